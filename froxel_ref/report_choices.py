"""Sections of a report's page that compare its points: advice, key figures, plots, tables of them, and failures."""

from __future__ import annotations

import math
import shlex
from collections.abc import Mapping, Sequence

from froxel_ref.report_markup import (
    MEMBERS,
    base_of,
    cell,
    drawn,
    factor,
    failed,
    find,
    grouped,
    least,
    link,
    many,
    num,
    ratio,
    safe,
    sets,
    table,
    why,
)
from froxel_ref.report_numbers import megabytes, milliseconds, number, percent
from froxel_ref.report_plots import Drawing, plots_available
from froxel_ref.report_record import Errors, Point, Report

__all__ = [
    "key_figures", "section_equal", "section_failures", "section_plots", "section_points", "section_recommendation",
]


WORST = 0.25  # the share of relMSE from which on a single pixel is told


def section_recommendation(report: Report) -> str:
    """What is recommended, with a command to copy.

    Parameters
    ----------
    report : Report

    Returns
    -------
    str
        HTML; nothing where the report has nothing for it.
    """
    advice = report.recommendation
    if advice is None:
        return ""
    command = " ".join(filter(None, ["froxel-ref render", shlex.quote(report.setup.source or report.setup.scene),
                                     sets([*report.setup.overrides, *advice.overrides])]))
    steps = []
    if advice.up is not None:
        steps.append(f"More exact: {link(report, advice.up)}.")
    if advice.down is not None:
        steps.append(f"Faster: {link(report, advice.down)}.")
    best = find(report, advice.point)
    if best is None or failed(best[1]):
        return ('<section class="card rec missed" id="recommendation"><h2>No recommendation</h2>'
                f"<p>{safe(advice.words)}</p></section>")
    head = (f"For {safe(advice.limit)}: {link(report, advice.point)}" if advice.met else
            f"Nothing surely meets {safe(advice.limit)}; {link(report, advice.point)} comes closest")
    return (f'<section class="card rec{"" if advice.met else " missed"}" id="recommendation"><h2>{head}</h2>'
            f'<p>{safe(advice.words)}</p><div class="line"><code tabindex="0">{safe(command)}</code>'
            '<button class="copy" type="button">Copy</button></div>'
            + (f"<p>{' '.join(steps)}</p>" if steps else "") + "</section>")


def key_figures(report: Report) -> str:
    """The key figures, a tile each.

    Parameters
    ----------
    report : Report

    Returns
    -------
    str
        HTML.
    """
    base, good = base_of(report), [p for p in report.points if not failed(p)]
    tiles = []
    if base is not None and not failed(base):
        tiles.append(("base", num(milliseconds(least(base)), "ms"), f"relMSE {number(base.errors.relmse)}"))
    if good:
        fast, exact = min(good, key=least), min(good, key=lambda p: p.errors.relmse)
        tiles.append(("fastest", num(milliseconds(least(fast)), "ms"), f"{safe(fast.id)}, relMSE "
                      f"{number(fast.errors.relmse)}"))
        tiles.append(("most exact, relMSE", num(number(exact.errors.relmse)), f"{safe(exact.id)}, "
                      f"{milliseconds(least(exact))}\u202fms"))
    sure, maybe = (sum(p.member == word for p in report.points) for word in ("certain", "possible"))
    tiles.append(("on the front", num(str(sure)), f"and {maybe} perhaps, of {len(report.points)}"))
    tiles.append(("the reference’s own relMSE", num(number(report.reference.floor)),
                  f"{report.reference.unconverged} of {grouped(report.reference.pixels)} pixels did not converge"))
    saved = report.saved
    if saved is not None:
        tiles.append(("saved by leaving out", num(factor(ratio(saved.forced.least, saved.planned.least))),
                      f"in time, {factor(ratio(saved.forced_bytes, saved.planned_bytes))} in memory"))
    fails = sum(map(failed, report.points))
    if fails:
        tiles.append(("failed", f'<a class="num fail" href="#failures">{fails}</a>', f"of {len(report.points)}"))
    return '<dl class="figures">' + "".join(
        f"<div><dt>{name}</dt><dd>{value}<small>{words}</small></dd></div>" for name, value, words in tiles) + "</dl>"


