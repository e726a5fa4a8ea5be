"""What techniques for volumetric shadows get wrong, what they cost and how much memory they take.

    python benchmarks/volumetric_shadows.py [--data FOLDER] [--picture FILE] [--repeats N]

Every technique of `froxel_ref.techniques` keeps the same rays and is asked at 256 depths of each; the truth is the
exact transmittance. `--data` names a folder with `smoke.vol`, of which 400 rays are taken. Times are of 1024 rays with
64 stretches (or 50 points) each, and of 64 lookups on each of them, on one core, in float64.
"""

from __future__ import annotations

import argparse
import itertools
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from timing import Timing, interleaved, table

from froxel_ref.absorbers import Absorbers, as_points
from froxel_ref.sampling import fetch_trilinear
from froxel_ref.techniques import Technique, stored_bytes, technique
from froxel_ref.volumes import read_vol

DATA = Path(__file__).resolve().parents[2] / "shared" / "data"  # beside the repository, as for the tests
DEPTHS = (np.arange(256) + 0.5) / 256.0
KINDS = {"FOM": "FOM: Fourier opacity (harmonics)", "resolved": "the same, resolved (harmonics)",
         "ETM": "ETM: cosines (coefficients)",
         "OSM": "OSM: opacity slices (slices)", "power": "power moments (moments)",
         "trig": "trigonometric moments (complex moments)"}


class Contender(NamedTuple):
    kind: str
    options: Mapping[str, Any] = {}


CONTENDERS = [
    Contender("deep"),
    *[Contender("fourier", {"harmonics": k}) for k in (1, 3, 5, 7)],
    *[Contender("fourier", {"harmonics": k, "storage": "float16"}) for k in (1, 3, 5, 7)],
    Contender("fourier", {"lanczos": True}),
    *[Contender("resolved", {"harmonics": k, "storage": s}) for k in (1, 3, 5, 7) for s in (None, "float16")],
    *[Contender("cosine", {"count": c}) for c in (4, 8, 16)],
    *[Contender("cosine", {"count": c, "storage": "float16"}) for c in (4, 8, 16)],
    *[Contender("slices", {"slices": s}) for s in (8, 16, 32, 64)],
    *[Contender("slices", {"slices": s, "storage": "float16"}) for s in (8, 16, 32, 64)],
    *[Contender("slices", {"sampling": s}) for s in ("nearest", "linear")],
    *[Contender("power", {"count": c, "storage": s}) for s in ("float32", "unorm16", "float16") for c in (4, 6, 8)],
    *[Contender("trigonometric", {"count": c, "storage": s}) for s in ("float32", "unorm16", "float16")
      for c in (2, 3, 4)],
]


# --- what dims the rays -----------------------------------------------------------------------------


def stretches(knots: np.ndarray, extinction: np.ndarray) -> Absorbers:
    """Linear extinction between knots, rays along the second axis."""
    length = np.diff(knots)[:, None]
    low, high = extinction[:-1], extinction[1:]
    return Absorbers(np.broadcast_to(knots[:-1, None], low.shape), np.broadcast_to(knots[1:, None], low.shape),
                     0.5 * length * (low + high), length * (high - low))


def smooth(density: np.ndarray, whole: float) -> Absorbers:
    """A curve given at 257 knots, as stretches whose optical depth is a given one."""
    rays = stretches(np.linspace(0, 1, 257), density[:, None])
    factor = whole / rays.tau.sum()
    return rays._replace(tau=rays.tau * factor, rise=rays.rise * factor)


def smoke_rays(folder: Path, count: int = 400, parts: int = 64) -> Absorbers | None:
    """Straight ways through the smoke's box from face to face, near its middle; a mean optical depth of 2."""
    path = folder / "smoke.vol"
    if not path.is_file():
        print(f"no {path}: rays through smoke are left out\n")
        return None
    grid = read_vol(path)[0].astype(np.float64)
    rng = np.random.default_rng(1)
    knots = np.linspace(0, 1, parts + 1)
    ends = [rng.uniform(0.2, 0.8, (2, count)) * n for n in grid.shape[1:]]
    y, x = (a + (b - a) * knots[:, None] for a, b in ends)
    rays = stretches(knots, np.maximum(fetch_trilinear(grid, x, y, knots[:, None] * grid.shape[0]), 0.0))
    factor = 2.0 / rays.tau.sum(axis=0).mean()
    return rays._replace(tau=rays.tau * factor, rise=rays.rise * factor)


def particles(count: int = 400, each: int = 50) -> Absorbers:
    """Points of an opacity below 0.15."""
    rng = np.random.default_rng(2)
    return as_points(rng.random((each, count)), -np.log1p(-rng.uniform(0, 0.15, (each, count))))


