"""Particles and transparent surfaces in the truth: closed forms, scalar loops, and the frame that tends to it."""

from __future__ import annotations

import dataclasses
import json
import math
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
import reference_particles as reference

from froxel_ref.assets import Assets, load_assets
from froxel_ref.cli import main
from froxel_ref.frame import run_frame
from froxel_ref.geometry import camera_rays
from froxel_ref.records import InputError
from froxel_ref.scene import (
    Box,
    Camera,
    DirectionalLight,
    LocalMedium,
    Medium,
    Particle,
    ParticleCloud,
    Plane,
    PointLight,
    Scene,
    Sphere,
    Transform,
    TransparentSurface,
)
from froxel_ref.scene_files import load
from froxel_ref.settings import Grid, Settings, replace
from froxel_ref.truth import make_truth_physics, trace, trace_layers
from froxel_ref.truth_image import TruthImage, render_truth
from froxel_ref.truth_input import make_lines
from froxel_ref.truth_layers import Layers, find_layers
from froxel_ref.veils import make_veil, veiled

CAMERA = Camera(position=(0, 0, 0), target=(0, 0, -1), vertical_fov=50, width=10, height=6)
FOG = Medium(albedo=(0.9, 0.6, 0.3), extinction=0.25)
AMBIENT = (0.5, 1.0, 2.0)
BEHIND = (7.0, 5.0, 3.0)
HOW = Settings(grid=Grid(far=20.0))
WHITE = (1.0, 1.0, 1.0)
SUN = DirectionalLight(direction=(0.3, 1.0, 0.2), irradiance=(4.0, 3.0, 2.0))
TEXTURE = np.random.default_rng(0).random((6, 9))


def with_texture(scene: Scene) -> Assets:
    """The scene's assets, without files: every texture is the same."""
    bare = dataclasses.replace(scene, particles=tuple(p for p in scene.particles if p.texture is None))
    return load_assets(bare, None)._replace(opacities={"a": TEXTURE})


# --- closed forms -----------------------------------------------------------------------------------


def fogged(distance: float, channel: int) -> tuple[float, float]:
    """Light and transmittance of the uniform fog under ambient light alone, up to a distance."""
    passed = math.exp(-0.25 * distance)
    return (0.9, 0.6, 0.3)[channel] * AMBIENT[channel] * (1.0 - passed), passed


def far_end(way: np.ndarray) -> float:
    """The distance along a ray at which it is 20 m deep."""
    return 20.0 / -way[2]


def expected(way: np.ndarray, layers: list[tuple[float, float, tuple[float, ...]]]) -> list[float]:
    """Layers of (distance, opacity, light) over one another from back to front, each fogged at its distance."""
    result = []
    for c in range(3):
        glow, passed = fogged(far_end(way), c)
        total = BEHIND[c] * passed + glow
        for distance, opacity, light in sorted(layers, reverse=True):
            glow, passed = fogged(distance, c)
            total = total * (1.0 - opacity) + opacity * (light[c] * passed + glow)
        result.append(total)
    return result


def ways() -> np.ndarray:
    rays = camera_rays(CAMERA, CAMERA.width, CAMERA.height)
    return np.stack([np.broadcast_to(c, rays.length.shape) for c in rays.per_depth]) / rays.length


def test_one_particle_before_a_background() -> None:
    albedo = (0.25, 0.5, 1.0)
    puff = Particle(position=(0.2, 0.1, -4.0), size=2.0, opacity=0.6, profile="square", albedo=albedo)
    scene = Scene(camera=CAMERA, particles=(puff,), global_media=(FOG,), ambient=AMBIENT, background=BEHIND)
    image, every, hit = render_truth(scene, HOW, rtol=1e-9), ways(), 0
    for row in range(6):
        for column in range(10):
            way = tuple(every[:, row, column].tolist())
            found = reference.lamp_hit(puff, {}, (0.0, 0.0, 0.0), way)
            on = found is not None and found[1] > 0.0
            hit += on
            layers = [(found[0], 0.6, tuple(a * b for a, b in zip(albedo, AMBIENT, strict=True)))] if on else []
            np.testing.assert_allclose(image.radiance[:, row, column], expected(np.array(way), layers), rtol=1e-9)
            assert image.layer_transmittance[row, column] == pytest.approx(0.4 if on else 1.0, rel=1e-15)
    assert 4 < hit < 40
    assert image.converged.all()


