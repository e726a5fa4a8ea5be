"""Fourier opacity maps: coefficients against many digits, reconstruction against exact integrals."""

from __future__ import annotations

import itertools
import math

import mpmath
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from froxel_ref.fom import (
    even_coefficients,
    falling_coefficients,
    opacity_depth,
    optical_depth,
    sample_coefficients,
    segment_coefficients,
    transmittance,
)

EPS = float(np.finfo(np.float64).eps)
UNIT = st.floats(0, 1)


def exact_samples(depths, taus, harmonics):
    with mpmath.workdps(40):
        return [[2 * mpmath.fsum(mpmath.mpf(t) * f(2 * mpmath.pi * k * mpmath.mpf(d))
                                 for d, t in zip(depths, taus, strict=True)) for k in range(harmonics + 1)]
                for f in (mpmath.cos, mpmath.sin)]


def exact_segments(parts, harmonics):
    """2∫σ(x) cos, sin 2πkx dx by antiderivatives of a linear σ, with digits to spare for their differences."""
    result = []
    with mpmath.workdps(120):
        for turned in (False, True):
            row = []
            for k in range(harmonics + 1):
                total = mpmath.mpf(0)
                for start, stop, tau, rise in parts:
                    a, b, t, r = (mpmath.mpf(v) for v in (start, stop, tau, rise))
                    w, length = 2 * mpmath.pi * k, b - a
                    if length == 0:
                        total += 2 * t * (mpmath.sin if turned else mpmath.cos)(w * a)
                        continue
                    slope = r / length**2
                    low = t / length - slope * length / 2
                    if k == 0:
                        total += 0 if turned else 2 * t
                    elif turned:
                        def inner(x, a=a, w=w, low=low, slope=slope):
                            return -(low + slope * (x - a)) * mpmath.cos(w * x) / w + slope * mpmath.sin(w * x) / w**2
                        total += 2 * (inner(b) - inner(a))
                    else:
                        def inner(x, a=a, w=w, low=low, slope=slope):
                            return (low + slope * (x - a)) * mpmath.sin(w * x) / w + slope * mpmath.cos(w * x) / w**2
                        total += 2 * (inner(b) - inner(a))
                row.append(total)
            result.append(row)
    return result


def ulps(got, want, scale):
    """Largest distance in ulp of the coefficients' scale."""
    return max(abs(float(mpmath.mpf(float(g)) - w)) for g, w in zip(np.ravel(got), itertools.chain(*want), strict=True)
               ) / np.spacing(scale)


# --- coefficients -----------------------------------------------------------------------------------


@settings(max_examples=80, deadline=None)
@given(st.lists(st.tuples(UNIT, st.floats(1e-6, 30)), min_size=1, max_size=12), st.integers(0, 8))
def test_samples_within_16_ulp_of_forty_digits(samples, harmonics):
    depths, taus = (np.array(column) for column in zip(*samples, strict=True))
    got = sample_coefficients(depths, taus, harmonics=harmonics)
    assert got.shape == (2, harmonics + 1)
    assert ulps(got, exact_samples(depths, taus, harmonics), 2 * taus.sum()) <= 16
    assert got[0, 0] / 2 == taus.sum()


@settings(max_examples=80, deadline=None)
@given(st.lists(st.tuples(UNIT, UNIT, st.floats(1e-6, 30), st.floats(-2, 2)), min_size=1, max_size=6),
       st.integers(0, 8), st.floats(1e-9, 1))
def test_segments_within_16_ulp_of_forty_digits(drawn, harmonics, shrink):
    parts = []
    for a, b, tau, share in drawn:
        start = min(a, b)
        stop = min(1.0, start + abs(b - a) * shrink)
        parts.append((start, stop if stop - start > 1e-25 else start, tau, share * tau))  # the reference's digits
    start, stop, tau, rise = (np.array(column) for column in zip(*parts, strict=True))
    got = segment_coefficients(start, stop, tau, rise=rise, harmonics=harmonics)
    assert ulps(got, exact_segments(parts, harmonics), 2 * (tau + np.abs(rise)).sum()) <= 16


