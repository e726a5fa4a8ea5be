"""Phase functions: normalised, mirrored, and right to 8 ε for every g and every angle."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
import reference_phase as reference
from hypothesis import example, given
from hypothesis import strategies as st
from mpmath import mp, mpf

from froxel_ref import settings as settings_module
from froxel_ref.phase import (
    PHASE,
    cornette_shanks,
    henyey_greenstein,
    isotropic,
    phase,
    rayleigh,
    schlick,
    two_lobe_henyey_greenstein,
    versine,
)
from froxel_ref.records import InputError
from froxel_ref.settings import SecondLobe

TYPES = (np.float32, np.float64)
NAMES = ("isotropic", "rayleigh", "henyey_greenstein", "schlick", "cornette_shanks")
LOBES = ("henyey_greenstein", "schlick", "cornette_shanks")
# Required. Worst of 4e6 random pairs each: Rayleigh 1.1, HG 3.9, Cornette-Shanks 4.7, Schlick 5.2 ε.
BOUND = 8.0


def error(got: Any, want: mpf, dtype: type[np.floating[Any]]) -> float:
    """Relative error in units of the type's ε."""
    assert np.isfinite(got)
    return float(abs(mpf(float(got)) - want) / (abs(want) * mpf(float(np.finfo(dtype).eps))))


def edge_anisotropies(dtype: type[np.floating[Any]]) -> list[float]:
    """g where something could go wrong: 0, ±1 and the fits' joints with their neighbours, tiny ones."""
    info = np.finfo(dtype)
    sizes = [0.0, info.smallest_subnormal, info.tiny, 1e-30, info.eps, 1e-3, 0.3, 0.5, 0.8, 0.99, 0.999999,
             1 - info.epsneg, 1 - 2 * info.epsneg]
    for joint in (0.5, 0.9, 0.93811745632330678):
        sizes += [np.nextafter(dtype(joint), dtype(0)), dtype(joint), np.nextafter(dtype(joint), dtype(1))]
    return [sign * float(dtype(size)) for size in sizes for sign in (1, -1)]


def edge_cosines(dtype: type[np.floating[Any]]) -> np.ndarray[Any, Any]:
    info = np.finfo(dtype)
    sizes = [0.0, info.smallest_subnormal, info.tiny, 1e-9, 0.25, np.nextafter(dtype(0.5), dtype(0)), 0.5,
             0.7, 0.999, 1 - info.epsneg, 1 - 2 * info.epsneg, 1.0]
    return np.array([sign * dtype(size) for size in sizes for sign in (1, -1)], dtype)


# --- a case by hand, closed forms ---------------------------------------------------------------------


@pytest.mark.parametrize(("name", "cosine", "g", "sphere_times"), [
    ("isotropic", 0.3, 0.9, 1.0),
    ("rayleigh", 1.0, 0.0, 1.5),
    ("rayleigh", 0.0, 0.0, 0.75),
    ("henyey_greenstein", 1.0, 0.5, 6.0),  # 0.75/0.5³
    ("henyey_greenstein", -1.0, 0.5, 2.0 / 9.0),  # 0.75/1.5³
    ("henyey_greenstein", -1.0, -0.5, 6.0),
    ("cornette_shanks", 1.0, 0.5, 8.0),  # 6·1.5·2/2.25
    ("cornette_shanks", 0.0, 0.0, 0.75),
    ("schlick", 0.0, 0.5, 0.5012109375),  # k = 0.70625, 1 − k²
])
def test_by_hand(name: str, cosine: float, g: float, sphere_times: float) -> None:
    assert PHASE[name](cosine, g) * 4 * math.pi == pytest.approx(sphere_times, rel=1e-14)


def test_table_has_the_names_of_the_settings() -> None:
    assert tuple(sorted(PHASE)) == tuple(sorted(settings_module.PHASE_FUNCTIONS))


@pytest.mark.parametrize("g", [-0.7, -0.2, 0.0, 0.4, 0.9])
def test_mean_cosine_of_henyey_greenstein_is_g(g: float) -> None:
    mu, weight = nodes()
    mu = math.copysign(1, g) * mu
    assert 2 * math.pi * np.sum(weight * mu * henyey_greenstein(mu, g)) == pytest.approx(g, abs=1e-12)


