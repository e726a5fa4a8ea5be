"""The inputs on which kernels are tried: random ones, hand-picked extremes, and those of the maps.

A map lays a kernel's first two parameters along its edges, from one end of their ranges to the other; what
was picked beyond that (0, the least denormal, a length of 1e22 m) stands in cells of its own at the edge.
"""

from __future__ import annotations

import itertools
import math
import re
import zlib
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from froxel_ref.arrays import Field
from froxel_ref.kernel_registry import PRECISIONS, Kernel, Parameter

__all__ = ["Axis", "Cases", "Map", "axis", "map_of", "sample", "seed"]

Doubles: TypeAlias = NDArray[np.float64]

COLUMNS, ROWS, POINTS = 40, 26, 240  # cells of a map, without those at its edges; points of a line
LEAST = 1e-30  # where a range that goes far below it is cut off and goes on in single cells
NEXT = 1.0 - 2.0**-52


class Cases(NamedTuple):
    """Inputs, one array per parameter, in the type to compute in."""

    inputs: tuple[Field, ...]


class Axis(NamedTuple):
    """Values along one edge of a map.

    Attributes
    ----------
    values : ndarray
        One a cell, growing.
    kind, label : str
        The parameter's kind; its name and unit.
    ticks : tuple of (float, str)
        Places as shares of the edge, and what stands there; those that matter most first.
    lines : tuple of float
        Shares at which cells outside the range are set apart.
    """

    values: Doubles
    kind: str
    label: str
    ticks: tuple[tuple[float, str], ...]
    lines: tuple[float, ...] = ()

    def share(self, value: float) -> float:
        """Where a value lies along the edge: the middle of the cell that is nearest to it.

        Examples
        --------
        >>> axis(Parameter("length", "m", "magnitude", 1e-2, 1e2), 3, "float64").share(2.0)
        0.5
        """
        distance = np.abs(_spread(self.values, self.kind) - _spread(np.array(value), self.kind))
        return (int(np.argmin(distance)) + 0.5) / len(self.values)


class Map(NamedTuple):
    """A map's edges and inputs; ``up`` is None for one parameter: the map is a line.

    Attributes
    ----------
    across, up : Axis
        Of the first two parameters.
    inputs : tuple of ndarray
        One array per parameter, row by row; the other parameters have their typical values.
    """

    across: Axis
    up: Axis | None
    inputs: tuple[Field, ...]

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""
        return 1 if self.up is None else len(self.up.values), len(self.across.values)


# --- random and hand-picked -------------------------------------------------------------------------


def seed(kernel: Kernel) -> int:
    """Of a kernel's random inputs.

    Examples
    --------
    >>> from froxel_ref.kernel_registry import kernels
    >>> seed(kernels(["rayleigh"])[0])
    4099025668
    """
    return zlib.crc32(kernel.name.encode())


def _drawn(parameter: Parameter, count: int, dtype: Any, rng: np.random.Generator) -> Doubles:
    limits, half = np.finfo(dtype), count // 2
    if parameter.kind == "choice":
        return rng.choice(np.array(parameter.extremes), count)
    even = rng.uniform(parameter.low, parameter.high, count)
    if parameter.kind == "linear":
        near = 10.0 ** -rng.uniform(0.0, limits.precision, count)
        return np.where(np.arange(count) < half, even,
                        parameter.low + (parameter.high - parameter.low) * near)
    if parameter.kind in ("share", "cosine"):
        near = np.copysign(1.0 - 10.0 ** -rng.uniform(0.0, limits.precision, count), even)
        return np.where(np.arange(count) < half, even, near)
    low, high = max(parameter.low, float(limits.tiny)), min(parameter.high, float(limits.max) / 4.0)
    middle = min(max(1.0, low), high)
    near = middle * 2.0 ** rng.uniform(-1.0, 1.0, count)
    wide = np.exp(rng.uniform(math.log(low), math.log(high), count))
    return np.clip(np.where(rng.permutation(count) < half, near, wide), low, high)


