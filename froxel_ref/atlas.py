"""A square texture shared out in tiles by a quadtree [Dörries 2020, §3.3.3].

Requests are rounded up to powers of two between the smallest tile and the whole square. A node of the tree
stores the size of the largest free square below it, so that a request finds its way down without search, and
one that cannot be met is refused at the root. An atlas is a value: what changes it gives another one.
"""

from __future__ import annotations

from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from froxel_ref.records import InputError

__all__ = ["Atlas", "Tile", "allocate", "free", "largest_free", "new_atlas", "reset", "tile_size_for"]

Sizes: TypeAlias = NDArray[np.int64]


class Tile(NamedTuple):
    """A square of an atlas.

    Attributes
    ----------
    row, column : int [texels]
        Of its upper left corner.
    size : int [texels]
        Along each side, a power of two.
    """

    row: int
    column: int
    size: int


class Atlas(NamedTuple):
    """What is free in a square texture, and what is taken.

    Attributes
    ----------
    size, smallest : int [texels]
        Of the whole and of the smallest tile, along each side; powers of two.
    room : tuple of ndarray, shape (2ˡ, 2ˡ) for level l, int64 [texels]
        Size of the largest free square below each node, 0 if there is none; level 0 is the whole. Below a node
        that is taken as a whole the values are those of an empty atlas, and are not looked at.
    tiles : frozenset of Tile
        What is taken.
    """

    size: int
    smallest: int
    room: tuple[Sizes, ...]
    tiles: frozenset[Tile] = frozenset()


def new_atlas(size: int = 2048, smallest: int = 64) -> Atlas:
    """An atlas with nothing in it; also what `allocate` and `free` of everything come back to.

    Parameters
    ----------
    size : int [texels]
        Along each side, a power of two; 2048 in the thesis's program.
    smallest : int [texels]
        The smallest tile, a power of two of at most ``size``; below 64 they are of little use.

    Returns
    -------
    Atlas

    Raises
    ------
    InputError
        Not powers of two, or a smallest tile larger than the whole.

    Examples
    --------
    >>> atlas = new_atlas(256, 64)
    >>> len(atlas.room), largest_free(atlas)
    (3, 256)
    """
    for name, value in (("size", size), ("smallest", smallest)):
        if value < 1 or value & (value - 1):
            raise InputError(name, f"is {value}, must be a power of two")
    if smallest > size:
        raise InputError("smallest", f"is {smallest}, must be at most the atlas's size ({size})")
    levels = (size // smallest).bit_length()
    return Atlas(size, smallest, tuple(np.full((2**level,) * 2, size >> level, np.int64) for level in range(levels)))


def tile_size_for(atlas: Atlas, wanted: int) -> int:
    """The size of the tile that a request gets.

    Parameters
    ----------
    atlas : Atlas
    wanted : int [texels]
        At least 1, along each side.

    Returns
    -------
    int [texels]
        The next power of two, at least the smallest tile; may exceed the atlas.

    Raises
    ------
    InputError
        Less than 1 texel.

    Examples
    --------
    >>> [tile_size_for(new_atlas(256, 64), wanted) for wanted in (1, 65, 128, 500)]
    [64, 128, 128, 512]
    """
    if wanted < 1:
        raise InputError("wanted", f"is {wanted}, must be at least 1 texel")
    return max(atlas.smallest, 1 << (wanted - 1).bit_length())


def largest_free(atlas: Atlas) -> int:
    """The largest tile that could still be had.

    Parameters
    ----------
    atlas : Atlas

    Returns
    -------
    int [texels]
        Along each side; 0 if the atlas is full.

    Examples
    --------
    >>> atlas, _ = allocate(new_atlas(256, 64), 64)
    >>> largest_free(atlas)
    128
    """
    return int(atlas.room[0][0, 0])


def allocate(atlas: Atlas, wanted: int) -> tuple[Atlas, Tile | None]:
    """Take a tile.

    Parameters
    ----------
    atlas : Atlas
    wanted : int [texels]
        How large the tile has to be, along each side.

    Returns
    -------
    atlas : Atlas
        With the tile taken; the same one if there is no room.
    tile : Tile or None
        None if there is no free square of that size.

    Raises
    ------
    InputError
        Less than 1 texel.

    Notes
    -----
    From the root down to the level of the tile's size, each time into the first of the four quarters (upper left,
    upper right, lower left, lower right) whose largest free square is large enough. O(levels) looks, O(levels)
    changes, and a copy of the levels that change.

    Examples
    --------
    >>> atlas = new_atlas(256, 64)
    >>> for wanted in (100, 64, 200, 30):
    ...     atlas, tile = allocate(atlas, wanted)
    ...     print(wanted, tile)
    100 Tile(row=0, column=0, size=128)
    64 Tile(row=0, column=128, size=64)
    200 None
    30 Tile(row=0, column=192, size=64)
    """
    size = tile_size_for(atlas, wanted)
    if size > largest_free(atlas):
        return atlas, None
    row = column = level = 0
    while atlas.size >> level > size:
        level += 1
        quarters = ((2 * row + i, 2 * column + j) for i in (0, 1) for j in (0, 1))
        row, column = next(place for place in quarters if atlas.room[level][place] >= size)
    tile = Tile(row * size, column * size, size)
    return Atlas(atlas.size, atlas.smallest, _changed(atlas, level, row, column, 0), atlas.tiles | {tile}), tile


def free(atlas: Atlas, tile: Tile) -> Atlas:
    """Give a tile back.

    Parameters
    ----------
    atlas : Atlas
    tile : Tile
        One that `allocate` gave, and that is still taken.

    Returns
    -------
    Atlas
        Four free quarters are one free square again, on every level: an atlas whose tiles have all been given
        back, in any order, equals a new one.

    Raises
    ------
    InputError
        The tile is not taken.

    Examples
    --------
    >>> atlas, tile = allocate(new_atlas(256, 64), 64)
    >>> largest_free(free(atlas, tile))
    256
    """
    if tile not in atlas.tiles:
        raise InputError("tile", f"is {tuple(tile)}, must be one that is taken")
    level = (atlas.size // tile.size).bit_length() - 1
    room = _changed(atlas, level, tile.row // tile.size, tile.column // tile.size, tile.size)
    return Atlas(atlas.size, atlas.smallest, room, atlas.tiles - {tile})


def reset(atlas: Atlas) -> Atlas:
    """Give all tiles back.

    Parameters
    ----------
    atlas : Atlas

    Returns
    -------
    Atlas
        A new one of the same sizes.

    Examples
    --------
    >>> atlas, _ = allocate(new_atlas(256, 64), 64)
    >>> largest_free(reset(atlas)), len(reset(atlas).tiles)
    (256, 0)
    """
    return new_atlas(atlas.size, atlas.smallest)


def _changed(atlas: Atlas, level: int, row: int, column: int, value: int) -> tuple[Sizes, ...]:
    """The largest free squares with another value at a node, and what follows from it above."""
    room = list(atlas.room)
    room[level] = room[level].copy()
    room[level][row, column] = value
    for above in range(level - 1, -1, -1):
        row, column = row // 2, column // 2
        quarters = room[above + 1][2 * row:2 * row + 2, 2 * column:2 * column + 2]
        whole = bool((quarters == atlas.size >> (above + 1)).all())
        room[above] = room[above].copy()
        room[above][row, column] = atlas.size >> above if whole else quarters.max()
    return tuple(room)
