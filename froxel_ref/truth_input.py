"""What `froxel_ref.truth` is asked, checked: every fault is one `InputError` that names the argument."""

from __future__ import annotations

from numbers import Integral, Real
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from froxel_ref.optical_depth import Lines
from froxel_ref.records import InputError, shown, suggest
from froxel_ref.scene import LONGEST

__all__ = [
    "FARTHEST", "SHADOWS", "SUN_MEDIA", "TIGHTEST", "check_limits", "check_options", "distances", "make_lines",
    "vectors",
]

Array: TypeAlias = NDArray[np.floating[Any]]

SHADOWS = ("off", "exact")
SUN_MEDIA = ("all", "local")

# The least relative tolerance: some hundred ε, below which the rounding of the integrand decides.
TIGHTEST = 1e-13

# The farthest end of a ray [m]: a view depth of 1e10 m at the edge of the widest field of view.
FARTHEST = 1e4 * LONGEST


def check_options(rtol: float, shadows: str, sun_distance: float, sun_media: str = "all") -> None:
    """Refuse options of `froxel_ref.truth.trace` that make no sense.

    Raises
    ------
    InputError
        Naming the option.

    Examples
    --------
    >>> check_options(0.5, "soft", np.inf)
    Traceback (most recent call last):
        ...
    froxel_ref.records.InputError: shadows: is 'soft'; did you mean 'off'?
    """
    if not _number("rtol", rtol) >= TIGHTEST or not rtol < 1.0:
        raise InputError("rtol", f"is {rtol:g}, must be at least {TIGHTEST:g} (the arithmetic's floor) "
                                 "and below 1")
    if shadows not in SHADOWS or not isinstance(shadows, str):
        hint = suggest(shadows, SHADOWS) if isinstance(shadows, str) else f"must be one of {', '.join(SHADOWS)}"
        raise InputError("shadows", f"is {shown(shadows)}; {hint}")
    if not _number("sun_distance", sun_distance) > 0.0:
        raise InputError("sun_distance", f"is {sun_distance:g}, must be above 0 m")
    if sun_media not in SUN_MEDIA:
        raise InputError("sun_media", f"is {shown(sun_media)}, must be {' or '.join(SUN_MEDIA)}")


def check_limits(volumetric_shadows: bool, limit_rounds: int, limit_intervals: int, threads: int | None) -> None:
    """Refuse a switch that is none and limits that are not whole numbers; raises InputError."""
    if not isinstance(volumetric_shadows, bool | np.bool_):
        raise InputError("volumetric_shadows", f"is {shown(volumetric_shadows)}, must be true or false")
    for name, value, least in (("limit_rounds", limit_rounds, 0), ("limit_intervals", limit_intervals, 1),
                               ("threads", 1 if threads is None else threads, 1)):
        if not isinstance(value, Integral) or isinstance(value, bool) or value < least:
            raise InputError(name, f"is {shown(value)}, must be a whole number, at least {least}")


def _number(name: str, value: float) -> float:
    if not isinstance(value, Real) or isinstance(value, bool):
        raise InputError(name, f"is {shown(value)}, must be a number")
    return float(value)


def vectors(name: str, values: ArrayLike) -> Array:
    """One or more vectors, a column each.

    Parameters
    ----------
    name : str
        What they are called in a fault.
    values : array_like, shape (3, N)

    Returns
    -------
    ndarray, float64, shape (3, N)

    Raises
    ------
    InputError
        Another shape; anything but finite numbers.
    """
    result = _numbers(name, values)
    if result.ndim != 2 or len(result) != 3:
        raise InputError(name, f"has shape {result.shape}, must be (3, N): rows x, y, z, one column a ray")
    if not np.isfinite(result).all():
        raise InputError(name, "has a component that is not finite, must be finite")
    return result


def distances(name: str, values: ArrayLike) -> Array:
    """Distances along rays [m], as a float64 array of any shape.

    Raises
    ------
    InputError
        Anything but numbers from 0 to 1e14 m.
    """
    result = _numbers(name, values)
    if not ((result >= 0.0) & (result <= FARTHEST)).all():
        raise InputError(name, f"must be finite, from 0 to {FARTHEST:g} m")
    return result


def _numbers(name: str, values: ArrayLike) -> Array:
    try:
        return np.asarray(values, np.float64)
    except (TypeError, ValueError):
        raise InputError(name, "is not an array, must be numbers in rows of one length") from None


def make_lines(origins: ArrayLike, directions: ArrayLike, starts: ArrayLike, ends: ArrayLike) -> Lines:
    """Rays from what `froxel_ref.truth.trace` was given.

    Parameters
    ----------
    origins, directions : array_like, shape (3, N) or (3, 1)
        Directions of any length but 0.
    starts, ends : array_like, shape (N,) or () [m]

    Returns
    -------
    Lines
        With directions of length 1; those that had it stay as they are, to the last bit.

    Raises
    ------
    InputError
        Numbers that are not finite or out of range; shapes that do not fit together.

    Examples
    --------
    >>> make_lines([[0.0]] * 3, [[3e200], [0.0], [4e200]], 0.0, 2.0).direction.round(12).tolist()
    [[0.6], [0.0], [0.8]]
    """
    fields = [vectors("origins", origins), vectors("directions", directions)]
    if not (np.abs(fields[0]) <= LONGEST).all():
        raise InputError("origins", f"has a component beyond {LONGEST:g} m, must be within that")
    limits = [distances("starts", starts), distances("ends", ends)]
    count = max((f.shape[-1] for f in (*fields, *limits) if f.ndim and f.shape[-1] != 1), default=1)
    for name, field in zip(("origins", "directions"), fields, strict=True):
        if field.shape[1] not in (1, count):
            raise InputError(name, f"has shape {field.shape}, must be (3, {count}) for {count} rays, or (3, 1) "
                                   "for all of them")
    for name, field in zip(("starts", "ends"), limits, strict=True):
        if field.shape not in ((), (1,), (count,)):
            raise InputError(name, f"has shape {field.shape}, must be ({count},) for {count} rays, or one number")
    start, stop = (np.broadcast_to(field, (count,)) for field in limits)
    if not (stop >= start).all():
        raise InputError("ends", "has a distance below starts, must not be below it")
    return Lines(np.broadcast_to(fields[0], (3, count)), np.broadcast_to(_unit(fields[1]), (3, count)), start, stop)


def _unit(directions: Array) -> Array:
    largest = np.abs(directions).max(axis=0, initial=0.0)
    if not largest.all():
        raise InputError("directions", "has a zero vector, must point somewhere")
    # By a power of two, exactly, so that no square over- or underflows.
    exponent = np.frexp(largest)[1]
    scaled = np.ldexp(directions, -exponent)
    length = np.sqrt((scaled * scaled).sum(axis=0))
    result: Array = np.where(np.abs(np.ldexp(length, np.clip(exponent, -64, 64)) - 1.0) <= 4e-16, directions,
                             scaled / length)
    return result
