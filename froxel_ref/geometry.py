"""Matrices, camera rays and points in space, in compact axes.

Conventions (CONVENTIONS.md): right-handed world, +y up; view space looks down −z; **view depth** is −z,
positive and planar. Matrices are 4×4 for column vectors, named ``target_from_source``. A ray's parameter
is its view depth, so points on it are origin + per_depth·depth and no square root is needed to place them.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import DTypeLike, NDArray

from froxel_ref.arrays import Field, Points
from froxel_ref.scene import Camera

__all__ = [
    "CUBE", "SLACK", "Lines", "Rays", "bounding_radius", "camera_rays", "clip_from_view", "crop_rays", "cross", "dot",
    "inside_raster", "normalize", "ray_bounds", "ray_points", "transform_points", "turn_and_shift", "turned",
    "view_from_world", "world_from_view",
]

Matrix = NDArray[np.float64]

# An entry of the turn between two cameras this near to 0 or 1 is rounding: the axes that it is formed from are off by
# as much. So a camera that stands still turns by nothing at all.
STILL = 4.0 * 2.0**-52

# Texels by which a coordinate may lie beyond a raster's end and still count as on it: far more than rounding moves it,
# and so little that no filter can tell.
SLACK = 2.0**-30

CUBE = np.array(list(itertools.product((-1.0, 1.0), repeat=3)))
"""Corners of the cube [−1, 1]³, shape (8, 3)."""


class Rays(NamedTuple):
    """Rays through the texels of a raster, measured in metres of view depth.

    Attributes
    ----------
    origin : tuple of 3 floats [m]
        The camera's position.
    per_depth : Points
        World metres per metre of view depth; each component has shape (h or 1, w or 1).
    length : Field, shape (h, w) [1]
        Metres along the ray per metre of view depth, |per_depth| ≥ 1.
    """

    origin: tuple[float, float, float]
    per_depth: Points
    length: Field


class Lines(NamedTuple):
    """Stretches of straight lines.

    Attributes
    ----------
    origin, direction : ndarray, shape (3, n)
        Where t = 0 is [m], and world metres per unit of t; of length 1 wherever t is in metres.
    start, stop : ndarray, shape (n,)
        The stretch in t; stop may be infinite.
    """

    origin: Field
    direction: Field
    start: Field
    stop: Field


# --- matrices ---------------------------------------------------------------------------------------


def world_from_view(camera: Camera) -> Matrix:
    """Take points from view space to the world.

    Parameters
    ----------
    camera : Camera
        Where it stands and looks.

    Returns
    -------
    ndarray, shape (4, 4), float64
        Columns: the world directions right, up and backward, then the position.

    Notes
    -----
    right = forward × up, so a camera without roll keeps right.y exactly 0.

    Examples
    --------
    >>> world_from_view(Camera(position=(1, 2, 3), target=(1, 2, 0)))[:3, 3].tolist()
    [1.0, 2.0, 3.0]
    """
    forward = _unit(np.subtract(camera.target, camera.position))
    right = _unit(np.cross(forward, _unit(np.asarray(camera.up))))
    result = np.eye(4)
    result[:3, :3] = np.stack([right, _unit(np.cross(right, forward)), -forward], axis=1)
    result[:3, 3] = camera.position
    return result + 0.0  # no negative zeros


def view_from_world(camera: Camera) -> Matrix:
    """Take points from the world to view space: x right, y up, z backward.

    Parameters
    ----------
    camera : Camera
        Where it stands and looks.

    Returns
    -------
    ndarray, shape (4, 4), float64
        The rigid inverse of `world_from_view`: its rotation transposed.

    Examples
    --------
    >>> (view_from_world(Camera(position=(0, 1, 0), target=(0, 1, -1))) @ (0, 1, -5, 1)).tolist()
    [0.0, 0.0, -5.0, 1.0]
    """
    pose = world_from_view(camera)
    result = np.eye(4)
    result[:3, :3] = pose[:3, :3].T
    result[:3, 3] = -(pose[:3, :3].T @ pose[:3, 3])
    return result + 0.0


def clip_from_view(camera: Camera, near: float) -> Matrix:
    """Project view space to clip space with reversed depth and the far plane at infinity.

    Parameters
    ----------
    camera : Camera
        Its vertical field of view and the aspect of its image.
    near : float [m]
        View depth that maps to device depth 1.

    Returns
    -------
    ndarray, shape (4, 4), float64
        After division by w (the view depth): x to the right and y upwards in [−1, 1], device depth
        near/depth, so 1 at the near plane and 0 at infinity.

    Notes
    -----
    Reversed depth keeps float32 relative precision about even over the range.

    Examples
    --------
    >>> clip = clip_from_view(Camera(vertical_fov=90, width=4, height=4), 0.5) @ (0, 2, -2, 1)
    >>> (clip / clip[3]).round(12).tolist()
    [0.0, 1.0, 0.25, 1.0]
    """
    tangent = _half_tangent(camera)
    result = np.zeros((4, 4))
    result[0, 0] = camera.height / (camera.width * tangent)
    result[1, 1] = 1.0 / tangent
    result[2, 3] = near
    result[3, 2] = -1.0
    return result


# --- rays -------------------------------------------------------------------------------------------


def camera_rays(camera: Camera, width: int, height: int, *, jitter: tuple[float, float] = (0.5, 0.5),
                dtype: DTypeLike = np.float64) -> Rays:
    """Make the rays through the texels of a raster that covers the camera's whole image.

    Parameters
    ----------
    camera : Camera
        Its own width and height give the aspect, whatever the raster's size.
    width, height : int
        Texels of the raster; row 0 is at the top.
    jitter : tuple of 2 floats, in [0, 1)
        Where in its texel a sample lies, x then y (downwards); ½ is the centre.
    dtype : data type
        Of the result; all is computed in float64 and rounded once.

    Returns
    -------
    Rays
        Components keep length-1 axes where they do not vary: without roll y is (height, 1), and level
        along an axis x is (1, width) and z is (1, 1).

    Notes
    -----
    per_depth = forward + right·u + up·v with u = a·tan(fov/2)·(2(i + jx)/width − 1) and
    v = tan(fov/2)·(1 − 2(j + jy)/height); length = √(1 + u² + v²). [Dörries 2020, §3.2.2]

    Examples
    --------
    >>> rays = camera_rays(Camera(vertical_fov=90, width=2, height=2), 2, 2)
    >>> [component.shape for component in rays.per_depth]
    [(1, 2), (2, 1), (1, 1)]
    >>> rays.per_depth[1].ravel().round(12).tolist()
    [0.5, -0.5]
    """
    pose = world_from_view(camera)
    tangent = _half_tangent(camera)
    across = tangent * camera.width / camera.height
    u = (across * (2.0 * (np.arange(width) + jitter[0]) / width - 1.0))[np.newaxis, :]
    v = (tangent * (1.0 - 2.0 * (np.arange(height) + jitter[1]) / height))[:, np.newaxis]
    components = [_affine(float(right), u, float(up), v, -float(backward))
                  for right, up, backward in pose[:3, :3]]
    x, y, z = (component.astype(dtype) for component in components)
    return Rays(camera.position, (x, y, z), np.sqrt(1.0 + u * u + v * v).astype(dtype))


def ray_points(rays: Rays, depth: Field) -> Points:
    """Place points on rays by their view depth.

    Parameters
    ----------
    rays : Rays
        Shape (h, w).
    depth : Field [m]
        View depth, broadcastable with (h, w); finite.

    Returns
    -------
    Points [m]
        origin + per_depth·depth, each component with the axes on which it varies.

    Examples
    --------
    >>> rays = camera_rays(Camera(position=(0, 0, 0), target=(0, 0, -1)), 1, 1)
    >>> [float(c[0, 0]) for c in ray_points(rays, np.array([[2.0]]))]
    [0.0, 0.0, -2.0]
    """
    x, y, z = (start + step * depth for start, step in zip(rays.origin, rays.per_depth, strict=True))
    return x, y, z


def crop_rays(rays: Rays, y: slice, x: slice) -> Rays:
    """Keep the rays of a rectangle of the raster.

    Parameters
    ----------
    rays : Rays
        Shape (h, w).
    y, x : slice
        Rows and columns to keep.

    Returns
    -------
    Rays
        Views; axes of length 1 stay.

    Examples
    --------
    >>> crop_rays(camera_rays(Camera(), 8, 6), slice(1, 3), slice(0, 5)).length.shape
    (2, 5)
    """
    whole = slice(None)
    a, b, c = (component[y if component.shape[0] > 1 else whole, x if component.shape[1] > 1 else whole]
               for component in rays.per_depth)
    return Rays(rays.origin, (a, b, c), rays.length[y, x])


# --- bounds on the raster ---------------------------------------------------------------------------

# Texels added on each side of a computed range. Rays and hits in float32 stray by some 1e-3 texels.
MARGIN = 1.0


def ray_bounds(rays: Rays, corners: Field) -> tuple[slice, slice]:
    """Bound the texels whose rays can meet the convex hull of some points.

    Parameters
    ----------
    rays : Rays
        Shape (h, w).
    corners : ndarray, shape (n, 3) [m]
        World points; the hull may lie anywhere, also around or behind the camera.

    Returns
    -------
    (slice, slice)
        Ranges along y and x: never too small, at least one texel wider than the hull on each side.
        Empty where no ray in front of the camera can meet the hull.

    Notes
    -----
    The rays are affine in their indices, per_depth = A + B·i + C·j, so the inverse of (A, B, C) takes
    a point relative to the camera to (w, w·i, w·j) with w its view depth. The hull's part in front of the
    camera is spanned by the corners with w > 0 and by the directions in which its edges cross w = 0; an
    edge that crosses with w·i > 0 makes the range of i unbounded above, one with w·i < 0 below. Signs
    that rounding leaves open count as both. One row or column alone does not tell the projection: then
    the whole raster is returned.

    Examples
    --------
    >>> rays = camera_rays(Camera(position=(0, 0, 0), target=(0, 0, -1), width=64, height=64), 64, 64)
    >>> ray_bounds(rays, np.array([[-0.1, 0.1, -4.0], [0.1, 0.1, -4.0]]))
    (slice(30, 32, None), slice(30, 34, None))
    """
    rows, columns = rays.length.shape
    if rows < 2 or columns < 2 or not len(corners):
        return slice(0, rows if len(corners) else 0), slice(0, columns if len(corners) else 0)
    inverse, slack = _projection(rays)
    relative = np.asarray(corners, np.float64) - rays.origin
    w, wi, wj = inverse @ relative.T
    reach = math.sqrt(float((relative * relative).sum(axis=1).max()))
    # The second term: a corner this near to w = 0 is beyond the raster whatever w's true sign.
    tolerance = slack * reach * (np.sqrt((inverse * inverse).sum(axis=1))
                                 + np.array([0.0, 2.0 * columns, 2.0 * rows]))
    front = w > tolerance[0]
    if front.all():
        crossing = np.zeros((2, 0))
    else:
        crossing = _crossings(np.stack([wi, wj]), w, front, w < -tolerance[0])
        if not front.any() and not crossing.shape[1]:
            return slice(0, 0), slice(0, 0)
    # What the rounding of the rays amounts to in texels, beside the fixed margin.
    margin = MARGIN + slack * np.sqrt((inverse[1:] * inverse[1:]).sum(axis=1)) * float(rays.length.max())
    x = _range(wi[front] / w[front], crossing[0], tolerance[1], float(margin[0]), columns)
    y = _range(wj[front] / w[front], crossing[1], tolerance[2], float(margin[1]), rows)
    return y, x


def _projection(rays: Rays) -> tuple[Matrix, float]:
    """The matrix to (w, w·i, w·j), and the relative rounding error of the rays that it was made from."""
    rows, columns = rays.length.shape
    first = np.array([float(c[0, 0]) for c in rays.per_depth])
    right = np.array([float(c[0, -1]) for c in rays.per_depth])
    low = np.array([float(c[-1, 0]) for c in rays.per_depth])
    basis = np.stack([first, (right - first) / (columns - 1), (low - first) / (rows - 1)], axis=1)
    return np.linalg.inv(basis), 32.0 * float(np.finfo(rays.length.dtype).eps)


def _crossings(position: Matrix, w: Matrix, front: NDArray[np.bool_], back: NDArray[np.bool_]) -> Matrix:
    """(w·i, w·j) where the hull's edges cross w = 0: corners on it, and pairs on either side of it."""
    on = position[:, ~front & ~back]
    ahead, behind = w[front][:, np.newaxis], w[back]
    share = ahead / (ahead - behind)
    a, b = position[:, front][:, :, np.newaxis], position[:, back][:, np.newaxis, :]
    return np.concatenate([on, (a + (b - a) * share).reshape(2, -1)], axis=1)


