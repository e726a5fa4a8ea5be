"""Knobs: what each turns to is allowed or refused in a line, can be typed, and is like nothing else of the knob."""

from __future__ import annotations

import dataclasses
from functools import cache

import pytest

from froxel_ref import load
from froxel_ref.frame import plan
from froxel_ref.knobs import KNOBS, Knob, changed, chosen, own_knob
from froxel_ref.presets import preset
from froxel_ref.quantities import final_result
from froxel_ref.records import InputError
from froxel_ref.scene import Medium, Scene
from froxel_ref.scene_files import Loaded, builtin
from froxel_ref.settings import SWITCHES, FogLookup, Grid, OpacityMaps, Settings, ShadowMaps, Temporal, replace

BASES = [(name, given) for name in builtin() for given in ((), ("thesis",))]

# What does not go with a base, by knob and label. The preset merges media and lighting, which leaves the filter of
# media nothing to filter.
REFUSED = {(): set(), ("thesis",): {("temporal", "media, α 0.2")}}


@cache
def base(name: str, given: tuple[str, ...]) -> Loaded:
    return load(name, overrides=[text for one in given for text in preset(one)])


def tried(settings: Settings, overrides: tuple[str, ...]) -> Settings | InputError:
    """Settings with overrides, or why not."""
    try:
        return changed(settings, overrides)
    except InputError as error:
        return error


def spelt_out(settings: Settings) -> tuple[object, ...]:
    """Settings by what they come to: all fields and the values of all switches."""
    fields = [getattr(settings, field.name) for field in dataclasses.fields(settings)
              if field.name not in ("fidelity", "switches")]
    return (*fields, *(getattr(settings, name) for name in SWITCHES))


def steps_of(settings: Settings) -> list[tuple[Knob, object]]:
    return [(knob, step) for knob in KNOBS for step in knob.steps(settings)]


# --- every step ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(("name", "given"), BASES)
def test_each_step_is_allowed_or_refused_in_a_line(name: str, given: tuple[str, ...]) -> None:
    settings = base(name, given).settings
    refused = set()
    for knob, step in steps_of(settings):
        found = tried(settings, step.overrides)
        if isinstance(found, InputError):
            assert found.place
            assert "\n" not in str(found)
            assert "must be" in found.problem
            refused.add((knob.name, step.label))
    assert refused == REFUSED[given]


@pytest.mark.parametrize(("name", "given"), [("thesis-hall", ()), ("thesis-hall", ("thesis",)), ("long-range", ()),
                                             ("particles-in-fog", ("thesis",))])
def test_each_step_can_be_typed(name: str, given: tuple[str, ...]) -> None:
    """What `changed` makes of the base is what the command line makes of the scene."""
    loaded, typed = base(name, given), [text for one in given for text in preset(one)]
    for knob, step in steps_of(loaded.settings):
        if (knob.name, step.label) not in REFUSED[given]:
            again = load(name, overrides=[*typed, *step.overrides])
            assert again.settings == changed(loaded.settings, step.overrides), step
            assert again.scene == loaded.scene


@pytest.mark.parametrize(("name", "given"), BASES)
def test_no_two_steps_of_a_knob_are_alike(name: str, given: tuple[str, ...]) -> None:
    """Of a knob that the scene has a use for: one at most is the base itself."""
    loaded = base(name, given)
    for knob in (knob for knob in KNOBS if knob.name in needed(loaded.scene, loaded.settings)):
        steps = [step for step in knob.steps(loaded.settings) if (knob.name, step.label) not in REFUSED[given]]
        made = [(spelt_out(changed(loaded.settings, step.overrides)), step.frames) for step in steps]
        assert len(set(made)) == len(steps), knob.name
        assert len({step.label for step in steps}) == len(steps), knob.name
        assert any(step.quick for step in steps) == (knob.name != "whole")


def test_every_knob_turns_something() -> None:
    """No step changes what its knob does not name, and each knob has two that are not the base, if there are two."""
    settings = Settings()
    fields = {"grid": {"grid"}, "slices": {"grid"}, "grid and slices": {"grid"}, "distribution": {"grid"},
              "integrator": {"switches"}, "phase": {"switches"}, "shadows": {"shadow_maps", "shadows"},
              "opacity maps": {"opacity_maps", "volumetric_shadows"}, "temporal": {"temporal"},
              "checkerboard": {"checkerboard", "temporal"}, "merged": {"merged"}, "lookup": {"fog_lookup", "switches"},
              "long range": {"long_range"}, "precision": {"precision", "fog_lookup", "opacity_maps", "taa"},
              "anti-aliasing": {"taa"}, "fidelity": {"fidelity"}}
    for knob in KNOBS:
        others = [changed(settings, step.overrides) for step in knob.steps(settings)]
        assert sum(other != settings for other in others) >= (1 if knob.name in ("merged", "distribution") else 2)
        found = {name for other in others for name in vars(settings) if getattr(other, name) != getattr(settings, name)}
        assert found == fields.get(knob.name, found)


