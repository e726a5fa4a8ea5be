"""Light and transmittance beyond the froxels' far end: a march along each ray, to be laid behind the fog.

Froxels end at a view depth of some 64 m. What lies behind is marched in a few steps from there to the surface:
directional lights, ambient light and global media only, at half the image's resolution
(`froxel_ref.bilateral`). Densities are means over the steps, in closed form but for textures, so that only
shadows, textures and mixtures of media are left for the steps to resolve.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from types import MappingProxyType
from typing import NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from froxel_ref import blocks
from froxel_ref.arrays import Field, Points, Visibility
from froxel_ref.density import Placed, density_at, place
from froxel_ref.geometry import Lines, Rays
from froxel_ref.integrate import INTEGRATORS, slice_integral
from froxel_ref.lighting import CONSTANT_AMBIENT
from froxel_ref.lights import unit
from froxel_ref.media import Textures, contributing, media_at
from froxel_ref.optical_depth import MediumPath, column, extinctions, line_points, medium_path
from froxel_ref.records import InputError, shown, suggest
from froxel_ref.scene import DirectionalLight, Medium, Scene
from froxel_ref.settings import Settings
from froxel_ref.sun_rays import SunRays, sun_light, sun_rays

__all__ = ["DENSITIES", "LongRange", "combine", "march_long_range", "sun_transmittance"]

Stretches = TypeVar("Stretches", Lines, MediumPath)

DENSITIES = ("mean", "sampled")
"""What a step takes for the density of a medium: see `march_long_range`."""

# Rays that are worked on at a time: ten float64 operands of a step then fit a core's cache.
RAYS = 8192

NO_TEXTURES: Textures = MappingProxyType({})


class LongRange(NamedTuple):
    """What lies between the froxels' far end and the surfaces.

    Attributes
    ----------
    radiance : ndarray, shape (3, h, w), or (3, 1, 1) of zeros
        [W m⁻² sr⁻¹] Light that leaves it towards the camera, as it arrives at the far end of the froxels.
    transmittance : ndarray, shape (h, w) or (3, h, w), or of ones with axes of length 1
        [1] What passes through all of it; three channels if a global medium's extinction is RGB.
    """

    radiance: Field
    transmittance: Field


# --- what all rays share ----------------------------------------------------------------------------


class _Matter(NamedTuple):
    """A global medium in place, and its material at density 1: (3,), (C,), (3,) and g."""

    placed: Placed
    scattering: Field
    extinction: Field
    emission: Field
    anisotropy: float

    @property
    def scatters(self) -> bool:
        return bool(self.scattering.any())


class _Lobe(NamedTuple):
    """A phase function with its share; its g is a number, or None for the mean of the scattering media's."""

    name: str
    share: float
    anisotropy: float | None
    members: tuple[int, ...]
    first: bool


class _Job(NamedTuple):
    """All that a block of rays needs."""

    matter: tuple[_Matter, ...]
    lobes: tuple[_Lobe, ...]
    suns: tuple[tuple[int, DirectionalLight], ...]
    ambient: Field
    settings: Settings
    origin: tuple[float, float, float]
    steps: int
    density: str
    visibility: Visibility
    dimmed: tuple[int, ...]
    sun_steps: int
    sun_distance: float


def _matter(media: Sequence[Medium], textures: Textures, settings: Settings) -> tuple[_Matter, ...]:
    factors, nowhere = extinctions(media), (np.zeros(1),) * 3
    found = []
    for medium, extinction in zip(media, factors, strict=True):
        plain = dataclasses.replace(medium, height_fog=None, density=None)
        material = media_at((plain,), nowhere, {}, settings)
        texels = None if medium.density is None else textures.get(medium.density.source)
        found.append(_Matter(place(medium, texels), material.scattering[:, 0].astype(np.float64), extinction,
                             material.emission[:, 0].astype(np.float64), medium.phase_anisotropy))
    return tuple(found)


