"""The kernels that `froxel_ref.stability` measures: each as computed, and as it is defined, in many digits.

To add one, write its definition as a function of an mpmath context and exact inputs, and `register` it.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from froxel_ref.arrays import Field
from froxel_ref.compensated import double_double, two_product
from froxel_ref.density import density, place
from froxel_ref.geometry import Rays
from froxel_ref.grid import depth_to_slice, slice_to_depth
from froxel_ref.kernel_registry import Kernel, Parameter, for_each, register
from froxel_ref.lights import cone_attenuation, distance_attenuation
from froxel_ref.media import albedo_of
from froxel_ref.optical_depth import Lines, column, medium_path
from froxel_ref.phase import cornette_shanks, henyey_greenstein, rayleigh, schlick, two_lobe_henyey_greenstein
from froxel_ref.scene import DirectionalLight, HeightFog, Medium, PointLight, SpotLight
from froxel_ref.settings import Grid, SecondLobe
from froxel_ref.storage import store
from froxel_ref.sun_rays import sun_light, sun_rays
from froxel_ref.tonemap import FLOAT16_LARGEST_LUMA, inverse_tone_map, tone_map

__all__: list[str] = []

Digits = Any
NEXT = 1.0 - 2.0**-52
TWO = ("float64", "float32")


# --- phase functions --------------------------------------------------------------------------------

COSINE = Parameter("cos θ", "1", "cosine", -1.0, 1.0, (-1.0, 0.0, 0.5, NEXT, 1.0), 0.5)
SHAPE = Parameter("g", "1", "share", -1.0, 1.0, (0.0, -0.5, 0.97, NEXT, -NEXT), 0.7)


def _exact_lobe(mp: Digits, cosine: Any, g: Any) -> Any:
    return (1 - g * g) / (4 * mp.pi * (1 + g * g - 2 * g * cosine) ** mp.mpf("1.5"))


def _exact_schlick(mp: Digits, cosine: Any, g: Any) -> Any:
    h, fit = abs(g), mp.mpf("0.55")
    rest = (1 - h) * max(1 - fit * h - fit * h * h, mp.mpf("0.0595"))
    k = mp.sign(g) * (1 - rest)
    return (1 - k * k) / (4 * mp.pi * (1 - k * cosine) ** 2)


def _textbook_lobe(cosine: Field, g: Field) -> Field:
    one = cosine.dtype.type(1.0)
    return (one - g * g) / (cosine.dtype.type(4.0 * math.pi) * np.power(one + g * g - 2 * g * cosine, 1.5))


register(Kernel(
    "henyey_greenstein", "phase functions", "Henyey-Greenstein's lobe from cos θ", (COSINE, SHAPE),
    {"corrected": henyey_greenstein, "textbook": _textbook_lobe}, _exact_lobe,
    departure="textbook: 1 + g² − 2g cos θ as it stands"))
register(Kernel(
    "henyey_greenstein_versine", "phase functions", "the same from 1 − cos θ, as along rays", (
        Parameter("1 − cos θ", "1", "magnitude", 1e-30, 2.0, (0.0, 1e-30, 1e-16, 1e-8, 2.0), 1e-3),
        Parameter("g", "1", "share", 0.0, 1.0, (0.0, 0.5, 0.97, NEXT), 0.7)),
    {"corrected": lambda v, g: henyey_greenstein(1 - v, g, versine=v),
     "from_cosine": lambda v, g: henyey_greenstein(1 - v, g)},
    lambda mp, v, g: (1 - g * g) / (4 * mp.pi * ((1 - g) ** 2 + 2 * g * v) ** mp.mpf("1.5")),
    departure="from_cosine: 1 − cos θ from a rounded cos θ"))
register(Kernel(
    "two_lobe_henyey_greenstein", "phase functions", "two lobes, the second with g = −0.3 and share 0.3",
    (COSINE, SHAPE), {"corrected": two_lobe_henyey_greenstein},
    lambda mp, c, g: (1 - mp.mpf(SecondLobe().weight)) * _exact_lobe(mp, c, g) + mp.mpf(SecondLobe().weight)
    * _exact_lobe(mp, c, mp.mpf(SecondLobe().phase_anisotropy))))
register(Kernel(
    "cornette_shanks", "phase functions", "Cornette and Shanks", (COSINE, SHAPE),
    {"corrected": cornette_shanks},
    lambda mp, c, g: mp.mpf(3) / 2 * (1 + c * c) / (2 + g * g) * _exact_lobe(mp, c, g)))
register(Kernel(
    "schlick", "phase functions", "Schlick's lobe", (COSINE, SHAPE),
    {"corrected": schlick, "published": lambda c, g: schlick(c, g, fit="published"),
     "kosian": lambda c, g: schlick(c, g, sign="kosian")}, _exact_schlick,
    departure="S1: published fit of k exceeds 1; D14: kosian has the opposite sign"))
register(Kernel(
    "rayleigh", "phase functions", "Rayleigh scattering", (COSINE,), {"corrected": rayleigh},
    lambda mp, c: 3 / (16 * mp.pi) * (1 + c * c), at_most=3.0 / (8.0 * math.pi)))


def _sun(offset: Field, g: Field) -> Field:
    def one(value: float, across: Field) -> Field:
        zero = np.zeros((1, len(across)), across.dtype)
        rays = Rays((0.0, 0.0, 0.0), (across[None], zero, zero - 1), np.sqrt(1 + across[None] * across[None]))
        sun = sun_rays(0, DirectionalLight(direction=(0.0, 0.0, -1.0), irradiance=(1.0, 1.0, 1.0)), rays)
        light: Field = sun_light(sun, "henyey_greenstein", np.full((1, 1, 1), value))[0, 0, 0]
        return light
    return for_each(g, one, offset)


register(Kernel(
    "sun_along_rays", "phase functions", "a sun's light turned into rays beside it, Henyey-Greenstein", (
        Parameter("offset of the ray", "m/m", "magnitude", 1e-12, 1e3, (0.0, 1e-30, 1e-8, 1.0, 1e3)),
        Parameter("g", "1", "choice", 1e-9, 1.0, (0.0, -0.5, 0.5, 0.9, 0.99, 1 - 2.0**-20), 0.5)),
    {"corrected": _sun}, lambda mp, x, g: _exact_lobe(mp, 1 / mp.sqrt(1 + x * x), g)))


# --- attenuation and height fog ---------------------------------------------------------------------

DISTANCE2 = Parameter("squared distance", "m²", "magnitude", 1e-18, 1e18,
                      (0.0, 5e-324, 1e-18, 1e-4, 1.0, 100.0 * NEXT, 100.0, 1e18))
REACH = Parameter("radius", "m", "choice", 1e-3, 1e9, (1e-3, 1.0, 10.0, 1e9), 10.0)


def _lamp(radius: float, falloff: str = "windowed") -> PointLight:
    return PointLight(position=(0.0, 0.0, 0.0), intensity=(1.0, 1.0, 1.0), radius=radius, falloff=falloff)


def _exact_window(mp: Digits, d2: Any, radius: Any) -> Any:
    return (1 - min(d2 / radius**2, mp.mpf(1)) ** 2) ** 2 / max(d2, mp.mpf("1e-4"))


register(Kernel(
    "distance_attenuation", "attenuation", "windowed inverse square", (DISTANCE2, REACH),
    {"corrected": lambda d2, r: for_each(r, lambda x, d: distance_attenuation(d, _lamp(x)), d2),
     "author": lambda d2, r: for_each(
         r, lambda x, d: distance_attenuation(d, _lamp(x), attenuation="inverse_radius"), d2)},
    _exact_window, departure="A6: d² at least 1/radius²", falling=0,
    at_most=lambda d2, r: np.full_like(d2, 1e4)))
register(Kernel(
    "inverse_square", "attenuation", "inverse square without a window", (DISTANCE2,),
    {"corrected": lambda d2: distance_attenuation(d2, _lamp(10.0, "inverse_square"))},
    lambda mp, d2: 1 / max(d2, mp.mpf("1e-4")), falling=0, at_most=lambda d2: np.full_like(d2, 1e4)))


def _exact_cone(mp: Digits, cosine: Any, outer: Any) -> Any:
    wide, narrow = mp.cos(outer * mp.pi / 180), mp.cos(outer * mp.pi / 360)
    return min(max((cosine - wide) / (narrow - wide), mp.mpf(0)), mp.mpf(1)) ** 2


def _cone(cosine: Field, outer: Field) -> Field:
    def one(angle: float, c: Field) -> Field:
        return cone_attenuation(c, SpotLight(position=(0.0, 0.0, 0.0), intensity=(1.0, 1.0, 1.0),
                                             inner_angle=angle / 2.0, outer_angle=angle))
    return for_each(outer, one, cosine)


register(Kernel(
    "cone_attenuation", "attenuation", "spot light, inner angle half of the outer", (
        COSINE, Parameter("outer angle", "degrees", "choice", 0.125, 89.0, (0.125, 1.0, 30.0, 89.0), 30.0)),
    {"corrected": _cone}, _exact_cone, at_most=1.0))


def _fog(height: Field, falloff: Field) -> Field:
    def one(rate: float, y: Field) -> Field:
        medium = Medium(extinction=1.0, height_fog=HeightFog(start=1.0, falloff=rate))
        return density(medium, (np.zeros_like(y), y, np.zeros_like(y)))
    return for_each(falloff, one, height)


register(Kernel(
    "height_fog", "media", "density of height fog that starts at 1 m", (
        Parameter("height", "m", "magnitude", 1e-9, 1e9, (0.0, 1.0, 1.0 + 2.0**-23, 10.0, 1e9), 3.0),
        Parameter("falloff", "1/m", "choice", 1e-9, 1e8, (0.0, 1e-9, 0.125, 1.0, 1e8), 0.125)),
    {"corrected": _fog}, lambda mp, y, k: mp.exp(-k * max(y - 1, mp.mpf(0))), at_most=1.0, falling=0))


RATE = 0.125  # falloff; the ray begins 1 m above the fog's start


def _fog_column(distance: Field, rise: Field) -> Field:
    fog = Medium(extinction=1.0, height_fog=HeightFog(start=1.0, falloff=RATE))
    nothing = np.zeros_like(rise)
    lines = Lines(np.stack([nothing, nothing + 2.0, nothing]),
                  np.stack([np.sqrt(1.0 - rise * rise), rise, nothing]),
                  nothing, np.full_like(rise, np.inf))
    return np.asarray(column(medium_path(place(fog), lines), distance[:, None])[:, 0])


def _exact_column(mp: Digits, distance: Any, rise: Any) -> Any:
    rate = mp.mpf(RATE)
    inside = min(distance, -1 / rise) if rise < 0 else distance  # where the density is not 1
    x = rate * rise
    falling = mp.exp(-rate) * (-mp.expm1(-x * inside) / x if x else inside)
    return falling + (distance - inside)


register(Kernel(
    "height_fog_column", "media", "density of height fog integrated along a ray", (
        Parameter("distance", "m", "magnitude", 1e-9, 1e9, (0.0, 1e-9, 1.0, 64.0, 1e9)),
        Parameter("rise of the ray", "m/m", "choice", -1.0, 1.0,
                  (-1.0, -0.5, -1e-9, 0.0, 1e-9, 0.5, 1.0), 0.5)),
    {"corrected": _fog_column}, _exact_column, at_most=lambda t, rise: t, precisions=("float64",)))

DENSE = Parameter("extinction", "1/m", "magnitude", 1e-300, 1e8, (0.0, 5e-324, 1e-5, 1.0, 1e8), 0.05)


def _albedo(at_zero: str) -> Callable[[Field, Field], Field]:
    return lambda share, sigma: albedo_of(np.stack([share * sigma] * 3), sigma, at_zero=at_zero)[0]


register(Kernel(
    "albedo", "media", "albedo from scattering, itself albedo times extinction", (
        Parameter("albedo", "1", "share", 0.0, 1.0, (0.0, 0.5, NEXT), 0.5), DENSE),
    {"corrected": _albedo("zero"), "published": _albedo("divide")},
    lambda mp, share, sigma: share if sigma else mp.mpf(0), departure="D1: 0/0 where there is nothing",
    at_most=1.0,
    # A product among the denormals has lost its digits, whatever is done with it afterwards.
    condition=lambda share, sigma: np.where(share * sigma > 1e-37, 1.0, 1e16)))


# --- slice distributions ----------------------------------------------------------------------------

FAR = 64.0
NEAR = Parameter("near plane", "m", "choice", 1e-6, 32.0, (1e-6, 1e-3, 0.5, 32.0), 0.5)
COUNT = Parameter("slices", "1", "choice", 1.0, 4096.0, (1.0, 64.0, 4096.0), 64.0, whole=True)
PLACE = Parameter("place in the grid", "1", "share", 0.0, 1.0, (0.0, 2.0**-30, 0.5, NEXT), 0.5)
DEPTH = Parameter("view depth", "m", "magnitude", 1e-6, 1e6,
                  (1e-6, 0.5, 0.5 + 2.0**-24, 1.0, 63.0, 64.0, 1e9))


def _depth(distribution: str) -> Callable[[Field, Field, Field], Field]:
    def one(near: float, place: Any, count: Any) -> Field:
        return for_each(count, lambda n, u: slice_to_depth(
            u.astype(np.float64) * n, Grid(depth=int(n), near=near, far=FAR,
                        distribution=distribution)), place)
    return lambda place, near, count: for_each(near, one, place, count)


def _slice(distribution: str) -> Callable[[Field, Field, Field], Field]:
    def one(near: float, z: Any, count: Any) -> Field:
        return for_each(count, lambda n, depth: np.abs(depth_to_slice(
            depth, Grid(depth=int(n), near=near, far=FAR, distribution=distribution))), z)
    return lambda z, near, count: for_each(near, one, z, count)


for _name, _there, _back in (
        ("exponential", lambda mp, u, near: near * (FAR / near) ** u,
         lambda mp, z, near: abs(mp.log(z / near) / mp.log(FAR / near))),
        ("linear", lambda mp, u, near: near + (FAR - near) * u,
         lambda mp, z, near: abs((z - near) / (FAR - near)))):
    register(Kernel(
        f"{_name}_depth", "slice distributions", f"depth from slice, {_name}, far plane at 64 m",
        (PLACE, NEAR, COUNT), {"corrected": _depth(_name)},
        lambda mp, u, near, n, there=_there: there(mp, u, near),
        at_most=lambda u, near, n: np.full_like(u, FAR)))
    register(Kernel(
        f"{_name}_slice", "slice distributions", f"distance from slice 0 by depth, {_name}",
        (DEPTH, NEAR, COUNT), {"corrected": _slice(_name)},
        lambda mp, z, near, n, back=_back: n * back(mp, z, near)))


# --- tone map ---------------------------------------------------------------------------------------

BRIGHT = (0.0, 1e-30, 1.0, 2047.0, 4095.0, 65504.0, 3e38)
RED = Parameter("red", "W m⁻² sr⁻¹", "magnitude", 1e-10, 1e30, BRIGHT)
GREEN = Parameter("green and blue", "W m⁻² sr⁻¹", "magnitude", 1e-10, 1e30, BRIGHT)


def _colour(red: Field, green: Field) -> Field:
    return np.stack([red, green, green])


def _exact_luma(mp: Digits, red: Any, green: Any) -> Any:
    return mp.mpf("0.2126") * red + mp.mpf("0.7874") * green


def _round_trip(red: Field, green: Field, *, largest: float | None = None,
                store: Callable[[Field], Field]) -> Field:
    if largest is None:  # the largest number below 1 that what stores in between can hold
        edge = float(store(np.ones(1, red.dtype) - np.finfo(red.dtype).epsneg)[0])
        largest = edge if edge < 1.0 else FLOAT16_LARGEST_LUMA
    back: Field = inverse_tone_map(store(tone_map(_colour(red, green))), largest_luma=largest)
    return np.asarray(back[0])


register(Kernel(
    "tone_map", "tone map", "c/(1 + luma)", (RED, GREEN),
    {"corrected": lambda r, g: tone_map(_colour(r, g))[0]},
    lambda mp, r, g: r / (1 + _exact_luma(mp, r, g)), at_most=lambda r, g: np.full_like(r, 1.0 / 0.2126)))
register(Kernel(
    "inverse_tone_map", "tone map", "c/(1 − luma)", (
        Parameter("red", "1", "share", 0.0, 1.0, (0.0, 0.5, NEXT), 0.5),
        Parameter("green and blue", "1", "share", 0.0, 1.0, (0.0, 0.5, NEXT), 0.5)),
    {"corrected": lambda r, g: inverse_tone_map(_colour(r, g))[0],
     "published": lambda r, g: inverse_tone_map(_colour(r, g), largest_luma=1.0)[0]},
    lambda mp, r, g: r / (1 - _exact_luma(mp, r, g)), departure="D9: singular at luma 1"))
register(Kernel(
    "tone_map_round_trip", "tone map", "there, stored, and back", (
        Parameter("red", "W m⁻² sr⁻¹", "magnitude", 1e-3, 1e9, (0.0, 1.0, 2047.0, 4095.0, 65504.0)),
        Parameter("green and blue", "W m⁻² sr⁻¹", "magnitude", 1e-3, 1e9,
                  (0.0, 1.0, 2047.0, 4095.0, 65504.0))),
    {"corrected": _round_trip, "published": lambda r, g, store: _round_trip(r, g, largest=1.0, store=store)},
    lambda mp, r, g: r, departure="D9: stored in float16, luma reaches 1", stores_between=True,
    condition=lambda r, g: 1.0 + 0.2126 * r + 0.7874 * g))


# --- storage and compensated arithmetic -------------------------------------------------------------


def _exact_float(mp: Digits, x: Any, mantissa: int) -> Any:
    """The number of a half-like format next to x, ties to even; beyond the largest, infinity in float16."""
    most = (2 - mp.ldexp(1, -mantissa)) * mp.ldexp(1, 15)
    unit = mp.ldexp(1, max(int(mp.frexp(x)[1]) - 1, -14) - mantissa) if x else mp.mpf(1)
    steps = mp.floor(x / unit)
    rest = x / unit - steps
    up = rest > 0.5 or (rest == 0.5 and steps % 2 == 1)
    rounded = (steps + 1 if up else steps) * unit
    return rounded if rounded <= most else (mp.inf if mantissa == 10 else most)


STORED = Parameter("value", "1", "magnitude", 1e-9, 1e6, (
    0.0, 5e-324, 2.0**-25, 2.0**-24, 2.0**-14, 1.0 + 2.0**-11, 65504.0, 65519.0, 65520.0, 1e30), 1.0)


def _red(values: Field) -> Field:
    return np.asarray(store(np.stack([values] * 3), "r11g11b10f")[0])


for _format, _form, _exact in (
        ("float16", lambda x: store(x, "float16"), lambda mp, x: _exact_float(mp, x, 10)),
        ("r11g11b10f", _red, lambda mp, x: _exact_float(mp, x, 6)),
        ("unorm8", lambda x: store(x, "unorm8"), lambda mp, x: mp.floor(min(x, mp.mpf(1)) * 255 + 0.5) / 255),
        ("unorm16", lambda x: store(x, "unorm16"),
         lambda mp, x: mp.floor(min(x, mp.mpf(1)) * 65535 + 0.5) / 65535)):
    register(Kernel(
        f"store_{_format}", "storage", f"to the nearest of {_format}", (STORED,),
        {"corrected": _form}, _exact,
        precisions=TWO, smooth=False))

WIDE = Parameter("a", "1", "magnitude", 1e-120, 1e120, (1e-120, 1.0, NEXT, 1e120))
OTHER = WIDE._replace(name="b")


def _root(a: Field, b: Field) -> Field:
    x, y = double_double(a), double_double(b)
    return (x * x + y * y).sqrt().high


register(Kernel(
    "compensated_length", "compensated arithmetic", "√(a² + b²) in twice the digits", (WIDE, OTHER),
    {"compensated": _root, "plain": lambda a, b: np.sqrt(a * a + b * b)},
    lambda mp, a, b: mp.sqrt(a * a + b * b), departure="plain: float64", precisions=("float64",)))
register(Kernel(
    "product_error", "compensated arithmetic", "|a·b − round(a·b)|, which must be exact", (WIDE, OTHER),
    {"compensated": lambda a, b: np.abs(two_product(a, b)[1]), "plain": lambda a, b: np.zeros_like(a)},
    lambda mp, a, b: abs(a * b - mp.mpf(float(a) * float(b))), departure="plain: float64 cannot see it",
    precisions=("float64",), smooth=False))
