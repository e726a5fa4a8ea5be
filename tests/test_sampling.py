"""Texel fetches: texel-centre rules, addressing, exactness, order, broadcasting."""

from __future__ import annotations

import numpy as np
import pytest
import reference_sampling as reference
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from froxel_ref import blocks
from froxel_ref.records import InputError
from froxel_ref.sampling import fetch_bilinear, fetch_nearest, fetch_trilinear

RAMP = np.array([10.0, 20.0, 40.0]).reshape(1, 1, 3)
VOLUME = np.random.default_rng(3).random((5, 4, 6))
INF, NAN = float("inf"), float("nan")

addresses = st.sampled_from(["clamp", "wrap"])
coordinates = st.floats(-20.0, 20.0)
small_textures = hnp.arrays(np.float64, hnp.array_shapes(min_dims=3, max_dims=3, max_side=4),
                            elements=st.floats(-100.0, 100.0))


# --- by hand ------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("x", "clamp", "wrap"), [
    (0.5, 10.0, 10.0), (1.5, 20.0, 20.0), (2.5, 40.0, 40.0),    # centres
    (1.0, 15.0, 15.0), (1.25, 17.5, 17.5), (2.25, 35.0, 35.0),  # between them
    (0.0, 10.0, 25.0), (3.0, 40.0, 25.0), (0.25, 10.0, 17.5),   # at the ends
    (-0.5, 10.0, 40.0), (-1.25, 10.0, 25.0), (4.0, 40.0, 15.0), (301.25, 40.0, 17.5), (-299.0, 10.0, 15.0),
])
def test_ramp_by_hand(x: float, clamp: float, wrap: float) -> None:
    assert fetch_trilinear(RAMP, x, 0.5, 0.5) == clamp
    assert fetch_trilinear(RAMP, x, 0.5, 0.5, address="wrap") == wrap


def test_axes_are_x_y_z_of_a_z_y_x_texture() -> None:
    texture = np.arange(24.0).reshape(2, 3, 4)
    assert fetch_trilinear(texture, 3.5, 1.5, 0.5) == texture[0, 1, 3]
    assert fetch_bilinear(texture[1], 2.5, 0.5) == texture[1, 0, 2]
    assert fetch_nearest(texture, 3.9, 2.1, 1.0) == texture[1, 2, 3]
    assert fetch_nearest(texture[0], 0.0, 2.99) == texture[0, 2, 0]


def test_corner_of_eight_texels_is_their_mean() -> None:
    texture = np.arange(8.0).reshape(2, 2, 2)
    assert fetch_trilinear(texture, 1.0, 1.0, 1.0) == 3.5


def test_clamp_after_frac_shows_the_seam_of_departure_a5() -> None:
    u = np.array([-2.0**-20, 0.0])  # two sides of a period's end
    wrapped = fetch_trilinear(RAMP, u * 3, 0.5, 0.5, address="wrap")
    seam = fetch_trilinear(RAMP, (u - np.floor(u)) * 3, 0.5, 0.5, address="clamp")
    assert abs(wrapped[1] - wrapped[0]) < 1e-3
    assert seam.tolist() == [40.0, 10.0]


@pytest.mark.parametrize(("x", "clamp", "wrap"), [
    (NAN, NAN, NAN), (INF, 40.0, NAN), (-INF, 10.0, NAN), (1e300, 40.0, None), (-1e300, 10.0, None),
])
def test_what_is_not_a_place(x: float, clamp: float, wrap: float | None) -> None:
    np.testing.assert_equal(fetch_trilinear(RAMP, np.array([x]), 0.5, 0.5), [clamp])
    got = fetch_trilinear(RAMP, np.array([x]), 0.5, 0.5, address="wrap")
    if wrap is None:  # a whole number: the mean of two neighbours, by exact remainder
        i = int(x)
        assert got == (RAMP[0, 0, i % 3] + RAMP[0, 0, (i - 1) % 3]) / 2
    else:
        np.testing.assert_equal(got, [wrap])


@pytest.mark.parametrize("x", [NAN, np.array([0.0, NAN])])
def test_nan_stays_where_it_is(x: object) -> None:
    got = fetch_trilinear(VOLUME, x, np.array([1.0, 2.0]), 2.0, address="wrap")
    np.testing.assert_array_equal(np.isnan(got), np.isnan(x) | np.zeros(2, bool))


