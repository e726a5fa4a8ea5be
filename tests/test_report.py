"""A report: what is measured, gone on with and summed up; the budget and the refinement held to frames of their own."""

from __future__ import annotations

import csv
import json
import math
import shutil
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from data import data_file

from froxel_ref import compare, load, report, report_log, report_points
from froxel_ref.budget import parts_of
from froxel_ref.error_images import distance, last_image, make_subject, reference_image
from froxel_ref.flip import flip_available
from froxel_ref.frame import Frame, plan, run_frame
from froxel_ref.knobs import KNOBS, SUITES, Knob, Step, chosen, own_knob
from froxel_ref.records import InputError
from froxel_ref.report import level_name, measure, measurements, refined
from froxel_ref.report_entries import sound
from froxel_ref.report_folder import check_target, measured, run_report
from froxel_ref.report_log import IMAGES, LOCK, LOG, Entry
from froxel_ref.report_points import BASE, Asked, Prepared, Suite, prepare
from froxel_ref.report_record import Point, Report, Spread
from froxel_ref.report_sums import noise_of, put_together
from froxel_ref.scene import Camera, DirectionalLight, ImageBuffers, Medium, Scene
from froxel_ref.scene_files import Loaded, builtin
from froxel_ref.sequence import run_sequence
from froxel_ref.settings import SWITCHES, Grid, LongRange, OpacityMaps, Settings, ShadowMaps, Switches, replace
from froxel_ref.truth_image import render_truth

GRID = ["grid.width=8", "grid.height=6", "grid.depth=8"]
SIZE = ["camera.width=32", "camera.height=18"]
TINY = Suite(pixels=600, frames=4, rtol=1e-3, repeats=2, slow=2.0, refine=2, levels=(0.5, 1.0))


@pytest.fixture(autouse=True)
def tiny(monkeypatch: pytest.MonkeyPatch) -> None:
    """Few pixels, frames and runs."""
    for name in SUITES:
        monkeypatch.setitem(report_points.SUITES, name, TINY)


def prepared(name: str = "uniform", *overrides: str, sweep: str | None = "grid.depth=4,8,16", **asked: Any) -> Prepared:
    knobs = {} if sweep is None else {"knobs": (own_knob(sweep),)}
    return prepare(load(name, overrides=[*GRID, *SIZE, *overrides]), Asked(**(knobs | asked)))


def errors_of(found: Report) -> str:
    """Everything but times, to the last bit; NaN is like NaN here."""
    return repr([(point.id, point.errors, point.overrides, point.frames, point.fault) for point in found.points]
                + [found.budget, found.refinement, found.reference._replace(seconds=0.0), found.left_out])


def table(path: Path) -> list[dict[str, str]]:
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


def names_in(folder: Path) -> list[str]:
    return [json.loads(line)["name"] for line in (folder / LOG).read_text().splitlines()[1:]]


# --- what is to be measured ---------------------------------------------------------------------------


def test_suites_have_names() -> None:
    assert tuple(report_points.SUITES) == SUITES == ("quick", "full")


def test_the_full_suite_has_the_quick_ones_points_and_more() -> None:
    loaded = load("shaft", overrides=[*GRID, *SIZE])
    quick, full = ({spot.id: spot for spot in prepare(loaded, Asked(suite=suite)).spots} for suite in SUITES)
    assert quick.items() < full.items()
    assert next(iter(full)) == BASE
    assert "whole=thesis" in full


@pytest.mark.parametrize("name", ["uniform", "shaft", "long-range", "hall-walk", "vacuum", "particles-in-fog"])
def test_points_are_unlike_one_another(name: str) -> None:
    found = prepare(load(name, overrides=[*GRID, *SIZE]), Asked(suite="full", knobs=(
        *KNOBS, own_knob("grid.depth=16,8,16.0"), own_knob("precision=float32"), own_knob("settings.grid.depth=16"),
        own_knob("emission=per_metre,published"), own_knob("fidelity=corrected"))))
    assert {"integrator=analytic", "phase=weighted", "fidelity=corrected", "emission=per_metre"}.isdisjoint(
        spot.id for spot in found.spots)
    assert len({spot.id for spot in found.spots}) == len(found.spots)
    switches = [tuple(getattr(spot.settings, name) for name in SWITCHES) for spot in found.spots]
    bare = [replace(spot.settings, fidelity="corrected", switches=Switches()) for spot in found.spots if spot.settings]
    assert len(set(zip(bare, switches, [spot.frames for spot in found.spots], strict=True))) == len(found.spots)
    assert {each.name for each in found.left_out}.isdisjoint(spot.knob for spot in found.spots)
    # Every knob is either turned, or left out with its reason; the rest has no value but the base's or another's.
    assert {spot.knob for spot in found.spots} | {each.name for each in found.left_out} >= {knob.name for knob in KNOBS}
    for spot in found.spots:
        assert spot.frames in ((4, 1) if spot.settings is not None else (1,))


def test_points_that_average_have_frames() -> None:
    found = {spot.label: spot.frames for spot in prepared(sweep=None, suite="full", knobs=chosen(["temporal"])).spots}
    assert found["as it is"] == 1
    assert found["scattering, α 0.2"] == 4
    report_points.SUITES["full"] = TINY._replace(frames=16)
    found = {spot.label: spot.frames for spot in prepared(sweep=None, suite="full", knobs=chosen(["temporal"])).spots}
    assert (found["scattering, α 0.2"], found["scattering, α 0.2, 4 frames"]) == (16, 4)


def test_names_of_measurements_are_unique(tmp_path: Path) -> None:
    found = prepare(load("shaft", overrides=[*GRID, *SIZE, "fidelity=published"]), Asked(suite="full"))
    works = list(measurements(found, tmp_path))
    assert len({work.name for work in works}) == len(works)
    assert len({report_log.image_path(tmp_path, work.name) for work in works}) == len(works)
    assert works[0].name == "reference"
    ids = [spot.id for spot in found.spots]
    points = {f"{what} {i}" for i in ids for what in ("image", "memory", "time 0", "time 1")}
    rest = {"reference", "saved", "level 0.5", "level 1", "budget: none"}
    rest |= {f"budget: {way}" for part in found.parts for way in (f"without {part.name}", f"{part.name} alone")}
    assert {work.name for work in works} == points | rest
    few = prepare(found.subject.loaded, Asked(suite="full", everything=False))
    assert {work.name for work in measurements(few, tmp_path)} == points | {"reference"}
    assert all(work.weight >= 0.0 for work in works)


