"""Where in its froxel the sample of a frame lies: Halton points, one per frame, for the temporal filter to average.

The published points do not average ½, so that what the filter converges to is sampled beside the froxel's centre
(D10, A2). Every axis of the points that are used here by default has a mean of ½.
"""

from __future__ import annotations

from fractions import Fraction
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from froxel_ref.records import InputError, shown, suggest

__all__ = ["BASES", "POINTS", "froxel_jitter", "halton", "jitter_points", "mirrored"]

Doubles = NDArray[np.float64]

BASES = (2, 3, 5)
"""The bases along x, y and z [Dörries 2020, §3.2.3]."""

POINTS = ("centred", "published", "author")
"""Which points: the corrected, the published and the author's ones."""

# Points a cycle may have. The index itself must be exact in float64, and all points are formed at once.
MOST = 65536

# The largest float64 below 1.
BELOW_ONE = 1.0 - 2.0**-53


def halton(index: ArrayLike, base: int) -> Doubles:
    """Values of a Halton sequence in one base: an index's digits mirrored at the point.

    Parameters
    ----------
    index : array_like of int
        At least 0, below 2⁵³/base.
    base : int
        At least 2; one prime per dimension.

    Returns
    -------
    ndarray, shape of ``index``, float64
        In [0, 1); 0 for index 0.

    Raises
    ------
    InputError
        An index that is negative, too large or no whole number; a base below 2.

    Notes
    -----
    Σ d_k·b^(−k−1) for the index Σ d_k·b^k [Dörries 2020, listing 3.6]. The sum is formed as one whole number
    over a power of the base and rounded once, so the value is correctly rounded; the listing's own
    arithmetic, in float32, is off by up to some ulp in bases 3 and 5.

    Examples
    --------
    >>> halton([1, 2, 3, 4, 5, 6], 2).tolist()
    [0.5, 0.25, 0.75, 0.125, 0.625, 0.375]
    >>> float(halton(5, 3)) == 7 / 9
    True
    """
    rest = np.asarray(index)
    if not isinstance(base, (int, np.integer)) or isinstance(base, bool) or base < 2:
        raise InputError("base", f"is {shown(base)}, must be a whole number, at least 2")
    if rest.dtype.kind not in "iu" or (rest.size and not (rest.min() >= 0 and int(rest.max()) < 2**53 // int(base))):
        raise InputError("index", f"is {shown(index)}, must be whole numbers from 0 to below 2^53/base")
    rest = rest.astype(np.int64)
    numerator, denominator = np.zeros_like(rest), np.ones_like(rest)
    while rest.any():
        running = rest > 0
        numerator = np.where(running, numerator * base + rest % base, numerator)
        denominator = np.where(running, denominator * base, denominator)
        rest = rest // base
    return np.asarray(numerator / denominator)


def mirrored(index: int, base: int) -> Fraction:
    """One value of a Halton sequence exactly.

    Parameters
    ----------
    index : int
        At least 0.
    base : int
        At least 2.

    Returns
    -------
    Fraction
        The index's digits mirrored at the point; `halton` is its nearest float.

    Examples
    --------
    >>> mirrored(5, 3)
    Fraction(7, 9)
    """
    numerator, denominator = 0, 1
    while index:
        index, digit = divmod(index, base)
        numerator, denominator = numerator * base + digit, denominator * base
    return Fraction(numerator, denominator)


def froxel_jitter(frame: int, *, points: str = "centred", count: int = 32, hold: int = 1) -> tuple[float, float, float]:
    """Where in their froxels the samples of a frame lie.

    Parameters
    ----------
    frame : int
        The frame's number; negative ones continue the cycle backwards.
    points : {"centred", "published", "author"}
        D10, A2: which points, see `jitter_points`.
    count : int
        How many Halton points; 32 in [Dörries 2020, §3.2.3].
    hold : int
        For how many frames each point stays. 2 under a checkerboard (`froxel_ref.checkerboard`), so that both
        colours see every point; 1, as published, otherwise.

    Returns
    -------
    (float, float, float)
        Along x, y (downwards) and z (away) in texels, each in [0, 1); what `froxel_ref.grid.make_froxels` takes.

    Raises
    ------
    InputError
        An unknown word; a count or hold out of range.

    Notes
    -----
    With a checkerboard and ``hold=1`` a froxel is computed at every other frame and sees every other point. The
    base 2 of x then gives one colour only values of at least ½ and the other only smaller ones: means of 0.734 and
    0.235, for "centred" 0.750 and 0.250. The filtered volume so keeps a chequered shift of a quarter of a texel.

    Examples
    --------
    >>> froxel_jitter(0, points="published")[:2] == (1 / 2, 1 / 3)
    True
    >>> froxel_jitter(32, points="published") == froxel_jitter(0, points="published")
    True
    >>> [froxel_jitter(frame, points="author")[0] for frame in range(4)]
    [0.5, 0.75, 0.625, 0.875]
    """
    if not isinstance(frame, (int, np.integer)):
        raise InputError("frame", f"is {shown(frame)}, must be a whole number")
    if not isinstance(hold, (int, np.integer)) or hold < 1:
        raise InputError("hold", f"is {shown(hold)}, must be a whole number, at least 1")
    cycle = jitter_points(points, count=count)
    x, y, z = cycle[int(frame) // int(hold) % len(cycle)].tolist()
    return x, y, z


def jitter_points(points: str = "centred", *, count: int = 32) -> Doubles:
    """All points of a cycle, in the order of the frames.

    Parameters
    ----------
    points : {"centred", "published", "author"}
        "published": the Halton points of bases 2, 3 and 5 with the indices 1 … count. "centred" (the default):
        the same, moved so that their mean is ½ (D10). "author": of the published ones those with the indices
        2·(frame mod count/2) + 1 (A2).
    count : int
        How many Halton points, 1 to 65536; at least 2 for "author".

    Returns
    -------
    ndarray, shape (count, 3), or (⌊count/2⌋, 3) for "author"; float64
        x, y and z in [0, 1); must not be written to.

    Raises
    ------
    InputError
        An unknown word; a count out of range.

    Notes
    -----
    The 32 published points average (0.485, 0.481, 0.462), and the author's (0.734, 0.463, 0.452).

    "centred" moves all points of an axis by ½ minus their mean, and wraps none: a wrapped point would move the mean
    by 1/count again, and change its distances to the others. Moved by δ, the points' star discrepancy changes by at
    most Σδ (0.0151 + 0.0188 + 0.0380 for 32). They stay in [0, 1) up to a count of 92; beyond that, where a point
    would reach 1, the axis is also drawn together about ½, by less than 1 %. The mean is that of the points before
    they are rounded: of the float64 values it is ½ within 2⁻⁵⁴.

    Examples
    --------
    >>> jitter_points("published").mean(axis=0).round(3).tolist()
    [0.485, 0.481, 0.462]
    >>> jitter_points().mean(axis=0).round(15).tolist()
    [0.5, 0.5, 0.5]
    """
    if points not in POINTS:
        raise InputError("points", f"is {shown(points)}; {suggest(str(points), POINTS)}")
    least = 2 if points == "author" else 1
    if not isinstance(count, (int, np.integer)) or not least <= count <= MOST:
        raise InputError("count", f"is {shown(count)}, must be a whole number, {least} to {MOST}")
    return _cycle(points, int(count))


@lru_cache(maxsize=16)
def _cycle(points: str, count: int) -> Doubles:
    """The points of `jitter_points`, read-only since all callers share them."""
    index = np.arange(1, count + 1)
    if points == "author":
        index = 2 * np.arange(count // 2) + 1
    columns = [_centred(count, base) if points == "centred" else halton(index, base) for base in BASES]
    result = np.stack(columns, axis=1)
    result.setflags(write=False)
    return result


def _centred(count: int, base: int) -> Doubles:
    """One axis of the published points about their mean, which is taken to ½, in exact fractions."""
    exact = [mirrored(i, base) for i in range(1, count + 1)]
    mean = sum(exact, Fraction(0)) / count
    offsets = [value - mean for value in exact]
    reach = max(offsets)
    room = Fraction(BELOW_ONE) - Fraction(1, 2)
    scale = Fraction(1) if reach <= room else room / reach
    return np.array([float(Fraction(1, 2) + offset * scale) for offset in offsets])
