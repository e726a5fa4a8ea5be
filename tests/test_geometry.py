"""Matrices, rays, points and bounds against exact scalar geometry."""

from __future__ import annotations

import math

import numpy as np
import pytest
import reference_geometry as reference
from hypothesis import assume, example, given
from hypothesis import strategies as st

from froxel_ref.geometry import (
    Rays,
    camera_rays,
    clip_from_view,
    crop_rays,
    cross,
    dot,
    normalize,
    ray_bounds,
    ray_points,
    transform_points,
    view_from_world,
    world_from_view,
)
from froxel_ref.records import InputError
from froxel_ref.scene import Camera

EPS = np.finfo(np.float64).eps
length3 = st.floats(-10.0, 10.0).map(lambda x: round(x, 3))
vectors = st.tuples(length3, length3, length3)


@st.composite
def cameras(draw):
    try:
        return Camera(position=draw(vectors), target=draw(vectors), up=draw(vectors),
                      vertical_fov=draw(st.floats(1.0, 150.0)), width=draw(st.integers(1, 40)),
                      height=draw(st.integers(1, 40)))
    except InputError:
        assume(False)


def at(component, j, i):
    """A component's value at row j, column i, whatever axes it carries."""
    return float(component[j if component.shape[0] > 1 else 0, i if component.shape[1] > 1 else 0])


# --- rays -------------------------------------------------------------------------------------------


def test_rays_of_a_quarter_turn_by_hand():
    """90° over two rows: u = v = ±½; the camera looks along +x, so its right is +z."""
    rays = camera_rays(Camera(position=(1, 2, 3), target=(5, 2, 3), vertical_fov=90, width=2, height=2), 2, 2)
    x, y, z = (component.round(15) for component in rays.per_depth)
    assert rays.origin == (1.0, 2.0, 3.0)
    assert x.tolist() == [[1.0]]
    assert y.tolist() == [[0.5], [-0.5]]
    assert z.tolist() == [[-0.5, 0.5]]
    np.testing.assert_allclose(rays.length, np.full((2, 2), math.sqrt(1.5)), rtol=4 * EPS)


def test_jitter_and_aspect_by_hand():
    """The raster may have another aspect than the image; jitter 0 is the texel's upper left corner."""
    camera = Camera(position=(0, 0, 0), target=(0, 0, -1), vertical_fov=90, width=20, height=10)
    rays = camera_rays(camera, 4, 4, jitter=(0.0, 0.75))
    np.testing.assert_allclose(rays.per_depth[0][0], [-2.0, -1.0, 0.0, 1.0], rtol=4 * EPS, atol=EPS)
    np.testing.assert_allclose(rays.per_depth[1][:, 0], [0.625, 0.125, -0.375, -0.875], rtol=8 * EPS)


@pytest.mark.parametrize(("target", "up", "shapes"), [
    ((0, 0, -1), (0, 1, 0), [(1, 5), (3, 1), (1, 1)]),
    ((-2, 0, 0), (0, 3, 0), [(1, 1), (3, 1), (1, 5)]),
    ((1, 0, -1), (0, 1, 0), [(1, 5), (3, 1), (1, 5)]),
    ((1, 1, -1), (0, 1, 0), [(3, 5), (3, 1), (3, 5)]),
    ((0, 1, -1), (0, 1, 0), [(1, 5), (3, 1), (3, 1)]),
    ((1, 1, -1), (1, 2, 3), [(3, 5), (3, 5), (3, 5)]),
])
def test_components_keep_only_the_axes_on_which_they_vary(target, up, shapes):
    rays = camera_rays(Camera(position=(0, 0, 0), target=target, up=up), 5, 3)
    assert [component.shape for component in rays.per_depth] == shapes
    assert rays.length.shape == (3, 5)


@given(cameras(), st.integers(1, 4), st.integers(1, 4), st.tuples(st.floats(0, 0.99), st.floats(0, 0.99)))
def test_rays_agree_with_forty_digits(camera, width, height, jitter):
    rays = camera_rays(camera, width, height, jitter=jitter)
    forward = np.subtract(camera.target, camera.position)
    across = np.linalg.norm(np.cross(forward, camera.up))
    across /= np.linalg.norm(forward) * np.linalg.norm(camera.up)
    for j, i in np.ndindex(height, width):
        expected = reference.camera_ray(camera, width, height, i + jitter[0], j + jitter[1])
        size = float(reference.mpmath.sqrt(reference.dot(expected, expected)))
        # Some ten roundings of terms up to |per_depth|; the basis loses digits as up nears the view.
        bound = 16 * EPS * size / across
        assert all(abs(at(c, j, i) - e) <= bound for c, e in zip(rays.per_depth, expected, strict=True))
        assert rays.length[j, i] == pytest.approx(size, rel=8 * EPS)


@given(cameras())
def test_a_ray_advances_one_metre_of_view_depth(camera):
    rays = camera_rays(camera, 3, 3)
    view = transform_points(view_from_world(camera), rays.per_depth, directions=True)
    np.testing.assert_allclose(np.broadcast_to(view[2], (3, 3)), -1.0, atol=32 * EPS * rays.length.max())


