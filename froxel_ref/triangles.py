"""Exact hits of rays with surfaces of many triangles: height fields and meshes.

As in `froxel_ref.primitives`: rays of a raster from one origin, view depths, +inf for a miss, and the index
of the triangle that was hit. The few rays that come near a surface are followed in float64.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from froxel_ref.arrays import Field
from froxel_ref.geometry import Matrix, Rays
from froxel_ref.primitives import Facets, local_rays, slab, unit_rows
from froxel_ref.records import InputError

__all__ = [
    "Caster", "height_field_normals", "hit_height_field", "hit_mesh", "mesh_caster", "mesh_normals",
    "walk_height_field",
]

Caster = Callable[[NDArray[Any], NDArray[Any]], NDArray[np.int32]]
"""Origins and directions, (n, 3) each, to the index of the first triangle that is hit, −1 for none."""


# --- height field -----------------------------------------------------------------------------------


def hit_height_field(rays: Rays, world_from_local: Matrix, heights: Field) -> tuple[Field, Facets]:
    """Hit the surface z = h(x, y) over [−1, 1]² in local space, from either side.

    Parameters
    ----------
    rays : Rays
        Shape (h, w).
    world_from_local : ndarray, shape (4, 4)
        Any affine map that is not singular.
    heights : ndarray, shape (rows, columns), at least (2, 2)
        Local z at y = −1 + 2·row/(rows − 1), x = −1 + 2·column/(columns − 1); a cell's two triangles meet
        along its diagonal from the lowest to the highest (x, y).

    Returns
    -------
    t : Field, shape (h, w) [m]
        View depth of the hit.
    triangle : ndarray of int32, shape (h, w)
        Index into `height_field_normals`: 2·cell, + 1 for the triangle towards +y.

    Notes
    -----
    On a ray z − h(x, y) is continuous and linear between crossings of grid lines and diagonals, so the
    walk visits the crossings in order, forms it once at each, and hits where it changes its sign: no ray
    slips between triangles. Rays that reach the field's bounds are walked in float64. A ray that runs
    within a triangle's plane does not hit it.

    Examples
    --------
    >>> from froxel_ref.geometry import camera_rays
    >>> from froxel_ref.scene import Camera
    >>> rays = camera_rays(Camera(position=(0.25, 0, 4), target=(0.25, 0, 0)), 1, 1)
    >>> t, triangle = hit_height_field(rays, np.eye(4), np.array([[0.0, 1.0], [0.0, 1.0]]))
    >>> t.tolist(), triangle.tolist()
    ([[3.375]], [[0]])
    """
    origin, direction = local_rays(rays, world_from_local)
    enter, leave = _field_range(origin, direction, heights)
    shape = rays.length.shape
    enter, leave = np.broadcast_to(enter, shape), np.broadcast_to(leave, shape)
    live = np.flatnonzero(enter < leave)
    t = np.full(shape, np.inf, rays.length.dtype)
    triangle = np.zeros(shape, np.int32)
    if live.size:
        line = np.stack([np.broadcast_to(d, shape).reshape(-1)[live] for d in direction]).astype(np.float64)
        span = np.stack([enter.reshape(-1)[live], leave.reshape(-1)[live]]).astype(np.float64)
        which, depth, index = _walk(_field_coordinates(origin, line, heights), span, heights)
        positive = depth > 0.0
        t.reshape(-1)[live[which[positive]]] = depth[positive]
        triangle.reshape(-1)[live[which[positive]]] = index[positive]
    return t, triangle


def _field_range(origin: tuple[float, ...], direction: tuple[Field, ...],
                 heights: Field) -> tuple[Field, Field]:
    """Depths between which rays are inside the field's bounds and in front of the camera."""
    low, high = float(heights.min()), float(heights.max())
    # Wider than the heights by more than z can be off by rounding: the signs at both ends are certain.
    pad = 0.01 * (high - low) + 1e-4 * (max(abs(low), abs(high)) + abs(origin[2]))
    middle, half = 0.5 * (low + high), 0.5 * (high - low) + pad or 1.0
    near_x, far_x = slab(origin[0], direction[0])
    near_y, far_y = slab(origin[1], direction[1])
    near_z, far_z = slab((origin[2] - middle) / half, direction[2] / half)
    enter = np.maximum(np.maximum(np.maximum(near_x, near_y), near_z), 0.0)
    return enter, np.minimum(np.minimum(far_x, far_y), far_z)


