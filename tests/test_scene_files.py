"""Scene files: the built-in scenes, strict JSON, overrides, and a schema that agrees with the records."""

from __future__ import annotations

import contextlib
import copy
import dataclasses
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from unittest import mock

import jsonschema
import numpy as np
import pytest
from hypothesis import given
from hypothesis import settings as hypothesis_settings
from hypothesis import strategies as st

from froxel_ref.frame import run_frame
from froxel_ref.overrides import override
from froxel_ref.records import InputError, Record, from_json, to_json
from froxel_ref.scene import Box, HeightField, HeightFog, Mesh, NoiseDensity, Scene, VolumeDensity
from froxel_ref.scene_files import LARGEST, Document, builtin, document, load, schema
from froxel_ref.scene_motion import duration, scene_at
from froxel_ref.sequence import moment
from froxel_ref.settings import Settings, replace
from froxel_ref.strict_json import parse

NAMES = ["ghosting", "hall-walk", "leak", "leak-walk", "lights", "long-range", "many-lights", "particles-in-fog",
         "ringing", "shaft", "smoke", "thesis-hall", "thin-layer", "two-volumes", "uniform", "vacuum"]
SMALL = '{"schema": 1, "scene": {"name": "small"}}'


def message(function: Any, *arguments: Any, **options: Any) -> str:
    """The one line with which a call is refused."""
    with pytest.raises(InputError) as caught:
        function(*arguments, **options)
    line = str(caught.value)
    assert "\n" not in line
    return line


# --- built-in scenes --------------------------------------------------------------------------------


def test_the_built_in_scenes_are_named_and_described() -> None:
    scenes = builtin()
    assert list(scenes) == NAMES
    assert all(about.endswith(".") and about.count(". ") <= 1 for about in scenes.values())


@pytest.mark.parametrize("name", NAMES)
def test_a_built_in_scene_loads_validates_and_comes_back(name: str) -> None:
    loaded = load(name)
    assert (loaded.scene.name, loaded.folder) == (name, None)
    written = document(loaded.scene, loaded.settings)
    jsonschema.Draft202012Validator(schema()).validate(written)
    again = from_json(Document, json.loads(json.dumps(written)))
    assert (again.scene, again.settings) == (loaded.scene, loaded.settings)


@pytest.mark.parametrize("name", NAMES)
def test_a_built_in_file_itself_fits_the_schema(name: str) -> None:
    file = Path(load.__code__.co_filename).parent / "scenes" / f"{name}.json"
    jsonschema.Draft202012Validator(schema()).validate(parse(file.read_text("utf-8"), name))


def test_thesis_hall_has_what_the_thesis_has() -> None:
    scene = load("thesis-hall").scene
    kinds = [light.kind for light in scene.lights]
    assert (kinds.count("point"), kinds.count("directional"), len(kinds)) == (9, 1, 10)
    assert all(light.radius == 16 for light in scene.lights if light.kind == "point")
    assert isinstance(scene.global_media[0].height_fog, HeightFog)
    mist = scene.local_media[0]
    assert mist.shape == "ellipsoid"
    assert mist.density is not None
    assert isinstance(mist.density.source, NoiseDensity)
    assert any(mist.density.scroll)
    assert any(isinstance(surface, HeightField) for surface in scene.surfaces)
    assert sum(surface.name.startswith("column") for surface in scene.surfaces) == 14
    assert scene.extra_lights.count == 0
    assert len(load("thesis-hall", overrides=["extra_lights.count=512"]).scene.all_lights) == 522


def test_the_extra_lights_of_thesis_hall_are_inside_it() -> None:
    extra = load("thesis-hall", overrides=["extra_lights.count=64"]).scene.extra_lights.lights()
    assert all(abs(x) < 8 and 0 < y < 8 and -44 < z < 4 for x, y, z in (light.position for light in extra))


def test_uniform_has_one_medium_one_sun_and_nothing_else() -> None:
    scene = load("uniform").scene
    assert (len(scene.global_media), len(scene.lights), scene.lights[0].kind) == (1, 1, "directional")
    assert (scene.local_media, scene.surfaces) == ((), ())
    assert (scene.ambient, scene.background) == ((0, 0, 0), (0, 0, 0))
    medium = scene.global_media[0]
    assert (medium.height_fog, medium.density) == (None, None)


def test_vacuum_has_no_medium() -> None:
    scene = load("vacuum").scene
    assert (scene.global_media, scene.local_media) == ((), ())
    assert scene.lights
    assert scene.surfaces


