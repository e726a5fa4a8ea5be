"""Maps of a kernel's errors: over the plane of its first two parameters, or along its only one."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from froxel_ref.arrays import Field
from froxel_ref.display import Bytes, ramp_colours
from froxel_ref.panels import AMBER, FAINT, INK, PANEL, canvas, write
from froxel_ref.stability import Examined, Kernel, errors_in_ulp, exact_values, examine, run_form
from froxel_ref.stability_inputs import Axis, Map, map_of
from froxel_ref.stability_measure import FAULTS, SOUND_ULP, Measure

if TYPE_CHECKING:
    from PIL.Image import Image

__all__ = ["MARKS", "Plane", "error_plane", "heat_map"]

Ticks: TypeAlias = tuple[tuple[float, str], ...]

WIDTH, HEIGHT = 368, 208  # of a panel [px]
LEFT, RIGHT, HEAD, FOOT, TOP, SIDE = 84, 14, 46, 52, 66, 90
LOWEST = 0.1  # end of the colour scale [ulp]
HIGHEST = {"float64": 1e16, "float32": 1e8, "float16": 1e4}  # where a type has no digit left, about
DIM = 0.17  # place on the ramp where the scale begins: to be seen on the page
BEYOND = (58, 60, 66)  # the exact value is beyond the type

# What must not be: a colour, and every how many pixels along x, y and the diagonal it gives way to black.
MARKS: dict[str, tuple[tuple[int, int, int], tuple[int, int, int]]] = {
    "not_a_number": ((240, 70, 230), (4, 4, 0)), "infinite": ((224, 64, 64), (0, 0, 0)),
    "negative": ((70, 215, 235), (0, 4, 0)), "above": ((255, 205, 40), (0, 0, 6)),
    "rising": ((150, 240, 90), (4, 0, 0))}


class Plane(NamedTuple):
    """What a map shows of one form in one precision.

    Attributes
    ----------
    chart : Map
        Its edges.
    errors : ndarray, shape of the map [ulp]
        NaN beyond the type's range, infinity for a result that is not finite.
    faults : dict of str to ndarray of bool, shape of the map
        By the names in `froxel_ref.stability.FAULTS`.
    """

    chart: Map
    errors: NDArray[np.float64]
    faults: dict[str, NDArray[np.bool_]]


def error_plane(kernel: Kernel, form: str, precision: str, *, columns: int = 40, rows: int = 26) -> Plane:
    """A kernel's errors over its first two parameters, the others at their typical values.

    Parameters
    ----------
    kernel : Kernel
    form, precision : str
        Keys of its forms and of `PRECISIONS`.
    columns, rows : int
        Cells within the ranges; fewer for kernels whose exact value is costly.

    Returns
    -------
    Plane
        Without faults.
    """
    chart = map_of(kernel, precision, columns=columns, rows=rows)
    results = run_form(kernel, form, chart.inputs, precision)
    errors = errors_in_ulp(results, exact_values(kernel, chart.inputs))[0]
    return Plane(chart, errors.reshape(chart.shape), {})


def heat_map(kernel: Kernel, found: Examined | None = None) -> Bytes:
    """The picture of a kernel: a panel per form and precision, with axes, scales and marks.

    Parameters
    ----------
    kernel : Kernel
    found : Examined, optional
        What is known of it; default: found anew, from as many inputs as the command takes.

    Returns
    -------
    ndarray of uint8, shape (height, width, 3)
        A title over each panel gives the verdict and the worst error over all inputs, random and hand-picked
        ones too, and a ring the place of that error.
    """
    found = examine(kernel) if found is None else found
    pitch, stride = LEFT + WIDTH + RIGHT, HEAD + HEIGHT + FOOT
    width = max(16 + pitch * len(kernel.forms) + SIDE, 720)
    image = canvas(width, TOP + stride * len(kernel.precisions) + 40)
    write(image, (16, 10), kernel.name.replace("_", " "), 22)
    write(image, (16, 38), _plain(kernel.about), 15, FAINT, image.width - 32)
    measures = {(row.form, row.precision): row for row in found.measures}
    occurring: set[str] = set()
    for j, precision in enumerate(kernel.precisions):
        y = TOP + j * stride + HEAD
        for i, form in enumerate(kernel.forms):
            plane, x = _plane(found, form, precision), 16 + LEFT + i * pitch
            row = measures[form, precision]
            _title(image, row, x, y)
            draw = _draw_line if plane.chart.up is None else _draw_map
            draw(image, plane, row, precision, x, y)
            occurring |= {name for name, flags in plane.faults.items() if flags.any()}
            occurring |= {"beyond"} if np.isnan(plane.errors).any() else set()
        if found.trials[precision].chart.up is not None:
            _scale(image, precision, 16 + pitch * len(kernel.forms), y)
    _legend(image, occurring, image.height - 30)
    return np.asarray(image)


def _plane(found: Examined, form: str, precision: str) -> Plane:
    """The part of an outcome that belongs to the map."""
    chart, outcome = found.trials[precision].chart, found.outcomes[form, precision]
    last = slice(-chart.shape[0] * chart.shape[1], None)
    return Plane(chart, outcome.ulps[last].reshape(chart.shape),
                 {name: flags[last].reshape(chart.shape) for name, flags in outcome.faults.items()})


def _title(image: Image, row: Measure, x: int, y: int) -> None:
    write(image, (x, y - 42), f"{row.form}, {row.precision}: worst {row.worst:.3g} ulp", 15, INK, WIDTH)
    verdict = f"{row.verdict}: {row.reason}" if row.reason else row.verdict
    if row.sound and row.worst > SOUND_ULP:
        verdict += f" for a condition number of {row.condition:.2g}"
    colour = {"sound": FAINT, "inexact": AMBER, "fails": MARKS["infinite"][0]}[row.verdict]
    write(image, (x, y - 22), verdict, 13, colour, WIDTH)


def _plain(words: str) -> str:
    """Without the signs that the pictures' typeface lacks and `panels.drawable` does not know."""
    for sign, letters in (("θ", "theta"), ("⁻²", "^-2"), ("⁻¹", "^-1"), ("√", "root of "), ("τ", "tau")):
        words = words.replace(sign, letters)
    return words


