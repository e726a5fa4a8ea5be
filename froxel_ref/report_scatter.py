"""The plot of error against time: all points, the front, the floor of the reference, and what failed."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from froxel_ref.arrays import Field
from froxel_ref.report_front import called, error_of, front_of, placed, times_of
from froxel_ref.report_labels import along, draw_label, extents, label_boxes
from froxel_ref.report_numbers import number, tick
from froxel_ref.report_record import Point, Report
from froxel_ref.report_sheet import SERIES, WIDE, Log, Sheet, plain_settings

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["figure_error"]

SHAPES = ("o", "s", "^", "D", "v", "P", "<", "p", ">", "h", "d")  # 11 shapes to 8 colours: 88 knobs apart


def figure_error(report: Report, width: float = WIDE, *, norm: str = "relmse") -> Figure | None:
    """Error against time of a frame, both logarithmic: all points, the front, the floor, and what failed.

    Parameters
    ----------
    report : Report
    width : float [in]
        Below some 8 in, more than six labels are numbers with a key beneath.
    norm : str
        "relmse" or "flip".

    Returns
    -------
    Figure or None
        None if no point has that error, nor failed.
    """
    points = report.points
    if not points or (norm == "flip" and all(p.errors.flip is None for p in points)):
        return None
    with plain_settings():
        return _figure_error(report, width, norm)


class _Spot(NamedTuple):
    """A point on the sheet; ``end`` is where its bar of error ends, NaN where there is none."""

    place: int
    x: float
    y: float
    end: float
    failed: bool


class _Lanes(NamedTuple):
    """Strips at the edges: of points without an error above, without a time right, without any difference below."""

    top: float
    right: float
    bottom: float


def _figure_error(report: Report, width: float, norm: str) -> Figure:
    """The figure, its parts drawn one after the other."""
    sheet, points = Sheet(width), report.points
    front = front_of(points, norm)
    shown = [i for i, p in enumerate(points) if norm == "relmse" or p.errors.flip is not None or _failed(p, "relmse")]
    top, left, right = 28.0, 50.0 if sheet.narrow else 66.0, sheet.width - (8.0 if sheet.narrow else 14.0)
    bottom = top + (330.0 if sheet.narrow else 470.0)
    frame = (left, top, right, bottom)
    across, up, lanes = _scales(points, shown, norm, frame, report.reference.floor if norm == "relmse" else math.nan)
    name = "relMSE" if norm == "relmse" else "mean HDR-FLIP"
    sheet.text(4.0, 12.0, f"{name} [1]", bold=True)
    sheet.text(4.0 + sheet.long(f"{name} [1]", True) + 8.0, 12.0, "nearer to the reference is lower, faster is left"
               if not sheet.narrow else "lower is nearer to the reference", "soft")
    _grid(sheet, across, up, frame, lanes)
    floor = _floor(sheet, report.reference.floor if norm == "relmse" else 0.0, up, frame, lanes)
    spots = _spots(points, shown, norm, across, up, frame, lanes)
    look = _looks(points)
    stairs = _stairs([spot for spot in spots if spot.place in front], right - lanes.right)
    sheet.line(*stairs, "front", 1.4, order=2.5)
    for spot in spots:
        _draw_spot(sheet, points[spot.place], spot, front.get(spot.place), look[points[spot.place].knob])
    y = _name_spots(sheet, points, spots, front, stairs, floor, frame, bottom + 48.0, _recommended(report))
    recommended = any(points[i].id == _recommended(report) for i in shown)
    y = _key(sheet, points, spots, look, y, front, recommended)
    missing = len(points) - len(shown)
    if missing:
        said = "point has" if missing == 1 else "points have"
        sheet.text(4.0, y + 8.0, f"{missing} {said} no FLIP: not shown here", "soft")
        y += 20.0
    return sheet.finish(y + 4.0)


def _recommended(report: Report) -> str:
    """The id of the point that is recommended, if there is one."""
    return "" if report.recommendation is None else report.recommendation.point


def _failed(point: Point, norm: str) -> bool:
    """Whether a point is drawn as a failure."""
    return point.member == "failed" or (norm == "relmse" and not placed(point, norm))


def _scales(points: Sequence[Point], shown: Sequence[int], norm: str, frame: tuple[float, float, float, float],
            floor: float) -> tuple[Log, Log, _Lanes]:
    """The scales of time in ms and of the error, and what they leave at the edges for points that have neither."""
    errors = [error_of(points[i], norm) for i in shown]
    times = [t for i in shown for t in times_of(points[i]) if math.isfinite(t)] or [1e-3, 1.0]
    values = [e for e in errors if math.isfinite(e) and e > 0.0] or [1e-3, 1.0]
    below = 0.0 < floor < math.inf and floor <= 0.05 * min(values)  # room for its words alone
    if 0.0 < floor < math.inf and not below:
        values = [*values, floor * 0.6]
    lanes = _Lanes(
        30.0 if any(not (math.isfinite(e) and e >= 0.0) for e in errors) else 0.0,
        34.0 if any(not math.isfinite(times_of(points[i])[0]) for i in shown) else 0.0,
        24.0 if any(e == 0.0 for e in errors) else 0.0)

    def ends(these: Sequence[float], before: float, after: float) -> tuple[float, float]:
        low, high = math.log10(min(these)), math.log10(max(these))
        span = max(high - low, 0.5)
        middle = (low + high) / 2.0
        return middle - span * (0.5 + before), middle + span * (0.5 + after)

    x0, y0, x1, y1 = frame
    across = Log(*ends([1e3 * t for t in times], 0.09, 0.16), x0, x1 - lanes.right)
    up = Log(*ends(values, 0.12 if below else 0.07, 0.09), y1 - lanes.bottom, y0 + lanes.top)
    return across, up, lanes


def _grid(sheet: Sheet, across: Log, up: Log, frame: tuple[float, float, float, float], lanes: _Lanes) -> None:
    """Lines and numbers of both axes, and the lanes at the edges."""
    x0, y0, x1, y1 = frame
    if lanes.top:
        sheet.box(x0, y0, x1, y0 + lanes.top, "lane")
        sheet.text(x0 - 6.0, y0 + lanes.top / 2.0, "failed", "fail", "right")
    if lanes.right:
        sheet.box(x1 - lanes.right, y0, x1, y1, "lane")
        sheet.text(x1, y1 + 32.0, "not run ↑", "fail", "right")
    if lanes.bottom:
        sheet.box(x0, y1 - lanes.bottom, x1, y1, "lane")
        sheet.text(x0 - 6.0, y1 - lanes.bottom / 2.0, "0", "soft", "right")
    for value in across.ticks(40.0 if sheet.narrow else 52.0):
        x, words = across.at(value), tick(value)
        sheet.line([x, x], [y0, y1], "grid", 0.8, order=1.5)
        if x + sheet.long(words) / 2.0 <= x1 + 4.0:
            sheet.text(x, y1 + 14.0, words, "soft", "center")
    for value in up.ticks(26.0):
        y = up.at(value)
        sheet.line([x0, x1], [y, y], "grid", 0.8, order=1.5)
        sheet.text(x0 - 6.0, y, tick(value), "soft", "right")
    sheet.line([x0, x0, x1, x1, x0], [y1, y0, y0, y1, y1], "edge", 0.9, order=1.6)
    sheet.text(x0 + (across.end - x0) / 2.0, y1 + 32.0, "time of a frame [ms]", bold=True, anchor="center")


def _floor(sheet: Sheet, floor: float, up: Log, frame: tuple[float, float, float, float], lanes: _Lanes) -> Field:
    """The line below which the reference is no better; returns the box of its words, if there are any."""
    if not 0.0 < floor < math.inf:
        return np.zeros((0, 4))
    x0, _, x1, y1 = frame
    words, middle = f"the reference is no better than {number(floor)}", y1 - lanes.bottom - 11.0
    if math.log10(floor) <= up.low:
        words = f"↓ {words}"
        sheet.box(x0 + 4.0, middle - 8.0, x0 + 8.0 + sheet.long(words), middle + 8.0, "paper", alpha=0.8, order=1.7)
    else:
        y = up.at(floor)
        middle = min(y + 10.0, y1 - 9.0)
        sheet.box(x0, y, x1, y1, "soft", alpha=0.13)
        sheet.line([x0, x1], [y, y], "soft", 1.2, dash=True, order=1.8)
    sheet.text(x0 + 6.0, middle, words, "soft")
    return np.array([[x0, middle - 8.0, x0 + 8.0 + sheet.long(words), middle + 8.0]])


def _spots(points: Sequence[Point], shown: Sequence[int], norm: str, across: Log, up: Log,
           frame: tuple[float, float, float, float], lanes: _Lanes) -> list[_Spot]:
    """Where points stand, those in the lanes too."""
    _, y0, x1, y1 = frame
    spots, lost = [], 0
    room = max(1, int((up.start - y0 - 10.0) // 20.0))
    for i in shown:
        error, (least, median) = error_of(points[i], norm), times_of(points[i])
        bad, timeless = not (math.isfinite(error) and error >= 0.0), not math.isfinite(least)
        y = y0 + lanes.top / 2.0 if bad else y1 - lanes.bottom / 2.0 if error == 0.0 else up.at(error)
        if bad and timeless:  # one below the other, from the corner; beside each other when the edge is full
            y = y0 + 14.0 + 20.0 * (lost % room)
            x = x1 - lanes.right / 2.0 - 20.0 * (lost // room)
            lost += 1
        else:
            x = x1 - lanes.right / 2.0 if timeless else across.at(1e3 * least)
        end = math.nan if timeless else across.at(1e3 * median)
        spots.append(_Spot(i, x, y, end, _failed(points[i], norm) or bad or timeless))
    return spots


def _looks(points: Sequence[Point]) -> dict[str, tuple[str, str]]:
    """A shape and a colour for each knob."""
    knobs = dict.fromkeys(p.knob for p in points if p.knob != "base")
    looks = {knob: (SHAPES[i % len(SHAPES)], SERIES[i % len(SERIES)]) for i, knob in enumerate(knobs)}
    return looks | {"base": ("o", "ink")}


def _stairs(spots: Sequence[_Spot], end: float) -> tuple[list[float], list[float]]:
    """The front as a stepped line: what is reached with so much time."""
    xs: list[float] = []
    ys: list[float] = []
    for spot in sorted(spots, key=lambda s: (s.x, s.y)):
        if not ys:
            xs, ys = [spot.x], [spot.y]
        elif spot.y > ys[-1]:
            xs, ys = [*xs, spot.x, spot.x], [*ys, ys[-1], spot.y]
    return ([*xs, max(end, xs[-1])], [*ys, ys[-1]]) if xs else ([], [])


def _draw_spot(sheet: Sheet, point: Point, spot: _Spot, member: str | None, look: tuple[str, str]) -> None:
    """A point's marker and bar: a cross if it failed, faint if another is better, ringed if it is the base."""
    shape, colour = look
    gid = f"p{spot.place}"
    if spot.failed:
        sheet.mark(spot.x, spot.y, "x", "fail", 9.0, width=2.2, gid=gid, order=5.0)
    elif member is None and point.knob != "base":
        if spot.end > spot.x:
            sheet.line([spot.x, spot.end], [spot.y, spot.y], colour, 1.0, alpha=0.4, gid=f"b{spot.place}")
        sheet.mark(spot.x, spot.y, shape, colour, 6.0, alpha=0.45, width=0.8, gid=gid, order=3.0)
    else:
        if spot.end > spot.x:
            sheet.line([spot.x, spot.end], [spot.y, spot.y], colour, 1.6, gid=f"b{spot.place}", order=3.5)
            sheet.line([spot.end, spot.end], [spot.y - 3.5, spot.y + 3.5], colour, 1.6, gid=f"b{spot.place}", order=3.5)
        sheet.mark(spot.x, spot.y, shape, colour, 8.0, fill=colour if member == "certain" else "paper", gid=gid)
    if point.knob == "base":
        sheet.mark(spot.x, spot.y, "o", "ink", 16.0, fill="none", width=1.6, gid=f"r{spot.place}", order=4.5)


