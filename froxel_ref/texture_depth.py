"""Columns of a density texture along lines, cell by cell.

Between the centres of neighbouring texels the density is trilinear, hence a cubic along a line. A line is
cut where it crosses the planes through the texels' centres; in each piece a Gauss rule of two points is
exact, or one of five where height fog multiplies the cubic by an exponential.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from froxel_ref.density import Placed, density_at
from froxel_ref.geometry import transform_points
from froxel_ref.records import InputError

if TYPE_CHECKING:
    from froxel_ref.optical_depth import Lines, MediumPath, Rows

__all__ = ["Cells", "cell_column", "crossings", "make_cells", "nearest_face", "texel_steps"]

Array: TypeAlias = NDArray[np.floating[Any]]

# The most cells that a line may cross: a table of 2 numbers a cell and line is kept.
MOST_CELLS = 20000


class Cells(NamedTuple):
    """The pieces of lines between the faces of a texture's cells.

    Attributes
    ----------
    placed, lines, time, addressing
        What the density is evaluated with.
    knots : ndarray, shape (n, J)
        Ends of the pieces, ascending.
    sums : ndarray, shape (n, J)
        The column up to each knot [m].
    order : int
        Points of the Gauss rule in a piece.
    """

    placed: Placed
    lines: Lines
    time: float
    addressing: str
    knots: Array
    sums: Array
    order: int


def _coordinates(placed: Placed, lines: Lines, time: float) -> list[tuple[Array, Array, int]]:
    """For each axis the texel coordinate at t = 0 and per t, and the number of texels."""
    record, texture = placed.medium.density, placed.texture
    if record is None or texture is None:
        return []
    origin = (lines.origin[0], lines.origin[1], lines.origin[2])
    direction = (lines.direction[0], lines.direction[1], lines.direction[2])
    if placed.local_from_world is not None:
        local = transform_points(placed.local_from_world, origin)
        origin = (local[0] * 0.5 + 0.5, local[1] * 0.5 + 0.5, local[2] * 0.5 + 0.5)
        turned = transform_points(placed.local_from_world, direction, directions=True)
        direction = (turned[0] * 0.5, turned[1] * 0.5, turned[2] * 0.5)
    axes = []
    for i, count in enumerate(reversed(texture.shape)):
        shift = (record.bias[i] + record.scroll[i] * time) % 1.0
        start = (origin[i] * record.scale[i] + shift) * count
        axes.append((start, direction[i] * record.scale[i] * count, count))
    return axes


def texel_steps(placed: Placed, lines: Lines, time: float = 0.0) -> Array:
    """Texels that lines cross on each axis per unit of t, shape (3, n); 0 on an axis of one texel."""
    steps = [step * (count > 1) for _, step, count in _coordinates(placed, lines, time)]
    return np.stack(steps) if steps else np.zeros((3, lines.start.size))


def crossings(placed: Placed, lines: Lines, low: Array, high: Array, *, time: float = 0.0,
              addressing: str = "wrap") -> Array:
    """Where stretches of lines cross the faces of a texture's cells.

    Parameters
    ----------
    placed : Placed
        A medium with a texture.
    lines : Lines
    low, high : ndarray, shape (n,)
        The stretches, finite.
    time, addressing
        As for `froxel_ref.density.density_at`.

    Returns
    -------
    ndarray, shape (n, J)
        Ascending from low to high; the last ones repeat high.

    Raises
    ------
    InputError
        A line crosses more than 20000 cells.

    Notes
    -----
    The faces lie at texel coordinates k + ½. With the seam of A5 ("clamp") also at whole periods.
    """
    parts = [low[:, np.newaxis], high[:, np.newaxis]]
    for start, step, count in _coordinates(placed, lines, time):
        for offset, period in _families(count, addressing):
            a, b = (start + step * low - offset) / period, (start + step * high - offset) / period
            first = np.ceil(np.minimum(a, b))
            most = int(np.max(np.floor(np.maximum(a, b)) - first + 1.0, initial=0.0))
            if most > MOST_CELLS:
                raise InputError("density.scale",
                                 f"makes a ray cross {most} cells, must be at most {MOST_CELLS}")
            if most <= 0:
                continue
            planes = (first[:, np.newaxis] + np.arange(most)) * period + offset
            with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
                t = (planes - start[:, np.newaxis]) / step[:, np.newaxis]
            t = np.where(np.isfinite(t), t, high[:, np.newaxis])
            parts.append(np.minimum(np.maximum(t, low[:, np.newaxis]), high[:, np.newaxis]))
    return np.sort(np.concatenate(parts, axis=1), axis=1)


def _families(count: int, addressing: str) -> list[tuple[float, float]]:
    """Offsets and periods of the faces across an axis, in texels."""
    if count == 1:
        return []
    return [(0.5, 1.0)] + [(0.0, float(count))] * (addressing == "clamp")


def nearest_face(placed: Placed, lines: Lines, t: Array, *, time: float = 0.0,
                 addressing: str = "wrap") -> Array:
    """The face of a texture's cells that is crossed nearest to a point of each line.

    Parameters
    ----------
    placed : Placed
        A medium with a texture.
    lines : Lines
    t : ndarray, shape (n,)
        The points.
    time, addressing
        As for `froxel_ref.density.density_at`.

    Returns
    -------
    ndarray, shape (n,)
        Parameters of the crossings; infinite where a line meets no face.
    """
    best = np.full(t.shape, np.inf)
    for start, step, count in _coordinates(placed, lines, time):
        for offset, period in _families(count, addressing):
            with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
                plane = np.round((start + step * t - offset) / period) * period + offset
                face = (plane - start) / step
            best = np.where(np.abs(face - t) < np.abs(best - t), face, best)
    return best


def make_cells(placed: Placed, lines: Lines, path: MediumPath, *, time: float, addressing: str,
               keep: bool) -> Cells:
    """Cut lines at a texture's cells and add up the column over them; see `medium_path`."""
    fog = bool(path.slope.any() or path.exponent.any())
    order = 5 if fog else 2
    live = np.flatnonzero(path.leave > path.enter)
    part = type(lines)._make(field[..., live] for field in lines)
    knots = crossings(placed, part, path.enter[live], path.leave[live], time=time, addressing=addressing)
    if fog:
        knots = np.sort(np.concatenate([knots, _fog_knots(path, live)], axis=1), axis=1)
    cells = Cells(placed, lines, time, addressing, knots, np.zeros((len(path.enter), 1)), order)
    low, high = knots[:, :-1], knots[:, 1:]
    filled = high > low
    pieces = np.zeros(low.shape)
    row = np.broadcast_to(live[:, np.newaxis], low.shape)[filled]
    pieces[filled] = _pieces(cells, row, low[filled], high[filled])
    if not keep:
        cells.sums[live, 0] = pieces.sum(axis=1)
        return cells
    every = np.repeat(path.enter[:, np.newaxis], knots.shape[1], axis=1)
    sums = np.zeros(every.shape)
    every[live], sums[live, 1:] = knots, np.cumsum(pieces, axis=1)
    return cells._replace(knots=every, sums=sums)


