"""Numerical stability: every kernel against arithmetic with many digits, over ordinary and extreme inputs.

A `Kernel` is one line of mathematics as the package computes it, beside the same line in many digits. It
is registered once, by `register`, and then measured in every type, drawn and listed. A kernel may have
several forms: ``corrected``, which must hold, and others (``published``, ``plain``) that show what a
departure or a plain formula costs; all are measured against the same exact value.

Errors are counted in ulp: the distance from the exact value in spacings of the type there. The inputs are
taken as exact, so an ill-conditioned kernel is not excused by itself; its relative condition number
Σ|xᵢ·∂f/∂xᵢ|/|f| is found from the exact function and stands beside the error.
"""

from __future__ import annotations

import itertools
import math
import zlib
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from froxel_ref.arrays import Field
from froxel_ref.high_precision import digits
from froxel_ref.kernel_registry import PRECISIONS, Kernel, Parameter, kernels, register
from froxel_ref.records import InputError, shown, suggest
from froxel_ref.storage import store

__all__ = [
    "PRECISIONS", "Cases", "Kernel", "Measure", "Parameter", "condition_numbers", "errors_in_ulp",
    "exact_values",
    "kernels", "measure", "register", "run_form", "sample", "sweep",
]

Doubles: TypeAlias = NDArray[np.float64]
Progress: TypeAlias = Callable[[str, int, int], None]

DIGITS = 60  # 40 for the value; the rest for the difference quotient of the condition number
STEP = 1e-20  # relative step of that quotient
WELL = 4.0  # condition numbers below count as well-conditioned


class Cases(NamedTuple):
    """Inputs, one array per parameter, in the type to compute in."""

    inputs: tuple[Field, ...]


class Measure(NamedTuple):
    """What became of one form of a kernel in one precision; errors in ulp over the finite results.

    Attributes
    ----------
    kernel, group, form, precision : str
        Which.
    cases : int
        Inputs tried.
    beyond : int
        Of these, with an exact value beyond the type's largest number; they are not in the errors.
    not_a_number, infinite, negative, above : int
        Results that must not be: NaN; infinity for a finite value; below 0; above the kernel's bound.
    rising : int
        Steps at which a falling output grew.
    worst, mean : float
        Largest and mean error [ulp].
    worst_relative : float
        Largest relative error where the exact value is a normal number [1].
    condition : float
        Condition number at the worst error.
    worst_well : float
        Largest error where the condition number is below 4 [ulp].
    worst_per_condition : float
        Largest error over 1 + condition number [ulp].
    place : tuple of float
        The inputs of the worst error.
    """

    kernel: str
    group: str
    form: str
    precision: str
    cases: int
    beyond: int
    not_a_number: int
    infinite: int
    negative: int
    above: int
    rising: int
    worst: float
    mean: float
    worst_relative: float
    condition: float
    worst_well: float
    worst_per_condition: float
    place: tuple[float, ...]

    @property
    def sound(self) -> bool:
        """Whether nothing came out that must not be."""
        return not (self.not_a_number or self.infinite or self.negative or self.above or self.rising)


# --- inputs -----------------------------------------------------------------------------------------


def _drawn(parameter: Parameter, count: int, dtype: Any, rng: np.random.Generator) -> Doubles:
    limits, half = np.finfo(dtype), count // 2
    if parameter.kind == "choice":
        return rng.choice(np.array(parameter.extremes), count)
    even = rng.uniform(parameter.low, parameter.high, count)
    if parameter.kind == "linear":
        near = 10.0 ** -rng.uniform(0.0, limits.precision, count)
        return np.where(np.arange(count) < half, even,
                        parameter.low + (parameter.high - parameter.low) * near)
    if parameter.kind in ("share", "cosine"):
        near = np.copysign(1.0 - 10.0 ** -rng.uniform(0.0, limits.precision, count), even)
        return np.where(np.arange(count) < half, even, near)
    low, high = max(parameter.low, float(limits.tiny)), min(parameter.high, float(limits.max) / 4.0)
    middle = min(max(1.0, low), high)
    near = middle * 2.0 ** rng.uniform(-1.0, 1.0, count)
    wide = np.exp(rng.uniform(math.log(low), math.log(high), count))
    return np.clip(np.where(rng.permutation(count) < half, near, wide), low, high)


