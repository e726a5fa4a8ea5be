"""Where pixels were in the image of the frame before."""

from __future__ import annotations

import math

import mpmath
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from froxel_ref.geometry import SLACK
from froxel_ref.image_motion import Motion, closest_depth, from_velocity, motion
from froxel_ref.records import InputError
from froxel_ref.scene import Camera

NAN, INF = math.nan, math.inf


def camera(position=(0.0, 0.0, 0.0), towards=(0.0, 0.0, -1.0), *, fov=90.0, width=4, height=4, up=(0.0, 1.0, 0.0)):
    target = tuple(p + t for p, t in zip(position, towards, strict=True))
    return Camera(position=position, target=target, up=up, vertical_fov=fov, width=width, height=height)


def turned(degrees: float, position=(0.0, 0.0, 0.0), **options):
    """Turned to the left about the world's y axis."""
    angle = math.radians(degrees)
    return camera(position, (-math.sin(angle), 0.0, -math.cos(angle)), **options)


# --- by hand ----------------------------------------------------------------------------------------


def test_a_step_to_the_side_by_hand():
    """With 90° and 4 pixels a metre at depth d is 2/d pixels: to the right now, so things were farther right."""
    depth = np.array([[1.0, 2.0, 4.0, 8.0]])
    got = motion(depth, camera((0.5, 0.0, 0.0)), camera())
    assert got.x == pytest.approx(np.array([[0.5 + 1.0, 1.5 + 0.5, 2.5 + 0.25, 3.5 + 0.125]]), abs=1e-15)
    assert got.y.tolist() == [[0.5], [1.5], [2.5], [3.5]]
    assert got.valid.tolist() == [[True]]


def test_a_step_down_and_forwards_by_hand():
    """Half a metre down: things were lower on the screen. One forwards: depth 2 was 3, towards the middle by 2/3."""
    got = motion(np.full((1, 1), 2.0), camera((0.0, -0.5, 0.0)), camera())
    assert got.y == pytest.approx(np.array([[0.5], [1.5], [2.5], [3.5]]) + 0.5, abs=1e-15)
    got = motion(np.full((1, 1), 2.0), camera((0.0, 0.0, -1.0)), camera())
    assert got.x == pytest.approx(2.0 + (np.array([[0.5, 1.5, 2.5, 3.5]]) - 2.0) * 2.0 / 3.0, abs=1e-15)


def test_a_turn_by_hand():
    """A turn of 45° to the left: what is in the middle now was at tan(45°) to the left, the image's edge."""
    got = motion(np.full((1, 1), INF), turned(45.0, width=5, height=5), turned(0.0, width=5, height=5))
    assert got.x[0, 2] == pytest.approx(0.0, abs=1e-14)  # a column stays one, its rows are drawn apart
    assert got.y[:, 2] == pytest.approx([2.5 + math.sqrt(2.0) * j for j in (-2, -1, 0, 1, 2)], abs=1e-14)
    assert not got.valid[2, 0]


def test_a_wider_view_draws_pixels_together():
    got = motion(np.full((1, 1), 7.0), camera(fov=2 * math.degrees(math.atan(0.5))), camera())
    assert got.x == pytest.approx(np.array([[1.25, 1.75, 2.25, 2.75]]), abs=1e-14)
    assert got.y.ravel() == pytest.approx(got.x.ravel(), abs=1e-14)


# --- at rest ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("place", [(0.0, 0.0, 0.0), (3.0, -2.0, 7.0), (1e7, 2e6, -3e9)])
@pytest.mark.parametrize("dtype", [np.float64, np.float32])
def test_a_still_camera_is_the_identity_exactly(place, dtype):
    view = camera(place, (1e2, 2e2, -3e2), width=7, height=5)
    depth = np.random.default_rng(1).uniform(0.0, 1e6, (5, 7))
    depth[0, 0], depth[1, 1], depth[2, 2] = INF, NAN, 0.0
    got = motion(depth, view, view, dtype=dtype)
    assert got.x.tolist() == [[i + 0.5 for i in range(7)]]
    assert got.y.tolist() == [[j + 0.5] for j in range(5)]
    assert got.valid.all()
    assert got.x.dtype == dtype
    assert closest_depth(got, depth) is got
    assert all((v == 0.0).all() for v in got.velocity())


def test_a_camera_that_says_the_same_in_other_numbers_is_the_identity_to_rounding():
    """Another target on the same line and another `up`: the axes differ in their last digits."""
    now = Camera(position=(1, 2, 3), target=(4, 1, -2), width=960, height=540)
    then = Camera(position=(1, 2, 3), target=(1 + 0.3 * 3, 2 - 0.3, 3 - 0.3 * 5), up=(0.03, 1.0, -0.05), width=960,
                  height=540)
    got = motion(np.full((540, 960), 5.0), now, then)
    assert np.abs(got.x - (np.arange(960) + 0.5)).max() < 1e-12
    assert np.abs(got.y - (np.arange(540)[:, None] + 0.5)).max() < 1e-12


