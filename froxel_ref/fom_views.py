"""How Fourier opacity maps look from lights: their texels' rays, the depths they reach, the tiles they are given."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from froxel_ref.atlas import Tile, allocate, largest_free, new_atlas
from froxel_ref.geometry import Lines, view_from_world
from froxel_ref.light_raster import LightRaster, raster_rays
from froxel_ref.scene import Camera, DirectionalLight, PointLight, SpotLight
from froxel_ref.settings import Grid, OpacityMaps, ShadowMaps
from froxel_ref.shadow_filters import pad_octahedral
from froxel_ref.shadow_views import WIDEST_SPOT, cascade_views, spot_view

__all__ = [
    "CASCADE_REACH", "Wanted", "assign_tiles", "cascade_lines", "lamp_directions", "lamp_reach",
    "octahedral_directions", "opacity_cascades", "screen_extent",
]

Matrix: TypeAlias = NDArray[np.float64]

# How far before and behind its plane a cascade looks for media [m]: beyond the farthest that scenes may have.
CASCADE_REACH = 1e11


# --- lamps ------------------------------------------------------------------------------------------


def octahedral_directions(inner: int, *, gutter: int = 0) -> Matrix:
    """Unit vectors through the texels of an octahedral map.

    Parameters
    ----------
    inner : int
        Texels across, without the gutter.
    gutter : int
        Texels around them that see what their neighbours across the edge see.

    Returns
    -------
    ndarray, shape (3, inner + 2·gutter, inner + 2·gutter)
        From the light; the inverse of `froxel_ref.shadow_lookup.octahedral_square` at texels' centres.

    Examples
    --------
    >>> octahedral_directions(1).ravel().tolist()
    [0.0, 1.0, 0.0]
    >>> octahedral_directions(2)[1].round(3).tolist()  # texels' centres lie on the fold
    [[0.0, 0.0], [0.0, 0.0]]
    """
    u = (np.arange(inner) + 0.5) * (2.0 / inner) - 1.0
    u, v = np.broadcast_arrays(u, u[:, np.newaxis])
    y = 1.0 - np.abs(u) - np.abs(v)
    below = y < 0.0
    x = np.where(below, np.copysign(1.0 - np.abs(v), u), u)
    z = np.where(below, np.copysign(1.0 - np.abs(u), v), v)
    ways = np.stack([x, y, z])
    ways /= np.sqrt((ways * ways).sum(axis=0))
    return np.asarray(pad_octahedral(ways, gutter), np.float64)


def lamp_directions(light: PointLight, size: int, *, gutter: int, spot: str = "upright",
                    octahedron: str = "from_light") -> Matrix:
    """Unit vectors from a lamp through the texels of its map.

    Parameters
    ----------
    light : PointLight or SpotLight
        Spot lights up to a half angle of 75° have a perspective map, all others an octahedral one.
    size : int
        Texels across, gutter included.
    gutter : int
        Texels around the map: of an octahedron what lies across its edges, of a spot light what lies beside its
        cone.
    spot : {"upright", "mirrored"}
        A3: a spot light's rows in the order in which they are looked up, or the other way round and without a gutter.
    octahedron : {"from_light", "to_light"}
        A9: whether octahedral maps hold directions from the light, or to it.

    Returns
    -------
    ndarray, shape (3, size, size)

    Examples
    --------
    >>> lamp = SpotLight(position=(0, 2, 0), intensity=(1, 1, 1))
    >>> lamp_directions(lamp, 9, gutter=1)[:, 4, 4].tolist()
    [0.0, -1.0, 0.0]
    """
    if isinstance(light, SpotLight) and light.outer_angle <= WIDEST_SPOT:
        _, ways = raster_rays(spot_view(light, size, border=gutter if spot == "upright" else 0))
        ways = np.broadcast_to(ways, (3, size, size))
        turned: Matrix = ways / np.sqrt((ways * ways).sum(axis=0))
        return turned if spot == "upright" else turned[:, ::-1]
    ways = octahedral_directions(size - 2 * gutter, gutter=gutter)
    return ways if octahedron == "from_light" else -ways


def lamp_reach(light: PointLight, camera: Camera, grid: Grid) -> float:
    """How far from a lamp its map reaches.

    Parameters
    ----------
    light : PointLight
    camera, grid : Camera, Grid
        What is seen; for lamps without a window.

    Returns
    -------
    float [m]
        Its radius; of a lamp without a window, to the farthest corner of the froxels.

    Examples
    --------
    >>> lamp_reach(PointLight(position=(0, 0, 0), intensity=(1, 1, 1), radius=5), Camera(), Grid())
    5.0
    """
    if light.falloff == "windowed":
        return light.radius
    rise = math.tan(math.radians(camera.vertical_fov) / 2.0)
    across = rise * camera.width / camera.height
    view = view_from_world(camera)
    away = view[:3, :3] @ np.asarray(light.position) + view[:3, 3]
    corners = [np.array([sx * across * z, sy * rise * z, -z]) for z in (0.0, grid.far) for sx in (-1, 1)
               for sy in (-1, 1)]
    return float(max(np.linalg.norm(corner - away) for corner in corners))


def screen_extent(light: PointLight, camera: Camera) -> float:
    """Height of a lamp's sphere on the screen, as a share of the image's.

    Parameters
    ----------
    light : PointLight
    camera : Camera

    Returns
    -------
    float
        (r/√(D² − r²))/tan(fov/2), with D the distance from the camera; infinite from within the sphere, and for
        lamps without a window.

    Examples
    --------
    >>> camera = Camera(position=(0, 0, 0), target=(0, 0, -1), vertical_fov=90)
    >>> round(screen_extent(PointLight(position=(0, 0, -5), intensity=(1, 1, 1), radius=3), camera), 12)
    0.75
    """
    away = math.dist(light.position, camera.position)
    if light.falloff != "windowed" or away <= light.radius:
        return math.inf
    tangent = light.radius / math.sqrt((away - light.radius) * (away + light.radius))
    return tangent / math.tan(math.radians(camera.vertical_fov) / 2.0)


class Wanted(NamedTuple):
    """What a lamp asked for in the atlas, and what it got.

    Attributes
    ----------
    size : int [texels]
        Across, as wanted.
    tile : Tile or None
        None if there was no room for even the smallest.
    """

    size: int
    tile: Tile | None


def assign_tiles(lights: Mapping[int, PointLight], camera: Camera, maps: OpacityMaps, *,
                 tiles: str = "by_extent") -> dict[int, Wanted]:
    """Share the atlas out among lamps.

    Parameters
    ----------
    lights : mapping of int to PointLight
        By index, in the order in which they are served.
    camera : Camera
        On whose screen the lamps are large or small.
    maps : OpacityMaps
        Sizes.
    tiles : {"by_extent", "small"}
        A8: the thesis's program gives every lamp a small tile.

    Returns
    -------
    dict of int to Wanted

    Notes
    -----
    128² or 256² by the light's size on the screen [Dörries 2020, §3.3.3], which names no limit; ours is half the
    image's height. Where there is no room a lamp gets the next smaller tile, down to ``maps.smallest``, then none.

    Examples
    --------
    >>> lamp = PointLight(position=(0, 0, 0), intensity=(1, 1, 1))
    >>> wanted = assign_tiles({0: lamp, 1: lamp}, Camera(), OpacityMaps(atlas=256, small=128, smallest=128))
    >>> wanted[0].tile, wanted[1].tile
    (Tile(row=0, column=0, size=256), None)
    """
    atlas, result = new_atlas(maps.atlas, maps.smallest), {}
    for number, light in lights.items():
        large = tiles == "by_extent" and screen_extent(light, camera) >= maps.large_extent
        size = maps.large if large else maps.small
        given = size
        while given > largest_free(atlas) and given > maps.smallest:
            given //= 2
        atlas, tile = allocate(atlas, given)
        result[number] = Wanted(size, tile)
    return result


# --- suns -------------------------------------------------------------------------------------------


def opacity_cascades(light: DirectionalLight, camera: Camera, grid: Grid, shadow_maps: ShadowMaps,
                     maps: OpacityMaps) -> list[LightRaster]:
    """The cascades of a sun's Fourier opacity maps: those of its shadow maps, with texels of their own.

    Parameters
    ----------
    light : DirectionalLight
    camera, grid
        As for `froxel_ref.shadow_views.cascade_views`.
    shadow_maps : ShadowMaps
        Number and split of the cascades.
    maps : OpacityMaps
        Texels across.

    Returns
    -------
    list of LightRaster

    Examples
    --------
    >>> sun = DirectionalLight(direction=(0, 1, 0), irradiance=(1, 1, 1))
    >>> [view.rows for view in opacity_cascades(sun, Camera(), Grid(), ShadowMaps(), OpacityMaps())]
    [256, 256, 256, 256]
    """
    texels = ShadowMaps(cascades=shadow_maps.cascades, split=shadow_maps.split,
                        directional_size=maps.directional_size, border=1)
    return cascade_views(light, camera, grid, texels)


def cascade_lines(view: LightRaster) -> Lines:
    """The rays of a cascade's texels.

    Parameters
    ----------
    view : LightRaster
        Parallel rays.

    Returns
    -------
    Lines, rows·columns of them
        Depth 0 on the cascade's plane.

    Examples
    --------
    >>> sun = DirectionalLight(direction=(0, 1, 0), irradiance=(1, 1, 1))
    >>> view = opacity_cascades(sun, Camera(), Grid(), ShadowMaps(), OpacityMaps(directional_size=16))[0]
    >>> cascade_lines(view).direction[:, 0].tolist()
    [0.0, -1.0, 0.0]
    """
    places, way = raster_rays(view)
    origins = np.ascontiguousarray(places.reshape(3, -1))
    count = origins.shape[1]
    ends = np.full(count, CASCADE_REACH)
    return Lines(origins, np.broadcast_to(way.reshape(3, 1), origins.shape), -ends, ends)
