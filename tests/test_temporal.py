"""The temporal filter: where froxels were, fetches there, the moving average and what it is made of."""

from __future__ import annotations

import dataclasses
import math
from itertools import pairwise
from typing import Any

import mpmath
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from froxel_ref.grid import froxel_from_world, froxel_points, make_froxels, world_from_froxel
from froxel_ref.jitter import froxel_jitter
from froxel_ref.records import InputError
from froxel_ref.sampling import fetch_trilinear
from froxel_ref.scene import Camera
from froxel_ref.settings import DISTRIBUTIONS, Grid
from froxel_ref.storage import store
from froxel_ref.temporal import (
    HistoryPosition,
    blend,
    history_length,
    history_position,
    reproject,
    start_weight,
    usable,
)

EPS = 2.0**-52
SMALL = Grid(width=13, height=9, depth=16)
CAMERA = Camera(position=(3.0, 2.0, -1.0), target=(5.0, 1.0, -9.0), vertical_fov=70.0, width=1600, height=900)
ROLLED = Camera(position=(-30.0, 12.0, 7.0), target=(5.0, 1.0, -9.0), up=(0.3, 1.0, 0.1), vertical_fov=35.0)
AFAR = Camera(position=(1e9, 3e8, -7e8), target=(1e9 + 8.0, 3e8 - 1.0, -7e8 - 30.0))
CAMERAS = {"level": Camera(), "pitched": CAMERA, "rolled": ROLLED, "afar": AFAR}


def centres(grid: Grid) -> tuple[Any, Any, Any]:
    """Texel coordinates x, y and z of all centres, full."""
    z, y, x = np.meshgrid(*(np.arange(n) + 0.5 for n in (grid.depth, grid.height, grid.width)), indexing="ij")
    return x, y, z


def full(position: HistoryPosition, grid: Grid) -> tuple[Any, ...]:
    return tuple(np.broadcast_to(a, (grid.depth, grid.height, grid.width)) for a in position[:4])


def rotated(camera: Camera, degrees: float) -> Camera:
    """Panned about the world's y axis, to the left."""
    c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    x, y, z = (b - a for a, b in zip(camera.position, camera.target, strict=True))
    turned = (c * x + s * z, y, -s * x + c * z)
    return dataclasses.replace(camera, target=tuple(a + b for a, b in zip(camera.position, turned, strict=True)))


def moved(camera: Camera, by: tuple[float, float, float]) -> Camera:
    position, target = (tuple(a + b for a, b in zip(v, by, strict=True)) for v in (camera.position, camera.target))
    return dataclasses.replace(camera, position=position, target=target)


# --- at rest ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("camera", CAMERAS.values(), ids=CAMERAS.keys())
@pytest.mark.parametrize("distribution", DISTRIBUTIONS)
@pytest.mark.parametrize("size", [(13, 9, 16), (160, 90, 64), (240, 135, 128), (1, 1, 1), (4093, 3, 2), (3, 2, 4091)])
def test_a_camera_at_rest_stays_where_it_is(camera: Camera, distribution: str, size: tuple[int, int, int]) -> None:
    """Exactly, on three axes alone, borders and all."""
    grid = Grid(width=size[0], height=size[1], depth=size[2], distribution=distribution)
    position = history_position(grid, camera, dataclasses.replace(camera))
    for coordinate, count, axis in ((position.x, size[0], 2), (position.y, size[1], 1), (position.z, size[2], 0)):
        assert coordinate.shape == tuple(count if i == axis else 1 for i in range(3))
        np.testing.assert_array_equal(coordinate.ravel(), np.arange(count) + 0.5)
    assert position.valid.tolist() == [[[True]]]
    assert position.shape == (size[2], size[1], size[0])


@pytest.mark.parametrize("camera", CAMERAS.values(), ids=CAMERAS.keys())
def test_rest_is_no_special_case(camera: Camera) -> None:
    """A field of view that differs by a rounding makes the general way take over: the identity to 1e-12 texels."""
    other = dataclasses.replace(camera, vertical_fov=np.nextafter(camera.vertical_fov, 180.0).item())
    grid = Grid(width=240, height=135, depth=128, near=0.5 * (1.0 + EPS))
    position = history_position(grid, camera, other, previous_grid=Grid(width=240, height=135, depth=128))
    for got, expected in zip(full(position, grid)[:3], centres(grid), strict=True):
        np.testing.assert_allclose(got, expected, rtol=0, atol=1e-12)
    assert position.valid.all()


