"""Heat maps: a kernel's error over the plane of its first two parameters."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from froxel_ref.arrays import Field
from froxel_ref.display import Bytes, ramp_colours
from froxel_ref.panels import FAINT, INK, canvas, write
from froxel_ref.stability import PRECISIONS, Kernel, Parameter, errors_in_ulp, exact_values, run_form

if TYPE_CHECKING:
    from PIL.Image import Image

__all__ = ["Axis", "Plane", "axis", "error_plane", "heat_map"]

COLUMNS, ROWS, CELL = 40, 26, 8
LEFT, TOP, GAP, BOTTOM = 92, 64, 26, 112
TYPES = ("float64", "float32")
LOWEST, HIGHEST = 0.1, 1e9  # ends of the colour scale [ulp]
BAD, BEYOND = (224, 64, 64), (58, 60, 66)  # not finite; the exact value is beyond the type


class Axis(NamedTuple):
    """Values along one edge of a heat map, in float64, with a label and named positions in [0, 1]."""

    values: NDArray[np.float64]
    label: str
    ticks: tuple[tuple[float, str], ...]


class Plane(NamedTuple):
    """Errors in ulp, shape (rows, columns); NaN beyond the type's range, infinity for a result not finite."""

    across: Axis
    up: Axis
    errors: NDArray[np.float64]


