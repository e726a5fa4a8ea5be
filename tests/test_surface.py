"""The surface stage: nearest hits, Lambert shading, and that restriction and threads change no bit."""

from __future__ import annotations

import importlib.util
import math
import sys
from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest
import reference_geometry as reference
from hypothesis import given, settings
from hypothesis import strategies as st

from froxel_ref import surface
from froxel_ref.assets import Assets, fold_heights
from froxel_ref.geometry import camera_rays
from froxel_ref.records import InputError
from froxel_ref.scene import (
    Box,
    Camera,
    DirectionalLight,
    Folds,
    HeightField,
    Mesh,
    Plane,
    PointLight,
    Scene,
    Sphere,
    SpotLight,
    Transform,
)
from froxel_ref.surface import find_surfaces, imported, shade

HAS_EMBREE = importlib.util.find_spec("embreex") is not None
FOLDS = Folds(folds=2, size=9)
MESH = Mesh(path="pyramid.obj", albedo=(0.1, 0.2, 0.3))
PYRAMID = (np.array([[-1.0, -1, 0], [1, -1, 0], [0, 1, 0], [0, 0, 1]]),
           np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]]))
ASSETS = Assets(textures={}, heights={FOLDS: fold_heights(FOLDS)}, meshes={MESH: PYRAMID},
                depth=None, radiance=None)
AHEAD = Camera(position=(0, 0, 0), target=(0, 0, -1), vertical_fov=90, width=4, height=4)
EPS = np.finfo(np.float64).eps
seeds = st.integers(0, 2**32 - 1)


def random_scene(rng):
    """Surfaces and lights of every kind around the origin, and a camera among them."""
    def place():
        return tuple((rng.normal(size=3) * 3.0).tolist())

    def pose():
        return Transform(translate=place(), rotate=tuple(rng.choice([0.0, 90.0, 33.0], 3).tolist()),
                         scale=tuple(rng.uniform(0.2, 2.0, 3).tolist()))

    def rgb():
        return tuple(rng.random(3).tolist())

    surfaces = [Plane(point=place(), normal=place(), albedo=rgb())]
    surfaces += [Box(transform=pose(), albedo=rgb()) for _ in range(3)]
    surfaces += [Sphere(center=place(), radius=rng.uniform(0.1, 2), albedo=rgb()) for _ in range(2)]
    surfaces += [HeightField(heights=FOLDS, transform=pose(), albedo=rgb())]
    surfaces += [MESH] * HAS_EMBREE
    lights = [DirectionalLight(direction=place(), irradiance=rgb()),
              PointLight(position=place(), intensity=rgb(), radius=rng.uniform(0.5, 5)),
              PointLight(position=place(), intensity=rgb(), falloff="inverse_square"),
              SpotLight(position=place(), intensity=rgb(), radius=rng.uniform(2, 8), direction=place(),
                        inner_angle=20, outer_angle=50)]
    camera = Camera(position=place(), target=tuple((rng.normal(size=3) * 0.5).tolist()), width=40, height=30,
                    vertical_fov=rng.uniform(20, 110))
    return Scene(camera=camera, surfaces=tuple(surfaces), lights=tuple(lights), ambient=rgb(),
                 background=rgb())


# --- finding ----------------------------------------------------------------------------------------


def test_surfaces_by_hand():
    """Four rays at ±½: a wall at 4 m, half covered by a box whose front is at 3 m; the floor of the rest."""
    box = Box(albedo=(0.1, 0.2, 0.3), transform=Transform(translate=(-2, 0, -5), scale=(2, 9, 2)))
    wall = Plane(albedo=(0.4, 0.5, 0.6), point=(0, 0, -4), normal=(0, 0, -7))
    hits = find_surfaces([wall, box], camera_rays(AHEAD, 2, 2), ASSETS)
    assert hits.depth.tolist() == [[3.0, 4.0], [3.0, 4.0]]
    assert hits.normal[:, 0].tolist() == [[0.0, 0.0], [0.0, 0.0], [1.0, 1.0]]
    assert hits.albedo[:, 1].tolist() == [[0.1, 0.4], [0.2, 0.5], [0.3, 0.6]]


def test_nothing_is_infinitely_far_and_black():
    hits = find_surfaces([], camera_rays(AHEAD, 3, 2, dtype=np.float32), ASSETS)
    assert [array.dtype for array in hits] == [np.float32] * 3
    assert np.isposinf(hits.depth).all()
    assert hits.depth.shape == (2, 3)
    assert not hits.normal.any()
    assert not hits.albedo.any()
    assert hits.normal.shape == hits.albedo.shape == (3, 2, 3)


