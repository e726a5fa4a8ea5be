"""Power moments: sums in rational numbers, bounds from their definition in many digits, and what rounding may do."""

from __future__ import annotations

import warnings
from fractions import Fraction

import mpmath
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from reference_volumetric import stretches_of

from froxel_ref.absorbers import Absorbers, as_points
from froxel_ref.deep_shadow import direct_depth
from froxel_ref.moment_storage import BIASES, Bias, normalised_moments, stored_moments
from froxel_ref.power_moments import power_moments, transmittance, warped
from froxel_ref.records import InputError

EPS = float(np.finfo(np.float64).eps)
UNIT = st.floats(0, 1)
COUNTS = pytest.mark.parametrize("count", [4, 6, 8])


def points(n, rays=(), seed=0):
    rng = np.random.default_rng(seed)
    return as_points(rng.random((n, *rays)), rng.exponential(1.0, (n, *rays)))


def slabs(n, rays=(), seed=0):
    rng = np.random.default_rng(seed)
    start, stop = np.sort(rng.random((2, n, *rays)), axis=0)
    tau = rng.exponential(1.0, (n, *rays))
    return Absorbers(start, stop, tau, 2 * tau * rng.uniform(-1, 1, tau.shape))


# --- moments ----------------------------------------------------------------------------------------


def exact_moments(stretches, count):
    """∫σ(2x − 1)^k dx by the antiderivative, in rational numbers."""
    result = []
    for k in range(count + 1):
        total = Fraction(0)
        for start, stop, tau, rise in stretches:
            a, b, t, r = (Fraction(v) for v in (start, stop, tau, rise))
            a, b = 2 * a - 1, 2 * b - 1
            if a == b:
                total += t * a**k
                continue
            slope = r / (b - a) ** 2
            low = t / (b - a) - slope * (b - a) / 2
            for power, factor in ((k, low - slope * a), (k + 1, slope)):
                total += factor * (b ** (power + 1) - a ** (power + 1)) / (power + 1)
        result.append(total)
    return result


@settings(max_examples=60)
@given(st.lists(st.tuples(UNIT, UNIT, st.floats(1e-6, 30), st.floats(-2, 2)), min_size=1, max_size=5),
       st.sampled_from([2, 4, 6, 8]), st.floats(1e-9, 1))
def test_moments_are_exact(drawn, count, shrink):
    rows = []
    for a, b, tau, share in drawn:
        start = min(a, b)
        rows.append((start, start + abs(b - a) * shrink, tau, share * tau if a != b else 0.0))
    absorbers = Absorbers(*(np.array(column) for column in zip(*rows, strict=True)))
    got = power_moments(absorbers, count=count)
    assert got.shape == (count + 1,)
    bound = (2 * count + 40) * EPS * float(absorbers.tau.sum())
    for value, want in zip(got, exact_moments(stretches_of(absorbers), count), strict=True):
        assert abs(float(value) - float(want)) <= bound


def test_warped_moments_converge():
    """A stretch under a logarithm of ratio 100: as many short ones, which a rule can hardly get wrong."""
    ends = np.linspace(0.1, 0.9, 2001)
    middles = 0.5 * (ends[:-1] + ends[1:])
    short = Absorbers(ends[:-1], ends[1:], (3.0 + 2.0 * (middles - 0.5) / 0.8) / 2000, np.full(2000, 2.0 / 2000**2))
    whole = Absorbers(*(np.array([v]) for v in (0.1, 0.9, 3.0, 2.0)))
    for count in (4, 8):  # of the short ones, 1/2000 long: below 1e-12
        error = power_moments(whole, count=count, ratio=100.0) - power_moments(short, count=count, ratio=100.0)
        assert np.abs(error).max() < 1e-9
    np.testing.assert_allclose(warped(np.array([0.0, 1.0]), 7.0), [0.0, 1.0])
    assert warped(np.array([0.5]), 1.0)[0] == 0.5


# --- bounds -----------------------------------------------------------------------------------------


