"""The light that arrives along rays from every piece of them: what `froxel_ref.truth` integrates.

A *source* is one light, or the glow of ambient light and emission. Each has its own intervals and its own
variable: metres for suns and glow, the equiangular angle for lamps (`froxel_ref.breaks`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from froxel_ref.breaks import (
    FAR,
    Lamp,
    from_angle,
    jacobian,
    lamp_cuts,
    medium_cuts,
    pieces,
    relate,
    thickness_cuts,
    to_angle,
)
from froxel_ref.buffers import VBuffer
from froxel_ref.density import Placed, place
from froxel_ref.light_paths import light_transmittance
from froxel_ref.lighting import CONSTANT_AMBIENT
from froxel_ref.lights import colour, cone_attenuation, distance_attenuation, unit
from froxel_ref.media import Textures, contributing, media_at
from froxel_ref.optical_depth import Lines, MediumPath, extinctions, line_points, medium_path, optical_depth
from froxel_ref.phase import phase
from froxel_ref.quadrature import NODES, Estimate, Pool, kronrod
from froxel_ref.scene import DirectionalLight, Light, Medium, Scene, SpotLight
from froxel_ref.settings import Settings
from froxel_ref.texture_depth import nearest_face
from froxel_ref.visibility import Occluder, dark_spans

__all__ = ["Bundle", "Physics", "evaluate", "first_pool", "make_bundle", "split_at_cells", "through"]

Array: TypeAlias = NDArray[np.floating[Any]]
Integers: TypeAlias = NDArray[np.integer[Any]]
Mask: TypeAlias = NDArray[np.bool_]

# From an interval's end to the rule's first node, in half lengths.
GAP = float(NODES[0] + 1.0)

GLOW = 0  # the source of ambient light and emission; light i is source i + 1
TINY, EPS = float(np.finfo(np.float64).tiny), float(np.finfo(np.float64).eps)


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
        Whether media dim the light on its way to the ray.
    sun_distance : float [m]
        How far towards a directional light they do.
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

    @property
    def every_medium(self) -> tuple[Medium, ...]:
        """The media's records."""
        return tuple(placed.medium for placed in self.media)


class Bundle(NamedTuple):
    """Rays laid through the scene: their media, cuts and lamps."""

    physics: Physics
    lines: Lines
    paths: tuple[MediumPath, ...]
    cuts: Array
    lamps: Mapping[int, Lamp]
    dark: Mapping[int, Array]


def make_physics(scene: Scene, settings: Settings, textures: Textures, occluders: tuple[Occluder, ...], *,
                 volumetric: bool, sun_distance: float) -> Physics:
    """Gather what does not depend on the rays; see `Physics`."""
    media = (*scene.global_media, *scene.local_media)
    placed = tuple(place(m, None if m.density is None else textures[m.density.source]) for m in media)
    used = set(map(id, contributing(media)))
    return Physics(scene, settings, textures, placed, tuple(id(m) in used for m in media), extinctions(media),
                   scene.all_lights, occluders, volumetric, sun_distance)


def make_bundle(physics: Physics, lines: Lines) -> Bundle:
    """Lay rays through the scene.

    Parameters
    ----------
    physics : Physics
    lines : Lines
        With directions of length 1 and finite stops.

    Returns
    -------
    Bundle
    """
    settings = physics.settings
    paths = tuple(medium_path(placed, lines, time=settings.time, addressing=settings.density_addressing)
                  for placed in physics.media)
    thick = thickness_cuts(paths, physics.extinction, lines)
    cuts = np.concatenate([medium_cuts(paths, lines), thick], axis=1)
    lamps = {i: relate(light, lines, attenuation=settings.attenuation)
             for i, light in enumerate(physics.lights) if not isinstance(light, DirectionalLight)}
    dark = {i: dark_spans(physics.occluders, lines, light) for i, light in enumerate(physics.lights)
            } if physics.occluders else {}
    return Bundle(physics, lines, paths, cuts, lamps, dark)


def through(bundle: Bundle, t: Array, rows: Any = slice(None)) -> Array:
    """Transmittance from the rays' starts to points on them, shape (C, n, …)."""
    with np.errstate(under="ignore"):
        result: Array = np.exp(-optical_depth(bundle.paths, bundle.physics.extinction, t, rows))
    return result


# --- the first intervals ----------------------------------------------------------------------------


