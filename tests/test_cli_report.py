"""The command ``report``: what it prints and writes, and how it ends."""

from __future__ import annotations

import json
import math
import os
import re
import signal
import subprocess
import sys
import time
import webbrowser
from pathlib import Path

import pytest

from froxel_ref import cli_report, report_points
from froxel_ref.cli import main
from froxel_ref.error_images import reference_image
from froxel_ref.knobs import KNOBS, SUITES
from froxel_ref.report_log import IMAGES, LOCK, LOG
from froxel_ref.report_points import Suite

SMALL = ["--grid", "8x6x8", "--size", "32x18"]
SWEEP = ["--sweep", "grid.depth=4,16"]
TINY = Suite(pixels=600, frames=4, rtol=1e-3, repeats=2, slow=2.0, refine=2, levels=(0.5, 1.0))


@pytest.fixture(autouse=True)
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Each test in an empty folder of its own, with few pixels, frames and runs; nothing opens a browser."""
    monkeypatch.chdir(tmp_path)
    for name in SUITES:
        monkeypatch.setitem(report_points.SUITES, name, TINY)
    monkeypatch.setattr(webbrowser, "open", lambda url: pytest.fail(f"opened {url}"))
    return tmp_path


def run(capsys: pytest.CaptureFixture[str], *arguments: str, code: int = 0) -> tuple[str, str]:
    """What the command prints to standard output and to standard error."""
    assert main(["report", *arguments]) == code
    found = capsys.readouterr()
    return found.out, found.err


def refused(capsys: pytest.CaptureFixture[str], *arguments: str) -> str:
    """The one line that a command says that must not succeed."""
    out, err = run(capsys, *arguments, code=2)
    assert out == ""
    assert re.fullmatch(r"froxel-ref: error: [^\n]+\n", err), err
    return err.removeprefix("froxel-ref: error: ").rstrip("\n")


def contents(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in sorted(folder.rglob("*")) if path.is_file()}


def numbers(line: str) -> list[float]:
    return [float(text) for text in re.findall(r"\d\.\d\de[+-]\d\d", line)]


# --- what is printed ----------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def shaft(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A whole report of a beam of light, with the lines that it printed."""
    folder = tmp_path_factory.mktemp("shaft")
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(report_points.SUITES, "quick", TINY)
        patch.chdir(folder)
        with (folder / "printed").open("w") as file:
            patch.setattr(sys, "stdout", file)
            assert main(["report", "shaft", *SMALL, *SWEEP, "--fidelity", "published", "--budget-ms", "1e5"]) == 0
    return folder


def lines_of(folder: Path) -> list[str]:
    return (folder / "printed").read_text().splitlines()


def test_the_last_line_is_the_page(shaft: Path) -> None:
    lines = lines_of(shaft)
    assert lines[-1] == os.path.join("report-shaft", "index.html")
    assert (shaft / lines[-1]).read_text().lstrip().lower().startswith("<!doctype html>")
    assert lines[0].startswith("shaft: frames of 32 x 18 pixels, errors of 32 x 18 ones against the truth (relMSE of ")
    assert " 3 points in " in lines[0]
    assert sorted(entry.name for entry in shaft.iterdir()) == ["printed", "report-shaft"]


def test_points_are_printed_from_the_fastest_to_the_slowest(shaft: Path) -> None:
    raw = json.loads((shaft / "report-shaft" / "report.json").read_text())
    lines = lines_of(shaft)
    head = next(i for i, line in enumerate(lines) if line.startswith("point "))
    assert lines[head].split() == ["point", "ms", "MB", "relMSE", "bias", "FLIP", "front"]
    shown = [point for point in raw["points"] if point["member"] != "dominated" or point["id"] == "base"]
    shown.sort(key=lambda point: point["seconds"]["least"])
    for line, point in zip(lines[head + 1:], shown, strict=False):
        cells = line.split()
        assert cells[0] == point["id"]
        bar = max(point["seconds"]["median"], point["seconds"]["high"])
        assert cells[1] == f"{1e3 * point['seconds']['least']:.1f}–{1e3 * bar:.1f}"
        assert numbers(line) == [float(f"{point['errors']['relmse']:.2e}")]
        assert cells[-1] == point["member"]
    hidden = len(raw["points"]) - len(shown)
    words = {0: "budget ", 1: "and 1 point that another one surely beats in both",
             2: "and 2 points that another one surely beats in both"}[hidden]
    assert lines[head + 1 + len(shown)].startswith(words)