def _range(ratio: Matrix, crossing: Matrix, tolerance: float, margin: float, count: int) -> slice:
    """Indices from the least to the largest ratio, unbounded where a crossing leads away to infinity."""
    low, high = (float(ratio.min()), float(ratio.max())) if len(ratio) else (math.inf, -math.inf)
    if len(crossing):
        low = -math.inf if float(crossing.min()) <= tolerance else low
        high = math.inf if float(crossing.max()) >= -tolerance else high
    start = math.ceil(min(max(low - margin, 0.0), count))
    stop = math.floor(max(min(high + margin, count - 1.0), -1.0)) + 1
    return slice(start, max(start, stop))


# --- points -----------------------------------------------------------------------------------------


def dot(a: Points, b: Points) -> Field:
    """Multiply two vectors componentwise and add up.

    Parameters
    ----------
    a, b : Points
        Three broadcastable components each.

    Returns
    -------
    Field
        a·b, with the axes of both.

    Examples
    --------
    >>> e = np.ones((1, 1))
    >>> dot((e, 2 * e, 3 * e), (e, e, e)).tolist()
    [[6.0]]
    """
    result: Field = a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
    return result


def cross(a: Points, b: Points) -> Points:
    """Form the cross product of two vectors.

    Parameters
    ----------
    a, b : Points
        Three broadcastable components each.

    Returns
    -------
    Points
        a × b.

    Examples
    --------
    >>> o, e = np.zeros(1), np.ones(1)
    >>> [float(c[0]) for c in cross((e, o, o), (o, e, o))]
    [0.0, 0.0, 1.0]
    """
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


