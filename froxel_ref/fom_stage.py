"""The fom stage bound to a frame: which lights have opacity maps, the maps by name, what lights see by them."""

from __future__ import annotations

from collections.abc import Hashable, Mapping
from typing import Any

import numpy as np
from numpy.typing import DTypeLike

from froxel_ref.arrays import Field, Points, Sight, Visibility
from froxel_ref.assets import Assets
from froxel_ref.billboard_shadows import points_transmittance
from froxel_ref.fom_codes import code_of
from froxel_ref.fom_lookup import OpacityMap, cascade_sight, lamp_sight, pairs_of
from froxel_ref.fom_maps import Dimming, lamp_tiles, make_dimming, sun_cascades
from froxel_ref.fom_plan import (
    assigned_tiles,
    casting_particles,
    dimmed_lamps,
    dimmed_suns,
    dimming_media,
    is_octahedral,
    map_border,
    particle_size,
)
from froxel_ref.fom_resolved import ROUNDINGS, resolve
from froxel_ref.fom_views import CASCADE_REACH, lamp_reach
from froxel_ref.jobs import Same
from froxel_ref.light_paths import light_transmittance
from froxel_ref.scene import DirectionalLight, Medium, NoiseDensity, PointLight, Scene
from froxel_ref.settings import Settings

__all__ = ["LAMPS", "SUNS", "empty_maps", "exact_sights", "map_keys", "map_sights", "opacity_maps"]

LAMPS = ("fom/light", "fom/tile", "fom/range", "fom/matrix", "fom/coefficients", "fom/resolved")
"""Names of the lamps' results."""
SUNS = ("fom/directional_light", "fom/directional_range", "fom/directional_matrix", "fom/directional_coefficients",
        "fom/directional_resolved")
"""Names of the directional lights' results."""


# --- making -----------------------------------------------------------------------------------------


def opacity_maps(scene: Scene, settings: Settings, assets: Assets, *, dtype: DTypeLike = np.float64,
                 threads: int | None = None, known: Mapping[str, Any] | None = None) -> dict[str, Any]:
    """Make the opacity maps of a scene.

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
    [§3.3.4]; see `froxel_ref.fom_maps`. ``coefficients`` are the technique's numbers (`froxel_ref.fom_codes`).

    Examples
    --------
    >>> sorted(opacity_maps(Scene(), Settings(), None))[:2]
    ['fom/coefficients', 'fom/directional_coefficients']
    """
    known = known or {}
    results = {name: known[name] for name in (*LAMPS, *SUNS) if name in known}
    lamps, suns = dimmed_lamps(scene, settings), dimmed_suns(scene)
    old_lamps, old_suns = LAMPS[0] in known, SUNS[0] in known
    some = (lamps and not old_lamps) or (suns and not old_suns)
    dimming = make_dimming(scene if some else Scene(), assets, dtype=dtype)
    if not old_lamps:
        tiles = lamp_tiles(scene, settings, dimming, lamps, assigned_tiles(scene, settings), dtype=dtype,
                           threads=threads)
        results |= dict(zip(LAMPS, (*tiles, None), strict=True))
    if not old_suns:
        cascades = sun_cascades(scene, settings, dimming.of_suns(), suns, dtype=dtype, threads=threads)
        results |= dict(zip(SUNS, (*cascades, None), strict=True))
    for stored, resolved in ((LAMPS[-2:]), (SUNS[-2:])):
        if stored in known:
            continue
        if settings.opacity_maps.storage == "float16":
            results[stored] = code_of(settings.opacity_maps).store(results[stored])
        results[resolved] = _resolved(results[stored], settings, dtype, threads)
    for array in results.values():
        array.flags.writeable = False  # they may be handed on to the next frame
    return results


