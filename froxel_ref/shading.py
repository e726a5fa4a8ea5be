"""Lambert shading of what camera rays hit, each light only where it can reach.

The image is cut into tiles, and the surfaces in a tile into a box in the world: a light visits the tiles whose
box its sphere meets, so that the cost grows with the pixels it touches, whatever lies before and behind them.
The tiles' pixels are laid out one tile behind another, for a light's tiles to be picked out in one go.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from froxel_ref.arrays import Field, Points, Visibility
from froxel_ref.blocks import blocks, run
from froxel_ref.buffers import Hits
from froxel_ref.geometry import Rays, crop_rays, dot, ray_points
from froxel_ref.lights import colour, light_at, seen
from froxel_ref.scene import Light, PointLight, Scene

__all__ = ["shade"]

Integers = NDArray[np.intp]

# Pixels in a block: each light costs some 50 calls in each block, whatever it reaches.
BLOCK = 262144
# Pixels along the edge of a tile, and tiles along the edge of a square whose common box is tried first.
TILE, SQUARE = 8, 4
# Tiles that are worked on at a time: a dozen arrays of their pixels stay in the cache.
FEW = 512
# Share of the tiles from which on all are taken as they are: picking tiles out costs as much as a few passes.
MOST = 0.8
# Rounding of positions and distances that the boxes allow for, in ulp of the farthest one.
ROUNDINGS = 64.0


class _Tiles(NamedTuple):
    """A block's pixels by tile: points and normals of shape (3, tiles, pixels), and each tile's box (3, tiles).

    ``wide`` is the number of tiles in a row of them.
    """

    wide: int
    points: Field
    normal: Field
    low: Field
    high: Field


def shade(hits: Hits, rays: Rays, scene: Scene, *, attenuation: str = "min_distance",
          visibility: Visibility | None = None, restrict: bool = True, threads: int | None = None) -> Field:
    """Shade what the rays hit as Lambert reflectors.

    Parameters
    ----------
    hits : Hits
        From `froxel_ref.surface.find_surfaces` with the same rays.
    rays : Rays
        Shape (h, w).
    scene : Scene
        Its lights, ambient and background radiance.
    attenuation : {"min_distance", "inverse_radius"}
        Lower bound of the distance (A6), see `froxel_ref.lights`.
    visibility : mapping of int to callable, optional
        For lights that something may hide: given points and normals, the share of the light that arrives.
    restrict : bool
        Shade with a light only in the tiles whose surfaces lie within its radius. The result is the same without.
    threads : int, optional
        Default: one for each core. The result does not depend on it.

    Returns
    -------
    Field, shape (3, h, w) [W m⁻² sr⁻¹]
        Radiance towards the camera; the background where nothing is hit.

    Notes
    -----
    albedo·(Σ_l E_l·max(N·L, 0)·visibility/π + ambient); the ambient radiance comes from all directions, so
    its irradiance is π times as large. Lights are summed in the scene's order.

    Examples
    --------
    >>> from froxel_ref.geometry import camera_rays
    >>> from froxel_ref.scene import Box, Camera
    >>> from froxel_ref.surface import find_surfaces
    >>> rays = camera_rays(Camera(position=(0, 0, 4), target=(0, 0, 0)), 1, 1)
    >>> hits = find_surfaces([Box()], rays, None)
    >>> shade(hits, rays, Scene(ambient=(1, 2, 3))).ravel().tolist()
    [0.5, 1.0, 1.5]
    """
    shape = hits.depth.shape
    lights = scene.all_lights
    radiance = np.zeros((3, *shape), hits.depth.dtype)

    def light_rows(rows: slice) -> None:
        depth, total = hits.depth[rows], radiance[:, rows]
        empty = np.isinf(depth)
        if lights:
            nearer = np.where(empty, 0.0, depth).astype(depth.dtype)
            points = ray_points(crop_rays(rays, rows, slice(0, shape[1])), nearer)
            tiles = _cut(points, hits.normal[:, rows], empty)
            light = np.zeros_like(tiles.points)
            reached = _reached(lights, rays, tiles) if restrict else [None] * len(lights)
            for number, (source, chosen) in enumerate(zip(lights, reached, strict=True)):
                if chosen is None or chosen.size:
                    _add(light, number, source, chosen, tiles, attenuation, visibility or {})
            total[...] = _joined(light, depth.shape)
        for c in range(3):
            total[c] *= 1.0 / math.pi
            total[c] += scene.ambient[c]
            total[c] *= hits.albedo[c, rows]
            np.copyto(total[c], scene.background[c], where=empty)

    # Whole rows of tiles, so that blocks have the same tiles as the image.
    tall = -(-shape[0] // TILE)
    run(light_rows, (slice(rows.start * TILE, min(rows.stop * TILE, shape[0]))
                     for _, rows in blocks(1, tall, shape[1], size=BLOCK // TILE)), threads=threads)
    return radiance


def _cut(points: Points, normal: Field, empty: NDArray[np.bool_]) -> _Tiles:
    """Lay a block's pixels out by tiles; empty ones are in no box."""
    shape = empty.shape
    places = np.stack([_by_tile(np.broadcast_to(c, shape)) for c in points])
    nothing = _by_tile(empty)
    low = np.where(nothing, np.inf, places).min(axis=2)
    high = np.where(nothing, -np.inf, places).max(axis=2)
    return _Tiles(-(-shape[1] // TILE), places, np.stack([_by_tile(c) for c in normal]), low, high)


def _by_tile(image: NDArray[Any]) -> NDArray[Any]:
    """An image as (tiles, pixels); the last row and column are repeated where they fill no tile."""
    height, width = image.shape
    if height % TILE or width % TILE:
        image = np.pad(image, ((0, -height % TILE), (0, -width % TILE)), mode="edge")
    tall, wide = image.shape[0] // TILE, image.shape[1] // TILE
    return image.reshape(tall, TILE, wide, TILE).transpose(0, 2, 1, 3).reshape(tall * wide, TILE * TILE)


def _joined(tiles: Field, shape: tuple[int, ...]) -> Field:
    """The images (channels, height, width) of `_by_tile`."""
    tall, wide = -(-shape[0] // TILE), -(-shape[1] // TILE)
    whole = tiles.reshape(-1, tall, wide, TILE, TILE).transpose(0, 1, 3, 2, 4)
    return whole.reshape(-1, tall * TILE, wide * TILE)[:, :shape[0], :shape[1]]


def _reached(lights: Sequence[Light], rays: Rays, tiles: _Tiles) -> list[Integers | None]:
    """The tiles whose box each light's sphere meets; None for all of them."""
    result: list[Integers | None] = [None] * len(lights)
    bounded = {i: light for i, light in enumerate(lights)
               if isinstance(light, PointLight) and light.falloff == "windowed"}
    if not bounded:
        return result
    centers = np.array([light.position for light in bounded.values()])
    radii = np.array([light.radius for light in bounded.values()])
    extent = np.abs(centers).max(axis=1) + np.abs(rays.origin).max() + radii
    radii = radii + ROUNDINGS * float(np.finfo(tiles.points.dtype).eps) * extent
    light, tile = _near(centers, radii, tiles)
    met = _meets(centers[light], radii[light], tiles.low[:, tile], tiles.high[:, tile])
    light, tile = light[met], tile[met]
    ends = np.searchsorted(light, np.arange(len(bounded) + 1))
    for place, i in enumerate(bounded):
        chosen = tile[ends[place]:ends[place + 1]]
        result[i] = None if len(chosen) > MOST * tiles.low.shape[1] else chosen
    return result


def _near(centers: Field, radii: Field, tiles: _Tiles) -> tuple[Integers, Integers]:
    """Pairs of a light and a tile, light by light: every tile of the squares whose common box is met."""
    tall, wide = tiles.low.shape[1] // tiles.wide, tiles.wide
    low, high = (part.reduceat(part.reduceat(box.reshape(3, tall, wide), np.arange(0, tall, SQUARE), axis=1),
                               np.arange(0, wide, SQUARE), axis=2)
                 for part, box in ((np.minimum, tiles.low), (np.maximum, tiles.high)))
    light, square = np.nonzero(_meets(centers[:, np.newaxis], radii[:, np.newaxis],
                                      low.reshape(3, -1), high.reshape(3, -1)))
    row, column = np.divmod(square, low.shape[2])
    step = np.arange(SQUARE)
    shape = len(square), SQUARE, SQUARE
    row = np.broadcast_to((row[:, np.newaxis] * SQUARE + step)[:, :, np.newaxis], shape).ravel()
    column = np.broadcast_to((column[:, np.newaxis] * SQUARE + step)[:, np.newaxis], shape).ravel()
    inside = (row < tall) & (column < wide)
    return np.repeat(light, SQUARE * SQUARE)[inside], (row * wide + column)[inside]


def _meets(centers: Field, radii: Field, low: Field, high: Field) -> NDArray[np.bool_]:
    """Whether spheres meet boxes."""
    away = np.zeros(())
    for axis in range(3):
        center = centers[..., axis]
        gap = np.maximum(np.maximum(low[axis] - center, center - high[axis]), 0.0)
        away = away + gap * gap
    return np.asarray(away <= radii * radii)


def _add(light: Field, number: int, source: Light, chosen: Integers | None, tiles: _Tiles, attenuation: str,
         hidden: Visibility) -> None:
    """Add what one light gives the tiles that it reaches, per π and per albedo; a few tiles at a time."""
    count = tiles.points.shape[1] if chosen is None else len(chosen)
    tint = colour(source).tolist()
    for begin in range(0, count, FEW):
        some = slice(begin, begin + FEW)
        part = some if chosen is None else chosen[some]
        nx, ny, nz = tiles.normal[:, part]
        x, y, z = tiles.points[:, part]
        with np.errstate(over="ignore"):  # a floor near the horizon lies farther than its square can tell: 0
            towards, factor = light_at(source, (x, y, z), attenuation=attenuation)
        arriving = factor * np.maximum(dot((nx, ny, nz), towards), 0.0)
        if number in hidden:
            arriving = seen(arriving, hidden[number], (x, y, z), (nx, ny, nz))
        for plane, each in zip(light, tint, strict=True):
            plane[part] += arriving * each
