"""What particles take from lights: where rays of a light cross them, and what they let through to points.

Towards a light particles are billboards that face it (`froxel_ref.billboards`). Rays and points are many: only
those near a particle are tried (`froxel_ref.near_pairs`).
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from froxel_ref.arrays import Field, Points
from froxel_ref.billboards import Particles, facing, facing_axes, half_extents, opacity_at, reaches
from froxel_ref.lights import unit
from froxel_ref.near_pairs import pairs_within
from froxel_ref.records import InputError, shown
from froxel_ref.scene import DirectionalLight, Light

__all__ = ["DEPTHS", "Crossings", "lamp_hits", "points_transmittance", "sun_hits"]

Integers: TypeAlias = NDArray[np.intp]
Vec3: TypeAlias = tuple[float, float, float]

DEPTHS = ("hit", "centre")

# What optical depths are cut at unless told otherwise: e to the minus this is a normal number of the type.
LARGEST = {4: 80.0, 8: 700.0}
# Points that are looked at at a time.
BLOCK = 1 << 17
# Roundings, in ulp, by which a way has to end behind what dims it: so a particle's centre is not in its own shadow.
ROUNDINGS = 8.0


class Crossings(NamedTuple):
    """Where rays cross particles, ordered by ray and then by particle.

    Attributes
    ----------
    ray, particle : ndarray of int, shape (m,)
        Which ray crosses which particle; every pair once.
    distance : ndarray, shape (m,) [m]
        Along the ray.
    tau : ndarray, shape (m,) [1]
        Optical depth that the particle casts there, above 0.
    """

    ray: Integers
    particle: Integers
    distance: Field
    tau: Field


# --- rays of lights ---------------------------------------------------------------------------------


class _View(NamedTuple):
    """Particles as a light sees them: depths along its rays, and the axes of their squares, to tell places on them.

    ``place`` and ``reach`` bound what they cover: of unit directions for a lamp, in the plane across a sun's rays.
    ``slack`` is by how much a way must end behind a particle to be dimmed by it.
    """

    along: Field
    right: Field
    down: Field
    depth: Field
    place: Field
    reach: Field
    slack: Field


def lamp_hits(particles: Particles, origin: Vec3, directions: Field, *, depth: str = "hit", size: str = "edge",
              least_transmittance: float | None = None) -> Crossings:
    """Where rays from a lamp cross the particles, which face the lamp.

    Parameters
    ----------
    particles : Particles
    origin : (float, float, float) [m]
        The lamp's position.
    directions : ndarray, shape (3, r)
        Unit directions of the rays; in any order, without other cost than a little time.
    depth : {"hit", "centre"}
        What the distance is: that of the point that is hit, or of the particle's centre, as the thesis's own
        program has it (A9).
    size : {"edge", "half"}
        As for `half_extents` (A9).
    least_transmittance : float, optional [1]
        What a particle lets through at least, which caps its optical depth. Published: 1e-5, a cap of 11.5 (D8).
        Default: e^−700, in float32 e^−80, so that an opaque particle has a finite depth.

    Returns
    -------
    Crossings
        In the dtype of the directions.

    Raises
    ------
    InputError
        Unknown word, or a bound that is not above 0 and below 1.

    Notes
    -----
    The square of a particle lies across the direction a to its centre, D away: a ray d with d·a > 0 meets its
    plane at D/(d·a), and the opacity there counts [Dörries 2020, §3.3.3] as −ln(1 − α)·multiplier, capped.

    A particle whose centre is the lamp's position faces nowhere, and is left out. One that is nearer than it is
    large dims up to half of all directions, those that its square covers.

    Examples
    --------
    >>> from froxel_ref.assets import load_assets
    >>> from froxel_ref.billboards import placed_particles
    >>> from froxel_ref.scene import Particle, Scene
    >>> scene = Scene(particles=(Particle(position=(0, 0, -2), size=2, profile="square"),))
    >>> ready = placed_particles(scene, load_assets(scene, None))
    >>> rays = np.array([[0.0, 0.6, 0.28], [0.0, 0.0, 0.0], [-1.0, -0.8, -0.96]])
    >>> hits = lamp_hits(ready, (0.0, 0.0, 0.0), rays)
    >>> hits.ray.tolist(), hits.distance.round(4).tolist(), hits.tau.round(4).tolist()
    ([0, 2], [2.0, 2.0833], [0.6931, 0.6931])
    """
    _check_depth(depth)
    cap = _cap(least_transmittance, directions.dtype)
    view = _lamp_view(particles, origin, size, directions.dtype)
    parts = []
    for ray, particle in pairs_within(directions, view.place, view.reach):
        distance, x, y = _lamp_crossing(view, directions[:, ray], particle)
        parts.append(_kept(particles, ray, particle, view.depth[particle] if depth == "centre" else distance, x, y,
                           cap))
    return _ordered(parts, directions.dtype)


def sun_hits(particles: Particles, origins: Field, direction: Vec3, *, depth: str = "hit", size: str = "edge",
             least_transmittance: float | None = None) -> Crossings:
    """Where parallel rays cross the particles, which face them.

    Parameters
    ----------
    particles : Particles
    origins : ndarray, shape (3, r) [m]
        Where each ray's distance is 0.
    direction : (float, float, float)
        The way of the rays, of any length but 0: minus a directional light's direction.
    depth, size, least_transmittance
        As for `lamp_hits`. A square across the rays is as far as its centre, so ``depth`` changes nothing.

    Returns
    -------
    Crossings
        In the dtype of the origins. Rays are whole lines: distances may be negative.

    Raises
    ------
    InputError
        As for `lamp_hits`.

    Examples
    --------
    >>> from froxel_ref.assets import load_assets
    >>> from froxel_ref.billboards import placed_particles
    >>> from froxel_ref.scene import Particle, Scene
    >>> scene = Scene(particles=(Particle(position=(0, 1, 0), size=2, profile="disc"),))
    >>> ready = placed_particles(scene, load_assets(scene, None))
    >>> origins = np.array([[0.5, 1.5], [3.0, 3.0], [0.0, 0.0]])
    >>> sun_hits(ready, origins, (0.0, -1.0, 0.0))[:3]
    (array([0]), array([0]), array([2.]))
    """
    _check_depth(depth)
    cap = _cap(least_transmittance, origins.dtype)
    view, basis, shift = _sun_view(particles, direction, size, origins.dtype)
    across = _turned(basis, origins, shift)
    parts = []
    for ray, particle in pairs_within(across[:2], view.place, view.reach):
        distance, x, y = _sun_crossing(view, across[:, ray], particle)
        parts.append(_kept(particles, ray, particle, distance, x, y, cap))
    return _ordered(parts, origins.dtype)


def _check_depth(depth: str) -> None:
    if depth not in DEPTHS:
        raise InputError("depth", f"is {shown(depth)}, must be one of {', '.join(DEPTHS)}")


def _lamp_view(particles: Particles, origin: Vec3, size: str, dtype: np.dtype[Any]) -> _View:
    eps = float(np.finfo(dtype).eps)
    along, right, down, distance, half = facing(particles, origin, size=size)
    # Directions within an angle are points of the unit sphere within a chord. A particle at the lamp covers none.
    angle = np.arctan2(reaches(particles, size=size), distance)
    reach = np.where(distance > 0.0, 2.0 * np.sin(0.5 * angle) + 32.0 * eps, -1.0)
    scale = distance / half
    slack = ROUNDINGS * eps * (np.abs(particles.position).max(axis=0, initial=np.abs(origin).max()) + distance)
    return _View(*(part.astype(dtype) for part in
                   (along, right * scale, down * scale, distance, along, reach, slack)))


def _lamp_crossing(view: _View, d: Field, particle: Integers) -> tuple[Field, Field, Field]:
    """Distance along rays from the lamp, and place on the square; outside of it where a ray leads away."""
    cosine = _dot(d, view.along, particle)
    faced = cosine > 0.0
    safe = np.where(faced, cosine, 1.0)
    with np.errstate(over="ignore"):  # along a square that is nearer than it is large
        x = np.where(faced, _dot(d, view.right, particle) / safe, np.inf)
        return view.depth[particle] / safe, x, _dot(d, view.down, particle) / safe


def _sun_view(particles: Particles, direction: Vec3, size: str, dtype: np.dtype[Any]) -> tuple[_View, Field, Field]:
    """Particles across a sun's rays, axes there as rows, and the place that counts as their origin."""
    eps = float(np.finfo(dtype).eps)
    along = np.reshape(unit((direction[0], direction[1], direction[2])), (3, 1))
    right, down = facing_axes(along, np.array([[1.0], [0.0]]))
    basis = np.concatenate([right, down, along], axis=1).T
    # Near the particles, so that far from the world's origin no digits are lost on the way.
    position = particles.position.astype(np.float64)
    shift = position.mean(axis=1, keepdims=True) if position.size else np.zeros((3, 1))
    place = _turned(basis, position.astype(dtype), shift)
    c, s = particles.turn / half_extents(particles, size=size)
    reach = reaches(particles, size=size) + 32.0 * eps * np.abs(place).max(initial=0.0)
    slack = ROUNDINGS * eps * (np.abs(position).max(axis=0) + np.abs(place[2]))
    return _View(*(part.astype(dtype) for part in
                   (along, np.stack([c, -s]), np.stack([s, c]), place[2], place[:2], reach, slack))), basis, shift


