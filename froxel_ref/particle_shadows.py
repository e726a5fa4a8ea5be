"""Shadows that particles cast across rays: where they begin and end, in closed form, and what they leave of a light.

Towards a light a particle is a square that faces it (`froxel_ref.billboards`). What lies in its shadow is a cone
or a pyramid with its point at the lamp, a cylinder or a prism for a sun, behind the square: convex, so a ray has one
stretch of each. Places on the square are a ratio of two functions linear along the ray.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from froxel_ref.billboards import (
    DISC,
    PROFILES,
    SOFT,
    Particles,
    facing,
    facing_axes,
    half_extents,
    opacity_at,
    reaches,
)
from froxel_ref.geometry import Lines
from froxel_ref.lights import unit
from froxel_ref.scene import DirectionalLight, Light, PointLight

__all__ = ["Shadows", "particle_cuts", "particle_shadows", "passing", "shadow_pairs", "shadow_shares"]

Array: TypeAlias = NDArray[np.floating[Any]]
Integers: TypeAlias = NDArray[np.integer[Any]]

EPS = float(np.finfo(np.float64).eps)
ROUNDINGS = 8.0  # in ulp, by which a point must lie behind a particle, as for froxel_ref.billboard_shadows
PAIRS = 1 << 20  # of a ray and a particle that are tried at a time
TOGETHER = 1 << 16  # pairs of an interval and a shadow that are looked at at a time
LINES = 32.0     # through a texture's texels, that a shadow is cut at where the ray's ways cross no more of them
TEXELS = 2.0     # else of the texture that a piece of the shadow crosses, so that a rule's nodes see each


class Shadows(NamedTuple):
    """Shadows of particles across rays, of one light: m pairs of a ray and a particle, ray by ray.

    Attributes
    ----------
    particles : Particles
        Those that cast.
    first : ndarray of int, shape (n + 1,)
        The pairs of ray i are first[i] … first[i + 1] − 1.
    particle : ndarray of int, shape (m,)
    enter, leave : ndarray, shape (m,) [m]
        The stretch of the ray that lies in the shadow.
    x, y, w : ndarray, shape (2, m)
        (x₀ + x₁t)/(w₀ + w₁t) is the place along the square's right axis that the way from a point to the light
        crosses, in half edges, and likewise down.
    """

    particles: Particles
    first: Integers
    particle: Integers
    enter: Array
    leave: Array
    x: Array
    y: Array
    w: Array


class _View(NamedTuple):
    """Particles as a light sees them: its place or the way of its rays, and the squares' axes over half an edge."""

    apex: Array | None
    along: Array
    right: Array
    down: Array
    center: Array
    distance: Array
    reach: Array
    slack: Array


def particle_shadows(particles: Particles, light: Light, lines: Lines, *, size: str = "edge") -> Shadows:
    """Find the shadows of particles across rays.

    Parameters
    ----------
    particles : Particles
        Those that cast.
    light : Light
    lines : Lines
        The rays, n of them, with directions of length 1 and finite stops.
    size : {"edge", "half"}
        As for `froxel_ref.billboards.half_extents` (A9).

    Returns
    -------
    Shadows

    Notes
    -----
    The ways from a ray to a light lie in one plane, so only particles that this plane meets are looked at: one
    product for each ray and particle, all else for the few that are left. A particle centred at the lamp casts
    nothing, and one out of the reach of a lamp with a window nothing that counts.

    Examples
    --------
    >>> from froxel_ref.assets import load_assets
    >>> from froxel_ref.billboards import placed_particles
    >>> from froxel_ref.scene import Particle, Scene
    >>> scene = Scene(particles=(Particle(position=(0, 2, -5), size=2, opacity=0.75, profile="square"),))
    >>> sun = DirectionalLight(direction=(0, 1, 0), irradiance=(1, 1, 1))
    >>> ray = Lines(np.zeros((3, 1)), np.array([[0.0], [0.0], [-1.0]]), np.zeros(1), np.array([9.0]))
    >>> found = particle_shadows(placed_particles(scene, load_assets(scene, None)), sun, ray)
    >>> found.enter.tolist(), found.leave.tolist()
    ([4.0], [6.0])
    >>> passing(found, np.array([0, 0]), np.array([[1.0, 2.0], [4.5, 5.5]])).tolist()
    [[1.0, 1.0], [0.25, 0.25]]
    """
    view = _view(particles, light, size)
    parts = [_crossed(particles, view, lines, ray, particle) for ray, particle in _candidates(view, light, lines)]
    ray, particle, enter, leave = (np.concatenate([part[i] for part in parts]) for i in range(4)
                                   ) if parts else (np.zeros(0, np.intp), np.zeros(0, np.intp), *np.zeros((2, 0)))
    x, y, w = (np.concatenate([part[i] for part in parts], axis=1) if parts else np.zeros((2, 0)) for i in (4, 5, 6))
    order = np.lexsort((particle, ray))
    first = np.searchsorted(ray[order], np.arange(lines.start.size + 1))
    return Shadows(particles, first, particle[order], enter[order], leave[order],
                   x[:, order], y[:, order], w[:, order])


