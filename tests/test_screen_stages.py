"""The fog on the screen: lookups, the long range and temporal anti-aliasing as stages of a frame."""

from __future__ import annotations

import dataclasses
import json
import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from froxel_ref import load, preset, run_sequence
from froxel_ref.cli import main
from froxel_ref.frame import FINAL, QUANTITIES, Frame, estimate_bytes, plan, run_frame
from froxel_ref.quantities import AVERAGED, final_result
from froxel_ref.records import InputError
from froxel_ref.scene import (
    Box,
    Camera,
    DirectionalLight,
    HeightFog,
    Medium,
    Particle,
    Plane,
    PointLight,
    Scene,
    Sphere,
    Transform,
)
from froxel_ref.settings import AntiAliasing, FogLookup, Grid, LongRange, Settings, ShadowMaps, replace
from froxel_ref.taa import pixel_offsets
from froxel_ref.tonemap import FLOAT16_LARGEST_LUMA, luma

FOG = Medium(albedo=(0.5, 0.5, 0.5), extinction=0.02)
LONG = LongRange(march=True, farthest=400.0, noise=False)
GRID = Grid(width=8, height=6, depth=16, near=0.5, far=20.0)
CAMERA = Camera(position=(0, 2, 0), target=(0, 2, -1), width=16, height=12)
LIT = Scene(camera=CAMERA, global_media=(FOG,), ambient=(1.0, 2.0, 0.5), background=(0.3, 0.2, 0.1))
VARIED = Scene(
    camera=CAMERA, global_media=(dataclasses.replace(FOG, height_fog=HeightFog(falloff=0.1)),),
    ambient=(0.1, 0.1, 0.2), background=(0.3, 0.2, 0.1),
    lights=(DirectionalLight(direction=(0.3, 1.0, 0.2), irradiance=(3.0, 2.0, 2.0)),
            PointLight(position=(0.5, 3.0, -6.0), intensity=(9.0, 9.0, 9.0), radius=9.0)),
    surfaces=(Plane(), Sphere(center=(0, 2, -9), radius=1.5),
              Box(transform=Transform(translate=(3, 4, -60), scale=(2, 8, 2)))),
    particles=(Particle(position=(-1.0, 2.0, -5.0), opacity=0.5),))
ALL = Settings(grid=GRID, fog_lookup=FogLookup(method="noisy", bias=1.5, stored="tone_mapped", storage="float16"),
               long_range=LongRange(march=True, farthest=400.0), taa=AntiAliasing(on=True, storage="float16"))


def sequence(scene: Scene, settings: Settings, count: int, **more: object) -> list[Frame]:
    made: list[Frame] = []
    for number in range(count):
        made.append(run_frame(scene, settings, frame=number, previous=made[-1] if made else None, **more))  # type: ignore[arg-type]
    return made


# --- all of it --------------------------------------------------------------------------------------


@pytest.mark.parametrize("fidelity", ["corrected", "published", "author"])
@pytest.mark.parametrize("scene", [VARIED, LIT, Scene(camera=CAMERA)], ids=["varied", "fog", "nothing"])
def test_leaving_out_changes_nothing(scene: Scene, fidelity: str) -> None:
    how = replace(ALL, fidelity=fidelity)
    planned, forced = sequence(scene, how, 2), sequence(scene, how, 2, force_all=True)
    for one, other in zip(planned, forced, strict=True):
        np.testing.assert_array_equal(*np.broadcast_arrays(one.image, other.image))


def test_threads_change_nothing() -> None:
    one, many = (sequence(VARIED, ALL, 2, threads=n)[-1] for n in (1, 3))
    for name in one.results:
        np.testing.assert_array_equal(one[name], many[name], err_msg=name)


def test_what_is_off_leaves_no_array_and_no_stage() -> None:
    frame = run_frame(VARIED, Settings(grid=GRID))
    for name in ("long_range/depth", "long_range/radiance", "long_range/transmittance", AVERAGED):
        assert frame[name].size == 0
    assert {"long_range", "taa"} <= {planned.name for planned in frame.plan.left_out}
    assert frame.history is None
    forced = run_frame(VARIED, Settings(grid=GRID), force_all=True)
    assert forced["long_range/radiance"].size == forced[AVERAGED].size == 0