def section_plots(report: Report, drawings: Mapping[str, Drawing]) -> str:
    """The plots of errors against time, or what would draw them.

    Parameters
    ----------
    report : Report
    drawings : mapping of str to Drawing

    Returns
    -------
    str
        HTML; nothing where the report has nothing for it.
    """
    if not drawings:
        return ("" if plots_available() else
                "<p>The plots are missing, the extra <code>report</code> draws them: <code>python -m pip "
                "install 'froxel-ref[report]'</code>, then the same command with <code>--resume</code>.</p>")
    hint = "Point at a mark, tap it, or reach it by Tab and the arrow keys; a click marks its row in the table."
    return (drawn("error-against-time", "A point lies at the least time of its runs; its bar ends where noise "
                  "is likely to end. The "
                  f"stepped line is the least error that is reached in so much time. {hint}", drawings)
            + drawn("flip-against-time", "The same by FLIP, which weighs errors as an eye does; its front is its own.",
                    drawings))


def section_points(report: Report) -> str:
    """All points in a table, with what sorts and filters it.

    Parameters
    ----------
    report : Report

    Returns
    -------
    str
        HTML; nothing where the report has nothing for it.
    """
    if not report.points:
        return ""
    base = least(base_of(report))
    flips = any(point.errors.flip is not None for point in report.points)
    heads = [("point", "its settings, beyond the base’s", "w lead"), ("knob", "what was turned", "w"),
             ("front", "of relMSE and time", "w"), ("time [ms]", "of a frame, the least of the runs", "n"),
             ("median [ms]", "of the runs", "n"),
             ("speed-up", "the base’s time over this one’s", "n"), ("relMSE", "mean of (a − b)²/(b² + ε)", "n"),
             ("mean |error|", "mean of |a − b|, over the mean of b", "n"),
             ("bias", "mean of a − b, over the mean of b", "n"),
             ("99.9th\u00a0pct.", "99.9th percentile of |a − b|, over the mean of b", "n"),
             ("largest", "largest |a − b|, over the mean of b", "n")]
    heads += [("FLIP", "mean HDR-FLIP", "n")] * flips
    heads += [("memory [MB]", "the most that arrays took at one moment", "n"),
              ("overrides", "what to give to --set", "w"), ("frames", "whose last was measured", "n"),
              ("runs", "timed runs", "n")]
    rows = "".join(_row(report, i, point, base, flips) for i, point in enumerate(report.points))
    knobs = "".join(f'<option value="{safe(knob)}">{safe(knob)}</option>'
                    for knob in dict.fromkeys(point.knob for point in report.points))
    return (f'<div class="tools"><label>knob <select id="knob"><option value="">all</option>{knobs}</select></label>'
            '<label><input type="checkbox" id="front"> front only</label>'
            '<button type="button" id="clear" disabled>show all</button>'
            f'<output id="shown" aria-live="polite">{many(len(report.points), "point")}</output></div>'
            + table(heads, rows, "points", tall=True, label="All points", sortable=True))


def hangs(errors: Errors) -> str:
    """A word of warning where few pixels decide on relMSE."""
    return f"<small>{percent(errors.worst)} in one pixel</small>" if errors.worst > WORST else ""


def _row(report: Report, index: int, point: Point, base: float, flips: bool) -> str:
    """A point's row in the table of all."""
    spread, errors = point.seconds, point.errors
    speed = ratio(base, least(point))
    front = MEMBERS.get(point.member, point.member)
    if failed(point):
        front = f'<b class="fail">failed</b><small>{safe(why(point))}</small>'
    elif point.member in ("certain", "possible"):
        front = f"<b>{front}</b>"
    cells = [f'<td class="lead" data-v="{safe(point.id)}"><button type="button" class="pick" aria-pressed="false">'
             f"{_broken(point.id)}</button></td><td>{safe(point.knob)}</td>"
             f'<td data-v="{list(MEMBERS).index(point.member) if point.member in MEMBERS else 9}">{front}</td>',
             cell(least(point), milliseconds(spread.least if spread else None)),
             cell(spread.median if spread else None, milliseconds(spread.median if spread else None)),
             cell(speed, factor(speed)), cell(errors.relmse, number(errors.relmse) + hangs(errors)),
             cell(errors.absolute, percent(errors.absolute)), cell(errors.bias, percent(errors.bias)),
             cell(errors.quantile, number(errors.quantile)), cell(errors.maximum, number(errors.maximum))]
    if flips:
        cells.append(cell(errors.flip, number(errors.flip)))
    cells += [cell(point.peak_bytes, megabytes(point.peak_bytes)),
              f'<td class="mono">{safe(shlex.join(point.overrides)) or "–"}</td>',  # in one line: rows stay low
              cell(point.frames, str(point.frames)),
              cell(spread.runs if spread else None, str(spread.runs) if spread else "–")]
    member = "1" if point.member in ("certain", "possible") else "0"
    return (f'<tr id="point-{index}" data-p="{index}" data-k="{safe(point.knob)}" data-f="{member}">'
            + "".join(cells) + "</tr>")


