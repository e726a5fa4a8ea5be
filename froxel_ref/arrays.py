"""Names for the arrays that every module speaks of."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

__all__ = ["Field", "Index", "Points", "Visibility"]

Field: TypeAlias = NDArray[np.floating[Any]]
"""An array broadcastable to (D, H, W), or channel-first to (3, D, H, W); length 1 where nothing varies."""

Points: TypeAlias = tuple[Field, Field, Field]
"""World x, y and z [m] of points, three arrays that broadcast to the points' common shape."""

Index: TypeAlias = tuple[slice, slice, slice]
"""A box of froxels: ranges along z, y and x."""

Visibility: TypeAlias = Callable[[int, Points], Field]
"""What share of a light (its index in the scene) arrives at points: broadcastable to them, in [0, 1]."""
