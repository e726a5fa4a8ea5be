"""What a stage is, and what it is given to work on."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from froxel_ref.arrays import Field
from froxel_ref.assets import Assets
from froxel_ref.geometry import Rays, camera_rays
from froxel_ref.grid import Froxels, make_froxels
from froxel_ref.jitter import froxel_jitter
from froxel_ref.scene import Camera, Scene
from froxel_ref.settings import Grid, Settings
from froxel_ref.taa import pixel_offsets

__all__ = ["History", "Job", "Need", "Part", "Results", "Same", "Stage"]

MIDDLE = (0.5, 0.5, 0.5)


@dataclass(frozen=True)
class History:
    """What a frame hands to the next: its filtered fields and image, and where they were seen from.

    ``length`` counts the frames that it holds since it was begun.
    """

    fields: Mapping[str, Field]
    camera: Camera
    grid: Grid
    exposure: float
    length: int

    def has(self, name: str) -> bool:
        """Whether it holds a field."""
        return name in self.fields and self.fields[name].size > 0


@dataclass(frozen=True)
class Job:
    """What every stage may look at: the scene, the settings, the files' arrays, and how to run.

    ``full`` forces every part with fields that carry all their axes; ``asked`` names the results to keep,
    for a stage that has some which no other stage reads. ``frame`` is this frame's number in a sequence, ``history``
    what the one before it hands on.
    """

    scene: Scene
    settings: Settings
    assets: Assets
    threads: int | None = None
    full: bool = False
    asked: frozenset[str] = frozenset()
    frame: int = 0
    history: History | None = None

    @property
    def dtype(self) -> np.dtype[np.floating]:
        """Type of the arithmetic."""
        return np.dtype(self.settings.precision)

    @property
    def jitter(self) -> tuple[float, float, float]:
        """Where in its froxel this frame's sample lies."""
        how = self.settings
        if how.temporal.filter == "off" or how.jitter == "off":
            return MIDDLE
        # Each colour of a checkerboard has its turn at every point.
        hold = 2 if how.checkerboard and how.jitter == "centred" else 1
        return froxel_jitter(self.frame, points=how.jitter, hold=hold)

    @property
    def image_shape(self) -> tuple[int, int]:
        """Height and width of the image."""
        return self.scene.camera.height, self.scene.camera.width

    @property
    def pixel_shift(self) -> tuple[float, float]:
        """How far to the right and downwards of their centres this frame samples its pixels."""
        if not self.settings.taa.on or self.settings.taa_points == "off" or self.scene.image_buffers is not None:
            return 0.0, 0.0
        x, y = pixel_offsets(self.frame, points=self.settings.taa_points).tolist()
        return x, y

    @property
    def exposure(self) -> float:
        """The factor that light holds already, before display (A12)."""
        return self.scene.camera.exposure if self.settings.exposure == "lighting" else 1.0

    @cached_property
    def froxels(self) -> Froxels:
        """The froxel grid of this camera, its samples where this frame has them."""
        return self._froxels(self.jitter)

    @cached_property
    def centres(self) -> Froxels:
        """The froxel grid with the samples in the middle."""
        return self.froxels if self.jitter == MIDDLE else self._froxels(MIDDLE)

    def _froxels(self, jitter: tuple[float, float, float]) -> Froxels:
        froxels = make_froxels(self.scene.camera, self.settings.grid, jitter=jitter, dtype=self.dtype)
        return froxels._replace(rays=_whole(froxels.rays)) if self.full else froxels

    @cached_property
    def image_rays(self) -> Rays:
        """The rays through the image's pixels, where this frame samples them."""
        camera, (right, down) = self.scene.camera, self.pixel_shift
        rays = camera_rays(camera, camera.width, camera.height, jitter=(0.5 + right, 0.5 + down), dtype=self.dtype)
        return _whole(rays) if self.full else rays


@dataclass(frozen=True)
class Part:
    """A piece of a stage that a scene may not need."""

    name: str
    runs: bool
    why: str


Results = Mapping[str, Field]
Need = tuple[bool, str]


@dataclass(frozen=True)
class Stage:
    """One stage: its data flow, when it is needed, what stands for it when not, and how it runs.

    ``keys`` says what groups of its results depend on: of an earlier frame with an equal key they are handed to
    ``run`` among what it reads, and it hands them on.
    """

    name: str
    about: str
    reads: tuple[str, ...]
    writes: tuple[str, ...]
    needed: Callable[[Scene, Settings], Need]
    neutral: Callable[[Job], dict[str, Field]]
    run: Callable[[Job, Results], dict[str, Field]]
    parts: Callable[[Scene, Settings], tuple[Part, ...]] = lambda scene, settings: ()
    keys: Callable[[Job], Mapping[tuple[str, ...], Hashable]] = lambda job: {}


class Same:
    """An array that is equal to itself alone, for the keys of results that outlive a frame.

    Whether a file that was read again holds the same numbers need not be looked up.
    """

    def __init__(self, thing: object) -> None:
        self.thing = thing

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Same) and other.thing is self.thing

    def __hash__(self) -> int:
        return id(self.thing)


def _whole(rays: Rays) -> Rays:
    shape = rays.length.shape
    x, y, z = (np.ascontiguousarray(np.broadcast_to(component, shape)) for component in rays.per_depth)
    return rays._replace(per_depth=(x, y, z))
