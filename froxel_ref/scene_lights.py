"""Lights as validated records."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import ClassVar

import numpy as np

from froxel_ref.kinds import choice, flag, integer, number, text, vector
from froxel_ref.records import InputError, Record
from froxel_ref.scene_space import LIGHT, PLACE, RATE, SINGULAR, SIZE, Rgb, Vec3, cos_sin, must_point

__all__ = ["DirectionalLight", "ExtraLights", "Light", "PointLight", "SpotLight"]


@dataclass(frozen=True, kw_only=True)
class DirectionalLight(Record):
    """A light at infinity, such as the sun."""

    kind: ClassVar[str] = "directional"
    name: str = text("", "for the reader")
    direction: Vec3 = vector(about="from the scene towards the light (L)", **RATE)
    irradiance: Rgb = vector(about="on a surface that faces the light", unit="W/m^2", **LIGHT)
    casts_shadows: bool = flag(True, "whether surfaces hide it")
    shadow_map: str | None = text(None, ".npy file of depths made elsewhere (CONVENTIONS.md)", optional=True)

    def check_together(self) -> None:
        must_point(self.direction, "direction")


@dataclass(frozen=True, kw_only=True)
class PointLight(Record):
    """A light that shines alike in all directions."""

    kind: ClassVar[str] = "point"
    name: str = text("", "for the reader")
    position: Vec3 = vector(about="world position", **PLACE)
    intensity: Rgb | None = vector(None, "radiant intensity", unit="W/sr", optional=True, **LIGHT)
    power: Rgb | None = vector(
        None, "radiant power, instead of intensity (see Settings: light_power)", unit="W", optional=True,
        **LIGHT)
    radius: float = number(16.0, "distance at which the window reaches zero", **SIZE)
    falloff: str = choice("windowed", "inverse_square", default="windowed",
                          about="inverse square times sat(1 − (d/radius)⁴)², or without that window")
    min_distance: float = number(
        0.01, "distance below which the irradiance stops growing", **SIZE)
    casts_shadows: bool = flag(True, "whether surfaces hide it")
    shadow_map: str | None = text(None, ".npy file of depths made elsewhere (CONVENTIONS.md)", optional=True)

    def check_together(self) -> None:
        if (self.intensity is None) == (self.power is None):
            both = "is given beside power, must be given instead of it" if self.power else "is missing (or power)"
            raise InputError("intensity", both)


@dataclass(frozen=True, kw_only=True)
class SpotLight(PointLight):
    """A point light in a cone: sat(cos·scale + offset)², 1 within the inner angle, 0 outside the outer."""

    kind: ClassVar[str] = "spot"
    direction: Vec3 = vector((0.0, -1.0, 0.0), "from the light along the axis of its cone", **RATE)
    inner_angle: float = number(
        20.0, "half angle of full intensity", unit="degrees", at_least=0.0, below=90.0)
    outer_angle: float = number(30.0, "half angle of the cone", unit="degrees", above=0.0, below=90.0,
                                within=(0.001, 90.0))

    def check_together(self) -> None:
        super().check_together()
        must_point(self.direction, "direction")
        inner, outer = cos_sin(self.inner_angle)[0], cos_sin(self.outer_angle)[0]
        if not inner - outer > SINGULAR * (1.0 - outer):
            raise InputError(
                "inner_angle", f"is {self.inner_angle:g}, must be below outer_angle ({self.outer_angle:g})")


Light = DirectionalLight | PointLight | SpotLight


@dataclass(frozen=True, kw_only=True)
class ExtraLights(Record):
    """Unshadowed point lights strewn over a box from a seed, for measuring how time grows with lights."""

    count: int = integer(0, "how many", at_least=0, at_most=65536)
    seed: int = integer(1, "seed of the generator", at_least=0)
    low: Vec3 = vector((-8.0, 0.5, -30.0), "smallest corner of the box", **PLACE)
    high: Vec3 = vector((8.0, 5.0, 0.0), "largest corner of the box", **PLACE)
    radius: float = number(4.0, "radius of each", **SIZE)
    intensity: float = number(0.5, "mean radiant intensity; each has its own hue", unit="W/sr", **LIGHT)

    def check_together(self) -> None:
        if not all(a <= b for a, b in zip(self.low, self.high, strict=True)):
            raise InputError("low", "is beyond high, must not exceed it on any axis")

    def lights(self) -> tuple[PointLight, ...]:
        """The lights; the first n are the same whatever the count."""
        return _strewn(self)


@lru_cache(maxsize=4)  # every stage asks for them, and each light is checked as it is made
def _strewn(extra: ExtraLights) -> tuple[PointLight, ...]:
    unit = np.random.default_rng(extra.seed).random((extra.count, 6))
    position = np.asarray(extra.low) + unit[:, :3] * np.subtract(extra.high, extra.low)
    hue = unit[:, 3:] + 0.25
    intensity = extra.intensity * hue / hue.mean(axis=1, keepdims=True)
    return tuple(
        PointLight(name=f"extra {i}", position=tuple(p), intensity=tuple(c), radius=extra.radius,
                   casts_shadows=False)
        for i, (p, c) in enumerate(zip(position.tolist(), intensity.tolist(), strict=True)))
