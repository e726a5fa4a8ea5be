"""What a sequence leaves on disk: a folder of frames that can be gone on with, or one animated picture."""

from __future__ import annotations

import io
import json
import re
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from froxel_ref.assets import Assets
from froxel_ref.frame import Frame, Progress, plan, remembered
from froxel_ref.image_files import display_image, write_png
from froxel_ref.jobs import History
from froxel_ref.output import check_folder, read_manifest, refusal, whole_file
from froxel_ref.quantities import QUANTITIES, final_result, raster_size
from froxel_ref.records import InputError, from_json, shown, to_json
from froxel_ref.scene import LONGEST, SHORTEST, Camera
from froxel_ref.scene_files import Loaded, document
from froxel_ref.sequence import run_sequence
from froxel_ref.settings import Grid, Settings

__all__ = ["MANIFEST", "STATE", "check_target", "write_animation", "write_frames"]

FORMAT, VERSION = "froxel-ref sequence", 1
MANIFEST, STATE = "sequence.json", "history.npz"
PICTURE = "frame-{:05d}.png"


class _State(NamedTuple):
    """The last frame of a folder, and what it hands to the next."""

    frame: int
    history: History | None


def check_target(folder: Path, *, force: bool, resume: bool) -> None:
    """Whether a sequence may be written there.

    Parameters
    ----------
    folder : Path
    force : bool
        Replace a sequence that stands there.
    resume : bool
        Go on with one that stands there, if there is one.

    Raises
    ------
    InputError
        The place is taken.
    """
    check_folder(folder, _foreign, force=force or resume, kind="sequence", short="sequence",
                 instead="--resume to go on with it, --force to replace it")


def _foreign(folder: Path) -> str | None:
    """Something in the folder that no sequence put there."""
    ours = re.compile(r"frame-[0-9]{5,}\.png")
    known = {MANIFEST, STATE} if read_manifest(folder / MANIFEST, FORMAT) else set()
    return next((entry.name for entry in sorted(folder.iterdir())
                 if entry.name not in known and not (known and ours.fullmatch(entry.name))), None)


@contextmanager
def _writing(folder: Path) -> Iterator[None]:
    try:
        yield
    except (OSError, MemoryError) as error:
        raise refusal(error, "output", folder) from None


def write_frames(loaded: Loaded, assets: Assets, folder: Path, *, frames: int, rate: float, force: bool = False,
                 resume: bool = False, progress: Progress | None = None) -> int:
    """Compute a sequence into a folder: a picture for each frame, and what the next one needs.

    Parameters
    ----------
    loaded : Loaded
        Scene and settings.
    assets : Assets
        Of the scene.
    folder : Path
        Made if it is not there.
    frames : int
        Their number.
    rate : float [1/s]
        Frames a second.
    force : bool
        Begin anew over a sequence that stands there.
    resume : bool
        Go on behind the last frame that stands there, if it is of the same scene, settings and rate.
    progress : callable, optional
        Called before each frame.

    Returns
    -------
    int
        How many frames were computed now.

    Raises
    ------
    InputError
        The place is taken, what stands there is of another scene, or it cannot be written.

    Notes
    -----
    Each file appears whole or not at all; after every frame the folder can be gone on with.
    """
    check_target(folder, force=force, resume=resume)
    written = document(loaded.scene, loaded.settings)
    state, final = _state(folder, written, rate, loaded.settings) if resume else None, final_result(loaded.settings)
    first = 0 if state is None else state.frame + 1
    if first >= frames:
        return 0
    before = None if state is None else Frame({}, plan(loaded.scene, loaded.settings, [final]), {}, loaded.scene,
                                              loaded.settings, history=state.history)
    # Refuses a frame that is not allowed before anything is written.
    made = run_sequence(loaded.scene, frames=frames, settings=loaded.settings, first=first, rate=rate, assets=assets,
                        outputs=[final], progress=progress, previous=before)
    with _writing(folder):
        folder.mkdir(exist_ok=True)
        if state is None:
            for old in sorted(folder.iterdir()):
                old.unlink()
            _save(folder / MANIFEST, json.dumps({"format": FORMAT, "version": VERSION, "rate": rate, "input": written},
                                                indent=1, allow_nan=False).encode())
        for number, frame in enumerate(made, first):
            with whole_file(folder / PICTURE.format(number), force=True) as partial:
                write_png(partial, display_image(frame))
            _save(folder / STATE, _packed(number, frame.history))
    return frames - first


def _save(path: Path, content: bytes) -> None:
    with whole_file(path, force=True) as partial:
        partial.write_bytes(content)


def _packed(frame: int, history: History | None) -> bytes:
    """A state as an ``.npz``: its arrays, and its facts as JSON."""
    facts: dict[str, Any] = {"frame": frame, "history": None}
    arrays: dict[str, Any] = {}
    if history is not None:
        facts["history"] = {"camera": to_json(history.camera), "grid": to_json(history.grid),
                            "exposure": history.exposure, "length": history.length}
        arrays = {name.replace("/", "."): field for name, field in history.fields.items()}
    file = io.BytesIO()
    np.savez(file, facts=np.array(json.dumps(facts)), **arrays)
    return file.getvalue()


