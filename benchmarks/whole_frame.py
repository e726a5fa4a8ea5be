"""A whole frame, stage by stage: time and peak memory of a built-in scene.

    python benchmarks/whole_frame.py [SCENE=thesis-hall] [--precision float64|float32] [--shadows off|maps|kept]
                                     [--repeats N] [--data DIR]

Shadows: off, by maps made for every frame, or by maps that are kept from the frame before.

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

from timing import table

from froxel_ref import scene_files
from froxel_ref.assets import load_assets
from froxel_ref.blocks import available_threads
from froxel_ref.frame import run_frame


def import_seconds(module: str, repeats: int = 5) -> float:
    """Least time of an import in a fresh interpreter, the interpreter's own start not counted."""
    code = f"import time; t = time.perf_counter(); import {module}; print(time.perf_counter() - t)"
    return min(float(subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True).stdout)
               for _ in range(repeats))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("scene", nargs="?", default="thesis-hall")
    parser.add_argument("--precision", choices=("float64", "float32"), nargs="*", default=["float64", "float32"])
    parser.add_argument("--shadows", choices=("off", "maps", "kept"), nargs="*", default=["off", "maps", "kept"])
    parser.add_argument("--repeats", type=int, default=9)
    parser.add_argument("--data", help="folder with the scene's files")
    options = parser.parse_args()
    print(f"import numpy {import_seconds('numpy'):.3f} s, import froxel_ref {import_seconds('froxel_ref'):.3f} s, "
          f"import froxel_ref.frame {import_seconds('froxel_ref.frame'):.3f} s (least of 5)")
    for precision, shadows in itertools.product(options.precision, options.shadows):
        scene, settings, folder = scene_files.load(
            options.scene, data=options.data, overrides=[
                f"settings.precision={precision}", f"settings.shadows={'off' if shadows == 'off' else 'maps'}"])
        assets = load_assets(scene, folder)
        stages: dict[str, list[float]] = {}
        frame = None
        for _ in range(options.repeats + 1):
            # The last one's buffers are not part of this one's memory.
            kept = dataclasses.replace(frame, results={}) if frame is not None and shadows == "kept" else None
            frame = None
            begin = time.perf_counter()
            frame = run_frame(scene, settings, assets=assets, previous=kept)
            total = time.perf_counter() - begin
            for name, seconds in {**frame.timings, "whole frame": total}.items():
                stages.setdefault(name, []).append(seconds)
        g, c = settings.grid, scene.camera
        print(f"\n{options.scene}, {precision}, shadows {shadows}, "
              f"{g.width}x{g.height}x{g.depth} froxels, {c.width}x{c.height} pixels, "
              f"{available_threads()} threads; milliseconds, first run left out")
        rows = [(name, f"{1e3 * min(all_[1:]):.1f}", f"{1e3 * statistics.median(all_[1:]):.1f}")
                for name, all_ in stages.items()]
        print(table(rows, ("stage", "least", "median")))
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    print(f"\npeak resident memory of this process: {peak:.0f} MiB")


if __name__ == "__main__":
    main()
