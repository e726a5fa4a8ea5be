"""The converged image against the frame, and the command that writes it."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from froxel_ref import load, run_frame
from froxel_ref.cli import main
from froxel_ref.records import InputError
from froxel_ref.scene import Box, Camera, DirectionalLight, Medium, Plane, Scene, Transform
from froxel_ref.settings import Grid, Settings, replace
from froxel_ref.truth_image import FILTER_GAUSS, FILTER_KRONROD, FILTER_NODES, render_truth

SIZE = ["scene.camera.width=24", "scene.camera.height=14"]


def test_surfaces_are_the_frames_own():
    """Without media, truth and frame are the same image, to the last bit."""
    scene, settings, _ = load("vacuum", overrides=SIZE)
    frame, truth = run_frame(scene, settings), render_truth(scene, settings)
    np.testing.assert_array_equal(truth.radiance, np.broadcast_to(frame["apply/radiance"], truth.radiance.shape))
    assert truth.converged.all()


@pytest.mark.parametrize("name", ["uniform", "lights", "two-volumes", "thesis-hall"])
def test_the_frame_is_near_the_truth(name):
    """At the frame's default grid: the differences are its discretisation, of known size."""
    scene, settings, folder = load(name, overrides=SIZE)
    from froxel_ref.assets import load_assets

    assets = load_assets(scene, folder)
    frame = run_frame(scene, settings, assets=assets)
    truth = render_truth(scene, settings, assets=assets)
    assert truth.converged.all()
    error = np.abs(frame["apply/fog_radiance"] - truth.fog_radiance)
    # Measured: 4e-5 (between the rays of froxels the lookup is linear), then 0.01 to 0.02 of the mean.
    assert error.mean() < (2e-4 if name == "uniform" else 0.04) * truth.fog_radiance.mean()


def test_switches_of_physics_are_followed():
    scene = Scene(camera=Camera(width=4, height=4, exposure=2.0), ambient=(1, 1, 1), background=(3, 3, 3),
                  global_media=(Medium(extinction=0.1),))
    grid = Grid(near=2.0, far=20.0)
    plain = render_truth(scene, Settings(grid=grid), rtol=1e-9)
    near = render_truth(scene, replace(Settings(grid=grid), integrate_from="near"), rtol=1e-9)
    bright = render_truth(scene, replace(Settings(grid=grid), exposure="lighting"), rtol=1e-9)
    np.testing.assert_allclose(bright.radiance, 2 * plain.radiance, rtol=1e-14)
    from froxel_ref.geometry import camera_rays

    length = camera_rays(scene.camera, 4, 4).length
    np.testing.assert_allclose(near.fog_transmittance, np.exp(-1.8 * length), rtol=1e-13)
    np.testing.assert_allclose(plain.fog_transmittance, np.exp(-2.0 * length), rtol=1e-13)
    far = render_truth(scene, Settings(grid=grid), far=1e3)
    assert (far.fog_transmittance < 1e-40).all()


def test_shadows_fall_on_surfaces():
    """Under a roof the floor is black; fog towards the sun dims what is beside it."""
    sun = DirectionalLight(direction=(0, 1, 0), irradiance=(math.pi,) * 3)
    scene = Scene(camera=Camera(position=(0, 2, 6), target=(0, 0, 0), width=8, height=8, vertical_fov=20),
                  lights=(sun,), surfaces=(Plane(albedo=(1, 1, 1)),
                                           Box(transform=Transform(translate=(0, 9, 0), scale=(0.1, 0.1, 9)))))
    lit, dark = render_truth(scene), render_truth(scene, shadows="exact")
    np.testing.assert_allclose(lit.radiance, 1.0, rtol=1e-15)
    assert set(np.unique(dark.radiance.round(12))) == {0.0, 1.0}
    fog = dataclasses.replace(scene, global_media=(Medium(albedo=(0, 0, 0), extinction=(0.1, 0.2, 0.4)),))
    dim = render_truth(fog, volumetric_shadows=True, sun_distance=5.0)
    np.testing.assert_allclose(dim.radiance / dim.fog_transmittance,
                               np.exp([-0.5, -1.0, -2.0])[:, None, None] * np.ones((3, 8, 8)), rtol=1e-12)


