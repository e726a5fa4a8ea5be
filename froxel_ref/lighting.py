"""In-scattering: the light that each froxel sends towards the camera, per metre of the way.

σ_s·(Σ_l p·Vis·E_l + ambient) + emission, block by block. What a point or spot light adds is worked out
along the ray (`froxel_ref.light_rays`), only where the light reaches, in arrays that stay in the cache.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias

import numpy as np

from froxel_ref import blocks
from froxel_ref.arrays import Field, Points
from froxel_ref.geometry import dot
from froxel_ref.grid import Froxels, froxel_points
from froxel_ref.light_rays import LightRays, Rect, light_rays, rect
from froxel_ref.lights import colour, unit
from froxel_ref.phase import (
    PHASE, cornette_shanks, henyey_greenstein, isotropic, phase, rayleigh, schlick, two_lobe_henyey_greenstein,
    versine,
)
from froxel_ref.records import InputError, suggest
from froxel_ref.scene import DirectionalLight, Light, Rgb
from froxel_ref.settings import SWITCHES, SecondLobe

if TYPE_CHECKING:
    from froxel_ref.media import VBuffer

__all__ = [
    "PHASE", "Visibility", "cornette_shanks", "henyey_greenstein", "in_scattering", "isotropic", "phase",
    "rayleigh", "schlick", "two_lobe_henyey_greenstein", "versine",
]

Visibility: TypeAlias = Callable[[int, Points], Field]
"""What share of a light (its index) arrives at points: broadcastable to them, in [0, 1]."""

# The largest 2|g|/(1−|g|)² (|g| ≤ 0.61) for which d + s is formed as it stands. Where it cancels, the
# rounding of d enters the phase function with 1½ times this factor: up to 12 ulp, about what a ray
# direction rounded to the same type costs there. Above, four more passes keep all digits.
PLAIN = 8.0

SIZE = 16384
CONSTANT_AMBIENT = 1.0 / (4.0 * math.pi * math.pi)


class Lobe(NamedTuple):
    """A part of the scattering that has one phase function.

    Attributes
    ----------
    scattering : Field, shape (3, …) [m⁻¹]
        σ_s of this part.
    share : float
        Of the phase function.
    ambient : Field, shape (3, 1, 1, 1) [W m⁻² sr⁻¹]
        Isotropic radiance that this part scatters.
    name : str
        A key of `PHASE`.
    g : Field, shape (…)
        Phase anisotropy.
    careful : bool
        Henyey–Greenstein only: whether d + s must be formed without cancellation.
    """

    scattering: Field
    share: float
    ambient: Field
    name: str
    g: Field
    careful: bool


class Sun(NamedTuple):
    """A directional light: its index, irradiance (3, 1, 1, 1), cos θ and 1 − cos θ per ray, (1, H, W)."""

    index: int
    irradiance: Field
    cosine: Field
    versine: Field


class Job(NamedTuple):
    """All that a block needs."""

    froxels: Froxels
    vbuffer: VBuffer
    lobes: list[Lobe]
    suns: list[Sun]
    skies: list[Field | None]
    lamps: list[LightRays]
    colours: list[list[Field]]
    depths: dict[float, Field]
    emission: str
    exposure: float
    visibility: Visibility | None


def in_scattering(
    vbuffer: VBuffer, lights: Sequence[Light], froxels: Froxels, *, ambient: Rgb = (0.0, 0.0, 0.0),
    phase_function: str = "henyey_greenstein", second_lobe: SecondLobe | None = None,
    emission: str = "per_metre", attenuation: str = "min_distance", ambient_term: str = "scene",
    exposure: float = 1.0, visibility: Visibility | None = None, threads: int | None = None,
    block_size: int = SIZE, restrict: bool = True,
) -> Field:
    """TBD."""
    for name, word in (("emission", emission), ("attenuation", attenuation), ("ambient", ambient_term)):
        if word not in SWITCHES[name]:
            raise InputError(name, f"is {word!r}; {suggest(word, set(SWITCHES[name]))}")
    if phase_function not in PHASE:
        raise InputError("phase_function", f"is {phase_function!r}; {suggest(phase_function, PHASE)}")
    dtype = froxels.depths.dtype
    sky = np.array((CONSTANT_AMBIENT,) * 3 if ambient_term == "constant" else ambient, dtype).reshape(3, 1, 1, 1)
    lobes = _lobes(vbuffer, phase_function, second_lobe, sky)
    suns = [_sun(i, light, froxels) for i, light in enumerate(lights) if isinstance(light, DirectionalLight)]
    lamps = light_rays({i: light for i, light in enumerate(lights) if not isinstance(light, DirectionalLight)},
                       froxels, attenuation=attenuation, restrict=restrict)
    skies = [None if _in_blocks(lobe, suns, visibility) else _sky(lobe, lobe.g, suns) for lobe in lobes]
    job = Job(froxels, vbuffer, lobes, suns, skies, lamps, [_colours(lobe, lamps, dtype) for lobe in lobes],
              {lamp.unit: (froxels.depths.astype(np.float64) / lamp.unit).astype(dtype) for lamp in lamps},
              emission, exposure, visibility)
    shape = _shape(job)
    result = np.empty((3, *shape), dtype)
    memory = threading.local()
    with np.errstate(all="raise"):
        blocks.run(lambda part: _fill(job, result, memory, *part), blocks.blocks(*shape, size=block_size),
                   threads=threads)
    return result


# --- what to do -------------------------------------------------------------------------------------


def _lobes(vbuffer: VBuffer, name: str, second: SecondLobe | None, ambient: Field) -> list[Lobe]:
    """The parts of the scattering, each with one phase function."""
    parts = vbuffer.lobes or ((vbuffer.scattering, vbuffer.phase_anisotropy),)
    if name != "two_lobe_henyey_greenstein":
        return [_lobe(scattering, 1.0, ambient, name, g) for scattering, g in parts]
    other, result, name = second or SecondLobe(), [], "henyey_greenstein"
    for scattering, g in parts:
        result.append(_lobe(scattering, 1.0 - other.weight, ambient, name, g))
        result.append(_lobe(scattering, other.weight, ambient * 0, name, other.phase_anisotropy))
    return result


def _lobe(scattering: Field, share: float, ambient: Field, name: str, g: Field | float) -> Lobe:
    values = np.asarray(g)
    if values.size == 1 or name in ("isotropic", "rayleigh") or values.min() == values.max():
        # In float64, where a single g near ±1 keeps its digits.
        values = values.reshape(-1)[:1].astype(np.float64).reshape(1, 1, 1)
    if name == "henyey_greenstein" and not values.any():
        name = "isotropic"
    largest = float(np.abs(values).max())
    return Lobe(scattering, share, ambient, name, values, 2.0 * largest > PLAIN * (1.0 - largest) ** 2)


def _sun(index: int, light: DirectionalLight, froxels: Froxels) -> Sun:
    """A directional light relative to each ray."""
    rays = froxels.rays
    L = tuple(np.full((1, 1), c, rays.length.dtype) for c in unit(light.direction))
    V = tuple(-c / rays.length for c in rays.per_depth)
    cosine, small = -dot(V, L), versine(V, L)  # type: ignore[arg-type]
    return Sun(index, _channels(colour(light), rays.length.dtype), cosine[np.newaxis], small[np.newaxis])


def _channels(values: Any, dtype: np.dtype[Any]) -> Field:
    """Three numbers as (3, 1, 1, 1); what the dtype cannot hold becomes its largest number."""
    return np.minimum(values, np.finfo(dtype).max).astype(dtype).reshape(3, 1, 1, 1)


def _in_blocks(lobe: Lobe, suns: list[Sun], visibility: Visibility | None) -> bool:
    """Whether the directional part varies along z."""
    return bool(suns) and (visibility is not None or lobe.g.shape[0] > 1)


def _sky(lobe: Lobe, g: Field, suns: list[Sun], y: slice = slice(None), seen: Sequence[Field] = ()) -> Field:
    """Ambient and directional light scattered towards the camera, per σ_s."""
    total = lobe.ambient
    for k, sun in enumerate(suns):
        value = phase(lobe.name, sun.cosine[:, y], g, versine=sun.versine[:, y]) * lobe.share
        total = total + value * sun.irradiance * (seen[k] if seen else 1.0)
    return total


def _colours(lobe: Lobe, lamps: list[LightRays], dtype: np.dtype[Any]) -> list[Field]:
    """Intensities with all constant factors of the phase function."""
    factor = lobe.share*.25
    if lobe.name == "isotropic":
        factor *= 0.25 / math.pi
    elif lobe.name == "henyey_greenstein" and lobe.g.size == 1:
        factor *= float(_prefactor(lobe.g)[0, 0, 0])
    return [_channels(lamp.intensity * factor, dtype) for lamp in lamps]


def _prefactor(g: Field) -> Field:
    """(1 − g²)/(4π(1 − |g|)³)."""
    size = np.abs(g)
    rest = 1.0 - size
    return np.asarray((1.0 + size) / (4.0 * math.pi * rest * rest))


def _slope(g: Field) -> Field:
    """2|g|/(1 − |g|)²."""
    size = np.abs(g)
    rest = 1.0 - size
    return np.asarray(2.0 * size / (rest * rest))


def _shape(job: Job) -> tuple[int, int, int]:
    """The axes along which the result varies."""
    if job.lamps or (job.suns and job.visibility is not None):
        return (job.froxels.depths.shape[0], *job.froxels.rays.length.shape)  # type: ignore[return-value]
    parts = [job.vbuffer.emission]
    for lobe, sky in zip(job.lobes, job.skies, strict=True):
        parts += [lobe.scattering, sky] if sky is not None else [lobe.scattering, lobe.g, job.suns[0].cosine]
    if job.emission == "absorption":
        parts.append(job.vbuffer.extinction)
    return np.broadcast_shapes(*(part.shape for part in parts))[-3:]  # type: ignore[return-value]


# --- a block ----------------------------------------------------------------------------------------


def _part(field: Field, z: slice, y: slice) -> Field:
    """A block of a field, whose length-1 axes stay as they are."""
    return field[..., z if field.shape[-3] > 1 else slice(None), y if field.shape[-2] > 1 else slice(None), :]


def _fill(job: Job, result: Field, memory: threading.local, z: slice, y: slice) -> None:
    """Work out one block of the result."""
    with np.errstate(over="ignore", under="ignore"):
        target = _part(result, z, y)
        lights = [target] + [np.empty_like(target) for _ in job.lobes[1:]]
        for lobe, sky, light in zip(job.lobes, job.skies, lights, strict=True):
            light[...] = 0.0
        if job.lamps:
            _add_lamps(job, lights, memory, z, y)
        for lobe, sky, light in zip(job.lobes, job.skies, lights, strict=True):
            if job.lamps and lobe.name == "henyey_greenstein" and lobe.g.size > 1:
                light *= _prefactor(_part(lobe.g, z, y))
            light += _block_sky(job, lobe, z, y) if sky is None else _part(sky, z, y)
            if job.emission == "published" and lobe.ambient is not None:
                light += _part(job.vbuffer.emission, z, y)
            light *= _part(lobe.scattering, z, y)
            if light is not target:
                target += light
        if job.emission != "published" and job.vbuffer.emission.any():
            target += _part(job.vbuffer.emission, z, y)
        if job.exposure != 1.0:
            target *= job.exposure


def _block_sky(job: Job, lobe: Lobe, z: slice, y: slice) -> Field:
    seen = []
    if job.visibility is not None:
        points = froxel_points(job.froxels, z, y)
        seen = [job.visibility(sun.index, points) for sun in job.suns]
    return _sky(lobe, _part(lobe.g, z, y), job.suns, y, seen)


def _scratch(memory: threading.local, count: int, dtype: np.dtype[Any]) -> Field:
    """Memory that a thread uses again and again."""
    if getattr(memory, "array", np.empty(0)).size < count:
        memory.array = np.empty(count, dtype)
    return memory.array


def _add_lamps(job: Job, lights: list[Field], memory: threading.local, z: slice, y: slice) -> None:
    """Add what point and spot lights give a block, per σ_s and (varying) prefactor."""
    count = lights[0][0].size
    dtype = lights[0].dtype
    scratch = _scratch(memory, 9 * count, dtype)
    along = scratch[8 * count:9 * count].reshape(lights[0].shape[1:])
    terms = [_terms(lobe, z, y, dtype) for lobe in job.lobes]
    size = 0.0
    for k, lamp in enumerate(job.lamps):
        area = rect(lamp.boxes, z, y)
        if area is None:
            continue
        if lamp.unit != size:
            size = lamp.unit
            np.multiply(job.depths[size][z], job.froxels.rays.length[y], out=along)
        az, ay, ax = area
        here = slice(az.start - z.start, az.stop - z.start), slice(ay.start - y.start, ay.stop - y.start), ax
        _add_lamp(job, k, lamp, along[here], area, here, terms, lights, scratch)


def _terms(lobe: Lobe, z: slice, y: slice, dtype) -> tuple[Any, Any]:
    if lobe.name != "henyey_greenstein":
        return None, None
    if lobe.g.size == 1:
        return dtype.type(_slope(lobe.g)[0, 0, 0]), bool(lobe.g[0, 0, 0] < 0)
    g = _part(lobe.g, z, y)
    sign = np.copysign(dtype.type(1), g) if (g < 0).any() else False
    return _slope(g), sign


def _add_lamp(job, k, lamp, t, area, here, terms, lights, scratch):
    az, ay, ax = area
    shape = t.shape
    n = t.size
    buffers = scratch[:8 * n].reshape(8, *shape)
    s, d, u, v, w = buffers[:5]
    rgb = buffers[5:]
    top, left = lamp.corner
    rays = slice(ay.start - top, ay.stop - top), slice(ax.start - left, ax.stop - left)
    np.subtract(t, lamp.nearest[rays], out=s)
    np.multiply(s, s, out=u)
    np.add(u, lamp.across2[rays], out=u)
    np.sqrt(u, out=d)
    close = rect(lamp.close, az, ay)
    if lamp.windowed:
        np.multiply(u, u, out=u)
        np.subtract(1.0, u, out=u)
        np.abs(u, out=v)
        np.add(u, v, out=u)
        np.multiply(u, u, out=u)
    else:
        u.fill(1.0)
    for lobe, (slope, sign), colours, light in zip(job.lobes, terms, job.colours, lights):
        if lobe.careful:
            np.abs(s, out=v)
            np.add(v, d, out=w)
            np.divide(lamp.across2[rays], w, out=w)
            np.add(v, s, out=v)
            np.add(v, w, out=v)
        else:
            np.add(s, d, out=v)
        np.multiply(v, slope, out=v)
        np.add(v, d, out=v)
        np.multiply(d, v, out=w)
        np.sqrt(w, out=w)
        np.multiply(w, v, out=w)
        np.divide(u, w, out=w)
        np.multiply(w, colours[k], out=rgb)
        acc = light[(slice(None), *here)]
        np.add(acc, rgb, out=acc)
