"""Bad input through the command line: exit code 2, one line that names the place, nothing left behind."""

from __future__ import annotations

import copy
import errno
import json
import os
import re
import resource
import shutil
import struct
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from froxel_ref.cli import main

GOOD: dict[str, Any] = {
    "schema": 1,
    "scene": {
        "name": "bad-input",
        "camera": {"position": [0, 1, 4], "target": [0, 1, 0], "width": 12, "height": 8},
        "global_media": [{"extinction": 0.1, "albedo": [0.9, 0.9, 0.9], "phase_anisotropy": 0.2}],
        "local_media": [{"extinction": 1.0, "density": {"source": {"type": "file", "path": "density.npy"}},
                         "transform": {"scale": [1, 1, 1]}}],
        "lights": [{"type": "point", "position": [0, 3, 0], "intensity": [5, 5, 5], "radius": 8},
                   {"type": "spot", "position": [0, 3, 0], "intensity": [5, 5, 5]},
                   {"type": "directional", "direction": [1, 1, 1], "irradiance": [1, 1, 1]}],
        "surfaces": [{"type": "sphere", "radius": 0.5}, {"type": "plane"}],
    },
    "settings": {"grid": {"width": 6, "height": 5, "depth": 4, "near": 0.5, "far": 16}},
}


@pytest.fixture(autouse=True)
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with a good scene and its density file, as the current one."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "scene.json").write_text(json.dumps(GOOD))
    np.save(tmp_path / "density.npy", np.linspace(0.0, 1.0, 60).reshape(3, 4, 5))
    return tmp_path


def contents(folder: Path) -> dict[str, bytes | None]:
    return {str(p.relative_to(folder)): p.read_bytes() if p.is_file() else None for p in folder.rglob("*")}


class Refusal:
    """Runs a command that must be refused and hands out its line."""

    def __init__(self, capsys: pytest.CaptureFixture[str], folder: Path) -> None:
        self.capsys, self.folder = capsys, folder

    def __call__(self, *arguments: str) -> str:
        before = contents(self.folder)
        code = main(arguments)
        out, err = self.capsys.readouterr()
        assert code == 2, f"{arguments}: exit code {code}, printed {out!r} {err!r}"
        assert out == ""
        check_line(err)
        assert contents(self.folder) == before
        return err


def check_line(err: str) -> None:
    assert err.startswith("froxel-ref: error: ")
    assert err.endswith("\n")
    assert len(err.splitlines()) == 1
    assert "Traceback" not in err
    assert len(err) < 500


@pytest.fixture
def refused(capsys: pytest.CaptureFixture[str], here: Path) -> Refusal:
    return Refusal(capsys, here)


def write_scene(folder: Path, path: str, value: object) -> None:
    """The good scene with one value changed; ``path`` is keys and indices joined by dots."""
    document = copy.deepcopy(GOOD)
    *way, last = [int(step) if step.isdigit() else step for step in path.split(".")]
    target: Any = document
    for step in way:
        target = target[step]
    target[last] = value
    (folder / "scene.json").write_text(json.dumps(document))