def _lobes(matter: Sequence[_Matter], every: Sequence[Medium], settings: Settings) -> tuple[_Lobe, ...]:
    """The parts of the scattering (D12), each with one phase function."""
    scattering = tuple(i for i, each in enumerate(matter) if each.scatters)
    if not scattering:
        return ()
    distinct = list(dict.fromkeys(matter[i].anisotropy for i in scattering))
    groups: list[tuple[float | None, tuple[int, ...]]]
    if settings.phase_mixing == "mean":  # a global medium counts everywhere, whatever it adds
        values = [medium.phase_anisotropy for medium in every]
        mean = min(max(sum(values) / len(values), min(values)), max(values))
        groups = [(mean, scattering)]
    elif settings.phase_mixing == "mixture" or len(distinct) == 1:
        groups = [(g, tuple(i for i in scattering if matter[i].anisotropy == g)) for g in distinct]
    else:
        groups = [(None, scattering)]
    name, second = settings.phase_function, settings.second_lobe
    if name != "two_lobe_henyey_greenstein":
        return tuple(_Lobe(name, 1.0, g, members, True) for g, members in groups)
    name = "henyey_greenstein"
    return tuple(part for g, members in groups for part in (
        _Lobe(name, 1.0 - second.weight, g, members, True),
        _Lobe(name, second.weight, second.phase_anisotropy, members, False)))


# --- the march --------------------------------------------------------------------------------------


