"""Taps with blue noise and the biquadratic fetch, against their definitions and what they promise."""

from __future__ import annotations

import itertools
import math
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from froxel_ref import blocks
from froxel_ref.apply import lookup_fog
from froxel_ref.blue_noise import blue_noise
from froxel_ref.fog_lookups import ALONG_Z, fetch_biquadratic, noisy_lookup, tap_offsets
from froxel_ref.grid import slice_to_depth
from froxel_ref.integrate import Integrated, integrate
from froxel_ref.records import InputError
from froxel_ref.sampling import fetch_trilinear
from froxel_ref.settings import Grid
from froxel_ref.storage import store
from froxel_ref.tonemap import FLOAT16_LARGEST_LUMA, luma, tone_map

EPS = 2.0**-52
VOLUME = np.random.default_rng(3).random((5, 4, 6))
NOISE = blue_noise()
STILL = np.zeros((1, 3, 1, 1))
FETCHES = {"linear": fetch_trilinear, "quadratic": fetch_biquadratic}

addresses = st.sampled_from(["clamp", "wrap"])
coordinates = st.floats(-20.0, 20.0)
small_textures = hnp.arrays(np.float64, hnp.array_shapes(min_dims=3, max_dims=3, max_side=4),
                            elements=st.floats(-100.0, 100.0))


def image(height: int, width: int, grid: tuple[int, int, int], seed: int = 1):
    """Coordinates as `apply` has them: columns, rows, and a depth for each pixel."""
    depth, rows, columns = grid
    x, y = (np.arange(width) + 0.5) * columns / width, ((np.arange(height) + 0.5) * rows / height)[:, None]
    return x, y, np.random.default_rng(seed).uniform(0.0, depth + 2.0, (height, width))


def offsets_of(height: int, width: int, **options):
    return tap_offsets(np.arange(height).reshape(-1, 1), np.arange(width), 5, **options)


# --- offsets ----------------------------------------------------------------------------------------


def test_offsets_by_hand():
    """n = (−1.5, −0.75, 0.75, 1.5): noise 0, ¼, ¾, 1."""
    noise = np.array([0.0, 0.25, 0.75, 1.0]).reshape(4, 1, 1, 1)
    got = tap_offsets(np.array([7]), np.array([9]), 3, noise=noise)
    assert got.shape == (4, 3, 1)
    assert got[..., 0].tolist() == [[-1.5, -0.75, 0.375], [-0.75, 0.75, 0.75], [0.75, 1.5, -0.75], [1.5, -1.5, -0.375]]


@pytest.mark.parametrize(("taps", "reach", "share"), [(4, 1.5, 0.5), (1, 1.0, 1.0), (3, 0.5, 0.25)])
def test_offsets_are_the_scalar_loop(taps, reach, share):
    frame, rows, columns = 66, [0, 5, 64, 71], [63, 64, 2]
    got = tap_offsets(np.array(rows).reshape(-1, 1), np.array(columns), frame, taps=taps, reach=reach,
                      depth_share=share)
    assert got.shape == (taps, 3, 4, 3)
    for tap, (j, row), (i, column) in itertools.product(range(taps), enumerate(rows), enumerate(columns)):
        at = [(2.0 * NOISE[component % 4, frame % 64, row % 64, column % 64] - 1.0) * reach
              for component in (tap, tap + 1, tap + 2)]
        assert got[tap, :, j, i].tolist() == [at[0], at[1], share * at[2]]


def test_offsets_reach_to_a_texel_and_a_half_and_average_to_nothing():
    """Of 256 steps of 3/256 texels the outer ones are half a step within; over a tile the mean is 0, exactly."""
    got = offsets_of(64, 64)
    largest = 1.5 * 255 / 256
    assert np.abs(got).max(axis=(0, 2, 3)).tolist() == [largest, largest, largest / 2]
    assert np.array_equal(got.mean(axis=(2, 3)), np.zeros((4, 3)))


def test_the_mean_of_the_taps_lies_on_a_diagonal():
    mean = offsets_of(9, 70).mean(axis=0)
    assert mean[0] == pytest.approx(mean[1], abs=2 * EPS)
    assert 2 * mean[2] == pytest.approx(mean[0], abs=2 * EPS)
    assert np.abs(mean).max() > 0.5


