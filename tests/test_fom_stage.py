"""The fom stage in frames: against ways to the light, plans and tiles, departures, extremes."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest

from froxel_ref import scene_files
from froxel_ref.assets import load_assets
from froxel_ref.cli import main
from froxel_ref.fom_plan import assigned_tiles, dimmed_lamps, dimmed_suns, map_bytes
from froxel_ref.fom_stage import LAMPS, SUNS, exact_sights, map_sights, opacity_maps
from froxel_ref.frame import FINAL, QUANTITIES, Frame, plan, run_frame
from froxel_ref.grid import froxel_points, make_froxels
from froxel_ref.records import InputError
from froxel_ref.scene import (
    Camera,
    DensityTexture,
    DirectionalLight,
    HeightFog,
    LocalMedium,
    Medium,
    NoiseDensity,
    Plane,
    PointLight,
    Scene,
    Sphere,
    SpotLight,
    Transform,
)
from froxel_ref.settings import Grid, OpacityMaps, Settings, ShadowMaps, replace
from froxel_ref.truth import trace

WHITE = (1.0, 1.0, 1.0)
CAMERA = Camera(position=(0, 1.5, 5), target=(0, 1, 0), width=32, height=18)
GRID = Grid(width=16, height=9, depth=16, near=0.5, far=16.0)
FOG = Medium(extinction=0.1, height_fog=HeightFog(start=0.5, falloff=0.3))
BALL = LocalMedium(extinction=1.5, shape="ellipsoid", transform=Transform(translate=(0, 1, 0), scale=(1.2, 0.9, 1.0)))
NOISE = DensityTexture(source=NoiseDensity(size=8, cells=2))
MIST = LocalMedium(extinction=2.0, density=NOISE, transform=Transform(translate=(-1.5, 1, -2), rotate=(0, 30, 0)))
SUN = DirectionalLight(name="sun", direction=(0.5, 1.0, 0.3), irradiance=WHITE)
LAMP = PointLight(name="lamp", position=(2.0, 2.5, 0.5), intensity=(9.0, 8.0, 7.0), radius=8)
SPOT = SpotLight(name="spot", position=(-2.0, 3.5, 2.0), direction=(1, -1, -1), intensity=(9.0, 9.0, 9.0), radius=9,
                 inner_angle=20, outer_angle=35)
MAPS = OpacityMaps(small=32, large=64, smallest=16, atlas=256, directional_size=64)
HOW = Settings(grid=GRID, volumetric_shadows="maps", opacity_maps=MAPS,
               shadow_maps=ShadowMaps(directional_size=64, spot_size=32, point_size=32))
SCENE = Scene(camera=CAMERA, global_media=(FOG,), local_media=(BALL, MIST), lights=(SUN, LAMP, SPOT),
              surfaces=(Plane(), Sphere(center=(1.2, 0.4, 1.0), radius=0.4)))


def framed(scene: Scene = SCENE, how: Settings = HOW, **options: object) -> Frame:
    return run_frame(scene, how, **options)


def sights_of(scene: Scene, how: Settings, *, exact: bool = False) -> dict:
    assets = load_assets(scene, None)
    if exact:
        return dict(exact_sights(scene, how, assets))
    return dict(map_sights(opacity_maps(scene, how, assets, dtype=how.precision), scene, how))


def errors(scene: Scene, how: Settings) -> dict[int, np.ndarray]:
    """Differences from ways to the light, of froxels that each light reaches."""
    points = froxel_points(make_froxels(scene.camera, how.grid))
    got, want = sights_of(scene, how), sights_of(scene, how, exact=True)
    assert got.keys() == want.keys()
    result = {}
    for number, see in want.items():
        light, exact = scene.all_lights[number], see(points)
        reached = np.ones(exact.shape, bool)
        if isinstance(light, PointLight):
            away = np.stack([np.broadcast_to(p - c, exact.shape) for p, c in zip(points, light.position, strict=True)])
            distance = np.sqrt((away * away).sum(axis=0))
            reached = distance < light.radius
            if isinstance(light, SpotLight):
                axis = np.array(light.direction) / np.linalg.norm(light.direction)
                reached &= np.tensordot(axis, away, 1) > np.cos(np.radians(light.outer_angle)) * distance
        result[number] = (np.broadcast_to(got[number](points), exact.shape) - exact)[reached]
        assert result[number].size > 100
    return result


# --- against the exact way --------------------------------------------------------------------------


def test_media_that_fill_the_range_are_exact_whatever_the_map() -> None:
    """Uniform fog: one coefficient, no interpolation error; K = 0 as well."""
    scene = dataclasses.replace(SCENE, local_media=(), global_media=(Medium(extinction=0.2),))
    for harmonics in (0, 3):
        how = replace(HOW, opacity_maps=dataclasses.replace(MAPS, harmonics=harmonics))
        for error in errors(scene, how).values():
            assert np.abs(error).max() < 1e-14


def test_errors_fall_with_harmonics_and_texels() -> None:
    """Mean absolute error; measured 2.3e-2 to 5e-3 for the coarse one, and less than half of it for the fine one."""
    few = errors(SCENE, HOW)
    many = errors(SCENE, replace(HOW, opacity_maps=OpacityMaps(harmonics=12, small=256, large=256)))
    for number in few:
        coarse, fine = (float(np.abs(e[number]).mean()) for e in (few, many))
        assert coarse < 0.04, number
        assert fine < 0.5 * coarse, number
        assert fine < 0.008, number


def test_a_frame_by_maps_tends_to_the_frame_by_exact_ways() -> None:
    exact = framed(how=replace(HOW, volumetric_shadows="exact"))[FINAL]
    off = framed(how=replace(HOW, volumetric_shadows="off"))[FINAL]
    maps, fine = (framed(how=replace(HOW, opacity_maps=m))[FINAL] for m in (
        MAPS, OpacityMaps(harmonics=12, small=256, large=256)))
    sizes = [float(np.abs(frame - exact).mean() / exact.mean()) for frame in (off, maps, fine)]
    assert sizes[0] > 0.1
    assert sizes[1] < 0.15 * sizes[0]
    assert sizes[2] < 0.05 * sizes[0]


def test_frames_by_exact_ways_are_the_truths_shadows() -> None:
    """One ray through the scene: light scattered at froxels against the truth's own integral, lamps only, for
    global media do not dim a sun's map."""
    scene = dataclasses.replace(SCENE, lights=(LAMP, SPOT), surfaces=(), local_media=(BALL,))
    how = replace(HOW, volumetric_shadows="exact", shadows="off", integrate_from="near",
                  grid=dataclasses.replace(GRID, width=4, height=3, depth=512))
    frame = framed(scene, how, outputs=["integrate/radiance"])
    froxels = make_froxels(scene.camera, how.grid)
    way = np.stack([np.broadcast_to(c, (3, 4)) for c in froxels.rays.per_depth]).reshape(3, -1)
    origin = np.broadcast_to(np.reshape(scene.camera.position, (3, 1)), way.shape)
    length = np.sqrt((way * way).sum(axis=0))
    truth = trace(scene, origin, way / length, 16.0 * length, starts=0.5 * length, settings=how,
                  volumetric_shadows=True, rtol=1e-6)
    got = frame["integrate/radiance"][:, -1].reshape(3, -1)
    np.testing.assert_allclose(got, truth.radiance, rtol=4e-3)  # 512 slices; edges of media are of order 1