@pytest.mark.parametrize("dtype", TYPES)
def test_g_zero_is_isotropic_or_rayleigh(dtype: type[np.floating[Any]]) -> None:
    cosine = edge_cosines(dtype)
    eps = np.finfo(dtype).eps
    np.testing.assert_allclose(henyey_greenstein(cosine, dtype(0)), 1 / (4 * math.pi), rtol=2 * eps)
    np.testing.assert_allclose(schlick(cosine, dtype(0)), 1 / (4 * math.pi), rtol=4 * eps)
    np.testing.assert_allclose(cornette_shanks(cosine, dtype(0)), rayleigh(cosine), rtol=4 * eps)


# --- accuracy ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("dtype", TYPES)
@pytest.mark.parametrize("name", NAMES)
def test_accuracy_at_the_edges(name: str, dtype: type[np.floating[Any]]) -> None:
    """Every g of the list with every angle of the list: finite, and within 8 ε."""
    worst = 0.0
    with mp.workdps(reference.DIGITS):
        for g in edge_anisotropies(dtype):
            cosines = edge_cosines(dtype)
            got = np.broadcast_to(PHASE[name](cosines, dtype(g)), cosines.shape)
            assert got.dtype == dtype
            worst = max(worst, *(error(p, reference.REFERENCE[name](float(c), g), dtype)
                                 for c, p in zip(cosines, got, strict=True)))
    assert worst <= BOUND


@pytest.mark.parametrize("name", LOBES)
def test_accuracy_of_a_double_g_beside_float32(name: str) -> None:
    """A Python float g that float32 would round to 1 keeps its meaning, without overflow."""
    cosines = edge_cosines(np.float32)
    with mp.workdps(reference.DIGITS):
        worst = max(error(p, reference.REFERENCE[name](float(c), g), np.float32)
                    for g in edge_anisotropies(np.float64)
                    for c, p in zip(cosines, PHASE[name](cosines, g), strict=True))
    assert PHASE[name](cosines, 0.5).dtype == np.float32
    assert worst <= BOUND


@pytest.mark.parametrize("dtype", TYPES)
@pytest.mark.parametrize("name", NAMES)
@given(data=st.data())
def test_accuracy_anywhere(name: str, dtype: type[np.floating[Any]], data: st.DataObject) -> None:
    width = 32 if dtype is np.float32 else 64
    g = data.draw(st.floats(-1, 1, exclude_min=True, exclude_max=True, width=width))
    cosine = data.draw(st.floats(-1, 1, width=width))
    got = PHASE[name](np.array([cosine], dtype), np.array([g], dtype))
    with mp.workdps(reference.DIGITS):
        assert error(got[0], reference.REFERENCE[name](cosine, g), dtype) <= BOUND


@pytest.mark.parametrize("dtype", TYPES)
def test_accuracy_of_the_published_fit_where_it_is_positive(dtype: type[np.floating[Any]]) -> None:
    cosines = edge_cosines(dtype)
    with mp.workdps(reference.DIGITS):
        sizes = [g for g in edge_anisotropies(dtype) if abs(reference.fitted_k(g, "published")) < 1]
        assert max(sizes) > 0.9381  # up to the very root
        worst = max(error(p, reference.schlick(float(c), g, "published"), dtype)
                    for g in sizes
                    for c, p in zip(cosines, schlick(cosines, dtype(g), fit="published"), strict=True))
    assert worst <= BOUND


@pytest.mark.parametrize("dtype", TYPES)
@given(seed=st.integers(0, 2**32))
def test_versine_keeps_the_digits_that_a_cosine_loses(dtype: type[np.floating[Any]], seed: int) -> None:
    """With ½|V+L|² a lobe of g = 1 − 2⁻²⁰ is right at angles for which the cosine is already 1."""
    angle = 10.0 ** np.random.default_rng(seed).uniform(-12, -5)
    light = (dtype(math.sin(angle)), dtype(0), dtype(-math.cos(angle)))
    to_camera = (dtype(0), dtype(0), dtype(1))
    g = 1 - 2.0**-20
    turn = versine(to_camera, light)
    with mp.workdps(40):
        exact = (mpf(float(light[0])) ** 2 + (1 + mpf(float(light[2]))) ** 2) / 2
        want = reference.henyey_greenstein(1 - exact, g)
        assert error(turn, exact, dtype) <= 2
        assert error(henyey_greenstein(-light[2] * to_camera[2], g, versine=turn), want, dtype) <= BOUND + 3


