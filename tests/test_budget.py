"""The error budget: which parts a frame has, what replaces them, and sums that add up whatever the images are."""

from __future__ import annotations

import dataclasses
import itertools
import math
from functools import cache

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from froxel_ref import load
from froxel_ref.budget import Part, all_true, make_budget, only, parts_of
from froxel_ref.error_images import distance, last_image, make_subject, reference_image
from froxel_ref.frame import plan
from froxel_ref.presets import preset
from froxel_ref.quantities import final_result
from froxel_ref.report_record import Budget, LeftOut
from froxel_ref.scene import DirectionalLight, Medium, Particle, Scene
from froxel_ref.scene_files import Loaded, builtin
from froxel_ref.settings import (
    SWITCHES,
    AntiAliasing,
    FogLookup,
    Grid,
    LongRange,
    OpacityMaps,
    Settings,
    Switches,
    Temporal,
    replace,
)

NAMES = ("depth", "lateral", "opaque shadows", "volumetric shadows", "phase", "departures", "temporal filter",
         "checkerboard", "lookup", "long range", "particles' light", "storage", "anti-aliasing")
RASTER = (32, 18)


def parts(scene: Scene, settings: Settings) -> tuple[tuple[Part, ...], tuple[LeftOut, ...]]:
    return parts_of(scene, settings, plan(scene, settings, [final_result(settings)]), raster=RASTER)


def names(scene: Scene, settings: Settings) -> set[str]:
    return {part.name for part in parts(scene, settings)[0]}


@cache
def loaded(name: str, *overrides: str) -> Loaded:
    return load(name, overrides=list(overrides))


# --- which parts --------------------------------------------------------------------------------------


FOG = {"depth", "lateral"}


@pytest.mark.parametrize(("name", "overrides", "expected"), [
    ("vacuum", ["shadows=off"], set()),
    ("vacuum", [], {"opaque shadows"}),
    ("uniform", [], FOG),
    ("shaft", [], FOG | {"opaque shadows"}),
    ("shaft", ["shadows=exact"], FOG),
    ("shaft", ["shadows=off", "volumetric_shadows=maps"], FOG | {"volumetric shadows"}),
    ("shaft", ["shadows=off", "volumetric_shadows=exact"], FOG),
    ("shaft", ["shadows=off", "lookup=centre"], FOG | {"departures"}),
    ("shaft", ["shadows=off", "fidelity=published"], FOG | {"departures"}),
    ("uniform", ["phase_mixing=mean"], FOG),  # one medium
    ("long-range", ["shadows=off"], FOG | {"long range", "phase"}),
    ("long-range", ["shadows=off", "phase_mixing=mean"], FOG | {"long range", "phase"}),
    ("long-range", ["shadows=off", "phase_mixing=mixture", "long_range.march=false"], FOG),
    ("uniform", ["temporal.filter=scattering"], FOG | {"temporal filter"}),
    ("uniform", ["temporal.filter=media"], FOG | {"temporal filter"}),
    ("uniform", ["checkerboard=true"], FOG | {"checkerboard"}),
    ("vacuum", ["shadows=off", "checkerboard=true"], FOG | {"checkerboard"}),  # fog of frames before is remembered
    ("uniform", ["fog_lookup.method=noisy"], FOG | {"lookup"}),
    ("uniform", ["fog_lookup.method=biquadratic"], FOG | {"lookup"}),
    ("uniform", ["fog_lookup.bias=1"], FOG | {"lookup"}),
    ("uniform", ["fog_lookup.bias=0"], FOG),
    ("uniform", ["fog_lookup.stored=tone_mapped"], FOG | {"lookup"}),
    ("vacuum", ["shadows=off", "fog_lookup.method=noisy"], set()),
    ("uniform", ["precision=float32"], FOG | {"storage"}),
    ("uniform", ["fog_lookup.storage=float16"], FOG | {"storage"}),
    ("uniform", ["taa.storage=float16"], FOG | {"storage"}),
    ("uniform", ["opacity_maps.storage=float16"], FOG | {"storage"}),
    ("uniform", ["taa.on=true"], FOG | {"anti-aliasing"}),
    ("uniform", ["particles_lit_at=centre"], FOG),  # there are none
    ("particles-in-fog", ["shadows=off"], FOG | {"volumetric shadows", "phase"}),
    ("particles-in-fog", ["shadows=off", "particles_lit_at=centre"],
     FOG | {"volumetric shadows", "phase", "particles' light"}),
    ("uniform", ["merged=true"], FOG),  # the same image
    ("long-range", ["shadows=off", "merged=true"], FOG | {"long range", "phase"}),
])
def test_a_part_is_there_where_a_frame_makes_the_approximation(name: str, overrides: list[str],
                                                               expected: set[str]) -> None:
    scene, settings, _ = loaded(name, *overrides)
    assert names(scene, settings) == expected


