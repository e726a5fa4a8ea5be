"""Rays laid through a scene: their media, their lamps, and everywhere that light or media break along them.

What all rays share is the `Physics`; what is worked out for a block of rays is the `Bundle`.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from froxel_ref.billboards import Particles
from froxel_ref.breaks import Lamp, from_angle, medium_cuts, relate, thickness_cuts, to_angle
from froxel_ref.compensated import dot, double_double
from froxel_ref.density import Placed, place
from froxel_ref.fom_plan import particle_size
from froxel_ref.lights import colour
from froxel_ref.media import Textures, contributing
from froxel_ref.media_shadows import shadow_cuts
from froxel_ref.optical_depth import Lines, MediumPath, extinctions, medium_path, optical_depth, support
from froxel_ref.particle_shadows import Shadows, particle_cuts, particle_shadows
from froxel_ref.quadrature import Pool
from froxel_ref.scene import DirectionalLight, Light, LocalMedium, Medium, Scene
from froxel_ref.settings import Settings
from froxel_ref.veils import Veil
from froxel_ref.visibility import Occluder, dark_spans

__all__ = ["Bundle", "Physics", "make_bundle", "make_physics", "parameter", "sampling", "through",
           "variable"]

Array: TypeAlias = NDArray[np.floating[Any]]
Integers: TypeAlias = NDArray[np.integer[Any]]
Mask: TypeAlias = NDArray[np.bool_]


class Physics(NamedTuple):
    """What light and media do, the same for all rays.

    Attributes
    ----------
    scene, settings, textures
        As for a frame.
    media : tuple of Placed
        All media, global ones first.
    active : tuple of bool
        Which of them dim or glow.
    extinction : ndarray, shape (media, 1 or 3) [1/m]
        At density 1.
    lights : tuple of Light
        All lights.
    occluders : tuple of Occluder
        What casts shadows; empty for shadows "off".
    volumetric : bool
        Whether media and particles dim the light on its way to the ray.
    sun_distance : float [m]
        How far towards a directional light media do.
    particles : Particles or None
        Those that dim light; None where there are none.
    sun_media : str
        Which media dim directional lights: "all", or "local", as in a frame.
    """

    scene: Scene
    settings: Settings
    textures: Textures
    media: tuple[Placed, ...]
    active: tuple[bool, ...]
    extinction: Array
    lights: tuple[Light, ...]
    occluders: tuple[Occluder, ...]
    volumetric: bool
    sun_distance: float
    particles: Particles | None = None
    sun_media: str = "all"

    def dims(self, number: int) -> bool:
        """Whether media and particles dim a light on its way: with volumetric shadows, one that casts shadows."""
        return self.volumetric and self.lights[number].casts_shadows

    def dimmers(self, number: int) -> tuple[tuple[Placed, ...], Array]:
        """The media that dim a light, and their extinction."""
        if self.sun_media == "all" or not isinstance(self.lights[number], DirectionalLight):
            return self.media, self.extinction
        local = [isinstance(medium, LocalMedium) for medium in self.every_medium]
        return tuple(placed for placed, kept in zip(self.media, local, strict=True) if kept), self.extinction[local]

    @property
    def every_medium(self) -> tuple[Medium, ...]:
        """The media's records."""
        return tuple(placed.medium for placed in self.media)

    @property
    def anchored(self) -> bool:
        """Whether anything but lamps has a place in the world, whose rounding shows along rays."""
        return bool(self.occluders) or self.particles is not None or any(
            isinstance(m, LocalMedium) or m.height_fog is not None or m.density is not None for m in self.every_medium)


class Turn(NamedTuple):
    """By how much a sun's light turns into rays, each of shape (n,): cos θ, 1 − cos θ and 1 + cos θ."""

    cosine: Array
    versine: Array
    mirrored: Array


class Bundle(NamedTuple):
    """Rays laid through the scene.

    Attributes
    ----------
    physics : Physics
    lines : Lines
        The rays.
    paths : tuple of MediumPath
        The media along them.
    cuts : ndarray, shape (n, M) [m]
        Where media and their thickness break.
    lamps : mapping of int to Lamp
        The lamps as the rays see them, by the light's number.
    suns : mapping of int to Turn
        The other lights, likewise.
    dark : mapping of int to ndarray, shape (n, M, 2) [m]
        Where surfaces hide a light; empty for shadows "off".
    shaded : mapping of int to ndarray, shape (n, M) [m]
        Where the shadows of media and particles break, for lights that shine; empty unless these dim them.
    cast : mapping of int to Shadows
        The shadows of particles, likewise; empty without particles.
    veil : Veil or None
        What layers in front of points leave of their light; None without layers.
    """

    physics: Physics
    lines: Lines
    paths: tuple[MediumPath, ...]
    cuts: Array
    lamps: Mapping[int, Lamp]
    suns: Mapping[int, Turn]
    dark: Mapping[int, Array]
    shaded: Mapping[int, Array]
    cast: Mapping[int, Shadows]
    veil: Veil | None