def test_where_two_are_equally_near_the_first_is_seen():
    planes = [Plane(albedo=(a,) * 3, point=(0, 0, -2), normal=(0, 0, 1)) for a in (0.25, 0.75)]
    assert (find_surfaces(planes, camera_rays(AHEAD, 2, 2), ASSETS).albedo == 0.25).all()
    assert (find_surfaces(planes[::-1], camera_rays(AHEAD, 2, 2), ASSETS).albedo == 0.75).all()


@pytest.mark.parametrize("thing", [
    Sphere(center=(0, 0, 0), radius=3), Box(transform=Transform(scale=(3, 4, 5), rotate=(0, 30, 0))),
    Plane(point=(0, -1, 0), normal=(0, -1, 0)), Plane(point=(0, -1, 0), normal=(0, 1, 0)),
    HeightField(heights=FOLDS, transform=Transform(translate=(0, 0, -3))),
    HeightField(heights=FOLDS, transform=Transform(translate=(0, 0, -3), rotate=(0, 180, 0))),
    pytest.param(MESH, marks=pytest.mark.skipif(not HAS_EMBREE, reason="embreex is not installed")),
], ids=lambda thing: thing.kind)
@pytest.mark.parametrize("dtype", [np.float64, np.float32])
def test_normals_are_unit_and_face_the_camera(thing, dtype):
    position = (0.1, 0.1, 3.0) if thing is MESH else (0.1, 0.2, 0.0)
    rays = camera_rays(Camera(position=position, target=(0, 0, -1)), 24, 18, dtype=dtype)
    hits = find_surfaces([thing], rays, ASSETS)
    seen = np.isfinite(hits.depth)
    assert seen.sum() > 20
    np.testing.assert_allclose((hits.normal**2).sum(axis=0)[seen], 1.0, rtol=8 * np.finfo(dtype).eps)
    facing = sum(n * d for n, d in zip(hits.normal, rays.per_depth, strict=True))
    assert (facing[seen] <= 0.0).all()
    assert not np.signbit(hits.normal[hits.normal == 0.0]).any()


def test_sphere_normals_point_from_its_centre():
    rays = camera_rays(Camera(position=(0, 0, 0), target=(1, 2, -3), vertical_fov=30), 16, 12)
    center = (1.0, 2.0, -3.0)
    hits = find_surfaces([Sphere(center=center, radius=1)], rays, ASSETS)
    seen = np.isfinite(hits.depth)
    assert seen.sum() > 20
    for i in range(3):
        place = (rays.per_depth[i] * np.where(seen, hits.depth, 0.0) - center[i])[seen]
        np.testing.assert_allclose(hits.normal[i][seen], place, atol=32 * EPS * 4)


def test_mesh_facets_have_their_own_normals():
    pytest.importorskip("embreex", reason="embreex is not installed")
    rays = camera_rays(Camera(position=(0.3, 0.2, 4), target=(0, 0, 0), vertical_fov=50), 30, 30)
    hits = find_surfaces([MESH], rays, ASSETS)
    seen = np.isfinite(hits.depth)
    found = {tuple(n) for n in hits.normal[:, seen].T.round(9).tolist()}
    # Three sides through the top (0, 0, 1) and an edge of the base, by hand: the cross product of two edges.
    sides = ((0, -2, 2), (4, 2, 2), (-4, 2, 2))
    expected = {tuple((np.array(n) / math.sqrt(reference.dot(n, n))).round(9).tolist()) for n in sides}
    assert found == expected
    np.testing.assert_allclose(hits.albedo[:, seen], np.array([MESH.albedo]).T * np.ones(seen.sum()))


@pytest.mark.parametrize("dtype", [np.float64, np.float32])
@settings(max_examples=40)
@given(seeds)
def test_restriction_changes_no_bit(dtype, seed):
    """Every surface against every ray, every light on every pixel: the same images."""
    scene = random_scene(np.random.default_rng(seed))
    rays = camera_rays(scene.camera, 40, 30, dtype=dtype)
    hits, every = (find_surfaces(scene.surfaces, rays, ASSETS, restrict=r, threads=1) for r in (True, False))
    assert all(np.array_equal(a, b) for a, b in zip(hits, every, strict=True))
    images = [shade(hits, rays, scene, restrict=restrict, threads=1) for restrict in (True, False)]
    assert np.array_equal(*images)
    assert images[0].dtype == dtype


