"""The command line, ``froxel-ref …``: parsing and printing only.

Exit codes: 0; 2 for anything wrong with the input or the output, with one line on standard error;
130 when interrupted, 143 when terminated, 129 when hung up, 141 when the reader of a pipe went away.
"""

from __future__ import annotations

import argparse
import io
import json
import math
import os
import re
import signal
import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

from froxel_ref import __version__, cli_report, cli_stability, cli_truth
from froxel_ref.cli_progress import Progress, progress
from froxel_ref.records import InputError, shown

if TYPE_CHECKING:
    from froxel_ref.frame import Frame, Plan
    from froxel_ref.scene_files import Loaded

__all__ = ["main"]

SIGNALS = ("SIGINT", "SIGTERM", "SIGHUP")  # by name: not every system has them all
GRACE = 2.0  # seconds in which further signals are part of the first

EXAMPLES = """\
examples:
  froxel-ref scenes
  froxel-ref render two-volumes -o two-volumes.png --size 1280x720
  froxel-ref golden thesis-hall -o golden-hall --grid 240x135x128
  froxel-ref explain uniform
  froxel-ref schema > scene.schema.json
"""
RENDER = """\
The ending of the output says what is written: .png is the picture as displayed (exposed, tone-mapped,
sRGB); .npy and .exr (with the extra: pip install 'froxel-ref[exr]') hold linear radiance.

examples:
  froxel-ref render lights
  froxel-ref render thesis-hall --set 'global_media[0].extinction=0.05' --fidelity published -o thick.png
  froxel-ref render my-scene.json --size 1920x1080 -o my-scene.exr
  froxel-ref render thesis-hall --preset thesis --frames 32 -o hall.png
  froxel-ref render my-scene.json --frames 90 -o frames --set temporal.filter=scattering
  froxel-ref render my-scene.json --frames 90 -o frames --set temporal.filter=scattering --resume
"""
GOLDEN = """\
Writes a folder per stage with .npy arrays in GPU order, pictures, manifest.json and contact_sheet.png,
whose path is the last line printed.

examples:
  froxel-ref golden
  froxel-ref golden thesis-hall -o golden-small --grid 32x18x16 --size 160x90
  froxel-ref golden thesis-hall --preset thesis --frames 16 -o golden-whole
  froxel-ref golden smoke --data path/to/folder --set 'lights[0].irradiance=[3,3,3]'
"""
EXPLAIN = """\
The frame is computed, so the axes and bytes are those of this scene, not an estimate.

examples:
  froxel-ref explain uniform
  froxel-ref explain thesis-hall --json
"""


MOST_FRAMES = 100_000


# --- the entry --------------------------------------------------------------------------------------


