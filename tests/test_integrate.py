"""Slice integration: the slice rules one by one, whole columns, and what must hold whatever the medium."""

from __future__ import annotations

import itertools
import math

import mpmath
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from reference_integrate import exact_column, exact_slice, ulps

from froxel_ref.integrate import DEGREES, INTEGRATORS, Integrated, integrate, slice_integral
from froxel_ref.records import InputError
from froxel_ref.settings import SWITCHES

DTYPES = (np.float64, np.float32)
EPS = 2.0**-52


def column(source, extinction, boundaries, **options):
    """Radiance and transmittance along one column of mono media, from the near boundary unless told."""
    options = {"integrate_from": "near"} | options
    boundaries = np.asarray(boundaries, float)
    fog = integrate(np.broadcast_to(np.asarray(source, float), (3, len(boundaries) - 1))[..., None, None],
                    np.broadcast_to(np.asarray(extinction, float), len(boundaries) - 1)[:, None, None],
                    np.diff(boundaries)[:, None, None], np.ones((1, 1)), near=boundaries[0], **options)
    fields = fog.radiance[0, :, 0, 0], fog.transmittance[:, 0, 0]
    return [np.broadcast_to(field, len(boundaries) - 1) for field in fields]


def exponential(count, near=0.5, far=64.0):
    """Slice boundaries, and the sample of each slice at its geometric middle."""
    s = np.arange(2 * count + 1) / (2 * count)
    z = near * np.exp(np.log(far / near) * s)
    return z[::2], z[1::2]


def same_bits(a: Integrated, b: Integrated) -> bool:
    return all(np.array_equal(*np.broadcast_arrays(p, q)) for p, q in zip(a, b, strict=True))


# --- one slice --------------------------------------------------------------------------------------


# By hand, from e⁻¹ = 0.36787944117144233: 3·(1 − e⁻¹)/½; vacuum 3·2; an opaque slice 3/4e3.
@pytest.mark.parametrize(("extinction", "integral", "transmittance"), [
    (0.5, 3.792723352971346, 0.36787944117144233), (0.0, 6.0, 1.0), (4e3, 7.5e-4, 0.0)])
def test_analytic_by_hand(extinction, integral, transmittance):
    got = slice_integral(np.float64(3.0), np.float64(extinction), np.float64(2.0))
    assert got == pytest.approx((integral, transmittance), rel=1e-15, abs=0.0)


# The shader's lines by hand: σ is at least 1e-5 in both; "simple" leaves the light as it is (no length).
@pytest.mark.parametrize(("name", "extinction", "integral", "transmittance"), [
    ("published", 0.5, 3.792723352971346, 0.36787944117144233),
    ("published", 0.0, 5.99994000040000, 0.99998000020000),
    ("simple", 0.5, 3.0, 0.36787944117144233), ("simple", 0.0, 3.0, 0.99998000020000)])
def test_shader_rules_by_hand(name, extinction, integral, transmittance):
    got = slice_integral(np.float64(3.0), np.float64(extinction), np.float64(2.0), integrator=name)
    assert got == pytest.approx((integral, transmittance), rel=2e-11)  # (1 − T)/1e-5 keeps 11 digits


DECADES = ("denormal", "tiny", "small", "middle", "dense", "opaque")


@pytest.mark.parametrize("dtype", DTYPES)
@pytest.mark.parametrize("decade", DECADES)
def test_analytic_within_4_ulp(decade, dtype):
    """The issue's bound, on the exact product of the given σ and d, from the least denormal to 1e30."""
    n, limits = 1200, np.finfo(dtype)
    edges = [float(limits.smallest_subnormal) * 2, float(limits.tiny), 1e-6, 0.1, 2.0, 50.0, 1e30]
    low, high = np.log(edges[DECADES.index(decade):][:2])
    random = np.random.default_rng(DECADES.index(decade))
    depth = np.exp(random.uniform(low, high, n))
    length = np.exp(random.uniform(math.log(1e-3), math.log(1e2), n)).astype(dtype)
    extinction, source = (depth / length).astype(dtype), random.uniform(0.1, 10.0, n).astype(dtype)
    integral, transmittance = slice_integral(source, extinction, length)
    assert integral.dtype == transmittance.dtype == dtype
    exact = [exact_slice(*inputs) for inputs in zip(source, extinction, length, strict=True)]
    assert max(ulps(got, e[0]) for got, e in zip(integral, exact, strict=True)) <= 4.0
    x = extinction.astype(float) * length if dtype is np.float64 else np.zeros(n)
    assert max(ulps(got, e[1]) / (1.0 + a) for got, e, a in zip(transmittance, exact, x, strict=True)) <= 1.0


