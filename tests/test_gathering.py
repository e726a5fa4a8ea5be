"""Fields gathered from their parts: the same as laid out at the end, whatever comes first, and nothing twice."""

from __future__ import annotations

import tracemalloc

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from froxel_ref.arrays import Index
from froxel_ref.checkerboard import lattices
from froxel_ref.gathering import Gathered

SHAPE = 6, 4, 5
SLABS: list[Index] = [(slice(a, b), slice(0, 4), slice(0, 5)) for a, b in ((0, 2), (2, 4), (4, 6))]
HALVES: list[Index] = [(slice(0, 6), *box[1:]) for box in lattices((12, 4, 5), 0)]


def size(place: Index) -> tuple[int, ...]:
    return tuple(len(range(n)[r]) for n, r in zip(SHAPE, place, strict=True))


@given(places=st.sampled_from([SLABS, HALVES]), data=st.data(), values=st.sampled_from([1, 2, 9]),
       order=st.randoms(use_true_random=False))
def test_gathered_is_laid_out(places: list[Index], data: st.DataObject, values: int, order: object) -> None:
    """Each part full, or of length 1 along some axes; as few axes as may be, whatever the order."""
    rng = np.random.default_rng(data.draw(st.integers(0, 99)))
    parts, whole = [], np.zeros((2, *SHAPE))
    for place in places:
        axes = data.draw(st.tuples(*[st.booleans()] * 3))
        shape = [n if full else 1 for n, full in zip(size(place), axes, strict=True)]
        parts.append(rng.integers(0, values, (2, *shape)).astype(float))
        whole[:, *place] = parts[-1]
    gathered = Gathered(places, SHAPE)
    numbers = list(range(len(places)))
    order.shuffle(numbers)  # type: ignore[attr-defined]
    for k in numbers:
        gathered.add(k, "field", parts[k])
    found = gathered.fields()["field"]
    assert np.array_equal(np.broadcast_to(found, whole.shape), whole)
    for axis in (1, 2, 3):
        if places is SLABS and axis > 1:
            assert (found.shape[axis] > 1) == any(part.shape[axis] > 1 for part in parts)
    alike = all(part.shape[1:] == (1, 1, 1) and np.array_equal(part, parts[0]) for part in parts)
    assert (found.shape[1:] == (1, 1, 1)) == alike


@pytest.mark.parametrize("places", [SLABS, HALVES])
def test_a_part_is_written_to_its_place(places: list[Index]) -> None:
    gathered = Gathered(places, SHAPE)
    for k, place in enumerate(places):
        view = gathered.room(k, "field")((2, *size(place)), np.dtype(np.float32))
        view[...] = k + 1
        gathered.add(k, "field", view)
    found = gathered.fields()["field"]
    assert found.dtype == np.float32
    assert found.shape == (2, *SHAPE)
    for k, place in enumerate(places):
        assert (found[:, *place] == k + 1).all()


def test_what_may_not_vary_has_no_place_yet() -> None:
    """A slice alone does not tell whether the next is another."""
    places = [(slice(k, k + 1), slice(0, 4), slice(0, 5)) for k in range(6)]
    gathered = Gathered(places, SHAPE)
    for k in range(6):
        view = gathered.room(k, "field")((1, 1, 4, 5), np.dtype(float))
        view[...] = 3.0
        gathered.add(k, "field", view)
    assert gathered.fields()["field"].shape == (1, 1, 4, 5)


def test_what_has_no_such_axes_is_the_first_part_s() -> None:
    gathered = Gathered(SLABS, SHAPE)
    nothing = np.zeros((3, 0, 0, 0))
    for k in range(3):
        gathered.add(k, "numbers", np.array([1.0, 2.0]), spatial=False)
        gathered.add(k, "nothing", nothing)
    fields = gathered.fields()
    assert list(fields) == ["numbers", "nothing"]
    assert fields["numbers"].tolist() == [1.0, 2.0]
    assert fields["nothing"].shape == nothing.shape


def test_parts_are_forgotten() -> None:
    """The peak is the field and one part, not the field and all parts."""
    places = [(slice(10 * k, 10 * k + 10), slice(0, 50), slice(0, 50)) for k in range(20)]
    gathered = Gathered(places, (200, 50, 50))
    tracemalloc.start()
    for k in range(20):
        gathered.add(k, "field", np.full((10, 50, 50), float(k)))
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 8 * 200 * 50 * 50 * 1.08