def test_a_perturbed_harmonic_is_far_outside():
    d, tau = np.array([0.3, 0.7]), np.array([1.0, 2.0])
    assert ulps(sample_coefficients(d + 1e-13, tau), exact_samples(d, tau, 3), 6.0) > 100


def test_a_segment_without_length_is_a_sample():
    d, tau = np.random.default_rng(1).random((2, 40))
    np.testing.assert_array_equal(segment_coefficients(d, d, tau), sample_coefficients(d, tau))


@pytest.mark.parametrize("rise", [0.0, 1.0])
def test_segments_put_together_are_the_whole(rise):
    """A slab of linear extinction cut anywhere."""
    cuts = np.sort(np.concatenate([[0.2, 0.9], np.random.default_rng(2).uniform(0.2, 0.9, 30)]))
    low, high = cuts[:-1], cuts[1:]

    def density(x):
        return 2.0 + rise * (x - 0.2)

    tau = (high - low) * density(0.5 * (low + high))
    parts = segment_coefficients(low, high, tau, rise=rise * (high - low) ** 2, harmonics=6)
    whole = segment_coefficients(np.array([0.2]), np.array([0.9]), np.array([0.7 * density(0.55)]),
                                 rise=np.array([rise * 0.49]), harmonics=6)
    np.testing.assert_allclose(parts, whole, atol=1e-14)


def test_order_and_grouping_change_only_roundings():
    rng = np.random.default_rng(3)
    d, tau = rng.random((2, 1000))
    whole = sample_coefficients(d, tau)
    turn = rng.permutation(1000)
    for other in (sample_coefficients(d[turn], tau[turn]),
                  sum(sample_coefficients(d[i:i + 100], tau[i:i + 100]) for i in range(0, 1000, 100))):
        np.testing.assert_allclose(other, whole, atol=1000 * EPS * 2 * tau.sum() / 100)


def test_texels_are_the_axes_behind_the_first():
    d, tau = np.random.default_rng(4).random((2, 5, 4, 3))
    got = sample_coefficients(d, tau, harmonics=2)
    assert got.shape == (2, 3, 4, 3)
    np.testing.assert_allclose(got[:, :, 2, 1], sample_coefficients(d[:, 2, 1], tau[:, 2, 1], harmonics=2), rtol=1e-15)


def test_float32_stays():
    d, tau = np.random.default_rng(5).random((2, 50)).astype(np.float32)
    got = sample_coefficients(d, tau)
    assert got.dtype == np.float32
    wide = sample_coefficients(d.astype(float), tau.astype(float))
    np.testing.assert_allclose(got, wide, atol=60 * 1.2e-7 * tau.sum())


# --- reconstruction ---------------------------------------------------------------------------------


@given(st.lists(st.tuples(UNIT, st.floats(0, 50)), min_size=1, max_size=8), st.integers(0, 12), st.booleans())
def test_both_ends_are_exact(samples, harmonics, lanczos):
    depths, taus = (np.array(column) for column in zip(*samples, strict=True))
    coefficients = sample_coefficients(depths, taus, harmonics=harmonics)
    ends = optical_depth(coefficients, np.array([0.0, 1.0, -3.0, 7.0]), lanczos=lanczos)
    assert ends[0] == ends[2] == 0.0
    assert ends[1] == ends[3] == coefficients[0, 0] / 2
    assert transmittance(coefficients, np.array(0.0), lanczos=lanczos) == 1.0


