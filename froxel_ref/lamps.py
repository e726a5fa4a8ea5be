"""Point and spot lights, and the parts of the scattering, made ready for the blocks of a grid.

What they add to a block is worked out in `froxel_ref.lamp_batches`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from froxel_ref.arrays import Candidates, Field, Index, Visibility
from froxel_ref.grid import Froxels
from froxel_ref.grid_parts import bounds_in
from froxel_ref.light_rays import LightRays, farthest_distance, light_rays
from froxel_ref.records import InputError
from froxel_ref.scene import PointLight

__all__ = [
    "PLAIN", "LampRays", "Lamps", "Lobe", "channels", "lamps_in", "make_lamps", "make_lobe", "part", "prefactor",
    "relate_lamps",
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
    varies : bool
        Whether g does, if not here then in another piece of the grid.
    """

    scattering: Field
    share: float
    first: bool
    name: str
    g: Field
    careful: bool
    varies: bool

    @property
    def scaled(self) -> bool:
        """Whether the phase function's prefactor varies, so that lights are summed without it."""
        return self.name == "henyey_greenstein" and self.varies


class LampRays(NamedTuple):
    """Point and spot lights as the rays of a whole grid see them, for the grid or a part of it.

    Attributes
    ----------
    box : Index
        The part, in the grid.
    rays : LightRays
        The lights. Rays are counted in the grid, boxes in the part.
    depths : dict of float to Field, shape (D, 1, 1)
        The view depth of the grid's samples in each light's unit.
    common : float [m]
        The unit of most lights.
    """

    box: Index
    rays: LightRays
    depths: dict[float, Field]
    common: float


class Lamps(NamedTuple):
    """The point and spot lights that reach a grid, or a part of one.

    Attributes
    ----------
    froxels : Froxels
        The part's.
    related : LampRays
        The lights.
    colours : list of Field, shape (n, 3, 1, 1, 1)
        For each lobe, the lights' intensities with all constant factors.
    visibility : Visibility
        As for `froxel_ref.lighting.in_scattering`.
    candidates : Candidates or None
        Which lights a block has to visit; all of them unless given.
    """

    froxels: Froxels
    related: LampRays
    colours: list[Field]
    visibility: Visibility
    candidates: Candidates | None = None

    @property
    def rays(self) -> LightRays:
        """The lights."""
        return self.related.rays


