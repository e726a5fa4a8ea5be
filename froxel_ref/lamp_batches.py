"""What point and spot lights add to a block of froxels, in passes over arrays that stay in the cache.

The arithmetic along the ray (`froxel_ref.light_rays`) as NumPy does it fastest: a light costs some 20
passes, each into memory that is at hand, and none of them a choice between two results. Lights that touch
few froxels of a block are laid out one behind another, so that most passes are over many lights at once.
"""

from __future__ import annotations

import threading
from collections.abc import Sequence
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from froxel_ref.arrays import Field, Index
from froxel_ref.grid import froxel_points
from froxel_ref.grid_parts import whole_slice
from froxel_ref.lamps import Lamps, Lobe, part
from froxel_ref.light_rays import ConeRays, rects
from froxel_ref.lights import seen
from froxel_ref.phase import phase

__all__ = ["add_lamps"]

Type: TypeAlias = "np.dtype[np.floating[Any]]"

# Froxels, of as many lights as it takes, that are worked on at a time: eight arrays of them stay in the cache.
BATCH = 16384
# Below this many froxels a light's three channels are added in one call, above it one by one, from the cache.
FEW = 8192


# --- a block ----------------------------------------------------------------------------------------


class Terms(NamedTuple):
    """A lobe's terms in a block: g itself, 2|g|/(1−|g|)², and the sign of g where it varies or is −1."""

    g: Field
    slope: Field
    sign: Field | None


class Piece(NamedTuple):
    """One light in one block: its place in the grid and in the block, and its part of the batch's arrays."""

    k: int
    area: Index
    here: Index
    across2: Field
    nearest: Field
    cone: ConeRays | None
    s: Field
    d: Field
    reach: Field
    v: Field
    w: Field


class Batch(NamedTuple):
    """Lights in one block, laid out one behind another: flat arrays, and each light's views of them.

    ``s``, ``d`` and ``reach`` are the lights', ``v``, ``w`` and ``spare`` are for free use.
    """

    pieces: list[Piece]
    spare: Field
    s: Field
    d: Field
    reach: Field
    v: Field
    w: Field


def add_lamps(lamps: Lamps, lobes: Sequence[Lobe], lights: Sequence[Field], memory: threading.local,
              z: slice, y: slice) -> None:
    """Add what point and spot lights give a block, per σ_s and per varying prefactor.

    Parameters
    ----------
    lamps : Lamps
        From `make_lamps`, for the same lobes.
    lobes : sequence of Lobe
        The parts of the medium.
    lights : sequence of Field, shape (3, d, h, W) [W m⁻² sr⁻¹]
        For each lobe, what is added to.
    memory : threading.local
        Keeps a thread's arrays from block to block.
    z, y : slice
        The block's slices and rows.

    Notes
    -----
    With the terms of `froxel_ref.light_rays`, a light adds I·w(d²)·cone²·V/max(d², d_min²)·p(cos θ).
    Henyey–Greenstein needs no cos θ: p/d² is prefactor/(√(d·v)·v) with v = d + 2|g|/(1 − |g|)²·(d ± s).
    Lights are added in their order, whatever shares a batch.

    Examples
    --------
    >>> from math import pi
    >>> from froxel_ref.grid import make_froxels
    >>> from froxel_ref.lamps import make_lamps, make_lobe, relate_lamps
    >>> from froxel_ref.scene import Camera, PointLight
    >>> from froxel_ref.settings import Grid
    >>> froxels = make_froxels(Camera(), Grid(width=3, height=3, depth=4))
    >>> lobe = make_lobe(np.ones((3, 1, 1, 1)), 1.0, True, "isotropic", 0.0, np.dtype(float))
    >>> lamp = PointLight(position=(0.0, 1.7, -6.0), intensity=(1.0, 1.0, 1.0), falloff="inverse_square")
    >>> related = relate_lamps({0: lamp}, froxels, attenuation="min_distance", restrict=True)
    >>> lamps = make_lamps(related, [lobe], froxels, visibility={})
    >>> light = np.zeros((3, 4, 3, 3))
    >>> add_lamps(lamps, [lobe], [light], threading.local(), slice(0, 4), slice(0, 3))
    >>> distance = 6.0 - froxels.depths[0, 0, 0]
    >>> bool(abs(light[0, 0, 1, 1] * 4.0 * pi * distance**2 - 1.0) < 1e-12)
    True
    """
    chosen = _chosen(lamps, z, y)
    areas = rects(lamps.rays.boxes[chosen], z, y)
    sizes = np.prod(areas[:, 1::2] - areas[:, ::2], axis=1)
    chosen, areas, sizes = chosen[sizes > 0], areas[sizes > 0], sizes[sizes > 0]
    if not chosen.size:
        return
    shape, dtype = lights[0].shape[1:], lights[0].dtype
    terms = [_terms(lobe, z, y, shape, dtype) for lobe in lobes]
    close = rects(lamps.rays.close[chosen], z, y)
    along = _depths(lamps, lamps.related.common, z) * lamps.froxels.rays.length[y]
    for run in _batches(sizes):
        batch = _lay_out(lamps, chosen[run].tolist(), areas[run].tolist(), int(sizes[run].sum()), memory, z, y)
        _reach(lamps, batch, close[run].tolist(), along)
        for lobe, term, colours, light in zip(lobes, terms, lamps.colours, lights, strict=True):
            _weigh(lobe, term, batch)
            for piece in batch.pieces:
                _add(light, piece, colours[piece.k], batch.spare)


