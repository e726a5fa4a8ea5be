"""Work in blocks that fit the cache, on a thread per core.

NumPy's ufuncs release the interpreter lock and cost least when their operands stay in the L2 cache, so
the stages cut their volumes into blocks of slices and rows, and hand the blocks to threads. Blocks never
share an output element: the result is the same to the last bit whatever their size and number.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

__all__ = ["available_threads", "blocks", "run"]

T = TypeVar("T")

# Elements of one operand in a block. Ten float64 operands of this size are 1.3 MB, about what a core's
# L2 cache holds on current machines; smaller blocks pay more for ufunc dispatch (about 0.5 µs each).
BLOCK = 16384


def available_threads() -> int:
    """How many cores this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def blocks(count: int, rows: int, columns: int, *, size: int = BLOCK) -> list[tuple[slice, slice]]:
    """Cut a volume of ``count`` slices of ``rows`` × ``columns`` into blocks of about ``size`` elements.

    Parameters
    ----------
    count, rows, columns : int
        Extents along z, y and x.
    size : int
        Wanted elements in a block; a block is never less than one row.

    Returns
    -------
    list of (slice, slice)
        Ranges along z and y that cover the volume once, in order.

    Examples
    --------
    >>> blocks(2, 4, 10, size=20)[:2]
    [(slice(0, 1, None), slice(0, 2, None)), (slice(0, 1, None), slice(2, 4, None))]
    >>> blocks(4, 2, 5, size=20)
    [(slice(0, 2, None), slice(0, 2, None)), (slice(2, 4, None), slice(0, 2, None))]
    """
    if columns * rows <= size:
        deep, tall = max(1, size // max(1, columns * rows)), max(1, rows)
    else:
        deep, tall = 1, max(1, size // max(1, columns))
    deep, tall = _even(count, deep), _even(rows, tall)
    return [
        (slice(z, min(z + deep, count)), slice(y, min(y + tall, rows)))
        for z in range(0, count, deep)
        for y in range(0, rows, tall)
    ]


def _even(extent: int, step: int) -> int:
    """The step that cuts an extent into as many parts, all about alike, so that threads end together."""
    parts = -(-extent // step)
    return -(-extent // parts) if parts else 1


def run(task: Callable[[T], None], items: Iterable[T], *, threads: int | None = None) -> None:
    """Call ``task`` on each item, on as many threads as there are cores unless told otherwise.

    Parameters
    ----------
    task : callable
        Writes its result into arrays of its own; must not touch what another item writes.
    items : iterable
        What to call it with.
    threads : int, optional
        Default: `available_threads`. With 1 no thread is started.

    Raises
    ------
    Exception
        The first one that a task raised.
    """
    todo = list(items)
    workers = min(available_threads() if threads is None else threads, len(todo))
    if workers <= 1:
        for item in todo:
            task(item)
        return
    with ThreadPoolExecutor(workers) as pool:
        for _ in pool.map(task, todo):
            pass