@pytest.mark.parametrize("camera", CAMERAS.values(), ids=CAMERAS.keys())
def test_the_same_view_by_another_target_is_at_rest(camera: Camera) -> None:
    """The turn between equal axes, each rounded on its own, is no turn."""
    farther = tuple(a + 2.0 * (b - a) for a, b in zip(camera.position, camera.target, strict=True))
    position = history_position(SMALL, camera, dataclasses.replace(camera, target=farther))
    assert [c.size for c in position[:3]] == [13, 9, 16]


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize("shape", [(16, 9, 13), (3, 16, 9, 13), (3, 1, 1, 1), (1, 9, 1), (2, 16, 1, 13)])
def test_a_volume_at_rest_comes_back_bit_for_bit(dtype: type, shape: tuple[int, ...]) -> None:
    volume = np.random.default_rng(1).standard_normal(shape).astype(dtype)
    volume[..., 0] = np.nan
    position = history_position(SMALL, CAMERA, CAMERA)
    got = reproject(volume, position)
    assert got.dtype == dtype
    assert got is volume  # with its NaN
    # And by the fetch itself, where the volume has no holes.
    finite = np.nan_to_num(volume)
    np.testing.assert_array_equal(fetch_trilinear(finite, position.x, position.y, position.z), finite)


def test_jitter_does_not_move_the_history() -> None:
    """No option leads it there: positions are those of unjittered samples, whatever the frame's were."""
    x, y, z = froxel_points(make_froxels(CAMERA, SMALL))
    jittered = froxel_points(make_froxels(CAMERA, SMALL, jitter=froxel_jitter(3)))
    previous = moved(rotated(CAMERA, 3.0), (0.1, 0.2, 0.3))
    position = history_position(SMALL, CAMERA, previous)
    for got, here, there in zip(full(position, SMALL)[:3], froxel_from_world((x, y, z), previous, SMALL),
                                froxel_from_world(jittered, previous, SMALL), strict=True):
        np.testing.assert_allclose(got, np.broadcast_to(here, got.shape), rtol=0, atol=1e-11)
        assert np.abs(got - there).max() > 0.1


# --- in motion ----------------------------------------------------------------------------------------

MOTIONS = {
    "pan": rotated(CAMERA, 20.0), "roll": dataclasses.replace(CAMERA, up=(0.2, 1.0, 0.0)),
    "away": moved(CAMERA, (0.5, -0.2, 2.0)), "zoom": dataclasses.replace(CAMERA, vertical_fov=50.0),
    "about": dataclasses.replace(CAMERA, target=(-5.0, 4.0, 9.0)), "other": ROLLED,
}


@pytest.mark.parametrize("previous", MOTIONS.values(), ids=MOTIONS.keys())
@pytest.mark.parametrize("distribution", DISTRIBUTIONS)
def test_positions_are_those_of_the_points_in_the_world(previous: Camera, distribution: str) -> None:
    """By way of the world, with the grid's own functions, and a grid of another size before."""
    grid = dataclasses.replace(SMALL, distribution=distribution)
    before = Grid(width=20, height=7, depth=11, near=1.0, far=40.0, distribution=distribution)
    position = history_position(grid, CAMERA, previous, previous_grid=before)
    x, y, z, valid = full(position, grid)
    i, j, k = froxel_from_world(world_from_froxel(centres(grid), CAMERA, grid), previous, before)
    # Of 100 m of extent some 100 roundings, per depth of 0.5 m and in units of texels: 20·100·100·ε/0.5.
    seen = ~np.isnan(i) & (np.abs(i) < 1e4) & (np.abs(j) < 1e4)
    for got, expected in ((x, i), (y, j), (z, k)):
        np.testing.assert_allclose(got[seen], expected[seen], rtol=1e-9, atol=1e-10)
    inside = (i >= 0) & (i <= 20) & (j >= 0) & (j <= 7) & (k >= 0) & (k <= 11)
    np.testing.assert_array_equal(valid, inside)
    np.testing.assert_array_equal(np.isnan(x), np.isnan(i))


