"""Numerical stability: the measuring itself, the registered kernels, what is written, the command."""

from __future__ import annotations

import csv
import html.parser
import json
import math
import re
import sys
from pathlib import Path

import mpmath
import numpy as np
import pytest
from PIL import Image

from froxel_ref import kernel_registry, stability
from froxel_ref.cli import main
from froxel_ref.display import NOT_A_NUMBER
from froxel_ref.records import InputError
from froxel_ref.stability import FAULTS, Kernel, Parameter, errors_in_ulp, examine, kernels, sample, sweep
from froxel_ref.stability_inputs import axis, map_of
from froxel_ref.stability_pictures import MARKS, error_plane, heat_map
from froxel_ref.tonemap import FLOAT16_LARGEST_LUMA, inverse_tone_map, luma, tone_map

ALL = kernels()
NAMES = [kernel.name for kernel in ALL]
SAMPLES = 40


@pytest.fixture(scope="module")
def found():
    """All kernels, examined once."""
    return {kernel.name: examine(kernel, SAMPLES) for kernel in ALL}


@pytest.fixture(scope="module")
def measures(found):
    return {(m.kernel, m.form, m.precision): m for each in found.values() for m in each.measures}


def first(kernel: Kernel) -> str:
    return next(iter(kernel.forms))


HELD = [(k.name, first(k), p) for k in ALL for p in k.precisions]


# --- the measuring ----------------------------------------------------------------------------------


@pytest.mark.parametrize(("value", "exact", "ulps"), [
    (1.0, 1, 0.0), (1.0 + 2**-52, 1, 1.0), (1.0 - 2**-53, 1, 0.5), (2.0 + 2**-51, 2, 1.0), (2.0 - 2**-52, 2, 0.5),
    (5e-324, 0, 1.0), (0.0, mpmath.mpf(2)**-1075, 0.5), (-1.0, 1, 2.0**53), (0.0, 1, 2.0**52)])
def test_errors_are_counted_in_spacings_at_the_exact_value(value, exact, ulps):
    assert errors_in_ulp(np.array([value]), [mpmath.mpf(exact)])[0][0] == ulps


def test_what_is_not_finite_or_beyond():
    big = mpmath.mpf(2)**1024
    values = np.array([np.nan, np.inf, np.inf, 1.0])
    errors = errors_in_ulp(values, [mpmath.mpf(1), mpmath.mpf(1), big, big])[0]
    assert errors[:2].tolist() == [math.inf, math.inf]
    assert np.isnan(errors[2:]).all()
    half = errors_in_ulp(np.array([np.inf, np.inf], np.float16), [mpmath.mpf(65504), mpmath.mpf(65520)])[0]
    assert half[0] == math.inf
    assert np.isnan(half[1])


def made(forms, exact=lambda mp, x: x, **options):
    x = Parameter("x", "1", "magnitude", 1e-3, 1e3, (1.0,))
    return Kernel("made", "tests", "for a test", (x,), forms, exact, **options)


@pytest.mark.parametrize(("form", "count"), [
    (lambda x: np.where(x > 1, np.nan, x), "not_a_number"), (lambda x: np.where(x > 1, np.inf, x), "infinite"),
    (lambda x: np.where(x > 1, -x, x), "negative"), (lambda x: np.where(x > 1, 3e3, x), "above"),
    (lambda x: np.where(x > 1, x, 0.5), "rising")])
def test_every_kind_of_failure_is_seen(form, count):
    """A kernel that is right below 1 and wrong above it, each time in another way."""
    kernel = made({"wrong": form}, at_most=2e3, falling=0 if count == "rising" else None)
    row = sweep([kernel], samples=50)[0]
    assert getattr(row, count) > 10
    assert not row.sound
    assert row.verdict == "fails"
    assert f"{getattr(row, count)} {FAULTS[count]}" in row.reason
    if count != "rising":
        others = {"not_a_number", "infinite", "negative", "above"} - {count}
        assert not any(getattr(row, other) for other in others)


