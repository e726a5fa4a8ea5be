"""The checkerboard: which texels a frame computes, their lattices, and what holes are filled with."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from froxel_ref.checkerboard import PARITIES, computed, fill, gather, lattice_froxels, lattices, scatter
from froxel_ref.grid import corner_bounds, froxel_from_world, froxel_points, make_froxels
from froxel_ref.jitter import froxel_jitter
from froxel_ref.lighting import in_scattering
from froxel_ref.media import voxelise
from froxel_ref.records import InputError
from froxel_ref.scene import Camera, DirectionalLight, LocalMedium, Medium, PointLight, Scene, SpotLight, Transform
from froxel_ref.settings import Grid, Settings
from froxel_ref.temporal import blend

EPS = 2.0**-52
shapes = st.tuples(*[st.integers(1, 7)] * 3)
frames = st.integers(-9, 9)
parities = st.sampled_from(PARITIES)
ROLLED = Camera(position=(-3.0, 2.0, 7.0), target=(5.0, 1.0, -9.0), up=(0.3, 1.0, 0.1))


def is_computed(z: int, y: int, x: int, frame: int, parity: str) -> bool:
    """The definition [Dörries 2020, §3.2.9], and with "odd" the author's program's (A1)."""
    return (x + y + z + frame) % 2 == (0 if parity == "even" else 1)


def texels(shape: tuple[int, int, int]) -> list[tuple[int, int, int]]:
    return list(np.ndindex(shape))


def field(shape: tuple[int, ...], seed: int = 0) -> Any:
    return np.random.default_rng(seed).random(shape)


def halved(full: Any, frame: int, parity: str = "even", empty: float = 0.0) -> Any:
    """A field as a frame leaves it: its lattices gathered and scattered again."""
    shape = full.shape[-3:]
    parts = [gather(full, lattice) for lattice in lattices(shape, frame, parity=parity)]
    return scatter(parts, shape, frame, parity=parity, empty=empty)


# --- which texels ---------------------------------------------------------------------------------------


@given(shape=shapes, frame=frames, parity=parities)
def test_computed_by_definition(shape: tuple[int, int, int], frame: int, parity: str) -> None:
    flags = computed(shape, frame, parity=parity)
    assert flags.shape == shape
    assert all(flags[t] == is_computed(*t, frame, parity) for t in texels(shape))


@given(shape=shapes, frame=frames)
def test_two_frames_compute_each_texel_once(shape: tuple[int, int, int], frame: int) -> None:
    now, then = computed(shape, frame), computed(shape, frame + 1)
    assert not (now & then).any()
    assert (now | then).all()
    assert abs(int(now.sum()) - int(then.sum())) == np.prod(shape) % 2
    np.testing.assert_array_equal(computed(shape, frame, parity="odd"), then)
    np.testing.assert_array_equal(computed(shape, frame + 2), now)


def test_the_published_dispatch_computes_the_same_texels() -> None:
    """Listing 3.11: thread (x, y, k) takes slice 2k, or 2k + 1 where (x + y) mod 2 is the frame's condition."""
    for frame in range(4):
        flags = np.zeros((6, 5, 7), bool)
        for k, y, x in np.ndindex(3, 5, 7):
            flags[2 * k + (1 if (x + y) & 1 == (frame + 1) & 1 else 0), y, x] = True
        np.testing.assert_array_equal(flags, computed((6, 5, 7), frame))


# --- lattices -------------------------------------------------------------------------------------------


@given(shape=shapes, frame=frames, parity=parities)
def test_lattices_hold_each_computed_texel_once(shape: tuple[int, int, int], frame: int, parity: str) -> None:
    seen = np.zeros(shape, int)
    boxes = lattices(shape, frame, parity=parity)
    for box in boxes:
        assert seen[box].size > 0
        seen[box] += 1
    assert all(seen[t] == is_computed(*t, frame, parity) for t in texels(shape))
    assert len(boxes) <= 4
    assert sum(seen[box].size for box in boxes) == seen.sum()  # half of the work, to a texel


