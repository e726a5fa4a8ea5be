"""The density of a participating medium at points: its shape, its height fog and its texture."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import DTypeLike, NDArray

from froxel_ref.arrays import Field, Points
from froxel_ref.geometry import Matrix, transform_points
from froxel_ref.records import InputError
from froxel_ref.sampling import fetch_trilinear
from froxel_ref.scene import DensityTexture, HeightFog, LocalMedium, Medium

__all__ = ["Placed", "density", "density_at", "place"]

Mask = NDArray[np.bool_]


class Placed(NamedTuple):
    """A medium made ready for many points.

    Attributes
    ----------
    medium : Medium
        What it is made of.
    local_from_world : ndarray, shape (4, 4), or None
        Into the space of a local medium's shape.
    texture : ndarray, shape (nz, ny, nx), or None
        Texels of its density.
    """

    medium: Medium
    local_from_world: Matrix | None
    texture: NDArray[Any] | None


def density(medium: Medium, points: Points, texture: NDArray[Any] | None = None, *, time: float = 0.0,
            addressing: str = "wrap") -> Field:
    """Evaluate a medium's density at points.

    Parameters
    ----------
    medium : Medium
        Global or local.
    points : Points [m]
        World positions.
    texture : ndarray, shape (nz, ny, nx), optional
        Texels of ``medium.density``; must be given if the medium has one.
    time : float [s]
        Moves scrolling textures.
    addressing : {"wrap", "clamp"}
        "clamp" has the seam of frac() with a clamping sampler (A5).

    Returns
    -------
    Field [1]
        Broadcastable to the points' shape, with the axes on which it varies; 0 outside a local medium.

    Notes
    -----
    Height fog: 0 where y > max_height, else exp(−falloff·max(y − start, 0)). Texture: trilinear at
    frac(position·scale + bias + scroll·time). Both take the world position in a global medium, and
    p·½ + ½ in a local one, where p is the position in local space. A local medium is where all |p| ≤ 1
    (box) or p·p ≤ 1 (ellipsoid) [Dörries 2020, listings 3.1, 3.8]. Elementwise; float64 error measured
    below 4 ulp of exp's value, times the conditioning of the exponent.

    Examples
    --------
    >>> fog = Medium(height_fog=HeightFog(start=1.0, falloff=0.5, max_height=4.0))
    >>> x, y = np.zeros(1), np.array([0.0, 1.0, 3.0, 5.0])
    >>> density(fog, (x, y, x)).round(4).tolist()
    [1.0, 1.0, 0.3679, 0.0]
    """
    placed = place(medium, texture, dtype=np.result_type(*points))
    return density_at(placed, points, time=time, addressing=addressing)[0]


def place(medium: Medium, texture: NDArray[Any] | None = None, *, dtype: DTypeLike = np.float64) -> Placed:
    """Make a medium ready for `density_at`.

    Parameters
    ----------
    medium : Medium
        Global or local.
    texture : ndarray, shape (nz, ny, nx), optional
        Texels of ``medium.density``; must be given if the medium has one.
    dtype : data type
        Of the arithmetic to come, which the texels are rounded to.

    Returns
    -------
    Placed
        With the inverse of a local medium's transform.

    Raises
    ------
    InputError
        A density texture without its texels.

    Examples
    --------
    >>> from froxel_ref.scene import Transform
    >>> place(LocalMedium(transform=Transform(scale=(2.0, 4.0, 8.0)))).local_from_world.diagonal().tolist()
    [0.5, 0.25, 0.125, 1.0]
    """
    if medium.density is not None and texture is None:
        raise InputError("density", "has no texels here, must come with its texture")
    matrix: Matrix | None = None
    if isinstance(medium, LocalMedium):
        matrix = np.linalg.inv(medium.transform.world_from_local).astype(np.float64)
    texels = None if texture is None or medium.density is None else texture.astype(dtype, copy=False)
    return Placed(medium, matrix, texels)


def density_at(placed: Placed, points: Points, *, time: float = 0.0,
               addressing: str = "wrap") -> tuple[Field, Mask | None]:
    """Evaluate the density of a placed medium, and where its region is.

    Parameters
    ----------
    placed : Placed
        From `place`.
    points : Points [m]
        World positions, three arrays with the same number of axes.
    time, addressing
        As for `density`.

    Returns
    -------
    density : Field [1]
        As from `density`.
    inside : array of bool, or None
        Where a local medium's shape holds the point; None for a global medium.

    Examples
    --------
    >>> x = np.array([0.0, 1.0, 2.0])
    >>> [a.tolist() for a in density_at(place(LocalMedium()), (x, 0 * x, 0 * x))]
    [[1.0, 1.0, 0.0], [True, True, False]]
    """
    medium, inside = placed.medium, None
    if placed.local_from_world is not None and isinstance(medium, LocalMedium):
        local = transform_points(placed.local_from_world, points)
        inside = _inside(medium.shape, local)
        points = (local[0] * 0.5 + 0.5, local[1] * 0.5 + 0.5, local[2] * 0.5 + 0.5)
    value = _height_density(medium.height_fog, points[1])
    if medium.density is not None and placed.texture is not None:
        value = value * _texture_density(medium.density, placed.texture, points, inside, time, addressing)
    return (value if inside is None else value * inside), inside


def _inside(shape: str, local: Points) -> Mask:
    x, y, z = local
    if shape == "ellipsoid":
        return np.asarray(x * x + y * y + z * z <= 1.0)
    return (np.abs(x) <= 1.0) & (np.abs(y) <= 1.0) & (np.abs(z) <= 1.0)


def _height_density(fog: HeightFog | None, y: Field) -> Field:
    one = np.ones((1,) * y.ndim, y.dtype)
    if fog is None:
        return one
    value = one
    if fog.falloff > 0.0:
        # A falloff beyond the type's range would make 0·∞ at the start height.
        falloff = min(fog.falloff, float(np.finfo(y.dtype).max))
        with np.errstate(over="ignore", under="ignore"):
            value = np.exp(np.maximum(y - fog.start, 0.0) * -falloff)
    return value if fog.max_height is None else value * (y <= fog.max_height)


def _texture_density(record: DensityTexture, texture: NDArray[Any], points: Points, inside: Mask | None,
                     time: float, addressing: str) -> Field:
    """The texture at points; at those inside a local medium only, since fetches cost most."""
    if inside is not None and not inside.all():
        shape = np.broadcast_shapes(inside.shape, *(p.shape for p in points))
        chosen = np.broadcast_to(inside, shape)
        x, y, z = (np.broadcast_to(p, shape)[chosen] for p in points)
        result = np.zeros(shape, points[0].dtype)
        result[chosen] = _texture_density(record, texture, (x, y, z), None, time, addressing)
        return result
    coordinates = []
    for i, (point, count) in enumerate(zip(points, reversed(texture.shape), strict=True)):
        # Whole periods are taken off the offset in Python's floats, so that float32 keeps its digits.
        shift = (record.bias[i] + record.scroll[i] * time) % 1.0
        u = point * record.scale[i] + shift
        coordinates.append((u - np.floor(u)) * count)
    fetched: Field = fetch_trilinear(texture, *coordinates, address=addressing)
    return fetched
