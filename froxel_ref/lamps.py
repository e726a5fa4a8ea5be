"""What point and spot lights add to a block of froxels, in passes over arrays that stay in the cache.

The arithmetic along the ray (`froxel_ref.light_rays`) as NumPy does it fastest: a light costs some 20
passes, each into memory that is at hand, and none of them a choice between two results. Lights that touch
few froxels of a block are laid out one behind another, so that most passes are over many lights at once.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from froxel_ref.arrays import Candidates, Field, Index, Visibility
from froxel_ref.grid import Froxels, froxel_points
from froxel_ref.light_rays import Boxes, ConeRays, LightRays, farthest_distance, light_rays, rects
from froxel_ref.phase import phase
from froxel_ref.records import InputError
from froxel_ref.scene import PointLight

__all__ = [
    "Lamps", "Lobe", "add_lamps", "channels", "make_lobe", "part", "prefactor", "relate_lamps",
]

Type: TypeAlias = "np.dtype[np.floating[Any]]"

# The largest 2|g|/(1−|g|)² (|g| ≤ 0.61) for which d + s is formed as it stands. Where it cancels, the
# rounding of d enters the phase function with 1½ times this factor: up to 12 ulp, about what a ray
# direction rounded to the same type costs there. Above, four more passes keep all digits.
PLAIN = 8.0

# Froxels, of as many lights as it takes, that are worked on at a time: five arrays of them stay in the cache.
BATCH = 16384


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


class Lamps(NamedTuple):
    """The point and spot lights that reach a grid.

    Attributes
    ----------
    froxels : Froxels
        The grid.
    rays : LightRays
        The lights.
    colours : list of Field, shape (n, 3, 1, 1, 1)
        For each lobe, the lights' intensities with all constant factors.
    depths : dict of float to Field, shape (D, 1, 1)
        The samples' view depth in each light's unit.
    visibility : Visibility
        As for `froxel_ref.lighting.in_scattering`.
    candidates : Candidates or None
        Which lights a block has to visit; all of them unless given.
    """

    froxels: Froxels
    rays: LightRays
    colours: list[Field]
    depths: dict[float, Field]
    visibility: Visibility
    candidates: Candidates | None = None


def make_lobe(scattering: Field, share: float, first: bool, name: str, g: Field | float, dtype: Type) -> Lobe:
    """Make a lobe and find out how its phase function is best computed.

    Parameters
    ----------
    scattering, share, first, name
        As in `Lobe`.
    g : Field or float
        Phase anisotropy.
    dtype : dtype
        Of the arithmetic; g is moved to where it still is below 1 in it.

    Returns
    -------
    Lobe
        With one number for a g that does not vary; isotropic for Henyey–Greenstein with g = 0.

    Raises
    ------
    InputError
        |g| above 1.

    Notes
    -----
    d + s cancels where a lamp lies ahead of the froxel. Its rounding enters the phase function times
    2|g|/(1 − |g|)²: beyond `PLAIN` the lobe is ``careful``.

    Examples
    --------
    >>> fog = np.full((3, 1, 1, 1), 0.1)
    >>> lobes = [make_lobe(fog, 1.0, True, "henyey_greenstein", g, np.dtype(float)) for g in (0.0, 0.5, 0.9)]
    >>> [(lobe.name, lobe.careful) for lobe in lobes]
    [('isotropic', False), ('henyey_greenstein', False), ('henyey_greenstein', True)]
    """
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


def relate_lamps(lights: Mapping[int, PointLight], lobes: Sequence[Lobe], froxels: Froxels, *,
                 attenuation: str, restrict: bool, visibility: Visibility, candidates: Candidates | None = None,
                 threads: int | None = None) -> Lamps:
    """Prepare point and spot lights for the blocks of a grid.

    Parameters
    ----------
    lights : mapping of int to PointLight or SpotLight
        By their index.
    lobes : sequence of Lobe
        The parts of the medium.
    froxels : Froxels
        The grid, shape (D, H, W).
    attenuation, restrict, visibility, candidates, threads
        As for `froxel_ref.lighting.in_scattering`.

    Returns
    -------
    Lamps
        Without the lights that reach nothing.

    Examples
    --------
    >>> from froxel_ref.grid import make_froxels
    >>> from froxel_ref.scene import Camera
    >>> from froxel_ref.settings import Grid
    >>> froxels = make_froxels(Camera(), Grid(width=4, height=4, depth=4))
    >>> lobe = make_lobe(np.ones((3, 1, 1, 1)), 1.0, True, "isotropic", 0.0, np.dtype(float))
    >>> near, behind = (PointLight(position=(0.0, 1.7, z), intensity=(1.0, 1.0, 1.0), radius=4.0)
    ...                 for z in (-6.0, 20.0))
    >>> lamps = relate_lamps({0: near, 1: behind}, [lobe], froxels, attenuation="min_distance",
    ...                      restrict=True, visibility={})
    >>> lamps.rays.numbers.tolist()
    [0]
    """
    dtype = froxels.depths.dtype
    rays = light_rays(lights, froxels, attenuation=attenuation, restrict=restrict, threads=threads)
    farthest = farthest_distance(dtype) / float(froxels.rays.length.max())
    depths = {size: np.minimum(froxels.depths.astype(np.float64) / size, farthest).astype(dtype)
              for size in np.unique(rays.units).tolist()}
    # What is constant in the phase function and, as `_window` leaves it, in the window.
    window = np.where(rays.windowed, 0.25, 1.0)[:, np.newaxis]
    colours = [np.asarray(np.minimum(rays.intensity * (_factor(lobe) * window), np.finfo(dtype).max), dtype)
               .reshape(-1, 3, 1, 1, 1) for lobe in lobes]
    return Lamps(froxels, rays, colours, depths, visibility, candidates if restrict else None)


def channels(values: Any, dtype: Type) -> Field:
    """Lay three numbers along the channels; what the dtype cannot hold becomes its largest number.

    Parameters
    ----------
    values : array_like, shape (3,)
        At least 0.
    dtype : dtype
        Of the result.

    Returns
    -------
    ndarray, shape (3, 1, 1, 1)
        The same numbers.

    Notes
    -----
    `froxel_ref.lighting` lays out the ambient radiance with it, too.

    Examples
    --------
    >>> channels([1.0, 2.0, 1e300], np.dtype(np.float32)).ravel().tolist()
    [1.0, 2.0, 3.4028234663852886e+38]
    """
    return np.asarray(np.minimum(values, np.finfo(dtype).max), dtype).reshape(3, 1, 1, 1)


def part(field: Field, z: slice, y: slice) -> Field:
    """A block of a field, whose length-1 axes stay as they are.

    Parameters
    ----------
    field : Field, shape (…, D or 1, H or 1, W or 1)
        The whole.
    z, y : slice
        The block's slices and rows.

    Returns
    -------
    Field
        A view.

    Notes
    -----
    `froxel_ref.lighting` cuts the medium's fields into blocks with it, too.

    Examples
    --------
    >>> part(np.zeros((3, 8, 1, 5)), slice(2, 4), slice(0, 1)).shape
    (3, 2, 1, 5)
    """
    every = slice(None)
    return field[..., z if field.shape[-3] > 1 else every, y if field.shape[-2] > 1 else every, :]


def _factor(lobe: Lobe) -> float:
    """What is constant in a lobe's phase function."""
    if lobe.name == "isotropic":
        return lobe.share * 0.25 / math.pi
    if lobe.name == "henyey_greenstein" and not lobe.scaled:
        return lobe.share * float(prefactor(lobe.g)[0, 0, 0])
    return lobe.share


