"""Trigonometric moments: against the Fourier coefficients, the definition by linear algebra, and what rounding does."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from froxel_ref import fom
from froxel_ref.absorbers import Absorbers, as_points
from froxel_ref.deep_shadow import direct_depth
from froxel_ref.moment_storage import TRIGONOMETRIC_WEIGHTS, normalised_moments, stored_moments
from froxel_ref.records import InputError
from froxel_ref.trigonometric_moments import WRAPPING, transmittance, trigonometric_moments

COUNTS = pytest.mark.parametrize("count", [2, 3, 4])
STORAGES = pytest.mark.parametrize("storage", [None, "float32", "float16", "unorm16"])


def points(n, rays=(), seed=0):
    rng = np.random.default_rng(seed)
    return as_points(rng.random((n, *rays)), rng.exponential(1.0, (n, *rays)))


def slabs(n, rays=(), seed=0):
    rng = np.random.default_rng(seed)
    start, stop = np.sort(rng.random((2, n, *rays)), axis=0)
    tau = rng.exponential(1.0, (n, *rays))
    return Absorbers(start, stop, tau, 2 * tau * rng.uniform(-1, 1, tau.shape))


# --- moments ----------------------------------------------------------------------------------------


@COUNTS
def test_moments_by_quadrature(count):
    """∫σ e^{ikφ} by Gauss–Legendre's rule with 40 points, which is exact to rounding here."""
    absorbers = slabs(3, seed=count)
    u, weight = np.polynomial.legendre.leggauss(40)
    want = np.zeros(count + 1, complex)
    for a, b, tau, rise in zip(*absorbers, strict=True):
        x = a + (b - a) * (1 + u) / 2
        amount = (tau + rise * u / 2) * weight / 2
        want += [(amount * np.exp(1j * k * (2 * np.pi - WRAPPING) * x)).sum() for k in range(count + 1)]
    got = trigonometric_moments(absorbers, count=count)
    assert got.shape == (1 + 2 * count,)
    np.testing.assert_allclose(got[0], want[0].real, rtol=1e-14)
    np.testing.assert_allclose(got[1::2] + 1j * got[2::2], want[1:], atol=1e-14 * got[0])


def test_the_whole_circle_gives_fourier_opacity():
    absorbers = slabs(5, (4,))
    got = trigonometric_moments(absorbers, count=3, wrapping=0.0)
    want = fom.segment_coefficients(*absorbers[:3], rise=absorbers.rise)
    np.testing.assert_allclose(2 * got[0], want[0, 0], rtol=1e-14)
    np.testing.assert_allclose(2 * got[1::2], want[0, 1:], atol=1e-13)
    np.testing.assert_allclose(2 * got[2::2], want[1, 1:], atol=1e-13)


# --- bounds -----------------------------------------------------------------------------------------


def by_definition(encoded, depth, bias, overestimation):
    """Toeplitz matrix, roots of its kernel, weights from the moments: plain linear algebra."""
    count = (len(encoded) - 1) // 2
    b = np.concatenate([[1.0], (1 - bias) * (encoded[1::2] + 1j * encoded[2::2]) / encoded[0]])
    toeplitz = np.array([[b[j - k] if j >= k else np.conj(b[k - j]) for k in range(count + 1)]
                         for j in range(count + 1)])
    phase = (2 * np.pi - WRAPPING) * depth
    here = np.exp(1j * phase)
    kernel = np.linalg.solve(toeplitz.T, np.conj(here ** np.arange(count + 1)))
    roots = np.roots(kernel[::-1])
    np.testing.assert_allclose(np.abs(roots), 1.0, atol=1e-6)
    held = np.linalg.solve(np.concatenate([[here], roots]) ** np.arange(count + 1)[:, None], b)
    np.testing.assert_allclose(held.imag, 0.0, atol=1e-6)
    angle = np.angle(roots) % (2 * np.pi)
    zone = np.clip((angle - (2 * np.pi - WRAPPING)) / WRAPPING, 0.0, 1.0)
    share = np.where(angle < phase, 1.0, zone)
    return np.exp(-encoded[0] * (overestimation * held[0].real + (held[1:].real * share).sum()))


@COUNTS
@pytest.mark.parametrize("make", [points, slabs])
def test_the_mixture_is_that_of_the_definition(count, make):
    rng = np.random.default_rng(count)
    for seed in range(40):
        encoded = trigonometric_moments(make(rng.integers(1, 8), seed=seed), count=count)
        for d in rng.random(3):
            for beta in (0.0, 0.25, 1.0):
                got = transmittance(encoded, np.array([d]), bias=1e-3, overestimation=beta)[0]
                assert abs(got - by_definition(encoded, d, 1e-3, beta)) < 1e-10


@COUNTS
def test_few_points_come_back_exactly(count):
    """As many points as moments are the only distribution on the circle that has them."""
    for n in range(1, count + 1):
        layers = as_points(np.linspace(0.1, 0.8, n), np.linspace(0.5, 1.5, n))
        d = np.linspace(0.02, 0.95, 401)
        away = np.abs(d[:, None] - layers.start).min(axis=1) > 0.03
        got = transmittance(trigonometric_moments(layers, count=count), d[away], bias=1e-10)
        np.testing.assert_allclose(got, np.exp(-direct_depth(layers, d[away])), atol=1e-4)


def test_more_moments_are_nearer():
    d = np.linspace(0, 1, 201)[:, None]
    absorbers = slabs(5, (100,), seed=3)
    exact = np.exp(-direct_depth(absorbers, d))
    errors = [np.abs(transmittance(trigonometric_moments(absorbers, count=c), d) - exact).mean() for c in (2, 3, 4)]
    assert errors[2] < errors[1] < errors[0] < 0.1


# --- whatever rounding did --------------------------------------------------------------------------


