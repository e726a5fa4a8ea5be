"""Moving scenes: what lies between keys, the scene at one moment, what may move and what is refused."""

from __future__ import annotations

import dataclasses
import json
import math
from itertools import pairwise
from pathlib import Path
from typing import Any
from unittest import mock

import jsonschema
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.interpolate import CubicHermiteSpline

from froxel_ref.frame import run_frame
from froxel_ref.records import InputError, Record, from_json, to_json
from froxel_ref.scene import (
    Camera,
    DensityTexture,
    DirectionalLight,
    HeightFog,
    LocalMedium,
    Medium,
    NoiseDensity,
    PointLight,
    Scene,
    SpotLight,
    Transform,
)
from froxel_ref.scene_files import Document, document, load, schema
from froxel_ref.scene_motion import Key, Track, duration, scene_at, track_values
from froxel_ref.settings import Settings

INTERPOLATIONS, REPEATS = ("linear", "smooth", "step"), ("hold", "loop", "back_and_forth")


def track(path: str, *pairs: tuple[float, Any], **options: str) -> Track:
    return Track(path=path, keys=tuple(Key(time=time, value=value) for time, value in pairs), **options)


def refusal(function: Any, *arguments: Any, **options: Any) -> str:
    """The one line with which a call is refused."""
    with pytest.raises(InputError) as caught:
        function(*arguments, **options)
    line = str(caught.value)
    assert "\n" not in line
    return line


# --- values over time -------------------------------------------------------------------------------


@pytest.mark.parametrize(("interpolation", "expected"), [
    #           -1  0  0.5     1  1.5  2  3    4  5
    ("linear", [2, 2, 3.0, 4, 4.0, 4, 2.0, 0, 0]),
    # The slope is 0 at every key: at the ends, and where the value rests. So each piece is a + (b − a)·(3τ² − 2τ³).
    ("smooth", [2, 2, 3.0, 4, 4.0, 4, 2.0, 0, 0]),
    ("step", [2, 2, 2.0, 4, 4.0, 4, 4.0, 0, 0]),
])
def test_values_by_hand(interpolation: str, expected: list[float]) -> None:
    moving = track("lights[0].radius", (0, 2), (1, 4), (2, 4), (4, 0), interpolation=interpolation)
    np.testing.assert_array_equal(track_values(moving, [-1, 0, 0.5, 1, 1.5, 2, 3, 4, 5]), expected)


def test_a_smooth_piece_by_hand() -> None:
    # Keys at 0, 1, 3 with lines of slope 1 and 2: h = 1, k = 2, so the slope at 1 is (2·1 + 1·2)/3 = 4/3. At τ = ½ the
    # cubic is (a + b)/2 + h·(p − q)/8. With a second line of slope 10, (2 + 10)/3 = 4 is beyond 3·1.
    moving = track("lights[0].radius", (0, 0), (1, 1), (3, 5), interpolation="smooth")
    np.testing.assert_allclose(track_values(moving, [0.5, 2]), [1 / 2 - 1 / 6, 3 + 2 / 6], rtol=1e-15)
    moving = track("lights[0].radius", (0, 0), (1, 1), (3, 21), interpolation="smooth")
    np.testing.assert_allclose(track_values(moving, [0.5, 2]), [1 / 2 - 3 / 8, 11 + 2 * 3 / 8], rtol=1e-15)


@pytest.mark.parametrize(("repeat", "expected"), [
    ("hold", [10, 10, 10, 10, 30, 15, 0, 0, 0, 0, 0]),
    ("loop", [10, 30, 22.5, 10, 30, 15, 10, 15, 20, 30, 10]),
    ("back_and_forth", [0, 30, 25, 10, 30, 15, 0, 7.5, 15, 30, 10]),
])
def test_repeats_by_hand(repeat: str, expected: list[float]) -> None:
    # A loop takes 4 s: −3, 5 and 9 are as 1. Back and forth, 1 − s is as 1 + s and 5 + s as 5 − s.
    moving = track("lights[0].radius", (1, 10), (3, 30), (5, 0), repeat=repeat)
    np.testing.assert_array_equal(track_values(moving, [-3, -1, -0.5, 1, 3, 4, 5, 5.5, 6, 7, 9]), expected)


@pytest.mark.parametrize("interpolation", INTERPOLATIONS)
@pytest.mark.parametrize("repeat", REPEATS)
def test_one_key_stands_for_ever(interpolation: str, repeat: str) -> None:
    moving = track("ambient", (3, (1, 2, 3)), interpolation=interpolation, repeat=repeat)
    np.testing.assert_array_equal(track_values(moving, [-9, 3, 9]), np.outer([1, 2, 3], [1, 1, 1]))


def test_a_looped_step_ends_with_its_last_key() -> None:
    moving = track("lights[0].radius", (0, 1), (1, 2), (2, 3), interpolation="step", repeat="loop")
    np.testing.assert_array_equal(track_values(moving, [0, 0.9, 1, 1.9, 2, 2.9, 3, 4]), [1, 1, 2, 2, 1, 1, 2, 1])


