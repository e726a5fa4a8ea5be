"""Where the light along a ray breaks: media, height fog, windows, cones, thick fog; and the pieces between.

Every function gives cuts as columns of an array (rays, cuts); `pieces` sorts them and keeps the stretches
that have a length. A cut too many costs an interval, a cut too few costs many.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from froxel_ref.lights import smallest_d2, unit
from froxel_ref.optical_depth import Lines, MediumPath, optical_depth
from froxel_ref.scene import PointLight, SpotLight

__all__ = [
    "FAR", "Lamp", "from_angle", "jacobian", "lamp_cuts", "medium_cuts", "pieces", "relate",
    "thickness_cuts", "to_angle",
]

Array: TypeAlias = NDArray[np.floating[Any]]
Integers: TypeAlias = NDArray[np.integer[Any]]

# Exponents of height fog and optical depths at which to cut: a rule of 15 points resolves exp(−x) over a
# range of 14, and the next stretches hold less than 1e-7, 1e-49 of what the first one does.
FALLS = (2.0, 16.0, 112.0)
EPS = float(np.finfo(np.float64).eps)
FIRST_DEPTH, DEPTH_RATIO, LAST_DEPTH = 2.0, 8.0, 745.0
SHALLOWEST = 1e-30  # of a ray's length: nearer to its start no depth is looked for


class Lamp(NamedTuple):
    """A point or spot light as lines see it. Arrays of shape (n,) unless said otherwise.

    Attributes
    ----------
    light : PointLight
        The light.
    nearest : ndarray [m]
        t of the line's point nearest to the light; s = t − nearest is what the light is measured by.
    across2 : ndarray [m²]
        Squared distance there, h².
    scale : ndarray [m]
        H of the equiangular substitution: h, but not below a quarter of the light's smallest distance.
    least2 : float [m²]
        Lower bound of d².
    rounding : ndarray
        Relative error that the rounding of places makes of the light: some ulp of them over H, and over
        the line's length.
    cone_slope, cone_offset : ndarray
        (s·slope + offset)/d is the cosine to a spot light's axis; both 0 for point lights.
    """

    light: PointLight
    nearest: Array
    across2: Array
    scale: Array
    least2: float
    rounding: Array
    cone_slope: Array
    cone_offset: Array


def relate(light: PointLight, lines: Lines, *, attenuation: str = "min_distance") -> Lamp:
    """Relate a light to lines.

    Parameters
    ----------
    light : PointLight or SpotLight
        The light.
    lines : Lines
        With directions of length 1.
    attenuation : {"min_distance", "inverse_radius"}
        See `froxel_ref.lights.smallest_d2`.

    Returns
    -------
    Lamp

    Notes
    -----
    With q from the line's origin to the light and u its direction, h² = |q × u|² and the offset across
    the line is u × (q × u): no cancellation where the light is far from the origin and near to the line.

    Examples
    --------
    >>> line = Lines(np.zeros((3, 1)), np.array([[0.0], [0.0], [-1.0]]), np.zeros(1), np.ones(1))
    >>> lamp = relate(PointLight(position=(3.0, 0.0, -5.0), intensity=(1.0, 1.0, 1.0)), line)
    >>> float(lamp.nearest[0]), float(lamp.across2[0])
    (5.0, 9.0)
    """
    u = lines.direction
    q = np.asarray(light.position)[:, np.newaxis] - lines.origin
    normal = np.cross(q, u, axis=0)
    nearest, across2 = (q * u).sum(axis=0), (normal * normal).sum(axis=0)
    least2 = smallest_d2(light, attenuation)
    # Rounding of the places involved is as good as a smallest distance.
    size = np.abs(q).max(axis=0, initial=0.0) + np.abs(lines.origin).max(axis=0, initial=0.0)
    scale = np.maximum(np.sqrt(across2), np.maximum(max(0.25 * least2 ** 0.5, 1e-150), 1e-14 * size))
    slope = offset = np.zeros_like(nearest)
    if isinstance(light, SpotLight):
        axis = np.asarray(unit(light.direction))[:, np.newaxis]
        slope, offset = (u * axis).sum(axis=0), -(np.cross(u, normal, axis=0) * axis).sum(axis=0)
    with np.errstate(divide="ignore", invalid="ignore"):
        rounding = 8.0 * EPS * size / scale + 4.0 * EPS * np.abs(nearest) / (lines.stop - lines.start)
    rounding = np.where(np.isfinite(rounding), rounding, 0.0)
    return Lamp(light, nearest, across2, scale, least2, rounding, slope, offset)


# --- the lamps' variable ----------------------------------------------------------------------------

# Where the angle hands over to the logarithm, in units of H. Beyond, the fog and the window would be
# squeezed into a thin layer at the end of the angle's range, which a rule of 15 points cannot see.
FAR = 4.0


def to_angle(s: Array, scale: Array, far: NDArray[np.bool_]) -> Array:
    """The variable in which a lamp's light is smooth, increasing with s.

    Parameters
    ----------
    s : ndarray [m]
        Distance along the line from the point nearest to the light.
    scale : ndarray [m]
        H.
    far : ndarray of bool
        Which of two forms.

    Returns
    -------
    ndarray [rad or 1]
        arctan(s/H), or where far, for |s| > H, the logarithm ±ln(|s|/H) with the sign of s.

    Notes
    -----
    Equiangular sampling [Kulla 2012], here as a substitution: ds = (s² + H²)/H dθ cancels the
    inverse square. Far from a light that is near to the line, ds = |s| dx leaves 1/|s| of it.

    Examples
    --------
    >>> near = np.array([False])
    >>> from_angle(to_angle(np.array([3.0]), np.array([2.0]), near), np.array([2.0]), near).round(12).tolist()
    [3.0]
    """
    size = np.abs(s) / scale
    with np.errstate(divide="ignore"):
        logarithm = np.copysign(np.log(size), s)
    return np.where(far, logarithm, np.arctan(s / scale))


def from_angle(x: Array, scale: Array, far: NDArray[np.bool_]) -> Array:
    """The inverse of `to_angle`: s [m]."""
    with np.errstate(over="ignore"):
        return scale * np.where(far, np.copysign(np.exp(np.abs(x)), x), np.tan(x))


def jacobian(s: Array, scale: Array, far: NDArray[np.bool_]) -> Array:
    """ds by the variable of `to_angle` [m]."""
    return np.where(far, np.abs(s), (s * s + scale * scale) / scale)


# --- cuts -------------------------------------------------------------------------------------------


def medium_cuts(paths: Sequence[MediumPath], lines: Lines) -> Array:
    """Cuts [m] where media begin and end, and where height fog starts to fall and has fallen.

    Parameters
    ----------
    paths : sequence of MediumPath
    lines : Lines

    Returns
    -------
    ndarray, shape (n, M)
        Including the lines' start and stop.
    """
    cuts = [lines.start, lines.stop]
    for path in paths:
        cuts += [path.enter, path.leave]
        if path.slope.any():
            cuts += [path.fall_from, path.fall_to]
            with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
                levels = [path.fall_from + (u - path.exponent) / path.slope for u in FALLS]
            cuts += [np.where((t > path.fall_from) & (t < path.fall_to), t, lines.start) for t in levels]
    columns = np.stack(cuts, axis=1)
    # A column that no ray uses is not sorted along.
    used = (columns != lines.start[:, np.newaxis]).any(axis=0)
    used[0] = True
    result: Array = columns[:, used]
    return result


def thickness_cuts(paths: Sequence[MediumPath], extinction: Array, lines: Lines) -> Array:
    """Cuts [m] where the optical depth reaches 2, 16, 128, …: light from behind thick fog is faint.

    Parameters
    ----------
    paths : sequence of MediumPath
    extinction : ndarray, shape (media, C)
    lines : Lines

    Returns
    -------
    ndarray, shape (n, M)
        Rays that do not reach a level have their start there.

    Notes
    -----
    By bisection, of the channel that is dimmed most: of the distance's exponent first, since a mean free
    path may be 1e-22 of the ray, then of the distance. Without these cuts a rule of 15 points could step over
    all that shines, where a fog's mean free path is a small part of an interval.
    """
    reached = optical_depth(paths, extinction, lines.stop)
    total = reached.max(axis=0, initial=0.0)
    least = reached.min(axis=0, initial=0.0) if len(reached) else total
    cuts: list[Array] = []
    level = FIRST_DEPTH
    while (total > level).any() and len(cuts) < 24:
        rows = np.flatnonzero(total > level)
        cut = lines.start.copy()
        cut[rows] = _reached(paths, extinction, lines, rows, level)
        cuts.append(cut)
        if level > LAST_DEPTH and not (extinction.shape[1] > 1 and (least[rows] < level).any()):
            break
        level *= DEPTH_RATIO
    return np.stack(cuts, axis=1) if cuts else np.zeros((len(lines.start), 0))


def _reached(paths: Sequence[MediumPath], extinction: Array, lines: Lines, rows: Integers,
             level: float) -> Array:
    """Where lines that reach an optical depth in some channel do so, to the last digit but one."""
    start, stop = lines.start[rows], lines.stop[rows]
    low, high = SHALLOWEST * (stop - start), stop - start
    for turn in range(60):
        middle = np.sqrt(low) * np.sqrt(high) if turn < 10 else 0.5 * (low + high)
        beyond = optical_depth(paths, extinction, start + middle, rows).max(axis=0) > level
        low, high = np.where(beyond, low, middle), np.where(beyond, middle, high)
    result: Array = start + high
    return result


def lamp_cuts(lamp: Lamp) -> Array:
    """Cuts of a lamp's light, measured from the point nearest to it [m].

    Parameters
    ----------
    lamp : Lamp

    Returns
    -------
    ndarray, shape (n, M)
        The nearest point, where the variable changes,
        the sphere within which the inverse square stops growing, the window's end, and
        a spot light's inner and outer cone; NaN where a line does not meet them.
    """
    cuts = [np.zeros_like(lamp.nearest), -FAR * lamp.scale, FAR * lamp.scale]
    spheres = [lamp.least2]
    if lamp.light.falloff == "windowed":
        spheres.append(lamp.light.radius * lamp.light.radius)
    for square in spheres:
        with np.errstate(invalid="ignore"):
            half = np.sqrt(square - lamp.across2)
        cuts += [-half, half]
    if isinstance(lamp.light, SpotLight):
        for angle in (lamp.light.inner_angle, lamp.light.outer_angle):
            cuts += _cone_roots(lamp, float(np.cos(np.radians(angle))))
    return np.stack(cuts, axis=1)


def _cone_roots(lamp: Lamp, cosine: float) -> list[Array]:
    """Where (s·k + m)² = cos²·(s² + h²); roots on the other nappe do no harm."""
    k, m = lamp.cone_slope, lamp.cone_offset
    a, b = (k - cosine) * (k + cosine), k * m
    c = m * m - cosine * cosine * lamp.across2
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        root = np.sqrt(b * b - a * c)
        q = -(b + np.copysign(root, b))
        first, second = q / a, c / q
    return [np.where(np.isfinite(first), first, np.nan), np.where(np.isfinite(second), second, np.nan)]


def pieces(cuts: Array, low: Array, high: Array,
           keep: Callable[[Integers, Array], NDArray[np.bool_]]) -> tuple[Integers, Array, Array]:
    """The stretches between cuts.

    Parameters
    ----------
    cuts : ndarray, shape (n, M)
        In any order, NaN where there is none.
    low, high : ndarray, shape (n,)
        What to cover.
    keep : callable
        Given rows and the middles of stretches, tells which to keep.

    Returns
    -------
    row : ndarray of int, shape (k,)
        Whose stretch it is; ascending.
    low, high : ndarray, shape (k,)
        Limits, low < high.

    Examples
    --------
    >>> row, low, high = pieces(np.array([[5.0, 1.0, np.nan]]), np.array([0.0]), np.array([2.0]),
    ...                         lambda row, middle: middle > 0.0)
    >>> row.tolist(), low.tolist(), high.tolist()
    ([0, 0], [0.0, 1.0], [1.0, 2.0])
    """
    high = np.maximum(low, high)
    every = np.concatenate([low[:, np.newaxis], np.where(np.isnan(cuts), low[:, np.newaxis], cuts),
                            high[:, np.newaxis]], axis=1)
    every = np.sort(np.minimum(np.maximum(every, low[:, np.newaxis]), high[:, np.newaxis]), axis=1)
    row, column = np.nonzero(every[:, 1:] > every[:, :-1])
    start, stop = every[row, column], every[row, column + 1]
    kept = keep(row, 0.5 * (start + stop))
    return row[kept], start[kept], stop[kept]
