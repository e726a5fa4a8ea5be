"""The V-Buffer and a sun's visibility filtered over frames: averages, what leaves a ghost and what cannot, holes."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from froxel_ref.checkerboard import computed
from froxel_ref.frame import FINAL, Frame, estimate_bytes, plan, run_frame
from froxel_ref.golden import write_golden
from froxel_ref.grid import froxel_points, make_froxels
from froxel_ref.jitter import froxel_jitter
from froxel_ref.lighting import in_scattering
from froxel_ref.material_stage import FIELDS, filtered_sun
from froxel_ref.media import voxelise
from froxel_ref.records import InputError
from froxel_ref.scene import (
    Box,
    Camera,
    DirectionalLight,
    LocalMedium,
    Medium,
    Plane,
    PointLight,
    Scene,
    Transform,
)
from froxel_ref.scene_files import Loaded
from froxel_ref.settings import Grid, Settings, Temporal, replace
from froxel_ref.temporal import history_position, reproject

GRID = Grid(width=12, height=7, depth=8, near=0.5, far=16.0)
SHAPE = (8, 7, 12)
SUN = DirectionalLight(direction=(0.3, 1.0, 0.2), irradiance=(3, 2, 1))
LAMP = PointLight(position=(0.4, 1.5, -5.0), intensity=(9, 5, 2), radius=7)
FOG = Medium(extinction=0.08, phase_anisotropy=0.6)
BALL = LocalMedium(extinction=0.7, phase_anisotropy=-0.3, emissive=(0.0, 0.2, 0.1),
                   transform=Transform(translate=(0.3, 1.5, -5), scale=(1.5, 1, 1.2)))
SLAB = Box(transform=Transform(translate=(0.5, 3, -5), scale=(1.7, 0.1, 1.7)))
HALL = Scene(camera=Camera(width=24, height=14), global_media=(FOG,), local_media=(BALL,), lights=(LAMP, SUN),
             surfaces=(Plane(), SLAB))
FOGGY = dataclasses.replace(HALL, local_media=())


def how(**temporal: object) -> Settings:
    return Settings(grid=GRID, shadows="exact",
                    temporal=Temporal(**({"filter": "media"} | temporal)))  # type: ignore[arg-type]


def frames(scene: Scene, settings: Settings, count: int, **more: object) -> list[Frame]:
    made: list[Frame] = []
    for n in range(count):
        made.append(run_frame(scene, settings, frame=n, previous=made[-1] if made else None, **more))  # type: ignore[arg-type]
    return made


def full(field: np.ndarray) -> np.ndarray:
    return np.broadcast_to(field, (*field.shape[:-3], *SHAPE))


def lit_below_a_slab(points: tuple[np.ndarray, ...], direction: tuple[float, float, float]) -> np.ndarray:
    """1 where the way to a sun misses the slab and begins above the ground, written for boxes along the axes."""
    x, y, z = np.broadcast_arrays(*points)
    first, last = np.full(x.shape, 0.0), np.full(x.shape, np.inf)
    for place, way, middle, half in zip((x, y, z), direction, (0.5, 3.0, -5.0), (1.7, 0.1, 1.7), strict=True):
        ends = [(middle - half - place) / way, (middle + half - place) / way]
        first, last = np.maximum(first, np.minimum(*ends)), np.minimum(last, np.maximum(*ends))
    return ((first >= last) & (y > 0.0)).astype(float)


# --- the averages -----------------------------------------------------------------------------------


def test_material_and_visibility_are_averaged_at_the_jittered_samples() -> None:
    """Equation 3.2 as a loop over frames; g by what scatters; the sun's visibility by hand."""
    made = frames(HALL, how(alpha=0.25), 5)
    kept: dict[str, np.ndarray] = {}
    for n, frame in enumerate(made):
        froxels = make_froxels(HALL.camera, GRID, jitter=froxel_jitter(n))
        buffer = voxelise(HALL, froxels, {}, Settings())
        now = {"scattering": full(buffer.scattering), "extinction": full(buffer.extinction),
               "emission": full(buffer.emission),
               "sun_visibility": lit_below_a_slab(froxel_points(froxels), SUN.direction)}
        now["moment"] = now["scattering"].sum(axis=0) * full(buffer.phase_anisotropy)
        kept = {name: 0.25 * now[name] + 0.75 * kept[name] for name in now} if kept else now
        for name in ("scattering", "extinction", "emission", "sun_visibility"):
            np.testing.assert_allclose(full(frame[f"material/{name}"]), kept[name], rtol=1e-13, atol=1e-15)
        want = kept["moment"] / kept["scattering"].sum(axis=0)
        np.testing.assert_allclose(full(frame["material/phase_anisotropy"]), want, rtol=1e-12, atol=1e-15)
    assert frame["material/sun_light"].tolist() == [1]
    assert 0.0 < frame["material/sun_visibility"].mean() < 1.0
    assert ((frame["material/sun_visibility"] > 0.0) & (frame["material/sun_visibility"] < 1.0)).any()
    assert np.ptp(frame["material/phase_anisotropy"]) > 0.5


