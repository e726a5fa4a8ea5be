"""A frame: the plan of what a scene needs, and the run of its stages with nothing else.

The plan walks back from the asked-for outputs through the stage table (`froxel_ref.stages`), drops
every stage that this scene does not need, and says why. A dropped stage stands for its neutral value.
"""

from __future__ import annotations

import math
import os
import time
from collections.abc import Callable, Hashable, Iterable, Mapping
from dataclasses import dataclass, field

import numpy as np

from froxel_ref import material_stage, temporal_stage
from froxel_ref.arrays import Field
from froxel_ref.assets import Assets, load_assets
from froxel_ref.culling import list_shapes
from froxel_ref.fom_plan import crossing_bytes
from froxel_ref.fom_plan import map_bytes as opacity_bytes
from froxel_ref.forcing import forced
from froxel_ref.jobs import History, Job, Part, Stage
from froxel_ref.lights import with_intensities
from froxel_ref.quantities import AVERAGED, FINAL, QUANTITIES, Quantity, final_result, raster_size
from froxel_ref.records import InputError, shown, suggest
from froxel_ref.scene import Folds, HeightField, PointLight, Scene
from froxel_ref.settings import Settings
from froxel_ref.shadow_stage import map_bytes
from froxel_ref.stages import STAGES

__all__ = [
    "FINAL", "QUANTITIES", "Frame", "Plan", "Planned", "Quantity", "estimate_bytes", "plan", "remembered",
    "run_frame", "working_bytes",
]

Progress = Callable[[str, int, int], None]


@dataclass(frozen=True)
class Planned:
    """One stage of a plan: whether it runs, why, and what it leaves out within itself."""

    stage: Stage
    runs: bool
    why: str
    parts: tuple[Part, ...] = ()

    @property
    def name(self) -> str:
        """The stage's name."""
        return self.stage.name


@dataclass(frozen=True)
class Plan:
    """What a frame will do, stage by stage, and which results it keeps."""

    stages: tuple[Planned, ...]
    outputs: tuple[str, ...]

    def __getitem__(self, name: str) -> Planned:
        for planned in self.stages:
            if planned.name == name:
                return planned
        raise KeyError(f"{name!r} is not a stage; {suggest(name, [planned.name for planned in self.stages])}")

    def written_by(self, planned: Planned) -> tuple[str, ...]:
        """The results that a stage has made, or stands for: not what another one makes in its stead (merged)."""
        if planned.runs:
            return planned.stage.writes
        made = {name for other in self.stages if other.runs for name in other.stage.writes}
        return tuple(name for name in planned.stage.writes if name not in made)

    @property
    def left_out(self) -> tuple[Planned, ...]:
        """The stages that do not run."""
        return tuple(planned for planned in self.stages if not planned.runs)


@dataclass(frozen=True)
class Frame:
    """The results of a run by name, the plan that made them, and seconds per stage.

    ``kept`` holds what the next frame may take over if nothing that it depends on has changed (shadow maps);
    ``reused`` names the results that this frame took over. ``history`` is what temporal filters hand to the next.
    """

    results: Mapping[str, Field]
    plan: Plan
    timings: Mapping[str, float]
    scene: Scene
    settings: Settings
    kept: Mapping[tuple[str, ...], tuple[Hashable, Mapping[str, Field]]] = field(default_factory=dict)
    reused: tuple[str, ...] = ()
    history: History | None = None

    def __getitem__(self, name: str) -> Field:
        if name not in self.results:
            raise KeyError(f"{name!r} is not among the results; {suggest(name, self.results)}")
        return self.results[name]

    @property
    def image(self) -> Field:
        """The final radiance, averaged over frames where temporal anti-aliasing is on."""
        return self[final_result(self.settings)]

    @property
    def display_exposure(self) -> float:
        """The factor from the final radiance to display: 1 where the lighting already holds it (A12)."""
        return 1.0 if self.settings.exposure == "lighting" else self.scene.camera.exposure


