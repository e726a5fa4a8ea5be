"""Names for the arrays that every module speaks of."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, Protocol, TypeAlias

import numpy as np
from numpy.typing import NDArray

__all__ = ["Candidates", "Field", "FogAt", "Index", "Points", "Sight", "Visibility"]

Field: TypeAlias = NDArray[np.floating[Any]]
"""An array broadcastable to (D, H, W), or channel-first to (3, D, H, W); length 1 where nothing varies."""

Points: TypeAlias = tuple[Field, Field, Field]
"""World x, y and z [m] of points, three arrays that broadcast to the points' common shape."""

Index: TypeAlias = tuple[slice, slice, slice]
"""A box of froxels: ranges along z, y and x."""


class Sight(Protocol):
    """What share of a light arrives at points: broadcastable to them, in [0, 1].

    On a surface the unit normal is given as well, towards the side that is lit; in a medium it is not.
    """

    def __call__(self, points: Points, normal: Points | None = None, /) -> Field: ...


Visibility: TypeAlias = Mapping[int, Sight]
"""By the light's index in the scene. A light that is not in it is hidden by nothing."""

Candidates: TypeAlias = Callable[[slice, slice], NDArray[np.intp]]
"""Given a block's slices and rows, the indices, growing, of the lights or media that it has to visit."""

FogAt: TypeAlias = Callable[[NDArray[np.integer[Any]], NDArray[np.integer[Any]], Field], tuple[Field, Field]]
"""Given rows and columns of pixels and view depths there, (…), the fog's radiance (3, …) and transmittance, (…) or
(3, …), from the camera up to them; length 1 where nothing varies."""
