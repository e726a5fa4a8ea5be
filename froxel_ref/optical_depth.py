"""Optical depth along lines, to any point of them: in closed form, or cell by cell through a texture.

A medium's *column* is the integral of its density along a line [m]; times its extinction it is the optical
depth. Without a texture the density is 1, or exp(−u) with u linear along the line, between where the line
enters and leaves the medium, so the column has a closed form (`medium_path`, `column`). Through a texture
the density is a cubic in every cell, times the same exponential (`froxel_ref.texture_depth`).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from froxel_ref.density import Placed
from froxel_ref.geometry import Lines, transform_points
from froxel_ref.scene import LocalMedium, Medium
from froxel_ref.texture_depth import Cells, cell_column, make_cells

__all__ = ["Lines", "MediumPath", "column", "extinctions", "line_points", "local_line", "medium_path",
           "optical_depth", "support"]

Array: TypeAlias = NDArray[np.floating[Any]]
Rows: TypeAlias = NDArray[np.integer[Any]] | slice

ALL = slice(None)


class MediumPath(NamedTuple):
    """One medium along lines: where it is, and how its density runs there. All arrays of shape (n,).

    Attributes
    ----------
    enter, leave : ndarray [m]
        The stretch inside the medium; equal where there is none.
    flat_from, flat_to : ndarray [m]
        Where height fog has density 1.
    fall_from, fall_to : ndarray [m]
        Where it is exp(−exponent − slope·(t − fall_from)).
    exponent : ndarray
        At fall_from, at least 0.
    slope : ndarray [1/m]
        Of the exponent along the line.
    cells : Cells or None
        A density texture's cells along the lines.
    """

    enter: Array
    leave: Array
    flat_from: Array
    flat_to: Array
    fall_from: Array
    fall_to: Array
    exponent: Array
    slope: Array
    cells: Cells | None = None


def line_points(lines: Lines, t: Array, rows: Rows = ALL) -> tuple[Array, Array, Array]:
    """Points on lines.

    Parameters
    ----------
    lines : Lines
    t : ndarray, shape (n, …)
        One row of parameters for each line chosen.
    rows : ndarray of int or slice
        The lines.

    Returns
    -------
    tuple of 3 ndarrays, shape of ``t`` [m]

    Examples
    --------
    >>> one = np.array([[0.0], [1.0], [2.0]])
    >>> [c.tolist() for c in line_points(Lines(one, one, one[0], one[0]), np.array([2.0]))]
    [[0.0], [3.0], [6.0]]
    """
    shape = (-1, *(1,) * (t.ndim - 1))
    x, y, z = (start[rows].reshape(shape) + step[rows].reshape(shape) * t
               for start, step in zip(lines.origin, lines.direction, strict=True))
    return x, y, z


def extinctions(media: Sequence[Medium]) -> Array:
    """The media's extinctions at density 1, shape (media, 1 or 3) [1/m]: one channel if none is RGB."""
    wide = any(isinstance(medium.extinction, tuple) for medium in media)
    rows = [np.broadcast_to(np.asarray(m.extinction, np.float64), (3 if wide else 1,)) for m in media]
    return np.stack(rows) if rows else np.zeros((0, 1))


# --- one medium -------------------------------------------------------------------------------------


def local_line(placed: Placed, lines: Lines) -> tuple[tuple[Array, Array, Array], tuple[Array, Array, Array]]:
    """A line's origin and direction in the space of a medium's shape (the world for a global one)."""
    ox, oy, oz = lines.origin
    dx, dy, dz = lines.direction
    if placed.local_from_world is None:
        return (ox, oy, oz), (dx, dy, dz)
    origin = transform_points(placed.local_from_world, (ox, oy, oz))
    direction = transform_points(placed.local_from_world, (dx, dy, dz), directions=True)
    return origin, direction


