"""Directional lights along rays, and the arithmetic with two float64 that they rest on."""

from __future__ import annotations

import mpmath
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from froxel_ref.compensated import FOUR_PI, DoubleDouble, double_double, two_product, two_sum
from froxel_ref.geometry import camera_rays
from froxel_ref.scene import Camera, DirectionalLight
from froxel_ref.sun_rays import sun_light, sun_rays

mp = mpmath.mp.clone()
mp.prec = 400
ordinary = st.floats(1e-60, 1e60) | st.floats(-1e60, -1e-60)


def exact(value: DoubleDouble) -> mpmath.mpf:
    return mp.mpf(float(value.high)) + mp.mpf(float(value.low))


@given(ordinary, ordinary)
def test_two_sum_and_two_product_lose_nothing(a: float, b: float) -> None:
    for got, want in ((two_sum, mp.mpf(a) + mp.mpf(b)), (two_product, mp.mpf(a) * mp.mpf(b))):
        value, error = got(np.float64(a), np.float64(b))
        assert mp.mpf(float(value)) + mp.mpf(float(error)) == want
        assert float(value) == float(want)  # the first part is the sum or product, rounded


@given(ordinary, ordinary, st.floats(-1e-17, 1e-17), st.floats(-1e-17, 1e-17))
def test_arithmetic_keeps_a_hundred_bits(a: float, b: float, c: float, d: float) -> None:
    x, y = double_double(a) + double_double(a * c), double_double(b) + double_double(b * d)
    p, q = exact(x), exact(y)
    for got, want, size in ((x + y, p + q, abs(p) + abs(q)), (x - y, p - q, abs(p) + abs(q)),
                            (x * y, p * q, abs(p * q)), (x / y, p / q, abs(p / q))):
        assert abs(exact(got) - want) <= size * mp.mpf(2) ** -100
    positive = x * x
    assert abs(exact(positive.sqrt()) - mp.sqrt(exact(positive))) <= abs(p) * mp.mpf(2) ** -100


def test_constants_and_the_root_of_nothing() -> None:
    assert abs(exact(FOUR_PI) - 4 * mp.pi) < mp.mpf(2) ** -104
    assert exact(double_double(0.0).sqrt()) == 0


CAMERA = Camera(target=(0.3, 1.9, -1.0), vertical_fov=100.0)
TOWARDS = {"behind": (0.2, 0.3, 1.0), "ahead": (0.31, 0.22, -1.0), "centre": (0.3, 0.2, -1.0)}


@pytest.mark.parametrize("dtype", [np.float64, np.float32])
@pytest.mark.parametrize("g", [-0.999, -0.6, 0.0, 0.3, 0.9, 0.9999, 1 - 2.0**-24])
@pytest.mark.parametrize("towards", TOWARDS)
def test_henyey_greenstein_of_a_sun_is_rounded_once(towards: str, g: float, dtype: type) -> None:
    rays = camera_rays(CAMERA, 7, 5, dtype=dtype)
    light = DirectionalLight(direction=TOWARDS[towards], irradiance=(1.0, 0.3, 7.0))
    got = sun_light(sun_rays(0, light, rays), "henyey_greenstein", np.full((1, 1, 1), g))
    assert got.dtype == dtype
    components = [np.broadcast_to(c, (5, 7)) for c in rays.per_depth]
    size, direction = mp.mpf(g), [mp.mpf(c) for c in light.direction]
    for j in range(5):
        for i in range(7):
            p = [mp.mpf(float(c[j, i])) for c in components]
            cosine = sum(a * b for a, b in zip(p, direction, strict=True)) / mp.sqrt(
                sum(a * a for a in p) * sum(b * b for b in direction))
            want = (1 - size**2) / (4 * mp.pi * (1 + size**2 - 2 * size * cosine) ** mp.mpf(1.5))
            for channel, power in enumerate(light.irradiance):
                # Rounded to nearest: half an ulp, and a hair for rounding float32 through float64.
                error = abs(mp.mpf(float(got[channel, 0, j, i])) - want * mp.mpf(power))
                assert error <= 0.51 * float(np.spacing(dtype(float(want * power))))


def test_other_phase_functions_see_the_same_angle() -> None:
    rays = camera_rays(CAMERA, 6, 4)
    sun = sun_rays(0, DirectionalLight(direction=TOWARDS["ahead"], irradiance=(1.0, 1.0, 1.0)), rays)
    # Rayleigh by hand: 3/(16π)·(1 + cos² θ).
    want = 3.0 / (16.0 * np.pi) * (1.0 + sun.deflection.high**2)
    np.testing.assert_allclose(sun_light(sun, "rayleigh", np.zeros((1, 1, 1)))[0, 0], want, rtol=1e-15)
    # A g that varies takes the plain path: it agrees with the single one where that is well-conditioned.
    g = np.full((2, 4, 6), -0.5)
    single = sun_light(sun, "henyey_greenstein", g[:1, :1, :1])
    varying = sun_light(sun, "henyey_greenstein", g)
    np.testing.assert_allclose(varying, np.broadcast_to(single, varying.shape), rtol=4e-15)