def everything() -> tuple[Scene, Settings]:
    """A base that makes every approximation that there is."""
    scene, settings, _ = loaded("shaft")
    media = (*scene.global_media, Medium(extinction=0.01, phase_anisotropy=-0.5))
    scene = dataclasses.replace(scene, global_media=media, particles=(Particle(position=(0, 1, -2), size=0.5),),
                                lights=(*scene.lights, DirectionalLight(direction=(0, 1, 0.3), irradiance=(1, 1, 1))))
    return scene, replace(
        settings, grid=Grid(width=8, height=6, depth=8, far=4.0), volumetric_shadows="maps", fidelity="author",
        temporal=Temporal(filter="unphased", alpha=0.2, clamp="range"), checkerboard=True, merged=True,
        fog_lookup=FogLookup(method="noisy", bias=2.0, stored="tone_mapped", storage="float16", taps=2),
        long_range=LongRange(march=True, steps=4, sun_steps=2), precision="float32",
        particles_lit_at="centre",
        opacity_maps=OpacityMaps(storage="float16", harmonics=1), taa=AntiAliasing(on=True, storage="float16"))


def test_one_base_has_them_all() -> None:
    found, left = parts(*everything())
    assert tuple(part.name for part in found) == NAMES
    assert left == ()


@pytest.mark.parametrize("given", [(), ("thesis",)])
@pytest.mark.parametrize("name", builtin())
def test_what_is_left_out_is_the_rest_with_a_reason(name: str, given: tuple[str, ...]) -> None:
    scene, settings, _ = loaded(name, *(text for one in given for text in preset(one)))
    found, left = parts(scene, settings)
    both = [part.name for part in found] + [each.name for each in left]
    assert sorted(both) == sorted(NAMES)
    assert all(each.why for each in left)
    assert all(part.about and part.truth for part in found)
    if given and name != "vacuum":
        assert {"depth", "temporal filter", "checkerboard", "lookup", "anti-aliasing"} <= {part.name for part in found}


# --- what replaces them -------------------------------------------------------------------------------


@given(st.permutations(range(len(NAMES))))
def test_the_order_of_replacements_does_not_matter(order: list[int]) -> None:
    scene, settings = everything()
    found, _ = parts(scene, settings)
    for count in (2, 5, 12):
        chosen = [found[i] for i in order[:count]]
        assert all_true(settings, chosen) == all_true(settings, sorted(chosen, key=found.index))


@pytest.mark.parametrize("given", [(), ("thesis",)])
@pytest.mark.parametrize("name", builtin())
def test_any_two_replacements_commute(name: str, given: tuple[str, ...]) -> None:
    scene, settings, _ = loaded(name, *(text for one in given for text in preset(one)))
    found, _ = parts(scene, settings)
    for one, other in itertools.combinations(found, 2):
        assert one.replaced(other.replaced(settings)) == other.replaced(one.replaced(settings))
    for part in found:
        assert part.replaced(part.replaced(settings)) == part.replaced(settings) != settings


def test_a_part_that_is_replaced_is_gone() -> None:
    """And no other comes or goes with it; but for those that can only be made finer."""
    scene, settings = everything()
    every = set(NAMES)
    for part in parts(scene, settings)[0]:
        left = names(scene, part.replaced(settings))
        gone = set() if part.name in ("depth", "lateral", "long range") else {part.name}
        if part.name == "departures":
            gone = {"departures"}
        assert left == every - gone, part.name
    true = all_true(settings, parts(scene, settings)[0])
    assert names(scene, true) == {"depth", "lateral", "long range"}
    assert (true.grid, true.long_range.steps, true.long_range.noise) == (
        Grid(width=32, height=18, depth=32, far=4.0), 64, False)
    assert all(getattr(true, name) == switch[0] for name, switch in SWITCHES.items() if name != "phase_mixing")