def test_the_budget_says_that_it_adds_up_and_what_it_claims(shaft: Path) -> None:
    """Shares as printed add up to the total as printed; the roots as told differ by less than the slack as told."""
    budget = json.loads((shaft / "report-shaft" / "report.json").read_text())["budget"]
    lines = lines_of(shaft)
    head = next(i for i, line in enumerate(lines) if line.startswith("budget "))
    rows = lines[head + 1:head + 4 + len(budget["parts"])]
    names = [part["name"] for part in budget["parts"]]
    assert names[0] == "lateral"
    for line, name in zip(rows, [*names, "rest", "interaction", "total"], strict=True):
        assert line.startswith(name)
    shares = [float(re.search(r"(-?\d+\.\d) %", line)[1]) for line in rows]  # type: ignore[index]
    assert shares[-1] == 100.0
    assert sum(shares[:-1]) == pytest.approx(100.0, abs=0.05 * len(shares))
    assert numbers(rows[-1]) == [float(f"{budget['total']:.2e}")]
    claim = lines[head + 1 + len(rows)]
    found = re.fullmatch(r"with lateral true, by the budget (\S+) should be left, and (\S+) is: the roots differ by "
                         r"(\S+), what it does together with others explains up to (\S+)", claim)
    assert found is not None
    claimed, left, apart, slack = (float(text) for text in found.groups())
    assert left < budget["total"]
    assert apart == pytest.approx(abs(math.sqrt(claimed) - math.sqrt(left)), rel=0.02)
    assert apart <= slack


def test_the_refinement_and_what_leaving_out_saves_are_printed(shaft: Path) -> None:
    raw = json.loads((shaft / "report-shaft" / "report.json").read_text())
    text = (shaft / "printed").read_text()
    order, absolute = raw["refinement"]["order"], raw["refinement"]["absolute_order"]
    told = [f"{words} falls with order {value:.2f}" if value >= 0.25 else
            f"{words} does not fall steadily (order {value:.2f})"
            for words, value in (("√relMSE", order), ("mean |error|", absolute))]
    assert "; ".join(told) + "\n" in text
    for level in raw["refinement"]["levels"]:
        line = next(line for line in text.splitlines() if line.startswith(level["label"]))
        assert numbers(line) == [float(f"{level['errors'][name]:.2e}") for name in ("relmse", "absolute")]
    assert re.search(rf"^left out: {len(raw['saved']['left_out'])} stages and parts; \d+\.\d\d times as fast as with "
                     r"everything forced on, \d+\.\d\d times less memory, the same bit for bit$", text, re.MULTILINE)


def test_a_recommendation_is_printed_as_it_can_be_typed(shaft: Path) -> None:
    chosen = json.loads((shaft / "report-shaft" / "report.json").read_text())["recommendation"]
    lines = lines_of(shaft)
    at = lines.index(f"for 100000 ms a frame: {chosen['words']}")
    assert chosen["met"]
    assert lines[at + 1] == "".join(f"  --set '{text}'" for text in chosen["overrides"]) or not chosen["overrides"]