def _add(light: Field, piece: Piece, colour: Field, spare: Field) -> None:
    """Add a light's three channels to the block."""
    size = piece.w.size
    if size <= FEW:
        every = spare[:3 * size].reshape(3, *piece.w.shape)
        target = light[:, *piece.here]
        np.multiply(piece.w, colour, out=every)
        np.add(target, every, out=target)
        return
    for channel, factor in zip(light, colour, strict=True):
        target = channel[piece.here]
        np.multiply(piece.w, factor, out=piece.v)
        np.add(target, piece.v, out=target)


def _chosen(lamps: Lamps, z: slice, y: slice) -> NDArray[np.intp]:
    """Places of the lights that a block has to visit."""
    numbers = lamps.rays.numbers
    if lamps.candidates is None:
        return np.arange(len(numbers))
    return np.flatnonzero(np.isin(numbers, lamps.candidates(z, y), assume_unique=True))


def _batches(sizes: NDArray[np.intp]) -> list[slice]:
    """Runs of lights that together fill a batch; a light that alone does more is one of its own."""
    result, begin, total = [], 0, 0
    for k, size in enumerate(sizes.tolist()):
        if k > begin and total + size > BATCH:
            result.append(slice(begin, k))
            begin, total = k, 0
        total += size
    return [*result, slice(begin, len(sizes))]


def _lay_out(lamps: Lamps, chosen: list[int], areas: list[list[int]], count: int, memory: threading.local,
             z: slice, y: slice) -> Batch:
    """Places and memory for a batch; fresh memory for each would cost more than the arithmetic."""
    dtype = lamps.rays.nearest.dtype
    if getattr(memory, "array", np.empty(0)).size < 3 * FEW + 5 * count:
        memory.array = np.empty(3 * FEW + 5 * max(count, BATCH), dtype)
    flat = memory.array[3 * FEW:3 * FEW + 5 * count].reshape(5, count)
    pieces, begin = [], 0
    for k, (z0, z1, y0, y1, x0, x1) in zip(chosen, areas, strict=True):
        shape = z1 - z0, y1 - y0, x1 - x0
        size = shape[0] * shape[1] * shape[2]
        views = flat[:, begin:begin + size].reshape(5, *shape)
        begin += size
        area = slice(z0, z1), slice(y0, y1), slice(x0, x1)
        here = slice(z0 - z.start, z1 - z.start), slice(y0 - y.start, y1 - y.start), area[2]
        pieces.append(Piece(k, area, here, *_rays(lamps, k, area), *views))
    return Batch(pieces, memory.array[:3 * FEW], *flat)


