"""Bars of a report, and the three plots made of them: the budget, stages, and what leaving out saves."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, NamedTuple

from froxel_ref.report_front import called, front_of, placed, times_of
from froxel_ref.report_numbers import megabytes, milliseconds, number, percent
from froxel_ref.report_record import Budget, Point, Report
from froxel_ref.report_sheet import SERIES, WIDE, Sheet, plain_settings

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["figure_budget", "figure_planned", "figure_stages"]


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
    with plain_settings():
        sheet = Sheet(width)
        colours = {name: SERIES[i % len(SERIES)] for i, name in enumerate(budget.regions)}
        rows = _budget_rows(budget, colours)
        ends = [(sum(min(v, 0.0) for v, _ in row.pieces), sum(max(v, 0.0) for v, _ in row.pieces)) for row in rows]
        low, high = min(0.0, *(end[0] for end in ends)), max(0.01, *(end[1] for end in ends))
        marks = [row.mark for row in rows if math.isfinite(row.mark)]
        high = max(high, min(max(marks, default=0.0), 1.5 * high)) * 1.03
        sheet.text(4.0, 13.0, f"relMSE {number(budget.total)} of the base: what it comes from", bold=True,
                   big=not sheet.narrow)
        y = _bars(sheet, rows, ("share", "alone"), 36.0, low * 1.05, high)
        entries = [(f"{name}, {percent(share)} of the pixels", colours[name]) for name, share in budget.regions.items()]
        return sheet.finish(_legend(sheet, [*entries, ("all regions", "edge")], y + 12.0,
                                    "alone: its relMSE with everything else true, over the total") + 2.0)


def _budget_rows(budget: Budget, colours: Mapping[str, str]) -> list[_Row]:
    """A bar for each part, in pieces by region, and for what parts do not explain."""
    rows = []
    for part in budget.parts:
        pieces = tuple((part.regions.get(name, 0.0), colour) for name, colour in colours.items())
        alone = math.nan if part.alone is None else part.alone / budget.total
        rows.append(_row(part.name, pieces or ((part.share, "front"),), alone, percent(part.share), percent(alone)))
    for name, share, relmse in (("rest, with all parts true", budget.rest, budget.rest_relmse),
                                ("interaction of parts", budget.interaction, budget.interaction_relmse)):
        rows.append(_row(name, ((share, "edge"),), relmse / budget.total,
                         percent(share), percent(relmse / budget.total)))
    return rows


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
    front = _staged(report.points, most)
    if not front:
        return None
    names = _longest(front, 7)
    with plain_settings():
        sheet = Sheet(width)
        rows = []
        apart = times_of(front[-1])[0] > 30.0 * times_of(front[0])[0]  # too far to be seen beside each other: shares
        for point in front:
            unit = times_of(point)[0] if apart else 1.0
            pieces = [(point.stages.get(name, 0.0) / unit, SERIES[i]) for i, name in enumerate(names)]
            others = times_of(point)[0] / unit - sum(v for v, _ in pieces if math.isfinite(v))
            rows.append(_row(called(point), (*pieces, (max(others, 0.0), "edge")), math.nan,
                             milliseconds(times_of(point)[0]), number(point.errors.relmse)))
        high = max(sum(v for v, _ in row.pieces) for row in rows) or 1.0
        title = "What stages take of each frame" if apart else "What stages take"
        sheet.text(4.0, 13.0, f"{title}, along the front", bold=True, big=not sheet.narrow)
        y = _bars(sheet, rows, ("time [ms]", "relMSE"), 36.0, 0.0, high)
        entries = [(name, SERIES[i]) for i, name in enumerate(names)]
        rest = max(v for row in rows for v, colour in (*row.pieces, (0.0, "edge")) if colour == "edge")
        entries += [("all else", "edge")] * (rest > 1e-3 * high)
        return sheet.finish(_legend(sheet, entries, y + 12.0) + 2.0)


def _staged(points: Sequence[Point], most: int) -> list[Point]:
    """Points of the front, and the base, that have times of stages, by time; at most so many, evenly taken."""
    front = [points[i] for i in front_of(points)]
    front += [p for p in points if p.knob == "base" and placed(p) and p not in front]
    front = sorted((p for p in front if p.stages), key=lambda p: times_of(p)[0])
    if len(front) > most:
        front = [front[round(i * (len(front) - 1) / (most - 1))] for i in range(most)]
    return front


def _longest(points: Sequence[Point], count: int) -> list[str]:
    """The stages with the largest shares of any point's time, in the order of stages."""
    total: dict[str, float] = {}
    for point in points:
        for name, seconds in point.stages.items():
            total[name] = max(total.get(name, 0.0), seconds / times_of(point)[0] if math.isfinite(seconds) else 0.0)
    names = sorted(total, key=lambda name: -total[name])[:count]
    return [name for name in total if name in names]


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
    with plain_settings():
        sheet = Sheet(width)
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


def _bars(sheet: Sheet, rows: Sequence[_Row], heads: Sequence[str], y: float, low: float, high: float) -> float:
    """Bars under each other, from ``low`` to ``high``; returns where they end."""
    columns = [max([sheet.long(head, True), *(sheet.long(row.words[i]) for row in rows)]) + 14.0
               for i, head in enumerate(heads)]
    names = 0.0 if sheet.narrow else min(max((sheet.long(row.name) for row in rows), default=0.0), 230.0) + 14.0
    x0, x1 = 4.0 + names, sheet.width - (10.0 if sheet.narrow else sum(columns) + 6.0)
    scale = (x1 - x0) / max(high - low, 1e-300)
    zero = x0 - low * scale
    pitch, half = (44.0, 7.0) if sheet.narrow else (30.0, 8.5)
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
        _draw_pieces(sheet, row, zero, scale, middle - half, middle + half)
        if math.isfinite(row.mark):
            at = zero + min(max(row.mark, low), high) * scale
            sheet.line([at, at], [middle - half - 4.0, middle + half + 4.0], "paper", 4.0, order=3.0)
            sheet.line([at, at], [middle - half - 4.0, middle + half + 4.0], "ink", 2.0, order=3.1)
            if row.mark > high:
                sheet.mark(at + 4.0, middle, ">", "ink", 5.0, width=0.5)
        if sheet.narrow:
            sheet.line([zero, zero], [middle - half - 3.0, middle + half + 3.0], "edge", 1.0, order=1.6)
        y += pitch
    if not sheet.narrow:
        sheet.line([zero, zero], [first, y + 2.0], "edge", 1.0, order=1.6)
    return y + 8.0


def _draw_pieces(sheet: Sheet, row: _Row, zero: float, scale: float, top: float, bottom: float) -> None:
    """The pieces of a bar one behind another: to the right of zero, negative ones to its left."""
    over, under = zero, zero
    for length, colour in row.pieces:
        if not math.isfinite(length) or length == 0.0:
            continue
        edge = "paper" if abs(length) * scale > 2.0 else colour
        if length > 0.0:
            sheet.box(over, top, over + length * scale, bottom, colour)
            over += length * scale
            sheet.line([over, over], [top, bottom], edge, 0.8)
        else:
            sheet.box(under + length * scale, top, under, bottom, colour)
            under += length * scale
            sheet.line([under, under], [top, bottom], edge, 0.8)


def _legend(sheet: Sheet, entries: Sequence[tuple[str, str]], y: float, mark: str = "") -> float:
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
