"""Height fields and meshes: against every triangle in rational arithmetic, and without a crack."""

from __future__ import annotations

import importlib.util
import sys

import numpy as np
import pytest
import reference_geometry as reference
from hypothesis import given, settings
from hypothesis import strategies as st
from test_primitives import bundle, each_ray, random_rays

from froxel_ref.records import InputError
from froxel_ref.scene import Transform
from froxel_ref.triangles import (
    height_field_normals,
    hit_height_field,
    hit_mesh,
    mesh_caster,
    mesh_normals,
)

EPS = np.finfo(np.float64).eps
seeds = st.integers(0, 2**32 - 1)
dtypes = pytest.mark.parametrize("dtype", [np.float64, np.float32])
needs_embree = pytest.mark.skipif(importlib.util.find_spec("embreex") is None,
                                  reason="embreex is not installed (the extra 'mesh')")
rational = settings(max_examples=25)  # exact arithmetic over every triangle takes its time
PLANE = np.eye(4)
TETRAHEDRON = (np.array([[1.0, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]]),
               np.array([[0, 1, 2], [0, 3, 1], [0, 2, 3], [1, 3, 2]]))


def ball(levels):
    """A closed mesh: a tetrahedron whose faces are split in four, its vertices pushed to the unit sphere."""
    vertices, faces = TETRAHEDRON
    triangles = vertices[faces]
    for _ in range(levels):
        a, b, c = triangles.transpose(1, 0, 2)
        ab, bc, ca = (a + b) / 2, (b + c) / 2, (c + a) / 2
        triangles = np.concatenate([np.stack(part, axis=1) for part in
                                    ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))])
    points, index = np.unique(triangles.reshape(-1, 3).round(12), axis=0, return_inverse=True)
    return points / np.linalg.norm(points, axis=1, keepdims=True), index.reshape(-1, 3)


def random_pose(rng):
    pose = np.eye(4)
    pose[:3, :3] = rng.normal(size=(3, 3)) * 0.4 + np.eye(3) * rng.choice([1.0, 2.0])
    pose[:3, 3] = rng.normal(size=3)
    return pose


# --- height field -----------------------------------------------------------------------------------


def test_height_field_by_hand():
    """h = x over one cell, seen from above at (¼, ±½): both triangles at z = ¼; from below the same."""
    heights = np.array([[-1.0, 1.0], [-1.0, 1.0]])
    t, triangle = hit_height_field(bundle((0.25, -0.5, 4.0), [(0, 0, -1), (0, 0, 1)]), PLANE, heights)
    assert t.tolist() == [[3.75, np.inf]]
    assert triangle[0, 0] == 0
    t, triangle = hit_height_field(bundle((0.25, 0.5, -4.0), [(0, 0, 1), (2, 0, 1)]), PLANE, heights)
    assert t.tolist() == [[4.25, np.inf]]
    assert triangle[0, 0] == 1


def test_rows_run_along_y_and_columns_along_x():
    """A single raised sample in the last row and first column is at x = −1, y = 1."""
    heights = np.zeros((3, 4))
    heights[2, 0] = 1.0
    down = [(0, 0, -1)]
    assert hit_height_field(bundle((-1 + 1e-9, 1 - 1e-9, 4.0), down), PLANE, heights)[0] == pytest.approx(3.0)
    assert hit_height_field(bundle((1 - 1e-9, -1 + 1e-9, 4.0), down), PLANE, heights)[0] == pytest.approx(4.0)


@pytest.mark.parametrize("dtype", [np.float64, np.float32])
@pytest.mark.parametrize(("height", "z"), [(0.0, 0.0), (0.5, 0.5), (-100.0, -100.0)])
def test_a_flat_field_is_a_square(dtype, height, z):
    """No room between its bounds: the walk must still begin and end on either side of it."""
    directions = [(0.2, 0.24, -1), (-0.24, 0.1, -1), (0.26, 0, -1), (0, 0, -1), (1, 0, 0)]
    t, _ = hit_height_field(bundle((0.0, 0.0, z + 4.0), directions, dtype), PLANE, np.full((4, 3), height))
    assert np.isfinite(t).tolist() == [[True, True, False, True, False]]
    np.testing.assert_allclose(t[np.isfinite(t)], 4.0, rtol=1e-5)


def test_a_ray_within_the_field_sees_the_next_slope():
    """Standing between two ridges (h = |x|): the one ahead is hit at half a metre up, half a metre away."""
    heights = np.array([[1.0, 0.0, 1.0]] * 2)
    t, _ = hit_height_field(bundle((0.0, 0.0, 0.5), [(1, 0, 0), (-1, 0, 0), (0, 1, 0)]), PLANE, heights)
    assert t[0].tolist() == [pytest.approx(0.5), pytest.approx(0.5), np.inf]