EDGES = ((0.0, 1.0), (5e-324, 1.0), (5e-324, 1e300), (1e-310, 1e-2), (2.3e-308, 1.0), (1e300, 1e-3),
         (1e300, 1e300), (1.7e308, 1e2), (0.0, 5e307), (1e-16, 1.0), (1.0, 745.2), (3e305, 1.0), (3.0, 0.0))


@pytest.mark.parametrize(("extinction", "length"), EDGES)
def test_analytic_at_the_edges(extinction, length):
    """Denormal, absent and overflowing products, without a warning."""
    integral, transmittance = slice_integral(np.float64(2.0), np.float64(extinction), np.float64(length))
    exact = exact_slice(2.0, extinction, length)
    assert ulps(integral, exact[0]) <= 4.0
    assert ulps(transmittance, exact[1]) <= 1.0 + min(800.0, extinction * length / 2.0)


@pytest.mark.parametrize(("extinction", "length"), [(1e-45, 1.0), (1e-45, 1e30), (3e38, 1e30), (1e-40, 1e-3)])
def test_analytic_at_the_edges_of_float32(extinction, length):
    inputs = np.float32(2.0), np.float32(extinction), np.float32(length)
    for got, exact in zip(slice_integral(*inputs), exact_slice(*inputs), strict=True):
        assert ulps(got, exact) <= 1.0


@pytest.mark.parametrize("dtype", DTYPES)
def test_vacuum_is_exact(dtype):
    length = np.geomspace(1e-3, 1e3, 50).astype(dtype)
    integral, transmittance = slice_integral(dtype(0.3) + 0 * length, 0 * length, length)
    assert np.array_equal(integral, dtype(0.3) * length)
    assert np.array_equal(transmittance, np.ones(50))
    assert not slice_integral(0 * length, 0 * length, length)[0].any()


def test_published_form_dims_vacuum():
    """D3: over 64 m the clamp takes 1 − e^(−64e-5) = 6.4e-4 of what is behind; the analytic form nothing."""
    z = np.linspace(0.0, 64.0, 65)
    assert 1.0 - column(0.0, 0.0, z, integrator="published")[1][-1] == pytest.approx(6.398e-4, rel=1e-3)
    assert column(0.0, 0.0, z)[1][-1] == 1.0


@pytest.mark.parametrize("depth", [1e-3, 1e-4, 1e-5])
def test_published_form_loses_digits_in_float32(depth):
    """D3: S − S·T keeps only what of x = σd exceeds the rounding of 1 − x, 2⁻²⁵ on average over x."""
    length = np.linspace(0.5, 1.0, 2000, dtype=np.float32)
    inputs = np.ones_like(length), np.full_like(length, depth), length
    exact = -np.expm1(-np.float64(np.float32(depth)) * length) / np.float32(depth)
    analytic, published = (np.abs(slice_integral(*inputs, integrator=name)[0] / exact - 1.0).max()
                           for name in ("analytic", "published"))
    assert 2.0**-26 / depth < published < 2.0**-22 / depth
    assert analytic < 2.0**-23


def test_simple_form_depends_on_the_number_of_slices():
    """Its sum of unweighted samples doubles with the slices in thin fog, where the integral stays."""
    sums = [column(1.0, 1e-4, np.linspace(0.0, 1.0, n + 1), integrator="simple")[0][-1] for n in (32, 64)]
    assert sums[1] / sums[0] == pytest.approx(2.0, rel=1e-4)
    assert sums[1] == pytest.approx(64.0, rel=1e-4)


# --- whole columns ----------------------------------------------------------------------------------


def test_two_slices_by_hand():
    """T = ½ and ¼ by σ = ln 2; light 2·(1 − ½)/ln 2, then half of 4·(1 − ½)/ln 2 more."""
    light, through = column([[2.0, 4.0]], math.log(2.0), [0.0, 1.0, 2.0])
    assert light == pytest.approx([1.0 / math.log(2.0), 2.0 / math.log(2.0)], rel=1e-15)
    assert through == pytest.approx([0.5, 0.25], rel=1e-15)


def test_front_segment_has_the_medium_of_slice_0():
    """D6: from the camera, 1 m of slice 0's fog comes first; the published form starts behind it."""
    inputs = (np.full((3, 1, 1, 1), 2.0), np.array([math.log(2.0), 0.0]).reshape(2, 1, 1), np.ones((2, 1, 1)))
    whole = integrate(*inputs, np.ones((1, 1)), near=1.0)
    assert whole.front_transmittance == pytest.approx(np.array([[0.5]]), rel=1e-15)
    assert whole.front_radiance.ravel() == pytest.approx([1.0 / math.log(2.0)] * 3, rel=1e-15)
    assert whole.transmittance.ravel() == pytest.approx([0.25, 0.25], rel=1e-15)
    late = integrate(*inputs, np.ones((1, 1)), near=1.0, integrate_from="near")
    assert (late.front_radiance == 0.0).all()
    assert (late.front_transmittance == 1.0).all()
    assert late.transmittance.ravel() == pytest.approx([0.5, 0.5], rel=1e-15)


