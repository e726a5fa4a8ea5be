"""Settings: the grid, the switches between the sources and what is right."""

from __future__ import annotations

import copy
import dataclasses
import pickle
import re

import pytest

from froxel_ref.records import InputError, from_json, to_json
from froxel_ref.settings import FIDELITIES, SWITCHES, Culling, Grid, SecondLobe, Settings, Switches, replace

# Which departure each switch is for, and what the sources do there (the tables of CONVENTIONS.md).
EXPECTED = {
    "albedo_at_zero": ("D1", "zero", "zero", "zero"),
    "emission": ("D2", "per_metre", "published", "published"),
    "integrator": ("D3", "analytic", "published", "published"),
    "accumulation": ("S2", "compensated", "plain", "plain"),
    "lookup": ("D4", "boundary", "centre", "centre"),
    "near_surface": ("A11", "fog", "first_slice", "first_slice"),
    "surface_term": ("D5", "outside", "outside", "outside"),
    "integrate_from": ("D6", "camera", "near", "near"),
    "phase_mixing": ("D12", "weighted", "mean", "mean"),
    "density_addressing": ("A5", "wrap", "wrap", "clamp"),
    "attenuation": ("A6", "min_distance", "min_distance", "inverse_radius"),
    "light_power": ("A6", "solid_angle", "solid_angle", "author"),
    "ambient": ("A7", "scene", "scene", "constant"),
    "exposure": ("A12", "display", "display", "lighting"),
    "beyond_cascades": ("A4", "lit", "lit", "dark"),
    "fom_samples": ("D7", "segments", "front", "dithered"),
    "fom_opacity": ("D8", "exact", "clamped", "clamped"),
    "fom_range": ("A8", "bounded", "radius", "fixed"),
    "fom_tiles": ("A8", "by_extent", "by_extent", "small"),
    "fom_lookup": ("S3", "per_texel", "filtered", "filtered"),
    "fom_sun": ("D16", "product", "product", "min"),
    "fom_spot": ("A3", "upright", "upright", "mirrored"),
    "fom_octahedron": ("A9", "from_light", "from_light", "to_light"),
    "fom_particles": ("A9", "hit", "hit", "centre"),
    "jitter": ("D10", "centred", "published", "author"),
    "checkerboard_parity": ("A1", "even", "even", "odd"),
    "checkerboard_fill": ("D11", "existing", "zero", "zero"),
    "filled_holes": ("S7", "replaced", "kept", "kept"),
    "inverse_tone_map": ("D9", "carried", "luma", "bounded"),
    "half_depth": ("A11", "nearest", "nearest", "farthest"),
    "long_density": ("S5", "mean", "sampled", "sampled"),
    "long_judged": ("S6", "texel", "tap", "tap"),
    "taa_points": ("D10", "centred", "published", "published"),
    "taa_space": ("A10", "ycocg", "rgb", "rgb"),
    "taa_border": ("A10", "inside", "repeat", "zero"),
    "taa_box": ("A10", "measured", "least", "padded"),
    "taa_weight": ("A10", "constant", "constant", "author"),
}


def test_every_switch_is_in_the_table_and_is_a_field() -> None:
    assert list(SWITCHES) == list(EXPECTED) == [field.name for field in dataclasses.fields(Switches)]


@pytest.mark.parametrize("name", SWITCHES)
def test_every_switch_says_which_departure_it_is_for(name: str) -> None:
    field = next(field for field in dataclasses.fields(Switches) if field.name == name)
    departures = re.match(r"([DAS]\d+(?:, [DAS]\d+)*): \S", field.metadata["kind"].about)
    assert departures is not None
    assert EXPECTED[name][0] in departures[1].split(", ")


@pytest.mark.parametrize("fidelity", FIDELITIES)
@pytest.mark.parametrize("name", SWITCHES)
def test_the_fidelity_sets_every_switch(name: str, fidelity: str) -> None:
    assert getattr(Settings(fidelity=fidelity), name) == EXPECTED[name][1 + FIDELITIES.index(fidelity)]


