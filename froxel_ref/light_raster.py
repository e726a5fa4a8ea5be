"""The rays of a light through the texels of a shadow map, and where points and hulls lie among them."""

from __future__ import annotations

import math
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from froxel_ref.geometry import Matrix

__all__ = ["Bounds", "LightRaster", "Projected", "inverse_rows", "project", "raster_rays", "windows"]

Bounds: TypeAlias = NDArray[np.int64]
"""First row, row after the last, first column and column after the last, shape (4, n)."""

EPS = float(np.finfo(np.float64).eps)


class LightRaster(NamedTuple):
    """The rays of a light through the texels of one face of a shadow map.

    The texel of row i and column j has its centre at x = j + ½, y = i + ½.

    Attributes
    ----------
    base, across, down : ndarray, shape (3,), float64
        They give p(x, y) = base + x·across + y·down.
    origin : ndarray, shape (3,), or None [m]
        Where all rays start: points origin + t·p(x, y), t > 0, so t is the depth across the plane that p
        spans. None for parallel rays.
    direction : ndarray, shape (3,), or None
        Of parallel rays, length 1: points p(x, y) + t·direction, t from −inf, where the light is. None for
        rays from a point.
    rows, columns : int
        Texels.
    """

    base: Matrix
    across: Matrix
    down: Matrix
    origin: Matrix | None
    direction: Matrix | None
    rows: int
    columns: int


def raster_rays(raster: LightRaster) -> tuple[Matrix, Matrix]:
    """List the rays through the centres of a raster's texels.

    Parameters
    ----------
    raster : LightRaster
        Any.

    Returns
    -------
    origins, directions : ndarray, broadcastable to (3, rows, columns)
        Points of a ray are origin + t·direction; what all rays share has length-1 axes.

    Examples
    --------
    >>> x, y, z = np.eye(3)
    >>> origins, directions = raster_rays(LightRaster(-x, x, y, 5 * z, None, 1, 2))
    >>> origins.ravel().tolist(), directions[:, 0, 1].tolist()
    ([0.0, 0.0, 5.0], [0.5, 0.5, 0.0])
    """
    x = np.arange(raster.columns) + 0.5
    y = (np.arange(raster.rows) + 0.5)[:, np.newaxis]
    base, across, down = (v[:, np.newaxis, np.newaxis] for v in (raster.base, raster.across, raster.down))
    place = base + x * across + y * down
    fixed = raster.direction if raster.origin is None else raster.origin
    assert fixed is not None
    shared = fixed[:, np.newaxis, np.newaxis]
    return (place, shared) if raster.origin is None else (shared, place)


# --- points -----------------------------------------------------------------------------------------


class Projected(NamedTuple):
    """Points in the coordinates of a raster.

    Attributes
    ----------
    depth : ndarray [t]
        The parameter of the ray through the point: planar depth, or distance along parallel rays.
    weight : ndarray
        What x and y are multiplied by: the depth, or 1 for parallel rays.
    x, y : ndarray [texels]
        ``weight`` times the column and the row, both with fractions.
    reach : ndarray
        The length of what was rounded: from the light to the point, and from the world's origin.
    rounding : tuple of 3 floats
        Times ``reach`` bounds the rounding errors of weight, x and y.
    """

    depth: Matrix
    weight: Matrix
    x: Matrix
    y: Matrix
    reach: Matrix
    rounding: tuple[float, float, float]

    def take(self, index: NDArray[Any] | tuple[slice, Any]) -> Projected:
        """Some of the points, in the shape of the index."""
        return self._replace(depth=self.depth[index], weight=self.weight[index], x=self.x[index],
                             y=self.y[index], reach=self.reach[index])


def inverse_rows(columns: Matrix) -> Matrix:
    """Invert the matrix of three columns by cross products.

    Parameters
    ----------
    columns : ndarray, shape (3, 3)
        Its columns, one a row.

    Returns
    -------
    ndarray, shape (3, 3)
        The inverse. For columns at right angles every row of it is as exact as they are, however different
        their lengths.

    Raises
    ------
    ValueError
        They lie in a plane.

    Examples
    --------
    >>> inverse_rows(np.array([[2.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 0.0, 4.0]])).tolist()
    [[0.5, -0.5, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 0.25]]
    """
    a, b, c = columns
    rows = np.stack([np.cross(b, c), np.cross(c, a), np.cross(a, b)])
    volume = float(rows[0] @ a)
    if volume == 0.0 or not math.isfinite(volume):
        raise ValueError("the three vectors of a raster or a box lie in a plane, they must span the space")
    result: Matrix = rows / volume + 0.0  # no negative zeros
    return result


