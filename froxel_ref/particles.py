"""Billboard particles in the image: lit, fogged at their own depth, and laid over one another from back to front.

Particles face the camera here; towards lights they face the light (`froxel_ref.billboard_shadows`).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from froxel_ref.arrays import Field, FogAt, Points, Visibility
from froxel_ref.billboards import Facing, Particles, facing, opacity_at, reaches
from froxel_ref.geometry import Rays, crop_rays, dot, ray_bounds, ray_points, view_from_world
from froxel_ref.lights import colour, light_at, seen
from froxel_ref.phase import henyey_greenstein, versine
from froxel_ref.records import InputError, shown
from froxel_ref.scene import Camera, Light, PointLight, Rgb

__all__ = [
    "LIT_AT", "Fragments", "LightOn", "ParticleLayer", "draw_order", "fragment_points", "fragments", "particle_layers",
    "render_particles", "scattered_light",
]

Integers: TypeAlias = NDArray[np.intp]

LightOn: TypeAlias = Callable[[Points, Integers], Field]
"""Given points (m,) and the particle that each is on, the radiance (3, m) that it sends to the camera where opaque."""

LIT_AT = ("pixel", "centre")

# Fragments that are lit at a time: some dozen arrays of them stay near the cache, and each light costs some 60 calls.
BLOCK = 32768
# Pairs of a light and a particle that are tried at a time.
PAIRS = 1 << 20
# Rounding of places that the reach of a light allows for, in ulp of float32 of the farthest one.
ROUNDINGS = 64.0


class ParticleLayer(NamedTuple):
    """What all particles together do to an image: below·transmittance + radiance.

    Attributes
    ----------
    radiance : ndarray, shape (3, h, w), or (3, 1, 1) without particles
        [W m⁻² sr⁻¹] Their own light and that of the fog in front of them, times their opacity.
    transmittance : ndarray, shape (h, w), or (1, 1) without particles
        [1] The share of what lies behind them, its fog included, that passes.
    """

    radiance: Field
    transmittance: Field


class Fragments(NamedTuple):
    """Points of particles that pixels show, each (m,), particle by particle from back to front."""

    particle: Integers
    row: Integers
    column: Integers
    depth: Field
    opacity: Field


def draw_order(particles: Particles, camera: Camera) -> Integers:
    """The particles from back to front.

    Parameters
    ----------
    particles : Particles
    camera : Camera

    Returns
    -------
    ndarray of int, shape (n,)
        By falling view depth of the centres; of equal ones the first in the scene comes first, and lies below.

    Examples
    --------
    >>> from froxel_ref.assets import load_assets
    >>> from froxel_ref.billboards import placed_particles
    >>> from froxel_ref.scene import Particle, Scene
    >>> scene = Scene(particles=tuple(Particle(position=(0, 0, z)) for z in (-1, -3, -2, -3)))
    >>> draw_order(placed_particles(scene, load_assets(scene, None)), Camera()).tolist()
    [1, 3, 2, 0]
    """
    return np.argsort(-_view_depth(particles, camera), kind="stable")


def _view_depth(particles: Particles, camera: Camera) -> NDArray[np.float64]:
    row = view_from_world(camera)[2]
    x, y, z = particles.position.astype(np.float64)
    return np.asarray(-(row[0] * x + row[1] * y + row[2] * z + row[3]))


def render_particles(particles: Particles, camera: Camera, rays: Rays, depth_image: Field, light_on: LightOn,
                     fog_at: FogAt, *, lit_at: str = "pixel", size: str = "edge") -> ParticleLayer:
    """Draw the particles over an image.

    Parameters
    ----------
    particles : Particles
    camera : Camera
        Gives the view depths by which they are sorted.
    rays : Rays
        Through the pixels, shape (h, w), from the camera's position.
    depth_image : ndarray, shape (h, w) [m]
        View depth of the opaque surfaces, ∞ where there are none.
    light_on : callable
        See `LightOn`; `scattered_light` makes one.
    fog_at : callable
        See `froxel_ref.arrays.FogAt`; `froxel_ref.apply.fog_lookup` makes one.
    lit_at : {"pixel", "centre"}
        Where particles are lit: at every point that a pixel shows, or at their centres.
    size : {"edge", "half"}
        As for `froxel_ref.billboards.half_extents` (A9).

    Returns
    -------
    ParticleLayer
        In the dtype of the rays.

    Raises
    ------
    InputError
        Unknown word.

    Notes
    -----
    A pixel's ray meets the square, which lies across the direction from the camera to the centre, at one view
    depth z; if z is nearer than the surface, strictly, what lies behind is multiplied by 1 − α there, and
    α·(L·T(z) + F(z)) is added, L the particle's light, T and F the fog's transmittance and light up to z
    [Dörries 2020, §4.3]. Squares that cut each other are not cut: each lies before or behind the other as a whole.
    A particle at the camera's place faces nowhere, and is left out.

    Only the pixels under a particle are touched, those in the rectangle around its square.

    Examples
    --------
    >>> from froxel_ref.assets import load_assets
    >>> from froxel_ref.billboards import placed_particles
    >>> from froxel_ref.geometry import camera_rays
    >>> from froxel_ref.scene import Particle, Scene
    >>> scene = Scene(particles=(Particle(position=(0, 1.7, -2), opacity=0.25, profile="square"),))
    >>> ready, camera = placed_particles(scene, load_assets(scene, None)), Camera(width=3, height=3)
    >>> layer = render_particles(
    ...     ready, camera, camera_rays(camera, 3, 3), np.full((3, 3), np.inf),
    ...     lambda points, index: np.full((3, len(index)), 8.0),
    ...     lambda rows, columns, depth: (np.zeros((3, 1)), np.ones(1)))
    >>> layer.radiance[0].tolist()
    [[0.0, 0.0, 0.0], [0.0, 2.0, 0.0], [0.0, 0.0, 0.0]]
    >>> float(layer.transmittance[1, 1])
    0.75
    """
    return particle_layers(particles, camera, rays, depth_image, (), light_on, fog_at, lit_at=lit_at, size=size)[0]


def particle_layers(particles: Particles, camera: Camera, rays: Rays, depth_image: Field, panes: Sequence[Field],
                    light_on: LightOn, fog_at: FogAt, *, lit_at: str = "pixel", size: str = "edge"
                    ) -> list[ParticleLayer]:
    """Draw the particles in layers, for what lies between them.

    Parameters
    ----------
    particles, camera, rays, depth_image, light_on, fog_at, lit_at, size
        As for `render_particles`.
    panes : sequence of ndarray, shape (h, w) [m]
        View depths of k transparent surfaces at each pixel, ∞ where there are none.

    Returns
    -------
    list of ParticleLayer
        k + 1 of them. In layer i each pixel has the points of particles that i of the panes lie before, or as near
        as: first what lies before all of them.

    Raises
    ------
    InputError
        Unknown word.

    Notes
    -----
    A pane cuts a particle as a surface does, pixel by pixel. Each point is lit and fogged once, in whichever layer.

    Examples
    --------
    >>> from froxel_ref.assets import load_assets
    >>> from froxel_ref.billboards import placed_particles
    >>> from froxel_ref.geometry import camera_rays
    >>> from froxel_ref.scene import Particle, Scene
    >>> pair = tuple(Particle(position=(0, 1.7, z), opacity=0.25) for z in (-1, -3))
    >>> scene = Scene(particles=pair)
    >>> layers = particle_layers(
    ...     placed_particles(scene, load_assets(scene, None)), scene.camera, camera_rays(scene.camera, 1, 1),
    ...     np.full((1, 1), np.inf), [np.full((1, 1), 2.0)], lambda points, index: np.full((3, len(index)), 8.0),
    ...     lambda rows, columns, depth: (np.zeros((3, 1)), np.ones(1)))
    >>> [layer.transmittance.tolist() for layer in layers]
    [[[0.75]], [[0.75]]]
    """
    if lit_at not in LIT_AT:
        raise InputError("lit_at", f"is {shown(lit_at)}, must be one of {', '.join(LIT_AT)}")
    dtype, shape = rays.length.dtype, rays.length.shape
    pixels, count = shape[0] * shape[1], len(panes) + 1
    radiance, through = np.zeros((3, count * pixels), dtype), np.ones(count * pixels, dtype)
    central, drawn = None, False
    if lit_at == "centre" and len(particles.size):
        x, y, z = particles.position.astype(dtype)
        central = light_on((x, y, z), np.arange(len(x)))
    for some in fragments(particles, camera, rays, depth_image, size=size):
        light = light_on(fragment_points(rays, some), some.particle) if central is None else central[:, some.particle]
        glow, passed = fog_at(some.row, some.column, some.depth)
        place = some.row * shape[1] + some.column
        for pane in panes:
            place += pixels * (pane[some.row, some.column] <= some.depth)
        _lay(radiance, through, some, place, some.opacity * (light * passed + glow))
        drawn = True
    if not drawn:
        return [ParticleLayer(np.zeros((3, 1, 1), dtype), np.ones((1, 1), dtype))] * count
    return [ParticleLayer(radiance.reshape(3, count, *shape)[:, i], through.reshape(count, *shape)[i])
            for i in range(count)]


def fragments(particles: Particles, camera: Camera, rays: Rays, depth_image: Field, *, size: str = "edge"
              ) -> Iterator[Fragments]:
    """The points of particles that pixels show, from back to front, of several particles at a time.

    Parameters
    ----------
    particles, camera, rays, depth_image, size
        As for `render_particles`.

    Yields
    ------
    Fragments
        No particle in two of them.

    Examples
    --------
    >>> from froxel_ref.assets import load_assets
    >>> from froxel_ref.billboards import placed_particles
    >>> from froxel_ref.geometry import camera_rays
    >>> from froxel_ref.scene import Particle, Scene
    >>> scene = Scene(particles=tuple(Particle(position=(0, 1.7, z)) for z in (-1, -3)))
    >>> ready, rays = placed_particles(scene, load_assets(scene, None)), camera_rays(scene.camera, 1, 1)
    >>> some = next(fragments(ready, scene.camera, rays, np.full((1, 1), np.inf)))
    >>> some.particle.tolist(), some.depth.tolist(), fragment_points(rays, some)[2].tolist()
    ([1, 0], [3.0, 1.0], [-3.0, -1.0])
    """
    squares, order = facing(particles, rays.origin, size=size), draw_order(particles, camera)
    before = _view_depth(particles, camera) + reaches(particles, size=size) > 0.0
    visible = order[(before & (squares.distance > 0.0) & (particles.opacity > 0.0))[order]]
    waiting: list[Fragments] = []
    count = 0
    for i in visible.tolist():
        found = _fragments(particles, squares, i, rays, depth_image)
        if len(found.row):
            waiting.append(found)
            count += len(found.row)
        if count >= BLOCK:
            yield _joined(waiting)
            waiting, count = [], 0
    if waiting:
        yield _joined(waiting)


def _joined(parts: list[Fragments]) -> Fragments:
    particle, row, column = (np.concatenate([part[i] for part in parts]) for i in (0, 1, 2))
    depth, opacity = (np.concatenate([part[i] for part in parts]) for i in (3, 4))
    return Fragments(particle, row, column, depth, opacity)


def _fragments(particles: Particles, squares: Facing, i: int, rays: Rays, depth_image: Field) -> Fragments:
    """One particle's, row by row."""
    dtype, half = rays.length.dtype, squares.half[i]
    across, below = squares.right[:, i] * half, squares.down[:, i] * half
    center = particles.position[:, i].astype(np.float64)
    rows, columns = ray_bounds(rays, center + np.stack([across + below, across - below, below - across,
                                                        -across - below]))
    ways = crop_rays(rays, rows, columns).per_depth
    slope = _along(ways, squares.along[:, i], dtype)
    faced = slope > 0.0
    safe = np.where(faced, slope, 1.0)
    per_half = squares.distance[i] / half
    with np.errstate(over="ignore"):  # along a square that is nearer than it is large
        depth = np.asarray(squares.distance[i], dtype) / safe
        x = np.where(faced, _along(ways, squares.right[:, i] * per_half, dtype) / safe, np.inf)
        y = _along(ways, squares.down[:, i] * per_half, dtype) / safe
    shown_at = (np.abs(x) <= 1.0) & (np.abs(y) <= 1.0) & (depth < depth_image[rows, columns])
    row, column = np.nonzero(shown_at)
    opacity = opacity_at(particles, np.full(len(row), i), x[row, column], y[row, column])
    on = opacity > 0.0
    row, column = row[on], column[on]
    return Fragments(np.full(len(row), i), row + rows.start, column + columns.start, depth[row, column], opacity[on])