@pytest.mark.parametrize(("block", "threads"), [(1, 1), (37 * 5, 3), (10**6, 2)])
def test_blocks_and_threads_change_no_bit(monkeypatch, block, threads):
    scene = random_scene(np.random.default_rng(11))
    rays = camera_rays(scene.camera, 37, 29)
    hits = find_surfaces(scene.surfaces, rays, ASSETS, threads=1)
    image = shade(hits, rays, scene, threads=1)
    monkeypatch.setattr(surface, "BLOCK", block)
    again = find_surfaces(scene.surfaces, rays, ASSETS, threads=threads)
    assert all(np.array_equal(a, b) for a, b in zip(hits, again, strict=True))
    assert np.array_equal(image, shade(hits, rays, scene, threads=threads))
    assert np.isfinite(hits.depth).sum() > 100


def test_arguments_are_not_changed():
    scene = random_scene(np.random.default_rng(4))
    rays = camera_rays(scene.camera, 8, 6)
    for array in (*rays.per_depth, rays.length, *PYRAMID, ASSETS.heights[FOLDS]):
        array.flags.writeable = False
    hits = find_surfaces(scene.surfaces, rays, ASSETS)
    for array in hits:
        array.flags.writeable = False
    shade(hits, rays, scene)
    for array in (*PYRAMID, ASSETS.heights[FOLDS]):
        array.flags.writeable = True


def test_a_mesh_without_embree_is_refused(monkeypatch):
    for name in ("embreex", "embreex.mesh_construction", "embreex.rtcore_scene"):
        monkeypatch.setitem(sys.modules, name, None)
    with pytest.raises(InputError, match=r"pip install 'froxel-ref\[mesh\]'"):
        find_surfaces([MESH], camera_rays(AHEAD, 2, 2), ASSETS)


# --- shading ----------------------------------------------------------------------------------------


def floor_scene(*lights, **extra):
    """Looking straight down from 2 m: one ray hits the origin."""
    camera = Camera(position=(0, 2, 0), target=(0, 0, 0), up=(0, 0, -1), width=1, height=1)
    return Scene(camera=camera, surfaces=(Plane(albedo=(0.5, 0.25, 1)),), lights=lights, **extra)


def shade_scene(scene, **options):
    rays = camera_rays(scene.camera, scene.camera.width, scene.camera.height)
    return shade(find_surfaces(scene.surfaces, rays, ASSETS), rays, scene, **options)


PI = (math.pi, math.pi, 2 * math.pi)


@pytest.mark.parametrize(("light", "arriving"), [
    (DirectionalLight(direction=(0, 3, 0), irradiance=PI), 1.0),
    (DirectionalLight(direction=(3, 4, 0), irradiance=PI), 0.8),
    (DirectionalLight(direction=(3, -4, 0), irradiance=PI), 0.0),
    # 5 m away, cosine 0.8, window (1 − (5/10)⁴)² = (15/16)².
    (PointLight(position=(0, 4, 3), intensity=PI, radius=10), 0.8 / 25 * (15 / 16)**2),
    (PointLight(position=(0, 4, 3), intensity=PI, radius=5), 0.0),
    (SpotLight(position=(0, 4, 0), intensity=PI, falloff="inverse_square"), 1 / 16),
    (SpotLight(position=(0, 4, 0), intensity=PI, direction=(1, 0, 0)), 0.0),
])
def test_lambert_by_hand(light, arriving):
    """E = π·(1, 1, 2) seen head on leaves albedo·(1, 1, 2); ambient adds albedo·ambient."""
    image = shade_scene(floor_scene(light, ambient=(0.5, 0.5, 0.5), background=(9, 9, 9)))
    expected = [0.5 * (arriving + 0.5), 0.25 * (arriving + 0.5), 2 * arriving + 0.5]
    np.testing.assert_allclose(image.ravel(), expected, rtol=16 * EPS)


def test_background_where_nothing_is_hit():
    scene = Scene(camera=AHEAD, background=(1, 2, 3), ambient=(5, 5, 5),
                  lights=(PointLight(position=(0, 0, 0), intensity=(1, 1, 1)),))
    image = shade_scene(scene)
    assert image.shape == (3, 4, 4)
    assert (image == np.array([1.0, 2.0, 3.0])[:, np.newaxis, np.newaxis]).all()