def test_a_wrong_digit_is_seen_with_its_place():
    kernel = made({"right": lambda x: x, "wrong": lambda x: np.where(x == 1, np.nextafter(x, 2, dtype=x.dtype), x)})
    right, wrong = sweep([kernel._replace(precisions=("float64",))], samples=30)
    assert (right.worst, right.sound) == (0.0, True)
    assert (wrong.worst, wrong.place, wrong.worst_well) == (1.0, (1.0,), 1.0)
    # 30 random inputs, one by hand, and the map's, none of which is 1.
    assert wrong.cases == 31 + len(map_of(kernel, "float64").inputs[0])
    assert wrong.mean == pytest.approx(1.0 / wrong.cases)


def test_the_map_s_inputs_count_in_the_table():
    """A kernel that is wrong in a narrow band, which two random inputs miss, but one of 240 in a line does not."""
    wrong = made({"wrong": lambda x: np.where((x > 20) & (x < 23), -x, x)}, precisions=("float64",))
    [row] = sweep([wrong], samples=2)
    band = [(values > 20) & (values < 23) for values in (sample(wrong, 2, "float64").inputs[0],
                                                         map_of(wrong, "float64").inputs[0])]
    assert not band[0].any()
    assert row.negative == band[1].sum() > 0
    assert 20 < row.place[0] < 23


@pytest.mark.parametrize(("form", "exact", "verdict", "reason"), [
    (lambda x: x, lambda mp, x: x, "sound", ""),
    (lambda x: x * (1 + 9 * np.finfo(x.dtype).eps), lambda mp, x: x, "inexact", "ulp at a condition number below 4"),
    (lambda x: x * 0 + 1, lambda mp, x: x, "inexact", "ulp at a condition number below 4"),
    (lambda x: x * 0 + 1, lambda mp, x: mp.exp(mp.mpf(2)**40 * (x - 1)), "inexact", "ulp per 1 + condition number"),
    (lambda x: -x, lambda mp, x: x, "fails", " negative")])
def test_a_verdict_on_digits(form, exact, verdict, reason):
    """Nothing invalid is not enough: a constant 1 has no digit of x."""
    x = Parameter("x", "1", "linear", 1.0, 1.0 + 2.0**-36, (1.0 + 2.0**-37,))
    [row] = sweep([made({"made": form}, exact, precisions=("float64",))._replace(parameters=(x,))], samples=50)
    assert (row.verdict, row.sound) == (verdict, verdict == "sound")
    assert row.reason.endswith(reason)
    assert bool(row.reason) != row.sound


def test_infinity_is_no_fault_next_to_the_largest_number():
    """65519.9 is a float16; what 8·(1 + condition) roundings of float32 make of it may not be."""
    near, far = 65519.96, 65000.0
    for value, faults in ((near, 0), (far, 1)):
        x = Parameter("x", "1", "choice", 0.0, 1.0, (1.0,))
        kernel = made({"made": lambda x: x * np.inf}, lambda mp, x, v=value: x * v, precisions=("float16",))
        [row] = sweep([kernel._replace(parameters=(x,))], samples=2)
        assert (row.infinite > 0) == bool(faults)


@pytest.mark.parametrize(("exact", "condition"), [
    (lambda mp, x: x**3, 3.0), (lambda mp, x: mp.exp(-20 * x), 20.0), (lambda mp, x: mp.mpf(5), 0.0),
    (lambda mp, x: x - 1 + mp.mpf(10)**-6, 1e6), (lambda mp, x: mp.mpf(0), 0.0)])
def test_condition_numbers_by_hand(exact, condition):
    kernel, one = made({"any": lambda x: x}, exact), [np.ones(1)]
    found = stability.condition_numbers(kernel, one, stability.exact_values(kernel, one))
    assert found[0] == pytest.approx(condition, rel=1e-9, abs=0.0)


