"""What leaving out saves: every built-in scene as planned against everything forced on.

    python benchmarks/leaving_out.py [SCENE …] [--repeats N] [--data DIR]

Prints how many stages and parts of stages are left out, time and memory of both (the most that arrays take at one
moment), their ratios, and whether the two frames are the same bit for bit.
"""

from __future__ import annotations

import argparse

from timing import table
from tqdm import tqdm

from froxel_ref import InputError, load, load_assets
from froxel_ref.measuring import measure_saved
from froxel_ref.scene_files import builtin
from froxel_ref.sequence import moment


def row(name: str, repeats: int, data: str | None) -> tuple[object, ...]:
    scene, settings, folder = load(name, data=data)
    saved = measure_saved(moment(scene, None, 0), settings, load_assets(scene, folder), repeats=repeats)
    planned, forced = saved.planned, saved.forced
    return (name, len(saved.left_out), f"{1e3 * planned.least:.0f}", f"{1e3 * planned.median:.0f}",
            f"{1e3 * forced.least:.0f}", f"{1e3 * forced.median:.0f}", f"{forced.least / planned.least:.1f}x",
            f"{saved.planned_bytes / 1e6:.0f}", f"{saved.forced_bytes / 1e6:.0f}",
            f"{saved.forced_bytes / saved.planned_bytes:.1f}x", "yes" if saved.same else "NO")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("scenes", nargs="*", default=list(builtin()), metavar="SCENE")
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--data", help="folder of the files that scenes name")
    args = parser.parse_args()
    head = ("scene", "left out", "planned ms", "median", "forced ms", "median", "time", "planned MB", "forced MB",
            "memory", "same bits")
    rows = []
    for name in tqdm(args.scenes, leave=False, disable=None):
        try:
            rows.append(row(name, args.repeats, args.data))
        except InputError as error:
            print(f"{name}: left out: {error}")
    print("least and median of several runs, warm, at each scene's own size and precision\n")
    print(table(rows, head))


if __name__ == "__main__":
    main()
