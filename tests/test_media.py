"""Media: densities at points, how materials blend, and the V-Buffer over the grid."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np
import pytest
import reference_media as slow
from hypothesis import given
from hypothesis import strategies as st

from froxel_ref.density import place
from froxel_ref.grid import Froxels, froxel_points, make_froxels
from froxel_ref.media import VBuffer, contributing, density, media_at, pack_v_buffer, voxelise
from froxel_ref.records import InputError
from froxel_ref.scene import (
    Camera,
    DensityTexture,
    HeightFog,
    LocalMedium,
    Medium,
    NoiseDensity,
    Scene,
    Transform,
)
from froxel_ref.settings import Grid, Settings, replace

EPS = 2.0**-52
NOISE = NoiseDensity(size=8, cells=2)
TEXTURES = {NOISE: np.random.default_rng(3).random((8, 7, 6))}
GRID = Grid(width=11, height=7, depth=9, near=0.5, far=32.0)
CAMERA = Camera(position=(0.5, 1.5, 2.0), target=(1.5, 1.0, -8.0), vertical_fov=65.0)
TURNED = Transform(matrix=(1.5, 0.4, -0.3, 0.5, -0.2, 1.1, 0.6, 1.2, 0.3, -0.5, 2.0, -4.0))


def at(*points: tuple[float, float, float]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points as three arrays."""
    x, y, z = np.asarray(points, float).T
    return x.copy(), y.copy(), z.copy()