# --- panels -----------------------------------------------------------------------------------------


def _place(errors: Field, precision: str) -> Field:
    """Share of the scale, by the logarithm of the error."""
    with np.errstate(divide="ignore", invalid="ignore"):
        share = np.log(np.maximum(errors, LOWEST) / LOWEST) / math.log(HIGHEST[precision] / LOWEST)
    return np.clip(np.nan_to_num(share, nan=0.0, posinf=1.0), 0.0, 1.0)


def _colours(errors: Field, precision: str) -> Bytes:
    colours = ramp_colours(DIM + (1.0 - DIM) * _place(errors, precision))
    colours[np.isnan(errors)] = BEYOND
    return colours


def _mark(name: str, shape: tuple[int, int]) -> Bytes:
    """A mark's colour and hatch over an area [px]."""
    colour, steps = MARKS[name]
    y, x = np.mgrid[:shape[0], :shape[1]]
    dark = np.zeros(shape, bool)
    for step, along in zip(steps, (x, y, x + y), strict=True):
        dark |= (along % step < step // 2) if step else False
    return np.where(dark[..., None], np.uint8(16), np.array(colour, np.uint8))


def _draw_map(image: Image, plane: Plane, row: Measure, precision: str, x: int, y: int) -> None:
    from PIL import Image as Images

    rows, columns = plane.errors.shape
    down, across = np.arange(HEIGHT)[::-1] * rows // HEIGHT, np.arange(WIDTH) * columns // WIDTH
    pixels = _colours(plane.errors, precision)[down[:, None], across]
    for name in reversed(FAULTS):  # the gravest last, on top
        where = plane.faults[name][down[:, None], across]
        pixels = np.where(where[..., None], _mark(name, where.shape), pixels)
    image.paste(Images.fromarray(np.ascontiguousarray(pixels.astype(np.uint8))), (x, y))
    assert plane.chart.up is not None
    _frame(image, x, y, plane.chart.across, plane.chart.up)
    at = (x + WIDTH * plane.chart.across.share(row.place[0]), y + HEIGHT * (1 - plane.chart.up.share(row.place[1])))
    _ring(image, at)


def _draw_line(image: Image, plane: Plane, row: Measure, precision: str, x: int, y: int) -> None:
    """Points: the error over the only parameter, on a logarithmic scale."""
    from PIL import ImageDraw

    image.paste(canvas(WIDTH, HEIGHT, PANEL), (x, y))
    worst = float(np.nanmax(np.where(np.isfinite(plane.errors), plane.errors, np.nan), initial=1.0))
    top = max(10.0, 10.0 ** math.ceil(math.log10(max(worst, row.worst)) + 0.3))
    low = LOWEST / 10.0

    def height(error: Field) -> Field:
        return np.asarray(y + HEIGHT * (1.0 - np.log(np.maximum(error, low) / low) / math.log(top / low)))

    decades = range(round(math.log10(low)), round(math.log10(top)) + 1)
    marks = [10.0**k for k in decades if k % max(1, len(decades) // 5) == 0]
    ticks = tuple((float(y + HEIGHT - height(np.array(v))) / HEIGHT, f"{v:g}") for v in marks)
    _frame(image, x, y, plane.chart.across, Axis(np.zeros(1), "linear", "error [ulp]", ticks), grid=True)
    draw = ImageDraw.Draw(image)
    errors = plane.errors[0]
    columns = x + WIDTH * (np.arange(len(errors)) + 0.5) / len(errors)
    for at, value, up in zip(columns, errors, height(errors), strict=True):
        if np.isnan(value):
            draw.rectangle([at - 1, y, at + 1, y + HEIGHT - 1], fill=BEYOND)
        elif np.isfinite(value):
            draw.ellipse([at - 1.5, up - 1.5, at + 1.5, up + 1.5], fill=(240, 200, 120))
    for name in reversed(FAULTS):  # along the upper edge
        for at in columns[plane.faults[name][0]]:
            draw.rectangle([at - 1, y, at + 1, y + 12], fill=MARKS[name][0])
    _ring(image, (x + WIDTH * plane.chart.across.share(row.place[0]), float(height(np.array(row.worst)))))


def _ring(image: Image, at: tuple[float, float]) -> None:
    from PIL import ImageDraw

    draw = ImageDraw.Draw(image)
    for radius, colour, width in ((7, (0, 0, 0), 4), (6, (255, 255, 255), 2)):
        draw.ellipse([at[0] - radius, at[1] - radius, at[0] + radius, at[1] + radius], outline=colour, width=width)


def _frame(image: Image, x: int, y: int, across: Axis, up: Axis, *, grid: bool = False) -> None:
    from PIL import Image as Images
    from PIL import ImageDraw

    draw = ImageDraw.Draw(image)
    for share, words in _apart(up.ticks, lambda words: 15.0 / HEIGHT):
        at = y + HEIGHT * (1.0 - share)
        draw.line([(x - 5, at), (x + WIDTH if grid else x - 1, at)], fill=BEYOND if grid else FAINT)
        write(image, (x - 7, at), words, 13, FAINT, anchor="rm")
    for share, words in _apart(across.ticks, lambda words: (7.0 * len(words) + 8.0) / WIDTH):
        at = x + share * WIDTH
        draw.line([(at, y + HEIGHT), (at, y + HEIGHT + 4)], fill=FAINT)
        write(image, (at, y + HEIGHT + 6), words, 13, FAINT, anchor="ma")
    for share in across.lines:  # what lies outside the range
        at = x + round(share * WIDTH) - 1
        draw.line([(at, y), (at, y + HEIGHT)], fill=(0, 0, 0), width=1 if grid else 3)
    for share in up.lines:
        at = y + HEIGHT * (1.0 - share)
        draw.line([(x, at), (x + WIDTH, at)], fill=(0, 0, 0), width=3)
    draw.rectangle([x - 1, y - 1, x + WIDTH, y + HEIGHT], outline=FAINT)
    write(image, (x + WIDTH / 2, y + HEIGHT + 24), _plain(across.label), 14, INK, WIDTH, "ma")
    side = canvas(HEIGHT, 18)
    write(side, (HEIGHT / 2, 1), _plain(up.label), 14, INK, HEIGHT, "ma")
    image.paste(side.transpose(Images.Transpose.ROTATE_90), (x - LEFT + 6, y))


def _apart(ticks: Ticks, size: Callable[[str], float]) -> list[tuple[float, str]]:
    """The ticks whose words do not run into those of an earlier one."""
    kept: list[tuple[float, str]] = []
    for share, words in ticks:
        if all(abs(share - other) >= 0.5 * (size(words) + size(said)) for other, said in kept):
            kept.append((share, words))
    return kept


# --- what the colours mean --------------------------------------------------------------------------


def _scale(image: Image, precision: str, x: int, y: int) -> None:
    """The scale of a row of maps, beside it."""
    from PIL import Image as Images

    end = HIGHEST[precision]
    steps = np.geomspace(end, LOWEST, HEIGHT)
    bar = np.broadcast_to(_colours(steps, precision)[:, None], (HEIGHT, 14, 3))
    image.paste(Images.fromarray(np.ascontiguousarray(bar)), (x + 2, y))
    for value in (LOWEST, 1.0, end**0.25, end**0.5, end**0.75, end):
        at = y + HEIGHT * (1.0 - float(_place(np.array(value), precision)))
        words = f"{value:.0e}".replace("e+0", "e").replace("e+", "e") if value >= 1e4 else f"{value:g}"
        write(image, (x + 21, at), words, 13, FAINT, anchor="lm")
    write(image, (x + 2, y - 42), "ulp", 14, INK)
    write(image, (x + 2, y - 24), "and more", 13, FAINT)


def _legend(image: Image, occurring: set[str], y: int) -> None:
    """What the marks are that stand in this picture."""
    from PIL import Image as Images

    x = 30.0
    _ring(image, (x, y + 7))
    words = "worst of all inputs, drawn or not"
    write(image, (x + 15, y - 1), words, 13, FAINT)
    x += 250.0
    for name, said in (*FAULTS.items(), ("beyond", "value beyond the type")):
        if name in occurring:
            patch = np.full((14, 14, 3), BEYOND, np.uint8) if name == "beyond" else _mark(name, (14, 14))
            image.paste(Images.fromarray(patch), (int(x), y))
            write(image, (x + 20, y - 1), said, 13, FAINT)
            x += 34.0 + 7.2 * len(said)
