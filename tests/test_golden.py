"""Golden sets: layout, checksums, the same bytes twice, and nothing half-written whatever happens."""

from __future__ import annotations

import dataclasses
import errno
import hashlib
import json
import os
import shutil
import signal
import tracemalloc
from pathlib import Path

import numpy as np
import pytest

from froxel_ref import golden, output
from froxel_ref.assets import load_assets
from froxel_ref.cli import main
from froxel_ref.frame import Frame, run_frame
from froxel_ref.golden import MANIFEST, GoldenSet, check_target, golden_bytes, gpu_array, write_golden
from froxel_ref.quantities import QUANTITIES
from froxel_ref.records import InputError, from_json
from froxel_ref.scene import (
    Camera,
    DensityTexture,
    DirectionalLight,
    ExtraLights,
    LocalMedium,
    Medium,
    Particle,
    ParticleCloud,
    Plane,
    PointLight,
    Scene,
    VolumeDensity,
)
from froxel_ref.scene_files import Loaded, document
from froxel_ref.settings import Grid, Settings, ShadowMaps, Switches, Temporal, replace

SCENE = Scene(
    name="small", camera=Camera(position=(0.0, 1.0, 0.0), target=(0.1, 1.0, -1.0), width=12, height=10),
    global_media=(Medium(extinction=0.1, albedo=(0.9, 0.5, 0.2), phase_anisotropy=0.4),),
    lights=(DirectionalLight(direction=(1.0, 1.0, 1.0), irradiance=(3.0, 2.0, 1.0)),), surfaces=(Plane(),))
MAPS = ShadowMaps(directional_size=16, spot_size=16, point_size=16)
SETTINGS = Settings(grid=Grid(width=6, height=5, depth=4), shadow_maps=MAPS)


def loaded(scene: Scene = SCENE, settings: Settings = SETTINGS, folder: Path | None = None) -> Loaded:
    return Loaded(scene, settings, folder)


def frame(given: Loaded) -> Frame:
    return run_frame(given.scene, given.settings, assets=load_assets(given.scene, given.folder))


@pytest.fixture(scope="module")
def small() -> Frame:
    return frame(loaded())


@pytest.fixture(scope="module")
def written(small: Frame, tmp_path_factory: pytest.TempPathFactory) -> GoldenSet:
    """One golden set that tests only read."""
    return write_golden(small, loaded(), tmp_path_factory.mktemp("golden") / "set")


@pytest.fixture
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    """Pictures of one pixel, for tests that are not about pictures."""
    monkeypatch.setattr("froxel_ref.pictures.preview", lambda *_, **__: np.zeros((1, 1, 3), np.uint8))
    monkeypatch.setattr("froxel_ref.pictures.contact_sheet", lambda _: np.zeros((1, 1, 3), np.uint8))


def bytes_in(folder: Path) -> dict[str, bytes]:
    return {p.relative_to(folder).as_posix(): p.read_bytes() for p in folder.rglob("*") if p.is_file()}


# --- what is written --------------------------------------------------------------------------------


@pytest.mark.parametrize("name", [n for n in QUANTITIES
                                  if not n.startswith(("media/lobe", "shadow/", "fom/", "culling/", "material/",
                                                       "temporal/", "long_range/", "taa/"))
                                  and n != "lighting/phase_ratio"])
def test_arrays_are_in_gpu_order(name: str, small: Frame, written: GoldenSet) -> None:
    entry = next(e for e in written.manifest["arrays"] if e["name"] == name)
    stored = np.load(written.folder / entry["file"], allow_pickle=False)
    axes = QUANTITIES[name].axes
    expected = {"czyx": (4, 5, 6, 3), "zyx": (4, 5, 6), "z": (4,), "cyx": (10, 12, 3), "yx": (10, 12)}[axes]
    if name.startswith("integrate/front"):
        expected = (5, 6, 3) if "c" in axes else (5, 6)
    assert stored.shape == expected
    assert stored.flags.c_contiguous
    assert stored.dtype.str == "<f8"
    assert entry["shape"] == list(expected)
    assert entry["dtype"] == "<f8"
    order = axes.replace("c", "") + ("c" if "c" in axes else "")
    assert entry["axes"] == [{"c": "channel"}.get(axis, axis) for axis in order]
    computed = small[name]
    for index in np.ndindex(stored.shape):  # element by element, through names of axes
        place = dict(zip(order, index, strict=True))
        source = tuple(place[axis] if size > 1 else 0
                       for axis, size in zip(axes, computed.shape, strict=True))
        assert stored[index] == computed[source]