def _broken(words: str) -> str:
    """A name that may be broken behind its = and _."""
    return safe(words).replace("=", "=<wbr>").replace("_", "_<wbr>")


def section_equal(report: Report) -> str:
    """The most exact points by time, and the fastest by error.

    Parameters
    ----------
    report : Report

    Returns
    -------
    str
        HTML; nothing where the report has nothing for it.
    """
    if not report.equal_time and not report.equal_error:
        return ""
    parts = (_equal_time(report) if report.equal_time else "") + (_equal_error(report) if report.equal_error else "")
    return (f'<div class="pair">{parts}</div><p class="soft">Less error and speed-up are against the base: '
            "above 1 is better.</p>")


def bar(point: Point | None) -> str:
    """Both ends of a point's error bar, in ms."""
    if point is None or point.seconds is None:
        return milliseconds(None)
    return f"{milliseconds(point.seconds.least)} to {milliseconds(point.seconds.end)}"


def _equal_time(report: Report) -> str:
    """The most exact point of each time."""
    base = base_of(report)
    start = math.nan if base is None else base.errors.relmse
    rows = ""
    for target in report.equal_time:
        point = (find(report, target.point) or (0, None))[1]
        error = math.nan if point is None else point.errors.relmse
        maybe = f"<small>perhaps {link(report, target.perhaps)}</small>" if target.perhaps else ""
        rows += ("<tr>" + cell(target.budget, milliseconds(target.budget))
                 + f"<td>{link(report, target.point) if point else 'none surely' if maybe else '–'}{maybe}</td>"
                 + (cell(least(point), bar(point)) + cell(error, number(error))
                    + cell(None, factor(ratio(start, error))) if point else
                    '<td colspan="3" class="soft">no point is surely as fast</td>') + "</tr>")
    heads = [("at most [ms]", "a frame", "n"), ("most exact point", "whose whole bar fits", "w"),
             ("time [ms]", "its bar: the least, and what noise may make of it", "n"),
             ("relMSE", "", "n"), ("less error", "the base’s relMSE over this one’s", "n")]
    return "<div><h3>With so much time</h3>" + table(heads, rows, "small", label="Equal time") + "</div>"


def _equal_error(report: Report) -> str:
    """The fastest point of each error."""
    base = base_of(report)
    rows = ""
    for target in report.equal_error:
        point = (find(report, target.point) or (0, None))[1]
        error = math.nan if point is None else point.errors.relmse
        speed = ratio(least(base), least(point))
        rows += ("<tr>" + cell(target.relmse, number(target.relmse)) + f"<td>{link(report, target.point)}</td>"
                 + (cell(error, number(error)) + cell(least(point), milliseconds(least(point)))
                    + cell(speed, factor(speed)) if point else
                    '<td colspan="3" class="soft">no point is as exact</td>') + "</tr>")
    heads = [("relMSE at most", "", "n"), ("fastest point", "", "w"), ("relMSE", "", "n"),
             ("time [ms]", "least", "n"), ("speed-up", "the base’s time over this one’s", "n")]
    return "<div><h3>With so much error</h3>" + table(heads, rows, "small", label="Equal error") + "</div>"


def section_failures(points: Sequence[Point]) -> str:
    """What failed, and why.

    Parameters
    ----------
    points : sequence of Point

    Returns
    -------
    str
        HTML; nothing if nothing failed.
    """
    rows = "".join(
        f'<li><a class="fail" href="#point-{i}" data-p="{i}"><b>{safe(point.id)}</b></a>: {safe(why(point))}'
        + (f" (after {num(milliseconds(least(point)), 'ms')} a frame)" if point.seconds else "") + "</li>"
        for i, point in enumerate(points) if failed(point))
    if not rows:
        return ""
    return ("<p>They are crosses in the plots: at the upper edge without an error, at the right edge without a time."
            "</p>"
            f'<ul class="plain">{rows}</ul>')