# --- against 50 digits ------------------------------------------------------------------------------


def exact_axes(view: Camera):
    """Right, up and forward."""
    def unit(v):
        length = mpmath.sqrt(sum(c * c for c in v))
        return [c / length for c in v]

    def cross(a, b):
        return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]

    forward = unit([mpmath.mpf(t) - mpmath.mpf(p) for t, p in zip(view.target, view.position, strict=True)])
    right = unit(cross(forward, [mpmath.mpf(c) for c in view.up]))
    return right, cross(right, forward), forward


def exact_position(i: int, j: int, depth: float, now: Camera, then: Camera, shape: tuple[int, int]):
    """The definition: place the point in the world, project it; None behind the camera."""
    height, width = shape
    right, up, forward = exact_axes(now)
    tangent = mpmath.tan(mpmath.radians(now.vertical_fov) / 2)
    u = tangent * now.width / now.height * (mpmath.mpf(2 * i + 1) / width - 1)
    v = tangent * (1 - mpmath.mpf(2 * j + 1) / height)
    ray = [f + r * u + p * v for f, r, p in zip(forward, right, up, strict=True)]
    if math.isinf(depth):
        relative = ray
    else:
        relative = [mpmath.mpf(a) + r * mpmath.mpf(depth) - mpmath.mpf(b)
                    for a, r, b in zip(now.position, ray, then.position, strict=True)]
    right, up, forward = exact_axes(then)
    x, y, z = (sum(a * b for a, b in zip(relative, axis, strict=True)) for axis in (right, up, forward))
    if z <= 0:
        return None
    tangent = mpmath.tan(mpmath.radians(then.vertical_fov) / 2)
    return (width * (1 + x / (z * tangent * then.width / then.height)) / 2, height * (1 - y / (z * tangent)) / 2)


def test_equals_50_digits():
    """Measured: 3e-14 of the image's size; where a point grazes the camera's plane its condition number comes on top,
    so points whose position is beyond ten images are left out."""
    random, worst, seen = np.random.default_rng(5), 0.0, 0
    with mpmath.workdps(50):
        for _ in range(40):
            shape = (int(random.integers(1, 600)), int(random.integers(1, 1000)))
            turn = random.uniform(-60, 60)
            then = turned(turn, tuple(random.normal(0, 3, 3)), fov=random.uniform(20, 120), width=16, height=9)
            now = camera(tuple(random.normal(0, 3, 3)), (random.normal(0, 0.4), random.normal(0, 0.4), -1.0),
                         fov=random.uniform(20, 120), width=16, height=9, up=(random.normal(0, 0.2), 1.0, 0.1))
            depth = random.choice([0.02, 0.7, 3.0, 1e3, 1e8, INF], shape)
            got = motion(depth, now, then, shape=shape)
            for _ in range(12):
                j, i = (int(random.integers(n)) for n in shape)
                exact = exact_position(i, j, depth[j, i], now, then, shape)
                if exact is None:
                    assert np.isnan(got.x[j, i])
                    assert not got.valid[j, i]
                    continue
                errors = [float(abs(mpmath.mpf(float(g[j, i])) - e)) / n for g, e, n in zip(
                    (got.x, got.y), exact, shape[::-1], strict=True)]
                inside = all(0 <= e <= n for e, n in zip(exact, shape[::-1], strict=True))
                assert bool(np.broadcast_to(got.valid, shape)[j, i]) == inside
                if all(abs(e) < 10 * n for e, n in zip(exact, shape[::-1], strict=True)):
                    worst, seen = max(worst, *errors), seen + 1
    assert seen > 200
    assert worst < 1e-13


@given(st.tuples(*[st.floats(-5, 5)] * 3), st.tuples(*[st.floats(-5, 5)] * 3), st.floats(-50, 50),
       st.sampled_from([0.5, 2.0, 40.0]))