def test_shadow_maps_are_written_as_they_are(small: Frame, written: GoldenSet) -> None:
    """One sun with four cascades; kinds of lights that the scene has not have no arrays."""
    entries = {e["name"]: e for e in written.manifest["arrays"] if e["name"].startswith("shadow/")}
    assert sorted(entries) == ["shadow/directional_depth", "shadow/directional_light", "shadow/directional_matrix"]
    depth = entries["shadow/directional_depth"]
    assert (depth["shape"], depth["axes"]) == ([1, 4, 16, 16], ["light", "face", "row", "column"])
    for name, entry in entries.items():
        stored = np.load(written.folder / entry["file"], allow_pickle=False)
        assert np.array_equal(stored, small[name])
        assert stored.dtype == small[name].dtype


def test_varies_names_the_axes_that_the_field_carries(written: GoldenSet) -> None:
    varies = {entry["name"]: entry["varies"] for entry in written.manifest["arrays"]}
    assert varies["media/extinction"] == []
    assert varies["lighting/in_scattering"] == ["z", "y", "x"]  # the plane hides the sun from what is below it
    assert varies["integrate/transmittance"] == ["z", "y", "x"]
    assert varies["grid/slice_depth"] == ["z"]


@pytest.mark.usefixtures("quick")
def test_without_shadows_the_sun_varies_along_no_depth(tmp_path: Path) -> None:
    given = loaded(settings=replace(SETTINGS, shadows="off"))
    done = write_golden(frame(given), given, tmp_path / "set")
    varies = {entry["name"]: entry["varies"] for entry in done.manifest["arrays"]}
    assert varies["lighting/in_scattering"] == ["y", "x"]


def test_the_checksum_is_of_the_whole_file(written: GoldenSet) -> None:
    for entry in written.manifest["arrays"]:
        content = (written.folder / entry["file"]).read_bytes()
        assert hashlib.sha256(content).hexdigest() == entry["sha256"]
        assert QUANTITIES[entry["name"]].unit == entry["unit"]
        assert entry["about"]


def test_the_file_is_byte_for_byte_what_numpy_saves(small: Frame, written: GoldenSet,
                                                    tmp_path: Path) -> None:
    name = "media/scattering"
    view, _ = gpu_array(small[name], QUANTITIES[name], SCENE.camera, SETTINGS.grid)
    np.save(tmp_path / "by_numpy.npy", np.ascontiguousarray(view))
    assert (tmp_path / "by_numpy.npy").read_bytes() == (written.folder / "media/scattering.npy").read_bytes()


def test_the_folder_holds_what_the_manifest_says_and_nothing_else(written: GoldenSet) -> None:
    listed = {MANIFEST, written.manifest["contact_sheet"]}
    listed |= {entry[key] for entry in written.manifest["arrays"] for key in ("file", "preview")}
    found = bytes_in(written.folder)
    assert set(found) == listed
    assert json.loads(found[MANIFEST]) == written.manifest
    assert written.size == sum(map(len, found.values()))
    assert written.contact_sheet.is_file()
    assert all(content.startswith(b"\x89PNG") for name, content in found.items() if name.endswith(".png"))


def test_the_manifest_holds_the_input_in_full_and_no_place_of_the_machine(written: GoldenSet) -> None:
    assert written.manifest["input"] == document(SCENE, SETTINGS)
    assert written.manifest["schema_version"] == 1
    text = (written.folder / MANIFEST).read_text(encoding="utf-8")
    assert str(written.folder.parent) not in text
    assert os.uname().nodename not in text or len(os.uname().nodename) < 4


@pytest.mark.usefixtures("quick")
@pytest.mark.parametrize(("fidelity", "lookup", "emission"), [
    ("corrected", "boundary", "absorption"), ("published", "centre", "absorption")])
def test_the_manifest_says_every_switch_in_force(fidelity: str, lookup: str, emission: str,
                                                 tmp_path: Path) -> None:
    """Without this package nobody can tell what ``null`` under a fidelity comes to."""
    given = loaded(settings=replace(SETTINGS, fidelity=fidelity, emission=emission))
    switches = write_golden(frame(given), given, tmp_path / "set").manifest["resolved_switches"]
    assert set(switches) == {field.name for field in dataclasses.fields(Switches)}
    assert (switches["lookup"], switches["emission"]) == (lookup, emission)
    assert None not in switches.values()


