"""Real input from end to end: a measured smoke plume over a scanned mesh (not part of the project)."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest
from data import data_file

from froxel_ref import scene_files
from froxel_ref.assets import load_assets
from froxel_ref.cli import main
from froxel_ref.frame import FINAL, run_frame
from froxel_ref.geometry import view_from_world


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


def test_sun_and_spot_light_the_plume_and_the_mesh(folder: Path) -> None:
    """Each light by itself adds to pixels of clear plume and of bare mesh, and both together are their sum."""
    scene, settings, _ = scene_files.load("smoke", overrides=["camera.width=64", "camera.height=64"])
    assets = load_assets(scene, folder)
    assert {light.kind for light in scene.lights} == {"directional", "spot"}
    alone = []
    for light in scene.lights:
        only = dataclasses.replace(scene, lights=(light,), ambient=(0.0,) * 3, background=(0.0,) * 3)
        frame = run_frame(only, settings, assets=assets)
        plume = np.broadcast_to(frame["apply/fog_transmittance"], (64, 64)) < 0.5
        mesh = np.isclose(frame["surface/albedo"][0], scene.surfaces[1].albedo[0])
        assert plume.any()
        assert mesh.any()
        assert (frame["apply/fog_radiance"][:, plume] > 0).any()
        assert (frame["surface/radiance"][:, mesh] > 0).any()
        alone.append(frame[FINAL])
    both = dataclasses.replace(scene, ambient=(0.0,) * 3, background=(0.0,) * 3)
    together = run_frame(both, settings, assets=assets)[FINAL]
    # Sums of two in another order: a few roundings of each pixel.
    np.testing.assert_allclose(together, alone[0] + alone[1], rtol=1e-12, atol=1e-15)


def test_the_mesh_is_in_the_depth_buffer(folder: Path) -> None:
    """Mesh pixels are as far as the mesh's own vertices, moved into the world, allow; the floor lies behind."""
    scene, settings, _ = scene_files.load("smoke", overrides=["camera.width=96", "camera.height=96"])
    assets = load_assets(scene, folder)
    frame = run_frame(scene, settings, assets=assets, outputs=["surface/depth", "surface/albedo"])
    mesh = next(surface for surface in scene.surfaces if surface.kind == "mesh")
    pixels = np.isclose(frame["surface/albedo"][0], mesh.albedo[0])
    matrix = mesh.transform.world_from_local
    points = assets.meshes[mesh][0] @ matrix[:3, :3].T + matrix[:3, 3]
    depths = -(points @ view_from_world(scene.camera)[2, :3] + view_from_world(scene.camera)[2, 3])
    hit = frame["surface/depth"][pixels]
    assert pixels.mean() > 0.02
    assert depths.min() - 1e-6 <= hit.min()
    assert hit.max() <= depths.max() + 1e-6
    assert hit.min() < np.median(depths)


def test_smoke_planned_equals_forced(folder: Path) -> None:
    scene, settings, _ = scene_files.load("smoke", overrides=[
        "camera.width=48", "camera.height=48", "grid.width=24", "grid.height=24", "grid.depth=24"])
    assets = load_assets(scene, folder)
    planned, forced = (run_frame(scene, settings, assets=assets, force_all=force_all)[FINAL]
                       for force_all in (False, True))
    assert planned.tobytes() == forced.tobytes()