@given(cameras(), st.floats(0.01, 100.0))
def test_clip_space_shows_the_raster_and_reversed_depth(camera, depth):
    rays = camera_rays(camera, 4, 2)
    points = transform_points(view_from_world(camera), ray_points(rays, np.array([[depth]])))
    stacked = np.stack([np.broadcast_to(c, (2, 4)) for c in (*points, np.ones((1, 1)))])
    clip = np.einsum("ij,jyx->iyx", clip_from_view(camera, 0.01), stacked)
    # Positions of up to 17 m enter and leave again; a narrow field of view magnifies what that rounds off.
    bound = 64 * EPS * (30.0 / depth + 1.0) * clip_from_view(camera, 0.01)[:2].max() + 64 * EPS
    across = np.broadcast_to([-0.75, -0.25, 0.25, 0.75], (2, 4))
    np.testing.assert_allclose(clip[0] / clip[3], across, atol=bound)
    np.testing.assert_allclose(clip[1] / clip[3], np.broadcast_to([[0.5], [-0.5]], (2, 4)), atol=bound)
    np.testing.assert_allclose(clip[2] / clip[3], 0.01 / depth, rtol=bound)


def test_device_depth_is_one_at_the_near_plane_and_zero_at_infinity():
    clip = clip_from_view(Camera(), 0.5)
    near, far = clip @ (0, 0, -0.5, 1), clip @ (0, 0, -1, 0)
    assert near[2] / near[3] == 1.0
    assert far[2] / far[3] == 0.0


@given(cameras())
def test_view_and_world_are_inverse_rotations(camera):
    pose, inverse = world_from_view(camera), view_from_world(camera)
    np.testing.assert_allclose(pose @ inverse, np.eye(4), atol=256 * EPS * 10)
    assert np.linalg.det(pose[:3, :3]) == pytest.approx(1.0, abs=1e-6)


def test_float32_rays_are_the_float64_rays_rounded_once():
    single, double = (camera_rays(Camera(), 5, 4, dtype=t) for t in (np.float32, np.float64))
    for a, b in zip((*single.per_depth, single.length), (*double.per_depth, double.length), strict=True):
        assert a.dtype == np.float32
        assert np.array_equal(a, b.astype(np.float32))


def test_points_on_rays_by_hand():
    per_depth = (np.array([[0.5, -0.5]]), np.array([[0.25]]), np.array([[-1.0]]))
    rays = Rays((1.0, 2.0, 3.0), per_depth, np.ones((1, 2)))
    x, y, z = ray_points(rays, np.array([[[2.0]], [[4.0]]]))
    assert x.tolist() == [[[2.0, 0.0]], [[3.0, -1.0]]]
    assert y.tolist() == [[[2.5]], [[3.0]]]
    assert z.tolist() == [[[1.0]], [[-1.0]]]


def test_cropped_rays_are_views_of_the_rectangle():
    rays = camera_rays(Camera(target=(1, 2, -1)), 8, 6)
    part = crop_rays(rays, slice(1, 3), slice(2, 7))
    assert [c.shape for c in part.per_depth] == [(2, 5), (2, 1), (2, 5)]
    assert np.array_equal(part.length, rays.length[1:3, 2:7])
    assert np.array_equal(part.per_depth[0], rays.per_depth[0][1:3, 2:7])
    assert np.shares_memory(part.per_depth[1], rays.per_depth[1])


# --- points -----------------------------------------------------------------------------------------


@given(vectors, vectors)
def test_products_agree_with_scalars(a, b):
    left, right = (tuple(np.array([c]) for c in v) for v in (a, b))
    assert dot(left, right)[0] == pytest.approx(reference.dot(a, b), abs=1e-12)
    assert [float(c[0]) for c in cross(left, right)] == pytest.approx(reference.cross(a, b), abs=1e-12)


@given(vectors)
def test_normalised_vectors_have_length_one(a):
    assume(any(a))
    unit = normalize(tuple(np.array([c]) for c in a))
    assert dot(unit, unit)[0] == pytest.approx(1.0, rel=8 * EPS)
    assert all(float(u[0]) * c >= 0.0 for u, c in zip(unit, a, strict=True))


@pytest.mark.parametrize(("directions", "expected"), [(False, (24.0, 41.0, 7.0)), (True, (14.0, 21.0, 0.0))])
def test_transform_by_hand(directions, expected):
    matrix = np.array([[2.0, 0, 4, 10], [0, 3, 5, 20], [0, 0, 0, 7], [0, 0, 0, 1]])
    x, y, z = np.full((1, 4), 1.0), np.full((3, 1), 2.0), np.full((1, 1), 3.0)
    result = transform_points(matrix, (x, y, z), directions=directions)
    assert [component.shape for component in result] == [(1, 4), (3, 1), (1, 1)]
    assert tuple(float(component[0, 0]) for component in result) == expected


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_transform_keeps_the_dtype(dtype):
    points = tuple(np.ones((1, 2), dtype) for _ in range(3))
    assert all(c.dtype == dtype for c in transform_points(world_from_view(Camera(target=(1, 2, 3))), points))