@pytest.mark.usefixtures("quick")
def test_stages_stand_with_their_reasons_and_neutral_values(tmp_path: Path) -> None:
    given = loaded(dataclasses.replace(SCENE, global_media=()))
    manifest = write_golden(frame(given), given, tmp_path / "set").manifest
    stages = {stage["name"]: stage for stage in manifest["stages"]}
    assert stages["surface"]["runs"]
    assert not stages["integrate"]["runs"]
    assert "medium" in stages["integrate"]["why"]
    assert stages["integrate"]["neutral"] == {
        "integrate/radiance": 0.0, "integrate/transmittance": 1.0, "integrate/front_radiance": 0.0,
        "integrate/front_transmittance": 1.0}
    assert (np.load(tmp_path / "set/integrate/transmittance.npy") == 1.0).all()
    # A stage that is left out has no parts to speak of; one that runs says which of its own it does without.
    assert not stages["media"].get("parts")
    looked_up = {"name": "fog lookup", "runs": False, "why": "the scene has no fog to look up"}
    assert looked_up in stages["apply"]["parts"]


def test_two_runs_give_identical_bytes(written: GoldenSet, tmp_path: Path) -> None:
    again = write_golden(frame(loaded()), loaded(), tmp_path / "another name")
    assert bytes_in(again.folder) == bytes_in(written.folder)


@pytest.mark.usefixtures("quick")
def test_float32_stays_float32(tmp_path: Path) -> None:
    given = loaded(settings=replace(SETTINGS, precision="float32"))
    done = write_golden(frame(given), given, tmp_path / "set")
    kept = {entry["name"]: entry["dtype"] for entry in done.manifest["arrays"]}
    # Matrices keep their digits, and indices are no floats.
    assert (kept.pop("shadow/directional_matrix"), kept.pop("shadow/directional_light")) == ("<f8", "<i8")
    assert set(kept.values()) == {"<f4"}
    assert np.load(tmp_path / "set/integrate/radiance.npy").dtype == np.float32


@pytest.mark.usefixtures("quick")
def test_the_lobes_of_a_mixture_come_first(tmp_path: Path) -> None:
    media = (Medium(extinction=0.1, phase_anisotropy=0.5), Medium(extinction=0.2, phase_anisotropy=-0.5))
    given = loaded(dataclasses.replace(SCENE, global_media=media), replace(SETTINGS, phase_mixing="mixture"))
    done = write_golden(frame(given), given, tmp_path / "set")
    entries = {entry["name"]: entry for entry in done.manifest["arrays"]}
    assert entries["media/lobe_scattering"]["axes"] == ["lobe", "z", "y", "x", "channel"]
    assert entries["media/lobe_scattering"]["shape"] == [2, 4, 5, 6, 3]
    assert np.load(tmp_path / "set/media/lobe_anisotropy.npy").tolist() == [0.5, -0.5]


@pytest.mark.usefixtures("quick")
def test_extinction_per_colour_has_a_channel(tmp_path: Path) -> None:
    given = loaded(dataclasses.replace(SCENE, global_media=(Medium(extinction=(0.1, 0.2, 0.3)),)))
    done = write_golden(frame(given), given, tmp_path / "set")
    entries = {entry["name"]: entry for entry in done.manifest["arrays"]}
    assert entries["media/extinction"]["axes"] == ["z", "y", "x", "channel"]
    assert np.load(tmp_path / "set/media/extinction.npy")[3, 2, 1].tolist() == [0.1, 0.2, 0.3]


@pytest.mark.usefixtures("quick")
def test_files_that_the_scene_names_have_a_checksum(tmp_path: Path) -> None:
    (tmp_path / "data").mkdir()
    np.save(tmp_path / "data/density.npy", np.random.default_rng(1).random((3, 4, 5)))
    density = DensityTexture(source=VolumeDensity(path="density.npy"))
    scene = dataclasses.replace(SCENE, local_media=(LocalMedium(density=density),))
    given = loaded(scene, folder=tmp_path / "data")
    manifest = write_golden(frame(given), given, tmp_path / "set").manifest
    expected = hashlib.sha256((tmp_path / "data/density.npy").read_bytes()).hexdigest()
    assert manifest["input_files"] == {"density.npy": expected}