@given(shape=shapes, frame=frames, parity=parities, kept=st.tuples(*[st.booleans()] * 3),
       channels=st.sampled_from([(), (3,)]))
def test_gathered_and_scattered_is_what_it_was(shape: tuple[int, int, int], frame: int, parity: str,
                                               kept: tuple[bool, bool, bool], channels: tuple[int, ...]) -> None:
    """Also where fields have axes of length 1."""
    small = field((*channels, *(n if keep else 1 for n, keep in zip(shape, kept, strict=True))))
    full = np.broadcast_to(small, (*channels, *shape))
    parts = [gather(small, lattice) for lattice in lattices(shape, frame, parity=parity)]
    assert all(np.shares_memory(part, small) for part in parts)
    if not parts:
        return
    got = scatter(parts, shape, frame, parity=parity, empty=-1.0)
    assert got.shape == full.shape
    for t in texels(shape):
        expected = full[(..., *t)] if is_computed(*t, frame, parity) else np.full(channels, -1.0)
        np.testing.assert_array_equal(got[(..., *t)], expected)


def test_dtype_is_kept_and_fields_are_left_alone() -> None:
    full = field((3, 4, 5, 6)).astype(np.float32)
    full.setflags(write=False)
    half = halved(full, 1)
    half.setflags(write=False)
    assert half.dtype == np.float32
    filled = fill(half, full, True, 1)
    assert filled.dtype == np.float32
    assert fill(half, None, True, 1).dtype == np.float32
    np.testing.assert_array_equal(filled, full)


CAMERAS = {"level": Camera(), "rolled": ROLLED}


@pytest.mark.parametrize("camera", CAMERAS.values(), ids=CAMERAS.keys())
@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize("shape", [(8, 6, 10), (7, 5, 9), (5, 1, 4), (3, 4, 1)])
def test_froxels_of_a_lattice_are_those_of_the_grid(camera: Camera, dtype: type, shape: tuple[int, int, int]) -> None:
    """Positions bit for bit; ``sample_from_world`` finds each sample at its index in the lattice."""
    froxels = make_froxels(camera, Grid(depth=shape[0], height=shape[1], width=shape[2]), jitter=(0.2, 0.9, 0.4),
                           dtype=dtype)
    for frame in (0, 1):
        for lattice in lattices(shape, frame):
            part = lattice_froxels(froxels, lattice)
            whole = [np.broadcast_to(p, shape)[lattice] for p in froxel_points(froxels)]
            points = [np.broadcast_to(p, whole[0].shape) for p in froxel_points(part)]
            for a, b in zip(points, whole, strict=True):
                np.testing.assert_array_equal(a, b)
            np.testing.assert_array_equal(part.rays.length, froxels.rays.length[lattice[1], lattice[2]])
            i, j, d = np.einsum("ij,jzyx->izyx", part.sample_from_world,
                                np.stack([*points, np.ones_like(points[0])]).astype(float))
            slack = 100 * float(np.finfo(dtype).eps) * 64
            np.testing.assert_allclose(i / d, np.broadcast_to(np.arange(i.shape[2]), i.shape), rtol=0, atol=slack)
            np.testing.assert_allclose(j / d, np.broadcast_to(np.arange(i.shape[1])[:, None], i.shape), rtol=0,
                                       atol=slack)


def test_bounds_work_on_lattices() -> None:
    froxels = make_froxels(ROLLED, Grid(depth=9, height=11, width=14))
    corners = np.array([(2.0, 0.0, -3.0), (3.0, 2.0, -3.0), (2.5, 1.0, -5.0), (1.0, 1.5, -1.0)])
    inside = corner_bounds(froxels, corners)
    for lattice in lattices((9, 11, 14), 1):
        own = corner_bounds(lattice_froxels(froxels, lattice), corners)
        for part, whole, step in zip(own, inside, lattice, strict=True):
            held = set(range(*step.indices(99))) & set(range(whole.start, whole.stop))
            assert held <= {step.start + 2 * i for i in range(part.start, part.stop)}


