"""Frozen, validated records: one declaration gives the type, the check, the JSON form and its schema.

A record is a frozen dataclass whose fields are declared with `number`, `vector`, `choice`, `nested`…
The same declaration validates a value at construction (once), reads and writes it as JSON, and exports
a JSON Schema, so the four cannot disagree. Every fault becomes one `InputError` that names the place.
"""

from __future__ import annotations

import dataclasses
import difflib
import math
import re
import reprlib
from collections.abc import Iterable, Mapping, Sequence
from numbers import Real
from typing import Any, ClassVar, TypeVar

__all__ = [
    "InputError", "Record", "choice", "flag", "from_json", "integer", "many", "nested", "number",
    "numbers", "text", "to_json", "vector",
]

Json = Any
R = TypeVar("R", bound="Record")

# What may not stand in a string: messages, plans and manifests are lines of valid Unicode.
_UNPRINTABLE = r"[\u0000-\u001f\u007f-\u009f\u2028\u2029\ud800-\udfff]"


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
        """The same fault as seen from the record that holds it."""
        if not self.place or self.place.startswith("["):
            return InputError(parent + self.place, self.problem)
        return InputError(f"{parent}.{self.place}" if parent else self.place, self.problem)


def suggest(word: str, known: Iterable[str]) -> str:
    """A hint for an unknown word: the nearest known one, or the list of all of them."""
    known = sorted(known)
    near = difflib.get_close_matches(word, known, n=1, cutoff=0.5)
    return f"did you mean {near[0]!r}?" if near else f"known: {', '.join(known)}"


def shown(value: object) -> str:
    """A value as it may stand in a one-line message."""
    line = _SHORT.repr(value)
    return line if len(line) <= 60 else line[:57] + "..."


_SHORT = reprlib.Repr()
_SHORT.maxlevel, _SHORT.maxlist, _SHORT.maxtuple, _SHORT.maxdict = 3, 12, 12, 4
_SHORT.maxstring = _SHORT.maxlong = _SHORT.maxother = 60


def key_shown(key: object) -> str:
    """A key of the user's as it may stand in a place."""
    return key if isinstance(key, str) and re.fullmatch(r"[\w\- ]{1,60}", key) else shown(key)


# --- kinds of value ---------------------------------------------------------------------------------


@dataclasses.dataclass(frozen=True)
class Kind:
    """How one field's value is checked, read from JSON, written and described."""

    optional: bool = False
    about: str = ""

    def accept(self, value: Any) -> Any:
        """The value in its normal form; `InputError` (with a relative place) when it is not allowed."""
        if value is None and self.optional:
            return None
        return self.check(value)

    def read(self, raw: Json) -> Any:
        """The value from its JSON form."""
        return None if raw is None and self.optional else self.parse(raw)

    def check(self, value: Any) -> Any:
        raise NotImplementedError

    def parse(self, raw: Json) -> Any:
        return raw

    def schema(self) -> dict[str, Json]:
        raise NotImplementedError

    def described(self) -> dict[str, Json]:
        schema = self.schema()
        if self.optional:
            schema = {"anyOf": [schema, {"type": "null"}]}
        return schema | ({"description": self.about} if self.about else {})


@dataclasses.dataclass(frozen=True)
class Number(Kind):
    """A finite number within bounds, in a stated unit."""

    unit: str = ""
    above: float | None = None
    at_least: float | None = None
    below: float | None = None
    at_most: float | None = None
    whole: bool = False

    def allowed(self) -> str:
        """The bounds in words."""
        bounds = {"above": self.above, "at least": self.at_least,
                  "below": self.below, "at most": self.at_most}
        words = [f"{name} {bound:g}" for name, bound in bounds.items() if bound is not None]
        what = "a whole number" if self.whole else "a finite number"
        return " and ".join(words) + (f" {self.unit}" if self.unit else "") if words else what

    def check(self, value: Any) -> Any:
        what = "a whole number" if self.whole else "a finite number"
        if isinstance(value, bool) or not isinstance(value, Real):
            raise InputError("", f"is {shown(value)}, must be {what}")
        try:
            real = float(value)
        except OverflowError:
            real = math.inf
        if not math.isfinite(real) or (self.whole and not real.is_integer()):
            raise InputError("", f"is {real!r}, must be {what}")
        value = math.floor(value) if self.whole else real
        outside = (
            (self.above is not None and not value > self.above)
            or (self.at_least is not None and not value >= self.at_least)
            or (self.below is not None and not value < self.below)
            or (self.at_most is not None and not value <= self.at_most)
        )
        if outside:
            raise InputError("", f"is {repr(value).removesuffix('.0')}, must be {self.allowed()}")
        return value

    def schema(self) -> dict[str, Json]:
        keys = {"exclusiveMinimum": self.above, "minimum": self.at_least,
                "exclusiveMaximum": self.below, "maximum": self.at_most}
        schema: dict[str, Json] = {"type": "integer" if self.whole else "number"}
        schema |= {key: bound for key, bound in keys.items() if bound is not None}
        return schema | ({"unit": self.unit} if self.unit else {})


