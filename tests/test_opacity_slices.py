"""Opacity shadow maps: slices against rational arithmetic and a slow loop, lookups against interpolation by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from reference_volumetric import exact_depth, stretches_of

from froxel_ref.absorbers import Absorbers, as_points
from froxel_ref.opacity_slices import opacity_slices, slice_depths, transmittance
from froxel_ref.records import InputError

EPS = float(np.finfo(np.float64).eps)
UNIT = st.floats(0, 1)
STRETCHES = st.lists(st.tuples(UNIT, UNIT, st.floats(0, 100), st.floats(-2, 2)), min_size=1, max_size=8)


def absorbers_of(drawn):
    rows = [(min(a, b), max(a, b), tau, share * tau if a != b else 0.0) for a, b, tau, share in drawn]
    return Absorbers(*(np.array(column) for column in zip(*rows, strict=True)))


def exact_before(stretches, depth):
    """The same as `exact_depth` but without the points at the depth itself."""
    return exact_depth(stretches, depth) - sum(exact_depth([s], depth) for s in stretches if s[0] == s[1] == depth)


@settings(max_examples=50)
@given(STRETCHES, st.integers(1, 40))
def test_means_are_exact(drawn, slices):
    absorbers = absorbers_of(drawn)
    got = slice_depths(absorbers, slices=slices)
    assert got.shape == (slices,)
    whole = absorbers.tau.sum()
    for k, value in enumerate(got):
        low, high = k / slices, (k + 1) / slices  # a point at depth 1 is in the last slice
        want = (exact_depth if k == slices - 1 else exact_before)(stretches_of(absorbers), high)
        want -= exact_before(stretches_of(absorbers), low)
        # Edges are rounded in another way than k/S is: points next to an edge may change slices.
        near = sum(t for a, b, t, _ in stretches_of(absorbers)
                   if b - a < 1e-12 and min(abs(a - low), abs(a - high)) < 1e-12)
        assert abs(float(value) - float(want)) <= 60 * EPS * whole + near + 1e-300


def test_voxel_samplings_against_a_slow_loop():
    rng = np.random.default_rng(1)
    ends = np.sort(rng.random((2, 30)), axis=0)
    ends[1, 20:] = ends[0, 20:]
    tau = rng.random(30)
    rise = np.where(ends[1] > ends[0], tau * rng.uniform(-2, 2, 30), 0.0)
    absorbers = Absorbers(ends[0], ends[1], tau, rise)
    slices = 12
    want = {"nearest": np.zeros(slices), "linear": np.zeros(slices)}
    for a, b, t, r in stretches_of(absorbers):
        if a == b:
            place = a * slices
            want["nearest"][int(place)] += t
            beside = min(max(place - 0.5, 0.0), slices - 1.0)
            cell = min(int(beside), slices - 2)
            want["linear"][cell] += t * (1 - (beside - cell))
            want["linear"][cell + 1] += t * (beside - cell)
            continue
        for k in range(slices):
            middle = (k + 0.5) / slices
            if a <= middle < b:
                value = (t + r * ((middle - a) / (b - a) - 0.5)) / (b - a) / slices
                want["nearest"][k] += value
                want["linear"][k] += value
    for sampling, values in want.items():
        np.testing.assert_allclose(slice_depths(absorbers, slices=slices, sampling=sampling), values, rtol=1e-12,
                                   atol=1e-14)


@given(st.lists(st.tuples(UNIT, st.floats(0, 100)), min_size=1, max_size=9), st.integers(1, 40),
       st.sampled_from(["mean", "nearest", "linear"]))
def test_no_point_is_lost(points, slices, sampling):
    depth, tau = (np.array(column) for column in zip(*points, strict=True))
    got = slice_depths(as_points(depth, tau), slices=slices, sampling=sampling)
    assert abs(got.sum() - tau.sum()) <= 20 * EPS * tau.sum() + 1e-300
    assert got.min() >= 0.0


def test_a_slab_between_two_middles_is_missed():
    slab = Absorbers(*(np.array([v]) for v in (0.30, 0.36, 4.0, 0.0)))
    assert slice_depths(slab, slices=4, sampling="nearest").tolist() == [0.0] * 4
    assert slice_depths(slab, slices=4).sum() == pytest.approx(4.0)


def test_smooth_extinction_has_order_2():
    x = np.linspace(0, 1, 2001)
    value = 2.0 + np.sin(3 * x)
    h = x[1]
    medium = Absorbers(x[:-1], x[1:], 0.5 * h * (value[:-1] + value[1:]), h * np.diff(value))
    exact = 2.0 + (1 - math.cos(3.0)) / 3.0
    errors = [abs(slice_depths(medium, slices=s, sampling="nearest").sum() - exact) for s in (4, 8, 16)]
    slopes = np.diff(np.log2(errors))
    assert ((slopes > -2.1) & (slopes < -1.9)).all()


@pytest.mark.parametrize("holds", ["transmittance", "depth"])
def test_lookups_are_linear_between_the_ends(holds):
    depths = np.array([0.0, 2.0, 0.5, 0.0, 1.0])
    d = np.array([-1.0, 0.0, 0.1, 0.2, 0.3, 0.55, 0.99, 1.0, 2.0])
    passed = transmittance(opacity_slices(depths, holds=holds), d, holds=holds)
    knots, total = np.linspace(0, 1, 6), np.concatenate([[0.0], np.cumsum(depths)])
    want = (np.interp(d, knots, np.exp(-total)) if holds == "transmittance" else np.exp(-np.interp(d, knots, total)))
    np.testing.assert_allclose(passed, want, rtol=1e-14)
    assert passed[0] == passed[1] == 1.0


@given(STRETCHES, st.integers(1, 40), st.sampled_from(["transmittance", "depth"]))
def test_never_brightens(drawn, slices, holds):
    encoded = opacity_slices(slice_depths(absorbers_of(drawn), slices=slices), holds=holds)
    passed = transmittance(encoded, np.linspace(-0.1, 1.1, 400), holds=holds)
    assert np.diff(passed).max() <= 4 * EPS
    assert passed.min() >= 0.0
    assert passed.max() == 1.0


def test_rays_and_float32():
    rng = np.random.default_rng(3)
    ends = np.sort(rng.random((2, 9, 4, 3)), axis=0)
    tau = rng.random((9, 4, 1))
    many = Absorbers(ends[0], ends[1], tau, np.zeros((1, 1, 1)))
    encoded = opacity_slices(slice_depths(many))
    assert encoded.shape == (32, 4, 3)
    d = rng.random((6, 1, 3))
    one = Absorbers(ends[0, :, 2, 1], ends[1, :, 2, 1], tau[:, 2, 0], np.zeros(1))
    got = transmittance(encoded, d)
    assert got.shape == (6, 4, 3)
    np.testing.assert_allclose(got[:, 2, 1], transmittance(opacity_slices(slice_depths(one)), d[:, 0, 1]), rtol=1e-13)
    narrow = Absorbers(*(row.astype(np.float32) for row in many))
    low = transmittance(opacity_slices(slice_depths(narrow)), d.astype(np.float32))
    assert low.dtype == np.float32
    np.testing.assert_allclose(low, got, atol=2e-5)


def test_bad_input_is_named():
    slab = Absorbers(*(np.array([v]) for v in (0.3, 0.7, 1.0, 0.0)))
    with pytest.raises(InputError, match="slices: is 0, must be at least 1"):
        slice_depths(slab, slices=0)
    with pytest.raises(InputError, match="sampling: is 'nearst'"):
        slice_depths(slab, sampling="nearst")
    with pytest.raises(InputError, match="holds: is 'opacity'"):
        opacity_slices(np.zeros(3), holds="opacity")
    with pytest.raises(InputError, match="holds: is 'opacity'"):
        transmittance(np.ones(3), np.zeros(2), holds="opacity")