def media(folder: Path) -> dict[str, Absorbers]:
    """By name; the first word tells the family."""
    one = np.ones((1, 1))
    x = np.linspace(0, 1, 257)
    bump = np.where(np.abs(x - 0.5) < 0.3, 1 + np.cos(np.pi * (x - 0.5) / 0.3), 0.0)
    result = {f"layer {tau:g}": as_points(0.5 * one, tau * one) for tau in (0.1, 1.0, 4.0, 20.0)}
    result |= {f"slab {tau:g}": Absorbers(0.3 * one, 0.7 * one, tau * one, 0 * one) for tau in (0.5, 1.0, 4.0, 20.0)}
    result |= {"exp": smooth(np.exp(-4 * x), 2.0), "bump": smooth(bump, 2.0)}
    smoke = smoke_rays(folder)
    if smoke is not None:
        result["smoke"] = smoke
    result["particles"] = particles()
    return result


# --- what is measured -------------------------------------------------------------------------------


class Row(NamedTuple):
    way: Technique
    mean: dict[str, float]
    largest: dict[str, float]
    overshoot: dict[str, float]
    bytes: int
    encode: Timing
    encode_points: Timing
    decode: Timing


def errors(way: Technique, rays: Absorbers, exact: np.ndarray) -> tuple[float, float, float | None]:
    encoded = way.encode(rays)
    off = np.abs(way.decode(encoded, DEPTHS[:, None]) - exact)
    over = None if way.uncut is None else max(0.0, float(way.uncut(encoded, DEPTHS[:, None]).max()) - 1.0)
    return float(off.mean()), float(off.max()), over


def microseconds(ways: Sequence[Technique], repeats: int) -> list[list[Timing]]:
    """Of 1000 encodes of stretches, of points and 1000 decodes."""
    rng = np.random.default_rng(3)
    rays, points = stretches(np.linspace(0, 1, 65), rng.random((65, 1024))), particles(1024)
    depths = rng.random((64, 1024))
    encoded = [way.encode(rays) for way in ways]
    runs: dict[str, Any] = {}
    for i, way in enumerate(ways):
        runs[f"{i} encode"] = lambda way=way: way.encode(rays)
        runs[f"{i} points"] = lambda way=way: way.encode(points)
        runs[f"{i} decode"] = lambda way=way, i=i: way.decode(encoded[i], depths)
    timings = interleaved(runs, repeats=repeats)
    counts = {"encode": 1024, "points": 1024, "decode": depths.size}
    return [[Timing(*(1e9 * seconds / count for seconds in timings[f"{i} {what}"])) for what, count in counts.items()]
            for i in range(len(ways))]


def measure(folder: Path, repeats: int) -> list[Row]:
    rays = media(folder)
    truth = technique("deep")
    exact = {name: truth.decode(truth.encode(each), DEPTHS[:, None]) for name, each in rays.items()}
    ways = [technique(kind, **options) for kind, options in CONTENDERS]
    sample = rays.get("smoke", rays["particles"])
    rows = []
    for way, times in zip(ways, microseconds(ways, repeats), strict=True):
        found = {name: errors(way, each, exact[name]) for name, each in rays.items()}
        over = {name: f[2] for name, f in found.items() if f[2] is not None}
        rows.append(Row(way, {n: f[0] for n, f in found.items()}, {n: f[1] for n, f in found.items()},
                        over, stored_bytes(way, way.encode(sample)), *times))
    return rows


def overall(errors: Mapping[str, float]) -> float:
    """The mean over the families of media, each the mean of its members."""
    families: dict[str, list[float]] = {}
    for name, value in errors.items():
        families.setdefault(name.split()[0], []).append(value)
    return float(np.mean([np.mean(values) for values in families.values()]))


# --- what is shown ----------------------------------------------------------------------------------


def tables(rows: Sequence[Row]) -> None:
    names = list(rows[0].mean)
    for title, which in (("mean absolute error of transmittance over depth", "mean"), ("largest error", "largest")):
        lines = [(row.way.name, *[f"{getattr(row, which)[n]:.4f}" for n in names],
                  f"{overall(getattr(row, which)):.4f}") for row in rows]
        print(f"{title}\n\n" + table(lines, ("technique", *names, "overall")) + "\n")
    lines = [(row.way.name, *[f"{row.overshoot[n]:.4f}" for n in names]) for row in rows if row.overshoot]
    print("largest overshoot of transmittance, beyond 1, before the clamp\n")
    print(table(lines, ("technique", *names)) + "\n")
    costs = [(row.way.name, row.way.numbers or "varies", row.bytes,
              *[f"{t.least:.0f} ({t.median:.0f})" for t in (row.encode, row.encode_points, row.decode)],
              f"{overall(row.mean):.4f}") for row in rows]
    print("costs: bytes a ray (of the exact one, with 64 stretches); microseconds per 1000 rays and per 1000 lookups,\n"
          "least (median) of several, warm\n")
    print(table(costs, ("technique", "numbers", "bytes", "encode 64 stretches", "encode 50 points", "decode",
                        "overall error")) + "\n")


def known_failure() -> None:
    layer = as_points(np.full((1, 1), 0.5), np.full((1, 1), 4.0))
    way = technique("fourier")
    assert way.uncut is not None
    top = float(way.uncut(way.encode(layer), np.linspace(0, 1, 20001)[:, None]).max())
    print(f"known failure: K = 3, thin layer at 1/2, optical depth 4: transmittance overshoots to {top:.3f} before the "
          "clamp\n")