def test_frames_that_differ_are_said_loudly(capsys: pytest.CaptureFixture[str],
                                            monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("froxel_ref.measuring._equal", lambda a, b: False)
    out, _ = run(capsys, "uniform", *SMALL, *SWEEP)
    assert "less memory, NOT THE SAME\n" in out


def test_a_point_that_is_no_number_is_printed_and_written(capsys: pytest.CaptureFixture[str], here: Path) -> None:
    """0/0 in empty space, as listing 3.1 has it: NaN in every table, with the reason, beside what went well."""
    out, err = run(capsys, "two-volumes", *SMALL, "--sweep", "albedo_at_zero=divide,zero", *SWEEP, "--points-only")
    assert err == ""
    line = next(line for line in out.splitlines() if line.startswith("albedo_at_zero=divide"))
    assert re.search(r" nan +\+?nan % .*failed: NaN instead of \S+ at \(0, 0, 0\), the first of 1728$", line)
    assert " 4 points in " in out  # the base, the divisor and two depths: zero is what the base has
    raw = json.loads((here / "report-two-volumes" / "report.json").read_text())
    point = next(point for point in raw["points"] if point["id"] == "albedo_at_zero=divide")
    assert (point["errors"]["relmse"], point["member"]) == ("nan", "failed")
    assert point["fault"].startswith("NaN instead of ")
    row = next(line for line in (here / "report-two-volumes" / "points.csv").read_text().splitlines()
               if line.startswith("albedo_at_zero=divide"))
    assert ",nan,nan,nan,nan," in row
    assert "failed,\"NaN instead of " in row


def test_what_does_not_go_with_the_base_is_printed_too(capsys: pytest.CaptureFixture[str]) -> None:
    out, _ = run(capsys, "uniform", *SMALL, "--set", "merged=true", "--knobs", "temporal, shadows", "--suite", "full",
                 "--points-only")
    assert re.search(r"^temporal=media, α 0.2 +- +- +nan .*failed: refused: settings.merged: is on with the temporal "
                     r"filter 'media', must be off", out, re.MULTILINE)
    assert "\nnot turned: shadows (the scene has nothing that casts a shadow)\n" in out


def test_points_only_leaves_out_the_rest(capsys: pytest.CaptureFixture[str], here: Path) -> None:
    out, err = run(capsys, "uniform", *SMALL, *SWEEP, "--points-only", "-o", "out")
    assert err == ""
    assert "budget" not in out
    assert "refined" not in out
    assert "left out" not in out
    raw = json.loads((here / "out" / "report.json").read_text())
    assert (raw["budget"], raw["refinement"], raw["saved"]) == (None, None, None)
    assert raw["setup"]["overrides"] == [
        "settings.grid.width=8", "settings.grid.height=6", "settings.grid.depth=8", "scene.camera.width=32",
        "scene.camera.height=18"]
    assert raw["setup"]["about"].startswith("Uniform fog")


def test_the_thesiss_whole_frame(capsys: pytest.CaptureFixture[str], here: Path) -> None:
    """Every stage switched on: all averages, all parts, and the same frame with everything forced on."""
    out, err = run(capsys, "shaft", *SMALL, *SWEEP, "--preset", "thesis")
    assert err == ""
    assert "the same bit for bit" in out
    raw = json.loads((here / "report-shaft" / "report.json").read_text())
    assert {part["name"] for part in raw["budget"]["parts"]} >= {
        "temporal filter", "checkerboard", "lookup", "anti-aliasing", "volumetric shadows"}
    assert [point["frames"] for point in raw["points"]] == [4, 4, 4]


def test_plots_and_flip_may_be_missing(capsys: pytest.CaptureFixture[str], here: Path,
                                       monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("froxel_ref.report_plots.plots_available", lambda: False)
    monkeypatch.setattr("froxel_ref.flip.flip_available", lambda: False)
    monkeypatch.setattr("froxel_ref.error_images.flip_available", lambda: False)
    out, err = run(capsys, "uniform", *SMALL, *SWEEP, "--points-only")
    assert [line.partition(",")[0] for line in err.splitlines()] == [
        "froxel-ref: note: without plots", "froxel-ref: note: without HDR-FLIP"]
    assert out.endswith("index.html\n")
    # Pictures of errors need neither.
    assert [path.name for path in (here / "report-uniform").glob("*.png")] == ["errors.png"]


def test_knobs_are_listed(capsys: pytest.CaptureFixture[str], here: Path) -> None:
    out, err = run(capsys, "uniform", "--knobs", "list")
    assert err == ""
    lines = out.splitlines()
    assert [re.split("  +", line)[0] for line in lines[1:]] == [knob.name for knob in KNOBS]
    assert not os.listdir(here)


def test_the_examples_of_the_help_are_accepted(capsys: pytest.CaptureFixture[str], here: Path,
                                               monkeypatch: pytest.MonkeyPatch) -> None:
    """Each is a command line that is understood, up to measuring."""
    import shlex

    out, _ = run(capsys, "--help")
    examples = re.findall(r"^  froxel-ref report (.+)$", out, re.MULTILINE)
    assert len(examples) >= 5
    asked = []

    def stop(prepared: object, folder: Path, **options: object) -> None:
        asked.append((prepared, folder.name, options["resume"]))
        raise KeyboardInterrupt

    monkeypatch.setattr("froxel_ref.report_folder.run_report", stop)
    for example in examples:
        assert main(["report", *shlex.split(example), "--force"] if "--resume" not in example else
                    ["report", *shlex.split(example)]) == 130
    assert len(asked) == len(examples)
    assert sum(resume for _, _, resume in asked) == sum("--resume" in example for example in examples)
    assert not os.listdir(here)


# --- bad input ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(("arguments", "words"), [
    (["unifrom"], r"scene: 'unifrom' .*did you mean 'uniform'\?"),
    (["uniform", "--knobs", "slice"], r"--knobs: has 'slice'; did you mean 'slices'\?"),
    (["uniform", "--knobs", "slices,nonsense,grid"], "--knobs: has 'nonsense'; known: anti-aliasing, "),
    (["uniform", "--knobs", ""], "--knobs: is empty, must name some of grid, "),
    (["uniform", "--knobs", " , "], "--knobs: is empty, must name some of grid, "),
    (["uniform", "--knobs", "shadows"],
     r"--knobs: leaves nothing to sweep \(shadows: the scene has nothing that casts a shadow\)"),
    (["uniform", "--knobs", "whole"], r"--knobs: leaves nothing to sweep \(.*--suite full may have others\)"),
    (["uniform", "--sweep", "grid.depth=8"], r"--sweep: leaves nothing to sweep \(.* the base's own"),
    (["uniform", "--sweep", "grid.depth="], "--sweep: is 'grid.depth=': an empty sweep, must have a value at least"),
    (["uniform", "--sweep", "grid.depth"], "--sweep: is 'grid.depth', must be path=value,value,…"),
    (["uniform", "--sweep", "grid.dept=4"], r"settings.grid.dept: is not a key here; did you mean 'depth'\?"),
    (["uniform", "--sweep", "grid.depth=4,many"], "settings.grid.depth: is 'many', must be a whole number"),
    (["uniform", "--sweep", "camera.width=8"], "camera.width: is of the scene, must be a setting"),
    (["uniform", "--sweep", "lights[0].irradiance=[1,1,1]"], r"lights\[0\].irradiance: is of the scene, must be a set"),
    (["uniform", *SWEEP, "--suite", "quik"], r"--suite: is 'quik'; did you mean 'quick'\?"),
    (["uniform", *SWEEP, "--budget-ms", "0"], "--budget-ms: is '0', must be a number above 0 such as 33"),
    (["uniform", *SWEEP, "--budget-ms", "33ms"], "--budget-ms: is '33ms', must be a number above 0 such as 33"),
    (["uniform", *SWEEP, "--budget-ms", "1e999"], "--budget-ms: is '1e999', must be a number above 0"),
    (["uniform", *SWEEP, "--budget-ms", "-1"], "--budget-ms: is '-1', must be a number above 0"),
    (["uniform", *SWEEP, "--max-error", "nan"], "--max-error: is 'nan', must be a number above 0 such as 1e-3"),
    (["uniform", *SWEEP, "--budget-ms", "33", "--max-error", "1"], "--max-error: is given with --budget-ms, must be"),
    (["uniform", *SWEEP, "--force", "--resume"], "--resume: is given with --force, must be one of the two"),
    (["uniform", *SWEEP, "--resume"],
     "--resume: 'report-uniform' does not exist: there are no measurements to go on with"),
    (["uniform", *SWEEP, "-o", ""], "output: is '', must be a name to write to"),
    (["uniform", *SWEEP, "-o", "no/such/place"], "output: 'no/such/place' cannot be written: its folder does not"),
    (["uniform", *SWEEP, "--set", "grid.far=0"], "settings.grid.far: is 0, must be "),
    (["smoke", *SWEEP], "local_media.* is a file, but its folder is not given"),
    (["uniform", *SWEEP, "--preset", "thesys"], r"--preset: is 'thesys'; did you mean 'thesis'\?")])
