"""How points look themselves up in a light's shadow map."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from froxel_ref.arrays import Field, Points, Sight
from froxel_ref.settings import ShadowMaps
from froxel_ref.shadow_filters import compare, exponential_visibility, kernel_reach
from froxel_ref.shadow_views import CASCADE_EDGE

__all__ = ["ShadowMap", "cube_faces", "octahedral_square", "roundings", "sight"]

Matrix: TypeAlias = NDArray[np.float64]
Integers: TypeAlias = NDArray[np.integer[Any]]

# Depth that stands for the light's own place, where no direction is right [m].
TINY = 1e-30

# A lifted point stays on its side of the light: the least share of 1 − k·n in `_lift`.
LEAST = 0.25

# Of a texel, the way to its corner.
DIAGONAL = 2.0 ** 0.5

# Times the rounding of a coordinate: how far a surface's own points may stray from its map's depth.
ROUNDINGS = 8.0

# Of a lamp's depth, the most that corner_bias may take.
CORNER = 0.125


class ShadowMap(NamedTuple):
    """One light's map.

    Attributes
    ----------
    kind : {"directional", "spot", "cube", "octahedral"}
    depth : Field, shape (faces, size, size) [m]
        First hits.
    matrix : ndarray, shape (faces, 3, 4)
        As in `froxel_ref.shadow.Stack`.
    exponential : Field, shape (faces, n, n), or None
        The filtered map, if there is one.
    low, high : ndarray, shape (faces,) [m]
        The range of depths that it is made for.
    eps : float
        Relative rounding of the depths, if it is larger than that of their type: of maps made elsewhere.
    """

    kind: str
    depth: Field
    matrix: Matrix
    exponential: Field | None = None
    low: Matrix | None = None
    high: Matrix | None = None
    eps: float = 0.0


class _Place(NamedTuple):
    """Where in a map points are; ``face`` is the number of faces for points outside all of them."""

    face: Integers | int
    x: Field
    y: Field
    depth: Field


def sight(shadow_map: ShadowMap, *, maps: ShadowMaps | None = None, outside: str = "lit") -> Sight:
    """What share of a light arrives at points, by its shadow map.

    Parameters
    ----------
    shadow_map : ShadowMap
        The light's.
    maps : ShadowMaps, optional
        Kernel and biases, and the border that the map has.
    outside : {"lit", "dark"}
        What points outside all cascades are (A4).

    Returns
    -------
    callable
        From points, and the normals if they lie on surfaces, to shares in [0, 1].

    Notes
    -----
    In a medium no bias is applied: a froxel's sample lies on no surface. On a surface with normal n the map's
    own depth is that of the surface at the texel's centre, up to r texels away, and would hide it. The point is
    lifted along n by just what a plane needs: with a texel's ray d + Δx·a + Δy·b (a and b the steps per texel),
    a plane is nowhere nearer to the light than the lifted point if the lift is at least t'·r·(|n·a| + |n·b|),
    t' the depth of the lifted point; for parallel rays r·(|n·a| + |n·b|). That holds at any angle, however
    grazing. ``normal_bias`` multiplies it, r is the kernel's reach (1 texel for bilinear comparisons). Beside
    it stand the usual two, which are 0 unless set: a constant in metres, and a multiple of the surface's
    change of depth per texel.

    Examples
    --------
    >>> from froxel_ref.scene import Plane, SpotLight
    >>> from froxel_ref.shadow_raster import casters, raster_depth
    >>> from froxel_ref.shadow_views import raster_from_world, spot_view
    >>> view = spot_view(SpotLight(position=(0, 2, 0), intensity=(1, 1, 1)), 16, border=1)
    >>> depth = raster_depth(casters([Plane()], None), view)
    >>> see = sight(ShadowMap("spot", depth[None], raster_from_world(view)[None]))
    >>> x = np.zeros(2)
    >>> see((x, np.array([0.1, -0.1]), x)).tolist()
    [1.0, 0.0]
    """
    maps = maps or ShadowMaps()
    locate = {"directional": _cascade, "spot": _spot, "cube": _cube, "octahedral": _octahedron}[shadow_map.kind]

    def see(points: Points, normal: Points | None = None) -> Field:
        shape = np.broadcast_shapes(*(p.shape for p in points))
        place = locate(shadow_map, maps, points, normal)
        faces = len(shadow_map.depth)
        beyond = None
        if shadow_map.kind == "directional":
            beyond = np.equal(place.face, faces)
            place = place._replace(face=np.minimum(place.face, faces - 1))
        share = _share(shadow_map, maps, place)
        if beyond is not None and beyond.any():
            share = np.where(beyond, 1.0 if outside == "lit" else 0.0, share).astype(share.dtype, copy=False)
        return np.broadcast_to(share, shape)

    return see


def _share(shadow_map: ShadowMap, maps: ShadowMaps, place: _Place) -> Field:
    depth = shadow_map.depth
    if shadow_map.exponential is None:
        return compare(depth, place.face, place.x, place.y, place.depth, kernel=maps.kernel)
    low, high = (np.asarray(v, place.depth.dtype).take(place.face) for v in (shadow_map.low, shadow_map.high))
    share = 1.0 / (depth.shape[-1] // shadow_map.exponential.shape[-1])
    return exponential_visibility(shadow_map.exponential, place.face, place.x * share, place.y * share,
                                  (place.depth - low) / (high - low), exponent=maps.exponent)


# --- biases -----------------------------------------------------------------------------------------


def _along(axis: Matrix, points: Points, shift: float = 0.0) -> Field:
    """axis·p + shift."""
    a, b, c = axis.tolist()
    x, y, z = points
    return np.asarray(x * a + y * b + z * c + shift)


def roundings(points: Points, *, beyond: float = 0.0, eps: float = 0.0) -> Field:
    """How far a surface's points stray from it by rounding.

    Parameters
    ----------
    points : Points, shape (…) [m]
        On the surface.
    beyond : float [m]
        Sum of the coordinates' sizes of what else rounds with them.
    eps : float
        Relative rounding, if it is larger than that of the points' type.

    Returns
    -------
    Field, shape (…) [m]
        8·ε·(|x| + |y| + |z| + beyond).

    Examples
    --------
    >>> float(roundings((np.array(1.0), np.array(-2.0), np.array(1.0))) / np.finfo(float).eps)
    32.0
    """
    x, y, z = points
    unit = ROUNDINGS * max(float(np.finfo(np.result_type(*points)).eps), eps)
    return np.asarray((np.abs(x) + np.abs(y) + np.abs(z) + beyond) * unit)


def _rounding(shadow_map: ShadowMap, points: Points, origin: Matrix) -> Field:
    """How far a surface's points stray from it, and from the map's rays, by rounding [m]."""
    return roundings(points, beyond=float(np.abs(origin).sum()), eps=shadow_map.eps)


def _reach(maps: ShadowMaps) -> float:
    """How far from a point what it is compared with may lie [texels]; exponential maps compare with their mean."""
    return 0.5 if maps.technique == "exponential" else kernel_reach(maps.kernel)


def _least_reach(maps: ShadowMaps) -> float:
    """The same, no more than that of bilinear comparisons: wider kernels soften a corner's line by themselves."""
    return min(_reach(maps), 1.0)


