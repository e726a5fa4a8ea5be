"""Participating media as validated records."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from froxel_ref.kinds import choice, integer, nested, number, text, vector
from froxel_ref.records import InputError, Record
from froxel_ref.scene_space import BLACK, LIGHT, LONGEST, PLACE, RATE, SHORTEST, WHITE, Rgb, Transform, Vec3

__all__ = ["DensityTexture", "HeightFog", "LocalMedium", "Medium", "NoiseDensity", "VolumeDensity"]


@dataclass(frozen=True, kw_only=True)
class HeightFog(Record):
    """Density over height: 1 up to ``start``, then exp(−falloff·(y − start)), 0 above ``max_height``."""

    start: float = number(0.0, "height where the falloff begins", **PLACE)
    falloff: float = number(0.1, "rate of the falloff", unit="1/m", at_least=0.0, within=(0.0, LONGEST))
    max_height: float | None = number(None, "height above which there is nothing", optional=True, **PLACE)


@dataclass(frozen=True, kw_only=True)
class NoiseDensity(Record):
    """A periodic density texture made from a seed: summed octaves of gradient noise."""

    kind: ClassVar[str] = "noise"
    seed: int = integer(1, "seed of the generator", at_least=0)
    size: int = integer(32, "texels along each axis", at_least=2, at_most=256)
    cells: int = integer(4, "noise cells along each axis in the first octave", at_least=1, at_most=64)
    octaves: int = integer(3, "octaves, each with twice the cells and half the weight", at_least=1, at_most=8)
    contrast: float = number(2.0, "how far the noise is spread about ½ before it is cut to [0, 1]", above=0.0,
                             within=(SHORTEST, LONGEST))


@dataclass(frozen=True, kw_only=True)
class VolumeDensity(Record):
    """A density texture from a file: ``.vol`` (Mitsuba grid), ``.npy``, or raw with stated shape and type."""

    kind: ClassVar[str] = "file"
    path: str = text(about="file, relative to the scene's folder")
    multiplier: float = number(1.0, "factor on every value", at_least=0.0, within=(0.0, LONGEST))
    shape: tuple[int, ...] | None = vector(
        None, "raw files only: texels along z, y, x", whole=True, optional=True, at_least=1)
    dtype: str | None = choice(
        "uint8", "uint16", "float16", "float32", "float64", default=None, optional=True,
        about="raw files only: type of a value, little-endian; integers span [0, 1]")

    def check_together(self) -> None:
        if (self.shape is None) != (self.dtype is None):
            missing, given = ("shape", "dtype") if self.shape is None else ("dtype", "shape")
            raise InputError(missing, f"is missing beside {given}, raw files need both")


@dataclass(frozen=True, kw_only=True)
class DensityTexture(Record):
    """A 3-D texture that multiplies a medium's density: uv = frac(position·scale + bias + scroll·time)."""

    source: NoiseDensity | VolumeDensity = nested(
        NoiseDensity, VolumeDensity, about="where the texels come from")
    scale: Vec3 = vector(WHITE, "periods per metre (global media) or per unit of the local cube [0, 1]³", **RATE)
    bias: Vec3 = vector(BLACK, "offset of the texture coordinate, in periods", **RATE)
    scroll: Vec3 = vector(BLACK, "motion of the bias, in periods per second", **RATE)


@dataclass(frozen=True, kw_only=True)
class Medium(Record):
    """A participating medium without bounds."""

    name: str = text("", "for the reader")
    albedo: Rgb = vector(WHITE, "scattering over extinction", at_least=0.0, at_most=1.0)
    extinction: float | Rgb = vector(0.01, "extinction at density 1", unit="1/m", spread=True, at_least=0.0,
                                     within=(0.0, 1e12))
    emissive: Rgb = vector(
        BLACK, "emission at density 1 (see Settings: emission)", unit="W m^-3 sr^-1", **LIGHT)
    phase_anisotropy: float = number(0.0, "mean cosine g of the phase function", above=-1.0, below=1.0)
    height_fog: HeightFog | None = nested(
        HeightFog, default=None, optional=True, about="density that falls with height")
    density: DensityTexture | None = nested(
        DensityTexture, default=None, optional=True, about="density texture")


@dataclass(frozen=True, kw_only=True)
class LocalMedium(Medium):
    """A medium inside a box or ellipsoid; its height fog and texture see local space mapped to [0, 1]³."""

    shape: str = choice("box", "ellipsoid", default="box",
                        about="|p| ≤ 1 on each axis, or p·p ≤ 1, in local space")
    transform: Transform = nested(Transform, default=Transform(), about="world_from_local")
