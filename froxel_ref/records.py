"""Frozen, validated records: one declaration gives the type, the check, the JSON form and its schema.

A record is a frozen dataclass whose fields are declared with the functions of `froxel_ref.kinds`. The
same declaration validates a value at construction (once), reads and writes it as JSON, and exports a JSON
Schema, so the four cannot disagree. Every fault becomes one `InputError` that names the place.
"""

from __future__ import annotations

import dataclasses
import difflib
import re
import reprlib
from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any, ClassVar, TypeVar

if TYPE_CHECKING:
    from froxel_ref.kinds import Kind

__all__ = [
    "InputError", "Json", "Record", "at", "from_json", "json_schema", "key_shown", "kinds_of", "shown",
    "suggest", "to_json",
]

Json = Any
R = TypeVar("R", bound="Record")


class InputError(ValueError):
    """A fault in what the user gave: one line that names the place and what is allowed.

    Parameters
    ----------
    place : str
        Where, as a path from the document's root: ``lights[2].radius``; empty for the whole.
    problem : str
        What is wrong and what is allowed, without a full stop.

    Examples
    --------
    >>> print(InputError("radius", "is 0, must be above 0 m").under("lights[2]"))
    lights[2].radius: is 0, must be above 0 m
    """

    def __init__(self, place: str, problem: str) -> None:
        self.place, self.problem = place, problem
        super().__init__(f"{place}: {problem}" if place else problem)

    def __reduce__(self) -> tuple[type[InputError], tuple[str, str]]:
        return type(self), (self.place, self.problem)

    def under(self, parent: str) -> InputError:
        """The same fault as seen from the record that holds it.

        Parameters
        ----------
        parent : str
            The place of that record's field; empty for the whole.

        Returns
        -------
        InputError
            A new one, with the place lengthened.
        """
        if not self.place or self.place.startswith("["):
            return InputError(parent + self.place, self.problem)
        return InputError(f"{parent}.{self.place}" if parent else self.place, self.problem)


def suggest(word: str, known: Iterable[str]) -> str:
    """A hint for an unknown word.

    Parameters
    ----------
    word : str
        What was given.
    known : iterable of str
        What would have been right.

    Returns
    -------
    str
        The nearest known word as a question, or the list of all of them.

    Examples
    --------
    >>> suggest("raleigh", ["isotropic", "rayleigh"])
    "did you mean 'rayleigh'?"
    """
    known = sorted(known)
    near = difflib.get_close_matches(word, known, n=1, cutoff=0.5)
    return f"did you mean {near[0]!r}?" if near else f"known: {', '.join(known)}"


def shown(value: object) -> str:
    """A value as it may stand in a one-line message.

    Parameters
    ----------
    value : object
        Anything that a user gave.

    Returns
    -------
    str
        Its repr, in one line of at most 60 characters.

    Examples
    --------
    >>> shown(list(range(100)))
    '[0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, ...]'
    """
    line = _SHORT.repr(value)
    return line if len(line) <= 60 else line[:57] + "..."


_SHORT = reprlib.Repr()
_SHORT.maxlevel, _SHORT.maxlist, _SHORT.maxtuple, _SHORT.maxdict = 3, 12, 12, 4
_SHORT.maxstring = _SHORT.maxlong = _SHORT.maxother = 60


def key_shown(key: object) -> str:
    """A key of the user's as it may stand in a place.

    Parameters
    ----------
    key : object
        A key of a JSON object.

    Returns
    -------
    str
        The key itself if it is a short word, else as `shown`.

    Examples
    --------
    >>> key_shown("radius"), key_shown("a.b")
    ('radius', "'a.b'")
    """
    return key if isinstance(key, str) and re.fullmatch(r"[\w\- ]{1,60}", key) else shown(key)


# --- records ----------------------------------------------------------------------------------------


def at(place: str, function: Any, value: Any) -> Any:
    """``function(value)``, whose fault is reported at a place.

    Parameters
    ----------
    place : str
        Where the value stands.
    function : callable
        Takes the value.
    value : object
        Its argument.

    Returns
    -------
    object
        What the function returns.

    Raises
    ------
    InputError
        The function's own, with the place in front.

    Examples
    --------
    >>> def fail(value):
    ...     raise InputError("[1]", "is odd")
    >>> at("sizes", fail, (2, 3))
    Traceback (most recent call last):
    froxel_ref.records.InputError: sizes[1]: is odd
    """
    try:
        return function(value)
    except InputError as error:
        raise error.under(place) from None


class Record:
    """Base of the frozen dataclasses: every field is checked once, at construction.

    Attributes
    ----------
    kind : str
        The word under the key ``type`` that tells the class from others in JSON; empty where none must be.

    Raises
    ------
    InputError
        At construction: a value that its field does not allow, or fields that do not go together.

    Examples
    --------
    >>> from froxel_ref.scene import PointLight
    >>> PointLight(position=(0, 2, 0), intensity=(1, 1, -1))
    Traceback (most recent call last):
    froxel_ref.records.InputError: intensity[2]: is -1, must be at least 0 W/sr
    """

    kind: ClassVar[str] = ""

    def __post_init__(self) -> None:
        for name, kind in kinds_of(type(self)).items():
            object.__setattr__(self, name, at(name, kind.accept, getattr(self, name)))
        self.check_together()

    def check_together(self) -> None:
        """What must hold between fields; raises `InputError` with a relative place."""


