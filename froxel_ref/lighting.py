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
    PHASE,
    cornette_shanks,
    henyey_greenstein,
    isotropic,
    phase,
    rayleigh,
    schlick,
    two_lobe_henyey_greenstein,
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

Type: TypeAlias = "np.dtype[np.floating[Any]]"

# The largest 2|g|/(1−|g|)² (|g| ≤ 0.61) for which d + s is formed as it stands. Where it cancels, the
# rounding of d enters the phase function with 1½ times this factor: up to 12 ulp, about what a ray
# direction rounded to the same type costs there. Above, four more passes keep all digits.
PLAIN = 8.0

# Elements of a block. More than elsewhere (blocks.BLOCK): a light costs some 25 short calls, between
# which threads wait for each other; see benchmarks/in_scattering.py.
SIZE = 65536

CONSTANT_AMBIENT = 1.0 / (4.0 * math.pi * math.pi)


class Lobe(NamedTuple):
    """A part of the scattering that has one phase function.

    Attributes
    ----------
    scattering : Field, shape (3, …) [m⁻¹]
        σ_s of this part.
    share : float
        Factor on the phase function.
    first : bool
        Whether it is the one to scatter what has no direction (of several with the same σ_s).
    name : str
        A key of `PHASE`.
    g : Field, shape (…)
        Phase anisotropy; one float64 number where it does not vary.
    careful : bool
        Henyey–Greenstein only: whether d + s must be formed without cancellation.
    """

    scattering: Field
    share: float
    first: bool
    name: str
    g: Field
    careful: bool

    @property
    def scaled(self) -> bool:
        """Whether the phase function's prefactor varies, so that lights are summed without it."""
        return self.name == "henyey_greenstein" and self.g.size > 1


class Sun(NamedTuple):
    """A directional light: its number, irradiance (3, 1, 1, 1), cos θ and 1 − cos θ per ray, (1, H, W)."""

    number: int
    irradiance: Field
    cosine: Field
    versine: Field


