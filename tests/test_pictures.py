"""Pictures: the display mapping against scalar arithmetic, plans to scale, labels that fit."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from froxel_ref import number_panels, panels
from froxel_ref.display import (
    NOTHING,
    Display,
    display_for,
    ramp,
    ramp_colours,
    srgb_transfer,
    to_srgb8,
    tone_map,
)
from froxel_ref.frame import run_frame
from froxel_ref.pictures import View, channel_first, contact_sheet, final_image, preview, varying
from froxel_ref.quantities import QUANTITIES, Quantity
from froxel_ref.scene import Camera, DirectionalLight, Medium, Scene, Sphere
from froxel_ref.settings import Grid, Settings

CAMERA = Camera(width=32, height=18)
GRID = Grid(width=8, height=6, depth=10)
VIEW = View(CAMERA, GRID, 1.0)
MAGENTA = [255, 0, 255]


def display_byte(value: float) -> int:
    """The display mapping of a grey, in plain floats, written anew."""
    mapped = value * (1 + value / 16) / (1 + value)
    cut = min(max(mapped, 0.0), 1.0)
    encoded = 12.92 * cut if cut <= 0.0031308 else 1.055 * cut ** (1 / 2.4) - 0.055
    return int(encoded * 255 + 0.5)


# --- colours ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(("linear", "byte"), [
    (0.0, 0), (0.0031308, 10), (0.18, 118), (0.5, 188), (1.0, 255), (7.0, 255)])
def test_srgb_transfer_of_known_values(linear: float, byte: int) -> None:
    assert round(float(srgb_transfer(np.array(linear))) * 255) == byte


@pytest.mark.parametrize("value", [0.0, 1e-6, 0.01, 0.18, 0.5, 1.0, 3.0, 4.0, 50.0, 1e30])
@pytest.mark.parametrize("exposure", [0.25, 1.0, 8.0])
def test_a_grey_is_displayed_as_scalar_arithmetic_says(value: float, exposure: float) -> None:
    expected = display_byte(min(value * exposure, 1e6))
    shown = to_srgb8(np.full((3, 1, 1), value), exposure)
    assert shown.shape == (1, 1, 3)
    # One step: a value within rounding of a byte's edge may fall on either side.
    assert np.abs(shown.astype(int) - expected).max() <= 1


def test_the_tone_map_keeps_hue_and_order() -> None:
    colour = np.array([0.2, 0.5, 0.1])[:, None] * np.geomspace(1e-3, 3.9, 50)
    mapped = tone_map(colour)
    np.testing.assert_allclose(mapped[0] / mapped[1], 0.4, rtol=1e-14)
    assert (np.diff(mapped[1]) > 0).all()


@given(arrays.arrays(np.float64, (3, 4, 5), elements=st.floats(allow_nan=True, allow_infinity=True)))
def test_any_radiance_becomes_bytes_and_only_nan_is_magenta(radiance: np.ndarray) -> None:
    shown = to_srgb8(radiance)
    assert shown.dtype == np.uint8
    assert shown.shape == (4, 5, 3)
    bad = np.isnan(radiance).any(axis=0)
    assert (shown[bad] == MAGENTA).all()


def test_infinite_radiance_is_white() -> None:
    assert to_srgb8(np.full((3, 1, 1), np.inf)).tolist() == [[[255, 255, 255]]]


def test_the_ramp_goes_from_black_to_white_and_always_up() -> None:
    colours = ramp(np.linspace(0.0, 1.0, 257))
    np.testing.assert_allclose(colours[:, [0, -1]], [[0, 1]] * 3, atol=1e-12)
    # The weights of Green's own definition of perceived brightness.
    brightness = np.array([0.30, 0.59, 0.11]) @ colours
    assert (np.diff(brightness) > 0).all()
    assert len({tuple(c) for c in ramp_colours(np.linspace(0, 1, 257)).tolist()}) > 200


@pytest.mark.parametrize("name", ["surface/depth", "surface/normal", "surface/albedo", "media/extinction",
                                  "media/scattering", "apply/fog_transmittance", "apply/radiance"])
def test_nan_is_magenta_in_every_kind_of_picture(name: str) -> None:
    channels = 3 if "c" in QUANTITIES[name].axes else 1
    values = np.full((channels, 2, 2), 0.25)
    values[:, 0, 1] = np.nan
    shown = display_for(name, values).paint(values)
    assert shown[0, 1].tolist() == MAGENTA
    assert shown[1, 1].tolist() != MAGENTA


def test_where_nothing_is_hit_depth_is_grey_and_the_ramp_spans_the_rest() -> None:
    depth = np.array([[[1.0, 10.0, 100.0, np.inf]]])
    display = display_for("surface/depth", depth)
    shown = display.paint(depth)[0]
    assert (display.low, display.high) == (1.0, 100.0)
    np.testing.assert_array_equal(shown, [*ramp_colours(np.array([0.0, 0.5, 1.0])), NOTHING])


def test_literal_colours_of_normals_and_transmittance() -> None:
    normal = np.array([0.0, 1.0, -1.0]).reshape(3, 1, 1)
    assert Display("normal", -1, 1, 1).paint(normal)[0, 0].tolist() == [128, 255, 0]
    assert Display("unit", 0, 1, 1).paint(np.full((1, 1, 1), 0.5))[0, 0].tolist() == [128, 128, 128]


def test_the_albedo_of_media_fills_its_range_and_says_so() -> None:
    """0.9 to 0.95 would all be white; a surface's albedo stays as it is."""
    albedo = np.array([[0.9, 0.925, 0.95]] * 3).reshape(3, 1, 1, 3)
    display = display_for("media/albedo", albedo)
    assert display.paint(albedo)[0, 0].tolist() == [[0] * 3, [188] * 3, [255] * 3]
    assert display.label() == "0.9 (black) to 0.95 (white) in each channel"
    assert display_for("surface/albedo", albedo).kind == display_for("media/albedo", albedo * 0 + 0.9).kind == (
        "reflectance")


