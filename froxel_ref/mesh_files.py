"""Triangle meshes from files: ``.obj`` parsed here, ``.ply`` and ``.glb`` by trimesh."""

from __future__ import annotations

import io
import logging
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from froxel_ref.records import InputError, shown
from froxel_ref.volumes import open_input

__all__ = ["Triangles", "read_mesh"]

Triangles: TypeAlias = tuple[NDArray[np.float64], NDArray[np.int64]]
"""Vertices (n, 3) in the file's own space and the vertex numbers of each triangle (m, 3)."""

MESH_EXTENSIONS = (".obj", ".ply", ".glb")
MESH_INSTALL = "python -m pip install 'froxel-ref[mesh]'"


def read_mesh(path: Path, *, place: str = "") -> Triangles:
    """The triangles of a mesh file, in the file's own space.

    Parameters
    ----------
    path : Path
        ``.obj``, ``.ply`` or ``.glb``; polygons are cut into triangles, the nodes of a ``.glb`` are placed.
    place : str
        Where the path was given, for messages.

    Returns
    -------
    vertices : ndarray, float64, shape (N, 3)
        Positions.
    faces : ndarray, int64, shape (M, 3)
        Vertex numbers; M ≥ 1.

    Raises
    ------
    InputError
        trimesh is not installed (but for ``.obj``), another extension, no mesh in the file, no triangle
        with an area, a vertex that is not finite, a vertex number out of range.

    Notes
    -----
    Materials, textures and buffers in other files are not looked for, so that a mesh cannot make the
    program open anything outside the scene's folder. ``.obj`` is parsed here, the others by trimesh: of an
    ``.obj`` only the lines ``v`` and ``f`` count, and a negative number counts back from its line.

    Examples
    --------
    >>> import tempfile
    >>> path = Path(tempfile.mkdtemp(), "square.obj")
    >>> _ = path.write_text("v 0 0 0\\nv 1 0 0\\nv 1 1 0\\nv 0 1 0\\nf 1 2 3 4\\n")
    >>> vertices, faces = read_mesh(path)
    >>> vertices.shape, faces.shape
    ((4, 3), (2, 3))
    """
    name = repr(str(path))
    if path.suffix.lower() not in MESH_EXTENSIONS:
        raise InputError(place, f"{name} is not one of {', '.join(MESH_EXTENSIONS)}")
    with open_input(path, place=place) as (file, _):
        data = file.read()
    if path.suffix.lower() == ".obj":
        vertices, faces = _parse_obj(data, name, place)
    else:
        vertices, faces = _parse_mesh(data, path.suffix.lower()[1:], name, place)
    if not len(faces):
        raise InputError(place, f"{name} holds no triangle")
    if faces.min() < 0 or faces.max() >= len(vertices):
        raise InputError(place, f"{name} has a face that names a vertex outside its {len(vertices)}")
    bad = np.count_nonzero(~np.isfinite(vertices).all(axis=1))
    if bad:
        raise InputError(place, f"{name} has {bad} vertices that are not finite")
    _refuse_flat(vertices, faces, name, place)
    return vertices, faces


def _refuse_flat(vertices: NDArray[np.float64], faces: NDArray[np.int64], name: str, place: str) -> None:
    """Refuse a mesh none of whose triangles has an area."""
    used = vertices[np.unique(faces)]
    center = 0.5 * used.min(axis=0) + 0.5 * used.max(axis=0)
    size = float(np.abs(used - center).max())
    scaled = (vertices - center) / (size or 1.0)  # so that no square is beyond the floats
    first = scaled[faces[:, 0]]
    if not np.cross(scaled[faces[:, 1]] - first, scaled[faces[:, 2]] - first).any():
        raise InputError(place, f"{name} holds no triangle with an area")


def _parse_obj(data: bytes, name: str, place: str) -> Triangles:
    """Vertices and fans of triangles; relative numbers count back from the line that they stand on."""
    positions: list[bytes] = []
    corners: list[bytes] = []
    sizes: list[int] = []   # of each face
    before: list[int] = []  # vertices before it
    data = data.removeprefix(b"\xef\xbb\xbf").replace(b"\\\r\n", b" ").replace(b"\\\n", b" ")
    for line in data.splitlines():
        words = line.partition(b"#")[0].split()
        if not words or words[0] not in (b"v", b"f"):
            continue
        if len(words) < 4:
            raise InputError(place, f"{name} cannot be read as .obj: {shown(line.decode('latin-1').strip())} "
                                    "has fewer than 3 entries")
        if words[0] == b"v":
            positions += words[1:4]
        else:
            corners += words[1:]
            sizes.append(len(words) - 1)
            before.append(len(positions) // 3)
    vertices = np.array(_numbers(float, positions, name, place), np.float64).reshape(-1, 3)
    count, earlier = len(vertices), np.repeat(np.array(before, np.int64), np.array(sizes, np.int64))
    given = np.array(_numbers(int, [word.partition(b"/")[0] for word in corners], name, place), np.int64)
    wrong = np.flatnonzero((given == 0) | (given > count) | (given < -earlier))
    if wrong.size:
        where, allowed = int(wrong[0]), f"must be 1 to {count}"
        if given[where] < 0:
            allowed = f"but only {earlier[where]} vertices before it"
        raise InputError(place, f"{name} has a face with vertex {given[where]}, {allowed}")
    return vertices, np.where(given > 0, given - 1, earlier + given)[_fans(np.array(sizes, np.int64))]


def _numbers(kind: Callable[[bytes], Any], words: list[bytes], name: str, place: str) -> list[Any]:
    # Python's numbers may have underscores, and its whole ones no end.
    wrong = next((word for word in words if b"_" in word or (kind is int and len(word) > 18)), None)
    if wrong is not None:
        raise InputError(place, f"{name} cannot be read as .obj: {shown(wrong.decode('latin-1'))} as a number")
    try:
        return [kind(word) for word in words]
    except ValueError as error:
        raise InputError(place, f"{name} cannot be read as .obj: {str(error)[:80]}") from None


def _fans(sizes: NDArray[np.int64]) -> NDArray[np.int64]:
    """The corners (M, 3) of the triangles that polygons of these sizes are cut into, from their first."""
    first = np.repeat(np.cumsum(sizes) - sizes, sizes - 2)
    step = np.arange(len(first)) - np.repeat(np.cumsum(sizes - 2) - (sizes - 2), sizes - 2)
    return np.stack([first, first + step + 1, first + step + 2], axis=1)


def _parse_mesh(data: bytes, file_type: str, name: str, place: str) -> Triangles:
    with _quiet("trimesh"):
        try:
            import trimesh
        except ImportError:
            raise InputError(place, f"{name} is a mesh, which needs trimesh: {MESH_INSTALL}") from None
        try:
            with io.BytesIO(data) as file:
                mesh = trimesh.load(file, file_type=file_type, force="mesh", process=False, resolver=None,
                                    skip_materials=True)
            return (np.array(getattr(mesh, "vertices", ()), np.float64).reshape(-1, 3),
                    np.array(getattr(mesh, "faces", ()), np.int64).reshape(-1, 3))
        except Exception as error:  # the parsers raise whatever a broken file makes them raise
            reason = str(error).strip().split("\n")[0][:80] or type(error).__name__
            raise InputError(place, f"{name} cannot be read as .{file_type}: {reason}") from None


@contextmanager
def _quiet(library: str) -> Iterator[None]:
    """Without the library's log and warnings, which would speak of its insides."""
    log = logging.getLogger(library)
    level = log.level
    log.setLevel(logging.CRITICAL + 1)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    finally:
        log.setLevel(level)