@pytest.mark.parametrize("harmonics", [0, 1, 3, 7])
def test_band_limited_extinction_is_reproduced_to_rounding(harmonics):
    """σ(x) = m + Σ p_k cos 2πkx + q_k sin 2πkx: its coefficients are known, its integral too."""
    rng = np.random.default_rng(6)
    p, q = rng.uniform(-0.2, 0.2, (2, harmonics))
    k = np.arange(1, harmonics + 1)
    coefficients = np.concatenate([[[2 * 3.0], [0.0]], np.stack([p, q])], axis=1)
    d = np.linspace(0, 1, 501)
    want = 3.0 * d + (p * np.sin(2 * np.pi * d[:, None] * k) / (2 * np.pi * k)).sum(1) + (
        q * (1 - np.cos(2 * np.pi * d[:, None] * k)) / (2 * np.pi * k)).sum(1)
    np.testing.assert_allclose(optical_depth(coefficients, d), want, atol=2e-15 * (1 + harmonics))


def test_the_known_failure_of_three_harmonics():
    """A thin layer of optical depth 4 at ½: transmittance overshoots to 1.450, and is cut."""
    layer = sample_coefficients(np.array([0.5]), np.array([4.0]))
    d = np.linspace(0, 1, 20001)
    assert round(float(transmittance(layer, d, clamp=False).max()), 3) == 1.450
    assert transmittance(layer, d).max() == 1.0
    # Lanczos' factors ring less, and more harmonics are sharper.
    exact = np.where(d < 0.5, 1.0, math.exp(-4.0))
    finer = sample_coefficients(np.array([0.5]), np.array([4.0]), harmonics=9)
    three, nine = (np.abs(transmittance(c, d) - exact).mean() for c in (layer, finer))
    assert nine < 0.5 * three
    assert transmittance(layer, d, clamp=False, lanczos=True).max() < 1.1


def test_coefficients_of_a_slab_converge():
    """The error of the optical depth of a smooth slab falls with the harmonics as of any Fourier series of a jump."""
    slab = [segment_coefficients(np.array([0.3]), np.array([0.7]), np.array([2.0]), harmonics=k)
            for k in (4, 8, 16, 32)]
    d = np.linspace(0, 1, 2001)
    exact = 2.0 * np.clip((d - 0.3) / 0.4, 0, 1)
    errors = [np.sqrt(np.mean((optical_depth(c, d) - exact) ** 2)) for c in slab]
    slope = -np.polyfit(np.log([4, 8, 16, 32]), np.log(errors), 1)[0]
    assert 1.2 < slope < 1.8  # coefficients of a kink fall as 1/k²: root mean square k^(−3/2)


# --- opacity ----------------------------------------------------------------------------------------


def test_opacity_to_depth():
    opacity = np.array([0.0, 1e-300, 1e-9, 0.5, 1 - 2.0**-53, 1.0])
    got = opacity_depth(opacity)
    np.testing.assert_allclose(got[:5], [0.0, 1e-300, 1e-9 + 5e-19, math.log(2), 53 * math.log(2)], rtol=1e-15)
    assert got[5] == math.inf
    capped = opacity_depth(opacity, least_transmittance=1e-5)
    assert capped[5] == capped[4] == pytest.approx(11.5129254, rel=1e-8)
    assert np.array_equal(capped[:4], got[:4])


# --- stretches that fall, and marches ---------------------------------------------------------------


def exact_falling(start, stop, most, slope, harmonics):
    """2∫ σ(x) e^{2πikx} dx of σ = most·exp(−|slope|·(way from the denser end)), by its antiderivative."""
    with mpmath.workdps(120):
        a, b, m, q = (mpmath.mpf(float(v)) for v in (start, stop, most, slope))
        rows = []
        for k in range(harmonics + 1):
            w = mpmath.mpc(-q, 2 * mpmath.pi * k)
            dense = a if q >= 0 else b
            if w == 0:
                rows.append(2 * m * (b - a))
            else:
                rows.append(2 * m * mpmath.exp(q * dense) * (mpmath.exp(w * b) - mpmath.exp(w * a)) / w)
        return [[r.real for r in rows], [r.imag for r in rows]]


