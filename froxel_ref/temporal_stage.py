"""The temporal stage bound to a frame: holes of the checkerboard filled, froxels filtered over frames."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from froxel_ref import blocks, checkerboard, ghosting, temporal
from froxel_ref.arrays import Field, Index
from froxel_ref.grid_parts import part_of
from froxel_ref.jobs import History, Job, Part, Results
from froxel_ref.scene import Scene
from froxel_ref.settings import Settings

__all__ = [
    "FIELDS", "HISTORY", "Past", "average_parts", "averages_light", "filled", "filtered_fields", "fog_fields",
    "guesses", "held", "holes_part", "needs_filter", "nothing_filtered", "past_of", "temporal_parts", "weight",
]

FIELDS = ("temporal/in_scattering", "temporal/extinction", "temporal/unphased", "temporal/valid",
          "temporal/guessed")
HISTORY = (*FIELDS[:3], FIELDS[4])
"""What the next frame reads."""


def needs_filter(settings: Settings) -> tuple[bool, str]:
    """Whether there is anything to filter or to fill, and why.

    Parameters
    ----------
    settings : Settings

    Returns
    -------
    needed : bool
    why : str

    Examples
    --------
    >>> from froxel_ref.settings import Temporal
    >>> needs_filter(Settings()), needs_filter(Settings(temporal=Temporal(filter="scattering")))
    ((False, 'no temporal filter and no checkerboard'), (True, 'filter: scattering'))
    """
    found = ["checkerboard"] * settings.checkerboard
    found += [f"filter: {settings.temporal.filter}"] * averages_light(settings)
    return (True, ", ".join(found)) if found else (False, "no temporal filter and no checkerboard")


def averages_light(settings: Settings) -> bool:
    """Whether it is light that is averaged, and not what it falls on (`froxel_ref.material_stage`).

    Parameters
    ----------
    settings : Settings

    Returns
    -------
    bool

    Examples
    --------
    >>> averages_light(Settings())
    False
    """
    return settings.temporal.filter in ("scattering", "unphased")


def temporal_parts(scene: Scene, settings: Settings) -> tuple[Part, ...]:
    """What the stage does within itself.

    Parameters
    ----------
    scene : Scene
    settings : Settings

    Returns
    -------
    tuple of Part
    """
    average, *remedies = average_parts(settings, averages_light(settings))
    return average, holes_part(settings), *remedies


def holes_part(settings: Settings) -> Part:
    """What is said of a checkerboard's holes.

    Parameters
    ----------
    settings : Settings

    Returns
    -------
    Part
    """
    return Part("holes", settings.checkerboard, "of the checkerboard" if settings.checkerboard else "none")


def average_parts(settings: Settings, filters: bool) -> tuple[Part, Part, Part]:
    """What is said of an average over frames.

    Parameters
    ----------
    settings : Settings
    filters : bool
        Whether it is formed.

    Returns
    -------
    tuple of Part
        The average and its two remedies against ghosts.
    """
    how = settings.temporal
    clamps, rises = filters and how.clamp != "off", filters and how.alpha_most is not None
    other = "no temporal filter" if how.filter == "off" else f"the filter is {how.filter}"
    return (Part("average", filters, f"weight {how.alpha:g}" if filters else other),
            Part("clamp", clamps, f"to the neighbourhood's {how.clamp}" if clamps else "history as it is"),
            Part("variable weight", rises, f"up to {how.alpha_most:g}" if rises else "one for all"))


def nothing_filtered(job: Job) -> dict[str, Field]:
    """What stands for the stage where it is left out: no fields; the next stage reads what came before.

    Parameters
    ----------
    job : Job

    Returns
    -------
    dict of str to ndarray
        Arrays with axes of length 0.
    """
    none = np.zeros((3, 0, 0, 0), job.dtype)
    return {name: none if name in (FIELDS[0], FIELDS[2]) else none[0] for name in FIELDS}


def fog_fields(results: Results) -> tuple[Field, Field]:
    """In-scattering and extinction as the fog is made of: filtered where a filter ran.

    Parameters
    ----------
    results : mapping of str to Field

    Returns
    -------
    in_scattering, extinction : Field
    """
    if results["temporal/extinction"].size:
        return results["temporal/in_scattering"], results["temporal/extinction"]
    filtered = results["material/extinction"]
    return results["lighting/in_scattering"], filtered if filtered.size else results["media/extinction"]


def filtered_fields(job: Job, results: Results) -> dict[str, Field]:
    """Fill the holes and filter.

    Parameters
    ----------
    job : Job
    results : mapping of str to Field
        With ``lighting/…``, ``media/extinction`` and ``material/extinction``.

    Returns
    -------
    dict of str to Field
        ``temporal/…``.

    Notes
    -----
    What is kept is in-scattering with extinction beside it, as one RGBA16F texture holds them [Dörries 2020, §3.2.3].
    "unphased" keeps light divided by what the phase function makes of it, and each frame multiplies by its own ratio
    [Lagarde 2018]: so what a turning camera does with the phase function is never old. The ratio is of lights that
    nothing hides, at the froxels' middles, so at rest it changes nothing. Of several lights it is that of their sum,
    whichever of them are hidden. A hole of the checkerboard is its history alone, or the mean of its neighbours where
    it has none [§3.2.9]. Of "media" light has holes and nothing else: extinction comes without, from
    `froxel_ref.material_stage`.
    """
    how = job.settings
    if not needs_filter(how)[0]:  # forced, but not to what was switched off
        return nothing_filtered(job)
    light, empty, past = results["lighting/in_scattering"], np.zeros((3, 0, 0, 0), job.dtype), past_of(job, HISTORY[0])
    if how.temporal.filter == "media":
        (light,), *rest = _filtered(job, {HISTORY[0]: light}, past)
        return dict(zip(FIELDS, (light, results["material/extinction"], empty, *rest), strict=True))
    unphased = how.temporal.filter == "unphased"
    ratio = results["lighting/phase_ratio"]
    if unphased and not ratio.size:  # there is no light
        ratio = np.ones((3, 1, 1, 1), job.dtype)
    if unphased:
        light = np.divide(light, ratio, where=ratio > 0.0, out=np.zeros(np.broadcast_shapes(light.shape, ratio.shape),
                                                                       job.dtype))
    (light, dense), *rest = _filtered(job, {HISTORY[2 if unphased else 0]: light,
                                            HISTORY[1]: results["media/extinction"]}, past)
    if not unphased:
        return dict(zip(FIELDS, (light, dense, empty, *rest), strict=True))
    return dict(zip(FIELDS, (_phased(job, light, ratio, past), dense, light, *rest), strict=True))


def _phased(job: Job, light: Field, ratio: Field, past: Past | None) -> Field:
    """Light times what the phase function makes of it; in a checkerboard's holes as it was, where it was."""
    made: Field = light * filled(job, ratio)
    known = _known(job)
    if past is None or known is None:
        return made
    old = _fetched(job, past, HISTORY[0])
    return np.where(~known & temporal.usable(old, past.place.valid), old, made)


