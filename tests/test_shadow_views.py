"""Where shadow maps look: bases, cascades that cover and do not shimmer, cube faces, octants."""

from __future__ import annotations

import dataclasses
import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from froxel_ref.grid import froxel_points, make_froxels
from froxel_ref.scene import Camera, DirectionalLight, PointLight, SpotLight
from froxel_ref.settings import Grid, ShadowMaps
from froxel_ref.shadow_lookup import cube_faces, octahedral_square
from froxel_ref.shadow_raster import raster_rays
from froxel_ref.shadow_views import (
    CASCADE_EDGE,
    CUBE_FACES,
    cascade_splits,
    cascade_views,
    cube_views,
    octant_views,
    raster_from_world,
    shadow_basis,
    spot_view,
)

EDGE = ShadowMaps().edge
UNIT = st.tuples(*[st.floats(-1, 1)] * 3).filter(lambda v: math.hypot(*v) > 0.1)
LAMP = PointLight(position=(0.5, -1.0, 2.0), intensity=(1, 1, 1))
SPOT = SpotLight(position=(0.5, -1.0, 2.0), intensity=(1, 1, 1), direction=(0.3, -0.8, 0.2), outer_angle=40)
SUN = DirectionalLight(direction=(0.3, 0.8, -0.2), irradiance=(1, 1, 1))


@given(UNIT)
def test_bases_are_turned_axes(direction):
    basis = shadow_basis(direction)
    np.testing.assert_allclose(basis @ basis.T, np.eye(3), atol=1e-14)
    np.testing.assert_allclose(basis[2] * math.hypot(*direction), direction, atol=1e-14)
    # Right, down and along: seen from the light a picture, not its mirror image.
    np.testing.assert_allclose(np.cross(basis[0], basis[1]), basis[2], atol=1e-14)


@pytest.mark.parametrize("view", [spot_view(SPOT, 12, border=2), *cube_views(LAMP, 12, border=1),
                                  *cascade_views(SUN, Camera(), Grid(), ShadowMaps(directional_size=16)),
                                  *itertools.chain(*octant_views(LAMP, 12).values())])
def test_matrices_invert_the_rays(view):
    matrix = raster_from_world(view)
    origin, way = raster_rays(view)
    for depth in (0.5, 3.0, 40.0):
        points = np.broadcast_to(origin + way * depth, (3, view.rows, view.columns))
        x, y, t = np.einsum("ij,jrc->irc", matrix[:, :3], points) + matrix[:, 3, None, None]
        if view.origin is not None:
            x, y = x / t, y / t
        row, column = np.mgrid[:view.rows, :view.columns] + 0.5
        np.testing.assert_allclose(t, np.full_like(t, depth), rtol=1e-12)
        np.testing.assert_allclose(x, column, atol=1e-10)
        np.testing.assert_allclose(y, row, atol=1e-10)


# --- cascades ---------------------------------------------------------------------------------------


def test_splits_by_hand():
    grid = Grid(near=1.0, far=81.0)
    assert cascade_splits(grid, ShadowMaps(cascades=4, split=0.0)).tolist() == [0.0, 21.0, 41.0, 61.0, 81.0]
    np.testing.assert_allclose(cascade_splits(grid, ShadowMaps(cascades=4, split=1.0)), [0, 3, 9, 27, 81])
    np.testing.assert_allclose(cascade_splits(grid, ShadowMaps(cascades=2, split=0.5)), [0, 25, 81])


def inside(views, size, points):
    """For each cascade whether points lie within 0.97 of its half width, by its own matrix."""
    x = np.stack([np.broadcast_to(p, np.broadcast_shapes(*(q.shape for q in points))).reshape(-1) for p in points])
    result = []
    for view in views:
        matrix = raster_from_world(view)
        place = matrix[:2, :3] @ x + matrix[:2, 3:]
        result.append((np.abs(place - size / 2) < CASCADE_EDGE * (size / 2 - EDGE)).all(axis=0))
    return np.array(result)


@settings(max_examples=60, deadline=None)
@given(UNIT, UNIT, st.tuples(*[st.floats(-1e3, 1e3)] * 3), st.floats(5, 150), st.integers(1, 6), st.floats(0, 1),
       st.sampled_from([16, 32, 250, 1024]), st.sampled_from([(16, 9), (4, 4), (3, 20)]))
def test_every_froxel_has_a_cascade(sun, look, place, fov, count, split, size, image):
    """No gap: what a cascade's stretch of the view holds, it reaches; nothing is beyond them all."""
    target = tuple(p + c for p, c in zip(place, look, strict=True))
    up = (0.0, 1.0, 0.0) if abs(look[1]) < 0.9 * math.hypot(*look) else (1.0, 0.0, 0.0)
    camera = Camera(position=place, target=target, up=up, vertical_fov=fov, width=image[0], height=image[1])
    grid = Grid(width=9, height=7, depth=12, near=0.3, far=90.0)
    maps = ShadowMaps(cascades=count, split=split, directional_size=size)
    light = DirectionalLight(direction=sun, irradiance=(1, 1, 1))
    views = cascade_views(light, camera, grid, maps)
    froxels = make_froxels(camera, grid, jitter=(0.5, 0.5, 0.5))
    reached = inside(views, size, froxel_points(froxels)).reshape(count, 12, -1)
    depths = froxels.depths[:, 0, 0]
    splits = cascade_splits(grid, maps)
    for k in range(count):
        assert reached[k, (depths >= splits[k]) & (depths <= splits[k + 1])].all()
    # The corners of the image at the far end are the outermost points.
    corners = make_froxels(camera, dataclasses.replace(grid, width=2, height=2), jitter=(0.0, 0.0, 0.5)).rays
    ends = [o + c * grid.far for o, c in zip(corners.origin, corners.per_depth, strict=True)]
    assert inside(views, size, ends)[-1].all()