class Job(NamedTuple):
    """All that a block needs; ``skies`` is None where directional light varies along z."""

    froxels: Froxels
    vbuffer: VBuffer
    lobes: list[Lobe]
    suns: list[Sun]
    ambient: Field
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
    """Sum the light that each froxel scatters, or emits, towards the camera.

    Parameters
    ----------
    vbuffer : VBuffer
        Scattering, extinction, emission and phase anisotropy at the samples of ``froxels``, in its dtype.
    lights : sequence of Light
        All lights; their positions in it are the indices that ``visibility`` is called with.
    froxels : Froxels
        The grid; float64 or float32, which the result has too.
    ambient : (float, float, float) [W m⁻² sr⁻¹]
        Radiance L_a that arrives from every direction. It adds σ_s·L_a whatever the phase function.
    phase_function : str
        A key of `PHASE`.
    second_lobe : SecondLobe, optional
        For ``two_lobe_henyey_greenstein``; the default of `SecondLobe` unless given.
    emission : {"per_metre", "published", "absorption"}
        D2: "published" multiplies the V-Buffer's emission by σ_s; otherwise it is added as it is.
    attenuation : {"min_distance", "inverse_radius"}
        A6: see `froxel_ref.lights.smallest_d2`.
    ambient_term : {"scene", "constant"}
        A7: ``ambient``, or 1/(4π²) in every channel instead.
    exposure : float
        A12: factor on the result.
    visibility : callable, optional
        Called with a light's index and points, gives the share of it that arrives; 1 if not given.
    threads : int, optional
        Default: one for each core.
    block_size : int
        Froxels that are worked on at a time; the result does not depend on it.
    restrict : bool
        Whether to skip what a light does not reach; the result does not depend on it.

    Returns
    -------
    ndarray, shape (3, D, H, W) [W m⁻³ sr⁻¹]
        With axes of length 1 where nothing varies along them: (3, 1, H, W) for directional lights in a
        uniform medium, (3, 1, 1, 1) without lights.

    Raises
    ------
    InputError
        An unknown word for one of the switches; |g| above 1.

    Notes
    -----
    σ_s·(Σ_l p·Vis·E_l + L_a) + emission [Dörries 2020, listings 3.2 and 3.7, with its emission at D2].
    A point light's share of it for Henyey–Greenstein, with v = d(1 − cos θ) = d + s, is
    p/d² = (1+|g|)/(4π(1−|g|)²)/(e·√(d·e)), e = d + 2|g|/(1−|g|)²·v, g < 0 with s mirrored: two roots and
    one division a froxel. v is formed as h²/(d+|s|) + (s+|s|) where g asks for it (see ``PLAIN``). At a
    light itself cos θ = 0; g is taken no nearer to ±1 than the dtype's last number below 1. Distances are
    right up to 1e9 light radii (float32; 1e70 in float64), beyond which a light without a window is 0.

    Examples
    --------
    >>> from types import SimpleNamespace
    >>> from froxel_ref.grid import make_froxels
    >>> from froxel_ref.scene import Camera
    >>> from froxel_ref.settings import Grid
    >>> fog = SimpleNamespace(
    ...     scattering=np.full((3, 1, 1, 1), 0.5), extinction=np.full((1, 1, 1), 0.5), lobes=(),
    ...     emission=np.zeros((3, 1, 1, 1)), phase_anisotropy=np.zeros((1, 1, 1)))
    >>> froxels = make_froxels(Camera(), Grid(width=4, height=2, depth=8))
    >>> in_scattering(fog, [], froxels, ambient=(1.0, 2.0, 3.0)).ravel().tolist()
    [0.5, 1.0, 1.5]
    """
    for switch, word in (("emission", emission), ("attenuation", attenuation), ("ambient", ambient_term)):
        if word not in SWITCHES[switch]:
            raise InputError(switch, f"is {word!r}; {suggest(word, set(SWITCHES[switch]))}")
    if phase_function not in PHASE:
        raise InputError("phase_function", f"is {phase_function!r}; {suggest(phase_function, PHASE)}")
    job = _prepare(
        vbuffer, lights, froxels, phase_function, second_lobe, attenuation, restrict,
        (CONSTANT_AMBIENT,) * 3 if ambient_term == "constant" else ambient)
    job = job._replace(emission=emission, exposure=exposure, visibility=visibility)
    job = job._replace(skies=[None if _along_z(job, lobe) else _sky(job, lobe, lobe.g) for lobe in job.lobes])
    shape = _shape(job)
    result = np.empty((3, *shape), froxels.depths.dtype)
    memory = threading.local()
    blocks.run(lambda part: _fill(job, result, memory, *part), blocks.blocks(*shape, size=block_size),
               threads=threads)
    return result


# --- what there is to do ----------------------------------------------------------------------------


def _prepare(vbuffer: VBuffer, lights: Sequence[Light], froxels: Froxels, phase_function: str,
             second_lobe: SecondLobe | None, attenuation: str, restrict: bool, ambient: Rgb) -> Job:
    """What does not depend on the block."""
    dtype = froxels.depths.dtype
    lobes = _lobes(vbuffer, phase_function, second_lobe, dtype)
    suns = [_sun(i, light, froxels) for i, light in enumerate(lights) if isinstance(light, DirectionalLight)]
    lamps = light_rays(
        {i: light for i, light in enumerate(lights) if not isinstance(light, DirectionalLight)},
        froxels, attenuation=attenuation, restrict=restrict)
    units = {lamp.unit for lamp in lamps}
    depths = {size: (froxels.depths.astype(np.float64) / size).astype(dtype) for size in units}
    colours = [[_channels(lamp.intensity * _factor(lobe, lamp), dtype) for lamp in lamps] for lobe in lobes]
    return Job(froxels, vbuffer, lobes, suns, _channels(ambient, dtype), [], lamps, colours, depths,
               "per_metre", 1.0, None)


def _lobes(vbuffer: VBuffer, name: str, second: SecondLobe | None, dtype: Type) -> list[Lobe]:
    """The parts of the scattering, each with one phase function."""
    parts = vbuffer.lobes or ((vbuffer.scattering, vbuffer.phase_anisotropy),)
    if name != "two_lobe_henyey_greenstein":
        return [_lobe(scattering, 1.0, True, name, g, dtype) for scattering, g in parts]
    other, result, name = second or SecondLobe(), [], "henyey_greenstein"
    for scattering, g in parts:
        result.append(_lobe(scattering, 1.0 - other.weight, True, name, g, dtype))
        result.append(_lobe(scattering, other.weight, False, name, other.phase_anisotropy, dtype))
    return result


