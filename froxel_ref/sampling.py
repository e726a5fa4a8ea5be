"""Texel fetches: nearest, bilinear and trilinear, clamped or wrapped, as a GPU's sampler defines them.

Texel i covers [i, i+1) and its centre is i + ½ (spec of the texel rules: CONVENTIONS.md). Coordinates
are arrays that broadcast against each other, each keeping only the axes on which it varies; indexes and
weights are worked out on those small arrays, and only the gather runs at the full size.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray

from froxel_ref import blocks
from froxel_ref.records import InputError, shown

__all__ = ["ADDRESSES", "at_centres", "fetch_bilinear", "fetch_nearest", "fetch_trilinear"]

ADDRESSES = ("clamp", "wrap")

# Below this |texel index| an integer and its remainder are exact in int64 and float64 alike.
_EXACT = 2.0**52

Array = NDArray[Any]


class _Axis(NamedTuple):
    """Along one axis: the texel that holds the coordinate, the neighbour on its side, that one's share."""

    near: NDArray[np.intp]
    far: NDArray[np.intp]
    share: Array


def fetch_trilinear(texture: Array, x: ArrayLike, y: ArrayLike, z: ArrayLike, *, address: str = "clamp",
                    weight_bits: int | None = None, threads: int | None = 1) -> Array:
    """Values of a 3-D texture between its texel centres, linear along each axis.

    Parameters
    ----------
    texture : ndarray, shape (nz, ny, nx) or (C, nz, ny, nx)
        Finite texels; channels first.
    x, y, z : array_like
        Texel coordinates (0 and n are the texture's two ends), broadcastable to a common shape.
    address : {"clamp", "wrap"}
        Beyond the ends: the edge texel, or the texture repeated.
    weight_bits : int, optional
        Round the weights to multiples of 2^−bits; 8 is what current GPUs do. Default: full precision.
    threads : int, optional
        Default 1, since callers already split their work; None: one per core.

    Returns
    -------
    ndarray, shape (…) or (C, …)
        The broadcast shape of the coordinates, but of length 1 where only a coordinate varies whose
        texture axis has a single texel. The dtype is that of texture and coordinate arrays together.

    Raises
    ------
    InputError
        Wrong number of axes, an axis without texels, unknown address, weight_bits outside 1…23.

    Notes
    -----
    Along one axis the value is near + s·(far − near): near is the texel that holds the coordinate, far
    its neighbour on the coordinate's side, s ∈ [0, ½] the distance from near's centre. This is the usual
    a + t·(b − a) measured from the nearer end. Since s ≤ ½ the rounded result never leaves the hull of
    the texels, a constant texture gives that constant, and a coordinate i + ½ gives texel i, all exactly;
    linear textures come back within 2 ulp of the largest texel per axis. Order 2 in the texel size.

    "wrap" is seamless and exact in the index for every finite coordinate, negative and huge ones too.
    The seam that the thesis's program has (frac() and a clamping sampler, departure A5) is "clamp" on a
    coordinate that frac() has been applied to. A NaN coordinate gives NaN, as does an infinite one that
    wraps; an infinite one that clamps gives the edge. Axes of one texel do not read their coordinate.

    Examples
    --------
    >>> ramp = np.array([10.0, 20.0, 30.0]).reshape(1, 1, 3)
    >>> fetch_trilinear(ramp, np.array([-1.0, 0.5, 1.25, 3.0]), 0.5, 0.5)
    array([10. , 10. , 17.5, 30. ])
    >>> fetch_trilinear(ramp, np.array([0.0, 3.0, -2.5]), 0.5, 0.5, address="wrap")
    array([20., 20., 10.])
    """
    _check(texture, 3, address)
    return _fetch(texture, (z, y, x), address, weight_bits, threads)


def fetch_bilinear(texture: Array, x: ArrayLike, y: ArrayLike, *, address: str = "clamp",
                   weight_bits: int | None = None, threads: int | None = 1) -> Array:
    """Values of an image between its texel centres, linear along each axis.

    Parameters
    ----------
    texture : ndarray, shape (ny, nx) or (C, ny, nx)
        Finite texels; channels first.
    x, y : array_like
        Texel coordinates, broadcastable to a common shape.
    address, weight_bits, threads
        As for `fetch_trilinear`.

    Returns
    -------
    ndarray, shape (…) or (C, …)
        As for `fetch_trilinear`.

    Raises
    ------
    InputError
        As for `fetch_trilinear`.

    Notes
    -----
    The trilinear fetch without its third axis; see there.

    Examples
    --------
    >>> float(fetch_bilinear(np.array([[0.0, 1.0], [2.0, 3.0]]), 1.0, 1.0))
    1.5
    """
    _check(texture, 2, address)
    return _fetch(texture, (y, x), address, weight_bits, threads)