# --- against exact arithmetic ---------------------------------------------------------------------------


@given(small_textures, coordinates, coordinates, coordinates, addresses, st.sampled_from([None, 8, 3]))
def test_equals_the_sum_of_hat_functions(texture: np.ndarray, x: float, y: float, z: float, address: str,
                                         bits: int | None) -> None:
    got = float(fetch_trilinear(texture, x, y, z, address=address, weight_bits=bits))
    exact = reference.trilinear(texture.tolist(), x, y, z, address, bits)
    # u = ε/2, M the largest texel. A blend rounds three times, each by at most u·M (|far − near|·s ≤ M);
    # its weight is off by u/2 (times 2M). Three axes: 12·u·M. A weight on the edge between two multiples
    # of 2^−bits may go either way: then a whole step is allowed.
    largest = float(np.abs(texture).max())
    allowed = 6 * np.finfo(float).eps * largest
    assert abs(got - exact) <= allowed or (bits and near_a_tie((x, y, z), bits)
                                           and abs(got - exact) <= 6 * largest * 2.0**-bits)


def near_a_tie(position: tuple[float, float, float], bits: int) -> bool:
    scaled = (np.array(position) - 0.5) * 2.0**bits % 1.0
    return bool(np.any(np.abs(scaled - 0.5) < 1e-9))


@given(small_textures, coordinates, coordinates, coordinates, addresses)
def test_never_leaves_the_hull(texture: np.ndarray, x: float, y: float, z: float, address: str) -> None:
    got = fetch_trilinear(texture, x, y, z, address=address)
    assert texture.min() <= got <= texture.max()


@given(st.floats(-1e30, 1e30), st.floats(allow_nan=False, allow_infinity=False), addresses,
       st.sampled_from([None, 8]))
def test_constant_stays_that_constant(value: float, x: float, address: str, bits: int | None) -> None:
    texture = np.full((3, 2, 5), value)
    assert fetch_trilinear(texture, x, -x, x, address=address, weight_bits=bits) == value


@given(st.integers(-2**40, 2**40), st.integers(-50, 50), st.integers(-50, 50))
def test_centres_are_exact_wherever_they_wrap(i: int, j: int, k: int) -> None:
    got = fetch_trilinear(VOLUME, i + 0.5, j + 0.5, k + 0.5, address="wrap")
    assert got == VOLUME[k % 5, j % 4, i % 6]
    assert fetch_nearest(VOLUME, i + 0.5, j + 0.25, k + 0.75, address="wrap") == got


@given(st.integers(-2**20, 2**20), st.integers(0, 6 * 2**20), st.sampled_from([np.float32, np.float64]))
def test_wrap_repeats_exactly(period: int, step: int, dtype: type) -> None:
    x = step / 2.0**20
    shifted = np.array(x + 6 * period, dtype)
    here = np.array(float(shifted) - 6 * period)  # what is left of x in the dtype
    texture = VOLUME.astype(dtype)
    assert fetch_trilinear(texture, shifted, 1.0, 2.0, address="wrap") == fetch_trilinear(
        texture, here.astype(dtype), 1.0, 2.0, address="wrap")


@pytest.mark.parametrize("x", [2.0**52 + 1, 2.0**60, -(2.0**60), 2.0**53 * 7, 1e22])
def test_wrap_of_huge_coordinates_takes_the_exact_remainder(x: float) -> None:
    got = fetch_trilinear(VOLUME, np.array([x, 0.5]), 0.5, 0.5, address="wrap")
    i = int(x)
    # ½·(far − near) + near rounds thrice, by at most ½ ulp of 1 each.
    assert got[0] == pytest.approx((VOLUME[0, 0, i % 6] + VOLUME[0, 0, (i - 1) % 6]) / 2, rel=0, abs=3.4e-16)


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_linear_fields_come_back(dtype: type) -> None:
    k, j, i = np.meshgrid(*(np.arange(n) + 0.5 for n in (6, 7, 8)), indexing="ij")
    texture = (2.0 + 3.0 * i - 1.0 * j + 0.5 * k).astype(dtype)
    rng = np.random.default_rng(1)
    x, y, z = ((rng.random(1000) * (n - 1) + 0.5).astype(dtype) for n in (8, 7, 6))
    exact = 2.0 + 3.0 * x.astype(float) - y.astype(float) + 0.5 * z.astype(float)
    error = np.abs(fetch_trilinear(texture, x, y, z) - exact).max()
    assert error <= 6 * np.finfo(dtype).eps * np.abs(texture).max()  # as in the test against exact arithmetic