def test_axes_are_those_of_the_times_with_channels_first() -> None:
    alone, three = track("lights[0].radius", (0, 2), (1, 4)), track("ambient", (0, (1, 2, 3)), (1, (3, 2, 1)))
    for shape in ((), (1,), (4, 5)):
        assert track_values(alone, np.full(shape, 0.5)).shape == shape
        assert track_values(three, np.full(shape, 0.5)).shape == (3, *shape)
    assert track_values(alone, np.float32(0.5)).dtype == np.float64


@pytest.mark.parametrize("bad", [math.nan, math.inf])
def test_times_that_are_no_times_are_refused(bad: float) -> None:
    expected = "time: holds NaN or infinity, must be finite"
    assert refusal(track_values, track("ambient", (0, (1, 2, 3))), [0, bad]) == expected


def slowly(moving: Track, time: float) -> float:
    """A track of single numbers by its definition, one time after the other."""
    keys = [(key.time, key.value) for key in moving.keys]
    first, last = keys[0][0], keys[-1][0]
    if len(keys) == 1:
        return keys[0][1]
    if moving.repeat == "hold":
        time = min(max(time, first), last)
    elif moving.repeat == "loop":
        while time >= last:
            time -= last - first
        while time < first:
            time += last - first
    else:
        while not first <= time <= last:
            time = 2 * last - time if time > last else 2 * first - time
    i = max(i for i, (at, _) in enumerate(keys) if at <= time)
    if moving.interpolation == "step" or i == len(keys) - 1:
        return keys[i][1]
    (t0, a), (t1, b) = keys[i], keys[i + 1]
    tau = (time - t0) / (t1 - t0)
    if moving.interpolation == "linear":
        return a + (b - a) * tau

    def slope(n: int) -> float:
        around = [n - 1, n]
        if n in (0, len(keys) - 1):
            if moving.repeat != "loop":
                return 0.0
            around = [len(keys) - 2, 0]
        (h, d), (k, e) = [(keys[m + 1][0] - keys[m][0],
                           (keys[m + 1][1] - keys[m][1]) / (keys[m + 1][0] - keys[m][0])) for m in around]
        if d == 0 or e == 0 or (d > 0) != (e > 0):
            return 0.0
        parabola = d + (e - d) * h / (h + k)
        bound = 3 * min(abs(d), abs(e))
        return parabola if abs(parabola) <= bound else math.copysign(bound, d)

    # The four Hermite polynomials in powers.
    return ((2 * tau**3 - 3 * tau**2 + 1) * a + (tau**3 - 2 * tau**2 + tau) * (t1 - t0) * slope(i)
            + (3 * tau**2 - 2 * tau**3) * b + (tau**3 - tau**2) * (t1 - t0) * slope(i + 1))


# Times and values in quarters, so that folding is exact and no two keys nearly meet.
quarters = st.integers(-40, 40).map(lambda n: n / 4)


@st.composite
def tracks(draw: st.DrawFn, **fixed: str) -> Track:
    times = sorted(draw(st.sets(quarters, min_size=1, max_size=7)))
    values = draw(st.lists(quarters, min_size=len(times), max_size=len(times)))
    options = {"interpolation": draw(st.sampled_from(INTERPOLATIONS)), "repeat": draw(st.sampled_from(REPEATS))}
    return track("lights[0].radius", *zip(times, values, strict=True), **(options | fixed))


@given(moving=tracks(), times=st.lists(st.integers(-320, 320).map(lambda n: n / 16), min_size=1, max_size=8))
def test_values_agree_with_their_definition(moving: Track, times: list[float]) -> None:
    expected = [slowly(moving, time) for time in times]
    # Some ten operations on numbers up to 10·(1 + 3 + 3): below 70·10 roundings of 1.1e-16, 8e-14.
    np.testing.assert_allclose(track_values(moving, times), expected, rtol=0, atol=8e-14)


@given(moving=tracks())
def test_a_track_passes_through_its_keys_to_the_bit(moving: Track) -> None:
    # Times and values that are no short binary fractions.
    keys = tuple(Key(time=key.time / 3, value=key.value / 7) for key in moving.keys)
    moving = dataclasses.replace(moving, keys=keys)
    inside = keys[:-1] if moving.repeat == "loop" and len(keys) > 1 else keys
    np.testing.assert_array_equal(track_values(moving, [key.time for key in inside]), [key.value for key in inside])


def test_the_last_value_keeps_its_digits() -> None:
    # Where a + (b − a) is not b.
    for interpolation in INTERPOLATIONS:
        moving = track("camera.position[0]", (0, -0.1), (1, 4), interpolation=interpolation)
        np.testing.assert_array_equal(track_values(moving, [0, 1, 2]), [-0.1, 4, 4])


