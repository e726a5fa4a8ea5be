"""Billboards: their squares by hand and against scalar loops, and what they take from lights."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
import reference_particles as reference
from hypothesis import given
from hypothesis import strategies as st

from froxel_ref import billboard_shadows, near_pairs
from froxel_ref.assets import Assets
from froxel_ref.billboard_shadows import lamp_hits, points_transmittance, sun_hits
from froxel_ref.billboards import PROFILES, facing_axes, half_extents, opacity_at, placed_particles, reaches
from froxel_ref.records import InputError
from froxel_ref.scene import DirectionalLight, Particle, PointLight, Scene
from froxel_ref.shadow_views import shadow_basis

EPS = float(np.finfo(np.float64).eps)
TEXTURES = {"corner.npy": np.array([[1.0, 0.0], [0.0, 0.0]]),
            "noise.npy": np.random.default_rng(8).random((3, 5))}
LAMP = PointLight(position=(0.3, 0.1, -0.2), intensity=(1, 1, 1))
SUN = DirectionalLight(direction=(0.4, 1.0, 0.3), irradiance=(1, 1, 1))


def ready(*particles, dtype=np.float64):
    assets = Assets({}, {}, {}, None, None, opacities=TEXTURES)
    return placed_particles(Scene(particles=particles), assets, dtype=dtype)


def drawn(rng, count, reach=3.0):
    """Particles of every kind, turned and strewn."""
    def one():
        texture = rng.choice([None, None, None, *TEXTURES])
        return Particle(position=tuple(rng.uniform(-reach, reach, 3).tolist()), size=float(rng.uniform(0.2, 2.5)),
                        rotation=float(rng.uniform(-400, 400)), opacity=float(rng.random()),
                        profile=str(rng.choice(PROFILES)), texture=None if texture is None else str(texture),
                        fom_multiplier=float(rng.choice([0.0, 0.5, 1.0, 2.0])))
    return tuple(one() for _ in range(count))


def directions(rng, count):
    way = rng.normal(size=(3, count))
    return way / np.sqrt((way * way).sum(axis=0))


# --- squares ----------------------------------------------------------------------------------------


def test_what_is_placed():
    one = Particle(position=(1, 2, 3), size=4, rotation=-90, opacity=0.5, albedo=(0.1, 0.2, 0.3),
                   phase_anisotropy=0.6, fom_multiplier=7, profile="disc")
    two = Particle(position=(0, 0, 0), rotation=60, texture="noise.npy")
    got = ready(one, two, dataclasses.replace(two, texture="corner.npy"), two)
    assert got.position[:, 0].tolist() == [1, 2, 3]
    assert (got.size[0], got.opacity[0], got.anisotropy[0], got.multiplier[0]) == (4, 0.5, 0.6, 7)
    assert got.turn[:, 0].tolist() == [0, -1]
    np.testing.assert_allclose(got.turn[:, 1], [0.5, math.sqrt(0.75)], rtol=4 * EPS)
    assert got.albedo[:, 0].tolist() == [0.1, 0.2, 0.3]
    assert got.profile.tolist() == [1, 3, 4, 3]
    assert [texture.shape for texture in got.textures] == [(3, 5), (2, 2)]
    none = ready()
    assert none.position.shape == none.albedo.shape == (3, 0)
    assert {part.dtype for part in (*ready(one, dtype=np.float32)[:7],)} == {np.dtype(np.float32)}


@given(x=st.floats(-1.2, 1.2), y=st.floats(-1.2, 1.2), kind=st.sampled_from([*PROFILES, *TEXTURES]))
def test_opacities_are_those_of_the_scalar_loop(x, y, kind):
    one = (Particle(position=(0, 0, 0), opacity=0.7, profile=kind) if kind in PROFILES else
           Particle(position=(0, 0, 0), opacity=0.7, texture=kind))
    got = opacity_at(ready(one), np.array([0]), np.array([x]), np.array([y]))
    # 1 − r² is a difference of numbers of at most 1: some ulp of 1 wherever r is.
    assert got[0] == pytest.approx(reference.opacity(one, TEXTURES, x, y), abs=8 * EPS)


def test_a_texture_has_row_0_on_top():
    """Seen along −z: the corner that is opaque lies up and to the left, at world (−x, +y)."""
    one = ready(Particle(position=(0, 0, -2), size=2, opacity=0.5, texture="corner.npy"))
    way = np.array([[-0.75, 0.75, -0.75, 0.75], [0.75, 0.75, -0.75, -0.75], [-2.0, -2.0, -2.0, -2.0]])
    hits = lamp_hits(one, (0.0, 0.0, 0.0), way / np.sqrt((way * way).sum(axis=0)))
    assert (hits.ray.tolist(), hits.tau.tolist()) == ([0], [pytest.approx(math.log(2), rel=8 * EPS)])


@pytest.mark.parametrize(("rotation", "corner"), [(90, (-0.75, -0.75)), (-90, (0.75, 0.75)), (180, (0.75, -0.75))])
def test_a_turn_is_counter_clockwise(rotation, corner):
    one = ready(Particle(position=(0, 0, -2), size=2, opacity=0.5, rotation=rotation, texture="corner.npy"))
    way = np.array([[*corner, -2.0]]).T
    assert len(lamp_hits(one, (0.0, 0.0, 0.0), way / np.sqrt((way * way).sum())).ray) == 1


@given(way=st.tuples(*[st.floats(-1, 1)] * 3).filter(lambda w: math.hypot(*w) > 1e-3), degrees=st.floats(-360, 360))
def test_axes_are_those_of_a_light_turned(way, degrees):
    along = np.array(reference.unit(way)).reshape(3, 1)
    plain = facing_axes(along, np.array([[1.0], [0.0]]))
    np.testing.assert_allclose(np.stack([axis[:, 0] for axis in plain]), shadow_basis(way)[:2], atol=32 * EPS)
    c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    right, down = facing_axes(along, np.array([[c], [s]]))
    basis = np.concatenate([right, down, along], axis=1)
    np.testing.assert_allclose(basis.T @ basis, np.eye(3), atol=32 * EPS)
    assert np.linalg.det(basis) == pytest.approx(1.0)
    for got, want in zip((right, down), reference.axes(along[:, 0].tolist(), degrees), strict=True):
        np.testing.assert_allclose(got[:, 0], want, atol=32 * EPS)


def test_sizes():
    every = ready(*(Particle(position=(0, 0, 0), size=2, profile=p) for p in PROFILES),
                  Particle(position=(0, 0, 0), size=2, texture="noise.npy"))
    root = math.sqrt(2)
    np.testing.assert_allclose(reaches(every), [root, 1, 1, root], rtol=2 * EPS)
    np.testing.assert_allclose(reaches(every, size="half"), [2 * root, 2, 2, 2 * root], rtol=2 * EPS)
    assert half_extents(every).tolist() == [1] * 4
    with pytest.raises(InputError, match="size: is 'radius', must be one of edge, half"):
        half_extents(every, size="radius")


# --- rays -------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("seed", "half"), [(1, 0.5), (2, 0.5), (3, 1.0)])
def test_lamp_hits_are_those_of_the_scalar_loop(seed, half):
    rng = np.random.default_rng(seed)
    particles, way = drawn(rng, 12), directions(rng, 300)
    # One in which the lamp nearly stands, wider than the way to it.
    particles += (Particle(position=(0.3, 0.1, -0.19), size=2, profile="square", rotation=20),)
    got = lamp_hits(ready(*particles), LAMP.position, way, size="edge" if half == 0.5 else "half")
    wanted = {}
    for ray in range(way.shape[1]):
        for i, each in enumerate(particles):
            found = reference.lamp_hit(each, TEXTURES, LAMP.position, tuple(way[:, ray].tolist()), half=half)
            if found is not None and found[1] * each.fom_multiplier > 0:
                wanted[ray, i] = found[0], -math.log1p(-found[1]) * each.fom_multiplier
    assert list(zip(got.ray.tolist(), got.particle.tolist(), strict=True)) == list(wanted)  # in that order
    assert len(wanted) > 200
    # A place on a square is off by some ulp of D/h, here up to some tens, and the lowest slope of a ray is 1e-3.
    np.testing.assert_allclose(np.stack([got.distance, got.tau], axis=1), list(wanted.values()), rtol=1e-12)


@pytest.mark.parametrize("half", [0.5, 1.0])
def test_sun_hits_are_those_of_the_scalar_loop(half):
    rng = np.random.default_rng(4)
    particles, origins = drawn(rng, 24), rng.uniform(-3, 3, (3, 300))
    along = tuple(-c for c in reference.unit(SUN.direction))
    got = sun_hits(ready(*particles), origins, tuple(-2 * c for c in SUN.direction),
                   size="edge" if half == 0.5 else "half")
    wanted = {}
    for ray in range(origins.shape[1]):
        for i, each in enumerate(particles):
            t, opacity = reference.met(each, TEXTURES, along, tuple(origins[:, ray].tolist()), along, half=half)
            if opacity * each.fom_multiplier > 0:
                wanted[ray, i] = t, -math.log1p(-opacity) * each.fom_multiplier
    assert list(zip(got.ray.tolist(), got.particle.tolist(), strict=True)) == list(wanted)
    assert len(wanted) > 100
    assert got.distance.min() < 0 < got.distance.max()
    np.testing.assert_allclose(np.stack([got.distance, got.tau], axis=1), list(wanted.values()), rtol=1e-12, atol=1e-14)


def test_a_disc_covers_its_share_of_the_sphere():
    """(1 − cos θ)/2 of all directions, tan θ = radius/distance; of a spiral of 200000 the error is some 1e-4."""
    k = np.arange(200000) + 0.5
    y, angle = 1 - 2 * k / len(k), k * math.pi * (3 - math.sqrt(5))
    ring = np.sqrt(1 - y * y)
    way = np.stack([ring * np.cos(angle), y, ring * np.sin(angle)])
    for distance, size in ((3.0, 2.0), (1.0, 2.0), (0.01, 2.0)):
        one = ready(Particle(position=(0.6 * distance, 0, 0.8 * distance), size=size, profile="disc"))
        share = len(lamp_hits(one, (0.0, 0.0, 0.0), way).ray) / len(k)
        theta = math.atan2(size / 2, distance)
        assert share == pytest.approx((1 - math.cos(theta)) / 2, abs=3e-4)


@pytest.mark.parametrize(("profile", "area"), [("disc", math.pi / 4), ("square", 1.0), ("soft", math.pi / 12)])
def test_what_a_sun_loses_is_area_times_opacity(profile, area):
    """∫α over the square of edge 1: r(1 − r²)² over a disc of radius ½ is π/12 of its α; slanted rays alike."""
    one = ready(Particle(position=(0.2, 1, 0.1), profile=profile, opacity=0.25, rotation=30))
    x = (np.arange(400) + 0.5) / 400 * 2 - 1
    right, down = facing_axes(-np.array(reference.unit(SUN.direction)).reshape(3, 1), np.array([[1.0], [0.0]]))
    origins = (right[:, :, np.newaxis] * x + down[:, np.newaxis] * x[:, np.newaxis]).reshape(3, -1)
    origins = origins + np.array([[0.2], [1.0], [0.1]])
    hits = sun_hits(one, origins, tuple(-c for c in SUN.direction))
    # A grid of 400² misjudges an edge's texels: 2·perimeter/400 at worst in one direction, far less in the mean.
    assert -np.expm1(-hits.tau).sum() / 200**2 == pytest.approx(0.25 * area, rel=3e-3)


def test_distance_to_the_hit_or_to_the_centre():
    one, way = ready(Particle(position=(0, 0, -3), size=9, profile="square")), np.array([[0.6], [0.0], [-0.8]])
    assert lamp_hits(one, (0.0, 0.0, 1.0), way).distance.tolist() == [5.0]
    assert lamp_hits(one, (0.0, 0.0, 1.0), way, depth="centre").distance.tolist() == [4.0]
    for depth in ("hit", "centre"):
        hits = sun_hits(one, np.array([[1.0], [2.0], [1.0]]), (0.0, 0.0, -1.0), depth=depth)
        assert hits.distance.tolist() == [4.0]


@pytest.mark.parametrize(("dtype", "most"), [(np.float64, 700), (np.float32, 80)])
def test_an_opaque_particle_has_a_finite_depth(dtype, most):
    every = [Particle(position=(0, 0, -2), opacity=a, profile="square", fom_multiplier=m)
             for a, m in ((1.0, 1.0), (1.0, 0.25), (1.0, 0.0), (0.0, 1.0), (0.5, 1e10), (1 - 2.0**-20, 2.0))]
    hits = lamp_hits(ready(*every), (0.0, 0.0, 0.0), np.array([[0.0], [0.0], [-1.0]], dtype))
    assert hits.particle.tolist() == [0, 1, 4, 5]
    np.testing.assert_allclose(hits.tau, [most, most, most, 40 * math.log(2)], rtol=1e-6)
    assert hits.tau.dtype == hits.distance.dtype == dtype
    published = lamp_hits(ready(*every), (0.0, 0.0, 0.0), np.array([[0.0], [0.0], [-1.0]], dtype),
                          least_transmittance=1e-5)
    np.testing.assert_allclose(published.tau, 5 * math.log(10), rtol=1e-6)


@pytest.mark.parametrize("bound", [0.0, 1.0, -1.0, math.nan])
def test_what_rays_refuse(bound):
    with pytest.raises(InputError, match=r"^least_transmittance: is .*, must be above 0 and below 1$"):
        lamp_hits(ready(), LAMP.position, np.ones((3, 1)), least_transmittance=bound)
    with pytest.raises(InputError, match="depth: is 'middle', must be one of hit, centre"):
        sun_hits(ready(), np.ones((3, 1)), (0.0, 1.0, 0.0), depth="middle")


def test_a_particle_at_the_lamp():
    """In it: nothing. A hair away from it: what its square covers of the half sphere, at a hair's distance."""
    way = directions(np.random.default_rng(5), 2000)
    assert len(lamp_hits(ready(Particle(position=(1, 2, 3))), (1.0, 2.0, 3.0), way).ray) == 0
    near = lamp_hits(ready(Particle(position=(1, 2, 3 - 1e-9), size=2, profile="square")), (1.0, 2.0, 3.0), way)
    assert near.ray.tolist() == np.flatnonzero(way[2] < -1e-8).tolist()
    assert np.isfinite(near.distance).all()
    assert np.isfinite(near.tau).all()
    single = lamp_hits(ready(Particle(position=(0, 0, -1e-9), size=1e10, profile="square"), dtype=np.float32),
                       (0.0, 0.0, 0.0), way.astype(np.float32))
    assert len(single.ray) > 900
    assert np.isfinite(single.tau).all()


