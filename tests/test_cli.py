"""The command line: what it prints, what it writes, its exit codes."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from froxel_ref import __version__, scene_files
from froxel_ref.cli import main
from froxel_ref.frame import run_frame
from froxel_ref.golden import MANIFEST
from froxel_ref.settings import replace
from froxel_ref.stages import STAGES

SMALL = ["--grid", "8x6x5", "--size", "12x8"]


@pytest.fixture(autouse=True)
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Each test in an empty folder of its own."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


def process(*arguments: str, **options: object) -> subprocess.CompletedProcess[str]:
    """``python -m froxel_ref`` in a process of its own."""
    root = Path(__file__).parent.parent
    path = os.pathsep.join(filter(None, [str(root), os.environ.get("PYTHONPATH")]))
    return subprocess.run([sys.executable, "-m", "froxel_ref", *arguments], capture_output=True, text=True,
                          timeout=120, env=os.environ | {"PYTHONPATH": path}, **options)  # type: ignore[call-overload]


def printed(capsys: pytest.CaptureFixture[str], *arguments: str) -> str:
    """What a command that must succeed prints; nothing goes to standard error outside a terminal."""
    assert main(arguments) == 0
    out, err = capsys.readouterr()
    assert err == ""
    return out


# --- help -------------------------------------------------------------------------------------------


@pytest.mark.parametrize("command", ["", "scenes", "render", "golden", "explain", "schema"])
def test_help_has_an_example(capsys: pytest.CaptureFixture[str], command: str) -> None:
    out = printed(capsys, *command.split(), "--help")
    assert re.search(rf"^  froxel-ref {command or 'golden'}\b", out, re.MULTILINE)


def test_the_examples_of_the_help_are_accepted(capsys: pytest.CaptureFixture[str]) -> None:
    """Every example parses; those that need no file of the reader's own are run at a small size."""
    import shlex

    printed(capsys, "scenes")
    examples = set()
    for command in ("", "render", "golden", "explain"):
        examples |= set(re.findall(r"^  froxel-ref (.+)$", printed(capsys, *command.split(), "--help"), re.M))
    runnable = [e for e in examples if not re.search(r"my-scene|path/to/|>", e)]
    assert len(runnable) >= 7
    for example in runnable:
        words = shlex.split(example)
        small = [] if words[0] in ("scenes", "schema") else SMALL
        force = ["--force"] if words[0] in ("render", "golden") else []
        few = ["--frames", "2"] if "--frames" in words else []  # or it takes so long that it tells
        assert main([*words, *small, *force, *few]) == 0, example
        assert capsys.readouterr().err == ""


def test_version(capsys: pytest.CaptureFixture[str]) -> None:
    assert printed(capsys, "--version") == f"froxel-ref {__version__}\n"


@pytest.mark.parametrize("module", ["froxel_ref", "froxel_ref.cli"])
def test_an_import_loads_nothing_heavy(module: str) -> None:
    root = Path(__file__).parent.parent
    heavy = {"scipy", "imageio", "PIL", "trimesh", "tqdm", "matplotlib", "numba", "embreex"}
    code = (f"import sys; sys.path.insert(0, {str(root)!r}); import {module}; "
            f"print({heavy!r} & set(sys.modules))")
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "set()\n"


def test_help_does_not_even_load_numpy() -> None:
    root = Path(__file__).parent.parent
    code = (f"import sys; sys.path.insert(0, {str(root)!r}); from froxel_ref.cli import main; "
            "main(['--help']); print('numpy' in sys.modules)")
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    assert out.endswith("False\n")


# --- scenes, schema, explain ------------------------------------------------------------------------


def test_scenes_lists_each_with_its_counts(capsys: pytest.CaptureFixture[str]) -> None:
    lines = printed(capsys, "scenes").splitlines()
    assert lines[0].split() == ["name", "surfaces", "lights", "media", "shows"]
    assert [line.split()[0] for line in lines[1:]] == list(scene_files.builtin())
    hall = next(line for line in lines if line.startswith("thesis-hall"))
    assert hall.split()[2:4] == ["10", "2"]  # nine point lights and the sun; height fog and the ellipsoid
    vacuum = next(line for line in lines if line.startswith("vacuum"))
    assert vacuum.split()[3] == "0"


