"""Half the resolution and back: depths in turn, rays through what pixels share, upsampling that sees depth."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from froxel_ref.bilateral import EXTREMES, JUDGED, half_depth, half_rays, rotated_offsets, upsample
from froxel_ref.compare import order
from froxel_ref.geometry import camera_rays
from froxel_ref.raymarch import march_long_range
from froxel_ref.records import InputError
from froxel_ref.scene import Camera, DirectionalLight, HeightFog, Medium, Scene
from froxel_ref.settings import Grid, Settings

EPS = 2.0**-52
SIZES = [(6, 8), (5, 7), (6, 7), (1, 1), (1, 4), (3, 1), (2, 2)]


def image(height, width, seed=1, low=1.0, high=100.0):
    return np.random.default_rng(seed).uniform(low, high, (height, width))


# --- half the resolution ----------------------------------------------------------------------------


@pytest.mark.parametrize("even", EXTREMES)
@pytest.mark.parametrize(("height", "width"), SIZES)
def test_half_depth_agrees_with_the_scalar_loop(height, width, even):
    depth = image(height, width)
    if depth.size > 4:
        depth[height // 2, width // 2], depth[0, 0] = np.inf, np.inf
    got = half_depth(depth, even=even)
    assert got.shape == (math.ceil(height / 2), math.ceil(width / 2))
    for y in range(got.shape[0]):
        for x in range(got.shape[1]):
            block = [float(depth[j, i]) for j in (2 * y, 2 * y + 1) for i in (2 * x, 2 * x + 1)
                     if j < height and i < width]
            first = (x + y) % 2 == 0
            assert got[y, x] == (min(block) if first == (even == "nearest") else max(block))


def test_half_depth_by_hand():
    """The nearest at the top left by default, then in turn along both axes."""
    depth = np.arange(16.0).reshape(4, 4)
    assert half_depth(depth).tolist() == [[0.0, 7.0], [13.0, 10.0]]
    assert half_depth(depth, even="farthest").tolist() == [[5.0, 2.0], [8.0, 15.0]]


def test_half_depth_of_reversed_depth_is_the_other_one():
    """A11: the smaller of n/z is the farthest, so one listing means two things."""
    depth = image(6, 9)
    assert half_depth(1.0 / depth, even="nearest") == pytest.approx(1.0 / half_depth(depth, even="farthest"), rel=EPS)


@pytest.mark.parametrize(("axes", "shape"), [((1, 1), (1, 1)), ((1, 8), (3, 4)), ((6, 1), (3, 4)), ((6, 8), (3, 4))])
def test_half_depth_of_axes_on_which_nothing_varies(axes, shape):
    depth = image(*axes)
    got = half_depth(depth, shape=(6, 8))
    assert got.shape == shape
    assert np.array_equal(np.broadcast_to(got, (3, 4)), half_depth(np.broadcast_to(depth, (6, 8)).copy()))


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_half_depth_keeps_type_and_values(dtype):
    depth = image(5, 6).astype(dtype)
    got = half_depth(depth)
    assert got.dtype == dtype
    assert np.isin(got, depth).all()


def test_a_nan_shows():
    depth = image(4, 4)
    depth[3, 0] = np.nan
    assert np.isnan(half_depth(depth)).tolist() == [[False, False], [True, False]]


@pytest.mark.parametrize(("height", "width"), SIZES)
def test_half_rays_run_through_the_corner_that_pixels_share(height, width):
    """Unnormalised and at depth 1 that is the mean of the four pixels' rays, where there are four."""
    camera = Camera(position=(1.0, 2.0, 3.0), target=(-2.0, 1.0, -5.0), width=width, height=height)
    full, half = camera_rays(camera, width, height), half_rays(camera, width, height)
    assert half.length.shape == (math.ceil(height / 2), math.ceil(width / 2))
    for got, pixels in zip(half.per_depth, full.per_depth, strict=True):
        got, pixels = np.broadcast_to(got, half.length.shape), np.broadcast_to(pixels, full.length.shape)
        for y in range(height // 2):
            for x in range(width // 2):
                mean = pixels[2 * y:2 * y + 2, 2 * x:2 * x + 2].mean()
                assert got[y, x] == pytest.approx(mean, rel=1e-13, abs=1e-15)
    squares = sum(np.broadcast_to(c, half.length.shape) ** 2 for c in half.per_depth)
    assert half.length == pytest.approx(np.sqrt(squares), rel=8 * EPS)


def test_half_rays_at_an_odd_border():
    """Three pixels, 90° wide, end at −⅓, ⅓ and 1: texels' centres lie where the first and the third do."""
    rays = half_rays(Camera(vertical_fov=90.0, width=3, height=3, target=(0.0, 1.7, -1.0)), 3, 3, dtype=np.float32)
    assert rays.per_depth[0].dtype == np.float32
    assert rays.per_depth[0].ravel() == pytest.approx([-1 / 3, 1.0], rel=1e-6)
    assert rays.per_depth[1].ravel() == pytest.approx([1 / 3, -1.0], rel=1e-6)


# --- upsampling: a scalar loop ----------------------------------------------------------------------


def scalar_weight(found, depth, accepted, least):
    if found == depth:
        return 1.0
    if not (math.isfinite(found) and math.isfinite(depth)) or depth == 0.0:
        return least
    return max(least, min(1.0, max(0.0, 1.0 - abs(found - depth) / (accepted * depth))))


def scalar_upsample(field, half, depth, offsets, judged, accepted, least):
    height, width = depth.shape
    rows, columns = half.shape
    result = np.empty((height, width))

    def at(values, j, i):
        return float(values[min(max(j, 0), rows - 1), min(max(i, 0), columns - 1)])

    for y in range(height):
        for x in range(width):
            total = weights = 0.0
            for dx, dy in offsets[:, :, y, x].tolist():
                u, v = (x + 0.5) / 2.0 + dx, (y + 0.5) / 2.0 + dy
                for j in range(-6, rows + 6):
                    for i in range(-6, columns + 6):
                        tent = max(0.0, 1.0 - abs(u - i - 0.5)) * max(0.0, 1.0 - abs(v - j - 0.5))
                        if tent == 0.0:
                            continue
                        judge = at(half, j, i) if judged == "texel" else at(half, math.floor(v), math.floor(u))
                        weight = tent * scalar_weight(judge, float(depth[y, x]), accepted, least)
                        total += weight * at(field, j, i)
                        weights += weight
            result[y, x] = total / weights
    return result


@pytest.mark.parametrize("judged", JUDGED)
@pytest.mark.parametrize("taps", [0, 1, 4])
@pytest.mark.parametrize(("height", "width"), SIZES)
def test_upsampling_agrees_with_the_scalar_loop(height, width, taps, judged):
    """Depths of which some are alike, some within a tenth, some beyond, some infinite, one 0."""
    random = np.random.default_rng(7)
    depth = random.choice([10.0, 10.3, 10.9, 12.0, 50.0, np.inf], (height, width))
    depth[0, 0] = 0.0
    half = random.choice([10.0, 10.3, 10.9, 12.0, 50.0, np.inf, 0.0], (-(-height // 2), -(-width // 2)))
    fields = [random.random((3, *half.shape)), random.random(half.shape)]
    offsets = random.uniform(-1.5, 1.5, (taps, 2, height, width)) if taps else None
    got = upsample(fields, half, depth, offsets=offsets, judged=judged, accepted=0.08, least=1e-3)
    used = np.zeros((1, 2, height, width)) if offsets is None else offsets
    for found, field in zip((*got[0], got[1]), (*fields[0], fields[1]), strict=True):
        want = scalar_upsample(field, half, depth, used, judged, 0.08, 1e-3)
        assert np.broadcast_to(found, depth.shape) == pytest.approx(want, rel=1e-12)


def test_weights_by_hand():
    """A pixel at 10 m between texels (shares ¾ and ¼): at 10.4 m the second has weight 0.6, at 11 m the least."""
    for second, weight in ((10.4, 0.6), (10.999, 0.001), (11.0, 1e-5), (9.0, 1e-5), (9.6, 0.6), (1e300, 1e-5)):
        got, = upsample([np.array([[0.0, 1.0]])], np.array([[10.0, second]]), np.array([[10.0, 10.0, 10.0, 10.0]]))
        share = 0.25 * weight / (0.75 + 0.25 * weight)
        assert got[0, 1] == pytest.approx(share, rel=1e-11)
        assert got[0, 0] == 0.0


# --- what must hold ---------------------------------------------------------------------------------


@pytest.mark.parametrize("depth", [7.0, np.inf, 0.0, 1e-300, 1e300])
def test_equal_depths_give_the_bilinear_mean(depth):
    """A plane over texel centres comes back, level beyond the outermost."""
    y, x = np.arange(4.0)[:, None] + 0.5, np.arange(5.0) + 0.5
    across, down = np.clip((np.arange(10) + 0.5) / 2, 0.5, 4.5), np.clip((np.arange(8) + 0.5) / 2, 0.5, 3.5)[:, None]
    got, = upsample([0.1 + 0.2 * x + 0.3 * y], np.full((1, 1), depth), np.full((1, 1), depth), shape=(8, 10))
    assert got == pytest.approx(0.1 + 0.2 * across + 0.3 * down, rel=8 * EPS)


def test_nothing_leaks_across_an_edge():
    """Near 20 m with 0, far 100 m with 1 and a jagged edge: each pixel of a far or near side keeps its own to 1.5e-4.

    Each pixel here has a texel on its side among its four, of a share of at least 1/16; the other three have 15/16
    times 1e-5.
    """
    columns, rows = np.arange(32), np.arange(24)[:, None]
    depth = np.where(columns < 13 + 3 * np.sin(rows), 20.0, 100.0)
    half = half_depth(depth)
    values = (half > 50.0).astype(float)
    for side, own in ((20.0, 0.0), (100.0, 1.0)):
        texel = (half == side).astype(float)
        reached, = upsample([texel], np.zeros((1, 1)), np.zeros((1, 1)), shape=(24, 32))  # bilinear, by depths alike
        there = (depth == side) & (reached > 0.0)
        got, = upsample([values], half, depth)
        leak = np.abs(got - own)[there].max()
        assert 0.0 < leak <= 15e-5
        plain, = upsample([values], half, depth, judged="tap")
        assert np.abs(plain - own)[there].max() > 0.4  # one tap in the middle, judged as a whole, hides nothing
    assert there.sum() > 300


def test_jittered_taps_leak_as_published_only():
    """Four taps within 1.5 texels: judged as a whole a fetch brings in the other side, texel by texel it does not."""
    depth = np.broadcast_to(np.where(np.arange(32) < 15, 20.0, 100.0), (24, 32))
    half = half_depth(depth)
    offsets = rotated_offsets(np.random.default_rng(3).random((4, 24, 32)))
    values = (half > 50.0).astype(float)
    away = np.minimum(np.abs(np.arange(32) - 14.5), 9.0) < 2.0
    found = {judged: upsample([values], half, depth, offsets=offsets, judged=judged)[0] for judged in JUDGED}
    near = (depth == 20.0) & away
    assert np.mean(found["texel"][near]) < 1e-3
    assert np.mean(found["tap"][near]) > 0.05
    assert found["tap"][near].max() > 0.4


def test_sky():
    """Beside sky sky counts, beside a surface it weighs least, and a lone pixel of sky takes what there is."""
    sky = np.inf
    half = np.array([[sky, 30.0]])
    got, = upsample([np.array([[1.0, 0.0]])], half, np.array([[sky, sky, 30.0, 30.0], [30.0, 30.0, sky, sky]]))
    # Shares ¾ and ¼; the pixels at the border see one texel alone.
    least = [0.75e-5 / (0.75e-5 + 0.25), 0.75e-5 / (0.25 + 0.75e-5)]
    assert got[0].tolist() == pytest.approx([1.0, 0.75 / (0.75 + 0.25e-5), 0.25e-5 / (0.75 + 0.25e-5), 0.0], rel=1e-12)
    assert got[1].tolist() == pytest.approx([1.0, least[0], 1.0 - least[1], 0.0], rel=1e-9)


SPECIAL = [0.0, 1e-300, 1.0, 1.05, 50.0, 1e300, np.inf, np.nan]


@given(st.integers(0, 2**32 - 1), st.booleans(), st.sampled_from(JUDGED))
def test_never_nan_and_within_the_hull(seed, moved, judged):
    random = np.random.default_rng(seed)
    depth, half = random.choice(SPECIAL, (5, 6)), random.choice(SPECIAL, (3, 3))
    values, offsets = random.random((3, 3)), random.uniform(-1.5, 1.5, (4, 2, 5, 6))
    got, white = upsample([values, np.ones((3, 3))], half, depth, offsets=offsets if moved else None, judged=judged)
    assert (got >= values.min() * (1.0 - 40 * EPS)).all()
    assert (got <= values.max() * (1.0 + 40 * EPS)).all()
    assert (white == 1.0).all()  # exactly: a sum of weights over itself


def test_what_is_nearer_takes_no_part():
    """Pixels up to the far end have clear air exactly, whatever their texels hold."""
    depth = np.array([[63.0, 64.0, 64.1, np.inf, np.nan, 70.0]])
    light, through = upsample([np.full((3, 1, 3), 2.0), np.full((1, 3), 0.5)], np.full((1, 1), 66.0), depth,
                              begins=64.0, nearer=(0.0, 1.0))
    assert light[:, 0].tolist() == [[0.0, 0.0, 2.0, 2.0, 2.0, 2.0]] * 3
    assert through.tolist() == [[1.0, 1.0, 0.5, 0.5, 0.5, 0.5]]


def test_fields_that_do_not_vary_stay_as_they_are():
    clear = np.zeros((3, 1, 1)), np.ones((1, 1))
    got = upsample(clear, half_depth(image(6, 8)), image(6, 8), begins=50.0, nearer=(0.0, 1.0))
    for a, b in zip(got, clear, strict=True):
        assert a is b
    # One number beyond, but another one nearer: there is an image after all.
    depth = image(6, 8)
    got, = upsample([np.full((1, 1), 0.25)], half_depth(depth), depth, begins=50.0, nearer=(1.0,))
    assert np.array_equal(got, np.where(depth > 50.0, 0.25, 1.0))


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_types_threads_and_blocks(dtype, monkeypatch):
    depth, values = image(12, 14).astype(dtype), image(6, 7, seed=2).astype(dtype)
    whole, = upsample([values], half_depth(depth), depth, threads=1)
    assert whole.dtype == dtype
    monkeypatch.setattr("froxel_ref.blocks.BLOCK", 5)
    for threads in (1, 3):
        assert np.array_equal(upsample([values], half_depth(depth), depth, threads=threads)[0], whole)


# --- offsets ----------------------------------------------------------------------------------------


def test_offsets_rotate_four_numbers():
    noise = np.random.default_rng(1).random((4, 2, 3))
    got = rotated_offsets(noise)
    assert got.shape == (4, 2, 2, 3)
    for tap in range(4):
        for axis in range(2):
            assert np.array_equal(got[tap, axis], (noise[(tap + axis) % 4] * 2.0 - 1.0) * 1.5)
    assert np.array_equal(rotated_offsets(noise, reach=3.0), 2.0 * got)
    assert rotated_offsets(noise.astype(np.float32)).dtype == np.float32


def test_offsets_go_along_x_then_y():
    """One texel to the right and none down reads the next column."""
    values = np.arange(12.0).reshape(3, 4)
    move = np.zeros((1, 2, 1, 1))
    move[0, 0] = 1.0
    one = np.ones((1, 1))
    plain, moved = (upsample([values], one, one, offsets=m, shape=(6, 8))[0] for m in (None, move))
    assert np.array_equal(moved[:, :6], plain[:, 2:])
    move[0] = [[[0.0]], [[1.0]]]
    moved, = upsample([values], one, one, offsets=move, shape=(6, 8))
    assert np.array_equal(moved[:4], plain[2:])


# --- the long range, there and back -----------------------------------------------------------------

CAMERA = Camera(position=(0.0, 8.0, 0.0), target=(0.0, 7.0, -10.0), vertical_fov=50.0, width=48, height=36)
FOG = Medium(albedo=(0.9, 0.9, 0.9), extinction=0.01, phase_anisotropy=0.4,
             height_fog=HeightFog(start=0.0, falloff=0.05))
SUN = DirectionalLight(direction=(0.3, 0.5, -1.0), irradiance=(2.0, 2.0, 2.0))
SCENE = Scene(camera=CAMERA, global_media=(FOG,), lights=(SUN,), ambient=(0.1, 0.1, 0.1))
SETTINGS = Settings(grid=Grid(far=32.0))


def there_and_back(height, width, depth):
    camera = dataclasses.replace(CAMERA, width=width, height=height)
    what, half = dataclasses.replace(SCENE, camera=camera), half_depth(depth, shape=(height, width))
    found = [march_long_range(d, rays, what, farthest=400.0, settings=SETTINGS)
             for d, rays in ((half, half_rays(camera, width, height)), (depth, camera_rays(camera, width, height)))]
    return upsample(found[0], half, depth, begins=32.0, nearer=(0.0, 1.0), shape=(height, width)), found[1]


@pytest.mark.parametrize("odd", [0, 1])
def test_half_the_resolution_is_of_second_order_on_a_wall(odd):
    """A wall at 150 m under the sky: the median error falls fourfold with twice the resolution, odd sizes included."""
    off = []
    for scale in (1, 2, 4):
        height, width = 36 * scale - odd, 48 * scale - odd
        depth = np.where(np.arange(height)[:, None] < height // 3, np.inf, np.full((height, width), 150.0))
        got, full = there_and_back(height, width, depth)
        off.append([float(np.median(np.abs(a / b - 1.0))) for a, b in zip(got, full, strict=True)])
    for errors in np.transpose(off):
        assert order([1.0, 0.5, 0.25], errors).order == pytest.approx(2.0, abs=0.6)
    assert (np.array(off[0]) < 2e-3).all()


def test_half_the_resolution_on_a_ground():
    """Where depth slopes, nearest and farthest in turn are off by a pixel's depth, which the mean of four takes out
    in part: measured 2.3e-3, 7.0e-4 and 2.7e-4 of the largest radiance, between first and second order."""
    off = []
    for scale in (2, 4, 8):
        height, width = 36 * scale, 48 * scale
        slope = np.broadcast_to(camera_rays(dataclasses.replace(CAMERA, width=width, height=height), width, height
                                            ).per_depth[1], (height, width))
        with np.errstate(divide="ignore"):
            depth = np.where(slope < -0.02, -8.0 / slope, np.inf)
        got, full = there_and_back(height, width, depth)
        rows = slice(int(0.6 * height), height)  # no horizon, where a pixel spans a hundred metres
        off.append(float(np.sqrt(np.mean((got[0] - full.radiance)[:, rows] ** 2)) / full.radiance.max()))
    assert order([4.0, 2.0, 1.0], off).order == pytest.approx(1.5, abs=0.3)
    assert off == pytest.approx([2.3e-3, 7.0e-4, 2.7e-4], rel=0.05)


# --- bad input --------------------------------------------------------------------------------------


@pytest.mark.parametrize(("options", "place"), [
    ({"judged": "texels"}, "judged"), ({"accepted": 0.0}, "accepted"), ({"accepted": np.nan}, "accepted"),
    ({"least": 0.0}, "least"), ({"begins": 1.0}, "nearer"), ({"begins": 1.0, "nearer": (0.0, 1.0)}, "nearer"),
    ({"offsets": np.zeros((4, 3, 6, 8))}, "offsets"), ({"offsets": np.zeros((4, 2, 5, 8))}, "offsets"),
    ({"offsets": np.zeros((0, 2, 6, 8))}, "offsets"), ({"offsets": np.zeros((2, 6, 8))}, "offsets"),
    ({"shape": (7, 8)}, "depth"), ({"half": np.ones((6, 8))}, "half"), ({"fields": [np.ones((4, 4))]}, "fields")])
def test_bad_input_is_named(options, place):
    given = {"fields": [np.ones((3, 4))], "half": np.ones((3, 4)), "depth": image(6, 8)} | options
    with pytest.raises(InputError) as fault:
        upsample(given.pop("fields"), given.pop("half"), given.pop("depth"), **given)
    assert fault.value.place == place


def test_half_depth_names_bad_input():
    for options, place in (({"even": "near"}, "even"), ({"shape": (5, 8)}, "depth")):
        with pytest.raises(InputError) as fault:
            half_depth(image(6, 8), **options)
        assert fault.value.place == place
    for shape in ((3, 6, 8), (0, 4), (5,)):
        with pytest.raises(InputError, match="depth"):
            half_depth(np.ones(shape))
    with pytest.raises(InputError, match="noise"):
        rotated_offsets(np.zeros((3, 6, 8)))