# --- plans ------------------------------------------------------------------------------------------


def test_switched_off_they_are_left_out_and_it_is_said() -> None:
    how = replace(HOW, volumetric_shadows="off")
    made = plan(SCENE, how)
    assert (made["fom"].runs, made["fom"].why) == (False, "volumetric shadows are off")
    part = next(part for part in made["lighting"].parts if part.name == "volumetric shadows")
    assert (part.runs, part.why) == (False, "volumetric shadows are off")
    assert "fom" not in framed(how=how).timings
    assert map_bytes(SCENE, how) == 0


@pytest.mark.parametrize(("scene", "why"), [
    (dataclasses.replace(SCENE, global_media=(), local_media=()), "nothing that dims light"),
    (dataclasses.replace(SCENE, global_media=(Medium(extinction=0.0, emissive=WHITE),), local_media=()),
     "nothing that dims light"),
    (dataclasses.replace(SCENE, lights=(SUN,), local_media=()), "no light that casts shadows is dimmed"),
    (dataclasses.replace(SCENE, lights=(dataclasses.replace(LAMP, casts_shadows=False),)),
     "no light that casts shadows is dimmed"),
    (dataclasses.replace(SCENE, lights=(dataclasses.replace(LAMP, intensity=(0, 0, 0)),)),
     "no light that casts shadows is dimmed"),
    (dataclasses.replace(SCENE, global_media=(), lights=(dataclasses.replace(LAMP, position=(90, 0, 0)),)),
     "no light that casts shadows is dimmed"),
])
def test_what_a_scene_does_not_need_is_left_out(scene: Scene, why: str) -> None:
    made = plan(scene, HOW)["fom"]
    assert not made.runs
    assert why in made.why


