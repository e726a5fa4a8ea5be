"""Moment-based transmittance from power moments: a ray's optical depth, and a few averages of powers of its depth.

With z = 2d − 1 a ray holds b_k = Σ τ_i z_i^k for k = 0 … n, which can be gathered in any order. What has these moments
lets through, up to z, an amount between two bounds, which are found and mixed [Peters 2015; Münstermann 2018].
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from froxel_ref.absorbers import Absorbers, inverse_lengths
from froxel_ref.arrays import Field
from froxel_ref.moment_storage import BIASES, Bias, known_bias, normalised_moments
from froxel_ref.real_roots import real_roots
from froxel_ref.records import InputError, shown

__all__ = ["OVERESTIMATION", "power_moments", "transmittance"]

Array: TypeAlias = NDArray[np.floating[Any]]

# How far the mixture lies from the lower bound of the optical depth to the upper one [Münstermann 2018].
OVERESTIMATION = 0.25
# Least spread of a distribution's orthogonal polynomials: distributions of fewer points than the moments allow have 0.
LEAST_SPREAD = 1e-7
# How many points a warped stretch's rule has more than a straight one's.
WARPED_NODES = 6
# A node farther away holds nothing that float64 can tell from 0.
FARTHEST = 1e20
# Elements a block of depths has, so that its arrays stay in the cache.
BLOCK = 1 << 15


def power_moments(absorbers: Absorbers, *, count: int = 4, ratio: float = 1.0) -> Array:
    """Power moments of what lies on rays.

    Parameters
    ----------
    absorbers : Absorbers
        n stretches a ray, rays along the other axes.
    count : int
        The highest power, even; published: 4, 6 or 8.
    ratio : float [1]
        Far over near depth: above 1, depth is warped by `warped`.

    Returns
    -------
    ndarray, shape (1 + count, …) [1]
        b_0, the whole optical depth, then b_1 … b_count. Add those of several calls to gather more.

    Raises
    ------
    InputError
        An odd or too small count; a ratio below 1.

    Notes
    -----
    b_k = ∫σ z^k [Münstermann 2018]. Stretches are taken at Gauss–Legendre points: exact for linear extinction times
    powers up to count, without cancellation between their ends. Error: below (2·count + 40) ε·b_0, plus that of a sum
    of n. Warped, the rule is no longer exact, but has 6 points more, and an error below 1e-10·b_0 up to a ratio of 1e4.

    Examples
    --------
    >>> power_moments(Absorbers(np.zeros(1), np.ones(1), np.array([3.0]), np.zeros(1))).round(12).tolist()
    [3.0, 0.0, 1.0, 0.0, 0.6]
    """
    if count < 2 or count % 2:
        raise InputError("count", f"is {shown(count)}, must be even and at least 2")
    totals: list[Array] = []
    for z, amount in _nodes(absorbers, count // 2 + 1, ratio):
        power = np.broadcast_to(amount, np.broadcast_shapes(amount.shape, z.shape))
        sums = [np.sum(power, axis=0)]
        for _k in range(count):
            power = power * z
            sums.append(np.sum(power, axis=0))
        totals.append(np.stack(sums))
    whole: Array = np.sum(totals, axis=0)
    return whole


def _nodes(absorbers: Absorbers, nodes: int, ratio: float) -> Iterator[tuple[Array, Array]]:
    """Points, as z and optical depth, that stand for stretches: of Gauss–Legendre's rule in the warped depth."""
    start, stop, tau, rise = absorbers
    near = 2.0 * warped(start, ratio) - 1.0
    if inverse_lengths(absorbers)[0].all():
        yield near, tau
        return
    if ratio > 1.0:
        # Distance grows by a factor 1 + g over a stretch, and as e^{sl} with the share s of its warped length.
        g = (stop - start) / (start + 1.0 / (ratio - 1.0))
        length = np.log1p(g)
        thin = length < np.finfo(length.dtype).tiny
        length, g = np.where(thin, 0.0, length), np.where(thin, 1.0, g)
        far: Array = length * (2.0 / math.log(ratio))
        nodes += WARPED_NODES
    else:
        far = 2.0 * (stop - start)
    for u, weight in zip(*np.polynomial.legendre.leggauss(nodes), strict=True):
        s, part = (tau.dtype.type(0.5 * v) for v in (1.0 + u, weight))
        share: Any = s
        amount: Any = part
        if ratio > 1.0:
            share = np.where(thin, s, np.expm1(s * length) / g)
            amount = np.where(thin, 1.0, np.exp(s * length) * (length / g)) * part
        yield near + s * far, (tau + rise * (share - tau.dtype.type(0.5))) * amount