def test_inputs_are_half_near_1_and_half_everywhere():
    x = Parameter("x", "1", "magnitude", 1e-30, 1e30, (0.0, 5e-324))
    kernel = made({"any": lambda x: x})._replace(parameters=(x,))
    for precision, dtype in (("float64", np.float64), ("float32", np.float32), ("float16", np.float32)):
        [values] = sample(kernel, 1000, precision).inputs
        assert values.dtype == dtype
        drawn = values[:1000]
        assert ((drawn >= 0.5) & (drawn <= 2.0)).sum() == pytest.approx(505, abs=30)
        assert (drawn < 1e-10).sum() > 100
        assert (drawn > 1e10).sum() > 100
        assert values[-2] == 0.0
        assert values[-1] == np.finfo(dtype).smallest_subnormal  # never lost to the type
        assert np.array_equal(values, sample(kernel, 1000, precision).inputs[0])
    g = Parameter("g", "1", "share", -1.0, 1.0, (1.0 - 2.0**-52, -1.0 + 2.0**-52))
    [values] = sample(kernel._replace(parameters=(g,)), 1000, "float32").inputs
    assert (np.abs(values) < 1.0).all()
    assert (1.0 - np.abs(values) < 1e-3).sum() > 200


@pytest.mark.parametrize("parameter", [p for k in ALL for p in k.parameters], ids=str)
def test_ranges_are_ranges(parameter):
    assert parameter.low < parameter.high
    assert parameter.kind in ("magnitude", "share", "cosine", "linear", "choice")
    assert parameter.kind != "choice" or parameter.extremes


# --- the kernels ------------------------------------------------------------------------------------


def test_the_issue_s_extremes_are_tried():
    """σ from 0 over the least denormal to 1e8, optical depths to 1e30, g to ±(1 − 2⁻⁵²), 4096 slices, …"""
    extremes = {(k.name, p.name): p.extremes for k in ALL for p in k.parameters}
    assert {0.0, 5e-324, 1e8} <= set(extremes["slice_integral", "extinction"])
    assert 1e8 * max(extremes["slice_integral", "length"]) == 1e30
    assert {1 - 2.0**-52, -1 + 2.0**-52} <= set(extremes["henyey_greenstein", "g"])
    assert {0.0, 1e18} <= set(extremes["distance_attenuation", "squared distance"])  # 0 and 1e9 m
    assert 1e-6 in extremes["exponential_depth", "near plane"]
    assert {1.0, 4096.0} <= set(extremes["accumulated_contrast", "slices"])
    assert {65504.0, 65520.0} <= set(extremes["store_float16", "value"])


@pytest.mark.parametrize("case", HELD, ids=" ".join)
def test_what_must_hold_holds(measures, case):
    """No NaN, infinity, negative, rising or too large result; all errors finite."""
    row = measures[case]
    assert row.sound
    assert math.isfinite(row.worst)
    assert math.isfinite(row.mean)


@pytest.mark.parametrize("case", [case for case in HELD if case[2] != "float16"], ids=" ".join)
def test_8_ulp_where_the_condition_is_below_4(measures, case):
    assert measures[case].worst_well <= 8.0


@pytest.mark.parametrize("case", HELD, ids=" ".join)
def test_elsewhere_the_error_follows_the_condition_number(measures, case):
    """At most 8 ulp for each unit of 1 + condition, however ill-conditioned. Measured: 5.8."""
    assert measures[case].worst_per_condition <= 8.0


@pytest.mark.parametrize("name", ["accumulated_transmittance", "accumulated_contrast"])
def test_a_two_term_sum_beats_the_condition_number(measures, name):
    """e^(−τ) of a rounded τ is off by τ ulp; of a sum of two numbers it is not."""
    assert measures[name, "compensated", "float64"].worst <= 2.0
    assert measures[name, "plain", "float64"].worst > 100.0


# What each departure costs; the least size that must show, in the field named.
FAILURES = [
    ("slice_integral", "published", "float32", "worst_relative", 0.07),  # cancellation, and the clamp
    ("slice_integral", "published", "float32", "above", 1),
    ("slice_transmittance", "published", "float64", "worst_relative", 0.5),  # a light-year of clamped vacuum
    ("accumulated_transmittance", "published", "float64", "worst_relative", 6e-4),  # 64 m of it
    ("furnace", "published", "float32", "worst_relative", 0.01),
    ("henyey_greenstein", "textbook", "float32", "worst", 1e3),
    ("henyey_greenstein_versine", "from_cosine", "float32", "worst", 1e6),
    ("schlick", "published", "float64", "negative", 5),  # S1
    ("schlick", "kosian", "float64", "worst_relative", 1e3),  # D14
    ("distance_attenuation", "author", "float64", "above", 1),  # A6
    ("tone_map_round_trip", "published", "float16", "infinite", 1),  # D9
    ("albedo", "published", "float64", "not_a_number", 1),  # D1
    ("product_error", "plain", "float64", "worst_relative", 1.0),
]


