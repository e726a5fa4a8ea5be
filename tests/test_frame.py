"""The frame driver: closed forms end to end, and leaving out that changes nothing."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from froxel_ref import scene_files
from froxel_ref.assets import load_assets
from froxel_ref.frame import FINAL, QUANTITIES, estimate_bytes, plan, run_frame, working_bytes
from froxel_ref.geometry import camera_rays
from froxel_ref.grid import make_froxels
from froxel_ref.records import InputError
from froxel_ref.scene import Camera, DirectionalLight, ExtraLights, LocalMedium, Medium, PointLight, Scene
from froxel_ref.settings import Grid, Settings, ShadowMaps, replace

SMALL = Grid(width=12, height=8, depth=16)
BUILT_IN = [name for name in scene_files.builtin() if name != "smoke"]  # smoke needs files: test_real_input


MAPS = ShadowMaps(directional_size=32, spot_size=16, point_size=16)


def small(name: str, **changes: object) -> tuple[Scene, Settings]:
    """A built-in scene at a size for tests."""
    loaded = scene_files.load(name)
    camera = dataclasses.replace(loaded.scene.camera, width=32, height=18)
    how = replace(loaded.settings, grid=dataclasses.replace(SMALL, near=0.5, far=64.0), shadow_maps=MAPS,
                  **changes)
    return dataclasses.replace(loaded.scene, camera=camera), how


def uniform_scene(extinction: float, g: float, *, albedo: float = 0.9, fov: float = 75.0) -> Scene:
    return Scene(
        camera=Camera(position=(0.0, 0.0, 0.0), target=(0.3, 0.2, -1.0), vertical_fov=fov, width=24, height=16),
        global_media=(Medium(albedo=(albedo, 0.5, 1.0), extinction=extinction, phase_anisotropy=g),),
        lights=(DirectionalLight(direction=(0.4, 0.7, -0.5), irradiance=(3.0, 2.0, 1.0)),))


def closed_form(scene: Scene, how: Settings) -> tuple[np.ndarray, np.ndarray]:
    """L = σ_s·E·p·(1 − e^(−σs))/σ and T = e^(−σs) to every slice boundary, in extended precision.

    The rays and boundaries are taken as given (they are tested by themselves); the rest is written anew.
    """
    wide = np.longdouble
    medium, light = scene.global_media[0], scene.lights[0]
    froxels = make_froxels(scene.camera, how.grid)
    u = np.stack([np.broadcast_to(c, froxels.rays.length.shape) for c in froxels.rays.per_depth]).astype(wide)
    m = np.sqrt((u * u).sum(0))
    toward = np.array(light.direction, wide)
    toward /= np.sqrt((toward * toward).sum())
    chord = u / m - toward[:, None, None]
    versine = (chord * chord).sum(0) / 2
    g = wide(medium.phase_anisotropy)
    bend = (1 - g) ** 2 + 2 * g * versine
    four_pi = 4 * (wide(math.pi) + wide(1.2246467991473532e-16))  # and what the float64 of π leaves
    phase = (1 - g * g) / four_pi / (bend * np.sqrt(bend))
    start = 0 if how.integrate_from == "camera" else wide(how.grid.near)
    path = (froxels.boundaries[1:].astype(wide) - start) * m
    sigma = wide(medium.extinction)
    weight = -np.expm1(-sigma * path) / sigma if sigma else path
    albedo = np.array(medium.albedo, wide)[:, None, None, None]
    power = np.array(light.irradiance, wide)[:, None, None, None]
    return albedo * sigma * power * phase * weight, np.exp(-sigma * path)


def ulps_per_step(got: np.ndarray, want: np.ndarray) -> float:
    """The largest distance in float64 ulp, divided by the number of slices integrated."""
    steps = np.arange(1, want.shape[-3] + 1)[:, None, None]
    return float(np.max(np.abs(got - want) / np.spacing(want.astype(np.float64)) / steps))


@pytest.mark.parametrize("integrate_from", ["camera", "near"])
@pytest.mark.parametrize("g", [-0.9, -0.4, 0.0, 0.3, 0.6, 0.8, 0.95, 0.999])
@pytest.mark.parametrize("extinction", [1e-6, 0.01, 0.08])
def test_uniform_medium_is_the_closed_form(extinction: float, g: float, integrate_from: str) -> None:
    scene = uniform_scene(extinction, g)
    how = Settings(grid=Grid(width=24, height=16, depth=64), switches=dataclasses.replace(
        Settings().switches, integrate_from=integrate_from))
    frame = run_frame(scene, how)
    radiance, transmittance = closed_form(scene, how)
    # The required bound: 4 ulp per slice step, at every pixel and slice, off-axis ones too.
    assert ulps_per_step(frame["integrate/transmittance"], transmittance) <= 4
    assert ulps_per_step(frame["integrate/radiance"], radiance) <= 4


@pytest.mark.parametrize("precision", ["float64", "float32"])
def test_4096_slices_end_as_exact_as_one(precision: str) -> None:
    """S2: 8 ulp behind any number of slices; the plain sums, which grow with them, are far outside."""
    scene = uniform_scene(0.02, 0.6)
    how = Settings(grid=Grid(width=8, height=6, depth=4096), precision=precision)
    radiance, transmittance = closed_form(scene, dataclasses.replace(how, precision="float64"))
    froxels = [make_froxels(scene.camera, how.grid, dtype=np.dtype(name)) for name in ("float64", precision)]
    # What the rounded boundaries and rays themselves are off by is the grid's, not the sum's.
    paths = [f.boundaries[1:].astype(np.float64) * f.rays.length for f in froxels]
    moved = np.exp(0.02 * (paths[0] - paths[1]))
    worst = {}
    for word in ("compensated", "plain"):
        frame = run_frame(scene, replace(how, accumulation=word))
        got = frame["integrate/transmittance"]
        worst[word] = np.max(np.abs(got - transmittance * moved) / np.spacing(got))
        light = np.abs(frame["integrate/radiance"] - radiance)[:, 1000:] / radiance[:, 1000:]
        worst[word + " light"] = np.max(light) / np.finfo(precision).eps
    assert worst["compensated"] <= 8
    assert worst["plain"] > 30
    assert worst["compensated light"] < 0.2 * worst["plain light"]


def test_the_closed_form_test_can_fail() -> None:
    """A g that is off by 1e-12, or a planar path (D13), is far outside the bound."""
    scene = uniform_scene(0.02, 0.6)
    how = Settings(grid=Grid(width=24, height=16, depth=64))
    got = run_frame(scene, how)["integrate/radiance"]
    almost = dataclasses.replace(scene.global_media[0], phase_anisotropy=0.6 + 1e-12)
    radiance, _ = closed_form(dataclasses.replace(scene, global_media=(almost,)), how)
    assert ulps_per_step(got, radiance) > 100
    planar = closed_form(scene, how)[0] / np.asarray(make_froxels(scene.camera, how.grid).rays.length)
    assert ulps_per_step(got, planar) > 1e6


def test_the_picture_of_uniform_fog_is_its_last_boundary() -> None:
    """No surface: every pixel looks the fog up at the far boundary, at its own froxel (one pixel a froxel)."""
    scene = uniform_scene(0.02, 0.6)
    frame = run_frame(scene, Settings(grid=Grid(width=24, height=16, depth=64)))
    assert np.array_equal(frame["apply/fog_radiance"], frame["integrate/radiance"][:, -1])
    assert np.array_equal(frame[FINAL], frame["integrate/radiance"][:, -1])


@given(extinction=st.floats(0, 100), g=st.floats(-0.99, 0.99), fov=st.floats(20, 120))
@settings(max_examples=25)
def test_uniform_medium_any_extinction(extinction: float, g: float, fov: float) -> None:
    scene = uniform_scene(extinction, g, fov=fov)
    how = Settings(grid=Grid(width=8, height=6, depth=32))
    frame = run_frame(scene, how)
    radiance, transmittance = closed_form(scene, how)
    # e^(−τ) has condition number τ. A slice's depth is rounded as a step, as the ray's length (twice), as
    # their product and times σ: five roundings, so τ moves e^(−τ) by up to 5τ ulp beside the 4 per step.
    depth = -np.log(np.maximum(transmittance, np.finfo(np.float64).tiny))
    steps = np.arange(1, 33)[:, None, None]
    allowed = 4 * steps + 5 * depth
    spacing = np.spacing(transmittance.astype(np.float64))
    assert np.all(np.abs(frame["integrate/transmittance"] - transmittance) <= allowed * spacing)
    error = np.abs(frame["integrate/radiance"] - radiance) / np.spacing(radiance.astype(np.float64))
    assert np.all(error <= 4 * steps)


def test_albedo_of_nothing() -> None:
    """D1: where there is no medium the published V-Buffer divides 0 by 0, the corrected one has 0."""
    for albedo_at_zero in ("zero", "divide"):
        scene, how = small("two-volumes", albedo_at_zero=albedo_at_zero)
        clear = dataclasses.replace(scene, global_media=())
        frame = run_frame(clear, how, outputs=["media/albedo", "media/extinction"])
        empty = np.broadcast_to(frame["media/extinction"] == 0, frame["media/albedo"].shape)
        assert empty.any()
        assert np.isnan(frame["media/albedo"][empty]).all() == (albedo_at_zero == "divide")
        assert np.isfinite(frame["media/albedo"][~empty]).all()


def test_vacuum_is_exact() -> None:
    scene, how = small("vacuum")
    for force_all in (False, True):
        frame = run_frame(scene, how, force_all=force_all)
        assert np.all(frame["integrate/transmittance"] == 1.0)
        assert np.all(frame["integrate/radiance"] == 0.0)
        assert np.array_equal(frame[FINAL], np.broadcast_to(frame["surface/radiance"], frame[FINAL].shape))


# --- leaving out ------------------------------------------------------------------------------------


@pytest.mark.parametrize("precision", ["float64", "float32"])
@pytest.mark.parametrize("fidelity", ["corrected", "published", "author"])
@pytest.mark.parametrize("name", BUILT_IN)
def test_planned_equals_forced_bit_for_bit(name: str, fidelity: str, precision: str) -> None:
    scene, how = small(name, fidelity=fidelity, precision=precision)
    planned, forced = (run_frame(scene, how, force_all=force_all) for force_all in (False, True))
    for quantity in QUANTITIES:
        a, b = np.broadcast_arrays(planned[quantity], forced[quantity])
        assert a.tobytes() == b.tobytes(), quantity


@pytest.mark.parametrize("mixing", ["weighted", "mean", "mixture"])
def test_planned_equals_forced_with_overlapping_media(mixing: str) -> None:
    scene, how = small("thesis-hall", phase_mixing=mixing)
    planned, forced = (run_frame(scene, how, force_all=force_all)[FINAL] for force_all in (False, True))
    assert planned.tobytes() == forced.tobytes()


@pytest.mark.parametrize("media", [
    (Medium(phase_anisotropy=0.7),) * 3, (Medium(extinction=0.0, phase_anisotropy=0.95),),
    (Medium(phase_anisotropy=0.7), Medium(extinction=0.0, phase_anisotropy=-0.4)),
], ids=["three alike", "idle only", "one idle"])
def test_planned_equals_forced_where_a_plain_mean_counts_media(media: tuple[Medium, ...]) -> None:
    """D12: what counts media must not count what was forced; and must count what is idle."""
    scene = Scene(camera=Camera(width=16, height=9), global_media=media, local_media=(
        LocalMedium(extinction=0.2, phase_anisotropy=0.1),) * (len(media) == 2),
        lights=(DirectionalLight(direction=(1.0, 2.0, -3.0), irradiance=(1.0, 1.0, 1.0)),))
    how = replace(Settings(grid=SMALL), phase_mixing="mean")
    planned, forced = (run_frame(scene, how, force_all=force_all) for force_all in (False, True))
    for quantity in QUANTITIES:
        a, b = np.broadcast_arrays(planned[quantity], forced[quantity])
        assert a.tobytes() == b.tobytes(), quantity


def test_uniform_leaves_out_what_it_does_not_need() -> None:
    scene, how = small("uniform")
    the_plan = plan(scene, how)
    parts = {part.name: part for planned in the_plan.stages for part in planned.parts}
    for name in ("local media", "height fog", "density textures", "shadows", "point and spot lights"):
        assert not parts[name].runs
        assert parts[name].why
    assert [planned.name for planned in the_plan.left_out] == [
        "shadow", "fom", "surface", "long_range", "culling", "material", "merged", "temporal", "particles", "taa"]
    frame = run_frame(scene, how)
    assert frame["media/extinction"].shape == (1, 1, 1)
    assert frame["lighting/in_scattering"].shape == (3, 1, 8, 12)


def test_only_what_is_asked_for_runs_and_is_kept() -> None:
    scene, how = small("thesis-hall")
    frame = run_frame(scene, how, outputs=["media/extinction"])
    assert set(frame.results) == {"media/extinction"}
    assert set(frame.timings) == {"culling", "media"}  # the lists of local media
    fog = run_frame(dataclasses.replace(scene, local_media=(), lights=()), how, outputs=["media/extinction"])
    assert set(fog.timings) == {"media"}
    assert frame.plan["lighting"].why == "nothing that was asked for reads it"


def test_results_do_not_depend_on_threads() -> None:
    scene, how = small("thesis-hall")
    one, two, five = (run_frame(scene, how, threads=threads)[FINAL].tobytes() for threads in (1, 2, 5))
    assert one == two == five


def test_two_runs_are_identical() -> None:
    scene, how = small("two-volumes")
    first, second = (run_frame(scene, how) for _ in range(2))
    assert all(first[name].tobytes() == second[name].tobytes() for name in QUANTITIES)


# --- across stages ----------------------------------------------------------------------------------


def test_light_is_linear() -> None:
    scene, how = small("two-volumes")
    brighter = dataclasses.replace(scene, lights=tuple(
        dataclasses.replace(light, **{name: tuple(4 * c for c in getattr(light, name))})
        for light in scene.lights
        for name in (("intensity",) if isinstance(light, PointLight) else ("irradiance",))),
        ambient=tuple(4 * c for c in scene.ambient), background=tuple(4 * c for c in scene.background))
    one, four = (run_frame(s, how)[FINAL] for s in (scene, brighter))
    np.testing.assert_array_equal(4 * one, four)  # a power of two: exact


@pytest.mark.parametrize("factor", [0.125, 16.0])
def test_units_of_length_do_not_matter(factor: float) -> None:
    """Lengths × k, extinction ÷ k, intensity × k²: the same picture (k a power of two, so only exp differs)."""
    base = Scene(
        camera=Camera(position=(0, 1, 0), target=(0, 1, -1), width=16, height=9),
        global_media=(Medium(extinction=0.05, phase_anisotropy=0.4),),
        lights=(PointLight(position=(1.0, 2.0, -6.0), intensity=(5.0, 4.0, 3.0), radius=12.0),))
    scaled = Scene(
        camera=Camera(position=(0, factor, 0), target=(0, factor, -factor), width=16, height=9),
        global_media=(Medium(extinction=0.05 / factor, phase_anisotropy=0.4),),
        lights=(PointLight(position=(factor, 2 * factor, -6 * factor), radius=12.0 * factor,
                           intensity=(5 * factor**2, 4 * factor**2, 3 * factor**2), min_distance=0.01 * factor),))
    grids = [Grid(width=8, height=6, depth=16, near=0.5 * k, far=64 * k) for k in (1.0, factor)]
    pairs = zip((base, scaled), grids, strict=True)
    one, other = (run_frame(scene, Settings(grid=grid))[FINAL] for scene, grid in pairs)
    np.testing.assert_allclose(other, one, rtol=1e-14)  # measured: below 1e-15


@pytest.mark.parametrize("name", ["two-volumes", "particles-in-fog"])
def test_exposure_moves_into_the_lighting_without_changing_the_display(name: str) -> None:
    scene, how = small(name)
    scene = dataclasses.replace(scene, camera=dataclasses.replace(scene.camera, exposure=2.0))
    after, within = (run_frame(scene, replace(how, exposure=where)) for where in ("display", "lighting"))
    np.testing.assert_array_equal(after[FINAL] * after.display_exposure,
                                  within[FINAL] * within.display_exposure)


def test_every_fidelity_runs_and_differs() -> None:
    pictures = []
    for fidelity in ("corrected", "published", "author"):
        scene, how = small("thesis-hall", fidelity=fidelity)
        pictures.append(run_frame(scene, how)[FINAL])
        assert np.all(np.isfinite(pictures[-1]))
    assert np.any(pictures[0] != pictures[1])
    assert np.any(pictures[1] != pictures[2])


# --- what is refused --------------------------------------------------------------------------------


def test_unknown_output() -> None:
    with pytest.raises(InputError, match="outputs: 'media/extintion' is not a result; did you mean 'media/ext"):
        plan(Scene(), outputs=["media/extintion"])


def test_absurd_numbers_of_lights_and_lobes_are_refused_too() -> None:
    """65,536 lamps on a large grid keep two distances for each of its rays; a lobe is a volume of its own."""
    wide = Settings(grid=Grid(width=2048, height=2048, depth=2))
    with pytest.raises(InputError, match="GiB"):
        plan(Scene(extra_lights=ExtraLights(count=65536)), wide)
    assert working_bytes(Scene(extra_lights=ExtraLights(count=1000)), wide) > 1000 * 2 * 2048 * 2048 * 8
    many = tuple(Medium(phase_anisotropy=g / 100) for g in range(60))
    mixture = replace(Settings(), phase_mixing="mixture")
    assert working_bytes(Scene(global_media=many), mixture) > 60 * 3 * 160 * 90 * 64 * 8


def test_absurd_grid_is_refused_before_anything_is_allocated() -> None:
    with pytest.raises(InputError, match=r"settings.grid: 65536x65536x65536 froxels .* GiB"):
        run_frame(Scene(), Settings(grid=Grid(width=65536, height=65536, depth=65536)))


def test_estimate_holds_lobes_and_coloured_extinction() -> None:
    scene, how = small("two-volumes", phase_mixing="mixture")
    tinted = tuple(dataclasses.replace(medium, extinction=(0.1, 0.2, 0.3), phase_anisotropy=g)
                   for medium, g in zip(scene.local_media, (0.1, 0.7), strict=True))
    frame = run_frame(dataclasses.replace(scene, local_media=tinted), how, force_all=True)
    held = sum(field.nbytes for field in frame.results.values())
    assert held == estimate_bytes(dataclasses.replace(scene, local_media=tinted), how)


def test_estimate_is_the_sum_of_all_results_at_full_size() -> None:
    scene, how = small("thesis-hall")
    frame = run_frame(scene, how, force_all=True)
    camera, g = scene.camera, how.grid
    volume, image, face = g.width * g.height * g.depth, camera.width * camera.height, g.width * g.height
    assert frame["lighting/in_scattering"].size == 3 * volume
    media, lobes, lighting, integrated = 3 + 3 + 1 + 3 + 1, 0, 3, 3 + 1
    by_hand = 8 * ((media + lobes + lighting + integrated) * volume + g.depth + (3 + 1) * face
                   + (1 + 3 + 3 + 3 + 3 + 1 + 3 + 3 + 1) * image)
    # One sun with four cascades, nine lamps with six faces; a matrix of 12 numbers for each, an index a light.
    by_hand += 8 * (4 * (32 * 32 + 12) + 1 + 9 * (6 * (16 * 16 + 12) + 1))
    words = sum(frame[f"culling/{kind}_tiles"].shape[0] for kind in ("light", "medium"))
    assert words == 2
    by_hand += 4 * (9 + 1 + 2 * 2 * 256 + words * 3 * 4)  # order, bins, and 3 rows of 4 tiles
    assert estimate_bytes(scene, how) == by_hand


def test_rays_of_grid_and_image_see_the_same_frustum() -> None:
    camera = Camera(width=960, height=540)
    coarse, fine = camera_rays(camera, 160, 90), camera_rays(camera, 960, 540)
    for a, b in zip(coarse.per_depth, fine.per_depth, strict=True):
        a, b = np.broadcast_to(a, (90, 160)), np.broadcast_to(b, (540, 960))
        np.testing.assert_allclose(b.reshape(90, 6, 160, 6).mean((1, 3)), a, atol=1e-14)


def test_files_are_needed_and_said() -> None:
    loaded = scene_files.load("smoke")
    with pytest.raises(InputError, match="--data"):
        load_assets(loaded.scene, loaded.folder)
