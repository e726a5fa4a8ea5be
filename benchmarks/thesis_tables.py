"""The tables of the thesis's results, 4.1 to 4.10, with our times beside them [Dörries 2020, §4.1, §4.2].

Published are milliseconds of two GPUs, ours are those of NumPy on a processor: only ratios can be compared. Each row is
given as a share of its table's total, or of its first row where there is no total.

Where our text of the thesis lacks a cell: "CB Off" of the RX 5700 XT in tables 4.3 and 4.4 is "Merged" of tables 4.1
and 4.2, as it is for the GTX 1050; "Filter" in table 4.5 is that of table 4.3. The totals of table 4.9 are not
the sums of what they say to include, which are 0.313 and 2.529 ms.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import NamedTuple

from timing import Timing, table

LOW, HIGH = (160, 90, 64), (240, 135, 128)
GPUS = ("RX 5700 XT", "GTX 1050")

Pair = tuple[float, float]


class Configuration(NamedTuple):
    """One row of table 3.3, on one grid."""

    size: tuple[int, int, int]
    merged: bool
    checkerboard: bool
    shadows: bool

    @property
    def number(self) -> int:
        """As the thesis counts them."""
        return 1 + self.merged + 2 * self.checkerboard + 4 * self.shadows


class Measured(NamedTuple):
    """Our times of stages by name: in each configuration, of the image at full size, of the opacity maps of suns and of
    lamps alone, and in the long range scene, or why there are none."""

    stages: Mapping[Configuration, Mapping[str, Timing]]
    apply: Mapping[tuple[int, int, int], Timing]
    suns: Timing
    lamps: Timing
    long_range: Mapping[str, Timing] | str


class Row(NamedTuple):
    """What a row is called, what was published, and ours."""

    name: str
    published: Pair
    ours: Timing | None


class Table(NamedTuple):
    """Rows, and the one that counts as 1."""

    title: str
    rows: list[Row]
    base: int
    note: str = ""


# Milliseconds on the RX 5700 XT and the GTX 1050. Tables 4.1 and 4.2: V-Buffer, in-scattering, both, merged.
SEPARATE = {LOW: ((0.0275, 0.300), (0.426, 2.434), (0.453, 2.734), (0.412, 2.582)),
            HIGH: ((0.147, 1.249), (1.199, 8.780), (1.346, 10.029), (1.174, 9.626))}
# Tables 4.3 and 4.4: off, in-scattering on, filter on, both on.
CHECKERBOARD = {LOW: (SEPARATE[LOW][3], (0.275, 1.638), (0.050, 0.228), (0.325, 1.866)),
                HIGH: (SEPARATE[HIGH][3], (0.711, 5.176), (0.224, 0.991), (0.935, 6.167))}
# Tables 4.5 and 4.6: in-scatter, filter, integrate, apply, total.
PASSES = {LOW: ((0.291, 1.638), CHECKERBOARD[LOW][2], (0.059, 0.169), (0.223, 1.003), (0.624, 3.038)),
          HIGH: ((0.752, 5.176), (0.224, 0.991), (0.191, 0.723), (0.224, 1.020), (1.391, 7.910))}
# Table 4.7: in-scatter, filter, integrate, depth downsample, ray marching, apply, total.
LONG_RANGE = ((0.088, 0.530), (0.051, 0.239), (0.057, 0.175), (0.0001, 0.074), (0.316, 4.42), (0.193, 0.828),
              (0.705, 6.266))
# Table 4.8: suns' depth, suns, lamps, in-scattering overhead, ray marching overhead, total.
OPACITY = ((0.022, 0.025), (0.122, 0.047), (0.129, 2.262), (0.016, 0.128), (0.000, 0.000), (0.289, 2.462))
# Table 4.9: in-scattering overhead, total.
OVERHEAD = ((0.040, 0.195), (0.321, 1.637))
# Table 4.10: without and with volumetric shadows, low and high.
COMPLETE = {LOW: ((0.607, 3.038), (0.929, 5.663)), HIGH: ((1.348, 7.857), (1.692, 10.673))}


def published_share(configuration: Configuration) -> Pair | None:
    """Media to filter, as a share of what is separate and whole, where the thesis has it."""
    known = {1: SEPARATE[configuration.size][2], 2: SEPARATE[configuration.size][3],
             4: CHECKERBOARD[configuration.size][3]}
    found = known.get(configuration.number)
    return None if found is None else _over(found, known[1])


def tables(measured: Measured) -> Iterator[str]:
    """All of them as text, in their order."""
    for number, size in enumerate((LOW, HIGH)):
        yield text(separate_or_merged(measured, size, f"4.{1 + number}"))
    for number, size in enumerate((LOW, HIGH)):
        yield text(without_or_with_checkerboard(measured, size, f"4.{3 + number}"))
    for number, size in enumerate((LOW, HIGH)):
        yield text(all_passes(measured, size, f"4.{5 + number}"))
    if isinstance(measured.long_range, str):
        yield f"Table 4.7 is left out: {measured.long_range}"
    else:
        yield text(with_long_range(measured.long_range))
    yield text(opacity_maps(measured))
    yield text(opacity_overhead(measured))
    yield text(complete(measured))


# --- each table -------------------------------------------------------------------------------------


def separate_or_merged(measured: Measured, size: tuple[int, int, int], number: str) -> Table:
    """4.1 and 4.2; without a checkerboard the thesis filters in the in-scattering shader."""
    apart, one = (_stages(measured, size, merged=merged) for merged in (False, True))
    parts = apart["media"], plus(apart["lighting"], apart["temporal"])
    buffer, light, both, merged = SEPARATE[size]
    ours = plus(*parts), plus(one["merged"], one["temporal"])
    return Table(f"{number}: separate vs. merged V-Buffer and in-scattering, {_froxels(size)}", [
        Row("Separate", both, ours[0]), Row("  (V-Buffer", buffer, parts[0]),
        Row("  + in-scattering)", light, parts[1]), Row("Merged", merged, ours[1]),
        Row("Difference", _less(merged, both), minus(ours[1], ours[0]))], 0)


def without_or_with_checkerboard(measured: Measured, size: tuple[int, int, int], number: str) -> Table:
    """4.3 and 4.4, merged."""
    off, on = (_stages(measured, size, merged=True, checkerboard=half) for half in (False, True))
    ours = plus(off["merged"], off["temporal"]), plus(on["merged"], on["temporal"])
    whole, light, filtered, half = CHECKERBOARD[size]
    return Table(f"{number}: without and with checkerboard rendering, {_froxels(size)}", [
        Row("CB Off", whole, ours[0]), Row("CB On", half, ours[1]), Row("  (in-scattering", light, on["merged"]),
        Row("  + filter)", filtered, on["temporal"]), Row("Difference", _less(half, whole), minus(ours[1], ours[0]))],
        0, f"CB Off of the {GPUS[0]} is Merged of table {number[:2]}{int(number[2:]) - 2}.")


def all_passes(measured: Measured, size: tuple[int, int, int], number: str) -> Table:
    """4.5 and 4.6, merged and with a checkerboard."""
    stages = _stages(measured, size, merged=True, checkerboard=True)
    ours = [stages["merged"], stages["temporal"], stages["integrate"], measured.apply[size]]
    names = ("In-Scatter", "Filter", "Integrate", "Apply", "Total")
    note = f"Filter of the {GPUS[0]} is that of table 4.3." if size == LOW else ""
    return Table(f"{number}: all volumetric fog passes, {_froxels(size)}",
                 [Row(*each) for each in zip(names, PASSES[size], [*ours, plus(*ours)], strict=True)], 4, note)


def with_long_range(stages: Mapping[str, Timing]) -> Table:
    """4.7; downsampling is the first part of our long range's stage."""
    march = minus(stages["long_range"], stages["downsample"])
    ours = [stages["merged"], stages["temporal"], stages["integrate"], stages["downsample"], march, stages["apply"]]
    names = ("In-Scatter", "Filter", "Integrate", "Depth Downsample", "Ray Marching", "Apply", "Total")
    return Table(f"4.7: the long range scene, {_froxels(LOW)}",
                 [Row(*each) for each in zip(names, LONG_RANGE, [*ours, plus(*ours)], strict=True)], 6)


