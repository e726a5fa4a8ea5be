"""Particles in the image: against a scalar loop, by hand, and what they must not depend on."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
import reference_particles as reference
from hypothesis import given
from hypothesis import strategies as st

from froxel_ref import particles as module
from froxel_ref.apply import fog_lookup
from froxel_ref.assets import Assets
from froxel_ref.billboards import PROFILES, placed_particles
from froxel_ref.buffers import Integrated
from froxel_ref.geometry import camera_rays
from froxel_ref.particles import draw_order, render_particles, scattered_light
from froxel_ref.records import InputError
from froxel_ref.scene import Camera, DirectionalLight, Particle, PointLight, Scene, SpotLight
from froxel_ref.settings import Grid

EPS = float(np.finfo(np.float64).eps)
TEXTURES = {"corner.npy": np.array([[1.0, 0.0], [0.0, 0.0]]),
            "noise.npy": np.random.default_rng(8).random((3, 5))}
AHEAD = Camera(position=(0, 0, 0), target=(0, 0, -1), vertical_fov=90, width=8, height=8)
CLEAR = Integrated(np.zeros((3, 1, 1, 1)), np.ones((1, 1, 1)), np.zeros((3, 1, 1)), np.ones((1, 1)))


def ready(*particles, dtype=np.float64):
    assets = Assets({}, {}, {}, None, None, opacities=TEXTURES)
    return placed_particles(Scene(particles=particles), assets, dtype=dtype)


def clear(rows, columns, depth):
    return np.zeros((3, 1), depth.dtype), np.ones(1, depth.dtype)


def white(points, index):
    return np.ones((3, len(index)), points[0].dtype)


def drawn(*particles, camera=AHEAD, depth=None, light_on=white, fog_at=clear, dtype=np.float64, **how):
    shape = camera.height, camera.width
    depth = np.full(shape, np.inf) if depth is None else depth
    return render_particles(ready(*particles), camera, camera_rays(camera, camera.width, camera.height, dtype=dtype),
                            depth.astype(dtype), light_on, fog_at, **how)


def strewn(rng, count, *, profiles=PROFILES, textures=TEXTURES):
    def one():
        texture = rng.choice([None, None, *textures])
        return Particle(position=tuple(rng.uniform((-2, -2, -6), (2, 2, 1)).tolist()), size=float(rng.uniform(0.3, 3)),
                        rotation=float(rng.uniform(-400, 400)), opacity=float(rng.random()),
                        profile=str(rng.choice(profiles)), texture=None if texture is None else str(texture))
    return tuple(one() for _ in range(count))


# --- the scalar loop --------------------------------------------------------------------------------


def scalar_light(point, particle):
    return [1.0 + math.sin(point[0]), 2.0 + math.cos(point[1]) * particle.opacity, point[2] ** 2]


def scalar_fog(row, column, depth):
    passed = [math.exp(-s * depth) * (1.0 + 0.1 * row) for s in (0.1, 0.2, 0.3)]
    return [0.5 * depth, 0.1 * column, 1.0], passed


def light_on_of(particles):
    opacity = np.array([each.opacity for each in particles])

    def light_on(points, index):
        x, y, z = points
        return np.stack([1 + np.sin(x), 2 + np.cos(y) * opacity[index].astype(x.dtype), z**2])
    return light_on


def fog_at(rows, columns, depth):
    passed = np.exp(-np.array([[0.1], [0.2], [0.3]], depth.dtype) * depth) * (1 + 0.1 * rows).astype(depth.dtype)
    return np.stack([0.5 * depth, (0.1 * columns).astype(depth.dtype), np.ones_like(depth)]), passed


def by_hand(particles, camera, depth):
    rays = camera_rays(camera, camera.width, camera.height)
    ways = [np.broadcast_to(part, depth.shape) for part in rays.per_depth]
    forward = reference.unit(reference.minus(camera.target, camera.position))
    centres = [reference.dot(reference.minus(each.position, camera.position), forward) for each in particles]
    return reference.image(particles, TEXTURES, (rays.origin, ways), depth.tolist(), centres, scalar_light, scalar_fog)


@pytest.mark.parametrize(("seed", "up"), [(1, (0, 1, 0)), (2, (0.3, 1, 0)), (3, (0, 1, 0)), (4, (1, -0.2, 0))])
def test_the_image_is_that_of_the_scalar_loop(seed, up):
    rng = np.random.default_rng(seed)
    camera = Camera(position=(0.1, -0.2, 0.3), target=tuple(rng.uniform((-1, -1, -4), (1, 1, -3)).tolist()), up=up,
                    vertical_fov=70, width=17, height=12)
    # One wider than the way to it, one at the camera, one behind it that reaches before it, and one that it stands
    # beside, so that rays backwards would meet it.
    particles = (*strewn(rng, 14), Particle(position=(0.1, -0.2, 0.28), size=3), Particle(position=(0.1, -0.2, 0.3)),
                 Particle(position=(0.8, -0.2, 0.35), size=3, profile="square", opacity=0.3),
                 Particle(position=(0.15, -0.15, 0.3), size=4, profile="square", opacity=0.6))
    depth = np.where(rng.random((12, 17)) < 0.3, np.inf, rng.uniform(0.5, 8, (12, 17)))
    got = drawn(*particles, camera=camera, depth=depth, light_on=light_on_of(particles), fog_at=fog_at)
    radiance, through = by_hand(particles, camera, depth)
    # Places on squares are off by some ulp of (distance/half edge)/(slope of the ray), here at most some hundreds.
    np.testing.assert_allclose(got.radiance, radiance, rtol=1e-11, atol=1e-12)
    np.testing.assert_allclose(got.transmittance, through, rtol=1e-11, atol=1e-12)
    assert np.count_nonzero(got.transmittance < 1) > 60


def test_single_precision_is_near_to_double():
    """Of soft particles, whose opacity has no jump for a rounding to fall over."""
    rng = np.random.default_rng(5)
    particles = tuple(dataclasses.replace(each, profile="soft", texture=None) for each in strewn(rng, 15))
    double, single = (drawn(*particles, light_on=light_on_of(particles), fog_at=fog_at, dtype=dtype)
                      for dtype in (np.float64, np.float32))
    assert single.radiance.dtype == single.transmittance.dtype == np.float32
    assert np.abs(single.radiance - double.radiance).max() < 1e-4  # measured: 4e-6, of radiances up to 20
    assert np.abs(single.transmittance - double.transmittance).max() < 1e-5


# --- by hand ----------------------------------------------------------------------------------------


def colours(*every):
    return lambda points, index: np.array(every, np.float64)[index].T


def test_the_nearer_lies_over_the_farther():
    """Centre pixels of a red one at 2 m and a green one at 3 m, in both orders of the scene."""
    near = Particle(position=(0, 0, -2), size=2, opacity=0.5, profile="square")
    far = Particle(position=(0, 0, -3), size=2, opacity=0.25, profile="square")
    red, green = (1, 0, 0), (0, 1, 0)
    for pair, tints in (((near, far), (red, green)), ((far, near), (green, red))):
        got = drawn(*pair, light_on=colours(*tints))
        assert got.radiance[:, 4, 4].tolist() == [0.5, 0.125, 0.0]
        assert got.transmittance[4, 4] == 0.375


def test_order_is_that_of_view_depths_not_of_distances():
    """The one at the side is farther away and still lies before the other; of equal depths the later one does."""
    side, middle = Particle(position=(3, 0, -2), size=9), Particle(position=(0, 0, -2.5))
    assert draw_order(ready(side, middle), AHEAD).tolist() == [1, 0]
    level = [dataclasses.replace(side, position=(x, 0, -2)) for x in (0.0, 1.0, -1.0)]
    assert draw_order(ready(*level, middle), AHEAD).tolist() == [3, 0, 1, 2]
    assert draw_order(ready(level[0], middle), dataclasses.replace(AHEAD, position=(0, 0, -5))).tolist() == [0, 1]


def test_a_surface_hides_what_is_not_nearer():
    one, depth = Particle(position=(0, 0, -2), size=40, opacity=0.5, profile="square"), np.full((8, 8), np.inf)
    depth[0], depth[1], depth[2] = 2.0, np.nextafter(2.0, 3.0), 1.0
    got = drawn(one, depth=depth)
    assert got.transmittance[0].tolist() == got.transmittance[2].tolist() == [1.0] * 8
    assert got.transmittance[1].tolist() == got.transmittance[3].tolist() == [0.5] * 8


def test_a_floor_cuts_a_particle():
    """The square stands upright before a level camera 1 m above the floor: what lies lower than −1 is cut."""
    camera = dataclasses.replace(AHEAD, width=64, height=64)
    rays = camera_rays(camera, 64, 64)
    down = np.broadcast_to(rays.per_depth[1], (64, 64))
    floor = np.where(down < 0, -1 / np.where(down < 0, down, -1), np.inf)
    got = drawn(Particle(position=(0, 0, -4), size=4, opacity=0.5, profile="square"), camera=camera, depth=floor)
    x, y = np.broadcast_to(rays.per_depth[0], (64, 64)) * 4, down * 4
    inside = (np.abs(x) < 2) & (y < 2) & (y > -1)
    np.testing.assert_array_equal(got.transmittance < 1, inside)


@pytest.mark.parametrize(("rotation", "pixel"), [(0, (3, 3)), (90, (4, 3)), (180, (4, 4)), (-90, (3, 4))])
def test_a_texture_stands_upright_and_turns_counter_clockwise(rotation, pixel):
    one = Particle(position=(0, 0, -1), size=0.5, opacity=0.5, rotation=rotation, texture="corner.npy")
    got = drawn(one)
    assert np.argwhere(got.transmittance == 0.5).tolist() == [list(pixel)]


def test_a_camera_that_rolls_sees_particles_roll():
    particles = strewn(np.random.default_rng(6), 12)
    level = drawn(*particles)
    rolled = drawn(*particles, camera=dataclasses.replace(AHEAD, up=(1, 0, 0)))  # its right is the world's −y
    np.testing.assert_allclose(rolled.transmittance, np.rot90(level.transmittance), atol=1e-13)
    assert np.unique(level.transmittance).size > 15


@given(opacity=st.lists(st.floats(0, 1), min_size=1, max_size=6))
def test_transmittances_multiply(opacity):
    got = drawn(*(Particle(position=(0, 0, -2 - i), size=99, opacity=a, profile="square")
                  for i, a in enumerate(opacity)))
    passed = math.prod(1 - a for a in opacity)
    assert np.all(np.abs(got.transmittance - passed) <= 4 * EPS)
    # What is lit with 1 adds up with what passes to 1.
    assert np.all(np.abs(got.radiance + got.transmittance - 1) <= 16 * EPS)


def test_layers_are_laid_over_one_another():
    """All at once is the far ones, then the near ones over them."""
    every = strewn(np.random.default_rng(7), 16)
    far, near = (tuple(p for p in every if (p.position[2] < -3) == behind) for behind in (True, False))
    light = [light_on_of(part) for part in (every, far, near)]
    whole, back, front = (drawn(*part, light_on=on, fog_at=fog_at)
                          for part, on in zip((every, far, near), light, strict=True))
    np.testing.assert_allclose(whole.transmittance, back.transmittance * front.transmittance, rtol=1e-14)
    np.testing.assert_allclose(whole.radiance, back.radiance * front.transmittance + front.radiance, rtol=1e-13)


def test_each_is_fogged_at_its_own_depth():
    """Opaque ones in a fog whose stored values are exact at the depth looked up: L·T + F there, not the surface's."""
    grid = Grid(width=2, height=2, depth=4, near=1.0, far=5.0, distribution="linear")
    passed = np.exp(-0.5 * np.arange(1, 5)).reshape(4, 1, 1)
    fog = Integrated(np.stack([1 - passed] * 3), passed, np.zeros((3, 1, 1)), np.ones((1, 1)))
    for depth, slices in ((2.0, 1), (4.0, 3)):
        got = drawn(Particle(position=(0, 0, -depth), size=1, opacity=1, profile="square"), light_on=colours((8, 0, 0)),
                    fog_at=fog_lookup(fog, grid, (8, 8)), depth=np.full((8, 8), 4.5))
        t = math.exp(-0.5 * slices)
        # A square across the way to its centre, here the camera's axis: one view depth all over.
        np.testing.assert_allclose(got.radiance[:, 3, 4], [8 * t + 1 - t, 1 - t, 1 - t], rtol=8 * EPS)


