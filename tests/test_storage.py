"""Storage formats against exact fractions: every code there and back, rounding, range, what is not finite."""

from __future__ import annotations

import math
import struct
from fractions import Fraction
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from froxel_ref.records import InputError
from froxel_ref.storage import (
    FORMATS,
    ROUNDINGS,
    decode_r11g11b10f,
    decode_unorm,
    encode_r11g11b10f,
    encode_unorm,
    store,
    store_series,
)

TYPES = (np.float32, np.float64)
# (mantissa bits, exponent of the smallest normal, of the largest number); unsigned formats as channels.
LAYOUT = {"float32": (23, -126, 127), "float16": (10, -14, 15),
          "float11": (6, -14, 15), "float10": (5, -14, 15)}


def reference(x: float, name: str, rounding: str) -> float:
    """The number of a format for one value, from the definition, in exact fractions."""
    mantissa, smallest, largest = LAYOUT[name]
    unsigned = name in ("float11", "float10")
    if math.isnan(x):
        return x
    if unsigned and x <= 0:
        return 0.0
    if math.isinf(x) or x == 0:
        return x
    exponent = max(math.frexp(x)[1] - 1, smallest)
    step = Fraction(2) ** (exponent - mantissa)
    steps = abs(Fraction(x)) / step
    size = step * (round(steps) if rounding == "nearest" else math.floor(steps))  # round(): ties to even
    if size > (2 - Fraction(2) ** -mantissa) * Fraction(2) ** largest:
        size = (2 - Fraction(2) ** -mantissa) * Fraction(2) ** largest
        if rounding == "nearest" and not unsigned:
            return math.copysign(math.inf, x)
    return math.copysign(float(size), x)


def stored(values: Any, name: str, rounding: str = "nearest", dtype: Any = np.float64) -> Any:
    """`store` for one channel: float11 is red, float10 is blue of R11G11B10F."""
    array = np.asarray(values, dtype)
    if name in ("float11", "float10"):
        three = np.stack([array, array, array])
        return store(three, "r11g11b10f", rounding=rounding)[0 if name == "float11" else 2]
    return store(array, name, rounding=rounding)


def same(a: Any, b: Any) -> bool:
    """Equal, the sign of zero and NaN included."""
    with np.errstate(invalid="ignore"):  # signalling NaNs
        a, b = np.asarray(a, np.float64), np.asarray(b, np.float64)
    return bool(np.all((a == b) & (np.signbit(a) == np.signbit(b)) | np.isnan(a) & np.isnan(b)))


def awkward(name: str, dtype: Any) -> list[float]:
    """Values at, half-way between and just beside the numbers of a format, over its whole range."""
    mantissa, smallest, largest = LAYOUT[name]
    values = [0.0, math.inf, math.nan, float(np.finfo(dtype).max), float(np.finfo(dtype).smallest_subnormal)]
    for exponent in {smallest - mantissa - 1, smallest - mantissa, smallest - 1, smallest, -3, 0, 5,
                     min(largest, 100), largest}:
        for fraction in (1.0, 1 + 2.0 ** -(mantissa + 1), 1 + 2.0**-mantissa, 1 + 3 * 2.0 ** -(mantissa + 1),
                         1.7, 2 - 2.0**-mantissa, 2 - 2.0 ** -(mantissa + 1)):
            with np.errstate(over="ignore", under="ignore"):
                middle = dtype(fraction * 2.0**exponent)
            values += [float(middle), float(np.nextafter(middle, dtype(0))),
                       float(np.nextafter(middle, np.finfo(dtype).max))]
    return [sign * value for value in values for sign in (1, -1)]


# --- float formats ------------------------------------------------------------------------------------


@pytest.mark.parametrize("rounding", ROUNDINGS)
@pytest.mark.parametrize("dtype", TYPES)
@pytest.mark.parametrize("name", LAYOUT)
def test_awkward_values(name: str, dtype: Any, rounding: str) -> None:
    values = awkward(name, dtype)
    got = stored(values, name, rounding, dtype)
    assert got.dtype == dtype
    assert same(got, [reference(value, name, rounding) for value in values])


