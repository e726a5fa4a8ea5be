"""Remedies of ghosting: neighbourhoods by slow loops, what they do to steps and what to noise."""

from __future__ import annotations

import itertools
import math
import statistics
from collections.abc import Iterator
from fractions import Fraction
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from froxel_ref.checkerboard import computed, fill
from froxel_ref.ghosting import METHODS, adaptive_alpha, clamp_history, neighbourhood_bounds, neighbourhood_moments
from froxel_ref.jitter import froxel_jitter
from froxel_ref.records import InputError
from froxel_ref.temporal import blend

EPS = 2.0**-52
shapes = st.tuples(*[st.integers(1, 5)] * 3)


def around(field: Any, known: Any) -> Iterator[tuple[tuple[int, ...], list[float]]]:
    """Every texel with the known values of its 3×3×3 neighbourhood."""
    for place in np.ndindex(field.shape):
        steps = itertools.product((-1, 0, 1), repeat=3)
        near = (tuple(p + s for p, s in zip(place, step, strict=True)) for step in steps)
        yield place, [float(field[q]) for q in near
                      if all(0 <= c < n for c, n in zip(q, field.shape, strict=True)) and known[q]]


# --- neighbourhoods -----------------------------------------------------------------------------------


@given(shape=shapes, seed=st.integers(0, 99), share=st.sampled_from([0.1, 0.5, 1.0]))
def test_bounds_by_a_slow_loop(shape: tuple[int, int, int], seed: int, share: float) -> None:
    rng = np.random.default_rng(seed)
    field, known = rng.standard_normal(shape), rng.random(shape) < share
    field[~known] = np.nan  # is not read
    least, most = neighbourhood_bounds(field, known=known)
    for place, near in around(field, known):
        assert least[place] == min(near, default=math.inf)
        assert most[place] == max(near, default=-math.inf)
    if share == 1.0:
        for got, expected in zip(neighbourhood_bounds(field), (least, most), strict=True):
            np.testing.assert_array_equal(got, expected)


@given(shape=shapes, seed=st.integers(0, 99), share=st.sampled_from([0.1, 0.5, 1.0]),
       offset=st.sampled_from([0.0, 1e6]))
def test_moments_by_a_slow_loop(shape: tuple[int, int, int], seed: int, share: float, offset: float) -> None:
    """Also far from 0, where √(E[x²] − E[x]²) has no digits left."""
    rng = np.random.default_rng(seed)
    field, known = offset + rng.standard_normal(shape), rng.random(shape) < share
    field = np.where(known, field, 7.0)
    mean, deviation = neighbourhood_moments(np.where(known, field, np.nan), known=known)
    for place, near in around(field, known):
        if not near:
            assert np.isnan(mean[place])
            assert deviation[place] == 0.0
            continue
        exact = [Fraction(v) for v in near]
        middle = sum(exact) / len(exact)
        # 26 values join the first in 6 steps, each with some 4 roundings of the mean.
        assert abs(mean[place] - float(middle)) <= 32 * EPS * max(abs(v) for v in near)
        spread = math.sqrt(sum((v - middle) ** 2 for v in exact) / len(exact))
        # Differences of values at 10⁶ are exact; their means there are rounded by 1e-10.
        assert deviation[place] == pytest.approx(spread, rel=1e-13 if offset == 0.0 else 1e-9, abs=1e-9 * bool(offset))
        if len(near) > 1:
            assert spread == pytest.approx(statistics.pstdev(near), rel=1e-9)


@given(shape=shapes, value=st.floats(-1e6, 1e6))
def test_a_constant_has_itself_as_bounds_and_no_deviation(shape: tuple[int, int, int], value: float) -> None:
    field = np.full(shape, value)
    least, most = neighbourhood_bounds(field)
    mean, deviation = neighbourhood_moments(field)
    assert (least == value).all()
    assert (most == value).all()
    assert (mean == value).all()
    assert (deviation == 0.0).all()


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_channels_types_and_axes_of_length_one(dtype: type) -> None:
    field = np.random.default_rng(3).random((3, 4, 1, 6)).astype(dtype)
    field.setflags(write=False)
    for function in (neighbourhood_bounds, neighbourhood_moments):
        got = function(field)
        assert {a.dtype for a in got} == {np.dtype(dtype)}
        assert {a.shape for a in got} == {field.shape}
        for channel in range(3):
            for a, b in zip(got, function(field[channel]), strict=True):
                np.testing.assert_array_equal(a[channel], b)
        # What does not vary along an axis has the same neighbourhoods when written out along it.
        for a, b in zip(got, function(np.repeat(field, 3, axis=2)), strict=True):
            np.testing.assert_allclose(np.repeat(a, 3, axis=2), b, rtol=20 * np.finfo(dtype).eps)