def sample(kernel: Kernel, count: int, precision: str) -> Cases:
    """Inputs for a kernel: random ones, then every combination of the hand-picked extremes.

    Parameters
    ----------
    kernel : Kernel
    count : int
        Random inputs.
    precision : str
        A key of `PRECISIONS`.

    Returns
    -------
    Cases
        The same for the same name, count and precision; float32 and float16 share theirs.

    Examples
    --------
    >>> [kernel] = kernels(["henyey_greenstein"])
    >>> [len(values) for values in sample(kernel, 10, "float32").inputs]
    [35, 35]
    """
    dtype = PRECISIONS[precision][0]
    rng = np.random.default_rng(zlib.crc32(kernel.name.encode()))
    count = max(2, round(count * kernel.share))
    drawn = [rng.permuted(_drawn(p, count, dtype, rng)) for p in kernel.parameters]
    grid = np.array(list(itertools.product(*(p.extremes or (p.typical,) for p in kernel.parameters)))).T
    columns = [np.concatenate([random, extreme]) for random, extreme in zip(drawn, grid, strict=True)]
    return Cases(tuple(_fitted(values, parameter, dtype)
                       for values, parameter in zip(columns, kernel.parameters, strict=True)))


def _fitted(values: Doubles, parameter: Parameter, dtype: Any) -> Field:
    """Values in the type; a share stays inside its open range, and what is too large becomes the largest."""
    limits = np.finfo(dtype)
    with np.errstate(under="ignore"):
        fitted = np.clip(values, -float(limits.max), float(limits.max)).astype(dtype)
    if parameter.kind == "share":
        edge = dtype(1.0) - limits.epsneg
        fitted = np.clip(fitted, -edge if parameter.low < 0.0 else dtype(0.0), edge)
    # The least denormal is meant where a number below it was picked.
    return np.where((values > 0.0) & (fitted == 0.0), limits.smallest_subnormal, fitted)


# --- results ----------------------------------------------------------------------------------------


def run_form(kernel: Kernel, form: str, inputs: Sequence[Field], precision: str) -> Field:
    """The results of one form, in the type of the precision's storage.

    Raises
    ------
    InputError
        An unknown form.
    """
    if form not in kernel.forms:
        raise InputError("form", f"is {shown(form)}; {suggest(form, kernel.forms)}")
    target = PRECISIONS[precision][1]
    half = target == np.float16

    def texture(values: Field) -> Field:
        return store(values, "float16") if half else values

    with np.errstate(all="ignore"):
        options = {"store": texture} if kernel.stores_between else {}
        result = np.broadcast_to(kernel.forms[form](*inputs, **options), inputs[0].shape)
        return result.astype(target)


def exact_values(kernel: Kernel, inputs: Sequence[Field]) -> list[Any]:
    """The exact results as mpf, of the inputs as they are."""
    mp = digits(DIGITS)
    return [kernel.exact(mp, *(mp.mpf(float(v)) for v in values)) for values in zip(*inputs, strict=True)]


def condition_numbers(kernel: Kernel, inputs: Sequence[Field], exact: Sequence[Any]) -> Doubles:
    """Relative condition numbers Σ|xᵢ·∂f/∂xᵢ|/|f|, by central differences in many digits; 0 where f is 0."""
    result = np.zeros(len(exact))
    if kernel.condition is not None:
        return kernel.condition(*(values.astype(np.float64) for values in inputs))
    if not kernel.smooth:
        return result
    mp = digits(DIGITS)
    steps = [not p.whole for p in kernel.parameters]
    for index, (values, value) in enumerate(zip(zip(*inputs, strict=True), exact, strict=True)):
        if value == 0:
            continue
        at = [mp.mpf(float(v)) for v in values]
        for i in (i for i, moves in enumerate(steps) if moves and at[i] != 0):
            ends = [kernel.exact(mp, *at[:i], at[i] * (1 + side * mp.mpf(STEP)), *at[i + 1:])
                    for side in (1, -1)]
            result[index] += float(abs((ends[0] - ends[1]) / (2 * mp.mpf(STEP) * value)))
    return result


def errors_in_ulp(results: Field, exact: Sequence[Any]) -> tuple[Doubles, Doubles]:
    """Distance from the exact values in spacings of the results' type there, and relative.

    Parameters
    ----------
    results : ndarray
        float64, float32 or float16.
    exact : sequence of mpf
        As many.

    Returns
    -------
    ulps, relative : ndarray
        NaN where the exact value is beyond the type (by half a spacing or more); infinity where only the
        result is not finite. The relative error is NaN as well below the normal numbers.

    Examples
    --------
    >>> mp = digits(40)
    >>> ulps, relative = errors_in_ulp(np.array([1.0 + 2.0**-52]), [mp.mpf(1)])
    >>> float(ulps[0]), float(relative[0])
    (1.0, 2.220446049250313e-16)
    """
    limits = np.finfo(results.dtype)
    most, tiny = float(limits.max) * (1.0 + float(limits.eps) / 4.0), float(limits.tiny)
    mp = digits(DIGITS)
    ulps, relative = np.full((2, len(exact)), math.nan)
    for index, (result, value) in enumerate(zip(results, exact, strict=True)):
        size = abs(value)
        if size >= most:
            continue
        if not np.isfinite(result):
            ulps[index] = relative[index] = math.inf
            continue
        error = abs(mp.mpf(float(result)) - value)
        place = mp.frexp(size)[1] - 1 if size >= tiny else limits.minexp
        ulps[index] = float(mp.ldexp(error, limits.nmant - int(place)))
        if size >= tiny:
            relative[index] = float(error / size)
    return ulps, relative


