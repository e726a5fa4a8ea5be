"""The flattest extinction with given Fourier coefficients: constant on a few intervals, 0 elsewhere.

Among all extinctions between 0 and a bound that have the coefficients c_0 … c_K there is exactly one at the least
bound for which there are any: it is the bound on at most K intervals, 0 elsewhere (Markov's problem with a bound).
A slab comes back as that slab, up to K thin layers as thin layers.
"""

from __future__ import annotations

from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

__all__ = ["Intervals", "intervals", "least_bound", "one_slab"]

Reals: TypeAlias = NDArray[np.float64]
Complexes: TypeAlias = NDArray[np.complex128]
Mask: TypeAlias = NDArray[np.bool_]

HIGHEST = 1024.0  # bound per unit of optical depth: what is thinner than 1/1024 of the ray is that wide
HALVINGS = 40  # of the logarithm of the bound: seven digits less than float64 has, and than a layer's ends show
ENDING = 1e-8  # what is left to explain, as a share, where a coefficient counts as explained by those before
ASIDE = np.exp(0.618034j * np.pi)  # turned by its powers, poles that are none lie apart from each other
ROOT_STEPS = 40  # of Aberth's method at most, whose order is 3: some ten do, unless roots lie close together
SETTLED = 1e-8  # the step that ends them: the next would be of rounding


class Intervals(NamedTuple):
    """Extinction that is constant on intervals of a circle of length 1.

    Attributes
    ----------
    bound : ndarray, shape (n,) [1]
        The extinction on the intervals, per unit of optical depth; its inverse is their length in all.
    start, length : ndarray, shape (K, n) [1]
        Where each begins, in [0, 1), and how long it is. It may go on beyond 1, at 0; it may be empty.
    spread : ndarray, shape (n,) [1]
        0 if one interval is all there is, at most 1: 1 − |γ_1|², γ_1 the first reflection coefficient.
    """

    bound: Reals
    start: Reals
    length: Reals
    spread: Reals


def intervals(moments: Complexes) -> Intervals:
    """The extinction of the least bound that has given coefficients.

    Parameters
    ----------
    moments : ndarray of complex128, shape (K + 1, n) [1]
        ∫σ(x) e^{−2πikx} dx over the whole depth, k = 0 … K ≥ 1, the first being 1.

    Returns
    -------
    Intervals

    Notes
    -----
    With F(z) = c_0 + 2Σ c_k z^k + …, whose real part on the unit circle is σ, and a bound L, −i·exp(iπF(z)/L) has a
    positive real part iff 0 ≤ σ ≤ L [Akhiezer 1962; Krein 1977]. Its Taylor coefficients up to K follow from c; they
    are those of such a function iff Schur's reflection coefficients γ_1 … γ_K are below 1 in size, so L is found by
    bisection. At the least L the last one is 1 in size and the function rational: its poles on the circle are where
    the intervals begin, its zeros where they end, both roots of para-orthogonal polynomials [Simon 2005]. What is left
    to explain after each is Π(1 − |γ|²); where next to nothing is, as after the first of a slab, the further γ are
    rounding, are not looked at, and count as 1 in size.

    Coefficients that no extinction up to `HIGHEST` has (thin layers, rounded coefficients) are drawn to those of a
    uniform extinction until there is one.

    Examples
    --------
    >>> k = np.arange(4)
    >>> slab = np.sinc(0.25 * k) * np.exp(-2j * np.pi * k * 0.5)
    >>> found = intervals(slab[:, None])
    >>> round(float(found.bound[0]), 6), round(float(found.length.sum()), 6), round(float(found.spread[0]), 6)
    (4.0, 0.25, 0.0)
    """
    drawn = _drawn(moments)
    bound = least_bound(drawn)
    reflection, left, first = _reflections(drawn, bound)
    poles, zeros = _polynomials(_on_circle(reflection, left <= ENDING), first)
    start, stop = (np.sort(np.angle(_roots(each)) / (2.0 * np.pi) % 1.0, axis=0) for each in (poles, zeros))
    return Intervals(bound, start, _lengths(start, stop, 1.0 / bound), np.maximum(left[0], 0.0))


