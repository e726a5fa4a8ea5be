"""What a scene's files hold, and the paths that lead to them."""

from __future__ import annotations

import hashlib
import logging
import math
import struct
import sys
from pathlib import Path

import numpy as np
import pytest
from data import data_file
from hypothesis import given
from hypothesis import strategies as st

from froxel_ref import assets as module
from froxel_ref.assets import Assets, checksums, fold_heights, input_path, load_assets, read_mesh
from froxel_ref.records import InputError
from froxel_ref.scene import (
    Camera,
    DensityTexture,
    Folds,
    HeightField,
    HeightsFile,
    ImageBuffers,
    LocalMedium,
    Medium,
    Mesh,
    NoiseDensity,
    Particle,
    ParticleCloud,
    Plane,
    Scene,
    VolumeDensity,
)

SQUARE = """# two triangles by one polygon
v -1 0 -1
v 1 0 -1
v 1 0 1
v -1 0 1
f 1 2 3 4
"""
DENSITY = np.arange(8, dtype=np.float32).reshape(2, 2, 2)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A scene's folder with one good file of each kind, beside a file that is none of its business."""
    base = tmp_path / "scene"
    (base / "sub").mkdir(parents=True)
    np.save(base / "density.npy", DENSITY)
    np.save(base / "heights.npy", np.array([[0.0, 1.0, 2.0], [3.0, 4.0, 5.0]]))
    np.save(base / "depth.npy", np.array([[1.0, 2.0, math.inf], [4.0, 5.0, 6.0]], np.float32))
    np.save(base / "puff.npy", np.array([[0.0, 0.5, 1.0]], np.float16))
    np.save(base / "radiance.npy", np.arange(18, dtype=np.float32).reshape(2, 3, 3))
    (base / "sub" / "square.obj").write_text(SQUARE)
    (tmp_path / "outside.obj").write_text(SQUARE)
    return base


def media(*sources: NoiseDensity | VolumeDensity) -> tuple[LocalMedium, ...]:
    return tuple(LocalMedium(density=DensityTexture(source=source)) for source in sources)


def with_mesh(path: str) -> Scene:
    return Scene(surfaces=(Plane(), Mesh(path=path)))


def buffers(**changes: object) -> Scene:
    return Scene(camera=Camera(width=3, height=2),
                 image_buffers=ImageBuffers(**({"depth": "depth.npy", "radiance": "radiance.npy"} | changes)))


# --- everything good --------------------------------------------------------------------------------------


def test_every_kind_is_there(folder: Path) -> None:
    seeded, volume = NoiseDensity(size=4, cells=2), VolumeDensity(path="density.npy", multiplier=2.0)
    folds, heights, mesh = Folds(size=9), HeightsFile(path="heights.npy"), Mesh(path="sub/square.obj")
    scene = Scene(global_media=(Medium(), Medium(density=DensityTexture(source=seeded))),
                  local_media=media(volume),
                  surfaces=(HeightField(heights=folds), HeightField(heights=heights), mesh),
                  particles=(Particle(position=(0, 0, 0)), ParticleCloud(texture="puff.npy")))
    got = load_assets(scene, folder)
    assert set(got.textures) == {volume, seeded}
    assert got.textures[volume].tolist() == (2.0 * DENSITY).tolist()
    assert got.textures[seeded].shape == (4, 4, 4)
    assert set(got.heights) == {folds, heights}
    assert got.heights[heights].tolist() == [[0.0, 1.0, 2.0], [3.0, 4.0, 5.0]]
    vertices, faces = got.meshes[mesh]
    corners = [[-1, 0, -1], [1, 0, -1], [1, 0, 1], [-1, 0, 1]]
    assert (vertices.dtype, faces.dtype) == (np.float64, np.int64)
    assert sorted(vertices.tolist()) == sorted(corners)
    assert {tuple(vertices[v]) for v in faces[0]} < set(map(tuple, corners))
    area = np.linalg.norm(np.cross(*(vertices[faces[:, i]] - vertices[faces[:, 0]] for i in (1, 2))), axis=1)
    assert area.tolist() == [4.0, 4.0]  # twice the area of each half
    assert {path: values.tolist() for path, values in got.opacities.items()} == {"puff.npy": [[0.0, 0.5, 1.0]]}
    assert got.depth is None
    assert got.radiance is None