@pytest.mark.parametrize("command", ["golden", "render", "explain"])
def test_the_good_scene_is_good(command: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main([command, "scene.json"]) == 0
    assert capsys.readouterr().err == ""


# --- the scene --------------------------------------------------------------------------------------


@pytest.mark.parametrize("command", ["golden", "render", "explain"])
@pytest.mark.parametrize(("name", "said"), [
    ("thesis-hal", "thesis-hall"), ("", "uniform"), ("a\nb", "vacuum"), ("no/such.json", "No such file"),
    (".", "scene"), ("x" * 5000, "scene"), ("a\0b.json", "a"), ("density.npy", "scene"),
    ("/", "directory"), ("\udcff.json", "No such file"), ("☃", "uniform"),
])
def test_an_unknown_scene(refused: Refusal, command: str, name: str, said: str) -> None:
    assert said in refused(command, name)


NESTED = "[" * 100_000


@pytest.mark.parametrize(("text", "said"), [
    ('{"schema": 1,\n "scene": {"name": "a" "b"}}', "line 2, column"),
    ('{\n\n  "schema": 1,}', "line 3, column"),
    ("", "line 1, column 1"),
    ('{"schema": 1', "line 1, column"),
    ('{"schema": 1, "scene": {"ambient": [NaN, 0, 0]}}', "line 1, column"),
    ('{"schema": 1, "scene": {"ambient": [-Infinity, 0, 0]}}', "line 1, column"),
    ('{"schema": 1, "scene": {"name": "a", "name": "b"}}', "name"),
    ('{"schema": 1, "scene": {"ambient": [1e999, 0, 0]}}', "scene.ambient[0]"),
    ('{"schema": 1, "scene": {"ambient": [1' + "0" * 5000 + ", 0, 0]}}", "scene.ambient[0]"),
    ("[]", "must be an object"), ("7", "must be an object"), ("null", "must be an object"),
    ('{"scene": {}}', "schema"), ('{"schema": 2, "scene": {}}', "schema"), ('{"schema": 1}', "scene"),
    ('{"schema": 1, "scene": ' + NESTED, ""),
], ids=range(16))
def test_malformed_documents(refused: Refusal, here: Path, text: str, said: str) -> None:
    (here / "scene.json").write_text(text)
    assert said in refused("golden", "scene.json")


@pytest.mark.parametrize("content", [b"\xff\xfe\x00\x01", b"\x80abc", os.urandom(64)])
def test_a_document_that_is_no_text(refused: Refusal, here: Path, content: bytes) -> None:
    (here / "scene.json").write_bytes(b"\xff" + content)
    assert "scene.json" in refused("golden", "scene.json")


@pytest.mark.parametrize(("path", "value", "said"), [
    # an unknown key, with the nearest known one
    ("scene.lights.0.raduis", 3, "scene.lights[0].raduis: is not a key here; did you mean 'radius'?"),
    ("scene.cammera", {}, "did you mean 'camera'?"),
    ("setings", {}, "did you mean 'settings'?"),
    ("settings.grid.dpeth", 3, "did you mean 'depth'?"),
    ("scene.lights.0.type", "pont", "did you mean 'point'?"),
    ("scene.lights.0.type", None, "scene.lights[0].type"),
    ("settings.fidelity", "autor", "settings.fidelity"),
    ("settings.switches", {"integrator": "euler"}, "settings.switches.integrator"),
    # numbers out of their bounds
    ("scene.global_media.0.extinction", -0.1, "scene.global_media[0].extinction: is -0.1"),
    ("scene.global_media.0.extinction", [0.1, -1, 0.1], "scene.global_media[0].extinction[1]: is -1"),
    ("scene.global_media.0.albedo", [0.5, 1.01, 0.5], "scene.global_media[0].albedo[1]: is 1.01"),
    ("scene.global_media.0.albedo", [0.5, 0.5, -1e-9], "scene.global_media[0].albedo[2]"),
    ("scene.surfaces.0.albedo", [2, 0, 0], "scene.surfaces[0].albedo[0]"),
    ("scene.global_media.0.phase_anisotropy", 1, "scene.global_media[0].phase_anisotropy: is 1"),
    ("scene.global_media.0.phase_anisotropy", -1.0, "scene.global_media[0].phase_anisotropy: is -1"),
    ("scene.global_media.0.phase_anisotropy", 7, "scene.global_media[0].phase_anisotropy: is 7"),
    ("scene.lights.0.radius", 0, "scene.lights[0].radius: is 0"),
    ("scene.lights.0.radius", -8, "scene.lights[0].radius: is -8"),
    ("scene.surfaces.0.radius", 0, "scene.surfaces[0].radius: is 0"),
    ("scene.lights.0.intensity", [1, 1], "scene.lights[0].intensity: has 2 numbers"),
    ("scene.lights.2.direction", [0, 0, 0], "scene.lights[2].direction"),
    ("scene.lights.1.inner_angle", 80, "scene.lights[1].inner_angle"),
    ("scene.camera.target", [0, 1, 4], "scene.camera.target"),
    ("scene.camera.up", [0, 0, 1], "scene.camera.up"),
    ("scene.camera.vertical_fov", 180, "scene.camera.vertical_fov"),
    ("settings.grid.near", 16, "settings.grid.near: is 16 m, must be below far"),
    ("settings.grid.near", 20, "settings.grid.near"),
    ("settings.grid.near", 0, "settings.grid.near: is 0"),
    ("settings.grid.width", 0, "settings.grid.width: is 0"),
    ("settings.grid.depth", 2.5, "settings.grid.depth"),
    ("settings.grid.depth", -4, "settings.grid.depth"),
    # singular transforms
    ("scene.local_media.0.transform.scale", [1, 0, 1], "scene.local_media[0].transform.scale"),
    ("scene.local_media.0.transform.scale", [1e-9, 1, 1], "scene.local_media[0].transform.scale"),
    ("scene.local_media.0.transform", {"matrix": [1, 2, 3, 0, 2, 4, 6, 0, 1, 1, 1, 0]},
     "scene.local_media[0].transform.matrix"),
    ("scene.local_media.0.transform", {"matrix": [0] * 12}, "scene.local_media[0].transform.matrix"),
    # other types
    ("scene.lights", {}, "scene.lights: is {}"),
    ("scene.lights.0", 3, "scene.lights[0]"),
    ("scene.lights.0.radius", "8", "scene.lights[0].radius: is '8'"),
    ("scene.lights.0.radius", True, "scene.lights[0].radius: is True"),
    ("scene.name", 3, "scene.name"),
    ("scene.name", "two\nlines", "scene.name"),
    ("settings.grid", None, "settings.grid"),
    ("scene.image_buffers", {"depth": "density.npy"}, "scene.image_buffers"),
])
def test_a_value_that_is_not_allowed(refused: Refusal, here: Path, path: str, value: object,
                                     said: str) -> None:
    write_scene(here, path, value)
    assert said in refused("golden", "scene.json")


@pytest.mark.parametrize("path", [
    "scene.camera.position", "scene.camera.exposure", "scene.camera.vertical_fov",
    "scene.global_media.0.extinction", "scene.global_media.0.phase_anisotropy", "scene.lights.0.position",
    "scene.lights.0.radius", "scene.lights.2.direction", "scene.surfaces.0.radius", "settings.grid.far",
    "settings.time", "scene.ambient",
    "scene.local_media.0.transform.translate", "scene.local_media.0.transform.rotate"])
@pytest.mark.parametrize("number", ["NaN", "Infinity", "-Infinity", "1e400"])
def test_nan_and_infinity_anywhere(refused: Refusal, here: Path, path: str, number: str) -> None:
    is_vector = path.rpartition(".")[2] in ("position", "direction", "ambient", "translate", "rotate")
    write_scene(here, path, [0, "HERE", 0] if is_vector else "HERE")
    text = (here / "scene.json").read_text().replace('"HERE"', number)
    (here / "scene.json").write_text(text)
    line = refused("golden", "scene.json")
    assert "finite" in line
    assert path.rpartition(".")[2] in line or "column" in line


# --- options ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("grid", ["0x6x5", "8x0x5", "8x6x0", "8x6", "8x6x5x4", "-8x6x5", "8.5x6x5", "axbxc",
                                  "", "x", "xx", "9" * 30 + "x6x5", "٣x6x5", "1e3x6x5"])
