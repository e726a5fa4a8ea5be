"""FLIP as a norm: what the package lets pass does not pass here, and what it is told is what it does."""

from __future__ import annotations

import importlib.util
import itertools
import math

import numpy as np
import pytest

from froxel_ref.compare import Norm, absolute, order
from froxel_ref.flip import (
    PIXELS_PER_DEGREE,
    TONE_MAPPERS,
    filter_reach,
    flip,
    flip_available,
    flip_map,
    scaled_pixels_per_degree,
)
from froxel_ref.records import InputError

needs_package = pytest.mark.skipif(importlib.util.find_spec("flip_evaluator") is None,
                                   reason="flip-evaluator (extra 'flip') is not installed")
NAN, INF = math.nan, math.inf


def constant(*colour: float, size: tuple[int, int] = (24, 24), dtype: type = np.float64) -> np.ndarray:
    return np.broadcast_to(np.array(colour, dtype)[:, None, None], (3, *size)).copy()


def picture(size: tuple[int, int] = (40, 56)) -> np.ndarray:
    """Soft waves under a grid of bright points: edges, points and flat parts."""
    y, x = np.mgrid[:size[0], :size[1]]
    waves = np.stack([1.0 + np.sin(0.17 * x + 0.05 * y + shift) for shift in (0.0, 0.7, 1.9)])
    return 0.1 + 0.4 * waves + 2.0 * ((x % 13 == 5) & (y % 11 == 3))


# --- values that are known --------------------------------------------------------------------------


def tone_mapped(colour: tuple[float, ...], kind: str) -> list[float]:
    if kind == "reinhard":
        luma = 0.2126 * colour[0] + 0.7152 * colour[1] + 0.0722 * colour[2]
        out = [c / (1.0 + luma) for c in colour]
    elif kind == "aces":  # Narkowicz's fit, whose factor 0.6 before it is part of the published curve
        out = [(x := 0.6 * c) and (x * (2.51 * x + 0.03)) / (x * (2.43 * x + 0.59) + 0.14) for c in colour]
    else:
        out = [(0.231683 * c * c + 0.013791 * c) / (0.18 * c * c + 0.3 * c + 0.018) for c in colour]
    return [min(max(c, 0.0), 1.0) for c in out]


def hunt_lab(rgb: list[float]) -> tuple[float, float, float]:
    """CIELab of linear Rec. 709 under D65, its a and b times L/100 (the Hunt effect)."""
    rows = ((0.4123907993, 0.3575843394, 0.1804807884), (0.2126390059, 0.7151686788, 0.0721923154),
            (0.0193308187, 0.1191947798, 0.9505321522))
    white = [sum(row) for row in rows]
    x, y, z = ((t ** (1 / 3) if t > (6 / 29) ** 3 else t / (3 * (6 / 29) ** 2) + 4 / 29)
               for t in (sum(m * c for m, c in zip(row, rgb, strict=True)) / w
                         for row, w in zip(rows, white, strict=True)))
    lightness = 116 * y - 16
    return lightness, 0.01 * lightness * 500 * (x - y), 0.01 * lightness * 200 * (y - z)


def distance(one: list[float], other: list[float]) -> float:
    a, b = hunt_lab(one), hunt_lab(other)
    return abs(a[0] - b[0]) + math.hypot(a[1] - b[1], a[2] - b[2])


def constant_flip(one: tuple[float, ...], other: tuple[float, ...], kind: str) -> float:
    """Of two images of one colour each: no edges, no points, and filters leave a constant alone.

    The power 0.7 of the HyAB distance, over its largest, green against blue; the first 40 % of that are
    stretched over 95 % of the scale [Andersson 2020].
    """
    most = distance([0.0, 1.0, 0.0], [0.0, 0.0, 1.0]) ** 0.7
    error = distance(tone_mapped(one, kind), tone_mapped(other, kind)) ** 0.7
    knee = 0.4 * most
    return 0.95 * error / knee if error < knee else 0.95 + 0.05 * (error - knee) / (most - knee)


