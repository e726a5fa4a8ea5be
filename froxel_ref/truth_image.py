"""The converged image: surfaces, particles and panes seen through media, put together without froxels."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from froxel_ref.arrays import Field, Points, Visibility
from froxel_ref.billboard_shadows import points_transmittance
from froxel_ref.buffers import Hits
from froxel_ref.fom_plan import particle_size
from froxel_ref.geometry import Rays, camera_rays
from froxel_ref.light_paths import light_transmittance
from froxel_ref.media import contributing
from froxel_ref.records import InputError, suggest
from froxel_ref.scene import Scene
from froxel_ref.settings import Settings
from froxel_ref.shadow_stage import exact_sights
from froxel_ref.single_scattering import Physics
from froxel_ref.surface import find_surfaces, imported, shade
from froxel_ref.truth import Progress, Truth, check_options, make_truth_physics, trace_layers
from froxel_ref.truth_input import check_limits, make_lines
from froxel_ref.truth_layers import by_channel, find_layers

if TYPE_CHECKING:
    from froxel_ref.assets import Assets

__all__ = ["FILTERS", "TruthImage", "check_filter", "check_integrable", "image_lines", "render_truth", "shadow_kind"]

Array: TypeAlias = NDArray[np.floating[Any]]

FILTERS = ("centre", "box")

# The (3, 7) Gauss–Kronrod pair on (−1, 1) [Kronrod 1965], for the box filter over a pixel.
_X = np.array([0.960491268708020283423507092629080, 0.774596669241483377035853079956480,
               0.434243749346802558002071502844628])
_W = np.array([0.104656226026467265193823857192073, 0.268488089868333440728569280666710,
               0.401397414775962222905051818618432])
FILTER_NODES = 0.5 + 0.5 * np.concatenate([-_X, [0.0], _X[::-1]])
FILTER_KRONROD = 0.5 * np.concatenate([_W, [0.450916538658474142345110087045571], _W[::-1]])
FILTER_GAUSS = np.array([0.0, 5.0, 0.0, 8.0, 0.0, 5.0, 0.0]) / 18.0

# What stands for particles and transparent surfaces where a scene has none.
NO_LIGHT, ALL_PASSES = np.zeros((3, 1, 1)), np.ones((1, 1))
for _nothing in (NO_LIGHT, ALL_PASSES):
    _nothing.setflags(write=False)


class TruthImage(NamedTuple):
    """A converged image.

    Attributes
    ----------
    radiance : ndarray, shape (3, h, w) [W m⁻² sr⁻¹]
        Surfaces times both transmittances, plus the layers' light and the media's.
    error : ndarray, shape (3, h, w) [W m⁻² sr⁻¹]
        Estimated absolute error: that of the rays' light and, with a box filter, the filter's own.
    fog_radiance : ndarray, shape (3, h, w) [W m⁻² sr⁻¹]
        The media's light alone, as it arrives through particles and transparent surfaces.
    fog_transmittance : ndarray, shape (h, w) or (3, h, w) [1]
        The share of the surface's light that passes the media.
    converged : ndarray of bool, shape (h, w)
        Whether every ray of the pixel reached its tolerance (of the media's light). Of the filter's error
        nothing is promised, it is only told.
    evaluations : ndarray of int, shape (h, w)
        Points at which a light was evaluated.
    filter_error : ndarray, shape (3, h, w) [W m⁻² sr⁻¹]
        The filter's share of the error: 0 for rays through the centres.
    layer_radiance : ndarray, shape (3, h, w), or (3, 1, 1) where the scene has none [W m⁻² sr⁻¹]
        Light of particles and transparent surfaces, as it arrives through the media and those in front.
    layer_transmittance : ndarray, shape (h, w), or (1, 1) where the scene has none [1]
        The share of the surface's light that passes them.
    """

    radiance: Array
    error: Array
    fog_radiance: Array
    fog_transmittance: Array
    converged: NDArray[np.bool_]
    evaluations: NDArray[np.intp]
    filter_error: Array
    layer_radiance: Array = NO_LIGHT
    layer_transmittance: Array = ALL_PASSES


def check_filter(scene: Scene, pixel_filter: str) -> None:
    """Refuse a filter that is not known, or that the scene has no rays for; raises InputError."""
    if pixel_filter not in FILTERS:
        raise InputError("pixel_filter", f"is {pixel_filter!r}; {suggest(pixel_filter, FILTERS)}")
    if pixel_filter == "box" and scene.image_buffers is not None:
        raise InputError("pixel_filter", "is 'box', which a scene with its own depth image has no rays for")


def check_integrable(scene: Scene, settings: Settings) -> None:
    """Refuse a scene whose media have no light to send.

    Raises
    ------
    InputError
        No medium that dims or glows; or no light, ambient light or emission.

    Examples
    --------
    >>> check_integrable(Scene(), Settings())
    Traceback (most recent call last):
        ...
    froxel_ref.records.InputError: scene: has no medium with extinction or emission: nothing to integrate
    """
    media = contributing((*scene.global_media, *scene.local_media))
    if not media:
        raise InputError("scene", "has no medium with extinction or emission: nothing to integrate")
    ambient = any(scene.ambient) or settings.ambient == "constant"
    if not (scene.all_lights or ambient or any(any(medium.emissive) for medium in media)):
        raise InputError("scene", "has no light, no ambient light and no emission: nothing to integrate")


def image_lines(rays: Rays, depth: Field, far: float) -> tuple[Array, Array, Array]:
    """A raster's rays for `froxel_ref.truth.trace`.

    Parameters
    ----------
    rays : Rays
        Shape (h, w).
    depth : Field, broadcastable to (h, w) [m]
        View depth at which each ray ends, at most ``far``.
    far : float [m]
        View depth at which rays end that hit nothing nearer.

    Returns
    -------
    origins, directions : ndarray, shape (3, 1) and (3, h·w)
    ends : ndarray, shape (h·w,) [m]
    """
    shape = rays.length.shape
    directions = np.stack([np.broadcast_to(c, shape).reshape(-1) for c in rays.per_depth])
    length = rays.length.reshape(-1)
    ends = np.minimum(np.broadcast_to(depth, shape).reshape(-1), far) * length
    return np.asarray(rays.origin, np.float64)[:, np.newaxis], directions / length, ends


def shadow_kind(settings: Settings) -> str:
    """The shadows that are the truth of a frame's.

    Parameters
    ----------
    settings : Settings

    Returns
    -------
    {"off", "exact"}

    Examples
    --------
    >>> shadow_kind(Settings(shadows="maps"))
    'exact'
    """
    return "off" if settings.shadows == "off" else "exact"


def render_truth(scene: Scene, settings: Settings | None = None, *, assets: Assets | None = None,
                 rtol: float = 1e-4, shadows: str | None = None, volumetric_shadows: bool | None = None,
                 sun_distance: float = np.inf, sun_media: str = "all", far: float | None = None,
                 pixel_filter: str = "centre", threads: int | None = None, progress: Progress | None = None
                 ) -> TruthImage:
    """Render an image whose single scattering has converged.

    Parameters
    ----------
    scene : Scene
    settings : Settings, optional
        As for `froxel_ref.truth.trace`; where integrate_from is "near", media in front of the grid's near
        boundary are left out, as the frame does.
    assets : Assets, optional
        What the scene's files hold.
    rtol, sun_distance, sun_media, threads
        As for `froxel_ref.truth.trace`.
    shadows : {"off", "exact"}, optional
        Default: exact, unless the settings have them off.
    volumetric_shadows : bool, optional
        Whether media and particles dim light on its way, to surfaces and particles too. Default: unless the settings
        have them off.
    far : float, optional [m]
        View depth at which rays end that hit nothing nearer; the grid's far boundary unless given, where
        the frame's fog ends too.
    pixel_filter : {"centre", "box"}
        One ray through each pixel's centre, as the frame; or the mean over the pixel, by 7 × 7 rays.
    progress : callable, optional
        Called as ``progress(rays done, rays)``.

    Returns
    -------
    TruthImage

    Raises
    ------
    InputError
        As `froxel_ref.truth.trace`; an unknown filter, or a box filter over a scene's own depth image.

    Notes
    -----
    L = L_surface·T·Π_j (1 − α_j) + L_media + L_layers [Dörries 2020, eq. 2.11 and §4.3], the j-th of the particles and
    transparent surfaces that the ray crosses fogged at its own depth: all that lies behind it, fog included, arrives by
    1 − α_j, and it adds its own light times α_j (`froxel_ref.truth_layers`). They are lit like surfaces: every light
    hidden by surfaces, and dimmed by media and particles, along a straight way from each point.

    The box filter is the tensor Gauss–Kronrod rule (3, 7); its error |K − G| is large, and rightly so, where an edge
    crosses a pixel.

    Examples
    --------
    >>> from froxel_ref.scene import Camera, Medium
    >>> fire = Medium(extinction=1, emissive=(1, 1, 1))
    >>> image = render_truth(Scene(camera=Camera(width=2, height=1), global_media=(fire,)))
    >>> image.radiance[0].round(6).tolist()
    [[1.0, 1.0]]
    """
    settings = settings or Settings()
    shadows = shadow_kind(settings) if shadows is None else shadows
    if volumetric_shadows is None:
        volumetric_shadows = settings.volumetric_shadows != "off"
    check_options(rtol, shadows, sun_distance, sun_media)
    check_limits(volumetric_shadows, 1, 1, threads)
    check_filter(scene, pixel_filter)
    from froxel_ref.assets import load_assets

    assets = load_assets(scene, None) if assets is None else assets
    physics = make_truth_physics(scene, settings, assets, shadows, volumetric_shadows, sun_distance, sun_media)
    far = settings.grid.far if far is None else far
    samples = list(_samples(pixel_filter))
    whole = scene.camera.width * scene.camera.height
    images, weights = [], []
    for number, (jitter, kronrod, gauss) in enumerate(samples):
        def tell(done: int, count: int, before: int = number * whole) -> None:
            if progress is not None:
                progress(before + done, whole * len(samples))

        images.append(_one_image(physics, assets, jitter, far, rtol=rtol, threads=threads, progress=tell))
        weights.append((kronrod, gauss))
    return images[0] if len(images) == 1 else _filtered(images, weights)


def _samples(pixel_filter: str) -> Iterator[tuple[tuple[float, float], float, float]]:
    """Places in a pixel, with their weights in the two rules."""
    if pixel_filter == "centre":
        yield (0.5, 0.5), 1.0, 1.0
        return
    for y, ky, gy in zip(FILTER_NODES, FILTER_KRONROD, FILTER_GAUSS, strict=True):
        for x, kx, gx in zip(FILTER_NODES, FILTER_KRONROD, FILTER_GAUSS, strict=True):
            yield (float(x), float(y)), float(kx * ky), float(gx * gy)


def _filtered(images: list[TruthImage], weights: list[tuple[float, float]]) -> TruthImage:
    def mean(name: str, rule: int) -> Array:
        return np.asarray(sum(w[rule] * getattr(i, name) for i, w in zip(images, weights, strict=True)))

    radiance = mean("radiance", 0)
    edges = np.abs(radiance - mean("radiance", 1))
    return TruthImage(radiance, mean("error", 0) + edges, mean("fog_radiance", 0), mean("fog_transmittance", 0),
                      np.logical_and.reduce([i.converged for i in images]),
                      np.sum([i.evaluations for i in images], axis=0), edges, mean("layer_radiance", 0),
                      mean("layer_transmittance", 0))


def _one_image(physics: Physics, assets: Assets, jitter: tuple[float, float], far: float, *, rtol: float,
               threads: int | None, progress: Progress) -> TruthImage:
    """One ray for each pixel."""
    scene, settings, camera = physics.scene, physics.settings, physics.scene.camera
    rays = camera_rays(camera, camera.width, camera.height, jitter=jitter)
    sights = _sights(physics, assets)
    hits, behind = _surfaces(physics, rays, assets, sights, threads)
    if settings.exposure == "lighting":
        behind = behind * camera.exposure
    layers = find_layers(scene, settings, assets, rays, hits.depth, sights, threads=threads)
    origins, directions, ends = image_lines(rays, hits.depth, far)
    begin: Array = np.zeros_like(ends)
    if settings.integrate_from == "near":
        begin = np.minimum(settings.grid.near * rays.length.reshape(-1), ends)
    fog, own, passed = trace_layers(physics, make_lines(origins, directions, begin, ends), layers, rtol=rtol,
                                    threads=threads, progress=progress)
    shape = rays.length.shape
    fog = Truth._make(field.reshape(*field.shape[:-1], *shape) for field in fog)
    surface = behind * fog.transmittance
    if layers is None:
        return TruthImage(surface + fog.radiance, fog.error, fog.radiance, fog.transmittance, fog.converged,
                          fog.evaluations, np.zeros_like(fog.error))
    own, passed = own.reshape(3, *shape), passed.reshape(shape)
    return TruthImage(surface * passed + own + fog.radiance, fog.error, fog.radiance, fog.transmittance,
                      fog.converged, fog.evaluations, np.zeros_like(fog.error), own, passed)


def _sights(physics: Physics, assets: Assets) -> list[Visibility]:
    """What is left of each light at points: of all channels alike, or of each where extinction is RGB."""
    opaque = exact_sights(physics.scene, assets) if physics.occluders else {}
    if not physics.volumetric:
        return [opaque]

    def passing(channel: int, number: int, points: Points, normal: Points | None = None) -> Field:
        way = light_transmittance(*physics.dimmers(number), physics.lights[number], points,
                                  settings=physics.settings, sun_distance=physics.sun_distance)
        share: Field = way[min(channel, len(way) - 1)]
        if physics.particles is not None:
            share = share * points_transmittance(physics.particles, physics.lights[number], points,
                                                 size=particle_size(physics.settings))
        return np.asarray(share * opaque[number](points, normal)) if number in opaque else share

    return [{number: partial(passing, channel, number) if physics.dims(number) else opaque[number]
             for number in range(len(physics.lights)) if physics.dims(number) or number in opaque}
            for channel in range(physics.extinction.shape[1])]


def _surfaces(physics: Physics, rays: Rays, assets: Assets, sights: list[Visibility],
              threads: int | None) -> tuple[Hits, Array]:
    """What the rays hit, and its radiance."""
    scene = physics.scene
    if scene.image_buffers is not None:
        return imported(assets, scene)
    hits = find_surfaces(scene.surfaces, rays, assets, threads=threads)
    return hits, by_channel([shade(hits, rays, scene, attenuation=physics.settings.attenuation, visibility=sight,
                                   threads=threads) for sight in sights])