def first_pool(bundle: Bundle) -> Pool:
    """The intervals between breaks, for every source that has any.

    Parameters
    ----------
    bundle : Bundle

    Returns
    -------
    Pool
        Kind 2·source, + 1 for the second form of the angle; owners are rays.
    """
    parts = [_plain_intervals(bundle, GLOW, None)] if _glows(bundle.physics) else []
    for i, light in enumerate(bundle.physics.lights):
        if not colour(light).any():
            continue
        dark = bundle.dark.get(i)
        if isinstance(light, DirectionalLight):
            parts.append(_plain_intervals(bundle, i + 1, dark))
        else:
            parts.append(_lamp_intervals(bundle, i + 1, bundle.lamps[i], dark))
    if not parts:
        nothing, none = np.zeros(0), np.zeros(0, np.intp)
        return Pool(none, none, nothing, nothing)
    return Pool._make(np.concatenate(columns) for columns in zip(*parts, strict=True))


def _glows(physics: Physics) -> bool:
    emits = any(any(medium.emissive) for medium in physics.every_medium)
    return emits or physics.settings.ambient == "constant" or any(physics.scene.ambient)


def _in_media(bundle: Bundle, rows: Integers, t: Array) -> Mask:
    """Whether points lie in a medium that dims or glows."""
    result: Mask = np.zeros(t.shape, bool)
    for path, active in zip(bundle.paths, bundle.physics.active, strict=True):
        if active:
            within = (t > path.enter[rows]) & (t < path.leave[rows])
            result = np.asarray(np.logical_or(result, within))
    return result


def _lit(dark: Array | None, rows: Integers, t: Array) -> Mask:
    """Whether points lie in no shadow."""
    if dark is None or not dark.shape[1]:
        return np.ones(t.shape, bool)
    spans = dark[rows]
    inside = (t[:, np.newaxis] > spans[..., 0]) & (t[:, np.newaxis] < spans[..., 1])
    return np.asarray(~inside.any(axis=1))


def _plain_intervals(bundle: Bundle, source: int, dark: Array | None) -> Pool:
    cuts = bundle.cuts
    if dark is not None:
        cuts = np.concatenate([cuts, dark.reshape(len(cuts), -1)], axis=1)
    row, low, high = pieces(cuts, bundle.lines.start, bundle.lines.stop,
                            lambda rows, t: _in_media(bundle, rows, t) & _lit(dark, rows, t))
    return Pool(row, np.full(row.shape, 2 * source), low, high)


def _lamp_intervals(bundle: Bundle, source: int, lamp: Lamp, dark: Array | None) -> Pool:
    """Intervals of the angle, each in the form that keeps its digits."""
    nearest = lamp.nearest[:, np.newaxis]
    cuts: list[Array] = [bundle.cuts - nearest, lamp_cuts(lamp)]
    if dark is not None:
        cuts.append(dark.reshape(len(nearest), -1) - nearest)
    low: Array = bundle.lines.start - lamp.nearest
    high: Array = bundle.lines.stop - lamp.nearest
    if lamp.light.falloff == "windowed":
        reach = np.sqrt(np.maximum(lamp.light.radius ** 2 - lamp.across2, 0.0))
        low, high = np.maximum(low, -reach), np.minimum(high, reach)

    def keep(rows: Integers, s: Array) -> Mask:
        kept = _in_media(bundle, rows, s + lamp.nearest[rows]) & _lit(dark, rows, s + lamp.nearest[rows])
        if isinstance(lamp.light, SpotLight):
            kept &= cone_attenuation(_cos_axis(lamp, rows, s), lamp.light) > 0.0
        return kept

    row, begin, end = pieces(np.concatenate(cuts, axis=1), low, high, keep)
    scale = lamp.scale[row]
    far: Mask = (begin >= FAR * scale) | (end <= -FAR * scale)
    first, last = to_angle(begin, scale, far), to_angle(end, scale, far)
    ordered = last > first
    return Pool._make(column[ordered] for column in (row, 2 * source + far, first, last))


def _cos_axis(lamp: Lamp, rows: Integers, s: Array) -> Array:
    d = np.sqrt(s * s + lamp.across2[rows])
    return np.asarray((s * lamp.cone_slope[rows] + lamp.cone_offset[rows]) / np.maximum(d, TINY))


# --- the integrand ----------------------------------------------------------------------------------


