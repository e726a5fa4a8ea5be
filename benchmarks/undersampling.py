"""One sample a froxel, and how many frames of jittered ones make up for it: the scene `shaft`, measured and predicted.

    python benchmarks/undersampling.py [--width N] [--height N] [--depth N] [--sequences N] [--strata N]

Root mean square errors of in-scattering against its mean over each froxel (n·n·n random points in as many equal parts
of it), over the root mean square of that. An exponential moving average of weight α weighs the past like n = (2 − α)/α
samples, Σ α²(1 − α)²ᵏ = 1/n: errors of independent random points fall by √n exactly, whatever the field. Their measured
factor comes with its standard error from the scatter of independent sequences: of S sequences with mean squares m_s(α)
the factor squared is R = Σ m_s(1)/Σ m_s(α), and its relative variance, to first order, that of the mean of
m_s(1)/m̄(1) − m_s(α)/m̄(α). Halton points fill the froxel more evenly than chance and should do better; a cycle of 32
points can do no better than its own mean.
"""

from __future__ import annotations

import argparse
import dataclasses
import math
from collections.abc import Callable, Iterable, Sequence
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from froxel_ref import scene_files
from froxel_ref.arrays import Field
from froxel_ref.assets import load_assets
from froxel_ref.grid import froxel_points, make_froxels
from froxel_ref.jitter import froxel_jitter
from froxel_ref.lighting import in_scattering
from froxel_ref.media import voxelise
from froxel_ref.shadow_stage import map_sights, shadow_maps
from froxel_ref.temporal import blend

Doubles: TypeAlias = NDArray[np.float64]
Point: TypeAlias = tuple[float, float, float]
Sampler: TypeAlias = Callable[[Point], Field]

ALPHAS = (1.0, 0.5, 0.2, 0.1, 0.05)
CYCLE = 32
MIDDLE = (0.5, 0.5, 0.5)


class Factor(NamedTuple):
    """By how much an average lessens the error, and the standard error of that."""

    value: float
    error: float


def effective_samples(alpha: float) -> float:
    """n of an exponential moving average."""
    return (2.0 - alpha) / alpha


def shaft_sampler(width: int, height: int, depth: int) -> Sampler:
    """In-scattering in the room of the scene `shaft`, one channel, at one point of every froxel; shadows by maps.

    The lamp stands outside, where one sample's square has no mean to speak of: a froxel that holds it is left out.
    """
    loaded = scene_files.load("shaft")
    scene, assets = loaded.scene, load_assets(loaded.scene, loaded.folder)
    settings = dataclasses.replace(loaded.settings, grid=dataclasses.replace(
        loaded.settings.grid, width=width, height=height, depth=depth))
    x, y, z = np.broadcast_arrays(*froxel_points(make_froxels(scene.camera, settings.grid)))
    room = (abs(x) < 3.0) & (abs(y - 1.5) < 1.5) & (abs(z + 3.5) < 4.5)
    sights = map_sights(shadow_maps(scene, settings, assets), scene, settings, assets)

    def sample(point: Point) -> Field:
        froxels = make_froxels(scene.camera, settings.grid, jitter=point)
        buffer = voxelise(scene, froxels, assets.textures, settings)
        light = in_scattering(buffer, scene.lights, froxels, ambient=scene.ambient, visibility=sights)
        return light[0][room].reshape(1, 1, -1)

    return sample


