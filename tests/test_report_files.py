"""Reports as JSON and CSV: nothing is lost, nothing is not valid, faults name their place."""

from __future__ import annotations

import csv
import io
import json
import math
import shlex
from pathlib import Path

import numpy as np
import pytest
from report_examples import EXAMPLES, minimal, rich

from froxel_ref.records import InputError
from froxel_ref.report_files import (
    FORMAT,
    PICTURES,
    budget_csv,
    points_csv,
    refinement_csv,
    report_from_json,
    report_json,
    write_report,
)
from froxel_ref.report_record import Report, Spread

NAMES = tuple(EXAMPLES)


def rows_of(text: str) -> list[dict[str, str]]:
    return list(csv.DictReader(io.StringIO(text)))


@pytest.mark.parametrize("name", NAMES)
def test_a_report_comes_back_from_json_number_for_number(name: str):
    # NaN is unlike itself, but repr shows it, and every other number to its last bit.
    report = EXAMPLES[name]()
    text = json.dumps(report_json(report), allow_nan=False)
    again = report_from_json(json.loads(text))
    assert repr(again) == repr(report)
    assert type(again) is Report


def test_numbers_of_numpy_become_plain_ones():
    report = minimal()
    point = report.points[0]._replace(peak_bytes=np.int64(7), seconds=Spread(np.float64(0.5), np.float32(0.25), 3))
    raw = report_json(report._replace(points=(point,)))["points"][0]
    assert raw["peak_bytes"] == 7
    assert type(raw["peak_bytes"]) is int
    assert (type(raw["seconds"]["least"]), raw["seconds"]["median"]) == (float, 0.25)


def test_json_says_what_its_numbers_are():
    raw = report_json(rich())
    assert (raw["format"], raw["schema_version"]) == (FORMAT, 1)
    # Every path of `columns` leads somewhere.
    for path in raw["columns"]:
        place = raw
        for step in path.replace("[]", ".[]").split("."):
            if step == "NAME":
                assert place
                break
            place = place[0] if step == "[]" else place[step]


@pytest.mark.parametrize(("change", "message"), [
    (lambda raw: raw | {"format": "x"}, "format: is 'x', must be 'froxel-ref report'"),
    (lambda raw: raw | {"schema_version": 2}, "schema_version: is 2, must be 1"),
    (lambda raw: raw | {"schema_version": True}, "schema_version: is True, must be 1"),
    (lambda raw: raw | {"extra": 1}, "extra: is not a key here"),
    (lambda raw: {key: raw[key] for key in raw if key != "points"}, "points: is missing"),
    (lambda raw: raw | {"points": {}}, "points: is {}, must be a list"),
    (lambda raw: raw | {"setup": raw["setup"] | {"grid": [1, 2]}}, "setup.grid: has length 2, must have 3"),
    (lambda raw: raw | {"setup": raw["setup"] | {"epsilon": "big"}}, "setup.epsilon: is 'big', must be a number"),
    (lambda raw: raw | {"setup": raw["setup"] | {"frames": 1.5}}, "setup.frames: is 1.5, must be a whole number"),
    (lambda raw: raw | {"setup": raw["setup"] | {"frames": True}}, "setup.frames: is True, must be a whole number"),
    (lambda raw: raw | {"setup": raw["setup"] | {"machine": {"cores": 2}}}, "setup.machine.cores: is 2, must be a str"),
    (lambda raw: raw | {"reference": None}, "reference: is None, must be an object"),
    (lambda raw: [raw], "must be an object"),
])
def test_faults_of_json_name_their_place(change, message: str):
    with pytest.raises(InputError) as caught:
        report_from_json(change(report_json(minimal())))
    assert message in str(caught.value)


@pytest.mark.parametrize("name", NAMES)
def test_points_have_a_row_each_with_every_number(name: str):
    report = EXAMPLES[name]()
    rows = rows_of(points_csv(report.points))
    assert [row["id"] for row in rows] == [point.id for point in report.points]
    for row, point in zip(rows, report.points, strict=True):
        assert np.array_equal(float(row["relmse"]), point.errors.relmse, equal_nan=True)
        assert np.array_equal(float(row["quantile_999"]), point.errors.quantile, equal_nan=True)
        assert row["flip"] == ("" if point.errors.flip is None else repr(point.errors.flip))
        assert row["time_least_s"] == ("" if point.seconds is None else repr(point.seconds.least))
        assert row["time_median_s"] == ("" if point.seconds is None else repr(point.seconds.median))
        assert row["runs"] == ("" if point.seconds is None else str(point.seconds.runs))
        assert row["peak_bytes"] == ("" if point.peak_bytes is None else str(point.peak_bytes))
        assert tuple(shlex.split(row["overrides"])) == point.overrides
        assert (row["member"], row["fault"], row["error_fault"]) == (point.member, point.fault, point.errors.fault)
        stages = {key: value for key, value in row.items() if key.startswith("stage_") and value}
        assert stages == {f"stage_{key}_s": repr(value) for key, value in point.stages.items()}


def test_the_budgets_rows_add_up():
    budget = rich().budget
    assert budget is not None
    rows = rows_of(budget_csv(budget))
    assert [row["row"] for row in rows] == ["part"] * 5 + ["rest", "interaction", "total"]
    shares = [float(row["share"]) for row in rows]
    assert math.isclose(sum(shares[:-1]), shares[-1], rel_tol=1e-12)
    for row in rows[:5]:
        regions = [float(value) for key, value in row.items() if key.startswith("share_in_")]
        assert math.isclose(sum(regions), float(row["share"]), rel_tol=1e-12)


def test_levels_have_a_row_each():
    refinement = rich().refinement
    assert refinement is not None
    rows = rows_of(refinement_csv(refinement.levels))
    assert [float(row["step"]) for row in rows] == [1.0, 0.5, 0.25, 0.125, 0.0625]
    assert [float(row["relmse"]) for row in rows] == [level.errors.relmse for level in refinement.levels]


def test_a_report_is_written_file_by_file(tmp_path: Path):
    written = write_report(tmp_path, rich(), pictures={PICTURES[0]: b"picture"})
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted(path.name for path in written)
    assert {path.name for path in written} == {"report.json", "points.csv", "budget.csv", "refinement.csv",
                                               "index.html", PICTURES[0]}
    assert written[-1].name == "index.html"
    assert (tmp_path / PICTURES[0]).read_bytes() == b"picture"
    assert repr(report_from_json(json.loads((tmp_path / "report.json").read_text("utf-8")))) == repr(rich())


def test_what_an_earlier_report_left_behind_goes(tmp_path: Path):
    write_report(tmp_path, rich(), pictures={PICTURES[0]: b"picture"})
    (tmp_path / "notes.txt").write_text("mine")
    write_report(tmp_path, minimal(), pictures={})
    assert {path.name for path in tmp_path.iterdir()} == {"report.json", "points.csv", "index.html", "notes.txt"}


def test_a_folder_that_is_not_there_is_refused(tmp_path: Path):
    with pytest.raises(InputError, match="its folder does not exist"):
        write_report(tmp_path / "none", minimal(), pictures={})
