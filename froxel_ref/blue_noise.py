"""Blue noise: tiles made by void-and-cluster, those that are shipped, and what pixels of a frame find in them."""

from __future__ import annotations

import importlib.resources
import math
from collections.abc import Sequence
from decimal import MIN_EMIN, Context, Decimal, localcontext
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import DTypeLike, NDArray

from froxel_ref.arrays import Field
from froxel_ref.records import InputError, shown

__all__ = ["SEED", "blue_noise", "noise_at", "rank_pattern", "to_bytes", "void_and_cluster"]

SEED = 1
"""The seed of the shipped tiles; tile (component, layer) has the seed (SEED, component, layer)."""

Bits = NDArray[np.bool_]

_FILE = "blue_noise.npy"
_SPARSE = 6.0  # distance between neighbours [σ] from which on energies are summed anew, see `_thin`


def void_and_cluster(size: int, seed: int | Sequence[int], *, sigma: float = 1.5, share: float = 0.1
                     ) -> NDArray[np.int64]:
    """Order the pixels of a tile such that the first n of them are spread evenly, whatever n is.

    Parameters
    ----------
    size : int
        Pixels along each edge of the tile, at least 1.
    seed : int or sequence of int
        Of the first pattern, at least 0.
    sigma : float, default 1.5
        [pixels] Standard deviation of the Gaussian that clusters and voids are told by, 0.5 to ``size`` (or 0.5).
        1.5 is the published one.
    share : float, default 0.1
        Share of the pixels that the first pattern has, in (0, ½].

    Returns
    -------
    ndarray, int64, shape (size, size)
        Each of 0 … size² − 1 once.

    Raises
    ------
    InputError
        A size, seed, sigma or share outside of these.

    Notes
    -----
    [Ulichney 1993]: `rank_pattern` of pixels drawn at random. They are drawn by the generator's raw words, whose
    stream NumPy keeps from version to version, and the energies are whole numbers: the same ranks on every machine.

    Examples
    --------
    >>> void_and_cluster(4, 1)
    array([[ 8,  2, 10,  1],
           [ 4, 12,  6, 14],
           [11,  0,  9,  3],
           [ 7, 15,  5, 13]])
    """
    _check_whole("size", size, 1)
    for word in seed if isinstance(seed, Sequence) else (seed,):
        _check_whole("seed", word, 0)
    if not 0.0 < share <= 0.5:
        raise InputError("share", f"is {shown(share)}, must be above 0 and at most 0.5")
    words = np.random.PCG64(np.random.SeedSequence(seed)).random_raw(size * size)
    pattern = np.zeros(size * size, bool)
    pattern[np.argsort(words, kind="stable")[:max(1, int(share * size * size))]] = True
    return rank_pattern(pattern.reshape(size, size), sigma=sigma)


def rank_pattern(pattern: Bits, *, sigma: float = 1.5) -> NDArray[np.int64]:
    """Order the pixels of a tile, starting from a pattern of some of them.

    Parameters
    ----------
    pattern : ndarray of bool, shape (n, n)
        Any pixels, one at least.
    sigma : float, default 1.5
        [pixels] As for `void_and_cluster`.

    Returns
    -------
    ndarray, int64, shape (n, n)
        Each of 0 … n² − 1 once.

    Raises
    ------
    InputError
        A pattern that is not square, not of truth values, or empty; sigma out of bounds.

    Notes
    -----
    [Ulichney 1993]. The energy of a pixel is the sum over the pattern's pixels of the torus-wrapped Gaussian
    Σ over i, j of exp(−((x + i·n)² + (y + j·n)²)/(2σ²)). The pattern's pixel of most energy, its tightest cluster, is
    moved to the free pixel of least energy, its largest void, until it would go back to where it was (or to a place
    as crowded; the sum of all pairs falls with each move, so this ends). Then the pattern's pixels are taken away,
    tightest cluster first, which gives ranks from the highest to 0; and the free pixels are filled, largest void
    first, which gives the ranks above. The published third phase fills the tightest cluster of the free pixels
    instead: this is the same pixel, since the energies of a pattern and of its complement add up to a constant.

    A move costs n² additions of whole numbers, so nothing drifts. Where two pixels have the same energy the first
    one, row by row, is taken: always so for the last two, and where moving every pixel alike maps the pattern to
    itself.

    Examples
    --------
    >>> corner = np.zeros((3, 3), bool)
    >>> corner[0, 0] = True
    >>> rank_pattern(corner)
    array([[0, 3, 5],
           [4, 1, 7],
           [6, 8, 2]])
    """
    if pattern.ndim != 2 or pattern.shape[0] != pattern.shape[1] or pattern.dtype != np.bool_ or not pattern.any():
        raise InputError("pattern", f"has shape {pattern.shape}, type {pattern.dtype} and {np.count_nonzero(pattern)} "
                                    "pixels, must be a square of truth values, one at least true")
    size = pattern.shape[0]
    if not 0.5 <= sigma <= max(size, 0.5):
        raise InputError("sigma", f"is {shown(sigma)}, must be 0.5 to {max(size, 0.5)}")
    bell = _bell(size, sigma)
    ones = pattern.copy()
    energy = np.zeros(ones.shape, np.int64)
    for at in np.flatnonzero(ones):
        energy += bell.about(at)
    _even_out(ones, energy, bell)
    free = _thin(~ones, bell.whole.sum() - energy, bell)
    order = [*reversed(_thin(ones, energy, bell)), *free]
    ranks = np.empty(size * size, np.int64)
    ranks[order] = np.arange(size * size)
    return ranks.reshape(size, size)