@pytest.mark.parametrize("sigma", [0.0, 1e-12, 0.03, 0.3])
def test_uniform_medium_equals_the_closed_form_at_every_froxel(sigma):
    """L = S·(1 − e^(−σr))/σ, T = e^(−σr) with r along the ray: within 4 ulp per slice, off-axis too.

    The front segment counts as a slice. The corner's path is 134 m, so at σ = 0.3 the mean optical depth
    of a slice is 0.63, within what `integrate` asks for.
    """
    z = exponential(64)[0]
    across, down = np.linspace(-1.6, 1.6, 8), np.linspace(-0.9, 0.9, 5)
    ray = np.sqrt(1.0 + across**2 + down[:, None]**2)
    fog = integrate(np.full((3, 1, 1, 1), 0.7), np.full((1, 1, 1), sigma), np.diff(z)[:, None, None], ray,
                    near=z[0])
    light, through = (np.broadcast_to(field, (64, 5, 8)) for field in (fog.radiance[0], fog.transmittance))
    for k, j, i in itertools.product(range(0, 64, 3), range(5), range(8)):
        with mpmath.workdps(40):
            exact = exact_slice(0.7, sigma, mpmath.mpf(float(z[k + 1])) * mpmath.mpf(float(ray[j, i])))
        assert ulps(light[k, j, i], exact[0]) <= 4.0 * (k + 2)
        assert ulps(through[k, j, i], exact[1]) <= 4.0 * (k + 2)


@pytest.mark.parametrize("contrast", [1.0, 1e12])
def test_column_equals_the_40_digit_sum(contrast):
    """Random media, neighbouring slices up to 1e12 apart in light and in extinction."""
    random = np.random.default_rng(7)
    spread = 0.5 * math.log(contrast) + 1.0
    source = np.exp(random.uniform(-spread, spread, 24))
    extinction = np.exp(random.uniform(-2.0 * spread, 0.0, 24)) * 3.0
    z = exponential(24, 0.5, 8.0)[0]
    got = column(source[None], extinction, z)
    exact = exact_column(source, extinction, np.diff(z))
    for values, wanted in zip(got, exact, strict=True):
        errors = np.array([ulps(value, w) for value, w in zip(values, wanted, strict=True)])
        assert (errors <= 4.0 * np.arange(1, 25)).all()


def test_4096_slices():
    """Rounding adds up no faster than 4 ulp a slice; measured here: 0.04 in all."""
    z = exponential(4096)[0]
    light, through = column(1.0, 0.05, z)
    path = z[1:] - z[0]
    bound = 4.0 * EPS * np.arange(1, 4097)
    assert (np.abs(light / (-np.expm1(-0.05 * path) / 0.05) - 1.0) <= bound).all()
    assert (np.abs(through / np.exp(-0.05 * path) - 1.0) <= bound).all()


# σ = σ₀u and S = S₀u² with u = e^(−βs) along a slanted ray through exponential height fog. With κ = σ₀/β
# T = e^(−κ(1−u)) and L = S₀/β·∫ᵤ¹ v·e^(−κ(1−v)) dv, where ∫ v·e^(κv) dv = (v/κ − 1/κ²)·e^(κv).
SIGMA, BETA, GLOW = 0.6, 0.12, 2.0


def height_fog_error(count, name):
    z, middle = exponential(count, 0.5, 32.0)
    u, kappa = np.exp(-BETA * middle), SIGMA / BETA
    light, through = column(GLOW * u[None]**2, SIGMA * u, z, integrator=name)
    front, back = math.exp(-BETA * z[0]), math.exp(-BETA * z[-1])
    exact_through = math.exp(-kappa * (front - back))
    # Transmittance is counted from the near boundary, so e^(−κ·front) is divided out.
    primitive = [(v / kappa - 1.0 / kappa**2) * math.exp(kappa * (v - front)) for v in (back, front)]
    exact_light = GLOW / BETA * (primitive[1] - primitive[0])
    return abs(light[-1] / exact_light - 1.0), abs(through[-1] / exact_through - 1.0)


