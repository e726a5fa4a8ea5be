"""Records: one declaration checks a value, reads it, writes it and describes it."""

from __future__ import annotations

import dataclasses
import pickle
from dataclasses import dataclass
from fractions import Fraction
from typing import ClassVar

import jsonschema
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from froxel_ref.kinds import (
    Many,
    Nested,
    Number,
    Vector,
    Word,
    choice,
    flag,
    integer,
    many,
    nested,
    number,
    numbers,
    text,
    vector,
)
from froxel_ref.records import InputError, Record, from_json, json_schema, shown, suggest, to_json


@dataclass(frozen=True, kw_only=True)
class Wheel(Record):
    """A wheel."""

    kind: ClassVar[str] = "wheel"
    radius: float = number(about="its radius", unit="m", above=0.0, at_most=2.0)
    spokes: int = integer(8, "how many", at_least=3)


@dataclass(frozen=True, kw_only=True)
class Runner(Record):
    """A sledge's runner."""

    kind: ClassVar[str] = "runner"
    length: float = number(1.0, "its length", unit="m", above=0.0)


@dataclass(frozen=True, kw_only=True)
class Cart(Record):
    """A cart."""

    name: str = text("", "its name")
    feet: tuple[Wheel | Runner, ...] = many(Wheel, Runner, about="what it stands on")
    size: tuple[float, float] = vector((1.0, 2.0), "its size", length=2, at_least=0.0)
    load: tuple[float, ...] | None = numbers(None, "masses", optional=True)
    spare: Wheel | None = nested(Wheel, default=None, optional=True, about="a spare wheel")
    tint: float | tuple[float, float, float] = vector(0.5, "its colour", spread=True)
    covered: bool = flag(False, "under a roof")
    gait: str = choice("walk", "trot", default="walk", about="how fast")


CART = {"name": "hay",
        "feet": [{"type": "wheel", "radius": 0.5, "spokes": 12}, {"type": "runner", "length": 2.0}],
        "size": [1.5, 3.0], "load": [1.0, 2.0, 3.0], "spare": {"type": "wheel", "radius": 0.25, "spokes": 8},
        "tint": [0.1, 0.2, 0.3], "covered": True, "gait": "trot"}


def test_a_record_is_what_its_json_says_and_back() -> None:
    cart = from_json(Cart, CART)
    assert cart == Cart(name="hay", feet=(Wheel(radius=0.5, spokes=12), Runner(length=2.0)), size=(1.5, 3.0),
                        load=(1.0, 2.0, 3.0), spare=Wheel(radius=0.25), tint=(0.1, 0.2, 0.3), covered=True,
                        gait="trot")
    assert to_json(cart) == CART


def test_defaults_are_written_out() -> None:
    assert to_json(Cart()) == {"name": "", "feet": [], "size": [1.0, 2.0], "load": None, "spare": None,
                               "tint": 0.5, "covered": False, "gait": "walk"}


