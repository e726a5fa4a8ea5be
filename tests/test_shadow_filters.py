"""What depths of a shadow map become: comparisons against a scalar loop, exponential maps, gutters."""

from __future__ import annotations

import math

import numpy as np
import pytest

from froxel_ref.shadow_filters import compare, exponential_map, exponential_visibility, kernel_reach, pad_octahedral

RNG = np.random.default_rng(11)
DEPTH = RNG.uniform(1, 9, (3, 9, 9))


def weights(place, kernel, count):
    """Texels along an axis and what each counts: the integral of a box of ``kernel`` texels of bilinear lookups."""
    if kernel == 0:
        return {min(max(math.floor(place), 0), count - 1): 1.0}
    result = {}
    for k in range(kernel):
        at = place - (kernel - 1) / 2 + k - 0.5
        first = math.floor(at)
        for texel, share in ((first, 1 - (at - first)), (first + 1, at - first)):
            result[texel] = result.get(texel, 0.0) + share / kernel
    return result


def scalar(depth, face, x, y, receiver, kernel):
    total = 0.0
    for row, a in weights(y, kernel, depth.shape[1]).items():
        for column, b in weights(x, kernel, depth.shape[2]).items():
            if a * b > 0.0:
                total += a * b * (depth[face, row, column] > receiver)
    return total


@pytest.mark.parametrize("kernel", [0, 1, 2, 3, 4])
def test_comparisons_equal_a_scalar_loop(kernel):
    n = 300
    margin = kernel_reach(kernel)
    x, y = RNG.uniform(margin, 9 - margin, (2, n))
    face, receiver = RNG.integers(0, 3, n), RNG.uniform(0, 10, n)
    got = compare(DEPTH, face, x, y, receiver, kernel=kernel)
    want = [scalar(DEPTH, *args, kernel) for args in zip(face, x, y, receiver, strict=True)]
    assert 0.1 < np.mean(want) < 0.9
    np.testing.assert_allclose(got, want, atol=1e-14)


@pytest.mark.parametrize("kernel", [0, 1, 2, 3, 7])
@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_full_light_is_exactly_one_and_never_less_than_nothing(kernel, dtype):
    x, y = RNG.uniform(-5, 15, (2, 400)).astype(dtype)
    depth, zero = DEPTH.astype(dtype), np.zeros(400, dtype)
    assert (compare(depth, 0, x, y, zero, kernel=kernel) == 1.0).all()
    dark = compare(depth, 0, x, y, zero + dtype(10), kernel=kernel)
    assert dark.dtype == dtype
    assert (dark >= 0.0).all()
    assert dark.max() <= 1e-6
    # Where nothing was hit nothing is dark, whatever the receiver.
    assert (compare(np.full_like(depth, np.inf), 0, x, y, zero + dtype(1e30), kernel=kernel) == 1.0).all()


def test_a_point_at_the_very_depth_is_dark():
    one = np.ones(1)
    assert compare(np.full((1, 3, 3), 2.0), 0, one, one, 2.0 * one).tolist() == [0.0]
    assert compare(np.full((1, 3, 3), np.nextafter(2.0, 3.0)), 0, one, one, 2.0 * one).tolist() == [1.0]


def test_places_that_are_no_number_of_texels_are_looked_up_at_the_border():
    x = np.array([-1e30, 1e30, np.inf, -np.inf])
    got = compare(DEPTH, 0, x, np.full(4, 4.5), np.full(4, 5.0), kernel=1)
    np.testing.assert_allclose(got, [float(DEPTH[0, 4, c] > 5) for c in (0, 8, 8, 0)], atol=1e-14)


# --- exponential ------------------------------------------------------------------------------------


