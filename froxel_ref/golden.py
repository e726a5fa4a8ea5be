"""Golden sets: every result of a frame as files that another implementation can be held against.

One folder per stage, one ``.npy`` file per result in the order of a GPU texture, a picture of each, a
contact sheet, and ``manifest.json``, which says what everything is. The manifest holds no time and no
path of the machine, so that two runs give the same bytes.
"""

from __future__ import annotations

import hashlib
import json
import math
import re
import stat
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from froxel_ref import __version__, pictures
from froxel_ref.arrays import Field
from froxel_ref.assets import checksums
from froxel_ref.image_files import write_png
from froxel_ref.output import check_folder, check_space, read_manifest, whole_folder
from froxel_ref.quantities import QUANTITIES, Quantity, raster_size, stored_grid
from froxel_ref.records import to_json
from froxel_ref.scene import Camera, ParticleCloud, Scene
from froxel_ref.scene_files import Loaded, document
from froxel_ref.sequence import RATE
from froxel_ref.settings import SWITCHES, Grid
from froxel_ref.stages import STAGES

if TYPE_CHECKING:
    from froxel_ref.frame import Frame

__all__ = [
    "CONTACT_SHEET", "MANIFEST", "GoldenSet", "check_target", "golden_bytes", "gpu_array", "write_array",
    "write_golden",
]

FORMAT, VERSION = "froxel-ref golden set", 1
MANIFEST, CONTACT_SHEET = "manifest.json", "contact_sheet.png"
SLAB = 1 << 22  # bytes written at once: the most that is ever expanded
# The pictures of one array and its share of the contact sheet, generously: their text and frames, and
# what each value that is shown adds, up to the most pixels that a picture has.
PICTURE_BYTES, VALUE_BYTES, MOST_PICTURE_BYTES = 150_000, 10, 4_000_000
ABOUT = {
    "order": "each .npy file is C-contiguous and little-endian, its axes as listed, the last one fastest; "
             "rows run from the top of the image, slices away from the camera",
    "varies": "the axes along which the values may differ; along the others they are repeated",
    "sha256": "of the whole file's bytes, header included",
    "frame": "its number in a sequence from 0 at so many frames a second, which it remembers, and the scene's time "
             "then; the input is as the sequence begins",
    "resolved_switches": "the choice in force for each departure of the sources, as fidelity and switches "
                         "in input.settings make it",
}
AXES = {"z": "z", "y": "y", "x": "x", "c": "channel", "l": "lobe", "n": "place", "e": "first or last", "b": "bin",
        "w": "word", "v": "tile row", "u": "tile column", "m": "light", "f": "face", "p": "row", "q": "column",
        "i": "matrix row", "j": "matrix column", "a": "row, column or size"}

Progress = Callable[[str, int, int], None]


class GoldenSet(NamedTuple):
    """A golden set on disk.

    Attributes
    ----------
    folder : Path
        Where it stands.
    manifest : dict
        What ``manifest.json`` in it holds.
    contact_sheet : Path
        The picture of all its arrays.
    size : int
        Of all its files [bytes].
    """

    folder: Path
    manifest: dict[str, Any]
    contact_sheet: Path
    size: int


# --- layout -----------------------------------------------------------------------------------------


def gpu_array(array: Field, quantity: Quantity, camera: Camera, grid: Grid) -> tuple[Field, str]:
    """An array as a GPU texture holds it: full size, channel last.

    Parameters
    ----------
    array : array
        As computed: channel first, length 1 where constant.
    quantity : Quantity
        What it is.
    camera, grid : Camera, Grid
        The sizes of images and volumes.

    Returns
    -------
    view : array
        A read-only view; nothing is expanded.
    axes : str
        Its axes, such as ``zyxc``.

    Examples
    --------
    >>> from froxel_ref.scene import Camera; from froxel_ref.settings import Grid
    >>> from froxel_ref.quantities import QUANTITIES
    >>> view, axes = gpu_array(np.ones((3, 1, 1, 1)), QUANTITIES["media/scattering"], Camera(), Grid())
    >>> view.shape, axes
    ((64, 90, 160, 3), 'zyxc')
    """
    axes = pictures.full_axes(array, quantity)
    rows, columns = raster_size(quantity, camera, grid)
    sizes = dict(zip(axes, array.shape, strict=True)) | {"x": columns, "y": rows, "z": grid.depth}
    whole = np.broadcast_to(array, tuple(sizes[axis] for axis in axes))
    if "c" not in axes:
        return whole, axes
    return np.moveaxis(whole, axes.index("c"), -1), axes.replace("c", "") + "c"


