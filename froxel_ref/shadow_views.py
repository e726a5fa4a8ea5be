"""How shadow maps look at the world: the rasters of a sun's cascades, a spot light, a cube, an octahedron.

Every face of a map is one raster of rays that are affine in the texel, `froxel_ref.shadow_raster.LightRaster`.
Its inverse, a 3×4 matrix, takes a world point to (x, y, depth): texel coordinates and metres. For rays from
one point they come as (x·depth, y·depth, depth).
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from froxel_ref.geometry import world_from_view
from froxel_ref.lights import unit
from froxel_ref.scene import Camera, DirectionalLight, PointLight, SpotLight
from froxel_ref.settings import Grid, ShadowMaps
from froxel_ref.shadow_raster import LightRaster

__all__ = [
    "CUBE_FACES", "WIDEST_SPOT", "cascade_splits", "cascade_views", "cube_views", "octant_views",
    "raster_from_world", "shadow_basis", "spot_view",
]

Matrix: TypeAlias = NDArray[np.float64]

# Spot lights with a wider half angle have a point light's map: their image plane would run to infinity.
WIDEST_SPOT = 75.0

# A cascade counts where both |x| and |y| are below this share of its half width (the sources' 0.97), border not
# counted.
CASCADE_EDGE = 0.97

# Faces of a cube map as graphics interfaces number them: +x, −x, +y, −y, +z, −z; for each the axis that it
# looks along and the world directions in which its columns and rows grow [OpenGL 4.6, table 8.19].
CUBE_FACES = np.array([
    [[1, 0, 0], [0, 0, -1], [0, -1, 0]], [[-1, 0, 0], [0, 0, 1], [0, -1, 0]],
    [[0, 1, 0], [1, 0, 0], [0, 0, 1]], [[0, -1, 0], [1, 0, 0], [0, 0, -1]],
    [[0, 0, 1], [1, 0, 0], [0, -1, 0]], [[0, 0, -1], [-1, 0, 0], [0, -1, 0]]], np.float64)


def shadow_basis(direction: tuple[float, ...]) -> Matrix:
    """Axes of a map that looks along a direction.

    Parameters
    ----------
    direction : tuple of 3 floats
        Which way the light shines, of any length but 0.

    Returns
    -------
    ndarray, shape (3, 3)
        Rows: the unit vectors in which columns grow (right), rows grow (down), and depth grows.

    Notes
    -----
    Right is across the world's y axis, or across its z axis where the light shines within 8° of y. It depends
    on nothing else, so a map does not turn when the camera does.

    Examples
    --------
    >>> shadow_basis((0.0, 0.0, -2.0)).tolist()
    [[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, -1.0]]
    """
    x, y, z = direction
    axis = np.array(unit((x, y, z)))
    up = np.array([0.0, 1.0, 0.0]) if abs(axis[1]) < 0.99 else np.array([0.0, 0.0, -1.0])
    right = np.cross(axis, up)
    right /= np.sqrt(right @ right)
    return np.stack([right, np.cross(axis, right), axis]) + 0.0


def raster_from_world(raster: LightRaster) -> Matrix:
    """The matrix from the world to texels and depth.

    Parameters
    ----------
    raster : LightRaster
        A face of a map.

    Returns
    -------
    ndarray, shape (3, 4)
        Takes (p, 1) to (x, y, depth) for parallel rays, and to (x·depth, y·depth, depth) for rays from one
        point. Texel i covers [i, i + 1); depth in metres along the rays, or across the image plane's distance.

    Examples
    --------
    >>> spot = SpotLight(position=(0, 2, 0), intensity=(1, 1, 1), inner_angle=30, outer_angle=45)
    >>> matrix = raster_from_world(spot_view(spot, 8, border=0))
    >>> x, y, depth = matrix @ (0.0, 0.0, 0.0, 1.0)
    >>> [round(float(v), 12) for v in (x / depth, y / depth, depth)]
    [4.0, 4.0, 2.0]
    """
    if raster.origin is None:
        columns, start = np.stack([raster.across, raster.down, np.asarray(raster.direction)], axis=1), raster.base
    else:
        columns, start = np.stack([raster.across, raster.down, raster.base], axis=1), raster.origin
    linear = np.linalg.inv(columns)
    return np.concatenate([linear, (-linear @ start)[:, np.newaxis]], axis=1)


# --- suns -------------------------------------------------------------------------------------------


def cascade_splits(grid: Grid, maps: ShadowMaps) -> Matrix:
    """View depths between which each cascade of a sun serves.

    Parameters
    ----------
    grid : Grid
        Its near and far.
    maps : ShadowMaps
        Number of cascades, split: the share of the exponential distribution, and reach, if they serve beyond the
        froxels, or less far.

    Returns
    -------
    ndarray, shape (cascades + 1,) [m]
        From 0, the camera, to far, or to the reach.

    Notes
    -----
    z_i = λ·n·(f/n)^(i/C) + (1 − λ)·(n + (f − n)·i/C) [Zhang 2006, the practical split scheme]; the first
    cascade begins at the camera, for surfaces may lie in front of the froxels.

    Examples
    --------
    >>> cascade_splits(Grid(near=1.0, far=16.0), ShadowMaps(cascades=2, split=1.0)).tolist()
    [0.0, 4.0, 16.0]
    """
    share = np.arange(maps.cascades + 1) / maps.cascades
    far = grid.far if maps.reach is None else maps.reach
    splits = maps.split * grid.near * (far / grid.near) ** share
    splits += (1.0 - maps.split) * (grid.near + (far - grid.near) * share)
    splits[0], splits[-1] = 0.0, far
    return np.asarray(splits)


class _Ball(NamedTuple):
    """A sphere around a stretch of the view, its centre on the camera's axis."""

    depth: float
    radius: float


