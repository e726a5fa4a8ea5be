"""Norms: how far a result is from what was expected, as numbers that cannot pass by accident.

Every norm treats what is not finite first and exactly: NaN and each infinity must stand in the same places
in both arrays. Where they do not, the norm has a `fault` in words, its value is NaN, and it is within no
limit. Where they do, they count as equal and enter no mean. Arrays of another shape, another type or
without elements are refused: a comparison that compares nothing must not pass.

| norm | value |
| --- | --- |
| `absolute` | mean of \\|a − b\\| |
| `relative` | mean of \\|a − b\\|/\\|b\\| |
| `relative_mse` | mean of (a − b)²/(b² + ε) |
| `bias` | mean of a − b, as it is or over the mean of \\|b\\| |
| `quantile` | of the absolute or relative error, or the distance in ulp |
| `maximum` | the same, with its place |

a is the result, b what was expected. `bias` alone cannot see a permutation or errors that cancel; the
others see any change. `ulp_distance` and `order` stand by themselves.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from froxel_ref.arrays import Field
from froxel_ref.records import InputError, shown, suggest
from froxel_ref.ulp import INCOMPARABLE, checked, ulp_distance

__all__ = [
    "INCOMPARABLE", "MEASURES", "Norm", "Order", "absolute", "bias", "maximum", "order", "quantile",
    "relative", "relative_mse", "ulp_distance",
]

Doubles = NDArray[np.float64]

MEASURES = ("absolute", "relative", "ulp")

# ε of relMSE on radiance of order 1 [Rousselle 2011].
RELATIVE_MSE_EPSILON = 1e-2

# Numbers above are brought down before they are subtracted, where the difference might overflow.
HUGE = 1e300


class Norm(NamedTuple):
    """One norm of the difference of two arrays.

    Attributes
    ----------
    name : str
        Such as ``relative_mse``.
    value : float
        NaN where there is a fault; infinity where it exceeds all numbers.
    pairs : int
        Pairs of finite numbers that it was taken over.
    fault : str
        Why the arrays cannot be close whatever the value, in words; empty if there is no such reason.
    place : tuple of int
        Index of the element, for a maximum; of the first faulty one, with a fault; else empty.
    epsilon : float or None
        Of relMSE.
    """

    name: str
    value: float
    pairs: int
    fault: str = ""
    place: tuple[int, ...] = ()
    epsilon: float | None = None

    def within(self, limit: float) -> bool:
        """Whether there is no fault and the value's size is at most ``limit``; never for NaN.

        Examples
        --------
        >>> bad = absolute(np.array([1.0, np.nan]), np.ones(2))
        >>> bad.within(float("inf")), bad.fault
        (False, 'NaN instead of 1.0 at (1,)')
        """
        return not self.fault and abs(self.value) <= limit


class Order(NamedTuple):
    """An order of convergence: error ≈ constant·step^order.

    Attributes
    ----------
    order : float
        Slope of log error against log step.
    constant : float
        The fitted error at a step of 1; infinity or 0 where beyond all numbers.
    residual : float
        Root mean square of ln(error/fit): 0 for an exact power law, 0.1 for 10 % scatter.
    """

    order: float
    constant: float
    residual: float


# --- norms ------------------------------------------------------------------------------------------


def absolute(result: ArrayLike, expected: ArrayLike) -> Norm:
    """Mean absolute error.

    Parameters
    ----------
    result, expected : array_like
        Floats of the same type and shape, not empty.

    Returns
    -------
    Norm
        In the unit of the arrays.

    Raises
    ------
    InputError
        Another shape or type, or no elements.

    Examples
    --------
    >>> absolute([1.0, 2.0], [1.5, 2.0]).value
    0.25
    """
    return _mean("absolute", *checked(result, expected))


def relative(result: ArrayLike, expected: ArrayLike) -> Norm:
    """Mean relative error; a fault where 0 is expected and something else is there.

    Parameters
    ----------
    result, expected : array_like
        As for `absolute`.

    Returns
    -------
    Norm
        [1].

    Raises
    ------
    InputError
        Another shape or type, or no elements.

    Examples
    --------
    >>> relative([1.1, 0.0], [1.0, 0.0]).value.__round__(12)
    0.05
    >>> relative([1.0, 1e-9], [1.0, 0.0]).fault
    '1e-09 instead of 0.0 at (1,): no relative error'
    """
    return _mean("relative", *checked(result, expected))


def relative_mse(result: ArrayLike, expected: ArrayLike, *, epsilon: float = RELATIVE_MSE_EPSILON) -> Norm:
    """Relative mean squared error, relMSE.

    Parameters
    ----------
    result, expected : array_like
        As for `absolute`.
    epsilon : float
        Added to the expected value's square, in its unit squared; above 0. 0.01 is [Rousselle 2011]'s
        for radiance of order 1. The result repeats it.

    Returns
    -------
    Norm
        Mean of (a − b)²/(b² + ε) [1].

    Raises
    ------
    InputError
        As for `absolute`; an epsilon that is not positive and finite.

    Examples
    --------
    >>> norm = relative_mse([2.0, 1.0], [1.0, 1.0], epsilon=1.0)
    >>> round(norm.value, 12), norm.epsilon
    (0.25, 1.0)
    """
    if not (0.0 < epsilon < math.inf):
        raise InputError("epsilon", f"is {epsilon!r}, must be above 0 and finite")
    a, b = checked(result, expected)
    fault, place, alike = _strangers(a, b)
    if fault:
        return Norm("relative_mse", math.nan, 0, fault, place, epsilon)
    wide = b[alike].astype(np.float64)
    with np.errstate(over="ignore", under="ignore"):
        errors = _over(a[alike], b[alike], np.hypot(wide, math.sqrt(epsilon))) ** 2
    return Norm("relative_mse", _safe_mean(errors), errors.size, epsilon=epsilon)


def bias(result: ArrayLike, expected: ArrayLike, *, share: bool = False) -> Norm:
    """Mean signed error: what is left when errors that cancel have done so.

    Parameters
    ----------
    result, expected : array_like
        As for `absolute`.
    share : bool
        Divide by the mean of |expected|.

    Returns
    -------
    Norm
        Positive where the result is too large. In the unit of the arrays, or [1] with ``share``.

    Raises
    ------
    InputError
        As for `absolute`.

    Examples
    --------
    >>> bias([1.5, 2.5], [1.0, 2.0]).value, bias([2.0, 1.0], [1.0, 2.0]).value
    (0.5, 0.0)
    """
    a, b = checked(result, expected)
    fault, place, alike = _strangers(a, b)
    if fault:
        return Norm("bias", math.nan, 0, fault, place)
    ones = np.ones(int(alike.sum()))
    with np.errstate(over="ignore"):
        value = _safe_mean(_over(a[alike], b[alike], ones))
    if share:
        size = _safe_mean(np.abs(b[alike].astype(np.float64)))
        if size == 0.0 and value != 0.0:
            return Norm("bias", math.nan, ones.size, "everything expected is 0: no share of it")
        value = value / size if size else 0.0
    return Norm("bias", value, ones.size)


def quantile(result: ArrayLike, expected: ArrayLike, share: float, *, measure: str = "absolute") -> Norm:
    """The error that a given share of the elements does not exceed.

    Parameters
    ----------
    result, expected : array_like
        As for `absolute`.
    share : float
        In [0, 1]; ½ is the median.
    measure : {"absolute", "relative", "ulp"}
        What an element's error is.

    Returns
    -------
    Norm
        An error that occurs, never one between two (the lowest one that the share does not exceed).

    Raises
    ------
    InputError
        As for `absolute`; an unknown measure; a share outside [0, 1].

    Examples
    --------
    >>> quantile([0.0, 0.0, 0.0, 4.0], [0.0, 1.0, 2.0, 1.0], 0.5).value
    1.0
    """
    if not 0.0 <= share <= 1.0:
        raise InputError("share", f"is {share!r}, must be in [0, 1]")
    a, b = checked(result, expected)
    fault, place, errors, _ = _errors(a, b, measure)
    name = f"quantile {share:g} ({measure})"
    if fault:
        return Norm(name, math.nan, 0, fault, place)
    value = float(np.quantile(errors, share, method="inverted_cdf")) if errors.size else 0.0
    return Norm(name, value, errors.size)


def maximum(result: ArrayLike, expected: ArrayLike, *, measure: str = "absolute") -> Norm:
    """The largest error, and where it is.

    Parameters
    ----------
    result, expected : array_like
        As for `absolute`.
    measure : {"absolute", "relative", "ulp"}
        What an element's error is.

    Returns
    -------
    Norm
        With the place of the first largest error.

    Raises
    ------
    InputError
        As for `absolute`; an unknown measure.

    Examples
    --------
    >>> norm = maximum([[1.0, 2.0], [3.0, 4.0]], [[1.0, 2.0], [3.5, 4.0]])
    >>> norm.value, norm.place
    (0.5, (1, 0))
    """
    a, b = checked(result, expected)
    fault, place, errors, alike = _errors(a, b, measure)
    name = f"maximum ({measure})"
    if fault:
        return Norm(name, math.nan, 0, fault, place)
    if not errors.size:
        return Norm(name, 0.0, 0)
    worst = int(np.argmax(errors))
    return Norm(name, float(errors[worst]), errors.size, place=_index(np.flatnonzero(alike)[worst], a.shape))


def order(steps: ArrayLike, errors: ArrayLike) -> Order:
    """Fit an order of convergence.

    Parameters
    ----------
    steps : array_like, shape (n,)
        Sizes of the discretisation's steps, such as 1/slices; at least two different ones.
    errors : array_like, shape (n,)
        Error at each.

    Returns
    -------
    Order

    Raises
    ------
    InputError
        Fewer than two steps or all of them equal; anything that is not positive and finite. An error of 0
        has no logarithm, and leaving it out would hide that the floor of the arithmetic was reached.

    Notes
    -----
    Least squares of ln error against ln step.

    Examples
    --------
    >>> fit = order([1.0, 0.5, 0.25], [3.0, 0.75, 0.1875])
    >>> round(fit.order, 12), round(fit.constant, 12), round(fit.residual, 12)
    (2.0, 3.0, 0.0)
    """
    h, e = np.asarray(steps, np.float64), np.asarray(errors, np.float64)
    if h.ndim != 1 or h.shape != e.shape:
        raise InputError("errors", f"has shape {e.shape}, must be that of steps, ({h.size},)")
    for name, values in (("steps", h), ("errors", e)):
        bad = np.flatnonzero(~(np.isfinite(values) & (values > 0.0)))
        if bad.size:
            raise InputError(f"{name}[{bad[0]}]",
                             f"is {float(values[bad[0]])!r}, must be positive and finite")
    if np.unique(h).size < 2:
        raise InputError("steps", "must hold at least two different sizes")
    x, y = np.log(h), np.log(e)
    across, up = x - x.mean(), y - y.mean()
    slope = float((across @ up) / (across @ across))
    start = float(y.mean() - slope * x.mean())
    residual = float(np.sqrt(np.mean((up - slope * across) ** 2)))
    with np.errstate(over="ignore", under="ignore"):
        return Order(slope, float(np.exp(start)), residual)


# --- parts ------------------------------------------------------------------------------------------


def _index(flat: Any, shape: tuple[int, ...]) -> tuple[int, ...]:
    return tuple(int(i) for i in np.unravel_index(int(flat), shape))


def _strangers(a: Field, b: Field) -> tuple[str, tuple[int, ...], NDArray[np.bool_]]:
    """What is wrong among NaN and infinities, the first place of it, and which pairs are both finite."""
    finite = np.isfinite(a) & np.isfinite(b)
    same = finite | (np.isnan(a) & np.isnan(b)) | (a == b)
    if same.all():
        return "", (), finite
    wrong = np.flatnonzero(~same)
    place = _index(wrong[0], a.shape)
    more = f", the first of {wrong.size}" if wrong.size > 1 else ""
    return f"{_said(a[place])} instead of {_said(b[place])} at {place}{more}", place, finite


def _said(value: Any) -> str:
    return "NaN" if np.isnan(value) else shown(float(value))


def _over(a: Field, b: Field, divisor: Doubles) -> Doubles:
    """(a − b)/divisor in float64, without an overflow on the way where the quotient has none."""
    a, b = a.astype(np.float64), b.astype(np.float64)
    scale = np.where(np.maximum(np.abs(a), np.abs(b)) > HUGE, 0.25, 1.0)
    quotient: Doubles = (a * scale - b * scale) / divisor / scale
    return quotient


def _errors(a: Field, b: Field, measure: str) -> tuple[str, tuple[int, ...], Doubles, NDArray[np.bool_]]:
    """Fault and its place; the errors of the finite pairs, and which pairs they are."""
    if measure not in MEASURES:
        raise InputError("measure", f"is {shown(measure)}; {suggest(str(measure), MEASURES)}")
    fault, place, finite = _strangers(a, b)
    none = np.empty(0)
    if fault:
        return fault, place, none, finite
    if measure == "ulp":
        return "", (), ulp_distance(a, b)[finite].astype(np.float64), finite
    wide = np.abs(b.astype(np.float64))
    if measure == "relative":
        endless = finite & (b == 0.0) & (a != 0.0)
        if endless.any():
            place = _index(np.flatnonzero(endless)[0], a.shape)
            return f"{_said(a[place])} instead of 0.0 at {place}: no relative error", place, none, finite
    divisor = np.where(wide > 0.0, wide, 1.0)[finite] if measure == "relative" else np.ones(int(finite.sum()))
    with np.errstate(over="ignore", under="ignore"):
        return "", (), np.abs(_over(a[finite], b[finite], divisor)), finite


def _mean(measure: str, a: Field, b: Field) -> Norm:
    fault, place, errors, _ = _errors(a, b, measure)
    if fault:
        return Norm(measure, math.nan, 0, fault, place)
    return Norm(measure, _safe_mean(errors), errors.size)


def _safe_mean(values: Doubles) -> float:
    """The mean, without an overflow of the sum; 0 of no values."""
    largest = float(np.abs(values).max(initial=0.0))
    if largest == 0.0 or math.isinf(largest):
        return largest
    # A power of two: dividing by it and multiplying again rounds nothing.
    unit = math.ldexp(1.0, max(-1000, math.frexp(largest)[1] - 1))
    return float(np.mean(values / unit)) * unit
