"""Sums, products, quotients and roots that carry their own rounding errors: about 106 bits in two float64.

For the few values per ray that the whole frame rests on, where a plain float64 would spend the digits
that the rest of the pipeline keeps [Dekker 1971; Higham 2002, §27.9].
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = ["FOUR_PI", "DoubleDouble", "cross", "dot", "double_double", "two_product", "two_sum", "where"]

Doubles = NDArray[np.float64]

# Splits a float64 into halves of 26 bits, whose products are exact [Dekker 1971].
SPLITTER = 2.0**27 + 1.0


def two_sum(a: Doubles, b: Doubles) -> tuple[Doubles, Doubles]:
    """The rounded sum of two arrays and its rounding error; their sum is exact.

    Parameters
    ----------
    a, b : ndarray, float64
        Finite.

    Returns
    -------
    sum, error : ndarray

    Examples
    --------
    >>> [float(part) for part in two_sum(np.float64(1.0), np.float64(2.0**-60))]
    [1.0, 8.673617379884035e-19]
    """
    total = a + b
    back = total - a
    return total, (a - (total - back)) + (b - back)


def _split(a: Doubles) -> tuple[Doubles, Doubles]:
    scaled = SPLITTER * a
    high = scaled - (scaled - a)
    return high, a - high


def two_product(a: Doubles, b: Doubles) -> tuple[Doubles, Doubles]:
    """The rounded product of two arrays and its rounding error; their sum is exact.

    Parameters
    ----------
    a, b : ndarray, float64
        Below 1e299 in size; the error is exact where the product is above 1e-290.

    Returns
    -------
    product, error : ndarray

    Examples
    --------
    >>> [float(part) for part in two_product(np.float64(1.0 + 2.0**-52), np.float64(1.0 - 2.0**-52))]
    [1.0, -4.930380657631324e-32]
    """
    product = a * b
    (a_high, a_low), (b_high, b_low) = _split(a), _split(b)
    return product, ((a_high * b_high - product) + a_high * b_low + a_low * b_high) + a_low * b_low


@dataclass(frozen=True, eq=False)
class DoubleDouble:
    """An array of unevaluated sums of two float64: ``high`` is the value rounded, ``low`` what is missing.

    Relative error of an operation: below 2⁻¹⁰⁰ (sums of opposite sign lose what they cancel, from 106 bits).

    Examples
    --------
    >>> third = double_double(1.0) / double_double(3.0)
    >>> float((third * double_double(3.0) - double_double(1.0)).high) == 0.0
    True
    """

    high: Doubles
    low: Doubles

    def __add__(self, other: DoubleDouble) -> DoubleDouble:
        high, error = two_sum(self.high, other.high)
        low, further = two_sum(self.low, other.low)
        high, error = two_sum(high, error + low)
        return DoubleDouble(*two_sum(high, error + further))

    def __neg__(self) -> DoubleDouble:
        return DoubleDouble(-self.high, -self.low)

    def __sub__(self, other: DoubleDouble) -> DoubleDouble:
        return self + (-other)

    def __mul__(self, other: DoubleDouble) -> DoubleDouble:
        high, error = two_product(self.high, other.high)
        return DoubleDouble(*two_sum(high, error + (self.high * other.low + self.low * other.high)))

    def __truediv__(self, other: DoubleDouble) -> DoubleDouble:
        first = self.high / other.high
        rest = self - other * double_double(first)
        second = rest.high / other.high
        rest = rest - other * double_double(second)
        return double_double(first) + double_double(second) + double_double(rest.high / other.high)

    def sqrt(self) -> DoubleDouble:
        """The square root; 0 of 0."""
        first = np.sqrt(self.high)
        rest = self - double_double(first) * double_double(first)
        safe = np.where(first > 0.0, first, 1.0)
        return DoubleDouble(*two_sum(first, rest.high / (2.0 * safe)))


def double_double(value: ArrayLike) -> DoubleDouble:
    """A float64 array (or what converts to one exactly) with a low part of 0.

    Parameters
    ----------
    value : array_like

    Returns
    -------
    DoubleDouble
    """
    high = np.asarray(value, np.float64)
    return DoubleDouble(high, np.zeros_like(high))


def where(chosen: NDArray[np.bool_], first: DoubleDouble, other: DoubleDouble) -> DoubleDouble:
    """Element by element one of two, like `numpy.where`."""
    return DoubleDouble(np.where(chosen, first.high, other.high), np.where(chosen, first.low, other.low))


def dot(a: Sequence[DoubleDouble], b: Sequence[DoubleDouble]) -> DoubleDouble:
    """The scalar product of vectors with three components."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def cross(a: Sequence[DoubleDouble], b: Sequence[DoubleDouble]) -> list[DoubleDouble]:
    """The vector product of vectors with three components.

    Examples
    --------
    >>> x, y, z = ([double_double(c) for c in row] for row in np.eye(3))
    >>> [float(c.high) for c in cross(x, y)], float(dot(x, x).high)
    ([0.0, 0.0, 1.0], 1.0)
    """
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]


# 4π to 106 bits: 4·(π rounded), and 4·(π − π rounded) [any table of π].
FOUR_PI = DoubleDouble(np.float64(12.566370614359172), np.float64(4.898587196589413e-16))  # type: ignore[arg-type]