def opacity_maps(measured: Measured) -> Table:
    """4.8."""
    ours = [None, measured.suns, measured.lamps, _overhead(measured, LOW), None]
    total = plus(*(timing for timing in ours if timing is not None))
    names = ("Dir. Lights Depth", "Dir. Lights", "Local Lights", "In-Scattering Overhead", "Ray Marching Overhead",
             "Total")
    return Table("4.8: generating the FOM textures and sampling them",
                 [Row(*each) for each in zip(names, OPACITY, [*ours, total], strict=True)], 5,
                 "Our Dir. Lights find their depth ranges themselves; no march of ours reads these maps, for global "
                 "media do not dim suns.")


def opacity_overhead(measured: Measured) -> Table:
    """4.9."""
    ours = _overhead(measured, HIGH)
    total = plus(measured.suns, measured.lamps, ours)
    return Table(f"4.9: sampling the FOM textures, {_froxels(HIGH)}", [
        Row("In-Scattering Overhead", OVERHEAD[0], ours), Row("Total", OVERHEAD[1], total)], 1,
        "Published totals are as printed; the sums of their parts are 0.313 and 2.529 ms.")


def complete(measured: Measured) -> Table:
    """4.10: opacity maps, fog, what lies behind it, and apply; surfaces, opaque maps and culling do not count."""
    rows = []
    for size, resolution in ((LOW, "Low"), (HIGH, "High")):
        for shadows, word in ((False, "Without"), (True, "With")):
            stages = _stages(measured, size, merged=True, checkerboard=True, shadows=shadows)
            ours = [stages[name] for name in ("fom", "merged", "temporal", "integrate", "long_range") if name in stages]
            rows.append(Row(f"{word} Volumetric Shadows ({resolution} Res.)", COMPLETE[size][shadows],
                            plus(*ours, measured.apply[size])))
    return Table("4.10: the complete volumetric lighting", rows, 0)