def test_lit_at_the_centre():
    one = Particle(position=(0, 0.5, -2), size=2, opacity=0.5, profile="square")
    got = drawn(one, light_on=lambda points, index: np.stack(points), lit_at="centre")
    on = got.transmittance < 1
    assert {tuple(value) for value in got.radiance[:, on].T.tolist()} == {(0.0, 0.25, -1.0)}
    pixels = drawn(one, light_on=lambda points, index: np.stack(points))
    assert np.unique(pixels.radiance[1]).size > 3


def test_half_extents_are_twice_the_edge():
    every = strewn(np.random.default_rng(9), 8)
    twice = tuple(dataclasses.replace(each, size=2 * each.size) for each in every)
    for a, b in zip(drawn(*every, size="half"), drawn(*twice), strict=True):
        np.testing.assert_array_equal(a, b)


@pytest.mark.parametrize("particles", [
    (), (Particle(position=(0, 0, 3)),), (Particle(position=(50, 0, -1)),), (Particle(position=(0, 0, 0), size=3),),
    (Particle(position=(0, 0, -2), opacity=0),), (Particle(position=(0, 0, -9), size=3),)])
def test_nothing_to_see_is_one_texel(particles):
    got = drawn(*particles, depth=np.full((8, 8), 5.0))
    assert (got.radiance.tolist(), got.transmittance.tolist()) == ([[[0.0]]] * 3, [[1.0]])


