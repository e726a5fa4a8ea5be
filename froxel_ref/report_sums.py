"""From measurements to a report: points and their front, the budget's sums, tables, a recommendation."""

from __future__ import annotations

import importlib.metadata
import math
import os
import platform
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import froxel_ref
from froxel_ref import compare, pareto, report_log
from froxel_ref.budget import Part, make_budget
from froxel_ref.error_images import no_flip, reference_words, regions
from froxel_ref.flip import scaled_pixels_per_degree
from froxel_ref.measuring import spread_of
from froxel_ref.report_log import Entry
from froxel_ref.report_points import BASE, EPSILON, Prepared, Spot, digest
from froxel_ref.report_record import (
    AtError,
    AtTime,
    Budget,
    Errors,
    LeftOut,
    Level,
    Point,
    Recommendation,
    Reference,
    Refinement,
    Report,
    Saved,
    Setup,
    Spread,
)

__all__ = ["put_together"]

Image = NDArray[np.float64]
Done = Mapping[str, Entry]

NAN = Errors(math.nan, math.nan, math.nan, math.nan)

# Budgets of time, over the upper end of the base's.
BUDGETS = (0.25, 0.5, 1.0, 2.0, 4.0)


def put_together(prepared: Prepared, folder: Path, done: Done) -> Report:
    """The report that measurements make.

    Parameters
    ----------
    prepared : Prepared
    folder : Path
        Where the log keeps images.
    done : mapping of str to Entry
        Every measurement of `froxel_ref.report.measurements`.

    Returns
    -------
    Report
    """
    points = _points(prepared, done)
    truth = report_log.load_image(folder, "reference", (3, *prepared.raster[::-1]))
    assert truth is not None
    everything = prepared.asked.everything
    times, errors = _rows(points)
    return Report(
        _setup(prepared, points, done["reference"].value["begun"], sum(entry.took for entry in done.values())),
        _reference(prepared, truth, done["reference"]),
        points, prepared.left_out,
        _budget(prepared, folder, done, truth) if everything else None,
        _refinement(prepared, done) if everything else None,
        _saved(done["saved"].value) if everything else None,
        times, errors, _recommendation(prepared, points))


# --- setup ----------------------------------------------------------------------------------------------


def _setup(prepared: Prepared, points: Sequence[Point], begun: str, took: float) -> Setup:
    subject, suite = prepared.subject, prepared.suite
    scene, grid = subject.loaded.scene, subject.settings.grid
    return Setup(
        scene.name or "scene", prepared.about, digest(subject.loaded), prepared.overrides, prepared.asked.suite,
        (grid.width, grid.height, grid.depth), (scene.camera.width, scene.camera.height), prepared.raster,
        suite.repeats, suite.frames, EPSILON, scene.camera.exposure,
        scaled_pixels_per_degree(prepared.raster[0], scene.camera.width),
        no_flip(prepared.raster, scene.camera.width), machine(), begun, took, noise_of(points), prepared.source)


def machine() -> dict[str, str]:
    """What ran, in a few words each: processor, system, versions."""
    found = {"processor": _processor(), "cores": str(len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity")
                                                     else os.cpu_count() or 1),
             "system": f"{platform.system()} {platform.machine()}", "froxel_ref": froxel_ref.__version__,
             "Python": platform.python_version()}
    for name in ("numpy", "scipy", "matplotlib", "flip-evaluator"):
        try:
            found[name] = importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            found[name] = "not installed"
    return found


def _processor() -> str:
    try:
        with open("/proc/cpuinfo", encoding="utf-8") as file:
            named = [line.partition(":")[2].strip() for line in file if line.startswith("model name")]
    except OSError:
        named = []
    return named[0] if named else platform.processor() or platform.machine()


def _reference(prepared: Prepared, truth: Image, entry: Entry) -> Reference:
    value = entry.value
    return Reference(reference_words(prepared.subject, prepared.suite.rtol), prepared.suite.rtol, value["floor"],
                     value["unconverged"], truth[0].size, value["seconds"], value["mean"])


# --- points ---------------------------------------------------------------------------------------------