@dataclasses.dataclass(frozen=True)
class Vector(Kind):
    """A tuple of numbers of fixed or free length; a lone number stands for all of them if `spread`."""

    each: Number = Number()
    length: int | None = 3
    spread: bool = False

    def check(self, value: Any) -> Any:
        if hasattr(value, "tolist"):
            value = value.tolist()
        if self.spread and isinstance(value, Real) and not isinstance(value, bool):
            return self.each.check(value)
        if not isinstance(value, Sequence) or isinstance(value, (str, bytes, bytearray)):
            also = " or one number" if self.spread else ""
            raise InputError("", f"is {shown(value)}, must be {self.length or 'a list of'} numbers{also}")
        if self.length is not None and len(value) != self.length:
            raise InputError("", f"has {len(value)} numbers, must have {self.length}")
        return tuple(at(f"[{i}]", self.each.check, item) for i, item in enumerate(value))

    def schema(self) -> dict[str, Json]:
        each = self.each.schema()
        unit = {"unit": each.pop("unit")} if "unit" in each else {}
        size = {} if self.length is None else {"minItems": self.length, "maxItems": self.length}
        array = {"type": "array", "items": each, **size}
        return ({"anyOf": [each, array]} if self.spread else array) | unit


@dataclasses.dataclass(frozen=True)
class Word(Kind):
    """A string, from a list of words where one is given."""

    words: tuple[str, ...] = ()

    def check(self, value: Any) -> str:
        if not isinstance(value, str):
            raise InputError("", f"is {shown(value)}, must be a string")
        if self.words and value not in self.words:
            raise InputError("", f"is {shown(value)}, must be one of {', '.join(self.words)}")
        if re.search(_UNPRINTABLE, value):
            raise InputError("", f"is {shown(value)}, must hold no control characters")
        return value

    def schema(self) -> dict[str, Json]:
        if self.words:
            return {"enum": list(self.words)}
        return {"type": "string", "not": {"pattern": _UNPRINTABLE}}


@dataclasses.dataclass(frozen=True)
class Flag(Kind):
    """True or false."""

    def check(self, value: Any) -> bool:
        if not isinstance(value, bool):
            raise InputError("", f"is {shown(value)}, must be true or false")
        return value

    def schema(self) -> dict[str, Json]:
        return {"type": "boolean"}


@dataclasses.dataclass(frozen=True)
class Nested(Kind):
    """A record, or one of several told apart by the key ``type``."""

    classes: tuple[type[Record], ...] = ()

    def check(self, value: Any) -> Any:
        if type(value) not in self.classes:  # a subclass would come back from JSON as something else
            names = " or ".join(cls.__name__ for cls in self.classes)
            raise InputError("", f"is {shown(value)}, must be {names}")
        return value

    def parse(self, raw: Json) -> Any:
        if len(self.classes) == 1:
            return from_json(self.classes[0], raw)
        kinds = {cls.kind: cls for cls in self.classes}
        if not isinstance(raw, Mapping):
            raise InputError("", f"is {shown(raw)}, must be an object with the key 'type'")
        word = raw.get("type")
        if not isinstance(word, str) or word not in kinds:
            problem = f"is {shown(word)}" if "type" in raw else "is missing"
            raise InputError("type", f"{problem}; {suggest(word if isinstance(word, str) else '', kinds)}")
        return from_json(kinds[word], raw)

    def schema(self) -> dict[str, Json]:
        references = [{"$ref": f"#/$defs/{cls.__name__}"} for cls in self.classes]
        return references[0] if len(references) == 1 else {"anyOf": references}


@dataclasses.dataclass(frozen=True)
class Many(Kind):
    """A tuple of records."""

    item: Nested = Nested()

    def check(self, value: Any) -> tuple[Any, ...]:
        if not isinstance(value, (list, tuple)):
            raise InputError("", f"is {shown(value)}, must be a list")
        return tuple(at(f"[{i}]", self.item.check, item) for i, item in enumerate(value))

    def parse(self, raw: Json) -> Any:
        if not isinstance(raw, list):
            raise InputError("", f"is {shown(raw)}, must be a list")
        return tuple(at(f"[{i}]", self.item.parse, item) for i, item in enumerate(raw))

    def schema(self) -> dict[str, Json]:
        return {"type": "array", "items": self.item.schema()}


