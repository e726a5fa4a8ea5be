"""Fronts of error against run time, where errors are exact and times are noisy.

A point is a way of doing something: its error, and an interval that its time lies in. One dominates another
if it is at least as fast and at least as exact, and one of both strictly. As times are known within
intervals only, a point is on the front for certain, possibly, or not at all:

| word | for times anywhere within the intervals, |
| --- | --- |
| ``certain`` | nothing dominates it, whatever they are |
| ``possible`` | some leave it undominated, and others do not |
| ``dominated`` | something dominates it, whatever they are |
| ``failed`` | it has no finite error or no time: it is never on the front, dominates nothing, is still listed |
"""

from __future__ import annotations

import math
import statistics
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from froxel_ref.records import InputError

__all__ = [
    "LEAST_GAIN", "MEMBERSHIPS", "EqualError", "EqualTime", "Front", "Recommendation", "Spread", "Step", "bars",
    "equal_error", "equal_time", "front", "recommend", "spread",
]

Doubles = NDArray[np.float64]
Flags = NDArray[np.bool_]

CERTAIN, POSSIBLE, DOMINATED, FAILED = MEMBERSHIPS = ("certain", "possible", "dominated", "failed")


LEAST_GAIN = 0.05
"""By what share an error must be less for a step up to be worth its name."""


class Spread(NamedTuple):
    """What several runs took.

    Attributes
    ----------
    least : float
        [s]. Lower end of the error bar.
    median : float
        [s]. Upper end of the error bar.
    seconds : tuple of float
        [s]. All that were measured, in order.
    """

    least: float
    median: float
    seconds: tuple[float, ...]


class Front(NamedTuple):
    """Which points are on the front of error against time.

    Attributes
    ----------
    membership : tuple of str
        One of `MEMBERSHIPS` for each point, in the points' order.
    line : tuple of int
        Indices of those that are certain or possible, from the least to the most exact.
    dominator : tuple of int or None
        For a dominated point the index of one that dominates it whatever the times, itself certain or
        possible: the most exact, of these the fastest. None for all other points.
    """

    membership: tuple[str, ...]
    line: tuple[int, ...]
    dominator: tuple[int | None, ...]


class EqualTime(NamedTuple):
    """The most exact point within a budget of time.

    Attributes
    ----------
    budget : float
        [s].
    surely, possibly : int or None
        Index of the most exact point whose time lies within the budget up to the upper end of its interval;
        or with its lower end at least. None where there is none.
    sure_error, possible_error : float or None
        Their errors.
    """

    budget: float
    surely: int | None
    possibly: int | None
    sure_error: float | None
    possible_error: float | None


class EqualError(NamedTuple):
    """The fastest point within an error.

    Attributes
    ----------
    level : float
        The error allowed.
    fastest : int or None
        Index of the point with the least lower end of its time; None where no point is as exact.
    rivals : tuple of int
        Others as exact that may be as fast: their intervals reach down to where one is surely done.
    speed_up : float or None
        How many times faster it is than the base point, by the lower ends; None without either.
    speed_up_low, speed_up_high : float or None
        The least and the largest that the intervals allow.
    """

    level: float
    fastest: int | None
    rivals: tuple[int, ...]
    speed_up: float | None
    speed_up_low: float | None
    speed_up_high: float | None


class Step(NamedTuple):
    """From a point to another on the front.

    Attributes
    ----------
    point : int
        Index of the other one.
    seconds : float
        [s]. How much longer it takes, by the lower ends; negative where it is faster.
    error : float
        How much larger its error is; negative where it is more exact.
    sure : bool
        Whether the intervals are apart, so that one of both is faster whatever the times.
    """

    point: int
    seconds: float
    error: float
    sure: bool


class Recommendation(NamedTuple):
    """The point to take under a limit.

    Attributes
    ----------
    point : int or None
        Index of it, or where none meets the limit of the closest one; None if all have failed.
    met : bool
        Whether it meets the limit.
    shortfall : float or None
        By how much the closest one misses it, in seconds or in error; 0 if it is met, None without a point.
    up : Step or None
        To the fastest point that is more exact by `LEAST_GAIN` at least.
    down : Step or None
        To the most exact of the points that are faster.
    """

    point: int | None
    met: bool
    shortfall: float | None
    up: Step | None
    down: Step | None


# --- times ------------------------------------------------------------------------------------------


