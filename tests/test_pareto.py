"""Fronts of error against noisy times: held to the definition, with every choice of times tried out."""

from __future__ import annotations

import itertools
import math
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from froxel_ref.pareto import (
    LEAST_GAIN,
    MEMBERSHIPS,
    EqualError,
    EqualTime,
    Front,
    Recommendation,
    Spread,
    Step,
    bars,
    equal_error,
    equal_time,
    front,
    recommend,
    spread,
)
from froxel_ref.records import InputError

NAN, INF = math.nan, math.inf
ON = ("certain", "possible")

# Few values, so that ties of errors, of times and of ends of intervals are common; None for what failed.
ERROR = st.sampled_from([0.0, 1.0, 2.0, 3.0, NAN, INF])
ENDS = st.tuples(st.integers(1, 6), st.integers(1, 6)).map(lambda pair: (float(min(pair)), float(max(pair))))
POINT = st.tuples(ERROR, st.one_of(ENDS, ENDS, ENDS, st.sampled_from([(NAN, NAN), (1.0, NAN), (INF, INF)])))
POINTS = st.lists(POINT, min_size=1, max_size=5)


def columns(points):
    return [p[0] for p in points], [p[1][0] for p in points], [p[1][1] for p in points]


def whole(point) -> bool:
    return all(math.isfinite(value) for value in (point[0], *point[1]))


# --- the definition, written out --------------------------------------------------------------------


def undominated(errors, times, i) -> bool:
    """Nothing is at least as fast and as exact as point i, and one of both strictly, at exact times."""
    return not any(times[j] <= times[i] and errors[j] <= errors[i] and (times[j] < times[i] or errors[j] < errors[i])
                   for j in range(len(errors)) if j != i)


def memberships(points) -> list[str]:
    """By trying out all choices of ends and middles of the intervals."""
    kept = [i for i, point in enumerate(points) if whole(point)]
    errors = [points[i][0] for i in kept]
    choices = [sorted({low, (low + high) / 2, high}) for low, high in (points[i][1] for i in kept)]
    seen: list[set[bool]] = [set() for _ in kept]
    for times in itertools.product(*choices):
        for i in range(len(kept)):
            seen[i].add(undominated(errors, times, i))
    words = ["failed"] * len(points)
    for i, found in zip(kept, seen, strict=True):
        words[i] = "certain" if found == {True} else "dominated" if found == {False} else "possible"
    return words


@settings(max_examples=400)
@given(POINTS)
@example([(1.0, (1.0, 1.0)), (1.0, (1.0, 1.0))])
@example([(1.0, (1.0, 2.0)), (1.0, (2.0, 3.0))])
@example([(0.0, (2.0, 3.0)), (1.0, (1.0, 2.0))])
@example([(0.0, (1.0, 2.0)), (1.0, (2.0, 3.0))])
def test_membership_is_what_all_choices_of_times_say(points) -> None:
    assert list(front(*columns(points)).membership) == memberships(points)


@settings(max_examples=400)
@given(POINTS)
def test_the_line_and_who_dominates(points) -> None:
    """The line has all that may be on the front, by error; a dominator is on it and beats at all times."""
    found = front(*columns(points))
    assert set(found.line) == {i for i, word in enumerate(found.membership) if word in ON}
    assert all(points[i][0] >= points[j][0] for i, j in itertools.pairwise(found.line))
    for i, (word, j) in enumerate(zip(found.membership, found.dominator, strict=True)):
        assert (j is not None) == (word == "dominated")
        if j is not None:
            assert j in found.line
            (e, (_, high)), (error, (low, _)) = points[j], points[i]
            assert e <= error
            assert high <= low
            assert e < error or high < low
            beaters = [p for p in points if whole(p) and p[0] <= error and p[1][1] <= low
                       and (p[0] < error or p[1][1] < low)]
            assert (e, high) == min((p[0], p[1][1]) for p in beaters)


