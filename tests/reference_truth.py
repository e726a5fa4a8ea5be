"""Slow, independent single scattering: panels in geometric progression around every break, and mpmath.

Nothing here is shared with the package. Lines are given as (origin, direction, length), densities and
lights as plain functions of positions.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import mpmath
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
NODES, WEIGHTS = np.polynomial.legendre.leggauss(24)


def henyey_greenstein(deflection: Array, g: float) -> Array:
    """By the angle of deflection, in the form with half angles: 1 + g² − 2g·cos = (1−g)² + 4g·sin²(θ/2)."""
    return (1 - g * g) / (4 * np.pi * ((1 - g) ** 2 + 4 * g * np.sin(deflection / 2) ** 2) ** 1.5)


def panels(low: float, high: float, breaks: Sequence[float], finest: float) -> Array:
    """Ends of panels that shrink by ½ towards every break, down to ``finest``."""
    ends = {low, high}
    steps = 2.0 ** np.arange(0, 60)
    for point in [low, high, *[b for b in breaks if low < b < high]]:
        for sign in (-1.0, 1.0):
            near = point + sign * finest * steps
            ends |= set(near[(near > low) & (near < high)].tolist())
        ends.add(point)
    return np.array(sorted(ends))


def integral(f: Callable[[Array], Array], low: float, high: float, breaks: Sequence[float], *,
             finest: float = 1e-6) -> float:
    """∫ f, by 24 points in every panel."""
    if high <= low:
        return 0.0
    ends = panels(low, high, breaks, finest)
    half = 0.5 * np.diff(ends)[:, None]
    x = ends[:-1, None] + half * (1.0 + NODES)
    return float((f(x) * WEIGHTS * half).sum())


def lamp_in_uniform_fog(origin: Array, direction: Array, end: float, light: Array, *, extinction: float,
                        albedo: float, g: float, intensity: float, radius: float | None = None,
                        min_distance: float = 0.01) -> float:
    """A point light in fog without bounds; ``radius`` is that of the window, None for none."""
    q = np.asarray(light, float) - origin
    b = float(q @ direction)
    h = float(np.linalg.norm(q - b * direction))

    def f(s: Array) -> Array:
        d = np.hypot(s, h)
        deflection = np.arctan2(h, -s)  # 0 where the ray looks at the light from afar
        window = 1.0 if radius is None else np.maximum(1.0 - (d / radius) ** 4, 0.0) ** 2
        falloff = window / np.maximum(d, min_distance) ** 2
        return np.exp(-extinction * (s + b)) * henyey_greenstein(deflection, g) * falloff

    breaks = [0.0]
    for reach in (min_distance, radius or np.inf):
        if h < reach < np.inf:
            half = (reach * reach - h * h) ** 0.5
            breaks += [-half, half]
    finest = 0.05 * max(h, 1e-6) * (1 - abs(g))
    return albedo * extinction * intensity * integral(f, -b, end - b, breaks, finest=min(finest, 0.01))


def lamp_in_uniform_fog_exact(origin: Sequence[float], direction: Sequence[float], end: float,
                              light: Sequence[float], *, extinction: float, g: float) -> float:
    """The same with pure scattering and intensity 1, no window, straight from the definition, 30 digits."""
    mp = mpmath.mp.clone()
    mp.dps = 30
    o, u, p = ([mp.mpf(c) for c in v] for v in (origin, direction, light))
    length = mp.sqrt(sum(c * c for c in u))
    u = [c / length for c in u]
    q = [a - b for a, b in zip(p, o, strict=True)]
    b = sum(a * c for a, c in zip(q, u, strict=True))

    def f(t: mpmath.mpf) -> mpmath.mpf:
        way = [a - t * c for a, c in zip(q, u, strict=True)]
        d2 = sum(c * c for c in way)
        cosine = sum(a * c for a, c in zip(way, u, strict=True)) / mp.sqrt(d2)
        lobe = (1 - g * g) / (4 * mp.pi * (1 + g * g - 2 * g * cosine) ** mp.mpf("1.5"))
        return extinction * mp.exp(-extinction * t) * lobe / d2

    h = mp.sqrt(sum(c * c for c in q) - b * b)
    inner = [b + k * h for k in (-100, -10, -3, -1, 0, 1, 3, 10, 100) if 0 < b + k * h < end]
    return float(mp.quad(f, [0, *inner, end]))


def scattered(origin: Array, direction: Array, end: float, *, density: Callable[[Array], Array],
              light: Callable[[Array, Array], Array], extinction: float, scattering: float,
              breaks: Sequence[float] = (), finest: float = 1e-4) -> float:
    """∫ e^(−τ)·σ_s·ρ·light dt for any density and light, τ by the same panels, running.

    ``density`` and ``light`` take points (3, n); light also the distances t, and includes the phase function.
    """
    ends = panels(0.0, end, breaks, finest)
    half = 0.5 * np.diff(ends)[:, None]
    t = ends[:-1, None] + half * (1.0 + NODES)

    def at(values: Array) -> Array:
        return (origin[:, None] + direction[:, None] * values.reshape(-1)[None, :])

    rho = density(at(t)).reshape(t.shape)
    before = np.concatenate([[0.0], np.cumsum((rho * WEIGHTS * half).sum(axis=1))[:-1]])
    # Inside a panel: from its start to each node, by the rule shrunk to that stretch.
    inner = half * (1.0 + NODES) / 2.0
    fine = ends[:-1, None, None] + inner[..., None] * (1.0 + NODES)
    within = (density(at(fine)).reshape(fine.shape) * WEIGHTS * inner[..., None]).sum(axis=-1)
    through = np.exp(-extinction * (before[:, None] + within))
    values = through * scattering * rho * light(at(t), t.reshape(-1)).reshape(t.shape)
    return float((values * WEIGHTS * half).sum())


def transmittance_between(a: Array, b: Array, density: Callable[[Array], Array], extinction: float,
                          pieces: int = 4000) -> Array:
    """e^(−τ) from points (3, n) to points (3, n) or (3, 1): a plain midpoint rule."""
    share = (np.arange(pieces) + 0.5) / pieces
    length = np.linalg.norm(b - a, axis=0)
    total = np.zeros(length.shape)
    for u in share:
        total += density(a + (b - a) * u)
    return np.exp(-extinction * total / pieces * length)
