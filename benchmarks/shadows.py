"""What shadow maps get wrong and what they cost.

    python benchmarks/shadows.py [--sizes N ...] [--repeats N] [--skip-error]

First the share of froxels that a map without filter lights differently than a ray from the froxel's sample, for
every light of `shaft` and `thesis-hall` whose reach they are in: it falls as 1/size. Then time and memory of the
maps of `thesis-hall` (a sun with four cascades, nine point lights) against their size, made anew and taken over
from the frame before; and of a whole frame with shadows off, by maps, by maps taken over, and by rays.
"""

from __future__ import annotations

import argparse
import dataclasses
import statistics
import time
import tracemalloc
from collections.abc import Callable, Iterator

import numpy as np
from timing import table

from froxel_ref import load, load_assets, run_frame
from froxel_ref.blocks import available_threads
from froxel_ref.grid import froxel_points, make_froxels
from froxel_ref.lights import light_at
from froxel_ref.settings import Settings, ShadowMaps, replace
from froxel_ref.shadow_stage import exact_sights, map_bytes, map_lights, map_sights, shadow_maps

SCENES = ("shaft", "thesis-hall")


def sized(size: int, **changes: object) -> ShadowMaps:
    return ShadowMaps(directional_size=size, spot_size=size, point_size=size, **changes)  # type: ignore[arg-type]


def disagreement(name: str, sizes: list[int]) -> Iterator[tuple[object, ...]]:
    scene, settings, folder = load(name)
    assets = load_assets(scene, folder)
    froxels = make_froxels(scene.camera, settings.grid)
    points = froxel_points(froxels)
    exact = exact_sights(scene, assets)
    truth, reach = {}, {}
    for number, see in exact.items():
        factor = np.broadcast_to(light_at(scene.all_lights[number], points)[1], np.broadcast_shapes(
            *(p.shape for p in points)))
        reach[number] = factor > 0.0
        inside = tuple(np.broadcast_to(p, factor.shape)[reach[number]] for p in points)
        truth[number] = see(inside), inside
    for layout in ("cube", "octahedral"):
        wrong: dict[str, list[float]] = {}
        for size in sizes:
            how = replace(settings, shadow_maps=sized(size, kernel=0, point_map=layout))
            sees = map_sights(shadow_maps(scene, how, assets), scene, how, assets)
            for kind, numbers in map_lights(scene).items():
                if not numbers or (layout == "octahedral" and kind != "point"):
                    continue
                bad = sum(int((sees[n](truth[n][1]) != truth[n][0]).sum()) for n in numbers)
                label = layout if kind == "point" else kind
                wrong.setdefault(label, []).append(bad / sum(truth[n][0].size for n in numbers))
        for label, shares in wrong.items():
            slope = -np.polyfit(np.log(sizes), np.log(shares), 1)[0] if min(shares) > 0 else float("nan")
            yield (name, label, *[f"{100 * s:.3f} %" for s in shares], f"{slope:.2f}")


def timed(run: Callable[[], object], repeats: int) -> tuple[float, float]:
    run()
    seconds = []
    for _ in range(repeats):
        begin = time.perf_counter()
        run()
        seconds.append(time.perf_counter() - begin)
    return min(seconds), statistics.median(seconds)


def peak_megabytes(run: Callable[[], object]) -> float:
    """Most memory that arrays took during a run, beside what stood before."""
    tracemalloc.start()
    run()
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    return peak / 2**20


def costs(sizes: list[int], repeats: int) -> Iterator[tuple[object, ...]]:
    scene, settings, folder = load("thesis-hall")
    assets = load_assets(scene, folder)
    sun = dataclasses.replace(scene, lights=scene.lights[:1])
    lamps = dataclasses.replace(scene, lights=scene.lights[1:])
    for size in sizes:
        for label, part, layout in (("4 cascades", sun, "cube"), ("9 cubes", lamps, "cube"),
                                    ("9 octahedra", lamps, "octahedral"), ("4 cascades and 9 cubes", scene, "cube"),
                                    ("4 cascades and 9 octahedra", scene, "octahedral")):
            how = replace(settings, shadow_maps=sized(size, point_map=layout))

            def make(part: object = part, how: Settings = how) -> object:
                return shadow_maps(part, how, assets)  # type: ignore[arg-type]

            least, median = timed(make, repeats)
            held = map_bytes(part, how)
            yield (f"{size}²", label, f"{1e3 * least:.0f}", f"{1e3 * median:.0f}", f"{held / 2**20:.1f}",
                   f"{peak_megabytes(make):.1f}")


def frames(repeats: int) -> Iterator[tuple[object, ...]]:
    for name in SCENES:
        scene, settings, folder = load(name)
        assets = load_assets(scene, folder)
        before = run_frame(scene, settings, assets=assets)
        for label, shadows, previous in (("off", "off", None), ("maps, made anew", "maps", None),
                                         ("maps, taken over", "maps", before), ("rays", "exact", None)):
            how = replace(settings, shadows=shadows)
            count = 1 if shadows == "exact" else repeats
            seconds: list[dict[str, float]] = []
            for _ in range(count + (count > 1)):
                begin = time.perf_counter()
                frame = run_frame(scene, how, assets=assets, previous=previous)
                seconds.append(dict(frame.timings) | {"whole": time.perf_counter() - begin})
            least = {key: min(s[key] for s in seconds) for key in seconds[0]}
            median = statistics.median(s["whole"] for s in seconds)
            yield (name, label, *[f"{1e3 * least.get(stage, 0.0):.0f}" for stage in (
                "shadow", "surface", "lighting", "whole")], f"{1e3 * median:.0f}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--sizes", type=int, nargs="+", default=[64, 128, 256, 512, 1024, 2048])
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--skip-error", action="store_true", help="costs alone")
    args = parser.parse_args()
    print(f"{available_threads()} cores, float64\n")
    if not args.skip_error:
        rows = [row for name in SCENES for row in disagreement(name, args.sizes)]
        print("froxels that a map lights differently than a ray, of those in a light's reach; "
              "order: fitted slope against size\n")
        print(table(rows, ("scene", "maps", *[f"{s}²" for s in args.sizes], "order")) + "\n")
    sizes = [s for s in args.sizes if 256 <= s <= 1024] or args.sizes[:1]
    print(table(list(costs(sizes, max(1, args.repeats // 2))), (
        "size", "thesis-hall", "least ms", "median ms", "maps, MiB", "peak, MiB")) + "\n")
    print(table(list(frames(args.repeats)), (
        "scene", "shadows", "shadow ms", "surface ms", "lighting ms", "whole, least ms", "whole, median ms")))


if __name__ == "__main__":
    main()
