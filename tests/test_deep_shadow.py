"""Deep shadow maps: against rational arithmetic, for stretches that overlap, touch, vanish and come in any order."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from reference_volumetric import exact_depth, stretches_of

from froxel_ref.absorbers import Absorbers, as_points, joined
from froxel_ref.deep_shadow import deep_map, direct_depth, optical_depth, transmittance

EPS = float(np.finfo(np.float64).eps)
# Ends that meet exactly are the hard case, so half of them come from a few places.
PLACE = st.one_of(st.sampled_from([0.0, 0.25, 0.5, 0.75, 1.0]), st.floats(0, 1))
STRETCH = st.tuples(PLACE, PLACE, st.floats(0, 100), st.floats(-2, 2))


def absorbers_of(drawn):
    rows = [(min(a, b), max(a, b), tau, share * tau if a != b else 0.0) for a, b, tau, share in drawn]
    return Absorbers(*(np.array(column) for column in zip(*rows, strict=True)))


def largest_error(got, absorbers, depths):
    want = [exact_depth(stretches_of(absorbers), float(d)) for d in depths]
    worst = max(abs(float(g) - float(w)) for g, w in zip(got, want, strict=True))
    return worst / max(float(absorbers.tau.sum()), 1e-300)


@settings(max_examples=60)
@given(st.lists(STRETCH, min_size=1, max_size=12), st.lists(st.floats(0, 1), max_size=6))
def test_exact_to_rounding_at_all_ends_and_between(drawn, depths):
    absorbers = absorbers_of(drawn)
    ends = np.concatenate([absorbers.start, absorbers.stop, depths])
    places = np.unique(np.concatenate([ends, np.nextafter(ends, 0), np.nextafter(ends, 1), [0.0, 1.0]]))
    bound = (3 * len(drawn) + 8) * EPS
    # A depth next to a point's own is off by the point's whole optical depth if it is on the wrong side.
    assert largest_error(optical_depth(deep_map(absorbers), places), absorbers, places) <= bound
    assert largest_error(direct_depth(absorbers, places), absorbers, places) <= bound


def test_short_dense_stretches_leave_no_rest():
    """What running sums of extinction and slope get wrong, by 1e-5 of the whole even in twice the digits."""
    rng = np.random.default_rng(1)
    start = rng.random(40)
    stop = np.minimum(1.0, start + 10.0 ** rng.uniform(-16, 0, 40))
    tau = rng.random(40)
    absorbers = Absorbers(start, stop, tau, 2 * tau * rng.uniform(-1, 1, 40))
    depths = np.linspace(0, 1, 200)
    assert largest_error(optical_depth(deep_map(absorbers), depths), absorbers, depths) <= 40 * EPS


def test_closed_forms():
    d = np.linspace(0, 1, 101)
    slab = Absorbers(np.array([0.3]), np.array([0.7]), np.array([4.0]), np.array([0.0]))
    np.testing.assert_allclose(transmittance(deep_map(slab), d), np.exp(-10 * np.clip(d - 0.3, 0, 0.4)), rtol=1e-14)
    ramp = Absorbers(np.array([0.0]), np.array([1.0]), np.array([3.0]), np.array([6.0]))
    np.testing.assert_allclose(optical_depth(deep_map(ramp), d), 3 * d * d, rtol=0, atol=1e-15)


def test_a_point_counts_at_its_own_depth():
    layer = deep_map(as_points(np.array([0.5]), np.array([4.0])))
    d = np.array([0.0, np.nextafter(0.5, 0), 0.5, 1.0])
    assert optical_depth(layer, d).tolist() == [0.0, 0.0, 4.0, 4.0]


@given(st.lists(STRETCH, min_size=1, max_size=8), st.randoms())
def test_order_and_cutting_change_only_roundings(drawn, random):
    absorbers = absorbers_of(drawn)
    turn = list(range(len(drawn)))
    random.shuffle(turn)
    other = Absorbers(*(row[turn] for row in absorbers))
    d = np.linspace(0, 1, 33)
    bound = 40 * EPS * absorbers.tau.sum()
    np.testing.assert_allclose(optical_depth(deep_map(other), d), optical_depth(deep_map(absorbers), d), atol=bound)


@given(st.lists(STRETCH, min_size=1, max_size=12))
def test_never_brightens(drawn):
    encoded = deep_map(absorbers_of(drawn))
    d = np.sort(np.concatenate([np.linspace(-1, 2, 301), encoded[:len(encoded) // 4]]))
    tau, passed = optical_depth(encoded, d), transmittance(encoded, d)
    whole = tau[-1]
    assert np.diff(tau).min() >= -4 * EPS * whole
    assert tau[0] == 0.0
    assert passed.min() >= 0.0
    assert passed.max() <= 1.0


def test_rays_are_the_other_axes_and_broadcast():
    rng = np.random.default_rng(2)
    ends = np.sort(rng.random((2, 7, 3, 4)), axis=0)
    tau = rng.random((7, 1, 4))
    many = joined(Absorbers(ends[0], ends[1], tau, np.zeros((1, 1, 1))), as_points(rng.random((2, 3, 1)),
                                                                                  np.ones((1, 1, 1))))
    encoded = deep_map(many)
    assert encoded.shape == (4 * 2 * 9, 3, 4)
    d = rng.random((5, 3, 1))
    got = optical_depth(encoded, d)
    assert got.shape == (5, 3, 4)
    for y, x in np.ndindex(3, 4):
        one = Absorbers(*(row[:, y, x] for row in many))
        assert largest_error(got[:, y, x], one, d[:, y, 0]) <= 35 * EPS


@pytest.mark.parametrize("tau", [0.0, 1e-300, 1e8])
def test_extreme_depths(tau):
    encoded = deep_map(Absorbers(np.array([0.2]), np.array([0.4]), np.array([tau]), np.array([tau])))
    d = np.linspace(0, 1, 11)
    assert np.isfinite(optical_depth(encoded, d)).all()
    assert optical_depth(encoded, d)[-1] == tau
    assert transmittance(encoded, d)[0] == 1.0


def test_float32_stays():
    rng = np.random.default_rng(3)
    ends = np.sort(rng.random((2, 20, 5)), axis=0).astype(np.float32)
    tau = rng.random((20, 5)).astype(np.float32)
    narrow = Absorbers(ends[0], ends[1], tau, tau)
    wide = Absorbers(*(row.astype(float) for row in narrow))
    d = np.linspace(0, 1, 9, dtype=np.float32)[:, None]
    got = optical_depth(deep_map(narrow), d)
    assert got.dtype == transmittance(deep_map(narrow), d).dtype == np.float32
    np.testing.assert_allclose(got, optical_depth(deep_map(wide), d.astype(float)), atol=68 * 6e-8 * 20)
