"""Fourier opacity maps without ringing: a non-negative extinction with the map's own coefficients.

The series of a few coefficients falls below 0, and what passes rises where it does. Here what is stored, and how it
is gathered, stays as it is (`froxel_ref.fom`); a pass over the texels then finds for each an extinction that is
nowhere negative and has its coefficients, and lookups in that cost half as much again as those in the series.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from froxel_ref import fom
from froxel_ref.arrays import Field
from froxel_ref.blocks import run
from froxel_ref.fom_intervals import HIGHEST, Intervals, intervals, least_bound, one_slab
from froxel_ref.fom_nonnegative import NOWHERE, least_energy, lowest, negative_arcs
from froxel_ref.records import InputError

__all__ = ["ROUNDINGS", "resolve", "resolved_depth", "resolved_transmittance"]

Array: TypeAlias = NDArray[np.floating[Any]]
Reals: TypeAlias = NDArray[np.float64]

BLOCK = 4096  # texels
# Which extinction is believed, by what the media of the tests are reproduced best with.
THIN = 0.05, 0.1  # length of the intervals in all: up to the first they are believed, from the second on not
SINGLE = 1e-3, 2e-3  # their spread, likewise: a slab is told by fewer numbers than there are
DIP = 0.03  # how far the series falls below 0, of its mean, for intervals to be believed fully
ROUNDING = 1e-13  # how far it may fall for being the extinction itself
LEAST_ROUNDING = 1e-9  # for a slab to be told by; what has no more counts as exact
ENDS = 1e-6  # how near to 0 or 1 a thin layer counts as being at both


ROUNDINGS: Mapping[str | None, float] = {"float16": 2.0**-12}
"""By storage, the rounding that `resolve` is to be given where it is more than that of the coefficients' type: half of
float16's largest, which the margins above are multiples of."""


def resolve(coefficients: Field, *, rounding: float = 0.0, threads: int | None = None) -> Array:
    """What coefficients are looked up by without ringing.

    Parameters
    ----------
    coefficients : ndarray, shape (2, K + 1, …) [1]
        From `fom.sample_coefficients`, `fom.segment_coefficients`, or sums of such. b_0 is not read.
    rounding : float [1]
        Of the coefficients, relative, if it is more than that of their type: 2⁻¹² where they were stored as
        float16.
    threads : int, optional
        Default: one for each core. The result does not depend on it.

    Returns
    -------
    ndarray, shape (7 (K + 1), …) [1]
        For `resolved_depth`: the optical depth; 2K + 2 coefficients of a trigonometric sum p and K + 1 arcs where it
        is negative (start, stop, what to add for each); the extinction on K intervals, their starts and lengths.
        At least float32.

    Raises
    ------
    InputError
        If coefficients are not finite, or not of that shape.

    Notes
    -----
    σ = (1 − w)·max(p, 0) + w·L on the intervals. Both parts are extinctions with the given coefficients: the one of
    least energy (`fom_nonnegative.least_energy`), which is smooth and is the series where that is not negative, and
    the one of the least bound (`fom_intervals.intervals`), which is a slab or up to K thin layers if the medium is.
    w goes to 1 as the intervals get short or become one, and to 0 as the series stops being negative. So media
    without harmonics above K come back to rounding, like from the series, and slabs and up to K thin layers too,
    which the series blurs; slabs longer than about 0.82 of the ray do not, as their series (K = 3) is positive and
    so is a medium by itself.

    Coefficients repeat: a layer at 0 and one at 1 are the same to them. It is put at 0, and a steep medium at one end
    bleeds to the other as it does in the series.

    Rounded coefficients may be those of a few thin layers alone, though what they were of is smooth. So how thin the
    intervals are is told with the coefficients drawn to those of a uniform extinction by four times their rounding;
    a slab that has them but for sixteen roundings is believed; and an interval that reaches beyond an end by no more
    than eight, or eight over its length up to a tenth of that, ends there.

    Examples
    --------
    >>> layer = resolve(fom.sample_coefficients(np.array([0.5]), np.array([4.0])))
    >>> resolved_depth(layer, np.array([0.0, 0.49, 0.51, 1.0])).round(3).tolist()
    [0.0, 0.0, 4.0, 4.0]
    """
    if coefficients.ndim < 2 or coefficients.shape[0] != 2 or coefficients.shape[1] < 1:
        raise InputError("coefficients", f"has shape {coefficients.shape}, must be (2, K + 1, …)")
    if not np.isfinite(coefficients).all():
        raise InputError("coefficients", "has values that are not finite, must be finite")
    rounding = max(rounding, 0.5 * float(np.finfo(coefficients.dtype).eps))
    count, texels = coefficients.shape[1], coefficients.shape[2:]
    flat = np.asarray(coefficients, np.float64).reshape(2, count, -1)
    out = np.zeros((7 * count, flat.shape[2]), np.promote_types(coefficients.dtype, np.float32))

    def task(start: int) -> None:
        out[:, start:start + BLOCK] = _resolved(flat[:, :, start:start + BLOCK], rounding)

    run(task, range(0, flat.shape[2], BLOCK), threads=threads)
    return out.reshape(7 * count, *texels)


