"""Storage formats: what a number becomes when a GPU writes it to a texture and reads it back.

The stages compute in float64 or float32 and never round in between. Where a program keeps a buffer in
RGBA16F or R11G11B10F, one call of `store` after the stage says so. Both roundings of the float formats
are met on real devices: most round to nearest, some software devices cut off.

=========== ============== ======== =============== ========================= ======== ====
format      sign, exponent mantissa largest finite  finite numbers beyond it  −∞       NaN
=========== ============== ======== =============== ========================= ======== ====
float32     1, 8           23       3.4028235e38    ±∞, or cut to the largest −∞       NaN
float16     1, 5           10       65504           ±∞, or cut to the largest −∞       NaN
r11g11b10f  0, 5           6, 6, 5  65024 and 64512 the largest               0        NaN
unorm8      integer        8        1               1                         0        0
unorm16     integer        16       1               1                         0        0
=========== ============== ======== =============== ========================= ======== ====

+∞ stays +∞ in the float formats and becomes 1 in UNORM. "nearest" makes ±∞ of what lies half a step or
more beyond the largest number (65520 in float16), as IEEE 754 has it; "truncate" never makes an infinity
of a finite number. R11G11B10F never does either, in both roundings, by the rules of OpenGL
[EXT_packed_float, §2.1.A and B] and of Direct3D; it has no sign, so what is negative becomes 0.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import DTypeLike, NDArray

from froxel_ref.arrays import Field
from froxel_ref.records import InputError, shown, suggest

__all__ = [
    "FLOAT16_LARGEST", "FORMATS", "ROUNDINGS", "decode_r11g11b10f", "decode_unorm", "encode_r11g11b10f", "encode_unorm",
    "store", "store_half", "store_series",
]

FORMATS = ("float32", "float16", "r11g11b10f", "unorm8", "unorm16")
ROUNDINGS = ("nearest", "truncate")


class _Float(NamedTuple):
    """A binary floating point format with denormals, infinities and NaN."""

    mantissa: int
    smallest: int  # exponent of the smallest normal number
    largest: int  # exponent of the largest finite number
    signed: bool = True

    @property
    def maximum(self) -> float:
        return (2.0 - 2.0**-self.mantissa) * 2.0**self.largest


FLOATS: Mapping[str, _Float] = {
    "float32": _Float(23, -126, 127),
    "float16": _Float(10, -14, 15),
    "float11": _Float(6, -14, 15, signed=False),
    "float10": _Float(5, -14, 15, signed=False),
}
PACKED = ("float11", "float11", "float10")  # red, green and blue of R11G11B10F
# Arithmetic on a signalling NaN sets the processor's flag, of which NumPy would warn; NaN is data here.
SILENT_NAN = partial(np.errstate, invalid="ignore")
EXPONENT_BITS = {4: 0x7F800000, 8: 0x7FF0000000000000}  # by bytes of a float


FLOAT16_LARGEST = FLOATS["float16"].maximum
"""The largest number of half floats."""


def store(array: Field, format: str, *, rounding: str = "nearest") -> Field:
    """The values as a texture of a format gives them back, in the type that they came in.

    Parameters
    ----------
    array : ndarray of float32 or float64
        Any shape; for ``r11g11b10f`` channel-first, (3, …).
    format : str
        One of `FORMATS`; the name of a texture format's channels, as in RGBA16F: ``float16``.
    rounding : {"nearest", "truncate"}
        To nearest with ties to even, or towards zero. UNORM is always rounded to nearest, for the
        graphics interfaces leave no choice there.

    Returns
    -------
    ndarray
        Same shape and type; denormals of the format are kept.

    Raises
    ------
    InputError
        An unknown format or rounding; an array that is not of float32 or float64, or without three
        channels where the format has three.

    Notes
    -----
    Exact: the result is the number of the format that the rule names, also for denormals. See the table
    of this module for what lies outside a format's range. Storing twice changes nothing.

    Examples
    --------
    >>> import numpy as np
    >>> print(store(np.array([1 / 3, 1e5]), "float16"))
    [0.33325195        inf]
    >>> print(store(np.array([1 / 3, 1e5]), "float16", rounding="truncate"))
    [3.33251953e-01 6.55040000e+04]
    >>> print(store(np.array([0.4999, -1.0, np.nan]), "unorm8") * 255)
    [127.   0.   0.]
    """
    _check(array, format, rounding)
    if format == "r11g11b10f":
        return np.stack([_round(channel, FLOATS[name], rounding)
                         for channel, name in zip(array, PACKED, strict=True)])
    if format in FLOATS:
        return _round(np.asarray(array), FLOATS[format], rounding)
    return decode_unorm(encode_unorm(array, bits=int(format.removeprefix("unorm"))), dtype=array.dtype)


def store_half(array: Field) -> Field:
    """The values as a half-float texture gives them back, what is beyond its largest number as that.

    Parameters
    ----------
    array : ndarray of float32 or float64

    Returns
    -------
    ndarray
        As of `store`, with no infinity of a finite number.

    Examples
    --------
    >>> store_half(np.array([0.1, 1e6])).round(6).tolist()
    [0.099976, 65504.0]
    """
    return store(np.asarray(np.minimum(array, array.dtype.type(FLOAT16_LARGEST))), "float16")


def store_series(series: Field, format: str | None, *, axis: int = 0) -> Field:
    """The coefficients of series as a texture gives them back; those too large for it keep their shape.

    Parameters
    ----------
    series : ndarray of float32 or float64
        One series along an axis.
    format : {"float32", "float16"} or None
        None: as they are.
    axis : int
        The coefficients' axis.

    Returns
    -------
    ndarray
        Same shape and type, finite if the series is.

    Raises
    ------
    InputError
        As for `store`; a format without a sign.

    Notes
    -----
    If a coefficient is beyond the format's largest number, its series is scaled down as a whole, where a texture
    would hold infinities, and a sum of them NaN. Of a series of extinction, whose a_0 is largest, an optical depth
    of 32752 is left in float16: light still ends within 1/2000 of the range where it ended at once.

    Examples
    --------
    >>> import numpy as np
    >>> print(store_series(np.array([[2.0, 1e6], [1.0, -5e5]]), "float16"))
    [[ 2.0000e+00  6.5504e+04]
     [ 1.0000e+00 -3.2752e+04]]
    """
    if format is None:
        return series
    if format not in FORMATS or not (format in FLOATS and FLOATS[format].signed):
        signed = [name for name in FORMATS if name in FLOATS and FLOATS[name].signed]
        raise InputError("format", f"is {shown(format)}; {suggest(str(format), signed)}")
    largest = FLOATS[format].maximum
    scale = np.minimum(1.0, largest / np.maximum(np.max(np.abs(series), axis=axis, keepdims=True), 1.0))
    return store(series * scale.astype(series.dtype), format)


def encode_r11g11b10f(array: Field, *, rounding: str = "nearest") -> NDArray[np.uint32]:
    """Colours as packed words, red in the lowest 11 bits, blue in the highest 10.

    Parameters
    ----------
    array : ndarray of float32 or float64, shape (3, …)
        Red, green and blue.
    rounding : {"nearest", "truncate"}
        As for `store`.

    Returns
    -------
    ndarray of uint32, shape (…)
        Every NaN has the same bits: the highest bit of the mantissa.

    Raises
    ------
    InputError
        As for `store`.

    Notes
    -----
    Layout of GL_UNSIGNED_INT_10F_11F_11F_REV [EXT_packed_float] and DXGI_FORMAT_R11G11B10_FLOAT.

    Examples
    --------
    >>> import numpy as np
    >>> print(hex(encode_r11g11b10f(np.array([1.0, 0.5, 2.0]))))
    0x801c03c0
    """
    words = np.zeros(array.shape[1:], np.uint32)
    for channel, name, shift in zip(store(array, "r11g11b10f", rounding=rounding), PACKED, (0, 11, 22),
                                    strict=True):
        # A half has the same exponent, so it is the same number with a longer mantissa and a sign (0).
        spare = FLOATS["float16"].mantissa - FLOATS[name].mantissa
        halves = np.where(np.isnan(channel), np.inf, channel).astype(np.float16).view(np.uint16) >> spare
        quiet = 1 << (FLOATS[name].mantissa - 1)
        words |= (halves | np.where(np.isnan(channel), quiet, 0)).astype(np.uint32) << np.uint32(shift)
    return words[()]


def decode_r11g11b10f(words: NDArray[np.uint32], *, dtype: DTypeLike = np.float32) -> Field:
    """The colours of packed words.

    Parameters
    ----------
    words : ndarray of uint32, shape (…)
        As from `encode_r11g11b10f`.
    dtype : dtype
        Type of the result; every word is exact in float16 and wider.

    Returns
    -------
    ndarray, shape (3, …)
        Red, green and blue.

    Examples
    --------
    >>> import numpy as np
    >>> print(decode_r11g11b10f(np.uint32(0x801c03c0)))
    [1.  0.5 2. ]
    """
    word = np.asarray(words, np.uint32)
    channels = []
    for name, shift in zip(PACKED, (0, 11, 22), strict=True):
        mantissa = FLOATS[name].mantissa
        code = (word >> np.uint32(shift)) & np.uint32((1 << (5 + mantissa)) - 1)
        half = (code << np.uint32(FLOATS["float16"].mantissa - mantissa)).astype(np.uint16)
        with SILENT_NAN():
            channels.append(half.view(np.float16).astype(dtype))
    return np.stack(channels)


def encode_unorm(array: Field, *, bits: int = 8) -> NDArray[np.unsignedinteger[Any]]:
    """Numbers in [0, 1] as unsigned integers; what is outside is clamped, NaN is 0.

    Parameters
    ----------
    array : ndarray of float32 or float64
        Any shape [1].
    bits : {8, 16}
        Width of the integers.

    Returns
    -------
    ndarray of uint8 or uint16
        The integer nearest to x·(2^bits − 1). Only x = ½ lies half-way; it goes up, to the even one.

    Raises
    ------
    InputError
        Another width; an array that is not of float32 or float64.

    Notes
    -----
    Exact for every float64. x is split into 24 bits and the rest, so that neither product is rounded (in
    float64: 16 + 24 bits), and the decision at a half hangs on the sign of a sum, which rounding keeps.

    Examples
    --------
    >>> import numpy as np
    >>> print(encode_unorm(np.array([0.0, 0.5, 1.0, 7.0])))
    [  0 128 255 255]
    """
    if bits not in (8, 16):
        raise InputError("bits", f"is {shown(bits)}, must be 8 or 16")
    _check(array, "unorm8", "nearest")
    scale = float((1 << bits) - 1)
    x = np.clip(np.where(np.isnan(array), 0.0, array), 0.0, 1.0).astype(np.float64)
    head = x.astype(np.float32).astype(np.float64)
    product = head * scale
    below = np.floor(product)
    up = (product - below - 0.5) + (x - head) * scale >= 0.0
    return (below + up).astype(np.uint8 if bits == 8 else np.uint16)


def decode_unorm(codes: NDArray[np.unsignedinteger[Any]], *, dtype: DTypeLike = np.float32) -> Field:
    """The numbers in [0, 1] that unsigned integers stand for.

    Parameters
    ----------
    codes : ndarray of uint8 or uint16
        As from `encode_unorm`.
    dtype : dtype
        Type of the result.

    Returns
    -------
    ndarray
        code/(2^bits − 1), correctly rounded [1].

    Raises
    ------
    InputError
        Codes of another type.

    Examples
    --------
    >>> import numpy as np
    >>> print(decode_unorm(np.array([0, 51, 255], np.uint8)))
    [0.  0.2 1. ]
    """
    if codes.dtype not in (np.uint8, np.uint16):
        raise InputError("codes", f"has type {codes.dtype}, must be uint8 or uint16")
    values: Field = codes.astype(dtype)
    values /= float(np.iinfo(codes.dtype).max)
    return values


def _check(array: Field, format: str, rounding: str) -> None:
    if format not in FORMATS:
        raise InputError("format", f"is {shown(format)}; {suggest(str(format), FORMATS)}")
    if rounding not in ROUNDINGS:
        raise InputError("rounding", f"is {shown(rounding)}; {suggest(str(rounding), ROUNDINGS)}")
    kind = getattr(array, "dtype", None)
    if kind not in (np.float32, np.float64):
        raise InputError("array", f"has type {kind}, must be float32 or float64")
    if format == "r11g11b10f" and (array.ndim == 0 or array.shape[0] != 3):
        raise InputError("array", f"has shape {array.shape}, must be (3, …) for r11g11b10f")


def _round(array: Field, target: _Float, rounding: str) -> Field:
    """The numbers of a float format nearest to the values, or next to them towards zero."""
    values = array
    if not target.signed:
        with SILENT_NAN():
            values = np.maximum(values, 0.0) + 0.0  # keeps NaN; the sum makes −0 a +0
    if target == FLOATS["float32"] and values.dtype == np.float32:
        return values.copy()
    integer = np.dtype(np.uint32 if values.dtype == np.float32 else np.uint64)
    exponent: NDArray[Any] = values.view(integer) & integer.type(EXPONENT_BITS[values.itemsize])
    power: Field = np.asarray(exponent).view(values.dtype)
    # From here `power` is the spacing of the format at each value: a power of two, so that dividing by it
    # is exact. Below the smallest normal number it stays as it is; infinity and NaN have a finite one.
    power = np.clip(power, 2.0**target.smallest, 2.0**target.largest)
    power *= 2.0**-target.mantissa
    with SILENT_NAN():
        steps = values / power
        result = np.asarray(np.rint(steps) if rounding == "nearest" else np.trunc(steps)) * power
    if rounding == "truncate" or not target.signed:
        limited = np.clip(result, -target.maximum, target.maximum)
        return np.where(np.isinf(values), values, limited)[()]
    return np.where(np.abs(result) > target.maximum, np.copysign(np.inf, result), result)[()]