# --- clamping -----------------------------------------------------------------------------------------


@given(shape=shapes, seed=st.integers(0, 99), method=st.sampled_from(METHODS), gamma=st.sampled_from([0.0, 0.5, 2.0]))
def test_a_history_is_held_to_its_neighbourhood(shape: tuple[int, int, int], seed: int, method: str,
                                                gamma: float) -> None:
    rng = np.random.default_rng(seed)
    current, history = rng.random(shape), 3.0 * rng.standard_normal(shape)
    known = rng.random(shape) < rng.choice([0.05, 0.6])
    hole = rng.choice([np.nan, 0.0])  # is not read
    got = clamp_history(history, np.where(known, current, hole), method=method, gamma=gamma, known=known)
    for place, near in around(current, known):
        if not near:
            assert got[place] == history[place]
            continue
        low, high = min(near), max(near)
        if method == "variance":
            middle, spread = statistics.fmean(near), gamma * statistics.pstdev(near)
            low, high = middle - spread, middle + spread
        assert got[place] == pytest.approx(min(max(history[place], low), high), rel=1e-13, abs=1e-13)


def test_what_is_not_finite_stays_so() -> None:
    """So that blend still leaves it out."""
    history = np.array([np.nan, np.inf, -np.inf, 9.0]).reshape(1, 1, 4)
    current = np.array([1.0, 2.0, 3.0, 4.0]).reshape(1, 1, 4)
    for method in METHODS:
        got = clamp_history(history, current, method=method)
        np.testing.assert_array_equal(got[..., :3], history[..., :3])
        assert got[0, 0, 3] <= 4.0
        assert blend(current, got, True).ravel()[:3].tolist() == [1.0, 2.0, 3.0]


# --- adaptive weights ---------------------------------------------------------------------------------


@given(shape=shapes, seed=st.integers(0, 99), jump=st.sampled_from([0.0, 0.5, 1.0, 2.0, 30.0]))
def test_weights_by_a_slow_loop(shape: tuple[int, int, int], seed: int, jump: float) -> None:
    rng = np.random.default_rng(seed)
    current = rng.random((2, *shape))
    history = rng.random((2, *shape)) + jump * np.array([0.0, 1.0]).reshape(2, 1, 1, 1)
    got = adaptive_alpha(current, history, least=0.1, most=0.8, onset=0.5, width=2.0)
    assert got.shape == shape
    assert got.min() >= 0.1
    assert got.max() <= 0.8
    groups = [dict(around(channel, np.ones(shape, bool))) for channel in current]
    for place in np.ndindex(shape):
        departures = []
        for channel in range(2):
            near = groups[channel][place]
            apart, spread = abs(statistics.fmean(near) - history[channel][place]), statistics.pstdev(near)
            departures.append(apart / spread if spread else (math.inf if apart else 0.0))
        share = min(max((max(departures) - 0.5) / 2.0, 0.0), 1.0)
        assert got[place] == pytest.approx(0.1 + 0.7 * share, rel=1e-9)


def test_weights_where_nothing_deviates_or_nothing_was() -> None:
    current = np.ones((1, 2, 3), np.float32)
    assert adaptive_alpha(current, current).dtype == np.float32
    assert (adaptive_alpha(current, current) == np.float32(0.05)).all()
    assert (adaptive_alpha(current, current + np.float32(0.1)) == 0.5).all()
    assert (adaptive_alpha(current, np.full_like(current, np.nan)) == 0.5).all()
    assert (adaptive_alpha(current, np.full_like(current, np.inf)) == 0.5).all()


