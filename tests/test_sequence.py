"""Sequences: what each frame is given, moving scenes, cuts, resuming, bad paths."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from froxel_ref.assets import load_assets
from froxel_ref.frame import FINAL, run_frame
from froxel_ref.records import InputError
from froxel_ref.scene import Box, Camera, Key, Medium, Mesh, PointLight, Scene, Sphere, Track, Transform
from froxel_ref.scene_motion import scene_at
from froxel_ref.sequence import moment, run_sequence
from froxel_ref.settings import Grid, Settings, Temporal

HOW = Settings(grid=Grid(width=6, height=4, depth=5, near=0.5, far=12.0), time=2.0,
               temporal=Temporal(filter="scattering", alpha=0.3))
LAMP = PointLight(position=(-1.0, 1.5, -4.0), intensity=(5, 5, 5), radius=6)
MOVING = Scene(camera=Camera(width=12, height=8), global_media=(Medium(extinction=0.1),), lights=(LAMP,), tracks=(
    Track(path="lights[0].position", keys=(Key(time=0, value=(-1, 1.5, -4)), Key(time=1, value=(1, 1.5, -4)))),
    Track(path="camera.position[0]", keys=(Key(time=0, value=0), Key(time=1, value=0.5)))))


def test_each_frame_by_hand() -> None:
    """Scene, time, number and history of every frame; one after the other."""
    before = None
    for n, frame in enumerate(run_sequence(MOVING, frames=4, settings=HOW, rate=4.0)):
        want = run_frame(scene_at(MOVING, n / 4.0), dataclasses.replace(HOW, time=2.0 + n / 4.0), frame=n,
                         previous=before)
        assert frame.scene.camera.position[0] == pytest.approx(0.125 * n)
        assert frame.settings.time == 2.0 + n / 4.0
        np.testing.assert_array_equal(frame[FINAL], want[FINAL])
        before = want


def test_a_sequence_goes_on_where_it_was_left() -> None:
    whole = [frame[FINAL] for frame in run_sequence(MOVING, frames=5, settings=HOW)]
    begun = list(run_sequence(MOVING, frames=3, settings=HOW))
    rest = list(run_sequence(MOVING, frames=5, settings=HOW, first=3, previous=begun[-1]))
    for got, want in zip([*begun, *rest], whole, strict=True):
        np.testing.assert_array_equal(got[FINAL], want)


def test_a_path_of_cameras_or_a_function() -> None:
    cameras = [Camera(width=12, height=8, position=(0.1 * n, 1.7, 0)) for n in range(3)]
    still = dataclasses.replace(MOVING, tracks=())
    images = [[frame[FINAL] for frame in run_sequence(still, path, 3, settings=HOW)]
              for path in (cameras, cameras.__getitem__)]
    for a, b in zip(*images, strict=True):
        np.testing.assert_array_equal(a, b)
    assert not np.array_equal(images[0][0], images[0][2])


def test_cuts() -> None:
    made = list(run_sequence(MOVING, frames=4, settings=HOW, cuts=[2]))
    assert [frame.history.length for frame in made] == [1, 2, 1, 2]  # type: ignore[union-attr]


def test_frames_keep_what_was_asked_for() -> None:
    told: list[tuple[str, int, int]] = []
    made = list(run_sequence(MOVING, frames=2, settings=HOW, outputs=[FINAL],
                             progress=lambda name, k, n: told.append((name, k, n))))
    assert list(made[1].results) == [FINAL]
    assert told == [("frame 0", 0, 2), ("frame 1", 1, 2)]


@pytest.mark.parametrize("surface", [Box(transform=Transform(translate=(0, 1.7, -3), rotate=(0, 30, 0))),
                                     Sphere(center=(0, 1.7, -3), radius=0.5)])
def test_a_path_that_ends_within_geometry_is_refused_before_it_begins(surface: Box | Sphere) -> None:
    scene = Scene(surfaces=(surface,), tracks=(
        Track(path="camera.position[2]", keys=(Key(time=0, value=2), Key(time=1, value=-3))),
        Track(path="camera.target[2]", keys=(Key(time=0, value=-9), Key(time=1, value=-9)))))
    with pytest.raises(InputError, match=r"^camera\.position: is within surfaces\[0\] in frame \d+, must be outside"):
        run_sequence(scene, frames=31, settings=HOW)  # nothing is asked of it yet
    assert moment(scene, None, 0).camera.position[2] == 2.0


def test_bad_input_is_named() -> None:
    for more, words in (({"frames": 0}, "^frames: is 0"), ({"frames": True}, "^frames: is True"),
                        ({"frames": 2, "first": 2}, "^first: is 2, must be a frame from 0 to 1"),
                        ({"rate": 0.0}, "^rate: is 0"),
                        ({"camera_path": [Camera()], "frames": 2}, "^camera_path: has 1"),
                        ({"camera_path": lambda n: None}, r"^camera_path\[0\]: is a NoneType")):
        with pytest.raises(InputError, match=words):
            run_sequence(MOVING, settings=HOW, **more)  # type: ignore[arg-type]


def test_a_mesh_that_moves_is_found_among_its_assets() -> None:
    pytest.importorskip("embreex", reason="meshes need the extra 'mesh'")
    mesh = Mesh(path="pyramid.obj", transform=Transform(translate=(-1, 1.5, -4)))
    corners = np.array([(-1, 0, -1), (1, 0, -1), (1, 0, 1), (-1, 0, 1), (0, 1.5, 0)], float)
    faces = np.array([(0, 1, 4), (1, 2, 4), (2, 3, 4), (3, 0, 4)])
    empty = load_assets(Scene(), None)
    scene = dataclasses.replace(MOVING, surfaces=(mesh,), tracks=(
        Track(path="surfaces[0].transform.translate[0]", keys=(Key(time=0, value=-1), Key(time=0.1, value=1))),))
    made = list(run_sequence(scene, frames=4, settings=dataclasses.replace(HOW, temporal=Temporal()),
                             assets=empty._replace(meshes={mesh: (corners, faces)})))
    assert not np.array_equal(made[0][FINAL], made[3][FINAL])
    there = dataclasses.replace(mesh, transform=Transform(translate=(1, 1.5, -4)))
    want = run_frame(dataclasses.replace(scene, surfaces=(there,), tracks=()), made[3].settings,
                     assets=empty._replace(meshes={there: (corners, faces)}))
    np.testing.assert_array_equal(made[3][FINAL], want[FINAL])