@pytest.mark.parametrize("name", ["media/scattering", "media/albedo", "surface/albedo", "media/extinction"])
def test_colours_have_a_scale(name: str) -> None:
    """A bar that begins with the colour of the lowest value and ends with that of the largest."""
    values = np.random.default_rng(6).random((3, 4, 4, 4)) * 0.5 + 0.25
    display = display_for(name, values)
    bar = np.asarray(number_panels.legend(display, 400))[12, :100]
    low = 0.0 if display.kind == "colour" else display.low
    for pixel, value in ((bar[0], low), (bar[-1], display.high)):
        np.testing.assert_array_equal(pixel, display.paint(np.full((3, 1), value))[0])
    assert (np.diff(bar.sum(axis=1)) >= 0).all()


@pytest.mark.parametrize(("level", "raised"), [(3.0, 1.0), (0.25, 1.0), (0.2, 2.0), (0.01, 32.0), (0.0, 1.0)])
def test_dark_radiance_is_exposed_by_the_power_of_two_that_is_named(level: float, raised: float) -> None:
    display = display_for("integrate/radiance", np.full((3, 2, 2, 2), level))
    assert display.exposure == raised
    assert f"exposure x{raised:g}" in display.label()


def test_the_final_image_is_never_exposed_further() -> None:
    assert display_for("apply/radiance", np.full((3, 2, 2), 1e-4), 2.0).exposure == 2.0


def test_the_final_image_has_the_camera_size_though_the_radiance_is_one_colour() -> None:
    image = final_image(np.array([0.0, 0.18, 1.0]).reshape(3, 1, 1), VIEW)
    assert image.shape == (18, 32, 3)
    assert (image == image[0, 0]).all()


# --- panels -----------------------------------------------------------------------------------------


def test_slices_are_chosen_where_the_volume_changes() -> None:
    volume = np.zeros((1, 64, 2, 2))
    volume[0, 30:34] = 1.0
    picked = panels.chosen_slices(volume, 16)
    assert picked[0] == 0
    assert picked[-1] == 63
    assert set(picked) >= {29, 30, 31, 32, 33, 34}
    assert panels.chosen_slices(np.arange(100.0).reshape(1, 100, 1, 1), 5) == [0, 25, 50, 74, 99]
    assert panels.chosen_slices(np.zeros((1, 3, 1, 1)), 5) == [0, 1, 2]
    assert panels.chosen_slices(np.zeros((1, 100, 1, 1)), 3) == [0, 50, 99]


