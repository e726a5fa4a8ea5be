"""FLIP: how visible the difference of two images is to someone who switches between them.

HDR-FLIP [Andersson 2021] at one exposure, which the caller states: linear radiance is exposed, tone-mapped,
cut to [0, 1] and judged by FLIP [Andersson 2020], which filters both images as the eye does at so many
pixels per degree and weighs differences of colour, edges and points. 0 is no difference, 1 the largest.

The filters, the tone mappers and the colour spaces are those of the package ``flip-evaluator`` (extra
``flip``). What this module adds is that nothing passes by accident:

| what | the package alone | here |
| --- | --- | --- |
| NaN or infinite | black: an image of NaN scores 0 against black | a fault, or left out where both have it |
| one exposure, start = stop | divides by 0 and scores every image 0 | the same exposure twice |
| tone mapper ``"Hable"`` | ACES without a word: it knows small letters only | small letters, or refused |
| negative radiance | ACES squares it: −1 is white | black, as a display shows it |
| above 1.8e19 | its square overflows: black | bounded first, far above white |
| fewer than 2 pixels per degree | 0/0 in its filters | refused |
| an image smaller than the filters | mostly repeats of the border | refused |

It works in float32: rounding of the images alone scores up to 3e-5, and nothing below means anything.
"""

from __future__ import annotations

import importlib.util
import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from froxel_ref.arrays import Field
from froxel_ref.compare import Norm, absolute
from froxel_ref.records import InputError, shown, suggest
from froxel_ref.ulp import checked

__all__ = [
    "PIXELS_PER_DEGREE", "TONE_MAPPERS", "filter_reach", "flip", "flip_available", "flip_map",
    "scaled_pixels_per_degree",
]

PIXELS_PER_DEGREE = 67.0
"""A screen 0.7 m and 3840 pixels wide, seen from 0.7 m [Andersson 2020]: 0.7·(3840/0.7)·π/180 = 67.02."""

TONE_MAPPERS = ("aces", "hable", "reinhard")
"""Of the package; ``aces`` is [Andersson 2021]'s own choice."""

# Below, the weights of the package's filters for edges underflow and their sum, a divisor, is 0: at 1.5.
LEAST_PIXELS_PER_DEGREE = 2.0

# The square is still a float32; white by every tone mapper, all of which are cut at 1 from 14 on.
BRIGHTEST = 1e18

# Three standard deviations of the widest filter, for blue against yellow, in degrees: 3·√(0.04/2)/π.
REACH = 3.0 * math.sqrt(0.04 / 2.0) / math.pi


def flip_available() -> bool:
    """Whether the package ``flip-evaluator`` is there.

    Returns
    -------
    bool
    """
    return importlib.util.find_spec("flip_evaluator") is not None


def scaled_pixels_per_degree(width: int, full_width: int, *, pixels_per_degree: float = PIXELS_PER_DEGREE) -> float:
    """Pixels per degree of an image that shows with fewer pixels what a full one shows.

    Parameters
    ----------
    width, full_width : int
        Pixels across of the image, and of the full one that fills as much of the screen; at least 1.
    pixels_per_degree : float
        Of the full one; above 0.

    Returns
    -------
    float
        pixels_per_degree·width/full_width: a pixel of the smaller image is that much larger on the screen.

    Raises
    ------
    InputError
        A width below 1; pixels per degree that are not positive and finite.

    Examples
    --------
    >>> scaled_pixels_per_degree(384, 3840)
    6.7
    """
    for name, pixels in (("width", width), ("full_width", full_width)):
        if not pixels >= 1:
            raise InputError(name, f"is {pixels!r}, must be at least 1")
    if not 0.0 < pixels_per_degree < math.inf:
        raise InputError("pixels_per_degree", f"is {pixels_per_degree!r}, must be above 0 and finite")
    return pixels_per_degree * width / full_width


def filter_reach(pixels_per_degree: float = PIXELS_PER_DEGREE) -> int:
    """How many pixels to each side a pixel's FLIP depends on.

    Parameters
    ----------
    pixels_per_degree : float
        At least 2.

    Returns
    -------
    int
        Three standard deviations of the widest of the filters [Andersson 2020], rounded up.

    Raises
    ------
    InputError
        Fewer than 2 pixels per degree, or not finite.

    Examples
    --------
    >>> filter_reach(67.0), filter_reach(6.7)
    (10, 1)
    """
    if not LEAST_PIXELS_PER_DEGREE <= pixels_per_degree < math.inf:
        raise InputError("pixels_per_degree", f"is {pixels_per_degree!r}, must be at least 2 and finite")
    return math.ceil(REACH * pixels_per_degree)