def kinds_of(cls: type[Record]) -> dict[str, Kind]:
    """The kind of each field of a record class.

    Parameters
    ----------
    cls : type of Record
        The class.

    Returns
    -------
    dict of str to Kind
        By the field's name, in order.
    """
    return {f.name: f.metadata["kind"] for f in dataclasses.fields(cls) if "kind" in f.metadata}  # type: ignore[arg-type]


def from_json(cls: type[R], raw: Json) -> R:
    """A record from its JSON form.

    Parameters
    ----------
    cls : type of Record
        What it is.
    raw : JSON value
        An object with the record's fields as keys; those with a default may be missing.

    Returns
    -------
    Record
        An instance of ``cls``, checked.

    Raises
    ------
    InputError
        Unknown or missing key, wrong type, value out of bounds; the place is a path from ``raw``.

    Examples
    --------
    >>> from froxel_ref.scene import PointLight
    >>> from_json(PointLight, {"type": "point", "position": [0, 2, 0], "intensity": [1, 1, 1]}).radius
    16.0
    """
    if not isinstance(raw, Mapping):
        raise InputError("", f"is {shown(raw)}, must be an object")
    kinds = kinds_of(cls)
    unknown = [key for key in raw if key not in kinds and not (key == "type" and cls.kind)]
    if unknown:
        raise InputError(key_shown(unknown[0]), f"is not a key here; {suggest(str(unknown[0]), kinds)}")
    if "type" in raw and raw["type"] != cls.kind and "type" not in kinds:
        raise InputError("type", f"is {shown(raw['type'])}, must be {cls.kind!r}")
    needed = {f.name for f in dataclasses.fields(cls)  # type: ignore[arg-type]
              if f.default is dataclasses.MISSING and f.default_factory is dataclasses.MISSING}
    for name in kinds:
        if name in needed and name not in raw:
            raise InputError(name, f"is missing ({kinds[name].about or 'required'})")
    values = {name: at(name, kinds[name].read, raw[name]) for name in kinds if name in raw}
    return cls(**values)


def to_json(value: Any) -> Json:
    """A record, or a tuple of them, in its JSON form, every field written out.

    Parameters
    ----------
    value : Record, tuple, or what a record's field holds
        Anything else is its own JSON form.

    Returns
    -------
    JSON value
        `from_json` makes an equal record of it.

    Examples
    --------
    >>> from froxel_ref.settings import SecondLobe
    >>> to_json(SecondLobe())
    {'phase_anisotropy': -0.3, 'weight': 0.3}
    """
    if isinstance(value, Record):
        head = {"type": value.kind} if value.kind else {}
        return head | {name: to_json(getattr(value, name)) for name in kinds_of(type(value))}
    return [to_json(item) for item in value] if isinstance(value, tuple) else value


def json_schema(cls: type[Record]) -> dict[str, Json]:
    """The JSON Schema (2020-12) of a record class and of every class that it can hold.

    Parameters
    ----------
    cls : type of Record
        The class.

    Returns
    -------
    dict
        ``$ref`` to the class in ``$defs``. Rules between fields (`Record.check_together`) are not in it.

    Examples
    --------
    >>> from froxel_ref.settings import SecondLobe
    >>> json_schema(SecondLobe)["$defs"]["SecondLobe"]["properties"]["weight"]["maximum"]
    1.0
    """
    definitions: dict[str, Json] = {}
    waiting = [cls]
    while waiting:
        current = waiting.pop()
        if current.__name__ in definitions:
            continue
        definitions[current.__name__] = _definition(current)
        for kind in kinds_of(current).values():
            waiting.extend(kind.holds())
    return {"$schema": "https://json-schema.org/draft/2020-12/schema",
            "$ref": f"#/$defs/{cls.__name__}", "$defs": dict(sorted(definitions.items()))}


def _definition(cls: type[Record]) -> dict[str, Json]:
    kinds = kinds_of(cls)
    fields = {f.name: f for f in dataclasses.fields(cls)}  # type: ignore[arg-type]
    properties: dict[str, Json] = {"type": {"const": cls.kind}} if cls.kind else {}
    for name, kind in kinds.items():
        properties[name] = kind.described()
        if fields[name].default is not dataclasses.MISSING:
            properties[name]["default"] = to_json(fields[name].default)
    required = [name for name in kinds if fields[name].default is dataclasses.MISSING]
    summary = (cls.__doc__ or "").strip().split("\n")[0]
    return {"type": "object", "description": summary, "properties": properties,
            "required": (["type"] if cls.kind else []) + required, "additionalProperties": False}
