"""Higher orders: what profiles, the half step and the compensated march are worth, measured."""

from __future__ import annotations

import itertools
import math

import mpmath
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from reference_integrate import exact_column, exact_slice, ulps

from froxel_ref import stiffness
from froxel_ref.compare import order
from froxel_ref.integrate import DEGREES, INTEGRATORS, integrate, slice_integral
from froxel_ref.records import InputError
from froxel_ref.slice_profiles import Profile, profile, profile_integral

HIGHER = tuple(DEGREES)
EPS = 2.0**-52


def column(source, extinction, boundaries, **options):
    """Radiance and transmittance along one column, from the near boundary unless told."""
    count, boundaries = len(boundaries) - 1, np.asarray(boundaries, float)
    options = {"integrate_from": "near", "near": float(boundaries[0])} | options
    if "depths" in options:
        options["depths"] = np.reshape(options["depths"], (count, 1, 1))
    fog = integrate(np.broadcast_to(np.asarray(source, float), (3, count))[..., None, None],
                    np.broadcast_to(np.asarray(extinction, float), count)[:, None, None],
                    np.diff(boundaries)[:, None, None], np.ones((1, 1)), **options)
    return [np.broadcast_to(f, count) for f in (fog.radiance[0, :, 0, 0], fog.transmittance[:, 0, 0])]


# --- orders -----------------------------------------------------------------------------------------

# Height fog along a slanted ray: σ = σ₀u, S = S₀u², u = e^(−βz). With κ = σ₀/β, T = e^(−κ(u₀ − u)) and
# L = S₀/β·∫ᵤ^u₀ v·e^(−κ(u₀−v)) dv, whose primitive is (v/κ − 1/κ²)·e^(κv).
BETA, GLOW = 0.12, 2.0


def grid(count, spacing, near=0.5, far=32.0):
    s = np.arange(2 * count + 1) / (2 * count)
    z = near * (far / near) ** s if spacing == "exponential" else near + (far - near) * s
    return z[::2], z[1::2]


def fog_error(count, name, spacing="exponential", sigma=0.6, **options):
    z, middle = grid(count, spacing)
    u, kappa = np.exp(-BETA * middle), sigma / BETA
    light, through = column(GLOW * u**2, sigma * u, z, integrator=name, **({"depths": middle} | options))
    front = math.exp(-BETA * z[0])

    def exact(place):
        back = math.exp(-BETA * place)
        ends = [(v / kappa - 1.0 / kappa**2) * math.exp(kappa * (v - front)) for v in (back, front)]
        return GLOW / BETA * (ends[1] - ends[0]), math.exp(-kappa * (front - back))

    place = 0.5 * (z[-2] + z[-1]) if name == "half_step" else z[-1]  # its transmittance stands in the middle
    return abs(light[-1] / exact(z[-1])[0] - 1.0), abs(through[-1] / exact(place)[1] - 1.0)


@pytest.mark.parametrize("spacing", ["exponential", "linear"])
@pytest.mark.parametrize(("name", "wanted"), [("analytic", 2), ("half_step", 2), ("linear", 2), ("gauss", 4)])
def test_orders_for_smooth_media(name, wanted, spacing):
    """Slopes of the transmittance's error over three doublings, and a bound on the light's."""
    counts = np.array([48, 96, 192, 384])
    light, through = np.array([fog_error(count, name, spacing) for count in counts]).T
    fit = order(1.0 / counts, through)
    assert fit.order == pytest.approx(wanted, abs=0.2)
    assert fit.residual < 0.15
    # The light's errors along the ray partly cancel, so no slope can be fitted: they stay below the same law.
    assert (light < 10.0 * through).all()
    assert order(1.0 / counts, light).order > wanted - 0.7


def test_gauss_is_far_better_at_64_slices():
    errors = {name: max(fog_error(64, name)) for name in ("analytic", "half_step", "linear", "gauss")}
    assert errors["gauss"] < 0.1 * min(errors["analytic"], errors["half_step"], errors["linear"])


