"""Half the image's resolution and back: depths by nearest and farthest in turn, and upsampling that sees depth.

A texel of the half-resolution image covers two by two pixels, one or two at an odd image's last column and row. Its
centre is the corner that its pixels share, whatever the image's size.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TypeAlias

import numpy as np
from numpy.typing import DTypeLike, NDArray

from froxel_ref import blocks
from froxel_ref.arrays import Field
from froxel_ref.fog_lookups import rotated_taps
from froxel_ref.geometry import Rays, camera_rays
from froxel_ref.records import InputError, shown, suggest
from froxel_ref.scene import Camera

__all__ = ["EXTREMES", "JUDGED", "half_depth", "half_rays", "rotated_offsets", "upsample"]

Texels: TypeAlias = NDArray[np.intp]

EXTREMES = ("nearest", "farthest")
"""Which depth of its pixels a texel of even x + y takes; the other texels take the other one."""

JUDGED = ("texel", "tap")
"""Whose depth is compared with the pixel's: see `upsample`."""


# --- half the resolution ----------------------------------------------------------------------------


def half_depth(depth: Field, *, even: str = "nearest", shape: tuple[int, int] | None = None) -> Field:
    """Take the nearest or the farthest of every two by two pixels' depths, in turn like the fields of a chessboard.

    Parameters
    ----------
    depth : ndarray, shape (h, w) [m]
        View depth of the pixels, +inf where there is no surface.
    even : {"nearest", "farthest"}, default "nearest"
        What texels (x, y) take whose x + y is even. The thesis's listing takes the smaller value there, which is the
        nearest of depths that grow; its program's depth falls with distance, so that it takes the farthest (A11).
    shape : (int, int), optional
        Height and width of the image, if ``depth`` has length 1 along an axis on which it does not vary.

    Returns
    -------
    ndarray, shape (⌈h/2⌉, ⌈w/2⌉) [m]
        (1, 1) if the depth is one number. Every value is one of the pixels'; at an odd image's last column and row
        the pixels that are there count. A NaN among them gives NaN.

    Raises
    ------
    InputError
        An unknown word, no image, or a shape that does not fit.

    Notes
    -----
    [Dörries 2020, listing 3.10]. A mean of depths would belong to no surface.

    Examples
    --------
    >>> half_depth(np.array([[1.0, 2.0, 5.0], [3.0, 4.0, 6.0]])).tolist()
    [[1.0, 6.0]]
    >>> half_depth(np.array([[1.0, 2.0, 5.0], [3.0, 4.0, 6.0]]), even="farthest").tolist()
    [[4.0, 5.0]]
    """
    if even not in EXTREMES:
        raise InputError("even", f"is {even!r}; {suggest(even, EXTREMES)}")
    if depth.ndim != 2 or 0 in depth.shape:
        raise InputError("depth", f"has shape {depth.shape}, must be (h, w)")
    if shape is not None and depth.shape != (1, 1):
        depth = _spread("depth", depth, shape)
    rows, columns = (np.minimum(np.arange(2 * -(-count // 2)), count - 1) for count in depth.shape)
    block = depth[rows][:, columns].reshape(len(rows) // 2, 2, len(columns) // 2, 2)
    nearest, farthest = block.min(axis=(1, 3)), block.max(axis=(1, 3))
    odd = (np.arange(nearest.shape[0])[:, np.newaxis] + np.arange(nearest.shape[1])) % 2 == 1
    result: Field = np.where(odd == (even == "nearest"), farthest, nearest)
    return result


def _spread(name: str, field: Field, shape: tuple[int, ...]) -> Field:
    try:
        return np.broadcast_to(field, shape)
    except ValueError:
        raise InputError(name, f"has shape {field.shape}, must fit {shape}") from None


def half_rays(camera: Camera, width: int, height: int, *, shift: tuple[float, float] = (0.0, 0.0),
              dtype: DTypeLike = np.float64) -> Rays:
    """Make the rays through the centres of the half-resolution texels of an image.

    Parameters
    ----------
    camera : Camera
        Its whole image is covered by the pixels.
    width, height : int
        Of the image in full resolution [pixels].
    shift : (float, float), default (0, 0)
        [pixels] How far to the right and downwards the pixels of a jittered image are sampled.
    dtype : data type
        Of the result.

    Returns
    -------
    Rays
        Shape (⌈height/2⌉, ⌈width/2⌉); texel (x, y) through pixel coordinates (2x + 1, 2y + 1), which for the last
        texel of an odd image is its border.

    Examples
    --------
    >>> rays = half_rays(Camera(vertical_fov=90, width=3, height=3), 3, 3)
    >>> rays.length.shape, rays.per_depth[0].ravel().round(6).tolist()
    ((2, 2), [-0.333333, 1.0])
    """
    rays = camera_rays(camera, width, height, jitter=(1.0 + shift[0], 1.0 + shift[1]), dtype=dtype)
    x, y, z = (component[::2, ::2] for component in rays.per_depth)
    return Rays(rays.origin, (x, y, z), rays.length[::2, ::2])


# --- and back ---------------------------------------------------------------------------------------


def rotated_offsets(noise: Field, *, reach: float = 1.5) -> Field:
    """Make four offsets of taps from four numbers a pixel.

    Parameters
    ----------
    noise : ndarray, shape (4, h, w)
        In [0, 1]: blue noise, another layer each frame.
    reach : float, default 1.5
        Largest offset [texels], either way [Dörries 2020, listing 3.12].

    Returns
    -------
    ndarray, shape (4, 2, h, w) [texels]
        Offsets along x, then y: tap i has the numbers i and i + 1 (mod 4), spread to [−reach, reach].

    Raises
    ------
    InputError
        Another number of channels.

    Notes
    -----
    One fetch of noise serves four taps [Dörries 2020, listing 3.13].

    Examples
    --------
    >>> rotated_offsets(np.array([0.0, 0.5, 1.0, 0.25]).reshape(4, 1, 1))[..., 0, 0].tolist()
    [[-1.5, 0.0], [0.0, 1.5], [1.5, -0.75], [-0.75, -1.5]]
    """
    if noise.ndim != 3 or noise.shape[0] != 4:
        raise InputError("noise", f"has shape {noise.shape}, must be (4, h, w)")
    return rotated_taps(noise, taps=4, axes=2, reach=reach)


def upsample(fields: Sequence[Field], half: Field, depth: Field, *, offsets: Field | None = None,
             judged: str = "texel", accepted: float = 0.1, least: float = 1e-5, begins: float = 0.0,
             nearer: Sequence[float] = (), shape: tuple[int, int] | None = None,
             threads: int | None = None) -> tuple[Field, ...]:
    """Spread half-resolution images over the pixels, each from the texels at its own depth.

    Parameters
    ----------
    fields : sequence of ndarray, each of shape (⌈h/2⌉, ⌈w/2⌉) or (C, ⌈h/2⌉, ⌈w/2⌉)
        What to spread, finite: for the long range its radiance and transmittance. Length 1 along axes of the image on
        which nothing varies.
    half : ndarray, broadcastable to (⌈h/2⌉, ⌈w/2⌉) [m]
        View depth that the texels belong to, as `half_depth` gives it.
    depth : ndarray, shape (h, w) [m]
        View depth of the pixels.
    offsets : ndarray, shape (t, 2, h, w), optional [texels]
        Along x and y, of each of t taps a pixel, in half-resolution texels (`rotated_offsets`). Unless given there is
        one tap, at the pixel: its four nearest texels, bilinearly.
    judged : {"texel", "tap"}, default "texel"
        Whose depth is compared with the pixel's; see the notes. Published: "tap".
    accepted : float, default 0.1
        Difference of depth, as a share of the pixel's, from which on a texel has the least weight
        [Dörries 2020, listing 3.13].
    least : float, default 1e-5
        The least weight, so that there always is one [Dörries 2020, listing 3.13].
    begins : float, default 0
        [m] Pixels that are not beyond this depth take no part: the froxels' far end, for the long range.
    nearer : sequence of float
        What each of the fields is there; must be given if ``begins`` is: 0 and 1 for the long range.
    shape : (int, int), optional
        Height and width of the image, if ``depth`` has length 1 along an axis on which it does not vary.
    threads : int, optional
        Default: one per core. The result is the same to the last bit.

    Returns
    -------
    tuple of ndarray, each of shape (h, w) or (C, h, w)
        In the fields' own types. A field with length 1 along both axes of the image stays as it is, unless pixels that
        take no part differ from it.

    Raises
    ------
    InputError
        An unknown word; a number that is out of range; shapes that do not fit.

    Notes
    -----
    The weight of a difference Δz at a pixel's depth z is max(sat(1 − |Δz|/(0.1 z)), 1e-5)
    [Dörries 2020, listing 3.13]. Where all texels have the pixel's depth the result is their bilinear mean.

    ``texel`` : each of a tap's four texels is judged by its own depth, its bilinear share times the weight. At a depth
        edge the texels beyond it give at most 1.5e-4/v of the result, v the weight of any one texel on the
        pixel's side, unless offsets are given: its bilinear share is 1/16 or more.
    ``tap`` : as published: the texel that holds the tap is judged for all four. The bilinear fetch then brings
        in what lies beyond an edge, up to some 3/4 of it.

    Infinite depths: sky beside sky has weight 1, sky beside a surface the least. So has a depth of NaN. Where all
    texels have the least weight, it cancels, and the plain mean is left. Means never leave the hull of what they
    are of but for rounding, and never exceed 1 where nothing does.

    Examples
    --------
    >>> near, far = 10.0, 100.0
    >>> image, = upsample([np.array([[0.0, 8.0]])], np.array([[near, far]]), np.array([[near, near, far, far]]))
    >>> image.round(4).tolist()  # without depth 0, 2, 6, 8
    [[0.0, 0.0, 8.0, 8.0]]
    """
    if judged not in JUDGED:
        raise InputError("judged", f"is {judged!r}; {suggest(judged, JUDGED)}")
    for name, value in (("accepted", accepted), ("least", least)):
        if not value > 0.0:
            raise InputError(name, f"is {shown(value)}, must be above 0")
    depth = _spread("depth", depth, shape or depth.shape)
    size = (-(-depth.shape[0] // 2), -(-depth.shape[1] // 2))
    half = _spread("half", half, size)
    texels = [_spread("fields", field, (*field.shape[:-2], *size)) for field in fields]
    if begins > 0.0 and len(nearer) != len(fields):
        raise InputError("nearer", f"has {len(nearer)} values, must have {len(fields)} as there are fields")
    if offsets is not None and (offsets.ndim != 4 or offsets.shape[1] != 2 or not len(offsets)):
        raise InputError("offsets", f"has shape {offsets.shape}, must be (taps, 2, h, w)")
    offsets = np.zeros((1, 2, 1, 1)) if offsets is None else offsets
    moves = _spread("offsets", offsets, (len(offsets), 2, *depth.shape))
    outside = tuple(nearer) if begins > 0.0 else (0.0,) * len(fields)
    spread = [field.shape[-2:] != (1, 1) or (begins > 0.0 and bool((field != value).any()))
              for field, value in zip(fields, outside, strict=True)]
    images = [np.full((*field.shape[:-2], *depth.shape), value, field.dtype) if wanted else field
              for field, value, wanted in zip(fields, outside, spread, strict=True)]
    rows, columns = np.nonzero(~(depth <= begins) if begins > 0.0 else np.ones(depth.shape, bool))

    def work(chosen: slice) -> None:
        y, x = rows[chosen], columns[chosen]
        taps = list(_taps(half, y, x, depth[y, x], moves[..., y, x].astype(np.float64), judged, accepted, least))
        total = sum(weight for _, _, weight in taps)
        for image, field, wanted in zip(images, texels, spread, strict=True):
            if wanted:
                image[..., y, x] = sum(field[..., row, column] * weight for row, column, weight in taps) / total

    if any(spread):
        blocks.run(work, [slice(i, i + blocks.BLOCK) for i in range(0, rows.size, blocks.BLOCK)], threads=threads)
    return tuple(images)


def _taps(half: Field, rows: Texels, columns: Texels, depth: Field, moves: Field, judged: str, accepted: float,
          least: float) -> Iterator[tuple[Texels, Texels, Field]]:
    """Rows, columns and weights of the texels of n pixels, each of shape (n,)."""
    for across, down in moves:
        y, x = 0.5 * rows + 0.25 + down, 0.5 * columns + 0.25 + across
        held = _alike(half[_texel(y, half.shape[0]), _texel(x, half.shape[1])], depth, accepted, least)
        for row, high in _sides(y, half.shape[0]):
            for column, wide in _sides(x, half.shape[1]):
                like = held if judged == "tap" else _alike(half[row, column], depth, accepted, least)
                yield row, column, high * wide * like


def _texel(position: Field, count: int) -> Texels:
    """The texel that holds a position, at the borders the last one."""
    return np.clip(np.floor(position).astype(np.intp), 0, count - 1)


def _sides(position: Field, count: int) -> tuple[tuple[Texels, Field], tuple[Texels, Field]]:
    """The texels on both sides of a position, by their centres, and their bilinear shares."""
    low = np.floor(position - 0.5)
    share: Field = position - 0.5 - low
    return (_texel(low, count), 1.0 - share), (_texel(low + 1.0, count), share)


def _alike(found: Field, depth: Field, accepted: float, least: float) -> Field:
    """What texels' depths weigh for pixels of another depth."""
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        weight = 1.0 - np.abs(found - depth) / (accepted * depth)
    # What is no number, as the difference of two infinite depths is, weighs least.
    return np.where(found == depth, 1.0, np.fmax(weight, least))
