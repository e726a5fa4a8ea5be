"""Blue noise: void-and-cluster against its definition, and what the shipped tiles promise."""

from __future__ import annotations

import importlib.util
import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from froxel_ref.blue_noise import SEED, blue_noise, noise_at, rank_pattern, to_bytes, void_and_cluster
from froxel_ref.records import InputError

SCRIPT = Path(__file__).parent.parent / "scripts" / "make_blue_noise.py"
SHIPPED = blue_noise()
TILES = SHIPPED.reshape(256, 64, 64)
WHITE = np.random.default_rng(1).permuted(TILES.reshape(256, -1), axis=1).reshape(TILES.shape)


# --- the definition, slowly -------------------------------------------------------------------------


def slow_ranks(pattern: np.ndarray, sigma: float) -> list[list[int]]:
    """The three phases of the paper, every energy summed anew over the other pixels, rounded once."""
    size = len(pattern)
    pixels = [(y, x) for y in range(size) for x in range(size)]
    reach = range(-2 - math.ceil(12 * sigma / size), 3 + math.ceil(12 * sigma / size))
    line = [math.fsum(math.exp(-(d + k * size)**2 / (2 * sigma**2)) for k in reach) for d in range(size)]

    def energy(at, others):
        return math.fsum(line[(at[0] - y) % size] * line[(at[1] - x) % size] for y, x in others if (y, x) != at)

    def tightest(among):
        return max(among, key=lambda at: (energy(at, among), -at[0], -at[1]))

    def emptiest(among, others):
        return min(among, key=lambda at: (energy(at, others), at))

    ones = {at for at in pixels if pattern[at]}
    while True:
        cluster = tightest(ones)
        ones.remove(cluster)
        void = emptiest(set(pixels) - ones, ones)
        if energy(void, ones) >= energy(cluster, ones):
            ones.add(cluster)
            break
        ones.add(void)

    ranks = [[0] * size for _ in range(size)]
    left = set(ones)
    for rank in reversed(range(len(ones))):
        y, x = tightest(left)
        left.remove((y, x))
        ranks[y][x] = rank
    filled = set(ones)
    for rank in range(len(ones), size * size):
        free = set(pixels) - filled
        y, x = emptiest(free, filled) if 2 * len(filled) < size * size else tightest(free)
        filled.add((y, x))
        ranks[y][x] = rank
    return ranks


# With the last numbers 16 pixels count as sparse, so that the sums over pairs have their share; else one at most.
@pytest.mark.parametrize(("size", "sigma", "share"), [
    (7, 1.5, 0.1), (8, 1.5, 0.3), (9, 1.5, 0.1), (10, 1.0, 0.2), (6, 2.0, 0.5), (12, 0.5, 0.2)])
def test_is_the_published_algorithm(size, sigma, share):
    pattern = np.random.default_rng(size).random((size, size)) < share
    assert rank_pattern(pattern, sigma=sigma).tolist() == slow_ranks(pattern, sigma)


def test_line_of_two_by_hand():
    """From the first pixel: the largest void lies across, at (1, 1); of the two left, the first one."""
    pattern = np.array([[True, False], [False, False]])
    assert rank_pattern(pattern, sigma=0.5).tolist() == [[0, 2], [3, 1]]


def test_pixels_far_apart_are_told_apart():
    """Some 14σ and more from each other, where a bell is below 1e-43 of its peak, the most crowded still goes first.

    Such energies are compared by their logarithms, the largest term apart. Two or three pixels may tie.
    """
    pattern = np.zeros((64, 64), bool)
    pattern[np.random.default_rng(6).permutation(64)[:40], np.arange(40)] = True
    ranks = rank_pattern(pattern, sigma=0.5)
    order = [tuple(int(i) for i in np.argwhere(ranks == rank)[0]) for rank in range(20)]
    for count in range(2, 21):
        left = order[:count]
        logarithms = [energy_exponent(at, left, 64) for at in left]
        assert logarithms[-1] >= max(logarithms) - 1e-9


def energy_exponent(at, others, size):
    """log of the energy, by its largest term and the rest relative to it, σ = ½."""
    squares = []
    for y, x in others:
        if (y, x) != at:
            dy, dx = (min(abs(a - b), size - abs(a - b)) for a, b in zip(at, (y, x), strict=True))
            squares.append(-(dy * dy + dx * dx) / 0.5)
    top = max(squares)
    return top + math.log(math.fsum(math.exp(s - top) for s in squares))


@given(st.integers(1, 7), st.integers(0, 2**63), st.floats(0.5, 1.0), st.floats(0.01, 0.5))
def test_tiny_tiles_have_each_rank_once(size, seed, sigma, share):
    ranks = void_and_cluster(size, seed, sigma=sigma, share=share)
    assert ranks.dtype == np.int64
    assert sorted(ranks.ravel().tolist()) == list(range(size * size))