def test_the_order_of_rays_makes_no_difference():
    rng = np.random.default_rng(6)
    particles, way = ready(*drawn(rng, 20)), directions(rng, 500)
    turned = rng.permutation(500)
    one, two = lamp_hits(particles, LAMP.position, way), lamp_hits(particles, LAMP.position, way[:, turned])
    order = np.lexsort((two.particle, turned[two.ray]))
    np.testing.assert_array_equal(one.ray, turned[two.ray][order])
    for a, b in zip(one[1:], two[1:], strict=True):
        np.testing.assert_array_equal(a, b[order])


def test_nothing_from_nothing():
    for hits in (lamp_hits(ready(), LAMP.position, np.ones((3, 4))), sun_hits(ready(), np.ones((3, 4)), (0., -1., 0.)),
                 lamp_hits(ready(Particle(position=(0, 0, 0))), LAMP.position, np.ones((3, 0)))):
        assert [part.shape for part in hits] == [(0,)] * 4
    assert points_transmittance(ready(), LAMP, (np.ones(3),) * 3).tolist() == [1.0] * 3


# --- points -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("light", [LAMP, SUN], ids=["lamp", "sun"])
@pytest.mark.parametrize("seed", [1, 2])
def test_points_see_what_the_scalar_loop_lets_through(light, seed, monkeypatch):
    rng = np.random.default_rng(seed)
    particles, points = drawn(rng, 24), rng.uniform(-4, 4, (3, 20, 15))
    got = points_transmittance(ready(*particles), light, tuple(points))
    want = [reference.transmittance(particles, TEXTURES, light, tuple(p.tolist())) for p in points.reshape(3, -1).T]
    np.testing.assert_allclose(got.ravel(), want, rtol=1e-12)
    assert np.count_nonzero(got < 1) > 60
    monkeypatch.setattr(billboard_shadows, "BLOCK", 64)
    monkeypatch.setattr(near_pairs, "PAIRS", 32)
    np.testing.assert_allclose(points_transmittance(ready(*particles), light, tuple(points)), got, rtol=4 * EPS)