def strata(n: int, seed: int) -> Doubles:
    """A random point in each of n·n·n equal parts of the unit cube."""
    corners = np.stack(np.meshgrid(*[np.arange(n)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    return np.asarray((corners + np.random.default_rng(seed).random(corners.shape)) / n)


def mean_over(sample: Sampler, points: Iterable[Sequence[float]]) -> Field:
    """The mean over points, one at a time."""
    total, count = None, 0
    for point in points:
        field = sample((float(point[0]), float(point[1]), float(point[2])))
        total, count = field if total is None else total + field, count + 1
    assert total is not None
    return np.asarray(total / count)


def mean_squares(sample: Sampler, truth: Field, points: Iterable[Sequence[float]], *,
                 alphas: Sequence[float] = ALPHAS, warm: int = 3 * CYCLE) -> Doubles:
    """Of each weight the mean square error of the filtered field over all frames after the first ones."""
    fields: list[Field | None] = [None] * len(alphas)
    totals, count = np.zeros(len(alphas)), 0
    for n, point in enumerate(points):
        now = sample((float(point[0]), float(point[1]), float(point[2])))
        for k, alpha in enumerate(alphas):
            before = fields[k]
            # The mean of all so far, until α weighs more: the beginning is soon forgotten.
            weight = max(alpha, 1.0 / (n + 1))
            fields[k] = after = now if before is None else blend(now, before, True, alpha=weight)
            if n >= warm:
                totals[k] += float(np.mean((after - truth) ** 2))
        count += n >= warm
    return totals / count


def halton_errors(sample: Sampler, truth: Field, *, alphas: Sequence[float] = ALPHAS) -> Doubles:
    """Root mean squares over a cycle of the centred Halton points."""
    points = [froxel_jitter(n) for n in range(4 * CYCLE)]
    return np.sqrt(mean_squares(sample, truth, points, alphas=alphas))


def random_squares(sample: Sampler, truth: Field, *, sequences: int, frames: int, seed: int,
                   alphas: Sequence[float] = ALPHAS, warm: int = 3 * CYCLE) -> Doubles:
    """Mean squares of independent sequences of independent random points, shape (sequences, alphas)."""
    rng = np.random.default_rng(seed)
    return np.array([mean_squares(sample, truth, rng.random((warm + frames, 3)), alphas=alphas, warm=warm)
                     for _ in range(sequences)])


def factor(squares: Doubles, column: int) -> Factor:
    """√(Σ m_s(1)/Σ m_s(α)), and its standard error to first order."""
    one, other = squares[:, 0] / squares[:, 0].mean(), squares[:, column] / squares[:, column].mean()
    value = math.sqrt(squares[:, 0].mean() / squares[:, column].mean())
    return Factor(value, 0.5 * value * float(np.std(one - other, ddof=1)) / math.sqrt(len(squares)))


def rms(values: Field) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--width", type=int, default=40)
    parser.add_argument("--height", type=int, default=22)
    parser.add_argument("--depth", type=int, default=24)
    parser.add_argument("--sequences", type=int, default=12)
    parser.add_argument("--frames", type=int, default=120, help="of each sequence, after 96 first ones")
    parser.add_argument("--strata", type=int, default=16, help="parts of a froxel's edge, for its mean")
    args = parser.parse_args()
    sample, parts = shaft_sampler(args.width, args.height, args.depth), args.strata
    truth = mean_over(sample, strata(parts, 1))
    whole = rms(truth)
    print(f"shaft, {args.width}x{args.height}x{args.depth} froxels, mean over {parts ** 3} points of each; errors over "
          f"{whole:.4g}")
    print(f"one sample at the middle: {rms(sample(MIDDLE) - truth) / whole:.4f}")
    finer = mean_over(sample, [(0.5, 0.5, (k + 0.5) / parts) for k in range(parts)])
    print(f"one sample in each of {parts} slices of a froxel, at their middles: {rms(finer - truth) / whole:.4f}")
    halton = halton_errors(sample, truth)
    squares = random_squares(sample, truth, sequences=args.sequences, frames=args.frames, seed=2)
    print(f"{'alpha':>6}{'n':>6}{'sqrt n':>9}{'random':>10}{'factor':>9}{'+-':>7}{'off by':>9}{'Halton':>10}"
          f"{'factor':>9}")
    for k, alpha in enumerate(ALPHAS):
        n, found = effective_samples(alpha), factor(squares, k)
        off = f"{(found.value - math.sqrt(n)) / found.error:+.1f} se" if k else ""
        random = math.sqrt(squares[:, k].mean()) / whole
        print(f"{alpha:>6g}{n:>6.0f}{math.sqrt(n):>9.2f}{random:>10.4f}{found.value:>9.2f}{found.error:>7.2f}{off:>9}"
              f"{halton[k] / whole:>10.4f}{halton[0] / halton[k]:>9.2f}")
    cycle = rms(mean_over(sample, [froxel_jitter(n) for n in range(CYCLE)]) - truth)
    print(f"the mean of a whole cycle of {CYCLE} Halton points: {cycle / whole:.4f}, factor {halton[0] / cycle:.2f}; "
          f"of random ones {math.sqrt(squares[:, 0].mean() / CYCLE) / whole:.4f}, factor {math.sqrt(CYCLE):.2f}")


if __name__ == "__main__":
    main()
