"""The light that arrives along rays from every piece of them, integrated: what `froxel_ref.truth` adds up.

A *source* is one light, or the glow of ambient light and emission. Each has its own intervals and its own
variable: metres for suns and glow, the equiangular angle for lamps (`froxel_ref.breaks`).
"""

from __future__ import annotations

from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from froxel_ref.breaks import FAR, Lamp, lamp_cuts, pieces, to_angle
from froxel_ref.bundles import Bundle, Physics, parameter
from froxel_ref.integrand import radiance, samples
from froxel_ref.lights import colour, cone_attenuation
from froxel_ref.quadrature import NODES, Estimate, Pool, kronrod
from froxel_ref.scene import DirectionalLight, SpotLight
from froxel_ref.unseen import EPS, GAP, hidden_faces, missed_density, thin_layers
from froxel_ref.veils import veiled

__all__ = ["Physics", "evaluate", "first_pool"]

Array: TypeAlias = NDArray[np.floating[Any]]
Integers: TypeAlias = NDArray[np.integer[Any]]
Mask: TypeAlias = NDArray[np.bool_]

GLOW = 0  # the source of ambient light and emission; light i is source i + 1
TINY = float(np.finfo(np.float64).tiny)


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
    parts = [_plain_intervals(bundle, GLOW)] if _glows(bundle.physics) else []
    for i, light in enumerate(bundle.physics.lights):
        if not colour(light).any():
            continue
        if isinstance(light, DirectionalLight):
            parts.append(_plain_intervals(bundle, i + 1))
        else:
            parts.append(_lamp_intervals(bundle, i + 1, bundle.lamps[i]))
    if not parts:
        nothing, none = np.zeros(0), np.zeros(0, np.intp)
        return Pool(none, none, nothing, nothing)
    return Pool._make(np.concatenate(columns) for columns in zip(*parts, strict=True))


def _glows(physics: Physics) -> bool:
    emits = any(any(medium.emissive) for medium in physics.every_medium)
    return emits or physics.settings.ambient == "constant" or any(physics.scene.ambient)


def _in_media(bundle: Bundle, rows: Integers, t: Array) -> Mask:
    """Whether points lie in a medium that dims or glows, and anything of it is seen through the layers."""
    result: Mask = np.zeros(t.shape, bool)
    for path, active in zip(bundle.paths, bundle.physics.active, strict=True):
        if active:
            within = (t > path.enter[rows]) & (t < path.leave[rows])
            result = np.asarray(np.logical_or(result, within))
    if bundle.veil is not None:
        result = np.asarray(result & (veiled(bundle.veil, rows, t) > 0.0))
    return result


def _lit(dark: Array | None, rows: Integers, t: Array) -> Mask:
    """Whether points lie in no shadow."""
    if dark is None or not dark.shape[1]:
        return np.ones(t.shape, bool)
    spans = dark[rows]
    inside = (t[:, np.newaxis] > spans[..., 0]) & (t[:, np.newaxis] < spans[..., 1])
    return np.asarray(~inside.any(axis=1))


def _cuts(bundle: Bundle, source: int) -> Array:
    """Cuts of the media, and of a light's shadows [m]; NaN where there is none."""
    cuts = [bundle.cuts]
    if source - 1 in bundle.dark:
        cuts.append(bundle.dark[source - 1].reshape(len(bundle.cuts), -1))
    if source - 1 in bundle.shaded:
        cuts.append(bundle.shaded[source - 1])
    return np.concatenate(cuts, axis=1)


def _plain_intervals(bundle: Bundle, source: int) -> Pool:
    dark = bundle.dark.get(source - 1)
    row, low, high = pieces(_cuts(bundle, source), bundle.lines.start, bundle.lines.stop,
                            lambda rows, t: _in_media(bundle, rows, t) & _lit(dark, rows, t))
    return Pool(row, np.full(row.shape, 2 * source), low, high)


def _lamp_intervals(bundle: Bundle, source: int, lamp: Lamp) -> Pool:
    """Intervals of the angle, each in the form that keeps its digits."""
    dark = bundle.dark.get(source - 1)
    cuts = [_cuts(bundle, source) - lamp.nearest[:, np.newaxis], lamp_cuts(lamp)]
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


# --- the integral -----------------------------------------------------------------------------------


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
            estimate = _evaluate(bundle, number, part)
            value[:, which], error[:, which] = estimate
    return Estimate(value, error)


def _evaluate(bundle: Bundle, source: int, part: Pool) -> Estimate:
    """Intervals of one source, by the rule; to its error comes what its nodes may not have seen."""
    half = 0.5 * (part.high - part.low)
    x = 0.5 * (part.low + part.high)[:, np.newaxis] + half[:, np.newaxis] * NODES
    # Beyond the range of numbers the result is not finite, which `integrate_pool` tells.
    with np.errstate(under="ignore", over="ignore", invalid="ignore"):
        at = samples(bundle, source, part, x)
        values = np.broadcast_to(radiance(bundle, at), (3, *x.shape))
        value, error = kronrod(values, half)
        error = np.maximum(error, missed_density(bundle, at, part, half))
        if source and bundle.physics.dims(source - 1):
            error = error + thin_layers(bundle, source, part, half, values)
        hidden = GAP * half * hidden_faces(bundle, part, half)
        if hidden.any():
            error = error + hidden * np.abs(np.diff(values, axis=-1)).max(axis=-1)
        return Estimate(value, error + _rounding(bundle, source, part, half) * np.abs(value))


def _rounding(bundle: Bundle, source: int, part: Pool, half: Array) -> Array:
    """What the rounding of the limits, and of places, makes of the result, as a share of it."""
    rounding: Array = EPS * (np.abs(part.low) + np.abs(part.high)) / half
    if bundle.physics.anchored:
        # Edges are found from the ray's origin, and are off by as much as that is.
        low, high = parameter(bundle, part, part.low), parameter(bundle, part, part.high)
        size = np.abs(bundle.lines.origin[:, part.owner]).max(axis=0)
        rounding = rounding + np.minimum(EPS * size / np.maximum(high - low, TINY), 1.0)
    if source - 1 in bundle.lamps:
        rounding = rounding + bundle.lamps[source - 1].rounding[part.owner]
    return rounding