def cloud(count: int, seed: int = 0, reach: float = 4.0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    x, y, z = np.random.default_rng(seed).uniform(-reach, reach, (3, count))
    return x, y, z - 4.0


def assert_same(a: VBuffer, b: VBuffer) -> None:
    """Bit for bit, also where one of them has more axes written out."""
    for name in ("scattering", "extinction", "emission", "phase_anisotropy"):
        left, right = np.broadcast_arrays(getattr(a, name), getattr(b, name))
        assert left.dtype == right.dtype
        np.testing.assert_array_equal(left, right, err_msg=name)
    assert [g for _, g in a.lobes] == [g for _, g in b.lobes]
    for (left, _), (right, _) in zip(a.lobes, b.lobes, strict=True):
        np.testing.assert_array_equal(*np.broadcast_arrays(left, right))


# --- density ----------------------------------------------------------------------------------------


def test_height_fog_by_hand() -> None:
    fog = Medium(height_fog=HeightFog(start=1.0, falloff=0.5, max_height=3.0))
    heights = [-5.0, 1.0, 2.0, 3.0, math.nextafter(3.0, 4.0)]  # both comparisons are strict
    expected = [1.0, 1.0, 0.6065306597126334, 0.36787944117144233, 0.0]
    np.testing.assert_allclose(density(fog, at(*[(0.0, y, 0.0) for y in heights])), expected, rtol=2 * EPS)


def test_boxes_and_ellipsoids_by_hand() -> None:
    corners = [(1.0, 1.0, -1.0), (math.nextafter(1.0, 2.0), 0.0, 0.0), (0.6, 0.0, 0.8), (0.0, -1.0, 0.0)]
    assert density(LocalMedium(shape="box"), at(*corners)).tolist() == [1.0, 0.0, 1.0, 1.0]
    assert density(LocalMedium(shape="ellipsoid"), at(*corners)).tolist() == [0.0, 0.0, 1.0, 1.0]


def test_local_height_fog_is_in_the_unit_cube() -> None:
    """Local y from −1 to 1 is height 0 to 1, whatever the scale."""
    fog = HeightFog(start=0.5, falloff=2.0, max_height=0.75)
    box = LocalMedium(height_fog=fog, transform=Transform(translate=(0, 10, 0), scale=(1, 4, 1)))
    found = density(box, at((0, 6, 0), (0, 10, 0), (0, 11, 0), (0, 13, 0)))
    np.testing.assert_allclose(found, [1.0, 1.0, math.exp(-0.25), 0.0], rtol=2 * EPS)


def test_texture_by_hand() -> None:
    """One texel axis, two texels: centres give the texel, the middle between them the mean."""
    texture = np.array([[[2.0, 6.0]]])
    record = DensityTexture(source=NOISE, scale=(0.5, 1.0, 1.0))
    x = [0.5, 1.0, 1.5, 2.0, 2.5, -1.5]  # texel centres at a quarter and three quarters of a 2 m period
    wrap = density(Medium(density=record), at(*[(a, 0, 0) for a in x]), texture)
    assert wrap.tolist() == [2.0, 4.0, 6.0, 4.0, 2.0, 2.0]
    # A5: at the period's end clamping gives the edge texel instead of the mean across the seam.
    seam = density(Medium(density=record), at((2.0, 0, 0), (2.0 - 1e-12, 0, 0)), texture, addressing="clamp")
    assert seam.tolist() == [2.0, 6.0]


@given(shift=st.tuples(*[st.integers(-3, 3)] * 3), seed=st.integers(0, 99))
def test_textures_repeat(shift: tuple[int, int, int], seed: int) -> None:
    medium = Medium(density=DensityTexture(source=NOISE, scale=(0.5, 0.25, 2.0)))
    x, y, z = (np.round(p * 64) / 64 for p in cloud(20, seed))
    moved = (x + 2 * shift[0], y + 4 * shift[1], z + shift[2] / 2)  # whole periods, without rounding
    np.testing.assert_array_equal(density(medium, (x, y, z), TEXTURES[NOISE]),
                                  density(medium, moved, TEXTURES[NOISE]))


@pytest.mark.parametrize("addressing", ["wrap", "clamp"])
def test_scroll_is_bias_in_time(addressing: str) -> None:
    still = DensityTexture(source=NOISE, bias=(0.5, 0.625, -1.75))
    moving = DensityTexture(source=NOISE, bias=(0.0, 0.5, -2.0), scroll=(0.25, 0.0625, 0.125))
    points = cloud(50)
    np.testing.assert_array_equal(
        density(Medium(density=still), points, TEXTURES[NOISE], addressing=addressing),
        density(Medium(density=moving), points, TEXTURES[NOISE], time=2.0, addressing=addressing))


def test_long_scrolling_keeps_float32_digits() -> None:
    """After a day at 1/8 period a second; the offset in float32 would have only three digits left."""
    medium = Medium(density=DensityTexture(source=NOISE, scroll=(0.1251, 0.0, 0.0)))
    points = cloud(50)
    single = density(medium, tuple(p.astype(np.float32) for p in points), TEXTURES[NOISE], time=86400.0)
    assert single.dtype == np.float32
    # |position| ≤ 8 in float32 is 5e-7 of a period, times 8 texels and texel differences of up to 1.
    np.testing.assert_allclose(single, density(medium, points, TEXTURES[NOISE], time=86400.0), atol=2e-5)


def test_a_texture_must_come_with_its_medium() -> None:
    with pytest.raises(InputError, match="has no texels"):
        place(Medium(density=DensityTexture(source=NOISE)))


# --- against the scalar loop ------------------------------------------------------------------------

unit = st.floats(0.0, 1.0)
colours = st.tuples(unit, unit, unit)
fogs = st.none() | st.builds(HeightFog, start=st.floats(-2, 2), falloff=st.floats(0, 3),
                             max_height=st.none() | st.floats(-2, 3))
textures = st.none() | st.builds(
    DensityTexture, source=st.just(NOISE), scale=st.tuples(*[st.floats(-2, 2)] * 3), bias=colours,
    scroll=colours)
looks: dict[str, Any] = {
    "albedo": colours,
    "extinction": st.sampled_from([0.0, 0.5]) | st.floats(1e-6, 10.0) | colours,
    "emissive": st.just((0.0, 0.0, 0.0)) | colours,
    "phase_anisotropy": st.sampled_from([-0.5, 0.0, 0.3, 0.9]),
    "height_fog": fogs, "density": textures}
transforms = st.just(TURNED) | st.builds(
    Transform, translate=st.tuples(*[st.floats(-3, 3)] * 3), rotate=st.tuples(*[st.floats(-180, 180)] * 3),
    scale=st.tuples(*[st.floats(0.5, 5.0)] * 3))
everywhere = st.lists(st.builds(Medium, **looks), max_size=2)
places = st.lists(st.builds(LocalMedium, shape=st.sampled_from(["box", "ellipsoid"]), transform=transforms,
                            **looks), max_size=3)
modes = st.builds(
    lambda mixing, emission, addressing, time: replace(
        Settings(grid=GRID, time=time), phase_mixing=mixing, emission=emission,
        density_addressing=addressing),
    st.sampled_from(["weighted", "mean", "mixture"]),
    st.sampled_from(["per_metre", "published", "absorption"]),
    st.sampled_from(["wrap", "clamp"]), st.floats(0.0, 10.0))


@given(fog=everywhere, local=places, settings=modes, seed=st.integers(0, 999))
def test_points_agree_with_the_scalar_loop(fog: list[Medium], local: list[LocalMedium], settings: Settings,
                                           seed: int) -> None:
    media = [*fog, *local]
    points = cloud(6, seed)
    found = media_at(media, points, TEXTURES, settings)
    shared = len({m.phase_anisotropy for m in media}) <= 1
    for i in range(6):
        expected = slow.material(media, tuple(float(p[i]) for p in points), TEXTURES, settings)
        # Texture coordinates of up to ±20 periods at 8 texels: 20·8·2⁻⁵² of a texel, and small sums.
        close = {"rtol": 1e-12, "atol": 2e-13}
        for name in ("scattering", "extinction", "emission"):
            field = np.broadcast_to(getattr(found, name), (3, 6))
            np.testing.assert_allclose(field[:, i], expected[name], **close, err_msg=name)
        for field, g in found.lobes:
            total = np.broadcast_to(field, (3, 6))[:, i].sum()
            np.testing.assert_allclose(total, expected["lobes"][g], **close)
        if sum(expected["scattering"]) > 1e-9 and not shared:
            anisotropy = np.broadcast_to(found.phase_anisotropy, 6)[i]
            np.testing.assert_allclose(anisotropy, expected["anisotropy"], rtol=1e-9, atol=1e-9)


@given(fog=everywhere, local=places, settings=modes, dtype=st.sampled_from([np.float32, np.float64]),
       camera=st.sampled_from([Camera(), CAMERA]))
def test_the_grid_is_its_points(fog: list[Medium], local: list[LocalMedium], settings: Settings, dtype: type,
                                camera: Camera) -> None:
    """Restricted, blocked and threaded, against all media at all points at once: the same bits."""
    scene = Scene(camera=camera, global_media=tuple(fog), local_media=tuple(local))
    froxels = make_froxels(camera, GRID, dtype=dtype)
    x, y, z = np.broadcast_arrays(*froxel_points(froxels))
    brute = media_at([*fog, *local], (x, y, z), TEXTURES, settings)
    assert_same(voxelise(scene, froxels, TEXTURES, settings, threads=1), brute)
    assert_same(voxelise(scene, froxels, TEXTURES, settings, threads=2, block=25), brute)
    assert_same(voxelise(scene, froxels, TEXTURES, settings, threads=1, restrict=False), brute)


# --- the grid ---------------------------------------------------------------------------------------

MONO = Medium(extinction=0.1, phase_anisotropy=0.5)
HIGH = dataclasses.replace(MONO, height_fog=HeightFog(falloff=0.3))
INSIDE = LocalMedium(extinction=0.2, phase_anisotropy=-0.25, transform=Transform(translate=(0, 1.7, -6)))
BEHIND = dataclasses.replace(INSIDE, transform=Transform(translate=(0, 1.7, 60)))
SAME = dataclasses.replace(INSIDE, phase_anisotropy=0.5)
SHAPES: list[tuple[tuple[Medium, ...], tuple[LocalMedium, ...], tuple[Any, ...], tuple[Any, ...]]] = [
    ((), (), (1, 1, 1), (1, 1, 1)),
    ((MONO,), (), (1, 1, 1), (1, 1, 1)),
    ((HIGH,), (), (9, 7, 1), (1, 1, 1)),
    ((HIGH,), (BEHIND,), (9, 7, 1), (9, 7, 1)),
    ((dataclasses.replace(MONO, height_fog=HeightFog(falloff=0.0)),), (), (1, 1, 1), (1, 1, 1)),
    ((HIGH,), (INSIDE,), (9, 7, 11), (9, 7, 11)),
    ((HIGH,), (SAME,), (9, 7, 11), (1, 1, 1)),
    ((dataclasses.replace(MONO, density=DensityTexture(source=NOISE)),), (), (9, 7, 11), (1, 1, 1)),
    ((HIGH,), (dataclasses.replace(INSIDE, extinction=0.0),), (9, 7, 1), (1, 1, 1)),
]


@pytest.mark.parametrize(("fog", "local", "extinction", "anisotropy"), SHAPES)
def test_fields_carry_only_what_varies(fog: Any, local: Any, extinction: Any, anisotropy: Any) -> None:
    scene = Scene(global_media=fog, local_media=local)
    found = voxelise(scene, make_froxels(scene.camera, GRID), TEXTURES, Settings(grid=GRID))
    assert found.extinction.shape == extinction
    assert found.scattering.shape == (3, *extinction)
    assert found.phase_anisotropy.shape == anisotropy
    assert found.emission.shape == (3, 1, 1, 1)


def test_no_media_is_exact_zeros() -> None:
    found = voxelise(Scene(), make_froxels(Camera(), GRID, dtype=np.float32), {}, Settings(grid=GRID))
    for field in found[:4]:
        assert field.dtype == np.float32
        assert field.size in (1, 3)
        assert not field.any()


def test_rgb_extinction_has_channels() -> None:
    media = [Medium(extinction=0.5, albedo=(1.0, 0.5, 0.0)), Medium(extinction=(0.1, 0.2, 0.3))]
    found = media_at(media, at((0, 0, 0)), {}, Settings())
    np.testing.assert_allclose(found.extinction[:, 0], [0.6, 0.7, 0.8], rtol=2 * EPS)
    np.testing.assert_allclose(found.scattering[:, 0], [0.6, 0.45, 0.3], rtol=2 * EPS)


def test_contributing_leaves_out_what_adds_nothing() -> None:
    dark = Medium(extinction=0.0)
    glow = Medium(extinction=0.0, emissive=(0.0, 0.0, 1.0))
    assert contributing([dark, glow, MONO]) == (glow, MONO)


# --- laws -------------------------------------------------------------------------------------------


def whole(froxels: Froxels, media: list[Medium], settings: Settings = Settings(grid=GRID)) -> VBuffer:  # noqa: B008
    scene = Scene(global_media=tuple(m for m in media if not isinstance(m, LocalMedium)),
                  local_media=tuple(m for m in media if isinstance(m, LocalMedium)))
    return voxelise(scene, froxels, TEXTURES, settings)


@given(fog=everywhere, local=places)
def test_materials_add(fog: list[Medium], local: list[LocalMedium]) -> None:
    froxels = make_froxels(CAMERA, GRID)
    together = whole(froxels, [*fog, *local])
    for name in ("scattering", "emission"):
        parts = sum(getattr(whole(froxels, [medium]), name) for medium in (*fog, *local))
        # Up to five terms, none negative: one rounding of the sum each.
        np.testing.assert_allclose(*np.broadcast_arrays(getattr(together, name), parts), rtol=5 * EPS)


@pytest.mark.parametrize("k", [0.25, 8.0])
def test_lengths_times_k_and_extinction_over_k(k: float) -> None:
    """The world k times as large and k times as thin: σ_t·length is unchanged, exactly for a power of two."""
    def build(k: float) -> VBuffer:
        fog = Medium(extinction=0.1 / k,
                     height_fog=HeightFog(start=1.0 * k, falloff=0.5 / k, max_height=6.0 * k),
                     density=DensityTexture(source=NOISE, scale=(0.3 / k, 0.2 / k, 0.1 / k)))
        moved = np.reshape(TURNED.matrix, (3, 4)) * k
        ball = LocalMedium(extinction=0.7 / k, shape="ellipsoid", phase_anisotropy=0.5,
                           transform=Transform(matrix=tuple(moved.ravel().tolist())))
        camera = dataclasses.replace(CAMERA, position=tuple(k * a for a in CAMERA.position),
                                     target=tuple(k * a for a in CAMERA.target))
        grid = dataclasses.replace(GRID, near=GRID.near * k, far=GRID.far * k)
        return whole(make_froxels(camera, grid), [fog, ball])

    scaled, plain = build(k), build(1.0)
    np.testing.assert_allclose(scaled.extinction * k, plain.extinction, rtol=64 * EPS)
    np.testing.assert_allclose(scaled.phase_anisotropy, plain.phase_anisotropy, rtol=64 * EPS, atol=64 * EPS)


@given(angles=st.tuples(*[st.floats(-180, 180)] * 3), shift=st.tuples(*[st.floats(-5, 5)] * 3),
       shape=st.sampled_from(["box", "ellipsoid"]))
def test_moving_medium_and_points_together(angles: tuple[float, ...], shift: tuple[float, ...],
                                           shape: str) -> None:
    motion = Transform(rotate=angles, translate=shift).world_from_local
    medium = LocalMedium(shape=shape, transform=TURNED, height_fog=HeightFog(start=0.2, falloff=1.5),
                         density=DensityTexture(source=NOISE, scale=(2.0, 1.0, 3.0)))
    placed = motion @ TURNED.world_from_local
    moved = dataclasses.replace(medium, transform=Transform(matrix=tuple(placed[:3].ravel().tolist())))
    points = np.stack(cloud(40))
    elsewhere = motion[:3, :3] @ points + motion[:3, 3:]
    # Positions of some 10 m in 8 texels per metre; one point on the very border would not do.
    np.testing.assert_allclose(density(moved, tuple(elsewhere), TEXTURES[NOISE]),
                               density(medium, tuple(points), TEXTURES[NOISE]), rtol=0, atol=1e-12)


# --- phase anisotropy (D12) -------------------------------------------------------------------------

DENSE = Medium(extinction=1.0, phase_anisotropy=0.8)
TRACE = Medium(extinction=1e-6, phase_anisotropy=-0.8)
NOTHING_HERE = Medium(extinction=1.0, phase_anisotropy=-0.8, height_fog=HeightFog(max_height=-1.0))


@pytest.mark.parametrize(("media", "mean", "weighted"), [
    ([DENSE], 0.8, 0.8),
    ([DENSE, TRACE], 0.0, 0.8 - 1.6e-6),        # D12: a millionth of the fog turns g from 0.8 to 0
    ([DENSE, NOTHING_HERE], 0.0, 0.8),          # and so does a medium whose density is 0 here
    ([DENSE, LocalMedium(phase_anisotropy=-0.8)], 0.0, 0.8 - 1.6 * 0.01 / 1.01),
    ([DENSE, LocalMedium(phase_anisotropy=-0.8, transform=Transform(translate=(9, 0, 0)))], 0.8, 0.8),
    ([LocalMedium(phase_anisotropy=-0.8, transform=Transform(translate=(9, 0, 0))), TRACE], -0.8, -0.8),
    ([NOTHING_HERE, dataclasses.replace(NOTHING_HERE, phase_anisotropy=0.5)], -0.15, 0.0),
    ([], 0.0, 0.0),
])
def test_mean_and_weighted_anisotropy(media: list[Medium], mean: float, weighted: float) -> None:
    for mixing, expected in (("mean", mean), ("weighted", weighted), ("mixture", weighted)):
        found = media_at(media, at((0, 0, 0)), {}, replace(Settings(), phase_mixing=mixing)).phase_anisotropy
        np.testing.assert_allclose(found, expected, rtol=0, atol=3e-12, err_msg=mixing)


def test_outside_every_local_medium_the_plain_mean_is_zero() -> None:
    settings = replace(Settings(), phase_mixing="mean")
    found = media_at([LocalMedium(phase_anisotropy=0.5)], at((0, 0, 0), (3, 0, 0)), {}, settings)
    assert found.phase_anisotropy.tolist() == [0.5, 0.0]


def test_a_mixture_keeps_each_phase_function() -> None:
    media = [DENSE, TRACE, dataclasses.replace(DENSE, extinction=0.5)]
    found = media_at(media, at((0, 0, 0)), {}, replace(Settings(), phase_mixing="mixture"))
    assert [(float(field[1, 0]), g) for field, g in found.lobes] == [(1.5, 0.8), (1e-6, -0.8)]
    single = media_at([DENSE], at((0, 0, 0)), {}, replace(Settings(), phase_mixing="mixture"))
    assert [(field.ravel().tolist(), g) for field, g in single.lobes] == [([1.0, 1.0, 1.0], 0.8)]
    assert media_at(media, at((0, 0, 0)), {}, Settings()).lobes == ()


@pytest.mark.parametrize(("emission", "expected"), [
    ("per_metre", 3.0), ("published", 3.0), ("absorption", 0.75 * 2.0 * 3.0)])
def test_emission_switch(emission: str, expected: float) -> None:
    medium = Medium(albedo=(0.25, 0.25, 0.25), extinction=2.0, emissive=(3.0, 0.0, 3.0))
    found = media_at([medium], at((0, 0, 0)), {}, replace(Settings(), emission=emission))
    assert found.emission[:, 0].tolist() == [expected, 0.0, expected]


# --- extremes ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize("mixing", ["weighted", "mean", "mixture"])
def test_extremes_stay_finite(dtype: type, mixing: str) -> None:
    """Extinction 1e8 beside 1e-4 (contrast 1e12), and a falloff that underflows; warnings are errors."""
    steep = HeightFog(start=0.0, falloff=1e4)
    media = [Medium(extinction=1e8, phase_anisotropy=0.999999, height_fog=steep),
             Medium(extinction=1e-4, phase_anisotropy=-0.999999, height_fog=HeightFog(max_height=1.0)),
             LocalMedium(extinction=1e8, phase_anisotropy=0.5,
                         height_fog=HeightFog(start=0.9, falloff=1e10))]
    heights = (-1.0, 0.0, 0.0073, 0.0741, 0.5, 0.9, 60.0)
    x, y, z = (p.astype(dtype) for p in at(*[(0.0, h, 0.0) for h in heights]))
    found = media_at(media, (x, y, z), {}, replace(Settings(), phase_mixing=mixing))
    assert all(np.isfinite(field).all() for field in found[:4])
    assert np.all(np.abs(found.phase_anisotropy) <= 0.999999)
    assert float(found.extinction[1]) == pytest.approx(2e8 + 1e-4, rel=float(np.finfo(dtype).eps))
    assert found.extinction[-1] == 0.0


# --- layout -----------------------------------------------------------------------------------------


def test_packing_by_hand() -> None:
    """Table 3.2: albedo and extinction, emissive and g, channels last."""
    point = tuple(p.reshape(2, 1, 1) for p in at((0, 0, 0), (0, 5, 0)))
    medium = Medium(albedo=(0.5, 0.25, 1.0), extinction=2.0, emissive=(1.0, 2.0, 3.0), phase_anisotropy=0.3,
                    height_fog=HeightFog(max_height=1.0))
    a, b = pack_v_buffer(media_at([medium], point, {}, Settings()))
    assert a[:, 0, 0].tolist() == [[0.5, 0.25, 1.0, 2.0], [0.0, 0.0, 0.0, 0.0]]
    assert b[:, 0, 0].tolist() == [[1.0, 2.0, 3.0, 0.3], [0.0, 0.0, 0.0, 0.3]]
    assert a.flags.c_contiguous


def test_packing_reproduces_the_division_by_zero() -> None:
    """D1: NaN exactly where there is nothing."""
    fog = dataclasses.replace(MONO, height_fog=HeightFog(max_height=1.0))
    froxels = make_froxels(CAMERA, GRID)
    found = whole(froxels, [fog])
    (divided, _), (zero, _) = (pack_v_buffer(found, albedo_at_zero=how) for how in ("divide", "zero"))
    empty = zero[..., 3] == 0.0
    assert empty.any()
    assert not empty.all()
    np.testing.assert_array_equal(np.isnan(divided[..., :3]), np.repeat(empty[..., np.newaxis], 3, axis=-1))
    assert np.isfinite(zero).all()
    np.testing.assert_array_equal(divided[~empty], zero[~empty])


def test_rgb_extinction_does_not_fit_the_layout() -> None:
    found = media_at([Medium(extinction=(0.1, 0.2, 0.3))], at((0, 0, 0)), {}, Settings())
    with pytest.raises(InputError, match="must be one number"):
        pack_v_buffer(found)