@needs_package
@pytest.mark.parametrize("kind", TONE_MAPPERS)
@pytest.mark.parametrize(("one", "other"), [
    ((0.0, 0.0, 0.0), (100.0, 100.0, 100.0)), ((0.0, 0.0, 0.0), (0.01, 0.02, 0.03)),
    ((0.5, 0.5, 0.5), (0.6, 0.5, 0.4)), ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0)), ((0.2, 0.9, 3.0), (0.3, 0.8, 2.0)),
    ((0.0, 1e4, 0.0), (0.0, 0.0, 1e4)),
])
def test_constant_images_have_a_closed_form(one: tuple[float, ...], other: tuple[float, ...], kind: str) -> None:
    """Worked out in float64 from the published formulas; the package has float32 (4e-5 measured)."""
    got = flip(constant(*one), constant(*other), exposure=1.0, tone_mapper=kind)
    assert got.value == pytest.approx(constant_flip(one, other, kind), abs=1e-4)
    assert got.pairs == 3 * 24 * 24


@needs_package
def test_the_ends_of_the_scale() -> None:
    """Equal is 0 exactly; green against blue is the largest there is; black against white 0.967."""
    same = flip(picture(), picture(), exposure=1.0)
    assert same == Norm("flip (aces, exposure 1, 67 px/°)", 0.0, 3 * 40 * 56)
    assert not flip_map(picture(), picture(), exposure=1.0).any()
    assert flip(constant(0, 1e6, 0), constant(0, 0, 1e6), exposure=1.0).value == pytest.approx(1.0, abs=1e-6)
    assert flip(constant(0, 0, 0), constant(1e6, 1e6, 1e6), exposure=1.0).value == pytest.approx(0.9674, abs=5e-5)


# --- properties -------------------------------------------------------------------------------------


@needs_package
@pytest.mark.parametrize("kind", TONE_MAPPERS)
def test_it_is_symmetric(kind: str) -> None:
    """Bit for bit: the exposure is taken from neither image."""
    rng = np.random.default_rng(2)
    a, b = picture(), picture() * rng.uniform(0.5, 1.5, (3, 40, 56))
    for exposure in (0.25, 1.0, 3.0):
        forth = flip_map(a, b, exposure=exposure, tone_mapper=kind)
        assert forth.max() > 0.05
        np.testing.assert_array_equal(forth, flip_map(b, a, exposure=exposure, tone_mapper=kind))


@needs_package
@pytest.mark.parametrize("pattern", ["noise", "brighter", "tinted", "one pixel"])
def test_it_grows_with_the_difference(pattern: str) -> None:
    rng = np.random.default_rng(3)
    truth = picture()
    change = {"noise": rng.uniform(-1, 1, truth.shape), "brighter": np.ones_like(truth),
              "tinted": np.array([1.0, 0.0, -1.0])[:, None, None] * np.ones_like(truth),
              "one pixel": np.zeros_like(truth)}[pattern]
    if pattern == "one pixel":
        change[:, 20, 30] = 5.0
    values = [flip(truth + 0.1 * t * change, truth, exposure=1.0).value for t in (0.0, 0.05, 0.1, 0.2, 0.4, 0.8)]
    assert values[0] == 0.0
    assert all(low < high for low, high in itertools.pairwise(values))


@needs_package
@pytest.mark.parametrize("degree", [8.0, 67.0])
def test_small_differences_count_by_their_power_and_end_in_rounding(degree: float) -> None:
    """Of a brighter image: slope 0.7 from 1e-2 to 1e-4 (0.707 and 0.713 measured); float32 as below 3e-5."""
    truth = picture()
    sizes = 10.0 ** -np.arange(2.0, 4.5, 0.5)
    values = [flip(truth * (1.0 + size), truth, exposure=1.0, pixels_per_degree=degree).value for size in sizes]
    assert order(sizes, values).order == pytest.approx(0.7, abs=0.03)
    rounded = flip(truth * (1.0 + 1e-7), truth, exposure=1.0, pixels_per_degree=degree).value
    assert 0.0 < rounded < 3e-5


@needs_package
@pytest.mark.parametrize("kind", TONE_MAPPERS)
def test_the_exposure_is_fixed(kind: str) -> None:
    """Images times a power of two and the exposure over it are the same images, bit for bit; the exposure alone not."""
    rng = np.random.default_rng(4)
    a, b = picture(), picture() * rng.uniform(0.5, 1.5, (3, 40, 56))
    first = flip_map(a, b, exposure=1.0, tone_mapper=kind)
    for k in (-40, -3, 1, 60):
        scaled = flip_map(a * 2.0**k, b * 2.0**k, exposure=2.0**-k, tone_mapper=kind)
        np.testing.assert_array_equal(scaled, first)
    dark = flip(a, b, exposure=2.0**-4, tone_mapper=kind).value
    bright = flip(a, b, exposure=16.0, tone_mapper=kind).value
    assert len({round(dark, 2), round(float(first.mean()), 2), round(bright, 2)}) == 3


