"""What arrives at a point from one light."""

from __future__ import annotations

import math

import numpy as np
import pytest
import reference_lighting as reference
from hypothesis import given
from hypothesis import strategies as st

from froxel_ref.lights import (
    colour,
    cone_attenuation,
    distance_attenuation,
    light_at,
    point_intensity,
    smallest_d2,
    spot_intensity,
)
from froxel_ref.records import InputError
from froxel_ref.scene import DirectionalLight, PointLight, SpotLight

WHITE = (1.0, 1.0, 1.0)
ORIGIN = (0.0, 0.0, 0.0)


def at(*point: float, dtype: type = np.float64) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    x, y, z = (np.full((1, 1, 1), c, dtype) for c in point)
    return x, y, z


def test_a_lamp_by_hand() -> None:
    """At (3, 0, 4) from the light: d = 5, window (1 − (25/100)²)² = 0.87890625, factor window/25."""
    lamp = PointLight(position=ORIGIN, intensity=(1.0, 2.0, 3.0), radius=10.0)
    L, factor = light_at(lamp, at(3.0, 0.0, 4.0))
    assert [c.item() for c in L] == [-0.6, 0.0, -0.8]
    assert factor.item() == 0.03515625
    assert colour(lamp).tolist() == [1.0, 2.0, 3.0]


def test_a_spot_by_hand() -> None:
    """Half way in cosine between the cone's edges, half the angle factor's root: ¼."""
    edge = math.degrees(math.acos(0.5))
    lamp = SpotLight(position=ORIGIN, intensity=WHITE, falloff="inverse_square", direction=(0.0, 0.0, -2.0),
                     inner_angle=0.0, outer_angle=edge)
    side = math.sqrt(1.0 - 0.75**2)
    _, factor = light_at(lamp, at(2.0 * side, 0.0, -1.5))
    # cos 60° comes out of degrees with an error of an ulp, which the cone's slope doubles.
    assert factor.item() == pytest.approx(0.25 * 0.25, rel=16 * np.finfo(float).eps)


def test_a_directional_light_has_no_axes() -> None:
    L, factor = light_at(DirectionalLight(direction=(0.0, 3e9, 4e9), irradiance=(7.0, 8.0, 9.0)),
                         (np.zeros((1, 1, 5)), np.zeros((1, 4, 1)), np.zeros((3, 1, 1))))
    assert [c.shape for c in L] == [(1, 1, 1)] * 3
    assert [c.item() for c in L] == [0.0, 0.6, 0.8]
    assert factor.shape == (1, 1, 1)
    assert factor.item() == 1.0


@pytest.mark.parametrize("falloff", ["windowed", "inverse_square"])
@pytest.mark.parametrize("attenuation", ["min_distance", "inverse_radius"])
@given(st.floats(0.1, 100.0), st.floats(-50.0, 50.0), st.floats(-50.0, 50.0), st.floats(-50.0, 50.0))
def test_lights_agree_with_the_textbook(falloff: str, attenuation: str, radius: float, x: float, y: float,
                                        z: float) -> None:
    lamp = SpotLight(position=(1.0, 2.0, 3.0), intensity=WHITE, radius=radius, falloff=falloff,
                     direction=(1.0, -2.0, 0.5), inner_angle=10.0, outer_angle=75.0)
    L, factor = light_at(lamp, at(x, y, z), attenuation=attenuation)
    want, weight = reference.light(lamp, (x, y, z), attenuation=attenuation, number=reference.mp.mpf)
    d2 = sum((a - b) ** 2 for a, b in zip((x, y, z), lamp.position, strict=True))
    eps = np.finfo(float).eps
    assert max(abs(a.item() - float(b)) for a, b in zip(L, want, strict=True)) <= 4 * eps
    # Window and cone are differences of numbers up to 1 (cone: slope 1.4, of which the square doubles it):
    # an absolute error of some 40 eps, over the bounded d².
    assert abs(factor.item() - float(weight)) <= 40 * eps / max(d2, smallest_d2(lamp, attenuation))


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize("radius", [1e-9, 1e-6, 1.0, 1e9, 1e10])
@pytest.mark.parametrize("attenuation", ["min_distance", "inverse_radius"])
@pytest.mark.parametrize("falloff", ["windowed", "inverse_square"])
def test_no_distance_or_radius_makes_nan(dtype: type, radius: float, attenuation: str, falloff: str) -> None:
    lamp = PointLight(position=ORIGIN, intensity=WHITE, radius=radius, falloff=falloff, min_distance=1e-9)
    x = np.array([0.0, 1e-20, 1e-3, 1.0, 1e9, 4e10], dtype)
    with np.errstate(all="raise", under="ignore"):
        L, factor = light_at(lamp, (x, 0 * x, 0 * x), attenuation=attenuation)
    assert np.isfinite(factor).all()
    assert (factor >= 0.0).all()
    assert all(np.isfinite(c).all() for c in L)
    assert factor.dtype == L[0].dtype == dtype


