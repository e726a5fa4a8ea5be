"""The temporal stage bound to a frame: holes of the checkerboard filled, froxels filtered over frames."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from froxel_ref import checkerboard, ghosting, temporal
from froxel_ref.arrays import Field
from froxel_ref.jobs import Job, Part, Results
from froxel_ref.scene import Scene
from froxel_ref.settings import Settings

__all__ = ["FIELDS", "HISTORY", "filtered_fields", "fog_fields", "needs_filter", "nothing_filtered", "temporal_parts"]

FIELDS = ("temporal/in_scattering", "temporal/extinction", "temporal/unphased", "temporal/valid")
HISTORY = FIELDS[:3]
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
    found += [f"filter: {settings.temporal.filter}"] * (settings.temporal.filter != "off")
    return (True, ", ".join(found)) if found else (False, "no temporal filter and no checkerboard")


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
    how = settings.temporal
    filters = how.filter != "off"
    rest = how.clamp != "off", how.alpha_most is not None
    return (Part("average", filters, f"weight {how.alpha:g}" if filters else "no temporal filter"),
            Part("holes", settings.checkerboard, "of the checkerboard" if settings.checkerboard else "none"),
            Part("clamp", rest[0], f"to the neighbourhood's {how.clamp}" if rest[0] else "history as it is"),
            Part("variable weight", rest[1], f"up to {how.alpha_most:g}" if how.alpha_most else "one for all"))


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
    return {name: none if name in FIELDS[0::2] else none[0] for name in FIELDS}


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
    return results["lighting/in_scattering"], results["media/extinction"]


def filtered_fields(job: Job, results: Results) -> dict[str, Field]:
    """Fill the holes and filter.

    Parameters
    ----------
    job : Job
    results : mapping of str to Field
        With ``lighting/…`` and ``media/extinction``.

    Returns
    -------
    dict of str to Field
        ``temporal/…``.

    Notes
    -----
    What is kept is in-scattering with extinction beside it, as one RGBA16F texture holds them [Dörries 2020, §3.2.3].
    "unphased" keeps the light that an isotropic medium would scatter, and each frame multiplies by its own ratio of
    the two [Lagarde 2018]: so what the phase function does with a turning camera is never old. A hole of the
    checkerboard is its history alone, or the mean of its neighbours where it has none [§3.2.9].
    """
    how = job.settings
    if not needs_filter(how)[0]:  # forced, but not to what was switched off
        return nothing_filtered(job)
    unphased = how.temporal.filter == "unphased"
    light, dense = results[f"lighting/{'unphased' if unphased else 'in_scattering'}"], results["media/extinction"]
    light, dense, valid = _filtered(job, light, dense, HISTORY[2 if unphased else 0])
    empty = np.zeros((3, 0, 0, 0), job.dtype)
    if not unphased:
        return dict(zip(FIELDS, (light, dense, empty, valid), strict=True))
    ratio = _ratio(*(_filled(job, results[f"lighting/{name}"]) for name in ("in_scattering", "unphased")))
    return dict(zip(FIELDS, (light * ratio, dense, light, valid), strict=True))


def _filled(job: Job, field: Field, history: Field | None = None, valid: NDArray[np.bool_] | None = None,
            ratio: float = 1.0) -> Field:
    """A field without holes. One number has none, unless what is outside counts as 0."""
    how = job.settings
    outside = "zero" if how.checkerboard_fill == "zero" else "absent"
    if not how.checkerboard or (history is None and outside == "absent" and field.shape[-3:] == (1, 1, 1)):
        return field
    whole = checkerboard.unpack(field, how.grid.shape, job.frame, parity=how.checkerboard_parity)
    return checkerboard.fill(whole, history, np.ones((1, 1, 1), bool) if valid is None else valid, job.frame,
                             parity=how.checkerboard_parity, exposure_ratio=ratio, outside=outside)


def _ratio(phased: Field, unphased: Field) -> Field:
    """What the phase function makes of light; where none arrives it makes nothing of it."""
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        return np.where(unphased > 0.0, phased / unphased, 0.0).astype(phased.dtype)


def _filtered(job: Job, light: Field, dense: Field, name: str) -> tuple[Field, Field, Field]:
    """Light and extinction averaged with their history, and where they have one."""
    history = job.history
    if history is None or name not in history.fields or not history.fields[name].size:
        return _filled(job, light), _filled(job, dense), np.zeros((1, 1, 1), job.dtype)
    grid = job.settings.grid
    place = temporal.history_position(grid, job.scene.camera, history.camera, previous_grid=history.grid)
    old = [temporal.reproject(history.fields[n].astype(job.dtype, copy=False), place, threads=job.threads)
           for n in (name, HISTORY[1])]
    made = [_averaged(job, new, before, place.valid, ratio)
            for new, before, ratio in zip((light, dense), old, (job.exposure / history.exposure, 1.0), strict=True)]
    return made[0], made[1], place.valid.astype(job.dtype)


def _averaged(job: Job, new: Field, old: Field, valid: NDArray[np.bool_], ratio: float) -> Field:
    """One field: holes first, then the average. ``ratio`` is of exposures (A12)."""
    settings, how = job.settings, job.settings.temporal
    filled = _filled(job, new, old, valid, ratio)
    if how.filter == "off":
        return filled
    known = checkerboard.computed(settings.grid.shape, job.frame, parity=settings.checkerboard_parity
                                  ) if settings.checkerboard else None
    if ratio != 1.0:
        old = old * job.dtype.type(ratio)
    if how.clamp != "off":
        method = {"range": "minmax", "deviation": "variance"}[how.clamp]
        old = ghosting.clamp_history(old, filled, method=method, gamma=how.gamma, known=known)
    weight = _weight(job, filled, old, known)
    if known is not None:
        weight = np.where(known, weight, 1.0)  # what stands in a hole is its history already
    return temporal.blend(filled, old, valid, alpha=weight)


def _weight(job: Job, light: Field, old: Field, known: NDArray[np.bool_] | None) -> Field:
    """The weight of this frame."""
    how, history = job.settings.temporal, job.history
    assert history is not None
    alpha = how.alpha
    if how.start == "mean":
        values = history.length // 2 if job.settings.checkerboard else history.length
        alpha = float(temporal.start_weight(values + 1, alpha=alpha))
    if how.alpha_most is None or how.alpha_most <= alpha:
        return np.full((1, 1, 1), alpha, job.dtype)
    return ghosting.adaptive_alpha(light, old, least=alpha, most=how.alpha_most, known=known)
