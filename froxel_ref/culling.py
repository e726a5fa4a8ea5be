"""Culling: which lights and local media each froxel has to visit, by tiles of the screen and bins of view depth.

Lights are sorted by depth. A tile holds a bit for each place in that order, a bin the first and the last place
that it overlaps. A froxel's lights are the bits of its tile between the two places of its bin. Local media have
lists of their own. Both are conservative: what is not in a list adds exactly nothing.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from froxel_ref.arrays import Candidates
from froxel_ref.geometry import clip_from_view, view_from_world
from froxel_ref.grid import Froxels
from froxel_ref.scene import Camera, LocalMedium, PointLight
from froxel_ref.tile_bounds import Proxies, depth_ranges, light_proxies, medium_proxies, row_ranges

__all__ = [
    "BINS", "TILE", "Culled", "Tiling", "candidates", "cull_lights", "cull_media", "lights_per_tile",
    "list_lengths", "list_shapes", "listed", "make_tiling",
]

Doubles = NDArray[np.float64]
Integers = NDArray[Any]

TILE, BINS = 8, 256
WORD = 32
# Comparisons of places with bins that are held at a time.
PAIRS = 1 << 22


class Tiling(NamedTuple):
    """Tiles of the screen and bins of view depth.

    Attributes
    ----------
    tile_from_world : ndarray, shape (3, 4), float64
        Takes (x, y, z, 1) to (column·depth, row·depth, depth), in tiles; row 0 is at the top.
    rows, columns : int
        Of tiles; the last ones may reach beyond the image.
    bins : int
        Of view depth, all of the same size.
    near, far : float [m]
        Where the first bin begins and the last one ends; what lies before or beyond counts as in these two.
    """

    tile_from_world: Doubles
    rows: int
    columns: int
    bins: int
    near: float
    far: float

    def bin_of(self, depth: Doubles) -> Integers:
        """The bins of view depths [m]; growing with depth, whatever rounds."""
        place = (depth - self.near) * (self.bins / (self.far - self.near))
        return np.asarray(np.clip(np.floor(place), 0, self.bins - 1), np.intp)


class Culled(NamedTuple):
    """The lists of lights, or of local media.

    Attributes
    ----------
    order : ndarray of int32, shape (n,)
        Indices in the scene, sorted by the view depth of the nearest point of their proxies; ties by index.
    bins : ndarray of int32, shape (2, bins)
        First and last place in that order whose depths overlap the bin; 1 and 0 where none does.
    tiles : ndarray of uint32, shape (words, rows, columns)
        Bit i mod 32 of word i // 32 is the i-th in that order; bits beyond the last are 0.

    Where n is 0 all have an axis of length 0: shapes (0,), (2, 0) and (0, 1, 1).
    """

    order: Integers
    bins: Integers
    tiles: Integers


def make_tiling(camera: Camera, *, depth_range: tuple[float, float], tile: int = TILE, bins: int = BINS) -> Tiling:
    """Cut a camera's image into tiles, and its view depth into bins.

    Parameters
    ----------
    camera : Camera
        Its image is cut from the top left corner on.
    depth_range : (float, float) [m]
        View depths between which the bins lie: those of the froxel grid.
    tile : int
        Edge of a tile in pixels of the image, 8 in the thesis's program.
    bins : int
        How many. The thesis names no number; 256 are ¼ m each for a grid of 64 m.

    Returns
    -------
    Tiling

    Notes
    -----
    Tiles by bins instead of a list for each cluster [Drobot 2017; Dörries 2020, §3.2.4].

    Examples
    --------
    >>> tiling = make_tiling(Camera(width=20, height=12), depth_range=(0.5, 64.5), bins=64)
    >>> tiling.rows, tiling.columns, tiling.bin_of(np.array([0.0, 1.4, 1.6, 99.0])).tolist()
    (2, 3, [0, 0, 1, 63])
    """
    clip_from_world = clip_from_view(camera, 1.0) @ view_from_world(camera)
    right, up, depth = clip_from_world[0], clip_from_world[1], clip_from_world[3]
    matrix = np.stack([0.5 * camera.width / tile * (right + depth), 0.5 * camera.height / tile * (depth - up), depth])
    return Tiling(matrix, -(-camera.height // tile), -(-camera.width // tile), bins, *depth_range)


def list_shapes(count: int, camera: Camera, *, tile: int = TILE, bins: int = BINS) -> tuple[tuple[int, ...], ...]:
    """Tell the shapes of the lists of some lights or media, without making them.

    Parameters
    ----------
    count : int
        How many lights or media.
    camera, tile, bins
        As for `make_tiling`.

    Returns
    -------
    tuple of 3 tuples of int
        Of ``order``, ``bins`` and ``tiles``; all have entries of 4 bytes.

    Examples
    --------
    >>> list_shapes(521, Camera())
    ((521,), (2, 256), (17, 68, 120))
    """
    if not count:
        return (0,), (2, 0), (0, 1, 1)
    return (count,), (2, bins), (-(-count // WORD), -(-camera.height // tile), -(-camera.width // tile))


def cull_lights(lights: Mapping[int, PointLight], tiling: Tiling, *, origin: Sequence[float] = (0.0, 0.0, 0.0),
                dtype: np.dtype[Any] | type[Any] = np.float64) -> Culled:
    """Make the lists of point and spot lights.

    Parameters
    ----------
    lights : mapping of int to PointLight or SpotLight
        Those with a window, by their indices in the scene. Lights without one reach everything and, like
        directional ones, are in no list.
    tiling : Tiling
        From `make_tiling`.
    origin : sequence of 3 floats [m]
        The camera's position: how far away a light lies tells how its distances round.
    dtype : dtype
        Of the arithmetic whose results must not miss a light.

    Returns
    -------
    Culled

    Notes
    -----
    [Drobot 2017; Dörries 2020, §3.2.4]. See `froxel_ref.tile_bounds` for the proxies and their margins.

    Examples
    --------
    >>> camera = Camera(position=(0, 0, 0), target=(0, 0, -1), width=32, height=16)
    >>> far, near = (PointLight(position=(0, 0, z), intensity=(1, 1, 1), radius=1) for z in (-20, -10))
    >>> culled = cull_lights({3: far, 7: near}, make_tiling(camera, depth_range=(0, 32), bins=4))
    >>> culled.order.tolist(), culled.bins.tolist(), culled.tiles.tolist()
    ([7, 3], [[1, 0, 1, 1], [0, 0, 1, 0]], [[[0, 3, 3, 0], [0, 3, 3, 0]]])
    """
    proxies = light_proxies(list(lights.values()), origin, np.dtype(dtype))
    return _lists(np.array(list(lights), np.int32), proxies, tiling)


def cull_media(media: Mapping[int, LocalMedium], tiling: Tiling, *, origin: Sequence[float] = (0.0, 0.0, 0.0),
               dtype: np.dtype[Any] | type[Any] = np.float64) -> Culled:
    """Make the lists of local media.

    Parameters
    ----------
    media : mapping of int to LocalMedium
        By their indices in the scene.
    tiling, origin, dtype
        As for `cull_lights`.

    Returns
    -------
    Culled

    Notes
    -----
    [Dörries 2020, §3.2.5: the same lists as for lights].

    Examples
    --------
    >>> from froxel_ref.scene import Transform
    >>> camera = Camera(position=(0, 0, 0), target=(0, 0, -1), width=32, height=16)
    >>> mist = LocalMedium(transform=Transform(translate=(0, 0, -10)))
    >>> cull_media({0: mist}, make_tiling(camera, depth_range=(0, 32), bins=4)).bins.tolist()
    [[1, 0, 1, 1], [0, 0, 0, 0]]
    """
    proxies = medium_proxies(list(media.values()), origin, np.dtype(dtype))
    return _lists(np.array(list(media), np.int32), proxies, tiling)


def _lists(indices: Integers, proxies: Proxies, tiling: Tiling) -> Culled:
    """Sort, and enter into bins and tiles."""
    if not len(indices):
        return Culled(indices, np.zeros((2, 0), np.int32), np.zeros((0, 1, 1), np.uint32))
    depths = depth_ranges(proxies, tiling.tile_from_world)
    order = np.lexsort((indices, depths[0]))
    ranges = row_ranges(proxies, tiling.tile_from_world, tiling.rows)[:, order]
    return Culled(indices[order], _bins(depths[:, order], tiling), _tiles(ranges, tiling))


def _bins(depths: Doubles, tiling: Tiling) -> Integers:
    """First and last place of each bin."""
    first, last = (tiling.bin_of(depth) for depth in depths)
    last = np.where((depths[1] > 0.0) & (depths[0] <= depths[1]), last, -1)  # behind the camera: in none
    result = np.empty((2, tiling.bins), np.int32)
    result[:] = [[1], [0]]
    step = max(1, PAIRS // len(first))
    for begin in range(0, tiling.bins, step):
        bins = np.arange(begin, min(begin + step, tiling.bins))[:, np.newaxis]
        overlap = (first <= bins) & (bins <= last)
        some = overlap.any(axis=1)
        ends = np.stack([overlap.argmax(axis=1), overlap.shape[1] - 1 - overlap[:, ::-1].argmax(axis=1)])
        result[:, begin:begin + step][:, some] = ends[:, some]
    return result


def _tiles(ranges: Doubles, tiling: Tiling) -> Integers:
    """The words of all tiles, from the columns that each light spans in each row."""
    first = np.clip(np.floor(ranges[0]), 0, tiling.columns).astype(np.intp)
    last = np.clip(np.floor(ranges[1]) + 1.0, 0, tiling.columns).astype(np.intp)
    place, row = np.nonzero(first < last)
    words = -(-len(first) // WORD)
    # A bit is added where its light begins and taken away where it ends: the running sum is the mask. Other
    # bits of the word do not notice, for the sum of distinct bits is exact, whatever wraps around on the way.
    change = np.zeros((words, tiling.rows, tiling.columns + 1), np.uint32)
    bit = np.left_shift(np.uint32(1), (place % WORD).astype(np.uint32))
    np.add.at(change, (place // WORD, row, first[place, row]), bit)
    np.subtract.at(change, (place // WORD, row, last[place, row]), bit)
    return np.cumsum(change, axis=2, dtype=np.uint32)[..., :-1]


# --- looking up -------------------------------------------------------------------------------------


class _Places(NamedTuple):
    """The bin of each slice, and the row and column of tiles of each row and column of froxels."""

    bins: Integers
    rows: Integers
    columns: Integers


def _places(froxels: Froxels, tiling: Tiling) -> _Places:
    # Both matrices are linear in (column·depth, row·depth, depth) of one and the same image.
    matrix = tiling.tile_from_world[:, :3] @ np.linalg.inv(froxels.sample_from_world[:, :3])
    rows, columns = (np.arange(count) for count in froxels.rays.length.shape)
    row, column = matrix[1, 1] * rows + matrix[1, 2], matrix[0, 0] * columns + matrix[0, 2]
    return _Places(tiling.bin_of(froxels.depths[:, 0, 0].astype(np.float64)),
                   np.clip(np.floor(row), 0, tiling.rows - 1).astype(np.intp),
                   np.clip(np.floor(column), 0, tiling.columns - 1).astype(np.intp))


def _between(culled: Culled, bins: Integers) -> Integers:
    """Words whose bits lie between the first and the last place of bins, shape (len(bins), words)."""
    place = np.arange(WORD * len(culled.tiles))
    first, last = culled.bins[:, bins][..., np.newaxis]
    return _words((first <= place) & (place <= last))


def _words(bits: NDArray[np.bool_]) -> Integers:
    """Bits along the last axis as words."""
    return np.packbits(bits, axis=-1, bitorder="little").view("<u4").astype(np.uint32)


def _bits(words: Integers) -> NDArray[np.bool_]:
    """Words along the last axis as bits."""
    plain = np.ascontiguousarray(words, "<u4")
    return np.unpackbits(plain.view(np.uint8), axis=-1, bitorder="little").astype(bool)


def candidates(culled: Culled, froxels: Froxels, tiling: Tiling, *, everywhere: Sequence[int] = ()) -> Candidates:
    """Make what tells a block of froxels which lights, or media, it has to visit.

    Parameters
    ----------
    culled : Culled
        From `cull_lights` or `cull_media`, with the same tiling.
    froxels : Froxels
        The grid that blocks are cut from.
    tiling : Tiling
        From `make_tiling`, of the same camera.
    everywhere : sequence of int
        Indices of those that reach everything and are in no list.

    Returns
    -------
    callable
        Given ranges of slices and rows, indices in the scene, growing: sums must run in the scene's order. They
        are those in some list of the block's tiles and of its bins, and ``everywhere``.

    Examples
    --------
    >>> from froxel_ref.grid import make_froxels
    >>> from froxel_ref.settings import Grid
    >>> camera = Camera(position=(0, 0, 0), target=(0, 0, -1), width=32, height=16)
    >>> lights = {k: PointLight(position=(0, 0, -10.0 * k), intensity=(1, 1, 1), radius=3) for k in (2, 1)}
    >>> tiling = make_tiling(camera, depth_range=(0, 32))
    >>> froxels = make_froxels(camera, Grid(width=4, height=2, depth=8, near=1, far=32, distribution="linear"))
    >>> visit = candidates(cull_lights(lights, tiling), froxels, tiling, everywhere=[0])
    >>> visit(slice(0, 8), slice(0, 2)).tolist(), visit(slice(0, 4), slice(0, 2)).tolist()
    ([0, 1, 2], [0, 1])
    """
    places = _places(froxels, tiling)
    always = np.array(everywhere, np.intp)
    count = len(culled.order)
    # Whichever column: blocks are cut along slices and rows only.
    across = np.bitwise_or.reduce(culled.tiles, axis=2).T if count else np.zeros((1, 0), np.uint32)
    within = _between(culled, places.bins) if count else np.zeros((len(places.bins), 0), np.uint32)

    def visit(z: slice, y: slice) -> NDArray[np.intp]:
        rows = np.bitwise_or.reduce(across[np.unique(places.rows[y])], axis=0) if count else across[0]
        words = rows & np.bitwise_or.reduce(within[z], axis=0)
        found = culled.order[_bits(words)[:count]]
        return np.sort(np.concatenate([found, always]).astype(np.intp))

    return visit


def listed(culled: Culled, froxels: Froxels, tiling: Tiling) -> NDArray[np.bool_]:
    """Tell for every froxel and place in the order whether the froxel's list has it.

    Parameters
    ----------
    culled, froxels, tiling
        As for `candidates`.

    Returns
    -------
    ndarray of bool, shape (n, D, H, W)
        By place in ``culled.order``; for tests and pictures, since it is large.

    Examples
    --------
    >>> from froxel_ref.grid import make_froxels
    >>> from froxel_ref.settings import Grid
    >>> camera = Camera(position=(0, 0, 0), target=(0, 0, -1), width=32, height=16)
    >>> lamp = PointLight(position=(0, 0, -10), intensity=(1, 1, 1), radius=1)
    >>> tiling = make_tiling(camera, depth_range=(0, 32), bins=32)
    >>> froxels = make_froxels(camera, Grid(width=4, height=1, depth=4, near=1, far=32))
    >>> listed(cull_lights({5: lamp}, tiling), froxels, tiling)[0, :, 0].astype(int).tolist()
    [[0, 0, 0, 0], [0, 0, 0, 0], [0, 1, 1, 0], [0, 0, 0, 0]]
    """
    bins, rows, columns = _places(froxels, tiling)
    count = len(culled.order)
    shape = len(bins), len(rows), len(columns)
    if not count:
        return np.zeros((0, *shape), bool)
    tiles = culled.tiles[:, rows][:, :, columns]
    words = np.moveaxis(tiles, 0, -1) & _between(culled, bins)[:, np.newaxis, np.newaxis]
    return np.moveaxis(_bits(words)[..., :count], -1, 0)


def list_lengths(culled: Culled, froxels: Froxels, tiling: Tiling) -> Integers:
    """Count the lights, or media, in every froxel's list.

    Parameters
    ----------
    culled, froxels, tiling
        As for `candidates`.

    Returns
    -------
    ndarray of int64, shape (D, H, W)
        Without those that reach everything.

    Examples
    --------
    >>> from froxel_ref.grid import make_froxels
    >>> from froxel_ref.settings import Grid
    >>> camera = Camera(position=(0, 0, 0), target=(0, 0, -1), width=32, height=16)
    >>> lamp = PointLight(position=(0, 0, -10), intensity=(1, 1, 1), radius=4)
    >>> tiling = make_tiling(camera, depth_range=(0, 32), bins=32)
    >>> froxels = make_froxels(camera, Grid(width=4, height=2, depth=4, near=1, far=32))
    >>> list_lengths(cull_lights({5: lamp}, tiling), froxels, tiling)[2].tolist()
    [[0, 1, 1, 0], [0, 1, 1, 0]]
    """
    bins, rows, columns = _places(froxels, tiling)
    result = np.zeros((len(bins), len(rows), len(columns)), np.int64)
    if len(culled.order):
        for slice_, between in zip(result, _between(culled, bins), strict=True):
            tiles = np.bitwise_count(culled.tiles & between[:, np.newaxis, np.newaxis]).sum(axis=0, dtype=np.int64)
            slice_[...] = tiles[rows][:, columns]
    return result


def lights_per_tile(tiles: Integers) -> Doubles:
    """Count the bits of each tile, for pictures.

    Parameters
    ----------
    tiles : ndarray of uint32, shape (words, rows, columns)
        As in `Culled`.

    Returns
    -------
    ndarray of float64, shape (rows, columns)

    Examples
    --------
    >>> lights_per_tile(np.array([[[7, 0]], [[1, 0]]], np.uint32)).tolist()
    [[4.0, 0.0]]
    """
    return np.asarray(np.bitwise_count(tiles).sum(axis=0), np.float64)
