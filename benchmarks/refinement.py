"""That the frame tends to the truth on every built-in scene, as grid, maps and harmonics are refined together.

    python benchmarks/refinement.py [SCENE …] [--levels F …] [--data DIR]

Level 1 is the scene's own grid, shadow maps, opacity maps, harmonics and steps of the long range; level ½ half as many
along each axis of the grid and each side of a map. All else is as exact as settings make it
(`froxel_ref.report.refined`). Prints √relMSE and the mean absolute error against the converged truth, over the mean of
the truth, with their orders: the slopes of their logarithms. On edges of light both are jumps: order 1 of the mean, ½
of the root, which a few pixels decide on.
"""

from __future__ import annotations

import argparse
import math

from timing import table
from tqdm import tqdm

from froxel_ref import InputError, compare, load
from froxel_ref.error_images import distance, last_image, reference_image
from froxel_ref.report import finer_image, refined
from froxel_ref.report_points import EPSILON, SUITES, Asked, Prepared, prepare
from froxel_ref.scene_files import builtin

LEVELS = (0.25, 0.5, 1.0, 2.0)


def rows(name: str, prepared: Prepared, levels: list[float], rtol: float) -> list[tuple[object, ...]]:
    subject = prepared.subject
    truth = reference_image(subject, rtol=rtol)
    found = [distance(last_image(subject, refined(subject.settings, prepared.parts, factor),
                                 finer=finer_image(prepared, factor)), truth.radiance, epsilon=EPSILON)
             for factor in levels]
    steps = [1.0 / factor for factor in levels]
    missed = f"{(~truth.converged).sum()}"
    series = (("root of relMSE", [math.sqrt(each.relmse) for each in found]),
              ("mean |error|", [each.absolute for each in found]))
    return [(name, label, *[f"{error:.2e}" for error in errors],
             f"{compare.order(steps, errors).order:.2f}" if min(errors) > 0.0 else "exact", missed)
            for label, errors in series]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("scenes", nargs="*", default=list(builtin()), metavar="SCENE")
    parser.add_argument("--levels", nargs="+", type=float, default=list(LEVELS), metavar="F")
    parser.add_argument("--rtol", type=float, default=1e-3)
    parser.add_argument("--data", help="folder of the files that scenes name")
    args = parser.parse_args()
    found, asked = [], Asked(knobs=())
    for name in tqdm(args.scenes, leave=False, disable=None):
        try:
            found += rows(name, prepare(load(name, data=args.data), asked, sweep=False), args.levels, args.rtol)
        except InputError as error:
            print(f"{name}: left out: {error}")
    print(f"about {SUITES['quick'].pixels} pixels; fewer where lights are many\n")
    print(table(found, ("scene", "of", *[f"x{factor:g}" for factor in args.levels], "order", "not converged")))


if __name__ == "__main__":
    main()