def test_light_is_computed_of_the_filtered_fields_at_the_middles() -> None:
    """A sun alone, isotropic: σ_s·E·visibility/4π + emission, of what the stage hands on."""
    scene = dataclasses.replace(HALL, lights=(SUN,))
    frame = frames(scene, replace(how(alpha=0.25), phase_function="isotropic"), 3)[-1]
    light = np.reshape(SUN.irradiance, (3, 1, 1, 1)) / (4.0 * np.pi) * frame["material/sun_visibility"]
    want = frame["material/scattering"] * light + frame["material/emission"]
    np.testing.assert_allclose(frame["lighting/in_scattering"], full(want), rtol=1e-13, atol=1e-16)


def test_without_jitter_rest_is_rest() -> None:
    """Every bit, borders and g too."""
    still = replace(how(), jitter="off")
    plain = run_frame(HALL, Settings(grid=GRID, shadows="exact"))
    for frame in frames(HALL, still, 4):
        np.testing.assert_array_equal(frame[FINAL], plain[FINAL])
        np.testing.assert_array_equal(frame["material/phase_anisotropy"], plain["media/phase_anisotropy"])
    one = frames(dataclasses.replace(HALL, global_media=()), how(), 2)[-1]  # one g, where nothing scatters too
    assert (one["material/phase_anisotropy"].shape, one["material/scattering"].shape) == ((1, 1, 1), (3, *SHAPE))


@pytest.mark.parametrize("scene", [
    dataclasses.replace(HALL, lights=(), ambient=(0.3, 0.2, 0.1)),
    dataclasses.replace(HALL, lights=(SUN,), local_media=(), global_media=(Medium(extinction=0.08),)),
], ids=["ambient light on a medium with an edge", "a shadow's edge in uniform fog"])
def test_a_scene_at_rest_is_as_by_filtering_light(scene: Scene) -> None:
    """Where only one of the two factors varies within a froxel the mean of the product is the product of means."""
    ours = frames(scene, how(alpha=0.3), 6)[-1]
    theirs = frames(scene, how(alpha=0.3, filter="scattering"), 6)[-1]
    np.testing.assert_allclose(full(ours["lighting/in_scattering"]), full(theirs["temporal/in_scattering"]), rtol=1e-13,
                               atol=1e-16)
    np.testing.assert_allclose(full(ours["material/extinction"]), full(theirs["temporal/extinction"]), rtol=1e-13)
    np.testing.assert_allclose(ours[FINAL], theirs[FINAL], rtol=1e-11)
    once = run_frame(scene, Settings(grid=GRID, shadows="exact"))
    assert not np.allclose(full(once["lighting/in_scattering"]), full(ours["lighting/in_scattering"]), rtol=1e-2)


def test_start_by_the_mean() -> None:
    made = frames(HALL, how(start="mean"), 4)
    parts = [lit_below_a_slab(froxel_points(make_froxels(HALL.camera, GRID, jitter=froxel_jitter(n))), SUN.direction)
             for n in range(4)]
    np.testing.assert_allclose(made[-1]["material/sun_visibility"], np.mean(parts, axis=0), rtol=1e-13, atol=1e-15)