@given(POINTS)
def test_something_is_on_the_front_unless_all_has_failed(points) -> None:
    found = front(*columns(points))
    assert bool(found.line) == any(map(whole, points))
    assert set(found.membership) <= set(MEMBERSHIPS)
    assert [word == "failed" for word in found.membership] == [not whole(point) for point in points]


@given(POINTS, st.randoms(use_true_random=False))
def test_the_order_of_points_does_not_matter(points, random) -> None:
    order = list(range(len(points)))
    random.shuffle(order)
    shuffled = [points[i] for i in order]
    first, second = front(*columns(points)), front(*columns(shuffled))
    assert second.membership == tuple(first.membership[i] for i in order)
    assert [shuffled[i] for i in second.line] == [points[i] for i in first.line]
    for i, j in zip(order, second.dominator, strict=True):
        assert (None if j is None else shuffled[j]) == (
            None if first.dominator[i] is None else points[first.dominator[i]])
    for how in ({"budget": 3.0}, {"most_error": 1.0}):
        one, other = recommend(*columns(points), **how), recommend(*columns(shuffled), **how)
        assert (None if one.point is None else points[one.point]) == (
            None if other.point is None else shuffled[other.point])
        assert one[1:3] == other[1:3]
        for a, b in ((one.up, other.up), (one.down, other.down)):
            assert (a is None) == (b is None)
            assert a is None or (points[a.point], *a[1:]) == (shuffled[b.point], *b[1:])


@given(POINTS, st.sampled_from([2.0**-30, 0.5, 8.0, 2.0**40]), st.sampled_from([2.0**-40, 4.0]))
def test_units_do_not_matter(points, of_time, of_error) -> None:
    """Powers of two, so that no time or error is rounded."""
    e, low, high = (np.array(column) for column in columns(points))
    scaled = (e * of_error, low * of_time, high * of_time)
    assert front(*scaled) == front(e, low, high)
    for budget in (1.0, 3.0):
        one, other = equal_time(e, low, high, [budget])[0], equal_time(*scaled, [budget * of_time])[0]
        assert (one.surely, one.possibly) == (other.surely, other.possibly)
        a, b = recommend(e, low, high, budget=budget), recommend(*scaled, budget=budget * of_time)
        assert a[:2] == b[:2]
        assert a.shortfall is None or a.shortfall * of_time == b.shortfall
    assert equal_error(*scaled, [of_error])[0][1:] == equal_error(e, low, high, [1.0])[0][1:]


@given(POINTS, POINT.filter(lambda point: not whole(point)))
def test_a_failed_point_changes_nothing_else(points, failed) -> None:
    found, more = front(*columns(points)), front(*columns([*points, failed]))
    assert more == Front((*found.membership, "failed"), found.line, (*found.dominator, None))
    both = columns(points), columns([*points, failed])
    for how in ({"budget": 2.0}, {"most_error": 2.0}):
        assert recommend(*both[0], **how) == recommend(*both[1], **how)
    assert equal_time(*both[0], [1.0, 4.0]) == equal_time(*both[1], [1.0, 4.0])
    assert equal_error(*both[0], [0.5, 2.0]) == equal_error(*both[1], [0.5, 2.0])


# --- by hand ----------------------------------------------------------------------------------------


def test_a_front_by_hand() -> None:
    """Exact times: the common front. Then bars: one point slides below another, one is surely beaten."""
    errors, times = [8.0, 4.0, 5.0, 2.0, 2.0, 1.0], [1.0, 2.0, 3.0, 4.0, 5.0, 9.0]
    assert front(errors, times, times) == Front(
        ("certain", "certain", "dominated", "certain", "dominated", "certain"), (0, 1, 3, 5),
        (None, None, 1, None, 3, None))
    high = [1.5, 3.5, 3.1, 5.5, 5.5, 9.0]
    assert front(errors, times, high) == Front(
        ("certain", "certain", "possible", "possible", "possible", "certain"), (0, 2, 1, 3, 4, 5), (None,) * 6)