def test_steps_are_of_the_base_that_they_are_given() -> None:
    """Sizes are shares of the base's, and what is on is turned off."""
    settings = Settings(grid=Grid(width=24, height=14, depth=8), checkerboard=True, merged=True,
                        temporal=Temporal(filter="scattering"))
    by_name = {knob.name: knob.steps(settings) for knob in KNOBS}
    assert [step.label for step in by_name["grid"]] == ["6x4", "12x7", "18x10", "36x21", "48x28"]
    assert [step.overrides for step in by_name["slices"]] == [(f"grid.depth={n}",) for n in (1, 2, 4, 12, 16, 32)]
    assert by_name["checkerboard"][0].overrides == ("checkerboard=false",)
    assert by_name["merged"][0].overrides == ("merged=false",)
    sizes = {(24, 14, 8): 1.0}
    for step in by_name["grid and slices"]:
        grid = changed(settings, step.overrides).grid
        sizes[grid.width, grid.height, grid.depth] = grid.width * grid.height * grid.depth / (24 * 14 * 8)
    assert len(sizes) == 1 + len(by_name["grid and slices"]) == 16
    assert all(0.1 <= share <= 9.0 for share in sizes.values())  # ⅛ to 8, and whole numbers of froxels


@pytest.mark.parametrize("maps", [
    {}, {"atlas": 16384}, {"atlas": 8192, "large": 4096, "small": 4096}, {"directional_size": 16},
    {"smallest": 8, "gutter": 2}, {"gutter": 8}, {"smallest": 4096, "small": 4096, "large": 4096, "atlas": 4096},
    {"directional_size": 4096}])
def test_tiles_are_larger_where_they_can_be_and_never_smaller(maps: dict[str, int]) -> None:
    settings = Settings(opacity_maps=OpacityMaps(**maps))
    knob = next(knob for knob in KNOBS if knob.name == "opacity maps")
    steps = {step.label: step for step in knob.steps(settings)}
    larger = changed(settings, steps["tiles x2"].overrides).opacity_maps
    for name, most in (("small", 4096), ("large", 4096), ("smallest", 4096), ("atlas", 16384),
                       ("directional_size", 4096)):
        assert getattr(larger, name) == min(most, 2 * getattr(settings.opacity_maps, name))
    if "tiles x1/2" in steps and maps != {"directional_size": 16}:
        assert changed(settings, steps["tiles x1/2"].overrides).opacity_maps.large == settings.opacity_maps.large // 2


@pytest.mark.parametrize("maps", [{"point_map": "octahedral"}, {"technique": "exponential"}, {"kernel": 15},
                                  {"directional_size": 16384, "spot_size": 64, "point_size": 64}])
def test_steps_of_shadow_maps_are_judged_with_the_rest(maps: dict[str, object]) -> None:
    """Each is allowed or refused in a line whatever the base's maps are; sizes are multiples of what they must be."""
    settings = Settings(shadow_maps=ShadowMaps(**maps))
    knob = next(knob for knob in KNOBS if knob.name == "shadows")
    found = {step.label: tried(settings, step.overrides) for step in knob.steps(settings)}
    assert all(each.place.startswith("settings.shadow_maps") for each in found.values() if isinstance(each, InputError))
    allowed = {label for label, each in found.items() if isinstance(each, Settings)}
    assert {"exact", "maps x1/2"} <= allowed
    assert ("maps x2" in allowed) == (settings.shadow_maps.directional_size < 16384)


# --- what a scene has a use for -----------------------------------------------------------------------


def needed(scene: Scene, settings: Settings) -> dict[str, str]:
    """The knobs that a scene has a use for, with the reason; and that each has one."""
    planned = plan(scene, settings, [final_result(settings)])
    found = {knob.name: knob.needed(scene, settings, planned) for knob in KNOBS}
    assert all(why for _, why in found.values())
    return {name: why for name, (there, why) in found.items() if there}


ALWAYS = {"precision", "anti-aliasing", "fidelity"}
FOG = {"grid", "slices", "grid and slices", "distribution", "integrator", "temporal", "checkerboard", "merged",
       "lookup", "whole"}


@pytest.mark.parametrize(("name", "overrides", "expected"), [
    ("vacuum", [], ALWAYS | {"shadows"}),
    ("vacuum", ["shadows=off"], ALWAYS),
    ("vacuum", ["shadows=exact"], ALWAYS),
    ("uniform", [], ALWAYS | FOG),
    ("uniform", ["volumetric_shadows=maps"], ALWAYS | FOG),  # media without end do not dim suns
    ("shaft", [], ALWAYS | FOG | {"shadows"}),
    ("shaft", ["volumetric_shadows=maps"], ALWAYS | FOG | {"shadows", "opacity maps"}),
    ("long-range", [], ALWAYS | FOG | {"shadows", "long range", "phase"})])
def test_a_knob_is_turned_where_it_can_matter(name: str, overrides: list[str], expected: set[str]) -> None:
    loaded = load(name, overrides=overrides)
    assert set(needed(loaded.scene, loaded.settings)) == expected


