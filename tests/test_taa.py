"""Temporal anti-aliasing: jitter, history, clipping, and what is left of edges, ghosts and numbers that are none."""

from __future__ import annotations

import math
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from froxel_ref.image_motion import Motion, from_velocity, motion
from froxel_ref.records import InputError
from froxel_ref.scene import Camera
from froxel_ref.storage import store
from froxel_ref.taa import AUTHOR, KERNELS, PUBLISHED, author_alpha, fetch_history, pixel_offsets, resolve
from froxel_ref.tonemap import FLOAT16_LARGEST_LUMA, luma

EPS, NAN, INF = 2.0**-52, math.nan, math.inf
LUMA = (0.2126, 0.7152, 0.0722)


def image(shape, seed=1, *, largest=4.0, dtype=np.float64):
    return (largest * np.random.default_rng(seed).random((3, *shape))).astype(dtype)


def grey(plane):
    return np.broadcast_to(np.asarray(plane, np.float64), (3, *np.shape(plane))).copy()


def moved(x, y, shape):
    """Every pixel by so much."""
    return from_velocity(np.array([x, y], np.float64).reshape(2, 1, 1), shape=shape)


# --- jitter -----------------------------------------------------------------------------------------


def radical_inverse(index: int, base: int) -> Fraction:
    digits = []
    while index:
        digits.append(index % base)
        index //= base
    return sum((Fraction(d, base**(k + 1)) for k, d in enumerate(digits)), Fraction(0))


def test_published_offsets_are_halton_points_less_a_half():
    got = pixel_offsets(np.arange(16), points="published")
    expected = [[float(radical_inverse(i + 1, b) - Fraction(1, 2)) for b in (2, 3)] for i in range(16)]
    assert got.tolist() == expected
    assert expected[:3] == [[0.0, pytest.approx(-1 / 6)], [-0.25, pytest.approx(1 / 6)], [0.25, pytest.approx(-7 / 18)]]
    assert got.mean(axis=0) == pytest.approx([-15 / 512, -1 / 27], abs=1e-16)  # D10 for images


@pytest.mark.parametrize("count", [1, 2, 3, 8, 16, 64])
def test_centred_offsets_average_nothing_at_all(count):
    got = pixel_offsets(np.arange(count), count=count)
    for order in (slice(None), slice(None, None, -1)):
        assert got[order].sum(axis=0).tolist() == [0.0, 0.0]
        assert got[order].astype(np.float32).cumsum(axis=0)[-1].tolist() == [0.0, 0.0]
    assert np.abs(got).max() < 0.5
    published = pixel_offsets(np.arange(count), points="published", count=count)
    assert np.abs(got - (published - published.mean(axis=0))).max() < 2.0**-24 + 1e-16


def test_offsets_cycle_and_keep_the_shape_of_frames():
    cycle = pixel_offsets(np.arange(16))
    assert np.array_equal(pixel_offsets(np.arange(-16, 48).reshape(4, 16)), np.broadcast_to(cycle, (4, 16, 2)))
    assert pixel_offsets(5).shape == (2,)
    assert len(np.unique(cycle[:, 0])) == len(np.unique(cycle[:, 1])) == 16
    cycle[:] = 7.0  # a copy
    assert np.abs(pixel_offsets(np.arange(16))).max() < 0.5


# --- the program's weight ---------------------------------------------------------------------------


def test_author_alpha_by_hand():
    """m = max(|x|, |y|): 2.5 is a centre, 3 an edge, 2.75 half-way; a jitter of (0.3, 0.4) is one half pixel long."""
    x, y = np.array([[0.5, 3.0, 2.75, -2.75]]), np.array([[2.5]])
    assert author_alpha(x, y, (0.0, 0.0))[0] == pytest.approx([0.05, 0.8, 0.425, 0.425], abs=1e-15)
    assert author_alpha(x, y, (0.3, -0.4))[0] == pytest.approx(
        [a * math.exp(-2.29) for a in (0.05, 0.8, 0.425, 0.425)], abs=1e-15)
    assert author_alpha(np.array([[NAN, INF]]), y, (0.0, 0.0)).tolist() == [[0.8, 0.8]]
    assert author_alpha(x.astype(np.float32), y.astype(np.float32), (0, 0)).dtype == np.float32


def test_at_rest_the_program_takes_between_a_five_hundredth_and_a_twentieth():
    still = from_velocity(np.zeros((2, 1, 1)), shape=(3, 4))
    weights = [float(author_alpha(still.x, still.y, offset).max()) for offset in pixel_offsets(np.arange(16))]
    assert all(float(author_alpha(still.x, still.y, o).min()) == w for o, w in zip(
        pixel_offsets(np.arange(16)), weights, strict=True))
    assert 0.05 * math.exp(-2.29 * math.sqrt(2.0)) < min(weights) < max(weights) <= 0.05


# --- history ----------------------------------------------------------------------------------------


def cubic(distance: float) -> float:
    """The Catmull–Rom kernel by distance: Keys' cubic with a = −½."""
    d = abs(distance)
    if d < 1.0:
        return 1.5 * d**3 - 2.5 * d**2 + 1.0
    return -0.5 * d**3 + 2.5 * d**2 - 4.0 * d + 2.0 if d < 2.0 else 0.0


def slow_fetch(plane, x, y, kernel):
    """The sum over pixels; each pixel of an endless image that repeats its edge. NaN if one that counts is none."""
    height, width = plane.shape
    total = weights = 0.0
    left, top = math.floor(x - 0.5), math.floor(y - 0.5)
    for n in range(top - 1, top + 3):
        for m in range(left - 1, left + 3):
            if kernel == "bilinear":
                weight = max(0.0, 1.0 - abs(x - m - 0.5)) * max(0.0, 1.0 - abs(y - n - 0.5))
            else:
                weight = cubic(x - m - 0.5) * cubic(y - n - 0.5)
            if kernel == "five_tap" and m in (left - 1, left + 2) and n in (top - 1, top + 2):
                continue
            if weight:
                value = float(plane[min(max(n, 0), height - 1), min(max(m, 0), width - 1)])
                total += weight * (value if math.isfinite(value) else NAN)
                weights += weight
    return total / weights


