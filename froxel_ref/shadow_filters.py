"""How depths of a shadow map become a share of light: comparisons, and exponential shadow maps.

Maps are stacks of square faces, (faces, size, size). A point is looked up at a face and texel coordinates:
texel i covers [i, i + 1).
"""

from __future__ import annotations

from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from froxel_ref.arrays import Field

__all__ = ["compare", "exponential_map", "exponential_visibility", "kernel_reach", "pad_octahedral"]

Integers: TypeAlias = NDArray[np.integer[Any]]


def kernel_reach(kernel: int) -> float:
    """How far from the point looked up a texel's centre may lie that is compared with.

    Parameters
    ----------
    kernel : int
        As for `compare`.

    Returns
    -------
    float [texels]
        Along each axis.

    Examples
    --------
    >>> kernel_reach(0), kernel_reach(1), kernel_reach(3)
    (0.5, 1.0, 2.0)
    """
    return 0.5 * (kernel + 1)


def compare(depth: Field, face: Integers | int, x: Field, y: Field, receiver: Field, *, kernel: int = 1) -> Field:
    """The share of a map's texels around a point that do not hide it: percentage-closer filtering.

    Parameters
    ----------
    depth : Field, shape (faces, size, size) [m]
        First hits; infinite where nothing is hit.
    face : int or ndarray of int, broadcastable to the points
        Which face to look at.
    x, y : Field, shape (…) [texels]
        Where; what lies beyond a border is looked up at it.
    receiver : Field, shape (…) [m]
        Depth of the point.
    kernel : int
        0: the texel that holds the point. 1: the four nearest, bilinear. n: a box of n·n such lookups.

    Returns
    -------
    Field, shape (…) [1]
        In the receiver's dtype.

    Notes
    -----
    A texel lets light through iff its depth is above the receiver's, strictly. Weights are separable: along
    each axis n + 1 texels with (1 − f, 1, …, 1, f)/n, f the point's fraction [Reeves 1987; hardware filters].

    Examples
    --------
    >>> half = np.array([[[1.0, 9.0, 9.0]] * 3])
    >>> x = np.array([0.5, 0.75, 1.5])
    >>> compare(half, 0, x, np.ones(3), np.full(3, 5.0)).tolist()
    [0.0, 0.25, 1.0]
    """
    size = depth.shape[-1]
    flat = depth.reshape(-1)
    column, fx = _cell(x, 0.5 * kernel, size - kernel)
    row, fy = _cell(y, 0.5 * kernel, size - kernel)
    index = (np.asarray(face) * size + row) * size + column
    if kernel == 0:
        return np.asarray(np.greater(flat.take(index), receiver), receiver.dtype)
    hidden = np.zeros(receiver.shape, receiver.dtype)
    for i in range(kernel + 1):
        line = np.zeros_like(hidden)
        for j in range(kernel + 1):
            line += np.less_equal(flat.take(index + (i * size + j)), receiver) * _factor(j, kernel, fx)
        hidden += line * _factor(i, kernel, fy)
    # What is hidden is summed, so that a point in full light has exactly 1.
    hidden *= -1.0 / (kernel * kernel)
    hidden += 1.0
    result: Field = np.maximum(hidden, 0.0, out=hidden)
    return result


def _cell(place: Field, shift: float, count: int) -> tuple[Integers, Field]:
    """The first texel of a kernel, kept on the map, and the fraction by which its last one counts."""
    last = np.nextafter(np.asarray(count, place.dtype), np.asarray(0.0, place.dtype))
    moved = np.clip(place - np.asarray(shift, place.dtype), 0.0, last)
    floor = np.floor(moved)
    return floor.astype(np.intp), moved - floor


def _factor(k: int, kernel: int, fraction: Field) -> Field | float:
    return 1.0 - fraction if k == 0 else fraction if k == kernel else 1.0


# --- exponential shadow maps ------------------------------------------------------------------------