def evaluate(bundle: Bundle, pool: Pool, *, block: int = 2048) -> Estimate:
    """Integrate all intervals of a pool by one rule.

    Parameters
    ----------
    bundle : Bundle
    pool : Pool
        As from `first_pool`.
    block : int
        Intervals that are worked on at a time; no effect on the result.

    Returns
    -------
    Estimate
        Radiance and error of each interval, shapes (3, n).
    """
    value, error = np.zeros((3, len(pool.owner))), np.zeros((3, len(pool.owner)))
    source = pool.kind // 2
    for number in np.unique(source).tolist():
        chosen = np.flatnonzero(source == number)
        for begin in range(0, len(chosen), block):
            which = chosen[begin:begin + block]
            part = pool.take(which)
            half = 0.5 * (part.high - part.low)
            # Beyond the range of numbers the result is not finite, which `integrate_pool` tells.
            with np.errstate(under="ignore", over="ignore", invalid="ignore"):
                values = _values(bundle, number, part, half)
                estimate = kronrod(np.broadcast_to(values, (3, len(half), NODES.size)), half)
            hidden = GAP * half * _hidden_faces(bundle, part, half)
            if hidden.any():
                hidden = hidden * np.abs(np.diff(values, axis=-1)).max(axis=-1)
            # What the rounding of the limits, and of a lamp's place, makes of the result.
            rounding = EPS * (np.abs(part.low) + np.abs(part.high)) / half
            if number - 1 in bundle.lamps:
                rounding += bundle.lamps[number - 1].rounding[part.owner]
            value[:, which] = estimate.value
            error[:, which] = estimate.error + rounding * np.abs(estimate.value) + hidden
    return Estimate(value, error)


def _values(bundle: Bundle, source: int, part: Pool, half: Array) -> Array:
    """The integrand at the nodes, (3, n, 15)."""
    rows = part.owner
    x = 0.5 * (part.low + part.high)[:, np.newaxis] + half[:, np.newaxis] * NODES
    light = bundle.physics.lights[source - 1] if source else None
    if light is None or isinstance(light, DirectionalLight):
        t = x
    else:
        lamp = bundle.lamps[source - 1]
        far = (part.kind % 2 == 1)[:, np.newaxis]
        s = from_angle(x, lamp.scale[rows][:, np.newaxis], far)
        t = s + lamp.nearest[rows][:, np.newaxis]
    points = line_points(bundle.lines, t, rows)
    media = media_at(bundle.physics.every_medium, points, bundle.physics.textures, bundle.physics.settings)
    if light is None:
        arriving = _glow(bundle.physics, media)
    elif isinstance(light, DirectionalLight):
        arriving = _sun(bundle, light, media, rows)
    else:
        arriving = _lamp(bundle, bundle.lamps[source - 1], media, rows, s, far)
    arriving = arriving * through(bundle, t, rows)
    if light is not None and bundle.physics.volumetric:
        arriving = arriving * light_transmittance(
            bundle.physics.media, bundle.physics.extinction, light, points,
            settings=bundle.physics.settings, sun_distance=bundle.physics.sun_distance)
    return np.asarray(arriving)


def _glow(physics: Physics, media: VBuffer) -> Array:
    """Ambient light scattered, and emission."""
    settings = physics.settings
    ambient = (CONSTANT_AMBIENT,) * 3 if settings.ambient == "constant" else physics.scene.ambient
    received = np.reshape(np.asarray(ambient, np.float64), (3, 1, 1))
    if settings.emission == "published":
        return np.asarray(media.scattering * (received + media.emission))
    return np.asarray(media.scattering * received + media.emission)


def _scattered(physics: Physics, media: VBuffer, cosine: Array, versine: Array) -> Array:
    """Σ σ_s·p over the lobes, (3, n, 15) or broadcastable."""
    settings = physics.settings
    parts: Sequence[tuple[Any, Any]] = media.lobes or ((media.scattering, media.phase_anisotropy),)
    total: Any = 0.0
    for scattering, g in parts:
        total = total + scattering * phase(settings.phase_function, cosine, g, versine=versine,
                                           second_lobe=settings.second_lobe)
    return np.asarray(total)


def _sun(bundle: Bundle, light: DirectionalLight, media: VBuffer, rows: Integers) -> Array:
    towards = np.asarray(unit(light.direction))[:, np.newaxis]
    along = bundle.lines.direction[:, rows]
    turn = towards - along
    versine = 0.5 * (turn * turn).sum(axis=0)[:, np.newaxis]
    cosine = (towards * along).sum(axis=0)[:, np.newaxis]
    return _scattered(bundle.physics, media, cosine, versine) * colour(light).reshape(3, 1, 1)