def _depths(lamps: Lamps, unit: float, z: slice) -> Field:
    """View depth of slices in a light's unit."""
    return lamps.related.depths[unit][whole_slice(lamps.related.box[0], z)]


def _rays(lamps: Lamps, k: int, area: Index) -> tuple[Field, Field, ConeRays | None]:
    """h² and b of a light's rays there, and its cone."""
    top, _, left, _ = lamps.rays.windows[k].tolist()
    y, x = (whole_slice(outer, inner) for outer, inner in zip(lamps.related.box[1:], area[1:], strict=True))
    rays = slice(y.start - top, y.stop - top, y.step), slice(x.start - left, x.stop - left, x.step)
    nearest, across2 = (image[rays] if x.step == 1 else image[rays].copy() for image in lamps.rays.window(k))
    cone = lamps.rays.cones.get(k)
    return across2, nearest, cone and ConeRays(cone.slope[rays], cone.start[rays], cone.offset)


def _terms(lobe: Lobe, z: slice, y: slice, shape: tuple[int, ...], dtype: Type) -> Terms:
    if not lobe.varies:
        sign = np.full((1, 1, 1), -1.0, dtype) if lobe.g[0, 0, 0] < 0.0 else None
        return Terms(lobe.g, _slope(lobe.g).astype(dtype), sign)
    g = part(lobe.g, z, y)
    sign = np.broadcast_to(np.copysign(np.ones((), dtype), g), shape) if (g < 0.0).any() else None
    return Terms(np.broadcast_to(g, shape), np.broadcast_to(_slope(g), shape), sign)


# --- a batch ----------------------------------------------------------------------------------------


def _reach(lamps: Lamps, batch: Batch, close: list[list[int]], along: Field) -> None:
    """Distances to the lights, and what windows, cones and visibility leave (of a window, four times that).

    ``along`` is the block's distance from the camera in the unit of most lights.
    """
    rays, reach = lamps.rays, batch.reach
    for piece in batch.pieces:
        unit = float(rays.units[piece.k])
        if unit == lamps.related.common:
            np.subtract(along[piece.here], piece.nearest, out=piece.s)
            continue
        az, ay, ax = piece.area
        np.multiply(_depths(lamps, unit, az), lamps.froxels.rays.length[ay, ax], out=piece.s)
        np.subtract(piece.s, piece.nearest, out=piece.s)
    np.multiply(batch.s, batch.s, out=reach)
    for piece in batch.pieces:
        np.add(piece.reach, piece.across2, out=piece.reach)
    np.sqrt(reach, out=batch.d)
    bounds = [_bound(piece, box, float(rays.smallest[piece.k]))
              for piece, box in zip(batch.pieces, close, strict=True)]
    windowed = [bool(rays.windowed[piece.k]) for piece in batch.pieces]
    if any(windowed):
        _window(batch)
    for piece, ends, bound in zip(batch.pieces, windowed, bounds, strict=True):
        if not ends:
            piece.reach.fill(1.0)
        if bound is not None:
            piece.reach[bound[0]] *= bound[1]
        if piece.cone is not None:
            _cone(piece, piece.cone)
        sight = lamps.visibility.get(int(rays.numbers[piece.k]))
        if sight is not None:
            piece.reach[...] = seen(piece.reach, sight, froxel_points(lamps.froxels, *piece.area))


def _window(batch: Batch) -> None:
    """Four times sat(1 − d⁴)², in units; sat(x) as (x + |x|)/2, for NumPy's maximum takes three times as long."""
    reach, v = batch.reach, batch.v
    np.multiply(reach, reach, out=reach)
    np.subtract(1.0, reach, out=reach)
    np.abs(reach, out=v)
    np.add(reach, v, out=reach)
    np.multiply(reach, reach, out=reach)


