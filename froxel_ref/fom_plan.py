"""Which lights have opacity maps, how large, and what a plan says of it."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from froxel_ref.blocks import available_threads
from froxel_ref.fom_codes import code_of
from froxel_ref.fom_particles import AT_ONCE, CROSSING, KEPT, KEPT_CROSSING
from froxel_ref.fom_views import Wanted, assign_tiles, lamp_reach
from froxel_ref.geometry import bounding_radius
from froxel_ref.jobs import Part
from froxel_ref.lights import colour
from froxel_ref.records import InputError
from froxel_ref.scene import DirectionalLight, LocalMedium, Medium, Particle, PointLight, Scene
from froxel_ref.settings import Settings
from froxel_ref.shadow import map_kind

__all__ = [
    "assigned_tiles", "casting_particles", "crossing_bytes", "dimmed_lamps", "dimmed_suns", "dimming_media",
    "dims_light", "faces_shape", "is_octahedral", "map_border", "map_bytes", "map_parts", "meets", "needs_maps",
    "particle_size", "used_texels",
]


def dimming_media(scene: Scene, *, local_only: bool = False) -> dict[int, Medium]:
    """The media that dim, by their place among the global and then the local ones.

    Parameters
    ----------
    scene : Scene
    local_only : bool
        For directional lights, which global media do not dim: they have no end towards them.

    Returns
    -------
    dict of int to Medium

    Raises
    ------
    InputError
        The extinction of a medium that may dim a light is RGB: a map holds one number.
    """
    found = {i: medium for i, medium in enumerate((*scene.global_media, *scene.local_media))
             if np.any(np.asarray(medium.extinction) > 0.0)}
    casting = [light for light in scene.all_lights if _casts(light)]
    lamps = any(isinstance(light, PointLight) for light in casting)
    for number, medium in found.items():
        dims = casting if isinstance(medium, LocalMedium) else lamps
        if dims and isinstance(medium.extinction, tuple):
            first = len(scene.global_media)
            place = f"global_media[{number}]" if number < first else f"local_media[{number - first}]"
            raise InputError(f"{place}.extinction", "is RGB, must be one number for volumetric shadows (or "
                                                    "settings.volumetric_shadows=off)")
    return {i: medium for i, medium in found.items() if isinstance(medium, LocalMedium) or not local_only}


def casting_particles(scene: Scene) -> tuple[Particle, ...]:
    """The particles that dim light.

    Parameters
    ----------
    scene : Scene

    Returns
    -------
    tuple of Particle

    Examples
    --------
    >>> casting_particles(Scene(particles=(Particle(position=(0, 0, 0), opacity=0),)))
    ()
    """
    return tuple(each for each in scene.all_particles if each.casts)


def particle_size(settings: Settings) -> str:
    """What the size of a particle is: its edge, or in the thesis's program half of it (A9).

    Parameters
    ----------
    settings : Settings

    Returns
    -------
    {"edge", "half"}
        As for `froxel_ref.billboards.half_extents`.

    Examples
    --------
    >>> particle_size(Settings())
    'edge'
    """
    return "half" if settings.fom_particles == "centre" else "edge"


def is_octahedral(light: PointLight) -> bool:
    """Whether a lamp's map is an octahedron: of point lights, and of spot lights beyond a half angle of 75°.

    Parameters
    ----------
    light : PointLight

    Returns
    -------
    bool

    Examples
    --------
    >>> is_octahedral(PointLight(position=(0, 0, 0), intensity=(1, 1, 1)))
    True
    """
    return map_kind(light) == "point"


def map_border(light: PointLight, settings: Settings) -> int:
    """Texels around a lamp's map; the thesis's program has none on spot lights' tiles (A3).

    Parameters
    ----------
    light : PointLight
    settings : Settings

    Returns
    -------
    int

    Examples
    --------
    >>> map_border(PointLight(position=(0, 0, 0), intensity=(1, 1, 1)), Settings())
    1
    """
    mirrored = not is_octahedral(light) and settings.fom_spot == "mirrored"
    return 0 if mirrored else settings.opacity_maps.gutter


def dimmed_lamps(scene: Scene, settings: Settings) -> dict[int, PointLight]:
    """Point and spot lights that media or particles may dim on their way, by index.

    Parameters
    ----------
    scene : Scene
    settings : Settings
        Its grid, for lamps without a window.

    Returns
    -------
    dict of int to PointLight
        Those that shine and cast shadows.

    Examples
    --------
    >>> lamp = PointLight(position=(0, 0, 0), intensity=(1, 1, 1))
    >>> list(dimmed_lamps(Scene(lights=(lamp,), global_media=(Medium(),)), Settings()))
    [0]
    """
    media, particles = dimming_media(scene), casting_particles(scene)
    centers = np.reshape([each.position for each in particles], (-1, 3))
    radii = np.array([each.size for each in particles]) * 2.0 ** 0.5  # twice that of a square of this edge (A9)

    def dimmed(light: PointLight) -> bool:
        reach = lamp_reach(light, scene.camera, settings.grid)
        away = np.linalg.norm(centers - light.position, axis=1) - radii
        return bool((away < reach).any()) or any(meets(light, medium, reach) for medium in media.values())

    return {i: light for i, light in enumerate(scene.all_lights)
            if isinstance(light, PointLight) and _casts(light) and dimmed(light)}


def dimmed_suns(scene: Scene) -> dict[int, DirectionalLight]:
    """Directional lights that local media or particles dim, by index.

    Parameters
    ----------
    scene : Scene

    Returns
    -------
    dict of int to DirectionalLight

    Examples
    --------
    >>> sun = DirectionalLight(direction=(0, 1, 0), irradiance=(1, 1, 1))
    >>> dimmed_suns(Scene(lights=(sun,), global_media=(Medium(),)))
    {}
    """
    if not dimming_media(scene, local_only=True) and not casting_particles(scene):
        return {}
    return {i: light for i, light in enumerate(scene.all_lights)
            if isinstance(light, DirectionalLight) and _casts(light)}


def _casts(light: DirectionalLight | PointLight) -> bool:
    return light.casts_shadows and bool(colour(light).any())


def meets(light: PointLight, medium: Medium, reach: float) -> bool:
    """Whether a medium's bounding ball meets what a lamp reaches.

    Parameters
    ----------
    light : PointLight
    medium : Medium
    reach : float [m]
        From `froxel_ref.fom_views.lamp_reach`.

    Returns
    -------
    bool
        True for a medium without bounds.

    Examples
    --------
    >>> lamp = PointLight(position=(0, 5, 0), intensity=(1, 1, 1))
    >>> meets(lamp, LocalMedium(), 3.0), meets(lamp, LocalMedium(), 3.5)
    (False, True)
    """
    if not isinstance(medium, LocalMedium):
        return True
    pose = medium.transform.world_from_local
    away = float(np.linalg.norm(pose[:3, 3] - light.position))
    return away <= (reach + bounding_radius(pose)) * (1.0 + 1e-9)


def needs_maps(scene: Scene, settings: Settings) -> tuple[bool, str]:
    """Whether a frame needs opacity maps, and why.

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
    (False, 'volumetric shadows are off')
    """
    if settings.volumetric_shadows == "off":
        return False, "volumetric shadows are off"
    if not dimming_media(scene) and not casting_particles(scene):
        return False, "the scene has nothing that dims light on its way"
    count = len(dimmed_lamps(scene, settings)) + len(dimmed_suns(scene))
    if not count:
        return False, ("no light that casts shadows is dimmed by a medium or particle (media without end dim lamps, "
                       "not suns)")
    if settings.volumetric_shadows == "exact":
        return False, "volumetric shadows are exact: along a ray from every point"
    return True, f"{count} light{'s' * (count > 1)} that media or particles may dim"


def dims_light(scene: Scene, settings: Settings) -> bool:
    """Whether media or particles dim a light, by maps or exactly.

    Parameters
    ----------
    scene : Scene
    settings : Settings

    Returns
    -------
    bool

    Examples
    --------
    >>> dims_light(Scene(), Settings(volumetric_shadows="exact"))
    False
    """
    return settings.volumetric_shadows != "off" and bool(dimmed_lamps(scene, settings) or dimmed_suns(scene))


def assigned_tiles(scene: Scene, settings: Settings) -> dict[int, Wanted]:
    """The tiles of the lamps that media or particles may dim.

    Parameters
    ----------
    scene : Scene
    settings : Settings

    Returns
    -------
    dict of int to Wanted
        See `froxel_ref.fom_views.assign_tiles`.

    Examples
    --------
    >>> lamp = PointLight(position=(0, 0, 0), intensity=(1, 1, 1))
    >>> assigned_tiles(Scene(lights=(lamp,), global_media=(Medium(),)), Settings())[0].tile
    Tile(row=0, column=0, size=256)
    """
    return assign_tiles(dimmed_lamps(scene, settings), scene.camera, settings.opacity_maps,
                        tiles=settings.fom_tiles)


def map_parts(scene: Scene, settings: Settings) -> tuple[Part, ...]:
    """What the stage does for this scene: its technique, tiles of the atlas, cascades; lamps with less than they asked.

    Parameters
    ----------
    scene : Scene
    settings : Settings

    Returns
    -------
    tuple of Part
        None unless volumetric shadows are by maps.

    Examples
    --------
    >>> [part.why for part in map_parts(Scene(), Settings(volumetric_shadows="maps"))]
    ['Fourier series, 8 numbers a texel', 'none that anything dims', 'none that a local medium or particle dims']
    """
    if settings.volumetric_shadows != "maps":
        return ()
    wanted = assigned_tiles(scene, settings)
    suns = len(dimmed_suns(scene))
    sizes = [str(each.tile.size) for each in wanted.values() if each.tile is not None]
    held = ", ".join(f"{sizes.count(size)} of {size}²" for size in sorted(set(sizes), key=int, reverse=True))
    parts = [Part("technique", True, code_of(settings.opacity_maps).about),
             Part("point and spot lights", bool(sizes), f"tiles of the {settings.opacity_maps.atlas}² atlas: {held}"
                  if sizes else "none that anything dims" if not wanted else "the atlas has no room")]
    parts.append(Part("directional lights", suns > 0, f"{suns * settings.shadow_maps.cascades} cascades"
                      if suns else "none that a local medium or particle dims"))
    for number, each in wanted.items():
        if each.tile is None:
            parts.append(Part(f"lights[{number}]", False, "fog and particles do not dim it: the atlas has no room for "
                                                          f"{settings.opacity_maps.smallest}²"))
        elif each.tile.size < each.size:
            parts.append(Part(f"lights[{number}]", True, f"{each.tile.size}² instead of {each.size}²: no more room"))
    return tuple(parts)


def faces_shape(settings: Settings) -> tuple[int, int, int, int]:
    """Shape of a directional light's numbers.

    Parameters
    ----------
    settings : Settings

    Returns
    -------
    (int, int, int, int)
        Cascades, channels, rows and columns.

    Examples
    --------
    >>> faces_shape(Settings())
    (4, 8, 256, 256)
    """
    maps = settings.opacity_maps
    return settings.shadow_maps.cascades, maps.channels, maps.directional_size, maps.directional_size


def used_texels(wanted: Mapping[int, Wanted]) -> tuple[int, int]:
    """Rows and columns of the atlas from its corner to the last tile.

    Parameters
    ----------
    wanted : mapping of int to Wanted

    Returns
    -------
    (int, int)

    Examples
    --------
    >>> used_texels({})
    (0, 0)
    """
    tiles = [each.tile for each in wanted.values() if each.tile is not None]
    return (max((tile.row + tile.size for tile in tiles), default=0),
            max((tile.column + tile.size for tile in tiles), default=0))


def map_bytes(scene: Scene, settings: Settings) -> int:
    """Memory that the maps of a scene take.

    Parameters
    ----------
    scene : Scene
    settings : Settings

    Returns
    -------
    int
        Bytes; 0 where none are made.

    Examples
    --------
    >>> map_bytes(Scene(), Settings())
    0
    """
    if not needs_maps(scene, settings)[0]:
        return 0
    wanted = assigned_tiles(scene, settings)
    rows, columns = used_texels(wanted)
    lamps, suns = sum(each.tile is not None for each in wanted.values()), len(dimmed_suns(scene))
    faces, channels, size, _ = faces_shape(settings)
    more = 7 * channels // 2 if settings.opacity_maps.reconstruction == "resolved" else 0
    texels = rows * columns * (channels + more) + suns * faces * size * size * (channels + more + 2)
    # Beside them an index, three numbers of the tile, two of the range and twelve of the matrix.
    return texels * np.dtype(settings.precision).itemsize + 8 * (lamps * (1 + 3 + 2 + 12) + suns * (1 + faces * 12))


def crossing_bytes(scene: Scene, settings: Settings) -> int:
    """Memory that particles' crossings with the maps' rays take while maps are made.

    Parameters
    ----------
    scene : Scene
    settings : Settings

    Returns
    -------
    int
        Bytes: if every ray crosses every particle, up to what threads work on at a time and what is kept.

    Examples
    --------
    >>> crossing_bytes(Scene(), Settings())
    0
    """
    particles = len(casting_particles(scene))
    if settings.volumetric_shadows != "maps" or not particles:
        return 0
    maps = settings.opacity_maps
    lamps, faces = len(dimmed_lamps(scene, settings)), len(dimmed_suns(scene)) * settings.shadow_maps.cascades
    largest = max(maps.large**2 * (lamps > 0), maps.directional_size**2 * (faces > 0))
    most = particles * (lamps * maps.large**2 + faces * maps.directional_size**2)
    # One particle has up to one crossing a ray; of several there may be more than were meant.
    working = available_threads() * max(largest, 2 * AT_ONCE)
    return min(most, working) * CROSSING + min(most, KEPT) * KEPT_CROSSING