def test_a_grid_of_nothing(refused: Refusal, grid: str) -> None:
    assert "grid" in refused("golden", "uniform", f"--grid={grid}")


@pytest.mark.parametrize("command", ["golden", "render", "explain"])
@pytest.mark.parametrize("options", [["--grid", "65536x65536x65536"], ["--grid", "9999x9999x9999"],
                                     ["--grid", "100000x8x8"],
                                     ["--set", "grid.width=65536", "--set", "grid.height=65536"]])
def test_a_grid_of_absurd_size_is_refused_before_anything_is_computed(
        refused: Refusal, command: str, options: list[str]) -> None:
    line = refused(command, "two-volumes", *options)
    assert "settings.grid" in line
    assert "GiB" in line or "at most" in line


@pytest.mark.parametrize(("options", "said"), [
    (["--size", "0x8"], "width"), (["--size", "8"], "--size"), (["--size", "99999x8"], "width"),
    (["--set", "scene.nothing=1"], "nothing"), (["--set", "grid.depth"], "="), (["--set", "=3"], ""),
    (["--set", "lights[9].radius=1"], "lights"), (["--set", "grid.depth=NaN"], "depth"),
    (["--set", "grid.depth=1e999"], "depth"), (["--set", "grid.depth={"], "depth"), (["--set", ""], ""),
    (["--set", "global_media[0].extinction=-1"], "extinction"), (["--set", "settings.grid=[]"], "grid"),
    (["--precision", "float16"], "settings.precision"), (["--fidelity", "best"], "settings.fidelity"),
    (["--fidelity", "a\nb"], "settings.fidelity"), (["--data", "nowhere"], "nowhere"),
    (["--data", "density.npy"], "density.npy"), (["--unknown"], "--unknown"), (["--grid"], "--grid"),
])
def test_options_that_are_not_allowed(refused: Refusal, options: list[str], said: str) -> None:
    assert said in refused("golden", "uniform", *options)