@needs_package
@pytest.mark.parametrize("kind", TONE_MAPPERS)
@pytest.mark.parametrize("c", [-2.0, 0.0, 3.0])
def test_it_is_the_package_s_own_at_start_and_stop_exposure(kind: str, c: float) -> None:
    """The factor 2^c is the package's exposure c, one value for both ends; the magnitude is its own mean's."""
    import flip_evaluator

    rng = np.random.default_rng(5)
    b = picture().astype(np.float32)
    a = b * rng.uniform(0.5, 1.5, b.shape).astype(np.float32)
    theirs, mean, used = flip_evaluator.evaluate(
        np.moveaxis(b, 0, -1).copy(), np.moveaxis(a, 0, -1).copy(), "HDR", applyMagma=False,
        parameters={"startExposure": c, "stopExposure": c, "numExposures": 2, "ppd": 20.0, "tonemapper": kind})
    assert used["startExposure"] == used["stopExposure"] == c
    np.testing.assert_array_equal(flip_map(a, b, exposure=2.0**c, pixels_per_degree=20.0, tone_mapper=kind),
                                  theirs[..., 0])
    ours = flip(a, b, exposure=2.0**c, pixels_per_degree=20.0, tone_mapper=kind)
    assert ours.value == pytest.approx(mean, rel=1e-5)
    assert ours.name == f"flip ({kind}, exposure {2.0**c:g}, 20 px/°)"


@needs_package
def test_the_tone_mapper_is_passed() -> None:
    values = {kind: flip(1.2 * picture(), picture(), exposure=1.0, tone_mapper=kind).value for kind in TONE_MAPPERS}
    assert len({round(value, 3) for value in values.values()}) == 3