def _turned(basis: Field, points: Field, shift: Field) -> Field:
    """Coordinates along the rows of a basis, (3, n)."""
    x, y, z = points - shift.astype(points.dtype)
    return np.stack([x * a + y * b + z * c for a, b, c in basis.astype(points.dtype)])


def _sun_crossing(view: _View, across: Field, particle: Integers) -> tuple[Field, Field, Field]:
    offset = across[:2] - view.place[:, particle]
    x, y = (offset[0] * axis[0, particle] + offset[1] * axis[1, particle] for axis in (view.right, view.down))
    return view.depth[particle] - across[2], x, y


def _dot(d: Field, axes: Field, index: Integers) -> Field:
    result: Field = d[0] * axes[0].take(index)
    result += d[1] * axes[1].take(index)
    result += d[2] * axes[2].take(index)
    return result


def _kept(particles: Particles, ray: Integers, particle: Integers, distance: Field, x: Field, y: Field, cap: float
          ) -> Crossings:
    """Of candidates those that dim."""
    on = np.flatnonzero((np.abs(x) <= 1.0) & (np.abs(y) <= 1.0))
    ray, particle, distance = ray[on], particle[on], distance[on]
    opacity = opacity_at(particles, particle, x[on], y[on])
    tau = _optical_depth(opacity, particles.multiplier[particle].astype(opacity.dtype), cap)
    dims = tau > 0.0
    return Crossings(ray[dims], particle[dims], distance[dims], tau[dims])