def warped(depth: Field, ratio: float) -> Array:
    """Depth on a scale that resolves what is near better.

    Parameters
    ----------
    depth : ndarray [1]
        In [0, 1].
    ratio : float [1]
        r, far over near.

    Returns
    -------
    ndarray, same shape [1]
        In [0, 1].

    Raises
    ------
    InputError
        A ratio below 1.

    Notes
    -----
    ln(1 + d(r − 1))/ln r: the logarithm of a distance that grows from 1 to r [Münstermann 2018]. 1: as it is.

    Examples
    --------
    >>> warped(np.array([0.0, 1 / 11, 1.0]), 100.0).round(6).tolist()
    [0.0, 0.5, 1.0]
    """
    if not ratio >= 1.0:
        raise InputError("ratio", f"is {shown(ratio)}, must be at least 1")
    return depth if ratio == 1.0 else np.asarray(np.log1p(depth * (ratio - 1.0)) / math.log(ratio), depth.dtype)


def transmittance(encoded: Field, depth: Field, *, storage: str | None = None, bias: Bias | None = None,
                  overestimation: float = OVERESTIMATION, ratio: float = 1.0) -> Array:
    """What passes up to a point of the ray, from its moments.

    Parameters
    ----------
    encoded : ndarray, shape (1 + count, …) [1]
        From `power_moments` or `moment_storage.stored_moments`.
    depth : ndarray, shape (m, …) [1]
        Broadcastable to m depths on each ray; outside [0, 1] the end's value is taken.
    storage
        As given to `stored_moments`.
    bias : Bias, optional
        What is mixed in. Default: that of the storage, float32's if there is none.
    overestimation : float [1]
        0: the lower bound of the optical depth, 1: the upper one.
    ratio
        As given to `power_moments`.

    Returns
    -------
    ndarray, shape (m, …) [1]
        In [0, 1]. If the moments are those of something, as stored, and the bias is the storage's, it never rises with
        the depth, but for rounding: by 1e-9 at most.

    Raises
    ------
    InputError
        A number of moments without a bias of its own, and none given; an unknown storage.

    Notes
    -----
    One distribution of count/2 + 1 points has these moments and a point at z. What it has before z, and that with
    the point at z, are the sharpest bounds there are [Peters 2015]. With the orthonormal polynomials p_j of the
    moments, the other points are the roots of K(z, ·) = Σ p_j(z) p_j(·), and a point at x holds 1/K(x, x). Roots are
    taken in y = 1/(x − z) here, so that none is infinite: the leading coefficient is K(z, z) ≥ 1, and a point lies
    before z iff its y is negative. The recurrence of the p_j is kept to what distributions on [−1, 1] have, so that
    the result holds its bounds whatever rounding did to the moments. All in float64: the Hankel matrix is nearly
    singular.

    At depth 1 some of the optical depth may still lie behind: exp(−b_0) is what passes in all.

    Examples
    --------
    >>> layer = Absorbers(*(np.array([v]) for v in (0.5, 0.5, 4.0, 0.0)))
    >>> transmittance(power_moments(layer), np.array([0.0, 0.45, 0.55, 1.0])).round(3).tolist()
    [1.0, 1.0, 0.018, 0.018]
    """
    dtype = np.result_type(encoded, depth)
    whole, shares = normalised_moments(np.asarray(encoded, np.float64), storage)
    if bias is None:
        bias = known_bias(BIASES, storage, len(shares))
    z = 2.0 * warped(np.clip(np.asarray(depth, np.float64), 0.0, 1.0), ratio) - 1.0
    centre, spread = _recurrence(_biased(shares, bias))
    return in_blocks(lambda some: _before(centre, spread, some, overestimation), z, whole).astype(dtype, copy=False)


