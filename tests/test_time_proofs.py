"""Frames over time, end to end: how fast the filter's mean converges and to what, the work of a checkerboard, a march
against longer froxels, and what the command line refuses."""

from __future__ import annotations

import dataclasses
import io
import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import imageio.v3 as iio
import numpy as np
import pytest

from froxel_ref import lighting, media
from froxel_ref.apply import lookup_fog
from froxel_ref.cli import main
from froxel_ref.compare import order
from froxel_ref.frame import FINAL, Frame, run_frame
from froxel_ref.geometry import camera_rays
from froxel_ref.grid import Froxels, froxel_points, make_froxels, step_lengths
from froxel_ref.image_files import display_image
from froxel_ref.integrate import integrate
from froxel_ref.jitter import jitter_points
from froxel_ref.lighting import in_scattering
from froxel_ref.media import voxelise
from froxel_ref.raymarch import combine, march_long_range
from froxel_ref.records import InputError
from froxel_ref.scene import (
    Camera,
    DirectionalLight,
    HeightFog,
    Key,
    LocalMedium,
    Medium,
    PointLight,
    Scene,
    Track,
    Transform,
)
from froxel_ref.scene_files import load
from froxel_ref.sequence import moment, run_sequence
from froxel_ref.sequence_files import STATE
from froxel_ref.settings import AntiAliasing, Grid, Settings, Temporal, replace
from froxel_ref.temporal import blend

SUN = DirectionalLight(direction=(0.3, 1.0, 0.2), irradiance=(3.0, 2.0, 1.0))

# --- what the filter's mean tends to, and how fast --------------------------------------------------

# Smooth in every froxel: no medium ends, no height fog begins, and the lamp is out of sight.
SMOOTH = Scene(
    camera=Camera(width=8, height=6),
    global_media=(Medium(extinction=0.08, phase_anisotropy=0.5, height_fog=HeightFog(start=-100.0, falloff=0.3)),),
    lights=(SUN, PointLight(position=(1.0, 9.0, -5.0), intensity=(9.0, 5.0, 2.0), falloff="inverse_square")))
COARSE = Settings(grid=Grid(width=4, height=3, depth=5, near=2.0, far=12.0))


def sampled(jitter: Any) -> Any:
    """In-scattering of all froxels, each at the same place within it."""
    froxels = make_froxels(SMOOTH.camera, COARSE.grid, jitter=tuple(jitter))
    return in_scattering(voxelise(SMOOTH, froxels, {}, COARSE), SMOOTH.lights, froxels)


def over_the_froxel(nodes: int) -> Any:
    """The integral over all places within a froxel, by Gauss's rule along each axis."""
    x, w = np.polynomial.legendre.leggauss(nodes)
    return sum(w[a] * w[b] * w[c] / 8.0 * sampled(((x[a] + 1) / 2, (x[b] + 1) / 2, (x[c] + 1) / 2))
               for a in range(nodes) for b in range(nodes) for c in range(nodes))


def filtered_mean(values: list[Any], *, alpha: float = 0.05) -> Any:
    """The mean over a cycle of what the filter holds, once (1 − α)ⁿ of its first value is below 1e-9."""
    count, state, total = len(values), values[0], np.zeros_like(values[0])
    settled = count * math.ceil(math.log(1e-9) / math.log(1.0 - alpha) / count)
    for frame in range(1, settled + count):
        state = blend(values[frame % count], state, True, alpha=alpha)
        total += state / count if frame >= settled else 0.0
    return total


def discrepancy(points: Any) -> float:
    """The L2 discrepancy of a point set and of all its projections, each anchored at 1: Warnock's sums with the kernel
    ∏(2 − max(x, y)) [Hickernell 1998]."""
    count, axes = points.shape
    single = float(np.prod((3.0 - points**2) / 2.0, axis=1).sum())
    double = float(np.prod(2.0 - np.maximum(points[:, None], points), axis=2).sum())
    return math.sqrt((4.0 / 3.0) ** axes - 2.0 * single / count + double / count**2)


