"""Billboards: flat particles that turn to whoever looks at them.

A particle is a square through its centre, across the direction from the viewer to the centre. A viewer is the
camera, a lamp, or a sun, which sees all of them from one direction.
"""

from __future__ import annotations

import math
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import DTypeLike, NDArray

from froxel_ref.arrays import Field
from froxel_ref.assets import Assets
from froxel_ref.records import InputError, shown
from froxel_ref.sampling import fetch_bilinear
from froxel_ref.scene import Scene

__all__ = [
    "PROFILES", "SIZES", "Facing", "Particles", "facing", "facing_axes", "half_extents", "opacity_at",
    "placed_particles", "reaches",
]

Integers: TypeAlias = NDArray[np.intp]

PROFILES = ("square", "disc", "soft")
SQUARE, DISC, SOFT = range(3)
SIZES = ("edge", "half")


class Particles(NamedTuple):
    """A scene's particles, made ready.

    Attributes
    ----------
    position : ndarray, shape (3, n) [m]
        Centres.
    size : ndarray, shape (n,) [m]
        As the scene has it.
    turn : ndarray, shape (2, n)
        Cosine and sine of the rotation.
    opacity : ndarray, shape (n,) [1]
    albedo : ndarray, shape (3, n) [1]
    anisotropy : ndarray, shape (n,) [1]
        Mean cosine g of the phase function.
    multiplier : ndarray, shape (n,) [1]
        Factor on the optical depth that it casts.
    profile : ndarray of int, shape (n,)
        Place in `PROFILES`, or len(PROFILES) + i for the i-th texture.
    textures : tuple of ndarray, shape (rows, columns) [1]
        Shares of the opacity, row 0 on top.
    """

    position: Field
    size: Field
    turn: Field
    opacity: Field
    albedo: Field
    anisotropy: Field
    multiplier: Field
    profile: Integers
    textures: tuple[Field, ...]


class Facing(NamedTuple):
    """The squares of particles as they are turned to a viewer.

    Attributes
    ----------
    along : ndarray, shape (3, n)
        Unit directions from the viewer to the centres.
    right, down : ndarray, shape (3, n)
        Unit vectors along the squares' edges, see `facing_axes`.
    distance : ndarray, shape (n,) [m]
        From the viewer to the centres; at 0 there is no direction, and (0, 0, 1) stands for it.
    half : ndarray, shape (n,) [m]
        Half an edge.
    """

    along: Field
    right: Field
    down: Field
    distance: Field
    half: Field


def placed_particles(scene: Scene, assets: Assets, *, dtype: DTypeLike = np.float64) -> Particles:
    """Make a scene's particles ready.

    Parameters
    ----------
    scene : Scene
        Its particles, clouds expanded.
    assets : Assets
        Holds the textures that they name.
    dtype : data type
        Of the arrays.

    Returns
    -------
    Particles
        In the order of `Scene.all_particles`.

    Examples
    --------
    >>> from froxel_ref.assets import load_assets
    >>> from froxel_ref.scene import ParticleCloud
    >>> scene = Scene(particles=(ParticleCloud(count=5),))
    >>> placed_particles(scene, load_assets(scene, None)).position.shape
    (3, 5)
    """
    every = scene.all_particles
    paths = list(dict.fromkeys(each.texture for each in every if each.texture is not None))
    rows = [(*each.position, each.size, *_cos_sin(each.rotation), each.opacity, *each.albedo, each.phase_anisotropy,
             each.fom_multiplier) for each in every]
    table = np.asarray(rows, np.float64).reshape(len(rows), 12).T.astype(dtype)
    profile = [PROFILES.index(each.profile) if each.texture is None else len(PROFILES) + paths.index(each.texture)
               for each in every]
    return Particles(table[:3], table[3], table[4:6], table[6], table[7:10], table[10], table[11],
                     np.asarray(profile, np.intp), tuple(assets.opacities[path].astype(dtype) for path in paths))