def support(placed: Placed, lines: Lines) -> tuple[Array, Array]:
    """Where lines run inside a medium: its shape, below its ceiling, within the lines' stretch.

    Parameters
    ----------
    placed : Placed
        The medium.
    lines : Lines

    Returns
    -------
    enter, leave : ndarray, shape (n,)
        Equal where the line misses it. One stretch, since all shapes are convex.

    Notes
    -----
    Box: slabs; ellipsoid: with o, d in local space the roots are (−o·d ± √(d·d − |o×d|²))/d·d, where the
    cross product keeps the digits that (o·d)² − d·d(o·o − 1) loses.

    Examples
    --------
    >>> from froxel_ref.density import place
    >>> lines = Lines(np.array([[0.0], [0.0], [4.0]]), np.array([[0.0], [0.0], [-1.0]]), np.zeros(1),
    ...               np.array([9.0]))
    >>> [c.tolist() for c in support(place(LocalMedium(shape="ellipsoid")), lines)]
    [[3.0], [5.0]]
    """
    medium = placed.medium
    origin, direction = local_line(placed, lines)
    low, high = lines.start, lines.stop
    if isinstance(medium, LocalMedium):
        near, far = (_ellipsoid if medium.shape == "ellipsoid" else _box)(origin, direction)
        low, high = np.maximum(low, near), np.minimum(high, far)
    fog = medium.height_fog
    if fog is not None and fog.max_height is not None:
        y, dy = _height(placed, origin, direction)
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            ceiling = (fog.max_height - y) / dy
        low = np.maximum(low, np.where(dy < 0.0, ceiling, -np.inf))
        high = np.minimum(high, np.where(dy > 0.0, ceiling, np.inf))
        high = np.where((dy == 0.0) & (y > fog.max_height), low, high)
    missed = ~(low < high)
    return np.where(missed, lines.start, low), np.where(missed, lines.start, high)


def _box(origin: tuple[Array, ...], direction: tuple[Array, ...]) -> tuple[Array, Array]:
    low, high = np.full(origin[0].shape, -np.inf), np.full(origin[0].shape, np.inf)
    for o, d in zip(origin, direction, strict=True):
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            a, b = (-1.0 - o) / d, (1.0 - o) / d
        outside = np.where(np.abs(o) <= 1.0, -np.inf, np.inf)
        low = np.maximum(low, np.where(d == 0.0, outside, np.minimum(a, b)))
        high = np.minimum(high, np.where(d == 0.0, -outside, np.maximum(a, b)))
    return low, high


def _ellipsoid(origin: tuple[Array, ...], direction: tuple[Array, ...]) -> tuple[Array, Array]:
    ox, oy, oz = origin
    dx, dy, dz = direction
    a, b = dx * dx + dy * dy + dz * dz, ox * dx + oy * dy + oz * dz
    cx, cy, cz = oy * dz - oz * dy, oz * dx - ox * dz, ox * dy - oy * dx
    inside = a - (cx * cx + cy * cy + cz * cz)
    root = np.sqrt(np.maximum(inside, 0.0))
    miss = inside <= 0.0
    return np.where(miss, np.inf, (-b - root) / a), np.where(miss, -np.inf, (-b + root) / a)


def _height(placed: Placed, origin: tuple[Array, ...], direction: tuple[Array, ...]) -> tuple[Array, Array]:
    """The height that fog is measured by along the line: at t = 0, and its change per t."""
    if placed.local_from_world is None:
        return origin[1], direction[1]
    return origin[1] * 0.5 + 0.5, direction[1] * 0.5


def medium_path(placed: Placed, lines: Lines, *, time: float = 0.0, addressing: str = "wrap",
                keep: bool = True) -> MediumPath:
    """Lay lines through a medium.

    Parameters
    ----------
    placed : Placed
        The medium, from `froxel_ref.density.place`.
    lines : Lines
        In world metres; finite where the medium has a texture.
    time, addressing
        As for `froxel_ref.density.density_at`.
    keep : bool
        Keep what a texture needs for columns up to points between; without, only whole columns are right.

    Returns
    -------
    MediumPath

    Notes
    -----
    The exponent of height fog, u = falloff·(y − start), is linear along the line; the density is
    exp(−max(u, 0)). A line that is level in the fog has slope 0, which needs no case of its own.
    """
    enter, leave = support(placed, lines)
    fog = placed.medium.height_fog
    nothing = np.zeros_like(enter)
    if fog is None or fog.falloff == 0.0:
        path = MediumPath(enter, leave, enter, leave, leave, leave, nothing, nothing)
    else:
        y, dy = _height(placed, *local_line(placed, lines))
        falloff = min(fog.falloff, 1e300)
        with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
            first, slope = falloff * (y - fog.start), falloff * dy
            crossing = np.clip((fog.start - y) / dy, enter, leave)
        up, level_above = slope > 0.0, (slope == 0.0) & (first > 0.0)
        fall_from = np.where(up, crossing, np.where((slope < 0.0) | level_above, enter, leave))
        fall_to = np.where(slope < 0.0, crossing, leave)
        flat_from, flat_to = np.where(slope < 0.0, fall_to, enter), np.where(slope < 0.0, leave, fall_from)
        flat_to = np.where(level_above, flat_from, flat_to)
        with np.errstate(over="ignore", invalid="ignore"):
            exponent = np.where(up & (fall_from > enter), 0.0, np.maximum(first + slope * fall_from, 0.0))
        exponent = np.where(np.isnan(exponent), 0.0, exponent)
        path = MediumPath(enter, leave, flat_from, flat_to, fall_from, fall_to, exponent, slope)
    if placed.texture is None:
        return path
    return path._replace(cells=make_cells(placed, lines, path, time=time, addressing=addressing, keep=keep))


