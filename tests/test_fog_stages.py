"""Media and lighting in pieces: half of a checkerboard, slabs, both; the same bits as the whole grid's."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from froxel_ref import scene_files
from froxel_ref.assets import load_assets
from froxel_ref.checkerboard import computed, pack, unpack
from froxel_ref.fog_stages import pieces
from froxel_ref.frame import FINAL, Frame, plan, run_frame
from froxel_ref.jobs import Job
from froxel_ref.records import InputError
from froxel_ref.scene import (
    Camera,
    DirectionalLight,
    HeightFog,
    LocalMedium,
    Medium,
    Plane,
    PointLight,
    Scene,
    Transform,
)
from froxel_ref.settings import Grid, Settings, replace

SUN = DirectionalLight(direction=(0.2, 1.0, 0.1), irradiance=(2, 2, 2))
LAMP = PointLight(position=(0.0, 2.0, -4.0), intensity=(9, 5, 2), radius=6)
FOG = Medium(extinction=0.1, phase_anisotropy=0.5)
HAZE = Medium(extinction=0.1, height_fog=HeightFog(falloff=0.4))
BALL = LocalMedium(extinction=0.8, emissive=(0, 0.1, 0), transform=Transform(translate=(0, 1.5, -4), scale=(1.5, 1, 1)))
SCENES = {
    "uniform": Scene(global_media=(FOG,), lights=(SUN,)),
    "ambient": Scene(global_media=(FOG,), ambient=(1, 1, 1)),
    "haze": Scene(global_media=(HAZE,), lights=(SUN,)),
    "lamp": Scene(global_media=(FOG,), lights=(LAMP,), surfaces=(Plane(),)),
    "two": Scene(global_media=(FOG,), local_media=(BALL,), lights=(SUN, LAMP)),
    "ball": Scene(local_media=(BALL,), lights=(SUN, LAMP)),
    "nothing": Scene(lights=(SUN,)),
}
SIZES = [(8, 5, 6), (7, 4, 5), (1, 1, 1), (2, 2, 2), (1, 6, 3), (9, 1, 4), (3, 2, 1)]
FIELDS = ("lighting/in_scattering", "media/extinction")


def run(scene: Scene, size: tuple[int, int, int], **how: object) -> Frame:
    width, height, depth = size
    scene = dataclasses.replace(scene, camera=Camera(width=13, height=9))
    frame = how.pop("frame", 0)
    force = how.pop("force_all", False)
    grid = Grid(width=width, height=height, depth=depth, near=0.5, far=20.0)
    return run_frame(scene, replace(Settings(grid=grid), **how), frame=frame, force_all=force)  # type: ignore[arg-type]


def equal(a: np.ndarray, b: np.ndarray) -> bool:
    if not a.size or not b.size:
        return not (a.any() or b.any())
    return bool((np.broadcast_to(a, np.broadcast_shapes(a.shape, b.shape)) == b).all())


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("name", SCENES)
def test_merged_is_separate_bit_for_bit(name: str, size: tuple[int, int, int], monkeypatch: pytest.MonkeyPatch) -> None:
    """Slabs of one slice, of some, and of all."""
    whole = run(SCENES[name], size)
    for slab in (1, 50, 1 << 17):
        monkeypatch.setattr("froxel_ref.fog_stages.SLAB", slab)
        merged = run(SCENES[name], size, merged=True)
        for result in (*FIELDS, FINAL):
            assert equal(whole[result], merged[result]), result
            assert merged[result].size <= whole[result].size


@pytest.mark.parametrize("frame", [0, 1])
@pytest.mark.parametrize("parity", ["even", "odd"])
@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("name", SCENES)
def test_half_of_the_froxels_are_those_of_the_whole(name: str, size: tuple[int, int, int], parity: str, frame: int
                                                    ) -> None:
    """Where the listing has them; the whole grid's numbers to the last bit."""
    if size == (1, 1, 1):
        with pytest.raises(InputError, match=r"^checkerboard: is on for a grid of one froxel"):
            run(SCENES[name], size, checkerboard=True)
        return
    width, height, depth = size
    shape = depth, height, width
    whole = run(SCENES[name], size)
    half = run(SCENES[name], size, checkerboard=True, checkerboard_parity=parity, frame=frame)
    for result in FIELDS:
        want = np.broadcast_to(whole[result], (*whole[result].shape[:-3], *shape))
        got = np.broadcast_to(half[result], (*half[result].shape[:-3], -(-depth // 2), height, width))
        for z, y, x in np.ndindex(shape):
            if (x + y + z + frame) % 2 == (parity == "odd"):
                assert np.array_equal(got[..., z // 2, y, x], want[..., z, y, x]), (result, z, y, x)


def test_half_is_computed() -> None:
    """Counted: the froxels of a frame's pieces, and those of the next, are all and each once."""
    for size in (s for s in SIZES if s != (1, 1, 1)):
        width, height, depth = size
        jobs = [Job(Scene(), Settings(grid=Grid(width=width, height=height, depth=depth), checkerboard=True), None,
                    frame=f) for f in (0, 1)]  # type: ignore[arg-type]
        counts = [sum(p.froxels.depths.size * p.froxels.rays.length.size for p in pieces(job)) for job in jobs]
        assert counts == [computed((depth, height, width), f).sum() for f in (0, 1)]
        assert sum(counts) == width * height * depth


@given(size=st.tuples(*[st.integers(1, 9)] * 3).filter(lambda size: size != (1, 1, 1)),
       name=st.sampled_from(sorted(SCENES)), frame=st.integers(0, 3), merged=st.booleans())
@settings(max_examples=40)
def test_planned_is_forced_and_merged_is_separate_under_a_checkerboard(
        size: tuple[int, int, int], name: str, frame: int, merged: bool) -> None:
    planned = run(SCENES[name], size, checkerboard=True, frame=frame)
    other = run(SCENES[name], size, checkerboard=True, frame=frame, merged=merged, force_all=not merged)
    width, height, depth = size
    shape = depth, height, width
    there = computed(shape, frame)
    for result in FIELDS:  # what the last of an odd number of slices lacks is no froxel
        halves = [np.broadcast_to(f[result], (*f[result].shape[:-3], -(-depth // 2), height, width))
                  for f in (planned, other)]
        whole = [unpack(half, shape, frame) for half in halves]
        assert np.array_equal(whole[0] * there, whole[1] * there), result
    for result in ("temporal/in_scattering", "temporal/extinction", FINAL):
        assert equal(planned[result], other[result]), result


@pytest.mark.parametrize("fill", ["existing", "zero"])
def test_planned_is_forced_where_a_border_is_dark(fill: str) -> None:
    """D11: one number has holes too, if what is outside counts as 0."""
    for name in ("ambient", "uniform"):
        frames = [run(SCENES[name], (6, 5, 4), checkerboard=True, checkerboard_fill=fill, force_all=force)
                  for force in (False, True)]
        assert equal(frames[0]["temporal/extinction"], frames[1]["temporal/extinction"])
    dark = frames[0]["temporal/extinction"]
    assert (dark.min() == 0.5 * dark.max()) if fill == "zero" else (dark == 0.1).all()


def test_the_plan_says_so() -> None:
    scene, grid = SCENES["lamp"], Grid(width=4, height=4, depth=4)
    apart, merged = (plan(scene, Settings(grid=grid, merged=m)) for m in (False, True))
    assert apart["merged"].why == "media and lighting are stages of their own"
    assert [merged[name].runs for name in ("media", "lighting", "merged")] == [False, False, True]
    assert merged["media"].why == "merged with lighting"
    assert {part.name for part in merged["merged"].parts} >= {"global media", "point and spot lights", "shadows"}


def test_what_is_constant_stays_one_number() -> None:
    for how in ({}, {"merged": True}, {"checkerboard": True}, {"checkerboard": True, "merged": True}):
        frame = run(SCENES["ambient"], (9, 8, 7), **how)
        assert frame["media/extinction"].shape == (1, 1, 1), how
        assert frame["lighting/in_scattering"].shape == (3, 1, 1, 1), how


@pytest.mark.parametrize("precision", ["float64", "float32"])
def test_the_hall_in_pieces(precision: str) -> None:
    """Textured, with spot lights, shadows, culling and volumetric shadows."""
    loaded = scene_files.load("thesis-hall", overrides=["camera.width=32", "camera.height=18"])
    how = replace(loaded.settings, grid=Grid(width=21, height=13, depth=17, near=0.5, far=40.0), precision=precision,
                  volumetric_shadows="maps")
    assets = load_assets(loaded.scene, loaded.folder)
    whole, merged = (run_frame(loaded.scene, replace(how, merged=m), assets=assets) for m in (False, True))
    assert equal(whole[FINAL], merged[FINAL])
    halves = [run_frame(loaded.scene, replace(how, checkerboard=True), assets=assets, frame=f) for f in (0, 1)]
    shape = 17, 13, 21
    for f, half in enumerate(halves):
        boxes = pieces(Job(loaded.scene, replace(how, checkerboard=True), assets, frame=f))
        starts = [slice((p.place[1].start + p.place[2].start + f) % 2, None, 2) for p in boxes]
        parts = [whole["lighting/in_scattering"][:, z, p.place[1], p.place[2]]
                 for z, p in zip(starts, boxes, strict=True)]
        order = np.argsort([z.start * 2 + p.place[1].start for z, p in zip(starts, boxes, strict=True)])
        assert np.array_equal(half["lighting/in_scattering"], pack([parts[k] for k in order], shape, f))
