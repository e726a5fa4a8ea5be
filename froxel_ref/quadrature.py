"""Adaptive Gauss–Kronrod quadrature over many intervals at once.

A pool of intervals is worked on in rounds: every live interval is evaluated with the 15-point rule in one
vectorised call, the sums of each owner (a ray, say) are formed, and the intervals whose share of the
owner's error is too large are split. Nothing here knows what is integrated.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

__all__ = ["GAUSS_WEIGHTS", "KRONROD_WEIGHTS", "NODES", "Estimate", "Pool", "Split", "Totals",
           "integrate_pool", "kronrod"]

Array: TypeAlias = NDArray[np.floating[Any]]
Integers: TypeAlias = NDArray[np.integer[Any]]

# The (7, 15) pair of [Piessens 1983, QUADPACK, qk15]: abscissae on (0, 1), weights of both rules.
_HALF = np.array([0.991455371120812639206854697526329, 0.949107912342758524526189684047851,
                  0.864864423359769072789712788640926, 0.741531185599394439863864773280788,
                  0.586087235467691130294144838258730, 0.405845151377397166906606412076961,
                  0.207784955007898467600689403773245])
_KRONROD = np.array([0.022935322010529224963732008058970, 0.063092092629978553290700663189204,
                     0.104790010322250183839876322541518, 0.140653259715525918745189590510238,
                     0.169004726639267902826583426598550, 0.190350578064785409913256402421014,
                     0.204432940075298892414161999234649])
_GAUSS = np.array([0.0, 0.129484966168869693270611432679082, 0.0, 0.279705391489276667901467771423780,
                   0.0, 0.381830050505118944950369775488975, 0.0])

NODES: Array = np.concatenate([-_HALF, [0.0], _HALF[::-1]])
"""The 15 abscissae on (−1, 1), ascending."""
KRONROD_WEIGHTS: Array = np.concatenate([_KRONROD, [0.209482141084727828012999174891714], _KRONROD[::-1]])
"""Weights of the 15-point rule, exact for polynomials up to degree 22 (23 by symmetry)."""
GAUSS_WEIGHTS: Array = np.concatenate([_GAUSS, [0.417959183673469387755102040816327], _GAUSS[::-1]])
"""Weights of the embedded 7-point Gauss rule at the same abscissae (0 at the others)."""
for _table in (NODES, KRONROD_WEIGHTS, GAUSS_WEIGHTS):
    _table.setflags(write=False)

# Null rules: orthonormal under the sum over the nodes, rule d is 0 for polynomials below degree d, here
# d = 9…14, as strong as the 15-point rule. They see how fast the integrand's expansion falls off.
_NULL = np.linalg.qr(np.polynomial.legendre.legvander(NODES, 14))[0][:, 9:]
_NULL *= np.sqrt(np.sum(KRONROD_WEIGHTS**2))
_RULES = np.concatenate([KRONROD_WEIGHTS[:, np.newaxis], GAUSS_WEIGHTS[:, np.newaxis], _NULL], axis=1)

# Rounding of a sum of 15 products and of the integrand behind it, in units of the integral of |f|. The
# integrand's own rounding (a phase function, an exponential, an attenuation) is some 10 ε.
ROUNDING = 32.0 * float(np.finfo(np.float64).eps)

TINY = float(np.finfo(np.float64).tiny)

# An interval whose halves would be this few ulp wide is not split again.
NARROWEST = 64.0 * float(np.finfo(np.float64).eps)


class Estimate(NamedTuple):
    """Integrals over intervals and their error estimates, each of shape (C, n)."""

    value: Array
    error: Array


class Pool(NamedTuple):
    """Intervals to integrate over.

    Attributes
    ----------
    owner : ndarray of int, shape (n,)
        Which total each belongs to.
    kind : ndarray of int, shape (n,)
        Passed to the integrand, for it to know what to evaluate.
    low, high : ndarray, shape (n,)
        Limits, low < high.
    """

    owner: Integers
    kind: Integers
    low: Array
    high: Array

    def take(self, which: NDArray[Any]) -> Pool:
        """The chosen intervals, in their order."""
        return Pool._make(column[which] for column in self)


class Totals(NamedTuple):
    """What the adaptive rule has reached for each owner.

    Attributes
    ----------
    value, error : ndarray, shape (C, owners)
        Integral and the sum of the error estimates.
    converged : ndarray of bool, shape (owners,)
        Whether every channel's error is within the tolerance.
    evaluations : ndarray of int, shape (owners,)
        Points at which the integrand was evaluated.
    """

    value: Array
    error: Array
    converged: NDArray[np.bool_]
    evaluations: Integers


Split: TypeAlias = Callable[[Pool], Array]
"""Where to split intervals: points strictly inside them, or NaN for the middle."""


def kronrod(values: Array, half: Array) -> Estimate:
    """Apply the 15-point rule and estimate its error by the embedded 7-point one.

    Parameters
    ----------
    values : ndarray, shape (C, n, 15)
        The integrand at the nodes of each interval.
    half : ndarray, shape (n,)
        Half the intervals' lengths.

    Returns
    -------
    Estimate
        Shapes (C, n).

    Notes
    -----
    The error is |K₁₅ − G₇| plus a floor for rounding. QUADPACK shrinks that difference by its power of 3/2;
    here it stays as it is: the error of the weaker rule, far above that of the stronger one wherever the
    integrand is smooth. At a kink or a jump both rules may be wrong by the same amount. So null rules are
    taken in pairs, E = √(n_d² + n_{d−1}²) for d = 14, 12, 10 [Berntsen 1991]: where these do not
    fall off, r = max(E₁₄/E₁₂, E₁₂/E₁₀) near 1, the largest of them counts too, by the factor min(1, 2r)⁴.

    Examples
    --------
    >>> values = np.exp(NODES)[np.newaxis, np.newaxis]
    >>> print(kronrod(values, np.ones(1)).value[0, 0] - 2.0 * np.sinh(1.0))
    0.0
    """
    sums = values @ _RULES
    floor = ROUNDING * (np.abs(values) @ KRONROD_WEIGHTS)
    pairs = [np.hypot(sums[..., i], sums[..., i + 1]) for i in (6, 4, 2)]
    ratio = np.maximum(pairs[0] / (pairs[1] + floor + TINY), pairs[1] / (pairs[2] + floor + TINY))
    rough = np.maximum(np.maximum(pairs[0], pairs[1]), pairs[2]) * np.minimum(2.0 * ratio, 1.0) ** 4
    difference = np.maximum(np.abs(sums[..., 0] - sums[..., 1]), rough)
    return Estimate(sums[..., 0] * half, (difference + floor) * half)


def integrate_pool(evaluate: Callable[[Pool], Estimate], pool: Pool, owners: int, *, rtol: float,
                   channels: int = 1, split: Split | None = None, limit_rounds: int = 60,
                   limit_intervals: int = 4000) -> Totals:
    """Integrate until each owner's error is a given share of its integral.

    Parameters
    ----------
    evaluate : callable
        Integral and error over each interval of a pool, shapes (channels, n); see `kronrod`.
    pool : Pool
        The first intervals; breaks of the integrand should be their ends.
    owners : int
        How many totals there are.
    rtol : float
        Wanted error as a share of the integral, in every channel.
    channels : int
        Of the integrand.
    split : callable, optional
        Where to split; the middle unless given.
    limit_rounds, limit_intervals : int
        Rounds of splitting, and intervals that one owner may have. Who reaches a limit is not converged.

    Returns
    -------
    Totals

    Notes
    -----
    In each round the owners whose error is too large split the intervals with more than half of an even
    share of the tolerance: at least one, since the largest error is above the mean. Sums run over an
    owner's intervals in an order that does not depend on the other owners.

    Examples
    --------
    >>> def root(pool):
    ...     half = 0.5 * (pool.high - pool.low)
    ...     x = 0.5 * (pool.low + pool.high)[:, None] + half[:, None] * NODES
    ...     return kronrod(np.sqrt(x)[None], half)
    >>> one = Pool(np.zeros(1, np.intp), np.zeros(1, np.intp), np.zeros(1), np.ones(1))
    >>> totals = integrate_pool(root, one, 1, rtol=1e-9)
    >>> bool(totals.converged[0]), float(totals.value[0, 0].round(9))
    (True, 0.666666667)
    """
    done = Totals(np.zeros((channels, owners)), np.zeros((channels, owners)), np.zeros(owners, bool),
                  np.zeros(owners, np.intp))
    evaluations = done.evaluations
    estimate = evaluate(pool)
    evaluations += NODES.size * np.bincount(pool.owner, minlength=owners)
    for turn in range(limit_rounds + 1):
        value, error = (_sums(part, pool.owner, owners) for part in estimate)
        allowed = rtol * np.abs(value)
        met = np.asarray((np.isfinite(value) & (error <= allowed)).all(axis=0))
        chosen = _chosen(pool, estimate.error, allowed, ~met, limit_intervals)
        if not chosen.any() or turn == limit_rounds:
            break
        halves, known = _halves(pool.take(chosen), split)
        evaluations += NODES.size * np.bincount(halves.owner, minlength=owners)
        fresh = _inherit(evaluate(halves), Estimate(*(part[:, chosen] for part in estimate)), known)
        pool = Pool._make(np.concatenate([a[~chosen], b]) for a, b in zip(pool, halves, strict=True))
        estimate = Estimate._make(np.concatenate([a[:, ~chosen], b], axis=1)
                                  for a, b in zip(estimate, fresh, strict=True))
    return Totals(value, error, met, evaluations)


def _inherit(halves: Estimate, whole: Estimate, known: NDArray[np.bool_]) -> Estimate:
    """No half claims less than half of what the whole is now known to have been wrong by.

    Where the integrand is smooth that is far below the halves' own estimates; a kink so near to the end of
    an interval that no node lay beyond it shows here. Not where the interval was split at a known break.
    """
    wrong = np.where(known, 0.0, np.abs(whole.value - halves.value[:, ::2] - halves.value[:, 1::2]))
    return Estimate(halves.value, np.maximum(halves.error, 0.5 * np.repeat(wrong, 2, axis=1)))


def _sums(part: Array, owner: Integers, owners: int) -> Array:
    return np.stack([np.bincount(owner, weights=channel, minlength=owners) for channel in part])


def _chosen(pool: Pool, error: Array, allowed: Array, live: NDArray[np.bool_],
            limit: int) -> NDArray[np.bool_]:
    """The intervals to split."""
    count = np.bincount(pool.owner, minlength=live.size)
    share = 0.5 * allowed / np.maximum(count, 1)
    wide = pool.high - pool.low > NARROWEST * np.maximum(np.abs(pool.low), np.abs(pool.high))
    large = (error > share[:, pool.owner]).any(axis=0)
    result: NDArray[np.bool_] = (live & (count < limit))[pool.owner] & wide & large
    return result


def _halves(pool: Pool, split: Split | None) -> tuple[Pool, NDArray[np.bool_]]:
    """Both parts of each interval, side by side, and which were split at a known break."""
    middle = 0.5 * (pool.low + pool.high)
    inside = np.zeros(middle.shape, bool)
    if split is not None:
        wanted = split(pool)
        inside = np.asarray((wanted > pool.low) & (wanted < pool.high))
        middle = np.where(inside, wanted, middle)
    low, high = (np.stack(pair, axis=1).reshape(-1) for pair in ((pool.low, middle), (middle, pool.high)))
    return Pool(np.repeat(pool.owner, 2), np.repeat(pool.kind, 2), low, high), inside
