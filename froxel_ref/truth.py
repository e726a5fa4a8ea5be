"""The converged truth: single scattering along rays, to a requested tolerance and with an error estimate.

Media, phase functions and lights are those of the frame, evaluated at points (`froxel_ref.media.media_at`,
`froxel_ref.lights`, `froxel_ref.phase`). The quadrature is its own: rays are cut where their light breaks
(`froxel_ref.breaks`), every light is integrated by itself, lamps in the angle at which they see the ray, and
an adaptive Gauss–Kronrod rule (`froxel_ref.quadrature`) works on all intervals at once.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from froxel_ref import blocks
from froxel_ref.billboards import placed_particles
from froxel_ref.bundles import Bundle, Physics, make_bundle, make_physics, through
from froxel_ref.fom_particles import casting as casting_particles
from froxel_ref.optical_depth import Lines, optical_depth
from froxel_ref.quadrature import integrate_pool
from froxel_ref.records import InputError
from froxel_ref.scene import Scene
from froxel_ref.settings import Settings
from froxel_ref.single_scattering import evaluate, first_pool
from froxel_ref.truth_input import (
    SHADOWS,
    TIGHTEST,
    check_limits,
    check_options,
    distances,
    make_lines,
)
from froxel_ref.truth_layers import Layers, padded
from froxel_ref.unseen import split_at_cells
from froxel_ref.veils import Veil, before, make_veil
from froxel_ref.visibility import occluders

if TYPE_CHECKING:
    from froxel_ref.assets import Assets

__all__ = [
    "SHADOWS", "TIGHTEST", "Truth", "check_options", "make_truth_physics", "trace", "trace_depths", "trace_layers",
]

Array: TypeAlias = NDArray[np.floating[Any]]
Progress: TypeAlias = Callable[[int, int], None]

# Rays that are worked on at a time: their first intervals, 15 points each, fill about the cache.
RAYS = 256


class Truth(NamedTuple):
    """What arrives along rays from the media in front of their ends.

    Attributes
    ----------
    radiance : ndarray, shape (3, …) [W m⁻² sr⁻¹]
        Light scattered once, or emitted, by the media.
    transmittance : ndarray, shape (…) or (3, …) [1]
        Of the whole ray; three channels if any medium's extinction is RGB.
    error : ndarray, shape (3, …) [W m⁻² sr⁻¹]
        Estimated absolute error of the radiance.
    converged : ndarray of bool, shape (…)
        Whether the estimate is within the tolerance in every channel.
    evaluations : ndarray of int, shape (…)
        Points at which a light was evaluated.
    """

    radiance: Array
    transmittance: Array
    error: Array
    converged: NDArray[np.bool_]
    evaluations: NDArray[np.intp]


def trace(scene: Scene, origins: ArrayLike, directions: ArrayLike, ends: ArrayLike, *,
          settings: Settings | None = None, assets: Assets | None = None, starts: ArrayLike = 0.0,
          rtol: float = 1e-4, shadows: str = "off", volumetric_shadows: bool = False,
          sun_distance: float = np.inf, sun_media: str = "all", limit_rounds: int = 60, limit_intervals: int = 4000,
          threads: int | None = None, progress: Progress | None = None) -> Truth:
    """Integrate single scattering along rays until the error is a given share of the result.

    Parameters
    ----------
    scene : Scene
        Its media, lights and ambient light. Its surfaces and particles only cast shadows: what a ray crosses of them
        it does not see; transparent surfaces do nothing.
    origins, directions : array_like, shape (3, N) or (3, 1)
        Where rays begin [m], within 1e10 m, and which way they look; scaled to length 1. One column a ray, rows
        x, y and z: a list of three rays, (3, 3), must be transposed, which no check can tell.
    ends : array_like, shape (N,) or () [m]
        Distance along each ray at which it ends; at most 1e14, not below ``starts``.
    settings : Settings, optional
        Its phase function and the switches that change physics: emission, phase_mixing, density_addressing,
        attenuation, ambient, exposure. Integrator, lookup and grid are the frame's alone.
    assets : Assets, optional
        What the scene's files hold; loaded if the scene names none.
    starts : array_like, shape (N,) or () [m]
        Distance at which the integral, and the transmittance, begins.
    rtol : float
        Wanted error as a share of the radiance, in every channel; at least 1e-13.
    shadows : {"off", "exact"}
        Whether opaque surfaces block lights. Ambient light is not blocked.
    volumetric_shadows : bool
        Whether media and particles dim the light of what casts shadows on its way to the ray.
    sun_distance : float [m]
        How far towards directional lights media do; see `froxel_ref.light_paths.light_transmittance`.
    sun_media : {"all", "local"}
        Which media dim directional lights. "local": as in a frame, whose suns are those that arrive through its global
        media.
    limit_rounds, limit_intervals : int
        When to give up on a ray; it is then not ``converged``.
    threads : int, optional
        Default: one per core. The result does not depend on it.
    progress : callable, optional
        Called as ``progress(rays done, rays)``.

    Returns
    -------
    Truth

    Raises
    ------
    InputError
        A tolerance or limit out of range, an unknown word, rays that are not finite, have no direction or do
        not fit together; a texture of which a ray, or its ways to a light, cross more than 20000 cells.

    Notes
    -----
    L = ∫ T(t)·[σ_s·(Σ_l p·V·E_l + L_a) + emission] dt [Dörries 2020, eq. 2.11], T from the ray's start,
    with E_l a directional light's irradiance, or intensity times attenuation (CONVENTIONS.md); multiplied
    by the camera's exposure if the switch exposure is "lighting".

    The estimate is Σ|K₁₅ − G₇| over the intervals, so as a rule far above the real error. To it comes what the
    nodes cannot have seen: columns of textures that the rule gets wrong, light at the ends of intervals, the
    rounding of places. Rays are cut where a light's shadows of particles begin and end
    (`froxel_ref.particle_shadows`).

    Examples
    --------
    >>> from froxel_ref.scene import DirectionalLight, Medium
    >>> sun = DirectionalLight(direction=(0, 1, 0), irradiance=(4, 4, 4))
    >>> fog = Medium(albedo=(1, 1, 1), extinction=0.5)
    >>> truth = trace(Scene(global_media=(fog,), lights=(sun,)), [[0.0]] * 3, [[0.0], [0.0], [-1.0]], [2.0])
    >>> print(truth.radiance[0], (1 - np.exp(-1)) / np.pi)
    [0.20121022] 0.20121022313515236
    """
    if not isinstance(scene, Scene):
        raise InputError("scene", f"is a {type(scene).__name__}, must be a Scene, as froxel_ref.load gives it")
    settings = Settings() if settings is None else settings
    if not isinstance(settings, Settings):
        raise InputError("settings", f"is a {type(settings).__name__}, must be Settings, as froxel_ref.load gives them")
    check_options(rtol, shadows, sun_distance, sun_media)
    check_limits(volumetric_shadows, limit_rounds, limit_intervals, threads)
    lines = make_lines(origins, directions, starts, ends)
    physics = make_truth_physics(scene, settings, assets, shadows, volumetric_shadows, sun_distance, sun_media)
    return trace_layers(physics, lines, None, rtol=rtol, limit_rounds=limit_rounds, limit_intervals=limit_intervals,
                        threads=threads, progress=progress)[0]


def trace_layers(physics: Physics, lines: Lines, layers: Layers | None, *, rtol: float, limit_rounds: int = 60,
                 limit_intervals: int = 4000, threads: int | None = None, progress: Progress | None = None
                 ) -> tuple[Truth, Array, Array]:
    """Integrate single scattering along rays, behind and between what they cross.

    Parameters
    ----------
    physics : Physics
        From `make_truth_physics`.
    lines : Lines
        The rays, n of them, from `froxel_ref.truth_input.make_lines`.
    layers : Layers, optional
        What they cross; what lies before a ray's start has no fog in front of it, what lies behind its end all of it.
    rtol, limit_rounds, limit_intervals, threads, progress
        As for `trace`; the tolerance is a share of the light that arrives through the layers.

    Returns
    -------
    truth : Truth
        Its radiance is dimmed by the layers in front, its transmittance that of the media alone.
    radiance : ndarray, shape (3, n), or (3, 1) without layers [W m⁻² sr⁻¹]
        The layers' own light as it arrives.
    transmittance : ndarray, shape (n,), or (1,) without layers [1]
        What all layers let through.

    Notes
    -----
    Σ_j P_j·α_j·L_j·T(d_j), P_j what the layers in front let through, L_j the layer's light, T the media's
    transmittance [Dörries 2020, §4.3]; see `froxel_ref.veils` for the media's light.

    Examples
    --------
    >>> from froxel_ref.scene import Medium
    >>> from froxel_ref.truth_input import make_lines
    >>> scene = Scene(global_media=(Medium(extinction=1.0, emissive=(1, 1, 1)),))
    >>> pane = Layers(np.array([0, 1]), np.ones(1), np.full(1, 0.5), np.zeros((3, 1)))
    >>> truth, own, through = trace_layers(
    ...     make_truth_physics(scene, Settings(), None, "off", False, np.inf),
    ...     make_lines([[0.0]] * 3, [[0.0], [0.0], [-1.0]], 0.0, 2.0), pane, rtol=1e-6)
    >>> print((truth.radiance[0] + 0.5 * np.exp(-2.0) + 0.5 * np.exp(-1.0)).round(12), through)
    [1.] [0.5]
    """
    scene, settings = physics.scene, physics.settings
    count = lines.stop.size
    wide = physics.extinction.shape[1]
    result = Truth(np.zeros((3, count)), np.ones((wide, count)), np.zeros((3, count)), np.ones(count, bool),
                   np.zeros(count, np.intp))
    own = np.zeros((3, 1 if layers is None else count)), np.ones(1 if layers is None else count)
    done: list[int] = []

    def work(rows: slice) -> None:
        part = Lines._make(field[..., rows] for field in lines)
        if layers is None:
            _trace_block(physics, part, None, result, rows, rtol, limit_rounds, limit_intervals)
        else:
            distance, opacity, light = padded(layers, rows)
            bundle = _trace_block(physics, part, make_veil(distance, opacity), result, rows, rtol, limit_rounds,
                                  limit_intervals)
            passed = before(opacity)
            own[0][:, rows] = (passed[:, :-1] * opacity * light * _fogged(bundle, distance)).sum(axis=-1)
            own[1][rows] = passed[:, -1]
        done.append(part.stop.size)
        if progress is not None:
            progress(sum(done), count)

    blocks.run(work, [slice(i, min(i + RAYS, count)) for i in range(0, count, RAYS)], threads=threads)
    if settings.exposure == "lighting":
        exposure = scene.camera.exposure
        result = result._replace(radiance=result.radiance * exposure, error=result.error * exposure)
    truth = result if wide == 3 else result._replace(transmittance=result.transmittance[0])
    return truth, *own


def _fogged(bundle: Bundle, distance: Array) -> Array:
    """The media's transmittance up to layers, (C, n, K)."""
    return through(bundle, np.minimum(distance, bundle.lines.stop[:, np.newaxis]))


