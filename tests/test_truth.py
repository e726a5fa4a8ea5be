"""The converged truth against closed forms and quadrature that shares nothing with it."""

from __future__ import annotations

import dataclasses
import itertools
import math

import numpy as np
import pytest
import reference_truth as reference
from hypothesis import given
from hypothesis import settings as hypothesis_settings
from hypothesis import strategies as st

from froxel_ref.density import density, place
from froxel_ref.optical_depth import Lines, column, medium_path
from froxel_ref.records import InputError
from froxel_ref.scene import (
    Box,
    DensityTexture,
    DirectionalLight,
    HeightFog,
    LocalMedium,
    Medium,
    NoiseDensity,
    PointLight,
    Scene,
    Sphere,
    SpotLight,
    Transform,
)
from froxel_ref.settings import PHASE_FUNCTIONS, SecondLobe, Settings, replace
from froxel_ref.truth import Truth, trace, trace_depths

WHITE = (1.0, 1.0, 1.0)


def rays(seed, count, reach=4.0, stop=12.0):
    rng = np.random.default_rng(seed)
    d = rng.normal(size=(3, count))
    return rng.uniform(-reach, reach, (3, count)), d / np.linalg.norm(d, axis=0), rng.uniform(0.1, stop, count)


def hold(truth: Truth, want, rtol):
    """The tolerance on at least 99.9 % of rays; the estimate is never below a tenth of the real error."""
    error = np.abs(truth.radiance - want)
    assert truth.converged.all()
    met = (error <= rtol * np.abs(want) + 1e-300).all(axis=0)
    assert met.mean() >= 0.999, np.flatnonzero(~met)
    assert (error <= 10 * truth.error).all(), float((error / np.maximum(truth.error, 1e-300)).max())


# --- suns -------------------------------------------------------------------------------------------


@given(st.floats(-0.999, 0.999), st.floats(-6, 6).map(lambda e: 10**e), st.floats(-3, 3).map(lambda e: 10**e),
       st.integers(0, 2**31))
def test_uniform_fog_and_a_sun(g, extinction, length, seed):
    rng = np.random.default_rng(seed)
    d, sun = rng.normal(size=(3, 5)), rng.normal(size=3)
    d /= np.linalg.norm(d, axis=0)
    light = DirectionalLight(direction=tuple(sun), irradiance=(1.0, 2.0, 3.0))
    fog = Medium(albedo=(0.9, 0.5, 0.1), extinction=extinction, phase_anisotropy=g)
    truth = trace(Scene(global_media=(fog,), lights=(light,)), rng.uniform(-9, 9, (3, 5)), d,
                  np.full(5, length), rtol=1e-6, threads=1)
    # The angle by its tangent, which has digits at both ends.
    sun = sun[:, None] / np.linalg.norm(sun)
    angle = np.arctan2(np.linalg.norm(np.cross(d, sun, axis=0), axis=0), (d * sun).sum(axis=0))
    phase = reference.henyey_greenstein(angle, g)
    want = np.outer([0.9, 1.0, 0.3], phase) * -math.expm1(-extinction * length)
    assert truth.converged.all()
    assert (np.abs(truth.radiance - want) <= 1e-6 * want).all()
    np.testing.assert_allclose(truth.transmittance, math.exp(-extinction * length), rtol=1e-9, atol=1e-300)


@pytest.mark.parametrize("rtol", [1e-2, 1e-4, 1e-7])
@pytest.mark.parametrize("medium", [
    Medium(extinction=0.3, height_fog=HeightFog(start=-1.0, falloff=0.7)),
    Medium(extinction=2.0, height_fog=HeightFog(start=-20.0, falloff=1.5, max_height=1.0)),
    Medium(extinction=50.0, height_fog=HeightFog(start=-3.5, falloff=40.0)),
    LocalMedium(extinction=1.5, transform=Transform(rotate=(10, 20, 30), scale=(1, 2, 3))),
    LocalMedium(extinction=30.0, shape="ellipsoid", transform=Transform(rotate=(10, 20, 30), scale=(1, 2, 3))),
    LocalMedium(extinction=4.0, shape="ellipsoid", height_fog=HeightFog(start=0.3, falloff=5.0, max_height=0.8),
                transform=Transform(scale=(3, 2, 3))),
], ids=["fog", "ceiling", "thin layer", "box", "ellipsoid", "local fog"])
def test_one_medium_and_a_sun(medium, rtol):
    """Whatever the density, a sun gives albedo·p·E·(1 − T), with T from 40 digits or plain quadrature."""
    origins, directions, ends = rays(7, 1000)
    scene = Scene(global_media=() if isinstance(medium, LocalMedium) else (medium,),
                  local_media=(medium,) if isinstance(medium, LocalMedium) else (),
                  lights=(DirectionalLight(direction=(1, 2, 3), irradiance=(math.tau * 2,) * 3),))
    truth = trace(scene, origins, directions, ends, rtol=rtol)
    # 1 − T from τ, for T may be 1 but for its last digit. `optical_depth` has tests of its own.
    lines = Lines(origins, directions, np.zeros(1000), ends)
    depth = medium.extinction * column(medium_path(place(medium), lines), ends)
    hold(truth, np.broadcast_to(-np.expm1(-depth), (3, 1000)), rtol)
    for i in range(0, 1000, 50):
        t = (np.arange(200_000) + 0.5) / 200_000 * ends[i]
        points = tuple(origins[k, i] + directions[k, i] * t for k in range(3))
        depth = medium.extinction * density(medium, points).mean() * ends[i]
        # A midpoint rule that a surface of the medium cuts is off by up to half a step's extinction.
        assert truth.transmittance[i] == pytest.approx(math.exp(-depth), abs=2e-4)