def test_offsets_are_exact_in_float32():
    small = offsets_of(8, 8, dtype=np.float32)
    assert small.dtype == np.float32
    assert np.array_equal(small, offsets_of(8, 8))


def test_other_noise_is_left_alone():
    noise = np.random.default_rng(2).random((3, 2, 4, 4))
    before = noise.copy()
    got = tap_offsets(0, 0, 0, noise=noise, taps=3)
    assert got.shape == (3, 3)
    assert np.array_equal(noise, before)


# --- the mean of the taps ---------------------------------------------------------------------------


def slow_taps(texture, x, y, z, offsets, bias, nearest):
    """Tent weights over all texels, one channel, one pixel."""
    values = []
    for dx, dy, dz in offsets:
        places = [x + dx, y + dy, max(z - bias + dz, nearest)]
        tents = []
        for place, count in zip(places, texture.shape[::-1], strict=True):
            centre = min(max(place - 0.5, 0.0), count - 1.0)
            tents.append([max(0.0, 1.0 - abs(centre - i)) for i in range(count)])
        values.append(math.fsum(tents[2][k] * tents[1][j] * tents[0][i] * float(texture[k, j, i])
                                for k, j, i in np.ndindex(texture.shape)))
    return math.fsum(values) / len(values)


@pytest.mark.parametrize(("taps", "bias", "nearest"), [(4, 1.5, None), (3, 0.0, None), (4, 0.25, 2.5), (1, 1.5, 1.5)])
def test_mean_is_the_scalar_loop(taps, bias, nearest):
    """Four taps of eight texels in [0, 1]; coordinates up to 8 are off by an ulp or two, 3·2⁻⁵² each."""
    x, y, z = image(6, 8, VOLUME.shape)
    offsets = offsets_of(6, 8, taps=taps)
    got = noisy_lookup(VOLUME, x, y, z, offsets, bias=bias, nearest=nearest)
    for j, i in np.ndindex(6, 8):
        exact = slow_taps(VOLUME, x[i], y[j, 0], z[j, i], offsets[:, :, j, i].tolist(), bias,
                          -np.inf if nearest is None else nearest)
        assert got[j, i] == pytest.approx(exact, abs=32 * EPS)


def test_published_defaults():
    """Bias 1.5 slices; trilinear; nothing undone."""
    x, y, z = image(6, 8, VOLUME.shape)
    assert np.array_equal(noisy_lookup(VOLUME, x, y, z, STILL), fetch_trilinear(VOLUME, x, y, z - 1.5))


def test_noise_of_a_linear_field_is_the_mean_offset():
    """a + 0.02x − 0.05y + 0.01z: the field at the place, plus (0.02 − 0.05 + ½·0.01) times the mean component.

    Over a tile that adds up to nothing, and its variance is (…)²·reach²/3·(1 − 2⁻¹⁶)/4 for independent components;
    4096 pixels of blue noise know it within √(2/2788) = 2.7 %, correlation of components included.
    """
    k, j, i = np.meshgrid(*(np.arange(n) + 0.5 for n in (12, 20, 20)), indexing="ij")
    texture = 0.3 + 0.02 * i - 0.05 * j + 0.01 * k
    x, y = 5.0 + np.arange(64) / 8, (5.0 + np.arange(64) / 8)[:, None]
    z = np.random.default_rng(4).uniform(4.0, 9.0, (64, 64))
    got = noisy_lookup(texture, x, y, z, offsets_of(64, 64))
    noise = (2 * NOISE[:, 5] - 1).mean(axis=0) * 1.5
    clean = 0.3 + 0.02 * x - 0.05 * y + 0.01 * (z - 1.5)
    assert got == pytest.approx(clean - 0.025 * noise, abs=16 * EPS)
    assert abs((got - clean).mean()) < 4 * EPS
    assert (got - clean).var() == pytest.approx(0.025**2 * 1.5**2 / 12, rel=4 * 0.027)


def test_a_gradient_across_the_diagonal_has_no_noise():
    i, j = np.meshgrid(np.arange(20) + 0.5, np.arange(20) + 0.5)
    x, y = 5.0 + np.arange(64) / 8, (5.0 + np.arange(64) / 8)[:, None]
    got = noisy_lookup((i - j)[None], x, y, 0.5, offsets_of(64, 64))
    assert got == pytest.approx(x - y, abs=64 * EPS)