@pytest.mark.parametrize("mixing", ["weighted", "mean"])
def test_the_mean_of_g_over_frames(mixing: str) -> None:
    """D12 in time: two frames of different fog, a step by hand."""
    def alone(g: float, extinction: float) -> Scene:
        ball = dataclasses.replace(BALL, phase_anisotropy=g, extinction=extinction)
        return dataclasses.replace(HALL, global_media=(), local_media=(ball, ball), lights=())

    settings = replace(how(alpha=0.25), jitter="off", phase_mixing=mixing)
    first = run_frame(alone(0.8, 0.1), settings)
    then = run_frame(alone(-0.4, 0.7), settings, frame=1, previous=first)
    inside = full(then["media/extinction"]) > 0.0
    weights = (0.25 * 0.7, 0.75 * 0.1) if mixing == "weighted" else (0.25, 0.75)
    want = (weights[0] * -0.4 + weights[1] * 0.8) / sum(weights)
    np.testing.assert_allclose(full(then["material/phase_anisotropy"])[inside], want, rtol=1e-12)
    assert inside.any()


def test_a_g_that_the_scene_has_no_more() -> None:
    """What history holds lies outside of what this frame's media span, and is lit by it all the same."""
    ball = dataclasses.replace(BALL, phase_anisotropy=0.9, emissive=(0, 0, 0))
    scene = dataclasses.replace(HALL, local_media=(ball,), lights=(SUN,), surfaces=())
    now = dataclasses.replace(scene, global_media=(dataclasses.replace(FOG, phase_anisotropy=0.1),),
                              local_media=(dataclasses.replace(ball, phase_anisotropy=0.1),))
    frame = run_frame(now, how(), frame=1, previous=run_frame(scene, how()))
    g = full(frame["material/phase_anisotropy"])
    assert g.min() < 0.7
    assert g.max() > 0.8
    way = np.stack(np.broadcast_arrays(*froxel_points(make_froxels(HALL.camera, GRID)))) - np.reshape(
        HALL.camera.position, (3, 1, 1, 1))
    cosine = np.tensordot(SUN.direction, way / np.linalg.norm(way, axis=0), axes=1) / np.linalg.norm(SUN.direction)
    phase = (1.0 - g * g) / (4.0 * np.pi * (1.0 + g * g - 2.0 * g * cosine) ** 1.5)
    want = frame["material/scattering"] * np.reshape(SUN.irradiance, (3, 1, 1, 1)) * phase
    np.testing.assert_allclose(full(frame["lighting/in_scattering"]), want, rtol=1e-12)


def test_lobes_of_a_mixture() -> None:
    """Each lobe is averaged; a history of other lobes is none."""
    settings = replace(how(alpha=0.25), phase_mixing="mixture")
    made = frames(HALL, settings, 3)
    want = made[0]["media/lobe_scattering"]
    for frame in made[1:]:
        want = 0.25 * frame["media/lobe_scattering"] + 0.75 * want
    np.testing.assert_allclose(made[-1]["material/lobe_scattering"], want, rtol=1e-13, atol=1e-16)
    np.testing.assert_allclose(want.sum(axis=0), full(made[-1]["material/scattering"]), rtol=1e-13)
    other = dataclasses.replace(HALL, global_media=(dataclasses.replace(FOG, phase_anisotropy=0.1),))
    then, fresh = (run_frame(other, settings, frame=3, previous=previous) for previous in (made[-1], None))
    for name in ("material/scattering", "material/lobe_scattering", "material/extinction"):
        np.testing.assert_array_equal(then[name], fresh[name])
    assert not np.array_equal(then["material/sun_visibility"], fresh["material/sun_visibility"])


# --- ghosts -----------------------------------------------------------------------------------------


def lamp_at(x: float, scene: Scene = FOGGY) -> Scene:
    return dataclasses.replace(scene, lights=(dataclasses.replace(LAMP, position=(x, 1.5, -5.0)), SUN))