# --- lamps ------------------------------------------------------------------------------------------


def near_lamp(seed, count):
    """Rays that pass a lamp at (1, 2, 3) at 1 mm to 50 m, in front of or behind it."""
    rng = np.random.default_rng(seed)
    d = rng.normal(size=(3, count))
    d /= np.linalg.norm(d, axis=0)
    side = np.cross(d, rng.normal(size=(3, count)), axis=0)
    side /= np.linalg.norm(side, axis=0)
    h, along = 10 ** rng.uniform(-3, math.log10(50), count), rng.uniform(-20, 100, count)
    origins = np.array([[1.0], [2.0], [3.0]]) - along * d - h * side
    return origins, d, 10 ** rng.uniform(-1, 2.4, count)


@pytest.mark.parametrize("g", [0.0, 0.6, -0.9, 0.99])
@pytest.mark.parametrize("radius", [None, 3.0, 40.0])
def test_a_lamp_in_uniform_fog(g, radius):
    for k, (extinction, rtol) in enumerate([(1e-3, 1e-4), (0.1, 1e-4), (0.1, 1e-8), (3.0, 1e-4)]):
        origins, d, ends = near_lamp(k, 60)
        lamp = PointLight(position=(1, 2, 3), intensity=(5, 5, 5), radius=radius or 1.0,
                          falloff="windowed" if radius else "inverse_square")
        fog = Medium(albedo=(0.8,) * 3, extinction=extinction, phase_anisotropy=g)
        truth = trace(Scene(global_media=(fog,), lights=(lamp,)), origins, d, ends, rtol=rtol, threads=1)
        want = [reference.lamp_in_uniform_fog(o, u, end, np.array([1.0, 2.0, 3.0]), extinction=extinction,
                                              albedo=0.8, g=g, intensity=5.0, radius=radius)
                for o, u, end in zip(origins.T, d.T, ends, strict=True)]
        hold(truth, np.array(want)[None].repeat(3, axis=0), rtol)


@pytest.mark.parametrize(("light", "g"), [((0.5, 0.0, -8.0), 0.7), ((1e-3, 0.0, -8.0), 0.0),
                                          ((0.0, 30.0, -4.0), -0.5), ((0.2, 0.1, 1.0), 0.9)])
def test_the_reference_itself_against_30_digits(light, g):
    got = reference.lamp_in_uniform_fog(np.zeros(3), np.array([0.0, 0.0, -1.0]), 20.0, np.array(light),
                                        extinction=0.1, albedo=1.0, g=g, intensity=1.0, min_distance=1e-12)
    want = reference.lamp_in_uniform_fog_exact((0, 0, 0), (0, 0, -1), 20.0, light, extinction=0.1, g=g)
    assert got == pytest.approx(want, rel=1e-12)


@hypothesis_settings(max_examples=60)
@given(st.floats(-3, 1.69).map(lambda e: 10**e), st.floats(-30, 120), st.floats(-0.95, 0.95),
       st.floats(-4, 1).map(lambda e: 10**e), st.floats(0.1, 300))
def test_any_lamp_beside_a_ray(off, along, g, extinction, end):
    lamp = PointLight(position=(off, 0.0, -along), intensity=(1, 1, 1), falloff="inverse_square")
    fog = Medium(albedo=WHITE, extinction=extinction, phase_anisotropy=g)
    ray = np.zeros((3, 1)), np.array([[0.0], [0.0], [-1.0]])
    truth = trace(Scene(global_media=(fog,), lights=(lamp,)), *ray, [end], rtol=1e-5, threads=1)
    want = reference.lamp_in_uniform_fog(ray[0][:, 0], ray[1][:, 0], end, np.array(lamp.position),
                                         extinction=extinction, albedo=1.0, g=g, intensity=1.0)
    hold(truth, np.full((3, 1), want), 1e-5)


