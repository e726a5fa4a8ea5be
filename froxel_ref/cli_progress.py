"""How far a command is: a bar on a terminal, a plain line now and then elsewhere; always on standard error."""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import TypeAlias

__all__ = ["EVERY", "Progress", "progress"]

Progress: TypeAlias = Callable[[str, int, int], None]

EVERY = 10.0  # from one plain line to the next [s]; what is done sooner says nothing


@contextmanager
def progress(unit: str) -> Iterator[Progress]:
    """A function that tells how far a command is.

    Parameters
    ----------
    unit : str
        What is counted, in the plural: ``rays``.

    Yields
    ------
    callable
        ``tell(what, done, count)``, from any thread, before each step or after it.

    Examples
    --------
    >>> with progress("rays") as tell:
    ...     tell("", 10, 20)
    """
    if sys.stderr is None:
        yield lambda what, done, count: None
    elif sys.stderr.isatty():
        with _bar(unit) as tell:
            yield tell
    else:
        with _beats(unit, _lines(unit, time.monotonic)) as tell:
            yield tell


@contextmanager
def _bar(unit: str) -> Iterator[Progress]:
    from tqdm import tqdm

    layout = "{desc:<32} {bar} {n_fmt}/{total_fmt} {unit}, {remaining} left"
    with tqdm(total=0, file=sys.stderr, leave=False, unit=unit, unit_scale=True, bar_format=layout) as bar:
        def tell(what: str, done: int, count: int) -> None:
            bar.total, bar.n = count, done
            bar.set_description_str(what)

        yield tell


@contextmanager
def _beats(unit: str, told: Progress) -> Iterator[Progress]:
    """The same, and a sign of life each `EVERY` seconds while a single step takes longer than that."""
    done, latest = threading.Event(), [("", 0, 0)]

    def beat() -> None:
        before, since = latest[0], time.monotonic()
        while not done.wait(EVERY):
            now = latest[0]
            if now != before:
                before, since = now, time.monotonic()
            elif now[2]:
                named = f" ({now[0]})" if now[0] else ""
                with suppress(OSError, ValueError):
                    print(f"froxel-ref: at {now[1] + 1} of {now[2]} {unit}{named} for more than "
                          f"{_span(time.monotonic() - since)}", file=sys.stderr, flush=True)

    def tell(what: str, number: int, count: int) -> None:
        latest[0] = (what, number, count)
        told(what, number, count)

    watch = threading.Thread(target=beat, daemon=True)
    watch.start()
    try:
        yield tell
    finally:
        done.set()
        watch.join()


def _lines(unit: str, clock: Callable[[], float]) -> Progress:
    """Plain lines, at most one each `EVERY` seconds."""
    lock = threading.Lock()
    begun, told, total = clock(), clock(), -1

    def tell(what: str, done: int, count: int) -> None:
        nonlocal begun, told, total
        with lock:
            now = clock()
            if count != total:  # another part of the work, with a pace of its own
                begun, total = now, count
            if now - told < EVERY or done <= 0:
                return
            told, left = now, (now - begun) * (count - done) / done
            named = f" ({what})" if what else ""
            # Stages are too unlike to tell what the rest will take.
            ahead = "" if unit == "stages" else f", about {_span(left)} left"
            with suppress(OSError, ValueError):  # a reader that went away does not stop the work
                print(f"froxel-ref: {done} of {count} {unit}{named}{ahead}", file=sys.stderr, flush=True)

    return tell


def _span(seconds: float) -> str:
    """A time in words, to be read at a glance.

    >>> _span(8.2), _span(75.0), _span(5000.0)
    ('8 s', '1 min 15 s', '1 h 23 min')
    """
    whole = round(seconds)
    if whole < 60:
        return f"{whole} s"
    return f"{whole // 60} min {whole % 60} s" if whole < 3600 else f"{whole // 3600} h {whole % 3600 // 60} min"