def test_ties() -> None:
    """Twins with exact times do not beat each other; with bars one of them is faster, unknown which."""
    assert front([1, 1], [2, 2], [2, 2]).membership == ("certain", "certain")
    assert front([1, 1], [2, 2], [3, 3]).membership == ("possible", "possible")
    assert front([1, 1], [2, 3], [3, 4]).membership == ("certain", "possible")  # the ends touch
    assert front([1, 1], [2, 3], [2.9, 4]).membership == ("certain", "dominated")
    assert front([1, 2], [3, 3], [3, 3]).membership == ("certain", "dominated")
    assert front([1, 2], [3, 2], [4, 3]).membership == ("certain", "possible")


def test_of_equals_which_one() -> None:
    """Where the first thing asked for is equal, what is known best decides, wherever in the list it stands."""
    for order in ([0, 1, 2], [2, 0, 1], [1, 2, 0]):
        def put(*points, order=order):
            return columns([points[i] for i in order])

        # Equally exact: the one whose upper end is lower, though its lower end is not.
        found = recommend(*put((1.0, (2.0, 5.0)), (1.0, (3.0, 4.0)), (2.0, (1.0, 1.5))), budget=6.0)
        assert order[found.point] == 1
        assert order[found.down.point] == 2
        # Exact enough: the least lower end, though another's upper end is lower; then the upper end; then the error.
        points = put((1.0, (2.0, 5.0)), (1.0, (3.0, 4.0)), (9.0, (1.0, 1.0)))
        assert order[recommend(*points, most_error=2.0).point] == 0
        row, = equal_error(*points, [2.0])
        assert order[row.fastest] == 0
        assert [order[i] for i in row.rivals] == [1]
        points = put((1.0, (2.0, 5.0)), (1.5, (2.0, 4.0)), (1.0, (2.0, 4.0)))
        assert order[recommend(*points, most_error=2.0).point] == 2
        assert order[equal_error(*points, [2.0])[0].fastest] == 2
        # No rival: it starts below the upper end of the fastest, but above that of another.
        row, = equal_error(*put((1.0, (2.0, 9.0)), (1.0, (3.0, 4.0)), (1.0, (5.0, 6.0))), [1.0])
        assert [order[i] for i in row.rivals] == [1]
        # A step down among equals: the least lower end.
        found = recommend(*put((1.0, (6.0, 6.0)), (2.0, (3.0, 4.0)), (2.0, (2.0, 5.0))), budget=6.0)
        assert (order[found.point], order[found.down.point]) == (0, 2)
        found = recommend(*put((9.0, (1.0, 1.0)), (2.0, (3.0, 4.0)), (2.0, (2.0, 5.0))), budget=1.0)
        assert (order[found.point], order[found.up.point]) == (0, 2)
        # Beaten by two that are equally exact: the one surely done first is named.
        beaten = front(*put((1.0, (2.0, 4.0)), (1.0, (1.0, 5.0)), (2.0, (6.0, 7.0))))
        assert [order[j] for j in beaten.dominator if j is not None] == [0]


def test_all_failed() -> None:
    e, low, high = [NAN, 1.0, 0.0], [1.0, NAN, 1.0], [1.0, 2.0, INF]
    assert front(e, low, high) == Front(("failed",) * 3, (), (None,) * 3)
    assert recommend(e, low, high, budget=1.0) == Recommendation(None, False, None, None, None)
    assert equal_time(e, low, high, [9.0]) == (EqualTime(9.0, None, None, None, None),)
    assert equal_error(e, low, high, [9.0]) == (EqualError(9.0, None, (), None, None, None),)


# --- tables -----------------------------------------------------------------------------------------

LADDER = ([8.0, 4.0, 5.0, 2.0, 1.0, NAN], [1.0, 2.0, 2.5, 4.0, 8.0, 0.5], [1.5, 3.0, 3.5, 5.0, 9.0, 0.5])


