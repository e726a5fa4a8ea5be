"""Sections of a report's page on where the base's error and time come from: budget, refinement, what was left out."""

from __future__ import annotations

import base64
import itertools
import math
from collections.abc import Mapping, Sequence

from froxel_ref.report_markup import cell, drawn, factor, num, ratio, safe, table
from froxel_ref.report_numbers import megabytes, milliseconds, number, percent
from froxel_ref.report_pictures import FULL, Picture
from froxel_ref.report_plots import Drawing
from froxel_ref.report_record import STEADY, Budget, LeftOut, Level, Refinement, Report, Spread

__all__ = ["section_budget", "section_left_out", "section_pictures", "section_refinement"]


def section_pictures(pictures: Sequence[Picture]) -> str:
    """Small pictures side by side, their pixels as squares.

    Parameters
    ----------
    pictures : sequence of Picture

    Returns
    -------
    str
        HTML; nothing without any.
    """
    if not pictures:
        return ""
    shots = "".join(
        f'<figure><img alt="{safe(each.title)}: {safe(each.words)}" src="data:image/png;base64,'
        f'{base64.b64encode(each.png).decode("ascii")}"><figcaption><b>{safe(each.title)}</b> {safe(each.words)}'
        "</figcaption></figure>" for each in pictures)
    return (f'<div class="shots">{shots}</div><p class="soft">Errors, and what single approximations add to them, over '
            f"√(b² + ε): blue where the frame is too dark, red where it is too bright, full colour from "
            f"{percent(FULL)} on.</p>")


def section_budget(report: Report, drawings: Mapping[str, Drawing]) -> str:
    """The budget: its plot, whether it adds up, its parts, and regions of the image.

    Parameters
    ----------
    report : Report
    drawings : mapping of str to Drawing

    Returns
    -------
    str
        HTML; nothing where the report has nothing for it.
    """
    budget = report.budget
    if budget is None:
        return ""
    total = sum(part.share for part in budget.parts) + budget.rest + budget.interaction
    return (drawn("budget", "A share is the mean of what a part adds first, to a frame that is true otherwise, "
                  "and last, to one that is not; negative where it undoes what others do. The thin mark is what it "
                  "makes alone.", drawings)
            + f"<p>{_adds_up(budget, total)}</p>" + _parts(budget, total) + _regions(budget))


def _parts(budget: Budget, total: float) -> str:
    """The table of parts, of what they do not explain, and of their sum."""
    names = list(budget.region_totals)
    heads = [("part", "an approximation of the frame", "w lead"), ("share", "of the frame’s relMSE", "n"),
             ("alone", "its relMSE with everything else true", "n"),
             ("without", "relMSE with this part true, all others on", "n"),
             ("bias", "mean of what it adds, over the mean of the reference", "n")]
    heads += [(f"in {safe(name)}", "its share there; regions add up to the share", "n") for name in names]
    heads.append(("what it is; its truth", "", "w wide-words"))
    rows = "".join(
        f'<tr><th scope="row" class="lead">{safe(part.name)}</th>' + cell(part.share, percent(part.share))
        + cell(part.alone, number(part.alone)) + cell(part.without, number(part.without))
        + cell(part.bias, percent(part.bias))
        + "".join(cell(part.regions.get(name), percent(part.regions.get(name))) for name in names)
        + f"<td>{safe(part.about)}<small>true: {safe(part.truth)}</small></td></tr>" for part in budget.parts)
    blank = f'<td colspan="{2 + len(names)}"></td>'
    for name, share, relmse, words in (
            ("rest", budget.rest, budget.rest_relmse, "left when all parts are true: fine, but not infinitely so"),
            ("interaction", budget.interaction, budget.interaction_relmse,
             "what three and more parts do together; of two, each has half")):
        rows += (f'<tr><th scope="row" class="lead">{name}</th>' + cell(share, percent(share))
                 + cell(relmse, number(relmse)) + blank + f"<td>{words}</td></tr>")
    foot = (f'<tr><th scope="row" class="lead">together</th>{cell(total, percent(total))}'
            f"{cell(budget.total, number(budget.total))}<td></td><td></td>"
            + "".join(cell(v, percent(v)) for v in budget.region_totals.values())
            + "<td>the frame’s relMSE, and where in the image it is</td></tr>")
    return table(heads, rows, "small", label="Budget", foot=foot)