@pytest.mark.parametrize("kernel", KERNELS)
@pytest.mark.parametrize("shape", [(1, 1), (1, 5), (4, 1), (2, 2), (4, 5)])
def test_fetch_is_the_sum_over_its_pixels(kernel, shape):
    """Five bilinear fetches are the twelve pixels without corners. Coordinates in and around the image; quarters and
    halves among them hit the pixels' edges. Tolerance: some thirty roundings of sums of at most 1.3 times 4."""
    random = np.random.default_rng(7)
    picture = image(shape)
    x = np.concatenate([random.uniform(-3.0, shape[1] + 3.0, 30), np.arange(-8, 4 * shape[1] + 8) / 4])
    y = np.concatenate([random.uniform(-3.0, shape[0] + 3.0, 30), np.arange(-8, 4 * shape[0] + 8) / 4])
    y = np.resize(y, x.size)
    got = fetch_history(picture, x, y, kernel=kernel)
    expected = [[slow_fetch(plane, a, b, kernel) for a, b in zip(x, y, strict=True)] for plane in picture]
    assert np.abs(got - expected).max() < 40 * EPS * 4.0
    assert np.array_equal(fetch_history(picture[0], x, y, kernel=kernel), got[0])


@pytest.mark.parametrize("kernel", KERNELS)
@pytest.mark.parametrize("dtype", [np.float64, np.float32])
def test_centres_give_their_pixel_exactly(kernel, dtype):
    picture = image((4, 6), dtype=dtype)
    x, y = np.arange(6) + 0.5, np.arange(4)[:, None] + 0.5
    assert fetch_history(picture, x[None], y, kernel=kernel) is picture
    for i, j in ((0, 0), (-1, 0), (2, -1), (-9, 40)):  # by whole pixels, beyond the edges too
        got = fetch_history(picture, x[None] + i, y + j, kernel=kernel)
        rows, columns = np.clip(np.arange(4) + j, 0, 3), np.clip(np.arange(6) + i, 0, 5)
        assert got.dtype == dtype
        assert np.array_equal(got, picture[:, rows][:, :, columns])


@given(st.floats(0.0, 1e30), st.floats(-20, 20), st.floats(-20, 20), st.sampled_from(KERNELS),
       st.sampled_from([None, 8]))
def test_a_constant_image_is_fetched_exactly(value, x, y, kernel, bits):
    got = fetch_history(np.full((3, 4, 5), value), np.array([x]), np.array([y]), kernel=kernel, weight_bits=bits)
    assert (got == value).all()


def test_orders_in_the_pixel_size():
    """sin 3x cos 2y between the pixels. Measured: 3.1 for all sixteen, 2.0 bilinear; without corners 1.1."""
    def error(kernel, n):
        at = (np.arange(n) + 0.5) / n
        x, y = np.linspace(0.2, 0.8, 97)[None], np.linspace(0.2, 0.8, 89)[:, None]
        got = fetch_history(np.sin(3 * at) * np.cos(2 * at)[:, None], x * n, y * n, kernel=kernel)
        return np.abs(got - np.sin(3 * x) * np.cos(2 * y)).max()

    slopes = {kernel: math.log2(error(kernel, 32) / error(kernel, 64)) for kernel in KERNELS}
    assert 2.8 < slopes["bicubic"] < 3.3
    assert 1.9 < slopes["bilinear"] < 2.1
    assert 0.9 < slopes["five_tap"] < 1.3


def test_without_corners_a_slope_is_off_by_up_to_six_thousandths():
    """At (f, ½) with b = w₁ + w₂ along either axis: b_x·(1 − b_y)·(w₂/b_x − f)/(1 − (1 − b_x)(1 − b_y))."""
    ramp, worst = np.broadcast_to(np.arange(12.0), (12, 12)), 0.0
    for f in np.linspace(0.0, 1.0, 51):
        across = [cubic(f - k) for k in (0, 1)]
        bx, by = sum(across), 2 * cubic(0.5)
        expected = bx * (1 - by) * (across[1] / bx - f) / (1 - (1 - bx) * (1 - by))
        got = fetch_history(ramp, np.array([[5.5 + f]]), np.array([[6.0]])) - (5.0 + f)
        assert abs(got[0, 0]) == pytest.approx(abs(expected), abs=1e-13)
        worst = max(worst, abs(float(got[0, 0])))
    assert worst == pytest.approx(0.0061, abs=5e-5)
    assert np.abs(fetch_history(ramp, np.array([[5.7]]), np.array([[6.0]]), kernel="bicubic") - 5.2).max() < 1e-14


@pytest.mark.parametrize("kernel", KERNELS)
def test_a_pixel_that_is_none_shows_only_where_it_has_weight(kernel):
    picture = image((6, 6))
    picture[1, 2, 3] = NAN
    random = np.random.default_rng(8)
    x, y = np.round(random.uniform(0, 6, 200) * 4) / 4, np.round(random.uniform(0, 6, 200) * 4) / 4
    got = fetch_history(picture, x, y, kernel=kernel)
    expected = np.array([math.isnan(slow_fetch(picture[1], a, b, kernel)) for a, b in zip(x, y, strict=True)])
    assert 0 < expected.sum() < 150
    np.testing.assert_array_equal(np.isnan(got), np.broadcast_to(expected, (3, 200)))


def test_a_coordinate_that_is_none():
    got = fetch_history(image((3, 4)), np.array([[NAN, 1.25]]), np.array([[1.0]]))
    assert np.isnan(got[..., 0]).all()
    assert np.isfinite(got[..., 1]).all()
    edge = fetch_history(image((3, 4)), np.array([[INF, -INF]]), np.array([[1.5]]))
    assert np.array_equal(edge[:, 0], image((3, 4))[:, 1, [3, 0]])


def test_eight_bits_of_weight_are_off_by_a_five_hundredth():
    """Measured 0.0021 of the range, against nothing in full precision: two axes of half a step of 2⁻⁸ each."""
    random, picture = np.random.default_rng(9), image((16, 16), largest=1.0)
    x, y = random.uniform(2, 14, (1, 500)), random.uniform(2, 14, (1, 500))
    error = np.abs(fetch_history(picture, x, y, weight_bits=8) - fetch_history(picture, x, y)).max()
    assert 2.0**-11 < error < 2.0**-8


# --- the whole by a loop ----------------------------------------------------------------------------


def tone(colour):
    return [c / (1.0 + sum(a * b for a, b in zip(LUMA, colour, strict=True))) for c in colour]


def untone(colour):
    return [c / (1.0 - sum(a * b for a, b in zip(LUMA, colour, strict=True))) for c in colour]


def to_ycocg(colour):
    r, g, b = colour
    return [r / 4 + g / 2 + b / 4, r / 2 - b / 2, -r / 4 + g / 2 - b / 4]


def from_ycocg(colour):
    y, o, g = colour
    return [y + o - g, y + g, y - o - g]


def same(colour):
    return list(colour)