def _cos_sin(degrees: float) -> tuple[float, float]:
    """Exact at quarter turns."""
    quarter, rest = divmod(degrees, 90.0)
    c, s = math.cos(math.radians(rest)), math.sin(math.radians(rest))
    return ((c, s), (-s, c), (-c, -s), (s, -c))[int(quarter % 4.0)]


# --- the square and what is on it -------------------------------------------------------------------


def half_extents(particles: Particles, *, size: str = "edge") -> Field:
    """Half the edges of the particles' squares.

    Parameters
    ----------
    particles : Particles
    size : {"edge", "half"}
        What the scene's size is: an edge, or half of one as in the thesis's own program (A9).

    Returns
    -------
    ndarray, shape (n,) [m]

    Raises
    ------
    InputError
        Another word.

    Examples
    --------
    >>> from froxel_ref.assets import load_assets
    >>> from froxel_ref.scene import Particle
    >>> scene = Scene(particles=(Particle(position=(0, 0, 0), size=2),))
    >>> ready = placed_particles(scene, load_assets(scene, None))
    >>> half_extents(ready).tolist(), half_extents(ready, size="half").tolist()
    ([1.0], [2.0])
    """
    if size not in SIZES:
        raise InputError("size", f"is {shown(size)}, must be one of {', '.join(SIZES)}")
    return particles.size * np.asarray(0.5 if size == "edge" else 1.0, particles.size.dtype)


def reaches(particles: Particles, *, size: str = "edge") -> Field:
    """How far from their centre the particles have opacity.

    Parameters
    ----------
    particles : Particles
    size : {"edge", "half"}
        As for `half_extents`.

    Returns
    -------
    ndarray, shape (n,) [m]
        To a corner of the square, or to the rim of a disc.

    Raises
    ------
    InputError
        As for `half_extents`.

    Examples
    --------
    >>> from froxel_ref.assets import load_assets
    >>> from froxel_ref.scene import Particle
    >>> scene = Scene(particles=tuple(Particle(position=(0, 0, 0), size=2, profile=p) for p in ("disc", "square")))
    >>> reaches(placed_particles(scene, load_assets(scene, None))).round(4).tolist()
    [1.0, 1.4142]
    """
    half = half_extents(particles, size=size)
    is_round = (particles.profile == DISC) | (particles.profile == SOFT)
    return np.asarray(np.where(is_round, half, half * np.asarray(math.sqrt(2.0), half.dtype)))


def facing_axes(along: Field, turn: Field) -> tuple[Field, Field]:
    """The axes of squares that face a viewer.

    Parameters
    ----------
    along : ndarray, shape (3, n) or (3, 1)
        Unit directions from the viewer to the centres.
    turn : ndarray, shape (2, n)
        Cosine and sine of the rotation, counter-clockwise as the viewer sees it.

    Returns
    -------
    (right, down) : ndarray, shape (3, n)
        Unit vectors along which a texture's columns and rows grow.

    Notes
    -----
    Unturned, right is along × y, or along × −z within 8° of y, and down is along × right, as for shadow maps
    (CONVENTIONS.md). They follow the world, so a camera that rolls sees the particles roll. Where the direction
    passes into the 8° the axes jump, which only a round particle without texture does not show.

    Examples
    --------
    >>> along, quarter = np.array([[0.0], [0.0], [-1.0]]), np.array([[0.0], [1.0]])
    >>> [axis.ravel().tolist() for axis in facing_axes(along, np.array([[1.0], [0.0]]))]
    [[1.0, 0.0, 0.0], [0.0, -1.0, 0.0]]
    >>> [axis.ravel().tolist() for axis in facing_axes(along, quarter)]
    [[0.0, 1.0, 0.0], [1.0, 0.0, 0.0]]
    """
    x, y, z = along
    level, none = np.abs(y) < 0.99, np.zeros_like(x)
    right = np.where(level, np.stack([-z, none, x]), np.stack([-y, x, none]))
    right = right / np.sqrt((right * right).sum(axis=0))
    rx, ry, rz = right
    down = np.stack([y * rz - z * ry, z * rx - x * rz, x * ry - y * rx])
    c, s = turn
    # Adding 0 turns −0 into 0.
    return right * c - down * s + 0.0, right * s + down * c + 0.0


