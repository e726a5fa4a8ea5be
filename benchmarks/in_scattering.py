"""Nine point lights in fog, 160×90×64 in float32: froxel_ref against the thesis in NumPy and against numba.

Run ``python benchmarks/in_scattering.py`` with the extra ``benchmark``. Runs are interleaved, so that what
else the machine does hits all alike; ratios are of the least times.
"""

from __future__ import annotations

import argparse
import statistics
import time
from collections.abc import Callable

import numba
import numpy as np
import peers
from numpy.typing import NDArray

from froxel_ref.blocks import available_threads
from froxel_ref.grid import Froxels, make_froxels
from froxel_ref.lighting import in_scattering
from froxel_ref.media import VBuffer
from froxel_ref.scene import Camera, PointLight
from froxel_ref.settings import Grid

Array = NDArray[np.float32]
Run = Callable[[], Array]


def nine_lights() -> list[PointLight]:
    """Lights of radius 16 m strewn over a hall, each of its own colour."""
    unit = np.random.default_rng(3).random((9, 6))
    places = unit[:, :3] * (16.0, 5.0, 30.0) + (-8.0, 0.5, -30.0)
    return [PointLight(position=tuple(p), intensity=tuple(c), radius=16.0)
            for p, c in zip(places.tolist(), (50.0 * unit[:, 3:]).tolist(), strict=True)]


def medium(varying: bool, shape: tuple[int, int, int]) -> VBuffer:
    """Fog of g = 0.6, uniform or with scattering and g that vary."""
    noise = np.random.default_rng(5).random(shape, np.float32) if varying else np.ones((1, 1, 1), np.float32)
    scattering = np.array([0.05, 0.04, 0.03], np.float32).reshape(3, 1, 1, 1) * noise
    # Rounded up to 0.61 or more, froxel_ref would take its careful path, which the peers have not.
    g = np.float32(0.6) * noise
    return VBuffer(scattering, scattering[0] * 2, np.zeros((3, 1, 1, 1), np.float32), g, ())


def contestants(froxels: Froxels, fog: VBuffer, threads: int) -> dict[str, Run]:
    """What is measured, by name."""
    lights = nine_lights()
    arguments = froxels, fog.scattering, fog.phase_anisotropy, lights
    runs: dict[str, Run] = {
        "froxel_ref": lambda: in_scattering(fog, lights, froxels, threads=threads),
        "listings in NumPy": lambda: peers.transcription(*arguments),
    }
    for name, make in (("numba, listings", peers.listings_kernel), ("numba, along rays", peers.ray_kernel)):
        for fastmath in (False, True):
            kernel = make(fastmath)
            runs[name + (", fastmath" if fastmath else "")] = lambda kernel=kernel: kernel(*arguments)
    return runs


def measure(runs: dict[str, Run], repeats: int) -> dict[str, list[float]]:
    """Seconds of each run, interleaved; the NumPy transcription is run a third as often."""
    times: dict[str, list[float]] = {name: [] for name in runs}
    for turn in range(repeats):
        for name, run in runs.items():
            if "NumPy" in name and turn % 3:
                continue
            start = time.perf_counter()
            run()
            times[name].append(time.perf_counter() - start)
    return times


def compare(froxels: Froxels, fog: VBuffer, threads: int, repeats: int) -> None:
    """Print one table."""
    numba.set_num_threads(threads)
    runs = contestants(froxels, fog, threads)
    exact = in_scattering(wide(fog), nine_lights(), make_froxels(Camera(), Grid()))
    results = {name: run() for name, run in runs.items()}  # warm, and compared
    times = measure(runs, repeats)
    own = min(times["froxel_ref"])
    print(f"{'':28}{'least':>10}{'median':>10}{'÷ ours':>9}{'error, worst':>14}{'error, rms':>12}")
    lit = exact > 1e-4 * np.median(exact)  # towards a radius the window's relative error has no bound
    for name, seconds in times.items():
        error = np.abs(results[name][lit] / exact[lit] - 1.0)
        print(f"{name:28}{min(seconds) * 1e3:7.1f} ms{statistics.median(seconds) * 1e3:7.1f} ms"
              f"{min(seconds) / own:9.2f}{error.max():14.1e}{np.sqrt(np.mean(error**2)):12.1e}")


def wide(fog: VBuffer) -> VBuffer:
    """The same medium in float64."""
    return VBuffer(*(np.asarray(field, np.float64) for field in fog[:4]), ())


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--repeats", type=int, default=9)
    repeats = parser.parse_args().repeats
    froxels = make_froxels(Camera(), Grid(), dtype=np.float32)
    shape = (froxels.depths.shape[0], *froxels.rays.length.shape)
    for threads in dict.fromkeys((available_threads(), 1)):
        for varying in (False, True):
            print(f"\nnine point lights, {'varying' if varying else 'uniform'} medium, {threads} thread(s)")
            compare(froxels, medium(varying, shape), threads, repeats)


if __name__ == "__main__":
    main()