def test_a_flat_wall_has_the_closed_form():
    wall = exponential_map(np.full((1, 16, 16), 4.0), 0.0, 10.0, exponent=80.0, downsample=4, blur=2)
    np.testing.assert_allclose(wall, math.exp(80 * (0.4 - 1)), rtol=1e-13)
    receiver = np.array([0.0, 0.39, 0.4, 0.41, 0.5, 1.0])
    got = exponential_visibility(wall, 0, *np.full((2, 6), 1.7), receiver)
    np.testing.assert_allclose(got, np.minimum(1.0, np.exp(-80 * (receiver - 0.4))), rtol=1e-11)


def test_filtering_is_averaging_visibility():
    """For a receiver behind everything in the kernel the filtered map gives the mean of what single texels give."""
    depth = RNG.uniform(2, 3, (1, 8, 8))
    coarse = exponential_map(depth, 0.0, 10.0, exponent=30.0, downsample=8, blur=0)
    receiver = 0.35
    want = np.exp(30 * (depth / 10 - receiver)).mean()
    got = coarse[0, 0, 0] * math.exp(30 * (1 - receiver))
    np.testing.assert_allclose(got, want, rtol=1e-12)


def test_blur_keeps_the_mean_and_constants():
    depth = RNG.uniform(2, 3, (1, 64, 64))
    sharp, soft = (exponential_map(depth, 0.0, 10.0, exponent=5.0, downsample=2, blur=b) for b in (0, 3))
    assert soft.std() < 0.5 * sharp.std()
    np.testing.assert_allclose(soft.mean(), sharp.mean(), rtol=1e-3)


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_nothing_overflows(dtype):
    depth = np.array([[0.0, np.inf, -1e30, 1e30]] * 4, dtype)[np.newaxis]
    filtered = exponential_map(depth, 0.0, 10.0, exponent=85.0, downsample=1, blur=0)
    assert np.isfinite(filtered).all()
    x = np.array([0.5, 1.5, 2.5, 3.5], dtype)
    for receiver in (-1e30, 0.0, 0.5, 1.0, 1e30):
        got = exponential_visibility(filtered, 0, x, np.full(4, 1.5, dtype), np.full(4, receiver, dtype), exponent=85.0)
        assert np.isfinite(got).all()
        assert ((got >= 0) & (got <= 1)).all()
        # Nothing is hit within the range; the outermost place is a rounding within the map.
        np.testing.assert_allclose(got[[1, 3]], 1.0, rtol=8 * np.finfo(dtype).eps)


# --- octahedra --------------------------------------------------------------------------------------


def direction(size, row, column):
    """The direction of an octahedral map's texel, from the definition."""
    u, v = 2 * (column + 0.5) / size - 1, 2 * (row + 0.5) / size - 1
    y = 1 - abs(u) - abs(v)
    if y < 0:
        u, v = (1 - abs(v)) * math.copysign(1, u), (1 - abs(u)) * math.copysign(1, v)
    d = np.array([u, y, v])
    return d / np.linalg.norm(d)


def test_the_gutter_holds_the_true_neighbours():
    """Beyond every edge and corner stands the texel whose direction comes next."""
    size, gutter = 8, 2
    index = np.arange(size * size, dtype=np.float64).reshape(size, size)
    padded = pad_octahedral(index, gutter)
    assert padded[gutter:-gutter, gutter:-gutter].tolist() == index.tolist()

    def at(row, column):
        return direction(size, *divmod(int(padded[row + gutter, column + gutter]), size))

    step = 2.5 * 2 / size  # radians that neighbouring texels' centres are apart at most, with room
    for k in range(-gutter, size + gutter):
        for row, column, inner in ((-1, k, (0, k)), (size, k, (size - 1, k)), (k, -1, (k, 0)),
                                   (k, size, (k, size - 1))):
            angle = math.acos(min(1.0, at(row, column) @ at(*inner)))
            assert angle < step
    # Across an edge the same texel stands turned about the edge's middle.
    assert padded[gutter - 1, gutter:-gutter].tolist() == index[0, ::-1].tolist()
    assert padded[gutter:-gutter, -gutter].tolist() == index[::-1, -1].tolist()
