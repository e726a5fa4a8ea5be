"""Distances counted in numbers of a floating point type."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from froxel_ref.arrays import Field
from froxel_ref.records import InputError

__all__ = ["INCOMPARABLE", "checked", "ulp_distance"]

INCOMPARABLE = np.uint64(0xFFFF_FFFF_FFFF_FFFF)
"""The distance in ulp between NaN or infinity and anything else; above every distance of finite numbers."""

# By bytes of a float.
INTEGERS: dict[int, type[np.signedinteger[Any]]] = {2: np.int16, 4: np.int32, 8: np.int64}


def checked(result: ArrayLike, expected: ArrayLike) -> tuple[Field, Field]:
    """Two arrays that can be compared element by element.

    Parameters
    ----------
    result, expected : array_like
        float16, float32 or float64.

    Returns
    -------
    (ndarray, ndarray)

    Raises
    ------
    InputError
        Another type, types or shapes that differ, or no elements.

    Examples
    --------
    >>> checked([1.0], [2.0])
    (array([1.]), array([2.]))
    """
    a, b = np.asarray(result), np.asarray(expected)
    for name, array in (("result", a), ("expected", b)):
        if array.dtype not in (np.float16, np.float32, np.float64):
            raise InputError(name, f"has type {array.dtype}, must be float16, float32 or float64")
    if a.dtype != b.dtype:
        raise InputError("result", f"has type {a.dtype}, must be {b.dtype} like what is expected")
    if a.shape != b.shape:
        raise InputError("result", f"has shape {a.shape}, must be {b.shape} like what is expected")
    if a.size == 0:
        raise InputError("result", f"has shape {a.shape}: nothing to compare")
    return a, b


def ulp_distance(result: ArrayLike, expected: ArrayLike) -> NDArray[np.uint64]:
    """How many numbers of the type lie between two values, element by element.

    Parameters
    ----------
    result, expected : array_like
        float16, float32 or float64, the same type and shape.

    Returns
    -------
    ndarray of uint64
        0 for equal numbers (0 and −0 among them), for the same infinity and for two NaN; counted through
        denormals and across zero for the others; `INCOMPARABLE` if one of them is NaN or infinite.

    Raises
    ------
    InputError
        As for `absolute`.

    Notes
    -----
    The bits of a float, read as an integer, order the numbers of one sign; negative ones are mirrored.
    From −1.8e308 to 1.8e308 the distance still fits into 64 bits.

    Examples
    --------
    >>> tiny = np.finfo(np.float64).smallest_subnormal
    >>> ulp_distance([1.0 + 2.0**-52, -0.0, -tiny, np.inf], [1.0, 0.0, tiny, 1.7976931348623157e308]).tolist()
    [1, 0, 2, 18446744073709551615]
    """
    a, b = checked(result, expected)
    first, second = _ordered(a), _ordered(b)
    swapped = first < second
    low, high = np.where(swapped, first, second), np.where(swapped, second, first)
    distance = high.view(np.uint64) - low.view(np.uint64)  # modulo 2⁶⁴, hence right where int64 overflows
    both_nan = np.isnan(a) & np.isnan(b)
    strange = ~(np.isfinite(a) & np.isfinite(b)) & (first != second)
    return np.where(both_nan, np.uint64(0), np.where(strange, INCOMPARABLE, distance))


def _ordered(values: Field) -> NDArray[np.int64]:
    """Integers in the order of the numbers, neighbours 1 apart, both zeros 0."""
    integer = INTEGERS[values.dtype.itemsize]
    bits = np.asarray(values.copy(order="C")).view(integer).astype(np.int64)
    mirrored = np.int64(np.iinfo(integer).min) - bits
    return np.where(bits < 0, mirrored, bits)