def test_image_buffers_become_channel_first(folder: Path) -> None:
    got = load_assets(buffers(), folder)
    assert got.depth is not None
    assert got.radiance is not None
    assert got.depth.tolist() == [[1.0, 2.0, math.inf], [4.0, 5.0, 6.0]]
    assert got.radiance[1].tolist() == [[1.0, 4.0, 7.0], [10.0, 13.0, 16.0]]  # the greens
    assert got.radiance.flags.c_contiguous
    assert load_assets(buffers(radiance=None), folder).radiance is None


def test_all_is_float64_whatever_the_files_hold(folder: Path) -> None:
    got = load_assets(buffers(), folder)
    assert got.depth is not None
    assert got.radiance is not None
    fields = tuple(HeightField(heights=h) for h in (Folds(), HeightsFile(path="heights.npy")))
    scene = Scene(local_media=media(NoiseDensity(size=4), VolumeDensity(path="density.npy")), surfaces=fields,
                  particles=(ParticleCloud(texture="puff.npy"),))
    more = load_assets(scene, folder)
    arrays = [got.depth, got.radiance, *more.textures.values(), *more.heights.values(), *more.opacities.values()]
    assert [a.dtype for a in arrays] == [np.float64] * 7


def test_the_same_source_is_read_once(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    read: list[str] = []

    def counted(path: Path, **options: object) -> object:
        read.append(path.name)
        return real(path, **options)

    real = module.read_mesh
    monkeypatch.setattr(module, "read_mesh", counted)
    red, blue = (Mesh(path="sub/square.obj", albedo=albedo) for albedo in ((1.0, 0.0, 0.0), (0.0, 0.0, 1.0)))
    got = load_assets(Scene(surfaces=(red, blue, red)), folder)
    assert read == ["square.obj"]
    assert set(got.meshes) == {red, blue}
    source = VolumeDensity(path="density.npy")
    assert len(load_assets(Scene(local_media=media(source, source)), folder).textures) == 1


def test_a_scene_without_files_needs_no_folder() -> None:
    assert load_assets(Scene(), None) == Assets({}, {}, {}, None, None)


def test_checksums_are_of_the_files(folder: Path) -> None:
    scene = Scene(local_media=media(VolumeDensity(path="density.npy"), NoiseDensity(), VolumeDensity(
        path="density.npy", multiplier=3.0)), surfaces=(Mesh(path="sub/square.obj"), HeightField(
            heights=HeightsFile(path="heights.npy"))), particles=(Particle(position=(0, 0, 0), texture="puff.npy"),))
    got = checksums(scene, folder)
    assert list(got) == ["density.npy", "heights.npy", "puff.npy", "sub/square.obj"]
    for path, digest in got.items():
        assert digest == hashlib.sha256((folder / path).read_bytes()).hexdigest()
    assert list(checksums(buffers(), folder)) == ["depth.npy", "radiance.npy"]
    with pytest.raises(InputError, match=r"surfaces\[1\].path: 'no.obj' is not in"):
        checksums(with_mesh("no.obj"), folder)


# --- heights of a curtain ---------------------------------------------------------------------------------


@pytest.mark.parametrize(("folds", "size"), [(6, 65), (1, 2), (3, 100)])
def test_folds_follow_their_formula(folds: int, size: int) -> None:
    got = fold_heights(Folds(folds=folds, size=size))
    rows, columns = got.shape
    assert columns == size
    assert rows == max(2, 1 + (size - 1) // 4)
    for j, i in np.ndindex(rows, columns):
        x, y = i / (columns - 1), j / (rows - 1)
        wanted = math.sin(2 * math.pi * folds * x) * (1 + 0.5 * math.sin(2 * math.pi * (y + x))) / 1.5
        # linspace and the products may differ by an ulp of the argument, up to 2π·folds.
        assert got[j, i] == pytest.approx(wanted, rel=0, abs=4e-16 * 2 * math.pi * (folds + 2))


# --- paths ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("path", "words"), [
    ("", "is '', must be a file name"),
    ("../outside.obj", "'../outside.obj' leaves the scene's folder"),
    ("sub/../../outside.obj", "leaves the scene's folder"),
    ("../scene-other/x.obj", "leaves the scene's folder"),
    ("link.obj", "'link.obj' leaves the scene's folder"),
    ("linked/outside.obj", "leaves the scene's folder"),
    ("/etc/passwd", "'/etc/passwd' is absolute, must be relative to the scene's folder"),
    ("no.obj", "'no.obj' is not in '.*scene'; --data DIR names the folder"),
    ("density.npy/x.obj", "is not in|cannot be looked up"),
    ("loop.obj", "cannot be looked up|is not in"),
    ("x" * 300, "cannot be looked up: File name too long"),
    ("sub", "not one of .obj, .ply, .glb"),
    ("density.npy", r"not one of \.obj, \.ply, \.glb"),
])
def test_paths_stay_in_the_folder(folder: Path, path: str, words: str) -> None:
    (folder / "link.obj").symlink_to(folder.parent / "outside.obj")
    (folder / "linked").symlink_to(folder.parent)
    (folder / "loop.obj").symlink_to("loop.obj")
    with pytest.raises(InputError, match=words) as fault:
        load_assets(with_mesh(path), folder)
    assert str(fault.value).startswith("surfaces[1].path: ")
    assert "\n" not in str(fault.value)