def test_versine_of_a_square() -> None:
    """V and L at right angles: 1 − cos θ = 1; the same way: 2; opposite: 0."""
    camera = (np.array([1.0, 1.0, 1.0]), np.array([0.0]), np.array([0.0]))
    light = (np.array([0.0, 1.0, -1.0]), np.array([0.0]), np.array([[1.0, 0.0, 0.0]]))
    np.testing.assert_array_equal(versine(camera, light), [[1.0, 2.0, 0.0]])


def test_versine_is_used_forward_and_ignored_backward() -> None:
    assert henyey_greenstein(1.0, 0.5, versine=2.0) == henyey_greenstein(-1.0, 0.5)
    assert henyey_greenstein(1.0, -0.5, versine=2.0) == henyey_greenstein(1.0, -0.5)
    both = henyey_greenstein(np.array([0.3]), np.array([[0.5], [-0.5]]), versine=np.array([0.7]))
    np.testing.assert_array_equal(both[:, 0], [henyey_greenstein(0.3, 0.5), henyey_greenstein(0.3, -0.5)])


@pytest.mark.parametrize("name", ["henyey_greenstein", "cornette_shanks", "schlick"])
def test_a_backward_lobe_is_the_forward_one_mirrored(name: str) -> None:
    """p(c, −g; 1 + c) = p(−c, g; 1 − (−c)) to the last bit, also where 1 ± c has no digits left."""
    small = np.array([0.0, 1e-30, 1e-12, 1e-3])
    cosine = small - 1.0
    back = phase(name, cosine, -0.9999, mirrored_versine=small)
    np.testing.assert_array_equal(back, phase(name, -cosine, 0.9999, versine=small))
    assert len(set(back.tolist())) == 3
    both = phase(name, cosine, np.array([[0.5], [-0.9999]]), mirrored_versine=small)
    np.testing.assert_array_equal(both[1], back)
    np.testing.assert_array_equal(both[0], phase(name, cosine, 0.5, mirrored_versine=2 * small))


def test_a_mirrored_versine_reaches_the_second_lobe_and_the_other_sign() -> None:
    lobe, cosine, small = SecondLobe(phase_anisotropy=-0.999, weight=1.0), np.array([-1.0]), np.array([1e-9])
    got = two_lobe_henyey_greenstein(cosine, 0.5, mirrored_versine=small, second_lobe=lobe)
    np.testing.assert_array_equal(got, henyey_greenstein(cosine, -0.999, mirrored_versine=small))
    got = schlick(cosine, 0.999, mirrored_versine=small, sign="kosian")
    np.testing.assert_array_equal(got, schlick(-cosine, 0.999, versine=small))


# --- the sphere ---------------------------------------------------------------------------------------


def nodes() -> tuple[np.ndarray[Any, Any], np.ndarray[Any, Any]]:
    """Cosines and weights on [−1, 1], 40-point Gauss–Legendre on pieces that shrink towards cos θ = 1.

    The lobe's singularity lies (1 − g)²/2g beyond 1: pieces that halve keep all of it well outside.
    """
    x, w = np.polynomial.legendre.leggauss(40)
    ends = np.concatenate([[-1.0], 1.0 - 2.0 ** -np.arange(0.0, 25.0), [1.0]])
    half = np.diff(ends)[:, None] / 2
    return ((ends[:-1, None] + half) + half * x).ravel(), (half * w).ravel()


@pytest.mark.parametrize("g", [0.0, 1e-9, 0.1, 0.5, 0.9, 0.93, 0.94, 0.97, 0.99])
@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("sign", [1, -1])
def test_integral_over_the_sphere_is_one(name: str, g: float, sign: int) -> None:
    mu, weight = nodes()
    values = PHASE[name](sign * mu, sign * g)
    assert abs(2 * math.pi * np.sum(weight * values) - 1) < 1e-12