def test_there_and_back(a, b, degrees, depth):
    """A point seen by one camera, looked up in the other, is found there at a depth that leads back."""
    now, then = camera(a, width=8, height=6), turned(degrees, b, width=8, height=6)
    there = motion(np.full((1, 1), depth), now, then)
    x, y = (np.broadcast_to(c, (6, 8)) for c in (there.x, there.y))
    with mpmath.workdps(30):
        axes = exact_axes(then)
        for j, i in ((0, 0), (3, 5)):
            if np.isnan(x[j, i]):
                continue
            # The world point, by the first camera's definition, must lie on the second one's ray through (x, y).
            point = [a[0] + depth * (8 / 6) * ((2 * i + 1) / 8 - 1), a[1] + depth * (1 - (2 * j + 1) / 6), a[2] - depth]
            relative = [p - q for p, q in zip(point, b, strict=True)]
            z = sum(r * f for r, f in zip(relative, axes[2], strict=True))
            if z < 0.1:
                continue
            u, v = (8 / 6) * (2 * x[j, i] / 8 - 1), 1 - 2 * y[j, i] / 6
            ray = [f + u * r + v * p for r, p, f in zip(*axes, strict=True)]
            assert all(abs(float(r * z - q)) < 1e-11 for r, q in zip(ray, relative, strict=True))


# --- depth ------------------------------------------------------------------------------------------


def test_the_background_turns_but_does_not_shift():
    now, still, moved = turned(10.0, (1.0, 2.0, 3.0)), turned(0.0, (1.0, 2.0, 3.0)), turned(0.0, (-4.0, 0.0, 9.0))
    far, turn = motion(np.full((1, 1), INF), now, moved), motion(np.full((1, 1), 1.0), now, still)
    np.testing.assert_array_equal(*(np.broadcast_to(m.x, (4, 4)) for m in (far, turn)))
    np.testing.assert_array_equal(*(np.broadcast_to(m.y, (4, 4)) for m in (far, turn)))
    near = motion(np.full((1, 1), 1e15), now, moved)
    assert np.abs(near.x - far.x).max() < 1e-13
    assert motion(np.full((1, 1), INF), camera((5.0, 0.0, 0.0)), camera()).x.tolist() == [[0.5, 1.5, 2.5, 3.5]]


def test_what_was_behind_the_camera_has_no_place():
    """The camera has moved back by 3 m: what is now at 2 m was behind it, at 3 m in its plane, at 4 m a metre ahead."""
    got = motion(np.array([[2.0, 3.0, 4.0, INF]]), camera((0.0, 0.0, 3.0)), camera())
    assert np.isnan(got.x).tolist() == [[True, True, False, False]] * len(got.x)
    assert np.broadcast_to(got.valid, (4, 4))[1].tolist() == [False, False, True, True]
    assert got.x[0, 2] == pytest.approx(2.0 + 0.5 * 4.0, abs=1e-14)


def test_depths_that_are_none():
    got = motion(np.array([[NAN, 0.0, 1.0, 1.0]]), camera((0.0, 0.0, -1.0)), camera())
    assert np.isnan(got.x[0, 0])
    assert not np.broadcast_to(got.valid, (4, 4))[0, 0]
    assert got.x[0, 1] == 2.0  # the camera's own place, a metre straight ahead of the former one
    assert np.broadcast_to(got.valid, (4, 4))[:, 1:].all()


@pytest.mark.parametrize("shape", [(1, 1), (6, 1), (1, 8), (6, 8)])
def test_depths_of_one_length_are_depths_of_the_full_one(shape):
    depth = np.random.default_rng(2).uniform(0.3, 4.0, shape)
    now, then = turned(5.0, (0.2, 0.1, 0.4), width=8, height=6), camera(width=8, height=6)
    full, got = motion(np.broadcast_to(depth, (6, 8)), now, then), motion(depth, now, then)
    for a, b in zip(full[:3], got[:3], strict=True):
        np.testing.assert_array_equal(np.broadcast_to(a, (6, 8)), np.broadcast_to(b, (6, 8)))
    assert motion(depth, now, then, dtype=np.float32).x.dtype == np.float32


def test_axes_carry_only_what_varies():
    got = motion(np.full((1, 1), 2.0), camera((0.1, 0.0, 0.0), width=8, height=6), camera(width=8, height=6))
    assert (got.x.shape, got.y.shape, got.valid.shape, got.shape) == ((1, 8), (6, 1), (1, 1), (6, 8))


def test_the_image_ends_at_its_edges():
    """Both edges belong to it, and no more than rounding beyond."""
    velocity = np.zeros((2, 1, 4))
    velocity[0] = [0.5, 0.5 + SLACK / 2, 0.0, -0.5]
    velocity[0, 0, 1] += 1.0
    got = from_velocity(velocity)
    assert got.x.tolist() == [[0.0, -SLACK / 2, 2.5, 4.0]]
    assert got.valid.all()
    velocity[0, 0, 0] += 3 * SLACK
    velocity[0, 0, 3] -= 3 * SLACK
    assert from_velocity(velocity).valid.tolist() == [[False, True, True, False]]