@given(moving=tracks(), share=st.floats(0, 1))
def test_no_value_leaves_those_of_the_keys_beside_it(moving: Track, share: float) -> None:
    keys = tuple(Key(time=key.time / 3, value=key.value / 7) for key in moving.keys)
    moving = dataclasses.replace(moving, keys=keys)
    for before, after in pairwise(keys):
        time = before.time + share * (after.time - before.time)
        low, high = sorted([before.value, after.value])
        # A rounding in folding may carry a time past the end of its piece, never within the first turn.
        if time < keys[-1].time or moving.repeat != "loop":
            assert low <= track_values(moving, time) <= high


@given(moving=tracks(interpolation="smooth", repeat="hold"))
def test_smooth_is_monotone_between_keys(moving: Track) -> None:
    for before, after in pairwise(moving.keys):
        steps = np.diff(track_values(moving, np.linspace(before.time, after.time, 65)))
        # Monotone but for roundings of the values: some ten operations on numbers up to 70.
        assert (steps * np.sign(after.value - before.value) > -8e-14).all()


def test_smooth_stays_within_where_three_point_slopes_overshoot() -> None:
    times, values, at = np.arange(6.0), np.array([0.0, 0, 0, 1, 1, 1]), np.linspace(0, 5, 501)
    loose = CubicHermiteSpline(times, values, np.gradient(values, times))(at)
    kept = track_values(track("lights[0].radius", *zip(times, values, strict=True), interpolation="smooth"), at)
    assert (loose.min() < -0.05, loose.max() > 1.05) == (True, True)
    assert (kept.min(), kept.max()) == (0, 1)


@given(moving=tracks(interpolation="smooth"))
def test_smooth_has_no_kink(moving: Track) -> None:
    # One-sided differences over ε differ by at most ε times the cubics' second derivatives on both sides, each at most
    # (6·|b − a| + 6·h·slope)/h² ≤ (6 + 6·3)·20/(¼)² = 7680, and by roundings of some 70·1.1e-16·10/ε.
    if moving.repeat == "loop":  # closed, or it jumps
        keys = (*moving.keys[:-1], dataclasses.replace(moving.keys[-1], value=moving.keys[0].value))
        moving = dataclasses.replace(moving, keys=keys)
    eps = 2.0**-20
    for key in moving.keys:
        left, here, right = track_values(moving, [key.time - eps, key.time, key.time + eps])
        assert abs((right - here) - (here - left)) / eps <= 2 * 7680 * eps + 1e-12 / eps


def test_a_turn_loops_without_a_kink() -> None:
    # From 0° to 360° and on: the values jump, the turn does not, and its speed is the same on both sides.
    moving = track("local_media[0].transform.rotate[1]", (0, 0), (1, 90), (2, 180), (4, 360), interpolation="smooth",
                   repeat="loop")
    eps = 2.0**-20
    before, after = track_values(moving, 4 - eps), track_values(moving, 4 + eps)
    np.testing.assert_allclose([(360 - before) / eps, after / eps], 90, rtol=1e-5)  # the cubics are straight lines
    np.testing.assert_allclose(track_values(moving, [0.25, 3, 7]), [22.5, 270, 270], rtol=1e-15)


def test_smooth_is_a_hermite_spline_of_three_point_slopes_where_the_lines_bend_little() -> None:
    # Lines' slopes between 1 and 2: no slope between them is beyond 3·1. The ends have another slope: inner keys only.
    rng = np.random.default_rng(5)
    steps = rng.uniform(0.1, 2, 40)
    times, values = np.cumsum(steps), np.cumsum(steps * rng.uniform(1, 2, 40))
    moving = track("lights[0].radius", *zip(times, values, strict=True), interpolation="smooth")
    at = rng.uniform(times[1], times[-2], 1000)
    expected = CubicHermiteSpline(times, values, np.gradient(values, times))(at)
    np.testing.assert_allclose(track_values(moving, at), expected, rtol=4e-15)  # measured: 4e-16


@pytest.mark.parametrize(("interpolation", "even", "order"), [
    ("step", True, 1), ("linear", True, 2), ("linear", False, 2), ("smooth", True, 3), ("smooth", False, 3)])
def test_the_order_of_convergence(interpolation: str, even: bool, order: int) -> None:
    # e^t on [0, 2], its keys at even distances or such that alternate 2 : 1; looked at in [½, 3/2], away from the ends.
    at = np.linspace(0.5, 1.5, 4001)
    errors = []
    for n in (32, 64, 128):
        times = np.concatenate([[0], np.cumsum(np.tile([1 / n] * 2 if even else [4 / (3 * n), 2 / (3 * n)], n))])
        moving = track("lights[0].radius", *zip(times, np.exp(times), strict=True), interpolation=interpolation)
        errors.append(np.abs(track_values(moving, at) - np.exp(at)).max())
    found = np.log2(np.divide(errors[:-1], errors[1:]))
    np.testing.assert_allclose(found, order, atol=0.05)  # measured: 0.03 off, and less with more keys


