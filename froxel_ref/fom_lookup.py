"""How points look themselves up in a light's opacity map: what the media and particles let through."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from froxel_ref.arrays import Field, Points, Sight
from froxel_ref.fom import optical_depth
from froxel_ref.fom_resolved import resolve, resolved_depth
from froxel_ref.shadow_lookup import octahedral_square
from froxel_ref.shadow_views import CASCADE_EDGE

__all__ = ["OpacityMap", "Reading", "cascade_sight", "lamp_sight", "pairs_of", "planes_of"]

Integers: TypeAlias = NDArray[np.intp]
Matrix: TypeAlias = NDArray[np.float64]
Decode: TypeAlias = Callable[[Field, Field], Field]
Fetch: TypeAlias = Callable[[Field, Integers, Field], Field]

TINY = 1e-30


class Reading(NamedTuple):
    """How optical depth is read from texels' numbers.

    Attributes
    ----------
    depth : callable
        From numbers, shape (channels, …), and depths in the texels' ranges to optical depth, finite and at least 0 but
        for what rings.
    fetch : callable or None
        The same from a map, shape (channels, texels), and texels' indices, where few of their numbers are read.
    each : bool
        Whether each of a lamp's four texels is read, and the optical depths filtered; else their numbers are filtered
        first, since all share one range.
    """

    depth: Decode
    fetch: Fetch | None
    each: bool

    def at(self, flat: Field, texel: Integers, depth: Field) -> Field:
        """Optical depth of some texels."""
        return self.depth(flat.take(texel, axis=1), depth) if self.fetch is None else self.fetch(flat, texel, depth)


class OpacityMap(NamedTuple):
    """One light's map.

    Attributes
    ----------
    kind : {"spot", "octahedral", "directional"}
    coefficients : Field, shape (faces, channels, size, size) [1]
        a_0, b_0, a_1, b_1, …, or another technique's numbers; one face for lamps.
    near, far : Field, shape (faces, size, size), or broadcastable [m]
        The depths that 0 and 1 stand for; nothing dims where far ≤ near.
    matrix : ndarray, shape (faces, 3, 4)
        As in `froxel_ref.shadow.Stack`.
    gutter : int [texels]
        Around the map.
    resolved : Field, shape (faces, 7(K + 1), size, size), or None
        From `froxel_ref.fom_resolved.resolve`, for the reconstruction of that name; made here unless given.
    """

    kind: str
    coefficients: Field
    near: Field
    far: Field
    matrix: Matrix
    gutter: int = 0
    resolved: Field | None = None

    @property
    def without_ringing(self) -> Field:
        """The coefficients resolved."""
        if self.resolved is not None:
            return self.resolved
        return np.stack([resolve(pairs_of(planes)) for planes in self.coefficients])


def planes_of(coefficients: Field) -> Field:
    """Coefficients as their two textures' channels hold them, one behind the other.

    Parameters
    ----------
    coefficients : Field, shape (2, K + 1, …)
        From `froxel_ref.fom`.

    Returns
    -------
    Field, shape (2K + 2, …)
        a_0, b_0, a_1, b_1, … [Dörries 2020, listing 3.16].

    Examples
    --------
    >>> planes_of(np.array([[1.0, 2.0], [3.0, 4.0]])).tolist()
    [1.0, 3.0, 2.0, 4.0]
    """
    return np.asarray(coefficients.swapaxes(0, 1).reshape(-1, *coefficients.shape[2:]))


def pairs_of(planes: Field) -> Field:
    """The inverse of `planes_of`.

    Parameters
    ----------
    planes : Field, shape (2K + 2, …)

    Returns
    -------
    Field, shape (2, K + 1, …)

    Examples
    --------
    >>> pairs_of(np.array([1.0, 3.0, 2.0, 4.0])).tolist()
    [[1.0, 2.0], [3.0, 4.0]]
    """
    return planes.reshape(-1, 2, *planes.shape[1:]).swapaxes(0, 1)


class Corners(NamedTuple):
    """The four texels around points, and their shares: flat indices and weights, one array each."""

    texel: Sequence[Integers]
    weight: Sequence[Field]


def _corners(x: Field, y: Field, size: int, first: Integers | int = 0) -> Corners:
    """What a bilinear lookup reads; beyond the outermost centres the edge's texels. ``first`` is the face's index."""
    edge = np.asarray(size - 2, x.dtype)
    column, row = (np.minimum(np.maximum(np.floor(v - 0.5), 0.0), edge) for v in (x, y))
    right, down = (np.minimum(np.maximum(v - 0.5 - low, 0.0), 1.0) for v, low in ((x, column), (y, row)))
    index = (row * size + column).astype(np.intp) + first
    return Corners([index, index + 1, index + size, index + size + 1],
                   [(1.0 - right) * (1.0 - down), right * (1.0 - down), (1.0 - right) * down, right * down])


def _filtered(planes: Field, corners: Corners) -> Field:
    """Bilinearly filtered planes, shape (channels, …)."""
    flat = planes.reshape(len(planes), -1)
    result = np.zeros((len(planes), *corners.weight[0].shape), planes.dtype)
    for index, weight in zip(corners.texel, corners.weight, strict=True):
        for plane, channel in zip(flat, result, strict=True):
            channel += plane.take(index) * weight
    return result


def _share(t: Field, near: Field, far: Field) -> Field:
    """Depths as shares of their range, in [0, 1]; 0 where the range is empty."""
    width = far - near
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        return np.where(width > 0.0, np.minimum(np.maximum((t - near) / width, 0.0), 1.0), 0.0).astype(t.dtype)


def _passed(depth: Field) -> Field:
    """exp(−depth), no more than 1."""
    with np.errstate(under="ignore", over="ignore"):
        return np.asarray(np.minimum(np.exp(-depth), 1.0))


def _reading(reconstruction: str) -> Reading:
    """From Fourier coefficients, or what is resolved of them."""
    if reconstruction == "resolved":
        return Reading(resolved_depth, None, each=True)
    return Reading(lambda planes, depth: optical_depth(pairs_of(planes), depth, lanczos=reconstruction == "lanczos"),
                   None, each=False)


def _read(planes: Field, corners: Corners, depth: Field, reading: Reading) -> Field:
    """Optical depth from each of the four texels, then filtered: of what is not linear in what is stored."""
    flat = planes.reshape(len(planes), -1)
    total = np.zeros_like(depth)
    for texel, weight in zip(corners.texel, corners.weight, strict=True):
        total += weight * reading.at(flat, texel, depth)
    return total


# --- lamps ------------------------------------------------------------------------------------------


def lamp_sight(opacity_map: OpacityMap, *, reconstruction: str = "fourier", octahedron: str = "from_light",
               reading: Reading | None = None) -> Sight:
    """What media and particles let through of a lamp's light.

    Parameters
    ----------
    opacity_map : OpacityMap
        Of a spot light or an octahedron, its range one number.
    reconstruction : {"fourier", "lanczos", "resolved"}
        How transmittance is read from coefficients.
    octahedron : {"from_light", "to_light"}
        What an octahedral map's directions are (A9).
    reading : Reading, optional
        How another technique's numbers are read; ``reconstruction`` has no meaning then.

    Returns
    -------
    callable
        From points to transmittance in [0, 1].

    Notes
    -----
    Coefficients are filtered bilinearly, which filters optical depth, since all texels share one range; then
    `froxel_ref.fom.transmittance` at the distance from the light. Filtered moments are those of the mean of what lies
    on the four rays. "resolved" finds each texel's extinction first
    (`froxel_ref.fom_resolved`), and filters the optical depths of the four. Beyond the map's depths the nearest is
    taken.

    Examples
    --------
    >>> planes = np.zeros((1, 8, 4, 4)); planes[:, 0] = 2.0
    >>> origin = np.eye(3, 4)[np.newaxis]
    >>> see = lamp_sight(OpacityMap("octahedral", planes, np.zeros(1), np.full(1, 10.0), origin))
    >>> float(see((np.array(5.0), np.array(0.0), np.array(0.0))).round(6))  # half way: e^−½
    0.606531
    """
    planes, plain = opacity_map.coefficients[0], reading is None
    resolved = plain and reconstruction == "resolved"
    read = reading or _reading(reconstruction)
    near, far = float(opacity_map.near.flat[0]), float(opacity_map.far.flat[0])
    alike = bool((planes == planes[:, :1, :1]).all())
    if not far > near or (alike and not planes.any()):
        return _clear
    if resolved:
        planes = opacity_map.without_ringing[0]
    origin = _origin(opacity_map.matrix[0])
    if alike:  # nothing varies with direction
        few = planes[:2] if plain and not (resolved or planes[2:].any()) else planes
        return lambda points, normal=None: _passed(read.depth(
            few[:, 0, 0].reshape(-1, *(1,) * points[0].ndim),
            _share(_away(origin, points)[1], np.asarray(near), np.asarray(far))))
    sign = 1.0 if octahedron == "from_light" else -1.0
    locate = (partial(_on_octahedron, sign=sign, size=planes.shape[-1], gutter=opacity_map.gutter)
              if opacity_map.kind == "octahedral" else
              partial(_on_plane, matrix=opacity_map.matrix[0], size=planes.shape[-1]))

    def see(points: Points, normal: Points | None = None) -> Field:
        away, distance = _away(origin, points)
        shape = distance.shape
        x, y = locate(away)
        corners = _corners(x.reshape(-1), y.reshape(-1), planes.shape[-1])
        depth = _share(distance.reshape(-1), np.asarray(near), np.asarray(far))
        tau = _read(planes, corners, depth, read) if read.each else read.depth(_filtered(planes, corners), depth)
        return _passed(tau).reshape(shape)

    return see


def _clear(points: Points, normal: Points | None = None) -> Field:
    """Nothing dims."""
    return np.ones((1,) * points[0].ndim, np.result_type(*points))


def _origin(matrix: Matrix) -> Matrix:
    """Where a lamp is."""
    return np.asarray(np.linalg.solve(matrix[:, :3], -matrix[:, 3]), np.float64)


def _away(origin: Matrix, points: Points) -> tuple[Points, Field]:
    """Vectors from the lamp, and their lengths."""
    x, y, z = (p - o for p, o in zip(points, origin.tolist(), strict=True))
    return (x, y, z), np.sqrt(x * x + y * y + z * z)


def _on_octahedron(away: Points, *, sign: float, size: int, gutter: int) -> tuple[Field, Field]:
    half = 0.5 * (size - 2 * gutter)
    x, y, z = away
    shape = np.broadcast_shapes(x.shape, y.shape, z.shape)
    u, v = octahedral_square(*(sign * np.broadcast_to(c, shape) for c in (x, y, z)))
    return u * half + 0.5 * size, v * half + 0.5 * size


def _on_plane(away: Points, *, matrix: Matrix, size: int) -> tuple[Field, Field]:
    x, y, z = away
    u, v, depth = (a * x + b * y + c * z for a, b, c in matrix[:, :3].tolist())
    over = 1.0 / np.maximum(depth, TINY)
    limit = 4.0 * size
    with np.errstate(over="ignore"):  # points beside or behind the light, where it does not shine
        return np.clip(u * over, -limit, limit), np.clip(v * over, -limit, limit)


# --- suns -------------------------------------------------------------------------------------------


def cascade_sight(opacity_map: OpacityMap, *, reconstruction: str = "fourier", lookup: str = "per_texel",
                  reading: Reading | None = None) -> Sight:
    """What local media and particles let through of a sun's light.

    Parameters
    ----------
    opacity_map : OpacityMap
        A directional light's.
    reconstruction : {"fourier", "lanczos", "resolved"}
        As for `lamp_sight`.
    lookup : {"per_texel", "filtered"}
        Each of the four texels read by its own range and the optical depths filtered; or the coefficients and the
        ranges filtered first, as a texture unit does it (S3). What is resolved is always read by texel.
    reading : Reading, optional
        As for `lamp_sight`.

    Returns
    -------
    callable
        From points to transmittance in [0, 1]; 1 outside all cascades, and where no medium lies on the ray.

    Notes
    -----
    A coefficient means nothing without its range: coefficients of different ranges have no mean. Texels with
    nothing on their ray count as clear.

    Examples
    --------
    >>> planes = np.zeros((1, 8, 4, 4)); planes[:, 0] = 2.0
    >>> matrix = np.array([[[1.0, 0, 0, 2], [0, 0, 1, 2], [0, -1, 0, 0]]])
    >>> ends = [np.full((1, 4, 4), t) for t in (-5.0, 5.0)]
    >>> see = cascade_sight(OpacityMap("directional", planes, *ends, matrix))
    >>> x = np.zeros(3)
    >>> see((x, np.array([9.0, 0.0, -9.0]), x)).round(6).tolist()
    [1.0, 0.606531, 0.367879]
    """
    faces, _, size, _ = opacity_map.coefficients.shape
    planes = np.ascontiguousarray(opacity_map.coefficients.swapaxes(0, 1))  # once, and not by every lookup
    near, far = (np.broadcast_to(end, (faces, size, size)).reshape(-1) for end in (opacity_map.near, opacity_map.far))
    if not (far > near).any():
        return _clear
    resolved = reading is None and reconstruction == "resolved"
    how, read = reading or _reading(reconstruction), _each if lookup == "per_texel" or resolved else _together
    if resolved:
        planes = np.ascontiguousarray(opacity_map.without_ringing.swapaxes(0, 1))

    def see(points: Points, normal: Points | None = None) -> Field:
        shape = np.broadcast_shapes(*(p.shape for p in points))
        places = [np.broadcast_to(p, shape).reshape(-1) for p in points]
        result = np.ones(places[0].shape, places[0].dtype)
        waiting = np.arange(len(result))
        for face in range(faces):
            x, y, t = (a * places[0][waiting] + b * places[1][waiting] + c * places[2][waiting] + d
                       for a, b, c, d in opacity_map.matrix[face].tolist())
            reach = CASCADE_EDGE * (0.5 * size - opacity_map.gutter)
            inside = (np.abs(x - 0.5 * size) < reach) & (np.abs(y - 0.5 * size) < reach)
            if inside.any():
                corners = _corners(x[inside], y[inside], size, face * size * size)
                result[waiting[inside]] = _passed(read(planes, near, far, corners, t[inside], how))
            waiting = waiting[~inside]
            if not waiting.size:
                break
        return result.reshape(shape)

    return see


def _each(planes: Field, near: Field, far: Field, corners: Corners, t: Field, reading: Reading) -> Field:
    """Optical depth from each texel by its own range, then filtered."""
    flat = planes.reshape(len(planes), -1)
    total = np.zeros_like(t)
    for index, weight in zip(corners.texel, corners.weight, strict=True):
        begin, end = near.take(index), far.take(index)
        behind = np.flatnonzero((end > begin) & (t > begin))
        if behind.size:
            some = index[behind]
            depth = _share(t[behind], begin[behind], end[behind])
            total[behind] += weight[behind] * reading.at(flat, some, depth)
    return total


def _together(planes: Field, near: Field, far: Field, corners: Corners, t: Field, reading: Reading) -> Field:
    """Coefficients and ranges filtered first; texels with nothing on their ray have no range and do not count."""
    dtype = t.dtype
    there = np.where(far > near, 1.0, 0.0).astype(dtype)
    ends = np.stack([there, np.where(far > near, near, 0.0), np.where(far > near, far, 0.0)]).astype(dtype)
    weight, begin, end = _filtered(ends, corners)
    with np.errstate(divide="ignore", invalid="ignore"):
        begin, end = begin / weight, end / weight
    depth = _share(t, begin, end)
    return reading.depth(_filtered(planes, corners), np.where(weight > 0.0, depth, 0.0))
