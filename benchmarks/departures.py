"""What each departure of the sources costs: the final image with one switch thrown, against the corrected one.

    python benchmarks/departures.py [SCENE …]

For each switch and each of its other values: bias (mean difference over mean radiance), root mean square
and largest difference, the last two relative to the mean radiance of the corrected image. A scene that does
not ask the question (no emission, no second g) answers 0. Switches of Fourier opacity maps, and whole fidelities,
are measured with volumetric shadows on; those of what happens over time and on the screen, on the eighth frame of the
thesis's whole (``--preset thesis``), at half the size.
"""

from __future__ import annotations

import argparse
import dataclasses
from collections import deque

import numpy as np
from timing import table

from froxel_ref import scene_files
from froxel_ref.assets import load_assets
from froxel_ref.frame import FINAL, run_frame
from froxel_ref.presets import preset
from froxel_ref.scene import Scene
from froxel_ref.sequence import run_sequence
from froxel_ref.settings import FIDELITIES, SWITCHES, Settings, replace

# What a scene needs so that a switch can show: a medium that glows, an exposure that is not 1.
GLOW, EXPOSURE = (0.02, 0.01, 0.005), 2.0
OVER_TIME = ("jitter", "checkerboard", "filled_holes", "inverse_tone_map", "half_depth", "long_", "taa_")
FRAMES = 8


def asked(scene: Scene) -> Scene:
    """The scene with its first medium glowing, and a camera exposure."""
    first, *rest = scene.global_media or scene.local_media
    media = (dataclasses.replace(first, emissive=GLOW), *rest)
    which = "global_media" if scene.global_media else "local_media"
    return dataclasses.replace(scene, camera=dataclasses.replace(scene.camera, exposure=EXPOSURE), **{which: media})


def rows(name: str) -> list[tuple[object, ...]]:
    scene, settings, folder = scene_files.load(name)
    scene = asked(scene)
    assets = load_assets(scene, folder)

    def picture(how: Settings) -> np.ndarray:
        frame = run_frame(scene, how, assets=assets, outputs=[FINAL])
        return frame[FINAL] * frame.display_exposure

    camera = dataclasses.replace(scene.camera, width=scene.camera.width // 2, height=scene.camera.height // 2)
    small = dataclasses.replace(scene, camera=camera)

    def last(how: Settings) -> np.ndarray:
        frames = run_sequence(small, frames=FRAMES, settings=how, assets=assets, outputs=["taa/radiance"])
        frame = deque(frames, maxlen=1).pop()
        return frame.image * frame.display_exposure

    # Those of Fourier opacity maps are measured with volumetric shadows on, the others as the scene has them.
    ways = {"plain": (settings, picture), "fom": (replace(settings, volumetric_shadows="maps"), picture),
            "time": (scene_files.load(name, overrides=preset("thesis")).settings, last)}
    right = {way: make(how) for way, (how, make) in ways.items()}
    thrown = [(f"{switch}={value}", {switch: value}) for switch, values in SWITCHES.items()
              for value in dict.fromkeys(values[1:]) if value != values[0]]
    thrown += [(f"fidelity={fidelity}", {"fidelity": fidelity}) for fidelity in FIDELITIES[1:]]
    result = []
    for label, change in thrown:
        way = "time" if label.startswith(OVER_TIME) else "fom" if label.startswith(("fom_", "fidelity")) else "plain"
        how, make = ways[way]
        difference = (make(replace(how, **change)) - right[way]) / right[way].mean()
        result.append((label, f"{difference.mean():+.2e}", f"{np.sqrt((difference**2).mean()):.2e}",
                       f"{np.abs(difference).max():.2e}"))
    return result


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("scenes", nargs="*", metavar="SCENE",
                        default=["thesis-hall", "two-volumes", "particles-in-fog"])
    for name in parser.parse_args().scenes:
        print(f"{name}\n{table(rows(name), ('switch', 'bias', 'rms', 'largest'))}\n")


if __name__ == "__main__":
    main()
