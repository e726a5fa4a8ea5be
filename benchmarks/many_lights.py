"""Many lights: time of culling, of in-scattering and of shading, from 9 lights on thesis-hall to 521.

    python benchmarks/many_lights.py [--repeats N] [--counts 0 7 23 55 119 247 503 512] [--precision float64 float32]

The hall's nine lamps of 16 m, and lights of 4 m strewn between them. Times are the least and the median of
several runs, warm and interleaved; ratios are of the least. "Touched" are pairs of a froxel and a light that
truly reaches it, "visited" those that in-scattering works on, "listed" those in the lists of tiles and bins; the
slope is that of a line through the logarithms of time and of visited pairs.
"""

from __future__ import annotations

import argparse
import dataclasses
from collections.abc import Callable

import numpy as np
from timing import Timing, interleaved, table

from froxel_ref import culling, fog_stages, lamp_batches, lighting, scene_files, shading, surface
from froxel_ref.assets import load_assets
from froxel_ref.blocks import available_threads
from froxel_ref.culling import Tiling
from froxel_ref.frame import run_frame
from froxel_ref.geometry import camera_rays
from froxel_ref.grid import Froxels, froxel_points, make_froxels
from froxel_ref.lights import light_at
from froxel_ref.scene import PointLight, Scene

MEDIA = ("media/scattering", "media/extinction", "media/emission", "media/phase_anisotropy",
         "media/lobe_scattering", "media/lobe_anisotropy")


class Case:
    """The hall with some lights more, and everything that its stages are given."""

    def __init__(self, extra: int, precision: str, *, alone: bool = False) -> None:
        overrides = [f"extra_lights.count={extra}", f"settings.precision={precision}"]
        self.scene, self.settings, folder = scene_files.load("thesis-hall", overrides=overrides)
        if alone:
            self.scene = dataclasses.replace(self.scene, lights=())
        assets, grid, camera = load_assets(self.scene, folder), self.settings.grid, self.scene.camera
        self.lights = {i: light for i, light in enumerate(self.scene.all_lights) if isinstance(light, PointLight)}
        self.froxels: Froxels = make_froxels(camera, grid, dtype=precision)
        self.tiling: Tiling = culling.make_tiling(camera, depth_range=(grid.near, grid.far))
        self.vbuffer = fog_stages.v_buffer(run_frame(self.scene, self.settings, assets=assets, outputs=MEDIA).results)
        self.rays = camera_rays(camera, camera.width, camera.height, dtype=precision)
        self.hits = surface.find_surfaces(self.scene.surfaces, self.rays, assets)
        self.culled = self.cull()

    def cull(self) -> culling.Culled:
        return culling.cull_lights(self.lights, self.tiling, origin=self.scene.camera.position,
                                   dtype=self.froxels.depths.dtype)

    def light(self) -> None:
        visit = culling.candidates(self.culled, self.froxels, self.tiling)
        lighting.in_scattering(self.vbuffer, self.scene.all_lights, self.froxels, ambient=self.scene.ambient,
                               candidates=visit)

    def shade(self) -> None:
        shading.shade(self.hits, self.rays, self.scene)

    def pairs(self) -> dict[str, int]:
        """Pairs of a froxel, or a pixel, and a light."""
        points = froxel_points(self.froxels)
        volume = int(np.prod([len(self.froxels.depths), *self.froxels.rays.length.shape]))
        touched = sum(int((light_at(light, points)[1] > 0.0).sum()) for light in self.lights.values())
        listed = int(culling.list_lengths(self.culled, self.froxels, self.tiling).sum())
        froxels = counted(lamp_batches, "_lay_out", lambda arguments: arguments[3], self.light)
        pixels = counted(shading, "light_at", lambda arguments: max(p.size for p in arguments[1]), self.shade)
        return {"all": volume * len(self.lights), "touched": touched, "listed": listed, "visited": froxels,
                "pixels": pixels}


