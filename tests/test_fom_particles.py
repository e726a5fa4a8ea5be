"""Particles in Fourier opacity maps: what they cast on media, on each other and on surfaces."""

from __future__ import annotations

import dataclasses
import tracemalloc

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from froxel_ref import scene_files
from froxel_ref.assets import load_assets
from froxel_ref.billboard_shadows import Crossings, lamp_hits
from froxel_ref.billboards import Particles, placed_particles
from froxel_ref.fom_particles import AT_ONCE, casting, crossed
from froxel_ref.fom_plan import dimmed_lamps, dimmed_suns
from froxel_ref.fom_stage import exact_sights, map_sights, opacity_maps
from froxel_ref.frame import FINAL, estimate_bytes, plan, run_frame, working_bytes
from froxel_ref.records import InputError
from froxel_ref.scene import (
    Camera,
    DirectionalLight,
    LocalMedium,
    Medium,
    Particle,
    ParticleCloud,
    PointLight,
    Scene,
    SpotLight,
)
from froxel_ref.settings import Grid, OpacityMaps, Settings, ShadowMaps, replace

WHITE = (1.0, 1.0, 1.0)
SUN = DirectionalLight(direction=(0.0, 1.0, 0.0), irradiance=WHITE)
LAMP = PointLight(position=(0.0, 4.0, 0.0), intensity=(9, 9, 9), radius=8)
SPOT = SpotLight(position=(0.0, 4.0, 0.0), intensity=(9, 9, 9), radius=8, inner_angle=30, outer_angle=45)
LIGHTS = {"sun": SUN, "lamp": LAMP, "spot": SPOT}
PUFF = Particle(position=(0.0, 2.0, 0.0), size=2.0, opacity=0.75, profile="square")
HOW = Settings(grid=Grid(width=16, height=9, depth=16, near=0.5, far=12.0), volumetric_shadows="maps", shadows="off",
               opacity_maps=OpacityMaps(small=64, large=64, smallest=64, directional_size=128))
CAMERA = Camera(position=(0, 2, 6), target=(0, 1, 0), width=32, height=18)


def scene_of(light: object, *particles: object, **more: object) -> Scene:
    return Scene(camera=CAMERA, lights=(light,), particles=particles, **more)


def passed(scene: Scene, heights: object, how: Settings = HOW, *, exact: bool = False, x: float = 0.05) -> np.ndarray:
    """What arrives below the light, at some heights."""
    assets = load_assets(scene, None)
    sights = exact_sights(scene, how, assets) if exact else map_sights(
        opacity_maps(scene, how, assets, dtype=how.precision), scene, how)
    y = np.asarray(heights, np.float64)
    return np.broadcast_to(sights[0]((np.full_like(y, x), y, np.full_like(y, 0.03))), y.shape)


@pytest.mark.parametrize("name", LIGHTS)
def test_behind_a_particle_its_opacity_is_missing(name: str) -> None:
    """Its own Fourier series is exact at both ends of the range; the range ends a particle's size behind it."""
    got = passed(scene_of(LIGHTS[name], PUFF), [3.9, -1.0])
    np.testing.assert_allclose(got, [1.0, 0.25], rtol=1e-11)
    assert passed(scene_of(LIGHTS[name], PUFF), [-1.0], x=4.0)[0] == 1.0


@pytest.mark.parametrize("name", LIGHTS)
@pytest.mark.parametrize("harmonics", [0, 1, 3, 12])
def test_particles_against_exact_ways(name: str, harmonics: int) -> None:
    """Behind all of them exactly, whatever K; between them the mean error falls with K."""
    scene = scene_of(LIGHTS[name], *(dataclasses.replace(PUFF, position=(0, y, 0), opacity=0.4)
                                     for y in (1.2, 1.5, 2.0, 2.6)))
    heights = np.linspace(-2.0, 4.0, 301)
    how = replace(HOW, opacity_maps=dataclasses.replace(HOW.opacity_maps, harmonics=harmonics))
    error = passed(scene, heights, how) - passed(scene, heights, exact=True)
    assert np.abs(error[:10]).max() < 1e-9
    assert np.abs(error).mean() < 1.2 * {0: 0.1, 1: 0.025, 3: 0.022, 12: 0.011}[harmonics]  # as measured