def _resolved(coefficients: Reals, rounding: float) -> Reals:
    """`resolve` of texels in a row: the series, and where that is negative the two extinctions instead."""
    _, count, texels = coefficients.shape
    total = np.maximum(0.5 * coefficients[0, 0], 0.0)
    out = np.zeros((7 * count, texels))
    summed, arcs, steps = _parts(out)
    out[0] = total
    summed[:] = coefficients
    summed[1, 0] = 0.0
    summed[:, :, total == 0.0] = 0.0
    arcs[:2] = NOWHERE
    if count == 1:
        return out
    moments = np.divide(coefficients[0] - 1j * coefficients[1], 2.0 * total, where=total > 0.0,
                        out=np.zeros((count, texels), np.complex128))
    moments[0] = total > 0.0
    moments /= np.maximum(np.abs(moments), 1.0)
    series = np.concatenate([moments[:1].real, 2.0 * moments[1:].real, -2.0 * moments[1:].imag])
    dip = -lowest(np.ascontiguousarray(series.T))
    negative = np.flatnonzero(dip > ROUNDING)
    if negative.size:
        share, steps[:, negative] = _stepped(moments[:, negative], dip[negative], total[negative], rounding)
        rest = (1.0 - share) * total[negative]
        summed[:, :, negative], arcs[:, :, negative] = _smooth(series[:, negative], rest)
    return out


def _parts(resolved: Array) -> tuple[Array, Array, Array]:
    """Views: the sum's coefficients (2, K + 1, …), its arcs (3, K + 1, …), the intervals (2 K + 1, …)."""
    count, texels = len(resolved) // 7, resolved.shape[1:]
    return (resolved[1:2 * count + 1].reshape(2, count, *texels),
            resolved[2 * count + 1:5 * count + 1].reshape(3, count, *texels), resolved[5 * count + 1:])


def _stepped(moments: NDArray[np.complex128], dip: Reals, total: Reals, rounding: float) -> tuple[Reals, Reals]:
    """The share w of the intervals, and their extinction, starts and lengths, shape (2 K + 1, n)."""
    found = intervals(moments)
    bound, single = found.bound, _falling(found.spread, SINGLE)
    if rounding > LEAST_ROUNDING:
        drawn = (1.0 - 4.0 * rounding) * moments
        drawn[0] = moments[0]
        bound = np.minimum(bound, least_bound(drawn))
    # Always, for of very many harmonics the reflection coefficients of a slab lose their digits.
    found, single = _one_slab(moments, found, single, max(rounding, LEAST_ROUNDING))
    share = np.maximum(_falling(1.0 / bound, THIN), single)
    share *= np.minimum(dip / DIP, 1.0)
    # What is as thin as can be would lie at both ends if it reaches beyond one: it is moved to where its middle is.
    over = found.start + found.length > 1.0
    thin = over & (found.length < 2.0 / HIGHEST)
    late = found.start + 0.5 * found.length < 1.0 - ENDS
    start = np.where(thin, np.where(late, 1.0 - found.length, 0.0), found.start)
    doubt = np.minimum(8.0 * rounding / np.maximum(found.length, 1.0 / HIGHEST), 0.1 * found.length)
    slack = np.maximum(doubt, max(8.0 * rounding, ENDS))
    start = np.where(over & (found.start + found.length < 1.0 + slack), 1.0 - found.length, start)
    start = np.where(over & (found.start > 1.0 - slack), 0.0, start)
    return share, np.concatenate([[share * total * found.bound], start, found.length])


def _one_slab(moments: NDArray[np.complex128], found: Intervals, single: Reals, rounding: float
              ) -> tuple[Intervals, Reals]:
    """Where one slab has the coefficients but for their rounding, that slab."""
    start, length, residual = one_slab(moments)
    believed = _falling(residual, (16.0 * rounding, 32.0 * rounding))
    k = np.arange(len(moments))[:, np.newaxis, np.newaxis]
    waves = np.sinc(k * found.length) * np.exp(-2j * np.pi * k * (found.start + 0.5 * found.length))
    off = np.abs((found.bound * found.length * waves).sum(axis=1) - moments).max(axis=0)
    better = (believed > single) | ((believed > 0.0) & (residual < off))
    first = np.arange(len(found.start))[:, np.newaxis] == 0
    return Intervals(np.where(better, 1.0 / length, found.bound),
                     np.where(better, np.where(first, start, 0.0), found.start),
                     np.where(better, np.where(first, length, 0.0), found.length),
                     found.spread), np.maximum(single, believed)