@pytest.mark.parametrize("scene", [dataclasses.replace(FOGGY, surfaces=()), HALL], ids=["fog", "a ball, at rest"])
def test_a_moving_lamp_leaves_no_ghost(scene: Scene) -> None:
    """Not a bit of it: the frame is that of a run without history. Filtered light keeps 0.95 of it."""
    settings = how() if not scene.surfaces else replace(how(), jitter="off")
    before: dict[str, Frame | None] = {"media": None, "scattering": None}
    for n in range(4):
        for filter in before:
            temporal = dataclasses.replace(settings.temporal, filter=filter)
            before[filter] = run_frame(lamp_at(-3.0 + 2.0 * n, scene), replace(settings, temporal=temporal), frame=n,
                                       previous=before[filter])
    fresh = run_frame(lamp_at(3.0, scene), settings, frame=3)
    ours, theirs = before["media"], before["scattering"]
    assert ours is not None
    assert theirs is not None
    for name in ("lighting/in_scattering", FINAL):
        np.testing.assert_array_equal(ours[name], fresh[name])
    apart = theirs["temporal/in_scattering"] - full(fresh["lighting/in_scattering"])
    assert np.abs(apart).max() > 0.3 * fresh["lighting/in_scattering"].max()
    if not scene.surfaces:  # a uniform fog's fields carry no axes, filtered or not
        assert [ours[f"material/{name}"].size for name in ("scattering", "extinction", "phase_anisotropy")] == [3, 1, 1]


def test_a_turning_camera_has_the_phase_function_at_once() -> None:
    scene = Scene(camera=Camera(width=24, height=14), global_media=(FOG,), lights=(SUN,))
    turned = dataclasses.replace(scene, camera=Camera(width=24, height=14, target=(1.0, 1.9, -1.0)))
    before = frames(scene, how(), 3)[-1]
    now = run_frame(turned, how(), frame=3, previous=before)
    want = run_frame(turned, Settings(grid=GRID))["lighting/in_scattering"]
    np.testing.assert_array_equal(full(now["lighting/in_scattering"]), full(want))


@pytest.mark.parametrize("alpha", [0.1, 0.4])
def test_the_shadow_of_a_moving_sun_does(alpha: float) -> None:
    """(1 − α)ⁿ of each earlier shadow, found by hand; light follows."""
    ways = [(0.3 + 0.2 * n, 1.0, 0.2 - 0.09 * n) for n in range(5)]
    before, want = None, None
    for n, way in enumerate(ways):
        scene = dataclasses.replace(FOGGY, lights=(dataclasses.replace(SUN, direction=way),),
                                    global_media=(Medium(extinction=0.08),))
        before = run_frame(scene, how(alpha=alpha), frame=n, previous=before)
        points = froxel_points(make_froxels(scene.camera, GRID, jitter=froxel_jitter(n)))
        now = lit_below_a_slab(points, way)
        want = now if want is None else alpha * now + (1.0 - alpha) * want
    assert before is not None
    np.testing.assert_allclose(before["material/sun_visibility"], want, rtol=1e-12, atol=1e-15)
    light = 0.08 * np.reshape(SUN.irradiance, (3, 1, 1, 1)) / (4.0 * np.pi) * want
    np.testing.assert_allclose(before["lighting/in_scattering"], light, rtol=1e-12, atol=1e-16)


def test_remedies_shorten_the_shadows_ghost() -> None:
    """The sun from above a roof over everything, then from below. Where a shadow is three froxels wide, every
    neighbourhood holds light and dark, and no clamp finds anything amiss."""
    roof = Box(transform=Transform(translate=(0, 40, 0), scale=(500, 1, 500)))
    above = dataclasses.replace(FOGGY, surfaces=(roof,))
    below = dataclasses.replace(above, lights=(LAMP, dataclasses.replace(SUN, direction=(0.1, -1.0, 0.2))))
    left = {}
    for name, more in (("none", {}), ("range", {"clamp": "range"}), ("deviation", {"clamp": "deviation"}),
                       ("weight", {"alpha_most": 0.6})):
        settings = how(alpha=0.1, **more)
        before = frames(above, settings, 2)[-1]
        for n in range(2, 6):
            before = run_frame(below, settings, frame=n, previous=before)
        left[name] = float(1.0 - before["material/sun_visibility"].mean())
    assert left == pytest.approx({"none": 0.9 ** 4, "range": 0.0, "deviation": 0.0, "weight": 0.4 ** 4}, abs=1e-12)