def _fetched(job: Job, past: Past, name: str) -> Field:
    """A field of the history where this frame's froxels were; light at this frame's exposure (A12)."""
    old = past.field(name, job)
    ratio = 1.0 if name == HISTORY[1] else job.exposure / past.history.exposure
    return old if ratio == 1.0 else old * job.dtype.type(ratio)


def _filtered(job: Job, fields: Mapping[str, Field], past: Past | None) -> tuple[list[Field], Field, Field]:
    """Fields, light first, averaged with their history; where they have one; and what is guessed of them."""
    averages = averages_light(job.settings)
    if past is None or not past.history.has(next(iter(fields))):
        return ([filled(job, field) for field in fields.values()], np.zeros((1, 1, 1), job.dtype),
                guesses(job, averages)[1])
    valid = past.place.valid
    old_guess, guess = guesses(job, averages, past.history.fields.get(HISTORY[3]), past.place)
    made = []
    for name, new in fields.items():
        old = _fetched(job, past, name)
        if old.ndim > new.ndim:  # extinction was of three colours
            new = np.broadcast_to(new, (3, *new.shape))
        elif old.ndim < new.ndim:
            old = old[np.newaxis]
        made.append(_averaged(job, new, old, valid, old_guess) if averages else filled(job, new, old, valid))
    return made, valid.astype(job.dtype), guess