def test_schema_is_json_schema(capsys: pytest.CaptureFixture[str]) -> None:
    assert json.loads(printed(capsys, "schema")) == scene_files.schema()


def test_explain_uniform_says_what_is_left_out_and_why(capsys: pytest.CaptureFixture[str]) -> None:
    out = printed(capsys, "explain", "uniform", *SMALL)
    assert out.startswith("uniform: 8 x 6 x 5 froxels, 12 x 8 pixels, float64, corrected\n")
    for line in ["surface: left out (the scene has no surfaces)",
                 "  without local media (the scene has none)",
                 "  without density textures (no medium has one)",
                 "  without height fog (no medium has it)",
                 "  without shadows (", "media: runs (1 medium)"]:
        assert line in out
    extinction = re.search(r"^  media/extinction +(.*)$", out, re.MULTILINE)
    assert extinction is not None
    assert re.split(r"  +", extinction[1]) == ["constant", "8 B", "of", "1.920 kB"]  # 8·6·5 float64
    assert re.search(r"^  lighting/in_scattering  y x ", out, re.MULTILINE)
    assert out.splitlines()[-1].startswith("total: ")


def test_explain_as_json_adds_up(capsys: pytest.CaptureFixture[str]) -> None:
    facts = json.loads(printed(capsys, "explain", "lights", "--json", *SMALL))
    arrays = [array for stage in facts["stages"] for array in stage["arrays"]]
    assert facts["bytes"] == sum(a["bytes"] for a in arrays)
    assert facts["bytes"] < facts["expanded_bytes"] == sum(a["expanded_bytes"] for a in arrays)
    loaded = scene_files.load("lights", overrides=["grid.width=8", "grid.height=6", "grid.depth=5",
                                                   "camera.width=12", "camera.height=8"])
    frame = run_frame(loaded.scene, loaded.settings)
    assert {a["name"]: a["bytes"] for a in arrays} == {
        name: field.nbytes for name, field in frame.results.items() if field.size}


# --- render -----------------------------------------------------------------------------------------


def expected_image(*overrides: str, **settings: object) -> np.ndarray:
    loaded = scene_files.load("lights", overrides=[
        "grid.width=8", "grid.height=6", "grid.depth=5", "camera.width=12", "camera.height=8", *overrides])
    frame = run_frame(loaded.scene, replace(loaded.settings, **settings))
    return np.moveaxis(np.broadcast_to(frame["apply/radiance"], (3, 8, 12)), 0, -1)


def test_render_writes_the_display_image(capsys: pytest.CaptureFixture[str], here: Path) -> None:
    import imageio.v3 as iio

    assert printed(capsys, "render", "lights", *SMALL) == "lights.png\n"
    image = iio.imread(here / "lights.png")
    assert image.shape == (8, 12, 3)
    assert image.dtype == np.uint8
    assert image.max() > 20
    assert os.listdir(here) == ["lights.png"]


def test_render_writes_linear_radiance(capsys: pytest.CaptureFixture[str], here: Path) -> None:
    assert printed(capsys, "render", "lights", "-o", "out.npy", *SMALL) == "out.npy\n"
    stored = np.load(here / "out.npy")
    assert stored.dtype == np.float64
    np.testing.assert_array_equal(stored, expected_image())


@pytest.mark.parametrize(("options", "overrides", "settings"), [
    (["--fidelity", "published"], [], {"fidelity": "published"}),
    (["--precision", "float32"], [], {"precision": "float32"}),
    (["--set", "scene.global_media[0].extinction=0.5"], ["scene.global_media[0].extinction=0.5"], {}),
    (["--set", "integrator=simple", "--set", "grid.near=1"], ["grid.near=1"], {"integrator": "simple"}),
])
def test_options_change_the_frame(capsys: pytest.CaptureFixture[str], here: Path, options: list[str],
                                  overrides: list[str], settings: dict[str, object]) -> None:
    printed(capsys, "render", "lights", "-o", "out.npy", *SMALL, *options)
    stored = np.load(here / "out.npy")
    np.testing.assert_array_equal(stored, expected_image(*overrides, **settings))
    assert not np.array_equal(stored, expected_image())


def test_render_writes_exr(capsys: pytest.CaptureFixture[str], here: Path) -> None:
    exr = pytest.importorskip("OpenEXR", reason="the extra 'exr' is not installed")
    printed(capsys, "render", "lights", "-o", "out.exr", *SMALL)
    with exr.File(str(here / "out.exr")) as file:
        stored = file.channels()["RGB"].pixels
    np.testing.assert_array_equal(stored, expected_image().astype(np.float32))