def test_points_broadcast_and_come_in_their_type():
    one = ready(Particle(position=(0, 2, 0), size=2, opacity=0.75, profile="square"))
    sun = DirectionalLight(direction=(0, 1, 0), irradiance=(1, 1, 1))
    x, y = np.array([[0.0, 5.0]], np.float32), np.array([[1.0], [3.0]], np.float32)
    got = points_transmittance(one, sun, (x, y, np.zeros((1, 1), np.float32)))
    assert (got.dtype, got.tolist()) == (np.float32, [[0.25, 1.0], [1.0, 1.0]])


@pytest.mark.parametrize("light", [LAMP, SUN], ids=["lamp", "sun"])
@pytest.mark.parametrize("shift", [0.0, 100.0])
def test_single_precision_is_near_to_double(light, shift):
    """Of soft particles and points that no square passes within a rounding; the places themselves are rounded."""
    rng = np.random.default_rng(10)
    particles = [dataclasses.replace(each, profile="soft", texture=None, opacity=0.5 * each.opacity,
                                     position=tuple(c + shift for c in each.position)) for each in drawn(rng, 30)]
    if light is LAMP:
        light = dataclasses.replace(LAMP, position=tuple(c + shift for c in LAMP.position))
    points = (rng.uniform(-4, 4, (3, 2000)) + shift).astype(np.float32)
    double, single = (points_transmittance(ready(*particles), light, tuple(points.astype(dtype)))
                      for dtype in (np.float64, np.float32))
    assert single.dtype == np.float32
    # A place on a square is off by some ulp of the coordinates over half an edge; the opacity is as steep as 1.5.
    assert np.abs(single - double).max() < 32 * 6e-8 * (10 + shift)
    assert np.count_nonzero(double < 0.99) > 300