@given(moving=tracks(), time=quarters, turns=st.integers(-5, 5))
def test_what_repeats_is_periodic(moving: Track, time: float, turns: int) -> None:
    span = moving.keys[-1].time - moving.keys[0].time
    if moving.repeat == "loop":
        assert track_values(moving, time) == track_values(moving, time + turns * span)
    elif moving.repeat == "back_and_forth":
        assert track_values(moving, time) == track_values(moving, time + turns * 2 * span)
        assert track_values(moving, time) == track_values(moving, 2 * moving.keys[0].time - time)


# --- the scene at one moment ------------------------------------------------------------------------

SUN = DirectionalLight(direction=(0, 1, 0), irradiance=(1, 1, 1))
LAMP = PointLight(position=(0, 2, 0), intensity=(1, 1, 1), radius=4)
SPOT = SpotLight(position=(0, 2, 0), power=(1, 1, 1))
MIST = LocalMedium(density=DensityTexture(source=NoiseDensity(size=4)), extinction=(1, 2, 3))
PLACES = Scene(name="places", global_media=(Medium(height_fog=HeightFog()),), local_media=(MIST,),
               lights=(SUN, LAMP, SPOT))


def at_path(whole: Any, *steps: Any) -> Any:
    for step in steps:
        whole = whole[step] if isinstance(step, int) else getattr(whole, step)
    return whole


@pytest.mark.parametrize(("path", "value", "steps"), [
    ("camera.position", (1.0, 2.0, 3.0), ("camera", "position")),
    ("camera.position[1]", 5.0, ("camera", "position", 1)),
    ("camera.vertical_fov", 35.0, ("camera", "vertical_fov")),
    ("ambient", (1.0, 2.0, 3.0), ("ambient",)),
    ("background[2]", 2.0, ("background", 2)),
    ("lights[0].irradiance", (1.0, 2.0, 3.0), ("lights", 0, "irradiance")),
    ("lights[1].radius", 3.0, ("lights", 1, "radius")),
    ("lights[2].power[0]", 3.0, ("lights", 2, "power", 0)),
    ("global_media[0].extinction", 0.5, ("global_media", 0, "extinction")),
    ("global_media[0].extinction", (1.0, 2.0, 3.0), ("global_media", 0, "extinction")),
    ("global_media[0].height_fog.max_height", 3.0, ("global_media", 0, "height_fog", "max_height")),
    ("local_media[0].extinction[1]", 9.0, ("local_media", 0, "extinction", 1)),
    ("local_media[0].transform.translate", (1.0, 2.0, 3.0), ("local_media", 0, "transform", "translate")),
    ("local_media[0].density.bias[0]", 0.25, ("local_media", 0, "density", "bias", 0)),
    ("extra_lights.intensity", 2.0, ("extra_lights", "intensity")),
])
def test_a_value_is_put_in_its_place_and_nowhere_else(path: str, value: Any, steps: tuple[Any, ...]) -> None:
    moved = scene_at(dataclasses.replace(PLACES, tracks=(track(path, (0, value), (1, value)),)), 0.3)
    assert at_path(moved, *steps) == value
    assert at_path(PLACES, *steps) != value
    assert moved.tracks == ()
    # An override of the same path, which knows nothing of tracks, makes the same scene.
    raw = to_json(PLACES)
    inner = raw
    for step in steps[:-1]:
        inner = inner[step]
    inner[steps[-1]] = list(value) if isinstance(value, tuple) else value
    assert moved == from_json(Scene, raw)


def test_several_tracks_move_one_record_at_once() -> None:
    # The camera walks through the point at which it looks, and so would be there between one track and the other.
    scene = dataclasses.replace(PLACES, tracks=(
        track("camera.position[2]", (0, 0), (2, -4)), track("camera.target[2]", (0, -1), (2, -5)),
        track("camera.position[0]", (0, 0), (1, 1)), track("lights[1].radius", (0, 4), (4, 8)),
        track("lights[2].outer_angle", (0, 30), (4, 80)), track("lights[2].inner_angle", (0, 20), (4, 60))))
    camera = Camera(position=(0.5, 1.7, -1), target=(0, 1.7, -2))
    lights = (SUN, dataclasses.replace(LAMP, radius=4.5),
              dataclasses.replace(SPOT, inner_angle=25, outer_angle=36.25))
    assert scene_at(scene, 0.5) == dataclasses.replace(PLACES, camera=camera, lights=lights)
    assert scene_at(scene, 4).lights[2].inner_angle == 60  # beyond the outer angle of the scene as it stands


def test_a_scene_without_tracks_is_its_own_moment() -> None:
    assert scene_at(PLACES, 3) is PLACES
    moment = scene_at(dataclasses.replace(PLACES, tracks=(track("ambient", (0, (1, 1, 1))),)), 3)
    assert scene_at(moment, 5) is moment


def test_numbers_in_a_moment_are_plain() -> None:
    scene = dataclasses.replace(PLACES, tracks=(track("ambient", (0, (1, 1, 1))), track("lights[1].radius", (0, 2))))
    moment = scene_at(scene, np.float32(0.5))
    assert [type(part) for part in (*moment.ambient, moment.lights[1].radius)] == [float] * 4
    assert hash(moment) == hash(scene_at(scene, 0.5))