def _lamp(bundle: Bundle, lamp: Lamp, media: VBuffer, rows: Integers, s: Array, far: Mask) -> Array:
    """A lamp's light times the Jacobian of its variable."""
    across2, scale = lamp.across2[rows][:, np.newaxis], lamp.scale[rows][:, np.newaxis]
    d2 = s * s + across2
    d = np.maximum(np.sqrt(d2), TINY)
    cosine = -s / d
    # 1 + s/d, where the light lies ahead without the difference of like numbers.
    versine = np.where(s < 0.0, across2 / (d * (d + np.abs(s))), 1.0 - cosine)
    factor = distance_attenuation(d2, lamp.light, attenuation=bundle.physics.settings.attenuation)
    if isinstance(lamp.light, SpotLight):
        slope, offset = lamp.cone_slope[rows][:, np.newaxis], lamp.cone_offset[rows][:, np.newaxis]
        factor = factor * cone_attenuation((s * slope + offset) / d, lamp.light)
    factor = factor * jacobian(s, scale, far)
    scattered = _scattered(bundle.physics, media, cosine, versine)
    return scattered * factor * colour(lamp.light).reshape(3, 1, 1)


# --- where to split ---------------------------------------------------------------------------------


def split_at_cells(bundle: Bundle, pool: Pool) -> Array:
    """Where to split intervals: at the face of a texture's cell nearest to the middle, else in the middle.

    Parameters
    ----------
    bundle : Bundle
    pool : Pool
        Intervals of any sources.

    Returns
    -------
    ndarray, shape (n,)
        In each interval's own variable; NaN for the middle.

    Notes
    -----
    The light has a kink at every face. Cutting there first would cost an interval for each cell, a hundred
    a ray; cutting there only where the error asks for it converges as fast.
    """
    middle = 0.5 * (pool.low + pool.high)
    result = np.full(middle.shape, np.nan)
    textured = [k for k, placed in enumerate(bundle.physics.media) if placed.texture is not None]
    if not textured:
        return result
    t = _parameter(bundle, pool, middle)
    for k in textured:
        placed, path = bundle.physics.media[k], bundle.paths[k]
        rows = np.flatnonzero((t > path.enter[pool.owner]) & (t < path.leave[pool.owner]))
        lines = Lines._make(field[..., pool.owner[rows]] for field in bundle.lines)
        face = nearest_face(placed, lines, t[rows], **_sampling(bundle))
        result[rows] = _variable(bundle, pool.take(rows), face)
    return result


def _sampling(bundle: Bundle) -> dict[str, Any]:
    settings = bundle.physics.settings
    return {"time": settings.time, "addressing": settings.density_addressing}


def _hidden_faces(bundle: Bundle, pool: Pool, half: Array) -> Mask:
    """Intervals with a cell's face between an end and the first node, where no value tells of its kink."""
    result: Mask = np.zeros(half.shape, bool)
    for k, placed in enumerate(bundle.physics.media):
        if placed.texture is None:
            continue
        for end, inward in ((pool.low, GAP), (pool.high, -GAP)):
            a, b = (_parameter(bundle, pool, x) for x in (end, end + inward * half))
            path = bundle.paths[k]
            rows = np.flatnonzero((b > path.enter[pool.owner]) & (b < path.leave[pool.owner]))
            a, b = a[rows], b[rows]
            lines = Lines._make(field[..., pool.owner[rows]] for field in bundle.lines)
            face = nearest_face(placed, lines, 0.5 * (a + b), **_sampling(bundle))
            with np.errstate(invalid="ignore", divide="ignore"):
                share = (face - a) / (b - a)
            result[rows] |= (share > 1e-6) & (share < 1.0)
    return result


def _parameter(bundle: Bundle, pool: Pool, x: Array) -> Array:
    """Metres along the ray from an interval's own variable."""
    return _convert(bundle, pool, x, lambda lamp, rows, far, v: from_angle(v, lamp.scale[rows], far)
                    + lamp.nearest[rows])


def _variable(bundle: Bundle, pool: Pool, t: Array) -> Array:
    """An interval's own variable from metres along the ray."""
    return _convert(bundle, pool, t, lambda lamp, rows, far, v: to_angle(v - lamp.nearest[rows],
                                                                         lamp.scale[rows], far))


def _convert(bundle: Bundle, pool: Pool, values: Array, change: Any) -> Array:
    result = values.copy()
    for i, lamp in bundle.lamps.items():
        which = np.flatnonzero(pool.kind // 2 == i + 1)
        if which.size:
            far = pool.kind[which] % 2 == 1
            result[which] = change(lamp, pool.owner[which], far, values[which])
    return result
