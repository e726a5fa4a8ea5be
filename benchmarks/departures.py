"""What each departure of the sources costs: the final image with one switch thrown, against the corrected one.

    python benchmarks/departures.py [SCENE …]

For each switch and each of its other values: bias (mean difference over mean radiance), root mean square
and largest difference, the last two relative to the mean radiance of the corrected image. A scene that does
not ask the question (no emission, no second g) answers 0. Switches of Fourier opacity maps, and whole fidelities,
are measured with volumetric shadows on.
"""

from __future__ import annotations

import argparse
import dataclasses

import numpy as np
from timing import table

from froxel_ref import scene_files
from froxel_ref.assets import load_assets
from froxel_ref.frame import FINAL, run_frame
from froxel_ref.scene import Scene
from froxel_ref.settings import FIDELITIES, SWITCHES, Settings, replace

# What a scene needs so that a switch can show: a medium that glows, an exposure that is not 1.
GLOW, EXPOSURE = (0.02, 0.01, 0.005), 2.0


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

    # Those of Fourier opacity maps are measured with volumetric shadows on, the others as the scene has them.
    base = {True: replace(settings, volumetric_shadows="maps"), False: settings}
    right = {fom: picture(how) for fom, how in base.items()}
    thrown = [(f"{switch}={value}", {switch: value}) for switch, values in SWITCHES.items()
              for value in dict.fromkeys(values[1:]) if value != values[0]]
    thrown += [(f"fidelity={fidelity}", {"fidelity": fidelity}) for fidelity in FIDELITIES[1:]]
    result = []
    for label, change in thrown:
        fom = label.startswith(("fom_", "fidelity"))
        difference = (picture(replace(base[fom], **change)) - right[fom]) / right[fom].mean()
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