def test_velocity_undoes_from_velocity():
    velocity = np.random.default_rng(3).normal(0, 2, (2, 5, 7)).astype(np.float32)
    got = from_velocity(velocity)
    assert got.x.dtype == np.float32
    assert np.abs(np.stack(got.velocity()) - velocity).max() < 1e-6  # positions up to 10 in float32: half an ulp 5e-7


# --- the nearest neighbour --------------------------------------------------------------------------


def slow_closest(x, y, depth):
    height, width = depth.shape
    result = np.empty((2, height, width))
    for j in range(height):
        for i in range(width):
            best, chosen = depth[j, i], (j, i)
            if math.isnan(best):
                best = INF
            for n in range(max(j - 1, 0), min(j + 2, height)):
                for m in range(max(i - 1, 0), min(i + 2, width)):
                    if depth[n, m] < best:
                        best, chosen = depth[n, m], (n, m)
            n, m = chosen
            result[:, j, i] = i + 0.5 - (m + 0.5 - x[n, m]), j + 0.5 - (n + 0.5 - y[n, m])
    return result


@pytest.mark.parametrize("shape", [(1, 1), (1, 6), (5, 1), (2, 2), (6, 7)])
@pytest.mark.parametrize("seed", [1, 2])
def test_closest_depth_is_that_of_a_loop(shape, seed):
    random = np.random.default_rng(seed)
    velocity = random.integers(-8, 9, (2, *shape)) / 4.0
    depth = random.choice([1.0, 2.0, 3.0, INF, NAN], shape)  # with many ties
    moved = from_velocity(velocity)
    got = closest_depth(moved, depth)
    np.testing.assert_array_equal(np.stack([got.x, got.y]), slow_closest(moved.x, moved.y, depth))
    inside = (got.x >= 0) & (got.x <= shape[1]) & (got.y >= 0) & (got.y <= shape[0])
    np.testing.assert_array_equal(np.broadcast_to(got.valid, shape), inside)


def test_a_front_gives_its_motion_to_the_pixels_about_it():
    """By hand: a near pixel in the middle moves by 1 to the right; all its neighbours do too, none beyond them."""
    velocity, depth = np.zeros((2, 5, 5)), np.full((5, 5), 9.0)
    velocity[0, 2, 2], depth[2, 2] = 1.0, 1.0
    got = closest_depth(from_velocity(velocity), depth).velocity()[0]
    expected = np.zeros((5, 5))
    expected[1:4, 1:4] = 1.0
    assert np.array_equal(got, expected)


def test_what_has_no_former_place_passes_that_on():
    velocity, depth = np.zeros((2, 1, 4)), np.array([[9.0, 9.0, 9.0, 1.0]])
    velocity[0, 0, 3] = NAN
    got = closest_depth(from_velocity(velocity), depth)
    assert got.valid.tolist() == [[True, True, False, False]]


def test_equally_near_pixels_keep_their_own_motion():
    velocity = np.random.default_rng(4).normal(0, 0.2, (2, 4, 5))
    moved = from_velocity(velocity)
    for depth in (np.full((1, 1), 2.0), np.full((4, 5), INF)):
        got = closest_depth(moved, depth)
        assert np.array_equal(got.x, moved.x)
        assert np.array_equal(got.y, moved.y)


# --- bad input --------------------------------------------------------------------------------------


@pytest.mark.parametrize(("call", "line"), [
    (lambda: motion(np.ones((3, 4)), camera(), camera()), "depth_image: has shape (3, 4), must be (4, 4), or 1 along"),
    (lambda: motion(np.ones(4), camera(), camera()), "depth_image: has shape (4,)"),
    (lambda: motion(np.array([[1.0, -2.0, NAN, 1.0]]), camera(), camera()), "depth_image: holds -2, must be at least"),
    (lambda: motion(np.ones((1, 1)), camera(), camera(), shape=(0, 4)), "shape: is (0, 4), must be a height and a"),
    (lambda: motion(np.ones((1, 1)), camera(), camera(), shape=(4,)), "shape: is (4,)"),
    (lambda: from_velocity(np.zeros((3, 2, 2))), "velocity: has shape (3, 2, 2), must be (2, 2, 2)"),
    (lambda: from_velocity(np.zeros((2, 2, 3)), shape=(2, 2)), "velocity: has shape (2, 2, 3), must be (2, 2, 2)"),
    (lambda: from_velocity(np.zeros(2)), "shape: is ()"),
    (lambda: closest_depth(from_velocity(np.ones((2, 2, 2))), np.ones((2, 3))), "depth_image: has shape (2, 3)"),
])
def test_bad_input_is_one_line(call, line):
    with pytest.raises(InputError) as caught:
        call()
    assert str(caught.value).startswith(line)
    assert "\n" not in str(caught.value)


def test_motion_is_a_plain_record():
    assert Motion._fields == ("x", "y", "valid", "shape")