def test_planned_equals_forced_bit_for_bit() -> None:
    resolved = replace(HOW, opacity_maps=dataclasses.replace(MAPS, reconstruction="resolved"))
    for how in (HOW, replace(HOW, volumetric_shadows="exact"), replace(HOW, fidelity="author"), resolved):
        planned, forced = (framed(how=how, force_all=force) for force in (False, True))
        for name in QUANTITIES:
            a, b = np.broadcast_arrays(planned[name], forced[name])
            assert a.tobytes() == b.tobytes(), name


@pytest.mark.parametrize("reconstruction", ["fourier", "resolved"])
def test_results_depend_neither_on_threads_nor_on_what_was_before(reconstruction: str) -> None:
    how = replace(HOW, opacity_maps=dataclasses.replace(MAPS, reconstruction=reconstruction))
    one, many = framed(how=how, threads=1), framed(how=how, threads=5)
    again = framed(how=how, previous=one)
    assert (one["fom/resolved"].size > 0) == (reconstruction == "resolved")
    assert sum(one[name].nbytes for name in (*LAMPS, *SUNS)) == map_bytes(SCENE, how)
    for name in QUANTITIES:
        assert one[name].tobytes() == many[name].tobytes() == again[name].tobytes()
    assert set(again.reused) >= {*LAMPS, *SUNS}


@pytest.mark.parametrize("word", ["off", "exact", "maps"])
@pytest.mark.parametrize("scene", [
    SCENE, Scene(camera=CAMERA), dataclasses.replace(SCENE, lights=(SUN,)), dataclasses.replace(SCENE, lights=(LAMP,)),
    dataclasses.replace(SCENE, lights=()), dataclasses.replace(SCENE, lights=tuple(
        dataclasses.replace(LAMP, position=(0.1 * i, 2.0, 0.0)) for i in range(20)))])
def test_resolved_maps_of_any_scene(scene: Scene, word: str) -> None:
    """Without lamps, without suns, without anything, with an atlas that is full."""
    how = replace(HOW, volumetric_shadows=word, opacity_maps=dataclasses.replace(MAPS, reconstruction="resolved"))
    frame = framed(scene, how)
    assert np.isfinite(frame[FINAL]).all()
    assert sum(frame[name].nbytes for name in (*LAMPS, *SUNS)) == map_bytes(scene, how)


@pytest.mark.parametrize("word", ["off", "exact"])
def test_what_is_switched_off_is_not_forced_on(word: str) -> None:
    frame = framed(how=replace(HOW, shadows=word, volumetric_shadows=word), force_all=True)
    assert frame["shadow/point_depth"].size == frame["fom/coefficients"].size == 0


@pytest.mark.parametrize("change", [
    {"local_media": (BALL,)}, {"global_media": (dataclasses.replace(FOG, extinction=0.2),)},
    {"lights": (SUN, dataclasses.replace(LAMP, position=(2.0, 2.6, 0.5)), SPOT)},
])
def test_what_has_changed_is_made_anew(change: dict) -> None:
    changed = dataclasses.replace(SCENE, **change)
    fresh, after = framed(changed), framed(changed, previous=framed())
    assert not set(LAMPS) & set(after.reused)
    for name in (*LAMPS, *SUNS, FINAL):
        assert fresh[name].tobytes() == after[name].tobytes()


