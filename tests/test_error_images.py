"""Images that errors are taken of: rasters, moments, exposures, norms and regions."""

from __future__ import annotations

import dataclasses
import math
import re
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from froxel_ref import error_images, load
from froxel_ref.error_images import (
    PARTS_OF_IMAGE,
    Subject,
    averages,
    distance,
    last_image,
    make_subject,
    no_flip,
    raster,
    reference_image,
    reference_words,
    regions,
    whole_errors,
    with_size,
)
from froxel_ref.frame import run_frame
from froxel_ref.geometry import camera_rays
from froxel_ref.records import InputError
from froxel_ref.scene import Box, Camera, DirectionalLight, ImageBuffers, Medium, Plane, Scene, Transform
from froxel_ref.scene_files import Loaded
from froxel_ref.sequence import moment, run_sequence
from froxel_ref.settings import AntiAliasing, FogLookup, Grid, LongRange, Settings, Switches, Temporal, replace
from froxel_ref.truth_image import render_truth

GRID = ["grid.width=8", "grid.height=6", "grid.depth=8"]
SIZE = ["camera.width=32", "camera.height=18"]
FOG = (Medium(extinction=0.05, albedo=(0.9, 0.8, 0.7), phase_anisotropy=0.5),)
SUN = DirectionalLight(direction=(0.3, 1, 0.2), irradiance=(3, 2, 1))


def subject(name: str, *overrides: str, frames: int = 4, pixels: int = 7000) -> Subject:
    return make_subject(load(name, overrides=[*GRID, *SIZE, *overrides]), pixels=pixels, frames=frames)


# --- the raster ---------------------------------------------------------------------------------------


def is_prime(number: int) -> bool:
    return number > 1 and all(number % k for k in range(2, number))


@given(st.integers(1, 60), st.integers(1, 60), st.integers(1, 40), st.integers(1, 40_000))
def test_a_raster_has_the_shape_of_the_view(across: int, down: int, times: int, pixels: int) -> None:
    camera = Camera(width=across * times, height=down * times)
    width, height = raster(camera, pixels)
    assert width <= camera.width
    assert height <= camera.height
    # Where no size of the very shape is near, one to half a pixel, and a prime number of rows.
    if width * camera.height != height * camera.width:
        assert abs(width - height * camera.width / camera.height) <= 0.5 or width == 1
        assert is_prime(height)
        return
    if camera.width * camera.height <= pixels:
        assert (width, height) == (camera.width, camera.height)
        return
    shared, every = math.gcd(width, height), math.gcd(camera.width, camera.height)
    assert is_prime(shared) or shared == every or is_prime(height)
    if not (is_prime(shared) or shared == every):
        return
    # Of the primes none would be nearer to what was asked for.
    off = abs(math.log(width * height / pixels))
    unit = camera.width // every * (camera.height // every)
    assert all(off <= abs(math.log(unit * k * k / pixels)) + 1e-12 for k in range(2, every) if is_prime(k))


@pytest.mark.parametrize(("size", "pixels", "expected"), [
    ((960, 540), 7_000, (112, 63)), ((960, 540), 24_000, (208, 117)), ((640, 360), 7_000, (112, 63)),
    ((1920, 1080), 7_000, (112, 63)), ((512, 512), 7_000, (83, 83)), ((101, 103), 7_000, (101, 103)),
    ((32, 18), 576, (32, 18)), ((32, 18), 575, (32, 18)), ((64, 36), 600, (32, 18)), ((7000, 1), 700, (7000, 1)),
    ((1366, 768), 7_000, (119, 67)), ((854, 480), 7_000, (119, 67)), ((1279, 719), 7_000, (119, 67))])
def test_rasters_of_common_views(size: tuple[int, int], pixels: int, expected: tuple[int, int]) -> None:
    assert raster(Camera(width=size[0], height=size[1]), pixels) == expected