def test_frames_average_to_the_clean_lookup():
    """The 64 frames of a pixel are independent: the mean offset is within 5·√(¾/256) = 0.27 texels of 0, and at
    independent pixels of the same frame it differs."""
    i = np.arange(20) + 0.5
    frames = np.array([noisy_lookup(i[None, None], np.full((3, 3), 10.0), 0.5, 0.5, tap_offsets(
        np.arange(3).reshape(-1, 1), np.arange(3), frame)) for frame in range(64)])
    assert np.abs(frames.mean(axis=0) - 10.0).max() < 0.27
    assert frames.std(axis=0).min() > 0.2  # √(¾/4) = 0.43


@pytest.mark.parametrize("tap", [1, 2, 3, 4, 7])
@given(value=st.floats(0.0, 1e30), seed=st.integers(0, 99))
def test_constant_stays_that_constant(tap, value, seed):
    offsets = np.random.default_rng(seed).uniform(-2, 2, (tap, 3, 2))
    assert np.array_equal(noisy_lookup(np.full((3, 2, 4), value), 1.1, 1.2, 0.3, offsets), [value] * 2)


@given(small_textures, coordinates, coordinates, coordinates, st.integers(0, 99), st.sampled_from([*FETCHES]))
def test_never_leaves_the_hull(texture, x, y, z, seed, fetch):
    offsets = np.random.default_rng(seed).uniform(-2, 2, (4, 3))
    got = noisy_lookup(texture, x, y, z, offsets, fetch=FETCHES[fetch])
    assert texture.min() <= got <= texture.max()


def test_nearest_keeps_taps_behind_it():
    """A first texel of 1 that nobody is to see, then 0: with nearest at the second one's centre, nothing of it."""
    column = np.array([1.0, 0.0, 0.0, 0.0]).reshape(4, 1, 1)
    z = np.linspace(0.0, 4.0, 50)
    offsets = tap_offsets(np.zeros(50, int), np.arange(50), 0)
    assert not noisy_lookup(column, 0.5, 0.5, z, offsets, nearest=1.5).any()
    assert noisy_lookup(column, 0.5, 0.5, z, offsets)[:30].all()


# --- tone-mapped ------------------------------------------------------------------------------------


def test_tone_mapped_mean_by_hand():
    """Grey of luma 1 and 3 is stored as ½ and ¾; their mean ⅝ is the luma 5/3, not 2."""
    texture = tone_map(np.array([1.0, 3.0]).reshape(1, 1, 1, 2) * np.ones((3, 1, 1, 1)))
    offsets = np.array([[-1.0, 0.0, 0.0], [1.0, 0.0, 0.0]])
    got = noisy_lookup(texture, np.array(1.0), 0.5, 0.5, offsets, tone_mapped=True)
    assert got == pytest.approx(5 / 3, rel=4 * EPS)


@pytest.mark.parametrize("fetch", FETCHES)
def test_tone_mapped_mean_is_the_scalar_loop(fetch):
    """Relative errors grow by 1/(1 − luma), at most 1 + 14 here, of some 16 roundings."""
    light = np.random.default_rng(5).random((3, 5, 4, 6)) * 14
    stored = tone_map(light)
    x, y, z = image(5, 7, (5, 4, 6))
    offsets = offsets_of(5, 7)
    got = noisy_lookup(stored, x, y, z, offsets, bias=0.5, tone_mapped=True, fetch=FETCHES[fetch])
    weights = {"linear": hat, "quadratic": spline}[fetch]
    for j, i in np.ndindex(5, 7):
        total = [0.0, 0.0, 0.0]
        for dx, dy, dz in offsets[:, :, j, i].tolist():
            along = [weights(x[i] + dx, 6, "clamp"), weights(y[j, 0] + dy, 4, "clamp"),
                     hat(z[j, i] - 0.5 + dz, 5, "clamp")]
            for c in range(3):
                total[c] += 0.25 * math.fsum(
                    along[2][k] * along[1][v] * along[0][u] * light[c, k, v, u]
                    / (1 + 0.2126 * light[0, k, v, u] + 0.7152 * light[1, k, v, u] + 0.0722 * light[2, k, v, u])
                    for k in along[2] for v in along[1] for u in along[0])
        rest = 1 - 0.2126 * total[0] - 0.7152 * total[1] - 0.0722 * total[2]
        assert got[:, j, i] == pytest.approx([value / rest for value in total], rel=15 * 32 * EPS)


