"""What leaving out saves: every built-in scene as planned against everything forced on.

    python benchmarks/leaving_out.py [SCENE …] [--repeats N]

Prints time and memory of both, their ratio, and whether the two frames are the same bit for bit.
"""

from __future__ import annotations

import argparse

import numpy as np
from timing import interleaved, table
from tqdm import tqdm

from froxel_ref import scene_files
from froxel_ref.assets import load_assets
from froxel_ref.frame import FINAL, Frame, run_frame


def held(frame: Frame) -> int:
    """Bytes of all results."""
    return sum(field.nbytes for field in frame.results.values())


def row(name: str, repeats: int) -> tuple[object, ...]:
    scene, settings, folder = scene_files.load(name)
    assets = load_assets(scene, folder)
    frames: dict[bool, Frame] = {}

    def run(force_all: bool) -> None:
        frames[force_all] = run_frame(scene, settings, assets=assets, force_all=force_all)

    times = interleaved({"planned": lambda: run(False), "forced": lambda: run(True)}, repeats=repeats)
    same = all(np.array_equal(*np.broadcast_arrays(frames[False][q], frames[True][q]), equal_nan=True)
               for q in frames[False].results)
    same = same and np.array_equal(*np.broadcast_arrays(frames[False][FINAL], frames[True][FINAL]))
    planned, forced = times["planned"], times["forced"]
    left_out = sum(not part.runs for stage in frames[False].plan.stages for part in stage.parts)
    left_out += len(frames[False].plan.left_out)
    return (name, left_out, f"{1e3 * planned.least:.1f}", f"{1e3 * forced.least:.1f}",
            f"{forced.least / planned.least:.1f}x", f"{held(frames[False]) / 1e6:.1f}",
            f"{held(frames[True]) / 1e6:.1f}", f"{held(frames[True]) / held(frames[False]):.1f}x",
            "yes" if same else "NO")


def main() -> None:
    every = [name for name in scene_files.builtin() if name != "smoke"]  # smoke needs files from elsewhere
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("scenes", nargs="*", default=every, metavar="SCENE")
    parser.add_argument("--repeats", type=int, default=5)
    options = parser.parse_args()
    head = ("scene", "left out", "planned ms", "forced ms", "time", "planned MB", "forced MB", "memory", "same bits")
    print("least of several runs, warm, at each scene's own size and precision\n")
    rows = [row(name, options.repeats) for name in tqdm(options.scenes, leave=False, disable=None)]
    print(table(rows, head))


if __name__ == "__main__":
    main()
