"""Linear filtering as a sum of hat functions, in exact rational arithmetic."""

from __future__ import annotations

import math
from fractions import Fraction


def weights(coordinate: float, count: int, address: str,
            weight_bits: int | None = None) -> dict[int, Fraction]:
    """Weight of each texel: hats max(0, 1 − |x − centre|) of an endless row of texels, folded back."""
    x = Fraction(coordinate)
    result: dict[int, Fraction] = {}
    middle = math.floor(x)
    for i in range(middle - 1, middle + 2):
        weight = max(Fraction(0), 1 - abs(x - i - Fraction(1, 2)))
        if weight_bits is not None:
            weight = Fraction(round(weight * 2**weight_bits), 2**weight_bits)
        texel = i % count if address == "wrap" else min(max(i, 0), count - 1)
        result[texel] = result.get(texel, Fraction(0)) + weight
    return {i: w for i, w in result.items() if w}


def trilinear(texture: list[list[list[float]]], x: float, y: float, z: float, address: str,
              weight_bits: int | None = None) -> Fraction:
    """The weighted sum over the texels of a nested list [z][y][x]."""
    sizes = (len(texture), len(texture[0]), len(texture[0][0]))
    wz, wy, wx = (weights(c, n, address, weight_bits) for c, n in zip((z, y, x), sizes, strict=True))
    return sum((wz[k] * wy[j] * wx[i] * Fraction(texture[k][j][i]) for k in wz for j in wy for i in wx),
               Fraction(0))
