"""A whole frame, stage by stage: time and peak memory of a built-in scene.

    python benchmarks/whole_frame.py [SCENE=thesis-hall] [--precision float64|float32] [--shadows off|maps|kept]
                                     [--repeats N] [--data DIR]
    python benchmarks/whole_frame.py [SCENE=thesis-hall] --preset thesis [--repeats N] [--data DIR]

Shadows: off, by maps made for every frame, or by maps that are kept from the frame before. With a preset: the steady
frames of a sequence, of which the first three are left out.

Also prints how long `import froxel_ref` takes in a fresh interpreter, beside `import numpy` alone.
"""

from __future__ import annotations

import argparse
import dataclasses
import itertools
import resource
import statistics
import subprocess
import sys
import time
from collections.abc import Iterator

from timing import table

from froxel_ref import scene_files
from froxel_ref.assets import load_assets
from froxel_ref.blocks import available_threads
from froxel_ref.frame import Frame, run_frame
from froxel_ref.presets import preset
from froxel_ref.quantities import final_result
from froxel_ref.scene_files import Loaded
from froxel_ref.sequence import run_sequence

BEGINNING = 3


def import_seconds(module: str, repeats: int = 5) -> float:
    """Least time of an import in a fresh interpreter, the interpreter's own start not counted."""
    code = f"import time; t = time.perf_counter(); import {module}; print(time.perf_counter() - t)"
    return min(float(subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True).stdout)
               for _ in range(repeats))


def alone(loaded: Loaded, count: int, keep: bool) -> Iterator[Frame]:
    """The same frame over and over, with all of its buffers."""
    assets = load_assets(loaded.scene, loaded.folder)
    frame = None
    for _ in range(count):
        # The last one's buffers are not part of this one's memory.
        kept = dataclasses.replace(frame, results={}) if frame is not None and keep else None
        frame = None
        frame = run_frame(loaded.scene, loaded.settings, assets=assets, previous=kept)
        yield frame


def in_sequence(loaded: Loaded, count: int) -> Iterator[Frame]:
    """Frames one after the other, of which the final image is kept."""
    return run_sequence(loaded.scene, frames=count, settings=loaded.settings, outputs=[final_result(loaded.settings)],
                        assets=load_assets(loaded.scene, loaded.folder))


def report(what: str, loaded: Loaded, frames: Iterator[Frame], beginning: int) -> None:
    """Least and median of each stage, and of the whole."""
    stages: dict[str, list[float]] = {}
    begin = time.perf_counter()
    for frame in frames:
        for name, seconds in {**frame.timings, "whole frame": time.perf_counter() - begin}.items():
            stages.setdefault(name, []).append(seconds)
        begin = time.perf_counter()
    g, c = loaded.settings.grid, loaded.scene.camera
    print(f"\n{what}, {g.width}x{g.height}x{g.depth} froxels, {c.width}x{c.height} pixels, "
          f"{available_threads()} threads; milliseconds, first {beginning} left out")
    print(table([(name, f"{1e3 * min(all_[beginning:]):.1f}", f"{1e3 * statistics.median(all_[beginning:]):.1f}")
                 for name, all_ in stages.items()], ("stage", "least", "median")))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("scene", nargs="?", default="thesis-hall")
    parser.add_argument("--precision", choices=("float64", "float32"), nargs="*", default=["float64", "float32"])
    parser.add_argument("--shadows", choices=("off", "maps", "kept"), nargs="*", default=["off", "maps", "kept"])
    parser.add_argument("--preset", help="such as thesis: its sequence instead")
    parser.add_argument("--repeats", type=int, default=9)
    parser.add_argument("--data", help="folder with the scene's files")
    options = parser.parse_args()
    print(f"import numpy {import_seconds('numpy'):.3f} s, import froxel_ref {import_seconds('froxel_ref'):.3f} s, "
          f"import froxel_ref.frame {import_seconds('froxel_ref.frame'):.3f} s (least of 5)")
    if options.preset is not None:
        loaded = scene_files.load(options.scene, data=options.data, overrides=preset(options.preset))
        report(f"{options.scene}, preset {options.preset}, float64", loaded,
               in_sequence(loaded, BEGINNING + options.repeats), BEGINNING)
    else:
        for precision, shadows in itertools.product(options.precision, options.shadows):
            loaded = scene_files.load(options.scene, data=options.data, overrides=[
                f"settings.precision={precision}", f"settings.shadows={'off' if shadows == 'off' else 'maps'}"])
            report(f"{options.scene}, {precision}, shadows {shadows}", loaded,
                   alone(loaded, 1 + options.repeats, shadows == "kept"), 1)
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    print(f"\npeak resident memory of this process: {peak:.0f} MiB")


if __name__ == "__main__":
    main()
