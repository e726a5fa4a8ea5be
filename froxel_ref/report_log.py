"""What a report has measured so far, on disk: interrupted at any moment, it can be gone on with.

A folder holds ``measurements.jsonl``, whose first line says of what and each further one is one measurement by its
name, and ``images/`` with an array for each image that was computed. A line that was cut off counts as not there.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from tokenize import TokenError
from typing import Any, NamedTuple
from zipfile import BadZipFile

import numpy as np
from numpy.typing import NDArray

from froxel_ref.output import refusal, whole_file
from froxel_ref.records import InputError, shown

__all__ = [
    "FORMAT", "IMAGES", "LOCK", "LOG", "Entry", "append", "begin", "image_path", "is_log", "load_image", "locked",
    "read", "store_image",
]

LOG, IMAGES, LOCK = "measurements.jsonl", "images", "measurements.lock"
FORMAT, VERSION = "froxel-ref measurements", 1

# What must be the same to go on, and what a header that differs is called.
SAME = {"package": "another version", "scene": "another scene", "digest": "another scene or other settings or files",
        "suite": "another suite", "points": "other knobs or sweeps"}


class Entry(NamedTuple):
    """A measurement: its value, plain as JSON has it, and the seconds that it took."""

    value: Any
    took: float


def begin(folder: Path, header: Mapping[str, Any]) -> None:
    """Begin a log in a folder, which is made if it is not there.

    Parameters
    ----------
    folder : Path
    header : mapping
        What is measured, as plain values.

    Raises
    ------
    InputError
        It cannot be written.
    """
    try:
        (folder / IMAGES).mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise refusal(error, "output", folder) from None
    with whole_file(folder / LOG, force=True) as partial:
        partial.write_text(json.dumps({"format": FORMAT, "version": VERSION, **header}) + "\n", "utf-8")


@contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Be the only one that writes into a folder, which is made if it is not there.

    Parameters
    ----------
    folder : Path

    Yields
    ------
    None
        While it lasts; a process that ends, however it does, lets go.

    Raises
    ------
    InputError
        Another process writes there, or it cannot be written.
    """
    try:
        folder.mkdir(exist_ok=True)
        file = (folder / LOCK).open("a")
    except OSError as error:
        raise refusal(error, "output", folder) from None
    with file:
        try:
            import fcntl
        except ImportError:  # a system without such locks: nobody is kept out
            yield
            return
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            raise InputError("output", f"{shown(str(folder))} is being written by another report, must be left to it") \
                from None
        yield


def read(folder: Path, header: Mapping[str, Any]) -> dict[str, Entry]:
    """What was measured before.

    Parameters
    ----------
    folder : Path
    header : mapping
        What is to be measured now.

    Returns
    -------
    dict of str to Entry
        By the name of the measurement.

    Raises
    ------
    InputError
        There is no log, or one of another scene, version, suite or choice of knobs.
    """
    place = shown(str(folder))
    try:
        lines = (folder / LOG).read_bytes().decode("utf-8", "replace").splitlines()
    except FileNotFoundError:
        why = "holds no measurements" if folder.is_dir() else "does not exist: there are no measurements"
        raise InputError("--resume", f"{place} {why} to go on with") from None
    except OSError as error:
        raise refusal(error, "--resume", folder) from None
    documents = [found for line in lines if (found := _parsed(line)) is not None]
    if not documents or documents[0].get("format") != FORMAT or documents[0].get("version") != VERSION:
        raise InputError("--resume", f"{place} holds no measurements of this format to go on with")
    old = documents[0]
    for key, word in SAME.items():
        if old.get(key) != header.get(key):
            told = f" ({shown(old.get(key))}, not {shown(header.get(key))})" if key not in ("digest", "points") else ""
            raise InputError("--resume", f"{place} is of {word}{told}, must be of the same: choose another "
                                         "folder, or --force to begin anew")
    return {str(each["name"]): Entry(each["value"], each["took"]) for each in documents[1:]
            if {"name", "value", "took"} <= each.keys() and isinstance(each["took"], float)}


def is_log(path: Path) -> bool:
    """Whether a file begins as a log does."""
    try:
        with path.open("rb") as file:
            found = _parsed(file.readline(1_000_000).decode("utf-8", "replace"))
    except OSError:
        return False
    return found is not None and found.get("format") == FORMAT


def _parsed(line: str) -> dict[str, Any] | None:
    try:
        found = json.loads(line)
    except (ValueError, RecursionError):
        return None
    return found if isinstance(found, dict) else None


def append(folder: Path, name: str, entry: Entry) -> None:
    """Add one measurement.

    Parameters
    ----------
    folder : Path
    name : str
    entry : Entry
        NaN and infinity are written as JavaScript has them.

    Raises
    ------
    InputError
        It cannot be written.
    """
    try:
        with (folder / LOG).open("a", encoding="utf-8") as file:
            # After a line that was cut off, a new one begins.
            line = json.dumps({"name": name, "value": entry.value, "took": float(entry.took)})
            file.write(("" if _ends_well(folder / LOG) else "\n") + line + "\n")
    except OSError as error:
        raise refusal(error, "output", folder) from None


def _ends_well(path: Path) -> bool:
    with path.open("rb") as file:
        size = file.seek(0, 2)
        if not size:
            return True
        file.seek(size - 1)
        return file.read(1) == b"\n"


def image_path(folder: Path, name: str) -> Path:
    """Where the image of a measurement lies: names hold what files' names may not."""
    safe = "".join(letter if letter.isalnum() and letter.isascii() else "-" for letter in name)[:60].strip("-")
    return folder / IMAGES / f"{safe}-{hashlib.sha256(name.encode()).hexdigest()[:8]}.npy"


def store_image(folder: Path, name: str, image: NDArray[Any]) -> None:
    """Keep the image of a measurement, before the measurement is told.

    Raises
    ------
    InputError
        It cannot be written.
    """
    with suppress(OSError):  # what stands in the way is told below
        (folder / IMAGES).mkdir(exist_ok=True)
    with whole_file(image_path(folder, name), force=True) as partial:
        np.save(partial, image, allow_pickle=False)


def load_image(folder: Path, name: str, shape: tuple[int, ...]) -> NDArray[np.float64] | None:
    """The image of a measurement as it was kept; None if it is not there, or is no such image."""
    try:
        with image_path(folder, name).open("rb") as file:
            image = np.load(file, allow_pickle=False)
    except (OSError, ValueError, EOFError, MemoryError, BadZipFile, TokenError):  # what damage makes NumPy raise
        return None
    return image if isinstance(image, np.ndarray) and image.dtype == np.float64 and image.shape == shape else None