@pytest.mark.parametrize("rounding", ROUNDINGS)
@pytest.mark.parametrize("name", LAYOUT)
@given(x=st.floats())
def test_any_double(name: str, rounding: str, x: float) -> None:
    assert same(stored(x, name, rounding), reference(x, name, rounding))


@pytest.mark.parametrize("name", LAYOUT)
@given(x=st.floats(width=32))
def test_any_float32(name: str, x: float) -> None:
    assert same(stored(x, name, "nearest", np.float32), reference(x, name, "nearest"))
    assert same(stored(x, name, "truncate", np.float32), reference(x, name, "truncate"))


@given(x=st.floats(-65519.99, 65519.99))
def test_half_agrees_with_struct(x: float) -> None:
    """The interpreter's own half-precision conversion, which rounds to nearest."""
    assert same(store(np.array(x), "float16"), struct.unpack("e", struct.pack("e", x))[0])


@pytest.mark.parametrize("dtype", TYPES)
@pytest.mark.parametrize("rounding", ROUNDINGS)
def test_every_half_is_kept(rounding: str, dtype: Any) -> None:
    with np.errstate(invalid="ignore"):  # signalling NaNs among them
        halves = np.arange(65536, dtype=np.uint16).view(np.float16).astype(dtype)
    assert same(store(halves, "float16", rounding=rounding), halves)


@pytest.mark.parametrize(("value", "nearest", "truncate"), [
    (65504.0, 65504.0, 65504.0),
    (65519.99, 65504.0, 65504.0),
    (65520.0, math.inf, 65504.0),
    (-1e300, -math.inf, -65504.0),
    (math.inf, math.inf, math.inf),
    (2.0**-25, 0.0, 0.0),  # half the smallest denormal: to even
    (1.5 * 2.0**-24, 2.0**-23, 2.0**-24),
    (1 + 2.0**-11, 1.0, 1.0),  # half-way, to even
    (1 + 3 * 2.0**-11, 1 + 2.0**-9, 1 + 2.0**-10),
])
def test_half_by_hand(value: float, nearest: float, truncate: float) -> None:
    assert store(np.array(value), "float16") == nearest
    assert store(np.array(value), "float16", rounding="truncate") == truncate


@pytest.mark.parametrize("rounding", ROUNDINGS)
@pytest.mark.parametrize("name", LAYOUT)
@given(pair=st.tuples(st.floats(allow_nan=False), st.floats(allow_nan=False)))
def test_monotone_idempotent_and_close(name: str, rounding: str, pair: tuple[float, float]) -> None:
    low, high = stored([min(pair), max(pair)], name, rounding)
    assert low <= high
    assert same(stored(low, name, rounding), low)
    if rounding == "truncate":
        assert abs(low) <= abs(min(pair))
        assert abs(high) <= abs(max(pair))
    mantissa, smallest, largest = LAYOUT[name]
    x = max(pair)
    if 0 < x < 2.0**largest:
        spacing = Fraction(2) ** (max(math.frexp(x)[1] - 1, smallest) - mantissa)
        assert abs(Fraction(float(high)) - Fraction(x)) <= (spacing / 2 if rounding == "nearest" else spacing)


@pytest.mark.parametrize("dtype", TYPES)
def test_nothing_is_warned_of(dtype: Any) -> None:
    """A signalling NaN, denormals and overflow pass in silence (warnings are errors in this suite)."""
    bits = {np.float32: (np.uint32, 0x7F800001), np.float64: (np.uint64, 0x7FF0000000000001)}[dtype]
    info = np.finfo(dtype)
    signalling = np.array([bits[1]] * 3, bits[0]).view(dtype)
    with np.errstate(all="warn", under="ignore"):
        for name in FORMATS:
            for rounding in ROUNDINGS:
                got = store(signalling, name, rounding=rounding)
                assert np.isnan(got).all() if "unorm" not in name else (got == 0).all()
                store(np.array([info.max, info.smallest_subnormal, -np.inf], dtype), name, rounding=rounding)