def test_a_camera_that_moves_keeps_lamps_and_moves_cascades() -> None:
    moved = dataclasses.replace(SCENE, camera=dataclasses.replace(CAMERA, position=(0.1, 1.5, 5)))
    after = framed(moved, previous=framed())
    assert set(LAMPS) <= set(after.reused)
    assert not set(SUNS) & set(after.reused)
    assert framed(moved)[FINAL].tobytes() == after[FINAL].tobytes()


def test_media_in_another_order_change_only_roundings() -> None:
    turned = dataclasses.replace(SCENE, local_media=(MIST, BALL))
    a, b = (framed(scene) for scene in (SCENE, turned))
    for name in ("fom/coefficients", "fom/directional_coefficients"):
        np.testing.assert_allclose(a[name], b[name], atol=1e-13)


# --- the atlas --------------------------------------------------------------------------------------


def lamps(count: int) -> Scene:
    return dataclasses.replace(SCENE, lights=tuple(
        dataclasses.replace(LAMP, position=(0.1 * i, 2.0, 0.0)) for i in range(count)))


def test_lamps_are_given_tiles_by_their_extent_on_the_screen() -> None:
    far = dataclasses.replace(LAMP, position=(0, 2, -60))
    tiles = assigned_tiles(dataclasses.replace(SCENE, lights=(LAMP, far)), HOW)
    assert [wanted.tile.size for wanted in tiles.values()] == [64, 32]
    small = assigned_tiles(dataclasses.replace(SCENE, lights=(LAMP, far)), replace(HOW, fom_tiles="small"))
    assert [wanted.tile.size for wanted in small.values()] == [32, 32]


def test_a_full_atlas_gives_smaller_tiles_then_none_and_explain_says_so() -> None:
    how = replace(HOW, opacity_maps=dataclasses.replace(MAPS, atlas=128, smallest=32))
    given = [wanted.tile and wanted.tile.size for wanted in assigned_tiles(lamps(6), how).values()]
    assert given == [64, 64, 64, 64, None, None]
    odd = dataclasses.replace(lamps(7), lights=(*lamps(3).lights, dataclasses.replace(LAMP, position=(0, 2, -60)),
                                                *lamps(4).lights))
    given = [wanted.tile and wanted.tile.size for wanted in assigned_tiles(odd, how).values()]
    assert given == [64, 64, 64, 32, 32, 32, 32, None]
    parts = {part.name: part for part in plan(odd, how)["fom"].parts}
    assert parts["point and spot lights"].why == "tiles of the 128² atlas: 3 of 64², 4 of 32²"
    assert parts["lights[4]"].why == "32² instead of 64²: no more room"
    assert (parts["lights[7]"].runs, parts["lights[7]"].why) == (
        False, "fog and particles do not dim it: the atlas has no room for 32²")
    frame = framed(odd, how)
    assert frame["fom/light"].tolist() == list(range(7))
    assert frame["fom/coefficients"].shape == (8, 128, 128)
    whole = np.zeros((128, 128), int)
    for row, column, size in frame["fom/tile"].reshape(-1, 3).tolist():
        whole[row:row + size, column:column + size] += 1
    assert whole.max() == 1


def test_only_the_corner_of_the_atlas_that_holds_tiles_is_kept() -> None:
    frame = framed()
    assert frame["fom/tile"].reshape(-1, 3).tolist() == [[0, 0, 64], [0, 64, 64]]
    assert frame["fom/coefficients"].shape == (8, 64, 128)
    assert sum(frame[name].nbytes for name in (*LAMPS, *SUNS)) == map_bytes(SCENE, HOW)


# --- departures -------------------------------------------------------------------------------------


@pytest.mark.parametrize("fidelity", ["published", "author"])
def test_the_sources_forms_run_and_differ(fidelity: str) -> None:
    """How far single departures are off is told by their own tests."""
    right, other = sights_of(SCENE, HOW), sights_of(SCENE, replace(HOW, fidelity=fidelity))
    points = froxel_points(make_froxels(SCENE.camera, HOW.grid))
    for number, see in right.items():
        assert np.abs(other[number](points) - see(points)).max() > 0.02, number