def exact_position(camera: Camera, previous: Camera, grid: Grid, i: int, j: int, k: int) -> list[Any]:
    """The definition in 50 digits, by way of the world."""
    mp = mpmath.mp

    def axes(c: Camera) -> list[list[Any]]:
        def unit(v: list[Any]) -> list[Any]:
            length = mp.sqrt(sum(a * a for a in v))
            return [a / length for a in v]

        def across(a: list[Any], b: list[Any]) -> list[Any]:
            return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]

        forward = unit([mp.mpf(b) - mp.mpf(a) for a, b in zip(c.position, c.target, strict=True)])
        right = unit(across(forward, [mp.mpf(a) for a in c.up]))
        return [right, across(right, forward), forward]

    def tangents(c: Camera) -> tuple[Any, Any]:
        tall = mp.tan(mp.mpf(c.vertical_fov) * mp.pi / 360)
        return tall * c.width / c.height, tall

    near, far = mp.mpf(grid.near), mp.mpf(grid.far)
    depth = near * (far / near) ** ((k + mp.mpf(0.5)) / grid.depth)
    wide, tall = tangents(camera)
    local = [wide * ((2 * i + 1) / mp.mpf(grid.width) - 1), tall * (1 - (2 * j + 1) / mp.mpf(grid.height)), 1]
    right, up, forward = axes(camera)
    point = [mp.mpf(p) + depth * (local[0] * a + local[1] * b + c)
             for p, a, b, c in zip(camera.position, right, up, forward, strict=True)]
    offset = [p - mp.mpf(q) for p, q in zip(point, previous.position, strict=True)]
    u, v, w = (sum(a * b for a, b in zip(axis, offset, strict=True)) for axis in axes(previous))
    wide, tall = tangents(previous)
    return [grid.width * (1 + u / w / wide) / 2, grid.height * (1 - v / w / tall) / 2,
            grid.depth * mp.log(w / near) / mp.log(far / near)]


@pytest.mark.parametrize("far_off", [0.0, 1e6])
def test_positions_are_exact_to_the_last_digits(far_off: float) -> None:
    """Against 50 digits, where the froxel is in view; the world's origin costs nothing (coordinates in eighths)."""
    grid = Grid(width=240, height=135, depth=128)
    camera = moved(Camera(position=(3.0, 2.0, -1.0), target=(5.0, 1.0, -9.0)), (far_off, -far_off, far_off))
    previous = moved(Camera(position=(2.5, 2.25, -0.5), target=(5.0, 2.0, -9.0)), (far_off, -far_off, far_off))
    position = history_position(grid, camera, previous)
    x, y, z, valid = full(position, grid)
    rng = np.random.default_rng(4)
    worst = 0.0
    with mpmath.workdps(50):
        for place in rng.integers(0, grid.depth * grid.height * grid.width, 200).tolist():
            k, j, i = np.unravel_index(place, x.shape)
            if valid[k, j, i]:
                exact = exact_position(camera, previous, grid, int(i), int(j), int(k))
                worst = max(worst, *(abs(float(got[k, j, i] - e)) for got, e in zip((x, y, z), exact, strict=True)))
    assert 0.0 < worst <= 3e-13  # measured 7e-14 over 1500 froxels