def _ordered(parts: list[Crossings], dtype: np.dtype[Any]) -> Crossings:
    if not parts:
        return Crossings(np.zeros(0, np.intp), np.zeros(0, np.intp), np.zeros(0, dtype), np.zeros(0, dtype))
    ray, particle = (np.concatenate([part[i] for part in parts]) for i in (0, 1))
    distance, tau = (np.concatenate([part[i] for part in parts]) for i in (2, 3))
    order = np.lexsort((particle, ray))
    return Crossings(ray[order], particle[order], distance[order], tau[order])


# --- points -----------------------------------------------------------------------------------------


def points_transmittance(particles: Particles, light: Light, points: Points, *, size: str = "edge") -> Field:
    """What the particles let through of a light on its straight way to points, exactly.

    Parameters
    ----------
    particles : Particles
    light : Light
        A lamp, or a sun, whose way begins at infinity.
    points : Points [m]
        Of any shape.
    size : {"edge", "half"}
        As for `half_extents` (A9).

    Returns
    -------
    ndarray, the points' shape [1]
        The product of (1 − α)^multiplier over the particles whose square, facing the light, the way crosses
        before the point.

    Raises
    ------
    InputError
        As for `half_extents`.

    Notes
    -----
    Before means by more than 8 ulp of the coordinates and distances at hand, so that the centre of a particle is
    not in its own shadow. Of a particle that faces the camera the half that is farther from the light is: there the
    two squares cut each other.

    A point at a lamp lies in no shadow, and a particle at a lamp casts none, as for `lamp_hits`.

    Examples
    --------
    >>> from froxel_ref.assets import load_assets
    >>> from froxel_ref.billboards import placed_particles
    >>> from froxel_ref.scene import Particle, Scene
    >>> scene = Scene(particles=(Particle(position=(0, 2, 0), size=2, opacity=0.75, profile="square"),))
    >>> ready = placed_particles(scene, load_assets(scene, None))
    >>> sun = DirectionalLight(direction=(0, 1, 0), irradiance=(1, 1, 1))
    >>> zero, height = np.zeros(3), np.array([1.0, 2.0, 3.0])
    >>> points_transmittance(ready, sun, (zero, height, zero)).tolist()
    [0.25, 1.0, 1.0]
    """
    shape, dtype = np.broadcast_shapes(*(p.shape for p in points)), np.result_type(*points)
    place = np.stack([np.broadcast_to(p, shape).ravel() for p in points]).astype(dtype, copy=False)
    total = np.zeros(place.shape[1], dtype)
    step = BLOCK
    for begin in range(0, len(total), step):
        some = slice(begin, begin + step)
        for ray, tau in (_sun_shadows(particles, light, place[:, some], size) if isinstance(light, DirectionalLight)
                         else _lamp_shadows(particles, light.position, place[:, some], size)):
            total[some] += np.bincount(ray, weights=tau, minlength=len(total[some])).astype(dtype)
    with np.errstate(under="ignore"):
        return np.asarray(np.exp(-total).reshape(shape))


