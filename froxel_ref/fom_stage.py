"""The fom stage bound to a frame: which lights have Fourier opacity maps, the maps by name, what lights see by them."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Hashable, Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import DTypeLike

from froxel_ref import blocks, storage
from froxel_ref.arrays import Field, Points, Sight, Visibility
from froxel_ref.assets import Assets
from froxel_ref.density import Placed, place
from froxel_ref.fom import PUBLISHED_LEAST_TRANSMITTANCE
from froxel_ref.fom_lookup import OpacityMap, cascade_sight, lamp_sight, planes_of
from froxel_ref.fom_march import DITHER, Marching, Span, media_coefficients, media_span
from froxel_ref.fom_plan import (
    assigned_tiles,
    dimmed_lamps,
    dimmed_suns,
    dimming_media,
    faces_shape,
    meets,
    used_texels,
)
from froxel_ref.fom_views import CASCADE_REACH, cascade_lines, lamp_directions, lamp_reach, opacity_cascades
from froxel_ref.geometry import Lines
from froxel_ref.jobs import Same
from froxel_ref.light_paths import light_transmittance
from froxel_ref.light_raster import LightRaster
from froxel_ref.scene import DirectionalLight, LocalMedium, Medium, NoiseDensity, PointLight, Scene
from froxel_ref.settings import Settings
from froxel_ref.shadow import map_kind
from froxel_ref.shadow_filters import pad_octahedral
from froxel_ref.shadow_views import raster_from_world, spot_view

__all__ = ["LAMPS", "SUNS", "empty_maps", "exact_sights", "map_keys", "map_sights", "opacity_maps"]

LAMPS = ("fom/light", "fom/tile", "fom/range", "fom/matrix", "fom/coefficients")
"""Names of the lamps' results."""
SUNS = ("fom/directional_light", "fom/directional_range", "fom/directional_matrix", "fom/directional_coefficients")
"""Names of the directional lights' results."""

# Rays that are worked on at a time: fewer make calls so short that threads wait for the interpreter.
RAYS = 8192

# The thesis's program covers this depth of a directional light, about its cascade's plane (A8) [m].
FIXED_DEPTH = 300.0


# --- making -----------------------------------------------------------------------------------------


class _Media(NamedTuple):
    """What dims, made ready: media by number, and their extinctions by the same."""

    placed: dict[int, Placed]
    extinction: dict[int, float]


def _media(scene: Scene, assets: Assets, dtype: DTypeLike, *, local_only: bool = False) -> _Media:
    """A texture whose texels are all alike is a factor, and no reason to march."""
    placed, extinction = {}, {}
    for number, medium in dimming_media(scene, local_only=local_only).items():
        texels = None if medium.density is None else assets.textures[medium.density.source]
        factor = 1.0
        if texels is not None and texels.min() == texels.max():
            factor, texels, medium = float(texels.flat[0]), None, dataclasses.replace(medium, density=None)
        if factor > 0.0:
            placed[number] = place(medium, texels, dtype=dtype)
            extinction[number] = float(np.max(medium.extinction)) * factor
    return _Media(placed, extinction)


def _marching(settings: Settings) -> Marching:
    maps = settings.opacity_maps
    most = -np.log(PUBLISHED_LEAST_TRANSMITTANCE) if settings.fom_opacity == "clamped" else np.inf
    return Marching(settings.fom_samples, float(most), maps.step, maps.most_steps, settings.time,
                    settings.density_addressing)


def opacity_maps(scene: Scene, settings: Settings, assets: Assets, *, dtype: DTypeLike = np.float64,
                 threads: int | None = None, known: Mapping[str, Any] | None = None) -> dict[str, Any]:
    """Make the Fourier opacity maps of a scene.

    Parameters
    ----------
    scene : Scene
        Its media, lights and camera.
    settings : Settings
        Its opacity_maps, and the switches that begin with fom.
    assets : Assets
        Density textures.
    dtype : data type
        Of the coefficients.
    threads : int, optional
        Default: one for each core. The result does not depend on it.
    known : mapping of str to ndarray, optional
        Maps that have not changed since they were made, by result name; they are handed on.

    Returns
    -------
    dict of str to ndarray
        `LAMPS` and `SUNS`. Not to be written to: the next frame may take them over.

    Notes
    -----
    A lamp's texels look along the rays from it [Dörries 2020, §3.3.3], a directional light's through its cascades
    [§3.3.4]; what they gather is `froxel_ref.fom_march.media_coefficients`. Only the corner of the atlas that holds
    tiles is kept.

    Examples
    --------
    >>> sorted(opacity_maps(Scene(), Settings(), None))[:2]
    ['fom/coefficients', 'fom/directional_coefficients']
    """
    known, kind = known or {}, np.zeros(0, dtype).dtype
    results = {name: known[name] for name in (*LAMPS, *SUNS) if name in known}
    for names, make in ((LAMPS, _lamps), (SUNS, _suns)):
        if names[0] not in results:
            results |= dict(zip(names, make(scene, settings, assets, kind, threads), strict=True))
    if settings.opacity_maps.storage == "float16":
        for name in ("fom/coefficients", "fom/directional_coefficients"):
            if name not in known:
                results[name] = storage.store(results[name], "float16")
    for array in results.values():
        array.flags.writeable = False  # they may be handed on to the next frame
    return results


