"""Error of each integrator against the optical depth of a slice, from 1e-8 to 1e4.

    python benchmarks/stiffness.py [--slices N] [--precision float32]

64 equal slices of a medium that thins by 7.4 from front to back. Relative errors of the light and of the
transmittance at the last slice; "-" where the transmittance is below all normal numbers. Needs mpmath (the
extra `test`).
"""

from __future__ import annotations

import argparse
import math

from timing import table

from froxel_ref.integrate import INTEGRATORS
from froxel_ref.stiffness import SLICE_DEPTHS, stiffness_table


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--slices", type=int, default=64)
    parser.add_argument("--precision", choices=("float64", "float32"), default="float64")
    args = parser.parse_args()
    found = {(row.integrator, row.slice_depth): row
             for row in stiffness_table(slices=args.slices, dtype=args.precision)}
    for quantity in ("light", "transmittance"):
        rows: list[tuple[object, ...]] = []
        for x in SLICE_DEPTHS:
            errors = [getattr(found[name, x], quantity) for name in INTEGRATORS]
            rows.append((f"{x:.0e}", *("-" if math.isnan(error) else f"{error:.1e}" for error in errors)))
        print(f"\n{quantity}, relative error, {args.precision}, {args.slices} slices")
        print(table(rows, ("x a slice", *INTEGRATORS)))


if __name__ == "__main__":
    main()
