"""The command ``froxel-ref truth``: parsing and printing only."""

from __future__ import annotations

import argparse
import re
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from froxel_ref.cli_progress import progress
from froxel_ref.records import InputError, shown

if TYPE_CHECKING:
    from froxel_ref.frame import Frame
    from froxel_ref.scene_files import Loaded
    from froxel_ref.truth_files import Options
    from froxel_ref.truth_image import TruthImage

__all__ = ["EXAMPLES", "add_options", "run_truth"]

EXAMPLES = """\
Writes a folder with .npy arrays in GPU order (height, width, channel): radiance, error (the estimated
absolute error of each value), fog_radiance, fog_transmittance, converged, evaluations, of scenes with particles or
transparent surfaces layer_radiance and layer_transmittance; manifest.json; and
pictures: radiance.png, error.png, and contact_sheet.png with the frame of the same scene beside it, whose path
is the last line printed. Rays that did not reach the tolerance are counted, and are false in converged.npy.
The truth is always float64 and has no froxels: --grid's sizes and --precision are those of the frame.

examples:
  froxel-ref truth two-volumes
  froxel-ref truth thesis-hall --size 160x90 --shadows off --rtol 1e-3 -o hall
  froxel-ref truth lights --size 64x36 --volumetric-shadows --filter box
  froxel-ref truth particles-in-fog --size 160x90
"""


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of this command beside those that name a scene and an output."""
    parser.add_argument("--rtol", metavar="R", default="1e-4",
                        help="wanted error as a share of the fog's radiance (default: 1e-4)")
    parser.add_argument("--shadows", metavar="KIND",
                        help="exact, or off (default: exact, unless the scene's settings have them off)")
    parser.add_argument("--volumetric-shadows", action=argparse.BooleanOptionalAction,
                        help="let media and particles dim light on its way to what it shines on (default: as the "
                             "scene's settings have it)")
    parser.add_argument("--filter", metavar="KIND", default="centre",
                        help="centre of each pixel (default), or box: 49 rays a pixel")


def _options(args: argparse.Namespace) -> Options:
    """What was typed, or a fault that names the option."""
    from froxel_ref.truth import SHADOWS, check_options
    from froxel_ref.truth_files import Options
    from froxel_ref.truth_image import FILTERS

    if not re.fullmatch(r"[-+]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][-+]?[0-9]{1,4})?", args.rtol):
        raise InputError("--rtol", f"is {shown(args.rtol)}, must be a number such as 1e-4")
    kind = SHADOWS[-1] if args.shadows is None else args.shadows
    for option, word, known in (("--shadows", kind, SHADOWS), ("--filter", args.filter, FILTERS)):
        if word not in known:
            raise InputError(option, f"is {shown(word)}, must be {' or '.join(known)}")
    options = Options(float(args.rtol), kind, bool(args.volumetric_shadows), args.filter)
    try:
        check_options(options.rtol, options.shadows, 1.0)
    except InputError as error:
        raise InputError("--rtol", error.problem) from None
    return options


def _check_scene(loaded: Loaded, options: Options, name: str) -> None:
    from froxel_ref.frame import plan
    from froxel_ref.quantities import final_result
    from froxel_ref.truth_image import check_filter, check_integrable

    try:
        check_integrable(loaded.scene, loaded.settings)
    except InputError as error:
        see = f"; to see its surfaces: froxel-ref render {name}" if error.place == "scene" else ""
        raise InputError(error.place, error.problem + see) from None
    try:
        check_filter(loaded.scene, options.filter)
    except InputError as error:
        raise InputError("--filter", error.problem) from None
    plan(loaded.scene, loaded.settings, [final_result(loaded.settings)])  # refuses a frame beyond the memory


def run_truth(args: argparse.Namespace, load: Callable[[Any], Loaded]) -> None:
    """Run the command.

    Parameters
    ----------
    args : Namespace
        What the parser made of the command line.
    load : callable
        Gives the scene that the arguments name.

    Raises
    ------
    InputError
        Anything wrong with the input or the output.
    """
    from froxel_ref.assets import load_assets
    from froxel_ref.frame import run_frame
    from froxel_ref.output import output_path, whole_folder
    from froxel_ref.quantities import final_result
    from froxel_ref.truth_files import CONTACT_SHEET, check_target, write_truth
    from froxel_ref.truth_image import render_truth, shadow_kind

    options, loaded = _options(args), load(args)
    if args.shadows is None:
        options = options._replace(shadows=shadow_kind(loaded.settings))
    if args.volumetric_shadows is None:
        options = options._replace(volumetric_shadows=loaded.settings.volumetric_shadows != "off")
    _check_scene(loaded, options, args.scene)
    folder = output_path(args.output, f"truth-{Path(args.scene).stem}")
    check_target(folder, force=args.force)
    assets = load_assets(loaded.scene, loaded.folder)
    with whole_folder(folder, lambda target: check_target(target, force=args.force)) as partial:
        frame = run_frame(loaded.scene, loaded.settings, assets=assets, outputs=[final_result(loaded.settings)])
        with progress("rays") as tell:
            image = render_truth(
                loaded.scene, loaded.settings, assets=assets, rtol=options.rtol, shadows=options.shadows,
                volumetric_shadows=options.volumetric_shadows, pixel_filter=options.filter,
                progress=lambda done, count: tell("", done, count))
        found = write_truth(partial, image, frame, loaded, options)
    for line in _summary(image, options):
        print(line)
    print(f"{_frame(frame, options)}: half of the pixels within {found.median:.1e} of the truth, worst "
          f"{found.worst:.1e} at pixel x {found.pixel[0]}, y {found.pixel[1]}; RMS difference {found.rms:.1e} of the "
          "mean radiance")
    print(folder / CONTACT_SHEET)


def _frame(frame: Frame, options: Options) -> str:
    grid = frame.settings.grid
    lacks = options.volumetric_shadows and frame.settings.volumetric_shadows == "off"
    words = "; without the shadows of media: settings.volumetric_shadows=off" if lacks else ""
    return f"frame ({grid.width} x {grid.height} x {grid.depth} froxels, {frame.settings.precision}{words})"


def _summary(image: TruthImage, options: Options) -> list[str]:
    """How the rays did, and the filter."""
    import numpy as np

    def largest(part: Any, whole: Any) -> float:
        return float(np.divide(part, whole, out=np.zeros_like(part), where=whole > 0.0).max())

    count, missed = int(image.converged.size), int((~image.converged).sum())
    reached = f"{missed} of {count} pixels did not" if missed else f"all {count} pixels did"
    rays = largest(image.error - image.filter_error, image.fog_radiance)
    lines = [f"rays: to reach {options.rtol:g}, {reached}; largest estimated error {rays:.1e} of the fog's radiance; "
             f"{image.evaluations.mean():.0f} evaluations a pixel"]
    if options.filter == "box":
        beyond = int((image.filter_error > options.rtol * image.radiance).any(axis=0).sum())
        lines.append(f"filter: {beyond} of {count} pixels exceed {options.rtol:g}, where edges cross them; largest "
                     f"estimated error {largest(image.filter_error, image.radiance):.1e} of the pixel's radiance")
    return lines