def test_arguments_are_left_alone() -> None:
    array = np.array([1.1, -2.2, 3.3], np.float32)
    for name in FORMATS:
        result = store(array, name)
        result += 1
    np.testing.assert_array_equal(array, np.array([1.1, -2.2, 3.3], np.float32))


@pytest.mark.parametrize("name", FORMATS)
def test_shape_and_stride_do_not_matter(name: str) -> None:
    array = np.random.default_rng(1).lognormal(0, 4, (3, 4, 6)) * 0.1
    whole = store(array, name)
    np.testing.assert_array_equal(whole[..., ::2], store(array[..., ::2], name))
    np.testing.assert_array_equal(whole[:, 1, 1], store(array[:, 1, 1], name))
    wide = np.broadcast_to(array[:, :1, :1], array.shape)
    np.testing.assert_array_equal(store(wide, name), np.broadcast_to(whole[:, :1, :1], array.shape))


# --- R11G11B10F -------------------------------------------------------------------------------------


def small_float(code: int, mantissa: int) -> float:
    """One channel from its bits, as EXT_packed_float defines it."""
    exponent, fraction = code >> mantissa, code & ((1 << mantissa) - 1)
    if exponent == 31:
        return math.nan if fraction else math.inf
    if exponent == 0:
        return math.ldexp(fraction, -14 - mantissa)
    return math.ldexp(1 + fraction / (1 << mantissa), exponent - 15)


@pytest.mark.parametrize(("channel", "mantissa", "shift"), [(0, 6, 0), (1, 6, 11), (2, 5, 22)])
def test_every_code_of_each_channel(channel: int, mantissa: int, shift: int) -> None:
    codes = np.arange(1 << (5 + mantissa), dtype=np.uint32)
    decoded = decode_r11g11b10f(codes << np.uint32(shift), dtype=np.float64)
    want = [small_float(int(code), mantissa) for code in codes]
    assert same(decoded[channel], want)
    assert same(np.delete(decoded, channel, axis=0), np.zeros((2, codes.size)))
    for rounding in ROUNDINGS:
        again = encode_r11g11b10f(decoded, rounding=rounding)
        quiet = np.uint32((0x3F << (mantissa - 1)) << shift)
        np.testing.assert_array_equal(again, np.where(np.isnan(want), quiet, codes << np.uint32(shift)))
        assert same(store(decoded, "r11g11b10f", rounding=rounding), decoded)


@pytest.mark.parametrize("rounding", ROUNDINGS)
def test_range_of_r11g11b10f(rounding: str) -> None:
    """The rules of EXT_packed_float; the numbers are its own."""
    values = np.array([1.0, -1.0, 1e6, 65025.0, 64513.0, np.inf, -np.inf, np.nan, -np.nan, -0.0])
    got = store(np.stack([values] * 3), "r11g11b10f", rounding=rounding)
    red = [1.0, 0.0, 65024.0, 65024.0, 64512.0, np.inf, 0.0, np.nan, np.nan, 0.0]
    blue = [1.0, 0.0, 64512.0, 64512.0, 64512.0, np.inf, 0.0, np.nan, np.nan, 0.0]
    assert same(got, [red, red, blue])


@given(words=st.lists(st.floats(0, 1e5), min_size=3, max_size=3), rounding=st.sampled_from(ROUNDINGS))
def test_encode_then_decode_is_store(words: list[float], rounding: str) -> None:
    colour = np.array(words)
    packed = encode_r11g11b10f(colour, rounding=rounding)
    assert packed.dtype == np.uint32
    assert same(decode_r11g11b10f(packed), store(colour, "r11g11b10f", rounding=rounding))


# --- UNORM --------------------------------------------------------------------------------------------


def nearest_code(x: float, bits: int) -> int:
    if math.isnan(x) or x <= 0:
        return 0
    return math.floor(Fraction(min(x, 1.0)) * ((1 << bits) - 1) + Fraction(1, 2))


