"""Kinds of value that a record's fields hold, and the functions that declare such fields.

One declaration gives a field its type, its check, its JSON form and its JSON Schema, so that the four
cannot disagree (`froxel_ref.records`).
"""

from __future__ import annotations

import dataclasses
import math
import re
from collections.abc import Mapping, Sequence
from numbers import Real
from typing import Any

from froxel_ref.records import InputError, Json, Record, at, from_json, shown, suggest

__all__ = [
    "Flag", "Kind", "Many", "Nested", "Number", "Vector", "Word", "choice", "flag", "integer", "many",
    "nested", "number", "numbers", "text", "vector",
]

# What may not stand in a string: messages, plans and manifests are lines of valid Unicode.
_UNPRINTABLE = r"[\u0000-\u001f\u007f-\u009f\u2028\u2029\ud800-\udfff]"


# --- kinds of value ---------------------------------------------------------------------------------


@dataclasses.dataclass(frozen=True)
class Kind:
    """How one field's value is checked, read from JSON, written and described.

    Parameters
    ----------
    optional : bool
        Whether None is allowed.
    about : str
        The field in a few words.
    """

    optional: bool = False
    about: str = ""

    def accept(self, value: Any) -> Any:
        """The value in its normal form.

        Parameters
        ----------
        value : object
            As given by a caller.

        Returns
        -------
        object
            Immutable, and equal for equal meaning: numbers as float, lists as tuples.

        Raises
        ------
        InputError
            Not allowed; the place is relative to the field.
        """
        if value is None and self.optional:
            return None
        return self.check(value)

    def read(self, raw: Json) -> Any:
        """The value from its JSON form, not yet checked.

        Parameters
        ----------
        raw : JSON value
            As `json.loads` gives it.

        Returns
        -------
        object
            What `accept` takes.

        Raises
        ------
        InputError
            A record in it is not allowed.
        """
        return None if raw is None and self.optional else self.parse(raw)

    def check(self, value: Any) -> Any:
        """`accept` for what is not None; each kind has its own."""
        raise NotImplementedError

    def parse(self, raw: Json) -> Any:
        """`read` for what is not null; not yet checked."""
        return raw

    def schema(self) -> dict[str, Json]:
        """The JSON Schema of what `check` allows, as far as one can say it."""
        raise NotImplementedError

    def holds(self) -> tuple[type[Record], ...]:
        """The record classes that a value may be, or have in it."""
        return ()

    def described(self) -> dict[str, Json]:
        """`schema` with what the field adds: null where optional, and the sentence about it."""
        schema = self.schema()
        if self.optional:
            schema = {"anyOf": [schema, {"type": "null"}]}
        return schema | ({"description": self.about} if self.about else {})


@dataclasses.dataclass(frozen=True)
class Number(Kind):
    """A finite number within bounds, in a stated unit.

    The bounds say what the number means (a radius is above 0); ``within`` is how far it may go (no scene is
    larger than this), and is only spoken of where it is left.
    """

    unit: str = ""
    above: float | None = None
    at_least: float | None = None
    below: float | None = None
    at_most: float | None = None
    within: tuple[float, float] | None = None
    whole: bool = False

    def allowed(self) -> str:
        """The bounds in words, for messages.

        Returns
        -------
        str
            Such as ``above 0 and at most 1 m``.
        """
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
        if self.within is not None and not self.within[0] <= value <= self.within[1]:
            low, high = self.within
            unit = f" {self.unit}" if self.unit else ""
            raise InputError("", f"is {repr(value).removesuffix('.0')}, must be within {low:g} and {high:g}{unit}")
        return value

    def schema(self) -> dict[str, Json]:
        low, high = self.within or (None, None)
        least = [bound for bound in (self.at_least, low) if bound is not None]
        most = [bound for bound in (self.at_most, high) if bound is not None]
        keys = {"exclusiveMinimum": self.above, "minimum": max(least, default=None),
                "exclusiveMaximum": self.below, "maximum": min(most, default=None)}
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
            allowed = f"one of {', '.join(self.words)}" if len(self.words) > 1 else shown(self.words[0])
            raise InputError("", f"is {shown(value)}, must be {allowed}")
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

    def holds(self) -> tuple[type[Record], ...]:
        return self.classes

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

    def holds(self) -> tuple[type[Record], ...]:
        return self.item.holds()

    def schema(self) -> dict[str, Json]:
        return {"type": "array", "items": self.item.schema()}


# --- declaring fields -------------------------------------------------------------------------------


def _field(kind: Kind, default: Any) -> Any:
    extra = {} if default is dataclasses.MISSING else {"default": default}
    return dataclasses.field(metadata={"kind": kind}, **extra)