class _Lines(NamedTuple):
    """Rays in cell coordinates: (u, v, u − v) and z, at depth 0 and per metre of depth."""

    start: Matrix  # (4, 1), or (4, n) for lines of many origins
    step: Matrix  # (4, n)


def walk_height_field(origin: Matrix, direction: Matrix, span: Matrix,
                      heights: Field) -> tuple[Facets, Matrix, Facets]:
    """Follow lines of any origins over a height field to the first hit.

    Parameters
    ----------
    origin, direction : ndarray, shape (3, n)
        In the field's local space.
    span : ndarray, shape (2, n)
        Parameters between which to look; within the field's square.
    heights : ndarray, shape (rows, columns)
        As for `hit_height_field`.

    Returns
    -------
    which, depth, triangle : ndarray, shape (hits,)
        Lines that hit, in no order, the parameters of their hits, and the triangles.

    Examples
    --------
    >>> o, d = np.array([[0.25], [0.0], [4.0]]), np.array([[0.0], [0.0], [-1.0]])
    >>> walk_height_field(o, d, np.array([[0.0], [9.0]]), np.array([[0.0, 1.0], [0.0, 1.0]]))[1].tolist()
    [3.375]
    """
    return _walk(_field_coordinates(origin, direction, heights), span, heights)


def _field_coordinates(origin: Sequence[Any] | Matrix, direction: Matrix, heights: Field) -> _Lines:
    rows, columns = heights.shape
    su, sv = 0.5 * (columns - 1), 0.5 * (rows - 1)
    u, v = (origin[0] + 1.0) * su, (origin[1] + 1.0) * sv
    du, dv = direction[0] * su, direction[1] * sv
    start = np.asarray([u, v, u - v, origin[2]], np.float64).reshape(4, -1)
    return _Lines(start, np.stack([du, dv, du - dv, direction[2]]))


def _walk(lines: _Lines, span: Matrix, heights: Field) -> tuple[Facets, Matrix, Facets]:
    """Rays that hit, their depths and triangles: visit crossings of the three families in order."""
    flat = np.ascontiguousarray(heights, np.float64)
    now, end = span
    start, step = lines.start, lines.step
    sign = np.sign(step[:3])
    # The next line of each family: the first integer strictly ahead of where the ray enters.
    ahead = sign * (np.floor(sign * (start[:3] + step[:3] * now)) + 1.0)
    value = _clearance(start, step, now, flat)
    ray = np.arange(now.size)
    found: list[tuple[Facets, Matrix, Facets]] = []
    while ray.size:
        with np.errstate(all="ignore"):
            crossing = np.where(sign == 0.0, np.inf, (ahead - start[:3]) / step[:3])
        then = np.maximum(np.minimum(crossing.min(axis=0), end), now)
        reached = _clearance(start, step, then, flat)
        hit = (reached > 0.0) != (value > 0.0)
        if hit.any():
            depth = now[hit] + (then - now)[hit] * (value[hit] / (value[hit] - reached[hit]))
            middle = 0.5 * (now[hit] + then[hit])
            found.append((ray[hit], depth, _triangle_at(_of(start, hit), step[:, hit], middle, flat.shape)))
        ahead += sign * (crossing <= then)
        keep = ~hit & (then < end)
        now, value = then, reached
        if not keep.all():
            ray, now, end, value = ray[keep], now[keep], end[keep], value[keep]
            start, step, sign, ahead = _of(start, keep), step[:, keep], sign[:, keep], ahead[:, keep]
    if not found:
        return np.zeros(0, np.intp), np.zeros(0), np.zeros(0, np.intp)
    which, depths, triangles = (np.concatenate(part) for part in zip(*found, strict=True))
    return which, depths, triangles


def _of(start: Matrix, which: NDArray[np.bool_]) -> Matrix:
    """The origins of some of the lines."""
    return start[:, which] if start.shape[1] > 1 else start