def slow_resolve(current, history, pixels, *, alpha=0.1, gamma=1.0, clip="line", space="ycocg", border="inside",
                 padding=0.0, least_variance=0.0, kernel="five_tap", tone_mapping=True, exposure_ratio=1.0, **_):
    """Pixel by pixel, as the equations have it: average tone-mapped colours, then eq. 3.4."""
    height, width = current.shape[1:]
    enter, leave = (tone, untone) if tone_mapping else (same, same)
    into, out = (to_ycocg, from_ycocg) if space == "ycocg" else (same, same)
    result = np.empty_like(current)

    def colour_at(j, i):
        """What counts as a neighbour there: a colour, or None."""
        if not (0 <= j < height and 0 <= i < width):
            if border == "zero":
                return [0.0, 0.0, 0.0]
            if border == "inside":
                return None
            j, i = min(max(j, 0), height - 1), min(max(i, 0), width - 1)
        values = [float(c) for c in current[:, j, i]]
        return [max(c, 0.0) for c in values] if all(map(math.isfinite, values)) else None

    for j in range(height):
        for i in range(width):
            taps = [colour_at(j + n, i + m) for n in (-1, 0, 1) for m in (-1, 0, 1)]
            taps = [into(enter(tap)) for tap in taps if tap is not None]
            now, then = colour_at(j, i), None
            x, y = (float(np.broadcast_to(c, (height, width))[j, i]) for c in (pixels.x, pixels.y))
            if history is not None and 0 <= x <= width and 0 <= y <= height:
                then = [slow_fetch(plane, x, y, kernel) * exposure_ratio for plane in history]
                then = [max(c, 0.0) for c in then] if all(map(math.isfinite, then)) else None
            if taps:
                mean = [sum(tap[k] for tap in taps) / len(taps) for k in range(3)]
                variance = [sum((tap[k] - mean[k])**2 for tap in taps) / len(taps) for k in range(3)]
                half = [gamma * math.sqrt(max(v, least_variance)) + padding for v in variance]
            if then is not None:
                then = into(enter(then))
                if taps and clip == "line":
                    s = min([1.0] + [half[k] / abs(then[k] - mean[k]) for k in range(3) if then[k] != mean[k]])
                    then = [mean[k] + s * (then[k] - mean[k]) for k in range(3)]
                elif taps and clip == "clamp":
                    then = [min(max(then[k], mean[k] - half[k]), mean[k] + half[k]) for k in range(3)]
                then = [max(c, 0.0) for c in out(then)]
            share = float(np.broadcast_to(alpha, (height, width))[j, i])
            if now is not None and then is not None:
                value = leave([share * a + (1.0 - share) * b for a, b in zip(enter(now), then, strict=True)])
            elif then is not None:
                value = leave(then)
            elif now is not None:
                value = now
            else:
                value = leave(out(mean)) if taps else [0.0, 0.0, 0.0]
            result[:, j, i] = value
    return result


WAYS = [{}, {"clip": "clamp"}, {"clip": "off"}, {"space": "rgb"}, {"space": "rgb", "clip": "clamp"},
        {"border": "repeat"}, {"border": "zero"}, {"gamma": 0.0}, {"gamma": 0.4, "padding": 0.02}, {"alpha": 1.0},
        {"alpha": 0.7}, {"least_variance": 0.01}, {"kernel": "bicubic"}, {"kernel": "bilinear"},
        {"tone_mapping": False}, {"tone_mapping": False, "clip": "clamp", "space": "rgb"}, {"exposure_ratio": 2.5},
        PUBLISHED, AUTHOR, {"inverse": "luma", "gamma": 0.5}]


@pytest.mark.parametrize("shape", [(1, 1), (1, 4), (3, 1), (5, 6)])
@pytest.mark.parametrize("way", WAYS, ids=lambda way: "-".join(map(str, way)) or "default")
def test_resolve_is_that_of_a_loop(way, shape):
    """With motion, darkness, negative numbers, NaN and infinities. The loop's 1/(1 − luma) multiplies roundings by up
    to 1 + luma, 7 here, and its s is a quotient of differences; measured 2e-14 of a value, 1e-12 allowed."""
    random = np.random.default_rng(11)
    current, history = image(shape, 12, largest=6.0), image(shape, 13, largest=6.0)
    current[:, random.random(shape) < 0.1] = 0.0
    current[1, random.random(shape) < 0.1] = -0.5
    history[:, random.random(shape) < 0.1] = 0.0
    for value in (NAN, INF, -INF):
        current[random.integers(3), random.random(shape) < 0.06] = value
        history[random.integers(3), random.random(shape) < 0.03] = value
    pixels = from_velocity(np.round(random.normal(0.0, 1.0, (2, *shape)) * 8) / 8)
    way = dict(way)
    if way.get("inverse") == "luma":
        way["largest_luma"] = 1.0 - 2.0**-40  # nothing comes near it
    alpha = way.pop("alpha", np.clip(random.random(shape), 0.01, 1.0))
    got = resolve(current, history, pixels, alpha=alpha, **way)
    expected = slow_resolve(current, history, pixels, alpha=alpha, **way)
    assert np.abs(got - expected).max() < 1e-12 * 6.0
    assert np.isfinite(got).all()


def test_the_weight_of_the_program_goes_in_as_an_image():
    current, history = image((4, 5), 21), image((4, 5), 22)
    pixels = from_velocity(np.random.default_rng(23).normal(0.0, 1.0, (2, 4, 5)))
    alpha = author_alpha(pixels.x, pixels.y, pixel_offsets(3))
    got = resolve(current, history, pixels, alpha=alpha, **AUTHOR)
    assert np.abs(got - slow_resolve(current, history, pixels, alpha=alpha, **AUTHOR)).max() < 1e-12 * 4.0


@pytest.mark.parametrize("way", [{}, {"clip": "clamp"}, {"tone_mapping": False}, PUBLISHED])
def test_float32_stays_and_agrees(way):
    """1e-5 of the range: a clipped share is a quotient of differences of tone-mapped colours."""
    current, history = image((9, 8), 31), image((9, 8), 32)
    pixels = from_velocity(np.random.default_rng(33).normal(0.0, 1.0, (2, 9, 8)))
    got = resolve(current.astype(np.float32), history.astype(np.float32), pixels, **way)
    assert got.dtype == np.float32
    assert np.abs(got - resolve(current, history, pixels, **way)).max() < 1e-5 * 4.0
    assert resolve(current.astype(np.float32), None).dtype == np.float32


def test_rows_and_threads_change_nothing():
    current, history = image((300, 200), 41), image((300, 200), 42)
    pixels = from_velocity(np.random.default_rng(43).normal(0.0, 1.0, (2, 300, 200)))
    whole = resolve(current, history, pixels, threads=2)
    assert np.array_equal(whole, resolve(current, history, pixels))
    top = resolve(current[:, :120], history[:, :120])  # another cut into blocks: alike but for the last row
    assert np.array_equal(top[:, :119], resolve(current, history)[:, :119])