@pytest.mark.parametrize("name", ["analytic", "published"])
def test_second_order_for_smooth_media(name):
    """Fitted slope of log error against log slice depth, exponential slices sampled at the middle: 2."""
    counts = np.array([32, 64, 128, 256, 512])
    errors = np.array([height_fog_error(count, name) for count in counts])
    slopes = -np.polyfit(np.log(counts), np.log(errors), 1)[0]
    assert slopes == pytest.approx([2.0, 2.0], abs=0.05)
    assert errors[1].max() < 5e-3


def test_simple_form_does_not_converge():
    assert height_fog_error(512, "simple")[0] > 1.0


# --- whatever the medium ----------------------------------------------------------------------------

SLICE = st.tuples(st.floats(0.0, 1e3), st.floats(0.0, 5.0), st.floats(0.01, 4.0))
MEDIA = st.lists(SLICE, min_size=2, max_size=8)


def parts(media):
    source, extinction, step = (np.array(column) for column in zip(*media, strict=True))
    return source, extinction, np.concatenate([[0.0], np.cumsum(step)])


@given(MEDIA)
def test_transmittance_falls_from_1_and_light_rises(media):
    light, through = column(*parts(media))
    assert (through <= 1.0).all()
    assert (through >= 0.0).all()
    assert (np.diff(through) <= 0.0).all()
    assert (np.diff(light) >= 0.0).all()


@given(MEDIA, st.integers(1, 7))
def test_transmittance_multiplies_along_the_ray(media, cut):
    source, extinction, z = parts(media)
    cut = min(cut, len(source) - 1)
    whole = column(source, extinction, z)
    near, far = (column(source[part], extinction[part], z[part.start:part.stop + 1])
                 for part in (slice(0, cut), slice(cut, len(source))))
    # Only the order of the products differs: 2 roundings a slice at most.
    assert near[1][-1] * far[1][-1] == pytest.approx(whole[1][-1], rel=16 * EPS, abs=0.0)
    assert near[0][-1] + near[1][-1] * far[0][-1] == pytest.approx(whole[0][-1], rel=40 * EPS, abs=1e-300)


@given(MEDIA)
def test_splitting_slices_changes_only_rounding(media):
    source, extinction, z = parts(media)
    halves = np.sort(np.concatenate([z, 0.5 * (z[1:] + z[:-1])]))
    whole, split = column(source, extinction, z), column(source.repeat(2), extinction.repeat(2), halves)
    for a, b in zip(whole, split, strict=True):
        # Halving rounds x by up to x ulp (x ≤ 20 a slice), then 4 ulp for each of 8 + 16 slices.
        assert b[1::2] == pytest.approx(a, rel=300 * EPS, abs=1e-300)


@given(MEDIA, st.floats(1e-3, 1e3))
def test_lengths_times_k_and_extinction_over_k_change_nothing(media, k):
    """Radiance stays when the world is scaled; S is a radiance per metre, so it is divided too."""
    source, extinction, z = parts(media)
    for a, b in zip(column(source, extinction, z), column(source / k, extinction / k, z * k), strict=True):
        assert b == pytest.approx(a, rel=400 * EPS, abs=1e-300)


@pytest.mark.parametrize("name", [name for name in INTEGRATORS if name not in DEGREES])
@given(MEDIA, st.floats(0.0, 10.0), st.floats(0.0, 10.0))
def test_linear_in_the_source(name, media, a, b):
    source, extinction, z = parts(media)
    other = source[::-1]
    first, second, both = (column(s, extinction, z, integrator=name)[0]
                           for s in (source, other, a * source + b * other))
    # The published form is off by up to 2⁻⁵²/1e-5/0.01 m = 2e-9 of each slice's light.
    bound = 1e-8 if name == "published" else 1e-13
    assert both == pytest.approx(a * first + b * second, rel=bound, abs=1e-300)


@given(MEDIA)
def test_light_never_exceeds_source_over_extinction(media):
    source, extinction, z = parts(media)
    extinction = extinction + 0.1
    light, through = column(source, extinction, z)
    most = (source / extinction).max()
    assert (light <= most * (1.0 - through) * (1 + 64 * EPS) + most * 64 * EPS).all()


# --- axes, blocks, threads --------------------------------------------------------------------------


def volume(dtype=np.float64, shape=(12, 7, 10)):
    random = np.random.default_rng(3)
    z = exponential(shape[0])[0].reshape(-1, 1, 1).astype(dtype)
    ray = random.uniform(1.0, 2.0, shape[1:]).astype(dtype)
    source, extinction = random.random((3, *shape)).astype(dtype), random.random(shape).astype(dtype)
    return source, extinction, np.diff(z, axis=0), ray