def normalize(vector: Points) -> Points:
    """Scale vectors to length 1.

    Parameters
    ----------
    vector : Points
        Not zero; squares must neither overflow nor underflow.

    Returns
    -------
    Points
        vector/|vector|; every component has the axes of the length.

    Examples
    --------
    >>> [float(c[0]) for c in normalize((np.array([3.0]), np.array([0.0]), np.array([4.0])))]
    [0.6, 0.0, 0.8]
    """
    length = np.sqrt(dot(vector, vector))
    return vector[0] / length, vector[1] / length, vector[2] / length


def transform_points(matrix: Matrix, points: Points, *, directions: bool = False) -> Points:
    """Map points (or directions) by an affine matrix, leaving out its zeros.

    Parameters
    ----------
    matrix : ndarray, shape (4, 4)
        ``target_from_source``; the last row is (0, 0, 0, 1).
    points : Points
        In the source space.
    directions : bool
        Leave out the translation.

    Returns
    -------
    Points
        In the target space, in the dtype of ``points``. An output component has only the axes of the
        inputs that enter it with a factor other than 0.

    Examples
    --------
    >>> x, y, z = np.ones((1, 4)), np.ones((3, 1)), np.ones((1, 1))
    >>> [c.shape for c in transform_points(np.diag([2.0, 3.0, 4.0, 1.0]), (x, y, z))]
    [(1, 4), (3, 1), (1, 1)]
    """
    x, y, z = (_row(matrix[row], points, not directions) for row in range(3))
    return x, y, z