def make_physics(scene: Scene, settings: Settings, textures: Textures, occluders: tuple[Occluder, ...], *,
                 volumetric: bool, sun_distance: float, particles: Particles | None = None,
                 sun_media: str = "all") -> Physics:
    """Gather what does not depend on the rays; see `Physics`."""
    media = (*scene.global_media, *scene.local_media)
    placed = tuple(place(m, None if m.density is None else textures[m.density.source]) for m in media)
    used = set(map(id, contributing(media)))
    return Physics(scene, settings, textures, placed, tuple(id(m) in used for m in media), extinctions(media),
                   scene.all_lights, occluders, volumetric, sun_distance, particles, sun_media)


def make_bundle(physics: Physics, lines: Lines, veil: Veil | None = None) -> Bundle:
    """Lay rays through the scene.

    Parameters
    ----------
    physics : Physics
    lines : Lines
        With directions of length 1 and finite stops.
    veil : Veil, optional
        Layers along them.

    Returns
    -------
    Bundle
    """
    settings = physics.settings
    paths = tuple(medium_path(placed, lines, **sampling(physics)) for placed in physics.media)
    cuts = [medium_cuts(paths, lines), thickness_cuts(paths, physics.extinction, lines),
            *_membership_cuts(physics, lines)]
    lamps = {i: relate(light, lines, attenuation=settings.attenuation)
             for i, light in enumerate(physics.lights) if not isinstance(light, DirectionalLight)}
    suns = {i: _turn(light, lines) for i, light in enumerate(physics.lights)
            if isinstance(light, DirectionalLight)}
    dark = {i: dark_spans(physics.occluders, lines, light) for i, light in enumerate(physics.lights)
            if light.casts_shadows} if physics.occluders else {}
    shaded = {i: shadow_cuts(*physics.dimmers(i), light, lines, lamp=lamps.get(i),
                             sun_distance=physics.sun_distance, time=settings.time)
              for i, light in enumerate(physics.lights) if physics.dims(i) and colour(light).any()}
    cast = {} if physics.particles is None else {
        i: particle_shadows(physics.particles, physics.lights[i], lines, size=particle_size(settings)) for i in shaded}
    shaded |= {i: np.concatenate([shaded[i], particle_cuts(each)], axis=1) for i, each in cast.items()}
    if veil is not None:
        cuts.append(np.where(np.isfinite(veil.distance), veil.distance, np.nan))
    return Bundle(physics, lines, paths, np.concatenate(cuts, axis=1), lamps, suns, dark, shaded, cast, veil)


def _turn(light: DirectionalLight, lines: Lines) -> Turn:
    """In twice the digits: near the sun, and opposite to it, the rounding of unit vectors would show."""
    exponent = math.frexp(max(map(abs, light.direction)))[1]
    towards = [double_double(math.ldexp(component, -exponent)) for component in light.direction]
    along, one = [double_double(component) for component in lines.direction], double_double(1.0)
    cosine = dot(along, towards) / (dot(along, along) * dot(towards, towards)).sqrt()
    return Turn(cosine.high, np.maximum((one - cosine).high, 0.0), np.maximum((one + cosine).high, 0.0))


def _membership_cuts(physics: Physics, lines: Lines) -> list[Array]:
    """Where rays enter and leave shapes with a ceiling: the plain mean of g counts what is above it too."""
    cuts = []
    for placed in physics.media if physics.settings.phase_mixing == "mean" else ():
        fog = placed.medium.height_fog
        if isinstance(placed.medium, LocalMedium) and fog is not None and fog.max_height is not None:
            whole = placed._replace(medium=dataclasses.replace(placed.medium, height_fog=None))
            cuts.append(np.stack(support(whole, lines), axis=1))
    return cuts


def sampling(physics: Physics) -> dict[str, Any]:
    """What textures are sampled with: the keywords time and addressing."""
    return {"time": physics.settings.time, "addressing": physics.settings.density_addressing}



def through(bundle: Bundle, t: Array, rows: Any = slice(None)) -> Array:
    """Transmittance from the rays' starts to points on them, shape (C, n, …)."""
    with np.errstate(under="ignore"):
        result: Array = np.exp(-optical_depth(bundle.paths, bundle.physics.extinction, t, rows))
    return result


# --- metres, and the intervals' own variables -------------------------------------------------------


def parameter(bundle: Bundle, pool: Pool, x: Array) -> Array:
    """Metres along the rays from the intervals' own variables, both of shape (n,)."""
    return _convert(bundle, pool, x, lambda lamp, rows, far, v: from_angle(v, lamp.scale[rows], far)
                    + lamp.nearest[rows])


def variable(bundle: Bundle, pool: Pool, t: Array) -> Array:
    """The inverse of `parameter`."""
    return _convert(bundle, pool, t, lambda lamp, rows, far, v: to_angle(v - lamp.nearest[rows],
                                                                         lamp.scale[rows], far))


def _convert(bundle: Bundle, pool: Pool, values: Array, change: Callable[..., Array]) -> Array:
    result = values.copy()
    for i, lamp in bundle.lamps.items():
        which = np.flatnonzero(pool.kind // 2 == i + 1)
        if which.size:
            far = pool.kind[which] % 2 == 1
            result[which] = change(lamp, pool.owner[which], far, values[which])
    return result