def _ball(low: float, high: float, slope: float) -> _Ball:
    """The smallest one; ``slope`` is the tangent of the angle to the image's corners."""
    depth = min(high, 0.5 * (low + high) * (1.0 + slope * slope))
    return _Ball(depth, max(math.hypot(high - depth, high * slope), math.hypot(depth - low, low * slope)))


def cascade_views(light: DirectionalLight, camera: Camera, grid: Grid, maps: ShadowMaps) -> list[LightRaster]:
    """Fit a sun's cascades to the froxels.

    Parameters
    ----------
    light : DirectionalLight
    camera : Camera
        The view that they follow.
    grid : Grid
        Its near and far.
    maps : ShadowMaps
        Number, split and size of the cascades.

    Returns
    -------
    list of LightRaster
        Parallel rays along the sun's light; depth 0 is the plane through the cascade's centre.

    Notes
    -----
    Each is a square around the ball about its stretch of the view, so that its size does not change when the
    camera turns, and its centre moves in whole texels, so that nothing shimmers when it moves: a point of the
    world falls on the same place in its texel in every frame. The ball lies within 0.97 of the half width
    without the border, half a texel for the snap included, so every froxel has a cascade, unless maps.reach
    is nearer than the froxels' far end.

    Examples
    --------
    >>> sun = DirectionalLight(direction=(0, 1, 0), irradiance=(1, 1, 1))
    >>> len(cascade_views(sun, Camera(), Grid(), ShadowMaps()))
    4
    """
    basis = shadow_basis(tuple(-c for c in light.direction))
    size = maps.directional_size
    inner = size - 2 * maps.edge
    splits = cascade_splits(grid, maps)
    pose = world_from_view(camera)
    tangent = math.tan(math.radians(camera.vertical_fov) / 2.0)
    slope = tangent * math.hypot(1.0, camera.width / camera.height)
    result = []
    for low, high in zip(splits[:-1].tolist(), splits[1:].tolist(), strict=True):
        ball = _ball(low, high, slope)
        texel = 2.0 * ball.radius / (CASCADE_EDGE * inner - 1.0)
        center = basis @ (pose[:3, 3] - ball.depth * pose[:3, 2])
        center = np.round(center / texel) * texel
        across, down = texel * basis[0], texel * basis[1]
        base = center @ basis - 0.5 * size * (across + down)
        result.append(LightRaster(base, across, down, None, basis[2], size, size))
    return result


# --- lamps ------------------------------------------------------------------------------------------