def test_panes_in_uniform_fog() -> None:
    """Two planes that cross in the image: which of them is in front changes from pixel to pixel."""
    panes = [Plane(point=(0, 0, -5), normal=(0.8, 0.0, 1.0), albedo=(0.5, 0.25, 1.0)),
             Plane(point=(0, 0, -5), normal=(-0.8, 0.0, 1.0), albedo=(1.0, 0.5, 0.25))]
    scene = Scene(camera=CAMERA, global_media=(FOG,), ambient=AMBIENT, background=BEHIND,
                  transparent_surfaces=tuple(TransparentSurface(surface=p, opacity=o)
                                             for p, o in zip(panes, (0.3, 0.8), strict=True)))
    image, every = render_truth(scene, HOW, rtol=1e-9), ways()
    order = set()
    for column in range(10):
        way = every[:, 2, column]
        layers = []
        for pane, opacity in zip(panes, (0.3, 0.8), strict=True):
            t = np.dot(pane.point, pane.normal) / np.dot(way, pane.normal)
            layers.append((t, opacity, tuple(a * b for a, b in zip(pane.albedo, AMBIENT, strict=True))))
        order.add(layers[0][0] < layers[1][0])
        np.testing.assert_allclose(image.radiance[:, 2, column], expected(way, layers), rtol=1e-9)
    assert order == {True, False}
    assert (image.fog_radiance > 0.0).all()
    np.testing.assert_allclose(image.layer_transmittance, 0.14, rtol=1e-14)


def test_nothing_shows_behind_what_is_opaque() -> None:
    """An opaque pane is the opaque surface, and the fog behind it costs nothing."""
    wall = Plane(point=(0, 0, -3), normal=(0.1, 0.2, 1.0), casts_shadows=False)
    scene = Scene(camera=CAMERA, lights=(SUN,), global_media=(FOG,), ambient=AMBIENT, background=BEHIND)
    solid = render_truth(dataclasses.replace(scene, surfaces=(wall,)), HOW, rtol=1e-6)
    pane = render_truth(dataclasses.replace(scene, transparent_surfaces=(TransparentSurface(surface=wall, opacity=1),),
                                            particles=(Particle(position=(0, 0, -8)),)), HOW, rtol=1e-6)
    np.testing.assert_allclose(pane.radiance, solid.radiance, rtol=1e-12)
    assert (pane.layer_transmittance == 0.0).all()
    assert pane.evaluations.max() <= solid.evaluations.max()


# --- shadows ----------------------------------------------------------------------------------------


def marched(scene: Scene, way: np.ndarray, end: float, light: DirectionalLight | PointLight, steps: int) -> np.ndarray:
    """Light scattered to the origin by isotropic uniform fog under one light, by the midpoint rule, point by point."""
    total = np.zeros(3)
    medium, step = scene.global_media[0], end / steps
    for i in range(steps):
        t = (i + 0.5) * step
        point = tuple((t * way).tolist())
        arriving = reference.transmittance(scene.all_particles, {"a": TEXTURE.tolist()}, light, point)
        if isinstance(light, PointLight):
            d2 = sum((a - b) ** 2 for a, b in zip(light.position, point, strict=True))
            arriving *= math.exp(-medium.extinction * math.sqrt(d2)) / d2 * max(1 - (d2 / light.radius**2) ** 2, 0) ** 2
        tint = light.intensity if isinstance(light, PointLight) else light.irradiance
        total += np.array(tint) * arriving * math.exp(-medium.extinction * t) * step
    return total * np.array(medium.albedo) * medium.extinction / (4.0 * math.pi)