@given(degrees=st.floats(-60.0, 60.0), i=st.integers(0, 12), k=st.integers(0, 15))
def test_a_pan_by_a_known_angle(degrees: float, i: int, k: int) -> None:
    """A level camera turned by θ: what stood at tan φ stands at tan(φ − θ), nearer or farther by cos(φ − θ)/cos φ."""
    position = history_position(SMALL, rotated(Camera(), degrees), Camera())
    assert position.x.shape == (1, 1, 13)
    across = math.tan(math.radians(30.0)) * 960 / 540
    phi = math.atan(across * ((2 * i + 1) / 13 - 1))
    seen = phi - math.radians(degrees)
    if abs(seen) > 1.3:
        return
    stretch = math.cos(seen) / math.cos(phi)
    assert float(position.x[0, 0, i]) == pytest.approx(13 * (0.5 + 0.5 * math.tan(seen) / across), abs=1e-11)
    _, y, z, valid = full(position, SMALL)
    assert z[k, 2, i] == pytest.approx(k + 0.5 + 16 * math.log(stretch) / math.log(128.0), abs=1e-11)
    assert y[k, 2, i] == pytest.approx(9 * (0.5 - 0.5 * (1 - 5 / 9) / stretch), abs=1e-11)
    inside = abs(math.tan(seen)) < across and 0 < y[k, 2, i] < 9 and 0 <= z[k, 2, i] <= 16
    assert valid[k, 2, i] == inside


def test_a_step_along_the_axis() -> None:
    """From 10 m farther back depths are 10 m more, and the image shrinks about its middle; two axes at a time."""
    previous, grid = moved(Camera(), (0.0, 0.0, 10.0)), SMALL
    position = history_position(grid, Camera(), previous)
    assert [c.shape for c in position[:3]] == [(16, 1, 13), (16, 9, 1), (16, 1, 1)]
    depth = 0.5 * 128.0 ** ((np.arange(16) + 0.5) / 16)
    np.testing.assert_allclose(position.z.ravel(), 16 * np.log2((depth + 10) * 2) / 7, rtol=0, atol=1e-13)
    np.testing.assert_allclose(position.x[:, 0, 12], 6.5 + 6.0 * depth / (depth + 10), rtol=0, atol=1e-13)
    np.testing.assert_array_equal(position.valid, position.z <= 16)  # x and y are always nearer to the middle
    assert not position.valid[15, 0, 0]


def test_a_step_aside_by_whole_texels() -> None:
    """Linear in x: at a slice's depth by s texels, and invalid where it comes in from outside."""
    grid = Grid(width=16, height=4, depth=3, near=1.0, far=4.0, distribution="linear")
    camera = Camera(vertical_fov=90.0, width=400, height=100)  # 16 froxels are 8 m wide at a depth of 1 m
    position = history_position(grid, moved(camera, (3.0, 0.0, 0.0)), camera)
    shift = 3.0 / (0.5 * np.array([1.5, 2.5, 3.5]))
    np.testing.assert_allclose(position.x[:, 0], np.arange(16) + 0.5 + shift[:, None], rtol=0, atol=1e-13)
    assert position.valid.sum(axis=2).ravel().tolist() == [12, 14, 14]
    assert position.y.shape == (1, 4, 1)
    assert position.z.shape == (3, 1, 1)


@pytest.mark.parametrize("camera", [Camera(), CAMERA, ROLLED], ids=["level", "pitched", "rolled"])
def test_a_centre_moved_onto_the_border_is_valid(camera: Camera) -> None:
    """[0, 1] is closed, and rounding does not decide: half a texel aside, whatever the camera's turn and angle."""
    grid = Grid(width=10, height=6, depth=1, near=1.0, far=4.0)  # the only sample at a depth of 2 m
    right = np.cross(np.subtract(camera.target, camera.position), camera.up)
    right /= np.linalg.norm(right)
    strays = []
    for degrees in range(20, 120, 5):
        eye = dataclasses.replace(camera, vertical_fov=float(degrees))
        step = right * (math.tan(math.radians(degrees / 2)) * camera.width / camera.height * 2.0 / 10)
        for sign, edge, end in ((1.0, -1, 10.0), (-1.0, 0, 0.0)):
            on = history_position(grid, moved(eye, tuple((sign * step).tolist())), eye)
            beyond = history_position(grid, moved(eye, tuple((sign * step * 1.0001).tolist())), eye)
            assert on.valid.all()
            assert not np.broadcast_to(beyond.valid, (1, 6, 10))[..., edge].any()
            np.testing.assert_allclose(on.x[..., edge], end, rtol=0, atol=1e-12)
            strays.append(float((sign * (on.x[..., edge] - end)).max()))
    assert max(strays) > 0.0  # some do lie beyond, by rounding


