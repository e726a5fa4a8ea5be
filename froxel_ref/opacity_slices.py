"""Opacity shadow maps: transmittance along rays at fixed depths, linear in between.

A ray's slices are of equal width. Slice k of S ends at depth (k + 1)/S, and the map holds what passes up to there;
at depth 0 it is 1, which is not stored [Kim 2001; Hillaire 2015; Dörries 2020, §3.3.1].
"""

from __future__ import annotations

from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from froxel_ref.absorbers import Absorbers, inverse_lengths
from froxel_ref.arrays import Field
from froxel_ref.records import InputError, shown, suggest

__all__ = ["HOLDS", "SAMPLINGS", "opacity_slices", "slice_depths", "transmittance"]

Array: TypeAlias = NDArray[np.floating[Any]]

SAMPLINGS = ("mean", "nearest", "linear")
HOLDS = ("transmittance", "depth")


def slice_depths(absorbers: Absorbers, *, slices: int = 32, sampling: str = "mean") -> Array:
    """The optical depth of each slice of the rays.

    Parameters
    ----------
    absorbers : Absorbers
        n stretches a ray, rays along the other axes.
    slices : int
        S. Default: Hillaire's maps have 32 texels along each axis.
    sampling : {"mean", "nearest", "linear"}
        "mean": all that lies in a slice, exactly. "nearest": as voxels of a slice's size would have it, extinction at
        the slice's middle, and points in the slice that holds them. "linear": the same, but a point is shared by the
        two slices whose middles are nearest to it.

    Returns
    -------
    ndarray, shape (S, …) [1]

    Raises
    ------
    InputError
        No slices; an unknown sampling.

    Notes
    -----
    A stretch holds its beginning and not its end. Order 2 in the width of smooth extinction, 1 at edges; a slab that
    lies between two middles is missed by "nearest" and "linear", as by any voxels.

    Examples
    --------
    >>> slab = Absorbers(np.array([0.25]), np.array([0.625]), np.array([3.0]), np.array([0.0]))
    >>> slice_depths(slab, slices=4).tolist(), slice_depths(slab, slices=4, sampling="nearest").tolist()
    ([0.0, 2.0, 1.0, 0.0], [0.0, 2.0, 0.0, 0.0])
    """
    if slices < 1:
        raise InputError("slices", f"is {shown(slices)}, must be at least 1")
    if sampling not in SAMPLINGS:
        raise InputError("sampling", f"is {shown(sampling)}; {suggest(str(sampling), SAMPLINGS)}")
    start, _, tau, rise = absorbers
    point, scale = inverse_lengths(absorbers)
    where = np.minimum(start * slices, np.nextafter(np.asarray(slices, start.dtype), 0.0))
    dots = np.where(point, tau, 0.0)
    result = []
    for k in range(slices):
        if sampling == "mean":
            low, high = (np.clip((edge / slices - start) * scale, 0.0, 1.0) for edge in (k, k + 1))
            inner = (high - low) * (tau + 0.5 * rise * (high + low - 1.0))
        else:
            share = ((k + 0.5) / slices - start) * scale
            inner = ((share >= 0.0) & (share < 1.0)) * scale * (tau + rise * (share - 0.5)) / slices
        result.append(np.sum(inner + dots * _held(where, k, slices, sampling), axis=0))
    return np.asarray(np.stack(result), np.result_type(*absorbers))


def _held(where: Field, k: int, slices: int, sampling: str) -> Array:
    """The share of a point that slice k gets, the point's depth given in slices."""
    if sampling != "linear":
        return np.asarray(np.floor(where) == k, where.dtype)
    away = np.abs(np.clip(where, 0.5, slices - 0.5) - (k + 0.5))
    return np.asarray(np.maximum(1.0 - away, 0.0))


def opacity_slices(depths: Field, *, holds: str = "transmittance") -> Array:
    """What the map holds: running sums of slices' optical depths.

    Parameters
    ----------
    depths : ndarray, shape (S, …) [1]
        Optical depth of each slice, from `slice_depths` or `extinction_voxels.march`.
    holds : {"transmittance", "depth"}
        What is stored, and linear between the slices' ends: transmittance [Hillaire 2015], or optical depth.

    Returns
    -------
    ndarray, shape (S, …) [1]

    Raises
    ------
    InputError
        Anything else to hold.

    Examples
    --------
    >>> opacity_slices(np.array([0.0, 2.0, 1.0, 0.0]), holds="depth").tolist()
    [0.0, 2.0, 3.0, 3.0]
    """
    _check(holds)
    total = np.cumsum(depths, axis=0)
    with np.errstate(under="ignore"):
        return np.asarray(total if holds == "depth" else np.exp(-total))


def transmittance(encoded: Field, depth: Field, *, holds: str = "transmittance") -> Array:
    """What passes up to a point of the ray.

    Parameters
    ----------
    encoded : ndarray, shape (S, …) [1]
        From `opacity_slices`.
    depth : ndarray, shape (m, …) [1]
        Broadcastable to m depths on each ray; outside [0, 1] the end's value is taken.
    holds
        As for `opacity_slices`.

    Returns
    -------
    ndarray, shape (m, …) [1]
        In [0, 1], never rising with the depth, exact at the slices' ends (if the slices are).

    Raises
    ------
    InputError
        Anything else to hold.

    Examples
    --------
    >>> transmittance(opacity_slices(np.array([0.0, 2.0])), np.array([0.25, 0.75, 1.0])).round(4).tolist()
    [1.0, 0.5677, 0.1353]
    """
    _check(holds)
    slices, rays = len(encoded), encoded.shape[1:]
    clear = np.full((1, *rays), holds == "transmittance", encoded.dtype)
    size = int(np.prod(rays))
    flat = np.concatenate([clear, encoded]).reshape(-1)
    place = np.clip(depth, 0.0, 1.0) * slices
    below = np.minimum(np.floor(place), slices - 1)
    index = below.astype(np.intp) * size + np.arange(size).reshape(rays)
    near, far = flat.take(index), flat.take(index + size)
    share = place - below
    value = near * (1.0 - share) + far * share
    with np.errstate(under="ignore"):
        return np.asarray(value if holds == "transmittance" else np.exp(-value))


def _check(holds: str) -> None:
    if holds not in HOLDS:
        raise InputError("holds", f"is {shown(holds)}; {suggest(str(holds), HOLDS)}")
