"""Time and memory of frames: warm, without reading or writing files, as a shared machine allows."""

from __future__ import annotations

import dataclasses
import time
import tracemalloc
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from froxel_ref.arrays import Field
from froxel_ref.assets import Assets
from froxel_ref.error_images import Subject, averages
from froxel_ref.frame import Frame, run_frame
from froxel_ref.pareto import spread
from froxel_ref.quantities import final_result
from froxel_ref.report_record import LeftOut, Saved, Spread
from froxel_ref.scene import Scene
from froxel_ref.settings import Settings

__all__ = ["Timed", "frames_of", "left_out_of", "measure_saved", "peak_bytes", "spread_of", "timed"]


class Timed(NamedTuple):
    """One run of a frame.

    Attributes
    ----------
    seconds : float [s]
        From the call to the result.
    stages : dict of str to float [s]
        Those of each stage that ran.
    """

    seconds: float
    stages: dict[str, float]


def frames_of(subject: Subject, settings: Settings, *, threads: int | None = None) -> Callable[[], Frame]:
    """A function that computes one frame after the other, of the scene's own size.

    Parameters
    ----------
    subject : Subject
    settings : Settings
    threads : int, optional

    Returns
    -------
    callable
        Each call is a frame of a camera at rest, with all that it needs made anew: maps are not taken over, for what
        moves lights or surfaces has to make them. Filters go on from the call before.

    Raises
    ------
    InputError
        Settings that this scene cannot be run with, when it is called.
    """
    scene, how, assets = subject.now(settings)
    goes_on, final = averages(settings), final_result(settings)
    number, previous = 0, None

    def run() -> Frame:
        nonlocal number, previous
        frame = run_frame(scene, how, assets=assets, outputs=[final], threads=threads, previous=previous, frame=number)
        previous = dataclasses.replace(frame, kept={}) if goes_on else None
        number += 1
        return frame

    return run


def timed(run: Callable[[], Frame]) -> Timed:
    """One run by the clock.

    Parameters
    ----------
    run : callable
        As `frames_of` gives it, called before at least once.

    Returns
    -------
    Timed
    """
    begun = time.perf_counter()
    frame = run()
    return Timed(time.perf_counter() - begun, dict(frame.timings))


def peak_bytes(run: Callable[[], object]) -> int:
    """The most memory that arrays take at one moment while something runs.

    Parameters
    ----------
    run : callable

    Returns
    -------
    int [bytes]
        Of what Python and NumPy ask for from the call on. What was there before does not count.

    Examples
    --------
    >>> 8e6 <= peak_bytes(lambda: np.ones(1000000)) < 8.1e6
    True
    """
    tracing = tracemalloc.is_tracing()
    if not tracing:
        tracemalloc.start()
    before = tracemalloc.get_traced_memory()[0]
    tracemalloc.reset_peak()
    try:
        run()
        return max(0, tracemalloc.get_traced_memory()[1] - before)
    finally:
        if not tracing:
            tracemalloc.stop()


# --- what leaving out saves -----------------------------------------------------------------------------


def left_out_of(frame: Frame) -> tuple[LeftOut, ...]:
    """Stages, and parts of stages that run, which a frame's plan left out."""
    found = []
    for planned in frame.plan.stages:
        if not planned.runs:
            found.append(LeftOut(planned.name, planned.why))
        found += [LeftOut(f"{planned.name}: {part.name}", part.why) for part in planned.parts if not part.runs]
    return tuple(found)


def measure_saved(scene: Scene, settings: Settings, assets: Assets, *, repeats: int = 3, threads: int | None = None,
                  tell: Callable[[int, int], None] | None = None) -> Saved:
    """What leaving out saves: a frame with all results as planned, against everything forced on.

    Parameters
    ----------
    scene : Scene
        Without tracks.
    settings : Settings
    assets : Assets
    repeats : int
        Runs of each, in turn, after one to warm up.
    threads : int, optional
    tell : callable, optional
        Called as ``tell(runs done, runs)``.

    Returns
    -------
    Saved

    Examples
    --------
    >>> from froxel_ref.assets import load_assets
    >>> from froxel_ref.settings import Grid
    >>> saved = measure_saved(Scene(), Settings(grid=Grid(width=4, height=2, depth=2)), load_assets(Scene(), None))
    >>> saved.same, saved.left_out[0]
    (True, LeftOut(name='shadow', why='the scene has nothing that casts a shadow'))
    """
    frames: dict[bool, Frame] = {}
    seconds: dict[bool, list[float]] = {False: [], True: []}

    def run(force_all: bool) -> None:
        begun = time.perf_counter()
        frames[force_all] = run_frame(scene, settings, assets=assets, threads=threads, force_all=force_all)
        seconds[force_all].append(time.perf_counter() - begun)

    peaks = {forced: peak_bytes(lambda forced=forced: run(forced)) for forced in (False, True)}  # type: ignore[misc]
    seconds = {False: [], True: []}
    for number in range(repeats):
        for forced in (False, True):
            if tell is not None:
                tell(2 * number + forced, 2 * repeats)
            run(forced)
    planned, forced_frame = frames[False], frames[True]
    same = all(_equal(planned[name], forced_frame[name]) for name in planned.results)
    return Saved(left_out_of(planned), spread_of(seconds[False]), spread_of(seconds[True]), peaks[False], peaks[True],
                 same)


def _equal(a: Field, b: Field) -> bool:
    """Bit for bit where both have values, whatever their axes of length 1; what is not made has none."""
    if not (a.size and b.size):
        return True
    one, other = np.broadcast_arrays(a, b)
    return bool(np.array_equal(one, other, equal_nan=True))


def spread_of(seconds: Sequence[float]) -> Spread:
    """Times of several runs as a report has them."""
    found = spread(seconds)
    return Spread(found.least, found.median, len(found.seconds))