@pytest.mark.parametrize("short", [(1, 1), (1, 6), (5, 1)])
@pytest.mark.parametrize("border", ["inside", "repeat", "zero"])
def test_axes_of_length_one_are_full_ones(short, border):
    thin, full = image(short, 51), np.broadcast_to(image(short, 51), (3, 5, 6))
    other = image((5, 6), 52)
    for pixels in (None, moved(0.3, -0.2, (5, 6))):
        assert np.array_equal(resolve(thin, other, pixels, border=border), resolve(full, other, pixels, border=border))
        assert np.array_equal(resolve(other, thin, pixels, border=border), resolve(other, full, pixels, border=border))
    assert resolve(thin, thin).shape == (3, *short)
    assert resolve(thin, thin, moved(0.3, 0.0, (5, 6)), border=border).shape == (3, 5, 6)


def test_what_is_negative_counts_as_black():
    """Of the history too, before it is filtered: no pixel darkens another below what black would do."""
    current, history = image((4, 5), 63) - 2.0, image((4, 5), 64) - 2.0
    for pixels in (None, moved(0.4, 0.3, (4, 5))):
        got = resolve(current, history, pixels)
        assert np.array_equal(got, resolve(np.maximum(current, 0.0), np.maximum(history, 0.0), pixels))


def test_other_types_are_taken_as_float64():
    for dtype in (np.float16, np.int32):
        current = image((3, 4), 65).astype(dtype)
        got = resolve(current, current)
        assert got.dtype == np.float64
        assert np.array_equal(got, resolve(current.astype(np.float64), current.astype(np.float64)))
    assert resolve(current, image((3, 4), 65, dtype=np.float32)).dtype == np.float64


def test_nothing_given_is_changed():
    current, history = image((4, 4), 61), image((4, 4), 62)
    current[0, 1, 1] = history[0, 2, 2] = NAN
    kept = current.copy(), history.copy()
    resolve(current, history, moved(0.5, 0.0, (4, 4)))
    resolve(current, history)
    np.testing.assert_array_equal((current, history), kept)


# --- constant images --------------------------------------------------------------------------------


@pytest.mark.parametrize("dtype", [np.float64, np.float32])
@pytest.mark.parametrize("value", [0.0, 1e-30, 0.3, 7.0, 65504.0, 3e9, 1e18])
@pytest.mark.parametrize("way", [{}, {"space": "rgb"}, {"tone_mapping": False}, {"clip": "clamp"}, {"clip": "off"},
                                 {"border": "repeat"}, {"alpha": 1.0}, {"alpha": 0.5}, {"alpha": 0.9}])
def test_a_constant_image_stays_exactly(way, value, dtype):
    """Bit for bit after a hundred frames, still or in motion: no tone map is undone where nothing is clipped."""
    now = (value * np.array([1.0, 0.25, 0.7])).astype(dtype).reshape(3, 1, 1) + np.zeros((3, 5, 6), dtype)
    history, velocities = now, np.random.default_rng(71).normal(0.0, 1.5, (10, 2, 5, 6))
    for velocity in velocities:
        history = resolve(now, history, from_velocity(velocity), **way)
        history = resolve(now, history, **way)
    assert np.array_equal(history, now)


def test_black_beyond_the_edge_darkens_the_corners():
    """A10. Grey 1 is ½ tone-mapped. In a corner 4 of 9 are there: mean 4/9·½, deviation √20/9·½, so the history stays
    below (4 + √20)/9·½ and the result, at α = 0.05, ends at 0.95 of that and 0.05 of ½: 10 % too dark. At an edge 6 of
    9 leave room enough."""
    now = grey(np.ones((5, 5)))
    history = now
    for _ in range(200):
        history = resolve(now, history, alpha=0.05, border="zero", space="rgb")
    mapped = 0.95 * (4.0 + math.sqrt(20.0)) / 18.0 + 0.05 * 0.5
    assert history[0, 0, 0] == pytest.approx(mapped / (1.0 - mapped), rel=1e-12)
    assert history[0, 0, 0] == pytest.approx(0.8945, abs=1e-4)
    assert np.array_equal(history[:, 0, 1:-1], now[:, 0, 1:-1])
    for border in ("inside", "repeat"):
        assert np.array_equal(resolve(now, now, border=border), now)


# --- numbers that are none --------------------------------------------------------------------------


@pytest.mark.parametrize("way", [{}, {"clip": "clamp"}, {"clip": "off"}, {"tone_mapping": False}, {"border": "zero"},
                                 PUBLISHED | {"largest_luma": FLOAT16_LARGEST_LUMA}])
@pytest.mark.parametrize("value", [NAN, INF, -INF])
@pytest.mark.parametrize("everywhere", [False, True])
def test_nothing_that_is_no_number_gets_out(way, value, everywhere):
    """In whatever input, at once; and the frame after it is what it would have been from that."""
    good, bad = image((6, 7), 81), image((6, 7), 82)
    bad[:, slice(None) if everywhere else 3, slice(None) if everywhere else 4] = value
    for pixels in (None, from_velocity(np.random.default_rng(83).normal(0, 1.0, (2, 6, 7)))):
        for current, history in ((bad, good), (good, bad), (bad, bad), (bad, None)):
            got = resolve(current, history, pixels, **way)
            assert np.isfinite(got).all()
            assert (got >= 0.0).all()
            assert np.isfinite(resolve(good, got, pixels, **way)).all()


def test_what_stands_for_a_pixel_that_is_none():
    current, history = grey([[1.0, 3.0, 3.0]]), grey([[2.0, 3.0, 8.0]])
    current[2, 0, 1] = NAN
    # Its history, clipped to what its neighbours 1 and 3 are (mapped ½ and ¾, so it is their ⅝ + 1/8).
    assert resolve(current, history)[0, 0, 1] == pytest.approx(3.0, rel=4 * EPS)
    # No history: the mean of ½ and ¾, ⅝, undone; linear 2.
    assert resolve(current, None)[0, 0, 1] == pytest.approx(0.625 / 0.375, rel=4 * EPS)
    assert resolve(current, None, tone_mapping=False)[0, 0, 1] == 2.0
    # Neither: 0. No finite neighbour, but a history: that.
    current[:] = NAN
    assert resolve(current, None).tolist() == np.zeros((3, 1, 3)).tolist()
    assert resolve(current, history).tolist() == history.tolist()
    # It takes no part in its neighbours' boxes: those of the left pixel are 1 alone, of which it becomes 1.
    current = grey([[1.0, 3.0, 3.0]])
    current[2, 0, 1] = NAN
    assert resolve(current, history)[0, 0, 0] == pytest.approx(1.0, rel=4 * EPS)


