"""The surface stage: the nearest opaque surface along each camera ray, and its Lambert shading.

It makes the depth buffer that the fog is looked up at. Surfaces are hit exactly (`froxel_ref.primitives`,
`froxel_ref.triangles`), and lit by `froxel_ref.shading`. Each is tested only within the rectangle of the image
that can see it; what is left out could not have changed a bit.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import DTypeLike, NDArray

from froxel_ref.arrays import Field
from froxel_ref.blocks import blocks, run
from froxel_ref.buffers import Hits
from froxel_ref.geometry import CUBE, Matrix, Rays, crop_rays, dot, ray_bounds
from froxel_ref.primitives import Facets, box_normals, hit_box, hit_plane, hit_sphere
from froxel_ref.records import InputError
from froxel_ref.scene import HeightField, Mesh, Plane, Scene, Sphere, Surface
from froxel_ref.shading import shade
from froxel_ref.triangles import height_field_normals, hit_height_field, hit_mesh, mesh_caster, mesh_normals

if TYPE_CHECKING:
    from froxel_ref.assets import Assets

__all__ = ["Hits", "find_surfaces", "imported", "shade"]

Window = tuple[slice, slice]

# Pixels in a block. Measured on a hall of 21 boxes: smaller blocks lose more to the interpreter, which only
# one thread at a time can hold, larger ones to the cache.
BLOCK = 131072


class _Target(NamedTuple):
    """A surface made ready: where it can be seen, how it is hit, and the normals of its facets."""

    window: Window
    hit: Callable[[Rays], tuple[Field, Facets]]
    normals: Matrix  # (facets, 3)
    albedo: tuple[float, float, float]
    center: tuple[float, float, float] | None = None  # of a sphere, whose normals are found afterwards


# --- finding ----------------------------------------------------------------------------------------


def find_surfaces(surfaces: Sequence[Surface], rays: Rays, assets: Assets, *, restrict: bool = True,
                  threads: int | None = None) -> Hits:
    """Find the nearest surface along each ray.

    Parameters
    ----------
    surfaces : sequence of Plane, Box, Sphere, HeightField, Mesh
        Where two are equally near, the first in the list is seen.
    rays : Rays
        Shape (h, w); their dtype is that of the result.
    assets : Assets
        Height fields and meshes by their records.
    restrict : bool
        Test each surface only within `froxel_ref.geometry.ray_bounds` of it. The result is the same without.
    threads : int, optional
        Default: one for each core. The result does not depend on it.

    Returns
    -------
    Hits
        Normals face the camera.

    Raises
    ------
    InputError
        A mesh without Embree installed.

    Notes
    -----
    In a renderer the rasteriser's depth buffer stands here. Depths are exact but for rounding: some ulp of t
    for planes and boxes away from grazing, see the primitives for the others.

    Examples
    --------
    >>> from froxel_ref.geometry import camera_rays
    >>> from froxel_ref.scene import Box, Camera
    >>> rays = camera_rays(Camera(position=(0, 0, 4), target=(0, 0, 0)), 1, 1)
    >>> hits = find_surfaces([Sphere(radius=1), Box()], rays, None)
    >>> hits.depth.tolist(), hits.normal.ravel().tolist()
    ([[3.0]], [0.0, 0.0, 1.0])
    """
    shape, dtype = rays.length.shape, rays.length.dtype
    whole = (slice(0, shape[0]), slice(0, shape[1]))
    targets = [_prepare(surface, rays, assets) for surface in surfaces]
    if not restrict:
        targets = [target._replace(window=whole) for target in targets]
    first = np.cumsum([1] + [len(target.normals) for target in targets]).tolist()
    normals = _table([target.normals for target in targets], dtype)
    albedos = _table([np.broadcast_to(target.albedo, target.normals.shape) for target in targets], dtype)
    hits = Hits(np.full(shape, np.inf, dtype), np.empty((3, *shape), dtype), np.empty((3, *shape), dtype))
    facet = np.zeros(shape, np.int32)

    def find(rows: slice) -> None:
        for target, number in zip(targets, first, strict=False):
            _test(target, number, rows, rays, hits.depth, facet)
        for table, image in ((normals, hits.normal), (albedos, hits.albedo)):
            for row, plane in zip(table, image, strict=True):
                plane[rows] = row.take(facet[rows])
        for target, number in zip(targets, first, strict=False):
            if target.center is not None:
                _sphere_normals(target, number, rows, rays, hits, facet)
        _face_camera(hits.normal[:, rows], crop_rays(rays, rows, whole[1]))

    run(find, (rows for _, rows in blocks(1, *shape, size=BLOCK)), threads=threads)
    return hits


def _table(facets: list[Matrix], dtype: DTypeLike) -> Field:
    """One column for each facet; column 0 is what is seen where there is nothing."""
    return np.concatenate([np.zeros((1, 3)), *facets]).T.astype(dtype, order="C")


def _test(target: _Target, number: int, rows: slice, rays: Rays, depth: Field, facet: Facets) -> None:
    """Enter a surface's hits into the depth buffer where they are nearest."""
    y, x = _overlap(target.window[0], rows), target.window[1]
    if y.start >= y.stop or x.start >= x.stop:
        return
    t, which = target.hit(crop_rays(rays, y, x))
    closer = t < depth[y, x]
    np.copyto(depth[y, x], t, where=closer)
    np.copyto(facet[y, x], np.add(which, number, dtype=np.int32), where=closer)