def empty_maps(settings: Settings, dtype: DTypeLike = np.float64) -> dict[str, Any]:
    """What stands for the stage where it is left out: no maps.

    Parameters
    ----------
    settings : Settings
    dtype : data type

    Returns
    -------
    dict of str to ndarray
        Arrays with an axis of length 0.

    Examples
    --------
    >>> empty_maps(Settings())["fom/coefficients"].shape
    (8, 0, 0)
    """
    return opacity_maps(Scene(), settings, None, dtype=dtype)  # type: ignore[arg-type]


def _lamps(scene: Scene, settings: Settings, assets: Assets, dtype: np.dtype[np.floating], threads: int | None
           ) -> tuple[Any, ...]:
    """Numbers, tiles, ranges, matrices, and the atlas."""
    maps, lamps = settings.opacity_maps, dimmed_lamps(scene, settings)
    wanted = assigned_tiles(scene, settings)
    held = {i: each.tile for i, each in wanted.items() if each.tile is not None}
    atlas = np.zeros((2 * maps.harmonics + 2, *used_texels(wanted)), dtype)
    span = np.zeros((len(held), 1, 2))
    media = _media(scene, assets, dtype) if held else _Media({}, {})
    tasks: list[Callable[[], None]] = []
    for k, (number, tile) in enumerate(held.items()):
        out = atlas[:, tile.row:tile.row + tile.size, tile.column:tile.column + tile.size]
        tasks += _lamp_tasks(lamps[number], scene, settings, media, out, span[k, 0])
    blocks.run(lambda task: task(), tasks, threads=threads)
    for number, tile in held.items():
        if _octahedral(lamps[number]) and maps.gutter:
            out = atlas[:, tile.row:tile.row + tile.size, tile.column:tile.column + tile.size]
            inner = slice(maps.gutter, tile.size - maps.gutter)
            out[...] = pad_octahedral(out[:, inner, inner], maps.gutter)
    matrix = [_lamp_matrix(lamps[number], tile.size, settings) for number, tile in held.items()]
    tiles = np.array([tuple(tile) for tile in held.values()], np.int64)
    return (np.array(list(held), np.int64), tiles.reshape(-1, 1, 3), span, np.array(matrix).reshape(-1, 1, 3, 4),
            atlas)


def _octahedral(light: PointLight) -> bool:
    return map_kind(light) == "point"


def _border(light: PointLight, settings: Settings) -> int:
    """Texels around a lamp's map; the thesis's program has none on spot lights' tiles (A3)."""
    mirrored = not _octahedral(light) and settings.fom_spot == "mirrored"
    return 0 if mirrored else settings.opacity_maps.gutter


def _lamp_matrix(light: PointLight, size: int, settings: Settings) -> Field:
    """From the world to texels and depth of a spot light, to the position relative to an octahedron."""
    if _octahedral(light):
        return np.concatenate([np.eye(3), -np.reshape(light.position, (3, 1))], axis=1)
    return raster_from_world(spot_view(light, size, border=_border(light, settings)))  # type: ignore[arg-type]


def _lamp_tasks(light: PointLight, scene: Scene, settings: Settings, media: _Media, out: Field, span: Field
                ) -> list[Callable[[], None]]:
    """Fill a lamp's tile (an octahedron's without its gutter), a few rows of texels at a time."""
    maps, octahedral = settings.opacity_maps, _octahedral(light)
    ways = lamp_directions(light, out.shape[-1], gutter=_border(light, settings), spot=settings.fom_spot,
                           octahedron=settings.fom_octahedron)
    target = out
    if octahedral and maps.gutter:
        inner = slice(maps.gutter, out.shape[-1] - maps.gutter)
        ways, target = ways[:, inner, inner], out[:, inner, inner]
    reach = lamp_reach(light, scene.camera, settings.grid)
    near = media._replace(placed={i: placed for i, placed in media.placed.items()
                                  if meets(light, placed.medium, reach)})
    size = target.shape[-1]

    def lines(rows: slice) -> Lines:
        some = np.ascontiguousarray(ways[:, rows]).reshape(3, -1)
        count = some.shape[1]
        origin = np.broadcast_to(np.reshape(light.position, (3, 1)), some.shape).astype(np.float64)
        return Lines(origin, some, np.zeros(count), np.full(count, reach))

    span[:] = _lamp_span(near.placed, lines(slice(0, size)), reach, settings)
    if not span[1] > span[0]:
        return []
    return _row_tasks(near, lines, Span(span[:1], span[1:]), target, settings, whole=True)