@pytest.mark.parametrize("way", [{}, {"clip": "clamp"}, {"clip": "clamp", "space": "rgb"}, {"clip": "off"},
                                 {"alpha": 1.0}, {"alpha": 1e-30}, {"tone_mapping": False}, {"kernel": "bicubic"},
                                 {"inverse": "luma"}])
@pytest.mark.parametrize("dtype", [np.float64, np.float32])
def test_the_whole_range_of_numbers_stays_finite(way, dtype):
    """From denormals to the largest number a type has, side by side; a warning of NumPy's would be a fault too."""
    kind, random = np.finfo(dtype), np.random.default_rng(87)
    levels = np.array([0.0, kind.smallest_subnormal, kind.tiny, 1.0, 1.0 / kind.eps, 1e30, kind.max / 4, kind.max])
    levels = levels.astype(dtype)
    top = np.full((3, 4, 5), kind.max)
    assert np.array_equal(resolve(top, top, moved(0.25, 0.5, (4, 5)), **way), top) or way == {"inverse": "luma"}
    for _ in range(20):
        current, history = (random.choice(levels, (3, 4, 5)) for _ in range(2))
        for pixels in (None, moved(0.25, 0.5, (4, 5))):
            got = resolve(current, history, pixels, **way)
            assert np.isfinite(got).all()
            assert (got >= 0.0).all()


def test_channels_clamped_apart_are_cut_at_black():
    """Two green and one blue pixel among dark ones, a cyan history: clamped in YCoCg its red would be below 0."""
    current, history = grey(np.full((3, 3), 0.05)), np.zeros((3, 3, 3))
    current[:, 0, 2] = current[:, 2, 1] = 0.0, 5.0, 0.0
    current[:, 1, 0], history[1:] = (0.0, 0.0, 5.0), 5.0
    taps = np.array([to_ycocg(tone(c)) for c in current.reshape(3, 9).T.tolist()])
    mean, deviation = taps.mean(axis=0), taps.std(axis=0)
    clamped = from_ycocg(np.clip(to_ycocg(tone([0.0, 5.0, 5.0])), mean - deviation, mean + deviation))
    assert min(clamped) < -0.01
    got = resolve(current, history, alpha=1e-18, clip="clamp")[:, 1, 1]
    assert got == pytest.approx(untone([max(c, 0.0) for c in clamped]), rel=1e-12)


def test_channels_clamped_apart_are_as_bright_as_is_allowed():
    """Green of nine tenths of the luma in all pixels, red of a tenth in all but one: red's box, mean and deviation,
    reaches 0.12. A history with that red and too little green is clamped to a luma of 1.02, beyond all radiance."""
    current = np.zeros((3, 3, 3))
    current[0], current[1] = 1e9 * 0.1 / LUMA[0], 1e9 * 0.9 / LUMA[1]
    current[:, 0, 0] = 0.0, 9.0 / LUMA[1], 0.0
    mapped = np.array([0.12 / LUMA[0], 0.87 / LUMA[1], 0.0])
    history = np.broadcast_to((100.0 * mapped).reshape(3, 1, 1), (3, 3, 3))  # luma 99, so w = 1/100
    clamped = np.array([mapped[0], 0.9 / LUMA[1], 0.0])
    for most in (FLOAT16_LARGEST_LUMA, 1.0 - 2.0**-53):
        got = resolve(current, history, alpha=1e-18, clip="clamp", space="rgb", largest_luma=most)[:, 1, 1]
        assert got == pytest.approx(clamped / (1.0 - most), rel=1e-6)
    assert np.array_equal(got, resolve(current, history, alpha=1e-18, clip="clamp", space="rgb")[:, 1, 1])
    assert np.isfinite(resolve(current, history, clip="clamp", space="rgb", largest_luma=1.0)).all()


def test_a_weight_of_one_is_the_image_exactly():
    assert np.array_equal(resolve(image((4, 5), 88), image((4, 5), 89), alpha=1.0), image((4, 5), 88))


def test_a_history_that_is_none_counts_as_absent():
    current, history = image((4, 5), 91), image((4, 5), 92)
    expected = resolve(current, history)
    history[1, 2, 3] = INF
    expected[:, 2, 3] = current[:, 2, 3]
    assert np.array_equal(resolve(current, history), expected)


# --- where there is no history ----------------------------------------------------------------------


def test_without_history_the_image_stays_as_it_is():
    current, history = image((4, 5), 101), image((4, 5), 102)
    for got in (resolve(current, None), resolve(current, history, cut=True),
                resolve(current, history, moved(9.0, 0.0, (4, 5))), resolve(current, history, moved(NAN, 0.0, (4, 5)))):
        assert np.array_equal(got, current)
    got = resolve(current, history, moved(2.0, 0.0, (4, 5)))
    assert np.array_equal(got[..., :2], current[..., :2])
    assert not np.isclose(got[..., 2:], current[..., 2:]).all()


def test_a_mask_of_the_caller_counts():
    current, history = image((3, 3), 103), image((3, 3), 104)
    mask = np.eye(3, dtype=bool)
    still = from_velocity(np.zeros((2, 1, 1)), shape=(3, 3))
    got = resolve(current, history, still._replace(valid=mask))
    assert np.array_equal(got, np.where(mask, resolve(current, history), current))


def test_a_motion_by_cameras_holds_an_image_fast():
    """A wall at 4 m with a pattern of its own, seen by a camera that steps aside by one pixel a frame, is a history
    fetched at centres: the result is the pattern, exactly, wherever it was seen before."""
    pattern = image((6, 20), 105, largest=2.0)
    step = 4.0 * 2.0 * (8 / 6) / 8  # metres per pixel at 4 m: 90° upright, 8 × 6 pixels
    views = [Camera(position=(k * step, 0, 0), target=(k * step, 0, -1), vertical_fov=90, width=8, height=6)
             for k in range(4)]
    history = None
    for k, view in enumerate(views):
        now = pattern[:, :, k:k + 8]
        pixels = motion(np.full((1, 1), 4.0), view, views[max(k - 1, 0)])
        history = resolve(now, history, pixels, clip="off")
        assert np.abs(history - now).max() < 1e-13


# --- stored in float16 ------------------------------------------------------------------------------


