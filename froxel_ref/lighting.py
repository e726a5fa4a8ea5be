"""In-scattering: the light that each froxel sends towards the camera, per metre of the way.

σ_s·(Σ_l p·Vis·E_l + ambient) + emission, block by block. What a point or spot light adds is worked out
along the ray (`froxel_ref.light_rays`, `froxel_ref.lamp_batches`), and only where the light reaches.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from froxel_ref import blocks
from froxel_ref.arrays import Candidates, Field, Visibility
from froxel_ref.buffers import VBuffer
from froxel_ref.gathering import Room
from froxel_ref.grid import Froxels, froxel_points
from froxel_ref.grid_lights import GridLights, relate_lights, shine
from froxel_ref.lamp_batches import add_lamps
from froxel_ref.lamps import Lamps, Lobe, channels, make_lamps, make_lobe, part, prefactor
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
from froxel_ref.scene import Light, Rgb
from froxel_ref.settings import SWITCHES, SecondLobe
from froxel_ref.sun_rays import SunRays, sun_light

__all__ = [
    "PHASE", "cornette_shanks", "henyey_greenstein", "in_scattering", "isotropic", "lobes_of", "phase", "rayleigh",
    "schlick", "two_lobe_henyey_greenstein", "versine",
]

Type: TypeAlias = "np.dtype[np.floating[Any]]"

# Bytes of an operand in a block, more than elsewhere (blocks.BLOCK): a light costs some 20 calls, and
# threads that share the interpreter lock get in each other's way the more, the shorter a call is. Least of
# 57,600 to 921,600 elements on two cores, in both types (benchmarks/in_scattering.py).
OPERAND = 1 << 20

NOTHING: Mapping[int, Field] = MappingProxyType({})

CONSTANT_AMBIENT = 1.0 / (4.0 * math.pi * math.pi)


class Job(NamedTuple):
    """All that a block needs."""

    froxels: Froxels
    vbuffer: VBuffer
    lobes: list[Lobe]
    suns: Sequence[SunRays]
    shine: list[tuple[Field, ...] | None]
    ambient: Field
    lamps: Lamps
    emission: str
    exposure: float
    visibility: Visibility
    known: Mapping[int, Field] = NOTHING


def in_scattering(
    vbuffer: VBuffer, lights: Sequence[Light] | GridLights, froxels: Froxels, *, ambient: Rgb = (0.0, 0.0, 0.0),
    phase_function: str = "henyey_greenstein", second_lobe: SecondLobe | None = None,
    emission: str = "per_metre", attenuation: str = "min_distance", ambient_term: str = "scene",
    exposure: float = 1.0, visibility: Visibility | None = None, candidates: Candidates | None = None,
    known_visibility: Mapping[int, Field] | None = None,
    anisotropy_span: tuple[float, float] | None = None,
    threads: int | None = None, block_size: int | None = None, restrict: bool = True, room: Room = np.empty,
) -> Field:
    """Sum the light that each froxel scatters, or emits, towards the camera.

    Parameters
    ----------
    vbuffer : VBuffer
        Scattering, extinction, emission and phase anisotropy at the samples of ``froxels``, in its dtype.
    lights : sequence of Light, or GridLights
        All lights; their positions in it are the indices of ``visibility``. Or these as ``froxels`` see them, of
        which several parts of a grid need not be told anew (`froxel_ref.grid_lights`).
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
    visibility : mapping of int to callable, optional
        For lights that something may hide: given points, the share of the light that arrives.
    candidates : callable, optional
        Given a block's slices and rows, the indices of the point and spot lights that it has to visit, growing
        (`froxel_ref.culling.candidates`); all of them unless given.
    known_visibility : mapping of int to Field, broadcastable to (D, H, W), optional
        For directional lights, instead of ``visibility``: the share that arrives at the samples.
    anisotropy_span : (float, float), optional
        Least and greatest phase anisotropy of all pieces that a grid is worked on in, so that each chooses the same
        formula; that of this V-Buffer unless given.
    threads : int, optional
        Default: one for each core.
    block_size : int, optional
        Froxels that are worked on at a time, 1 MiB of each operand unless given; the result does not
        depend on it.
    restrict : bool
        Whether to skip what a light does not reach; the result does not depend on it.
    room : callable
        Makes room for the result.

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
    one division a froxel. v is formed as h²/(d+|s|) + (s+|s|) where g asks for it (`lamps.PLAIN`). At a
    light itself cos θ = 0; g is taken no nearer to ±1 than the dtype's last number below 1. The error is at
    most what 4 ulp in the froxel's position make of it (measured against 40 digits, |g| ≤ 0.99).

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
    dtype = froxels.depths.dtype
    lobes = _lobes(vbuffer, phase_function, second_lobe, dtype, anisotropy_span)
    related = lights if isinstance(lights, GridLights) else relate_lights(lights, froxels, attenuation=attenuation,
                                                                          restrict=restrict)
    hidden = visibility or {}
    sky = (CONSTANT_AMBIENT,) * 3 if ambient_term == "constant" else ambient
    job = Job(
        froxels=froxels, vbuffer=vbuffer, lobes=lobes, suns=related.suns,
        shine=[shine(related, lobe) for lobe in lobes], ambient=channels(sky, dtype),
        emission=emission, lamps=make_lamps(related.lamps, lobes, froxels, visibility=hidden,
                                            candidates=candidates if restrict else None),
        exposure=exposure, visibility=hidden, known=known_visibility or NOTHING)
    skies = [None if _along_z(job, lobe) else _sky(job, k, lobe.g) for k, lobe in enumerate(lobes)]
    shape = _shape(job, skies)
    result = room((3, *shape), dtype)
    memory = threading.local()
    block_size = block_size or OPERAND // result.itemsize
    blocks.run(lambda part: _fill(job, skies, result, memory, *part), blocks.blocks(*shape, size=block_size),
               threads=threads)
    return result


