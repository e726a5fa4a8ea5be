"""Where the shadows of media break along rays: edges and corners, planes of height fog, cells of textures.

A ray and its ways to a light lie in one plane, the *sheet*. A medium cuts a polygon or an ellipse out of it,
the planes of its height fog are lines in it, and so is the end of the ways to a sun. The optical depth
towards the light is smooth along the ray but where a way meets a corner of that drawing, or touches the
ellipse. All corners are found in closed form. A texture has too many of them; its shadow is cut into pieces
of two cells, of which a rule of 15 points sees every one.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from froxel_ref.breaks import Lamp
from froxel_ref.density import Placed
from froxel_ref.geometry import transform_points
from froxel_ref.light_paths import ways_to_light
from froxel_ref.lights import unit
from froxel_ref.optical_depth import Lines, support
from froxel_ref.records import InputError
from froxel_ref.scene import DirectionalLight, Light, LocalMedium
from froxel_ref.texture_depth import MOST_CELLS, texel_steps

__all__ = ["shadow_cuts"]

Array: TypeAlias = NDArray[np.floating[Any]]
Mask: TypeAlias = NDArray[np.bool_]

# Cells of a texture in a piece of its shadow. A single texel reaches into two on each axis, so that it is met by
# as many nodes as a rule needs to tell that it is rough; larger pieces are bisected to about these anyway.
CELLS = 2.0
PLACES = 33     # where along a shadow it is measured how fast the ways sweep over cells
SLACK = 1e-12   # of the coordinates, when corners are told from points outside


class _Sheet(NamedTuple):
    """Points base + v·along + w·across of the plane of each ray and a light, in a medium's space.

    A sun: base and along are the ray's, across leads to the light, 0 ≤ w ≤ most, t = v. A lamp: base is its
    place, base + across the ray's origin, 0 < w ≤ most = 1, t = v/w.
    """

    base: Array
    along: Array
    across: Array
    most: float
    lamp: bool

    def parameter(self, v: Array, w: Array, valid: Mask | bool = True) -> Array:
        """t on the ray of points; NaN of those that no way reaches."""
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            t = v / w if self.lamp else v
            reached = valid & (w > 0.0) & (w <= self.most * (1.0 + SLACK)) & np.isfinite(t)
        return np.where(reached, t, np.nan)


def shadow_cuts(media: Sequence[Placed], extinction: Array, light: Light, lines: Lines, *,
                lamp: Lamp | None = None, sun_distance: float = np.inf, time: float = 0.0) -> Array:
    """Cuts [m] where the media's dimming of a light breaks along rays.

    Parameters
    ----------
    media : sequence of Placed
        All media.
    extinction : ndarray, shape (media, C) [1/m]
        Those of 0 cast no shadow.
    light : Light
        Any light.
    lines : Lines
        The rays, with directions of length 1 and finite stops.
    lamp : Lamp, optional
        How the rays see a lamp; textures' shadows are cut only within its window.
    sun_distance : float [m]
        Length of the way to a directional light.
    time : float [s]
        Moves scrolling textures.

    Returns
    -------
    ndarray, shape (n, M)
        In any order; NaN where a ray has none. Where the ray itself meets a medium is not among them.

    Raises
    ------
    InputError
        A ray's ways to the light sweep over more than 20000 cells of a texture.

    Notes
    -----
    A chord through a box is as long as the difference of two planes' distances, linear in t for a sun: it
    bends where a way passes an edge, that is at a corner of the polygon. Height fog adds the planes at its
    start and its ceiling to those of the box. The chord through an ellipsoid has a root's edge where the way
    touches it, |X × l| = |l| with X the point and l the way in local space.

    Examples
    --------
    >>> from froxel_ref.density import place
    >>> from froxel_ref.scene import Transform
    >>> ball = place(LocalMedium(shape="ellipsoid", transform=Transform(translate=(0.0, 6.0, -5.0))))
    >>> ray = Lines(np.zeros((3, 1)), np.array([[0.0], [0.0], [-1.0]]), np.zeros(1), np.array([9.0]))
    >>> sun = DirectionalLight(direction=(0, 1, 0), irradiance=(1, 1, 1))
    >>> shadow_cuts([ball], np.ones((1, 1)), sun, ray).round(12).tolist()
    [[6.0, 4.0, 5.0]]
    """
    columns: list[Array] = []
    for placed, factors in zip(media, extinction, strict=True):
        if not factors.any():
            continue
        cuts = _cuts(placed, _sheet(placed, light, lines, sun_distance))
        columns += cuts
        if placed.texture is not None:
            columns += _texture_cuts(placed, light, lines, cuts, lamp, sun_distance, time)
    if not columns:
        return np.zeros((lines.start.size, 0))
    whole = np.stack(columns, axis=1)
    whole = np.where((whole > lines.start[:, np.newaxis]) & (whole < lines.stop[:, np.newaxis]), whole, np.nan)
    result: Array = whole[:, ~np.isnan(whole).all(axis=0)]
    return result


def _sheet(placed: Placed, light: Light, lines: Lines, sun_distance: float) -> _Sheet:
    matrix = np.eye(4) if placed.local_from_world is None else placed.local_from_world

    def local(vectors: Array, directions: bool = False) -> Array:
        x, y, z = (np.asarray(c, np.float64) for c in vectors)
        return np.stack(np.broadcast_arrays(*transform_points(matrix, (x, y, z), directions=directions)))

    origin, along = local(lines.origin), local(lines.direction, True)
    if isinstance(light, DirectionalLight):
        towards = local(np.asarray(unit(light.direction))[:, np.newaxis], True)
        return _Sheet(origin, along, np.broadcast_to(towards, along.shape), sun_distance, False)
    place = np.asarray(light.position)[:, np.newaxis]
    base = np.broadcast_to(local(place), along.shape)
    return _Sheet(base, along, local(lines.origin - place, True), 1.0, True)


def _cuts(placed: Placed, sheet: _Sheet) -> list[Array]:
    """The corners of what a medium draws on the sheet, but for those on the ray."""
    medium, fog = placed.medium, placed.medium.height_fog
    heights = [] if fog is None else [fog.start] * (fog.falloff > 0.0)
    heights += [] if fog is None or fog.max_height is None else [fog.max_height]
    if not isinstance(medium, LocalMedium):
        return [_end_at(sheet, 1, height) for height in heights if np.isfinite(sheet.most) and not sheet.lamp]
    levels = [2.0 * height - 1.0 for height in heights if 0.0 < height < 1.0]
    if medium.shape == "ellipsoid":
        return _ellipse_cuts(sheet, levels)
    return _polygon_cuts(sheet, ([-1.0, 1.0], [-1.0, *levels, 1.0], [-1.0, 1.0]))


# --- boxes, and planes of height fog ----------------------------------------------------------------


def _end_at(sheet: _Sheet, axis: int, level: float) -> Array:
    """Where the far end of the ways to a sun crosses a plane across an axis."""
    w = np.full(sheet.base.shape[1], sheet.most)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        v = (level - sheet.base[axis] - sheet.most * sheet.across[axis]) / sheet.along[axis]
    return sheet.parameter(v, w)


def _polygon_cuts(sheet: _Sheet, levels: Sequence[Sequence[float]]) -> list[Array]:
    """Corners of the lines in which planes across the axes cut the sheet, within the box [−1, 1]³."""
    a, b, base = sheet.along, sheet.across, sheet.base
    cuts = []
    with np.errstate(all="ignore"):
        for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
            over = 1.0 / (a[i] * b[j] - a[j] * b[i])
            for p, q in itertools.product(levels[i], levels[j]):
                p, q = p - base[i], q - base[j]
                v, w = (p * b[j] - q * b[i]) * over, (a[i] * q - a[j] * p) * over
                cuts.append(sheet.parameter(v, w, _within(sheet, k, v, w)))
            if np.isfinite(sheet.most) and not sheet.lamp:
                for level in levels[i]:
                    v = _end_at(sheet, i, level)
                    w = np.full(v.shape, sheet.most)
                    cuts.append(sheet.parameter(v, w, _within(sheet, j, v, w) & _within(sheet, k, v, w)))
    return cuts


def _within(sheet: _Sheet, axis: int, v: Array, w: Array) -> Mask:
    """Whether points of the sheet lie between −1 and 1 on an axis."""
    along, across = sheet.along[axis] * v, sheet.across[axis] * w
    slack = SLACK * (np.abs(sheet.base[axis]) + np.abs(along) + np.abs(across))
    return np.asarray(np.abs(sheet.base[axis] + along + across) <= 1.0 + slack)


# --- ellipsoids -------------------------------------------------------------------------------------


def _ellipse_cuts(sheet: _Sheet, levels: Sequence[float]) -> list[Array]:
    """Where ways touch the unit sphere, the middle between, and the corners with planes across y."""
    edges = _tangents(sheet)
    cuts = [*edges, 0.5 * (edges[0] + edges[1])]
    for level in levels:
        cuts += _chord_ends(sheet, *_level_line(sheet, level))
    if np.isfinite(sheet.most) and not sheet.lamp:
        zero, one = np.zeros(sheet.base.shape[1]), np.ones(sheet.base.shape[1])
        cuts += _chord_ends(sheet, zero, sheet.most * one, one, zero)
        for level in levels:
            v = _end_at(sheet, 1, level)
            inside = np.square(sheet.base + v * sheet.along + sheet.most * sheet.across).sum(axis=0) < 1.0
            cuts.append(np.where(inside, v, np.nan))
    return cuts


def _tangents(sheet: _Sheet) -> list[Array]:
    """Both t whose way touches the unit sphere."""
    a, b, base = sheet.along, sheet.across, sheet.base
    if sheet.lamp:  # |A × D| = |D|, A the lamp and D = b + t·a
        u, v, f, g = _cross(base, b), _cross(base, a), b, a
    else:           # |X × b| = |b|, X = base + t·a
        u, v, f, g = _cross(base, b), _cross(a, b), b, np.zeros_like(a)
    size_u, size_f = np.sqrt(_dot(u, u)), np.sqrt(_dot(f, f))
    roots = _roots(_dot(v, v) - _dot(g, g), _dot(u, v) - _dot(f, g), (size_u - size_f) * (size_u + size_f))
    result = []
    for t in roots:
        way = b + t * a if sheet.lamp else b
        start = base if sheet.lamp else base + t * a
        with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
            w = -_dot(start, way) / _dot(way, way)
        result.append(sheet.parameter(t * w if sheet.lamp else t, w))
    return result


def _level_line(sheet: _Sheet, level: float) -> tuple[Array, Array, Array, Array]:
    """The line of the sheet at a height: (v, w) of a point, and its direction."""
    a, b = sheet.along[1], sheet.across[1]
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        share = (level - sheet.base[1]) / (a * a + b * b)
    return share * a, share * b, b, -a


def _chord_ends(sheet: _Sheet, v: Array, w: Array, dv: Array, dw: Array) -> list[Array]:
    """Where a line of the sheet, (v, w) + x·(dv, dw), meets the unit sphere."""
    point = sheet.base + v * sheet.along + w * sheet.across
    step = dv * sheet.along + dw * sheet.across
    roots = _roots(_dot(step, step), _dot(point, step), _dot(point, point) - 1.0)
    return [sheet.parameter(v + x * dv, w + x * dw) for x in roots]


def _roots(a: Array, b: Array, c: Array) -> list[Array]:
    """Of a·x² + 2b·x + c, NaN where there is none."""
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        q = -(b + np.copysign(np.sqrt(b * b - a * c), b))
        roots = [q / a, c / q]
    return [np.where(np.isfinite(root), root, np.nan) for root in roots]


def _cross(a: Array, b: Array) -> Array:
    return np.stack([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])


def _dot(a: Array, b: Array) -> Array:
    result: Array = (a * b).sum(axis=0)
    return result


# --- textures ---------------------------------------------------------------------------------------


def _texture_cuts(placed: Placed, light: Light, lines: Lines, cuts: Sequence[Array], lamp: Lamp | None,
                  sun_distance: float, time: float) -> list[Array]:
    """Pieces of a textured medium's shadow in which the ways sweep over at most 2 cells."""
    low, high = _shadow(placed, light, lines, cuts, sun_distance)
    if lamp is not None and lamp.light.falloff == "windowed":
        reach = np.sqrt(np.maximum(lamp.light.radius ** 2 - lamp.across2, 0.0))
        low, high = np.maximum(low, lamp.nearest - reach), np.minimum(high, lamp.nearest + reach)
    live = np.flatnonzero(low < high)
    if not live.size:
        return []
    part = Lines._make(field[..., live] for field in lines)
    t = low[live, np.newaxis] + (high - low)[live, np.newaxis] * np.linspace(0.0, 1.0, PLACES)
    speed = _sweep(placed, light, part, t, sun_distance, time)
    # Between two places the faster of both counts.
    steps = np.maximum(speed[:, 1:], speed[:, :-1]) * np.diff(t, axis=1)
    swept = np.concatenate([np.zeros((live.size, 1)), np.cumsum(steps, axis=1)], axis=1)
    if not swept.max() <= MOST_CELLS:
        raise InputError("density.scale", f"makes a ray's ways to a light sweep over {swept.max():.0f} cells, "
                                          f"must be at most {MOST_CELLS}")
    found = _evenly(swept, t)
    result = np.full((lines.start.size, found.shape[1]), np.nan)
    result[live] = found
    return list(result.T)