@pytest.mark.parametrize("case", FAILURES, ids=lambda case: " ".join(case[:4]))
def test_published_failures_are_listed_with_their_size(measures, case):
    *key, field, least = case
    assert getattr(measures[tuple(key)], field) >= least


def test_the_cancellation_seen_on_real_hardware():
    """(S − S·T)/σ in float32 on thin slices that the clamp does not touch: 7 % and more, the sum as well.

    Slices of a few millimetres to centimetres of fog with σ ≥ 1e-5, optical depths 1e-7 to 1e-5: half a unit
    of 2⁻²⁴ is lost of x in 1 − e^(−x). On devices 1.6 % have been measured on less stiff input.
    """
    from froxel_ref.integrate import slice_integral

    length = np.geomspace(0.01, 0.5, 400).astype(np.float32)
    sigma = np.full_like(length, 2e-5)
    exact = -np.expm1(-sigma.astype(float) * length) / sigma.astype(float)
    errors = {name: np.abs(slice_integral(np.ones_like(length), sigma, length, integrator=name)[0] / exact - 1.0)
              for name in ("published", "analytic")}
    assert errors["published"].max() > 0.07
    assert np.median(errors["published"][sigma * length > 1e-6]) > 1e-3
    assert errors["analytic"].max() < 2.0**-23


# --- tone map ---------------------------------------------------------------------------------------


def test_tone_map_by_hand():
    """Luma of (1, 2, 4) is 1.9318."""
    colour = np.array([1.0, 2.0, 4.0])
    assert luma(colour) == pytest.approx(1.9318, rel=1e-15)
    assert tone_map(colour) == pytest.approx(colour / 2.9318, rel=1e-15)
    assert inverse_tone_map(colour / 8.0) == pytest.approx(colour / 8.0 / (1.0 - 1.9318 / 8.0), rel=1e-15)


@pytest.mark.parametrize("dtype", [np.float64, np.float32])
def test_tone_map_is_finite_to_the_largest_number(dtype):
    largest = np.full(3, np.finfo(dtype).max)
    assert tone_map(largest) == pytest.approx(np.ones(3), rel=1e-6)
    assert np.isfinite(inverse_tone_map(tone_map(largest))).all()
    assert tone_map(largest).dtype == inverse_tone_map(largest).dtype == dtype


def test_float16_makes_the_published_inverse_singular():
    """D9: from a luma of 4095 on, half floats round the tone-mapped luma to 1, and 1/0 follows."""
    bright = np.full((3, 3), [2000.0, 4000.0, 5000.0])
    stored = tone_map(bright).astype(np.float16).astype(np.float64)
    published = inverse_tone_map(stored, largest_luma=1.0)[0]
    assert np.isfinite(published[:2]).all()
    assert published[2] > 1e15  # infinite in the shader's float32, where the weights sum to 1 exactly
    corrected = inverse_tone_map(stored, largest_luma=FLOAT16_LARGEST_LUMA)[0]
    assert corrected[2] == pytest.approx(2048.0)
    assert corrected[0] == pytest.approx(2000.0, rel=2000 * 2.0**-11)


# --- registration -----------------------------------------------------------------------------------


def test_a_kernel_is_registered_once():
    with pytest.raises(InputError, match="registered already"):
        stability.register(ALL[0])
    with pytest.raises(InputError, match="must have a form"):
        stability.register(made({}))


def test_a_registered_kernel_is_measured_like_the_others(monkeypatch):
    monkeypatch.setattr(kernel_registry, "_KERNELS", dict(kernel_registry._KERNELS))
    stability.register(made({"corrected": np.sqrt}, lambda mp, x: mp.sqrt(x)))
    rows = sweep(kernels(["made"]), samples=20)
    assert [row.precision for row in rows] == ["float64", "float32", "float16"]
    assert all(row.worst <= 0.5 for row in rows)