def test_behind_the_camera_before_there_is_no_history() -> None:
    behind = dataclasses.replace(CAMERA, target=(1.0, 3.0, 7.0))
    position = history_position(SMALL, CAMERA, behind)
    x, y, z, valid = full(position, SMALL)
    assert not valid.any()
    assert np.isnan(x).all()
    assert np.isnan(y).all()
    assert not np.isnan(z).any()
    volume = np.ones((16, 9, 13))
    got = reproject(volume, position)
    assert np.isnan(got).all()
    assert (blend(volume, got, position.valid) == 1.0).all()


def test_texture_coordinates_are_shares_of_the_volume() -> None:
    before = Grid(width=26, height=18, depth=8)
    u, v, w = history_position(SMALL, CAMERA, CAMERA, previous_grid=before).texture()
    np.testing.assert_array_equal(u.ravel(), (np.arange(13) + 0.5) / 13)
    np.testing.assert_allclose(v.ravel(), (np.arange(9) + 0.5) / 9, rtol=EPS)
    np.testing.assert_allclose(w.ravel(), (np.arange(16) + 0.5) / 16, rtol=EPS)


def test_coordinates_in_the_type_that_is_asked_for() -> None:
    wide, narrow = (history_position(SMALL, CAMERA, ROLLED, dtype=d) for d in (np.float64, np.float32))
    assert {c.dtype for c in narrow[:3]} == {np.dtype(np.float32)}
    for a, b in zip(wide[:3], narrow[:3], strict=True):
        np.testing.assert_array_equal(a.astype(np.float32), b)
    np.testing.assert_array_equal(wide.valid, narrow.valid)


# --- fetched ------------------------------------------------------------------------------------------


def scenery(points: Any) -> Any:
    x, y, z = (np.asarray(p, np.float64) for p in points)
    return np.stack(np.broadcast_arrays(np.sin(0.12 * x) + np.cos(0.08 * z), 2.0 + np.cos(0.1 * y - 0.08 * z)))


def test_second_order_in_the_froxels_size() -> None:
    """The camera moves and turns; the field is a function of the world."""
    camera = Camera(position=(3.0, 2.0, -1.0), target=(5.0, 1.0, -9.0))
    previous = moved(rotated(camera, 7.0), (0.4, -0.3, 0.6))

    def error(n: int) -> float:
        grid = Grid(width=2 * n, height=n, depth=n, near=2.0, far=32.0)
        before = scenery(froxel_points(make_froxels(previous, grid)))
        now = scenery(froxel_points(make_froxels(camera, grid)))
        position = history_position(grid, camera, previous)
        got = reproject(before, position)
        x, y, z, valid = full(position, grid)
        # Half a texel from the ends the fetch clamps, which is of first order there.
        inner = valid & (x > 0.5) & (x < 2 * n - 0.5) & (y > 0.5) & (y < n - 0.5) & (z > 0.5) & (z < n - 0.5)
        assert inner.mean() > 0.5
        return float(np.sqrt(np.mean((got - now)[:, inner] ** 2)))

    sizes = np.array([16, 32, 64])
    slope = np.polyfit(np.log(sizes), np.log([error(n) for n in sizes]), 1)[0]
    assert slope == pytest.approx(-2.0, abs=0.1)  # measured −1.97


def test_fetched_volumes_keep_their_type_and_axes() -> None:
    position = history_position(SMALL, CAMERA, ROLLED)
    for shape in ((16, 9, 13), (3, 16, 9, 13), (3, 16, 1, 1), (1, 1, 1)):
        got = reproject(np.ones(shape, np.float32), position)
        assert got.dtype == np.float32
        assert got.shape == (*shape[:-3], *((1, 1, 1) if shape[-1] == 1 and shape[-3] == 1 else (16, 9, 13)))
    aside = history_position(SMALL, Camera(), moved(Camera(), (0.0, 0.0, 1.0)))
    assert reproject(np.ones((3, 16, 1, 1)), aside).shape == (3, 16, 1, 1)