def test_all_that_lies_on_a_ray_dims_what_lies_behind():
    rng = np.random.default_rng(9)
    particles, way = ready(*drawn(rng, 30)), directions(rng, 200)
    hits = lamp_hits(particles, LAMP.position, way)
    total = np.bincount(hits.ray, weights=hits.tau, minlength=200)
    points = np.reshape(LAMP.position, (3, 1)) + 1e4 * way
    # 1e4 m away a point tells the direction within some 1e-16, and the opacity changes little with it.
    np.testing.assert_allclose(points_transmittance(particles, LAMP, tuple(points)), np.exp(-total), rtol=1e-9)


def test_opaque_particles_let_nothing_through():
    one = ready(Particle(position=(0, 2, 0), size=2, opacity=1.0, profile="square"),
                Particle(position=(0, 3, 0), size=2, opacity=1.0, profile="square"))
    lamp = PointLight(position=(0, 9, 0), intensity=(1, 1, 1))
    assert points_transmittance(one, lamp, (np.zeros(1),) * 3).tolist() == [0.0]
    assert points_transmittance(one, lamp, (np.zeros(1), np.full(1, 9.0), np.zeros(1))).tolist() == [1.0]


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@given(seed=st.integers(0, 2**32), shift=st.sampled_from([0.0, 100.0, 1e6]))
def test_a_centre_is_not_in_its_own_shadow(dtype, seed, shift):
    rng = np.random.default_rng(seed)
    particles = [Particle(position=tuple((rng.normal(size=3) * 3 + shift).tolist()), opacity=1.0) for _ in range(8)]
    for light in (dataclasses.replace(LAMP, position=(shift, shift, shift)), SUN):
        for each in particles:
            centre = tuple(np.array([c], dtype) for c in each.position)
            assert points_transmittance(ready(each), light, centre) == 1.0


def test_before_is_strictly_before():
    one = ready(Particle(position=(0, 0, -2), opacity=0.5, profile="square"))
    lamp = PointLight(position=(0, 0, 0), intensity=(1, 1, 1))
    z = np.array([-1.9, -2.0 * (1 - 1e-13), -2.0, -2.0 * (1 + 1e-13), -2.1])
    assert points_transmittance(one, lamp, (np.zeros(5), np.zeros(5), z)).tolist() == [1, 1, 1, 0.5, 0.5]
