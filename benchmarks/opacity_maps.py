"""What Fourier opacity maps get wrong and what they cost.

    python benchmarks/opacity_maps.py [--sizes N ...] [--harmonics K ...] [--repeats N] [--skip-error]

First the time for the nine lamps of `thesis-hall` at 256² by what they are dimmed by: a uniform medium leaves the
march out. Then the cost of volumetric shadows in a frame, on against off, beside the thesis's table 4.10; its figures
are milliseconds on a GPU, so the ratios are what compares. Last the error of the visibility against exact ways to the
light, over froxels in each lamp's reach, by texels and harmonics, with the time for making and for looking up. It
takes two minutes.
"""

from __future__ import annotations

import argparse
import dataclasses
import time
from functools import partial

import numpy as np
from timing import interleaved, table

from froxel_ref import load, load_assets, run_frame
from froxel_ref.blocks import available_threads
from froxel_ref.fom_plan import map_bytes
from froxel_ref.fom_stage import exact_sights, map_sights, opacity_maps
from froxel_ref.grid import froxel_points, make_froxels
from froxel_ref.lights import light_at
from froxel_ref.scene import DensityTexture, LocalMedium, Medium, NoiseDensity, Scene, Transform
from froxel_ref.settings import Grid, OpacityMaps, Settings, replace

VOLUMETRIC = ("media", "lighting", "integrate", "apply", "fom", "particles")  # what table 4.10 counts
TABLE_4_10 = {(160, 90, 64): ((0.607, 0.929), (3.038, 5.663)), (240, 135, 128): ((1.348, 1.692), (7.857, 10.673))}


def hall() -> tuple[Scene, Settings]:
    scene, settings, _ = load("thesis-hall")
    return scene, replace(settings, volumetric_shadows="maps")


def media() -> dict[str, dict[str, tuple[Medium, ...]]]:
    """What the lamps are dimmed by."""
    scene, _ = hall()
    mist, = scene.local_media
    assert isinstance(mist, LocalMedium)
    drifting = DensityTexture(source=NoiseDensity(), scale=(0.1, 0.1, 0.1))
    room = LocalMedium(extinction=0.05, transform=Transform(translate=(0, 4, -20), scale=(9, 5, 24)))
    return {
        "uniform, everywhere": {"global_media": (Medium(extinction=0.05),), "local_media": ()},
        "uniform, in the mist's ellipsoid": {"global_media": (), "local_media": (
            dataclasses.replace(mist, density=None),)},
        "uniform, in a box about the hall": {"global_media": (), "local_media": (room,)},
        "height fog": {"local_media": ()},
        "height fog and the textured mist": {},
        "textured, everywhere": {"global_media": (Medium(extinction=0.05, density=drifting),), "local_media": ()},
    }


def making(repeats: int) -> list[tuple[object, ...]]:
    scene, settings = hall()
    rows: list[tuple[object, ...]] = []
    for name, what in media().items():
        lamps = dataclasses.replace(scene, lights=scene.lights[1:], **what)  # without the sun
        assets = load_assets(lamps, None)
        found = interleaved({precision: partial(opacity_maps, lamps, settings, assets, dtype=precision)
                             for precision in ("float64", "float32")}, repeats=repeats)
        rows.append((name, *(f"{seconds:.3f}" for timing in found.values() for seconds in timing),
                     f"{map_bytes(lamps, settings) / 2**20:.0f}"))
    return rows