def _averaged(job: Job, new: Field, old: Field, valid: NDArray[np.bool_], guessed: Field | None) -> Field:
    """A field averaged with its history."""
    how = job.settings.temporal
    if job.settings.checkerboard and how.clamp == "off" and how.alpha_most is None:
        return _averaged_half(job, new, old, valid, guessed)
    whole = filled(job, new, old, valid)
    old = held(job, old, whole)
    return temporal.blend(whole, old, valid, alpha=weight(job, [whole], [old], guessed))


def _averaged_half(job: Job, new: Field, old: Field, valid: NDArray[np.bool_], guessed: Field | None) -> Field:
    """The same where no froxel looks at its neighbours: half are averaged, the others are their history."""
    how, shape = job.settings, job.settings.grid.shape
    known, holes = (checkerboard.lattices(shape, job.frame + n, parity=how.checkerboard_parity) for n in (0, 1))
    result = np.empty((*new.shape[:-3], *shape), job.dtype)
    alpha = job.dtype.type(_alpha(job))
    remembered = all(temporal.usable(part_of(old, box), part_of(valid, box)).all() for box in holes)
    kept = old if remembered else filled(job, new, old, valid)

    def average(box: Index) -> None:
        packed = slice(0, len(range(shape[0])[box[0]])), *box[1:]
        share = _raised(alpha, None if guessed is None else part_of(guessed, box))
        result[..., *box] = temporal.blend(part_of(new, packed), part_of(old, box), part_of(valid, box), alpha=share)

    def keep(box: Index) -> None:
        result[..., *box] = part_of(kept, box)

    blocks.run(average, known, threads=job.threads)
    blocks.run(keep, holes, threads=job.threads)
    return result


# --- what every average over frames does --------------------------------------------------------------


class Past(NamedTuple):
    """A history as this frame's froxels see it.

    Attributes
    ----------
    history : History
    place : HistoryPosition
        Where these froxels lie in it.
    """

    history: History
    place: temporal.HistoryPosition

    def field(self, name: str, job: Job) -> Field:
        """One of its fields, where these froxels were."""
        return self.fetch(self.history.fields[name].astype(job.dtype, copy=False), job)

    def fetch(self, volume: Field, job: Job) -> Field:
        """A volume of that frame, where these froxels were."""
        return temporal.reproject(volume, self.place, threads=job.threads)


def past_of(job: Job, name: str) -> Past | None:
    """See a frame's history from this frame, if it holds a field.

    Parameters
    ----------
    job : Job
    name : str
        Of the field.

    Returns
    -------
    Past or None
    """
    history = job.history
    if history is None or not history.has(name):
        return None
    return Past(history, temporal.history_position(job.settings.grid, job.scene.camera, history.camera,
                                                   previous_grid=history.grid))


def filled(job: Job, field: Field, history: Field | None = None, valid: NDArray[np.bool_] | None = None
           ) -> Field:
    """Fill the holes of a field as this frame computes it.

    Parameters
    ----------
    job : Job
    field : Field
        As stored: of a checkerboard half the slices.
    history : Field, optional
        As reprojected, and rescaled.
    valid : ndarray of bool, optional
        Where there is one; everywhere unless given.

    Returns
    -------
    Field
        Of the whole grid. One number has no holes, unless what is outside counts as 0.
    """
    how = job.settings
    outside = "zero" if how.checkerboard_fill == "zero" else "absent"
    if not how.checkerboard or (history is None and outside == "absent" and field.shape[-3:] == (1, 1, 1)):
        return field
    whole = checkerboard.unpack(field, how.grid.shape, job.frame, parity=how.checkerboard_parity)
    return checkerboard.fill(whole, history, np.ones((1, 1, 1), bool) if valid is None else valid, job.frame,
                             parity=how.checkerboard_parity, outside=outside)