def _cell(start: Matrix, step: Matrix, t: Matrix, shape: tuple[int, ...]) -> tuple[Any, ...]:
    """The cell under a point of each ray, and where in the cell it is."""
    u = np.minimum(np.maximum(start[0] + step[0] * t, 0.0), shape[1] - 1.0)
    v = np.minimum(np.maximum(start[1] + step[1] * t, 0.0), shape[0] - 1.0)
    column = np.minimum(u.astype(np.intp), shape[1] - 2)
    row = np.minimum(v.astype(np.intp), shape[0] - 2)
    return row, column, u - column, v - row


def _clearance(start: Matrix, step: Matrix, t: Matrix, heights: Matrix) -> Matrix:
    """z − h(x, y) at a point of each ray."""
    row, column, fu, fv = _cell(start, step, t, heights.shape)
    corner = row * heights.shape[1] + column
    diagonal = corner + (heights.shape[1] + 1)
    values = heights.reshape(-1)
    low, high = values.take(corner), values.take(diagonal)
    # The third corner lies towards +x where fu > fv, else towards +y: h = low + (third − low)·max
    # + (high − third)·min in both triangles.
    third = values.take(np.where(fu > fv, corner + 1, diagonal - 1))
    most, least = np.maximum(fu, fv), np.minimum(fu, fv)
    result: Matrix = start[3] + step[3] * t - (low + (third - low) * most + (high - third) * least)
    return result


def _triangle_at(start: Matrix, step: Matrix, t: Matrix, shape: tuple[int, ...]) -> Facets:
    row, column, fu, fv = _cell(start, step, t, shape)
    result: Facets = 2 * (row * (shape[1] - 1) + column) + (fu <= fv)
    return result


def height_field_normals(world_from_local: Matrix, heights: Field) -> Matrix:
    """List the normals of a height field's triangles.

    Parameters
    ----------
    world_from_local : ndarray, shape (4, 4)
        As for `hit_height_field`.
    heights : ndarray, shape (rows, columns)
        As for `hit_height_field`.

    Returns
    -------
    ndarray, shape (2·(rows − 1)·(columns − 1), 3)
        Unit normals that point towards local +z.

    Notes
    -----
    (−∂h/∂x, −∂h/∂y, 1), mapped by the inverse transposed.

    Examples
    --------
    >>> height_field_normals(np.eye(4), np.zeros((2, 2))).tolist()
    [[0.0, 0.0, 1.0], [0.0, 0.0, 1.0]]
    """
    h = np.asarray(heights, np.float64)
    low, right, up, high = h[:-1, :-1], h[:-1, 1:], h[1:, :-1], h[1:, 1:]
    su, sv = 0.5 * (h.shape[1] - 1), 0.5 * (h.shape[0] - 1)
    slope_x = np.stack([right - low, high - up], axis=-1) * su
    slope_y = np.stack([high - right, up - low], axis=-1) * sv
    local = np.stack([-slope_x, -slope_y, np.ones_like(slope_x)], axis=-1).reshape(-1, 3)
    return unit_rows(local @ np.linalg.inv(world_from_local[:3, :3])) + 0.0


# --- triangle mesh ----------------------------------------------------------------------------------


def mesh_caster(vertices: Matrix, faces: Facets) -> Caster:
    """Build the search tree that tells which triangle of a mesh a ray hits first.

    Parameters
    ----------
    vertices : ndarray, shape (n, 3) [m]
        Positions in the space of the rays.
    faces : ndarray of int, shape (m, 3)
        Vertices of each triangle.

    Returns
    -------
    callable
        Takes origins and directions, shape (k, 3) each; returns the triangle's index, −1 for none.

    Raises
    ------
    InputError
        Embree is not installed.

    Notes
    -----
    Embree works in float32, here about the mesh's centre at unit size, so the choice of triangle can differ
    within about 1e-6 of the mesh's size and distance: at silhouettes by a ray. It can miss where triangles
    meet in a vertex; rays that hit nothing are therefore cast twice more, turned by 1e-6.

    Examples
    --------
    >>> corners = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    >>> cast = mesh_caster(corners, np.array([[0, 1, 2]]))
    >>> cast(np.array([[0.2, 0.2, 1.0]]), np.array([[0.0, 0.0, -1.0]])).tolist()
    [0]
    """
    try:
        from embreex.mesh_construction import TriangleMesh
        from embreex.rtcore_scene import EmbreeScene
    except ImportError:
        problem = "is a mesh, which needs Embree: python -m pip install 'froxel-ref[mesh]'"
        raise InputError("surfaces", problem) from None
    used = vertices[np.unique(faces)]
    low, high = used.min(axis=0), used.max(axis=0)
    # A mesh that its transform makes as small as a point is left at its size: no ray hits it.
    center, size = 0.5 * low + 0.5 * high, float((high - low).max())
    scale = 2.0 / size if size > 1e-300 else 1.0
    scene = EmbreeScene()
    TriangleMesh(scene, ((vertices - center) * scale).astype(np.float32), np.asarray(faces, np.int32))

    def cast(origins: NDArray[Any], directions: NDArray[Any]) -> NDArray[np.int32]:
        start = ((origins - center) * scale).astype(np.float32)
        towards = directions / np.sqrt((directions * directions).sum(axis=1, keepdims=True))
        result: NDArray[np.int32] = scene.run(start, towards.astype(np.float32))
        for turn in ((1e-6, 2e-6, -1.5e-6), (-2e-6, 1e-6, 3e-6)):
            missed = np.flatnonzero(result < 0)
            if missed.size:
                result[missed] = scene.run(start[missed], (towards[missed] + turn).astype(np.float32))
        return result

    cast(center[np.newaxis], np.array([[0.0, 0.0, 1.0]]))  # builds the tree, which threads must not share in
    return cast