def flip(result: ArrayLike, expected: ArrayLike, *, exposure: float, pixels_per_degree: float = PIXELS_PER_DEGREE,
         tone_mapper: str = "aces") -> Norm:
    """Mean FLIP of two images of linear radiance.

    Parameters
    ----------
    result, expected : array_like, shape (3, h, w)
        Linear RGB (Rec. 709), floats of the same type; h and w each 1, where nothing varies along it, or
        at least twice the filters' reach and 1.
    exposure : float
        Radiance is multiplied by it [1/unit of the radiance]; positive and finite. The package's exposure
        c is its logarithm to base 2.
    pixels_per_degree : float
        Of visual angle, at least 2. Default: [Andersson 2020]'s, 67.
    tone_mapper : {"aces", "hable", "reinhard"}
        Default: [Andersson 2021]'s.

    Returns
    -------
    Norm
        In [0, 1]; its name repeats the tone mapper, the exposure and the pixels per degree. A fault, and NaN
        for the value, where something is not finite in one image alone. What is not finite alike in both
        counts as black in both; a pixel without any finite channel is left out of the mean.

    Raises
    ------
    InputError
        Another type or shape, no pixels, fewer than the filters need; an exposure, pixels per degree or a
        tone mapper out of bounds; the extra ``flip`` is missing.

    Notes
    -----
    Symmetric in its images, as the exposure comes from neither of them. The mean is taken in float64.
    Negative radiance is black, and 0 in its place no error: it is what is seen that counts here, and
    `compare.bias` and others see the rest. The largest value occurs for saturated green against blue;
    white against black is 0.967.

    Small differences count by their power 0.7, that of colours [Andersson 2020]: where radiance
    converges with order p, FLIP does with 0.7·p, down to some 3e-5, the rounding of float32 to the same power.

    Examples
    --------
    >>> grey = np.full((3, 32, 32), 0.5)
    >>> norm = flip(grey, grey, exposure=1.0)
    >>> norm.value, norm.name
    (0.0, 'flip (aces, exposure 1, 67 px/°)')
    """
    a, b = _images(result, expected, exposure, pixels_per_degree, tone_mapper)
    name = f"flip ({tone_mapper}, exposure {exposure:g}, {pixels_per_degree:g} px/°)"
    finite = absolute(a, b)
    if finite.fault:
        return Norm(name, math.nan, 0, finite.fault, finite.place)
    seen = _values(a, b, exposure, pixels_per_degree, tone_mapper)[np.isfinite(a).any(axis=0)]
    return Norm(name, float(seen.mean(dtype=np.float64)) if seen.size else 0.0, finite.pairs)


def flip_map(result: ArrayLike, expected: ArrayLike, *, exposure: float,
             pixels_per_degree: float = PIXELS_PER_DEGREE, tone_mapper: str = "aces") -> NDArray[np.float32]:
    """FLIP pixel by pixel.

    Parameters
    ----------
    result, expected : array_like, shape (3, h, w)
        As for `flip`.
    exposure : float
        As for `flip`.
    pixels_per_degree : float
        As for `flip`.
    tone_mapper : {"aces", "hable", "reinhard"}
        As for `flip`.

    Returns
    -------
    ndarray of float32, shape (h, w)
        In [0, 1]. NaN in a pixel that has something not finite in one image alone, or nothing finite in
        both; to its neighbours that is black in both images.

    Raises
    ------
    InputError
        As for `flip`.

    Examples
    --------
    >>> grey = np.full((3, 32, 48), 0.5)
    >>> flip_map(grey, grey, exposure=1.0).shape
    (32, 48)
    """
    a, b = _images(result, expected, exposure, pixels_per_degree, tone_mapper)
    alike = np.isfinite(a) & np.isfinite(b)
    strange = ~(alike | (np.isnan(a) & np.isnan(b)) | (a == b))
    values = _values(a, b, exposure, pixels_per_degree, tone_mapper)
    return np.where(strange.any(axis=0) | ~alike.any(axis=0), np.float32(np.nan), values)


# --- parts ------------------------------------------------------------------------------------------


def _images(result: ArrayLike, expected: ArrayLike, exposure: float, pixels_per_degree: float,
            tone_mapper: str) -> tuple[Field, Field]:
    """Both images, once nothing speaks against judging them."""
    a, b = checked(result, expected)
    if a.ndim != 3 or a.shape[0] != 3:
        raise InputError("result", f"has shape {a.shape}, must be (3, height, width)")
    if not 0.0 < exposure < math.inf:
        raise InputError("exposure", f"is {exposure!r}, must be above 0 and finite")
    if tone_mapper not in TONE_MAPPERS:
        raise InputError("tone_mapper", f"is {shown(tone_mapper)}; {suggest(str(tone_mapper), TONE_MAPPERS)}")
    least = 2 * filter_reach(pixels_per_degree) + 1
    if any(side != 1 and side < least for side in a.shape[1:]):
        raise InputError("result", f"is {a.shape[2]} × {a.shape[1]} pixels, must be at least {least} × {least} "
                                   f"at {pixels_per_degree:g} pixels per degree")
    if not flip_available():
        raise InputError("flip", "needs the extra flip: python -m pip install -e '.[flip]'")
    return a, b


def _values(a: Field, b: Field, exposure: float, pixels_per_degree: float, tone_mapper: str) -> NDArray[np.float32]:
    """FLIP of each pixel, with black in both where one is not finite."""
    from flip_evaluator import evaluate

    alike = np.isfinite(a) & np.isfinite(b)
    # Two exposures, both 2⁰: of a single one the package divides by 0 and finds no error anywhere.
    how = {"startExposure": 0.0, "stopExposure": 0.0, "numExposures": 2, "tonemapper": tone_mapper,
           "ppd": float(pixels_per_degree)}
    values = evaluate(_shown(b, alike, exposure), _shown(a, alike, exposure), "HDR", applyMagma=False,
                      computeMeanError=False, parameters=how)[0]
    return np.asarray(values, np.float32).reshape(a.shape[1:])


def _shown(image: Field, alike: NDArray[np.bool_], exposure: float) -> NDArray[np.float32]:
    """(h, w, 3), exposed, within what the package's tone mappers can square."""
    with np.errstate(over="ignore", under="ignore"):
        exposed = np.where(alike, image, 0.0).astype(np.float64) * exposure
        bounded = np.clip(exposed, 0.0, BRIGHTEST).astype(np.float32)
    return np.ascontiguousarray(np.moveaxis(bounded, 0, -1))