def turn_and_shift(camera: Camera, previous: Camera) -> tuple[Matrix, Matrix]:
    """What takes points from a camera's view space to that of an earlier one.

    Parameters
    ----------
    camera, previous : Camera

    Returns
    -------
    turn : ndarray, shape (3, 3)
        The identity exactly for cameras that look the same way: entries within 4 roundings of 0 or 1 are these.
    shift : ndarray, shape (3,) [m]
        From both cameras alone, so that the world's origin costs no digits.

    Examples
    --------
    >>> near, far = (Camera(position=(0, 0, z), target=(0, 0, 0)) for z in (1, 2))
    >>> turn, shift = turn_and_shift(near, far)
    >>> bool((turn == np.eye(3)).all()), shift.tolist()
    (True, [0.0, 0.0, -1.0])
    """
    now, then = world_from_view(camera), world_from_view(previous)
    turn: Matrix = then[:3, :3].T @ now[:3, :3]
    turn = np.where(np.abs(turn) <= STILL, 0.0, turn)
    turn = np.where(np.abs(np.abs(turn) - 1.0) <= STILL, np.sign(turn), turn)
    return turn, then[:3, :3].T @ (now[:3, 3] - then[:3, 3])


def turned(row: Matrix, ray: Points) -> Matrix:
    """One component of a turned vector.

    Parameters
    ----------
    row : ndarray, shape (3,)
        Of the turn.
    ray : Points

    Returns
    -------
    ndarray
        Without the terms whose factor is 0, so that their axes stay away.

    Examples
    --------
    >>> turned(np.array([0.0, 2.0, 0.0]), (np.ones((3, 1)), np.ones((1, 1)), np.ones((1, 4)))).tolist()
    [[2.0]]
    """
    total: Matrix = np.zeros((1,) * ray[0].ndim)
    for factor, component in zip(row.tolist(), ray, strict=True):
        if factor != 0.0:
            total = total + factor * component
    return total