def on_and_off(name: str, grid: tuple[int, int, int], repeats: int) -> tuple[object, ...]:
    """A frame's volumetric stages with and without volumetric shadows, all maps made anew."""
    scene, settings, folder = load(name)
    width, height, depth = grid
    sized = Grid(width=width, height=height, depth=depth, near=settings.grid.near, far=settings.grid.far)
    assets = load_assets(scene, folder)
    least = {"off": np.inf, "maps": np.inf, "kept": np.inf}
    for _ in range(repeats + 1):
        for kind in ("off", "maps"):
            how = replace(settings, grid=sized, volumetric_shadows=kind)
            frame = run_frame(scene, how, assets=assets)
            again = run_frame(scene, how, assets=assets, previous=frame)
            for label, made in ((kind, frame), ("kept" if kind == "maps" else kind, again)):
                least[label] = min(least[label], sum(made.timings.get(stage, 0.0) for stage in VOLUMETRIC))
    thesis = [f"{on / off:.2f}" for off, on in TABLE_4_10[grid]]
    return (f"{name}, {width}x{height}x{depth}", *(f"{1e3 * least[kind]:.0f}" for kind in least),
            f"{least['maps'] / least['off']:.2f}", f"{least['kept'] / least['off']:.2f}", *thesis)


def errors(sizes: list[int], harmonics: list[int]) -> list[tuple[object, ...]]:
    scene, settings = hall()
    scene = dataclasses.replace(scene, lights=scene.lights[1:4])
    settings = replace(settings, grid=dataclasses.replace(settings.grid, width=64, height=36, depth=48))
    assets = load_assets(scene, None)
    points = froxel_points(make_froxels(scene.camera, settings.grid))
    want = {}
    for number, see in exact_sights(scene, settings, assets).items():
        factor = np.broadcast_to(light_at(scene.all_lights[number], points)[1],
                                 np.broadcast_shapes(*(p.shape for p in points)))
        inside = tuple(np.broadcast_to(p, factor.shape)[factor > 0.0] for p in points)
        want[number] = inside, see(inside)
    rows: list[tuple[object, ...]] = []
    for reconstruction in ("fourier", "lanczos", "resolved"):
        for size in sizes:
            for k in harmonics:
                maps = OpacityMaps(harmonics=k, small=size, large=size, smallest=min(size, 64),
                                   reconstruction=reconstruction)
                how = replace(settings, opacity_maps=maps)
                begin = time.perf_counter()
                sees = map_sights(opacity_maps(scene, how, assets), scene, how)
                made = time.perf_counter()
                got = {number: see(want[number][0]) for number, see in sees.items()}
                looked = time.perf_counter()
                off = np.concatenate([got[number] - want[number][1] for number in want])
                rows.append((reconstruction, size, k, f"{np.abs(off).mean():.1e}", f"{np.abs(off).max():.2f}",
                             f"{1e3 * (made - begin) / len(want):.0f}", f"{1e9 * (looked - made) / off.size:.0f}"))
    return rows


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--sizes", type=int, nargs="+", default=[64, 128, 256, 512], metavar="N")
    parser.add_argument("--harmonics", type=int, nargs="+", default=[1, 3, 7, 15], metavar="K")
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--skip-error", action="store_true", help="times alone")
    args = parser.parse_args()
    print(f"{available_threads()} threads\n\nnine lamps at 256², eight coefficients: seconds (allowed: 0.3 where the "
          "medium is uniform, 3 where it is textured)")
    print(table(making(args.repeats), ("dimmed by", "float64 least", "median", "float32 least", "median", "MiB")))
    print("\nvolumetric stages of a frame, float64, milliseconds: shadows of media off, on, and on with the maps of "
          "the frame before;\nbeside it on over off of the thesis's own hall, at the same resolution on two machines "
          "(table 4.10)")
    rows = [on_and_off("thesis-hall", grid, args.repeats) for grid in TABLE_4_10]
    rows.append(on_and_off("particles-in-fog", (160, 90, 64), args.repeats))
    print(table(rows, ("scene", "off", "on", "kept", "on/off", "kept/off", "RX 5700 XT", "GTX 1050")))
    if not args.skip_error:
        print("\nerror of the visibility of three lamps of thesis-hall against exact ways; time for a map [ms] and a "
              "lookup [ns]")
        print(table(errors(args.sizes, args.harmonics), ("reconstruction", "texels", "K", "mean", "largest", "making",
                                                         "lookup")))


if __name__ == "__main__":
    main()
