"""Media and in-scattering bound to a frame: on the whole grid, on half of its froxels, or slab by slab.

Both stages take any regular grid of samples, so a frame may hand them pieces of its own: the four sublattices of a
checkerboard, or slabs of slices, from which the V-Buffer is gone again before the next is made (the thesis's merged
shader [Dörries 2020, §3.2.2]). Every froxel's numbers are the same to the last bit, whatever piece it comes in.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from froxel_ref import blocks, culling, lighting, media
from froxel_ref.arrays import Candidates, Field, Index, Visibility
from froxel_ref.buffers import VBuffer
from froxel_ref.checkerboard import lattice_froxels, lattices
from froxel_ref.gathering import Gathered, Room
from froxel_ref.grid import Froxels
from froxel_ref.grid_lights import GridLights, lights_in, relate_lights
from froxel_ref.grid_parts import candidates_in, is_whole, part_of, slices_of
from froxel_ref.jobs import Job, Results
from froxel_ref.light_visibility import light_visibility
from froxel_ref.quantities import QUANTITIES, stored_grid
from froxel_ref.scene import PointLight

__all__ = [
    "FILTERED", "Piece", "Run", "assembled", "fog_tiling", "lobe_fields", "merged_fields", "pieces", "scattered_fields",
    "v_buffer", "voxel_fields",
]

FILTERED = ("material/scattering", "material/extinction", "material/emission", "material/phase_anisotropy",
            "material/lobe_scattering", "material/lobe_anisotropy")
"""The V-Buffer as it is filtered over frames (`froxel_ref.material_stage`), which is of the whole grid."""

# A field of those that have half the slices with a checkerboard.
PACKED = "media/extinction"

# Froxels of a slab, about: few enough that the V-Buffer is small, enough that no time goes into beginnings.
SLAB = 1 << 17


class Piece(NamedTuple):
    """Some of a frame's froxels.

    Attributes
    ----------
    froxels : Froxels
        Their samples.
    box : (slice, slice, slice)
        Where they stand in the grid.
    place : (slice, slice, slice)
        Where they stand in the fields: of a checkerboard, in those of half the slices (`froxel_ref.checkerboard`).
    """

    froxels: Froxels
    box: Index
    place: Index


def pieces(job: Job, froxels: Froxels | None = None) -> list[Piece]:
    """What a frame's froxels are worked on in.

    Parameters
    ----------
    job : Job
    froxels : Froxels, optional
        Of the whole grid; with this frame's samples unless given.

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
    how, froxels = job.settings, job.froxels if froxels is None else froxels
    if not how.checkerboard:
        depth, rows, columns = how.grid.shape
        whole = slice(0, depth, 1), slice(0, rows, 1), slice(0, columns, 1)
        found = [Piece(froxels, whole, whole)]
    else:
        boxes = lattices(how.grid.shape, job.frame, parity=how.checkerboard_parity)
        found = [_sublattice(froxels, box) for box in boxes]
    return [slab for piece in found for slab in _slabs(piece)] if how.merged else found


def _sublattice(froxels: Froxels, box: Index) -> Piece:
    part = lattice_froxels(froxels, box)
    return Piece(part, box, (slice(0, len(part.depths)), *box[1:]))


