"""Slow loops for Fourier opacity maps: the thesis's march and lookup, a sample at a time, and exact ways to a light."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np

Extinction = Callable[[np.ndarray], float]


def listing_3_18(extinction: Extinction, origin: np.ndarray, way: np.ndarray, length: float, steps: int,
                 harmonics: int, *, offset: float = 0.0, least: float = 0.0) -> np.ndarray:
    """Coefficients of a march with points at (k + offset)·step [Dörries 2020, listings 3.16 and 3.18]."""
    result = np.zeros((2, harmonics + 1))
    size = length / steps
    for i in range(steps):
        t = (i + offset) * size
        transmittance = max(math.exp(-extinction(origin + t * way) * size), least)
        for k in range(harmonics + 1):
            angle = 2.0 * math.pi * k * t / length
            result[0, k] += -2.0 * math.log(transmittance) * math.cos(angle)
            result[1, k] += -2.0 * math.log(transmittance) * math.sin(angle)
    return result


def listing_3_17(a: Sequence[float], b: Sequence[float], depth: float) -> float:
    """Transmittance from coefficients [Dörries 2020, listing 3.17]."""
    total = 0.5 * a[0] * depth
    for k in range(1, len(a)):
        total += a[k] / (2.0 * math.pi * k) * math.sin(2.0 * math.pi * k * depth)
        total += b[k] / (2.0 * math.pi * k) * (1.0 - math.cos(2.0 * math.pi * k * depth))
    return min(max(math.exp(-total), 0.0), 1.0)


def fold(way: np.ndarray) -> tuple[float, float]:
    """A direction on the octahedron's square [−1, 1]², the middle component (y) up [Meyer 2010]."""
    x, y, z = way / np.abs(way).sum()
    if y >= 0.0:
        return x, z
    return (1.0 - abs(z)) * math.copysign(1.0, x), (1.0 - abs(x)) * math.copysign(1.0, z)


def unfold(u: float, v: float) -> np.ndarray:
    """The inverse: a unit vector."""
    y = 1.0 - abs(u) - abs(v)
    if y < 0.0:
        u, v = (1.0 - abs(v)) * math.copysign(1.0, u), (1.0 - abs(u)) * math.copysign(1.0, v)
    way = np.array([u, y, v])
    return way / math.sqrt(way @ way)


def neighbour(row: int, column: int, size: int) -> tuple[int, int]:
    """The texel that lies at (row, column) of an octahedral map without gutter, also beyond its edges."""
    if row < 0 or row >= size:
        row, column = (-1 - row if row < 0 else 2 * size - 1 - row), size - 1 - column
    if column < 0 or column >= size:
        row, column = size - 1 - row, (-1 - column if column < 0 else 2 * size - 1 - column)
    return row, column
