"""Rasterise triangles without a crack: the depth of the first one at every texel of a shadow map.

Points come projected into the coordinates of the raster, in homogeneous form and never divided, so triangles
may reach behind the light. At a texel every corner is moved by the same rounded subtraction, whichever
triangle it belongs to, so neighbours see the same point; the rest is the sign of products in the plane.
"""

from __future__ import annotations

from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from froxel_ref.geometry import Matrix
from froxel_ref.light_raster import Bounds, Projected, windows
from froxel_ref.primitives import Facets

__all__ = ["raster_triangles"]

Edges: TypeAlias = tuple[Matrix, Matrix, Matrix]

# Texels of a triangle's rectangle from which on it is cheaper to draw it by itself, as views of the image.
LARGE = 2048
# Pairs of triangle and texel, or texels of a large triangle, that are tested at once.
BLOCK = 32768


def _reached(value: Matrix, weight: Matrix, count: int) -> tuple[Bounds, Bounds]:
    """Texels at which triangles in front of the light do not have all corners on one side, exactly.

    That is value − centre·weight, as it is rounded, being neither above 0 at all corners nor below 0.
    """
    with np.errstate(over="ignore"):
        first = np.ceil(np.clip(value / weight - 0.5, -1.0, count))
    # The quotient is rounded: a corner's first texel is the one whose product says so.
    first -= (first - 0.5) * weight >= value
    first += (first + 0.5) * weight < value
    last = first - ((first + 0.5) * weight > value)
    start = np.clip(first.min(axis=0), 0.0, count).astype(np.int64)
    stop = np.clip(last.max(axis=0) + 1.0, 0.0, count).astype(np.int64)
    return start, np.maximum(start, stop)


# --- drawing ----------------------------------------------------------------------------------------


def raster_triangles(depth: Matrix, vertices: Projected, faces: Facets, *, forward: bool,
                     restrict: bool = True) -> None:
    """Enter the triangles that rays through texel centres hit first into a depth image.

    Parameters
    ----------
    depth : ndarray, shape (rows, columns), float64, C-contiguous
        Least t so far; changed in place.
    vertices : Projected, shape (n,)
        Every vertex once.
    faces : ndarray of int, shape (m, 3)
        Vertices of each triangle; either side is hit.
    forward : bool
        Only t > 0 counts.
    restrict : bool
        Test each triangle only within its rectangle. The result is the same without.

    Notes
    -----
    With a texel's centre (x, y) and rᵢ = (xᵢ − x·wᵢ, yᵢ − y·wᵢ) for the corners i, the ray hits where the
    products eᵢ = rⱼ × rₖ have one sign or are 0, and not all 0, at t = Σ eᵢ·tᵢ/Σ eᵢ, kept between the depths
    of the corners (after the watertight test of Woop, Benthin and Wald, 2013, in the raster's coordinates).
    The rᵢ are rounded, but for all triangles at a vertex alike, and the sign of a difference of two products
    is right or 0 since rounding keeps order: so no ray passes between triangles, along an edge or through a
    vertex. The range of the rᵢ must hold 0 on both axes, so that a triangle seen edge on is not met on the
    line beyond it. Triangles that vanish are not hit. Errors: some ulp of the corners' coordinates in texels
    across the triangle's own depths.

    Examples
    --------
    >>> w, image = np.ones(3), np.full((2, 2), np.inf)
    >>> corners = Projected(3 * w, w, np.array([0.0, 2.0, 0.0]), np.array([0.0, 0.0, 2.0]), w, (0.0, 0.0, 0.0))
    >>> raster_triangles(image, corners, np.array([[0, 1, 2]]), forward=True)
    >>> image.tolist()
    [[3.0, 3.0], [3.0, inf]]
    """
    rows, columns = depth.shape
    corners = vertices.take(np.ascontiguousarray(faces.T))
    if not restrict:
        for k in range(len(faces)):
            _draw(depth, corners, k, (0, rows, 0, columns), forward)
        return
    front = (corners.weight > corners.rounding[0] * corners.reach).all(axis=0)
    bounds = np.empty((4, len(faces)), np.int64)
    whole = corners.take((slice(None), front))
    bounds[:, front] = np.stack([*_reached(whole.y, whole.weight, rows), *_reached(whole.x, whole.weight, columns)])
    bounds[:, ~front] = windows(corners.take((slice(None), ~front)), rows, columns)
    area = (bounds[1] - bounds[0]) * (bounds[3] - bounds[2])
    alone = (area > LARGE) | (~front & (area > 0))
    for k in np.flatnonzero(alone).tolist():
        _draw(depth, corners, k, bounds[:, k].tolist(), forward)
    _draw_small(depth, corners, bounds, np.flatnonzero((area > 0) & ~alone), area, forward)