def _slabs(view: Field) -> Iterator[NDArray[Any]]:
    """The array's values in order, little-endian, a few megabytes at a time."""
    rows = max(1, SLAB // max(1, view.itemsize * math.prod(view.shape[1:])))
    kind = view.dtype.newbyteorder("<")
    for begin in range(0, view.shape[0], rows):
        yield np.ascontiguousarray(view[begin:begin + rows], dtype=kind)


def write_array(path: Path, view: Field) -> str:
    """Write a ``.npy`` file, little-endian, a few megabytes at a time.

    Parameters
    ----------
    path : Path
        The file.
    view : ndarray
        In the order in which its values are to stand; nothing is expanded whole.

    Returns
    -------
    str
        SHA-256 of the file.

    Examples
    --------
    >>> import tempfile
    >>> len(write_array(Path(tempfile.mkdtemp(), "ones.npy"), np.ones((2, 3))))
    64
    """
    digest = hashlib.sha256()

    class Tee:
        def write(self, data: Any) -> int:
            digest.update(data)
            return file.write(data)

    header = {"descr": np.lib.format.dtype_to_descr(view.dtype.newbyteorder("<")), "fortran_order": False,
              "shape": view.shape}
    with path.open("wb") as file:
        np.lib.format.write_array_header_1_0(Tee(), header)
        for slab in _slabs(view):
            Tee().write(slab.data.cast("B"))
    return digest.hexdigest()


def golden_bytes(frame: Frame) -> int:
    """About how many bytes a golden set of a frame takes.

    Parameters
    ----------
    frame : Frame
        With the results to be written.

    Returns
    -------
    int
        Its arrays at full size, and a generous share for each picture [bytes].

    Examples
    --------
    >>> import froxel_ref
    >>> scene, settings, _ = froxel_ref.load("uniform", overrides=[
    ...     "camera.width=4", "camera.height=2", "grid.width=2", "grid.height=2", "grid.depth=2"])
    >>> frame = froxel_ref.run_frame(scene, settings)
    >>> golden_bytes(frame) > sum(array.size > 0 for array in frame.results.values()) * PICTURE_BYTES
    True
    """
    views = (gpu_array(array, QUANTITIES[name], frame.scene.camera, stored_grid(name, frame.settings))[0]
             for name, array in frame.results.items() if array.size)
    return sum(view.size * view.itemsize + PICTURE_BYTES + min(VALUE_BYTES * view.size, MOST_PICTURE_BYTES)
               for view in views)


# --- where it may stand -----------------------------------------------------------------------------


def check_target(folder: Path, *, force: bool) -> None:
    """Refuse a place that holds something a golden set must not replace.

    Parameters
    ----------
    folder : Path
        Where a golden set is to stand.
    force : bool
        Whether a golden set that stands there may be replaced; nothing else ever is, but an empty folder.

    Raises
    ------
    InputError
        It exists and ``force`` is not set, it is a file, or it holds anything but a golden set.
    """
    check_folder(folder, _foreign, force=force, kind="golden set", short="golden set")


def _foreign(folder: Path) -> str | None:
    """Something in the folder that the golden set there, if there is one, did not put there.

    The manifest is read first: without one of ours nothing else is looked at, however much there is.
    """
    known = _listed(folder / MANIFEST)
    stages = {file.partition("/")[0] for file in known if "/" in file}
    for name in sorted(entry.name for entry in folder.iterdir()):
        path = folder / name
        if name in stages and stat.S_ISDIR(path.lstat().st_mode):
            inside = sorted(f"{name}/{entry.name}" for entry in path.iterdir())
        else:
            inside = [name]
        for file in inside:
            if file not in known or not stat.S_ISREG((folder / file).lstat().st_mode):
                return file
    return None


def _listed(manifest: Path) -> set[str]:
    """The files of a golden set that its manifest lists; none if it is not one of ours."""
    content = read_manifest(manifest, FORMAT)
    try:
        names = [str(array["name"]) for array in content["arrays"]] if content else None
    except (TypeError, KeyError):
        names = None
    if names is None:
        return set()
    # Whatever else a manifest lists, only what this program can have written is its own.
    ours = re.compile(rf"({'|'.join(stage.name for stage in STAGES)})/[a-z_]+")
    arrays = {f"{name}{ending}" for name in names if ours.fullmatch(name) for ending in (".npy", ".png")}
    return {MANIFEST, CONTACT_SHEET} | arrays


# --- the manifest -----------------------------------------------------------------------------------


def _stage_entries(frame: Frame) -> list[dict[str, Any]]:
    entries = []
    for planned in frame.plan.stages:
        entry: dict[str, Any] = {"name": planned.name, "about": planned.stage.about, "runs": planned.runs,
                                 "why": planned.why}
        parts = [{"name": part.name, "runs": part.runs, "why": part.why} for part in planned.parts]
        entry |= {"parts": parts} if parts else {}
        if not planned.runs:
            entry["neutral"] = {name: _plain(frame.results[name]) for name in frame.plan.written_by(planned)
                                if name in frame.results and 0 < frame.results[name].size <= 3}
        entries.append(entry)
    return entries


def _strewn(scene: Scene) -> dict[str, Any]:
    """What the scene strews from seeds, written out: nobody else has NumPy's generator."""
    particles = [each for cloud in scene.particles if isinstance(cloud, ParticleCloud) for each in cloud.particles()]
    return {"particles": [to_json(each) for each in particles],
            "lights": [to_json(light) for light in scene.extra_lights.lights()]}


def _plain(array: Field) -> Any:
    """A constant as JSON, which knows no infinity."""
    values = [v if math.isfinite(v) else str(v) for v in np.unique(array).tolist()]
    return values[0] if len(values) == 1 else [float(v) for v in array.ravel()]


# --- writing ----------------------------------------------------------------------------------------


def write_golden(frame: Frame, loaded: Loaded, folder: Path, *, number: int = 0, rate: float = RATE,
                 force: bool = False, progress: Progress | None = None) -> GoldenSet:
    """Write a frame's results, pictures and manifest into a folder that appears whole or not at all.

    Parameters
    ----------
    frame : Frame
        From `froxel_ref.frame.run_frame` on ``loaded``'s scene and settings.
    loaded : Loaded
        Scene, settings and the folder of the files that the scene names.
    folder : Path
        The folder to make.
    number : int
        Of the frame, if it is one of a sequence from 0.
    rate : float [1/s]
        Of that sequence.
    force : bool
        Replace a golden set that stands there, once the new one is complete.
    progress : callable, optional
        Called as ``progress(result, index, count)`` before each result, and for the contact sheet.

    Returns
    -------
    GoldenSet
        What now stands in the folder.

    Raises
    ------
    InputError
        The place is taken or cannot be written, the disk is too small or runs full.

    Notes
    -----
    Arrays are expanded a few megabytes at a time while they are written. The manifest is written last.

    Examples
    --------
    >>> import tempfile
    >>> from froxel_ref.frame import run_frame
    >>> from froxel_ref.scene_files import load
    >>> small = [f"camera.{side}=4" for side in ("width", "height")]
    >>> small += [f"grid.{side}=2" for side in ("width", "height", "depth")]
    >>> loaded = load("uniform", overrides=small)
    >>> frame = run_frame(loaded.scene, loaded.settings)
    >>> golden = write_golden(frame, loaded, Path(tempfile.mkdtemp(), "set"))
    >>> np.load(golden.folder / "integrate" / "transmittance.npy").shape
    (2, 2, 2)
    >>> golden.manifest["resolved_switches"]["lookup"]
    'boundary'
    """
    folder = Path(folder)
    tell = progress or (lambda name, index, count: None)
    names = [name for name, array in frame.results.items() if array.size]
    with whole_folder(folder, lambda target: check_target(target, force=force)) as partial:
        check_space(partial, golden_bytes(frame), target=folder)
        manifest: dict[str, Any] = {
            "format": FORMAT, "schema_version": VERSION, "conventions": ABOUT,
            "made_by": {"froxel-ref": __version__, "numpy": np.__version__},
            "input": document(loaded.scene, loaded.settings),
            "resolved_switches": {name: getattr(loaded.settings, name) for name in SWITCHES},
            "frame": {"number": number, "rate": rate, "time": frame.settings.time},
            "strewn": _strewn(loaded.scene),
            "input_files": checksums(loaded.scene, loaded.folder),
            "stages": _stage_entries(frame), "contact_sheet": CONTACT_SHEET,
        }
        entries = []
        for index, name in enumerate(names):
            tell(name, index, len(names) + 1)
            entries.append(_write_result(partial, name, frame))
        tell("contact sheet", len(names), len(names) + 1)
        _write_contact_sheet(partial, frame)
        manifest["arrays"] = entries
        text = json.dumps(manifest, indent=1, ensure_ascii=False, allow_nan=False) + "\n"
        (partial / MANIFEST).write_text(text, encoding="utf-8", newline="\n")
        size = sum(path.stat().st_size for path in partial.rglob("*") if path.is_file())
    return GoldenSet(folder, manifest, folder / CONTACT_SHEET, size)


def _write_result(folder: Path, name: str, frame: Frame) -> dict[str, Any]:
    """One array and its picture; its entry in the manifest."""
    array, quantity = frame.results[name], QUANTITIES[name]
    grid = stored_grid(name, frame.settings)
    view, axes = gpu_array(array, quantity, frame.scene.camera, grid)
    file = f"{name}.npy"
    (folder / file).parent.mkdir(exist_ok=True)
    sha256 = write_array(folder / file, view)
    picture = f"{name}.png"
    how = pictures.View(frame.scene.camera, grid, frame.display_exposure)
    write_png(folder / picture, pictures.preview(array, quantity, name=name, view=how))
    return {"name": name, "file": file, "preview": picture, "shape": list(view.shape),
            "dtype": view.dtype.newbyteorder("<").str, "axes": [AXES[axis] for axis in axes],
            "varies": [AXES[axis] for axis in pictures.varying(array, quantity)],
            "unit": quantity.unit, "about": quantity.about, "sha256": sha256}


def _write_contact_sheet(folder: Path, frame: Frame) -> None:
    write_png(folder / CONTACT_SHEET, pictures.contact_sheet(frame))