def _trace_block(physics: Physics, lines: Lines, veil: Veil | None, result: Truth, rows: slice, rtol: float,
                 limit_rounds: int, limit_intervals: int) -> Bundle:
    bundle = make_bundle(physics, lines, veil)
    totals = integrate_pool(
        lambda pool: evaluate(bundle, pool), first_pool(bundle), lines.stop.size, rtol=rtol, channels=3,
        split=lambda pool: split_at_cells(bundle, pool), limit_rounds=limit_rounds,
        limit_intervals=limit_intervals)
    result.radiance[:, rows], result.error[:, rows] = totals.value, totals.error
    result.converged[rows], result.evaluations[rows] = totals.converged, totals.evaluations
    with np.errstate(under="ignore"):
        result.transmittance[:, rows] = np.exp(-optical_depth(bundle.paths, physics.extinction, lines.stop))
    return bundle


def make_truth_physics(scene: Scene, settings: Settings, assets: Assets | None, shadows: str,
                       volumetric: bool, sun_distance: float, sun_media: str = "all") -> Physics:
    """What light, media and particles do, made ready once for all rays.

    Parameters
    ----------
    scene, settings, assets, shadows, sun_distance, sun_media
        As for `trace`.
    volumetric : bool
        Its volumetric_shadows.

    Returns
    -------
    Physics

    Examples
    --------
    >>> make_truth_physics(Scene(), Settings(), None, "off", True, np.inf).particles is None
    True
    """
    from froxel_ref.assets import load_assets

    assets = load_assets(scene, None) if assets is None else assets
    casting = occluders([surface for surface in scene.surfaces if surface.casts_shadows], assets
                        ) if shadows == "exact" else ()
    dims = volumetric and any(each.casts for each in scene.all_particles)
    particles = casting_particles(placed_particles(scene, assets)) if dims else None
    return make_physics(scene, settings, assets.textures, casting, volumetric=volumetric,
                        sun_distance=sun_distance, particles=particles, sun_media=sun_media)