@pytest.mark.parametrize("pattern", [np.ones((4, 4), bool), np.ones((1, 1), bool), np.eye(5, dtype=bool)])
def test_any_pattern_gives_each_rank_once(pattern):
    assert sorted(rank_pattern(pattern, sigma=0.7).ravel().tolist()) == list(range(pattern.size))


@pytest.mark.parametrize("shift", [(1, 0), (0, 1), (17, 30)])
def test_no_place_of_the_torus_is_special(shift):
    """A pattern moved by some pixels gives its ranks, moved; but for the last two on either side, which always tie."""
    pattern = np.random.default_rng(3).random((32, 32)) < 0.1
    ranks, moved = rank_pattern(pattern), rank_pattern(np.roll(pattern, shift, (0, 1)))
    ranks = np.roll(ranks, shift, (0, 1))
    tied = (np.minimum(ranks, 1023 - ranks) <= 1)
    assert np.count_nonzero(tied) == 4
    assert np.array_equal(ranks[~tied], moved[~tied])
    assert np.array_equal(ranks[tied] > 512, moved[tied] > 512)


def test_pattern_is_left_alone():
    pattern = np.eye(6, dtype=bool)
    rank_pattern(pattern)
    assert np.array_equal(pattern, np.eye(6))


def test_seeds_differ_and_repeat():
    assert np.array_equal(void_and_cluster(16, (3, 1, 2)), void_and_cluster(16, (3, 1, 2)))
    assert not np.array_equal(void_and_cluster(16, (3, 1, 2)), void_and_cluster(16, (3, 2, 1)))
    assert not np.array_equal(void_and_cluster(16, 3), void_and_cluster(16, 4))


# --- what is shipped --------------------------------------------------------------------------------


def test_shape_and_values():
    assert SHIPPED.shape == (4, 64, 64, 64)
    assert SHIPPED.dtype == np.float64
    steps = SHIPPED * 256 - 0.5
    assert np.array_equal(steps, np.rint(steps))
    assert np.array_equal(blue_noise(dtype=np.float32), SHIPPED)
    assert blue_noise(dtype=np.float32).dtype == np.float32


def test_histograms_are_flat():
    counts = [np.bincount((tile * 256 - 0.5).astype(int).ravel(), minlength=256) for tile in TILES]
    assert np.array_equal(counts, np.full((256, 256), 16))


@pytest.mark.parametrize(("component", "layer"), [(0, 0), (0, 1), (1, 0), (3, 63)])
def test_tiles_are_those_of_the_seed(component, layer):
    ranks = void_and_cluster(64, (SEED, component, layer))
    assert np.array_equal((to_bytes(ranks) + 0.5) / 256, SHIPPED[component, layer])


def test_the_script_makes_what_is_shipped(tmp_path):
    spec = importlib.util.spec_from_file_location("make_blue_noise", SCRIPT)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    module.main(["--layers", "2", "--components", "3", "-o", str(tmp_path / "some.npy")])
    some = np.load(tmp_path / "some.npy")
    assert some.dtype == np.uint8
    assert np.array_equal((some + 0.5) / 256, SHIPPED[:3, :2])
    assert module.SHIPPED.stat().st_size == 128 + 4 * 64**3
    for seed in (5, 6):
        module.main(["--layers", "1", "--components", "1", "--size", "8", "--seed", str(seed), "--sigma", "1",
                     "-o", str(tmp_path / f"{seed}.npy")])
    assert np.load(tmp_path / "5.npy")[0, 0].tolist() == to_bytes(void_and_cluster(8, (5, 0, 0), sigma=1.0)).tolist()
    assert (tmp_path / "5.npy").read_bytes() != (tmp_path / "6.npy").read_bytes()
    with pytest.raises(SystemExit):
        module.main(["--layers", "0", "-o", str(tmp_path / "none.npy")])


# --- spectra ----------------------------------------------------------------------------------------

CYCLES = np.rint(np.hypot(*np.meshgrid(*[np.fft.fftfreq(64, 1 / 64)] * 2))).astype(int).ravel()


def radial_power(tiles: np.ndarray) -> np.ndarray:
    """Periodogram of each tile by cycles a tile, 1 on average: the mean over rings one cycle wide."""
    tiles = tiles - tiles.mean(axis=(1, 2), keepdims=True)
    power = np.abs(np.fft.fft2(tiles))**2 / (tiles.var(axis=(1, 2), keepdims=True) * 64**2)
    modes = np.bincount(CYCLES)
    return np.array([np.bincount(CYCLES, p.ravel()) / modes for p in power])