def test_bright_flecks_count_less():
    """Concave in luma: never more than the mean of the light; what is the same everywhere comes back."""
    light = np.random.default_rng(6).lognormal(0.0, 2.0, (1, 5, 4, 6)) * np.ones((3, 1, 1, 1))
    x, y, z = image(5, 7, (5, 4, 6))
    offsets = offsets_of(5, 7)
    got = luma(noisy_lookup(tone_map(light), x, y, z, offsets, tone_mapped=True))
    plain = luma(noisy_lookup(light, x, y, z, offsets))
    assert (got < plain).all()
    even = noisy_lookup(tone_map(np.full((3, 5, 4, 6), 7.0)), x, y, z, offsets, tone_mapped=True)
    assert even == pytest.approx(7.0, rel=8 * 8 * EPS)


def test_what_float16_holds_stays_finite():
    """D9: luma 1e5 is stored as 1; its inverse is that of the bound, 2048, or 2⁵³ in float64, or infinite."""
    stored = store(tone_map(np.full((3, 1, 1, 1), 1e5)), "float16")
    assert (stored == 1.0).all()
    for largest, wanted in ((FLOAT16_LARGEST_LUMA, 2048.0), (None, 2.0**53), (1.0, np.inf)):
        got = noisy_lookup(stored, 0.5, 0.5, 0.5, np.zeros((4, 3)), tone_mapped=True, largest_luma=largest)
        assert got.tolist() == [wanted] * 3


# --- what the bias costs ----------------------------------------------------------------------------


def uniform_fog(count: int, far: float = 9.0) -> tuple[Grid, Integrated, np.ndarray]:
    """Extinction 0.4/m from 1 m on, and the texture that the boundary lookup reads."""
    grid = Grid(width=1, height=1, depth=count, near=1.0, far=far, distribution="linear")
    boundaries = slice_to_depth(np.arange(count + 1), grid).reshape(-1, 1, 1)
    fog = integrate(np.ones((3, 1, 1, 1)), np.full((1, 1, 1), 0.4), np.diff(boundaries, axis=0), np.ones((1, 1)),
                    near=1.0)
    column = np.concatenate([np.ones((1, 1, 1)), fog.front_transmittance[None], fog.transmittance])
    return grid, fog, column


@pytest.mark.parametrize(("bias", "order"), [(0.0, 2.0), (1.5, 1.0)])
def test_order_of_the_bias(bias, order):
    """Errors of T(z) = e^(−0.4z) with four taps, by the slices' number; bias 1.5 leaves out 1.5 slices of fog."""
    counts, depth = np.array([64, 128, 256, 512]), np.linspace(3.0, 7.0, 1001)
    errors, signed = [], []
    for count in counts:
        column = uniform_fog(count)[2]
        z = (depth - 1.0) * count / 8.0 + 1.5
        offsets = np.array([-0.5, 0.25, 0.75, -0.5])[:, None, None] * np.array([[0.0], [0.0], [1.0]])
        error = noisy_lookup(column, 0.5, 0.5, z, offsets, bias=bias) / np.exp(-0.4 * depth) - 1.0
        errors.append(np.abs(error).max())
        signed.append(error.mean())
    assert -np.polyfit(np.log(counts), np.log(errors), 1)[0] == pytest.approx(order, abs=0.1)
    if bias:
        assert signed[-1] == pytest.approx(math.expm1(0.4 * 1.5 * 8 / 512), rel=0.01)


def test_published_bias_amounts_to_one_slice():
    """D4: what is stored at the slices' centres is looked up half a slice too deep; less 1.5, it is one too near."""
    grid, fog, column = uniform_fog(32)
    depth = np.linspace(3.0, 9.0, 100)
    s = (depth - 1.0) * 4.0
    centre = np.concatenate([column[:1], fog.transmittance])
    published = noisy_lookup(centre, 0.5, 0.5, s + 1.0, STILL[..., 0])
    corrected = noisy_lookup(column, 0.5, 0.5, s + 1.5, STILL[..., 0], bias=1.0)
    exact = lookup_fog(fog, grid, (depth - 0.25)[None])[1][0]
    assert published == pytest.approx(exact, rel=64 * EPS)
    assert corrected == pytest.approx(exact, rel=64 * EPS)


# --- the biquadratic fetch --------------------------------------------------------------------------


