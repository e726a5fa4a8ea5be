"""Other ways of looking the fog up than one trilinear fetch: taps with blue noise, and a smoother fetch."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray

from froxel_ref.arrays import Field
from froxel_ref.blue_noise import noise_at
from froxel_ref.records import InputError, shown
from froxel_ref.sampling import fetch_trilinear
from froxel_ref.tonemap import inverse_tone_map

__all__ = ["ALONG_Z", "Fetch", "fetch_biquadratic", "noisy_lookup", "rotated_taps", "tap_offsets"]

ALONG_Z = ("linear", "quadratic")

Array = NDArray[Any]


class Fetch(Protocol):
    """What `froxel_ref.sampling.fetch_trilinear` and `fetch_biquadratic` are."""

    def __call__(self, texture: Array, x: ArrayLike, y: ArrayLike, z: ArrayLike, *, address: str = "clamp",
                 weight_bits: int | None = None, threads: int | None = 1) -> Array: ...


def tap_offsets(rows: NDArray[np.integer[Any]], columns: NDArray[np.integer[Any]], frame: int, *, taps: int = 4,
                reach: float = 1.5, depth_share: float = 0.5, noise: Field | None = None,
                dtype: DTypeLike = np.float64) -> Field:
    """How far from its place the fog is looked up for pixels of a frame.

    Parameters
    ----------
    rows, columns : ndarray of int, broadcastable to a common shape (…)
        Pixels.
    frame : int
        The frame's number.
    taps : int, default 4
        Lookups for a pixel, at most as many as the noise has components.
    reach : float, default 1.5
        [texels] Largest offset along x and y, at least 0.
    depth_share : float, default 0.5
        [1] Share of it that is the largest offset along z, at least 0.
    noise : ndarray, shape (components, layers, height, width), optional
        Three components at least. Default: `froxel_ref.blue_noise.blue_noise`.
    dtype : dtype, default float64
        Of the result; exact in float32 too, with the defaults.

    Returns
    -------
    ndarray, shape (taps, 3, …)
        [texels] Offsets along x, y and z.

    Raises
    ------
    InputError
        Taps, reach or depth_share out of bounds, noise of fewer than three components; as for
        `froxel_ref.blue_noise.noise_at`.

    Notes
    -----
    [Dörries 2020, §3.2.7, §3.2.10, listings 3.12 and 3.13]. With N the noise at the pixel, in (0, 1), n the components
    (2N − 1)·reach, counted round, and e the depth_share, tap i lies at (n_i, n_{i+1}, e·n_{i+2}).

    With as many taps as components each axis has every component once. So the mean of the taps always lies on one
    diagonal, (1, 1, e) times the mean of n: where the fog is linear with the gradient (a, b, c) per texel, the noise
    of the mean of four has the variance (a + b + e·c)²·reach²/12, where independent numbers would give
    (a² + b² + (e·c)²)·reach²/12. So it is from none to three times as much, depending on the gradient's direction.

    Examples
    --------
    >>> offsets = tap_offsets(np.arange(2).reshape(-1, 1), np.arange(3), 0)
    >>> offsets.shape, bool(np.abs(offsets[:, 2]).max() < 0.75)
    ((4, 3, 2, 3), True)
    """
    if not reach >= 0.0:
        raise InputError("reach", f"is {shown(reach)}, must be at least 0 texels")
    if not depth_share >= 0.0:
        raise InputError("depth_share", f"is {shown(depth_share)}, must be at least 0")
    values = noise_at(rows, columns, frame, noise=noise, dtype=dtype)
    count = len(values)
    if count < 3:
        raise InputError("noise", f"has {count} components, must have 3 at least")
    if isinstance(taps, bool) or taps not in range(1, count + 1):
        raise InputError("taps", f"is {shown(taps)}, must be 1 to {count}, the components of the noise")
    offsets = rotated_taps(values, taps=taps, axes=3, reach=reach)
    offsets[:, 2] *= values.dtype.type(depth_share)
    return offsets


def rotated_taps(noise: Field, *, taps: int, axes: int, reach: float) -> Field:
    """Offsets of several taps from the components of one noise, rotated from tap to tap.

    Parameters
    ----------
    noise : ndarray, shape (n, …)
        In [0, 1].
    taps, axes : int
        Of each at most n.
    reach : float
        Largest offset, either way.

    Returns
    -------
    ndarray, shape (taps, axes, …)
        Tap i has the components i, i + 1, … of (2·noise − 1)·reach, counted round [Dörries 2020, listing 3.13].

    Examples
    --------
    >>> rotated_taps(np.array([0.0, 0.5, 1.0]), taps=3, axes=2, reach=1.0).tolist()
    [[-1.0, 0.0], [0.0, 1.0], [1.0, -1.0]]
    """
    spread = (noise * noise.dtype.type(2.0) - noise.dtype.type(1.0)) * noise.dtype.type(reach)
    return np.stack([spread[np.arange(i, i + axes) % len(spread)] for i in range(taps)])


def noisy_lookup(texture: Array, x: ArrayLike, y: ArrayLike, z: ArrayLike, offsets: Field, *, bias: float = 1.5,
                 nearest: float | None = None, tone_mapped: bool = False, largest_luma: float | None = None,
                 fetch: Fetch = fetch_trilinear, threads: int | None = 1) -> Array:
    """The mean of several lookups around a place, nearer to the camera.

    Parameters
    ----------
    texture : ndarray, shape (nz, ny, nx) or (C, nz, ny, nx)
        What is stored: transmittance as it is, or tone-mapped radiance.
    x, y, z : array_like
        Texel coordinates, broadcastable to a common shape (…).
    offsets : ndarray, shape (taps, 3, …)
        [texels] Along x, y and z, as of `tap_offsets`.
    bias : float, default 1.5
        [slices] How far all taps are moved to the camera. Published: 1.5.
    nearest : float, optional
        Coordinate along z in front of which no tap lies: those that would are moved to it. Default: none.
    tone_mapped : bool, default False
        Whether the texture is radiance after `froxel_ref.tonemap.tone_map`, which is undone on the mean.
    largest_luma : float, optional
        As for `froxel_ref.tonemap.inverse_tone_map` (D9).
    fetch : callable, default `fetch_trilinear`
        Or `fetch_biquadratic`; clamps.
    threads : int, optional
        Default 1; None: one per core. The result is the same to the last bit.

    Returns
    -------
    ndarray, shape (…) or (C, …)
        As of the fetch, of the dtype of texture and coordinates together.

    Raises
    ------
    InputError
        Offsets without taps or three axes, a tone-mapped texture without its three channels; as for the fetch.

    Notes
    -----
    [Dörries 2020, §3.2.7, §3.2.10]. With S the stored field the result is 1/n·Σ S(x + δx, y + δy, z − bias + δz), or
    the inverse tone map of that. The mean is taken step by step, m + (v − m)/k for the k-th, so it never leaves the
    hull of the texels and a constant texture gives that constant, both exactly.

    The bias hides fog that would leak through thin walls, at the cost of an error of first order in the slice's depth:
    the fog of 1.5 slices is missing. Of the published lookup only that of one is, since it reads half a slice too
    deep (D4): with stored values at their boundaries, bias 1 is what its pictures have. Tone-mapped taps that differ
    give less light than the mean of their light, since the map is concave: bright flecks count less.

    Examples
    --------
    >>> column = np.array([1.0, 0.8, 0.6, 0.4]).reshape(4, 1, 1)
    >>> offsets = np.array([-0.75, -0.25, 0.25, 0.75])[:, np.newaxis, np.newaxis] * np.array([[0.0], [0.0], [1.0]])
    >>> noisy_lookup(column, 0.5, 0.5, np.array([3.5]), offsets).round(12)
    array([0.7])
    >>> noisy_lookup(column, 0.5, 0.5, np.array([3.5]), offsets, bias=0.0, nearest=3.0).round(12)
    array([0.4375])
    """
    if offsets.ndim < 2 or offsets.shape[1] != 3 or not len(offsets):
        raise InputError("offsets", f"has shape {offsets.shape}, must be (taps, 3, …)")
    if tone_mapped and (texture.ndim != 4 or len(texture) != 3):
        raise InputError("texture", f"has shape {texture.shape}, must be (3, nz, ny, nx) where it is tone-mapped")
    dtype = np.result_type(texture.dtype, *(c.dtype for c in (x, y, z) if hasattr(c, "dtype")))
    dtype = dtype if dtype.kind == "f" else np.dtype(np.float64)
    across, down, deep = (np.asarray(c, dtype) for c in (x, y, z))
    deep = deep - dtype.type(bias)
    mean: Any = None
    for count, (dx, dy, dz) in enumerate(offsets.astype(dtype, copy=False), start=1):
        place = deep + dz if nearest is None else np.maximum(deep + dz, dtype.type(nearest))
        tap = fetch(texture, across + dx, down + dy, place, threads=threads)
        if mean is None:
            mean = tap
        else:
            tap -= mean
            tap *= dtype.type(1.0 / count)
            mean += tap
    return inverse_tone_map(mean, largest_luma=largest_luma) if tone_mapped else mean


def fetch_biquadratic(texture: Array, x: ArrayLike, y: ArrayLike, z: ArrayLike, *, address: str = "clamp",
                      weight_bits: int | None = None, threads: int | None = 1, along_z: str = "linear") -> Array:
    """Values of a 3-D texture by the uniform quadratic B-spline: smooth, where a trilinear fetch has creases.

    Parameters
    ----------
    texture : ndarray, shape (nz, ny, nx) or (C, nz, ny, nx)
        Finite texels; channels first.
    x, y, z : array_like
        Texel coordinates (0 and n are the texture's two ends), broadcastable to a common shape.
    address : {"clamp", "wrap"}
        Beyond the ends: the edge texel, or the texture repeated.
    weight_bits : int, optional
        As for `fetch_trilinear`: of the linear fetches that this one is made of.
    threads : int, optional
        Default 1; None: one per core. The result is the same to the last bit.
    along_z : {"linear", "quadratic"}
        Quadratic in x and y; along z the stored values come back at the texels' centres, or are smoothed too.

    Returns
    -------
    ndarray, shape (…) or (C, …)
        As for `fetch_trilinear`.

    Raises
    ------
    InputError
        Unknown along_z; as for `fetch_trilinear`.

    Notes
    -----
    Along one axis, in texel i at x = i + f, the texels i − 1, i and i + 1 have the weights ½(1 − f)², ½ + f(1 − f) and
    ½f². They add up to 1, and their first moment is x: linear textures come back, from a texel within the ends on.
    The second is x² + ¼ instead of x², so what is smooth comes back with h²/8 times its second derivative too much, h
    the texel: of order 2, and everywhere alike as much as a linear fetch has between two centres. The result has
    continuous first derivatives; texels do not come back at their centres.

    The weights are those of two linear fetches, at i + ½f and i + ½ + ½f, with shares 1 − f and f; so a device needs
    four fetches, or eight. They are blended from the nearer end, with a share of at most ½, hence the result never
    leaves the hull of the texels and a constant texture gives that constant, both exactly. Beyond the rounding of
    these blends, halving f rounds coordinates once more, by half an ulp.

    Examples
    --------
    >>> step = np.array([0.0, 0.0, 8.0, 8.0]).reshape(1, 1, 4)
    >>> fetch_biquadratic(step, np.array([0.5, 1.0, 1.5, 2.0, 2.5, 3.0, 9.0]), 0.5, 0.5)
    array([0., 0., 1., 4., 7., 8., 8.])
    """
    if along_z not in ALONG_Z:
        raise InputError("along_z", f"is {shown(along_z)}, must be one of {', '.join(ALONG_Z)}")
    smooth = [axis for axis, count in enumerate(texture.shape[-3:])
              if count > 1 and (axis > 0 or along_z == "quadratic")]

    def linear(places: Sequence[ArrayLike]) -> Array:
        return fetch_trilinear(texture, places[2], places[1], places[0], address=address, weight_bits=weight_bits,
                               threads=threads)

    return _smoothed(linear, (z, y, x), smooth, texture.shape[-3:], address)


def _smoothed(linear: Callable[[Sequence[ArrayLike]], Array], places: tuple[ArrayLike, ...], axes: Sequence[int],
              sizes: Sequence[int], address: str) -> Array:
    """The linear fetch at places (z, y, x), made quadratic along some of the axes."""
    if not axes:
        return linear(places)
    axis, *rest = axes
    near, far, share = _ends(places[axis], sizes[axis], address)
    at_near, at_far = (_smoothed(linear, (*places[:axis], end, *places[axis + 1:]), rest, sizes, address)
                       for end in (near, far))
    at_far -= at_near
    at_far *= share
    at_far += at_near
    return at_far


def _ends(coordinate: ArrayLike, count: int, address: str) -> tuple[ArrayLike, ArrayLike, Array]:
    """Where the two linear fetches lie along an axis, the one of more weight first, and the other one's share."""
    x = np.asarray(coordinate)
    x = x if x.dtype.kind == "f" else x.astype(np.float64)
    if address == "clamp":
        x = np.clip(x, 0.0, count)  # for infinity: beyond, the edge texel has all weight anyway
    with np.errstate(invalid="ignore"):
        texel = np.floor(x)
        fraction = x - texel
    half = x.dtype.type(0.5)
    right = fraction >= half
    low = texel + half * fraction
    high = low + half
    ends: tuple[Array, Array] = np.where(right, high, low), np.where(right, low, high)
    share = np.where(right, 1 - fraction, fraction)
    if hasattr(coordinate, "dtype"):
        return *ends, share
    return ends[0].tolist(), ends[1].tolist(), share  # a Python number has no say in the result's dtype
