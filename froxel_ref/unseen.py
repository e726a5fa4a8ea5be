"""What the nodes of a rule do not see, and where to split so that they do.

The 15 points of an interval tell how well they are fitted, not what lies between them: the one filled texel
that all of them miss, a face of a cell or a thin layer before the first of them. Each is looked for by what is
known besides the nodes (exact columns of textures, cells' faces, the light at the very ends) and counts
as error, so that the interval is split.
"""

from __future__ import annotations

from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from froxel_ref.bundles import Bundle, parameter, sampling, variable
from froxel_ref.density import density_at
from froxel_ref.integrand import Samples, radiance, samples
from froxel_ref.media import media_at
from froxel_ref.optical_depth import Lines, column
from froxel_ref.quadrature import KRONROD_WEIGHTS, NODES, Pool
from froxel_ref.scene import Medium
from froxel_ref.texture_depth import nearest_face

__all__ = ["hidden_faces", "missed_density", "split_at_cells", "thin_layers"]

Array: TypeAlias = NDArray[np.floating[Any]]
Mask: TypeAlias = NDArray[np.bool_]

EPS = float(np.finfo(np.float64).eps)
GAP = float(NODES[0] + 1.0)  # from an interval's end to the rule's first node, in half lengths
INSET = 1e-9                 # from an interval's end to where its light is looked at, in half lengths
BLUR = 64.0 * EPS            # by which the end of an interval may be off, as a share of the coordinates


def _extrapolation() -> Array:
    """The polynomial through the nodes at both ends, as weights of the nodes, shape (15, 2)."""
    gaps = NODES[:, np.newaxis] - NODES + np.eye(NODES.size)
    ends = np.array([-1.0, 1.0]) - NODES[:, np.newaxis]
    return np.stack([np.prod(np.delete(ends, i, axis=0), axis=0) / np.prod(gaps[i]) for i in range(NODES.size)])


EXTRAPOLATION = _extrapolation()


def thin_layers(bundle: Bundle, source: int, part: Pool, half: Array, values: Array) -> Array:
    """Light before the first and behind the last node that the nodes do not tell of, as an error.

    Parameters
    ----------
    bundle : Bundle
    source : int
        A light; all intervals belong to it.
    part : Pool
        The intervals.
    half : ndarray, shape (n,)
        Half their lengths.
    values : ndarray, shape (3, n, 15)
        The integrand at the nodes.

    Returns
    -------
    ndarray, shape (3, n)

    Notes
    -----
    Behind the edge of a dense medium's shadow the light falls within a mean free path. Between cuts the
    optical depth towards a light has no minimum, so such a layer lies at an end; what is there, less what the
    polynomial through the nodes has there, times the width of the gap, bounds what was missed.
    """
    middle = 0.5 * (part.low + part.high)
    low, high = parameter(bundle, part, part.low), parameter(bundle, part, part.high)
    size = np.abs(bundle.lines.origin[:, part.owner]).max(axis=0, initial=0.0) + np.abs(low) + np.abs(high)
    with np.errstate(divide="ignore", invalid="ignore"):
        inset = INSET + BLUR * (size / (high - low) + (np.abs(part.low) + np.abs(part.high)) / half)
    clear = inset < 0.5 * GAP  # narrower intervals end where rounding decides
    reach = half * (1.0 - np.where(clear, inset, GAP))
    x = np.stack([middle - reach, middle + reach], axis=1)
    ends = radiance(bundle, samples(bundle, source, part, x))
    with np.errstate(over="ignore", invalid="ignore"):
        jump = np.abs(ends - values @ EXTRAPOLATION).max(axis=-1)
    result: Array = np.where(clear, GAP * half * jump, 0.0)
    return result


