"""Numerical stability: every kernel against arithmetic with many digits, over ordinary and extreme inputs.

A `Kernel` is one line of mathematics as the package computes it, beside the same line in many digits. It
is registered once, by `register`, and then measured in every type, drawn and listed. A kernel may have
several forms: ``corrected``, which must hold, and others (``published``, ``plain``) that show what a
departure or a plain formula costs; all are measured against the same exact value, on the same inputs:
random ones, hand-picked ones, and those of the map that is drawn.

Errors are counted in ulp: the distance from the exact value in spacings of the type there. The inputs are
taken as exact, so an ill-conditioned kernel is not excused by itself; its relative condition number
Σ|xᵢ·∂f/∂xᵢ|/|f| is found from the exact function and stands beside the error.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from froxel_ref.arrays import Field
from froxel_ref.high_precision import digits
from froxel_ref.kernel_registry import PRECISIONS, Kernel, Parameter, kernels, register
from froxel_ref.records import InputError, shown, suggest
from froxel_ref.stability_inputs import Cases, Map, map_of, sample
from froxel_ref.stability_measure import FAULTS, SOUND_ULP, WELL, Measure
from froxel_ref.storage import store

__all__ = [
    "FAULTS", "PRECISIONS", "SOUND_ULP", "WELL", "Cases", "Examined", "Kernel", "Measure", "Outcome",
    "Parameter", "Trial", "condition_numbers", "errors_in_ulp", "exact_values", "examine", "judge", "kernels",
    "measure", "register", "run_form", "sample", "sweep", "trial",
]

Doubles: TypeAlias = NDArray[np.float64]
Flags: TypeAlias = NDArray[np.bool_]
Progress: TypeAlias = Callable[[str, int, int], None]

DIGITS = 60  # 40 for the value; the rest for the difference quotient of the condition number
STEP = 1e-20  # relative step of that quotient


class Trial(NamedTuple):
    """Inputs of a kernel in one type, and what is exact of them; the last ones are those of the map.

    Attributes
    ----------
    inputs : tuple of ndarray
        One array per parameter.
    exact : list of mpf
        The exact results.
    condition : ndarray
        Condition numbers.
    chart : Map
        The map, whose inputs stand at the end.
    """

    inputs: tuple[Field, ...]
    exact: list[Any]
    condition: Doubles
    chart: Map


class Outcome(NamedTuple):
    """What one form made of a `Trial`, input by input.

    Attributes
    ----------
    results : ndarray
        In the type of storage.
    ulps, relative : ndarray
        As `errors_in_ulp`.
    faults : dict of str to ndarray of bool
        By the names in `FAULTS`, which results must not be. Rises are those of the map alone. Infinity within
        8·(1 + condition number) roundings of the largest number counts as beyond the type.
    """

    results: Field
    ulps: Doubles
    relative: Doubles
    faults: dict[str, Flags]


class Examined(NamedTuple):
    """All that was found of a kernel.

    Attributes
    ----------
    kernel : Kernel
    trials : dict of str to Trial
        By precision; float32 and float16 share theirs.
    outcomes : dict of (str, str) to Outcome
        By form and precision.
    measures : list of Measure
        Precision by precision, form by form.
    """

    kernel: Kernel
    trials: dict[str, Trial]
    outcomes: dict[tuple[str, str], Outcome]
    measures: list[Measure]


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


def _above(kernel: Kernel, inputs: Sequence[Field], results: Field) -> Flags:
    """Which results exceed the bound: a number strictly, a function of the inputs by more than rounding."""
    if not callable(kernel.at_most):
        return np.asarray(results > kernel.at_most)
    limits = np.finfo(results.dtype)
    with np.errstate(all="ignore"):
        bound = kernel.at_most(*(values.astype(np.float64) for values in inputs))
        slack = 4.0 * float(limits.eps) * bound + float(limits.smallest_subnormal)
        return np.asarray(results.astype(np.float64) > bound + slack)


def _rising(kernel: Kernel, chart: Map, results: Field) -> Flags:
    """Which cells of the map are above their neighbour, in the direction in which the output must fall."""
    risen = np.zeros(len(results), bool)
    if kernel.falling is not None and kernel.falling < 2:
        rows, columns = chart.shape
        plane = results[-rows * columns:].reshape(rows, columns).astype(np.float64)
        with np.errstate(invalid="ignore"):
            after = np.diff(plane, axis=1 - kernel.falling) > 0.0
        edge = ((0, 0), (1, 0)) if kernel.falling == 0 else ((1, 0), (0, 0))
        risen[-rows * columns:] = np.pad(after, edge).ravel()
    return risen


def trial(kernel: Kernel, samples: int, precision: str) -> Trial:
    """The inputs on which a kernel is tried in one precision, with their exact values.

    Parameters
    ----------
    kernel : Kernel
    samples : int
        Random inputs.
    precision : str
        A key of `PRECISIONS`.

    Returns
    -------
    Trial
    """
    chart = map_of(kernel, precision)
    drawn = sample(kernel, samples, precision).inputs
    inputs = tuple(np.concatenate(pair) for pair in zip(drawn, chart.inputs, strict=True))
    exact = exact_values(kernel, inputs)
    return Trial(inputs, exact, condition_numbers(kernel, inputs, exact), chart)


def judge(kernel: Kernel, form: str, precision: str, tried: Trial) -> Outcome:
    """Run one form on a trial's inputs: errors, and what must not be.

    Parameters
    ----------
    kernel : Kernel
    form, precision : str
        Keys of its forms and of `PRECISIONS`.
    tried : Trial

    Returns
    -------
    Outcome
    """
    results = run_form(kernel, form, tried.inputs, precision)
    ulps, relative = errors_in_ulp(results, tried.exact)
    infinite = np.isinf(results) & ~np.isnan(ulps)
    if infinite.any():  # what inputs so ill-conditioned may turn into infinity is none of the form's doing
        computed = float(np.finfo(PRECISIONS[precision][0]).eps)
        reach = 1.0 + SOUND_ULP * computed * (1.0 + tried.condition)
        sizes = np.array([abs(value) for value in tried.exact], dtype=object) * reach
        ulps[infinite & (sizes >= float(np.finfo(results.dtype).max))] = math.nan
    within = ~np.isnan(ulps)
    return Outcome(results, ulps, relative, {
        "not_a_number": np.isnan(results), "infinite": np.isinf(results) & within, "negative": results < 0.0,
        "above": _above(kernel, tried.inputs, results) & within & np.isfinite(results),
        "rising": _rising(kernel, tried.chart, results)})


def measure(kernel: Kernel, form: str, precision: str, tried: Trial, outcome: Outcome) -> Measure:
    """Sum up what one form of a kernel did in one precision.

    Parameters
    ----------
    kernel : Kernel
    form, precision : str
        Keys of its forms and of `PRECISIONS`.
    tried, outcome : Trial, Outcome
        From `trial` and `judge`.

    Returns
    -------
    Measure
    """
    ulps, condition = outcome.ulps, tried.condition
    counted = np.isfinite(ulps)
    worst = int(np.argmax(np.where(counted, ulps, -1.0)))
    counts = {name: int(flags.sum()) for name, flags in outcome.faults.items()}
    counts["rising"] += _rises(kernel, form, precision)
    return Measure(
        kernel.name, kernel.group, form, precision, len(ulps), int(np.isnan(ulps).sum()), **counts,
        worst=float(ulps[worst]), mean=float(ulps[counted].mean()) if counted.any() else math.nan,
        worst_relative=float(np.nanmax(np.where(counted, outcome.relative, np.nan), initial=0.0)),
        condition=float(condition[worst]),
        worst_well=float(ulps[counted & (condition < WELL)].max(initial=0.0)),
        worst_per_condition=float((ulps[counted] / (1.0 + condition[counted])).max(initial=0.0)),
        place=tuple(float(values[worst]) for values in tried.inputs))


def examine(kernel: Kernel, samples: int = 400) -> Examined:
    """Measure a kernel in all its forms and precisions, and keep what its picture shows.

    Parameters
    ----------
    kernel : Kernel
    samples : int
        Random inputs per precision; the extremes and the map's come on top.

    Returns
    -------
    Examined

    Examples
    --------
    >>> found = examine(kernels(["rayleigh"])[0], 20)
    >>> [(row.precision, row.verdict) for row in found.measures]
    [('float64', 'sound'), ('float32', 'sound'), ('float16', 'sound')]
    """
    known: dict[Any, Trial] = {}
    found = Examined(kernel, {}, {}, [])
    for precision in kernel.precisions:
        dtype = PRECISIONS[precision][0]
        if dtype not in known:
            known[dtype] = trial(kernel, samples, precision)
        found.trials[precision] = known[dtype]
        for form in kernel.forms:
            outcome = judge(kernel, form, precision, known[dtype])
            found.outcomes[form, precision] = outcome
            found.measures.append(measure(kernel, form, precision, known[dtype], outcome))
    return found


def sweep(chosen: Sequence[Kernel], *, samples: int = 400, progress: Progress | None = None) -> list[Measure]:
    """Measure kernels, in all their forms and precisions.

    Parameters
    ----------
    chosen : sequence of Kernel
        From `kernels`.
    samples : int
        Random inputs per kernel and precision; the extremes and the map's come on top.
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
        result += examine(kernel, samples).measures
    return result