def one_slab(moments: Complexes) -> tuple[Reals, Reals, Reals]:
    """The slab that has the first coefficient, and how far it is from having the others.

    Parameters
    ----------
    moments : ndarray of complex128, shape (K + 1, n) [1]
        As for `intervals`.

    Returns
    -------
    start, length : ndarray, shape (n,) [1]
        Where it begins, in [0, 1), and how long it is.
    residual : ndarray, shape (n,) [1]
        The largest distance of a coefficient.

    Notes
    -----
    c_k = sinc(kw)·e^{−2πikm} of a slab of length w about m: |c_1| tells w, by halving, and its argument m.

    Examples
    --------
    >>> k = np.arange(4)
    >>> start, length, residual = one_slab((np.sinc(0.25 * k) * np.exp(-1j * np.pi * k))[:, None])
    >>> round(float(start[0]), 9), round(float(length[0]), 9), bool(residual[0] < 1e-9)
    (0.375, 0.25, True)
    """
    low, high = np.zeros(moments.shape[1]), np.ones(moments.shape[1])
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        wide = np.sinc(middle) < np.abs(moments[1])
        high, low = np.where(wide, middle, high), np.where(wide, low, middle)
    length = np.maximum(high, 1.0 / HIGHEST)
    centre = -np.angle(moments[1]) / (2.0 * np.pi)
    k = np.arange(len(moments))[:, None]
    slab = np.sinc(k * length) * np.exp(-2j * np.pi * k * centre)
    return np.mod(centre - 0.5 * length, 1.0), length, np.asarray(np.abs(slab - moments).max(axis=0))


def least_bound(moments: Complexes) -> Reals:
    """The least bound of an extinction that has given coefficients.

    Parameters
    ----------
    moments : ndarray of complex128, shape (K + 1, n) [1]
        As for `intervals`.

    Returns
    -------
    ndarray, shape (n,) [1]
        At most `HIGHEST`, also where none has them.

    Examples
    --------
    >>> slab = np.sinc(0.25 * np.arange(4)) + 0j
    >>> least_bound(slab[:, None]).round(6).tolist()
    [4.0]
    """
    low, high = np.zeros(moments.shape[1]), np.full(moments.shape[1], np.log(HIGHEST))
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        feasible = _feasible(moments, np.exp(middle))
        high, low = np.where(feasible, middle, high), np.where(feasible, low, middle)
    return np.asarray(np.exp(high))


def _drawn(moments: Complexes) -> Complexes:
    """Coefficients mixed with as much of a uniform extinction's as brings the bound below the highest."""
    outside = np.flatnonzero(~_feasible(moments, np.full(moments.shape[1], HIGHEST)))
    result = moments.copy()
    low, high = np.zeros(outside.size), np.ones(outside.size)
    for _ in range(HALVINGS if outside.size else 0):
        middle = 0.5 * (low + high)
        result[1:, outside] = moments[1:, outside] * (1.0 - middle)
        feasible = _feasible(result[:, outside], np.full(outside.size, HIGHEST))
        high, low = np.where(feasible, middle, high), np.where(feasible, low, middle)
    result[1:, outside] = moments[1:, outside] * (1.0 - high)
    return result


def _reflections(moments: Complexes, bound: Reals) -> tuple[Complexes, Reals, Complexes]:
    """Reflection coefficients γ of −i·exp(iπF/L), what is left after each, Π(1 − |γ|²), and the value at 0.

    From where nothing is left, or less, γ is 0.
    """
    count = len(moments) - 1
    slope = (2j * np.pi * np.arange(count + 1)[:, None] / bound) * moments
    taylor = np.empty_like(slope)
    taylor[0] = -1j * np.exp(1j * np.pi / bound)
    for k in range(1, count + 1):
        taylor[k] = np.sum(slope[1:k + 1] * taylor[k - 1::-1] if k > 1 else slope[1:2] * taylor[:1], axis=0) / k
    above, below = taylor[1:], taylor[:-1].copy()
    below[0] = 2.0 * taylor[0].real
    reflection, left = np.zeros_like(above), np.ones(above.shape)
    for k in range(count):
        live = left[k - 1 if k else 0] > ENDING
        gamma: Complexes = np.divide(above[0], below[0], out=reflection[k], where=live)
        left[k:] *= 1.0 - (gamma.real**2 + gamma.imag**2)
        above, below = above[1:] - gamma * below[1:], below[:-1] - np.conj(gamma) * above[:-1]
    return reflection, left, taylor[0]