def _lobe(scattering: Field, share: float, first: bool, name: str, g: Field | float, dtype: Type) -> Lobe:
    values = np.asarray(g)
    low, high = float(values.min()), float(values.max())
    largest = max(-low, high)
    if largest > 1.0:
        raise InputError("phase_anisotropy", f"is {largest:g} in size, must be below 1")
    inside = 1.0 - float(np.finfo(dtype).epsneg)
    if low == high or name in ("isotropic", "rayleigh"):
        values = np.clip(np.full((1, 1, 1), low), -inside, inside)
    elif largest > inside:
        values = np.clip(values, -inside, inside)
    if name == "henyey_greenstein" and largest == 0.0:
        name = "isotropic"
    return Lobe(scattering, share, first, name, values, 2.0 * largest > PLAIN * (1.0 - largest) ** 2)


def _sun(index: int, light: DirectionalLight, froxels: Froxels) -> Sun:
    """A directional light relative to each ray."""
    rays = froxels.rays
    x, y, z = (np.full((1, 1), c, rays.length.dtype) for c in unit(light.direction))
    V = (-rays.per_depth[0] / rays.length, -rays.per_depth[1] / rays.length, -rays.per_depth[2] / rays.length)
    return Sun(index, _channels(colour(light), rays.length.dtype),
               -dot(V, (x, y, z))[np.newaxis], versine(V, (x, y, z))[np.newaxis])


def _channels(values: Any, dtype: Type) -> Field:
    """Three numbers as (3, 1, 1, 1); what the dtype cannot hold becomes its largest number."""
    return np.asarray(np.minimum(values, np.finfo(dtype).max), dtype).reshape(3, 1, 1, 1)


def _factor(lobe: Lobe, lamp: LightRays) -> float:
    """What is constant in a lobe's phase function and, as `_reach` leaves it, in a light's window."""
    factor = lobe.share * (0.25 if lamp.windowed else 1.0)
    if lobe.name == "isotropic":
        return factor * 0.25 / math.pi
    if lobe.name == "henyey_greenstein" and not lobe.scaled:
        return factor * float(_prefactor(lobe.g)[0, 0, 0])
    return factor


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


def _along_z(job: Job, lobe: Lobe) -> bool:
    """Whether the directional part varies along z."""
    return bool(job.suns) and (job.visibility is not None or lobe.g.shape[0] > 1)


def _sky(job: Job, lobe: Lobe, g: Field, y: slice = slice(None), seen: Sequence[Field] = ()) -> Field:
    """Ambient and directional light scattered towards the camera, per σ_s."""
    total = job.ambient if lobe.first else np.zeros_like(job.ambient)
    for k, sun in enumerate(job.suns):
        value = phase(lobe.name, sun.cosine[:, y], g, versine=sun.versine[:, y])
        light = value * (sun.irradiance * lobe.share)
        total = total + (light * seen[k] if seen else light)
    return total


def _shape(job: Job) -> tuple[int, int, int]:
    """The axes along which the result varies."""
    rows, columns = job.froxels.rays.length.shape
    if job.lamps or (job.suns and job.visibility is not None):
        return job.froxels.depths.shape[0], rows, columns
    parts = [job.vbuffer.emission]
    for lobe, sky in zip(job.lobes, job.skies, strict=True):
        parts += [lobe.scattering, sky] if sky is not None else [lobe.scattering, lobe.g, job.suns[0].cosine]
    depth, height, width = np.broadcast_shapes(*(part.shape[-3:] for part in parts))
    return depth, height, width


# --- a block ----------------------------------------------------------------------------------------


def _part(field: Field, z: slice, y: slice) -> Field:
    """A block of a field, whose length-1 axes stay as they are."""
    every = slice(None)
    return field[..., z if field.shape[-3] > 1 else every, y if field.shape[-2] > 1 else every, :]