@pytest.mark.parametrize("z", [-1, 1])
def test_a_particle_at_the_camera_is_left_out(z):
    camera = dataclasses.replace(AHEAD, target=(0, 0, z))
    got = drawn(Particle(position=(0, 0, 0), size=3, profile="square"), camera=camera)
    assert got.transmittance.tolist() == [[1.0]]


def test_batches_make_no_difference(monkeypatch):
    every = strewn(np.random.default_rng(10), 16)
    how = {"camera": dataclasses.replace(AHEAD, width=32, height=32), "light_on": light_on_of(every), "fog_at": fog_at}
    whole = drawn(*every, **how)
    for block in (1, 500, 2000):
        monkeypatch.setattr(module, "BLOCK", block)
        for a, b in zip(drawn(*every, **how), whole, strict=True):
            np.testing.assert_array_equal(a, b)


def test_only_pixels_under_particles_are_lit_and_fogged():
    lit = []

    def counted(points, index):
        lit.append(len(index))
        return white(points, index)

    got = drawn(*strewn(np.random.default_rng(11), 6), light_on=counted,
                camera=dataclasses.replace(AHEAD, width=64, height=64))
    assert 0 < sum(lit) <= 6 * np.count_nonzero(got.transmittance < 1)


def test_what_is_refused():
    with pytest.raises(InputError, match="lit_at: is 'corner', must be one of pixel, centre"):
        drawn(lit_at="corner")
    with pytest.raises(InputError, match="size: is 'radius', must be one of edge, half"):
        drawn(size="radius")