def spot_light(points, t, spot, g, direction):
    """A spot light's irradiance times the phase function, from its description."""
    way = np.array(spot.position)[:, None] - points
    d = np.linalg.norm(way, axis=0)
    axis = np.array(spot.direction) / np.linalg.norm(spot.direction)
    cosine = -(axis @ way) / d
    inner, outer = (math.cos(math.radians(a)) for a in (spot.inner_angle, spot.outer_angle))
    cone = np.clip((cosine - outer) / (inner - outer), 0, 1) ** 2
    window = np.clip(1 - (d / spot.radius) ** 4, 0, None) ** 2
    angle = np.arctan2(np.linalg.norm(np.cross(direction, way, axisa=0, axisb=0, axisc=0), axis=0),
                       direction @ way)
    return reference.henyey_greenstein(angle, g) * cone * window / np.maximum(d, spot.min_distance) ** 2


@pytest.mark.parametrize("rtol", [1e-3, 1e-6])
def test_a_spot_light_in_an_ellipsoid_in_the_fog(rtol):
    """Two media that overlap, of one g, a cone with all its edges: breaks from a dense scan."""
    spot = SpotLight(position=(0.3, 2.5, -1.0), intensity=(7, 7, 7), radius=6.0, direction=(0.1, -1, 0.2),
                     inner_angle=12, outer_angle=35)
    ball = LocalMedium(albedo=WHITE, extinction=0.8, shape="ellipsoid", phase_anisotropy=0.5,
                       transform=Transform(scale=(2, 1, 2)))
    fog = Medium(albedo=WHITE, extinction=0.2, phase_anisotropy=0.5, height_fog=HeightFog(falloff=0.5))
    scene = Scene(global_media=(fog,), local_media=(ball,), lights=(spot,))
    origins, d, ends = rays(3, 40)
    truth = trace(scene, origins, d, ends, rtol=rtol, threads=1)

    def density(p):
        inside = (p[0] / 2) ** 2 + p[1] ** 2 + (p[2] / 2) ** 2 <= 1
        return 0.2 * np.exp(-0.5 * np.maximum(p[1], 0)) + 0.8 * inside

    want = []
    for o, u, end in zip(origins.T, d.T, ends, strict=True):
        t = np.linspace(0, end, 20001)
        p = o[:, None] + u[:, None] * t
        way = p - np.array(spot.position)[:, None]
        cosine = (np.array(spot.direction) / np.linalg.norm(spot.direction)) @ way / np.linalg.norm(way, axis=0)
        fields = [1 - ((p[0] / 2) ** 2 + p[1] ** 2 + (p[2] / 2) ** 2), p[1], 6.0 - np.linalg.norm(way, axis=0),
                  cosine - math.cos(math.radians(12)), cosine - math.cos(math.radians(35))]
        breaks = [-float(u @ (o - np.array(spot.position)))]
        for f in fields:
            k = np.flatnonzero(f[1:] * f[:-1] < 0)
            breaks += (t[k] + (t[k + 1] - t[k]) * f[k] / (f[k] - f[k + 1])).tolist()
        want.append(7 * reference.scattered(
            o, u, float(end), density=density, extinction=1.0, scattering=1.0, breaks=breaks,
            light=lambda points, t, u=u: spot_light(points, t, spot, 0.5, u)))
    # The breaks are interpolated: 1e-7 m off, and so is the reference, by 1e-8 of the result.
    dark = ~(np.array(want) > 1e-12)
    assert (~dark).sum() > 5
    np.testing.assert_allclose(truth.radiance[0][~dark], np.array(want)[~dark], rtol=rtol + 2e-7)
    assert (truth.radiance[0][dark] < 1e-11).all()


@pytest.mark.parametrize("name", PHASE_FUNCTIONS)
def test_every_phase_function_integrates_to_the_albedo(name):
    """Suns from everywhere: their mean is the mean of the phase function, 1/(4π), exactly to its moments."""
    x, weight = np.polynomial.legendre.leggauss(48)
    fog = Medium(albedo=WHITE, extinction=1.0, phase_anisotropy=0.3)
    settings = Settings(phase_function=name, second_lobe=SecondLobe(phase_anisotropy=-0.2, weight=0.4))
    total = 0.0
    for c, w in zip(x, weight, strict=True):
        sun = DirectionalLight(direction=(math.sqrt(1 - c * c), 0, c), irradiance=WHITE)
        total += w * trace(Scene(global_media=(fog,), lights=(sun,)), [[0.0]] * 3, [[0.0], [0.0], [1.0]], [1.0],
                           settings=settings, threads=1).radiance[0, 0]
    assert math.tau * total == pytest.approx(-math.expm1(-1.0), rel=1e-10)


# --- media together ---------------------------------------------------------------------------------