@pytest.mark.parametrize("arguments", [[], ["nonsense"], ["render"], ["scenes", "more"], ["golden", "a", "b"],
                                       ["--nothing"]])
def test_commands_that_do_not_exist(refused: Refusal, arguments: list[str]) -> None:
    assert "--help" in refused(*arguments)


# --- files that the scene names ---------------------------------------------------------------------


class Explosive:
    """What a pickle must never be able to do."""

    def __reduce__(self) -> tuple[object, tuple[str]]:
        return os.system, ("touch exploded",)


def npy(header: str, data: bytes) -> bytes:
    text = header.encode("latin-1")
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(text)) + text + data


def vol(*, magic: bytes = b"VOL", version: int = 3, kind: int = 1, size: tuple[int, int, int] = (2, 2, 2),
        channels: int = 1, values: int = 8) -> bytes:
    head = struct.pack("<3sB5i6f", magic, version, kind, *size, channels, -1, -1, -1, 1, 1, 1)
    return head + np.linspace(0, 1, values, dtype="<f4").tobytes()


def one(value: float) -> bytes:
    return npy("{'descr': '<f8', 'fortran_order': False, 'shape': (1, 1, 1)}\n", struct.pack("<d", value))


FLOATS = np.linspace(0.0, 1.0, 60).tobytes()


@pytest.mark.parametrize(("name", "content"), [
    ("lying.npy", npy("{'descr': '<f8', 'fortran_order': False, 'shape': (3, 4, 500)}\n", FLOATS)),
    ("short.npy", npy("{'descr': '<f8', 'fortran_order': False, 'shape': (3, 4, 5)}\n", FLOATS[:-1])),
    ("long.npy", npy("{'descr': '<f8', 'fortran_order': False, 'shape': (3, 4, 5)}\n", FLOATS + b"more")),
    ("huge.npy", npy("{'descr': '<f8', 'fortran_order': False, 'shape': (99999999, 99999999, 9)}\n", FLOATS)),
    ("minus.npy", npy("{'descr': '<f8', 'fortran_order': False, 'shape': (-3, -4, 5)}\n", FLOATS)),
    ("code.npy", npy("__import__('os').system('touch exploded')\n", FLOATS)),
    ("words.npy", npy("{'descr': '<U8', 'fortran_order': False, 'shape': (3, 4, 5)}\n", FLOATS)),
    ("flat.npy", npy("{'descr': '<f8', 'fortran_order': False, 'shape': (60,)}\n", FLOATS)),
    ("headless.npy", b"\x93NUMPY\x01\x00\xff\xff{"), ("empty.npy", b""), ("text.npy", b"hello"),
    ("nan.npy", one(float("nan"))), ("infinite.npy", one(float("inf"))), ("negative.npy", one(-1.0)),
    ("short.vol", vol(values=7)), ("long.vol", vol(values=9)), ("lying.vol", vol(size=(2, 2, 2000))),
    ("huge.vol", vol(size=(2**31 - 1,) * 3)), ("none.vol", vol(size=(0, 2, 2))),
    ("minus.vol", vol(size=(-2, -2, 2))),
    ("magic.vol", vol(magic=b"LOV")), ("version.vol", vol(version=2)), ("kind.vol", vol(kind=3)),
    ("channels.vol", vol(channels=3)), ("head.vol", vol()[:20]), ("empty.vol", b""),
    ("unknown.xyz", FLOATS),
], ids=lambda value: value if isinstance(value, str) else "")
def test_files_that_lie(refused: Refusal, here: Path, name: str, content: bytes) -> None:
    (here / name).write_bytes(content)
    write_scene(here, "scene.local_media.0.density.source", {"type": "file", "path": name})
    line = refused("golden", "scene.json")
    assert name in line
    assert "local_media[0].density.source" in line
    assert not (here / "exploded").exists()