@pytest.mark.parametrize(("raw", "message"), [
    (3, "is 3, must be an object"),
    ({"nmae": "x"}, "nmae: is not a key here; did you mean 'name'?"),
    ({"zzzzzz": 1}, "zzzzzz: is not a key here; known: covered, feet, gait, load, name, size, spare, tint"),
    ({"a\nb": 1}, "'a\\nb': is not a key here; known: covered, feet, gait, load, name, size, spare, tint"),
    ({"type": "x"}, "type: is not a key here; known: covered, feet, gait, load, name, size, spare, tint"),
    ({"name": 3}, "name: is 3, must be a string"),
    ({"name": "two\nlines"}, "name: is 'two\\nlines', must hold no control characters"),
    ({"name": "\ud800"}, "name: is '\\ud800', must hold no control characters"),
    ({"feet": {}}, "feet: is {}, must be a list"),
    ({"feet": [3]}, "feet[0]: is 3, must be an object with the key 'type'"),
    ({"feet": [{"radius": 1}]}, "feet[0].type: is missing; known: runner, wheel"),
    ({"feet": [{"type": "whel"}]}, "feet[0].type: is 'whel'; did you mean 'wheel'?"),
    ({"feet": [{"type": []}]}, "feet[0].type: is []; known: runner, wheel"),
    ({"feet": [{"type": "wheel"}]}, "feet[0].radius: is missing (its radius)"),
    ({"feet": [{"type": "wheel", "radius": 0}]}, "feet[0].radius: is 0, must be above 0 and at most 2 m"),
    ({"feet": [{"type": "wheel", "radius": 3}]}, "feet[0].radius: is 3, must be above 0 and at most 2 m"),
    ({"feet": [{"type": "wheel", "radius": None}]}, "feet[0].radius: is None, must be a finite number"),
    ({"feet": [{"type": "wheel", "radius": 1, "spokes": 3.5}]},
     "feet[0].spokes: is 3.5, must be a whole number"),
    ({"feet": [{"type": "wheel", "radius": 1, "spokes": True}]},
     "feet[0].spokes: is True, must be a whole number"),
    ({"spare": {"type": "runner", "radius": 1}}, "spare.type: is 'runner', must be 'wheel'"),
    ({"size": [1]}, "size: has 1 numbers, must have 2"),
    ({"size": 1}, "size: is 1, must be 2 numbers"),
    ({"size": "12"}, "size: is '12', must be 2 numbers"),
    ({"size": [1, -2]}, "size[1]: is -2, must be at least 0"),
    ({"size": [1, float("nan")]}, "size[1]: is nan, must be a finite number"),
    ({"size": [1, float("inf")]}, "size[1]: is inf, must be a finite number"),
    ({"size": [1, 10**400]}, "size[1]: is inf, must be a finite number"),
    ({"size": [1, "2"]}, "size[1]: is '2', must be a finite number"),
    ({"size": [1, [2]]}, "size[1]: is [2], must be a finite number"),
    ({"load": 3}, "load: is 3, must be a list of numbers"),
    ({"tint": "red"}, "tint: is 'red', must be 3 numbers or one number"),
    ({"tint": False}, "tint: is False, must be 3 numbers or one number"),
    ({"covered": 1}, "covered: is 1, must be true or false"),
    ({"gait": "run"}, "gait: is 'run', must be one of walk, trot"),
])
def test_what_is_refused_is_named_in_one_line(raw: object, message: str) -> None:
    with pytest.raises(InputError) as caught:
        from_json(Cart, raw)
    assert str(caught.value) == message
    assert "\n" not in message


@pytest.mark.parametrize(("value", "message"), [
    (np.array([1.0, 2.0, 3.0]), "is array([1., 2., 3.]), must be a finite number"),
    (1 + 2j, "is (1+2j), must be a finite number"),
    (np.float32("nan"), "is nan, must be a finite number"),
    (10**400, "is inf, must be a finite number"),
    (None, "is None, must be a finite number"),
    (np.True_, "is np.True_, must be a finite number"),
])
def test_what_python_gives_as_a_number_is_checked_too(value: object, message: str) -> None:
    with pytest.raises(InputError) as caught:
        Number().accept(value)
    assert str(caught.value) == message


@pytest.mark.parametrize("value", [2, 2.0, np.float32(2), np.int16(2), Fraction(2)])
def test_every_real_number_becomes_a_float(value: object) -> None:
    accepted = Number().accept(value)
    assert (accepted, type(accepted)) == (2.0, float)


@pytest.mark.parametrize("value", [2, 2.0, np.float32(2), np.int16(2)])
def test_a_whole_number_becomes_an_int(value: object) -> None:
    accepted = Number(whole=True).accept(value)
    assert (accepted, type(accepted)) == (2, int)


def test_a_large_whole_number_keeps_its_digits() -> None:
    assert Number(whole=True).accept(2**64 + 1) == 18446744073709551617


@pytest.mark.parametrize("value", [
    [1, 2, 3], (1.0, 2.0, 3.0), np.arange(1, 4), np.array([1, 2, 3], np.float32), range(1, 4)])
def test_every_sequence_becomes_a_tuple_of_floats(value: object) -> None:
    assert Vector().accept(value) == (1.0, 2.0, 3.0)


@pytest.mark.parametrize("value", [3, 3.0, np.float32(3), np.float64(3)])
def test_a_lone_number_may_stand_for_all(value: object) -> None:
    assert Vector(spread=True).accept(value) == 3.0


@pytest.mark.parametrize("value", ["123", b"123", {1, 2, 3}, {"x": 1}])
def test_what_is_no_sequence_of_numbers_is_refused(value: object) -> None:
    with pytest.raises(InputError, match="must be 3 numbers"):
        Vector().accept(value)