NEAR = 0.1  # of the frame's own error: a claim that is not off by more is near


def _adds_up(budget: Budget, total: float) -> str:
    """Whether shares add up to 1, and whether the claim holds."""
    if not math.isfinite(total):
        return "The parts could not be summed: some share is not a number."
    right = abs(total - 1.0) <= 5e-3
    words = (f"Shares ({num(percent(sum(part.share for part in budget.parts)))}), rest "
             f"({num(percent(budget.rest))}) and interaction ({num(percent(budget.interaction))}) add up to "
             f"{num(f'{total:.3f}')}" + (", as they must." if right else
                                         ': <b class="fail">they must add up to 1, so this budget is wrong.</b>'))
    claim = budget.claim
    if claim is None:
        return words
    gap = abs(math.sqrt(max(claim.claimed, 0.0)) - math.sqrt(max(claim.measured, 0.0)))
    near = gap <= NEAR * math.sqrt(budget.total)
    worse = [part.name for part in budget.parts if part.share > 0.01 and part.without > budget.total]
    return (f"{words} The check, of the largest part: without <b>{safe(claim.name)}</b> the budget claims a relMSE of "
            f"{num(number(claim.claimed))}, and the frame without it has {num(number(claim.measured))}. Their roots "
            f"(relMSE is the square of a length) differ by {num(number(gap))}; half of what this part does together "
            f"with others explains up to {num(number(claim.slack))}. " + (
                f'<b class="good">The two are within {percent(NEAR)} of the frame’s own</b>.' if near else
                '<b class="fail">They are far apart</b>: this part and others undo each other in places, and no single '
                "share tells what its truth would buy.")
            + (f" Made true by themselves, {safe(' and '.join(worse))} would make the frame less exact, for another "
               "part needs them." if worse else ""))


def _regions(budget: Budget) -> str:
    """Where in the image the error is."""
    if not budget.regions:
        return ""
    rows = ""
    for name, pixels in budget.regions.items():
        share = budget.region_totals.get(name, math.nan)
        worst = max(budget.parts, key=lambda part: part.regions.get(name, -math.inf), default=None)
        rows += (f'<tr><th scope="row">{safe(name)}</th>' + cell(pixels, percent(pixels)) + cell(share, percent(share))
                 + cell(None, factor(ratio(share, pixels))) + f"<td>{safe(worst.name) if worst else '–'}</td></tr>")
    heads = [("region", "", "w"), ("of the pixels", "", "n"), ("of the error", "", "n"),
             ("against the mean", "share of the error over share of the pixels", "n"), ("largest part there", "", "w")]
    return "<h3>By region of the image</h3>" + table(heads, rows, "small", label="Regions")


def section_refinement(report: Report, drawings: Mapping[str, Drawing]) -> str:
    """Refinement: the orders in words, the plot, the levels.

    Parameters
    ----------
    report : Report
    drawings : mapping of str to Drawing

    Returns
    -------
    str
        HTML; nothing where the report has nothing for it.
    """
    found = report.refinement
    if found is None:
        return ""
    return (f"<p>{_orders(found)}</p>" + drawn("refinement", "The dashed line is the fit.", drawings)
            + _levels(found.levels))


def _orders(found: Refinement) -> str:
    """What orders were fitted, and how well."""
    words = "No order could be fitted: a level has no error."
    if found.order is not None and found.order < STEADY:
        words = (f"Grid, maps and harmonics refined together, √relMSE does not fall steadily (the fitted order is "
                 f"{num(f'{found.order:.2f}'.replace('-', '−'))}).")
    elif found.order is not None:
        words = (f"Grid, maps and harmonics refined together, the frame tends to the reference by the order "
                 f"<b>{num(f'{found.order:.2f}'.replace('-', '−'))}</b>: √relMSE goes with that power of the step.")
        if 0.0 < found.order < 50.0:
            words += f" With half the step it is {num(number(2.0**found.order))} times smaller."
        if found.residual is not None:
            words += f" Levels lie within {num(percent(math.expm1(min(found.residual, 99.0))))} (rms) of that line."
    if found.absolute_order is not None:
        words += (f" The mean absolute error tends to it by the order "
                  f"<b>{num(f'{found.absolute_order:.2f}'.replace('-', '−'))}</b>, on which single pixels on edges of "
                  "light have less hold.")
    rises = [b.label for a, b in itertools.pairwise(found.levels) if b.errors.relmse > a.errors.relmse]
    if rises:
        words += (f" At {safe(' and at '.join(rises))} relMSE did not fall: single pixels on edges of light decide on "
                  "it.")
    return words