def test_second_order_in_the_texel_size() -> None:
    sizes = np.array([8, 16, 32, 64])
    u = np.random.default_rng(2).random((3, 4000))

    def error(n: int) -> float:
        centre = (np.arange(n) + 0.5) / n
        wave = np.sin(2 * np.pi * centre)
        texture = wave * wave[:, None] + wave[:, None, None]
        exact = np.sin(2 * np.pi * u)
        return float(np.sqrt(np.mean((fetch_trilinear(texture, *(u * n), address="wrap")
                                      - exact[0] * exact[1] - exact[2])**2)))

    slope = np.polyfit(np.log(sizes), np.log([error(n) for n in sizes]), 1)[0]
    assert slope == pytest.approx(-2.0, abs=0.05)  # measured −1.99


# --- weights as hardware has them -------------------------------------------------------------------------


def test_eight_bit_weights_are_multiples_of_a_256th() -> None:
    x = np.linspace(0.5, 1.5, 5001)
    got = fetch_bilinear(np.array([[0.0, 256.0]]), x, 0.0, weight_bits=8)
    assert np.array_equal(got, np.rint(got))
    assert set(got) == set(range(257))
    assert np.abs(got - 256 * (x - 0.5)).max() <= 0.5 + 1e-12
    assert np.all(np.diff(got) >= 0)


# --- shapes, types, blocks --------------------------------------------------------------------------------


def separable(dtype: type = np.float64) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(5)
    return tuple((rng.random(shape) * 30 - 10).astype(dtype)  # type: ignore[return-value]
                 for shape in ((7, 1, 11), (9, 1), (7, 1, 1)))


@pytest.mark.parametrize("address", ["clamp", "wrap"])
def test_broadcast_coordinates_equal_expanded_ones(address: str) -> None:
    small = separable()
    full = [a.copy() for a in np.broadcast_arrays(*small)]
    got = fetch_trilinear(VOLUME, *small, address=address)
    assert got.shape == (7, 9, 11)
    np.testing.assert_array_equal(got, fetch_trilinear(VOLUME, *full, address=address))
    flat = fetch_trilinear(VOLUME, *(a.ravel() for a in full), address=address)
    np.testing.assert_array_equal(got.ravel(), flat)
    five = fetch_trilinear(VOLUME, *(a.reshape(7, 3, 1, 3, 11) for a in full), address=address)
    np.testing.assert_array_equal(got.reshape(7, 3, 1, 3, 11), five)


@pytest.mark.parametrize("fetch", [fetch_trilinear, fetch_nearest])
@pytest.mark.parametrize(("block", "threads"), [(1, 1), (10, 1), (100, 3), (16384, None)])
def test_blocks_and_threads_change_nothing(monkeypatch: pytest.MonkeyPatch, fetch: object, block: int,
                                           threads: int | None) -> None:
    full = [a.copy() for a in np.broadcast_arrays(*separable())]
    wanted = fetch(VOLUME, *full, address="wrap")  # type: ignore[operator]
    monkeypatch.setattr(blocks, "BLOCK", block)
    monkeypatch.setattr(blocks.blocks, "__kwdefaults__", {"size": block})
    np.testing.assert_array_equal(
        fetch(VOLUME, *full, address="wrap", threads=threads), wanted)  # type: ignore[operator]


def test_channels_are_fetched_alike() -> None:
    texture = np.random.default_rng(7).random((3, 5, 4, 6))
    got = fetch_trilinear(texture, *separable())
    assert got.shape == (3, 7, 9, 11)
    np.testing.assert_array_equal(got, np.stack([fetch_trilinear(t, *separable()) for t in texture]))
    image = fetch_bilinear(texture[:, 0], np.array([1.0, 2.25]), 3.0)
    assert image.shape == (3, 2)
    np.testing.assert_array_equal(image[1], fetch_bilinear(texture[1, 0], np.array([1.0, 2.25]), 3.0))


