"""The checkerboard in three dimensions: each frame computes every other froxel, and the holes are filled.

Texel (x, y, z) is computed in frame f iff x + y + z + f is even. Along the x axis the computed texels of a row are
every second one, and where they begin depends on whether z + y is even: so all of them lie on four lattices with
steps of two, each of which is a froxel grid of its own, of an eighth of the froxels. Nothing is padded, nothing is
gathered by index, and every axis keeps what it varies by: a lattice of a field is a view of it.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from froxel_ref.arrays import Field, Index
from froxel_ref.geometry import crop_rays
from froxel_ref.grid import Froxels
from froxel_ref.records import InputError, shown, suggest
from froxel_ref.temporal import usable

__all__ = ["PARITIES", "computed", "fill", "gather", "lattice_froxels", "lattices", "pack", "scatter", "unpack"]

Flags = NDArray[np.bool_]
Shape = tuple[int, int, int]
T = TypeVar("T", bound=np.generic)

PARITIES = ("even", "odd")
"""What x + y + z + frame is where a texel is computed: as published, and as the author's program has it (A1)."""

OUTSIDE = ("absent", "zero")
WITHOUT_HISTORY = ("neighbours", "empty")


def _offset(frame: int, parity: str) -> int:
    """0 or 1: what x + y + z must be, modulo 2."""
    if parity not in PARITIES:
        raise InputError("parity", f"is {shown(parity)}; {suggest(str(parity), PARITIES)}")
    if not isinstance(frame, (int, np.integer)):
        raise InputError("frame", f"is {shown(frame)}, must be a whole number")
    return (int(frame) + PARITIES.index(parity)) % 2


def computed(shape: Shape, frame: int, *, parity: str = "even") -> Flags:
    """Tell which texels a frame computes.

    Parameters
    ----------
    shape : tuple of 3 ints
        Slices, rows and columns.
    frame : int
        The frame's number.
    parity : {"even", "odd"}
        A1: what x + y + z + frame is where a texel is computed.

    Returns
    -------
    ndarray of bool, shape ``shape``

    Raises
    ------
    InputError
        An unknown word; a frame that is no whole number.

    Notes
    -----
    [Dörries 2020, §3.2.9, listing 3.11]. A volume with an odd number of texels has one more of one colour than of
    the other; the next frame computes exactly the rest.

    Examples
    --------
    >>> computed((1, 2, 4), 0).astype(int).tolist()
    [[[1, 0, 1, 0], [0, 1, 0, 1]]]
    """
    offset = _offset(frame, parity)
    z, y, x = (np.arange(n) for n in shape)
    return np.asarray((z[:, np.newaxis, np.newaxis] + y[:, np.newaxis] + x) % 2 == offset)


# --- the computed half, compact ---------------------------------------------------------------------


def lattices(shape: Shape, frame: int, *, parity: str = "even") -> tuple[Index, ...]:
    """Cut the texels that a frame computes into boxes with steps of two.

    Parameters
    ----------
    shape : tuple of 3 ints
        Slices, rows and columns.
    frame : int
        The frame's number.
    parity : {"even", "odd"}
        A1, see `computed`.

    Returns
    -------
    tuple of Index
        At most four, none of them empty: together they hold every computed texel once and no other. Ranges with a
        step of 2 along z, y and x, by whether z, then y is even.

    Raises
    ------
    InputError
        As for `computed`.

    Notes
    -----
    With z ≡ a, y ≡ b (mod 2) the computed x are ≡ a + b + frame: for each of the four (a, b) one lattice. Odd sizes
    need no padding, since a lattice that begins at 1 is simply shorter.

    Examples
    --------
    >>> [tuple((r.start, r.step) for r in lattice) for lattice in lattices((2, 2, 4), 1)]
    [((0, 2), (0, 2), (1, 2)), ((0, 2), (1, 2), (0, 2)), ((1, 2), (0, 2), (0, 2)), ((1, 2), (1, 2), (1, 2))]
    >>> lattices((1, 1, 1), 1)
    ()
    """
    offset = _offset(frame, parity)
    starts = [(a, b, (a + b + offset) % 2) for a in (0, 1) for b in (0, 1)]
    boxes = [(slice(a, shape[0], 2), slice(b, shape[1], 2), slice(c, shape[2], 2)) for a, b, c in starts]
    return tuple(box for box in boxes if all(r.start < r.stop for r in box))