@pytest.mark.parametrize(("time", "expected"), [
    (math.nan, "time: is nan, must be a finite number"),
    ("now", "time: is 'now', must be a finite number"),
    (1e11, "time: is 100000000000, must be within -1e+10 and 1e+10 s"),
])
def test_a_moment_that_is_no_time_is_refused(time: Any, expected: str) -> None:
    assert refusal(scene_at, PLACES, time) == expected


def test_what_does_not_go_together_between_keys_is_named_with_its_time() -> None:
    scene = dataclasses.replace(PLACES, tracks=(
        track("ambient", (0, (0, 0, 0)), (1, (1, 1, 1))), track("lights[0].direction[1]", (0, 1), (1, -1))))
    assert scene_at(scene, 0.25).lights[0].direction == (0, 0.5, 0)
    expected = "lights[0].direction: is zero, must point somewhere (tracks[1] at 0.5 s)"
    assert refusal(scene_at, scene, 0.5) == expected


def test_duration() -> None:
    assert duration(PLACES) == 0
    moving = (track("ambient", (0, (1, 1, 1)), (3, (1, 2, 1))), track("lights[1].radius", (-5, 2), (7.5, 3)))
    assert duration(dataclasses.replace(PLACES, tracks=moving)) == 7.5
    assert duration(dataclasses.replace(PLACES, tracks=moving[:1])) == 3


def test_a_frame_of_a_moment_is_that_of_the_scene_written_by_hand() -> None:
    scene, settings, _ = load("uniform", overrides=["camera.width=8", "camera.height=4", "grid.width=4",
                                                    "grid.height=2", "grid.depth=4"])
    brighter = dataclasses.replace(scene.lights[0], irradiance=(2, 3, 4))
    moving = dataclasses.replace(scene, tracks=(track("lights[0].irradiance", (0, (1, 1, 1)), (2, (3, 5, 7))),))
    expected = run_frame(dataclasses.replace(scene, lights=(brighter,)), settings).results
    found = run_frame(scene_at(moving, 1), settings).results
    assert found.keys() == expected.keys()
    for name, array in expected.items():
        np.testing.assert_array_equal(found[name], array)


# --- what may move ----------------------------------------------------------------------------------


def every_place(whole: Any, path: str = "") -> list[tuple[str, Any]]:
    """The path of all that a scene holds, and the JSON Schema of it, None for what stands within a vector."""
    found = []
    for field in dataclasses.fields(whole):
        inner, value = f"{path}.{field.name}" if path else field.name, getattr(whole, field.name)
        found.append((inner, field.metadata["kind"].schema()))
        if isinstance(value, Record):
            found += every_place(value, inner)
        elif isinstance(value, tuple):
            for i, item in enumerate(value):
                if isinstance(item, Record):
                    found += [(f"{inner}[{i}]", {"$ref": ""}), *every_place(item, f"{inner}[{i}]")]
    return found


def whole_scene() -> Scene:
    """A scene in which nearly every class stands."""
    return load("thesis-hall", overrides=[
        'global_media[0].density={"source": {"type": "file", "path": "a"}}', 'particles=[{"type": "cloud"},'
        '{"type": "particle", "position": [0, 0, 0]}]', 'surfaces=[{"type": "plane"}, {"type": "sphere"},'
        '{"type": "box"}, {"type": "mesh", "path": "a"}, {"type": "height_field", "heights": {"type": "folds"}}]',
        'lights=[{"type": "spot", "position": [0, 0, 0], "intensity": [1, 1, 1]},'
        '{"type": "directional", "direction": [0, 1, 0], "irradiance": [1, 1, 1]}]']).scene


WHOLE = whole_scene()


@pytest.mark.parametrize(("path", "fields"), every_place(WHOLE))
def test_only_real_numbers_and_vectors_of_them_move(path: str, fields: dict[str, Any]) -> None:
    each = fields.get("anyOf", [fields])[0]
    each = each["items"] if each.get("type") == "array" else each
    moves = each.get("type") == "number" and ".source." not in path
    now = at_path(WHOLE, *(int(step) if step.isdigit() else step
                           for step in path.replace("[", ".").replace("]", "").split(".")))
    numbers = isinstance(now, float) or (isinstance(now, tuple) and now and isinstance(now[0], float))
    moving = track(path, (0, now if numbers else 1.0))
    if moves and numbers:
        assert scene_at(dataclasses.replace(WHOLE, tracks=(moving,)), 1) == WHOLE
    elif not moves:
        assert refusal(dataclasses.replace, WHOLE, tracks=(moving,)).startswith(f"tracks[0].path: is '{path}'")


def test_most_of_a_scene_moves() -> None:
    assert sum(fields.get("type") == "number" for _, fields in every_place(WHOLE)) > 20
    assert len(every_place(WHOLE)) > 90


REAL = "must be a real number or a vector of them"


