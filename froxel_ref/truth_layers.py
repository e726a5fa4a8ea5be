"""What camera rays cross in front of the opaque surfaces: points of particles and transparent surfaces, lit."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from froxel_ref.arrays import Field, Visibility
from froxel_ref.billboards import placed_particles
from froxel_ref.fom_plan import particle_size
from froxel_ref.geometry import Rays
from froxel_ref.particles import fragment_points, fragments, scattered_light
from froxel_ref.scene import Scene
from froxel_ref.settings import Settings
from froxel_ref.surface import find_surfaces, shade
from froxel_ref.transparency_stage import needs_layers

if TYPE_CHECKING:
    from froxel_ref.assets import Assets

__all__ = ["Layers", "by_channel", "find_layers", "padded"]

Array: TypeAlias = NDArray[np.floating[Any]]
Integers: TypeAlias = NDArray[np.intp]


class Layers(NamedTuple):
    """What n rays cross, m points in all, ray by ray and on each from front to back.

    Attributes
    ----------
    first : ndarray of int, shape (n + 1,)
        The points of ray i are first[i] … first[i + 1] − 1.
    distance : ndarray, shape (m,) [m]
        Along the ray.
    opacity : ndarray, shape (m,) [1]
    radiance : ndarray, shape (3, m) [W m⁻² sr⁻¹]
        What each would send to the camera if it were opaque.
    """

    first: Integers
    distance: Array
    opacity: Array
    radiance: Array


class _Points(NamedTuple):
    """Some points of layers: pixel, view depth, opacity, light, and the transparent surfaces before each."""

    pixel: Integers
    depth: Array
    opacity: Array
    radiance: Array
    behind: Integers


def find_layers(scene: Scene, settings: Settings, assets: Assets, rays: Rays, depth_image: Field,
                sights: Sequence[Visibility], *, threads: int | None = None) -> Layers | None:
    """Find what rays cross in front of the opaque surfaces, and light it.

    Parameters
    ----------
    scene : Scene
    settings : Settings
        Its particles_lit_at, attenuation and exposure.
    assets : Assets
    rays : Rays
        From the camera, shape (h, w).
    depth_image : Field, broadcastable to (h, w) [m]
        View depth of the opaque surfaces, ∞ where there are none.
    sights : sequence of Visibility
        What hides and dims the lights: one for all three channels, or one for each.
    threads : int, optional
        Default: one for each core. The result does not depend on it.

    Returns
    -------
    Layers or None
        None where the scene has nothing of the kind.

    Notes
    -----
    The order is the frame's (CONVENTIONS.md): transparent surfaces by their depth in each pixel, of equally near ones
    the first in the scene in front; particles before or behind each of them by their own depth there, among
    themselves as wholes, by the view depth of their centres.

    Examples
    --------
    >>> from froxel_ref.assets import load_assets
    >>> from froxel_ref.geometry import camera_rays
    >>> from froxel_ref.scene import Particle
    >>> scene = Scene(particles=(Particle(position=(0, 1.7, -2)), Particle(position=(0, 1.7, -1), opacity=0.25)))
    >>> layers = find_layers(scene, Settings(), load_assets(scene, None), camera_rays(scene.camera, 1, 1),
    ...                      np.full((1, 1), np.inf), [{}])
    >>> layers.first.tolist(), layers.distance.tolist(), layers.opacity.tolist()
    ([0, 2], [1.0, 2.0], [0.25, 0.5])
    """
    if not needs_layers(scene, settings)[0]:
        return None
    shape = rays.length.shape
    depth = np.broadcast_to(depth_image, shape)
    images: list[Array] = []
    panes = _joined(_transparent(scene, settings, assets, rays, depth, sights, images, threads))
    order = np.lexsort((np.arange(panes.pixel.size), panes.depth, panes.pixel))
    panes = _Points._make(part[..., order] for part in panes)
    nearer = np.arange(panes.pixel.size) - np.searchsorted(panes.pixel, panes.pixel)
    puffs = _joined(_particles(scene, settings, assets, rays, depth, sights, images))
    every = _joined([puffs, panes._replace(behind=nearer)])
    # Particles come from back to front; those that k panes lie before are in front of the next pane, the k-th from 0.
    is_pane = np.arange(every.pixel.size) >= puffs.pixel.size
    order = np.lexsort((-np.arange(every.pixel.size), is_pane, every.behind, every.pixel))
    every = _Points._make(part[..., order] for part in every)
    first = np.searchsorted(every.pixel, np.arange(rays.length.size + 1))
    exposure = scene.camera.exposure if settings.exposure == "lighting" else 1.0
    distance = every.depth * np.broadcast_to(rays.length, shape).reshape(-1)[every.pixel]
    return Layers(first, distance, every.opacity, every.radiance * exposure)


def _joined(parts: Iterable[_Points]) -> _Points:
    none = np.zeros(0, np.intp)
    every = [_Points(none, np.zeros(0), np.zeros(0), np.zeros((3, 0)), none), *parts]
    return _Points._make(np.concatenate(column, axis=-1) for column in zip(*every, strict=True))


def _transparent(scene: Scene, settings: Settings, assets: Assets, rays: Rays, depth: Array,
                 sights: Sequence[Visibility], images: list[Array], threads: int | None) -> Iterator[_Points]:
    """Points of transparent surfaces, in any order; where each is, ∞ elsewhere, is added to the images."""
    for each in scene.transparent_surfaces:
        if each.visible:
            hits = find_surfaces([each.surface], rays, assets, threads=threads)
            light = by_channel([shade(hits, rays, scene, attenuation=settings.attenuation, visibility=sight,
                                      threads=threads) for sight in sights])
            on = hits.depth < depth
            images.append(np.where(on, hits.depth, np.inf))
            pixel = np.flatnonzero(on)
            yield _Points(pixel, hits.depth[on], np.full(pixel.size, each.opacity), light[:, on],
                          np.zeros(pixel.size, np.intp))


def _particles(scene: Scene, settings: Settings, assets: Assets, rays: Rays, depth: Array,
               sights: Sequence[Visibility], panes: Sequence[Array]) -> Iterator[_Points]:
    """Points of particles, from back to front."""
    ready, size = placed_particles(scene, assets), particle_size(settings)
    lit = [scattered_light(ready, scene.all_lights, scene.camera.position, ambient=scene.ambient, visibility=sight,
                           attenuation=settings.attenuation, size=size) for sight in sights]
    central = None
    if settings.particles_lit_at == "centre" and ready.size.size:
        x, y, z = ready.position
        central = by_channel([light_on((x, y, z), np.arange(x.size)) for light_on in lit])
    for some in fragments(ready, scene.camera, rays, depth, size=size):
        light = by_channel([light_on(fragment_points(rays, some), some.particle) for light_on in lit]
                           ) if central is None else central[:, some.particle]
        behind = np.zeros(some.row.size, np.intp)
        for pane in panes:
            behind += pane[some.row, some.column] <= some.depth
        yield _Points(some.row * rays.length.shape[1] + some.column, some.depth, some.opacity, light, behind)


def by_channel(planes: Sequence[Field]) -> Field:
    """Light of three channels, each by what hides it there.

    Parameters
    ----------
    planes : sequence of Field, shape (3, …)
        One for all channels, or one for each.

    Returns
    -------
    Field, shape (3, …)

    Examples
    --------
    >>> by_channel([np.arange(3.0), 10.0 + np.arange(3.0), 20.0 + np.arange(3.0)]).tolist()
    [0.0, 11.0, 22.0]
    """
    return planes[0] if len(planes) == 1 else np.stack([plane[c] for c, plane in enumerate(planes)])


def padded(layers: Layers, rows: slice) -> tuple[Array, Array, Array]:
    """The layers of some rays as rows of one length.

    Parameters
    ----------
    layers : Layers
    rows : slice

    Returns
    -------
    distance, opacity : ndarray, shape (n, K) [m], [1]
        ∞ and 0 where a ray has no more.
    radiance : ndarray, shape (3, n, K) [W m⁻² sr⁻¹]

    Examples
    --------
    >>> layers = Layers(np.array([0, 2, 3]), np.array([1.0, 2.0, 5.0]), np.full(3, 0.5), np.zeros((3, 3)))
    >>> padded(layers, slice(0, 2))[0].tolist()
    [[1.0, 2.0], [5.0, inf]]
    """
    first = layers.first[rows.start:rows.stop + 1]
    count = np.diff(first)
    ray = np.repeat(np.arange(count.size), count)
    some = slice(int(first[0]), int(first[-1]))
    place = np.arange(some.start, some.stop) - first[ray]
    shape = count.size, int(count.max(initial=0))
    distance, opacity, radiance = np.full(shape, np.inf), np.zeros(shape), np.zeros((3, *shape))
    distance[ray, place], opacity[ray, place] = layers.distance[some], layers.opacity[some]
    radiance[:, ray, place] = layers.radiance[:, some]
    return distance, opacity, radiance