def counted(module: object, name: str, size: Callable[[tuple], int], run: Callable[[], None]) -> int:
    """How much a function of a module is given in all, while something runs."""
    sizes: list[int] = []
    real = getattr(module, name)

    def listening(*arguments: object, **options: object) -> object:
        sizes.append(size(arguments))
        return real(*arguments, **options)

    setattr(module, name, listening)
    run()
    setattr(module, name, real)
    return sum(sizes)


def slope(visited: list[int], seconds: list[float]) -> float:
    """Of log time over log visited pairs, by least squares."""
    return float(np.polyfit(np.log(visited), np.log(seconds), 1)[0])


def show(precision: str, counts: list[int], repeats: int) -> None:
    cases = {extra: Case(extra, precision) for extra in counts}
    runs = {(name, extra): getattr(case, name) for name in ("cull", "light", "shade") for extra, case in cases.items()}
    names = {f"{name} {extra}": run for (name, extra), run in runs.items()}
    names["light alone"] = Case(max(counts), precision, alone=True).light
    times: dict[str, Timing] = interleaved(names, repeats=repeats)
    pairs = {extra: case.pairs() for extra, case in cases.items()}
    scene: Scene = cases[counts[0]].scene
    print(f"\nthesis-hall, {precision}, 160x90x64 froxels, {scene.camera.width}x{scene.camera.height} pixels, "
          f"{available_threads()} threads")
    print("\npairs of a froxel and a light, in millions")
    first = pairs[counts[0]]
    rows: list[tuple[object, ...]] = []
    for extra, p in pairs.items():
        rows.append((len(cases[extra].lights), *(f"{p[k] / 1e6:.2f}" for k in ("all", "touched", "visited", "listed")),
                     f"{p['visited'] / p['touched']:.2f}", f"{p['listed'] / p['touched']:.2f}",
                     f"{p['listed'] / (p['all'] / len(cases[extra].lights)):.1f}",
                     f"{p['visited'] / first['visited']:.2f}"))
    print(table(rows, ("lights", "all", "touched", "visited", "listed", "visited/touched", "listed/touched",
                       "mean list", "visited, ratio")))
    for name, about, key in (("cull", "culling", "visited"), ("light", "lighting: in-scattering", "visited"),
                             ("shade", "surface: shading", "pixels")):
        base = times[f"{name} {counts[0]}"].least
        rows = [(len(cases[extra].lights), f"{1e3 * times[f'{name} {extra}'].least:.1f}",
                 f"{1e3 * times[f'{name} {extra}'].median:.1f}", f"{times[f'{name} {extra}'].least / base:.2f}",
                 f"{pairs[extra][key] / 1e6:.2f}", f"{pairs[extra][key] / first[key]:.2f}") for extra in counts]
        what = "pixels" if key == "pixels" else "froxels"
        print(f"\n{about}, milliseconds")
        print(table(rows, ("lights", "least", "median", "ratio", f"{what} visited, millions", "ratio")))
        if name != "cull":
            fitted = slope([pairs[extra][key] for extra in counts],
                           [times[f"{name} {extra}"].least for extra in counts])
            print(f"slope of log time over log {what} visited: {fitted:.2f}")
    alone = times["light alone"].least
    print(f"\n{max(counts)} lights of 4 m by themselves: {1e3 * alone:.1f} ms in-scattering, "
          f"{alone / times[f'light {counts[0]}'].least:.2f} times the nine of 16 m and the sun")
    print("\n[Dörries 2020, figure 4.2] as a table: lights against time of in-scattering at 160x90x64, milliseconds")
    rows = [(len(cases[extra].lights), f"{1e3 * times[f'light {extra}'].least:.1f}", "with a later version")
            for extra in counts]
    print(table(rows, ("lights", "every froxel", "checkerboard")))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--repeats", type=int, default=7)
    parser.add_argument("--counts", type=int, nargs="+", default=[0, 7, 23, 55, 119, 247, 503, 512],
                        help="lights beside the nine")
    parser.add_argument("--precision", nargs="+", default=["float64", "float32"])
    options = parser.parse_args()
    for precision in options.precision:
        show(precision, options.counts, options.repeats)


if __name__ == "__main__":
    main()
