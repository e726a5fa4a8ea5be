"""Fourier opacity maps: transmittance along a ray as a few Fourier coefficients of its extinction.

Depth along the ray is normalised, d in [0, 1]. Coefficients are sums over what lies on the ray, so they can be
gathered in any order [Jansen 2010; Dörries 2020, §3.3.2].
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray
from scipy.special import spherical_jn

from froxel_ref.arrays import Field
from froxel_ref.compensated import two_product, two_sum

__all__ = ["even_coefficients", "falling_coefficients", "opacity_depth", "optical_depth", "sample_coefficients",
           "segment_coefficients", "transmittance"]

Array: TypeAlias = NDArray[np.floating[Any]]

# The thesis's lower bound on a sample's transmittance, 11.5 of optical depth (D8) [Dörries 2020, listing 3.16].
PUBLISHED_LEAST_TRANSMITTANCE = 1e-5


def opacity_depth(opacity: Field, *, least_transmittance: float = 0.0) -> Array:
    """The optical depth of what has an opacity.

    Parameters
    ----------
    opacity : ndarray [1]
        In [0, 1].
    least_transmittance : float [1]
        Lower bound on 1 − opacity. Published: 1e-5, which caps the optical depth at 11.5 (D8).

    Returns
    -------
    ndarray, same shape [1]
        −ln(1 − opacity); infinite for opacity 1 unless there is a bound.

    Notes
    -----
    As −log1p(−opacity), which keeps the digits of small opacities.

    Examples
    --------
    >>> opacity_depth(np.array([1e-20, 0.5])).tolist()
    [1e-20, 0.6931471805599453]
    >>> float(opacity_depth(np.array(1.0), least_transmittance=1e-5).round(4))
    11.5129
    """
    with np.errstate(divide="ignore"):
        depth = -np.log1p(-opacity)
    return np.asarray(np.minimum(depth, -np.log(least_transmittance)) if least_transmittance else depth)


# --- sines and cosines of multiples -----------------------------------------------------------------

# Whose square root is below any length that counts, and whose inverse is a float32.
TINY = 1e-37

# 2π to twice the digits.
TWO_PI = float(2.0 * np.pi), 2.4492935982947064e-16


def _turn(d: Field, low: Field | float = 0.0) -> tuple[Array, Array]:
    """sin and cos of 2π(d + low), low being tiny: exactly 0 and ±1 at quarters.

    The angle is at most an eighth of a turn, so its own rounding is known and small, and is made good to first
    order; a harmonic k would multiply it by k.
    """
    quarter = np.round(4.0 * d)
    rest = d - 0.25 * quarter
    if d.dtype == np.float64:
        angle, error = two_product(np.asarray(TWO_PI[0]), np.asarray(rest, np.float64))
        error = error + (TWO_PI[1] * rest + TWO_PI[0] * low)
    else:
        angle, error = TWO_PI[0] * rest, np.zeros((), d.dtype)
    sine, cosine = np.sin(angle), np.cos(angle)
    sine, cosine = sine + error * cosine, cosine - error * sine
    odd, behind = quarter % 2.0 == 1.0, quarter % 4.0 >= 2.0
    sine, cosine = np.where(odd, cosine, sine), np.where(odd, -sine, cosine)
    return np.where(behind, -sine, sine) + 0.0, np.where(behind, -cosine, cosine) + 0.0


def _multiples(sine: Array, cosine: Array, count: int) -> Iterator[tuple[int, Array, Array]]:
    """k and the sine and cosine of k times an angle, for k = 1 … count, turned from one to the next.

    A turn adds one rounding to those of the first angle, so the k-th is off by about 2k ε, in size and not in
    proportion.
    """
    s, c = sine, cosine
    for k in range(1, count + 1):
        yield k, s, c
        s, c = s * cosine + c * sine, c * cosine - s * sine


# --- coefficients -----------------------------------------------------------------------------------


def sample_coefficients(depth: Field, tau: Field, *, harmonics: int = 3) -> Array:
    """Fourier coefficients of points of optical depth.

    Parameters
    ----------
    depth : ndarray, shape (n, …) [1]
        Where along the ray they lie, in [0, 1].
    tau : ndarray, shape (n, …) [1]
        Optical depth of each, finite.
    harmonics : int
        K; the thesis has 3.

    Returns
    -------
    ndarray, shape (2, K + 1, …) [1]
        a_k and b_k for k = 0 … K, summed over the first axis; b_0 is 0.

    Notes
    -----
    a_k = 2Σ τ_i cos 2πk d_i, b_k = 2Σ τ_i sin 2πk d_i [Dörries 2020, listing 3.16]. Error of the k-th: below
    (3k + n) ε·2Σ|τ_i|. Add the arrays of several calls to gather more.

    Examples
    --------
    >>> sample_coefficients(np.array([0.25]), np.array([1.5]), harmonics=2).round(12).tolist()
    [[3.0, 0.0, -3.0], [0.0, 3.0, 0.0]]
    """
    return _summed(depth, 0.0, [(2.0 * tau, None)], harmonics)


def segment_coefficients(start: Field, stop: Field, tau: Field, *, rise: Field | float = 0.0, harmonics: int = 3
                         ) -> Array:
    """Fourier coefficients of stretches of constant or linear extinction, exactly.

    Parameters
    ----------
    start, stop : ndarray, shape (n, …) [1]
        Where along the ray each begins and ends, 0 ≤ start ≤ stop ≤ 1.
    tau : ndarray, shape (n, …) [1]
        Optical depth of each.
    rise : ndarray, shape (n, …) [1]
        How much more extinction there is at the end than at the beginning, times the length: 0 for constant
        extinction, at most 2·tau in size if it is nowhere negative.
    harmonics : int
        K.

    Returns
    -------
    ndarray, shape (2, K + 1, …) [1]

    Notes
    -----
    With middle m and length δ, w = πkδ: 2∫σ e^{2πikx} dx = e^{2πikm}·(2τ·sin w/w + i·rise·j₁(w)), j₁ the spherical
    Bessel function (sin w/w − cos w)/w. No difference of sines is formed, so short stretches keep their digits; a
    stretch of length 0 is a point.

    Examples
    --------
    >>> whole = segment_coefficients(np.zeros(1), np.ones(1), np.array([2.0]))
    >>> bool(whole[0, 0] == 4.0), bool(np.abs(whole[:, 1:]).max() < 1e-15)
    (True, True)
    """
    length = stop - start
    linear = np.any(rise)
    terms: list[tuple[Field, Field | None]] = []
    for k in range(harmonics + 1):
        odd = rise * spherical_jn(1, np.pi * k * length).astype(length.dtype) if linear else None
        terms.append((2.0 * tau * np.sinc(k * length), odd))
    middle: Array = 0.5 * (start + stop)
    low: Field | float = 0.0
    if middle.dtype == np.float64:  # what the sum has lost counts k times in the k-th harmonic
        _, error = two_sum(np.asarray(start, np.float64), np.asarray(stop, np.float64))
        low = 0.5 * error
    return _summed(middle, low, terms, harmonics)


def falling_coefficients(start: Field, stop: Field, most: Field, slope: Field, *, harmonics: int = 3) -> Array:
    """Fourier coefficients of stretches of extinction that falls or rises exponentially, exactly.

    Parameters
    ----------
    start, stop : ndarray, shape (n, …) [1]
        Where along the ray each begins and ends, 0 ≤ start ≤ stop ≤ 1.
    most : ndarray, shape (n, …) [1]
        The extinction at the denser end times the whole depth range.
    slope : ndarray, shape (n, …) [1]
        q: extinction goes as exp(−q·d); above 0 it falls along the ray.
    harmonics : int
        K.

    Returns
    -------
    ndarray, shape (2, K + 1, …) [1]

    Notes
    -----
    From the denser end e inwards, over the length δ: 2·most·δ·e^{2πike}·φ(w), w = (−|q| ± 2πik)·δ and
    φ(w) = (e^w − 1)/w. Height fog along a light's ray is such a stretch. Error of the k-th: below (3k + 8) ε of
    its 2τ.

    Examples
    --------
    >>> half = np.log(2.0) * np.ones(1)  # ∫ 2^−x dx = 1/(2 ln 2)
    >>> bool(abs(falling_coefficients(np.zeros(1), np.ones(1), np.ones(1), half)[0, 0] * half[0] - 1.0) < 1e-15)
    True
    """
    falls = slope >= 0.0
    length = stop - start
    sign = np.where(falls, 1.0, -1.0).astype(length.dtype)
    x, scale = np.abs(slope) * length, 2.0 * most * length
    with np.errstate(under="ignore"):
        left, lost = np.exp(-x), -np.expm1(-x)
    ends = _multiples(*_turn(np.where(falls, start, stop)), harmonics)
    halves = _multiples(*_turn(0.5 * length), harmonics)
    total = [np.sum(scale * np.where(x > TINY, lost / np.maximum(x, TINY), 1.0), axis=0)]
    turned = [np.zeros_like(total[0])]
    for (k, sine, cosine), (_, s, c) in zip(ends, halves, strict=True):
        # φ = (e^w − 1)/w with w = −x + iy, of the half angle y/2, so that e^{iy} − 1 = 2i·s·e^{iy/2} keeps its digits.
        y = 2.0 * np.pi * k * length
        real, imaginary = -lost - left * (2.0 * s * s), left * (2.0 * s * c)
        over = 1.0 / np.maximum(x * x + y * y, TINY)
        still = over == 1.0 / TINY
        even = np.where(still, 1.0, (y * imaginary - x * real) * over)
        odd = np.where(still, 0.0, -(x * imaginary + y * real) * over) * sign
        total.append(np.sum(scale * (even * cosine - odd * sine), axis=0))
        turned.append(np.sum(scale * (even * sine + odd * cosine), axis=0))
    return np.stack([np.stack(total), np.stack(turned)])


def even_coefficients(start: Field, step: Field, tau: Field, *, harmonics: int = 3, filled: bool = True) -> Array:
    """Fourier coefficients of samples at even steps along rays, as a march takes them.

    Parameters
    ----------
    start : ndarray, shape (…) [1]
        Where the first sample lies.
    step : ndarray, shape (…) [1]
        From each to the next.
    tau : ndarray, shape (n, …) [1]
        Optical depth of each step.
    harmonics : int
        K.
    filled : bool
        Whether each stands for a stretch of constant extinction about it, a step long; else for a point.

    Returns
    -------
    ndarray, shape (2, K + 1, …) [1]
        Of the type of ``tau``.

    Notes
    -----
    2e^{2πikx}·Σ τ_j z^j with z = e^{2πik·step} by Horner's rule, times sin w/w, w = πk·step, for stretches: two
    passes a sample and harmonic, in float64. Error of the k-th: below (3k + 2n) ε·2Σ|τ_j|.

    Examples
    --------
    >>> uniform = even_coefficients(np.array(0.125), np.array(0.25), np.full(4, 0.5))
    >>> float(uniform[0, 0]), bool(np.abs(uniform[:, 1:]).max() < 1e-15)
    (4.0, True)
    """
    shape = np.broadcast_shapes(np.shape(start), np.shape(step), tau.shape[1:])
    result = np.zeros((2, harmonics + 1, *shape), tau.dtype)
    k = np.arange(1.0, harmonics + 1.0).reshape(-1, *(1,) * len(shape))
    wide = np.asarray(step, np.float64)
    z = np.exp(2j * np.pi * (k * wide))
    # Sample by sample, so that a ray's sum does not depend on the rays beside it.
    whole, total = np.zeros(shape), np.zeros((harmonics, *shape), np.complex128)
    for each in tau[::-1]:
        whole += each
        total *= z
        total += each
    total *= 2.0 * np.exp(2j * np.pi * np.mod(k * np.asarray(start, np.float64), 1.0))
    if filled:
        total *= np.sinc(k * wide)
    result[0, 0], result[0, 1:], result[1, 1:] = 2.0 * whole, total.real, total.imag
    return result


def _summed(middle: Field, low: Field | float, terms: Sequence[tuple[Field, Field | None]], harmonics: int) -> Array:
    """Σ e^{2πikm}(even + i·odd), m = middle + low; one term stands for all k."""
    def term(k: int) -> tuple[Field, Field | None]:
        return terms[k] if len(terms) > 1 else terms[0]

    even, _ = term(0)
    total = [np.sum(np.broadcast_to(even, np.broadcast_shapes(middle.shape, even.shape)), axis=0)]
    turned = [np.zeros_like(total[0])]
    for k, sine, cosine in _multiples(*_turn(middle, low), harmonics):
        even, odd = term(k)
        real, imaginary = even * cosine, even * sine
        if odd is not None:
            real, imaginary = real - odd * sine, imaginary + odd * cosine
        total.append(np.sum(real, axis=0))
        turned.append(np.sum(imaginary, axis=0))
    return np.stack([np.stack(total), np.stack(turned)])


# --- reconstruction ---------------------------------------------------------------------------------


def optical_depth(coefficients: Field, depth: Field, *, lanczos: bool = False) -> Array:
    """The optical depth up to a point of the ray, from its coefficients.

    Parameters
    ----------
    coefficients : ndarray, shape (2, K + 1, …) [1]
        From `sample_coefficients`, `segment_coefficients`, or sums of such.
    depth : ndarray, broadcastable with … [1]
        In [0, 1]; beyond it the end's value is taken.
    lanczos : bool
        Weight the k-th harmonic by sinc(k/(K + 1)), which rings less and is less sharp.

    Returns
    -------
    ndarray [1]
        0 at depth 0 and a_0/2, the whole, at depth 1, both exactly. In between it may fall, or be negative: a few
        harmonics ring.

    Notes
    -----
    a_0 d/2 + Σ a_k sin(2πkd)/(2πk) + Σ b_k (1 − cos 2πkd)/(2πk) [Dörries 2020, §3.3.2; Jansen 2010]. Of an
    extinction without harmonics above K it is the exact integral.

    Examples
    --------
    >>> layer = sample_coefficients(np.array([0.5]), np.array([4.0]))
    >>> optical_depth(layer, np.array([0.0, 0.25, 0.5, 1.0])).round(4).tolist()
    [0.0, 0.1512, 2.0, 4.0]
    """
    d = np.minimum(np.maximum(depth, 0.0), 1.0)
    highest = coefficients.shape[1] - 1
    total = coefficients[0, 0] * (0.5 * d)
    # Of half the angles: 1 − cos is twice a square then, and what is 0 at the ends is exactly 0.
    for k, s, c in _multiples(*_turn(0.5 * d), highest):
        weight = (float(np.sinc(k / (highest + 1.0))) if lanczos else 1.0) / (np.pi * k)
        total = total + (coefficients[0, k] * c + coefficients[1, k] * s) * (s * weight)
    return np.asarray(total)


def transmittance(coefficients: Field, depth: Field, *, lanczos: bool = False, clamp: bool = True) -> Array:
    """What passes up to a point of the ray.

    Parameters
    ----------
    coefficients, depth, lanczos
        As for `optical_depth`.
    clamp : bool
        Whether to cut what rings beyond [0, 1], as is published.

    Returns
    -------
    ndarray [1]

    Notes
    -----
    exp(−optical depth). Three harmonics of a thin layer of optical depth 4 in the middle overshoot to 1.450 before
    they are cut.

    Examples
    --------
    >>> layer = sample_coefficients(np.array([0.5]), np.array([4.0]))
    >>> d = np.linspace(0, 1, 1001)
    >>> float(transmittance(layer, d, clamp=False).max().round(3)), float(transmittance(layer, d).max())
    (1.45, 1.0)
    """
    with np.errstate(under="ignore", over="ignore"):
        passed = np.exp(-optical_depth(coefficients, depth, lanczos=lanczos))
    return np.asarray(np.minimum(passed, 1.0) if clamp else passed)
