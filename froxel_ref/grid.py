"""Froxels: how slices share the view depth, where texels lie in the world, and which ones a shape touches.

Texel i of an axis covers [i, i+1); its sample lies at i + jitter, ½ where nothing jitters. Slice
coordinates count boundaries: 0 is the near one, ``grid.depth`` the far one. Depth is planar view depth.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray

from froxel_ref.arrays import Field, Index, Points
from froxel_ref.compensated import double_double
from froxel_ref.geometry import (
    Rays,
    camera_rays,
    clip_from_view,
    crop_rays,
    ray_points,
    transform_points,
    view_from_world,
    world_from_view,
)
from froxel_ref.scene import Camera
from froxel_ref.settings import Grid

__all__ = [
    "CURVES", "Curve", "Froxels", "corner_bounds", "depth_to_slice", "froxel_from_world", "froxel_points",
    "make_froxels", "slice_to_depth", "step_lengths", "world_from_froxel",
]

Doubles = NDArray[np.float64]
NOTHING: Index = (slice(0, 0), slice(0, 0), slice(0, 0))


class Froxels(NamedTuple):
    """The samples of a froxel grid, as rays times depths; positions are formed for the block in hand.

    Attributes
    ----------
    rays : Rays
        Through the samples of the grid's columns and rows, shape (H, W).
    depths : Field, shape (D, 1, 1) [m]
        View depth of the samples, growing.
    boundaries : Field, shape (D + 1, 1, 1) [m]
        View depth of the slice boundaries.
    sample_from_world : ndarray, shape (3, 4), float64
        Takes (x, y, z, 1) in the world to (i·depth, j·depth, depth), where the sample of column i and
        row j lies on the ray (i, j) exactly; used to find which samples a shape can touch.
    """

    rays: Rays
    depths: Field
    boundaries: Field
    sample_from_world: Doubles


# --- slice distributions ----------------------------------------------------------------------------


class Curve(NamedTuple):
    """A slice distribution: depth from slice and its inverse, each given (values, slices, near, far)."""

    depth: Callable[[Doubles, int, float, float], Doubles]
    slice: Callable[[Doubles, int, float, float], Doubles]


def _exponential_depth(s: Doubles, count: int, near: float, far: float) -> Doubles:
    # From the nearer end, so that both ends come out exact and the exponent's rounding is halved.
    front = 2.0 * s <= count
    power: Doubles = np.power(far / near, np.where(front, s, s - count) / count)
    return np.where(front, near, far) * power


def _exponential_slice(z: Doubles, count: int, near: float, far: float) -> Doubles:
    front = z <= np.sqrt(near) * np.sqrt(far)
    ratio = np.where(front, np.maximum(z, 0.0) / near, z / far)
    with np.errstate(divide="ignore"):  # depth 0 is slice −∞
        rise: Doubles = np.log2(ratio) / np.log2(far / near) * count
    return np.where(front, rise, count + rise)


def _linear_depth(s: Doubles, count: int, near: float, far: float) -> Doubles:
    front = 2.0 * s <= count
    share: Doubles = np.where(front, s, s - count) / count
    return np.where(front, near, far) + (far - near) * share


def _linear_slice(z: Doubles, count: int, near: float, far: float) -> Doubles:
    front = 2.0 * z <= near + far
    return np.where(front, 0.0, count) + (z - np.where(front, near, far)) * (count / (far - near))


CURVES: Mapping[str, Curve] = MappingProxyType({
    "exponential": Curve(_exponential_depth, _exponential_slice),
    "linear": Curve(_linear_depth, _linear_slice),
})
"""The distributions by name, one for each word of `froxel_ref.settings.DISTRIBUTIONS`."""


def slice_to_depth(s: ArrayLike, grid: Grid) -> Doubles:
    """Find the view depth of slice coordinates.

    Parameters
    ----------
    s : array_like
        Slice coordinates; [0, D] is the grid, beyond it the curve is continued.
    grid : Grid
        Its near, far, depth and distribution.

    Returns
    -------
    ndarray, shape of ``s``, float64 [m]
        View depth; exactly near at 0 and far at D.

    Notes
    -----
    exponential: z = n·(f/n)^(s/D) [Dörries 2020, §3.2.2]; linear: z = n + (f − n)·s/D. Computed from the
    nearer end. Largest error measured against 50-digit arithmetic, for f/n up to 1e6: 1.3 ulp where D is
    a power of two; otherwise the rounding of s/D adds up to ¼·ln(f/n) ulp.

    Examples
    --------
    >>> slice_to_depth([0, 32, 64], Grid(near=0.25, far=64.0, depth=64)).tolist()
    [0.25, 4.0, 64.0]
    """
    return CURVES[grid.distribution].depth(np.asarray(s, np.float64), grid.depth, grid.near, grid.far)


def depth_to_slice(z: ArrayLike, grid: Grid) -> Doubles:
    """Find the slice coordinate of view depths, the inverse of `slice_to_depth`.

    Parameters
    ----------
    z : array_like [m]
        View depths, also infinite ones.
    grid : Grid
        Its near, far, depth and distribution.

    Returns
    -------
    ndarray, shape of ``z``, float64
        Slice coordinates; exactly 0 at near and D at far, ∞ at infinity. Under the exponential
        distribution −∞ where depth ≤ 0.

    Notes
    -----
    exponential: s = D·ln(z/n)/ln(f/n); linear: s = D·(z − n)/(f − n). The float that holds s holds z to
    ½·ln(f/n) ulp at best. Largest error measured for z → s → z: 4 ulp for f/n = 128 as in the thesis,
    15 ulp for 1e6; linear 1 ulp. For s → z → s: 1.5·D·2⁻⁵².

    Examples
    --------
    >>> depth_to_slice([0.0, 0.25, 4.0, float("inf")], Grid(near=0.25, far=64.0, depth=64)).tolist()
    [-inf, 0.0, 32.0, inf]
    """
    return CURVES[grid.distribution].slice(np.asarray(z, np.float64), grid.depth, grid.near, grid.far)


# --- the grid ---------------------------------------------------------------------------------------


def make_froxels(camera: Camera, grid: Grid, *, jitter: tuple[float, float, float] = (0.5, 0.5, 0.5),
                 dtype: DTypeLike = np.float64) -> Froxels:
    """Lay a froxel grid into a camera's view.

    Parameters
    ----------
    camera : Camera
        Its whole image is covered, whatever the grid's aspect.
    grid : Grid
        Extents, depth range and distribution.
    jitter : tuple of 3 floats, in [0, 1)
        Where in its texel a sample lies, along x, y (downwards) and z (away).
    dtype : data type
        Of the result; all is computed in float64 and rounded once.

    Returns
    -------
    Froxels
        Samples at slice coordinate k + jitter: under the exponential distribution the geometric, not the
        arithmetic mean of the slice's boundaries at ½.

    Notes
    -----
    The rays' ``length`` is that of ``per_depth`` as it stands, in twice the digits and rounded once, for
    every path through a slice is a multiple of it.

    Examples
    --------
    >>> froxels = make_froxels(Camera(), Grid(width=4, height=2, depth=8, near=0.25, far=64.0))
    >>> froxels.rays.length.shape, froxels.depths.shape, float(froxels.boundaries[4, 0, 0])
    ((2, 4), (8, 1, 1), 4.0)
    """
    rays = camera_rays(camera, grid.width, grid.height, jitter=jitter[:2], dtype=dtype)
    depths = slice_to_depth(np.arange(grid.depth) + jitter[2], grid).reshape(-1, 1, 1).astype(dtype)
    boundaries = slice_to_depth(np.arange(grid.depth + 1), grid).reshape(-1, 1, 1).astype(dtype)
    x, y, z = (double_double(component) for component in rays.per_depth)
    length = np.broadcast_to((x * x + y * y + z * z).sqrt().high.astype(dtype), rays.length.shape)
    return Froxels(rays._replace(length=length), depths, boundaries, _texel_from_world(camera, grid, jitter[:2]))


def froxel_points(froxels: Froxels, z: slice = slice(None), y: slice = slice(None),
                  x: slice = slice(None)) -> Points:
    """Place the samples of a box of froxels in the world.

    Parameters
    ----------
    froxels : Froxels
        The grid.
    z, y, x : slice
        Ranges of slices, rows and columns; all of them unless given.

    Returns
    -------
    Points [m]
        origin + per_depth·depth; each component has the axes (z, y, x), of length 1 where it does not vary.

    Examples
    --------
    >>> froxels = make_froxels(Camera(), Grid(width=4, height=2, depth=8))
    >>> [component.shape for component in froxel_points(froxels, z=slice(0, 3))]
    [(3, 1, 4), (3, 2, 1), (3, 1, 1)]
    """
    return ray_points(crop_rays(froxels.rays, y, x), froxels.depths[z])


def step_lengths(froxels: Froxels) -> tuple[Field, Field]:
    """Give the lengths of the slices along each ray, as two factors.

    Parameters
    ----------
    froxels : Froxels
        The grid.

    Returns
    -------
    step : Field, shape (D, 1, 1) [m]
        View depth between consecutive boundaries.
    length : Field, shape (H, W) [1]
        Metres along the ray per metre of view depth; the path through slice k is step[k]·length.

    Notes
    -----
    Taking the planar step for the path length makes fog too thin by cos θ off the axis (D13).

    Examples
    --------
    >>> step, length = step_lengths(make_froxels(Camera(), Grid(depth=63, near=1.0, distribution="linear")))
    >>> step.shape, round(float(step.sum()), 12), bool(length.min() >= 1.0)
    ((63, 1, 1), 63.0, True)
    """
    step: Field = np.diff(froxels.boundaries, axis=0)
    return step, froxels.rays.length


# --- world and texel coordinates --------------------------------------------------------------------


def world_from_froxel(coordinates: Points, camera: Camera, grid: Grid) -> Points:
    """Place texel coordinates in the world.

    Parameters
    ----------
    coordinates : Points
        x, y (downwards) and slice coordinate; texel centres lie at i + ½.
    camera, grid : Camera, Grid
        The view and the grid in it.

    Returns
    -------
    Points [m]
        World position, float64.

    Notes
    -----
    The thesis interpolates the four far-plane corners bilinearly and scales by z/f; for a perspective view
    that is the same point as origin + (forward + right·u + up·v)·z [Dörries 2020, listing 3.1].

    Examples
    --------
    >>> middle = (np.array([2.0]), np.array([1.0]), np.array([0.0]))
    >>> [c.tolist() for c in world_from_froxel(middle, Camera(), Grid(width=4, height=2, near=0.5))]
    [[0.0], [1.7], [-0.5]]
    """
    clip = clip_from_view(camera, 1.0)
    x, y = (np.asarray(c, np.float64) for c in coordinates[:2])
    depth = slice_to_depth(coordinates[2], grid)
    view = ((2.0 * x / grid.width - 1.0) / clip[0, 0] * depth,
            (1.0 - 2.0 * y / grid.height) / clip[1, 1] * depth, -depth)
    return transform_points(world_from_view(camera), view)


def froxel_from_world(points: Points, camera: Camera, grid: Grid) -> Points:
    """Find the texel coordinates of world points, the inverse of `world_from_froxel`.

    Parameters
    ----------
    points : Points [m]
        World positions.
    camera, grid : Camera, Grid
        The view and the grid in it.

    Returns
    -------
    Points
        x, y (downwards) and slice coordinate, float64; inside the grid iff 0 ≤ x < W, 0 ≤ y < H and
        0 ≤ z < D. x and y are NaN at or behind the camera's plane, so that no such test holds there.

    Examples
    --------
    >>> point = (np.array([0.0]), np.array([1.7]), np.array([-64.0]))
    >>> [c.tolist() for c in froxel_from_world(point, Camera(), Grid())]
    [[80.0], [45.0], [64.0]]
    """
    wide = tuple(np.asarray(c, np.float64) for c in points)
    matrix = np.vstack([_texel_from_world(camera, grid, (0.0, 0.0)), (0.0, 0.0, 0.0, 1.0)])
    x, y, depth = transform_points(matrix, (wide[0], wide[1], wide[2]))
    front = np.where(depth > 0.0, depth, np.nan)
    return x / front, y / front, depth_to_slice(depth, grid)


def _texel_from_world(camera: Camera, grid: Grid, jitter: tuple[float, float]) -> Doubles:
    """Rows that give (i·depth, j·depth, depth), where i + jitter is the texel coordinate."""
    clip_from_world = clip_from_view(camera, 1.0) @ view_from_world(camera)
    right, up, depth = clip_from_world[0], clip_from_world[1], clip_from_world[3]
    return np.stack([0.5 * grid.width * (right + depth) - jitter[0] * depth,
                     0.5 * grid.height * (depth - up) - jitter[1] * depth, depth])


# --- which samples a shape can touch ----------------------------------------------------------------


def corner_bounds(froxels: Froxels, corners: ArrayLike) -> Index:
    """Bound the samples inside the convex hull of some points by ranges of slices, rows and columns.

    Parameters
    ----------
    froxels : Froxels
        The grid.
    corners : array_like, shape (n, 3) [m]
        World positions, some of which may lie behind the camera.

    Returns
    -------
    Index
        Holds every sample inside the hull, also as computed in the grid's dtype; empty where the hull is
        out of view.

    Notes
    -----
    The hull is cut to the depth range of the samples first (all segments between two corners are, which
    holds every edge), so a hull that the camera stands in, or that passes it, is bounded as well.

    Examples
    --------
    >>> froxels = make_froxels(Camera(), Grid(width=8, height=8, depth=4, near=1.0, far=16.0))
    >>> corner_bounds(froxels, [(-1, 1, -6), (1, 1, -6), (0, 2, -2)])
    (slice(1, 3, None), slice(3, 5, None), slice(3, 5, None))
    """
    points = np.asarray(corners, np.float64).reshape(-1, 3)
    slack = _slack(froxels, np.abs(points).max())
    matrix = froxels.sample_from_world
    cut = points @ matrix[:, :3].T + matrix[:, 3]
    first, last = float(froxels.depths[0, 0, 0]), float(froxels.depths[-1, 0, 0])
    # The rounding slack must not move the cut to the camera's plane, where every image is infinite.
    cut = _clip(cut, max(first - slack, 0.5 * first), last + slack)
    if cut.size == 0:
        return NOTHING
    depth = cut[:, 2]
    ranges = [_depth_range(froxels, depth.min() - slack, depth.max() + slack)]
    for axis, count in zip((1, 0), froxels.rays.length.shape, strict=True):
        image = cut[:, axis] / depth
        # How far the image moves for a metre across, at the nearest depth.
        widen = slack * (np.linalg.norm(matrix[axis, :3]) + count) / depth.min()
        low, high = np.clip([image.min() - widen, image.max() + widen], -1.0, count)
        ranges.append(slice(int(np.ceil(low)) if low > 0.0 else 0, min(int(np.floor(high)) + 1, count)))
    return _index(ranges)


def _slack(froxels: Froxels, extent: float) -> float:
    """Metres by which rounding may move a sample or a shape of this extent, with a wide margin."""
    length = froxels.rays.length
    corners = length[::max(1, length.shape[0] - 1), ::max(1, length.shape[1] - 1)]  # the longest is there
    size = max(map(abs, froxels.rays.origin)) + float(froxels.depths[-1, 0, 0] * corners.max()) + extent
    return 32.0 * float(np.finfo(froxels.depths.dtype).eps) * size


def _depth_range(froxels: Froxels, low: float, high: float) -> slice:
    depths = froxels.depths[:, 0, 0].astype(np.float64)
    return slice(int(np.searchsorted(depths, low, "left")), int(np.searchsorted(depths, high, "right")))


def _index(ranges: list[slice]) -> Index:
    """The three ranges, or three empty ones if any is empty."""
    return NOTHING if any(r.start >= r.stop for r in ranges) else (ranges[0], ranges[1], ranges[2])


def _clip(points: Doubles, low: float, high: float) -> Doubles:
    """Cut a convex hull to low ≤ depth ≤ high: points whose hull is the cut one; depth is the last column."""
    for bound, side in ((low, 1.0), (high, -1.0)):
        beyond: NDArray[Any] = side * (points[:, 2] - bound)
        a, b = np.nonzero((beyond[:, np.newaxis] > 0.0) & (beyond[np.newaxis, :] < 0.0))
        share = (beyond[a] / (beyond[a] - beyond[b]))[:, np.newaxis]
        crossing = points[a] + share * (points[b] - points[a])
        crossing[:, 2] = bound  # exactly: its rounding is that of a corner that may be far behind
        points = np.concatenate([points[beyond >= 0.0], crossing])
    return points