def _cone(piece: Piece, cone: ConeRays) -> None:
    """A spot light's cone."""
    np.multiply(piece.s, cone.slope, out=piece.v)
    np.add(piece.v, cone.start, out=piece.v)
    np.divide(piece.v, piece.d, out=piece.v)
    np.add(piece.v, cone.offset, out=piece.v)
    np.clip(piece.v, 0.0, 1.0, out=piece.v)
    np.multiply(piece.v, piece.v, out=piece.v)
    np.multiply(piece.reach, piece.v, out=piece.reach)


def _bound(piece: Piece, close: list[int], smallest: float) -> tuple[Index, Field] | None:
    """d²/max(d², d_min²) where a light is that close; exactly 1 everywhere else."""
    if not close[1]:
        return None
    ranges = [slice(max(first, a.start) - a.start, min(last, a.stop) - a.start)
              for first, last, a in zip(close[::2], close[1::2], piece.area, strict=True)]
    if any(r.start >= r.stop for r in ranges):
        return None
    z, y, x = ranges
    d2 = piece.reach[z, y, x]
    limits = np.finfo(d2.dtype)
    return (z, y, x), d2 / np.maximum(d2, min(max(smallest, float(limits.tiny)), float(limits.max)))


def _weigh(lobe: Lobe, terms: Terms, batch: Batch) -> None:
    """``w`` = reach/d² times the phase function, without its prefactor for Henyey–Greenstein."""
    s, d, v, w = batch.s, batch.d, batch.v, batch.w
    if lobe.name == "isotropic":
        np.multiply(d, d, out=w)
        np.divide(batch.reach, w, out=w)
    elif lobe.name == "henyey_greenstein":
        _turned(lobe, terms, batch)
        if terms.g.size == 1:
            np.multiply(v, terms.slope[0, 0, 0], out=v)
        else:
            for piece in batch.pieces:
                np.multiply(piece.v, terms.slope[piece.here], out=piece.v)
        np.add(v, d, out=v)
        np.multiply(d, v, out=w)
        np.sqrt(w, out=w)
        np.multiply(w, v, out=w)
        np.divide(batch.reach, w, out=w)
    else:
        _turned(lobe._replace(careful=True), terms._replace(sign=None), batch)
        np.divide(v, d, out=v)
        np.divide(s, d, out=w)
        for piece in batch.pieces:
            g = terms.g if terms.g.size == 1 else terms.g[piece.here]
            piece.w[...] = phase(lobe.name, piece.w * -1.0, g, versine=piece.v)
        np.multiply(d, d, out=v)
        np.divide(batch.reach, v, out=v)
        np.multiply(w, v, out=w)


def _turned(lobe: Lobe, terms: Terms, batch: Batch) -> None:
    """``v`` = d·(1 − cos θ), or d·(1 + cos θ) where g < 0: d + s, s mirrored."""
    s, d, v, w = batch.s, batch.d, batch.v, batch.w
    if lobe.careful:
        np.abs(s, out=v)
        np.add(v, d, out=w)
        for piece in batch.pieces:
            np.divide(piece.across2, piece.w, out=piece.w)
            turned = piece.s if terms.sign is None else piece.s * _part(terms.sign, piece)
            np.add(piece.v, turned, out=piece.v)
        np.add(v, w, out=v)
    elif terms.sign is None:
        np.add(d, s, out=v)
    else:
        for piece in batch.pieces:
            np.multiply(piece.s, _part(terms.sign, piece), out=piece.v)
        np.add(d, v, out=v)


def _part(field: Field, piece: Piece) -> Field:
    """What a light's froxels have of a block's field; one number stays one."""
    return field if field.size == 1 else field[piece.here]


def _slope(g: Field) -> Field:
    """2|g|/(1 − |g|)²."""
    size = np.abs(g)
    rest = 1.0 - size
    return np.asarray(2.0 * size / (rest * rest))