def test_bad_input_is_one_line_and_leaves_nothing(capsys: pytest.CaptureFixture[str], here: Path, arguments: list[str],
                                                  words: str) -> None:
    assert re.match(words, refused(capsys, arguments[0], *SMALL, *arguments[1:]))
    assert not os.listdir(here)


def test_a_scene_without_a_truth_is_one_line_and_leaves_nothing(capsys: pytest.CaptureFixture[str], here: Path,
                                                                monkeypatch: pytest.MonkeyPatch) -> None:
    from froxel_ref import report
    from froxel_ref.records import InputError

    def none(*args: object, **options: object) -> None:
        raise InputError("particles", "are not in the truth, must be left out")

    monkeypatch.setattr(report, "reference_image", none)
    assert refused(capsys, "uniform", *SMALL, *SWEEP) == "particles: are not in the truth, must be left out"
    assert not os.listdir(here)
    assert report.reference_image is not reference_image


def test_a_folder_that_is_taken_is_left_as_it_is(capsys: pytest.CaptureFixture[str], here: Path, shaft: Path) -> None:
    import shutil

    shutil.copytree(shaft / "report-shaft", here / "out")
    before = contents(here / "out")
    usual = ["shaft", *SMALL, *SWEEP, "--fidelity", "published", "-o", "out"]
    assert refused(capsys, *usual) == (
        "output: 'out' exists; give --resume to go on with it, --force to replace it")
    for arguments, word in ((["uniform", *usual[1:]], r"another scene \('shaft', not 'uniform'\)"),
                            ([*usual, "--set", "grid.far=9"], "another scene or other settings or files"),
                            ([*usual, "--set", "lights[0].radius=9"], "another scene or other settings or files"),
                            ([*usual, "--suite", "full"], r"another suite \('quick', not 'full'\)"),
                            ([*usual, "--sweep", "grid.far=9"], "other knobs or sweeps")):
        assert re.fullmatch(rf"--resume: 'out' is of {word}, must be of the same: choose another folder, or "
                            r"--force to begin anew", refused(capsys, *arguments, "--resume"))
        assert contents(here / "out") == before
    log = here / "out" / LOG
    log.write_bytes(log.read_bytes().replace(b'"package": "', b'"package": "0.0.', 1))
    assert re.match(r"--resume: 'out' is of another version \('0\.0\.", refused(capsys, *usual, "--resume"))
    (here / "out" / "mine.txt").write_text("")
    for how in ("--resume", "--force"):
        assert refused(capsys, *usual, how) == ("output: 'out' holds 'mine.txt', which is not part of a report, must "
                                                "be empty or a report to be replaced")
    (here / "file").write_text("mine")
    assert refused(capsys, "uniform", *SMALL, *SWEEP, "-o", "file", "--force").startswith("output: 'file' is a file")
    assert (here / "file").read_text() == "mine"


