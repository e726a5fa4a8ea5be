"""Halton points: their values, their means, how evenly they lie, and what a frame gets of them."""

from __future__ import annotations

import math
from collections import Counter
from fractions import Fraction
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from froxel_ref.jitter import BASES, POINTS, froxel_jitter, halton, jitter_points
from froxel_ref.records import InputError

EPS = 2.0**-52


def mirrored(index: int, base: int) -> Fraction:
    """The definition, digit by digit, in exact fractions [Dörries 2020, listing 3.6]."""
    value, weight = Fraction(0), Fraction(1)
    while index > 0:
        weight /= base
        value += weight * (index % base)
        index //= base
    return value


def published(count: int) -> list[tuple[Fraction, ...]]:
    return [tuple(mirrored(i, base) for base in (2, 3, 5)) for i in range(1, count + 1)]


# --- the sequence -------------------------------------------------------------------------------------


@pytest.mark.parametrize(("base", "expected"), [
    (2, [0, 1 / 2, 1 / 4, 3 / 4, 1 / 8, 5 / 8, 3 / 8, 7 / 8, 1 / 16]),
    (3, [0, 1 / 3, 2 / 3, 1 / 9, 4 / 9, 7 / 9, 2 / 9, 5 / 9, 8 / 9]),
    (5, [0, 1 / 5, 2 / 5, 3 / 5, 4 / 5, 1 / 25, 6 / 25, 11 / 25, 16 / 25]),
])
def test_the_first_values_by_hand(base: int, expected: list[float]) -> None:
    assert halton(np.arange(9), base).tolist() == expected


@given(index=st.integers(0, 2**40), base=st.integers(2, 4096))
def test_values_are_correctly_rounded(index: int, base: int) -> None:
    assert float(halton(index, base)) == float(mirrored(index, base))


def test_the_base_may_exceed_the_index_and_arrays_keep_their_shape() -> None:
    assert float(halton(3, 7)) == 3 / 7
    assert halton(np.arange(6).reshape(2, 3), 2).shape == (2, 3)
    assert halton(np.zeros(0, int), 2).shape == (0,)


@given(base=st.sampled_from(BASES), digits=st.integers(1, 5))
def test_a_whole_period_is_a_grid(base: int, digits: int) -> None:
    count = base**digits
    assert sorted(halton(np.arange(count), base).tolist()) == [i / count for i in range(count)]


# --- the points ---------------------------------------------------------------------------------------


def test_published_points_are_the_indices_from_1_on() -> None:
    expected = [[float(c) for c in point] for point in published(32)]
    assert jitter_points("published").tolist() == expected


def test_d10_the_published_mean_is_not_a_half() -> None:
    """(0.485, 0.481, 0.462), as the exact means of the definition have it."""
    means = [sum(column) / 32 for column in zip(*published(32), strict=True)]
    assert means == [Fraction(993, 2048), Fraction(13, 27), Fraction(231, 500)]
    np.testing.assert_allclose(jitter_points("published").mean(axis=0), [float(m) for m in means], rtol=4 * EPS)


def test_a2_the_authors_points_are_every_other_one() -> None:
    points = jitter_points("author")
    expected = [[float(mirrored(2 * (f % 16) + 1, base)) for base in (2, 3, 5)] for f in range(16)]
    assert points.tolist() == expected
    assert points[:, 0].mean() == 0.734375
    assert points[:, 0].min() == 0.5


@pytest.mark.parametrize("count", [*range(1, 130), 266, 625, 1000, 4096])
def test_centred_points_average_a_half_and_stay_inside(count: int) -> None:
    points = jitter_points(count=count)
    assert points.shape == (count, 3)
    assert points.min() >= 0.0
    assert points.max() < 1.0
    for axis in range(3):
        # Each point is rounded once, by at most 2⁻⁵⁴ (those below ½ by less).
        mean = sum(map(Fraction, points[:, axis].tolist())) / count
        assert abs(mean - Fraction(1, 2)) <= Fraction(1, 2**54)


@pytest.mark.parametrize("count", [1, 2, 16, 31, 32, 33, 64, 92])
def test_centred_points_are_the_published_ones_moved(count: int) -> None:
    """No point is wrapped: all distances between points stay."""
    moved = jitter_points(count=count) - jitter_points("published", count=count)
    # Differences of numbers below 1, each rounded by at most 2⁻⁵⁴.
    assert np.ptp(moved, axis=0).max() <= 4 * 2.0**-54
    assert moved[0].min() >= -(2.0**-54)  # the published mean is never above ½


def test_beyond_92_points_an_axis_is_drawn_together_by_less_than_a_hundredth() -> None:
    for count in (93, 131, 136, 266, 4096):
        own, before = jitter_points(count=count), jitter_points("published", count=count)
        scale = np.ptp(own, axis=0) / np.ptp(before, axis=0)
        assert scale.min() > 0.99
        assert scale.max() <= 1.0 + 4 * EPS
    assert np.ptp(jitter_points(count=93), axis=0)[1] < np.ptp(jitter_points("published", count=93), axis=0)[1]


