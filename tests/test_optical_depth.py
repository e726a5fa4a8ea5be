"""Columns of density along lines: closed forms against quadrature that shares nothing with them."""

from __future__ import annotations

import itertools
import math

import mpmath
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from froxel_ref.density import density, place
from froxel_ref.light_paths import light_transmittance
from froxel_ref.optical_depth import Lines, column, extinctions, medium_path, optical_depth, support
from froxel_ref.records import InputError
from froxel_ref.scene import (
    DensityTexture,
    DirectionalLight,
    HeightFog,
    LocalMedium,
    Medium,
    NoiseDensity,
    PointLight,
    Transform,
)
from froxel_ref.settings import Settings
from froxel_ref.texture_depth import crossings

mp = mpmath.mp.clone()
mp.dps = 40
EPS = 2.0**-52


def line(origin, direction, stop, start=0.0):
    d = np.array(direction, float)
    return Lines(np.array(origin, float)[:, None], (d / np.linalg.norm(d))[:, None], np.array([float(start)]),
                 np.array([float(stop)]))


def exact_fog_column(y, dy, stop, fog):
    """∫ density, from its definition, in 40 digits; the pieces are found by hand."""
    y, dy, stop, start, k = (mp.mpf(v) for v in (y, dy, stop, fog.start, fog.falloff))
    low, high = mp.mpf(0), stop
    if fog.max_height is not None:
        if dy == 0:
            high = stop if y <= fog.max_height else mp.mpf(0)
        else:
            cut = min(max((fog.max_height - y) / dy, 0), stop)
            low, high = (low, cut) if dy > 0 else (cut, high)
    if dy == 0:
        return (high - low) * mp.exp(-k * max(y - start, 0))
    cross = min(max((start - y) / dy, low), high)
    flat = cross - low if dy > 0 else high - cross
    a, b = (cross, high) if dy > 0 else (low, cross)
    if b <= a:
        return flat
    ua, ub = max(k * (y + dy * a - start), 0), max(k * (y + dy * b - start), 0)
    if ua == ub:
        return flat + (b - a) * mp.exp(-ua)
    return flat + (b - a) * (mp.exp(-min(ua, ub)) - mp.exp(-max(ua, ub))) / abs(ub - ua)


@given(st.floats(-20, 60), st.floats(-1, 1), st.floats(0, 200), st.floats(-10, 30),
       st.floats(-9, 3).map(lambda e: 10**e), st.none() | st.floats(-10, 60))
def test_height_fog_in_every_direction(y, dy, stop, start, falloff, ceiling):
    """Within a few ulp, and what 4 ulp in the exponent make of exp."""
    fog = HeightFog(start=start, falloff=falloff, max_height=ceiling)
    direction = (math.sqrt(1 - dy * dy), dy, 0.0)
    lines = Lines(np.array([[0.0], [y], [0.0]]), np.array(direction)[:, None], np.zeros(1), np.array([stop]))
    got = float(column(medium_path(place(Medium(height_fog=fog)), lines), lines.stop)[0])
    want = exact_fog_column(y, dy, stop, fog)
    # Rounding of heights moves the ends of the pieces, and the exponent.
    place_error = 8 * EPS * (abs(y) + abs(start) + abs(ceiling or 0.0) + stop)
    slope = abs(dy) if dy else 1.0
    bound = 16 * EPS * float(want) + float(want) * falloff * place_error + place_error / max(slope, EPS)
    assert abs(got - want) <= min(bound, 16 * EPS * stop + float(want) * 1e-3 + place_error / max(slope, EPS))
    assert got >= 0.0


@pytest.mark.parametrize("dy", [0.0, 1e-300, 1e-17, 1e-12, 1e-6, -1e-6, -1e-12, 1.0, -1.0])
def test_height_fog_near_the_horizon_keeps_its_digits(dy):
    """Inside the fog, where nothing is cut, the result is within 8 ulp for every slope."""
    fog = HeightFog(start=0.0, falloff=0.25)
    lines = Lines(np.array([[0.0], [8.0], [0.0]]), np.array([[1.0], [dy], [0.0]]), np.zeros(1), np.array([4.0]))
    got = float(column(medium_path(place(Medium(height_fog=fog)), lines), lines.stop)[0])
    want = exact_fog_column(8.0, dy, 4.0, fog)
    assert abs(got / float(want) - 1) <= 8 * EPS