def test_a_subclass_is_refused_since_it_would_not_come_back() -> None:
    @dataclass(frozen=True, kw_only=True)
    class Large(Wheel):
        """A large wheel."""

        kind: ClassVar[str] = "large"

    with pytest.raises(InputError, match=r"^feet\[0\]: is .*Large.* must be Wheel or Runner$"):
        Cart(feet=(Large(radius=2.0),))


def test_a_record_cannot_be_changed() -> None:
    with pytest.raises(dataclasses.FrozenInstanceError):
        Cart().name = "x"  # type: ignore[misc]


def test_a_changed_copy_is_checked() -> None:
    with pytest.raises(InputError, match=r"^size: has 3 numbers, must have 2$"):
        dataclasses.replace(Cart(), size=(1, 2, 3))


@pytest.mark.parametrize(("parent", "place", "expected"), [
    ("lights[2]", "radius", "lights[2].radius: p"),
    ("lights", "[2].radius", "lights[2].radius: p"),
    ("lights", "", "lights: p"),
    ("", "radius", "radius: p"),
])
def test_a_fault_seen_from_above(parent: str, place: str, expected: str) -> None:
    assert str(InputError(place, "p").under(parent)) == expected


def test_a_fault_survives_pickling() -> None:
    again = pickle.loads(pickle.dumps(InputError("lights[2]", "is odd")))
    assert (str(again), again.place, again.problem) == ("lights[2]: is odd", "lights[2]", "is odd")


@pytest.mark.parametrize("value", [
    list(range(10**5)), "x" * 10**5, {str(i): i for i in range(1000)}, [[[[[[1]]]]]], 10**4000, "a\nb"])
def test_any_value_is_shown_on_one_short_line(value: object) -> None:
    line = shown(value)
    assert len(line) <= 60
    assert "\n" not in line


def test_suggestions() -> None:
    assert suggest("raduis", ["radius", "name"]) == "did you mean 'radius'?"
    assert suggest("q", ["radius", "name"]) == "known: name, radius"


def test_the_schema_by_hand() -> None:
    definitions = json_schema(Cart)["$defs"]
    assert sorted(definitions) == ["Cart", "Runner", "Wheel"]
    assert definitions["Wheel"] == {
        "type": "object", "description": "A wheel.", "additionalProperties": False,
        "required": ["type", "radius"],
        "properties": {
            "type": {"const": "wheel"},
            "radius": {"type": "number", "exclusiveMinimum": 0.0, "maximum": 2.0, "unit": "m",
                       "description": "its radius"},
            "spokes": {"type": "integer", "minimum": 3, "description": "how many", "default": 8}}}
    assert definitions["Cart"]["properties"]["tint"]["anyOf"] == [
        {"type": "number"}, {"type": "array", "items": {"type": "number"}, "minItems": 3, "maxItems": 3}]


# Values on both sides of every rule that a single field can state.
VALUES = st.one_of(
    st.none(), st.booleans(), st.integers(-3, 20), st.floats(-4, 4),
    st.sampled_from(["walk", "trot", "", "a\nb"]), st.lists(st.floats(-1, 4), max_size=4),
    st.lists(st.sampled_from([1, "x", None, True]), max_size=3), st.just({}), st.just([{}]),
    st.fixed_dictionaries({"type": st.sampled_from(["wheel", "runner", "leg"])},
                          optional={"radius": st.floats(-1, 3), "spokes": st.integers(0, 9)}))


@given(changes=st.dictionaries(
    st.sampled_from([*CART, "other"]), VALUES | st.lists(VALUES, max_size=2), max_size=3))
def test_the_schema_refuses_exactly_what_the_record_refuses(changes: dict[str, object]) -> None:
    document = CART | changes
    # A float such as 12.0 is a whole number to both.
    valid = jsonschema.Draft202012Validator(json_schema(Cart)).is_valid(document)
    try:
        cart = from_json(Cart, document)
    except InputError:
        assert not valid
    else:
        assert valid
        assert from_json(Cart, to_json(cart)) == cart


@pytest.mark.parametrize("kind", [Number(), Vector(), Word(), Many(item=Nested(classes=(Wheel,))),
                                  Nested(classes=(Wheel,))], ids=lambda kind: type(kind).__name__)
def test_null_is_refused_unless_optional(kind: Number) -> None:
    with pytest.raises(InputError):
        kind.accept(None)
    assert dataclasses.replace(kind, optional=True).accept(None) is None