def fetch_nearest(texture: Array, x: ArrayLike, y: ArrayLike, z: ArrayLike | None = None, *,
                  address: str = "clamp", threads: int | None = 1) -> Array:
    """The texels that hold the coordinates.

    Parameters
    ----------
    texture : ndarray, shape (ny, nx) or (C, ny, nx); with ``z``, (nz, ny, nx) or (C, nz, ny, nx)
        Texels; channels first.
    x, y, z : array_like
        Texel coordinates, broadcastable to a common shape.
    address, threads
        As for `fetch_trilinear`.

    Returns
    -------
    ndarray, shape (…) or (C, …)
        As for `fetch_trilinear`, in the texture's dtype.

    Raises
    ------
    InputError
        As for `fetch_trilinear`; also a coordinate that has no texel (NaN, or infinite with "wrap").

    Examples
    --------
    >>> fetch_nearest(np.array([[1, 2, 3]]), np.array([0.99, 1.0, 7.0]), 0.0)
    array([1, 2, 3])
    """
    coordinates = (y, x) if z is None else (z, y, x)
    _check(texture, len(coordinates), address)
    wide = [np.asarray(c) for c in coordinates]
    if not all(np.isfinite(c).all() if address == "wrap" else not np.isnan(c).any() for c in wide):
        raise InputError("coordinate", "is NaN or, with 'wrap', infinite; must be a number to name a texel")
    return _fetch(texture, coordinates, address, None, threads, nearest=True)


def at_centres(coordinate: Array, axis: int, count: int) -> bool:
    """Whether the coordinates along an axis are the centres of its texels, in order, and vary along no other.

    Parameters
    ----------
    coordinate : ndarray
    axis : int
    count : int
        Texels.

    Returns
    -------
    bool
        A fetch there gives the texture itself.

    Examples
    --------
    >>> at_centres(np.array([[0.5, 1.5]]), 1, 2), at_centres(np.array([[0.5], [1.5]]), 1, 2)
    (True, False)
    """
    return coordinate.size == count == coordinate.shape[axis] and np.array_equal(
        coordinate.ravel(), np.arange(count) + 0.5)


def _check(texture: Array, axes: int, address: str) -> None:
    if texture.ndim not in (axes, axes + 1) or 0 in texture.shape:
        raise InputError("texture", f"has shape {texture.shape}, must have {axes} axes, or {axes + 1} with "
                                    "channels first, none of them empty")
    if address not in ADDRESSES:
        raise InputError("address", f"is {shown(address)}, must be one of {', '.join(ADDRESSES)}")


def _fetch(texture: Array, coordinates: Sequence[ArrayLike], address: str, weight_bits: int | None,
           threads: int | None, *, nearest: bool = False) -> Array:
    """The common body; ``coordinates`` are in the order of the texture's axes, slowest first."""
    if weight_bits is not None and weight_bits not in range(1, 24):
        raise InputError("weight_bits", f"is {shown(weight_bits)}, must be None or 1 to 23")
    sizes = texture.shape[-len(coordinates):]
    # A lone Python number takes part in the arithmetic but not in the choice of dtype (as in NumPy itself).
    dtype = texture.dtype if nearest else _float(texture, *coordinates)
    planes = np.ascontiguousarray(texture, dtype).reshape(-1, int(np.prod(sizes)))
    arrays = [np.asarray(c) if n > 1 else np.zeros(np.ndim(c) * (1,), np.float32)
              for c, n in zip(coordinates, sizes, strict=True)]
    shape = np.broadcast_shapes(*(a.shape for a in arrays))
    boxes = [_three_axes(a, shape) for a in arrays]
    full = np.broadcast_shapes((1, 1, 1), *(b.shape for b in boxes))
    kept = [i for i, n in enumerate(sizes) if n > 1]
    # Worked out once where it is small, per block where it is as large as the result.
    ready = {i: _axis(boxes[i], sizes[i], address, weight_bits, dtype) for i in kept
             if boxes[i].size < np.prod(full)}
    strides = [int(np.prod(sizes[i + 1:])) for i in range(len(sizes))]
    out = np.empty((len(planes), *full), dtype)

    def fill(place: tuple[slice, slice, slice]) -> None:
        axes = [_cut(ready[i], place) if i in ready
                else _axis(_part(boxes[i], place), sizes[i], address, weight_bits, dtype) for i in kept]
        index = _corners(axes, [strides[i] for i in kept], nearest=nearest)
        for plane, target in zip(planes, out, strict=True):
            target[place] = _interpolate(plane, index, [] if nearest else [a.share for a in axes])

    blocks.run(fill, _places(full), threads=threads)
    return out.reshape(texture.shape[:-len(sizes)] + shape)


