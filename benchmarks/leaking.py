"""Fog that leaks through a thin wall: on the built-in scene `leak`, for each lookup and bias, against the truth.

    python benchmarks/leaking.py [--frames N]

A froxel that straddles the wall has the light of both sides, and a lookup at the wall finds some of what lies behind.
Leak: the fog's light in front of the room's walls beyond the truth's, mean and 99th percentile of the pixels, in per
cent of what fog adds behind the opening. Lost: what is missing of the fog seen through the opening, in per cent of it.
Once with the froxels of one frame, once as the temporal filter leaves them after so many; noisy lookups are means over
as many frames.
"""

from __future__ import annotations

import argparse
import dataclasses
from collections import deque

import numpy as np

from froxel_ref import scene_files
from froxel_ref.apply import lookup_fog
from froxel_ref.arrays import Field
from froxel_ref.buffers import Integrated
from froxel_ref.frame import Frame, run_frame
from froxel_ref.geometry import camera_rays
from froxel_ref.scene import Scene
from froxel_ref.sequence import run_sequence
from froxel_ref.settings import FogLookup, Grid, Settings, Temporal, replace
from froxel_ref.truth_image import render_truth

VOLUMES = tuple(f"integrate/{name}" for name in Integrated._fields)
BIASES = (0.0, 0.5, 1.0, 1.5, 2.0)


def integrated(frame: Frame) -> Integrated:
    return Integrated(*(frame[name] for name in VOLUMES))


def filtered(scene: Scene, settings: Settings, count: int) -> Integrated:
    """What the temporal filter leaves of the froxels."""
    how = replace(settings, temporal=Temporal(filter="scattering"))
    return integrated(deque(run_sequence(scene, frames=count, settings=how, outputs=VOLUMES), maxlen=1).pop())


def looked_up(volumes: Integrated, grid: Grid, depth: Field, lookup: str, how: FogLookup, count: int) -> Field:
    """The fog's light in front of every pixel; of noisy lookups the mean over frames."""
    frames = range(count if how.method == "noisy" else 1)
    return np.mean([lookup_fog(volumes, grid, depth, lookup=lookup, options=how, frame=n)[0] for n in frames], axis=0)


def heights(scene: Scene, depth: Field) -> tuple[Field, Field]:
    """y and z of what the pixels show [m]."""
    rays = camera_rays(scene.camera, scene.camera.width, scene.camera.height)
    y, z = (start + step * depth for start, step in zip(rays.origin[1:], rays.per_depth[1:], strict=True))
    return y, z


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--frames", type=int, default=64)
    args = parser.parse_args()
    scene, settings, _ = scene_files.load("leak")
    scene = dataclasses.replace(scene, camera=dataclasses.replace(scene.camera, width=320, height=180))
    truth = render_truth(scene, settings, rtol=1e-4).fog_radiance
    frame = run_frame(scene, settings, outputs=[*VOLUMES, "surface/depth"])
    depth = frame["surface/depth"]
    y, z = heights(scene, np.minimum(depth, 1e3))
    walls, opening = (z > -3.1) & (y > 0.02), z < -3.2
    behind = float(truth[:, opening].mean() - truth[:, walls].mean())
    print(f"leak, 320x180, {settings.grid.depth} slices: {walls.mean():.0%} of the pixels show walls, "
          f"{opening.mean():.0%} the opening")
    print(f"{'':<31}{'one frame':>20}{'':>8}{'filtered':>20}")
    print(f"{'lookup':<10}{'method':<13}{'bias':>5}" + 2 * f"   {'leak':>7}{'99th':>8}{'lost':>8}")
    still, settled = integrated(frame), filtered(scene, settings, args.frames)
    for lookup in ("boundary", "centre"):
        for method in ("trilinear", "biquadratic", "noisy"):
            for bias in BIASES:
                cells = ""
                for volumes in (still, settled):
                    fog = looked_up(volumes, settings.grid, depth, lookup, FogLookup(method=method, bias=bias),
                                    args.frames)
                    excess = (fog - truth).mean(axis=0)
                    leak, lost = excess[walls] / behind, -excess[opening].mean() / truth[:, opening].mean()
                    cells += (f"   {100.0 * leak.mean():>7.2f}{100.0 * np.quantile(leak, 0.99):>8.1f}"
                              f"{100.0 * lost:>8.2f}")
                print(f"{lookup:<10}{method:<13}{bias:>5.1f}{cells}")


if __name__ == "__main__":
    main()
