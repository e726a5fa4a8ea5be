"""Make the tiles of blue noise that the package ships.

    python scripts/make_blue_noise.py [--seed N] [--size N] [--layers N] [--components N] [--sigma PIXELS] [-o FILE]

The same arguments give the same bytes on every machine, and fewer layers or components the first of more. As shipped,
256 tiles of 64 × 64, it takes some ten seconds.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from froxel_ref.blue_noise import SEED, to_bytes, void_and_cluster
from froxel_ref.cli_progress import progress

SHIPPED = Path(__file__).resolve().parents[1] / "froxel_ref" / "data" / "blue_noise.npy"


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description="Make tiles of blue noise, [component, layer, y, x], one byte each.")
    parser.add_argument("--seed", type=int, default=SEED, help="at least 0 (default: %(default)s)")
    parser.add_argument("--size", type=int, default=64, help="pixels along each edge (default: %(default)s)")
    parser.add_argument("--layers", type=int, default=64, help="one a frame (default: %(default)s)")
    parser.add_argument("--components", type=int, default=4, help="of a layer (default: %(default)s)")
    parser.add_argument("--sigma", type=float, default=1.5, help="of the Gaussian, in pixels (default: %(default)s)")
    parser.add_argument("-o", "--output", type=Path, default=SHIPPED, help="a .npy file (default: the package's)")
    args = parser.parse_args(arguments)
    if min(args.size, args.layers, args.components) < 1:
        parser.error("size, layers and components must be at least 1")
    tiles = np.empty((args.components, args.layers, args.size, args.size), np.uint8)
    with progress("tiles") as tell:
        for done, (component, layer) in enumerate(np.ndindex(tiles.shape[:2])):
            tell(f"component {component}", done, args.components * args.layers)
            ranks = void_and_cluster(args.size, (args.seed, component, layer), sigma=args.sigma)
            tiles[component, layer] = to_bytes(ranks)
    with args.output.open("wb") as file:
        np.save(file, tiles, allow_pickle=False)


if __name__ == "__main__":
    main()