@pytest.mark.parametrize("name", INTEGRATORS)
@pytest.mark.parametrize("dtype", DTYPES)
def test_same_bits_whatever_blocks_and_threads(name, dtype, monkeypatch):
    inputs = volume(dtype)
    before = [a.copy() for a in inputs]
    whole = integrate(*inputs, near=0.5, integrator=name, threads=1)
    assert whole.radiance.dtype == whole.transmittance.dtype == whole.front_radiance.dtype == dtype
    assert same_bits(whole, integrate(*inputs, near=0.5, integrator=name, threads=3))
    monkeypatch.setattr("froxel_ref.integrate.BLOCK", 20)
    assert same_bits(whole, integrate(*inputs, near=0.5, integrator=name))
    assert all(np.array_equal(a, b) for a, b in zip(inputs, before, strict=True))


@pytest.mark.parametrize("axes", [(1, 1, 1), (12, 1, 1), (1, 7, 10), (12, 7, 1)])
def test_compact_axes_give_the_same_bits(axes):
    source, extinction, step, ray = volume()
    source = source[:, :axes[0], :axes[1], :axes[2]]
    extinction = extinction[:axes[0], :axes[1], :axes[2]]
    full = [np.broadcast_to(a, (*a.shape[:-3], 12, 7, 10)).copy() for a in (source, extinction)]
    compact = integrate(source, extinction, step, ray, near=0.5)
    assert same_bits(compact, integrate(*full, step, ray, near=0.5))


def test_one_extinction_per_colour():
    source, extinction, step, ray = volume()
    colours = np.stack([extinction, 2.0 * extinction, 0.0 * extinction])
    fog = integrate(source, colours, step, ray, near=0.5)
    assert fog.transmittance.shape == (3, 12, 7, 10)
    for channel, single in enumerate(colours):
        one = integrate(source, single, step, ray, near=0.5)
        assert np.array_equal(fog.radiance[channel], one.radiance[channel])
        assert np.array_equal(*np.broadcast_arrays(fog.transmittance[channel], one.transmittance))
        assert np.array_equal(*np.broadcast_arrays(fog.front_transmittance[channel], one.front_transmittance))


@pytest.mark.parametrize(("lit", "hazy"), [(False, False), (False, True), (True, False), (True, True)])
def test_constant_fields_stay_one_texel(lit, hazy):
    source, extinction, step, ray = volume()
    fog = integrate(source * lit, extinction * hazy, step, ray, near=0.5)
    shapes = {name: field.shape for name, field in fog._asdict().items()}
    assert shapes == {
        "radiance": (3, 12, 7, 10) if lit else (3, 1, 1, 1),
        "transmittance": (12, 7, 10) if hazy else (1, 1, 1),
        "front_radiance": (3, 7, 10) if lit else (3, 1, 1),
        "front_transmittance": (7, 10) if hazy else (1, 1)}
    # A trace of the missing field forces all of it to be written out, and must change nothing else.
    forced = integrate(source * lit + 1e-300, extinction * hazy + 5e-324, step, ray, near=0.5)
    assert forced.radiance.shape == (3, 12, 7, 10)
    assert np.array_equal(*np.broadcast_arrays(fog.transmittance, forced.transmittance))
    assert np.allclose(fog.radiance, forced.radiance, rtol=1e-15, atol=1e-290)


def test_clamped_vacuum_is_written_out():
    """The published form dims vacuum, along the ray: there is nothing to leave out."""
    source, extinction, step, ray = volume()
    fog = integrate(source, 0.0 * extinction, step, ray, integrator="published", integrate_from="near")
    assert fog.transmittance[-1] == pytest.approx(np.exp(-1e-5 * step.sum() * ray), rel=1e-14)


def test_switches_are_the_words_of_the_settings():
    assert set(INTEGRATORS) == set(SWITCHES["integrator"])


@pytest.mark.parametrize("option", [{"integrator": "analitic"}, {"integrate_from": "far"}])
def test_unknown_words_are_refused(option):
    with pytest.raises(InputError, match=r"analytic|'near'"):
        integrate(*volume(), **option)


def test_whole_numbers_and_plain_ones_are_what_they_say() -> None:
    """3·(1 − e^(−2))/1 and e^(−2), whatever the numbers are written as; float32 arrays stay float32."""
    light, through = slice_integral(3, 1, 2)
    assert (float(light), float(through)) == pytest.approx((3 * (1 - math.exp(-2)), math.exp(-2)), rel=4e-16)
    mixed = slice_integral(np.float32([3.0]), np.float32([1.0]), 2.0)
    assert [part.dtype for part in mixed] == [np.float32, np.float32]
