"""The temporal stage in frames: rest, averages, jitter's mean, remedies, exposure, cuts, and what is left out."""

from __future__ import annotations

import dataclasses
import itertools

import numpy as np
import pytest

from froxel_ref.frame import FINAL, Frame, plan, run_frame
from froxel_ref.grid import make_froxels
from froxel_ref.jitter import froxel_jitter
from froxel_ref.lighting import in_scattering
from froxel_ref.media import voxelise
from froxel_ref.records import InputError
from froxel_ref.scene import Box, Camera, DirectionalLight, LocalMedium, Medium, Plane, PointLight, Scene, Transform
from froxel_ref.settings import Grid, Settings, Temporal, replace

GRID = Grid(width=12, height=7, depth=8, near=0.5, far=16.0)
SUN = DirectionalLight(direction=(0.3, 1.0, 0.2), irradiance=(3, 2, 1))
LAMP = PointLight(position=(0.4, 1.5, -5.0), intensity=(9, 5, 2), radius=7)
FOG = Medium(extinction=0.08, phase_anisotropy=0.6)
BALL = LocalMedium(extinction=0.7, transform=Transform(translate=(0.3, 1.5, -5), scale=(1.5, 1, 1.2)))
HALL = Scene(camera=Camera(width=24, height=14), global_media=(FOG,), local_media=(BALL,), lights=(SUN, LAMP),
             surfaces=(Plane(), Box(transform=Transform(translate=(0.5, 3, -5), scale=(0.7, 0.1, 0.7)))))


def how(**temporal: object) -> Settings:
    return Settings(grid=GRID, temporal=Temporal(**({"filter": "scattering"} | temporal)))  # type: ignore[arg-type]


def frames(scene: Scene, settings: Settings, count: int, **more: object) -> list[Frame]:
    made: list[Frame] = []
    for n in range(count):
        made.append(run_frame(scene, settings, frame=n, previous=made[-1] if made else None, **more))  # type: ignore[arg-type]
    return made


def current(scene: Scene, settings: Settings, frame: int) -> tuple[np.ndarray, np.ndarray]:
    """In-scattering and extinction of one frame at its own samples, past every filter."""
    plain = replace(settings, temporal=Temporal(), checkerboard=False, shadows="off")
    froxels = make_froxels(scene.camera, settings.grid, jitter=froxel_jitter(frame))
    buffer = voxelise(scene, froxels, {}, plain)
    return in_scattering(buffer, scene.lights, froxels), np.broadcast_to(buffer.extinction, (8, 7, 12))


def test_the_average_is_equation_3_2() -> None:
    """Against a loop over frames that are made one by one: the weights of five of them."""
    scene = dataclasses.replace(HALL, surfaces=())
    made = frames(scene, how(alpha=0.25), 5)
    light, dense = current(scene, made[0].settings, 0)
    for n, frame in enumerate(made):
        if n:
            now, thick = current(scene, frame.settings, n)
            light, dense = 0.25 * now + 0.75 * light, 0.25 * thick + 0.75 * dense
        np.testing.assert_allclose(frame["temporal/in_scattering"], light, rtol=1e-13, atol=1e-15)
        np.testing.assert_allclose(np.broadcast_to(frame["temporal/extinction"], dense.shape), dense, rtol=1e-13)
    assert not np.allclose(made[0]["temporal/in_scattering"], made[4]["temporal/in_scattering"], rtol=1e-3)


def test_without_jitter_rest_is_rest() -> None:
    """Every bit, borders too: the same samples, and history from the same texels."""
    still = replace(how(), jitter="off")
    first, *rest = frames(HALL, still, 4)
    plain = run_frame(HALL, Settings(grid=GRID))
    for frame in rest:
        for name in ("temporal/in_scattering", "temporal/extinction", FINAL):
            np.testing.assert_array_equal(frame[name], first[name])
    np.testing.assert_array_equal(first[FINAL], plain[FINAL])


@pytest.mark.parametrize("points", ["centred", "published", "author"])
def test_where_a_filter_looks_on_average(points: str) -> None:
    """D10 and A2: of a field that is linear over the froxels a whole cycle's mean is the value at its mean point.

    A medium whose extinction is linear along x, made by a light that falls linearly is not at hand; so the samples'
    places themselves are averaged: (i + mean) is where a linear field would be read.
    """
    cycle = np.array([froxel_jitter(f, points=points) for f in range(32)])
    settings = replace(how(alpha=1.0), jitter=points)
    for n in (0, 1, 7):
        froxels = make_froxels(HALL.camera, GRID, jitter=tuple(cycle[n]))
        frame = run_frame(HALL, replace(settings, shadows="off"), frame=n)
        plain = Settings(grid=GRID, shadows="off")
        buffer = voxelise(HALL, froxels, {}, plain)
        np.testing.assert_array_equal(frame["media/extinction"], buffer.extinction)
    assert np.abs(cycle.mean(axis=0) - 0.5).max() < (1e-12 if points == "centred" else 0.3)
    assert points == "centred" or np.abs(cycle.mean(axis=0) - 0.5).max() > 0.01


