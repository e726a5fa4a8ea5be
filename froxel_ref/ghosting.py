"""Remedies of ghosting: histories held to what this frame shows around a froxel, weights that grow where it differs.

The temporal filter takes every change for noise. What tells them apart is the neighbourhood: the 3×3×3 values of this
frame around a froxel. All remedies compare the history with it, so all of them share one weakness: noise that a whole
neighbourhood shares (every froxel has the same jitter) looks like a change.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from froxel_ref.arrays import Field
from froxel_ref.records import InputError, shown, suggest

__all__ = ["METHODS", "Moments", "adaptive_alpha", "clamp_history", "neighbourhood_bounds", "neighbourhood_moments"]

METHODS = ("minmax", "variance")
"""What a history may be held to: the smallest and largest neighbour, or their mean ± γ·σ."""


class Moments(NamedTuple):
    """Mean and standard deviation over a neighbourhood, each of the field's shape.

    Attributes
    ----------
    mean, deviation : Field
        In the field's unit; the deviation is that of the population, √(Σ(x − mean)²/n).
    """

    mean: Field
    deviation: Field


def neighbourhood_bounds(field: Field, *, known: ArrayLike | None = None) -> tuple[Field, Field]:
    """Find the smallest and the largest value around every texel.

    Parameters
    ----------
    field : Field, shape (z, y, x) or (c, z, y, x)
        Finite where known.
    known : array_like of bool, broadcastable to (z, y, x), optional
        Which texels count; all unless given. Under a checkerboard `froxel_ref.checkerboard.computed`.

    Returns
    -------
    least, most : Field, shape of ``field``, or that of field and ``known`` together
        Over the 3×3×3 texels of which it is the middle, as far as the grid goes, by channel. ∞ and −∞ where no
        neighbour is known.

    Notes
    -----
    Separable: nine passes of two values instead of 26.

    Examples
    --------
    >>> least, most = neighbourhood_bounds(np.array([3.0, 1.0, 2.0, 5.0]).reshape(1, 1, 4))
    >>> least.ravel().tolist(), most.ravel().tolist()
    ([1.0, 1.0, 1.0, 2.0], [3.0, 3.0, 5.0, 5.0])
    """
    infinity = field.dtype.type(np.inf)
    least = field if known is None else np.where(np.asarray(known), field, infinity)
    most = field if known is None else np.where(np.asarray(known), field, -infinity)
    for axis in (-3, -2, -1):
        least, most = _extreme(least, axis, np.minimum), _extreme(most, axis, np.maximum)
    return least, most


def _extreme(field: Field, axis: int, choose: np.ufunc) -> Field:
    """The least or greatest of each texel and its two neighbours along an axis."""
    low, high = _ends(axis)
    result = field.copy()
    choose(field[low], field[high], out=result[low])
    choose(result[high], field[low], out=result[high])
    return result


def _ends(axis: int) -> tuple[tuple[Any, ...], tuple[Any, ...]]:
    """Indexes of all texels but the last, and all but the first, along one of the last three axes."""
    after = (slice(None),) * (-1 - axis)
    return (Ellipsis, slice(None, -1), *after), (Ellipsis, slice(1, None), *after)


def neighbourhood_moments(field: Field, *, known: ArrayLike | None = None) -> Moments:
    """Find the mean and the standard deviation around every texel.

    Parameters
    ----------
    field : Field, shape (z, y, x) or (c, z, y, x)
        Finite where known.
    known : array_like of bool, broadcastable to (z, y, x), optional
        As for `neighbourhood_bounds`.

    Returns
    -------
    Moments
        Over the 3×3×3 texels of which it is the middle, as far as the grid goes, by channel. The texel itself and 0
        where no neighbour is known.

    Notes
    -----
    Three groups at a time along each axis are joined by their counts, means and sums of squares about the mean
    [Chan 1983], so nothing cancels: a constant has the deviation 0, and the relative error does not grow with
    mean/σ, as that of √(E[x²] − E[x]²) does.

    Examples
    --------
    >>> moments = neighbourhood_moments(np.array([1.0, 1.0, 4.0]).reshape(1, 1, 3))
    >>> moments.mean.ravel().tolist(), moments.deviation.ravel().round(3).tolist()
    ([1.0, 2.0, 2.5], [0.0, 1.414, 1.5])
    """
    some = np.ones((1, 1, 1), np.bool_) if known is None else np.asarray(known)
    mean = field if known is None else np.where(some, field, field.dtype.type(0.0))
    count = np.broadcast_to(some, np.broadcast_shapes(some.shape, field.shape[-3:])).astype(field.dtype)
    squares = np.zeros_like(mean)
    for axis in (-3, -2, -1):
        count, mean, squares = _joined(count, mean, squares, axis)
    there = count > 0.0
    deviation = np.sqrt(squares / np.maximum(count, 1.0))
    return Moments(np.where(there, mean, field), np.where(there, deviation, field.dtype.type(0.0)))


def _joined(count: Field, mean: Field, squares: Field, axis: int) -> tuple[Field, Field, Field]:
    """Each texel's group and those of its two neighbours along an axis as one group."""
    total, middle, spread = count, mean, squares
    low, high = _ends(axis)
    for here, there in ((low, high), (high, low)):
        more = np.zeros_like(count)
        more[here] = count[there]
        joint = total + more
        share = more / np.maximum(joint, 1.0)
        difference = np.zeros_like(mean)
        difference[here] = mean[there] - middle[here]
        added = np.zeros_like(squares)
        added[here] = squares[there]
        spread = spread + added + difference * difference * (total * share)
        middle = middle + difference * share
        total = joint
    return total, middle, spread