def test_equal_time_by_hand() -> None:
    assert equal_time(*LADDER, [0.9, 1.2, 3.0, 4.5, 100.0]) == (
        EqualTime(0.9, None, None, None, None),
        EqualTime(1.2, None, 0, None, 8.0),
        EqualTime(3.0, 1, 1, 4.0, 4.0),
        EqualTime(4.5, 1, 3, 4.0, 2.0),
        EqualTime(100.0, 4, 4, 1.0, 1.0))
    assert equal_time(*LADDER, []) == ()


def test_equal_error_by_hand() -> None:
    """Against the most exact one, of 8 to 9 s; point 2 may be as fast as point 1."""
    assert equal_error(*LADDER, [0.5, 1.0, 5.0, 10.0], base=4) == (
        EqualError(0.5, None, (), None, None, None),
        EqualError(1.0, 4, (), 1.0, 1.0, 1.0),
        EqualError(5.0, 1, (2,), 4.0, 8.0 / 3.0, 4.5),
        EqualError(10.0, 0, (), 8.0, 8.0 / 1.5, 9.0))
    assert equal_error(*LADDER, [5.0], base=5) == (EqualError(5.0, 1, (2,), None, None, None),)


@settings(max_examples=400)
@given(POINTS, st.sampled_from([0.5, 1.0, 2.0, 3.5, 6.0]), st.data())
def test_tables_are_what_a_search_finds(points, limit, data) -> None:
    base = data.draw(st.integers(0, len(points) - 1))
    kept = [(e, low, high, i) for i, (e, (low, high)) in enumerate(points) if whole(points[i])]
    at_time, at_error = equal_time(*columns(points), [limit])[0], equal_error(*columns(points), [limit], base=base)[0]
    surely = [p for p in kept if p[2] <= limit]
    possibly = [p for p in kept if p[1] <= limit]
    assert at_time.sure_error == min((p[0] for p in surely), default=None)
    assert at_time.possible_error == min((p[0] for p in possibly), default=None)
    assert (at_time.surely is None) == (not surely)
    assert at_time.surely is None or (points[at_time.surely][0] == at_time.sure_error
                                      and points[at_time.surely][1][1] <= limit)
    assert at_time.possibly is None or (points[at_time.possibly][0] == at_time.possible_error
                                        and points[at_time.possibly][1][0] <= limit)
    exact = [p for p in kept if p[0] <= limit]
    if not exact:
        assert at_error == EqualError(limit, None, (), None, None, None)
        return
    best = min(exact, key=lambda p: (p[1], p[2], p[0], p[3]))
    assert at_error.fastest == best[3]
    # A rival is fastest, alone or with others, for some choice of times.
    may = {p[3] for p in exact if all(p[1] <= q[2] for q in exact)}
    assert {at_error.fastest, *at_error.rivals} == may | {best[3]}
    if not whole(points[base]):
        assert at_error.speed_up is None
    elif base != best[3]:
        low, high = points[base][1]
        assert (at_error.speed_up_low, at_error.speed_up, at_error.speed_up_high) == (
            low / best[2], low / best[1], high / best[1])


# --- recommendations --------------------------------------------------------------------------------


def test_recommendations_by_hand() -> None:
    """Steps lead to points that are better in one of the two: never to point 2, which is off the line."""
    assert recommend(*LADDER, budget=3.0) == Recommendation(
        1, True, 0.0, Step(3, 2.0, -2.0, True), Step(0, -1.0, 4.0, True))
    assert recommend(*LADDER, budget=1.5) == Recommendation(0, True, 0.0, Step(1, 1.0, -4.0, True), None)
    assert recommend(*LADDER, budget=9.0) == Recommendation(4, True, 0.0, None, Step(3, -4.0, 1.0, True))
    assert recommend(*LADDER, most_error=4.5) == recommend(*LADDER, budget=3.0)
    assert recommend(*LADDER, budget=1.25) == Recommendation(0, False, 0.25, Step(1, 1.0, -4.0, True), None)
    assert recommend(*LADDER, most_error=0.75) == Recommendation(4, False, 0.25, None, Step(3, -4.0, 1.0, True))