@pytest.mark.parametrize("dtype", TYPES)
@pytest.mark.parametrize("bits", [8, 16])
def test_unorm_beside_every_threshold(bits: int, dtype: Any) -> None:
    """The float next to each half-way point, and its neighbours on both sides."""
    scale = (1 << bits) - 1
    codes = range(0, scale, 1 if bits == 8 else 37)
    middle = np.array([float(Fraction(2 * code + 1, 2 * scale)) for code in codes], dtype)
    values = np.concatenate([middle, np.nextafter(middle, dtype(0)), np.nextafter(middle, dtype(1))])
    want = [nearest_code(float(value), bits) for value in values]
    np.testing.assert_array_equal(encode_unorm(values, bits=bits), want)


@pytest.mark.parametrize("bits", [8, 16])
@given(x=st.floats())
def test_unorm_of_any_double(bits: int, x: float) -> None:
    code = encode_unorm(np.array(x), bits=bits)
    assert code == nearest_code(x, bits)
    scale = (1 << bits) - 1
    assert store(np.array(x), f"unorm{bits}") == float(Fraction(int(code), scale))


@pytest.mark.parametrize("dtype", TYPES)
@pytest.mark.parametrize("bits", [8, 16])
def test_every_unorm_code_is_kept(bits: int, dtype: Any) -> None:
    integer = np.uint8 if bits == 8 else np.uint16
    codes = np.arange(1 << bits).astype(integer)
    decoded = decode_unorm(codes, dtype=dtype)
    assert decoded.dtype == dtype
    again = encode_unorm(decoded, bits=bits)
    assert again.dtype == integer
    np.testing.assert_array_equal(again, codes)
    assert same(store(decoded, f"unorm{bits}", rounding="truncate"), decoded)


# --- faults -----------------------------------------------------------------------------------------


# --- series -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("dtype", TYPES)
def test_series_too_large_keep_their_shape(dtype: Any) -> None:
    shape = np.array([1.0, -0.5, 0.25, 0.0], dtype)[:, np.newaxis]
    sizes = np.array([1e-3, 7.0, 65504.0, 65505.0, 1e9, 1e30], dtype)
    got = store_series(shape * sizes, "float16")
    assert got.dtype == dtype
    assert same(got[:, :3], store((shape * sizes)[:, :3], "float16"))  # what fits is stored as ever
    assert same(got[:, 3:], np.broadcast_to(65504.0 * shape, (4, 3)).astype(dtype))
    assert same(store_series((shape * sizes).T.copy(), "float16", axis=1), got.T.copy())
    assert store_series(shape, None) is shape


def test_the_largest_of_a_series_may_be_negative_and_any() -> None:
    got = store_series(np.array([65504.0, -1310080.0]), "float16")
    assert got.tolist() == [3276.0, -65504.0]  # 65504/20 = 3275.2, whose neighbours are 2 apart


ONE = np.ones(3)


@pytest.mark.parametrize(("call", "message"), [
    (lambda: store(ONE, "flaot16"), "format: is 'flaot16'; did you mean 'float16'?"),
    (lambda: store(ONE, "float16", rounding="truncat"),
     "rounding: is 'truncat'; did you mean 'truncate'?"),
    (lambda: store(np.ones(3, int), "float16"), "array: has type int64, must be float32 or float64"),
    (lambda: store(np.ones(3, ">f8"), "float16"), "array: has type >f8, must be float32 or float64"),
    (lambda: store(np.ones((4, 2)), "r11g11b10f"),
     "array: has shape (4, 2), must be (3, …) for r11g11b10f"),
    (lambda: store_series(ONE, "unorm8"), "format: is 'unorm8'; known: float16, float32"),
    (lambda: encode_unorm(ONE, bits=10), "bits: is 10, must be 8 or 16"),
    (lambda: decode_unorm(np.zeros(1, np.uint32)), "codes: has type uint32, must be uint8 or uint16"),
])
def test_faults_are_one_line(call: Any, message: str) -> None:
    with pytest.raises(InputError) as caught:
        call()
    assert str(caught.value) == message
