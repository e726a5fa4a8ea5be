"""Outputs that are whole or not there: written beside their place under another name, then renamed.

Whatever stops a write (an error, a full disk, an interruption) removes what was begun; only a killed
process or a lost power supply can leave a ``….partial-…`` behind, which nothing takes for an output.
"""

from __future__ import annotations

import json
import os
import secrets
import shutil
import signal
import stat
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from froxel_ref.records import InputError, shown

_SIGNALS = ("SIGINT", "SIGTERM", "SIGHUP")

__all__ = [
    "MOST_MANIFEST_BYTES", "check_file", "check_folder", "check_space", "output_path", "read_manifest", "refusal",
    "whole_file", "whole_folder",
]

MOST_MANIFEST_BYTES = 64_000_000


def output_path(given: str | None, default: str) -> Path:
    """Where a command writes: what was given, or its default.

    Parameters
    ----------
    given : str or None
        As typed.
    default : str
        If nothing was.

    Returns
    -------
    Path

    Raises
    ------
    InputError
        An empty name, which a variable that is not set leaves behind.

    Examples
    --------
    >>> output_path(None, "golden-lights").name
    'golden-lights'
    """
    if given is not None and not given.strip():
        raise InputError("output", f"is {shown(given)}, must be a name to write to")
    return Path(default if given is None else given)


def read_manifest(path: Path, kind: str) -> dict[str, Any] | None:
    """A file that says what a folder of results holds.

    Parameters
    ----------
    path : Path
        A JSON file.
    kind : str
        What its ``format`` must be.

    Returns
    -------
    dict or None
        None if it is not there, cannot be read, or is of another format.

    Examples
    --------
    >>> read_manifest(Path("not there.json"), "froxel-ref golden set") is None
    True
    """
    try:
        if not stat.S_ISREG(path.lstat().st_mode):  # opening a pipe would wait for ever
            return None
        with path.open("rb") as file:
            content = json.loads(file.read(MOST_MANIFEST_BYTES).decode("utf-8"))
        return content if content["format"] == kind else None
    except (OSError, ValueError, TypeError, KeyError, RecursionError):
        return None


def refusal(error: OSError | MemoryError, place: str, path: str | os.PathLike[str]) -> InputError:
    """The one-line fault for an operating-system error about an output.

    Parameters
    ----------
    error : OSError or MemoryError
        What happened.
    place : str
        What the message begins with, such as ``output``.
    path : path
        What could not be written.

    Returns
    -------
    InputError
        To be raised.

    Examples
    --------
    >>> import errno
    >>> print(refusal(OSError(errno.ENOSPC, "No space left on device"), "output", "set"))
    output: 'set' cannot be written: No space left on device
    """
    why = "out of memory"
    if isinstance(error, OSError):
        why = error.strerror or str(error) or type(error).__name__
    return InputError(place, f"{shown(os.fspath(path))} cannot be written: {why}")


def _partial(target: Path) -> Path:
    # Same ending, since some writers choose the format by it. Cut, since a name that just fits in what
    # file systems take (255 bytes) has no room for more: 40 and 8 characters are 192 bytes at most.
    ending = target.suffix if len(target.suffix) <= 8 else ""
    return target.with_name(f".{target.stem[:40]}.partial-{secrets.token_hex(4)}{ending}")


def _resolved(path: Path, place: str) -> Path:
    """The path with links followed, so that a link to an output stays; its folder must exist."""
    try:
        target = path.resolve()
        if not target.name:
            raise InputError(place, f"{shown(str(path))} is not a name to write to")
        if not target.parent.is_dir():
            missing = "is not a folder" if target.parent.exists() else "does not exist"
            raise InputError(place, f"{shown(str(path))} cannot be written: its folder {missing}")
        with suppress(FileNotFoundError):
            target.stat()  # a name that is too long is refused now, not when all is done
    except InputError:
        raise
    except (ValueError, RuntimeError) as error:  # a NUL in the path; a loop of links
        raise InputError(place, f"{shown(str(path))} cannot be written: {error}") from None
    except OSError as error:
        raise refusal(error, place, path) from None
    return target


def check_folder(folder: Path, foreign: Callable[[Path], str | None], *, force: bool, kind: str,
                 short: str, instead: str = "--force to replace it") -> None:
    """Whether a folder of results may be written there: nowhere but on an earlier one, and only if told to.

    Parameters
    ----------
    folder : path
        Where it is to stand.
    foreign : callable
        Names something in an existing folder that is no part of such results; None if there is nothing.
    force : bool
        Whether what stands there may be replaced.
    kind, short : str
        What such a folder is called, in full and again.
    instead : str
        What may be given where one stands already.

    Raises
    ------
    InputError
        It exists and ``force`` is not set, it is a file, it holds anything foreign, or the folder around it
        is not there.

    Examples
    --------
    >>> check_folder(Path("a folder that is not there"), lambda folder: None, force=False, kind="set", short="set")
    """
    name = shown(str(folder))
    _resolved(folder, "output")
    try:
        if not folder.exists():
            return
        if not folder.is_dir():
            raise InputError("output", f"{name} is a file, must be a folder")
        if not force:
            raise InputError("output", f"{name} exists; give {instead}")
        found = foreign(folder)
    except OSError as error:
        raise refusal(error, "output", folder) from None
    if found:
        raise InputError("output", f"{name} holds {shown(found)}, which is not part of a {kind}, "
                                   f"must be empty or a {short} to be replaced")


