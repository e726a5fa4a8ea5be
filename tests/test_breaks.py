"""Where the light along a ray breaks: every change of a light or a medium happens at a cut."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from froxel_ref.breaks import (
    from_angle,
    jacobian,
    lamp_cuts,
    medium_cuts,
    pieces,
    relate,
    thickness_cuts,
    to_angle,
)
from froxel_ref.density import place
from froxel_ref.lights import light_at
from froxel_ref.optical_depth import Lines, medium_path, optical_depth
from froxel_ref.scene import HeightFog, Medium, PointLight, SpotLight


def random_lines(seed, count, stop=20.0):
    rng = np.random.default_rng(seed)
    d = rng.normal(size=(3, count))
    return Lines(rng.uniform(-6, 6, (3, count)), d / np.linalg.norm(d, axis=0), np.zeros(count),
                 np.full(count, stop))


LAMP = SpotLight(position=(0.5, 1.0, -0.5), intensity=(1, 1, 1), radius=6.0, min_distance=0.3,
                 direction=(0.3, -1.0, 0.2), inner_angle=15.0, outer_angle=40.0)


def test_a_lamp_is_related_as_its_points_say():
    """The distance, and the cosine to its axis, of `relate` against those at the points themselves."""
    lines = random_lines(1, 200)
    lamp = relate(LAMP, lines)
    for t in (0.0, 3.0, 17.0):
        s = t - lamp.nearest
        points = lines.origin + lines.direction * t
        way = points - np.array(LAMP.position)[:, None]
        d = np.linalg.norm(way, axis=0)
        axis = np.array(LAMP.direction) / np.linalg.norm(LAMP.direction)
        np.testing.assert_allclose(s * s + lamp.across2, d * d, rtol=1e-13)
        np.testing.assert_allclose((s * lamp.cone_slope + lamp.cone_offset) / d, axis @ way / d, atol=1e-13)


def test_a_near_miss_far_away_keeps_its_digits():
    """1 mm off a light at 1 km: h is right to 1e-9 where the squares' difference has 1e-4."""
    line = Lines(np.zeros((3, 1)), np.array([[0.0], [0.0], [-1.0]]), np.zeros(1), np.array([2e3]))
    lamp = relate(PointLight(position=(1e-3, 0.0, -1e3), intensity=(1, 1, 1)), line)
    assert abs(lamp.across2[0] / 1e-6 - 1) < 1e-9


@pytest.mark.parametrize("light", [LAMP, PointLight(position=(1, 0, 0), intensity=(1, 1, 1), radius=4.0)])
def test_no_kink_of_a_lamp_lies_between_cuts(light):
    """Where the lamp's region changes (window, sphere of least distance, cone), a cut is near."""
    lines = random_lines(2, 60)
    lamp = relate(light, lines)
    cuts = np.where(np.isnan(lamp_cuts(lamp)), np.inf, lamp_cuts(lamp)) + lamp.nearest[:, None]
    t = np.linspace(0, 20, 4001)
    points = tuple(lines.origin[i][:, None] + lines.direction[i][:, None] * t for i in range(3))
    towards, factor = light_at(light, points)
    d = np.sqrt(sum((p - q) ** 2 for p, q in zip(points, light.position, strict=True)))
    regions = [factor > 0.0, d < light.min_distance, d < light.radius]
    if isinstance(light, SpotLight):
        axis = np.array(light.direction) / np.linalg.norm(light.direction)
        cosine = -sum(c * a for c, a in zip(towards, axis, strict=True))
        regions += [cosine > np.cos(np.radians(angle)) for angle in (light.inner_angle, light.outer_angle)]
    changes = 0
    for region in regions:
        row, place = np.nonzero(region[:, 1:] != region[:, :-1])
        changes += len(row)
        gap = np.abs(cuts[row] - 0.5 * (t[place] + t[place + 1])[:, None]).min(axis=1)
        assert (gap <= 0.0051).all()
    assert changes > 20


@given(st.floats(-12, 12), st.booleans(), st.floats(-6, 2).map(lambda e: 10**e))
def test_the_lamp_variable_round_trips(size, negative, scale):
    s = np.array([10.0**size * scale * (-1 if negative else 1)])
    H, far = np.array([scale]), np.array([size > 0.7])
    x = to_angle(s, H, far)
    # d s/d x of the angle magnifies a rounding of x by up to |s|/H.
    loss = 1.0 if far[0] else max(abs(s[0]) / scale, 1.0)
    assert abs(from_angle(x, H, far)[0] / s[0] - 1) <= 64 * 2**-52 * loss
    step = 1e-6 * max(abs(x[0]), 1e-9)
    slope = (from_angle(x + step, H, far) - from_angle(x - step, H, far))[0] / (2 * step)
    assert slope == pytest.approx(jacobian(s, H, far)[0], rel=1e-4)
    assert slope > 0


def test_medium_cuts_enclose_every_change():
    fog = Medium(height_fog=HeightFog(start=0.0, falloff=2.0, max_height=3.0))
    lines = random_lines(4, 50)
    paths = [medium_path(place(fog), lines)]
    cuts = medium_cuts(paths, lines)
    y = lines.origin[1][:, None] + lines.direction[1][:, None] * cuts
    for level in (0.0, 3.0):
        crosses = (lines.origin[1] - level) * (lines.origin[1] + 20 * lines.direction[1] - level) < 0
        assert (np.abs(y - level).min(axis=1)[crosses] < 1e-12).all()


@pytest.mark.parametrize("extinction", [3.0, 1e3, 1e8])
def test_thickness_cuts_lie_at_their_depths(extinction):
    lines = random_lines(5, 20)
    paths = [medium_path(place(Medium(extinction=extinction)), lines)]
    factor = np.array([[extinction]])
    cuts = thickness_cuts(paths, factor, lines)
    depth = optical_depth(paths, factor, cuts)[0]
    levels = 2.0 * 8.0 ** np.arange(cuts.shape[1])
    np.testing.assert_allclose(depth, np.broadcast_to(levels, depth.shape), rtol=1e-4)
    assert levels[-1] >= min(60.0, 745.0) / 8


def test_pieces_cover_what_they_should_once():
    rng = np.random.default_rng(6)
    cuts = rng.uniform(-1, 3, (30, 7))
    cuts[rng.random(cuts.shape) < 0.3] = np.nan
    low, high = np.zeros(30), np.full(30, 2.0)
    high[:3] = -1.0
    row, start, stop = pieces(cuts, low, high, lambda rows, middle: np.ones(rows.shape, bool))
    assert (stop > start).all()
    total = np.bincount(row, weights=stop - start, minlength=30)
    np.testing.assert_allclose(total, np.maximum(high, 0.0), rtol=1e-14)
    for r, a, b in zip(row, start, stop, strict=True):
        inner = cuts[r][(cuts[r] > a) & (cuts[r] < b)]
        assert not inner.size