def spread(seconds: Sequence[float]) -> Spread:
    """The least and the median of measured times.

    Parameters
    ----------
    seconds : sequence of float
        [s]. Of runs of the same work, warm; at least one.

    Returns
    -------
    Spread

    Raises
    ------
    InputError
        No run; a time that is not positive and finite.

    Notes
    -----
    On a shared machine a run takes its own cost and whatever else happens meanwhile, which is never less
    than nothing. So the least of several runs is the best estimate of the cost, from above, and the mean
    has no meaning of its own. The median says what such noise adds to a run as they come. The bar from one
    to the other is the range in which half of the runs lay; it shrinks to the cost on an idle machine, and
    says nothing about what was slow in every run.

    Few runs make bars that mislead: for n = 2m + 1 runs each of the very same work, and any distribution of
    the noise, two bars lie apart in 2·C(3m + 1, m)/C(4m + 2, 2m + 1) of all cases: 7 % for 7 runs, 1.2 % for
    11, 0.2 % for 15. (All of one set come after the middle of the other: of the 4m + 2 runs in order the
    first m + 1 are of one set, and among the other 3m + 1 stand its m last.)

    Examples
    --------
    >>> spread([1.2, 1.0, 3.0])[:2]
    (1.0, 1.2)
    """
    times = tuple(float(time) for time in seconds)
    if not times:
        raise InputError("seconds", "is empty, must hold at least one run")
    for i, time in enumerate(times):
        if not 0.0 < time < math.inf:
            raise InputError(f"seconds[{i}]", f"is {time!r}, must be above 0 s and finite")
    return Spread(min(times), statistics.median(times), times)


def bars(spreads: Sequence[Spread | None]) -> tuple[Doubles, Doubles]:
    """The ends of many error bars, as `front` takes them.

    Parameters
    ----------
    spreads : sequence of Spread or None
        None for a point without a time.

    Returns
    -------
    low, high : ndarray, shape (n,) [s]
        Least and median; NaN for None.

    Examples
    --------
    >>> low, high = bars([spread([1.0, 2.0, 4.0]), None])
    >>> low.tolist(), high.tolist()
    ([1.0, nan], [2.0, nan])
    """
    low = np.array([math.nan if one is None else one.least for one in spreads])
    high = np.array([math.nan if one is None else one.median for one in spreads])
    return low, high


# --- the front --------------------------------------------------------------------------------------


def front(errors: ArrayLike, low: ArrayLike, high: ArrayLike) -> Front:
    """Which points nothing else beats in both error and time.

    Parameters
    ----------
    errors : array_like, shape (n,)
        At least 0; not finite for a point that has failed.
    low, high : array_like, shape (n,) [s]
        Ends of the interval that the point's time lies in, above 0; not finite where it is missing.

    Returns
    -------
    Front

    Raises
    ------
    InputError
        No points, shapes that differ; a negative error; a time not above 0; an interval whose ends are
        in the wrong order.

    Notes
    -----
    With errors e and times t_i in [l_i, h_i], each wherever it may be whatever the others are, j dominates
    i if t_j ≤ t_i, e_j ≤ e_i and one of both is strict.

    *Certain.* For a given j ≠ i there are times with which j dominates i if and only if there are with the
    best ones for j: t_j = l_j and t_i = h_i. So i is certain if and only if no j has e_j < e_i and
    l_j ≤ h_i, or e_j = e_i and l_j < h_i.

    *Dominated.* Whoever dominates i with t_i = l_i and t_j = h_j, the best times for i, does so with all
    others, as t_j ≤ h_j ≤ l_i ≤ t_i. One choice is the best for i against all j at once; so if at these
    times nothing dominates i, it is on the front there, and if something does, that does always. Hence i
    is dominated if and only if some j has e_j < e_i and h_j ≤ l_i, or e_j = e_i and h_j < l_i; then one
    and the same point dominates it for all times. All else is possible.

    *Its dominator.* The most exact such j, and of these the one with the least h. It is on the front: who
    surely dominates it surely dominates i as well, and would have been taken, as it is more exact or has
    h_k < l_j ≤ h_j.

    *Ties.* Points equal in error and in a time that is known exactly do not dominate each other. Points of
    the same error whose intervals overlap by more than an end are all possible at best: one is faster, and
    nobody knows which. An interval of length 0 is an exact time; with these alone nothing is possible.

    n² comparisons.

    Examples
    --------
    >>> found = front([1.0, 0.5, 0.5, 0.2, float("nan")], [1.0, 2.0, 2.1, 4.0, 0.1], [1.2, 2.2, 2.5, 5.0, 0.1])
    >>> found.membership, found.line
    (('certain', 'possible', 'possible', 'certain', 'failed'), (0, 1, 2, 3))
    """
    e, lowest, highest, fine = _points(errors, low, high)
    never, always = _dominance(e, lowest, highest, fine)
    words = np.where(~fine, FAILED, np.where(always.any(axis=1), DOMINATED, np.where(never, CERTAIN, POSSIBLE)))
    membership = tuple(str(word) for word in words)
    line = np.flatnonzero((words == CERTAIN) | (words == POSSIBLE))
    line = line[np.lexsort((line, highest[line], lowest[line], -e[line]))]
    dominator = tuple(_first(always[i], e, highest, lowest) for i in range(e.size))
    return Front(membership, tuple(int(i) for i in line), dominator)