def test_height_fog_to_infinity():
    fog = Medium(height_fog=HeightFog(start=1.0, falloff=0.5))
    up, level, down = (line((0, 2, 0), d, np.inf) for d in ((0, 1, 0), (1, 0, 0), (1, -1, 0)))
    depth = [float(column(medium_path(place(fog), way), way.stop)[0]) for way in (up, level, down)]
    assert depth[0] == pytest.approx(2.0 * math.exp(-0.5), rel=1e-15)
    assert depth[1:] == [math.inf, math.inf]


@pytest.mark.parametrize("shape", ["box", "ellipsoid"])
def test_local_media_end_where_their_density_does(shape):
    """Random lines: the density's own inside test agrees on both sides of each end."""
    rng = np.random.default_rng(11)
    medium = LocalMedium(shape=shape, transform=Transform(translate=(1, 2, -3), rotate=(20, 30, 40),
                                                          scale=(0.5, 2.0, 1.5)))
    count = 500
    d = rng.normal(size=(3, count))
    origin = rng.uniform(-2, 2, (3, count)) + np.array([[1], [2], [-3]])
    lines = Lines(origin, d / np.linalg.norm(d, axis=0), np.zeros(count), np.full(count, 12.0))
    enter, leave = support(place(medium), lines)
    met = leave > enter
    assert 0.2 < met.mean() < 0.9

    def inside(t):
        return density(medium, tuple(lines.origin[i] + t * lines.direction[i] for i in range(3))) > 0

    assert inside(0.5 * (enter + leave))[met].all()
    for t, sign in ((enter, -1), (leave, 1)):
        ends = met & (t > 0) & (t < 12)
        assert not inside(t + sign * 1e-9)[ends].any()
        assert inside(t - sign * 1e-9)[ends & (leave - enter > 1e-8)].all()
    for t in np.linspace(0, 12, 301):
        away = (np.abs(t - enter) > 1e-9) & (np.abs(t - leave) > 1e-9)
        np.testing.assert_array_equal(inside(np.full(count, t))[away], ((t > enter) & (t < leave))[away])


def dense_column(medium, lines, texture, time, addressing, pieces=20000):
    """Midpoint rule with 20000 steps: error about (kinks)·step², measured 1e-7 of the length."""
    t = (np.arange(pieces) + 0.5) / pieces * float(lines.stop[0])
    points = tuple(float(o[0]) + float(d[0]) * t for o, d in zip(lines.origin, lines.direction, strict=True))
    return float(density(medium, points, texture, time=time, addressing=addressing).mean() * lines.stop[0])


@pytest.mark.parametrize("fog", [None, HeightFog(start=0.1, falloff=3.0, max_height=0.9)])
@pytest.mark.parametrize("addressing", ["wrap", "clamp"])
@pytest.mark.parametrize("local", [True, False])
def test_textured_columns(fog, addressing, local):
    rng = np.random.default_rng(3)
    texels = rng.random((5, 7, 6))
    record = DensityTexture(source=NoiseDensity(), scale=(0.8, 1.3, 2.1), bias=(0.2, -0.4, 0.6),
                            scroll=(0.1, 0.0, -0.3))
    kind = {"shape": "ellipsoid", "transform": Transform(rotate=(10, 20, 30), scale=(2.0, 1.0, 1.5))}
    medium = LocalMedium(density=record, height_fog=fog, **kind) if local else Medium(density=record, height_fog=fog)
    for _ in range(4):
        lines = line(rng.uniform(-1.5, 1.5, 3), rng.normal(size=3), 3.0)
        path = medium_path(place(medium, texels), lines, time=1.7, addressing=addressing)
        want = dense_column(medium, lines, texels, 1.7, addressing)
        assert float(column(path, lines.stop)[0]) == pytest.approx(want, abs=2e-4)
        # Columns to points between, summed by pieces, agree with the whole: all exact rules.
        t = np.linspace(0, 3.0, 37)[None]
        part = column(path, t)
        assert (np.diff(part[0]) >= -1e-15).all()
        short = medium_path(place(medium, texels), lines._replace(stop=t[0, 20:21]), time=1.7,
                            addressing=addressing)
        assert float(column(short, t[0, 20:21])[0]) == pytest.approx(float(part[0, 20]), abs=1e-13)
        whole = medium_path(place(medium, texels), lines, time=1.7, addressing=addressing, keep=False)
        assert float(column(whole, lines.stop)[0]) == pytest.approx(float(part[0, -1]), abs=1e-13)


