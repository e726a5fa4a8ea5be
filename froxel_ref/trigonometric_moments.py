"""Moment-based transmittance from trigonometric moments: a Fourier opacity map's coefficients, bounded.

Depth goes round a circle, not all of it: φ = (2π − w)·d, so that the far end does not touch the near one. A ray
holds b_k = Σ τ_i e^{ikφ_i} for k = 0 … n, which can be gathered in any order. What has these moments lets through,
up to φ, an amount between two bounds, which are found and mixed [Münstermann 2018].
"""

from __future__ import annotations

import itertools
import math
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from froxel_ref import fom
from froxel_ref.absorbers import Absorbers
from froxel_ref.arrays import Field
from froxel_ref.moment_storage import TRIGONOMETRIC_WEIGHTS, known_bias, normalised_moments
from froxel_ref.power_moments import OVERESTIMATION, in_blocks
from froxel_ref.real_roots import real_roots
from froxel_ref.records import InputError, shown

__all__ = ["WRAPPING", "transmittance", "trigonometric_moments"]

Array: TypeAlias = NDArray[np.floating[Any]]
Complex: TypeAlias = NDArray[np.complexfloating[Any, Any]]

# How much of the circle no depth has [Münstermann 2018: a tenth of half a turn].
WRAPPING = 0.1 * np.pi
# Least 1 − |γ|² of a reflection coefficient γ: distributions of fewer points than the moments allow reach 0.
LEAST = 1e-10


def trigonometric_moments(absorbers: Absorbers, *, count: int = 2, wrapping: float = WRAPPING) -> Array:
    """Trigonometric moments of what lies on rays, exactly.

    Parameters
    ----------
    absorbers : Absorbers
        n stretches a ray, rays along the other axes.
    count : int
        How many besides b_0; published: 2, 3 or 4.
    wrapping : float [rad]
        w, how much of the circle is left out; 0 gives the coefficients of Fourier opacity maps, halved.

    Returns
    -------
    ndarray, shape (1 + 2·count, …) [1]
        b_0, the whole optical depth, then real and imaginary part of b_1, of b_2 … Add those of several calls to
        gather more.

    Raises
    ------
    InputError
        A count below 1; a wrapping outside [0, 2π).

    Notes
    -----
    Half the Fourier coefficients at depths times 1 − w/2π, with their closed forms (`fom.segment_coefficients`).

    Examples
    --------
    >>> layer = Absorbers(*(np.array([v]) for v in (0.5, 0.5, 2.0, 0.0)))
    >>> (trigonometric_moments(layer, wrapping=0.0) + 0.0).tolist()
    [2.0, -2.0, 0.0, 2.0, 0.0]
    """
    if count < 1:
        raise InputError("count", f"is {shown(count)}, must be at least 1")
    start, stop, tau, rise = absorbers
    dtype = np.result_type(*absorbers)
    scale = dtype.type(_span(wrapping) / (2.0 * np.pi))
    pairs = 0.5 * fom.segment_coefficients(scale * start, scale * stop, tau, rise=rise, harmonics=count)
    rest = np.swapaxes(pairs[:, 1:], 0, 1).reshape(2 * count, *pairs.shape[2:])
    return np.concatenate([pairs[:1, 0], rest]).astype(dtype)


def _span(wrapping: float) -> float:
    if not 0.0 <= wrapping < 2.0 * np.pi:
        raise InputError("wrapping", f"is {shown(wrapping)}, must be in [0, 2π)")
    return 2.0 * np.pi - wrapping