def equal_time(errors: ArrayLike, low: ArrayLike, high: ArrayLike, budgets: Sequence[float]) -> tuple[EqualTime, ...]:
    """The most exact points for budgets of time.

    Parameters
    ----------
    errors, low, high : array_like, shape (n,)
        As for `front`.
    budgets : sequence of float
        [s]. Positive and finite.

    Returns
    -------
    tuple of EqualTime
        One for each budget. Of equally exact points the fastest is named, by the upper end where it fits
        surely and by the lower end where it fits possibly.

    Raises
    ------
    InputError
        As for `front`; a budget out of bounds.

    Examples
    --------
    >>> equal_time([1.0, 0.1], [1.0, 2.0], [1.5, 4.0], [3.0])
    (EqualTime(budget=3.0, surely=0, possibly=1, sure_error=1.0, possible_error=0.1),)
    """
    e, lowest, highest, fine = _points(errors, low, high)
    rows = []
    for budget in _limits("budgets", budgets):
        surely = _first(fine & (highest <= budget), e, highest, lowest)
        possibly = _first(fine & (lowest <= budget), e, lowest, highest)
        rows.append(EqualTime(budget, surely, possibly, *(None if i is None else float(e[i])
                                                          for i in (surely, possibly))))
    return tuple(rows)


def equal_error(errors: ArrayLike, low: ArrayLike, high: ArrayLike, levels: Sequence[float], *,
                base: int = 0) -> tuple[EqualError, ...]:
    """The fastest points for errors allowed, and how much faster than a base point they are.

    Parameters
    ----------
    errors, low, high : array_like, shape (n,)
        As for `front`.
    levels : sequence of float
        Errors allowed; positive and finite.
    base : int
        Index of the base point, such as the published form. If it has failed there is no speed-up.

    Returns
    -------
    tuple of EqualError
        One for each level. Of points with equal lower ends the one with the lower upper end is named, of
        these the most exact.

    Raises
    ------
    InputError
        As for `front`; a level out of bounds; a base that is no point.

    Notes
    -----
    The speed-up is l_base/l_i, between l_base/h_i and h_base/l_i for times within the intervals; for the
    base itself it is 1.

    Examples
    --------
    >>> equal_error([0.1, 0.1, 1.0], [4.0, 2.0, 1.0], [5.0, 2.5, 1.0], [0.5])
    (EqualError(level=0.5, fastest=1, rivals=(), speed_up=2.0, speed_up_low=1.6, speed_up_high=2.5),)
    """
    e, lowest, highest, fine = _points(errors, low, high)
    if isinstance(base, bool) or not isinstance(base, int | np.integer) or not 0 <= base < e.size:
        raise InputError("base", f"is {base!r}, must be the index of one of {e.size} points")
    rows = []
    for level in _limits("levels", levels):
        exact = fine & (e <= level)
        i = _first(exact, lowest, highest, e)
        if i is None:
            rows.append(EqualError(level, None, (), None, None, None))
            continue
        rivals = tuple(int(j) for j in np.flatnonzero(exact & (lowest <= highest[exact].min())) if j != i)
        ratios: tuple[float | None, ...] = (None, None, None)
        if i == base:
            ratios = (1.0, 1.0, 1.0)
        elif fine[base]:
            ratios = (float(lowest[base] / lowest[i]), float(lowest[base] / highest[i]),
                      float(highest[base] / lowest[i]))
        rows.append(EqualError(level, i, rivals, *ratios))
    return tuple(rows)


