"""What a report of error against run time holds: plain records, as its JSON has them.

`froxel_ref.report` measures and fills them in; tables, plots and the page are made of nothing else.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import NamedTuple

__all__ = [
    "AtError", "AtTime", "Budget", "BudgetPart", "Claim", "Errors", "LeftOut", "Level", "Point", "Recommendation",
    "Reference", "Refinement", "Report", "Saved", "Setup", "Spread",
]


NOISY = 1.15
"""The ratio of median to least from which on times are told to be noisy."""

STEADY = 0.25
"""The order below which errors of levels do not fall steadily."""


class Spread(NamedTuple):
    """Seconds of several runs of the same work.

    Attributes
    ----------
    least, median : float [s]
        The best estimate on a shared machine, and what noise adds.
    runs : int
    high : float [s]
        The end of the error bar that begins at the least, where other points' times spread more than this one's; 0
        where that is the median.
    """

    least: float
    median: float
    runs: int
    high: float = 0.0

    @property
    def end(self) -> float:
        """The end of the error bar."""
        return self.high if self.high > self.median else self.median


class Errors(NamedTuple):
    """How far an image is from the reference. All but FLIP are of radiance times the camera's exposure.

    Attributes
    ----------
    relmse : float [1]
        Mean of (a − b)²/(b² + ε).
    bias : float [1]
        Mean of a − b, over the mean of b.
    quantile : float [1]
        The 99.9th percentile of |a − b|, over the mean of b.
    maximum : float [1]
        The largest |a − b|, over the mean of b.
    flip : float or None [1]
        Mean HDR-FLIP; None where it was not taken.
    fault : str
        Why there are no errors, in words: all are NaN then.
    absolute : float [1]
        Mean of |a − b|, over the mean of b. A few pixels that are far off count by how far they are, not by its square.
    worst : float [1]
        The share of relMSE that a single pixel has: where it is large, relMSE says little of the others.
    """

    relmse: float
    bias: float
    quantile: float
    maximum: float
    flip: float | None = None
    fault: str = ""
    absolute: float = math.nan
    worst: float = math.nan


class Point(NamedTuple):
    """One choice of settings, measured.

    Attributes
    ----------
    id : str
        Such as ``slices=32``; unlike that of any other point.
    knob : str
        What was turned: ``slices``; ``base`` for the settings that all others start from.
    label : str
        What it was turned to.
    overrides : tuple of str
        What to give to ``--set``, beyond the base's, to get there.
    frames : int
        Number of frames, one after the other, whose last image was measured.
    errors : Errors
    seconds : Spread or None
        Of a whole frame, warm, all stages; None where it could not be run.
    stages : mapping of str to float [s]
        Seconds of each stage in the run that was least.
    peak_bytes : int or None
        The most memory that arrays took at one moment.
    member : str
        Of the Pareto front of relMSE and time: "certain", "possible", "dominated" or "failed".
    fault : str
        Why it failed, in words; empty if it did not.
    """

    id: str
    knob: str
    label: str
    overrides: tuple[str, ...]
    frames: int
    errors: Errors
    seconds: Spread | None
    stages: Mapping[str, float]
    peak_bytes: int | None
    member: str
    fault: str = ""


class LeftOut(NamedTuple):
    """Something that this scene does not need (a knob, a stage, a part of one), and why."""

    name: str
    why: str


class Setup(NamedTuple):
    """What was measured, where and how.

    Attributes
    ----------
    scene, about : str
        The scene's name and its sentence.
    scene_digest : str
        SHA-256 of the scene and settings in full.
    overrides : tuple of str
        What the command line changed of the scene's file.
    suite : str
        "quick" or "full".
    grid : tuple of int
        Froxels of the base: across, down, in depth.
    size : tuple of int
        Width and height of the frames that are timed.
    raster : tuple of int
        Width and height of the images that errors are taken of: the same view.
    repeats, frames : int
        Timed runs of a point, at most; frames of points that average over time.
    epsilon : float
        Of relMSE.
    exposure : float
        The camera's, by which radiance is multiplied before errors are taken.
    pixels_per_degree : float
        For FLIP, on the raster.
    flip : str
        Empty if FLIP was taken, else why not.
    machine : mapping of str to str
        Processor, cores, system; versions of this package, Python, NumPy and others.
    begun : str
        Date and time, ISO 8601, UTC.
    took : float [s]
        Wall-clock time of the measurements.
    noise : float [1]
        The ratio of median to least that nine of ten points stay below: no error bar is shorter.
    source : str
        What the scene was called on the command line: its name, or its file.
    """

    scene: str
    about: str
    scene_digest: str
    overrides: tuple[str, ...]
    suite: str
    grid: tuple[int, int, int]
    size: tuple[int, int]
    raster: tuple[int, int]
    repeats: int
    frames: int
    epsilon: float
    exposure: float
    pixels_per_degree: float
    flip: str
    machine: Mapping[str, str]
    begun: str
    took: float
    noise: float = 1.0
    source: str = ""


class Reference(NamedTuple):
    """What errors are taken against.

    Attributes
    ----------
    about : str
        A sentence: the converged truth, to which tolerance, with which shadows.
    rtol : float
    floor : float [1]
        relMSE of the estimate of its own error: a point below it cannot be told from the truth.
    unconverged : int
        Pixels that did not reach the tolerance.
    pixels : int
    seconds : float [s]
        That it took.
    mean : float [1]
        Of radiance times exposure: relMSE's ε supposes it to be of order 1.
    """

    about: str
    rtol: float
    floor: float
    unconverged: int
    pixels: int
    seconds: float
    mean: float = 1.0


class BudgetPart(NamedTuple):
    """What one approximation of the frame adds to its error.

    With e the error image of the frame, a what this approximation adds to a frame with none (all others replaced by
    their truth), m what it adds to a frame with all others, s = ½(a + m), and ⟨u, v⟩ the mean of u·v/(b² + ε), so that
    relMSE = ⟨e, e⟩:

    Attributes
    ----------
    name, about : str
    truth : str
        What it is replaced by, in words.
    alone : float or None [1]
        ⟨a, a⟩: its relMSE with everything else true. None where that would take too long: s is then m.
    without : float [1]
        relMSE of the frame with this part replaced by its truth, all others on.
    share : float [1]
        ⟨s, e⟩/⟨e, e⟩: its share of the total; may be negative, where it undoes what others do.
    bias : float [1]
        Mean of s, over the mean of the reference.
    regions : mapping of str to float [1]
        Its share, by region of the image: they add up to ``share``.
    """

    name: str
    about: str
    truth: str
    alone: float | None
    without: float
    share: float
    bias: float
    regions: Mapping[str, float]


class Claim(NamedTuple):
    """What replacing the largest part by its truth leaves of the error by the budget, and in the frame.

    Attributes
    ----------
    name : str
        Of the part.
    claimed : float [1]
        ⟨e − s, e − s⟩: relMSE that is left by the budget.
    measured : float [1]
        relMSE of the frame with that part true.
    slack : float [1]
        √⟨m − s, m − s⟩, half of what this part does together with others: the roots of the two may differ by so much.
    """

    name: str
    claimed: float
    measured: float
    slack: float


class Budget(NamedTuple):
    """The error of the base's frame, by its causes: Σ share + rest + interaction = 1.

    Attributes
    ----------
    total : float [1]
        relMSE of the frame.
    parts : tuple of BudgetPart
        Largest share first.
    left_out : tuple of LeftOut
        Approximations that this frame does not make.
    rest : float [1]
        Share of what is left when all parts are replaced, which are fine but not infinitely so.
    rest_relmse : float [1]
        Its relMSE.
    interaction : float [1]
        Share of what three and more parts do together; what two do is shared between them.
    interaction_relmse : float [1]
        relMSE of that image.
    claim : Claim or None
        None where there is no part.
    regions : mapping of str to float [1]
        Share of the pixels in each region.
    region_totals : mapping of str to float [1]
        Share of the total in each region; they add up to 1.
    """

    total: float
    parts: tuple[BudgetPart, ...]
    left_out: tuple[LeftOut, ...]
    rest: float
    rest_relmse: float
    interaction: float
    interaction_relmse: float
    claim: Claim | None
    regions: Mapping[str, float]
    region_totals: Mapping[str, float]


class Level(NamedTuple):
    """One refinement: its settings in words, its step over the coarsest one's, its errors."""

    label: str
    step: float
    errors: Errors