def test_one_weight_for_all_of_the_material() -> None:
    """A fog that changes its colour: extinction moves as fast as scattering, so no more is scattered than lost."""
    def fog(albedo: tuple[float, float, float], extinction: float) -> Scene:
        ball = dataclasses.replace(BALL, albedo=albedo, extinction=extinction, emissive=(0, 0, 0),
                                   transform=Transform(translate=(0.0, 1.5, -6), scale=(3, 3, 3)))
        return dataclasses.replace(HALL, lights=(), global_media=(), local_media=(ball,))

    settings = replace(how(alpha=0.05, alpha_most=0.9), jitter="off")
    before = frames(fog((0.1, 0.2, 0.3), 0.7), settings, 2)[-1]
    then = run_frame(fog((0.9, 1.0, 0.3), 0.75), settings, frame=2, previous=before)
    inside = full(then["media/extinction"]) > 0.0
    shares = []
    for name in ("extinction", "scattering"):
        old, new, now = (full(field)[..., inside] for field in (
            before[f"material/{name}"], then[f"material/{name}"], then[f"media/{name}"]))
        shares.append((new - old) / (now - old))
    np.testing.assert_allclose(np.broadcast_to(shares[0], shares[1].shape), shares[1], rtol=1e-9)
    assert ((shares[0] > 0.2) & (shares[0] < 0.8)).any()  # by its own change alone 0.05 at the ball's edge
    assert (full(then["material/scattering"]) <= full(then["material/extinction"]) * (1.0 + 1e-14)).all()


# --- which sun --------------------------------------------------------------------------------------


def test_the_first_sun_that_anything_hides() -> None:
    free = dataclasses.replace(SUN, casts_shadows=False)
    second = dataclasses.replace(SUN, direction=(-0.4, 1.0, 0.3))
    scene = dataclasses.replace(FOGGY, lights=(LAMP, free, SUN, second))
    assert filtered_sun(scene, how()) == 2
    assert filtered_sun(scene, replace(how(), shadows="off")) is None
    assert filtered_sun(HALL, replace(how(), shadows="off", volumetric_shadows="exact")) == 1
    frame = frames(scene, how(), 3)[-1]
    assert frame["material/sun_light"].tolist() == [2]
    # The other one is judged at the middle, by this frame alone.
    only = dataclasses.replace(scene, lights=(second,))
    one = run_frame(only, Settings(grid=GRID, shadows="exact"))["lighting/in_scattering"]
    none = run_frame(dataclasses.replace(scene, lights=(LAMP, free, SUN)), how(), frame=2,
                     previous=frames(dataclasses.replace(scene, lights=(LAMP, free, SUN)), how(), 2)[-1])
    np.testing.assert_allclose(frame["lighting/in_scattering"], none["lighting/in_scattering"] + one, rtol=1e-12)


def test_another_suns_visibility_is_no_history() -> None:
    second = dataclasses.replace(SUN, direction=(-0.4, 1.0, 0.3))
    before = run_frame(dataclasses.replace(FOGGY, lights=(SUN, second)), how())
    scene = dataclasses.replace(FOGGY, lights=(dataclasses.replace(SUN, casts_shadows=False), second))
    then, fresh = (run_frame(scene, how(), frame=1, previous=previous) for previous in (before, None))
    assert then["material/sun_light"].tolist() == [1]
    np.testing.assert_array_equal(then["material/sun_visibility"], fresh["material/sun_visibility"])


# --- where history begins ---------------------------------------------------------------------------


def test_a_cut_begins_anew() -> None:
    before = run_frame(HALL, how())
    cut, fresh, on = (run_frame(HALL, how(), frame=1, **more) for more in (
        {"previous": before, "cut": True}, {}, {"previous": before}))
    for name in (FINAL, "material/scattering", "material/sun_visibility"):
        np.testing.assert_array_equal(cut[name], fresh[name])
        assert not np.array_equal(on[name], fresh[name])
    assert cut["material/valid"].max() == 0.0
    assert on["material/valid"].min() == 1.0


def test_what_was_out_of_view_has_no_history() -> None:
    away = dataclasses.replace(HALL, camera=Camera(width=24, height=14, target=(1.0, 1.7, 0.0)))
    then = run_frame(away, how(), frame=1, previous=run_frame(HALL, how()))
    assert then["material/valid"].mean() < 0.1
    alone = run_frame(away, how(), frame=1)
    lost = full(then["material/valid"]) == 0.0
    for name in ("scattering", "extinction", "phase_anisotropy", "sun_visibility"):
        ours, theirs = (full(frame[f"material/{name}"])[..., lost] for frame in (then, alone))
        np.testing.assert_array_equal(ours, theirs)


