"""The converged image against the frame, and the command that writes it."""

from __future__ import annotations

import dataclasses
import hashlib
import json
import math

import numpy as np
import pytest

from froxel_ref import load, run_frame
from froxel_ref.cli import main
from froxel_ref.cli_truth import _summary
from froxel_ref.panels import PAPER, View
from froxel_ref.records import InputError
from froxel_ref.scene import (
    Box,
    Camera,
    DirectionalLight,
    HeightFog,
    LocalMedium,
    Medium,
    Plane,
    PointLight,
    Scene,
    Transform,
)
from froxel_ref.scene_files import document
from froxel_ref.settings import Grid, Settings, replace
from froxel_ref.truth_files import Options
from froxel_ref.truth_image import FILTER_GAUSS, FILTER_KRONROD, FILTER_NODES, TruthImage, render_truth
from froxel_ref.truth_pictures import UNCONVERGED, difference, error_picture, overview

SIZE = ["scene.camera.width=24", "scene.camera.height=14"]


def test_surfaces_are_the_frames_own():
    """Without media, truth and frame are the same image, to the last bit."""
    scene, settings, _ = load("vacuum", overrides=SIZE)
    for shadows in ("off", "exact"):
        how = replace(settings, shadows=shadows)
        frame, truth = run_frame(scene, how), render_truth(scene, how)
        np.testing.assert_array_equal(truth.radiance, np.broadcast_to(frame["apply/radiance"], truth.radiance.shape))
        assert truth.converged.all()


def test_the_truths_shadows_are_the_scenes():
    """By default as the frame has them; what casts none casts none here."""
    scene, settings, _ = load("two-volumes", overrides=SIZE)
    ball = Box(transform=Transform(translate=(0, 2, -4), scale=(0.7, 0.1, 0.7)))
    scene = dataclasses.replace(scene, surfaces=(*scene.surfaces, ball))
    off, exact, default = (render_truth(scene, settings, shadows=kind).radiance for kind in ("off", "exact", None))
    assert np.array_equal(default, exact)
    assert not np.array_equal(off, exact)
    assert np.array_equal(render_truth(scene, replace(settings, shadows="off")).radiance, off)
    for changes in ({"surfaces": tuple(dataclasses.replace(s, casts_shadows=False) for s in scene.surfaces)},
                    {"lights": tuple(dataclasses.replace(light, casts_shadows=False) for light in scene.lights)}):
        free = render_truth(dataclasses.replace(scene, **changes), settings)
        np.testing.assert_allclose(free.radiance, off, rtol=1e-12)


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
    lit, dark = (render_truth(scene, shadows=kind) for kind in ("off", "exact"))
    np.testing.assert_allclose(lit.radiance, 1.0, rtol=1e-15)
    assert set(np.unique(dark.radiance.round(12))) == {0.0, 1.0}
    fog = dataclasses.replace(scene, global_media=(Medium(albedo=(0, 0, 0), extinction=(0.1, 0.2, 0.4)),))
    dim = render_truth(fog, shadows="off", volumetric_shadows=True, sun_distance=5.0)
    np.testing.assert_allclose(dim.radiance / dim.fog_transmittance,
                               np.exp([-0.5, -1.0, -2.0])[:, None, None] * np.ones((3, 8, 8)), rtol=1e-12)


