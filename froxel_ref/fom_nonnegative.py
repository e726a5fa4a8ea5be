"""The smoothest non-negative extinction with given Fourier coefficients: the positive part of a trigonometric sum.

Where the Fourier series itself is nowhere negative, it is that series.
"""

from __future__ import annotations

from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

__all__ = ["basis", "least_energy", "lowest", "negative_arcs"]

Reals: TypeAlias = NDArray[np.float64]
Integers: TypeAlias = NDArray[np.integer[Any]]
Mask: TypeAlias = NDArray[np.bool_]

NODES = 16  # of the quadrature, for each of K + 1 frequencies
STEPS = 16  # of Newton's method at most; a few are enough where the series is hardly negative
DAMPING = 0.05  # of a step, times the residual: 0.01 to 0.1 end within a tenth of each other
CLOSE = 3e-5  # residual at which steps end, per unit of optical depth: below what 8 bits of transmittance show
ROOT_STEPS = 40  # of Newton's method in a bracket at most; most roots take five, those of shallow dips twenty
ROWS = 64  # of a matrix product at a time
NOWHERE = 2.0  # where arcs lie that do not exist


def basis(depth: Reals, harmonics: int) -> Reals:
    """1, cos 2πkx and sin 2πkx, k = 1 … K, at points.

    Parameters
    ----------
    depth : ndarray, shape (m,) [1]
    harmonics : int
        K.

    Returns
    -------
    ndarray, shape (2 K + 1, m) [1]

    Examples
    --------
    >>> basis(np.array([0.25]), 1).round(12).tolist()
    [[1.0], [0.0], [1.0]]
    """
    angle = 2.0 * np.pi * np.arange(1, harmonics + 1)[:, None] * depth
    return np.concatenate([np.ones((1, depth.size)), np.cos(angle), np.sin(angle)])


def nodes(harmonics: int) -> Reals:
    """Where sums are looked at, evenly from 0 on."""
    return np.arange(NODES * (harmonics + 1)) / (NODES * (harmonics + 1))


def least_energy(series: Reals) -> Reals:
    """The trigonometric sum whose positive part has the coefficients of a series.

    Parameters
    ----------
    series : ndarray of float64, shape (n, 2 K + 1) [1]
        Fourier series in the order of `basis`, per unit of optical depth: the first column is 1.

    Returns
    -------
    ndarray, shape (n, 2 K + 1) [1]

    Notes
    -----
    Of all σ ≥ 0 with the coefficients, the positive part of a sum p of the same harmonics has the least ∫σ². Its p
    minimises the convex ½∫max(p, 0)² − ∫p·series, a small system of equations that Newton's method solves, damped by
    a multiple of the residual [Li 2004]; integrals are sums over nodes. Narrow bumps make the system as ill
    conditioned as 1e8, thin layers insoluble; then what the steps end with is taken, the best of them.

    Examples
    --------
    >>> series = np.array([[1.0, 1.8, 0.6]])
    >>> p = least_energy(series) @ basis(nodes(1), 1)
    >>> bool(np.abs(np.maximum(p, 0.0) @ basis(nodes(1), 1).T / p.size * [1, 2, 2] - series).max() < 1e-4)
    True
    """
    harmonics = series.shape[1] // 2
    functions = basis(nodes(harmonics), harmonics)
    mean = functions.T / functions.shape[1]
    products = (functions[:, None] * functions).reshape(-1, functions.shape[1]).T / functions.shape[1]
    weight = np.where(np.arange(series.shape[1]) == 0, 1.0, 0.5)
    best, left = series.copy(), np.full(len(series), np.inf)
    going, current = np.arange(len(series)), series.copy()
    for step in range(STEPS + 1):
        values = product(current, functions)
        residual = (current - series[going]) * weight + product(np.maximum(-values, 0.0), mean)
        size = np.abs(residual).max(axis=1)
        better = size < left[going]
        best[going[better]], left[going[better]] = current[better], size[better]
        open_ = size > CLOSE
        if step == STEPS or not open_.any():
            break
        going, current, residual = going[open_], current[open_], residual[open_]
        hessian = product((values[open_] > 0.0).astype(np.float64), products).reshape(-1, *2 * weight.shape)
        hessian += (DAMPING * size[open_])[:, None, None] * np.diag(weight)
        current = current - np.linalg.solve(hessian, residual[..., None])[..., 0]
    return best


def product(rows: Reals, matrix: Reals) -> Reals:
    """Matrix product in pieces too small for threads of BLAS, which would fight with those that run the blocks."""
    whole = len(rows) // ROWS * ROWS
    result = np.empty((len(rows), matrix.shape[1]))
    np.matmul(rows[:whole].reshape(-1, ROWS, rows.shape[1]), matrix,
              out=result[:whole].reshape(-1, ROWS, matrix.shape[1]))
    result[whole:] = rows[whole:] @ matrix
    return result


# --- where a sum is negative ------------------------------------------------------------------------


def lowest(sums: Reals) -> Reals:
    """The least values of trigonometric sums.

    Parameters
    ----------
    sums : ndarray of float64, shape (n, 2 K + 1) [1]
        In the order of `basis`.

    Returns
    -------
    ndarray, shape (n,) [1]
        At the nodes, and between them where a sum is negative there alone.

    Examples
    --------
    >>> float(lowest(np.array([[0.999, np.cos(0.1), np.sin(0.1)]]))[0].round(12))
    -0.001
    """
    values, slopes = _at_nodes(sums)
    result = values.min(axis=1)
    texel, _, _, value = _bottoms(sums, values, slopes)
    np.minimum.at(result, texel, value)
    return np.asarray(result)