@settings(max_examples=400)
@given(POINTS, st.sampled_from([0.5, 1.0, 2.0, 3.5, 6.0]), st.booleans())
def test_recommendations_are_on_the_front_and_the_best_there(points, limit, by_time) -> None:
    found = recommend(*columns(points), **{"budget" if by_time else "most_error": limit})
    kept = [(e, low, high) for e, (low, high) in (p for p in points if whole(p))]
    on = [points[i] for i in front(*columns(points)).line]
    if not kept:
        assert found == Recommendation(None, False, None, None, None)
        return
    point = points[found.point]
    e, (low, high) = point
    assert point in on
    fits = [p for p in kept if (p[2] if by_time else p[0]) <= limit]
    assert found.met == bool(fits)
    if fits:
        assert found.shortfall == 0.0
        assert (high if by_time else e) <= limit
        assert (e if by_time else low) == min(p[0 if by_time else 1] for p in fits)
    else:
        assert found.shortfall == min(p[2] if by_time else p[0] for p in kept) - limit > 0.0
        assert found.shortfall == (high if by_time else e) - limit
    ups = [p for p in kept if p[0] < e and p[0] <= (1.0 - LEAST_GAIN) * e]
    downs = [p for p in kept if p[0] > e and p[1] < low]
    best = (min(ups, key=lambda p: (p[1], p[0], p[2]), default=None),
            min(downs, key=lambda p: (p[0], p[1], p[2]), default=None))
    for step, wanted in zip((found.up, found.down), best, strict=True):
        assert (step is None) == (wanted is None)
        if step is not None and wanted is not None:
            other = points[step.point]
            assert (other[0], *other[1]) == wanted
            assert other in on
            assert (step.seconds, step.error) == (other[1][0] - low, other[0] - e)
            assert step.sure == (other[1][0] > high or other[1][1] < low)


# --- noise ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(20))
def test_what_one_measurement_is_sure_of_the_next_does_not_deny(seed: int) -> None:
    """Two sets of bars, each about the same true times: no point is certain in one and dominated in the other."""
    rng = np.random.default_rng(seed)
    errors, times = rng.integers(1, 30, 40) / 8.0, rng.lognormal(0.0, 1.0, 40)
    true = front(errors, times, times).membership
    sets = [front(errors, times * (1 - rng.uniform(0, 0.1, 40)), times * (1 + rng.uniform(0, 0.2, 40))).membership
            for _ in range(2)]
    for words in sets:
        assert all(word != "dominated" for word, exact in zip(words, true, strict=True) if exact == "certain")
        assert all(word != "certain" for word, exact in zip(words, true, strict=True) if exact == "dominated")
    assert {"certain", "dominated"} not in [set(pair) for pair in zip(*sets, strict=True)]
    assert "certain" in sets[0]
    assert "dominated" in sets[0]


def test_noise_can_deny_what_bars_do_not_cover() -> None:
    """So the test above can fail: the same points with bars of length 0 at noisy times."""
    rng = np.random.default_rng(0)
    errors, times = rng.integers(1, 30, 40) / 8.0, rng.lognormal(0.0, 1.0, 40)
    sets = []
    for _ in range(2):
        noisy = times * rng.uniform(0.7, 1.5, 40)
        sets.append(front(errors, noisy, noisy).membership)
    assert {"certain", "dominated"} in [set(pair) for pair in zip(*sets, strict=True)]


# --- times ------------------------------------------------------------------------------------------


def test_a_spread_by_hand() -> None:
    assert spread([3.0, 1.0, 2.0]) == Spread(1.0, 2.0, (3.0, 1.0, 2.0))
    assert spread(np.array([4.0, 1.0])) == Spread(1.0, 2.5, (4.0, 1.0))
    assert spread([0.25]) == Spread(0.25, 0.25, (0.25,))
    low, high = bars([spread([3.0, 1.0, 2.0]), None])
    np.testing.assert_array_equal(low, [1.0, NAN])
    np.testing.assert_array_equal(high, [2.0, NAN])
    assert front([0.5, 0.1], low, high).membership == ("certain", "failed")