@pytest.mark.parametrize("rounding", ["nearest", "truncate"])
def test_the_tone_map_is_safe_in_float16(rounding):
    """D9: random images up to float16's largest number, stored in it between frames, moving and overshooting. Nothing
    becomes an infinity; what is constant stays to the bit."""
    random = np.random.default_rng(111)
    bright = store((65504.0 * random.random((3, 12, 12), np.float32)**4), "float16")
    bright[:, 4:8, 4:8] = 65504.0
    history = bright
    for frame in range(60):
        pixels = from_velocity(random.normal(0.0, 1.0, (2, 12, 12)).astype(np.float32))
        history = store(resolve(bright, history, pixels, largest=65504.0, clip="off" if frame % 2 else "line"),
                        "float16", rounding=rounding)
        assert np.isfinite(history).all()
        assert history.max() <= 65504.0
    flat = np.full((3, 4, 4), np.float32(65504.0))
    history = flat
    for _ in range(60):
        history = store(resolve(flat, history, moved(0.4, 0.3, (4, 4)), largest=65504.0), "float16", rounding=rounding)
    assert np.array_equal(history[:, 1:, 1:], flat[:, 1:, 1:])


def test_an_overshoot_beyond_float16_lasts_one_frame_without_a_largest():
    edge = grey(np.repeat([[0.0, 65504.0]], 4, axis=1) + np.zeros((8, 1)))
    over = resolve(edge, edge, moved(0.5, 0.0, (8, 8)), clip="off")
    assert over.max() > 65520.0
    stored = store(over, "float16")
    assert np.isinf(stored).any()
    assert np.isfinite(resolve(edge, stored)).all()


def test_carried_weights_keep_what_one_minus_luma_loses():
    """D9. Two grey images of luma L and 1.001·L, α = ½, in float32. In exact arithmetic the result is their mean by the
    weights 1/(1 + L). Carried: within 4 ulp at any brightness (measured 1.2e-7). From the mapped luma the error grows
    as L·2⁻²⁴ and is all of it from 1e7 on; with the luma bounded it is at least finite."""
    for level, least, most in ((1e2, 1e-8, 1e-4), (1e4, 1e-5, 1e-2), (1e6, 1e-3, 1.0)):
        now, then = (np.full((3, 3, 3), level * f, np.float32) for f in (1.0, 1.001))
        a, b = float(now[0, 0, 0]), float(then[0, 0, 0])
        exact = (a / (1 + a) + b / (1 + b)) / (1 / (1 + a) + 1 / (1 + b))
        carried = float(resolve(now, then, alpha=0.5, clip="off")[0, 1, 1])
        from_luma = float(resolve(now, then, alpha=0.5, clip="off", inverse="luma")[0, 1, 1])
        assert abs(carried / exact - 1.0) < 4 * 2.0**-23
        assert least < abs(from_luma / exact - 1.0) < most
    huge = np.full((3, 2, 2), 1e9, np.float32)
    assert np.isinf(resolve(huge, huge, **PUBLISHED)).any()
    assert np.isfinite(resolve(huge, huge, **PUBLISHED | {"largest_luma": FLOAT16_LARGEST_LUMA})).all()
    assert np.array_equal(resolve(huge, huge), huge)


colours = hnp.arrays(np.float64, (3, 3, 3), elements=st.floats(0.0, 1e6))


@given(colours, colours, st.floats(0.01, 1.0), st.floats(0.0, 3.0), st.sampled_from(["ycocg", "rgb"]))
def test_never_brighter_than_all_that_goes_in(current, history, alpha, gamma, space):
    """The middle of 3×3 lies, in each channel, within the nine pixels and the history; 16 roundings of the largest
    are allowed, for a clipped colour is a quotient of means."""
    got = resolve(current, history, alpha=alpha, gamma=gamma, space=space)[:, 1, 1]
    everything = np.concatenate([current.reshape(3, 9), history[:, 1, 1:2]], axis=1)
    slack = 16 * EPS * everything.max(axis=1)
    assert (got >= everything.min(axis=1) - slack).all()
    assert (got <= everything.max(axis=1) + slack).all()


@given(colours, colours, st.floats(0.0, 3.0), st.sampled_from(["line", "clamp"]), st.sampled_from(["ycocg", "rgb"]))
def test_a_clipped_history_lies_in_the_box(current, history, gamma, clip, space):
    """What α → 0 leaves is the clipped history: tone-mapped it is within γ deviations, and history inside stays as it
    is, but for a rounding and what is left of the current colour: 1e-18 times the weights' ratio of up to 1e6 + 1, both
    of the larger one. Roundings of a mapped colour, of up to 13.9 per channel. Clamped channels below 0 are cut."""
    got = resolve(current, history, alpha=1e-18, gamma=gamma, clip=clip, space=space)[:, 1, 1]
    into = to_ycocg if space == "ycocg" else same
    taps = np.array([into(tone(c)) for c in current.reshape(3, 9).T.tolist()])
    mean, half = taps.mean(axis=0), gamma * taps.std(axis=0)
    if clip == "clamp" and (got <= 2e-12 * current[:, 1, 1]).any():  # cut: no more is there than is left of the current
        return
    if clip == "clamp" and luma(got) > 1e6:  # T came near a luma of 1, or beyond it, and was bounded
        return
    reached = np.array(into(tone(got.tolist())))
    slack = 1e-13 if clip == "line" else 1e-9
    assert (np.abs(reached - mean) <= half + slack).all()
    before = np.array(into(tone(history[:, 1, 1].tolist())))
    if (np.abs(before - mean) < half - 1e-12).all():
        assert np.abs(got - history[:, 1, 1]).max() <= 2e-12 * max(current[:, 1, 1].max(), history[:, 1, 1].max())


# --- what it is for ---------------------------------------------------------------------------------


def half_plane(shape, x, y, angle, offset):
    """1 where n·p < offset, n at an angle, of points (x, y) in pixels."""
    return (np.cos(angle) * x + np.sin(angle) * y < offset).astype(np.float64) + np.zeros(shape)


def covered(j, i, angle, offset):
    """Area of pixel (i, j) with n·p < offset: its square, cut by the line."""
    corners = [(i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1)]
    side = [math.cos(angle) * x + math.sin(angle) * y - offset for x, y in corners]
    kept = []
    for k in range(4):
        (x0, y0), (x1, y1), a, b = corners[k - 1], corners[k], side[k - 1], side[k]
        if (a < 0) != (b < 0):
            kept.append((x0 + (x1 - x0) * a / (a - b), y0 + (y1 - y0) * a / (a - b)))
        if b < 0:
            kept.append((x1, y1))
    return 0.5 * sum(kept[k - 1][0] * kept[k][1] - kept[k][0] * kept[k - 1][1] for k in range(len(kept)))


SIZE, ANGLE, OFFSET = (16, 16), 0.35, 9.3
AREA = np.array([[covered(j, i, ANGLE, OFFSET) for i in range(16)] for j in range(16)])
EDGE = (AREA > 0.0) & (AREA < 1.0)


def sampled(frame, points="centred", level=1.0):
    dx, dy = pixel_offsets(frame, points=points)
    x, y = np.arange(16) + 0.5 + dx, np.arange(16)[:, None] + 0.5 + dy
    return grey(level * half_plane(SIZE, x, y, ANGLE, OFFSET))


