"""Plots of a report: error against time, the budget, refinement, stages, and what leaving out saves.

Every plot is drawn by Matplotlib (extra ``report``), once for a width: as a PNG file in light colours, or as SVG whose
text is text and whose colours are CSS variables, so that a page shows it by light and by dark. Drawing is in pixels
from the upper left corner, of which there are 72 to an inch.
"""

from __future__ import annotations

import html
import importlib.util
import io
import math
import re
import warnings
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from froxel_ref.arrays import Field
from froxel_ref.pareto import front
from froxel_ref.records import InputError
from froxel_ref.report_record import Point, Report

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = [
    "NARROW", "THEME", "WIDE", "Drawing", "drawings", "figure_budget", "figure_error", "figure_planned",
    "figure_refinement", "figure_stages", "front_of", "megabytes", "milliseconds", "number", "percent", "pictures",
    "plots_available",
]

WIDE, NARROW = 820 / 72, 356 / 72  # widths [in]: from 700 px on, and on phones
PICTURE_WIDTH = 1600  # of a PNG file [px]

# Colours by light and by dark. No two light ones are equal: SVG knows them by their value.
THEME: dict[str, tuple[str, str]] = {
    "paper": ("#fffffe", "#16181c"), "ink": ("#1b1d21", "#e8eaee"), "soft": ("#585f6a", "#a4aab4"),
    "grid": ("#e3e6ea", "#2c3037"), "lane": ("#f3f4f7", "#1e2126"), "edge": ("#9aa1ab", "#5d646f"),
    "front": ("#3a4049", "#c3c8d0"), "fail": ("#b3261e", "#ff8a80"),
    "s0": ("#0072b2", "#57b0f2"), "s1": ("#c24e00", "#ff9d57"), "s2": ("#007d5a", "#45cfa0"),
    "s3": ("#b0408c", "#ef8fd0"), "s4": ("#8a6700", "#e0c040"), "s5": ("#1787a8", "#74dcee"),
    "s6": ("#6a3fb5", "#b9a0fa"), "s7": ("#6b6f76", "#b6bac1")}
SERIES = tuple(name for name in THEME if re.fullmatch(r"s\d", name))
SHAPES = ("o", "s", "^", "D", "v", "P", "<", "p", ">", "h", "d")  # 11 shapes to 8 colours: 88 knobs apart


def plots_available() -> bool:
    """Whether Matplotlib is there to draw.

    Returns
    -------
    bool

    Examples
    --------
    >>> plots_available() in (True, False)
    True
    """
    return importlib.util.find_spec("matplotlib") is not None


# --- numbers as they are shown ----------------------------------------------------------------------


def number(value: float | None) -> str:
    """Three significant digits, as text that does not break.

    Parameters
    ----------
    value : float or None

    Returns
    -------
    str

    Examples
    --------
    >>> number(0.0123456), number(1.5e-7), number(-2), number(12345.0), number(0.0), number(float("nan")), number(None)
    ('0.0123', '1.50×10⁻⁷', '−2.00', '12\u202f300', '0', 'NaN', '–')
    """
    if value is None:
        return "–"
    if not math.isfinite(value):
        return "NaN" if math.isnan(value) else "∞" if value > 0.0 else "−∞"
    if value == 0.0:
        return "0"
    mantissa, _, exponent = f"{abs(value):.2e}".partition("e")
    power = int(exponent)
    if -4 <= power <= 5:
        rounded = float(f"{mantissa}e{power}")
        text = f"{rounded:,.{max(0, 2 - power)}f}".replace(",", "\u202f")
    else:
        text = f"{mantissa}×10{str(power).translate(_RAISED)}"
    return f"−{text}" if value < 0.0 else text


_RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


def milliseconds(seconds: float | None) -> str:
    """Seconds as a number of milliseconds, without the unit.

    Parameters
    ----------
    seconds : float or None [s]

    Returns
    -------
    str

    Examples
    --------
    >>> milliseconds(0.0167), milliseconds(1.5)
    ('16.7', '1\u202f500')
    """
    return number(None if seconds is None else 1e3 * seconds)


def megabytes(size: float | None) -> str:
    """Bytes as a number of megabytes (10⁶ bytes), without the unit.

    Parameters
    ----------
    size : float or None [bytes]

    Returns
    -------
    str

    Examples
    --------
    >>> megabytes(58_200_000)
    '58.2'
    """
    return number(None if size is None else size / 1e6)


def percent(share: float | None) -> str:
    """A share in percent, two digits of it.

    Parameters
    ----------
    share : float or None [1]

    Returns
    -------
    str

    Examples
    --------
    >>> percent(0.413), percent(-0.0312), percent(0.00042), percent(0.0)
    ('41\u202f%', '−3.1\u202f%', '0.042\u202f%', '0\u202f%')
    """
    if share is None or not math.isfinite(share):
        return number(share)
    size = 100.0 * abs(share)
    if size < 1e-3:
        return f"{number(100.0 * share)}\u202f%"
    digits = max(0, 1 - math.floor(math.log10(float(f"{size:.1e}"))))
    return f"{'−' if share < 0.0 else ''}{size:,.{digits}f}\u202f%".replace(",", "\u202f")


# --- what is where ----------------------------------------------------------------------------------


class _Log(NamedTuple):
    """A logarithmic scale: the decades ``low`` and ``high`` lie at the pixels ``start`` and ``end``."""

    low: float
    high: float
    start: float
    end: float

    def at(self, value: float) -> float:
        return self.at_power(math.log10(value))

    def at_power(self, power: float) -> float:
        return self.start + (power - self.low) / (self.high - self.low) * (self.end - self.start)

    def ticks(self, apart: float) -> list[float]:
        """Powers of ten, or of these 1, 2 and 5, at least so many pixels apart."""
        decade = abs(self.end - self.start) / (self.high - self.low)
        inside = range(max(-300, math.floor(self.low)), min(300, math.ceil(self.high)) + 1)
        if 0.125 * decade >= apart:
            values = [m * 10.0**k for k in inside for m in (1, 1.5, 2, 3, 5, 7)]
        elif 0.3 * decade >= apart:
            values = [m * 10.0**k for k in inside for m in (1, 2, 5)]
        elif 0.47 * decade >= apart:
            values = [m * 10.0**k for k in inside for m in (1, 3)]
        else:
            step = max(1, math.ceil(apart / decade))
            values = [10.0**k for k in inside if k % step == 0]
        return [value for value in values if self.low - 1e-9 <= math.log10(value) <= self.high + 1e-9]