# --- light ------------------------------------------------------------------------------------------

LIGHTS = (
    PointLight(position=(1, 2, -3), intensity=(3, 2, 1), radius=3),
    DirectionalLight(direction=(1, 2, 3), irradiance=(0.5, 1, 0.25)),
    SpotLight(position=(0, 3, -2), intensity=(1, 5, 2), direction=(0, -1, -0.3), outer_angle=60, radius=8),
    PointLight(position=(-2, 0, -2), intensity=(2, 2, 2), falloff="inverse_square", radius=0.5),
    PointLight(position=(0, 0, -2), intensity=(0, 0, 0)),
    PointLight(position=(40, 0, -2), intensity=(1, 1, 1), radius=3),
)
VIEWER = (0.1, 0.2, 0.3)


def lobe(cosine, g):
    return (1 - g * g) / (4 * math.pi * (1 + g * g - 2 * g * cosine) ** 1.5)


def irradiance(light, point):
    """The unit vector to the light and what arrives, per unit of its colour."""
    if isinstance(light, DirectionalLight):
        return reference.unit(light.direction), 1.0
    way = reference.minus(light.position, point)
    d2 = reference.dot(way, way)
    factor = 1 / max(d2, light.min_distance**2)
    if light.falloff == "windowed":
        factor *= max(1 - (d2 / light.radius**2) ** 2, 0.0) ** 2
    towards = reference.unit(way)
    if isinstance(light, SpotLight):
        inner, outer = (math.cos(math.radians(a)) for a in (light.inner_angle, light.outer_angle))
        cosine = -reference.dot(towards, reference.unit(light.direction))
        factor *= min(max((cosine - outer) / (inner - outer), 0.0), 1.0) ** 2
    return towards, factor