def number(default: Any = dataclasses.MISSING, about: str = "", *, optional: bool = False,
           **bounds: Any) -> Any:
    """A field that holds one finite number, kept as a float.

    Parameters
    ----------
    default : float or None
        The value where none is given; without it the field must be given.
    about : str
        The field in a few words, for the schema and for messages.
    optional : bool
        Whether None (null in JSON) is allowed, too.
    **bounds
        ``above``, ``at_least``, ``below``, ``at_most`` : float, and ``unit`` : str, of both bounds and value.

    Returns
    -------
    dataclasses.Field
        The declaration, for the body of a record class.

    Examples
    --------
    >>> @dataclasses.dataclass(frozen=True, kw_only=True)
    ... class Fan(Record):
    ...     blades: int = integer(3, at_least=1)
    ...     reach: float = number(above=0.0, unit="m")
    >>> Fan(reach=2)
    Fan(blades=3, reach=2.0)
    >>> Fan(reach=0)
    Traceback (most recent call last):
    froxel_ref.records.InputError: reach: is 0, must be above 0 m
    """
    return _field(Number(optional, about, **bounds), default)


def integer(default: Any = dataclasses.MISSING, about: str = "", *, optional: bool = False,
            **bounds: Any) -> Any:
    """A field that holds one whole number, kept as an int.

    Parameters
    ----------
    default : int or None
        As for `number`.
    about, optional, **bounds
        As for `number`.

    Returns
    -------
    dataclasses.Field
        The declaration, for the body of a record class.
    """
    return _field(Number(optional, about, whole=True, **bounds), default)


def vector(default: Any = dataclasses.MISSING, about: str = "", *, length: int = 3, spread: bool = False,
           optional: bool = False, **bounds: Any) -> Any:
    """A field that holds a fixed count of finite numbers, kept as a tuple of floats.

    Parameters
    ----------
    default : tuple of float, or float, or None
        As for `number`.
    about, optional, **bounds
        As for `number`; the bounds are each number's.
    length : int
        How many numbers.
    spread : bool
        Whether one number may stand for all of them; it is kept as that one.

    Returns
    -------
    dataclasses.Field
        The declaration, for the body of a record class.
    """
    return _field(Vector(optional, about, Number(**bounds), length, spread), default)


def numbers(default: Any = dataclasses.MISSING, about: str = "", *, whole: bool = False,
            optional: bool = False, **bounds: Any) -> Any:
    """A field that holds any count of finite numbers, kept as a tuple.

    Parameters
    ----------
    default : tuple or None
        As for `number`.
    about, optional, **bounds
        As for `number`; the bounds are each number's.
    whole : bool
        Whether they must be whole numbers.

    Returns
    -------
    dataclasses.Field
        The declaration, for the body of a record class.
    """
    return _field(Vector(optional, about, Number(whole=whole, **bounds), None), default)


def choice(*words: str, default: Any = dataclasses.MISSING, about: str = "", optional: bool = False) -> Any:
    """A field that holds one of the given words.

    Parameters
    ----------
    *words : str
        All that is allowed.
    default : str or None
        As for `number`.
    about, optional
        As for `number`.

    Returns
    -------
    dataclasses.Field
        The declaration, for the body of a record class.
    """
    return _field(Word(optional, about, words), default)


def text(default: Any = dataclasses.MISSING, about: str = "", *, optional: bool = False) -> Any:
    """A field that holds a string without control characters.

    Parameters
    ----------
    default : str or None
        As for `number`.
    about, optional
        As for `number`.

    Returns
    -------
    dataclasses.Field
        The declaration, for the body of a record class.
    """
    return _field(Word(optional, about), default)


def flag(default: Any = dataclasses.MISSING, about: str = "") -> Any:
    """A field that holds true or false.

    Parameters
    ----------
    default : bool
        As for `number`.
    about : str
        As for `number`.

    Returns
    -------
    dataclasses.Field
        The declaration, for the body of a record class.
    """
    return _field(Flag(False, about), default)


def nested(*classes: type[Record], default: Any = dataclasses.MISSING, about: str = "",
           optional: bool = False) -> Any:
    """A field that holds one record.

    Parameters
    ----------
    *classes : type of Record
        What it may be; in JSON, several classes are told apart by the key ``type``.
    default : Record or None
        As for `number`.
    about, optional
        As for `number`.

    Returns
    -------
    dataclasses.Field
        The declaration, for the body of a record class.
    """
    return _field(Nested(optional, about, classes), default)


def many(*classes: type[Record], about: str = "") -> Any:
    """A field that holds a tuple of records, in JSON a list; empty unless given.

    Parameters
    ----------
    *classes : type of Record
        As for `nested`.
    about : str
        As for `number`.

    Returns
    -------
    dataclasses.Field
        The declaration, for the body of a record class.
    """
    return _field(Many(False, about, Nested(classes=classes)), ())
