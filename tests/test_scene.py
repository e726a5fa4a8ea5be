"""The scene's records: what they mean, what they refuse."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from froxel_ref import scene
from froxel_ref.records import InputError, Record, from_json, to_json
from froxel_ref.scene import (
    Box,
    Camera,
    DensityTexture,
    DirectionalLight,
    ExtraLights,
    HeightFog,
    ImageBuffers,
    LocalMedium,
    Medium,
    NoiseDensity,
    Particle,
    ParticleCloud,
    Plane,
    PointLight,
    Scene,
    SpotLight,
    Transform,
)

RECORDS = [cls for cls in vars(scene).values()
           if isinstance(cls, type) and issubclass(cls, Record) and cls is not Record]


@pytest.mark.parametrize("cls", RECORDS)
def test_everything_is_described(cls: type) -> None:
    assert cls.__doc__
    assert [f.name for f in dataclasses.fields(cls) if not f.metadata["kind"].about] == []


# --- transforms -------------------------------------------------------------------------------------


@pytest.mark.parametrize(("transform", "rows"), [
    (Transform(), [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0]]),
    (Transform(translate=(1, 2, 3), scale=(4, 5, 6)), [[4, 0, 0, 1], [0, 5, 0, 2], [0, 0, 6, 3]]),
    # A quarter turn about x takes y to z and z to −y; about y, z to x; about z, x to y.
    (Transform(rotate=(90, 0, 0)), [[1, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0]]),
    (Transform(rotate=(0, 90, 0)), [[0, 0, 1, 0], [0, 1, 0, 0], [-1, 0, 0, 0]]),
    (Transform(rotate=(0, 0, 90)), [[0, -1, 0, 0], [1, 0, 0, 0], [0, 0, 1, 0]]),
    # First about x, then about y: z → −y → −y, x → x → −z, y → z → x.
    (Transform(rotate=(90, 90, 0)), [[0, 1, 0, 0], [0, 0, -1, 0], [-1, 0, 0, 0]]),
    # The scale comes first: local z (2 m) turns to world −y.
    (Transform(rotate=(90, 0, 0), scale=(1, 1, 2)), [[1, 0, 0, 0], [0, 0, -2, 0], [0, 1, 0, 0]]),
    (Transform(rotate=(-450, 180, 360)), [[-1, 0, 0, 0], [0, 0, 1, 0], [0, 1, 0, 0]]),
    (Transform(matrix=(1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 12, 13)),
     [[1, 2, 3, 4], [5, 6, 7, 8], [9, 10, 12, 13]]),
])
def test_transforms_by_hand(transform: Transform, rows: list[list[float]]) -> None:
    np.testing.assert_array_equal(transform.world_from_local, [*rows, [0, 0, 0, 1]])


def test_a_turn_of_30_degrees_by_hand() -> None:
    # cos 30° = √3/2 and sin 30° = ½; one rounding in the angle, one in the function: 2 ulp.
    half, root = 0.5, np.sqrt(3) / 2
    np.testing.assert_allclose(Transform(rotate=(0, 30, 0)).world_from_local[:3, :3],
                               [[root, 0, half], [0, 1, 0], [-half, 0, root]], rtol=4e-16, atol=0)


angles = st.floats(-720, 720)


@given(turn=st.tuples(angles, angles, angles))
def test_a_turn_keeps_lengths_and_hands(turn: tuple[float, float, float]) -> None:
    matrix = Transform(rotate=turn).world_from_local[:3, :3]
    np.testing.assert_allclose(matrix @ matrix.T, np.eye(3), atol=1e-15)  # measured: 4.4e-16
    np.testing.assert_allclose(np.linalg.det(matrix), 1.0, rtol=2e-15)


# --- what is refused --------------------------------------------------------------------------------

POINT = {"type": "point", "position": [0, 0, 0], "intensity": [1, 1, 1]}
SPOT = POINT | {"type": "spot"}
SUN = {"type": "directional", "direction": [0, 1, 0], "irradiance": [1, 1, 1]}
PUFF = {"type": "particle", "position": [0, 0, 0]}
NAN, INF = float("nan"), float("inf")


@pytest.mark.parametrize(("raw", "message"), [
    ({"global_media": [{"extinction": -0.1}]}, "global_media[0].extinction: is -0.1, must be at least 0 1/m"),
    ({"global_media": [{"extinction": [0, 0, -1]}]},
     "global_media[0].extinction[2]: is -1, must be at least 0 1/m"),
    ({"global_media": [{"extinction": NAN}]}, "global_media[0].extinction: is nan, must be a finite number"),
    ({"global_media": [{"albedo": [0, 1.5, 0]}]},
     "global_media[0].albedo[1]: is 1.5, must be at least 0 and at most 1"),
    ({"global_media": [{"albedo": [0, -0.5, 0]}]},
     "global_media[0].albedo[1]: is -0.5, must be at least 0 and at most 1"),
    ({"global_media": [{"phase_anisotropy": 1}]},
     "global_media[0].phase_anisotropy: is 1, must be above -1 and below 1"),
    ({"global_media": [{"phase_anisotropy": -1.5}]},
     "global_media[0].phase_anisotropy: is -1.5, must be above -1 and below 1"),
    ({"global_media": [{"emissive": [INF, 0, 0]}]},
     "global_media[0].emissive[0]: is inf, must be a finite number"),
    ({"global_media": [{"height_fog": {"falloff": -1}}]},
     "global_media[0].height_fog.falloff: is -1, must be at least 0 1/m"),
    ({"global_media": [{"shape": "box"}]},
     "global_media[0].shape: is not a key here; known: albedo, density, emissive, extinction, height_fog, "
     "name, phase_anisotropy"),
    ({"global_media": [{"density": {"source": {"type": "noise", "size": 1}}}]},
     "global_media[0].density.source.size: is 1, must be at least 2 and at most 256"),
    ({"global_media": [{"density": {"source": {"type": "file", "path": "a.raw", "dtype": "uint8"}}}]},
     "global_media[0].density.source.shape: is missing beside dtype, raw files need both"),
    ({"global_media": [{"density": {"source": {"type": "file", "path": "a.raw", "shape": [2, 2, 2]}}}]},
     "global_media[0].density.source.dtype: is missing beside shape, raw files need both"),
    ({"local_media": [{"transform": {"scale": [1, 0, 1]}}]},
     "local_media[0].transform.scale: makes the transform singular, must span all three axes"),
    ({"local_media": [{"transform": {"scale": [1, 1e-9, 1], "rotate": [10, 20, 30]}}]},
     "local_media[0].transform.scale: makes the transform singular, must span all three axes"),
    ({"local_media": [{"transform": {"scale": [0, 0, 0]}}]},
     "local_media[0].transform.scale: makes the transform singular, must span all three axes"),
    ({"local_media": [{"transform": {"scale": [1e300, 1, 1]}}]},
     "local_media[0].transform.scale[0]: is 1e+300, must be within -1e+10 and 1e+10 m"),
    ({"local_media": [{"transform": {"matrix": [1, 0, 0, 0, 1, 0, 0, 0, 0, 0, 1, 0]}}]},
     "local_media[0].transform.matrix: makes the transform singular, must span all three axes"),
    ({"local_media": [{"transform": {"matrix": [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0], "scale": [2, 2, 2]}}]},
     "local_media[0].transform.matrix: is given beside translate, rotate or scale, must stand for all three"),
    ({"local_media": [{"transform": {"matrix": [1, 0, 0]}}]},
     "local_media[0].transform.matrix: has 3 numbers, must have 12"),
    ({"local_media": [{"shape": "ball"}]}, "local_media[0].shape: is 'ball', must be one of box, ellipsoid"),
    ({"lights": [POINT, POINT | {"radius": 0}]}, "lights[1].radius: is 0, must be above 0 m"),
    ({"lights": [POINT, POINT | {"radius": -2}]}, "lights[1].radius: is -2, must be above 0 m"),
    ({"lights": [POINT | {"raduis": 2}]}, "lights[0].raduis: is not a key here; did you mean 'radius'?"),
    ({"lights": [POINT | {"intensity": [1, 1, -1]}]},
     "lights[0].intensity[2]: is -1, must be at least 0 W/sr"),
    ({"lights": [{"type": "point"}]}, "lights[0].position: is missing (world position)"),
    ({"lights": [{"type": "area"}]}, "lights[0].type: is 'area'; known: directional, point, spot"),
    ({"lights": [SPOT | {"inner_angle": 30}]},
     "lights[0].inner_angle: is 30, must be below outer_angle (30)"),
    ({"lights": [SPOT | {"outer_angle": 90}]},
     "lights[0].outer_angle: is 90, must be above 0 and below 90 degrees"),
    ({"lights": [SPOT | {"direction": [0, 0, 0]}]}, "lights[0].direction: is zero, must point somewhere"),
    ({"lights": [SUN | {"direction": [0, 0, 0]}]}, "lights[0].direction: is zero, must point somewhere"),
    ({"lights": [SUN | {"direction": [0, 1e-200, 0]}]},
     "lights[0].direction: has length 1e-200, must be within 1e-100 and 1e+100"),
    ({"surfaces": [{"type": "plane", "normal": [0, 0, 0]}]},
     "surfaces[0].normal: is zero, must point somewhere"),
    ({"surfaces": [{"type": "sphere", "radius": 0}]}, "surfaces[0].radius: is 0, must be above 0 m"),
    ({"surfaces": [{"type": "box", "albedo": [2, 0, 0]}]},
     "surfaces[0].albedo[0]: is 2, must be at least 0 and at most 1"),
    ({"surfaces": [{"type": "mesh"}]},
     "surfaces[0].path: is missing (.obj, .ply or .glb file, relative to the scene's folder)"),
    ({"surfaces": [{"type": "height_field"}]},
     "surfaces[0].heights: is missing (where the heights come from)"),
    ({"surfaces": [{"type": "plane"}], "image_buffers": {"depth": "d.npy"}},
     "image_buffers: is given beside surfaces, must be given instead of them"),
    ({"camera": {"position": [1, 2, 3], "target": [1, 2, 3]}},
     "camera.target: is the camera's position, must be another point"),
    ({"camera": {"up": [0, 0, 2]}}, "camera.up: is along the view direction, must be across it"),
    ({"camera": {"up": [0, 0, 0]}}, "camera.up: is zero, must point somewhere"),
    ({"camera": {"target": [0, 1e308, 0]}},
     "camera.target[1]: is 1e+308, must be within -1e+10 and 1e+10 m"),
    ({"camera": {"vertical_fov": 180}}, "camera.vertical_fov: is 180, must be above 0 and below 180 degrees"),
    ({"camera": {"width": 0}}, "camera.width: is 0, must be at least 1 and at most 16384 pixels"),
    ({"camera": {"exposure": 0}}, "camera.exposure: is 0, must be above 0"),
    ({"extra_lights": {"count": -1}}, "extra_lights.count: is -1, must be at least 0 and at most 65536"),
    ({"extra_lights": {"low": [9, 0, 0]}},
     "extra_lights.low: is beyond high, must not exceed it on any axis"),
    ({"particles": [{"type": "smoke"}]}, "particles[0].type: is 'smoke'; known: cloud, particle"),
    ({"particles": [{"type": "particle"}]}, "particles[0].position: is missing (its centre)"),
    ({"particles": [{"position": [0, 0, 0]}]}, "particles[0].type: is missing; known: cloud, particle"),
    ({"particles": [PUFF, PUFF | {"size": 0}]}, "particles[1].size: is 0, must be above 0 m"),
    ({"particles": [PUFF | {"opacity": 1.5}]}, "particles[0].opacity: is 1.5, must be at least 0 and at most 1"),
    ({"particles": [PUFF | {"profile": "round"}]},
     "particles[0].profile: is 'round', must be one of soft, disc, square"),
    ({"particles": [PUFF | {"fom_multiplier": -1}]}, "particles[0].fom_multiplier: is -1, must be at least 0"),
    ({"particles": [PUFF | {"texture": 3}]}, "particles[0].texture: is 3, must be a string"),
    ({"particles": [{"type": "cloud", "low": [9, 0, 0]}]},
     "particles[0].low: is beyond high, must not exceed it on any axis"),
    ({"particles": [{"type": "cloud", "size": [2, 1]}]},
     "particles[0].size: begins with 2, must not exceed its end, 1"),
    ({"particles": [{"type": "cloud", "opacity": [0.5, 0.25]}]},
     "particles[0].opacity: begins with 0.5, must not exceed its end, 0.25"),
    ({"particles": [{"type": "cloud", "opacity": [0.5]}]}, "particles[0].opacity: has 1 numbers, must have 2"),
    ({"ambient": [0, 0, -1]}, "ambient[2]: is -1, must be at least 0 W m^-2 sr^-1"),
    ({"fog": 1}, "fog: is not a key here; known: ambient, background, camera, description, extra_lights, "
                 "global_media, image_buffers, lights, local_media, name, particles, surfaces, tracks, "
                 "transparent_surfaces"),
])
def test_what_is_refused_is_named_in_one_line(raw: object, message: str) -> None:
    with pytest.raises(InputError) as caught:
        from_json(Scene, raw)
    assert str(caught.value) == message


def numeric_fields() -> list[tuple[type[Record], str, int]]:
    """Every field of every record that holds a number or numbers, with how many."""
    found = []
    for cls in RECORDS:
        for field in dataclasses.fields(cls):
            schema = field.metadata["kind"].schema()
            if schema.get("type") in ("number", "integer"):
                found.append((cls, field.name, 0))
            elif "items" in schema and schema["items"].get("type") in ("number", "integer"):
                found.append((cls, field.name, schema["minItems"]))
            elif "anyOf" in schema and schema["anyOf"][0].get("type") == "number":
                found.append((cls, field.name, 0))
    return found


def test_there_are_numeric_fields() -> None:
    assert len(numeric_fields()) > 50


@pytest.mark.parametrize("bad", [NAN, INF, -INF])
@pytest.mark.parametrize(("cls", "name", "length"), numeric_fields(),
                         ids=lambda part: getattr(part, "__name__", part))
def test_nan_and_infinity_are_refused_everywhere(
        cls: type[Record], name: str, length: int, bad: float) -> None:
    required = {"direction": [0, 1, 0], "irradiance": [1] * 3, "position": [0] * 3, "intensity": [1] * 3,
                "path": "a", "depth": "a", "source": {"type": "noise"}, "heights": {"type": "folds"},
                "time": 0, "value": 0, "surface": {"type": "sphere"}}
    names = {field.name for field in dataclasses.fields(cls)}
    values = {key: value for key, value in required.items() if key in names}
    values[name] = [1] * (length - 1) + [bad] if length else bad
    problem = rf"^{name}(\[\d+\])?: is (nan|-?inf), must be a (finite|whole) number$"
    with pytest.raises(InputError, match=problem):
        from_json(cls, values)


def test_thin_things_are_not_singular() -> None:
    assert Box(transform=Transform(scale=(100, 1e-5, 100))).transform.scale == (100, 1e-5, 100)


def test_small_and_large_directions_are_allowed() -> None:
    for direction in ((0.0, 1e-90, 1e-300), (0.0, 1e-90, 1e10)):
        assert DirectionalLight(direction=direction, irradiance=(1, 1, 1)).direction == direction


# --- the whole --------------------------------------------------------------------------------------


def test_a_scene_comes_back_from_json() -> None:
    whole = Scene(
        name="all", camera=Camera(position=(1, 2, 3), exposure=0.1),
        global_media=(Medium(extinction=(0.1, 0.2, 0.3), height_fog=HeightFog(max_height=3)),),
        local_media=(LocalMedium(shape="ellipsoid", density=DensityTexture(source=NoiseDensity(seed=3))),),
        lights=(PointLight(position=(0, 1, 0), intensity=(1, 1, 1)),
                SpotLight(position=(0, 1, 0), intensity=(1, 1, 1), falloff="inverse_square"),
                DirectionalLight(direction=(0, 1, 0), irradiance=(1 / 3, 0, 0))),
        surfaces=(Plane(), Box(transform=Transform(rotate=(10, 20, 30)))),
        particles=(ParticleCloud(count=3, seed=9, shape="ellipsoid", texture="puff.npy", size=(1, 2)),
                   Particle(position=(1, 2, 3), rotation=-30, profile="disc", fom_multiplier=0.5)))
    assert from_json(Scene, to_json(whole)) == whole
    assert hash(from_json(Scene, to_json(whole))) == hash(whole)


def test_image_buffers_instead_of_surfaces() -> None:
    assert Scene(image_buffers=ImageBuffers(depth="d.npy")).image_buffers == ImageBuffers(depth="d.npy")


# --- extra lights -----------------------------------------------------------------------------------


@given(count=st.integers(0, 40), seed=st.integers(0, 2**70))
def test_the_first_extra_lights_are_the_same_whatever_the_count(count: int, seed: int) -> None:
    assert ExtraLights(count=40, seed=seed).lights()[:count] == ExtraLights(count=count, seed=seed).lights()


@given(seed=st.integers(0, 2**70))
def test_extra_lights_are_as_declared(seed: int) -> None:
    extra = ExtraLights(count=16, seed=seed, low=(-1, 2, 3), high=(1, 2, 5), radius=2.5, intensity=0.75)
    for light in extra.lights():
        assert all(a <= p <= b for a, p, b in zip(extra.low, light.position, extra.high, strict=True))
        assert light.radius == 2.5
        assert sum(light.intensity) / 3 == pytest.approx(0.75, rel=1e-15)


def test_extra_lights_come_after_the_scenes_own() -> None:
    own = PointLight(name="own", position=(0, 0, 0), intensity=(1, 1, 1))
    names = [light.name for light in Scene(lights=(own,), extra_lights=ExtraLights(count=2)).all_lights]
    assert names == ["own", "extra 0", "extra 1"]


def test_another_seed_gives_other_lights() -> None:
    assert ExtraLights(count=1, seed=1).lights() != ExtraLights(count=1, seed=2).lights()


# --- particles --------------------------------------------------------------------------------------


@given(count=st.integers(0, 40), seed=st.integers(0, 2**70), shape=st.sampled_from(["box", "ellipsoid"]))
def test_the_first_particles_of_a_cloud_are_the_same_whatever_the_count(count: int, seed: int, shape: str) -> None:
    whole = ParticleCloud(count=40, seed=seed, shape=shape).particles()
    assert whole[:count] == ParticleCloud(count=count, seed=seed, shape=shape).particles()


@given(seed=st.integers(0, 2**70), shape=st.sampled_from(["box", "ellipsoid"]))
def test_a_cloud_is_as_declared(seed: int, shape: str) -> None:
    low, high = (-1.0, 2.0, 3.0), (1.0, 2.0, 5.0)  # flat: an axis without extent is allowed
    cloud = ParticleCloud(name="smoke", count=16, seed=seed, low=low, high=high, shape=shape, size=(0.1, 0.3),
                          rotation=(-20, 20), opacity=(0.25, 0.25), albedo=(0.5, 0.25, 1), phase_anisotropy=0.3,
                          profile="disc", texture="puff.npy", fom_multiplier=2)
    for i, each in enumerate(cloud.particles()):
        assert all(a <= p <= b for a, p, b in zip(low, each.position, high, strict=True))
        if shape == "ellipsoid":
            assert each.position[0] ** 2 + (each.position[2] - 4.0) ** 2 <= 1.0 + 1e-15
        assert 0.1 <= each.size <= 0.3
        assert -20 <= each.rotation <= 20
        assert each == Particle(name=f"smoke {i}", position=each.position, size=each.size, rotation=each.rotation,
                                opacity=0.25, albedo=(0.5, 0.25, 1), phase_anisotropy=0.3, profile="disc",
                                texture="puff.npy", fom_multiplier=2)


@pytest.mark.parametrize(("shape", "variance"), [("box", 1 / 3), ("ellipsoid", 1 / 5)])
def test_a_cloud_is_even(shape: str, variance: float) -> None:
    # Over [−1, 1] in box and ball; the variance's own deviation is below 0.3/√20000, and five of them are allowed.
    cloud = ParticleCloud(count=20000, low=(-1, -1, -1), high=(1, 1, 1), shape=shape)
    place = np.array([each.position for each in cloud.particles()])
    assert np.abs(place.mean(axis=0)).max() < 5 * np.sqrt(variance / 20000)
    np.testing.assert_allclose(np.cov(place.T), variance * np.eye(3), atol=5 * 0.3 / np.sqrt(20000))


def test_clouds_expand_in_their_place() -> None:
    one, two = Particle(name="one", position=(0, 0, 0)), Particle(name="two", position=(0, 0, 0))
    whole = Scene(particles=(one, ParticleCloud(count=2), two))
    assert [each.name for each in whole.all_particles] == ["one", "cloud 0", "cloud 1", "two"]
    assert Scene().all_particles == ()


def test_another_seed_gives_another_cloud() -> None:
    assert ParticleCloud(count=1, seed=1).particles() != ParticleCloud(count=1, seed=2).particles()
