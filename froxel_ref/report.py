"""Error against run time of one scene's frame: which settings buy how much, what errors come of, what is not needed.

A report is made of *measurements*, each with a name and a plain value, so that an interrupted one is gone on with:
the truth, the image of every point and of every part of the error budget, refinements, times in rounds. Images are
of a smaller raster (`froxel_ref.error_images`), times and memory of frames of the scene's own size.
"""

from __future__ import annotations

import datetime
import time
import warnings
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace as with_fields
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from froxel_ref import report_log
from froxel_ref.budget import Part, all_true, only
from froxel_ref.error_images import averages, last_image, no_flip, reference_image, whole_errors
from froxel_ref.flip import scaled_pixels_per_degree
from froxel_ref.frame import Frame
from froxel_ref.measuring import frames_of, measure_saved, peak_bytes, timed
from froxel_ref.records import InputError
from froxel_ref.report_log import Entry
from froxel_ref.report_points import EPSILON, Prepared, Spot
from froxel_ref.report_record import Report
from froxel_ref.report_sums import put_together
from froxel_ref.settings import Settings, replace

__all__ = ["Work", "finer_image", "level_name", "measure", "measurements", "refined"]

Image = NDArray[np.float64]
Tell = Callable[[str, int, int], None]

# What a frame costs beside its froxels, and rays instead of maps, in froxels: for the time that is left.
PIXELS, RAYS, TRUTH = 0.5, 6.0, 200.0

# Pixels along each axis for one of the raster's, of an image whose long range is true.
FINER = 5

# What refinement changes; every other part of the budget is replaced by its truth.
REFINED = ("depth", "lateral", "opaque shadows", "volumetric shadows", "long range")


class Work(NamedTuple):
    """One measurement.

    Attributes
    ----------
    name : str
        In the log.
    label : str
        What it is called while it is made.
    weight : float
        How long it takes beside others.
    run : callable
        Gives its value, plain as JSON has it.
    image : bool
        Whether it keeps an image, without which it has to be made again.
    """

    name: str
    label: str
    weight: float
    run: Callable[[], Any]
    image: bool = False


def measure(prepared: Prepared, folder: Path, *, done: Mapping[str, Entry] | None = None, tell: Tell | None = None
            ) -> Report:
    """Measure what has not been measured, and put the report together.

    Parameters
    ----------
    prepared : Prepared
    folder : Path
        With a log (`report_log.begin`), to which every measurement is added as it is made.
    done : mapping of str to Entry, optional
        What was measured before (`report_log.read`).
    tell : callable, optional
        Called as ``tell(what, hundredths done, 100)``.

    Returns
    -------
    Report

    Raises
    ------
    InputError
        The scene's truth cannot be found, or the folder not be written.
    """
    known = dict(done or {})
    works = list(measurements(prepared, folder))
    shape = (3, *prepared.raster[::-1])
    left = [work for work in works if work.name not in known or (
        work.image and "fault" not in known[work.name].value
        and report_log.load_image(folder, work.name, shape) is None)]
    whole, behind = sum(work.weight for work in left), 0.0
    for work in left:
        if tell is not None:
            tell(work.label, int(100 * behind / whole) if whole else 0, 100)
        begun = time.perf_counter()
        entry = Entry(work.run(), time.perf_counter() - begun)
        known[work.name] = entry
        report_log.append(folder, work.name, entry)
        behind += work.weight
    _add_flip(prepared, folder, known)
    return put_together(prepared, folder, {work.name: known[work.name] for work in works})


def _add_flip(prepared: Prepared, folder: Path, known: dict[str, Entry]) -> None:
    """HDR-FLIP of images that were kept while its package was not there."""
    shape = (3, *prepared.raster[::-1])
    if no_flip(prepared.raster, prepared.subject.loaded.scene.camera.width):
        return
    truth = report_log.load_image(folder, "reference", shape)
    for name, entry in list(known.items()):
        errors = entry.value.get("errors") if isinstance(entry.value, dict) else None
        if truth is None or errors is None or errors["flip"] is not None or errors["fault"]:
            continue
        image = report_log.load_image(folder, name, shape)
        if image is None:
            continue
        known[name] = Entry({**entry.value, "errors": _errors(prepared, image, truth)}, entry.took)
        report_log.append(folder, name, known[name])


# --- the measurements -----------------------------------------------------------------------------------


def measurements(prepared: Prepared, folder: Path) -> Iterator[Work]:
    """Everything that a report measures, in order.

    Parameters
    ----------
    prepared : Prepared
    folder : Path
        Where images are kept.

    Yields
    ------
    Work
    """
    yield from _reference(prepared, folder)
    for spot in prepared.spots:
        yield _image(prepared, folder, f"image {spot.id}", f"error of {spot.id}", spot.settings, spot.frames,
                     spot.fault)
    if prepared.asked.everything:
        yield from _budget_images(prepared, folder)
        yield from _levels(prepared, folder)
        yield _saved(prepared)
    yield from _times(prepared)


