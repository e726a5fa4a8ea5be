"""What the truth command writes: arrays in GPU order, pictures, and a manifest that says what they are."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from froxel_ref import __version__
from froxel_ref.assets import checksums
from froxel_ref.fom_plan import casting_particles
from froxel_ref.frame import Frame
from froxel_ref.golden import ABOUT, write_array
from froxel_ref.image_files import write_png
from froxel_ref.output import check_folder, read_manifest
from froxel_ref.pictures import View, final_image
from froxel_ref.scene_files import Loaded, document
from froxel_ref.settings import SWITCHES
from froxel_ref.transparency_stage import needs_layers
from froxel_ref.truth_image import TruthImage
from froxel_ref.truth_pictures import Difference, difference, error_picture, overview

__all__ = ["CONTACT_SHEET", "MANIFEST", "Options", "check_target", "write_truth"]

FORMAT, VERSION = "froxel-ref truth", 1
MANIFEST, CONTACT_SHEET = "manifest.json", "contact_sheet.png"

# Every array that may be written: its unit and what it is.
RADIANCE = "W m⁻² sr⁻¹"
ARRAYS = {
    "radiance": (RADIANCE, "surfaces times transmittance, plus the media's light"),
    "layer_radiance": (RADIANCE, "light of particles and transparent surfaces as it arrives; it is in radiance"),
    "layer_transmittance": ("1", "share of the surface's light that passes these; fog_transmittance is the media's"),
    "error": (RADIANCE, "estimated absolute error of radiance; with a box filter, the filter's own is in it"),
    "filter_error": (RADIANCE, "the box filter's share of the error"),
    "fog_radiance": (RADIANCE, "the media's light alone"),
    "fog_transmittance": ("1", "share of the surface's light that passes"),
    "converged": ("1", "whether every ray of the pixel reached rtol"),
    "evaluations": ("1", "points at which a light was evaluated"),
}
PICTURES = ("radiance.png", "error.png", CONTACT_SHEET)
FILES = (*(f"{name}.npy" for name in ARRAYS), *PICTURES, MANIFEST)


class Options(NamedTuple):
    """How a truth was made, by the names of the command's options."""

    rtol: float
    shadows: str
    volumetric_shadows: bool
    filter: str

    def __str__(self) -> str:
        return self.words("media")

    def words(self, dimming: str) -> str:
        """On one line; what dims light is the scene's."""
        shadows = self.shadows + (f", and by {dimming}" if self.volumetric_shadows else "")
        rays = "one ray a pixel" if self.filter == "centre" else "box filter, 49 rays a pixel"
        return f"tolerance {self.rtol:g}, shadows {shadows}, {rays}"


def check_target(folder: Path, *, force: bool) -> None:
    """Whether a truth may be written there.

    Raises
    ------
    InputError
        It exists and ``force`` is not set, it is a file, or it holds anything but a truth.
    """
    check_folder(folder, _foreign, force=force, kind="truth", short="truth")


def _foreign(folder: Path) -> str | None:
    """Something in the folder that no truth there speaks of."""
    known = FILES if read_manifest(folder / MANIFEST, FORMAT) else ()
    return next((path.name for path in sorted(folder.iterdir())
                 if path.name not in known or path.is_symlink() or not path.is_file()), None)


def write_truth(folder: Path, image: TruthImage, frame: Frame, loaded: Loaded, options: Options) -> Difference:
    """Fill an empty folder: arrays, pictures, manifest.

    Parameters
    ----------
    folder : Path
        From `froxel_ref.output.whole_folder`.
    image : TruthImage
    frame : Frame
        Of the same scene, with its final image.
    loaded : Loaded
        Scene, settings and the folder of the files that the scene names.
    options : Options

    Returns
    -------
    Difference
        Between frame and truth.
    """
    left_out = set() if options.filter == "box" else {"filter_error"}
    if not needs_layers(loaded.scene, loaded.settings)[0]:
        left_out |= {"layer_radiance", "layer_transmittance"}
    entries = [_write(folder, name, image) for name in ARRAYS if name not in left_out]
    view = View(frame.scene.camera, frame.settings.grid, frame.display_exposure)
    shown = np.broadcast_to(frame.image, image.radiance.shape)
    write_png(folder / "radiance.png", final_image(image.radiance, view))
    write_png(folder / "error.png", error_picture(image))
    grid = frame.settings.grid
    dimming = "media and particles" if casting_particles(loaded.scene) else "media"
    write_png(folder / CONTACT_SHEET, overview(
        image, shown, view, title=loaded.scene.name or "unnamed scene", facts=options.words(dimming),
        frame_facts=f"{grid.width} x {grid.height} x {grid.depth} froxels, {frame.settings.precision}, "
                    f"{frame.settings.fidelity}, shadows {_shadows(frame, options)}"))
    found = difference(shown, image.radiance)
    manifest = _manifest(image, loaded, options, found) | {"arrays": entries}
    text = json.dumps(manifest, indent=1, ensure_ascii=False, allow_nan=False) + "\n"
    (folder / MANIFEST).write_text(text, encoding="utf-8", newline="\n")
    return found


def _write(folder: Path, name: str, image: TruthImage) -> dict[str, Any]:
    """One array; its entry in the manifest."""
    array, (unit, about) = np.asarray(getattr(image, name)), ARRAYS[name]
    array = array.astype("<i8") if name == "evaluations" else array
    view = np.moveaxis(array, 0, -1) if array.ndim == 3 else array
    sha256 = write_array(folder / f"{name}.npy", view)
    return {"name": name, "file": f"{name}.npy", "shape": list(view.shape),
            "dtype": view.dtype.newbyteorder("<").str, "axes": ["y", "x", "channel"][:view.ndim], "unit": unit,
            "about": about, "sha256": sha256}


def _shadows(frame: Frame, options: Options) -> str:
    """What the frame's shadows are, and what of the truth's they lack."""
    by = {"maps": "by maps", "exact": "by rays", "off": "off"}[frame.settings.shadows]
    media = {"maps": "by Fourier opacity maps", "exact": "by rays", "off": "none"}[frame.settings.volumetric_shadows]
    return by + (f", of media {media}" if options.volumetric_shadows or media != "none" else "")


def _manifest(image: TruthImage, loaded: Loaded, options: Options, found: Difference) -> dict[str, Any]:
    rms = found.rms if np.isfinite(found.rms) else str(found.rms)
    return {
        "format": FORMAT, "schema_version": VERSION,
        "conventions": {key: ABOUT[key] for key in ("order", "sha256", "resolved_switches")},
        "made_by": {"froxel-ref": __version__, "numpy": np.__version__},
        "input": document(loaded.scene, loaded.settings),
        "resolved_switches": {name: getattr(loaded.settings, name) for name in SWITCHES},
        "input_files": checksums(loaded.scene, loaded.folder), "truth": options._asdict(),
        "pixels": int(image.converged.size), "unconverged": int((~image.converged).sum()),
        "frame_against_truth": {
            "about": "the frame of the same input. Of the largest difference of a channel over the pixel's brightest: "
                     "median, worst, and that pixel's column and row; root mean square difference over the mean "
                     "radiance",
            "median": found.median if np.isfinite(found.median) else str(found.median), "rms": rms,
            "worst": found.worst, "pixel": list(found.pixel)},
        "pictures": list(PICTURES)}