def facing(particles: Particles, viewer: tuple[float, float, float], *, size: str = "edge") -> Facing:
    """Turn the particles to a viewer.

    Parameters
    ----------
    particles : Particles
    viewer : (float, float, float) [m]
        Where it stands.
    size : {"edge", "half"}
        As for `half_extents`.

    Returns
    -------
    Facing
        In float64.

    Raises
    ------
    InputError
        As for `half_extents`.

    Examples
    --------
    >>> from froxel_ref.assets import load_assets
    >>> from froxel_ref.scene import Particle
    >>> scene = Scene(particles=(Particle(position=(0, 0, -2)),))
    >>> seen = facing(placed_particles(scene, load_assets(scene, None)), (0.0, 0.0, 0.0))
    >>> seen.along.ravel().tolist(), seen.distance.tolist(), seen.half.tolist()
    ([0.0, 0.0, -1.0], [2.0], [0.5])
    """
    relative = particles.position.astype(np.float64) - np.reshape(viewer, (3, 1))
    distance = np.sqrt((relative * relative).sum(axis=0))
    apart = distance > 0.0
    along = np.where(apart, relative / np.where(apart, distance, 1.0), [[0.0], [0.0], [1.0]])
    right, down = facing_axes(along, particles.turn.astype(np.float64))
    return Facing(along, right, down, distance, half_extents(particles, size=size).astype(np.float64))


def opacity_at(particles: Particles, index: Integers, x: Field, y: Field) -> Field:
    """Opacities of particles at points of their squares.

    Parameters
    ----------
    particles : Particles
    index : ndarray of int, shape (m,)
        Which particle each point is on.
    x, y : ndarray, shape (m,)
        Place along its right and down axes, in half edges: the square is [−1, 1]².

    Returns
    -------
    ndarray, shape (m,) [1]
        0 outside the square.

    Notes
    -----
    With r² = x² + y²: ``square`` is 1, ``disc`` is 1 up to r = 1, ``soft`` is (1 − r²)² up to r = 1, times the
    particle's opacity. A texture is bilinear between its texels' centres; beyond the outermost of these, up to
    the square's edge, it has the outermost texels.

    Examples
    --------
    >>> from froxel_ref.assets import load_assets
    >>> from froxel_ref.scene import Particle
    >>> scene = Scene(particles=tuple(Particle(position=(0, 0, 0), profile=p) for p in PROFILES))
    >>> ready = placed_particles(scene, load_assets(scene, None))
    >>> opacity_at(ready, np.arange(3), np.full(3, 0.5), np.full(3, 0.5)).tolist()
    [0.5, 0.5, 0.125]
    """
    profile = particles.profile[index]
    opacity = np.where((np.abs(x) <= 1.0) & (np.abs(y) <= 1.0), particles.opacity[index].astype(x.dtype), 0.0)
    # Few points of many particles, or many points of few: whichever is shorter tells the kinds.
    kinds = np.unique(min(profile.ravel(), particles.profile, key=len)).tolist()
    if DISC in kinds or SOFT in kinds:
        rest = np.maximum(1.0 - (x * x + y * y), 0.0)
        share = np.where(profile == SOFT, rest * rest, np.where((profile == DISC) & (x * x + y * y > 1.0), 0.0, 1.0))
        opacity = opacity * share
    for kind in (kind for kind in kinds if kind >= len(PROFILES)):
        on = np.flatnonzero((profile == kind) & (opacity > 0.0))
        texture = particles.textures[kind - len(PROFILES)]
        rows, columns = texture.shape
        opacity[on] *= fetch_bilinear(texture.astype(x.dtype, copy=False), (x[on] + 1.0) * (0.5 * columns),
                                      (y[on] + 1.0) * (0.5 * rows))
    return np.asarray(opacity, x.dtype)