def in_blocks(before: Callable[[Array], Array], place: Array, whole: Array) -> Array:
    """exp(−whole·before(place)), a few rows of places at a time."""
    rows = max(1, BLOCK // max(1, whole.size))
    shares = [before(place[i:i + rows]) for i in range(0, len(place), rows)]
    with np.errstate(under="ignore"):
        return np.asarray(np.exp(-whole * np.concatenate(shares)))


def _biased(shares: Array, bias: Bias) -> Array:
    moments = np.reshape(bias.moments, (-1, *(1,) * (shares.ndim - 1)))
    one = np.ones((1, *shares.shape[1:]))
    return np.concatenate([one, shares + bias.weight * (moments - shares)])


def _recurrence(moments: Array) -> tuple[Array, Array]:
    """The recurrence of the orthonormal polynomials, p_{j+1} = ((z − a_j) p_j − b_j p_{j−1})/b_{j+1}.

    By Cholesky factorisation of the Hankel matrix [Peters 2015], a in [−1, 1] and b in [LEAST_SPREAD, 1] as those of
    distributions on [−1, 1] are.
    """
    size = len(moments) // 2 + 1
    factor = np.zeros((size, size, *moments.shape[1:]))
    centre, spread = np.empty((2, size, *moments.shape[1:]))
    spread[0] = 1.0
    for j in range(size):
        rest = moments[2 * j] - np.sum(factor[j, :j] ** 2, axis=0)
        least = LEAST_SPREAD * (factor[j - 1, j - 1] if j else 1.0)
        factor[j, j] = np.sqrt(np.maximum(rest, least * least))
        for i in range(j + 1, size):
            factor[i, j] = (moments[i + j] - np.sum(factor[i, :j] * factor[j, :j], axis=0)) / factor[j, j]
        if j:
            spread[j] = np.clip(factor[j, j] / factor[j - 1, j - 1], LEAST_SPREAD, 1.0)
    for j in range(size - 1):
        back = factor[j, j - 1] / factor[j - 1, j - 1] if j else 0.0
        centre[j] = np.clip(factor[j + 1, j] / factor[j, j] - back, -1.0, 1.0)
    return centre[:-1], spread


def _before(centre: Array, spread: Array, z: Array, overestimation: float) -> Array:
    """The share of the optical depth that lies before z."""
    size = len(spread)
    # Of each polynomial at z + h, the coefficients of h⁰ … h^j.
    older: list[Any] = []
    old: list[Any] = [np.ones_like(z)]
    kernel = [np.ones(np.broadcast_shapes(z.shape, spread.shape[1:]))] + [np.zeros(())] * (size - 1)
    for j in range(1, size):
        away, inverse = z - centre[j - 1], 1.0 / spread[j]
        new = [away * c for c in old] + [0.0]
        for k in range(j):
            new[k + 1] = new[k + 1] + old[k]
            if k < len(older):
                new[k] = new[k] - spread[j - 1] * older[k]
        older, old = old, [c * inverse for c in new]
        for k in range(j + 1):
            kernel[k] = kernel[k] + old[0] * old[k]
    y = real_roots(np.stack([np.broadcast_to(c, kernel[0].shape) for c in kernel]))
    held = 1.0 / _christoffel(centre, spread, z, y)
    here = 1.0 / kernel[0]
    low = np.sum(held * (y < 0.0), axis=0)
    return np.asarray((low + overestimation * here) / (np.sum(held, axis=0) + here))


def _christoffel(centre: Array, spread: Array, z: Array, y: Array) -> Array:
    """K(x, x) at x = z + 1/y."""
    near = np.abs(y) * FARTHEST > 1.0
    x = z + np.where(near, 1.0 / np.where(near, y, 1.0), FARTHEST)
    older, old = np.zeros_like(x), np.ones_like(x)
    total = old
    for j in range(1, len(spread)):
        older, old = old, ((x - centre[j - 1]) * old - spread[j - 1] * older) * (1.0 / spread[j])
        total = total + old * old
    return total