def axis(parameter: Parameter | None, count: int, precision: str) -> Axis:
    """How a parameter is laid out along an edge.

    Parameters
    ----------
    parameter : Parameter or None
        None for kernels with one parameter: then the neighbours of the other one's value.
    count : int
        Cells.
    precision : str
        A key of `PRECISIONS`, for the range.

    Returns
    -------
    Axis
        Logarithmic for magnitudes; for what approaches 1, the logarithm of the distance from it.

    Examples
    --------
    >>> axis(Parameter("length", "m", "magnitude", 1e-2, 1e2), 3, "float64").values.round(12).tolist()
    [0.01, 1.0, 100.0]
    """
    if parameter is None:
        return Axis(np.arange(float(count)), "neighbouring numbers", ((0.0, "0"), (1.0, str(count - 1))))
    limits = np.finfo(PRECISIONS[precision][0])
    unit = "" if parameter.unit == "1" else f" [{parameter.unit}]"
    label = f"{parameter.name}{unit}"
    if parameter.kind == "choice":
        known = np.array(sorted(parameter.extremes))
        index = np.minimum(np.arange(count) * len(known) // count, len(known) - 1)
        return Axis(known[index], label,
                    tuple(((i + 0.5) / len(known), f"{v:g}") for i, v in enumerate(known)))
    if parameter.kind in ("share", "cosine"):
        digits = int(limits.precision)
        places = tuple((k / digits, "0" if k == 0 else f"1-1e-{k}")
                       for k in (0, digits // 3, 2 * digits // 3, digits))
        return Axis(1.0 - 10.0 ** -np.linspace(0.0, digits, count), label, places)
    if parameter.kind == "linear":
        ends = parameter.low, parameter.high
        return Axis(np.linspace(*ends, count), label, ((0.0, f"{ends[0]:g}"), (1.0, f"{ends[1]:g}")))
    low, high = max(parameter.low, float(limits.tiny), 1e-30), min(parameter.high, float(limits.max) / 4.0)
    start, end = math.log10(low), math.log10(high)
    step = max(1, math.ceil((end - start) / 5.0))
    marks = range(math.ceil(start / step) * step, math.floor(end + 1e-9) + 1, step)
    return Axis(np.geomspace(low, high, count), label,
                tuple(((m - start) / (end - start), f"1e{m}") for m in marks))


def error_plane(kernel: Kernel, form: str, precision: str, *, columns: int = COLUMNS,
                rows: int = ROWS) -> Plane:
    """A kernel's errors over its first two parameters, the others at their typical values.

    Parameters
    ----------
    kernel : Kernel
    form, precision : str
        Keys of its forms and of `PRECISIONS`.
    columns, rows : int
        Cells; fewer for kernels whose exact value is costly.

    Returns
    -------
    Plane
    """
    inputs, across, up, shape = _inputs(kernel, precision, columns, rows)
    errors = errors_in_ulp(run_form(kernel, form, inputs, precision), exact_values(kernel, inputs))[0]
    return Plane(across, up, errors.reshape(shape))


def _inputs(kernel: Kernel, precision: str, columns: int, rows: int
            ) -> tuple[list[Field], Axis, Axis, tuple[int, int]]:
    if kernel.share < 1.0:
        columns, rows = columns // 2, rows // 2
    dtype = PRECISIONS[precision][0]
    second = kernel.parameters[1] if len(kernel.parameters) > 1 else None
    across, up = axis(kernel.parameters[0], columns, precision), axis(second, rows, precision)
    # A cell is not its middle's nice number: values are moved by a fixed share of the way to the next one.
    jitter = 1.0 + 1e-3 * np.random.default_rng(1).random((rows, columns))
    x, y = np.broadcast_arrays(across.values[None, :], up.values[:, None])
    if kernel.parameters[0].kind == "magnitude":
        x = x * jitter
    if second is None:
        fields = [(x * (1.0 + y * float(np.finfo(dtype).eps)))]
    else:
        fields = [x, y * jitter[::-1] if second.kind == "magnitude" else y]
    fields += [np.full(x.shape, p.typical) for p in kernel.parameters[2:]]
    inputs = [np.clip(f, -np.finfo(dtype).max, np.finfo(dtype).max).astype(dtype).ravel() for f in fields]
    for values, parameter in zip(inputs, kernel.parameters, strict=True):
        if parameter.kind == "share":
            np.minimum(values, dtype(1) - np.finfo(dtype).epsneg, out=values)
    return inputs, across, up, (rows, columns)


def heat_map(kernel: Kernel, precisions: tuple[str, ...] | None = None) -> Bytes:
    """The picture of a kernel: a panel per form and precision, with axes and the scale of colours.

    Parameters
    ----------
    kernel : Kernel
    precisions : tuple of str, optional
        Rows of panels, of those that the kernel has. Default: float64 and float32, and float16 where
        something is stored in between.

    Returns
    -------
    ndarray of uint8, shape (height, width, 3)
    """
    from PIL import Image

    wanted = precisions or (*TYPES, *(("float16",) if kernel.stores_between else ()))
    rows = [p for p in wanted if p in kernel.precisions]
    panels = []
    for precision in rows:  # the exact values are the forms' common cost
        inputs, across, up, shape = _inputs(kernel, precision, COLUMNS, ROWS)
        exact = exact_values(kernel, inputs)
        panels.append([Plane(across, up, errors_in_ulp(run_form(kernel, form, inputs, precision), exact)[0]
                             .reshape(shape)) for form in kernel.forms])
    width, height = COLUMNS * CELL, ROWS * CELL
    pitch, stride = width + LEFT, height + BOTTOM - 34
    image = canvas(max(pitch * len(kernel.forms) + GAP, 650), TOP + stride * len(rows) + 62)
    write(image, (16, 10), kernel.name.replace("_", " "), 22)
    write(image, (16, 38), _plain(kernel.about), 15, FAINT, image.width - 32)
    for j, (precision, planes) in enumerate(zip(rows, panels, strict=True)):
        for i, (form, plane) in enumerate(zip(kernel.forms, planes, strict=True)):
            x, y = LEFT + i * pitch, TOP + 26 + j * stride
            write(image, (x, y - 20), f"{form}, {precision}: {_range(plane.errors)}", 15, INK, width)
            cells = Image.fromarray(_painted(plane.errors)[::-1].copy())
            image.paste(cells.resize((width, height), Image.Resampling.NEAREST), (x, y))
            _axes(image, plane, x, y, width, height)
    _scale(image, image.height - 50)
    return np.asarray(image)


def _range(errors: NDArray[np.float64]) -> str:
    finite = errors[np.isfinite(errors)]
    return f"worst {finite.max():.3g} ulp" if finite.size else "nothing in range"


def _plain(words: str) -> str:
    """Without the signs that the pictures' typeface lacks and `panels.drawable` does not know."""
    for sign, letters in (("θ", "theta"), ("⁻²", "^-2"), ("⁻¹", "^-1"), ("√", "root of "), ("τ", "tau")):
        words = words.replace(sign, letters)
    return words


def _painted(errors: NDArray[np.float64]) -> Bytes:
    """Colours by the logarithm of the error, in ulp; marks for what has none."""
    with np.errstate(divide="ignore", invalid="ignore"):
        share = np.log(np.maximum(errors, LOWEST) / LOWEST) / math.log(HIGHEST / LOWEST)
    colours = ramp_colours(np.clip(np.nan_to_num(share, nan=0.0, posinf=1.0), 0.0, 1.0))
    colours[np.isnan(errors)] = BEYOND
    colours[np.isinf(errors)] = BAD
    return colours


def _axes(image: Image, plane: Plane, x: int, y: int, width: int, height: int) -> None:
    from PIL import Image as Images
    from PIL import ImageDraw

    draw = ImageDraw.Draw(image)
    draw.rectangle([x - 1, y - 1, x + width, y + height], outline=FAINT)
    for share, words in plane.across.ticks:
        at = x + share * width
        draw.line([(at, y + height), (at, y + height + 4)], fill=FAINT)
        write(image, (at, y + height + 6), words, 13, FAINT, anchor="ma")
    for share, words in plane.up.ticks:
        at = y + height * (1.0 - share)
        draw.line([(x - 5, at), (x - 1, at)], fill=FAINT)
        write(image, (x - 7, at), words, 13, FAINT, anchor="rm")
    write(image, (x + width / 2, y + height + 24), _plain(plane.across.label), 14, INK, width, "ma")
    side = canvas(height, 18)
    write(side, (height / 2, 1), _plain(plane.up.label), 14, INK, height, "ma")
    image.paste(side.transpose(Images.Transpose.ROTATE_90), (x - LEFT + 8, y))


def _scale(image: Image, y: int) -> None:
    from PIL import Image as Images

    width = 300
    steps = np.geomspace(LOWEST, HIGHEST, width)
    bar = np.broadcast_to(_painted(steps)[None], (14, width, 3))
    image.paste(Images.fromarray(np.ascontiguousarray(bar)), (16, y))
    for value in (0.1, 1.0, 1e3, 1e6, 1e9):
        at = 16 + width * math.log(value / LOWEST) / math.log(HIGHEST / LOWEST)
        write(image, (at, y + 18), f"{value:g}".replace("e+0", "e"), 13, FAINT,
              anchor="la" if value == LOWEST else "ma")
    write(image, (16 + width + 14, y - 1), "error [ulp]", 14, INK)
    for i, (colour, words) in enumerate(((BAD, "not finite"), (BEYOND, "beyond the type"))):
        at = 16 + width + 100 + 90 * i
        image.paste(canvas(12, 12, colour), (at, y + 1))
        write(image, (at + 17, y - 1), words, 13, FAINT)
