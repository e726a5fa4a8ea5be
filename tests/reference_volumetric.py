"""Slow, exact forms of what dims light along one ray, in rational numbers: no code shared with the package."""

from __future__ import annotations

from fractions import Fraction


def exact_depth(stretches, depth):
    """The optical depth up to a depth of (start, stop, tau, rise), a point counting where it is at it or before."""
    d, total = Fraction(depth), Fraction(0)
    for start, stop, tau, rise in stretches:
        a, b, t, r = (Fraction(float(v)) for v in (start, stop, tau, rise))
        if d < a:
            continue
        if d >= b:
            total += t
            continue
        low = (t - r / 2) / (b - a)  # extinction at the beginning, then the slope, integrated
        slope = r / (b - a) ** 2
        total += low * (d - a) + slope * (d - a) ** 2 / 2
    return total


def stretches_of(absorbers, *texel):
    """The stretches of one ray as a list of tuples."""
    return [tuple(float(row[(i if len(row) > 1 else 0, *texel)]) for row in absorbers)
            for i in range(max(len(row) for row in absorbers))]