@pytest.mark.usefixtures("quick")
def test_progress_is_told_before_each_result(small: Frame, tmp_path: Path) -> None:
    told: list[tuple[str, int, int]] = []
    write_golden(small, loaded(), tmp_path / "set", progress=lambda *step: told.append(step))
    assert [index for _, index, _ in told] == list(range(len(told)))
    assert {count for _, _, count in told} == {len(told)}
    assert told[-1][0] == "contact sheet"


def test_a_volume_is_never_expanded_whole(tmp_path: Path) -> None:
    """67 MB on disk from one number, in a few MB of memory."""
    view, _ = gpu_array(np.ones((1, 1, 1)), QUANTITIES["media/extinction"], SCENE.camera,
                        Grid(width=256, height=256, depth=128))
    tracemalloc.start()
    golden.write_array(tmp_path / "big.npy", view)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert (tmp_path / "big.npy").stat().st_size == 128 + 8 * 2**23
    assert peak < 3 * golden.SLAB


def test_the_estimate_covers_what_is_written(small: Frame, written: GoldenSet) -> None:
    assert written.size <= golden_bytes(small) < 10**7  # a few MB: pictures have a least size, not more


def test_the_estimate_covers_pictures_of_noise(tmp_path: Path) -> None:
    """Nothing compresses worse."""
    random = np.random.default_rng(5)
    given = loaded(dataclasses.replace(SCENE, camera=Camera(width=160, height=120)),
                   Settings(grid=Grid(width=32, height=24, depth=16), shadow_maps=MAPS))
    noisy = frame(given)
    results = {name: random.random(gpu_shape(name, noisy)) for name in noisy.results if noisy.results[name].size}
    noisy = dataclasses.replace(noisy, results=results)
    assert write_golden(noisy, given, tmp_path / "set").size <= golden_bytes(noisy)