@pytest.mark.parametrize(("path", "problem"), [
    ("", "is '', must be a path such as lights[2].radius"),
    ("lights[-1].radius", "is 'lights[-1].radius', must be a path such as lights[2].radius"),
    ("camera.", "is 'camera.', must be a path such as lights[2].radius"),
    ("lights[" + "1" * 19 + "].radius", f"is 'lights[{'1' * 19}].radius', must be a path such as lights[2].radius"),
    ("scene.camera.position", "is 'scene.camera.position', must begin within the scene, without 'scene.'"),
    ("camera.positon", "is 'camera.positon', but 'positon' is not a key of camera; did you mean 'position'?"),
    ("lihgts[0].radius", "is 'lihgts[0].radius', but 'lihgts' is not a key; did you mean 'lights'?"),
    ("lights[3].radius", "is 'lights[3].radius', but lights has only 3"),
    ("surfaces[0].albedo", "is 'surfaces[0].albedo', but surfaces is empty"),
    ("camera.position[3]", "is 'camera.position[3]', but camera.position has only 3"),
    ("lights.radius", "is 'lights.radius', but lights is a list of records, has no key 'radius'"),
    ("camera[0]", "is 'camera[0]', but camera is a record, not a list"),
    ("camera.exposure[0]", "is 'camera.exposure[0]', but camera.exposure is one number, not a list"),
    ("camera.position.x", "is 'camera.position.x', but camera.position is a list of numbers, has no key 'x'"),
    ("camera.position[0][0]", "is 'camera.position[0][0]', but camera.position[0] is one number, not a list"),
    ("global_media[0].extinction[0]",
     "is 'global_media[0].extinction[0]', but global_media[0].extinction is one number, not a list"),
    ("lights[1].power[0]", "is 'lights[1].power[0]', but lights[1].power is null, not a list"),
    ("global_media[0].density.bias",
     "is 'global_media[0].density.bias', but global_media[0].density is null, has no key 'bias'"),
    ("camera.width", f"is 'camera.width', a whole number, {REAL}"),
    ("extra_lights.count", f"is 'extra_lights.count', a whole number, {REAL}"),
    ("name", f"is 'name', a word, {REAL}"),
    ("lights[1].falloff", f"is 'lights[1].falloff', a word, {REAL}"),
    ("lights[1].shadow_map", f"is 'lights[1].shadow_map', a word, {REAL}"),
    ("lights[1].casts_shadows", f"is 'lights[1].casts_shadows', true or false, {REAL}"),
    ("lights", f"is 'lights', a list of records, {REAL}"),
    ("camera", f"is 'camera', a record, {REAL}"),
    ("image_buffers", f"is 'image_buffers', null, {REAL}"),
    ("tracks[1].keys[0].time", "is 'tracks[1].keys[0].time', must be something else than a track"),
    ("tracks", "is 'tracks', must be something else than a track"),
    ("local_media[0].density.source.contrast",
     "is 'local_media[0].density.source.contrast', but local_media[0].density.source is made into a texture once, "
     "must not move"),
])
def test_a_path_that_leads_to_nothing_that_moves_is_refused(path: str, problem: str) -> None:
    moving = (track("ambient", (0, (1, 1, 1))), track(path, (0, 1)))
    assert refusal(dataclasses.replace, PLACES, tracks=moving) == f"tracks[1].path: {problem}"


@pytest.mark.parametrize(("first", "second", "how"), [
    ("camera.position", "camera.position", "like camera.position"),
    ("lights[1].radius", "lights[01].radius", "like lights[1].radius"),
    ("camera.position", "camera.position[0]", "inside camera.position"),
    ("camera.position[0]", "camera.position", "around camera.position[0]"),
])
def test_the_same_must_not_move_twice(first: str, second: str, how: str) -> None:
    values = {path: 2 if path[-1] in "]s" else (2, 2, 2) for path in (first, second)}
    moving = (track(first, (0, values[first])), track("ambient", (0, (1, 1, 1))), track(second, (0, values[second])))
    shown = second.replace("01", "1")
    assert refusal(dataclasses.replace, PLACES, tracks=moving) == (
        f"tracks[2].path: is '{shown}', {how} of tracks[0], must be something else")


def test_neighbours_may_move() -> None:
    moving = [track(f"camera.position[{i}]", (0, 1 + i)) for i in range(3)]
    scene = dataclasses.replace(PLACES, tracks=(*moving, track("camera.target", (0, (0, 0, 0)))))
    assert scene_at(scene, 0).camera.position == (1, 2, 3)