def test_what_is_no_part_stays_as_it_is() -> None:
    """Other departures stay while phase functions are mixed exactly, and the other way round."""
    scene, settings = everything()
    by_name = {part.name: part for part in parts(scene, settings)[0]}
    mixed = by_name["phase"].replaced(settings)
    assert (mixed.phase_mixing, mixed.emission, mixed.exposure) == ("mixture", "published", "lighting")
    right = by_name["departures"].replaced(settings)
    assert (right.phase_mixing, right.emission, right.exposure) == ("mean", "per_metre", "display")
    single = replace(settings, switches=Switches(emission="absorption", jitter="off"), fidelity="corrected")
    assert by_name["departures"].replaced(single).switches == Switches(phase_mixing="weighted")
    assert by_name["lookup"].replaced(settings).fog_lookup == FogLookup(storage="float16", taps=2)
    assert by_name["storage"].replaced(settings).fog_lookup == FogLookup(
        method="noisy", bias=2.0, stored="tone_mapped", taps=2)


def test_one_alone_is_all_others_replaced() -> None:
    scene, settings = everything()
    found, _ = parts(scene, settings)
    for part in found:
        alone = only(settings, found, part)
        assert part.replaced(alone) == all_true(settings, found) != alone


def test_slices_of_the_truth_are_as_many_as_asked_for() -> None:
    scene, settings, _ = loaded("uniform")
    planned = plan(scene, settings)
    depths = [parts_of(scene, settings, planned, raster=(5, 3), refine=refine)[0][0].replaced(settings).grid.depth
              for refine in (2, 8)]
    assert depths == [2 * settings.grid.depth, 8 * settings.grid.depth]
    lateral = parts_of(scene, settings, planned, raster=(5, 3))[0][1].replaced(settings).grid
    assert (lateral.width, lateral.height, lateral.depth) == (5, 3, settings.grid.depth)


# Mean |error| over the mean with everything true and 4, 16 and 64 times as many slices as the base's 8, as measured.
RESTS = {"shaft": (0.0783, 0.0187, 0.0056), "two-volumes": (0.0301, 0.0061, 0.0020), "leak": (0.0627, 0.0026, 0.0009),
         "lights": (0.0246, 0.0034, 0.0021), "thin-layer": (0.0288, 0.0090, 0.0001),
         "ghosting": (0.0746, 0.0187, 0.0053)}


@pytest.mark.parametrize("name", RESTS)
def test_with_everything_true_the_rest_is_of_slices_alone(name: str) -> None:
    """It falls as these get more, and is below 0.6 % in the end, where the base has 18 % and more."""
    found = make_subject(load(name, overrides=["grid.width=8", "grid.height=6", "grid.depth=8", "camera.width=32",
                                               "camera.height=18", "fidelity=published"]), pixels=1000, frames=1)
    there, how, _ = found.now(found.settings)
    truth = reference_image(found, rtol=1e-4).radiance
    rests = []
    for refine in (4, 16, 64):
        replacing, _ = parts_of(there, how, plan(there, how), raster=RASTER, refine=refine)
        assert {"departures", "depth", "lateral"} <= {part.name for part in replacing}
        rests.append(distance(last_image(found, all_true(found.settings, replacing)), truth, epsilon=0.01).absolute)
    assert rests == pytest.approx(RESTS[name], abs=5e-4)
    assert rests[2] < 0.006
    assert distance(last_image(found, found.settings), truth, epsilon=0.01).absolute > max(0.17, 2.0 * rests[0])


# --- the sums -----------------------------------------------------------------------------------------


SHAPE = (3, 2, 4)
IMAGES = arrays(np.float64, SHAPE, elements=st.floats(-10.0, 10.0, width=32))
MASKS = arrays(np.int64, SHAPE[1:], elements=st.integers(0, 2))


def part(name: str) -> Part:
    return Part(name, f"about {name}", f"truth of {name}", lambda how: how)


def budget_of(images: list[np.ndarray], masks: np.ndarray, count: int, epsilon: float = 0.01) -> Budget:
    """Of truth, whole, none, then two images for each part."""
    truth, whole, none, *others = images
    names = [f"part {i}" for i in range(count)]
    return make_budget([part(name) for name in names], [LeftOut("other", "it is off")], truth=truth, whole=whole,
                       none=none, alone=dict(zip(names, others[:count], strict=True)),
                       without=dict(zip(names, others[count:], strict=True)), epsilon=epsilon,
                       regions={f"region {k}": masks == k for k in range(3)})


def scalar(u: np.ndarray, v: np.ndarray, truth: np.ndarray, epsilon: float, among: np.ndarray | None = None) -> float:
    """Mean of u·v/(T² + ε), one value at a time; of a region the rest counts as 0."""
    terms = []
    for index in np.ndindex(u.shape):
        inside = among is None or bool(among[index[1:]])
        terms.append(float(u[index]) * float(v[index]) / (float(truth[index]) ** 2 + epsilon) if inside else 0.0)
    return math.fsum(terms) / len(terms)


