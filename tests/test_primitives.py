"""Hits with planes, spheres and boxes against exact rational and 60-digit arithmetic."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest
import reference_geometry as reference
from hypothesis import given, settings
from hypothesis import strategies as st

from froxel_ref.geometry import Rays, camera_rays
from froxel_ref.primitives import box_normals, hit_box, hit_plane, hit_sphere
from froxel_ref.scene import Camera, Transform

EPS = np.finfo(np.float64).eps
seeds = st.integers(0, 2**32 - 1)
dtypes = pytest.mark.parametrize("dtype", [np.float64, np.float32])


def bundle(origin, directions, dtype=np.float64):
    """Rays of one row through the given directions."""
    d = np.asarray(directions, dtype).reshape(1, -1, 3)
    return Rays(origin, tuple(np.ascontiguousarray(d[..., i]) for i in range(3)),
                np.sqrt((d.astype(np.float64)**2).sum(axis=-1)).astype(dtype))


def random_rays(rng, dtype=np.float64, distance=6.0):
    """Rays of a camera somewhere around the origin, looking past it."""
    camera = Camera(position=tuple(rng.normal(size=3) * rng.uniform(0.0, distance)),
                    target=tuple(rng.normal(size=3)), up=tuple(rng.normal(size=3)),
                    vertical_fov=rng.uniform(10.0, 120.0))
    return camera_rays(camera, 5, 4, dtype=dtype)


def each_ray(rays):
    """Every ray's index and direction, as the floats that they are."""
    shape = rays.length.shape
    full = [np.broadcast_to(c, shape) for c in rays.per_depth]
    for j, i in np.ndindex(shape):
        yield (j, i), tuple(float(c[j, i]) for c in full)


# --- plane ------------------------------------------------------------------------------------------


def test_plane_by_hand():
    """2 m above the floor: a ray falling by ½ m per metre meets it at 4 m, from below never."""
    rays = bundle((0.0, 2.0, 0.0), [(0, -0.5, -1), (0, 0.5, -1), (0, 0, -1), (3, -4, -1)])
    assert hit_plane(rays, (7.0, 0.0, 7.0), (0.0, 3.0, 0.0)).tolist() == [[4.0, np.inf, np.inf, 0.5]]
    assert hit_plane(rays, (0.0, 2.0, 0.0), (0.0, 1.0, 0.0)).tolist() == [[np.inf] * 4]  # from within it


def test_plane_keeps_compact_axes():
    rays = camera_rays(Camera(), 8, 6)
    assert hit_plane(rays, (0.0, 0.0, 0.0), (0.0, 1.0, 0.0)).shape == (6, 1)
    assert hit_plane(rays, (0.0, 0.0, -5.0), (0.0, 0.0, 1.0)).shape == (1, 1)


@dtypes
@given(seeds)
def test_plane_hits_lie_on_the_plane(dtype, seed):
    rng = np.random.default_rng(seed)
    rays = random_rays(rng, dtype)
    point, normal = tuple(rng.normal(size=3).tolist()), tuple(rng.normal(size=3).tolist())
    t = np.broadcast_to(hit_plane(rays, point, normal), rays.length.shape)
    assert t.dtype == dtype
    for index, direction in each_ray(rays):
        expected = reference.plane_hit(rays.origin, direction, point, normal)
        if expected is None or not np.isfinite(t[index]):
            assert expected is None
            assert not np.isfinite(t[index])
            continue
        # n·(o + tD − p): a product of two roundings for each of n·D's terms, and t's own.
        size = sum(abs(n) * (abs(p - o) + t[index] * abs(d)) for n, p, o, d in
                   zip(normal, point, rays.origin, direction, strict=True))
        at = [Fraction(o) + Fraction(float(t[index])) * Fraction(d) - Fraction(p)
              for o, d, p in zip(rays.origin, direction, point, strict=True)]
        assert abs(reference.dot(normal, [float(a) for a in at])) <= 8 * np.finfo(dtype).eps * size


# --- sphere -----------------------------------------------------------------------------------------


def test_sphere_by_hand():
    """From (0, 0, 5): unit sphere straight ahead at 4 m, at its rim, beside it, behind."""
    rays = bundle((0.0, 0.0, 5.0), [(0, 0, -1), (0.3, 0, -1), (0, 0, 1)])
    assert hit_sphere(rays, (0.0, 0.0, 0.0), 1.0).tolist() == [[4.0, np.inf, np.inf]]
    assert hit_sphere(rays, (0.0, 0.0, 4.0), 2.0)[0, [0, 2]].tolist() == [3.0, 1.0]  # from inside
    assert hit_sphere(bundle((0.0, 0.0, 1.0), [(0, 0, -1), (0, 0, 1), (1, 0, 0)]),
                      (0.0, 0.0, 0.0), 1.0).tolist() == [[2.0, np.inf, np.inf]]  # from its surface


