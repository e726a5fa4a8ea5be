"""Voxelised extinction: media and particles as one grid over a box, and the way of light through it.

The grid n × n × n covers an axis-aligned box [Hillaire 2015; Dörries 2020, §3.3.1]: voxel (k, j, i) covers the i-th of
n equal parts along x, the j-th along y, the k-th along z. Rays marched through it give the slices of an opacity
shadow map (`froxel_ref.opacity_slices`).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from froxel_ref.arrays import Field, Points
from froxel_ref.records import InputError, shown, suggest
from froxel_ref.sampling import fetch_nearest, fetch_trilinear

__all__ = ["VOXELISATIONS", "Box", "march", "voxel_centres", "voxelise_media", "voxelise_particles"]

Array: TypeAlias = NDArray[np.floating[Any]]
Vector: TypeAlias = tuple[float, float, float]

VOXELISATIONS = ("point", "trilinear")


class Box(NamedTuple):
    """An axis-aligned box in the world.

    Attributes
    ----------
    low, high : (float, float, float) [m]
        Corners with the least and the greatest x, y and z.
    """

    low: Vector
    high: Vector


def voxel_centres(box: Box, *, size: int = 32) -> Points:
    """World positions of the voxels' centres.

    Parameters
    ----------
    box : Box
        What the grid covers.
    size : int
        n. Default: 32.

    Returns
    -------
    Points [m]
        x along the last of three axes, y along the middle one, z along the first.

    Raises
    ------
    InputError
        A box without volume; no voxels.

    Examples
    --------
    >>> [axis.ravel().tolist() for axis in voxel_centres(Box((0.0, 0.0, 0.0), (1.0, 2.0, 4.0)), size=2)]
    [[0.25, 0.75], [0.5, 1.5], [1.0, 3.0]]
    """
    if size < 1:
        raise InputError("size", f"is {shown(size)}, must be at least 1")
    steps = _steps(box, size)
    x, y, z = (low + (np.arange(size) + 0.5) * step for low, step in zip(box.low, steps, strict=True))
    return x[None, None, :], y[None, :, None], z[:, None, None]


def _steps(box: Box, size: int) -> Vector:
    x, y, z = (high - low for low, high in zip(box.low, box.high, strict=True))
    if not min(x, y, z) > 0.0:
        raise InputError("box", f"is {shown((*box.low, *box.high))}, must have a volume")
    return x / size, y / size, z / size


def voxelise_media(extinction: Callable[[Points], Field], box: Box, *, size: int = 32) -> Array:
    """The extinction of media at the voxels' centres.

    Parameters
    ----------
    extinction : callable
        From world positions to extinction [m⁻¹], summed over the media.
    box : Box
        What the grid covers.
    size : int
        n.

    Returns
    -------
    ndarray, shape (n, n, n) [m⁻¹]

    Raises
    ------
    InputError
        As for `voxel_centres`.

    Notes
    -----
    One sample a voxel, as in froxels: order 2 where extinction is smooth, 1 at a medium's edge.

    Examples
    --------
    >>> grid = voxelise_media(lambda points: 2.0 * points[0], Box((0.0, 0.0, 0.0), (1.0, 1.0, 1.0)), size=2)
    >>> grid[0, 0].tolist()
    [0.5, 1.5]
    """
    values = extinction(voxel_centres(box, size=size))
    return np.array(np.broadcast_to(values, (size, size, size)))


def voxelise_particles(position: Points, cross_section: Field, box: Box, *, size: int = 32,
                       method: str = "trilinear") -> Array:
    """The extinction of particles, each given to one voxel or shared by eight.

    Parameters
    ----------
    position : Points, shape (p,) [m]
        Where the particles' centres lie.
    cross_section : Field, shape (p,) [m²]
        How much of light each takes away, per irradiance: the optical depth of the particle, seen face on, times the
        area it has there.
    box : Box
        What the grid covers; what lies outside is left out.
    size : int
        n.
    method : {"point", "trilinear"}
        "point": all in the voxel that holds the centre. "trilinear": shared by the eight whose centres are nearest.

    Returns
    -------
    ndarray, shape (n, n, n) [m⁻¹]
        Add it to that of the media.

    Raises
    ------
    InputError
        As for `voxel_centres`; an unknown method.

    Notes
    -----
    Extinction is cross-section over a voxel's volume, so its integral over the box is the sum of the cross-sections,
    to rounding, by both methods; at the box's faces the outer voxel keeps the share of those that are missing.
    Hillaire has an extinction from opacity and a factor set by hand instead; multiply the cross-section by yours.
    A particle larger than a voxel is squeezed into it, by both.

    Examples
    --------
    >>> box = Box((0.0, 0.0, 0.0), (2.0, 2.0, 2.0))
    >>> place = tuple(np.array([v]) for v in (0.75, 0.5, 0.5))
    >>> voxelise_particles(place, np.array([4.0]), box, size=2)[0, 0].tolist()
    [3.0, 1.0]
    """
    if method not in VOXELISATIONS:
        raise InputError("method", f"is {shown(method)}; {suggest(str(method), VOXELISATIONS)}")
    steps = _steps(box, size)
    coordinates = [(p - low) / step for p, low, step in zip(position, box.low, steps, strict=True)]
    inside = np.logical_and.reduce([(c >= 0.0) & (c <= size) for c in coordinates])
    values = np.where(inside, cross_section, 0.0) / (steps[0] * steps[1] * steps[2])
    index, weight = np.zeros((1, len(values)), np.intp), values[None]
    for c in reversed(coordinates):  # z first: its stride is the largest
        cells, shares = _cells(np.where(inside, c, 0.0), size, method)
        index = (index[:, None] * size + cells).reshape(-1, len(values))
        weight = (weight[:, None] * shares).reshape(-1, len(values))
    summed = np.bincount(index.ravel(), weights=weight.ravel(), minlength=size**3)
    return np.asarray(summed.reshape(size, size, size), values.dtype)


def _cells(c: Field, size: int, method: str) -> tuple[NDArray[np.intp], Array]:
    """Along one axis: the voxels that get something, and how much."""
    if method == "point":
        return np.minimum(np.floor(c), size - 1).astype(np.intp)[None], np.ones((1, len(c)), c.dtype)
    middle = np.clip(c - 0.5, 0.0, size - 1.0)
    cell = np.minimum(np.floor(middle), max(size - 2, 0))
    share = middle - cell
    cells = np.minimum(np.stack([cell, cell + 1.0]), size - 1.0).astype(np.intp)
    return cells, np.stack([1.0 - share, share])


def march(grid: Field, box: Box, origin: Points, direction: Points, near: Field | float, far: Field | float, *,
          slices: int = 32, lookup: str = "trilinear") -> Array:
    """The optical depth of slices of rays through the grid.

    Parameters
    ----------
    grid : ndarray, shape (n, n, n) [m⁻¹]
        Extinction.
    box : Box
        What it covers; there is none outside.
    origin : Points [m]
        Where rays begin: the light, or a place on its plane for each ray.
    direction : Points, shape (…) [1]
        Unit vectors.
    near, far : Field or float [m]
        Distances between which the slices lie.
    slices : int
        S, one sample each.
    lookup : {"trilinear", "point"}
        Between voxels' centres, as a sampler does, or the voxel that holds the sample.

    Returns
    -------
    ndarray, shape (S, …) [1]
        Turned into a map by `opacity_slices.opacity_slices`.

    Raises
    ------
    InputError
        No slices; an unknown lookup; a box without volume.

    Notes
    -----
    Extinction at the slice's middle times its length [Hillaire 2015]: order 2 in the length between voxels' centres.

    Examples
    --------
    >>> ahead, here = (np.zeros(1), np.zeros(1), np.ones(1)), tuple(np.zeros(1) for _ in range(3))
    >>> box = Box((-1.0, -1.0, 0.0), (1.0, 1.0, 2.0))
    >>> march(np.full((4, 4, 4), 3.0), box, here, ahead, 0.0, 4.0, slices=4).ravel().tolist()
    [3.0, 3.0, 0.0, 0.0]
    """
    if slices < 1:
        raise InputError("slices", f"is {shown(slices)}, must be at least 1")
    if lookup not in VOXELISATIONS:
        raise InputError("lookup", f"is {shown(lookup)}; {suggest(str(lookup), VOXELISATIONS)}")
    size = grid.shape[-1]
    steps = _steps(box, size)
    rays = np.broadcast_shapes(*(a.shape for a in (*origin, *direction)), np.shape(near), np.shape(far))
    length = (np.asarray(far) - near) / slices
    middle = (np.arange(slices) + 0.5).reshape(slices, *(1,) * len(rays)).astype(grid.dtype)
    distance = near + middle * length
    coordinates = [(o + distance * d - low) / step
                   for o, d, low, step in zip(origin, direction, box.low, steps, strict=True)]
    inside = np.logical_and.reduce(np.broadcast_arrays(*((c >= 0.0) & (c <= size) for c in coordinates)))
    fetch = fetch_trilinear if lookup == "trilinear" else fetch_nearest
    values = fetch(np.asarray(grid), *coordinates)
    return np.asarray(values * inside * length, grid.dtype)
