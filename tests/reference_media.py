"""Media, the slow way: one point at a time, plain Python floats, nothing shared with the package."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from typing import Any

from froxel_ref.scene import DensityTexture, LocalMedium, Medium
from froxel_ref.settings import Settings

Point = tuple[float, float, float]


def solve(matrix: Sequence[Sequence[float]], point: Point) -> Point:
    """The local position of a world point: Cramer's rule on world_from_local (3 or 4 rows of 4)."""
    a, b, c = ([matrix[row][column] for row in range(3)] for column in range(3))
    p = [point[row] - matrix[row][3] for row in range(3)]

    def determinant(u: Sequence[float], v: Sequence[float], w: Sequence[float]) -> float:
        return (u[0] * (v[1] * w[2] - v[2] * w[1]) - u[1] * (v[0] * w[2] - v[2] * w[0])
                + u[2] * (v[0] * w[1] - v[1] * w[0]))

    whole = determinant(a, b, c)
    return determinant(p, b, c) / whole, determinant(a, p, c) / whole, determinant(a, b, p) / whole


def local_position(medium: LocalMedium, point: Point) -> Point:
    return solve(medium.transform.world_from_local.tolist(), point)


def is_inside(medium: Medium, point: Point) -> bool:
    if not isinstance(medium, LocalMedium):
        return True
    p = local_position(medium, point)
    return math.hypot(*p) <= 1.0 if medium.shape == "ellipsoid" else max(map(abs, p)) <= 1.0


def texel(texture: Any, record: DensityTexture, point: Point, time: float, addressing: str) -> float:
    """Eight weighted texels at frac(position·scale + bias + scroll·time)."""
    counts = tuple(reversed(texture.shape))
    bases, shares = [], []
    for i in range(3):
        u = point[i] * record.scale[i] + record.bias[i] + record.scroll[i] * time
        t = (u - math.floor(u)) * counts[i] - 0.5
        bases.append(math.floor(t))
        shares.append(t - math.floor(t))
    total = 0.0
    for corner in itertools.product((0, 1), repeat=3):
        weight, index = 1.0, []
        for side, base, share, count in zip(corner, bases, shares, counts, strict=True):
            weight *= share if side else 1.0 - share
            near = base + side
            index.append(near % count if addressing == "wrap" else min(max(near, 0), count - 1))
        total += weight * float(texture[index[2], index[1], index[0]])
    return total


def density(medium: Medium, point: Point, texture: Any, time: float, addressing: str) -> float:
    if not is_inside(medium, point):
        return 0.0
    if isinstance(medium, LocalMedium):
        a, b, c = local_position(medium, point)
        point = (a + 1.0) / 2.0, (b + 1.0) / 2.0, (c + 1.0) / 2.0
    value, fog = 1.0, medium.height_fog
    if fog is not None:
        if fog.max_height is not None and point[1] > fog.max_height:
            return 0.0
        if point[1] > fog.start:
            value = math.exp(-(point[1] - fog.start) * fog.falloff)
    if medium.density is not None:
        value *= texel(texture, medium.density, point, time, addressing)
    return value


def rgb(value: float | tuple[float, float, float]) -> tuple[float, float, float]:
    return value if isinstance(value, tuple) else (value, value, value)


def material(media: Sequence[Medium], point: Point, textures: Mapping[Any, Any],
             settings: Settings) -> dict[str, Any]:
    """Scattering, extinction (RGB) and emission, g, and the scattering of each g, at a point."""
    scattering, extinction, emission = [0.0] * 3, [0.0] * 3, [0.0] * 3
    lobes: dict[float, float] = {}
    members = []
    for medium in media:
        texture = textures[medium.density.source] if medium.density is not None else None
        amount = density(medium, point, texture, settings.time, settings.density_addressing)
        for c in range(3):
            sigma_t, albedo = rgb(medium.extinction)[c] * amount, medium.albedo[c]
            scattering[c] += albedo * sigma_t
            extinction[c] += sigma_t
            absorbed = settings.emission == "absorption"
            emission[c] += medium.emissive[c] * ((1.0 - albedo) * sigma_t if absorbed else amount)
            lobes[medium.phase_anisotropy] = lobes.get(medium.phase_anisotropy, 0.0) + albedo * sigma_t
        if is_inside(medium, point):
            members.append(medium.phase_anisotropy)
    total = sum(lobes.values())
    weighted = sum(g * weight for g, weight in lobes.items()) / total if total > 0.0 else 0.0
    plain = sum(members) / len(members) if members else 0.0
    return {"scattering": scattering, "extinction": extinction, "emission": emission, "lobes": lobes,
            "anisotropy": plain if settings.phase_mixing == "mean" else weighted}
