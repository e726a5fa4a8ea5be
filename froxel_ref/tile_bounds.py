"""Which tiles of the screen, and which depths, a bounded light or medium can touch: proxies and their bounds.

A proxy is an ellipsoid, or the convex hull of some points, or what lies in both. It holds everything for which
the arithmetic of the stages, in its own type, gives anything but 0. Bounds are found row of tiles by row of
tiles: between the two planes through the camera that cut a row out, an ellipsoid is again a smaller one.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from froxel_ref.geometry import CUBE
from froxel_ref.lights import cone_corners
from froxel_ref.scene import LocalMedium, PointLight, SpotLight

__all__ = ["Proxies", "depth_ranges", "light_proxies", "medium_proxies", "row_ranges"]

Doubles = NDArray[np.float64]

# Rounding of positions that proxies allow for, in ulp of the farthest one. Positions, distances, and local
# coordinates are some ten roundings from their inputs.
ROUNDINGS = 64.0
# Share by which an ellipsoid is enlarged so that what rounding adds to each of its axes fits into one.
SWELLING = 1e-3
# In tiles: far above the rounding of these bounds, far below what a tile holds.
MARGIN = 1e-6


class Proxies(NamedTuple):
    """Bounds in the world of n lights or media.

    Attributes
    ----------
    centers : ndarray, shape (n, 3) [m]
        Middles of the ellipsoids.
    axes : ndarray, shape (n, 3, 3) [m]
        Their half axes as columns: what takes the unit sphere there.
    hulls : dict of int to ndarray, shape (points, 3) [m]
        Points in whose convex hull a proxy lies as well.
    """

    centers: Doubles
    axes: Doubles
    hulls: dict[int, Doubles]


def light_proxies(lights: Sequence[PointLight], origin: Sequence[float], dtype: np.dtype[Any]) -> Proxies:
    """Bound what windowed point and spot lights reach.

    Parameters
    ----------
    lights : sequence of PointLight or SpotLight
        With a window; where one has none, nothing bounds it.
    origin : sequence of 3 floats [m]
        The camera's position, from which distances are measured.
    dtype : dtype
        Of the arithmetic.

    Returns
    -------
    Proxies
        Spheres; of spot lights what lies in the pyramid of `froxel_ref.lights.cone_corners` as well.

    Examples
    --------
    >>> lamp = PointLight(position=(1, 2, 3), intensity=(1, 1, 1), radius=4)
    >>> proxies = light_proxies([lamp], (0, 0, 0), np.dtype(float))
    >>> proxies.axes[0].round(9).diagonal().tolist(), proxies.hulls
    ([4.0, 4.0, 4.0], {})
    """
    centers = np.array([light.position for light in lights], np.float64).reshape(-1, 3)
    radii = np.array([light.radius for light in lights], np.float64)
    slack = _slack(centers, radii, origin, dtype)
    axes = (radii + slack)[:, np.newaxis, np.newaxis] * np.eye(3)
    hulls = {}
    for k, light in enumerate(lights):
        corners = cone_corners(light, dtype) if isinstance(light, SpotLight) else ()
        if len(corners):
            grown = _grown(np.asarray(corners), float(slack[k]))
            if grown is not None:
                hulls[k] = grown
    return Proxies(centers, axes, hulls)


def medium_proxies(media: Sequence[LocalMedium], origin: Sequence[float], dtype: np.dtype[Any]) -> Proxies:
    """Bound local media.

    Parameters
    ----------
    media : sequence of LocalMedium
    origin, dtype
        As for `light_proxies`.

    Returns
    -------
    Proxies
        Of an ellipsoid itself; of a box the ellipsoid through its corners, and the corners.

    Notes
    -----
    In a local coordinate the rounding of a position counts with the length of its row of local_from_world.

    Examples
    --------
    >>> box = medium_proxies([LocalMedium()], (0, 0, 0), np.dtype(float))
    >>> box.hulls[0].round(9).min(), box.axes[0, 0, 0].round(2)
    (np.float64(-1.0), np.float64(1.73))
    """
    poses = np.array([medium.transform.world_from_local for medium in media]).reshape(-1, 4, 4)
    centers, linear = poses[:, :3, 3], poses[:, :3, :3]
    slack = _slack(centers, np.linalg.norm(linear, axis=(1, 2)), origin, dtype)
    blur = slack[:, np.newaxis] * np.linalg.norm(np.linalg.inv(linear), axis=2)
    # |p| ≤ 1 plus a box of ± blur lies where Σ (p/size)² ≤ 1.
    size = np.sqrt((1.0 + SWELLING) + 3.0 * (1.0 + 1.0 / SWELLING) * blur * blur)
    boxes = {k: medium for k, medium in enumerate(media) if medium.shape == "box"}
    size[list(boxes)] *= np.sqrt(3.0)
    hulls = {k: (CUBE * (1.0 + blur[k])) @ linear[k].T + centers[k] for k in boxes}
    return Proxies(centers, linear * size[:, np.newaxis, :], hulls)


def _slack(centers: Doubles, sizes: Doubles, origin: Sequence[float], dtype: np.dtype[Any]) -> Doubles:
    """Metres by which rounding may move a point of a proxy, with a wide margin."""
    extent = np.linalg.norm(centers, axis=1) + 2.0 * np.linalg.norm(np.asarray(origin, np.float64)) + sizes
    return np.asarray(ROUNDINGS * float(np.finfo(dtype).eps) * extent)


def _grown(corners: Doubles, slack: float) -> Doubles | None:
    """A pyramid (apex first, then its base) that holds all within ``slack`` of another one; None for a point."""
    apex, base = corners[0], corners[1:].mean(axis=0)
    height = float(np.linalg.norm(base - apex))
    wide = float(np.linalg.norm(corners[1] - base)) * np.cos(np.pi / (len(corners) - 1))
    total = wide + np.hypot(wide, height)
    if not wide * height > slack * total:
        return None  # all of it is rounding: the sphere says as much
    # Scaled about the middle of the largest ball that it holds, of this radius.
    ball = wide * height / total
    middle = base + (apex - base) * (ball / height)
    return np.asarray(middle + (corners - middle) * (1.0 + slack / ball))


# --- bounds -----------------------------------------------------------------------------------------


def depth_ranges(proxies: Proxies, tile_from_world: Doubles) -> Doubles:
    """Find the view depths between which each proxy lies.

    Parameters
    ----------
    proxies : Proxies
        n of them.
    tile_from_world : ndarray, shape (3, 4)
        Takes (x, y, z, 1) to (column·depth, row·depth, depth), in tiles.

    Returns
    -------
    ndarray, shape (2, n) [m]
        Nearest and farthest; both negative behind the camera.

    Examples
    --------
    >>> lamp = PointLight(position=(1, 2, -9), intensity=(1, 1, 1), radius=4)
    >>> depth = np.array([[1.0, 0, 0, 0], [0, 1, 0, 0], [0, 0, -1, 0]])
    >>> depth_ranges(light_proxies([lamp], (0, 0, 0), np.dtype(float)), depth).round(9).tolist()
    [[5.0], [13.0]]
    """
    linear, shift = tile_from_world[:, :3], tile_from_world[:, 3]
    middle = proxies.centers @ linear[2] + shift[2]
    half = np.linalg.norm(linear[2] @ proxies.axes, axis=1)
    low, high = middle - half, middle + half
    for k, hull in proxies.hulls.items():
        depth = hull @ linear[2] + shift[2]
        low[k], high[k] = max(low[k], float(depth.min())), min(high[k], float(depth.max()))
    return np.stack([low, high])


def row_ranges(proxies: Proxies, tile_from_world: Doubles, rows: int) -> Doubles:
    """Bound the proxies' images in each row of tiles.

    Parameters
    ----------
    proxies : Proxies
        n of them.
    tile_from_world : ndarray, shape (3, 4)
        Takes (x, y, z, 1) to (column·depth, row·depth, depth), in tiles.
    rows : int
        Of tiles.

    Returns
    -------
    ndarray, shape (2, n, rows)
        Least and largest column, as real numbers and possibly infinite; the least is the larger one where
        nothing of the proxy lies in the row, in front of the camera.

    Notes
    -----
    In the space where an ellipsoid is the unit sphere all planes through the camera stay planes. Where the
    sphere's middle lies outside a row, at distance d from its nearer plane, the part inside the row lies in the
    ball about the middle's foot on that plane with radius √(1 − d²). A ball's image between the planes through
    one line is bounded by the two that touch it: the direction to its middle turned by ±asin(radius/distance),
    by products alone. Bounds of hulls are those of their corners in the row and of their edges' crossings with
    its two planes. Never too small [Drobot 2017, by proxies; the arithmetic is this module's].

    Examples
    --------
    >>> lamp = PointLight(position=(0, 0, -5), intensity=(1, 1, 1), radius=3)
    >>> tiles = np.array([[1.0, 0, -4, 0], [0, 1, -4, 0], [0, 0, -1, 0]])  # 90° across 8 tiles: 4 ± x/depth
    >>> low, high = row_ranges(light_proxies([lamp], (0, 0, 0), np.dtype(float)), tiles, 8)
    >>> low[0, 3:5].round(3).tolist(), high[0, 3:5].round(3).tolist()  # the sine of the tangent is 3/5
    ([3.25, 3.25], [4.75, 4.75])
    """
    low, high = _ball_ranges(proxies, tile_from_world, rows)
    for k, hull in proxies.hulls.items():
        image = hull @ tile_from_world[:, :3].T + tile_from_world[:, 3]
        least, largest = _hull_ranges(image, rows)
        low[k], high[k] = np.maximum(low[k], least), np.minimum(high[k], largest)
    return np.stack([low - MARGIN, high + MARGIN])


def _ball_ranges(proxies: Proxies, tile_from_world: Doubles, rows: int) -> tuple[Doubles, Doubles]:
    """Least and largest column of the ellipsoids in each row."""
    matrix = tile_from_world[:, :3] @ proxies.axes  # rows X, Y, W: what a step in the ball's space adds
    X, Y, W = (matrix[:, np.newaxis, i] for i in range(3))
    x, y, w = (proxies.centers @ tile_from_world[:, :3].T + tile_from_world[:, 3]).T[..., np.newaxis]
    edge = np.arange(rows + 1.0)
    normal = Y - edge[:, np.newaxis] * W  # (n, rows + 1, 3): of the planes between rows, towards larger ones
    length = np.linalg.norm(normal, axis=2)
    distance = (y - edge * w) / length
    # How far the middle lies outside each row, and the unit vector back to it.
    above, below = -distance[:, :-1], distance[:, 1:]
    outside = np.maximum(np.maximum(above, below), 0.0)
    unit = normal / length[..., np.newaxis]
    back = np.where((above >= below)[..., np.newaxis], unit[:, :-1], -unit[:, 1:]) * outside[..., np.newaxis]
    # Coordinates across the line X = W = 0, where all planes between columns meet.
    size = np.linalg.norm(W, axis=2)
    forward = W / size[..., np.newaxis]
    tilt = (X * forward).sum(axis=2)
    side = X - tilt[..., np.newaxis] * forward
    wide = np.maximum(np.linalg.norm(side, axis=2), np.finfo(np.float64).tiny)
    side = side / wide[..., np.newaxis]
    ahead, across = w / size, (x - tilt * (w / size)) / wide
    low, high = _tangents(ahead + (back * forward).sum(axis=2), across + (back * side).sum(axis=2),
                          np.sqrt(np.maximum(1.0 - outside * outside, 0.0)))
    low, high = (tilt + wide * slope for slope in (low, high))
    seen = (outside < 1.0) & (low <= high)
    return np.where(seen, low / size, np.inf), np.where(seen, high / size, -np.inf)


def _tangents(ahead: Doubles, across: Doubles, radius: Doubles) -> tuple[Doubles, Doubles]:
    """Least and largest across/ahead of circles' points with ahead > 0; (inf, −inf) where there are none."""
    away = np.hypot(ahead, across)
    # The radius is a bound itself; the last digits keep it one after the roundings here.
    sine = np.minimum(radius * (1.0 + 1e-12) / np.maximum(away, np.finfo(np.float64).tiny), 1.0)
    cosine = np.sqrt((1.0 - sine) * (1.0 + sine))
    with np.errstate(divide="ignore", over="ignore", invalid="ignore"):
        down, up = ahead * cosine + across * sine, ahead * cosine - across * sine
        low = np.where(down > 0.0, (across * cosine - ahead * sine) / down, -np.inf)
        high = np.where(up > 0.0, (across * cosine + ahead * sine) / up, np.inf)
    around, front = sine >= 1.0, ahead + radius * (1.0 + 1e-12) > 0.0
    low, high = np.where(around, -np.inf, low), np.where(around, np.inf, high)
    return np.where(front, low, np.inf), np.where(front, high, -np.inf)


def _hull_ranges(image: Doubles, rows: int) -> tuple[Doubles, Doubles]:
    """Least and largest column of a hull in each row, from its points (column·depth, row·depth, depth)."""
    low, high = np.full(rows, np.inf), np.full(rows, -np.inf)
    points = _in_front(image)
    if not len(points):
        return low, high
    a, b = np.triu_indices(len(points), 1)
    edge = np.arange(rows + 1.0)[:, np.newaxis]
    beyond = points[:, 1] - edge * points[:, 2]
    start, end = beyond[:, a], beyond[:, b]
    with np.errstate(divide="ignore", invalid="ignore"):
        share = np.where((start > 0.0) != (end > 0.0), start / (start - end), np.nan)
        crossing = points[a][:, ::2] + share[..., np.newaxis] * (points[b] - points[a])[:, ::2]
        least, largest = _columns(crossing[..., 0], crossing[..., 1])
        np.minimum(low, np.minimum(least[:-1], least[1:]), out=low)
        np.maximum(high, np.maximum(largest[:-1], largest[1:]), out=high)
        # Corners, in their row, or in both at a boundary.
        inside = (beyond[:-1] >= -MARGIN * points[:, 2]) & (beyond[1:] <= MARGIN * points[:, 2])
        own = np.where(inside & (points[:, 2] > 0.0), points[:, 0] / points[:, 2], np.nan)
    least, largest = np.fmin.reduce(own, axis=1, initial=np.inf), np.fmax.reduce(own, axis=1, initial=-np.inf)
    return np.minimum(low, least), np.maximum(high, largest)


def _columns(x: Doubles, w: Doubles) -> tuple[Doubles, Doubles]:
    """Least and largest x/w along the last axis; at w = 0 an infinity of x's sign, or both. NaN is nothing."""
    flat = np.abs(w) <= 1e-12 * np.abs(x)
    left = np.where(flat, np.where(x <= 0.0, -np.inf, np.inf), x / w)
    right = np.where(flat, np.where(x >= 0.0, np.inf, -np.inf), x / w)
    none = np.isnan(x)
    return (np.where(none, np.inf, left).min(axis=-1, initial=np.inf),
            np.where(none, -np.inf, right).max(axis=-1, initial=-np.inf))


def _in_front(image: Doubles) -> Doubles:
    """The corners in front of the camera, and where the hull's edges cross its plane; that depth is exactly 0."""
    depth = image[:, 2]
    ahead, behind = image[depth > 0.0], image[depth <= 0.0]
    if not len(ahead) or not len(behind):
        return ahead
    share = ahead[:, np.newaxis, 2:] / (ahead[:, np.newaxis, 2:] - behind[:, 2:])
    crossing = (ahead[:, np.newaxis] + share * (behind - ahead[:, np.newaxis])).reshape(-1, 3)
    crossing[:, 2] = 0.0
    return np.concatenate([ahead, crossing])
