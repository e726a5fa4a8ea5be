"""Lists of lights and media: hand-made ones, and none that leaves out what would have added anything."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
import reference_culling as reference
from hypothesis import given
from hypothesis import settings as budget
from hypothesis import strategies as st
from test_lighting import fog

from froxel_ref import culling, light_rays, shading, surface, tile_bounds
from froxel_ref.culling import (
    Culled,
    Tiling,
    candidates,
    cull_lights,
    cull_media,
    lights_per_tile,
    list_lengths,
    list_shapes,
    listed,
    make_tiling,
)
from froxel_ref.frame import FINAL, QUANTITIES, estimate_bytes, plan, run_frame
from froxel_ref.geometry import camera_rays
from froxel_ref.grid import Froxels, froxel_points, make_froxels
from froxel_ref.lighting import in_scattering
from froxel_ref.lights import light_at
from froxel_ref.records import InputError
from froxel_ref.scene import (
    Box,
    Camera,
    DirectionalLight,
    ExtraLights,
    LocalMedium,
    Medium,
    Plane,
    PointLight,
    Scene,
    SpotLight,
    Transform,
)
from froxel_ref.settings import Culling, Grid, Settings, replace

DOUBLE = np.dtype(np.float64)
AHEAD = Camera(position=(0.0, 0.0, 0.0), target=(0.0, 0.0, -1.0), width=32, height=16, vertical_fov=90.0)
WHITE = (1.0, 1.0, 1.0)


def lamp(*position: float, radius: float = 1.0) -> PointLight:
    return PointLight(position=position, intensity=WHITE, radius=radius)


def tiling(camera: Camera = AHEAD, near: float = 0.0, far: float = 32.0, bins: int = 8, tile: int = 8) -> Tiling:
    return make_tiling(camera, depth_range=(near, far), bins=bins, tile=tile)


# --- by hand ----------------------------------------------------------------------------------------


def test_the_order_is_by_the_nearest_point_and_ties_by_index() -> None:
    lights = {9: lamp(0, 0, -10.0), 2: lamp(0, 0, -10.0), 4: lamp(0, 0, -12.0, radius=5.0), 7: lamp(5, 0, 3.0)}
    assert cull_lights(lights, tiling()).order.tolist() == [7, 4, 2, 9]


def test_bins_hold_first_and_last_place() -> None:
    """Bins of 4 m: depths 9 to 11, 7 to 13 and 1 to 3."""
    lights = {0: lamp(0, 0, -10.0), 1: lamp(0, 0, -10.0, radius=3.0), 2: lamp(0, 0, -2.0)}
    culled = cull_lights(lights, tiling())
    assert culled.order.tolist() == [2, 1, 0]
    assert culled.bins.tolist() == [[0, 1, 1, 1, 1, 1, 1, 1], [0, 1, 2, 1, 0, 0, 0, 0]]
    assert culled.bins.dtype == culled.order.dtype == np.int32


def test_what_lies_between_two_lights_is_between_their_places() -> None:
    """A long light spans a bin whose own light comes later: the range holds both, and what is between."""
    lights = {0: lamp(0, 0, -16.0, radius=14.0), 1: lamp(0, 0, -5.5), 2: lamp(0, 0, -21.5)}
    assert cull_lights(lights, tiling()).bins[:, 5].tolist() == [0, 2]


def test_a_bin_that_is_met_at_its_edge_counts() -> None:
    """A light from 8 m to 12 m: the margin for rounding reaches into the bins before and behind."""
    culled = cull_lights({0: lamp(0, 0, -10.0, radius=2.0)}, tiling())
    assert culled.bins[1].tolist() == [0, 0, 0, 0, 0, 0, 0, 0]
    assert culled.bins[0].tolist() == [1, 0, 0, 0, 1, 1, 1, 1]


def test_depths_outside_the_range_count_as_its_ends() -> None:
    culled = cull_lights({0: lamp(0, 0, -0.5, radius=0.25), 1: lamp(0, 0, -99.0), 2: lamp(0, 0, 9.0)},
                         tiling(near=1.0, far=33.0))
    assert culled.order.tolist() == [2, 0, 1]
    assert culled.bins.tolist() == [[1, 1, 1, 1, 1, 1, 1, 2], [1, 0, 0, 0, 0, 0, 0, 2]]


def test_tiles_of_a_light_in_a_corner() -> None:
    """At 8 m depth the image spans ±16 m by ±8 m in 4 × 2 tiles of 8 m: columns at −16, −8, 0, 8."""
    culled = cull_lights({0: lamp(-12.0, 4.0, -8.0), 1: lamp(4.0, -4.0, -8.0, radius=0.5)}, tiling())
    assert culled.order.tolist() == [0, 1]
    assert culled.tiles.tolist() == [[[1, 0, 0, 0], [0, 0, 2, 0]]]


def test_tiles_of_a_light_across_a_corner_of_tiles() -> None:
    """Where rows meet, the ball that is cut off by the row above is smaller than the light."""
    words = cull_lights({0: lamp(0.0, 0.0, -8.0, radius=2.9)}, tiling(tile=1)).tiles[0]
    # Tiles of 1 m at 8 m: the outline spans ±2.9/√(1 − (2.9/8)²) = ±3.11 m in the rows at its middle. The rows
    # beyond 1, 2, 3 m are 0.99, 1.94, 2.81 m from the middle, which leaves balls of 2.72, 2.16, 0.72 m.
    assert words.sum(axis=1).tolist() == [0] * 4 + [2, 6, 6, 8, 8, 6, 6, 2] + [0] * 4
    assert words.sum(axis=0).tolist() == [0] * 12 + [2, 6, 6, 8, 8, 6, 6, 2] + [0] * 12


def test_the_camera_in_a_light_sees_it_everywhere_and_behind_nowhere() -> None:
    inside, behind = lamp(0.5, 0.0, 0.0, radius=2.0), lamp(0.0, 0.0, 5.0, radius=4.0)
    culled = cull_lights({0: inside, 1: behind}, tiling())
    assert culled.order.tolist() == [1, 0]
    assert (culled.tiles == 2).all()
    assert culled.bins[:, 0].tolist() == [1, 1]


def test_a_light_beside_the_camera_is_only_on_its_side() -> None:
    """It reaches across the camera's plane, so its image has no end to the left, but one to the right."""
    words = cull_lights({0: lamp(-5.0, 0.0, 0.0, radius=3.9)}, tiling(tile=1)).tiles[0]
    # Its edge is at 90° − asin(3.9/5) = 38.7° to the left: 0.80 metres per metre, 6.4 tiles from the middle.
    assert words[8].tolist() == [1] * 10 + [0] * 22
    assert not cull_lights({0: lamp(-5.0, 0.0, 0.0, radius=2.0)}, tiling()).tiles.any()