@pytest.mark.parametrize(("name", "wanted"), [("analytic", 1), ("linear", 2), ("gauss", 3)])
def test_orders_where_every_slice_is_opaque(name, wanted):
    """All light comes from the first slice's front, so it is the profile itself whose order shows.

    σ = 1e4 and S = σ·e^(−βz): the light is ∫ e^(−t − βt/σ) dt = 1/(1 + β/σ), at z = 0.
    """
    counts, errors = np.array([8, 16, 32, 64]), []
    for count in counts:
        z = np.linspace(0.0, 8.0, count + 1)
        light, _ = column(1e5 * np.exp(-0.3 * 0.5 * (z[1:] + z[:-1])), 1e5, z, integrator=name)
        errors.append(abs(light[-1] * (1.0 + 0.3 / 1e5) - 1.0))
    fit = order(1.0 / counts, errors)
    assert fit.order == pytest.approx(wanted, abs=0.2)
    assert fit.residual < 0.1


def test_samples_elsewhere_than_in_the_middle():
    """Jittered samples keep the order, if `depths` says where they are."""
    counts, errors = np.array([32, 64, 128]), []
    for count in counts:
        z = np.linspace(0.0, 20.0, count + 1)
        at = z[:-1] + 0.2 * np.diff(z)
        _, through = column(0.0, 0.1 * np.exp(-0.2 * at), z, integrator="gauss", depths=at)
        errors.append(abs(-math.log(through[-1]) / (0.5 * -math.expm1(-4.0)) - 1.0))
    assert order(1.0 / counts, errors).order > 2.8  # third: the errors of an uneven stencil do not cancel
    assert errors[-1] < 1e-5
    z = np.linspace(0.0, 20.0, 129)
    _, through = column(0.0, 0.1 * np.exp(-0.2 * (z[:-1] + 0.2 * 20 / 128)), z, integrator="gauss")
    assert abs(-math.log(through[-1]) / (0.5 * -math.expm1(-4.0)) - 1.0) > 1e-3  # told nothing, it cannot know


def test_a_linear_medium_is_integrated_exactly():
    """σ = 0.1 + 0.02z, S = 3 − 0.2z over 8 slices: both rules are exact, to rounding, by mpmath."""
    z = np.linspace(0.0, 8.0, 9)
    middle = 0.5 * (z[1:] + z[:-1])
    with mpmath.workdps(40):
        exact = mpmath.quad(lambda x: (3 - mpmath.mpf(2) / 10 * x) * mpmath.exp(-x / 10 - x * x / 100), [0, 4, 8])
        far = mpmath.exp(-mpmath.mpf(8) / 10 - mpmath.mpf(64) / 100)
    for name in HIGHER:
        light, through = column(3.0 - 0.2 * middle, 0.1 + 0.02 * middle, z, integrator=name)
        assert ulps(light[-1], exact) <= 16
        assert ulps(through[-1], far) <= 16


# --- one slice --------------------------------------------------------------------------------------


def shape(rng, degree):
    """A random profile that stays within [0, 2], by way of random neighbours up to a million apart."""
    centre = rng.uniform(0.2, 0.8)
    others = 10.0 ** rng.uniform(-3.0, 3.0, 2)
    return profile(np.ones(1), (others[:1], others[1:]), centre, (centre - 1.1, centre + 0.9), degree=degree)


def exact_profile(depth, light, medium):
    """∫₀¹ e^(−depth·∫₀ᵘ m) l(u) du and e^(−depth·∫₀¹ m) to 30 digits, by mpmath's own quadrature."""
    with mpmath.workdps(30):
        x, c, k = mpmath.mpf(depth), mpmath.mpf(medium.centre), mpmath.mpf(light.centre)
        (a, b), (p, q) = ((mpmath.mpf(float(v[0])) for v in s[:2]) for s in (medium, light))
        tau = lambda u: x * (u + a * ((u - c)**2 - c**2) / 2 + b * ((u - c)**3 + c**3) / 3)  # noqa: E731
        cuts = [0, *(mpmath.mpf(10)**-n for n in range(max(0, int(mpmath.log10(x + 1))) + 2, -1, -1))]
        glow = mpmath.quad(lambda u: mpmath.exp(-tau(u)) * (1 + p * (u - k) + q * (u - k)**2), cuts)
        return glow, mpmath.exp(-tau(1))


