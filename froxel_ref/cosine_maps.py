"""Extinction transmittance maps: the extinction along rays as a few coefficients of a cosine basis.

Like Fourier opacity maps (`froxel_ref.fom`), gathered in any order, but over half a period: what lies at the far
end does not come back at the near one [Gautron 2011].
"""

from __future__ import annotations

from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from froxel_ref import fom
from froxel_ref.absorbers import Absorbers
from froxel_ref.arrays import Field

__all__ = ["cosine_coefficients", "optical_depth", "transmittance"]

Array: TypeAlias = NDArray[np.floating[Any]]


def cosine_coefficients(absorbers: Absorbers, *, count: int = 8) -> Array:
    """Cosine coefficients of what lies on rays, exactly.

    Parameters
    ----------
    absorbers : Absorbers
        n stretches a ray, rays along the other axes.
    count : int
        How many, at least 1. Default: as many numbers as the thesis's Fourier opacity maps hold.

    Returns
    -------
    ndarray, shape (count, …) [1]
        c_k for k = 0 … count − 1. Add those of several calls to gather more.

    Notes
    -----
    c_k = 2∫σ cos(πkx) dx [Gautron 2011]: the real Fourier coefficients at half the depths, with their closed forms
    without cancellation and their error (`fom.segment_coefficients`). Halving is exact.

    Examples
    --------
    >>> layer = Absorbers(*(np.array([v]) for v in (0.5, 0.5, 1.5, 0.0)))
    >>> cosine_coefficients(layer, count=4).tolist()
    [3.0, 0.0, -3.0, 0.0]
    """
    start, stop, tau, rise = absorbers
    halves = fom.segment_coefficients(0.5 * start, 0.5 * stop, tau, rise=rise, harmonics=count - 1)
    return np.asarray(halves[0], np.result_type(*absorbers))  # Bessel functions are of float64


def optical_depth(coefficients: Field, depth: Field) -> Array:
    """The optical depth up to a point of the ray, from its coefficients.

    Parameters
    ----------
    coefficients : ndarray, shape (count, …) [1]
        From `cosine_coefficients`, or sums of such.
    depth : ndarray, broadcastable with … [1]
        In [0, 1]; beyond it the end's value is taken.

    Returns
    -------
    ndarray [1]
        0 at depth 0 and c_0/2, the whole, at depth 1, both exactly. In between it may fall, or be negative.

    Notes
    -----
    c_0 d/2 + Σ c_k sin(πkd)/(πk) [Gautron 2011].

    Examples
    --------
    >>> layer = Absorbers(*(np.array([v]) for v in (0.5, 0.5, 4.0, 0.0)))
    >>> optical_depth(cosine_coefficients(layer), np.array([0.0, 0.25, 0.5, 1.0])).round(4).tolist()
    [0.0, 0.1512, 2.0, 4.0]
    """
    d = 0.5 * np.minimum(np.maximum(depth, 0.0), 1.0)
    return 2.0 * fom.optical_depth(np.stack([coefficients, np.zeros_like(coefficients)]), d)


def transmittance(coefficients: Field, depth: Field, *, clamp: bool = True) -> Array:
    """What passes up to a point of the ray.

    Parameters
    ----------
    coefficients, depth
        As for `optical_depth`.
    clamp : bool
        Whether to cut what rings beyond [0, 1].

    Returns
    -------
    ndarray [1]

    Examples
    --------
    >>> layer = cosine_coefficients(Absorbers(*(np.array([v]) for v in (0.5, 0.5, 4.0, 0.0))))
    >>> float(transmittance(layer, np.linspace(0, 1, 1001), clamp=False).max().round(3))
    1.45
    """
    with np.errstate(under="ignore", over="ignore"):
        passed = np.exp(-optical_depth(coefficients, depth))
    return np.asarray(np.minimum(passed, 1.0) if clamp else passed)