def test_suns_may_be_dimmed_by_local_media_alone():
    """As in frames: a global medium dims no sun then, a lamp still, and a local one both."""
    fog = Medium(extinction=0.2, height_fog=HeightFog(start=0.0, falloff=0.5))
    puff = LocalMedium(shape="ellipsoid", extinction=2.0, transform=Transform(translate=(0, 3, -4), scale=(1, 1, 1)))
    sun = DirectionalLight(direction=(0, 1, 0), irradiance=(4, 4, 4))
    lamp = PointLight(position=(0, 6, -4), intensity=(9, 9, 9))
    camera = Camera(width=6, height=4)

    def light(sun_media, *, volumetric=True, **parts):
        return render_truth(Scene(camera=camera, **parts), rtol=1e-6, volumetric_shadows=volumetric,
                            sun_media=sun_media).radiance

    alone = {"global_media": (fog,), "lights": (sun,)}
    assert np.array_equal(light("local", **alone), light("all", volumetric=False, **alone))
    share = light("all", **alone) / light("local", **alone)
    assert (share < 0.95).all()
    assert (share < 0.7).any()
    lit = {"global_media": (fog,), "lights": (lamp,)}
    assert np.array_equal(light("local", **lit), light("all", **lit))
    # A constant medium without an end would leave a sun nothing; a local one dims it in both, where its shadow falls.
    both = {"global_media": (Medium(extinction=0.05),), "local_media": (puff,), "lights": (sun,)}
    shadowed, free = light("local", **both), light("local", volumetric=False, **both)
    assert (shadowed <= free).all()
    assert (shadowed < 0.9 * free).any()
    with pytest.raises(InputError, match="sun_media: is 'none', must be all or local"):
        light("none", **alone)


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
    assert (box.filter_error > 0.0).all()
    assert (box.filter_error < box.error).all()
    assert not render_truth(scene).filter_error.any()
    edge = Scene(camera=Camera(width=1, height=1, target=(0.3, 1.7, -1)), ambient=(1, 1, 1), background=(0, 0, 0),
                 surfaces=(Box(transform=Transform(translate=(0, 1.7, -3))),))
    assert render_truth(edge, pixel_filter="box").error[0, 0, 0] > 0.01


def test_unknown_filters_are_refused():
    with pytest.raises(InputError, match="pixel_filter: is 'gauss'"):
        render_truth(Scene(), pixel_filter="gauss")


# --- the command ------------------------------------------------------------------------------------


FILES = ["contact_sheet.png", "converged.npy", "error.npy", "error.png", "evaluations.npy", "fog_radiance.npy",
         "fog_transmittance.npy", "manifest.json", "radiance.npy", "radiance.png"]


def test_the_command_writes_image_error_and_picture(tmp_path, capsys):
    folder = tmp_path / "out"
    command = ["truth", "two-volumes", "--size", "16x9", "-o", str(folder)]
    assert main(command) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[-1] == str(folder / "contact_sheet.png")
    assert lines[0].startswith("rays: to reach 0.0001, all 144 pixels did; largest estimated error")
    scene, settings, _ = load("two-volumes", overrides=["scene.camera.width=16", "scene.camera.height=9"])
    want = render_truth(scene, settings)
    for name in ("radiance", "error", "fog_radiance"):
        np.testing.assert_array_equal(np.load(folder / f"{name}.npy"), np.moveaxis(getattr(want, name), 0, -1))
    np.testing.assert_array_equal(np.load(folder / "fog_transmittance.npy"), want.fog_transmittance)
    assert (folder / "radiance.png").stat().st_size > 100
    assert np.load(folder / "converged.npy").all()
    assert sorted(path.name for path in folder.iterdir()) == FILES
    assert main(command) == 2
    assert "exists; give --force" in capsys.readouterr().err
    before = {path.name: path.read_bytes() for path in folder.iterdir()}
    assert main([*command, "--force"]) == 0
    assert before == {path.name: path.read_bytes() for path in folder.iterdir()}
    (folder / "mine.txt").write_text("keep")
    assert main([*command, "--force"]) == 2
    assert (folder / "mine.txt").read_text() == "keep"


