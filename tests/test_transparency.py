"""Transparent surfaces: closed forms, a scalar loop over pixels, order with particles, and what they leave alone."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path

import numpy as np
import pytest
import reference_particles as reference
from hypothesis import given
from hypothesis import strategies as st

from froxel_ref.assets import checksums, load_assets
from froxel_ref.frame import plan, run_frame, working_bytes
from froxel_ref.jobs import Job
from froxel_ref.overrides import override
from froxel_ref.quantities import FINAL, QUANTITIES
from froxel_ref.records import InputError, from_json, to_json
from froxel_ref.scene import (
    Box,
    Camera,
    DirectionalLight,
    Folds,
    HeightField,
    HeightsFile,
    ImageBuffers,
    Key,
    LocalMedium,
    Medium,
    Mesh,
    Particle,
    ParticleCloud,
    Plane,
    PointLight,
    Scene,
    Sphere,
    SpotLight,
    Track,
    Transform,
    TransparentSurface,
)
from froxel_ref.scene_files import Document, document
from froxel_ref.sequence import moment, run_sequence
from froxel_ref.settings import (
    AntiAliasing,
    FogLookup,
    Grid,
    LongRange,
    OpacityMaps,
    Settings,
    ShadowMaps,
    Temporal,
    replace,
)
from froxel_ref.transparency import Pane, sorted_panes
from froxel_ref.transparency_stage import drawn_layers

EPS = float(np.finfo(np.float64).eps)
CAMERA = Camera(position=(0, 0, 0), target=(0, 0, -1), vertical_fov=60, width=12, height=8)
# Slices end at 1, 2, 3, … m; one froxel for each pixel, so that a lookup at a boundary is what is stored there.
GRID = Grid(width=12, height=8, depth=8, near=1.0, far=9.0, distribution="linear")
HOW = Settings(grid=GRID)
FOG = Medium(albedo=(0.9, 0.6, 0.3), extinction=0.25)
AMBIENT = (0.5, 1.0, 2.0)
WHITE = (1.0, 1.0, 1.0)
SUN = DirectionalLight(direction=(0, 0, 1), irradiance=(3.0, 2.0, 1.0))


def facing(depth: float, *, opacity: float = 0.3, albedo: tuple[float, float, float] = WHITE) -> TransparentSurface:
    """A pane across the camera's axis."""
    return TransparentSurface(surface=Plane(point=(0, 0, -depth), normal=(0, 0, 1), albedo=albedo), opacity=opacity)


def wall(depth: float, albedo: tuple[float, float, float] = (0.2, 0.4, 0.8)) -> Plane:
    return Plane(point=(0, 0, -depth), normal=(0, 0, 1), albedo=albedo)


def square(depth: float, *, opacity: float = 0.5, albedo: tuple[float, float, float] = WHITE) -> Particle:
    """A particle that covers the whole image, at one view depth all over."""
    return Particle(position=(0, 0, -depth), size=50, opacity=opacity, albedo=albedo, profile="square")


def glass(*panes: TransparentSurface, **more: object) -> Scene:
    return Scene(**{"camera": CAMERA, "ambient": WHITE, "transparent_surfaces": panes} | more)  # type: ignore[arg-type]


def colour(values: tuple[float, float, float]) -> np.ndarray:
    return np.reshape(values, (3, 1, 1))


def ray_lengths() -> np.ndarray:
    """Metres along each pixel's ray per metre of view depth."""
    tall = math.tan(math.radians(30))
    x = (2 * (np.arange(12) + 0.5) / 12 - 1) * tall * 12 / 8
    y = (2 * (np.arange(8) + 0.5) / 8 - 1) * tall
    return np.sqrt(1 + x**2 + y[:, np.newaxis] ** 2)


# --- closed forms -----------------------------------------------------------------------------------


