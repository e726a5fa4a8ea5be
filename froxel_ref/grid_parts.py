"""Parts of a grid: boxes of samples with steps, such as slabs and the sublattices of a checkerboard.

A part has coordinates of its own, in which its samples stand side by side; what was worked out for the whole grid
serves it through the slices that these functions give.
"""

from __future__ import annotations

from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from froxel_ref.arrays import Candidates, Index

Scalar = TypeVar("Scalar", bound=np.generic)

__all__ = ["bounds_in", "candidates_in", "is_whole", "part_of", "part_slice", "slices_of", "whole_slice"]


def whole_slice(outer: slice, inner: slice) -> slice:
    """Where a range of a part lies in the whole.

    Parameters
    ----------
    outer : slice
        The part; its start and stop are numbers, its step is above 0 or None.
    inner : slice
        In the part's coordinates, with a step of 1.

    Returns
    -------
    slice

    Examples
    --------
    >>> list(range(10))[slice(1, 10, 2)][slice(1, 3)], list(range(10))[whole_slice(slice(1, 10, 2), slice(1, 3))]
    ([3, 5], [3, 5])
    """
    step = outer.step or 1
    begin = outer.start + step * inner.start
    return slice(begin, max(begin, outer.start + step * (inner.stop - 1) + 1), step)


def part_slice(outer: slice, range_: slice) -> slice:
    """What a part has of a range of the whole, in its coordinates.

    Parameters
    ----------
    outer : slice
        The part, as for `whole_slice`.
    range_ : slice
        Of the whole, with a step of 1.

    Returns
    -------
    slice
        Empty where it has none.

    Examples
    --------
    >>> part_slice(slice(1, 10, 2), slice(3, 6)), part_slice(slice(1, 10, 2), slice(4, 5))
    (slice(1, 3, None), slice(2, 2, None))
    """
    step = outer.step or 1
    count = len(range(outer.start, outer.stop, step))
    first, last = (min(max(-((outer.start - end) // step), 0), count) for end in (range_.start, range_.stop))
    return slice(first, last)


def slices_of(box: Index, first: int, last: int) -> Index:
    """A part's slices from ``first`` up to ``last``, in its coordinates, with all of its rows and columns.

    Parameters
    ----------
    box : Index
        The part.
    first, last : int

    Returns
    -------
    Index

    Examples
    --------
    >>> slices_of((slice(1, 9, 2), slice(0, 4, 2), slice(0, 4)), 1, 3)[0]
    slice(3, 6, 2)
    """
    return whole_slice(box[0], slice(first, last)), box[1], box[2]


def is_whole(box: Index, shape: tuple[int, ...]) -> bool:
    """Whether a part has all samples along axes of these lengths, the last ones of its three.

    Parameters
    ----------
    box : Index
    shape : tuple of int

    Returns
    -------
    bool

    Examples
    --------
    >>> box = slice(2, 4), slice(0, 3), slice(0, 5)
    >>> is_whole(box, (3, 5)), is_whole(box, (8, 3, 5))
    (True, False)
    """
    return all((r.start or 0, r.stop, r.step or 1) == (0, n, 1)
               for r, n in zip(box[3 - len(shape):], shape, strict=True))


def part_of(field: NDArray[Scalar], box: Index) -> NDArray[Scalar]:
    """What a field holds of a part.

    Parameters
    ----------
    field : ndarray
        Its last three axes are z, y and x.
    box : Index

    Returns
    -------
    ndarray
        A view; axes of length 1 stay.

    Examples
    --------
    >>> part_of(np.arange(4.0).reshape(1, 1, 4), (slice(0, 1), slice(1, 5, 2), slice(1, 4, 2))).tolist()
    [[[1.0, 3.0]]]
    """
    z, y, x = (r if n > 1 else slice(None) for r, n in zip(box, field.shape[-3:], strict=True))
    return field[..., z, y, x]


def bounds_in(boxes: NDArray[np.intp], box: Index) -> NDArray[np.intp]:
    """Ranges of rows and columns, slice by slice, as a part counts them.

    Parameters
    ----------
    boxes : ndarray, shape (n, D, 4)
        First and last + 1 row and column of the whole grid; all 0 where none (`froxel_ref.light_rays`).
    box : Index
        The part.

    Returns
    -------
    ndarray, shape (n, d, 4)
        Of the part's slices; holds exactly its samples that ``boxes`` hold.

    Examples
    --------
    >>> bounds_in(np.array([[[0, 0, 0, 0], [2, 6, 3, 4]]]), (slice(1, 2), slice(1, 8, 2), slice(0, 8, 2))).tolist()
    [[[0, 0, 0, 0]]]
    >>> bounds_in(np.array([[[0, 0, 0, 0], [2, 6, 3, 5]]]), (slice(1, 2), slice(1, 8, 2), slice(0, 8, 2))).tolist()
    [[[1, 3, 2, 3]]]
    """
    found = boxes[:, box[0]]
    if all((r.start, r.step or 1) == (0, 1) for r in box[1:]) and (found[..., 1::2] <= [r.stop for r in box[1:]]).all():
        return found
    start, step, count = np.repeat([(r.start, r.step or 1, len(range(r.start, r.stop, r.step or 1))) for r in box[1:]],
                                   2, axis=0).T
    found = np.asarray(np.clip((found - start + (step - 1)) // step, 0, count), np.intp)
    found[(found[..., 0] >= found[..., 1]) | (found[..., 2] >= found[..., 3])] = 0
    return found


def candidates_in(visit: Candidates | None, box: Index) -> Candidates | None:
    """What tells a block of a part what it has to visit.

    Parameters
    ----------
    visit : callable or None
        Of the whole grid (`froxel_ref.culling.candidates`).
    box : Index

    Returns
    -------
    callable or None

    Examples
    --------
    >>> visit = candidates_in(lambda z, y: np.arange(8)[z], (slice(1, 8, 2), slice(0, 4), slice(0, 4)))
    >>> visit(slice(1, 3), slice(0, 4)).tolist()
    [3, 5]
    """
    if visit is None:
        return None

    def within(z: slice, y: slice) -> NDArray[np.intp]:
        return visit(whole_slice(box[0], z), whole_slice(box[1], y))

    return within