def test_render_without_openexr_says_how_to_get_it(capsys: pytest.CaptureFixture[str], here: Path,
                                                   monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    assert main(["render", "lights", "-o", "out.exr", *SMALL]) == 2
    assert "pip install 'froxel-ref[exr]'" in capsys.readouterr().err
    assert not os.listdir(here)


def test_an_image_is_replaced_only_with_force(capsys: pytest.CaptureFixture[str], here: Path) -> None:
    (here / "lights.png").write_bytes(b"mine")
    assert main(["render", "lights", *SMALL]) == 2
    assert (here / "lights.png").read_bytes() == b"mine"
    assert "--force" in capsys.readouterr().err
    printed(capsys, "render", "lights", "--force", *SMALL)
    assert (here / "lights.png").read_bytes().startswith(b"\x89PNG")


def test_a_scene_file_is_rendered_under_its_own_name(capsys: pytest.CaptureFixture[str], here: Path) -> None:
    document = scene_files.document(*scene_files.load("lights")[:2])
    (here / "mine.json").write_text(json.dumps(document))
    assert printed(capsys, "render", "mine.json", *SMALL) == "mine.png\n"


# --- golden -----------------------------------------------------------------------------------------


def test_golden_prints_what_it_wrote_and_ends_with_the_contact_sheet(
        capsys: pytest.CaptureFixture[str], here: Path) -> None:
    lines = printed(capsys, "golden", *SMALL).splitlines()
    assert lines[-1] == os.path.join("golden-thesis-hall", "contact_sheet.png")
    assert (here / lines[-1]).read_bytes().startswith(b"\x89PNG")
    manifest = json.loads((here / "golden-thesis-hall" / MANIFEST).read_text(encoding="utf-8"))
    assert lines[0].split() == ["stage", "arrays", "MB", "seconds"]
    table = {line.split()[0]: int(line.split()[1]) for line in lines[1:-2]}
    names = [entry["name"].partition("/")[0] for entry in manifest["arrays"]]
    assert table == {stage.name: names.count(stage.name) for stage in STAGES}
    assert os.listdir(here) == ["golden-thesis-hall"]


def test_golden_twice_gives_the_same_bytes(capsys: pytest.CaptureFixture[str], here: Path) -> None:
    for name in ("one", "two"):
        printed(capsys, "golden", "uniform", "-o", name, *SMALL)
    first, second = ({p.relative_to(folder): p.read_bytes() for p in folder.rglob("*") if p.is_file()}
                     for folder in (here / "one", here / "two"))
    assert first == second
    assert len(first) > 30


# --- how it ends ------------------------------------------------------------------------------------


def test_the_module_is_the_command(here: Path) -> None:
    done = process("render", "uniform", *SMALL)
    assert (done.returncode, done.stdout, done.stderr) == (0, "uniform.png\n", "")
    done = process("render", "unifrom")
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.startswith("froxel-ref: error: scene: ")
    assert done.stderr.count("\n") == 1


def test_a_reader_that_goes_away_is_no_error() -> None:
    root = Path(__file__).parent.parent
    command = subprocess.Popen([sys.executable, "-m", "froxel_ref", "schema"], stdout=subprocess.PIPE,
                               stderr=subprocess.PIPE, env=os.environ | {"PYTHONPATH": str(root)})
    assert command.stdout is not None
    command.stdout.close()
    assert command.stderr is not None
    assert command.stderr.read() == b""
    command.stderr.close()
    assert command.wait(timeout=60) == 141


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="the system has no /dev/full")
@pytest.mark.parametrize("command", ["scenes", "schema"])
def test_a_full_standard_output_is_one_line(command: str) -> None:
    root = Path(__file__).parent.parent
    environment = os.environ | {"PYTHONPATH": str(root), "PYTHONUNBUFFERED": ""}  # fails at the flush only
    with open("/dev/full", "w") as full:
        done = subprocess.run([sys.executable, "-m", "froxel_ref", command], stdout=full, text=True,
                              stderr=subprocess.PIPE, timeout=60, env=environment)
    assert done.returncode == 2
    assert re.fullmatch(r"froxel-ref: error: .*No space left on device\n", done.stderr)