def test_a_fixed_range_rings() -> None:
    """A8, and figure 3.17 against 3.21: 300 m of depth for media of 2 m."""
    scene = dataclasses.replace(SCENE, lights=(SUN,))
    bounded, fixed = (np.abs(errors(scene, replace(HOW, fom_range=word))[0]).mean() for word in ("bounded", "fixed"))
    assert fixed > 5 * bounded


def test_a_lamps_range_is_what_it_dims() -> None:
    """Without fog about it the ball alone counts; with the lamp's radius its coefficients are blunter."""
    scene = dataclasses.replace(SCENE, lights=(LAMP,), global_media=(), local_media=(BALL,))
    frame = framed(scene)
    near, far = frame["fom/range"][0, 0]
    assert 0.9 < near < 2.0
    assert 2.0 < far < 4.1
    assert framed(scene, replace(HOW, fom_range="radius"))["fom/range"].ravel().tolist() == [0.0, 8.0]
    errs = [np.abs(errors(scene, replace(HOW, fom_range=word))[0]).mean() for word in ("bounded", "radius")]
    assert errs[0] < errs[1]


def test_stored_in_float16_as_the_thesis_stores_it() -> None:
    full, half = framed(), framed(how=replace(HOW, opacity_maps=dataclasses.replace(MAPS, storage="float16")))
    for name in ("fom/coefficients", "fom/directional_coefficients"):
        assert np.array_equal(half[name], full[name].astype(np.float16))
        assert not np.array_equal(half[name], full[name])


# --- extremes ---------------------------------------------------------------------------------------


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("precision", ["float64", "float32"])
@pytest.mark.parametrize("storage", ["full", "float16"])
@pytest.mark.parametrize(("harmonics", "reconstruction"),
                         [(0, "fourier"), (1, "lanczos"), (3, "fourier"), (3, "resolved"), (8, "resolved")])
@pytest.mark.parametrize("extinction", [1e-30, 1e5, 1e8, 1e12])
def test_extremes_are_finite_and_between_0_and_1(extinction: float, harmonics: int, reconstruction: str, storage: str,
                                                 precision: str) -> None:
    """Dense media about the lights, whatever the departures."""
    dense = tuple(dataclasses.replace(medium, extinction=extinction) for medium in (BALL, MIST))
    inside = dataclasses.replace(LAMP, position=(0.1, 1.0, 0.0))
    scene = dataclasses.replace(SCENE, local_media=dense, lights=(SUN, inside, SPOT),
                                global_media=(dataclasses.replace(FOG, extinction=extinction),))
    for fidelity in ("corrected", "published", "author"):
        how = replace(HOW, fidelity=fidelity, precision=precision,
                      opacity_maps=dataclasses.replace(MAPS, harmonics=harmonics, storage=storage,
                                                       reconstruction=reconstruction))
        points = froxel_points(make_froxels(scene.camera, how.grid, dtype=np.dtype(precision)))
        for number, see in sights_of(scene, how).items():
            passed = see(points)
            assert passed.dtype == precision
            assert np.isfinite(passed).all(), number
            assert passed.min() >= 0.0
            assert passed.max() <= 1.0
        assert np.isfinite(framed(scene, how)[FINAL]).all()


def test_what_a_dense_medium_hides_is_dark() -> None:
    """A lamp inside a medium of extinction 1e8: with the range bounded to it, nothing outside is lit."""
    scene = dataclasses.replace(SCENE, global_media=(), local_media=(dataclasses.replace(BALL, extinction=1e8),),
                                lights=(dataclasses.replace(LAMP, position=(0, 1, 0)),))
    for storage in ("full", "float16"):
        see = sights_of(scene, replace(HOW, opacity_maps=dataclasses.replace(MAPS, storage=storage)))[0]
        assert float(see(tuple(np.array([c]) for c in (3.0, 1.0, 0.0)))[0]) == 0.0


def test_rgb_extinction_is_refused_by_name() -> None:
    scene = dataclasses.replace(SCENE, local_media=(BALL, dataclasses.replace(MIST, extinction=(1, 2, 3))))
    with pytest.raises(InputError, match=r"^local_media\[1\]\.extinction: is RGB, must be one number for volumetric"):
        framed(scene)
    framed(scene, replace(HOW, volumetric_shadows="off"))
    framed(dataclasses.replace(scene, lights=()))


