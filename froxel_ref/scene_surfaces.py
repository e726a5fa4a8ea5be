"""Surfaces, opaque and transparent, and images that stand for them, as validated records."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from froxel_ref.kinds import flag, integer, nested, number, text, vector
from froxel_ref.records import Record
from froxel_ref.scene_space import BLACK, PLACE, RATE, SIZE, Rgb, Transform, Vec3, must_point

__all__ = [
    "Box", "Folds", "HeightField", "HeightsFile", "ImageBuffers", "Mesh", "Plane", "Sphere", "Surface",
    "TransparentSurface",
]


@dataclass(frozen=True, kw_only=True)
class Plane(Record):
    """An infinite Lambert plane, seen from both sides."""

    kind: ClassVar[str] = "plane"
    name: str = text("", "for the reader")
    albedo: Rgb = vector((0.5, 0.5, 0.5), "Lambert reflectance", at_least=0.0, at_most=1.0)
    point: Vec3 = vector(BLACK, "a point of the plane", **PLACE)
    normal: Vec3 = vector((0.0, 1.0, 0.0), "its normal", **RATE)
    casts_shadows: bool = flag(True, "whether it hides lights from what lies behind it")

    def check_together(self) -> None:
        must_point(self.normal, "normal")


@dataclass(frozen=True, kw_only=True)
class Box(Record):
    """The Lambert surface of the cube [−1, 1]³ under a transform."""

    kind: ClassVar[str] = "box"
    name: str = text("", "for the reader")
    albedo: Rgb = vector((0.5, 0.5, 0.5), "Lambert reflectance", at_least=0.0, at_most=1.0)
    transform: Transform = nested(Transform, default=Transform(), about="world_from_local")
    casts_shadows: bool = flag(True, "whether it hides lights from what lies behind it")


@dataclass(frozen=True, kw_only=True)
class Sphere(Record):
    """A Lambert sphere."""

    kind: ClassVar[str] = "sphere"
    name: str = text("", "for the reader")
    albedo: Rgb = vector((0.5, 0.5, 0.5), "Lambert reflectance", at_least=0.0, at_most=1.0)
    center: Vec3 = vector(BLACK, "its centre", **PLACE)
    radius: float = number(1.0, "its radius", **SIZE)
    casts_shadows: bool = flag(True, "whether it hides lights from what lies behind it")


@dataclass(frozen=True, kw_only=True)
class Folds(Record):
    """Heights of a hanging curtain: h = sin(2π·folds·x) · (1 + ½ sin(2π·(y + x)))/1.5, for x, y in [0, 1]."""

    kind: ClassVar[str] = "folds"
    folds: int = integer(6, "waves across", at_least=1, at_most=256)
    size: int = integer(65, "samples along x", at_least=2, at_most=4097)


@dataclass(frozen=True, kw_only=True)
class HeightsFile(Record):
    """Heights from a ``.npy`` file of shape (rows, columns)."""

    kind: ClassVar[str] = "file"
    path: str = text(about="file, relative to the scene's folder")


@dataclass(frozen=True, kw_only=True)
class HeightField(Record):
    """A Lambert surface z = h(x, y) over [−1, 1]² in local space: two triangles a cell, two-sided."""

    kind: ClassVar[str] = "height_field"
    name: str = text("", "for the reader")
    albedo: Rgb = vector((0.5, 0.5, 0.5), "Lambert reflectance", at_least=0.0, at_most=1.0)
    heights: Folds | HeightsFile = nested(Folds, HeightsFile, about="where the heights come from")
    transform: Transform = nested(Transform, default=Transform(), about="world_from_local")
    casts_shadows: bool = flag(True, "whether it hides lights from what lies behind it")


@dataclass(frozen=True, kw_only=True)
class Mesh(Record):
    """A Lambert triangle mesh from a file (needs the extra ``mesh``)."""

    kind: ClassVar[str] = "mesh"
    name: str = text("", "for the reader")
    albedo: Rgb = vector((0.5, 0.5, 0.5), "Lambert reflectance", at_least=0.0, at_most=1.0)
    path: str = text(about=".obj, .ply or .glb file, relative to the scene's folder")
    transform: Transform = nested(Transform, default=Transform(), about="world_from_local")
    casts_shadows: bool = flag(True, "whether it hides lights from what lies behind it")


Surface = Plane | Box | Sphere | HeightField | Mesh


@dataclass(frozen=True, kw_only=True)
class TransparentSurface(Record):
    """A surface that lets light of what lies behind it through, fogged at its own depth; it hides no light."""

    surface: Surface = nested(Plane, Box, Sphere, HeightField, Mesh, about="its shape and albedo")
    opacity: float = number(0.3, "share of what lies behind it that it hides", at_least=0.0, at_most=1.0)

    @property
    def visible(self) -> bool:
        """Whether it shows in the image."""
        return self.opacity > 0.0


@dataclass(frozen=True, kw_only=True)
class ImageBuffers(Record):
    """A depth buffer and a colour image made elsewhere, instead of surfaces."""

    depth: str = text(about=".npy, shape (height, width): view depth in metres, +inf where there is nothing")
    radiance: str | None = text(None, ".npy, shape (height, width, 3): radiance without fog", optional=True)