def _power(value: float) -> str:
    """A tick: 0.05, 20, 10⁻⁷."""
    power = math.floor(math.log10(value) + 1e-9)
    if -4 <= power <= 4:
        more = 0 if abs(value / 10.0**power % 1.0 - 0.5) > 0.1 else 1  # 1.5
        return f"{value:,.{max(0, more - power)}f}".replace(",", "\u202f")
    times = f"{value / 10.0**power:.2g}"
    return ("" if times == "1" else f"{times}×") + f"10{str(power).translate(_RAISED)}"


def front_of(points: Sequence[Point], norm: str = "relmse") -> dict[int, str]:
    """The members of the front of time and an error.

    Parameters
    ----------
    points : sequence of Point
    norm : str
        "relmse" takes the members that the report has; another one ("flip") has those of `froxel_ref.pareto.front`.

    Returns
    -------
    dict of int to str
        "certain" or "possible" by the index of the point, in order of the least time.

    Examples
    --------
    >>> from froxel_ref.report_record import Errors, Spread
    >>> def point(flip, least, median):
    ...     errors = Errors(0.1, 0.0, 0.0, 0.0, flip)
    ...     return Point("", "", "", (), 1, errors, Spread(least, median, 3), {}, None, "dominated")
    >>> front_of([point(0.1, 2.0, 2.5), point(0.2, 1.9, 2.1), point(0.2, 3.0, 3.5)], "flip")
    {1: 'possible', 0: 'certain'}
    """
    if norm == "relmse":
        found = {i: p.member for i, p in enumerate(points) if p.member in ("certain", "possible") and _placed(p, norm)}
    else:
        use = [i for i, p in enumerate(points) if p.member != "failed" and _placed(p, norm)]
        low, high = zip(*(_times(points[i]) for i in use), strict=True) if use else ((), ())
        members = front([_error(points[i], norm) for i in use], low, high).membership if use else ()
        found = {i: member for i, member in zip(use, members, strict=True) if member in ("certain", "possible")}
    return dict(sorted(found.items(), key=lambda item: _times(points[item[0]])[0]))


def _error(point: Point, norm: str) -> float:
    value = getattr(point.errors, norm)
    return math.nan if value is None else float(value)


def _times(point: Point) -> tuple[float, float]:
    """Both ends of the error bar, NaN where there are none."""
    if point.seconds is None or not point.seconds.least > 0.0 or not math.isfinite(point.seconds.end):
        return math.nan, math.nan
    return float(point.seconds.least), float(max(point.seconds.end, point.seconds.least))


def _placed(point: Point, norm: str) -> bool:
    """Whether it has a place between the axes; an error of 0 has one, on a line of its own."""
    error = _error(point, norm)
    return math.isfinite(error) and error >= 0.0 and math.isfinite(_times(point)[0])


# --- a sheet to draw on -----------------------------------------------------------------------------


class _Sheet:
    """A figure in pixels, y downwards; its height is set at the end."""

    def __init__(self, width: float) -> None:
        from matplotlib.figure import Figure

        self.figure = Figure(figsize=(width, width))
        self.axes = self.figure.add_axes((0.0, 0.0, 1.0, 1.0))
        self.axes.set_axis_off()
        self.width = 72.0 * width
        self.narrow = self.width < 600.0
        self.size = 11.0 if self.narrow else 12.8

    def text(self, x: float, y: float, words: str, colour: str = "ink", anchor: str = "left", *, bold: bool = False,
             big: bool = False, gid: str | None = None) -> None:
        """Words in one line, whose middle is at y."""
        size = self.size * (1.15 if big else 1.0)
        self.axes.text(x, y + 0.36 * size, _one_line(words).replace("$", r"\$"), color=THEME[colour][0], fontsize=size,
                       ha=anchor, va="baseline", family="DejaVu Sans", weight="bold" if bold else "normal", gid=gid,
                       clip_on=False)

    def line(self, xs: Sequence[float], ys: Sequence[float], colour: str, width: float = 1.0, *, dash: bool = False,
             alpha: float = 1.0, gid: str | None = None, order: float = 2.0) -> None:
        self.axes.plot(xs, ys, color=THEME[colour][0], linewidth=width, linestyle=(0, (4, 3)) if dash else "-",
                       alpha=alpha, gid=gid, zorder=order, clip_on=False, solid_capstyle="butt", marker="None")

    def box(self, x0: float, y0: float, x1: float, y1: float, colour: str, *, alpha: float = 1.0, order: float = 1.0,
            gid: str | None = None) -> None:
        from matplotlib.patches import Rectangle

        self.axes.add_patch(Rectangle((min(x0, x1), min(y0, y1)), abs(x1 - x0), abs(y1 - y0), linewidth=0.0,
                                      facecolor=THEME[colour][0], alpha=alpha, zorder=order, gid=gid, clip_on=False))

    def mark(self, x: float, y: float, shape: str, colour: str, size: float, *, fill: str | None = None,
             alpha: float = 1.0, width: float = 1.6, gid: str | None = None, order: float = 4.0) -> None:
        face = "none" if fill == "none" else THEME[fill or colour][0]
        self.axes.plot([x], [y], marker=shape, markersize=size, markerfacecolor=face, markeredgecolor=THEME[colour][0],
                       markeredgewidth=width, alpha=alpha, linestyle="None", gid=gid, zorder=order, clip_on=False)

    def long(self, words: str, bold: bool = False) -> float:
        """How wide words are."""
        return _long(_one_line(words), self.size, bold)

    def cut(self, words: str, room: float) -> str:
        """Words that fit, with … where they had to be cut."""
        words = _one_line(words)
        if self.long(words) <= room:
            return words
        while len(words) > 1 and self.long(words + "…") > room:
            words = words[:-1]
        return words.rstrip() + "…"

    def finish(self, height: float) -> Figure:
        self.figure.set_size_inches(self.width / 72.0, height / 72.0)
        self.axes.set_xlim(0.0, self.width)
        self.axes.set_ylim(height, 0.0)
        self.figure.patch.set_facecolor(THEME["paper"][0])
        return self.figure


def _one_line(words: str) -> str:
    """Without line breaks, and what no letter stands for."""
    return "".join(letter for letter in " ".join(words.split()) if letter.isprintable() or letter in "\u202f\u00a0")