def _along(ways: Points, axis: Field, dtype: np.dtype[np.floating]) -> Field:
    a, b, c = axis.astype(dtype)
    return dot(ways, (a, b, c))


def fragment_points(rays: Rays, some: Fragments) -> Points:
    """Where fragments are [m], three arrays (m,); of the rays that they were found with."""
    x, y, z = (part[some.row if part.shape[0] > 1 else 0, some.column if part.shape[1] > 1 else 0]
               for part in rays.per_depth)
    return ray_points(Rays(rays.origin, (x, y, z), rays.length), some.depth)


def _lay(radiance: Field, through: Field, some: Fragments, place: Integers, added: Field) -> None:
    """Lay particles over what is there; places of one particle differ, so each is laid in one go."""
    keep = 1.0 - some.opacity
    ends = np.flatnonzero(np.diff(some.particle, append=-1)) + 1
    start = 0
    for stop in ends.tolist():
        part = slice(start, stop)
        at = place[part]
        for plane, light in zip(radiance, added, strict=True):
            plane[at] = plane[at] * keep[part] + light[part]
        through[at] *= keep[part]
        start = stop


# --- light ------------------------------------------------------------------------------------------


def scattered_light(particles: Particles, lights: Sequence[Light], viewer: tuple[float, float, float], *,
                    ambient: Rgb = (0.0, 0.0, 0.0), visibility: Visibility | None = None,
                    attenuation: str = "min_distance", size: str = "edge", restrict: bool = True) -> LightOn:
    """Make a function that lights particles by single scattering.

    Parameters
    ----------
    particles : Particles
    lights : sequence of Light
        The scene's, in its order.
    viewer : (float, float, float) [m]
        The camera's position.
    ambient : (float, float, float) [W m⁻² sr⁻¹]
        Radiance that arrives alike from all directions.
    visibility : mapping of int to callable, optional
        For lights that something may hide, by their place in ``lights``: given points, the share that arrives.
    attenuation : {"min_distance", "inverse_radius"}
        Lower bound of the distance (A6), see `froxel_ref.lights`.
    size : {"edge", "half"}
        As for `froxel_ref.billboards.half_extents` (A9).
    restrict : bool
        Light with a lamp only the particles within its radius. The result is the same without.

    Returns
    -------
    callable
        See `LightOn`.

    Raises
    ------
    InputError
        Unknown word; of ``attenuation`` when it is called.

    Notes
    -----
    albedo·(Σ_l p(cos θ)·E_l·visibility + ambient), p the phase function of Henyey and Greenstein with the
    particle's g: what an opaque cloud of such scatterers would send if light were scattered once and none of it
    were lost inside. Lights are summed in their order. Work grows with the pairs of a light and a point that it
    reaches.

    Examples
    --------
    >>> from froxel_ref.assets import load_assets
    >>> from froxel_ref.billboards import placed_particles
    >>> from froxel_ref.scene import DirectionalLight, Particle, Scene
    >>> sun = DirectionalLight(direction=(0, 1, 0), irradiance=(4 * np.pi, 0, 0))
    >>> scene = Scene(particles=(Particle(position=(0, 0, -1), albedo=(0.5, 1, 1)),))
    >>> light_on = scattered_light(placed_particles(scene, load_assets(scene, None)), [sun], (0, 0, 0),
    ...                            ambient=(0, 0, 0.25))
    >>> light_on((np.zeros(1), np.zeros(1), -np.ones(1)), np.array([0])).round(12).ravel().tolist()
    [0.5, 0.0, 0.25]
    """
    hidden = visibility or {}
    reached = _reached(particles, lights, size) if restrict else [np.ones(len(particles.size), np.bool_)] * len(lights)
    tints = [colour(light).tolist() for light in lights]

    def light_on(points: Points, index: Integers) -> Field:
        dtype = np.result_type(*points)
        total = np.zeros((3, len(index)), dtype)
        for number, (light, near) in enumerate(zip(lights, reached, strict=True)):
            if not near.any() or not any(tints[number]):
                continue
            chosen = slice(None) if near.all() else np.flatnonzero(near[index])
            x, y, z = (p[chosen] for p in points)
            if len(x):
                towards, factor = light_at(light, (x, y, z), attenuation=attenuation)
                if number in hidden:
                    factor = seen(factor, hidden[number], (x, y, z))
                factor = factor * _phase((x, y, z), viewer, towards, particles.anisotropy[index[chosen]])
                for plane, tint in zip(total, tints[number], strict=True):
                    plane[chosen] += factor * tint
        albedo = particles.albedo.astype(dtype)[:, index]
        return np.asarray((total + np.asarray(ambient, dtype)[:, np.newaxis]) * albedo)

    return light_on