def _fill(job: Job, result: Field, memory: threading.local, z: slice, y: slice) -> None:
    """Work out one block of the result."""
    with np.errstate(over="ignore", under="ignore"):  # what overflows lies beyond a light's window
        target = result[:, z, y]
        lights = [target] + [np.empty_like(target) for _ in job.lobes[1:]]
        skies = [_block_sky(job, lobe, z, y) if sky is None else _part(sky, z, y)
                 for lobe, sky in zip(job.lobes, job.skies, strict=True)]
        for lobe, sky, light in zip(job.lobes, skies, lights, strict=True):
            light[...] = 0.0 if lobe.scaled else sky
        if job.lamps:
            _add_lamps(job, lights, memory, z, y)
        for lobe, sky, light in zip(job.lobes, skies, lights, strict=True):
            if lobe.scaled:
                light *= _prefactor(_part(lobe.g, z, y))
                light += sky
            if job.emission == "published" and lobe.first:
                light += _part(job.vbuffer.emission, z, y)
            light *= _part(lobe.scattering, z, y)
        for light in lights[1:]:
            target += light
        if job.emission != "published":
            target += _part(job.vbuffer.emission, z, y)
        if job.exposure != 1.0:
            target *= job.exposure


def _block_sky(job: Job, lobe: Lobe, z: slice, y: slice) -> Field:
    """Ambient and directional light in a block, where it varies along z."""
    seen: list[Field] = []
    if job.visibility is not None:
        points = froxel_points(job.froxels, z, y)
        seen = [job.visibility(sun.number, points) for sun in job.suns]
    return _sky(job, lobe, _part(lobe.g, z, y), y, seen)


# --- point and spot lights --------------------------------------------------------------------------


class Terms(NamedTuple):
    """A lobe's terms in a block: g itself, 2|g|/(1−|g|)², and the sign of g where it varies or is −1."""

    g: Field
    slope: Field
    sign: Field | None


class Work(NamedTuple):
    """One light in one block: where it is, in the grid and in the block, and arrays of that shape.

    ``s``, ``d`` and ``reach`` are the light's, the others are for free use.
    """

    area: Rect
    here: Rect
    across2: Field
    s: Field
    d: Field
    reach: Field
    v: Field
    w: Field
    rgb: Field


def _add_lamps(job: Job, lights: list[Field], memory: threading.local, z: slice, y: slice) -> None:
    """Add what point and spot lights give a block, per σ_s and varying prefactor."""
    shape, dtype = lights[0].shape[1:], lights[0].dtype
    scratch = _scratch(memory, 9 * lights[0][0].size, dtype)
    along = scratch[-lights[0][0].size:].reshape(shape)
    terms = [_terms(lobe, z, y, shape, dtype) for lobe in job.lobes]
    measured = 0.0
    for k, lamp in enumerate(job.lamps):
        area = rect(lamp.boxes, z, y)
        if area is None:
            continue
        if lamp.unit != measured:
            measured = lamp.unit
            np.multiply(job.depths[measured][z], job.froxels.rays.length[y], out=along)
        work = _reach(job, lamp, area, along, scratch, z, y)
        for lobe, term, colours, light in zip(job.lobes, terms, job.colours, lights, strict=True):
            _weigh(lobe, _inside(term, work.here), work)
            np.multiply(work.w, colours[k], out=work.rgb)
            light[:, *work.here] += work.rgb


def _scratch(memory: threading.local, count: int, dtype: Type) -> Field:
    """Memory that a thread uses block after block: fresh memory costs more than the arithmetic."""
    if getattr(memory, "array", np.empty(0)).size < count:
        memory.array = np.empty(count, dtype)
    array: Field = memory.array
    return array[:count]


def _terms(lobe: Lobe, z: slice, y: slice, shape: tuple[int, ...], dtype: Type) -> Terms:
    if lobe.g.size == 1:
        sign = np.full((1, 1, 1), -1.0, dtype) if lobe.g[0, 0, 0] < 0.0 else None
        return Terms(lobe.g, _slope(lobe.g).astype(dtype), sign)
    g = _part(lobe.g, z, y)
    sign = np.broadcast_to(np.copysign(np.ones((), dtype), g), shape) if (g < 0.0).any() else None
    return Terms(np.broadcast_to(g, shape), np.broadcast_to(_slope(g), shape), sign)


def _inside(terms: Terms, here: Rect) -> Terms:
    """The terms in a part of the block."""
    if terms.g.size == 1:
        return terms
    return Terms(terms.g[here], terms.slope[here], None if terms.sign is None else terms.sign[here])


