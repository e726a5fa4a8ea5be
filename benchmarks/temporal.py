"""The thesis's eight configurations (table 3.3): what a checkerboard and merged stages cost and save.

    python benchmarks/temporal.py [--repeat N] [--data DIR]

Times are the least (and the median) of several warm runs within this one; memory is the peak of what NumPy holds.
"""

from __future__ import annotations

import argparse
import dataclasses
import time
import tracemalloc
from collections.abc import Callable
from statistics import median

import numpy as np

from froxel_ref import scene_files
from froxel_ref.assets import load_assets
from froxel_ref.blocks import available_threads
from froxel_ref.frame import FINAL, Frame, run_frame
from froxel_ref.settings import Settings, Temporal, replace

FOG = ("media", "material", "lighting", "merged", "temporal")


def sequence(scene: object, settings: Settings, count: int, **more: object) -> list[Frame]:
    made: list[Frame] = []
    for number in range(count):
        made.append(run_frame(scene, settings, frame=number, previous=made[-1] if made else None, **more))  # type: ignore[arg-type]
    return made


def rms(a: np.ndarray, b: np.ndarray) -> float:
    return float(np.sqrt(np.mean((a - b) ** 2)))


def timed(task: Callable[[], Frame], repeat: int) -> tuple[list[float], list[float], float]:
    """Seconds of the fog's stages and of all, and peak memory in MB."""
    task()
    fog, whole = [], []
    for _ in range(repeat):
        begin = time.perf_counter()
        frame = task()
        whole.append(time.perf_counter() - begin)
        fog.append(sum(frame.timings.get(name, 0.0) for name in FOG))
    tracemalloc.start()
    task()
    peak = tracemalloc.get_traced_memory()[1] / 1e6
    tracemalloc.stop()
    return fog, whole, peak


def configurations(repeat: int, data: str | None) -> None:
    """Of the hall at rest, filtered over time, with the maps of the frame before; the image's error after 8 frames."""
    loaded = scene_files.load("thesis-hall", data=data)
    assets = load_assets(loaded.scene, loaded.folder)
    for size in ((160, 90, 64), (240, 135, 128)):
        grid = dataclasses.replace(loaded.settings.grid, width=size[0], height=size[1], depth=size[2])
        froxels = "x".join(map(str, size))
        print(f"\nthesis-hall, {froxels}, float64, second frame at rest: milliseconds, least (median)")
        print(f"{'merged':<8}{'checkerboard':<14}{'shadows':<9}{'media to filter':>18}{'share':>7}{'frame':>16}"
              f"{'MB':>7}{'image error':>13}")
        for shadows in ("off", "maps"):
            base, plain = 0.0, None
            for checkerboard in (False, True):
                for merged in (False, True):
                    how = replace(loaded.settings, grid=grid, volumetric_shadows=shadows, merged=merged,
                                  checkerboard=checkerboard, temporal=Temporal(filter="scattering"))
                    first = run_frame(loaded.scene, how, assets=assets, outputs=[FINAL])
                    fog, whole, peak = timed(lambda how=how, first=first: run_frame(  # type: ignore[misc]
                        loaded.scene, how, assets=assets, outputs=[FINAL], frame=1, previous=first), repeat)
                    last = sequence(loaded.scene, how, 8, assets=assets, outputs=[FINAL])[-1][FINAL]
                    base, plain = base or min(fog), last if plain is None else plain
                    print(f"{'yes' if merged else 'no':<8}{'yes' if checkerboard else 'no':<14}{shadows:<9}"
                          f"{f'{1e3 * min(fog):.0f} ({1e3 * median(fog):.0f})':>18}{min(fog) / base:>7.2f}"
                          f"{f'{1e3 * min(whole):.0f} ({1e3 * median(whole):.0f})':>16}{peak:>7.0f}"
                          f"{rms(last, plain) / float(plain.mean()):>13.4f}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--repeat", type=int, default=5)
    parser.add_argument("--data", help="folder of the files that scenes name")
    args = parser.parse_args()
    print(f"{available_threads()} threads")
    configurations(args.repeat, args.data)


if __name__ == "__main__":
    main()
