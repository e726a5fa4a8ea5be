"""A scene's lights as a grid's rays see them: worked out for the whole grid, handed to each part that it is lit in."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from froxel_ref.arrays import Field, Index
from froxel_ref.compensated import DoubleDouble
from froxel_ref.grid import Froxels
from froxel_ref.grid_parts import is_whole, part_of
from froxel_ref.lamps import LampRays, Lobe, lamps_in, relate_lamps
from froxel_ref.scene import DirectionalLight, Light
from froxel_ref.sun_rays import SunRays, sun_light, sun_rays

__all__ = ["GridLights", "lights_in", "relate_lights", "shine"]

Phase = tuple[str, float, float]
NOTHING: Mapping[Phase, tuple[Field, ...]] = MappingProxyType({})


class GridLights(NamedTuple):
    """Lights related to the rays of a grid.

    Attributes
    ----------
    suns : tuple of SunRays
        The directional ones.
    lamps : LampRays
        The others.
    known : mapping of (str, float, float) to tuple of Field
        `shine` by the phase function's name, g and share, where it is worked out already.
    """

    suns: tuple[SunRays, ...]
    lamps: LampRays
    known: Mapping[Phase, tuple[Field, ...]] = NOTHING


def shine(lights: GridLights, lobe: Lobe) -> tuple[Field, ...] | None:
    """What a lobe turns of the suns' light into each ray, where it is the same at every depth.

    Parameters
    ----------
    lights : GridLights
    lobe : Lobe
        Of the medium.

    Returns
    -------
    tuple of Field of shape (3, 1, H, W), or None
        For each sun, by `froxel_ref.sun_rays.sun_light`; nothing for a lobe whose g varies.

    Examples
    --------
    >>> from froxel_ref.grid import make_froxels
    >>> from froxel_ref.lamps import make_lobe
    >>> from froxel_ref.scene import Camera
    >>> from froxel_ref.settings import Grid
    >>> froxels = make_froxels(Camera(), Grid(width=4, height=2, depth=8))
    >>> lights = relate_lights([DirectionalLight(direction=(0, 1, 0), irradiance=(1, 1, 1))], froxels)
    >>> lobe = make_lobe(np.ones((3, 1, 1, 1)), 1.0, True, "henyey_greenstein", 0.5, np.dtype(float))
    >>> [light.shape for light in shine(lights, lobe)]
    [(3, 1, 2, 4)]
    """
    if lobe.varies:
        return None
    found = lights.known.get(_phase(lobe))
    return found or tuple(sun_light(sun, lobe.name, lobe.g, share=lobe.share) for sun in lights.suns)


def _phase(lobe: Lobe) -> Phase:
    return lobe.name, float(lobe.g[0, 0, 0]), lobe.share


def relate_lights(lights: Sequence[Light], froxels: Froxels, *, attenuation: str = "min_distance",
                  restrict: bool = True, lobes: Sequence[Lobe] = ()) -> GridLights:
    """Relate lights to the rays of a grid.

    Parameters
    ----------
    lights, attenuation, restrict
        As for `froxel_ref.lighting.in_scattering`.
    froxels : Froxels
        The whole grid.
    lobes : sequence of Lobe
        For which `shine` is worked out at once, lest each part of the grid do so.

    Returns
    -------
    GridLights

    Examples
    --------
    >>> from froxel_ref.grid import make_froxels
    >>> from froxel_ref.scene import Camera
    >>> from froxel_ref.settings import Grid
    >>> froxels = make_froxels(Camera(), Grid(width=4, height=2, depth=8))
    >>> sun = DirectionalLight(direction=(0, 1, 0), irradiance=(1, 1, 1))
    >>> [light.number for light in relate_lights([sun, sun], froxels).suns]
    [0, 1]
    """
    suns = tuple(sun_rays(i, light, froxels.rays) for i, light in enumerate(lights)
                 if isinstance(light, DirectionalLight))
    local = {i: light for i, light in enumerate(lights) if not isinstance(light, DirectionalLight)}
    related = GridLights(suns, relate_lamps(local, froxels, attenuation=attenuation, restrict=restrict))
    return related._replace(known={_phase(lobe): light for lobe in lobes if (light := shine(related, lobe))})


def lights_in(lights: GridLights, box: Index) -> GridLights:
    """What a part of a grid has of the lights that are related to all of it.

    Parameters
    ----------
    lights : GridLights
        From `relate_lights`.
    box : Index
        The part, with numbers for its starts and stops.

    Returns
    -------
    GridLights
        To the last bit what the part's own rays would give.

    Examples
    --------
    >>> from froxel_ref.grid import make_froxels
    >>> from froxel_ref.scene import Camera
    >>> from froxel_ref.settings import Grid
    >>> froxels = make_froxels(Camera(), Grid(width=4, height=2, depth=8))
    >>> lights = relate_lights([DirectionalLight(direction=(0, 1, 0), irradiance=(1, 1, 1))], froxels)
    >>> lights_in(lights, (slice(0, 8, 2), slice(0, 2, 2), slice(1, 4, 2))).suns[0].deflection.high.shape
    (1, 2)
    """
    _, y, x = box
    known = {phase: tuple(part_of(light, (slice(None), y, x)) for light in found)
             for phase, found in lights.known.items()}
    return GridLights(tuple(_sun_in(sun, y, x) for sun in lights.suns), lamps_in(lights.lamps, box), known)


def _sun_in(sun: SunRays, y: slice, x: slice) -> SunRays:
    if is_whole((y, y, x), sun.deflection.high.shape):
        return sun
    high, low = (np.ascontiguousarray(part[y, x]) for part in (sun.deflection.high, sun.deflection.low))
    return sun._replace(deflection=DoubleDouble(high, low))