def _lamp_span(media: Mapping[int, Placed], lines: Lines, reach: float, settings: Settings) -> tuple[float, float]:
    """The depths that a lamp's map covers: all that its light reaches, or what is dimmed of that (A8)."""
    if settings.fom_range != "bounded" or any(not isinstance(p.medium, LocalMedium) for p in media.values()):
        return 0.0, reach
    span = media_span(list(media.values()), lines)
    near, far = float(span.near.min()), float(span.far.max())
    return (near, far) if far > near else (0.0, 0.0)


def _row_tasks(media: _Media, lines: Callable[[slice], Lines], span: Span, target: Field, settings: Settings, *,
               whole: bool) -> list[Callable[[], None]]:
    """Tasks that fill a map's rows; the result does not depend on how many there are to a task."""
    size, how = target.shape[-1], _marching(settings)
    deep = max(1, RAYS // size)

    def fill(rows: slice) -> None:
        some = lines(rows)
        part = Span(*(end if end.size == 1 else end.reshape(size, size)[rows].reshape(-1) for end in span))
        dither = np.broadcast_to(DITHER[np.arange(rows.start, rows.stop)[:, np.newaxis] % 4, np.arange(size) % 4],
                                 (rows.stop - rows.start, size)).reshape(-1)
        made = media_coefficients(media.placed, media.extinction, some, part, harmonics=settings.opacity_maps.harmonics,
                                  marching=how, whole=whole, dither=dither, dtype=target.dtype)
        made = np.broadcast_to(made, (*made.shape[:2], some.start.size))
        target[:, rows] = planes_of(made).reshape(-1, rows.stop - rows.start, size)

    pieces = [slice(begin, min(begin + deep, size)) for begin in range(0, size, deep)]
    return [lambda rows=rows: fill(rows) for rows in pieces]  # type: ignore[misc]


def _suns(scene: Scene, settings: Settings, assets: Assets, dtype: np.dtype[np.floating], threads: int | None
          ) -> tuple[Any, ...]:
    """Numbers, ranges, matrices, and coefficients."""
    suns = dimmed_suns(scene)
    shape = faces_shape(settings)
    coefficients = np.zeros((len(suns), *shape), dtype)
    span = np.zeros((len(suns), shape[0], 2, *shape[2:]), dtype)
    matrix = np.zeros((len(suns), shape[0], 3, 4))
    media = _media(scene, assets, dtype, local_only=True) if suns else _Media({}, {})
    tasks: list[Callable[[], None]] = []
    for k, light in enumerate(suns.values()):
        views = opacity_cascades(light, scene.camera, settings.grid, settings.shadow_maps, settings.opacity_maps)
        for face, view in enumerate(views):
            matrix[k, face] = raster_from_world(view)
            tasks.append(_cascade_task(view, media, coefficients[k, face], span[k, face], settings))
    blocks.run(lambda task: task(), tasks, threads=threads)
    return np.array(list(suns), np.int64), span, matrix, coefficients


def _cascade_task(view: LightRaster, media: _Media, out: Field, ends: Field, settings: Settings) -> Callable[[], None]:
    def fill() -> None:
        lines = cascade_lines(view)
        span = media_span(list(media.placed.values()), lines)
        met = span.far > span.near
        if settings.fom_range == "fixed":
            half = np.full(met.shape, 0.5 * FIXED_DEPTH)
            span = Span(-half, half)
        # Rounded first, so that a lookup has the very range that the coefficients are made for.
        near, far = (np.where(met, end, 0.0).astype(out.dtype).astype(np.float64) for end in span)
        ends[0], ends[1] = near.reshape(ends.shape[1:]), far.reshape(ends.shape[1:])
        if not met.any():
            return
        size = out.shape[-1]

        def some(rows: slice) -> Lines:
            chosen = slice(rows.start * size, rows.stop * size)
            return Lines(*(field[..., chosen] for field in lines))

        for task in _row_tasks(media, some, Span(near, far), out, settings, whole=False):
            task()

    return fill


# --- what has not changed ---------------------------------------------------------------------------


def map_keys(scene: Scene, settings: Settings, assets: Assets) -> dict[tuple[str, ...], Hashable]:
    """What the maps depend on: equal keys mean equal maps.

    Parameters
    ----------
    scene, settings, assets
        As for `opacity_maps`.

    Returns
    -------
    dict of tuple of str to hashable
        By the results' names.

    Examples
    --------
    >>> here, there = (map_keys(Scene(), Settings(time=t), None) for t in (0.0, 0.0))
    >>> here == there
    True
    """
    fixed = (settings.opacity_maps, settings.shadow_maps, settings.precision, settings.time, settings.grid,
             settings.fidelity, settings.switches)
    media = tuple((medium, _texels(medium, assets)) for medium in dimming_media(scene).values()
                  ) if settings.volumetric_shadows == "maps" else ()
    lamps = dimmed_lamps(scene, settings) if media else {}
    tiles = assigned_tiles(scene, settings) if lamps else {}
    # A lamp without a window reaches as far as the camera sees.
    reach = tuple(lamp_reach(light, scene.camera, settings.grid) for light in lamps.values())
    suns = tuple(dimmed_suns(scene).items()) if media else ()
    return {LAMPS: (fixed, media, tuple(lamps.items()), tuple(tiles.items()), reach),
            SUNS: (fixed, media, suns, scene.camera if suns else None)}


def _texels(medium: Medium, assets: Assets) -> Hashable:
    """What a density texture holds: noise is what its record says."""
    if medium.density is None or isinstance(medium.density.source, NoiseDensity):
        return None
    return Same(assets.textures[medium.density.source])


# --- what lights see --------------------------------------------------------------------------------


def map_sights(results: Mapping[str, Any], scene: Scene, settings: Settings) -> Visibility:
    """What media and particles let through of each light, by the maps among a frame's results.

    Parameters
    ----------
    results : mapping of str to ndarray
        With `LAMPS` and `SUNS`.
    scene, settings
        As for `opacity_maps`.

    Returns
    -------
    mapping of int to callable
        See `froxel_ref.arrays.Visibility`.

    Examples
    --------
    >>> map_sights(empty_maps(Settings()), Scene(), Settings())
    {}
    """
    found: dict[int, Sight] = {}
    maps = settings.opacity_maps
    lights = scene.all_lights
    numbers, tiles, span, matrix, atlas = (results[name] for name in LAMPS)
    for number, [(row, column, size)], ends, each in zip(numbers.tolist(), tiles.tolist(), span, matrix, strict=True):
        light = lights[number]
        assert isinstance(light, PointLight)
        tile = np.ascontiguousarray(atlas[:, row:row + size, column:column + size])
        kind = "octahedral" if _octahedral(light) else "spot"
        found[number] = lamp_sight(
            OpacityMap(kind, tile[np.newaxis], ends[:, 0], ends[:, 1], each, _border(light, settings)),
            reconstruction=maps.reconstruction, octahedron=settings.fom_octahedron)
    for number, ends, each, planes in zip(*(results[name] for name in SUNS), strict=True):
        found[int(number)] = cascade_sight(
            OpacityMap("directional", planes, ends[:, 0], ends[:, 1], each, 1),
            reconstruction=maps.reconstruction, lookup=settings.fom_lookup)
    return found


def exact_sights(scene: Scene, settings: Settings, assets: Assets) -> Visibility:
    """What media let through of each light, along a straight way from every point.

    Parameters
    ----------
    scene : Scene
    settings : Settings
    assets : Assets
        Density textures.

    Returns
    -------
    mapping of int to callable
        Of the lights that have maps, and by the same media: what the maps are measured against.

    Examples
    --------
    >>> exact_sights(Scene(), Settings(), None)
    {}
    """
    suns, lamps = dimmed_suns(scene), dimmed_lamps(scene, settings)
    found: dict[int, Sight] = {}
    for lights, local_only in ((lamps, False), (suns, True)):
        if lights:
            media = _media(scene, assets, np.float64, local_only=local_only)
            found |= {number: _exact(light, media, settings) for number, light in lights.items()}
    return found


def _exact(light: DirectionalLight | PointLight, media: _Media, settings: Settings) -> Sight:
    placed = list(media.placed.values())
    extinction = np.array([[media.extinction[i]] for i in media.placed])

    def see(points: Points, normal: Points | None = None) -> Field:
        passed = light_transmittance(placed, extinction, light, points, settings=settings, sun_distance=CASCADE_REACH)
        return np.asarray(passed[0].astype(np.result_type(*points), copy=False))

    return see