LAMP = PointLight(position=(1.0, 5.0, -6.0), intensity=(40.0, 30.0, 20.0), radius=25.0)


@pytest.mark.parametrize("light", [SUN, LAMP], ids=["sun", "lamp"])
@pytest.mark.parametrize("profile", ["square", "disc", "soft", "texture"])
def test_a_particles_shadow_in_uniform_fog(light: DirectionalLight | PointLight, profile: str) -> None:
    """Against a scalar midpoint rule: at a jump it is off by up to a step's light, 1/steps of the whole."""
    rng = np.random.default_rng(2)
    puffs = tuple(Particle(position=tuple(rng.uniform((-2, 1, -9), (2, 3, -4)).tolist()), size=1.6, opacity=0.8,
                           rotation=float(20 * i), fom_multiplier=1.5, texture="a" if profile == "texture" else None,
                           profile="soft" if profile == "texture" else profile) for i in range(4))
    scene = Scene(lights=(light,), particles=puffs, global_media=(dataclasses.replace(FOG, extinction=0.06),))
    way = np.array([(0.02, 0.05, -1.0), (-0.1, -0.02, -1.0), (0.05, -0.1, -1.0)]).T
    way = way / np.sqrt((way * way).sum(axis=0))
    found = trace(scene, [[0.0]] * 3, way, 12.0, assets=with_texture(scene), volumetric_shadows=True, rtol=1e-7)
    clear = trace(dataclasses.replace(scene, particles=()), [[0.0]] * 3, way, 12.0, volumetric_shadows=True, rtol=1e-7)
    assert found.converged.all()
    assert (found.radiance < clear.radiance).all()
    assert (found.radiance < 0.95 * clear.radiance).any()
    want = np.stack([marched(scene, w, 12.0, light, 2000) for w in way.T], axis=1)
    np.testing.assert_allclose(found.radiance, want, rtol=1e-3)


def test_a_square_in_closed_form() -> None:
    """A sun from above, a level ray of 10 m, a shadow from 4 to 6 m: an exponential less a part of it."""
    scene = Scene(lights=(DirectionalLight(direction=(0, 1, 0), irradiance=(math.pi, 0, 0)),), global_media=(
        Medium(albedo=WHITE, extinction=0.1),), particles=(
        Particle(position=(0, 2, -5), size=2.0, opacity=0.75, profile="square"),))
    found = trace(scene, [[0.0]] * 3, [[0.0], [0.0], [-1.0]], 10.0, volumetric_shadows=True, rtol=1e-12)
    want = 0.25 * ((1 - math.exp(-1)) - 0.75 * (math.exp(-0.4) - math.exp(-0.6)))
    assert found.radiance[0, 0] == pytest.approx(want, rel=1e-12)
    plain = trace(scene, [[0.0]] * 3, [[0.0], [0.0], [-1.0]], 10.0, rtol=1e-12)
    assert plain.radiance[0, 0] == pytest.approx(0.25 * (1 - math.exp(-1)), rel=1e-12)


def test_who_casts_and_who_is_dimmed() -> None:
    """Particles without a multiplier cast nothing; lights that cast no shadows are dimmed by none."""
    scene = Scene(camera=CAMERA, lights=(SUN,), global_media=(FOG,), surfaces=(Plane(point=(0, -1, 0)),),
                  particles=(ParticleCloud(count=9, low=(-2, 0, -7), high=(2, 1, -4), opacity=(0.9, 0.9)),))
    dim, clear = (render_truth(scene, HOW, volumetric_shadows=word) for word in (True, False))
    assert (dim.radiance <= clear.radiance).all()
    assert dim.fog_radiance.min(initial=1.0, where=clear.fog_radiance > 0) < clear.fog_radiance.max()
    assert (dim.fog_radiance < 0.99 * clear.fog_radiance).any()
    for changes in ({"lights": (dataclasses.replace(SUN, casts_shadows=False),)},
                    {"particles": tuple(dataclasses.replace(p, fom_multiplier=0) for p in scene.all_particles)}):
        free = [render_truth(dataclasses.replace(scene, **changes), HOW, volumetric_shadows=word)
                for word in (True, False)]
        np.testing.assert_allclose(free[0].radiance, free[1].radiance, rtol=1e-13)