def _lift(maps: ShadowMaps, spread: Field, depth: Field, facing: Field) -> Field:
    """How far to lift points of a plane: depth'·spread, depth' = depth + lift·facing."""
    return np.asarray(maps.normal_bias * depth * spread / np.maximum(1.0 - spread * facing, LEAST))


def _biased(depth: Field, maps: ShadowMaps, slope: Field | None, span: Field | float = 0.0, most: float | None = None
            ) -> Field:
    """The receiver's depth with the constant, the slope's and the corner's bias.

    ``span`` is a texel's diagonal there, ``most`` the share of the depth that the corner's bias may take: texels
    so coarse that it took all would light everything.
    """
    if maps.constant_bias:
        depth = depth - maps.constant_bias
    if slope is not None:
        depth = depth - maps.slope_bias * slope
    if maps.corner_bias and np.any(span):
        depth = depth - maps.corner_bias * span if most is None else np.maximum(
            depth - maps.corner_bias * span, (1.0 - most) * depth)
    return np.asarray(depth)


# --- directional lights -----------------------------------------------------------------------------


def _cascade(shadow_map: ShadowMap, maps: ShadowMaps, points: Points, normal: Points | None) -> _Place:
    """The first cascade in which |x| and |y| are below 0.97 of its half width."""
    matrix, size = shadow_map.matrix, shadow_map.depth.shape[-1]
    scale = np.sqrt((matrix[:, 0, :3] ** 2).sum(axis=1))  # texels per metre
    axes = matrix[0, :, :3] / np.array([scale[0], scale[0], 1.0])[:, np.newaxis]
    x, y, z = (_along(axis, points) for axis in axes)
    shape = np.broadcast_shapes(x.shape, y.shape, z.shape)
    face = np.full(shape, len(matrix), np.intp)
    reach = CASCADE_EDGE * (0.5 * size - maps.edge)
    for k in range(len(matrix) - 1, -1, -1):
        across, down = matrix[k, 0, 3] - 0.5 * size, matrix[k, 1, 3] - 0.5 * size
        inside = (np.abs(x * float(scale[k]) + float(across)) < reach) & (
            np.abs(y * float(scale[k]) + float(down)) < reach)
        face[inside] = k
    last = np.minimum(face, len(matrix) - 1)
    dtype = z.dtype
    steps = scale.astype(dtype).take(last)
    slope = None
    if normal is not None:
        nx, ny, nz = (_along(axis, normal) for axis in axes)
        spread = _reach(maps) * (np.abs(nx) + np.abs(ny)) / steps
        lift = maps.normal_bias * spread + _rounding(shadow_map, points, np.zeros(3))
        x, y, z = x + lift * nx, y + lift * ny, z + lift * nz
        if maps.slope_bias:
            slope = np.maximum(np.abs(nx), np.abs(ny)) / (steps * np.maximum(np.abs(nz), TINY))
    tx, ty, tz = (matrix[:, i, 3].astype(dtype).take(last) for i in range(3))
    span = 0.0 if normal is None else DIAGONAL * _least_reach(maps) / steps
    return _Place(face, x * steps + tx, y * steps + ty, _biased(z + tz, maps, slope, span))