SCENE = Scene(
    camera=Camera(position=(1.0, 2.0, 0.5), target=(0.0, 1.0, -8.0)),
    global_media=(Medium(extinction=0.05, phase_anisotropy=0.4),),
    local_media=(LocalMedium(transform=Transform(translate=(0.0, 1.0, -8.0), scale=(3.0, 2.0, 3.0)), extinction=0.3,
                             phase_anisotropy=-0.2),),
    lights=(PointLight(position=(0.0, 1.5, -6.0), intensity=(1.0, 2.0, 3.0), radius=5.0),
            SpotLight(position=(2.0, 3.0, -9.0), direction=(0.0, -1.0, 0.2), intensity=(5.0, 4.0, 3.0), radius=9.0),
            PointLight(position=(-2.0, 1.0, -12.0), intensity=(3.0, 2.0, 1.0), radius=4.0),
            DirectionalLight(direction=(0.2, 1.0, 0.3), irradiance=(1.0, 1.0, 1.0))))


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize("frame", [0, 1])
@pytest.mark.parametrize("anisotropy", [0.4, -0.2])
def test_media_and_light_on_lattices_are_those_of_the_grid(dtype: type, frame: int, anisotropy: float) -> None:
    """Half of the froxels by four smaller grids: bit for bit where one g holds for all media.

    Where g varies, lighting chooses its formula by the values of g that it is given, and a lattice may miss some:
    then within what either form may be off, 8 ε of each light's part (`froxel_ref.phase.henyey_greenstein`).
    """
    shape = (9, 11, 21)
    settings = Settings(grid=Grid(depth=9, height=11, width=21))
    froxels = make_froxels(SCENE.camera, settings.grid, jitter=(0.3, 0.6, 0.1), dtype=dtype)
    media = tuple(dataclasses.replace(m, phase_anisotropy=anisotropy) for m in SCENE.local_media)
    scene = dataclasses.replace(SCENE, local_media=media)

    def light(part: Any) -> Any:
        return in_scattering(voxelise(scene, part, {}, settings), scene.lights, part)

    full = light(froxels)
    assert full.shape == (3, *shape)
    half = scatter([light(lattice_froxels(froxels, lattice)) for lattice in lattices(shape, frame)], shape, frame)
    expected = np.where(computed(shape, frame), full, 0.0)
    np.testing.assert_allclose(half, expected, rtol=0.0 if anisotropy == 0.4 else 16 * np.finfo(dtype).eps)


# --- holes ----------------------------------------------------------------------------------------------


def slow_fill(current: Any, history: Any, valid: Any, frame: int, parity: str, outside: str, without: str) -> Any:
    """One channel, texel by texel."""
    result = current.copy()
    depth, rows, columns = current.shape
    for z, y, x in texels(current.shape):
        if is_computed(z, y, x, frame, parity):
            continue
        if history is not None and valid[z, y, x] and np.isfinite(history[z, y, x]):
            result[z, y, x] = history[z, y, x]
            continue
        if history is None and without == "empty":
            result[z, y, x] = 0.0
            continue
        places = [(z, y - 1, x), (z, y + 1, x), (z, y, x - 1), (z, y, x + 1)]
        if rows == columns == 1 and outside == "absent":
            places = [(z - 1, y, x), (z + 1, y, x)]
        there = [current[p] for p in places if 0 <= p[0] < depth and 0 <= p[1] < rows and 0 <= p[2] < columns]
        share = 4 if outside == "zero" else max(len(there), 1)
        result[z, y, x] = sum(there) / share
    return result


@given(shape=shapes, frame=frames, parity=parities, outside=st.sampled_from(["absent", "zero"]),
       without=st.sampled_from(["neighbours", "empty"]), first=st.booleans(), seed=st.integers(0, 99))
