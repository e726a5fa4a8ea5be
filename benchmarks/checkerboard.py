"""What a checkerboard adds to the error of fog that is filtered over time: the hall at rest and in motion.

    python benchmarks/checkerboard.py [--frames N ...] [--alpha A]

Sequences of the built-in scene `thesis-hall` at 30 frames a second, with a checkerboard and without: at rest; the
camera walks 2 m/s and turns by 12° a second; a lamp flies 4 m/s. Differences of in-scattering over all froxels, and of
the image over all pixels: root mean square over the mean, per cent. Without jitter they are what stands in the holes
alone; with it, the two see its points at other frames. As published the first frame is whole in the average, and so is
what its holes were filled with; `temporal.start=mean` forgets that with the second.
"""

from __future__ import annotations

import argparse
import dataclasses
import math
from collections.abc import Iterator, Sequence
from itertools import product

import numpy as np
from timing import table

from froxel_ref import scene_files
from froxel_ref.assets import load_assets
from froxel_ref.frame import FINAL, Frame, run_frame
from froxel_ref.scene import Key, Scene, Track
from froxel_ref.sequence import moment
from froxel_ref.settings import Settings, Temporal, replace

LIGHT = "temporal/in_scattering"
SECOND = 1.0


def track(path: str, begin: float, end: float) -> Track:
    return Track(path=path, keys=(Key(time=0.0, value=begin), Key(time=SECOND, value=end)))


def variants() -> Iterator[tuple[str, Scene, Settings]]:
    """The hall, whose mist stands still, with what moves in it."""
    scene, settings, _ = scene_files.load("thesis-hall", overrides=[
        "camera.width=480", "camera.height=270", "local_media[0].density.scroll=[0,0,0]"])
    z, lamp = scene.camera.position[2], scene.lights[7].position[0]
    turn = (scene.camera.position[2] - scene.camera.target[2]) * math.tan(math.radians(12.0))
    walk = track("camera.position[2]", z, z - 2.0), track("camera.target[0]", 0.0, turn)
    flight = track("lights[7].position[0]", lamp, lamp + 4.0)
    for name, tracks in (("at rest", ()), ("camera", walk), ("lamp", (flight,))):
        yield name, dataclasses.replace(scene, tracks=tracks), settings


def kept(scene: Scene, settings: Settings, counts: Sequence[int]) -> list[Frame]:
    """The frames after so many; the others without an image."""
    assets, last, found = load_assets(scene, None), None, []
    for number in range(max(counts)):
        wanted = [LIGHT, FINAL] if number + 1 in counts else [LIGHT]
        last = run_frame(moment(scene, None, number), settings, assets=assets, frame=number, previous=last,
                         outputs=wanted)
        if number + 1 in counts:
            found.append(last)
    return found


def off(one: np.ndarray, other: np.ndarray) -> str:
    return f"{100.0 * float(np.sqrt(np.mean((one - other) ** 2)) / other.mean()):.2f}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--frames", type=int, nargs="+", default=[1, 2, 8, 16])
    parser.add_argument("--alpha", type=float, default=0.05)
    args = parser.parse_args()
    counts, lines = sorted(set(args.frames)), []
    for name, scene, settings in variants():
        for start, jitter in product(("first", "mean"), ("off", "centred")):
            how = replace(settings, jitter=jitter, temporal=Temporal(
                filter="scattering", alpha=args.alpha, start=start))
            whole, half = (kept(scene, replace(how, checkerboard=on), counts) for on in (False, True))
            cells = [off(a[result], b[result]) for result in (LIGHT, FINAL) for a, b in zip(half, whole, strict=True)]
            lines.append((f"{name}, start {start}, jitter {jitter}", *cells))
    grid = settings.grid
    print(f"thesis-hall, {grid.width}x{grid.height}x{grid.depth} froxels, 480x270 pixels, alpha {args.alpha:g}; "
          "per cent, after frames")
    print(table(lines, ("", *(f"{what} {count}" for what in ("froxels", "image") for count in counts))))


if __name__ == "__main__":
    main()
