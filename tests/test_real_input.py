"""Real input from end to end: a measured smoke plume over a scanned mesh (not part of the project)."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from data import data_file

from froxel_ref import scene_files
from froxel_ref.assets import load_assets
from froxel_ref.cli import main
from froxel_ref.frame import FINAL, run_frame


@pytest.fixture
def folder() -> Path:
    """The folder with both files; the test is skipped, and says so, where they are not."""
    data_file("stanford-bunny.obj")
    pytest.importorskip("embreex", reason="meshes need the extra 'mesh'")
    return data_file("smoke.vol").parent


def test_smoke_golden_set(folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    target = tmp_path / "golden"
    assert main(["golden", "smoke", "--data", str(folder), "-o", str(target), "--grid", "40x40x48",
                 "--size", "160x160"]) == 0
    assert Path(capsys.readouterr().out.rstrip().split("\n")[-1]).name == "contact_sheet.png"
    manifest = json.loads((target / "manifest.json").read_text())
    assert str(folder) not in json.dumps(manifest)
    extinction = np.load(target / "media" / "extinction.npy")
    assert extinction.shape == (48, 40, 40)
    assert extinction.max() > 0


def test_smoke_is_where_it_should_be(folder: Path) -> None:
    scene, settings, _ = scene_files.load("smoke", overrides=["camera.width=128", "camera.height=128"])
    frame = run_frame(scene, settings, assets=load_assets(scene, folder))
    transmittance = np.broadcast_to(frame["apply/fog_transmittance"], (128, 128))
    depth = frame["surface/depth"]
    thick, clear = transmittance < 0.8, transmittance > 0.999
    rows = np.flatnonzero(thick.any(axis=1))
    # The plume stands in the middle of the picture and rises well above the mesh's back (seen in the picture).
    assert thick.mean() > 0.05
    assert clear.mean() > 0.2
    assert rows[0] < 40
    assert np.all(frame[FINAL] >= 0)
    # The mesh is nearer than the floor behind it: its silhouette is a step in depth.
    steps = np.abs(np.diff(np.where(np.isfinite(depth), depth, 1e3), axis=1))
    assert (steps > 0.2).sum() > 20


def test_smoke_planned_equals_forced(folder: Path) -> None:
    scene, settings, _ = scene_files.load("smoke", overrides=[
        "camera.width=48", "camera.height=48", "grid.width=24", "grid.height=24", "grid.depth=24"])
    assets = load_assets(scene, folder)
    planned, forced = (run_frame(scene, settings, assets=assets, force_all=force_all)[FINAL]
                       for force_all in (False, True))
    assert planned.tobytes() == forced.tobytes()