@dtypes
@given(seeds, st.sampled_from([0.2, 6.0, 1e3, 1e6]))
def test_sphere_hits_lie_on_the_sphere(dtype, seed, distance):
    """Radially within some ulp of the distance, however far, near, grazing, inside or outside."""
    rng = np.random.default_rng(seed)
    center, radius = tuple(rng.normal(size=3).tolist()), float(rng.uniform(0.1, 3.0))
    origin = rng.normal(size=3) * distance
    # Aim near the silhouette for some rays, at the body for the others.
    aims = rng.normal(size=(12, 3))
    aims *= (radius * rng.choice([0.3, 0.9999999, 1.0000001, 1.3], (12, 1))
             / np.linalg.norm(aims, axis=1, keepdims=True))
    directions = (center + aims - origin) / max(distance, 1.0)
    rays = bundle(tuple(origin.tolist()), directions, dtype)
    t = hit_sphere(rays, center, radius)
    assert t.dtype == dtype
    reach = np.linalg.norm(origin - center)
    # q, q×D and the roots each round a few times, relative to |q|; a camera near the wall sees r instead.
    bound = 16 * np.finfo(dtype).eps * (reach + radius)
    for index, direction in each_ray(rays):
        expected, gap = reference.sphere_hit(rays.origin, direction, center, radius)
        if not np.isfinite(t[index]):
            # Missed: really outside, grazing within the bound, or leaving a wall that it stands on.
            if expected is not None:
                assert radius - reference.distance_to_ray(rays.origin, direction, center) <= bound
            continue
        assert expected is not None or gap <= bound
        with reference.mpmath.workdps(60):
            at = [reference.mpmath.mpf(o) + reference.mpmath.mpf(float(t[index])) * d - c
                  for o, d, c in zip(rays.origin, direction, center, strict=True)]
            assert abs(reference.mpmath.sqrt(reference.dot(at, at)) - radius) <= bound


def test_sphere_keeps_digits_where_the_plain_quadratic_has_none():
    """A 1 m sphere 10⁸ m away: b² − 4ac is all rounding error there, |q×D|² is not."""
    rays = bundle((0.0, 0.0, 1e8), [(0, 0, -1), (0.5e-8, 0, -1), (2e-8, 0, -1)])
    t = hit_sphere(rays, (0.0, 0.0, 0.0), 1.0)
    # An ulp at 10⁸ is 1.5e-8.
    assert t[0, :2].tolist() == pytest.approx([1e8 - 1.0, 1e8 - 0.75**0.5], rel=0, abs=2e-8)
    assert t[0, 2] == np.inf


@pytest.mark.parametrize(("gap", "directions"), [(2.0**-13, [(0, 0, -1), (0.3, 0.2, -1)]),
                                                 (-2.0**-13, [(0, 0, 1), (0.3, 0.2, 1)])])
def test_sphere_seen_from_close_to_its_wall(gap, directions):
    """0.1 mm from the wall, on either side: b − √s has three digits in float32, c/(b + √s) all of them."""
    rays = bundle((0.0, 0.0, 1.0 + gap), directions, np.float32)
    t = hit_sphere(rays, (0.0, 0.0, 0.0), 1.0)
    for index, direction in each_ray(rays):
        expected, _ = reference.sphere_hit(rays.origin, direction, (0.0, 0.0, 0.0), 1.0)
        assert float(t[index]) == pytest.approx(float(expected), rel=8 * float(np.finfo(np.float32).eps))


# --- box --------------------------------------------------------------------------------------------


def test_box_by_hand():
    """The cube seen from (0, 0, 4): its front at 3 m; past its side; from behind; a 2 m slab."""
    rays = bundle((0.0, 0.0, 4.0), [(0, 0, -1), (0.5, 0, -1), (0, 0, 1), (0.3, 0.1, -1)])
    t, axis = hit_box(rays, np.eye(4))
    assert t.tolist() == [[3.0, np.inf, np.inf, 3.0]]
    assert axis[0, [0, 3]].tolist() == [2, 2]
    wide = Transform(scale=(2, 1, 1)).world_from_local
    t, axis = hit_box(bundle((0.0, 3.0, 0.0), [(0.5, -1, 0), (1.5, -1, 0)]), wide)
    assert (t.tolist(), int(axis[0, 0])) == ([[2.0, np.inf]], 1)