def _reached(particles: Particles, lights: Sequence[Light], size: str) -> list[NDArray[np.bool_]]:
    """For each light the particles that its sphere meets."""
    count = len(particles.size)
    result = [np.ones(count, np.bool_)] * len(lights)
    bounded = [i for i, light in enumerate(lights) if isinstance(light, PointLight) and light.falloff == "windowed"]
    position, reach = particles.position.astype(np.float64), reaches(particles, size=size).astype(np.float64)
    slack = ROUNDINGS * float(np.finfo(np.float32).eps) * (np.abs(position).max(axis=0) + reach)
    step = max(1, PAIRS // max(1, count))
    for begin in range(0, len(bounded), step):
        some = bounded[begin:begin + step]
        lamps = [lights[i] for i in some]
        center = np.array([lamp.position for lamp in lamps if isinstance(lamp, PointLight)])
        radius = np.array([lamp.radius for lamp in lamps if isinstance(lamp, PointLight)])[:, np.newaxis]
        far = radius * (1.0 + ROUNDINGS * float(np.finfo(np.float32).eps)) + reach + slack
        gap = center[:, :, np.newaxis] - position
        for i, near in zip(some, (gap * gap).sum(axis=1) <= far * far, strict=True):
            result[i] = near
    return result


def _phase(points: Points, viewer: tuple[float, float, float], towards: Points, g: Field) -> Field:
    """Of light from a direction that leaves to the viewer [sr⁻¹]."""
    x, y, z = (v - p for v, p in zip(viewer, points, strict=True))
    # A point at the viewer's own place has no direction to it; any finite one will do.
    length = np.maximum(np.sqrt(x * x + y * y + z * z), np.finfo(x.dtype).tiny)
    x, y, z = x / length, y / length, z / length
    away = versine((x, y, z), towards)
    return henyey_greenstein(1.0 - away, g, versine=away,
                             mirrored_versine=versine((-x, -y, -z), towards) if np.any(g < 0.0) else None)