def test_the_quadrature_can_fail() -> None:
    mu, weight = nodes()
    assert abs(2 * math.pi * np.sum(weight * henyey_greenstein(mu, 0.9) * (1 + 1e-11)) - 1) > 1e-12


def test_integral_of_two_lobes_is_one() -> None:
    x, w = np.polynomial.legendre.leggauss(200)
    lobe = SecondLobe(phase_anisotropy=-0.6, weight=0.25)
    values = two_lobe_henyey_greenstein(x, 0.7, second_lobe=lobe)
    assert 2 * math.pi * np.sum(w * values) == pytest.approx(1, abs=1e-12)
    assert 2 * math.pi * np.sum(w * x * values) == pytest.approx(0.75 * 0.7 - 0.25 * 0.6, abs=1e-12)


# --- Schlick's fit (S1, D14) --------------------------------------------------------------------------


def test_published_fit_fails_where_the_docstring_says() -> None:
    peak = [schlick(1.0, g, fit="published") for g in (0.938, 0.9382, 0.97, 0.999)]
    assert peak[0] > 0 > max(peak[1:])
    # (1 + k)/(4π(1 − k)) with k = 1.00152985, from the printed cubic.
    assert peak[2] == pytest.approx(2.00152985 / (4 * math.pi * -0.00152985), rel=1e-12)
    # The pole is at cos θ = 1/k, inside [−1, 1].
    assert abs(schlick(1 / 1.00152985, 0.97, fit="published")) > 1e20


def test_fits_agree_up_to_the_knee() -> None:
    g = np.linspace(-0.8999, 0.8999, 101)[:, None]
    cosine = np.linspace(-1, 1, 21)
    np.testing.assert_array_equal(schlick(cosine, g), schlick(cosine, g, fit="published"))
    assert schlick(1.0, 0.92) != schlick(1.0, 0.92, fit="published")


def test_corrected_fit_is_steady() -> None:
    """The peak (1 + k)/(4π(1 − k)) grows with k: strictly monotone in g, through the knee, up to g → 1."""
    g = np.concatenate([np.linspace(-0.999, 0.999, 4001), 1 - 10.0 ** np.arange(-4, -16, -0.5)])
    assert (np.diff(schlick(1.0, g)) > 0).all()


def test_sign_of_kosian_is_the_opposite() -> None:
    cosine = np.linspace(-1, 1, 9)
    np.testing.assert_array_equal(schlick(cosine, 0.6, sign="kosian"), schlick(-cosine, 0.6))
    np.testing.assert_array_equal(
        schlick(cosine, 0.6, sign="kosian", versine=1 - cosine), schlick(-cosine, 0.6))
    k = 1.55 * 0.6 - 0.55 * 0.6**3
    printed = (1 - k * k) / (4 * math.pi * (1 + k * cosine) ** 2)
    np.testing.assert_allclose(schlick(cosine, 0.6, sign="kosian"), printed, rtol=1e-13)


# --- properties -------------------------------------------------------------------------------------


cosines = st.floats(-1, 1)
anisotropies = st.floats(-1, 1, exclude_min=True, exclude_max=True)


@pytest.mark.parametrize("name", NAMES)
@given(cosine=cosines, g=anisotropies)
@example(cosine=1.0, g=1 - 2.0**-53)
@example(cosine=-1.0, g=5e-324)
def test_positive_and_mirrored(name: str, cosine: float, g: float) -> None:
    value = PHASE[name](cosine, g)
    assert value > 0
    assert math.isfinite(value)
    assert value == PHASE[name](-cosine, -g)