class _Bell(NamedTuple):
    """The torus-wrapped Gaussian about pixel (0, 0)."""

    sparse: int  # as many pixels or fewer are sparse
    mantissa: NDArray[np.float64]  # (n, n)
    exponent: NDArray[np.int64]  # (n, n), of 2
    whole: NDArray[np.int64]  # (n, n), in units that make the sum 2^61
    tiled: NDArray[np.int64]  # (2n, 2n)

    def about(self, at: int | np.intp) -> NDArray[np.int64]:
        """About another pixel, given by its flat index."""
        size = len(self.whole)
        y, x = divmod(int(at), size)
        return self.tiled[size - y:2 * size - y, size - x:2 * size - x]


def _bell(size: int, sigma: float) -> _Bell:
    """In decimal arithmetic, whose exponential is rounded correctly everywhere."""
    images = range(-1 - math.ceil(12.0 * sigma / size), 2 + math.ceil(12.0 * sigma / size))  # e^(−72) is left out
    with localcontext(Context(prec=40, Emin=MIN_EMIN)):
        scale = -1 / (2 * Decimal(float(sigma))**2)
        line = [sum((((d + k * size)**2 * scale).exp() for k in images), Decimal(0)) for d in range(size)]
        total = sum(line, Decimal(0))
        unit = 2**61 / (total * total)
        whole = np.array([[int((a * b * unit).to_integral_value()) for a in line] for b in line], np.int64)
        powers = [int(value.ln() / Decimal(2).ln()) for value in line]
        shares = np.array([float(value / Decimal(2)**power) for value, power in zip(line, powers, strict=True)])
    exponent = np.array(powers, np.int64)
    sparse = int((size / (_SPARSE * sigma))**2)
    return _Bell(sparse, np.multiply.outer(shares, shares), np.add.outer(exponent, exponent), whole,
                 np.tile(whole, (2, 2)))


def _even_out(ones: Bits, energy: NDArray[np.int64], bell: _Bell) -> None:
    """Move pixels from the tightest clusters to the largest voids, in place."""
    flat, heights = ones.reshape(-1), energy.reshape(-1)
    while True:
        cluster = np.argmax(np.where(flat, heights, -1))
        flat[cluster] = False
        energy -= bell.about(cluster)
        void = np.argmin(np.where(flat, _FULL, heights))
        if heights[void] >= heights[cluster]:
            void = cluster
        flat[void] = True
        energy += bell.about(void)
        if void == cluster:
            return


_FULL = np.iinfo(np.int64).max


def _thin(points: Bits, energy: NDArray[np.int64], bell: _Bell) -> list[int]:
    """The order in which the tightest cluster is taken away, until nothing is left; uses its arguments up.

    Pixels far apart have a bell's tails alone in common, which whole numbers do not hold (at 6 σ they have 31 bits).
    The last ones are told by sums over all their pairs, without the pixel's own share, in floating point: each such
    sum is of positive numbers, so it is as exact as they are. It is taken row by row, in an order that no processor
    changes.
    """
    flat, heights, order = points.reshape(-1), energy.reshape(-1), []
    for _ in range(int(np.count_nonzero(flat)) - bell.sparse):
        cluster = int(np.argmax(np.where(flat, heights, -1)))
        flat[cluster] = False
        energy -= bell.about(cluster)
        order.append(cluster)
    last, energies = np.flatnonzero(flat), np.zeros(0)
    while len(last):
        if not energies.max(initial=0.0) > _FAINT:
            pairs = _pairs(last, bell)
            energies = pairs.sum(axis=0)
        place = int(np.argmax(energies))
        order.append(int(last[place]))
        last = np.delete(last, place)
        pairs = np.delete(np.delete(pairs, place, 0), place, 1)
        energies = pairs.sum(axis=0)
    return order


_FAINT = 2.0**-500


def _pairs(at: NDArray[np.intp], bell: _Bell) -> NDArray[np.float64]:
    """What each pixel gets from each other one, the largest of it about 1, and 0 from itself."""
    y, x = ((part - part[:, np.newaxis]) % len(bell.whole) for part in np.divmod(at, len(bell.whole)))
    exponent, apart = bell.exponent[y, x], ~np.eye(len(at), dtype=bool)
    exponent -= exponent.max(initial=exponent.min(), where=apart)
    shifts = np.maximum(np.where(apart, exponent, 0), -1100).astype(np.int32)  # which is 0 already
    pairs: NDArray[np.float64] = np.ldexp(bell.mantissa[y, x], shifts) * apart
    return pairs