def _reach(job: Job, lamp: LightRays, area: Rect, along: Field, scratch: Field, z: slice, y: slice) -> Work:
    """Distances to a light, and what its window, cone and visibility leave of it (four times the window)."""
    az, ay, ax = area
    here = slice(az.start - z.start, az.stop - z.start), slice(ay.start - y.start, ay.stop - y.start), ax
    t = along[here]
    buffers = scratch[:8 * t.size].reshape(8, *t.shape)
    s, d, reach, v, w = buffers[:5]
    top, left = lamp.corner
    rays = slice(ay.start - top, ay.stop - top), slice(ax.start - left, ax.stop - left)
    work = Work(area, here, lamp.across2[rays], s, d, reach, v, w, buffers[5:])
    np.subtract(t, lamp.nearest[rays], out=s)
    np.multiply(s, s, out=reach)
    np.add(reach, work.across2, out=reach)
    np.sqrt(reach, out=d)
    close = rect(lamp.close, az, ay)
    bound = None if close is None else _bound(work, close, lamp.smallest)
    if lamp.windowed:  # sat(x) as (x + |x|)/2, for NumPy's maximum takes three times as long
        np.multiply(reach, reach, out=reach)
        np.subtract(1.0, reach, out=reach)
        np.abs(reach, out=v)
        np.add(reach, v, out=reach)
        np.multiply(reach, reach, out=reach)
    else:
        reach.fill(1.0)
    if bound is not None:
        reach[bound[0]] *= bound[1]
    if lamp.cone is not None:
        np.multiply(s, lamp.cone.slope[rays], out=v)
        np.add(v, lamp.cone.start[rays], out=v)
        np.divide(v, d, out=v)
        np.add(v, lamp.cone.offset, out=v)
        np.clip(v, 0.0, 1.0, out=v)
        np.multiply(v, v, out=v)
        np.multiply(reach, v, out=reach)
    if job.visibility is not None:
        reach *= job.visibility(lamp.number, froxel_points(job.froxels, az, ay, ax))
    return work


def _bound(work: Work, close: Rect, smallest: float) -> tuple[Rect, Field] | None:
    """d²/max(d², d_min²) where a light is that close; exactly 1 everywhere else."""
    offsets = [a.start for a in work.area]
    starts = [max(c.start, a.start) - o for c, a, o in zip(close, work.area, offsets, strict=True)]
    stops = [min(c.stop, a.stop) - o for c, a, o in zip(close, work.area, offsets, strict=True)]
    z, y, x = (slice(start, stop) for start, stop in zip(starts, stops, strict=True))
    if x.start >= x.stop:
        return None
    d2 = work.reach[z, y, x]
    limits = np.finfo(d2.dtype)
    return (z, y, x), d2 / np.maximum(d2, min(max(smallest, float(limits.tiny)), float(limits.max)))


def _weigh(lobe: Lobe, terms: Terms, work: Work) -> None:
    """``w`` = reach/d² times the phase function, without its prefactor for Henyey–Greenstein."""
    s, d, v, w = work.s, work.d, work.v, work.w
    if lobe.name == "isotropic":
        np.multiply(d, d, out=w)
        np.divide(work.reach, w, out=w)
    elif lobe.name == "henyey_greenstein":
        _turned(lobe, terms, work)
        np.multiply(v, terms.slope, out=v)
        np.add(v, d, out=v)
        np.multiply(d, v, out=w)
        np.sqrt(w, out=w)
        np.multiply(w, v, out=w)
        np.divide(work.reach, w, out=w)
    else:
        _turned(lobe._replace(careful=True), terms._replace(sign=None), work)
        np.divide(v, d, out=v)
        value = phase(lobe.name, np.divide(s, d) * -1.0, terms.g, versine=v)
        np.multiply(d, d, out=w)
        np.divide(work.reach, w, out=w)
        np.multiply(w, value, out=w)


def _turned(lobe: Lobe, terms: Terms, work: Work) -> None:
    """``v`` = d·(1 − cos θ), or d·(1 + cos θ) where g < 0: d + s, s mirrored."""
    s, d, v, w = work.s, work.d, work.v, work.w
    if lobe.careful:
        np.abs(s, out=v)
        np.add(v, d, out=w)
        np.divide(work.across2, w, out=w)
        turned = s if terms.sign is None else s * terms.sign
        np.add(v, turned, out=v)
        np.add(v, w, out=v)
    elif terms.sign is None:
        np.add(d, s, out=v)
    else:
        np.multiply(s, terms.sign, out=v)
        np.add(d, v, out=v)