def test_zero_bytes_are_no_name(folder: Path) -> None:
    with pytest.raises(InputError, match="must be a file name"):
        input_path(folder, "a\0b", "place")


def test_no_folder_is_said(folder: Path) -> None:
    with pytest.raises(InputError, match="its folder is not given; --data DIR"):
        load_assets(with_mesh("sub/square.obj"), None)


@pytest.mark.parametrize("path", ["sub/square.obj", "./sub/square.obj", "sub/../sub/square.obj", "inner.obj"])
def test_paths_inside_are_followed(folder: Path, path: str) -> None:
    (folder / "inner.obj").symlink_to("sub/square.obj")
    (folder.parent / "alias").symlink_to(folder)  # the folder itself may be reached by a link
    for base in (folder, str(folder), folder.parent / "alias"):
        assert len(load_assets(with_mesh(path), base).meshes) == 1


@pytest.mark.parametrize(("scene", "place"), [
    (Scene(global_media=(Medium(), Medium(density=DensityTexture(source=VolumeDensity(path="no.npy"))))),
     "global_media[1].density.source.path"),
    (Scene(local_media=media(VolumeDensity(path="no.vol"))), "local_media[0].density.source.path"),
    (Scene(surfaces=(HeightField(heights=HeightsFile(path="no.npy")),)), "surfaces[0].heights.path"),
    (with_mesh("no.obj"), "surfaces[1].path"),
    (buffers(depth="no.npy"), "image_buffers.depth"),
    (buffers(radiance="no.npy"), "image_buffers.radiance"),
    (Scene(particles=(ParticleCloud(), ParticleCloud(texture="no.npy"))), "particles[1].texture"),
])
def test_places_are_paths_in_the_scene(folder: Path, scene: Scene, place: str) -> None:
    with pytest.raises(InputError) as fault:
        load_assets(scene, folder)
    assert fault.value.place == place


# --- arrays that do not fit -------------------------------------------------------------------------------


@pytest.mark.parametrize(("array", "words"), [
    (np.zeros(3), r"has 1 axes \(3,\), must have 2"),
    (np.zeros((1, 5)), r"has shape \(1, 5\), must be at least \(2, 2\)"),
    (np.array([[0.0, 1.0], [math.nan, 2.0]]), r"holds nan at \[1, 0\] .* heights must be finite"),
    (np.zeros((2, 2), int), "holds int64, must hold floats"),
])
def test_bad_heights(folder: Path, array: np.ndarray, words: str) -> None:
    np.save(folder / "bad.npy", array)
    with pytest.raises(InputError, match=words):
        load_assets(Scene(surfaces=(HeightField(heights=HeightsFile(path="bad.npy")),)), folder)