@needs_package
@pytest.mark.parametrize("degree", [8.0, 20.0, 40.0, 67.0])
def test_a_pixel_is_seen_as_far_as_the_filters_reach(degree: float) -> None:
    """A change right of a column is seen up to half the reach left of it, and not beyond the reach."""
    reach, column = filter_reach(degree), 30
    truth = constant(0.5, 0.5, 0.5, size=(24, 60))
    changed = truth.copy()
    changed[:, :, column:] = np.array([3.0, 0.1, 0.0])[:, None, None]
    seen = flip_map(changed, truth, exposure=1.0, pixels_per_degree=degree)
    assert reach == math.ceil(3 * math.sqrt(0.04 / (2 * math.pi**2)) * degree)
    assert not seen[:, :column - reach].any()
    assert (seen[:, column - (reach + 1) // 2] > 0.0).all()


@needs_package
def test_what_is_fine_is_less_seen_with_more_pixels_per_degree() -> None:
    """Until the pattern is a flat grey to the eye: what stays then is the tone mapper, whose mean is another."""
    y, x = np.mgrid[:60, :60]
    chequered = np.broadcast_to(0.2 + 0.1 * ((x + y) % 2), (3, 60, 60)).copy()
    values = [flip(chequered, constant(0.25, 0.25, 0.25, size=(60, 60)), exposure=1.0,
                   pixels_per_degree=degree).value for degree in (5.0, 10.0, 20.0, 40.0, 67.0)]
    assert all(high > low for high, low in itertools.pairwise(values))


@needs_package
@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_axes_of_length_one_stand_for_images_that_do_not_vary(dtype: type) -> None:
    """Along an axis without variation the border's repeats are the image itself; 2e-6 measured in float32."""
    rng = np.random.default_rng(6)
    row = rng.random((3, 1, 64)).astype(dtype)
    other = row * rng.uniform(0.7, 1.3, row.shape).astype(dtype)
    full = flip_map(np.repeat(other, 40, axis=1), np.repeat(row, 40, axis=1), exposure=1.0)
    narrow = flip_map(other, row, exposure=1.0)
    assert narrow.shape == (1, 64)
    assert narrow.dtype == np.float32
    np.testing.assert_allclose(full, np.broadcast_to(narrow, full.shape), atol=2e-5)
    assert flip(constant(1, 1, 1, size=(1, 1)), constant(0, 0, 0, size=(1, 1)), exposure=1.0).value == pytest.approx(
        flip(constant(1, 1, 1), constant(0, 0, 0), exposure=1.0).value, abs=1e-5)


# --- what does not pass -----------------------------------------------------------------------------


@needs_package
@pytest.mark.parametrize("bad", [NAN, INF, -INF])
@pytest.mark.parametrize("everywhere", [False, True])
def test_what_is_not_finite_is_a_fault_and_no_number(bad: float, everywhere: bool) -> None:
    """Also against black, to which the package alone scores NaN as equal."""
    black = constant(0.0, 0.0, 0.0)
    broken = black.copy()
    broken[(slice(None),) * 3 if everywhere else (1, 2, 3)] = bad
    for result, expected in ((broken, black), (black, broken)):
        norm = flip(result, expected, exposure=1.0)
        assert math.isnan(norm.value)
        assert not norm.within(INF)
        assert (norm.fault, norm.place) == (absolute(result, expected).fault, (0, 0, 0) if everywhere else (1, 2, 3))
        assert ("NaN" if math.isnan(bad) else "inf") in norm.fault
        seen = flip_map(result, expected, exposure=1.0)
        assert np.isnan(seen).sum() == (seen.size if everywhere else 1)
        assert everywhere or np.isnan(seen[2, 3])


@needs_package
def test_the_package_alone_lets_them_pass() -> None:
    """Why this module checks first, and asks for two exposures and small letters: if this fails, it need not."""
    import flip_evaluator

    def alone(result: np.ndarray, **changed: object) -> float:
        how = {"startExposure": 0.0, "stopExposure": 0.0, "numExposures": 2, "tonemapper": "aces", "ppd": 67.0}
        return flip_evaluator.evaluate(black, result, "HDR", applyMagma=False, parameters=how | changed)[1]

    black = np.zeros((24, 24, 3), np.float32)
    one = np.ones_like(black)
    assert alone(NAN * one) == 0.0
    assert alone(one, numExposures=1) == 0.0
    assert alone(one, tonemapper="Hable") == alone(one) != alone(one, tonemapper="hable")
    assert alone(-one) > 0.96
    assert alone(np.float32(1e20) * one) == 0.0


@needs_package
@pytest.mark.parametrize("bad", [NAN, INF])
def test_what_is_not_finite_in_both_enters_no_mean(bad: float) -> None:
    truth, result = picture(), 1.2 * picture()
    both = [image.copy() for image in (result, truth)]
    for image in both:
        image[:, 7, 9] = bad
    black = [image.copy() for image in (result, truth)]
    for image in black:
        image[:, 7, 9] = 0.0
    norm, seen = flip(*both, exposure=1.0), flip_map(*both, exposure=1.0)
    held = flip_map(*black, exposure=1.0)
    outside = np.ones(held.shape, bool)
    outside[7, 9] = False
    assert np.isnan(seen[7, 9])
    np.testing.assert_array_equal(seen[outside], held[outside])
    assert norm.value == pytest.approx(held[outside].mean(dtype=np.float64), rel=1e-12)
    assert (norm.fault, norm.pairs) == ("", 3 * (40 * 56 - 1))
    both[0][0, 7, 9] = both[1][0, 7, 9] = 0.5  # one channel is finite again: the pixel counts
    seen, norm = flip_map(*both, exposure=1.0), flip(*both, exposure=1.0)
    assert np.isfinite(seen).all()
    assert norm.value == pytest.approx(seen.mean(dtype=np.float64), rel=1e-12)
    assert norm.pairs == 3 * (40 * 56 - 1) + 1
    assert flip(constant(bad, bad, bad), constant(bad, bad, bad), exposure=1.0)[1:3] == (0.0, 0)


@needs_package
@pytest.mark.parametrize("kind", TONE_MAPPERS)
def test_below_black_is_black(kind: str) -> None:
    black, below = constant(0, 0, 0), constant(-1, -30, -1e-3)
    assert flip(below, black, exposure=1.0, tone_mapper=kind).value == 0.0
    grey = constant(0.2, 0.2, 0.2)
    assert flip(below, grey, exposure=1.0, tone_mapper=kind) == flip(black, grey, exposure=1.0, tone_mapper=kind)


@needs_package
@pytest.mark.parametrize("kind", TONE_MAPPERS)
def test_the_largest_numbers_are_white(kind: str) -> None:
    """Above 1.8e19 a square overflows in float32; above 3.4e38 the number itself."""
    black = constant(0, 0, 0)
    for bright in (1e17, 1e20, 1e60, 1.7e308):
        norm = flip(constant(bright, bright, bright), black, exposure=4.0, tone_mapper=kind)
        assert norm.value == pytest.approx(0.9674, abs=5e-5)


@needs_package
def test_precisions_agree() -> None:
    """float64 input is rounded to float32 once it is exposed."""
    a, b = (image.astype(np.float32) for image in (1.2 * picture(), picture()))
    wide = flip_map(a.astype(np.float64), b.astype(np.float64), exposure=0.5)
    np.testing.assert_array_equal(wide, flip_map(a, b, exposure=0.5))


@pytest.mark.parametrize("function", [flip, flip_map])
@pytest.mark.parametrize(("changed", "place", "words"), [
    ({"result": constant(1, 1, 1, dtype=np.float32)}, "result", "float32, must be float64"),
    ({"result": constant(1, 1, 1, size=(24, 25))}, "result", "shape"),
    ({"result": constant(1, 1, 1).astype(int)}, "result", "int64"),
    ({"result": np.ones((3, 0, 24)), "expected": np.ones((3, 0, 24))}, "result", "nothing to compare"),
    ({"result": np.ones((24, 24, 3)), "expected": np.ones((24, 24, 3))}, "result", "must be (3, height, width)"),
    ({"result": np.ones((3, 24)), "expected": np.ones((3, 24))}, "result", "must be (3, height, width)"),
    ({"result": np.ones((3, 20, 24)), "expected": np.ones((3, 20, 24))}, "result", "24 × 20 pixels, must be at least"),
    ({"pixels_per_degree": 100.0}, "result", "at least 29 × 29 at 100 pixels per degree"),
    ({"pixels_per_degree": 1.9}, "pixels_per_degree", "at least 2"),
    ({"pixels_per_degree": NAN}, "pixels_per_degree", "nan"),
    ({"pixels_per_degree": INF}, "pixels_per_degree", "inf"),
    ({"exposure": 0.0}, "exposure", "0.0, must be above 0"),
    ({"exposure": -1.0}, "exposure", "-1.0"),
    ({"exposure": INF}, "exposure", "inf"),
    ({"exposure": NAN}, "exposure", "nan"),
    ({"tone_mapper": "Hable"}, "tone_mapper", "did you mean 'hable'?"),
])
def test_bad_input_is_refused(function, changed, place, words) -> None:
    arguments = {"result": constant(1, 1, 1), "expected": constant(1, 1, 1), "exposure": 1.0} | changed
    with pytest.raises(InputError) as caught:
        function(arguments.pop("result"), arguments.pop("expected"), **arguments)
    assert caught.value.place == place
    assert words in caught.value.problem


def test_without_the_package_it_says_what_to_do(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    assert not flip_available()
    for function in (flip, flip_map):
        with pytest.raises(InputError, match=r"^flip: needs the extra flip: python -m pip install -e '\.\[flip\]'$"):
            function(constant(1, 1, 1), constant(1, 1, 1), exposure=1.0)


def test_pixels_per_degree_go_with_the_width() -> None:
    assert pytest.approx(0.7 * (3840 / 0.7) * math.pi / 180, rel=1e-3) == PIXELS_PER_DEGREE
    assert scaled_pixels_per_degree(1920, 3840) == 33.5
    assert scaled_pixels_per_degree(3840, 3840) == 67.0
    assert scaled_pixels_per_degree(160, 1280, pixels_per_degree=40.0) == 5.0
    for arguments, place in (((0, 10), "width"), ((10, 0), "full_width")):
        with pytest.raises(InputError) as caught:
            scaled_pixels_per_degree(*arguments)
        assert caught.value.place == place
    with pytest.raises(InputError, match="pixels_per_degree"):
        scaled_pixels_per_degree(10, 10, pixels_per_degree=INF)
    with pytest.raises(InputError, match="pixels_per_degree"):
        filter_reach(1.0)
