"""What is left of each light where it arrives: by surfaces, and by media and particles, in a frame."""

from __future__ import annotations

import numpy as np

from froxel_ref import fom_stage, shadow_stage
from froxel_ref.arrays import Field, Points, Sight, Visibility
from froxel_ref.jobs import Job, Results
from froxel_ref.scene import DirectionalLight

__all__ = ["both_sights", "light_visibility"]


def both_sights(hidden: Sight, dimmed: Sight, *, smaller: bool = False) -> Sight:
    """What surfaces and media together let through.

    Parameters
    ----------
    hidden, dimmed : callable
        By surfaces, and by media.
    smaller : bool
        Take the smaller of the two, as the thesis's program does for the sun (D16), not their product.

    Returns
    -------
    callable

    Examples
    --------
    >>> half = lambda points, normal=None: np.full(1, 0.5)
    >>> [float(both_sights(half, half, smaller=s)((np.zeros(1),) * 3)[0]) for s in (False, True)]
    [0.25, 0.5]
    """
    def see(points: Points, normal: Points | None = None) -> Field:
        one, other = hidden(points, normal), dimmed(points, normal)
        return np.asarray(np.minimum(one, other) if smaller else one * other)

    return see


def _hidden(job: Job, results: Results) -> Visibility:
    """What surfaces leave of each light."""
    how = job.settings.shadows
    return (shadow_stage.map_sights(results, job.scene, job.settings, job.assets) if how == "maps" else
            shadow_stage.exact_sights(job.scene, job.assets) if how == "exact" else {})


def _dimmed(job: Job, results: Results) -> Visibility:
    """What media and particles leave of each light."""
    how = job.settings.volumetric_shadows
    return (fom_stage.map_sights(results, job.scene, job.settings) if how == "maps" else
            fom_stage.exact_sights(job.scene, job.settings, job.assets) if how == "exact" else {})


def light_visibility(job: Job, results: Results) -> Visibility:
    """What is left of each light, by surfaces times by media.

    Parameters
    ----------
    job : Job
    results : mapping of str to ndarray
        With the maps that its settings ask for.

    Returns
    -------
    mapping of int to callable
        Of lights that anything hides or dims; where all is forced, of all, an explicit 1 where nothing does.
    """
    hidden, dimmed = _hidden(job, results), _dimmed(job, results)
    found = {**hidden, **dimmed}
    for number in hidden.keys() & dimmed.keys():
        sun = isinstance(job.scene.all_lights[number], DirectionalLight)
        smaller = sun and job.settings.fom_sun == "min"
        found[number] = both_sights(hidden[number], dimmed[number], smaller=smaller)

    def seen(points: Points, normal: Points | None = None) -> Field:
        return np.ones(np.broadcast_shapes(*(p.shape for p in points)), job.dtype)

    return dict.fromkeys(range(len(job.scene.all_lights)), seen) | found if job.full else found