def gpu_shape(name: str, whole: Frame) -> tuple[int, ...]:
    """The shape of a result that varies on all its axes."""
    quantity, grid, camera = QUANTITIES[name], whole.settings.grid, whole.scene.camera
    half = 2 if quantity.raster == "half" else 1
    on_grid = quantity.raster == "grid" or "z" in quantity.axes
    sizes = {"c": 3, "z": grid.depth, "y": grid.height if on_grid else -(-camera.height // half),
             "x": grid.width if on_grid else -(-camera.width // half), "m": 1, "f": 4, "p": 16, "q": 16, "i": 3, "j": 4}
    return tuple(sizes[axis] for axis in quantity.axes)


# --- where it may stand -----------------------------------------------------------------------------


def test_a_folder_whose_parent_is_missing_is_refused_before_anything_is_computed(
        tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setattr("froxel_ref.frame.run_frame", lambda *_, **__: pytest.fail("computed"))
    monkeypatch.chdir(tmp_path)
    for name, says in (("a/b/c", "'a/b/c' cannot be written: its folder does not exist"), ("", "is '', must be")):
        assert main(["golden", "uniform", "-o", name]) == 2
        assert says in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


@pytest.mark.usefixtures("quick")
def test_an_existing_set_is_replaced_only_with_force(small: Frame, tmp_path: Path) -> None:
    target = tmp_path / "set"
    write_golden(small, loaded(), target)
    (target / "contact_sheet.png").write_bytes(b"touched")
    with pytest.raises(InputError, match="--force"):
        write_golden(small, loaded(), target)
    assert (target / "contact_sheet.png").read_bytes() == b"touched"
    write_golden(small, loaded(), target, force=True)
    assert (target / "contact_sheet.png").read_bytes() != b"touched"
    assert os.listdir(tmp_path) == ["set"]


@pytest.mark.parametrize("force", [False, True])
@pytest.mark.parametrize("content", [
    {"thesis.txt": "three years of work"},
    {"manifest.json": "{}"},
    {"manifest.json": "not JSON"},
    {"manifest.json": '{"format": "another tool"}'},
    {"manifest.json": "[]", "a/b.npy": ""},
    {"manifest.json": "[" * 100_000},
    {"manifest.json": '{"format": "froxel-ref golden set"}'},
    {"manifest.json": '{"format": "froxel-ref golden set", "arrays": [7]}'},
    {"manifest.json": '{"format": "froxel-ref golden set", "arrays": [{"name": "precious", '
                      '"file": "precious.txt", "preview": "precious.txt"}]}', "precious.txt": "mine"},
    {"manifest.json": '{"format": "froxel-ref golden set", "arrays": [{"name": "mine/notes"}]}',
     "mine/notes.npy": "mine"},
    {"manifest.json": '{"format": "froxel-ref golden set", "arrays": [{"name": "media/../x"}]}', "x.npy": ""},
    {"manifest.json": '{"format": "froxel-ref golden set", "arrays": [{"name": "media/albedo"}]}',
     "media/albedo.npy/mine": "a folder of that name"},
])
def test_a_folder_that_is_no_golden_set_is_never_replaced(small: Frame, tmp_path: Path, force: bool,
                                                          content: dict[str, str]) -> None:
    target = tmp_path / "mine"
    for name, text in content.items():
        (target / name).parent.mkdir(parents=True, exist_ok=True)
        (target / name).write_text(text)
    before = bytes_in(target)
    with pytest.raises(InputError, match="output"):
        write_golden(small, loaded(), target, force=force)
    assert bytes_in(target) == before
    assert os.listdir(tmp_path) == ["mine"]


@pytest.mark.usefixtures("quick")
def test_a_file_of_somebody_else_in_a_golden_set_stops_the_replacement(small: Frame, tmp_path: Path) -> None:
    target = write_golden(small, loaded(), tmp_path / "set").folder
    (target / "media/notes.txt").write_text("keep me")
    with pytest.raises(InputError, match=r"media/notes\.txt"):
        write_golden(small, loaded(), target, force=True)
    assert (target / "media/notes.txt").read_text() == "keep me"


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="the system has no named pipes")
def test_a_pipe_for_a_manifest_is_not_waited_for(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / MANIFEST)
    with pytest.raises(InputError, match=r"holds 'manifest\.json', which is not part"):
        check_target(tmp_path, force=True)


def test_without_a_manifest_nothing_is_searched(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A slip such as ``-o /`` must not walk the whole disk before it is refused."""
    (tmp_path / "a/b").mkdir(parents=True)
    real, looked = os.scandir, []
    monkeypatch.setattr(os, "scandir", lambda *given: looked.append(given) or real(*given))
    monkeypatch.setattr(Path, "rglob", lambda *_: pytest.fail("the whole tree"))
    listdir = os.listdir
    monkeypatch.setattr(os, "listdir", lambda *given: looked.append(given) or listdir(*given))
    with pytest.raises(InputError, match="holds 'a'"):
        check_target(tmp_path, force=True)
    assert len(looked) == 1


@pytest.mark.usefixtures("quick")
def test_a_link_in_a_golden_set_is_somebody_elses(small: Frame, tmp_path: Path) -> None:
    target = write_golden(small, loaded(), tmp_path / "set").folder
    (tmp_path / "mine.png").write_text("mine")
    (target / "contact_sheet.png").unlink()
    (target / "contact_sheet.png").symlink_to(tmp_path / "mine.png")
    with pytest.raises(InputError, match=r"contact_sheet\.png"):
        check_target(target, force=True)


@pytest.mark.usefixtures("quick")
@pytest.mark.parametrize("name", ["n" * 255, "é" * 127, "a." + "b" * 250])
def test_a_name_may_be_as_long_as_the_system_takes(small: Frame, tmp_path: Path, name: str) -> None:
    for force in (False, True):
        assert write_golden(small, loaded(), tmp_path / name, force=force).contact_sheet.is_file()
    assert os.listdir(tmp_path) == [name]


def test_a_name_that_is_too_long_is_refused_first(small: Frame, tmp_path: Path) -> None:
    told: list[object] = []
    with pytest.raises(InputError, match="File name too long") as fault:
        write_golden(small, loaded(), tmp_path / ("n" * 256), progress=lambda *step: told.append(step))
    assert not told
    assert "partial" not in str(fault.value)


@pytest.mark.usefixtures("quick")
@pytest.mark.parametrize("number", ["SIGINT", "SIGTERM", "SIGHUP"])
def test_a_signal_while_cleaning_up_waits(small: Frame, tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
                                          number: str) -> None:
    """A second Ctrl-C must not leave half of a folder that the first one was removing."""
    class Stop(BaseException):
        pass

    def stop(*_: object) -> None:
        raise Stop

    wanted = getattr(signal, number)
    before, rmtree = signal.signal(wanted, stop), shutil.rmtree

    def interrupted(path: Path) -> None:
        signal.raise_signal(wanted)
        rmtree(path)

    monkeypatch.setattr(shutil, "rmtree", interrupted)
    failing("_write_contact_sheet", 0, KeyboardInterrupt(), monkeypatch)
    try:
        with pytest.raises(Stop):
            write_golden(small, loaded(), tmp_path / "set")
        assert signal.getsignal(wanted) is stop
    finally:
        signal.signal(wanted, before)
    assert not os.listdir(tmp_path)


@pytest.mark.usefixtures("quick")
def test_an_empty_folder_is_used_with_force(small: Frame, tmp_path: Path) -> None:
    (tmp_path / "set").mkdir()
    with pytest.raises(InputError, match="exists"):
        write_golden(small, loaded(), tmp_path / "set")
    assert write_golden(small, loaded(), tmp_path / "set", force=True).contact_sheet.is_file()


@pytest.mark.usefixtures("quick")
def test_through_a_link_the_set_behind_it_is_replaced(small: Frame, tmp_path: Path) -> None:
    (tmp_path / "real").mkdir()
    write_golden(small, loaded(), tmp_path / "real/set")
    (tmp_path / "link").symlink_to(tmp_path / "real/set")
    write_golden(small, loaded(), tmp_path / "link", force=True)
    assert (tmp_path / "link").is_symlink()
    assert (tmp_path / "real/set" / MANIFEST).is_file()


@pytest.mark.parametrize("force", [False, True])
def test_a_file_is_not_a_folder(tmp_path: Path, force: bool) -> None:
    (tmp_path / "file").write_text("mine")
    with pytest.raises(InputError, match="is a file"):
        check_target(tmp_path / "file", force=force)


@pytest.mark.parametrize("name", ["no/such/set", "file/set", "a\0b", "x" * 300, "/", "."])
def test_a_place_that_cannot_be_is_refused(small: Frame, tmp_path: Path, name: str,
                                           monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "file").write_text("mine")
    with pytest.raises(InputError, match="output"):
        write_golden(small, loaded(), Path(name))
    assert os.listdir(tmp_path) == ["file"]


# --- what goes wrong on the way ---------------------------------------------------------------------


class Broken(Exception):
    """Something that nobody foresaw."""


FAULTS = [OSError(errno.ENOSPC, "No space left on device"), OSError(errno.EIO, "Input/output error"),
          PermissionError(errno.EACCES, "Permission denied"), MemoryError(), KeyboardInterrupt(),
          SystemExit(1), Broken()]


def failing(place: str, count: int, fault: BaseException, monkeypatch: pytest.MonkeyPatch) -> None:
    """Let the ``count``-th call of a function of `froxel_ref.golden` raise."""
    module = output if place == "_take_place" else golden
    real, calls = getattr(module, place), iter(range(1000))

    def call(*given: object) -> object:
        if next(calls) == count:
            raise fault
        return real(*given)

    monkeypatch.setattr(module, place, call)


@pytest.mark.usefixtures("quick")
@pytest.mark.parametrize("replaces", [False, True])
@pytest.mark.parametrize(("place", "count"), [("write_array", 0), ("write_array", 7), ("write_png", 16),
                                              ("_write_contact_sheet", 0), ("_take_place", 0)])
@pytest.mark.parametrize("fault", FAULTS, ids=lambda fault: type(fault).__name__)
def test_whatever_stops_a_write_leaves_nothing_and_the_old_set_stands(
        small: Frame, written: GoldenSet, tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
        fault: BaseException, place: str, count: int, replaces: bool) -> None:
    target = tmp_path / "set"
    if replaces:
        shutil.copytree(written.folder, target)
    before = bytes_in(tmp_path)
    failing(place, count, fault, monkeypatch)
    one_line = isinstance(fault, (OSError, MemoryError))
    with pytest.raises(InputError if one_line else type(fault)) as caught:
        write_golden(small, loaded(), target, force=replaces)
    if one_line:
        assert str(caught.value).startswith("output: ")
        assert "\n" not in str(caught.value)
    assert bytes_in(tmp_path) == before
    assert os.listdir(tmp_path) == (["set"] if replaces else [])


@pytest.mark.usefixtures("quick")
def test_a_rename_that_fails_puts_the_old_set_back(small: Frame, written: GoldenSet, tmp_path: Path,
                                                   monkeypatch: pytest.MonkeyPatch) -> None:
    target = tmp_path / "set"
    shutil.copytree(written.folder, target)
    before, rename, calls = bytes_in(tmp_path), Path.rename, iter(range(9))

    def once_wrong(self: Path, to: Path) -> Path:
        if next(calls) == 1:
            raise OSError(errno.EIO, "Input/output error")
        return rename(self, to)

    monkeypatch.setattr(Path, "rename", once_wrong)
    with pytest.raises(InputError, match="Input/output error"):
        write_golden(small, loaded(), target, force=True)
    assert bytes_in(tmp_path) == before


@pytest.mark.usefixtures("quick")
def test_what_appears_while_writing_is_not_replaced(small: Frame, tmp_path: Path) -> None:
    target = tmp_path / "set"
    with pytest.raises(InputError, match="exists"):
        write_golden(small, loaded(), target, progress=lambda *_: target.mkdir(exist_ok=True))
    assert os.listdir(tmp_path) == ["set"]
    assert not os.listdir(target)


def test_a_disk_that_is_too_small_is_refused_before_anything_is_written(
        small: Frame, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    usage = shutil._ntuple_diskusage(10**9, 10**9 - 10**6, 10**6 + 10**5)
    monkeypatch.setattr(shutil, "disk_usage", lambda _: usage)
    with pytest.raises(InputError, match=r"^output: '.*/set' needs about 4 MB, its disk has 1 MB free$"):
        write_golden(small, loaded(), tmp_path / "set")
    assert not os.listdir(tmp_path)


def test_what_seeds_strew_is_written_out(tmp_path: Path) -> None:
    """A port has not NumPy's generator: without the clouds and extra lights, but with their items, the same frame."""
    cloud = ParticleCloud(name="puff", count=5, seed=7, low=(-1, 0, -6), high=(1, 2, -4))
    scene = Scene(camera=Camera(width=8, height=6), particles=(cloud,), global_media=(Medium(),),
                  extra_lights=ExtraLights(count=3, low=(-2, 0, -8), high=(2, 2, -2)))
    how = Settings(grid=Grid(width=4, height=3, depth=4))
    frame = run_frame(scene, how)
    strewn = write_golden(frame, Loaded(scene, how, None), tmp_path / "set").manifest["strewn"]
    assert json.loads((tmp_path / "set" / MANIFEST).read_text("utf-8"))["strewn"] == strewn
    lights = tuple(from_json(PointLight, each) for each in strewn["lights"])
    particles = tuple(from_json(Particle, each) for each in strewn["particles"])
    assert len(lights) == 3
    written = dataclasses.replace(scene, particles=particles, lights=lights, extra_lights=ExtraLights())
    np.testing.assert_array_equal(run_frame(written, how)["apply/radiance"], frame["apply/radiance"])


@pytest.mark.parametrize("depth", [4, 5])
@pytest.mark.parametrize("filter", ["off", "unphased"])
def test_a_checkerboards_half_is_written_as_listing_3_11_has_it(tmp_path: Path, depth: int, filter: str) -> None:
    """Half the slices of media and lighting, constants too; all of them behind the filter; the sheet is drawn."""
    how = Settings(grid=Grid(width=6, height=4, depth=depth), checkerboard=True, temporal=Temporal(filter=filter))
    scene = Scene(camera=Camera(width=12, height=8), global_media=(Medium(),), lights=SCENE.lights)
    frame = run_frame(scene, how)
    made = write_golden(frame, Loaded(scene, how, None), tmp_path / "set")
    for name, slices in (("media/extinction", -(-depth // 2)), ("lighting/in_scattering", -(-depth // 2)),
                         ("temporal/in_scattering", depth), ("integrate/transmittance", depth)):
        assert np.load(made.folder / f"{name}.npy").shape[:3] == (slices, 4, 6)
    half, whole = (np.load(made.folder / f"{name}/in_scattering.npy") for name in ("lighting", "temporal"))
    for z, y, x in np.ndindex(depth, 4, 6):
        if (x + y + z) % 2 == 0 and filter == "off":
            np.testing.assert_array_equal(half[z // 2, y, x], whole[z, y, x])
