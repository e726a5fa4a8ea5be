"""Slow scalar versions of slice integration and lookup: mpmath and plain Python numbers, no NumPy inside."""

from __future__ import annotations

import math
from collections.abc import Sequence

import mpmath
import numpy as np

DIGITS = 40


def exact_slice(source: float, extinction: float, length: float) -> tuple[mpmath.mpf, mpmath.mpf]:
    """∫₀^d e^(−σx) S dx and e^(−σd) of the numbers exactly as given, to 40 digits."""
    with mpmath.workdps(DIGITS):
        s, sigma, d = (mpmath.mpf(float(value)) for value in (source, extinction, length))
        integral = s * d if sigma == 0 else -s * mpmath.expm1(-sigma * d) / sigma
        return integral, mpmath.exp(-sigma * d)


def ulps(got: float | np.floating, exact: mpmath.mpf) -> float:
    """Distance from the exact value in units of the spacing of floats there (of denormals near 0)."""
    dtype = type(got) if isinstance(got, np.floating) else np.float64
    with mpmath.workdps(DIGITS), np.errstate(under="ignore"):
        spacing = np.spacing(dtype(abs(exact)))
        return float(abs(mpmath.mpf(float(got)) - exact) / mpmath.mpf(float(spacing)))


def exact_column(sources: Sequence[float], extinctions: Sequence[float], lengths: Sequence[float]
                 ) -> tuple[list[mpmath.mpf], list[mpmath.mpf]]:
    """Light and transmittance after each slice: the sum over slices, each behind all those before it."""
    light, through = [], []
    with mpmath.workdps(DIGITS):
        for k in range(len(lengths)):
            optical = [mpmath.mpf(e) * mpmath.mpf(d) for e, d in zip(extinctions, lengths, strict=True)]
            through.append(mpmath.exp(-mpmath.fsum(optical[:k + 1])))
            light.append(mpmath.fsum(exact_slice(sources[j], extinctions[j], lengths[j])[0]
                                     * mpmath.exp(-mpmath.fsum(optical[:j])) for j in range(k + 1)))
    return light, through


def lookup_pixel(values: Sequence[Sequence[Sequence[float]]], front: Sequence[Sequence[float]], camera: float,
                 boundaries: Sequence[float], slice_of_depth: float, depth: float, u: float, v: float,
                 lookup: str) -> float:
    """One pixel's fog, as a sum over all stored texels of tent weights.

    ``values[k][j][i]``, ``front[j][i]``: what is stored; ``u``, ``v``: place in the image, 0 to 1;
    ``slice_of_depth``: the depth's slice coordinate, by whatever formula the grid has.
    """
    slices, rows, columns = len(values), len(values[0]), len(values[0][0])
    planes = list(values)
    if lookup == "boundary":
        planes = [[[camera] * columns] * rows, front, *values]
        z = depth / boundaries[0] if depth < boundaries[0] else 1.0 + min(slice_of_depth, slices)
    else:
        z = slice_of_depth - 0.5
    places = [min(max(place, 0.0), count - 1.0) for place, count in
              ((z, len(planes)), (v * rows - 0.5, rows), (u * columns - 0.5, columns))]
    tents = [[max(0.0, 1.0 - abs(place - i)) for i in range(count)] for place, count in
             zip(places, (len(planes), rows, columns), strict=True)]
    return math.fsum(tents[0][k] * tents[1][j] * tents[2][i] * planes[k][j][i]
                     for k in range(len(planes)) for j in range(rows) for i in range(columns))
