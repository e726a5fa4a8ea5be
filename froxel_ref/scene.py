"""What is in the world: cameras, media, lights, surfaces and particles as frozen, validated records.

Units: metres, degrees, linear RGB. Radiance is in W m⁻² sr⁻¹, irradiance in W m⁻², radiant intensity
in W sr⁻¹, extinction in m⁻¹. The world is right-handed with +y up (see CONVENTIONS.md). Scenes are
data: the files they name are read by `froxel_ref.assets`, the arrays they describe are made by the stages.
"""

from __future__ import annotations

from dataclasses import dataclass

from froxel_ref.kinds import many, nested, text, vector
from froxel_ref.records import InputError, Record
from froxel_ref.scene_lights import DirectionalLight, ExtraLights, Light, PointLight, SpotLight
from froxel_ref.scene_media import DensityTexture, HeightFog, LocalMedium, Medium, NoiseDensity, VolumeDensity
from froxel_ref.scene_motion import Key, Track, check_tracks
from froxel_ref.scene_particles import Billboard, Particle, ParticleCloud
from froxel_ref.scene_space import (
    BLACK,
    LIGHT,
    LONGEST,
    PLACE,
    RATE,
    SHORTEST,
    SINGULAR,
    SIZE,
    STRONGEST,
    WHITE,
    WIDEST,
    Camera,
    Rgb,
    Transform,
    Vec3,
)
from froxel_ref.scene_surfaces import (
    Box,
    Folds,
    HeightField,
    HeightsFile,
    ImageBuffers,
    Mesh,
    Plane,
    Sphere,
    Surface,
    TransparentSurface,
)

__all__ = [
    "BLACK", "LIGHT", "LONGEST", "PLACE", "RATE", "SHORTEST", "SINGULAR", "SIZE", "STRONGEST", "WHITE", "WIDEST",
    "Billboard", "Box", "Camera", "DensityTexture", "DirectionalLight", "ExtraLights", "Folds", "HeightField",
    "HeightFog", "HeightsFile", "ImageBuffers", "Key", "Light", "LocalMedium", "Medium", "Mesh", "NoiseDensity",
    "Particle", "ParticleCloud", "Plane", "PointLight", "Rgb", "Scene", "Sphere", "SpotLight", "Surface", "Track",
    "Transform", "TransparentSurface", "Vec3", "VolumeDensity",
]




@dataclass(frozen=True, kw_only=True)
class Scene(Record):
    """Everything that a frame shows."""

    name: str = text("", "short name")
    description: str = text("", "one sentence")
    camera: Camera = nested(Camera, default=Camera(), about="where it is seen from")
    global_media: tuple[Medium, ...] = many(Medium, about="media without bounds")
    local_media: tuple[LocalMedium, ...] = many(LocalMedium, about="media in a box or ellipsoid")
    lights: tuple[Light, ...] = many(DirectionalLight, PointLight, SpotLight, about="lights")
    extra_lights: ExtraLights = nested(ExtraLights, default=ExtraLights(), about="lights for measuring")
    surfaces: tuple[Surface, ...] = many(Plane, Box, Sphere, HeightField, Mesh, about="opaque surfaces")
    image_buffers: ImageBuffers | None = nested(
        ImageBuffers, default=None, optional=True, about="depth and colour instead of surfaces")
    particles: tuple[Particle | ParticleCloud, ...] = many(Particle, ParticleCloud, about="billboards")
    transparent_surfaces: tuple[TransparentSurface, ...] = many(
        TransparentSurface, about="surfaces that are seen through, before the opaque ones or the image buffers")
    ambient: Rgb = vector(
        BLACK, "radiance that arrives from every direction", unit="W m^-2 sr^-1", **LIGHT)
    background: Rgb = vector(BLACK, "radiance where a ray hits nothing", unit="W m^-2 sr^-1", **LIGHT)

    tracks: tuple[Track, ...] = many(Track, about="what changes over time; all else is as it stands")

    def check_together(self) -> None:
        if self.image_buffers is not None and self.surfaces:
            raise InputError("image_buffers", "is given beside surfaces, must be given instead of them")
        check_tracks(self)

    @property
    def all_lights(self) -> tuple[Light, ...]:
        """The lights, then the extra ones."""
        return self.lights + self.extra_lights.lights()

    @property
    def all_surfaces(self) -> tuple[Surface, ...]:
        """The opaque surfaces, then the transparent ones."""
        return self.surfaces + tuple(each.surface for each in self.transparent_surfaces)

    @property
    def all_particles(self) -> tuple[Particle, ...]:
        """The particles in order, each cloud's in its place."""
        return tuple(particle for each in self.particles
                     for particle in (each.particles() if isinstance(each, ParticleCloud) else (each,)))