def gather(field: NDArray[T], lattice: Index) -> NDArray[T]:
    """Take the texels of a lattice out of a field.

    Parameters
    ----------
    field : Field, broadcastable to (z, y, x), or to (c, z, y, x)
        Of the whole grid; three axes at least.
    lattice : Index
        One of `lattices`.

    Returns
    -------
    Field
        A view; axes of length 1 stay.

    Examples
    --------
    >>> lattice = lattices((2, 2, 4), 0)[1]
    >>> gather(np.arange(4.0).reshape(1, 1, 4), lattice).tolist(), gather(np.zeros((3, 2, 1, 1)), lattice).shape
    ([[[1.0, 3.0]]], (3, 1, 1, 1))
    """
    # Along an axis of length 1 only the lattice's first texel could exist: what is there stands for all.
    z, y, x = (part if n > 1 else slice(None) for part, n in zip(lattice, field.shape[-3:], strict=True))
    return field[..., z, y, x]


def lattice_froxels(froxels: Froxels, lattice: Index) -> Froxels:
    """Make the froxel grid of a lattice, for whatever works on froxels.

    Parameters
    ----------
    froxels : Froxels
        The whole grid, jittered or not.
    lattice : Index
        One of `lattices`.

    Returns
    -------
    Froxels
        Samples exactly those of the whole grid, bit for bit. ``boundaries`` remain those of the whole grid, for the
        lattice's slices do not touch.

    Notes
    -----
    Sample i of the lattice is sample start + 2i of the grid, so the rows of ``sample_from_world`` become
    (row − start·row_depth)/2.

    Examples
    --------
    >>> from froxel_ref.grid import make_froxels
    >>> from froxel_ref.scene import Camera
    >>> from froxel_ref.settings import Grid
    >>> froxels = make_froxels(Camera(), Grid(width=5, height=3, depth=4))
    >>> [lattice_froxels(froxels, lattice).rays.length.shape for lattice in lattices((4, 3, 5), 0)[:2]]
    [(2, 3), (1, 2)]
    """
    z, y, x = lattice
    rays = crop_rays(froxels.rays, y, x)
    a, b, c = (np.ascontiguousarray(component) for component in rays.per_depth)
    matrix = froxels.sample_from_world.copy()
    for row, part in ((0, x), (1, y)):
        matrix[row] = (matrix[row] - part.start * matrix[2]) / part.step
    return Froxels(rays._replace(per_depth=(a, b, c), length=np.ascontiguousarray(rays.length)),
                   np.ascontiguousarray(froxels.depths[z]), froxels.boundaries, matrix)


def scatter(parts: Sequence[Field], shape: Shape, frame: int, *, parity: str = "even", empty: float = 0.0) -> Field:
    """Lay the lattices of a frame out in the whole grid again.

    Parameters
    ----------
    parts : sequence of Field
        One for each of `lattices`, in their order; broadcastable to (z, y, x), or all of them to (c, z, y, x), of
        the lattice.
    shape : tuple of 3 ints
        Slices, rows and columns of the whole grid.
    frame, parity
        As for `lattices`.
    empty : float
        What the holes hold.

    Returns
    -------
    Field, shape (z, y, x) or (c, z, y, x)
        In the dtype of the parts together; full along z, y and x whatever the parts' axes.

    Raises
    ------
    InputError
        Another number of parts than of lattices, none at all, or a part that does not fit its lattice.

    Notes
    -----
    A part of length 1 along an axis has that value everywhere along it. Where all parts have length 1 along an axis,
    so has what they are parts of, most likely: then to compute it without a checkerboard is cheaper.

    Examples
    --------
    >>> scatter([np.full((1, 1, 1), 1.0), np.full((1, 1, 1), 2.0)], (1, 2, 4), 0).tolist()
    [[[1.0, 0.0, 1.0, 0.0], [0.0, 2.0, 0.0, 2.0]]]
    """
    boxes = lattices(shape, frame, parity=parity)
    if len(parts) != len(boxes) or not parts:
        raise InputError("parts", f"has {len(parts)}, must have {len(boxes)} and at least one, a part for each lattice")
    channels = parts[0].shape[:-3]
    result = np.full((*channels, *shape), empty, np.result_type(*parts))
    for i, (part, box) in enumerate(zip(parts, boxes, strict=True)):
        target = result[..., *box]
        if part.ndim != target.ndim or any(n not in (1, m) for n, m in zip(part.shape, target.shape, strict=True)):
            raise InputError(f"parts[{i}]", f"has shape {part.shape}, must be broadcastable to {target.shape}")
        target[...] = part
    return result


