"""A report of error against run time as one web page that needs nothing but itself."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence

from froxel_ref.report_causes import section_budget, section_left_out, section_pictures, section_refinement
from froxel_ref.report_choices import (
    key_figures,
    section_equal,
    section_failures,
    section_plots,
    section_points,
    section_recommendation,
)
from froxel_ref.report_markup import MEMBERS, by, drawn, failed, grouped, long_time, many, num, safe, sets, why
from froxel_ref.report_numbers import megabytes, milliseconds, number, percent
from froxel_ref.report_pictures import Picture
from froxel_ref.report_plots import Drawing
from froxel_ref.report_record import NOISY, Point, Report
from froxel_ref.report_style import SCRIPT, STYLE

__all__ = ["page"]


def page(report: Report, drawings: Mapping[str, Drawing], pictures: Sequence[Picture] = ()) -> str:
    """The page; no link leaves it, and nothing is fetched.

    Parameters
    ----------
    report : Report
    drawings : mapping of str to Drawing
        From `froxel_ref.report_plots.drawings`; without any, the page has its tables and says what would draw.
    pictures : sequence of Picture
        Of where the error lies (`froxel_ref.report_pictures.error_pictures`).

    Returns
    -------
    str
        HTML.

    Examples
    --------
    >>> from froxel_ref.report_record import Reference, Setup
    >>> setup = Setup("hall", "A hall.", "", (), "quick", (1, 1, 1), (1, 1), (1, 1), 1, 1, 0.01, 1.0, 60.0, "", {}, "",
    ...               0.0)
    >>> report = Report(setup, Reference("", 1e-4, 0.0, 0, 1, 0.0), (), (), None, None, None, (), (), None)
    >>> page(report, {}).startswith("<!doctype html>")
    True
    """
    sections = [  # id, heading, in the row of links; contents
        ("plots", "Error against time", "Plots", section_plots(report, drawings)),
        ("points", "All points", "Points", section_points(report)),
        ("equal", "Equal time, equal error", "Equal time", section_equal(report)),
        ("budget", "Where the error comes from", "Budget",
         section_pictures(pictures) + section_budget(report, drawings)),
        ("refinement", "Refinement", "Refinement", section_refinement(report, drawings)),
        ("stages", "Run time by stage", "Stages", drawn("stages", "Times of stages in the run that was least; “all "
                                                        "else” is what none of them took.", drawings)),
        ("left-out", "What was left out, and what it saved", "Left out", section_left_out(report, drawings)),
        ("failures", "Failures", "Failures", section_failures(report.points)),
        ("reading", "How to read this", "Reading", _reading(report)),
        ("machine", "Machine and versions", "Machine", _machine(report)),
    ]
    sections = [section for section in sections if section[3]]
    links = "".join(f'<a href="#{name}">{short}</a>' for name, _, short, _ in sections)
    body = "".join(f'<section id="{name}"><h2>{head}</h2>{inside}</section>' for name, head, _, inside in sections)
    data = json.dumps([_told(point) for point in report.points], ensure_ascii=False).replace("<", "\\u003c")
    setup = report.setup
    return "\n".join([
        '<!doctype html><html lang="en"><head><meta charset="utf-8">',
        '<meta name="viewport" content="width=device-width,initial-scale=1">',
        "<meta http-equiv=\"Content-Security-Policy\" content=\"default-src 'none'; style-src 'unsafe-inline'; "
        "script-src 'unsafe-inline'; img-src data:\">",
        f"<title>Error against run time: {safe(setup.scene)}</title>",
        f"<style>{STYLE}</style></head><body>",
        f"<header><h1>Error against run time: {safe(setup.scene)}</h1>",
        f'<p class="soft">{safe(setup.about)}</p><p>{_summary(report)}</p></header>',
        f'<nav aria-label="Sections"><div>{links}</div></nav>',
        f"<main>{section_recommendation(report)}{key_figures(report)}{body}</main>",
        f'<footer class="soft">Measured {safe(_when(setup.begun))}; it took {long_time(setup.took)}. '
        "The same figures as files: <code>report.json</code>, <code>points.csv</code>.</footer>",
        f'<div id="tip" role="status" hidden></div><script type="application/json" id="data">{data}</script>',
        f"<script>{SCRIPT}</script></body></html>", ""])


def _summary(report: Report) -> str:
    """What was compared, and between what times and errors."""
    setup, points = report.setup, report.points
    good = [p for p in points if not failed(p)]
    knobs = len({p.knob for p in points if p.knob != "base"})
    words = (f"{many(len(points), 'choice')} of settings ({many(knobs, 'knob')} turned one at a time or together, "
             f"suite <b>{safe(setup.suite)}</b>) were timed at {num(by(setup.size))} pixels, and their images of "
             f"{num(by(setup.raster))} pixels compared with a converged reference")
    if not good:
        return f"{words}. None of them could be measured."
    times = [p.seconds.least for p in good if p.seconds is not None]
    errors = [p.errors.relmse for p in good]
    noisy = (f" <b>This machine was busy</b>: medians are up to {num(f'{setup.noise:.2f}')} times the least times, "
             "which leaves many places on the front open." if setup.noise > NOISY else "")
    return (f"{words}: they take {num(milliseconds(min(times)))} to {num(milliseconds(max(times)), 'ms')} a frame, "
            f"with a relMSE of {num(number(min(errors)))} to {num(number(max(errors)))}.{noisy}")


def _told(point: Point) -> dict[str, object]:
    """What the label of a point says."""
    lines = []
    if point.seconds is not None:
        spread = point.seconds
        lines.append(f"{milliseconds(spread.least)} ms, median {milliseconds(spread.median)} ms of "
                     f"{many(spread.runs, 'run')}")
    if failed(point):
        lines.append(f"failed: {why(point)}")
    if math.isfinite(point.errors.relmse):
        lines.append(f"relMSE {number(point.errors.relmse)}, mean |error| {percent(point.errors.absolute)}, "
                     f"bias {percent(point.errors.bias)}, largest "
                     f"{number(point.errors.maximum)}")
    if point.errors.flip is not None:
        lines.append(f"FLIP {number(point.errors.flip)}")
    if point.peak_bytes is not None:
        lines.append(f"{megabytes(point.peak_bytes)} MB at most")
    if not failed(point):
        lines.append(MEMBERS.get(point.member, point.member))
    return {"id": point.id, "lines": lines, "set": sets(point.overrides)}


def _when(begun: str) -> str:
    """2026-03-01T12:00:00Z as 2026-03-01, 12:00 UTC."""
    day, t, rest = begun.partition("T")
    return f"{day}, {rest[:5]} UTC" if t and len(rest) >= 5 else begun or "at an unknown time"


def _reading(report: Report) -> str:
    """What the words of the page mean."""
    setup, reference = report.setup, report.reference
    flip = (f"HDR-FLIP [Andersson 2021], mean of the image, at {num(number(setup.pixels_per_degree))} pixels "
            "per degree of view" if not setup.flip else f"not taken: {safe(setup.flip)}")
    entries = [
        ("reference", f"{safe(reference.about)} It took {long_time(reference.seconds)}. Its own relMSE, by its "
         f"estimate of its error, is {num(number(reference.floor))}: below it nothing can be told from the truth. "
         f"{reference.unconverged} of {grouped(reference.pixels)} pixels did not reach the relative tolerance of "
         f"{num(number(reference.rtol))}."),
        ("relMSE", f"mean of (a − b)²/(b² + ε) over pixels and channels, ε = {num(number(setup.epsilon))}; a is the "
         f"frame, b the reference, both radiance times the exposure {num(number(setup.exposure))}"),
        ("mean |error|", "mean of |a − b| over the mean of b: a few pixels that are far off count by how far they "
         "are, not by its square"),
        ("bias", "mean of a − b over the mean of b: whether the frame is too bright or too dark on the whole"),
        ("99.9th pct., largest", "of |a − b|, over the mean of b"),
        ("FLIP", flip),
        ("time", f"of a whole frame, warm, all stages, of {num(by(setup.size))} pixels and "
         f"{num(by(setup.grid))} froxels unless a knob turns them; least and median of up to "
         f"{many(setup.repeats, 'run')}. The least is the best estimate on a machine that does other things too; the "
         "bar from there is what these add: to the median, and at least to "
         f"{num(f'{setup.noise:.2f}')} times the least, below which nine of ten points have their median"),
        ("errors of", f"images of {num(by(setup.raster))} pixels, the same view, apart from the timed "
         f"runs. Points that average over time are the last of {many(setup.frames, 'frame')}"),
        ("front", "points that no other beats in both time and relMSE. Certain: whatever the noise of times, within "
         "their bars; possible: it depends on that noise"),
        ("budget", "a part is one approximation of the frame, and has a truth that replaces it. Its share: the mean of "
         "what it adds first, to a frame that is true otherwise, and last, to one that is approximate otherwise, "
         "projected on the frame’s error; negative where it undoes what others do. Alone: relMSE with everything else "
         "true. Without: relMSE with this part true and all others as they are. Rest: what is left with all parts "
         "true, which are fine but not infinitely so. Interaction: what three and more parts do together. A column "
         f"of froxels for each of the {num(by(setup.raster))} pixels is the truth across, for then nothing is "
         "interpolated"),
        ("regions", "sky: nothing is hit; edges: next door another surface begins; surfaces: all else"),
        ("memory", "the most bytes that arrays took at one moment of a frame; 1 MB is 10⁶ bytes"),
    ]
    return '<dl class="list">' + "".join(f"<dt>{name}</dt><dd>{words}</dd>" for name, words in entries) + "</dl>"


def _machine(report: Report) -> str:
    """The machine, versions of packages, and what was measured."""
    setup = report.setup
    entries = [*setup.machine.items(), ("overrides of the scene’s file", " ".join(setup.overrides) or "none"),
               ("scene and settings, SHA-256", setup.scene_digest)]
    return '<dl class="list">' + "".join(f"<dt>{safe(name)}</dt><dd>{safe(value)}</dd>"
                                         for name, value in entries) + "</dl>"