def test_fill_by_a_slow_loop(shape: tuple[int, int, int], frame: int, parity: str, outside: str, without: str,
                             first: bool, seed: int) -> None:
    rng = np.random.default_rng(seed)
    current, history = rng.random((2, *shape))
    current[~computed(shape, frame, parity=parity)] = np.nan  # is not read
    history[rng.random(shape) < 0.2] = np.nan
    valid = rng.random(shape) < 0.6
    got = fill(current, None if first else history, valid, frame, parity=parity, outside=outside,
               without_history=without)
    expected = slow_fill(current, None if first else history, valid, frame, parity, outside, without)
    # Four values below 1 are added in another order, three roundings of at most ½ ulp of 4 each.
    np.testing.assert_allclose(got, expected, rtol=0, atol=2 * EPS)
    assert not np.isnan(got).any()


@given(shape=shapes, frame=frames, outside=st.sampled_from(["absent", "zero"]))
def test_channels_are_filled_alike_and_stand_or_fall_together(shape: tuple[int, int, int], frame: int,
                                                             outside: str) -> None:
    current, history = field((3, *shape), 1), field((3, *shape), 2)
    history[1, 0, 0, 0] = np.inf
    got = fill(current, history, True, frame, outside=outside)
    seen = np.isfinite(history).all(axis=0)
    for channel in range(3):
        own = np.where(seen, history[channel], np.nan)
        np.testing.assert_array_equal(got[channel], fill(current[channel], own, True, frame, outside=outside))


def test_histories_and_flags_may_be_a_single_texel() -> None:
    current = field((3, 4, 5, 6))
    history, valid = np.full((3, 1, 1, 1), 2.0), np.full((1, 1, 1), True)
    got = fill(current, history, valid, 0)
    np.testing.assert_array_equal(got, np.where(computed((4, 5, 6), 0), current, 2.0))
    rows = np.arange(5).reshape(1, 5, 1) > 2
    expected = np.where(rows, got, fill(current, None, True, 0))
    np.testing.assert_array_equal(fill(current, history, rows, 0), expected)


@given(shape=shapes, frame=frames, value=st.floats(1e-3, 1e3))
def test_a_constant_has_no_holes_in_the_first_frame(shape: tuple[int, int, int], frame: int, value: float) -> None:
    half = np.where(computed(shape, frame), value, np.nan)
    got = fill(half, None, False, frame)
    if shape == (1, 1, 1) and frame % 2:
        assert got == 0.0  # nothing was computed
    else:
        np.testing.assert_allclose(got, value, rtol=2 * EPS)  # a third of a sum of three


@given(frame=frames, parity=parities, slope=st.tuples(*[st.floats(-4.0, 4.0)] * 3))
def test_linear_fields_are_filled_exactly_inside(frame: int, parity: str, slope: tuple[float, float, float]) -> None:
    z, y, x = np.ogrid[:4, :6, :7]
    full = 1.0 + slope[0] * z + slope[1] * y + slope[2] * x
    error = np.abs(fill(halved(full, frame, parity, np.nan), None, False, frame, parity=parity) - full)
    # The field itself is rounded thrice, at most 1 + 4·(3 + 5 + 6) = 57 large, and so is the sum of four.
    assert error[:, 1:-1, 1:-1].max() <= 8 * 57 * EPS
    # On an edge the mean of three leans inwards by a third of a texel, in a corner that of two by half of one per axis.
    assert error[:, 1:-1, 0].max() <= abs(slope[2]) / 3 + 1e-13
    assert error[:, 0, 0].max() <= (abs(slope[1]) + abs(slope[2])) / 2 + 1e-13


