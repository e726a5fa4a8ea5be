"""The thesis's eight configurations (table 3.3) and its tables 4.1 to 4.10, with our times beside the published ones.

    python benchmarks/temporal.py [--repeat N] [--data DIR]

Times are the least and the median of several warm runs within this one, all configurations in turn; sums are of these.
Memory is the peak of what NumPy holds. The hall is at rest, filtered over time, its shadow maps are those of the frame
before, and opacity maps are made anew for each frame, as in the thesis. Images have the scene's 960x540 pixels, but for
"Apply" and table 4.7 the thesis's 1920x1080. Errors are root mean square differences over the mean, after 8 frames.
"""

from __future__ import annotations

import argparse
import dataclasses
import time
import tracemalloc
from collections.abc import Callable, Iterable, Mapping
from itertools import product
from statistics import median
from typing import NamedTuple

import numpy as np
import thesis_tables
from thesis_tables import HIGH, LOW, Configuration, Measured
from timing import Timing, table

from froxel_ref import scene_files
from froxel_ref.assets import load_assets
from froxel_ref.bilateral import half_depth
from froxel_ref.blocks import available_threads
from froxel_ref.frame import FINAL, QUANTITIES, Frame, Progress, run_frame
from froxel_ref.presets import preset
from froxel_ref.scene import Camera, DirectionalLight, Scene
from froxel_ref.scene_files import Loaded
from froxel_ref.settings import Settings, Temporal, replace

FOG = ("media", "material", "lighting", "merged", "temporal")
LIT = ("media", "lighting", "merged")
OPACITY = tuple(name for name in QUANTITIES if name.startswith("fom/"))
FRAMES = 8
SCENE, FAR_SCENE = "thesis-hall", "long-range"


class Run(NamedTuple):
    """A configuration, measured."""

    stages: Mapping[str, Timing]
    fog: Timing
    whole: Timing
    fog_megabytes: float
    megabytes: float
    image: np.ndarray


class Hall(NamedTuple):
    """The scene with all that a frame of it needs."""

    scene: Scene
    settings: Settings
    assets: object

    def frame(self, settings: Settings, **more: object) -> Frame:
        return run_frame(self.scene, settings, assets=self.assets, **more)  # type: ignore[arg-type]


def hall(loaded: Loaded) -> Hall:
    return Hall(loaded.scene, loaded.settings, load_assets(loaded.scene, loaded.folder))


def full_size(camera: Camera) -> Camera:
    return dataclasses.replace(camera, width=1920, height=1080)


def configured(settings: Settings, each: Configuration) -> Settings:
    width, height, depth = each.size
    return replace(settings, grid=dataclasses.replace(settings.grid, width=width, height=height, depth=depth),
                   merged=each.merged, checkerboard=each.checkerboard,
                   volumetric_shadows="maps" if each.shadows else "off", temporal=Temporal(filter="scattering"))


def timing(seconds: Iterable[float]) -> Timing:
    every = list(seconds)
    return Timing(min(every), median(every))


def stage_timings(runs: list[Mapping[str, float]]) -> dict[str, Timing]:
    return {name: timing(run[name] for run in runs) for name in runs[0]}


# --- the eight configurations -----------------------------------------------------------------------


def without_opacity_maps(frame: Frame) -> Frame:
    """A frame from which the next takes its shadow maps and history, but makes opacity maps anew."""
    return dataclasses.replace(frame, kept={group: held for group, held in frame.kept.items()
                                            if not group[0].startswith("fom/")})


def settled(what: Hall, configurations: list[Configuration]) -> dict[Configuration, Frame]:
    """Each configuration after all but the last of so many frames, without their images. Merged ones take those of
    their twins, whose history is theirs to the last bit."""
    frames: dict[Configuration, Frame] = {}
    for number in range(FRAMES - 1):
        for each in (each for each in configurations if not each.merged):
            before = frames.get(each, next(iter(frames.values()), None))
            frames[each] = what.frame(configured(what.settings, each), frame=number, previous=before,
                                      cut=number == 0, outputs=["temporal/valid"])
    return {each: frames[each._replace(merged=False)] for each in configurations}


def peaks(task: Callable[[Progress], object]) -> tuple[float, float]:
    """Memory in MB that a frame takes at most: while its media are made and lit, and at any time."""
    most: dict[str, float] = {}
    running = [""]

    def tell(stage: str, index: int, count: int) -> None:
        most[running[0]] = tracemalloc.get_traced_memory()[1] / 1e6
        tracemalloc.reset_peak()
        running[0] = stage

    tracemalloc.start()
    task(tell)
    tell("", 0, 0)
    tracemalloc.stop()
    return max(most.get(name, 0.0) for name in LIT), max(most.values())


def runs(what: Hall, configurations: list[Configuration], repeat: int) -> dict[Configuration, Run]:
    """All configurations, one frame of each in turn; the first of them is the eighth, whose image is kept."""
    frames, seconds = settled(what, configurations), {each: [] for each in configurations}
    stages, images, most = {each: [] for each in configurations}, {}, {}
    for number in range(FRAMES - 1, FRAMES - 1 + repeat):
        for each in configurations:
            how, before = configured(what.settings, each), without_opacity_maps(frames[each])
            begin = time.perf_counter()
            frames[each] = what.frame(how, frame=number, previous=before, outputs=[FINAL])
            seconds[each].append(time.perf_counter() - begin)
            stages[each].append(frames[each].timings)
            images.setdefault(each, frames[each][FINAL])
    for each in configurations:
        how, before = configured(what.settings, each), without_opacity_maps(frames.pop(each))
        most[each] = peaks(lambda tell, how=how, before=before: what.frame(  # type: ignore[misc]
            how, frame=FRAMES - 1 + repeat, previous=before, outputs=[FINAL], progress=tell))
    return {each: Run(stage_timings(stages[each]),
                      timing(sum(run.get(name, 0.0) for name in FOG) for run in stages[each]),
                      timing(seconds[each]), *most[each], images[each]) for each in configurations}