def hit_mesh(rays: Rays, triangles: Matrix, caster: Caster) -> tuple[Field, Facets]:
    """Hit a triangle mesh, from either side.

    Parameters
    ----------
    rays : Rays
        Shape (h, w).
    triangles : ndarray, shape (m, 3, 3) [m]
        World positions of each triangle's corners.
    caster : callable
        From `mesh_caster` of the same mesh: decides which triangle is hit.

    Returns
    -------
    t : Field, shape (h, w) [m]
        View depth of the hit.
    triangle : ndarray of int32, shape (h, w)
        Index into ``triangles``.

    Notes
    -----
    Embree (float32) only chooses the triangle; t is then found in float64 from that triangle's plane, and
    kept between the depths of its corners along the ray, which matters where the triangle is seen edge on.

    Examples
    --------
    >>> from froxel_ref.geometry import camera_rays
    >>> from froxel_ref.scene import Camera
    >>> rays = camera_rays(Camera(position=(0.2, 0.2, 3), target=(0.2, 0.2, 0)), 1, 1)
    >>> vertices = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    >>> faces = np.array([[0, 1, 2]])
    >>> [result.tolist() for result in hit_mesh(rays, vertices[faces], mesh_caster(vertices, faces))]
    [[[3.0]], [[0]]]
    """
    shape = rays.length.shape
    direction = np.stack([np.broadcast_to(d, shape).reshape(-1) for d in rays.per_depth], axis=1)
    direction = direction.astype(np.float64, copy=False)
    chosen = caster(np.broadcast_to(np.asarray(rays.origin), direction.shape), direction)
    live = np.flatnonzero(chosen >= 0)
    d = direction[live]
    corners = triangles[chosen[live]] - np.asarray(rays.origin)
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    along = np.einsum("ncx,nx->nc", corners, d) / np.einsum("nx,nx->n", d, d)[:, np.newaxis]
    with np.errstate(divide="ignore", invalid="ignore"):
        depth = np.einsum("nx,nx->n", normal, corners[:, 0]) / np.einsum("nx,nx->n", normal, d)
    depth = np.where(np.isfinite(depth), depth, along[:, 0])
    depth = np.minimum(np.maximum(depth, along.min(axis=1)), along.max(axis=1))
    t = np.full(shape, np.inf, rays.length.dtype)
    t.reshape(-1)[live] = np.where(depth > 0.0, depth, np.inf)
    return t, chosen.reshape(shape)


def mesh_normals(triangles: Matrix) -> Matrix:
    """List the normals of triangles.

    Parameters
    ----------
    triangles : ndarray, shape (m, 3, 3)
        Corners of each triangle.

    Returns
    -------
    ndarray, shape (m, 3)
        Unit normals, right-handed about the corners' order; 0 for a triangle without area.

    Examples
    --------
    >>> mesh_normals(np.array([[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]])).tolist()
    [[0.0, 0.0, 1.0]]
    """
    edges = triangles[:, 1:] - triangles[:, :1]
    return unit_rows(np.cross(edges[:, 0], edges[:, 1]))