def transmittance(encoded: Field, depth: Field, *, storage: str | None = None, bias: float | None = None,
                  overestimation: float = OVERESTIMATION, wrapping: float = WRAPPING) -> Array:
    """What passes up to a point of the ray, from its moments.

    Parameters
    ----------
    encoded : ndarray, shape (1 + 2·count, …) [1]
        From `trigonometric_moments` or `moment_storage.stored_moments`.
    depth : ndarray, shape (m, …) [1]
        Broadcastable to m depths on each ray; outside [0, 1] the end's value is taken.
    storage
        As given to `stored_moments`.
    bias : float, optional [1]
        How much of the uniform distribution is mixed in. Default: as for the storage, float32's if there is none.
    overestimation : float [1]
        0: the lower bound of the optical depth, 1: the upper one.
    wrapping
        As given to `trigonometric_moments`.

    Returns
    -------
    ndarray, shape (m, …) [1]
        In [0, 1]. It may rise with the depth where points of the distribution cross the zone that no depth has: by 0.2
        on random layers, measured.

    Raises
    ------
    InputError
        A number of moments without a bias of its own, and none given; an unknown storage.

    Notes
    -----
    As `power_moments.transmittance`, on the circle: count + 1 points have these moments, one of them at φ; the others
    are the roots of K(z, ·), z = e^{iφ}, made of the orthonormal polynomials [Szegő 1975]. They are taken in y =
    cot(½(θ − φ)), in which K is a real polynomial that leads with K(z, z) ≥ 1. What lies in the zone without depths may
    have spilled from either end: it counts as lying before by its place in the zone, linear in the angle (published: in
    a parameter that is cheaper to compute). Reflection coefficients are kept inside the unit circle, so that the result
    stays in [0, 1] whatever rounding did. All in float64.

    Examples
    --------
    >>> layer = Absorbers(*(np.array([v]) for v in (0.5, 0.5, 4.0, 0.0)))
    >>> transmittance(trigonometric_moments(layer), np.array([0.0, 0.45, 0.55, 1.0])).round(3).tolist()
    [1.0, 1.0, 0.018, 0.018]
    """
    dtype = np.result_type(encoded, depth)
    whole, shares = normalised_moments(np.asarray(encoded, np.float64), storage, power=False)
    if bias is None:
        bias = known_bias(TRIGONOMETRIC_WEIGHTS, storage, len(shares) // 2)
    moments = np.asarray((1.0 - bias) * (shares[0::2] + 1j * shares[1::2]), np.complex128)
    phase = _span(wrapping) * np.clip(np.asarray(depth, np.float64), 0.0, 1.0)
    kernel = _kernel(moments)
    return in_blocks(lambda some: _before(kernel, some, overestimation, wrapping), phase, whole
                     ).astype(dtype, copy=False)


def _kernel(moments: Complex) -> Complex:
    """A of K(z, u) = Σ A_lm z̄^l u^m: the sum over the orthonormal polynomials, by Levinson's recursion [Szegő 1975].

    Φ_{j+1} = zΦ_j − γ̄_j Φ*_j, with γ̄_j‖Φ_j‖² = ⟨zΦ_j, 1⟩, and γ kept inside the unit circle.
    """
    count = len(moments)
    rays = moments.shape[1:]
    result = np.zeros((count + 1, count + 1, *rays), complex)
    polynomial = np.ones((1, *rays), complex)
    norm = np.ones(rays)
    for j in range(count + 1):
        result[:j + 1, :j + 1] += np.conj(polynomial)[:, None] * polynomial / norm
        if j == count:
            break
        turn = np.sum(polynomial * moments[:j + 1], axis=0) / norm
        size = np.abs(turn)
        turn = turn * np.minimum(1.0, math.sqrt(1.0 - LEAST) / np.maximum(size, 0.5))
        reverse = np.conj(polynomial[::-1])
        ahead = np.concatenate([np.zeros((1, *rays)), polynomial])
        ahead[:-1] -= turn * reverse
        polynomial, norm = ahead, norm * (1.0 - np.abs(turn) ** 2)
    return result


def _before(kernel: Complex, phase: Array, overestimation: float, wrapping: float) -> Array:
    """The share of the optical depth that lies before the phase."""
    count = len(kernel) - 1
    z = np.exp(1j * phase)
    powers = list(itertools.accumulate([z] * count, np.multiply, initial=np.ones_like(z)))
    behind = [np.conj(p) for p in powers]
    row = [sum(k * b for k, b in zip(kernel[:, m], behind, strict=True)) * powers[m] for m in range(count + 1)]
    coefficients = _in_cotangents(row)
    y = real_roots(np.stack(coefficients))
    # e^{iθ} = (y + i)/(y − i) is how far a root lies round the circle from the phase.
    root = z * ((y + 1j) / (y - 1j))
    diagonals = [np.trace(kernel, offset=k) for k in range(count + 1)]
    value: Any = diagonals[-1]
    for diagonal in diagonals[-2:0:-1]:
        value = value * root + diagonal
    # K(u, u) is real on the circle, and no point holds more than everything.
    held = 1.0 / np.maximum(diagonals[0].real + 2.0 * (value * root).real, 1.0)
    here = 1.0 / coefficients[0]
    # Beyond a whole turn roots lie before the phase; in the zone that no depth has, by their place in it.
    angle = phase + 2.0 * np.arctan2(1.0, y)
    share = np.clip((angle - (2.0 * np.pi - wrapping)) / max(wrapping, 1e-300), 0.0, 1.0)
    low = np.sum(held * share, axis=0)
    return np.asarray((low + overestimation * here) / (np.sum(held, axis=0) + here))


def _in_cotangents(row: list[Complex]) -> list[Array]:
    """Σ k_m u^m as a real polynomial in y, u = (y + i)/(y − i): coefficients of the highest power first."""
    count = len(row) - 1
    total: list[Array] = [np.zeros(())] * (count + 1)
    for m, value in enumerate(row):
        factor = np.ones(1, complex)
        for root in [-1j] * m + [1j] * (count - m):
            factor = np.convolve(factor, [1.0, -root])
        for k, c in enumerate(factor):  # of which every second is real, and the others imaginary
            total[k] = total[k] + (value.real * c.real if k % 2 == 0 else value.imag * -c.imag)
    return total