def _name_spots(sheet: Sheet, points: Sequence[Point], spots: Sequence[_Spot], front: Mapping[int, str],
                stairs: tuple[list[float], list[float]], floor: Field, frame: tuple[float, float, float, float],
                y: float, chosen: str) -> float:
    """Labels of the front, the base and what failed; returns where the key of numbers, if there is one, ends."""
    named = sorted((s for s in spots if s.place in front or s.failed or points[s.place].knob == "base"),
                   key=lambda s: (s.failed, s.x, s.y))
    if not named:
        return y
    anchors = np.array([(s.x, s.y) for s in named])
    things, weights = _obstacles(points, spots, named, stairs, floor)
    x0, y0, x1, y1 = frame
    area = (x0 + 3.0, y0 + 3.0, x1 - 3.0, y1 - 3.0)
    words = [called(points[s.place]) for s in named]
    numbered = len(named) > (6 if sheet.narrow else 24)
    if not numbered:
        full = words
        boxes, apart = label_boxes(anchors, extents(sheet, full), things, weights, area)
        numbered = not apart
    if numbered:
        full = [str(i + 1) for i in range(len(named))]
        boxes, _ = label_boxes(anchors, extents(sheet, full), things, weights, area)
    for spot, text, box in zip(named, full, boxes, strict=True):
        draw_label(sheet, text, box, (spot.x, spot.y), "fail" if spot.failed else "ink", f"l{spot.place}",
                   bold=points[spot.place].id == chosen)
    return _numbers(sheet, named, words, y) if numbered else y


