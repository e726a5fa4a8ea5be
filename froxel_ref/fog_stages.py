"""Media and in-scattering bound to a frame: on the whole grid, on half of its froxels, or slab by slab.

Both stages take any regular grid of samples, so a frame may hand them pieces of its own: the four sublattices of a
checkerboard, or slabs of slices, from which the V-Buffer is gone again before the next is made (the thesis's merged
shader [Dörries 2020, §3.2.2]). Every froxel's numbers are the same to the last bit, whatever piece it comes in.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np

from froxel_ref import blocks, culling, lighting, media
from froxel_ref.arrays import Candidates, Field, Index, Visibility
from froxel_ref.buffers import VBuffer
from froxel_ref.checkerboard import lattice_froxels, lattices
from froxel_ref.grid import Froxels
from froxel_ref.jobs import Job, Results
from froxel_ref.light_visibility import light_visibility
from froxel_ref.quantities import QUANTITIES, stored_grid
from froxel_ref.scene import PointLight

__all__ = [
    "FILTERED", "Piece", "assembled", "fog_tiling", "lobe_fields", "merged_fields", "pieces", "scattered_fields",
    "v_buffer", "voxel_fields",
]

# Froxels of a slab, about: few enough that the V-Buffer is small, enough that no time goes into beginnings.
SLAB = 1 << 17

FILTERED = tuple(f"material/{name}" for name in (
    "scattering", "extinction", "emission", "phase_anisotropy", "lobe_scattering", "lobe_anisotropy"))
"""The V-Buffer as filtered over frames (`froxel_ref.material_stage`)."""


class Piece(NamedTuple):
    """Some of a frame's froxels.

    Attributes
    ----------
    froxels : Froxels
        Their samples.
    place : (slice, slice, slice)
        Where they stand in the fields: of a checkerboard, in those of half the slices (`froxel_ref.checkerboard`).
    box : (slice, slice, slice)
        Where they lie in the whole grid.
    """

    froxels: Froxels
    place: Index
    box: Index


def pieces(job: Job, froxels: Froxels | None = None) -> list[Piece]:
    """What a frame's froxels are worked on in.

    Parameters
    ----------
    job : Job
    froxels : Froxels, optional
        The whole grid; with this frame's samples unless given.

    Returns
    -------
    list of Piece
        One, four of a checkerboard, or slabs of these where the stages are merged.

    Examples
    --------
    >>> from froxel_ref.scene import Scene
    >>> from froxel_ref.settings import Settings
    >>> [len(pieces(Job(Scene(), Settings(checkerboard=half), None))) for half in (False, True)]
    [1, 4]
    """
    how, whole = job.settings, job.froxels if froxels is None else froxels
    if not how.checkerboard:
        found = [Piece(whole, (slice(None),) * 3, (slice(None),) * 3)]
    else:
        boxes = lattices(how.grid.shape, job.frame, parity=how.checkerboard_parity)
        found = [Piece(lattice_froxels(whole, box), (slice(None), *box[1:]), box) for box in boxes]
    return [slab for piece in found for slab in _slabs(piece)] if how.merged else found


def _slabs(piece: Piece) -> list[Piece]:
    depths = piece.froxels.depths
    rows, columns = piece.froxels.rays.length.shape
    deep = max(1, SLAB // (rows * columns))
    first, step = piece.box[0].start or 0, piece.box[0].step or 1
    ends = [(k, min(k + deep, len(depths))) for k in range(0, len(depths), deep)]
    return [Piece(piece.froxels._replace(depths=depths[k:end]), (slice(k, end), *piece.place[1:]),
                  (slice(first + step * k, first + step * (end - 1) + 1, step), *piece.box[1:])) for k, end in ends]


def assembled(job: Job, parts: Sequence[Piece], make: Callable[[Piece, int | None], dict[str, Field]]
              ) -> dict[str, Field]:
    """Make the fields of all pieces, several pieces each on a thread of its own.

    Parameters
    ----------
    job : Job
    parts : sequence of Piece
    make : callable
        Given a piece and a number of threads, its fields by result name.

    Returns
    -------
    dict of str to Field
        As stored: of a checkerboard with half the slices.
    """
    if len(parts) == 1 and parts[0].place == (slice(None),) * 3:
        return make(parts[0], job.threads)
    made: list[dict[str, Field]] = [{}] * len(parts)

    def one(k: int) -> None:
        made[k] = make(parts[k], 1)

    blocks.run(one, range(len(parts)), threads=job.threads)
    shape = stored_grid("media/extinction", job.settings).shape
    return {name: _joined([each[name] for each in made], parts, shape) if QUANTITIES[name].axes.endswith("zyx")
            else made[0][name] for name in made[0]}


def _joined(fields: Sequence[Field], parts: Sequence[Piece], shape: tuple[int, int, int]) -> Field:
    """One field of the pieces', which keeps at length 1 the axes along which none of them varies."""
    first = fields[0]
    if first.size == 0:
        return first
    if all(field.shape[-3:] == (1, 1, 1) and np.array_equal(field, first) for field in fields):
        return first
    if len({_column(part) for part in parts}) > 1:  # a checkerboard's slices are others in each column
        varies = [True] * 3
    else:  # slabs have every row and column, and may be constant each with a number of its own
        varies = [any(field.shape[axis - 3] > 1 for field in fields) for axis in range(3)]
        varies[0] = varies[0] or any(not np.array_equal(field, first) for field in fields)
    extent = tuple(n if v else 1 for n, v in zip(shape, varies, strict=True))
    result = np.zeros((*first.shape[:-3], *extent), first.dtype)
    for field, part in zip(fields, parts, strict=True):
        result[_index(part, extent)] = field
    return result


