"""The pipeline's own tone map, which keeps bright fog within half floats, and its inverse (D9)."""

from __future__ import annotations

import numpy as np

from froxel_ref.arrays import Field

__all__ = ["AUTHOR_LARGEST_LUMA", "FLOAT16_LARGEST_LUMA", "inverse_tone_map", "luma", "tone_map"]

# Rec. 709.
WEIGHTS = (0.2126, 0.7152, 0.0722)

FLOAT16_LARGEST_LUMA = 1.0 - 2.0**-11
"""The largest half float below 1: what a tone map stored in float16 can hold is a luma of 2047."""

AUTHOR_LARGEST_LUMA = 1.0 - 1e-6
"""What the thesis's program bounds a luma by before it undoes the tone map."""


def luma(colour: Field) -> Field:
    """Rec. 709 luma of linear RGB.

    Parameters
    ----------
    colour : ndarray, shape (3, ...)

    Returns
    -------
    ndarray, shape (...)

    Examples
    --------
    >>> float(luma(np.array([1.0, 0.0, 0.0])))
    0.2126
    """
    red, green, blue = colour
    weights = [colour.dtype.type(weight) for weight in WEIGHTS]
    result: Field = weights[0] * red + weights[1] * green + weights[2] * blue
    return result


def tone_map(colour: Field) -> Field:
    """Compress radiance into [0, 1) of luma.

    Parameters
    ----------
    colour : ndarray, shape (3, ...)
        Radiance, at least 0, finite.

    Returns
    -------
    ndarray, shape (3, ...)
        c/(1 + luma(c)).

    Notes
    -----
    [Dörries 2020, eq. 3.3]. Relative error at most 4 ε.

    Examples
    --------
    >>> tone_map(np.full(3, 3.0)).round(12).tolist()
    [0.75, 0.75, 0.75]
    """
    # Halved, so that the luma of the largest numbers does not overflow.
    half = colour.dtype.type(0.5)
    result: Field = (half * colour) / (half + half * luma(colour))
    return result


def inverse_tone_map(colour: Field, *, largest_luma: float | None = None) -> Field:
    """Undo `tone_map`.

    Parameters
    ----------
    colour : ndarray, shape (3, ...)
        Tone-mapped radiance, at least 0.
    largest_luma : float, optional
        Luma above is taken for it; in (0, 1]. Default: the type's largest number below 1. Where the colour
        has been stored in float16, `FLOAT16_LARGEST_LUMA`. Published: 1.

    Returns
    -------
    ndarray, shape (3, ...)
        c/(1 − min(luma(c), largest)).

    Notes
    -----
    [Dörries 2020, eq. 3.4]. D9: singular at luma 1, which rounding reaches, from a luma of 4095 on in
    float16. The condition number is 1/(1 − luma): what is stored in float16 comes back with a relative error
    of about 2⁻¹¹·(1 + luma of the radiance).

    Examples
    --------
    >>> inverse_tone_map(np.full(3, 0.75)).round(12).tolist()
    [3.0, 3.0, 3.0]
    >>> white = np.ones(3)
    >>> inverse_tone_map(white, largest_luma=FLOAT16_LARGEST_LUMA).tolist()
    [2048.0, 2048.0, 2048.0]
    """
    most = 1.0 - float(np.finfo(colour.dtype).epsneg) if largest_luma is None else largest_luma
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        result: Field = colour / (1.0 - np.minimum(luma(colour), colour.dtype.type(most)))
    return result