def _stages(measured: Measured, size: tuple[int, int, int], *, merged: bool = False, checkerboard: bool = False,
            shadows: bool = False) -> Mapping[str, Timing]:
    return measured.stages[Configuration(size, merged, checkerboard, shadows)]


def _overhead(measured: Measured, size: tuple[int, int, int]) -> Timing:
    """What looking up opacity maps adds to in-scattering."""
    return minus(*(_stages(measured, size, merged=True, checkerboard=True, shadows=shadows)["merged"]
                   for shadows in (True, False)))


# --- arithmetic and text ----------------------------------------------------------------------------


def plus(*timings: Timing) -> Timing:
    """Sums of the least and of the medians."""
    return Timing(*map(sum, zip(*timings, strict=True)))


def minus(one: Timing, other: Timing) -> Timing:
    """Differences of the least and of the medians."""
    return Timing(one.least - other.least, one.median - other.median)


def _over(one: Pair, other: Pair) -> Pair:
    return one[0] / other[0], one[1] / other[1]


def _less(one: Pair, other: Pair) -> Pair:
    return one[0] - other[0], one[1] - other[1]


def _froxels(size: tuple[int, int, int]) -> str:
    return "x".join(map(str, size))


def text(one: Table) -> str:
    """A table: our milliseconds and shares, then shares and milliseconds of each GPU."""
    base = one.rows[one.base]
    assert base.ours is not None
    lines = []
    for row in one.rows:
        ours = ("-", "-", "-") if row.ours is None else (
            f"{1e3 * row.ours.least:.1f}", f"{1e3 * row.ours.median:.1f}", f"{row.ours.least / base.ours.least:.3f}")
        shares = _over(row.published, base.published)
        theirs = [cell for share, value in zip(shares, row.published, strict=True)
                  for cell in (f"{share:.3f}", f"{value:.4g}")]
        lines.append((row.name, *ours, *theirs))
    head = ("", "ms", "median", "share", *(cell for gpu in GPUS for cell in (gpu, "ms")))
    return "\n".join([f"Table {one.title}", table(lines, head), *[one.note] * bool(one.note)])