def lit(rng, count=40):
    """Particles, points on them, and which is whose."""
    every = tuple(dataclasses.replace(each, phase_anisotropy=float(rng.uniform(-0.9, 0.9)),
                                      albedo=tuple(rng.random(3).tolist())) for each in strewn(rng, 12))
    index = rng.integers(12, size=count)
    centre = np.array([every[i].position for i in index]).T
    return every, index, centre + rng.uniform(-0.1, 0.1, (3, count))


def dim(points, normal=None):
    return 0.5 + 0.25 * np.sin(points[0])


def test_light_is_single_scattering():
    every, index, points = lit(np.random.default_rng(1))
    got = scattered_light(ready(*every), LIGHTS, VIEWER, ambient=(0.1, 0.2, 0.3), visibility={0: dim, 1: dim})(
        tuple(points), index)
    for k, i in enumerate(index):
        point = tuple(points[:, k].tolist())
        to_viewer = reference.unit(reference.minus(VIEWER, point))
        for c in range(3):
            total = (0.1, 0.2, 0.3)[c]
            for number, light in enumerate(LIGHTS):
                tint = light.irradiance[c] if isinstance(light, DirectionalLight) else light.intensity[c]
                towards, factor = irradiance(light, point)
                share = 0.5 + 0.25 * math.sin(point[0]) if number < 2 else 1.0
                total += (lobe(-reference.dot(to_viewer, towards), every[i].phase_anisotropy) * factor * tint * share)
            # The window and the cone lose some digits where they end; the lobe's textbook form likewise.
            assert got[c, k] == pytest.approx(every[i].albedo[c] * total, rel=1e-12)


@pytest.mark.parametrize("dtype", [np.float64, np.float32])
def test_leaving_out_far_lights_changes_no_bit(dtype):
    rng = np.random.default_rng(2)
    every, index, points = lit(rng, 400)
    lights = [PointLight(position=tuple(rng.uniform(-9, 9, 3).tolist()), intensity=(1, 2, 3),
                         radius=float(rng.uniform(0.5, 6))) for _ in range(60)]
    place = tuple(points.astype(dtype))
    for size in ("edge", "half"):
        all_, near = (scattered_light(ready(*every), [*LIGHTS, *lights], VIEWER, visibility={0: dim, 9: dim}, size=size,
                                      restrict=restrict)(place, index) for restrict in (False, True))
        np.testing.assert_array_equal(all_, near)
        assert near.dtype == dtype
    reached = module._reached(ready(*every), lights, "edge")
    assert 0 < sum(near.sum() for near in reached) < 0.7 * 60 * 12


def test_few_pairs_at_a_time_make_no_difference(monkeypatch):
    every, index, points = lit(np.random.default_rng(3))
    whole = scattered_light(ready(*every), LIGHTS, VIEWER)(tuple(points), index)
    monkeypatch.setattr(module, "PAIRS", 1)
    np.testing.assert_array_equal(scattered_light(ready(*every), LIGHTS, VIEWER)(tuple(points), index), whole)


def test_a_white_particle_in_even_light_is_as_bright_as_the_light():
    got = scattered_light(ready(Particle(position=(0, 0, -1), phase_anisotropy=0.7)), [], VIEWER, ambient=(1, 2, 3))
    assert got((np.zeros(1), np.zeros(1), -np.ones(1)), np.array([0])).ravel().tolist() == [1, 2, 3]


def test_light_is_finite_at_the_lamp_and_at_the_viewer():
    one = ready(Particle(position=(1, 2, -3), phase_anisotropy=0.999), Particle(position=VIEWER, phase_anisotropy=-0.9))
    points = tuple(np.array([a, b]) for a, b in zip((1.0, 2.0, -3.0), VIEWER, strict=True))
    assert np.isfinite(scattered_light(one, LIGHTS, VIEWER)(points, np.array([0, 1]))).all()


def test_a_particle_towards_a_light_is_bright():
    """g > 0 looks brightest where the light stands behind it."""
    sun = DirectionalLight(direction=(0, 0, -1), irradiance=(1, 1, 1))
    ahead, back = ((np.zeros(1), np.zeros(1), np.array([z])) for z in (-2.0, 2.0))
    light_on = scattered_light(ready(Particle(position=(0, 0, -2), phase_anisotropy=0.5)), [sun], (0.0, 0.0, 0.0))
    assert light_on(ahead, np.array([0]))[0, 0] == pytest.approx(lobe(1, 0.5))
    assert light_on(back, np.array([0]))[0, 0] == pytest.approx(lobe(-1, 0.5))