def test_coloured_extinction_has_coloured_transmittance():
    fog = Medium(albedo=(1.0, 0.5, 0.25), extinction=(0.1, 1.0, 1e4))
    sun = DirectionalLight(direction=(0, 1, 0), irradiance=(4 * math.pi,) * 3)
    truth = trace(Scene(global_media=(fog,), lights=(sun,)), [[0.0]] * 3, [[0.0], [0.0], [-1.0]], [2.0],
                  rtol=1e-8)
    np.testing.assert_allclose(truth.transmittance[:, 0], np.exp([-0.2, -2.0, -2e4]), rtol=1e-14)
    np.testing.assert_allclose(truth.radiance[:, 0],
                               [1 - math.exp(-0.2), 0.5 * (1 - math.exp(-2)), 0.25], rtol=1e-8)


@pytest.mark.parametrize("mixing", ["mixture", "weighted", "mean"])
def test_overlapping_media_mix_their_phase_functions(mixing):
    sun = DirectionalLight(direction=(0, 0, -1), irradiance=WHITE)
    a = Medium(albedo=WHITE, extinction=0.3, phase_anisotropy=0.8)
    b = Medium(albedo=WHITE, extinction=0.1, phase_anisotropy=-0.4)
    settings = replace(Settings(), phase_mixing=mixing)
    truth = trace(Scene(global_media=(a, b), lights=(sun,)), [[0.0]] * 3, [[0.0], [0.0], [-1.0]], [5.0],
                  settings=settings, rtol=1e-8)

    def forward(g):
        return (1 + g) / (4 * math.pi * (1 - g) ** 2)

    phase = {"mixture": 0.75 * forward(0.8) + 0.25 * forward(-0.4), "weighted": forward(0.5),
             "mean": forward(0.2)}[mixing]
    assert truth.radiance[0, 0] == pytest.approx(phase * -math.expm1(-2.0), rel=1e-8)


def test_ambient_light_and_emission():
    fog = Medium(albedo=(0.5,) * 3, extinction=0.4, emissive=(0.1, 0.2, 0.0))
    scene = Scene(global_media=(fog,), ambient=(1.0, 0.0, 2.0))
    ray = ([[0.0]] * 3, [[0.0], [0.0], [-1.0]], [3.0])
    part = -math.expm1(-1.2) / 0.4
    for word, emission in (("per_metre", (0.1, 0.2, 0.0)), ("published", (0.02, 0.04, 0.0)),
                           ("absorption", (0.02, 0.04, 0.0))):
        truth = trace(scene, *ray, settings=replace(Settings(), emission=word), rtol=1e-9)
        want = (np.array([0.2, 0.0, 0.4]) + emission) * part
        np.testing.assert_allclose(truth.radiance[:, 0], want, rtol=1e-9)
    constant = trace(scene, *ray, settings=replace(Settings(), ambient="constant"))
    assert constant.radiance[2, 0] == pytest.approx(0.2 * part / (4 * math.pi**2), rel=1e-9)


@pytest.mark.parametrize("rtol", [1e-3, 1e-5])
def test_a_textured_medium_and_a_lamp(rtol):
    """Against a truth with every cell's face given: a plain rule over 200 panels of each stretch."""
    from froxel_ref.assets import load_assets
    from froxel_ref.density import density as density_of

    medium = LocalMedium(albedo=WHITE, extinction=1.2, transform=Transform(scale=(2, 2, 2)),
                         density=DensityTexture(source=NoiseDensity(size=8, cells=4, octaves=1)))
    lamp = PointLight(position=(1.0, 0.5, 0.2), intensity=WHITE, falloff="inverse_square")
    scene = Scene(local_media=(medium,), lights=(lamp,))
    assets = load_assets(scene, None)
    texels = assets.textures[medium.density.source]
    origins, d, ends = rays(12, 12, reach=1.8, stop=6.0)
    truth = trace(scene, origins, d, ends, rtol=rtol, assets=assets, threads=1)
    for i in range(12):
        o, u = origins[:, i], d[:, i]
        with np.errstate(divide="ignore"):
            planes = np.concatenate([(np.arange(-2.25, 2.5, 0.5) - o[k]) / u[k] for k in range(3)]
                                    + [(np.array([-2.0, 2.0]) - o[k]) / u[k] for k in range(3)])
        b = float(u @ (np.array(lamp.position) - o))

        def light(points, t, u=u):
            d2 = ((np.array(lamp.position)[:, None] - points) ** 2).sum(axis=0)
            return 1 / (4 * math.pi * np.maximum(d2, 1e-4))

        want = reference.scattered(
            o, u, float(ends[i]), extinction=1.2, scattering=1.2, light=light, finest=2e-2,
            density=lambda p: np.broadcast_to(density_of(medium, (p[0], p[1], p[2]), texels), p.shape[1:]),
            breaks=[b, *planes.tolist()])
        error = abs(truth.radiance[0, i] - want)
        assert error <= (rtol + 1e-8) * want
        assert error <= 10 * truth.error[0, i] + 1e-8 * want


