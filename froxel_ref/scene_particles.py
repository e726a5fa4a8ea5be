"""Billboard particles as validated records."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import ClassVar

import numpy as np

from froxel_ref.kinds import choice, integer, number, text, vector
from froxel_ref.records import InputError, Record, kinds_of
from froxel_ref.scene_space import LONGEST, PLACE, RATE, SIZE, WHITE, Rgb, Vec3

__all__ = ["Billboard", "Particle", "ParticleCloud"]


@dataclass(frozen=True, kw_only=True)
class Billboard(Record):
    """What particles have in common: a flat square of scatterers that turns to whoever looks at it."""

    name: str = text("", "for the reader")
    albedo: Rgb = vector(WHITE, "share of the light it stops that it scatters", at_least=0.0, at_most=1.0)
    phase_anisotropy: float = number(0.0, "mean cosine g of the phase function", above=-1.0, below=1.0)
    profile: str = choice("soft", "disc", "square", default="soft",
                          about="share of the opacity at r from the centre, r = 1 in the middle of an edge: (1 − r²)², "
                                "1 up to r = 1, or 1 on the whole square")
    texture: str | None = text(
        None, ".npy file of shape (rows, columns), in [0, 1], instead of the profile; row 0 on top", optional=True)
    fom_multiplier: float = number(1.0, "factor on the optical depth it casts on what lies behind it", at_least=0.0,
                                   within=(0.0, LONGEST))


@dataclass(frozen=True, kw_only=True)
class Particle(Billboard):
    """A billboard: it faces the camera in the image, and a light in what it casts."""

    kind: ClassVar[str] = "particle"
    position: Vec3 = vector(about="its centre", **PLACE)
    size: float = number(1.0, "length of an edge (see CONVENTIONS.md, A9)", **SIZE)
    rotation: float = number(0.0, "turn about the line of sight, counter-clockwise", unit="degrees", **RATE)
    opacity: float = number(0.5, "share of the light that it stops where its profile is 1", at_least=0.0, at_most=1.0)

    @property
    def visible(self) -> bool:
        """Whether it stops any light of what lies behind it in the image."""
        return self.opacity > 0.0

    @property
    def casts(self) -> bool:
        """Whether it dims any light."""
        return self.visible and self.fom_multiplier > 0.0


@dataclass(frozen=True, kw_only=True)
class ParticleCloud(Billboard):
    """Particles strewn evenly over a box or an ellipsoid from a seed."""

    kind: ClassVar[str] = "cloud"
    count: int = integer(32, "how many", at_least=0, at_most=65536)
    seed: int = integer(1, "seed of the generator", at_least=0)
    low: Vec3 = vector((-1.0, 0.0, -1.0), "smallest corner of the box of their centres", **PLACE)
    high: Vec3 = vector((1.0, 2.0, 1.0), "largest corner of the box of their centres", **PLACE)
    shape: str = choice("box", "ellipsoid", default="box", about="the box, or the ellipsoid that touches its sides")
    size: tuple[float, float] = vector((0.5, 1.0), "shortest and longest edge", length=2, **SIZE)
    rotation: tuple[float, float] = vector((0.0, 360.0), "least and largest turn", length=2, unit="degrees", **RATE)
    opacity: tuple[float, float] = vector((0.2, 0.5), "least and largest opacity", length=2, at_least=0.0, at_most=1.0)

    def check_together(self) -> None:
        if not all(a <= b for a, b in zip(self.low, self.high, strict=True)):
            raise InputError("low", "is beyond high, must not exceed it on any axis")
        for name in ("size", "rotation", "opacity"):
            low, high = getattr(self, name)
            if low > high:
                raise InputError(name, f"begins with {low:g}, must not exceed its end, {high:g}")

    def particles(self) -> tuple[Particle, ...]:
        """The particles; the first n are the same whatever the count."""
        return _strewn_particles(self)


@lru_cache(maxsize=8)  # a frame asks for them once for every light
def _strewn_particles(cloud: ParticleCloud) -> tuple[Particle, ...]:
    unit = np.random.default_rng(cloud.seed).random((cloud.count, 6))
    place = unit[:, :3]
    if cloud.shape == "ellipsoid":
        # Even in a ball: the cube of the radius, the height and the angle are even.
        height, angle = 2.0 * unit[:, 1] - 1.0, 2.0 * np.pi * unit[:, 2]
        ring = np.sqrt(1.0 - height * height)
        ball = np.cbrt(unit[:, 0]) * np.stack([ring * np.cos(angle), height, ring * np.sin(angle)])
        place = np.clip(0.5 * ball.T + 0.5, 0.0, 1.0)
    position = np.clip(np.asarray(cloud.low) + place * np.subtract(cloud.high, cloud.low), cloud.low, cloud.high)
    low, high = np.transpose([cloud.size, cloud.rotation, cloud.opacity])
    rest = np.clip(low + unit[:, 3:] * (high - low), low, high)
    common = {name: getattr(cloud, name) for name in kinds_of(Billboard) if name != "name"}
    name = cloud.name or "cloud"
    return tuple(
        Particle(name=f"{name} {i}", position=tuple(p), size=size, rotation=rotation, opacity=opacity, **common)
        for i, (p, (size, rotation, opacity)) in enumerate(zip(position.tolist(), rest.tolist(), strict=True)))