def test_the_box_filter_is_a_mean_over_pixels():
    """Its rule is exact for polynomials; on a smooth image it agrees with 15 × 15 times as many pixels."""
    for weights, degree in ((FILTER_KRONROD, 11), (FILTER_GAUSS, 5)):
        for power in range(degree + 1):
            assert weights @ FILTER_NODES**power == pytest.approx(1 / (power + 1), rel=1e-14)
    scene = Scene(camera=Camera(width=2, height=2), ambient=(1, 1, 1), global_media=(Medium(extinction=0.02),))
    box = render_truth(scene, rtol=1e-9, pixel_filter="box")
    fine = render_truth(dataclasses.replace(scene, camera=Camera(width=30, height=30)), rtol=1e-9)
    mean = fine.radiance.reshape(3, 2, 15, 2, 15).mean(axis=(2, 4))
    # The midpoint rule of 15 × 15 pixels is off by 3e-4.
    np.testing.assert_allclose(box.radiance, mean, rtol=1e-3)
    assert (box.error < 1e-4 * box.radiance).all()
    edge = Scene(camera=Camera(width=1, height=1, target=(0.3, 1.7, -1)), ambient=(1, 1, 1), background=(0, 0, 0),
                 surfaces=(Box(transform=Transform(translate=(0, 1.7, -3))),))
    assert render_truth(edge, pixel_filter="box").error[0, 0, 0] > 0.01


def test_unknown_filters_are_refused():
    with pytest.raises(InputError, match="pixel_filter: is 'gauss'"):
        render_truth(Scene(), pixel_filter="gauss")


# --- the command ------------------------------------------------------------------------------------


def test_the_command_writes_image_error_and_picture(tmp_path, capsys):
    folder = tmp_path / "out"
    command = ["truth", "two-volumes", "--size", "16x9", "-o", str(folder)]
    assert main(command) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[-1] == str(folder / "radiance.png")
    assert lines[-2].startswith("100.00% of 144 pixels converged, largest estimated error")
    radiance, error = np.load(folder / "radiance.npy"), np.load(folder / "error.npy")
    scene, settings, _ = load("two-volumes", overrides=["scene.camera.width=16", "scene.camera.height=9"])
    want = render_truth(scene, settings)
    np.testing.assert_array_equal(radiance, np.moveaxis(want.radiance, 0, -1))
    np.testing.assert_array_equal(error, np.moveaxis(want.error, 0, -1))
    assert (folder / "radiance.png").stat().st_size > 100
    assert np.load(folder / "converged.npy").all()
    assert main(command) == 2
    assert "exists; give --force" in capsys.readouterr().err
    assert main([*command, "--force"]) == 0
    (folder / "mine.txt").write_text("keep")
    assert main([*command, "--force"]) == 2
    assert (folder / "mine.txt").read_text() == "keep"


@pytest.mark.parametrize(("arguments", "message"), [
    (["uniform", "--rtol", "0"], "rtol: is 0, must be at least 1e-13"),
    (["uniform", "--rtol", "1e-16"], "rtol: is 1e-16, must be at least 1e-13"),
    (["uniform", "--rtol", "tight"], "--rtol: is 'tight', must be a number"),
    (["vacuum"], "scene: has no medium with extinction or emission: nothing to integrate"),
    (["uniform", "--set", "lights=[]"], "scene: has no light, no ambient light and no emission"),
    (["uniform", "--shadows", "maps"], "shadows: is 'maps'"),
    (["uniform", "--filter", "tent"], "pixel_filter: is 'tent'"),
    (["uniform", "-o", "/no/such/place"], "output: '/no/such/place' cannot be written: its folder does not exist"),
])
def test_bad_commands_are_one_line(arguments, message, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(["truth", *arguments, "--size", "2x2"]) == 2
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 1
    assert lines[0].startswith(f"froxel-ref: error: {message}")
    assert not list(tmp_path.iterdir())