@pytest.mark.parametrize(("sweep", "overrides", "asked", "words"), [
    ("grid.depth=8", [], {}, r"--sweep: leaves nothing to sweep \(every value of the quick suite is the base's own"),
    ("grid.depth=8", [], {"suite": "full"}, r"--sweep: leaves nothing to sweep \(every value is the base's own\)"),
    (None, [], {"knobs": chosen(["whole"])}, r"--knobs: leaves nothing to sweep \(.*--suite full may have others\)"),
    (None, [], {"knobs": ()}, "--knobs: leaves nothing to sweep"),
    (None, [], {"knobs": chosen(["shadows", "opacity maps"])},
     r"--knobs: leaves nothing to sweep \(shadows: .*; opacity maps: volumetric shadows are off\)"),
    ("grid.fra=8", [], {}, r"settings.grid.fra: is not a key here; did you mean 'far'\?"),
    ("grid.far=0.1", [], {}, "settings.grid.near: is 0.5 m, must be below far"),
    ("camera.width=8", [], {}, "camera.width: is of the scene, must be a setting"),
    ("grid.depth=4", [], {"limit_ms": 0.0}, "--budget-ms: is 0, must be above 0"),
    ("grid.depth=4", [], {"limit_error": math.nan}, "--max-error: is nan, must be above 0")])
def test_what_cannot_be_measured_is_refused_at_once(sweep: str | None, overrides: list[str], asked: dict[str, Any],
                                                    words: str) -> None:
    with pytest.raises(InputError, match=words):
        prepared("uniform", *overrides, sweep=sweep, **asked)


