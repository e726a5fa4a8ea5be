"""What the temporal filter's remedies against ghosts save and cost: noise at rest, length of a lamp's trail.

    python benchmarks/ghosting.py [--width N] [--height N] [--depth N]

The scene `ghosting`: a lantern that moves at 3 m/s through fog of g = 0.7, and the sun through slits of a wall.

noise        standard deviation over the 32 frames of a cycle, the scene at rest and the filter steady, root mean square
             over the image's fog, over its mean
error        of the image's fog at rest against the mean of 256 points of the jitter, root mean square over its mean
trail        frames until of the light that a lantern leaves behind less than 5 % of its most is left, in the froxels
             within 0.6 m of where it passed after 10 frames; what is left behind is the filtered in-scattering less the
             mean of 32 points of the jitter in the scene of the same moment. That times the speed in metres
behind       the most that is left behind there, over the most light that the lantern gives there
moving       error of the fog against the mean of 32 points in the scene of the same moment, over frames 12, 20, … 60
"""

from __future__ import annotations

import argparse
import dataclasses
from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from froxel_ref import scene_files
from froxel_ref.arrays import Field
from froxel_ref.frame import Frame, run_frame
from froxel_ref.grid import froxel_points, make_froxels
from froxel_ref.scene import Scene
from froxel_ref.sequence import moment
from froxel_ref.settings import Grid, Settings, Temporal, replace

RATE, CYCLE = 30.0, 32
PASSED, REACH = 10, 0.6
MOMENTS = range(12, 61, 8)
LEFT = 0.05

REMEDIES: Mapping[str, Mapping[str, object]] = {
    "no filter, no jitter": {"filter": "off"},
    "scattering, alpha 0.05 (published)": {"alpha": 0.05},
    "scattering, alpha 0.1": {"alpha": 0.1},
    "scattering, alpha 0.2": {"alpha": 0.2},
    "unphased, alpha 0.05": {"filter": "unphased"},
    "media, alpha 0.05": {"filter": "media"},
    "clamp to the range": {"clamp": "range"},
    "clamp to the deviation": {"clamp": "deviation", "gamma": 1.0},
    "alpha 0.05 to 0.5": {"alpha_most": 0.5},
    "alpha 0.2, clamp to the range": {"alpha": 0.2, "clamp": "range"},
    "alpha 0.2, clamp to the deviation": {"alpha": 0.2, "clamp": "deviation"},
    "alpha 0.2 to 0.5": {"alpha": 0.2, "alpha_most": 0.5},
}


class Row(NamedTuple):
    """What is measured of a remedy."""

    noise: float
    error: float
    frames: float
    metres: float
    behind: float
    moving: float


class Stand(NamedTuple):
    """What all remedies are measured against."""

    scene: Scene
    settings: Settings
    moments: list[Scene]
    near: NDArray[np.bool_]
    truth: list[Field]
    truth_images: Mapping[int, Field]
    rest: Field
    most: float
    speed: float


def light(frame: Frame) -> Field:
    """In-scattering as the fog is made of, one channel."""
    filtered = frame["temporal/in_scattering"]
    return np.asarray((filtered if filtered.size else frame["lighting/in_scattering"])[0])


OUTPUTS = ("temporal/in_scattering", "lighting/in_scattering", "apply/fog_radiance")


def average(scene: Scene, settings: Settings, count: int) -> tuple[Field, Field]:
    """In-scattering and the image's fog as the mean of jitter points, without history: what a filter tends to."""
    how = replace(settings, temporal=Temporal(filter="scattering", alpha=1.0))
    fields, images, maps = [], [], None
    for n in range(count):
        maps = run_frame(scene, how, frame=n, previous=maps, cut=True, outputs=OUTPUTS)
        fields.append(light(maps))
        images.append(maps["apply/fog_radiance"])
    return np.mean(fields, axis=0), np.mean(images, axis=0)