@pytest.mark.parametrize("size", [(512, 512), (1024, 512), (333, 128), (100, 101)])
def test_images_from_elsewhere_are_looked_at_in_pixels_of_their_own(tmp_path: Path, size: tuple[int, int]) -> None:
    """Rays of the raster are the rays of the pixels whose depth it has, whatever the size."""
    width, height = size
    rows, columns = np.mgrid[:height, :width].astype(float)
    np.save(tmp_path / "depth.npy", 1000.0 * rows + columns + 1.0)
    np.save(tmp_path / "radiance.npy", np.ones((height, width, 3)))
    scene = Scene(camera=Camera(width=width, height=height, vertical_fov=70), global_media=FOG, lights=(SUN,),
                  image_buffers=ImageBuffers(depth="depth.npy", radiance="radiance.npy"))
    found = make_subject(Loaded(scene, Settings(), tmp_path), pixels=400, frames=4)
    small = found.small.camera
    assert found.small_assets.depth is not None
    assert found.small_assets.depth.shape == (small.height, small.width)
    assert small.width * small.height < 1200
    index = found.small_assets.depth - 1.0
    y, x = np.rint(index // 1000).astype(int), np.rint(index % 1000).astype(int)
    whole, part = (camera_rays(camera, camera.width, camera.height) for camera in (scene.camera, small))
    for k in range(3):
        here = np.broadcast_to(part.per_depth[k], part.length.shape)
        there = np.broadcast_to(whole.per_depth[k], whole.length.shape)[y, x]
        assert np.abs(here - there).max() < 1e-12


@given(st.integers(1, 30), st.integers(1, 30), st.integers(1, 60), st.integers(1, 40_000))
def test_an_exact_raster_has_its_centres_at_the_views(across: int, down: int, times: int, pixels: int) -> None:
    camera = Camera(width=across * times, height=down * times)
    small = raster(camera, pixels, exactly=True)
    for count, whole in zip(small, (camera.width, camera.height), strict=True):
        assert whole % count == 0
        assert (whole // count) % 2 == 1  # so (i + ½)·step − ½ is a whole number


def test_pixels_fall_on_all_places_of_froxels_alike() -> None:
    """r/gcd(r, g) places, as the raster's note has it: all 112 of a grid of 160, each once in seven froxels."""
    width = raster(Camera(width=960, height=540), 7_000)[0]
    places = {((2 * i + 1) * 160 % (2 * width)) for i in range(width)}
    assert len(places) == width // math.gcd(width, 160) == 7


# --- subjects -----------------------------------------------------------------------------------------


def imported(folder: Path, depth: np.ndarray, radiance: np.ndarray | None = None, **more: object) -> Loaded:
    """A scene whose surfaces come from elsewhere."""
    np.save(folder / "depth.npy", depth)
    if radiance is not None:
        np.save(folder / "radiance.npy", radiance)
    files = ImageBuffers(depth="depth.npy", radiance=None if radiance is None else "radiance.npy")
    scene = Scene(**({"camera": Camera(width=depth.shape[1], height=depth.shape[0]), "image_buffers": files,
                      "global_media": FOG, "lights": (SUN,)} | more))
    return Loaded(scene, Settings(grid=Grid(width=8, height=6, depth=8)), folder)


def test_images_from_elsewhere_are_taken_at_their_pixels_centres(tmp_path: Path) -> None:
    rows, columns = np.mgrid[:27, :45].astype(float)
    radiance = np.stack([rows, columns, np.full(rows.shape, 2.0)], -1)
    loaded = imported(tmp_path, 1.0 + 0.01 * rows + 0.02 * columns, radiance, global_media=(), lights=())
    found = make_subject(loaded, pixels=140, frames=1)
    camera = found.small.camera
    assert (camera.width, camera.height) == (15, 9)
    image = last_image(found, loaded.settings)
    np.testing.assert_array_equal(image[0], 1.0 + 3.0 * np.arange(9.0)[:, None] * np.ones(15))
    np.testing.assert_array_equal(image[1], 1.0 + 3.0 * np.arange(15.0) * np.ones((9, 1)))
    assert found.small_assets.depth is not None
    np.testing.assert_array_equal(found.small_assets.depth, 1.0 + 0.01 * image[0] + 0.02 * image[1])
    assert found.assets.depth is not None
    assert found.assets.depth.shape == (27, 45)
    np.testing.assert_array_equal(reference_image(found, rtol=1e-3).radiance, image)  # without media


def test_images_from_elsewhere_tend_to_the_truth_too(tmp_path: Path) -> None:
    """A froxel for each pixel of the raster and 64 slices: as near as slices are, 0.2 % (measured: 0.06 %)."""
    rows, columns = np.mgrid[:27, :45].astype(float)
    loaded = imported(tmp_path, 5.0 + 0.1 * rows + 0.3 * columns, np.ones((27, 45, 3)))
    found = make_subject(loaded, pixels=140, frames=1)
    fine = replace(loaded.settings, grid=Grid(width=15, height=9, depth=64))
    errors = distance(last_image(found, fine), reference_image(found, rtol=1e-4).radiance, epsilon=0.01)
    assert errors.absolute < 2e-3
    coarse = distance(last_image(found, loaded.settings), reference_image(found, rtol=1e-4).radiance, epsilon=0.01)
    assert coarse.absolute > 2.0 * errors.absolute


def test_a_file_that_is_not_there_is_named(tmp_path: Path) -> None:
    loaded = imported(tmp_path, np.ones((3, 5)))
    (tmp_path / "depth.npy").unlink()
    with pytest.raises(InputError, match=r"image_buffers\.depth: "):
        make_subject(loaded, pixels=10, frames=1)


@pytest.mark.parametrize("name", ["hall-walk", "leak-walk", "ghosting"])
def test_scenes_that_move_are_looked_at_in_the_last_frame(name: str) -> None:
    found = subject(name, frames=20)
    there, how, _ = found.now(found.settings, small=True)
    assert there == moment(found.small, None, 19, rate=found.rate) != found.small
    assert how.time == found.settings.time + 19 / 30
    image = last_image(found, found.settings)
    *_, last = run_sequence(found.small, frames=20, first=19, settings=found.settings, assets=found.small_assets)
    np.testing.assert_array_equal(image, np.broadcast_to(last.image * last.display_exposure, image.shape))
    truth = reference_image(found, rtol=1e-2)
    direct = render_truth(there, how, assets=found.small_assets, rtol=1e-2, far=how.grid.far)
    np.testing.assert_array_equal(truth.radiance, direct.radiance * there.camera.exposure)
    np.testing.assert_array_equal(truth.error, direct.error * there.camera.exposure)
    # And that is nearer than the truth of another moment.
    first = reference_image(found._replace(frames=1), rtol=1e-2)
    errors = [distance(image, each.radiance, epsilon=0.01).absolute for each in (truth, first)]
    assert errors[0] < errors[1]


@pytest.mark.parametrize("how", [
    Settings(temporal=Temporal(filter="scattering")), Settings(checkerboard=True), Settings(taa=AntiAliasing(on=True))])
def test_what_averages_begins_as_many_frames_before(how: Settings) -> None:
    found = subject("ghosting", frames=6)
    how = replace(how, grid=found.settings.grid)
    assert averages(how)
    for frames, first in ((None, 0), (6, 0), (3, 3), (1, 5), (9, 0)):
        *_, last = run_sequence(found.small, frames=6, first=first, settings=how, assets=found.small_assets)
        expected = np.broadcast_to(last.image * last.display_exposure, (3, 18, 32))
        np.testing.assert_array_equal(last_image(found, how, frames=frames), expected)
    assert not np.array_equal(last_image(found, how, frames=1), last_image(found, how, frames=6))


def test_what_does_not_average_is_one_frame_of_the_last_ones_number() -> None:
    """Noise is that of the last frame, whether an image is made alone or at the end of many."""
    found = subject("uniform", "fog_lookup.method=noisy", frames=6)
    assert not averages(found.settings)
    *_, last = run_sequence(found.small, frames=6, settings=found.settings)
    np.testing.assert_array_equal(last_image(found, found.settings), last.image * last.display_exposure)
    first = run_frame(found.small, found.settings)
    assert not np.array_equal(last_image(found, found.settings), first.image * first.display_exposure)


def test_finer_images_have_the_rasters_centres() -> None:
    found = subject("shaft", "shadows=exact")
    plain = last_image(found, found.settings)
    for finer in (3, 5):
        fine = last_image(found, found.settings, finer=finer)
        there, how, assets = found.now(found.settings, small=True)
        whole = run_frame(with_size(there, finer), how, assets=assets, frame=found.frames - 1)
        np.testing.assert_array_equal(
            fine, (whole.image * whole.display_exposure)[:, finer // 2::finer, finer // 2::finer])
        np.testing.assert_allclose(fine, plain, rtol=1e-9)  # rays of the same direction, up to rounding


# --- exposure -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("exposure", [0.2, 8.0])
def test_exposure_comes_in_once(exposure: float) -> None:
    """A12: on display, or multiplied into the lighting; images and the truth are the same radiance times exposure."""
    scene = Scene(camera=Camera(width=16, height=9, exposure=exposure), ambient=(0.3, 0.2, 0.1),
                  background=(0.5, 0.6, 0.7), global_media=FOG, lights=(SUN,), surfaces=(Plane(albedo=(0.5,) * 3),))
    how = Settings(grid=Grid(width=16, height=9, depth=32, near=0.2, far=40))
    found = make_subject(Loaded(scene, how, None), pixels=1000, frames=1)
    on_display = last_image(found, how)
    in_lighting = last_image(found, replace(how, exposure="lighting"))
    truth = reference_image(found, rtol=1e-4)
    lit = reference_image(found._replace(loaded=Loaded(scene, replace(how, exposure="lighting"), None)), rtol=1e-4)
    np.testing.assert_array_equal(lit.radiance, truth.radiance)
    one = dataclasses.replace(scene, camera=dataclasses.replace(scene.camera, exposure=1.0))
    plain = render_truth(one, how, rtol=1e-4)
    np.testing.assert_allclose(truth.radiance, exposure * plain.radiance, rtol=1e-12)
    # The background is radiance that no lighting makes: it is not multiplied there, which A12 is about.
    ground = np.isfinite(np.broadcast_to(run_frame(scene, how)["surface/depth"], (9, 16)))
    ground &= np.roll(ground, 1, 0)
    assert 20 < ground.sum() < 144
    np.testing.assert_allclose(in_lighting[:, ground], on_display[:, ground], rtol=1e-12)
    author = last_image(found, replace(how, fidelity="author"))
    np.testing.assert_allclose(author[:, ground].mean(), on_display[:, ground].mean(), rtol=0.5)
    np.testing.assert_allclose(on_display.mean(), truth.radiance.mean(), rtol=0.02)


def test_the_reference_is_right_whatever_the_settings_are() -> None:
    """Of the corrected physics, with the shadows and as far as the settings have it."""
    found = subject("shaft")
    right = reference_image(found, rtol=1e-3)

    def other(**changes: object) -> np.ndarray:
        loaded = found.loaded._replace(settings=replace(found.settings, **changes))
        return reference_image(found._replace(loaded=loaded), rtol=1e-3).radiance

    for changes in ({"fidelity": "published"}, {"fidelity": "author"}, {"emission": "absorption"},
                    {"switches": Switches(integrate_from="near", attenuation="inverse_radius")},
                    {"precision": "float32"}, {"shadows": "exact"}):
        np.testing.assert_array_equal(other(**changes), right.radiance)
    dark, dim = other(shadows="off"), other(volumetric_shadows="maps")
    assert dark.mean() > right.radiance.mean() > dim.mean()
    near = other(grid=dataclasses.replace(found.settings.grid, far=3.0))
    assert not np.array_equal(near, right.radiance)
    assert np.array_equal(other(grid=dataclasses.replace(found.settings.grid, far=3.0),
                                long_range=LongRange(march=True, farthest=found.settings.grid.far)), right.radiance)


def test_the_reference_says_what_it_is() -> None:
    found = subject("shaft")
    assert reference_words(found, 1e-3).endswith("relative tolerance of 0.001, exact shadows.")
    for shadows, volumetric, words in (("off", "off", ", no shadows."),
                                       ("maps", "maps", ", exact shadows of surfaces, media and particles (of suns: "
                                        "local media).")):
        loaded = found.loaded._replace(settings=replace(found.settings, shadows=shadows,
                                                        volumetric_shadows=volumetric))
        assert reference_words(found._replace(loaded=loaded), 1e-3).endswith(words)


# --- errors -------------------------------------------------------------------------------------------


IMAGES = arrays(np.float64, (3, 4, 5), elements=st.floats(-1e3, 1e3, width=32))


@given(IMAGES, IMAGES, st.sampled_from([0.01, 1.0]))
def test_norms_are_those_of_scalar_loops(image: np.ndarray, reference: np.ndarray, epsilon: float) -> None:
    reference[0, 0, 0] = 1.0
    pairs = [(float(a), float(b)) for a, b in zip(image.ravel(), reference.ravel(), strict=True)]
    mean = math.fsum(abs(b) for _, b in pairs) / 60
    sizes = sorted(abs(a - b) for a, b in pairs)
    found = distance(image, reference, epsilon=epsilon)
    assert found.fault == ""
    assert found.flip is None
    assert found.relmse == pytest.approx(math.fsum((a - b) ** 2 / (b * b + epsilon) for a, b in pairs) / 60, rel=1e-12)
    assert found.bias == pytest.approx(math.fsum(a - b for a, b in pairs) / 60 / mean, rel=1e-12, abs=1e-9)
    assert found.quantile == pytest.approx(sizes[math.ceil(0.999 * 60) - 1] / mean, rel=1e-12)
    assert found.maximum == pytest.approx(sizes[-1] / mean, rel=1e-12)
    assert found.absolute == pytest.approx(math.fsum(sizes) / 60 / mean, rel=1e-12)


def test_the_999_quantile_leaves_out_a_thousandth() -> None:
    image, reference = np.ones((3, 20, 50)), np.ones((3, 20, 50))
    image[0, 0, :3] = 5.0
    found = distance(image, reference, epsilon=0.01)
    assert (found.quantile, found.maximum) == (0.0, 4.0)
    image[0, 0, 3] = 3.0
    assert distance(image, reference, epsilon=0.01).quantile == 2.0


@pytest.mark.parametrize(("value", "words"), [
    (math.nan, r"NaN instead of 1.0 at \(1, 2, 3\)"), (math.inf, r"inf instead of 1.0"), (-math.inf, "-inf instead"),
    (1e200, "the error is beyond all numbers: values up to 1e[+]200")])
def test_what_is_no_number_is_a_fault_in_words(value: float, words: str) -> None:
    image = np.ones((3, 4, 5))
    image[1, 2, 3] = value
    for errors in (distance(image, np.ones((3, 4, 5)), epsilon=0.01),
                   whole_errors(image, np.ones((3, 4, 5)), epsilon=0.01, pixels_per_degree=2.0)):
        assert re.match(words, errors.fault)
        assert all(math.isnan(each) for each in (*errors[:4], errors.absolute))
        assert errors.flip is None


@pytest.mark.parametrize("value", [math.nan, math.inf])
def test_a_reference_that_is_no_number_agrees_with_nothing(value: float) -> None:
    """Not even with the same NaN or infinity in the image, which the norms would leave out."""
    reference = np.ones((3, 4, 5))
    reference[1, 2, 3] = value
    for image in (reference.copy(), np.ones((3, 4, 5))):
        errors = distance(image, reference, epsilon=0.01)
        assert errors.fault == "the reference is not finite in 1 of 60 values"
        assert math.isnan(errors.relmse)


def test_a_black_reference_has_no_share() -> None:
    black = np.zeros((3, 2, 2))
    same = distance(black, black, epsilon=0.01)
    assert (same.relmse, same.bias, same.quantile, same.maximum, same.absolute, same.fault) == (0, 0, 0, 0, 0, "")
    other = distance(black + 0.1, black, epsilon=0.01)
    assert other.fault == "the reference is black: no share of its mean"
    assert math.isnan(other.relmse)


def test_flip_is_taken_where_it_can_be() -> None:
    grey = np.full((3, 24, 24), 0.5)
    assert whole_errors(grey, grey, epsilon=0.01).flip is None
    same = whole_errors(grey, grey, epsilon=0.01, pixels_per_degree=60.0)
    other = whole_errors(grey + 0.1, grey, epsilon=0.01, pixels_per_degree=60.0)
    assert same.flip == 0.0
    assert other.flip is not None
    assert 0.01 < other.flip < 0.5
    assert other._replace(flip=None) == distance(grey + 0.1, grey, epsilon=0.01)


@pytest.mark.parametrize(("size", "full", "words"), [
    ((112, 63), 960, ""), ((112, 63), 3752, ""), ((21, 21), 21, ""), ((21, 1), 21, ""),
    ((112, 63), 3840, "needs at least 2 pixels per degree, these images have 2: they are 112 pixels wide"),
    ((112, 63), 7680, "needs at least 2 pixels per degree, these images have 0.98: they are 112 pixels wide"),
    ((32, 18), 32, "needs images of at least 21 x 21 pixels at 67 pixels per degree, these are 32 x 18")])
def test_images_too_small_for_flip(size: tuple[int, int], full: int, words: str) -> None:
    assert no_flip(size, full).startswith(words)
    assert bool(no_flip(size, full)) == bool(words)
    image = np.ones((3, *size[::-1]))
    if words:
        with pytest.raises(InputError):
            whole_errors(image, image, epsilon=0.01, pixels_per_degree=67.0 * size[0] / full)
    else:
        assert whole_errors(image, image, epsilon=0.01, pixels_per_degree=67.0 * size[0] / full).flip == 0.0


def test_without_the_extra_there_is_no_flip(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(error_images, "flip_available", lambda: False)
    assert no_flip((112, 63), 960).startswith("needs the extra flip: ")


# --- regions ------------------------------------------------------------------------------------------


def test_regions_are_those_of_a_depth_made_by_hand(tmp_path: Path) -> None:
    """Sky, a step of more than a tenth, a slope of less; by a scalar loop over neighbours."""
    sky = math.inf
    depth = np.array([[sky, sky, sky, sky, 9.0],
                      [sky, sky, sky, sky, sky],
                      [4.0, 4.2, 4.4, 4.6, 4.8],
                      [4.0, 4.2, 4.8, 5.0, 5.2],
                      [4.0, 4.2, 4.8, 5.0, 5.2]])
    expected = np.empty(depth.shape, object)
    for y in range(5):
        for x in range(5):
            there = [(y + 1, x), (y - 1, x), (y, x + 1), (y, x - 1)]
            others = [depth[j, i] for j, i in there if 0 <= j < 5 and 0 <= i < 5]
            near = [(min(depth[y, x], d), max(depth[y, x], d)) for d in others]
            # Another depth next door: the nearer one is less than nine tenths of the farther.
            edge = any(less < sky and less / more < 0.9 for less, more in near)
            expected[y, x] = "edges" if edge else "sky" if depth[y, x] == sky else "surfaces"
    found = regions(make_subject(imported(tmp_path, depth), pixels=1000, frames=1))
    assert list(found) == list(PARTS_OF_IMAGE) == ["sky", "edges", "surfaces"]
    for name, mask in found.items():
        np.testing.assert_array_equal(mask, expected == name)
    np.testing.assert_array_equal(sum(mask.astype(int) for mask in found.values()), 1)
    assert [int(found[name].sum()) for name in PARTS_OF_IMAGE] == [3, 16, 6]


@pytest.mark.parametrize("name", ["uniform", "shaft", "long-range", "leak-walk"])
def test_regions_part_the_image(name: str) -> None:
    """Each pixel lies in one; none is empty; the same whether the image is averaged over frames or not."""
    found = regions(subject(name))
    np.testing.assert_array_equal(sum(mask.astype(int) for mask in found.values()), np.ones((18, 32)))
    assert all(mask.any() for mask in found.values())
    assert set(found) == {"uniform": {"sky"}}.get(name, set(found))
    again = regions(subject(name, "taa.on=true", "temporal.filter=scattering"))
    assert all(np.array_equal(again[each], mask) for each, mask in found.items())


def test_a_box_before_the_sky_is_an_edge_a_surface_and_sky() -> None:
    scene = Scene(camera=Camera(width=32, height=18, position=(0, 0, 0), target=(0, 0, -1)),
                  surfaces=(Box(transform=Transform(translate=(0, 0, -6))),))
    found = regions(make_subject(Loaded(scene, Settings(), None), pixels=1000, frames=1))
    seen = np.isfinite(np.broadcast_to(run_frame(scene, outputs=["surface/depth"])["surface/depth"], (18, 32)))
    assert seen[found["surfaces"]].all()
    assert not seen[found["sky"]].any()
    rows, columns = seen.any(1).sum(), seen.any(0).sum()
    assert seen.sum() == rows * columns  # a rectangle: its outermost ring, and the ring around it without corners
    assert found["edges"].sum() == 2 * (rows + columns) - 4 + 2 * (rows + columns)


def test_looked_up_noise_is_part_of_the_image_not_of_the_truth() -> None:
    found = subject("uniform")
    noisy = last_image(found, replace(found.settings, fog_lookup=FogLookup(method="noisy")))
    assert not np.array_equal(noisy, last_image(found, found.settings))