class Refinement(NamedTuple):
    """Grid, maps and harmonics refined together.

    Attributes
    ----------
    levels : tuple of Level
        Coarsest first.
    order : float or None
        Slope of the logarithm of √relMSE against that of the step: the order in which the frame tends to the
        reference. None where a level has no error.
    residual : float or None
        Root mean square of ln(error/fit).
    absolute_order, absolute_residual : float or None
        The same of the mean absolute error: where a few pixels on edges of light decide on relMSE, this is the steadier
        one.
    """

    levels: tuple[Level, ...]
    order: float | None
    residual: float | None
    absolute_order: float | None = None
    absolute_residual: float | None = None


class Saved(NamedTuple):
    """What leaving out saves: the frame as planned against everything forced on.

    Attributes
    ----------
    left_out : tuple of LeftOut
        Stages, and parts of stages, that do not run.
    planned, forced : Spread
    planned_bytes, forced_bytes : int
        The most memory that arrays took at one moment.
    same : bool
        Whether all results are the same bit for bit.
    """

    left_out: tuple[LeftOut, ...]
    planned: Spread
    forced: Spread
    planned_bytes: int
    forced_bytes: int
    same: bool


class AtTime(NamedTuple):
    """A row of equal time.

    Attributes
    ----------
    budget : float [s]
    point : str or None
        The most exact point whose whole error bar lies within; None where none does.
    perhaps : str or None
        A more exact one, or the only one, of which at least the beginning of the bar does.
    """

    budget: float
    point: str | None
    perhaps: str | None = None


class AtError(NamedTuple):
    """A row of equal error: the fastest point at most that far from the reference; None where none is."""

    relmse: float
    point: str | None


class Recommendation(NamedTuple):
    """Which settings to take for a limit.

    Attributes
    ----------
    limit : str
        In words: "33 ms a frame", "relMSE at most 0.001".
    met : bool
    point : str
        The point that meets it; else the one that comes closest.
    overrides : tuple of str
        What to give to ``--set``.
    up, down : str or None
        The next points of the front: more exact, faster.
    words : str
        One or two sentences: what it costs, what the next step up would buy.
    """

    limit: str
    met: bool
    point: str
    overrides: tuple[str, ...]
    up: str | None
    down: str | None
    words: str


class Report(NamedTuple):
    """Everything that was measured of one scene."""

    setup: Setup
    reference: Reference
    points: tuple[Point, ...]
    left_out: tuple[LeftOut, ...]
    budget: Budget | None
    refinement: Refinement | None
    saved: Saved | None
    equal_time: tuple[AtTime, ...]
    equal_error: tuple[AtError, ...]
    recommendation: Recommendation | None