def bounds_by_definition(moments, z, digits=60):
    """Mass before z and at z of the distribution with these moments that has a point at z: Hankel, roots, weights."""
    with mpmath.workdps(digits):
        m = [mpmath.mpf(float(v)) for v in moments]
        size = len(m) // 2 + 1
        hankel = mpmath.matrix(size, size)
        for i in range(size):
            for j in range(size):
                hankel[i, j] = m[i + j]
        x = mpmath.mpf(float(z))
        kernel = mpmath.lu_solve(hankel, mpmath.matrix([x**i for i in range(size)]))
        with warnings.catch_warnings():  # newer versions want to be told the order, which older ones do not know
            warnings.simplefilter("ignore", DeprecationWarning)
            others = mpmath.polyroots([kernel[i] for i in reversed(range(size))], maxsteps=500, extraprec=400)
        nodes = [x, *(mpmath.re(r) for r in others)]
        powers = mpmath.matrix(size, size)
        for i in range(size):
            for j, node in enumerate(nodes):
                powers[i, j] = node**i
        held = mpmath.lu_solve(powers, mpmath.matrix(m[:size]))
        return sum(w for w, node in zip(held, nodes, strict=True) if node < x), held[0]


@COUNTS
@pytest.mark.parametrize("make", [points, slabs])
def test_the_mixture_is_that_of_the_definition(count, make):
    rng = np.random.default_rng(count)
    vector = BIASES["float32", count].moments
    for seed, n in enumerate((1, 2, 3, 5, 20)):
        encoded = power_moments(make(n, seed=seed), count=count)
        bias = Bias(1e-3, vector)
        shares = np.array([1.0, *(encoded[1:] / encoded[0])])
        biased = shares + bias.weight * (np.array([1.0, *vector]) - shares)
        for d in rng.random(4):
            low, here = bounds_by_definition(biased, 2 * d - 1)
            for beta in (0.0, 0.25, 1.0):
                got = transmittance(encoded, np.array([d]), bias=bias, overestimation=beta)[0]
                assert abs(got - float(mpmath.exp(-encoded[0] * (low + beta * here)))) < 1e-9


@COUNTS
@pytest.mark.parametrize("make", [points, slabs])
def test_bounds_hold_the_truth(count, make):
    """Up to the bias, which moves a share of the optical depth that is its weight."""
    d = np.linspace(0, 1, 201)[:, None]
    for n in (1, 3, 10):
        absorbers = make(n, (50,), seed=n)
        encoded = power_moments(absorbers, count=count)
        bias = Bias(1e-9, BIASES["float32", count].moments)
        upper, lower = (transmittance(encoded, d, bias=bias, overestimation=b) for b in (0.0, 1.0))
        exact = np.exp(-direct_depth(absorbers, d))
        assert (exact <= upper + 1e-7).all()
        assert (exact >= lower - 1e-7).all()