def settled(frames=320, average=16, **options):
    """The mean image of the last cycles of a still camera."""
    history, total = None, np.zeros((3, *SIZE))
    for frame in range(frames):
        history = resolve(sampled(frame, options.get("points", "centred")), history,
                          **{k: v for k, v in options.items() if k != "points"})
        total += history if frame >= frames - average else 0.0
    return (total / average)[0]


def rms(difference):
    return float(np.sqrt((difference[EDGE]**2).mean()))


def test_a_still_edge_becomes_its_area():
    """Linear and unclipped the mean of a cycle is the mean of its 16 samples. Measured, root mean square over the 21
    pixels on the edge: 0.252 for one frame without jitter, 0.035 for the cycle's mean whatever α; with the published
    points, which shift the edge, 0.047."""
    alone = half_plane(SIZE, np.arange(16) + 0.5, np.arange(16)[:, None] + 0.5, ANGLE, OFFSET)
    plain = np.mean([sampled(frame)[0] for frame in range(16)], axis=0)
    assert EDGE.sum() == 21
    assert rms(alone - AREA) > 0.25
    assert rms(plain - AREA) < 0.036
    assert rms(np.mean([sampled(frame, "published")[0] for frame in range(16)], axis=0) - AREA) > 0.045
    for alpha in (0.02, 0.1):
        mean = settled(640, tone_mapping=False, clip="off", alpha=alpha)
        # A cycle's mean of a filtered periodic signal is the signal's; (1 − α)^624 of the first frame is left.
        assert np.abs(mean - plain).max() < 2.0 * (1.0 - alpha)**624 / (16 * alpha) + 1e-12
    running = None
    for n in range(16):  # equal weights
        running = resolve(sampled(n), running, tone_mapping=False, clip="off", alpha=1.0 / (n + 1))
    assert np.abs(running[0] - plain).max() < 32 * EPS
    assert np.abs(plain - AREA)[~EDGE].max() == 0.0


def test_every_frame_of_a_still_edge_is_near_its_area():
    """No cycle is averaged: one image alone. Measured 0.041 to 0.062 at α = 0.1, 0.033 to 0.037 at 0.02; what exceeds
    0.035 is the ripple of a running average."""
    for alpha, least, most in ((0.1, 0.037, 0.065), (0.02, 0.03, 0.038)):
        errors = [rms(settled(320 + k, average=1, tone_mapping=False, clip="off", alpha=alpha) - AREA)
                  for k in range(0, 16, 2)]
        assert least < max(errors) < most


def test_more_points_come_nearer():
    """Equal weights over 4, 16 and 64 points; measured 0.095, 0.035 and 0.011."""
    errors = []
    for count in (4, 16, 64):
        total = np.zeros(SIZE)
        for dx, dy in pixel_offsets(np.arange(count), count=count):
            total += half_plane(SIZE, np.arange(16) + 0.5 + dx, np.arange(16)[:, None] + 0.5 + dy, ANGLE, OFFSET)
        errors.append(rms(total / count - AREA))
    assert errors[0] > 2.0 * errors[1] > 4.0 * errors[2]


def test_tone_mapped_an_edge_becomes_its_mapped_area():
    """At coverage a between 0 and 1: mapped a·½, so a/(2 − a), darker than a by up to 0.172 (at a = 2 − √2)."""
    plain = np.mean([sampled(frame)[0] for frame in range(16)], axis=0)
    history = None
    for n in range(16):
        history = resolve(sampled(n), history, clip="off", alpha=1.0 / (n + 1))
    assert np.abs(history[0] - plain / (2.0 - plain)).max() < 64 * EPS
    assert rms(history[0] - AREA / (2.0 - AREA)) < 0.042


def test_clipping_costs_a_still_edge_some_of_its_area():
    """The box of the frame at hand takes away what it does not show. Measured root mean square of the cycle's mean,
    linear, α = 0.1: 0.035 unclipped and for γ from 1.5 on, 0.033 for γ = 1, 0.101 for γ = ½. With all defaults 0.039
    from the mapped area, and 0.111 from the linear one."""
    error = {gamma: rms(settled(tone_mapping=False, gamma=gamma) - AREA) for gamma in (0.5, 1.0, 1.5)}
    assert error[1.0] < 0.036
    assert error[0.5] > 0.09
    assert error[1.5] == pytest.approx(rms(settled(tone_mapping=False, clip="off") - AREA), abs=1e-15)
    default = settled()
    assert rms(default - AREA / (2.0 - AREA)) < 0.042
    assert rms(default - AREA) > 0.1


def test_published_points_shift_the_image():
    """A slope of 1 per pixel comes out shifted by the points' mean: 15/512 and 1/27 of a pixel; centred by nothing."""
    shift = {}
    for points in ("centred", "published"):
        history = None
        for n in range(16):
            dx, dy = pixel_offsets(n, points=points)
            ramp = 20.0 + (np.arange(8) + dx) + 2.0 * (np.arange(8)[:, None] + dy)
            history = resolve(grey(ramp), history, tone_mapping=False, clip="off", alpha=1.0 / (n + 1))
        shift[points] = history[0] - (20.0 + np.arange(8) + 2.0 * np.arange(8)[:, None])
    assert np.abs(shift["centred"]).max() < 1e-13
    assert shift["published"] == pytest.approx(np.full((8, 8), -15 / 512 - 2 / 27), abs=1e-13)


def ghost(frames=24, **options):
    """Light that a bright square, 6 wide and 2 pixels a frame fast, leaves behind it, in shares of its own; and how
    much of that lies farther behind than the pixel next to it."""
    history, dark, bright = None, 0.1, 10.0
    for frame in range(frames):
        scene = np.full((16, 72), dark)
        scene[5:11, 2 * frame:2 * frame + 6] = bright
        history = resolve(grey(scene), history, **options)
    behind = np.maximum(history[0, :, :2 * frame] - dark, 0.0) / (36 * (bright - dark))
    return float(behind.sum()), float(behind[:, :-1].sum())