@pytest.mark.parametrize("opacity", [0.0, 0.3, 1.0])
def test_a_pane_in_uniform_fog_before_a_wall(opacity: float) -> None:
    """With the ray t: T = e^(−σt); F = albedo·(A + E/4π)·(1 − T); surfaces send albedo·(A + E/π), the sun behind us."""
    pane = (0.7, 0.5, 0.1)
    scene = glass(facing(4.0, opacity=opacity, albedo=pane), ambient=AMBIENT, surfaces=(wall(7.0),), lights=(SUN,),
                  global_media=(FOG,))
    got = run_frame(scene, replace(HOW, shadows="exact"))[FINAL]
    light = colour(AMBIENT) + colour(SUN.irradiance) / math.pi
    source = colour(FOG.albedo) * (colour(AMBIENT) + colour(SUN.irradiance) / (4 * math.pi))

    def seen(albedo: tuple[float, float, float], depth: float) -> np.ndarray:
        passed = np.exp(-0.25 * depth * ray_lengths())
        return colour(albedo) * light * passed + source * (1 - passed)

    want = opacity * seen(pane, 4.0) + (1 - opacity) * seen((0.2, 0.4, 0.8), 7.0)
    # Seven slices of some roundings each, a fetch and the exponential; measured: 4e-16.
    np.testing.assert_allclose(got, want, rtol=30 * EPS)


@pytest.mark.parametrize("march", [False, True])
def test_beyond_the_froxels_it_has_the_fog_of_their_far_end(march: bool) -> None:
    scene = glass(facing(40.0), ambient=AMBIENT, global_media=(FOG,))
    got = run_frame(scene, replace(HOW, long_range=LongRange(march=march)))
    passed = np.exp(-0.25 * 9.0 * ray_lengths())
    want = 0.3 * (colour(AMBIENT) * passed + colour(FOG.albedo) * colour(AMBIENT) * (1 - passed))
    np.testing.assert_allclose(got["particles/radiance"], want, rtol=30 * EPS)
    assert np.all(got["particles/transmittance"] == 0.7)


def test_as_the_author_all_of_the_first_slice_lies_before_it() -> None:
    """A11: where in the first slice it is makes no difference then; as corrected it does."""
    for fidelity, same in (("author", True), ("corrected", False)):
        how = replace(HOW, fidelity=fidelity, grid=dataclasses.replace(GRID, near=0.5))
        near, far = (run_frame(glass(facing(depth, opacity=1), global_media=(FOG,)), how)[FINAL]
                     for depth in (0.6, 0.8))
        assert np.array_equal(near, far) == same
        assert np.isfinite(near).all()
        assert near.min() > 0


def test_a_pane_of_opacity_0_changes_no_bit() -> None:
    """Nor do the particles before and behind it come in layers of their own, whose roundings would differ."""
    puffs = tuple(square(depth, opacity=0.3, albedo=(0.7, 0.6, 0.1)) for depth in (2.0, 2.5, 3.1, 5.0, 6.0))
    bare = glass(surfaces=(wall(7.0),), global_media=(FOG,), particles=puffs)
    frames = [run_frame(dataclasses.replace(bare, transparent_surfaces=panes), HOW)
              for panes in ((), (facing(4.0, opacity=0),))]
    for name in QUANTITIES:
        assert frames[0][name].tobytes() == frames[1][name].tobytes(), name
    assert not plan(glass(facing(4.0, opacity=0)), HOW)["particles"].runs


VARIED = Scene(
    camera=Camera(position=(0, 2, 4), target=(0, 1, -2), width=24, height=16), ambient=(0.1, 0.2, 0.1),
    global_media=(Medium(extinction=0.03, phase_anisotropy=0.3),), background=(0.2, 0.1, 0.4),
    local_media=(LocalMedium(shape="ellipsoid", extinction=0.8, transform=Transform(translate=(1, 1, -2))),),
    lights=(DirectionalLight(direction=(0.5, 1, 0.3), irradiance=(2, 2, 1)),
            PointLight(position=(-1, 3, -1), intensity=(5, 9, 5), radius=9),
            PointLight(position=(0.5, 1, 0), intensity=(1, 1, 1), radius=2),
            SpotLight(position=(2, 4, 1), direction=(-0.5, -1, -0.5), intensity=(9, 5, 5))),
    surfaces=(Box(transform=Transform(translate=(-1, 0.8, -3), scale=(0.6, 0.8, 0.6))), Plane(albedo=(0.6, 0.5, 0.3))),
    particles=(ParticleCloud(count=12, seed=3, low=(-2, 0, -4), high=(2, 2, 1)),))