@pytest.mark.parametrize(("numbers", "code"), [
    ([signal.SIGINT], 130), ([signal.SIGTERM], 143), ([signal.SIGHUP], 129),
    ([signal.SIGTERM, signal.SIGINT], None), ([signal.SIGINT, signal.SIGTERM, signal.SIGHUP], None)])
def test_an_interrupted_run_is_quiet_and_leaves_nothing(here: Path, numbers: list[int],
                                                        code: int | None) -> None:
    root = Path(__file__).parent.parent
    command = subprocess.Popen([sys.executable, "-m", "froxel_ref", "golden", "two-volumes"], cwd=here,
                               stdout=subprocess.PIPE, stderr=subprocess.PIPE,
                               env=os.environ | {"PYTHONPATH": str(root)})
    deadline = time.monotonic() + 60
    while not list(here.glob("*partial*/*/*.npy")) and command.poll() is None and time.monotonic() < deadline:
        time.sleep(0.002)
    for number in numbers:
        command.send_signal(number)
    out, err = command.communicate(timeout=60)
    assert command.returncode in ([code] if code else [129, 130, 143])
    assert (out, err) == (b"", b"")
    assert not os.listdir(here)


def test_a_fault_of_the_program_keeps_its_traceback(monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(*_: object, **__: object) -> None:
        raise AssertionError("a bug")

    monkeypatch.setattr("froxel_ref.frame.run_frame", broken)
    with pytest.raises(AssertionError, match="a bug"):
        main(["render", "uniform", *SMALL])


def test_memory_that_does_not_suffice_is_one_line(capsys: pytest.CaptureFixture[str], here: Path,
                                                  monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object, **__: object) -> None:
        raise MemoryError

    monkeypatch.setattr("froxel_ref.frame.run_frame", full)
    assert main(["golden", "uniform", *SMALL]) == 2
    assert capsys.readouterr().err.count("\n") == 1
    assert not os.listdir(here)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_signals_are_given_back(number: int) -> None:
    before = signal.getsignal(number)
    main(["--version"])
    assert signal.getsignal(number) is before


def test_a_run_under_nohup_is_not_hung_up(monkeypatch: pytest.MonkeyPatch) -> None:
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        monkeypatch.setattr("froxel_ref.cli._scenes", lambda _: signal.raise_signal(signal.SIGHUP))
        assert main(["scenes"]) == 0
    finally:
        signal.signal(signal.SIGHUP, before)


def closed(stream: str, *arguments: str) -> subprocess.CompletedProcess[str]:
    """The command in a process of its own, one of its standard streams closed by the shell."""
    root = Path(__file__).parent.parent
    return subprocess.run(["sh", "-c", f'exec "$@" {stream}', "sh", sys.executable, "-m", "froxel_ref",
                           *arguments], capture_output=True, text=True, timeout=120,
                          env=os.environ | {"PYTHONPATH": str(root)})


@pytest.mark.parametrize("command", [["schema"], ["scenes"], ["explain", "uniform", *SMALL]])
def test_without_standard_output_there_is_nothing_to_print_to(command: list[str]) -> None:
    done = closed(">&-", *command)
    assert (done.returncode, done.stderr) == (2, "froxel-ref: error: output: standard output is closed\n")


@pytest.mark.parametrize("stream", [">&-", "2>&-", "<&-", ">&- 2>&-", "<&- >&- 2>&-"])
def test_files_are_written_whatever_stream_is_closed(here: Path, stream: str) -> None:
    done = closed(stream, "render", "uniform", *SMALL, "-o", "x.png")
    assert (done.returncode, done.stderr) == (0, "")
    assert (here / "x.png").read_bytes().startswith(b"\x89PNG")
    assert closed(stream, "golden", "uniform", *SMALL, "-o", "set").returncode == 0
    assert os.listdir(here / "set")


def test_an_error_without_standard_error_is_not_printed_elsewhere() -> None:
    done = closed("2>&-", "render", "unifrom")
    assert (done.returncode, done.stdout) == (2, "")


def test_outside_the_main_thread_it_works_too(capsys: pytest.CaptureFixture[str]) -> None:
    import threading

    codes: list[int] = []
    thread = threading.Thread(target=lambda: codes.append(main(["--version"])))
    thread.start()
    thread.join()
    assert codes == [0]