@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize("depth", [1e-300, 1e-8, 1e-3, 0.1, 1.0, 10.0, 45.0, 46.0, 300.0, 1e4])
def test_profile_integral_to_rounding(depth, degree):
    """Slopes and bends up to the limit, light and medium apart. A profile that
    begins near 0 is the difference of larger numbers: ε there is ε·√(45·depth) of the light."""
    rng = np.random.default_rng(int(abs(math.log10(depth))) + degree)
    for _ in range(4):
        light, medium = shape(rng, degree), shape(rng, degree)
        got = profile_integral(np.ones(1), np.array([depth]), np.ones(1), light, medium)
        exact = exact_profile(depth, light, medium)
        assert ulps(got[0][0], exact[0]) <= 8 + math.sqrt(depth)
        if exact[1] > 1e-300:
            assert ulps(got[1][0], exact[1]) <= 4 * (1.0 + depth)


def test_profile_integral_in_float32_is_rounded_once():
    rng = np.random.default_rng(3)
    for depth in (1e-6, 0.3, 5.0, 500.0):
        light, medium = shape(rng, 2), shape(rng, 2)
        depth = float(np.float32(depth))
        got = profile_integral(np.ones(1, np.float32), np.array([depth], np.float32), np.ones(1, np.float32),
                               light, medium)[0]
        assert got.dtype == np.float32
        assert ulps(got[0], exact_profile(depth, light, medium)[0]) <= 0.51


@pytest.mark.parametrize("depth", [0.0, 5e-324, 1e-310, 1e-20, 1e20, 1e300, 1.7e308])
def test_constant_profile_is_the_closed_form_at_the_edges(depth):
    flat = Profile(np.zeros(1), np.zeros(1), 0.5)
    got = profile_integral(np.full(1, 2.0), np.array([depth]), np.ones(1), flat, flat)
    exact = exact_slice(2.0, min(depth, 1e300), 1.0)
    assert ulps(got[0][0], exact[0]) <= 40
    assert ulps(got[1][0], exact[1]) <= 1


@given(st.floats(0.05, 0.95), *[st.floats(0.0, 1e300)] * 3, st.sampled_from([1, 2]))
def test_profiles_stay_within_0_and_2(centre, own, first, second, degree):
    values = [np.array([v]) for v in (own, first, second)]
    made = profile(values[0], (values[1], values[2]), centre, (centre - 1.0, centre + 1.3), degree=degree)
    u = np.linspace(0.0, 1.0, 101)
    s = 1.0 + made.slope * (u - centre) + made.bend * (u - centre) ** 2
    assert s.min() >= -8 * EPS
    assert s.max() <= 2.0 + 8 * EPS
    if own == 0.0:
        assert (s == 1.0).all()


def test_profile_by_hand():
    """Through 1, 2 and 4 at u = −½, ½ and 3/2, relative to 2: slope ¾, bend ¼; the line has the slope."""
    arguments = np.array([2.0]), (np.array([1.0]), np.array([4.0])), 0.5, (-0.5, 1.5)
    for degree, bend in ((1, 0.0), (2, 0.25)):
        made = profile(*arguments, degree=degree)
        assert (made.slope[0], made.bend[0]) == (0.75, bend)


def test_no_nodes_are_refused():
    flat = Profile(np.zeros(1), np.zeros(1), 0.5)
    with pytest.raises(InputError, match="nodes: is 0"):
        profile_integral(np.ones(1), np.ones(1), np.ones(1), flat, flat, nodes=0)


# --- whole columns ----------------------------------------------------------------------------------

SLICE = st.tuples(st.floats(0.0, 1e6), st.floats(0.0, 1e6), st.floats(0.01, 4.0))
MEDIA = st.lists(SLICE, min_size=1, max_size=7)


def parts(media):
    source, extinction, step = (np.array(values) for values in zip(*media, strict=True))
    return source, extinction, np.concatenate([[0.0], np.cumsum(step)])


@pytest.mark.parametrize("name", ["half_step", *HIGHER])
@given(MEDIA)
def test_whatever_the_medium(name, media):
    """Contrasts of any size: transmittance falls from 1, light rises, nothing is negative or not finite."""
    light, through = column(*parts(media), integrator=name)
    assert (through >= 0.0).all()
    assert (np.diff(through, prepend=1.0) <= 0.0).all()
    assert np.isfinite(light).all()
    assert (np.diff(light, prepend=0.0) >= 0.0).all()