def _feasible(moments: Complexes, bound: Reals) -> Mask:
    """Whether some extinction between 0 and the bound has the coefficients, as far as they are not explained."""
    _, left, _ = _reflections(moments, bound)
    feasible, going = np.ones(left.shape[1], bool), np.ones(left.shape[1], bool)
    for each in left:
        feasible &= ~going | (each > 0.0)
        going &= each > ENDING
    return feasible


def _on_circle(reflection: Complexes, ends: Mask) -> Complexes:
    """The coefficients up to the end, of which the last is made 1 in size.

    Any beyond it of size 1 add a pole and a zero in one place each: an interval, or a gap, of no length.
    """
    result, ended = reflection.copy(), np.zeros(reflection.shape[1], bool)
    for k in range(len(reflection)):
        size = np.abs(reflection[k])
        last = ends[k] | (k == len(reflection) - 1)
        unit = np.where(size > 0.0, reflection[k] / np.where(size > 0.0, size, 1.0), 1.0)
        result[k] = np.where(ended, ASIDE ** (k + 1) ** 2, np.where(last, unit, reflection[k]))
        ended |= last
    return result


def _polynomials(reflection: Complexes, first: Complexes) -> tuple[Complexes, Complexes]:
    """Coefficients, lowest first, of the polynomials whose roots are the poles and the zeros."""
    one, nothing = np.ones_like(first)[None], np.zeros_like(first)[None]
    phi, psi = one, one
    for gamma in reflection:
        turned_phi, turned_psi = np.conj(phi[::-1]), np.conj(psi[::-1])
        phi = np.concatenate([nothing, phi]) - np.conj(gamma) * np.concatenate([turned_phi, nothing])
        psi = np.concatenate([nothing, psi]) + np.conj(gamma) * np.concatenate([turned_psi, nothing])
    return phi, first.real * np.conj(psi[::-1]) + 1j * first.imag * np.conj(phi[::-1])


def _roots(polynomial: Complexes) -> Complexes:
    """All roots of polynomials whose roots lie on the unit circle, by Aberth's method [Aberth 1973]."""
    count = len(polynomial) - 1
    # From places without symmetry: those of coefficients that are real would keep the iteration on a line.
    z: Complexes = np.exp(2j * np.pi * (np.arange(count)[:, None] + 0.123) / count) * np.ones_like(polynomial[:1])
    for _ in range(ROOT_STEPS):
        value, slope = np.broadcast_to(polynomial[-1], z.shape), np.zeros_like(z)
        for each in polynomial[-2::-1]:
            slope = slope * z + value
            value = value * z + each
        newton = np.divide(value, slope, out=np.zeros_like(z), where=slope != 0.0)
        push = np.zeros_like(z)
        for other in z:
            apart = z - other
            push += np.divide(1.0, apart, out=np.zeros_like(z), where=apart != 0.0)
        divisor = 1.0 - newton * push
        step = np.divide(newton, divisor, out=np.zeros_like(z), where=divisor != 0.0)
        z = z - step
        if np.abs(step).max(initial=0.0) < SETTLED:
            break
    return z


def _lengths(start: Reals, stop: Reals, whole: Reals) -> Reals:
    """Lengths from sorted starts to the stops that follow them, whose sum is known.

    Which stop follows which start hangs on rounding where both coincide. The sum does not: it is off by a whole
    number if they are counted from the wrong one.
    """
    count = len(start)
    shift = np.round(whole - (stop - start).sum(axis=0)).astype(int)
    index = np.arange(count)[:, None] + shift
    length = np.maximum(np.take_along_axis(stop, index % count, axis=0) + index // count - start, 0.0)
    total = length.sum(axis=0)
    return np.asarray(length * (whole / np.where(total > 0.0, total, 1.0)))