def _weight(prepared: Prepared, settings: Settings, frames: int = 1, *, small: bool = False) -> float:
    """About how long a frame takes, in froxels."""
    grid, camera = settings.grid, (prepared.subject.small if small else prepared.subject.loaded.scene).camera
    froxels = float(grid.width * grid.height * grid.depth)
    if settings.shadows == "exact" or settings.volumetric_shadows == "exact":
        froxels *= RAYS
    return frames * (froxels + PIXELS * camera.width * camera.height)


def _reference(prepared: Prepared, folder: Path) -> Iterator[Work]:
    subject, rtol = prepared.subject, prepared.suite.rtol

    def run() -> Any:
        begun = datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds")
        found = reference_image(subject, rtol=rtol, threads=prepared.asked.threads)
        report_log.store_image(folder, "reference", found.radiance)
        floor = float(np.mean((found.error / np.sqrt(found.radiance**2 + EPSILON)) ** 2))
        mean = float(found.radiance.mean())
        return {"begun": begun, "mean": mean, "seconds": found.seconds,
                "unconverged": int((~found.converged).sum()), "floor": floor}

    pixels = prepared.raster[0] * prepared.raster[1]
    yield Work("reference", "the truth", TRUTH * pixels, run, image=True)


def _image(prepared: Prepared, folder: Path, name: str, label: str, settings: Settings | None, frames: int,
           fault: str = "", finer: int = 1) -> Work:
    """An image and its distance from the truth; what cannot be computed is told, and nothing is raised."""
    subject, shape = prepared.subject, (3, *prepared.raster[::-1])

    def run() -> Any:
        if settings is None:
            return {"fault": fault}
        truth = report_log.load_image(folder, "reference", shape)
        assert truth is not None
        try:
            with _quiet():
                image = last_image(subject, settings, frames=frames, finer=finer, threads=prepared.asked.threads)
        except (InputError, MemoryError, ArithmeticError) as error:
            return {"fault": _words(error)}
        report_log.store_image(folder, name, image)
        return {"errors": _errors(prepared, image, truth)}

    weight = 0.0 if settings is None else _weight(prepared, settings, frames, small=True)
    return Work(name, label, weight, run, image=True)


def _errors(prepared: Prepared, image: Image, truth: Image) -> dict[str, Any]:
    """An image's errors as the log has them, with FLIP where it can be taken."""
    full = prepared.subject.loaded.scene.camera.width
    density = None if no_flip(prepared.raster, full) else scaled_pixels_per_degree(prepared.raster[0], full)
    return whole_errors(image, truth, epsilon=EPSILON, pixels_per_degree=density)._asdict()


def _words(error: Exception) -> str:
    return "memory: it does not fit" if isinstance(error, MemoryError) else f"{error}"


@contextmanager
def _quiet() -> Iterator[None]:
    """What overflows shows in the image; a warning for each would say less."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)
        yield


def _budget_images(prepared: Prepared, folder: Path) -> Iterator[Work]:
    """The image without any approximation, and of each part alone and without it."""
    base, parts = prepared.subject.settings, prepared.parts
    if not parts:
        return

    # A long range that is true is not marched at half the image's resolution either, which no setting changes.
    marched = _marched(prepared)

    def work(name: str, settings: Settings) -> Work:
        frames = prepared.subject.frames if averages(settings) else 1
        finer = FINER if marched and settings.long_range != base.long_range else 1
        return _image(prepared, folder, name, name, settings, frames, finer=finer)

    yield work("budget: none", all_true(base, parts))
    for part in parts:
        yield work(f"budget: without {part.name}", part.replaced(base))
        alone = work(f"budget: {part.name} alone", only(base, parts, part))
        if alone.weight <= prepared.suite.longest:  # as for averages over many frames it may not be
            yield alone


# --- refinement -----------------------------------------------------------------------------------------


def refined(settings: Settings, parts: tuple[Part, ...], factor: float) -> Settings:
    """Settings whose grid, maps and harmonics are finer together, with nothing else that is approximate.

    Parameters
    ----------
    settings : Settings
    parts : tuple of Part
        As `froxel_ref.budget.parts_of` gives them.
    factor : float
        Froxels along each axis, texels along each side of a map, harmonics and steps, over those of the settings.

    Returns
    -------
    Settings

    Examples
    --------
    >>> refined(Settings(), (), 0.5).grid.depth
    32
    """
    plain = all_true(settings, [part for part in parts if part.name not in REFINED])
    grid, maps, opacity, far = plain.grid, plain.shadow_maps, plain.opacity_maps, plain.long_range

    def times(count: int, least: int = 1) -> int:
        return min(65536, max(least, round(count * factor)))

    unit = 2 * maps.downsample
    least = -(-max(32, 2 * maps.edge + 10, 3 * maps.edge) // unit) * unit
    sizes: dict[str, Any] = {name: min(16384 // unit * unit, max(least, times(getattr(maps, name)) // unit * unit))
             for name in ("directional_size", "spot_size", "point_size")}
    tiles: dict[str, Any] = {name: _power(getattr(opacity, name) * factor, low, 16384 if name == "atlas" else 4096)
                             for name, low in (("smallest", 8), ("small", 8), ("large", 8), ("atlas", 64),
                                               ("directional_size", 16))}
    return replace(
        plain, grid=with_fields(grid, width=times(grid.width), height=times(grid.height), depth=times(grid.depth)),
        shadow_maps=with_fields(maps, **sizes),
        long_range=with_fields(far, steps=times(far.steps), noise=False),
        opacity_maps=with_fields(opacity, gutter=min(opacity.gutter, tiles["smallest"] // 3),
                                 harmonics=min(32, times(opacity.harmonics + 1, 2) - 1), **tiles))


def _power(size: float, low: int, high: int) -> int:
    """The largest power of two that is not above."""
    found = low
    while found * 2 <= min(size, high):
        found *= 2
    return found


def level_name(settings: Settings, *, shadowed: bool, dimmed: bool) -> str:
    """What a refinement has, in words."""
    grid, maps, opacity = settings.grid, settings.shadow_maps, settings.opacity_maps
    return ", ".join([f"{grid.width}x{grid.height}x{grid.depth}", *[f"maps {maps.point_size}²"] * shadowed,
                      *[f"K={opacity.harmonics} on {opacity.large}²"] * dimmed])


def _marched(prepared: Prepared) -> bool:
    """Whether a finer image makes the long range more exact: it is marched, and the depth is the scene's own."""
    return prepared.planned["long_range"].runs and prepared.subject.small.image_buffers is None