def test_phase_functions_are_mixed_where_media_that_scatter_differ() -> None:
    fog, soot = Medium(extinction=0.1, phase_anisotropy=0.5), Medium(extinction=0.1, albedo=(0, 0, 0))
    other = Medium(extinction=0.1, phase_anisotropy=0.2)
    for media, expected in (((fog,), False), ((fog, soot), False), ((fog, other), True),
                            ((fog, Medium(extinction=0.0, phase_anisotropy=0.2)), False)):
        assert ("phase" in needed(Scene(global_media=media), Settings())) == expected


# --- overrides ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("text", ["camera.width=4", "scene.camera.width=4", "lights[0].radius=3", "name=mine",
                                  "scene.name=", "scene.lights[2].intensity=[1,1,1]", "global_media[0].extinction=1",
                                  "camera.wdith=4", "surfaces=[]", "scene={}"])
def test_what_is_of_the_scene_is_refused_as_such(text: str) -> None:
    with pytest.raises(InputError) as fault:
        changed(Settings(), [text])
    assert fault.value.place == text.partition("=")[0]
    assert fault.value.problem == "is of the scene, must be a setting: errors are taken against one truth"


@pytest.mark.parametrize(("text", "words"), [
    ("grid.fra=16", r"settings.grid.fra: is not a key here; did you mean 'far'\?"),
    ("gird.far=16", r"gird: is not a key here; did you mean 'grid'\?"),
    ("grid.far=0", r"settings.grid.far: is 0"),
    ("grid.far", r"override: 'grid.far' has no '=', must be path=value"),
    ("grid.depth=2.5", r"settings.grid.depth: is 2.5"),
    ("emission=none", r"settings.switches.emission: is 'none'"),
])
def test_what_is_wrong_with_a_setting_is_said(text: str, words: str) -> None:
    with pytest.raises(InputError, match=words):
        changed(Settings(), [text])


def test_overrides_are_applied_one_after_the_other() -> None:
    found = changed(Settings(), ["grid.far=16", "settings.grid.near=2", "emission=published", "grid.far=32"])
    assert found == replace(Settings(grid=Grid(near=2, far=32)), emission="published")
    assert changed(found, []) == found


# --- knobs of one's own -------------------------------------------------------------------------------


@pytest.mark.parametrize(("text", "name", "labels"), [
    ("grid.far=16,32", "grid.far", ["16", "32"]),
    ("settings.grid.far=16", "grid.far", ["16"]),
    (" grid.far = 16 , 32 , ", "grid.far", ["16", "32"]),
    ("emission=published", "emission", ["published"]),
    ('temporal={"filter": "scattering", "alpha": 0.5},{"filter": "off"}', "temporal",
     ['{"filter": "scattering", "alpha": 0.5}', '{"filter": "off"}']),
    ("a.b=[1,[2,3]],[4,5]", "a.b", ["[1,[2,3]]", "[4,5]"]),
    ("shadow_maps.reach=null,8", "shadow_maps.reach", ["null", "8"]),
    ("a=b=c,d", "a", ["b=c", "d"])])
def test_a_knob_of_ones_own(text: str, name: str, labels: list[str]) -> None:
    knob = own_knob(text)
    steps = knob.steps(Settings())
    assert (knob.name, [step.label for step in steps]) == (name, labels)
    assert [step.overrides for step in steps] == [(f"{name}={label}",) for label in labels]
    assert all(step.quick and step.frames is None for step in steps)
    assert knob.needed(Scene(), Settings(), plan(Scene()))[0]


def test_values_of_ones_own_are_json() -> None:
    one, other = own_knob('temporal={"filter": "scattering", "alpha": 0.5},{"filter": "off"}').steps(Settings())
    assert changed(Settings(), one.overrides).temporal == Temporal(filter="scattering", alpha=0.5)
    assert changed(Settings(), other.overrides) == Settings()
    found = changed(Settings(fog_lookup=FogLookup(bias=1.0)), own_knob("fog_lookup.bias=null").steps(Settings())[0][1])
    assert found.fog_lookup.bias is None


@pytest.mark.parametrize(("text", "words"), [
    ("grid.far", "is 'grid.far', must be path=value,value,…"),
    ("=16,32", "is '=16,32', must be path=value,value,…"),
    (" = ", "is ' = ', must be path=value,value,…"),
    ("", "is '', must be path=value,value,…"),
    ("grid.far=", "is 'grid.far=': an empty sweep, must have a value at least"),
    ("grid.far= , ,", "is 'grid.far= , ,': an empty sweep, must have a value at least")])
def test_a_sweep_that_is_none(text: str, words: str) -> None:
    with pytest.raises(InputError) as fault:
        own_knob(text)
    assert (fault.value.place, fault.value.problem) == ("--sweep", words)


def test_knobs_are_chosen_by_name() -> None:
    assert chosen(None) is KNOBS
    assert [knob.name for knob in chosen(["whole", "grid", "grid"])] == ["grid", "whole"]
    assert len({knob.name for knob in KNOBS}) == len(KNOBS)
    with pytest.raises(InputError, match=r"--knobs: has 'slice'; did you mean 'slices'\?"):
        chosen(["grid", "slice"])
    with pytest.raises(InputError, match="--knobs: is empty, must name some of grid, slices"):
        chosen([])