def test_a_pickle_is_not_opened(refused: Refusal, here: Path) -> None:
    np.save(here / "pickle.npy", np.array([[[Explosive()]]], dtype=object), allow_pickle=True)
    write_scene(here, "scene.local_media.0.density.source.path", "pickle.npy")
    assert "pickle.npy" in refused("golden", "scene.json")
    assert not (here / "exploded").exists()


@pytest.mark.parametrize("path", ["../density.npy", "/etc/passwd", "a/../../density.npy", "link.npy", "",
                                  "a\0b", "missing.npy", "folder", "x" * 300, "loop.npy", "pipe.npy"])
def test_a_path_that_leaves_the_folder_or_names_no_file(refused: Refusal, here: Path, path: str) -> None:
    inner = here / "inner"
    (inner / "folder").mkdir(parents=True)
    (inner / "a").mkdir()
    (inner / "link.npy").symlink_to(here / "density.npy")
    (inner / "loop.npy").symlink_to(inner / "loop.npy")
    os.mkfifo(inner / "pipe.npy")
    write_scene(here, "scene.local_media.0.density.source.path", path)
    shutil.move(here / "scene.json", inner / "scene.json")
    assert "local_media[0].density.source" in refused("golden", "inner/scene.json")


def test_a_built_in_scene_without_its_data(refused: Refusal) -> None:
    assert "--data" in refused("golden", "smoke", "--grid", "4x4x4", "--size", "8x8")
    assert "density.npy" not in refused("golden", "smoke", "--data", ".", "--grid", "4x4x4", "--size", "8x8")


# --- outputs ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(("command", "name"), [
    ("golden", "set"), ("render", "image.png"), ("render", "image.npy")])
