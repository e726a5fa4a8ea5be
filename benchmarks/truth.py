"""What the converged truth costs, and how the cost grows with the breaks on a ray.

    python benchmarks/truth.py [--size WxH] [--rtol R] [--full]

First the hall at 160×90: without textures, with exact shadows, with volumetric shadows, with its drifting
mist. Without --full the slow ones trace every 8th ray and say what all would take. Then rays with more and
more breaks: boxes of fog in a row, lamps, pillars in the light, and boxes and balls of fog beside the ray that
cast volumetric shadows on it.
"""

from __future__ import annotations

import argparse
import dataclasses
import time
from collections.abc import Iterator

import numpy as np
from timing import table

from froxel_ref import load, load_assets
from froxel_ref.blocks import available_threads
from froxel_ref.geometry import camera_rays
from froxel_ref.scene import (
    Box,
    DirectionalLight,
    LocalMedium,
    Medium,
    PointLight,
    Scene,
    Transform,
)
from froxel_ref.surface import find_surfaces
from froxel_ref.truth import trace
from froxel_ref.truth_image import image_lines

HEAD = ("thesis-hall", "rays", "seconds", "CPU s", "all rays, s", "converged", "largest estimate",
        "evaluations a ray")


def hall(width: int, height: int, rtol: float, every: int) -> Iterator[tuple[object, ...]]:
    scene, settings, folder = load("thesis-hall", overrides=[f"scene.camera.width={width}",
                                                             f"scene.camera.height={height}"])
    assets = load_assets(scene, folder)
    rays = camera_rays(scene.camera, width, height)
    lines = image_lines(rays, find_surfaces(scene.surfaces, rays, assets).depth, settings.grid.far)
    plain = dataclasses.replace(scene, local_media=tuple(
        dataclasses.replace(medium, density=None) for medium in scene.local_media))
    runs = [("without textures", plain, 1, {}),
            ("  and exact shadows", plain, every, {"shadows": "exact"}),
            ("  and volumetric shadows", plain, every, {"volumetric_shadows": True}),
            ("with its textured mist", scene, every, {}),
            ("  and volumetric shadows", scene, every, {"volumetric_shadows": True}),
            ("  and both shadows", scene, every, {"volumetric_shadows": True, "shadows": "exact"})]
    for name, what, step, options in runs:
        origin, directions, ends = lines[0], lines[1][:, ::step], lines[2][::step]
        clock, cpu = time.perf_counter(), time.process_time()
        truth = trace(what, origin, directions, ends, settings=settings, assets=assets, rtol=rtol, **options)
        clock, cpu = time.perf_counter() - clock, time.process_time() - cpu
        lit = truth.radiance > 0
        worst = (truth.error[lit] / truth.radiance[lit]).max()
        yield (name, ends.size, f"{clock:.2f}", f"{cpu:.2f}", f"{clock * step:.1f}",
               f"{truth.converged.mean():.2%}", f"{worst:.1e}", f"{truth.evaluations.mean():.0f}")


def growing(rtol: float) -> Iterator[tuple[object, ...]]:
    """400 rays straight along a row of things, 0 to 32 of them."""
    count = 400
    origin = np.stack([np.linspace(-0.5, 0.5, count), np.zeros(count), np.zeros(count)])
    ray = np.array([[0.0], [0.0], [-1.0]])
    sun = DirectionalLight(direction=(0.3, 1, 0), irradiance=(1, 1, 1))
    fog = Medium(extinction=0.02)
    for n in (0, 1, 2, 4, 8, 16, 32):
        step = 64.0 / max(n, 1)
        boxes = tuple(LocalMedium(extinction=0.1, transform=Transform(
            translate=(0, 0, -step * (k + 0.5)), scale=(1, 1, 0.3 * step))) for k in range(n))
        lamps = tuple(PointLight(position=(1, 0.5, -step * (k + 0.5)), intensity=(1, 1, 1),
                                 falloff="inverse_square") for k in range(n))
        pillars = tuple(Box(transform=Transform(translate=(0, 3, -step * (k + 0.5)),
                                                scale=(2, 1, 0.2 * step))) for k in range(n))
        above = tuple(LocalMedium(extinction=2.0, shape=("box", "ellipsoid")[k % 2], transform=Transform(
            translate=(1, 4, -step * (k + 0.5)), scale=(2, 1, 0.3 * step))) for k in range(n))
        row: list[object] = [n]
        plain = Scene(global_media=(fog,), lights=(sun,))
        for change, options in (({"local_media": boxes}, {}), ({"lights": (sun, *lamps)}, {}),
                                ({"surfaces": pillars}, {"shadows": "exact"}),
                                ({"local_media": above}, {"volumetric_shadows": True})):
            scene = dataclasses.replace(plain, **change)
            cpu = time.process_time()
            truth = trace(scene, origin, np.broadcast_to(ray, (3, count)), np.full(count, 64.0), rtol=rtol,
                          threads=1, **options)
            cpu = time.process_time() - cpu
            row += [f"{truth.evaluations.mean():.0f}", f"{1e6 * cpu / count:.0f}"]
        yield tuple(row)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--size", default="160x90")
    parser.add_argument("--rtol", type=float, default=1e-4)
    parser.add_argument("--full", action="store_true", help="trace all rays of the slow scenes")
    args = parser.parse_args()
    width, height = map(int, args.size.split("x"))
    print(f"{width}x{height} rays, tolerance {args.rtol:g}, {available_threads()} cores\n")
    print(table(list(hall(width, height, args.rtol, 1 if args.full else 8)), HEAD) + "\n")
    print(table(list(growing(args.rtol)), (
        "things on the ray", "boxes of fog: evaluations", "µs a ray", "lamps: evaluations", "µs a ray",
        "pillars: evaluations", "µs a ray", "shadows of media: evaluations", "µs a ray")))


if __name__ == "__main__":
    main()