def _known(job: Job) -> NDArray[np.bool_] | None:
    """The froxels of a checkerboard that this frame computed."""
    how = job.settings
    return checkerboard.computed(how.grid.shape, job.frame, parity=how.checkerboard_parity
                                 ) if how.checkerboard else None


def guesses(job: Job, averages: bool, history: Field | None = None, place: temporal.HistoryPosition | None = None
            ) -> tuple[Field | None, Field]:
    """Tell what of a history, and of this frame's fields, no frame has computed.

    Parameters
    ----------
    job : Job
    averages : bool
        Whether fields are averaged.
    history : Field, optional
        The share that was guessed a frame ago.
    place : HistoryPosition, optional
        Where the froxels were then.

    Returns
    -------
    before : Field, or None where nothing was guessed
        The share of the history.
    now : Field
        The share of what this frame leaves; of length 0 unless a checkerboard is averaged.

    Notes
    -----
    A hole without a history takes the mean of its neighbours. By an average of α that guess would fade as (1 − α)ⁿ over
    n frames in which the froxel is computed: for 117 frames at 0.05 it is seen (S7). So what is computed first
    replaces it. With a camera that moves, histories are guessed in part, and this frame's weight rises by that share.
    """
    known = _known(job)
    if known is None or not averages or job.settings.filled_holes == "kept":
        return None, np.zeros((0, 0, 0), job.dtype)
    if place is None:
        return None, (~known).astype(job.dtype)
    if history is None or not history.size:
        history = np.zeros((1, 1, 1), job.dtype)
    if place.valid.all() and not history.any():
        return None, np.zeros((1, 1, 1), job.dtype)
    before = temporal.reproject(history.astype(job.dtype, copy=False), place, threads=job.threads)
    before = np.where(place.valid & (before >= 0.0), np.minimum(before, 1.0), job.dtype.type(1.0))
    return before, np.where(known, job.dtype.type(0.0), before)


def held(job: Job, history: Field, field: Field) -> Field:
    """Hold a history to what this frame shows around each froxel, if the settings say so.

    Parameters
    ----------
    job : Job
    history : Field
        As reprojected, and rescaled.
    field : Field
        Of this frame, without holes.

    Returns
    -------
    Field
    """
    how = job.settings.temporal
    if how.clamp == "off":
        return history
    method = {"range": "minmax", "deviation": "variance"}[how.clamp]
    return ghosting.clamp_history(history, field, method=method, gamma=how.gamma, known=_known(job))


def weight(job: Job, fields: Sequence[Field], histories: Sequence[Field], guessed: Field | None = None) -> Field:
    """Weigh this frame, alike for all the fields that one texture holds.

    Parameters
    ----------
    job : Job
        Its history's length counts.
    fields, histories : sequence of Field
        Of this frame, without holes, and as `held`.
    guessed : Field, optional
        The share of the histories that no frame has computed (`guesses`).

    Returns
    -------
    Field, broadcastable to (z, y, x)
        1 in holes: what stands there is history already.
    """
    how, known, alpha = job.settings.temporal, _known(job), _alpha(job)
    result: Field = np.full((1, 1, 1), alpha, job.dtype)
    if how.alpha_most is not None and how.alpha_most > alpha:
        for field, old in zip(fields, histories, strict=True):
            result = np.maximum(result, ghosting.adaptive_alpha(field, old, least=alpha, most=how.alpha_most,
                                                                known=known))
    result = _raised(result, guessed)
    return result if known is None else np.where(known, result, job.dtype.type(1.0))


def _raised(share: Any, guessed: Field | None) -> Any:
    """A weight raised by the share of the history that was guessed."""
    return share if guessed is None else share + (1.0 - share) * guessed


def _alpha(job: Job) -> float:
    """This frame's weight before anything raises it."""
    how, history = job.settings.temporal, job.history
    assert history is not None
    if how.start == "first":
        return how.alpha
    values = history.length // 2 if job.settings.checkerboard else history.length
    return float(temporal.start_weight(values + 1, alpha=how.alpha))
