"""Transmittance of the media from points to a light."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from froxel_ref.arrays import Points
from froxel_ref.density import Placed
from froxel_ref.lights import unit
from froxel_ref.optical_depth import Lines, column, medium_path
from froxel_ref.scene import DirectionalLight, Light
from froxel_ref.settings import Settings

__all__ = ["light_transmittance", "ways_to_light"]

Array: TypeAlias = NDArray[np.floating[Any]]


def light_transmittance(media: Sequence[Placed], extinction: Array, light: Light, points: Points, *,
                        settings: Settings, sun_distance: float = np.inf) -> Array:
    """What the media let through of a light on its way to points.

    Parameters
    ----------
    media : sequence of Placed
        All media.
    extinction : ndarray, shape (media, C) [1/m]
        From `froxel_ref.optical_depth.extinctions`.
    light : Light
        Where the way ends.
    points : Points [m]
        Three arrays that broadcast together.
    settings : Settings
        Its time and density_addressing.
    sun_distance : float [m]
        Length of the way to a directional light.

    Returns
    -------
    ndarray, shape (C, …) [1]

    Notes
    -----
    exp(−∫ σ_t) in closed form, or exactly cell by cell through a texture (`froxel_ref.optical_depth`).

    A global medium without a ceiling has no end towards a sun at infinity. Where its optical depth that way
    is finite (height fog and a sun above the horizon) it dims the sun; where it is infinite, no light would
    arrive at all, and the sun's irradiance is taken as that within the medium, which then does not dim it.
    A finite sun_distance makes every medium dim the sun over that length.

    Examples
    --------
    >>> from froxel_ref.density import place
    >>> from froxel_ref.scene import Medium, PointLight
    >>> lamp = PointLight(position=(0.0, 2.0, 0.0), intensity=(1.0, 1.0, 1.0))
    >>> x = np.zeros(1)
    >>> light_transmittance([place(Medium(extinction=0.5))], np.array([[0.5]]), lamp, (x, x, x),
    ...                     settings=Settings()).round(6).tolist()
    [[0.367879]]
    """
    shape = np.broadcast_shapes(*(p.shape for p in points))
    origin = np.stack([np.broadcast_to(p, shape).reshape(-1) for p in points])
    lines = ways_to_light(light, origin, sun_distance)
    total = np.zeros((extinction.shape[1], origin.shape[1]))
    for placed, factors in zip(media, extinction, strict=True):
        if not factors.any():
            continue
        ways = _bounded(placed, lines)
        path = medium_path(placed, ways, time=settings.time, addressing=settings.density_addressing,
                           keep=False)
        piece = column(path, ways.stop)
        piece = np.where(np.isfinite(piece), piece, 0.0)
        with np.errstate(over="ignore"):
            total += factors[:, np.newaxis] * piece
    with np.errstate(under="ignore"):
        return np.exp(-total).reshape(-1, *shape)


def ways_to_light(light: Light, origin: Array, sun_distance: float) -> Lines:
    """Lines from points, shape (3, n) [m], to a light; of length ``sun_distance`` to a directional one."""
    count = origin.shape[1]
    start = np.zeros(count)
    if isinstance(light, DirectionalLight):
        towards = np.asarray(unit(light.direction))[:, np.newaxis]
        return Lines(origin, np.broadcast_to(towards, origin.shape), start, np.full(count, sun_distance))
    way = np.asarray(light.position)[:, np.newaxis] - origin
    length = np.sqrt((way * way).sum(axis=0))
    return Lines(origin, way / np.maximum(length, 1e-300), start, length)


def _bounded(placed: Placed, lines: Lines) -> Lines:
    """Lines through a texture end where height fog has fallen to e^−60, or at once if they have no end."""
    if placed.texture is None or np.isfinite(lines.stop).all():
        return lines
    path = medium_path(placed._replace(texture=None), lines)
    with np.errstate(divide="ignore", invalid="ignore"):
        fallen = path.fall_from + np.maximum(60.0 - path.exponent, 0.0) / path.slope
    fallen = np.where(path.slope > 0.0, fallen, 0.0)
    return lines._replace(stop=np.where(np.isfinite(path.leave), path.leave, fallen))