def march_long_range(
    depth: Field, rays: Rays, scene: Scene, *, farthest: float, textures: Textures = NO_TEXTURES,
    settings: Settings | None = None, steps: int = 16, jitter: Field | float = 0.5, density: str = "mean",
    visibility: Visibility | None = None, sun_steps: int = 0, sun_distance: float = np.inf,
    threads: int | None = None,
) -> LongRange:
    """Gather light and transmittance from the froxels' far end to the surface that each ray meets.

    Parameters
    ----------
    depth : ndarray, broadcastable to (h, w)
        [m] View depth of the surfaces, +inf where there is none; see `froxel_ref.bilateral.half_depth`.
    rays : Rays
        One for each texel of the result, shape (h, w); see `froxel_ref.bilateral.half_rays`. Its dtype is
        the result's; the arithmetic is in float64.
    scene : Scene
        Its global media, directional lights, ambient light and exposure. Local media, lamps and particles are
        left out [Dörries 2020, §3.2.8].
    farthest : float
        [m] View depth at which rays end that meet no surface: the camera's far plane in the thesis. At least
        the grid's far end.
    textures : mapping from NoiseDensity or VolumeDensity to ndarray, shape (nz, ny, nx)
        The texels of every density texture of the global media.
    settings : Settings, optional
        Its grid's far end, phase function, integrator, time, and the switches emission, phase_mixing,
        density_addressing, ambient and exposure; defaults unless given.
    steps : int, default 16
        Of equal length along each ray [Dörries 2020, §3.2.8].
    jitter : ndarray, broadcastable to (h, w), or float, in [0, 1); default ½
        Where in each step its sample lies: middles unless given, another number for every texel and frame to
        turn the error into noise.
    density : {"mean", "sampled"}, default "mean"
        A step's density of each medium: its mean over the step, in closed form but for a texture, which is
        sampled; or the density at the sample. Published: "sampled".
    visibility : mapping of int to callable, optional
        By the light's index in ``scene.all_lights``: given points, the share of the light that arrives
        (`froxel_ref.arrays.Visibility`). What shadow maps do not reach they must say to be lit (A4).
    sun_steps : int, default 0
        Steps of a second march to each directional light that casts shadows, for the shadows of the global media:
        see `sun_transmittance`. 0 leaves these shadows out, as published; any number will do without textures.
    sun_distance : float, default ∞
        [m] Length of that march.
    threads : int, optional
        Default: one per core. The result is the same to the last bit.

    Returns
    -------
    LongRange
        0 and 1 for rays whose surface lies within the froxels, which take no part. Length 1 along both axes of
        the image where there is nothing to gather.

    Raises
    ------
    InputError
        ``farthest`` not finite or nearer than the grid; no steps; jitter outside [0, 1); an unknown word;
        shapes that do not fit; a density texture without its texels.

    Notes
    -----
    Front to back over the steps, L += T·∫e^(−σx) S dx, T *= e^(−σd) [Dörries 2020, §3.2.8 and listing 3.4], with
    S = σ_s·(Σ_l p·Vis·E_l + L_a) + emission, each step as `froxel_ref.integrate.slice_integral` has it for
    ``settings.integrator`` ("linear" and "gauss", which need neighbours, count as "analytic").

    With mean densities the transmittance is exact but for textures, whatever the jitter and the number of steps. So is
    the light of one medium, or of several uniform ones, where no shadow falls. Everything else is of second order in
    the step for samples in the middle, where media, shadows and textures are smooth; of first order for any
    other jitter, and at the edges of shadows. With sampled densities uniform media alone are exact.

    A NaN depth is no surface beyond the froxels, and takes no part.

    Examples
    --------
    >>> from froxel_ref.geometry import camera_rays
    >>> from froxel_ref.settings import Grid
    >>> fog = Medium(albedo=(1.0, 1.0, 1.0), extinction=0.01)
    >>> scene = Scene(global_media=(fog,), ambient=(1.0, 2.0, 4.0))
    >>> rays = camera_rays(scene.camera, 1, 1)  # along the axis
    >>> how = Settings(grid=Grid(far=64.0))
    >>> there = march_long_range(np.array([[164.0]]), rays, scene, farthest=1000.0, settings=how)
    >>> print(there.radiance.ravel().round(6), there.transmittance.ravel().round(6))  # 1 − 1/e of the ambient light
    [0.632121 1.264241 2.528482] [0.367879]
    """
    settings = Settings() if settings is None else settings
    far = settings.grid.far
    _check(steps, density, sun_steps, sun_distance, settings)
    if not (np.isfinite(farthest) and farthest >= far):
        raise InputError("farthest", f"is {shown(farthest)} m, must be finite and at least the grid's far, {far:g} m")
    shape, dtype = rays.length.shape, rays.length.dtype
    ends = _fitting("depth", np.where(np.isposinf(depth), farthest, depth).astype(np.float64), shape)
    offset = _fitting("jitter", np.asarray(jitter, np.float64), shape)
    if not ((offset >= 0.0) & (offset < 1.0)).all():
        raise InputError("jitter", "must be at least 0 and below 1")
    media = contributing(scene.global_media)
    job = _job(scene, media, textures, settings, rays.origin, steps, density, visibility or {}, sun_steps, sun_distance)
    rows, columns = np.nonzero(ends > far)
    tint = (3,) if extinctions(media).shape[1] == 3 else ()
    lit, hazy = _lit(job), bool(media) or _dims_vacuum(settings)
    if not (rows.size and hazy):
        return LongRange(np.zeros((3, 1, 1), dtype), np.ones((*tint, 1, 1), dtype))
    light = np.zeros((3, *shape) if lit else (3, 1, 1), dtype)
    through = np.ones((*tint, *shape), dtype)
    exposure = scene.camera.exposure if settings.exposure == "lighting" else 1.0

    def work(chosen: slice) -> None:
        y, x = rows[chosen], columns[chosen]
        part = _gather_rays(rays, y, x)
        radiance, transmittance = _march(job, part, far, ends[y, x], offset[y, x], lit)
        if lit:
            light[:, y, x] = radiance * exposure
        through[..., y, x] = transmittance if tint else transmittance[0]

    blocks.run(work, [slice(i, i + RAYS) for i in range(0, rows.size, RAYS)], threads=threads)
    return LongRange(light, through)


