"""The light that points of rays send towards their starts: what `froxel_ref.single_scattering` integrates."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from froxel_ref.arrays import Points
from froxel_ref.breaks import Lamp, from_angle, jacobian
from froxel_ref.buffers import VBuffer
from froxel_ref.bundles import Bundle, Physics, parameter, through
from froxel_ref.light_paths import light_transmittance
from froxel_ref.lighting import CONSTANT_AMBIENT
from froxel_ref.lights import colour, cone_attenuation, distance_attenuation
from froxel_ref.media import media_at
from froxel_ref.optical_depth import line_points
from froxel_ref.particle_shadows import passing as particles_pass
from froxel_ref.phase import phase
from froxel_ref.quadrature import Pool
from froxel_ref.scene import DirectionalLight, Light, SpotLight
from froxel_ref.veils import veiled

__all__ = ["Samples", "radiance", "samples"]

Array: TypeAlias = NDArray[np.floating[Any]]
Integers: TypeAlias = NDArray[np.integer[Any]]
Mask: TypeAlias = NDArray[np.bool_]

TINY = float(np.finfo(np.float64).tiny)


class Samples(NamedTuple):
    """Points of intervals of one source, and the light there. Shapes (n, m), one row an interval.

    Attributes
    ----------
    source : int
        GLOW, or the light's number + 1.
    rows : ndarray of int, shape (n,)
        Whose intervals they are.
    t, points
        Where they lie: metres along the ray, and in the world.
    s : ndarray [m]
        For lamps, t from the point nearest to it.
    stretch : ndarray
        Metres per unit of the intervals' own variable.
    passing : ndarray, shape (C, n, m)
        What media, and particles and transparent surfaces, let through on both ways.
    """

    source: int
    rows: Integers
    t: Array
    points: Points
    s: Array
    stretch: Array
    passing: Array


def samples(bundle: Bundle, source: int, part: Pool, x: Array) -> Samples:
    """Go to points of intervals.

    Parameters
    ----------
    bundle : Bundle
    source : int
        All intervals belong to it.
    part : Pool
        The intervals.
    x : ndarray, shape (n, m)
        The points, in their own variable.

    Returns
    -------
    Samples
    """
    physics, rows, lamp = bundle.physics, part.owner, bundle.lamps.get(source - 1)
    t, s = x, x
    stretch: Array = np.ones((1, 1))
    if lamp is not None:
        far, scale = (part.kind % 2 == 1)[:, np.newaxis], lamp.scale[rows][:, np.newaxis]
        s = from_angle(x, scale, far)
        t, stretch = s + lamp.nearest[rows][:, np.newaxis], jacobian(s, scale, far)
    points = line_points(bundle.lines, t, rows)
    passing = through(bundle, t, rows)
    if source and physics.dims(source - 1):
        passing = passing * light_transmittance(
            *physics.dimmers(source - 1), physics.lights[source - 1], points,
            settings=physics.settings, sun_distance=physics.sun_distance)
    if source - 1 in bundle.cast:
        passing = passing * particles_pass(bundle.cast[source - 1], rows, t)
    if bundle.veil is not None:
        middle = parameter(bundle, part, 0.5 * (part.low + part.high))
        passing = passing * veiled(bundle.veil, rows, middle)[:, np.newaxis]
    return Samples(source, rows, t, points, s, stretch, passing)


def radiance(bundle: Bundle, at: Samples, media: VBuffer | None = None) -> Array:
    """What the media at points send towards the rays' starts, by the intervals' variable: (3, n, m).

    Parameters
    ----------
    bundle : Bundle
    at : Samples
        From `samples`.
    media : VBuffer, optional
        The material there, if it is not the scene's.

    Returns
    -------
    ndarray, shape (3, n, m) or broadcastable to it [W m⁻² sr⁻¹ per unit of the variable]
    """
    physics = bundle.physics
    if media is None:
        media = media_at(physics.every_medium, at.points, physics.textures, physics.settings)
    light = physics.lights[at.source - 1] if at.source else None
    if light is None:
        arriving = _glow(physics, media)
    elif isinstance(light, DirectionalLight):
        turn = (part[at.rows][:, np.newaxis] for part in bundle.suns[at.source - 1])
        arriving = _scattered(physics, media, light, *turn)
    else:
        arriving = _lamp(bundle, bundle.lamps[at.source - 1], media, at)
    return np.asarray(arriving * at.stretch * at.passing)


def _glow(physics: Physics, media: VBuffer) -> Array:
    """Ambient light scattered, and emission."""
    settings = physics.settings
    ambient = (CONSTANT_AMBIENT,) * 3 if settings.ambient == "constant" else physics.scene.ambient
    received = np.reshape(np.asarray(ambient, np.float64), (3, 1, 1))
    if settings.emission == "published":
        return np.asarray(media.scattering * (received + media.emission))
    return np.asarray(media.scattering * received + media.emission)


def _scattered(physics: Physics, media: VBuffer, light: Light, cosine: Array, versine: Array,
               mirrored: Array) -> Array:
    """Σ σ_s·p·E over the lobes, (3, n, m) or broadcastable."""
    settings = physics.settings
    parts: Sequence[tuple[Any, Any]] = media.lobes or ((media.scattering, media.phase_anisotropy),)
    total: Any = 0.0
    for scattering, g in parts:
        total = total + scattering * phase(settings.phase_function, cosine, g, versine=versine,
                                           mirrored_versine=mirrored, second_lobe=settings.second_lobe)
    return np.asarray(total * colour(light).reshape(3, 1, 1))


def _lamp(bundle: Bundle, lamp: Lamp, media: VBuffer, at: Samples) -> Array:
    """A lamp's light, its variable's Jacobian apart."""
    s, across2 = at.s, lamp.across2[at.rows][:, np.newaxis]
    d2 = s * s + across2
    d = np.maximum(np.sqrt(d2), TINY)
    cosine = -s / d
    # 1 ± s/d, without the difference of like numbers where it is small.
    narrow = across2 / (d * (d + np.abs(s)))
    versine, mirrored = np.where(s < 0.0, narrow, 1.0 - cosine), np.where(s > 0.0, narrow, 1.0 + cosine)
    factor = distance_attenuation(d2, lamp.light, attenuation=bundle.physics.settings.attenuation)
    if isinstance(lamp.light, SpotLight):
        slope, offset = lamp.cone_slope[at.rows][:, np.newaxis], lamp.cone_offset[at.rows][:, np.newaxis]
        factor = factor * cone_attenuation((s * slope + offset) / d, lamp.light)
    return _scattered(bundle.physics, media, lamp.light, cosine, versine, mirrored) * factor
