"""Plots of a report: where things stand, that labels keep apart, that nothing is lost, and the same bytes each time."""

from __future__ import annotations

import io
import math
import re
import xml.etree.ElementTree as ET

import numpy as np
import pytest
from PIL import Image
from report_examples import EXAMPLES, extreme, minimal, rich

pytest.importorskip("matplotlib")

from froxel_ref import report_plots
from froxel_ref.records import InputError
from froxel_ref.report_front import front_of
from froxel_ref.report_labels import label_boxes
from froxel_ref.report_numbers import megabytes, milliseconds, number, percent
from froxel_ref.report_plots import (
    drawings,
    figure_budget,
    figure_error,
    figure_planned,
    figure_refinement,
    figure_stages,
    pictures,
)
from froxel_ref.report_record import Spread
from froxel_ref.report_sheet import NARROW, SERIES, THEME, WIDE

NAMES = tuple(EXAMPLES)
LABEL = re.compile(r"l\d+")


@pytest.fixture(scope="module")
def drawn():
    """All drawings of all examples, made once."""
    return {name: drawings(make()) for name, make in EXAMPLES.items()}


def marks_of(figure, kind: str = "p") -> dict[int, list[tuple[float, float]]]:
    """Places of the markers of points, in pixels, by the point's index."""
    found: dict[int, list[tuple[float, float]]] = {}
    for line in figure.axes[0].lines:
        gid = line.get_gid() or ""
        if re.fullmatch(rf"{kind}\d+", gid):
            found.setdefault(int(gid[1:]), []).append((float(line.get_xdata()[0]), float(line.get_ydata()[0])))
    return found


def words_of(figure) -> list[str]:
    return [text.get_text().replace(r"\$", "$") for text in figure.axes[0].texts]