# --- measures ---------------------------------------------------------------------------------------


def _rises(kernel: Kernel, form: str, precision: str) -> int:
    """How often the output grows along a fine ramp of the parameter in which it must fall."""
    if kernel.falling is None:
        return 0
    dtype = PRECISIONS[precision][0]
    moving = kernel.parameters[kernel.falling]
    limits = np.finfo(dtype)
    low, high = max(moving.low, float(limits.tiny)), min(moving.high, float(limits.max) / 4.0)
    coarse = np.geomspace(low, high, 400)
    fine = np.arange(200) * float(np.finfo(dtype).eps) + moving.typical  # neighbours, where rounding shows
    rises = 0
    for others in itertools.product(*((p.typical, *p.extremes[:2]) for p in kernel.parameters)):
        for ramp in (coarse, fine):
            inputs = [np.full(len(ramp), v, dtype) for v in others]
            inputs[kernel.falling] = ramp.astype(dtype)
            results = run_form(kernel, form, inputs, precision).astype(np.float64)
            with np.errstate(invalid="ignore"):
                rises += int((np.diff(results) > 0.0).sum())
    return rises


def _above(kernel: Kernel, inputs: Sequence[Field], results: Field) -> NDArray[np.bool_]:
    """Which results exceed the bound: a number strictly, a function of the inputs by more than rounding."""
    if not callable(kernel.at_most):
        return np.asarray(results > kernel.at_most)
    limits = np.finfo(results.dtype)
    with np.errstate(all="ignore"):
        bound = kernel.at_most(*(values.astype(np.float64) for values in inputs))
        slack = 4.0 * float(limits.eps) * bound + float(limits.smallest_subnormal)
        return np.asarray(results.astype(np.float64) > bound + slack)


def measure(kernel: Kernel, form: str, precision: str, inputs: Sequence[Field], exact: Sequence[Any],
            condition: Doubles) -> Measure:
    """Measure one form of a kernel in one precision.

    Parameters
    ----------
    kernel : Kernel
    form, precision : str
        Keys of its forms and of `PRECISIONS`.
    inputs : sequence of ndarray
        From `sample`.
    exact, condition
        From `exact_values` and `condition_numbers`.

    Returns
    -------
    Measure
    """
    results = run_form(kernel, form, inputs, precision)
    ulps, relative = errors_in_ulp(results, exact)
    counted, within = np.isfinite(ulps), ~np.isnan(ulps)
    worst = int(np.argmax(np.where(counted, ulps, -1.0)))
    well = counted & (condition < WELL)
    return Measure(
        kernel.name, kernel.group, form, precision, len(results), int((~within).sum()),
        int(np.isnan(results).sum()), int((np.isinf(results) & within).sum()), int((results < 0.0).sum()),
        int((_above(kernel, inputs, results) & within & np.isfinite(results)).sum()),
        _rises(kernel, form, precision),
        float(ulps[worst]), float(ulps[counted].mean()) if counted.any() else math.nan,
        float(np.nanmax(np.where(counted, relative, np.nan), initial=0.0)), float(condition[worst]),
        float(ulps[well].max(initial=0.0)),
        float((ulps[counted] / (1.0 + condition[counted])).max(initial=0.0)),
        tuple(float(values[worst]) for values in inputs))


def sweep(chosen: Sequence[Kernel], *, samples: int = 400, progress: Progress | None = None) -> list[Measure]:
    """Measure kernels, in all their forms and precisions.

    Parameters
    ----------
    chosen : sequence of Kernel
        From `kernels`.
    samples : int
        Random inputs per kernel and precision; the extremes come on top.
    progress : callable, optional
        Called as ``progress(kernel, index, count)`` before each.

    Returns
    -------
    list of Measure
        In the order of the kernels, then precisions, then forms.

    Raises
    ------
    InputError
        Fewer than 2 samples; mpmath is not installed.
    """
    if samples < 2:
        raise InputError("samples", f"is {samples}, must be at least 2")
    result = []
    for index, kernel in enumerate(chosen):
        if progress is not None:
            progress(kernel.name, index, len(chosen))
        known: dict[Any, tuple[Any, Any, Any]] = {}
        for precision in kernel.precisions:
            dtype = PRECISIONS[precision][0]
            if dtype not in known:
                inputs = sample(kernel, samples, precision).inputs
                exact = exact_values(kernel, inputs)
                known[dtype] = inputs, exact, condition_numbers(kernel, inputs, exact)
            result += [measure(kernel, form, precision, *known[dtype]) for form in kernel.forms]
    return result