@pytest.mark.parametrize("mixing", ["weighted", "mean"])
def test_what_a_camera_that_moved_finds(mixing: str) -> None:
    """Of a weight of nearly nothing for the present: the earlier fields where the froxels were, g by what scattered."""
    settings = replace(how(alpha=1e-12), jitter="off", phase_mixing=mixing)
    before = frames(HALL, settings, 2)[-1]
    camera = Camera(width=24, height=14, position=(0.7, 1.7, 0.2), target=(0.7, 1.7, -1.0))
    then = run_frame(dataclasses.replace(HALL, camera=camera), settings, frame=2, previous=before)
    place = history_position(GRID, camera, HALL.camera)
    seen = full(place.valid)
    old = {name: full(before[f"material/{name}"]) for name in ("scattering", "extinction", "phase_anisotropy")}
    want = {name: reproject(field, place) for name, field in old.items()}
    if mixing == "weighted":
        weight = old["scattering"].sum(axis=0)
        want["phase_anisotropy"] = reproject(weight * old["phase_anisotropy"], place) / reproject(weight, place)
    for name, field in want.items():
        np.testing.assert_allclose(full(then[f"material/{name}"])[..., seen], field[..., seen], rtol=1e-10, atol=1e-10)
    np.testing.assert_allclose(then["material/sun_visibility"][seen],
                               reproject(before["material/sun_visibility"], place)[seen], atol=1e-10)
    assert 0.3 < seen.mean() < 1.0
    apart = np.abs(want["phase_anisotropy"] - reproject(old["phase_anisotropy"], place))[seen].max()
    assert (apart > 0.1) == (mixing == "weighted")


@pytest.mark.parametrize("moves", [False, True])
@pytest.mark.parametrize("name", ["scattering", "sun_visibility", "phase_anisotropy"])
def test_a_history_that_is_no_number_lasts_one_frame(name: str, moves: bool) -> None:
    first = run_frame(HALL, how())
    assert first.history is not None
    spoiled = {key: field.copy() for key, field in first.history.fields.items()}
    spoiled[f"material/{name}"][..., 3, 2, 5] = np.nan
    history = dataclasses.replace(first.history, fields=spoiled)
    camera = Camera(width=24, height=14, position=(0.1, 1.7, 0.0), target=(0.1, 1.7, -1.0)) if moves else HALL.camera
    then, want = (run_frame(dataclasses.replace(HALL, camera=camera), how(), frame=1, previous=previous)
                  for previous in (dataclasses.replace(first, history=history), first))
    assert all(np.isfinite(then[field]).all() for field in (*FIELDS, FINAL))
    apart = full(then[f"material/{name}"]) != full(want[f"material/{name}"])
    assert apart.reshape(-1, *SHAPE).any(axis=0).sum() <= 8  # what reads the texel


def test_a_grid_of_another_size_is_looked_up_all_the_same() -> None:
    first = run_frame(HALL, how())
    finer = replace(how(), grid=dataclasses.replace(GRID, width=20, depth=11))
    then = run_frame(HALL, finer, frame=1, previous=first)
    assert then["material/valid"].min() == 1.0
    assert np.isfinite(then[FINAL]).all()


def test_another_filters_history_is_none() -> None:
    before = run_frame(HALL, how(filter="scattering"))
    then, fresh = (run_frame(HALL, how(), frame=1, previous=previous) for previous in (before, None))
    np.testing.assert_array_equal(then[FINAL], fresh[FINAL])


# --- the checkerboard -------------------------------------------------------------------------------


def test_a_checkerboard_at_rest_is_the_whole_after_two_frames() -> None:
    settings = replace(how(alpha=1.0), checkerboard=True, jitter="off")  # what neighbours filled lasts one frame
    first, then = frames(HALL, settings, 2)
    plain = run_frame(HALL, Settings(grid=GRID, shadows="exact"))
    np.testing.assert_array_equal(full(then["material/extinction"]), full(plain["media/extinction"]))
    np.testing.assert_array_equal(then["temporal/in_scattering"], plain["lighting/in_scattering"])
    np.testing.assert_array_equal(then[FINAL], plain[FINAL])
    assert first["lighting/in_scattering"].shape == (3, 4, 7, 12)
    assert first["material/scattering"].shape == (3, 8, 7, 12)
    assert 0.0 < np.abs(first[FINAL] - plain[FINAL]).max() < 0.5 * plain[FINAL].max()


