"""The long range bound to a frame: marched at half the image's resolution, spread over its pixels, behind the fog."""

from __future__ import annotations

import dataclasses

import numpy as np

from froxel_ref import bilateral, raymarch
from froxel_ref.arrays import Field
from froxel_ref.blue_noise import noise_at
from froxel_ref.jobs import Job, Part, Results
from froxel_ref.light_visibility import light_visibility
from froxel_ref.media import contributing
from froxel_ref.scene import Scene
from froxel_ref.settings import Settings, replace

__all__ = ["FIELDS", "behind", "long_range_fields", "long_range_parts", "needs_long_range", "nothing_marched"]

FIELDS = ("long_range/depth", "long_range/radiance", "long_range/transmittance")


def needs_long_range(scene: Scene, settings: Settings) -> tuple[bool, str]:
    """Whether there is anything behind the froxels, and why.

    Parameters
    ----------
    scene : Scene
    settings : Settings

    Returns
    -------
    needed : bool
    why : str

    Examples
    --------
    >>> needs_long_range(Scene(), Settings())
    (False, 'the long range is off')
    """
    if not settings.long_range.march:
        return False, "the long range is off"
    if contributing(scene.global_media):
        return True, f"global media behind {settings.grid.far:g} m"
    if settings.integrator in ("published", "simple"):
        return True, f"the integrator {settings.integrator!r} dims even a vacuum (D3)"
    return False, "no medium reaches behind the froxels"


def long_range_parts(scene: Scene, settings: Settings) -> tuple[Part, ...]:
    """What the stage does within itself.

    Parameters
    ----------
    scene : Scene
    settings : Settings

    Returns
    -------
    tuple of Part
    """
    how = settings.long_range
    return (Part("march to the suns", how.sun_steps > 0,
                 f"{how.sun_steps} steps" if how.sun_steps else "long_range.sun_steps is 0"),
            Part("blue noise", how.noise, "jittered steps and taps" if how.noise else "middles and one tap"))


def nothing_marched(job: Job) -> dict[str, Field]:
    """What stands for the stage where it is left out: no fields.

    Parameters
    ----------
    job : Job

    Returns
    -------
    dict of str to ndarray
        Arrays with axes of length 0.
    """
    none = np.zeros((3, 0, 0), job.dtype)
    return dict(zip(FIELDS, (none[0], none, none[0]), strict=True))


def long_range_fields(job: Job, results: Results) -> dict[str, Field]:
    """March from the froxels' far end to the surfaces.

    Parameters
    ----------
    job : Job
    results : mapping of str to Field
        With the surfaces' depth, and the maps that shadows ask for.

    Returns
    -------
    dict of str to Field
        ``long_range/…``, of half the image's resolution.

    Notes
    -----
    What no cascade of a sun's map reaches is lit, whatever the froxels have there (A4). Where it marches to the suns as
    well, the media's shadows are those of that march alone, and opacity maps are not asked.
    """
    how, camera, shape = job.settings, job.scene.camera, job.image_shape
    if not how.long_range.march:  # forced, but not to what was switched off
        return nothing_marched(job)
    half = bilateral.half_depth(results["surface/depth"], even=how.half_depth, shape=shape)
    rays = bilateral.half_rays(camera, *shape[::-1], shift=job.pixel_shift, dtype=job.dtype)
    marches = how.long_range.sun_steps > 0
    lit = dataclasses.replace(job, settings=replace(
        how, beyond_cascades="lit", volumetric_shadows="off" if marches else how.volumetric_shadows))
    rows, columns = rays.length.shape
    jitter = _noise(job, rows, columns)[0] if how.long_range.noise else 0.5
    found = raymarch.march_long_range(
        half, rays, job.scene, farthest=how.long_range.farthest, textures=job.assets.textures, settings=how,
        steps=how.long_range.steps, jitter=jitter, density=how.long_density, visibility=light_visibility(lit, results),
        sun_steps=how.long_range.sun_steps, sun_distance=how.long_range.sun_distance, threads=job.threads)
    return dict(zip(FIELDS, (half, *found), strict=True))


def _noise(job: Job, rows: int, columns: int) -> Field:
    return noise_at(np.arange(rows)[:, np.newaxis], np.arange(columns), job.frame)


def behind(job: Job, results: Results, fog: Field, transmittance: Field) -> tuple[Field, Field]:
    """The fog with what lies behind it.

    Parameters
    ----------
    job : Job
    results : mapping of str to Field
        With the surfaces' depth and ``long_range/…``; the fog as it is, where these are empty.
    fog, transmittance : Field
        What a lookup gives for the surfaces.

    Returns
    -------
    radiance, transmittance : Field
    """
    if not results["long_range/radiance"].size:
        return fog, transmittance
    how, shape = job.settings, job.image_shape
    offsets = bilateral.rotated_offsets(_noise(job, *shape)) if how.long_range.noise else None
    half, *fields = (results[name] for name in FIELDS)
    spread = bilateral.upsample(fields, half, results["surface/depth"], offsets=offsets, judged=how.long_judged,
                                begins=how.grid.far, nearer=(0.0, 1.0), shape=shape, threads=job.threads)
    return raymarch.combine(fog, transmittance, *spread)