def to_bytes(ranks: NDArray[np.integer[Any]]) -> NDArray[np.uint8]:
    """Ranks in the 256 steps that a texture of bytes has.

    Parameters
    ----------
    ranks : ndarray of int, shape (n, n)
        Each of 0 … n² − 1 once.

    Returns
    -------
    ndarray, uint8, shape (n, n)
        ⌊256·rank/n²⌋: each value equally often, where 256 divides n².

    Examples
    --------
    >>> to_bytes(np.array([[0, 1], [2, 3]]))
    array([[  0,  64],
           [128, 192]], dtype=uint8)
    """
    steps: NDArray[np.uint8] = (ranks.astype(np.int64) * 256 // ranks.size).astype(np.uint8)
    return steps


def blue_noise(*, dtype: DTypeLike = np.float64) -> Field:
    """The shipped tiles of blue noise.

    Parameters
    ----------
    dtype : dtype, default float64
        A floating-point type; the values are exact in each of them.

    Returns
    -------
    ndarray, shape (4, 64, 64, 64)
        [component, layer, y, x], values (v + ½)/256 with v = 0 … 255, each 16 times in a tile: in (0, 1), of mean ½.

    Notes
    -----
    Made by `void_and_cluster`, every tile of its own seed, so neither components nor layers have to do with each
    other. A tile repeats without a seam. Read from the package's file at each call.

    A texture unit would return v/255, of mean ½ too, with the ends 0 and 1; the half step is for values that are
    sample positions, as is usual.

    Examples
    --------
    >>> noise = blue_noise()
    >>> noise.shape, float(noise.mean()), float(noise.min()) == 0.5 / 256
    ((4, 64, 64, 64), 0.5, True)
    """
    return _values(_stored(), dtype)


def noise_at(rows: NDArray[np.integer[Any]], columns: NDArray[np.integer[Any]], frame: int, *,
             noise: Field | None = None, dtype: DTypeLike | None = None) -> Field:
    """What pixels of a frame find in the tiles.

    Parameters
    ----------
    rows, columns : ndarray of int, broadcastable to a common shape (…)
        Pixels, from the top left one; the tile is repeated.
    frame : int
        The frame's number; it takes the layer ``frame`` modulo the number of layers.
    noise : ndarray, shape (components, layers, height, width), optional
        Default: `blue_noise`.
    dtype : dtype, optional
        Default: that of ``noise``, or float64.

    Returns
    -------
    ndarray, shape (components, …)
        The values of the components, in (0, 1) for the shipped tiles.

    Raises
    ------
    InputError
        Rows, columns or a frame that are not whole numbers; noise without its four axes.

    Notes
    -----
    [Dörries 2020, listing 3.12], whose change of range is left to who asks.

    Examples
    --------
    >>> rows, columns = np.arange(2).reshape(-1, 1), np.arange(3)
    >>> here, there = noise_at(rows, columns, 0), noise_at(rows + 64, columns - 64, 128)
    >>> here.shape, np.array_equal(here, there)
    ((4, 2, 3), True)
    """
    for name, value in (("rows", rows), ("columns", columns)):
        if np.asarray(value).dtype.kind not in "iu":
            raise InputError(name, f"has type {np.asarray(value).dtype}, must be of whole numbers")
    _check_whole("frame", frame, None)
    if noise is not None and (noise.ndim != 4 or 0 in noise.shape):
        raise InputError("noise", f"has shape {noise.shape}, must be (components, layers, height, width)")
    tiles: NDArray[Any] = _stored() if noise is None else noise
    _, layers, height, width = tiles.shape
    layer = tiles[:, int(frame) % layers]
    found = layer[:, np.asarray(rows) % height, np.asarray(columns) % width]
    if noise is None:
        return _values(found, np.float64 if dtype is None else dtype)
    return np.array(found, noise.dtype if dtype is None else dtype)


def _stored() -> NDArray[np.uint8]:
    with importlib.resources.as_file(importlib.resources.files("froxel_ref") / "data" / _FILE) as path:
        stored: NDArray[np.uint8] = np.load(path, allow_pickle=False)
    return stored


def _values(stored: NDArray[np.uint8], dtype: DTypeLike) -> Field:
    values: Field = stored.astype(dtype)
    values += values.dtype.type(0.5)
    values *= values.dtype.type(1.0 / 256.0)
    return values


def _check_whole(name: str, value: object, least: int | None) -> None:
    if isinstance(value, bool) or not isinstance(value, (int, np.integer)) or (least is not None and value < least):
        allowed = "a whole number" + ("" if least is None else f", at least {least}")
        raise InputError(name, f"is {shown(value)}, must be {allowed}")