def star_discrepancy_l2(points: Any) -> float:
    """Warnock's closed form of the L2 star discrepancy, as three sums over the points."""
    n, d = points.shape
    single = sum(math.prod((1.0 - float(c) ** 2) / 2.0 for c in p) for p in points)
    double = sum(math.prod(1.0 - max(float(a), float(b)) for a, b in zip(p, q, strict=True))
                 for p in points for q in points)
    return math.sqrt(3.0**-d - 2.0 / n * single + double / n**2)


def test_points_lie_more_evenly_than_random_ones() -> None:
    """Measured: centred 0.0251, published 0.0266, author's 0.093; 20 random sets of 32 from 0.034 to 0.087."""
    random = [star_discrepancy_l2(np.random.default_rng(seed).random((32, 3))) for seed in range(20)]
    own, before, author = (star_discrepancy_l2(jitter_points(points)) for points in ("centred", "published", "author"))
    assert own < before < min(random)
    assert author > max(random)
    # The mean square of random points' discrepancy is (2^−d − 3^−d)/n: as a check of the closed form.
    assert np.mean(np.square(random)) == pytest.approx((2.0**-3 - 3.0**-3) / 32, rel=0.35)


def test_consecutive_points_are_far_apart() -> None:
    steps = np.linalg.norm(np.diff(np.vstack([jitter_points(), jitter_points()[:1]]), axis=0), axis=1)
    random = np.random.default_rng(1).random((4096, 2, 3))
    assert steps.mean() > 1.1 * np.linalg.norm(random[:, 0] - random[:, 1], axis=1).mean()  # measured 1.20


# --- what a frame gets ----------------------------------------------------------------------------------


@pytest.mark.parametrize("points", POINTS)
@pytest.mark.parametrize("hold", [1, 2, 3])
def test_each_point_comes_as_often_in_a_cycle(points: str, hold: int) -> None:
    cycle = [tuple(p) for p in jitter_points(points).tolist()]
    frames = [froxel_jitter(f, points=points, hold=hold) for f in range(len(cycle) * hold)]
    assert Counter(frames) == dict.fromkeys(cycle, hold)
    assert frames[::hold] == cycle
    start = 7 * len(cycle) * hold
    assert [froxel_jitter(start + f, points=points, hold=hold) for f in range(len(frames))] == frames


@given(frame=st.integers(-10**9, 10**9), count=st.integers(2, 64), points=st.sampled_from(POINTS))
def test_a_frames_sample_lies_in_its_froxel(frame: int, count: int, points: str) -> None:
    jitter = froxel_jitter(frame, points=points, count=count)
    assert all(type(c) is float and 0.0 <= c < 1.0 for c in jitter)
    period = count // 2 if points == "author" else count
    assert jitter == froxel_jitter(frame + period, points=points, count=count)


def test_the_average_of_the_filter_comes_to_the_centre() -> None:
    """Weights α(1 − α)ⁿ on a cycle: the mean over a cycle is the points' mean, the swing about it is small."""
    for points, expected in (("centred", (0.5, 0.5, 0.5)), ("author", (0.734375, 0.46296296, 0.452))):
        average = np.array(froxel_jitter(0, points=points))
        seen = []
        for frame in range(1, 32 * 30):
            average = average + 0.05 * (np.array(froxel_jitter(frame, points=points)) - average)
            seen.append(average)
        # 0.95^(32·26) of the start is left.
        np.testing.assert_allclose(np.mean(seen[-32:], axis=0), expected, rtol=0, atol=1e-8)
        assert np.abs(np.array(seen[-32:]) - expected).max() < 0.05  # measured 0.048, z of the centred


def test_a_checkerboard_sees_half_of_the_points_unless_they_are_held() -> None:
    """Every other frame has only x ≥ ½, the others only x < ½ (base 2): a quarter of a texel apart from the centre."""
    for points in ("published", "centred"):
        colours = [np.mean([froxel_jitter(f, points=points) for f in range(c, 32, 2)], axis=0) for c in (0, 1)]
        assert colours[0][0] - colours[1][0] == pytest.approx(0.5, abs=0.0011)  # 0.734 − 0.235: 1/64 in place of 0
    held = [np.mean([froxel_jitter(f, hold=2) for f in range(c, 64, 2)], axis=0) for c in (0, 1)]
    np.testing.assert_allclose(held, 0.5, rtol=0, atol=8 * EPS)


def test_points_are_shared_and_cannot_be_written_to() -> None:
    with pytest.raises(ValueError, match="read-only"):
        jitter_points()[0, 0] = 1.0


@pytest.mark.parametrize(("call", "words"), [
    (lambda: halton(-1, 2), "whole numbers from 0"), (lambda: halton(0.5, 2), "whole numbers from 0"),
    (lambda: halton(2**53, 2), "whole numbers from 0"), (lambda: halton(1, 1), "at least 2"),
    (lambda: halton(1, 2.5), "at least 2"), (lambda: jitter_points("corrected"), "known|mean"),
    (lambda: jitter_points(count=0), "1 to 65536"), (lambda: jitter_points("author", count=1), "2 to 65536"),
    (lambda: jitter_points(count=65537), "1 to 65536"), (lambda: froxel_jitter(0.5), "whole number"),
    (lambda: froxel_jitter(0, hold=0), "at least 1"), (lambda: froxel_jitter(0, points="centered"), "'centred'"),
])
def test_misuse_is_refused(call: Any, words: str) -> None:
    with pytest.raises(InputError, match=words):
        call()