def recommend(errors: ArrayLike, low: ArrayLike, high: ArrayLike, *, budget: float | None = None,
              most_error: float | None = None) -> Recommendation:
    """The point to take under a limit on time or on error, and what a step to either side would change.

    Parameters
    ----------
    errors, low, high : array_like, shape (n,)
        As for `front`.
    budget : float, optional
        [s]. The most exact point whose upper end lies within; of equally exact ones the fastest.
    most_error : float, optional
        The point with the least lower end whose error is at most this; then the least upper end, then the
        most exact.

    Returns
    -------
    Recommendation
        If nothing fits: the point with the least upper end for a budget, the most exact one for an error.
        The point is on the front, certainly or possibly.

    Raises
    ------
    InputError
        As for `front`; both limits or neither; a limit that is not positive and finite.

    Notes
    -----
    It is never dominated: whoever surely dominates i has e ≤ e_i and h ≤ l_i ≤ h_i, so it meets the limit
    (or is as close) too, and comes before i in the order by which points are chosen.

    The step up leads to the fastest (by its lower end) of the points whose error is less by `LEAST_GAIN` at least, so
    that no other more exact point is as fast; the step down to the most exact of the points that are faster. A
    more exact point that is merely possible may be faster, too.

    Examples
    --------
    >>> found = recommend([1.0, 0.3, 0.1], [1.0, 2.0, 5.0], [1.1, 2.5, 6.0], budget=3.0)
    >>> found.point, found.met, found.up.point, found.up.seconds, found.down.point, found.down.seconds
    (1, True, 2, 3.0, 0, -1.0)
    >>> recommend([1.0, 0.3], [1.0, 2.0], [1.1, 2.5], most_error=0.2)[:3]
    (1, False, 0.09999999999999998)
    """
    e, lowest, highest, fine = _points(errors, low, high)
    if (budget is None) == (most_error is None):
        raise InputError("most_error", "must be given if budget is not, and must not if it is")
    if budget is not None:
        limit, = _limits("budget", [budget], alone=True)
        i = _first(fine & (highest <= limit), e, highest, lowest)
        nearest = _first(fine, highest, e, lowest) if i is None else i
        missing = None if nearest is None else float(highest[nearest] - limit)
    else:
        limit, = _limits("most_error", [most_error], alone=True)
        i = _first(fine & (e <= limit), lowest, highest, e)
        nearest = _first(fine, e, lowest, highest) if i is None else i
        missing = None if nearest is None else float(e[nearest] - limit)
    if nearest is None:
        return Recommendation(None, False, None, None, None)
    ups = fine & (e <= (1.0 - LEAST_GAIN) * e[nearest]) & (e < e[nearest])
    downs = fine & (lowest < lowest[nearest]) & (e > e[nearest])
    up, down = _first(ups, lowest, e, highest), _first(downs, e, lowest, highest)
    return Recommendation(nearest, i is not None, 0.0 if i is not None else missing,
                          *(None if j is None else _step(nearest, j, e, lowest, highest) for j in (up, down)))


# --- parts ------------------------------------------------------------------------------------------


def _points(errors: ArrayLike, low: ArrayLike, high: ArrayLike) -> tuple[Doubles, Doubles, Doubles, Flags]:
    """The arrays, and which points have not failed."""
    e, lowest, highest = (np.asarray(values, np.float64) for values in (errors, low, high))
    if e.ndim != 1 or e.size == 0:
        raise InputError("errors", f"has shape {e.shape}, must be that of one or more points, (n,)")
    for name, values in (("low", lowest), ("high", highest)):
        if values.shape != e.shape:
            raise InputError(name, f"has shape {values.shape}, must be that of errors, {e.shape}")
        bad = np.flatnonzero(np.isfinite(values) & (values <= 0.0))
        if bad.size:
            raise InputError(f"{name}[{bad[0]}]", f"is {float(values[bad[0]])!r}, must be above 0 s")
    bad = np.flatnonzero(np.isfinite(e) & (e < 0.0))
    if bad.size:
        raise InputError(f"errors[{bad[0]}]", f"is {float(e[bad[0]])!r}, must be at least 0")
    timed = np.isfinite(lowest) & np.isfinite(highest)
    bad = np.flatnonzero(timed & (lowest > highest))
    if bad.size:
        raise InputError(f"low[{bad[0]}]", f"is {float(lowest[bad[0]])!r}, must be at most high, "
                                           f"{float(highest[bad[0]])!r}")
    return e, lowest, highest, timed & np.isfinite(e)


def _limits(place: str, values: Sequence[float | None], *, alone: bool = False) -> list[float]:
    limits = []
    for i, value in enumerate(values):
        if value is None or not 0.0 < value < math.inf:
            raise InputError(place if alone else f"{place}[{i}]", f"is {value!r}, must be above 0 and finite")
        limits.append(float(value))
    return limits


def _dominance(e: Doubles, low: Doubles, high: Doubles, fine: Flags) -> tuple[Flags, NDArray[np.bool_]]:
    """Whether nothing can dominate a point; and which points (columns) surely dominate it (rows)."""
    both = fine[:, None] & fine
    better, equal = both & (e < e[:, None]), both & (e == e[:, None])
    np.fill_diagonal(equal, False)
    may = (better & (low <= high[:, None])) | (equal & (low < high[:, None]))
    must = (better & (high <= low[:, None])) | (equal & (high < low[:, None]))
    return ~may.any(axis=1), must


def _first(among: Flags, *keys: Doubles) -> int | None:
    """The first point by several keys, the most important first; of equal ones by index."""
    found = np.flatnonzero(among)
    if not found.size:
        return None
    return int(found[np.lexsort([key[found] for key in reversed(keys)])[0]])


def _step(here: int, there: int, e: Doubles, low: Doubles, high: Doubles) -> Step:
    return Step(there, float(low[there] - low[here]), float(e[there] - e[here]),
                bool(high[here] < low[there] or high[there] < low[here]))