def clamp_history(history: Field, current: Field, *, method: str = "minmax", gamma: float = 1.0,
                  known: ArrayLike | None = None) -> Field:
    """Hold a history to what this frame shows around each texel.

    Parameters
    ----------
    history : Field, shape (z, y, x) or (c, z, y, x)
        As reprojected, and rescaled where the exposure changed. What is not finite stays so.
    current : Field, like ``history``
        Of this frame.
    method : {"minmax", "variance"}
        To the least and the greatest neighbour, or to their mean ± γ·σ.
    gamma : float
        γ, for "variance".
    known : array_like of bool, broadcastable to (z, y, x), optional
        As for `neighbourhood_bounds`. Where no neighbour is known the history stays as it is.

    Returns
    -------
    Field
        In the dtype of both together.

    Raises
    ------
    InputError
        An unknown method; γ negative or not finite.

    Notes
    -----
    What TAA does with colours [Dörries 2020, §3.2.6; Karis 2014; Salvi 2016], by channel, in the volume. A light
    that goes out leaves nothing behind where all around is dark at once. Noise that is independent from froxel to
    froxel keeps the filter's gain: 1.00 of it with "minmax", 0.99 with "variance" and γ = 1 (normal noise, α = 0.05).
    Noise that all froxels share loses it wholly, both have 1; but where the jitter moves a field that is linear over
    three froxels its mean stays within "minmax", for the range then spans a froxel to either side.

    Examples
    --------
    >>> history, dark = np.full((1, 1, 3), 1.0), np.array([0.0, 0.0, 0.5]).reshape(1, 1, 3)
    >>> clamp_history(history, dark).ravel().tolist()
    [0.0, 0.5, 0.5]
    """
    if method not in METHODS:
        raise InputError("method", f"is {shown(method)}; {suggest(str(method), METHODS)}")
    if not (np.isfinite(gamma) and gamma >= 0.0):
        raise InputError("gamma", f"is {shown(gamma)}, must be a finite number, at least 0")
    if method == "minmax":
        least, most = neighbourhood_bounds(current, known=known)
    else:
        mean, deviation = neighbourhood_moments(current, known=known)
        reach = float(gamma) * deviation
        least, most = mean - reach, mean + reach
        if known is not None:
            none = neighbourhood_bounds(current, known=known)[0] == np.inf
            least, most = np.where(none, -np.inf, least), np.where(none, np.inf, most)
    held = np.minimum(np.maximum(history, least), most)
    result = np.where((least <= most) & np.isfinite(history), held, history)
    return result.astype(np.result_type(history, current), copy=False)