@settings(max_examples=15, deadline=None)
@given(st.permutations(range(6)), st.sampled_from(list(LIGHTS)))
def test_particles_add_in_any_order(order: list[int], name: str) -> None:
    puffs = [dataclasses.replace(PUFF, position=(0.1 * i, 1.0 + 0.3 * i, -0.1 * i), opacity=0.1 + 0.1 * i)
             for i in range(6)]
    a, b = (opacity_maps(scene, HOW, load_assets(scene, None)) for scene in (
        scene_of(LIGHTS[name], *puffs), scene_of(LIGHTS[name], *(puffs[i] for i in order))))
    for result in ("fom/coefficients", "fom/directional_coefficients"):
        np.testing.assert_allclose(a[result], b[result], atol=1e-13)


def test_particles_and_media_add() -> None:
    ball = LocalMedium(extinction=0.5, shape="ellipsoid")
    fog = Medium(extinction=0.1)
    made = [opacity_maps(scene, HOW, load_assets(scene, None))["fom/coefficients"] for scene in (
        scene_of(LAMP, PUFF, local_media=(ball,), global_media=(fog,)),
        scene_of(LAMP, PUFF, global_media=(fog,)),
        scene_of(LAMP, local_media=(ball,), global_media=(fog,)), scene_of(LAMP, global_media=(fog,)))]
    np.testing.assert_allclose(made[0] + made[3], made[1] + made[2], atol=1e-13)
    assert np.abs(made[0] - made[2]).max() > 1.0


@pytest.mark.parametrize("name", LIGHTS)
def test_the_multiplier_scales_the_optical_depth(name: str) -> None:
    half = dataclasses.replace(PUFF, fom_multiplier=0.5)
    np.testing.assert_allclose(passed(scene_of(LIGHTS[name], half), [-1.0]), [0.5], rtol=1e-11)
    none = scene_of(LIGHTS[name], dataclasses.replace(PUFF, fom_multiplier=0.0))
    assert not plan(none, HOW)["fom"].runs
    assert plan(none, HOW)["particles"].runs


@pytest.mark.parametrize("name", LIGHTS)
@pytest.mark.parametrize("precision", ["float64", "float32"])
def test_an_opaque_particle_is_dark_and_finite(name: str, precision: str) -> None:
    """Opacity 1: a depth of 700, in float32 of 80; published: at most 11.5 (D8)."""
    opaque = scene_of(LIGHTS[name], dataclasses.replace(PUFF, opacity=1.0))
    how = replace(HOW, precision=precision)
    got = passed(opaque, np.linspace(-1, 3.95, 80), how)
    assert np.isfinite(got).all()
    assert got[0] < 1e-30
    assert got.max() <= 1.0
    clamped = passed(opaque, [-1.0], replace(how, fom_opacity="clamped"))
    np.testing.assert_allclose(clamped, [1e-5], rtol=1e-3)


@pytest.mark.parametrize("place", [(0.0, 4.0, 0.0), (0.0, 4.0, 1e-12), (0.0, 3.9, 0.0), (0.0, 4.1, 0.0)])
@pytest.mark.parametrize("light", [LAMP, SPOT])
def test_a_particle_at_the_light_is_finite(place: tuple[float, float, float], light: PointLight) -> None:
    scene = scene_of(light, dataclasses.replace(PUFF, position=place, opacity=1.0))
    for fidelity in ("corrected", "published", "author"):
        how = replace(HOW, fidelity=fidelity)
        got = passed(scene, np.linspace(-1, 5, 61), how)
        assert np.isfinite(got).all()
        assert got.min() >= 0.0
        assert got.max() <= 1.0
        assert np.isfinite(run_frame(scene, how)[FINAL]).all()


def test_the_authors_particles_are_twice_as_large_and_at_their_centres_distance() -> None:
    """A9."""
    author = replace(HOW, fom_particles="centre")
    wide = scene_of(LAMP, PUFF)
    assert passed(wide, [0.0], HOW, x=2.4)[0] == 1.0
    assert passed(wide, [0.0], author, x=2.4)[0] < 0.3


