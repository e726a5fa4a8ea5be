"""Lights and in-scattering by the textbook, one froxel at a time, in Python floats or mpmath numbers.

Vectors are formed and normalised, cosines are dot products: nothing here knows of rays.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import mpmath
import numpy as np

from froxel_ref.grid import Froxels
from froxel_ref.scene import DirectionalLight, Light, SpotLight

mp = mpmath.mp.clone()
mp.dps = 40


def dot(a: Sequence[Any], b: Sequence[Any]) -> Any:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def normalized(a: Sequence[Any], number: Callable[[Any], Any]) -> list[Any]:
    values = [number(c) for c in a]
    length = mp.sqrt(dot(values, values)) if number is mp.mpf else math.sqrt(dot(values, values))
    return [c / length for c in values]


def light(source: Light, point: Sequence[Any], *, attenuation: str = "min_distance",
          number: Callable[[Any], Any] = float) -> tuple[list[Any], Any]:
    """L and the factor on the light's colour."""
    if isinstance(source, DirectionalLight):
        return normalized(source.direction, number), number(1)
    to_light = [number(p) - number(x) for p, x in zip(source.position, point, strict=True)]
    d2 = dot(to_light, to_light)
    bound = number(source.min_distance) if attenuation == "min_distance" else 1 / number(source.radius)
    factor = 1 / max(d2, bound**2)
    if source.falloff == "windowed":
        factor *= max(0, 1 - (d2 / number(source.radius) ** 2) ** 2) ** 2
    L = normalized(to_light, number) if d2 > 0 else [number(0)] * 3
    if isinstance(source, SpotLight):
        radians = mp.radians if number is mp.mpf else math.radians
        cosine = mp.cos if number is mp.mpf else math.cos
        inner, outer = (cosine(radians(number(a))) for a in (source.inner_angle, source.outer_angle))
        cone = (-dot(L, normalized(source.direction, number)) - outer) / (inner - outer)
        factor *= min(1, max(0, cone)) ** 2
    return L, factor


def henyey_greenstein(cosine: Any, g: Any) -> Any:
    if isinstance(cosine, mp.mpf):
        return (1 - g * g) / (4 * mp.pi * (1 + g * g - 2 * g * cosine) ** mp.mpf("1.5"))
    return (1 - g * g) / (4 * math.pi * (1 + g * g - 2 * g * cosine) ** 1.5)


def in_scattering(scattering: Sequence[float], g: float, lights: Sequence[Light], camera: Sequence[float],
                  point: Sequence[Any], *, ambient: Sequence[float] = (0.0, 0.0, 0.0),
                  emission: Sequence[float] = (0.0, 0.0, 0.0), attenuation: str = "min_distance",
                  phase: Callable[[Any, Any], Any] = henyey_greenstein,
                  number: Callable[[Any], Any] = float) -> list[Any]:
    """RGB at one point."""
    total = [number(a) for a in ambient]
    V = normalized([number(c) - number(x) for c, x in zip(camera, point, strict=True)], number)
    for source in lights:
        L, factor = light(source, point, attenuation=attenuation, number=number)
        weight = factor * phase(-dot(V, L), number(g))
        colour = source.irradiance if isinstance(source, DirectionalLight) else source.intensity
        total = [t + number(c) * weight for t, c in zip(total, colour, strict=True)]
    return [number(s) * t + number(e) for s, t, e in zip(scattering, total, emission, strict=True)]


def sample(froxels: Froxels, z: int, y: int, x: int, number: Callable[[Any], Any] = float) -> list[Any]:
    """The position of a froxel's sample, from the numbers that the grid holds."""
    place = []
    for start, component in zip(froxels.rays.origin, froxels.rays.per_depth, strict=True):
        step = np.broadcast_to(component, froxels.rays.length.shape)[y, x]
        place.append(number(start) + number(float(step)) * number(float(froxels.depths[z, 0, 0])))
    return place