@pytest.mark.parametrize("fidelity", FIDELITIES)
@pytest.mark.parametrize(("name", "value"), [(name, value) for name in SWITCHES for value in SWITCHES[name]])
def test_a_single_switch_comes_before_the_fidelity(name: str, value: str, fidelity: str) -> None:
    settings = Settings(fidelity=fidelity, switches=Switches(**{name: value}))
    assert getattr(settings, name) == value
    others = [other for other in SWITCHES if other != name]
    assert [getattr(settings, o) for o in others] == [getattr(Settings(fidelity=fidelity), o) for o in others]


def test_replace_takes_switches_by_their_own_names() -> None:
    settings = replace(replace(Settings(), emission="published", time=2.0), lookup="centre")
    assert (settings.emission, settings.lookup, settings.time) == ("published", "centre", 2.0)
    assert settings.integrator == "analytic"


def test_replace_with_switches_and_a_switch() -> None:
    settings = replace(Settings(), switches=Switches(lookup="centre"), emission="published")
    assert (settings.emission, settings.lookup) == ("published", "centre")


SETTINGS = Settings(grid=Grid(width=3), fidelity="author", switches=Switches(emission="absorption"), time=1.5)


@pytest.mark.parametrize("again", [
    lambda settings: pickle.loads(pickle.dumps(settings)), copy.copy, copy.deepcopy, dataclasses.replace,
    replace, lambda settings: from_json(Settings, to_json(settings))],
    ids=["pickle", "copy", "deepcopy", "dataclasses.replace", "replace", "json"])
def test_settings_survive_being_copied(again) -> None:  # type: ignore[no-untyped-def]
    copied = again(SETTINGS)
    assert copied == SETTINGS
    assert hash(copied) == hash(SETTINGS)
    assert (copied.emission, copied.ambient) == ("absorption", "constant")


def test_an_unknown_name_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="Settings has no field or switch 'emision'"):
        _ = Settings().emision
    assert not hasattr(Settings(), "__array__")


@pytest.mark.parametrize(("raw", "message"), [
    ({"grid": {"width": 0}}, "grid.width: is 0, must be at least 1 and at most 65536"),
    ({"grid": {"height": -1}}, "grid.height: is -1, must be at least 1 and at most 65536"),
    ({"grid": {"depth": 1e9}}, "grid.depth: is 1000000000, must be at least 1 and at most 65536"),
    ({"grid": {"depth": 1.5}}, "grid.depth: is 1.5, must be a whole number"),
    ({"grid": {"near": 0}}, "grid.near: is 0, must be above 0 m"),
    ({"grid": {"near": 64}}, "grid.near: is 64 m, must be below far (64 m)"),
    ({"grid": {"far": float("inf")}}, "grid.far: is inf, must be a finite number"),
    ({"grid": {"distribution": "log"}}, "grid.distribution: is 'log', must be one of exponential, linear"),
    ({"gird": {}}, "gird: is not a key here; did you mean 'grid'?"),
    ({"fidelity": "right"}, "fidelity: is 'right', must be one of corrected, published, author"),
    ({"switches": {"lookup": "nearest"}}, "switches.lookup: is 'nearest', must be one of boundary, centre"),
    ({"second_lobe": {"phase_anisotropy": -1}},
     "second_lobe.phase_anisotropy: is -1, must be above -1 and below 1"),
    ({"second_lobe": {"weight": 1.5}}, "second_lobe.weight: is 1.5, must be at least 0 and at most 1"),
    ({"culling": {"tile": 0}}, "culling.tile: is 0, must be at least 1 and at most 16384 pixels"),
    ({"culling": {"bins": 2.5}}, "culling.bins: is 2.5, must be a whole number"),
    ({"culling": {"bin": 2}}, "culling.bin: is not a key here; did you mean 'bins'?"),
    ({"time": float("nan")}, "time: is nan, must be a finite number"),
    ({"precision": "float16"}, "precision: is 'float16', must be one of float64, float32"),
])
def test_what_is_refused_is_named_in_one_line(raw: object, message: str) -> None:
    with pytest.raises(InputError) as caught:
        from_json(Settings, raw)
    assert str(caught.value) == message


@pytest.mark.parametrize("cls", [Culling, Grid, Switches, SecondLobe, Settings])
def test_everything_is_described(cls: type) -> None:
    assert cls.__doc__
    assert [f.name for f in dataclasses.fields(cls) if not f.metadata["kind"].about] == []