def test_a_single_particle_is_no_empty_range() -> None:
    """Its range is as long as it is large, so that its point does not lie at an end, where it would count by half."""
    scene = scene_of(LAMP, PUFF)
    made = opacity_maps(scene, HOW, load_assets(scene, None))
    near, far = made["fom/range"][0, 0]
    assert near < 2.0 < far
    heights = np.array([2.9, 1.9])
    got = passed(scene, heights)
    assert got[0] > 0.6
    assert got[1] < 0.6


def test_what_lies_beyond_a_lamps_reach_does_not_count() -> None:
    near = dataclasses.replace(LAMP, radius=1.5)
    assert dimmed_lamps(scene_of(near, dataclasses.replace(PUFF, size=0.3)), HOW) == {}
    assert dimmed_suns(scene_of(SUN, dataclasses.replace(PUFF, opacity=0.0))) == {}


def test_both_cast_on_both_and_on_the_floor() -> None:
    """particles-in-fog: each of the two darkens the other, itself and the floor."""
    loaded = scene_files.load("particles-in-fog", overrides=[
        "scene.camera.width=96", "scene.camera.height=54", "grid.width=64", "grid.height=36", "grid.depth=48"])
    scene, how = loaded.scene, loaded.settings
    bare = dataclasses.replace(scene, particles=tuple(dataclasses.replace(p, fom_multiplier=0.0)
                                                      for p in scene.particles))
    lone = dataclasses.replace(scene, local_media=())
    both, of_fog, off = (run_frame(s, h) for s, h in (
        (scene, how), (bare, how), (scene, replace(how, volumetric_shadows="off"))))
    empty = run_frame(dataclasses.replace(scene, particles=(), local_media=(), global_media=()), how)
    only_particles = run_frame(lone, how)

    def darker(a: object, b: object, name: str) -> float:
        """Share of texels that are darker by a tenth and more."""
        one, other = (np.broadcast_to(f[name], np.broadcast_shapes(a[name].shape, b[name].shape)).sum(axis=0)
                      for f in (a, b))
        return float((one < 0.9 * other).mean())

    assert darker(of_fog, off, "lighting/in_scattering") > 0.01  # the fog on itself and the haze
    assert darker(of_fog, off, "particles/radiance") > 0.01  # the fog on particles
    assert darker(of_fog, off, "surface/radiance") > 0.05  # the fog on the floor
    assert darker(both, of_fog, "lighting/in_scattering") > 0.003  # particles on the fog
    assert darker(both, of_fog, "particles/radiance") > 0.01  # particles on themselves
    assert darker(both, of_fog, "surface/radiance") > 0.01  # particles on the floor
    assert darker(only_particles, empty, "surface/radiance") > 0.01
    without = plan(scene, replace(how, volumetric_shadows="off"))["fom"]
    assert (without.runs, without.why) == (False, "volumetric shadows are off")


def test_particles_in_fog_is_the_frame_by_exact_ways() -> None:
    """Mean difference a fifteenth of what the shadows are; measured 0.04."""
    loaded = scene_files.load("particles-in-fog", overrides=[
        "scene.camera.width=64", "scene.camera.height=36", "grid.width=32", "grid.height=18", "grid.depth=32"])
    maps, exact, off = (run_frame(loaded.scene, replace(loaded.settings, volumetric_shadows=word))[FINAL]
                        for word in ("maps", "exact", "off"))
    assert np.abs(maps - exact).mean() < np.abs(off - exact).mean() / 15


def test_bounding_the_range_removes_the_ringing() -> None:
    """Figures 3.17 and 3.21 of the thesis."""
    loaded = scene_files.load("ringing", overrides=[
        "scene.camera.width=64", "scene.camera.height=36", "grid.width=32", "grid.height=18", "grid.depth=32"])
    fixed, bounded, exact = (run_frame(loaded.scene, how)["particles/radiance"] for how in (
        loaded.settings, replace(loaded.settings, fom_range="bounded"),
        replace(loaded.settings, volumetric_shadows="exact")))
    assert loaded.settings.fom_range == "fixed"
    assert np.abs(fixed - exact).mean() > 2.5 * np.abs(bounded - exact).mean()