def test_visibility_multiplies_each_light():
    sun = DirectionalLight(direction=(0, 1, 0), irradiance=(math.pi,) * 3, name="sun")
    lamp = DirectionalLight(direction=(0, 1, 0), irradiance=(8 * math.pi,) * 3, name="lamp")
    asked = []

    def visible(light, points, normal):
        asked.append((light, [float(c.ravel()[0]) for c in points], [float(c.ravel()[0]) for c in normal]))
        return np.full((1, 1), (1.0, 0.25)[light])

    image = shade_scene(floor_scene(sun, lamp), visibility={i: partial(visible, i) for i in range(2)}, threads=1)
    np.testing.assert_allclose(image.ravel(), [1.5, 0.75, 3.0], rtol=16 * EPS)
    assert asked == [(0, [0.0, 0.0, 0.0], [0.0, 1.0, 0.0]), (1, [0.0, 0.0, 0.0], [0.0, 1.0, 0.0])]


def test_attenuation_is_handed_to_the_lights():
    """At 1 cm from a lamp of 4 m the author's bound on d² is 1/16, the corrected one d² itself (A6)."""
    lamp = PointLight(position=(0, 0.01, 0), intensity=(math.pi,) * 3, radius=4, min_distance=0.001)
    near, author = (shade_scene(floor_scene(lamp), attenuation=a) for a in ("min_distance", "inverse_radius"))
    np.testing.assert_allclose(near.ravel(), np.array([0.5, 0.25, 1.0]) * 1e4, rtol=1e-9)
    np.testing.assert_allclose(author.ravel(), np.array([0.5, 0.25, 1.0]) * 16, rtol=1e-9)


@settings(max_examples=20)
@given(seeds)
def test_shading_agrees_with_a_scalar_loop(seed):
    scene = random_scene(np.random.default_rng(seed))
    rays = camera_rays(scene.camera, 6, 5)
    hits = find_surfaces(scene.surfaces, rays, ASSETS)
    image = shade(hits, rays, scene)
    lights = [reference.plain(light) for light in scene.lights]
    for j, i in np.ndindex(5, 6):
        expected = scene.background
        if np.isfinite(hits.depth[j, i]):
            point = [o + float(hits.depth[j, i]) * float(np.broadcast_to(d, (5, 6))[j, i])
                     for o, d in zip(rays.origin, rays.per_depth, strict=True)]
            expected = reference.lambert(point, hits.normal[:, j, i].tolist(), hits.albedo[:, j, i].tolist(),
                                         lights, scene.ambient)
        # Measured 8e-16 over 150 scenes; windows and cones may lose more digits of little light.
        assert image[:, j, i].tolist() == pytest.approx(list(expected), rel=1e-14, abs=1e-15)


# --- images made elsewhere --------------------------------------------------------------------------


def images(depth, radiance=None):
    return SimpleNamespace(depth=np.asarray(depth, float), radiance=radiance)


def test_imported_images_are_taken_as_they_are():
    scene = Scene(camera=Camera(width=2, height=1))
    colour = np.arange(6.0).reshape(3, 1, 2)
    hits, radiance = imported(images([[2.0, np.inf]], colour), scene, dtype=np.float32)
    assert hits.depth.tolist() == [[2.0, np.inf]]
    assert (hits.depth.dtype, radiance.dtype) == (np.float32, np.float32)
    assert hits.normal.shape == hits.albedo.shape == (3, 1, 1)
    assert np.array_equal(radiance, colour)


def test_without_a_colour_image_only_the_background_shines():
    scene = Scene(camera=Camera(width=2, height=1), background=(1, 2, 3))
    _, radiance = imported(images([[2.0, np.inf]]), scene)
    assert radiance[:, 0].tolist() == [[0.0, 1.0], [0.0, 2.0], [0.0, 3.0]]


@pytest.mark.parametrize(("depth", "radiance", "message"), [
    ([[1.0, 2.0, 3.0]], None, r"image_buffers.depth: .*\(1, 3\).*\(1, 2\)"),
    ([[1.0, 0.0]], None, "image_buffers.depth: .*above 0"),
    ([[1.0, np.nan]], None, "image_buffers.depth: .*above 0"),
    ([[1.0, 2.0]], np.zeros((3, 2, 2)), r"image_buffers.radiance: .*\(2, 2\).*\(1, 2\)"),
    ([[1.0, 2.0]], np.full((3, 1, 2), np.inf), "image_buffers.radiance: .*finite"),
])
def test_bad_images_are_refused(depth, radiance, message):
    with pytest.raises(InputError, match=message):
        imported(images(depth, radiance), Scene(camera=Camera(width=2, height=1)))
