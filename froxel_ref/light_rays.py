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
from froxel_ref.geometry import dot
from froxel_ref.grid import Froxels, corner_bounds
from froxel_ref.lights import colour, cone_corners, smallest_d2, spot_cone, unit
from froxel_ref.scene import PointLight, SpotLight

__all__ = ["Boxes", "ConeRays", "LightRays", "farthest_distance", "light_rays", "rects", "slice_boxes"]

Boxes = NDArray[np.intp]

# Rays that are related to lights at a time: a dozen arrays of float64 that stay in the cache.
RAYS = 16384
# Columns [bytes] that a light may be given beyond its reach, if it then has whole rows.
COLUMNS = 256

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
    """Point and spot lights relative to the rays that each can touch.

    What is counted by light below has one entry for each of the n lights; ``nearest`` and ``across2`` hold
    all lights' windows one after another.

    Attributes
    ----------
    numbers : ndarray, shape (n,)
        Their indices in the scene's lights, growing.
    units : ndarray, shape (n,), float64 [m]
        What lengths are measured in.
    windowed : ndarray of bool, shape (n,)
        Whether the light ends at distance 1.
    intensity : ndarray, shape (n, 3), float64 [W sr⁻¹ m⁻²]
        Over unit².
    windows : ndarray, shape (n, 4)
        First and last + 1 row and column of the rays.
    starts : ndarray, shape (n + 1,)
        Where each light's rays begin in the flat arrays.
    nearest, across2 : Field, shape (rays of all lights,)
        b and h² of each ray, in units; row by row.
    cones : mapping of int to ConeRays
        Of the spot lights, by their place here.
    boxes : ndarray, shape (n, D, 4)
        First and last + 1 row and column that the light reaches in each slice; all 0 where none.
    close : ndarray, shape (n, D, 4)
        The same for distances below the lower bound on d².
    smallest : ndarray, shape (n,), float64
        The lower bound on d², in units².
    """

    numbers: NDArray[np.intp]
    units: NDArray[np.float64]
    windowed: NDArray[np.bool_]
    intensity: NDArray[np.float64]
    windows: Boxes
    starts: NDArray[np.intp]
    nearest: Field
    across2: Field
    cones: Mapping[int, ConeRays]
    boxes: Boxes
    close: Boxes
    smallest: NDArray[np.float64]

    def window(self, k: int) -> tuple[Field, Field]:
        """b and h² of the rays of the k-th light, as images of its window."""
        top, bottom, left, right = self.windows[k].tolist()
        span = slice(int(self.starts[k]), int(self.starts[k + 1]))
        shape = bottom - top, right - left
        return self.nearest[span].reshape(shape), self.across2[span].reshape(shape)