def is_blue(power: np.ndarray) -> np.ndarray:
    """Of each tile; up to 8 cycles a tile measured at most 0.0017, up to 12 at most 0.0099.

    White noise has 1 there, give or take √(2/n) for the n modes of a ring (in pairs of equal power; 8 at 1 cycle, 68
    at 12). Its narrowest ring alone is below 0.002 with a chance of 0.008⁴/4! = 2e-10.
    """
    return (power[:, 1:9].max(axis=1) < 0.002) & (power[:, 1:13].max(axis=1) < 0.012)


def test_every_tile_is_blue_and_white_noise_is_not():
    assert is_blue(radial_power(TILES)).all()
    assert not is_blue(radial_power(WHITE)).any()


def test_high_frequencies_have_the_power():
    """A tile's power adds up to 1 a mode; what is missing below is above: at 22 to 40 cycles 0.63 to 2.4 measured."""
    power = radial_power(TILES)
    assert (power[:, 22:41] > 0.55).all()
    assert power[:, 24:32].mean() > 1.5


@pytest.mark.parametrize("share", [1 / 16, 1 / 8, 1 / 4, 1 / 2, 3 / 4, 15 / 16])
def test_pixels_below_any_value_are_spread_evenly(share):
    """The pixels of a share g, or the 1 − g others, are √(1/g) apart: their power is at 64·√g cycles and above.

    Up to a quarter of it there is at most 0.155 of white noise's, measured.
    """
    patterns = (share > TILES).astype(float)
    assert np.array_equal(patterns.mean(axis=(1, 2)), np.full(256, share))
    cycles = int(16 * math.sqrt(min(share, 1 - share)))
    assert radial_power(patterns)[:, 1:cycles + 1].max() < 0.2
    assert (radial_power((share > WHITE).astype(float))[:, 1:cycles + 1].max(axis=1) > 0.2).all()


def test_tiles_repeat_without_a_seam():
    """Seen through a window, the tile and the tile cut in its middle and put together at the edges are alike.

    sin² windows spread a frequency over two cycles; of 3 to 8 cycles measured at most 0.0018 in both.
    """
    window = np.sin(np.pi * (np.arange(64) + 0.5) / 64)**2
    for tiles, blue in ((TILES, True), (np.roll(TILES, (32, 32), (1, 2)), True), (WHITE, False)):
        low = radial_power((tiles - 0.5) * window * window[:, None])[:, 3:9].max(axis=1)
        assert ((low < 0.003) == blue).all()


@pytest.mark.parametrize("axis", [1, 2])
def test_neighbours_across_the_edge_are_as_inside(axis):
    """Mean squared steps between neighbouring columns (or rows), over all tiles: the one across the edge is one of 64.

    The 64 means scatter by s; the largest of 64 deviations exceeds 4.5 s with a chance of 4e-4.
    """
    steps = ((np.roll(TILES, -1, axis) - TILES)**2).mean(axis=(0, 3 - axis))
    assert abs(steps[-1] - steps[:-1].mean()) < 4.5 * steps[:-1].std()


# --- independence -----------------------------------------------------------------------------------


def expected_scatter() -> float:
    """Standard deviation of the correlation of independent tiles with the mean spectrum P of the shipped.

    The correlation is Σ √(P P') cos φ/Σ P over the modes, phases φ at random, so its variance is Σ P²/(Σ P)²: that of
    white noise, 1/4096, were P flat; blue tiles have fewer modes, as if they had 2788 samples.
    """
    tiles = TILES - 0.5
    power = (np.abs(np.fft.fft2(tiles))**2).mean(axis=0)
    return float(np.sqrt((power**2).sum()) / power.sum())


def test_layers_and_components_are_uncorrelated():
    """32640 pairs; the largest of as many normal deviates is 4.2 σ, and beyond 5.5 σ with a chance of 1.2e-3.

    Their root mean square is known to 1/√(2·32640) = 0.4 %; the spectra of single tiles differ from the mean one, by
    which the formula is 0.14 % off as measured.
    """
    scatter = expected_scatter()
    assert 1 / 64 < scatter < 1 / 50
    deviates = (TILES - 0.5).reshape(256, -1)
    deviates /= np.sqrt((deviates**2).sum(axis=1, keepdims=True))
    pairs = (deviates @ deviates.T)[np.triu_indices(256, 1)]
    assert np.abs(pairs).max() < 5.5 * scatter
    assert np.sqrt((pairs**2).mean()) == pytest.approx(scatter, rel=0.02)