def test_a_box_and_an_ellipsoid() -> None:
    """The box from −1 to 1 m at 7 to 9 m fills 2/7 of a metre per metre, the ball less, and no corners."""
    place = Transform(translate=(0.0, 0.0, -8.0))
    fine = tiling(tile=1)
    box, ball = (cull_media({0: LocalMedium(shape=shape, transform=place)}, fine) for shape in ("box", "ellipsoid"))
    assert [int(c.tiles.sum()) for c in (box, ball)] == [16, 12]
    assert box.tiles[0, 6:10, 14:18].all()
    assert not ball.tiles[0, 6, 14]
    assert [culled.bins.tolist() for culled in (box, ball)] == [[[1, 0, 0, 1, 1, 1, 1, 1], [0] * 8]] * 2


def test_a_box_around_the_camera_is_everywhere() -> None:
    for transform in (Transform(scale=(3.0, 3.0, 3.0)), Transform(rotate=(10.0, 50.0, 30.0), scale=(9.0, 2.0, 5.0))):
        assert (cull_media({0: LocalMedium(transform=transform)}, tiling(tile=1)).tiles == 1).all()
    behind = Transform(translate=(0.0, 0.0, 4.0), scale=(9.0, 9.0, 3.0))
    assert not cull_media({0: LocalMedium(transform=behind)}, tiling(tile=1)).tiles.any()


def test_a_cone_is_narrower_than_its_sphere() -> None:
    spot = SpotLight(position=(0.0, 0.0, -8.0), direction=(0.0, 1.0, 0.0), intensity=WHITE, radius=6.0,
                     outer_angle=10.0, inner_angle=5.0)
    fine = tiling(tile=1)
    cone, sphere = (cull_lights({0: light}, fine).tiles.sum() for light in (spot, lamp(0, 0, -8.0, radius=6.0)))
    assert 0 < 8 * cone < sphere
    assert cull_lights({0: spot}, fine).bins.tolist() == [[1, 0, 0, 1, 1, 1, 1, 1], [0] * 8]