def _sphere_normals(target: _Target, number: int, rows: slice, rays: Rays, hits: Hits, facet: Facets) -> None:
    """Normals where a sphere is seen: from its centre to the hit."""
    y, x = _overlap(target.window[0], rows), target.window[1]
    seen = facet[y, x] == number
    if not seen.any():
        return
    q = np.subtract(rays.origin, target.center or ()).tolist()
    t = hits.depth[y, x][seen]
    part = crop_rays(rays, y, x)
    outward = [q[i] + np.broadcast_to(part.per_depth[i], seen.shape)[seen] * t for i in range(3)]
    length = np.sqrt(dot(*(tuple(outward),) * 2))
    for image, component in zip(hits.normal[:, y, x], outward, strict=True):
        image[seen] = component / length


def _face_camera(normal: Field, rays: Rays) -> None:
    """Turn normals that point away from the camera."""
    away = dot((normal[0], normal[1], normal[2]), rays.per_depth) > 0.0
    np.negative(normal, out=normal, where=away)
    normal += 0.0  # no negative zeros


def _overlap(a: slice, b: slice) -> slice:
    start = max(a.start, b.start)
    return slice(start, max(start, min(a.stop, b.stop)))


# --- making ready -----------------------------------------------------------------------------------


def _prepare(surface: Surface, rays: Rays, assets: Assets) -> _Target:
    """What `_test` needs of a surface."""
    if isinstance(surface, Plane):
        return _plane(surface, rays)
    if isinstance(surface, Sphere):
        return _sphere(surface, rays)
    if isinstance(surface, HeightField):
        return _height_field(surface, rays, assets.heights[surface.heights])
    if isinstance(surface, Mesh):
        return _mesh(surface, rays, *assets.meshes[surface])
    pose = surface.transform.world_from_local
    return _Target(ray_bounds(rays, _placed(pose, CUBE)), lambda part: hit_box(part, pose),
                   box_normals(pose), surface.albedo)


def _height_field(surface: HeightField, rays: Rays, heights: Field) -> _Target:
    pose = surface.transform.world_from_local
    corners = np.where(CUBE > 0.0, (1.0, 1.0, heights.max()), (-1.0, -1.0, heights.min()))
    return _Target(ray_bounds(rays, _placed(pose, corners)),
                   lambda part: hit_height_field(part, pose, heights),
                   height_field_normals(pose, heights), surface.albedo)