def check_file(path: Path, *, force: bool, place: str = "output") -> Path:
    """Where a file will really be written.

    Parameters
    ----------
    path : Path
        The file to make.
    force : bool
        Whether a file that stands there may be replaced.
    place : str
        What messages begin with.

    Returns
    -------
    Path
        Absolute, links followed.

    Raises
    ------
    InputError
        It exists and ``force`` is not set, is a folder, or its folder does not exist.

    Examples
    --------
    >>> check_file(Path("."), force=True)
    Traceback (most recent call last):
    froxel_ref.records.InputError: output: '.' is a folder, must be a file
    """
    target = _resolved(path, place)
    if target.is_dir():
        raise InputError(place, f"{shown(str(path))} is a folder, must be a file")
    if target.exists() and not target.is_file():
        raise InputError(place, f"{shown(str(path))} is not a regular file")
    if target.exists() and not force:
        raise InputError(place, f"{shown(str(path))} exists; give --force to replace it")
    return target


def check_space(folder: Path, needed: int, *, target: Path | None = None, place: str = "output") -> None:
    """Refuse what the disk cannot hold.

    Parameters
    ----------
    folder : Path
        Where it is to be written.
    needed : int
        How much that is [bytes].
    target : Path, optional
        What the message calls it; default: the folder.
    place : str
        What messages begin with.

    Raises
    ------
    InputError
        The file system of ``folder`` has fewer than ``needed`` bytes free.

    Examples
    --------
    >>> check_space(Path("."), 0)
    """
    name = folder if target is None else target
    try:
        free = shutil.disk_usage(folder).free
    except OSError as error:
        raise refusal(error, place, name) from None
    if needed > free:
        room = f"its disk has {free // 10**6:,} MB free"
        raise InputError(place, f"{shown(str(name))} needs about {-(-needed // 10**6):,} MB, {room}")


@contextmanager
def whole_file(path: Path, *, force: bool = False, place: str = "output") -> Iterator[Path]:
    """A temporary name to write a file under; it takes its place when the block ends well.

    Parameters
    ----------
    path : Path
        The file to make.
    force : bool
        Whether a file that stands there may be replaced.
    place : str
        What messages begin with.

    Yields
    ------
    Path
        A name in the same folder with the same ending, at which nothing stands yet.

    Raises
    ------
    InputError
        As `check_file`, and for any operating-system error while writing.

    Notes
    -----
    The new file replaces the old one in one step, so that a reader finds one of them, whole.

    Examples
    --------
    >>> import tempfile
    >>> path = Path(tempfile.mkdtemp(), "answer.txt")
    >>> with whole_file(path) as partial:
    ...     _ = partial.write_text("42")
    ...     print(path.exists())
    False
    >>> path.read_text()
    '42'
    """
    target = check_file(path, force=force, place=place)
    partial = _partial(target)
    try:
        yield partial
        if not force and target.exists():
            raise InputError(place, f"{shown(str(path))} exists; give --force to replace it")
        os.replace(partial, target)
    except (OSError, MemoryError) as error:
        raise refusal(error, place, path) from None
    finally:
        with _undisturbed():
            _remove(partial)


@contextmanager
def whole_folder(path: Path, check: Callable[[Path], None], *, place: str = "output") -> Iterator[Path]:
    """A temporary folder to write into; it takes its place when the block ends well.

    Parameters
    ----------
    path : Path
        The folder to make.
    check : callable
        Called with the folder (links followed) before the first and before the last step; raises where
        what stands there must not be replaced.
    place : str
        What messages begin with.

    Yields
    ------
    Path
        An empty folder beside it.

    Raises
    ------
    InputError
        As ``check``, and for any operating-system error while writing.

    Notes
    -----
    What stood there is put aside under another name and removed only when the new folder has its place.

    Examples
    --------
    >>> import tempfile
    >>> path = Path(tempfile.mkdtemp(), "set")
    >>> with whole_folder(path, lambda target: None) as partial:
    ...     _ = (partial / "a.txt").write_text("a")
    >>> [file.name for file in path.iterdir()]
    ['a.txt']
    """
    target = _resolved(path, place)
    check(target)
    partial = _partial(target)
    try:
        partial.mkdir()
        yield partial
        check(target)
        with _undisturbed():
            _take_place(partial, target)
    except (OSError, MemoryError) as error:
        raise refusal(error, place, path) from None
    finally:
        with _undisturbed():
            _remove(partial)


@contextmanager
def _undisturbed() -> Iterator[None]:
    """Hold back Ctrl-C and its like while files are put in order; the first one comes after."""
    held: list[int] = []

    def hold(number: int, frame: Any) -> None:
        held.append(number)

    before: dict[int, Any] = {}
    try:
        if threading.current_thread() is threading.main_thread():
            for number in (getattr(signal, name) for name in _SIGNALS if hasattr(signal, name)):
                if callable(signal.getsignal(number)):  # what is ignored, or kills, stays as it is
                    before[number] = signal.signal(number, hold)
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
        if held:
            signal.raise_signal(held[0])


def _take_place(partial: Path, target: Path) -> None:
    """Rename, and put aside what was there until the new one stands."""
    if not target.exists():
        partial.rename(target)
        return
    old = _partial(target)
    target.rename(old)
    try:
        partial.rename(target)
    except BaseException:
        old.rename(target)
        raise
    _remove(old)


def _remove(path: Path) -> None:
    """Remove a file or folder of ours, if it is there; a second failure must not hide the first."""
    with suppress(OSError):
        if path.is_dir():
            shutil.rmtree(path)
        elif path.exists():
            path.unlink()
