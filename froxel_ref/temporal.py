"""The temporal filter of volumes: where a froxel was in the frame before, and an exponential moving average.

A froxel's history is looked up at its *unjittered* centre: the jitter of the samples is the noise that the filter
averages, and must not move what it has averaged already.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray

from froxel_ref.arrays import Field
from froxel_ref.geometry import clip_from_view, inside_raster, turn_and_shift, turned
from froxel_ref.grid import depth_to_slice, slice_to_depth
from froxel_ref.records import InputError, shown
from froxel_ref.sampling import at_centres, fetch_trilinear
from froxel_ref.scene import Camera
from froxel_ref.settings import Grid

__all__ = ["HistoryPosition", "blend", "history_length", "history_position", "reproject", "start_weight", "usable"]

Doubles = NDArray[np.float64]
Flags = NDArray[np.bool_]


class HistoryPosition(NamedTuple):
    """Where the froxels' centres lie in the volume of the frame before.

    Attributes
    ----------
    x, y, z : Field, broadcastable to (D, H, W)
        Texel coordinates in that volume, centres at i + ½; each has three axes, of length 1 where it does not vary.
        x and y are NaN at or behind the plane of the camera of the frame before.
    valid : ndarray of bool, broadcastable to (D, H, W)
        Whether the texture coordinate lies in [0, 1]³; one texel where all of them do.
    shape : tuple of 3 ints
        Slices, rows and columns of the volume of the frame before.
    """

    x: Field
    y: Field
    z: Field
    valid: Flags
    shape: tuple[int, int, int]

    def texture(self) -> tuple[Field, Field, Field]:
        """The texture coordinates (u, v, w), [0, 1] along each axis of the volume."""
        depth, height, width = self.shape
        return self.x / width, self.y / height, self.z / depth


# --- where a froxel was -----------------------------------------------------------------------------


def history_position(grid: Grid, camera: Camera, previous_camera: Camera, *, previous_grid: Grid | None = None,
                     dtype: DTypeLike = np.float64) -> HistoryPosition:
    """Find every froxel's unjittered centre in the volume of the frame before.

    Parameters
    ----------
    grid, camera : Grid, Camera
        Of this frame.
    previous_camera : Camera
        Of the frame before.
    previous_grid : Grid, optional
        Of the frame before; ``grid`` unless given.
    dtype : data type
        Of the coordinates; all is computed in float64 and rounded once. Keep float64 for volumes of either type: a
        coordinate in float32 is off by up to 2⁻¹⁷ texels in a volume of 240.

    Returns
    -------
    HistoryPosition
        With the axes that vary: of a camera that stands still (1, 1, W), (1, H, 1) and (D, 1, 1), exactly the
        centres i + ½; of one that moves along its axis (D, 1, W), (D, H, 1) and (D, 1, 1).

    Notes
    -----
    World position of the texel centre, then the previous frame's projection [Dörries 2020, §3.2.3], valid iff inside
    [0, 1]³. Formed from the turn and the shift between the two cameras, so the world's origin costs no digits:
    with a froxel's ray r (r_z = −1) and depth d, q = R·r + t/d has d·|q_z| for its previous depth and
    (q_x, q_y)/|q_z| for its previous image.

    Coordinates are in texels, not in [0, 1], since (i + ½)/n·n is not i + ½ in floating point: only so a fetch at
    rest gives the texel itself. ``texture()`` has them in [0, 1].

    Both ends of [0, 1] are valid. A coordinate beyond an end by no more than 2⁻³⁰ texels counts as on it, lest the
    rounding of a motion by whole texels and a half decide; fetches clamp, so the value there is the end's. A
    camera at rest has no froxel nearer than half a texel to an end. Error measured against 50 digits, in view, for
    240×135×128 froxels: 7e-14 texels, at the origin and 10⁶ m from it alike.

    Examples
    --------
    >>> grid = Grid(width=4, height=2, depth=8)
    >>> rest = history_position(grid, Camera(), Camera())
    >>> rest.x.ravel().tolist(), rest.z.shape, rest.valid.tolist()
    ([0.5, 1.5, 2.5, 3.5], (8, 1, 1), [[[True]]])
    """
    before = previous_grid or grid
    turn, shift = turn_and_shift(camera, previous_camera)
    still = bool(np.array_equal(turn, np.eye(3))) and not shift.any()
    clip, clip_before = clip_from_view(camera, 1.0), clip_from_view(previous_camera, 1.0)
    i, j, k = (_along(np.arange(n) + 0.5, axis) for n, axis in ((grid.width, 2), (grid.height, 1), (grid.depth, 0)))
    depth: Doubles = slice_to_depth(k, grid)
    ray = ((2.0 * i / grid.width - 1.0) / clip[0, 0], (1.0 - 2.0 * j / grid.height) / clip[1, 1],
           np.full((1, 1, 1), -1.0))
    # Without a shift no depth enters, and its axis stays away.
    qx, qy, qz = (turned(row, ray) + s / depth if s != 0.0 else turned(row, ray)
                  for row, s in zip(turn, shift.tolist(), strict=True))
    ahead = np.where(qz < 0.0, -qz, np.nan)
    x: Field = before.width * (0.5 + 0.5 * clip_before[0, 0] * (qx / ahead))
    y: Field = before.height * (0.5 - 0.5 * clip_before[1, 1] * (qy / ahead))
    z: Field = depth_to_slice(depth * -qz, before)
    if still and clip[0, 0] == clip_before[0, 0]:
        x = i * (before.width / grid.width)
    if still and clip[1, 1] == clip_before[1, 1]:
        y = j * (before.height / grid.height)
    if still and (grid.near, grid.far, grid.distribution) == (before.near, before.far, before.distribution):
        z = k * (before.depth / grid.depth)
    valid = inside_raster((x, y, z), (before.width, before.height, before.depth))
    return HistoryPosition(x.astype(dtype), y.astype(dtype), z.astype(dtype), valid,
                           (before.depth, before.height, before.width))


def _along(values: Field, axis: int) -> Field:
    shape = [1, 1, 1]
    shape[axis] = -1
    return values.reshape(shape)


def reproject(volume: Field, position: HistoryPosition, *, threads: int | None = 1) -> Field:
    """Fetch a volume of the frame before at this frame's froxels.

    Parameters
    ----------
    volume : Field, shape (z, y, x) or (c, z, y, x)
        Of the frame before; length 1 along axes on which nothing varies.
    position : HistoryPosition
        Where the froxels lie in it.
    threads : int, optional
        As for `froxel_ref.sampling.fetch_trilinear`.

    Returns
    -------
    Field, shape (…) or (c, …)
        In the volume's dtype; length 1 where nothing varies. NaN where a coordinate is; what is beyond the volume's
        ends is the end's texel, to be left out by ``position.valid``.

    Raises
    ------
    InputError
        A volume of another shape than ``position`` is for.

    Notes
    -----
    Trilinear, clamped: order 2 in the texel size (measured 1.97), within half a texel of the volume's ends order 1.
    Where every coordinate is its texel's centre the result is the volume itself, the same array, bit for bit and
    without a fetch. A texel that is not finite spoils the up to eight results that read it; `blend` takes those for
    absent, so it lasts one frame.

    Examples
    --------
    >>> grid = Grid(width=4, height=2, depth=8)
    >>> volume = np.random.default_rng(1).random((3, 8, 2, 4))
    >>> reproject(volume, history_position(grid, Camera(), Camera())) is volume
    True
    """
    sizes = volume.shape[-3:]
    if volume.ndim not in (3, 4) or any(n not in (1, m) for n, m in zip(sizes, position.shape, strict=True)):
        raise InputError("volume", f"has shape {volume.shape}, must have {position.shape} for its last axes, or 1")
    if all(n == 1 or at_centres(c, axis, n)
           for axis, (c, n) in enumerate(zip((position.z, position.y, position.x), sizes, strict=True))):
        return volume
    with np.errstate(invalid="ignore"):  # texels that are not finite
        fetched = fetch_trilinear(volume, position.x, position.y, position.z, threads=threads)
    return fetched.astype(volume.dtype, copy=False)


# --- the average ------------------------------------------------------------------------------------


def usable(history: Field, valid: ArrayLike) -> Flags:
    """Tell where there is a history to average with.

    Parameters
    ----------
    history : Field, shape (z, y, x) or (c, z, y, x)
        As reprojected.
    valid : array_like of bool, broadcastable to (z, y, x)
        Whether its position lies in the volume.

    Returns
    -------
    ndarray of bool, shape (z, y, x)
        Valid, and finite in every channel.

    Examples
    --------
    >>> usable(np.array([1.0, np.nan, 2.0]).reshape(1, 1, 3), np.array([True, True, False])).ravel().tolist()
    [True, False, False]
    """
    finite = np.isfinite(history)
    return np.asarray((finite.all(axis=0) if history.ndim == 4 else finite) & np.asarray(valid))


def blend(current: Field, history: Field, valid: ArrayLike, *, alpha: ArrayLike = 0.05,
          exposure_ratio: float = 1.0) -> Field:
    """Average this frame's values with their history.

    Parameters
    ----------
    current : Field, shape (z, y, x) or (c, z, y, x)
        Y, of this frame.
    history : Field, like ``current``
        S of the frame before, as reprojected.
    valid : array_like of bool, broadcastable to (z, y, x)
        Whether a texel has a history. One that is not finite in every channel counts as none.
    alpha : float or array_like, broadcastable to (z, y, x), in [0, 1]
        Weight of the current value; 0.05 as published, 0.2 with jittered lookups and TAA. `start_weight` and
        `froxel_ref.ghosting.adaptive_alpha` give others.
    exposure_ratio : float
        A12: this frame's exposure over that of the frame before, where light is stored exposed.

    Returns
    -------
    Field
        In the dtype of current and history together: α·Y + (1 − α)·ratio·S, or Y alone where there is no history.

    Raises
    ------
    InputError
        A weight outside [0, 1]; a ratio that is negative or not finite.

    Notes
    -----
    [Dörries 2020, eq. 3.2]. Formed from the heavier of the two, S + α·(Y − S) up to α = ½ and Y + (1 − α)(S − Y)
    above: equal values give that value exactly, the result never leaves their hull, and the weights 0 and 1 give S
    and Y bit for bit.

    The weight of the value n frames ago is α(1 − α)ⁿ. A step is answered by 1 − (1 − α)ⁿ after n frames: 5 % are
    left after 58.4 frames at 0.05, so 59, and 14 at 0.2. Independent noise keeps α/(2 − α) of its variance: 1/39
    and 1/9. A history kept in fewer digits stops short: with round to nearest S stays as it is once |Y − S| is below
    ½ ulp/α, 10 ulp at 0.05, which is 1 % in float16.

    Examples
    --------
    >>> now, before = np.full((1, 1, 2), 1.0), np.array([2.0, np.nan]).reshape(1, 1, 2)
    >>> blend(now, before, True, alpha=0.25).ravel().tolist()
    [1.75, 1.0]
    """
    if not (np.isfinite(exposure_ratio) and exposure_ratio >= 0.0):
        raise InputError("exposure_ratio", f"is {shown(exposure_ratio)}, must be a finite number, at least 0")
    weight = np.asarray(alpha)
    if not (np.all(weight >= 0.0) and np.all(weight <= 1.0)):
        raise InputError("alpha", f"is {shown(alpha)}, must be within 0 and 1")
    dtype = np.result_type(current, history)
    weight = weight.astype(dtype)
    with np.errstate(invalid="ignore", over="ignore"):  # what is not finite is left out
        scaled = history if exposure_ratio == 1.0 else history * float(exposure_ratio)
        mixed = _mixed(scaled, current, weight)
    return np.where(usable(scaled, valid), mixed, current)


def _mixed(history: Field, current: Field, weight: NDArray[Any]) -> Field:
    """history + weight·(current − history), from the heavier end."""
    low = weight <= 0.5
    if low.all():
        return np.asarray(history + weight * (current - history))
    from_current = current + (1.0 - weight) * (history - current)
    if not low.any():
        return np.asarray(from_current)
    return np.where(low, history + weight * (current - history), from_current)


def history_length(length: ArrayLike, valid: ArrayLike) -> Doubles:
    """Count the values that a texel's average is made of, this frame's included.

    Parameters
    ----------
    length : array_like, broadcastable to (z, y, x)
        The count of the frame before, as reprojected; 0 where there is none.
    valid : array_like of bool, broadcastable to (z, y, x)
        Whether the texel has a history, see `usable`.

    Returns
    -------
    ndarray, float64
        length + 1 where valid, else 1.

    Examples
    --------
    >>> history_length(3.0, np.array([True, False])).tolist()
    [4.0, 1.0]
    """
    with np.errstate(invalid="ignore"):
        return np.where(np.asarray(valid), np.asarray(length, np.float64) + 1.0, 1.0)


def start_weight(length: ArrayLike, *, alpha: float = 0.05) -> Doubles:
    """Weigh all values of a young average alike.

    Parameters
    ----------
    length : array_like
        How many values there are, this frame's included, at least 1; see `history_length`.
    alpha : float, in (0, 1]
        The weight in the long run.

    Returns
    -------
    ndarray, shape of ``length``, float64
        max(α, 1/length), the ``alpha`` of `blend`.

    Raises
    ------
    InputError
        A weight or a length out of range.

    Notes
    -----
    As published a texel's first value keeps the weight (1 − α)ⁿ, more than its share 1/n for the first ln n/α
    frames: after 20 frames at 0.05 it still weighs 0.36. With 1/n the average of n ≤ 1/α values is their plain mean.
    Not published, so an option.

    Examples
    --------
    >>> start_weight([1.0, 2.0, 4.0, 40.0]).tolist()
    [1.0, 0.5, 0.25, 0.05]
    """
    if not 0.0 < alpha <= 1.0:
        raise InputError("alpha", f"is {shown(alpha)}, must be above 0 and at most 1")
    count = np.asarray(length, np.float64)
    if not np.all(count >= 1.0):
        raise InputError("length", f"is {shown(length)}, must be at least 1")
    return np.asarray(np.maximum(alpha, 1.0 / count))