class TestOutputs:
    """The same faults for folders and files."""

    def test_existing(self, refused: Refusal, here: Path, command: str, name: str) -> None:
        assert main([command, "scene.json", "-o", name]) == 0
        refused.capsys.readouterr()
        line = refused(command, "scene.json", "-o", name)
        assert name in line
        assert "--force" in line

    @pytest.mark.parametrize("force", [[], ["--force"]])
    def test_of_the_other_kind(self, refused: Refusal, here: Path, command: str, name: str,
                               force: list[str]) -> None:
        if command == "golden":
            (here / name).write_text("mine")
        else:
            (here / name).mkdir()
        assert name in refused(command, "scene.json", "-o", name, *force)

    @pytest.mark.parametrize("folder", ["missing", "density.npy", "density.npy/x", "/proc", "\0", "x" * 300])
    def test_in_a_place_that_cannot_be_written(self, refused: Refusal, command: str, name: str,
                                               folder: str) -> None:
        assert "output" in refused(command, "scene.json", "-o", f"{folder}/{name}")

    @pytest.mark.parametrize("code", [errno.ENOSPC, errno.EDQUOT, errno.EROFS, errno.EACCES, errno.EIO])
    def test_on_a_disk_that_fails(self, refused: Refusal, monkeypatch: pytest.MonkeyPatch, command: str,
                                  name: str, code: int) -> None:
        def fail(path: Path, *_: object) -> None:
            path.write_bytes(b"some of it")
            raise OSError(code, os.strerror(code))

        for place in ("golden.write_png", "image_files.write_png", "image_files._write_npy"):
            monkeypatch.setattr(f"froxel_ref.{place}", fail)
        line = refused(command, "scene.json", "-o", name)
        assert f"'{name}' cannot be written: {os.strerror(code)}" in line

    @pytest.mark.parametrize("limit", [0, 100, 3000])
    def test_on_a_disk_that_is_really_full(self, here: Path, command: str, name: str, limit: int) -> None:
        """The system itself refuses to let a file grow: in a process of its own, since the limit stays."""
        size = ["--size", "256x192"] if command == "render" else []
        before = contents(here)
        done = in_process([command, "scene.json", "-o", name, *size], here, limit)
        check_line(done.stderr)
        assert (done.returncode, done.stdout) == (2, "")
        assert "File too large" in done.stderr
        assert contents(here) == before


def in_process(arguments: list[str], folder: Path, limit: int) -> subprocess.CompletedProcess[str]:
    root = Path(__file__).parent.parent
    environment = os.environ | {"PYTHONPATH": str(root), "PYTHONDONTWRITEBYTECODE": "1"}
    return subprocess.run([sys.executable, "-m", "froxel_ref", *arguments], cwd=folder, env=environment,
                          capture_output=True, text=True, timeout=60,
                          preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit)))


@pytest.mark.parametrize("name", ["image", "image.tif", "image.exr.hdr", "image.jpg", ".png", "png"])
def test_an_image_of_an_unknown_kind(refused: Refusal, name: str) -> None:
    line = refused("render", "scene.json", f"--output={name}")
    assert ".png, .npy, .exr" in line


def test_the_small_disk_is_refused_before_the_frame_is_computed(refused: Refusal,
                                                                monkeypatch: pytest.MonkeyPatch) -> None:
    usage = shutil._ntuple_diskusage(10**9, 10**9 - 10**5, 10**5)
    monkeypatch.setattr(shutil, "disk_usage", lambda _: usage)
    monkeypatch.delattr("froxel_ref.frame.run_frame")  # would be a traceback
    assert re.search(r"needs about \d+ MB", refused("golden", "two-volumes"))


@pytest.mark.parametrize("index", ["9" * 5000, "0" * 5000, "1" + "0" * 18])
def test_an_index_beyond_every_list(refused: Refusal, index: str) -> None:
    line = refused("render", "scene.json", "--set", f"lights[{index}].radius=1")
    assert f"has an index of {len(index)} digits" in line
    assert len(line) < 200


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="the system has no named pipes")
def test_a_scene_that_is_a_pipe_is_not_waited_for(capsys: pytest.CaptureFixture[str], here: Path) -> None:
    os.mkfifo(here / "pipe.json")
    assert main(["render", "pipe.json"]) == 2
    assert "pipe.json: cannot be read: is not a regular file" in capsys.readouterr().err


def test_a_small_set_is_not_refused_for_a_small_disk(here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    usage = shutil._ntuple_diskusage(10**9, 10**9 - 5 * 10**6, 5 * 10**6)
    monkeypatch.setattr(shutil, "disk_usage", lambda _: usage)
    small = ["--grid", "4x4x4", "--size", "4x4", "--set", "settings.shadows=off"]  # maps alone are 5 MB
    assert main(["golden", "lights", *small, "-o", "g"]) == 0


@pytest.mark.parametrize("name", ["i" * 236 + ".png", "i" * 251 + ".npy"])
def test_an_image_of_a_long_name(here: Path, name: str) -> None:
    assert main(["render", "scene.json", "-o", name]) == 0
    assert (here / name).is_file()