@COUNTS
@STORAGES
def test_in_bounds_in_any_storage(count, storage):
    d = np.linspace(-0.1, 1.1, 301)[:, None]
    for n in (1, 2, 4, 30):
        for absorbers in (points(n, (60,), seed=n), slabs(n, (60,), seed=n)):
            encoded = stored_moments(trigonometric_moments(absorbers, count=count), storage, power=False)
            passed = transmittance(encoded, d, storage=storage)
            assert np.isfinite(passed).all()
            assert passed.min() >= 0.0
            assert passed.max() <= 1.0
            exact = np.exp(-direct_depth(absorbers, np.clip(d, 0, 1)))
            assert np.abs(passed - exact).mean() < 0.13


@given(st.integers(1, 5), st.integers(0, 10**6))
def test_impossible_moments_stay_in_bounds(count, seed):
    rng = np.random.default_rng(seed)
    noise = rng.uniform(-1, 1, (1 + 2 * count, 20))
    noise[0] = 3.0 * rng.random(20)
    passed = transmittance(noise, np.linspace(0, 1, 30)[:, None], bias=1e-6)
    assert np.isfinite(passed).all()
    assert passed.min() >= 0.0
    assert passed.max() <= 1.0


@COUNTS
@STORAGES
@pytest.mark.parametrize("tau", [0.0, 1e-300, 1e-12, 1.0, 1e8])
def test_single_points_of_any_depth(count, storage, tau):
    where = np.array([[0.0, 0.3, 0.5, 1.0]])
    layers = as_points(where, np.full((1, 4), tau))
    encoded = stored_moments(trigonometric_moments(layers, count=count), storage, power=False)
    passed = transmittance(encoded, np.linspace(0, 1, 101)[:, None], storage=storage)
    assert np.isfinite(passed).all()
    assert passed.min() >= 0.0
    assert passed.max() <= 1.0
    if tau < 1e-6:
        assert passed.min() >= 1.0 - 1e-6
    elif tau == 1.0:
        np.testing.assert_allclose(passed[[10, 45, 55, 90], 2], [1.0, 1.0, np.exp(-1.0), np.exp(-1.0)], atol=0.02)


@STORAGES
def test_float32_stays(storage):
    absorbers = slabs(5, (20,))
    narrow = trigonometric_moments(Absorbers(*(row.astype(np.float32) for row in absorbers)))
    assert narrow.dtype == np.float32
    encoded = stored_moments(narrow, storage, power=False)
    d = np.linspace(0, 1, 33)[:, None]
    got = transmittance(encoded, d.astype(np.float32), storage=storage)
    assert got.dtype == np.float32
    wide = transmittance(stored_moments(trigonometric_moments(absorbers), storage, power=False), d, storage=storage)
    assert np.abs(got - wide).mean() < 1e-3


@COUNTS
@pytest.mark.parametrize(("storage", "bound"), [("float32", 2e-7), ("float16", 2e-3), ("unorm16", 1.6e-5)])
def test_storage_keeps_moments_to_its_rounding(count, storage, bound):
    moments = trigonometric_moments(points(3, (500,)), count=count)
    shares = normalised_moments(stored_moments(moments, storage, power=False), storage, power=False)[1]
    error = np.abs(shares - moments[1:] / moments[0]).max()
    assert 0.0 < error < bound


@pytest.mark.parametrize("key", sorted(TRIGONOMETRIC_WEIGHTS))
def test_biases_take_rounded_moments_back(key):
    """Toeplitz matrices of all but a few in 10000 rounded moments are positive definite once biased, and not before."""
    storage, count = key
    before, after = [], []
    for n in (1, 2, 3):
        moments = trigonometric_moments(points(n, (4000,), seed=n), count=count)
        shares = normalised_moments(stored_moments(moments, storage, power=False), storage, power=False)[1]
        b = np.concatenate([np.ones((1, 4000)), shares[0::2] + 1j * shares[1::2]])
        index = np.subtract.outer(np.arange(count + 1), np.arange(count + 1))
        toeplitz = np.where((index >= 0)[..., None], b[np.abs(index)], np.conj(b[np.abs(index)]))
        least = np.linalg.eigvalsh(np.moveaxis(toeplitz, -1, 0)).min(axis=1)
        weight = TRIGONOMETRIC_WEIGHTS[key]
        before.append(least)
        after.append((1 - weight) * least + weight)
    assert (np.concatenate(before) < 0.0).mean() > 0.1
    assert (np.concatenate(after) <= 0.0).mean() < 1e-3


def test_rays_are_the_other_axes():
    absorbers = slabs(6, (3, 4))
    encoded = trigonometric_moments(absorbers, count=3)
    assert encoded.shape == (7, 3, 4)
    d = np.random.default_rng(1).random((5, 3, 1))
    got = transmittance(encoded, d)
    assert got.shape == (5, 3, 4)
    ends = transmittance(encoded, np.array([-0.5, 0.0, 1.0, 1.5]).reshape(4, 1, 1))
    assert np.array_equal(ends[0], ends[1])
    assert np.array_equal(ends[2], ends[3])
    one = Absorbers(*(row[:, 1, 2] for row in absorbers))
    np.testing.assert_allclose(got[:, 1, 2], transmittance(trigonometric_moments(one, count=3), d[:, 1, 0]), rtol=1e-9)


def test_bad_input_is_named():
    layer = points(1)
    with pytest.raises(InputError, match="count: is 0"):
        trigonometric_moments(layer, count=0)
    with pytest.raises(InputError, match="wrapping: is 7"):
        trigonometric_moments(layer, wrapping=7.0)
    with pytest.raises(InputError, match="bias: is not known for 5 moments"):
        transmittance(trigonometric_moments(layer, count=5), np.zeros(1))
