"""Froxels: slice distributions, world positions, and the bounds of shapes."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Any

import mpmath
import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from froxel_ref.grid import (
    CURVES,
    Froxels,
    corner_bounds,
    depth_to_slice,
    froxel_from_world,
    froxel_points,
    make_froxels,
    slice_to_depth,
    step_lengths,
    world_from_froxel,
)
from froxel_ref.scene import Camera
from froxel_ref.settings import DISTRIBUTIONS, Grid

EPS = 2.0**-52
CAMERA = Camera(position=(3.0, 2.0, -1.0), target=(5.0, 1.0, -9.0), vertical_fov=70.0, width=1600, height=900)
ROLLED = Camera(position=(-30.0, 12.0, 7.0), target=(5.0, 1.0, -9.0), up=(0.3, 1.0, 0.1), vertical_fov=35.0)
SMALL = Grid(width=13, height=9, depth=16, near=0.5, far=64.0)

grids = st.builds(
    lambda depth, near, ratio, name: Grid(depth=depth, near=near, far=near * ratio, distribution=name),
    depth=st.integers(1, 300), near=st.floats(1e-3, 1e3), ratio=st.floats(1.01, 1e6),
    name=st.sampled_from(DISTRIBUTIONS))


# --- slice distributions ----------------------------------------------------------------------------


def test_every_distribution_has_its_curve() -> None:
    assert tuple(CURVES) == DISTRIBUTIONS


@pytest.mark.parametrize(("distribution", "expected"), [
    ("exponential", [1.0, 2.0, 4.0, 8.0, 16.0]),
    ("linear", [1.0, 4.75, 8.5, 12.25, 16.0]),
])
def test_boundaries_by_hand(distribution: str, expected: list[float]) -> None:
    grid = Grid(depth=4, near=1.0, far=16.0, distribution=distribution)
    np.testing.assert_allclose(slice_to_depth(range(5), grid), expected, rtol=2 * EPS)
    np.testing.assert_allclose(depth_to_slice(expected, grid), range(5), rtol=0, atol=4 * EPS)


@given(grid=grids)
def test_the_ends_are_exact(grid: Grid) -> None:
    assert slice_to_depth([0, grid.depth], grid).tolist() == [grid.near, grid.far]
    assert depth_to_slice([grid.near, grid.far], grid).tolist() == [0.0, grid.depth]


def exact_depth(s: float, grid: Grid) -> Any:
    """The curve's definition in 60-digit arithmetic."""
    near, far, share = mpmath.mpf(grid.near), mpmath.mpf(grid.far), mpmath.mpf(s) / grid.depth
    return near * (far / near)**share if grid.distribution == "exponential" else near + (far - near) * share


@given(grid=grids, share=st.floats(-0.5, 1.5))
def test_depth_is_accurate(grid: Grid, share: float) -> None:
    s = share * grid.depth
    assume(grid.distribution == "exponential" or share > 0.0)
    with mpmath.workdps(60):
        exact = exact_depth(s, grid)
        error = abs((mpmath.mpf(float(slice_to_depth(s, grid))) - exact) / exact)
        ratio = math.log(grid.far / grid.near) if grid.distribution == "exponential" else 0.0
        # Rounding of f/n, of the exponent's share (times ln f/n) and of power and product, ½ ulp each.
        reach = max(0.0, 0.5 + abs(share - 0.5)) if not 0.0 <= share <= 1.0 else 0.5
        assert error <= (2.0 + (0.5 + ratio) * reach) * EPS


@given(grid=grids, share=st.floats(0.0, 1.0))
def test_round_trip_by_depth(grid: Grid, share: float) -> None:
    z = grid.near + share * (grid.far - grid.near)
    back = float(slice_to_depth(depth_to_slice(z, grid), grid))
    # The slice coordinate itself holds z only to ½ ulp times ln(f/n), or times (f − n)/z.
    kept = math.log(grid.far / grid.near) if grid.distribution == "exponential" else grid.far / z
    assert abs(back - z) <= (4.0 + kept) * EPS * z