def folded(weights: dict[int, float], count: int, address: str) -> dict[int, float]:
    result: dict[int, float] = {}
    for i, weight in weights.items():
        texel = i % count if address == "wrap" else min(max(i, 0), count - 1)
        result[texel] = result.get(texel, 0) + weight
    return result


def hat(x: float, count: int, address: str) -> dict[int, float]:
    first = math.floor(x - 0.5)
    share = x - 0.5 - first
    return folded({first: 1 - share, first + 1: share}, count, address)


def spline(x, count: int, address: str) -> dict[int, float]:
    """The centred quadratic B-spline, piece by piece: ¾ − t² for |t| ≤ ½, ½(3/2 − |t|)² for |t| ≤ 3/2."""
    middle = math.floor(x)
    weights = {}
    for i in range(middle - 2, middle + 3):
        t = abs(x - i - Fraction(1, 2)) if isinstance(x, Fraction) else abs(x - i - 0.5)
        if 2 * t <= 1:
            weights[i] = (3 - 4 * t * t) / 4
        elif 2 * t < 3:
            weights[i] = (3 - 2 * t)**2 / 8
    return folded(weights, count, address)


@pytest.mark.parametrize(("x", "clamp", "wrap"), [
    (0.5, 1.0 + 6.0 + 2.0, 4.0 + 6.0 + 2.0), (1.5, 1.0 + 12.0 + 4.0, 17.0), (1.0, 12.0, 12.0),
    (2.0, 24.0, 24.0), (3.0, 32.0, 20.0), (0.0, 8.0, 20.0), (-7.0, 8.0, None), (99.0, 32.0, None)])
def test_ramp_by_hand(x, clamp, wrap):
    """8, 16, 32: at a centre ⅛, ¾, ⅛; where two texels meet, ½ and ½."""
    ramp = np.array([8.0, 16.0, 32.0]).reshape(1, 1, 3)
    assert fetch_biquadratic(ramp, x, 0.5, 0.5) == clamp
    if wrap is not None:
        assert fetch_biquadratic(ramp, x, 0.5, 0.5, address="wrap") == wrap


@given(small_textures, coordinates, coordinates, coordinates, addresses, st.sampled_from(ALONG_Z))
def test_equals_the_sum_of_splines(texture, x, y, z, address, along_z):
    """Against rational arithmetic. A blend rounds thrice and its weight once, as for the trilinear fetch (12 u·M, M the
    largest texel) for each of two levels; halved coordinates up to 21 are off by 2⁻⁴⁹ = 16 u each, times a slope of at
    most 2 M per axis and level."""
    got = float(fetch_biquadratic(texture, x, y, z, address=address, along_z=along_z))
    nz, ny, nx = texture.shape
    along = [spline(Fraction(x), nx, address), spline(Fraction(y), ny, address),
             (spline if along_z == "quadratic" else hat_exactly)(Fraction(z), nz, address)]
    exact = sum(along[2][k] * along[1][j] * along[0][i] * Fraction(texture[k, j, i])
                for k in along[2] for j in along[1] for i in along[0])
    assert abs(got - exact) <= (24 + 3 * 32) * EPS / 2 * np.abs(texture).max()


def hat_exactly(x: Fraction, count: int, address: str) -> dict[int, Fraction]:
    middle = math.floor(x)
    return folded({i: max(Fraction(0), 1 - abs(x - i - Fraction(1, 2))) for i in range(middle - 1, middle + 2)}, count,
                  address)


@given(st.floats(-1e30, 1e30), st.floats(allow_nan=False, allow_infinity=False), addresses, st.sampled_from(ALONG_Z))
def test_weights_add_up_to_one(value, x, address, along_z):
    """A partition of unity, to the last bit, wherever one looks."""
    texture = np.full((3, 2, 5), value)
    assert fetch_biquadratic(texture, x, -x, x, address=address, along_z=along_z) == value


