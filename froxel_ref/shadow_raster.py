"""Exact depth of the first surface along the rays of a light: what shadow maps are made of.

A raster is any plane image of rays: from one point (a face of a cube, a spot light's image, a side of an
octahedron) or parallel. Along its rows and columns everything that bounds a plane or a box is linear in
**nearness** v, which is 1/t for rays from a point and −t for parallel ones: planes cost a sum of a column and
a row, boxes the least and the greatest of six. `froxel_ref.triangle_raster` draws height fields and meshes.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import DTypeLike, NDArray

from froxel_ref.arrays import Field
from froxel_ref.geometry import CUBE, Matrix
from froxel_ref.light_raster import LightRaster, inverse_rows, project, raster_rays, windows
from froxel_ref.primitives import Facets
from froxel_ref.scene import Box, HeightField, Plane, Sphere, Surface
from froxel_ref.triangle_raster import raster_triangles

if TYPE_CHECKING:
    from froxel_ref.assets import Assets

__all__ = ["Caster", "LightRaster", "casters", "raster_depth", "raster_rays"]

Window: TypeAlias = tuple[slice, slice]

# Of the terms of a difference, what rounding leaves of it: a light as near to a face as that lies in it.
SLACK = 4.0 * float(np.finfo(np.float64).eps)
# Texels in a block: four operands of this size fit the cache of a core.
BLOCK = 32768


# --- making ready -----------------------------------------------------------------------------------


class Caster(NamedTuple):
    """A surface made ready to cast shadows into any raster.

    Attributes
    ----------
    surface : Surface
        The record.
    hull : ndarray, shape (8, 3), or None [m]
        Points whose convex hull holds it; None for planes.
    local_from_world : ndarray, shape (3, 3), or None
        Of a box, without its translation.
    vertices : ndarray, shape (n, 3), or None [m]
        Of a height field or a mesh, in the world.
    faces : ndarray of int, shape (m, 3), or None
        Vertices of each of its triangles.
    """

    surface: Surface
    hull: Matrix | None = None
    local_from_world: Matrix | None = None
    vertices: Matrix | None = None
    faces: Facets | None = None


def casters(surfaces: Sequence[Surface], assets: Assets) -> tuple[Caster, ...]:
    """Make surfaces ready to be rastered, once for all rasters.

    Parameters
    ----------
    surfaces : sequence of Plane, Box, Sphere, HeightField, Mesh
        In any order.
    assets : Assets
        Height fields and meshes by their records; may be None where there are none.

    Returns
    -------
    tuple of Caster
        One for each surface.

    Examples
    --------
    >>> ready, = casters([Sphere(radius=2)], None)
    >>> ready.hull.min(), ready.hull.max()
    (np.float64(-2.0), np.float64(2.0))
    """
    return tuple(_ready(surface, assets) for surface in surfaces)


def _ready(surface: Surface, assets: Assets) -> Caster:
    if isinstance(surface, Plane):
        return Caster(surface)
    if isinstance(surface, Sphere):
        return Caster(surface, surface.center + surface.radius * CUBE)
    pose = surface.transform.world_from_local
    if isinstance(surface, Box):
        return Caster(surface, _placed(pose, CUBE), inverse_rows(pose[:3, :3].T))
    if isinstance(surface, HeightField):
        heights = np.asarray(assets.heights[surface.heights], np.float64)
        vertices, faces = _grid(heights), _grid_faces(*heights.shape)
    else:
        vertices, faces = assets.meshes[surface]
    low, high = vertices[faces].min(axis=(0, 1)), vertices[faces].max(axis=(0, 1))
    return Caster(surface, _placed(pose, np.where(CUBE > 0.0, high, low)), None, _placed(pose, vertices), faces)


def _grid(heights: Matrix) -> Matrix:
    """The vertices of a height field in its local space, row by row."""
    y, x = (np.linspace(-1.0, 1.0, count) for count in heights.shape)
    return np.stack([*np.meshgrid(x, y), heights], axis=-1).reshape(-1, 3)


def _grid_faces(rows: int, columns: int) -> Facets:
    """Two triangles a cell, along the diagonal from the lowest to the highest (x, y)."""
    low = (np.arange(rows - 1)[:, np.newaxis] * columns + np.arange(columns - 1)).reshape(-1)
    right, up, high = low + 1, low + columns, low + columns + 1
    return np.stack([low, right, high, low, high, up], axis=1).reshape(-1, 3)


def _placed(pose: Matrix, points: NDArray[Any]) -> Matrix:
    """Points in the world. Without a matrix product: a vertex that a file repeats must not change a bit."""
    x, y, z = np.asarray(points, np.float64).T
    return np.stack([row[0] * x + row[1] * y + row[2] * z + row[3] for row in pose[:3]], axis=1)


# --- all surfaces -----------------------------------------------------------------------------------


def raster_depth(casting: Sequence[Caster], raster: LightRaster, *, dtype: DTypeLike = np.float64,
                 restrict: bool = True, out: Field | None = None) -> Field:
    """Find how far the rays of a light reach.

    Parameters
    ----------
    casting : sequence of Caster
        From `casters`.
    raster : LightRaster
        The rays.
    dtype : data type
        Of the result, which is rounded once; unless ``out`` is given.
    restrict : bool
        Test each surface only within the rectangle of texels that it can touch. The result is the same
        without.
    out : Field, shape (rows, columns), optional
        Where to write it.

    Returns
    -------
    Field, shape (rows, columns)
        The ray's parameter t at the first hit, +inf where nothing is hit; never NaN. A point of a texel's
        ray is in the dark if its t is greater.

    Raises
    ------
    ValueError
        ``out`` has another shape, or the raster's vectors do not span the space.

    Notes
    -----
    As `froxel_ref.visibility.exact_visibility`: planes, height fields and meshes are sheets with two sides;
    boxes and spheres are solid, so a light within one sees t = 0 everywhere. A light in a plane, or a ray
    along it, does not meet it; one on the wall of a box or a sphere lights what lies outside. Wherever a
    difference of coordinates is within 4 roundings of its terms, or the sine between a ray and a face within
    4 roundings of 1, it counts as 0.

    Errors: some ulp of t for planes and boxes away from grazing rays, see the primitives for spheres and
    `froxel_ref.triangle_raster.raster_triangles` for the rest. Along parallel rays, of the greater of t and
    the distances from ``base``.

    Measured: 58 rasters of 1024² of the scene thesis-hall, the cube faces of its nine lamps and four of a
    sun, 0.6 s on one core of a server and 0.45 s on two; 69,451 triangles into one raster of 1024², 0.4 s.

    Examples
    --------
    >>> x, y, z = np.eye(3)
    >>> down = LightRaster(-z - 0.1 * x - 0.1 * y, 0.1 * x, 0.1 * y, 5 * z, None, 2, 2)
    >>> raster_depth(casters([Box()], None), down).tolist()
    [[4.0, 4.0], [4.0, 4.0]]
    """
    shape = (raster.rows, raster.columns)
    result = np.empty(shape, dtype) if out is None else out
    if result.shape != shape:
        raise ValueError(f"out has the shape {result.shape}, must have the raster's {shape}")
    usable = result.dtype == np.float64 and result.flags.c_contiguous
    depth = np.asarray(result, np.float64) if usable else np.empty(shape)
    areas = _areas(casting, raster, restrict)
    with np.errstate(divide="ignore", over="ignore"):
        _enter_solids(depth, casting, areas, raster)
        for caster, (y, x) in zip(casting, areas, strict=True):
            if caster.vertices is not None and caster.faces is not None and y.start < y.stop and x.start < x.stop:
                raster_triangles(depth, project(raster, caster.vertices), caster.faces,
                                 forward=raster.direction is None, restrict=restrict)
        if not usable:
            result[...] = depth
    return result


def _areas(casting: Sequence[Caster], raster: LightRaster, restrict: bool) -> list[Window]:
    """The rectangle of texels that each surface can touch."""
    areas = [(slice(0, raster.rows), slice(0, raster.columns))] * len(casting)
    bounded = [k for k, caster in enumerate(casting) if caster.hull is not None]
    if restrict and bounded:
        hulls = np.stack([hull for caster in casting if (hull := caster.hull) is not None], axis=1)
        found = windows(project(raster, hulls), raster.rows, raster.columns)
        for k, (top, bottom, left, right) in zip(bounded, found.T.tolist(), strict=True):
            areas[k] = slice(top, bottom), slice(left, right)
    return areas


def _enter_solids(image: Matrix, casting: Sequence[Caster], areas: list[Window], raster: LightRaster) -> None:
    """Planes, boxes and spheres: collected as the greatest nearness, left as the least t."""
    parallel = raster.direction is not None
    image.fill(-np.inf if parallel else 0.0)
    for caster, (y, x) in zip(casting, areas, strict=True):
        if caster.vertices is not None or y.start >= y.stop or x.start >= x.stop:
            continue
        part, place = image[y, x], _Texels(np.arange(y.start, y.stop) + 0.5, np.arange(x.start, x.stop) + 0.5)
        if isinstance(caster.surface, Plane):
            _enter_plane(part, place, caster.surface, raster)
        elif isinstance(caster.surface, Sphere):
            _enter_sphere(part, place, caster.surface, raster)
        elif isinstance(caster.surface, Box) and caster.local_from_world is not None:
            _enter_box(part, place, caster.surface, caster.local_from_world, raster)
    if parallel:
        np.subtract(0.0, image, out=image)  # no negative zeros
    else:
        np.divide(1.0, image, out=image)


# --- linear functions of a texel --------------------------------------------------------------------


class _Texels(NamedTuple):
    """The centres of a rectangle of texels."""

    y: Field  # (rows,)
    x: Field  # (columns,)

    def blocks(self) -> list[slice]:
        """Ranges of rows that fit the cache."""
        step = max(1, BLOCK // len(self.x))
        return [slice(k, min(k + step, len(self.y))) for k in range(0, len(self.y), step)]


class _Extreme:
    """The least or the greatest of linear functions c + a·x + b·y, each given as (c, a, b).

    Those along one axis are settled among themselves beforehand. The value at a texel does not depend on the
    rectangle that it is asked for in.
    """

    def __init__(self, pick: np.ufunc, functions: Sequence[Any], texels: _Texels) -> None:
        least = -np.inf if pick is np.maximum else np.inf
        row, column = np.full(len(texels.x), least), np.full((len(texels.y), 1), least)
        self.pick = pick
        self.terms: list[tuple[np.ufunc, Field, Field]] = []
        straight = False
        for c, a, b in functions:
            if a != 0.0 and b != 0.0:
                self.terms.append((np.add, (b * texels.y)[:, np.newaxis], c + a * texels.x))
                continue
            straight = True
            if b == 0.0:
                pick(row, c + a * texels.x, out=row)
            else:
                pick(column, c + (b * texels.y)[:, np.newaxis], out=column)
        if straight:
            self.terms.insert(0, (pick, column, row))

    def over(self, rows: slice, out: Matrix, spare: Matrix) -> Matrix:
        """Its values on some rows."""
        for k, (join, column, row) in enumerate(self.terms):
            join(column[rows], row, out=spare if k else out)
            if k:
                self.pick(out, spare, out=out)
        return out


def _functions(vectors: Matrix, raster: LightRaster) -> Matrix:
    """For each row n the function n·p(x, y), as (c, a, b)."""
    return np.stack([vectors @ raster.base, vectors @ raster.across, vectors @ raster.down], axis=-1)


# --- planes and boxes -------------------------------------------------------------------------------


def _enter_plane(image: Matrix, texels: _Texels, plane: Plane, raster: LightRaster) -> None:
    """n·(o + t·p − point) = 0: 1/t = n·p/n·(point − o); or n·(p + t·d − point) = 0: −t = n·(p − point)/n·d."""
    normal = np.asarray(plane.normal) / np.max(np.abs(plane.normal))
    point, function = np.asarray(plane.point), _functions(normal, raster)
    if raster.origin is not None:
        slope = float(normal @ (point - raster.origin))
        terms = float(np.abs(normal) @ (np.abs(point) + np.abs(raster.origin)))
    else:
        assert raster.direction is not None
        slope = float(normal @ raster.direction)
        terms = math.sqrt(float((normal @ normal) * (raster.direction @ raster.direction)))
        function[0] = normal @ (raster.base - point)
    if abs(slope) <= SLACK * terms:
        return
    nearness = _Extreme(np.maximum, [function / slope], texels)
    for rows in texels.blocks():
        out = np.empty((rows.stop - rows.start, len(texels.x)))
        np.maximum(image[rows], nearness.over(rows, out, out), out=image[rows])


def _enter_box(image: Matrix, texels: _Texels, box: Box, inverse: Matrix, raster: LightRaster) -> None:
    """A box is where v·g ≥ f(x, y) for six faces: from below v where g > 0, from above where g < 0."""
    above, below, held = _faces(box, inverse, raster)
    parallel = raster.direction is not None
    if not above and not held:
        image.fill(np.inf)
        return
    # From a point, what lies behind the light has a nearness below 0, which the image never takes.
    nothing = -np.inf if parallel else 0.0
    upper, lower = _Extreme(np.minimum, above or [(np.inf, 0.0, 0.0)], texels), _Extreme(np.maximum, below, texels)
    holding = [_Extreme(np.maximum, [function], texels) for function in held]
    shape = (texels.blocks()[0].stop, len(texels.x))
    first, second, third, missed = np.empty(shape), np.empty(shape), np.empty(shape), np.empty(shape, bool)
    for rows in texels.blocks():
        count = rows.stop - rows.start
        miss, spare = missed[:count], third[:count]
        enter, leave = upper.over(rows, first[:count], spare), lower.over(rows, second[:count], spare)
        np.copyto(enter, nothing, where=np.greater_equal(leave, enter, out=miss))
        for limit in holding:
            np.copyto(enter, nothing, where=np.greater(limit.over(rows, leave, spare), 0.0, out=miss))
        np.maximum(image[rows], enter, out=image[rows])


def _faces(box: Box, inverse: Matrix, raster: LightRaster) -> tuple[list[Any], list[Any], list[Any]]:
    """A box's bounds of the nearness from above and from below, and functions that must not be above 0.

    Within the face s = ±1 of a local axis: s·(o + t·d) ≤ 1. From a point o is a number and d linear in the
    texel, so v·(1 − s·o) ≥ s·d; along parallel rays d is a number, so v·(s·d) ≥ s·o − 1.
    """
    center, function = np.asarray(box.transform.world_from_local[:3, 3]), _functions(inverse, raster)
    above: list[Any] = []
    below: list[Any] = []
    held: list[Any] = []
    if raster.origin is not None:
        number = inverse @ (raster.origin - center)
        slack = SLACK * (1.0 + np.abs(inverse) @ (np.abs(raster.origin) + np.abs(center)))
    else:
        assert raster.direction is not None
        number = inverse @ raster.direction
        slack = SLACK * np.sqrt((inverse * inverse).sum(axis=1) * (raster.direction @ raster.direction))
        function[:, 0] = inverse @ (raster.base - center)
    for k, s in itertools.product(range(3), (-1.0, 1.0)):
        if raster.origin is not None:
            g, f = 1.0 - s * float(number[k]), s * function[k]
        else:
            g, f = s * float(number[k]), s * function[k] - (1.0, 0.0, 0.0)
        if abs(g) <= slack[k]:
            held.append(f)
        else:
            (below if g > 0.0 else above).append(f / g)
    return above, below, held


# --- spheres ----------------------------------------------------------------------------------------


def _enter_sphere(image: Matrix, texels: _Texels, sphere: Sphere, raster: LightRaster) -> None:
    """v = (b + √s)/c with s = r²·a − |q × D|², a = D·D; c = |q|² − r², b = q·D from a point q away, else c = a."""
    center, r = np.asarray(sphere.center), sphere.radius
    start = raster.base if raster.origin is None else raster.origin
    q = center - start if raster.direction is None else start - center
    distance = math.sqrt(float(q @ q))
    slack = SLACK * (distance + r + float(np.abs(center).max() + np.abs(start).max()))
    if raster.direction is None:
        slope, across, length = _functions(q, raster), _functions(_cross_rows(q), raster), _functions(np.eye(3), raster)
        c = (distance - r) * (distance + r) if abs(distance - r) > slack else 0.0
        if c < 0.0:
            image.fill(np.inf)
            return
    else:
        d = raster.direction
        slope, across = _functions(d, raster), _functions(-_cross_rows(d), raster)
        slope[0], across[:, 0] = d @ q, -_cross_rows(d) @ q
        length, c = np.zeros((0, 3)), float(d @ d)
    for rows in texels.blocks():
        along, *moments = (function[0] + function[1] * texels.x + (function[2] * texels.y[rows])[:, np.newaxis]
                           for function in (slope, *across, *length))
        a = sum((m * m for m in moments[3:]), start=np.zeros(())) if len(length) else np.asarray(c)
        s = r * r * a - (moments[0] * moments[0] + moments[1] * moments[1] + moments[2] * moments[2])
        met = (s > 0.0) & (along > 0.0) if raster.direction is None else s > 0.0
        v = (along + np.sqrt(np.maximum(s, 0.0))) / c if c > 0.0 else np.full(s.shape, np.inf)
        np.maximum(image[rows], np.where(met, v, -np.inf), out=image[rows])


def _cross_rows(q: Matrix) -> Matrix:
    """The matrix whose product with D is q × D."""
    x, y, z = q.tolist()
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