def inside_raster(coordinates: Sequence[Field], counts: Sequence[int]) -> NDArray[np.bool_]:
    """Whether texel coordinates lie in a raster, both of its ends included.

    Parameters
    ----------
    coordinates : sequence of Field, broadcastable together
    counts : sequence of int
        Texels along each.

    Returns
    -------
    ndarray of bool
        One element where all of them do. Beyond an end by no more than `SLACK` counts as on it.

    Examples
    --------
    >>> inside_raster([np.array([[0.0, 2.0]]), np.array([[0.5]])], [2, 1]).tolist()
    [[True]]
    """
    result = np.ones((1,) * coordinates[0].ndim, np.bool_)
    for coordinate, count in zip(coordinates, counts, strict=True):
        inside = (coordinate >= -SLACK) & (coordinate <= count + SLACK)
        if not inside.all():
            result = result & inside
    return result


def bounding_radius(pose: Matrix) -> float:
    """Radius of a ball about a pose's origin that holds its box.

    Parameters
    ----------
    pose : ndarray, shape (4, 4)
        ``world_from_local``; the box is [−1, 1]³ there.

    Returns
    -------
    float [m]
        Half the diagonal of the box along the world's axes around it: no less than the farthest corner's distance.

    Examples
    --------
    >>> bounding_radius(np.diag([2.0, 3.0, 6.0, 1.0]))
    7.0
    """
    return float(np.linalg.norm(np.abs(pose[:3, :3]).sum(axis=1)))


def _row(row: Matrix, points: Points, translated: bool) -> Field:
    """One output component: the sum of the terms whose factor is not 0."""
    total: Field | None = None
    for factor, component in zip(row[:3].tolist(), points, strict=True):
        if factor != 0.0:
            term = component if factor == 1.0 else component * factor
            total = term if total is None else total + term
    if total is None:
        total = np.zeros((1,) * max(c.ndim for c in points), np.result_type(*points))
    shift = float(row[3])
    return total + shift if translated and shift != 0.0 else total


def _affine(a: float, u: Matrix, b: float, v: Matrix, c: float) -> Matrix:
    """a·u + b·v + c without the terms whose factor is 0, so that their axes stay away."""
    total: Matrix = np.full((1, 1), c)
    if a != 0.0:
        total = total + a * u
    if b != 0.0:
        total = total + b * v
    return total


def _half_tangent(camera: Camera) -> float:
    """tan(fov/2)."""
    return math.tan(math.radians(camera.vertical_fov) / 2.0)


def _unit(vector: NDArray[Any]) -> Matrix:
    """The direction of one vector, whatever its size."""
    scaled = np.asarray(vector, np.float64) / np.max(np.abs(vector))
    result: Matrix = scaled / math.sqrt(float(scaled @ scaled))
    return result
