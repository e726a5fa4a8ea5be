"""Norms: each by hand, and each on data that must fail."""

from __future__ import annotations

import math
import struct

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from froxel_ref import compare
from froxel_ref.compare import INCOMPARABLE, maximum, order, quantile, ulp_distance
from froxel_ref.records import InputError

NAN, INF = math.nan, math.inf
# Every norm as f(result, expected); those that cannot see a permutation are marked in the tests.
NORMS = {
    "absolute": compare.absolute,
    "relative": compare.relative,
    "relative_mse": compare.relative_mse,
    "bias": compare.bias,
    "bias, share": lambda a, b: compare.bias(a, b, share=True),
    **{f"quantile, {m}": (lambda a, b, m=m: quantile(a, b, 1.0, measure=m)) for m in compare.MEASURES},
    **{f"maximum, {m}": (lambda a, b, m=m: maximum(a, b, measure=m)) for m in compare.MEASURES},
}
every_norm = pytest.mark.parametrize("norm", NORMS.values(), ids=NORMS)
EXPECTED = np.array([[0.25, 1.0, 4.0], [0.5, 2.0, 8.0]])


# --- by hand ----------------------------------------------------------------------------------------


# Errors +0.25 and −1 among six: mean |e| = 1.25/6, mean e = −0.75/6, relative 1 and 0.5.
@pytest.mark.parametrize(("name", "value"), [
    ("absolute", 1.25 / 6), ("relative", 1.5 / 6), ("bias", -0.75 / 6), ("bias, share", -0.75 / 15.75),
    ("relative_mse", (0.0625 / 0.0725 + 1.0 / 4.01) / 6), ("quantile, absolute", 1.0),
    ("quantile, relative", 1.0), ("maximum, absolute", 1.0), ("maximum, relative", 1.0)])
def test_by_hand(name, value):
    result = EXPECTED.copy()
    result[0, 0], result[1, 1] = 0.5, 1.0
    norm = NORMS[name](result, EXPECTED)
    assert norm.value == pytest.approx(value, rel=1e-14)
    assert (norm.pairs, norm.fault) == (6, "")
    assert norm.within(abs(value) * 1.01)
    assert not norm.within(abs(value) * 0.99)


def test_maximum_says_where():
    result = EXPECTED.copy()
    result[0, 0], result[1, 1] = 0.5, 1.0
    assert maximum(result, EXPECTED).place == (1, 1)
    assert maximum(result, EXPECTED, measure="relative").place == (0, 0)
    assert maximum(np.float32(2.0), np.float32(1.0)).place == ()


def test_quantiles_are_errors_that_occur():
    errors = np.array([3.0, 0.0, 1.0, 2.0])
    assert [quantile(errors, 0 * errors, s).value for s in (0.0, 0.25, 0.26, 0.5, 0.75, 0.9, 1.0)] == [
        0.0, 0.0, 1.0, 1.0, 2.0, 3.0, 3.0]


def test_relative_mse_states_and_uses_its_epsilon():
    loose, tight = (compare.relative_mse([0.1], [0.0], epsilon=e) for e in (1.0, 0.01))
    assert (loose.epsilon, tight.epsilon) == (1.0, 0.01)
    assert (loose.value, tight.value) == pytest.approx((0.01, 1.0))


def test_bias_cannot_see_what_cancels():
    """Its blind spot, so that nobody takes it alone for a verdict."""
    assert compare.bias(EXPECTED[::-1, ::-1], EXPECTED).value == 0.0
    assert compare.bias(EXPECTED + 0.5, EXPECTED).value == 0.5
    assert compare.bias(EXPECTED - 0.5, EXPECTED).value == -0.5


# --- data that must fail ----------------------------------------------------------------------------


@every_norm
def test_equal_arrays_are_within_0(norm):
    result = norm(EXPECTED, EXPECTED.copy())
    assert result.value == 0.0
    assert result.within(0.0)


@every_norm
@pytest.mark.parametrize("index", range(6))
def test_one_perturbed_element_fails(norm, index):
    """By a single ulp of one element."""
    wrong = EXPECTED.copy()
    wrong.flat[index] = np.nextafter(wrong.flat[index], INF)
    result = norm(wrong, EXPECTED)
    assert result.value > 0.0
    assert not result.within(0.0)


@pytest.mark.parametrize("name", [name for name in NORMS if "bias" not in name])  # bias cannot see it: above
@pytest.mark.parametrize("change", [np.fliplr, np.flipud, np.transpose])
def test_permuted_data_fails(name, change):
    norm, square = NORMS[name], np.arange(1.0, 17.0).reshape(4, 4)
    assert not norm(change(square), square).within(1e-6)


@every_norm
@pytest.mark.parametrize("fill", [0.0, -1.0])
def test_constant_data_fails(norm, fill):
    assert not norm(np.full_like(EXPECTED, fill), EXPECTED).within(1e-3)