def test_the_smoke_rises_and_the_bunny_stands_on_the_floor() -> None:
    scene = load("smoke").scene
    plume = scene.local_media[0]
    assert plume.density is not None
    assert plume.density.source == VolumeDensity(path="smoke.vol")
    # z is up in the volume's file, y in the world; a cell is as long on all three axes (bounds over texels).
    matrix = plume.transform.world_from_local
    up = matrix[:3, 2]
    assert up[1] > 0
    assert tuple(up[[0, 2]]) == (0, 0)
    extent = np.linalg.norm(matrix[:3, :3], axis=0)
    np.testing.assert_allclose(extent / extent[2], np.array([44, 45, 53]) / 53, rtol=0.02)
    # The mesh's own bounds: x −0.095…0.061, y 0.033…0.187, z −0.062…0.059.
    bunny = next(surface for surface in scene.surfaces if isinstance(surface, Mesh))
    low, high = (bunny.transform.world_from_local @ [*corner, 1] for corner in
                 ((-0.095, 0.033, -0.062), (0.061, 0.187, 0.059)))
    np.testing.assert_allclose(low[1], 0, atol=0.005)
    assert 1.2 < high[1] - low[1] < 1.5
    np.testing.assert_allclose((low + high)[[0, 2]] / 2, 0, atol=0.01)


@pytest.mark.parametrize(("walk", "still"), [("hall-walk", "thesis-hall"), ("leak-walk", "leak")])
def test_a_walk_is_its_scene_with_tracks_and_begins_where_that_stands(walk: str, still: str) -> None:
    moving, standing = load(walk), load(still)
    assert moving.settings == standing.settings
    assert moving.scene.tracks
    assert duration(moving.scene) == 4
    names = {"name": walk, "description": moving.scene.description}
    assert dataclasses.replace(moving.scene, tracks=()) == dataclasses.replace(standing.scene, **names)
    assert scene_at(moving.scene, 0.0) == dataclasses.replace(standing.scene, **names)


@pytest.mark.parametrize("walk", ["hall-walk", "leak-walk"])
def test_a_walk_goes_on_at_a_walk_and_keeps_clear_of_what_is_there(walk: str) -> None:
    """At least the near end of the froxels away from every wall and column, which stand along the axes, and slower
    than 3 m/s, in each of its 121 frames."""
    loaded = load(walk)
    cameras = [moment(loaded.scene, None, frame).camera for frame in range(121)]
    places = np.array([camera.position for camera in cameras])
    speeds = 30.0 * np.linalg.norm(np.diff(places, axis=0), axis=1)
    assert 0.5 < speeds.mean() < speeds.max() < 3.0
    boxes = [surface.transform for surface in loaded.scene.surfaces if isinstance(surface, Box)]
    assert all(box.rotate == (0, 0, 0) and box.matrix is None for box in boxes)
    for box in boxes:
        outside = np.maximum(np.abs(places - box.translate) - box.scale, 0.0)
        assert np.linalg.norm(outside, axis=1).min() > loaded.settings.grid.near
    assert (places[:, 1] > loaded.settings.grid.near).all()
    aims = np.array([np.subtract(camera.target, camera.position) for camera in cameras])
    aims /= np.linalg.norm(aims, axis=1, keepdims=True)
    turns = np.degrees(np.arccos(np.minimum((aims[1:] * aims[:-1]).sum(axis=1), 1.0)))
    assert 0.0 < turns.max() < 1.0  # a frame


def test_most_of_the_long_range_lies_behind_the_froxels_and_in_shafts() -> None:
    """Measured: 0.80 of the pixels; a tenth of the rays keep less than 0.37 of the light that they have without
    shadows, a tenth all of it."""
    scene, how, _ = load("long-range", overrides=["camera.width=64", "camera.height=36", "grid.width=4",
                                                  "grid.height=2", "grid.depth=2"])
    assert (how.shadows, how.long_range.march) == ("maps", True)
    assert how.shadow_maps.reach is not None
    light = "long_range/radiance"
    there, unhidden = (run_frame(scene, replace(how, shadows=word), outputs=[light, "surface/depth"])
                       for word in ("maps", "off"))
    depth = there["surface/depth"]
    assert np.mean(depth > how.grid.far) > 0.6
    assert depth.min() < how.grid.far / 2
    assert depth[np.isfinite(depth)].max() > 3000
    marched = unhidden[light][0] > 0
    share = there[light][0][marched] / unhidden[light][0][marched]
    assert np.quantile(share, 0.1) < 0.5
    assert np.quantile(share, 0.9) > 0.99