def _long(words: str, size: float, bold: bool = False) -> float:
    from matplotlib.font_manager import FontProperties
    from matplotlib.textpath import text_to_path

    font = FontProperties(family="DejaVu Sans", size=size, weight="bold" if bold else "normal")
    width, _, _ = text_to_path.get_text_width_height_descent(words, font, ismath=False)
    return float(width)


@contextmanager
def _plain_settings() -> Iterator[None]:
    """Matplotlib as it comes, whatever the user's own settings; the same bytes for the same record."""
    import matplotlib

    with matplotlib.rc_context(), warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Glyph .* missing")  # names may be in any script; browsers have it
        matplotlib.rcdefaults()
        matplotlib.rcParams.update({"svg.fonttype": "none", "svg.hashsalt": "froxel-ref", "path.simplify": False})
        yield


# --- labels that do not overlap ---------------------------------------------------------------------


def _overlap(a: Field, b: Field) -> Field:
    """Areas that boxes (…, 4) of x0, y0, x1, y1 have in common, broadcast."""
    wide = np.minimum(a[..., 2], b[..., 2]) - np.maximum(a[..., 0], b[..., 0])
    high = np.minimum(a[..., 3], b[..., 3]) - np.maximum(a[..., 1], b[..., 1])
    return np.asarray(np.maximum(wide, 0.0) * np.maximum(high, 0.0))


def _labels(anchors: Field, sizes: Field, things: Field, weights: Field, area: tuple[float, float, float, float]
            ) -> tuple[Field, bool]:
    """Boxes for labels near their anchors, apart from each other, from things, and within the area.

    Parameters
    ----------
    anchors, sizes : ndarray, shape (n, 2)
    things : ndarray, shape (m, 4)
        Boxes that labels should not hide, and how much it matters: ``weights``, shape (m,).
    area : tuple of float

    Returns
    -------
    boxes : ndarray, shape (n, 4)
    apart : bool
        Whether no two of them overlap.
    """
    turns = np.arange(16) * (math.pi / 8.0) - math.pi / 4.0  # up and to the right first
    reach = np.array([7.0, 13.0, 20.0, 30.0, 42.0, 58.0, 78.0, 102.0, 130.0])
    way = np.stack([np.cos(turns), np.sin(turns)], axis=1)
    # A box touches the circle of that radius about its anchor: across by the side that it lies on.
    offsets = (reach[:, None, None] * way).reshape(-1, 1, 2)
    sides = np.tile(np.clip(way * 1.42, -1.0, 1.0), (len(reach), 1))[:, None, :]
    centres = anchors + offsets + sides * sizes / 2.0
    boxes = np.concatenate([centres - sizes / 2.0, centres + sizes / 2.0], axis=-1)
    far = np.repeat(reach, len(turns)) ** 1.5 * 0.35 + np.tile(0.8 * np.abs(np.sin((turns + math.pi / 4) / 2)),
                                                              len(reach))
    cost = far[:, None] + np.einsum("cnm,m->cn", _overlap(boxes[:, :, None, :], things), weights)
    outside = (np.maximum(area[0] - boxes[..., 0], 0.0) + np.maximum(area[1] - boxes[..., 1], 0.0)
               + np.maximum(boxes[..., 2] - area[2], 0.0) + np.maximum(boxes[..., 3] - area[3], 0.0))
    wrong = _inside(anchors, (boxes + np.array([-8.0, -5.0, 8.0, 5.0]))[:, :, None, :])  # would seem to be another's
    wrong[:, np.arange(len(anchors)), np.arange(len(anchors))] = False
    cost = cost + 1e3 * outside + 45.0 * wrong.sum(axis=2)
    every = np.arange(len(anchors))
    best = np.argsort(cost, axis=0, kind="stable")[:80]  # the rest is far away
    cost, boxes, outside = (np.take_along_axis(values, best.reshape(best.shape + (1,) * (values.ndim - 2)), axis=0)
                            for values in (cost, boxes, outside))
    best = _chosen(cost, _between(anchors, boxes))
    placed = boxes[best, every]
    clash = _overlap(placed[:, None], placed[None])
    np.fill_diagonal(clash, 0.0)
    return placed, not bool(clash.any()) and not bool((outside[best, every] > 0.5).any())


def _between(anchors: Field, boxes: Field) -> list[dict[int, Field]]:
    """For each label by each other one near it: what any two of their places (rows and columns) cost together."""
    near = np.clip(anchors, boxes[..., :2], boxes[..., 2:])
    leaders = anchors[:, None, :] + np.linspace(0.25, 1.0, 4)[:, None] * (near - anchors)[:, :, None, :]
    hulls = np.concatenate([boxes[..., :2].min(axis=0), boxes[..., 2:].max(axis=0)], axis=1)
    pairs: list[dict[int, Field]] = [{} for _ in anchors]
    for i, j in zip(*np.nonzero(np.triu(_overlap(hulls[:, None], hulls[None]) > 0.0, 1)), strict=True):
        clash = _overlap(boxes[:, i, None], (boxes[:, j] + np.array([-2.0, -1.0, 2.0, 1.0]))[None])
        crossed = _inside(leaders[:, i, None], boxes[None, :, j, None]).sum(axis=2)
        crossed += _inside(leaders[None, :, j], boxes[:, i, None, None]).sum(axis=2)
        pairs[i][int(j)] = clash + 200.0 * (clash > 0.0) + 12.0 * crossed
        pairs[j][int(i)] = pairs[i][int(j)].T
    return pairs