def test_bits_of_many_lights() -> None:
    """Seventy lights: three words, and no bit beyond the last."""
    lights = {i: lamp(-12.0 + i % 4 * 8.0, 4.0 - i // 4 % 2 * 8.0, -8.0 - 0.01 * i, radius=0.5) for i in range(70)}
    culled = cull_lights(lights, tiling())
    assert culled.tiles.shape == (3, 2, 4)
    assert culled.tiles.dtype == np.uint32
    assert culled.order.tolist() == list(range(70))
    for i in range(96):
        there = [(row, column) for row in range(2) for column in range(4)
                 if reference.bit(culled.tiles, i, row, column)]
        assert there == ([(i // 4 % 2, i % 4)] if i < 70 else [])
    assert lights_per_tile(culled.tiles).sum() == 70
    shapes = [array.shape for array in culled]
    assert shapes == list(list_shapes(70, AHEAD, bins=8))


def test_no_lights_no_lists() -> None:
    for culled in (cull_lights({}, tiling()), cull_media({}, tiling())):
        assert [array.shape for array in culled] == [(0,), (2, 0), (0, 1, 1)] == list(list_shapes(0, AHEAD))
        froxels = make_froxels(AHEAD, Grid(width=3, height=2, depth=4))
        assert listed(culled, froxels, tiling()).shape == (0, 4, 2, 3)
        assert not list_lengths(culled, froxels, tiling()).any()
        assert candidates(culled, froxels, tiling(), everywhere=[5, 1])(slice(0, 4), slice(0, 2)).tolist() == [1, 5]


def test_a_tile_larger_than_the_image_and_tiles_that_reach_beyond_it() -> None:
    for tile, shape in ((64, (1, 1)), (7, (3, 5)), (16384, (1, 1))):
        culled = cull_lights({0: lamp(0, 0, -8.0, radius=20.0)}, tiling(tile=tile))
        assert culled.tiles.shape[1:] == shape
        assert (culled.tiles == 1).all()


# --- nothing is left out ----------------------------------------------------------------------------


number = st.floats(-1.0, 1.0)
vector = st.tuples(number, number, number)
direction = vector.filter(lambda v: max(map(abs, v)) > 1e-3)


@st.composite
def cameras(draw) -> Camera:
    position = tuple(10.0 * c for c in draw(vector))
    look = draw(direction.filter(lambda v: math.hypot(v[0], v[2]) > 1e-2))
    return Camera(position=position, target=tuple(p + c for p, c in zip(position, look, strict=True)),
                  vertical_fov=draw(st.sampled_from([3.0, 40.0, 75.0, 120.0, 170.0])),
                  width=draw(st.integers(1, 45)), height=draw(st.integers(1, 33)))


@st.composite
def grids(draw) -> Grid:
    near = draw(st.sampled_from([0.01, 0.5, 3.0]))
    return Grid(width=draw(st.integers(1, 13)), height=draw(st.integers(1, 9)), depth=draw(st.integers(1, 9)),
                near=near, far=near * draw(st.sampled_from([1.5, 20.0, 300.0])),
                distribution=draw(st.sampled_from(["exponential", "linear"])))


@st.composite
def places(draw, camera: Camera, froxels: Froxels) -> tuple[float, float, float]:
    """At the camera, at a sample, or anywhere about."""
    kind = draw(st.sampled_from(["camera", "sample", "near", "far"]))
    if kind == "camera":
        return camera.position
    if kind == "sample":
        shape = len(froxels.depths), *froxels.rays.length.shape
        index = tuple(draw(st.integers(0, n - 1)) for n in shape)
        x, y, z = (float(np.broadcast_to(c, shape)[index]) for c in froxel_points(froxels))
        return x, y, z
    reach = 3.0 if kind == "near" else float(froxels.depths[-1, 0, 0])
    x, y, z = (p + reach * c for p, c in zip(camera.position, draw(vector), strict=True))
    return x, y, z


@st.composite
def lamps(draw, camera: Camera, froxels: Froxels) -> PointLight:
    place = draw(places(camera, froxels))
    radius = 10.0 ** draw(st.floats(-3.0, 3.0))
    if draw(st.booleans()):
        return PointLight(position=place, intensity=WHITE, radius=radius)
    outer = draw(st.sampled_from([0.01, 0.5, 10.0, 45.0, 79.0, 89.9]))
    return SpotLight(position=place, intensity=WHITE, radius=radius, direction=draw(direction), outer_angle=outer,
                     inner_angle=outer * draw(st.sampled_from([0.0, 0.9])))


@st.composite
def local_media(draw, camera: Camera, froxels: Froxels) -> LocalMedium:
    place, size = draw(places(camera, froxels)), 10.0 ** draw(st.floats(-2.0, 2.0))
    shape = draw(st.sampled_from(["box", "ellipsoid"]))
    if draw(st.booleans()):
        scale = tuple(size * 10.0 ** (2.0 * c) for c in draw(vector))
        turn = tuple(180.0 * c for c in draw(vector))
        return LocalMedium(shape=shape, transform=Transform(translate=place, rotate=turn, scale=scale))
    sheared = np.eye(3) + np.array([draw(vector) for _ in range(3)])
    if np.linalg.svd(sheared, compute_uv=False)[-1] < 1e-3:
        sheared = np.eye(3)
    matrix = np.concatenate([size * sheared, np.reshape(place, (3, 1))], axis=1)
    return LocalMedium(shape=shape, transform=Transform(matrix=tuple(matrix.ravel().tolist())))


@st.composite
def worlds(draw) -> tuple[Camera, Grid, Froxels, Tiling, type]:
    camera, grid, dtype = draw(cameras()), draw(grids()), draw(st.sampled_from([np.float64, np.float32]))
    froxels = make_froxels(camera, grid, dtype=dtype)
    cut = make_tiling(camera, depth_range=(grid.near, grid.far), tile=draw(st.integers(1, 17)),
                      bins=draw(st.sampled_from([1, 7, 64])))
    return camera, grid, froxels, cut, dtype


def lit(lights: dict[int, PointLight], froxels: Froxels) -> dict[int, np.ndarray]:
    """Which froxels each light gives light, by the arithmetic of the stages."""
    points = froxel_points(froxels)
    shape = np.broadcast_shapes(*(p.shape for p in points))
    return {i: np.broadcast_to(light_at(light, points)[1] > 0.0, shape) for i, light in lights.items()}


def missed(culled: Culled, touched: dict[int, np.ndarray], froxels: Froxels, cut: Tiling) -> int:
    """How many froxels are touched by what their list has not."""
    found = listed(culled, froxels, cut)
    return sum(int((touched[i] & ~found[place]).sum()) for place, i in enumerate(culled.order.tolist()))


@given(st.data())
@budget(max_examples=150)
def test_every_light_that_gives_a_froxel_light_is_in_its_list(data) -> None:
    """By the arithmetic of the stages, in their own type, whatever it rounds."""
    camera, _, froxels, cut, dtype = data.draw(worlds())
    lights = dict(enumerate(data.draw(st.lists(lamps(camera, froxels), min_size=1, max_size=5))))
    culled = cull_lights(lights, cut, origin=camera.position, dtype=dtype)
    touched = lit(lights, froxels)
    assert missed(culled, touched, froxels, cut) == 0


@given(st.data())
@budget(max_examples=40)
def test_every_light_that_touches_a_froxel_is_in_its_list_by_scalars(data) -> None:
    camera, _, froxels, cut, dtype = data.draw(worlds())
    lights = dict(enumerate(data.draw(st.lists(lamps(camera, froxels), min_size=1, max_size=2))))
    culled = cull_lights(lights, cut, origin=camera.position, dtype=dtype)
    touched = {i: reference.touched(light, froxels) for i, light in lights.items()}
    assert missed(culled, touched, froxels, cut) == 0


@given(st.data())
@budget(max_examples=60)
def test_every_medium_that_holds_a_froxel_is_in_its_list(data) -> None:
    camera, _, froxels, cut, dtype = data.draw(worlds())
    media = dict(enumerate(data.draw(st.lists(local_media(camera, froxels), min_size=1, max_size=2))))
    culled = cull_media(media, cut, origin=camera.position, dtype=dtype)
    touched = {i: reference.touched(medium, froxels) for i, medium in media.items()}
    assert missed(culled, touched, froxels, cut) == 0


@given(st.data(), st.tuples(*[st.floats(0.0, 0.99)] * 3))
@budget(max_examples=40)
def test_samples_anywhere_in_their_froxels_are_in_tiles_and_bins(data, jitter: tuple[float, float, float]) -> None:
    camera, grid, _, cut, dtype = data.draw(worlds())
    froxels = make_froxels(camera, grid, jitter=jitter, dtype=dtype)
    lights = dict(enumerate(data.draw(st.lists(lamps(camera, froxels), min_size=1, max_size=5))))
    culled = cull_lights(lights, cut, origin=camera.position, dtype=dtype)
    touched = lit(lights, froxels)
    assert missed(culled, touched, froxels, cut) == 0


@pytest.mark.parametrize("fault", ["small", "row", "bin"])
def test_the_tests_of_lists_can_fail(fault: str) -> None:
    """A radius that is 10 % too small, a row of tiles or a bin that is one off: each is seen."""
    grid = Grid(width=40, height=30, depth=24, near=0.5, far=40.0)
    froxels, cut = make_froxels(AHEAD, grid), make_tiling(AHEAD, depth_range=(0.5, 40.0), tile=1)
    rng = np.random.default_rng(2)
    lights = {i: lamp(*place, radius=2.0) for i, place in enumerate((rng.random((30, 3)) * 16 - [8, 8, 17]).tolist())}
    touched = lit(lights, froxels)
    assert missed(cull_lights(lights, cut), touched, froxels, cut) == 0
    if fault == "small":
        lights = {i: dataclasses.replace(light, radius=0.9 * light.radius) for i, light in lights.items()}
    culled = cull_lights(lights, cut)
    if fault == "row":
        culled = culled._replace(tiles=np.roll(culled.tiles, 1, axis=1))
    if fault == "bin":
        culled = culled._replace(bins=np.roll(culled.bins, 1, axis=1))
    assert missed(culled, touched, froxels, cut) > 0


def test_positions_in_float32_need_their_margin(monkeypatch: pytest.MonkeyPatch) -> None:
    """Ten thousand kilometres from the origin samples move by half a metre; without a margin some are missed."""
    camera = Camera(position=(1e7, 0.0, 0.0), target=(1e7, 0.0, -1.0), width=64, height=64)
    grid = Grid(width=64, height=64, depth=32, near=1.0, far=9.0, distribution="linear")
    froxels = make_froxels(camera, grid, dtype=np.float32)
    cut = make_tiling(camera, depth_range=(1.0, 9.0), tile=1)
    lights = {i: lamp(1e7 + x, y, -5.0, radius=0.3) for i, (x, y) in enumerate(
        (np.random.default_rng(3).random((60, 2)) * 4.0 - 2.0).tolist())}
    touched = lit(lights, froxels)
    options = {"origin": camera.position, "dtype": np.float32}
    assert missed(cull_lights(lights, cut, **options), touched, froxels, cut) == 0
    monkeypatch.setattr(tile_bounds, "ROUNDINGS", 0.0)
    assert missed(cull_lights(lights, cut, **options), touched, froxels, cut) > 0


def test_lists_are_not_much_longer_than_they_must_be() -> None:
    """Of all pairs listed in a grid of 48×27×32, four in five are true ones, so that nothing is listed idly."""
    camera = Camera(position=(0.0, 0.0, 0.0), target=(0.0, 0.1, -1.0), width=384, height=216)
    froxels = make_froxels(camera, Grid(width=48, height=27, depth=32, near=0.5, far=40.0))
    cut = make_tiling(camera, depth_range=(0.5, 40.0))
    rng = np.random.default_rng(4)
    lights = {i: lamp(*p, radius=4.0) for i, p in enumerate((rng.random((40, 3)) * [16, 8, 36] - [8, 4, 38]).tolist())}
    culled, points = cull_lights(lights, cut), froxel_points(froxels)
    true = sum(int((light_at(light, points)[1] > 0.0).sum()) for light in lights.values())
    in_lists = int(listed(culled, froxels, cut).sum())
    assert in_lists == int(list_lengths(culled, froxels, cut).sum())
    assert true < in_lists < 2.0 * true


@given(st.data())
@budget(max_examples=60)
def test_blocks_are_handed_all_that_their_froxels_list(data) -> None:
    camera, _, froxels, cut, dtype = data.draw(worlds())
    indices = data.draw(st.lists(st.integers(0, 200), min_size=1, max_size=40, unique=True))
    lights = {i: lamp(*(p + 5.0 * c for p, c in zip(camera.position, data.draw(vector), strict=True)), radius=1.5)
              for i in sorted(indices)}
    culled = cull_lights(lights, cut, origin=camera.position, dtype=dtype)
    found = listed(culled, froxels, cut)
    depth, rows = found.shape[1:3]
    begin = data.draw(st.integers(0, depth - 1)), data.draw(st.integers(0, rows - 1))
    z, y = slice(begin[0], data.draw(st.integers(begin[0] + 1, depth))), slice(begin[1], rows)
    handed = candidates(culled, froxels, cut, everywhere=[300])(z, y).tolist()
    assert handed == sorted(handed)
    assert handed[-1] == 300
    own = {int(culled.order[place]) for place in np.flatnonzero(found[:, z, y].any(axis=(1, 2, 3)))}
    assert own <= set(handed)


# --- frames -----------------------------------------------------------------------------------------


@st.composite
def scenes(draw) -> tuple[Scene, Settings]:
    camera, grid, froxels, _, dtype = draw(worlds())
    lights = draw(st.lists(lamps(camera, froxels), max_size=4))
    endless = [dataclasses.replace(light, falloff="inverse_square") for light in draw(
        st.lists(lamps(camera, froxels), max_size=1))]
    sun = DirectionalLight(direction=(0.3, 1.0, 0.2), irradiance=WHITE)
    media = tuple(dataclasses.replace(medium, extinction=0.2, phase_anisotropy=draw(st.sampled_from([0.0, 0.5])))
                  for medium in draw(st.lists(local_media(camera, froxels), max_size=3)))
    floor = Plane(point=(0.0, camera.position[1] - 2.0, 0.0))
    box = Box(transform=Transform(translate=draw(places(camera, froxels)), rotate=(20.0, 30.0, 0.0)))
    scene = Scene(camera=camera, global_media=(Medium(extinction=0.05),) * draw(st.integers(0, 1)), local_media=media,
                  lights=(*lights[:2], sun, *endless, *lights[2:]), surfaces=(floor, box))
    mixing = draw(st.sampled_from(["weighted", "mean", "mixture"]))
    how = Settings(grid=grid, precision=np.dtype(dtype).name,
                   culling=Culling(tile=draw(st.integers(1, 17)), bins=draw(st.sampled_from([1, 5, 256]))))
    return scene, replace(how, phase_mixing=mixing)


def same(planned: np.ndarray, forced: np.ndarray) -> bool:
    a, b = np.broadcast_arrays(planned, forced)
    return a.tobytes() == b.tobytes()


@pytest.mark.parametrize(("place", "radius"), [(1e7, 1e-9), (1e8, 1e-9), (1e9, 1e-8)])
def test_a_cone_smaller_than_the_rounding_of_its_place_is_listed(place: float, radius: float) -> None:
    away = 64.0
    spot = SpotLight(position=(place, place, place - away), direction=(0, 0, -1), inner_angle=10, outer_angle=30,
                     intensity=(1, 1, 1), radius=radius, min_distance=1e-9)
    scene = Scene(camera=Camera(position=(place,) * 3, target=(place, place, place - 1024.0), width=4, height=4),
                  global_media=(Medium(extinction=0.05),), lights=(spot,))
    how = Settings(grid=Grid(width=1, height=1, depth=1, near=away - 0.5, far=away + 0.5 + radius,
                             distribution="linear"))
    culled, forced = (run_frame(scene, how, force_all=force)["lighting/in_scattering"].max() for force in (False, True))
    assert culled == forced > 0.0


@pytest.mark.parametrize(("radius", "far", "z"), [(1e-3, 1e6, -9e5), (1e-7, 64.0, -40.0), (1e-9, 64.0, -40.0)])
def test_a_lamp_too_small_to_measure_lights_nothing(radius: float, far: float, z: float) -> None:
    """In float32 distances beyond 2.7e8 radii are cut: they must not be cut to the same number."""
    lamp = PointLight(position=(0, 0, z), intensity=(1, 1, 1), radius=radius)
    scene = Scene(camera=Camera(position=(0, 0, 0), target=(0, 0, -1), width=4, height=4), lights=(lamp,),
                  global_media=(Medium(extinction=1e-6),))
    how = Settings(precision="float32", grid=Grid(width=9, height=9, depth=64, near=0.5, far=far))
    for force in (False, True):
        assert run_frame(scene, how, force_all=force)["lighting/in_scattering"].max() == 0.0


@given(scenes())
@budget(max_examples=60)
def test_culled_frames_are_the_forced_ones_bit_for_bit(given_scene: tuple[Scene, Settings]) -> None:
    scene, how = given_scene
    planned, forced = (run_frame(scene, how, force_all=force_all) for force_all in (False, True))
    for name in QUANTITIES:
        assert same(planned[name], forced[name]), name


def hall(count: int = 90, **changes: object) -> tuple[Scene, Settings]:
    """More lights than two words hold, fog, a mist and a floor."""
    scene = Scene(
        camera=Camera(position=(0.8, 1.9, -0.5), target=(0.0, 2.3, -20.0), vertical_fov=52.0, width=61, height=35),
        global_media=(Medium(extinction=0.04, phase_anisotropy=0.4),), surfaces=(Plane(),),
        local_media=(LocalMedium(shape="ellipsoid", extinction=0.6, transform=Transform(
            translate=(0.0, 1.6, -18.0), rotate=(0.0, 15.0, 0.0), scale=(3.8, 2.0, 6.0))),),
        extra_lights=ExtraLights(count=count, low=(-7.5, 0.5, -42.0), high=(7.5, 6.0, -2.0)))
    return scene, Settings(grid=Grid(width=23, height=13, depth=16), **changes)


@pytest.mark.parametrize("precision", ["float64", "float32"])
@pytest.mark.parametrize("count", [31, 32, 33, 90])
def test_several_words_of_lights_change_no_bit(count: int, precision: str) -> None:
    scene, how = hall(count, precision=precision)
    frames = [run_frame(scene, how, force_all=force_all, threads=threads)
              for force_all, threads in ((False, 1), (False, 3), (True, 2))]
    assert frames[0]["culling/light_tiles"].shape[0] == -(-count // 32)
    for name in QUANTITIES:
        assert same(frames[0][name], frames[1][name]), name
        assert same(frames[0][name], frames[2][name]), name


@pytest.mark.parametrize("lost", ["light_tiles", "light_bins", "medium_tiles", "medium_bins"])
def test_the_stages_visit_what_the_lists_hand_them_and_nothing_else(lost: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """With empty lists there is no light, or no mist: the frame is another one."""
    scene, how = hall(40)
    want = run_frame(scene, how)[FINAL]
    name = "cull_lights" if lost.startswith("light") else "cull_media"
    make, field = getattr(culling, name), lost.partition("_")[2]

    def emptied(*args: object, **options: object) -> Culled:
        culled = make(*args, **options)
        array = np.zeros_like(getattr(culled, field))
        return culled._replace(**{field: array if field == "tiles" else array + np.array([[1], [0]], np.int32)})

    monkeypatch.setattr(f"froxel_ref.culling.{name}", emptied)
    assert not np.array_equal(run_frame(scene, how)[FINAL], want)


def test_lights_and_media_that_add_nothing_are_in_no_list() -> None:
    scene, how = hall(3)
    dark = PointLight(position=(0.0, 1.0, -5.0), intensity=(0.0, 0.0, 0.0))
    idle = LocalMedium(extinction=0.0, transform=Transform(translate=(0.0, 1.0, -5.0)))
    endless = dataclasses.replace(dark, intensity=WHITE, falloff="inverse_square")
    scene = dataclasses.replace(scene, lights=(dark, endless), local_media=(idle, *scene.local_media))
    frame = run_frame(scene, how)
    assert sorted(frame["culling/light_order"].tolist()) == [2, 3, 4]
    assert frame["culling/medium_order"].tolist() == [1]
    mean = run_frame(scene, replace(how, phase_mixing="mean"))
    assert sorted(mean["culling/medium_order"].tolist()) == [0, 1]  # D12: what is idle counts


def test_the_plan_says_why() -> None:
    scene, how = hall(12)
    assert plan(scene, how)["culling"].why == "bounded: 12 lights, 1 local medium"
    bare = dataclasses.replace(scene, local_media=(), extra_lights=ExtraLights())
    endless = PointLight(position=(0.0, 1.0, -5.0), intensity=WHITE, falloff="inverse_square")
    for left in (bare, dataclasses.replace(bare, lights=(endless,))):
        planned = plan(left, how)["culling"]
        assert not planned.runs
        assert planned.why == "the scene has no lights with a window and no local media"
        assert run_frame(left, how)["culling/light_tiles"].shape == (0, 1, 1)
    parts = {part.name: part for part in plan(dataclasses.replace(scene, local_media=()), how)["culling"].parts}
    assert parts["lists of lights"].runs
    assert not parts["lists of local media"].runs


def test_memory_of_lists_is_known_and_refused_in_one_line() -> None:
    scene, how = hall(64)
    words = 2 + 1
    assert estimate_bytes(scene, how) - estimate_bytes(dataclasses.replace(
        scene, extra_lights=ExtraLights(), local_media=()), how) == 4 * (64 + 1 + 2 * 2 * 256 + words * 5 * 8)
    wide = dataclasses.replace(scene, camera=dataclasses.replace(scene.camera, width=16384, height=16384),
                               extra_lights=ExtraLights(count=65536))
    message = (r"^settings.culling.tile: is 1 pixels: the light words of all tiles, for 65536 lights and 1 local "
               r"media, need up to [\d,.]+ GiB, more than memory allows \(80 % of [\d,.]+ GiB\)$")
    with pytest.raises(InputError, match=message):
        plan(wide, dataclasses.replace(how, culling=Culling(tile=1)))


# --- surfaces ---------------------------------------------------------------------------------------


@given(st.data())
@budget(max_examples=60)
def test_shading_by_tiles_is_shading_everywhere(data) -> None:
    camera, _, froxels, _, dtype = data.draw(worlds())
    lights = tuple(data.draw(st.lists(lamps(camera, froxels), min_size=1, max_size=5)))
    box = Box(transform=Transform(translate=data.draw(places(camera, froxels)), rotate=(20.0, 30.0, 0.0)))
    scene = Scene(camera=camera, lights=lights, surfaces=(Plane(point=(0.0, -3.0, 0.0)), box), background=WHITE)
    rays = camera_rays(camera, camera.width, camera.height, dtype=dtype)
    hits = surface.find_surfaces(scene.surfaces, rays, None)
    one, all_ = (surface.shade(hits, rays, scene, restrict=restrict) for restrict in (True, False))
    assert one.tobytes() == all_.tobytes()


def test_shading_does_not_depend_on_blocks_and_threads(monkeypatch: pytest.MonkeyPatch) -> None:
    scene, _ = hall(60)
    rays = camera_rays(scene.camera, 61, 35)
    hits = surface.find_surfaces(scene.surfaces, rays, None)
    want = surface.shade(hits, rays, scene, threads=1, restrict=False)
    for block, few, square in ((64, 1, 1), (600, 3, 2), (10**6, 512, 5)):
        for name, value in (("BLOCK", block), ("FEW", few), ("SQUARE", square)):
            monkeypatch.setattr(shading, name, value)
        assert surface.shade(hits, rays, scene, threads=3).tobytes() == want.tobytes()


def test_a_light_shades_only_the_tiles_that_it_can_reach(monkeypatch: pytest.MonkeyPatch) -> None:
    """One lamp of 1 m over a floor: a few tiles, whose surfaces are within 1 m of it; and the test can fail."""
    camera = Camera(position=(0.0, 2.0, 0.0), target=(0.0, 0.0, -6.0), width=640, height=384)
    scene = Scene(camera=camera, surfaces=(Plane(),), lights=(lamp(0.0, 0.5, -6.0),))
    rays = camera_rays(camera, 640, 384)
    hits = surface.find_surfaces(scene.surfaces, rays, None)
    visited = []
    real = shading.light_at
    monkeypatch.setattr(shading, "light_at", lambda light, points, **how: (
        visited.append(points[0].size), real(light, points, **how))[1])
    light = surface.shade(hits, rays, scene)
    lit = int((light[0] > 0.0).sum())
    assert 0 < lit < sum(visited) < 2 * lit
    monkeypatch.setattr(shading, "_meets", lambda centers, radii, low, high: np.zeros(
        np.broadcast_shapes(radii.shape, low.shape[1:]), bool))
    assert not np.array_equal(surface.shade(hits, rays, scene), light)


@pytest.mark.parametrize("falloff", ["windowed", "inverse_square"])
@pytest.mark.parametrize("precision", ["float64", "float32"])
def test_a_floor_at_the_horizon_is_dark(falloff: str, precision: str) -> None:
    """Its distance, 1e38 m, has no square in float32."""
    camera = Camera(position=(0.0, 0.0, 0.0), target=(0.0, -2e-38, 1.0), width=1, height=3, vertical_fov=3.0)
    light = PointLight(position=(0.0, 0.0, 1.0), intensity=WHITE, falloff=falloff)
    scene = Scene(camera=camera, surfaces=(Plane(point=(0.0, -2.0, 0.0)),), lights=(light,))
    rays = camera_rays(camera, 1, 3, dtype=precision)
    hits = surface.find_surfaces(scene.surfaces, rays, None)
    assert 1e37 < hits.depth[1, 0] < np.inf
    for restrict in (True, False):
        dark = surface.shade(hits, rays, scene, restrict=restrict)[:, 1, 0]
        assert float(dark.max()) < 1e-70


# --- lights along rays ------------------------------------------------------------------------------


def test_narrow_cones_in_float32_are_not_cut_off() -> None:
    """In float32 a cosine to the axis of a cone of 0.05° rounds to that of 0: the light spills, and is kept."""
    camera = Camera(position=(0.0, 0.0, 0.0), target=(0.0, 0.0, -1.0), width=64, height=64, vertical_fov=2.0)
    froxels = make_froxels(camera, Grid(width=64, height=64, depth=8, near=5.0, far=20.0), dtype=np.float32)
    spot = SpotLight(position=(0.0, 0.0, -1.0), direction=(0.0, 0.0, -1.0), intensity=WHITE, radius=40.0,
                     inner_angle=0.0, outer_angle=0.05)
    whole, cut = (in_scattering(fog(0.5, dtype=np.float32), [spot], froxels, restrict=restrict)
                  for restrict in (False, True))
    assert whole.any()
    assert whole.tobytes() == cut.tobytes()


def test_few_columns_are_given_away_for_whole_rows(monkeypatch: pytest.MonkeyPatch) -> None:
    froxels = make_froxels(AHEAD, Grid(width=100, height=20, depth=4, near=2.0, far=20.0))
    wide, narrow = lamp(0.0, 0.0, -8.0, radius=7.9), lamp(0.0, 0.0, -8.0)
    boxes = light_rays.light_rays({0: wide, 1: narrow}, froxels).boxes
    assert (boxes[0, :, 3] - boxes[0, :, 2]).max() == 100
    assert (boxes[1, :, 3] - boxes[1, :, 2]).max() < 20