def test_float32_volumes_lose_no_more_than_their_own_rounding() -> None:
    volume = np.random.default_rng(2).random((16, 9, 13))
    position = history_position(SMALL, CAMERA, rotated(CAMERA, 2.0))
    wide, narrow = reproject(volume, position), reproject(volume.astype(np.float32), position)
    assert np.nanmax(np.abs(wide - narrow)) <= 2.0**-24 * 2  # of the texels, then of the result; both below 1


def test_one_bad_texel_lasts_one_frame() -> None:
    """NaN in a history does not spread: those that read it start anew."""
    volume = np.ones((3, 16, 9, 13))
    volume[1, 5, 4, 6] = np.nan
    position = history_position(SMALL, CAMERA, rotated(CAMERA, 1.0))
    current = np.full((3, 16, 9, 13), 2.0)
    history = blend(current, reproject(volume, position), position.valid)
    assert np.isfinite(history).all()
    still = history_position(SMALL, CAMERA, CAMERA)
    after = blend(current, reproject(volume, still), still.valid)
    assert (after[:, 5, 4, 6] == 2.0).all()
    assert (np.delete(after.reshape(3, -1), np.ravel_multi_index((5, 4, 6), (16, 9, 13)), axis=1) == 1.05).all()


# --- the average --------------------------------------------------------------------------------------


def test_a_blend_by_hand() -> None:
    current = np.array([1.0, 2.0, 3.0, 4.0]).reshape(1, 1, 4)
    history = np.array([5.0, 6.0, np.inf, np.nan]).reshape(1, 1, 4)
    valid = np.array([True, False, True, True])
    assert blend(current, history, valid, alpha=0.25).ravel().tolist() == [4.0, 2.0, 3.0, 4.0]
    assert blend(current, history, valid, alpha=0.75).ravel().tolist() == [2.0, 2.0, 3.0, 4.0]
    assert blend(current, history, valid, alpha=0.25, exposure_ratio=3.0).ravel().tolist() == [11.5, 2.0, 3.0, 4.0]


values = st.floats(-1e6, 1e6)


@given(current=values, history=values, alpha=st.floats(0.0, 1.0), ratio=st.floats(0.0, 8.0))
def test_a_blend_by_its_equation(current: float, history: float, alpha: float, ratio: float) -> None:
    y, s = np.full((1, 1, 1), current), np.full((1, 1, 1), history)
    got = float(blend(y, s, True, alpha=alpha, exposure_ratio=ratio)[0, 0, 0])
    with mpmath.workdps(40):
        scaled = mpmath.mpf(ratio) * mpmath.mpf(history)
        exact = mpmath.mpf(alpha) * mpmath.mpf(current) + (1 - mpmath.mpf(alpha)) * scaled
        # The history's scaling, the difference (twice as large), its product, the sum: ½ ulp each of at most 2M.
        assert abs(got - exact) <= 4 * EPS * max(abs(current), abs(history) * max(ratio, 1.0), 1e-300)


@given(current=values, history=values, alpha=st.floats(0.0, 1.0), dtype=st.sampled_from([np.float32, np.float64]))
def test_a_blend_stays_between(current: float, history: float, alpha: float, dtype: type) -> None:
    y, s = np.full((1, 1, 1), current, dtype), np.full((1, 1, 1), history, dtype)
    got = blend(y, s, True, alpha=alpha)
    assert got.dtype == dtype
    assert min(y, s) <= got <= max(y, s)
    assert blend(y, y, True, alpha=alpha) == y
    assert blend(y, s, True, alpha=0.0) == s
    assert blend(y, s, True, alpha=1.0) == y


def test_weights_by_froxel() -> None:
    current, history = np.ones((3, 2, 1, 4)), np.zeros((3, 2, 1, 4))
    alpha = np.linspace(0.0, 1.0, 4)
    for weight in (alpha, alpha[:2].repeat(2), alpha[2:].repeat(2)):
        np.testing.assert_allclose(blend(current, history, True, alpha=weight)[1, 1, 0], weight, rtol=EPS)
    assert blend(current.astype(np.float32), history.astype(np.float32), True, alpha=alpha).dtype == np.float32