def test_the_mean_of_a_cycle_tends_to_the_integral_over_the_froxel() -> None:
    """In-scattering of 32 jittered frames against the mean over 8×8×8 samples in each froxel, beside one frame's."""
    sunny = dataclasses.replace(HALL, lights=(SUN,))  # a lamp within a froxel is no field that 32 points could average
    fine = dataclasses.replace(GRID, width=96, height=56, depth=64)
    many = run_frame(sunny, Settings(grid=fine))["lighting/in_scattering"]
    truth = many.reshape(3, 8, 8, 7, 8, 12, 8).mean(axis=(2, 4, 6))
    one = run_frame(sunny, Settings(grid=GRID))["lighting/in_scattering"]
    filtered = frames(sunny, how(start="mean"), 32)[-1]["temporal/in_scattering"]
    errors = [float(np.sqrt(np.mean((field - truth) ** 2))) for field in (one, filtered)]
    assert errors[1] < 0.35 * errors[0]  # 0.28 measured; 32 independent samples of a field without edges: 0.18


def test_start_by_the_mean() -> None:
    made = frames(HALL, replace(how(start="mean"), shadows="off"), 6)
    want = np.mean([current(HALL, made[0].settings, n)[0] for n in range(6)], axis=0)
    np.testing.assert_allclose(made[-1]["temporal/in_scattering"], want, rtol=1e-12, atol=1e-15)


@pytest.mark.parametrize("filter", ["scattering", "unphased"])
def test_a_vanished_light_leaves_a_ghost_and_remedies_shorten_it(filter: str) -> None:
    """(1 − α)^n of it without; at once with a clamp; faster with a weight that rises."""
    dark = dataclasses.replace(HALL, lights=(SUN,))
    shares = {}
    for name, more in (("none", {}), ("range", {"clamp": "range"}), ("deviation", {"clamp": "deviation"}),
                       ("weight", {"alpha_most": 0.5})):
        settings = replace(how(filter=filter, alpha=0.1, **more), jitter="off", shadows="off")
        lit = frames(HALL, settings, 2)[-1]
        before, left = lit, []
        for n in range(2, 8):
            before = run_frame(dark, settings, frame=n, previous=before)
            left.append(before["temporal/in_scattering"].sum())
        want = run_frame(dark, settings)["temporal/in_scattering"].sum()
        shares[name] = (np.array(left) - want) / (lit["temporal/in_scattering"].sum() - want)
    if filter == "scattering":
        np.testing.assert_allclose(shares["none"], 0.9 ** np.arange(1, 7), rtol=1e-9)
    assert shares["range"][0] < 0.5 * shares["none"][0]
    assert shares["deviation"][0] < 0.6 * shares["none"][0]
    assert shares["weight"][5] < 0.5 * shares["none"][5]


def test_unphased_history_knows_no_direction() -> None:
    """A camera that turns about its axis in uniform fog: what is kept has the current phase function at once."""
    scene = Scene(camera=Camera(width=24, height=14), global_media=(FOG,), lights=(SUN,))
    turned = dataclasses.replace(scene, camera=Camera(width=24, height=14, target=(1.0, 1.9, -1.0)))
    errors = {}
    for filter in ("scattering", "unphased"):
        settings = replace(how(filter=filter, alpha=0.05), jitter="off")
        before = frames(scene, settings, 3)[-1]
        now = run_frame(turned, settings, frame=3, previous=before)
        want = run_frame(turned, Settings(grid=GRID))["lighting/in_scattering"]
        errors[filter] = float(np.abs(now["temporal/in_scattering"] / want - 1.0).max())
    assert errors["unphased"] < 1e-12
    assert errors["scattering"] > 0.05


def test_unphased_is_the_published_filter_at_rest() -> None:
    """Jitter, shadows, a lamp and the sun  and two media: the ratio of phase functions stays, so it cancels."""
    made = {filter: frames(HALL, replace(how(filter=filter)), 5)[-1] for filter in ("scattering", "unphased")}
    np.testing.assert_allclose(made["unphased"]["temporal/in_scattering"], made["scattering"]["temporal/in_scattering"],
                               rtol=1e-12)
    assert made["unphased"]["lighting/phase_ratio"].std() > 0.1


