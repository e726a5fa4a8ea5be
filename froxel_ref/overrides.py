"""Overrides: one line changes one value of a document, ``scene.lights[2].radius=8``.

A path is keys joined by dots, with ``[index]`` into lists. ``scene.`` and ``settings.`` may be left out
where only one of them fits, and a switch goes by its own name (``emission=published``). The value is JSON,
or a string where it is not JSON.
"""

from __future__ import annotations

import dataclasses
import re
from typing import Any

from froxel_ref.kinds import Kind, Many, Nested, Vector, Word
from froxel_ref.records import InputError, Record, kinds_of, shown, suggest, to_json
from froxel_ref.settings import SWITCHES
from froxel_ref.strict_json import MalformedError, parse

__all__ = ["override"]

Step = str | int
_PATH = re.compile(r"[A-Za-z_]\w*(\[\d+\])*(\.[A-Za-z_]\w*(\[\d+\])*)*")


def override(cls: type[Record], raw: Any, text: str) -> Any:
    """A document with one value changed; the document given is left as it is.

    Parameters
    ----------
    cls : type of Record
        The document's record class, with the fields ``scene`` and ``settings``.
    raw : JSON value
        The document with every field written out, as `froxel_ref.records.to_json` makes it.
    text : str
        ``path=value``. An optional record that is null is made; a new ``type`` keeps the keys that fit it.

    Returns
    -------
    JSON value
        The changed document, not yet validated.

    Raises
    ------
    InputError
        Malformed override, unknown or ambiguous path, index out of range.

    Examples
    --------
    >>> from froxel_ref.scene_files import Document
    >>> override(Document, {"schema": 1, "scene": {"camera": {"width": 960}}}, "camera.width=64")
    {'schema': 1, 'scene': {'camera': {'width': 64}}}
    """
    path, equals, value = text.partition("=")
    path = path.strip()
    if not equals:
        raise InputError("override", f"{shown(text)} has no '=', must be path=value")
    if not _PATH.fullmatch(path):
        raise InputError("override", f"{shown(path)} is not a path such as scene.lights[2].radius")
    far = next((digits for digits in re.findall(r"\d+(?=\])", path) if len(digits) > 18), None)
    if far is not None:  # beyond every list, and perhaps beyond what int() reads
        raise InputError("override", f"{shown(path)} has an index of {len(far)} digits, no list is as long")
    steps: list[Step] = [int(digits) if digits else name
                         for name, digits in re.findall(r"([A-Za-z_]\w*)|\[(\d+)\]", path)]
    return _changed(Nested(classes=(cls,)), raw, "", _rooted(cls, steps), value.strip())


def _rooted(cls: type[Record], steps: list[Step]) -> list[Step]:
    """The path from the document's root, where the first part of it was left out."""
    first = str(steps[0])
    kinds = kinds_of(cls)
    if first in kinds:
        if first == "settings" and len(steps) > 1 and steps[1] in SWITCHES:
            return ["settings", "switches", *steps[1:]]
        return steps
    parts = {name: kinds_of(kind.classes[0]) for name, kind in kinds.items() if isinstance(kind, Nested)}
    roots: list[list[Step]] = [[name] for name, inside in parts.items() if first in inside]
    if first in SWITCHES:
        roots.append(["settings", "switches"])
    if not roots:
        known = {*SWITCHES}.union(kinds, *parts.values())
        raise InputError(first, f"is not a key here; {suggest(first, known)}")
    if len(roots) > 1:
        both = " or ".join(".".join(map(str, [*root, first])) for root in roots)
        raise InputError(first, f"is ambiguous, must be {both}")
    return roots[0] + steps


def _changed(kind: Kind, node: Any, place: str, steps: list[Step], value: str) -> Any:
    """``node``, of this kind and at this place, with the value at the end of ``steps`` changed."""
    if not steps:
        return _value(kind, place, value)
    step, rest = steps[0], steps[1:]
    if isinstance(kind, Nested) and isinstance(step, str):
        return _changed_record(kind, {} if node is None else node, place, steps, value)
    if isinstance(kind, (Many, Vector)) and isinstance(step, int):
        if not isinstance(node, list):
            raise InputError(place, f"is {shown(node)}, not a list")
        if step >= len(node):
            count = f"has only {len(node)}, from [0] to [{len(node) - 1}]" if node else "is empty"
            raise InputError(f"{place}[{step}]", f"does not exist, the list {count}")
        item = kind.item if isinstance(kind, Many) else kind.each
        return [*node[:step], _changed(item, node[step], f"{place}[{step}]", rest, value), *node[step + 1:]]
    if isinstance(step, int):
        raise InputError(place, f"is not a list, cannot be followed by [{step}]")
    if isinstance(kind, (Many, Vector)):
        raise InputError(place, f"is a list, must be followed by an index such as [0] before {step!r}")
    raise InputError(place, f"is one value, has no key {step!r}")


def _changed_record(kind: Nested, node: dict[str, Any], place: str, steps: list[Step], value: str) -> Any:
    name, rest = str(steps[0]), steps[1:]
    inner = f"{place}.{name}" if place else name
    kinds = {cls.kind: cls for cls in kind.classes}
    if name == "type" and len(kinds) > 1 and not rest:
        word = _value(Word(), inner, value)
        fitting = kinds_of(kinds[word]) if word in kinds else {}
        return {"type": word} | {key: item for key, item in node.items() if key in fitting}
    cls = kind.classes[0] if len(kinds) == 1 else kinds.get(node.get("type", ""))
    if cls is None:
        raise InputError(place, f"is null, its type must be set first ({', '.join(kinds)})")
    known = kinds_of(cls)
    if name not in known:
        raise InputError(inner, f"is not a key here; {suggest(name, known)}")
    return node | {name: _changed(known[name], node.get(name, _default(cls, name)), inner, rest, value)}


def _default(cls: type[Record], name: str) -> Any:
    default = next(f.default for f in dataclasses.fields(cls) if f.name == name)  # type: ignore[arg-type]
    return None if default is dataclasses.MISSING else to_json(default)


def _value(kind: Kind, place: str, value: str) -> Any:
    """The value as JSON; as a string where it is not JSON, or where only a string fits."""
    if isinstance(kind, Word) and not (value.startswith('"') or (value == "null" and kind.optional)):
        return value
    try:
        return parse(value, place)
    except MalformedError:
        return value