def _check(steps: int, density: str, sun_steps: int, sun_distance: float, settings: Settings) -> None:
    if steps < 1:
        raise InputError("steps", f"is {shown(steps)}, must be at least 1")
    if density not in DENSITIES:
        raise InputError("density", f"is {density!r}; {suggest(density, DENSITIES)}")
    if sun_steps < 0:
        raise InputError("sun_steps", f"is {shown(sun_steps)}, must be at least 0")
    if not sun_distance > 0.0:
        raise InputError("sun_distance", f"is {shown(sun_distance)}, must be above 0 m")
    if settings.integrator not in INTEGRATORS:
        raise InputError("integrator", f"is {settings.integrator!r}; {suggest(settings.integrator, INTEGRATORS)}")


def _fitting(name: str, values: Field, shape: tuple[int, ...]) -> Field:
    try:
        return np.broadcast_to(values, shape)
    except ValueError:
        raise InputError(name, f"has shape {values.shape}, must fit that of the rays, {shape}") from None


def _job(scene: Scene, media: Sequence[Medium], textures: Textures, settings: Settings,
         origin: tuple[float, float, float], steps: int, density: str, visibility: Visibility, sun_steps: int,
         sun_distance: float) -> _Job:
    matter = _matter(media, textures, settings)
    suns = tuple((i, light) for i, light in enumerate(scene.all_lights)
                 if isinstance(light, DirectionalLight) and any(light.irradiance))
    ambient = (CONSTANT_AMBIENT,) * 3 if settings.ambient == "constant" else scene.ambient
    dimmed = tuple(i for i, light in suns if sun_steps and light.casts_shadows)
    return _Job(matter, _lobes(matter, scene.global_media, settings), suns, np.asarray(ambient, np.float64), settings,
                origin, steps, density, visibility, dimmed, sun_steps, sun_distance)


def _lit(job: _Job) -> bool:
    """Whether there is any light to gather."""
    scattering = any(each.scatters for each in job.matter)
    return bool(scattering and (job.suns or job.ambient.any())) or any(each.emission.any() for each in job.matter)


def _dims_vacuum(settings: Settings) -> bool:
    zero = np.zeros(1)
    return bool(slice_integral(zero, zero, np.ones(1), integrator=settings.integrator)[1][0] != 1.0)


def _gather_rays(rays: Rays, rows: NDArray[np.intp], columns: NDArray[np.intp]) -> Rays:
    """Some rays in a row, shape (1, n), in float64."""
    shape = rays.length.shape
    x, y, z = (np.broadcast_to(component, shape)[rows, columns][np.newaxis].astype(np.float64)
               for component in rays.per_depth)
    return Rays(rays.origin, (x, y, z), rays.length[rows, columns][np.newaxis].astype(np.float64))


def _march(job: _Job, rays: Rays, far: float, ends: Field, offset: Field, lit: bool) -> tuple[Field, Field]:
    """Radiance (3, n) and transmittance (C, n) along rays of shape (1, n)."""
    suns = [sun_rays(number, light, rays) for number, light in job.suns] if lit else []
    known: dict[int, list[Field]] = {}  # what suns give to lobes whose g is a number
    length, span = rays.length[0], ends - far
    light: Field = np.zeros((3, ends.size))
    through: Field = np.ones((1, ends.size))
    front: Field = np.full(ends.shape, far)
    for index in range(job.steps):
        back = ends if index == job.steps - 1 else far + span * ((index + 1) / job.steps)
        sample = np.clip(far + span * ((index + offset) / job.steps), front, back)
        points = _points(rays, sample)
        densities = [_density(job, each.placed, rays, front, back, points) for each in job.matter]
        extinction = _total(densities, [each.extinction for each in job.matter])
        source = _source(job, densities, suns, points, known) if lit else np.zeros((3, 1))
        with np.errstate(under="ignore"):
            integral, passing = slice_integral(source, extinction, (back - front) * length,
                                               integrator=job.settings.integrator)
            light = light + through * integral
            through = through * passing
        front = back
    return light, through


def _points(rays: Rays, sample: Field) -> Points:
    """World points at view depths of rays, each with the axes (1, 1, n)."""
    x, y, z = (start + step[np.newaxis] * sample for start, step in zip(rays.origin, rays.per_depth, strict=True))
    return x, y, z