@given(st.integers(1, 700), st.integers(1, 700), st.integers(60, 300))
def test_slices_are_enlarged_by_whole_factors(width: int, height: int, target: int) -> None:
    tile = panels.tile_size(Grid(width=width, height=height), target)
    if tile[0] >= width:
        factor = tile[0] // width
        assert tile == (width * factor, height * factor)
    assert max(tile) <= 1.5 * target + 1


@pytest.mark.parametrize("distribution", ["linear", "exponential"])
@pytest.mark.parametrize(("column", "k"), [(3, 20), (16, 25), (28, 30)])
def test_the_plan_from_above_is_to_scale(distribution: str, column: int, k: int) -> None:
    """One lit froxel: its pixels lie where its corners are in metres."""
    grid = Grid(width=32, height=3, depth=32, near=1.0, far=33.0, distribution=distribution)
    camera = Camera(width=200, height=100, vertical_fov=90.0)
    volume = np.zeros((1, 32, 3, 32))
    volume[0, k, 1, column] = 1.0
    image = np.asarray(panels.plan_panel(volume, Display("scalar", 0, 1, 1), View(camera, grid), 1320, 330))
    assert image.shape == (330, 1320, 3)
    rows, columns = np.nonzero((image == 255).all(axis=2))
    near, far = ((1.0 + k, 2.0 + k) if distribution == "linear"
                 else (33.0 ** (k / 32), 33.0 ** ((k + 1) / 32)))  # 1·(33/1)^(k/32)
    # A pixel belongs to the froxel if its centre does: its index is up to 1.5 below the edge after it.
    # Beside the axis an edge also moves by the froxel's slope from one row of pixels to the next.
    # 10 pixels a metre, the camera at the bottom centre; tan(45°)·(200/100) = 2 metres aside per metre.
    assert abs(rows.max() - (330 - 10 * near)) <= 1.5
    assert abs(rows.min() - (330 - 10 * far)) <= 1.5
    left, right = (2.0 * (2.0 * c / 32 - 1.0) for c in (column, column + 1))
    assert abs(columns.min() - (660 + 10 * min(left * near, left * far))) <= 1.5 + abs(left)
    assert abs(columns.max() - (660 + 10 * max(right * near, right * far))) <= 1.5 + abs(right)


def test_a_line_of_text_never_passes_its_width() -> None:
    image = panels.canvas(400, 40)
    panels.write(image, (10, 5), "a long line of words " * 10, 18, panels.INK, 150)
    inked = np.nonzero((np.asarray(image) != panels.PAPER).any(axis=(0, 2)))[0]
    assert 100 < inked.max() <= 162
    short = panels.canvas(400, 40)
    panels.write(short, (10, 5), "words", 18, panels.INK, 150)
    assert (np.asarray(short) != panels.PAPER).any()


def test_every_word_of_the_stage_table_can_be_drawn() -> None:
    for quantity in QUANTITIES.values():
        for words in (quantity.about, quantity.unit):
            assert "?" not in panels.drawable(words)
    assert panels.drawable("Dörries – ½ σ") == "Dorries - 1/2 sigma"


@pytest.mark.parametrize(("size", "box", "expected"), [
    ((4, 3), (40, 100), (40, 30)), ((4, 3), (41, 29), (36, 27)), ((100, 50), (50, 50), (50, 25))])
def test_images_fit_their_box_without_stretching(size: tuple[int, int], box: tuple[int, int],
                                                 expected: tuple[int, int]) -> None:
    assert panels.scaled(np.zeros((size[1], size[0], 3), np.uint8), *box).size == expected


# --- previews ---------------------------------------------------------------------------------------