def lobes_of(anisotropies: Sequence[float], *, phase_function: str = "henyey_greenstein",
             second_lobe: SecondLobe | None = None, dtype: Type) -> list[Lobe]:
    """Make the lobes of media whose parts have one phase anisotropy each, for what depends on no scattering.

    Parameters
    ----------
    anisotropies : sequence of float
        Of the parts.
    phase_function, second_lobe
        As for `in_scattering`.
    dtype : dtype
        Of the arithmetic.

    Returns
    -------
    list of Lobe
        Those that `in_scattering` has, but for their scattering.

    Examples
    --------
    >>> [lobe.share for lobe in lobes_of([0.5], phase_function="two_lobe_henyey_greenstein", dtype=np.dtype(float))]
    [0.7, 0.3]
    """
    if not anisotropies:
        return []
    none = np.zeros((3, 1, 1, 1), dtype)
    empty = VBuffer(none, none[0], none, none[0], tuple((none, g) for g in anisotropies))
    return _lobes(empty, phase_function, second_lobe, dtype, None)


# --- what there is to do ----------------------------------------------------------------------------


def _lobes(vbuffer: VBuffer, name: str, second: SecondLobe | None, dtype: Type, span: tuple[float, float] | None
           ) -> list[Lobe]:
    """The parts of the scattering, each with one phase function."""
    parts = vbuffer.lobes or ((vbuffer.scattering, vbuffer.phase_anisotropy),)
    span = None if vbuffer.lobes else span  # each lobe of a mixture has one g
    if name != "two_lobe_henyey_greenstein":
        return [make_lobe(scattering, 1.0, True, name, g, dtype, span=span) for scattering, g in parts]
    other, result, name = second or SecondLobe(), [], "henyey_greenstein"
    for scattering, g in parts:
        result.append(make_lobe(scattering, 1.0 - other.weight, True, name, g, dtype, span=span))
        result.append(make_lobe(scattering, other.weight, False, name, other.phase_anisotropy, dtype))
    return result