@pytest.mark.parametrize(("moving", "expected"), [
    ([track("lights[1].radius", (0, 1), (2.5, -1))],
     "lights[1].radius: is -1, must be above 0 m (tracks[0] at 2.5 s)"),
    ([track("ambient", (0, (1, 1, 1))), track("lights[1].intensity", (1, (1, 1, -1)))],
     "lights[1].intensity[2]: is -1, must be at least 0 W/sr (tracks[1] at 1 s)"),
    ([track("camera.position", (0, (1, 2)))], "camera.position: has 2 numbers, must have 3 (tracks[0] at 0 s)"),
    ([track("camera.position", (0, 1))], "camera.position: is 1.0, must be 3 numbers (tracks[0] at 0 s)"),
    ([track("camera.position[0]", (0, (1, 2)))],
     "camera.position[0]: is (1.0, 2.0), must be a finite number (tracks[0] at 0 s)"),
    ([track("camera.position[0]", (0, 1e17))],
     "camera.position[0]: is 1e+17, must be within -1e+10 and 1e+10 m (tracks[0] at 0 s)"),
    # Rules between fields, by the tracks that lead to the place, else those of its part.
    ([track("lights[2].inner_angle", (0, 10), (1, 30))],
     "lights[2].inner_angle: is 30, must be below outer_angle (30) (tracks[0] at 1 s)"),
    ([track("lights[1].radius", (0, 1)), track("lights[2].outer_angle", (0, 40), (1, 15))],
     "lights[2].inner_angle: is 20, must be below outer_angle (15) (tracks[1] at 1 s)"),
    ([track("lights[2].inner_angle", (0, 20), (2, 40)), track("lights[2].outer_angle", (0, 30), (1, 28), (2, 50))],
     "lights[2].inner_angle: is 30, must be below outer_angle (28) (tracks[0] at 1 s)"),
    ([track("lights[0].irradiance", (0, (1, 1, 1))), track("lights[0].direction[1]", (0, 1), (4, 0))],
     "lights[0].direction: is zero, must point somewhere (tracks[1] at 4 s)"),
    ([track("camera.target", (0, (0, 1.7, -9))), track("camera.position", (1, (0, 9, -9)))],
     "camera.up: is along the view direction, must be across it (tracks[0], tracks[1] at 0 s)"),
    ([track("local_media[0].transform.scale", (0, (1, 1, 1)), (1, (1, 0, 1)))],
     "local_media[0].transform.scale: makes the transform singular, must span all three axes (tracks[0] at 1 s)"),
    ([track("lights[1].power", (0, (1, 1, 1)))],
     "lights[1].intensity: is given beside power, must be given instead of it (tracks[0] at 0 s)"),
    ([track("camera.target", (0, (0, 1.7, -9)), (3, (0, 1.7, 0)))],
     "camera.target: is the camera's position, must be another point (tracks[0] at 3 s)"),
])
def test_a_bad_value_is_found_when_the_scene_is_made(moving: list[Track], expected: str) -> None:
    assert refusal(dataclasses.replace, PLACES, tracks=tuple(moving)) == expected


def test_the_last_value_of_a_loop_is_checked_though_never_reached() -> None:
    moving = track("lights[1].radius", (0, 1), (1, 0), repeat="loop")
    assert refusal(dataclasses.replace, PLACES, tracks=(moving,)) == (
        "lights[1].radius: is 0, must be above 0 m (tracks[0] at 1 s)")


@pytest.mark.parametrize(("raw", "expected"), [
    ({}, "path: is missing (what changes, such as camera.position or lights[2].position[1])"),
    ({"path": "ambient"}, "keys: is missing (its values, in growing time; at least one)"),
    ({"path": "ambient", "keys": []}, "keys: is empty, must hold at least one key"),
    ({"path": "ambient", "keys": [{"time": 0}]},
     "keys[0].value: is missing (the number, or the list of numbers, at that time)"),
    ({"path": "ambient", "keys": [{"value": 0}]}, "keys[0].time: is missing (when)"),
    ({"path": "ambient", "keys": [{"time": 1, "value": 0}, {"time": 0.5, "value": 1}]},
     "keys[1].time: is 0.5 s, must be later than keys[0], 1 s, by 1e-09 s or more"),
    ({"path": "ambient", "keys": [{"time": 1, "value": 0}, {"time": 1, "value": 1}]},
     "keys[1].time: is 1 s, must be later than keys[0], 1 s, by 1e-09 s or more"),
    ({"path": "ambient", "keys": [{"time": 0, "value": [1, 2]}, {"time": 1, "value": 1}]},
     "keys[1].value: is one number, must be a list of 2 like that of keys[0]"),
    ({"path": "ambient", "keys": [{"time": 0, "value": 1}, {"time": 1, "value": [1]}]},
     "keys[1].value: is a list of 1, must be one number like that of keys[0]"),
    ({"path": "ambient", "keys": [{"time": 0, "value": []}]},
     "keys[0].value: is an empty list, must hold at least one number"),
    ({"path": "ambient", "keys": [{"time": 0, "value": "red"}]},
     "keys[0].value: is 'red', must be a list of numbers or one number"),
    ({"path": "ambient", "keys": [{"time": 0, "value": [1, 1e19, 1]}]},
     "keys[0].value[1]: is 1e+19, must be within -1e+18 and 1e+18"),
    ({"path": "ambient", "keys": [{"time": 0, "value": 1}], "interpolation": "cubic"},
     "interpolation: is 'cubic', must be one of linear, smooth, step"),
    ({"path": "ambient", "keys": [{"time": 0, "value": 1}], "repeat": "yes"},
     "repeat: is 'yes', must be one of hold, loop, back_and_forth"),
])
def test_a_track_that_is_none_is_refused(raw: dict[str, Any], expected: str) -> None:
    assert refusal(from_json, Track, raw) == expected
    assert refusal(from_json, Scene, {"tracks": [raw]}) == f"tracks[0].{expected}"