@pytest.mark.parametrize("name", HIGHER)
@given(MEDIA, st.floats(0.1, 10.0))
def test_furnace(name, media, glow):
    """S = glow·σ everywhere gives glow·(1 − T), whatever the profile: the two have the same."""
    _, extinction, z = parts(media)
    light, through = column(glow * extinction, extinction, z, integrator=name)
    assert (light <= glow * (1.0 + 64 * EPS)).all()
    assert light == pytest.approx(glow * (1.0 - through), rel=1e-12, abs=glow * 1e-13)


@pytest.mark.parametrize("name", HIGHER)
def test_twice_the_light_gives_twice_the_light(name):
    """Also where the limiter makes the sum of two sources another thing than the sum of their fogs."""
    rng = np.random.default_rng(5)
    source, extinction = 10.0 ** rng.uniform(-6.0, 6.0, (2, 20))
    z = np.linspace(0.0, 3.0, 21)
    once, twice = (column(s, extinction, z, integrator=name)[0] for s in (source, 2.0 * source))
    assert np.array_equal(twice, 2.0 * once)


@pytest.mark.parametrize("name", HIGHER)
@pytest.mark.parametrize("count", [1, 2, 3, 40])
def test_constant_media_are_the_closed_form(name, count):
    z = grid(count, "exponential")[0]
    light, through = column(0.7, 0.05, z, integrator=name)
    for k in range(count):
        with mpmath.workdps(40):
            exact = exact_slice(0.7, 0.05, mpmath.mpf(float(z[k + 1])) - mpmath.mpf(float(z[0])))
        assert ulps(light[k], exact[0]) <= 6 * (k + 1)
        assert ulps(through[k], exact[1]) <= 4 * (k + 1)


def test_half_step_by_hand():
    """ln 2 a slice: stored T is 2^−½, 2^−1½; light 2·2^−½ + 4·2^−1½. The front segment is whole."""
    light, through = column([2.0, 4.0], math.log(2.0), [0.0, 1.0, 2.0], integrator="half_step")
    assert through == pytest.approx([2**-0.5, 2**-1.5], rel=1e-15)
    assert light == pytest.approx([2**0.5, 2**0.5 + 2**0.5], rel=1e-15)
    light, through = column([2.0, 4.0], math.log(2.0), [1.0, 2.0, 3.0], integrator="half_step",
                            integrate_from="camera")
    assert through == pytest.approx([2**-1.5, 2**-2.5], rel=1e-15)
    assert slice_integral(np.float64(3.0), np.float64(math.log(4.0)), np.float64(1.0),
                          integrator="half_step") == pytest.approx((1.5, 0.25), rel=1e-15)


@pytest.mark.parametrize(("dtype", "sigma", "length"), [
    (np.float32, 2.4683865e-07, 8.648125e+08),  # e^(−x/2) is 4e-47, no float32; the light 3.83e-38 is one
    (np.float32, 1.0, 180.0), (np.float64, 1.5e-6, 1e9), (np.float64, 1.46e-19, 1e22), (np.float64, 1480.0, 1.0)])
def test_half_step_keeps_light_whose_exponential_is_lost(dtype, sigma, length):
    """d·e^(−σd/2) is a normal number where e^(−σd/2) is none; only rounding σd costs digits then."""
    sigma, length = dtype(sigma), dtype(length)
    light = slice_integral(dtype(1.0), sigma, length, integrator="half_step")[0]
    with mpmath.workdps(40):
        depth = mpmath.mpf(float(sigma)) * mpmath.mpf(float(length))
        exact = mpmath.mpf(float(length)) * mpmath.exp(-depth / 2)
        if exact < np.finfo(dtype).tiny:  # then the spacing of the least numbers
            assert abs(float(light) - exact) <= np.finfo(dtype).smallest_subnormal
            return
        error = float(abs(mpmath.mpf(float(light)) / exact - 1))
    allowed = 1.0 if dtype == np.float32 else 4.0 + float(depth) / 2.0
    assert error <= allowed * float(np.finfo(dtype).eps)


@pytest.mark.parametrize("name", HIGHER)
def test_same_bits_whatever_the_blocks_and_colours(name, monkeypatch):
    rng = np.random.default_rng(2)
    source, extinction = rng.random((3, 6, 5, 7)), rng.random((3, 6, 5, 7))
    step, ray = np.full((6, 1, 1), 0.5), rng.uniform(1.0, 2.0, (5, 7))
    whole = integrate(source, extinction, step, ray, integrator=name)
    monkeypatch.setattr("froxel_ref.integrate.BLOCK", 9)
    cut = integrate(source, extinction, step, ray, integrator=name, threads=1)
    assert all(np.array_equal(a, b) for a, b in zip(whole, cut, strict=True))
    one = integrate(source, extinction[1], step, ray, integrator=name)
    assert np.array_equal(one.radiance[1], whole.radiance[1])