@rational
@given(seeds)
def test_height_field_agrees_with_all_its_triangles(seed):
    """Exact Möller–Trumbore over every triangle; disagreement only within rounding of the outer border."""
    rng = np.random.default_rng(seed)
    heights = rng.normal(size=rng.integers(2, 6, 2)) * rng.choice([0.1, 0.5, 2.0])
    pose = random_pose(rng)
    rays = random_rays(rng, distance=rng.choice([0.5, 6.0]))
    t, index = hit_height_field(rays, pose, heights)
    triangles = reference.height_field_triangles(pose, heights)
    for at, direction in each_ray(rays):
        expected = reference.triangles_hit(rays.origin, direction, triangles)
        # The reference's corners are rounded too; seeds are generic, so nothing grazes within 1e-9.
        assert (expected is None) == np.isinf(t[at])
        if expected is not None:
            assert t[at] == pytest.approx(float(expected[0]), rel=1e-11)
            assert index[at] == expected[1]


@given(seeds)
def test_height_field_normals_are_across_their_triangles(seed):
    rng = np.random.default_rng(seed)
    heights, pose = rng.normal(size=(3, 4)), random_pose(rng)
    normals = height_field_normals(pose, heights)
    corners = np.array(reference.height_field_triangles(pose, heights))
    expected = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    expected /= np.linalg.norm(expected, axis=1, keepdims=True) * np.sign(np.linalg.det(pose[:3, :3]))
    np.testing.assert_allclose(normals, expected, atol=1e-12)


@dtypes
@pytest.mark.parametrize("side", [5.0, -5.0])
@pytest.mark.parametrize("aim", ["vertices", "edges", "diagonals"])
def test_no_ray_slips_between_triangles_of_a_height_field(dtype, side, aim):
    """Aimed at what triangles share, from above and below, within the border: every ray must hit.

    No slope is steeper than 0.7 and no ray flatter than 3, so each ray crosses the surface once, at t = 1.
    """
    rng = np.random.default_rng(7)
    heights = rng.uniform(-0.03, 0.03, (17, 24))
    count = 20000
    column, row = rng.integers(1, 22, count), rng.integers(1, 15, count)
    step = rng.integers(0, 2, count)
    ends = {"vertices": (0, 0), "edges": (step, 1 - step), "diagonals": (1, 1)}[aim]
    share = rng.random(count)
    z = heights[row, column] * (1 - share) + heights[row + ends[1], column + ends[0]] * share
    x, y = -1 + 2 * (column + share * ends[0]) / 23, -1 + 2 * (row + share * ends[1]) / 16
    points = np.stack([x, y, z], axis=1)
    origin = np.array([0.1, -0.2, side])
    t, _ = hit_height_field(bundle(tuple(origin), points - origin, dtype), PLANE, heights)
    np.testing.assert_allclose(t, 1.0, rtol=16 * np.finfo(dtype).eps)


@dtypes
def test_height_field_hits_lie_on_the_surface(dtype):
    """z − h(x, y) of the hits, h by plain interpolation: some ulp of the largest term."""
    rng = np.random.default_rng(3)
    heights = rng.normal(size=(9, 9))
    rays = bundle((0.3, 0.2, 3.0), rng.normal(size=(500, 3)) * (0.2, 0.2, 0) - (0, 0, 1), dtype)
    t, _ = hit_height_field(rays, PLANE, heights)
    hit = np.isfinite(t)
    assert hit.sum() > 300
    x, y, z = (o + np.asarray(c, np.float64)[hit] * t[hit]
               for o, c in zip(rays.origin, rays.per_depth, strict=True))
    u, v = (x + 1) * 4, (y + 1) * 4
    i, j = np.minimum(u.astype(int), 7), np.minimum(v.astype(int), 7)
    fu, fv = u - i, v - j
    low, right, up, high = heights[j, i], heights[j, i + 1], heights[j + 1, i], heights[j + 1, i + 1]
    h = np.where(fu > fv, low + (right - low) * fu + (high - right) * fv,
                 low + (high - up) * fu + (up - low) * fv)
    # Slopes reach 4·4: rounding of t (and of the point) moves h that much more than z.
    np.testing.assert_allclose(z, h, atol=64 * np.finfo(dtype).eps * 3.0)


# --- mesh -------------------------------------------------------------------------------------------


@needs_embree
def test_mesh_by_hand():
    """Two triangles behind one another: the nearer is seen, from either side, and nothing beside them."""
    near = np.array([[-1.0, -1, -2], [1, -1, -2], [0, 1, -2]])
    vertices, faces = np.concatenate([near, near - (0, 0, 1)]), np.array([[0, 1, 2], [5, 4, 3]])
    caster = mesh_caster(vertices, faces)
    t, index = hit_mesh(bundle((0.0, 0.0, 0.0), [(0, 0, -1), (2, 0, -1), (0, 0, 1)]), vertices[faces], caster)
    assert t.tolist() == [[2.0, np.inf, np.inf]]
    assert index[0, 0] == 0
    t, index = hit_mesh(bundle((0.0, 0.0, -5.0), [(0, 0, 1)]), vertices[faces], caster)
    assert (t.tolist(), int(index[0, 0])) == ([[2.0]], 1)
    assert mesh_normals(vertices[faces]).tolist() == [[0.0, 0.0, 1.0], [0.0, 0.0, -1.0]]