@pytest.mark.parametrize(("names", "says"), [
    (["henyey_greenstien"], "did you mean 'henyey_greenstein'"), (["zzz"], "known: "), ([], "names no kernel")])
def test_unknown_kernels_are_refused(names, says):
    with pytest.raises(InputError, match=says):
        kernels(names)


def test_missing_mpmath_says_how_to_get_it(monkeypatch):
    monkeypatch.setitem(sys.modules, "mpmath", None)
    with pytest.raises(InputError, match="needs mpmath: python -m pip install"):
        sweep(ALL[:1], samples=4)


# --- pictures ---------------------------------------------------------------------------------------


def test_error_plane_shows_where_it_fails():
    """The published slice integral is worst where slices are thin, and right where they are thick."""
    [kernel] = kernels(["slice_integral"])
    plane = error_plane(kernel, "published", "float32", columns=20, rows=12)
    thick = plane.chart.across.values[None] * plane.chart.up.values[:, None] > 1e3
    fog = np.broadcast_to(plane.chart.across.values > 1e-4, thick.shape)
    assert np.nanmax(plane.errors[thick & fog]) < 4.0
    assert np.nanmax(plane.errors[~thick & fog]) > 1e4
    assert np.nanmax(error_plane(kernel, "corrected", "float32", columns=20, rows=12).errors) < 1.0


QUICK = ("rayleigh", "slice_integral", "exponential_depth", "tone_map_round_trip", "product_error")


@pytest.mark.parametrize("name", NAMES)
def test_every_kernel_has_a_picture(found, name):
    picture = heat_map(kernels([name])[0], found[name])
    assert picture.dtype == np.uint8
    assert picture.shape[1] >= 600
    assert len(np.unique(picture.astype(int) @ [65536, 256, 1])) > 20
    assert not (picture == NOT_A_NUMBER).all(axis=-1).any()


@pytest.mark.parametrize("name", QUICK)
def test_a_picture_needs_nothing_but_its_kernel(name):
    assert np.array_equal(heat_map(kernels([name])[0]), heat_map(kernels([name])[0], examine(kernels([name])[0])))


def painted(forms, **options):
    """Pixels of each mark in the picture of a made kernel of two parameters."""
    x = Parameter("x", "1", "magnitude", 1e-3, 1e3, (1.0,))
    kernel = made(forms, lambda mp, x, y: x, precisions=("float32",), **options)._replace(parameters=(x, x))
    picture = heat_map(kernel, examine(kernel, 10))
    return {name: int((picture == colour).all(axis=-1).sum()) for name, (colour, _) in MARKS.items()}


@pytest.mark.parametrize(("form", "name"), [
    (lambda x, y: np.where(x > 1, np.nan, x), "not_a_number"), (lambda x, y: np.where(x > 1, np.inf, x), "infinite"),
    (lambda x, y: np.where(x > 1, -x, x), "negative"), (lambda x, y: np.where(x > 1, 3e3, x), "above"),
    (lambda x, y: np.where(x > 1, x, 0.5), "rising")])
def test_failures_are_marked_each_by_its_own_colour(form, name):
    """Half of the cells, without what the hatch takes; and nothing of a mark, its legend included, without it."""
    options = {"at_most": 2e3, "falling": 0 if name == "rising" else None}
    sound, wrong = painted({"made": lambda x, y: x}, at_most=2e3), painted({"made": form}, **options)
    # The verdict over the panel has the colour of infinity: some hundred pixels.
    assert wrong[name] > 368 * 208 // 8
    assert all(count == 0 for count in sound.values())
    assert all(count == 0 for other, count in wrong.items() if other not in (name, "infinite"))
    assert name == "infinite" or wrong["infinite"] < 3000


def test_failures_are_marked_in_the_picture(found):
    [kernel] = kernels(["tone_map_round_trip"])
    bad = MARKS["infinite"][0]
    assert (heat_map(kernel, found[kernel.name]) == bad).all(axis=-1).sum() > 12 * 12 + 1000
    only = kernel._replace(forms={"corrected": kernel.forms["corrected"]})
    assert (heat_map(only, examine(only, SAMPLES)) == bad).all(axis=-1).sum() == 0