def test_the_light_itself_has_no_direction_but_a_factor() -> None:
    lamp = PointLight(position=(1.0, 2.0, 3.0), intensity=WHITE, min_distance=0.5)
    L, factor = light_at(lamp, at(1.0, 2.0, 3.0))
    assert [c.item() for c in L] == [0.0, 0.0, 0.0]
    assert factor.item() == 4.0


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_the_window_is_exactly_zero_from_the_radius_on(dtype: type) -> None:
    lamp = PointLight(position=ORIGIN, intensity=WHITE, radius=3.0)
    d2 = np.array([9.0, np.nextafter(dtype(9.0), dtype(10.0)), 1e30], dtype)
    assert distance_attenuation(d2, lamp).tolist() == [0.0, 0.0, 0.0]
    assert distance_attenuation(np.array([8.99], dtype), lamp).item() > 0.0


def test_author_bounds_by_the_inverse_radius() -> None:
    """A6: 1/r² in place of d_min², so that a light of radius ½ never exceeds ¼ of its intensity."""
    lamp = PointLight(position=ORIGIN, intensity=WHITE, radius=0.5)
    near = np.array([1e-12])
    assert distance_attenuation(near, lamp, attenuation="inverse_radius").item() == 0.25
    assert distance_attenuation(near, lamp).item() == 1e4


def test_cone_is_one_inside_and_zero_outside() -> None:
    lamp = SpotLight(position=ORIGIN, intensity=WHITE, inner_angle=20.0, outer_angle=30.0)
    cosines = np.cos(np.radians([0.0, 19.99, 30.01, 90.0, 180.0]))
    assert cone_attenuation(cosines, lamp).tolist() == [1.0, 1.0, 0.0, 0.0, 0.0]


def test_power_of_a_point_light() -> None:
    """A sphere around it takes up all of it."""
    assert 4.0 * math.pi * point_intensity((5.0, 0.0, 0.0))[0] == pytest.approx(5.0, rel=1e-15)


def test_power_of_a_spot_light_by_quadrature() -> None:
    inner, outer, count = 25.0, 65.0, 4000
    lamp = SpotLight(position=ORIGIN, intensity=WHITE, inner_angle=inner, outer_angle=outer)
    low, high = math.cos(math.radians(outer)), math.cos(math.radians(inner))
    cosines = low + (np.arange(count) + 0.5) / count * (high - low)
    cone = 2.0 * math.pi * (1.0 - high + (high - low) * cone_attenuation(cosines, lamp).mean())
    # The midpoint rule errs by 1/(4·count²) of the edge for a parabola.
    assert spot_intensity((1.0, 2.0, 3.0), inner, outer)[2] * cone == pytest.approx(3.0, rel=1e-7)
    assert spot_intensity((1.0, 2.0, 3.0), inner, outer, convention="author")[1] == 2.0 / math.pi


@pytest.mark.parametrize("call", [
    lambda: smallest_d2(PointLight(position=ORIGIN, intensity=WHITE), "none"),
    lambda: spot_intensity(WHITE, 1.0, 2.0, convention="none"),
])
def test_unknown_words_are_refused(call) -> None:
    with pytest.raises(InputError, match="'none', must be one of"):
        call()
