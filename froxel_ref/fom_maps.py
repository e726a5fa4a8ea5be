"""Making opacity maps: tiles of lamps and cascades of suns, filled with what dims their texels' rays."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import DTypeLike, NDArray

from froxel_ref import blocks
from froxel_ref.arrays import Field
from froxel_ref.assets import Assets
from froxel_ref.billboard_shadows import Crossings, lamp_hits, sun_hits
from froxel_ref.billboards import Particles, placed_particles
from froxel_ref.density import Placed, place
from froxel_ref.fom import PUBLISHED_LEAST_TRANSMITTANCE
from froxel_ref.fom_codes import code_of
from froxel_ref.fom_march import DITHER, Marching, Span, media_numbers, media_span
from froxel_ref.fom_particles import KEPT, Crossed, add_crossings, casting, crossed, crossing_span
from froxel_ref.fom_plan import (
    dimming_media,
    faces_shape,
    is_octahedral,
    map_border,
    meets,
    particle_size,
    used_texels,
)
from froxel_ref.fom_views import Wanted, cascade_lines, lamp_directions, lamp_reach, opacity_cascades
from froxel_ref.geometry import Lines
from froxel_ref.light_raster import LightRaster
from froxel_ref.scene import DirectionalLight, LocalMedium, PointLight, Scene
from froxel_ref.settings import Settings
from froxel_ref.shadow_filters import pad_octahedral
from froxel_ref.shadow_views import raster_from_world, spot_view

__all__ = ["Cascades", "Dimming", "Tiles", "lamp_tiles", "make_dimming", "sun_cascades"]

Type: TypeAlias = "np.dtype[np.floating]"

# Rays that are worked on at a time: fewer make calls so short that threads wait for the interpreter.
RAYS = 8192

# The thesis's program covers this depth of a directional light, about its cascade's plane (A8) [m].
FIXED_DEPTH = 300.0


class Dimming(NamedTuple):
    """All that dims light, made ready.

    Attributes
    ----------
    media : dict of int to Placed
        By their place among the global and then the local media.
    extinction : dict of int to float [1/m]
        At density 1, by the same.
    particles : Particles
        Those that cast.
    """

    media: dict[int, Placed]
    extinction: dict[int, float]
    particles: Particles

    def of_suns(self) -> Dimming:
        """Without global media, which have no end towards a directional light."""
        local = {i: placed for i, placed in self.media.items() if isinstance(placed.medium, LocalMedium)}
        return self._replace(media=local, extinction={i: self.extinction[i] for i in local})


class Tiles(NamedTuple):
    """The maps of lamps, m of them: fields as in the results ``fom/…`` (`froxel_ref.quantities`)."""

    light: NDArray[np.int64]
    tile: NDArray[np.int64]
    range: Field
    matrix: Field
    coefficients: Field


class Cascades(NamedTuple):
    """The maps of directional lights: fields as in the results ``fom/directional_…``."""

    light: NDArray[np.int64]
    range: Field
    matrix: Field
    coefficients: Field


def make_dimming(scene: Scene, assets: Assets, *, dtype: DTypeLike = np.float64) -> Dimming:
    """Make ready what dims light in a scene.

    Parameters
    ----------
    scene : Scene
    assets : Assets
        Density textures, and particles' opacities.
    dtype : data type
        Of the arithmetic to come; particles are float64.

    Returns
    -------
    Dimming
        A texture whose texels are all alike is a factor there, and no reason to march.

    Examples
    --------
    >>> from froxel_ref.assets import load_assets
    >>> from froxel_ref.scene import Medium
    >>> scene = Scene(global_media=(Medium(extinction=0.5),))
    >>> make_dimming(scene, load_assets(scene, None)).extinction
    {0: 0.5}
    """
    placed, extinction = {}, {}
    for number, medium in dimming_media(scene).items():
        texels = None if medium.density is None else assets.textures[medium.density.source]
        factor = 1.0
        if texels is not None and texels.min() == texels.max():
            factor, texels, medium = float(texels.flat[0]), None, dataclasses.replace(medium, density=None)
        if factor > 0.0:
            placed[number] = place(medium, texels, dtype=dtype)
            extinction[number] = float(np.max(medium.extinction)) * factor
    return Dimming(placed, extinction, casting(placed_particles(scene, assets)))


def _marching(settings: Settings) -> Marching:
    maps, least = settings.opacity_maps, _least(settings)
    return Marching(settings.fom_samples, -float(np.log(least)) if least else np.inf, maps.step, maps.most_steps,
                    settings.time, settings.density_addressing)


def _least(settings: Settings) -> float | None:
    """What a sample lets through at least (D8)."""
    return PUBLISHED_LEAST_TRANSMITTANCE if settings.fom_opacity == "clamped" else None


# --- lamps ------------------------------------------------------------------------------------------


class _Lamp(NamedTuple):
    """A lamp's map in the making: its texels' directions (of an octahedron without its gutter), and where they go."""

    light: PointLight
    ways: Field
    target: Field
    reach: float
    media: dict[int, Placed]
    particles: Crossed

    def lines(self, rows: slice) -> Lines:
        """The rays of some rows of texels."""
        some = np.ascontiguousarray(self.ways[:, rows]).reshape(3, -1)
        origin = np.broadcast_to(np.reshape(self.light.position, (3, 1)), some.shape).astype(np.float64)
        return Lines(origin, some, np.zeros(some.shape[1]), np.full(some.shape[1], self.reach))


def lamp_tiles(scene: Scene, settings: Settings, dimming: Dimming, lamps: Mapping[int, PointLight],
               wanted: Mapping[int, Wanted], *, dtype: DTypeLike = np.float64, threads: int | None = None) -> Tiles:
    """Fill the atlas.

    Parameters
    ----------
    scene : Scene
        Its camera, for lamps without a window.
    settings : Settings
    dimming : Dimming
    lamps : mapping of int to PointLight
        By index.
    wanted : mapping of int to Wanted
        Their tiles, from `froxel_ref.fom_views.assign_tiles`.
    dtype : data type
        Of the coefficients.
    threads : int, optional
        Default: one for each core. The result does not depend on it.

    Returns
    -------
    Tiles
        Of lamps that have a tile. Only the corner of the atlas that holds tiles is kept.

    Notes
    -----
    Every texel's ray gathers media and particles [Dörries 2020, §3.3.3]. The range is one for a whole map, so that
    bilinear lookups mix what may be mixed: [0, radius] where a medium is everywhere, else from the nearest to the
    farthest that dims on any ray (A8: always the radius).

    Examples
    --------
    >>> from froxel_ref.assets import load_assets
    >>> from froxel_ref.fom_views import assign_tiles
    >>> from froxel_ref.scene import Medium
    >>> scene = Scene(global_media=(Medium(extinction=0.5),))
    >>> lamps = {0: PointLight(position=(0, 0, 0), intensity=(1, 1, 1), radius=4)}
    >>> how = Settings()
    >>> wanted = assign_tiles(lamps, scene.camera, how.opacity_maps)
    >>> tiles = lamp_tiles(scene, how, make_dimming(scene, load_assets(scene, None)), lamps, wanted)
    >>> tiles.coefficients.shape, tiles.coefficients[:, 5, 5].tolist()  # a_0 = 2·0.5·4
    ((8, 256, 256), [4.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    """
    held = {i: each.tile for i, each in wanted.items() if each.tile is not None}
    atlas = np.zeros((settings.opacity_maps.channels, *used_texels(wanted)), dtype)
    code = code_of(settings.opacity_maps)
    outs = [atlas[:, t.row:t.row + t.size, t.column:t.column + t.size] for t in held.values()]
    made: list[_Lamp | None] = [None] * len(held)
    spans = np.zeros((len(held), 1, 2))

    def look(k: int) -> None:
        made[k] = lamp = _lamp(lamps[list(held)[k]], outs[k], scene, settings, dimming, KEPT // len(held))
        spans[k, 0] = _lamp_span(lamp, settings)

    blocks.run(look, range(len(held)), threads=threads)
    every = [lamp for lamp in made if lamp is not None]
    tasks = [task for lamp, [(near, far)] in zip(every, spans.tolist(), strict=True) if far > near
             for task in _row_tasks(lamp.media, dimming.extinction, lamp.lines, Span(np.full(1, near), np.full(1, far)),
                                    lamp.target, settings, whole=True)]
    blocks.run(lambda task: task(), tasks, threads=threads)

    def finish(k: int) -> None:
        near, far = spans[k, 0, :1], spans[k, 0, 1:]
        for _, crossings in every[k].particles():
            add_crossings(every[k].target, crossings, near, far, code=code)
        gutter = (outs[k].shape[-1] - every[k].target.shape[-1]) // 2
        if gutter:
            outs[k][...] = pad_octahedral(every[k].target.copy(), gutter)

    blocks.run(finish, range(len(held)), threads=threads)
    matrix = [_lamp_matrix(lamps[number], tile.size, settings) for number, tile in held.items()]
    return Tiles(np.array(list(held), np.int64), np.array(list(held.values()), np.int64).reshape(-1, 1, 3), spans,
                 np.array(matrix).reshape(-1, 1, 3, 4), atlas)


def _lamp(light: PointLight, out: Field, scene: Scene, settings: Settings, dimming: Dimming, keep: int) -> _Lamp:
    gutter = map_border(light, settings)
    ways = lamp_directions(light, out.shape[-1], gutter=gutter, spot=settings.fom_spot,
                           octahedron=settings.fom_octahedron)
    target = out
    if is_octahedral(light) and gutter:
        inner = slice(gutter, out.shape[-1] - gutter)
        ways, target = ways[:, inner, inner], out[:, inner, inner]
    reach = lamp_reach(light, scene.camera, settings.grid)
    near = {i: placed for i, placed in dimming.media.items() if meets(light, placed.medium, reach)}
    flat = np.ascontiguousarray(ways).reshape(3, -1)

    def cross(some: Particles) -> Crossings:
        ray, particle, distance, tau = lamp_hits(
            some, light.position, flat, depth=settings.fom_particles, size=particle_size(settings),
            least_transmittance=_least(settings))
        reached = distance < reach
        return Crossings(ray[reached], particle[reached], distance[reached], tau[reached])

    return _Lamp(light, ways, target, reach, near, crossed(dimming.particles, cross, rays=flat.shape[1], keep=keep))


def _lamp_span(lamp: _Lamp, settings: Settings) -> tuple[float, float]:
    """The depths that a lamp's map covers."""
    everywhere = any(not isinstance(placed.medium, LocalMedium) for placed in lamp.media.values())
    if settings.fom_range != "bounded" or everywhere:
        return 0.0, lamp.reach
    span = media_span(list(lamp.media.values()), lamp.lines(slice(None)))
    near, far = crossing_span(lamp.particles, span.near.size, size=particle_size(settings))
    low, high = float(min(span.near.min(), near.min())), float(max(span.far.max(), far.max()))
    return (max(low, 0.0), min(high, lamp.reach)) if high > low else (0.0, 0.0)


def _lamp_matrix(light: PointLight, size: int, settings: Settings) -> Field:
    """From the world to texels and depth of a spot light, to the position relative to an octahedron."""
    if is_octahedral(light):
        return np.concatenate([np.eye(3), -np.reshape(light.position, (3, 1))], axis=1)
    return raster_from_world(spot_view(light, size, border=map_border(light, settings)))  # type: ignore[arg-type]


def _row_tasks(media: Mapping[int, Placed], extinction: Mapping[int, float], lines: Callable[[slice], Lines],
               span: Span, target: Field, settings: Settings, *, whole: bool) -> list[Callable[[], None]]:
    """Tasks that fill a map's rows with media; the result does not depend on how many there are to a task."""
    size, how, code = target.shape[-1], _marching(settings), code_of(settings.opacity_maps)
    deep = max(1, RAYS // size)

    def fill(rows: slice) -> None:
        some = lines(rows)
        part = Span(*(end if end.size == 1 else end.reshape(size, size)[rows].reshape(-1) for end in span))
        dither = np.broadcast_to(DITHER[np.arange(rows.start, rows.stop)[:, np.newaxis] % 4, np.arange(size) % 4],
                                 (rows.stop - rows.start, size)).reshape(-1)
        made = media_numbers(media, extinction, some, part, code=code, marching=how, whole=whole, dither=dither,
                             dtype=target.dtype)
        made = np.broadcast_to(made, (len(made), some.start.size))
        target[:, rows] = made.reshape(-1, rows.stop - rows.start, size)

    pieces = [slice(begin, min(begin + deep, size)) for begin in range(0, size, deep)]
    return [lambda rows=rows: fill(rows) for rows in pieces] if media else []  # type: ignore[misc]


# --- suns -------------------------------------------------------------------------------------------


def sun_cascades(scene: Scene, settings: Settings, dimming: Dimming, suns: Mapping[int, DirectionalLight], *,
                 dtype: DTypeLike = np.float64, threads: int | None = None) -> Cascades:
    """Fill the cascades of directional lights.

    Parameters
    ----------
    scene : Scene
        Its camera.
    settings : Settings
    dimming : Dimming
        From `Dimming.of_suns`.
    suns : mapping of int to DirectionalLight
        By index.
    dtype : data type
        Of the coefficients and ranges.
    threads : int, optional
        Default: one for each core. The result does not depend on it.

    Returns
    -------
    Cascades

    Notes
    -----
    Each texel's range is from the nearest to the farthest medium or particle on its ray [Dörries 2020, §3.3.4]
    (A8: 300 m about the cascade's plane); 0 to 0 where there is none.

    Examples
    --------
    >>> from froxel_ref.assets import load_assets
    >>> scene = Scene(local_media=(LocalMedium(extinction=0.5),))
    >>> suns = {0: DirectionalLight(direction=(0, 1, 0), irradiance=(1, 1, 1))}
    >>> made = sun_cascades(scene, Settings(), make_dimming(scene, load_assets(scene, None)), suns)
    >>> made.coefficients.shape, float(made.coefficients[0, 0, 0].max().round(9))  # 2·0.5·2 m
    ((1, 4, 8, 256, 256), 2.0)
    """
    shape = faces_shape(settings)
    coefficients = np.zeros((len(suns), *shape), dtype)
    span = np.zeros((len(suns), shape[0], 2, *shape[2:]), dtype)
    matrix = np.zeros((len(suns), shape[0], 3, 4))
    tasks: list[Callable[[], None]] = []
    for k, light in enumerate(suns.values()):
        views = opacity_cascades(light, scene.camera, settings.grid, settings.shadow_maps, settings.opacity_maps)
        for face, view in enumerate(views):
            matrix[k, face] = raster_from_world(view)
            tasks.append(_cascade_task(light, view, dimming, coefficients[k, face], span[k, face], settings,
                                       KEPT // (len(suns) * shape[0])))
    blocks.run(lambda task: task(), tasks, threads=threads)
    return Cascades(np.array(list(suns), np.int64), span, matrix, coefficients)


def _cascade_task(light: DirectionalLight, view: LightRaster, dimming: Dimming, out: Field, ends: Field,
                  settings: Settings, keep: int) -> Callable[[], None]:
    size, code = out.shape[-1], code_of(settings.opacity_maps)

    def fill() -> None:
        lines = cascade_lines(view)
        x, y, z = light.direction
        particles = crossed(dimming.particles, lambda some: sun_hits(
            some, np.asarray(lines.origin, np.float64), (-x, -y, -z), depth=settings.fom_particles,
            size=particle_size(settings), least_transmittance=_least(settings)), rays=size * size, keep=keep)
        span = _cascade_span(lines, particles, dimming, settings)
        # Rounded first, so that a lookup has the very range that the coefficients are made for.
        near, far = (end.astype(out.dtype) for end in span)
        ends[0], ends[1] = near.reshape(size, size), far.reshape(size, size)
        near, far = near.astype(np.float64), far.astype(np.float64)
        if not (far > near).any():
            return

        def some(rows: slice) -> Lines:
            chosen = slice(rows.start * size, rows.stop * size)
            return Lines(*(field[..., chosen] for field in lines))

        for task in _row_tasks(dimming.media, dimming.extinction, some, Span(near, far), out, settings, whole=False):
            task()
        for _, crossings in particles():
            add_crossings(out, crossings, near, far, code=code)

    return fill


def _cascade_span(lines: Lines, particles: Crossed, dimming: Dimming, settings: Settings) -> Span:
    """The depths that each texel covers; 0 to 0 where nothing lies on its ray."""
    media = media_span(list(dimming.media.values()), lines)
    near, far = crossing_span(particles, media.near.size, size=particle_size(settings))
    near, far = np.minimum(near, media.near), np.maximum(far, media.far)
    met = far > near
    if settings.fom_range == "fixed":
        near, far = np.full(met.shape, -0.5 * FIXED_DEPTH), np.full(met.shape, 0.5 * FIXED_DEPTH)
    return Span(np.where(met, near, 0.0), np.where(met, far, 0.0))