def test_a_frame_tells_the_rule_where_its_samples_are():
    """Exponential slices of height fog: fourth order only with the samples at their own depths."""
    from froxel_ref import Scene, Settings, run_frame
    from froxel_ref.scene import Camera, HeightFog, Medium
    from froxel_ref.settings import Grid, replace

    camera = Camera(position=(0.0, 2.0, 0.0), target=(0.0, 22.0, -20.0), vertical_fov=20.0)
    scene = Scene(camera=camera, global_media=(Medium(extinction=0.2, height_fog=HeightFog(start=0.0, falloff=0.2)),))
    # Along the ray y = 2 + z/√2 from z = 0.5 to 64, so the optical depth is a difference of exponentials.
    rise, counts, errors = math.sqrt(0.5), np.array([48, 96, 192]), []
    front, back = (math.exp(-0.2 * (2.0 + rise * z)) for z in (0.5, 64.0))
    exact = math.exp(-0.2 / (0.2 * rise) * (front - back))
    for depth in counts.tolist():
        how = replace(Settings(grid=Grid(width=1, height=1, depth=depth)), integrator="gauss", integrate_from="near")
        errors.append(abs(float(run_frame(scene, how)["integrate/transmittance"][-1, 0, 0]) / exact - 1.0))
    assert order(1.0 / counts, errors).order == pytest.approx(4.0, abs=0.4)
    assert errors[-1] < 1e-7


# --- compensated ------------------------------------------------------------------------------------


def exact_sums(source, extinction, lengths):
    """`exact_column` for many slices: running sums instead of a double loop, 50 digits."""
    with mpmath.workdps(50):
        depth, total, light, through = mpmath.mpf(0), mpmath.mpf(0), [], []
        for s, e, d in zip(source, extinction, lengths, strict=True):
            total += exact_slice(s, e, d)[0] * mpmath.exp(-depth)
            depth += mpmath.mpf(float(e)) * mpmath.mpf(float(d))
            light.append(total)
            through.append(mpmath.exp(-depth))
        return light, through


def test_the_running_sums_are_the_reference():
    inputs = [1.0, 3.0, 0.5], [0.2, 0.0, 4.0], [1.0, 2.0, 0.25]
    for a, b in zip(exact_sums(*inputs), exact_column(*inputs), strict=True):
        assert all(abs(x / y - 1) < 1e-35 for x, y in zip(a, b, strict=True))


@pytest.mark.parametrize("total", [0.05, 3.0, 30.0, 600.0])
def test_4096_slices_within_a_few_ulp(total):
    """T within 2 ulp and L within 4, whatever the optical depth; the plain march loses up to 40 times more."""
    rng = np.random.default_rng(8)
    z = np.concatenate([[0.0], np.cumsum(rng.uniform(0.5, 1.5, 4096))]) / 64.0
    steps = np.diff(z)
    extinction = rng.uniform(0.0, 2.0, 4096) * total / z[-1]
    source = rng.uniform(0.0, 1.0, 4096)
    exact = exact_sums(source, extinction, steps)
    worst = {}
    for compensated in (False, True):
        got = column(source, extinction, z, compensated=compensated)
        for name, values, wanted in zip("LT", got, exact, strict=True):
            worst[name, compensated] = max(ulps(values[k], wanted[k]) for k in range(0, 4096, 13))
    assert worst["T", True] <= 2.0
    assert worst["L", True] <= 4.0
    assert worst["T", True] * 5.0 < worst["T", False]


