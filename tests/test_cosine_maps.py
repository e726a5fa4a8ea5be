"""Extinction transmittance maps: coefficients against many digits, reconstruction against exact integrals."""

from __future__ import annotations

import mpmath
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from froxel_ref import fom
from froxel_ref.absorbers import Absorbers, as_points
from froxel_ref.cosine_maps import cosine_coefficients, optical_depth, transmittance
from froxel_ref.deep_shadow import direct_depth

UNIT = st.floats(0, 1)


def exact_coefficients(stretches, count):
    """2∫σ cos πkx dx by the antiderivative of a linear σ, with digits to spare for its differences."""
    result = []
    with mpmath.workdps(120):
        for k in range(count):
            total = mpmath.mpf(0)
            for start, stop, tau, rise in stretches:
                a, b, t, r = (mpmath.mpf(float(v)) for v in (start, stop, tau, rise))
                w, length = mpmath.pi * k, b - a
                if length == 0 or k == 0:
                    total += 2 * t * mpmath.cos(w * a)
                    continue
                slope = r / length**2
                low = t / length - slope * length / 2

                def inner(x, a=a, w=w, low=low, slope=slope):
                    return (low + slope * (x - a)) * mpmath.sin(w * x) / w + slope * mpmath.cos(w * x) / w**2

                total += 2 * (inner(b) - inner(a))
            result.append(total)
    return result


@settings(max_examples=50)
@given(st.lists(st.tuples(UNIT, UNIT, st.floats(1e-6, 30), st.floats(-2, 2)), min_size=1, max_size=6),
       st.integers(1, 12), st.floats(1e-9, 1))
def test_coefficients_within_16_ulp_of_many_digits(drawn, count, shrink):
    rows = []
    for a, b, tau, share in drawn:
        start = min(a, b)
        stop = start + abs(b - a) * shrink
        rows.append((start, stop if stop - start > 1e-25 else start, tau, share * tau))
    absorbers = Absorbers(*(np.array(column) for column in zip(*rows, strict=True)))
    got = cosine_coefficients(absorbers, count=count)
    scale = np.spacing(2 * float((absorbers.tau + np.abs(absorbers.rise)).sum()))
    for value, want in zip(got, exact_coefficients(rows, count), strict=True):
        assert abs(float(mpmath.mpf(float(value)) - want)) <= 16 * scale


@given(st.lists(st.tuples(UNIT, st.floats(0, 50)), min_size=1, max_size=8), st.integers(1, 12))
def test_both_ends_are_exact(points, count):
    depths, taus = (np.array(column) for column in zip(*points, strict=True))
    coefficients = cosine_coefficients(as_points(depths, taus), count=count)
    ends = optical_depth(coefficients, np.array([0.0, 1.0, -3.0, 7.0]))
    assert ends[0] == ends[2] == 0.0
    assert ends[1] == ends[3] == coefficients[0] / 2


@pytest.mark.parametrize("count", [1, 2, 4, 8])
def test_band_limited_extinction_is_reproduced_to_rounding(count):
    """σ(x) = m + Σ p_k cos πkx: its coefficients are known, its integral too."""
    p = np.random.default_rng(1).uniform(-0.2, 0.2, count - 1)
    k = np.arange(1, count)
    d = np.linspace(0, 1, 501)
    want = 3.0 * d + (p * np.sin(np.pi * d[:, None] * k) / (np.pi * k)).sum(1)
    np.testing.assert_allclose(optical_depth(np.concatenate([[6.0], p]), d), want, rtol=0, atol=4e-15 * (1 + count))


def test_an_exponential_is_not_wrapped_round():
    """A fall from 1 to e⁻⁴ is a jump for a Fourier basis and a kink for this one: coefficients fall as 1/k²."""
    x = np.linspace(0, 1, 4001)
    value = np.exp(-4 * x)
    h = x[1]
    layers = Absorbers(x[:-1], x[1:], 0.5 * h * (value[:-1] + value[1:]), h * np.diff(value))
    d = np.linspace(0, 1, 101)
    got = optical_depth(cosine_coefficients(layers), d)
    want = (1 - np.exp(-4 * d)) / 4
    error = np.abs(got - want).max()
    assert error < 8 / np.pi**3 * (1 / np.arange(8, 10000.0) ** 3).sum()  # |c_k| ≤ 8/(πk)²: those left out
    fourier = fom.segment_coefficients(*layers[:3], rise=layers.rise)
    assert error < 0.2 * np.abs(fom.optical_depth(fourier, d) - want).max()
    k = np.arange(1, 8)
    exact = 8 * (1 - (-1.0) ** k * np.exp(-4)) / (16 + (np.pi * k) ** 2)
    np.testing.assert_allclose(cosine_coefficients(layers)[1:], exact, rtol=1e-5)  # the stretches' own, h²


def test_slabs_converge():
    slab = Absorbers(*(np.array([v]) for v in (0.3, 0.7, 2.0, 0.0)))
    d = np.linspace(0, 1, 2001)
    counts = np.array([8, 16, 32, 64])
    errors = [np.sqrt(np.mean((optical_depth(cosine_coefficients(slab, count=int(c)), d) - direct_depth(slab, d)) ** 2))
              for c in counts]
    slope = -np.polyfit(np.log(counts), np.log(errors), 1)[0]
    assert 1.2 < slope < 1.8  # coefficients of a kink fall as 1/k²: root mean square k^(−3/2)


def test_overshoot_is_cut():
    layer = cosine_coefficients(as_points(np.array([0.5]), np.array([4.0])))
    d = np.linspace(0, 1, 1001)
    assert transmittance(layer, d, clamp=False).max() > 1.4
    assert transmittance(layer, d).max() == 1.0


def test_rays_and_float32():
    rng = np.random.default_rng(2)
    ends = np.sort(rng.random((2, 9, 4, 3)), axis=0)
    tau = rng.random((9, 4, 1))
    many = Absorbers(ends[0], ends[1], tau, 0.5 * tau)
    got = cosine_coefficients(many)
    assert got.shape == (8, 4, 3)
    one = Absorbers(ends[0, :, 2, 1], ends[1, :, 2, 1], tau[:, 2, 0], 0.5 * tau[:, 2, 0])
    np.testing.assert_allclose(got[:, 2, 1], cosine_coefficients(one), rtol=1e-13, atol=1e-14)
    assert optical_depth(got, rng.random((6, 1, 3))).shape == (6, 4, 3)
    narrow = cosine_coefficients(Absorbers(*(row.astype(np.float32) for row in many)))
    assert narrow.dtype == transmittance(narrow, np.zeros((1, 1, 1), np.float32)).dtype == np.float32
    np.testing.assert_allclose(narrow, got, atol=60 * 1.2e-7 * 9)