def _resolved(coefficients: Field, settings: Settings, dtype: DTypeLike, threads: int | None) -> Field:
    """Coefficients (…, 2K + 2, rows, columns) made ready to be read without ringing; nothing for other readings."""
    faces, rows, columns = coefficients.shape[:-3], *coefficients.shape[-2:]
    channels = 7 * (settings.opacity_maps.harmonics + 1)
    if settings.opacity_maps.reconstruction != "resolved":
        return np.zeros((*faces, channels, 0, 0), dtype)
    made = np.empty((*faces, channels, rows, columns), dtype)
    rounding = ROUNDINGS.get(settings.opacity_maps.storage, 0.0)
    for face in np.ndindex(faces) if made.size else ():
        made[face] = resolve(pairs_of(coefficients[face]), rounding=rounding, threads=threads)
    return made


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
    particles = tuple((each, None if each.texture is None else Same(assets.opacities[each.texture]))
                      for each in casting_particles(scene)) if settings.volumetric_shadows == "maps" else ()
    dimming = (media, particles)
    lamps = dimmed_lamps(scene, settings) if any(dimming) else {}
    tiles = assigned_tiles(scene, settings) if lamps else {}
    # A lamp without a window reaches as far as the camera sees.
    reach = tuple(lamp_reach(light, scene.camera, settings.grid) for light in lamps.values())
    suns = tuple(dimmed_suns(scene).items()) if any(dimming) else ()
    return {LAMPS: (fixed, dimming, tuple(lamps.items()), tuple(tiles.items()), reach),
            SUNS: (fixed, dimming, suns, scene.camera if suns else None)}


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
    maps, reading = settings.opacity_maps, code_of(settings.opacity_maps).reading
    lights = scene.all_lights
    numbers, tiles, span, matrix, atlas, resolved = (results[name] for name in LAMPS)
    for number, [(row, column, size)], ends, each in zip(numbers.tolist(), tiles.tolist(), span, matrix, strict=True):
        light = lights[number]
        assert isinstance(light, PointLight)
        tile = np.ascontiguousarray(atlas[:, row:row + size, column:column + size])
        kind = "octahedral" if is_octahedral(light) else "spot"
        found[number] = lamp_sight(
            OpacityMap(kind, tile[np.newaxis], ends[:, 0], ends[:, 1], each, map_border(light, settings),
                       resolved[np.newaxis, :, row:row + size, column:column + size] if resolved.size else None),
            reconstruction=maps.reconstruction, octahedron=settings.fom_octahedron, reading=reading)
    for number, ends, each, planes, resolved in zip(*(results[name] for name in SUNS), strict=True):
        found[int(number)] = cascade_sight(
            OpacityMap("directional", planes, ends[:, 0], ends[:, 1], each, 1, resolved if resolved.size else None),
            reconstruction=maps.reconstruction, lookup=settings.fom_lookup, reading=reading)
    return found


def exact_sights(scene: Scene, settings: Settings, assets: Assets) -> Visibility:
    """What media and particles let through of each light, along a straight way from every point.

    Parameters
    ----------
    scene : Scene
    settings : Settings
    assets : Assets
        Density textures, and particles' opacities.

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
    if not (suns or lamps):
        return {}
    dimming = make_dimming(scene, assets)
    local = dimming.of_suns()
    return {**{number: _exact(light, dimming, settings) for number, light in lamps.items()},
            **{number: _exact(light, local, settings) for number, light in suns.items()}}


def _exact(light: DirectionalLight | PointLight, dimming: Dimming, settings: Settings) -> Sight:
    placed = list(dimming.media.values())
    extinction = np.array([[dimming.extinction[i]] for i in dimming.media]).reshape(-1, 1)

    def see(points: Points, normal: Points | None = None) -> Field:
        passed = light_transmittance(placed, extinction, light, points, settings=settings,
                                     sun_distance=CASCADE_REACH)[0]
        if dimming.particles.size.size:
            passed = passed * points_transmittance(dimming.particles, light, points, size=particle_size(settings))
        return np.asarray(passed.astype(np.result_type(*points), copy=False))

    return see