@pytest.mark.parametrize("kernel", ALL, ids=lambda kernel: kernel.name)
def test_the_worst_of_the_table_lies_on_the_map(found, kernel):
    """Ranges cover −1 and 1, what was picked by hand, and whatever was drawn."""
    for row in found[kernel.name].measures:
        chart = found[kernel.name].trials[row.precision].chart
        for edge, value, parameter in zip((chart.across, chart.up), row.place, kernel.parameters, strict=False):
            # As float32 a picked end may be the next number.
            low, high = edge.values[0], edge.values[-1]
            assert low - 1e-6 * abs(low) <= value <= high + 1e-6 * abs(high)
            assert 0.0 < edge.share(value) < 1.0
            if parameter.low == -1.0:
                assert (low, high) == (pytest.approx(-1.0, abs=1e-6), pytest.approx(1.0, abs=1e-6))


def test_edges_of_a_map_by_hand():
    both = axis(Parameter("cos θ", "1", "cosine", -1.0, 1.0), 40, "float64")
    assert (both.values[0], both.values[-1], both.share(0.0)) == (-1.0, 1.0, 0.5)
    assert (np.diff(both.values) > 0.0).all()
    np.testing.assert_array_equal(both.values, -both.values[::-1])
    thin = axis(Parameter("σ", "1/m", "magnitude", 1e-300, 1e8, (0.0, 5e-324, 1.0, 1e30)), 40, "float64")
    assert thin.values[:3].tolist() == [0.0, 5e-324, 1e-300]
    assert thin.values[-1] == 1e30
    cells = [thin.share(v) * len(thin.values) for v in (0.0, 5e-324, 1e30)]
    assert cells == pytest.approx([0.5, 1.5, len(thin.values) - 0.5], rel=1e-14)
    assert {words: share for share, words in thin.ticks}["1"] == pytest.approx(thin.share(1.0), abs=0.02)


# --- the report -------------------------------------------------------------------------------------