# --- lamps ------------------------------------------------------------------------------------------


def _spot(shadow_map: ShadowMap, maps: ShadowMaps, points: Points, normal: Points | None) -> _Place:
    axes, origin, scale = _frame(shadow_map.matrix[0], shadow_map.depth.shape[-1])
    away = _from(points, origin)
    slope = None
    if normal is not None:
        turned, local = ([_along(axis, vector) for axis in axes] for vector in (normal, away))
        lift = _plane_lift(maps, local, turned, scale) + _rounding(shadow_map, points, origin)
        slope = _plane_slope(maps, local, turned, scale)
        away = _moved(away, lift, normal)
    local = [_along(axis, away) for axis in axes]
    return _on_plane(local, scale, shadow_map, maps, slope, 0, surface=normal is not None)


def _frame(matrix: Matrix, size: int) -> tuple[Matrix, Matrix, float]:
    """Unit axes (right, down, along), position of the light, texels per tangent."""
    along = matrix[2, :3]
    right, down = (matrix[i, :3] - 0.5 * size * along for i in (0, 1))
    scale = float(np.sqrt(right @ right))
    origin = np.asarray(np.linalg.solve(matrix[:, :3], -matrix[:, 3]), np.float64)
    return np.stack([right / scale, down / scale, along]), origin, scale