# --- shadows ----------------------------------------------------------------------------------------


def test_a_sharp_shadow_in_uniform_fog():
    """A box between the sun and the ray: ½ of the ray is dark, and the light has a closed form."""
    sun = DirectionalLight(direction=(0, 1, 0), irradiance=(4 * math.pi,) * 3)
    fog = Medium(albedo=WHITE, extinction=0.7)
    roof = Box(transform=Transform(translate=(0, 3, -3), scale=(1, 0.1, 1)))
    scene = Scene(global_media=(fog,), lights=(sun,), surfaces=(roof,))
    ray = ([[0.0]] * 3, [[0.0], [0.0], [-1.0]], [5.0])
    lit, dark = trace(scene, *ray, rtol=1e-9), trace(scene, *ray, rtol=1e-9, shadows="exact")
    hidden = math.exp(-0.7 * 2) - math.exp(-0.7 * 4)
    assert lit.radiance[0, 0] == pytest.approx(1 - math.exp(-3.5), rel=1e-9)
    assert dark.radiance[0, 0] == pytest.approx(1 - math.exp(-3.5) - hidden, rel=1e-9)
    assert dark.evaluations[0] < 100


@pytest.mark.parametrize("rtol", [1e-4, 1e-8])
def test_a_ball_and_a_box_in_front_of_a_lamp(rtol, monkeypatch):
    """Random rays; the ends of the shadow from a dense scan of the ray caster, bisected."""
    monkeypatch.setattr("froxel_ref.visibility.NEAR", 0.0)  # rays may begin inside the ball
    from froxel_ref.assets import load_assets
    from froxel_ref.visibility import exact_visibility, occluders

    lamp = PointLight(position=(0.2, 2.0, -0.3), intensity=WHITE, falloff="inverse_square")
    scene = Scene(global_media=(Medium(albedo=WHITE, extinction=0.3),), lights=(lamp,),
                  surfaces=(Sphere(center=(0, 0.5, 0), radius=0.6),
                            Box(transform=Transform(translate=(1.5, 1, 0), rotate=(0, 30, 20), scale=(0.3,) * 3))))
    sees = exact_visibility(occluders(scene.surfaces, load_assets(scene, None)), scene.lights)
    origins, d, ends = rays(21, 120)
    truth = trace(scene, origins, d, ends, rtol=rtol, shadows="exact")
    want, partly = [], 0
    for o, u, end in zip(origins.T, d.T, ends, strict=True):
        def seen(t, o=o, u=u):
            return sees[0](tuple(o[k] + u[k] * np.asarray(t) for k in range(3)))

        t = np.linspace(0, end, 3001)
        visible = seen(t)
        k = np.flatnonzero(visible[1:] != visible[:-1])
        a, b = t[k], t[k + 1]
        for _ in range(45):
            middle = 0.5 * (a + b)
            same = seen(middle) == visible[k]
            a, b = np.where(same, middle, a), np.where(same, b, middle)
        partly += len(k) > 0
        ends_of = [0.0, *a.tolist(), end]
        total = 0.0
        for low, high in itertools.pairwise(ends_of):
            if seen(np.array([0.5 * (low + high)]))[0] > 0.5:
                def f(s, o=o, u=u):
                    p = o[:, None, None] + u[:, None, None] * s
                    d2 = ((p - np.array(lamp.position)[:, None, None]) ** 2).sum(axis=0)
                    return 0.3 * np.exp(-0.3 * s) / (4 * math.pi * np.maximum(d2, 1e-4))

                near = float(u @ (np.array(lamp.position) - o))
                total += reference.integral(f, low, high, [near], finest=1e-3)
        want.append(total)
    assert partly > 20
    error = np.abs(truth.radiance[0] - want)
    assert (error <= rtol * np.array(want) + 1e-13).all()
    assert (error <= 10 * truth.error[0] + 1e-13).all()


def test_volumetric_shadows_in_uniform_fog():
    """To a lamp: another factor e^(−σd) under the integral."""
    lamp = PointLight(position=(0.4, 0.0, -3.0), intensity=WHITE, falloff="inverse_square")
    scene = Scene(global_media=(Medium(albedo=WHITE, extinction=0.6),), lights=(lamp,))
    truth = trace(scene, [[0.0]] * 3, [[0.0], [0.0], [-1.0]], [8.0], rtol=1e-8, volumetric_shadows=True)

    def f(t):
        d = np.hypot(t - 3.0, 0.4)
        return 0.6 * np.exp(-0.6 * (t + d)) / (4 * math.pi * d * d)

    want = reference.integral(f, 0, 8, [3.0], finest=1e-2)
    assert truth.radiance[0, 0] == pytest.approx(want, rel=1e-8)