@given(small_textures, coordinates, coordinates, coordinates, addresses, st.sampled_from(ALONG_Z))
def test_biquadratic_never_leaves_the_hull(texture, x, y, z, address, along_z):
    got = fetch_biquadratic(texture, x, y, z, address=address, along_z=along_z)
    assert texture.min() <= got <= texture.max()


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_linear_fields_come_back_away_from_the_edges(dtype):
    """From one texel within on; the roundings are those of the test against rational arithmetic."""
    k, j, i = np.meshgrid(*(np.arange(n) + 0.5 for n in (6, 7, 8)), indexing="ij")
    texture = (2.0 + 3.0 * i - 1.0 * j + 0.5 * k).astype(dtype)
    rng = np.random.default_rng(1)
    x, y, z = ((1.0 + rng.random(1000) * (n - 2)).astype(dtype) for n in (8, 7, 6))
    exact = 2.0 + 3.0 * x.astype(float) - y.astype(float) + 0.5 * z.astype(float)
    for along_z in ALONG_Z:
        got = fetch_biquadratic(texture, x, y, z, along_z=along_z)
        assert got.dtype == dtype
        assert np.abs(got - exact).max() <= 12 * np.finfo(dtype).eps * np.abs(texture).max()
    assert abs(fetch_biquadratic(texture, dtype(0.75), dtype(3.0), dtype(3.0)) - (2.0 + 2.25 - 3 + 1.5)) > 0.05


def test_quadratic_fields_come_back_with_a_quarter_more():
    """Second moment x² + ¼ of the weights: a + ¼ for each axis that is smoothed, everywhere alike."""
    k, j, i = np.meshgrid(*(np.arange(n) + 0.5 for n in (6, 7, 8)), indexing="ij")
    rng = np.random.default_rng(1)
    x, y, z = (1.0 + rng.random(1000) * (n - 2) for n in (8, 7, 6))
    texture = i * i - 2.0 * j * j + 3.0 * k
    assert fetch_biquadratic(texture, x, y, z) == pytest.approx(x * x - 2.0 * y * y + 3.0 * z - 0.25, abs=1000 * EPS)
    texture = 4.0 * k * k
    assert fetch_biquadratic(texture, x, y, z, along_z="quadratic") == pytest.approx(4.0 * z * z + 1.0, abs=1000 * EPS)


def test_second_order_in_the_texel_size():
    """And the error of a wave is h²/8·(2π)² of itself at the finest."""
    sizes = np.array([8, 16, 32, 64])
    u = np.random.default_rng(2).random((3, 4000))

    def error(n: int) -> float:
        wave = np.sin(2 * np.pi * (np.arange(n) + 0.5) / n)
        got = fetch_biquadratic(wave.reshape(1, 1, -1), u[0] * n, 0.5, 0.5, address="wrap")
        return float(np.sqrt(np.mean((got - np.sin(2 * np.pi * u[0]))**2)))

    errors = [error(n) for n in sizes]
    assert np.polyfit(np.log(sizes), np.log(errors), 1)[0] == pytest.approx(-2.0, abs=0.05)  # measured −1.99
    share = errors[-1] / np.sqrt(np.mean(np.sin(2 * np.pi * u[0])**2))
    assert share == pytest.approx((2 * np.pi / 64)**2 / 8, rel=0.01)


def test_slopes_are_continuous_where_a_linear_fetch_has_creases():
    """Slopes over 2⁻¹⁰ texels change from one to the next by at most 2⁻¹⁰ times the second difference of the texels
    (at most 2), or by all of the difference at once."""
    step = 2.0**-10
    x = np.arange(0.0, 6.0 + step, step)
    for fetch, steepest in ((fetch_biquadratic, 2.0 * step * 1.001), (fetch_trilinear, 2.0)):
        values = fetch(VOLUME, x, 2.2, 2.2)
        jumps = np.abs(np.diff(np.diff(values) / step))
        assert jumps.max() <= steepest
        assert jumps.max() > 0.1 * steepest


def test_edge_texel_is_repeated():
    """As a texture with its edges written out; beyond the ends the edge, to the last bit."""
    padded = np.pad(VOLUME, 2, mode="edge")
    x, y, z = (np.random.default_rng(7).uniform(-1.0, n + 1.0, 500) for n in (6, 4, 5))
    for along_z in ALONG_Z:
        got = fetch_biquadratic(VOLUME, x, y, z, along_z=along_z)
        assert got == pytest.approx(fetch_biquadratic(padded, x + 2, y + 2, z + 2, along_z=along_z), abs=128 * EPS)
    for place in (0.0, -0.5, -3.0, -np.inf):
        assert fetch_biquadratic(VOLUME, place, place, place) == VOLUME[0, 0, 0]
    for place in (6.0, 6.5, 1e30, np.inf):
        assert fetch_biquadratic(VOLUME, place, place, place, along_z="quadratic") == VOLUME[-1, -1, -1]


