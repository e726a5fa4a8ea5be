"""The converged image: surfaces seen through media, put together as the frame does, without its froxels."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from froxel_ref.arrays import Field, Points
from froxel_ref.buffers import Hits
from froxel_ref.geometry import Rays, camera_rays
from froxel_ref.light_paths import light_transmittance
from froxel_ref.media import contributing
from froxel_ref.records import InputError, suggest
from froxel_ref.scene import Scene
from froxel_ref.settings import Settings
from froxel_ref.shadow_stage import exact_sights
from froxel_ref.single_scattering import Physics
from froxel_ref.surface import find_surfaces, imported, shade
from froxel_ref.truth import Progress, Truth, check_options, make_truth_physics, trace

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


class TruthImage(NamedTuple):
    """A converged image.

    Attributes
    ----------
    radiance : ndarray, shape (3, h, w) [W m⁻² sr⁻¹]
        Surfaces times transmittance, plus the media's light.
    error : ndarray, shape (3, h, w) [W m⁻² sr⁻¹]
        Estimated absolute error: that of the rays' light and, with a box filter, the filter's own.
    fog_radiance : ndarray, shape (3, h, w) [W m⁻² sr⁻¹]
        The media's light alone.
    fog_transmittance : ndarray, shape (h, w) or (3, h, w) [1]
        The share of the surface's light that passes.
    converged : ndarray of bool, shape (h, w)
        Whether every ray of the pixel reached its tolerance (of the media's light). Of the filter's error
        nothing is promised, it is only told.
    evaluations : ndarray of int, shape (h, w)
        Points at which a light was evaluated.
    filter_error : ndarray, shape (3, h, w) [W m⁻² sr⁻¹]
        The filter's share of the error: 0 for rays through the centres.
    """

    radiance: Array
    error: Array
    fog_radiance: Array
    fog_transmittance: Array
    converged: NDArray[np.bool_]
    evaluations: NDArray[np.intp]
    filter_error: Array


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
        No medium that dims or glows; or no light, ambient light or emission; or particles or transparent
        surfaces, which the truth does not draw.

    Examples
    --------
    >>> check_integrable(Scene(), Settings())
    Traceback (most recent call last):
        ...
    froxel_ref.records.InputError: scene: has no medium with extinction or emission: nothing to integrate
    """
    _check_all_drawn(scene)
    media = contributing((*scene.global_media, *scene.local_media))
    if not media:
        raise InputError("scene", "has no medium with extinction or emission: nothing to integrate")
    ambient = any(scene.ambient) or settings.ambient == "constant"
    if not (scene.all_lights or ambient or any(any(medium.emissive) for medium in media)):
        raise InputError("scene", "has no light, no ambient light and no emission: nothing to integrate")


def _check_all_drawn(scene: Scene) -> None:
    for name, items in (("particles", scene.all_particles), ("transparent_surfaces", scene.transparent_surfaces)):
        if any(each.visible for each in items):
            raise InputError(name, f"are not in the truth, must be left out (--set scene.{name}=[])")


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
                 sun_distance: float = np.inf, far: float | None = None, pixel_filter: str = "centre",
                 threads: int | None = None, progress: Progress | None = None) -> TruthImage:
    """Render an image whose single scattering has converged.

    Parameters
    ----------
    scene : Scene
    settings : Settings, optional
        As for `froxel_ref.truth.trace`; where integrate_from is "near", media in front of the grid's near
        boundary are left out, as the frame does.
    assets : Assets, optional
        What the scene's files hold.
    rtol, sun_distance, threads
        As for `froxel_ref.truth.trace`.
    shadows : {"off", "exact"}, optional
        Default: exact, unless the settings have them off.
    volumetric_shadows : bool, optional
        Whether media dim light on its way, to surfaces too. Default: unless the settings have them off.
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
    L = L_surface·T + L_media [Dörries 2020, eq. 2.11]. The box filter is the tensor Gauss–Kronrod rule
    (3, 7); its error |K − G| is large, and rightly so, where an edge crosses a pixel.

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
    check_options(rtol, shadows, sun_distance)
    check_filter(scene, pixel_filter)
    _check_all_drawn(scene)
    from froxel_ref.assets import load_assets

    assets = load_assets(scene, None) if assets is None else assets
    physics = make_truth_physics(scene, settings, assets, shadows, volumetric_shadows, sun_distance)
    options = {"rtol": rtol, "shadows": shadows, "volumetric_shadows": volumetric_shadows,
               "sun_distance": sun_distance, "threads": threads, "assets": assets, "settings": settings}
    far = settings.grid.far if far is None else far
    samples = list(_samples(pixel_filter))
    whole = scene.camera.width * scene.camera.height
    images, weights = [], []
    for number, (jitter, kronrod, gauss) in enumerate(samples):
        def tell(done: int, count: int, before: int = number * whole) -> None:
            if progress is not None:
                progress(before + done, whole * len(samples))

        images.append(_one_image(scene, physics, jitter, far, options | {"progress": tell}))
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
                      np.sum([i.evaluations for i in images], axis=0), edges)


def _one_image(scene: Scene, physics: Physics, jitter: tuple[float, float], far: float,
               options: dict[str, Any]) -> TruthImage:
    """One ray for each pixel."""
    settings, camera, assets = physics.settings, scene.camera, options["assets"]
    rays = camera_rays(camera, camera.width, camera.height, jitter=jitter)
    hits, behind = _surfaces(scene, physics, rays, assets, options["threads"])
    if settings.exposure == "lighting":
        behind = behind * camera.exposure
    origins, directions, ends = image_lines(rays, hits.depth, far)
    begin: Array = np.zeros_like(ends)
    if settings.integrate_from == "near":
        begin = np.minimum(settings.grid.near * rays.length.reshape(-1), ends)
    fog = trace(scene, origins, directions, ends, starts=begin, **options)
    shape = rays.length.shape
    fog = Truth._make(field.reshape(*field.shape[:-1], *shape) for field in fog)
    return TruthImage(behind * fog.transmittance + fog.radiance, fog.error, fog.radiance, fog.transmittance,
                      fog.converged, fog.evaluations, np.zeros_like(fog.error))


def _surfaces(scene: Scene, physics: Physics, rays: Rays, assets: Assets,
              threads: int | None) -> tuple[Hits, Array]:
    """What the rays hit, and its radiance."""
    if scene.image_buffers is not None:
        return imported(assets, scene)
    hits = find_surfaces(scene.surfaces, rays, assets, threads=threads)
    attenuation = physics.settings.attenuation
    opaque = exact_sights(scene, assets) if physics.occluders else {}
    if not physics.volumetric:
        return hits, shade(hits, rays, scene, attenuation=attenuation, visibility=opaque, threads=threads)

    def passing(channel: int, number: int, points: Points, normal: Points | None = None) -> Field:
        way = light_transmittance(physics.media, physics.extinction, physics.lights[number], points,
                                  settings=physics.settings, sun_distance=physics.sun_distance)
        share: Field = way[min(channel, len(way) - 1)]
        return np.asarray(share * opaque[number](points, normal)) if number in opaque else share

    # Visibility is one number a light: coloured extinction is shaded one channel at a time.
    planes = []
    for channel in range(physics.extinction.shape[1]):
        every = {number: partial(passing, channel, number) if physics.dims(number) else opaque[number]
                 for number in range(len(physics.lights)) if physics.dims(number) or number in opaque}
        planes.append(shade(hits, rays, scene, attenuation=attenuation, visibility=every, threads=threads))
    return hits, planes[0] if len(planes) == 1 else np.stack([plane[c] for c, plane in enumerate(planes)])