def _levels(levels: Sequence[Level]) -> str:
    """The table of levels, with the order from each to the next."""
    rows, before = "", None
    for level in levels:
        errors = level.errors
        local = math.nan
        if before is not None and before.step > level.step > 0.0 and all(
                0.0 < e < math.inf for e in (before.errors.relmse, errors.relmse)):
            fall = math.log(before.errors.relmse) - math.log(errors.relmse)
            local = 0.5 * fall / (math.log(before.step) - math.log(level.step))
        rows += (f'<tr><th scope="row" class="lead">{safe(level.label)}</th>' + cell(level.step, number(level.step))
                 + cell(errors.relmse, number(errors.relmse) + (f"<small>{safe(errors.fault)}</small>"
                                                                if errors.fault else ""))
                 + cell(local, f"{local:.2f}" if math.isfinite(local) else "–")
                 + cell(errors.absolute, percent(errors.absolute)) + cell(errors.bias, percent(errors.bias))
                 + cell(errors.quantile, number(errors.quantile)) + cell(errors.maximum, number(errors.maximum))
                 + cell(errors.flip, number(errors.flip)) + "</tr>")
        before = level
    heads = [("level", "", "w lead"), ("step", "over the coarsest level’s", "n"), ("relMSE", "", "n"),
             ("order", "of √relMSE, from the level above", "n"), ("mean |error|", "", "n"),
             ("bias", "", "n"), ("99.9th pct.", "", "n"),
             ("largest", "", "n"), ("FLIP", "", "n")]
    return table(heads, rows, "small", label="Refinement")


def section_left_out(report: Report, drawings: Mapping[str, Drawing]) -> str:
    """What was left out, why, and what that saved.

    Parameters
    ----------
    report : Report
    drawings : mapping of str to Drawing

    Returns
    -------
    str
        HTML; nothing where the report has nothing for it.
    """
    parts = []
    saved = report.saved
    if saved is not None:
        same = ("All results are the same, bit for bit." if saved.same else
                '<b class="fail">Results are not the same bit for bit.</b>')
        parts.append(
            f"<p>With everything forced on, the same frame takes "
            f"{num(factor(ratio(saved.forced.least, saved.planned.least)))} the time and "
            f"{num(factor(ratio(saved.forced_bytes, saved.planned_bytes)))} the memory. {same}</p>"
            + drawn("planned", "Bars are the least of the runs.", drawings))

        def row(name: str, spread: Spread, size: int) -> str:
            return (f'<tr><th scope="row">{name}</th>' + cell(spread.least, milliseconds(spread.least))
                    + cell(spread.median, milliseconds(spread.median)) + cell(spread.runs, str(spread.runs))
                    + cell(size, megabytes(size)) + "</tr>")

        heads = [("frame", "", "w"), ("time [ms]", "least of the runs", "n"), ("median [ms]", "", "n"),
                 ("runs", "", "n"), ("memory [MB]", "the most that arrays took at one moment", "n")]
        parts.append(table(heads, row("as planned", saved.planned, saved.planned_bytes)
                           + row("all forced on", saved.forced, saved.forced_bytes), "small", label="Saved"))
        parts.append(_list("Stages, and parts of stages, that do not run", saved.left_out))
    parts.append(_list("Knobs that this scene does not need", report.left_out))
    if report.budget is not None:
        parts.append(_list("Approximations that this frame does not make", report.budget.left_out))
    return "".join(parts)


def _list(head: str, items: Sequence[LeftOut]) -> str:
    """A heading and what was left out, with its reasons."""
    if not items:
        return ""
    rows = "".join(f"<li><b>{safe(item.name)}</b>: {safe(item.why)}</li>" for item in items)
    return f'<h3>{head}</h3><ul class="plain">{rows}</ul>'
