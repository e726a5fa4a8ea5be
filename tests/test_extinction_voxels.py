"""Voxelised extinction: splats against a slow loop, marched rays against closed forms."""

from __future__ import annotations

import math

import numpy as np
import pytest

from froxel_ref.extinction_voxels import Box, march, voxel_centres, voxelise_media, voxelise_particles
from froxel_ref.opacity_slices import opacity_slices, transmittance
from froxel_ref.records import InputError

BOX = Box((-1.0, 2.0, 0.5), (3.0, 4.0, 3.5))
VOLUME = 4.0 * 2.0 * 3.0


def particles(count=200, seed=1):
    rng = np.random.default_rng(seed)
    low, high = (np.array(corner)[:, None] for corner in BOX)
    # A quarter of them outside, some on faces.
    position = low + (high - low) * rng.uniform(-0.1, 1.1, (3, count))
    position[:, :4] = np.array([[-1.0, 3.0, -1.0, 3.0], [2.0, 4.0, 4.0, 2.0], [0.5, 3.5, 3.5, 0.5]])
    return tuple(position), rng.random(count)


@pytest.mark.parametrize("method", ["point", "trilinear"])
@pytest.mark.parametrize("size", [1, 2, 5])
def test_splats_against_a_slow_loop(method, size):
    position, cross = particles()
    want = np.zeros((size, size, size))
    for x, y, z, c in zip(*position, cross, strict=True):
        u = [(v - low) / (high - low) * size for v, low, high in zip((x, y, z), *BOX, strict=True)]
        if not all(0.0 <= v <= size for v in u):
            continue
        amount = c / (VOLUME / size**3)
        if method == "point":
            i, j, k = (min(int(v), size - 1) for v in u)
            want[k, j, i] += amount
            continue
        for corner in range(8):
            place, weight = [], 1.0
            for axis, v in enumerate(u):
                base = math.floor(v - 0.5)
                side = (corner >> axis) & 1
                place.append(min(max(base + side, 0), size - 1))
                weight *= (v - 0.5 - base) if side else 1 - (v - 0.5 - base)
            want[place[2], place[1], place[0]] += amount * weight
    got = voxelise_particles(position, cross, BOX, size=size, method=method)
    np.testing.assert_allclose(got, want, rtol=1e-12, atol=1e-14)


@pytest.mark.parametrize("method", ["point", "trilinear"])
def test_no_cross_section_is_lost_inside(method):
    position, cross = particles()
    inside = np.all([(p >= low) & (p <= high) for p, low, high in zip(position, *BOX, strict=True)], axis=0)
    grid = voxelise_particles(position, cross, BOX, method=method)
    assert grid.shape == (32, 32, 32)
    assert grid.sum() * VOLUME / 32**3 == pytest.approx(cross[inside].sum(), rel=1e-12)


def test_media_are_sampled_at_centres():
    grid = voxelise_media(lambda p: p[0] + 10 * p[1] + 100 * p[2], BOX, size=4)
    x, y, z = voxel_centres(BOX, size=4)
    assert grid[2, 1, 3] == pytest.approx(x[0, 0, 3] + 10 * y[0, 1, 0] + 100 * z[2, 0, 0])
    assert x.ravel().tolist() == [-0.5, 0.5, 1.5, 2.5]
    uniform = voxelise_media(lambda p: np.full((1, 1, 1), 0.3), BOX, size=4)
    assert uniform.shape == (4, 4, 4)
    uniform += 1.0  # its own memory


@pytest.mark.parametrize("lookup", ["trilinear", "point"])
def test_a_uniform_box_is_marched_exactly(lookup):
    """Rays from a point light through a box that they enter and leave at slices' ends."""
    grid = np.full((8, 8, 8), 0.7)
    origin = tuple(np.array([v]) for v in (1.0, 3.0, -1.0))
    direction = tuple(np.array([v]) for v in (0.0, 0.0, 1.0))
    slices = march(grid, BOX, origin, direction, 0.0, 6.0, slices=12, lookup=lookup)
    want = 0.7 * np.clip(0.5 * np.arange(1, 13) - 1.5, 0.0, 3.0)
    np.testing.assert_allclose(np.cumsum(slices[:, 0]), want, rtol=1e-13, atol=1e-14)
    passed = transmittance(opacity_slices(slices), np.array([[1.0]]))
    assert passed[0, 0] == pytest.approx(math.exp(-2.1), rel=1e-13)


def test_linear_extinction_between_centres_is_exact():
    """Trilinear lookups reproduce it, and the middle rule integrates it."""
    grid = voxelise_media(lambda p: 1.0 + 0.2 * p[0] + 0.1 * p[1] + 0.3 * p[2], BOX, size=8)
    rng = np.random.default_rng(2)
    a, b = np.array([[0.0, 2.5, 1.0], [2.0, 3.5, 3.0]])
    aim = rng.uniform(-0.05, 0.05, (3, 5)) + (b - a)[:, None]
    length = np.linalg.norm(aim, axis=0)
    slices = march(grid, BOX, tuple(np.array([v]) for v in a), tuple(aim / length), 0.0, length, slices=16)
    assert slices.shape == (16, 5)
    ends = a[:, None] + aim
    rate = [1.0 + 0.2 * p[0] + 0.1 * p[1] + 0.3 * p[2] for p in (a[:, None], ends)]
    np.testing.assert_allclose(slices.sum(axis=0), length * (rate[0] + rate[1]) / 2, rtol=1e-12)


def test_point_and_trilinear_differ_by_a_voxel():
    """A particle that moves: jumps from voxel to voxel by "point", slides by "trilinear"."""
    box = Box((0.0, 0.0, 0.0), (4.0, 4.0, 4.0))
    x = np.linspace(1.5, 2.5, 41)

    def seen(method):
        return np.array([voxelise_particles((np.array([v]), np.array([2.0]), np.array([2.0])), np.ones(1), box, size=4,
                                            method=method)[..., 2].sum() for v in x])

    assert sorted(set(seen("point"))) == [0.0, 1.0]
    assert np.abs(np.diff(seen("trilinear"))).max() == pytest.approx(1 / 40)


def test_float32_stays():
    position, cross = particles()
    narrow = voxelise_particles(tuple(p.astype(np.float32) for p in position), cross.astype(np.float32), BOX, size=4)
    assert narrow.dtype == np.float32
    ray = tuple(np.array([v], np.float32) for v in (0.0, 0.0, 1.0))
    assert march(narrow, BOX, ray, ray, 0.0, 6.0).dtype == np.float32


def test_bad_input_is_named():
    flat = Box((0.0, 0.0, 0.0), (1.0, 0.0, 1.0))
    one = (np.zeros(1),) * 3
    with pytest.raises(InputError, match=r"box: .* must have a volume"):
        voxel_centres(flat)
    with pytest.raises(InputError, match="size: is 0"):
        voxel_centres(BOX, size=0)
    with pytest.raises(InputError, match="method: is 'linear'"):
        voxelise_particles(one, np.ones(1), BOX, method="linear")
    with pytest.raises(InputError, match="slices: is 0"):
        march(np.ones((2, 2, 2)), BOX, one, one, 0.0, 1.0, slices=0)
    with pytest.raises(InputError, match="lookup: is 'nearest'"):
        march(np.ones((2, 2, 2)), BOX, one, one, 0.0, 1.0, lookup="nearest")
