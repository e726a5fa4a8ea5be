"""The command ``froxel-ref report``: parsing and printing only."""

from __future__ import annotations

import argparse
import re
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

from froxel_ref.cli_progress import progress
from froxel_ref.records import InputError, shown, suggest
from froxel_ref.report_record import NOISY, STEADY

if TYPE_CHECKING:
    from froxel_ref.report_points import Asked
    from froxel_ref.report_record import Budget, Point, Report
    from froxel_ref.scene_files import Loaded

__all__ = ["EXAMPLES", "add_options", "run_report_command"]

EXAMPLES = """\
Turns each setting that the scene has a use for, measures every frame against the converged truth and by the clock,
and writes index.html (its path is the last line printed), report.json, points.csv, budget.csv, refinement.csv and
pictures. Plots need matplotlib (pip install 'froxel-ref[report]'), FLIP needs flip-evaluator ('froxel-ref[flip]').
Times are of whole frames of the scene's own size, errors of smaller images of the same view. Every measurement is on
disk as soon as it is made: an interrupted report is gone on with by --resume, which also answers another --budget-ms
without measuring anything again.

examples:
  froxel-ref report thesis-hall
  froxel-ref report thesis-hall --set volumetric_shadows=maps --suite full -o hall
  froxel-ref report shaft --knobs slices,shadows --budget-ms 50
  froxel-ref report shaft --knobs slices,shadows --resume --max-error 0.001
  froxel-ref report uniform --sweep grid.far=16,32 --sweep grid.near=0.1,1
"""


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of this command beside those that name a scene and an output."""
    parser.add_argument("--suite", metavar="NAME", default="quick",
                        help="quick (default), some minutes; or full: more values, pixels, frames and runs")
    parser.add_argument("--knobs", metavar="NAMES",
                        help="turn these only, separated by commas; --knobs list names them")
    parser.add_argument("--sweep", metavar="PATH=V,V", action="append", default=[],
                        help="turn a setting of your own through values; may be repeated; alone, or beside --knobs")
    parser.add_argument("--budget-ms", metavar="X", help="recommend settings that take at most X ms a frame")
    parser.add_argument("--max-error", metavar="E", help="recommend settings with relMSE of at most E")
    parser.add_argument("--points-only", action="store_true",
                        help="leave out the error budget, the refinement and what leaving out saves")
    parser.add_argument("--resume", action="store_true", help="go on with what was measured before")
    parser.add_argument("--open", action="store_true", help="show the page in the browser when it is there")


def _asked(args: argparse.Namespace) -> Asked:
    """What was typed, or a fault that names the option."""
    from froxel_ref.knobs import chosen, own_knob
    from froxel_ref.report_points import SUITES, Asked

    if args.suite not in SUITES:
        raise InputError("--suite", f"is {shown(args.suite)}; {suggest(args.suite, SUITES)}")
    own = tuple(own_knob(text) for text in args.sweep)
    names = None if args.knobs is None else [name.strip() for name in args.knobs.split(",") if name.strip()]
    knobs = chosen(names) if names is not None or not own else ()
    if args.budget_ms is not None and args.max_error is not None:
        raise InputError("--max-error", "is given with --budget-ms, must be one of the two")
    limits = [_number(option, text) for option, text in (("--budget-ms", args.budget_ms),
                                                         ("--max-error", args.max_error))]
    return Asked(args.suite, (*knobs, *own), limits[0], limits[1], None, not args.points_only)


def _number(option: str, text: str | None) -> float | None:
    if text is None:
        return None
    if not re.fullmatch(r"([0-9]+\.?[0-9]*|\.[0-9]+)([eE][-+]?[0-9]{1,3})?", text) or not 0.0 < float(text) < 1e300:
        example = "33" if option == "--budget-ms" else "1e-3"
        raise InputError(option, f"is {shown(text)}, must be a number above 0 such as {example}")
    return float(text)


def run_report_command(args: argparse.Namespace, load: Callable[[Any], Loaded],
                       table: Callable[[Sequence[Sequence[str]], str], None]) -> None:
    """Run the command.

    Parameters
    ----------
    args : Namespace
        What the parser made of the command line.
    load : callable
        Gives the scene that the arguments name.
    table : callable
        Prints rows of cells.

    Raises
    ------
    InputError
        Anything wrong with the input or the output.
    """
    from froxel_ref.output import output_path
    from froxel_ref.report_files import PAGE
    from froxel_ref.report_folder import check_target, run_report
    from froxel_ref.report_points import prepare

    if args.force and args.resume:
        raise InputError("--resume", "is given with --force, must be one of the two: go on, or begin anew")
    if args.knobs is not None and args.knobs.strip() == "list":
        _list_knobs(table)
        return
    asked = _asked(args)
    folder = output_path(args.output, f"report-{Path(args.scene).stem}")
    check_target(folder, force=args.force, resume=args.resume)
    loaded = load(args)
    prepared = prepare(loaded, asked, overrides=args.typed, about=_about(args.scene, loaded),
                       source=args.scene)
    _tell_lacks()
    with progress("% of the work") as tell, _told_where(folder, args.resume):
        report = run_report(prepared, folder, force=args.force, resume=args.resume, tell=tell)
    _print(report, table)
    page = folder / PAGE
    if args.open:
        _open(page)
    print(page)


def _about(name: str, loaded: Loaded) -> str:
    from froxel_ref.scene_files import builtin

    return builtin().get(name, "")


def _list_knobs(table: Callable[[Sequence[Sequence[str]], str], None]) -> None:
    from froxel_ref.knobs import KNOBS

    table([("knob", "what"), *((knob.name, knob.about) for knob in KNOBS)], "ll")


def _tell_lacks() -> None:
    """What will be missing, before hours are spent."""
    from froxel_ref.flip import flip_available
    from froxel_ref.report_plots import plots_available

    for there, what, extra in ((plots_available(), "plots", "report"), (flip_available(), "HDR-FLIP", "flip")):
        if not there:
            print(f"froxel-ref: note: without {what}, which need the extra '{extra}': python -m pip install "
                  f"'froxel-ref[{extra}]'", file=sys.stderr)


@contextmanager
def _told_where(folder: Path, resume: bool) -> Iterator[None]:
    """Say what stands in the folder when it is interrupted, and leave none in which nothing stands."""
    from froxel_ref.report_folder import drop_empty, measured

    try:
        yield
    except (KeyboardInterrupt, InputError) as error:
        count = measured(folder)
        if isinstance(error, InputError) and error.place == "--resume":
            raise  # what stands there is of something else
        if count:
            print(f"froxel-ref: {count} measurement{'s' * (count > 1)} in {folder}, --resume goes on", file=sys.stderr)
        elif not resume:
            with suppress(InputError):
                drop_empty(folder)
        raise


def _open(page: Path) -> None:
    import webbrowser

    if not webbrowser.open(page.resolve().as_uri()):
        print(f"froxel-ref: note: no browser was found here; the page is {page}", file=sys.stderr)


# --- printing -------------------------------------------------------------------------------------------


def _print(report: Report, table: Callable[[Sequence[Sequence[str]], str], None]) -> None:
    """The front, the budget, the refinement and the recommendation, in a few lines each."""
    setup, reference = report.setup, report.reference
    print(f"{setup.scene}: frames of {setup.size[0]} x {setup.size[1]} pixels, errors of {setup.raster[0]} x "
          f"{setup.raster[1]} ones against the truth (relMSE of its own error {reference.floor:.1e}); "
          f"{len(report.points)} point{'s' * (len(report.points) > 1)} in {setup.took:.0f} s")
    if not 0.02 < reference.mean < 50.0:
        print(f"the image's mean is {reference.mean:.3g} after exposure: relMSE's ε of {setup.epsilon:g} supposes it "
              "to be of order 1, see mean |error| too")
    if reference.unconverged:
        print(f"the truth did not converge in {reference.unconverged} of {reference.pixels} pixels")
    rows: list[Sequence[str]] = [("point", "ms", "MB", "relMSE", "bias", "FLIP", "front")]
    shown_points = [point for point in report.points if point.member != "dominated" or point.knob == "base"]
    rows += [_row(point) for point in sorted(shown_points, key=_time)]
    table(rows, "lrrrrrl")
    if setup.noise > NOISY:
        print(f"this machine was busy: medians are up to {setup.noise:.2f} times the least times")
    for point in report.points:
        if point.errors.worst > 0.5 and point in shown_points:
            print(f"one pixel has {100.0 * point.errors.worst:.0f} % of the relMSE of {point.id}: see its mean |error| "
                  f"({100.0 * point.errors.absolute:.2g} %) too")
    hidden = len(report.points) - len(shown_points)
    if hidden:
        print(f"and {hidden} point{'s' * (hidden > 1)} that another one surely beats in both")
    if report.budget is not None:
        _print_budget(report.budget, table)
    if report.refinement is not None:
        _print_refinement(report, table)
    if report.saved is not None:
        saved = report.saved
        faster, less = saved.forced.least / saved.planned.least, saved.forced_bytes / max(1, saved.planned_bytes)
        print(f"left out: {len(saved.left_out)} stages and parts; {faster:.2f} times as fast as with everything forced "
              f"on, {less:.2f} times less memory, {'the same bit for bit' if saved.same else 'NOT THE SAME'}")
    for each in report.left_out:
        print(f"not turned: {each.name} ({each.why})")
    if report.recommendation is not None:
        chosen = report.recommendation
        print(f"for {chosen.limit}: {chosen.words}")
        if chosen.overrides:
            print("  " + " ".join(f"--set '{text}'" for text in chosen.overrides))


def _time(point: Point) -> float:
    return float("inf") if point.seconds is None else point.seconds.least


def _row(point: Point) -> tuple[str, ...]:
    seconds, errors = point.seconds, point.errors
    return (point.id, "-" if seconds is None else f"{1e3 * seconds.least:.1f}–{1e3 * seconds.end:.1f}",
            "-" if point.peak_bytes is None else f"{point.peak_bytes / 1e6:.0f}", f"{errors.relmse:.2e}",
            f"{100.0 * errors.bias:+.2f} %", "-" if errors.flip is None else f"{errors.flip:.4f}",
            f"{point.member}{': ' + point.fault if point.fault else ''}")


def _print_budget(budget: Budget, table: Callable[[Sequence[Sequence[str]], str], None]) -> None:
    rows = [("budget", "share", "alone", "without it", "")]
    rows += [(part.name, f"{100.0 * part.share:.1f} %", "-" if part.alone is None else f"{part.alone:.2e}",
              f"{part.without:.2e}", f"{part.about} -> {part.truth}") for part in budget.parts]
    rows.append(("rest", f"{100.0 * budget.rest:.1f} %", f"{budget.rest_relmse:.2e}", "",
                 "what the finer settings leave"))
    rows.append(("interaction", f"{100.0 * budget.interaction:.1f} %", f"{budget.interaction_relmse:.2e}", "",
                 "what three and more parts do together"))
    whole = sum(part.share for part in budget.parts) + budget.rest + budget.interaction
    rows.append(("total", f"{100.0 * whole:.1f} %", f"{budget.total:.2e}", "", "relMSE of the frame as it is"))
    table(rows, "lrrrl")
    if budget.claim is not None:
        claim = budget.claim
        apart = abs(claim.claimed**0.5 - claim.measured**0.5)
        print(f"with {claim.name} true, by the budget {claim.claimed:.2e} should be left, and {claim.measured:.2e} is: "
              f"the roots differ by {apart:.2e}, what it does together with others explains up to {claim.slack:.2e}")


def _print_refinement(report: Report, table: Callable[[Sequence[Sequence[str]], str], None]) -> None:
    assert report.refinement is not None
    found = report.refinement
    table([("refined together", "relMSE", "mean |error|"), *(
        (level.label, f"{level.errors.relmse:.2e}", f"{level.errors.absolute:.2e}") for level in found.levels)], "lrr")
    orders = [f"{words} falls with order {value:.2f}" if value >= STEADY else
              f"{words} does not fall steadily (order {value:.2f})" for words, value in (
        ("√relMSE", found.order), ("mean |error|", found.absolute_order)) if value is not None]
    print("; ".join(orders) or "no order: a level has no error, or failed")
