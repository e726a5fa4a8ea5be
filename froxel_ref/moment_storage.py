"""How moments are stored, and the bias that takes what storage rounds back to moments that something can have.

Rounded moments may belong to no distribution. A little of a fixed distribution is mixed in, whose moments are far
from that border [Peters 2015; Münstermann 2018]. Three storages:

======= =========================================================== ================================
float32 sums as they are gathered                                   published weights and moments
unorm16 b_0 as float32; the others over b_0, mixed to span [0, 1]   published weights and moments
float16 sums, as those of a Fourier opacity map                     weights measured here
======= =========================================================== ================================

The published weights of power moments in float32 are as two ports of the authors' program have them, which name the
paper's supplement; those of unorm16 and of trigonometric moments are as one port notes them. Measured on 600,000 rays
of 1 to 5 points or stretches, the least weights that make all moments possible ones are:

============= ===================== ======================= =====================
moments       float32               unorm16                 float16
============= ===================== ======================= =====================
4, 6, 8       4e-7, 6e-6, 2e-5      4e-5, 5e-5, 4e-3        3e-3, 3e-2, 0.14
2, 3, 4 trig. 1e-7, 2e-7, 2e-7      4e-5, 6e-5, 7e-5        1e-3, 2e-3, 2e-3
============= ===================== ======================= =====================

of which the weights used for float16 are those, rounded up.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple, TypeAlias, TypeVar

import numpy as np
from numpy.typing import NDArray

from froxel_ref.arrays import Field
from froxel_ref.records import InputError, shown, suggest
from froxel_ref.storage import store, store_series

__all__ = ["BIASES", "STORAGES", "TRIGONOMETRIC_WEIGHTS", "Bias", "normalised_moments", "stored_moments"]

Array: TypeAlias = NDArray[np.floating[Any]]
Known = TypeVar("Known")

STORAGES = ("float32", "float16", "unorm16")


class Bias(NamedTuple):
    """How much of a fixed distribution is mixed in, and its moments.

    Attributes
    ----------
    weight : float [1]
        In [0, 1].
    moments : tuple of float [1]
        b_1 … b_n, with b_0 = 1.
    """

    weight: float
    moments: tuple[float, ...]


_SINGLE = {4: (0.0, 0.375, 0.0, 0.375), 6: (0.0, 0.48, 0.0, 0.451, 0.0, 0.45),
           8: (0.0, 0.75, 0.0, 0.67666666666666664, 0.0, 0.63, 0.0, 0.60030303030303034)}
_MIXED = {4: (0.0, 0.628, 0.0, 0.628), 6: (0.0, 0.5566, 0.0, 0.489, 0.0, 0.47869382),
          8: (0.0, 0.42474916387959866, 0.0, 0.22407802675585284, 0.0, 0.15369230769230768, 0.0, 0.12900440529089119)}
BIASES: Mapping[tuple[str, int], Bias] = {
    ("float32", 4): Bias(5e-7, _SINGLE[4]),
    ("float32", 6): Bias(5e-6, _SINGLE[6]),
    ("float32", 8): Bias(5e-5, _SINGLE[8]),
    ("unorm16", 4): Bias(6e-5, _MIXED[4]),
    ("unorm16", 6): Bias(6e-4, _MIXED[6]),
    ("unorm16", 8): Bias(2.5e-3, _MIXED[8]),
    ("float16", 4): Bias(4e-3, _SINGLE[4]),
    ("float16", 6): Bias(3e-2, _MIXED[6]),
    ("float16", 8): Bias(0.15, _SINGLE[8]),
}
"""By storage and number of power moments. float32 and unorm16 as published; float16 measured here."""

TRIGONOMETRIC_WEIGHTS: Mapping[tuple[str, int], float] = {
    ("float32", 2): 4e-7, ("float32", 3): 8e-7, ("float32", 4): 1.5e-6,
    ("unorm16", 2): 4e-4, ("unorm16", 3): 6.5e-4, ("unorm16", 4): 8.5e-4,
    ("float16", 2): 2e-3, ("float16", 3): 2e-3, ("float16", 4): 2e-3,
}
"""By storage and number of trigonometric moments, whose bias distribution is uniform: all of its moments are 0."""

# Odd and even moments are mixed so that each number of unorm16 storage spans [0, 1] [Münstermann 2018].
_ODD = {
    4: ((1.5, -2.0), (0.8660254037844386, -0.3849001794597505)),
    6: ((2.5, -10.0, 8.0), (-1.87499864450, 4.20757543111, -1.83257678661),
        (1.26583039016, -1.47644882902, 0.71061660238)),
    8: ((3.48044635732474, -27.5760737514826, 55.1267384344761, -31.5311110403183),
        (1.26797185782836, -0.928755808743913, -2.07520453231032, 1.23598848322588),
        (-2.1671560004294, 6.17950199592966, -0.276515571579297, -4.23583042392097),
        (0.974332879165755, -0.443426830933027, -0.360491648368785, 0.310149466050223)),
}
_EVEN = {
    4: ((4.0, -4.0), (0.5, 0.5)),
    6: ((4.0, -4.0, 0.0), (9.0, -24.0, 16.0), (-0.57759806484, 4.61936647543, -3.07953906655)),
    8: ((0.280504133158527, -0.757633844606942, 0.392179589334688, -0.887531871812237),
        (-2.01362265883247, 0.221551373038988, -1.06107954265125, 2.83887201588367),
        (-7.31010494985321, 13.9855979699139, -0.114305766176437, -7.4361899359832),
        (-15.8954215629556, 79.6186327084103, -127.457278992502, 63.7349456687829)),
}
_EVEN_OFFSET = {4: (0.0, 0.0), 6: (0.0, 0.0, 0.018888946),
                8: (0.972481993925964, 1.0, 0.999179192513328, 0.991778293073131)}


def stored_moments(moments: Field, storage: str | None, *, power: bool = True) -> Array:
    """What a texture keeps of moments.

    Parameters
    ----------
    moments : ndarray, shape (1 + n, …) [1]
        Sums: b_0, then n power moments, or the real and imaginary parts of n/2 trigonometric ones.
    storage : {"float32", "float16", "unorm16"}, optional
        As above. Default: as they are.
    power : bool
        Which of the two they are, for "unorm16": trigonometric moments are not mixed, but halved and shifted by ½.

    Returns
    -------
    ndarray, shape (1 + n, …) [1]
        In the type that they came in.

    Raises
    ------
    InputError
        An unknown storage; power moments in unorm16 of which there are not 4, 6 or 8.

    Notes
    -----
    In float16, sums beyond 65504 are all scaled down by one factor, where a GPU's would become infinite: nothing
    passes there. 16-bit integers cannot be added up by blending; they are made of complete sums.

    Examples
    --------
    >>> stored_moments(np.array([3.0, 1.0, 1 / 3, 0.1, 0.1]), "float16").tolist()[2]
    0.333251953125
    """
    check_storage(storage)
    if storage is None:
        return moments
    if storage == "float32":
        return store(moments, storage)
    if storage == "float16":
        return store_series(moments, storage)
    shares = _shares(moments)
    codes = (_mixed(shares, _mixing(len(shares)), 0.5, _even_offset(len(shares))) if power
             else 0.5 * shares + 0.5)
    return np.concatenate([store(moments[:1], "float32"), store(codes, "unorm16")])


def normalised_moments(stored: Field, storage: str | None, *, power: bool = True) -> tuple[Array, Array]:
    """The whole optical depth and the moments over it, from what a texture keeps.

    Parameters
    ----------
    stored, storage, power
        From and as for `stored_moments`.

    Returns
    -------
    whole : ndarray, shape (…) [1]
        b_0.
    shares : ndarray, shape (n, …) [1]
        b_k/b_0, in [−1, 1]; 0 where b_0 is.

    Raises
    ------
    InputError
        As for `stored_moments`.

    Examples
    --------
    >>> whole, shares = normalised_moments(np.array([4.0, 2.0, 1.0]), None)
    >>> float(whole), shares.tolist()
    (4.0, [0.5, 0.25])
    """
    check_storage(storage)
    if storage != "unorm16":
        return stored[0], _shares(stored)
    if not power:
        return stored[0], 2.0 * stored[1:] - 1.0
    count = len(stored) - 1
    offset = _even_offset(count)
    codes = stored[1:].copy()
    codes[0::2] -= 0.5
    codes[1::2] -= offset.reshape(-1, *(1,) * (codes.ndim - 1))
    odd_matrix, even_matrix = (np.asarray(np.linalg.inv(m)) for m in _mixing(count))
    shares = _mixed(codes, (odd_matrix, even_matrix), 0.0, np.zeros_like(offset))
    return stored[0], np.clip(shares, -1.0, 1.0)


def known_bias(biases: Mapping[tuple[str, int], Known], storage: str | None, count: int) -> Known:
    """What a table of biases has for a storage, float32's where nothing is stored, and a number of moments."""
    key = storage or "float32", count
    if key not in biases:
        raise InputError("bias", f"is not known for {count} moments, must be given")
    return biases[key]