KNOWN, ENDING = f"known: {', '.join(NAMES)}", "a scene file's name ends in .json"


@pytest.mark.parametrize(("name", "expected"), [
    ("thesis-hal", f"scene: 'thesis-hal' is not built in; did you mean 'thesis-hall'? ({KNOWN}); {ENDING}"),
    ("qqq", f"scene: 'qqq' is not built in; {KNOWN}; {ENDING}"),
    ("", f"scene: '' is not built in; {KNOWN}; {ENDING}"),
    ("a\nb", f"scene: 'a\\nb' is not built in; {KNOWN}; {ENDING}"),
])
def test_an_unknown_scene_is_refused_with_the_nearest(name: str, expected: str) -> None:
    assert message(load, name) == expected


# --- files ------------------------------------------------------------------------------------------


def test_a_file_brings_its_folder(tmp_path: Path) -> None:
    file = tmp_path / "small.json"
    file.write_text(SMALL)
    for name in (file, str(file)):
        assert load(name) == (Scene(name="small"), Settings(), tmp_path)


def test_data_comes_before_the_files_folder(tmp_path: Path) -> None:
    file, data = tmp_path / "small.json", tmp_path / "data"
    file.write_text(SMALL)
    data.mkdir()
    assert load(file, data=data).folder == data
    assert load("smoke", data=str(data)).folder == data
    assert message(load, file, data="no such") == "data: 'no such' is not a folder"
    assert message(load, file, data="nul\0") == "data: 'nul\\x00' is not a folder"


def test_a_byte_order_mark_is_passed_over(tmp_path: Path) -> None:
    file = tmp_path / "small.json"
    file.write_bytes(b"\xef\xbb\xbf" + SMALL.encode())
    assert load(file).scene.name == "small"


def test_files_that_cannot_be_read(tmp_path: Path) -> None:
    missing, folder, latin, large = (tmp_path / f"{name}.json" for name in ("no", "folder", "latin", "large"))
    folder.mkdir()
    latin.write_bytes(b'{"name": "\xe9"}')
    large.write_bytes(b" " * (LARGEST + 1))
    assert message(load, missing) == f"{missing}: cannot be read: No such file or directory"
    assert message(load, folder) == f"{folder}: cannot be read: Is a directory"
    assert message(load, latin) == f"{latin}: is not UTF-8 (byte 10)"
    assert message(load, large) == f"{large}: is larger than 16 MB, too large for a scene"
    assert message(load, "nul\0.json") == "'nul\\x00.json': cannot be read: embedded null byte"
    assert message(load, "no/such") == "no/such: cannot be read: No such file or directory"


# Where Python's own words differ between versions, only the place is compared.
@pytest.mark.parametrize(("text", "start"), [
    ("", "hall.json, line 1, column 1: malformed JSON: "),
    ('{"schema" 1}', "hall.json, line 1, column 11: malformed JSON: Expecting ':' delimiter"),
    ('{\n  "schema": 1\n  "scene": {}\n}',
     "hall.json, line 3, column 3: malformed JSON: Expecting ',' delimiter"),
    ('{"scene": {}}}', "hall.json, line 1, column 14: malformed JSON: Extra data"),
    ("{'scene': {}}", "hall.json, line 1, column 2: malformed JSON: "),
    ('{"name": "two\nlines"}', "hall.json, line 1, column 14: malformed JSON: Invalid control character at"),
    ('{"scene": {"ambient": [0,\n 0, NaN]}}', "hall.json, line 2, column 5: is NaN, must be a finite number"),
    ('{"NaN": [Infinity]}', "hall.json, line 1, column 10: is Infinity, must be a finite number"),
    ('["\\" NaN", "\\\\", -Infinity]', "hall.json, line 1, column 18: is -Infinity, must be a finite number"),
    ('{"a": 1,\n "b": {"a": 1},\n "a": 2}',
     "hall.json, line 3, column 2: the key a stands twice in one object"),
    ('{"x": {"a": {"a": 0}, "b": 1}, "y": {"b": 1, "\\u0062": 1}}',
     "hall.json, line 1, column 46: the key b stands twice in one object"),
    ('{"a": "{", "a": "}"}', "hall.json, line 1, column 12: the key a stands twice in one object"),
    ('{"a\\n": 1, "a\\n": 2}', "hall.json, line 1, column 12: the key 'a\\n' stands twice in one object"),
    ("[" * 100_000, "hall.json: is nested too deeply"),
    ('{"a":' * 100_000, "hall.json: is nested too deeply"),
])
def test_malformed_json_is_refused_with_its_place(text: str, start: str) -> None:
    assert message(parse, text, "hall.json").startswith(start)