@given(st.integers(0, 3).flatmap(lambda n: st.tuples(st.just(n), st.lists(IMAGES, min_size=3 + 2 * n,
                                                                          max_size=3 + 2 * n))), MASKS)
def test_shares_rest_and_interaction_add_up_whatever_the_images(drawn: tuple[int, list[np.ndarray]],
                                                                masks: np.ndarray) -> None:
    count, images = drawn
    images[1][0, 0, 0] = images[0][0, 0, 0] + 1.0  # or there is no error to share out
    found = budget_of(images, masks, count)
    sizes = [abs(each.share) for each in found.parts] + [abs(found.rest), abs(found.interaction), 1.0]
    whole = sum(each.share for each in found.parts) + found.rest + found.interaction
    assert whole == pytest.approx(1.0, abs=1e-13 * sum(sizes))
    # And so do regions, of the total and of each part.
    assert sum(found.regions.values()) == pytest.approx(1.0)
    assert sum(found.region_totals.values()) == pytest.approx(1.0, abs=1e-13)
    for each in found.parts:
        assert sum(each.regions.values()) == pytest.approx(each.share, abs=1e-13 * sum(sizes))
    assert [each.share for each in found.parts] == sorted((each.share for each in found.parts), reverse=True)
    assert found.left_out == (LeftOut("other", "it is off"),)


@given(st.lists(IMAGES, min_size=7, max_size=7), MASKS, st.sampled_from([0.01, 1.0]))
def test_each_number_is_its_definition(images: list[np.ndarray], masks: np.ndarray, epsilon: float) -> None:
    images[1][0, 0, 0] = images[0][0, 0, 0] + 1.0
    images[0][2, 1, 3] = 1.0
    truth, whole, none, a, b, without_a, without_b = images
    found = budget_of(images, masks, 2, epsilon)
    error = whole - truth

    def near(value: float, u: np.ndarray, v: np.ndarray, over: float = 1.0, among: np.ndarray | None = None) -> None:
        size = scalar(np.abs(u), np.abs(v), truth, epsilon) / over
        assert value == pytest.approx(scalar(u, v, truth, epsilon, among) / over, abs=1e-12 * size + 1e-300)

    total = scalar(error, error, truth, epsilon)
    near(found.total, error, error)
    near(found.rest, none - truth, error, total)
    near(found.rest_relmse, none - truth, none - truth)
    # What comes first, to nothing else, and what comes last, to all else: each counts by half.
    added = {"part 0": 0.5 * ((a - none) + (whole - without_a)), "part 1": 0.5 * ((b - none) + (whole - without_b))}
    together = error - added["part 0"] - added["part 1"] - (none - truth)
    near(found.interaction_relmse, together, together)
    by_name = {each.name: each for each in found.parts}
    for name, alone, without in (("part 0", a, without_a), ("part 1", b, without_b)):
        near(by_name[name].alone, alone - none, alone - none)
        near(by_name[name].without, without - truth, without - truth)
        near(by_name[name].share, added[name], error, total)
        mean = math.fsum(abs(float(v)) for v in truth.ravel()) / truth.size
        assert by_name[name].bias == pytest.approx(
            math.fsum(float(v) for v in added[name].ravel()) / truth.size / mean, rel=1e-9, abs=1e-9)
        for k in range(3):
            near(by_name[name].regions[f"region {k}"], added[name], error, total, masks == k)
        assert (by_name[name].about, by_name[name].truth) == (f"about {name}", f"truth of {name}")
    for k in range(3):
        near(found.region_totals[f"region {k}"], error, error, total, masks == k)
        assert found.regions[f"region {k}"] == np.count_nonzero(masks == k) / masks.size


@given(st.lists(IMAGES, min_size=9, max_size=9), MASKS)
def test_the_claim_holds_within_its_slack(images: list[np.ndarray], masks: np.ndarray) -> None:
    """The roots of two sizes differ by at most the size of the difference, whatever the images are."""
    images[1][0, 0, 0] = images[0][0, 0, 0] + 1.0
    found = budget_of(images, masks, 3)
    claim = found.claim
    assert claim is not None
    assert claim.name == found.parts[0].name
    assert claim.measured == found.parts[0].without
    assert abs(math.sqrt(claim.claimed) - math.sqrt(claim.measured)) <= claim.slack * (1 + 1e-12) + 1e-12
    number = int(claim.name[-1])
    truth, whole, none = images[:3]
    more = whole - images[6 + number]
    adds = 0.5 * (images[3 + number] - none + more)
    assert claim.slack == pytest.approx(math.sqrt(scalar(more - adds, more - adds, truth, 0.01)), rel=1e-9, abs=1e-12)
    left = whole - truth - adds
    assert claim.claimed == pytest.approx(scalar(left, left, truth, 0.01), rel=1e-9, abs=1e-12)