@pytest.mark.parametrize(("runs", "stated"), [(3, None), (5, None), (7, 0.07), (11, 0.012), (15, 0.002)])
def test_how_often_bars_of_the_same_work_lie_apart(runs: int, stated: float | None) -> None:
    """The documented share, from all orders of two sets of runs (from 100 000 random ones beyond 5 runs)."""
    m = (runs - 1) // 2
    share = Fraction(2 * math.comb(3 * m + 1, m), math.comb(4 * m + 2, runs))
    assert stated is None or round(float(share), 3) == stated
    ranks = np.arange(1.0, 2 * runs + 1)
    if runs <= 5:
        firsts = [np.array(kept) for kept in itertools.combinations(ranks, runs)]
        apart = [lies_apart(first, np.setdiff1d(ranks, first)) for first in firsts]
        assert Fraction(sum(apart), len(apart)) == share
        return
    rng = np.random.default_rng(runs)
    drawn = rng.standard_exponential((100_000, 2, runs))
    low, high = drawn.min(axis=2), np.median(drawn, axis=2)
    count = int(((low[:, 0] > high[:, 1]) | (low[:, 1] > high[:, 0])).sum())
    mean = float(share) * 1e5
    assert abs(count - mean) < 4.0 * math.sqrt(mean)  # four standard deviations of a binomial count


def lies_apart(first: np.ndarray, second: np.ndarray) -> bool:
    a, b = spread(first), spread(second)
    return a.least > b.median or b.least > a.median


# --- bad input --------------------------------------------------------------------------------------


def numbers(text: str) -> list[float]:
    return [float(word) for word in text.split()]


@pytest.mark.parametrize(("columns", "place", "words"), [
    (("", "", ""), "errors", "one or more points"),
    (("1", "1 2", "1"), "low", "shape (2,), must be that of errors, (1,)"),
    (("1 2", "1 2", "1"), "high", "shape (1,)"),
    (("1 -2 3", "1 1 1", "1 1 1"), "errors[1]", "-2.0, must be at least 0"),
    (("1 2", "1 0", "1 1"), "low[1]", "0.0, must be above 0 s"),
    (("1 2", "nan nan", "1 -1"), "high[1]", "-1.0, must be above 0 s"),
    (("1 2", "1 3", "1 2"), "low[1]", "3.0, must be at most high, 2.0"),
])
def test_points_that_are_none(columns, place, words) -> None:
    e, low, high = map(numbers, columns)
    for function in (front, lambda *a: equal_time(*a, [1.0]), lambda *a: equal_error(*a, [1.0]),
                     lambda *a: recommend(*a, budget=1.0)):
        with pytest.raises(InputError) as caught:
            function(e, low, high)
        assert caught.value.place == place
        assert words in caught.value.problem


@pytest.mark.parametrize("bad", [0.0, -1.0, NAN, INF])
def test_limits_that_are_none(bad: float) -> None:
    one = ([1.0], [1.0], [1.0])
    for call, place in ((lambda: recommend(*one, budget=bad), "budget"),
                        (lambda: recommend(*one, most_error=bad), "most_error"),
                        (lambda: equal_time(*one, [1.0, bad]), "budgets[1]"),
                        (lambda: equal_error(*one, [bad]), "levels[0]"),
                        (lambda: spread([1.0, bad]), "seconds[1]")):
        with pytest.raises(InputError) as caught:
            call()
        assert caught.value.place == place
        assert repr(bad) in caught.value.problem


def test_other_arguments_that_are_none() -> None:
    one = ([1.0], [1.0], [1.0])
    for both in ({}, {"budget": 1.0, "most_error": 1.0}):
        with pytest.raises(InputError, match="must be given if budget is not, and must not if it is"):
            recommend(*one, **both)
    for base in (1, -1, True, 0.0):
        with pytest.raises(InputError, match=r"^base: "):
            equal_error(*one, [1.0], base=base)
    with pytest.raises(InputError, match="at least one run"):
        spread([])
    with pytest.raises(InputError, match="errors: has shape"):
        front([[1.0]], [[1.0]], [[1.0]])