def column(path: MediumPath, t: Array, rows: Rows = ALL) -> Array:
    """The integral of a medium's density from a line's start to points on it.

    Parameters
    ----------
    path : MediumPath
        From `medium_path`.
    t : ndarray, shape (n, …)
        One row of parameters for each line chosen.
    rows : ndarray of int or slice
        The lines.

    Returns
    -------
    ndarray, shape of ``t`` [m]

    Notes
    -----
    Over a stretch of length l whose exponent runs from u by k·l: l·exp(−min(u, u + kl))·φ(|k|l),
    φ(x) = −expm1(−x)/x. Every factor is positive and formed without cancellation, so the relative error is
    a few ulp plus what the rounding of u does to exp(−u), for every slope including 0.

    Examples
    --------
    >>> from froxel_ref.density import place
    >>> from froxel_ref.scene import HeightFog
    >>> up = Lines(np.zeros((3, 1)), np.array([[0.0], [1.0], [0.0]]), np.zeros(1), np.array([np.inf]))
    >>> path = medium_path(place(Medium(height_fog=HeightFog(start=1.0, falloff=0.5))), up)
    >>> column(path, np.array([[0.5, 1.0, np.inf]])).tolist()
    [[0.5, 1.0, 3.0]]
    """
    if path.cells is not None:
        return cell_column(path.cells, t, rows)
    shape = (-1, *(1,) * (t.ndim - 1))

    def part(field: Array) -> Array:
        return field[rows].reshape(shape)

    result = _within(t, part(path.flat_from), part(path.flat_to))
    if not path.slope.any() and not path.exponent.any():
        return result
    slope = part(path.slope)
    length = _within(t, part(path.fall_from), part(path.fall_to))
    return result + _falling(length, part(path.exponent), slope)


def _within(t: Array, low: Array, high: Array) -> Array:
    """The length of [low, high] up to t."""
    result: Array = np.maximum(np.minimum(t, high) - low, 0.0)
    return result


def _falling(length: Array, exponent: Array, slope: Array) -> Array:
    """∫ exp(−exponent − slope·x) dx over [0, length]."""
    with np.errstate(over="ignore", under="ignore", invalid="ignore", divide="ignore"):
        size = np.abs(slope)
        x = size * length
        lowest = np.maximum(exponent + np.minimum(slope, 0.0) * length, 0.0)
        lowest = np.where(slope < 0.0, lowest, exponent)
        rise = -np.expm1(-x)
        whole = np.where(x > 0.5, rise / size, length * np.where(x > 0.0, rise / x, 1.0))
        result: Array = np.where(length > 0.0, np.exp(-lowest) * whole, 0.0)
    return result


def optical_depth(paths: Sequence[MediumPath], extinction: Array, t: Array, rows: Rows = ALL) -> Array:
    """Optical depth from the lines' start to points on them.

    Parameters
    ----------
    paths : sequence of MediumPath
        One for each medium.
    extinction : ndarray, shape (media, C)
        From `extinctions`.
    t, rows
        As for `column`.

    Returns
    -------
    ndarray, shape (C, n, …) [1]
    """
    total = np.zeros((extinction.shape[1], *t.shape))
    for path, factors in zip(paths, extinction, strict=True):
        if factors.any():
            piece = column(path, t, rows)
            with np.errstate(over="ignore"):  # an infinite depth is as good as a huge one
                for channel, factor in zip(total, factors, strict=True):
                    channel += factor * piece
    return total