def estimate_bytes(scene: Scene, settings: Settings) -> int:
    """Memory that a frame's results take at most: if every field varied on all its axes.

    Parameters
    ----------
    scene : Scene
    settings : Settings

    Returns
    -------
    int
        Bytes of all results at full size. While it runs a frame needs more: `working_bytes`.

    Examples
    --------
    >>> estimate_bytes(Scene(), Settings()) // 10**6
    220
    """
    media = scene.global_media + scene.local_media
    lobes = _lobes(scene, settings)
    tints = 3 if any(isinstance(medium.extinction, tuple) for medium in media) else 1
    total = 0
    for name, quantity in QUANTITIES.items():
        if name.startswith(("shadow/", "fom/", "culling/")) or _idle(name, settings):
            continue
        rows, columns = raster_size(quantity, scene.camera, settings.grid)
        size = {"c": 3, "l": lobes, "m": 1, "z": settings.grid.depth, "y": rows, "x": columns}
        tinted = name.endswith(("extinction", "transmittance")) and not name.startswith("particles/")
        total += math.prod(size[axis] for axis in quantity.axes) * (tints if tinted else 1)
    return (total * np.dtype(settings.precision).itemsize + map_bytes(scene, settings)
            + opacity_bytes(scene, settings) + _list_bytes(scene, settings))


def _idle(name: str, settings: Settings) -> bool:
    """Whether a result of what the settings leave out is empty."""
    if name.startswith(("long_range/", "taa/")):
        return not (settings.long_range.march if name.startswith("long_range/") else settings.taa.on)
    if name.endswith("/guessed") and not (settings.checkerboard and settings.filled_holes == "replaced"):
        return True
    if name == "temporal/guessed":
        return not temporal_stage.averages_light(settings)
    if name in ("lighting/phase_ratio", "temporal/unphased"):
        return settings.temporal.filter != "unphased"
    if name.startswith("material/"):
        return settings.temporal.filter != "media"
    return name.startswith("temporal/") and not temporal_stage.needs_filter(settings)[0]


def _bounded(scene: Scene) -> tuple[int, int]:
    """How many lights and local media lists may hold, at most."""
    lights = sum(isinstance(light, PointLight) for light in scene.lights) + scene.extra_lights.count
    return lights, len(scene.local_media)


def _list_bytes(scene: Scene, settings: Settings) -> int:
    """What the lists of lights and local media take at most."""
    how = settings.culling
    return sum(4 * math.prod(shape) for count in _bounded(scene)
               for shape in list_shapes(count, scene.camera, tile=how.tile, bins=how.bins))