def test_rgb_extinction_is_refused_only_where_it_dims() -> None:
    """A global medium does not dim a sun, whatever it is; a lamp's light it does."""
    fog = dataclasses.replace(FOG, extinction=(0.01, 0.02, 0.03))
    sunny = dataclasses.replace(SCENE, lights=(SUN,), global_media=(fog,))
    for way in ("maps", "exact"):
        framed(sunny, replace(HOW, volumetric_shadows=way))
        with pytest.raises(InputError, match=r"^global_media\[0\]\.extinction: is RGB"):
            framed(dataclasses.replace(sunny, lights=(SUN, LAMP)), replace(HOW, volumetric_shadows=way))


@pytest.mark.parametrize(("field", "value", "words"), [
    ("small", 100, "must be a power of two"), ("large", 64, r"^small: is 128, must be at most large \(64\)"),
    ("atlas", 128, r"^large: is 256, must be at most atlas \(128\)"),
    ("smallest", 256, r"^smallest: is 256, must be at most small \(128\)"),
    ("harmonics", -1, "must be"), ("step", 0.0, "must be"), ("most_steps", 0, "must be"),
    ("storage", "float8", "must be|did you mean|is not"), ("gutter", 9, "must be"),
])
def test_bad_sizes_are_refused_by_name(field: str, value: object, words: str) -> None:
    with pytest.raises(InputError, match=words):
        OpacityMaps(**{field: value})


def test_the_hall_has_nine_tiles_and_four_cascades() -> None:
    loaded = scene_files.load("thesis-hall")
    made = plan(loaded.scene, replace(loaded.settings, volumetric_shadows="maps"))
    assert [part.why for part in made["fom"].parts] == ["Fourier series, 8 numbers a texel",
                                                    "tiles of the 2048² atlas: 9 of 256²", "4 cascades"]
    assert len(dimmed_lamps(loaded.scene, loaded.settings)) == 9
    assert len(dimmed_suns(loaded.scene)) == 1


@pytest.mark.parametrize("away", [3e3, 3e7, 9e9])
def test_what_is_far_towards_the_sun_dims_as_it_does_nearby(away: float) -> None:
    """A slab of optical depth ½ across the sun's way, by maps and by exact ways."""
    far = LocalMedium(extinction=0.5 / (0.2 * away), transform=Transform(
        translate=(0, away, 0), scale=(2 * away / 3, 0.1 * away, 2 * away / 3)))
    scene = Scene(lights=(SUN,), local_media=(far,), camera=SCENE.camera)
    below = tuple(np.array([c]) for c in (0.5, 1.0, 0.3))
    scene = dataclasses.replace(scene, lights=(DirectionalLight(direction=(0, 1, 0), irradiance=(1, 1, 1)),))
    assert sights_of(scene, HOW)[0](below)[0] == pytest.approx(np.exp(-0.5), abs=1e-9)
    assert exact_sights(scene, HOW, load_assets(scene, None))[0](below)[0] == pytest.approx(np.exp(-0.5), abs=1e-9)


def test_a_lamp_without_room_is_told_on_the_way(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    lights = [{"type": "point", "position": [x, 1, -4], "intensity": [5, 5, 5], "radius": 6} for x in range(6)]
    document = {"schema": 1, "scene": {"lights": lights, "global_media": [{"extinction": 0.1}]},
                "settings": {"volumetric_shadows": "maps", "opacity_maps": {"atlas": 256}}}
    scene = tmp_path / "many.json"
    scene.write_text(json.dumps(document))
    made = ["render", str(scene), "-o", str(tmp_path / "many.png"), "--size", "16x9", "--grid", "8x4x4"]
    assert main(made) == 0
    told = capsys.readouterr().err.splitlines()
    assert [line for line in told if "note" in line] == [
        f"froxel-ref: note: lights[{number}]: fog and particles do not dim it: the atlas has no room for 64²"
        for number in (1, 2, 3)] + ["froxel-ref: note: … and 2 more (see explain)"]
    assert main([*made, "--force", "--set", "settings.opacity_maps.atlas=2048"]) == 0
    assert "note" not in capsys.readouterr().err
