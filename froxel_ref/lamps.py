"""What point and spot lights add to a block of froxels, in passes over arrays that stay in the cache.

The arithmetic along the ray (`froxel_ref.light_rays`) as NumPy does it fastest: a light costs some 20
passes, each into memory that is at hand, and none of them a choice between two results.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from froxel_ref.arrays import Field, Visibility
from froxel_ref.grid import Froxels, froxel_points
from froxel_ref.light_rays import LightRays, Rect, farthest_distance, light_rays, rect
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
    rays : list of LightRays
        The lights.
    colours : list of list of Field, shape (3, 1, 1, 1)
        For each lobe and light, its intensity with all constant factors.
    depths : dict of float to Field, shape (D, 1, 1)
        The samples' view depth in each light's unit.
    visibility : Visibility
        As for `froxel_ref.lighting.in_scattering`.
    """

    froxels: Froxels
    rays: list[LightRays]
    colours: list[list[Field]]
    depths: dict[float, Field]
    visibility: Visibility


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
                 attenuation: str, restrict: bool, visibility: Visibility) -> Lamps:
    """Prepare point and spot lights for the blocks of a grid.

    Parameters
    ----------
    lights : mapping of int to PointLight or SpotLight
        By their index.
    lobes : sequence of Lobe
        The parts of the medium.
    froxels : Froxels
        The grid, shape (D, H, W).
    attenuation, restrict, visibility
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
    >>> [lamp.number for lamp in lamps.rays]
    [0]
    """
    dtype = froxels.depths.dtype
    rays = light_rays(lights, froxels, attenuation=attenuation, restrict=restrict)
    units = {lamp.unit for lamp in rays}
    farthest = farthest_distance(dtype) / float(froxels.rays.length.max())
    depths = {size: np.minimum(froxels.depths.astype(np.float64) / size, farthest).astype(dtype) for size in units}
    colours = [[channels(lamp.intensity * _factor(lobe, lamp), dtype) for lamp in rays] for lobe in lobes]
    return Lamps(froxels, rays, colours, depths, visibility)


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


def _factor(lobe: Lobe, lamp: LightRays) -> float:
    """What is constant in a lobe's phase function and, as `_reach` leaves it, in a light's window."""
    factor = lobe.share * (0.25 if lamp.windowed else 1.0)
    if lobe.name == "isotropic":
        return factor * 0.25 / math.pi
    if lobe.name == "henyey_greenstein" and not lobe.scaled:
        return factor * float(prefactor(lobe.g)[0, 0, 0])
    return factor


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
    shape, dtype = lights[0].shape[1:], lights[0].dtype
    scratch = _scratch(memory, 6 * lights[0][0].size, dtype)
    along = scratch[-lights[0][0].size:].reshape(shape)
    terms = [_terms(lobe, z, y, shape, dtype) for lobe in lobes]
    measured = 0.0
    for k, lamp in enumerate(lamps.rays):
        area = rect(lamp.boxes, z, y)
        if area is None:
            continue
        if lamp.unit != measured:
            measured = lamp.unit
            np.multiply(lamps.depths[measured][z], lamps.froxels.rays.length[y], out=along)
        work = _reach(lamps, lamp, area, along, scratch, z, y)
        for lobe, term, colours, light in zip(lobes, terms, lamps.colours, lights, strict=True):
            _weigh(lobe, _inside(term, work.here), work)
            for channel, factor in zip(light, colours[k], strict=True):
                np.multiply(work.w, factor, out=work.v)
                np.add(channel[work.here], work.v, out=channel[work.here])


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
    g = part(lobe.g, z, y)
    sign = np.broadcast_to(np.copysign(np.ones((), dtype), g), shape) if (g < 0.0).any() else None
    return Terms(np.broadcast_to(g, shape), np.broadcast_to(_slope(g), shape), sign)


def _inside(terms: Terms, here: Rect) -> Terms:
    """The terms in a part of the block."""
    if terms.g.size == 1:
        return terms
    return Terms(terms.g[here], terms.slope[here], None if terms.sign is None else terms.sign[here])


def _reach(lamps: Lamps, lamp: LightRays, area: Rect, along: Field, scratch: Field, z: slice,
           y: slice) -> Work:
    """Distances to a light, and what its window, cone and visibility leave of it (four times the window)."""
    az, ay, ax = area
    here = slice(az.start - z.start, az.stop - z.start), slice(ay.start - y.start, ay.stop - y.start), ax
    t = along[here]
    s, d, reach, v, w = scratch[:5 * t.size].reshape(5, *t.shape)
    top, left = lamp.corner
    rays = slice(ay.start - top, ay.stop - top), slice(ax.start - left, ax.stop - left)
    work = Work(area, here, lamp.across2[rays], s, d, reach, v, w)
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
    sight = lamps.visibility.get(lamp.number)
    if sight is not None:
        reach *= sight(froxel_points(lamps.froxels, az, ay, ax))
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
