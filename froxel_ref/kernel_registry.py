"""The list of kernels whose rounding `froxel_ref.stability` measures, and what a kernel is."""

from __future__ import annotations

import importlib
import math
from collections.abc import Callable, Iterable, Mapping
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from froxel_ref.arrays import Field
from froxel_ref.records import InputError, shown, suggest

__all__ = ["PRECISIONS", "Kernel", "Parameter", "for_each", "kernels", "register"]

Doubles: TypeAlias = NDArray[np.float64]
Run: TypeAlias = Callable[..., Field]

# Computed in, stored as; float16 is a storage format: computed in float32 and rounded once.
PRECISIONS: Mapping[str, tuple[Any, Any]] = {
    "float64": (np.float64, np.float64), "float32": (np.float32, np.float32),
    "float16": (np.float32, np.float16)}


class Parameter(NamedTuple):
    """One input of a kernel: where it is sampled.

    Attributes
    ----------
    name, unit : str
        In words, and its unit.
    kind : {"magnitude", "share", "cosine", "linear", "choice"}
        magnitude: half near 1, half over all magnitudes from low to high; share: half even between low and
        high, half so near to 1 (or −1) that the distance has any magnitude, never ±1 itself; cosine: the same
        with ±1; linear: half even, half near the low end; choice: one of the extremes.
    low, high : float
        The range; a magnitude is kept within the normal numbers of the type.
    extremes : tuple of float
        Hand-picked values, taken in every combination with those of the other parameters.
    typical : float
        Its value where other parameters are varied.
    whole : bool
        A count, on which nothing depends smoothly: left out of the condition number.
    """

    name: str
    unit: str
    kind: str
    low: float
    high: float
    extremes: tuple[float, ...] = ()
    typical: float = 1.0
    whole: bool = False


class Kernel(NamedTuple):
    """A line of mathematics, as it is computed and as it is.

    Attributes
    ----------
    name, group, about : str
        ``word_word``; what it is listed under; one line.
    parameters : tuple of Parameter
        The inputs. The first two span the map of errors; an only one is its axis.
    forms : mapping of str to callable
        By name, functions of one array per parameter, of the type to compute in, to an array. The first is
        the one that must hold.
    exact : callable
        ``exact(mp, *values)`` with an mpmath context and mpf values, straight from the definition.
    departure : str
        Which departures the other forms are, if any.
    at_most : float or callable
        Upper bound on the output, or a function of the exact inputs (float64 arrays) to it.
    falling : int or None
        The parameter in which the output never grows.
    precisions : tuple of str
        Keys of `PRECISIONS`.
    share : float
        Of the samples, for kernels whose exact value is costly.
    smooth : bool
        False for rounding, which has no condition number.
    stores_between : bool
        The forms take a keyword ``store``, to be called on what stands in a texture in between.
    condition : callable, optional
        Function of the inputs (float64 arrays), where rounding in between makes it another one than that of
        the exact function.
    """

    name: str
    group: str
    about: str
    parameters: tuple[Parameter, ...]
    forms: Mapping[str, Run]
    exact: Callable[..., Any]
    departure: str = ""
    at_most: float | Callable[..., Doubles] = math.inf
    falling: int | None = None
    precisions: tuple[str, ...] = tuple(PRECISIONS)
    share: float = 1.0
    smooth: bool = True
    stores_between: bool = False
    condition: Callable[..., Doubles] | None = None


# --- the registry -----------------------------------------------------------------------------------

_KERNELS: dict[str, Kernel] = {}


def register(kernel: Kernel) -> Kernel:
    """Add a kernel to the table.

    Parameters
    ----------
    kernel : Kernel

    Returns
    -------
    Kernel
        The same.

    Raises
    ------
    InputError
        Its name is taken, or it has no form or parameter.
    """
    if kernel.name in _KERNELS:
        raise InputError("kernel", f"{kernel.name!r} is registered already")
    if not kernel.forms or not kernel.parameters:
        raise InputError("kernel", f"{kernel.name!r} must have a form and a parameter")
    _KERNELS[kernel.name] = kernel
    return kernel


def kernels(names: Iterable[str] | None = None) -> list[Kernel]:
    """Registered kernels.

    Parameters
    ----------
    names : iterable of str, optional
        Default: all.

    Returns
    -------
    list of Kernel
        In the order of registration, each once.

    Raises
    ------
    InputError
        An unknown name, or an empty list of names.

    Examples
    --------
    >>> [kernel.group for kernel in kernels(["henyey_greenstein"])]
    ['phase functions']
    """
    # Registering all that the package has is what importing these does.
    for module in ("stability_kernels", "stability_slices", "stability_shadows", "stability_fom"):
        importlib.import_module(f"froxel_ref.{module}")

    wanted = list(_KERNELS) if names is None else list(names)
    for name in wanted:
        if name not in _KERNELS:
            raise InputError("kernel", f"is {shown(name)}; {suggest(name, _KERNELS)}")
    if not wanted:
        raise InputError("kernel", "names no kernel")
    return [kernel for name, kernel in _KERNELS.items() if name in wanted]


def for_each(values: Field, one: Callable[..., Field], *others: Field) -> Field:
    """``one(value, *others)`` for each different value of a parameter that is not an array to the package."""
    result = np.empty(np.shape(values), np.result_type(*others))
    for value in np.unique(values):
        here = values == value
        result[here] = one(float(value), *(other[here] for other in others))
    return result
