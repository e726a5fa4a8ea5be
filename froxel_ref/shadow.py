"""The shadow stage: maps of what opaque surfaces hide from each light, and how points look themselves up.

A map is made by exact rays through its texels' centres (`froxel_ref.shadow_raster`) from views that
`froxel_ref.shadow_views` lays out. `sight` turns one into a function from points to the share of light that
arrives (`froxel_ref.shadow_filters`): what `lighting` and `surface` ask.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import DTypeLike, NDArray

from froxel_ref import blocks
from froxel_ref.arrays import Field
from froxel_ref.geometry import bounding_radius
from froxel_ref.lights import colour
from froxel_ref.records import InputError
from froxel_ref.scene import Box, Camera, DirectionalLight, Light, Plane, PointLight, Sphere, SpotLight, Surface
from froxel_ref.settings import Grid, ShadowMaps
from froxel_ref.shadow_filters import exponential_map, pad_octahedral
from froxel_ref.shadow_lookup import ShadowMap, sight
from froxel_ref.shadow_raster import Caster, LightRaster, raster_depth, raster_rays
from froxel_ref.shadow_views import (
    WIDEST_SPOT,
    cascade_views,
    cube_views,
    octant_views,
    raster_from_world,
    spot_view,
)

__all__ = ["KINDS", "ShadowMap", "Stack", "make_stack", "map_kind", "map_of", "map_shape", "shadowed_lights", "sight"]

Matrix: TypeAlias = NDArray[np.float64]

KINDS = ("directional", "spot", "point")


class Stack(NamedTuple):
    """The maps of all lights of one kind.

    Attributes
    ----------
    light : ndarray of int, shape (m,)
        Which lights they are, by index in the scene.
    depth : Field, shape (m, faces, size, size) [m]
        First hits along the texels' rays, infinite where nothing is hit. One face for spot lights and
        octahedral maps, six for cubes, one for each cascade of a directional light.
    matrix : ndarray, shape (m, faces, 3, 4)
        From the world to texels and depth, see `froxel_ref.shadow_views.raster_from_world`; of an octahedral
        map to the position relative to the light.
    exponential : Field, shape (m, faces, n, n)
        The filtered map, if the technique is "exponential"; else m is 0.
    span : ndarray, shape (m, faces, 2) [m]
        The depths between which that one measures; m is 0 where it is.
    """

    light: NDArray[np.int64]
    depth: Field
    matrix: Matrix
    exponential: Field
    span: Matrix


# --- which lights -----------------------------------------------------------------------------------


def map_kind(light: Light) -> str:
    """The kind of map that a light has.

    Parameters
    ----------
    light : Light

    Returns
    -------
    {"directional", "spot", "point"}
        Spot lights beyond an outer angle of 75° have a point light's map.

    Examples
    --------
    >>> map_kind(SpotLight(position=(0, 0, 0), intensity=(1, 1, 1), outer_angle=80))
    'point'
    """
    if isinstance(light, DirectionalLight):
        return "directional"
    return "spot" if isinstance(light, SpotLight) and light.outer_angle <= WIDEST_SPOT else "point"


def shadowed_lights(lights: Sequence[Light], surfaces: Sequence[Surface]) -> tuple[int, ...]:
    """Which lights a surface may hide.

    Parameters
    ----------
    lights : sequence of Light
    surfaces : sequence of Surface

    Returns
    -------
    tuple of int
        Indices of the lights that shine, cast shadows, and have a casting surface within their radius, or a
        map made elsewhere.

    Examples
    --------
    >>> lamp = PointLight(position=(0, 9, 0), intensity=(1, 1, 1), radius=4)
    >>> shadowed_lights([lamp], [Plane()]), shadowed_lights([lamp], [Plane(point=(0, 6, 0))])
    ((), (0,))
    """
    casting = [surface for surface in surfaces if surface.casts_shadows]
    return tuple(i for i, light in enumerate(lights) if light.casts_shadows and colour(light).any()
                 and (light.shadow_map is not None or any(_reaches(light, surface) for surface in casting)))


def _reaches(light: Light, surface: Surface) -> bool:
    """Whether a surface may lie within a light's radius; yes where that takes its file to know."""
    if isinstance(light, DirectionalLight) or light.falloff != "windowed":
        return True
    place = np.asarray(light.position)
    if isinstance(surface, Plane):
        normal = np.asarray(surface.normal) / np.max(np.abs(surface.normal))
        away = abs(float(normal @ (place - surface.point))) / float(np.sqrt(normal @ normal))
    elif isinstance(surface, Sphere):
        away = float(np.linalg.norm(place - surface.center)) - surface.radius
    elif isinstance(surface, Box):
        pose = surface.transform.world_from_local
        local = np.linalg.solve(pose[:3, :3], place - pose[:3, 3])
        # To the point of the box whose local coordinates are nearest: never less than to the nearest point, so
        # the bounding ball decides where that is farther off.
        ball = float(np.linalg.norm(place - pose[:3, 3])) - bounding_radius(pose)
        away = ball if np.abs(local).max() > 1.0 else 0.0
    else:
        return True
    return away <= light.radius * (1.0 + 1e-9)