def _from(points: Points, origin: Matrix) -> Points:
    x, y, z = (p - float(o) for p, o in zip(points, origin, strict=True))
    return x, y, z


def _moved(points: Points, lift: Field, normal: Points) -> Points:
    x, y, z = (p + lift * n for p, n in zip(points, normal, strict=True))
    return x, y, z


def _plane_lift(maps: ShadowMaps, local: Sequence[Field], normal: Sequence[Field], scale: float) -> Field:
    """How far to lift points whose vectors and normals are given along a face's right, down and axis."""
    spread = _reach(maps) / scale * (np.abs(normal[0]) + np.abs(normal[1]))
    return _lift(maps, spread, np.abs(local[2]), normal[2])


def _plane_slope(maps: ShadowMaps, local: Sequence[Field], normal: Sequence[Field], scale: float) -> Field | None:
    """The change of a surface's depth per texel of a face."""
    if not maps.slope_bias:
        return None
    towards = np.maximum(np.abs(sum(n * p for n, p in zip(normal, local, strict=True))), TINY)
    steepest = np.maximum(np.abs(normal[0]), np.abs(normal[1]))
    return np.asarray(local[2] * local[2] * steepest / (scale * towards))


def _on_plane(local: Sequence[Field], scale: float, shadow_map: ShadowMap, maps: ShadowMaps, slope: Field | None,
              face: Integers | int, *, surface: bool) -> _Place:
    """Where points, along a face's right, down and axis from the light, meet its plane."""
    u, v, t = local
    half = 0.5 * shadow_map.depth.shape[-1]
    over = scale / np.maximum(t, TINY)
    span = DIAGONAL * _least_reach(maps) / scale * t if surface else 0.0
    with np.errstate(over="ignore"):  # points beside or behind the light are looked up at the border
        return _Place(face, u * over + half, v * over + half, _biased(t, maps, slope, span, CORNER))


def cube_faces(x: Field, y: Field, z: Field) -> tuple[Integers, Any]:
    """Which face of a cube map directions meet.

    Parameters
    ----------
    x, y, z : Field
        Directions, of any length.

    Returns
    -------
    face : ndarray of int
        In the order of `froxel_ref.shadow_views.CUBE_FACES`; of equal sizes the first axis counts.
    turn : callable
        From the components of vectors at the same points to those along the face's right, down and axis.

    Examples
    --------
    >>> face, turn = cube_faces(np.array([3.0, 0.0]), np.array([1.0, -2.0]), np.array([0.0, 1.0]))
    >>> face.tolist(), [c.tolist() for c in turn(*(np.array(c) for c in ([3.0, 0.0], [1.0, -2.0], [0.0, 1.0])))]
    ([0, 3], [[-0.0, 0.0], [-1.0, -1.0], [3.0, 2.0]])
    """
    x, y, z = np.broadcast_arrays(x, y, z)
    ax, ay, az = np.abs(x), np.abs(y), np.abs(z)
    first = (ax >= ay) & (ax >= az)
    second = ~first & (ay >= az)
    major = np.where(first, x, np.where(second, y, z))
    sign = np.copysign(np.ones((), x.dtype), major)
    face = np.where(first, 0, np.where(second, 2, 4)) + (sign < 0.0)

    def turn(a: Field, b: Field, c: Field) -> tuple[Field, Field, Field]:
        along = np.where(first, a, np.where(second, b, c)) * sign
        right = np.where(second, a, np.where(first, -c, a) * sign)
        down = np.where(second, c * sign, -b)
        return right, down, along

    return face, turn