def test_sizes_are_the_settings() -> None:
    """A9: half edges instead of edges, in the fog's shadows, on surfaces and in the image."""
    scene = Scene(camera=CAMERA, lights=(LAMP,), global_media=(FOG,), surfaces=(Plane(point=(0, -1, 0)),),
                  particles=(ParticleCloud(count=9, low=(-2, 0, -7), high=(2, 1, -4)),))
    twice = dataclasses.replace(scene, particles=tuple(dataclasses.replace(p, size=2 * p.size)
                                                       for p in scene.all_particles))
    half = render_truth(scene, replace(HOW, fom_particles="centre"), volumetric_shadows=True)
    edge = render_truth(twice, HOW, volumetric_shadows=True)
    np.testing.assert_array_equal(half.radiance, edge.radiance)
    assert not np.array_equal(half.radiance, render_truth(scene, HOW, volumetric_shadows=True).radiance)


def test_places_of_particles_round_as_others_do() -> None:
    """Edges of shadows are found from the rays' origins: far away their rounding is part of the estimate."""
    puffs = Scene(lights=(SUN,), particles=(Particle(position=(0, 2, -5)),), global_media=(FOG,))
    assert make_truth_physics(puffs, HOW, None, "off", True, math.inf).anchored
    assert not make_truth_physics(puffs, HOW, None, "off", False, math.inf).anchored


def test_coloured_extinction_is_each_channels_own() -> None:
    scene = Scene(camera=CAMERA, lights=(LAMP,), global_media=(dataclasses.replace(FOG, extinction=(0.1, 0.2, 0.4)),),
                  particles=(ParticleCloud(count=6, low=(-2, -1, -7), high=(2, 1, -4)),),
                  transparent_surfaces=(TransparentSurface(surface=Plane(point=(0, 0, -5), normal=(0, 0.2, 1))),))
    image = render_truth(scene, HOW, volumetric_shadows=True, rtol=1e-7)
    for channel, extinction in enumerate((0.1, 0.2, 0.4)):
        grey = render_truth(dataclasses.replace(scene, global_media=(dataclasses.replace(FOG, extinction=extinction),)),
                            HOW, volumetric_shadows=True, rtol=1e-7)
        for name in ("radiance", "layer_radiance"):
            np.testing.assert_allclose(getattr(image, name)[channel], getattr(grey, name)[channel], rtol=1e-6)


# --- the frame --------------------------------------------------------------------------------------


CROWD = Scene(
    camera=dataclasses.replace(CAMERA, exposure=1.5, width=24, height=14), lights=(SUN, LAMP), ambient=AMBIENT,
    background=BEHIND, surfaces=(Plane(point=(0, -1.5, 0)), Box(transform=Transform(translate=(1, 0, -8)))),
    particles=(ParticleCloud(count=40, low=(-3, -1.6, -9), high=(3, 2, -1), opacity=(0.1, 1.0), size=(0.4, 2.5),
                             phase_anisotropy=0.4, profile="square"),
               ParticleCloud(count=30, seed=2, low=(-3, -1, -9), high=(3, 2, -3), albedo=(1, 0.5, 0.2))),
    transparent_surfaces=tuple(TransparentSurface(surface=s, opacity=o) for s, o in (
        (Plane(point=(0, 0, -5), normal=(0.8, 0.0, 1.0), albedo=(0.5, 0.25, 1.0)), 0.4),
        (Sphere(center=(-1, 0, -5), radius=1.5, albedo=(0.2, 1, 0.5)), 0.5),
        (Plane(point=(0, 0, -5), normal=(-0.8, 0.0, 1.0)), 0.2))))