def _points(prepared: Prepared, done: Done) -> tuple[Point, ...]:
    measured = [_point(prepared, spot, done) for spot in prepared.spots]
    noise = noise_of(measured)
    measured = [point if point.seconds is None else point._replace(seconds=point.seconds._replace(
        high=max(point.seconds.median, noise * point.seconds.least))) for point in measured]
    found = pareto.front(*_columns(measured))
    return tuple(point._replace(member=member) for point, member in zip(measured, found.membership, strict=True))


def noise_of(points: Sequence[Point]) -> float:
    """How far medians lie above the least times, in nine of ten points.

    Few runs of one point tell little of the noise: bars from least to median of two runs of the same work lie apart in
    40 % of the cases with three runs, in 7 % with seven. But all points were timed in the same rounds on the same
    machine, so what they have in common is known better, and no bar is shorter than that.
    """
    ratios = [point.seconds.median / point.seconds.least for point in points if point.seconds is not None]
    return float(np.quantile(ratios, 0.9, method="inverted_cdf")) if ratios else 1.0


def _columns(points: Sequence[Point]) -> tuple[list[float], list[float], list[float]]:
    """Errors, and both ends of times; NaN where there is none. What differs by rounding alone does not differ."""
    return ([float(f"{point.errors.relmse:.9e}") for point in points],
            [math.nan if point.seconds is None else point.seconds.least for point in points],
            [math.nan if point.seconds is None else point.seconds.end for point in points])


def _point(prepared: Prepared, spot: Spot, done: Done) -> Point:
    image, memory = done[f"image {spot.id}"].value, done[f"memory {spot.id}"].value
    runs = [done[f"time {number} {spot.id}"].value for number in range(prepared.suite.repeats)]
    runs = sorted((run for run in runs if "seconds" in run), key=lambda run: float(run["seconds"]))
    errors = errors_of(image)
    return Point(
        spot.id, spot.knob, spot.label, spot.overrides, spot.frames, errors,
        spread_of([run["seconds"] for run in runs]) if runs else None,
        runs[0]["stages"] if runs else {}, memory.get("bytes"), "",
        image.get("fault") or errors.fault or memory.get("fault", ""))


def errors_of(value: Mapping[str, Any]) -> Errors:
    """Errors as the log has them; all NaN where there is only a fault."""
    return Errors(**value["errors"]) if "errors" in value else NAN._replace(fault=value["fault"])


# --- budget and refinement ------------------------------------------------------------------------------


def _budget(prepared: Prepared, folder: Path, done: Done, truth: Image) -> Budget | None:
    """Parts whose images failed are left out, with what failed; nothing is left without the base's own."""
    shape = truth.shape

    def image(name: str) -> Image | None:
        if name not in done or "errors" not in done[name].value or done[name].value["errors"]["fault"]:
            return None
        return report_log.load_image(folder, name, shape)

    whole, none = image(f"image {BASE}"), image("budget: none")
    if whole is None or (none is None and prepared.parts):
        return None
    alone: dict[str, Image] = {}
    without: dict[str, Image] = {}
    kept: list[Part] = []
    left = list(prepared.parts_left_out)
    for part in prepared.parts:
        names = [name for name in (f"budget: {part.name} alone", f"budget: without {part.name}") if name in done]
        found = {name: each for name in names if (each := image(name)) is not None}
        failed = next((name for name in names if name not in found), None)
        if failed is not None:
            left.append(LeftOut(part.name, f"could not be replaced: {errors_of(done[failed].value).fault}"))
            continue
        kept.append(part)
        without[part.name] = found[names[-1]]
        if len(names) == 2:
            alone[part.name] = found[names[0]]
    return make_budget(kept, left, truth=truth, whole=whole, none=whole if none is None else none, alone=alone,
                       without=without, epsilon=EPSILON, regions=regions(prepared.subject))