def _mesh(surface: Mesh, rays: Rays, vertices: Matrix, faces: Facets) -> _Target:
    placed = _placed(surface.transform.world_from_local, vertices)
    triangles = placed[faces]
    caster = mesh_caster(placed, faces)
    corners = np.where(CUBE > 0.0, triangles.max(axis=(0, 1)), triangles.min(axis=(0, 1)))
    return _Target(ray_bounds(rays, corners), lambda part: hit_mesh(part, triangles, caster),
                   mesh_normals(triangles), surface.albedo)


def _plane(plane: Plane, rays: Rays) -> _Target:
    rows, columns = rays.length.shape
    normal = np.asarray(plane.normal) / np.max(np.abs(plane.normal))
    nothing: NDArray[Any] = np.zeros((1, 1), np.uint8)
    return _Target((slice(0, rows), slice(0, columns)),
                   lambda part: (hit_plane(part, plane.point, tuple(normal.tolist())), nothing),
                   (normal / math.sqrt(normal @ normal))[np.newaxis], plane.albedo)


def _sphere(sphere: Sphere, rays: Rays) -> _Target:
    nothing: NDArray[Any] = np.zeros((1, 1), np.uint8)
    return _Target(ray_bounds(rays, sphere.center + sphere.radius * CUBE),
                   lambda part: (hit_sphere(part, sphere.center, sphere.radius), nothing),
                   np.zeros((1, 3)), sphere.albedo, sphere.center)


def _placed(pose: Matrix, points: NDArray[Any]) -> Matrix:
    result: Matrix = points @ pose[:3, :3].T + pose[:3, 3]
    return result


# --- made elsewhere ---------------------------------------------------------------------------------


def imported(assets: Assets, scene: Scene, *, dtype: DTypeLike = np.float64) -> tuple[Hits, Field]:
    """Take depth and colour from the user's own images instead of surfaces.

    Parameters
    ----------
    assets : Assets
        ``depth`` (h, w) and ``radiance`` (3, h, w) or None, as `Scene.image_buffers` names them.
    scene : Scene
        Its camera gives the size that the images must have; its background is taken where no radiance is
        given and depth is infinite.
    dtype : data type
        Of the result.

    Returns
    -------
    hits : Hits
        Normal and albedo are 0 with length-1 axes: nothing is known of them.
    radiance : Field, shape (3, h, w) [W m⁻² sr⁻¹]
        As given; without an image, the background or black.

    Raises
    ------
    InputError
        An image has not the camera's size, a depth is not above 0, or a radiance is not finite.

    Examples
    --------
    >>> from types import SimpleNamespace
    >>> from froxel_ref.scene import Camera
    >>> scene = Scene(camera=Camera(width=2, height=1), background=(1, 1, 1))
    >>> images = SimpleNamespace(depth=np.array([[2.0, np.inf]]), radiance=None)
    >>> imported(images, scene)[1][0].tolist()
    [[0.0, 1.0]]
    """
    size = (scene.camera.height, scene.camera.width)
    depth, given = np.asarray(assets.depth), assets.radiance
    _must_have(depth, size, "depth")
    if not (depth > 0.0).all():
        raise InputError("image_buffers.depth", "has values that are not above 0 m, must be above 0 m "
                                                "(infinite where there is nothing)")
    depth = depth.astype(dtype)
    nothing = np.zeros((3, 1, 1), depth.dtype)
    if given is None:
        background = np.array(scene.background, depth.dtype)[:, np.newaxis, np.newaxis]
        return Hits(depth, nothing, nothing), np.where(np.isinf(depth), background, nothing)
    _must_have(given, (3, *size), "radiance")
    if not np.isfinite(given).all():
        raise InputError("image_buffers.radiance", "has values that are not finite, must be finite")
    return Hits(depth, nothing, nothing), given.astype(dtype)


def _must_have(image: NDArray[Any], shape: tuple[int, ...], name: str) -> None:
    if image.shape != shape:
        raise InputError(f"image_buffers.{name}", f"has height and width {image.shape[-2:]}, must have the "
                                                  f"camera's {shape[-2:]}")