# --- going on -----------------------------------------------------------------------------------------


def test_another_limit_measures_nothing(capsys: pytest.CaptureFixture[str], here: Path, shaft: Path,
                                        monkeypatch: pytest.MonkeyPatch) -> None:
    import shutil

    shutil.copytree(shaft / "report-shaft", here / "report-shaft")
    before = contents(here / "report-shaft")
    monkeypatch.setattr("froxel_ref.report.reference_image", lambda *_, **__: pytest.fail("measured again"))
    monkeypatch.setattr("froxel_ref.report.last_image", lambda *_, **__: pytest.fail("measured again"))
    monkeypatch.setattr("froxel_ref.report.timed", lambda *_, **__: pytest.fail("measured again"))
    out, err = run(capsys, "shaft", *SMALL, *SWEEP, "--fidelity", "published", "--resume", "--max-error", "1e-9")
    assert err == ""
    assert "nothing that was measured meets relMSE at most 1e-09, this comes closest." in out
    after = contents(here / "report-shaft")
    assert {name for name in before if before[name] != after[name]} <= {
        name for name in before if not name.startswith((IMAGES, LOG, "points", "budget.csv", "refinement.csv"))}
    assert before.keys() == after.keys()
    assert json.loads(after["report.json"])["recommendation"]["met"] is False