@COUNTS
def test_few_points_come_back_exactly(count):
    """As many points as half the moments are the only distribution that has them."""
    for n in range(1, count // 2 + 1):
        layers = as_points(np.linspace(0.1, 0.8, n), np.linspace(0.5, 1.5, n))
        d = np.linspace(0, 1, 401)
        away = np.abs(d[:, None] - layers.start).min(axis=1) > 0.03
        bias = Bias(1e-10, BIASES["float32", count].moments)
        got = transmittance(power_moments(layers, count=count), d[away], bias=bias)
        np.testing.assert_allclose(got, np.exp(-direct_depth(layers, d[away])), atol=2e-5)


def test_more_moments_are_nearer():
    d = np.linspace(0, 1, 201)[:, None]
    absorbers = slabs(10, (100,), seed=3)
    exact = np.exp(-direct_depth(absorbers, d))
    errors = [np.abs(transmittance(power_moments(absorbers, count=c), d) - exact).mean() for c in (4, 6, 8)]
    assert errors[2] < errors[1] < errors[0] < 0.06


def test_a_warp_resolves_what_is_near():
    layer = as_points(np.array([0.01, 0.02]), np.array([1.0, 1.0]))
    d = np.array([0.014])
    plain, warp = (transmittance(power_moments(layer, ratio=r), d, storage="float32", ratio=r)[0] for r in (1.0, 100.0))
    assert abs(warp - np.exp(-1.0)) < 0.01 < abs(plain - np.exp(-1.0))


# --- whatever rounding did --------------------------------------------------------------------------


def assert_sound(passed, rounding=1e-9):
    assert np.isfinite(passed).all()
    assert passed.min() >= 0.0
    assert passed.max() <= 1.0
    assert np.diff(passed, axis=0).max() <= rounding


@COUNTS
@pytest.mark.parametrize("storage", [None, "float32", "float16", "unorm16"])
def test_never_brightens_in_any_storage(count, storage):
    d = np.linspace(-0.1, 1.1, 301)[:, None]
    for n in (1, 2, 4, 30):
        for absorbers in (points(n, (60,), seed=n), slabs(n, (60,), seed=n)):
            encoded = stored_moments(power_moments(absorbers, count=count), storage)
            assert_sound(transmittance(encoded, d, storage=storage))


@COUNTS
def test_impossible_moments_stay_in_bounds(count):
    rng = np.random.default_rng(1)
    noise = rng.uniform(-1, 1, (count + 1, 400))
    noise[0] = 3.0 * rng.random(400)
    assert_sound(transmittance(noise, np.linspace(0, 1, 301)[:, None]), rounding=1.0)


@COUNTS
@pytest.mark.parametrize("storage", [None, "float32", "float16", "unorm16"])
@pytest.mark.parametrize("tau", [0.0, 1e-300, 1e-12, 1.0, 1e8])
def test_single_points_of_any_depth(count, storage, tau):
    where = np.array([[0.0, 0.3, 0.5, 1.0]])
    encoded = stored_moments(power_moments(as_points(where, np.full((1, 4), tau)), count=count), storage)
    d = np.linspace(0, 1, 101)[:, None]
    passed = transmittance(encoded, d, storage=storage)
    assert_sound(passed)
    if tau < 1e-6:
        assert passed.min() >= 1.0 - 2e-6
    elif storage != "float16":  # whose bias is larger than 1/100
        np.testing.assert_allclose(passed[45, 2], 1.0 if tau == 1.0 else passed[45, 2], atol=1e-2)
        assert passed[55, 2] <= np.exp(-0.97 * tau)


@pytest.mark.parametrize("storage", [None, "float32", "float16", "unorm16"])
def test_float32_stays(storage):
    absorbers = slabs(5, (20,))
    narrow = power_moments(Absorbers(*(row.astype(np.float32) for row in absorbers)))
    assert narrow.dtype == np.float32
    assert power_moments(Absorbers(*(row.astype(np.float32) for row in absorbers)), ratio=9.0).dtype == np.float32
    encoded = stored_moments(narrow, storage)
    assert encoded.dtype == np.float32
    d = np.linspace(0, 1, 33)[:, None]
    got = transmittance(encoded, d.astype(np.float32), storage=storage)
    assert got.dtype == np.float32
    wide = transmittance(stored_moments(power_moments(absorbers), storage), d, storage=storage)
    np.testing.assert_allclose(got, wide, atol=0.05)  # one step of storage may turn; float16's are coarse
    assert np.abs(got - wide).mean() < 1e-3


def test_rays_are_the_other_axes():
    absorbers = slabs(6, (3, 4))
    encoded = power_moments(absorbers, count=6)
    assert encoded.shape == (7, 3, 4)
    d = np.random.default_rng(1).random((5, 3, 1))
    got = transmittance(encoded, d)
    assert got.shape == (5, 3, 4)
    ends = transmittance(encoded, np.array([-0.5, 0.0, 1.0, 1.5]).reshape(4, 1, 1))
    assert np.array_equal(ends[0], ends[1])
    assert np.array_equal(ends[2], ends[3])
    one = Absorbers(*(row[:, 1, 2] for row in absorbers))
    np.testing.assert_allclose(got[:, 1, 2], transmittance(power_moments(one, count=6), d[:, 1, 0]), rtol=1e-9)


# --- storage ----------------------------------------------------------------------------------------


@COUNTS
def test_unorm16_spans_its_range(count):
    """Every number of the mixture is made to reach 0 and 1 over the depths, and to leave [0, 1] nowhere."""
    d = np.linspace(0, 1, 4001)[None]
    codes = stored_moments(power_moments(as_points(d, np.ones_like(d)), count=count), "unorm16")[1:]
    assert (codes.min(axis=1) <= 2e-5).all()
    assert (codes.max(axis=1) >= 1 - 2e-5).all()
    clear = (codes > 0) & (codes < 1)
    assert clear.mean() > 0.99  # nothing was cut


@COUNTS
@pytest.mark.parametrize(("storage", "bound"), [("float32", 2e-7), ("float16", 2e-3), ("unorm16", 7e-5)])
def test_storage_keeps_moments_to_its_rounding(count, storage, bound):
    absorbers = points(3, (500,))
    moments = power_moments(absorbers, count=count)
    whole, shares = normalised_moments(stored_moments(moments, storage), storage)
    np.testing.assert_allclose(whole, moments[0], rtol=1e-3 if storage == "float16" else 6e-8)
    error = np.abs(shares - moments[1:] / moments[0]).max()
    assert 0.0 < error < bound


@pytest.mark.parametrize("key", sorted(BIASES))
def test_biases_take_rounded_moments_back(key):
    """Hankel matrices of all but a few in 10000 rounded moments are positive definite once biased, and not before."""
    storage, count = key
    bias = BIASES[key]
    size = count // 2 + 1
    index = np.add.outer(np.arange(size), np.arange(size))
    assert np.linalg.eigvalsh(np.array([1.0, *bias.moments])[index]).min() > 1e-5
    least = []
    for n in (1, 2, 3):
        moments = stored_moments(power_moments(points(n, (4000,), seed=n), count=count), storage)
        shares = normalised_moments(moments, storage)[1]
        for weight in (0.0, bias.weight):
            mixed = shares + weight * (np.array(bias.moments)[:, None] - shares)
            hankel = np.concatenate([np.ones((1, 4000)), mixed])[index]
            least.append(np.linalg.eigvalsh(np.moveaxis(hankel, -1, 0)).min(axis=1))
    before, after = np.concatenate(least[0::2]), np.concatenate(least[1::2])
    assert (before < 0.0).mean() > 0.1
    assert (after <= 0.0).mean() < 1e-3


def test_float16_sums_too_large_keep_their_ratios():
    moments = power_moments(as_points(np.array([0.75]), np.array([1e6])))
    whole, shares = normalised_moments(stored_moments(moments, "float16"), "float16")
    assert whole == 65504.0
    np.testing.assert_allclose(shares, 0.5 ** np.arange(1, 5), rtol=1e-3)


def test_bad_input_is_named():
    layer = points(1)
    for count in (0, 3):
        with pytest.raises(InputError, match=f"count: is {count}, must be even"):
            power_moments(layer, count=count)
    with pytest.raises(InputError, match="ratio: is 0"):
        power_moments(layer, ratio=0.5)
    with pytest.raises(InputError, match="storage: is 'half'"):
        stored_moments(power_moments(layer), "half")
    with pytest.raises(InputError, match="moments: are 2, must be 4, 6 or 8"):
        stored_moments(power_moments(layer, count=2), "unorm16")
    with pytest.raises(InputError, match="bias: is not known for 10 moments"):
        transmittance(power_moments(layer, count=10), np.zeros(1))
    with pytest.raises(InputError, match="storage: is 'half'"):
        transmittance(power_moments(layer), np.zeros(1), storage="half")