def make_stand(grid: Grid, *, points: int = CYCLE, frames: int = 130, rest: int = 8 * CYCLE,
               pixels: int = 4, overrides: Sequence[str] = ()) -> Stand:
    """The scene at every moment, and the truth of each."""
    loaded = scene_files.load("ghosting", overrides=overrides)
    camera = dataclasses.replace(loaded.scene.camera, width=pixels * grid.width,
                                 height=pixels * grid.height)
    track = dataclasses.replace(loaded.scene.tracks[0], repeat="hold")
    scene = dataclasses.replace(loaded.scene, camera=camera, tracks=(track,))
    settings = replace(loaded.settings, grid=dataclasses.replace(loaded.settings.grid, width=grid.width,
                                                                 height=grid.height, depth=grid.depth))
    moments = [moment(scene, None, n, rate=RATE) for n in range(frames)]
    ways = [np.array(each.lights[1].position) for each in moments]
    x, y, z = froxel_points(make_froxels(camera, settings.grid))
    near = (x - ways[PASSED][0]) ** 2 + (y - ways[PASSED][1]) ** 2 + (z - ways[PASSED][2]) ** 2 < REACH ** 2
    truth, images = [], {}
    for n, now in enumerate(moments):
        if n and now.lights == moments[n - 1].lights:
            truth.append(truth[-1])
            continue
        field, image = average(now, settings, points)
        truth.append(field[near])
        if n in MOMENTS:
            images[n] = image
    here = [float(part.mean()) for part in truth]
    speed = float(np.linalg.norm(ways[1] - ways[0])) * RATE
    return Stand(scene, settings, moments, near, truth, images, average(moments[0], settings, rest)[1],
                 max(here) - min(here), speed)


def measure(stand: Stand, temporal: Temporal, *, warm: int = 96) -> Row:
    """A remedy at rest, then as the lantern moves."""
    settings = replace(stand.settings, temporal=temporal)
    images, before = [], None
    for n in range(warm + CYCLE):
        still = temporal if n >= CYCLE else dataclasses.replace(temporal, start="mean")
        before = run_frame(stand.moments[0], replace(settings, temporal=still), frame=n, previous=before,
                           outputs=OUTPUTS)
        if n >= warm:
            images.append(before["apply/fog_radiance"])
    noise = rms(np.std(images, axis=0)) / float(stand.rest.mean())
    error = rms(np.array(images) - stand.rest) / float(stand.rest.mean())
    behind, errors = [], []
    for n, now in enumerate(stand.moments):
        before = run_frame(now, settings, frame=n, previous=before, outputs=OUTPUTS)
        behind.append(float((light(before)[stand.near] - stand.truth[n]).mean()))
        if n in stand.truth_images:
            errors.append(rms(before["apply/fog_radiance"] - stand.truth_images[n]) / float(stand.rest.mean()))
    peak = int(np.argmax(behind))
    most = behind[peak] / stand.most
    frames = 0 if most < LEFT else int(np.flatnonzero(np.array(behind) >= LEFT * behind[peak])[-1]) + 1 - peak
    return Row(noise, error, frames, frames * stand.speed / RATE, most, rms(np.array(errors)))


def rms(values: Field) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def temporal_of(words: Mapping[str, object]) -> Temporal:
    return Temporal(**({"filter": "scattering"} | words))  # type: ignore[arg-type]


def table(stand: Stand, show: Callable[[str], None]) -> dict[str, Row]:
    """Every remedy's row."""
    show(f"{'':<36}{'noise':>8}{'error':>8}{'trail':>13}{'':>9}{'behind':>8}{'moving':>8}")
    rows = {}
    for name, words in REMEDIES.items():
        rows[name] = row = measure(stand, temporal_of(words))
        trail = (f"{row.frames:.0f} frames", f"{row.metres:.1f} m") if row.frames else ("none", "")
        show(f"{name:<36}{row.noise:>8.4f}{row.error:>8.4f}{trail[0]:>13}{trail[1]:>9}{row.behind:>8.3f}"
             f"{row.moving:>8.4f}")
    return rows


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--width", type=int, default=64)
    parser.add_argument("--height", type=int, default=36)
    parser.add_argument("--depth", type=int, default=40)
    args = parser.parse_args()
    stand = make_stand(Grid(width=args.width, height=args.height, depth=args.depth))
    print(f"{args.width}x{args.height}x{args.depth} froxels, lantern at {stand.speed:.1f} m/s, {RATE:.0f} frames a "
          f"second, {int(stand.near.sum())} froxels where it passed")
    table(stand, lambda line: print(line, flush=True))


if __name__ == "__main__":
    main()
