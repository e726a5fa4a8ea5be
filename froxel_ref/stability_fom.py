"""Kernels of Fourier opacity maps: what a particle and a step of a march add."""

from __future__ import annotations

import numpy as np

from froxel_ref.arrays import Field
from froxel_ref.fom import PUBLISHED_LEAST_TRANSMITTANCE, opacity_depth
from froxel_ref.kernel_registry import Kernel, Parameter, register

__all__: list[str] = []


def _from_transmittance(transmittance: Field) -> Field:
    """The thesis's way: a transmittance, cut, and its logarithm [Dörries 2020, listing 3.16]."""
    return np.asarray(-np.log(np.maximum(transmittance, transmittance.dtype.type(PUBLISHED_LEAST_TRANSMITTANCE))))


OPACITY = Parameter("opacity", "1", "share", 0.0, 1.0, (0.0, 1e-30, 1e-8, 0.5, 0.99999), 0.1)
EXTINCTION = Parameter("extinction", "1/m", "magnitude", 1e-300, 1e8, (0.0, 1e-12, 0.05, 1e8), 0.05)
STEP = Parameter("step", "m", "magnitude", 1e-3, 1e3, (1e-3, 0.05, 1.0))

register(Kernel(
    "opacity_depth", "Fourier opacity maps", "optical depth of a particle from its opacity", (OPACITY,),
    {"corrected": opacity_depth, "published": lambda a: _from_transmittance(np.asarray(1.0 - a))},
    lambda mp, a: -mp.log(1 - a) if a < 1 else mp.inf, departure="D8: −ln(max(1 − α, 1e-5))"))
register(Kernel(
    "march_depth", "Fourier opacity maps", "optical depth of a step of a march", (EXTINCTION, STEP),
    {"corrected": lambda s, d: np.asarray(s * d), "published": lambda s, d: _from_transmittance(np.exp(-s * d))},
    lambda mp, s, d: s * d, departure="D8: −ln(max(exp(−σd), 1e-5))"))