@given(grid=grids, share=st.floats(0.0, 1.0))
def test_round_trip_by_slice(grid: Grid, share: float) -> None:
    s = share * grid.depth
    # One ulp of z is D/ln(f/n) (or D·z/(f − n)) ulp of s.
    z = float(slice_to_depth(s, grid))
    exponential = grid.distribution == "exponential"
    slope = 1.0 / math.log(grid.far / grid.near) if exponential else z / (grid.far - grid.near)
    assert abs(float(depth_to_slice(z, grid)) - s) <= 4.0 * EPS * grid.depth * (1.0 + slope)


@given(grid=grids, shares=st.tuples(st.floats(0.0, 1.0), st.floats(0.0, 1.0)))
def test_depth_grows_with_slice(grid: Grid, shares: tuple[float, float]) -> None:
    low, high = sorted(shares)
    assume(high - low > 1e-9)
    assert slice_to_depth(low * grid.depth, grid) < slice_to_depth(high * grid.depth, grid)


@pytest.mark.parametrize(("distribution", "z", "expected"), [
    ("exponential", math.inf, math.inf), ("linear", math.inf, math.inf), ("exponential", 0.0, -math.inf),
    ("exponential", -1.0, -math.inf), ("exponential", math.nan, math.nan), ("linear", math.nan, math.nan),
])
def test_slices_of_odd_depths(distribution: str, z: float, expected: float) -> None:
    result = float(depth_to_slice(z, Grid(distribution=distribution)))
    assert result == expected or (math.isnan(result) and math.isnan(expected))


# --- the grid ---------------------------------------------------------------------------------------


def test_a_sample_lies_at_the_geometric_mean_of_its_boundaries() -> None:
    froxels = make_froxels(CAMERA, SMALL)
    mean = np.sqrt(froxels.boundaries[:-1] * froxels.boundaries[1:])
    np.testing.assert_allclose(froxels.depths, mean, rtol=8 * EPS)


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_froxels_in_either_type(dtype: type) -> None:
    froxels = make_froxels(CAMERA, SMALL, dtype=dtype)
    assert froxels.depths.shape == (16, 1, 1)
    assert froxels.boundaries.shape == (17, 1, 1)
    arrays = (froxels.depths, froxels.boundaries, *froxel_points(froxels))
    assert {a.dtype for a in arrays} == {np.dtype(dtype)}


CUBE = np.array([[a, b, c] for a in (-1.0, 1.0) for b in (-1.0, 1.0) for c in (-1.0, 1.0)])


@pytest.mark.parametrize("camera", [CAMERA, ROLLED])
@pytest.mark.parametrize("jitter", [(0.5, 0.5, 0.5), (0.0, 0.25, 0.9)])
def test_positions_are_bilinear_in_the_far_corners(camera: Camera,
                                                   jitter: tuple[float, float, float]) -> None:
    """The thesis's form: the four far-plane corners, interpolated and scaled by z/f."""
    forward, right = (v / np.linalg.norm(v) for v in (
        np.subtract(camera.target, camera.position),
        np.cross(np.subtract(camera.target, camera.position), camera.up)))
    tall = SMALL.far * math.tan(math.radians(camera.vertical_fov) / 2)
    wide = tall * camera.width / camera.height
    middle, up = forward * SMALL.far, np.cross(right, forward) * tall
    corners = [[middle + up - right * wide, middle + up + right * wide],
               [middle - up - right * wide, middle - up + right * wide]]
    x, y, z = np.broadcast_arrays(*froxel_points(make_froxels(camera, SMALL, jitter=jitter)))
    for k, j, i in [(0, 0, 0), (15, 8, 12), (7, 3, 11)]:
        u, v = (i + jitter[0]) / SMALL.width, (j + jitter[1]) / SMALL.height
        far = (1 - v) * ((1 - u) * corners[0][0] + u * corners[0][1]) + v * (
            (1 - u) * corners[1][0] + u * corners[1][1])
        depth = SMALL.near * (SMALL.far / SMALL.near)**((k + jitter[2]) / SMALL.depth)
        expected = camera.position + far * depth / SMALL.far
        # 60 m of extent at 2⁻⁵² and some ten operations.
        np.testing.assert_allclose([a[k, j, i] for a in (x, y, z)], expected, rtol=0, atol=100 * 16 * EPS)