def _refinement(prepared: Prepared, done: Done) -> Refinement:
    levels = []
    for factor in prepared.suite.levels:
        value = done[f"level {factor:g}"].value
        levels.append(Level(value["label"], value["step"] * prepared.suite.levels[0], errors_of(value)))
    fits: list[float | None] = []
    for sizes in ([math.sqrt(level.errors.relmse) for level in levels], [level.errors.absolute for level in levels]):
        fine = all(0.0 < size < math.inf for size in sizes)
        fit = compare.order([level.step for level in levels], sizes) if fine else None
        fits += [None, None] if fit is None else [fit.order, fit.residual]
    return Refinement(tuple(levels), *fits)


def _saved(value: Mapping[str, Any]) -> Saved:
    return Saved(tuple(LeftOut(*each) for each in value["left_out"]), Spread(*value["planned"]),
                 Spread(*value["forced"]), value["planned_bytes"], value["forced_bytes"], value["same"])


# --- tables ---------------------------------------------------------------------------------------------


def _rows(points: Sequence[Point]) -> tuple[tuple[AtTime, ...], tuple[AtError, ...]]:
    """The most exact point of each budget of time, the fastest of each step of error: 1, 2, 5 in each decade."""
    columns = _columns(points)
    base = next(point for point in points if point.id == BASE)

    def name(index: int | None) -> str | None:
        return None if index is None else points[index].id

    times: tuple[AtTime, ...] = ()
    if base.seconds is not None:
        found = pareto.equal_time(*columns, [share * base.seconds.high for share in BUDGETS])
        times = tuple(AtTime(row.budget, name(row.surely), _perhaps(row, name)) for row in found)
    sizes = [error for error in columns[0] if error > 0.0]
    if not sizes:
        return times, ()
    decades = range(math.floor(math.log10(min(sizes))), math.floor(math.log10(2.0 * max(sizes))) + 1)
    steps = [float(f"{unit}e{decade}") for decade in decades for unit in (1, 2, 5)]
    levels = [step for step in reversed(steps) if min(sizes) <= step <= 2.0 * max(sizes)]
    if not levels:
        return times, ()
    return times, tuple(AtError(row.level, name(row.fastest)) for row in pareto.equal_error(*columns, levels))


def _perhaps(row: pareto.EqualTime, name: Callable[[int | None], str | None]) -> str | None:
    """The point that may fit, where it is more exact than what surely does."""
    better = row.surely is None or (row.possible_error is not None and row.sure_error is not None
                                    and row.possible_error < row.sure_error)
    return name(row.possibly) if better else None


def _recommendation(prepared: Prepared, points: Sequence[Point]) -> Recommendation | None:
    """The point to take under a limit, if one was given, in words too."""
    budget, most = prepared.asked.limit_ms, prepared.asked.limit_error
    if budget is None and most is None:
        return None
    limit = f"relMSE at most {most:.3g}" if budget is None else f"{budget:g} ms a frame"
    found = pareto.recommend(*_columns(points), budget=None if budget is None else budget / 1e3, most_error=most)
    if found.point is None:
        return Recommendation(limit, False, BASE, (), None, None, "No point could be measured.")
    point = points[found.point]
    words = f"{point.id} takes {_ms(point)} ms a frame with relMSE {point.errors.relmse:.3g}"
    surely = "surely " if budget is not None else ""
    words += "." if found.met else f"; nothing that was measured {surely}meets {limit}, this comes closest."
    up, down = (None if step is None else points[step.point] for step in (found.up, found.down))
    if up is not None:
        words += (f" The next step up is {up.id}: {_ms(up)} ms and relMSE {up.errors.relmse:.3g}, "
                  f"{_ratio(point.errors.relmse, up.errors.relmse)} less error for "
                  f"{_ratio(_least(up), _least(point))} the time.")
    else:
        words += f" Nothing that was measured is more exact by {100.0 * pareto.LEAST_GAIN:g} % or more."
    return Recommendation(limit, found.met, point.id, point.overrides, None if up is None else up.id,
                          None if down is None else down.id, words)


def _least(point: Point) -> float:
    return math.nan if point.seconds is None else point.seconds.least


def _ms(point: Point) -> str:
    return "?" if point.seconds is None else f"{1e3 * point.seconds.least:.3g} to {1e3 * point.seconds.high:.3g}"


def _ratio(more: float, less: float) -> str:
    return f"{more / less:.3g} times" if less > 0.0 else "infinitely"