def test_the_border_of_a_linear_field_is_no_change() -> None:
    """There the mean leans inwards by half a step, which is the deviation: exactly the onset."""
    field = np.broadcast_to(np.arange(6.0), (4, 5, 6)).copy()
    assert adaptive_alpha(field, field).max() <= 0.05 + 4 * EPS
    # Where two and three axes end the mean leans by as many halves, the deviation by their root: √2 and √3.
    corner = sum(np.meshgrid(*[np.arange(5.0)] * 3, indexing="ij"))
    weights = adaptive_alpha(corner, corner)
    assert weights[1:-1, 1:-1].max() <= 0.05 + 4 * EPS
    assert weights[0, 0, 0] == pytest.approx(0.05 + 0.45 * (math.sqrt(3.0) - 1.0), rel=1e-12)


# --- over frames --------------------------------------------------------------------------------------

SHAPE = (12, 14, 16)
REMEDIES = ("none", "minmax", "variance", "adaptive")


def filtered(frames: list[Any], remedy: str, alpha: float, **options: Any) -> list[Any]:
    """The filtered volumes of frames as a camera at rest sees them."""
    history, result = frames[0], []
    for current in frames[1:]:
        weight: Any = alpha
        held = history
        if remedy in METHODS:
            held = clamp_history(history, current, method=remedy)
        if remedy == "adaptive":
            weight = adaptive_alpha(current, history, least=alpha, **options)
        history = blend(current, held, True, alpha=weight)
        result.append(history)
    return result


def vanishing(shape: tuple[int, ...], frames: int, after: int, seed: int = 0) -> list[Any]:
    """A light of 1 over a haze of 0.2 that goes out, with noise of a tenth of what there is."""
    rng = np.random.default_rng(seed)
    return [(1.2 if f < frames else 0.2) * (1.0 + 0.1 * rng.standard_normal(shape)) * np.ones(SHAPE)
            for f in range(frames + after)]


@pytest.mark.parametrize(("remedy", "alpha", "frames"), [
    ("none", 0.05, 59), ("none", 0.2, 14), ("minmax", 0.05, 1), ("minmax", 0.2, 1), ("variance", 0.05, 1),
    ("variance", 0.2, 1), ("adaptive", 0.05, 5), ("adaptive", 0.2, 5)])
def test_how_long_a_light_that_went_out_is_seen(remedy: str, alpha: float, frames: int) -> None:
    """Frames until less than 5 % of it are left, on average over the volume."""
    volumes = filtered(vanishing(SHAPE, 40, 65), remedy, alpha)
    left = np.array([v.mean() - 0.2 for v in volumes[39:]])
    assert int(np.argmax(np.abs(left) < 0.05)) + 1 == frames
    assert np.abs(left[frames:]).max() < 0.05


@pytest.mark.parametrize(("remedy", "alpha", "share"), [
    ("none", 0.05, 1.0), ("none", 0.2, 1.0), ("minmax", 0.05, 1.0), ("minmax", 0.2, 0.99), ("variance", 0.05, 0.985),
    ("variance", 0.2, 0.95), ("adaptive", 0.05, 1.0), ("adaptive", 0.2, 0.975)])
def test_independent_noise_is_filtered_as_before(remedy: str, alpha: float, share: float) -> None:
    """The variance that is left, over α/(2 − α). Less than 1: what is held to its neighbours is smoothed by them."""
    volumes = filtered(vanishing(SHAPE, 300, 0), remedy, alpha)[100:]
    left = np.mean([np.mean((v / 1.2 - 1.0) ** 2) for v in volumes]) / 0.1**2
    # 2688 texels in some 200·α independent frames: √(2/26880) = 0.9 % at 0.05.
    assert left * (2.0 - alpha) / alpha == pytest.approx(share, abs=0.03)


@pytest.mark.parametrize("remedy", METHODS)
def test_noise_that_all_froxels_share_is_not_filtered_any_more(remedy: str) -> None:
    """What a clamp cannot know: a neighbourhood that flickers as one is no change."""
    volumes = filtered(vanishing((1, 1, 1), 300, 0), remedy, 0.05)[100:]
    assert np.mean([np.mean((v / 1.2 - 1.0) ** 2) for v in volumes]) / 0.1**2 > 0.8  # without: 1/39


