"""Names for the arrays that every module speaks of."""

from __future__ import annotations

from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

__all__ = ["Field", "Index", "Points"]

Field: TypeAlias = NDArray[np.floating[Any]]
"""An array broadcastable to (D, H, W), or channel-first to (3, D, H, W); length 1 where nothing varies."""

Points: TypeAlias = tuple[Field, Field, Field]
"""World x, y and z [m] of points, three arrays that broadcast to the points' common shape."""

Index: TypeAlias = tuple[slice, slice, slice]
"""A box of froxels: ranges along z, y and x."""