def negative_arcs(sums: Reals) -> tuple[Reals, Reals]:
    """Where trigonometric sums are below 0.

    Parameters
    ----------
    sums : ndarray of float64, shape (n, 2 K + 1) [1]
        In the order of `basis`.

    Returns
    -------
    start, stop : ndarray, shape (K + 1, n) [1]
        Arcs of [0, 1] in order, an arc across the ends as two; 2 and 2 for those that do not exist.

    Notes
    -----
    Signs at the nodes tell where to look, and slopes where a sum may dip between two; what is above −1e-13 of the
    sum's coefficients counts as 0. Ends are good to rounding over slope.

    Examples
    --------
    >>> start, stop = negative_arcs(np.array([[1.0, 2.0, 0.0]]))
    >>> start[:, 0].round(6).tolist(), stop[:, 0].round(6).tolist()
    ([0.333333, 2.0], [0.666667, 2.0])
    """
    slack = 1e-13 * np.abs(sums).sum(axis=1)
    values, slopes = _at_nodes(sums)
    cell = 1.0 / values.shape[1]
    values = values + slack[:, None]
    below = values < 0.0
    after = np.roll(below, -1, axis=1)
    starts, stops = ([_crossing(sums, texel, cell * index, cell * (index + 1))]
                     for texel, index in (np.nonzero(~below & after), np.nonzero(below & ~after)))
    texel, index, bottom, value = _bottoms(sums, values, slopes)
    deep = value < -slack[texel]
    texel, index, bottom = texel[deep], index[deep], bottom[deep]
    starts.append(_crossing(sums, texel, cell * index, bottom))
    stops.append(_crossing(sums, texel, bottom, cell * (index + 1)))
    across = np.flatnonzero(below[:, 0])
    starts.append((across, np.zeros(across.size)))
    stops.append((across, np.ones(across.size)))
    return _in_rows(starts, sums.shape), _in_rows(stops, sums.shape)


def _bottoms(sums: Reals, values: Reals, slopes: Reals) -> tuple[Integers, Integers, Reals, Reals]:
    """Minima between two nodes where a sum is not negative but may be in between: texels, cells, places, values."""
    cell = 1.0 / values.shape[1]
    later, rise = np.roll(values, -1, axis=1), np.roll(slopes, -1, axis=1)
    # Twice as far as the steeper slope takes it: a cell is a sixteenth of the shortest wave, or less.
    near = np.minimum(values, later) < 2.0 * cell * np.maximum(-slopes, rise)
    texel, index = np.nonzero((values >= 0.0) & (later >= 0.0) & (slopes < 0.0) & (rise > 0.0) & near)
    _, bottom = _crossing(sums, texel, cell * index, cell * (index + 1), True)
    return texel, index, bottom, _value(sums[texel], bottom, False)[0]


def _at_nodes(sums: Reals) -> tuple[Reals, Reals]:
    """Values and slopes at the nodes, shape (n, nodes) each."""
    harmonics = sums.shape[1] // 2
    functions = basis(nodes(harmonics), harmonics)
    k = 2.0 * np.pi * np.arange(1, harmonics + 1)[:, None]
    cosines, sines = functions[1:harmonics + 1], functions[harmonics + 1:]
    slopes = np.concatenate([np.zeros_like(functions[:1]), -k * sines, k * cosines])
    return product(sums, functions), product(sums, slopes)


def _value(sums: Reals, x: Reals, derived: bool) -> tuple[Reals, Reals]:
    """Each sum's value and slope at a point of its own, or its slope and the slope of that."""
    harmonics = sums.shape[1] // 2
    turn = np.exp(2j * np.pi * x)
    power = np.ones_like(turn)
    value, slope = (np.zeros(x.shape) if derived else sums[:, 0].copy()), np.zeros(x.shape)
    for k in range(1, harmonics + 1):
        power = power * turn
        rate = 2.0 * np.pi * k
        term = sums[:, k] * power.real + sums[:, harmonics + k] * power.imag
        rise = rate * (sums[:, harmonics + k] * power.real - sums[:, k] * power.imag)
        value, slope = (value + rise, slope - rate**2 * term) if derived else (value + term, slope + rise)
    return value, slope


def _crossing(sums: Reals, texel: Integers, low: Reals, high: Reals, derived: bool = False
              ) -> tuple[Integers, Reals]:
    """Where sums, or their slopes, change sign between two points: texels and places."""
    chosen = sums[texel]
    falls = _value(chosen, low, derived)[0] >= 0.0
    x = 0.5 * (low + high)
    for _ in range(ROOT_STEPS):
        value, slope = _value(chosen, x, derived)
        before = (value >= 0.0) == falls
        low, high = np.where(before, x, low), np.where(before, high, x)
        newton = x - np.divide(value, slope, out=np.full_like(x, np.inf), where=slope != 0.0)
        newton = np.where((newton >= low) & (newton <= high), newton, 0.5 * (low + high))
        settled = np.abs(newton - x).max(initial=0.0) < 1e-15
        x = newton
        if settled:
            break
    return texel, x


def _in_rows(ends: list[tuple[Integers, Reals]], shape: tuple[int, ...]) -> Reals:
    """Places by texel, in order, at most K + 1 of each."""
    texel, place = (np.concatenate(part) for part in zip(*ends, strict=True))
    order = np.lexsort((place, texel))
    texel, place = texel[order], place[order]
    rank = np.arange(texel.size) - np.searchsorted(texel, texel)
    result = np.full((shape[1] // 2 + 1, shape[0]), NOWHERE)
    kept = rank < len(result)
    result[rank[kept], texel[kept]] = place[kept]
    return result