def test_the_manifest_says_what_the_arrays_are(tmp_path):
    folder = tmp_path / "out"
    assert main(["truth", "lights", "--size", "6x4", "--grid", "8x6x4", "--filter", "box", "--shadows", "exact",
                 "--rtol", "1e-2", "-o", str(folder)]) == 0
    manifest = json.loads((folder / "manifest.json").read_text(encoding="utf-8"))
    loaded = load("lights", overrides=["camera.width=6", "camera.height=4", "grid.width=8", "grid.height=6",
                                       "grid.depth=4"])
    assert manifest["input"] == document(loaded.scene, loaded.settings)
    assert manifest["truth"] == {"rtol": 1e-2, "shadows": "exact", "volumetric_shadows": False, "filter": "box"}
    assert (manifest["pixels"], manifest["unconverged"]) == (24, 0)
    entries = {entry["name"]: entry for entry in manifest["arrays"]}
    for name, entry in entries.items():
        array = np.load(folder / entry["file"])
        assert list(array.shape) == entry["shape"], name
        assert array.dtype.newbyteorder("<").str == entry["dtype"]
        assert entry["axes"] == ["y", "x", "channel"][:array.ndim]
        assert entry["sha256"] == hashlib.sha256((folder / entry["file"]).read_bytes()).hexdigest()
    assert {entry["file"] for entry in entries.values()} | set(manifest["pictures"]) | {"manifest.json"} == {
        path.name for path in folder.iterdir()}
    assert (np.load(folder / "filter_error.npy") <= np.load(folder / "error.npy")).all()
    frame = run_frame(loaded.scene, loaded.settings)
    truth = np.moveaxis(np.load(folder / "radiance.npy"), -1, 0)
    away = np.broadcast_to(frame["apply/radiance"], truth.shape) - truth
    against = manifest["frame_against_truth"]
    assert against["rms"] == pytest.approx(math.sqrt((away**2).mean()) / truth.mean(), rel=1e-12)
    x, y = against["pixel"]
    assert against["worst"] == pytest.approx(np.abs(away[:, y, x]).max() / truth[:, y, x].max(), rel=1e-12)


def test_a_folder_that_is_no_truth_is_never_replaced(tmp_path, capsys):
    """Names alone do not make it one."""
    (tmp_path / "radiance.npy").write_bytes(b"mine")
    assert main(["truth", "uniform", "--size", "2x2", "-o", str(tmp_path), "--force"]) == 2
    assert "holds 'radiance.npy', which is not part of a truth" in capsys.readouterr().err
    assert (tmp_path / "radiance.npy").read_bytes() == b"mine"


def made_image(missed=(), edges=0.0, error=1e-6):
    """Four pixels of radiance 1, with an error each."""
    converged = np.ones((2, 2), bool)
    for place in missed:
        converged[place] = False
    filtered = np.zeros((3, 2, 2))
    filtered[:, 0, 1] = edges
    ones = np.ones((3, 2, 2))
    return TruthImage(ones, error * ones + filtered, 0.5 * ones, ones[0], converged, np.full((2, 2), 15), filtered)


@pytest.mark.parametrize(("image", "kind", "says"), [
    (made_image(), "centre", ["rays: to reach 0.0001, all 4 pixels did; largest estimated error 2.0e-06"]),
    (made_image([(1, 0)]), "centre", ["rays: to reach 0.0001, 1 of 4 pixels did not; "]),
    (made_image(edges=0.43), "box", ["all 4 pixels did; largest estimated error 2.0e-06 of the fog's radiance",
                                     "filter: 1 of 4 pixels exceed 0.0001, where edges cross them; largest "
                                     "estimated error 4.3e-01"])])
def test_rays_and_filter_are_told_apart(image, kind, says):
    """A pixel that an edge crosses is no failure of the rays, and one in a million that failed is told."""
    lines = _summary(image, Options(1e-4, "off", False, kind))
    assert len(lines) == len(says)
    assert all(words in line for words, line in zip(says, lines, strict=True))


def test_pictures_of_the_error_mark_what_did_not_converge():
    good, bad = (error_picture(made_image(missed)) for missed in ([], [(1, 0), (0, 0)]))
    red = [(picture == UNCONVERGED).all(axis=-1).sum() for picture in (good, bad)]
    assert red[0] == 0
    assert red[1] == 380**2  # one of the two: they take turns; two texels in 760 px


def test_a_difference_by_hand():
    truth = np.array([[[1.0, 4.0], [0.0, 0.0]]] * 3)
    frame = truth + np.array([[[0.5, -1.0], [0.0, 3.0]], [[0.0, 0.0], [0.0, 0.0]], [[0.0, 2.0], [0.0, 0.0]]])
    found = difference(frame, truth)
    np.testing.assert_array_equal(found.relative, [[0.5, 0.5], [0.0, np.inf]])
    assert (found.worst, found.pixel, found.median) == (0.5, (0, 0), 0.5)
    assert found.rms == pytest.approx(math.sqrt((0.25 + 1 + 9 + 4) / 12) / 1.25, rel=1e-14)


