"""Each departure of the sources through the settings, end to end: what it does, and how large that is."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from froxel_ref import scene_files
from froxel_ref.frame import FINAL, Frame, run_frame
from froxel_ref.scene import (
    Camera,
    DirectionalLight,
    HeightFog,
    Medium,
    Plane,
    PointLight,
    Scene,
    SpotLight,
)
from froxel_ref.settings import SWITCHES, Grid, Settings, replace

GRID = Grid(width=12, height=8, depth=16)
FOG = Medium(albedo=(0.5, 0.5, 0.5), extinction=0.1)
SUN = DirectionalLight(direction=(0.0, 1.0, 0.0), irradiance=(2.0, 2.0, 2.0))
CAMERA = Camera(position=(0.0, 2.0, 0.0), target=(0.0, 2.0, -1.0), width=16, height=9)


def hall() -> Scene:
    """The thesis's hall, small, with glowing fog and an exposure, so that every switch has something to say."""
    scene = scene_files.load("thesis-hall").scene
    glowing = dataclasses.replace(scene.global_media[0], emissive=(0.02, 0.01, 0.005))
    camera = dataclasses.replace(scene.camera, width=48, height=27, exposure=2.0)
    return dataclasses.replace(scene, camera=camera, global_media=(glowing,))


def picture(frame: Frame) -> np.ndarray:
    return frame[FINAL] * frame.display_exposure


# Root mean square difference over mean radiance, from `benchmarks/departures.py` at full size (CONVENTIONS.md).
SIZES = {
    "emission=published": 0.30, "emission=absorption": 0.30, "integrator=simple": 1.15, "lookup=centre": 7.3e-3,
    "integrate_from=near": 9.5e-3, "phase_mixing=mean": 3.9e-3, "phase_mixing=mixture": 3.1e-4,
    "density_addressing=clamp": 9.8e-5, "ambient=constant": 4.0e-3,
}


@pytest.mark.parametrize("switch", SIZES)
def test_sizes_are_what_the_table_says(switch: str) -> None:
    how = Settings(grid=Grid(width=48, height=27, depth=64))
    name, value = switch.split("=")
    right, wrong = picture(run_frame(hall(), how)), picture(run_frame(hall(), replace(how, **{name: value})))
    size = math.sqrt(np.mean((wrong - right) ** 2)) / right.mean()
    # A third of the resolution moves them by less than a factor of 4.
    assert SIZES[switch] / 4 < size < SIZES[switch] * 4


# Likewise, with volumetric shadows: of the scene that asks the question.
DIMMED = {
    ("thesis-hall", "fom_samples=front"): 2.2e-3, ("thesis-hall", "fom_samples=dithered"): 2.4e-3,
    ("thesis-hall", "fom_samples=middle"): 6.8e-4, ("thesis-hall", "fom_range=fixed"): 3.0e-3,
    ("thesis-hall", "fom_tiles=small"): 1.6e-3, ("ringing", "fom_range=bounded"): 0.064,
    ("particles-in-fog", "fom_particles=centre"): 0.052, ("ringing", "fom_particles=centre"): 0.24,
}


@pytest.mark.parametrize(("name", "switch"), DIMMED)
def test_sizes_of_the_maps_are_what_the_table_says(name: str, switch: str) -> None:
    loaded = scene_files.load(name)
    camera = dataclasses.replace(loaded.scene.camera, width=64, height=36)
    scene = dataclasses.replace(loaded.scene, camera=camera)
    how = replace(loaded.settings, volumetric_shadows="maps",
                  grid=dataclasses.replace(loaded.settings.grid, width=48, height=27, depth=48))
    word, value = switch.split("=")
    right, wrong = picture(run_frame(scene, how)), picture(run_frame(scene, replace(how, **{word: value})))
    size = math.sqrt(np.mean((wrong - right) ** 2)) / right.mean()
    assert DIMMED[name, switch] / 4 < size < DIMMED[name, switch] * 4


@pytest.mark.parametrize("switch", SWITCHES)
def test_every_word_of_every_switch_runs(switch: str) -> None:
    how = Settings(grid=GRID)
    for value in dict.fromkeys(SWITCHES[switch]):
        assert run_frame(hall(), replace(how, **{switch: value}))[FINAL].shape == (3, 27, 48)


def test_published_albedo_of_nothing_reaches_the_picture() -> None:
    """D1: above max_height listing 3.1 divides 0 by 0, and listing 3.2 lights what came of it."""
    low = dataclasses.replace(FOG, height_fog=HeightFog(max_height=2.0))
    scene = Scene(camera=CAMERA, global_media=(low,), lights=(SUN,))
    right, published = (run_frame(scene, replace(Settings(grid=GRID), albedo_at_zero=value))
                        for value in ("zero", "divide"))
    empty = np.broadcast_to(right["media/extinction"] == 0.0, (16, 8, 12))
    assert 0.3 < empty.mean() < 0.7
    got = np.broadcast_to(published["lighting/in_scattering"], (3, 16, 8, 12))
    assert np.array_equal(np.isnan(got), np.broadcast_to(empty, got.shape))
    assert np.isnan(published[FINAL]).any()
    assert np.isfinite(right[FINAL]).all()