def prefactor(g: Field) -> Field:
    """What Henyey–Greenstein has before the bracket: (1 − g²)/(4π(1 − |g|)³).

    Parameters
    ----------
    g : Field
        Phase anisotropy, inside (−1, 1).

    Returns
    -------
    Field, shape of ``g`` [sr⁻¹]
        p is this over (1 + 2|g|/(1 − |g|)²·(1 ∓ cos θ))^{3/2} [Henyey 1941].

    Examples
    --------
    >>> bool(prefactor(np.zeros(1))[0] == 1.0 / (4.0 * math.pi))
    True
    """
    size = np.abs(g)
    rest = 1.0 - size
    return np.asarray((1.0 + size) / (4.0 * math.pi * rest * rest))


def _slope(g: Field) -> Field:
    """2|g|/(1 − |g|)²."""
    size = np.abs(g)
    rest = 1.0 - size
    return np.asarray(2.0 * size / (rest * rest))


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

    ``s``, ``d`` and ``reach`` are the lights', ``v`` and ``w`` are for free use.
    """

    pieces: list[Piece]
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
        From `relate_lamps`, for the same lobes.
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
    >>> from froxel_ref.grid import make_froxels
    >>> from froxel_ref.scene import Camera
    >>> from froxel_ref.settings import Grid
    >>> froxels = make_froxels(Camera(), Grid(width=3, height=3, depth=4))
    >>> lobe = make_lobe(np.ones((3, 1, 1, 1)), 1.0, True, "isotropic", 0.0, np.dtype(float))
    >>> lamp = PointLight(position=(0.0, 1.7, -6.0), intensity=(1.0, 1.0, 1.0), falloff="inverse_square")
    >>> lamps = relate_lamps({0: lamp}, [lobe], froxels, attenuation="min_distance", restrict=True,
    ...                      visibility={})
    >>> light = np.zeros((3, 4, 3, 3))
    >>> add_lamps(lamps, [lobe], [light], threading.local(), slice(0, 4), slice(0, 3))
    >>> distance = 6.0 - froxels.depths[0, 0, 0]
    >>> bool(abs(light[0, 0, 1, 1] * 4.0 * math.pi * distance**2 - 1.0) < 1e-12)
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
    for part in _batches(sizes):
        batch = _lay_out(lamps, chosen[part].tolist(), areas[part].tolist(), int(sizes[part].sum()), memory, z, y)
        _reach(lamps, batch, close[part].tolist())
        for lobe, term, colours, light in zip(lobes, terms, lamps.colours, lights, strict=True):
            _weigh(lobe, term, batch)
            for piece in batch.pieces:
                for channel, factor in zip(light, colours[piece.k], strict=True):
                    np.multiply(piece.w, factor, out=piece.v)
                    target = channel[piece.here]
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
    if getattr(memory, "array", np.empty(0)).size < 5 * count:
        memory.array = np.empty(5 * max(count, BATCH), dtype)
    flat = memory.array[:5 * count].reshape(5, count)
    pieces, begin = [], 0
    for k, (z0, z1, y0, y1, x0, x1) in zip(chosen, areas, strict=True):
        shape = z1 - z0, y1 - y0, x1 - x0
        size = shape[0] * shape[1] * shape[2]
        views = flat[:, begin:begin + size].reshape(5, *shape)
        begin += size
        top, _, left, _ = lamps.rays.windows[k].tolist()
        rays = slice(y0 - top, y1 - top), slice(x0 - left, x1 - left)
        nearest, across2 = lamps.rays.window(k)
        here = slice(z0 - z.start, z1 - z.start), slice(y0 - y.start, y1 - y.start), slice(x0, x1)
        cone = lamps.rays.cones.get(k)
        pieces.append(Piece(
            k, (slice(z0, z1), slice(y0, y1), slice(x0, x1)), here, across2[rays], nearest[rays],
            cone and ConeRays(cone.slope[rays], cone.start[rays], cone.offset), *views))
    return Batch(pieces, *flat)


def _terms(lobe: Lobe, z: slice, y: slice, shape: tuple[int, ...], dtype: Type) -> Terms:
    if lobe.g.size == 1:
        sign = np.full((1, 1, 1), -1.0, dtype) if lobe.g[0, 0, 0] < 0.0 else None
        return Terms(lobe.g, _slope(lobe.g).astype(dtype), sign)
    g = part(lobe.g, z, y)
    sign = np.broadcast_to(np.copysign(np.ones((), dtype), g), shape) if (g < 0.0).any() else None
    return Terms(np.broadcast_to(g, shape), np.broadcast_to(_slope(g), shape), sign)


# --- a batch ----------------------------------------------------------------------------------------


def _reach(lamps: Lamps, batch: Batch, close: list[list[int]]) -> None:
    """Distances to the lights, and what windows, cones and visibility leave (of a window, four times that)."""
    rays, reach = lamps.rays, batch.reach
    for piece in batch.pieces:
        az, ay, ax = piece.area
        np.multiply(lamps.depths[float(rays.units[piece.k])][az], lamps.froxels.rays.length[ay, ax], out=piece.s)
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
            piece.reach[...] *= sight(froxel_points(lamps.froxels, *piece.area))


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