def test_points_keep_the_axes_on_which_they_vary() -> None:
    level = make_froxels(Camera(), SMALL)
    assert [p.shape for p in froxel_points(level)] == [(16, 1, 13), (16, 9, 1), (16, 1, 1)]
    turned = make_froxels(CAMERA, SMALL)
    assert froxel_points(turned)[1].shape == (16, 9, 1)  # pitch, but no roll


@pytest.mark.parametrize("camera", [Camera(), CAMERA, ROLLED])
def test_a_block_of_points_is_a_view_of_all_of_them(camera: Camera) -> None:
    froxels = make_froxels(camera, SMALL)
    box = (slice(3, 7), slice(2, 3), slice(5, 13))
    for whole, part in zip(froxel_points(froxels), froxel_points(froxels, *box), strict=True):
        full = np.broadcast_to(whole, (16, 9, 13))[box]
        np.testing.assert_array_equal(np.broadcast_to(part, full.shape), full)


@pytest.mark.parametrize("distribution", DISTRIBUTIONS)
def test_paths_are_measured_along_the_ray(distribution: str) -> None:
    """Against the distance of consecutive boundary points, formed in the world."""
    grid = Grid(width=5, height=3, depth=8, near=1.0, far=20.0, distribution=distribution)
    step, length = step_lengths(make_froxels(CAMERA, grid))
    middle = np.full(9, 0.5)
    ends = np.stack(world_from_froxel((middle, middle, np.arange(9.0)), CAMERA, grid), axis=1)
    expected = [math.dist(a, b) for a, b in pairwise(ends.tolist())]
    np.testing.assert_allclose(step[:, 0, 0] * length[0, 0], expected, rtol=1e-13)  # differences lose digits
    assert step.sum() == pytest.approx(19.0, rel=4 * EPS)


def test_corners_are_longer_by_what_d13_leaves_out() -> None:
    """Spec, D13: 1/cos θ in the corners at 60° and 16:9 is 1.54."""
    camera = Camera(vertical_fov=60.0, width=1600, height=900)
    world = world_from_froxel((np.array(0.0), np.array(0.0), np.array(64.0)), camera, Grid())
    length = math.dist([float(c) for c in world], camera.position) / 64.0
    assert length == pytest.approx(1.54, abs=0.005)


# --- world and texel coordinates --------------------------------------------------------------------


@given(x=st.floats(0, 13), y=st.floats(0, 9), s=st.floats(0, 16), camera=st.sampled_from([CAMERA, ROLLED]),
       distribution=st.sampled_from(DISTRIBUTIONS))
def test_world_round_trip(x: float, y: float, s: float, camera: Camera, distribution: str) -> None:
    grid = Grid(width=13, height=9, depth=16, near=0.5, far=64.0, distribution=distribution)
    world = world_from_froxel((np.array(x), np.array(y), np.array(s)), camera, grid)
    back = froxel_from_world(world, camera, grid)
    # Positions carry 35 m·2⁻⁵² or so; near the camera (0.5 m) that is 70·13 ulp of a texel; ×4 margin.
    np.testing.assert_allclose([float(c) for c in back], [x, y, s], rtol=0, atol=4 * 70 * 13 * EPS)


def test_texel_coordinates_of_samples() -> None:
    froxels = make_froxels(ROLLED, SMALL)
    x, y, z = froxel_from_world(froxel_points(froxels), ROLLED, SMALL)
    shape = (16, 9, 13)
    k, j, i = np.indices(shape) + 0.5
    for found, expected in ((x, i), (y, j), (z, k)):
        np.testing.assert_allclose(np.broadcast_to(found, shape), expected, rtol=0, atol=1e-11)


def test_nothing_behind_the_camera_is_inside() -> None:
    x, y, z = froxel_from_world((np.zeros(2), np.array([1.7, 1.7]), np.array([4.0, 0.0])), Camera(), Grid())
    assert np.isnan(x).all()
    assert np.isnan(y).all()
    assert z.tolist() == [-math.inf, -math.inf]


# --- bounds -----------------------------------------------------------------------------------------