class _Stopped(KeyboardInterrupt):
    """A signal that ends the program: all unwind like Ctrl-C, so that nothing half-written stays."""

    def __init__(self, number: int) -> None:
        super().__init__()
        self.number = number


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line.

    Parameters
    ----------
    argv : sequence of str, optional
        The arguments; default: the process's own.

    Returns
    -------
    int
        The exit code.

    Examples
    --------
    >>> main(["explain", "uniform", "--grid", "8x8x8", "--size", "8x8"])  # doctest: +ELLIPSIS
    uniform: 8 x 8 x 8 froxels...
    """
    _occupy()
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="replace")  # a terminal without Unicode must not stop the work
    try:
        with _terminable():
            args = _parser().parse_args(argv)
            if sys.stdout is None and args.run in (_scenes, _explain, _schema):
                raise InputError("output", "standard output is closed")
            args.run(args)
            if sys.stdout is not None:
                sys.stdout.flush()
        return 0
    except InputError as error:
        return _fail(str(error))
    except MemoryError:
        return _fail("memory: the frame does not fit, a smaller --grid or --size may")
    except _Stopped as stopped:
        return 128 + stopped.number
    except KeyboardInterrupt:
        return 130
    except BrokenPipeError:
        _silence()
        return 141
    except OSError as error:
        _silence()
        return _fail(f"{error.filename or 'output'}: {error.strerror or error}")
    except SystemExit as stop:  # argparse, after it has printed help, the version or its one line
        return int(stop.code or 0)


def _fail(message: str) -> int:
    if sys.stderr is not None:  # print would take standard output instead
        with suppress(OSError):
            print("froxel-ref: error:", " ".join(message.split()), file=sys.stderr)
    return 2


def _occupy() -> None:
    """Let no file that is opened later take the number of a standard stream that was closed."""
    if None in (sys.stdin, sys.stdout, sys.stderr):
        with suppress(OSError):
            while (number := os.open(os.devnull, os.O_RDWR)) <= 2:
                pass
            os.close(number)


def _silence() -> None:
    """Let Python's flush at exit go nowhere: the output is already known to be broken."""
    with suppress(OSError, ValueError, AttributeError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


@contextmanager
def _terminable() -> Iterator[None]:
    """Turn the signals that end a program into an exception while a command runs."""
    first = -math.inf

    def stop(number: int, frame: Any) -> None:
        nonlocal first
        # A second signal at once asks for what is being done already, and would cut the cleaning up short.
        if time.monotonic() - first > GRACE:
            first = time.monotonic()
            raise _Stopped(number)

    before: dict[int, Any] = {}
    try:
        if threading.current_thread() is threading.main_thread():
            for number in (getattr(signal, name) for name in SIGNALS if hasattr(signal, name)):
                if signal.getsignal(number) not in (signal.SIG_IGN, None):  # nohup's wish is kept
                    before[number] = signal.signal(number, stop)
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


# --- arguments --------------------------------------------------------------------------------------


class _Parser(argparse.ArgumentParser):
    """Says what is wrong in one line."""

    def error(self, message: str) -> NoReturn:
        self.exit(2, f"froxel-ref: error: {' '.join(message.split())} (see {self.prog} --help)\n")


def _parser() -> argparse.ArgumentParser:
    raw = argparse.RawDescriptionHelpFormatter
    parser = _Parser(prog="froxel-ref", formatter_class=raw, epilog=EXAMPLES,
                     description="Reference implementation of froxel volumetric lighting.")
    parser.add_argument("--version", action="version", version=f"froxel-ref {__version__}")
    commands = parser.add_subparsers(metavar="COMMAND", required=True, parser_class=_Parser)

    def command(name: str, run: Callable[[Any], None], about: str, epilog: str) -> argparse.ArgumentParser:
        added = commands.add_parser(name, help=about, description=about[0].upper() + about[1:] + ".",
                                    epilog=epilog, formatter_class=raw)
        added.set_defaults(run=run)
        return added

    command("scenes", _scenes, "list the built-in scenes", "example:\n  froxel-ref scenes\n")
    render = command("render", _render, "compute a frame and write its final image", RENDER)
    _scene_options(render)
    _output_options(render, "IMAGE", "file to write (default: SCENE.png); with --frames a folder, a .gif, or the last "
                    "frame's image")
    render.add_argument("--frames", metavar="N", help="compute a sequence of N frames, as the scene's tracks move it")
    render.add_argument("--rate", metavar="R", default="30", help="frames a second (default: 30)")
    render.add_argument("--resume", action="store_true", help="go on behind the last frame of a folder of frames")
    golden = command("golden", _golden, "write every stage's arrays as a golden set", GOLDEN)
    _scene_options(golden, default="thesis-hall")
    golden.add_argument("--frames", metavar="N", default="1",
                        help="compute a sequence of N frames and write the last one (default: 1)")
    golden.add_argument("--rate", metavar="R", default="30", help="frames a second (default: 30)")
    _output_options(golden, "DIR", "folder to make (default: golden-SCENE)")
    explain = command("explain", _explain, "say which stages a scene needs, and why", EXPLAIN)
    _scene_options(explain)
    explain.add_argument("--json", action="store_true", help="print JSON")
    truth = command("truth", _truth, "integrate a scene to a tolerance: image, error estimate, picture",
                    cli_truth.EXAMPLES)
    _scene_options(truth)
    _output_options(truth, "DIR", "folder to make (default: truth-SCENE)")
    cli_truth.add_options(truth)
    stability = command("stability", _stability, "measure every kernel's rounding on stiff and extreme inputs",
                        cli_stability.EXAMPLES)
    _output_options(stability, "DIR", "folder to make (default: stability)")
    cli_stability.add_options(stability)
    report = command("report", _report, "measure error against run time, and what the errors come of",
                     cli_report.EXAMPLES)
    _scene_options(report, default="thesis-hall")
    _output_options(report, "DIR", "folder to make (default: report-SCENE)")
    cli_report.add_options(report)
    command("schema", _schema, "print the JSON Schema of scene files",
            "example:\n  froxel-ref schema > scene.schema.json\n")
    return parser


def _scene_options(parser: argparse.ArgumentParser, default: str | None = None) -> None:
    only = {"nargs": "?", "default": default} if default else {}
    parser.add_argument("scene", metavar="SCENE", help="a built-in scene or a .json file"
                        + (f" (default: {default})" if default else ""), **only)  # type: ignore[arg-type]
    parser.add_argument("--grid", metavar="WxHxD", help="froxels across, down and in depth")
    parser.add_argument("--size", metavar="WxH", help="image size in pixels")
    parser.add_argument("--data", metavar="DIR", help="folder of the files that the scene names")
    parser.add_argument("--preset", metavar="NAME", help="settings to begin with: thesis, its whole frame")
    parser.add_argument("--set", metavar="PATH=VALUE", action="append", default=[], dest="changes",
                        help="change one value of the scene or the settings; may be repeated")
    parser.add_argument("--precision", metavar="TYPE", help="float64 (default) or float32")
    parser.add_argument("--fidelity", metavar="NAME", help="corrected (default), published or author")


def _output_options(parser: argparse.ArgumentParser, metavar: str, about: str) -> None:
    parser.add_argument("-o", "--output", metavar=metavar, help=about)
    parser.add_argument("--force", action="store_true", help="replace what an earlier run wrote there")


def _sizes(text: str, option: str, form: str) -> list[str]:
    parts = text.lower().split("x")
    if len(parts) != form.count("x") + 1 or not all(re.fullmatch(r"[0-9]{1,18}", part) for part in parts):
        raise InputError(option, f"is {shown(text)}, must be {form}, whole numbers of at least 1")
    return parts


def _load(args: argparse.Namespace) -> Loaded:
    """The scene with the options that change it, each by the name that its own message will give."""
    from froxel_ref.scene_files import load

    return load(args.scene, overrides=_changes(args), data=args.data)


def _changes(args: argparse.Namespace) -> list[str]:
    """What the options change, as overrides."""
    changes = [] if args.preset is None else _preset(args.preset)
    changes += args.changes
    if args.precision is not None:
        changes.append(f"settings.precision={json.dumps(args.precision)}")
    if args.fidelity is not None:
        changes.append(f"settings.fidelity={json.dumps(args.fidelity)}")
    if args.grid is not None:
        sizes = _sizes(args.grid, "--grid", "WIDTHxHEIGHTxDEPTH")
        axes = ("width", "height", "depth")
        changes += [f"settings.grid.{axis}={n}" for axis, n in zip(axes, sizes, strict=True)]
    if args.size is not None:
        sizes = _sizes(args.size, "--size", "WIDTHxHEIGHT")
        changes += [f"scene.camera.{axis}={n}" for axis, n in zip(("width", "height"), sizes, strict=True)]
    return changes


def _preset(name: str) -> list[str]:
    from froxel_ref.presets import preset

    try:
        return preset(name)
    except InputError as error:
        raise InputError("--preset", error.problem) from None


def _run(loaded: Loaded, outputs: list[str] | None, progress: Progress) -> Frame:
    from froxel_ref.assets import load_assets
    from froxel_ref.frame import plan, run_frame

    planned = plan(loaded.scene, loaded.settings, outputs)  # refuses a size beyond the memory before files are read
    _tell_shortages(planned)
    assets = load_assets(loaded.scene, loaded.folder)
    return run_frame(loaded.scene, loaded.settings, assets=assets, outputs=outputs, progress=progress)


def _last_of(loaded: Loaded, frames: int, rate: float, progress: Progress) -> Frame:
    """The last frame of a sequence with all its results."""
    from froxel_ref.assets import load_assets
    from froxel_ref.quantities import final_result
    from froxel_ref.sequence import run_sequence

    assets = load_assets(loaded.scene, loaded.folder)
    made = run_sequence(loaded.scene, frames=frames - 1, settings=loaded.settings, rate=rate, assets=assets,
                        outputs=[final_result(loaded.settings)], progress=progress)
    before = deque(made, maxlen=1).pop()  # one frame at a time is held
    return next(run_sequence(loaded.scene, frames=frames, first=frames - 1, settings=loaded.settings, rate=rate,
                             assets=assets, previous=before, progress=progress))


def _tell_shortages(planned: Plan) -> None:
    """Lights that the atlas of opacity maps has less room for than they ask."""
    short = [f"{part.name}: {part.why}" for part in planned["fom"].parts if part.name.startswith("lights[")]
    for line in [*short[:3], *[f"… and {len(short) - 3} more (see explain)"] * (len(short) > 3)]:
        print("froxel-ref: note:", line, file=sys.stderr)


# --- commands ---------------------------------------------------------------------------------------


def _scenes(args: argparse.Namespace) -> None:
    from froxel_ref.scene_files import builtin, load

    rows = [("name", "surfaces", "lights", "media", "shows")]
    for name, about in builtin().items():
        scene = load(name).scene
        rows.append((name, str(len(scene.surfaces) or ("buffers" if scene.image_buffers else 0)),
                     str(len(scene.lights) + scene.extra_lights.count),
                     str(len(scene.global_media) + len(scene.local_media)), about))
    _table(rows, "lrrrl")


def _render(args: argparse.Namespace) -> None:
    from froxel_ref.image_files import image_writer
    from froxel_ref.output import output_path, whole_file
    from froxel_ref.quantities import final_result

    if args.frames is not None:
        _render_sequence(args)
        return
    if args.resume:
        raise InputError("--resume", "is given for one image, must come with --frames")
    loaded = _load(args)
    path = output_path(args.output, f"{Path(args.scene).stem}.png")
    write = image_writer(path)
    with progress("stages") as tell, whole_file(path, force=args.force) as partial:
        frame = _run(loaded, [final_result(loaded.settings)], tell)
        write(partial, frame)
    print(path)


def _sequence(args: argparse.Namespace) -> tuple[int, float]:
    """How many frames, and how many a second."""
    if not re.fullmatch(r"[0-9]{1,9}", args.frames) or not 1 <= int(args.frames) <= MOST_FRAMES:
        raise InputError("--frames", f"is {shown(args.frames)}, must be a whole number, 1 to {MOST_FRAMES}")
    if not re.fullmatch(r"[0-9]{1,9}(\.[0-9]{1,9})?", args.rate) or float(args.rate) <= 0.0:
        raise InputError("--rate", f"is {shown(args.rate)}, must be a number above 0 such as 30")
    return int(args.frames), float(args.rate)


@contextmanager
def _told_where(path: Path, *, folder: bool) -> Iterator[None]:
    """Say what stands in a folder of frames when it is interrupted."""
    try:
        yield
    except KeyboardInterrupt:
        done = len(list(path.glob("frame-*.png"))) if folder else 0
        if done:
            print(f"froxel-ref: interrupted; {done} frame{'s' * (done > 1)} in {path}, --resume goes on",
                  file=sys.stderr)
        raise


def _render_sequence(args: argparse.Namespace) -> None:
    from froxel_ref.assets import load_assets
    from froxel_ref.image_files import ENDINGS, image_writer
    from froxel_ref.output import output_path
    from froxel_ref.sequence_files import write_animation, write_frames, write_last

    if args.force and args.resume:
        raise InputError("--resume", "is given with --force, must be one of the two: go on, or begin anew")
    frames, rate = _sequence(args)
    path = output_path(args.output, f"frames-{Path(args.scene).stem}")
    animation = path.suffix.lower() == ".gif"
    last = path.suffix.lower() in ENDINGS
    if not (animation or last) and path.suffix and not path.is_dir():
        raise InputError("output", f"{shown(str(path))} must be a folder, or end in .gif, {', '.join(ENDINGS)}, with "
                                   "--frames")
    if (animation or last) and args.resume:
        raise InputError("--resume", f"is given for a {path.suffix.lower()}, must come with a folder of frames")
    write = image_writer(path) if last else None
    loaded = _load(args)
    assets = load_assets(loaded.scene, loaded.folder)
    with progress("frames") as tell, _told_where(path, folder=not (animation or last)):
        if write is not None:
            write_last(loaded, assets, path, write, frames=frames, rate=rate, force=args.force, progress=tell)
        elif animation:
            write_animation(loaded, assets, path, frames=frames, rate=rate, force=args.force, progress=tell)
        else:
            write_frames(loaded, assets, path, frames=frames, rate=rate, force=args.force, resume=args.resume,
                         progress=tell)
    print(path)


def _golden(args: argparse.Namespace) -> None:
    from froxel_ref.frame import estimate_bytes, plan
    from froxel_ref.golden import check_target, write_golden
    from froxel_ref.output import check_space, output_path

    loaded = _load(args)
    frames, rate = _sequence(args)
    folder = output_path(args.output, f"golden-{Path(args.scene).stem}")
    check_target(folder, force=args.force)  # again when the folder is made: this one saves the wait
    plan(loaded.scene, loaded.settings)
    check_space(folder.absolute().parent, estimate_bytes(loaded.scene, loaded.settings), target=folder)
    with progress("steps") as tell:
        frame = _run(loaded, None, tell) if frames == 1 else _last_of(loaded, frames, rate, tell)
        golden = write_golden(frame, loaded, folder, number=frames - 1, rate=rate, force=args.force, progress=tell)
    rows = [("stage", "arrays", "MB", "seconds", "")]
    for entry in golden.manifest["stages"]:
        files = [a["file"] for a in golden.manifest["arrays"] if a["name"].startswith(entry["name"] + "/")]
        size = sum((folder / file).stat().st_size for file in files)
        seconds = f"{frame.timings[entry['name']]:.3f}" if entry["name"] in frame.timings else "-"
        rows.append((entry["name"], str(len(files)), f"{size / 1e6:.1f}", seconds,
                     "" if entry["runs"] else f"left out: {entry['why']}"))
    _table(rows, "lrrrl")
    print(f"{len(golden.manifest['arrays'])} arrays, {golden.size / 1e6:.1f} MB with their pictures")
    print(golden.contact_sheet)


def _explain(args: argparse.Namespace) -> None:
    loaded = _load(args)
    with progress("stages") as tell:
        frame = _run(loaded, None, tell)
    facts = _facts(frame)
    if args.json:
        print(json.dumps(facts, indent=2))
        return
    grid, camera = loaded.settings.grid, loaded.scene.camera
    print(f"{loaded.scene.name or args.scene}: {grid.width} x {grid.height} x {grid.depth} froxels, "
          f"{camera.width} x {camera.height} pixels, {loaded.settings.precision}, {loaded.settings.fidelity}")
    for stage in facts["stages"]:
        print(f"\n{stage['name']}: {'runs' if stage['runs'] else 'left out'} ({stage['why']})")
        for part in stage["parts"]:
            print(f"  {'with' if part['runs'] else 'without'} {part['name']} ({part['why']})")
        rows = [(f"  {a['name']}", a["varies"] or "constant", _amount(a["bytes"]), "of",
                 _amount(a["expanded_bytes"])) for a in stage["arrays"]]
        _table(rows, "llrlr")
    print(f"\ntotal: {_amount(facts['bytes'])}, of {_amount(facts['expanded_bytes'])} at full size")


def _facts(frame: Frame) -> dict[str, Any]:
    """The plan and what came of it, as plain values."""
    from froxel_ref.golden import gpu_array
    from froxel_ref.pictures import varying
    from froxel_ref.quantities import QUANTITIES, stored_grid

    stages: list[dict[str, Any]] = []
    for planned in frame.plan.stages:
        arrays = []
        for name in frame.plan.written_by(planned):
            if name not in frame.results or not frame.results[name].size:
                continue
            array, quantity = frame.results[name], QUANTITIES[name]
            full, _ = gpu_array(array, quantity, frame.scene.camera, stored_grid(name, frame.settings))
            arrays.append({"name": name, "unit": quantity.unit, "about": quantity.about,
                           "varies": " ".join(varying(array, quantity)), "bytes": array.size * array.itemsize,
                           "expanded_bytes": full.size * full.itemsize})
        parts = [{"name": part.name, "runs": part.runs, "why": part.why} for part in planned.parts]
        stages.append({"name": planned.name, "about": planned.stage.about, "runs": planned.runs,
                       "why": planned.why, "parts": parts, "arrays": arrays})
    every = [array for stage in stages for array in stage["arrays"]]
    return {"stages": stages} | {key: sum(a[key] for a in every) for key in ("bytes", "expanded_bytes")}


def _truth(args: argparse.Namespace) -> None:
    cli_truth.run_truth(args, _load)


def _stability(args: argparse.Namespace) -> None:
    cli_stability.run_stability(args, _table)


def _report(args: argparse.Namespace) -> None:
    args.typed = _changes(args)
    cli_report.run_report_command(args, _load, _table)


def _schema(args: argparse.Namespace) -> None:
    from froxel_ref.scene_files import schema

    print(json.dumps(schema(), indent=2))


# --- printing ---------------------------------------------------------------------------------------


def _amount(size: int) -> str:
    if size < 1000:
        return f"{size} B"
    return f"{size / 1e3:.3f} kB" if size < 100_000 else f"{size / 1e6:.3f} MB"


def _table(rows: Sequence[Sequence[str]], align: str) -> None:
    """Columns, each as wide as its widest entry; ``l`` and ``r`` say to which side."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    for row in rows:
        cells = [cell.ljust(w) if side == "l" else cell.rjust(w)
                 for cell, w, side in zip(row, widths, align, strict=True)]
        print("  ".join(cells).rstrip())