def make_lobe(scattering: Field, share: float, first: bool, name: str, g: Field | float, dtype: Type, *,
              span: tuple[float, float] | None = None) -> Lobe:
    """Make a lobe and find out how its phase function is best computed.

    Parameters
    ----------
    scattering, share, first, name
        As in `Lobe`.
    g : Field or float
        Phase anisotropy.
    dtype : dtype
        Of the arithmetic; g is moved to where it still is below 1 in it.
    span : (float, float), optional
        Least and greatest g to choose a formula for; that of ``g`` unless given.

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
    low, high = (float(values.min()), float(values.max())) if span is None else span
    largest = max(-low, high)
    if largest > 1.0:
        raise InputError("phase_anisotropy", f"is {largest:g} in size, must be below 1")
    inside = 1.0 - float(np.finfo(dtype).epsneg)
    varies = low != high and name not in ("isotropic", "rayleigh")  # which have no g
    if not varies:
        values = np.clip(np.full((1, 1, 1), float(values.min())), -inside, inside)
    elif largest > inside:
        values = np.clip(values, -inside, inside)
    if name == "henyey_greenstein" and largest == 0.0:
        name = "isotropic"
    return Lobe(scattering, share, first, name, values, 2.0 * largest > PLAIN * (1.0 - largest) ** 2, varies)


def relate_lamps(lights: Mapping[int, PointLight], froxels: Froxels, *, attenuation: str, restrict: bool) -> LampRays:
    """Relate point and spot lights to the rays of a grid.

    Parameters
    ----------
    lights : mapping of int to PointLight or SpotLight
        By their index.
    froxels : Froxels
        The grid, shape (D, H, W).
    attenuation, restrict
        As for `froxel_ref.lighting.in_scattering`.

    Returns
    -------
    LampRays
        Without the lights that reach nothing.

    Examples
    --------
    >>> from froxel_ref.grid import make_froxels
    >>> from froxel_ref.scene import Camera
    >>> from froxel_ref.settings import Grid
    >>> froxels = make_froxels(Camera(), Grid(width=4, height=4, depth=4))
    >>> near, behind = (PointLight(position=(0.0, 1.7, z), intensity=(1.0, 1.0, 1.0), radius=4.0)
    ...                 for z in (-6.0, 20.0))
    >>> relate_lamps({0: near, 1: behind}, froxels, attenuation="min_distance", restrict=True).rays.numbers.tolist()
    [0]
    """
    dtype = froxels.depths.dtype
    rays = light_rays(lights, froxels, attenuation=attenuation, restrict=restrict)
    farthest = farthest_distance(dtype) / float(froxels.rays.length.max())
    units, count = np.unique(rays.units, return_counts=True)
    windowed = set(rays.units[rays.windowed].tolist())
    depths = {size: _in_units(froxels.depths, size, farthest, windowed=size in windowed).astype(dtype)
              for size in units.tolist()}
    common = float(units[np.argmax(count)]) if units.size else 0.0
    depth, height, width = len(froxels.depths), *froxels.rays.length.shape
    return LampRays((slice(0, depth), slice(0, height), slice(0, width)), rays, depths, common)


def lamps_in(lamps: LampRays, box: Index) -> LampRays:
    """What a part of a grid has of the lights that are related to all of it.

    Parameters
    ----------
    lamps : LampRays
        From `relate_lamps`.
    box : Index
        The part, with numbers for its starts and stops.

    Returns
    -------
    LampRays
        With all lights; their boxes are those of the part.

    Examples
    --------
    >>> from froxel_ref.grid import make_froxels
    >>> from froxel_ref.scene import Camera
    >>> from froxel_ref.settings import Grid
    >>> froxels = make_froxels(Camera(), Grid(width=8, height=8, depth=4))
    >>> lamp = PointLight(position=(0.0, 1.7, -6.0), intensity=(1.0, 1.0, 1.0), radius=5.0)
    >>> lamps = relate_lamps({0: lamp}, froxels, attenuation="min_distance", restrict=True)
    >>> half = lamps_in(lamps, (slice(0, 4), slice(1, 8, 2), slice(1, 8, 2)))
    >>> lamps.rays.boxes[0, 2].tolist(), half.rays.boxes[0, 2].tolist()
    ([2, 6, 0, 8], [1, 3, 0, 4])
    """
    boxes, close = (bounds_in(boxes, box) for boxes in (lamps.rays.boxes, lamps.rays.close))
    return lamps._replace(box=box, rays=lamps.rays._replace(boxes=boxes, close=close))


def make_lamps(related: LampRays, lobes: Sequence[Lobe], froxels: Froxels, *, visibility: Visibility,
               candidates: Candidates | None = None) -> Lamps:
    """Prepare point and spot lights for the blocks of a grid, or of a part of one.

    Parameters
    ----------
    related : LampRays
        From `relate_lamps` or `lamps_in`.
    lobes : sequence of Lobe
        The parts of the medium.
    froxels : Froxels
        The part's.
    visibility, candidates
        As for `froxel_ref.lighting.in_scattering`.

    Returns
    -------
    Lamps

    Examples
    --------
    See `froxel_ref.lamp_batches.add_lamps`.
    """
    dtype, rays = froxels.depths.dtype, related.rays
    # What is constant in the phase function and, as `lamp_batches` leaves it, in the window.
    window = np.where(rays.windowed, 0.25, 1.0)[:, np.newaxis]
    colours = [np.asarray(np.minimum(rays.intensity * (_factor(lobe) * window), np.finfo(dtype).max), dtype)
               .reshape(-1, 3, 1, 1, 1) for lobe in lobes]
    return Lamps(froxels, related, colours, visibility, candidates)


def _in_units(depths: Field, size: float, farthest: float, *, windowed: bool) -> Field:
    """Depths in a light's unit; too large ones as if behind the camera, where no window reaches them."""
    measured = depths.astype(np.float64) / size
    return np.where(measured > farthest, -2.0 * farthest if windowed else farthest, measured)


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