def _obstacles(points: Sequence[Point], spots: Sequence[_Spot], named: Sequence[_Spot],
               stairs: tuple[list[float], list[float]], floor: Field) -> tuple[Field, Field]:
    """What labels should not hide: markers, bars, the front, words of the floor; and how much each matters."""
    reach = np.array([[9.0 if points[s.place].knob == "base" else 5.5 if s in named else 3.5] for s in spots])
    middles = np.array([(s.x, s.y) for s in spots])
    bars = np.array([(s.x, s.y - 3.0, s.end, s.y + 3.0) for s in named if s.end > s.x]).reshape(-1, 4)
    steps = along(*stairs)
    things = np.concatenate([np.concatenate([middles - reach, middles + reach], axis=1), bars, steps, floor])
    weights = np.concatenate([np.where(reach[:, 0] > 4.0, 3.0, 0.8), np.full(len(bars), 0.5), np.full(len(steps), 0.8),
                              np.full(len(floor), 2.0)])
    return things, weights


def _numbers(sheet: Sheet, named: Sequence[_Spot], words: Sequence[str], y: float) -> float:
    """The key of numbered labels, in as many columns as fit."""
    lead = sheet.long("00") + 6.0
    widest = max(sheet.long(word) for word in words) + lead + 16.0
    columns = min(max(1, int((sheet.width - 8.0) // widest)), 4, len(words))
    rows = -(-len(words) // columns)
    pitch, room = sheet.size * 1.5, (sheet.width - 8.0) / columns
    for i, (spot, word) in enumerate(zip(named, words, strict=True)):
        x, at = 4.0 + (i // rows) * room, y + 6.0 + (i % rows) * pitch
        sheet.text(x + lead - 6.0, at, str(i + 1), "fail" if spot.failed else "ink", "right", bold=True)
        sheet.text(x + lead, at, sheet.cut(word, room - lead - 8.0), "fail" if spot.failed else "ink",
                   gid=f"l{spot.place}")
    return y + rows * pitch + 10.0


def _key(sheet: Sheet, points: Sequence[Point], spots: Sequence[_Spot], looks: Mapping[str, tuple[str, str]], y: float,
         front: Mapping[int, str], recommended: bool) -> float:
    """What shapes, colours and fillings mean, flowing over as many lines as it takes."""
    x, pitch = 4.0, sheet.size * 1.65
    knobs = dict.fromkeys(points[s.place].knob for s in spots if not s.failed and points[s.place].knob != "base")
    signs = [("base: what all others start from", "base")] * any(points[s.place].knob == "base" for s in spots)
    said = {"certain": "on the front", "possible": "perhaps on the front", "": "another is better"}
    members = {front.get(s.place, "") for s in spots if not s.failed}
    signs += [(words, member or "dominated") for member, words in said.items() if member in members]
    signs += [("time: least of the runs, and noise", "bar")] * any(s.end > s.x for s in spots)
    signs += [("failed", "failed")] * any(s.failed for s in spots)
    signs += [("recommended", "bold")] * recommended
    entries = [(knob, *looks[knob]) for knob in knobs] + [(words, sign, "ink") for words, sign in signs]
    y += 8.0
    for at, (words, shape, colour) in enumerate(entries):
        words = sheet.cut(words, sheet.width - 40.0)
        lead = sheet.long("bold", True) + 6.0 if shape == "bold" else 20.0
        long = lead + sheet.long(words) + 16.0
        if x > 4.0 and (x + long - 12.0 > sheet.width or at == len(knobs)):
            x, y = 4.0, y + pitch
        if shape == "bold":
            sheet.text(x, y, "bold", "ink", bold=True)
        else:
            _sign(sheet, x + 8.0, y, shape, colour)
        sheet.text(x + lead, y, words, "soft")
        x += long
    return y + 12.0


def _sign(sheet: Sheet, x: float, y: float, shape: str, colour: str) -> None:
    """A marker as the key explains it."""
    if shape == "base":
        sheet.mark(x, y, "o", "ink", 12.0, fill="none", width=1.6)
    elif shape in ("certain", "possible"):
        sheet.mark(x, y, "o", "ink", 7.5, fill="ink" if shape == "certain" else "paper")
    elif shape == "dominated":
        sheet.mark(x, y, "o", "ink", 6.0, alpha=0.45, width=0.8)
    elif shape == "failed":
        sheet.mark(x, y, "x", "fail", 8.0, width=2.2)
    elif shape == "bar":
        sheet.mark(x - 5.0, y, "o", "ink", 5.0)
        sheet.line([x - 5.0, x + 7.0, x + 7.0, x + 7.0], [y, y, y - 3.5, y + 3.5], "ink", 1.5)
    else:
        sheet.mark(x, y, shape, colour, 7.5)