def test_the_cover_is_close_to_what_is_needed():
    """Half as large a square would miss froxels, so the test above can fail."""
    maps = ShadowMaps(directional_size=64)
    views = [view._replace(across=view.across / 2, down=view.down / 2)
             for view in cascade_views(SUN, Camera(), Grid(), maps)]
    assert not inside(views, 64, froxel_points(make_froxels(Camera(), Grid()))).any(axis=0).all()


def test_a_moving_and_turning_camera_does_not_shimmer():
    """A point of the world stays at the same place in its texel."""
    maps, rng = ShadowMaps(directional_size=64), np.random.default_rng(3)
    points = rng.uniform(-20, 20, (3, 50))
    first = None
    for _ in range(40):
        place, look = rng.uniform(-9, 9, 3), rng.normal(size=3)
        camera = Camera(position=tuple(place.tolist()), target=tuple((place + look).tolist()))
        now = []
        for view in cascade_views(SUN, camera, Grid(), maps):
            matrix = raster_from_world(view)
            now.append(matrix[:2, :3] @ points + matrix[:2, 3:])
        first = first or now
        for a, b in zip(first, now, strict=True):
            shift = b - a
            np.testing.assert_allclose(shift, np.round(shift), atol=1e-9)


def test_a_step_within_a_texel_changes_nothing():
    maps = ShadowMaps(directional_size=64)
    here, there = (cascade_views(SUN, Camera(position=(x, 1.7, 0), target=(x, 1.7, -1)), Grid(), maps)[-1]
                   for x in (0.0, 0.01))
    assert all(np.array_equal(a, b) for a, b in zip(here, there, strict=True))


# --- cubes and octahedra ----------------------------------------------------------------------------


def test_faces_are_numbered_as_graphics_interfaces_do():
    """The table of OpenGL and Direct3D: major axis, then what s and t grow with."""
    table = ["+x -z -y", "-x +z -y", "+y +x +z", "-y +x -z", "+z +x -y", "-z -x -y"]
    axes = {"x": 0, "y": 1, "z": 2}
    for words, face in zip(table, CUBE_FACES, strict=True):
        for word, axis in zip(words.split(), face, strict=True):
            want = np.zeros(3)
            want[axes[word[1]]] = 1.0 if word[0] == "+" else -1.0
            assert axis.tolist() == want.tolist()


def test_every_direction_meets_the_face_that_faces_it():
    d = np.random.default_rng(5).normal(size=(3, 500))
    face, turn = cube_faces(*d)
    along = np.einsum("fa,an->fn", CUBE_FACES[:, 0], d)
    assert np.array_equal(face, along.argmax(axis=0))
    for got, row in zip(turn(*d), (1, 2, 0), strict=True):
        np.testing.assert_array_equal(got, (CUBE_FACES[face, row].T * d).sum(axis=0))


def fold(d):
    """The octahedral map, one direction at a time."""
    x, y, z = d / np.abs(d).sum()
    if y < 0:
        x, z = (1 - abs(z)) * math.copysign(1, x), (1 - abs(x)) * math.copysign(1, z)
    return x, z


def test_the_square_of_directions():
    d = np.random.default_rng(6).normal(size=(3, 300))
    got = np.stack(octahedral_square(*d))
    np.testing.assert_allclose(got.T, [fold(v) for v in d.T], atol=1e-15)


def test_octants_are_the_square_unfolded():
    """Every texel's ray of the eight pieces folds to that texel's centre."""
    size = 12
    for (row, column), pair in octant_views(LAMP, size).items():
        for upper, view in zip((True, False), pair, strict=True):
            _, way = raster_rays(view)
            y, x = np.mgrid[:size // 2, :size // 2] + 0.5
            u, v = 2 * (x + column * size / 2) / size - 1, 2 * (y + row * size / 2) / size - 1
            here = (np.abs(u) + np.abs(v) < 1) == upper
            inside = np.abs(np.abs(u) + np.abs(v) - 1) > 1e-9
            assert np.array_equal(((way[1] > 0) == upper)[inside], here[inside])
            got = octahedral_square(*way)
            np.testing.assert_allclose(got[0][here], u[here], atol=1e-14)
            np.testing.assert_allclose(got[1][here], v[here], atol=1e-14)
            np.testing.assert_allclose(np.abs(way[:, here]).sum(axis=0), 1.0, atol=1e-14)
