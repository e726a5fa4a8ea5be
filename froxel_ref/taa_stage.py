"""Temporal anti-aliasing bound to a frame: the final image averaged with that of the frame before."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from froxel_ref import taa
from froxel_ref.arrays import Field
from froxel_ref.image_motion import closest_depth, motion
from froxel_ref.jobs import Job, Results
from froxel_ref.quantities import AVERAGED, FINAL
from froxel_ref.scene import Scene
from froxel_ref.settings import Settings
from froxel_ref.storage import FLOAT16_LARGEST, store_half

__all__ = ["averaged_image", "needs_average", "no_average", "resolve_options"]

BOXES: dict[str, dict[str, float]] = {
    "measured": {}, "least": {"least_variance": taa.PUBLISHED["least_variance"]},
    "padded": {name: taa.AUTHOR[name] for name in ("least_variance", "padding")}}
INVERSES: dict[str, dict[str, Any]] = {
    "carried": {"inverse": "carried"},
    "luma": {name: taa.PUBLISHED[name] for name in ("inverse", "largest_luma")},
    "bounded": {name: taa.AUTHOR[name] for name in ("inverse", "largest_luma")}}


def needs_average(scene: Scene, settings: Settings) -> tuple[bool, str]:
    """Whether the image is averaged, and why.

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
    >>> needs_average(Scene(), Settings())
    (False, 'temporal anti-aliasing is off')
    """
    on = settings.taa.on
    return on, f"temporal anti-aliasing, weight {settings.taa.alpha:g}" if on else "temporal anti-aliasing is off"


def no_average(job: Job) -> dict[str, Field]:
    """What stands for the stage where it is left out: no image.

    Parameters
    ----------
    job : Job

    Returns
    -------
    dict of str to ndarray
        An array with axes of length 0.
    """
    return {AVERAGED: np.zeros((3, 0, 0), job.dtype)}


def resolve_options(settings: Settings) -> dict[str, Any]:
    """What `froxel_ref.taa.resolve` is given, by the settings and their switches.

    Parameters
    ----------
    settings : Settings

    Returns
    -------
    dict
        Keyword arguments, but for the weight.

    Examples
    --------
    >>> from froxel_ref.settings import AntiAliasing
    >>> found = resolve_options(Settings(fidelity="author", taa=AntiAliasing(on=True)))
    >>> {name: found[name] for name in taa.AUTHOR} == taa.AUTHOR
    True
    """
    how = settings.taa
    return {"gamma": how.gamma, "clip": how.clip, "kernel": how.kernel, "tone_mapping": how.tone_mapping,
            "space": settings.taa_space, "border": settings.taa_border,
            **BOXES[settings.taa_box], **INVERSES[settings.inverse_tone_map]}


def averaged_image(job: Job, results: Results) -> dict[str, Field]:
    """Average the image with its history.

    Parameters
    ----------
    job : Job
    results : mapping of str to Field
        With the final image of this frame and the surfaces' depth.

    Returns
    -------
    dict of str to Field
        ``taa/radiance``.

    Notes
    -----
    Colours are tone-mapped as the display has them, exposed; what is kept is radiance. Pixels move as the camera makes
    them; things that move by themselves are not followed. A history of an image of another size is none.
    """
    how = job.settings.taa
    if not how.on:  # forced, but not to what was switched off
        return no_average(job)
    camera, past, shape = job.scene.camera, job.history, job.image_shape
    exposure = job.dtype.type(1.0 if job.settings.exposure == "lighting" else camera.exposure)
    image = np.broadcast_to(results[FINAL], (3, *shape)) * exposure
    options = resolve_options(job.settings)
    half = how.storage == "float16"
    if half:  # what the texture holds, as exposed
        options["largest"] = min(FLOAT16_LARGEST * float(exposure), float(np.finfo(job.dtype).max))
    if past is None or not past.has(AVERAGED) or (past.camera.height, past.camera.width) != shape:
        made = taa.resolve(image, None, threads=job.threads, **options)
    else:
        depth = np.broadcast_to(results["surface/depth"], shape)
        pixels = closest_depth(motion(depth, camera, past.camera), depth)
        alpha: ArrayLike = how.alpha
        if job.settings.taa_weight == "author":
            alpha = taa.author_alpha(pixels.x, pixels.y, job.pixel_shift)
        before = past.fields[AVERAGED].astype(job.dtype, copy=False) * exposure
        made = taa.resolve(image, before, pixels, alpha=alpha, exposure_ratio=job.exposure / past.exposure,
                           threads=job.threads, **options)
    made /= exposure
    return {AVERAGED: store_half(made) if half else made}
