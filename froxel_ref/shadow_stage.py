"""The shadow stage bound to a frame: which maps a scene needs, their results by name, and what lights see by them."""

from __future__ import annotations

import dataclasses
from collections.abc import Hashable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import DTypeLike

from froxel_ref.arrays import Field, Points, Sight, Visibility
from froxel_ref.assets import Assets
from froxel_ref.jobs import Same
from froxel_ref.scene import DirectionalLight, HeightField, HeightsFile, Light, Mesh, Scene, SpotLight, Surface
from froxel_ref.settings import Settings
from froxel_ref.shadow import KINDS, Stack, make_stack, map_kind, map_of, map_shape, shadowed_lights
from froxel_ref.shadow_lookup import roundings, sight
from froxel_ref.shadow_raster import casters
from froxel_ref.shadow_views import cascade_views
from froxel_ref.visibility import exact_visibility, occluders

__all__ = ["NAMES", "empty_maps", "exact_sights", "map_bytes", "map_keys", "map_lights", "map_sights",
           "needs_maps", "shadow_maps"]

NAMES = {kind: tuple(f"shadow/{kind}_{field}" for field in Stack._fields) for kind in KINDS}
"""The results' names, a tuple for each kind of light in the order of `froxel_ref.shadow.Stack`."""


def needs_maps(scene: Scene, settings: Settings) -> tuple[bool, str]:
    """Whether a frame needs shadow maps, and why.

    Parameters
    ----------
    scene : Scene
    settings : Settings

    Returns
    -------
    needed : bool
    why : str

    Examples
    --------
    >>> needs_maps(Scene(), Settings())
    (False, 'the scene has nothing that casts a shadow')
    """
    if settings.shadows == "off":
        return False, "shadows are off"
    mapped = any(light.shadow_map is not None for light in scene.lights)
    if not mapped and not any(surface.casts_shadows for surface in scene.surfaces):
        return False, "the scene has nothing that casts a shadow"
    found = shadowed_lights(scene.all_lights, scene.surfaces)
    if not found:
        return False, "no light that casts shadows reaches a surface that does"
    if settings.shadows == "exact":
        return False, "shadows are exact: a ray from every point"
    return True, f"{len(found)} light{'s' * (len(found) > 1)} that surfaces may hide"


def map_lights(scene: Scene) -> dict[str, dict[int, Light]]:
    """The lights that have a map, by kind and index.

    Parameters
    ----------
    scene : Scene

    Returns
    -------
    dict of str to dict of int to Light
        Every kind of `froxel_ref.shadow.KINDS`, in that order.

    Examples
    --------
    >>> map_lights(Scene())
    {'directional': {}, 'spot': {}, 'point': {}}
    """
    lights = scene.all_lights
    found: dict[str, dict[int, Light]] = {kind: {} for kind in KINDS}
    for i in shadowed_lights(lights, scene.surfaces):
        found[map_kind(lights[i])][i] = lights[i]
    return found


def map_bytes(scene: Scene, settings: Settings) -> int:
    """Memory that the shadow maps of a scene take.

    Parameters
    ----------
    scene : Scene
    settings : Settings

    Returns
    -------
    int
        Bytes of all results of the stage; 0 where no maps are made.

    Examples
    --------
    >>> map_bytes(Scene(), Settings())
    0
    """
    if not needs_maps(scene, settings)[0]:
        return 0
    maps, item, total = settings.shadow_maps, np.dtype(settings.precision).itemsize, 0
    for kind, lights in map_lights(scene).items():
        faces, rows, columns = map_shape(kind, maps)
        texels = rows * columns
        numbers = 12  # of a face's matrix
        if maps.technique == "exponential":
            texels, numbers = texels + texels // (maps.downsample * maps.downsample), numbers + 2
        total += len(lights) * (faces * (texels * item + numbers * 8) + 8)
    return total


def shadow_maps(scene: Scene, settings: Settings, assets: Assets, *, dtype: DTypeLike = np.float64,
                threads: int | None = None,
                known: Mapping[str, Any] | None = None) -> dict[str, Any]:
    """Make the shadow maps of a scene.

    Parameters
    ----------
    scene : Scene
        Its lights, surfaces and camera.
    settings : Settings
        Its grid and shadow_maps.
    assets : Assets
        Height fields, meshes, and maps made elsewhere.
    dtype : data type
        Of the depths.
    threads : int, optional
        As for `froxel_ref.shadow.make_stack`.
    known : mapping of str to ndarray, optional
        Maps of kinds that have not changed since they were made, by result name; they are handed on.

    Returns
    -------
    dict of str to ndarray
        Every name of `NAMES`; kinds without lights have no maps. Not to be written to: the next frame may take
        them over.

    Raises
    ------
    InputError
        A map made elsewhere of another shape, or with NaN.

    Examples
    --------
    >>> sorted(shadow_maps(Scene(), Settings(), None))[:2]
    ['shadow/directional_depth', 'shadow/directional_exponential']
    """
    results: dict[str, Any] = {}
    casting = None
    for kind, lights in map_lights(scene).items():
        if known is not None and NAMES[kind][0] in known:
            results |= {name: known[name] for name in NAMES[kind]}
            continue
        if lights and casting is None:
            casting = casters([surface for surface in scene.surfaces if surface.casts_shadows], assets)
        stack = make_stack(kind, lights, casting or (), scene.camera, settings.grid, maps=settings.shadow_maps,
                           given=assets.shadow_maps, dtype=dtype, threads=threads
                           ) if lights else _no_maps(kind, settings, dtype)
        results |= dict(zip(NAMES[kind], stack, strict=True))
    for name in (name for names in NAMES.values() for name in names):
        results[name].flags.writeable = False  # they may be handed on to the next frame
    return results


