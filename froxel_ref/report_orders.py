"""The plot of refinement: errors against the step, and the orders fitted to them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from froxel_ref.arrays import Field
from froxel_ref.report_labels import draw_label, extents, label_boxes
from froxel_ref.report_numbers import percent, tick
from froxel_ref.report_record import Level, Refinement, Report
from froxel_ref.report_sheet import WIDE, Log, Sheet, plain_settings

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["figure_refinement"]


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
    with plain_settings():
        sheet = Sheet(width)
        x0, y0 = (50.0 if sheet.narrow else 66.0), 28.0
        x1, y1 = sheet.width - 14.0, y0 + (230.0 if sheet.narrow else 310.0)
        steps, series = [level.step for level in levels], _series(refinement, levels)
        every = [error for each in series for error in each.errors]
        floor = math.sqrt(report.reference.floor) if 0.0 < report.reference.floor < math.inf else 0.0
        lowest = min(every) if floor < 0.2 * min(every) else min(*every, 0.7 * floor)
        across, up = _scale(steps, x0, x1, 0.12), _scale([lowest, 1.8 * max(every)], y1, y0, 0.14)
        sheet.text(4.0, 12.0, " and ".join(each.name for each in series) + " [1]", bold=True)
        _grid(sheet, steps, across, up)
        if math.log10(floor or 1e-300) > up.low:
            y = max(up.at(floor), y0)
            sheet.box(x0, y, x1, y1, "soft", alpha=0.13)
            sheet.line([x0, x1], [y, y], "soft", 1.2, dash=True)
            sheet.text(x1 - 6.0, min(y + 10.0, y1 - 9.0), "the reference is no better", "soft", "right")
        things = _draw_series(sheet, series, steps, across, up)
        if not sheet.narrow:
            anchors = np.array([(across.at(s), up.at(r)) for s, r in zip(steps, series[0].errors, strict=True)])
            words = [sheet.cut(level.label, 200.0) for level in levels]
            boxes, _ = label_boxes(anchors, extents(sheet, words), things, np.full(len(things), 1.5),
                                   (x0 + 3.0, y0 + 3.0, x1 - 3.0, y1 - 3.0))
            for at, (text, box) in enumerate(zip(words, boxes, strict=True)):
                draw_label(sheet, text, box, anchors[at], "soft")
        return sheet.finish(y1 + 44.0)


class _Series(NamedTuple):
    """An error by level, the order fitted to it and how far levels are from that, and how it is drawn."""

    name: str
    errors: list[float]
    order: float | None
    residual: float | None
    colour: str
    shape: str


def _series(refinement: Refinement, levels: Sequence[Level]) -> list[_Series]:
    """The root of relMSE, and the mean absolute error where all levels have one."""
    roots = [math.sqrt(level.errors.relmse) for level in levels]
    series = [_Series("√relMSE", roots, refinement.order, refinement.residual, "s0", "o")]
    means = [level.errors.absolute for level in levels]
    if all(0.0 < mean < 1e300 for mean in means):
        series.append(_Series("mean |error|", means, refinement.absolute_order, refinement.absolute_residual,
                              "s1", "s"))
    return series


def _scale(values: Sequence[float], start: float, end: float, pad: float) -> Log:
    """A scale of all values, and a share of their span beyond both ends."""
    low, high = math.log10(min(values)), math.log10(max(values))
    span = max(high - low, 0.3)
    return Log(low - pad * span, high + pad * span, start, end)


def _grid(sheet: Sheet, steps: Sequence[float], across: Log, up: Log) -> None:
    """Lines and numbers of both axes."""
    x0, x1, y0, y1 = across.start, across.end, up.end, up.start
    for value in _halves(steps):
        x = across.at(value)
        sheet.line([x, x], [y0, y1], "grid", 0.8, order=1.5)
        sheet.text(x, y1 + 14.0, _fraction(value), "soft", "center")
    for value in up.ticks(24.0):
        y = up.at(value)
        sheet.line([x0, x1], [y, y], "grid", 0.8, order=1.5)
        sheet.text(x0 - 6.0, y, tick(value), "soft", "right")
    sheet.line([x0, x0, x1, x1, x0], [y1, y0, y0, y1, y1], "edge", 0.9, order=1.6)
    sheet.text((x0 + x1) / 2.0, y1 + 32.0, "step, over the coarsest level’s", bold=True, anchor="center")


def _draw_series(sheet: Sheet, series: Sequence[_Series], steps: Sequence[float], across: Log, up: Log) -> Field:
    """Markers, fits, and words on them in the upper left corner; returns boxes that labels should not hide."""
    things = np.array([(across.at(s) - 6.0, up.at(e) - 6.0, across.at(s) + 6.0, up.at(e) + 6.0)
                       for each in series for s, e in zip(steps, each.errors, strict=True)])
    for at, (name, errors, order, residual, colour, shape) in enumerate(series):
        if order is not None and abs(order) < 50.0:
            things = np.concatenate([things, _fit(sheet, order, steps, errors, across, up, colour)])
        for step, error in zip(steps, errors, strict=True):
            sheet.mark(across.at(step), up.at(error), shape, colour, 8.0)
        said = f"{name}: " + ("no order could be fitted" if order is None else f"order {order:.2f}")
        if order is not None and residual is not None:
            said += f" (fit to within {percent(math.expm1(min(residual, 99.0)))})"
        x, y = across.start, up.end + 16.0 + 1.4 * at * sheet.size
        sheet.text(x + 10.0, y, said, colour if order is not None else "soft", bold=True)
        things = np.concatenate([things, [[x, y - 9.0, x + 14.0 + sheet.long(said, True), y + 9.0]]])
    return things


def _halves(steps: Sequence[float]) -> list[float]:
    """Ticks of steps: the steps themselves, if there are few."""
    return sorted(set(steps))[-8:]


def _fraction(step: float) -> str:
    """A step as 1/8, where it is one over a whole number."""
    inverse = 1.0 / step
    return f"1/{round(inverse)}" if inverse > 1.5 and abs(inverse - round(inverse)) < 1e-6 else f"{step:.3g}"


def _fit(sheet: Sheet, order: float, steps: Sequence[float], errors: Sequence[float], across: Log, up: Log,
         colour: str) -> Field:
    """The line of that slope through the middle of the points; returns boxes along it."""
    middle = (float(np.mean(np.log10(steps))), float(np.mean(np.log10(errors))))
    ends = [min(steps), max(steps)]
    xs = [across.at(step) for step in ends]
    ys = [up.at_power(middle[1] + order * (math.log10(step) - middle[0])) for step in ends]
    sheet.line(xs, ys, colour, 1.5, dash=True)
    along = np.linspace(0.0, 1.0, 24)[:, None]
    points = np.array([xs[0], ys[0]]) * (1.0 - along) + np.array([xs[1], ys[1]]) * along
    return np.concatenate([points - 3.0, points + 3.0], axis=1)