def trace_depths(scene: Scene, origins: ArrayLike, directions: ArrayLike, ends: ArrayLike,
                 **options: Any) -> Truth:
    """Integrate single scattering up to several distances along each ray.

    Parameters
    ----------
    scene, origins, directions
        As for `trace`.
    ends : array_like, shape (K, N) [m]
        Distances along each ray, not decreasing along the first axis: a slice's boundaries, say.
    **options
        As for `trace`; the tolerance holds for the stretch between neighbouring distances.

    Returns
    -------
    Truth
        With a leading axis K behind the channel: radiance (3, K, N), transmittance (K, N) or (3, K, N).
        ``evaluations`` are those of each stretch.

    Raises
    ------
    InputError
        As `trace`; distances that decrease.

    Notes
    -----
    Stretches are integrated by themselves and put together front to back, L += T·L', T *= T', so the
    relative error at each distance is at most that of the worst stretch before it.

    Examples
    --------
    >>> from froxel_ref.scene import Medium
    >>> glow = Scene(global_media=(Medium(extinction=1.0, emissive=(1, 1, 1)),))
    >>> truth = trace_depths(glow, [[0.0]] * 3, [[0.0], [0.0], [-1.0]], [[1.0], [2.0]])
    >>> truth.radiance[0, :, 0].round(6).tolist()
    [0.632121, 0.864665]
    """
    stop = distances("ends", ends)
    if stop.ndim != 2 or stop.size == 0:
        raise InputError("ends", f"has shape {stop.shape}, must be (K, N)")
    steps, count = stop.shape
    lines = make_lines(origins, directions, options.pop("starts", 0.0), stop[0])
    if lines.stop.size != count:
        raise InputError("ends", f"has shape {stop.shape}, must be (K, {lines.stop.size}) for {lines.stop.size} rays")
    if not (stop[1:] >= stop[:-1]).all():
        raise InputError("ends", "decreases along its first axis, must not")
    begin = np.concatenate([lines.start[np.newaxis], stop[:-1]])
    rays = [np.tile(field, steps) for field in (lines.origin, lines.direction)]
    parts = trace(scene, rays[0], rays[1], stop.reshape(-1), starts=begin.reshape(-1), **options)
    pieces = Truth._make(field.reshape(*field.shape[:-1], steps, count) for field in parts)
    through = np.cumprod(pieces.transmittance, axis=-2)
    before = np.concatenate([np.ones_like(through[..., :1, :]), through[..., :-1, :]], axis=-2)
    return Truth(np.cumsum(pieces.radiance * before, axis=1), through,
                 np.cumsum(pieces.error * before, axis=1),
                 np.logical_and.accumulate(pieces.converged, axis=0), pieces.evaluations)