def _float(texture: Array, *coordinates: ArrayLike) -> np.dtype[Any]:
    dtype = np.result_type(texture.dtype, *(c.dtype for c in coordinates if hasattr(c, "dtype")))
    return dtype if dtype.kind == "f" else np.dtype(np.float64)


def _three_axes(array: Array, shape: tuple[int, ...]) -> Array:
    """A view with three axes; leading axes beyond that are merged (which needs them written out)."""
    if len(shape) > 3:
        return np.broadcast_to(array, shape).reshape(-1, *shape[-2:])
    return array.reshape((1,) * (3 - array.ndim) + array.shape)


def _places(shape: tuple[int, ...]) -> list[tuple[slice, slice, slice]]:
    count, rows, columns = shape
    size = blocks.BLOCK
    across = [slice(x, min(x + size, columns)) for x in range(0, columns, size)]
    return [(z, y, x) for z, y in blocks.blocks(count, rows, columns) for x in across]


def _part(array: Array, place: tuple[slice, slice, slice]) -> Array:
    """The block of a broadcastable array: its axes of length 1 stay as they are."""
    part: Array = array[tuple(s if n > 1 else slice(None) for s, n in zip(place, array.shape, strict=True))]
    return part


def _cut(axis: _Axis, place: tuple[slice, slice, slice]) -> _Axis:
    return _Axis(*(_part(a, place) for a in axis))


def _axis(coordinate: Array, count: int, address: str, weight_bits: int | None, dtype: DTypeLike) -> _Axis:
    """Texels and share along one axis; see the notes of `fetch_trilinear`."""
    x = coordinate if coordinate.dtype.kind == "f" else coordinate.astype(np.float64)
    if address == "clamp":
        x = np.clip(x, 0.5, count - 0.5)
    with np.errstate(invalid="ignore"):  # NaN and infinity go through to the share
        floor = np.floor(x)
        fraction = x - floor
        near = _wrapped(floor, count) if address == "wrap" else floor.astype(np.intp)
    near = np.clip(near, 0, count - 1)  # where a NaN was cast
    right = fraction >= 0.5
    far = near + np.where(right, 1, -1)
    if address == "wrap":
        far = np.where(far == count, 0, np.where(far < 0, count - 1, far))
    else:
        far = np.clip(far, 0, count - 1)  # only where the share is 0
    share = np.abs(fraction - 0.5)
    if weight_bits is not None:
        share = np.rint(share * 2.0**weight_bits) * 2.0**-weight_bits
    return _Axis(near, far, share.astype(np.dtype(dtype) if np.dtype(dtype).kind == "f" else np.float64))


def _wrapped(floor: Array, count: int) -> NDArray[np.intp]:
    """Whole numbers modulo ``count``, exactly."""
    if not np.all(np.abs(floor) < _EXACT):  # also NaN; fmod is exact at any size but seven times slower
        floor = np.remainder(floor, np.asarray(count, floor.dtype))
    whole: NDArray[np.intp] = floor.astype(np.intp)
    return whole - whole // count * count


def _corners(axes: Sequence[_Axis], strides: Sequence[int], *, nearest: bool) -> list[NDArray[np.intp]]:
    """Flat indexes of the texels to read, the last axis's two neighbours side by side."""
    index: list[Any] = [np.zeros((1, 1, 1), np.intp)]
    for axis, stride in zip(axes, strides, strict=True):
        ends = [axis.near * stride] if nearest else [axis.near * stride, axis.far * stride]
        index = [i + end for i in index for end in ends]
    return index


def _interpolate(plane: Array, index: Sequence[NDArray[np.intp]], shares: Sequence[Array]) -> Array:
    values = [plane.take(i, mode="clip") for i in index]  # "clip" only because it is the fastest mode
    for share in reversed(shares):
        pairs = zip(values[::2], values[1::2], strict=True)
        values = [_blend(near, far, share) for near, far in pairs]
    return values[0]


def _blend(near: Array, far: Array, share: Array) -> Array:
    """near + share·(far − near), into ``far``."""
    far -= near
    far *= share
    far += near
    return far
