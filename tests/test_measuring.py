"""Times and memory of frames: what is run, what is counted, what leaving out saves."""

from __future__ import annotations

import threading
import tracemalloc
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from froxel_ref import load, measuring
from froxel_ref.assets import load_assets
from froxel_ref.error_images import Subject, make_subject
from froxel_ref.frame import Frame, run_frame
from froxel_ref.measuring import Timed, frames_of, left_out_of, measure_saved, peak_bytes, timed
from froxel_ref.presets import preset
from froxel_ref.quantities import final_result
from froxel_ref.report_record import LeftOut
from froxel_ref.settings import AntiAliasing, FogLookup, Settings, Temporal, replace

SMALL = ["grid.width=8", "grid.height=6", "grid.depth=8", "camera.width=32", "camera.height=18"]


def subject(name: str, *overrides: str, frames: int = 4) -> Subject:
    return make_subject(load(name, overrides=[*SMALL, *overrides]), pixels=150, frames=frames)


# --- memory -------------------------------------------------------------------------------------------


MB = 1 << 20


def test_memory_is_the_most_at_one_moment() -> None:
    """Not the sum of what is taken one after the other, and not what was there before."""
    before = np.ones(4 * MB // 8)

    def run() -> None:
        for _ in range(5):
            np.ones(2 * MB // 8)
        first = np.ones(MB // 8)
        np.ones(MB // 8)
        del first

    assert 2 * MB <= peak_bytes(run) < 2.1 * MB
    assert before.nbytes == 4 * MB


def test_memory_of_threads_counts() -> None:
    """Four threads hold their arrays at the same time."""
    together = threading.Barrier(4)

    def hold(_: int) -> None:
        array = np.ones(MB // 8)
        together.wait(timeout=30)
        del array

    with ThreadPoolExecutor(4) as pool:
        assert 4 * MB <= peak_bytes(lambda: list(pool.map(hold, range(4)))) < 4.3 * MB


def test_memory_of_a_frames_own_threads_counts() -> None:
    """All results of a frame are held in the end, whatever thread made them."""
    scene, settings, _ = load("shaft", overrides=SMALL)
    for threads in (1, 4):
        held = []
        peak = peak_bytes(lambda threads=threads, held=held: held.append(run_frame(scene, settings, threads=threads)))
        arrays = {id(field.base if field.base is not None else field): field for field in held[0].results.values()}
        assert peak > sum(array.nbytes for array in arrays.values()) > 50_000


def test_tracing_is_left_as_it_was() -> None:
    def broken() -> None:
        raise ValueError("no")

    def caught() -> None:
        with pytest.raises(ValueError, match="no"):
            peak_bytes(broken)

    for ends in (lambda: peak_bytes(lambda: None), caught):
        assert not tracemalloc.is_tracing()
        ends()
        assert not tracemalloc.is_tracing()
        tracemalloc.start()
        try:
            ends()
            assert tracemalloc.is_tracing()
        finally:
            tracemalloc.stop()


def test_what_was_traced_before_does_not_count() -> None:
    tracemalloc.start()
    try:
        before = np.ones(4 * MB // 8)
        assert MB <= peak_bytes(lambda: np.ones(MB // 8)) < 1.1 * MB
        assert peak_bytes(lambda: None) < 0.1 * MB
        assert before.nbytes == 4 * MB
    finally:
        tracemalloc.stop()


# --- frames -------------------------------------------------------------------------------------------


AVERAGED = Settings(temporal=Temporal(filter="scattering", alpha=0.2), taa=AntiAliasing(on=True))


def test_frames_go_on_from_the_call_before_with_maps_made_anew() -> None:
    found = subject("shaft", "volumetric_shadows=maps", "temporal.filter=scattering", "taa.on=true")
    run = frames_of(found, found.settings)
    scene, how, assets = found.now(found.settings)
    previous, kept = None, None
    for number in range(4):
        frame = run()
        previous = run_frame(scene, how, assets=assets, outputs=[final_result(how)], previous=previous, frame=number)
        np.testing.assert_array_equal(frame.image, previous.image)
        # A frame that is handed the maps of the one before takes them over; these do not.
        assert frame.reused == ()
        assert bool(previous.reused) == (number > 0)
        assert {"shadow", "fom"} <= set(frame.timings)
        assert list(frame.results) == [final_result(how)]
        assert frame.history is not None
        assert frame.history.length == number + 1
        assert kept is None or not np.array_equal(kept, frame.image)
        kept = frame.image


def test_frames_without_a_history_differ_by_their_number_alone() -> None:
    found = subject("uniform")
    noisy = replace(found.settings, fog_lookup=FogLookup(method="noisy"))
    for how, same in ((found.settings, True), (noisy, False)):
        run = frames_of(found, how)
        first, second = run(), run()
        assert np.array_equal(first.image, second.image) == same
        expected = run_frame(found.loaded.scene, replace(how, time=3 / 30), frame=1)
        np.testing.assert_array_equal(second.image, expected.image)
        assert second.history is None


def test_frames_are_of_the_scenes_own_size_at_the_moment_that_is_looked_at() -> None:
    found = subject("ghosting", "camera.width=48", "camera.height=27", frames=20)
    run = frames_of(found, found.settings)
    first, second = run(), run()
    assert first.image.shape == (3, 27, 48)
    assert (found.small.camera.width, found.small.camera.height) == (20, 11)
    assert first.scene == second.scene == found.now(found.settings)[0] != found.loaded.scene
    assert first.settings.time == second.settings.time == 19 / 30


def test_a_time_is_that_of_the_call() -> None:
    found = subject("shaft")
    run = frames_of(found, found.settings)
    frames: list[Frame] = []

    def kept() -> Frame:
        frames.append(run())
        return frames[-1]

    times = timed(kept)
    assert isinstance(times, Timed)
    assert times.stages == dict(frames[0].timings)
    assert times.seconds > sum(times.stages.values()) > 0.0
    assert len(frames) == 1


# --- what leaving out saves ---------------------------------------------------------------------------


@pytest.mark.parametrize(("name", "given"), [
    ("uniform", ()), ("shaft", ()), ("vacuum", ()), ("long-range", ()), ("particles-in-fog", ("thesis",)),
    ("shaft", ("thesis",)), ("uniform", ("thesis",))])
def test_leaving_out_changes_nothing(name: str, given: tuple[str, ...]) -> None:
    scene, settings, _ = load(name, overrides=[*SMALL, *(text for one in given for text in preset(one))])
    told: list[tuple[int, int]] = []
    saved = measure_saved(scene, settings, load_assets(scene, None), repeats=2,
                          tell=lambda done, count: told.append((done, count)))
    assert saved.same is True
    assert told == [(0, 4), (1, 4), (2, 4), (3, 4)]
    assert saved.planned.runs == saved.forced.runs == 2
    for spread in (saved.planned, saved.forced):
        assert 0.0 < spread.least <= spread.median == spread.end
    # Measured: 0.98 times as much (where shadow maps are most of it; the first run makes tables) to 5 times (uniform).
    assert saved.forced_bytes > 0.95 * saved.planned_bytes > 0
    assert saved.left_out == left_out_of(run_frame(scene, settings))


def test_what_is_left_out_is_named_with_its_reason() -> None:
    scene, settings, _ = load("shaft", overrides=SMALL)
    frame = run_frame(scene, settings)
    found = left_out_of(frame)
    assert LeftOut("fom", "volumetric shadows are off") in found
    assert LeftOut("shadow: directional lights", "none that a surface may hide") in found
    names = [each.name for each in found]
    assert len(set(names)) == len(names)
    assert "shadow" not in names
    assert {each.name for each in found if ":" not in each.name} == {p.name for p in frame.plan.left_out}


@pytest.mark.parametrize("change", ["value", "nan", "none"])
def test_a_difference_is_seen(monkeypatch: pytest.MonkeyPatch, change: str) -> None:
    """One value of one result, off by its last bit where everything is forced on."""
    scene, settings, _ = load("shaft", overrides=SMALL)

    def off(*args: object, **options: object) -> Frame:
        frame = run_frame(*args, **options)  # type: ignore[arg-type]
        if options["force_all"]:
            field = frame.results["lighting/in_scattering"].copy()
            where = np.unravel_index(np.argmax(field), field.shape)
            field[where] = {"value": np.nextafter(field[where], 0.0), "nan": np.nan, "none": field[where]}[change]
            frame.results["lighting/in_scattering"] = field  # type: ignore[index]
        return frame

    monkeypatch.setattr(measuring, "run_frame", off)
    assert measure_saved(scene, settings, load_assets(scene, None), repeats=1).same is (change == "none")


def test_nan_in_both_is_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    scene, settings, _ = load("uniform", overrides=SMALL)

    def broken(*args: object, **options: object) -> Frame:
        frame = run_frame(*args, **options)  # type: ignore[arg-type]
        frame.results["apply/radiance"] = np.full_like(frame.results["apply/radiance"], np.nan)  # type: ignore[index]
        return frame

    monkeypatch.setattr(measuring, "run_frame", broken)
    assert measure_saved(scene, settings, load_assets(scene, None), repeats=1).same