def _column(part: Piece) -> tuple[object, ...]:
    """Which columns a piece has."""
    return tuple((s.start, s.stop, s.step) for s in part.place[1:])


def _index(part: Piece, extent: tuple[int, ...]) -> Any:
    """Where a piece stands in a field, all of it along axes of length 1."""
    begin, step = part.place[0].start or 0, part.place[0].step or 1
    z = slice(begin, begin + step * (len(part.froxels.depths) - 1) + 1, step)
    return (..., *(s if n > 1 else slice(None) for s, n in zip((z, *part.place[1:]), extent, strict=True)))


def _cut(fields: Mapping[str, Field], part: Piece) -> dict[str, Field]:
    """What fields hold of a piece."""
    if part.place == (slice(None),) * 3:
        return dict(fields)
    return {name: np.ascontiguousarray(field[_index(part, field.shape[-3:])])
            if QUANTITIES[name].axes.endswith("zyx") else field for name, field in fields.items()}


# --- the two stages, and both in one ----------------------------------------------------------------


def fog_tiling(job: Job) -> culling.Tiling:
    """The tiles and bins of a frame's lists.

    Parameters
    ----------
    job : Job

    Returns
    -------
    Tiling
    """
    how = job.settings
    return culling.make_tiling(job.scene.camera, depth_range=(how.grid.near, how.grid.far),
                               tile=how.culling.tile, bins=how.culling.bins)


def _candidates(job: Job, results: Results, kind: str, froxels: Froxels) -> Candidates | None:
    """What the lists hand to blocks; nothing where all is forced, or nothing has bounds."""
    lists = culling.Culled(*(results[f"culling/{kind}_{name}"] for name in culling.Culled._fields))
    if job.full or not len(lists.order):
        return None
    endless = [i for i, light in enumerate(job.scene.all_lights)
               if isinstance(light, PointLight) and light.falloff != "windowed"] if kind == "light" else []
    return culling.candidates(lists, froxels, fog_tiling(job), everywhere=endless)


def lobe_fields(lobes: tuple[tuple[Field, float], ...], dtype: np.dtype[np.floating]) -> dict[str, Field]:
    """The lobes of a mixture as results.

    Parameters
    ----------
    lobes : tuple of (Field, float)
        Scattering and phase anisotropy of each.
    dtype : data type

    Returns
    -------
    dict of str to ndarray
    """
    anisotropy = np.array([g for _, g in lobes], dtype)
    if not lobes:
        none = np.zeros((0, 3, 1, 1, 1), dtype)
        return {"media/lobe_scattering": none, "media/lobe_anisotropy": anisotropy}
    shape = np.broadcast_shapes(*(scattering.shape for scattering, _ in lobes))
    stacked = np.stack([np.broadcast_to(scattering, shape) for scattering, _ in lobes])
    return {"media/lobe_scattering": stacked, "media/lobe_anisotropy": anisotropy}


def v_buffer(results: Results) -> VBuffer:
    """The V-Buffer from a frame's results by name: what `froxel_ref.lighting.in_scattering` is given.

    Parameters
    ----------
    results : mapping of str to Field
        With all of media but its albedo.

    Returns
    -------
    VBuffer
    """
    lobes = zip(results["media/lobe_scattering"], results["media/lobe_anisotropy"], strict=True)
    return VBuffer(results["media/scattering"], results["media/extinction"], results["media/emission"],
                   results["media/phase_anisotropy"], tuple((s, float(g)) for s, g in lobes))