# Colour, marker, and where a point's label stands from it, so that those of neighbours keep apart.
STYLES = {"FOM": ("tab:blue", "o", (-5, -16)), "resolved": ("tab:purple", "P", (-13, -12)),
          "ETM": ("tab:cyan", "s", (7, 3)), "OSM": ("tab:green", "^", (-15, -13)),
          "power": ("tab:red", "D", (-13, -11)), "trig": ("tab:orange", "v", (6, 4))}
CURVES = [Contender("deep"), Contender("fourier"), Contender("resolved"), Contender("cosine"), Contender("slices"),
          Contender("power", {"count": 6, "storage": "float32"}),
          Contender("trigonometric", {"count": 3, "storage": "float32"})]


def picture(rows: Sequence[Row], path: Path) -> None:
    import matplotlib
    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, ((by_time, by_size), (layer, slab)) = plt.subplots(2, 2, figsize=(13, 10.5), layout="constrained")
    for axes, cost, label in ((by_time, "decode", "time of a lookup [ns], NumPy on one core"),
                              (by_size, "bytes", "memory [bytes a ray]")):
        scatter(axes, rows, cost)
        axes.set(xscale="log", yscale="log", ylim=(0.00028, 0.1), xlabel=label)
        axes.set_ylabel("mean absolute error of transmittance")
        axes.grid(alpha=0.3, which="both")
    by_time.set_title("Error against time (stored in 32 bits)")
    by_size.set_title("Error against memory (stored in 16 bits: moments as unorm16)")
    by_size.set_xticks([8, 16, 32, 64, 128], ["8", "16", "32", "64", "128"])
    by_time.set_xticks([5, 10, 20, 50, 100, 200, 500], ["5", "10", "20", "50", "100", "200", "500"])
    for axes in (by_time, by_size):
        axes.minorticks_off()
        axes.set_yticks([0.0005, 0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1],
                        ["0.0005", "0.001", "0.002", "0.005", "0.01", "0.02", "0.05", "0.1"])
    by_time.set_xlim(3.0, 800.0)
    by_size.legend(loc="lower left")
    one = np.ones((1, 1))
    curves(layer, as_points(0.5 * one, 4 * one), "Thin layer at 1/2, τ = 4 (ETM 8 = FOM 3, resolved = exact)")
    curves(slab, Absorbers(0.3 * one, 0.7 * one, 4 * one, 0 * one),
           "Slab from 0.3 to 0.7, τ = 4 (ETM 8 = FOM 3, resolved = exact)")
    layer.legend(loc="lower left")
    figure.savefig(path, dpi=130)
    plt.close(figure)


def scatter(axes: Any, rows: Sequence[Row], cost: str) -> None:
    """One line a family; each point is named by its harmonics, coefficients, slices or moments."""
    groups: dict[str, list[Row]] = {}
    for row in rows:
        family, *rest = row.way.name.split()
        compact = "unorm16" if family in ("power", "trig") else "float16"
        if family in STYLES and rest[1:] in ([[compact]] if cost == "bytes" else [[], ["float32"]]):
            groups.setdefault(family, []).append(row)
    for family, members in groups.items():
        colour, marker, offset = STYLES[family]
        x = [row.decode.least if cost == "decode" else row.bytes for row in members]
        y = [overall(row.mean) for row in members]
        axes.plot(x, y, color=colour, marker=marker, markersize=7, linewidth=1.2, label=KINDS[family])
        for row, a, b in zip(members, x, y, strict=True):
            axes.annotate(row.way.name.split()[1], (a, b), xytext=offset, textcoords="offset points", fontsize=9,
                          color=colour)


def curves(axes: Any, rays: Absorbers, title: str) -> None:
    d = np.linspace(0, 1, 1001)
    dashes = itertools.cycle(["-", "-", "--", "--", "-.", "-", "--"])
    for (kind, options), dash in zip(CURVES, dashes, strict=False):
        way = technique(kind, **options)
        family = way.name.split()[0]
        encoded = way.encode(rays)
        values = way.decode(encoded, d[:, None])[:, 0]
        label = "exact" if kind == "deep" else " ".join(way.name.split()[:2])
        axes.plot(d, values, dash, color="black" if kind == "deep" else STYLES[family][0], linewidth=3 if kind == "deep"
                  else 1.6, alpha=0.5 if kind == "deep" else 1.0, label=label)
        if kind == "fourier" and way.uncut is not None:
            axes.plot(d, way.uncut(encoded, d[:, None])[:, 0], ":", color=STYLES[family][0],
                      label=f"{label}, before the clamp")
    axes.set(title=title, xlabel="depth", ylabel="transmittance", xlim=(0, 1))
    axes.grid(alpha=0.3)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--data", type=Path, default=DATA, help="folder of smoke.vol")
    parser.add_argument("--picture", type=Path, help="file to draw into")
    parser.add_argument("--repeats", type=int, default=7)
    args = parser.parse_args()
    known_failure()
    rows = measure(args.data, args.repeats)
    tables(rows)
    if args.picture:
        picture(rows, args.picture)
        print(f"drawn: {args.picture}")


if __name__ == "__main__":
    main()