def test_compensated_along_slanted_rays_counts_all_three_factors():
    """σ·step·length, none of the products rounded."""
    rng = np.random.default_rng(4)
    extinction, step, ray = rng.random((9, 2, 3)), rng.random((9, 1, 1)) * 20.0, rng.uniform(1.0, 2.0, (2, 3))
    fog = integrate(np.ones((3, 1, 1, 1)), extinction, step, ray, near=0.3, compensated=True)
    with mpmath.workdps(40):
        for j, i in itertools.product(range(2), range(3)):
            front = mpmath.mpf(0.3) * mpmath.mpf(extinction[0, j, i])
            depth = mpmath.mpf(ray[j, i]) * (front + mpmath.fsum(
                mpmath.mpf(s) * mpmath.mpf(e) for s, e in zip(step[:, 0, 0], extinction[:, j, i], strict=True)))
            assert ulps(fog.transmittance[-1, j, i], mpmath.exp(-depth)) <= 2.0


@pytest.mark.parametrize("dtype", [np.float64, np.float32])
def test_compensated_at_the_edges(dtype):
    """Vacuum, denormals, opaque slices and overflowing products, without a warning; types are kept."""
    large = float(np.finfo(dtype).max) / 4.0
    extinction = np.array([0.0, float(np.finfo(dtype).smallest_subnormal), 1.0, large, 0.0], dtype).reshape(-1, 1, 1)
    fog = integrate(np.ones((3, 1, 1, 1), dtype), extinction, np.full((5, 1, 1), 2.0, dtype), np.ones((1, 1), dtype),
                    integrate_from="near", compensated=True)
    assert fog.radiance.dtype == fog.transmittance.dtype == dtype
    wanted = pytest.approx([1.0, 1.0, math.exp(-2.0), 0.0, 0.0], rel=float(np.finfo(dtype).eps))
    assert fog.transmittance.ravel() == wanted
    assert fog.radiance[0].ravel()[:2] == pytest.approx([2.0, 4.0], rel=1e-15)
    assert np.isfinite(fog.radiance).all()


@pytest.mark.parametrize(("lit", "hazy"), [(False, True), (True, False)])
def test_compensated_keeps_constant_fields_small(lit, hazy):
    shape = (3, 4, 2, 3)
    fog = integrate(np.full(shape, float(lit)), np.full(shape[1:], float(hazy)), np.ones((4, 1, 1)), np.ones((2, 3)),
                    compensated=True)
    assert fog.radiance.shape == (shape if lit else (3, 1, 1, 1))
    assert fog.transmittance.shape == (shape[1:] if hazy else (1, 1, 1))


# --- bad input, and the table -----------------------------------------------------------------------


@pytest.mark.parametrize(("options", "says"), [
    ({"compensated": True, "integrator": "gauss"}, "compensated: goes with the integrator 'analytic', not 'gauss'"),
    ({"integrator": "gaus"}, "did you mean 'gauss'"),
    ({"integrator": "gauss", "depths": np.zeros(4)}, "depths: must lie within the slices"),
    ({"integrator": "gauss", "depths": np.arange(4) + 1.1}, "depths: must lie within the slices"),
    ({"integrator": "linear", "depths": np.full(4, np.nan)}, "depths: must lie within the slices")])
def test_bad_options_are_refused(options, says):
    with pytest.raises(InputError, match=says):
        column(1.0, 1.0, np.arange(5.0), **options)


def test_depths_of_another_shape_are_refused():
    with pytest.raises(InputError, match="has shape"):
        integrate(np.ones((3, 1, 1, 1)), np.ones((1, 1, 1)), np.ones((4, 1, 1)), np.ones((1, 1)), integrator="gauss",
                  depths=np.ones((3, 1, 1)))


def test_stiffness_table():
    """Every integrator on 64 slices of 1e-8 to 1e4 optical depths: what each is good for, in numbers."""
    rows = {(row.integrator, row.slice_depth): row for row in stiffness.stiffness_table()}
    assert len(rows) == len(INTEGRATORS) * 13
    worst = {name: max(rows[name, x].light for x in stiffness.SLICE_DEPTHS) for name in INTEGRATORS}
    assert worst["gauss"] < 1e-4 < worst["linear"] < 1e-3 < 1e-2 < worst["analytic"] < 2e-2
    assert rows["half_step", 1e4].light == pytest.approx(1.0)  # all light lost in opaque slices
    assert rows["simple", 1e4].light > 1e4
    assert rows["published", 1e-8].transmittance == pytest.approx(6.4e-4, rel=0.01)  # 64 m of clamped vacuum
    assert rows["analytic", 1e-8].transmittance < 1e-10
    assert all(math.isnan(rows[name, 1e2].transmittance) for name in INTEGRATORS)