def _falling(x: Reals, ends: tuple[float, float]) -> Reals:
    """1 up to the first end, 0 from the second on, linear in between."""
    return np.asarray(np.clip((ends[1] - x) / (ends[1] - ends[0]), 0.0, 1.0))


def _smooth(series: Reals, total: Reals) -> tuple[Reals, Reals]:
    """The sum's coefficients and arcs of texels whose series is negative somewhere; nothing where nothing is left."""
    count = len(series) // 2 + 1
    summed, arcs = np.zeros((2, count, series.shape[1])), np.zeros((3, count, series.shape[1]))
    arcs[:2] = NOWHERE
    left = np.flatnonzero(total > 0.0)
    if not left.size:
        return summed, arcs
    found = least_energy(np.ascontiguousarray(series[:, left].T))
    start, stop = negative_arcs(found)
    part = np.zeros((2, count, left.size))
    part[0, 0], part[:, 1:] = 2.0 * found[:, 0], found.T[1:].reshape(2, count - 1, -1)
    lost = np.maximum(fom.optical_depth(part, start) - fom.optical_depth(part, stop), 0.0)
    scale = total[left] / (found[:, 0] + lost.sum(axis=0))
    summed[:, :, left] = part * scale
    arcs[:, :, left] = start, stop, lost * scale
    return summed, arcs


# --- lookups ----------------------------------------------------------------------------------------


def resolved_depth(resolved: Field, depth: Field) -> Array:
    """The optical depth up to a point of the ray.

    Parameters
    ----------
    resolved : ndarray, shape (7 (K + 1), …) [1]
        From `resolve`.
    depth : ndarray, broadcastable with … [1]
        In [0, 1]; beyond it the end's value is taken.

    Returns
    -------
    ndarray [1]
        0 at depth 0 and a_0/2, the whole, at depth 1, both exactly; in between never falling, but for rounding of the
        whole.

    Notes
    -----
    The integral of the sum p up to the depth, as in `fom.optical_depth`, taken at the start of an arc on which p is
    negative, plus what p takes away on arcs before; plus the extinction on the intervals times what of them lies
    before the depth.

    Examples
    --------
    >>> slab = fom.segment_coefficients(np.array([0.25]), np.array([0.75]), np.array([2.0]))
    >>> resolved_depth(resolve(slab), np.array([0.25, 0.5, 0.75])).round(9).tolist()
    [0.0, 1.0, 2.0]
    """
    d = np.minimum(np.maximum(depth, 0.0), 1.0)
    summed, arcs, steps = _parts(resolved)
    held, added = d, np.zeros((), resolved.dtype)
    for start, stop, lost in zip(*arcs, strict=True):
        held = np.where((d > start) & (d < stop), start, held)
        added = added + np.where(d >= stop, lost, 0.0)
    total = fom.optical_depth(summed, held) + added
    count = len(steps) // 2
    before: Any = 0.0
    for start, length in zip(steps[1:count + 1], steps[count + 1:], strict=True):
        past = d - start
        before = before + (np.clip(past, 0.0, length) + np.clip(past + 1.0, 0.0, length)
                           - np.clip(1.0 - start, 0.0, length))
    total = np.minimum(np.maximum(total + steps[0] * before, 0.0), resolved[0])
    return np.asarray(np.where(d >= 1.0, resolved[0], total))


def resolved_transmittance(resolved: Field, depth: Field) -> Array:
    """What passes up to a point of the ray.

    Parameters
    ----------
    resolved, depth
        As for `resolved_depth`.

    Returns
    -------
    ndarray [1]
        In [0, 1].

    Notes
    -----
    exp(−optical depth). The mean error over the depth, against that of the series cut at 1 (K = 3): a tenth at most,
    mostly below a hundredth, for a thin layer or a slab up to 0.8 of the ray; a hundredth to all of it for smooth
    media, 0.04 on average for single bumps. One bump in a hundred has more, up to 2.8 times: its foot touches an end,
    and the series happens to be good there.

    Examples
    --------
    >>> layer = resolve(fom.sample_coefficients(np.array([0.5]), np.array([4.0])))
    >>> float(resolved_transmittance(layer, np.linspace(0, 1, 1001)).max())
    1.0
    """
    with np.errstate(under="ignore"):
        return np.asarray(np.exp(-resolved_depth(resolved, depth)))