def test_fields_of_few_axes_are_blended_on_them() -> None:
    assert blend(np.ones((3, 1, 1, 1)), np.zeros((3, 1, 1, 1)), np.ones((1, 1, 1), bool)).shape == (3, 1, 1, 1)
    assert blend(np.ones((3, 1, 1, 1)), np.zeros((3, 4, 1, 1)), np.ones((4, 1, 5), bool)).shape == (3, 4, 1, 5)


@given(history=st.lists(st.sampled_from([0.0, 1.0, math.nan, math.inf, -math.inf]), min_size=6, max_size=6),
       valid=st.tuples(st.booleans(), st.booleans()))
def test_a_texel_is_usable_as_a_whole(history: list[float], valid: tuple[bool, bool]) -> None:
    volume = np.array(history).reshape(3, 1, 1, 2)
    got = usable(volume, np.array(valid))
    assert got.shape == (1, 1, 2)
    for i in range(2):
        assert got[0, 0, i] == (valid[i] and all(math.isfinite(c) for c in history[i::2]))
    current = np.full((3, 1, 1, 2), 7.0)
    assert all((blend(current, volume, np.array(valid))[:, 0, 0, i] == 7.0).all() for i in range(2) if not got[0, 0, i])


def test_frames_are_weighed_by_powers() -> None:
    """The weight of the value n frames ago is α(1 − α)ⁿ, and of the first one (1 − α)ⁿ: together 1."""
    state = np.zeros((1, 1, 20))
    for frame in range(20):
        current = np.zeros((1, 1, 20))
        current[..., frame] = 1.0
        state = current if frame == 0 else blend(current, state, True, alpha=0.05)
    ago = np.arange(19, -1, -1)
    expected = np.where(ago == 19, 0.95**19, 0.05 * 0.95**ago)
    np.testing.assert_allclose(state.ravel(), expected, rtol=30 * EPS)
    assert state.sum() == pytest.approx(1.0, abs=1e-15)


@pytest.mark.parametrize(("alpha", "frames"), [(0.05, 59), (0.2, 14)])
def test_a_step_leaves_5_percent_after(alpha: float, frames: int) -> None:
    """ln 0.05/ln(1 − α) = 58.4 frames at 0.05, 13.4 at 0.2: the next whole one is below."""
    state, left = np.ones((1, 1, 1)), []
    while not left or left[-1] >= 0.05:
        state = blend(np.zeros((1, 1, 1)), state, True, alpha=alpha)
        left.append(float(state[0, 0, 0]))
    assert len(left) == frames == math.ceil(math.log(0.05) / math.log(1.0 - alpha))
    np.testing.assert_allclose(left, (1.0 - alpha) ** np.arange(1, frames + 1), rtol=1e-14)


@pytest.mark.parametrize(("alpha", "gain"), [(0.05, 39), (0.2, 9)])
def test_noise_keeps_a_share_of_its_variance(alpha: float, gain: int) -> None:
    """α/(2 − α): 1/39 and 1/9. Of 40000 independent values the variance is known to √(2/40000) = 0.7 %."""
    rng = np.random.default_rng(6)
    state = rng.standard_normal((40, 25, 40))
    for _ in range(int(8 / alpha)):  # (1 − α)^(16/α) = e⁻¹⁶ of the first one's variance is left
        state = blend(rng.standard_normal(state.shape), state, True, alpha=alpha)
    assert np.mean(state**2) * gain == pytest.approx(1.0, abs=4 * 0.0071)


def test_jittered_samples_of_a_linear_field_average_its_centre() -> None:
    """With the centred points; the published ones leave 0.015 to 0.038 texels, the author's 0.234 (D10, A2)."""
    z, y, x = np.ogrid[:3, :4, :5]
    for points, lasting in (("centred", (0.0, 0.0, 0.0)), ("published", (-31 / 2048, -1 / 54, -0.038)),
                            ("author", (0.234375, -1 / 27, -0.048))):
        state, mean = None, np.zeros((3, 3, 4, 5))
        for frame in range(32 * 16):
            j = froxel_jitter(frame, points=points)
            current = np.stack(np.broadcast_arrays(x + j[0], y + j[1], z + j[2])).astype(float)
            state = current if state is None else blend(current, state, True)
            if frame >= 32 * 15:
                mean += state / 32
        shift = mean - (np.stack(np.broadcast_arrays(x, y, z)) + 0.5)
        # 0.95^480 of the first value is left: 2e-11.
        np.testing.assert_allclose(shift, np.broadcast_to(np.reshape(lasting, (3, 1, 1, 1)), shift.shape), rtol=0,
                                   atol=1e-10)