def test_second_order_inside() -> None:
    def error(n: int) -> float:
        u = (np.arange(n) + 0.5) / n
        full = (np.sin(3.0 * u) * np.cos(2.0 * u)[:, None])[None]
        return float(np.abs(fill(halved(full, 0), None, False, 0) - full)[:, 1:-1, 1:-1].max())

    sizes = np.array([16, 32, 64, 128])
    assert np.polyfit(np.log(sizes), np.log([error(n) for n in sizes]), 1)[0] == pytest.approx(-2.0, abs=0.1)


def test_d11_zeros_outside_dim_the_border_by_25_to_50_percent() -> None:
    full = np.ones((2, 6, 6))
    holes = ~computed(full.shape, 0)
    got = fill(halved(full, 0), None, False, 0, outside="zero")
    corners, edges = np.zeros((6, 6), bool), np.zeros((6, 6), bool)
    corners[::5, ::5] = True
    edges[[0, -1]] = edges[:, [0, -1]] = True
    assert set(got[:, corners][holes[:, corners]]) == {0.5}
    assert set(got[:, edges & ~corners][holes[:, edges & ~corners]]) == {0.75}
    assert set(got[:, ~edges].ravel()) == {1.0}


def test_d11_the_first_frame_may_stay_empty() -> None:
    full = field((4, 5, 6))
    got = fill(halved(full, 0, empty=np.nan), None, True, 0, without_history="empty")
    np.testing.assert_array_equal(got, np.where(computed(full.shape, 0), full, 0.0))


def test_single_columns_and_rows() -> None:
    column = np.arange(5.0).reshape(1, 5, 1)  # rows 0, 2 and 4 are computed
    assert fill(halved(column, 0), None, False, 0).ravel().tolist() == [0.0, 1.0, 2.0, 3.0, 4.0]
    assert fill(halved(column, 1), None, False, 1).ravel().tolist() == [1.0, 1.0, 2.0, 3.0, 3.0]
    assert fill(halved(column, 0).reshape(1, 1, 5), None, False, 0).ravel().tolist() == [0.0, 1.0, 2.0, 3.0, 4.0]
    assert fill(halved(column, 0), None, False, 0, outside="zero").ravel().tolist() == [0.0, 0.5, 2.0, 1.5, 4.0]


def test_a_slice_of_one_texel_takes_those_before_and_behind() -> None:
    depth = np.array([1.0, 2.0, 4.0, 8.0, 16.0]).reshape(5, 1, 1)
    assert fill(halved(depth, 0), None, False, 0).ravel().tolist() == [1.0, 2.5, 4.0, 10.0, 16.0]
    assert fill(halved(depth, 1), None, False, 1).ravel().tolist() == [2.0, 2.0, 5.0, 8.0, 8.0]
    assert fill(halved(depth, 0), None, False, 0, outside="zero").ravel().tolist() == [1.0, 0.0, 4.0, 0.0, 16.0]


def test_exposure_rescales_the_history_alone() -> None:
    full = np.ones((2, 3, 4))
    got = fill(halved(full, 0), full, True, 0, exposure_ratio=2.0)
    np.testing.assert_array_equal(got, np.where(computed(full.shape, 0), 1.0, 2.0))


# --- over frames ----------------------------------------------------------------------------------------


def run(field_of: Any, shape: tuple[int, int, int], count: int, *, alpha: float = 0.05) -> list[Any]:
    """The filtered volumes of a camera at rest."""
    history, result = None, []
    for frame in range(count):
        current = fill(halved(field_of(frame), frame, empty=np.nan), history, True, frame)
        history = current if history is None else blend(current, history, True, alpha=alpha)
        result.append(history)
    return result


def test_two_frames_at_rest_show_the_whole_field() -> None:
    """With α = 1 every texel was computed in this frame or the one before."""
    full = field((5, 4, 7))
    np.testing.assert_array_equal(run(lambda _: full, full.shape, 2, alpha=1.0)[-1], full)