def _lamp_shadows(particles: Particles, origin: Vec3, points: Field, size: str) -> Iterator[tuple[Integers, Field]]:
    relative = points - np.reshape(origin, (3, 1)).astype(points.dtype)
    length = np.sqrt((relative * relative).sum(axis=0))
    directions = relative / np.where(length > 0.0, length, 1.0)
    view = _lamp_view(particles, origin, size, points.dtype)
    for ray, particle in pairs_within(directions, view.place, view.reach):
        distance, x, y = _lamp_crossing(view, directions[:, ray], particle)
        before = distance + view.slack[particle] < length[ray]
        found = _kept(particles, ray[before], particle[before], distance[before], x[before], y[before], math.inf)
        yield found.ray, found.tau


def _sun_shadows(particles: Particles, light: DirectionalLight, points: Field, size: str
                 ) -> Iterator[tuple[Integers, Field]]:
    x, y, z = light.direction
    view, basis, shift = _sun_view(particles, (-x, -y, -z), size, points.dtype)
    across = _turned(basis, points, shift)
    for ray, particle in pairs_within(across[:2], view.place, view.reach):
        distance, u, v = _sun_crossing(view, across[:, ray], particle)
        before = distance + view.slack[particle] < 0.0
        found = _kept(particles, ray[before], particle[before], distance[before], u[before], v[before], math.inf)
        yield found.ray, found.tau


def _optical_depth(opacity: Field, multiplier: Field, cap: float) -> Field:
    """−ln(1 − α) times the multiplier, cut; nothing for a multiplier of 0, be it opaque or not."""
    with np.errstate(divide="ignore", invalid="ignore"):
        depth = -np.log1p(-opacity) * multiplier
    return np.asarray(np.where(multiplier > 0.0, np.minimum(depth, cap), 0.0), opacity.dtype)


def _cap(least_transmittance: float | None, dtype: np.dtype[Any]) -> float:
    if least_transmittance is None:
        return LARGEST[dtype.itemsize]
    if not 0.0 < least_transmittance < 1.0:
        raise InputError("least_transmittance", f"is {shown(least_transmittance)}, must be above 0 and below 1")
    return -math.log(least_transmittance)