def test_a_checkerboards_froxels_are_averaged_where_they_are_computed() -> None:
    """Holes keep the history of material; light of all froxels is of this frame or the one before."""
    settings = replace(how(alpha=0.25), checkerboard=True)
    first, second, third = frames(HALL, settings, 3)
    some = computed(SHAPE, 2)
    for name in ("extinction", "sun_visibility", "scattering"):
        kept, new = (full(frame[f"material/{name}"]) for frame in (second, third))
        np.testing.assert_array_equal(new[..., ~some], kept[..., ~some])
    froxels = make_froxels(HALL.camera, GRID, jitter=froxel_jitter(2, hold=2))
    now = lit_below_a_slab(froxel_points(froxels), SUN.direction)
    want = 0.25 * now + 0.75 * second["material/sun_visibility"]
    np.testing.assert_allclose(third["material/sun_visibility"][some], want[some], rtol=1e-13, atol=1e-15)
    np.testing.assert_array_equal(third["temporal/extinction"], third["material/extinction"])
    np.testing.assert_array_equal(third["temporal/in_scattering"][:, ~some], second["temporal/in_scattering"][:, ~some])
    assert not np.array_equal(third["temporal/in_scattering"][:, some], second["temporal/in_scattering"][:, some])
    assert np.isfinite(first[FINAL]).all()


def test_under_a_checkerboard_a_lamp_that_goes_out_is_gone_after_two_frames() -> None:
    settings = replace(how(), checkerboard=True)
    lit = dataclasses.replace(HALL, surfaces=(), local_media=())
    dark = dataclasses.replace(lit, lights=(SUN,))
    before = frames(lit, settings, 4)[-1]
    sums = []
    want = run_frame(dark, settings)["lighting/in_scattering"].sum() * 2  # all froxels of a slice pair
    for n in (4, 5):
        before = run_frame(dark, settings, frame=n, previous=before)
        sums.append(float(before["temporal/in_scattering"].sum()))
    assert sums[0] > 1.05 * want
    np.testing.assert_allclose(sums[1], want, rtol=1e-6)


def test_lighting_asks_nobody_for_a_visibility_that_it_is_given() -> None:
    froxels = make_froxels(HALL.camera, GRID)
    buffer = voxelise(FOGGY, froxels, {}, Settings())

    def asked(points: object, normal: object = None) -> np.ndarray:
        raise AssertionError

    share = np.linspace(0.0, 1.0, 8).reshape(8, 1, 1)
    lit = in_scattering(buffer, [SUN], froxels)
    for visibility in ({}, {0: asked}):
        part = in_scattering(buffer, [SUN], froxels, visibility=visibility, known_visibility={0: share}, block_size=50)
        np.testing.assert_allclose(part, lit * share, rtol=1e-15)


# --- what a frame may leave out ---------------------------------------------------------------------


@pytest.mark.parametrize("size", [(7, 4, 5), (2, 2, 2), (1, 6, 3), (9, 1, 4), (3, 2, 1)])
def test_a_checkerboard_of_any_size(size: tuple[int, int, int]) -> None:
    grid = Grid(width=size[0], height=size[1], depth=size[2], near=0.5, far=16.0)
    plain = Settings(grid=grid, shadows="exact")
    then = frames(HALL, replace(how(alpha=1.0), checkerboard=True, jitter="off", grid=grid), 2)[-1]
    np.testing.assert_array_equal(then[FINAL], run_frame(HALL, plain)[FINAL])


def test_float32_stays() -> None:
    settings = replace(how(clamp="deviation", alpha_most=0.5), checkerboard=True, precision="float32")
    frame = frames(HALL, settings, 2)[-1]
    assert {frame[name].dtype.name for name in (*FIELDS, "temporal/in_scattering", FINAL)} == {"float32", "int64"}
    wide = frames(HALL, replace(settings, precision="float64"), 2)[-1]
    np.testing.assert_allclose(frame[FINAL], wide[FINAL], rtol=1e-3, atol=1e-6)


