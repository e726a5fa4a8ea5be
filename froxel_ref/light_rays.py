"""Point and spot lights as the camera's rays see them: what a froxel costs is a few operations per light.

A froxel lies on a ray (unit direction u) at distance t from the camera. Of a light at offset q from the
camera the ray needs two numbers, computed once: b = q·u, where the ray passes closest, and
h² = |q − b·u|², how close. Then, with s = t − b::

    d² = s² + h²,   cos θ = −s/d,   d·(1 − cos θ) = d + s

and no position, direction or dot product is formed for a froxel. Lengths are measured in units of the
light's radius, so that its window ends at 1 and nothing overflows whatever the size of the world.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from froxel_ref.arrays import Field
from froxel_ref.geometry import Rays, dot
from froxel_ref.grid import Froxels, corner_bounds
from froxel_ref.lights import colour, smallest_d2, spot_cone, unit
from froxel_ref.scene import PointLight, SpotLight

__all__ = ["ConeRays", "LightRays", "Rect", "farthest_distance", "light_rays", "rect", "slice_boxes"]

Boxes = NDArray[np.intp]
Rect = tuple[slice, slice, slice]

# A ray through the light itself is taken to pass it at this share of min_distance: at the light θ is
# undefined, and this makes it a right angle (cos θ = 0) instead of 0/0. Within min_distance, where alone it
# can be seen, it moves d² by less than a rounding.
CLOSEST = 1e-8

# Radii below are taken for it [m], lest positions in units of the radius overflow.
TINIEST = 1e-100


class ConeRays(NamedTuple):
    """A spot light's cone along each ray: its factor is sat((slope·s + start)/d + offset)².

    Attributes
    ----------
    slope, start : Field, shape (h, w)
        scale·(u·a) and scale·((b·u − q)·a) in units, a the cone's axis.
    offset : float
        See `froxel_ref.lights.spot_cone`.
    """

    slope: Field
    start: Field
    offset: float


class LightRays(NamedTuple):
    """A point or spot light relative to the rays that it can touch.

    Attributes
    ----------
    number : int
        Its index in the scene's lights.
    unit : float [m]
        What lengths are measured in.
    windowed : bool
        Whether the light ends at distance 1.
    intensity : ndarray, shape (3,), float64 [W sr⁻¹ m⁻²]
        Over unit².
    corner : tuple of 2 ints
        Row and column of the first ray.
    nearest, across2 : Field, shape (h, w)
        b and h² of each ray, in units.
    cone : ConeRays or None
        Of a spot light.
    boxes : ndarray, shape (D, 4)
        First and last + 1 row and column that the light reaches in each slice; all 0 where none.
    close : ndarray, shape (D, 4)
        The same for distances below the lower bound on d².
    smallest : float
        The lower bound on d², in units².
    """

    number: int
    unit: float
    windowed: bool
    intensity: NDArray[np.float64]
    corner: tuple[int, int]
    nearest: Field
    across2: Field
    cone: ConeRays | None
    boxes: Boxes
    close: Boxes
    smallest: float


def light_rays(lights: Mapping[int, PointLight], froxels: Froxels, *, attenuation: str = "min_distance",
               restrict: bool = True) -> list[LightRays]:
    """Relate point and spot lights to the rays of a grid.

    Parameters
    ----------
    lights : mapping of int to PointLight or SpotLight
        By their index, which is carried along.
    froxels : Froxels
        The grid; its dtype is that of the result.
    attenuation : {"min_distance", "inverse_radius"}
        See `froxel_ref.lights.smallest_d2`.
    restrict : bool
        Whether to leave out what a light cannot reach.

    Returns
    -------
    list of LightRays
        In the same order, without the lights that touch no sample of the grid.

    Notes
    -----
    h² = |q × p|²/|p|² of the unnormalised ray p has no cancellation, and like b is computed in float64 and
    rounded once: there are only as many of them as rays.

    Examples
    --------
    >>> from froxel_ref.grid import make_froxels
    >>> from froxel_ref.scene import Camera
    >>> from froxel_ref.settings import Grid
    >>> froxels = make_froxels(Camera(), Grid(width=3, height=3, depth=4))
    >>> lamp = PointLight(position=(0.0, 1.7, -6.0), intensity=(9.0, 9.0, 9.0), radius=3.0)
    >>> [rays] = light_rays({5: lamp}, froxels)
    >>> float(rays.nearest[0, 0]), float(rays.across2[0, 0]) < 1e-20, float(rays.intensity[0])
    (2.0, True, 1.0)
    """
    px, py, pz = (c.astype(np.float64) for c in froxels.rays.per_depth)
    rays = Rays(froxels.rays.origin, (px, py, pz), 1.0 / np.sqrt(dot((px, py, pz), (px, py, pz))))
    with np.errstate(over="ignore"):  # sizes beyond all numbers are cut to the largest one
        boxes = _reached(list(lights.values()), froxels, restrict)
        return [_relate(index, light, box, froxels, rays, attenuation, restrict)
                for (index, light), box in zip(lights.items(), boxes, strict=True) if box.any()]


def _reached(lights: list[PointLight], froxels: Froxels, restrict: bool) -> Boxes:
    """What each light reaches, (lights, D, 4); whole slices where it cannot be told."""
    rows, columns = froxels.rays.length.shape
    whole = np.array([0, rows, 0, columns])
    boxes = np.broadcast_to(whole, (len(lights), froxels.depths.shape[0], 4)).copy()
    bounded = [k for k, light in enumerate(lights) if restrict and light.falloff == "windowed"]
    if bounded:
        boxes[bounded] = slice_boxes(froxels, [lights[k].position for k in bounded],
                                     [lights[k].radius for k in bounded])
    for k in bounded:
        light = lights[k]
        # The corners of a pyramid that is wide, or long beyond all measure, say nothing.
        long = light.radius > 1e3 * float(froxels.depths[-1, 0, 0])
        if isinstance(light, SpotLight) and light.outer_angle < 80.0 and not long:
            boxes[k] = _cut(boxes[k], _cone_bounds(light, froxels))
        # NumPy's loops run along x: half a row costs as much as the whole.
        if 2 * int(np.max(boxes[k, :, 3] - boxes[k, :, 2])) >= columns:
            boxes[k, boxes[k, :, 1] > 0, 2:] = 0, columns
    return boxes


def farthest_distance(dtype: np.dtype[Any]) -> float:
    """The largest distance, in units of a light's radius, whose fourth power the type can hold with room.

    Parameters
    ----------
    dtype : dtype
        Of the arithmetic.

    Returns
    -------
    float
        2.7e8 in float32.

    Examples
    --------
    >>> round(farthest_distance(np.dtype(np.float32)) / 1e8, 1)
    2.7
    """
    largest = float(np.finfo(dtype).max)
    return math.sqrt(math.sqrt(largest)) / 16.0


def _relate(index: int, light: PointLight, boxes: Boxes, froxels: Froxels, rays: Rays, attenuation: str,
            restrict: bool) -> LightRays:
    """One light relative to the rays in its boxes; ``rays.length`` is 1/|p| here, all in float64."""
    dtype = froxels.rays.length.dtype
    filled = boxes[boxes[:, 1] > 0]
    (top, left), (bottom, right) = filled[:, ::2].min(axis=0).tolist(), filled[:, 1::2].max(axis=0).tolist()
    y, x = slice(top, bottom), slice(left, right)
    shape = (bottom - top, right - left)
    px, py, pz = (c[y if c.shape[0] > 1 else slice(None), x if c.shape[1] > 1 else slice(None)]
                  for c in rays.per_depth)
    per_length = rays.length[y, x]
    windowed = light.falloff == "windowed"
    q = np.subtract(light.position, rays.origin)
    # Without a window any unit does; this one keeps the squares of everything small.
    size = max(light.radius, TINIEST) if windowed else max(1.0, float(np.hypot.reduce(q)))
    qx, qy, qz = (q / size).tolist()
    nx, ny, nz = qy * pz - qz * py, qz * px - qx * pz, qx * py - qy * px
    b = (qx * px + qy * py + qz * pz) * per_length
    h2 = (nx * nx + ny * ny + nz * nz) * (per_length * per_length)
    limits = np.finfo(dtype)
    # A ray through the light itself, and a light too far away to measure in its radii: the window's fourth
    # power of the distance must stay a number.
    closest, farthest = CLOSEST * light.min_distance / size, farthest_distance(dtype)
    b = np.clip(b, -farthest, farthest)
    h2 = np.clip(h2, max(closest * closest, 1e4 * float(limits.tiny)), farthest * farthest)
    cone = None
    if isinstance(light, SpotLight):
        scale, offset = spot_cone(light)
        ax, ay, az = (scale * c for c in unit(light.direction))
        slope = (ax * px + ay * py + az * pz) * per_length
        start = b * slope - (ax * qx + ay * qy + az * qz)
        cone = ConeRays(slope.astype(dtype), start.astype(dtype), offset)
    smallest = smallest_d2(light, attenuation)
    close = boxes
    if restrict and float(h2.min()) * size * size > 2.0 * smallest:
        close = np.zeros_like(boxes)
    elif restrict:
        close = slice_boxes(froxels, [light.position], [math.sqrt(smallest)])[0]
    return LightRays(index, size, windowed, colour(light) / size / size, (top, left), b.astype(dtype),
                     np.broadcast_to(h2.astype(dtype), shape), cone, boxes, close, smallest / size / size)


def slice_boxes(froxels: Froxels, centers: ArrayLike, radii: ArrayLike) -> Boxes:
    """Bound the samples inside spheres by ranges of rows and columns, slice by slice.

    Parameters
    ----------
    froxels : Froxels
        The grid.
    centers : array_like, shape (n, 3) [m]
        World positions.
    radii : array_like, shape (n,) [m]
        At least 0.

    Returns
    -------
    ndarray, shape (n, D, 4)
        First row, last row + 1, first column, last column + 1; all 0 in slices that the sphere does not
        meet. Holds every sample within the radius, also as computed in the grid's dtype.

    Notes
    -----
    A slice cuts a sphere in a circle, and the grid's rows and columns are straight lines in the slice's
    plane, so the bound of the circle is exact. One box for all slices would be half empty.

    Examples
    --------
    >>> from froxel_ref.grid import make_froxels
    >>> from froxel_ref.scene import Camera
    >>> from froxel_ref.settings import Grid
    >>> froxels = make_froxels(Camera(), Grid(width=8, height=8, depth=4, near=1.0, far=16.0))
    >>> slice_boxes(froxels, [(0.0, 1.7, -4.0)], [1.5])[0].tolist()
    [[0, 0, 0, 0], [2, 6, 3, 5], [0, 0, 0, 0], [0, 0, 0, 0]]
    """
    points, radius = np.asarray(centers, np.float64), np.asarray(radii, np.float64)[:, np.newaxis]
    depths = froxels.depths[:, 0, 0].astype(np.float64)
    # Metres by which rounding may move a sample or the sphere, with a wide margin.
    extent = np.abs([*froxels.rays.origin, depths[-1] * froxels.rays.length.max()]).max()
    extent = extent + np.abs(points).max(axis=1, keepdims=True) + radius
    reach = radius + 32.0 * float(np.finfo(froxels.depths.dtype).eps) * extent
    linear, shift = froxels.sample_from_world[:, :3], froxels.sample_from_world[:, 3]
    places = (points @ linear.T + shift)[:, :, np.newaxis]
    away = depths - places[:, 2]
    circle = np.sqrt(np.maximum(reach - away, 0.0)) * np.sqrt(np.maximum(reach + away, 0.0))
    boxes = np.zeros((*away.shape, 4), np.intp)
    for column, axis, count in zip((0, 2), (1, 0), froxels.rays.length.shape, strict=True):
        along = float(linear[axis] @ linear[2])
        half = float(np.linalg.norm(linear[axis] - along * linear[2])) * circle
        middle = places[:, axis] + along * away
        boxes[..., column] = np.clip(np.ceil((middle - half) / depths), 0, count)
        boxes[..., column + 1] = np.clip(np.floor((middle + half) / depths) + 1, 0, count)
    boxes[(np.abs(away) > reach) | (boxes[..., 0] >= boxes[..., 1]) | (boxes[..., 2] >= boxes[..., 3])] = 0
    return boxes


def rect(boxes: Boxes, z: slice, y: slice) -> Rect | None:
    """The part of a block that boxes cover, as ranges in the grid.

    Parameters
    ----------
    boxes : ndarray, shape (D, 4)
        As from `slice_boxes`.
    z, y : slice
        The block's slices and rows.

    Returns
    -------
    tuple of 3 slices, or None
        Along z, y and x; None where the boxes miss the block.

    Examples
    --------
    >>> rect(np.array([[0, 0, 0, 0], [2, 6, 3, 5]]), slice(0, 2), slice(4, 8))
    (slice(1, 2, None), slice(4, 6, None), slice(3, 5, None))
    """
    if z.stop - z.start == 1:
        top, bottom, left, right = boxes[z.start].tolist()
        first, last = z.start, z.stop
    else:
        part = boxes[z]
        filled = np.flatnonzero(part[:, 1])
        if filled.size == 0:
            return None
        part = part[filled]
        (top, left), (bottom, right) = part[:, ::2].min(axis=0).tolist(), part[:, 1::2].max(axis=0).tolist()
        first, last = z.start + int(filled[0]), z.start + int(filled[-1]) + 1
    top, bottom = max(top, y.start), min(bottom, y.stop)
    if top >= bottom or left >= right:
        return None
    return slice(first, last), slice(top, bottom), slice(left, right)


def _cone_bounds(light: SpotLight, froxels: Froxels) -> Boxes:
    """Slice by slice bounds of a pyramid around a spot light's cone."""
    axis = np.array(unit(light.direction))
    side = np.cross(axis, np.eye(3)[np.argmin(np.abs(axis))])
    side /= np.linalg.norm(side)
    half = np.tan(np.radians(light.outer_angle)) * light.radius * (1.0 + 1e-6)
    base = axis * light.radius
    sides = half * np.stack([side, np.cross(axis, side)])
    corners = [base + i * sides[0] + j * sides[1] for i in (-1, 1) for j in (-1, 1)]
    z, y, x = corner_bounds(froxels, np.array([np.zeros(3), *corners]) + light.position)
    boxes = np.zeros((froxels.depths.shape[0], 4), np.intp)
    boxes[z] = y.start, y.stop, x.start, x.stop
    return boxes


def _cut(boxes: Boxes, others: Boxes) -> Boxes:
    """What lies in both."""
    result = np.where(np.arange(4) % 2 == 0, np.maximum(boxes, others), np.minimum(boxes, others))
    result[(result[:, 0] >= result[:, 1]) | (result[:, 2] >= result[:, 3])] = 0
    return result