# --- declaring fields -------------------------------------------------------------------------------


def _field(kind: Kind, default: Any) -> Any:
    extra = {} if default is dataclasses.MISSING else {"default": default}
    return dataclasses.field(metadata={"kind": kind}, **extra)


def number(default: Any = dataclasses.MISSING, about: str = "", *, optional: bool = False,
           **bounds: Any) -> Any:
    """A field that holds one finite number; bounds are ``above``, ``at_least``, ``below``, ``at_most``."""
    return _field(Number(optional, about, **bounds), default)


def integer(default: Any = dataclasses.MISSING, about: str = "", *, optional: bool = False,
            **bounds: Any) -> Any:
    """A field that holds one whole number."""
    return _field(Number(optional, about, whole=True, **bounds), default)


def vector(default: Any = dataclasses.MISSING, about: str = "", *, length: int = 3, spread: bool = False,
           optional: bool = False, **bounds: Any) -> Any:
    """A field that holds ``length`` finite numbers (or one for all of them, if ``spread``)."""
    return _field(Vector(optional, about, Number(**bounds), length, spread), default)


def numbers(default: Any = dataclasses.MISSING, about: str = "", *, whole: bool = False,
            optional: bool = False, **bounds: Any) -> Any:
    """A field that holds any number of finite numbers."""
    return _field(Vector(optional, about, Number(whole=whole, **bounds), None), default)


def choice(*words: str, default: Any = dataclasses.MISSING, about: str = "", optional: bool = False) -> Any:
    """A field that holds one of the given words."""
    return _field(Word(optional, about, words), default)


def text(default: Any = dataclasses.MISSING, about: str = "", *, optional: bool = False) -> Any:
    """A field that holds a string."""
    return _field(Word(optional, about), default)


def flag(default: Any = dataclasses.MISSING, about: str = "") -> Any:
    """A field that holds true or false."""
    return _field(Flag(False, about), default)


def nested(*classes: type[Record], default: Any = dataclasses.MISSING, about: str = "",
           optional: bool = False) -> Any:
    """A field that holds one record of the given classes."""
    return _field(Nested(optional, about, classes), default)


def many(*classes: type[Record], about: str = "") -> Any:
    """A field that holds a tuple of records of the given classes; empty unless given."""
    return _field(Many(False, about, Nested(classes=classes)), ())


# --- records ----------------------------------------------------------------------------------------


def at(place: str, function: Any, value: Any) -> Any:
    """``function(value)``, whose fault is reported at ``place``."""
    try:
        return function(value)
    except InputError as error:
        raise error.under(place) from None


class Record:
    """Base of the frozen dataclasses: every field is checked once, at construction."""

    kind: ClassVar[str] = ""

    def __post_init__(self) -> None:
        for name, kind in kinds_of(type(self)).items():
            object.__setattr__(self, name, at(name, kind.accept, getattr(self, name)))
        self.check_together()

    def check_together(self) -> None:
        """What must hold between fields; raises `InputError` with a relative place."""


def kinds_of(cls: type[Record]) -> dict[str, Kind]:
    """The kind of each field of a record class, in order."""
    return {f.name: f.metadata["kind"] for f in dataclasses.fields(cls) if "kind" in f.metadata}  # type: ignore[arg-type]


def from_json(cls: type[R], raw: Json) -> R:
    """A record from its JSON form.

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
    """A record, or a tuple of them, in its JSON form, every field written out."""
    if isinstance(value, Record):
        head = {"type": value.kind} if value.kind else {}
        return head | {name: to_json(getattr(value, name)) for name in kinds_of(type(value))}
    return [to_json(item) for item in value] if isinstance(value, tuple) else value


def json_schema(cls: type[Record]) -> dict[str, Json]:
    """The JSON Schema (2020-12) of a record class and of every class that it can hold."""
    definitions: dict[str, Json] = {}
    waiting = [cls]
    while waiting:
        current = waiting.pop()
        if current.__name__ in definitions:
            continue
        definitions[current.__name__] = _definition(current)
        for kind in kinds_of(current).values():
            inner = kind.item if isinstance(kind, Many) else kind
            waiting.extend(inner.classes if isinstance(inner, Nested) else ())
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
