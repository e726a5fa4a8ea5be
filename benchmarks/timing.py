"""Timing that a shared machine cannot easily fool: warm, interleaved, least and median of several."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Mapping
from typing import NamedTuple


class Timing(NamedTuple):
    """Seconds of one contender."""

    least: float
    median: float


def interleaved(contenders: Mapping[str, Callable[[], object]], *, repeats: int = 7) -> dict[str, Timing]:
    """Run each contender once to warm up, then all of them in turn, ``repeats`` times."""
    for run in contenders.values():
        run()
    seconds: dict[str, list[float]] = {name: [] for name in contenders}
    for _ in range(repeats):
        for name, run in contenders.items():
            begin = time.perf_counter()
            run()
            seconds[name].append(time.perf_counter() - begin)
    return {name: Timing(min(all_), statistics.median(all_)) for name, all_ in seconds.items()}


def table(rows: list[tuple[object, ...]], head: tuple[str, ...]) -> str:
    """A plain table with aligned columns: words to the left, numbers to the right."""
    cells = [head, *[tuple(str(cell) for cell in row) for row in rows]]
    widths = [max(len(row[i]) for row in cells) for i in range(len(head))]
    lines = ["  ".join(c.ljust(w) if i == 0 else c.rjust(w) for i, (c, w) in enumerate(zip(row, widths, strict=True)))
             for row in cells]
    return "\n".join([lines[0], "-" * len(lines[0]), *lines[1:]])