@needs_embree
@rational
@given(seeds)
def test_mesh_agrees_with_all_its_triangles(seed):
    """Exact Möller–Trumbore over every triangle; Embree may choose otherwise within 1e-5 of an edge."""
    rng = np.random.default_rng(seed)
    triangles = rng.normal(size=(6, 3, 3))
    vertices, faces = triangles.reshape(-1, 3), np.arange(18).reshape(-1, 3)
    rays = random_rays(rng)
    t, index = hit_mesh(rays, triangles, mesh_caster(vertices, faces))
    for at, direction in each_ray(rays):
        # Float32 may add or lose a hit at a border: the shrunken and the grown triangles bracket it.
        inner, outer = (reference.triangles_hit(rays.origin, direction, scaled(triangles, size))
                        for size in (1 - 1e-4, 1 + 1e-4))
        if inner is None or outer is None or inner[1] != outer[1]:
            assert np.isinf(t[at]) == (outer is None) or inner != outer
            continue
        expected = reference.triangle_hit(rays.origin, direction, triangles[inner[1]])
        assert index[at] == inner[1]
        assert t[at] == pytest.approx(float(expected), rel=1e-11)


def scaled(triangles, size):
    middle = triangles.mean(axis=1, keepdims=True)
    return middle + (triangles - middle) * size


@needs_embree
@dtypes
@pytest.mark.parametrize("origin", [(0.1, 0.2, 0.3), (0.0, 0.0, 0.0), (0.0, 0.0, 4.0)])
@pytest.mark.parametrize("aim", ["vertices", "edges", "anywhere"])
def test_no_ray_slips_through_a_closed_mesh(dtype, origin, aim):
    """From inside, or into the body from outside: whatever is aimed at, the ray stops at the first wall."""
    rng = np.random.default_rng(5)
    vertices, faces = ball(4)
    corners = vertices[faces][rng.integers(0, len(faces), 20000)]
    weights = {"vertices": np.array([[1.0, 0, 0]]), "anywhere": rng.dirichlet((1, 1, 1), 20000),
               "edges": np.pad(rng.dirichlet((1, 1), 20000), ((0, 0), (0, 1)))}[aim]
    points = (corners * weights[..., np.newaxis]).sum(axis=1) * (0.98 if origin[2] > 1 else 1.0)
    rays = bundle(origin, points - origin, dtype)
    t, _ = hit_mesh(rays, vertices[faces], mesh_caster(vertices, faces))
    assert np.isfinite(t).all()
    # The point aimed at is on or in the ball, so the wall is no further; float32 may choose 1e-4 amiss.
    assert (t <= 1.0 + 1e-4).all() if origin[2] > 1 else (np.abs(t - 1.0) < 1e-4).all()


@needs_embree
@pytest.mark.parametrize("scale", [1e-4, 1.0, 1e5])
def test_mesh_depth_has_float64_digits_at_any_size(scale):
    """Embree works in float32, the depth does not: a far, tilted triangle, t known in closed form."""
    pose = Transform(scale=(scale,) * 3, translate=(scale, 0, 0)).world_from_local
    corners = np.array([[-1.0, -1, -3], [1, -1, -3], [0, 1, -5]]) @ pose[:3, :3].T + pose[:3, 3]
    rays = bundle((scale * 1.1, scale * 0.1, 0.0), [(0, 0, -1)])
    t, _ = hit_mesh(rays, corners[np.newaxis], mesh_caster(corners, np.array([[0, 1, 2]])))
    assert t[0, 0] == pytest.approx(4.1 * scale, rel=1e-14)


@pytest.mark.parametrize("tilt", [0.0, 1e-12])
def test_a_triangle_seen_edge_on_keeps_its_depth(tilt):
    """Float32 may choose a triangle that the ray passes by 1e-7: its plane is met elsewhere or nowhere."""
    triangle = np.array([[[tilt, -1.0, -2.0], [0.0, 1.0, -3.0], [-tilt, -1.0, -4.0]]])
    rays = bundle((0.0, 0.0, 0.0), [(1e-7, 0, -1), (0, 0, -1)])
    t, _ = hit_mesh(rays, triangle, lambda origins, directions: np.zeros(len(origins), np.int32))
    assert ((t >= 2.0 - 1e-6) & (t <= 4.0 + 1e-6)).all()


def test_without_embree_the_message_names_the_command(monkeypatch):
    monkeypatch.setitem(sys.modules, "embreex", None)
    monkeypatch.setitem(sys.modules, "embreex.mesh_construction", None)
    with pytest.raises(InputError, match=r"needs Embree: python -m pip install 'froxel-ref\[mesh\]'"):
        mesh_caster(*TETRAHEDRON)


@pytest.mark.parametrize("corner", [0.0, 1e16])
def test_a_mesh_that_shrank_to_a_point_is_not_hit(corner: float) -> None:
    cast = mesh_caster(np.full((3, 3), corner), np.array([[0, 1, 2]]))
    assert cast(np.array([[0.1, 0.1, 5.0]]), np.array([[0.0, 0.0, -1.0]])).tolist() == [-1]