@pytest.mark.parametrize("changes", [{}, {"particles_lit_at": "centre"}, {"exposure": "lighting"},
                                     {"shadows": "off", "volumetric_shadows": "off"}, {"fom_particles": "centre"},
                                     {"attenuation": "inverse_radius"}], ids=lambda c: next(iter(c), "plain"))
def test_without_fog_the_frame_is_the_truth(changes: dict[str, str]) -> None:
    """Same points, same light, same order: particles that cut each other and panes that cut them. Rounding apart."""
    how = replace(Settings(shadows="exact", volumetric_shadows="exact"), **changes)
    frame = run_frame(CROWD, how, outputs=["apply/radiance", "particles/radiance", "particles/transmittance"])
    image = render_truth(CROWD, how)
    np.testing.assert_allclose(image.layer_transmittance, frame["particles/transmittance"], rtol=1e-12)
    np.testing.assert_allclose(image.layer_radiance, frame["particles/radiance"], rtol=1e-11)
    np.testing.assert_allclose(image.radiance, frame["apply/radiance"], rtol=1e-11)
    assert (image.layer_transmittance < 0.5).mean() > 0.1


def test_layers_are_fogged_one_by_one() -> None:
    """A scalar loop from back to front over each pixel's layers, with the fog of a trace up to each of them."""
    scene = dataclasses.replace(CROWD, global_media=(FOG,), camera=dataclasses.replace(CROWD.camera, width=6, height=4),
                                local_media=(LocalMedium(extinction=0.4, transform=Transform(translate=(0, 0, -4))),))
    how = replace(Settings(grid=Grid(near=0.5, far=7.0)), integrate_from="near", shadows="exact",
                  volumetric_shadows="exact")
    image, assets = render_truth(scene, how, rtol=1e-9), load_assets(scene, None)
    rays = camera_rays(scene.camera, 6, 4)
    plain = render_truth(dataclasses.replace(scene, particles=(), transparent_surfaces=(), global_media=(),
                                             local_media=()), replace(how, volumetric_shadows="off"))
    bare = dataclasses.replace(scene, transparent_surfaces=())
    options = {"settings": how, "assets": assets, "shadows": "exact", "volumetric_shadows": True, "rtol": 1e-9}
    depth = run_frame(scene, how, outputs=["surface/depth"])["surface/depth"]
    layers = _layers_of(scene, how)
    crossed = 0
    for pixel in range(24):
        row, column = divmod(pixel, 6)
        length = float(rays.length[row, column])
        way = [[float(np.broadcast_to(c, (4, 6))[row, column]) / length] for c in rays.per_depth]
        start, end = 0.5 * length, min(float(depth[row, column]), 7.0) * length
        some = slice(layers.first[pixel], layers.first[pixel + 1])
        crossed += any(a > b for a, b in pairwise(layers.distance[some]))
        stops = np.clip([end, *layers.distance[some]], start, end)
        fog = trace(bare, [[c] for c in scene.camera.position], np.repeat(way, len(stops), axis=1), stops,
                    starts=start, **options)
        surface = (image.radiance - image.layer_radiance - image.fog_radiance)[:, row, column] / (
            image.fog_transmittance * image.layer_transmittance)[row, column]
        total = surface * fog.transmittance[0] + fog.radiance[:, 0]
        for j in reversed(range(some.stop - some.start)):
            alpha, light = layers.opacity[some][j], layers.radiance[:, some][:, j]
            total = total * (1 - alpha) + alpha * (light * fog.transmittance[j + 1] + fog.radiance[:, j + 1])
        np.testing.assert_allclose(image.radiance[:, row, column], total, rtol=1e-7)
    assert crossed > 3
    assert plain.layer_transmittance.shape == (1, 1)


