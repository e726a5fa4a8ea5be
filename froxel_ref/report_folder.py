"""A report's folder: what may stand there, beginning, going on, and what is written in the end."""

from __future__ import annotations

import re
import shutil
from contextlib import suppress
from pathlib import Path

from froxel_ref import report_log
from froxel_ref.output import check_folder, read_manifest, refusal
from froxel_ref.records import InputError
from froxel_ref.report import Tell, measure
from froxel_ref.report_entries import sound
from froxel_ref.report_files import BUDGET, FORMAT, JSON, PAGE, PICTURES, POINTS, REFINEMENT, write_report
from froxel_ref.report_pictures import SHEET, error_pictures
from froxel_ref.report_points import Prepared
from froxel_ref.report_record import Report

__all__ = ["check_target", "drop_empty", "measured", "run_report"]

# The log's lock is the last to go: while it stands, the folder is a report's.
FILES = (JSON, POINTS, BUDGET, REFINEMENT, PAGE, SHEET, *PICTURES, report_log.IMAGES, report_log.LOG, report_log.LOCK)
PARTIAL = re.compile(r"\..*\.partial-[0-9a-f]{8}(\.\w+)?")  # of a write that was killed


def check_target(folder: Path, *, force: bool = False, resume: bool = False) -> None:
    """Whether a report may be written there.

    Parameters
    ----------
    folder : Path
    force : bool
        Begin anew over what stands there.
    resume : bool
        Go on with what stands there.

    Raises
    ------
    InputError
        The place is taken, or holds what is no part of a report.
    """
    check_folder(folder, _foreign, force=force or resume, kind="report", short="report",
                 instead="--resume to go on with it, --force to replace it")


def _foreign(folder: Path) -> str | None:
    """Something in the folder that no report put there."""
    names = [entry.name for entry in sorted(folder.iterdir())]
    if not (report_log.LOCK in names or report_log.is_log(folder / report_log.LOG)
            or read_manifest(folder / JSON, FORMAT)):
        return names[0] if names else None
    images = folder / report_log.IMAGES
    strange = [name for name in names if name not in FILES and not PARTIAL.fullmatch(name)]
    if not strange and images.is_dir():
        strange = [f"{images.name}/{entry.name}" for entry in sorted(images.iterdir()) if entry.suffix != ".npy"]
    return strange[0] if strange else None


def run_report(prepared: Prepared, folder: Path | str, *, force: bool = False, resume: bool = False,
               tell: Tell | None = None) -> Report:
    """Measure into a folder and write the report there.

    Parameters
    ----------
    prepared : Prepared
    folder : Path or str
        Made if it is not there.
    force, resume : bool
        As for `check_target`.
    tell : callable, optional
        As for `froxel_ref.report.measure`.

    Returns
    -------
    Report

    Raises
    ------
    InputError
        The place is taken; what stands there is of something else; it cannot be written.

    Notes
    -----
    Every measurement is on disk as soon as it is made: interrupted at any moment, it can be gone on with.
    """
    folder = Path(folder)
    check_target(folder, force=force, resume=resume)
    if resume:
        report_log.read(folder, prepared.header)  # refuses what cannot be gone on with, and makes nothing
    with report_log.locked(folder):
        if resume:
            done = {name: entry for name, entry in report_log.read(folder, prepared.header).items()
                    if sound(name, entry.value)}
            _sweep(folder)
        else:
            _clear(folder)
            report_log.begin(folder, prepared.header)
            done = {}
        report = measure(prepared, folder, done=done, tell=tell)
        write_report(folder, report, shown=error_pictures(report, folder))
    return report


def _clear(folder: Path) -> None:
    """Remove an earlier report, file by file."""
    if not folder.is_dir():
        return
    _sweep(folder)
    try:
        for name in FILES[:-1]:
            path = folder / name
            if path.is_dir() and not path.is_symlink():
                shutil.rmtree(path)
            else:
                path.unlink(missing_ok=True)
    except OSError as error:
        raise refusal(error, "output", folder) from None


def _sweep(folder: Path) -> None:
    """Remove what writes that were killed have left behind."""
    for place in (folder, folder / report_log.IMAGES):
        for path in place.iterdir() if place.is_dir() else ():
            if PARTIAL.fullmatch(path.name) and path.is_file():
                with suppress(OSError):
                    path.unlink()


def measured(folder: Path) -> int:
    """How many measurements stand in a folder."""
    try:
        with (folder / report_log.LOG).open("rb") as file:
            return max(0, sum(1 for _ in file) - 1)
    except OSError:
        return 0


def drop_empty(folder: Path) -> None:
    """Remove a folder in which nothing has been measured yet."""
    if folder.is_dir() and measured(folder) == 0 and not any((folder / name).exists() for name in (JSON, PAGE)):
        _clear(folder)
        try:
            (folder / report_log.LOCK).unlink(missing_ok=True)
            folder.rmdir()
        except OSError:
            raise InputError("output", f"{folder} could not be removed") from None