class Page(html.parser.HTMLParser):
    """Headings, rows, sources of images and links of a page."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.rows, self.images, self.links, self.heads = 0, [], [], 0
        self.feed(text)

    def handle_starttag(self, tag, attributes):
        values = dict(attributes)
        self.rows += tag == "tr"
        self.heads += tag == "th"
        self.images += [values["src"]] if tag == "img" else []
        self.links += [values[name] for name in ("href", "src") if name in values and tag != "img"]


def written(folder: Path) -> Path:
    chosen = ["--kernel", "tone_map_round_trip", "--kernel", "schlick"]
    assert main(["stability", "-o", str(folder / "out"), *chosen, "--samples", "20"]) == 0
    return folder / "out"


@pytest.fixture(scope="module")
def report(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """For tests that only read it."""
    return written(tmp_path_factory.mktemp("stability"))


def test_the_report_is_complete(tmp_path: Path, capsys):
    report = written(tmp_path)
    out, err = capsys.readouterr()
    assert out.splitlines()[-1] == str(report / "index.html")
    assert err == ""
    assert sorted(p.name for p in report.iterdir()) == [
        "index.html", "schlick.png", "stability.csv", "stability.json", "tone_map_round_trip.png"]
    document = json.loads((report / "stability.json").read_text())
    rows = [(k["name"], m) for k in document["kernels"] for m in k["measures"]]
    with (report / "stability.csv").open(newline="") as file:
        table = list(csv.DictReader(file))
    assert len(rows) == len(table) == 3 * 3 + 2 * 3
    for (name, row), line in zip(rows, table, strict=True):
        assert (name, row["form"], row["precision"]) == (line["kernel"], line["form"], line["precision"])
        assert float(row["worst_ulp"]) == float(line["worst_ulp"])
        assert (line["verdict"], line["reason"]) == (row["verdict"], row["reason"])
        inputs = dict(part.split("=") for part in line["inputs_at_worst"].split("; "))
        assert {key: float(value) for key, value in inputs.items()} == row["inputs_at_worst"]
        assert list(line)[2:] == list(row) == list(document["columns"])
        assert float(row["worst_relative"]) == float(line["worst_relative"])
    assert all(isinstance(kernel["seed"], int) for kernel in document["kernels"])
    for name in ("schlick", "tone_map_round_trip"):
        assert f"{name}" in out
        with Image.open(report / f"{name}.png") as picture:
            assert picture.width > 600


def test_the_page_needs_nothing_but_itself(report: Path):
    text = (report / "index.html").read_text()
    page = Page(text)
    assert page.rows == 1 + 15
    assert page.heads == 9
    assert len(page.images) == 2
    assert all(source.startswith("data:image/png;base64,") for source in page.images)
    assert all(link.startswith("#") for link in page.links)
    assert not re.search(r"https?://|@import|url\(", text)
    assert "color-scheme:light dark" in text
    assert "width=device-width" in text
    for verdict in ("fails", "inexact", "sound"):
        assert f"<b class={verdict}>{verdict}</b>" in text
    assert re.search(r"<b class=fails>fails</b><small>[1-9]\d* infinite, [1-9]\d* negative</small>", text)
    assert "cos θ = <span>" in text


def test_the_same_again_is_the_same(report: Path, tmp_path: Path):
    chosen = ["--kernel", "schlick", "--kernel", "tone_map_round_trip", "--samples", "20"]
    assert main(["stability", "-o", str(tmp_path / "again"), *chosen]) == 0
    for file in report.iterdir():
        assert file.read_bytes() == (tmp_path / "again" / file.name).read_bytes()


def test_a_report_is_replaced_by_force_only(tmp_path: Path, capsys):
    report = tmp_path / "out"
    again = ["stability", "-o", str(report), "--kernel", "rayleigh", "--samples", "4"]
    assert main(["stability", "-o", str(report), "--kernel", "albedo", "--samples", "4"]) == 0
    assert main(again) == 2
    assert "give --force" in capsys.readouterr().err
    assert main([*again, "--force"]) == 0
    assert sorted(p.name for p in report.iterdir()) == ["index.html", "rayleigh.png", "stability.csv", "stability.json"]
    (report / "mine.txt").write_text("precious")
    assert main([*again, "--force"]) == 2
    assert "mine.txt" in capsys.readouterr().err
    assert (report / "mine.txt").exists()


@pytest.mark.parametrize(("arguments", "says"), [
    (["--kernel", "slice_integrel"], "did you mean 'slice_integral'"), (["--kernel", ""], "--kernel: is ''"),
    (["--kernel", "hg"], "--kernel: is 'hg'; did you mean 'henyey_greenstein'? froxel-ref stability --list names all"),
    (["--kernel", "zzz"], "--kernel: is 'zzz'; froxel-ref stability --list names all"), (["-o", ""], "output: is ''"),
    (["--samples", "1"], "--samples: is '1'"), (["--samples", "many"], "--samples: is 'many'"),
    (["--samples", "²"], "--samples"), (["-o", "missing/folder"], "its folder does not exist"),
    (["-o", "taken"], "is a file, must be a folder"), (["--kernell", "x"], "unrecognized")])
def test_bad_input_is_one_line(arguments, says, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "taken").write_text("")
    assert main(["stability", *arguments]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert says in err
    assert len(err.splitlines()) == 1
    assert [p.name for p in tmp_path.iterdir()] == ["taken"]


def test_the_kernels_are_listed(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(["stability", "--list"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in lines] == ["kernel", *NAMES]
    assert list(tmp_path.iterdir()) == []


def test_an_interruption_leaves_nothing(tmp_path, monkeypatch):
    def stop(kernel, found):
        raise KeyboardInterrupt

    monkeypatch.setattr("froxel_ref.stability_pictures.heat_map", stop)
    assert main(["stability", "-o", str(tmp_path / "out"), "--kernel", "rayleigh", "--samples", "4"]) == 130
    assert list(tmp_path.iterdir()) == []


def test_progress_is_told(tmp_path):
    from froxel_ref.stability_page import write_report

    told = []
    write_report(kernels(["rayleigh"]), tmp_path / "out", samples=4, progress=lambda *what: told.append(what))
    assert told == [("rayleigh", 0, 1)]


def test_help_has_an_example(capsys):
    assert main(["stability", "--help"]) == 0
    assert re.search(r"^  froxel-ref stability\b", capsys.readouterr().out, re.MULTILINE)