def finer_image(prepared: Prepared, factor: float) -> int:
    """Pixels along each axis for one of the raster's.

    Where the long range is marched, at half the image's resolution, that is refined too; not where the image's depth
    comes from elsewhere.
    """
    return 2 * int(2.0 * factor) + 1 if _marched(prepared) else 1


def _levels(prepared: Prepared, folder: Path) -> Iterator[Work]:
    for factor in prepared.suite.levels:
        settings = refined(prepared.subject.settings, prepared.parts, factor)
        name = level_name(settings, shadowed=prepared.planned["shadow"].runs, dimmed=prepared.planned["fom"].runs)
        finer = finer_image(prepared, factor)
        name += f", image x{finer}" if finer > 1 else ""
        work = _image(prepared, folder, f"level {factor:g}", f"refined: {name}", settings, 1, finer=finer)

        def run(work: Work = work, name: str = name, factor: float = factor) -> Any:
            return {"label": name, "step": 1.0 / factor, **work.run()}

        yield work._replace(run=run)


# --- times ----------------------------------------------------------------------------------------------


def _saved(prepared: Prepared) -> Work:
    subject = prepared.subject

    def run() -> Any:
        saved = measure_saved(*subject.now(subject.settings), threads=prepared.asked.threads,
                              repeats=prepared.suite.repeats)
        return {**saved._asdict(), "left_out": [list(each) for each in saved.left_out]}

    return Work("saved", "what leaving out saves", 3.0 * (prepared.suite.repeats + 1) * _weight(
        prepared, subject.settings), run)


def _times(prepared: Prepared) -> Iterator[Work]:
    """Memory of each point, then its times in rounds, so that no point has all of a noisy minute."""
    running: dict[str, Callable[[], Frame]] = {}
    first: dict[str, float] = {}

    def warm(spot: Spot) -> tuple[Callable[[], Frame] | None, int, str]:
        """A point's frames, after the first of them; the memory that one took."""
        assert spot.settings is not None
        run, peak = frames_of(prepared.subject, spot.settings, threads=prepared.asked.threads), 0
        try:
            with _quiet():
                if averages(spot.settings):
                    run()
                peak = peak_bytes(run)
        except (InputError, MemoryError, ArithmeticError) as error:
            return None, 0, _words(error)
        running[spot.id] = run
        return run, peak, ""

    def memory(spot: Spot) -> Any:
        if spot.settings is None:
            return {"fault": spot.fault}
        _, peak, fault = warm(spot)
        return {"fault": fault} if fault else {"bytes": peak}

    def seconds(spot: Spot, number: int) -> Any:
        if spot.settings is None:
            return {"fault": spot.fault}
        run = running.get(spot.id) or warm(spot)[0]
        if run is None or (number > 1 and first.get(spot.id, 0.0) > prepared.suite.slow):
            return {"fault": "not run"}
        with _quiet():
            found = timed(run)
        first.setdefault(spot.id, found.seconds)
        return {"seconds": found.seconds, "stages": found.stages}

    def weight(spot: Spot, frames: int) -> float:
        return 0.0 if spot.settings is None else _weight(prepared, spot.settings, frames)

    for spot in prepared.spots:
        yield Work(f"memory {spot.id}", f"memory of {spot.id}", weight(spot, 2), partial(memory, spot))
    for number in range(prepared.suite.repeats):
        for spot in prepared.spots:
            yield Work(f"time {number} {spot.id}", f"time of {spot.id}, {number + 1} of {prepared.suite.repeats}",
                       weight(spot, 1), partial(seconds, spot, number))