def test_an_interruption_says_how_to_go_on(capsys: pytest.CaptureFixture[str], here: Path,
                                           monkeypatch: pytest.MonkeyPatch) -> None:
    from froxel_ref import report

    before, calls = report.last_image, []

    def interrupted(*args: object, **options: object) -> object:
        calls.append(1)
        if len(calls) == 3:
            raise KeyboardInterrupt
        return before(*args, **options)  # type: ignore[arg-type]

    monkeypatch.setattr(report, "last_image", interrupted)
    out, err = run(capsys, "uniform", *SMALL, *SWEEP, "--points-only", code=130)
    assert (out, err) == ("", "froxel-ref: 3 measurements in report-uniform, --resume goes on\n")
    out, err = run(capsys, "uniform", *SMALL, *SWEEP, "--points-only", "--resume")
    assert err == ""
    assert len(calls) == 4  # the one that was cut short once more, no other
    errors = [point["errors"] for point in json.loads((here / "report-uniform" / "report.json").read_text())["points"]]
    run(capsys, "uniform", *SMALL, *SWEEP, "--points-only", "-o", "again")
    assert errors == [point["errors"] for point in json.loads((here / "again" / "report.json").read_text())["points"]]


@pytest.mark.parametrize("there", [False, True])
def test_an_interruption_before_anything_is_measured_leaves_no_folder(
        capsys: pytest.CaptureFixture[str], here: Path, monkeypatch: pytest.MonkeyPatch, there: bool) -> None:
    def interrupted(*args: object, **options: object) -> None:
        raise KeyboardInterrupt

    if there:
        run(capsys, "uniform", *SMALL, *SWEEP, "--points-only")
    monkeypatch.setattr("froxel_ref.report.reference_image", interrupted)
    assert run(capsys, "uniform", *SMALL, *SWEEP, *["--force"] * there, code=130) == ("", "")
    assert not os.listdir(here)


