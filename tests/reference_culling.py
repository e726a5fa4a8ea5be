"""Which froxels a light or a medium touches, one by one, in Python floats; and lists, bit by bit."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from froxel_ref.grid import Froxels
from froxel_ref.scene import LocalMedium, PointLight, SpotLight
from tests.reference_lighting import dot, normalized, sample


def reaches(light: PointLight, point: Sequence[float]) -> bool:
    """Whether a windowed light gives a point anything."""
    away = [x - p for x, p in zip(point, light.position, strict=True)]
    distance = math.sqrt(dot(away, away))
    if distance >= light.radius:
        return False
    if not isinstance(light, SpotLight):
        return True
    along = dot(away, normalized(light.direction, float))
    return along > distance * math.cos(math.radians(light.outer_angle))


def holds(medium: LocalMedium, point: Sequence[float]) -> bool:
    """Whether a local medium's shape holds a point."""
    local = np.linalg.inv(medium.transform.world_from_local) @ (*point, 1.0)
    size = max(map(abs, local[:3])) if medium.shape == "box" else dot(local[:3], local[:3])
    return bool(size <= 1.0)


def touched(item: PointLight | LocalMedium, froxels: Froxels) -> np.ndarray:
    """Whether each froxel's sample is touched, shape (D, H, W)."""
    result = np.zeros((len(froxels.depths), *froxels.rays.length.shape), bool)
    for z, y, x in np.ndindex(*result.shape):
        point = sample(froxels, z, y, x)
        result[z, y, x] = holds(item, point) if isinstance(item, LocalMedium) else reaches(item, point)
    return result


def bit(tiles: np.ndarray, place: int, row: int, column: int) -> bool:
    """The bit of the place-th light in a tile."""
    return bool(int(tiles[place // 32, row, column]) >> (place % 32) & 1)