def _total(densities: Sequence[Field], factors: Sequence[Field]) -> Field:
    """Σ factor·density, shape (C, n) or (C, 1)."""
    total: Field = np.zeros((1, 1))
    for density, factor in zip(densities, factors, strict=True):
        total = total + factor[:, np.newaxis] * density
    return total


# --- a step -----------------------------------------------------------------------------------------


def _density(job: _Job, placed: Placed, rays: Rays, front: Field, back: Field, points: Points) -> Field:
    """A medium's density in a step, shape (n,) or (1,)."""
    if job.density == "sampled":
        return np.asarray(_sampled(placed, points, job.settings)[0, 0])
    medium = placed.medium
    mean: Field = np.ones(1)
    if medium.height_fog is not None:
        lines = Lines(np.asarray(rays.origin)[:, np.newaxis], np.stack([c[0] for c in rays.per_depth]), front, back)
        with np.errstate(under="ignore"):
            stretch = column(medium_path(placed._replace(texture=None), lines), back[:, np.newaxis])[:, 0]
        mean = stretch / np.maximum(back - front, np.finfo(np.float64).tiny)
    if medium.density is None:
        return mean
    return np.asarray(mean * _sampled(_without_height(placed), points, job.settings)[0, 0])


def _sampled(placed: Placed, points: Points, settings: Settings) -> Field:
    value, _ = density_at(placed, points, time=settings.time, addressing=settings.density_addressing)
    return value


def _without_height(placed: Placed) -> Placed:
    return placed._replace(medium=dataclasses.replace(placed.medium, height_fog=None))


def _source(job: _Job, densities: Sequence[Field], suns: Sequence[SunRays], points: Points,
            known: dict[int, list[Field]]) -> Field:
    """Light per metre that a step sends towards the camera, (3, n) or (3, 1)."""
    published = job.settings.emission == "published"
    emission = _total(densities, [each.emission for each in job.matter])
    seen = {sun.number: _seen(job, sun.number, points) for sun in suns}
    total: Field = np.zeros((3, 1)) if published else emission
    for index, lobe in enumerate(job.lobes):
        chosen = [(densities[i], job.matter[i]) for i in lobe.members]
        scattering = _total([density for density, _ in chosen], [each.scattering for _, each in chosen])
        if lobe.anisotropy is None:
            arriving = [_turned(sun, lobe, _mean_anisotropy(chosen)) for sun in suns]
        else:
            if index not in known:
                known[index] = [_turned(sun, lobe, np.full(1, lobe.anisotropy)) for sun in suns]
            arriving = known[index]
        sky = job.ambient[:, np.newaxis] if lobe.first else np.zeros((3, 1))
        for sun, light in zip(suns, arriving, strict=True):
            sky = sky + light * seen[sun.number]
        if published and lobe.first:
            sky = sky + emission
        total = total + scattering * sky
    return total


def _turned(sun: SunRays, lobe: _Lobe, anisotropy: Field) -> Field:
    """A sun's light per unit of scattering, (3, n); g of shape (n,) or (1,)."""
    return sun_light(sun, lobe.name, anisotropy[np.newaxis, np.newaxis], share=lobe.share)[:, 0, 0]


def _mean_anisotropy(chosen: Sequence[tuple[Field, _Matter]]) -> Field:
    """g weighted by scattering, 0 where nothing scatters."""
    weights = [density * each.scattering.sum() for density, each in chosen]
    values = [each.anisotropy for _, each in chosen]
    whole = np.asarray(sum(weights))
    numerator = sum(weight * g for weight, g in zip(weights, values, strict=True))
    with np.errstate(invalid="ignore", divide="ignore"):
        ratio = np.where(whole > 0.0, numerator / whole, 0.0)
    return np.clip(ratio, min(0.0, *values), max(0.0, *values))


