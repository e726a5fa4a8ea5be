"""Fields of a grid gathered from its parts, as they come, without keeping both."""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from typing import Any, TypeAlias

import numpy as np

from froxel_ref.arrays import Field, Index
from froxel_ref.grid_parts import part_of

__all__ = ["Gathered", "Room"]

Room: TypeAlias = Callable[[tuple[int, ...], "np.dtype[np.floating[Any]]"], Field]
"""Makes room for an array of a shape and type, whatever it holds at first: ``numpy.empty``, or a place in a field."""


class Gathered:
    """What the parts of a grid have given so far, by name; several threads may add to it.

    Parameters
    ----------
    places : sequence of Index
        Where the parts stand in the fields.
    shape : (int, int, int)
        Of the fields, along z, y and x.

    Notes
    -----
    A field keeps at length 1 the axes along which no part varies. What parts have given waits until it is seen to
    vary along all axes: from then on it is laid out, and each part is copied to its place and forgotten.

    Examples
    --------
    >>> gathered = Gathered([(slice(k, k + 1), slice(0, 3), slice(0, 2)) for k in (0, 1)], (2, 3, 2))
    >>> for k in (0, 1):
    ...     gathered.add(k, "same", np.ones((1, 1, 1)))
    ...     gathered.add(k, "along z", np.full((1, 1, 1), float(k)))
    >>> [field.ravel().tolist() for field in gathered.fields().values()]
    [[1.0], [0.0, 1.0]]
    """

    def __init__(self, places: Sequence[Index], shape: tuple[int, int, int]) -> None:
        self._places, self._shape = places, shape
        # Of a checkerboard the slices are others in each column; slabs have every row and column.
        self._slabs = len({tuple((r.start, r.stop, r.step) for r in place[1:]) for place in places}) == 1
        self._made: dict[str, _Field] = {}
        self._lock = threading.Lock()

    def add(self, part: int, name: str, field: Field, *, spatial: bool = True) -> None:
        """Add what a part gives.

        Parameters
        ----------
        part : int
            Its number among the places.
        name : str
            Of the field.
        field : Field, shape (…, z, y, x)
            Of the part, with length 1 along axes on which it does not vary.
        spatial : bool
            Whether it has these axes; otherwise it is the same for all parts.
        """
        with self._lock:
            made = self._made.setdefault(name, _Field(field, spatial and field.size > 0))
            if made.spatial:
                self._put(made, part, field)

    def room(self, part: int, name: str) -> Room:
        """What makes room for a part of a field.

        Parameters
        ----------
        part : int
            Its number among the places.
        name : str
            Of the field.

        Returns
        -------
        callable
            Gives the part's place in the whole, if its shape says that the field varies along all axes; to be added
            nevertheless, when it is filled.
        """
        def make(shape: tuple[int, ...], dtype: np.dtype[np.floating[Any]]) -> Field:
            extent = tuple(len(range(n)[r]) for n, r in zip(self._shape, self._places[part], strict=True))
            if shape[-3:] != extent or 1 in extent:
                return np.empty(shape, dtype)
            with self._lock:
                made = self._made.setdefault(name, _Field(np.empty((*shape[:-3], 0, 0, 0), dtype), True))
                if made.whole is None:
                    made.lay_out(self._shape, self._places)
                assert made.whole is not None
                return part_of(made.whole, self._places[part])

        return make

    def fields(self) -> dict[str, Field]:
        """The fields of the grid.

        Returns
        -------
        dict of str to Field
            In the order in which the names came.
        """
        return {name: self._whole(made) for name, made in self._made.items()}

    def _put(self, made: _Field, part: int, field: Field) -> None:
        if made.whole is None:
            made.waiting[part] = field
            made.look_at(field, self._slabs)
            if all(varies or n == 1 for varies, n in zip(made.varies, self._shape, strict=True)) and any(made.varies):
                made.lay_out(self._shape, self._places)
        elif not np.may_share_memory(field, made.whole):  # else it was written to its place
            part_of(made.whole, self._places[part])[...] = field

    def _whole(self, made: _Field) -> Field:
        if made.whole is None and any(made.varies):
            extent = tuple(n if varies else 1 for n, varies in zip(self._shape, made.varies, strict=True))
            made.lay_out(extent, self._places)
        return made.first


class _Field:
    """One field: what came first, what waits, along which axes it varies, and the whole once it is laid out."""

    def __init__(self, first: Field, spatial: bool) -> None:
        self.first, self.spatial = first, spatial
        self.waiting: dict[int, Field] = {}
        self.varies = [False] * 3
        self.whole: Field | None = None

    def look_at(self, field: Field, slabs: bool) -> None:
        """Note along which axes a part varies, or differs from the first."""
        self.varies = [old or n > 1 for old, n in zip(self.varies, field.shape[-3:], strict=True)]
        if not self.varies[0] and field is not self.first and not np.array_equal(field, self.first):
            self.varies[0] = True
        if not slabs:
            self.varies = [any(self.varies)] * 3

    def lay_out(self, extent: tuple[int, ...], places: Sequence[Index]) -> None:
        """Copy what waits to its place."""
        whole = np.zeros((*self.first.shape[:-3], *extent), self.first.dtype)
        for part, field in self.waiting.items():
            part_of(whole, places[part])[...] = field
        self.waiting.clear()
        self.first = self.whole = whole