# --- making -----------------------------------------------------------------------------------------


def map_shape(kind: str, maps: ShadowMaps) -> tuple[int, int, int]:
    """Faces, rows and columns of a light's map.

    Parameters
    ----------
    kind : {"directional", "spot", "point"}
    maps : ShadowMaps

    Returns
    -------
    (int, int, int)

    Examples
    --------
    >>> map_shape("point", ShadowMaps()), map_shape("point", ShadowMaps(point_map="octahedral"))
    ((6, 256, 256), (1, 256, 256))
    """
    size: int = getattr(maps, f"{kind}_size")
    faces = {"directional": maps.cascades, "spot": 1, "point": 6 if maps.point_map == "cube" else 1}[kind]
    return faces, size, size


def make_stack(kind: str, lights: Mapping[int, Light], casting: Sequence[Caster], camera: Camera, grid: Grid, *,
               maps: ShadowMaps | None = None, given: Mapping[str, Field] | None = None,
               dtype: DTypeLike = np.float64, threads: int | None = None) -> Stack:
    """Make the shadow maps of all lights of one kind.

    Parameters
    ----------
    kind : {"directional", "spot", "point"}
    lights : mapping of int to Light
        Those of that kind that have a map, by index in the scene.
    casting : sequence of Caster
        From `froxel_ref.shadow_raster.casters`.
    camera, grid : Camera, Grid
        What cascades are fitted to.
    maps : ShadowMaps, optional
        Sizes and technique.
    given : mapping of str to Field, optional
        Maps made elsewhere, by the path that a light names.
    dtype : data type
        Of the depths.
    threads : int, optional
        Default: one for each core. The result does not depend on it.

    Returns
    -------
    Stack

    Raises
    ------
    InputError
        A given map of another shape, or with NaN.

    Notes
    -----
    Each texel's depth is exact but for rounding: first hits of the rays through texel centres, where a
    rasteriser would interpolate. The gutter of an octahedral map repeats the texels across its edge.

    Examples
    --------
    >>> from froxel_ref.shadow_raster import casters
    >>> lamp = SpotLight(position=(0, 2, 0), intensity=(1, 1, 1))
    >>> stack = make_stack("spot", {4: lamp}, casters([Plane()], None), Camera(), Grid(),
    ...                    maps=ShadowMaps(spot_size=16))
    >>> stack.light.tolist(), stack.depth.shape, float(stack.depth.min())
    ([4], (1, 1, 16, 16), 2.0)
    """
    maps = maps or ShadowMaps()
    shape = map_shape(kind, maps)
    depth = np.empty((len(lights), *shape), dtype)
    matrix = np.empty((len(lights), shape[0], 3, 4))
    tasks: list[Callable[[], None]] = []
    octahedral = kind == "point" and maps.point_map == "octahedral"
    for k, light in enumerate(lights.values()):
        views = [] if octahedral else _views(light, camera, grid, maps)
        matrix[k] = _relative(light) if octahedral else [raster_from_world(view) for view in views]
        if light.shadow_map is not None:
            depth[k] = _checked((given or {})[light.shadow_map], shape, kind,
                                f"lights[{list(lights)[k]}].shadow_map")
        elif isinstance(light, PointLight) and octahedral:
            tasks += _octahedral_tasks(light, casting, depth[k, 0], maps)
        else:
            tasks += [_task(casting, view, depth[k, face]) for face, view in enumerate(views)]
    blocks.run(lambda task: task(), tasks, threads=threads)
    if octahedral:
        _glue(depth, maps.edge)
    numbers = np.array(list(lights), np.int64)
    if maps.technique != "exponential":
        return Stack(numbers, depth, matrix, np.empty((0, *shape), depth.dtype), np.empty((0, shape[0], 2)))
    span = np.reshape([_span(light, depth[k], matrix[k]) for k, light in enumerate(lights.values())],
                      (len(lights), shape[0], 2))
    low, high = (span[..., end, np.newaxis, np.newaxis] for end in (0, 1))
    return Stack(numbers, depth, matrix, exponential_map(
        depth, low, high, exponent=maps.exponent, downsample=maps.downsample, blur=maps.blur), span)


def _views(light: Light, camera: Camera, grid: Grid, maps: ShadowMaps) -> list[LightRaster]:
    if isinstance(light, DirectionalLight):
        return cascade_views(light, camera, grid, maps)
    if isinstance(light, SpotLight) and map_kind(light) == "spot":
        return [spot_view(light, maps.spot_size, border=maps.edge)]
    return cube_views(light, maps.point_size, border=maps.edge)