def exponential_map(depth: Field, low: Field, high: Field, *, exponent: float = 80.0, downsample: int = 4,
                    blur: int = 2) -> Field:
    """Turn depths into an exponential shadow map: downsampled and blurred.

    Parameters
    ----------
    depth : Field, shape (…, size, size) [m]
        First hits; infinite where nothing is hit.
    low, high : Field, broadcastable to (…, 1, 1) [m]
        The range of depths that receivers have.
    exponent : float
        c, over that range. Up to 85 it fits float32.
    downsample : int
        How many texels are averaged along each axis.
    blur : int
        Radius of the Gaussian blur in averaged texels; its standard deviation is half of that.

    Returns
    -------
    Field, shape (…, size/downsample, size/downsample)
        The filtered e^(c·(d − 1)), d the depth as a share of the range, cut to [0, 1].

    Notes
    -----
    Averages of e^(c·d) are averages of the visibility e^(c·(d − r)) for every receiver r behind all that was
    averaged, so the map can be filtered before it is looked up [Annen 2008]; [Wronski 2014] takes 1024² to 256²
    and blurs. Edges are repeated.

    Examples
    --------
    >>> wall = exponential_map(np.full((8, 8), 5.0), 0.0, 10.0)
    >>> wall.shape, bool(np.allclose(np.log(wall), 80.0 * (0.5 - 1.0)))
    ((2, 2), True)
    """
    d = np.clip((depth - low) / (high - low), 0.0, 1.0)
    value = np.exp((d - 1.0) * exponent)
    *front, rows, columns = value.shape
    parts = value.reshape(*front, rows // downsample, downsample, columns // downsample, downsample)
    small = parts.mean(axis=(-3, -1))
    if blur:
        offset = np.arange(-blur, blur + 1)
        weight = np.exp(-0.5 * (offset / (0.5 * blur)) ** 2)
        for axis in (-1, -2):
            small = _convolve(small, weight / weight.sum(), axis)
    result: Field = small.astype(depth.dtype, copy=False)
    return result


def _convolve(values: Field, weight: Field, axis: int) -> Field:
    """A weighted mean along an axis, the ends repeated."""
    count, radius = values.shape[axis], len(weight) // 2
    places = np.clip(np.arange(-radius, count + radius), 0, count - 1)
    wide = values.take(places, axis=axis)
    total = np.zeros_like(values)
    for k, share in enumerate(weight.tolist()):
        total += share * wide.take(np.arange(k, k + count), axis=axis)
    return total


def exponential_visibility(value: Field, face: Integers | int, x: Field, y: Field, receiver: Field, *,
                           exponent: float = 80.0) -> Field:
    """The share of light that an exponential shadow map lets through.

    Parameters
    ----------
    value : Field, shape (faces, size, size)
        From `exponential_map`.
    face : int or ndarray of int, broadcastable to the points
        Which face to look at.
    x, y : Field, shape (…) [texels of ``value``]
        Where; bilinear.
    receiver : Field, shape (…)
        Depth of the point as a share of the map's range; cut to [0, 1].
    exponent : float
        As for the map.

    Returns
    -------
    Field, shape (…) [1]
        sat(e^(c·(1 − r))·value).

    Notes
    -----
    Behind an edge of depth the light falls off as e^(−c·Δ) instead of at once, Δ the distance as a share of the
    range: near the surface that hides it a shadow leaks, by 1/e at range/80.

    Examples
    --------
    >>> wall = exponential_map(np.full((1, 8, 8), 5.0), 0.0, 10.0)
    >>> at = np.ones(3)
    >>> exponential_visibility(wall, 0, at, at, np.array([0.2, 0.51, 0.8])).round(4).tolist()
    [1.0, 0.4493, 0.0]
    """
    size = value.shape[-1]
    flat = value.reshape(-1)
    column, fx = _cell(x, 0.5, size - 1)
    row, fy = _cell(y, 0.5, size - 1)
    index = (np.asarray(face) * size + row) * size + column
    total = (flat.take(index) * (1.0 - fx) + flat.take(index + 1) * fx) * (1.0 - fy)
    total += (flat.take(index + size) * (1.0 - fx) + flat.take(index + (size + 1)) * fx) * fy
    with np.errstate(under="ignore"):
        total = total * np.exp(exponent * (1.0 - np.clip(receiver, 0.0, 1.0)))
    return np.asarray(np.minimum(total, 1.0))


# --- octahedra --------------------------------------------------------------------------------------


def pad_octahedral(values: Field, gutter: int) -> Field:
    """Put a gutter around octahedral maps, so that neighbours across their edges stand beside them.

    Parameters
    ----------
    values : ndarray, shape (…, size, size)
        Maps without gutter.
    gutter : int
        Texels to add on each side; at most size.

    Returns
    -------
    ndarray, shape (…, size + 2·gutter, size + 2·gutter)

    Notes
    -----
    An edge of the square is glued to itself, turned about its middle: beyond (i, −1) lies (size − 1 − i, 0)
    [Meyer 2010].

    Examples
    --------
    >>> pad_octahedral(np.arange(4.0).reshape(2, 2), 1).tolist()
    [[3.0, 1.0, 0.0, 2.0], [2.0, 0.0, 1.0, 3.0], [0.0, 2.0, 3.0, 1.0], [1.0, 3.0, 2.0, 0.0]]
    """
    if gutter == 0:
        return values
    turned = values[..., ::-1]
    rows = np.concatenate([turned[..., gutter - 1::-1, :], values, turned[..., :-gutter - 1:-1, :]], axis=-2)
    turned = rows[..., ::-1, :]
    return np.concatenate([turned[..., gutter - 1::-1], rows, turned[..., :-gutter - 1:-1]], axis=-1)