def test_a_cloud_is_its_particles() -> None:
    cloud = ParticleCloud(count=7, seed=3, low=(-1, 1, -1), high=(1, 2, 1))
    a, b = (opacity_maps(scene, HOW, load_assets(scene, None))["fom/coefficients"]
            for scene in (scene_of(LAMP, cloud), scene_of(LAMP, *cloud.particles())))
    assert a.tobytes() == b.tobytes()


def test_memory_stays_below_its_estimate_however_much_is_crossed() -> None:
    """Every ray of every lamp crosses many particles: 25 million crossings, of 32 bytes each when all are held."""
    rng = np.random.default_rng(3)
    puffs = tuple(Particle(position=tuple(rng.uniform(-1, 1, 3)), size=24.0, opacity=0.1) for _ in range(64))
    lamps = tuple(PointLight(position=tuple(rng.uniform(-2, 2, 3)), intensity=WHITE, radius=20) for _ in range(6))
    scene, how = Scene(particles=puffs, lights=lamps), Settings(volumetric_shadows="maps", grid=HOW.grid)
    assets = load_assets(scene, None)
    tracemalloc.start()
    try:
        opacity_maps(scene, how, assets)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert peak < 500e6 < 25e6 * 32
    assert peak < estimate_bytes(scene, how) + working_bytes(scene, how)


def test_what_is_kept_of_crossings_changes_nothing() -> None:
    ready = casting(placed_particles(Scene(particles=(ParticleCloud(count=200, size=(0.5, 2.0)),)),
                                     load_assets(Scene(), None)))
    ways = np.stack(np.meshgrid(np.linspace(-0.2, 0.2, 9), np.linspace(-0.2, 0.2, 9), [-1.0])).reshape(3, -1)
    asked: list[int] = []

    def cross(some: Particles) -> Crossings:
        asked.append(some.size.size)
        return lamp_hits(some, (0.0, 2.0, 9.0), ways)

    whole = cross(ready)
    for keep in (0, whole.ray.size // 2, whole.ray.size):
        asked.clear()
        parts = crossed(ready, cross, rays=AT_ONCE // 16, keep=keep)  # 16 particles at first
        for _ in range(2):
            found = [crossings for _, crossings in parts()]
            order = np.concatenate([each.distance for each in found])
            np.testing.assert_array_equal(np.sort(order), np.sort(whole.distance))
        assert 200 <= sum(asked) <= 400
        assert (sum(asked) == 200) == (keep == whole.ray.size)
        assert (sum(asked) == 400) == (keep == 0)


@pytest.mark.parametrize("light", ["sun", "lamp"])
def test_memory_stays_below_its_estimate_on_large_maps(light: str) -> None:
    """Sixteen particles that cover every ray of maps of 1024²: 16 million crossings a map."""
    cloud = ParticleCloud(count=16, low=(-0.4, 0.4, -0.4), high=(0.4, 1.2, 0.4), size=(90, 100), profile="square")
    what = SUN if light == "sun" else dataclasses.replace(LAMP, position=(0, 0.5, 0), radius=300)
    scene = Scene(particles=(cloud,), lights=(what,), camera=CAMERA)
    how = replace(HOW, opacity_maps=OpacityMaps(directional_size=1024, large=1024), shadow_maps=ShadowMaps(cascades=1))
    assets = load_assets(scene, None)
    tracemalloc.start()
    try:
        opacity_maps(scene, how, assets)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert peak < estimate_bytes(scene, how) + working_bytes(scene, how)


def test_opacity_maps_too_large_are_named() -> None:
    how = replace(HOW, opacity_maps=OpacityMaps(directional_size=4096, harmonics=32, reconstruction="resolved"),
                  shadow_maps=ShadowMaps(cascades=16))
    with pytest.raises(InputError, match=r"^settings\.opacity_maps: need up to [0-9.]+ GiB, "):
        plan(Scene(particles=(PUFF,), lights=(SUN,), camera=CAMERA), how)