def inside_box(froxels: Froxels, bounds: tuple[slice, slice, slice]) -> np.ndarray:
    mask = np.zeros((len(froxels.depths), *froxels.rays.length.shape), bool)
    mask[bounds] = True
    return mask


centers = st.tuples(st.floats(-40, 40), st.floats(-30, 30), st.floats(-60, 20))
cameras = st.sampled_from([Camera(), CAMERA, ROLLED])
types = st.sampled_from([np.float32, np.float64])


@given(center=centers, scale=st.tuples(*[st.floats(0.01, 20.0)] * 3),
       turn=st.tuples(*[st.floats(-3.0, 3.0)] * 3), camera=cameras, dtype=types,
       size=st.sampled_from([(13, 9, 16), (1, 1, 8), (1, 7, 3), (9, 1, 1)]))
def test_corner_bounds_miss_nothing(center: tuple[float, ...], scale: tuple[float, ...],
                                    turn: tuple[float, ...], camera: Camera, dtype: type,
                                    size: tuple[int, int, int]) -> None:
    grid = Grid(width=size[0], height=size[1], depth=size[2], near=0.5, far=64.0)
    froxels = make_froxels(camera, grid, dtype=dtype)
    # A box under any affine map: a shear makes it a parallelepiped.
    matrix = np.diag(scale) @ (np.eye(3) + np.array([[0, turn[0], turn[1]], [0, 0, turn[2]], [0, 0, 0]]))
    corners = CUBE @ matrix.T + center
    inverse = np.linalg.inv(matrix)
    x, y, z = (p - c for p, c in zip(np.broadcast_arrays(*froxel_points(froxels)), center, strict=True))
    local = [row[0] * x + row[1] * y + row[2] * z for row in inverse]
    inside = (np.abs(local[0]) <= 1) & (np.abs(local[1]) <= 1) & (np.abs(local[2]) <= 1)
    assert not np.any(inside & ~inside_box(froxels, corner_bounds(froxels, corners)))


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_bounds_allow_for_rounding(dtype: type) -> None:
    """A shape that is one sample's rounded position and nothing else still holds that sample."""
    froxels = make_froxels(CAMERA, SMALL, jitter=(0.1, 0.8, 0.3), dtype=dtype)
    points = np.stack(np.broadcast_arrays(*froxel_points(froxels)), axis=-1).astype(float)
    for index in np.ndindex(3, 9, 13):
        z, y, x = (slice(i, i + 1) for i in index)
        assert corner_bounds(froxels, points[index]) == (z, y, x)


def test_bounds_are_tight() -> None:
    """Of 300 random cubes, how many samples the bounds hold for each one inside."""
    froxels = make_froxels(CAMERA, Grid(width=32, height=18, depth=32))
    x, y, z = np.broadcast_arrays(*froxel_points(froxels))
    generator = np.random.default_rng(7)
    held = inside = 0
    for _ in range(300):
        i = tuple(generator.integers(0, x.shape))
        center, radius = (float(x[i]), float(y[i]), float(z[i])), float(generator.uniform(0.2, 5.0))
        away = [x - center[0], y - center[1], z - center[2]]
        held += inside_box(froxels, corner_bounds(froxels, CUBE * radius + center)).sum()
        inside += (np.max(np.abs(away), axis=0) <= radius).sum()
    assert held / inside < 1.45  # measured 1.37: shapes cut off by the border fill their bounds


@pytest.mark.parametrize("camera", [Camera(), ROLLED])
def test_all_around_the_camera_is_everything(camera: Camera) -> None:
    froxels = make_froxels(camera, SMALL)
    everything = (slice(0, 16), slice(0, 9), slice(0, 13))
    cube = CUBE * 500.0 + camera.position
    assert corner_bounds(froxels, cube) == everything


@pytest.mark.parametrize(
    "center", [(0.0, 1.7, 5.0), (0.0, 1.7, -90.0), (300.0, 1.7, -5.0), (0.0, 90.0, -5.0)])
def test_out_of_view_is_nothing(center: tuple[float, float, float]) -> None:
    froxels = make_froxels(Camera(), SMALL)
    empty = (slice(0, 0),) * 3
    cube = CUBE + center
    assert corner_bounds(froxels, cube) == empty