def test_many_lights_have_fewer_pixels(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(report_points.SUITES, "quick", TINY._replace(pixels=7000))
    sizes = {}
    for count in (0, 70):
        loaded = load("many-lights", overrides=[*GRID, f"extra_lights.count={count}"])
        sizes[count] = prepare(loaded, Asked(knobs=(own_knob("grid.depth=4"),))).raster
    assert sizes[0][0] > sizes[70][0]
    # √(20/80) of the pixels; the nearest prime.
    assert sizes[70] == (80, 45)


# --- measured, and gone on with -----------------------------------------------------------------------


SHAFT = ("shaft", "fidelity=published")


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Path, Report]]:
    """A report of everything, never interrupted."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(report_points.SUITES, "quick", TINY)
        folder = tmp_path_factory.mktemp("whole") / "report"
        yield folder, run_report(prepared(*SHAFT), folder)


def test_a_second_run_has_the_same_errors_to_the_last_bit(whole: tuple[Path, Report], tmp_path: Path) -> None:
    again = run_report(prepared(*SHAFT, threads=1), tmp_path / "again")
    assert errors_of(again) == errors_of(whole[1])
    assert [point.peak_bytes is not None for point in again.points] == [True] * 3
    # In points.csv too: all but times, memory and what follows from them.
    rows = [[{name: cell for name, cell in row.items() if not name.endswith(("_s", "_bytes")) and name != "member"}
             for row in table(folder / "points.csv")] for folder in (whole[0], tmp_path / "again")]
    assert rows[0] == rows[1]
    assert {"relmse", "bias", "quantile_999", "maximum", "flip"} <= rows[0][0].keys()


def test_all_of_it_is_in_the_folder(whole: tuple[Path, Report]) -> None:
    folder, found = whole
    names = names_in(folder)
    assert names == [work.name for work in measurements(prepared(*SHAFT), folder)]
    assert measured(folder) == len(names)
    assert {"report.json", "points.csv", "budget.csv", "refinement.csv", "index.html", LOG, IMAGES} <= {
        entry.name for entry in folder.iterdir()}
    assert [point.id for point in found.points] == ["base", "grid.depth=4", "grid.depth=16"]
    assert all(point.member != "failed" and not point.fault for point in found.points)
    assert found.setup.raster == (32, 18)
    assert found.setup.flip.startswith("needs images of at least 21 x 21 pixels")
    assert all(point.seconds is not None and point.seconds.runs == 2 and point.stages for point in found.points)


@pytest.mark.parametrize("stop", [0, 1, 8, 10**6])
def test_an_interrupted_report_is_gone_on_with(whole: tuple[Path, Report], tmp_path: Path, stop: int) -> None:
    """By Ctrl-C as a measurement begins, and again at the next; nothing is measured twice."""
    folder, asked = tmp_path / "report", prepared(*SHAFT)
    count = len(names_in(whole[0]))
    stop = min(stop, count - 1)
    seen: list[int] = []

    def tell(what: str, done: int, of: int) -> None:
        assert of == 100
        seen.append(done)
        if len(seen) in (stop + 1, stop + 3):
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run_report(asked, folder, tell=tell)
    assert measured(folder) == stop
    assert not (folder / "index.html").exists()
    if count - stop >= 3:
        with pytest.raises(KeyboardInterrupt):
            run_report(asked, folder, resume=True, tell=tell)
        assert measured(folder) == stop + 1
    found = run_report(asked, folder, resume=True, tell=tell)
    assert errors_of(found) == errors_of(whole[1])
    assert names_in(folder) == names_in(whole[0])
    assert all(0 <= done <= 100 for done in seen)
    assert seen[:stop + 1] == sorted(seen[:stop + 1])


def copied(folder: Path, to: Path) -> Path:
    return Path(shutil.copytree(folder, to / "report"))


def test_a_finished_report_answers_another_limit_without_measuring(whole: tuple[Path, Report], tmp_path: Path,
                                                                   monkeypatch: pytest.MonkeyPatch) -> None:
    folder = copied(whole[0], tmp_path)
    before = (folder / LOG).read_bytes()
    assert whole[1].recommendation is None

    def nothing(*args: object, **options: object) -> Frame:
        raise AssertionError("measured again")

    for name in ("frames_of", "last_image", "reference_image", "measure_saved", "timed", "peak_bytes"):
        monkeypatch.setattr(report, name, nothing)
    for limit in ({"limit_ms": 1e4}, {"limit_error": 10.0}, {"limit_ms": 1e-6}):
        found = run_report(prepared(*SHAFT, **limit), folder, resume=True, tell=nothing)
        assert found.recommendation is not None
        assert found.recommendation.met == (limit != {"limit_ms": 1e-6})
        assert found._replace(recommendation=None, setup=whole[1].setup) == whole[1]
        assert found.setup.took == whole[1].setup.took
    assert (folder / LOG).read_bytes() == before


@pytest.mark.parametrize("damage", ["cut", "image gone", "image damaged", "truth gone", "all images gone"])
def test_what_is_lost_is_measured_again_and_nothing_else(whole: tuple[Path, Report], tmp_path: Path,
                                                         damage: str) -> None:
    folder = copied(whole[0], tmp_path)
    names = names_in(folder)
    if damage == "cut":
        (folder / LOG).write_bytes((folder / LOG).read_bytes()[:-7])
        lost = names[-1:]
    elif damage == "all images gone":
        for path in (folder / IMAGES).iterdir():
            path.unlink()
        lost = [name for name in names if name.startswith(("reference", "image", "budget", "level"))]
    else:
        name = {"image gone": "image grid.depth=4", "image damaged": "budget: none", "truth gone": "reference"}[damage]
        lost, path = [name], report_log.image_path(folder, name)
        if damage == "image damaged":
            path.write_bytes(path.read_bytes()[:1000])
        else:
            path.unlink()
    told: list[str] = []
    found = run_report(prepared(*SHAFT), folder, resume=True, tell=lambda what, done, of: told.append(what))
    assert errors_of(found) == errors_of(whole[1])
    assert len(told) == len(lost)
    added = [json.loads(line)["name"] for line in (folder / LOG).read_text().splitlines()[-len(lost):]]
    assert added == lost


def test_points_alone_are_gone_on_with_for_the_rest(whole: tuple[Path, Report], tmp_path: Path) -> None:
    folder = tmp_path / "report"
    few = run_report(prepared(*SHAFT, everything=False), folder)
    assert (few.budget, few.refinement, few.saved) == (None, None, None)
    assert not (folder / "budget.csv").exists()
    count = measured(folder)
    assert errors_of(run_report(prepared(*SHAFT), folder, resume=True)) == errors_of(whole[1])
    assert (folder / "budget.csv").exists()
    assert len(set(names_in(folder))) == measured(folder) > count


def test_only_what_is_refused_is_left(tmp_path: Path) -> None:
    """Refused points weigh nothing; a log that ends before the last of them is gone on with all the same."""
    asked = prepared("uniform", "merged=true", sweep=None, knobs=chosen(["temporal"]), suite="full", everything=False)
    refused = next(spot for spot in asked.spots if spot.settings is None)
    asked = asked._replace(spots=(asked.spots[0], asked.spots[1], refused))
    folder = tmp_path / "report"
    found = run_report(asked, folder)
    assert found.points[-1].member == "failed"
    lines = (folder / LOG).read_text().splitlines(keepends=True)
    assert json.loads(lines[-1])["name"] == f"time 1 {refused.id}"
    (folder / LOG).write_text("".join(lines[:-1]))
    assert errors_of(run_report(asked, folder, resume=True, tell=lambda what, done, of: None)) == errors_of(found)


# --- folders ------------------------------------------------------------------------------------------


def test_a_folder_is_taken_unless_told_otherwise(whole: tuple[Path, Report], tmp_path: Path) -> None:
    folder = copied(whole[0], tmp_path)
    with pytest.raises(InputError, match="exists; give --resume to go on with it, --force to replace it"):
        check_target(folder)
    check_target(folder, force=True)
    check_target(folder, resume=True)
    (folder / "mine.txt").write_text("")
    for how in ({"force": True}, {"resume": True}):
        with pytest.raises(InputError, match=r"holds 'mine.txt', which is not part of a report"):
            check_target(folder, **how)
        with pytest.raises(InputError, match=r"holds 'mine.txt'"):
            run_report(prepared(*SHAFT), folder, **how)
    (folder / "mine.txt").unlink()
    (folder / IMAGES / "mine.png").write_text("")
    with pytest.raises(InputError, match=r"holds 'images/mine.png'"):
        check_target(folder, force=True)
    (folder / IMAGES / "mine.png").unlink()
    # Without its log it is a report still, by its JSON or its lock; without any of them it is not.
    for name in (LOG, "report.json"):
        (folder / name).unlink()
        check_target(folder, force=True)
    (folder / LOCK).unlink()
    with pytest.raises(InputError, match=r"holds 'budget.csv'"):
        check_target(folder, force=True)


def test_what_a_killed_write_leaves_behind_stops_nothing(whole: tuple[Path, Report], tmp_path: Path) -> None:
    """A partial file, a log without its first line, images alone: gone on with, or begun anew."""
    folder = copied(whole[0], tmp_path)
    for path in (folder / ".index.partial-c35b8ea6.html", folder / IMAGES / ".image-base.partial-00000000.npy"):
        path.write_text("half")
    found = run_report(prepared(*SHAFT), folder, resume=True)
    assert [point.errors for point in found.points] == [point.errors for point in whole[1].points]
    assert not list(folder.rglob(".*partial*"))
    lines = (folder / LOG).read_bytes().split(b"\n", 1)
    (folder / LOG).write_bytes(lines[0][:50] + b"\n" + lines[1])
    with pytest.raises(InputError, match="--resume"):
        run_report(prepared(*SHAFT), folder, resume=True)
    check_target(folder, force=True)
    for path in folder.iterdir():
        if path.name not in (IMAGES, LOCK):
            path.unlink()
    check_target(folder, force=True)


def test_one_report_writes_into_a_folder_at_a_time(whole: tuple[Path, Report], tmp_path: Path) -> None:
    folder = copied(whole[0], tmp_path)
    before = (folder / LOG).read_bytes()
    with report_log.locked(folder):
        for how in ({"force": True}, {"resume": True}):
            with pytest.raises(InputError, match="is being written by another report"):
                run_report(prepared(*SHAFT), folder, **how)
    assert (folder / LOG).read_bytes() == before
    with report_log.locked(folder):
        pass


@pytest.mark.parametrize(("name", "value"), [
    ("reference", None), ("reference", 3), ("reference", {}), ("image base", {}), ("image base", {"errors": {}}),
    ("image base", {"fault": 5}), ("memory base", 7), ("memory base", {"bytes": "x"}), ("memory base", {"bytes": -7.5}),
    ("time 0 base", {"seconds": "a", "stages": {}}), ("time 0 base", {"seconds": 0.0, "stages": {}}),
    ("time 0 base", {"seconds": math.inf, "stages": {}}), ("time 0 base", {"seconds": 1.0, "stages": None}),
    ("level 0.5", {}), ("saved", {}), ("saved", {"planned": [0, 0, 0, 0]}), ("what", {})])
def test_a_line_that_is_no_measurement_counts_as_not_there(whole: tuple[Path, Report], tmp_path: Path, name: str,
                                                           value: object) -> None:
    assert not sound(name, value)
    folder = copied(whole[0], tmp_path)
    report_log.append(folder, name, Entry(value, 1.0))
    found = run_report(prepared(*SHAFT), folder, resume=True)
    assert [point.errors for point in found.points] == [point.errors for point in whole[1].points]


@pytest.mark.parametrize("field", ["relmse", "absolute", "maximum", "worst"])
@pytest.mark.parametrize("value", ["x", None, -1.0, math.nan])
def test_errors_that_no_norm_has_are_measured_again(whole: tuple[Path, Report], field: str, value: object) -> None:
    errors = whole[1].points[0].errors._asdict()
    assert sound("image base", {"errors": errors})
    assert not sound("image base", {"errors": errors | {field: value}})
    assert not sound("image base", {"errors": errors | {"more": 1.0}})


def test_measurements_of_a_whole_log_are_sound(whole: tuple[Path, Report]) -> None:
    known = report_log.read(whole[0], prepared(*SHAFT).header)
    assert len(known) > 20
    assert all(sound(name, entry.value) for name, entry in known.items())


def test_files_that_have_changed_are_another_scene(tmp_path: Path) -> None:
    np.save(tmp_path / "fog.npy", np.ones((2, 2, 2)))
    medium = {"shape": "box", "extinction": 1.0, "density": {"source": {"type": "file", "path": "fog.npy"}}}
    (tmp_path / "s.json").write_text(json.dumps({"schema": 1, "scene": {
        "name": "s", "local_media": [medium], "lights": [{"type": "directional", "direction": [0, 1, 0],
                                                         "irradiance": [3, 3, 3]}]}}))
    before = report_points.digest(load(tmp_path / "s.json"))
    assert report_points.digest(load(tmp_path / "s.json")) == before
    np.save(tmp_path / "fog.npy", np.full((2, 2, 2), 0.5))
    assert report_points.digest(load(tmp_path / "s.json")) != before


@pytest.mark.parametrize(("text", "words"), [
    ("time=50", "one truth, which depends on it"), ("phase_function=isotropic", "one truth, which depends on it"),
    ("grid.far=1000", "one truth, which ends where the base's froxels end")])
def test_a_sweep_of_what_the_truth_has_is_refused(text: str, words: str) -> None:
    with pytest.raises(InputError, match=f"--sweep: turns .*{words}"):
        prepare(load("shaft", overrides=[*GRID, *SIZE]), Asked(knobs=(own_knob(text),)))


def test_errors_that_differ_by_rounding_are_equal(whole: tuple[Path, Report], tmp_path: Path) -> None:
    """The fastest of them is on the front, the others are not."""
    errors = {name: 3.294272973718802e-05 * (1.0 + k * 1e-15) for k, name in enumerate(ERRORS)}
    found = made_up(whole, tmp_path, errors, TIMES)
    fastest = min(found.points, key=lambda point: point.seconds.least if point.seconds else math.inf)
    assert [point.id for point in found.points if point.member == "certain"] == [fastest.id]


@pytest.mark.skipif(not flip_available(), reason="the package flip-evaluator (extra flip) is missing")
def test_flip_is_added_when_its_package_has_come(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    asked = prepare(load("uniform", overrides=["grid.width=8", "grid.height=6", "grid.depth=8", "camera.width=48",
                                               "camera.height=27"]),
                    Asked(knobs=(own_knob("grid.depth=4"),), everything=False))
    with monkeypatch.context() as without:
        without.setattr("froxel_ref.error_images.flip_available", lambda: False)
        first = run_report(asked, tmp_path / "report")
    assert all(point.errors.flip is None for point in first.points)
    second = run_report(asked, tmp_path / "report", resume=True)
    assert all(point.errors.flip is not None for point in second.points)
    assert [point.errors._replace(flip=None) for point in second.points] == [point.errors for point in first.points]
    assert [point.seconds for point in second.points] == [point.seconds for point in first.points]



def test_force_begins_anew(whole: tuple[Path, Report], tmp_path: Path) -> None:
    folder = copied(whole[0], tmp_path)
    found = run_report(prepared("uniform", everything=False), folder, force=True)
    assert found.setup.scene == "uniform"
    assert not (folder / "budget.csv").exists()
    assert len(list((folder / IMAGES).iterdir())) == 1 + len(found.points)
    assert len(names_in(folder)) == measured(folder)


def test_a_report_of_something_else_is_left_as_it_is(whole: tuple[Path, Report], tmp_path: Path) -> None:
    folder = copied(whole[0], tmp_path)
    before = {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}
    for other in (prepared("uniform"), prepared("shaft"), prepared(*SHAFT, sweep="grid.depth=4"),
                  prepared(*SHAFT, suite="full")):
        with pytest.raises(InputError, match=r"--resume: .* is of (another|other) "):
            run_report(other, folder, resume=True)
    assert {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()} == before


# --- what fails ---------------------------------------------------------------------------------------


def test_what_cannot_be_computed_is_a_point_that_failed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """NaN in the image; refused by the settings, by the frame; memory that does not suffice; overflow."""
    knob = Knob("trouble", "for this test", lambda settings: [
        Step("nan", ("albedo_at_zero=divide",)), Step("refused", ("grid.depth=0",)), Step("frame", ("grid.depth=3",)),
        Step("memory", ("grid.depth=5",)), Step("overflow", ("grid.depth=6",)), Step("fine", ("grid.depth=4",))],
        lambda scene, settings, planned: (True, "always"))
    monkeypatch.setattr(report_points, "KNOBS", (knob,))
    errors = {3: InputError("grid.depth", "is 3, which this frame refuses"), 5: MemoryError(),
              6: FloatingPointError("overflow encountered")}

    def failing(function: Any) -> Any:
        def run(subject: Any, settings: Settings, **options: Any) -> Any:
            if settings.grid.depth in errors:
                raise errors[settings.grid.depth]
            return function(subject, settings, **options)
        return run

    def frames(subject: Any, settings: Settings, **options: Any) -> Any:
        run = before(subject, settings, **options)
        return lambda: failing(lambda *_: run())(subject, settings)

    before = report.frames_of
    monkeypatch.setattr(report, "last_image", failing(report.last_image))
    monkeypatch.setattr(report, "frames_of", frames)
    asked = prepare(load("two-volumes", overrides=[*GRID, *SIZE]), Asked(knobs=(knob,), suite="full", limit_ms=1e5))
    found = run_report(asked, tmp_path / "report")
    points = {point.label: point for point in found.points}
    assert list(points) == ["as it is", "nan", "refused", "frame", "memory", "overflow", "fine"]
    words = {"nan": "NaN instead of ", "refused": "refused: settings.grid.depth: is 0, must be at least 1",
             "frame": "grid.depth: is 3, which this frame refuses", "memory": "memory: it does not fit",
             "overflow": "overflow encountered"}
    for label, why in words.items():
        point = points[label]
        assert point.member == "failed"
        assert point.fault.startswith(why)
        assert math.isnan(point.errors.relmse)
        assert point.errors.fault == point.fault
        assert (point.seconds is None) == (label != "nan")  # NaN takes its time
    assert points["fine"].member != "failed" != points["as it is"].member
    # Nothing that failed is recommended or in a row.
    assert found.recommendation is not None
    named = {row.point for row in (*found.equal_time, *found.equal_error)} | {found.recommendation.point}
    assert named.isdisjoint(f"trouble={label}" for label in words)
    # In the files: a row each, with the reason.
    raw = json.loads((tmp_path / "report" / "report.json").read_text())
    assert [(p["errors"]["relmse"] == "nan", p["member"] == "failed") for p in raw["points"]] == [
        (False, False), *[(True, True)] * 5, (False, False)]
    rows = {row["label"]: row for row in table(tmp_path / "report" / "points.csv")}
    for label, why in words.items():
        assert (rows[label]["relmse"], rows[label]["member"]) == ("nan", "failed")
        assert rows[label]["fault"].startswith(why)
    page = (tmp_path / "report" / "index.html").read_text()
    assert all(f"trouble={label}" in page for label in words)
    # And from the log alone.
    again = run_report(asked, tmp_path / "report", resume=True)
    assert errors_of(again) == errors_of(found)


def test_a_base_that_fails_is_a_report_all_the_same(tmp_path: Path) -> None:
    found = run_report(prepared("two-volumes", "albedo_at_zero=divide", sweep="albedo_at_zero=zero", limit_error=1.0),
                       tmp_path / "report")
    assert [point.member for point in found.points] == ["failed", "certain"]
    assert found.budget is None
    assert found.refinement is not None
    assert found.refinement.order is not None  # the divisor is a departure, which refinement replaces
    assert found.recommendation is not None
    assert found.recommendation.point == "albedo_at_zero=zero"


def test_a_part_whose_truth_fails_is_left_out_with_the_reason(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    before = report.last_image

    def failing(subject: Any, settings: Settings, **options: Any) -> Any:
        image = before(subject, settings, **options)
        return image * math.nan if settings.shadows == "exact" and settings.fidelity == "published" else image

    monkeypatch.setattr(report, "last_image", failing)
    found = run_report(prepared(*SHAFT), tmp_path / "report").budget
    assert found is not None
    assert "opaque shadows" not in {part.name for part in found.parts}
    why = next(each.why for each in found.left_out if each.name == "opaque shadows")
    assert why.startswith("could not be replaced: NaN instead of ")
    assert sum(part.share for part in found.parts) + found.rest + found.interaction == pytest.approx(1.0, abs=1e-12)


# --- the budget, by frames of its own -----------------------------------------------------------------


# What makes each part true, as it is typed; slices twice as many (the suite's `refine`), a froxel for each pixel.
TRUE = {"depth": ["grid.depth=16"], "lateral": ["grid.width=32", "grid.height=18"], "opaque shadows": ["shadows=exact"],
        "volumetric shadows": ["volumetric_shadows=exact"], "lookup": ["fog_lookup.method=trilinear"],
        "departures": ["fidelity=corrected", "integrator=analytic"], "phase": ["phase_mixing=mixture"]}


def frame_image(name: str, overrides: list[str]) -> list[list[float]]:
    """The last of four frames, of one camera at rest: radiance times exposure, a list for each channel."""
    scene, settings, _ = load(name, overrides=overrides)
    *_, last = run_sequence(scene, frames=4, first=3, settings=settings)
    image = np.broadcast_to(last.image, (3, 18, 32)) * last.display_exposure
    return [[float(value) for value in plane.ravel()] for plane in image]


def relmse(image: list[list[float]], truth: list[list[float]]) -> float:
    terms = [(a - b) ** 2 / (b * b + 0.01) for one, other in zip(image, truth, strict=True)
             for a, b in zip(one, other, strict=True)]
    return math.fsum(terms) / len(terms)


@pytest.mark.parametrize(("name", "overrides", "largest"), [
    ("shaft", ["fidelity=published"], "lateral"),
    ("two-volumes", [], "lateral"),
    ("lights", ["integrator=published"], "lateral"),
    ("thin-layer", ["volumetric_shadows=maps", "opacity_maps.harmonics=1", "shadow_maps.point_size=32"], "depth"),
    ("uniform", ["fog_lookup.method=noisy"], "lookup")])
def test_the_largest_parts_truth_lowers_the_total_as_the_budget_claims(tmp_path: Path, name: str, overrides: list[str],
                                                                       largest: str) -> None:
    found = run_report(prepared(name, *overrides), tmp_path / "report").budget
    assert found is not None
    # The parts add up to the whole, within rounding.
    shares = [part.share for part in found.parts]
    assert sum(shares) + found.rest + found.interaction == pytest.approx(1.0, abs=1e-12 * sum(map(abs, shares)))
    assert sum(found.region_totals.values()) == pytest.approx(1.0, abs=1e-12)
    for part in found.parts:
        assert sum(part.regions.values()) == pytest.approx(part.share, abs=1e-12)
    # Frames and the truth made anew, without the budget's settings, images or sums.
    typed = [*GRID, *SIZE, *overrides]
    scene, settings, _ = load(name, overrides=[*typed, *TRUE["departures"]])
    right = render_truth(scene, settings, rtol=1e-3, far=settings.grid.far).radiance * scene.camera.exposure
    truth = [[float(value) for value in plane.ravel()] for plane in right]
    total = relmse(frame_image(name, typed), truth)
    assert found.total == pytest.approx(total, rel=1e-9)
    for part in found.parts:
        assert part.without == pytest.approx(relmse(frame_image(name, [*typed, *TRUE[part.name]]), truth), rel=1e-9)
    claim = found.claim
    assert claim is not None
    assert (claim.name, found.parts[0].name) == (largest, largest)
    left = relmse(frame_image(name, [*typed, *TRUE[largest]]), truth)
    assert left < total
    assert claim.measured == pytest.approx(left, rel=1e-9)
    assert abs(math.sqrt(left) - math.sqrt(claim.claimed)) <= claim.slack * (1 + 1e-9)


def test_the_budgets_images_average_as_the_base_does(tmp_path: Path) -> None:
    """With a temporal filter: the frame without it is one centred sample."""
    found = run_report(prepared("uniform", "temporal.filter=scattering", "temporal.alpha=0.2"), tmp_path / "report")
    assert found.budget is not None
    part = next(part for part in found.budget.parts if part.name == "temporal filter")
    plain = run_report(prepared("uniform", everything=False), tmp_path / "plain")
    assert part.without == pytest.approx(plain.points[0].errors.relmse, rel=1e-12)
    assert found.budget.total == pytest.approx(found.points[0].errors.relmse, rel=1e-12)
    assert found.points[0].frames == 4


# --- refinement ---------------------------------------------------------------------------------------


MAPS = [{}, {"technique": "exponential"}, {"technique": "exponential", "point_map": "octahedral", "blur": 8},
        {"technique": "exponential", "downsample": 1}, {"point_map": "octahedral", "kernel": 15}, {"kernel": 0},
        {"border": 100}, {"technique": "exponential", "downsample": 64, "directional_size": 1024, "spot_size": 1024,
                          "point_size": 1024}, {"directional_size": 16384}, {"point_map": "octahedral", "border": 40}]
TILES = [{}, {"harmonics": 0}, {"harmonics": 32}, {"gutter": 8}, {"directional_size": 16}, {"directional_size": 200},
         {"large": 4096, "atlas": 16384}, {"smallest": 8, "small": 8, "large": 8, "gutter": 2}]


@pytest.mark.parametrize("factor", [1 / 16, 1 / 8, 1 / 4, 1 / 3, 1 / 2, 1.0, 2.0, 3.0, 8.0])
def test_refined_settings_are_allowed_ones(factor: float) -> None:
    """Settings check themselves; what they hold is the base's times the factor, rounded to what is allowed."""
    for shadows in MAPS:
        for tiles in TILES:
            settings = Settings(shadow_maps=ShadowMaps(**shadows), opacity_maps=OpacityMaps(**tiles),
                                long_range=LongRange(march=True, steps=12))
            found = refined(settings, (), factor)
            for name, count in (("width", 160), ("height", 90), ("depth", 64)):
                assert getattr(found.grid, name) == max(1, round(factor * count))
            assert (found.long_range.steps, found.long_range.noise) == (max(1, round(12 * factor)), False)
            for name in ("small", "large", "atlas", "smallest"):
                size, base = getattr(found.opacity_maps, name), getattr(settings.opacity_maps, name)
                assert size & (size - 1) == 0
                assert size <= max(base * factor, 64 if name == "atlas" else 8)
                assert 2 * size > min(base * factor, 4096)
            for name in ("directional_size", "spot_size", "point_size"):
                size, base = getattr(found.shadow_maps, name), getattr(settings.shadow_maps, name)
                unit = 2 * settings.shadow_maps.downsample
                least = max(32, 2 * settings.shadow_maps.edge + 10, 3 * settings.shadow_maps.edge) + unit
                assert size <= max(base * factor, least)
                assert size > min(base * factor, 16384) - unit
            assert found.opacity_maps.gutter <= settings.opacity_maps.gutter
            assert 1 <= found.opacity_maps.harmonics <= 32