@pytest.mark.parametrize(("size", "missing"), [((2, 2), 0.0), ((1, 1), 0.0), ((300, 2), np.inf), ((2, 900), 1.0)])
def test_the_overview_is_a_page_for_any_image(size, missing):
    """Nothing runs off it, whatever the shape, and whatever the difference is."""
    rng = np.random.default_rng(3)
    height, width = size
    truth = rng.random((3, height, width))
    ones = np.ones((height, width))
    image = TruthImage(truth, 1e-5 * truth, truth, ones, ones > 0, 15 * ones, 0 * truth)
    frame = np.where(truth > 0.5, truth, truth * (1 + (missing if np.isfinite(missing) else 1e300)))
    page = overview(image, frame, View(Camera(width=width, height=height), Grid()), title="t", facts="f",
                    frame_facts="g")
    assert page.dtype == np.uint8
    edge = np.concatenate([page[:20].reshape(-1, 3), page[-20:].reshape(-1, 3), page[:, :20].reshape(-1, 3),
                           page[:, -20:].reshape(-1, 3)])
    assert (edge == PAPER).all()


@pytest.mark.parametrize(("arguments", "message"), [
    (["uniform", "--rtol", "0"], "--rtol: is 0, must be at least 1e-13"),
    (["uniform", "--rtol", "1e-16"], "--rtol: is 1e-16, must be at least 1e-13"),
    (["uniform", "--rtol", "tight"], "--rtol: is 'tight', must be a number"),
    (["uniform", "--rtol", "١e-3"], "--rtol: is '١e-3', must be a number"),
    (["uniform", "--rtol", "nan"], "--rtol: is 'nan', must be a number"),
    (["uniform", "--rtol", "1_0e-3"], "--rtol: is '1_0e-3', must be a number"),
    (["vacuum"], "scene: has no medium with extinction or emission: nothing to integrate; to see its surfaces: "
                 "froxel-ref render vacuum"),
    (["uniform", "--set", "lights=[]"], "scene: has no light, no ambient light and no emission"),
    (["uniform", "--shadows", "soft"], "--shadows: is 'soft', must be off or exact"),
    (["uniform", "--filter", "tent"], "--filter: is 'tent', must be centre or box"),
    (["uniform", "--filter", "tent", "-o", "."], "--filter: is 'tent', must be centre or box"),
    (["uniform", "-o", ""], "output: is '', must be a name to write to"),
    (["uniform", "-o", "a/b/c"], "output: 'a/b/c' cannot be written: its folder does not exist"),
    (["uniform", "-o", "/no/such/place"], "output: '/no/such/place' cannot be written: its folder does not exist"),
])
def test_bad_commands_are_one_line(arguments, message, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(["truth", *arguments, "--size", "2x2"]) == 2
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 1
    assert lines[0].startswith(f"froxel-ref: error: {message}")
    assert not list(tmp_path.iterdir())


def test_lights_that_cast_no_shadows_are_not_dimmed_by_media() -> None:
    """As in a frame: what casts_shadows says holds for surfaces and media."""
    lamp = PointLight(position=(0, 2, -3), intensity=(5, 5, 5), radius=9)
    plain = dataclasses.replace(lamp, casts_shadows=False)
    scene = Scene(camera=Camera(position=(0, 1, 2), target=(0, 1, -1), width=4, height=3), surfaces=(Plane(),),
                  global_media=(Medium(extinction=0.3),))
    with_and_without = [[render_truth(dataclasses.replace(scene, lights=(light,)), shadows="off",
                                      volumetric_shadows=volumetric).radiance for volumetric in (False, True)]
                        for light in (lamp, plain)]
    assert with_and_without[0][1].max() < 0.9 * with_and_without[0][0].max()
    np.testing.assert_array_equal(with_and_without[1][0], with_and_without[1][1])