def sample(kernel: Kernel, count: int, precision: str) -> Cases:
    """Inputs for a kernel: random ones, then every combination of the hand-picked extremes.

    Parameters
    ----------
    kernel : Kernel
    count : int
        Random inputs.
    precision : str
        A key of `PRECISIONS`.

    Returns
    -------
    Cases
        The same for the same name, count and precision; float32 and float16 share theirs.

    Examples
    --------
    >>> from froxel_ref.kernel_registry import kernels
    >>> [kernel] = kernels(["henyey_greenstein"])
    >>> [len(values) for values in sample(kernel, 10, "float32").inputs]
    [35, 35]
    """
    dtype = PRECISIONS[precision][0]
    rng = np.random.default_rng(seed(kernel))
    count = max(2, round(count * kernel.share))
    drawn = [rng.permuted(_drawn(p, count, dtype, rng)) for p in kernel.parameters]
    grid = np.array(list(itertools.product(*(p.extremes or (p.typical,) for p in kernel.parameters)))).T
    columns = [np.concatenate([random, extreme]) for random, extreme in zip(drawn, grid, strict=True)]
    return Cases(tuple(_fitted(values, parameter, dtype)
                       for values, parameter in zip(columns, kernel.parameters, strict=True)))


def _fitted(values: Doubles, parameter: Parameter, dtype: Any) -> Field:
    """Values in the type; a share stays inside its open range, and what is too large becomes the largest."""
    limits = np.finfo(dtype)
    with np.errstate(under="ignore"):
        fitted = np.clip(values, -float(limits.max), float(limits.max)).astype(dtype)
    if parameter.kind == "share":
        edge = dtype(1.0) - limits.epsneg
        fitted = np.clip(fitted, -edge if parameter.low < 0.0 else dtype(0.0), edge)
    # The least denormal is meant where a number below it was picked.
    return np.where((values > 0.0) & (fitted == 0.0), limits.smallest_subnormal, fitted)


# --- maps -------------------------------------------------------------------------------------------


def _spread(values: Doubles, kind: str) -> Doubles:
    """A scale on which neighbouring cells are about as far apart everywhere."""
    with np.errstate(divide="ignore"):
        if kind == "magnitude":
            return np.maximum(np.log10(np.maximum(values, 0.0)), -400.0)
        if kind in ("share", "cosine"):
            return np.copysign(np.minimum(-np.log10(1.0 - np.minimum(np.abs(values), 1.0)), 20.0), values)
    return values


def axis(parameter: Parameter, count: int, precision: str) -> Axis:
    """How a parameter is laid out along an edge.

    Parameters
    ----------
    parameter : Parameter
    count : int
        Cells, about; those outside the range come on top. A choice has one for each of its values.
    precision : str
        A key of `PRECISIONS`, for the range.

    Returns
    -------
    Axis
        Logarithmic for magnitudes; for what approaches 1 and −1, even up to 0.9, then the logarithm of the
        distance from there.

    Examples
    --------
    >>> axis(Parameter("length", "m", "magnitude", 1e-2, 1e2), 3, "float64").values.round(12).tolist()
    [0.01, 1.0, 100.0]
    """
    label = parameter.name if parameter.unit == "1" else f"{parameter.name} [{parameter.unit}]"
    if parameter.kind == "choice":
        known = np.array(sorted(parameter.extremes))
        ticks = tuple(((i + 0.5) / len(known), _brief(v)) for i, v in enumerate(known.tolist()))
        return Axis(known, parameter.kind, label, ticks)
    if parameter.kind == "linear":
        ends = parameter.low, parameter.high
        return Axis(np.linspace(*ends, count), parameter.kind, label,
                    ((0.0, f"{ends[0]:g}"), (1.0, f"{ends[1]:g}")))
    return (_magnitudes if parameter.kind == "magnitude" else _towards_one)(parameter, count, precision, label)


def _brief(value: float) -> str:
    """A number in few characters; what is next to 1 by its distance from there.

    >>> _brief(1e-09), _brief(1e22), _brief(1.0 - 2.0**-20), _brief(0.125)
    ('1e-9', '1e22', '1-9.5e-7', '0.125')
    """
    gap = 1.0 - abs(value)
    words = f"1-{gap:.2g}" if 0.0 < gap < 1e-4 and value > 0.0 else f"{value:.3g}"
    return re.sub(r"e([+-])0?", lambda sign: "e" + sign[1].strip("+"), words)