def test_refined_settings_make_nothing_but_the_refined_approximate() -> None:
    scene, settings, _ = load("shaft", overrides=[
        *GRID, "fidelity=published", "temporal.filter=scattering", "checkerboard=true", "fog_lookup.method=noisy",
        "taa.on=true", "precision=float32", "volumetric_shadows=maps"])
    parts, _ = parts_of(scene, settings, plan(scene, settings), raster=(32, 18))
    found = refined(settings, parts, 1.0)
    left, _ = parts_of(scene, found, plan(scene, found), raster=(32, 18))
    assert {part.name for part in left} == {"depth", "lateral", "opaque shadows", "volumetric shadows"}
    assert found.grid == settings.grid
    assert found.shadow_maps == settings.shadow_maps
    assert found.opacity_maps == settings.opacity_maps


def test_harmonics_are_coefficients_less_one() -> None:
    counts = [refined(Settings(opacity_maps=OpacityMaps(harmonics=7)), (), factor).opacity_maps.harmonics
              for factor in (1 / 8, 1 / 4, 1 / 2, 1, 2, 8)]
    assert counts == [1, 1, 3, 7, 15, 32]


def test_a_level_is_named_by_what_it_refines() -> None:
    settings = refined(Settings(), (), 0.5)
    assert level_name(settings, shadowed=False, dimmed=False) == "80x45x32"
    assert level_name(settings, shadowed=True, dimmed=True) == "80x45x32, maps 128², K=1 on 128²"


