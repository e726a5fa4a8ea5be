"""What layers in front of points leave of their light: particles and transparent surfaces along rays."""

from __future__ import annotations

from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

__all__ = ["Veil", "before", "make_veil", "veiled"]

Array: TypeAlias = NDArray[np.floating[Any]]
Integers: TypeAlias = NDArray[np.integer[Any]]


class Veil(NamedTuple):
    """What layers leave of the light of every stretch of rays.

    Attributes
    ----------
    distance : ndarray, shape (n, K) [m]
        Where the layers are, growing along each row; ∞ where a ray has no more.
    passed : ndarray, shape (n, K + 1) [1]
        The share that arrives of what the stretch in front of each layer sends, and of what lies behind the last.
    """

    distance: Array
    passed: Array


def before(opacity: Array) -> Array:
    """What the layers in front of each layer let through.

    Parameters
    ----------
    opacity : ndarray, shape (n, K)
        From front to back.

    Returns
    -------
    ndarray, shape (n, K + 1) [1]
        Π (1 − α) over the earlier ones; last what all of them let through.

    Examples
    --------
    >>> before(np.array([[0.5, 0.5]])).tolist()
    [[1.0, 0.5, 0.25]]
    """
    return np.concatenate([np.ones((len(opacity), 1)), np.cumprod(1.0 - opacity, axis=1)], axis=1)


def make_veil(distance: Array, opacity: Array) -> Veil:
    """Make a veil of layers.

    Parameters
    ----------
    distance : ndarray, shape (n, K) [m]
        Along each ray; ∞ for none.
    opacity : ndarray, shape (n, K) [1]
        0 for none.

    Returns
    -------
    Veil

    Notes
    -----
    Layers are laid over one another in the order given, from front to back, and each is fogged at its own distance:
    I = Σ_j P_j·α_j·F(d_j) + P·F(end), P_j = Π_{k<j} (1 − α_k), F the fog's light up to a distance
    [Dörries 2020, §4.3]. So a stretch of fog counts by the sum of P_j·α_j over the layers behind it, and P. Where the
    order is that of the distances this is Π (1 − α) of the layers before the stretch; particles, which are sorted as
    wholes, may be laid in another.

    Examples
    --------
    >>> veil = make_veil(np.array([[2.0, 1.0, np.inf]]), np.array([[0.5, 0.5, 0.0]]))
    >>> veil.distance.tolist(), veil.passed.tolist()
    ([[1.0, 2.0, inf]], [[1.0, 0.75, 0.25, 0.25]])
    """
    share = before(opacity)
    order = np.argsort(distance, axis=1, kind="stable")
    taken = np.take_along_axis(share[:, :-1] * opacity, order, axis=1)
    # Sums of what is not below 0, from behind: nothing cancels.
    passed = np.cumsum(np.concatenate([share[:, -1:], taken[:, ::-1]], axis=1), axis=1)[:, ::-1]
    passed[:, 0] = 1.0
    return Veil(np.take_along_axis(distance, order, axis=1), passed)


def veiled(veil: Veil, rows: Integers, t: Array) -> Array:
    """What arrives of the light of points.

    Parameters
    ----------
    veil : Veil
    rows : ndarray of int, shape (k,)
        The rays that the points are on.
    t : ndarray, shape (k,) [m]
        Where on them, not at a layer.

    Returns
    -------
    ndarray, shape (k,) [1]

    Examples
    --------
    >>> veil = make_veil(np.array([[1.0, 2.0]]), np.array([[0.5, 0.5]]))
    >>> veiled(veil, np.zeros(3, int), np.array([0.5, 1.5, 2.5])).tolist()
    [1.0, 0.5, 0.25]
    """
    place = (veil.distance[rows] < t[:, np.newaxis]).sum(axis=1)
    return np.asarray(veil.passed[rows, place])