@every_norm
@pytest.mark.parametrize(("got", "want", "says"), [
    (NAN, 1.0, "NaN instead of 1.0 at (1, 1)"), (1.0, NAN, "1.0 instead of NaN at (1, 1)"),
    (INF, 1.0, "inf instead of 1.0 at (1, 1)"), (1.0, -INF, "1.0 instead of -inf at (1, 1)"),
    (INF, -INF, "inf instead of -inf at (1, 1)"), (NAN, INF, "NaN instead of inf at (1, 1)"),
    (-INF, NAN, "-inf instead of NaN at (1, 1)")])
def test_what_is_not_finite_must_match_in_place_and_kind(norm, got, want, says):
    a, b = EXPECTED.copy(), EXPECTED.copy()
    a[1, 1], b[1, 1] = got, want
    result = norm(a, b)
    assert (result.fault, result.place) == (says, (1, 1))
    assert math.isnan(result.value)
    assert not result.within(INF)


@every_norm
def test_matching_nan_and_infinities_enter_no_mean(norm):
    a, b = EXPECTED.copy(), EXPECTED.copy()
    a[0, 1] += 0.5
    kept = norm(a, b)
    a, b = (np.concatenate([x.ravel(), [NAN, INF, -INF]]) for x in (a, b))
    result = norm(a, b)
    assert (result.value, result.pairs, result.fault) == (kept.value, 6, "")


@every_norm
def test_moved_nan_fails(norm):
    a, b = np.array([NAN, 1.0, 1.0, 1.0]), np.array([1.0, NAN, 1.0, 1.0])
    assert norm(a, b).fault == "NaN instead of 1.0 at (0,), the first of 2"


@every_norm
def test_nothing_but_nan_is_close_to_nothing_but_nan_only(norm):
    nothing = np.full(3, NAN)
    assert norm(nothing, nothing).within(0.0)
    assert norm(nothing, nothing).pairs == 0
    assert not norm(nothing, np.zeros(3)).within(INF)


@every_norm
@pytest.mark.parametrize(("wrong", "says"), [
    (EXPECTED.astype(np.float32), "has type float32"), (EXPECTED.astype(int), "has type int64"),
    (EXPECTED.astype(complex), "complex"), (EXPECTED[:, :2], "has shape (2, 2)"), (EXPECTED[None], "has shape"),
    (EXPECTED.ravel(), "has shape (6,)"), (EXPECTED[0, 0], "has shape ()")])
def test_another_type_or_shape_is_refused(norm, wrong, says):
    for arguments in ((wrong, EXPECTED), (EXPECTED, wrong)):
        with pytest.raises(InputError) as caught:
            norm(*arguments)
        assert "\n" not in str(caught.value)
        if arguments[0] is wrong:
            assert says in str(caught.value)


@every_norm
def test_empty_arrays_are_refused(norm):
    with pytest.raises(InputError, match="nothing to compare"):
        norm(np.empty((0, 3)), np.empty((0, 3)))


@pytest.mark.parametrize("name", [n for n in NORMS if "relative" in n and "mse" not in n])
def test_no_relative_error_where_0_is_expected(name):
    assert NORMS[name]([1.0, 0.0], [1.0, 0.0]).within(0.0)
    assert NORMS[name]([1.0, 5e-324], [1.0, 0.0]).fault == "5e-324 instead of 0.0 at (1,): no relative error"
    assert compare.bias([1.0], [0.0], share=True).fault


@every_norm
@pytest.mark.parametrize("scale", [1.7e308, 1e-320])
def test_neither_overflow_nor_underflow_hides_an_error(norm, scale):
    """Doubled numbers next to the largest, and among denormals, without a warning."""
    a, b = np.array([scale, scale, -scale]), np.array([scale, scale, -scale])
    assert norm(a, b).within(0.0)
    wrong = a / np.array([2.0, 1.0, 1.0])
    result = norm(wrong, b)
    if scale > 1.0 or norm is not NORMS["relative_mse"]:  # ε = 0.01 is meant to forgive 1e-320
        assert not result.within(0.0)
    assert not math.isnan(result.value)


def test_difference_beyond_all_numbers():
    norm = compare.absolute([1.7e308, 0.0, 0.0, 0.0], [-1.7e308, 0.0, 0.0, 0.0])
    assert norm.value == INF  # 3.4e308 is no float64
    assert not norm.within(1e308)
    assert compare.relative([1.7e308, 0.0], [-1.7e308, 0.0]).value == 1.0


@pytest.mark.parametrize("call", [
    lambda: quantile(EXPECTED, EXPECTED, 1.5), lambda: quantile(EXPECTED, EXPECTED, NAN),
    lambda: maximum(EXPECTED, EXPECTED, measure="upl"), lambda: quantile(EXPECTED, EXPECTED, 0.5, measure="x"),
    lambda: compare.relative_mse(EXPECTED, EXPECTED, epsilon=0.0),
    lambda: compare.relative_mse(EXPECTED, EXPECTED, epsilon=NAN)])
def test_bad_options_are_refused(call):
    with pytest.raises(InputError):
        call()


# --- ulp --------------------------------------------------------------------------------------------

TYPES = (np.float16, np.float32, np.float64)
CODES = {np.float16: ("<e", "<h"), np.float32: ("<f", "<i"), np.float64: ("<d", "<q")}