@pytest.mark.parametrize("shape", ["box", "ellipsoid"])
@pytest.mark.parametrize("textured", [False, True])
def test_volumetric_shadows_of_a_local_medium(shape, textured):
    """A cloud between lamp and ray, every way to the light marched in 4000 steps: 1e-4 of the reference."""
    from froxel_ref.assets import load_assets
    from froxel_ref.density import density as density_of

    texture = DensityTexture(source=NoiseDensity(size=8, cells=4, octaves=1)) if textured else None
    cloud = LocalMedium(albedo=WHITE, extinction=1.5, shape=shape, density=texture,
                        transform=Transform(rotate=(0, 25, 10)))
    fog = Medium(albedo=WHITE, extinction=0.1)
    lamp = PointLight(position=(0.3, 3.0, 0.2), intensity=WHITE, falloff="inverse_square")
    scene = Scene(global_media=(fog,), local_media=(cloud,), lights=(lamp,))
    assets = load_assets(scene, None)
    texels = assets.textures[texture.source] if textured else None
    o, u = np.array([-4.0, -1.2, 0.1]), np.array([1.0, 0.1, -0.05])
    u /= np.linalg.norm(u)
    truth = trace(scene, o[:, None], u[:, None], [8.0], rtol=1e-5, volumetric_shadows=True, assets=assets)

    def density(p):
        return 0.1 + 1.5 * np.broadcast_to(density_of(cloud, (p[0], p[1], p[2]), texels), p.shape[1:])

    t = (np.arange(1500) + 0.5) / 1500 * 8
    p = o[:, None] + u[:, None] * t
    q = np.array(lamp.position)[:, None]
    way = reference.transmittance_between(p, q, density, 1.0, pieces=1500)
    here = np.exp(-(np.cumsum(density(p)) - 0.5 * density(p)) * 8 / 1500)
    want = (here * way * density(p) / (4 * math.pi * ((q - p) ** 2).sum(axis=0))).sum() * 8 / 1500
    assert truth.converged.all()
    assert truth.radiance[0, 0] == pytest.approx(want, rel=1e-3)


# --- properties -------------------------------------------------------------------------------------


HALL = Scene(
    global_media=(Medium(albedo=(0.9, 0.8, 0.7), extinction=0.1, phase_anisotropy=0.4,
                         height_fog=HeightFog(falloff=0.3)),),
    local_media=(LocalMedium(extinction=0.8, shape="ellipsoid", phase_anisotropy=-0.2,
                             transform=Transform(translate=(1, 0, -2), scale=(1, 1, 2))),),
    lights=(DirectionalLight(direction=(1, 1, 0), irradiance=(1, 2, 3)),
            PointLight(position=(0.5, 1, -2), intensity=(3, 2, 1), radius=5),
            SpotLight(position=(-1, 2, -1), intensity=(5, 5, 5), radius=8, direction=(0.2, -1, -0.2))),
    surfaces=(Sphere(center=(0, 0.4, -1.5), radius=0.3),), ambient=(0.1, 0.1, 0.1))


@pytest.mark.parametrize("options", [{}, {"shadows": "exact"}, {"volumetric_shadows": True}])
def test_estimates_hold_between_tolerances(options):
    """1000 rays through everything at once: loose results against tight ones."""
    origins, d, ends = rays(31, 1000)
    tight = trace(HALL, origins, d, ends, rtol=1e-9, **options)
    assert tight.converged.all()
    for rtol in (1e-2, 1e-4):
        hold(trace(HALL, origins, d, ends, rtol=rtol, **options), tight.radiance, rtol)


def test_stretches_compose_to_the_whole():
    origins, d, ends = rays(41, 50)
    cuts = ends * np.array([[0.1], [0.3], [0.31], [1.0]])
    whole = trace(HALL, origins, d, ends, rtol=1e-9)
    parts = trace_depths(HALL, origins, d, cuts, rtol=1e-9)
    assert parts.radiance.shape == (3, 4, 50)
    np.testing.assert_allclose(parts.radiance[:, -1], whole.radiance, rtol=3e-9)
    np.testing.assert_allclose(parts.transmittance[-1], whole.transmittance, rtol=1e-12)
    second = trace(HALL, origins, d, cuts[1], rtol=1e-9)
    np.testing.assert_allclose(parts.radiance[:, 1], second.radiance, rtol=3e-9)
    assert (np.diff(parts.radiance, axis=1) >= 0).all()


def test_threads_and_neighbours_change_no_bit():
    origins, d, ends = rays(51, 700)
    one, two = (trace(HALL, origins, d, ends, threads=n, shadows="exact") for n in (1, 2))
    for a, b in zip(one, two, strict=True):
        np.testing.assert_array_equal(a, b)
    some = trace(HALL, origins[:, 300:310], d[:, 300:310], ends[300:310], shadows="exact")
    np.testing.assert_array_equal(some.radiance, one.radiance[:, 300:310])