def test_exposure_of_the_history() -> None:
    """A12: in-scattering holds the exposure; what an earlier frame held is rescaled, extinction is not."""
    bright = dataclasses.replace(HALL, camera=dataclasses.replace(HALL.camera, exposure=4.0))
    settings = replace(how(), jitter="off", exposure="lighting")
    first = run_frame(HALL, settings)
    then = run_frame(bright, settings, frame=1, previous=first)
    np.testing.assert_allclose(then["temporal/in_scattering"], 4.0 * first["temporal/in_scattering"], rtol=1e-14)
    np.testing.assert_array_equal(then["temporal/extinction"], first["temporal/extinction"])


def test_what_was_out_of_view_has_no_history() -> None:
    """A pan by a right angle: nothing is left of the frame before."""
    away = dataclasses.replace(HALL, camera=Camera(width=24, height=14, target=(1.0, 1.7, 0.0)))
    settings = replace(how(), jitter="off")
    then = run_frame(away, settings, frame=1, previous=run_frame(HALL, settings))
    assert then["temporal/valid"].mean() < 0.1
    alone = run_frame(away, settings, frame=1)
    lost = np.broadcast_to(then["temporal/valid"], (8, 7, 12)) == 0.0
    np.testing.assert_array_equal(then["temporal/in_scattering"][:, lost], alone["temporal/in_scattering"][:, lost])


def test_a_cut_begins_anew() -> None:
    before = run_frame(HALL, how())
    cut, fresh = (run_frame(HALL, how(), frame=1, **more) for more in ({"previous": before, "cut": True}, {}))
    np.testing.assert_array_equal(cut[FINAL], fresh[FINAL])
    assert cut.history is not None
    assert cut.history.length == 1


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_a_history_that_is_no_number_lasts_one_frame(bad: float) -> None:
    first = run_frame(HALL, how())
    assert first.history is not None
    spoiled = {name: field.copy() for name, field in first.history.fields.items()}
    spoiled["temporal/in_scattering"][1, 3, 2, 5] = bad
    history = dataclasses.replace(first.history, fields=spoiled)
    then = run_frame(HALL, how(), frame=1, previous=dataclasses.replace(first, history=history))
    assert np.isfinite(then["temporal/in_scattering"]).all()
    assert np.isfinite(then[FINAL]).all()


def test_a_grid_of_another_size_is_looked_up_all_the_same() -> None:
    first = run_frame(HALL, how())
    finer = replace(how(), grid=dataclasses.replace(GRID, width=20, depth=11))
    then = run_frame(HALL, finer, frame=1, previous=first)
    assert then["temporal/valid"].min() == 1.0
    assert np.isfinite(then[FINAL]).all()


@pytest.mark.parametrize(("checkerboard", "merged", "filter"),
                         list(itertools.product((False, True), (False, True), ("off", "scattering", "unphased"))))
def test_planned_is_forced_over_time(checkerboard: bool, merged: bool, filter: str) -> None:
    settings = replace(how(filter=filter), checkerboard=checkerboard, merged=merged)
    planned, forced = (frames(HALL, settings, 3, force_all=force)[-1] for force in (False, True))
    np.testing.assert_array_equal(np.broadcast_to(planned[FINAL], forced[FINAL].shape), forced[FINAL])
    for threads in (1, 3):
        np.testing.assert_array_equal(frames(HALL, settings, 3, threads=threads)[-1][FINAL], planned[FINAL])


def test_a_checkerboard_at_rest_is_the_whole_after_two_frames() -> None:
    settings = Settings(grid=GRID, checkerboard=True)
    first, then = frames(HALL, settings, 2)
    plain = run_frame(HALL, Settings(grid=GRID))
    np.testing.assert_array_equal(then[FINAL], plain[FINAL])
    assert np.isfinite(first[FINAL]).all()
    assert 0.0 < np.abs(first[FINAL] - plain[FINAL]).max() < 0.5 * plain[FINAL].max()


def test_plans_say_what_filters() -> None:
    off, on = plan(HALL, Settings(grid=GRID)), plan(HALL, replace(how(clamp="range"), checkerboard=True))
    assert off["temporal"].why == "no temporal filter and no checkerboard"
    assert on["temporal"].why == "checkerboard, filter: scattering"
    assert {part.name: part.runs for part in on["temporal"].parts} == {
        "average": True, "holes": True, "clamp": True, "variable weight": False}
    assert plan(Scene(), how())["temporal"].runs  # fog of the frame before may be remembered


def test_bad_input_is_named() -> None:
    for call, words in (
            (lambda: Temporal(alpha=0.0), "^alpha: is 0"), (lambda: Temporal(alpha=1.5), "^alpha: is 1.5"),
            (lambda: Temporal(alpha=0.5, alpha_most=0.1), r"^alpha_most: is 0.1, must be at least alpha \(0.5\)"),
            (lambda: Temporal(filter="fog"), "^filter:"), (lambda: run_frame(HALL, how(), frame=-1), "^frame: is -1"),
            (lambda: run_frame(HALL, how(), frame=True), "^frame: is True")):
        with pytest.raises(InputError, match=words):
            call()
