"""The command ``froxel-ref truth``: the converged image of a scene, its error estimate and a picture."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from froxel_ref.records import InputError, shown

if TYPE_CHECKING:
    from froxel_ref.scene_files import Loaded
    from froxel_ref.truth_image import TruthImage

__all__ = ["EXAMPLES", "add_options", "run_truth"]

EXAMPLES = """\
Writes a folder with radiance.npy (height, width, 3), error.npy (the estimated absolute error of each
value), converged.npy and radiance.png; the picture's path is the last line printed. Rays that did not
reach the tolerance are counted, and are false in converged.npy.

examples:
  froxel-ref truth two-volumes
  froxel-ref truth thesis-hall --size 160x90 --shadows exact --rtol 1e-3 -o hall
  froxel-ref truth lights --size 64x36 --volumetric-shadows --filter box
"""
FILES = ("radiance.npy", "error.npy", "converged.npy", "radiance.png")


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of this command beside those that name a scene and an output."""
    parser.add_argument("--rtol", metavar="R", default="1e-4",
                        help="wanted error as a share of the fog's radiance (default: 1e-4)")
    parser.add_argument("--shadows", metavar="KIND", default="off",
                        help="off (default, as the frame) or exact")
    parser.add_argument("--volumetric-shadows", action="store_true",
                        help="let media dim light on its way to the fog and the surfaces")
    parser.add_argument("--filter", metavar="KIND", default="centre",
                        help="centre of each pixel (default), or box: 49 rays a pixel")


def _tolerance(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise InputError("--rtol", f"is {shown(text)}, must be a number such as 1e-4") from None


def _check_target(folder: Path, force: bool) -> None:
    """Refuse a place that holds anything but an earlier result of this command."""
    name = shown(str(folder))
    if not folder.exists():
        return
    if not folder.is_dir():
        raise InputError("output", f"{name} is a file, must be a folder")
    foreign = sorted(path.name for path in folder.iterdir() if path.name not in FILES)
    if foreign:
        raise InputError("output", f"{name} holds {shown(foreign[0])}, which is not of a truth, must be "
                                   "empty or hold an earlier one")
    if not force:
        raise InputError("output", f"{name} exists; give --force to replace it")


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
    from froxel_ref.output import whole_folder
    from froxel_ref.truth import check_options
    from froxel_ref.truth_image import check_integrable, render_truth

    rtol = _tolerance(args.rtol)
    check_options(rtol, args.shadows, 1.0)
    loaded = load(args)
    check_integrable(loaded.scene, loaded.settings)
    folder = Path(args.output or f"truth-{Path(args.scene).stem}")
    whole = whole_folder(folder, lambda target: _check_target(target, args.force))
    with whole as partial, _bar() as progress:
        image = render_truth(
            loaded.scene, loaded.settings, assets=load_assets(loaded.scene, loaded.folder), rtol=rtol,
            shadows=args.shadows, volumetric_shadows=args.volumetric_shadows, pixel_filter=args.filter,
            progress=progress)
        _write(partial, image, loaded)
    print(_summary(image))
    print(folder / "radiance.png")


def _write(folder: Path, image: TruthImage, loaded: Loaded) -> None:
    import numpy as np

    from froxel_ref.image_files import write_png
    from froxel_ref.pictures import View, final_image

    for name, planes in (("radiance", image.radiance), ("error", image.error)):
        np.save(folder / f"{name}.npy", np.ascontiguousarray(np.moveaxis(planes, 0, -1)).astype("<f8"))
    np.save(folder / "converged.npy", image.converged)
    camera = loaded.scene.camera
    exposure = 1.0 if loaded.settings.exposure == "lighting" else camera.exposure
    view = View(camera, loaded.settings.grid, exposure)
    write_png(folder / "radiance.png", final_image(image.radiance, view))


def _summary(image: TruthImage) -> str:
    import numpy as np

    fog = image.fog_radiance
    relative = np.divide(image.error, fog, out=np.zeros_like(fog), where=fog > 0.0)
    share, count = float(image.converged.mean()), int(image.converged.size)
    return (f"{share:.2%} of {count} pixels converged, largest estimated error {relative.max():.1e} of the "
            f"fog's radiance, {image.evaluations.mean():.0f} evaluations a pixel")


@contextmanager
def _bar() -> Iterator[Callable[[int, int], None]]:
    """A bar on standard error, if that is a terminal."""
    import sys

    from tqdm import tqdm

    with tqdm(total=0, file=sys.stderr, disable=None, leave=False, unit="ray", unit_scale=True) as bar:
        def tell(done: int, count: int) -> None:
            bar.total, bar.n = count, done
            bar.refresh()

        yield tell