def adaptive_alpha(current: Field, history: Field, *, least: float = 0.05, most: float = 0.5, onset: float = 1.0,
                   width: float = 1.0, deviation: Field | None = None, known: ArrayLike | None = None) -> Field:
    """Weigh the current value the more, the farther this frame has departed from the history.

    Parameters
    ----------
    current, history : Field, shape (z, y, x) or (c, z, y, x)
        Of this frame, and as reprojected, rescaled where the exposure changed.
    least, most : float, in [0, 1]
        The weight of the current value where nothing changed, and where all did.
    onset, width : float
        In deviations: up to which departure the weight is ``least``, and how much farther until it is ``most``.
    deviation : Field, broadcastable to ``current``, optional
        Of noise that the neighbourhood does not show, such as one estimated over time; added in squares.
    known : array_like of bool, broadcastable to (z, y, x), optional
        As for `neighbourhood_bounds`.

    Returns
    -------
    Field, shape (z, y, x)
        In [least, most], for `froxel_ref.temporal.blend`. ``most`` where the history is not finite.

    Raises
    ------
    InputError
        Weights out of order or outside [0, 1]; onset negative or width not positive.

    Notes
    -----
    α = least + (most − least)·sat((d − onset)/width), d the largest over the channels of |mean − history|/σ with the
    mean and the deviation σ over the neighbourhood. Variance-guided filters weigh differences by σ in the same way
    [Schied 2017]. It is the mean that is compared, not the froxel's own value, since that differs from the history by
    one σ by noise alone: of 27 values' mean and a filtered history d has a deviation of √(1/27 + α/(2 − α)), a
    quarter, so an onset of 1 is four of them, and no bias comes in from weights that follow the value they weigh.
    The mean at the border is one-sided: of a field linear across it d is exactly 1 there, which is the onset.
    Where σ is 0 every departure is a large one.

    Against clamping: noise keeps the gain, the answer to a change is no jump but one of ``most``, 5 frames to 5 % at
    ½, and changes below onset·σ are left to ``least``.

    Examples
    --------
    >>> now = np.array([1.0, 1.2, 0.9, 1.1]).reshape(1, 2, 2)
    >>> adaptive_alpha(now, np.full((1, 2, 2), 1.05))[0, 0].tolist()
    [0.05, 0.05]
    >>> adaptive_alpha(now, np.full((1, 2, 2), 4.0))[0, 0].tolist()
    [0.5, 0.5]
    """
    if not 0.0 <= least <= most <= 1.0:
        raise InputError("least", f"is {shown(least)}, must be within 0 and most ({shown(most)}), which is at most 1")
    if not (onset >= 0.0 and np.isfinite(onset)):
        raise InputError("onset", f"is {shown(onset)}, must be a finite number, at least 0")
    if not (width > 0.0 and np.isfinite(width)):
        raise InputError("width", f"is {shown(width)}, must be a finite number above 0")
    moments = neighbourhood_moments(current, known=known)
    spread: NDArray[np.floating] = moments.deviation if deviation is None else np.hypot(moments.deviation, deviation)
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        apart = np.abs(moments.mean - history)
        departure = np.where(apart == 0.0, 0.0, apart / spread)
        if departure.ndim == 4:
            departure = departure.max(axis=0)
        share = np.clip((departure - onset) / width, 0.0, 1.0)
    share = np.where(np.isnan(share), 1.0, share)
    return np.asarray(least + (most - least) * share, np.result_type(current, history))