def test_adaptive_weights_can_be_told_of_shared_noise() -> None:
    """With that noise's deviation given it is filtered as before; what goes beyond the onset still goes at once."""
    frames = vanishing((1, 1, 1), 300, 10)
    told: dict[str, Any] = {"onset": 4.0, "deviation": np.full((1, 1, 1), 0.12)}
    plain = filtered(frames[:300], "none", 0.05)[100:]
    spread = [np.var([v.mean() for v in volumes]) for volumes in (
        plain, filtered(frames[:300], "adaptive", 0.05, **told)[100:], filtered(frames[:300], "adaptive", 0.05)[100:])]
    assert spread[1] == pytest.approx(spread[0], rel=1e-12)
    assert spread[2] > 10.0 * spread[0]  # measured 25
    gone = filtered(frames, "adaptive", 0.05, **told)[299:]
    assert gone[0].mean() - 0.2 < 0.51  # four deviations are 0.48
    assert filtered(frames, "none", 0.05)[299].mean() - 0.2 > 0.9


@pytest.mark.parametrize("remedy", ["none", "minmax"])
def test_a_jittered_linear_field_keeps_its_mean(remedy: str) -> None:
    """Its neighbourhood spans a froxel to either side of the sample, so the centre is always within."""
    z, y, x = np.ogrid[:6, :7, :8]
    frames = []
    for frame in range(32 * 14):
        jx, jy, jz = froxel_jitter(frame)
        frames.append(3.0 * (x + jx) - 2.0 * (y + jy) + 1.5 * (z + jz))
    mean = np.mean(filtered(frames, remedy, 0.05)[-32:], axis=0)
    error = np.abs(mean - (3.0 * (x + 0.5) - 2.0 * (y + 0.5) + 1.5 * (z + 0.5)))
    assert error[1:-1, 1:-1, 1:-1].max() < 1e-8  # 0.95^416 of the start


def test_a_moving_light_leaves_less_of_a_trail() -> None:
    """Half a froxel a frame; the mean square error against the light without noise, over that of no remedy."""
    rng = np.random.default_rng(9)
    z, y, x = np.ogrid[:10, :10, :40]

    def light(frame: int) -> Any:
        return np.exp(-((x - 5.0 - 0.5 * frame) ** 2 + (y - 5.0) ** 2 + (z - 5.0) ** 2) / 18.0) + 0.05

    frames = [light(f) * (1.0 + 0.05 * rng.standard_normal((10, 10, 40))) for f in range(60)]
    errors = {}
    for remedy in REMEDIES:
        volumes = filtered(frames, remedy, 0.05)
        errors[remedy] = np.mean([np.mean((v - light(f + 1)) ** 2) for f, v in enumerate(volumes) if f >= 20])
    relative = {remedy: errors[remedy] / errors["none"] for remedy in REMEDIES}
    assert relative["variance"] < relative["adaptive"] < 0.2  # measured 0.13 and 0.14
    assert relative["minmax"] < 0.35  # measured 0.28


def test_remedies_under_a_checkerboard_read_only_what_was_computed() -> None:
    """A light goes out: holes keep it in their history until that is held to the neighbours of this frame."""
    history, left = np.full(SHAPE, 1.0), []
    for frame in range(4):
        known = computed(SHAPE, frame)
        half = np.where(known, 0.0, np.nan)
        held = clamp_history(history, half, known=known)
        history = blend(fill(half, held, True, frame), held, True)
        left.append(history.max())
    assert left == [0.0] * 4


@pytest.mark.parametrize(("call", "words"), [
    (lambda f: clamp_history(f, f, method="min"), "did you mean 'minmax'|known"),
    (lambda f: clamp_history(f, f, gamma=-1.0), "gamma"), (lambda f: clamp_history(f, f, gamma=math.nan), "gamma"),
    (lambda f: adaptive_alpha(f, f, least=0.6), "least"), (lambda f: adaptive_alpha(f, f, most=1.5), "least"),
    (lambda f: adaptive_alpha(f, f, onset=-1.0), "onset"), (lambda f: adaptive_alpha(f, f, width=0.0), "width"),
])
def test_misuse_is_refused(call: Any, words: str) -> None:
    with pytest.raises(InputError, match=words):
        call(np.ones((1, 2, 3)))