@pytest.mark.parametrize(("array", "words"), [
    (np.zeros(3), r"has 1 axes \(3,\), must have 2"),
    (np.zeros((0, 5)), "every length must be at least 1"),
    (np.array([[0.0, 1.0], [math.nan, 1.0]]), r"holds nan at \[1, 0\] .* opacities must be within 0 and 1"),
    (np.array([[0.0, 1.5]]), r"holds 1.5 at \[0, 1\] .* opacities must be within 0 and 1"),
    (np.array([[-0.1]]), r"holds -0.1 at \[0, 0\]"),
    (np.zeros((2, 2), np.uint8), "holds uint8, must hold floats"),
])
def test_bad_opacities(folder: Path, array: np.ndarray, words: str) -> None:
    np.save(folder / "bad.npy", array)
    with pytest.raises(InputError, match=words) as fault:
        load_assets(Scene(particles=(Particle(position=(0, 0, 0), texture="bad.npy"),)), folder)
    assert fault.value.place == "particles[0].texture"


@pytest.mark.parametrize(("name", "array", "words"), [
    ("depth", np.ones((3, 2)), r"has shape \(3, 2\), the camera's image has \(2, 3\)"),
    ("depth", np.ones((2, 3, 1)), "has 3 axes"),
    ("depth", np.full((2, 3), 0.0), r"holds 0 at \[0, 0\] \(6 such values\); view depth must be above 0 m"),
    ("depth", np.full((2, 3), -math.inf), "holds -inf"),
    ("depth", np.full((2, 3), math.nan), "holds nan"),
    ("depth", np.ones((2, 3), np.uint8), "holds uint8, must hold floats"),
    ("radiance", np.ones((3, 2, 3)), r"the camera's image has \(2, 3, 3\)"),
    ("radiance", np.ones((2, 3, 4)), r"the camera's image has \(2, 3, 3\)"),
    ("radiance", np.full((2, 3, 3), -1.0), "holds -1 at .*at least 0 and at most 1e"),
    ("radiance", np.full((2, 3, 3), math.inf), "holds inf"),
    ("radiance", np.full((2, 3, 3), math.nan), "holds nan"),
])
def test_bad_images(folder: Path, name: str, array: np.ndarray, words: str) -> None:
    np.save(folder / "bad.npy", array)
    with pytest.raises(InputError, match=words) as fault:
        load_assets(buffers(**{name: "bad.npy"}), folder)
    assert fault.value.place == f"image_buffers.{name}"


def test_other_extensions_are_refused(folder: Path) -> None:
    (folder / "depth.exr").write_bytes(b"v/1\x01")
    with pytest.raises(InputError, match=r"is not a \.npy file"):
        load_assets(buffers(depth="depth.exr"), folder)


# --- meshes -----------------------------------------------------------------------------------------------

TRIANGLE = "v 0 0 0\nv 1 0 0\nv 0 1 0\n"
PLY = """ply
format ascii 1.0
element vertex 3
property float x
property float y
property float z
element face 1
property list uchar int vertex_indices
end_header
0 0 0
1 0 0
0 1 {}
3 0 1 {}
"""