@pytest.mark.parametrize(("origin", "direction", "expected"), [
    ((0.0, 0.0, 0.0), (0, 0, -1), (1.0, 2)),        # inside: the wall where it leaves
    ((0.5, 0.0, 0.0), (1, 0.25, 0), (0.5, 0)),
    ((0.0, 5.0, 0.0), (0, -1, 0), (4.0, 1)),        # two components of 0, inside both slabs
    ((2.0, 5.0, 0.0), (0, -1, 0), None),            # parallel to x, outside that slab
    ((1.0, 5.0, 0.0), (0, -1, 0), (4.0, 1)),        # running within a face: 0/0 in the slab test
    ((1.0, 0.0, 0.0), (1, 0, 0), None),             # standing on a face, leaving
    ((1.0, 0.0, 0.0), (-1, 0, 0), (2.0, 0)),        # standing on a face, entering: the far wall
    ((-3.0, -3.0, 0.0), (1, 1, 0), (2.0, 0)),       # on an edge the first axis wins
    ((0.0, -3.0, -3.0), (0, 1, 1), (2.0, 1)),
    ((-3.0, -3.0, -3.0), (1, 1, 1), (2.0, 0)),      # a corner
    ((0.0, 0.0, 0.0), (0, 1, 1), (1.0, 1)),         # leaving through an edge
])
def test_box_where_slabs_are_delicate(origin, direction, expected):
    t, axis = hit_box(bundle(origin, [direction]), np.eye(4))
    assert (None if np.isinf(t[0, 0]) else (float(t[0, 0]), int(axis[0, 0]))) == expected


def test_box_keeps_compact_axes():
    """A level camera along z sees each slab of an upright box along one axis only; their meet is whole."""
    rays = camera_rays(Camera(position=(0, 0, 4), target=(0, 0, 0)), 8, 6)
    t, axis = hit_box(rays, np.eye(4))
    assert (t.shape, axis.shape) == ((6, 8), (6, 8))


@dtypes
@settings(max_examples=30)
@given(seeds)
def test_box_agrees_with_its_six_faces_in_rationals(dtype, seed):
    rng = np.random.default_rng(seed)
    rays = random_rays(rng, dtype)
    pose = np.eye(4)
    pose[:3, :3] = rng.normal(size=(3, 3)) + 1.5 * np.eye(3)[rng.permutation(3)]
    pose[:3, 3] = rng.normal(size=3)
    t, axis = (np.broadcast_to(r, rays.length.shape) for r in hit_box(rays, pose))
    assert t.dtype == dtype
    inverse = np.linalg.inv(pose[:3, :3])
    weight = np.abs(inverse) @ np.abs(pose[:3, :3]).sum(axis=1)  # how the inverse magnifies rounding
    reach = (np.abs(inverse) @ (np.abs(rays.origin) + np.abs(pose[:3, 3]))).max()
    for index, direction in each_ray(rays):
        hits = reference.box_hits(rays.origin, direction, pose)
        slope = np.abs(inverse) @ np.abs(direction)
        # Rounding in local space: relative to the terms of M·D·t and of M·(o − c), a few times each.
        depth = min(float(t[index]), 1e3)
        bound = 32 * np.finfo(dtype).eps * weight.max() * (slope.max() * depth + reach + 1.0)
        if not np.isfinite(t[index]):
            # Nothing is there, or the ray cuts off less of an edge than rounding can tell.
            assert not hits or chord(hits) * np.linalg.norm(inverse @ direction) <= 1e3 * bound
            continue
        place = inverse @ (np.asarray(rays.origin) + float(t[index]) * np.asarray(direction) - pose[:3, 3])
        assert abs(abs(place[axis[index]]) - 1.0) <= bound
        assert np.abs(place).max() <= 1.0 + bound
        if hits and axis[index] == hits[0][1]:
            across = abs(float((inverse @ direction)[axis[index]]))
            assert abs(float(t[index]) - float(hits[0][0])) <= bound / across


def chord(hits):
    """How much of a ray is inside a box that it enters and leaves."""
    return float(hits[-1][0] - hits[0][0])


@given(seeds)
def test_box_normals_are_across_its_faces(seed):
    rng = np.random.default_rng(seed)
    pose = np.eye(4)
    pose[:3, :3] = rng.normal(size=(3, 3)) + 2.0 * np.eye(3)
    normals = box_normals(pose)
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1.0, rtol=4 * EPS)
    edges = pose[:3, :3].T / np.linalg.norm(pose[:3, :3].T, axis=1, keepdims=True)
    off = ~np.eye(3, dtype=bool)
    np.testing.assert_allclose((normals @ edges.T)[off], 0.0, atol=64 * EPS * np.linalg.cond(pose[:3, :3]))