@hypothesis_settings(max_examples=50)
@given(value=st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False, allow_infinity=False) | st.text(),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(), inner, max_size=3), max_leaves=8))
def test_what_json_writes_is_read_unchanged(value: object) -> None:
    assert parse(json.dumps(value), "here") == value


@pytest.mark.parametrize(("text", "expected"), [
    ("[1, 2]", "is [1, 2], must be an object"),
    ("{}", "schema: is missing (version of this layout)"),
    ('{"schema": 1}', "scene: is missing (what is in the world)"),
    ('{"schema": 2, "world": {}}', "schema: is 2, this version of froxel-ref reads 1"),
    ('{"schema": "1", "scene": {}}', "schema: is '1', this version of froxel-ref reads 1"),
    ('{"schema": true, "scene": {}}', "schema: is True, this version of froxel-ref reads 1"),
    ('{"schema": 1, "scen": {}}', "scen: is not a key here; did you mean 'scene'?"),
    ('{"schema": 1, "scene": {"lights": [{"type": "point", "position": [0, 0, 0], "intensity": [1, 1, 1],'
     ' "radius": 1e999}]}}', "scene.lights[0].radius: is inf, must be a finite number"),
    ('{"schema": 1, "scene": {"camera": {"width": ' + "9" * 5000 + "}}}",
     "scene.camera.width: is inf, must be a whole number"),
    ('{"schema": 1, "scene": {}, "settings": {"grid": {"near": 64}}}',
     "settings.grid.near: is 64 m, must be below far (64 m)"),
    ('{"schema": 1, "scene": {"name": ' + "[" * 800 + "]" * 800 + "}}",
     "scene.name: is [[[[...]]]], must be a string"),
])
def test_a_document_that_says_something_else_is_refused(tmp_path: Path, text: str, expected: str) -> None:
    file = tmp_path / "bad.json"
    file.write_text(text)
    assert message(load, file) == expected


# --- overrides --------------------------------------------------------------------------------------


@pytest.mark.parametrize(("text", "read", "value"), [
    ("scene.lights[2].radius=8", lambda s, _: s.lights[2].radius, 8),
    ("lights[2].radius = 8", lambda s, _: s.lights[2].radius, 8),
    ("camera.position=[0, 1, 2]", lambda s, _: s.camera.position, (0, 1, 2)),
    ("camera.position[1]=5", lambda s, _: s.camera.position[1], 5),
    ("global_media[0].extinction=[0.1, 0.2, 0.3]", lambda s, _: s.global_media[0].extinction,
     (0.1, 0.2, 0.3)),
    ("settings.grid.depth=32", lambda _, t: t.grid.depth, 32),
    ("grid.depth=32", lambda _, t: t.grid.depth, 32),
    ("emission=published", lambda _, t: t.emission, "published"),
    ("settings.emission=published", lambda _, t: t.emission, "published"),
    ("switches.emission=null", lambda _, t: t.switches.emission, None),
    ("settings.ambient=constant", lambda _, t: t.ambient, "constant"),
    ("fidelity=author", lambda _, t: t.fidelity, "author"),
    ('fidelity="author"', lambda _, t: t.fidelity, "author"),
    ("name=3", lambda s, _: s.name, "3"),
    ("name=a=b", lambda s, _: s.name, "a=b"),
    ("name=", lambda s, _: s.name, ""),
    ("global_media[0].height_fog=null", lambda s, _: s.global_media[0].height_fog, None),
    ("local_media[0].height_fog.falloff=2", lambda s, _: s.local_media[0].height_fog, HeightFog(falloff=2)),
    ("local_media[0].density.bias[2]=0.5", lambda s, _: s.local_media[0].density.bias, (0, 0, 0.5)),
    ("global_media=[]", lambda s, _: s.global_media, ()),
    ("extra_lights.count=3", lambda s, _: len(s.all_lights), 13),
])
def test_an_override_changes_one_value(text: str, read: Any, value: object) -> None:
    scene, settings, _ = load("thesis-hall", overrides=[text])
    assert read(scene, settings) == value