def test_what_does_not_scatter_glows_unless_published() -> None:
    """D2: a medium of albedo 0 with emission."""
    ember = Medium(albedo=(0.0, 0.0, 0.0), extinction=0.1, emissive=(1.0, 0.5, 0.25))
    scene = Scene(camera=CAMERA, global_media=(ember,))
    glow = {value: run_frame(scene, replace(Settings(grid=GRID), emission=value))["integrate/radiance"][0, -1]
            for value in dict.fromkeys(SWITCHES["emission"])}
    # j/σ·(1 − e^(−τ)), with j = 1 per metre as authored, or σ_a·L_e = 0.1.
    depth = 0.1 * 64.0 * np.broadcast_to(1.0, (8, 12))
    assert (glow["per_metre"] > 10.0 * (1.0 - np.exp(-depth)) * (1 - 1e-12)).all()
    np.testing.assert_allclose(glow["absorption"], 0.1 * glow["per_metre"], rtol=1e-14)
    assert (glow["published"] == 0.0).all()


def test_surface_inside_the_integral() -> None:
    """D5: eq. 2.9 adds the surface's radiance once per metre: times (1 − e^(−σs))/σ instead of e^(−σs)."""
    # A black wall would say nothing, so the fog is black and the wall lit by ambient light alone.
    scene = Scene(camera=CAMERA, global_media=(Medium(albedo=(0.0, 0.0, 0.0), extinction=0.1),), ambient=(1.0,) * 3,
                  surfaces=(Plane(point=(0.0, 0.0, -8.0), normal=(0.0, 0.0, 1.0), albedo=(0.5,) * 3),))
    fine = Settings(grid=Grid(width=16, height=9, depth=512, near=0.01, far=16.0))
    outside, inside = (run_frame(scene, replace(fine, surface_term=value))[FINAL] for value in ("outside", "inside"))
    x = (np.arange(16) + 0.5) / 16 * 2 - 1
    y = 1 - (np.arange(9) + 0.5) / 9 * 2
    tangent = math.tan(math.radians(30.0))
    path = 8.0 * np.sqrt(1 + (x * tangent * 16 / 9) ** 2 + ((y * tangent)[:, None]) ** 2)
    # 512 slices: the lookup's own error is about (slice)²·σ²/8 = 1e-5.
    np.testing.assert_allclose(outside, np.broadcast_to(0.5 * np.exp(-0.1 * path), outside.shape), rtol=3e-5)
    np.testing.assert_allclose(inside, np.broadcast_to(5.0 * -np.expm1(-0.1 * path), inside.shape), rtol=3e-5)


def test_power_of_lights() -> None:
    """A6: a point light's Φ/4π either way; a spot light's over its own cone, or over π whatever the cone."""
    lamp = PointLight(position=(0.0, 3.0, -5.0), power=(4 * math.pi,) * 3)
    spot = SpotLight(position=(0.0, 3.0, -5.0), power=(math.pi,) * 3, inner_angle=0.0, outer_angle=60.0)
    for light, corrected, author in ((lamp, 1.0, 1.0), (spot, 3.0, 1.0)):
        got = {}
        for value, intensity in (("solid_angle", corrected), ("author", author)):
            given_by_power = Scene(camera=CAMERA, global_media=(FOG,), lights=(light,))
            given = dataclasses.replace(light, power=None, intensity=(intensity,) * 3)
            by_intensity = dataclasses.replace(given_by_power, lights=(given,))
            got[value] = run_frame(given_by_power, replace(Settings(grid=GRID), light_power=value))[FINAL]
            np.testing.assert_allclose(got[value], run_frame(by_intensity, Settings(grid=GRID))[FINAL], rtol=1e-12)
        assert np.allclose(got["solid_angle"], got["author"]) == (corrected == author)


def test_first_slice_in_front_of_near_surfaces() -> None:
    """A11 by itself: only surfaces nearer than the first stored value change, and they darken."""
    near_wall = Plane(point=(0.0, 0.0, -0.2), normal=(0.0, 0.0, 1.0))
    for wall, changes in ((near_wall, True), (dataclasses.replace(near_wall, point=(0.0, 0.0, -9.0)), False)):
        scene = Scene(camera=CAMERA, global_media=(FOG,), lights=(SUN,), surfaces=(wall,))
        fog, slice_ = (run_frame(scene, replace(Settings(grid=GRID), near_surface=value))["apply/fog_transmittance"]
                       for value in ("fog", "first_slice"))
        assert np.any(fog != slice_) == changes
        assert (slice_ <= fog).all()