def boxes_of(figure, keep=lambda text: True) -> list[tuple[str, np.ndarray]]:
    """Boxes of texts as Matplotlib draws them, in pixels of 1/72 in."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    figure.dpi = 72.0
    renderer = FigureCanvasAgg(figure).get_renderer()
    return [(text.get_text(), np.array(text.get_window_extent(renderer).extents)) for text in figure.axes[0].texts
            if keep(text)]


@pytest.mark.parametrize("width", [WIDE, NARROW], ids=["wide", "narrow"])
@pytest.mark.parametrize("norm", ["relmse", "flip"])
@pytest.mark.parametrize("name", NAMES)
def test_every_point_has_one_mark_on_the_sheet(name: str, norm: str, width: float):
    report = EXAMPLES[name]()
    figure = figure_error(report, width, norm=norm)
    if figure is None:
        assert norm == "flip"
        assert all(point.errors.flip is None for point in report.points)
        return
    marks = marks_of(figure)
    expected = {i for i, p in enumerate(report.points)
                if norm == "relmse" or p.errors.flip is not None or p.member == "failed"}
    assert set(marks) == expected
    wide, high = figure.get_size_inches() * 72.0
    for places in marks.values():
        assert len(places) == 1
        assert 0.0 < places[0][0] < wide
        assert 0.0 < places[0][1] < high


def test_points_stand_by_the_logarithms_of_time_and_error():
    # Three points place both scales; all others must fit them. 1e-6 px is rounding.
    report = rich()
    marks = marks_of(figure_error(report, WIDE))
    good = [i for i, p in enumerate(report.points) if p.member != "failed"]
    time = np.array([math.log(report.points[i].seconds.least) for i in good])
    error = np.array([math.log(report.points[i].errors.relmse) for i in good])
    at = np.array([marks[i][0] for i in good])
    for values, places, sign in ((time, at[:, 0], 1.0), (error, at[:, 1], -1.0)):
        low, high = int(np.argmin(values)), int(np.argmax(values))
        slope = (places[high] - places[low]) / (values[high] - values[low])
        assert sign * slope > 0.0  # pixels count downwards
        assert np.allclose(places, places[low] + slope * (values - values[low]), rtol=0.0, atol=1e-6)


def test_bars_reach_from_the_least_to_the_median():
    report = minimal()
    figure = figure_error(report, WIDE)
    marks = marks_of(figure)
    (bar,) = [line for line in figure.axes[0].lines if line.get_gid() == "b1" and len(set(line.get_xdata())) > 1]
    scale = (marks[0][0][0] - marks[1][0][0]) / math.log(0.02 / 0.011)
    assert math.isclose(bar.get_xdata()[0], marks[1][0][0], abs_tol=1e-6)
    assert math.isclose(np.ptp(bar.get_xdata()), scale * math.log(0.012 / 0.011), rel_tol=1e-6)


def test_failures_stand_at_the_edges():
    report = extreme()
    figure = figure_error(report, WIDE)
    marks = {i: places[0] for i, places in marks_of(figure).items()}
    good = [marks[i] for i, p in enumerate(report.points) if p.member != "failed"]
    for i, point in enumerate(report.points):
        if point.member != "failed":
            continue
        if not math.isfinite(point.errors.relmse) and point.seconds is not None:
            assert marks[i][1] < min(y for _, y in good)  # above
        if point.seconds is None:
            assert marks[i][0] > max(x for x, _ in good)  # right
    failed = [marks[i] for i, p in enumerate(report.points) if p.member == "failed"]
    for a, place in enumerate(failed):
        assert all(math.dist(place, other) > 10.0 for other in failed[:a])


def test_no_error_at_all_stands_below_all_others():
    report = extreme()
    marks = {i: places[0] for i, places in marks_of(figure_error(report, WIDE)).items()}
    (none,) = [i for i, p in enumerate(report.points) if p.errors.relmse == 0.0]
    assert all(y < marks[none][1] for i, (_, y) in marks.items() if i != none)


@pytest.mark.parametrize("width", [WIDE, NARROW], ids=["wide", "narrow"])
@pytest.mark.parametrize("name", NAMES)
def test_labels_of_the_front_and_of_failures_are_there_and_keep_apart(name: str, width: float):
    report = EXAMPLES[name]()
    figure = figure_error(report, width)
    boxes = boxes_of(figure, lambda text: LABEL.fullmatch(text.get_gid() or ""))
    labelled = {int(text.get_gid()[1:]) for text in figure.axes[0].texts if LABEL.fullmatch(text.get_gid() or "")}
    assert labelled == {i for i, p in enumerate(report.points) if p.member != "dominated" or p.knob == "base"}
    for i in labelled:
        name_of = "base" if report.points[i].knob == "base" else report.points[i].id
        assert any(words == name_of or (words.endswith("…") and name_of.startswith(words[:-1]))
                   for words in words_of(figure))
    for a, (_, box) in enumerate(boxes):
        for _, other in boxes[:a]:
            wide = min(box[2], other[2]) - max(box[0], other[0])
            high = min(box[3], other[3]) - max(box[1], other[1])
            assert wide <= 0.0 or high <= 2.5  # what fonts keep free above and below letters may touch


@pytest.mark.parametrize("width", [WIDE, NARROW], ids=["wide", "narrow"])
@pytest.mark.parametrize("name", NAMES)
def test_no_words_leave_the_sheet(name: str, width: float):
    report = EXAMPLES[name]()
    for make in (figure_error, figure_budget, figure_refinement, figure_stages, figure_planned):
        figure = make(report, width)
        if figure is None:
            continue
        wide, high = figure.get_size_inches() * 72.0
        for words, box in boxes_of(figure):
            assert box[0] >= -1.0, words
            assert box[2] <= wide + 1.0, words
            assert box[1] >= -1.0, words
            assert box[3] <= high + 1.0, words


def test_labels_keep_apart_in_a_crowd():
    # Twelve anchors within 30 px: each label finds a place of its own, inside the area.
    random = np.random.default_rng(3)
    anchors = 200.0 + random.uniform(0.0, 30.0, (12, 2))
    sizes = np.tile([70.0, 15.0], (12, 1))
    boxes, apart = label_boxes(anchors, sizes, np.zeros((0, 4)), np.zeros(0), (0.0, 0.0, 400.0, 400.0))
    assert apart
    for a in range(12):
        for b in range(a):
            wide = min(boxes[a, 2], boxes[b, 2]) - max(boxes[a, 0], boxes[b, 0])
            high = min(boxes[a, 3], boxes[b, 3]) - max(boxes[a, 1], boxes[b, 1])
            assert wide <= 0.0 or high <= 0.0
    assert (boxes[:, :2] >= 0.0).all()
    assert (boxes[:, 2:] <= 400.0).all()


def test_the_front_of_flip_by_hand():
    def points(*rows: tuple[float, float, float]):
        point = minimal().points[0]
        return [point._replace(errors=point.errors._replace(flip=flip), seconds=Spread(a, b, 3)) for flip, a, b in rows]

    # Fast, but the third is nearer and may be as fast; slower and farther; nearer; slow and nearest.
    these = points((0.5, 1.0, 1.1), (0.6, 1.2, 1.3), (0.4, 1.05, 1.4), (0.1, 5.0, 5.5))
    assert front_of(these, "flip") == {0: "possible", 2: "certain", 3: "certain"}
    # The second is no farther from the reference, and its time may be the less.
    assert front_of(points((0.5, 1.0, 1.1), (0.5, 1.05, 1.2)), "flip") == {0: "possible", 1: "possible"}
    # Members by relMSE are the report's own.
    members = ("possible", "dominated", "certain", "dominated")
    told = [p._replace(member=m) for p, m in zip(these, members, strict=True)]
    assert front_of(told) == {0: "possible", 2: "certain"}


def test_the_steps_of_the_front_go_down():
    report = rich()
    figure = figure_error(report, WIDE)
    (stairs,) = [line for line in figure.axes[0].lines
                 if line.get_color() == THEME["front"][0] and len(line.get_xdata()) > 4 and line.get_gid() is None]
    xs, ys = np.array(stairs.get_xdata()), np.array(stairs.get_ydata())
    assert (np.diff(xs) >= 0.0).all()
    assert (np.diff(ys) >= 0.0).all()  # pixels count downwards: the error falls
    marks = marks_of(figure)
    certain = [marks[i][0] for i, p in enumerate(report.points) if p.member == "certain"]
    corners = set(zip(xs, ys, strict=True))
    assert all(place in corners for place in certain)


def test_a_possible_member_above_the_steps_does_not_raise_them():
    report = minimal()
    base, fast = report.points
    third = base._replace(id="third", knob="slices", member="possible", seconds=Spread(0.015, 0.017, 3),
                          errors=base.errors._replace(relmse=5e-3))
    figure = figure_error(report._replace(points=(base, fast, third)), WIDE)
    (stairs,) = [line for line in figure.axes[0].lines
                 if line.get_color() == THEME["front"][0] and len(line.get_xdata()) > 2 and line.get_gid() is None]
    assert (np.diff(stairs.get_ydata()) >= 0.0).all()
    places = {i: found[0] for i, found in marks_of(figure).items()}
    assert stairs.get_ydata()[0] == pytest.approx(places[1][1])
    assert stairs.get_ydata()[-1] == pytest.approx(places[0][1])
    assert places[2][1] < places[1][1]  # farther from the reference than the steps are: above


def bars_of(figure) -> list[tuple[float, float, float, str]]:
    """Start, end, middle and colour of bars, legends left out."""
    from matplotlib.colors import to_hex
    from matplotlib.patches import Rectangle

    return [(r.get_x(), r.get_x() + r.get_width(), r.get_y() + r.get_height() / 2.0, to_hex(r.get_facecolor()))
            for r in figure.axes[0].patches if isinstance(r, Rectangle) and r.get_height() > 13.0]


@pytest.mark.parametrize("width", [WIDE, NARROW], ids=["wide", "narrow"])
def test_bars_of_the_budget_are_as_long_as_its_shares(width: float):
    budget = rich().budget
    bars = bars_of(figure_budget(rich(), width))
    rows: dict[float, list[tuple[float, float]]] = {}
    for start, end, middle, _ in bars:
        rows.setdefault(round(middle, 3), []).append((start, end))
    lengths = [sum(end - start for start, end in rows[middle]) for middle in sorted(rows)]
    shares = [abs(part.share) for part in budget.parts] + [abs(budget.rest), abs(budget.interaction)]
    assert np.allclose(np.array(lengths) / lengths[0], np.array(shares) / shares[0], rtol=1e-9)
    zero = min(start for start, _ in rows[min(rows)])
    signs = [1.0 if min(start for start, _ in rows[middle]) >= zero - 1e-6 else -1.0 for middle in sorted(rows)]
    assert signs == [math.copysign(1.0, v) for v in [*(p.share for p in budget.parts), budget.rest, budget.interaction]]


def test_bars_of_stages_are_as_long_as_their_times():
    report = rich()
    rows: dict[float, float] = {}
    for start, end, middle, _ in bars_of(figure_stages(report, WIDE)):
        rows[round(middle, 3)] = rows.get(round(middle, 3), 0.0) + end - start
    lengths = np.array([rows[middle] for middle in sorted(rows)])
    times = np.array(sorted(p.seconds.least for p in report.points
                            if p.member in ("certain", "possible") or p.knob == "base"))
    assert np.allclose(lengths / lengths[-1], times / times[-1], rtol=1e-9)


def test_refinement_says_its_order_and_draws_its_slope():
    figure = figure_refinement(rich(), WIDE)
    assert any(words.startswith("√relMSE: order 1.90") for words in words_of(figure))
    (fit,) = [line for line in figure.axes[0].lines
              if line.get_color() == THEME["s0"][0] and len(line.get_xdata()) == 2]
    dots = [(line.get_xdata()[0], line.get_ydata()[0]) for line in figure.axes[0].lines if line.get_marker() == "o"]
    assert len(dots) == 5
    # Pixels to a factor of two, across and up, from the points themselves: ends are 16 apart in step.
    xs, ys = np.array(dots).T
    errors = [level.errors.relmse for level in rich().refinement.levels]
    up = (ys[-1] - ys[0]) / (0.5 * math.log2(errors[0] / errors[-1]))
    across = (xs[0] - xs[-1]) / 4.0
    slope = -(fit.get_ydata()[1] - fit.get_ydata()[0]) / (fit.get_xdata()[1] - fit.get_xdata()[0]) * across / up
    assert math.isclose(slope, 1.9, rel_tol=1e-9)


def test_what_a_report_does_not_have_is_not_drawn():
    assert set(drawings(minimal())) == {"error-against-time", "stages"}
    assert set(pictures(rich())) == {"error-against-time.png", "flip-against-time.png", "budget.png", "refinement.png",
                                     "stages.png", "planned.png"}
    assert figure_error(minimal()._replace(points=())) is None
    assert figure_budget(extreme()) is None
    assert figure_refinement(extreme()) is None


def test_pictures_are_1600_pixels_wide_and_show_something():
    for name, content in pictures(rich()).items():
        with Image.open(io.BytesIO(content)) as image:
            assert image.width == 1600, name
            assert len(image.convert("RGB").getcolors(1 << 24)) > 20, name


@pytest.mark.parametrize("name", NAMES)
def test_drawings_are_well_formed_and_stand_alone(drawn, name: str):
    ids: set[str] = set()
    for plot in drawn[name].values():
        for text in plot:
            root = ET.fromstring(text)
            found = [element.get("id") for element in root.iter() if element.get("id")]
            assert len(found) == len(set(found))
            assert not ids & set(found)  # all of them stand in one page
            ids |= set(found)
            for reference in re.findall(r'(?:href="|url\()#([^")]*)', text):
                assert reference in found
            assert not re.search(r"https?:|<image|<script|@import", text)


@pytest.mark.parametrize("name", NAMES)
def test_colours_of_drawings_are_variables(drawn, name: str):
    for plot in drawn[name].values():
        for text in plot:
            assert re.findall(r"#[0-9a-f]{6}\b", text) == []
            assert set(re.findall(r"var\(--p-(\w+)\)", text)) <= set(THEME)
            assert "<text" in text


def test_points_in_drawings_can_have_the_focus_and_say_what_they_are(drawn):
    report = rich()
    for text in drawn["rich"]["error-against-time"]:
        root = ET.fromstring(text)
        points = {int(e.get("data-p")): e for e in root.iter() if e.get("class") == "pt"}
        assert set(points) == set(range(len(report.points)))
        for i, element in points.items():
            name = "base" if report.points[i].knob == "base" else report.points[i].id
            assert element.get("aria-label", "").startswith(name + ": ")
            assert element.get("tabindex") == "-1"


def test_the_same_report_gives_the_same_bytes():
    assert pictures(minimal()) == pictures(minimal())
    assert drawings(extreme()) == drawings(extreme())


def test_a_users_own_settings_of_matplotlib_change_nothing():
    import matplotlib

    plain = drawings(minimal())
    with matplotlib.rc_context({"svg.fonttype": "path", "lines.linewidth": 9, "savefig.bbox": "tight"}):
        assert drawings(minimal()) == plain
        assert matplotlib.rcParams["lines.linewidth"] == 9


def luminance(colour: str) -> float:
    """Relative luminance of an sRGB colour [WCAG 2.2]."""
    channels = [int(colour[i:i + 2], 16) / 255.0 for i in (1, 3, 5)]
    linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in channels]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


def contrast(a: str, b: str) -> float:
    low, high = sorted((luminance(a), luminance(b)))
    return (high + 0.05) / (low + 0.05)


@pytest.mark.parametrize("mode", [0, 1], ids=["light", "dark"])
def test_colours_can_be_read(mode: int):
    # WCAG 2.2: 4.5 for text, 3 for marks.
    for paper in ("paper", "lane"):
        for text in ("ink", "soft", "fail"):
            assert contrast(THEME[text][mode], THEME[paper][mode]) >= 4.5
        for name in (*SERIES, "front"):
            assert contrast(THEME[name][mode], THEME[paper][mode]) >= 3.0
    assert len({light for light, _ in THEME.values()}) == len(THEME)


def test_a_missing_matplotlib_is_said(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(report_plots, "plots_available", lambda: False)
    with pytest.raises(InputError, match=re.escape("plots: matplotlib is missing; install froxel-ref[report]")):
        drawings(minimal())


@pytest.mark.parametrize(("value", "text"), [
    (9.996, "10.0"), (0.00099996, "0.00100"), (99.96, "100"), (999.6, "1\u202f000"), (999600.0, "1.00×10⁶"),
    (9.999e-5, "0.000100"), (9.99e-5, "9.99×10⁻⁵"), (-0.5, "−0.500"), (math.inf, "∞"), (-math.inf, "−∞"),
    (1e-12, "1.00×10⁻¹²")])
def test_numbers_have_three_digits(value: float, text: str):
    assert number(value) == text


def test_units_are_those_said():
    assert (milliseconds(0.0334), milliseconds(None)) == ("33.4", "–")
    assert (megabytes(131_000_000), megabytes(None)) == ("131", "–")
    assert [percent(v) for v in (0.0996, 0.0994, 1.5, -0.0005, math.nan)] == [
        "10\u202f%", "9.9\u202f%", "150\u202f%", "−0.050\u202f%", "NaN"]