def _state(folder: Path, written: Any, rate: float, settings: Settings) -> _State | None:
    """Where a folder's sequence stands; nothing where there is none."""
    manifest = read_manifest(folder / MANIFEST, FORMAT)
    if manifest is None:
        return None
    if manifest.get("version") != VERSION:
        raise InputError("output", f"{shown(str(folder))} holds a sequence of version "
                                   f"{shown(manifest.get('version'))}, must be {VERSION}; give --force to begin anew")
    if manifest.get("input") != json.loads(json.dumps(written)) or manifest.get("rate") != rate:
        raise InputError("output", f"{shown(str(folder))} holds a sequence of another scene, other settings or another "
                                   "rate, and cannot be gone on with; give --force to begin anew")
    try:
        state = _read_state(folder / STATE, remembered(settings))
    except FileNotFoundError:
        return None
    except Exception as error:  # a damaged archive raises whatever it likes
        why = " ".join((str(error) or type(error).__name__).split())[:200]
        raise InputError("output", f"{shown(str(folder / STATE))} cannot be read ({why}), must be as a sequence left "
                                   "it; give --force to begin anew") from None
    missing = next((n for n in range(state.frame + 1) if not (folder / PICTURE.format(n)).is_file()), None)
    if missing is not None:
        raise InputError("output", f"{shown(str(folder))} lacks {PICTURE.format(missing)}, must have all pictures up "
                                   f"to {PICTURE.format(state.frame)}; give --force to begin anew")
    return state


def _read_state(path: Path, names: frozenset[str]) -> _State:
    """A state as `_packed` wrote it; any of several errors where it is not one."""
    with path.open("rb") as opened, np.load(opened, allow_pickle=False) as file:
        facts = json.loads(str(file["facts"]))
        fields = {name.replace(".", "/"): file[name] for name in file.files if name != "facts"}
    held, number = facts["history"], facts["frame"]
    if names != (set(fields) if held is not None else set()):
        raise ValueError(f"it holds {', '.join(sorted(fields)) or 'nothing'}, not "
                         f"{', '.join(sorted(names)) or 'nothing'}")
    if held is None:
        return _State(_whole(number, 0), None)
    history = History(fields, from_json(Camera, held["camera"]), from_json(Grid, held["grid"]),
                      float(held["exposure"]), _whole(held["length"], 1))
    if not SHORTEST <= history.exposure <= LONGEST:
        raise ValueError(f"an exposure of {history.exposure:g}")
    for name, field in fields.items():
        _check_field(name, field, history)
    return _State(_whole(number, 0), history)


def _check_field(name: str, field: NDArray[Any], history: History) -> None:
    """Refuse a field that its stage cannot have made: of another size than the history says, or of no numbers."""
    if name not in QUANTITIES:
        raise ValueError(f"{name} is no result")
    quantity = QUANTITIES[name]
    rows, columns = raster_size(quantity, history.camera, history.grid)
    sizes = {"c": 3, "z": history.grid.depth, "y": rows, "x": columns}
    axes = quantity.axes if field.ndim == len(quantity.axes) else f"c{quantity.axes}"
    if field.dtype.kind not in "fi" or field.ndim != len(axes) or any(
            n not in (0, 1, sizes.get(axis, n)) for axis, n in zip(axes, field.shape, strict=True)):
        raise ValueError(f"{name} has shape {field.shape} and type {field.dtype}, must be {axes} of "
                         f"{history.grid.depth} slices, {rows} rows and {columns} columns")


def _whole(value: object, least: int) -> int:
    if isinstance(value, bool) or not isinstance(value, int) or value < least:
        raise ValueError(f"{value!r} is no count of frames")
    return value


def write_animation(loaded: Loaded, assets: Assets, path: Path, *, frames: int, rate: float, force: bool = False,
                    progress: Progress | None = None) -> None:
    """Compute a sequence into one animated GIF.

    Parameters
    ----------
    loaded, assets, frames, rate, force, progress
        As for `write_frames`.
    path : Path
        The file; it appears when all is done.

    Raises
    ------
    InputError
        As for `write_frames`.
    """
    with whole_file(path, force=force) as partial:
        made = run_sequence(loaded.scene, frames=frames, settings=loaded.settings, rate=rate, assets=assets,
                            outputs=[final_result(loaded.settings)], progress=progress)
        partial.write_bytes(_gif([display_image(frame) for frame in made], rate))


def write_last(loaded: Loaded, assets: Assets, path: Path, write: Callable[[Path, Frame], None], *, frames: int,
               rate: float, force: bool = False, progress: Progress | None = None) -> None:
    """Compute a sequence and write its last image: what filters over time have made of it.

    Parameters
    ----------
    loaded, assets, frames, rate, force, progress
        As for `write_frames`.
    path : Path
        The file; it appears when all is done.
    write : callable
        As `froxel_ref.image_files.image_writer` gives it.

    Raises
    ------
    InputError
        As for `write_frames`.
    """
    with whole_file(path, force=force) as partial:
        made = run_sequence(loaded.scene, frames=frames, settings=loaded.settings, rate=rate, assets=assets,
                            outputs=[final_result(loaded.settings)], progress=progress)
        write(partial, deque(made, maxlen=1).pop())  # one frame at a time is held


def _gif(images: list[NDArray[np.uint8]], rate: float) -> bytes:
    import imageio.v3 as iio

    return bytes(iio.imwrite("<bytes>", images, extension=".gif", plugin="pillow", duration=max(20.0, 1000.0 / rate),
                             loop=0))