def _no_maps(kind: str, settings: Settings, dtype: DTypeLike) -> Stack:
    return make_stack(kind, {}, (), Scene().camera, settings.grid, maps=settings.shadow_maps, dtype=dtype)


def empty_maps(settings: Settings, dtype: DTypeLike = np.float64) -> dict[str, Any]:
    """What stands for the stage where it is left out: no maps.

    Parameters
    ----------
    settings : Settings
    dtype : data type

    Returns
    -------
    dict of str to ndarray
        Arrays whose first axis has length 0.

    Examples
    --------
    >>> empty_maps(Settings())["shadow/point_depth"].shape
    (0, 6, 256, 256)
    """
    return {name: array for kind in KINDS
            for name, array in zip(NAMES[kind], _no_maps(kind, settings, dtype), strict=True)}


# --- what has not moved -----------------------------------------------------------------------------


def map_keys(scene: Scene, settings: Settings, assets: Assets) -> dict[tuple[str, ...], Hashable]:
    """What the maps of each kind depend on: equal keys mean equal maps.

    Parameters
    ----------
    scene, settings, assets
        As for `shadow_maps`.

    Returns
    -------
    dict of tuple of str to hashable
        By the results' names. Places and shapes of lights and surfaces count, colours do not; of the camera
        only where the texels of cascades lie, which moves in whole texels.

    Examples
    --------
    >>> from froxel_ref.scene import Camera, Plane, PointLight
    >>> lamp = PointLight(position=(0, 1, 0), intensity=(1, 1, 1))
    >>> here, there = (map_keys(Scene(camera=Camera(position=p), lights=(lamp,), surfaces=(Plane(),)), Settings(), None)
    ...                for p in ((0, 1, 5), (0, 1, 6)))
    >>> here == there
    True
    """
    surfaces = tuple(_shape(surface, assets) for surface in scene.surfaces if surface.casts_shadows)
    keys: dict[tuple[str, ...], Hashable] = {}
    for kind, lights in map_lights(scene).items():
        cascades = tuple(_numbers(view) for light in lights.values() if isinstance(light, DirectionalLight)
                         for view in cascade_views(light, scene.camera, settings.grid, settings.shadow_maps))
        keys[NAMES[kind]] = (tuple((i, _place(light, assets)) for i, light in lights.items()),
                             surfaces if lights else (), cascades, settings.shadow_maps, settings.precision)
    return keys


def _numbers(view: Sequence[Any]) -> tuple[Any, ...]:
    return tuple(tuple(v.tolist()) if isinstance(v, np.ndarray) else v for v in view)


def _place(light: Light, assets: Assets) -> Hashable:
    given = None if light.shadow_map is None else Same(assets.shadow_maps[light.shadow_map])
    if isinstance(light, DirectionalLight):
        return light.direction, given
    cone = (light.direction, light.outer_angle) if isinstance(light, SpotLight) else None
    return light.position, light.radius, light.falloff, cone, given


def _shape(surface: Surface, assets: Assets) -> Hashable:
    plain = dataclasses.replace(surface, albedo=(0.0, 0.0, 0.0), name="")
    if isinstance(surface, HeightField) and isinstance(surface.heights, HeightsFile):
        return plain, Same(assets.heights[surface.heights])
    return (plain, Same(assets.meshes[surface])) if isinstance(surface, Mesh) else plain


# --- what lights see --------------------------------------------------------------------------------


def map_sights(results: Mapping[str, Any], scene: Scene, settings: Settings, assets: Assets) -> Visibility:
    """What hides each light, by the shadow maps among a frame's results.

    Parameters
    ----------
    results : mapping of str to ndarray
        With all of `NAMES`.
    scene, settings, assets
        As for `shadow_maps`.

    Returns
    -------
    mapping of int to callable
        See `froxel_ref.arrays.Visibility`.

    Examples
    --------
    >>> map_sights(empty_maps(Settings()), Scene(), Settings(), None)
    {}
    """
    found: dict[int, Sight] = {}
    for kind in KINDS:
        stack = Stack(*(results[name] for name in NAMES[kind]))
        for k, number in enumerate(stack.light.tolist()):
            shadow_map = map_of(stack, k, kind, scene.all_lights[number], maps=settings.shadow_maps,
                                given=assets.shadow_maps)
            found[number] = sight(shadow_map, maps=settings.shadow_maps, outside=settings.beyond_cascades)
    return found


def exact_sights(scene: Scene, assets: Assets) -> Visibility:
    """What hides each light, by a ray from every point.

    Parameters
    ----------
    scene : Scene
    assets : Assets
        Height fields and meshes.

    Returns
    -------
    mapping of int to callable
        0 where a surface that casts shadows lies between, else 1, of lights that one may hide. A surface's
        points are first lifted along its normal by some roundings of their coordinates.

    Raises
    ------
    InputError
        A mesh without Embree installed.

    Examples
    --------
    >>> exact_sights(Scene(), None)
    {}
    """
    numbers = shadowed_lights(scene.all_lights, scene.surfaces)
    if not numbers:
        return {}
    casting = occluders([surface for surface in scene.surfaces if surface.casts_shadows], assets)
    every = exact_visibility(casting, scene.all_lights)
    return {number: _lifted(every[number]) for number in numbers}


def _lifted(see: Sight) -> Sight:
    def seen(points: Points, normal: Points | None = None) -> Field:
        if normal is not None:
            lift = roundings(points)
            points = (points[0] + lift * normal[0], points[1] + lift * normal[1], points[2] + lift * normal[2])
        dtype = np.result_type(*points)
        return see(points).astype(dtype, copy=False)

    return seen