def sizes(quantity: Quantity, full: bool) -> tuple[int, ...]:
    half = 2 if quantity.raster == "half" else 1
    on_grid = quantity.raster == "grid" or "z" in quantity.axes
    whole = {"c": 3, "l": 2, "z": GRID.depth, "y": GRID.height if on_grid else -(-CAMERA.height // half),
             "x": GRID.width if on_grid else -(-CAMERA.width // half), "m": 2, "f": 3, "p": 16, "q": 16, "i": 3, "j": 4,
             "e": 2, "a": 3}
    return tuple(whole[axis] if full or axis in "clmfpqijea" else 1 for axis in quantity.axes)


FIELDS = [name for name in QUANTITIES if not name.startswith("culling/")]  # lists: integers, of other axes


@pytest.mark.parametrize("filling", ["constant", "full", "infinite", "not a number", "negative", "zero"])
@pytest.mark.parametrize("name", FIELDS)
def test_every_array_has_a_preview_whatever_it_holds(name: str, filling: str) -> None:
    quantity = QUANTITIES[name]
    array = np.random.default_rng(1).random(sizes(quantity, filling != "constant"))
    array = {"infinite": np.full_like(array, np.inf), "not a number": np.full_like(array, np.nan),
             "negative": -array, "zero": 0 * array}.get(filling, array)
    image = preview(array, quantity, name=name, view=VIEW)
    assert image.dtype == np.uint8
    assert image.ndim == 3
    assert image.shape[2] == 3
    assert min(image.shape[:2]) > 80
    assert (image != image[0, 0]).any()


@pytest.mark.parametrize("carried", ["z", "y", "x", "zy", "yx", "zx"])
@pytest.mark.parametrize("name", ["media/extinction", "integrate/radiance"])
def test_axes_of_length_one_need_no_expansion(name: str, carried: str) -> None:
    quantity = QUANTITIES[name]
    shape = tuple(size if axis in carried or axis == "c" else 1
                  for axis, size in zip(quantity.axes, sizes(quantity, True), strict=True))
    array = np.random.default_rng(2).random(shape)
    assert varying(array, quantity) == carried
    assert preview(array, quantity, name=name, view=VIEW).dtype == np.uint8


@pytest.mark.parametrize(("name", "shape"), [
    ("culling/light_order", (1,)), ("culling/light_order", (70,)), ("culling/medium_bins", (2, 1)),
    ("culling/light_bins", (2, 16)), ("culling/light_tiles", (1, 1, 1)), ("culling/light_tiles", (3, 5, 7)),
    ("culling/medium_tiles", (1, 1, 7))])
@pytest.mark.parametrize("filling", ["zero", "random", "largest"])
def test_lists_have_previews(name: str, shape: tuple[int, ...], filling: str) -> None:
    kind = np.uint32 if "tiles" in name else np.int32
    largest = np.iinfo(kind).max
    array = {"zero": np.zeros(shape, kind), "largest": np.full(shape, largest, kind),
             "random": np.random.default_rng(5).integers(0, largest, shape, kind)}[filling]
    image = preview(array, QUANTITIES[name], name=name, view=VIEW)
    assert image.dtype == np.uint8
    assert (image != image[0, 0]).any()


def test_a_preview_of_tiles_counts_their_lights() -> None:
    words = np.array([[[0, 1, 3]], [[0, 0, 0x80000001]]], np.uint32)
    assert channel_first(words, QUANTITIES["culling/light_tiles"]).tolist() == [[[0.0, 1.0, 4.0]]]
    assert varying(words, QUANTITIES["culling/light_tiles"]) == "wu"


def test_extinction_per_colour_has_a_channel_in_front() -> None:
    array = np.random.default_rng(3).random((3, 10, 6, 8))
    assert channel_first(array, QUANTITIES["media/extinction"]) is array
    assert varying(array, QUANTITIES["media/extinction"]) == "zyx"
    preview(array, QUANTITIES["media/extinction"], name="media/extinction", view=VIEW)


def test_the_lobes_of_a_mixture_are_shown_as_their_sum() -> None:
    lobes = np.stack([np.full((3, 1, 1, 1), 0.25), np.full((3, 1, 1, 1), 0.5)])
    assert channel_first(lobes, QUANTITIES["media/lobe_scattering"]).ravel().tolist() == [0.75] * 3


# --- the sheet --------------------------------------------------------------------------------------


def small_frame(*, fog: bool, width: int = 32, height: int = 18, exposure: float = 1.0,
                **settings: object) -> object:
    camera = Camera(position=(0.0, 1.0, 4.0), target=(0.0, 1.0, 0.0), width=width, height=height,
                    exposure=exposure)
    scene = Scene(name="small", camera=camera, surfaces=(Sphere(center=(0.0, 1.0, 0.0)),),
                  global_media=(Medium(extinction=0.1),) if fog else (),
                  lights=(DirectionalLight(direction=(1.0, 1.0, 1.0), irradiance=(3.0, 3.0, 3.0)),))
    return run_frame(scene, Settings(grid=GRID, **settings))


@pytest.mark.parametrize("fog", [True, False])
@pytest.mark.parametrize("size", [(32, 18), (16, 16), (8, 24), (64, 8), (1, 1), (12, 1), (100, 1), (1, 100),
                                  (16384, 1), (1, 16384)])
def test_the_contact_sheet_is_a_page_for_any_shape_of_image(fog: bool, size: tuple[int, int]) -> None:
    page = contact_sheet(small_frame(fog=fog, width=size[0], height=size[1]))
    assert page.dtype == np.uint8
    assert page.shape[1:] == (2400, 3)
    margin = np.concatenate([page[:, :40].reshape(-1, 3), page[:, -40:].reshape(-1, 3)])
    assert (margin == panels.PAPER).all()  # nothing runs off the page


def test_the_contact_sheet_shows_the_final_image_and_is_the_same_twice() -> None:
    frame = small_frame(fog=True)
    page = contact_sheet(frame)
    np.testing.assert_array_equal(page, contact_sheet(frame))
    other = contact_sheet(small_frame(fog=True, fidelity="published"))
    assert page.shape != other.shape or (page != other).any()


def test_a_frame_with_some_results_only_has_a_sheet_of_those() -> None:
    scene = Scene(camera=CAMERA, background=(0.5, 0.5, 0.5))
    assert contact_sheet(run_frame(scene, Settings(grid=GRID), outputs=["apply/radiance"])).shape[1] == 2400
    assert contact_sheet(run_frame(scene, Settings(grid=GRID), outputs=["grid/slice_depth"])).shape[1] == 2400


def test_the_tone_map_of_one_is_17_of_32() -> None:
    assert math.isclose(float(tone_map(np.ones((3, 1)))[0, 0]), 0.53125, rel_tol=1e-15)


TINY, HUGE = 5e-324, 1.7e308


@pytest.mark.parametrize("value", [TINY, 1e-310, 1e-300, 1e300, HUGE])
@pytest.mark.parametrize("exposure", [1e-9, 1.0, 1e9])
def test_no_radiance_is_too_dark_or_bright_for_a_label(value: float, exposure: float) -> None:
    radiance = np.full((3, 2, 2), value)
    display = display_for("lighting/in_scattering", radiance, exposure)
    # No further than 60 doublings; none for what is bright already.
    assert display.exposure == exposure * (2.0**60 if value < 1.0 else 1.0)
    assert "exposure x" in display.label()
    assert display.paint(radiance).tolist() == [[[0] * 3 if value < 1.0 else [255] * 3] * 2] * 2


@pytest.mark.parametrize("name", FIELDS)
def test_a_preview_of_the_ends_of_the_floats(name: str) -> None:
    """Warnings are errors here: no picture may overflow."""
    quantity = QUANTITIES[name]
    ends = np.array([0.0, TINY, 1e-310, HUGE, -HUGE, np.inf, -np.inf, np.nan])
    array = np.random.default_rng(4).choice(ends, sizes(quantity, True))
    for values in (array, np.where(array >= 0.0, array, 1.0), np.where(np.abs(array) < 1.0, array, 0.0)):
        assert preview(values, quantity, name=name, view=View(CAMERA, GRID, 1e9)).dtype == np.uint8


def test_the_sheet_of_an_exposure_at_the_end_of_its_range() -> None:
    for exposure in (1e-9, 1e9):
        frame = small_frame(fog=True, exposure=exposure)
        assert contact_sheet(frame).shape[1] == 2400