def check_storage(storage: str | None) -> None:
    """Refuse what is no storage of moments."""
    if storage is not None and storage not in STORAGES:
        raise InputError("storage", f"is {shown(storage)}; {suggest(str(storage), STORAGES)}")


def _shares(moments: Field) -> Array:
    empty = moments[0] <= 0.0
    return np.clip(moments[1:] / np.where(empty, 1.0, moments[0]), -1.0, 1.0)


def _mixing(count: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    if count not in _ODD:
        raise InputError("moments", f"are {count}, must be 4, 6 or 8 for unorm16")
    return np.array(_ODD[count]), np.array(_EVEN[count])


def _even_offset(count: int) -> NDArray[np.float64]:
    return np.array(_EVEN_OFFSET.get(count, ()))


def _mixed(moments: Field, matrices: tuple[Field, Field], odd: float, even: Field) -> Array:
    """Odd moments (b_1, b_3 …) by one matrix, even ones by another, each with an offset."""
    result = np.empty_like(moments)
    for place, (matrix, offset) in enumerate(zip(matrices, (np.full(len(even), odd), even), strict=True)):
        mixed = np.tensordot(matrix.astype(moments.dtype), moments[place::2], axes=1)
        result[place::2] = mixed + offset.astype(moments.dtype).reshape(-1, *(1,) * (moments.ndim - 1))
    return result