def test_the_final_image_goes_by_one_name() -> None:
    assert (final_result(Settings()), final_result(ALL)) == (FINAL, AVERAGED)
    frame = run_frame(LIT, ALL, outputs=[AVERAGED])
    assert frame.image is frame[AVERAGED]
    with pytest.raises(KeyError, match="taa/radiance"):
        _ = run_frame(LIT, ALL, outputs=[FINAL]).image


def test_the_estimate_counts_them() -> None:
    pixels = CAMERA.width * CAMERA.height
    more = estimate_bytes(VARIED, ALL) - estimate_bytes(VARIED, Settings(grid=GRID))
    assert more == 8 * (3 * pixels + 5 * pixels // 4)  # taa/radiance; half depth, radiance and transmittance
    frame = run_frame(VARIED, ALL)
    assert frame["long_range/radiance"].shape == (3, 6, 8)
    assert all(frame[name].size for name in QUANTITIES if name.startswith(("long_range", "taa")))


@pytest.mark.parametrize(("make", "message"), [
    (lambda: Settings(grid=GRID, long_range=LongRange(march=True, farthest=10.0)),
     "long_range.farthest: is 10 m, must be at least grid.far (20 m)"),
    (lambda: AntiAliasing(alpha=0.0), "alpha: is 0, must be above 0 and at most 1"),
    (lambda: AntiAliasing(alpha=1.5), "alpha: is 1.5, must be above 0 and at most 1"),
    (lambda: FogLookup(taps=5), "taps: is 5, must be at least 1 and at most 4"),
    (lambda: FogLookup(bias=-1.0), "bias: is -1"),
    (lambda: LongRange(steps=0), "steps: is 0, must be at least 1"),
])
def test_bad_settings_are_refused(make: Callable[[], object], message: str) -> None:
    with pytest.raises(InputError) as caught:
        make()
    assert str(caught.value).startswith(message)


# --- lookups ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("method", ["trilinear", "biquadratic", "noisy"])
@pytest.mark.parametrize("stored", ["linear", "tone_mapped"])
def test_fog_that_varies_nowhere_looks_the_same_by_every_lookup(method: str, stored: str) -> None:
    """Beyond the far end no offset and no bias leads anywhere else, once fog is as dense as to be one colour."""
    scene = dataclasses.replace(LIT, global_media=(dataclasses.replace(FOG, extinction=8.0),))
    how = Settings(grid=GRID, fog_lookup=FogLookup(method=method, stored=stored, bias=1.5))
    image = run_frame(scene, how).image
    # albedo times ambient light; a tone map and back is some 4 ulp of 1 + luma.
    np.testing.assert_allclose(image, np.broadcast_to(np.reshape([0.5, 1.0, 0.25], (3, 1, 1)), image.shape), rtol=2e-15)


@pytest.mark.parametrize("stored", ["linear", "tone_mapped"])
def test_a_bias_of_one_slice_finds_the_fog_of_the_boundary_before(stored: str) -> None:
    """At infinity the plain lookup has what is stored last; a bias of n slices what is stored n slices before."""
    one = dataclasses.replace(GRID, width=1, height=1)
    for bias in (0.0, 1.0, 3.0):
        frame = run_frame(LIT, Settings(grid=one, fog_lookup=FogLookup(bias=bias, stored=stored)))
        k = one.depth - 1 - int(bias)
        for name, volume in (("apply/fog_radiance", "integrate/radiance"),
                             ("apply/fog_transmittance", "integrate/transmittance")):
            found = frame[name].reshape(*frame[name].shape[:-2], -1)[..., 0]
            np.testing.assert_allclose(found, frame[volume][..., k, 0, 0], rtol=4e-15)


def test_a_bias_never_reaches_in_front_of_the_first_slice_if_that_is_what_near_surfaces_have() -> None:
    scene = dataclasses.replace(LIT, surfaces=(Box(transform=Transform(translate=(0, 2, -2), scale=(50, 50, 1.4))),))
    one = dataclasses.replace(GRID, width=1, height=1)
    how = Settings(grid=one, fog_lookup=FogLookup(bias=5.0))
    near = run_frame(scene, replace(how, near_surface="first_slice"))
    np.testing.assert_array_equal(near["apply/fog_transmittance"].ravel()[0], near["integrate/transmittance"][0, 0, 0])
    # Elsewhere it may: at five slices before what is 0.6 m away there is no fog at all.
    np.testing.assert_array_equal(run_frame(scene, how)["apply/fog_transmittance"].ravel()[0], 1.0)


def test_half_floats_round_what_is_looked_up() -> None:
    one = dataclasses.replace(GRID, width=1, height=1)
    for stored in ("linear", "tone_mapped"):
        how = Settings(grid=one, fog_lookup=FogLookup(stored=stored, storage="float16"))
        frame = run_frame(LIT, how)
        light = frame["integrate/radiance"][:, -1, 0, 0]
        t = light / (1.0 + luma(light)) if stored == "tone_mapped" else light
        rounded = t.astype(np.float16).astype(np.float64)
        expected = rounded / (1.0 - luma(rounded)) if stored == "tone_mapped" else rounded
        assert not np.array_equal(expected, light)
        np.testing.assert_allclose(frame["apply/fog_radiance"][:, 0, 0], expected, rtol=1e-14)


def test_the_inverse_tone_map_is_bounded_by_its_storage() -> None:
    """D9: light of a luma beyond 4095 is stored as 1."""
    bright = dataclasses.replace(LIT, ambient=(1e7,) * 3)
    how = Settings(grid=GRID, fog_lookup=FogLookup(stored="tone_mapped", storage="float16"))
    with np.errstate(divide="ignore"):
        found = {value: run_frame(bright, replace(how, inverse_tone_map=value))["apply/fog_radiance"].max()
                 for value in ("carried", "luma", "bounded")}
    assert found["luma"] == np.inf
    assert found["carried"] == pytest.approx(1.0 / (1.0 - FLOAT16_LARGEST_LUMA), rel=1e-12)
    assert found["bounded"] == pytest.approx(1e6, rel=1e-9)


def test_noise_is_another_one_each_frame_and_its_mean_is_the_plain_lookup() -> None:
    scene = dataclasses.replace(VARIED, particles=())
    plain = run_frame(scene, Settings(grid=GRID))["apply/fog_radiance"]
    off, spread = [], []
    for reach in (0.1, 0.05):
        how = Settings(grid=GRID, fog_lookup=FogLookup(method="noisy", reach=reach, bias=0.0))
        frames = [run_frame(scene, how, frame=n)["apply/fog_radiance"] for n in range(64)]
        assert not np.array_equal(frames[0], frames[1])
        off.append(np.sqrt(np.mean((np.mean(frames, axis=0) - plain) ** 2)))
        spread.append(np.sqrt(np.mean(np.std(frames, axis=0) ** 2)))
    # What noise adds is of first order in its reach; of its mean over 64 layers some eighth is left, and at creases of
    # the fetch the bend, of second order.
    assert 1.9 < spread[0] / spread[1] < 2.1
    assert off[1] < 3.0 / 8.0 * spread[1]


# --- long range -------------------------------------------------------------------------------------


def narrow(scene: Scene) -> Scene:
    """Seen by rays along the axis, to 1e-9."""
    return dataclasses.replace(scene, camera=dataclasses.replace(CAMERA, vertical_fov=0.002))


def test_uniform_fog_is_exact_to_the_farthest_depth() -> None:
    frame = run_frame(narrow(LIT), Settings(grid=GRID, long_range=LONG))
    passed = math.exp(-0.02 * 400.0)
    np.testing.assert_allclose(frame["apply/fog_transmittance"], passed, rtol=1e-8)
    for light, ambient in zip(frame["apply/fog_radiance"], LIT.ambient, strict=True):
        np.testing.assert_allclose(light, 0.5 * ambient * (1.0 - passed), rtol=1e-8)


def test_without_it_fog_ends_with_the_froxels() -> None:
    frame = run_frame(narrow(LIT), Settings(grid=GRID))
    np.testing.assert_allclose(frame["apply/fog_transmittance"], math.exp(-0.02 * 20.0), rtol=1e-8)


def test_pixels_whose_surface_lies_within_the_froxels_are_as_they_were() -> None:
    plain, long = (run_frame(VARIED, Settings(grid=GRID, long_range=how)) for how in (LongRange(), LONG))
    near = plain["surface/depth"] <= GRID.far
    assert 0.2 < near.mean() < 0.8
    np.testing.assert_array_equal(long[FINAL][:, near], plain[FINAL][:, near])
    assert (np.abs(long[FINAL] - plain[FINAL]).max(axis=0)[~near] > 1e-3).all()


@pytest.mark.parametrize("distance", [25.0, 70.0, 300.0])
def test_it_equals_froxels_that_reach_as_far(distance: float) -> None:
    """A wall in height fog and sunlight: 64 steps against 4096 slices, whose own error is below 1e-4."""
    wall = Box(transform=Transform(translate=(0, 0, -distance - 5), scale=(500, 500, 5)), casts_shadows=False)
    scene = dataclasses.replace(narrow(VARIED), surfaces=(wall,), particles=(), lights=VARIED.lights[:1])
    how = Settings(grid=dataclasses.replace(GRID, depth=1024), long_range=dataclasses.replace(LONG, steps=64))
    far = dataclasses.replace(GRID, depth=4096, far=320.0)
    for name in ("apply/fog_radiance", "apply/fog_transmittance"):
        np.testing.assert_allclose(run_frame(scene, how)[name], run_frame(scene, Settings(grid=far))[name], rtol=3e-4)


def test_it_goes_on_where_the_froxels_end() -> None:
    """A step of 1e-6 of the depth across the far end, where the light itself changes by as much."""
    found = []
    for share in (1.0 - 1e-6, 1.0 + 1e-6):
        wall = Box(transform=Transform(translate=(0, 0, -20.0 * share - 5), scale=(500, 500, 5)), casts_shadows=False)
        scene = dataclasses.replace(narrow(VARIED), surfaces=(wall,), particles=())
        found.append(run_frame(scene, Settings(grid=GRID, long_range=LONG)).image)
    np.testing.assert_allclose(found[1], found[0], rtol=1e-5)


def test_a_colour_of_its_own_for_every_extinction() -> None:
    tinted = dataclasses.replace(LIT, global_media=(dataclasses.replace(FOG, extinction=(0.01, 0.02, 0.03)),))
    frame = run_frame(narrow(tinted), Settings(grid=GRID, long_range=LONG))
    for passed, sigma in zip(frame["apply/fog_transmittance"], (0.01, 0.02, 0.03), strict=True):
        np.testing.assert_allclose(passed, math.exp(-sigma * 400.0), rtol=1e-7)


def test_switches_of_the_long_range_reach_it() -> None:
    base = Settings(grid=GRID, long_range=LONG)
    right = run_frame(VARIED, base)
    for switch in ("half_depth=farthest", "long_density=sampled", "long_judged=tap"):
        name, value = switch.split("=")
        wrong = run_frame(VARIED, replace(base, **{name: value}))
        assert not np.array_equal(right.image, wrong.image), switch
    np.testing.assert_array_equal(run_frame(VARIED, replace(base, half_depth="farthest"))["long_range/depth"] == 400,
                                  False)


def test_what_no_cascade_reaches_is_lit_whatever_froxels_have() -> None:
    """A4: the thesis's program has no sun there in froxels, and all of it in the march."""
    how = Settings(grid=GRID, long_range=LONG)
    scene = dataclasses.replace(VARIED, particles=())
    lit, dark = (run_frame(scene, replace(how, beyond_cascades=value)) for value in ("lit", "dark"))
    np.testing.assert_array_equal(lit["long_range/radiance"], dark["long_range/radiance"])
    assert lit["long_range/radiance"].max() > 0.01


def test_cascades_may_serve_the_long_range_too() -> None:
    """A shadow that begins behind the froxels: without a reach all is lit there."""
    wall = Box(transform=Transform(translate=(0, 0, -100), scale=(30, 30, 1)))
    sun = DirectionalLight(direction=(0.0, 1.0, -1.0), irradiance=(3.0, 2.0, 2.0))
    scene = dataclasses.replace(LIT, lights=(sun,), surfaces=(wall,), ambient=(0.0, 0.0, 0.0))
    how = Settings(grid=GRID, long_range=dataclasses.replace(LONG, steps=64))
    found = {name: run_frame(scene, each)["long_range/radiance"].mean() for name, each in {
        "lit": how, "exact": replace(how, shadows="exact"),
        "reach": replace(how, shadow_maps=ShadowMaps(reach=120.0))}.items()}
    assert found["exact"] < 0.95 * found["lit"]
    assert abs(found["reach"] / found["exact"] - 1.0) < 0.01
    with pytest.raises(InputError, match=r"shadow_maps\.reach: is 0\.1 m, must be above grid\.near"):
        replace(how, shadow_maps=ShadowMaps(reach=0.1))


def test_a_march_to_the_sun_dims_it() -> None:
    """From infinitely far fog of constant density no sun is left; along 1 m of it, little is lost."""
    scene = dataclasses.replace(LIT, lights=VARIED.lights[:1], ambient=(0.0, 0.0, 0.0))
    light = [run_frame(scene, Settings(grid=GRID, long_range=dataclasses.replace(LONG, sun_steps=4, sun_distance=d)))
             ["long_range/radiance"].max() for d in (1e4, 100.0, 1.0)]
    plain = run_frame(scene, Settings(grid=GRID, long_range=LONG))["long_range/radiance"].max()
    np.testing.assert_allclose(np.array(light[1:]) / plain, np.exp([-0.02 * 100.0, -0.02]), rtol=1e-9)
    assert light[0] < 1e-80


def test_jittered_rays_go_where_the_jittered_pixels_look() -> None:
    """With the image's own jitter, a tilted plane's half-resolution depth belongs to the shifted corner."""
    how = Settings(grid=GRID, long_range=LONG, taa=AntiAliasing(on=True))
    frame = run_frame(LIT, how, frame=3)
    right, down = pixel_offsets(3).tolist()
    tangent = math.tan(math.radians(30.0))
    v, u = tangent * (1 - 2 * (1 + down) / 12), tangent * 16 / 12 * (2 * (1 + right) / 16 - 1)
    length = math.sqrt(1 + u * u + v * v)
    np.testing.assert_allclose(frame["long_range/transmittance"][0, 0], math.exp(-0.02 * 380.0 * length), rtol=1e-12)


# --- temporal anti-aliasing -------------------------------------------------------------------------


EDGE = Scene(camera=CAMERA, background=(0.0, 0.0, 0.0), ambient=(1.0, 1.0, 1.0),
             surfaces=(Box(transform=Transform(translate=(5.03, 2, -6), scale=(5, 50, 1))),))


def coverage(frames: list[Frame]) -> np.ndarray:
    """Mean over a whole number of cycles."""
    return np.mean([frame[FINAL][0] for frame in frames], axis=0)


def test_pixels_are_sampled_where_the_offsets_say() -> None:
    floor = Scene(camera=CAMERA, surfaces=(Plane(),))
    for number in range(4):
        depth = run_frame(floor, Settings(taa=AntiAliasing(on=True)), frame=number)["surface/depth"]
        down = pixel_offsets(number)[1]
        v = math.tan(math.radians(30.0)) * (1.0 - 2.0 * (np.arange(12) + 0.5 + down) / 12)
        np.testing.assert_allclose(depth[v < 0, 0], -2.0 / v[v < 0], rtol=1e-12)
    still = run_frame(floor, replace(Settings(taa=AntiAliasing(on=True)), taa_points="off"), frame=1)
    np.testing.assert_array_equal(still["surface/depth"], run_frame(floor, Settings())["surface/depth"])


def test_an_edge_is_its_pixels_coverage() -> None:
    x = (0.03 / 5.0 / (math.tan(math.radians(30.0)) * 16 / 12) + 1.0) * 8.0  # of the edge, in pixels
    frames = sequence(EDGE, Settings(taa=AntiAliasing(on=True)), 16)
    share = coverage(frames)[6, int(x)] / frames[0][FINAL][0, 6, 12]
    assert abs(share - (1.0 - x % 1.0)) <= 1 / 16  # 16 points resolve no finer


def test_the_published_points_shift_the_image_for_ever_and_centred_ones_do_not() -> None:
    """D10: by their mean, (−0.029, −0.037) pixels, times what the image changes by from row to row."""
    scene = dataclasses.replace(LIT, surfaces=(Plane(albedo=(0.0, 0.0, 0.0)),))
    how = Settings(grid=dataclasses.replace(GRID, depth=256), taa=AntiAliasing(on=True))
    still = run_frame(scene, replace(how, taa_points="off"))[FINAL][0]
    slope = np.gradient(still, axis=0)[9:11]
    lasting = pixel_offsets(np.arange(16), points="published")[:, 1].mean()
    moved = {points: ((coverage(sequence(scene, replace(how, taa_points=points), 16)) - still)[9:11] / slope)
             for points in ("published", "centred")}
    assert lasting < -0.036
    # The bend of the image moves both alike, and it does not change across the middle columns; measured: within 0.003.
    np.testing.assert_allclose((moved["published"] - moved["centred"])[:, 7:9], lasting, atol=0.005)


def test_at_rest_the_average_is_an_exponential_one_of_its_frames() -> None:
    """Unclipped and linear; over a cycle its mean is that of the samples but for what α has of the beginning."""
    how = Settings(taa=AntiAliasing(on=True, tone_mapping=False, clip="off", alpha=0.1))
    frames = sequence(EDGE, how, 80)
    by_hand = frames[0][FINAL]
    for frame in frames[1:]:
        by_hand = by_hand + 0.1 * (frame[FINAL] - by_hand)
    np.testing.assert_allclose(frames[-1].image, by_hand, atol=1e-14)
    mean = np.mean([frame.image[0] for frame in frames[-16:]], axis=0)
    left = 0.9 ** 64 * frames[0][FINAL][0].max()
    np.testing.assert_allclose(mean, coverage(frames[:16]), atol=left / 0.1 / 16 + 1e-14)


def test_a_constant_image_stays_what_it_is() -> None:
    for frame in sequence(dataclasses.replace(LIT, global_media=()), ALL, 3):
        # Exposed, averaged and stored in half floats: of 0.3, 0.2, 0.1.
        expected = np.float16([0.3, 0.2, 0.1]).astype(np.float64).reshape(3, 1, 1)
        np.testing.assert_array_equal(frame.image, np.broadcast_to(expected, frame.image.shape))


def test_a_cut_begins_anew_and_so_does_another_size() -> None:
    first = run_frame(VARIED, ALL)
    other = dataclasses.replace(VARIED, ambient=(3.0, 1.0, 0.0))
    fresh = run_frame(other, ALL, frame=1)
    np.testing.assert_array_equal(run_frame(other, ALL, frame=1, previous=first, cut=True).image, fresh.image)
    assert not np.array_equal(run_frame(other, ALL, frame=1, previous=first).image, fresh.image)
    wide = dataclasses.replace(other, camera=dataclasses.replace(CAMERA, width=20))
    np.testing.assert_array_equal(run_frame(wide, ALL, frame=1, previous=first).image,
                                  run_frame(wide, ALL, frame=1).image)


def test_a_turning_camera_takes_its_history_along() -> None:
    """A picture that has no edges: what was averaged moves with the view, so weights change nothing but rounding."""
    plain = Scene(camera=CAMERA, ambient=(1.0, 1.0, 1.0), surfaces=(Plane(),), background=(0.2, 0.2, 0.2))
    turned = dataclasses.replace(plain, camera=dataclasses.replace(CAMERA, target=(0.2, 1.9, -1)))
    how = replace(Settings(taa=AntiAliasing(on=True, clip="off", alpha=0.05)), taa_points="off")
    first = run_frame(plain, how)
    second = run_frame(turned, how, frame=1, previous=first)
    inner = np.zeros(second["surface/depth"].shape, bool)
    inner[8:, 2:-2] = True  # all of it was in view
    np.testing.assert_allclose(second.image[:, inner], second[FINAL][:, inner], rtol=1e-12)


def test_the_programs_weight_is_a_switch() -> None:
    """A10: at rest between 0.002 and 0.05, by the length of the frame's jitter."""
    how = replace(Settings(taa=AntiAliasing(on=True, clip="off", tone_mapping=False, alpha=0.5)), taa_weight="author")
    first, second = sequence(EDGE, how, 2)
    right, down = pixel_offsets(1).tolist()
    alpha = 0.05 * math.exp(-2.29 * 2.0 * math.hypot(right, down))
    np.testing.assert_allclose(second.image, first.image + alpha * (second[FINAL] - first.image), atol=1e-15)


def test_exposed_light_keeps_its_history() -> None:
    """A12: with the exposure in the light, history is rescaled by the ratio; on display, colours are exposed anyway."""
    brighter = dataclasses.replace(EDGE, camera=dataclasses.replace(CAMERA, exposure=4.0))
    how = replace(Settings(taa=AntiAliasing(on=True)), taa_points="off")
    for exposure in ("display", "lighting"):
        mode = replace(how, exposure=exposure)
        second = run_frame(brighter, mode, frame=1, previous=run_frame(EDGE, mode))
        np.testing.assert_allclose(second.image, second[FINAL], rtol=1e-14)


def test_nothing_is_planned_that_a_still_frame_does_not_need() -> None:
    assert not plan(VARIED, Settings(), [FINAL])["taa"].runs
    assert plan(VARIED, ALL, [AVERAGED])["taa"].why == "temporal anti-aliasing, weight 0.1"
    assert plan(Scene(), ALL, [AVERAGED])["long_range"].why == "no medium reaches behind the froxels"


# --- a golden set of a later frame ------------------------------------------------------------------


def test_a_golden_set_may_be_of_a_frame_that_remembers(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The last of a sequence, its number and time in the manifest; the arrays are those of `run_sequence`."""
    monkeypatch.chdir(tmp_path)
    small = ["--preset", "thesis", "--size", "16x12", "--grid", "8x6x5"]
    assert main(["golden", "lights", *small, "--frames", "3", "-o", "set"]) == 0
    manifest = json.loads((tmp_path / "set" / "manifest.json").read_text())
    assert manifest["frame"] == {"number": 2, "rate": 30.0, "time": pytest.approx(2.0 / 30.0)}
    scene, settings, _ = load("lights", overrides=[
        *preset("thesis"), "camera.width=16", "camera.height=12", "grid.width=8", "grid.height=6", "grid.depth=5"])
    *_, last = run_sequence(scene, frames=3, settings=settings)
    for name in ("temporal/in_scattering", AVERAGED):
        written = np.moveaxis(np.load(tmp_path / "set" / f"{name}.npy"), -1, 0)
        np.testing.assert_array_equal(*np.broadcast_arrays(written, last[name]))
    assert np.load(tmp_path / "set" / "temporal" / "valid.npy").min() == 1.0
    assert main(["golden", "lights", *small, "--frames", "0", "-o", "none"]) == 2
    assert not (tmp_path / "none").exists()
