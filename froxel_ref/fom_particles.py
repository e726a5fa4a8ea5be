"""What particles add to opacity maps: points of optical depth where the lights' rays cross them."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from froxel_ref.arrays import Field
from froxel_ref.billboard_shadows import Crossings
from froxel_ref.billboards import Particles, reaches
from froxel_ref.fom_codes import Code, fourier_code

__all__ = [
    "AT_ONCE", "CROSSING", "KEPT", "KEPT_CROSSING", "Crossed", "add_crossings", "casting", "crossed", "crossing_span",
]

Integers: TypeAlias = NDArray[np.intp]

Crossed: TypeAlias = Callable[[], Iterable[tuple[Particles, Crossings]]]
"""Some particles at a time, and where rays cross them; may be asked more than once."""

# Crossings that are likely at a time: first one for each ray and particle, then as many as there were. No fewer than
# one particle's.
AT_ONCE = 1 << 19
# Crossings that are kept for being asked again.
KEPT = 1 << 22
# Bytes of a crossing while it is worked out, and while it is kept; measured.
CROSSING, KEPT_CROSSING = 320, 32


def casting(particles: Particles) -> Particles:
    """The particles that dim light.

    Parameters
    ----------
    particles : Particles

    Returns
    -------
    Particles
        Those with an opacity and a multiplier above 0.

    Examples
    --------
    >>> from froxel_ref.assets import load_assets
    >>> from froxel_ref.billboards import placed_particles
    >>> from froxel_ref.scene import Particle, Scene
    >>> scene = Scene(particles=(Particle(position=(0, 0, 0), opacity=0), Particle(position=(0, 1, 0))))
    >>> casting(placed_particles(scene, load_assets(scene, None))).position[1].tolist()
    [1.0]
    """
    return chosen(particles, np.flatnonzero((particles.opacity > 0.0) & (particles.multiplier > 0.0)))


def chosen(particles: Particles, some: Integers | slice) -> Particles:
    """Some of the particles."""
    return particles._replace(**{name: getattr(particles, name)[..., some] for name in Particles._fields
                                 if name != "textures"})


def crossed(particles: Particles, cross: Callable[[Particles], Crossings], *, rays: int = 1, keep: int = KEPT
            ) -> Crossed:
    """Cross particles a few at a time, so that memory stays bounded however many there are.

    Parameters
    ----------
    particles : Particles
    cross : callable
        From some particles to where rays cross them.
    rays : int
        How many there are.
    keep : int
        Crossings to keep at most: of the first particles, as far as it goes. The others are crossed each time.

    Returns
    -------
    callable
        See `Crossed`.

    Examples
    --------
    >>> from froxel_ref.assets import load_assets
    >>> from froxel_ref.billboards import placed_particles
    >>> from froxel_ref.scene import ParticleCloud, Scene
    >>> scene = Scene(particles=(ParticleCloud(count=300),))
    >>> none = Crossings(*(np.zeros(0, np.intp),) * 4)
    >>> parts = crossed(placed_particles(scene, load_assets(scene, None)), lambda some: none)
    >>> [some.size.size for some, _ in parts()]
    [300]
    """
    kept: list[tuple[Particles, Crossings]] = []

    def pieces() -> Iterator[tuple[Particles, Crossings]]:
        yield from tuple(kept)
        begin, held = sum(part.size.size for part, _ in kept), sum(found.ray.size for _, found in kept)
        few = max(1, AT_ONCE // rays)
        while begin < particles.size.size:
            part = chosen(particles, slice(begin, begin + few))
            found = cross(part)
            held += found.ray.size
            if held <= keep:
                kept.append((part, found))
            yield part, found
            begin += few
            few = min(max(few * AT_ONCE // max(found.ray.size, 1), 1), 4 * few)

    return pieces


def crossing_span(parts: Crossed, count: int, *, size: str = "edge") -> tuple[Field, Field]:
    """Nearest and farthest depth of particles along rays, as if they were as thick as they are wide.

    Parameters
    ----------
    parts : callable
        From `crossed`.
    count : int
        Rays.
    size : {"edge", "half"}
        As for `froxel_ref.billboards.half_extents` (A9).

    Returns
    -------
    near, far : ndarray, shape (count,) [m]
        Infinite and −infinite for rays that cross none.

    Notes
    -----
    A point at an end of the range would count by half at either end, for a Fourier series is periodic. A puff
    of smoke that a particle stands for has a thickness; its half before and behind keeps the ends free.

    Examples
    --------
    >>> from froxel_ref.assets import load_assets
    >>> from froxel_ref.billboard_shadows import lamp_hits
    >>> from froxel_ref.billboards import placed_particles
    >>> from froxel_ref.scene import Particle, Scene
    >>> scene = Scene(particles=(Particle(position=(0, 0, -4), size=2, profile="disc"),))
    >>> ready = placed_particles(scene, load_assets(scene, None))
    >>> ways = np.array([[0.0, 0.0], [0.0, 1.0], [-1.0, 0.0]])
    >>> parts = crossed(ready, lambda some: lamp_hits(some, (0.0, 0.0, 0.0), ways))
    >>> [end.tolist() for end in crossing_span(parts, 2)]
    [[3.0, inf], [5.0, -inf]]
    """
    near, far = np.full(count, np.inf), np.full(count, -np.inf)
    for particles, crossings in parts():
        half = reaches(particles, size=size)[crossings.particle]
        np.minimum.at(near, crossings.ray, crossings.distance - half)
        np.maximum.at(far, crossings.ray, crossings.distance + half)
    return near, far


def add_crossings(target: Field, crossings: Crossings, near: Field, far: Field, *, code: Code | None = None) -> None:
    """Add the numbers of crossings to a map.

    Parameters
    ----------
    target : Field, shape (channels, rows, columns)
        Changed in place.
    crossings : Crossings
        Of the rays through its texels, row by row.
    near, far : ndarray, shape (rows·columns,) or (1,) [m]
        The depths that the map covers. What lies beyond the far end dims nothing that is looked up, and what lies
        before the near end dims all of it.
    code : Code, optional
        Whose numbers they are. Default: a_0, b_0, a_1, b_1, … as many as there are channels.

    Examples
    --------
    >>> target = np.zeros((4, 1, 2))
    >>> add_crossings(target, Crossings(np.array([1]), np.array([0]), np.array([3.0]), np.array([0.5])),
    ...               np.array([1.0]), np.array([9.0]))
    >>> target[:, 0].round(12).tolist()
    [[0.0, 1.0], [0.0, 0.0], [0.0, 0.0], [0.0, 1.0]]
    """
    count = target.shape[1] * target.shape[2]
    begin, end = (np.broadcast_to(limit, count)[crossings.ray] for limit in (near, far))
    some = np.flatnonzero((crossings.distance <= end) & (end > begin))
    if not some.size:
        return
    width = end[some] - begin[some]
    depth = np.minimum(np.maximum((crossings.distance[some] - begin[some]) / width, 0.0), 1.0)
    code = code or fourier_code(len(target) // 2 - 1)
    made = code.scatter(crossings.ray[some], depth, crossings.tau[some].astype(np.float64), count)
    for plane, added in zip(target, made, strict=True):  # which may be a view of an atlas
        plane += added.reshape(plane.shape).astype(plane.dtype)
