"""Phase functions: how much of the light that a medium scatters turns from its way into the view.

All are normalised (the integral over the sphere is 1, unit sr⁻¹) and share one signature,
``f(cos_theta, g, *, versine=None, mirrored_versine=None)``. θ is the angle by which light is deflected,
cos θ = −V·L with V from the point to the camera and L from the point to the light, so that g > 0 is bright
towards the light.

A narrow lobe depends on 1 − cos θ, which a rounded cos θ near 1 has lost, or backward on 1 + cos θ. Who knows
the directions can pass them as `versine` and `mirrored_versine` with all their digits. Every function works in
the type of `cos_theta`; what depends on `g` alone is worked out in the wider of the types of `g` and
`cos_theta` and then rounded once, so that a Python float g next to 1 keeps its meaning beside a float32 image.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from froxel_ref.arrays import Field, Points
from froxel_ref.records import InputError, shown, suggest
from froxel_ref.settings import SecondLobe

__all__ = [
    "PHASE", "cornette_shanks", "henyey_greenstein", "isotropic", "phase", "rayleigh", "schlick",
    "two_lobe_henyey_greenstein", "versine",
]

Float: TypeAlias = "np.dtype[np.floating[Any]]"

# Nearest doubles; a float32 computation rounds them once more.
SPHERE = 12.566370614359172  # 4π [sr]
RAYLEIGH = 0.05968310365946075  # 3/(16π) [sr⁻¹]
CORNETTE = 0.1193662073189215  # 3/(8π) [sr⁻¹]

# Where Schlick's fit 1 − k crosses zero, besides g = 1: the root of 1 − 0.55 h − 0.55 h² = 0, i.e.
# (√(1 + 4/0.55) − 1)/2, as the nearest number of each type and what is left of it. Two parts, because the
# difference (root − h) would otherwise carry the rounding of the root where h is close to it.
SCHLICK_ROOT: Mapping[Float, tuple[float, float]] = {
    np.dtype(np.float32): (0.9381174445152283, 1.1808078507747728e-08),
    np.dtype(np.float64): (0.9381174563233068, -7.226611415246414e-18),
}
SCHLICK_FLOOR = 0.0595  # 1 − 0.55 h − 0.55 h² at h = 0.9, exactly


def versine(to_camera: Points, to_light: Points) -> Field:
    """1 − cos θ of the deflection between two unit directions, with the digits that cos θ has lost.

    Parameters
    ----------
    to_camera, to_light : Points
        V and L: x, y and z of unit vectors from the point to the camera and to the light, arrays that
        broadcast to a common shape [1].

    Returns
    -------
    ndarray
        ½|V + L|², at least 0, in the type of the components [1].

    Notes
    -----
    For unit vectors |V + L|² = 2 + 2 V·L = 2(1 − cos θ). Towards the light V and L are nearly opposite, so
    that their sums are exact in floating point and the result has relative, not absolute, accuracy.

    Examples
    --------
    >>> import numpy as np
    >>> V = tuple(np.array([c]) for c in (0.0, 0.0, 1.0))
    >>> L = tuple(np.array([c]) for c in (1e-9, 0.0, -1.0))
    >>> print(versine(V, L)[0], 1.0 + V[2][0] * L[2][0])
    5e-19 0.0
    """
    (vx, vy, vz), (lx, ly, lz) = to_camera, to_light
    x, y, z = vx + lx, vy + ly, vz + lz
    total = np.asarray(x * x + y * y + z * z)
    total *= 0.5
    return total[()]


def isotropic(cos_theta: ArrayLike, g: ArrayLike = 0.0, *, versine: ArrayLike | None = None,
              mirrored_versine: ArrayLike | None = None) -> Field:
    """Equal scattering into all directions.

    Parameters
    ----------
    cos_theta : array_like
        Only its type and number of axes are used.
    g, versine, mirrored_versine : array_like, optional
        Accepted and ignored, so that all phase functions can be called alike.

    Returns
    -------
    ndarray
        1/(4π), every axis of length 1, for it varies along none [sr⁻¹].

    Notes
    -----
    [Kosian 2020, eq. 2.1].

    Examples
    --------
    >>> import numpy as np
    >>> isotropic(np.zeros((4, 3)))
    array([[0.07957747]])
    """
    cosine = _cosine(cos_theta)
    return np.full((1,) * cosine.ndim, 1.0 / SPHERE, cosine.dtype)[()]


def rayleigh(cos_theta: ArrayLike, g: ArrayLike = 0.0, *, versine: ArrayLike | None = None,
             mirrored_versine: ArrayLike | None = None) -> Field:
    """Scattering by molecules much smaller than the wavelength.

    Parameters
    ----------
    cos_theta : array_like
        Cosine of the deflection, in [−1, 1] [1].
    g, versine, mirrored_versine : array_like, optional
        Accepted and ignored, so that all phase functions can be called alike.

    Returns
    -------
    ndarray
        3/(16π)·(1 + cos²θ), shape of `cos_theta` [sr⁻¹].

    Notes
    -----
    [Kosian 2020, eq. 2.2], [Intel 2012]. Relative error at most 2 ε (measured: 1.1).

    Examples
    --------
    >>> print(f"{rayleigh(1.0) / rayleigh(0.0):.1f}")
    2.0
    """
    result = _one_plus_square(_cosine(cos_theta))
    result *= RAYLEIGH
    return result[()]


def henyey_greenstein(cos_theta: ArrayLike, g: ArrayLike, *, versine: ArrayLike | None = None,
                      mirrored_versine: ArrayLike | None = None) -> Field:
    """The one-parameter lobe of Henyey and Greenstein.

    Parameters
    ----------
    cos_theta : array_like
        Cosine of the deflection, in [−1, 1] [1].
    g : array_like
        Mean cosine of the deflection, in (−1, 1); broadcasts with `cos_theta` [1]. ±1, as rounding to
        float32 can make of a valid g, is taken as the nearest number inside.
    versine : array_like, optional
        1 − cos θ, where it is known with more digits than `cos_theta` [1]; see `versine`.
    mirrored_versine : array_like, optional
        1 + cos θ likewise: ½|V − L|² [1].

    Returns
    -------
    ndarray
        In the type of `cos_theta`, broadcast with `g` [sr⁻¹].

    Raises
    ------
    InputError
        |g| above 1.

    Notes
    -----
    (1 − g²)/(4π d^{3/2}) [Henyey 1941; Dörries 2020, listing 3.2; Kosian 2020, eq. 2.3] with
    d = (1−g)² + 2g(1 − cos θ) for g ≥ 0, and the mirrored (1+g)² − 2g(1 + cos θ) for g < 0, where the
    textbook's 1 + g² − 2g cos θ loses all digits as |g| → 1. Every term is positive, so the relative error
    stays at most 8 ε for all g and angles, ε the type's epsilon (measured: 3.9). A backward lobe takes 1 + cos θ
    from `mirrored_versine`, or from `cos_theta`: 2 − versine has lost its digits. p(cos θ, g) = p(−cos θ, −g).

    Examples
    --------
    >>> print(henyey_greenstein(0.3, 0.0) == isotropic(0.3))
    True
    >>> print(f"{henyey_greenstein(1.0, 0.5):.6f}")
    0.477465
    """
    cosine = _cosine(cos_theta)
    g = _anisotropy(g, cosine.dtype)
    return _lobe(_turn(cosine, g, versine, mirrored_versine), *_lobe_terms(g, cosine.dtype))[()]


def two_lobe_henyey_greenstein(
    cos_theta: ArrayLike, g: ArrayLike, *, versine: ArrayLike | None = None,
    mirrored_versine: ArrayLike | None = None, second_lobe: SecondLobe | None = None,
) -> Field:
    """Two Henyey–Greenstein lobes, as of a medium that scatters strongly forward and somewhat back.

    Parameters
    ----------
    cos_theta, g, versine, mirrored_versine : array_like
        As for `henyey_greenstein`; g is that of the first lobe [1].
    second_lobe : SecondLobe, optional
        The second lobe's g and its share w; default as in `froxel_ref.settings.SecondLobe`.

    Returns
    -------
    ndarray
        (1 − w)·p(g) + w·p(g₂), as for `henyey_greenstein` [sr⁻¹].

    Raises
    ------
    InputError
        |g| above 1.

    Notes
    -----
    A convex sum of normalised, positive functions, hence itself normalised; the mean cosine is
    (1 − w)g + w g₂. Relative error at most that of the lobes plus 2 ε.

    Examples
    --------
    >>> lobe = SecondLobe(phase_anisotropy=-0.5, weight=0.5)
    >>> print(two_lobe_henyey_greenstein(1.0, 0.5, second_lobe=lobe)
    ...       == two_lobe_henyey_greenstein(-1.0, 0.5, second_lobe=lobe))
    True
    """
    second = SecondLobe() if second_lobe is None else second_lobe
    first = np.asarray(henyey_greenstein(cos_theta, g, versine=versine, mirrored_versine=mirrored_versine))
    other = np.asarray(henyey_greenstein(cos_theta, second.phase_anisotropy, versine=versine,
                                         mirrored_versine=mirrored_versine))
    first *= 1.0 - second.weight
    other *= second.weight
    return first + other


def cornette_shanks(cos_theta: ArrayLike, g: ArrayLike, *, versine: ArrayLike | None = None,
                    mirrored_versine: ArrayLike | None = None) -> Field:
    """Henyey–Greenstein with the polarisation factor of Rayleigh, which it becomes at g = 0.

    Parameters
    ----------
    cos_theta, g, versine, mirrored_versine : array_like
        As for `henyey_greenstein`; g is not exactly the mean cosine here [1].

    Returns
    -------
    ndarray
        In the type of `cos_theta`, broadcast with `g` [sr⁻¹].

    Raises
    ------
    InputError
        |g| above 1.

    Notes
    -----
    3/(8π)·(1 − g²)(1 + cos²θ)/((2 + g²) d^{3/2}), d as in `henyey_greenstein` [Cornette 1992; Intel 2012].
    Relative error at most 8 ε (measured: 4.7).

    Examples
    --------
    >>> print(f"{cornette_shanks(0.3, 0.0) / rayleigh(0.3):.12f}")
    1.000000000000
    """
    cosine = _cosine(cos_theta)
    g = _anisotropy(g, cosine.dtype)
    offset, slope, numerator = _lobe_terms(g, cosine.dtype, (2.0 + g * g) / CORNETTE)
    result = _lobe(_turn(cosine, g, versine, mirrored_versine), offset, slope, numerator)
    result *= _one_plus_square(cosine)
    return result[()]


def schlick(
    cos_theta: ArrayLike, g: ArrayLike, *, versine: ArrayLike | None = None,
    mirrored_versine: ArrayLike | None = None, fit: str = "corrected", sign: str = "henyey_greenstein",
) -> Field:
    """Schlick's lobe without a root, with k fitted so that it resembles Henyey–Greenstein's.

    Parameters
    ----------
    cos_theta, g, versine, mirrored_versine : array_like
        As for `henyey_greenstein` [1].
    fit : {"corrected", "published"}
        How k follows from g; see Notes.
    sign : {"henyey_greenstein", "kosian"}
        Which way g > 0 scatters: forward, or backward as the sign in Kosian's equation has it (D14).

    Returns
    -------
    ndarray
        In the type of `cos_theta`, broadcast with `g` [sr⁻¹].

    Raises
    ------
    InputError
        |g| above 1; an unknown `fit` or `sign`.

    Notes
    -----
    (1 − k²)/(4π(1 − k cos θ)²) [Blasi 1993] with k = 1.55 g − 0.55 g³ [Kosian 2020, eq. 2.4], which has
    1 + k cos θ (D14): with g = 0.8 the two differ by a factor of 2200 towards the light.

    S1, a departure found here: the fit exceeds 1 for 0.93812 < |g| < 1 (up to 1.00153). There the function is
    negative (−104 sr⁻¹ towards the light at g = 0.97, where Henyey–Greenstein is +174), has a pole at
    cos θ = 1/k, and no integral. With h = |g|, 1 − |k| = (1 − h)(1 − 0.55 h − 0.55 h²); "corrected" holds
    the second factor at its value for h = 0.9 from there on, so that k is the published one up to 0.9,
    then grows steadily to reach 1 only at g = 1. "published" is for checking a program that has the fit.

    The denominator is written (1 − |k|) + |k|(1 ∓ cos θ). Relative error at most 8 ε (measured: 5.2),
    for "published" too where it is positive.

    Examples
    --------
    >>> print(f"{schlick(1.0, 0.97):.1f} {schlick(1.0, 0.97, fit='published'):.1f}")
    89.1 -104.1
    """
    _one_of("fit", fit, ("corrected", "published"))
    _one_of("sign", sign, ("henyey_greenstein", "kosian"))
    cosine = _cosine(cos_theta)
    if sign == "kosian":  # the same function of the supplementary angle
        cosine, versine, mirrored_versine = -cosine, mirrored_versine, versine
    g = _anisotropy(g, cosine.dtype)
    rest = _schlick_rest(np.abs(g), fit)
    terms = rest, 1.0 - rest, rest * (2.0 - rest) / SPHERE
    offset, slope, numerator = (term.astype(cosine.dtype, copy=False) for term in terms)
    result = np.asarray(slope * _turn(cosine, g, versine, mirrored_versine))
    result += offset
    result *= result
    return np.divide(numerator, result, out=result)[()]


PHASE: Mapping[str, Callable[..., Field]] = {
    "henyey_greenstein": henyey_greenstein,
    "isotropic": isotropic,
    "rayleigh": rayleigh,
    "schlick": schlick,
    "cornette_shanks": cornette_shanks,
    "two_lobe_henyey_greenstein": two_lobe_henyey_greenstein,
}
"""The phase functions by the names that `Settings.phase_function` uses."""


def phase(
    name: str, cos_theta: ArrayLike, g: ArrayLike, *, versine: ArrayLike | None = None,
    mirrored_versine: ArrayLike | None = None, second_lobe: SecondLobe | None = None,
) -> Field:
    """The phase function of a given name.

    Parameters
    ----------
    name : str
        A key of `PHASE`.
    cos_theta, g, versine, mirrored_versine : array_like
        As for `henyey_greenstein` [1].
    second_lobe : SecondLobe, optional
        For ``two_lobe_henyey_greenstein``; the others do not look at it.

    Returns
    -------
    ndarray
        In the type of `cos_theta` [sr⁻¹].

    Raises
    ------
    InputError
        An unknown name; |g| above 1.

    Examples
    --------
    >>> print(phase("rayleigh", 0.5, 0.0) == rayleigh(0.5))
    True
    """
    if name not in PHASE:
        raise InputError("phase_function", f"is {shown(name)}; {suggest(name, PHASE)}")
    if name == "two_lobe_henyey_greenstein":
        return two_lobe_henyey_greenstein(cos_theta, g, versine=versine, mirrored_versine=mirrored_versine,
                                          second_lobe=second_lobe)
    return PHASE[name](cos_theta, g, versine=versine, mirrored_versine=mirrored_versine)


# --- parts ------------------------------------------------------------------------------------------


def _cosine(cos_theta: ArrayLike) -> Field:
    """cos θ as an array of float32 or float64; anything else becomes float64."""
    cosine = np.asarray(cos_theta)
    return cosine if cosine.dtype == np.float32 else cosine.astype(np.float64, copy=False)


def _anisotropy(g: ArrayLike, dtype: Float) -> Field:
    """g in the wider of its own type and that of cos θ, inside (−1, 1)."""
    values = np.asarray(g)
    values = values.astype(np.promote_types(values.dtype, dtype), copy=False)
    largest = np.abs(values).max() if values.size else 0.0
    if largest > 1.0:
        raise InputError("g", f"is {largest:g} in size, must be below 1")
    if largest == 1.0:
        inside = 1.0 - np.finfo(values.dtype).epsneg
        values = np.clip(values, -inside, inside)
    return values


def _turn(cosine: Field, g: Field, versine: ArrayLike | None, mirrored_versine: ArrayLike | None) -> Field:
    """1 − cos θ where g ≥ 0 and 1 + cos θ where g < 0: zero in the middle of the lobe, never below.

    A cosine that rounding has put above 1 would otherwise turn a narrow lobe into the root of a negative.
    """
    backward = g < 0
    if not backward.any():
        return _known(versine, cosine, -1.0)
    if backward.all():
        return _known(mirrored_versine, cosine, 1.0)
    return np.where(backward, np.maximum(_known(mirrored_versine, cosine, 1.0), 0.0),
                    np.maximum(_known(versine, cosine, -1.0), 0.0))


def _known(versine: ArrayLike | None, cosine: Field, sign: float) -> Field:
    """What is known of 1 ± cos θ with all its digits, in the type of cos θ, or what the cosine tells."""
    if versine is not None:
        return np.asarray(versine, dtype=cosine.dtype)
    return _positive(np.asarray(1.0 - cosine if sign < 0.0 else 1.0 + cosine))


def _positive(values: Field) -> Field:
    return np.maximum(values, 0.0, out=values)


def _one_plus_square(cosine: Field) -> Field:
    """1 + cos²θ, a new array."""
    square = np.asarray(cosine * cosine)
    square += 1.0
    return square


def _lobe_terms(g: Field, dtype: Float, divisor: float | Field = SPHERE) -> tuple[Field, Field, Field]:
    """Offset, slope and numerator of `_lobe`, in the type of cos θ.

    Where g has more digits than cos θ can hold, (1 − |g|)³ may leave the range of cos θ's type; d is then
    taken in units of 1 − |g|, which the numerator makes good. It costs a root, so only there.
    """
    h = np.abs(g)
    rest, slope = 1.0 - h, 2.0 * h
    numerator: Field = 1.0 + h
    if g.dtype.itemsize > dtype.itemsize:
        slope /= rest
        numerator /= np.sqrt(rest)
    else:
        numerator *= rest
        rest *= rest
    numerator /= divisor
    offset, rise, above = (term.astype(dtype, copy=False) for term in (rest, slope, numerator))
    return offset, rise, above


def _lobe(turn: Field, offset: Field, slope: Field, numerator: Field) -> Field:
    """numerator/d^{3/2}, d = offset + slope·turn: a new array, five passes."""
    d = np.asarray(slope * turn)
    d += offset
    result = np.asarray(np.sqrt(d))
    result *= d
    np.divide(numerator, result, out=result)
    return result


def _schlick_rest(h: Field, fit: str) -> Field:
    """1 − |k| for h = |g|, with relative accuracy.

    1 − 0.55 h − 0.55 h² = (root − h)(0.55 h + 0.55 (1 + root)), the root in two parts.
    """
    head, tail = SCHLICK_ROOT[h.dtype]
    factor = ((head - h) + tail) * (0.55 * h + 0.55 * (1.0 + head))
    # The factor falls as h grows, so a floor holds it from the knee on; a bound on h itself would bring
    # in the rounding of 0.9, 16 times magnified.
    held = np.maximum(factor, SCHLICK_FLOOR) if fit == "corrected" else factor
    rest: Field = (1.0 - h) * held
    return rest


def _one_of(place: str, word: str, words: tuple[str, ...]) -> None:
    if word not in words:
        raise InputError(place, f"is {shown(word)}; {suggest(word, words)}")