def _fog_knots(path: MediumPath, live: NDArray[np.integer[Any]]) -> Array:
    """Where height fog begins to fall, and steps of 1 in its exponent, beyond which a Gauss rule is weak."""
    begin, end, exponent, slope, enter, leave = (
        field[live, np.newaxis] for field in (path.fall_from, path.fall_to, path.exponent, path.slope,
                                              path.enter, path.leave))
    # Falling along the line the exponent is least at the end of the stretch, rising at its start.
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        least = np.where(slope < 0.0, exponent + slope * (end - begin), exponent)
        at = begin + (np.maximum(least, 0.0) + np.arange(1.0, 41.0) - exponent) / slope
    at = np.where(np.isfinite(at), at, leave)
    result: Array = np.minimum(np.maximum(np.concatenate([begin, end, at], axis=1), enter), leave)
    return result


def _pieces(cells: Cells, row: NDArray[np.integer[Any]], low: Array, high: Array) -> Array:
    """The column over pieces that no face cuts."""
    node, weight = np.polynomial.legendre.leggauss(cells.order)
    half = 0.5 * (high - low)
    t = (low + half)[:, np.newaxis] + half[:, np.newaxis] * node
    x, y, z = (start[row][:, np.newaxis] + step[row][:, np.newaxis] * t
               for start, step in zip(cells.lines.origin, cells.lines.direction, strict=True))
    value, _ = density_at(cells.placed, (x, y, z), time=cells.time, addressing=cells.addressing)
    result: Array = half * (np.broadcast_to(value, t.shape) @ weight)
    return result


def cell_column(cells: Cells, t: Array, rows: Rows) -> Array:
    """The column up to points on lines; see `froxel_ref.optical_depth.column`."""
    if cells.sums.shape[1] == 1:
        return np.broadcast_to(cells.sums[rows].reshape(-1, *(1,) * (t.ndim - 1)), t.shape)
    number = np.arange(len(cells.knots))[rows]
    flat = t.reshape(len(number), -1)
    first, last = cells.knots[number, :1], cells.knots[number, -1:]
    inside = np.minimum(np.maximum(flat, first), last)
    place = _search(cells.knots, number, inside)
    result = cells.sums[number[:, np.newaxis], place]
    low = cells.knots[number[:, np.newaxis], place]
    needed = inside > low
    row: NDArray[Any] = np.broadcast_to(number[:, np.newaxis], flat.shape)[needed]
    result[needed] += _pieces(cells, row, low[needed], inside[needed])
    reached: Array = result.reshape(t.shape)
    return reached


def _search(knots: Array, number: NDArray[np.integer[Any]], t: Array) -> NDArray[np.integer[Any]]:
    """The last knot at or before t, line by line: every line's knots moved to a range of its own."""
    base = float(knots.min())
    span = 2.0 * (float(knots.max()) - base) + 1.0
    shifted = (knots - base + span * np.arange(len(knots))[:, np.newaxis]).reshape(-1)
    found = np.searchsorted(shifted, t - base + span * number[:, np.newaxis], side="right") - 1
    place = found - knots.shape[1] * number[:, np.newaxis]
    result: NDArray[np.integer[Any]] = np.clip(place, 0, knots.shape[1] - 1)
    return result
