"""What is in the world: cameras, media, lights, surfaces and particles as frozen, validated records.

Units: metres, degrees, linear RGB. Radiance is in W m⁻² sr⁻¹, irradiance in W m⁻², radiant intensity
in W sr⁻¹, extinction in m⁻¹. The world is right-handed with +y up (see CONVENTIONS.md). Scenes are
data: the files they name are read by `froxel_ref.assets`, the arrays they describe are made by the stages.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from froxel_ref.kinds import choice, flag, integer, many, nested, number, text, vector
from froxel_ref.records import InputError, Record, kinds_of

Rgb = tuple[float, float, float]
Vec3 = tuple[float, float, float]
BLACK: Rgb = (0.0, 0.0, 0.0)
WHITE: Rgb = (1.0, 1.0, 1.0)

# Nothing is farther, larger, smaller or brighter than this: far beyond what a scene needs (a light year has
# 1e16 m, a hair 1e-4), and near enough that no square, fourth power or product of the stages' leaves the
# range of float32, where a frame would turn into infinities and NaN without a word.
LONGEST, SHORTEST, STRONGEST = 1e10, 1e-9, 1e18
RATE: dict[str, Any] = {"within": (-LONGEST, LONGEST)}
PLACE: dict[str, Any] = {"unit": "m", "within": (-LONGEST, LONGEST)}
SIZE: dict[str, Any] = {"unit": "m", "above": 0.0, "within": (SHORTEST, LONGEST)}
LIGHT: dict[str, Any] = {"at_least": 0.0, "within": (0.0, STRONGEST)}

# A transform whose smallest scale is below this share of its largest is refused as singular: float64
# could still invert it, but a point would lose half of its digits on the way.
SINGULAR = 1e-8

# Vectors that are normalised, and transforms, keep between 1/WIDEST and WIDEST, where squares and
# products of three neither overflow nor underflow.
WIDEST = 1e100


def _must_point(direction: tuple[float, ...], name: str) -> None:
    if not any(direction):
        raise InputError(name, "is zero, must point somewhere")
    if not 1 / WIDEST < math.hypot(*direction) < WIDEST:
        raise InputError(name, f"has length {math.hypot(*direction):g}, must be within {1 / WIDEST:g} and "
                               f"{WIDEST:g}")


def _unit(direction: tuple[float, ...]) -> tuple[float, ...]:
    length = math.hypot(*direction)
    return tuple(component / length for component in direction)


@dataclass(frozen=True, kw_only=True)
class Camera(Record):
    """A pinhole camera and the size of its image."""

    position: Vec3 = vector((0.0, 1.7, 0.0), "world position", **PLACE)
    target: Vec3 = vector((0.0, 1.7, -1.0), "world point in the centre of the image", **PLACE)
    up: Vec3 = vector((0.0, 1.0, 0.0), "direction that is up in the image", **RATE)
    vertical_fov: float = number(60.0, "vertical field of view", unit="degrees", above=0.0, below=180.0,
                                 within=(0.001, 179.9))
    width: int = integer(960, "image width", unit="pixels", at_least=1, at_most=16384)
    height: int = integer(540, "image height", unit="pixels", at_least=1, at_most=16384)
    exposure: float = number(1.0, "factor on radiance for display", above=0.0, within=(SHORTEST, LONGEST))

    def check_together(self) -> None:
        if self.target == self.position:
            raise InputError("target", "is the camera's position, must be another point")
        forward = tuple(b - a for a, b in zip(self.position, self.target, strict=True))
        _must_point(forward, "target")
        _must_point(self.up, "up")
        across = np.cross(_unit(forward), _unit(self.up))
        if not float(np.linalg.norm(across)) > SINGULAR:
            raise InputError("up", "is along the view direction, must be across it")


# --- placing things ---------------------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True)
class Transform(Record):
    """An affine map from local space to the world: first scale, then rotate, then translate."""

    translate: Vec3 = vector(BLACK, "world position of the local origin", **PLACE)
    rotate: Vec3 = vector(BLACK, "turns about the world's x, then y, then z axis", unit="degrees", **RATE)
    scale: Vec3 = vector(WHITE, "metres per local unit along each local axis (half the extent)", **PLACE)
    matrix: tuple[float, ...] | None = vector(
        None, "instead of the three above: world_from_local as 12 numbers, its 3 rows of 4 one after the other",
        length=12, optional=True, **RATE)

    def check_together(self) -> None:
        if self.matrix is not None and (self.translate, self.rotate, self.scale) != (BLACK, BLACK, WHITE):
            raise InputError("matrix", "is given beside translate, rotate or scale, must stand for all three")
        place = "scale" if self.matrix is None else "matrix"
        linear = self.world_from_local[:3, :3]
        largest = float(np.abs(linear).max())
        if largest and not 1 / WIDEST < largest < WIDEST:
            raise InputError(
                place, f"has a largest entry of {largest:g}, must be within {1 / WIDEST:g} and {WIDEST:g}")
        sizes = np.linalg.svd(linear / (largest or 1.0), compute_uv=False)
        if not sizes[-1] > SINGULAR * sizes[0]:
            raise InputError(place, "makes the transform singular, must span all three axes")

    @property
    def world_from_local(self) -> NDArray[np.float64]:
        """The matrix, shape (4, 4), float64."""
        result = np.eye(4)
        if self.matrix is not None:
            result[:3] = np.reshape(self.matrix, (3, 4))
            return result
        turn = np.eye(3)
        for axis, degrees in enumerate(self.rotate):
            c, s = _cos_sin(degrees)
            step = np.eye(3)
            i, j = (axis + 1) % 3, (axis + 2) % 3
            step[[i, i, j, j], [i, j, i, j]] = c, -s, s, c
            turn = step @ turn
        result[:3, :3] = turn * self.scale
        result[:3, 3] = self.translate
        return result


def _cos_sin(degrees: float) -> tuple[float, float]:
    """Exact at multiples of 90°, so that axis-aligned things stay axis-aligned."""
    quarter = {0.0: (1.0, 0.0), 90.0: (0.0, 1.0), 180.0: (-1.0, 0.0), 270.0: (0.0, -1.0)}
    angle = np.deg2rad(degrees)
    return quarter.get(degrees % 360.0, (float(np.cos(angle)), float(np.sin(angle))))


# --- participating media ----------------------------------------------------------------------------


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


# --- lights -----------------------------------------------------------------------------------------


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
        _must_point(self.direction, "direction")


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
        _must_point(self.direction, "direction")
        inner, outer = _cos_sin(self.inner_angle)[0], _cos_sin(self.outer_angle)[0]
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


# --- surfaces ---------------------------------------------------------------------------------------


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
        _must_point(self.normal, "normal")


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
class ImageBuffers(Record):
    """A depth buffer and a colour image made elsewhere, instead of surfaces."""

    depth: str = text(about=".npy, shape (height, width): view depth in metres, +inf where there is nothing")
    radiance: str | None = text(None, ".npy, shape (height, width, 3): radiance without fog", optional=True)


# --- particles --------------------------------------------------------------------------------------


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


# --- the whole --------------------------------------------------------------------------------------


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
    ambient: Rgb = vector(
        BLACK, "radiance that arrives from every direction", unit="W m^-2 sr^-1", **LIGHT)
    background: Rgb = vector(BLACK, "radiance where a ray hits nothing", unit="W m^-2 sr^-1", **LIGHT)

    def check_together(self) -> None:
        if self.image_buffers is not None and self.surfaces:
            raise InputError("image_buffers", "is given beside surfaces, must be given instead of them")

    @property
    def all_lights(self) -> tuple[Light, ...]:
        """The lights, then the extra ones."""
        return self.lights + self.extra_lights.lights()

    @property
    def all_particles(self) -> tuple[Particle, ...]:
        """The particles in order, each cloud's in its place."""
        return tuple(particle for each in self.particles
                     for particle in (each.particles() if isinstance(each, ParticleCloud) else (each,)))