def test_overrides_apply_in_order_and_together() -> None:
    changed = load("thesis-hall", overrides=[
        "surfaces=[]", "image_buffers.depth=depth.npy", "image_buffers.radiance=c.npy",
        "local_media[0].density.source.type=file", "local_media[0].density.source.path=a.vol",
        "grid.depth=3", "grid.depth=4"])
    assert changed.scene.image_buffers is not None
    assert (changed.scene.image_buffers.depth, changed.scene.image_buffers.radiance) == ("depth.npy", "c.npy")
    density = changed.scene.local_media[0].density
    assert density is not None
    assert density.source == VolumeDensity(path="a.vol")
    assert changed.settings.grid.depth == 4


def test_an_override_leaves_the_document_as_it_was() -> None:
    raw = to_json(Document(schema=1, scene=load("thesis-hall").scene))
    before = copy.deepcopy(raw)
    override(Document, raw, "lights[1].intensity[0]=3")
    override(Document, raw, "local_media[0].density.source.type=file")
    assert raw == before


@pytest.mark.parametrize(("text", "expected"), [
    ("grid.depth", "override: 'grid.depth' has no '=', must be path=value"),
    ("a b=3", "override: 'a b' is not a path such as scene.lights[2].radius"),
    ("lights[-1].radius=3", "override: 'lights[-1].radius' is not a path such as scene.lights[2].radius"),
    ("=3", "override: '' is not a path such as scene.lights[2].radius"),
    ("ambient=[0, 0, 0]", "ambient: is ambiguous, must be scene.ambient or settings.switches.ambient"),
    ("emision=published", "emision: is not a key here; did you mean 'emission'?"),
    ("scene.camera.positon=3", "scene.camera.positon: is not a key here; did you mean 'position'?"),
    ("lights[12].radius=3", "scene.lights[12]: does not exist, the list has only 10, from [0] to [9]"),
    ("camera.position[3]=3",
     "scene.camera.position[3]: does not exist, the list has only 3, from [0] to [2]"),
    ("lights.radius=3", "scene.lights: is a list, must be followed by an index such as [0] before 'radius'"),
    ("camera[0]=3", "scene.camera: is not a list, cannot be followed by [0]"),
    ("camera.width[0]=3", "scene.camera.width: is not a list, cannot be followed by [0]"),
    ("camera.width.x=3", "scene.camera.width: is one value, has no key 'x'"),
    ("global_media[0].extinction[0]=3", "scene.global_media[0].extinction: is 0.04, not a list"),
    ("lights[2].radius=-1", "scene.lights[2].radius: is -1, must be above 0 m"),
    ("lights[2].radius=big", "scene.lights[2].radius: is 'big', must be a finite number"),
    ("lights[2].radius=NaN", "scene.lights[2].radius, line 1, column 1: is NaN, must be a finite number"),
    ("lights[2].type=spto", "scene.lights[2].type: is 'spto'; did you mean 'spot'?"),
    ('camera={"width": 1, "width": 2}',
     "scene.camera, line 1, column 14: the key width stands twice in one object"),
    ("camera=" + "[" * 100_000, "scene.camera: is nested too deeply"),
    ("image_buffers.depth=d.npy",
     "scene.image_buffers: is given beside surfaces, must be given instead of them"),
    ("global_media[0].density.source.seed=3",
     "scene.global_media[0].density.source: is null, its type must be set first (noise, file)"),
    ("schema=2", "schema: is 2, must be at least 1 and at most 1"),
])
def test_an_override_that_fits_nowhere_is_refused(text: str, expected: str) -> None:
    assert message(load, "thesis-hall", overrides=[text]) == expected


def test_an_empty_list_says_so() -> None:
    expected = "scene.lights[0]: does not exist, the list is empty"
    assert message(load, "uniform", overrides=["lights=[]", "lights[0].radius=3"]) == expected


# --- the schema agrees with the records -------------------------------------------------------------


def leaves(value: Any, path: tuple[str | int, ...] = ()) -> Iterator[tuple[str | int, ...]]:
    """The path of everything in a document, inner nodes too."""
    yield path
    inner = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, item in inner:
        yield from leaves(item, (*path, key))