MAPS = Settings(
    grid=Grid(width=12, height=8, depth=12, near=0.5, far=20.0), volumetric_shadows="maps",
    shadow_maps=ShadowMaps(cascades=2, directional_size=256, spot_size=64, point_size=64),
    opacity_maps=OpacityMaps(small=32, large=32, smallest=32, directional_size=64))
PANES = tuple(TransparentSurface(surface=each, opacity=opacity) for each, opacity in (
    (Sphere(center=(0.5, 1, -1), radius=0.9, albedo=(0.9, 0.3, 0.3)), 0.4),
    (Box(transform=Transform(translate=(0, 1, 0), rotate=(0, 40, 0), scale=(2, 1, 0.05))), 0.25),
    (Plane(point=(0, 0.5, 0), normal=(0.1, 1, 0), albedo=(0.2, 0.4, 0.9)), 0.6),
    (HeightField(heights=Folds(folds=2, size=9), transform=Transform(translate=(-1, 1, -1), scale=(1, 1, 0.3))), 0.5)))


@pytest.mark.parametrize("changes", [
    {}, {"shadows": "exact", "volumetric_shadows": "exact"}, {"fidelity": "author"}, {"exposure": "lighting"},
    {"taa": AntiAliasing(on=True)}, {"fog_lookup": FogLookup(method="noisy", bias=1.5, stored="tone_mapped")}],
    ids=lambda changes: " ".join(changes) or "plain")
@pytest.mark.parametrize("which", range(len(PANES)))
def test_one_of_opacity_1_is_the_opaque_surface(which: int, changes: dict[str, object]) -> None:
    """With particles before, behind and through it, and other surfaces that shade it; it casts no shadow itself."""
    bare = dataclasses.replace(VARIED, camera=dataclasses.replace(VARIED.camera, exposure=3.0))
    shape = dataclasses.replace(PANES[which].surface, casts_shadows=False)
    opaque = dataclasses.replace(bare, surfaces=(shape, *VARIED.surfaces))
    clear = dataclasses.replace(bare, transparent_surfaces=(TransparentSurface(surface=shape, opacity=1.0),))
    how = replace(MAPS, **changes)
    a, b = (run_frame(scene, how, frame=3)["apply/radiance"] for scene in (opaque, clear))
    np.testing.assert_array_equal(b, a)  # α·(L·T + F) with α = 1, and what lies behind times 0
    assert np.abs(run_frame(bare, how, frame=3)["apply/radiance"] - a).max() > 0.01


# --- order ------------------------------------------------------------------------------------------


def over(*layers: tuple[float, tuple[float, float, float]]) -> list[float]:
    """White light behind layers (opacity, colour), the farthest first."""
    light = [1.0, 1.0, 1.0]
    for opacity, tint in layers:
        light = [below * (1 - opacity) + opacity * own for below, own in zip(light, tint, strict=True)]
    return light


RED, GREEN, BLUE = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)


@pytest.mark.parametrize("flip", [False, True])
def test_particles_before_and_behind_a_pane(flip: bool) -> None:
    puffs = (square(2.0, opacity=0.5, albedo=RED), square(6.0, opacity=0.25, albedo=BLUE))
    scene = glass(facing(4.0, opacity=0.375, albedo=GREEN), particles=puffs[::-1] if flip else puffs, background=WHITE)
    got = run_frame(scene, HOW)
    want = over((0.25, BLUE), (0.375, GREEN), (0.5, RED))
    np.testing.assert_array_equal(got[FINAL], np.broadcast_to(colour(tuple(want)), (3, 8, 12)))  # binary fractions
    assert np.all(got["particles/transmittance"] == 0.75 * 0.625 * 0.5)