def test_the_filters_mean_converges_as_the_discrepancy_does() -> None:
    """4 to 512 points in a cycle. Measured: relative errors from 1.3e-2 to 1.4e-4, and 0.030 to 0.063 times the points'
    discrepancy each; both fall as N^−0.85, where independent points give N^−0.5."""
    truth = over_the_froxel(6)
    np.testing.assert_allclose(truth, over_the_froxel(5), rtol=1e-8)
    counts = 2 ** np.arange(2, 10)
    errors, spread = [], []
    for count in counts.tolist():
        points = jitter_points(count=count)
        errors.append(float(np.sqrt(np.mean((filtered_mean([sampled(p) for p in points]) / truth - 1.0) ** 2))))
        spread.append(discrepancy(points))
    ratio = np.array(errors) / spread
    assert ratio.max() < 0.07
    assert ratio.min() > 0.025
    rates = [-np.polyfit(np.log(counts), np.log(each), 1)[0] for each in (errors, spread)]
    assert rates[0] == pytest.approx(rates[1], abs=0.1)
    assert min(rates) > 0.75


@pytest.mark.parametrize("points", ["centred", "published", "author"])
@pytest.mark.parametrize("count", [8, 32, 128])
def test_no_field_is_farther_off_than_the_discrepancy_allows(points: str, count: int) -> None:
    """|error| ≤ D·V [Hickernell 1998, Koksma and Hlawka's inequality for squares]: for f = ∏ e^(−a x) with its integral
    and V in closed form, and met by the field that is worst for these points, whose V and error are D and D²."""
    places = jitter_points(points, count=count)
    spread = discrepancy(places)
    for a in np.random.default_rng(count).uniform(0.1, 3.0, (20, 3)):
        got = float(filtered_mean([np.full((1, 1, 1), math.exp(-float(a @ p))) for p in places])[0, 0, 0])
        ends, slopes = np.exp(-2.0 * a), a * -np.expm1(-2.0 * a) / 2.0
        variation = math.sqrt(float(np.prod(ends + slopes) - np.prod(ends)))
        # What is left of the first value is 1e-9 of it.
        assert abs(got - float(np.prod(-np.expm1(-a) / a))) <= spread * variation + 1e-8
    kernel = np.prod(2.0 - np.maximum(places[:, None], places), axis=2).mean(axis=1)
    worst = np.prod((3.0 - places**2) / 2.0, axis=1) - kernel
    integral = (4.0 / 3.0) ** 3 - float(np.prod((3.0 - places**2) / 2.0, axis=1).mean())
    got = float(filtered_mean([np.full((1, 1, 1), value) for value in worst])[0, 0, 0])
    assert integral - got == pytest.approx(spread**2, abs=1e-9)


# One texel from the next along each axis of the volume is one step down in the world.
DOWNWARDS = {"x": Camera(target=(0, 0, -1), up=(1, 0, 0), position=(0, 0, 0), vertical_fov=1.0, width=8, height=8),
             "y": Camera(target=(0, 0, -1), up=(0, 1, 0), position=(0, 0, 0), vertical_fov=1.0, width=8, height=8),
             "z": Camera(target=(0, -1, 0), up=(0, 0, -1), position=(0, 0, 0), vertical_fov=1.0, width=8, height=8)}
LASTING = {"centred": (0.0, 0.0, 0.0), "published": (-31 / 2048, -1 / 54, -0.038),
           "author": (0.234375, -1 / 27, -0.048)}


@pytest.mark.parametrize("points", LASTING)
def test_d10_fog_of_a_frame_is_shifted_for_ever_or_not_at_all(points: str) -> None:
    """Fog that thins by e^(−k) a metre, from far through a narrow angle: how far from its middle a froxel finds, on
    average over a cycle, the extinction that its filter holds; in texels. Half a variance of ks is left of what is not
    linear, 5e-5 of a texel at ks of 6e-4 a texel; the rest is that of the jitter through the small angle."""
    fall, grid = 1e-3, Grid(width=3, height=3, depth=3, near=100.0, far=101.0, distribution="linear")
    across = 2.0 * math.tan(math.radians(0.5)) * 100.5 / 3.0
    settings = replace(Settings(grid=grid, temporal=Temporal(filter="scattering", alpha=0.5)), jitter=points)
    fog = Medium(extinction=1e-3, height_fog=HeightFog(start=-200.0, falloff=fall))
    for (axis, camera), expected in zip(DOWNWARDS.items(), LASTING[points], strict=True):
        scene, before, held = Scene(camera=camera, global_media=(fog,)), None, []
        for n in range(64):
            before = run_frame(scene, settings, frame=n, previous=before, outputs=["temporal/extinction"])
            held.append(np.broadcast_to(before["temporal/extinction"], grid.shape)[1, 1, 1])
        middle = np.broadcast_to(run_frame(scene, Settings(grid=grid))["media/extinction"], grid.shape)[1, 1, 1]
        texel = across if axis != "z" else 1.0 / 3.0
        shift = math.log(float(np.mean(held[32:])) / float(middle)) / (fall * texel)
        assert shift == pytest.approx(expected, abs=1e-4)


