"""Frames one after the other: moving cameras, lights and media, and what each frame hands to the next."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from dataclasses import replace as with_fields
from typing import TypeAlias

import numpy as np

from froxel_ref.assets import Assets, load_assets
from froxel_ref.frame import Frame, Progress, run_frame
from froxel_ref.records import InputError, shown
from froxel_ref.scene import Box, Camera, Mesh, Scene, Sphere
from froxel_ref.scene_motion import scene_at
from froxel_ref.settings import Settings, replace

__all__ = ["RATE", "CameraPath", "moment", "moved_assets", "run_sequence"]

CameraPath: TypeAlias = Sequence[Camera] | Callable[[int], Camera]
"""The camera of each frame: as many as there are frames, or a function of their number."""

RATE = 30.0


def moment(scene: Scene, camera_path: CameraPath | None, frame: int, *, rate: float = RATE) -> Scene:
    """The scene as one frame of a sequence shows it.

    Parameters
    ----------
    scene : Scene
        With or without tracks.
    camera_path : sequence of Camera, or callable, optional
        The camera of each frame; the scene's, which its tracks may move, unless given.
    frame : int
        Number of the frame.
    rate : float [1/s]
        Frames a second, for tracks.

    Returns
    -------
    Scene
        Without tracks.

    Raises
    ------
    InputError
        What tracks or the path make of it is not allowed: among it a camera within a box or a sphere, whose picture
        would be black.

    Examples
    --------
    >>> moment(Scene(), [Camera(vertical_fov=40)], 0).camera.vertical_fov
    40.0
    """
    now = scene_at(scene, frame / rate)
    if camera_path is not None:
        camera = camera_path(frame) if callable(camera_path) else camera_path[frame]
        if not isinstance(camera, Camera):
            raise InputError(f"camera_path[{frame}]", f"is a {type(camera).__name__}, must be a Camera")
        now = with_fields(now, camera=camera)
    inside = next((k for k, surface in enumerate(now.surfaces) if _holds(surface, now.camera.position)), None)
    if inside is not None:
        raise InputError("camera.position", f"is within surfaces[{inside}] in frame {frame}, must be outside of it")
    return now


def _holds(surface: object, point: tuple[float, float, float]) -> bool:
    """Whether a closed surface has a point inside."""
    if isinstance(surface, Sphere):
        return float(np.linalg.norm(np.subtract(point, surface.center))) < surface.radius
    if not isinstance(surface, Box):
        return False
    local = np.linalg.solve(surface.transform.world_from_local, (*point, 1.0))
    return bool(np.abs(local[:3]).max() < 1.0)


def run_sequence(scene: Scene, camera_path: CameraPath | None = None, frames: int = 1, *,
                 settings: Settings | None = None, first: int = 0, rate: float = RATE, cuts: Collection[int] = (),
                 assets: Assets | None = None, outputs: Iterable[str] | None = None, threads: int | None = None,
                 progress: Progress | None = None, previous: Frame | None = None) -> Iterator[Frame]:
    """Compute frames one after the other.

    Parameters
    ----------
    scene : Scene
        Its tracks move it (`froxel_ref.scene_motion`).
    camera_path : sequence of Camera, or callable, optional
        The camera of each frame; the scene's unless given.
    frames : int
        Their number.
    settings : Settings, optional
        Its ``time`` is that of frame 0.
    first : int
        Number of the first frame to compute; go on from frame ``first − 1`` with ``previous``.
    rate : float [1/s]
        Frames a second: of tracks, and of textures that scroll.
    cuts : collection of int
        Frames that have nothing to do with those before: their history begins anew.
    assets : Assets, optional
        Of the scene at its beginning; needed where it names files.
    outputs : iterable of str, optional
        Results to keep, as for `froxel_ref.frame.run_frame`.
    threads : int, optional
        Default: one for each core.
    progress : callable, optional
        Called as ``progress(name, index, count)`` before each frame.
    previous : Frame, optional
        Frame ``first − 1``.

    Yields
    ------
    Frame
        One at a time; each keeps what the next one needs, and no more.

    Raises
    ------
    InputError
        No frames, a rate that is not above 0, a path of another length, a cut or a frame that is not allowed: all are
        looked at before the first is computed.

    Notes
    -----
    Frame n has the scene at n/rate seconds, the n-th point of the jitter, layer n of the noise and the n-th colour of
    the checkerboard. The same numbers whatever the frame is that a run begins at, if ``previous`` is the one before.

    Examples
    --------
    >>> from froxel_ref.settings import Grid
    >>> how = Settings(grid=Grid(width=4, height=2, depth=2))
    >>> [frame.settings.time for frame in run_sequence(Scene(), frames=3, settings=how, rate=10, outputs=[])]
    [0.0, 0.1, 0.2]
    """
    settings = settings or Settings()
    _check(frames, first, rate, camera_path, cuts)
    frames = int(frames)
    replace(settings, time=settings.time + (frames - 1) / rate)  # refuses a time that is not allowed
    for number in range(first, frames):
        moment(scene, camera_path, number, rate=rate)
    return _frames(scene, camera_path, range(first, frames), settings, rate, frozenset(cuts),
                   load_assets(scene, None) if assets is None else assets, outputs, threads, progress, previous)


def _check(frames: int, first: int, rate: float, camera_path: CameraPath | None,
           cuts: Collection[int]) -> None:
    if isinstance(frames, bool) or not isinstance(frames, int | np.integer) or frames < 1:
        raise InputError("frames", f"is {shown(frames)}, must be a whole number of at least 1")
    if isinstance(first, bool) or not isinstance(first, int) or not 0 <= first < frames:
        raise InputError("first", f"is {shown(first)}, must be a frame from 0 to {frames - 1}")
    if isinstance(rate, bool) or not isinstance(rate, int | float | np.number) or not (
            np.isfinite(rate) and rate > 0.0):
        raise InputError("rate", f"is {shown(rate)}, must be a number above 0")
    if camera_path is not None and not callable(camera_path) and not isinstance(camera_path, Sequence):
        raise InputError("camera_path", f"is a {type(camera_path).__name__}, must be a sequence of cameras, or a "
                                        "function of a frame's number")
    if not isinstance(cuts, Collection):
        raise InputError("cuts", f"is {shown(cuts)}, must be a collection of frames")
    if camera_path is not None and not callable(camera_path) and len(camera_path) < frames:
        raise InputError("camera_path", f"has {len(camera_path)} cameras, must have one for each of {frames} frames")
    beyond = next((cut for cut in cuts if cut not in range(frames)), None)
    if beyond is not None:
        raise InputError("cuts", f"has {shown(beyond)}, must be frames from 0 to {frames - 1}")


def _frames(scene: Scene, camera_path: CameraPath | None, numbers: range, settings: Settings, rate: float,
            cuts: frozenset[int], assets: Assets, outputs: Iterable[str] | None, threads: int | None,
            progress: Progress | None, previous: Frame | None) -> Iterator[Frame]:
    wanted = None if outputs is None else tuple(outputs)
    for number in numbers:
        if progress is not None:
            progress(f"frame {number}", number - numbers.start, len(numbers))
        now = moment(scene, camera_path, number, rate=rate)
        previous = run_frame(now, replace(settings, time=settings.time + number / rate),
                             assets=moved_assets(assets, scene, now), outputs=wanted, threads=threads,
                             previous=previous, frame=number, cut=number in cuts)
        yield previous


def moved_assets(assets: Assets, scene: Scene, now: Scene) -> Assets:
    """What a scene's files hold, as the scene of one moment asks for it.

    Parameters
    ----------
    assets : Assets
        Of the scene at its beginning.
    scene, now : Scene
        At its beginning, and as `moment` gives it.

    Returns
    -------
    Assets
        Meshes by their records of this moment.

    Examples
    --------
    >>> assets = load_assets(Scene(), None)
    >>> moved_assets(assets, Scene(), Scene()) is assets
    True
    """
    pairs = zip(scene.all_surfaces, now.all_surfaces, strict=True)
    meshes = {after: assets.meshes[before] for before, after in pairs if isinstance(before, Mesh)
              and isinstance(after, Mesh)}
    return assets._replace(meshes=meshes) if meshes else assets