@pytest.mark.parametrize("checkerboard", [False, True])
@pytest.mark.parametrize("mixing", ["weighted", "mean", "mixture"])
@pytest.mark.parametrize("shadows", ["off", "exact", "maps"])
def test_planned_is_forced_over_time(checkerboard: bool, mixing: str, shadows: str) -> None:
    settings = replace(how(), checkerboard=checkerboard, phase_mixing=mixing, shadows=shadows)
    planned, forced = (frames(HALL, settings, 3, force_all=force)[-1] for force in (False, True))
    np.testing.assert_array_equal(np.broadcast_to(planned[FINAL], forced[FINAL].shape), forced[FINAL])
    for threads in (1, 3):
        np.testing.assert_array_equal(frames(HALL, settings, 3, threads=threads)[-1][FINAL], planned[FINAL])


@pytest.mark.parametrize("scene", [
    HALL, FOGGY, dataclasses.replace(FOGGY, surfaces=()), dataclasses.replace(HALL, lights=(LAMP,)),
    dataclasses.replace(HALL, lights=()), Scene(camera=Camera(width=24, height=14), lights=(SUN,)),
], ids=["hall", "fog", "fog alone", "no sun", "no light", "no medium"])
def test_planned_is_forced_as_a_camera_moves(scene: Scene) -> None:
    """Fields that keep no axes beside those that carry all of them."""
    settings = replace(how(clamp="range", alpha_most=0.5), shadows="maps", volumetric_shadows="maps")
    before: list[Frame | None] = [None, None]
    for n in range(3):
        camera = Camera(width=24, height=14, position=(0.1 * n, 1.7, 0.0), target=(0.2 * n, 1.7, -1.0))
        now = dataclasses.replace(scene, camera=camera)
        before = [run_frame(now, settings, frame=n, previous=before[k], force_all=bool(k)) for k in (0, 1)]
    planned, forced = before
    assert planned is not None
    assert forced is not None
    np.testing.assert_array_equal(np.broadcast_to(planned[FINAL], forced[FINAL].shape), forced[FINAL])


def test_plans_say_what_is_filtered() -> None:
    off, on = plan(HALL, Settings(grid=GRID)), plan(HALL, replace(how(clamp="range"), checkerboard=True))
    assert (off["material"].runs, off["material"].why) == (False, "no temporal filter of media")
    assert (on["material"].runs, on["temporal"].why) == (True, "checkerboard")
    assert {part.name: part.runs for part in on["material"].parts} == {
        "average": True, "sun's visibility": True, "holes": True, "clamp": True, "variable weight": False}
    assert {part.name: part.runs for part in on["temporal"].parts} == {
        "average": False, "holes": True, "clamp": False, "variable weight": False}
    assert not plan(HALL, how())["temporal"].runs
    assert plan(Scene(), how())["material"].runs  # media of the frame before may be remembered
    assert plan(dataclasses.replace(HALL, lights=()), how())["material"].runs
    for force in (False, True):  # forced, but not to what was switched off
        assert not any(run_frame(HALL, Settings(grid=GRID), force_all=force)[name].size for name in FIELDS)


def test_its_memory_is_counted() -> None:
    with_filter, without = (estimate_bytes(HALL, replace(how(filter=word), shadows="off")) for word in ("media", "off"))
    assert with_filter - without == 8 * (8 * 7 * 12 * (3 + 1 + 3 + 1 + 1 + 1) + 1)


def test_golden_sets_hold_it(tmp_path: Path) -> None:
    settings = replace(how(), checkerboard=True, phase_mixing="mixture")
    frame = frames(HALL, settings, 2)[-1]
    made = write_golden(frame, Loaded(HALL, settings, None), tmp_path / "set")
    shapes = {entry["name"]: entry["shape"] for entry in made.manifest["arrays"] if entry["name"] in FIELDS}
    assert shapes == {
        "material/scattering": [8, 7, 12, 3], "material/extinction": [8, 7, 12], "material/emission": [8, 7, 12, 3],
        "material/phase_anisotropy": [8, 7, 12], "material/lobe_scattering": [2, 8, 7, 12, 3],
        "material/lobe_anisotropy": [2], "material/sun_light": [1], "material/sun_visibility": [8, 7, 12],
        "material/guessed": [8, 7, 12], "material/valid": [8, 7, 12]}


def test_merged_stages_have_nothing_to_filter() -> None:
    with pytest.raises(InputError, match=r"^merged: is on with the temporal filter 'media', must be off"):
        replace(how(), merged=True)
