"""Particles and transparent surfaces bound to a frame: lit, fogged at their own depth, laid over one another."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from froxel_ref import fom_plan, particles, surface, transparency
from froxel_ref.arrays import Field, FogAt, Visibility
from froxel_ref.billboards import placed_particles
from froxel_ref.jobs import Job, Results
from froxel_ref.light_visibility import light_visibility
from froxel_ref.scene import Scene
from froxel_ref.settings import Settings

__all__ = ["FIELDS", "drawn_layers", "needs_layers", "nothing_drawn"]

FIELDS = ("particles/radiance", "particles/transmittance")


def needs_layers(scene: Scene, settings: Settings) -> tuple[bool, str]:
    """Whether anything lies over the image, and what.

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
    >>> needs_layers(Scene(), Settings())
    (False, 'the scene has no particles and no transparent surfaces')
    """
    counts = ((sum(each.visible for each in items), thing) for items, thing in (
        (scene.all_particles, "particle"), (scene.transparent_surfaces, "transparent surface")))
    found = [f"{count} {thing}{'s' * (count > 1)}" for count, thing in counts if count]
    return bool(found), ", ".join(found) or "the scene has no particles and no transparent surfaces"


def nothing_drawn(job: Job) -> dict[str, Field]:
    """What stands for the stage where it is left out: nothing over the image.

    Parameters
    ----------
    job : Job

    Returns
    -------
    dict of str to ndarray
    """
    return dict(zip(FIELDS, (np.zeros((3, 1, 1), job.dtype), np.ones((1, 1), job.dtype)), strict=True))


def drawn_layers(job: Job, results: Results, fog_at: FogAt) -> dict[str, Field]:
    """Draw particles and transparent surfaces.

    Parameters
    ----------
    job : Job
    results : mapping of str to Field
        With the surfaces' depth, and the maps that shadows ask for.
    fog_at : callable
        The fog in front of points, see `froxel_ref.arrays.FogAt`.

    Returns
    -------
    dict of str to Field
        ``particles/…``: all of them in one layer.

    Notes
    -----
    In each pixel transparent surfaces are sorted by their depth there, and what a particle shows there lies before or
    behind each of them by its own. Particles among themselves are sorted as wholes. Light is that of the froxels and
    opaque surfaces, through the same maps; the long range is skipped [Dörries 2020, §3.2.10].
    """
    scene, how, exposure = job.scene, job.settings, job.dtype.type(job.exposure)  # the fog's has it
    seen, size = light_visibility(job, results), fom_plan.particle_size(how)
    depth = np.broadcast_to(results["surface/depth"], job.image_shape)
    panes = transparency.sorted_panes(_panes(job, seen, depth, fog_at))
    ready = placed_particles(scene, job.assets, dtype=job.dtype)
    light_on = particles.scattered_light(
        ready, scene.all_lights, scene.camera.position, ambient=scene.ambient, visibility=seen,
        attenuation=how.attenuation, size=size, restrict=not job.full)
    radiance, passed = transparency.interleaved(panes, particles.particle_layers(
        ready, scene.camera, job.image_rays, depth, [pane.depth for pane in panes],
        lambda points, index: light_on(points, index) * exposure, fog_at, lit_at=how.particles_lit_at, size=size))
    if job.full:
        radiance, passed = (np.broadcast_to(field, (*field.shape[:-2], *job.image_shape)).copy()
                            for field in (radiance, passed))
    return dict(zip(FIELDS, (radiance, passed), strict=True))


def _panes(job: Job, seen: Visibility, depth: Field, fog_at: FogAt) -> Iterator[transparency.Pane]:
    """The transparent surfaces, one at a time."""
    for each in job.scene.transparent_surfaces:
        if each.visible:
            hits = surface.find_surfaces([each.surface], job.image_rays, job.assets, restrict=not job.full,
                                         threads=job.threads)
            light = surface.shade(hits, job.image_rays, job.scene, attenuation=job.settings.attenuation,
                                  visibility=seen, restrict=not job.full, threads=job.threads)
            yield transparency.fogged_pane(hits, light * job.dtype.type(job.exposure), each.opacity, depth, fog_at)