@pytest.mark.parametrize("texture", [
    VOLUME.transpose(2, 1, 0).copy().transpose(2, 1, 0), VOLUME[::-1], np.broadcast_to(VOLUME, (2, 5, 4, 6))])
def test_memory_layout_changes_nothing(texture: np.ndarray) -> None:
    np.testing.assert_array_equal(fetch_trilinear(texture, *separable()),
                                  fetch_trilinear(texture.copy(), *separable()))


@pytest.mark.parametrize(("shape", "wanted"), [
    ((1, 1, 1), (1, 1, 1)), ((5, 1, 1), (7, 1, 1)), ((1, 4, 1), (1, 9, 1)), ((1, 1, 6), (7, 1, 11)),
    ((1, 4, 6), (7, 9, 11)), ((3, 1, 1, 1), (3, 1, 1, 1))])
def test_single_texels_leave_their_axis_out(shape: tuple[int, ...], wanted: tuple[int, ...]) -> None:
    texture = np.random.default_rng(8).random(shape)
    full = np.broadcast_to(texture, (*shape[:-3], *(max(n, 2) for n in shape[-3:])))
    got = fetch_trilinear(texture, *separable())
    assert got.shape == wanted
    np.testing.assert_array_equal(np.broadcast_to(got, (*shape[:-3], 7, 9, 11)),
                                  fetch_trilinear(full, *separable()))


@pytest.mark.parametrize(("texture", "coordinate", "wanted"), [
    (np.float32, np.float32, np.float32), (np.float64, np.float64, np.float64),
    (np.float32, float, np.float32),
    (np.float32, np.float64, np.float64), (np.uint8, np.float32, np.float32), (np.uint8, float, np.float64)])
def test_dtype_follows_the_arrays(texture: type, coordinate: type, wanted: type) -> None:
    x = 1.0 if coordinate is float else np.array([1.0], coordinate)
    got = fetch_bilinear(np.array([[200, 100]], texture), x, 0.5)
    assert got.dtype == wanted
    assert got == 150  # and unsigned texels do not wrap round


def test_arguments_are_left_alone() -> None:
    texture, x = VOLUME.copy(), separable()
    kept = [a.copy() for a in x]
    for array in (texture, *x):
        array.setflags(write=False)
    fetch_trilinear(texture, *x, address="wrap")
    np.testing.assert_array_equal(texture, VOLUME)
    assert all(np.array_equal(a, b) for a, b in zip(x, kept, strict=True))


def test_no_points_give_no_values() -> None:
    assert fetch_trilinear(VOLUME, np.zeros((0, 1, 3)), np.zeros((4, 1)), 0.5).shape == (0, 4, 3)


@pytest.mark.parametrize(("call", "words"), [
    (lambda: fetch_trilinear(np.zeros((2, 2)), 0, 0, 0), "must have 3 axes"),
    (lambda: fetch_bilinear(np.zeros(2), 0, 0), "must have 2 axes"),
    (lambda: fetch_trilinear(np.zeros((2, 0, 2)), 0, 0, 0), "none of them empty"),
    (lambda: fetch_trilinear(VOLUME, 0, 0, 0, address="mirror"), "one of clamp, wrap"),
    (lambda: fetch_trilinear(VOLUME, 0, 0, 0, weight_bits=0), "None or 1 to 23"),
    (lambda: fetch_nearest(VOLUME, NAN, 0, 0), "is NaN"),
    (lambda: fetch_nearest(VOLUME, INF, 0, 0, address="wrap"), "infinite"),
])
def test_misuse_is_refused(call: object, words: str) -> None:
    with pytest.raises(InputError, match=words):
        call()  # type: ignore[operator]


def test_nearest_clamps_and_keeps_the_dtype() -> None:
    texture = np.arange(6, dtype=np.uint16).reshape(2, 3)
    got = fetch_nearest(texture, np.array([-INF, -3.0, 0.0, 0.99, 1.0, 2.999, 3.0, 50.0, INF]), 1.0)
    assert got.dtype == np.uint16
    assert got.tolist() == [3, 3, 3, 3, 4, 5, 5, 5, 5]