def project(raster: LightRaster, points: Matrix) -> Projected:
    """Take points to the coordinates of a raster.

    Parameters
    ----------
    raster : LightRaster
        Its vectors must span the space.
    points : ndarray, shape (..., 3) [m]
        In the world.

    Returns
    -------
    Projected, shape (...)
        The point is origin + base·weight + across·x + down·y for rays from a point, and base + across·x +
        down·y + direction·depth for parallel ones. Equal points have equal bits, wherever they stand.

    Raises
    ------
    ValueError
        The raster's vectors lie in a plane.

    Examples
    --------
    >>> x, y, z = np.eye(3)
    >>> point = project(LightRaster(-z, 0.5 * x, y, 0 * z, None, 1, 2), np.array([2.0, 6.0, -3.0]))
    >>> [float(value) for value in (point.depth, point.weight, point.x, point.y)]
    [3.0, 3.0, 4.0, 6.0]
    """
    start, along = (raster.base, raster.direction) if raster.origin is None else (raster.origin, raster.base)
    assert along is not None
    inverse = inverse_rows(np.stack([along, raster.across, raster.down]))
    px, py, pz = (points[..., i] - start[i] for i in range(3))
    depth, x, y = (row[0] * px + row[1] * py + row[2] * pz for row in inverse.tolist())
    weight = depth if raster.direction is None else np.ones_like(depth)
    reach = np.sqrt(px * px + py * py + pz * pz) + math.sqrt(float(start @ start))
    size = 32.0 * EPS * np.sqrt((inverse * inverse).sum(axis=1))
    rounding = (float(size[0]) if raster.direction is None else 0.0, float(size[1]), float(size[2]))
    return Projected(depth, weight, x, y, reach, rounding)


# --- rectangles -------------------------------------------------------------------------------------


def windows(hulls: Projected, rows: int, columns: int, *, margin: float = 1.0) -> Bounds:
    """Bound the texels whose rays can meet the convex hulls of points.

    Parameters
    ----------
    hulls : Projected, shape (corners, n)
        Corners of n hulls; these may lie anywhere, also around or behind the light.
    rows, columns : int
        Texels of the raster.
    margin : float [texels]
        Added on each side, beside what the rounding of the corners amounts to.

    Returns
    -------
    ndarray of int, shape (4, n)
        First row, row after the last, first column, column after the last; never too small. Empty where
        no ray from the light can meet the hull.

    Notes
    -----
    As `froxel_ref.geometry.ray_bounds`, for many hulls at once: a hull's part in front of the light is
    spanned by the corners there and by the directions in which lines between corners cross the light's plane.
    A crossing leads away to infinity on the side that the sign of its x (or y) tells; a sign that rounding
    leaves open counts as both.

    Examples
    --------
    >>> one, corner = np.ones((2, 1)), np.array([[2.0], [4.0]])
    >>> windows(Projected(one, one, corner, corner, one, (0.0, 0.0, 0.0)), 8, 5).ravel().tolist()
    [1, 5, 1, 5]
    """
    front = hulls.weight > hulls.rounding[0] * hulls.reach
    y = _window(hulls, hulls.y, hulls.rounding[2], front, rows, margin)
    x = _window(hulls, hulls.x, hulls.rounding[1], front, columns, margin)
    return np.stack([*y, *x])


def _window(hulls: Projected, value: Matrix, rounding: float, front: NDArray[np.bool_], count: int,
            margin: float) -> tuple[Bounds, Bounds]:
    """The range of one axis."""
    weight, slack = np.where(front, hulls.weight, 1.0), rounding * hulls.reach
    with np.errstate(over="ignore"):
        low = np.where(front, (value - slack) / weight, np.inf).min(axis=0) - margin
        high = np.where(front, (value + slack) / weight, -np.inf).max(axis=0) + margin
    mixed = np.flatnonzero(~front.all(axis=0))
    if mixed.size:
        # The second term: a corner this near to the light's plane is beyond the raster on either side of it.
        slack = (slack + 2.0 * count * hulls.rounding[0] * hulls.reach)[:, mixed].max(axis=0)
        down, up = _crossings(hulls.take((slice(None), mixed)), value[:, mixed], front[:, mixed], slack)
        low[mixed[down]], high[mixed[up]] = -np.inf, np.inf
    start = np.ceil(np.clip(low - 0.5, 0.0, count)).astype(np.int64)
    stop = np.floor(np.clip(high - 0.5, -1.0, count - 1.0)).astype(np.int64) + 1
    return start, np.maximum(start, stop)


def _crossings(hulls: Projected, value: Matrix, front: NDArray[np.bool_],
               slack: Matrix) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Whether hulls leave the front of the light towards lower and towards higher values."""
    behind = np.minimum(hulls.weight, 0.0)
    pair = front[:, np.newaxis] & ~front
    ahead = np.where(pair, hulls.weight[:, np.newaxis], 1.0)
    cross = (ahead * value - behind * value[:, np.newaxis]) / (ahead - behind)
    on = ~front & (hulls.weight >= -hulls.rounding[0] * hulls.reach)
    down = (pair & (cross <= slack)).any(axis=(0, 1)) | (on & (value <= slack)).any(axis=0)
    up = (pair & (cross >= -slack)).any(axis=(0, 1)) | (on & (value >= -slack)).any(axis=0)
    return down, up