def test_no_layer_is_the_next_one_shifted():
    """At every shift; 255·4096 correlations: beyond 6 σ with a chance of 2e-3 (measured 5.1)."""
    spectra = np.fft.fft2(TILES - 0.5)
    variance = (TILES[0] - 0.5).var()
    shifted = np.fft.ifft2(spectra[:-1] * spectra[1:].conj()).real / (4096 * variance)
    assert np.abs(shifted).max() < 6 * expected_scatter()


# --- what pixels find -------------------------------------------------------------------------------


def test_pixels_by_hand():
    """Row 70, column 129, frame 67: layer 3, row 6, column 1."""
    got = noise_at(np.array([70]), np.array([129]), 67)
    assert got.shape == (4, 1)
    assert np.array_equal(got[:, 0], SHIPPED[:, 3, 6, 1])


def test_an_image_is_the_tile_repeated():
    rows, columns = np.arange(130).reshape(-1, 1), np.arange(70)
    got = noise_at(rows, columns, 2**40 + 5)
    wanted = np.tile(SHIPPED[:, 5], (1, 3, 2))[:, :130, :70]
    assert np.array_equal(got, wanted)
    scattered = np.random.default_rng(4).integers(0, 70, (2, 3, 5))
    assert np.array_equal(noise_at(*scattered, 5), wanted[:, scattered[0], scattered[1]])
    assert np.array_equal(noise_at(rows[:1], columns, 5), wanted[:, :1])


def test_pixels_of_unsigned_and_negative_numbers():
    got = noise_at(np.array([250], np.uint8), np.array([-1]), -1)
    assert np.array_equal(got[:, 0], SHIPPED[:, 63, 250 % 64, 63])


def test_other_noise_and_types():
    other = np.random.default_rng(5).random((2, 3, 4, 5)).astype(np.float32)
    got = noise_at(np.arange(9).reshape(-1, 1), np.arange(11), 7, noise=other)
    assert got.dtype == np.float32
    assert np.array_equal(got, np.tile(other[:, 1], (1, 3, 3))[:, :9, :11])
    assert noise_at(np.arange(2), np.arange(2), 0, dtype=np.float32).dtype == np.float32
    assert noise_at(np.arange(2), np.arange(2), 0, noise=other, dtype=np.float64).dtype == np.float64
    assert noise_at(np.arange(2), np.arange(2), 0).dtype == np.float64


def test_what_is_found_may_be_written_to():
    noise_at(np.arange(2), np.arange(2), 0)[:] = 7.0
    blue_noise()[:] = 7.0
    assert np.array_equal(blue_noise(), SHIPPED)
    other = np.zeros((1, 1, 2, 2))
    noise_at(1, 1, 0, noise=other)[:] = 7.0
    assert not other.any()


@pytest.mark.parametrize(("call", "words"), [
    (lambda: void_and_cluster(0, 1), "size: is 0, must be a whole number, at least 1"),
    (lambda: void_and_cluster(2.0, 1), "size: is 2.0"),
    (lambda: void_and_cluster(True, 1), "size: is True"),
    (lambda: void_and_cluster(4, -1), "seed: is -1"),
    (lambda: void_and_cluster(4, (1, 0.5)), "seed: is 0.5"),
    (lambda: void_and_cluster(4, 1, sigma=0.4), "sigma: is 0.4, must be 0.5 to 4"),
    (lambda: void_and_cluster(4, 1, sigma=float("nan")), "sigma: is nan"),
    (lambda: void_and_cluster(4, 1, sigma=4.1), "sigma: is 4.1"),
    (lambda: void_and_cluster(4, 1, share=0.0), "share: is 0.0"),
    (lambda: void_and_cluster(4, 1, share=0.6), "share: is 0.6"),
    (lambda: rank_pattern(np.zeros((3, 3), bool)), r"pattern: has shape \(3, 3\), type bool and 0 pixels"),
    (lambda: rank_pattern(np.ones((3, 2), bool)), r"pattern: has shape \(3, 2\)"),
    (lambda: rank_pattern(np.ones((3, 3))), "type float64"),
    (lambda: rank_pattern(np.ones((3, 3, 3), bool)), r"shape \(3, 3, 3\)"),
    (lambda: noise_at(np.zeros(1), np.zeros(1, int), 0), "rows: has type float64, must be of whole numbers"),
    (lambda: noise_at(np.zeros(1, int), np.zeros(1), 0), "columns: has type float64"),
    (lambda: noise_at(np.zeros(1, int), np.zeros(1, int), 0.5), "frame: is 0.5, must be a whole number$"),
    (lambda: noise_at(np.zeros(1, int), np.zeros(1, int), 0, noise=np.zeros((4, 64, 64))), "noise: has shape"),
])
def test_misuse_is_refused(call, words):
    with pytest.raises(InputError, match=words):
        call()