# --- the checkerboard in frames ---------------------------------------------------------------------

BALL = LocalMedium(extinction=0.7, transform=Transform(translate=(0.3, 1.5, -5), scale=(1.5, 1, 1.2)))
HALL = Scene(camera=Camera(width=24, height=14), ambient=(0.1, 0.2, 0.3), local_media=(BALL,),
             global_media=(Medium(extinction=0.08, phase_anisotropy=0.6),),
             lights=(SUN, PointLight(position=(0.4, 1.5, -5.0), intensity=(9, 5, 2), radius=7,
                                     min_distance=1.0)))


@pytest.mark.parametrize("merged", [False, True])
@pytest.mark.parametrize("size", [(12, 7, 8), (11, 7, 9)])
def test_a_checkerboard_is_half_the_work_and_two_frames_all_of_it(size: tuple[int, int, int], merged: bool,
                                                                  monkeypatch: pytest.MonkeyPatch) -> None:
    """The froxels that media and lighting are asked for: each one once in two frames, by its place in the world."""
    grid = Grid(width=size[0], height=size[1], depth=size[2], near=0.5, far=16.0)
    asked: dict[str, list[Froxels]] = {}

    def counting(name: str, function: Callable[..., Any], place: int) -> Callable[..., Any]:
        def counted(*arguments: Any, **options: Any) -> Any:
            asked[name].append(arguments[place])
            return function(*arguments, **options)
        return counted

    monkeypatch.setattr(media, "voxelise", counting("media", media.voxelise, 1))
    monkeypatch.setattr(lighting, "in_scattering", counting("lighting", lighting.in_scattering, 2))
    settings, before = Settings(grid=grid, checkerboard=True, merged=merged), None
    places: dict[str, list[Any]] = {"media": [], "lighting": []}
    for n in range(2):
        asked |= {"media": [], "lighting": []}
        before = run_frame(HALL, settings, frame=n, previous=before)
        for name, pieces in asked.items():
            points = np.concatenate([np.stack([a.ravel() for a in np.broadcast_arrays(*froxel_points(piece))], axis=1)
                                     for piece in pieces])
            assert len(points) == (math.prod(size) + 1 - n) // 2
            places[name].append(points)
    whole = np.stack([a.ravel() for a in np.broadcast_arrays(*froxel_points(make_froxels(HALL.camera, grid)))], axis=1)
    for both in places.values():
        together = np.concatenate(both)
        np.testing.assert_array_equal(np.unique(together, axis=0), np.unique(whole, axis=0))
        assert len(together) == len(whole)


def holes_of(frame: Frame, whole: Frame) -> tuple[float, float]:
    """The darkest froxel's share of what it should be, and the mean's."""
    share = frame["temporal/in_scattering"] / whole["lighting/in_scattering"]
    return float(share.min()), float(share.mean())


@pytest.mark.parametrize("number", [0, 1])
def test_a_first_frame_has_no_holes(number: int) -> None:
    """Nor has one after a cut, nor what a pan brings into view. No hole is darker than its darkest neighbour, which in
    this smooth fog has more than 0.8 of its light (0.94 measured). Filled with nothing they would be black, and with
    zeros outside the border the corners have half of their light (D11; 0.47 measured)."""
    grid = Grid(width=12, height=7, depth=8, near=0.5, far=16.0)
    fog = dataclasses.replace(HALL, local_media=(), lights=(SUN,))
    settings = Settings(grid=grid, checkerboard=True)
    turned = dataclasses.replace(fog, camera=dataclasses.replace(fog.camera, target=(1.0, 1.7, 0.0)))
    whole, aside = run_frame(fog, Settings(grid=grid)), run_frame(turned, Settings(grid=grid))
    first = run_frame(fog, settings, frame=number)
    cut = run_frame(fog, settings, frame=number, previous=run_frame(turned, settings, frame=number + 1), cut=True)
    panned = run_frame(turned, settings, frame=number, previous=run_frame(fog, settings, frame=number + 1))
    assert panned["temporal/valid"].mean() < 0.1
    for frame, right in ((first, whole), (cut, whole), (panned, aside)):
        darkest, mean = holes_of(frame, right)
        assert darkest > 0.8
        assert mean == pytest.approx(1.0, abs=0.01)
    darkest, mean = holes_of(run_frame(fog, replace(settings, checkerboard_fill="zero"), frame=number), whole)
    assert darkest < 0.8
    assert mean < 0.97


