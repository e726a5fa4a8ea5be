"""What dims light along rays: stretches of extinction and points of opacity, in any order.

Every volumetric shadow here (`froxel_ref.fom` and its rivals) is made of such lists, so that they can be compared
on the same rays.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from froxel_ref.arrays import Field

__all__ = ["Absorbers", "as_points", "inverse_lengths", "joined"]


class Absorbers(NamedTuple):
    """Stretches of constant or linear extinction along rays; a stretch of length 0 is a point.

    Attributes
    ----------
    start, stop : Field, shape (n, …) [1]
        Where each begins and ends, 0 ≤ start ≤ stop ≤ 1: n stretches a ray, rays along the other axes.
    tau : Field, shape (n, …) [1]
        Optical depth of each, at least 0.
    rise : Field, shape (n, …) [1]
        How much more extinction there is at the end than at the beginning, times the length; 0 where it is
        constant, at most 2·tau in size.
    """

    start: Field
    stop: Field
    tau: Field
    rise: Field


def as_points(depth: Field, tau: Field) -> Absorbers:
    """Points of optical depth.

    Parameters
    ----------
    depth : Field, shape (n, …) [1]
        In [0, 1].
    tau : Field, shape (n, …) [1]

    Returns
    -------
    Absorbers

    Examples
    --------
    >>> as_points(np.array([0.5]), np.array([4.0])).stop.tolist()
    [0.5]
    """
    return Absorbers(depth, depth, tau, np.zeros((1,) * tau.ndim, tau.dtype))


def joined(*parts: Absorbers) -> Absorbers:
    """Everything that lies on the same rays.

    Parameters
    ----------
    *parts : Absorbers
        Whose rays broadcast together; at least one.

    Returns
    -------
    Absorbers

    Examples
    --------
    >>> layer = as_points(np.array([0.5]), np.array([4.0]))
    >>> joined(layer, layer).tau.tolist()
    [4.0, 4.0]
    """
    shape = np.broadcast_shapes(*(field.shape[1:] for part in parts for field in part))

    def whole(part: Absorbers, field: Field) -> Field:
        count = max(len(each) for each in part)
        return np.broadcast_to(field, (count, *shape))

    return Absorbers(*(np.concatenate([whole(part, part[i]) for part in parts]) for i in range(4)))


def inverse_lengths(absorbers: Absorbers) -> tuple[NDArray[np.bool_], Field]:
    """Which absorbers are points, and one over the length of those that are not.

    Parameters
    ----------
    absorbers : Absorbers

    Returns
    -------
    point : ndarray of bool
        Those too short to divide by among them.
    inverse : Field [1]
        0 for points.

    Examples
    --------
    >>> stretches = Absorbers(np.zeros(2), np.array([0.0, 0.25]), np.ones(2), np.zeros(1))
    >>> [a.tolist() for a in inverse_lengths(stretches)]
    [[True, False], [0.0, 4.0]]
    """
    length = absorbers.stop - absorbers.start
    point = length < np.finfo(length.dtype).tiny
    return point, np.where(point, 0.0, 1.0 / np.where(point, 1.0, length))