def spot_view(light: SpotLight, size: int, *, border: int) -> LightRaster:
    """The raster of a spot light: its cone touches the image's sides within a border.

    Parameters
    ----------
    light : SpotLight
        With an outer angle of at most 75°.
    size : int
        Texels across.
    border : int
        Texels on each side that only filters see.

    Returns
    -------
    LightRaster
        Depth is the planar distance along the light's axis.

    Examples
    --------
    >>> spot = SpotLight(position=(0, 2, 0), intensity=(1, 1, 1), inner_angle=30, outer_angle=45)
    >>> view = spot_view(spot, 8, border=0)
    >>> (view.base + 8 * view.across + 4 * view.down).round(12).tolist()
    [1.0, -1.0, 0.0]
    """
    basis = shadow_basis(light.direction)
    half = math.tan(math.radians(light.outer_angle))
    return _plane_view(light, basis[2], half * basis[0], half * basis[1], size, border)


def cube_views(light: PointLight, size: int, *, border: int) -> list[LightRaster]:
    """The six faces of a cube map.

    Parameters
    ----------
    light : PointLight
        Gives the position.
    size : int
        Texels across a face, border included.
    border : int
        Texels on each side that belong to the neighbours' directions, so that filters need no other face.

    Returns
    -------
    list of LightRaster
        In the order of `CUBE_FACES`; depth is the planar distance along the face's axis.

    Examples
    --------
    >>> face = cube_views(PointLight(position=(0, 0, 0), intensity=(1, 1, 1)), 4, border=1)[5]
    >>> (face.base + 1 * face.across + 3 * face.down).tolist()
    [1.0, -1.0, -1.0]
    """
    return [_plane_view(light, axis, right, down, size, border) for axis, right, down in CUBE_FACES]


def _plane_view(light: PointLight, axis: Matrix, right: Matrix, down: Matrix, size: int, border: int) -> LightRaster:
    """Rays from a light through a square that reaches ``right`` and ``down`` from its axis at distance 1."""
    inner = size - 2 * border
    across, below = right * (2.0 / inner), down * (2.0 / inner)
    return LightRaster(axis - 0.5 * size * (across + below), across, below, np.asarray(light.position, np.float64),
                       None, size, size)


def octant_views(light: PointLight, inner: int) -> dict[tuple[int, int], tuple[LightRaster, LightRaster]]:
    """The pieces of an octahedral map on which rays are affine in the texel.

    Parameters
    ----------
    light : PointLight
        Gives the position.
    inner : int
        Texels across the map without its gutter; even.

    Returns
    -------
    dict of (row, column) of a quarter to (LightRaster, LightRaster)
        For each quarter of the square two rasters of inner/2 texels: the upper octant (y > 0), which lies in
        the middle of the map, and the lower one in the corner. Depth is |x| + |y| + |z|.

    Notes
    -----
    The square [−1, 1]² folds to the octahedron |x| + |y| + |z| = 1: (u, v) → (u, 1 − |u| − |v|, v), and where
    the middle component is negative u → (1 − |v|)·sign u, v → (1 − |u|)·sign v [Meyer 2010]. v grows downwards
    and with +z.

    Examples
    --------
    >>> lamp = PointLight(position=(0, 0, 0), intensity=(1, 1, 1))
    >>> upper, lower = octant_views(lamp, 8)[1, 1]
    >>> (upper.base + 2 * upper.across + 1 * upper.down).tolist()
    [0.5, 0.25, 0.25]
    >>> (lower.base + 4 * lower.across + 4 * lower.down).tolist()
    [0.0, -1.0, 0.0]
    """
    half = inner // 2
    origin, step = np.asarray(light.position, np.float64), 2.0 / inner
    result = {}
    for row in (0, 1):
        for column in (0, 1):
            sx, sz = 2.0 * column - 1.0, 2.0 * row - 1.0
            u0, v0 = float(column - 1), float(row - 1)  # at the quarter's first texel edge

            def piece(x: Any, y: Any, z: Any, u0: float = u0, v0: float = v0) -> LightRaster:
                """From the components as functions (constant, per u, per v)."""
                parts = np.array([x, y, z], np.float64)
                base = parts @ (1.0, u0, v0)
                return LightRaster(base, step * parts[:, 1], step * parts[:, 2], origin, None, half, half)

            result[row, column] = (piece((0, 1, 0), (1, -sx, -sz), (0, 0, 1)),
                                   piece((sx, 0, -sx * sz), (1, -sx, -sz), (sz, -sx * sz, 0)))
    return result