def test_clipping_takes_the_ghost_away():
    """α = 0.1, no velocity told. Measured, linear: 0.813 unclipped, 0.098 clipped; tone-mapped 0.093 and 0.026. What is
    left lies in the pixel next to the square, whose box reaches into it; beyond, boxes are a point and nothing is left.
    γ = 2 leaves 0.054. The program's pad and least variance leave 2e-4 farther behind."""
    # Linear: frame f, which lit the columns 2f to 2f + 5, still weighs 0.1·0.9^(23 − f), the first one 0.9^23.
    weights = [0.9**23, *(0.1 * 0.9**(23 - f) for f in range(1, 24))]
    expected = sum(weights[f] for column in range(46) for f in range(24) if 2 * f <= column < 2 * f + 6) / 6.0
    assert ghost(clip="off", tone_mapping=False)[0] == pytest.approx(expected, abs=1e-13)
    for options, unclipped, clipped in (({"tone_mapping": False}, 0.81, 0.1), ({}, 0.093, 0.026)):
        assert ghost(clip="off", **options)[0] > unclipped
        for way in ({}, {"clip": "clamp"}, {"space": "rgb"}):
            total, farther = ghost(**options, **way)
            assert total < clipped
            assert farther < 1e-14
    assert 0.05 < ghost(gamma=2.0)[0] < 0.06
    assert 1e-4 < ghost(alpha=0.05, **AUTHOR)[1] < 5e-4


def test_velocity_takes_the_ghost_away_too():
    """The square's pixels told their motion, nothing clipped. Uncovered ground finds the square in its history."""
    history, shape = None, (16, 72)
    for frame in range(24):
        inside = np.zeros(shape, bool)
        inside[5:11, 2 * frame:2 * frame + 6] = True
        pixels = from_velocity(np.stack([np.where(inside, 2.0, 0.0), np.zeros(shape)]))
        history = resolve(grey(np.where(inside, 10.0, 0.1)), history, pixels, clip="off")
        assert np.array_equal(history[:, inside], np.full((3, 36), 10.0))
    with_both = resolve(grey(np.where(inside, 10.0, 0.1)), history, pixels)
    assert np.abs(with_both[:, :, :40] - 0.1).max() < 1e-12


def test_gamma_of_nothing_is_the_mean_of_the_neighbours():
    """γ = 0: the history is the mean of the nine, so the result a blend of the image with its blur."""
    current, history = image((6, 7), 121), image((6, 7), 122)
    got = resolve(current, history, gamma=0.0, alpha=0.25, tone_mapping=False)
    blur = sum(current[:, 1 + j:5 + j, 1 + i:6 + i] for j in (-1, 0, 1) for i in (-1, 0, 1)) / 9.0
    assert np.abs(got[:, 1:-1, 1:-1] - (0.25 * current[:, 1:-1, 1:-1] + 0.75 * blur)).max() < 16 * EPS * 4.0


def test_exposure_scales_the_history():
    """A12: with twice the exposure a history of half the numbers is the same image."""
    current = image((4, 5), 131)
    history = image((4, 5), 132)
    assert np.array_equal(resolve(current, 0.5 * history, exposure_ratio=2.0), resolve(current, history))


# --- bad input --------------------------------------------------------------------------------------

ONE = np.ones((3, 4, 5))


@pytest.mark.parametrize(("call", "line"), [
    (lambda: resolve(ONE, np.ones((3, 5, 4))), "history: has shape (3, 5, 4), must be (3, 4, 5), or 1 along y or x"),
    (lambda: resolve(ONE, np.ones((4, 5))), "history: has shape (4, 5), must be (3, h, w)"),
    (lambda: resolve(ONE[:2], None), "current: has shape (2, 4, 5), must be (3, h, w)"),
    (lambda: resolve(ONE[:, :0], None), "current: has shape (3, 0, 5), must be (3, h, w)"),
    (lambda: resolve(ONE, ONE, moved(0, 0, (4, 4))), "pixels: are of an image of (4, 4), must be of (4, 5)"),
    (lambda: resolve(ONE, ONE, alpha=0.0), "alpha: is 0.0, must be above 0 and at most 1"),
    (lambda: resolve(ONE, ONE, alpha=1.5), "alpha: is 1.5, must be above 0 and at most 1"),
    (lambda: resolve(ONE, ONE, alpha=NAN), "alpha: is nan, must be above 0 and at most 1"),
    (lambda: resolve(ONE, ONE, alpha=np.ones((3, 5))), "alpha: has shape (3, 5), must be (4, 5), or 1 along y or x"),
    (lambda: resolve(ONE, ONE, gamma=-1.0), "gamma: is -1.0, must be a finite number, at least 0"),
    (lambda: resolve(ONE, ONE, gamma=NAN), "gamma: is nan, must be a finite number, at least 0"),
    (lambda: resolve(ONE, ONE, padding=INF), "padding: is inf, must be a finite number, at least 0"),
    (lambda: resolve(ONE, ONE, clip="box"), "clip: is 'box'; known: clamp, line, off"),
    (lambda: resolve(ONE, ONE, space="ycocq"), "space: is 'ycocq'; did you mean 'ycocg'?"),
    (lambda: resolve(ONE, ONE, border="wrap"), "border: is 'wrap'; known: inside, repeat, zero"),
    (lambda: resolve(ONE, ONE, inverse="exact"), "inverse: is 'exact'; known: carried, luma"),
    (lambda: resolve(ONE, ONE, kernel="cubic"), "kernel: is 'cubic'; did you mean"),
    (lambda: resolve(ONE, ONE, largest_luma=1.5), "largest_luma: is 1.5, must be above 0 and at most 1"),
    (lambda: resolve(ONE, ONE, largest=0.0), "largest: is 0.0, must be a finite number above 0"),
    (lambda: resolve(ONE, ONE, exposure_ratio=-1.0), "exposure_ratio: is -1.0, must be a finite number, at least 0"),
    (lambda: pixel_offsets(0.5), "frame: is 0.5, must be a whole number"),
    (lambda: pixel_offsets(0, points="mean"), "points: is 'mean'; known: centred, published"),
    (lambda: pixel_offsets(0, count=65), "count: is 65, must be a whole number, 1 to 64"),
    (lambda: author_alpha(ONE[0], ONE[0], (0.0, NAN)), "offset: is (0.0, nan), must be two finite numbers"),
    (lambda: fetch_history(ONE[0, 0], ONE[0], ONE[0]), "history: has shape (5,), must have 2 axes, or 3 with channels"),
    (lambda: fetch_history(ONE, ONE[0], ONE[0], kernel="spline"), "kernel: is 'spline'; did you mean 'bilinear'?"),
])
def test_bad_input_is_one_line(call, line):
    with pytest.raises(InputError) as caught:
        call()
    assert str(caught.value).startswith(line)
    assert "\n" not in str(caught.value)


def test_a_motion_may_be_made_by_hand():
    x, y = np.array([[1.0, 1.5]]), np.array([[0.5]])
    got = resolve(grey([[1.0, 1.0]]), grey([[2.0, 6.0]]), Motion(x, y, np.array([[True]]), (1, 2)), clip="off",
                  kernel="bilinear", tone_mapping=False, alpha=0.5)
    assert got[0].tolist() == [[2.5, 3.5]]