def test_a_hole_keeps_its_average_to_the_bit() -> None:
    shape = (3, 4, 5)
    volumes = run(lambda frame: field((3, 4, 5), frame), shape, 6)
    for frame in range(1, 6):
        holes = ~computed(shape, frame)
        np.testing.assert_array_equal(volumes[frame][holes], volumes[frame - 1][holes])


def test_a_step_is_answered_at_half_the_pace() -> None:
    """0.95^(frames/2): 5 % are left after 59 computed values, 117 or 118 frames by the texel's colour, not 59."""
    shape = (2, 3, 4)
    volumes = run(lambda frame: np.full(shape, 1.0 if frame < 2 else 0.0), shape, 122)
    left = np.array([v.max() for v in volumes[2:]])
    least = np.array([v.min() for v in volumes[2:]])
    assert int(np.argmax(least < 0.05)) + 1 == 117
    assert int(np.argmax(left < 0.05)) + 1 == 118
    np.testing.assert_allclose(left[1::2], 0.95 ** np.arange(1, 61), rtol=1e-13)


@pytest.mark.parametrize(("hold", "shift"), [(1, 0.25), (2, 0.0)])
def test_points_that_are_not_held_leave_a_chequered_shift(hold: int, shift: float) -> None:
    """The field x at rest, sampled with jitter: its average over a cycle of 64 frames, after 0.95^352 of the start."""
    shape = (3, 4, 6)
    x = np.broadcast_to(np.arange(6.0), shape)
    volumes = run(lambda frame: x + froxel_jitter(frame, hold=hold)[0], shape, 64 * 12)
    mean = np.mean(volumes[-64:], axis=0) - (x + 0.5)
    expected = np.where(computed(shape, 0), shift, -shift)  # the even frames' points have x ≥ ½
    np.testing.assert_allclose(mean, expected, rtol=0, atol=5e-4)  # measured 0.24951: 1/64 stands in for 0


@pytest.mark.parametrize(("call", "words"), [
    (lambda: computed((2, 2, 2), 0, parity="both"), "known"),
    (lambda: computed((2, 2, 2), 0.5), "whole number"),  # type: ignore[arg-type]
    (lambda: scatter([np.zeros((1, 1, 1))] * 3, (2, 2, 2), 0), "must have 4"),
    (lambda: scatter([], (1, 1, 1), 1), "at least one"),
    (lambda: scatter([np.zeros((2, 1, 1))] * 4, (2, 2, 2), 0), r"parts\[0\]: has shape"),
    (lambda: scatter([np.zeros((1, 1, 1)), *[np.zeros((1, 1, 1, 1))] * 3], (2, 2, 2), 0), r"parts\[1\]: has shape"),
    (lambda: fill(np.zeros((2, 2, 2)), None, True, 0, outside="clamp"), "outside: is 'clamp'"),
    (lambda: fill(np.zeros((2, 2, 2)), None, True, 0, without_history="zero"), "without_history"),
    (lambda: fill(np.zeros((2, 2, 2)), None, True, 0, exposure_ratio=np.nan), "exposure_ratio"),
])
def test_misuse_is_refused(call: Any, words: str) -> None:
    with pytest.raises(InputError, match=words):
        call()


def test_points_of_a_lattice_lie_where_the_grid_says() -> None:
    """Against froxel_from_world, which knows nothing of lattices."""
    grid = Grid(depth=4, height=5, width=6)
    froxels = make_froxels(ROLLED, grid)
    for lattice in lattices((4, 5, 6), 1):
        points = froxel_points(lattice_froxels(froxels, lattice))
        x, y, z = froxel_from_world(points, ROLLED, grid)
        for got, part, axis in ((z, lattice[0], 0), (y, lattice[1], 1), (x, lattice[2], 2)):
            expected = np.arange((4, 5, 6)[axis])[part] + 0.5
            shape = [-1 if i == axis else 1 for i in range(3)]
            np.testing.assert_allclose(got, np.broadcast_to(expected.reshape(shape), got.shape), rtol=0, atol=1e-12)