def _along_z(job: Job, lobe: Lobe) -> bool:
    """Whether the directional part varies along z."""
    return bool(job.suns) and (_shadowed(job) or lobe.g.shape[0] > 1)


def _shadowed(job: Job) -> bool:
    """Whether something may hide a sun."""
    return any(sun.number in job.visibility or sun.number in job.known for sun in job.suns)


def _sky(job: Job, k: int, g: Field, y: slice = slice(None), seen: Mapping[int, Field] = NOTHING) -> Field:
    """Ambient and directional light that the k-th lobe scatters towards the camera, per σ_s."""
    lobe, known = job.lobes[k], job.shine[k]
    total = job.ambient if lobe.first else np.zeros_like(job.ambient)
    for i, sun in enumerate(job.suns):
        light = known[i][:, :, y] if known else sun_light(sun, lobe.name, g, share=lobe.share, rows=y, varies=True)
        total = total + (light * seen[sun.number] if sun.number in seen else light)
    return total


def _shape(job: Job, skies: Sequence[Field | None]) -> tuple[int, int, int]:
    """The axes along which the result varies."""
    rows, columns = job.froxels.rays.length.shape
    if len(job.lamps.rays.numbers) or _shadowed(job):
        return job.froxels.depths.shape[0], rows, columns
    parts = [job.vbuffer.emission]
    for lobe, sky in zip(job.lobes, skies, strict=True):
        varying = [sky] if sky is not None else [lobe.g, job.suns[0].deflection.high]
        parts += [lobe.scattering, *varying]
    depth, height, width = np.broadcast_shapes(*(part.shape[-3:] for part in parts))
    return depth, height, width


# --- a block ----------------------------------------------------------------------------------------


def _fill(job: Job, whole: Sequence[Field | None], result: Field, memory: threading.local, z: slice,
          y: slice) -> None:
    """Work out one block of the result; ``whole`` is each lobe's `_sky`, None where it varies along z."""
    with np.errstate(over="ignore", under="ignore"):  # what overflows lies beyond a light's window
        target = result[:, z, y]
        first = target if target.strides[-1] == target.itemsize else np.empty(target.shape, target.dtype)
        lights = [first] + [np.empty_like(first) for _ in job.lobes[1:]]
        skies = [_block_sky(job, k, z, y) if sky is None else part(sky, z, y) for k, sky in enumerate(whole)]
        for lobe, sky, light in zip(job.lobes, skies, lights, strict=True):
            light[...] = 0.0 if lobe.scaled else sky
        if len(job.lamps.rays.numbers):
            add_lamps(job.lamps, job.lobes, lights, memory, z, y)
        for lobe, sky, light in zip(job.lobes, skies, lights, strict=True):
            if lobe.scaled:
                light *= prefactor(part(lobe.g, z, y))
                light += sky
            if job.emission == "published" and lobe.first:
                light += part(job.vbuffer.emission, z, y)
            light *= part(lobe.scattering, z, y)
        for light in lights[1:]:
            first += light
        if job.emission != "published":
            first += part(job.vbuffer.emission, z, y)
        if job.exposure != 1.0:
            first *= job.exposure
        if first is not target:  # of a field that has other parts' samples between these
            target[...] = first


def _block_sky(job: Job, k: int, z: slice, y: slice) -> Field:
    """Ambient and directional light of the k-th lobe in a block, where it varies along z."""
    seen: dict[int, Field] = {}
    if _shadowed(job):
        points = froxel_points(job.froxels, z, y)
        seen = {sun.number: job.visibility[sun.number](points) for sun in job.suns
                if sun.number in job.visibility and sun.number not in job.known}
        seen |= {number: part(field, z, y) for number, field in job.known.items()}
    return _sky(job, k, part(job.lobes[k].g, z, y), y, seen)