def rank(value, dtype):
    """A number's place in the order of its type, by Python's own integers."""
    real, whole = CODES[dtype]
    bits = struct.unpack(whole, struct.pack(real, float(value)))[0]
    return bits if bits >= 0 else -(bits & (2 ** (8 * struct.calcsize(whole) - 1) - 1))


@pytest.mark.parametrize("dtype", TYPES)
def test_ulp_distance_by_hand(dtype):
    limits = np.finfo(dtype)
    tiny, one = limits.smallest_subnormal, dtype(1)
    up = np.nextafter(one, dtype(2))
    pairs = [(one, one, 0), (one, up, 1), (up, one, 1), (dtype(0), dtype(-0.0), 0), (-tiny, tiny, 2),
             (dtype(-0.0), tiny, 1), (limits.tiny, np.nextafter(limits.tiny, dtype(0)), 1),
             (one, dtype(2), 2**limits.nmant), (-one, -up, 1)]
    a, b, wanted = zip(*pairs, strict=True)
    assert ulp_distance(np.array(a), np.array(b)).tolist() == list(wanted)


@pytest.mark.parametrize("dtype", TYPES)
def test_ulp_distance_of_what_is_not_finite(dtype):
    a = np.array([NAN, NAN, 1.0, INF, INF, INF, -INF, NAN], dtype)
    b = np.array([NAN, 1.0, NAN, INF, -INF, 1.0, -INF, INF], dtype)
    far = int(INCOMPARABLE)
    assert ulp_distance(a, b).tolist() == [0, far, far, 0, far, far, 0, far]
    negative_nan = np.copysign(np.array([NAN], dtype), dtype(-1))
    assert ulp_distance(negative_nan, np.array([NAN], dtype)).tolist() == [0]


@pytest.mark.parametrize("dtype", TYPES)
def test_the_longest_distance_fits_and_is_no_mark(dtype):
    most = np.array([np.finfo(dtype).max])
    wanted = 2 * rank(most[0], dtype)
    assert int(ulp_distance(most, -most)[0]) == wanted < int(INCOMPARABLE)


@pytest.mark.parametrize("dtype", TYPES)
@given(st.data())
def test_ulp_distance_counts_numbers(dtype, data):
    width = np.dtype(dtype).itemsize * 8
    finite = st.floats(allow_nan=False, allow_infinity=False, width=width)
    a, b = data.draw(finite), data.draw(finite)
    wanted = abs(rank(a, dtype) - rank(b, dtype))
    assert int(ulp_distance(np.array([a], dtype), np.array([b], dtype))[0]) == wanted


@given(arrays(np.float64, 5, elements=st.floats(-1e300, 1e300)), st.integers(0, 4), st.integers(1, 1000))
def test_steps_by_nextafter_are_counted(values, index, steps):
    moved = values.copy()
    for _ in range(steps):
        moved[index] = np.nextafter(moved[index], INF)
    distance = ulp_distance(moved, values)
    assert distance[index] == steps
    assert distance.sum() == steps
    assert maximum(moved, values, measure="ulp").place == (index,)


def test_ulp_distance_of_strided_and_scalar_input():
    values = np.arange(12.0).reshape(3, 4)[:, ::2]
    assert not ulp_distance(values, values.copy()).any()
    assert ulp_distance(np.float32(1.0), np.float32(1.0)).shape == ()


# --- order ------------------------------------------------------------------------------------------


@given(st.floats(-1.0, 8.0), st.floats(1e-6, 1e6))
def test_order_of_a_power_law(power, constant):
    h = 0.5 ** np.arange(2, 9)
    fit = order(h, constant * h**power)
    assert fit.order == pytest.approx(power, abs=1e-12)
    assert fit.constant == pytest.approx(constant, rel=1e-10)
    assert fit.residual < 1e-10


def test_the_residual_shows_scatter():
    """Errors alternately 10 % above and below the line: residual ln 1.1, and the slope stays near."""
    h = 0.5 ** np.arange(12)
    fit = order(h, h**2 * 1.1 ** np.tile([1.0, -1.0], 6))
    assert fit.residual == pytest.approx(math.log(1.1), rel=0.03)
    assert fit.order == pytest.approx(2.0, abs=0.03)
    floor = order(h, h**2 + 1e-4)  # a floor of the arithmetic must show, too
    assert floor.residual > 0.5


@pytest.mark.parametrize(("steps", "errors", "says"), [
    ([1.0, 0.5], [1.0, 0.0], "errors[1]"), ([1.0, 0.5], [NAN, 1.0], "errors[0]"), ([1.0, 0.5], [1.0, INF], "errors[1]"),
    ([1.0, 0.5], [1.0, -1.0], "errors[1]"), ([1.0, 0.0], [1.0, 1.0], "steps[1]"), ([1.0], [1.0], "two different"),
    ([1.0, 1.0], [1.0, 2.0], "two different"), ([], [], "two different"), ([1.0, 0.5], [1.0], "shape")])
def test_order_refuses_what_has_no_logarithm(steps, errors, says):
    with pytest.raises(InputError, match=says.replace("[", r"\[").replace("]", r"\]")):
        order(steps, errors)