def _chosen(cost: Field, pairs: Sequence[Mapping[int, Field]]) -> NDArray[np.intp]:
    """A place for each label, such that no label alone, and hardly any with those that it pushes away, is better off.

    Parameters
    ----------
    cost : ndarray, shape (places, labels)
        Of each place, whatever the others do.
    pairs : sequence of mapping of int to ndarray, shape (places, places)
        What two labels cost together.
    """
    every = np.arange(cost.shape[1])

    def costs(i: int, chosen: NDArray[np.intp]) -> Field:
        total = cost[:, i].copy()
        for j, both in pairs[i].items():
            total += both[:, chosen[j]]
        return total

    def settled(chosen: NDArray[np.intp], order: NDArray[np.intp], most: int) -> tuple[NDArray[np.intp], float]:
        """Each in turn takes its best place, until none moves; and what all cost then."""
        for _ in range(most):
            before = chosen.copy()
            for i in map(int, order):
                chosen[i] = np.argmin(costs(i, chosen))
            if np.array_equal(before, chosen):
                break
        alone = cost[chosen, every]
        together = sum(costs(int(i), chosen)[chosen[i]] - alone[i] for i in every)
        return chosen, float(alone.sum() + 0.5 * together)

    start = np.argmin(cost, axis=0)
    best, least = min((settled(start.copy(), order, 30) for order in (every, every[::-1])), key=lambda found: found[1])
    for i in np.argsort(cost.min(axis=0) - cost[best, every], kind="stable")[:24]:  # pushed away, they push back
        for wish in np.argsort(cost[:, i], kind="stable")[:3]:
            if cost[best[i], i] > cost[wish, i] + 4.0:
                trial = best.copy()
                trial[i] = wish
                trial, total = settled(trial, np.append(every[every != i], i), 3)
                if total < least - 1e-9:
                    best, least = trial, total
    return best


def _inside(points: Field, boxes: Field) -> NDArray[np.bool_]:
    """Whether points (…, 2) lie in boxes (…, 4), broadcast."""
    x, y = points[..., 0], points[..., 1]
    return np.asarray((x >= boxes[..., 0]) & (x <= boxes[..., 2]) & (y >= boxes[..., 1]) & (y <= boxes[..., 3]))


def _along(xs: Sequence[float], ys: Sequence[float]) -> Field:
    """Small boxes along a line of upright and level pieces."""
    parts = []
    for x0, x1, y0, y1 in zip(xs[:-1], xs[1:], ys[:-1], ys[1:], strict=True):
        steps = max(2, int(max(abs(x1 - x0), abs(y1 - y0)) / 8.0) + 1)
        parts.append(np.stack([np.linspace(x0, x1, steps), np.linspace(y0, y1, steps)], axis=1))
    middle = np.concatenate(parts) if parts else np.zeros((0, 2))
    return np.concatenate([middle - 3.0, middle + 3.0], axis=1)


# --- error against time -----------------------------------------------------------------------------


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
    with _plain_settings():
        return _figure_error(report, width, norm)


class _Spot(NamedTuple):
    """A point on the sheet; ``end`` is where its bar of error ends, NaN where there is none."""

    place: int
    x: float
    y: float
    end: float
    failed: bool


def _figure_error(report: Report, width: float, norm: str) -> Figure:
    sheet, points = _Sheet(width), report.points
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


class _Lanes(NamedTuple):
    """Strips at the edges: of points without an error above, without a time right, without any difference below."""

    top: float
    right: float
    bottom: float


def _recommended(report: Report) -> str:
    return "" if report.recommendation is None else report.recommendation.point


def _failed(point: Point, norm: str) -> bool:
    return point.member == "failed" or (norm == "relmse" and not _placed(point, norm))


def _scales(points: Sequence[Point], shown: Sequence[int], norm: str, frame: tuple[float, float, float, float],
            floor: float) -> tuple[_Log, _Log, _Lanes]:
    errors = [_error(points[i], norm) for i in shown]
    times = [t for i in shown for t in _times(points[i]) if math.isfinite(t)] or [1e-3, 1.0]
    values = [e for e in errors if math.isfinite(e) and e > 0.0] or [1e-3, 1.0]
    below = 0.0 < floor < math.inf and floor <= 0.05 * min(values)  # room for its words alone
    if 0.0 < floor < math.inf and not below:
        values = [*values, floor * 0.6]
    lanes = _Lanes(
        30.0 if any(not (math.isfinite(e) and e >= 0.0) for e in errors) else 0.0,
        34.0 if any(not math.isfinite(_times(points[i])[0]) for i in shown) else 0.0,
        24.0 if any(e == 0.0 for e in errors) else 0.0)

    def ends(these: Sequence[float], before: float, after: float) -> tuple[float, float]:
        low, high = math.log10(min(these)), math.log10(max(these))
        span = max(high - low, 0.5)
        middle = (low + high) / 2.0
        return middle - span * (0.5 + before), middle + span * (0.5 + after)

    x0, y0, x1, y1 = frame
    across = _Log(*ends([1e3 * t for t in times], 0.09, 0.16), x0, x1 - lanes.right)
    up = _Log(*ends(values, 0.12 if below else 0.07, 0.09), y1 - lanes.bottom, y0 + lanes.top)
    return across, up, lanes


def _grid(sheet: _Sheet, across: _Log, up: _Log, frame: tuple[float, float, float, float], lanes: _Lanes) -> None:
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
        x, words = across.at(value), _power(value)
        sheet.line([x, x], [y0, y1], "grid", 0.8, order=1.5)
        if x + sheet.long(words) / 2.0 <= x1 + 4.0:
            sheet.text(x, y1 + 14.0, words, "soft", "center")
    for value in up.ticks(26.0):
        y = up.at(value)
        sheet.line([x0, x1], [y, y], "grid", 0.8, order=1.5)
        sheet.text(x0 - 6.0, y, _power(value), "soft", "right")
    sheet.line([x0, x0, x1, x1, x0], [y1, y0, y0, y1, y1], "edge", 0.9, order=1.6)
    sheet.text(x0 + (across.end - x0) / 2.0, y1 + 32.0, "time of a frame [ms]", bold=True, anchor="center")


def _floor(sheet: _Sheet, floor: float, up: _Log, frame: tuple[float, float, float, float], lanes: _Lanes) -> Field:
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