def _cube(shadow_map: ShadowMap, maps: ShadowMaps, points: Points, normal: Points | None) -> _Place:
    _, origin, scale = _frame(shadow_map.matrix[0], shadow_map.depth.shape[-1])
    away = _from(points, origin)
    slope = None
    if normal is not None:
        # A lifted point may look at another face, whose texels ask for another lift: the larger one serves both.
        # By rounding alone a point on an edge may, too; at a corner there is a third.
        _, turn = cube_faces(*away)
        slope = _plane_slope(maps, turn(*away), turn(*normal), scale)
        lift, rounding = _plane_lift(maps, turn(*away), turn(*normal), scale), _rounding(shadow_map, points, origin)
        for _ in range(2):
            _, other = cube_faces(*_moved(away, lift + rounding, normal))
            lift = np.maximum(lift, _plane_lift(maps, other(*away), other(*normal), scale))
        away = _moved(away, lift + rounding, normal)
    face, turn = cube_faces(*away)
    return _on_plane(turn(*away), scale, shadow_map, maps, slope, face, surface=normal is not None)


def octahedral_square(x: Field, y: Field, z: Field) -> tuple[Field, Field]:
    """Fold directions to the octahedron's square.

    Parameters
    ----------
    x, y, z : Field
        Directions from the light, of any length; 0 falls on the centre.

    Returns
    -------
    u, v : Field
        In [−1, 1], v downwards.

    Notes
    -----
    (u, v) = (x, z)/(|x| + |y| + |z|); where y < 0, ((1 − |v|)·sign u, (1 − |u|)·sign v) [Meyer 2010]. Since
    1 − |v| = (|x| + |y|)/(|x| + |y| + |z|), both halves are one formula without a difference, within 2 ulp.

    Examples
    --------
    >>> square = octahedral_square(np.array([0.0, 1.0, 0.0]), np.array([2.0, -1.0, -1.0]), np.array([0.0, 0.0, 0.0]))
    >>> [c.tolist() for c in square]
    [[0.0, 1.0, 1.0], [0.0, 0.5, 1.0]]
    """
    across, along = np.abs(x), np.abs(z)
    size = np.maximum(across + np.abs(y) + along, TINY)
    below = np.maximum(-y, 0.0)
    return np.copysign((across + below) / size, x), np.copysign((along + below) / size, z)


def _octahedron(shadow_map: ShadowMap, maps: ShadowMaps, points: Points, normal: Points | None) -> _Place:
    size = shadow_map.depth.shape[-1]
    inner = size - 2 * maps.edge
    origin = -shadow_map.matrix[0, :, 3]
    x, y, z = _from(points, origin)
    slope = None
    if normal is not None:
        nx, ny, nz = normal
        distance = np.maximum(np.sqrt(x * x + y * y + z * z), TINY)
        cosine = (x * nx + y * ny + z * nz) / distance
        sine = np.sqrt(np.maximum(1.0 - cosine * cosine, 0.0))
        # A step of (1, 1) texels moves the octahedron's point by at most √6·2/inner, and the direction by that
        # over the point's own distance, which is no less than 1/√3 anywhere near.
        step = 2.0 / inner * (np.abs(x) + np.abs(y) + np.abs(z)) / distance
        turn = _reach(maps) * 6.0 ** 0.5 * step * (1.0 + 8.0 * _reach(maps) / inner)
        lift = _lift(maps, turn * (sine + 0.5 * turn), distance, np.ones((), distance.dtype))
        lift = lift + _rounding(shadow_map, points, origin)
        if maps.slope_bias:
            slope = distance * step * sine / np.maximum(np.abs(cosine), TINY)
        x, y, z = _moved((x, y, z), lift, normal)
    u, v = octahedral_square(x, y, z)
    half = np.asarray(0.5 * inner, u.dtype)
    middle = np.asarray(0.5 * size, u.dtype)
    distance = np.sqrt(x * x + y * y + z * z)
    span = 0.0 if normal is None else 6.0 ** 0.5 * _least_reach(maps) * step * distance
    return _Place(0, u * half + middle, v * half + middle, _biased(distance, maps, slope, span, CORNER))
