"""Kernels of shadow maps: directions folded to the octahedron's square."""

from __future__ import annotations

from typing import Any

import numpy as np

from froxel_ref.arrays import Field
from froxel_ref.kernel_registry import Kernel, Parameter, register
from froxel_ref.shadow_lookup import octahedral_square

__all__: list[str] = []

ACROSS = ("1", "magnitude", 1e-30, 1e30, (0.0, 1e-30, 1e-16, 1e-8, 1.0, 1e8, 1e30))


def _folded(x: Field, z: Field) -> Field:
    return octahedral_square(x, np.full_like(x, -1.0), z)[0]


def _by_difference(x: Field, z: Field) -> Field:
    """The fold as it is usually written: 1 less the other coordinate."""
    size = np.abs(x) + np.ones_like(x) + np.abs(z)
    return np.asarray(1.0 - np.abs(z / size))


def _exact(mp: Any, x: Any, z: Any) -> Any:
    return (x + 1) / (x + 1 + z)


register(Kernel(
    "octahedral_fold", "directions", "u of the octahedral map, in its lower half: the direction (x, −1, z)",
    (Parameter("x", *ACROSS), Parameter("z", *ACROSS)), {"corrected": _folded, "plain": _by_difference}, _exact,
    departure="plain: 1 − |v| from a rounded v", at_most=1.0, falling=1))