def _seen(job: _Job, number: int, points: Points) -> Field:
    """What arrives of a sun at a step's samples, (n,) or (C, n), with length 1 where nothing varies."""
    share: Field = np.ones(1)
    if number in job.visibility:
        found = np.asarray(job.visibility[number](points))
        share = np.broadcast_to(found, np.broadcast_shapes(found.shape, (1, 1, 1)))[0, 0]
    if number in job.dimmed:
        light = dict(job.suns)[number]
        share = share * sun_transmittance([each.placed for each in job.matter], light, points, settings=job.settings,
                                          steps=job.sun_steps, distance=job.sun_distance)[:, 0, 0]
    return share


# --- towards the sun --------------------------------------------------------------------------------


def sun_transmittance(media: Sequence[Placed], light: DirectionalLight, points: Points, *,
                      settings: Settings | None = None, steps: int = 16, distance: float = np.inf) -> Field:
    """What media let through of a directional light on its way to points, by a march.

    Parameters
    ----------
    media : sequence of Placed
        All media that dim.
    light : DirectionalLight
        Towards which.
    points : Points [m]
        Three arrays that broadcast together.
    settings : Settings, optional
        Its time and density_addressing; defaults unless given.
    steps : int, default 16
        For each medium with a texture.
    distance : float, default ∞
        [m] Length of the way.

    Returns
    -------
    ndarray, shape (C, …) [1]
        exp(−∫ σ_t); C = 3 if any medium's extinction is RGB, else 1.

    Raises
    ------
    InputError
        No steps.

    Notes
    -----
    Named by the thesis as an extension [Dörries 2020, §4.1.4], for which maps do not reach far enough. Media without
    a texture are in closed form. Through a texture the way is cut into steps, each a sample of the texture times the
    column of the height fog in it. Steps share the integral of √density evenly, so that fog which falls with
    height has most of them where it is dense, and the last reaches to infinity. Second order in 1/steps
    where the texture is smooth along the way.

    As in `froxel_ref.light_paths.light_transmittance`, which this converges to, a medium whose column towards the sun
    is infinite does not dim it.

    Examples
    --------
    >>> from froxel_ref.scene import HeightFog
    >>> fog = place(Medium(extinction=0.5, height_fog=HeightFog(start=0.0, falloff=0.25)))
    >>> sun = DirectionalLight(direction=(0.0, 1.0, 0.0), irradiance=(1.0, 1.0, 1.0))
    >>> x = np.zeros(1)
    >>> sun_transmittance([fog], sun, (x, x, x)).round(6), np.exp([-0.5 / 0.25]).round(6)
    (array([[0.135335]]), array([0.135335]))
    """
    if steps < 1:
        raise InputError("steps", f"is {shown(steps)}, must be at least 1")
    settings = Settings() if settings is None else settings
    dtype, shape = np.result_type(*points), np.broadcast_shapes(*(p.shape for p in points))
    origin = np.stack([np.broadcast_to(p, shape).reshape(-1).astype(np.float64) for p in points])
    towards = np.broadcast_to(np.asarray(unit(light.direction))[:, np.newaxis], origin.shape)
    count = origin.shape[1]
    lines = Lines(origin, towards, np.zeros(count), np.full(count, distance))
    factors = extinctions([placed.medium for placed in media])
    total = np.zeros((factors.shape[1], count))
    for placed, factor in zip(media, factors, strict=True):
        if not factor.any():
            continue
        path = medium_path(placed._replace(texture=None), lines)
        with np.errstate(invalid="ignore"):  # ∞ − ∞ along level lines without end
            whole = column(path, lines.stop[:, np.newaxis])[:, 0]
        whole = np.where(np.isfinite(whole), whole, 0.0)
        if placed.texture is not None:
            live = np.flatnonzero(whole)
            whole[live] = _textured_column(placed, _chosen(lines, live), _chosen(path, live), settings, steps)
        with np.errstate(over="ignore"):
            total += factor[:, np.newaxis] * whole
    with np.errstate(under="ignore"):
        return np.exp(-total).reshape(-1, *shape).astype(dtype, copy=False)