@pytest.mark.parametrize("interpolation", INTERPOLATIONS)
@pytest.mark.parametrize("repeat", REPEATS)
def test_the_farthest_numbers_stay_finite(interpolation: str, repeat: str) -> None:
    moving = track("ambient", *((i * 2e-9, (-1) ** (i // 2) * 1e18) for i in range(8)), interpolation=interpolation,
                   repeat=repeat)
    with np.errstate(all="raise"):
        values = track_values(moving, np.linspace(-2e-8, 2e-8, 101))
    assert np.abs(values).max() <= 1e18


def test_a_scene_is_checked_at_its_keys_only() -> None:
    moving = (track("camera.position[2]", *((i / 8, i / 8 + 1) for i in range(100))),
              track("camera.exposure", (0, 1), (0.05, 2)), track("lights[1].radius", (7, 1)))
    count = mock.Mock(return_value=None)
    with mock.patch.object(Camera, "check_together", count):
        dataclasses.replace(PLACES, tracks=moving)
    assert count.call_count == 101  # 100 times and 2, of which one is the same


# --- files ------------------------------------------------------------------------------------------

MOVING = {"schema": 1, "scene": {
    "name": "moving", "camera": {"width": 8, "height": 4},
    "lights": [{"type": "point", "position": [0, 2, -3], "intensity": [1, 1, 1]}],
    "tracks": [{"path": "camera.position", "interpolation": "smooth",
                "keys": [{"time": 0, "value": [0, 1.7, 0]}, {"time": 4, "value": [2, 1.7, 0]}]},
               {"path": "lights[0].radius", "keys": [{"time": 0, "value": 4}, {"time": 1, "value": 6}],
                "repeat": "back_and_forth"}]}}


@pytest.fixture
def file(tmp_path: Path) -> Path:
    """A scene file with tracks."""
    (tmp_path / "moving.json").write_text(json.dumps(MOVING))
    return tmp_path / "moving.json"


def test_tracks_come_back_from_a_file(file: Path) -> None:
    scene, settings, _ = load(file)
    assert scene.tracks == (
        track("camera.position", (0, (0, 1.7, 0)), (4, (2, 1.7, 0)), interpolation="smooth"),
        track("lights[0].radius", (0, 4), (1, 6), repeat="back_and_forth"))
    written = document(scene, settings)
    jsonschema.Draft202012Validator(schema()).validate(written)
    assert from_json(Document, json.loads(json.dumps(written))).scene == scene
    moment = scene_at(scene, 1.5)
    again = from_json(Document, json.loads(json.dumps(document(moment, Settings())))).scene
    assert again == moment
    assert moment.lights[0].radius == 5


@pytest.mark.parametrize(("override", "read", "value"), [
    ("tracks[0].keys[1].time=2", lambda s: s.tracks[0].keys[1].time, 2),
    ("scene.tracks[0].keys[1].value[0]=3", lambda s: s.tracks[0].keys[1].value, (3, 1.7, 0)),
    ("tracks[1].keys[0].value=5", lambda s: s.tracks[1].keys[0].value, 5),
    ("tracks[0].interpolation=step", lambda s: s.tracks[0].interpolation, "step"),
    ("tracks[1].path=camera.exposure", lambda s: s.tracks[1].path, "camera.exposure"),
    ("tracks[1].repeat=loop", lambda s: s.tracks[1].repeat, "loop"),
    ("tracks=[]", lambda s: s.tracks, ()),
])
def test_overrides_reach_into_tracks(file: Path, override: str, read: Any, value: Any) -> None:
    assert read(load(file, overrides=[override]).scene) == value


@pytest.mark.parametrize(("override", "expected"), [
    ("tracks[1].keys[1].value=-6", "scene.lights[0].radius: is -6, must be above 0 m (tracks[1] at 1 s)"),
    ("tracks[1].path=camera.width",
     f"scene.tracks[1].path: is 'camera.width', a whole number, {REAL}"),
    ("tracks[0].keys[1].time=-2",
     "scene.tracks[0].keys[1].time: is -2 s, must be later than keys[0], 0 s, by 1e-09 s or more"),
    ("lights=[]", "scene.tracks[1].path: is 'lights[0].radius', but lights is empty"),
])
def test_a_fault_in_a_file_is_named_from_its_root(file: Path, override: str, expected: str) -> None:
    assert refusal(load, file, overrides=[override]) == expected


def test_a_moving_transform_is_that_of_its_numbers() -> None:
    moving = track("local_media[0].transform.rotate", (0, (0, 0, 0)), (1, (0, 90, 0)))
    moved = scene_at(dataclasses.replace(PLACES, tracks=(moving,)), 1)
    assert moved.local_media[0].transform == Transform(rotate=(0, 90, 0))
