"""The adaptive rule by itself: what it integrates exactly, that its estimate is honest, that it gives up."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from froxel_ref.quadrature import (
    GAUSS_WEIGHTS,
    KRONROD_WEIGHTS,
    NODES,
    Pool,
    integrate_pool,
    kronrod,
)


def intervals(*limits, owner=0):
    low, high = np.array(limits, float).T
    count = len(low)
    return Pool(np.full(count, owner), np.zeros(count, np.intp), low, high)


def rule(f):
    def evaluate(pool):
        half = 0.5 * (pool.high - pool.low)
        return kronrod(f(0.5 * (pool.low + pool.high)[:, None] + half[:, None] * NODES)[None], half)

    return evaluate


@pytest.mark.parametrize(("weights", "degree"), [(KRONROD_WEIGHTS, 23), (GAUSS_WEIGHTS, 13)])
def test_rules_are_exact_up_to_their_degree_and_not_beyond(weights, degree):
    for power in range(degree + 1):
        exact = 2 / (power + 1) if power % 2 == 0 else 0.0
        assert abs(weights @ NODES**power - exact) < 4e-16 * 4
    beyond = degree + 1
    assert abs(weights @ NODES**beyond - 2 / (beyond + 1)) > 1e-10


# Integrand, limits, exact value: smooth, peaked, kinked, singular at an end, oscillating, tiny.
CASES = {
    "exponential": (np.exp, 0, 1, math.e - 1),
    "steep": (lambda x: np.exp(-300 * x), 0, 1, -math.expm1(-300) / 300),
    "lorentzian": (lambda x: 1 / (1e-6 + x * x), -1, 2, (math.atan(2e3) + math.atan(1e3)) * 1e3),
    "kink": (lambda x: np.abs(x - 0.3), 0, 1, (0.09 + 0.49) / 2),
    "root": (np.sqrt, 0, 1, 2 / 3),
    "jump": (lambda x: np.where(x > 1 / 3, 1.0, 0.0), 0, 1, 2 / 3),
    "wave": (lambda x: 2 + np.sin(40 * x), 0, 1, 2 + (1 - math.cos(40)) / 40),
    "small": (lambda x: 1e-300 * x, 0, 1, 5e-301),
}


@pytest.mark.parametrize("name", CASES)
@pytest.mark.parametrize("rtol", [1e-2, 1e-4, 1e-8, 1e-12])
def test_the_tolerance_is_met_and_the_estimate_is_honest(name, rtol):
    f, low, high, exact = CASES[name]
    totals = integrate_pool(rule(f), intervals((low, high)), 1, rtol=rtol)
    error = abs(totals.value[0, 0] - exact)
    assert totals.converged[0]
    assert error <= rtol * exact
    assert error <= 10 * totals.error[0, 0]


@given(st.floats(0.05, 0.95), st.floats(1e-3, 10.0))
def test_kinks_anywhere_are_found(place, slope):
    totals = integrate_pool(rule(lambda x: 1 + slope * np.abs(x - place)), intervals((0, 1)), 1, rtol=1e-7)
    exact = 1 + slope * (place**2 + (1 - place) ** 2) / 2
    assert totals.converged[0]
    assert abs(totals.value[0, 0] - exact) <= 1e-7 * exact


def test_a_split_at_the_kink_needs_no_second():
    f = rule(lambda x: np.abs(x - 0.3))
    guided = integrate_pool(f, intervals((0, 1)), 1, rtol=1e-12, split=lambda pool: np.full(len(pool.low), 0.3))
    blind = integrate_pool(f, intervals((0, 1)), 1, rtol=1e-12)
    assert guided.evaluations[0] == 45
    assert blind.evaluations[0] > 500
    assert abs(guided.value[0, 0] - 0.29) < 1e-15


def test_split_points_outside_or_nan_mean_the_middle():
    f = rule(np.sqrt)
    plain = integrate_pool(f, intervals((0, 1)), 1, rtol=1e-9)
    for point in (np.nan, np.inf, 7.0, 0.0):
        other = integrate_pool(f, intervals((0, 1)), 1, rtol=1e-9,
                               split=lambda pool, p=point: np.full(len(pool.low), p))
        assert other.value[0, 0] == plain.value[0, 0]


def test_owners_do_not_touch_each_other():
    """An owner's result has the same bits alone and among others."""
    f = rule(lambda x: np.abs(np.sin(7 * x)) + 0.1)
    rng = np.random.default_rng(5)
    ends = np.sort(rng.uniform(0, 9, (20, 2)), axis=1)
    together = integrate_pool(f, Pool(np.arange(20), np.zeros(20, np.intp), ends[:, 0], ends[:, 1]), 20,
                              rtol=1e-6)
    for i, (low, high) in enumerate(ends):
        alone = integrate_pool(f, intervals((low, high)), 1, rtol=1e-6)
        assert alone.value[0, 0] == together.value[0, i]
        assert alone.evaluations[0] == together.evaluations[i]


def test_limits_are_told():
    f = rule(lambda x: 1 / (1e-12 + (x - 0.3) ** 2))
    assert integrate_pool(f, intervals((0, 1)), 1, rtol=1e-9).converged[0]
    assert not integrate_pool(f, intervals((0, 1)), 1, rtol=1e-9, limit_rounds=3).converged[0]
    few = integrate_pool(f, intervals((0, 1)), 1, rtol=1e-9, limit_intervals=5)
    assert not few.converged[0]
    assert few.evaluations[0] < 400


def test_what_is_not_finite_is_not_converged():
    totals = integrate_pool(rule(lambda x: np.where(x > 0.5, np.nan, 1.0)), intervals((0, 1)), 1, rtol=1e-3)
    assert not totals.converged[0]


def test_nothing_and_darkness_converge_at_once():
    none = Pool(np.zeros(0, np.intp), np.zeros(0, np.intp), np.zeros(0), np.zeros(0))
    totals = integrate_pool(rule(np.sin), none, 3, rtol=1e-9)
    assert totals.converged.all()
    assert not totals.value.any()
    dark = integrate_pool(rule(lambda x: 0 * x), intervals((0, 1)), 1, rtol=1e-9)
    assert dark.converged[0]
    assert dark.evaluations[0] == 15


def test_every_channel_must_converge():
    def evaluate(pool):
        half = 0.5 * (pool.high - pool.low)
        x = 0.5 * (pool.low + pool.high)[:, None] + half[:, None] * NODES
        return kronrod(np.stack([np.ones_like(x), 1e-9 * np.sqrt(x)]), half)

    totals = integrate_pool(evaluate, intervals((0, 1)), 1, rtol=1e-10, channels=2)
    assert totals.converged[0]
    assert abs(totals.value[1, 0] / (2e-9 / 3) - 1) < 1e-10