def test_parts_that_interact_in_pairs_share_what_they_do_together() -> None:
    """Of what two do together each has half, and nothing is left for more than two."""
    rng = np.random.default_rng(5)
    truth, none, a, b, c, ab, ac, bc, abc = rng.uniform(0.5, 2.0, (9, *SHAPE))
    whole = none + a + b + c + ab + ac + bc
    without = [none + b + c + bc, none + a + c + ac, none + a + b + ab]
    found = budget_of([truth, whole, none, none + a, none + b, none + c, *without], np.zeros(SHAPE[1:], int), 3)
    assert found.interaction_relmse == pytest.approx(0.0, abs=1e-28)
    shares = {each.name: each.share for each in found.parts}
    expected = {"part 0": a + 0.5 * (ab + ac), "part 1": b + 0.5 * (ab + bc), "part 2": c + 0.5 * (ac + bc)}
    for name, image in expected.items():
        assert shares[name] == pytest.approx(scalar(image, whole - truth, truth, 0.01) / found.total, rel=1e-12)
    more = budget_of([truth, whole + abc, none, none + a, none + b, none + c, *without], np.zeros(SHAPE[1:], int), 3)
    assert more.interaction_relmse > 0.1 * scalar(abc, abc, truth, 0.01)


def test_a_part_that_was_not_tried_alone_has_what_it_adds_last() -> None:
    rng = np.random.default_rng(6)
    truth, whole, none, a, without_a, without_b = rng.uniform(0.5, 2.0, (6, *SHAPE))
    parts = [Part(name, "", "", lambda how: how) for name in ("one", "two")]
    found = make_budget(parts, [], truth=truth, whole=whole, none=none, alone={"one": a},
                        without={"one": without_a, "two": without_b}, epsilon=0.01,
                        regions={"all": np.ones(SHAPE[1:], bool)})
    two = next(each for each in found.parts if each.name == "two")
    assert two.alone is None
    assert two.share == pytest.approx(scalar(whole - without_b, whole - truth, truth, 0.01) / found.total, rel=1e-12)
    assert sum(each.share for each in found.parts) + found.rest + found.interaction == pytest.approx(1.0, abs=1e-12)
    assert found.claim is not None
    assert found.claim.name == "one"


def test_parts_that_simply_add_up_leave_nothing() -> None:
    """Without interaction the claim is what is measured."""
    rng = np.random.default_rng(3)
    truth, rest, a, b = rng.uniform(0.5, 2.0, (4, *SHAPE))
    none = truth + 0.01 * rest
    images = [truth, none + a + b, none, none + a, none + b, none + b, none + a]
    found = budget_of(images, np.zeros(SHAPE[1:], int), 2)
    assert found.interaction == pytest.approx(0.0, abs=1e-14)
    assert found.interaction_relmse == pytest.approx(0.0, abs=1e-28)
    assert found.claim is not None
    assert found.claim.slack == pytest.approx(0.0, abs=1e-14)
    assert found.claim.claimed == pytest.approx(found.claim.measured, rel=1e-12)
    assert found.regions == {"region 0": 1.0, "region 1": 0.0, "region 2": 0.0}


def test_without_parts_all_is_rest() -> None:
    rng = np.random.default_rng(4)
    truth, whole = rng.uniform(0.5, 2.0, (2, *SHAPE))
    found = budget_of([truth, whole, whole], np.zeros(SHAPE[1:], int), 0)
    assert (found.parts, found.claim, found.interaction) == ((), None, 0.0)
    assert found.rest == pytest.approx(1.0, rel=1e-14)


def test_without_an_error_there_are_no_shares() -> None:
    truth = np.ones(SHAPE)
    found = budget_of([truth] * 5, np.zeros(SHAPE[1:], int), 1)
    assert (found.total, found.parts[0].share, found.rest, found.interaction) == (0.0, 0.0, 0.0, 0.0)
    black = budget_of([np.zeros(SHAPE), truth, np.zeros(SHAPE), truth, np.zeros(SHAPE)], np.zeros(SHAPE[1:], int), 1)
    assert (black.parts[0].bias, round(black.parts[0].share, 12)) == (0.0, 1.0)