def one_of_each() -> dict[str, Any]:
    """A small document in which every record class stands."""
    whole = load("two-volumes", overrides=[
        "settings.switches.lookup=centre", "local_media[0].height_fog.max_height=2",
        'local_media[0].density={"source": {"type": "noise"}}',
        'local_media[1].density={"source": {"type": "file", "path": "a", "shape": [1, 2, 3],'
        ' "dtype": "uint8"}}',
        "local_media[1].extinction=[1, 2, 3]", 'global_media=[{"name": "air"}]',
        'lights=[{"type": "point", "position": [0, 0, 0], "intensity": [1, 1, 1]},'
        '{"type": "spot", "position": [0, 0, 0], "intensity": [1, 1, 1]},'
        '{"type": "directional", "direction": [0, 1, 0], "irradiance": [1, 1, 1]}]',
        'surfaces=[{"type": "plane"}, {"type": "sphere"}, {"type": "mesh", "path": "a"},'
        '{"type": "box", "transform": {"matrix": [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0]}},'
        '{"type": "height_field", "heights": {"type": "folds"}},'
        '{"type": "height_field", "heights": {"type": "file", "path": "a"}}]',
        'particles=[{"type": "particle", "position": [0, 0, 0], "texture": "a"}, {"type": "cloud"}]',
        'tracks=[{"path": "camera.exposure", "keys": [{"time": 0, "value": 1}, {"time": 2, "value": 0.5}]},'
        '{"path": "ambient", "keys": [{"time": 1, "value": [0, 0.5, 1]}], "interpolation": "smooth",'
        ' "repeat": "loop"}]'])
    return document(whole.scene, whole.settings)


EACH = one_of_each()
VALIDATOR = jsonschema.Draft202012Validator(schema())
VALUES = st.one_of(
    st.none(), st.booleans(),
    st.sampled_from([0, 1, -1, 2, 3, 90, 180, 65536, 65537, 0.5, -0.5, 1.5, 1.0, -1.0]),
    st.sampled_from(["", "linear", "point", "spot", "box", "author", "divide", "uint8", "a\tb"]),
    st.lists(st.sampled_from([0, 0.5, 1, -1, 7, "x", None, True]), max_size=4), st.just({}),
    st.just({"type": "noise"}), st.just({"depth": "d.npy"}), st.just({"scale": [1, 2, 3]}))


@contextlib.contextmanager
def fields_alone() -> Iterator[None]:
    """Records without the rules that hold between fields, which a JSON Schema does not state."""
    with contextlib.ExitStack() as stack:
        waiting: list[type[Record]] = [Record]
        while waiting:
            cls = waiting.pop()
            waiting.extend(cls.__subclasses__())
            if "check_together" in vars(cls):
                stack.enter_context(mock.patch.object(cls, "check_together", return_value=None))
        yield


def accepted(raw: dict[str, Any]) -> bool:
    try:
        from_json(Document, raw)
    except InputError:
        return False
    return True


def test_the_document_with_one_of_each_holds_every_class() -> None:
    used = {json.dumps(EACH).count(f'"type": "{cls["properties"]["type"]["const"]}"') > 0
            for cls in schema()["$defs"].values() if "type" in cls["properties"]}
    assert used == {True}
    assert VALIDATOR.is_valid(EACH)
    assert accepted(EACH)


def changed(value: Any, path: tuple[str | int, ...], new: Any) -> Any:
    """A copy of a document with one value changed, or left out where the new one is `...`."""
    if not path:
        return new
    result = copy.copy(value)
    if new is ... and len(path) == 1:
        del result[path[0]]
    else:
        result[path[0]] = changed(value[path[0]], path[1:], new)
    return result


PATHS = [path for path in leaves(EACH) if path]


@pytest.mark.parametrize("path", PATHS, ids=lambda path: ".".join(map(str, path)))
def test_schema_and_records_agree_on_what_may_be_left_out(path: tuple[str | int, ...]) -> None:
    raw = changed(EACH, path, ...)
    with fields_alone():
        assert VALIDATOR.is_valid(raw) == accepted(raw)


@given(path=st.sampled_from(PATHS), value=VALUES)
def test_schema_and_records_agree_on_every_value(path: tuple[str | int, ...], value: object) -> None:
    raw = changed(EACH, path, value)
    valid = VALIDATOR.is_valid(raw)
    with fields_alone():
        assert valid == accepted(raw)
    if accepted(raw):
        assert valid
        whole = from_json(Document, raw)
        assert from_json(Document, json.loads(json.dumps(to_json(whole)))) == whole


@given(path=st.sampled_from([path for path in PATHS if isinstance(path[-1], str)]), key=st.text(max_size=5))
def test_schema_and_records_agree_on_other_keys(path: tuple[str | int, ...], key: str) -> None:
    parent: Any = EACH
    for step in path[:-1]:
        parent = parent[step]
    raw = changed(EACH, path[:-1], parent | {key: 1})
    with fields_alone():
        assert VALIDATOR.is_valid(raw) == accepted(raw)
