"""Phase functions in exact-input, high-precision arithmetic: the textbook formulas, term by term.

Nothing is rearranged for accuracy here; 80 digits make up for it. Inputs are the exact values of the
floats given, the constants 1.55, 0.55 and 0.9 are the decimal fractions that the sources print.
"""

from __future__ import annotations

from mpmath import mp, mpf

DIGITS = 80  # the textbook denominator cancels 32 digits at g = 1 − 2⁻⁵³
FIT_A, FIT_B = (31, 20), (11, 20)


def _ratio(parts: tuple[int, int]) -> mpf:
    return mpf(parts[0]) / parts[1]


def isotropic(c: float, g: float) -> mpf:
    """1/(4π)."""
    return 1 / (4 * mp.pi)


def rayleigh(c: float, g: float) -> mpf:
    """3/(16π)(1 + c²)."""
    return 3 / (16 * mp.pi) * (1 + mpf(c) ** 2)


def henyey_greenstein(c: float, g: float) -> mpf:
    """(1 − g²)/(4π(1 + g² − 2gc)^1.5)."""
    x, m = mpf(g), mpf(c)
    return (1 - x**2) / (4 * mp.pi * mp.power(1 + x**2 - 2 * x * m, mpf(3) / 2))


def cornette_shanks(c: float, g: float) -> mpf:
    """3/2 (1 − g²)/(2 + g²) (1 + c²)/(4π(1 + g² − 2gc)^1.5)."""
    x, m = mpf(g), mpf(c)
    below = 4 * mp.pi * (2 + x**2) * mp.power(1 + x**2 - 2 * x * m, mpf(3) / 2)
    return 3 * (1 - x**2) * (1 + m**2) / (2 * below)


def fitted_k(g: float, fit: str) -> mpf:
    """k(g): the published cubic, or beyond |g| = 0.9 a straight line from it to k = 1 at |g| = 1.

    The line starts with the value of the cubic, and (1 − k)/(1 − g) stays what it is there.
    """
    size = abs(mpf(g))
    knee = mpf(9) / 10
    if fit == "corrected" and size > knee:
        at_knee = _ratio(FIT_A) * knee - _ratio(FIT_B) * knee**3
        k = 1 - (1 - at_knee) * (1 - size) / (1 - knee)
    else:
        k = _ratio(FIT_A) * size - _ratio(FIT_B) * size**3
    return -k if g < 0 else k


def schlick(c: float, g: float, fit: str = "corrected") -> mpf:
    """(1 − k²)/(4π(1 − kc)²)."""
    k = fitted_k(g, fit)
    return (1 - k**2) / (4 * mp.pi * (1 - k * mpf(c)) ** 2)


def two_lobe(c: float, g: float, second: float, weight: float) -> mpf:
    """(1 − w)p(g) + w p(g₂)."""
    w = mpf(weight)
    return (1 - w) * henyey_greenstein(c, g) + w * henyey_greenstein(c, second)


REFERENCE = {
    "isotropic": isotropic,
    "rayleigh": rayleigh,
    "henyey_greenstein": henyey_greenstein,
    "cornette_shanks": cornette_shanks,
    "schlick": schlick,
}