def _layers_of(scene: Scene, how: Settings) -> Layers:
    """With the light of a truth's own sights, taken from layers that are opaque one at a time."""
    from froxel_ref.truth_image import _sights

    assets, camera = load_assets(scene, None), scene.camera
    rays = camera_rays(camera, camera.width, camera.height)
    physics = make_truth_physics(scene, how, assets, "exact", True, math.inf)
    depth = run_frame(scene, how, outputs=["surface/depth"])["surface/depth"]
    found = find_layers(scene, how, assets, rays, depth, _sights(physics, assets))
    assert found is not None
    return found


def test_the_frame_tends_to_it() -> None:
    """Four times the slices, a quarter of the way to the first: second order but where shadows have edges."""
    scene, settings, _ = load("particles-in-fog", overrides=["scene.camera.width=32", "scene.camera.height=18"])
    truth, errors = render_truth(scene, settings, rtol=1e-5), []
    for depth in (32, 128, 512):
        how = replace(settings, shadows="exact", volumetric_shadows="exact",
                      grid=Grid(width=32, height=18, depth=depth, near=16.0 / depth, far=16.0))
        frame = run_frame(scene, how, outputs=["apply/radiance"])["apply/radiance"]
        errors.append(np.abs(frame - truth.radiance))
    medians = [float(np.median(e)) / float(truth.radiance.mean()) for e in errors]
    # Measured: medians 5.6e-4, 6.1e-5, 8.5e-6; means 0.027, 4.5e-3, 3.6e-4, most of it at the lamp's glow.
    assert medians[0] > 5 * medians[1] > 25 * medians[2]
    assert medians[2] < 2e-5
    assert errors[2].mean() < 0.05 * errors[0].mean()


# --- the estimate -----------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["particles-in-fog", "ringing"])
@pytest.mark.parametrize("kind", ["soft", "disc", "square", "texture", "opaque", "small"])
def test_the_estimate_is_honest(name: str, kind: str) -> None:
    """What is told for 1e-3 bounds the difference to 1e-6, ray by ray, and all converge."""
    scene, settings, _ = load(name, overrides=["scene.camera.width=20", "scene.camera.height=11"])
    change = {"soft": {}, "disc": {"profile": "disc"}, "square": {"profile": "square"}, "texture": {"texture": "a"},
              "opaque": {"opacity": 1.0, "fom_multiplier": 0.3}, "small": {"size": 0.06, "opacity": 0.9}}[kind]
    scene = dataclasses.replace(scene, particles=tuple(dataclasses.replace(p, **change) for p in scene.all_particles))
    assets = with_texture(scene)
    rough, fine = (render_truth(scene, settings, assets=assets, rtol=rtol) for rtol in (1e-3, 1e-6))
    assert rough.converged.all()
    assert fine.converged.all()
    assert (np.abs(rough.fog_radiance - fine.fog_radiance) <= rough.error + fine.error).all()
    assert (rough.error <= 1e-3 * rough.fog_radiance).all()


def test_rays_that_give_up_are_told() -> None:
    scene, settings, _ = load("particles-in-fog")
    puffs = tuple(dataclasses.replace(p, texture="a") for p in scene.all_particles)
    scene = dataclasses.replace(scene, particles=puffs)
    physics = make_truth_physics(scene, settings, with_texture(scene), "exact", True, math.inf)
    towards = np.array([[-3.0], [-1.3], [-6.6]])
    line = make_lines([[c] for c in scene.camera.position], towards / np.linalg.norm(towards), 0.0, 9.0)
    few, none_left, _ = trace_layers(physics, line, None, rtol=1e-9, limit_rounds=1)
    assert not few.converged[0]
    assert none_left.shape == (3, 1)


# --- veils ------------------------------------------------------------------------------------------