def test_light_is_linear_and_units_scale():
    origins, d, ends = rays(61, 40)
    lights = [trace(dataclasses.replace(HALL, lights=(light,), ambient=(0, 0, 0)), origins, d, ends, rtol=1e-8)
              for light in HALL.lights]
    ambient = trace(dataclasses.replace(HALL, lights=()), origins, d, ends, rtol=1e-8)
    whole = trace(HALL, origins, d, ends, rtol=1e-8)
    np.testing.assert_allclose(sum(x.radiance for x in (*lights, ambient)), whole.radiance, rtol=3e-8)
    # Lengths times 8, extinction and falloffs by 8, intensities times 64: nothing changes.
    k = 8.0

    def grown(v):
        return tuple(k * c for c in v)

    fog, ball = HALL.global_media[0], HALL.local_media[0]
    lamps = [dataclasses.replace(light, position=grown(light.position), radius=k * light.radius,
                                 min_distance=k * light.min_distance,
                                 intensity=tuple(k * k * c for c in light.intensity)) for light in HALL.lights[1:]]
    scaled = dataclasses.replace(
        HALL, lights=(HALL.lights[0], *lamps),
        global_media=(dataclasses.replace(fog, extinction=fog.extinction / k,
                                          height_fog=HeightFog(falloff=0.3 / k)),),
        local_media=(dataclasses.replace(ball, extinction=ball.extinction / k,
                                         transform=Transform(translate=grown((1, 0, -2)), scale=grown((1, 1, 2)))),))
    np.testing.assert_allclose(trace(scaled, k * origins, d, k * ends, rtol=1e-8).radiance, whole.radiance,
                               rtol=1e-11)


def test_the_cost_grows_with_the_breaks():
    """Evaluations: 15 for each stretch between breaks, while they are smooth."""
    sun = DirectionalLight(direction=(0, 1, 0), irradiance=WHITE)
    ray = ([[0.0]] * 3, [[0.0], [0.0], [-1.0]], [20.0])
    for count in range(1, 5):
        boxes = tuple(LocalMedium(extinction=0.2, transform=Transform(translate=(0, 0, -3.0 * k - 3)))
                      for k in range(count))
        assert trace(Scene(local_media=boxes, lights=(sun,)), *ray).evaluations[0] == 15 * count


def test_rays_at_a_limit_are_flagged():
    origins, d, ends = rays(71, 30)
    truth = trace(HALL, origins, d, ends, rtol=1e-10, limit_rounds=0)
    assert not truth.converged.all()
    error = (truth.error > 1e-10 * truth.radiance).any(axis=0)
    np.testing.assert_array_equal(truth.converged, ~error)


@pytest.mark.parametrize(("change", "message"), [
    ({"rtol": 0.0}, "rtol: is 0, must be at least 1e-13"),
    ({"rtol": 1e-15}, "rtol: is 1e-15, must be"),
    ({"rtol": math.nan}, "rtol: is nan"),
    ({"shadows": "map"}, "shadows: is 'map'"),
    ({"rtol": None}, "rtol: is None, must be a number"),
    ({"rtol": "x"}, "rtol: is 'x', must be a number"),
    ({"shadows": None}, "shadows: is None; must be one of off, exact"),
    ({"shadows": True}, "shadows: is True; must be one of off, exact"),
    ({"volumetric_shadows": "off"}, "volumetric_shadows: is 'off', must be true or false"),
    ({"limit_rounds": -1}, "limit_rounds: is -1, must be a whole number, at least 0"),
    ({"limit_intervals": 0}, "limit_intervals: is 0, must be a whole number, at least 1"),
    ({"limit_intervals": 1.5}, "limit_intervals: is 1.5, must be a whole number"),
    ({"threads": 0}, "threads: is 0, must be a whole number, at least 1"),
    ({"sun_distance": 0.0}, "sun_distance: is 0, must be above 0 m"),
    ({"sun_distance": "far"}, "sun_distance: is 'far', must be a number"),
    ({"ends": [math.inf]}, "ends: must be finite, from 0 to 1e+14 m"),
    ({"ends": [-1.0]}, "ends: must be finite, from 0 to 1e+14 m"),
    ({"ends": [1e300]}, "ends: must be finite, from 0 to 1e+14 m"),
    ({"ends": [[1.0]]}, "ends: has shape (1, 1), must be (1,) for 1 rays, or one number"),
    ({"ends": "far"}, "ends: is not an array"),
    ({"starts": 3.0}, "ends: has a distance below starts"),
    ({"starts": math.nan}, "starts: must be finite, from 0"),
    ({"starts": [0.0, 0.0], "ends": [1.0, 2.0, 3.0]}, "starts: has shape (2,), must be (3,) for 3 rays"),
    ({"directions": [[0.0]] * 3}, "directions: has a zero vector"),
    ({"directions": [[math.inf]] * 3}, "directions: has a component that is not finite"),
    ({"directions": np.zeros((5, 3))}, "directions: has shape (5, 3), must be (3, N): rows x, y, z, one column a ray"),
    ({"directions": np.ones((3, 2)), "ends": [1.0] * 4}, "directions: has shape (3, 2), must be (3, 4) for 4 rays"),
    ({"origins": [[math.nan]] * 3}, "origins: has a component that is not finite"),
    ({"origins": [[1e11]] * 3}, "origins: has a component beyond 1e+10 m"),
    ({"origins": [0.0, 0.0]}, "origins: has shape (2,), must be (3, N)"),
    ({"origins": [[0.0], [0.0, 1.0], [0.0]]}, "origins: is not an array"),
])
def test_bad_input_is_one_line(change, message):
    options = {"origins": [[0.0]] * 3, "directions": [[0.0], [0.0], [-1.0]], "ends": [2.0]} | change
    with pytest.raises(InputError) as caught:
        trace(HALL, **options)
    assert str(caught.value).startswith(message)
    assert "\n" not in str(caught.value)


