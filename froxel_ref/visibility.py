"""Exact opaque visibility: where along rays a light is hidden, and whether it is seen from points.

The shadow of a convex body is convex, so on a ray it is one stretch. For planes, boxes and spheres its ends
are found in closed form; for height fields and meshes by casting rays within the stretch of their bounding
box, and bisection.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from froxel_ref.arrays import Points, Visibility
from froxel_ref.compensated import DoubleDouble, cross, dot, double_double, where
from froxel_ref.geometry import Lines, Rays
from froxel_ref.lights import unit
from froxel_ref.scene import Box, DirectionalLight, HeightField, Light, Plane, Sphere, Surface
from froxel_ref.triangles import hit_mesh, mesh_caster, walk_height_field

if TYPE_CHECKING:
    from froxel_ref.assets import Assets

__all__ = ["Occluder", "dark_spans", "exact_visibility", "occluders"]

Array: TypeAlias = NDArray[np.floating[Any]]
Mask: TypeAlias = NDArray[np.bool_]
Cast: TypeAlias = Callable[[Array, Array, bool], Mask]

# Points at which surfaces of triangles are cast at first within their bounds' shadow; a shadow or a gap
# between two of them that is narrower can be missed. Then halvings of each change.
CASTS, HALVINGS = 65, 44
PLANAR = 4.0 * float(np.finfo(np.float64).eps)  # of its terms, the height of a light over a plane that it lies in
SLACK = 1e-12  # of the coordinates, when corners of a shadow's cross-section are told from points outside
NEAR = 1e-7    # share of the way to a light within which a surface does not hide itself


class Occluder(NamedTuple):
    """A surface made ready to cast shadows.

    Attributes
    ----------
    surface : Surface
        The record.
    local_from_world : ndarray, shape (4, 4), or None
        Into the cube [−1, 1]³ that is the box, or bounds a height field or a mesh.
    cast : callable or None
        For height fields and meshes: from points (3, k) along ways (3, k), whether something lies in
        between; on to infinity if the flag is set.
    """

    surface: Surface
    local_from_world: Array | None
    cast: Cast | None = None


def occluders(surfaces: Sequence[Surface], assets: Assets) -> tuple[Occluder, ...]:
    """Make surfaces ready to cast shadows.

    Parameters
    ----------
    surfaces : sequence of Plane, Box, Sphere, HeightField, Mesh
    assets : Assets
        Height fields and meshes by their records.

    Returns
    -------
    tuple of Occluder

    Raises
    ------
    InputError
        A mesh without Embree installed.
    """
    result = []
    for surface in surfaces:
        if isinstance(surface, Plane | Sphere):
            result.append(Occluder(surface, None))
        elif isinstance(surface, Box):
            result.append(Occluder(surface, np.linalg.inv(surface.transform.world_from_local)))
        elif isinstance(surface, HeightField):
            result.append(_height_field(surface, assets.heights[surface.heights]))
        else:
            vertices, faces = assets.meshes[surface]
            pose = surface.transform.world_from_local
            placed = np.asarray(vertices) @ pose[:3, :3].T + pose[:3, 3]
            result.append(_mesh(surface, placed, faces))
    return tuple(result)


def _bounds(low: Array, high: Array) -> Array:
    """The matrix from a box to [−1, 1]³; a flat box gets a thickness."""
    half = np.maximum(0.5 * (high - low), 1e-9 * (1.0 + np.abs(high).max()))
    result = np.eye(4)
    result[:3, :3] = np.diag(1.0 / half)
    result[:3, 3] = -0.5 * (high + low) / half
    return result


def _height_field(surface: HeightField, heights: NDArray[Any]) -> Occluder:
    local = np.linalg.inv(surface.transform.world_from_local)
    inner = _bounds(np.array([-1.0, -1.0, heights.min()]), np.array([1.0, 1.0, heights.max()]))

    def cast(points: Array, ways: Array, endless: bool) -> Mask:
        origin = local[:3, :3] @ points + local[:3, 3:]
        direction = local[:3, :3] @ ways
        low, high = _slabs(inner[:3, :3] @ origin + inner[:3, 3:], inner[:3, :3] @ direction)
        low, high = np.maximum(low, NEAR), high if endless else np.minimum(high, 1.0)
        blocked = np.zeros(low.shape, bool)
        live = np.flatnonzero(low < high)
        if live.size:
            which, _, _ = walk_height_field(origin[:, live], direction[:, live],
                                            np.stack([low[live], high[live]]), heights)
            blocked[live[which]] = True
        return blocked

    return Occluder(surface, inner @ local, cast)


def _mesh(surface: Any, placed: Array, faces: NDArray[Any]) -> Occluder:
    triangles, caster = placed[faces], mesh_caster(np.asarray(placed, np.float64), faces)
    bounds = _bounds(triangles.min(axis=(0, 1)), triangles.max(axis=(0, 1)))

    def cast(points: Array, ways: Array, endless: bool) -> Mask:
        if endless:
            start = points + 1e-5 * ways
            return np.asarray(caster(start.T, np.broadcast_to(ways, points.shape).T) >= 0)
        # From the light, which all ways end at, to the points: the first thing met lies in between or not.
        light = points[:, 0] + ways[:, 0]
        x, y, z = (-w[np.newaxis] for w in ways)
        place = (float(light[0]), float(light[1]), float(light[2]))
        back = Rays(place, (x, y, z), np.ones((1, ways.shape[1])))
        return np.asarray(hit_mesh(back, triangles, caster)[0][0] < 1.0 - 1e-5)

    return Occluder(surface, bounds, cast)


# --- shadows along rays -----------------------------------------------------------------------------


def dark_spans(occluding: Sequence[Occluder], lines: Lines, light: Light) -> Array:
    """Where along lines a light is hidden.

    Parameters
    ----------
    occluding : sequence of Occluder
        From `occluders`.
    lines : Lines
        With directions of length 1.
    light : Light
        Any light.

    Returns
    -------
    ndarray, shape (n, M, 2) [m]
        Ends of the dark stretches that overlap the lines' own; NaN where there is none. They may overlap.

    Notes
    -----
    For a box: points L + w·(o − L) + v·d with 0 ≤ w ≤ 1 are those between the light at L and the ray's
    point at t = v/w. Those in the box form a polygon in (v, w) with at most 8 sides, and the least and
    largest t are at its corners. For a sun likewise with o + t·d + s·L, s ≥ 0. Exact but for rounding.

    Height fields and meshes: 65 points of the stretch that their bounding box darkens are cast, changes
    found to 2⁻⁴⁴ of their distance. Detail between two points can be missed, and no estimate tells.

    Examples
    --------
    >>> origin, direction = np.array([[-4.0], [-4.0], [0.0]]), np.array([[1.0], [0.0], [0.0]])
    >>> ray, box = Lines(origin, direction, np.zeros(1), np.array([9.0])), Occluder(Box(), np.eye(4))
    >>> sun = DirectionalLight(direction=(0, 1, 0), irradiance=(1, 1, 1))
    >>> dark_spans([box], ray, sun).round(9).tolist()
    [[[3.0, 5.0]]]
    """
    spans = []
    boxed = [occluder for occluder in occluding if occluder.local_from_world is not None]
    if boxed:
        matrices = np.stack([np.asarray(occluder.local_from_world) for occluder in boxed])
        low, high = _box_spans(matrices, lines, light)
        for k, occluder in enumerate(boxed):
            if occluder.cast is None:
                spans.append(np.stack([low[:, k], high[:, k]], axis=1)[:, np.newaxis])
            else:
                spans.append(_cast_spans(occluder.cast, lines, light, low[:, k], high[:, k]))
    for occluder in occluding:
        if isinstance(occluder.surface, Plane):
            spans.append(_plane_spans(occluder.surface, lines, light))
        elif isinstance(occluder.surface, Sphere):
            spans.append(_sphere_spans(occluder.surface, lines, light))
    if not spans:
        return np.zeros((lines.start.size, 0, 2))
    whole = np.concatenate(spans, axis=1)
    dark = (whole[..., 0] < whole[..., 1]) & (whole[..., 1] > lines.start[:, np.newaxis]) & (
        whole[..., 0] < lines.stop[:, np.newaxis])
    result: Array = np.where(dark[..., np.newaxis], whole, np.nan)[:, dark.any(axis=0)]
    return result


def _towards(light: Light) -> tuple[Array, bool]:
    """A sun's direction, or a lamp's position, and which it is."""
    if isinstance(light, DirectionalLight):
        return np.asarray(unit(light.direction)), True
    return np.asarray(light.position, np.float64), False


def _box_spans(matrices: Array, lines: Lines, light: Light) -> tuple[Array, Array]:
    """The shadow of each box, shapes (n, boxes); low > high where there is none."""
    linear, shift = matrices[:, :, :3], matrices[:, :, 3]
    origin = np.einsum("kij,jn->ink", linear, lines.origin) + shift.T[:, np.newaxis]
    a = np.einsum("kij,jn->ink", linear, lines.direction)
    towards, sun = _towards(light)
    if sun:
        b = np.broadcast_to((linear @ towards).T[:, np.newaxis], a.shape)
        return _polygon_range(a, b, -1.0 - origin, 1.0 - origin, ratio=False)
    place = (linear @ towards + shift).T[:, np.newaxis]
    place = np.broadcast_to(place, a.shape)
    low, high = _polygon_range(a, origin - place, -1.0 - place, 1.0 - place, ratio=True)
    within = (np.abs(place) <= 1.0).all(axis=0)
    return np.where(within, -np.inf, low), np.where(within, np.inf, high)


def _polygon_range(a: Array, b: Array, low: Array, high: Array, *, ratio: bool) -> tuple[Array, Array]:
    """Least and largest x (or x/y) over low ≤ a·x + b·y ≤ high, y ≥ 0 (and y ≤ 1), at the corners."""
    least, most = np.full(a.shape[1:], np.inf), np.full(a.shape[1:], -np.inf)
    size = np.abs(low) + np.abs(high)

    def take(x: Array, y: Array, free: Sequence[int], bounded: bool) -> None:
        inside = np.isfinite(x) & np.isfinite(y)
        if bounded:
            inside &= (y >= -SLACK) & ((y <= 1.0 + SLACK) if ratio else True)
        for k in free:
            along, across = a[k] * x, b[k] * y
            slack = SLACK * (size[k] + np.abs(along) + np.abs(across))
            inside &= (along + across >= low[k] - slack) & (along + across <= high[k] + slack)
        value = np.where(y > 0.0, x / y, np.copysign(np.inf, x)) if ratio else x
        np.minimum(least, np.where(inside, value, np.inf), out=least)
        np.maximum(most, np.where(inside, value, -np.inf), out=most)

    with np.errstate(all="ignore"):
        for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
            over = 1.0 / (a[i] * b[j] - a[j] * b[i])
            for ci in (low[i], high[i]):
                for cj in (low[j], high[j]):
                    take((ci * b[j] - cj * b[i]) * over, (a[i] * cj - a[j] * ci) * over, (k,), True)
            for ci in (low[i], high[i]):
                for y in (0.0, 1.0) if ratio else (0.0,):
                    take((ci - b[i] * y) / a[i], np.full(a.shape[1:], y), (j, k), False)
    return least, most


def _plane_side(plane: Plane, towards: Array, sun: bool) -> float:
    """On which side of a plane a light is; 0 if it lies in it, or shines along it, but for rounding."""
    normal, point = np.asarray(unit(plane.normal)), np.asarray(plane.point)
    terms = normal * towards if sun else normal * (towards - point)
    size = np.abs(normal) @ (np.abs(towards) if sun else np.abs(towards) + np.abs(point))
    return float(terms.sum()) if abs(float(terms.sum())) > PLANAR * float(size) else 0.0


def _plane_spans(plane: Plane, lines: Lines, light: Light) -> Array:
    normal = np.asarray(unit(plane.normal))
    towards, sun = _towards(light)
    height = normal @ (lines.origin - np.asarray(plane.point)[:, np.newaxis])
    slope = normal @ lines.direction
    side = _plane_side(plane, towards, sun)
    # Dark where the ray's height has the other sign than the light's.
    sign = -np.sign(side)
    with np.errstate(divide="ignore", invalid="ignore"):
        crossing = -height / slope
    low = np.where(sign * slope > 0.0, crossing, -np.inf)
    high = np.where(sign * slope < 0.0, crossing, np.inf)
    dark = (slope != 0.0) | (sign * height > 0.0)
    low, high = np.where(dark & (sign != 0.0), low, np.inf), np.where(dark & (sign != 0.0), high, -np.inf)
    return np.stack([low, high], axis=1)[:, np.newaxis]


def _sphere_spans(sphere: Sphere, lines: Lines, light: Light) -> Array:
    """Between the first and the last of its ends: where the ray crosses the shadow's mantle or the sphere.

    The quadratics are formed in twice the digits: over a planet, |o × l|² and r² have sixteen in common where
    a shadow's edge is grazed.
    """
    center, r2 = np.asarray(sphere.center)[:, np.newaxis], double_double(sphere.radius) * double_double(sphere.radius)
    o = [double_double(a) - double_double(c) for a, c in zip(lines.origin, center, strict=True)]
    d = [double_double(a) for a in lines.direction]
    ends = [lines.start, lines.stop, *_roots(dot(d, d), dot(o, d), dot(o, o) - r2)]
    if isinstance(light, DirectionalLight):
        towards = [double_double(c) for c in light.direction]
        u, v = cross(o, towards), cross(d, towards)
        ends += _roots(dot(v, v), dot(u, v), dot(u, u) - r2 * dot(towards, towards))
    else:
        # On the mantle the way to the light passes at r: |X × A|² = r²·|X − A|², A the light from the centre.
        apex = [double_double(a) - double_double(c) for a, c in zip(light.position, center, strict=True)]
        u, v, w = cross(o, apex), cross(d, apex), [a - b for a, b in zip(o, apex, strict=True)]
        ends += _roots(dot(v, v) - r2 * dot(d, d), dot(u, v) - r2 * dot(w, d), dot(u, u) - r2 * dot(w, w))
    inside = np.clip(np.nan_to_num(np.stack(ends), nan=0.0), lines.start, lines.stop)
    inside = np.sort(inside, axis=0)
    middle = 0.5 * (inside[1:] + inside[:-1])
    aim, sun = _towards(light)
    aim = aim if sun else aim - center[:, 0]
    origin = lines.origin - center
    dark = np.stack([_sphere_hides(origin + lines.direction * t, aim, sphere.radius ** 2, sun) for t in middle])
    dark &= inside[1:] > inside[:-1]
    low = np.where(dark, inside[:-1], np.inf).min(axis=0)
    high = np.where(dark, inside[1:], -np.inf).max(axis=0)
    return np.stack([low, high], axis=1)[:, np.newaxis]


def _roots(a: DoubleDouble, b: DoubleDouble, c: DoubleDouble) -> list[Array]:
    """Of a·t² + 2b·t + c; NaN where there is none."""
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        root = (b * b - a * c).sqrt()
        q = -(b + where(b.high < 0.0, -root, root))
        roots = [(q / a).high, (c / q).high]
    return [np.where(np.isfinite(root), root, np.nan) for root in roots]


def _sphere_hides(x: Array, light: Array, r2: float, sun: bool) -> Mask:
    """Whether a sphere about the origin lies between points and a light."""
    if sun:
        direction = np.asarray(light).reshape(3, *(1,) * (x.ndim - 1))
        along = np.maximum(-(x * direction).sum(axis=0), 0.0)
        nearest = x + along * direction
    else:
        way = np.asarray(light).reshape(3, *(1,) * (x.ndim - 1)) - x
        square = np.maximum((way * way).sum(axis=0), 1e-300)
        nearest = x + np.clip(-(x * way).sum(axis=0) / square, 0.0, 1.0) * way
    return np.asarray((nearest * nearest).sum(axis=0) < r2)


def _cast_spans(cast: Cast, lines: Lines, light: Light, low: Array, high: Array) -> Array:
    """Dark stretches within [low, high], by casting and bisection."""
    low, high = np.maximum(low, lines.start), np.minimum(high, lines.stop)
    rows = np.flatnonzero(low < high)
    towards, sun = _towards(light)

    def dark(row: NDArray[np.integer[Any]], t: Array) -> Mask:
        points = lines.origin[:, row] + lines.direction[:, row] * t
        light = towards[:, np.newaxis]
        way = np.broadcast_to(light, points.shape) if sun else light - points
        return cast(points, way, sun)

    share = np.linspace(0.0, 1.0, CASTS)
    t = low[rows, np.newaxis] + (high - low)[rows, np.newaxis] * share
    if not rows.size:
        return np.zeros((low.size, 0, 2))
    seen = dark(np.repeat(rows, CASTS), t.reshape(-1)).reshape(t.shape)
    which, place = np.nonzero(seen[:, 1:] != seen[:, :-1])
    a, b, first = t[which, place], t[which, place + 1], seen[which, place]
    for _ in range(HALVINGS if which.size else 0):
        middle = 0.5 * (a + b)
        same = dark(rows[which], middle) == first
        a, b = np.where(same, middle, a), np.where(same, b, middle)
    # Every line's changes in order, with its own ends where it begins or ends in the dark.
    ends = np.concatenate([np.where(seen[:, :1], t[:, :1], np.nan), np.full((len(rows), CASTS - 1), np.nan),
                           np.where(seen[:, -1:], t[:, -1:], np.nan)], axis=1)
    ends[which, place + 1] = 0.5 * (a + b)
    ends = np.sort(ends, axis=1)
    most = int(np.isfinite(ends).sum(axis=1).max(initial=0))
    result = np.full((low.size, (most + 1) // 2, 2), np.nan)
    result[rows] = ends[:, :2 * result.shape[1]].reshape(len(rows), -1, 2)
    return result


# --- from points ------------------------------------------------------------------------------------


def exact_visibility(occluding: Sequence[Occluder], lights: Sequence[Light]) -> Visibility:
    """What hides lights from points.

    Parameters
    ----------
    occluding : sequence of Occluder
        From `occluders`.
    lights : sequence of Light
        Those that the indices mean.

    Returns
    -------
    mapping of int to callable
        For each light: given points, 0 where a surface lies between, else 1; see
        `froxel_ref.arrays.Visibility`.

    Notes
    -----
    What lies within 1e-7 of the way to the light (1e-5 m or of the way for meshes) does not count, so that
    surfaces do not hide themselves.

    Examples
    --------
    >>> box = Occluder(Box(), np.eye(4))
    >>> sees = exact_visibility([box], [DirectionalLight(direction=(0, 1, 0), irradiance=(1, 1, 1))])
    >>> x = np.array([0.0, 3.0])
    >>> sees[0]((x, x - 5.0, 0.0 * x)).tolist()
    [0.0, 1.0]
    """
    def visible(number: int, points: Points, normal: Points | None = None) -> Array:
        shape = np.broadcast_shapes(*(p.shape for p in points))
        x = np.stack([np.broadcast_to(p, shape).reshape(-1) for p in points]).astype(np.float64)
        towards, sun = _towards(lights[number])
        way = np.broadcast_to(towards[:, np.newaxis], x.shape) if sun else towards[:, np.newaxis] - x
        dark = np.zeros(x.shape[1], bool)
        for occluder in occluding:
            left = np.flatnonzero(~dark)
            dark[left] = _hides(occluder, x[:, left], way[:, left], towards, sun)
        return np.where(dark, 0.0, 1.0).reshape(shape)

    return {number: partial(visible, number) for number in range(len(lights))}


def _hides(occluder: Occluder, x: Array, way: Array, towards: Array, sun: bool) -> Mask:
    surface = occluder.surface
    if occluder.cast is not None:
        return occluder.cast(x, way, sun) if x.shape[1] else np.zeros(0, bool)
    if isinstance(surface, Sphere):
        center = np.asarray(surface.center)
        start = x + NEAR * way - center[:, np.newaxis]
        return _sphere_hides(start, towards if sun else towards - center, surface.radius ** 2, sun)
    with np.errstate(divide="ignore", invalid="ignore"):
        if isinstance(surface, Plane):
            if _plane_side(surface, towards, sun) == 0.0:
                return np.zeros(x.shape[1], bool)
            normal = np.asarray(unit(surface.normal))
            t = -(normal @ (x - np.asarray(surface.point)[:, np.newaxis])) / (normal @ way)
            return np.asarray((t > NEAR) & ((t < 1.0) | sun))
    matrix = np.asarray(occluder.local_from_world)
    low, high = _slabs(matrix[:3, :3] @ x + matrix[:3, 3:], matrix[:3, :3] @ way)
    return np.asarray((np.maximum(low, NEAR) < high) & ((low < 1.0) | sun))


def _slabs(origin: Array, direction: Array) -> tuple[Array, Array]:
    """Where lines enter and leave [−1, 1]³."""
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        a, b = (-1.0 - origin) / direction, (1.0 - origin) / direction
    still = direction == 0.0
    outside = np.where(np.abs(origin) <= 1.0, -np.inf, np.inf)
    low = np.where(still, outside, np.minimum(a, b)).max(axis=0)
    high = np.where(still, -outside, np.maximum(a, b)).min(axis=0)
    return low, high