def pack(parts: Sequence[Field], shape: Shape, frame: int, *, parity: str = "even") -> Field:
    """Lay the lattices of a frame out as the texture of half the slices that a shader writes.

    Parameters
    ----------
    parts, shape, frame, parity
        As for `scatter`.

    Returns
    -------
    Field, shape (⌈D/2⌉, H, W) or (c, ⌈D/2⌉, H, W), or (…, 1, 1, 1) where all is one number
        Texel (x, y, z) stands in slice ⌊z/2⌋ [Dörries 2020, listing 3.11]; 0 in a last one that the grid lacks.

    Raises
    ------
    InputError
        As for `scatter`.

    Examples
    --------
    >>> pack([np.full((1, 1, 1), 1.0), np.full((1, 1, 1), 2.0)], (1, 2, 2), 0).tolist()
    [[[1.0, 0.0], [0.0, 2.0]]]
    """
    if parts and all(part.shape[-3:] == (1, 1, 1) and np.array_equal(part, parts[0]) for part in parts):
        return parts[0]
    whole = scatter(parts, shape, frame, parity=parity)
    # Of each two slices a column has one; the other is an exact 0.
    half = whole[..., 0::2, :, :].copy()
    half[..., :shape[0] // 2, :, :] += whole[..., 1::2, :, :]
    return half


def unpack(half: Field, shape: Shape, frame: int, *, parity: str = "even", empty: float = 0.0) -> Field:
    """The inverse of `pack`: the whole grid with its holes.

    Parameters
    ----------
    half : Field
        From `pack`.
    shape, frame, parity, empty
        As for `scatter`.

    Returns
    -------
    Field, shape (z, y, x) or (c, z, y, x)

    Examples
    --------
    >>> unpack(np.array([[[1.0, 3.0], [4.0, 2.0]]]), (2, 2, 2), 0, empty=-1).tolist()
    [[[1.0, -1.0], [-1.0, 2.0]], [[-1.0, 3.0], [4.0, -1.0]]]
    """
    result = np.full((*half.shape[:-3], *shape), empty, half.dtype)
    for box in lattices(shape, frame, parity=parity):
        z, y, x = box
        some = (slice(0, len(range(shape[0])[z])), y, x)
        result[..., *box] = gather(half, some)
    return result


# --- the holes --------------------------------------------------------------------------------------


def fill(current: Field, history: Field | None, valid: ArrayLike, frame: int, *, parity: str = "even",
         exposure_ratio: float = 1.0, outside: str = "absent", without_history: str = "neighbours") -> Field:
    """Fill the holes of a frame from its history, and where there is none from the neighbours.

    Parameters
    ----------
    current : Field, shape (z, y, x) or (c, z, y, x)
        As `scatter` lays it out, full along z, y and x; the holes are not read.
    history : Field, broadcastable to ``current``, or None
        Of the frame before, as reprojected; None in the first frame.
    valid : array_like of bool, broadcastable to (z, y, x)
        Whether a texel has a history. One that is not finite in every channel counts as none.
    frame, parity
        As for `computed`.
    exposure_ratio : float
        A12: factor on the history, as for `froxel_ref.temporal.blend`.
    outside : {"absent", "zero"}
        D11: neighbours outside the grid do not count, or count as zero: then what is filled at the border is 25 %
        too dark, in corners 50 %.
    without_history : {"neighbours", "empty"}
        D11: what holes hold if ``history`` is None: the neighbours' mean, or 0.

    Returns
    -------
    Field, shape of ``current``
        In the dtype of current and history together. Computed texels are those of ``current``, bit for bit.

    Raises
    ------
    InputError
        An unknown word; a ratio that is negative or not finite.

    Notes
    -----
    [Dörries 2020, §3.2.9]. All four neighbours of a hole in its slice were computed in this frame. Their mean is
    exact, but for rounding, for a field linear in the texel, where all four exist; at the border the mean is of two
    or three and leans inwards by at most half a texel's change per axis. In a slice of a single texel there are none:
    then the mean is over those before and behind, which were computed as well (not with "zero", by which all four
    count as zeros). A grid of a single texel has nothing to fill its hole with, which then holds 0.

    A texel is computed every other frame, and a hole that is filled with its history does not move the average: a
    step is answered at half the pace, 5 % are left after some 117 frames at 0.05.

    Examples
    --------
    >>> half = scatter([np.full((1, 1, 1), 1.0), np.full((1, 1, 1), 2.0)], (1, 2, 4), 0)
    >>> fill(half, None, False, 0)[0, 0].tolist()
    [1.0, 1.3333333333333333, 1.0, 1.5]
    """
    shape = _sizes(current)
    _offset(frame, parity)
    for name, word, words in (("outside", outside, OUTSIDE), ("without_history", without_history, WITHOUT_HISTORY)):
        if word not in words:
            raise InputError(name, f"is {shown(word)}; {suggest(str(word), words)}")
    if not (np.isfinite(exposure_ratio) and exposure_ratio >= 0.0):
        raise InputError("exposure_ratio", f"is {shown(exposure_ratio)}, must be a finite number, at least 0")
    result = current.astype(current.dtype if history is None else np.result_type(current, history))
    for box in lattices(shape, frame + 1, parity=parity):
        result[..., *box] = _holes(current, history, np.asarray(valid), box, float(exposure_ratio), outside,
                                   without_history)
    return result


def _holes(current: Field, history: Field | None, valid: Flags, box: Index, ratio: float, outside: str,
           without_history: str) -> Field:
    """What a lattice of holes is filled with."""
    if history is None:
        return np.zeros((), current.dtype) if without_history == "empty" else _neighbours(current, box, outside)
    with np.errstate(invalid="ignore", over="ignore"):
        scaled = gather(history, box) * ratio if ratio != 1.0 else gather(history, box)
    use = usable(scaled, gather(valid, box) if valid.ndim >= 3 else valid)
    return scaled if use.all() else np.where(use, scaled, _neighbours(current, box, outside))


def _sizes(field: Field) -> Shape:
    depth, rows, columns = field.shape[-3:]
    return depth, rows, columns


def _neighbours(current: Field, box: Index, outside: str) -> Field:
    """The mean of the four neighbours in the slice of a lattice's texels, or of those that exist."""
    sizes = _sizes(current)
    shape = tuple(len(range(n)[part]) for part, n in zip(box, sizes, strict=True))
    total = np.zeros((*current.shape[:-3], *shape), current.dtype)
    least, most = np.full_like(total, np.inf), np.full_like(total, -np.inf)
    count = np.zeros((1, 1, 1), current.dtype)
    for axis in (0,) if sizes[1:] == (1, 1) and outside == "absent" else (1, 2):
        beside = np.zeros(shape[axis], current.dtype)
        for here, there in _beside(box[axis], sizes[axis]):
            z, y, x = (there if i == axis else part for i, part in enumerate(box))
            target: tuple[Any, ...] = (..., here, *(slice(None),) * (2 - axis))
            near = current[..., z, y, x]
            total[target] += near
            np.minimum(least[target], near, out=least[target])
            np.maximum(most[target], near, out=most[target])
            beside[here] += 1.0
        count = count + beside.reshape([-1 if i == axis else 1 for i in range(3)])
    if outside == "zero":
        return total / 4.0
    # The sum of three equal numbers is rounded: their mean is held to be that number.
    return np.where(count > 0.0, np.minimum(np.maximum(total / np.maximum(count, 1.0), least), most), 0.0)


def _beside(part: slice, count: int) -> tuple[tuple[slice, slice], tuple[slice, slice]]:
    """Of every second texel of an axis: which have a neighbour before and behind, and which texels those are."""
    start, holes, after = part.start, len(range(count)[part]), len(range(part.start + 1, count, 2))
    first = 1 - start  # a lattice begins at 0 or 1
    return ((slice(first, holes), slice(start + 2 * first - 1, start + 2 * holes - 2, 2)),
            (slice(0, after), slice(start + 1, count, 2)))