def _spots(points: Sequence[Point], shown: Sequence[int], norm: str, across: _Log, up: _Log,
           frame: tuple[float, float, float, float], lanes: _Lanes) -> list[_Spot]:
    _, y0, x1, y1 = frame
    spots, lost = [], 0
    room = max(1, int((up.start - y0 - 10.0) // 20.0))
    for i in shown:
        error, (least, median) = _error(points[i], norm), _times(points[i])
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


def _draw_spot(sheet: _Sheet, point: Point, spot: _Spot, member: str | None, look: tuple[str, str]) -> None:
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


def _name_spots(sheet: _Sheet, points: Sequence[Point], spots: Sequence[_Spot], front: Mapping[int, str],
                stairs: tuple[list[float], list[float]], floor: Field, frame: tuple[float, float, float, float],
                y: float, chosen: str) -> float:
    """Labels of the front, the base and what failed; returns where the key of numbers, if there is one, ends."""
    named = sorted((s for s in spots if s.place in front or s.failed or points[s.place].knob == "base"),
                   key=lambda s: (s.failed, s.x, s.y))
    if not named:
        return y
    anchors = np.array([(s.x, s.y) for s in named])
    reach = np.array([[9.0 if points[s.place].knob == "base" else 5.5 if s in named else 3.5] for s in spots])
    middles = np.array([(s.x, s.y) for s in spots])
    bars = np.array([(s.x, s.y - 3.0, s.end, s.y + 3.0) for s in named if s.end > s.x]).reshape(-1, 4)
    steps = _along(*stairs)
    things = np.concatenate([np.concatenate([middles - reach, middles + reach], axis=1), bars, steps, floor])
    weights = np.concatenate([np.where(reach[:, 0] > 4.0, 3.0, 0.8), np.full(len(bars), 0.5), np.full(len(steps), 0.8),
                              np.full(len(floor), 2.0)])
    x0, y0, x1, y1 = frame
    area = (x0 + 3.0, y0 + 3.0, x1 - 3.0, y1 - 3.0)
    words = [_called(points[s.place]) for s in named]
    numbered = len(named) > (6 if sheet.narrow else 24)
    if not numbered:
        full = words
        boxes, apart = _labels(anchors, _extent(sheet, full), things, weights, area)
        numbered = not apart
    if numbered:
        full = [str(i + 1) for i in range(len(named))]
        boxes, _ = _labels(anchors, _extent(sheet, full), things, weights, area)
    for spot, text, box in zip(named, full, boxes, strict=True):
        bold = points[spot.place].id == chosen
        _draw_label(sheet, spot, text, box, "fail" if spot.failed else "ink", bold)
    return _numbers(sheet, named, words, y) if numbered else y


def _called(point: Point) -> str:
    return "base" if point.knob == "base" else point.id


def _extent(sheet: _Sheet, words: Sequence[str]) -> Field:
    return np.array([(sheet.long(word, True) + 3.0, 1.16 * sheet.size) for word in words])


def _draw_label(sheet: _Sheet, spot: _Spot, words: str, box: Field, colour: str, bold: bool) -> None:
    """Words in their box, and a line to the point where it is not next to them."""
    x, y = min(max(spot.x, box[0]), box[2]), min(max(spot.y, box[1]), box[3])
    if math.hypot(x - spot.x, y - spot.y) > 15.0:
        gap = 7.0 / math.hypot(x - spot.x, y - spot.y)
        sheet.line([spot.x + gap * (x - spot.x), x], [spot.y + gap * (y - spot.y), y], "edge", 0.8, order=2.6)
    if colour != "fail":
        sheet.box(box[0] + 1.0, box[1] + 1.0, box[2] - 1.0, box[3] - 1.0, "paper", alpha=0.72, order=2.7)
    sheet.text((box[0] + box[2]) / 2.0, (box[1] + box[3]) / 2.0, words, colour, "center", gid=f"l{spot.place}",
               bold=bold)


def _numbers(sheet: _Sheet, named: Sequence[_Spot], words: Sequence[str], y: float) -> float:
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


def _key(sheet: _Sheet, points: Sequence[Point], spots: Sequence[_Spot], looks: Mapping[str, tuple[str, str]], y: float,
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


def _sign(sheet: _Sheet, x: float, y: float, shape: str, colour: str) -> None:
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


# --- bars -------------------------------------------------------------------------------------------


class _Row(NamedTuple):
    """A stacked bar: name, (length, colour) pairs, a thin mark or NaN, words at the right."""

    name: str
    pieces: tuple[tuple[float, str], ...]
    mark: float
    words: tuple[str, ...]


def _row(name: str, pieces: Sequence[tuple[float, str]], mark: float, *words: str) -> _Row:
    """A bar of what can be drawn: lengths that are no numbers, or beyond all measure, are said in words alone."""
    return _Row(name, tuple((v, colour) for v, colour in pieces if abs(v) < 1e12),
                mark if abs(mark) < 1e12 else math.nan, words)


def _bars(sheet: _Sheet, rows: Sequence[_Row], heads: Sequence[str], y: float, low: float, high: float) -> float:
    """Bars under each other, from ``low`` to ``high``; returns where they end."""
    columns = [max([sheet.long(head, True), *(sheet.long(row.words[i]) for row in rows)]) + 14.0
               for i, head in enumerate(heads)]
    names = 0.0 if sheet.narrow else min(max((sheet.long(row.name) for row in rows), default=0.0), 230.0) + 14.0
    x0, x1 = 4.0 + names, sheet.width - (10.0 if sheet.narrow else sum(columns) + 6.0)
    scale = (x1 - x0) / max(high - low, 1e-300)
    zero = x0 - low * scale
    pitch, thick = (44.0, 14.0) if sheet.narrow else (30.0, 17.0)
    rights = [sheet.width - 4.0 - sum(columns[i + 1:]) for i in range(len(columns))]
    for right, title in zip(rights, heads, strict=True):
        sheet.text(right, y, title, "soft", "right")
    y += 10.0
    first = y
    for row in rows:
        middle = y + (32.0 if sheet.narrow else pitch / 2.0)
        head = y + 14.0 if sheet.narrow else middle
        room = (rights[0] - columns[0] if sheet.narrow and rights else names) - 8.0
        sheet.text(4.0, head, sheet.cut(row.name, room if sheet.narrow or names else 100.0))
        for right, words in zip(rights, row.words, strict=True):
            sheet.text(right, head, words, "ink", "right")
        over, under = zero, zero
        for length, colour in row.pieces:
            if not math.isfinite(length) or length == 0.0:
                continue
            edge = "paper" if abs(length) * scale > 2.0 else colour
            if length > 0.0:
                sheet.box(over, middle - thick / 2.0, over + length * scale, middle + thick / 2.0, colour)
                over += length * scale
                sheet.line([over, over], [middle - thick / 2.0, middle + thick / 2.0], edge, 0.8)
            else:
                sheet.box(under + length * scale, middle - thick / 2.0, under, middle + thick / 2.0, colour)
                under += length * scale
                sheet.line([under, under], [middle - thick / 2.0, middle + thick / 2.0], edge, 0.8)
        if math.isfinite(row.mark):
            at = zero + min(max(row.mark, low), high) * scale
            sheet.line([at, at], [middle - thick / 2.0 - 4.0, middle + thick / 2.0 + 4.0], "paper", 4.0, order=3.0)
            sheet.line([at, at], [middle - thick / 2.0 - 4.0, middle + thick / 2.0 + 4.0], "ink", 2.0, order=3.1)
            if row.mark > high:
                sheet.mark(at + 4.0, middle, ">", "ink", 5.0, width=0.5)
        if sheet.narrow:
            sheet.line([zero, zero], [middle - thick / 2.0 - 3.0, middle + thick / 2.0 + 3.0], "edge", 1.0, order=1.6)
        y += pitch
    if not sheet.narrow:
        sheet.line([zero, zero], [first, y + 2.0], "edge", 1.0, order=1.6)
    return y + 8.0


def _legend(sheet: _Sheet, entries: Sequence[tuple[str, str]], y: float, mark: str = "") -> float:
    """Coloured squares and their words, and what the thin mark is."""
    x = 4.0
    for words, colour in [*entries, *([(mark, "")] if mark else [])]:
        words = sheet.cut(words, sheet.width - 30.0)
        long = 17.0 + sheet.long(words) + 16.0
        if x > 4.0 and x + long - 12.0 > sheet.width:
            x, y = 4.0, y + sheet.size * 1.6
        if colour:
            sheet.box(x, y - 5.5, x + 11.0, y + 5.5, colour)
        else:
            sheet.line([x + 5.5, x + 5.5], [y - 7.0, y + 7.0], "ink", 2.0)
        sheet.text(x + 17.0, y, words, "soft")
        x += long
    return y + sheet.size * 1.3


def figure_budget(report: Report, width: float = WIDE) -> Figure | None:
    """Where the base's error comes from: the share of each part, of the rest and of the interaction, by region.

    Parameters
    ----------
    report : Report
    width : float [in]

    Returns
    -------
    Figure or None
        None where there is no budget, or its total is 0 or not a number.
    """
    budget = report.budget
    if budget is None or not math.isfinite(budget.total) or budget.total <= 0.0:
        return None
    with _plain_settings():
        sheet = _Sheet(width)
        names = list(budget.regions)
        colours = {name: SERIES[i % len(SERIES)] for i, name in enumerate(names)}
        rows = []
        for part in budget.parts:
            pieces = tuple((part.regions.get(name, 0.0), colours[name]) for name in names)
            alone = math.nan if part.alone is None else part.alone / budget.total
            rows.append(_row(part.name, pieces or ((part.share, "front"),), alone, percent(part.share), percent(alone)))
        for name, share, relmse in (("rest, with all parts true", budget.rest, budget.rest_relmse),
                                    ("interaction of parts", budget.interaction, budget.interaction_relmse)):
            rows.append(_row(name, ((share, "edge"),), relmse / budget.total,
                             percent(share), percent(relmse / budget.total)))
        ends = [(sum(min(v, 0.0) for v, _ in row.pieces), sum(max(v, 0.0) for v, _ in row.pieces)) for row in rows]
        low, high = min(0.0, *(end[0] for end in ends)), max(0.01, *(end[1] for end in ends))
        marks = [row.mark for row in rows if math.isfinite(row.mark)]
        high = max(high, min(max(marks, default=0.0), 1.5 * high)) * 1.03
        sheet.text(4.0, 13.0, f"relMSE {number(budget.total)} of the base: what it comes from", bold=True,
                   big=not sheet.narrow)
        y = _bars(sheet, rows, ("share", "alone"), 36.0, low * 1.05, high)
        entries = [(f"{name}, {percent(budget.regions[name])} of the pixels", colours[name]) for name in names]
        return sheet.finish(_legend(sheet, [*entries, ("all regions", "edge")], y + 12.0,
                                    "alone: its relMSE with everything else true, over the total") + 2.0)


def figure_stages(report: Report, width: float = WIDE, *, most: int = 16) -> Figure | None:
    """What the stages of the front's points take.

    Parameters
    ----------
    report : Report
    width : float [in]
    most : int
        Bars, evenly taken from the front, its ends among them.

    Returns
    -------
    Figure or None
        None where no point of the front has times of stages.
    """
    front = [report.points[i] for i in front_of(report.points)]
    front += [p for p in report.points if p.knob == "base" and _placed(p, "relmse") and p not in front]
    front = sorted((p for p in front if p.stages), key=lambda p: _times(p)[0])
    if not front:
        return None
    if len(front) > most:
        front = [front[round(i * (len(front) - 1) / (most - 1))] for i in range(most)]
    total: dict[str, float] = {}
    for point in front:
        for name, seconds in point.stages.items():
            total[name] = max(total.get(name, 0.0), seconds / _times(point)[0] if math.isfinite(seconds) else 0.0)
    names = sorted(total, key=lambda name: -total[name])[:7]
    names = [name for name in total if name in names]
    with _plain_settings():
        sheet = _Sheet(width)
        rows = []
        apart = _times(front[-1])[0] > 30.0 * _times(front[0])[0]  # too far to be seen beside each other: shares
        for point in front:
            unit = _times(point)[0] if apart else 1.0
            pieces = [(point.stages.get(name, 0.0) / unit, SERIES[i]) for i, name in enumerate(names)]
            others = _times(point)[0] / unit - sum(v for v, _ in pieces if math.isfinite(v))
            rows.append(_row(_called(point), (*pieces, (max(others, 0.0), "edge")), math.nan,
                             milliseconds(_times(point)[0]), number(point.errors.relmse)))
        high = max(sum(v for v, _ in row.pieces) for row in rows) or 1.0
        title = "What stages take of each frame" if apart else "What stages take"
        sheet.text(4.0, 13.0, f"{title}, along the front", bold=True, big=not sheet.narrow)
        y = _bars(sheet, rows, ("time [ms]", "relMSE"), 36.0, 0.0, high)
        entries = [(name, SERIES[i]) for i, name in enumerate(names)]
        rest = max(v for row in rows for v, colour in (*row.pieces, (0.0, "edge")) if colour == "edge")
        entries += [("all else", "edge")] * (rest > 1e-3 * high)
        return sheet.finish(_legend(sheet, entries, y + 12.0) + 2.0)


def figure_planned(report: Report, width: float = WIDE) -> Figure | None:
    """The frame as planned against everything forced on: time and memory.

    Parameters
    ----------
    report : Report
    width : float [in]

    Returns
    -------
    Figure or None
        None where that was not measured.
    """
    saved = report.saved
    if saved is None:
        return None
    with _plain_settings():
        sheet = _Sheet(width)
        sheet.text(4.0, 13.0, "What leaving out saves", bold=True, big=not sheet.narrow)
        both = (("as planned", "s0", saved.planned, saved.planned_bytes),
                ("all forced on", "s7", saved.forced, saved.forced_bytes))
        times = [_row(name, ((1e3 * spread.least, colour),), 1e3 * spread.median,
                      f"{milliseconds(spread.least)}\u202fms") for name, colour, spread, _ in both]
        sizes = [_row(name, ((size / 1e6, colour),), math.nan, f"{megabytes(size)}\u202fMB")
                 for name, colour, _, size in both]
        y = 26.0
        for rows, words, many in (
                (times, "time of a frame, least of the runs", saved.forced.least / saved.planned.least
                 if saved.planned.least > 0.0 else math.nan),
                (sizes, "most memory that arrays take", saved.forced_bytes / saved.planned_bytes
                 if saved.planned_bytes else math.nan)):
            less = f": forced takes {number(many)} times as much" if math.isfinite(many) else ""
            sheet.text(4.0, y + 14.0, sheet.cut(words + ("" if sheet.narrow else less), sheet.width - 8.0), "soft")
            high = max([v for row in rows for v in (*(p for p, _ in row.pieces), row.mark) if v > 0.0], default=1.0)
            y = _bars(sheet, rows, ("",), y + 16.0, 0.0, high * 1.02 or 1.0)
        return sheet.finish(_legend(sheet, [], y + 8.0, "median of the runs") + 2.0)


# --- refinement -------------------------------------------------------------------------------------


def figure_refinement(report: Report, width: float = WIDE) -> Figure | None:
    """The root of relMSE and the mean absolute error against the step, logarithmic, with the fitted orders.

    Parameters
    ----------
    report : Report
    width : float [in]

    Returns
    -------
    Figure or None
        None where fewer than two levels have an error.
    """
    refinement = report.refinement
    levels = [] if refinement is None else [
        level for level in refinement.levels if 0.0 < level.errors.relmse < math.inf and 0.0 < level.step < math.inf]
    if refinement is None or len(levels) < 2:
        return None
    with _plain_settings():
        sheet = _Sheet(width)
        x0, y0 = (50.0 if sheet.narrow else 66.0), 28.0
        x1, y1 = sheet.width - 14.0, y0 + (230.0 if sheet.narrow else 310.0)
        steps, roots = [level.step for level in levels], [math.sqrt(level.errors.relmse) for level in levels]
        series = [("√relMSE", roots, refinement.order, refinement.residual, "s0", "o")]
        means = [level.errors.absolute for level in levels]
        if all(0.0 < mean < 1e300 for mean in means):
            series.append(("mean |error|", means, refinement.absolute_order, refinement.absolute_residual, "s1", "s"))
        every = [error for _, errors, *_ in series for error in errors]
        floor = math.sqrt(report.reference.floor) if 0.0 < report.reference.floor < math.inf else 0.0
        lowest = min(every) if floor < 0.2 * min(every) else min(*every, 0.7 * floor)

        def scale(these: Sequence[float], start: float, end: float, pad: float) -> _Log:
            low, high = math.log10(min(these)), math.log10(max(these))
            span = max(high - low, 0.3)
            return _Log(low - pad * span, high + pad * span, start, end)

        across, up = scale(steps, x0, x1, 0.12), scale([lowest, max(every)], y1, y0, 0.14)
        sheet.text(4.0, 12.0, " and ".join(name for name, *_ in series) + " [1]", bold=True)
        for value in _halves(steps):
            x = across.at(value)
            sheet.line([x, x], [y0, y1], "grid", 0.8, order=1.5)
            sheet.text(x, y1 + 14.0, _fraction(value), "soft", "center")
        for value in up.ticks(24.0):
            y = up.at(value)
            sheet.line([x0, x1], [y, y], "grid", 0.8, order=1.5)
            sheet.text(x0 - 6.0, y, _power(value), "soft", "right")
        sheet.line([x0, x0, x1, x1, x0], [y1, y0, y0, y1, y1], "edge", 0.9, order=1.6)
        sheet.text((x0 + x1) / 2.0, y1 + 32.0, "step, over the coarsest level’s", bold=True, anchor="center")
        if math.log10(floor or 1e-300) > up.low:
            y = max(up.at(floor), y0)
            sheet.box(x0, y, x1, y1, "soft", alpha=0.13)
            sheet.line([x0, x1], [y, y], "soft", 1.2, dash=True)
            sheet.text(x1 - 6.0, min(y + 10.0, y1 - 9.0), "the reference is no better", "soft", "right")
        things = np.array([(across.at(s) - 6.0, up.at(e) - 6.0, across.at(s) + 6.0, up.at(e) + 6.0)
                           for _, errors, *_ in series for s, e in zip(steps, errors, strict=True)])
        for at, (name, errors, order, residual, colour, shape) in enumerate(series):
            if order is not None and abs(order) < 50.0:
                things = np.concatenate([things, _fit(sheet, order, steps, errors, across, up, colour)])
            for step, error in zip(steps, errors, strict=True):
                sheet.mark(across.at(step), up.at(error), shape, colour, 8.0)
            said = f"{name}: " + ("no order could be fitted" if order is None else f"order {order:.2f}")
            if order is not None and residual is not None:
                said += f" (fit to within {percent(math.expm1(min(residual, 99.0)))})"
            y = y0 + 16.0 + 1.4 * at * sheet.size
            sheet.text(x0 + 10.0, y, said, colour if order is not None else "soft", bold=True)
            things = np.concatenate([things, [[x0, y - 9.0, x0 + 14.0 + sheet.long(said, True), y + 9.0]]])
        anchors = np.array([(across.at(s), up.at(r)) for s, r in zip(steps, roots, strict=True)])
        words = [sheet.cut(level.label, 200.0) for level in levels]
        if not sheet.narrow:
            boxes, _ = _labels(anchors, _extent(sheet, words), things, np.full(len(things), 1.5),
                               (x0 + 3.0, y0 + 3.0, x1 - 3.0, y1 - 3.0))
            for at, (text, box) in enumerate(zip(words, boxes, strict=True)):
                _draw_label(sheet, _Spot(at, anchors[at, 0], anchors[at, 1], math.nan, False), text, box, "soft", False)
        return sheet.finish(y1 + 44.0)


def _halves(steps: Sequence[float]) -> list[float]:
    """Ticks of steps: the steps themselves, if there are few."""
    return sorted(set(steps))[-8:]


def _fraction(step: float) -> str:
    inverse = 1.0 / step
    return f"1/{round(inverse)}" if inverse > 1.5 and abs(inverse - round(inverse)) < 1e-6 else f"{step:.3g}"


def _fit(sheet: _Sheet, order: float, steps: Sequence[float], roots: Sequence[float], across: _Log, up: _Log,
         colour: str) -> Field:
    """The line of that slope through the middle of the points; returns boxes along it."""
    middle = (float(np.mean(np.log10(steps))), float(np.mean(np.log10(roots))))
    ends = [min(steps), max(steps)]
    xs = [across.at(step) for step in ends]
    ys = [up.at_power(middle[1] + order * (math.log10(step) - middle[0])) for step in ends]
    sheet.line(xs, ys, colour, 1.5, dash=True)
    along = np.linspace(0.0, 1.0, 24)[:, None]
    points = np.array([xs[0], ys[0]]) * (1.0 - along) + np.array([xs[1], ys[1]]) * along
    return np.concatenate([points - 3.0, points + 3.0], axis=1)


# --- files and drawings -----------------------------------------------------------------------------


class Drawing(NamedTuple):
    """A plot as two pieces of SVG, to stand in a page."""

    wide: str
    narrow: str


def _flip(report: Report, width: float) -> Figure | None:
    return figure_error(report, width, norm="flip")


FIGURES = {"error-against-time": figure_error, "flip-against-time": _flip, "budget": figure_budget,
           "refinement": figure_refinement, "stages": figure_stages, "planned": figure_planned}


def pictures(report: Report) -> dict[str, bytes]:
    """All plots as PNG files, 1600 px wide, in light colours.

    Parameters
    ----------
    report : Report

    Returns
    -------
    dict of str to bytes
        By the file's name. What the report has nothing for is not there. The same report gives the same bytes.

    Raises
    ------
    InputError
        Matplotlib is missing.
    """
    return {f"{name}.png": png(figure) for name, figure in _figures(report, WIDE).items()}


def drawings(report: Report) -> dict[str, Drawing]:
    """All plots as SVG for a page, for wide screens and for phones.

    Parameters
    ----------
    report : Report

    Returns
    -------
    dict of str to Drawing
        By the plot's name. Colours are the CSS variables ``--p-NAME`` of `THEME`; what belongs to point i of the
        report has ``data-p="i"``, and its marker has the class ``pt``.

    Raises
    ------
    InputError
        Matplotlib is missing.
    """
    wide, narrow = _figures(report, WIDE), _figures(report, NARROW)
    return {name: Drawing(svg(wide[name], report, f"{name}-w-"), svg(narrow[name], report, f"{name}-n-"))
            for name in wide}


def _figures(report: Report, width: float) -> dict[str, Figure]:
    if not plots_available():
        raise InputError("plots", "matplotlib is missing; install froxel-ref[report]")
    drawn = {name: make(report, width) for name, make in FIGURES.items()}
    return {name: figure for name, figure in drawn.items() if figure is not None}


def png(figure: Figure) -> bytes:
    """A figure as a PNG file, 1600 px wide.

    Parameters
    ----------
    figure : Figure

    Returns
    -------
    bytes
    """
    file = io.BytesIO()
    with _plain_settings():
        figure.savefig(file, format="png", dpi=PICTURE_WIDTH / figure.get_size_inches()[0], metadata={"Software": None})
    return file.getvalue()


def svg(figure: Figure, report: Report, prefix: str) -> str:
    """A figure as SVG to stand in a page.

    Parameters
    ----------
    figure : Figure
    report : Report
        That it is of.
    prefix : str
        Put before every id, so that many plots may stand in one page.

    Returns
    -------
    str
        One ``svg`` element that needs nothing from elsewhere.
    """
    file = io.StringIO()
    with _plain_settings():
        figure.patch.set_visible(False)
        figure.savefig(file, format="svg", metadata=dict.fromkeys(("Date", "Creator", "Format", "Type")))
        figure.patch.set_visible(True)
    text = file.getvalue()
    text = text[text.index("<svg"):]
    text = re.sub(r"<metadata>.*?</metadata>|<!--.*?-->|<title>.*?</title>", "", text, flags=re.DOTALL)
    text = re.sub(r'<svg [^>]*?viewBox="([^"]*)"[^>]*>', r'<svg viewBox="\1">', text, count=1)
    text = re.sub(r"font-family: [^;\"]*;? ?", "", text)
    names = {light: f"var(--p-{name})" for name, (light, _) in THEME.items()}
    text = re.sub(r"#[0-9a-f]{6}\b", lambda found: names.get(found[0], found[0]), text)
    text = text.replace("xlink:href", "href")
    text = re.sub(r'id="([pblr])(\d+)"', lambda found: _tied(found[1], int(found[2]), report), text)
    text = re.sub(r'(?<= id=")|(?<=url\(#)|(?<=href="#)', prefix, text)
    return re.sub(r"\n\s*", "\n", text).strip()


def _tied(kind: str, index: int, report: Report) -> str:
    """What ties an element to a point: markers, which can have the focus, and bars, labels and rings."""
    if kind != "p":
        return f'class="of-{kind}" data-p="{index}"'
    words = html.escape(point_words(report.points[index]), quote=True)
    return f'class="pt" data-p="{index}" tabindex="-1" role="button" aria-label="{words}"'


def point_words(point: Point) -> str:
    """A point in one sentence, for those who hear it.

    Parameters
    ----------
    point : Point

    Returns
    -------
    str

    Examples
    --------
    >>> from froxel_ref.report_record import Errors
    >>> point_words(Point("slices=32", "slices", "32", (), 1, Errors(*[float("nan")] * 4), None, {}, None, "failed",
    ...                   "refused"))
    'slices=32: failed, refused'
    """
    if point.member == "failed":
        return f"{_called(point)}: failed, {point.fault or point.errors.fault}"
    return f"{_called(point)}: {milliseconds(_times(point)[0])} ms, relMSE {number(point.errors.relmse)}"