def checkerboard_off(scene: Scene, settings: Settings, count: int) -> list[tuple[float, float]]:
    """Of each frame what a checkerboard adds to in-scattering and to the image: root mean square over the mean."""
    found, before = [], [None, None]
    for n in range(count):
        before = [run_frame(moment(scene, None, n), replace(settings, checkerboard=half), frame=n, previous=last)
                  for half, last in zip((True, False), before, strict=True)]
        pairs = [[frame[name] for frame in before] for name in ("temporal/in_scattering", FINAL)]
        found.append(tuple(float(np.sqrt(np.mean((a - b) ** 2)) / b.mean()) for a, b in pairs))
    return found


FILTERED = replace(Settings(grid=Grid(width=24, height=14, depth=16, near=0.5, far=16.0),
                            temporal=Temporal(filter="scattering", alpha=0.1)), jitter="off")


def test_what_holes_were_filled_with_is_replaced_by_what_is_computed_first() -> None:
    """S7, at rest and without jitter: the second frame is the whole."""
    first, *rest = (light for light, _ in checkerboard_off(HALL, FILTERED, 6))
    assert first > 0.05
    assert max(rest) < 1e-15
    guess = [frame["temporal/guessed"] for frame in run_sequence(
        HALL, frames=3, settings=replace(FILTERED, checkerboard=True), outputs=["temporal/guessed"])]
    assert [round(float(each.mean()), 12) for each in guess] == [0.5, 0.0, 0.0]


