"""Where what a pixel shows was in the image of the frame before: its motion, from view depth and both cameras.

Positions are those of the *unjittered* pixel centres: the jitter of the samples is what temporal anti-aliasing
averages, and must not move what it has averaged already.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import DTypeLike, NDArray

from froxel_ref.arrays import Field
from froxel_ref.geometry import clip_from_view, inside_raster, turn_and_shift, turned
from froxel_ref.records import InputError, shown
from froxel_ref.scene import Camera

__all__ = ["Motion", "closest_depth", "from_velocity", "motion"]

Doubles = NDArray[np.float64]
Flags = NDArray[np.bool_]

# A pixel and its neighbours, itself first: where several are as near, the first of these is taken.
AROUND = tuple(sorted(((j, i) for j in (-1, 0, 1) for i in (-1, 0, 1)), key=lambda step: step != (0, 0)))


class Motion(NamedTuple):
    """Where what the pixels show was in the image of the frame before.

    Attributes
    ----------
    x, y : Field, broadcastable to (h, w) [pixels]
        Position there: 0 and w are the image's left and right edge, row 0 is on top, pixel centres lie at i + ½. NaN at
        or behind the plane of that frame's camera. Two axes each, of length 1 where it does not vary.
    valid : ndarray of bool, broadcastable to (h, w)
        Whether the position lies in that image; one pixel where all of them do.
    shape : (int, int)
        Height and width of either image.
    """

    x: Field
    y: Field
    valid: Flags
    shape: tuple[int, int]

    def velocity(self) -> tuple[Field, Field]:
        """Pixels that each point moved since, to the right and downwards."""
        x, y = _centres(self.shape)
        return x - self.x, y - self.y


def motion(depth_image: Field, camera: Camera, previous_camera: Camera, *, shape: tuple[int, int] | None = None,
           dtype: DTypeLike = np.float64) -> Motion:
    """Find where the points that the pixels show were in the image of the frame before.

    Parameters
    ----------
    depth_image : Field, broadcastable to ``shape`` [m]
        View depth at the pixels' centres, at least 0; ∞ where nothing is hit, NaN where it is not known.
    camera, previous_camera : Camera
        Of this frame and of the one before.
    shape : (int, int), optional
        Height and width of the images; the camera's unless given. They cover the cameras' whole view.
    dtype : data type
        Of the positions; all is computed in float64 and rounded once. Keep float64 for images of either type: in
        float32 a position is off by up to 2⁻¹⁵ pixels in an image of 960.

    Returns
    -------
    Motion
        With the axes that vary: of a camera that stands still exactly the centres i + ½, (1, w) and (h, 1).

    Raises
    ------
    InputError
        A negative depth; a depth image that ``shape`` does not fit; a shape without pixels.

    Notes
    -----
    Points are at rest: what moves by itself needs a velocity of its own (`from_velocity`). The point is lifted along
    the pixel's ray and projected by the previous camera [Dörries 2020, §3.2.6; Karis 2014]. Formed from the turn R and
    the shift t between both cameras, so the world's origin costs no digits: with the ray r (r_z = −1) and the depth d,
    q = R·r + t/d (for d < 1 m: R·r·d + t), and (q_x, q_y)/|q_z| is the previous image. At d = ∞ only R is left: the
    background turns but does not shift.

    A camera that stands still maps every pixel to itself, whatever its depth. Of one that turns alone no depth is
    read. Both edges of the image are valid, and what lies beyond by no more than 2⁻³⁰ pixels.

    Within 1e-13 of the image's size of 50-digit arithmetic for turns up to 60° (measured: 3e-14).

    Examples
    --------
    >>> before = Camera(position=(0, 0, 0), target=(0, 0, -1), vertical_fov=90, width=4, height=4)
    >>> now = Camera(position=(1, 0, 0), target=(1, 0, -1), vertical_fov=90, width=4, height=4)
    >>> motion(np.array([[2.0, 4.0, np.inf, np.inf]]), now, before).x.round(12).tolist()
    [[1.5, 2.0, 2.5, 3.5]]
    >>> motion(np.array([[2.0]]), now, now).x.tolist()
    [[0.5, 1.5, 2.5, 3.5]]
    """
    height, width = _image_shape(shape or (camera.height, camera.width))
    depth = np.asarray(depth_image, np.float64)
    if depth.ndim != 2 or any(n not in (1, m) for n, m in zip(depth.shape, (height, width), strict=True)):
        raise InputError("depth_image", f"has shape {depth.shape}, must be {(height, width)}, or 1 along an axis")
    if (depth < 0.0).any():
        raise InputError("depth_image", f"holds {float(np.nanmin(depth)):g}, must be at least 0 m")
    turn, shift = turn_and_shift(camera, previous_camera)
    clip, clip_before = clip_from_view(camera, 1.0), clip_from_view(previous_camera, 1.0)
    x, y = _centres((height, width))
    ray = ((2.0 * x / width - 1.0) / clip[0, 0], (1.0 - 2.0 * y / height) / clip[1, 1], np.full((1, 1), -1.0))
    qx, qy, qz = _shifted([turned(row, ray) for row in turn], shift, depth)
    ahead = np.where(qz < 0.0, -qz, np.nan)
    still = np.array_equal(turn, np.eye(3)) and not shift.any()
    with np.errstate(over="ignore"):  # what grazes that camera's plane
        if not (still and clip[0, 0] == clip_before[0, 0]):
            x = width * (0.5 + 0.5 * clip_before[0, 0] * (qx / ahead))
        if not (still and clip[1, 1] == clip_before[1, 1]):
            y = height * (0.5 - 0.5 * clip_before[1, 1] * (qy / ahead))
    return _motion(x.astype(dtype), y.astype(dtype), (height, width))


def from_velocity(velocity: Field, *, shape: tuple[int, int] | None = None) -> Motion:
    """Take pixels' motion from a velocity image, such as a renderer writes for things that move by themselves.

    Parameters
    ----------
    velocity : Field, shape (2, h, w) [pixels]
        How far each point moved since the frame before, to the right and downwards; NaN where it had no place there.
    shape : (int, int), optional
        Height and width of the images, where ``velocity`` has length 1 along axes on which it does not vary.

    Returns
    -------
    Motion
        In the dtype of ``velocity``.

    Raises
    ------
    InputError
        A velocity of another shape; a shape without pixels.

    Examples
    --------
    >>> moved = from_velocity(np.array([1.0, 0.0]).reshape(2, 1, 1), shape=(1, 3))
    >>> moved.x.tolist(), moved.valid.tolist()
    ([[-0.5, 0.5, 1.5]], [[False, True, True]])
    """
    velocity = np.asarray(velocity)
    full = _image_shape(shape or velocity.shape[1:])
    if velocity.ndim != 3 or len(velocity) != 2 or any(
            n not in (1, m) for n, m in zip(velocity.shape[1:], full, strict=True)):
        raise InputError("velocity", f"has shape {velocity.shape}, must be {(2, *full)}, or 1 along y or x")
    x, y = _centres(full)
    dtype = velocity.dtype if velocity.dtype.kind == "f" else np.float64
    return _motion((x - velocity[0]).astype(dtype), (y - velocity[1]).astype(dtype), full)


def closest_depth(pixels: Motion, depth_image: Field) -> Motion:
    """Let each pixel move like the nearest of the 3×3 pixels about it.

    Parameters
    ----------
    pixels : Motion
        Of each pixel by itself.
    depth_image : Field, broadcastable to ``pixels.shape`` [m]
        View depth; NaN counts as farther than everything.

    Returns
    -------
    Motion
        The pixel's own centre less the chosen one's velocity; ``pixels`` itself where nothing moves.

    Raises
    ------
    InputError
        A depth image of another shape.

    Notes
    -----
    [Karis 2014]: the anti-aliased edge of what stands in front reaches into pixels whose own point belongs to the
    background, and has to travel with the front. Pixels outside the image are not there. Of pixels that are equally
    near the pixel itself is taken, then the first in reading order; a program that begins with the first corner and
    takes what is strictly nearer gives whatever faces the camera the motion of its corner, off by a pixel's worth of
    change.

    Examples
    --------
    >>> moved = from_velocity(np.array([[[0.0, 0.0, 0.0, 0.25]], [[0.0] * 4]]))
    >>> closest_depth(moved, np.array([[9.0, 9.0, 9.0, 2.0]])).velocity()[0].tolist()
    [[0.0, 0.0, 0.25, 0.25]]
    """
    depth = np.asarray(depth_image)
    if depth.ndim != 2 or any(n not in (1, m) for n, m in zip(depth.shape, pixels.shape, strict=True)):
        raise InputError("depth_image", f"has shape {depth.shape}, must be {pixels.shape}, or 1 along an axis")
    x, y = _centres(pixels.shape)
    if np.array_equal(pixels.x, x) and np.array_equal(pixels.y, y):
        return pixels
    height, width = pixels.shape
    near = np.pad(np.broadcast_to(np.where(np.isnan(depth), np.inf, depth), pixels.shape), 1, constant_values=np.inf)
    columns, rows = (np.pad(np.broadcast_to(c, pixels.shape), 1, mode="edge") for c in (pixels.x, pixels.y))
    best, best_x, best_y = (a[1:-1, 1:-1].copy() for a in (near, columns, rows))
    for j, i in AROUND[1:]:
        window = (slice(1 + j, 1 + j + height), slice(1 + i, 1 + i + width))
        closer = near[window] < best
        np.copyto(best, near[window], where=closer)
        np.copyto(best_x, columns[window] - i, where=closer)
        np.copyto(best_y, rows[window] - j, where=closer)
    return _motion(best_x, best_y, pixels.shape)


# --- parts ------------------------------------------------------------------------------------------


def _image_shape(shape: tuple[int, ...]) -> tuple[int, int]:
    if len(shape) != 2 or not all(isinstance(n, (int, np.integer)) and n >= 1 for n in shape):
        raise InputError("shape", f"is {shown(shape)}, must be a height and a width of at least 1")
    return int(shape[0]), int(shape[1])


def _centres(shape: tuple[int, int]) -> tuple[Doubles, Doubles]:
    """x and y of the pixels' centres, (1, w) and (h, 1)."""
    height, width = shape
    columns, rows = (np.arange(count, dtype=np.float64) + 0.5 for count in (width, height))
    return columns[np.newaxis, :], rows[:, np.newaxis]


def _motion(x: Field, y: Field, shape: tuple[int, int]) -> Motion:
    """With what lies in the image marked."""
    return Motion(x, y, inside_raster((y, x), shape), shape)


def _shifted(directions: list[Doubles], shift: Doubles, depth: Doubles) -> list[Doubles]:
    """min(d, 1)·(R·r + t/d), which neither an infinite depth nor one of 0 turns into NaN."""
    if not shift.any():
        return directions
    if not (depth >= 1.0).all():
        directions = [direction * np.minimum(depth, 1.0) for direction in directions]
    return [direction if s == 0.0 else direction + s / np.maximum(depth, 1.0)
            for direction, s in zip(directions, shift.tolist(), strict=True)]