def test_nan_stays_where_it_is():
    got = fetch_biquadratic(VOLUME, np.array([1.0, np.nan]), 1.0, 1.0)
    assert np.isnan(got).tolist() == [False, True]
    assert np.isnan(fetch_biquadratic(VOLUME, np.inf, 1.0, 1.0, address="wrap"))
    assert np.isnan(noisy_lookup(VOLUME, 1.0, 1.0, np.nan, np.zeros((4, 3))))


# --- shapes, types, blocks --------------------------------------------------------------------------


def lookup(fetch: str):
    """Either fetch, and the taps with either, with the signature of a fetch."""
    name, _, taps = fetch.partition(" ")
    if not taps:
        return FETCHES[name]
    return lambda texture, x, y, z, **options: noisy_lookup(
        texture, x, y, z, np.linspace(-1.0, 1.0, 12).reshape(4, 3), fetch=FETCHES[name], **options)


LOOKUPS = ["quadratic", "linear taps", "quadratic taps"]


@pytest.mark.parametrize("kind", LOOKUPS)
@pytest.mark.parametrize(("block", "threads"), [(1, 1), (100, 3), (16384, None)])
def test_blocks_and_threads_change_nothing(monkeypatch, kind, block, threads):
    x, y, z = image(20, 33, VOLUME.shape)
    wanted = lookup(kind)(VOLUME, x, y, z)
    monkeypatch.setattr(blocks, "BLOCK", block)
    monkeypatch.setattr(blocks.blocks, "__kwdefaults__", {"size": block})
    assert np.array_equal(lookup(kind)(VOLUME, x, y, z, threads=threads), wanted)


@pytest.mark.parametrize("kind", LOOKUPS)
def test_channels_and_broadcast_coordinates(kind):
    texture = np.random.default_rng(7).random((3, 5, 4, 6))
    x, y, z = image(7, 9, (5, 4, 6))
    got = lookup(kind)(texture, x, y, z)
    assert got.shape == (3, 7, 9)
    assert np.array_equal(got, np.stack([lookup(kind)(t, x, y, z) for t in texture]))
    full = [a.copy() for a in np.broadcast_arrays(x, y, z)]
    assert np.array_equal(got, lookup(kind)(texture, *full))
    scattered = lookup(kind)(texture, *(a.ravel() for a in full))
    assert np.array_equal(got.reshape(3, -1), scattered)


@pytest.mark.parametrize("kind", LOOKUPS)
@pytest.mark.parametrize(("shape", "wanted"), [
    ((1, 1, 1), (1, 1)), ((5, 1, 1), (7, 9)), ((1, 4, 1), (7, 1)), ((1, 1, 6), (1, 9)), ((3, 1, 1, 1), (3, 1, 1)),
    ((2, 1, 4, 6), (2, 7, 9))])
def test_single_texels_leave_their_axis_out(kind, shape, wanted):
    texture = np.random.default_rng(8).random(shape)
    x, y, z = image(7, 9, (5, 4, 6))
    got = lookup(kind)(texture, x, y, z)
    assert got.shape == wanted
    full = np.broadcast_to(texture, (*shape[:-3], *(max(n, 2) for n in shape[-3:])))
    assert np.array_equal(np.broadcast_to(got, (*shape[:-3], 7, 9)), lookup(kind)(full, x, y, z))


@pytest.mark.parametrize("kind", LOOKUPS)
@pytest.mark.parametrize(("texture", "coordinate", "wanted"), [
    (np.float32, np.float32, np.float32), (np.float64, np.float64, np.float64), (np.float32, float, np.float32),
    (np.float32, np.float64, np.float64), (np.uint8, np.float32, np.float32), (np.uint8, float, np.float64)])
def test_dtype_follows_the_arrays(kind, texture, coordinate, wanted):
    x = 1.0 if coordinate is float else np.array([1.0], coordinate)
    got = lookup(kind)(np.array([[[200, 100]]], texture), x, 0.5, 0.5)
    assert got.dtype == wanted
    assert got == pytest.approx(float(lookup(kind)(np.array([[[200.0, 100.0]]]), 1.0, 0.5, 0.5)), rel=1e-6)
    assert 140 < got < 160  # unsigned texels do not wrap round


