"""Parts of a grid: every slice and every box held against lists of numbers and masks of samples."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from froxel_ref.grid_parts import (
    bounds_in,
    candidates_in,
    is_whole,
    part_of,
    part_slice,
    slices_of,
    whole_slice,
)

COUNT = 9


@st.composite
def ranges(draw: st.DrawFn, step: bool = False) -> slice:
    start, stop = sorted(draw(st.tuples(st.integers(0, COUNT - 1), st.integers(1, COUNT))))
    return slice(start, max(stop, start + 1), draw(st.integers(1, 3)) if step else None)


@given(outer=ranges(step=True), inner=ranges())
def test_a_range_of_a_part_lies_there_in_the_whole(outer: slice, inner: slice) -> None:
    numbers = list(range(COUNT))
    part = numbers[outer]
    inner = slice(min(inner.start, len(part)), min(inner.stop, len(part)))
    assert numbers[whole_slice(outer, inner)] == part[inner]


@given(outer=ranges(step=True), inner=ranges())
def test_a_part_has_of_a_range_what_both_have(outer: slice, inner: slice) -> None:
    numbers = list(range(COUNT))
    part = numbers[outer]
    found = part_slice(outer, inner)
    assert part[found] == [n for n in part if n in numbers[inner]]
    assert 0 <= found.start <= found.stop <= len(part)


@given(box=st.tuples(*[ranges(step=True)] * 3), areas=st.lists(st.tuples(ranges(), ranges()), min_size=1, max_size=4))
def test_boxes_hold_the_same_samples_of_a_part(box: tuple[slice, slice, slice], areas: list[tuple[slice, slice]]
                                               ) -> None:
    """Slice by slice, of two lights, one of which reaches nothing in the last slice."""
    boxes = np.zeros((2, COUNT, 4), np.intp)
    for z in range(COUNT):
        y, x = areas[z % len(areas)]
        boxes[:, z] = y.start, y.stop, x.start, x.stop
    boxes[1, -1] = 0
    found = bounds_in(boxes, box)
    for light in range(2):
        whole = np.zeros((COUNT,) * 3, bool)
        for z, (top, bottom, left, right) in enumerate(boxes[light]):
            whole[z, top:bottom, left:right] = True
        want = whole[box]
        got = np.zeros_like(want)
        for z, (top, bottom, left, right) in enumerate(found[light]):
            got[z, top:bottom, left:right] = True
            assert got[z].any() or not found[light, z].any()
        assert np.array_equal(got, want)
        assert (found >= 0).all()
        assert (found[..., 1] <= want.shape[1]).all()
        assert (found[..., 3] <= want.shape[2]).all()


def test_axes_of_length_1_stay() -> None:
    field = np.arange(24.0).reshape(2, 1, 3, 4)
    part = part_of(field, (slice(3, 5), slice(1, 3), slice(0, 4, 2)))
    assert part.tolist() == [[[[4.0, 6.0], [8.0, 10.0]]], [[[16.0, 18.0], [20.0, 22.0]]]]
    assert np.shares_memory(part, field)


def test_the_whole_is_told_from_parts() -> None:
    whole = slice(0, 4), slice(0, 3), slice(0, 5)
    assert is_whole(whole, (4, 3, 5))
    for box in ((slice(1, 4), *whole[1:]), (slice(0, 3), *whole[1:]), (slice(0, 4, 2), *whole[1:])):
        assert not is_whole(box, (4, 3, 5))
        assert is_whole(box, (3, 5))
    assert slices_of((slice(1, 8, 2), *whole[1:]), 1, 3) == (slice(3, 6, 2), *whole[1:])


def test_blocks_of_a_part_visit_what_the_grid_tells_them() -> None:
    asked = []
    box = slice(1, 8, 2), slice(4, 8), slice(0, 5)
    visit = candidates_in(lambda z, y: asked.append((z, y)) or np.array([7]), box)
    assert visit is not None
    assert visit(slice(1, 3), slice(0, 2)).tolist() == [7]
    z, y = asked[0]
    assert list(range(9))[z] == [3, 5]
    assert list(range(9))[y] == [4, 5]
    assert candidates_in(None, box) is None