def _towards_one(parameter: Parameter, count: int, precision: str, label: str) -> Axis:
    digits = int(np.finfo(PRECISIONS[precision][0]).precision)
    both = parameter.low < 0.0
    cells = count // 2 if both else count
    near = np.concatenate([np.linspace(0.0, 0.9, cells // 2, endpoint=False),
                           1.0 - 10.0 ** -np.linspace(1.0, digits, cells - cells // 2)])
    ends = [NEXT, 1.0] if parameter.kind == "cosine" else [NEXT]
    values = np.concatenate([near, ends])
    values = np.concatenate([-values[:0:-1], values]) if both else values
    whole = Axis(values, parameter.kind, label, ())
    marks = [(10.0 ** -(digits // 2), f"{digits // 2}")]
    ticks = [(whole.share(0.0), "0")]
    for sign in (1.0, -1.0) if both else (1.0,):
        ticks.append((whole.share(sign * 0.9), f"{sign * 0.9:g}"))
        words = "1-1e-" if sign > 0.0 else "-1+1e-"
        ticks += [(whole.share(sign * (1.0 - gap)), words + k) for gap, k in marks]
        # At its end a cosine reaches 1, and a share the number next to it.
        ticks.append((0.5 + sign * (0.5 - 0.5 / len(values)), f"{sign:g}"))
    return whole._replace(ticks=tuple(ticks))


def _magnitudes(parameter: Parameter, count: int, precision: str, label: str) -> Axis:
    dtype = PRECISIONS[precision][0]
    limits = np.finfo(dtype)
    least, high = max(parameter.low, float(limits.tiny)), min(parameter.high, float(limits.max) / 4.0)
    low = LEAST if parameter.low < 1e-200 and least < LEAST else least
    picked = _fitted(np.array(parameter.extremes or (low,)), parameter, dtype).astype(np.float64)
    # Of an end of the range the type may hold a neighbour only: that is not outside.
    below = np.unique(np.concatenate([picked[picked < low * (1.0 - 1e-6)],
                                      np.geomspace(least, low, 5)[:-1] if least < low else []]))
    above = np.unique(picked[picked > high * (1.0 + 1e-6)])
    values = np.concatenate([below, np.geomspace(low, high, count), above])
    cells, first = len(values), len(below)
    start, end = math.log10(low), math.log10(high)
    step = max(1, math.ceil((end - start) / 5.0))

    def place(mark: float) -> float:
        return (first + 0.5 + (mark - start) / (end - start) * (count - 1)) / cells

    # Single cells are too narrow for all their numbers: the outermost ones say what kind they are.
    ticks = [(0.5 / cells, _brief(below[0]))] if first else []
    ticks += [(1.0 - 0.5 / cells, _brief(above[-1]))] if len(above) else []
    marks = range(math.ceil(start / step) * step, math.floor(end + 1e-9) + 1, step)
    ticks += [(place(m), f"1e{m}" if m else "1") for m in marks]
    lines = ((first / cells,) if first else ()) + ((1.0 - len(above) / cells,) if len(above) else ())
    return Axis(values, parameter.kind, label, tuple(ticks), lines)


def map_of(kernel: Kernel, precision: str, *, columns: int = COLUMNS, rows: int = ROWS) -> Map:
    """The map of a kernel's first two parameters, the others at their typical values.

    Parameters
    ----------
    kernel : Kernel
    precision : str
        A key of `PRECISIONS`.
    columns, rows : int
        Cells within the ranges; half as many each way for kernels whose exact value is costly.

    Returns
    -------
    Map

    Examples
    --------
    >>> from froxel_ref.kernel_registry import kernels
    >>> chart = map_of(kernels(["henyey_greenstein"])[0], "float32")
    >>> chart.shape, float(chart.inputs[0].min()), float(chart.inputs[0].max())
    ((27, 43), -1.0, 1.0)
    """
    if kernel.share < 1.0:
        columns, rows = columns // 2, rows // 2
    first, *others = kernel.parameters
    if not others:
        across = axis(first, POINTS, precision)
        return Map(across, None, _moved(kernel, [across.values], precision))
    across, up = axis(first, columns, precision), axis(others[0], rows, precision)
    x, y = np.broadcast_arrays(across.values[None, :], up.values[:, None])
    fields = [x.ravel(), y.ravel(), *(np.full(x.size, p.typical) for p in others[1:])]
    return Map(across, up, _moved(kernel, fields, precision))


def _moved(kernel: Kernel, fields: list[Doubles], precision: str) -> tuple[Field, ...]:
    """Inputs in the type; magnitudes within the range are moved a little, since a cell is not its nice number."""
    dtype = PRECISIONS[precision][0]
    inputs = []
    for number, (values, parameter) in enumerate(zip(fields, kernel.parameters, strict=True)):
        if parameter.kind == "magnitude" and number < 2:
            known, which = np.unique(values, return_inverse=True)
            shift = 1.0 + 1e-3 * np.random.default_rng(1 + number).random(len(known))
            inside = (known >= max(parameter.low, LEAST)) & (known <= parameter.high / 1.001)
            values = np.where(inside, known * shift, known)[which]
        inputs.append(_fitted(values, parameter, dtype))
    return tuple(inputs)