@pytest.mark.parametrize("flip", [False, True])
def test_the_nearer_of_two_panes_lies_over_the_farther(flip: bool) -> None:
    panes = (facing(2.0, opacity=0.5, albedo=RED), facing(6.0, opacity=0.25, albedo=BLUE))
    between = square(4.0, opacity=0.375, albedo=GREEN)
    got = run_frame(glass(*panes[::-1] if flip else panes, particles=(between,), background=WHITE), HOW)[FINAL]
    want = over((0.25, BLUE), (0.375, GREEN), (0.5, RED))
    np.testing.assert_array_equal(got, np.broadcast_to(colour(tuple(want)), (3, 8, 12)))


def test_of_two_equally_near_the_first_lies_on_top() -> None:
    got = run_frame(glass(facing(4.0, opacity=0.5, albedo=RED), facing(4.0, opacity=0.25, albedo=BLUE)), HOW)[FINAL]
    assert got[:, 0, 0].tolist() == [0.5, 0.0, 0.125]


def test_a_particle_as_near_as_a_pane_lies_behind_it() -> None:
    got = run_frame(glass(facing(4.0, opacity=0.5, albedo=RED), particles=(square(4.0, albedo=BLUE),)), HOW)[FINAL]
    assert got[:, 0, 0].tolist() == [0.5, 0.0, 0.25]  # as it does behind an opaque surface


def test_panes_that_cross_are_sorted_in_each_pixel() -> None:
    """Two planes that cross on the camera's axis: on the left one is nearer, on the right the other."""
    red, blue = (TransparentSurface(surface=Plane(point=(0, 0, -4), normal=(x, 0, 1), albedo=albedo), opacity=0.5)
                 for x, albedo in ((0.25, RED), (-0.25, BLUE)))
    got = run_frame(glass(red, blue), HOW)[FINAL]
    # x/4 + z + 4 = 0: z = −4 − x/4 is nearer on the left.
    assert {tuple(v) for v in got[:, :, :6].reshape(3, -1).T.tolist()} == {(0.5, 0.0, 0.25)}
    assert {tuple(v) for v in got[:, :, 6:].reshape(3, -1).T.tolist()} == {(0.25, 0.0, 0.5)}


def test_a_pane_cuts_a_particle() -> None:
    """The particle's depth is 4 m all over, the pane's from left to right across it."""
    slanted = TransparentSurface(surface=Plane(point=(0, 0, -4), normal=(1, 0, 1), albedo=RED), opacity=0.5)
    got = run_frame(glass(slanted, particles=(square(4.0, opacity=0.5, albedo=BLUE),)), HOW)[FINAL]
    hit = got[0] > 0  # on its far left the plane runs away from the rays
    left, right = np.where(hit[:, :6], got[2, :, :6], np.nan), got[2, :, 6:]
    assert {*left[~np.isnan(left)].tolist()} == {0.25}  # z = −4 − x: nearer on the left
    assert {*right[hit[:, 6:]].tolist()} == {0.5}


def scalar_hit(surface: Plane | Sphere, origin: tuple[float, ...], way: tuple[float, ...]) -> float:
    """View depth along a way whose view depth is 1; infinite where there is none."""
    if isinstance(surface, Plane):
        slope = reference.dot(surface.normal, way)
        t = reference.dot(surface.normal, reference.minus(surface.point, origin)) / slope if slope else math.inf
        return t if t > 0 else math.inf
    q = reference.minus(surface.center, origin)
    a, b, c = reference.dot(way, way), reference.dot(q, way), reference.dot(q, q) - surface.radius**2
    if b * b < a * c:
        return math.inf
    roots = [t for t in ((b - math.sqrt(b * b - a * c)) / a, (b + math.sqrt(b * b - a * c)) / a) if t > 0]
    return min(roots, default=math.inf)