def test_a_veil_against_its_definition() -> None:
    """Layers in any order of distances: what fog of a stretch counts is what a change of it makes of the image."""
    rng = np.random.default_rng(4)
    distance, opacity = rng.uniform(1, 9, (5, 6)), rng.uniform(0, 1, (5, 6))
    distance[0], opacity[0, 3:], distance[0, 3:] = np.sort(distance[0]), 0.0, np.inf
    opacity[1, 2] = 1.0
    veil = make_veil(distance, opacity)
    for row in range(5):
        for t in (0.5, *np.sort(distance[row][np.isfinite(distance[row])]) + 1e-9):
            total = 1.0
            for j in reversed(range(6)):
                total = total * (1 - opacity[row, j]) + opacity[row, j] * (distance[row, j] > t)
            assert veiled(veil, np.array([row]), np.array([t]))[0] == pytest.approx(total, abs=1e-15)


# --- the command, and what is left alone ------------------------------------------------------------


def test_every_built_in_scene_with_media_has_a_truth(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for name in ("particles-in-fog", "ringing"):
        folder = tmp_path / name
        assert main(["truth", name, "--size", "8x5", "--grid", "8x5x8", "--rtol", "1e-3", "-o", str(folder)]) == 0
        assert "all 40 pixels did" in capsys.readouterr().out
        entries = {entry["name"]: entry for entry in json.loads((folder / "manifest.json").read_text())["arrays"]}
        assert entries["layer_radiance"]["shape"] == [5, 8, 3]
        assert entries["layer_transmittance"]["shape"] == [5, 8]
        through = np.load(folder / "layer_transmittance.npy")
        assert through.min() < 0.5
        assert through.max() == 1.0
        assert main(["truth", name, "--size", "8x5", "--grid", "8x5x8", "-o", str(folder), "--force"]) == 0
        capsys.readouterr()


def test_a_scene_without_them_has_no_such_arrays(tmp_path: Path) -> None:
    assert main(["truth", "uniform", "--size", "4x3", "--grid", "4x3x4", "-o", str(tmp_path / "out")]) == 0
    assert not list((tmp_path / "out").glob("layer*"))
    image = render_truth(Scene(camera=CAMERA, global_media=(FOG,), ambient=AMBIENT), HOW)
    assert image.layer_radiance.shape == (3, 1, 1)
    assert not image.layer_radiance.any()
    assert image.layer_transmittance.tolist() == [[1.0]]


def test_layers_that_nothing_shows_change_no_bit() -> None:
    """Behind the camera, or behind a wall."""
    scene = Scene(camera=CAMERA, lights=(LAMP,), global_media=(FOG,), surfaces=(
        Plane(point=(0, 0, -6), normal=(0, 0, 1)),))
    want = render_truth(scene, HOW)
    for more in ({"particles": (Particle(position=(0, 0, 3)), Particle(position=(0, 0, -9)))},
                 {"transparent_surfaces": (TransparentSurface(surface=Plane(point=(0, 0, -7), normal=(0, 0, 1))),)}):
        got = render_truth(dataclasses.replace(scene, **more), HOW)
        for name in TruthImage._fields[:-2]:
            np.testing.assert_array_equal(getattr(got, name), getattr(want, name))
        assert (got.layer_transmittance == 1.0).all()
        assert got.layer_transmittance.shape == (6, 10)


def test_the_box_filter_takes_their_edges() -> None:
    scene = Scene(camera=dataclasses.replace(CAMERA, width=3, height=2), global_media=(FOG,), ambient=AMBIENT,
                  particles=(Particle(position=(0.4, 0.2, -4), size=1.5, opacity=0.9, profile="square"),))
    box = render_truth(scene, HOW, rtol=1e-4, pixel_filter="box")
    fine = render_truth(dataclasses.replace(scene, camera=dataclasses.replace(CAMERA, width=63, height=42)), HOW)
    mean = fine.layer_transmittance.reshape(2, 21, 3, 21).mean(axis=(1, 3))
    assert np.abs(box.layer_transmittance - mean).max() < 0.06
    assert (np.abs(box.radiance - fine.radiance.reshape(3, 2, 21, 3, 21).mean(axis=(2, 4))) <= box.error + 0.05).all()


def test_bad_options_are_told_apart() -> None:
    with pytest.raises(InputError, match=r"^threads: is 0, must be a whole number"):
        render_truth(CROWD, threads=0)