def test_what_holes_were_filled_with_is_forgotten_at_half_the_pace() -> None:
    """S7 as published, at rest and without jitter: (1 − α)^⌊n/2⌋ of the first frame's error is left in each froxel,
    since the average begins with it; by `temporal.start` = mean the second frame is the whole."""
    kept = replace(FILTERED, filled_holes="kept")
    first, *rest = (light for light, _ in checkerboard_off(HALL, kept, 8))
    assert first > 0.05
    for n, light in enumerate(rest, 2):
        assert light == pytest.approx(first * 0.9 ** (n // 2), rel=1e-9)
    at_once = dataclasses.replace(kept, temporal=dataclasses.replace(FILTERED.temporal, start="mean"))
    for light, image in checkerboard_off(HALL, at_once, 4)[1:]:
        assert light < 1e-15
        assert image < 1e-15


@pytest.mark.parametrize(("holes", "walking", "flying"), [
    ("replaced", [(0.106, 0.0149), (0.188, 0.035)], [(0.096, 0.0299), (0.219, 0.079)]),
    ("kept", [(0.163, 0.037), (0.207, 0.047)], [(0.268, 0.056), (0.261, 0.082)])])
def test_what_a_checkerboard_adds_in_motion_is_bounded(
        holes: str, walking: list[tuple[float, float]], flying: list[tuple[float, float]]) -> None:
    """As `benchmarks/checkerboard.py` has it, small: a camera that walks 3 m/s and a lamp that flies 6 m/s, after 8 and
    16 frames, of the froxels and of the image, from 0.37 and 0.06 in the first; to a tenth of what was measured."""
    walk = [Track(path=f"camera.{name}[2]", keys=(Key(time=0, value=z), Key(time=1, value=z - 3)))
            for name, z in (("position", 0), ("target", -1))]
    flight = [Track(path="lights[1].position[0]", keys=(Key(time=0, value=-1), Key(time=1, value=5)))]
    for tracks, expected in ((walk, walking), (flight, flying)):
        moving = dataclasses.replace(HALL, tracks=tuple(tracks))
        found = checkerboard_off(moving, replace(FILTERED, filled_holes=holes), 16)
        np.testing.assert_allclose([found[7], found[15]], expected, rtol=0.1)


# --- the long range against longer froxels ----------------------------------------------------------

VIEW = Camera(position=(0.0, 6.0, 0.0), target=(0.3, 5.5, -4.0), vertical_fov=50.0, width=8, height=6)
HAZE = Scene(camera=VIEW, ambient=(0.2, 0.1, 0.4), lights=(SUN,), global_media=(
    Medium(albedo=(0.9, 0.8, 0.6), extinction=0.002, phase_anisotropy=0.7),
    Medium(albedo=(0.7, 0.9, 0.5), extinction=0.004, phase_anisotropy=-0.3,
           height_fog=HeightFog(start=-300.0, falloff=0.01))))


def shade(points: Any, normal: Any = None) -> Any:
    """Light that comes and goes over some 100 m, between 0.2 and 1."""
    return 0.6 + 0.4 * np.sin(0.05 * points[0] + 0.03 * points[2]) * np.cos(0.01 * points[1])


def haze(grid: Grid, depth: Any) -> tuple[Any, Any]:
    """Froxels of a frame, read at view depths."""
    froxels = make_froxels(VIEW, grid)
    material = voxelise(HAZE, froxels, {}, Settings(grid=grid))
    light = in_scattering(material, HAZE.lights, froxels, ambient=HAZE.ambient, visibility={0: shade})
    return lookup_fog(integrate(light, material.extinction, *step_lengths(froxels), near=grid.near), grid, depth)


def hazed(slices: int, depth: Any, steps: int) -> tuple[Any, Any]:
    """64 m of froxels, and the march beyond."""
    near = Grid(width=8, height=6, depth=slices, near=0.5, far=64.0)
    long = march_long_range(depth, camera_rays(VIEW, 8, 6), HAZE, farthest=640.0, settings=Settings(grid=near),
                            steps=steps, visibility={0: shade})
    return combine(*haze(near, depth), *long)


def test_a_march_beyond_64_m_is_froxels_to_640_m() -> None:
    """Two media of different g and a shaded sun. Both are of second order, in slices and in steps, and tend to the
    same: measured 1.4e-3 of the light apart with 64 slices and 16 steps against 96 slices, 2.0e-5 with eight times as
    many of each; of the transmittance 1.8e-3 and 2.8e-5."""
    depth = np.random.default_rng(5).uniform(64.0, 640.0, (6, 8))
    counts, apart = np.array([1, 2, 4, 8]), []
    for n in counts.tolist():
        short = hazed(64 * n, depth, 16 * n)
        long = haze(Grid(width=8, height=6, depth=96 * n, near=0.5, far=640.0), depth)
        apart.append([float(np.abs(a / b - 1.0).max()) for a, b in zip(short, long, strict=True)])
    light, through = np.array(apart).T
    assert order(1.0 / counts, light).order == pytest.approx(2.0, abs=0.2)
    assert light[0] < 2e-3
    assert light[-1] < 3e-5
    assert through[-1] < 4e-5


@pytest.mark.parametrize("steps", [1, 16, 256])
def test_there_is_no_step_at_the_far_end(steps: int) -> None:
    """A micrometre on either side of 64 m is twice as far apart as a micrometre and two on this side: measured 3.3e-8
    of the light and 1.6e-8, so a step there is below 1e-9 of it."""
    depths = [np.full((6, 8), 64.0 + 1e-6 * n) for n in (-2, -1, 1)]
    for before, inner, outer in zip(*(hazed(256, depth, steps) for depth in depths), strict=True):
        within, across = (np.abs(b / a - 1.0).max() for a, b in ((before, inner), (inner, outer)))
        assert across < 1e-7
        assert across == pytest.approx(2.0 * within, rel=0.03)


# --- bad input on the command line ------------------------------------------------------------------

DOCUMENT = {
    "schema": 1,
    "scene": {"camera": {"width": 24, "height": 14}, "global_media": [{"extinction": 0.1}],
              "lights": [{"type": "point", "position": [0, 1, -4], "intensity": [5, 5, 5], "radius": 6}],
              "surfaces": [{"type": "plane"}, {"type": "sphere", "center": [0, 1.7, -3], "radius": 1}]},
    "settings": {"grid": {"width": 8, "height": 5, "depth": 6}, "temporal": {"filter": "scattering", "alpha": 0.3}}}


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "scene.json").write_text(json.dumps(DOCUMENT))
    return tmp_path


INTO_THE_SPHERE = ('tracks=[{"path":"camera.position[2]","keys":[{"time":0,"value":0},{"time":0.1,"value":-2.5}]},'
                   '{"path":"camera.target[2]","keys":[{"time":0,"value":-9}]}]')


@pytest.mark.parametrize(("arguments", "said"), [
    (["--frames", "0"], "--frames: is '0', must be a whole number, 1 to 100000"),
    (["--frames", "100001"], "--frames: is '100001', must be a whole number, 1 to 100000"),
    (["--frames", "-1"], "--frames: is '-1', must be"), (["--frames", "2.5"], "--frames: is '2.5', must be"),
    (["--frames", ""], "--frames: is '', must be"), (["--frames", "NaN"], "--frames: is 'NaN', must be"),
    *[(["--frames", "2", "--set", f"temporal.{name}={value}"], f"settings.temporal.{name}: is {value}, must be above 0")
      for name in ("alpha", "alpha_most") for value in ("0", "-0.1", "1.5", "2")],
    (["--set", "temporal.alpha=1.5"], "settings.temporal.alpha: is 1.5, must be above 0 and at most 1"),
    (["--set", "temporal.alpha=NaN"], "settings.temporal.alpha, line 1, column 1: is NaN, must be a finite number"),
    (["--set", "temporal.alpha=1e999"], "settings.temporal.alpha"),
    (["--set", "temporal.alpha=[0.1]"], "settings.temporal.alpha"),
    (["--set", "temporal.alpha_most=0.1"], "settings.temporal.alpha_most: is 0.1, must be at least alpha (0.3)"),
    (["--frames", "5", "--set", INTO_THE_SPHERE],
     "camera.position: is within surfaces[1] in frame 3, must be outside of it"),
    (["--frames", "2", "--set", "camera.position=[0,1.7,-3.2]"],
     "camera.position: is within surfaces[1] in frame 0, must be outside of it"),
])
def test_bad_input_is_one_line_and_exit_code_2(arguments: list[str], said: str, here: Path,
                                               capsys: pytest.CaptureFixture[str]) -> None:
    """Of a sequence as a folder, as an animation and as its last image, and of one image."""
    for output in ("out", "movie.gif", "last.png") if "--frames" in arguments else ("image.png",):
        assert main(["render", "scene.json", "-o", output, *arguments]) == 2
        out, err = capsys.readouterr()
        assert out == ""
        assert err.startswith(f"froxel-ref: error: {said}")
        assert len(err.splitlines()) == 1
        assert [path.name for path in here.iterdir()] == ["scene.json"]


def spoil(state: Path, change: Callable[[Any], Any]) -> None:
    """The history that a sequence left behind, with one of its fields changed."""
    with np.load(state) as file:
        arrays = {name: file[name] for name in file.files}
    arrays["temporal.in_scattering"] = change(arrays["temporal.in_scattering"])
    content = io.BytesIO()
    np.savez(content, **arrays)
    state.write_bytes(content.getvalue())


def test_a_kept_history_of_another_size_is_refused(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["render", "scene.json", "-o", "out", "--frames", "2"]) == 0
    spoil(here / "out" / STATE, lambda field: field[:, :3])
    capsys.readouterr()
    assert main(["render", "scene.json", "-o", "out", "--frames", "4", "--resume"]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.startswith("froxel-ref: error: ")
    assert "has shape (3, 3, 5, 8)" in err
    assert len(err.splitlines()) == 1
    assert sorted(path.name for path in (here / "out").glob("*.png")) == ["frame-00000.png", "frame-00001.png"]


@pytest.mark.parametrize("damage", [
    lambda content: content[:len(content) // 2], lambda content: b"", lambda content: b"no archive",
    lambda content: content.replace(b"temporal.in_scattering", b"temporal.in_scatterinX")])
def test_a_damaged_history_is_one_line(damage: Callable[[bytes], bytes], here: Path,
                                       capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["render", "scene.json", "-o", "out", "--frames", "1"]) == 0
    state = here / "out" / STATE
    state.write_bytes(damage(state.read_bytes()))
    capsys.readouterr()
    assert main(["render", "scene.json", "-o", "out", "--frames", "2", "--resume"]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.startswith("froxel-ref: error: output: ")
    assert len(err.splitlines()) == 1


@pytest.mark.parametrize("how", ["--preset=thesis", "--set=temporal.filter=media"])
def test_what_was_interrupted_goes_on_to_the_last_bit(how: str, here: Path) -> None:
    assert main(["render", "scene.json", "-o", "whole", "--frames", "4", how]) == 0
    assert main(["render", "scene.json", "-o", "parts", "--frames", "2", how]) == 0
    assert main(["render", "scene.json", "-o", "parts", "--frames", "4", "--resume", how]) == 0
    for picture in (here / "whole").glob("*.png"):
        assert picture.read_bytes() == (here / "parts" / picture.name).read_bytes()


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_a_kept_history_without_numbers_counts_as_none(bad: float, here: Path) -> None:
    """The next picture is that of a frame without a history; the extinction, which is even, has one."""
    assert main(["render", "scene.json", "-o", "out", "--frames", "1"]) == 0
    spoil(here / "out" / STATE, lambda field: np.full_like(field, bad))
    assert main(["render", "scene.json", "-o", "out", "--frames", "2", "--resume"]) == 0
    loaded = load("scene.json")
    alone = display_image(run_frame(loaded.scene, replace(loaded.settings, time=1.0 / 30.0), frame=1))
    np.testing.assert_array_equal(iio.imread(here / "out" / "frame-00001.png"), alone)


@pytest.mark.parametrize("length", [(3, 8, 7, 11), (3, 7, 7, 12), (1, 2, 8, 7, 12)])
def test_a_history_that_is_not_its_grids_is_one_line(length: tuple[int, ...]) -> None:
    """In Python: one whose fields are not of the size that it says."""
    grid = Grid(width=12, height=7, depth=8, near=0.5, far=16.0)
    settings = Settings(grid=grid, temporal=Temporal(filter="scattering"))
    first = run_frame(HALL, settings)
    assert first.history is not None
    fields = dict(first.history.fields) | {"temporal/in_scattering": np.ones(length)}
    spoilt = dataclasses.replace(first, history=dataclasses.replace(first.history, fields=fields))
    with pytest.raises(InputError) as fault:
        run_frame(HALL, settings, frame=1, previous=spoilt)
    assert f"has shape {length}" in str(fault.value)
    assert len(str(fault.value).splitlines()) == 1
    assert np.isfinite(run_frame(HALL, settings, frame=1, previous=spoilt, cut=True)[FINAL]).all()


# --- what cameras, lights and media may do between frames ---------------------------------------------


FILTERS = ("off", "scattering", "unphased", "media")


def changing(filter: str, **more: object) -> Settings:
    return replace(Settings(grid=Grid(width=7, height=5, depth=3), temporal=Temporal(filter=filter, alpha=0.2)), **more)


@pytest.mark.parametrize("checkerboard", [False, True])
@pytest.mark.parametrize("filter", FILTERS)
@pytest.mark.parametrize("target", [(9.0, 1.0, -1.0), (0.0, 2.0, 9.0)], ids=["aside", "about"])
def test_a_camera_may_turn_away_from_all_that_it_saw(
        filter: str, checkerboard: bool, target: tuple[float, ...]) -> None:
    """Froxels that lie behind the earlier camera have no history: the frame is that of a cut."""
    turned = dataclasses.replace(HALL, camera=dataclasses.replace(HALL.camera, target=target))
    how = changing(filter, checkerboard=checkerboard)
    first = run_frame(HALL, how)
    second = run_frame(turned, how, frame=1, previous=first)
    assert np.isfinite(second.image).all()
    if target == (0.0, 2.0, 9.0):
        np.testing.assert_array_equal(second.image, run_frame(turned, how, frame=1, previous=first, cut=True).image)


@pytest.mark.parametrize("checkerboard", [False, True])
@pytest.mark.parametrize("filter", FILTERS)
@pytest.mark.parametrize("order", [(0.0, 0.1, 0.1), (0.1, 0.0, 0.1)], ids=["comes", "gone"])
def test_media_that_come_and_go_leave_the_frame_as_forced(
        order: tuple[float, ...], filter: str, checkerboard: bool) -> None:
    """Extinction that is exactly 0 is no reason to forget."""
    how = changing(filter, checkerboard=checkerboard)
    made: dict[bool, list[Frame]] = {False: [], True: []}
    for force, frames in made.items():
        for n, extinction in enumerate(order):
            fog = dataclasses.replace(HALL.global_media[0], extinction=extinction)
            scene = dataclasses.replace(HALL, global_media=(fog,), local_media=())
            frames.append(run_frame(scene, how, frame=n, previous=frames[-1] if frames else None, force_all=force))
    for planned, forced in zip(*made.values(), strict=True):
        np.testing.assert_array_equal(*np.broadcast_arrays(planned.image, forced.image))


@pytest.mark.parametrize("checkerboard", [False, True])
@pytest.mark.parametrize("filter", FILTERS)
def test_extinction_may_become_one_number_and_three(filter: str, checkerboard: bool) -> None:
    how, before = changing(filter, checkerboard=checkerboard), None
    for n, extinction in enumerate((0.05, (0.05, 0.06, 0.07), 0.05, 0.05)):
        fog = dataclasses.replace(HALL.global_media[0], extinction=extinction)
        before = run_frame(dataclasses.replace(HALL, global_media=(fog,)), how, frame=n, previous=before)
        assert np.isfinite(before.image).all()


@pytest.mark.parametrize("checkerboard", [False, True])
@pytest.mark.parametrize("filter", FILTERS)
def test_lights_may_go_out_and_come_back(filter: str, checkerboard: bool) -> None:
    how, before = changing(filter, checkerboard=checkerboard), None
    for n, lights in enumerate((HALL.lights, (), (), HALL.lights)):
        before = run_frame(dataclasses.replace(HALL, lights=lights), how, frame=n, previous=before)
        assert np.isfinite(before.image).all()


@pytest.mark.parametrize("filter", ["scattering", "unphased", "media"])
def test_a_checkerboard_comes_to_rest(filter: str) -> None:
    """Without jitter, scene and camera at rest: the frame without any of it, and nothing flickers."""
    how = changing(filter, checkerboard=True, jitter="off")
    frames = list(run_sequence(HALL, frames=6, settings=how, rate=1e9, outputs=[FINAL]))
    still = run_frame(HALL, replace(changing("off"), jitter="off"), outputs=[FINAL]).image
    for frame in frames[2:]:
        np.testing.assert_allclose(frame.image, still, rtol=1e-12)


@pytest.mark.parametrize("exposure", [1e-4, 0.1, 10.0, 1e4])
def test_an_average_in_half_floats_is_bounded_as_it_is_stored(exposure: float) -> None:
    """65504 is the texture's, not that of what is displayed."""
    bright = Scene(camera=Camera(width=3, height=2, exposure=exposure), background=(1e5, 1.0, 6e4))
    image = run_frame(bright, Settings(taa=AntiAliasing(on=True, storage="float16"))).image
    np.testing.assert_array_equal(image[:, 0, 0], [65504.0, 1.0, np.float64(np.float16(6e4))])


def test_the_mean_of_the_first_frames_counts_those_of_the_fog() -> None:
    """Frames before the filter was on do not count."""
    how = Settings(grid=Grid(width=7, height=5, depth=3), taa=AntiAliasing(on=True))
    before = None
    for n in range(4):
        before = run_frame(HALL, how, frame=n, previous=before)
    on = replace(how, temporal=Temporal(filter="scattering", start="mean", alpha=0.05), jitter="off")
    first = run_frame(HALL, on, frame=4, previous=before)
    dark = dataclasses.replace(HALL, lights=())
    second = run_frame(dark, on, frame=5, previous=first)["temporal/in_scattering"]
    want = 0.5 * (first["temporal/in_scattering"] + run_frame(dark, on, frame=5)["temporal/in_scattering"])
    np.testing.assert_allclose(*np.broadcast_arrays(second, want), rtol=1e-12)


@pytest.mark.parametrize(("arguments", "said"), [
    ({"rate": "30"}, "rate: is '30', must be a number above 0"), ({"cuts": 1}, "cuts: is 1, must be a collection"),
    ({"cuts": (7,)}, "cuts: has 7, must be frames from 0 to 1"),
    ({"camera_path": (Camera() for _ in range(2))}, "camera_path: is a generator, must be a sequence of cameras"),
    ({"settings": Settings(time=1e10)}, "time: is ")])
def test_a_sequence_refuses_before_it_begins(arguments: dict[str, object], said: str) -> None:
    with pytest.raises(InputError) as caught:
        run_sequence(HALL, frames=2, **arguments)  # type: ignore[arg-type]
    assert str(caught.value).startswith(said)