def scalar_fog(depth: float) -> tuple[list[float], list[float]]:
    return [0.1 * depth, 0.2, 0.05 * depth**2], [math.exp(-s * depth) for s in (0.1, 0.2, 0.3)]


def field_fog(rows: np.ndarray, columns: np.ndarray, depth: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return (np.stack([0.1 * depth, np.full_like(depth, 0.2), 0.05 * depth**2]),
            np.exp(-np.reshape([0.1, 0.2, 0.3], (3, 1)) * depth))


@pytest.mark.parametrize("seed", range(4))
def test_against_a_scalar_loop_over_pixels(seed: int) -> None:
    """Each pixel's fragments: panes by depth, particles as wholes, each of them before or behind each pane."""
    rng = np.random.default_rng(seed)

    def tint() -> tuple[float, ...]:
        return tuple(rng.random(3).tolist())

    particles = tuple(Particle(position=tuple(rng.uniform((-3, -2, -8), (3, 2, -1)).tolist()), albedo=tint(),
                               size=float(rng.uniform(1, 4)), opacity=float(rng.random()), profile="square")
                      for _ in range(8))
    shapes = [Sphere(center=tuple(rng.uniform((-2, -2, -7), (2, 2, -2)).tolist()), radius=float(rng.uniform(1, 2)),
                     albedo=tint()) for _ in range(3)]
    shapes += [Plane(point=(0, 0, float(rng.uniform(-7, -2))), normal=(*rng.uniform(-0.5, 0.5, 2).tolist(), 1.0),
                     albedo=tint()) for _ in range(2)]
    panes = [TransparentSurface(surface=shape, opacity=float(rng.random())) for shape in shapes]
    scene = glass(*panes, ambient=AMBIENT, particles=particles)
    opaque = rng.uniform(4, 12, (8, 12))
    job = Job(scene, replace(HOW, shadows="off"), load_assets(scene, None))
    got = drawn_layers(job, {"surface/depth": opaque}, field_fog)
    tall, between = math.tan(math.radians(30)), 0
    for row in range(8):
        for column in range(12):
            way = ((2 * (column + 0.5) / 12 - 1) * tall * 1.5, (1 - 2 * (row + 0.5) / 8) * tall, -1.0)
            hits = [(scalar_hit(pane.surface, (0, 0, 0), way), pane) for pane in panes]
            sheets = sorted((hit for hit in hits if hit[0] < opaque[row, column]), key=lambda hit: hit[0])
            layers: list[list[tuple[float, float, tuple[float, ...]]]] = [[] for _ in range(len(sheets) + 1)]
            for puff in sorted(particles, key=lambda puff: puff.position[2]):
                met = reference.met(puff, {}, reference.unit(puff.position), (0, 0, 0), way)
                if met is not None and met[1] > 0 and met[0] < opaque[row, column]:
                    layers[sum(depth <= met[0] for depth, _ in sheets)].append((met[0], met[1], puff.albedo))
            ordered = list(layers[-1])
            for (depth, pane), before in zip(sheets[::-1], layers[-2::-1], strict=True):
                ordered += [(depth, pane.opacity, pane.surface.albedo), *before]
            between += any(layers[1:-1])
            light, passed = [0.0, 0.0, 0.0], 1.0
            for depth, opacity, albedo in ordered:
                glow, through = scalar_fog(depth)
                light = [(1 - opacity) * light[c] + opacity * (albedo[c] * AMBIENT[c] * through[c] + glow[c])
                         for c in range(3)]
                passed *= 1 - opacity
            # Some roundings of each of a dozen layers, and of their depths; measured: 1e-15.
            np.testing.assert_allclose(got["particles/radiance"][:, row, column], light, rtol=64 * EPS)
            assert got["particles/transmittance"][row, column] == pytest.approx(passed, rel=64 * EPS)
    assert between > 10


@given(depths=st.lists(st.lists(st.sampled_from([1.0, 2.0, 3.0, *[math.inf] * 3]), min_size=6, max_size=6), max_size=6))
def test_sorting_keeps_every_pixel_s_panes(depths: list[list[float]]) -> None:
    panes = []
    for i, depth in enumerate(depths):
        there = np.isfinite([depth])
        panes.append(Pane(np.array([depth]), np.where(there, i + 1.0, 0.0) * np.ones((3, 1, 1)),
                          np.where(there, 0.5, 1.0)))
    got = sorted_panes(panes)
    for x in range(6):
        want = sorted(((pane[x], i + 1.0) for i, pane in enumerate(depths) if pane[x] < math.inf))
        found = [(float(pane.depth[0, x]), float(pane.radiance[1, 0, x])) for pane in got]
        assert found == want + [(math.inf, 0.0)] * (len(got) - len(want))
        assert [float(pane.transmittance[0, x]) for pane in got] == [0.5] * len(want) + [1.0] * (len(got) - len(want))
    assert len(got) == max((sum(pane[x] < math.inf for pane in depths) for x in range(6)), default=0)


# --- what hides it, and what it leaves alone --------------------------------------------------------


def test_it_is_not_seen_behind_an_opaque_surface() -> None:
    bare = glass(surfaces=(wall(4.0),))
    want = run_frame(bare, HOW)[FINAL]
    for depth, seen in ((4.5, False), (4.0, False), (3.5, True)):
        got = run_frame(dataclasses.replace(bare, transparent_surfaces=(facing(depth),)), HOW)[FINAL]
        assert np.array_equal(got, want) != seen


def test_it_stands_before_image_buffers(tmp_path: Path) -> None:
    depth = np.full((8, 12), 4.0)
    depth[:, :6] = 2.0
    np.save(tmp_path / "depth.npy", depth)
    scene = glass(facing(3.0, opacity=0.5), image_buffers=ImageBuffers(depth="depth.npy"))
    got = run_frame(scene, HOW, assets=load_assets(scene, tmp_path))["particles/transmittance"]
    assert np.array_equal(got == 0.5, depth == 4.0)


def test_it_changes_nothing_but_the_image_over_it() -> None:
    """No depth, no shadow, no light anywhere else: all other results are those without, to the bit."""
    with_, without = (run_frame(dataclasses.replace(VARIED, transparent_surfaces=panes), MAPS)
                      for panes in (PANES, ()))
    for name in QUANTITIES:
        same = with_[name].tobytes() == without[name].tobytes()
        assert same != (name in ("particles/radiance", "particles/transmittance", FINAL)), name


def test_the_camera_may_stand_within_one() -> None:
    scene = glass(TransparentSurface(surface=Sphere(center=(0, 0, 0), radius=3), opacity=0.5))
    assert moment(scene, None, 0).camera == scene.camera
    assert np.all(run_frame(scene, HOW)["particles/transmittance"] == 0.5)
    with pytest.raises(InputError, match=r"camera.position: is within surfaces\[0\]"):
        moment(dataclasses.replace(scene, surfaces=(Sphere(center=(0, 0, 0), radius=3),)), None, 0)


# --- plans, threads, types --------------------------------------------------------------------------

WHOLE = dataclasses.replace(VARIED, transparent_surfaces=PANES)


@pytest.mark.parametrize("changes", [
    {}, {"fidelity": "author"}, {"fidelity": "published"}, {"precision": "float32"},
    {"fog_lookup": FogLookup(method="noisy", bias=1.5, stored="tone_mapped", storage="float16"),
     "taa": AntiAliasing(on=True), "long_range": LongRange(march=True)}], ids=str)
@pytest.mark.parametrize("scene", [
    WHOLE, dataclasses.replace(WHOLE, particles=(), global_media=(), local_media=()),
    dataclasses.replace(WHOLE, lights=(), surfaces=(), transparent_surfaces=PANES[:1])], ids=["all", "clear", "dim"])
def test_planned_equals_forced(scene: Scene, changes: dict[str, object]) -> None:
    how = replace(MAPS, **changes)
    planned, forced = (run_frame(scene, how, force_all=force_all) for force_all in (False, True))
    for name in QUANTITIES:
        if planned[name].size:
            a, b = np.broadcast_arrays(planned[name], forced[name])
            assert a.tobytes() == b.tobytes(), name
    if "precision" in changes:
        assert planned[FINAL].dtype == planned["particles/radiance"].dtype == np.float32


def test_threads_make_no_difference() -> None:
    one, three = (run_frame(WHOLE, MAPS, threads=threads)[FINAL] for threads in (1, 3))
    assert one.tobytes() == three.tobytes()


def test_exposure_in_the_lighting_is_the_same_on_display() -> None:
    scene = dataclasses.replace(WHOLE, camera=dataclasses.replace(WHOLE.camera, exposure=2.0))
    after, within = (run_frame(scene, replace(MAPS, exposure=where)) for where in ("display", "lighting"))
    np.testing.assert_array_equal(after[FINAL] * after.display_exposure, within[FINAL] * within.display_exposure)


def test_a_plan_says_what_lies_over_the_image() -> None:
    assert plan(Scene())["particles"].why == "the scene has no particles and no transparent surfaces"
    assert plan(glass(facing(1.0)))["particles"].why == "1 transparent surface"
    found = plan(WHOLE)
    assert found["particles"].why == "12 particles, 4 transparent surfaces"
    assert {part.name: part.why for part in found["apply"].parts}["particles"] == found["particles"].why
    assert {part.name for part in found["particles"].parts} == {"fog in front of them", "lights"}


def test_each_counts_for_the_memory() -> None:
    wide = dataclasses.replace(glass(), camera=Camera(width=4000, height=2000))
    four = dataclasses.replace(wide, transparent_surfaces=(facing(1.0),) * 4)
    assert working_bytes(four, HOW) - working_bytes(wide, HOW) == 4 * 9 * 8_000_000 * 8
    curtain = HeightField(heights=Folds(size=1025))
    hung = dataclasses.replace(wide, transparent_surfaces=(TransparentSurface(surface=curtain),))
    assert working_bytes(hung, HOW) - working_bytes(wide, HOW) == 9 * 8_000_000 * 8 + 64 * 1025**2
    many = dataclasses.replace(wide, transparent_surfaces=(facing(1.0),) * 100_000)
    with pytest.raises(InputError, match="GiB"):
        plan(many, HOW)


# --- scenes as data ---------------------------------------------------------------------------------


@pytest.mark.parametrize(("raw", "message"), [
    ([{"opacity": 0.5}], "transparent_surfaces[0].surface: is missing (its shape and albedo)"),
    ([{"surface": {"type": "plane"}, "opacity": 1.5}],
     "transparent_surfaces[0].opacity: is 1.5, must be at least 0 and at most 1"),
    ([{"surface": {"type": "plane"}, "opacity": -0.5}],
     "transparent_surfaces[0].opacity: is -0.5, must be at least 0 and at most 1"),
    ([{"surface": {"type": "plane"}}, {"surface": {"type": "cone"}}],
     "transparent_surfaces[1].surface.type: is 'cone'; known: box, height_field, mesh, plane, sphere"),
    ([{"surface": {"type": "sphere", "radius": 0}}], "transparent_surfaces[0].surface.radius: is 0, must be above 0 m"),
    ([{"type": "plane"}], "transparent_surfaces[0].type: is not a key here; known: opacity, surface"),
    ({"surface": {"type": "plane"}}, "transparent_surfaces: is {'surface': {'type': 'plane'}}, must be a list"),
])
def test_what_is_refused_is_named_in_one_line(raw: object, message: str) -> None:
    with pytest.raises(InputError) as caught:
        from_json(Scene, {"transparent_surfaces": raw})
    assert str(caught.value) == message


def test_a_scene_file_has_them() -> None:
    assert from_json(Scene, to_json(WHOLE)) == WHOLE
    changed = override(Document, document(WHOLE, MAPS), "scene.transparent_surfaces[1].opacity=0.75")
    changed = override(Document, changed, "scene.transparent_surfaces[0].surface.radius=2")
    made = from_json(Document, changed).scene.transparent_surfaces
    assert (made[0].surface.radius, made[1].opacity) == (2.0, 0.75)


def test_files_of_theirs_are_found_under_their_place(tmp_path: Path) -> None:
    np.save(tmp_path / "heights.npy", np.zeros((2, 3)))
    (tmp_path / "square.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", encoding="utf-8")
    heights, mesh = HeightsFile(path="heights.npy"), Mesh(path="square.obj")
    scene = glass(*(TransparentSurface(surface=each) for each in (HeightField(heights=heights), mesh)))
    assert list(checksums(scene, tmp_path)) == ["heights.npy", "square.obj"]
    pytest.importorskip("trimesh", reason="meshes need the extra 'mesh'")
    found = load_assets(scene, tmp_path)
    assert (set(found.heights), set(found.meshes)) == ({heights}, {mesh})
    for missing, place in ((HeightField(heights=HeightsFile(path="no.npy")), "surface.heights.path"),
                           (Mesh(path="no.obj"), "surface.path")):
        with pytest.raises(InputError) as caught:
            load_assets(glass(facing(1.0), TransparentSurface(surface=missing)), tmp_path)
        assert caught.value.place == f"transparent_surfaces[1].{place}"


def test_tracks_move_them() -> None:
    tracks = (Track(path="transparent_surfaces[0].opacity", keys=(Key(time=0, value=0), Key(time=1, value=1))),
              Track(path="transparent_surfaces[0].surface.point[2]",
                    keys=(Key(time=0, value=-2), Key(time=1, value=-6))))
    scene = glass(facing(1.0), tracks=tracks)
    assert moment(scene, None, 1, rate=4).transparent_surfaces == (
        TransparentSurface(surface=Plane(point=(0, 0, -3), normal=(0, 0, 1), albedo=WHITE), opacity=0.25),)
    frames = run_sequence(scene, frames=3, rate=4, settings=HOW, outputs=["particles/transmittance"])
    assert [frame["particles/transmittance"].max() for frame in frames] == [1.0, 0.75, 0.5]
    with pytest.raises(InputError, match=r"^transparent_surfaces\[0\].opacity: is 2, must be at least 0 and at most 1"):
        glass(facing(1.0), tracks=(Track(path="transparent_surfaces[0].opacity", keys=(Key(time=0, value=2),)),))


def test_a_mesh_that_moves_is_found_among_its_assets() -> None:
    pytest.importorskip("embreex", reason="meshes need the extra 'mesh'")
    mesh = Mesh(path="triangle.obj", transform=Transform(translate=(-1, 0, -4)))
    triangle = np.array([(-1, -1, 0), (1, -1, 0), (0, 1, 0)], float), np.array([(0, 1, 2)])
    assets = load_assets(Scene(), None)
    scene = glass(TransparentSurface(surface=mesh), surfaces=(wall(7.0),), tracks=(Track(
        path="transparent_surfaces[0].surface.transform.translate[0]",
        keys=(Key(time=0, value=-1), Key(time=0.1, value=1))),))
    made = list(run_sequence(scene, frames=4, settings=dataclasses.replace(HOW, temporal=Temporal()),
                             assets=assets._replace(meshes={mesh: triangle})))
    there = dataclasses.replace(mesh, transform=Transform(translate=(1, 0, -4)))
    want = run_frame(dataclasses.replace(scene, transparent_surfaces=(TransparentSurface(surface=there),), tracks=()),
                     made[3].settings, assets=assets._replace(meshes={there: triangle}))
    np.testing.assert_array_equal(made[3][FINAL], want[FINAL])
    assert not np.array_equal(made[0][FINAL], made[3][FINAL])