# --- bounds -----------------------------------------------------------------------------------------


def test_bounds_by_hand():
    """At 4 m and 90° over 64 texels a texel is ⅛ m: ±0.5 m are texels 28…36, and one more on each side."""
    camera = Camera(position=(0, 0, 0), target=(0, 0, -1), vertical_fov=90, width=64, height=64)
    corners = np.array([[-0.5, -0.5, -4.0], [0.5, 0.5, -4.0], [0.4, 0.0, -5.0]])
    assert ray_bounds(camera_rays(camera, 64, 64), corners) == (slice(27, 37), slice(27, 37))


@pytest.mark.parametrize(("corners", "empty"), [
    ([[0, 0, 4.0], [1, 1, 5.0]], True),                          # behind
    ([[50.0, 0, -4], [60, 1, -4]], True),                        # to the right
    ([[0, 90.0, -4], [1, 95, -4]], True),                        # above
    ([[-1, -1, 1.0], [1, -1, 1], [0, 2, 1], [0, 0, -2]], False),  # around the camera
    ([[1, -1, 5.0], [1, -1, -5]], False),                        # passing by: from the right edge inwards
    ([[5.0, 0, 0.0], [6, 0, 0]], True),                          # beside, in the camera's plane
    ([], True),
])
def test_bounds_behind_and_around_the_camera(corners, empty):
    camera = Camera(position=(0, 0, 0), target=(0, 0, -1), vertical_fov=90, width=64, height=64)
    y, x = ray_bounds(camera_rays(camera, 64, 64), np.array(corners, float).reshape(-1, 3))
    assert (y.start >= y.stop or x.start >= x.stop) == empty


def test_bounds_of_what_passes_beside_the_camera_are_one_sided():
    """A wall 1 m to the right, from behind the camera to 4 m ahead: it starts at u = ¼, 40 texels in."""
    camera = Camera(position=(0, 0, 0), target=(0, 0, -1), vertical_fov=90, width=64, height=64)
    corners = np.array([[1, y, z] for y in (-0.5, 0.5) for z in (3.0, -4.0)])
    y, x = ray_bounds(camera_rays(camera, 64, 64), corners)
    assert (x, y) == (slice(39, 64), slice(0, 64))


seeds = st.integers(0, 2**32 - 1)


@given(cameras(), seeds, st.sampled_from([0.01, 1.0, 30.0]), st.sampled_from([np.float32, np.float64]))
@example(Camera(position=(0, 0, 0), target=(0, 0, -1)), 0, 1.0, np.float64)
def test_bounds_are_never_too_small(camera, seed, size, dtype):
    """Whatever point of the hull a ray comes near, its texel is inside the bounds."""
    rng = np.random.default_rng(seed)
    width, height = rng.integers(1, 60, 2).tolist()
    corners = rng.normal(size=(rng.integers(1, 9), 3)) * size
    corners += rng.normal(size=3) * 4.0 + rng.integers(0, 2) * np.asarray(camera.position)
    y, x = ray_bounds(camera_rays(camera, width, height, dtype=dtype), corners)
    # Sparse weights reach the corners and edges, whose images bound the hull's.
    weights = rng.dirichlet(np.full(len(corners), 0.2), 200)
    for point in np.concatenate([corners, weights @ corners]):
        depth, place = reference.project(camera, width, height, point.tolist())
        if place is None or depth < 1e-6:
            continue
        # Texel i has its sample at i + ½: both samples next to the point are tested against the bounds.
        for i, j in {(math.floor(place[0] - 0.5), math.floor(place[1] - 0.5)),
                     (math.ceil(place[0] - 0.5), math.ceil(place[1] - 0.5))}:
            if 0 <= i < width and 0 <= j < height:
                assert x.start <= i < x.stop
                assert y.start <= j < y.stop


@given(cameras(), seeds)
def test_bounds_are_tight_in_front_of_the_camera(camera, seed):
    """Not more than two texels beyond the projected corners where all of them are ahead."""
    rng = np.random.default_rng(seed)
    width, height = rng.integers(2, 60, 2).tolist()
    forward = np.subtract(camera.target, camera.position)
    center = camera.position + forward / np.linalg.norm(forward) * 6.0
    corners = center + rng.uniform(-2.0, 2.0, (8, 3))
    places = np.array([reference.project(camera, width, height, p)[1] for p in corners.tolist()])
    for bound, at_, count in zip(ray_bounds(camera_rays(camera, width, height), corners), places.T[::-1],
                                 (height, width), strict=True):
        assert bound.start >= min(max(at_.min() - 2.0, 0.0), count) - 0.5
        assert bound.stop <= max(min(at_.max() + 2.0, count), 0.0) + 0.5