def _chosen(group: Stretches, rows: NDArray[np.intp]) -> Stretches:
    """Some lines of a group of arrays."""
    return type(group)._make(None if field is None else field[..., rows] for field in group)


def _textured_column(placed: Placed, lines: Lines, path: MediumPath, settings: Settings, steps: int) -> Field:
    """A texture's column, shape (n,); ``path`` has none, and a finite column above 0."""
    sparse, medium = path, placed.medium
    if medium.height_fog is not None:
        slower = dataclasses.replace(medium.height_fog, falloff=0.5 * medium.height_fog.falloff)
        sparse = medium_path(place(dataclasses.replace(medium, height_fog=slower, density=None)), lines)
    share = column(sparse, lines.stop[:, np.newaxis])[:, 0] / steps
    total: Field = np.zeros(share.shape)
    before: Field = np.zeros(share.shape)
    for index in range(steps):
        last = index == steps - 1
        back = lines.stop if last else _along(sparse, (index + 1.0) * share, steps * share)
        reached = column(path, back[:, np.newaxis])[:, 0]
        points = line_points(lines, _along(sparse, (index + 0.5) * share, steps * share))
        total = total + (reached - before) * _sampled(_without_height(placed), points, settings)
        before = reached
    return total


def _along(path: MediumPath, share: Field, whole: Field) -> Field:
    """Where a column has reached a share of the whole, shape (n,); the inverse of `column`."""
    flat, falling = path.flat_to - path.flat_from, path.fall_to - path.fall_from
    first = path.slope < 0.0  # fog that thickens along the line comes before its level part
    level = np.where(first, share - (whole - flat), share)
    slanted = np.maximum(np.where(first, share, share - flat), 0.0)
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        # ∫ e^(−u − kx) dx over [0, x] is e^(−u)·(1 − e^(−kx))/k.
        straight = slanted * np.exp(np.minimum(path.exponent, 700.0))
        bent = -np.log1p(-np.minimum(path.slope * straight, 1.0 - 2.0**-53)) / path.slope
        x = np.minimum(np.maximum(np.where(path.slope == 0.0, straight, bent), 0.0), falling)
    # Where there is no level part (flat is 0, which share − whole + flat may round to) the slanted one counts.
    inside = (level >= 0.0) & (flat > 0.0) & (first | (level <= flat))
    return np.where(inside, path.flat_from + np.minimum(level, flat), path.fall_from + x)


# --- together with the fog --------------------------------------------------------------------------


def combine(fog_radiance: Field, fog_transmittance: Field, long_radiance: Field, long_transmittance: Field
            ) -> tuple[Field, Field]:
    """Lay the froxels' fog over what lies behind it.

    Parameters
    ----------
    fog_radiance, fog_transmittance : ndarray, broadcastable to (3, h, w)
        [W m⁻² sr⁻¹], [1] From the camera to the surface, or to the far end of the froxels if that is nearer: what
        `froxel_ref.apply.lookup_fog` gives.
    long_radiance, long_transmittance : ndarray, broadcastable to (3, h, w)
        [W m⁻² sr⁻¹], [1] From there to the surface: 0 and 1 where it lies within the froxels.

    Returns
    -------
    radiance : ndarray, shape (3, h, w)
        [W m⁻² sr⁻¹] L_long·T_fog + L_fog.
    transmittance : ndarray, shape (h, w) or (3, h, w)
        [1] T_long·T_fog.

    Notes
    -----
    [Dörries 2020, listing 3.15]. Both with length 1 along axes on which nothing varies.

    Examples
    --------
    >>> one, half = np.ones((3, 1, 1)), np.full((1, 1), 0.5)
    >>> [a.ravel().tolist() for a in combine(one, half, 4.0 * one, half)]
    [[3.0, 3.0, 3.0], [0.25]]
    """
    radiance = np.asarray(long_radiance * fog_transmittance + fog_radiance)
    return radiance, np.asarray(long_transmittance * fog_transmittance)