def test_bad_depths_are_one_line():
    ray = ([[0.0]] * 3, [[0.0], [0.0], [-1.0]])
    for ends, message in (([1.0], "ends: has shape (1,), must be (K, N)"),
                          ([[2.0], [1.0]], "ends: decreases along its first axis"),
                          ([[math.nan]], "ends: must be finite")):
        with pytest.raises(InputError) as caught:
            trace_depths(HALL, *ray, ends)
        assert str(caught.value).startswith(message)
    with pytest.raises(InputError, match=r"^ends: has shape \(2, 1\), must be \(K, 5\) for 5 rays"):
        trace_depths(HALL, np.zeros((3, 5)), ray[1], [[1.0], [2.0]])


def test_numbers_broadcast_and_directions_have_any_length():
    origins, d, _ = rays(81, 6)
    want = trace(HALL, origins, d, np.full(6, 7.0), starts=np.full(6, 1.0), threads=1)
    for size in (1e200, 1e-200, 5e-300):
        got = trace(HALL, origins, size * d, 7.0, starts=1, threads=1)
        assert got.radiance.shape == (3, 6)
        np.testing.assert_allclose(got.radiance, want.radiance, rtol=1e-12)
    fan = trace(HALL, origins[:, :1], d[:, :1], np.linspace(1.0, 7.0, 6), starts=[1.0], threads=1)
    assert fan.radiance[:, -1] == pytest.approx(want.radiance[:, 0], rel=1e-4)
    assert trace(HALL, np.zeros((3, 0)), np.zeros((3, 0)), np.zeros(0)).radiance.shape == (3, 0)


@pytest.mark.parametrize("extinction", [0.0, 5e-324, 1e-8, 1e4, 1e8, 1e12])
@pytest.mark.parametrize("g", [0.0, 1 - 2**-52, -(1 - 2**-52)])
@pytest.mark.parametrize("off", [0.0, 1e-300, 1e-3, 1e9])
def test_stiff_and_extreme_rays_stay_finite(extinction, g, off):
    """No NaN, no infinity, nothing negative, no warning; T within [0, 1]; what fails its tolerance says so."""
    lights = (PointLight(position=(off, 0, -2), intensity=WHITE, falloff="inverse_square"),
              DirectionalLight(direction=(0, 0, -1), irradiance=WHITE))
    fog = Medium(extinction=extinction, phase_anisotropy=g, height_fog=HeightFog(start=-1, falloff=1e10))
    ray = (np.zeros((3, 4)), np.array([[0.0], [0.0], [-1.0]]), [0.0, 1e-12, 5.0, 1e9])
    for media in ((Medium(extinction=extinction, phase_anisotropy=g),), (fog,)):
        scene = Scene(global_media=media, lights=lights, ambient=WHITE)
        for volumetric in (False, True):
            truth = trace(scene, *ray, threads=1, volumetric_shadows=volumetric)
            assert np.isfinite(truth.radiance).all()
            assert np.isfinite(truth.error).all()
            assert (truth.radiance >= 0).all()
            assert ((truth.transmittance >= 0) & (truth.transmittance <= 1)).all()
            assert (truth.error <= 1e-4 * truth.radiance)[:, truth.converged].all()


def test_vacuum_is_black_and_clear():
    truth = trace(Scene(lights=HALL.lights), [[0.0]] * 3, [[0.0], [0.0], [-1.0]], [5.0])
    assert not truth.radiance.any()
    assert truth.transmittance.tolist() == [1.0]
    assert truth.converged.all()