# A coarse base for each scene, with maps that its levels make coarser still.
COARSE = ["grid.width=24", "grid.height=14", "grid.depth=32", "volumetric_shadows=maps",
          "shadow_maps.directional_size=512", "shadow_maps.spot_size=256", "shadow_maps.point_size=128",
          "opacity_maps.harmonics=7", "opacity_maps.small=32", "opacity_maps.large=64", "opacity_maps.smallest=32",
          "opacity_maps.atlas=1024", "opacity_maps.directional_size=128"]

# Width of the raster; orders of mean |error| and of √relMSE over ¼, ½ and 1 of the base, as measured; what is changed
# of the scene. Where many lights are, 8 of the 512 small ones are left, or the truth would take minutes.
ORDERS: dict[str, tuple[int, float, float, list[str]]] = {
    "ghosting": (48, 0.69, 0.37, []),
    "hall-walk": (32, 0.93, 0.77, []),
    "leak": (48, 1.91, 1.90, []),
    "leak-walk": (48, 1.98, 1.94, []),
    "lights": (48, 0.79, 0.60, []),
    "long-range": (48, 0.69, 0.66, []),
    "many-lights": (32, 0.92, 0.75, ["extra_lights.count=8"]),
    "particles-in-fog": (48, 0.76, 0.96, []),
    "ringing": (48, 1.04, 0.91, []),
    "shaft": (48, 1.27, 0.85, []),
    "smoke": (48, 0.81, 0.69, []),
    "thesis-hall": (32, 0.94, 0.78, []),
    "thin-layer": (48, 0.93, 0.68, []),
    "two-volumes": (48, 1.39, 1.43, []),
    "uniform": (48, 1.84, 1.63, []),
    "vacuum": (48, 1.05, 0.73, []),
}
MARGIN = 0.05  # other processors and versions of NumPy may see an edge of light a pixel further on