@pytest.mark.parametrize(("name", "text", "words"), [
    ("a.obj", "", "holds no triangle"),
    ("a.obj", "nothing of the kind\n", "holds no triangle"),
    ("a.obj", TRIANGLE, "holds no triangle"),
    ("a.obj", TRIANGLE + "f 1 2 4\n", "a face with vertex 4, must be 1 to 3"),
    ("a.obj", TRIANGLE + "f 1/1/1 2/1/1 0/1/1\n", "a face with vertex 0"),
    ("a.obj", TRIANGLE + "f 1 2 -4\n", "a face with vertex -4"),
    ("a.obj", TRIANGLE.replace("1 0 0", "1 nan 0") + "f 1 2 3\n", "1 vertices that are not finite"),
    ("a.obj", TRIANGLE.replace("1 0 0", "1 1e999 0") + "f 1 2 3\n", "1 vertices that are not finite"),
    ("a.obj", TRIANGLE.replace("1 0 0", "1 x 0") + "f 1 2 3\n", "cannot be read as .obj"),
    ("a.obj", "v 1 2\n" + TRIANGLE + "f 1 2 3\n", "'v 1 2' has fewer than 3 entries"),
    ("a.obj", TRIANGLE + "f 1 2 # 3\n", "has fewer than 3 entries"),
    ("a.obj", TRIANGLE + "f 1 2 " + "9" * 5000 + "\n", "cannot be read as .obj: '99"),
    ("a.obj", TRIANGLE + "f 1 2 3_\n", "cannot be read as .obj: '3_' as a number"),
    ("a.obj", TRIANGLE + "f 1 2 /3\n", "cannot be read as .obj"),
    ("a.obj", "v 0 0 0\nv 1 0 0\nf -1 -2 -3\nv 0 1 0\n", "vertex -3, but only 2 vertices before it"),
    ("a.obj", TRIANGLE + "f 1 1 1\n", "holds no triangle with an area"),
    ("a.obj", "v 5 5 5\n" * 3 + "f 1 2 3\n", "holds no triangle with an area"),
    ("a.obj", "v 0 0 0\nv 1 1 1\nv 3 3 3\nf 1 2 3\n", "holds no triangle with an area"),
    ("a.ply", PLY.format("0", "0"), "holds no triangle with an area"),
    ("a.ply", PLY.format("0", "7"), "names a vertex outside its 3"),
    ("a.ply", PLY.format("0", "-1"), "names a vertex outside its 3"),
    ("a.ply", PLY.format("inf", "2"), "1 vertices that are not finite"),
    ("a.ply", PLY[:80], "cannot be read as .ply|holds no triangle"),
    ("a.glb", "glTF", "cannot be read as .glb"),
    ("a.stl", "solid x", "not one of .obj, .ply, .glb"),
])
def test_bad_meshes(tmp_path: Path, name: str, text: str, words: str,
                    caplog: pytest.LogCaptureFixture, capfd: pytest.CaptureFixture[str]) -> None:
    (tmp_path / name).write_text(text)
    with pytest.raises(InputError, match=words) as fault:
        load_assets(with_mesh(name), tmp_path)
    assert fault.value.place == "surfaces[1].path"
    assert "\n" not in str(fault.value)
    assert not caplog.records
    assert capfd.readouterr() == ("", "")
    assert logging.getLogger("trimesh").level != logging.CRITICAL + 1  # put back


def test_ply_and_glb_are_read(tmp_path: Path) -> None:
    (tmp_path / "a.ply").write_text(PLY.format("0", "2"))
    vertices, faces = read_mesh(tmp_path / "a.ply")
    assert vertices.tolist() == [[0, 0, 0], [1, 0, 0], [0, 1, 0]]
    assert faces.tolist() == [[0, 1, 2]]
    (tmp_path / "a.glb").write_bytes(glb())
    vertices, faces = read_mesh(tmp_path / "a.glb")
    assert vertices.tolist() == [[5, 0, 0], [6, 0, 0], [5, 1, 0]]  # its node moves it by 5
    assert faces.tolist() == [[0, 1, 2]]


def glb() -> bytes:
    """A triangle under a node that moves it, written by hand."""
    data = struct.pack("<9f", 0, 0, 0, 1, 0, 0, 0, 1, 0) + struct.pack("<4H", 0, 1, 2, 0)
    text = (b'{"asset":{"version":"2.0"},"scene":0,"scenes":[{"nodes":[0]}],'
            b'"nodes":[{"mesh":0,"translation":[5,0,0]}],'
            b'"meshes":[{"primitives":[{"attributes":{"POSITION":0},"indices":1}]}],'
            b'"buffers":[{"byteLength":44}],'
            b'"bufferViews":[{"buffer":0,"byteLength":36},{"buffer":0,"byteOffset":36,"byteLength":6}],'
            b'"accessors":[{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3"},'
            b'{"bufferView":1,"componentType":5123,"count":3,"type":"SCALAR"}]}')
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(data), b"BIN\0") + data
    return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks


def test_a_mesh_opens_no_other_file(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (folder.parent / "secret.mtl").write_text("newmtl a\nKd 1 0 0\n")
    (folder / "a.obj").write_text("mtllib ../secret.mtl\nusemtl a\n" + TRIANGLE + "f 1 2 3\n")
    read_mesh(folder / "sub" / "square.obj")  # trimesh is imported now
    opened: list[str] = []
    real = open

    def noted(file: object, *args: object, **options: object) -> object:
        opened.append(str(file))
        return real(file, *args, **options)  # type: ignore[call-overload]

    monkeypatch.setattr("builtins.open", noted)
    read_mesh(folder / "a.obj")
    assert opened == [str(folder / "a.obj")]


def test_without_trimesh_the_install_command_is_named(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "trimesh", None)
    (folder / "a.ply").write_text(PLY.format("0", "2"))
    command = r"python -m pip install 'froxel-ref\[mesh\]'"
    with pytest.raises(InputError, match="needs trimesh: " + command) as fault:
        load_assets(with_mesh("a.ply"), folder)
    assert fault.value.place == "surfaces[1].path"


ORIGINALS = {".obj": (TRIANGLE + "f 1 2 3\n").encode(), ".ply": PLY.format(0, 2).encode(), ".glb": glb()}


@st.composite
def damaged(draw: st.DrawFn) -> tuple[str, bytes]:
    extension = draw(st.sampled_from(sorted(ORIGINALS)))
    data = bytearray(ORIGINALS[extension])
    for _ in range(draw(st.integers(0, 4))):
        data[draw(st.integers(0, len(data) - 1))] = draw(st.integers(0, 255))
    return extension, bytes(data[:draw(st.integers(0, len(data)))] if draw(st.booleans()) else data)


@given(damaged())
def test_damaged_meshes_are_read_or_refused(tmp_path_factory: pytest.TempPathFactory,
                                            broken: tuple[str, bytes]) -> None:
    path = tmp_path_factory.getbasetemp() / f"broken{broken[0]}"
    path.write_bytes(broken[1])
    try:
        vertices, faces = read_mesh(path, place="here")
    except InputError as fault:
        assert fault.place == "here"  # noqa: PT017
        assert "\n" not in str(fault)  # noqa: PT017
    else:
        assert np.isfinite(vertices[faces]).all()


def test_the_bunny() -> None:
    path = data_file("stanford-bunny.obj")
    vertices, faces = read_mesh(path)
    assert faces.shape == (69451, 3)
    assert vertices.shape[0] <= 35947  # as its header says; trimesh leaves out what no face names
    np.testing.assert_allclose(np.ptp(vertices, axis=0), [0.1557, 0.1543, 0.1207], atol=1e-4)


@pytest.mark.parametrize(("text", "faces"), [
    # A number below 0 counts back from its own line, whatever comes after it.
    ("v 0 0 0\nv 1 0 0\nv 0 1 0\nf -3 -2 -1\nv 9 0 0\nv 9 1 0\nv 8 0 0\nf -3 -2 -1\n", [[0, 1, 2], [3, 4, 5]]),
    ("f 1 2 3\n" + TRIANGLE, [[0, 1, 2]]),  # others may come before their vertices
    ("v\t0\t0\t0\nv\t1 0\t0\n\tv 0 1 0\nf\t1\t2\t3\n", [[0, 1, 2]]),
    ("v 0 0 0 # one\nv 1 0 0# two\nv 0 1 0 1.0 0.5 0.5 0.5\nf 1 2 3 # v 4 5 6\n", [[0, 1, 2]]),
    (TRIANGLE + "vt 0 0\nvn 0 0 1\nf 3/1/1 2//1 1/1\nl 1 2\n", [[2, 1, 0]]),
    (TRIANGLE.replace("\n", "\r\n") + "f 1 \\\r\n 2 3\r\n", [[0, 1, 2]]),
    ("\ufeff" + TRIANGLE + "o a # b\ng x\ns off\nf +1 2 3\n", [[0, 1, 2]]),
    (TRIANGLE + "v 1 1 0\nv 2 2 0\nf 1 2 3\nf 5 4 3 2 1\nf 1 2 4 3\n",
     [[0, 1, 2], [4, 3, 2], [4, 2, 1], [4, 1, 0], [0, 1, 3], [0, 3, 2]]),
])
def test_obj_as_programs_write_it(tmp_path: Path, text: str, faces: list[list[int]]) -> None:
    (tmp_path / "a.obj").write_bytes(text.encode())
    vertices, found = read_mesh(tmp_path / "a.obj")
    assert found.tolist() == faces
    assert vertices[:3].tolist() == [[0, 0, 0], [1, 0, 0], [0, 1, 0]]


@pytest.mark.parametrize("size", [1e-300, 1e-5, 1e300])
def test_a_mesh_of_any_size_has_an_area(tmp_path: Path, size: float) -> None:
    (tmp_path / "a.obj").write_text(TRIANGLE.replace("1", f"{size}") + "f 1 2 3\n")
    assert len(read_mesh(tmp_path / "a.obj")[1]) == 1