def light_rays(lights: Mapping[int, PointLight], froxels: Froxels, *, attenuation: str = "min_distance",
               restrict: bool = True) -> LightRays:
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
    LightRays
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
    >>> rays = light_rays({5: lamp}, froxels)
    >>> nearest, across2 = rays.window(0)
    >>> float(nearest[0, 1]), float(across2[0, 1]) < 1e-20, float(rays.intensity[0, 0])
    (2.0, True, 1.0)
    """
    with np.errstate(over="ignore"):  # sizes beyond all numbers are cut to the largest one
        boxes = _reached(list(lights.values()), froxels, restrict)
        kept: NDArray[np.bool_] = np.any(boxes, axis=(1, 2))
        boxes = boxes[kept]
        chosen = [light for light, keep in zip(lights.values(), kept.tolist(), strict=True) if keep]
        q = np.array([light.position for light in chosen]).reshape(-1, 3) - froxels.rays.origin
        windowed = np.array([light.falloff == "windowed" for light in chosen], bool)
        radii = np.maximum([light.radius for light in chosen], TINIEST)
        # Without a window any unit does that is not a radius; this one keeps the squares of everything small.
        units = np.where(windowed, radii, np.maximum(1.0, np.hypot.reduce(q, axis=1)) * (1.0 + 2.0**-20))
        windows = _windows(boxes)
        sizes = (windows[:, 1] - windows[:, 0]) * (windows[:, 3] - windows[:, 2])
        starts = np.concatenate([[0], np.cumsum(sizes)]).astype(np.intp)
        nearest, across2 = np.empty((2, int(starts[-1])), froxels.depths.dtype)
        smallest = np.array([smallest_d2(light, attenuation) for light in chosen])
        colours = np.array([colour(light) for light in chosen]).reshape(-1, 3)
        per_unit = colours / units[:, np.newaxis] / units[:, np.newaxis]
        result = LightRays(np.array(list(lights), np.intp)[kept], units, windowed, per_unit, windows, starts,
                           nearest, across2, {}, boxes, boxes, smallest / units / units)
        cones, closest = _relate(result, chosen, q / units[:, np.newaxis], froxels)
        if restrict:
            near = np.flatnonzero(~(closest * units * units > 2.0 * smallest))
            close = np.zeros_like(boxes)
            if near.size:
                close[near] = slice_boxes(froxels, [chosen[k].position for k in near], np.sqrt(smallest[near]))
            result = result._replace(close=close)
    return result._replace(cones=cones)


def _windows(boxes: Boxes) -> Boxes:
    """The rows and columns that hold all of each light's boxes."""
    filled = boxes[..., 1] > 0
    first = np.where(filled[..., np.newaxis], boxes[..., ::2], np.iinfo(np.intp).max).min(axis=1)
    last = boxes[..., 1::2].max(axis=1)
    return np.stack([first[:, 0], last[:, 0], first[:, 1], last[:, 1]], axis=1)


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
        if isinstance(light, SpotLight):
            corners = cone_corners(light, froxels.depths.dtype)
            # The corners of a pyramid that is long beyond all measure say nothing.
            if len(corners) and light.radius <= 1e3 * float(froxels.depths[-1, 0, 0]):
                boxes[k] = _cut(boxes[k], _corner_boxes(corners, froxels))
    if restrict:
        # NumPy's loops run along x, and along whole rows in one go: what that saves pays for a few columns.
        few = COLUMNS // froxels.depths.itemsize
        boxes[..., 2:][(boxes[..., 3] - boxes[..., 2] >= columns - few) & (boxes[..., 1] > 0)] = 0, columns
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


def _relate(rays: LightRays, lights: list[PointLight], q: NDArray[np.float64],
            froxels: Froxels) -> tuple[dict[int, ConeRays], NDArray[np.float64]]:
    """Fill ``nearest`` and ``across2``; the cones, and each light's least h². ``q`` is in units."""
    px, py, pz = (c.astype(np.float64) for c in froxels.rays.per_depth)
    per_length = 1.0 / np.sqrt(dot((px, py, pz), (px, py, pz)))
    whole = [np.broadcast_to(c, froxels.rays.length.shape) for c in (px, py, pz, per_length)]
    cones: dict[int, ConeRays] = {}
    closest = np.empty(len(lights))
    # A ray through the light itself, and a light too far away to measure in its radii: the window's fourth
    # power of the distance must stay a number.
    limits, farthest = np.finfo(rays.nearest.dtype), farthest_distance(rays.nearest.dtype)
    least = np.maximum((CLOSEST * np.array([light.min_distance for light in lights]) / rays.units) ** 2,
                       1e4 * float(limits.tiny))

    for group in _groups(rays.starts):  # calls too short to share them out to threads
        counts = np.diff(rays.starts[group.start:group.stop + 1])
        begin, end = int(rays.starts[group.start]), int(rays.starts[group.stop])
        part = np.empty((4, end - begin))
        for k in range(group.start, group.stop):
            top, bottom, left, right = rays.windows[k].tolist()
            span = part[:, int(rays.starts[k]) - begin:int(rays.starts[k + 1]) - begin]
            for values, image in zip(span, whole, strict=True):
                values.reshape(bottom - top, right - left)[...] = image[top:bottom, left:right]
        # One light alone is three numbers, several are told apart ray by ray.
        several = len(counts) > 1
        b, h2 = _along_and_across(part, np.repeat(q[group].T, counts, axis=1) if several else q[group.start])
        # Lights too far ahead to measure, and those a radius and more behind the camera, are in nobody's reach: they
        # are put where no froxel can seem to be (`froxel_ref.lamps.relate_lamps`).
        unreached = (b > farthest) | (b < -2.0)
        if not rays.windowed[group].all():
            unreached &= np.repeat(rays.windowed[group], counts)
        np.copyto(b, 2.0 * farthest, where=unreached)
        np.clip(h2, np.repeat(least[group], counts) if several else least[group.start], farthest * farthest, out=h2)
        rays.nearest[begin:end], rays.across2[begin:end] = b, h2
        closest[group] = np.minimum.reduceat(h2, rays.starts[group] - begin)
        for k in range(group.start, group.stop):
            light, own = lights[k], slice(int(rays.starts[k]) - begin, int(rays.starts[k + 1]) - begin)
            if isinstance(light, SpotLight):
                cones[k] = _cone_rays(light, part[:, own], b[own], q[k], rays, k)
    return cones, closest