@settings(max_examples=80, deadline=None)
@given(UNIT, UNIT, st.floats(1e-6, 1e4), st.one_of(st.floats(-1e4, 1e4), st.floats(-1e-12, 1e-12), st.just(0.0)),
       st.integers(0, 8))
def test_falling_stretches_within_16_ulp_of_forty_digits(a, b, most, slope, harmonics):
    start, stop = sorted((a, b))
    if 0.0 < abs(slope) < 1e-15 or stop - start < 1e-12:  # beyond the reference's digits
        slope, stop = 0.0, start
    got = falling_coefficients(*(np.array([v]) for v in (start, stop, most, slope)), harmonics=harmonics)
    want = exact_falling(start, stop, most, slope, harmonics)
    # In ulp of most·length, the largest that a coefficient of such a stretch may be; the τ of a steep one is less.
    assert ulps(got, want, max(2 * most * (stop - start), 1e-300)) <= 16


def test_a_falling_stretch_that_is_level_is_constant():
    start, stop, most = np.array([0.125]), np.array([0.875]), np.array([4.0])
    level = falling_coefficients(start, stop, most, np.zeros(1), harmonics=5)
    np.testing.assert_allclose(level, segment_coefficients(start, stop, most * 0.75, harmonics=5), atol=4e-15)


@settings(max_examples=60, deadline=None)
@given(st.floats(0, 0.5), st.integers(1, 64), st.floats(0, 1), st.booleans(), st.integers(0, 6),
       st.integers(0, 2**32 - 1))
def test_a_march_is_the_sum_of_its_samples(start, count, share, filled, harmonics, seed):
    step = share * 0.5 / count
    tau = np.random.default_rng(seed).random(count)
    got = even_coefficients(np.array(start), np.array(step), tau, harmonics=harmonics, filled=filled)
    half = step / 2 if filled else 0.0
    with mpmath.workdps(60):
        exact = [[mpmath.mpf(start) + j * mpmath.mpf(step) + sign * mpmath.mpf(half) for j in range(count)]
                 for sign in (-1, 1)]
    want = exact_segments([(a, b, t, 0) for a, b, t in zip(*exact, tau, strict=True)], harmonics)
    assert ulps(got, want, 2 * tau.sum()) <= 3 * harmonics + 2 * count + 4  # the derived bound, and a little


def test_a_march_of_points_may_pass_the_end_and_wraps():
    """A8: the thesis's last sample lies beyond 1, where cosines come back to the beginning."""
    got = even_coefficients(np.array(0.75), np.array(0.5), np.array([1.0, 2.0]), filled=False)
    np.testing.assert_allclose(got, sample_coefficients(np.array([0.75, 0.25]), np.array([1.0, 2.0])), atol=1e-14)


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_the_type_of_the_inputs_is_the_type_of_the_result(dtype):
    start, stop, tau = (np.full(3, v, dtype) for v in (0.1, 0.7, 2.0))
    made = [sample_coefficients(start, tau), segment_coefficients(start, stop, tau),
            segment_coefficients(start, stop, tau, rise=tau), falling_coefficients(start, stop, tau, -tau),
            even_coefficients(start[0], stop[0], tau)]
    for coefficients in made:
        assert coefficients.dtype == dtype
        for lanczos in (False, True):
            assert optical_depth(coefficients, start[0], lanczos=lanczos).dtype == dtype


@pytest.mark.parametrize("slope", [1e-300, 1e-60, 1e-38, 1e-20])
def test_a_slope_next_to_none_is_none(slope: float) -> None:
    """Extinction that falls by nothing over the range has the coefficients of a constant one: here to 4 ulp."""
    start, stop, most = np.array([0.2]), np.array([0.7]), np.array([3.0])
    found = falling_coefficients(start, stop, most, np.array([slope]))
    constant = segment_coefficients(start, stop, most * (stop - start))
    assert np.abs(found - constant).max() <= 4.0 * np.finfo(float).eps * constant[0, 0]
