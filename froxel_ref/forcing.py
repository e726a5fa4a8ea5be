"""Everything forced on: the frame with every part of every stage at its neutral value.

The comparison that proves that leaving out changes nothing.
"""

from __future__ import annotations

import dataclasses
from typing import TypeVar

import numpy as np

from froxel_ref.jobs import Job
from froxel_ref.media import contributing
from froxel_ref.scene import (
    BLACK,
    DensityTexture,
    DirectionalLight,
    ExtraLights,
    HeightFog,
    LocalMedium,
    Medium,
    Particle,
    PointLight,
    Scene,
    Sphere,
    Transform,
    TransparentSurface,
    VolumeDensity,
)
from froxel_ref.settings import replace

__all__ = ["forced"]

AnyMedium = TypeVar("AnyMedium", bound=Medium)

# A texture of ones, so that fetching it changes nothing. No scene can name it: an empty path is no file.
_ONES = VolumeDensity(path="")


def forced(job: Job) -> Job:
    """The same job with every part of every stage switched on at its neutral value.

    Parameters
    ----------
    job : Job

    Returns
    -------
    Job
        Media without height fog get a falloff of 0, media without a texture one of ones. The scene gets an
        empty local medium and an empty unbounded one if it has none, a black sun, a black lamp, a sphere behind
        the camera if it has no surface, a transparent one there if it has none such, and a particle of opacity 0
        if it has none. Each is an exact 0 or 1 in the arithmetic, so the frame must come out the same bit for bit.

    Notes
    -----
    Two departures have no neutral value, and what they concern is then not added: the plain mean of g (D12)
    counts media that are not there, and 0/0 (D1) is not the albedo of no medium.
    """
    scene, settings = job.scene, job.settings
    far_away = LocalMedium(extinction=0.0, transform=Transform(translate=(1e6, 1e6, 1e6)))
    local = scene.local_media or (far_away,)
    everywhere = scene.global_media or (Medium(extinction=0.0),)
    if settings.phase_mixing == "mean":
        everywhere, local = scene.global_media, scene.local_media
    if not contributing(scene.global_media + scene.local_media) and settings.albedo_at_zero == "divide":
        settings = replace(settings, albedo_at_zero="zero")
    lights = (*scene.all_lights, DirectionalLight(direction=(0.0, 1.0, 0.0), irradiance=BLACK),
              PointLight(position=scene.camera.target, intensity=BLACK, casts_shadows=False))
    surfaces = scene.surfaces if scene.surfaces or scene.image_buffers else (_behind(scene),)
    particles = scene.particles or (Particle(position=scene.camera.target, opacity=0.0),)
    glass = scene.transparent_surfaces or (TransparentSurface(surface=_behind(scene)),)
    scene = dataclasses.replace(
        scene, particles=particles, lights=lights, extra_lights=ExtraLights(), surfaces=surfaces,
        transparent_surfaces=glass,
        local_media=tuple(map(_with_all_parts, local)), global_media=tuple(map(_with_all_parts, everywhere)))
    textures = dict(job.assets.textures) | {_ONES: np.ones((2, 2, 2))}
    return dataclasses.replace(job, scene=scene, settings=settings,
                               assets=job.assets._replace(textures=textures))


def _behind(scene: Scene) -> Sphere:
    """A sphere that no ray meets and that hides no light."""
    forward = np.subtract(scene.camera.target, scene.camera.position)
    x, y, z = (scene.camera.position - 4.0 * forward).tolist()
    return Sphere(center=(x, y, z), radius=float(np.linalg.norm(forward)), casts_shadows=False)


def _with_all_parts(medium: AnyMedium) -> AnyMedium:
    return dataclasses.replace(medium, height_fog=medium.height_fog or HeightFog(falloff=0.0),
                               density=medium.density or DensityTexture(source=_ONES))