def test_exposure_is_carried_over() -> None:
    """A12: light stored exposed, of a scene that does not change, is the exposure times it in every frame."""
    light, exposures = 3.0, [1.0, 1.0, 2.0, 0.5, 0.5, 8.0]
    state = np.full((1, 1, 1), light)
    for before, now in pairwise(exposures):
        state = blend(np.full((1, 1, 1), light * now), state, True, exposure_ratio=now / before)
        assert float(state[0, 0, 0]) == light * now


@pytest.mark.parametrize(("alpha", "share"), [(0.05, 0.01), (0.2, 0.0025)])
def test_a_history_in_float16_stops_short(alpha: float, share: float) -> None:
    """Round to nearest keeps S once α·|Y − S| is below half an ulp: ½/α ulp short, 10 at 0.05."""
    target, state = np.full((1, 1, 1), 1.0), np.full((1, 1, 1), 2.0)
    for _ in range(600):
        state = store(blend(target, state, True, alpha=alpha), "float16")
    short = float(state[0, 0, 0]) - 1.0
    assert 0.4 / alpha * 2.0**-10 <= short <= 0.5 / alpha * 2.0**-10
    assert short <= share


# --- an even start ------------------------------------------------------------------------------------


def test_a_young_average_is_the_plain_mean() -> None:
    values_seen = np.random.default_rng(7).random(60)
    state, length = np.zeros((1, 1, 1)), np.zeros((1, 1, 1))
    for n, value in enumerate(values_seen.tolist(), start=1):
        length = history_length(length, n > 1)
        state = blend(np.full((1, 1, 1), value), state, n > 1, alpha=start_weight(length))
        if n <= 20:
            # n blends, each with three roundings of values below 1.
            assert float(state[0, 0, 0]) == pytest.approx(values_seen[:n].mean(), abs=3 * n * EPS)
    expected = values_seen[:20].mean()
    for value in values_seen[20:]:
        expected = 0.05 * value + 0.95 * expected
    assert float(state[0, 0, 0]) == pytest.approx(expected, abs=200 * EPS)


def test_lengths_start_anew_where_there_is_no_history() -> None:
    length = np.array([0.0, 1.0, 7.5, np.nan])
    assert history_length(length, np.array([True, True, True, False])).tolist() == [1.0, 2.0, 8.5, 1.0]
    assert history_length(length, False).tolist() == [1.0] * 4
    assert start_weight(np.array([1.0, 20.0, 21.0])).tolist() == [1.0, 0.05, 0.05]
    assert start_weight(4.0, alpha=0.2).tolist() == 0.25


@pytest.mark.parametrize(("call", "words"), [
    (lambda: blend(np.ones((1, 1, 1)), np.ones((1, 1, 1)), True, alpha=1.5), "within 0 and 1"),
    (lambda: blend(np.ones((1, 1, 1)), np.ones((1, 1, 1)), True, alpha=math.nan), "within 0 and 1"),
    (lambda: blend(np.ones((1, 1, 1)), np.ones((1, 1, 1)), True, exposure_ratio=-1.0), "exposure_ratio"),
    (lambda: blend(np.ones((1, 1, 1)), np.ones((1, 1, 1)), True, exposure_ratio=math.inf), "exposure_ratio"),
    (lambda: reproject(np.ones((2, 2)), history_position(SMALL, CAMERA, CAMERA)), "volume: has shape"),
    (lambda: reproject(np.ones((16, 9, 12)), history_position(SMALL, CAMERA, CAMERA)), r"must have \(16, 9, 13\)"),
    (lambda: start_weight(0.0), "at least 1"), (lambda: start_weight(math.nan), "at least 1"),
    (lambda: start_weight(1.0, alpha=0.0), "above 0"),
])
def test_misuse_is_refused(call: Any, words: str) -> None:
    with pytest.raises(InputError, match=words):
        call()