def _shadow(placed: Placed, light: Light, lines: Lines, cuts: Sequence[Array],
            sun_distance: float) -> tuple[Array, Array]:
    """The stretch of each ray whose ways meet a medium; low > high where there is none."""
    low, high = np.full(lines.start.shape, np.inf), np.full(lines.start.shape, -np.inf)
    # Where the ray itself meets it belongs to the shadow too.
    enter, leave = support(placed, lines)
    own = np.where(leave > enter, 0.0, np.nan)
    for t in (*cuts, enter + own, leave + own):
        low, high = np.fmin(low, t), np.fmax(high, t)
    for t in (lines.start, lines.stop):
        ways = ways_to_light(light, lines.origin + lines.direction * t, sun_distance)
        enter, leave = support(placed, ways)
        low, high = np.where(leave > enter, np.minimum(low, t), low), np.where(leave > enter, np.maximum(high, t), high)
    return np.maximum(low, lines.start), np.minimum(high, lines.stop)


def _sweep(placed: Placed, light: Light, lines: Lines, t: Array, sun_distance: float, time: float) -> Array:
    """Cells that ways to a light sweep over, per metre of the ray, at places (n, m)."""
    points = (lines.origin[:, :, np.newaxis] + lines.direction[:, :, np.newaxis] * t).reshape(3, -1)
    ways = ways_to_light(light, points, sun_distance)
    along = np.repeat(texel_steps(placed, lines, time), t.shape[1], axis=1)
    towards = texel_steps(placed, ways, time)
    size = np.sqrt(_dot(towards, towards))
    across = _cross(along, towards)
    with np.errstate(invalid="ignore", divide="ignore"):
        speed = np.where(size > 0.0, np.sqrt(_dot(across, across)) / size, np.sqrt(_dot(along, along)))
        if not isinstance(light, DirectionalLight):
            # What is nearer to a lamp moves more slowly.
            enter, leave = support(placed, ways)
            speed = speed * np.where(leave > enter, 1.0 - enter / ways.stop, 1.0)
    return speed.reshape(t.shape)


def _evenly(swept: Array, t: Array) -> Array:
    """Where to cut lines so that every piece sweeps over at most 2 cells; NaN where there is no need."""
    pieces = np.maximum(np.ceil(swept[:, -1] / CELLS), 1.0)
    number = np.arange(1.0, pieces.max(initial=1.0))
    wanted = swept[:, -1:] * (number / pieces[:, np.newaxis])
    before = np.minimum((swept[:, np.newaxis] <= wanted[..., np.newaxis]).sum(axis=2) - 1, swept.shape[1] - 2)
    row = np.arange(len(t))[:, np.newaxis]
    with np.errstate(invalid="ignore", divide="ignore"):
        share = (wanted - swept[row, before]) / (swept[row, before + 1] - swept[row, before])
    cut = t[row, before] + share * (t[row, before + 1] - t[row, before])
    return np.where(number < pieces[:, np.newaxis], cut, np.nan)