def _draw(depth: Matrix, corners: Projected, number: int, bounds: Any, forward: bool) -> None:
    """One triangle, in blocks of the rows of its rectangle."""
    top, bottom, left, right = bounds
    x, y, weight = (part[:, number, np.newaxis] for part in (corners.x, corners.y, corners.weight))
    rx = x - (np.arange(left, right) + 0.5) * weight
    ry = y - (np.arange(top, bottom) + 0.5) * weight
    inside_x, inside_y = (((r.min(axis=0) <= 0.0) & (r.max(axis=0) >= 0.0)) for r in (rx, ry))
    step = max(1, BLOCK // max(1, right - left))
    for start in range(0, bottom - top, step):
        rows = slice(start, start + step)
        edges = _edges(rx, ry[:, rows, np.newaxis])
        hit = _inside(edges)
        hit &= inside_x
        hit &= inside_y[rows, np.newaxis]
        part = depth[top + start:min(top + start + step, bottom), left:right]
        t = _depth((edges[0][hit], edges[1][hit], edges[2][hit]), corners.depth[:, number], forward)
        part[hit] = np.minimum(part[hit], t)


def _draw_small(depth: Matrix, corners: Projected, bounds: Bounds, which: Facets, area: Bounds,
                forward: bool) -> None:
    """Triangles of few texels, many at once: every pair of a triangle and a texel of its rectangle."""
    flat, columns = depth.reshape(-1), depth.shape[1]
    total = np.cumsum(area[which])
    cuts = np.searchsorted(total, np.arange(BLOCK, total[-1], BLOCK)) if which.size else which
    for part in np.split(which, cuts) if which.size else ():
        span, row = _spread(part, bounds[0], bounds[1])
        pair, column = _spread(span, bounds[2], bounds[3], index=True)
        x, y, weight = corners.x[:, span], corners.y[:, span], corners.weight[:, span]
        ry = y - (row + 0.5) * weight
        rx = x[:, pair] - (column + 0.5) * weight[:, pair]
        edges = _edges(rx, ry[:, pair])
        hit = np.flatnonzero(_inside(edges))
        pair = pair[hit]
        t = _depth((edges[0][hit], edges[1][hit], edges[2][hit]), corners.depth[:, span[pair]], forward)
        np.minimum.at(flat, row[pair] * columns + column[hit], t)


def _spread(items: Facets, start: Bounds, stop: Bounds, *, index: bool = False) -> tuple[Facets, Facets]:
    """Each item as often as its range is long, or its index, and the numbers of the range."""
    count = stop[items] - start[items]
    number = np.arange(int(count.sum())) - np.repeat(np.cumsum(count) - count - start[items], count)
    return np.repeat(np.arange(len(items)) if index else items, count), number


def _edges(x: Matrix, y: Matrix) -> Edges:
    """Products of the corners seen from the texel; the same edge the other way is the exact negation."""
    return x[1] * y[2] - y[1] * x[2], x[2] * y[0] - y[2] * x[0], x[0] * y[1] - y[0] * x[1]


def _inside(edges: Edges) -> NDArray[np.bool_]:
    """Of one sign or 0, and not all 0."""
    low = np.minimum(np.minimum(edges[0], edges[1]), edges[2])
    high = np.maximum(np.maximum(edges[0], edges[1]), edges[2])
    result: NDArray[np.bool_] = ((low >= 0.0) & (high > 0.0)) | ((high <= 0.0) & (low < 0.0))
    return result


def _depth(edges: Edges, corner: Matrix, forward: bool) -> Matrix:
    """Depths of hits between those of the corners."""
    t = edges[0] * corner[0] + edges[1] * corner[1] + edges[2] * corner[2]
    t /= edges[0] + edges[1] + edges[2]
    t = np.minimum(np.maximum(t, corner.min(axis=0)), corner.max(axis=0))
    return np.where(t > 0.0, t, np.inf) if forward else t
