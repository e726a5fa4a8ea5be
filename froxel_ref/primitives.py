"""Exact hits of rays with planes, spheres and boxes (`froxel_ref.triangles` has the rest).

Every function takes the rays of a raster (`froxel_ref.geometry.Rays`, all from one origin) and returns the
view depth t of the nearest hit in front of the camera, +inf where there is none, with only the axes on
which it varies. A primitive of several facets also returns which was hit, an index into the list of their
normals. What depends on the origin alone is computed in float64, the rest in the dtype of the rays.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from froxel_ref.arrays import Field
from froxel_ref.geometry import Matrix, Rays, cross, dot, transform_points

__all__ = ["Facets", "box_normals", "hit_box", "hit_plane", "hit_sphere"]

Facets = NDArray[np.integer[Any]]
"""Index of the facet that was hit; any number where nothing was."""


def hit_plane(rays: Rays, point: tuple[float, float, float], normal: tuple[float, float, float]) -> Field:
    """Hit an infinite plane from either side.

    Parameters
    ----------
    rays : Rays
        Shape (h, w).
    point : tuple of 3 floats [m]
        Any point of the plane.
    normal : tuple of 3 floats
        Its normal, of any length.

    Returns
    -------
    Field, broadcastable to (h, w) [m]
        t = n·(point − origin)/(n·per_depth); inf behind the camera and for rays in or along the plane.

    Notes
    -----
    The distance is formed in float64 and rounded once, so the relative error of t is that of n·per_depth.

    Examples
    --------
    >>> from froxel_ref.geometry import camera_rays
    >>> from froxel_ref.scene import Camera
    >>> rays = camera_rays(Camera(vertical_fov=90, position=(0, 1, 0), target=(0, 1, -1)), 2, 2)
    >>> hit_plane(rays, (0.0, 0.0, 0.0), (0.0, 1.0, 0.0)).round(12).tolist()
    [[inf], [2.0]]
    """
    n = np.asarray(normal, np.float64)
    distance = float(n @ np.subtract(point, rays.origin))
    slope = transform_points(_as_rows(n), rays.per_depth, directions=True)[0]
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        t = distance / slope
    return np.where(t > 0.0, t, np.inf).astype(t.dtype, copy=False)


def hit_sphere(rays: Rays, center: tuple[float, float, float], radius: float) -> Field:
    """Hit a sphere; from inside, its far wall.

    Parameters
    ----------
    rays : Rays
        Shape (h, w).
    center : tuple of 3 floats [m]
        Its centre.
    radius : float [m]
        Above 0.

    Returns
    -------
    Field, shape (h, w) [m]
        View depth of the hit.

    Notes
    -----
    With q = center − origin and D = per_depth the roots are (b ∓ √s)/a, a = D·D, b = q·D,
    s = r²a − |q×D|². The cross product keeps the digits that b² − a(q·q − r²) loses for far spheres. The
    near root is written c/(b + √s) with c = |q|² − r² from float64 scalars, so a camera close to the wall
    loses none either. At the silhouette √s carries the square root of the rounding error.

    Examples
    --------
    >>> from froxel_ref.geometry import camera_rays
    >>> from froxel_ref.scene import Camera
    >>> rays = camera_rays(Camera(position=(0, 0, 0), target=(0, 0, -1)), 1, 1)
    >>> hit_sphere(rays, (0.0, 0.0, -5.0), 2.0).tolist(), hit_sphere(rays, (0.0, 0.0, -1.0), 2.0).tolist()
    ([[3.0]], [[3.0]])
    """
    q = np.subtract(center, rays.origin)
    distance = float(np.sqrt(q @ q))
    c = (distance - radius) * (distance + radius)
    x, y, z = (np.full((1, 1), component, rays.length.dtype) for component in q)
    a = rays.length * rays.length
    b = dot((x, y, z), rays.per_depth)
    across = cross((x, y, z), rays.per_depth)
    s = radius * radius * a - dot(across, across)
    root = np.sqrt(np.maximum(s, 0.0))
    with np.errstate(divide="ignore", invalid="ignore"):
        if c > 0.0:
            t = np.where((s >= 0.0) & (b > 0.0), c / (b + root), np.inf)
        else:
            t = np.where(b > 0.0, (b + root) / a, -c / (root - b))
    return np.where(t > 0.0, t, np.inf).astype(s.dtype, copy=False)


# --- box --------------------------------------------------------------------------------------------


def hit_box(rays: Rays, world_from_local: Matrix) -> tuple[Field, Facets]:
    """Hit the cube [−1, 1]³ under an affine map; from inside, the wall where the ray leaves.

    Parameters
    ----------
    rays : Rays
        Shape (h, w).
    world_from_local : ndarray, shape (4, 4)
        Any affine map that is not singular.

    Returns
    -------
    t : Field, broadcastable to (h, w) [m]
        View depth of the hit.
    axis : ndarray of uint8, broadcastable to (h, w)
        Local axis across the face that was hit (see `box_normals`). On an edge the first axis wins.

    Notes
    -----
    Slab test in local space. A ray parallel to a pair of faces is inside that slab everywhere or nowhere;
    running within a face counts as inside. Faces have no thickness: t = 0 is no hit.

    Examples
    --------
    >>> from froxel_ref.geometry import camera_rays
    >>> from froxel_ref.scene import Camera
    >>> rays = camera_rays(Camera(position=(0, 0, 4), target=(0, 0, 0)), 1, 1)
    >>> [result.tolist() for result in hit_box(rays, np.eye(4))]
    [[[3.0]], [[2]]]
    """
    origin, direction = local_rays(rays, world_from_local)
    near, far = zip(*(slab(o, d) for o, d in zip(origin, direction, strict=True)), strict=True)
    enter = np.maximum(np.maximum(near[0], near[1]), near[2])
    leave = np.minimum(np.minimum(far[0], far[1]), far[2])
    if all(abs(o) <= 1.0 for o in origin):
        # The origin is common to all rays: from inside every ray hits where it leaves.
        hit = (enter <= leave) & (leave > 0.0)
        t, axis = leave, np.where(far[0] == leave, 0, np.where(far[1] == leave, 1, 2))
    else:
        hit = (enter <= leave) & (enter > 0.0)
        t, axis = enter, np.where(near[0] == enter, 0, np.where(near[1] == enter, 1, 2))
    return np.where(hit, t, np.inf).astype(t.dtype, copy=False), axis.astype(np.uint8)


def slab(origin: float, direction: Field) -> tuple[Field, Field]:
    """Where rays enter and leave −1 ≤ p ≤ 1 along one axis."""
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        a, b = (-1.0 - origin) / direction, (1.0 - origin) / direction
    near, far = np.minimum(a, b), np.maximum(a, b)
    parallel = direction == 0.0
    if parallel.any():
        inside = abs(origin) <= 1.0
        near = np.where(parallel, -np.inf if inside else np.inf, near).astype(a.dtype, copy=False)
        far = np.where(parallel, np.inf if inside else -np.inf, far).astype(a.dtype, copy=False)
    return near, far


def box_normals(world_from_local: Matrix) -> Matrix:
    """List the normals of a box's faces across each local axis.

    Parameters
    ----------
    world_from_local : ndarray, shape (4, 4)
        As for `hit_box`.

    Returns
    -------
    ndarray, shape (3, 3)
        Unit normals, one per row; the sign is left open.

    Notes
    -----
    Normals map by the inverse transposed: they are the rows of the inverse, scaled to 1.

    Examples
    --------
    >>> box_normals(np.diag([2.0, 3.0, 4.0, 1.0])).tolist()
    [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]
    """
    return unit_rows(np.linalg.inv(world_from_local[:3, :3]))


# --- shared -----------------------------------------------------------------------------------------


def local_rays(rays: Rays, world_from_local: Matrix) -> tuple[tuple[float, ...], tuple[Field, ...]]:
    """Origin (float64 scalars) and direction of rays in a primitive's local space; depth stays depth."""
    inverse = np.linalg.inv(world_from_local[:3, :3])
    origin = inverse @ np.subtract(rays.origin, world_from_local[:3, 3])
    return tuple(origin.tolist()), transform_points(_as_rows(inverse), rays.per_depth, directions=True)


def _as_rows(linear: NDArray[Any]) -> Matrix:
    """A matrix whose upper left rows are those given."""
    result = np.eye(4)
    rows = np.atleast_2d(linear)
    result[:len(rows), :3] = rows
    return result


def unit_rows(vectors: NDArray[Any]) -> Matrix:
    """Rows scaled to length 1; zero rows stay zero."""
    largest = np.abs(vectors).max(axis=1, keepdims=True)
    scaled = vectors / np.where(largest > 0.0, largest, 1.0)
    length = np.sqrt((scaled * scaled).sum(axis=1, keepdims=True))
    result: Matrix = scaled / np.where(length > 0.0, length, 1.0)
    return result