def test_textured_columns_are_exact_in_cells():
    """Against scipy's quadrature told of every face: 1e-12, where the midpoint rule could not see a fault."""
    from scipy.integrate import quad

    rng = np.random.default_rng(8)
    texels = rng.random((4, 4, 4))
    medium = Medium(density=DensityTexture(source=NoiseDensity()))
    lines = line((0.3, -0.2, 0.1), (1.0, 0.7, -0.4), 2.5)
    path = medium_path(place(medium, texels), lines)
    knots = crossings(place(medium, texels), lines, lines.start, lines.stop)[0]

    def at(t):
        points = tuple(np.array([float(o[0]) + float(d[0]) * t])
                       for o, d in zip(lines.origin, lines.direction, strict=True))
        return float(density(medium, points, texels)[0])

    want = sum(quad(at, a, b, epsabs=1e-15, epsrel=1e-13)[0] for a, b in itertools.pairwise(knots))
    assert float(column(path, lines.stop)[0]) == pytest.approx(want, rel=1e-12)


def test_too_many_cells_are_refused():
    medium = Medium(density=DensityTexture(source=NoiseDensity(), scale=(1e6, 1, 1)))
    with pytest.raises(InputError, match=r"density\.scale: makes a ray cross \d+ cells"):
        medium_path(place(medium, np.ones((4, 4, 4))), line((0, 0, 0), (1, 0, 0), 50.0))


def test_optical_depths_add_and_may_be_coloured():
    media = [Medium(extinction=0.5), Medium(extinction=(0.1, 0.2, 0.3)), LocalMedium(extinction=2.0)]
    lines = line((-3, 0, 0), (1, 0, 0), 10.0, start=1.0)
    paths = [medium_path(place(m), lines) for m in media]
    depth = optical_depth(paths, extinctions(media), np.array([3.0]))
    np.testing.assert_allclose(depth[:, 0], [1.0 + 0.2 + 2.0, 1.0 + 0.4 + 2.0, 1.0 + 0.6 + 2.0], rtol=1e-15)


# --- to lights --------------------------------------------------------------------------------------


def shade(media, light, point, **options):
    placed = [place(m) for m in media]
    points = tuple(np.array([float(c)]) for c in point)
    return light_transmittance(placed, extinctions(media), light, points, settings=Settings(), **options)[:, 0]


def test_the_way_to_a_lamp():
    lamp = PointLight(position=(3.0, 4.0, 0.0), intensity=(1, 1, 1))
    assert shade([Medium(extinction=0.2)], lamp, (0, 0, 0))[0] == pytest.approx(math.exp(-1.0), rel=1e-15)
    box = LocalMedium(extinction=1.0, transform=Transform(translate=(1.5, 2.0, 0.0), scale=(0.3, 9, 9)))
    # Across 0.6 m in x, of which the way has 3 in 5.
    assert shade([box], lamp, (0, 0, 0))[0] == pytest.approx(math.exp(-1.0), rel=1e-14)


def test_suns_at_infinity():
    sun = DirectionalLight(direction=(0, 2, 0), irradiance=(1, 1, 1))
    level = DirectionalLight(direction=(1, 0, 0), irradiance=(1, 1, 1))
    uniform, fog = Medium(extinction=0.5), Medium(extinction=0.5, height_fog=HeightFog(falloff=0.25))
    ceiling = Medium(extinction=0.5, height_fog=HeightFog(falloff=0.0, max_height=4.0))
    assert shade([uniform], sun, (0, 0, 0))[0] == 1.0  # infinitely deep: not dimmed, see the notes
    assert shade([uniform], sun, (0, 0, 0), sun_distance=4.0)[0] == pytest.approx(math.exp(-2), rel=1e-15)
    assert shade([fog], sun, (0, 0, 0))[0] == pytest.approx(math.exp(-2), rel=1e-15)
    assert shade([fog], level, (0, 0, 0))[0] == 1.0
    assert shade([ceiling], sun, (0, 0, 0))[0] == pytest.approx(math.exp(-2), rel=1e-15)
    assert shade([ceiling], level, (0, 9, 0))[0] == 1.0


def test_a_textured_global_medium_towards_the_sun():
    """A texture of ones changes nothing, also on the way to infinity."""
    sun = DirectionalLight(direction=(0, 1, 0.3), irradiance=(1, 1, 1))
    fog = HeightFog(falloff=0.25)
    ones = Medium(extinction=0.5, height_fog=fog, density=DensityTexture(source=NoiseDensity()))
    points = tuple(np.array([c]) for c in (0.0, 1.0, 0.0))
    got = light_transmittance([place(ones, np.ones((3, 3, 3)))], np.array([[0.5]]), sun, points,
                              settings=Settings())
    assert got[0, 0] == pytest.approx(shade([Medium(extinction=0.5, height_fog=fog)], sun, (0, 1, 0))[0], rel=1e-12)
