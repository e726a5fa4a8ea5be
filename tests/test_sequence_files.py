"""Sequences on disk: pictures as frames by hand give them, going on, what is refused, animations."""

from __future__ import annotations

import json
from pathlib import Path

import imageio.v3 as iio
import numpy as np
import pytest

from froxel_ref.assets import load_assets
from froxel_ref.cli import main
from froxel_ref.image_files import write_png
from froxel_ref.pictures import View, final_image
from froxel_ref.records import InputError
from froxel_ref.scene_files import Loaded, load
from froxel_ref.sequence import run_sequence
from froxel_ref.sequence_files import MANIFEST, STATE, write_frames

DOCUMENT = {
    "schema": 1,
    "scene": {
        "camera": {"width": 24, "height": 14},
        "tracks": [{"path": "lights[0].position", "keys": [{"time": 0, "value": [-2, 1.5, -5]},
                                                           {"time": 0.2, "value": [2, 1.5, -5]}]}],
        "lights": [{"type": "point", "position": [0, 1, -4], "intensity": [5, 5, 5], "radius": 6}],
        "global_media": [{"extinction": 0.1}], "surfaces": [{"type": "plane"}]},
    "settings": {"grid": {"width": 8, "height": 5, "depth": 6}, "temporal": {"filter": "scattering", "alpha": 0.3}}}


@pytest.fixture
def scene(tmp_path: Path) -> Path:
    path = tmp_path / "moving.json"
    path.write_text(json.dumps(DOCUMENT))
    return path


def loaded(scene: Path, *overrides: str) -> Loaded:
    return load(scene, overrides=overrides)


def content(folder: Path) -> dict[str, bytes]:
    return {file.name: file.read_bytes() for file in folder.glob("*.png")}


def write(scene: Path, folder: Path, *overrides: str, frames: int = 4, **more: object) -> int:
    what = loaded(scene, *overrides)
    return write_frames(what, load_assets(what.scene, None), folder, frames=frames, rate=30.0, **more)  # type: ignore[arg-type]


def test_each_picture_is_its_frames(scene: Path, tmp_path: Path) -> None:
    assert write(scene, tmp_path / "out") == 4
    what = loaded(scene)
    for number, frame in enumerate(run_sequence(what.scene, frames=4, settings=what.settings)):
        write_png(tmp_path / "one.png", final_image(frame["apply/radiance"], View(
            frame.scene.camera, frame.settings.grid, frame.display_exposure)))
        assert (tmp_path / "one.png").read_bytes() == (tmp_path / "out" / f"frame-{number:05d}.png").read_bytes()
    assert len(set(content(tmp_path / "out").values())) == 4


@pytest.mark.parametrize("override", ["temporal.filter=off", "temporal.filter=unphased", "checkerboard=true"])
def test_gone_on_with_is_never_left(scene: Path, tmp_path: Path, override: str) -> None:
    write(scene, tmp_path / "whole", override, frames=5)
    assert write(scene, tmp_path / "parts", override, frames=2) == 2
    assert write(scene, tmp_path / "parts", override, frames=5, resume=True) == 3
    assert write(scene, tmp_path / "parts", override, frames=5, resume=True) == 0
    assert content(tmp_path / "parts") == content(tmp_path / "whole")


def test_an_interrupted_run_goes_on(scene: Path, tmp_path: Path) -> None:
    def stop(name: str, index: int, count: int) -> None:
        if index == 2:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        write(scene, tmp_path / "out", frames=5, progress=stop)
    assert sorted(content(tmp_path / "out")) == ["frame-00000.png", "frame-00001.png"]
    assert write(scene, tmp_path / "out", frames=5, resume=True) == 3
    write(scene, tmp_path / "whole", frames=5)
    assert content(tmp_path / "out") == content(tmp_path / "whole")


def test_nothing_is_replaced_unless_told_to(scene: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    write(scene, out, frames=3)
    with pytest.raises(InputError, match="exists; give --resume to go on with it, --force to replace it"):
        write(scene, out)
    write(scene, out, frames=2, force=True)
    assert sorted(content(out)) == ["frame-00000.png", "frame-00001.png"]
    (out / "mine.txt").write_text("kept")
    for how in ({"force": True}, {"resume": True}):
        with pytest.raises(InputError, match=r"holds 'mine\.txt', which is not part of a sequence"):
            write(scene, out, **how)
    assert (out / "mine.txt").read_text() == "kept"


def test_another_scene_is_not_gone_on_with(scene: Path, tmp_path: Path) -> None:
    write(scene, tmp_path / "out", frames=2)
    before = content(tmp_path / "out")
    with pytest.raises(InputError, match="of another scene, other settings or another rate"):
        write(scene, tmp_path / "out", "temporal.alpha=0.1", resume=True)
    (tmp_path / "out" / STATE).write_bytes(b"not an archive")
    with pytest.raises(InputError, match=r"history\.npz'? cannot be read|cannot be read"):
        write(scene, tmp_path / "out", resume=True)
    assert content(tmp_path / "out") == before
    (tmp_path / "out" / STATE).unlink()
    assert write(scene, tmp_path / "out", frames=2, resume=True) == 2


def test_a_path_into_geometry_writes_nothing(scene: Path, tmp_path: Path) -> None:
    what = loaded(scene, 'surfaces=[{"type":"sphere","center":[0,1.7,0.2],"radius":1}]')
    with pytest.raises(InputError, match="within surfaces"):
        write_frames(what, load_assets(what.scene, None), tmp_path / "out", frames=3, rate=30.0)
    assert not (tmp_path / "out").exists()


def test_the_command(scene: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out, movie = tmp_path / "out", tmp_path / "movie.gif"
    assert main(["render", str(scene), "--frames", "2", "-o", str(out)]) == 0
    assert main(["render", str(scene), "--frames", "3", "-o", str(out), "--resume"]) == 0
    assert capsys.readouterr().out.split() == [str(out), str(out)]
    assert len(content(out)) == 3
    assert json.loads((out / MANIFEST).read_text())["format"] == "froxel-ref sequence"
    assert main(["render", str(scene), "--frames", "3", "-o", str(movie), "--rate", "12.5"]) == 0
    assert iio.imread(movie).shape[:3] == (3, 14, 24)
    assert iio.immeta(movie)["duration"] == pytest.approx(80)
    assert not np.array_equal(iio.imread(movie, index=0), iio.imread(movie, index=2))


@pytest.mark.parametrize(("more", "words"), [
    (["--frames", "0"], "--frames: is '0', must be a whole number"), (["--frames", "two"], "--frames: is 'two'"),
    (["--frames", "2", "--rate", "0"], "--rate: is '0'"), (["--resume"], "--resume: is given for one image"),
    (["--frames", "2", "--resume", "--force"], "--resume: is given with --force"),
    (["--frames", "2", "-o", "x.gif", "--resume"], "--resume: is given for a .gif"),
    (["--frames", "2", "-o", "x.mp4"], "output: 'x.mp4' must be a folder, or end in .gif"),
])
def test_bad_input_is_one_line(more: list[str], words: str, scene: Path, capsys: pytest.CaptureFixture[str],
                               tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    before = sorted(path.name for path in tmp_path.iterdir())
    assert main(["render", str(scene), *more]) == 2
    assert words in capsys.readouterr().err
    assert sorted(path.name for path in tmp_path.iterdir()) == before