def missed_density(bundle: Bundle, at: Samples, part: Pool, half: Array) -> Array:
    """The light of density that lies between the nodes, as an error.

    Parameters
    ----------
    bundle : Bundle
    at : Samples
        The nodes.
    part : Pool
        Their intervals.
    half : ndarray, shape (n,)
        Half their lengths.

    Returns
    -------
    ndarray, shape (3, n)

    Notes
    -----
    The column of a textured medium over an interval is known exactly. What the rule makes of its density
    differs from it by a length, which times the most light that one such length sends is what is missed.
    """
    error = np.zeros((3, len(half)))
    for k, placed in enumerate(bundle.physics.media):
        if placed.texture is None or not bundle.physics.active[k]:
            continue
        ends = np.stack([parameter(bundle, part, part.low), parameter(bundle, part, part.high)], axis=1)
        path = bundle.paths[k]
        rows = np.flatnonzero((ends[:, 1] > path.enter[part.owner]) & (ends[:, 0] < path.leave[part.owner]))
        if not rows.size:
            continue
        points = (at.points[0][rows], at.points[1][rows], at.points[2][rows])
        density, _ = density_at(placed, points, **sampling(bundle.physics))
        stretch = np.broadcast_to(at.stretch, at.t.shape)[rows]
        exact = column(path, ends[rows], part.owner[rows])
        missed = np.abs(half[rows] * ((density * stretch) @ KRONROD_WEIGHTS) - (exact[:, 1] - exact[:, 0]))
        missed = np.maximum(missed - 16.0 * EPS * exact[:, 1], 0.0)
        error[:, rows] += missed * _most_light(bundle, at, rows, placed.medium)
    return error


def _most_light(bundle: Bundle, at: Samples, rows: NDArray[np.integer[Any]], medium: Medium) -> Array:
    """The most that a metre of a medium at density 1 sends from any node of the intervals, (3, n)."""
    physics = bundle.physics
    plain = Medium(albedo=medium.albedo, extinction=medium.extinction, emissive=medium.emissive,
                   phase_anisotropy=medium.phase_anisotropy)
    points = (at.points[0][rows], at.points[1][rows], at.points[2][rows])
    there = Samples(at.source, at.rows[rows], at.t[rows], points, at.s[rows], np.ones((1, 1)),
                    at.passing[:, rows])
    light = radiance(bundle, there, media_at((plain,), points, {}, physics.settings))
    most: Array = np.broadcast_to(light, (3, *there.t.shape)).max(axis=-1)
    return most


# --- faces of cells ---------------------------------------------------------------------------------


def split_at_cells(bundle: Bundle, pool: Pool) -> Array:
    """Where to split intervals: at the face of a texture's cell nearest to the middle, else in the middle.

    Parameters
    ----------
    bundle : Bundle
    pool : Pool
        Intervals of any sources.

    Returns
    -------
    ndarray, shape (n,)
        In each interval's own variable; NaN for the middle.

    Notes
    -----
    The light has a kink at every face. Cutting there first would cost an interval for each cell, a hundred
    a ray; cutting there only where the error asks for it converges as fast.
    """
    middle = 0.5 * (pool.low + pool.high)
    result = np.full(middle.shape, np.nan)
    textured = [k for k, placed in enumerate(bundle.physics.media) if placed.texture is not None]
    if not textured:
        return result
    t = parameter(bundle, pool, middle)
    for k in textured:
        placed, path = bundle.physics.media[k], bundle.paths[k]
        rows = np.flatnonzero((t > path.enter[pool.owner]) & (t < path.leave[pool.owner]))
        lines = Lines._make(field[..., pool.owner[rows]] for field in bundle.lines)
        face = nearest_face(placed, lines, t[rows], **sampling(bundle.physics))
        result[rows] = variable(bundle, pool.take(rows), face)
    return result


def hidden_faces(bundle: Bundle, pool: Pool, half: Array) -> Mask:
    """Intervals with a cell's face between an end and the first node, where no value tells of its kink."""
    result: Mask = np.zeros(half.shape, bool)
    for k, placed in enumerate(bundle.physics.media):
        if placed.texture is None:
            continue
        for end, inward in ((pool.low, GAP), (pool.high, -GAP)):
            a, b = (parameter(bundle, pool, x) for x in (end, end + inward * half))
            path = bundle.paths[k]
            rows = np.flatnonzero((b > path.enter[pool.owner]) & (b < path.leave[pool.owner]))
            a, b = a[rows], b[rows]
            lines = Lines._make(field[..., pool.owner[rows]] for field in bundle.lines)
            face = nearest_face(placed, lines, 0.5 * (a + b), **sampling(bundle.physics))
            with np.errstate(invalid="ignore", divide="ignore"):
                share = (face - a) / (b - a)
            result[rows] |= (share > 1e-6) & (share < 1.0)
    return result