def _relative(light: Light) -> Matrix:
    """From the world to the position relative to a lamp."""
    position = () if isinstance(light, DirectionalLight) else light.position
    return np.concatenate([np.eye(3), -np.reshape(position, (3, 1))], axis=1)[np.newaxis]


def _task(casting: Sequence[Caster], view: LightRaster, out: Field) -> Callable[[], None]:
    def draw() -> None:
        raster_depth(casting, view, dtype=out.dtype, out=out)

    return draw


def _octahedral_tasks(light: PointLight, casting: Sequence[Caster], out: Field, maps: ShadowMaps
                      ) -> list[Callable[[], None]]:
    """The four quarters of a map without its gutter, as distances from the light."""
    border = maps.edge
    inner = maps.point_size - 2 * border
    half = inner // 2

    def quarter(row: int, column: int, upper: LightRaster, lower: LightRaster) -> None:
        target = out[border + row * half:border + (row + 1) * half, border + column * half:border + (column + 1) * half]
        for view, chosen in ((upper, True), (lower, False)):
            depth = raster_depth(casting, view)
            _, way = raster_rays(view)
            depth *= np.sqrt((way * way).sum(axis=0))
            np.copyto(target, depth.astype(out.dtype), where=(way[1] >= 0.0) == chosen)

    return [lambda place=place, pair=pair: quarter(*place, *pair)  # type: ignore[misc]
            for place, pair in octant_views(light, inner).items()]


def _glue(depth: Field, border: int) -> None:
    """Fill the gutters of octahedral maps."""
    inner = slice(border, depth.shape[-1] - border)
    depth[...] = pad_octahedral(depth[..., inner, inner], border)


def _checked(values: Field, shape: tuple[int, int, int], kind: str, place: str) -> Field:
    """A map made elsewhere, of the shape that it must have."""
    allowed = shape if shape[0] > 1 else shape[1:]
    if values.shape not in (shape, allowed):
        raise InputError(place, f"has shape {values.shape}, must be {allowed} (settings.shadow_maps)")
    if np.isnan(values).any() or np.isneginf(values).any():
        raise InputError(place, "has NaN or −∞, must hold depths in metres, infinite where nothing is hit")
    if kind != "directional" and (values < 0.0).any():
        raise InputError(place, "has negative depths, must hold distances from the light in metres")
    return values


def _span(light: Light, depth: Field, matrix: Matrix) -> Matrix:
    """The depths that an exponential map measures on each face, shape (faces, 2) [m].

    It needs room beyond its receivers, for what is cut to its end brightens what is filtered with it: half as
    much again as a cascade is wide. A lamp without a window reaches as far as nine tenths of what it sees.
    """
    if isinstance(light, DirectionalLight):
        half = 0.5 * depth.shape[-1] / np.sqrt((matrix[:, 0, :3] ** 2).sum(axis=-1))
        return np.stack([-1.5 * half, 1.5 * half], axis=1)
    far = light.radius
    if light.falloff != "windowed":
        hit = depth[np.isfinite(depth)]
        far = 1.25 * float(np.quantile(hit, 0.9)) if hit.size and hit.max() > 0.0 else 1.0
    return np.tile([0.0, far], (len(matrix), 1))


# --- one light's map --------------------------------------------------------------------------------


def map_of(stack: Stack, k: int, kind: str, light: Light, *, maps: ShadowMaps,
           given: Mapping[str, Field] | None = None) -> ShadowMap:
    """Take one light's map out of a stack, for `sight`.

    Parameters
    ----------
    stack : Stack
        From `make_stack`.
    k : int
        Which of its lights.
    kind : {"directional", "spot", "point"}
        The stack's.
    light : Light
        That light.
    maps, given
        As for `make_stack`.

    Returns
    -------
    ShadowMap

    Examples
    --------
    >>> lamp = PointLight(position=(0, 2, 0), intensity=(1, 1, 1))
    >>> stack = make_stack("point", {0: lamp}, (), Camera(), Grid(), maps=ShadowMaps(point_size=16))
    >>> map_of(stack, 0, "point", lamp, maps=ShadowMaps(point_size=16)).kind
    'cube'
    """
    name = maps.point_map if kind == "point" else kind
    eps = 0.0 if light.shadow_map is None or given is None else float(np.finfo(given[light.shadow_map].dtype).eps)
    if maps.technique != "exponential":
        return ShadowMap(name, stack.depth[k], stack.matrix[k], eps=eps)
    low, high = stack.span[k].T
    return ShadowMap(name, stack.depth[k], stack.matrix[k], stack.exponential[k], low, high, eps)
