"""What a report measures: suites, the points that knobs make of a base, checked before the first is run."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import froxel_ref
from froxel_ref import compare
from froxel_ref.assets import checksums
from froxel_ref.budget import Part, parts_of
from froxel_ref.error_images import Subject, averages, make_subject
from froxel_ref.frame import Plan, plan
from froxel_ref.knobs import KNOBS, Knob, changed
from froxel_ref.quantities import final_result
from froxel_ref.records import InputError
from froxel_ref.report_record import LeftOut
from froxel_ref.scene_files import Loaded, document
from froxel_ref.settings import SWITCHES, Settings, replace

__all__ = ["BASE", "EPSILON", "SUITES", "Asked", "Prepared", "Spot", "Suite", "digest", "prepare"]

BASE = "base"

MANY = 20  # lights

# ε of relMSE, on radiance times exposure, which is of order 1 [Rousselle 2011].
EPSILON = compare.RELATIVE_MSE_EPSILON


class Suite(NamedTuple):
    """How much is measured.

    Attributes
    ----------
    pixels : int
        About how many the raster of errors has.
    frames : int
        Of points that average over time.
    rtol : float
        Of the truth.
    repeats : int
        Timed runs of a point.
    slow : float [s]
        Points that take longer are run twice.
    refine : int
        Slices of the budget's truth for each of the frame's.
    levels : tuple of float
        Of the refinement: froxels along each axis, over the base's.
    longest : float
        Froxels of an image of the budget, of all its frames, times what rays cost: a part that takes more is not tried
        alone.
    """

    pixels: int
    frames: int
    rtol: float
    repeats: int
    slow: float
    refine: int
    levels: tuple[float, ...]
    longest: float = 6e7


SUITES: dict[str, Suite] = {
    "quick": Suite(7_000, 16, 1e-3, 3, 2.0, 4, (0.25, 0.5, 1.0, 2.0), 6e7),
    "full": Suite(24_000, 64, 1e-4, 7, 20.0, 8, (0.25, 0.5, 1.0, 2.0, 3.0), 3e9),
}


class Asked(NamedTuple):
    """What a report is asked for.

    Attributes
    ----------
    suite : str
        A key of `SUITES`.
    knobs : tuple of Knob
    limit_ms, limit_error : float or None
        A recommendation's limit: milliseconds a frame, or relMSE.
    threads : int or None
    everything : bool
        Budget, refinement and savings too, not only points.
    """

    suite: str = "quick"
    knobs: tuple[Knob, ...] = KNOBS
    limit_ms: float | None = None
    limit_error: float | None = None
    threads: int | None = None
    everything: bool = True


class Spot(NamedTuple):
    """A point before it is measured."""

    id: str
    knob: str
    label: str
    overrides: tuple[str, ...]
    frames: int
    settings: Settings | None
    fault: str = ""


class Prepared(NamedTuple):
    """All that is to be measured, checked."""

    subject: Subject
    asked: Asked
    suite: Suite
    planned: Plan
    spots: tuple[Spot, ...]
    left_out: tuple[LeftOut, ...]
    parts: tuple[Part, ...]
    parts_left_out: tuple[LeftOut, ...]
    overrides: tuple[str, ...]
    about: str
    source: str

    @property
    def raster(self) -> tuple[int, int]:
        """Width and height of the images that errors are taken of."""
        return self.subject.small.camera.width, self.subject.small.camera.height

    @property
    def header(self) -> dict[str, Any]:
        """What a log of this is called."""
        scene = self.subject.loaded.scene
        return {"package": froxel_ref.__version__, "scene": scene.name, "digest": digest(self.subject.loaded),
                "suite": self.asked.suite, "everything": self.asked.everything,
                "points": [[spot.id, spot.frames] for spot in self.spots]}


def digest(loaded: Loaded) -> str:
    """SHA-256 of a scene and its settings in full, and of the files that it names."""
    files = checksums(loaded.scene, loaded.folder)
    text = json.dumps([document(loaded.scene, loaded.settings), files], sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()


# --- what is to be measured -----------------------------------------------------------------------------


def prepare(loaded: Loaded, asked: Asked, *, overrides: Sequence[str] = (), about: str = "", source: str = "",
            sweep: bool = True) -> Prepared:
    """Check what is asked for and list what is to be measured.

    Parameters
    ----------
    loaded : Loaded
    asked : Asked
    overrides : sequence of str
        What made these settings of the scene's own, for the report to tell.
    about : str
        The scene's sentence.
    source : str
        What it was called; the scene's name unless given.
    sweep : bool
        Refuse a report of the base alone.

    Returns
    -------
    Prepared

    Raises
    ------
    InputError
        A scene that cannot be run or has no truth; knobs of which this scene has a use for none; a limit that is not
        above 0.
    """
    suite = SUITES[asked.suite]
    for name, limit in (("--budget-ms", asked.limit_ms), ("--max-error", asked.limit_error)):
        if limit is not None and not (math.isfinite(limit) and limit > 0.0):
            raise InputError(name, f"is {limit:g}, must be above 0")
    subject = make_subject(loaded, pixels=_pixels(loaded, suite), frames=suite.frames)
    scene, how, _ = subject.now(loaded.settings)
    planned = plan(scene, how, [final_result(how)])
    spots, left_out = _spots(subject, planned, asked)
    if sweep and len(spots) == 1:
        reasons = "; ".join(f"{each.name}: {each.why}" for each in left_out[:3]) or (
            "every value of the quick suite is the base's own, --suite full may have others" if asked.suite == "quick"
            else "every value is the base's own")
        option = "--knobs" if any(knob in KNOBS for knob in asked.knobs) or not asked.knobs else "--sweep"
        raise InputError(option, f"leaves nothing to sweep ({reasons}), must have what this scene has a use for")
    parts, others = parts_of(scene, how, planned, raster=(subject.small.camera.width, subject.small.camera.height),
                             refine=suite.refine)
    return Prepared(subject, asked, suite, planned, spots, left_out, parts, others, tuple(overrides), about,
                    source or loaded.scene.name)


def _pixels(loaded: Loaded, suite: Suite) -> int:
    """Fewer where lights are many, each of which the truth integrates along every ray."""
    return round(suite.pixels * min(1.0, math.sqrt(MANY / max(1, len(loaded.scene.all_lights)))))


def _spots(subject: Subject, planned: Plan, asked: Asked) -> tuple[tuple[Spot, ...], tuple[LeftOut, ...]]:
    """The base and every position of every knob that the scene has a use for, each once."""
    base = subject.settings
    spots = [Spot(BASE, BASE, "as it is", (), _frames(subject, base, None), base)]
    seen, left_out = {(_spelt_out(base), spots[0].frames)}, []
    for knob in asked.knobs:
        needed, why = knob.needed(subject.loaded.scene, base, planned)
        if not needed:
            left_out.append(LeftOut(knob.name, why))
            continue
        for step in knob.steps(base):
            if asked.suite == "quick" and not step.quick:
                continue
            name = f"{knob.name}={step.label}"
            try:
                settings = changed(base, step.overrides)
            except InputError as error:
                # A value of one's own that is not allowed is a mistake; one of ours does not go with this base.
                if knob not in KNOBS:
                    raise
                spots.append(Spot(name, knob.name, step.label, step.overrides, 1, None, f"refused: {error}"))
                continue
            if knob not in KNOBS:
                _check_truth(base, settings, step.overrides)
            frames = _frames(subject, settings, step.frames)
            same = _spelt_out(settings), frames
            if same not in seen:
                seen.add(same)
                spots.append(Spot(name, knob.name, step.label, step.overrides, frames, settings))
    return tuple(spots), tuple(left_out)


def _spelt_out(settings: Settings) -> Settings:
    """The same with every switch set by itself: settings that make the same frame are equal then."""
    return replace(settings, fidelity="corrected", **{name: getattr(settings, name) for name in SWITCHES})


def _check_truth(base: Settings, settings: Settings, overrides: Sequence[str]) -> None:
    """Refuse a sweep of what the truth depends on."""
    changed_ones = [name for name in ("time", "phase_function", "second_lobe")
                    if getattr(base, name) != getattr(settings, name)]
    beyond = not base.long_range.march and settings.grid.far > base.grid.far
    if changed_ones or beyond:
        why = "ends where the base's froxels end" if beyond and not changed_ones else "depends on it"
        raise InputError("--sweep", f"turns {', '.join(overrides)}: errors are taken against one truth, which {why}; "
                                    "must be a setting that the truth does not have")


def _frames(subject: Subject, settings: Settings, frames: int | None) -> int:
    return min(frames or subject.frames, subject.frames) if averages(settings) else 1