def _slabs(piece: Piece) -> list[Piece]:
    depths = piece.froxels.depths
    rows, columns = piece.froxels.rays.length.shape
    count = -(-len(depths) * rows * columns // SLAB)
    deep = max(2, -(-len(depths) // count))  # of two slices it can be seen whether they differ (`Gathered.room`)
    ends = [(k, min(k + deep, len(depths))) for k in range(0, len(depths), deep)]
    return [Piece(piece.froxels._replace(depths=depths[a:b]), slices_of(piece.box, a, b),
                  (slice(a, b), *piece.place[1:])) for a, b in ends]


class Run(NamedTuple):
    """How a piece is worked on.

    Attributes
    ----------
    threads : int or None
        On how many threads.
    room : callable
        Where a field of this name finds room: a function of shape and type.
    """

    threads: int | None
    room: Callable[[str], Room]


def assembled(job: Job, parts: Sequence[Piece], make: Callable[[Piece, Run], dict[str, Field]]) -> dict[str, Field]:
    """Make the fields of all pieces, several pieces each on a thread of its own.

    Parameters
    ----------
    job : Job
    parts : sequence of Piece
    make : callable
        Given a piece and how to work on it, its fields by result name.

    Returns
    -------
    dict of str to Field
        As stored: of a checkerboard with half the slices.
    """
    if len(parts) == 1 and is_whole(parts[0].box, job.settings.grid.shape):
        return make(parts[0], Run(job.threads, lambda name: np.empty))
    gathered = Gathered([part.place for part in parts], stored_grid(PACKED, job.settings).shape)

    def one(k: int) -> None:
        for name, field in make(parts[k], Run(1, partial(gathered.room, k))).items():
            gathered.add(k, name, field, spatial=QUANTITIES[name].axes.endswith("zyx"))

    blocks.run(one, range(len(parts)), threads=job.threads)
    return gathered.fields()


def _cut(fields: Mapping[str, Field], place: Index) -> dict[str, Field]:
    """What fields hold of a piece."""
    return {name: part_of(field, place) if QUANTITIES[name].axes.endswith("zyx") else field
            for name, field in fields.items()}


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


class _Lights(NamedTuple):
    """What all pieces share: the lights as the grid sees them, what is left of each, and which reach a block."""

    related: GridLights
    visibility: Visibility
    candidates: Candidates | None


def _lights(job: Job, results: Results, froxels: Froxels, *, hidden: bool = True) -> _Lights:
    how, scene = job.settings, job.scene
    even = media.even_anisotropies((*scene.global_media, *scene.local_media), how)
    lobes = lighting.lobes_of(even, phase_function=how.phase_function, second_lobe=how.second_lobe, dtype=job.dtype)
    related = relate_lights(scene.all_lights, froxels, attenuation=how.attenuation, restrict=not job.full, lobes=lobes)
    return _Lights(related, light_visibility(job, results) if hidden else {},
                   _candidates(job, results, "light", froxels))


class _Media(NamedTuple):
    """What all pieces share: the media as the grid has them, and which reach a block."""

    terms: media.Terms
    candidates: Candidates | None


def _media(job: Job, results: Results, froxels: Froxels) -> _Media:
    terms = media.media_terms(job.scene, froxels, job.assets.textures, job.settings, restrict=not job.full)
    return _Media(terms, _candidates(job, results, "medium", froxels))


def _phase_ratios(job: Job, results: Results) -> Callable[[Piece, Run], Field]:
    """What the phase function makes of light that nothing hides, at the middles of a piece's froxels.

    So it is the same in every frame in which neither camera nor light nor medium moves. 1 where there is no light.
    """
    if job.settings.temporal.filter != "unphased":
        return lambda part, run: np.zeros((3, 0, 0, 0), job.dtype)
    lights, known = _lights(job, results, job.centres, hidden=False), _media(job, results, job.centres)

    def ratio(part: Piece, run: Run) -> Field:
        middles = part._replace(froxels=lattice_froxels(job.centres, part.box))
        light = _light(job, lights, _voxelised(job, known, middles, run), middles, run)
        phased, plain = (light(phase_function=each) for each in (job.settings.phase_function, "isotropic"))
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            return np.where((plain > 0.0) & (phased > 0.0), phased / plain, 1.0).astype(phased.dtype)

    return ratio


def _voxelised(job: Job, known: _Media, part: Piece, run: Run) -> dict[str, Field]:
    buffer = media.voxelise(job.scene, part.froxels, job.assets.textures, job.settings, threads=run.threads,
                            terms=media.terms_in(known.terms, part.box),
                            candidates=candidates_in(known.candidates, part.box), restrict=not job.full)
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


def _scattered(job: Job, lights: _Lights, fields: Mapping[str, Field], part: Piece, run: Run, *,
               known: Mapping[int, Field] = MappingProxyType({}), span: tuple[float, float] | None = None) -> Field:
    light = _light(job, lights, fields, part, run, known=known, span=span)
    return light(phase_function=job.settings.phase_function, room=run.room("lighting/in_scattering"))


def _light(job: Job, lights: _Lights, fields: Mapping[str, Field], part: Piece, run: Run, *,
           known: Mapping[int, Field] = MappingProxyType({}), span: tuple[float, float] | None = None
           ) -> Callable[..., Field]:
    """In-scattering of a piece as a function of the phase function."""
    settings, scene = job.settings, job.scene
    return partial(
        lighting.in_scattering, v_buffer(fields), lights_in(lights.related, part.box), part.froxels,
        ambient=scene.ambient, second_lobe=settings.second_lobe, emission=settings.emission,
        attenuation=settings.attenuation, ambient_term=settings.ambient, visibility=lights.visibility,
        known_visibility=known, exposure=job.exposure, threads=run.threads,
        candidates=candidates_in(lights.candidates, part.box), restrict=not job.full,
        anisotropy_span=span or media.anisotropy_span((*scene.global_media, *scene.local_media), settings))


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
    known = _media(job, results, job.froxels)
    return assembled(job, pieces(job), lambda part, run: _voxelised(job, known, part, run))


def scattered_fields(job: Job, results: Results) -> dict[str, Field]:
    """In-scattering, from the V-Buffer.

    Parameters
    ----------
    job : Job
    results : mapping of str to Field
        With ``media/…`` or, where it is filtered, ``material/…``; lists of lights, maps.

    Returns
    -------
    dict of str to Field
        ``lighting/…``; of a checkerboard with half the slices.
    """
    if results["material/extinction"].size:
        return _relit_fields(job, results)
    lights, ratio = _lights(job, results, job.froxels), _phase_ratios(job, results)
    buffer = {name: field for name, field in results.items() if name.startswith("media/")}
    return assembled(job, pieces(job), lambda part, run: {
        "lighting/in_scattering": _scattered(job, lights, _cut(buffer, part.place), part, run),
        "lighting/phase_ratio": ratio(part, run)})


def _relit_fields(job: Job, results: Results) -> dict[str, Field]:
    """In-scattering at the froxels' middles, from the filtered V-Buffer and a sun's filtered visibility."""
    lights = _lights(job, results, job.centres)
    buffer = {f"media/{name.removeprefix('material/')}": field for name, field in results.items()
              if name in FILTERED}
    sun = {int(number): results["material/sun_visibility"] for number in results["material/sun_light"]}
    g = buffer["media/phase_anisotropy"]
    low, high = media.anisotropy_span((*job.scene.global_media, *job.scene.local_media), job.settings)
    span = min(low, float(g.min())), max(high, float(g.max()))  # history may hold what the scene has no more
    ratio = _phase_ratios(job, results)

    def make(part: Piece, run: Run) -> dict[str, Field]:
        known = {number: part_of(field, part.box) for number, field in sun.items()}
        return {"lighting/in_scattering": _scattered(job, lights, _cut(buffer, part.box), part, run, known=known,
                                                     span=span), "lighting/phase_ratio": ratio(part, run)}

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
    known = _media(job, results, job.froxels)
    lights, ratio = _lights(job, results, job.froxels), _phase_ratios(job, results)

    def make(part: Piece, run: Run) -> dict[str, Field]:
        fields = _voxelised(job, known, part, run)
        return {"lighting/in_scattering": _scattered(job, lights, fields, part, run),
                "lighting/phase_ratio": ratio(part, run), "media/extinction": fields["media/extinction"]}

    return assembled(job, pieces(job), make)