def working_bytes(scene: Scene, settings: Settings) -> int:
    """Memory that a frame needs beside its results, about.

    Parameters
    ----------
    scene : Scene
    settings : Settings

    Returns
    -------
    int
        Bytes of what grows with the scene: each lobe of a mixture before it is stacked, each lamp's
        distances per ray, each height field's triangles, particles' crossings with the rays of opacity maps, each
        transparent surface's layer with the particles behind it, the lists of lights twice more; and a quarter of the
        results for all else.

    Examples
    --------
    >>> working_bytes(Scene(), Settings()) // 10**6
    55
    """
    grid, item = settings.grid, np.dtype(settings.precision).itemsize
    lobes = _lobes(scene, settings)
    folds = [surface.heights.size for surface in scene.all_surfaces
             if isinstance(surface, HeightField) and isinstance(surface.heights, Folds)]
    lamps, _ = _bounded(scene)
    panes = sum(each.visible for each in scene.transparent_surfaces)
    # A lamp keeps two numbers per ray (a spot light four) and some 32 bytes per slice; a fold's 1:4 grid of
    # heights has two triangles a cell, of some 128 bytes each while they are hit.
    return (3 * lobes * grid.width * grid.height * grid.depth * item
            + lamps * (4 * grid.width * grid.height * item + 32 * grid.depth)
            + 9 * panes * scene.camera.width * scene.camera.height * item
            + sum(64 * size * size for size in folds) + crossing_bytes(scene, settings)
            + 2 * _list_bytes(scene, settings) + estimate_bytes(scene, settings) // 4)


def _lobes(scene: Scene, settings: Settings) -> int:
    """How many lobes the exact mixture of phase functions may keep apart."""
    media = scene.global_media + scene.local_media
    return len({medium.phase_anisotropy for medium in media}) if settings.phase_mixing == "mixture" else 0


def _machine_bytes() -> int:
    try:
        return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    except (AttributeError, OSError, ValueError):  # not a POSIX system: no figure, so no early refusal
        return 1 << 62


def _check_size(scene: Scene, settings: Settings) -> None:
    need, have = estimate_bytes(scene, settings) + working_bytes(scene, settings), _machine_bytes()
    # The words of all tiles, and as many again while they are made and while blocks look them up.
    lists = 3 * _list_bytes(scene, settings)
    if lists > 0.8 * have:
        lights, local = _bounded(scene)
        raise InputError(
            "settings.culling.tile", f"is {settings.culling.tile} pixels: the light words of all tiles, for {lights} "
            f"lights and {local} local media, need up to {lists / 2**30:,.1f} GiB, more than memory allows "
            f"(80 % of {have / 2**30:,.1f} GiB)")
    maps = map_bytes(scene, settings)
    if need > 0.8 * have and maps > 0.5 * need:
        raise InputError(
            "settings.shadow_maps", f"need up to {maps / 2**30:,.1f} GiB for depths alone, all must stay below 80 % of "
            f"this machine's {have / 2**30:,.1f} GiB")
    opacity = opacity_bytes(scene, settings)
    if need > 0.8 * have and opacity > 0.5 * need:
        raise InputError(
            "settings.opacity_maps", f"need up to {opacity / 2**30:,.1f} GiB, all must stay below 80 % of this "
            f"machine's {have / 2**30:,.1f} GiB")
    if need > 0.8 * have:
        g, c = settings.grid, scene.camera
        raise InputError(
            "settings.grid", f"{g.width}x{g.height}x{g.depth} froxels and {c.width}x{c.height} pixels need "
            f"up to {need / 2**30:,.1f} GiB, must stay below 80 % of this machine's {have / 2**30:,.1f} GiB")


def plan(scene: Scene, settings: Settings | None = None, outputs: Iterable[str] | None = None, *,
         force_all: bool = False) -> Plan:
    """Which stages this frame runs, and why.

    Parameters
    ----------
    scene : Scene
    settings : Settings, optional
    outputs : iterable of str, optional
        Names of the results to keep (see `QUANTITIES`); default: all of them.
    force_all : bool
        Run everything, needed or not: the comparison that shows that leaving out changes nothing.

    Returns
    -------
    Plan

    Raises
    ------
    InputError
        An unknown output, or a size that this machine's memory cannot hold.

    Examples
    --------
    >>> print(plan(Scene())["media"].why)
    the scene has no medium with extinction or emission
    """
    settings = settings or Settings()
    _check_size(scene, settings)
    wanted = tuple(QUANTITIES) if outputs is None else tuple(dict.fromkeys(outputs))
    for name in wanted:
        if name not in QUANTITIES:
            raise InputError("outputs", f"{name!r} is not a result; {suggest(name, QUANTITIES)}")
    asked = set(wanted)
    planned: list[Planned] = []
    for stage in reversed(STAGES):
        if force_all:
            runs, why = True, "forced"
        elif not asked & set(stage.writes):
            runs, why = False, "nothing that was asked for reads it"
        else:
            runs, why = stage.needed(scene, settings)
        if runs:
            asked |= set(stage.reads)
        planned.append(Planned(stage, runs, why, stage.parts(scene, settings) if runs else ()))
    return Plan(tuple(reversed(planned)), wanted)


def run_frame(scene: Scene, settings: Settings | None = None, *, assets: Assets | None = None,
              outputs: Iterable[str] | None = None, force_all: bool = False, threads: int | None = None,
              progress: Progress | None = None, previous: Frame | None = None, frame: int = 0,
              cut: bool = False) -> Frame:
    """Compute a frame: every stage that its plan keeps, in order.

    Parameters
    ----------
    scene : Scene
    settings : Settings, optional
    assets : Assets, optional
        What the scene's files hold (`load_assets`); needed where the scene names files.
    outputs : iterable of str, optional
        Names of the results to keep (see `QUANTITIES`); default: all of them. Other results are dropped
        as soon as their last reader has run.
    force_all : bool
        Run every stage and every part of it with neutral values, on fields that carry all their axes.
    threads : int, optional
        Default: one per core. The result does not depend on it.
    progress : callable, optional
        Called as ``progress(stage, index, count)`` before each stage.
    previous : Frame, optional
        The frame before. Its shadow and opacity maps are taken over where nothing that they depend on has
        changed: the result is the same to the last bit, for assets as `load_assets` gives them. Temporal filters
        go on from its history.
    frame : int
        Number in a sequence, from 0: of jitter, noise and checkerboard.
    cut : bool
        Whether what is seen has nothing to do with the frame before: history begins anew.

    Returns
    -------
    Frame
        ``results`` maps names to arrays, channel first, with length-1 axes where nothing varies. The
        results of stages that were left out are their neutral values.

    Raises
    ------
    InputError
        An unknown output, a size beyond the memory, or a file that the scene needs.

    Notes
    -----
    L = L_scene·T + L_fog [Dörries 2020, eq. 2.11, listing 3.5]. Blocks and threads never change a bit of
    the result; neither does leaving out, since a neutral value is an exact 0 or 1.

    Examples
    --------
    >>> frame = run_frame(Scene(background=(0.5, 0.5, 0.5)), outputs=[FINAL])
    >>> frame[FINAL].shape, float(frame[FINAL].max())
    ((3, 1, 1), 0.5)
    """
    if previous is not None and not isinstance(previous, Frame):
        raise InputError("previous", f"is a {type(previous).__name__}, must be a Frame")
    if isinstance(frame, bool) or not isinstance(frame, int | np.integer) or frame < 0:
        raise InputError("frame", f"is {shown(frame)}, must be a whole number of at least 0")
    settings = settings or Settings()
    the_plan = plan(scene, settings, outputs, force_all=force_all)
    if assets is None:
        assets = load_assets(scene, None)
    job = Job(with_intensities(scene, settings.light_power), settings, assets, threads, force_all,
              frozenset(the_plan.outputs), int(frame), None if previous is None or cut else previous.history)
    if force_all:
        job = forced(job)
    running = [planned.stage for planned in the_plan.stages if planned.runs]
    results: dict[str, Field] = {}
    for planned in the_plan.stages:
        if not planned.runs:
            results |= planned.stage.neutral(job)
    timings = {}
    kept: dict[tuple[str, ...], tuple[Hashable, Mapping[str, Field]]] = {}
    reused: list[str] = []
    held: dict[str, Field] = {}
    for index, stage in enumerate(running):
        if progress is not None:
            progress(stage.name, index, len(running))
        begin = time.perf_counter()
        keys = stage.keys(job)
        known = {name: array for group, key in keys.items() if previous is not None and group in previous.kept
                 and previous.kept[group][0] == key for name, array in previous.kept[group][1].items()}
        made = stage.run(job, {name: results[name] for name in stage.reads} | known)
        timings[stage.name] = time.perf_counter() - begin
        kept |= {group: (key, {name: made[name] for name in group}) for group, key in keys.items()}
        reused += known
        held |= {name: made[name] for name in remembered(settings) if name in made}
        results |= made
        still_read = {name for later in running[index + 1:] for name in later.reads} | set(the_plan.outputs)
        results = {name: field for name, field in results.items() if name in still_read}
    wanted = {name: results[name] for name in QUANTITIES if name in results and name in the_plan.outputs}
    return Frame(wanted, the_plan, timings, scene, settings, kept, tuple(reused), _history(job, held))


def remembered(settings: Settings) -> frozenset[str]:
    """The results that a frame hands to the next.

    Parameters
    ----------
    settings : Settings

    Returns
    -------
    frozenset of str

    Examples
    --------
    >>> from froxel_ref.settings import AntiAliasing
    >>> sorted(remembered(Settings(taa=AntiAliasing(on=True))))
    ['taa/radiance']
    """
    names = {AVERAGED} if settings.taa.on else set()
    if settings.temporal.filter == "media":
        names |= set(material_stage.HISTORY)
    return frozenset(names | set(temporal_stage.HISTORY if temporal_stage.needs_filter(settings)[0] else ()))


def _history(job: Job, held: Mapping[str, Field]) -> History | None:
    """What temporal filters hand to the next frame; nothing where none ran."""
    if not held:
        return None
    for array in held.values():
        array.flags.writeable = False
    fog = (temporal_stage.HISTORY[1], material_stage.HISTORY[0])
    goes_on = job.history is not None and any(job.history.has(name) for name in fog)
    length = job.history.length + 1 if job.history is not None and goes_on else 1
    return History(held, job.scene.camera, job.settings.grid, job.exposure, length)