def _groups(starts: NDArray[np.intp]) -> list[slice]:
    """Lights whose rays together fill a block."""
    ends = np.unique(np.searchsorted(starts, np.arange(RAYS, int(starts[-1]) + RAYS, RAYS)))
    ends = np.unique(np.minimum(ends, len(starts) - 1)).tolist()
    return [slice(a, b) for a, b in zip([0, *ends], ends, strict=False) if a < b]


def _along_and_across(part: NDArray[np.float64], q: NDArray[np.float64]) -> tuple[Field, Field]:
    """b and h² of rays px, py, pz, 1/|p|."""
    (px, py, pz, per_length), (qx, qy, qz) = part, q
    b, h2, a, c = qx * px, np.zeros_like(px), np.empty_like(px), np.empty_like(px)
    b += np.multiply(qy, py, out=a)
    b += np.multiply(qz, pz, out=a)
    b *= per_length
    for (q0, p0), (q1, p1) in (((qy, pz), (qz, py)), ((qz, px), (qx, pz)), ((qx, py), (qy, px))):
        np.multiply(q0, p0, out=a)
        a -= np.multiply(q1, p1, out=c)
        h2 += np.multiply(a, a, out=a)
    h2 *= np.multiply(per_length, per_length, out=a)
    return b, h2


def _cone_rays(light: SpotLight, part: NDArray[np.float64], b: Field, q: NDArray[np.float64], rays: LightRays,
               k: int) -> ConeRays:
    """A spot light's cone along the rays of its window."""
    (px, py, pz, per_length), dtype = part, rays.nearest.dtype
    top, bottom, left, right = rays.windows[k].tolist()
    scale, offset = spot_cone(light)
    ax, ay, az = (scale * c for c in unit(light.direction))
    slope = (ax * px + ay * py + az * pz) * per_length
    start = b * slope - (ax * q[0] + ay * q[1] + az * q[2])
    slope, start = (c.astype(dtype).reshape(bottom - top, right - left) for c in (slope, start))
    return ConeRays(slope, start, offset)


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


def rects(boxes: Boxes, z: slice, y: slice) -> Boxes:
    """The part of a block that each light's boxes cover, as ranges in the grid.

    Parameters
    ----------
    boxes : ndarray, shape (n, D, 4)
        As from `slice_boxes`.
    z, y : slice
        The block's slices and rows.

    Returns
    -------
    ndarray, shape (n, 6)
        First and last + 1 along z, y and x; all 0 where the boxes miss the block.

    Examples
    --------
    >>> rects(np.array([[[0, 0, 0, 0], [2, 6, 3, 5]]]), slice(0, 2), slice(4, 8)).tolist()
    [[1, 2, 4, 6, 3, 5]]
    """
    part = boxes[:, z]
    filled = (np.minimum(part[..., 1], y.stop) > np.maximum(part[..., 0], y.start)) & (part[..., 3] > part[..., 2])
    result = np.empty((len(boxes), 6), np.intp)
    result[:, 0] = z.start + np.argmax(filled, axis=1)
    result[:, 1] = z.stop - np.argmax(filled[:, ::-1], axis=1)
    result[:, 2::2] = np.where(filled[..., np.newaxis], part[..., ::2], np.iinfo(np.intp).max).min(axis=1)
    result[:, 3::2] = np.where(filled[..., np.newaxis], part[..., 1::2], 0).max(axis=1)
    np.clip(result[:, 2:4], y.start, y.stop, out=result[:, 2:4])
    result[~filled.any(axis=1)] = 0
    return result


def _corner_boxes(corners: NDArray[np.float64], froxels: Froxels) -> Boxes:
    """Slice by slice bounds of the hull of some points, the same in each slice that it meets."""
    z, y, x = corner_bounds(froxels, corners)
    boxes = np.zeros((froxels.depths.shape[0], 4), np.intp)
    boxes[z] = y.start, y.stop, x.start, x.stop
    return boxes


def _cut(boxes: Boxes, others: Boxes) -> Boxes:
    """What lies in both."""
    result = np.where(np.arange(4) % 2 == 0, np.maximum(boxes, others), np.minimum(boxes, others))
    result[(result[:, 0] >= result[:, 1]) | (result[:, 2] >= result[:, 3])] = 0
    return result