def _voxelised(job: Job, results: Results, part: Piece, threads: int | None) -> dict[str, Field]:
    buffer = media.voxelise(job.scene, part.froxels, job.assets.textures, job.settings, threads=threads,
                            candidates=_candidates(job, results, "medium", part.froxels), restrict=not job.full)
    scattering = buffer.scattering
    if job.settings.albedo_at_zero == "divide":  # D1: listing 3.2 recovers σ_s from the albedo
        scattering = media.albedo_of(scattering, buffer.extinction, at_zero="divide") * buffer.extinction
    fields = {"media/scattering": scattering, "media/extinction": buffer.extinction,
              "media/emission": buffer.emission, "media/phase_anisotropy": buffer.phase_anisotropy}
    if job.full:
        shape = (len(part.froxels.depths), *part.froxels.rays.length.shape)
        fields = {name: np.ascontiguousarray(np.broadcast_to(field, field.shape[:-3] + shape))
                  for name, field in fields.items()}
    if "media/albedo" in job.asked:
        fields["media/albedo"] = media.albedo_of(buffer.scattering, buffer.extinction,
                                                 at_zero=job.settings.albedo_at_zero)
    return fields | lobe_fields(buffer.lobes, job.dtype)


def _scattered(job: Job, results: Results, visibility: Visibility, fields: Mapping[str, Field], part: Piece,
               threads: int | None, *, known: Mapping[int, Field] = MappingProxyType({}),
               span: tuple[float, float] | None = None) -> dict[str, Field]:
    settings, scene = job.settings, job.scene
    light = partial(
        lighting.in_scattering, v_buffer(fields), scene.all_lights, part.froxels, ambient=scene.ambient,
        second_lobe=settings.second_lobe, emission=settings.emission, attenuation=settings.attenuation,
        ambient_term=settings.ambient, visibility=visibility, known_visibility=known,
        exposure=job.exposure, threads=threads,
        candidates=_candidates(job, results, "light", part.froxels), restrict=not job.full,
        anisotropy_span=span or media.anisotropy_span((*scene.global_media, *scene.local_media), settings))
    made = {"lighting/in_scattering": light(phase_function=settings.phase_function)}
    if settings.temporal.filter == "unphased":
        made["lighting/unphased"] = light(phase_function="isotropic")
    else:
        made["lighting/unphased"] = np.zeros((3, 0, 0, 0), job.dtype)
    return made


def voxel_fields(job: Job, results: Results) -> dict[str, Field]:
    """The V-Buffer's fields.

    Parameters
    ----------
    job : Job
    results : mapping of str to Field
        With the lists of local media.

    Returns
    -------
    dict of str to Field
        ``media/…``; of a checkerboard with half the slices.
    """
    return assembled(job, pieces(job), lambda part, threads: _voxelised(job, results, part, threads))


def scattered_fields(job: Job, results: Results) -> dict[str, Field]:
    """In-scattering, from the V-Buffer.

    Parameters
    ----------
    job : Job
    results : mapping of str to Field
        With ``media/…``, ``material/…``, lists of lights, maps.

    Returns
    -------
    dict of str to Field
        ``lighting/…``; of a checkerboard with half the slices.
    """
    visibility = light_visibility(job, results)
    if results["material/extinction"].size:
        return _relit_fields(job, results, visibility)
    buffer = {name: field for name, field in results.items() if name.startswith("media/")}
    return assembled(job, pieces(job), lambda part, threads: _scattered(
        job, results, visibility, _cut(buffer, part), part, threads))


def _relit_fields(job: Job, results: Results, visibility: Visibility) -> dict[str, Field]:
    """In-scattering at the froxels' middles, from the filtered V-Buffer and a sun's filtered visibility."""
    buffer = {f"media/{name.removeprefix('material/')}": field for name, field in results.items()
              if name in FILTERED}
    sun = {int(number): results["material/sun_visibility"] for number in results["material/sun_light"]}
    g = buffer["media/phase_anisotropy"]
    low, high = media.anisotropy_span((*job.scene.global_media, *job.scene.local_media), job.settings)
    span = min(low, float(g.min())), max(high, float(g.max()))  # history may hold what the scene has no more

    def make(part: Piece, threads: int | None) -> dict[str, Field]:
        whole = part._replace(place=part.box)  # these have no holes
        known = {number: _cut({"material/sun_visibility": field}, whole)["material/sun_visibility"]
                 for number, field in sun.items()}
        return _scattered(job, results, visibility, _cut(buffer, whole), part, threads, known=known, span=span)

    return assembled(job, pieces(job, job.centres), make)


def merged_fields(job: Job, results: Results) -> dict[str, Field]:
    """In-scattering and extinction, slab by slab: the V-Buffer of one at a time for each thread.

    Parameters
    ----------
    job : Job
    results : mapping of str to Field
        With lists and maps.

    Returns
    -------
    dict of str to Field
        ``lighting/…`` and ``media/extinction``; nothing where the stages are not merged.
    """
    if not job.settings.merged:  # forced, but not to what was switched off
        return {}
    visibility = light_visibility(job, results)

    def make(part: Piece, threads: int | None) -> dict[str, Field]:
        fields = _voxelised(job, results, part, threads)
        return {"media/extinction": fields["media/extinction"],
                **_scattered(job, results, visibility, fields, part, threads)}

    return assembled(job, pieces(job), make)