@pytest.mark.parametrize("kind", LOOKUPS)
def test_float32_is_within_its_rounding(kind):
    """Coordinates up to 8 are off by up to 2⁻²¹, with slopes of at most 1 a texel on three axes: 1.5e-6. Measured
    2.4e-7."""
    x, y, z = image(20, 33, VOLUME.shape)
    narrow = lookup(kind)(*(a.astype(np.float32) for a in (VOLUME, x, y, z)))
    assert np.abs(narrow - lookup(kind)(VOLUME, x, y, z)).max() < 1e-6


@pytest.mark.parametrize("kind", LOOKUPS)
def test_arguments_are_left_alone(kind):
    arrays = [VOLUME.copy(), *image(5, 7, VOLUME.shape)]
    kept = [a.copy() for a in arrays]
    for array in arrays:
        array.setflags(write=False)
    lookup(kind)(*arrays)
    assert all(np.array_equal(a, b) for a, b in zip(arrays, kept, strict=True))


def test_no_points_give_no_values():
    assert fetch_biquadratic(VOLUME, np.zeros((0, 3)), np.zeros((1, 3)), 0.5).shape == (0, 3)
    assert noisy_lookup(VOLUME, np.zeros((0, 3)), 1.0, 0.5, np.zeros((4, 3, 0, 3))).shape == (0, 3)


def test_weights_of_hardware_are_those_of_the_linear_fetches():
    """With 8 bits, ends at whole and half texels: 1.5 takes 1.25 and 1.75, of exact weights; 1.501 as good as 1.5."""
    texture = np.array([0.0, 256.0, 0.0]).reshape(1, 1, 3)
    assert fetch_biquadratic(texture, 1.5, 0.5, 0.5, weight_bits=8) == 192.0
    assert fetch_biquadratic(texture, 1.5 + 2.0**-10, 0.5, 0.5, weight_bits=8) == 192.0
    assert fetch_biquadratic(texture, 1.5 + 2.0**-10, 0.5, 0.5) != 192.0


@pytest.mark.parametrize(("call", "words"), [
    (lambda: fetch_biquadratic(np.zeros((2, 2)), 0, 0, 0), "must have 3 axes"),
    (lambda: fetch_biquadratic(np.zeros((2, 0, 2)), 0, 0, 0), "none of them empty"),
    (lambda: fetch_biquadratic(VOLUME, 0, 0, 0, address="mirror"), "one of clamp, wrap"),
    (lambda: fetch_biquadratic(VOLUME, 0, 0, 0, weight_bits=0), "None or 1 to 23"),
    (lambda: fetch_biquadratic(VOLUME, 0, 0, 0, along_z="cubic"), "along_z: is 'cubic', must be one of linear, quad"),
    (lambda: noisy_lookup(VOLUME, 0, 0, 0, np.zeros((4, 2))), r"offsets: has shape \(4, 2\), must be \(taps, 3, …\)"),
    (lambda: noisy_lookup(VOLUME, 0, 0, 0, np.zeros((0, 3))), r"offsets: has shape \(0, 3\)"),
    (lambda: noisy_lookup(VOLUME, 0, 0, 0, np.zeros(3)), r"offsets: has shape \(3,\)"),
    (lambda: noisy_lookup(VOLUME, 0, 0, 0, np.zeros((4, 3)), tone_mapped=True), "where it is tone-mapped"),
    (lambda: noisy_lookup(VOLUME[None], 0, 0, 0, np.zeros((4, 3)), tone_mapped=True), "where it is tone-mapped"),
    (lambda: tap_offsets(0, 0, 0, taps=0), "taps: is 0, must be 1 to 4"),
    (lambda: tap_offsets(0, 0, 0, taps=5), "taps: is 5"),
    (lambda: tap_offsets(0, 0, 0, taps=True), "taps: is True"),
    (lambda: tap_offsets(0, 0, 0, reach=-1.0), "reach: is -1.0, must be at least 0 texels"),
    (lambda: tap_offsets(0, 0, 0, depth_share=float("nan")), "depth_share: is nan"),
    (lambda: tap_offsets(0, 0, 0, noise=np.zeros((2, 1, 1, 1))), "noise: has 2 components"),
    (lambda: tap_offsets(0, 0, 0.5), "frame: is 0.5"),
])
def test_misuse_is_refused(call, words):
    with pytest.raises(InputError, match=words):
        call()
