"""Roots of many polynomials at once, for those that have real roots only."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from froxel_ref.arrays import Field
from froxel_ref.records import InputError

__all__ = ["real_roots"]

Array: TypeAlias = NDArray[np.floating[Any]]

SQRT_3 = 1.7320508075688772
POLISH = 2  # Newton steps: closed forms lose up to half of the digits of roots that nearly meet


def real_roots(coefficients: Field) -> Array:
    """The roots of polynomials all of whose roots are real.

    Parameters
    ----------
    coefficients : ndarray, shape (degree + 1, …) [1]
        Of the highest power first, which must not be 0; one polynomial along each of the other axes.

    Returns
    -------
    ndarray, shape (degree, …) [1]
        In no particular order.

    Raises
    ------
    InputError
        A constant.

    Notes
    -----
    Closed forms up to degree 4 (cubics by cosines; quartics as two quadratics, by the largest root of the resolvent),
    eigenvalues of companion matrices beyond, then Newton steps, kept where they make the value smaller. What rounding
    would have made complex is taken as the real double root. Roots as far apart as 0.4 and 1e4 keep 13 digits
    in all but one of 1000 quartics; of roots that are spread more the small ones lose theirs.

    Examples
    --------
    >>> np.sort(real_roots(np.array([1.0, -6.0, 11.0, -6.0]))).round(12).tolist()
    [1.0, 2.0, 3.0]
    """
    degree = len(coefficients) - 1
    if degree < 1:
        raise InputError("coefficients", "has no power above 0, must have one")
    monic = coefficients[1:] / coefficients[0]
    roots = CLOSED.get(degree, _companion)(monic)
    value, slope = _evaluate(monic, roots)
    for step in range(POLISH):
        moved = roots - value / np.where(slope == 0.0, np.inf, slope)
        new, new_slope = _evaluate(monic, moved)
        better = np.abs(new) < np.abs(value)
        roots = np.where(better, moved, roots)
        if step + 1 < POLISH:
            value, slope = np.where(better, new, value), np.where(better, new_slope, slope)
    return np.asarray(roots)


def _evaluate(monic: Array, x: Array) -> tuple[Array, Array]:
    """A monic polynomial's value and slope, by Horner's scheme."""
    value, slope = x + monic[0], np.ones_like(x)
    for c in monic[1:]:
        slope = slope * x + value
        value = value * x + c
    return value, slope


def _linear(monic: Array) -> Array:
    return -monic


def _quadratic(monic: Array) -> Array:
    """The root of larger size first, the other one by their product: no difference of equals."""
    half, product = 0.5 * monic[0], monic[1]
    width = np.sqrt(np.maximum(half * half - product, 0.0))
    large = -(half + np.copysign(width, half))
    return np.stack([large, product / np.where(large == 0.0, 1.0, large)])


def _cubic(monic: Array) -> Array:
    """x = s + 2ρ cos(φ + 2πk/3); the largest root is the first."""
    third = monic[0] / 3.0
    radius = np.sqrt(np.maximum(third * third - monic[1] / 3.0, 0.0))
    half = third * (third * third - 0.5 * monic[1]) + 0.5 * monic[2]
    angle = np.arctan2(np.sqrt(np.maximum(radius**6 - half * half, 0.0)), -half) / 3.0
    side, rise = radius * np.cos(angle), (SQRT_3 * radius) * np.sin(angle)
    return np.asarray(np.stack([2.0 * side, -side + rise, -side - rise]) - third)


def _quartic(monic: Array) -> Array:
    """Two quadratics with sums of roots −s and s about the mean root, s² the resolvent's largest root."""
    shift = 0.25 * monic[0]
    square = shift * shift
    p = monic[1] - 6.0 * square
    q = monic[2] + shift * (8.0 * square - 2.0 * monic[1])
    r = monic[3] + shift * (shift * (monic[1] - 3.0 * square) - monic[2])
    s2 = np.maximum(_cubic(np.stack([2.0 * p, p * p - 4.0 * r, -q * q]))[0], 0.0)
    s = np.sqrt(s2)
    middle, apart = 0.5 * (p + s2), 0.5 * q / np.where(s == 0.0, 1.0, s)
    pairs = _quadratic(np.stack([s, middle - apart])), _quadratic(np.stack([-s, middle + apart]))
    return np.asarray(np.concatenate(pairs) - shift)


def _companion(monic: Array) -> Array:
    degree, rest = len(monic), monic.shape[1:]
    matrix = np.zeros((*rest, degree, degree), monic.dtype)
    matrix[..., 0, :] = -np.moveaxis(monic, 0, -1)
    matrix[..., np.arange(1, degree), np.arange(degree - 1)] = 1.0
    return np.moveaxis(np.linalg.eigvals(matrix).real, -1, 0)


CLOSED: dict[int, Callable[[Array], Array]] = {1: _linear, 2: _quadratic, 3: _cubic, 4: _quartic}