def test_a_fault_on_the_way_says_what_is_kept(capsys: pytest.CaptureFixture[str], here: Path,
                                              monkeypatch: pytest.MonkeyPatch) -> None:
    """A disk that is full after some measurements: they stand, and the line after that says what happened."""
    from froxel_ref import report_log
    from froxel_ref.records import InputError

    before, calls = report_log.append, []

    def full(*args: object) -> None:
        calls.append(1)
        if len(calls) == 5:
            raise InputError("output", "'report-uniform' cannot be written: No space left on device")
        before(*args)  # type: ignore[arg-type]

    monkeypatch.setattr(report_log, "append", full)
    _, err = run(capsys, "uniform", *SMALL, *SWEEP, "--points-only", code=2)
    assert err.splitlines() == ["froxel-ref: 4 measurements in report-uniform, --resume goes on",
                                "froxel-ref: error: output: 'report-uniform' cannot be written: No space left on "
                                "device"]
    monkeypatch.setattr(report_log, "append", before)
    run(capsys, "uniform", *SMALL, *SWEEP, "--points-only", "--resume")
    assert (here / "report-uniform" / "index.html").exists()


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_keeps_what_was_measured(here: Path, number: int) -> None:
    """In a process of its own, at its real sizes: stopped after the first measurement, then listed as a report's."""
    root = Path(__file__).parent.parent
    command = [sys.executable, "-m", "froxel_ref", "report", "uniform", *SMALL, "--suite", "full"]
    process = subprocess.Popen(command, cwd=here, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
                               env=os.environ | {"PYTHONPATH": str(root)})
    log, deadline = here / "report-uniform" / LOG, time.monotonic() + 60
    while (not log.exists() or log.read_bytes().count(b"\n") < 3) and process.poll() is None \
            and time.monotonic() < deadline:
        time.sleep(0.005)
    process.send_signal(number)
    out, err = process.communicate(timeout=60)
    assert (process.returncode, out) == (128 + number, "")
    assert re.fullmatch(r"froxel-ref: \d+ measurements in report-uniform, --resume goes on\n", err)
    assert {entry.name for entry in (here / "report-uniform").iterdir()} == {LOG, IMAGES, LOCK}
    assert not list((here / "report-uniform").rglob("*partial*"))


# --- the browser --------------------------------------------------------------------------------------


def test_the_page_is_opened_when_asked_for(capsys: pytest.CaptureFixture[str], here: Path,
                                           monkeypatch: pytest.MonkeyPatch) -> None:
    opened: list[str] = []
    monkeypatch.setattr(webbrowser, "open", lambda url: not opened.append(url))
    _, err = run(capsys, "uniform", *SMALL, *SWEEP, "--points-only", "--open")
    assert err == ""
    assert opened == [(here / "report-uniform" / "index.html").resolve().as_uri()]


def test_without_a_browser_there_is_a_note(capsys: pytest.CaptureFixture[str], here: Path,
                                           monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(webbrowser, "open", lambda url: False)
    out, err = run(capsys, "uniform", *SMALL, *SWEEP, "--points-only", "--open")
    page = os.path.join("report-uniform", "index.html")
    assert err == f"froxel-ref: note: no browser was found here; the page is {page}\n"
    assert out.splitlines()[-1] == page
    assert (here / page).exists()


def test_on_a_machine_without_one_too(here: Path, shaft: Path) -> None:
    """The same with nothing on the path that a browser could be; an empty display."""
    root = Path(__file__).parent.parent
    code = ("import sys, froxel_ref.cli_report as c; from pathlib import Path; "
            "c._open(Path('index.html')); print('on it goes')")
    bare = {name: value for name, value in os.environ.items() if name not in ("DISPLAY", "WAYLAND_DISPLAY", "BROWSER")}
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=here, timeout=60,
                          env=bare | {"PYTHONPATH": str(root), "PATH": str(here)})
    assert (done.returncode, done.stdout) == (0, "on it goes\n")
    assert done.stderr == "froxel-ref: note: no browser was found here; the page is index.html\n"


def test_help_loads_nothing_heavy() -> None:
    root = Path(__file__).parent.parent
    code = ("import sys; from froxel_ref.cli import main; main(['report', '--help']); "
            "print({'numpy', 'matplotlib', 'flip_evaluator', 'webbrowser'} & set(sys.modules))")
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60,
                          env=os.environ | {"PYTHONPATH": str(root)})
    assert done.stdout.endswith("set()\n")
    assert cli_report.EXAMPLES in done.stdout