def _view(particles: Particles, light: Light, size: str) -> _View:
    position = particles.position.astype(np.float64)
    reach = reaches(particles, size=size).astype(np.float64)
    if isinstance(light, DirectionalLight):
        along = np.broadcast_to(-np.reshape(unit(light.direction), (3, 1)), position.shape)
        half = half_extents(particles, size=size).astype(np.float64)
        right, down = facing_axes(along, particles.turn.astype(np.float64))
        slack = ROUNDINGS * EPS * 2.0 * np.abs(position).max(axis=0, initial=0.0)
        return _View(None, along, right / half, down / half, position, np.zeros_like(half), reach, slack)
    apex: Array = np.asarray(light.position, np.float64)
    square = facing(particles, light.position, size=size)
    scale = square.distance / square.half
    slack = ROUNDINGS * EPS * (np.abs(position).max(axis=0, initial=np.abs(apex).max()) + square.distance)
    return _View(apex, square.along, square.right * scale, square.down * scale, position, square.distance, reach,
                 slack)


def _candidates(view: _View, light: Light, lines: Lines) -> Iterator[tuple[Integers, Integers]]:
    """Pairs of a ray and a particle that the plane of the ray and the light meets."""
    usable = view.distance > 0.0 if isinstance(light, PointLight) else np.ones(view.distance.shape, bool)
    if isinstance(light, PointLight) and light.falloff == "windowed":
        usable &= view.distance < light.radius
    some = np.flatnonzero(usable)
    if view.apex is None:
        normal: Array = np.cross(lines.direction, view.along[:, :1], axis=0)
        offset: Array = (normal * lines.origin).sum(axis=0)
        size: Array = np.abs(lines.origin).max(axis=0)
    else:
        normal = np.cross(lines.origin - view.apex[:, np.newaxis], lines.direction, axis=0)
        offset = normal.T @ view.apex
        size = np.abs(view.apex).max() + np.abs(lines.origin).max(axis=0)
    length = np.sqrt((normal * normal).sum(axis=0))
    slack = 64.0 * EPS * (length + (1.0 if view.apex is None else size)) * size
    step = max(1, PAIRS // max(1, lines.start.size))
    for begin in range(0, some.size, step):
        part = some[begin:begin + step]
        center = view.center[:, part]
        away = np.abs(normal.T @ center - offset[:, np.newaxis])
        rounding = 64.0 * EPS * np.abs(center).max(axis=0)
        bound = length[:, np.newaxis] * (view.reach[part] + rounding) * (1.0 + 64.0 * EPS) + slack[:, np.newaxis]
        ray, which = np.nonzero(away <= bound)
        if ray.size:
            yield ray, part[which]


def _crossed(particles: Particles, view: _View, lines: Lines, ray: Integers, particle: Integers
             ) -> tuple[Integers, Integers, Array, Array, Array, Array, Array]:
    """Of pairs those in which the ray crosses the shadow: ray, particle, enter, leave, x, y and w."""
    along, right, down = (axes[:, particle] for axes in (view.along, view.right, view.down))
    direction = lines.direction[:, ray]
    # From the lamp, or from the particle's centre.
    q = lines.origin[:, ray] - (view.center[:, particle] if view.apex is None else view.apex[:, np.newaxis])

    def linear(axis: Array) -> Array:
        return np.stack([(q * axis).sum(axis=0), (direction * axis).sum(axis=0)])

    x, y, behind = linear(right), linear(down), linear(along)
    w = behind if view.apex is not None else np.stack([np.ones(ray.size), np.zeros(ray.size)])
    behind = np.stack([behind[0] - view.distance[particle] - view.slack[particle], behind[1]])
    low, high = lines.start[ray], lines.stop[ray]
    is_round = (particles.profile[particle] == DISC) | (particles.profile[particle] == SOFT)
    for side in (behind, w - x, w + x, w - y, w + y):
        low, high = _clipped(side, low, high)
    some = np.flatnonzero(is_round & (high > low))
    low[some], high[some] = _in_circle(x[:, some], y[:, some], w[:, some], low[some], high[some])
    on = np.flatnonzero(high > low)
    return ray[on], particle[on], low[on], high[on], x[:, on], y[:, on], w[:, on]


def _clipped(side: Array, low: Array, high: Array) -> tuple[Array, Array]:
    """Where a linear function is not below 0; low > high where nowhere."""
    value, slope = side
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        root = -value / slope
    low = np.where(slope > 0.0, np.maximum(low, root), low)
    high = np.where(slope < 0.0, np.minimum(high, root), high)
    return low, np.where((slope == 0.0) & (value < 0.0), -np.inf, high)


def _in_circle(x: Array, y: Array, w: Array, low: Array, high: Array) -> tuple[Array, Array]:
    """Where x² + y² ≤ w² within [low, high], w > 0 there: one stretch, for a cone is convex."""
    a = x[1] * x[1] + y[1] * y[1] - w[1] * w[1]
    b = x[0] * x[1] + y[0] * y[1] - w[0] * w[1]
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        # About the vertex, so that digits are not lost in the discriminant.
        vertex = np.minimum(np.maximum(np.where(a != 0.0, -b / a, 0.0), low), high)
        vertex = np.where(np.isfinite(vertex), vertex, 0.0)
        u, v, z = (axis[0] + axis[1] * vertex for axis in (x, y, w))
        b, c = u * x[1] + v * y[1] - z * w[1], u * u + v * v - z * z
        root = np.sqrt(b * b - a * c)
        q = -(b + np.copysign(root, b))
        roots = [vertex + q / a, vertex + c / q]
    places = [low, *(np.minimum(np.maximum(np.where(np.isfinite(t), t, low), low), high) for t in roots), high]
    ends = np.sort(np.stack(places), axis=0)
    middle = 0.5 * (ends[1:] + ends[:-1])
    with np.errstate(invalid="ignore", over="ignore"):
        inside = (_at(x, middle) ** 2 + _at(y, middle) ** 2 <= _at(w, middle) ** 2) & (ends[1:] > ends[:-1])
    return np.where(inside, ends[:-1], np.inf).min(axis=0), np.where(inside, ends[1:], -np.inf).max(axis=0)


def _at(axis: Array, t: Array) -> Array:
    return np.asarray(axis[0] + axis[1] * t)


# --- cuts -------------------------------------------------------------------------------------------


def particle_cuts(shadows: Shadows) -> Array:
    """Cuts [m] where what particles leave of a light breaks along rays.

    Parameters
    ----------
    shadows : Shadows
        Of n rays.

    Returns
    -------
    ndarray, shape (n, M)
        NaN where a ray has no more: every end of a shadow, and between them, of a particle with a texture, the lines
        through its texels at which it has kinks; or pieces of two texels, where these would be many.

    Examples
    --------
    >>> from froxel_ref.assets import load_assets
    >>> from froxel_ref.billboards import placed_particles
    >>> from froxel_ref.scene import Particle, Scene
    >>> pair = tuple(Particle(position=(0, 2, z), size=2, profile="disc") for z in (-3, -4))
    >>> sun = DirectionalLight(direction=(0, 1, 0), irradiance=(1, 1, 1))
    >>> ray = Lines(np.zeros((3, 1)), np.array([[0.0], [0.0], [-1.0]]), np.zeros(1), np.array([9.0]))
    >>> ready = placed_particles(Scene(particles=pair), load_assets(Scene(), None))
    >>> particle_cuts(particle_shadows(ready, sun, ray)).round(12).tolist()
    [[2.0, 3.0, 4.0, 5.0]]
    """
    count = np.diff(shadows.first)
    ray = np.repeat(np.arange(len(count)), count)
    parts = [(ray, shadows.enter), (ray, shadows.leave), *_texture_cuts(shadows, ray)]
    row, cut = np.concatenate([part[0] for part in parts]), np.concatenate([part[1] for part in parts])
    order = np.argsort(row, kind="stable")
    row, cut = row[order], cut[order]
    place = np.arange(row.size) - np.searchsorted(row, row)
    result = np.full((len(count), int(place.max(initial=-1)) + 1), np.nan)
    result[row, place] = cut
    return result


def _texture_cuts(shadows: Shadows, ray: Integers) -> Iterator[tuple[Integers, Array]]:
    """Where a ray's ways cross the lines through a texture's texels; of too many of them, even steps over it."""
    profile = shadows.particles.profile[shadows.particle]
    for i, texture in enumerate(shadows.particles.textures):
        some = np.flatnonzero(profile == len(PROFILES) + i)
        if not some.size:
            continue
        sweeps = [_sweep(shadows, axis, some, texels) for axis, texels in (
            (shadows.x, texture.shape[1]), (shadows.y, texture.shape[0]))]
        swept = [np.abs(last - first) for first, last in sweeps]
        few = swept[0] + swept[1] <= LINES
        for axis, texels, (first, last), wider in ((shadows.x, texture.shape[1], sweeps[0], swept[0] >= swept[1]),
                                                   (shadows.y, texture.shape[0], sweeps[1], swept[0] < swept[1])):
            low, high = np.minimum(first, last), np.maximum(first, last)
            # Lines through texels' centres lie at whole numbers and a half.
            lines = np.maximum(np.floor(high - 0.5) - np.ceil(low - 0.5) + 1.0, 0.0)
            steps = np.maximum(np.ceil((high - low) / TEXELS) - 1.0, 0.0)
            count = np.where(few, lines, np.where(wider, steps, 0.0)).astype(np.intp)
            which = np.repeat(np.arange(some.size), count)
            number = np.arange(which.size) - np.searchsorted(which, which)
            even = low[which] + (high - low)[which] * ((number + 1) / (count[which] + 1))
            place = np.where(few[which], np.ceil(low[which] - 0.5) + 0.5 + number, even)
            yield ray[some[which]], _crossing(shadows, axis, some[which], place * (2.0 / texels) - 1.0)


def _sweep(shadows: Shadows, axis: Array, some: Integers, texels: int) -> tuple[Array, Array]:
    """Where on a texture, in texels along an axis, shadows are entered and left."""
    ends = np.stack([shadows.enter[some], shadows.leave[some]])
    u = (axis[0, some] + axis[1, some] * ends) / (shadows.w[0, some] + shadows.w[1, some] * ends)
    first, last = np.clip((u + 1.0) * (0.5 * texels), 0.0, texels)
    return first, last


def _crossing(shadows: Shadows, axis: Array, some: Integers, u: Array) -> Array:
    """Where rays' ways cross places along an axis, in half edges; NaN where never."""
    with np.errstate(divide="ignore", invalid="ignore"):
        t = (u * shadows.w[0, some] - axis[0, some]) / (axis[1, some] - u * shadows.w[1, some])
    return np.where(np.isfinite(t), t, np.nan)


# --- what passes ------------------------------------------------------------------------------------


def shadow_pairs(shadows: Shadows, rows: Integers, low: Array, high: Array) -> tuple[Integers, Integers]:
    """Which shadows stretches of rays meet.

    Parameters
    ----------
    shadows : Shadows
    rows : ndarray of int, shape (k,)
        The stretches' rays.
    low, high : ndarray, shape (k,) [m]

    Returns
    -------
    stretch, shadow : ndarray of int, shape (p,)
        Growing in the stretch.
    """
    begin, count = shadows.first[rows], shadows.first[rows + 1] - shadows.first[rows]
    stretch = np.repeat(np.arange(len(rows)), count)
    ends = np.cumsum(count)
    shadow = np.arange(ends[-1] if len(ends) else 0) - np.repeat(ends - count - begin, count)
    met = (shadows.enter[shadow] < high[stretch]) & (shadows.leave[shadow] > low[stretch])
    return stretch[met], shadow[met]


def shadow_shares(shadows: Shadows, shadow: Integers, t: Array) -> Array:
    """What single shadows leave of the light at points.

    Parameters
    ----------
    shadows : Shadows
    shadow : ndarray of int, shape (p,)
    t : ndarray, shape (p, m) [m]

    Returns
    -------
    ndarray, shape (p, m) [1]
        (1 − α)^multiplier within the shadow, else 1.
    """
    particles, particle = shadows.particles, shadows.particle[shadow]

    def along(axis: Array) -> Array:
        return np.asarray(axis[0, shadow, np.newaxis] + axis[1, shadow, np.newaxis] * t)

    inside = (t >= shadows.enter[shadow, np.newaxis]) & (t <= shadows.leave[shadow, np.newaxis])
    w = np.where(inside, along(shadows.w), 1.0)
    x, y = (np.where(inside, along(axis) / w, 2.0).reshape(-1) for axis in (shadows.x, shadows.y))
    opacity = opacity_at(particles, np.repeat(particle, t.shape[1]), x, y).reshape(t.shape)
    multiplier = particles.multiplier[particle][:, np.newaxis]
    return np.asarray(1.0 - opacity if (multiplier == 1.0).all() else (1.0 - opacity) ** multiplier)


def passing(shadows: Shadows, rows: Integers, t: Array) -> Array:
    """What the particles let through of a light on its way to points of rays.

    Parameters
    ----------
    shadows : Shadows
    rows : ndarray of int, shape (k,)
        The points' rays.
    t : ndarray, shape (k, m) [m]
        Where on them.

    Returns
    -------
    ndarray, shape (k, m) [1]
        As `froxel_ref.billboard_shadows.points_transmittance` has it, but for rounding: the product of what each
        shadow leaves.
    """
    result = np.ones(t.shape)
    if not shadows.particle.size or not t.size:
        return result
    # Some rows at a time, so that memory stays bounded however many shadows a ray crosses.
    most = np.cumsum(shadows.first[rows + 1] - shadows.first[rows])
    ends = np.flatnonzero(np.diff(most // TOGETHER, append=-1)) + 1
    for begin, end in pairwise([0, *ends.tolist()]):
        some = slice(begin, end)
        stretch, shadow = shadow_pairs(shadows, rows[some], t[some].min(axis=1), t[some].max(axis=1))
        if stretch.size:
            starts = np.flatnonzero(np.diff(stretch, prepend=-1))
            shares = shadow_shares(shadows, shadow, t[some][stretch])
            result[begin + stretch[starts]] = np.multiply.reduceat(shares, starts, axis=0)
    return result