def shown(one: Timing) -> str:
    return f"{1e3 * one.least:.0f} ({1e3 * one.median:.0f})"


def eight(measured: Mapping[Configuration, Run]) -> str:
    """Table 3.3 with what each row costs; shares are of the row with neither, and the same shadows."""
    lines = []
    for each, run in measured.items():
        plain = measured[each._replace(merged=False, checkerboard=False)]
        published = thesis_tables.published_share(each)
        error = np.sqrt(np.mean((run.image - plain.image) ** 2)) / plain.image.mean()
        yes = ["yes" if value else "no" for value in (each.merged, each.checkerboard, each.shadows)]
        theirs = ("-", "-") if published is None else [f"{share:.2f}" for share in published]
        lines.append((each.number, *yes, shown(run.fog), f"{run.fog.least / plain.fog.least:.2f}", *theirs,
                      shown(run.whole), f"{run.fog_megabytes:.0f}", f"{run.megabytes:.0f}", f"{error:.4f}"))
    return table(lines, ("", "merged", "checkerboard", "shadows", "media to filter", "share", *thesis_tables.GPUS,
                         "frame", "lit MB", "MB", "image error"))


# --- what these do not measure ----------------------------------------------------------------------


def apply_at_full_size(loaded: Loaded, size: tuple[int, int, int], repeat: int) -> Timing:
    """The thesis's lookup, upsampling included, of fog that has no lamps: it costs the same whatever the fog holds."""
    scene = dataclasses.replace(loaded.scene, lights=(), camera=full_size(loaded.scene.camera))
    what = hall(Loaded(scene, loaded.settings, loaded.folder))
    how = replace(configured(loaded.settings, Configuration(size, False, False, False)), temporal=Temporal())
    how = replace(how, taa=dataclasses.replace(how.taa, on=False))
    return stage_timings([what.frame(how, outputs=[FINAL]).timings for _ in range(repeat + 1)][1:])["apply"]


def opacity_maps(what: Hall, suns: bool, repeat: int) -> Timing:
    """Those of the suns, or of the lamps, alone."""
    some = tuple(light for light in what.scene.lights if isinstance(light, DirectionalLight) == suns)
    alone = what._replace(scene=dataclasses.replace(what.scene, lights=some))
    how = replace(what.settings, volumetric_shadows="maps")
    return stage_timings([alone.frame(how, outputs=OPACITY).timings for _ in range(repeat + 1)][1:])["fom"]


def long_range(data: str | None, repeat: int) -> dict[str, Timing] | str:
    """The stages of the long range scene, merged and with a checkerboard, 16 steps and shadow maps as in the thesis."""
    if FAR_SCENE not in scene_files.builtin():
        return f"there is no built-in scene {FAR_SCENE}"
    loaded = scene_files.load(FAR_SCENE, data=data, overrides=[
        *preset("thesis"), "settings.shadows=maps", "settings.long_range.steps=16"])
    scene = dataclasses.replace(loaded.scene, camera=full_size(loaded.scene.camera))
    what = hall(Loaded(scene, loaded.settings, loaded.folder))
    how = configured(loaded.settings, Configuration(LOW, True, True, False))
    last, stages = None, []
    for number in range(repeat + 1):
        last = what.frame(how, frame=number, previous=last, outputs=[FINAL, "surface/depth"])
        begin = time.perf_counter()
        half_depth(last["surface/depth"])
        stages.append(dict(last.timings) | {"downsample": time.perf_counter() - begin})
    return stage_timings(stages[1:])


# --- all of it --------------------------------------------------------------------------------------


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--repeat", type=int, default=5)
    parser.add_argument("--data", help="folder of the files that scenes name")
    args = parser.parse_args()
    loaded = scene_files.load(SCENE, data=args.data)
    what, stages = hall(loaded), {}
    print(f"{available_threads()} threads, float64, least (and median) of {args.repeat} in milliseconds")
    for size in (LOW, HIGH):
        every = [Configuration(size, merged, checkerboard, shadows)
                 for shadows, checkerboard, merged in product((False, True), repeat=3)]
        found = runs(what, every, args.repeat)
        stages |= {each: run.stages for each, run in found.items()}
        print(f"\nTable 3.3: {SCENE}, {'x'.join(map(str, size))}\n{eight(found)}", flush=True)
    as_published = scene_files.load(SCENE, data=args.data, overrides=preset("thesis"))
    measured = Measured(stages, {size: apply_at_full_size(as_published, size, args.repeat) for size in (LOW, HIGH)},
                        *(opacity_maps(what, suns, args.repeat) for suns in (True, False)),
                        long_range(args.data, args.repeat))
    for one in thesis_tables.tables(measured):
        print(f"\n{one}")


if __name__ == "__main__":
    main()