@pytest.mark.parametrize("name", ["henyey_greenstein", "schlick"])
@given(cosine=st.tuples(cosines, cosines), g=st.floats(0, 1, exclude_max=True))
def test_falls_with_the_angle(name: str, cosine: tuple[float, float], g: float) -> None:
    """Each step of the evaluation is monotone, so the rounded function is too."""
    assert PHASE[name](min(cosine), g) <= PHASE[name](max(cosine), g)


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("dtype", TYPES)
def test_array_equals_scalars_bit_for_bit(name: str, dtype: type[np.floating[Any]]) -> None:
    """However g is broadcast, strided or cut into blocks; planning and threads rely on it."""
    random = np.random.default_rng(3)
    cosine = random.uniform(-1, 1, (5, 40)).astype(dtype)
    g = random.uniform(-1, 1, (5, 1)).astype(dtype)
    whole = np.broadcast_to(PHASE[name](cosine, g), cosine.shape)
    full = PHASE[name](cosine, np.repeat(g, 40, axis=1))
    np.testing.assert_array_equal(whole, np.broadcast_to(full, cosine.shape))
    np.testing.assert_array_equal(whole[:, ::3], np.broadcast_to(
        PHASE[name](cosine[:, ::3], g), cosine[:, ::3].shape))
    single = [[PHASE[name](c, row[0]) for c in line] for line, row in zip(cosine, g, strict=True)]
    np.testing.assert_array_equal(whole, np.array(single, dtype))


@pytest.mark.parametrize("name", NAMES)
def test_arguments_are_left_alone(name: str) -> None:
    cosine, g, turn = np.array([0.5, -0.5]), np.array([0.3, -0.3]), np.array([0.5, 1.5])
    before = [a.copy() for a in (cosine, g, turn)]
    PHASE[name](cosine, g, versine=turn)
    for array, old in zip((cosine, g, turn), before, strict=True):
        np.testing.assert_array_equal(array, old)


def test_axes_carry_only_what_varies() -> None:
    assert isotropic(np.zeros((4, 1, 3), np.float32)).shape == (1, 1, 1)
    assert henyey_greenstein(np.zeros((1, 4, 3)), np.zeros((5, 1, 1))).shape == (5, 4, 3)


@pytest.mark.parametrize("name", LOBES)
@pytest.mark.parametrize("dtype", TYPES)
def test_rounding_beyond_the_range_is_harmless(name: str, dtype: type[np.floating[Any]]) -> None:
    """A dot product may exceed 1 by an ulp, and float32 may round a valid g to 1."""
    above = np.nextafter(dtype(1), dtype(2))
    assert PHASE[name](above, dtype(0.9999999)) == pytest.approx(PHASE[name](dtype(1), dtype(0.9999999)))
    for sign in (1, -1):
        value = PHASE[name](dtype(sign), dtype(sign))
        assert value == PHASE[name](dtype(sign), dtype(sign * (1 - np.finfo(dtype).epsneg)))


def test_nan_stays_nan() -> None:
    assert np.isnan(henyey_greenstein(np.nan, 0.5))
    assert np.isnan(henyey_greenstein(0.5, np.nan))


# --- by name, faults ----------------------------------------------------------------------------------


@pytest.mark.parametrize("name", [*NAMES, "two_lobe_henyey_greenstein"])
def test_by_name(name: str) -> None:
    cosine = np.array([-0.3, 0.8])
    got = phase(name, cosine, 0.4, versine=1 - cosine)
    np.testing.assert_array_equal(got, PHASE[name](cosine, 0.4, versine=1 - cosine))


def test_second_lobe_by_name() -> None:
    lobe = SecondLobe(phase_anisotropy=-0.5, weight=0.2)
    with mp.workdps(40):
        want = reference.two_lobe(0.3, 0.7, -0.5, 0.2)
        got = phase("two_lobe_henyey_greenstein", 0.3, 0.7, second_lobe=lobe)
        assert error(got, want, np.float64) <= BOUND


@pytest.mark.parametrize(("call", "message"), [
    (lambda: phase("raleigh", 0.0, 0.0), "phase_function: is 'raleigh'; did you mean 'rayleigh'?"),
    (lambda: henyey_greenstein(0.0, 1.5), "g: is 1.5 in size, must be below 1"),
    (lambda: cornette_shanks(0.0, np.array([0.1, -2.0])), "g: is 2 in size, must be below 1"),
    (lambda: schlick(0.0, 0.1, fit="publisht"), "fit: is 'publisht'; did you mean 'published'?"),
    (lambda: schlick(0.0, 0.1, sign="Kosian"), "sign: is 'Kosian'; did you mean 'kosian'?"),
])
def test_faults_are_one_line(call: Any, message: str) -> None:
    with pytest.raises(InputError) as caught:
        call()
    assert str(caught.value) == message