@pytest.mark.parametrize("name", builtin())
def test_the_frame_tends_to_the_truth(name: str) -> None:
    """Grid, maps and K refined together: mean |error| falls at each of ¼, ½, 1, with the order that was measured."""
    width, order, _, more = ORDERS[name]
    folder = data_file("smoke.vol").parent if name == "smoke" else None
    loaded = load(name, overrides=[f"camera.width={width}", f"camera.height={width * 9 // 16}", *COARSE, *more],
                  data=folder)
    found = make_subject(loaded, pixels=10_000, frames=16)
    truth = reference_image(found, rtol=1e-3)
    assert truth.converged.all()
    scene, how, _ = found.now(found.settings)
    parts, _ = parts_of(scene, how, plan(scene, how), raster=(width, width * 9 // 16))
    # As a report does it: where the long range is marched, the image at half its resolution is refined too.
    errors = [distance(last_image(found, refined(found.settings, parts, factor),
                                  finer=2 * int(2 * factor) + 1 if how.long_range.march else 1),
                       truth.radiance, epsilon=0.01) for factor in (0.25, 0.5, 1.0)]
    sizes = [each.absolute for each in errors]
    assert sizes[0] > sizes[1] > sizes[2] > 0.0
    fit = compare.order([4.0, 2.0, 1.0], sizes)
    print(f"{name}: mean |error| {', '.join(f'{size:.2e}' for size in sizes)}, order {fit.order:.2f}; √relMSE "
          f"{compare.order([4.0, 2.0, 1.0], [each.relmse**0.5 for each in errors]).order:.2f}")
    assert fit.order >= order - MARGIN


def test_a_reports_levels_are_those_images(whole: tuple[Path, Report]) -> None:
    found = whole[1].refinement
    assert found is not None
    asked = prepared(*SHAFT)
    truth = reference_image(asked.subject, rtol=TINY.rtol).radiance
    assert [level.step for level in found.levels] == [1.0, 0.5]
    for level, factor in zip(found.levels, TINY.levels, strict=True):
        how = refined(asked.subject.settings, asked.parts, factor)
        assert level.errors == distance(last_image(asked.subject, how), truth, epsilon=0.01)
        assert level.label == level_name(how, shadowed=True, dimmed=False)
    sizes = [level.errors.absolute for level in found.levels]
    assert found.absolute_order == pytest.approx(math.log2(sizes[0] / sizes[1]), rel=1e-12)
    assert found.order == pytest.approx(0.5 * math.log2(found.levels[0].errors.relmse / found.levels[1].errors.relmse),
                                        rel=1e-12)


# --- images that come from elsewhere ------------------------------------------------------------------


def test_a_scene_with_its_own_images_is_measured_like_any_other(tmp_path: Path) -> None:
    """Depth and radiance of 45 × 27 pixels, judged at 15 × 9 of them; with a long range behind the froxels too."""
    rows, columns = np.mgrid[:27, :45].astype(float)
    np.save(tmp_path / "depth.npy", 5.0 + 0.1 * rows + 0.3 * columns)
    np.save(tmp_path / "radiance.npy", np.ones((27, 45, 3)))
    scene = Scene(name="own", camera=Camera(width=45, height=27), lights=(DirectionalLight(
                  direction=(0.3, 1, 0.2), irradiance=(3, 2, 1)),),
                  image_buffers=ImageBuffers(depth="depth.npy", radiance="radiance.npy"),
                  global_media=(Medium(extinction=0.05),))
    for how in (Settings(grid=Grid(width=8, height=6, depth=8)),
                Settings(grid=Grid(width=8, height=6, depth=8, far=8.0), long_range=LongRange(march=True))):
        asked = prepare(Loaded(scene, how, tmp_path), Asked(knobs=(own_knob("grid.depth=4,16"),)))
        asked = prepare(asked.subject.loaded, asked.asked)._replace(suite=TINY)
        found = run_report(asked, tmp_path / f"report {how.long_range.march}")
        assert all(not point.fault for point in found.points)
        assert found.setup.size == (45, 27)
        assert found.budget is not None
        assert found.refinement is not None
        assert all(not level.errors.fault for level in found.refinement.levels)
        assert found.saved is not None
        assert found.saved.same


# --- sums ---------------------------------------------------------------------------------------------


def made_up(whole: tuple[Path, Report], tmp_path: Path, errors: Mapping[str, float], times: Mapping[str, list[float]],
            **asked: Any) -> Report:
    """The report that numbers made up for its points would make."""
    folder = copied(whole[0], tmp_path)
    wanted = prepared(*SHAFT, **asked)
    done = report_log.read(folder, wanted.header)
    for name, value in errors.items():
        entry = done[f"image {name}"]
        done[f"image {name}"] = entry._replace(value={"errors": entry.value["errors"] | {"relmse": value}})
    for name, seconds in times.items():
        for number, each in enumerate(seconds):
            done[f"time {number} {name}"] = Entry({"seconds": each, "stages": {"media": each / 2}}, each)
    return put_together(wanted, folder, done)


ERRORS = {"base": 0.02, "grid.depth=4": 0.1, "grid.depth=16": 0.004}
TIMES = {"base": [0.020, 0.022], "grid.depth=4": [0.011, 0.010], "grid.depth=16": [0.040, 0.044]}


def test_no_error_bar_is_shorter_than_the_noise_of_nine_points_in_ten() -> None:
    def point(median: float) -> Point:
        return Point("x", "x", "x", (), 1, None, Spread(2.0, median, 3, median), {}, None, "")  # type: ignore[arg-type]

    assert noise_of([]) == 1.0
    assert noise_of([point(2.0)._replace(seconds=None)]) == 1.0
    assert noise_of([point(2.5)]) == 1.25
    assert noise_of([point(2.0 + 0.1 * k) for k in range(10)]) == pytest.approx(2.8 / 2.0)  # the ninth of ten
    assert noise_of([*[point(2.0)] * 9, point(9.0)]) == 1.0


def test_times_of_points_and_their_bars(whole: tuple[Path, Report], tmp_path: Path) -> None:
    found = made_up(whole, tmp_path, ERRORS, TIMES | {"grid.depth=4": [0.010, 0.012]})
    # Medians of two are means; the quantile of three that nine in ten stay below is the largest: 1.1.
    assert found.setup.noise == pytest.approx(1.1)
    spreads = [point.seconds for point in found.points]
    assert spreads == [Spread(0.020, pytest.approx(0.021), 2, pytest.approx(0.022)),
                       Spread(0.010, pytest.approx(0.011), 2, pytest.approx(0.011)),
                       Spread(0.040, pytest.approx(0.042), 2, pytest.approx(0.044))]
    assert [point.stages for point in found.points] == [{"media": 0.010}, {"media": 0.005}, {"media": 0.020}]
    assert [point.member for point in found.points] == ["certain"] * 3


def test_rows_of_equal_time_and_of_equal_error(whole: tuple[Path, Report], tmp_path: Path) -> None:
    found = made_up(whole, tmp_path, ERRORS, TIMES)
    high = 0.021  # of the base: noise is 1.05 here
    assert [(row.budget / high, row.point) for row in found.equal_time] == [
        (pytest.approx(0.25), None), (pytest.approx(0.5), "grid.depth=4"), (pytest.approx(1.0), "base"),
        (pytest.approx(2.0), "grid.depth=16"), (pytest.approx(4.0), "grid.depth=16")]
    assert [(row.relmse, row.point) for row in found.equal_error] == [
        (0.2, "grid.depth=4"), (0.1, "grid.depth=4"), (0.05, "base"), (0.02, "base"), (0.01, "grid.depth=16"),
        (0.005, "grid.depth=16")]


def test_the_base_meets_the_budget_that_is_its_own(whole: tuple[Path, Report], tmp_path: Path) -> None:
    """Where others' times spread more than the base's, its bar is longer than to its median, and words say so."""
    times = TIMES | {"grid.depth=4": [0.010, 0.030], "grid.depth=16": [0.4, 0.9]}
    found = made_up(whole, tmp_path, ERRORS, times, limit_ms=39.0)
    assert found.setup.noise == pytest.approx(2.0)
    assert found.equal_time[2].budget == pytest.approx(0.040)
    assert [row.point for row in found.equal_time] == [None, "grid.depth=4", "base", "base", "base"]
    # 20 to 40 ms may be within 39, 10 to 20 surely are.
    assert found.recommendation is not None
    assert found.recommendation.words.startswith("grid.depth=4 takes 10 to 20 ms a frame with relMSE 0.1. The next "
                                                 "step up is base: 20 to 40 ms")


def test_a_row_of_equal_time_has_what_surely_fits(whole: tuple[Path, Report], tmp_path: Path) -> None:
    """Of 30 to 60 ms the lower end alone lies within the base's 40: the base is taken, though less exact."""
    found = made_up(whole, tmp_path, ERRORS, TIMES | {"grid.depth=4": [0.010, 0.030], "grid.depth=16": [0.03, 0.03]})
    assert found.points[2].seconds is not None
    assert found.points[2].seconds[:2] == (0.03, 0.03)
    assert found.points[2].seconds.high == pytest.approx(0.06)
    assert [row.point for row in found.equal_time] == [None, "grid.depth=4", "base", "grid.depth=16", "grid.depth=16"]


def test_points_without_an_error_above_0_make_no_rows_of_error(whole: tuple[Path, Report], tmp_path: Path) -> None:
    found = made_up(whole, tmp_path, dict.fromkeys(ERRORS, 0.0), TIMES)
    assert found.equal_error == ()
    assert [row.point for row in found.equal_time][-1] == "grid.depth=4"


@pytest.mark.parametrize(("limit", "met", "point", "up", "down", "words"), [
    ({"limit_ms": 25.0}, True, "base", "grid.depth=16", "grid.depth=4",
     "base takes 20 to 21 ms a frame with relMSE 0.02. The next step up is grid.depth=16: 40 to 42 ms and relMSE "
     "0.004, 5 times less error for 2 times the time."),
    ({"limit_ms": 5.0}, False, "grid.depth=4", "base", None,
     "grid.depth=4 takes 10 to 10.5 ms a frame with relMSE 0.1; nothing that was measured surely meets 5 ms a "
     "frame, this comes closest. The next step up is base: 20 to 21 ms and relMSE 0.02, 5 times less error for 2 times "
     "the time."),
    ({"limit_error": 0.005}, True, "grid.depth=16", None, "base",
     "grid.depth=16 takes 40 to 42 ms a frame with relMSE 0.004. Nothing that was measured is more exact by 5 % or "
     "more."),
    ({"limit_error": 1e-6}, False, "grid.depth=16", None, "base",
     "grid.depth=16 takes 40 to 42 ms a frame with relMSE 0.004; nothing that was measured meets relMSE at most 1e-06, "
     "this comes closest. Nothing that was measured is more exact by 5 % or more.")])
def test_what_is_recommended_in_words(whole: tuple[Path, Report], tmp_path: Path, limit: dict[str, float], met: bool,
                                      point: str, up: str | None, down: str | None, words: str) -> None:
    found = made_up(whole, tmp_path, ERRORS, TIMES, **limit).recommendation
    assert found is not None
    assert (found.met, found.point, found.up, found.down) == (met, point, up, down)
    assert found.words == words
    assert found.overrides == (() if point == "base" else (point,))


def test_the_next_step_may_have_no_error_at_all(whole: tuple[Path, Report], tmp_path: Path) -> None:
    found = made_up(whole, tmp_path, ERRORS | {"grid.depth=16": 0.0}, TIMES, limit_ms=25.0).recommendation
    assert found is not None
    assert "relMSE 0, infinitely less error for 2 times the time." in found.words


def test_where_nothing_could_be_measured_nothing_is_recommended(whole: tuple[Path, Report], tmp_path: Path) -> None:
    found = made_up(whole, tmp_path, dict.fromkeys(ERRORS, math.nan), TIMES, limit_ms=25.0)
    assert found.recommendation is not None
    assert (found.recommendation.met, found.recommendation.words) == (False, "No point could be measured.")
    assert (found.equal_error, {row.point for row in found.equal_time}) == ((), {None})
    assert {point.member for point in found.points} == {"failed"}


@pytest.mark.parametrize("value", [math.nan, 0.0, math.inf])
@pytest.mark.parametrize("level", ["level 0.5", "level 1"])
def test_a_level_without_an_error_leaves_no_order(whole: tuple[Path, Report], tmp_path: Path, level: str,
                                                  value: float) -> None:
    folder = copied(whole[0], tmp_path)
    asked = prepared(*SHAFT)
    done = report_log.read(folder, asked.header)
    entry = done[level]
    errors = entry.value["errors"] | {"relmse": value}
    done[level] = entry._replace(value=entry.value | {"errors": errors})
    found = put_together(asked, folder, done).refinement
    assert found is not None
    assert (found.order, found.residual) == (None, None)
    assert found.absolute_order is not None


def test_a_slow_point_is_run_twice(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(report_points.SUITES, "quick", TINY._replace(repeats=4, slow=1e-9))
    slow = run_report(prepared(everything=False), tmp_path / "slow")
    assert {point.seconds.runs for point in slow.points if point.seconds} == {2}
    monkeypatch.setitem(report_points.SUITES, "quick", TINY._replace(repeats=4, slow=1e9))
    assert {point.seconds.runs for point in run_report(prepared(everything=False), tmp_path / "fast").points
            if point.seconds} == {4}


def test_measure_is_what_run_report_writes(tmp_path: Path) -> None:
    asked = prepared(everything=False)
    report_log.begin(tmp_path, asked.header)
    found = measure(asked, tmp_path)
    assert found.points[0].overrides == ()
    assert found.points[1].overrides == ("grid.depth=4",)
    frame = run_frame(asked.subject.now(asked.subject.settings)[0], replace(asked.subject.settings, time=0.1),
                      outputs=["apply/radiance"])
    assert set(found.points[0].stages) == set(frame.timings)
    assert Switches() == asked.subject.settings.switches
