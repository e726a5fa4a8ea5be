"""What a scene's files hold: textures, heights, meshes, image buffers and opacities, read once and checked.

A scene names its files by paths relative to its folder. Nothing outside that folder is ever opened.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from froxel_ref.mesh_files import Triangles, read_mesh
from froxel_ref.records import InputError
from froxel_ref.scene import (
    Folds,
    HeightField,
    HeightsFile,
    Mesh,
    NoiseDensity,
    Scene,
    Surface,
    VolumeDensity,
)
from froxel_ref.scene_space import STRONGEST
from froxel_ref.volumes import noise, open_input, read_density, read_npy, refuse

__all__ = ["Assets", "checksums", "fold_heights", "input_path", "load_assets", "read_mesh"]

K = TypeVar("K")
V = TypeVar("V")
Folder = str | os.PathLike[str] | None



NONE: Mapping[str, NDArray[Any]] = MappingProxyType({})


class Assets(NamedTuple):
    """The arrays that a scene describes or names.

    Parameters
    ----------
    textures : mapping of NoiseDensity or VolumeDensity to ndarray, shape (nz, ny, nx)
        Densities, finite and not negative.
    heights : mapping of Folds or HeightsFile to ndarray, shape (rows, columns)
        Heights; the first row belongs to y = 0 of `Folds`, local y = −1.
    meshes : mapping of Mesh to (ndarray (N, 3) float64, ndarray (M, 3) int64)
        Vertices in the file's own space and the vertex numbers of each triangle.
    depth : ndarray, shape (height, width), optional
        View depth [m], +inf where there is nothing.
    radiance : ndarray, shape (3, height, width), optional
        Radiance without fog [W m⁻² sr⁻¹].
    shadow_maps : mapping of str to ndarray, shape (faces, size, size) or (size, size)
        Depths [m] by the path that a light names, +inf where there is nothing.
    opacities : mapping of str to ndarray, shape (rows, columns)
        Shares of a particle's opacity by the path that it names, in [0, 1]; row 0 is the top.
    """

    textures: Mapping[NoiseDensity | VolumeDensity, NDArray[Any]]
    heights: Mapping[Folds | HeightsFile, NDArray[Any]]
    meshes: Mapping[Mesh, Triangles]
    depth: NDArray[Any] | None
    radiance: NDArray[Any] | None
    shadow_maps: Mapping[str, NDArray[Any]] = NONE
    opacities: Mapping[str, NDArray[Any]] = NONE


def load_assets(scene: Scene, folder: Folder) -> Assets:
    """Read and make everything that a scene needs besides its own numbers.

    Parameters
    ----------
    scene : Scene
        The scene.
    folder : path, optional
        Where the scene's relative paths begin; None if it has no folder, which only a path minds.

    Returns
    -------
    Assets
        In float64; each source is there once, however often the scene uses it.

    Raises
    ------
    InputError
        Any fault of a file or its path, under its place in the scene; trimesh is missing.

    Examples
    --------
    >>> from froxel_ref.scene import DensityTexture, Medium
    >>> source = NoiseDensity(size=8)
    >>> scene = Scene(global_media=(Medium(density=DensityTexture(source=source)),))
    >>> load_assets(scene, None).textures[source].shape
    (8, 8, 8)
    """
    def texture(source: NoiseDensity | VolumeDensity, place: str) -> NDArray[Any]:
        if isinstance(source, NoiseDensity):
            return noise(source)
        file = input_path(folder, source.path, f"{place}.path")
        return read_density(source, file, place=place)

    def heights(source: Folds | HeightsFile, place: str) -> NDArray[Any]:
        if isinstance(source, Folds):
            return fold_heights(source)
        return _read_heights(folder, source.path, f"{place}.path").astype(np.float64, copy=False)

    def mesh(surface: Mesh, place: str) -> Triangles:
        return read_mesh(input_path(folder, surface.path, f"{place}.path"), place=f"{place}.path")

    def shadow_map(path: str, place: str) -> NDArray[Any]:
        file = input_path(folder, path, place)
        depths = _read_floats(file, None, place)
        if depths.dtype.itemsize < 4:
            raise InputError(place, f"{str(file)!r} holds {depths.dtype.name}, must hold float32 or float64")
        refuse(depths, np.isnan(depths), "depth must be a number, or +inf", file, place=place)
        return depths

    def opacity(path: str, place: str) -> NDArray[Any]:
        return _read_opacities(folder, path, place).astype(np.float64, copy=False)

    depth, radiance = _images(scene, folder)
    return Assets(textures=_each(_textures(scene), texture), heights=_each(_heights(scene), heights),
                  meshes=_meshes(scene, mesh), depth=depth, radiance=radiance,
                  shadow_maps=_each(_shadow_maps(scene), shadow_map), opacities=_each(_opacities(scene), opacity))


def _each(sources: Iterator[tuple[K, str]], read: Callable[[K, str], V]) -> dict[K, V]:
    done: dict[K, V] = {}
    for source, place in sources:
        if source not in done:
            done[source] = read(source, place)
    return done


def _textures(scene: Scene) -> Iterator[tuple[NoiseDensity | VolumeDensity, str]]:
    for name in ("global_media", "local_media"):
        for i, medium in enumerate(getattr(scene, name)):
            if medium.density is not None:
                yield medium.density.source, f"{name}[{i}].density.source"


def _surfaces(scene: Scene) -> Iterator[tuple[Surface, str]]:
    """The opaque and the transparent ones."""
    for i, surface in enumerate(scene.surfaces):
        yield surface, f"surfaces[{i}]"
    for i, each in enumerate(scene.transparent_surfaces):
        yield each.surface, f"transparent_surfaces[{i}].surface"


def _heights(scene: Scene) -> Iterator[tuple[Folds | HeightsFile, str]]:
    for surface, place in _surfaces(scene):
        if isinstance(surface, HeightField):
            yield surface.heights, f"{place}.heights"


def _shadow_maps(scene: Scene) -> Iterator[tuple[str, str]]:
    for i, light in enumerate(scene.lights):
        if light.shadow_map is not None:
            yield light.shadow_map, f"lights[{i}].shadow_map"


def _opacities(scene: Scene) -> Iterator[tuple[str, str]]:
    for i, each in enumerate(scene.particles):
        if each.texture is not None:
            yield each.texture, f"particles[{i}].texture"


def _meshes(scene: Scene, read: Callable[[Mesh, str], Triangles]) -> dict[Mesh, Triangles]:
    """Meshes that differ in colour or transform alone share their arrays."""
    files: dict[str, Triangles] = {}
    done: dict[Mesh, Triangles] = {}
    for surface, place in _surfaces(scene):
        if isinstance(surface, Mesh):
            if surface.path not in files:
                files[surface.path] = read(surface, place)
            done[surface] = files[surface.path]
    return done


# --- paths ------------------------------------------------------------------------------------------


def input_path(folder: Folder, path: str, place: str) -> Path:
    """The file that a scene's relative path names.

    Parameters
    ----------
    folder : path, optional
        The scene's folder.
    path : str
        As the scene has it.
    place : str
        Where the scene has it, for messages.

    Returns
    -------
    Path
        Absolute, without links, inside the folder.

    Raises
    ------
    InputError
        Empty, absolute, outside the folder (by ``..`` or a link), or nothing there.

    Examples
    --------
    >>> input_path(".", "../x.obj", "surfaces[0].path")
    Traceback (most recent call last):
    froxel_ref.records.InputError: surfaces[0].path: '../x.obj' leaves the scene's folder
    """
    if not path or "\0" in path:
        raise InputError(place, f"is {path!r}, must be a file name")
    if os.path.isabs(path):
        raise InputError(place, f"{path!r} is absolute, must be relative to the scene's folder")
    hint = "--data DIR names the folder"
    if folder is None:
        raise InputError(place, f"{path!r} is a file, but its folder is not given; {hint} "
                                "(in Python: assets=load_assets(scene, folder))")
    try:
        base = Path(folder).resolve()
        found = (base / path).resolve()
        if not found.is_relative_to(base):
            raise InputError(place, f"{path!r} leaves the scene's folder")
        if not found.exists():
            raise InputError(place, f"{path!r} is not in {str(base)!r}; {hint}")
    except (OSError, RuntimeError) as error:  # a name that is too long; links in a circle
        reason = getattr(error, "strerror", None) or str(error)
        raise InputError(place, f"{path!r} cannot be looked up: {reason}") from None
    return found


def _paths(scene: Scene) -> Iterator[tuple[str, str]]:
    """Every path that the scene names, with its place."""
    for texture, place in _textures(scene):
        if isinstance(texture, VolumeDensity):
            yield texture.path, f"{place}.path"
    for heights, place in _heights(scene):
        if isinstance(heights, HeightsFile):
            yield heights.path, f"{place}.path"
    for surface, place in _surfaces(scene):
        if isinstance(surface, Mesh):
            yield surface.path, f"{place}.path"
    yield from _shadow_maps(scene)
    yield from _opacities(scene)
    if scene.image_buffers is not None:
        yield scene.image_buffers.depth, "image_buffers.depth"
        if scene.image_buffers.radiance is not None:
            yield scene.image_buffers.radiance, "image_buffers.radiance"


def checksums(scene: Scene, folder: Folder) -> dict[str, str]:
    """The SHA-256 of every file that a scene names.

    Parameters
    ----------
    scene : Scene
        The scene.
    folder : path, optional
        Where its relative paths begin.

    Returns
    -------
    dict of str to str
        Path as the scene has it to hexadecimal digest, in the order of the paths.

    Raises
    ------
    InputError
        A fault of a path, or a file that cannot be read.

    Examples
    --------
    >>> checksums(Scene(), None)
    {}
    """
    digests: dict[str, str] = {}
    for path, place in _paths(scene):
        if path not in digests:
            with open_input(input_path(folder, path, place), place=place) as (file, _):
                digests[path] = hashlib.sha256(file.read()).hexdigest()
    return dict(sorted(digests.items()))


# --- heights and images -----------------------------------------------------------------------------


def fold_heights(folds: Folds) -> NDArray[np.float64]:
    """The heights of a hanging curtain.

    Parameters
    ----------
    folds : Folds
        Number of waves and samples across.

    Returns
    -------
    ndarray, float64, shape (rows, columns)
        columns = size samples over x in [0, 1]; a quarter as many rows over y (at least 2), along which
        the curtain only sways once.

    Notes
    -----
    h = sin(2π·folds·x)·(1 + ½ sin(2π(y + x)))/1.5, in [−1, 1].

    Examples
    --------
    >>> fold_heights(Folds(folds=1, size=5)).round(3).tolist()
    [[0.0, 1.0, 0.0, -0.333, -0.0], [0.0, 1.0, 0.0, -0.333, -0.0]]
    """
    x = np.linspace(0.0, 1.0, folds.size)
    y = np.linspace(0.0, 1.0, max(2, 1 + (folds.size - 1) // 4))[:, np.newaxis]
    turn = 2.0 * np.pi
    heights: NDArray[np.float64] = np.sin(turn * folds.folds * x) * (1.0 + 0.5 * np.sin(turn * (y + x))) / 1.5
    return heights


def _read_heights(folder: Folder, path: str, place: str) -> NDArray[Any]:
    file = input_path(folder, path, place)
    heights = _read_floats(file, 2, place)
    if min(heights.shape) < 2:
        raise InputError(place, f"{str(file)!r} has shape {heights.shape}, must be at least (2, 2)")
    refuse(heights, ~np.isfinite(heights), "heights must be finite", file, place=place)
    return heights


def _read_opacities(folder: Folder, path: str, place: str) -> NDArray[Any]:
    file = input_path(folder, path, place)
    values = _read_floats(file, 2, place)
    refuse(values, ~((values >= 0.0) & (values <= 1.0)), "opacities must be within 0 and 1", file, place=place)
    return values


def _read_floats(file: Path, ndim: int | None, place: str) -> NDArray[Any]:
    if file.suffix.lower() != ".npy":
        raise InputError(place, f"{str(file)!r} is not a .npy file")
    values = read_npy(file, ndim=ndim, place=place)
    if values.dtype.kind != "f":
        raise InputError(place, f"{str(file)!r} holds {values.dtype.name}, must hold floats")
    return values


def _images(scene: Scene, folder: Folder) -> tuple[NDArray[Any] | None, NDArray[Any] | None]:
    """The depth and the radiance of the scene's image buffers."""
    buffers, camera = scene.image_buffers, scene.camera
    depth = radiance = None
    if buffers is not None:
        place = "image_buffers.depth"
        file = input_path(folder, buffers.depth, place)
        depth = _image(file, (camera.height, camera.width), place)
        refuse(depth, ~(depth > 0.0), "view depth must be above 0 m, or +inf", file, place=place)
        depth = depth.astype(np.float64, copy=False)
    if buffers is not None and buffers.radiance is not None:
        place = "image_buffers.radiance"
        file = input_path(folder, buffers.radiance, place)
        colour = _image(file, (camera.height, camera.width, 3), place)
        refuse(colour, ~((colour >= 0.0) & (colour <= STRONGEST)),
               f"radiance must be at least 0 and at most {STRONGEST:g}", file, place=place)
        radiance = np.ascontiguousarray(np.moveaxis(colour, 2, 0), np.float64)
    return depth, radiance


def _image(file: Path, shape: tuple[int, ...], place: str) -> NDArray[Any]:
    values = _read_floats(file, len(shape), place)
    if values.shape != shape:
        raise InputError(place, f"{str(file)!r} has shape {values.shape}, the camera's image has {shape}")
    return values
