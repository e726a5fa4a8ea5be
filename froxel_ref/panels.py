"""Panels of the pictures: slices and plans of volumes, images, curves, swatches, and text.

A texel is always a square of pixels, enlarged by whole factors or averaged down; what stands in for a
constant says so. Text is set in the typeface that comes with Pillow, so pictures do not depend on the
machine's fonts.
"""

from __future__ import annotations

import math
import unicodedata
from functools import lru_cache
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from froxel_ref.arrays import Field
from froxel_ref.display import NOTHING, Bytes, Display, grey, ramp_colours
from froxel_ref.scene import Camera
from froxel_ref.settings import Grid

if TYPE_CHECKING:
    from PIL.Image import Image

PAPER, PANEL = (22, 24, 28), (34, 37, 43)
INK, FAINT, AMBER = (232, 234, 238), (150, 156, 166), (236, 178, 92)
_SIGNS = str.maketrans({"×": "x", "–": "-", "—": "-", "−": "-", "²": "^2", "³": "^3", "⁻": "^-", "¹": "1",
                       "½": "1/2", "≤": "<=", "≥": ">=", "σ": "sigma", "τ": "tau", "→": "->", "µ": "u"})
_DRAWN = "°·…"  # all that the typeface has beyond ASCII


class View(NamedTuple):
    """What a picture needs to know of the frame: camera, froxel grid and the exposure of the display."""

    camera: Camera
    grid: Grid
    exposure: float = 1.0


@lru_cache
def font(size: int) -> Any:
    """Pillow's own typeface: the same on every machine."""
    from PIL import ImageFont

    return ImageFont.load_default(size)


def write(image: Image, at: tuple[float, float], words: str, size: int = 15,
          fill: tuple[int, int, int] = INK, width: float = math.inf, anchor: str = "la") -> None:
    """Draw one line of text, shortened with dots where it would pass ``width`` pixels."""
    from PIL import ImageDraw

    draw, face, line = ImageDraw.Draw(image), font(size), drawable(words)
    while line and draw.textlength(line, font=face) > width:
        line = line[:-2].rstrip(" …,;") + "…" if len(line) > 2 else ""
    draw.text(at, line, font=face, fill=fill, anchor=anchor)


def drawable(words: str) -> str:
    """The words in the characters that the typeface has: accents dropped, signs spelled out.

    Examples
    --------
    >>> drawable("Dörries: σ ≤ ½·10⁻¹ m")
    'Dorries: sigma <= 1/2·10^-1 m'
    """
    plain = unicodedata.normalize("NFKD", words.translate(_SIGNS))
    kept = (c for c in plain if not unicodedata.combining(c))
    return "".join(c if c.isascii() or c in _DRAWN else "?" for c in kept)


def canvas(width: int, height: int, color: tuple[int, int, int] = PAPER) -> Image:
    """An empty picture."""
    from PIL import Image

    return Image.new("RGB", (int(width), int(height)), color)


def scaled(colours: Bytes, width: int, height: int) -> Image:
    """Texels as squares: enlarged by a whole factor, or averaged down, to fit a box."""
    from PIL import Image

    rows, columns = colours.shape[:2]
    image = Image.fromarray(np.ascontiguousarray(colours))
    if rows <= height and columns <= width:
        factor = max(1, min(width // columns, height // rows))
        return image.resize((columns * factor, rows * factor), Image.Resampling.NEAREST)
    share = min(width / columns, height / rows)
    return image.resize((max(1, round(columns * share)), max(1, round(rows * share))), Image.Resampling.BOX)


def resampled(colours: Bytes, width: int, height: int) -> Image:
    """An image resampled to fit a box, its proportions kept."""
    from PIL import Image

    rows, columns = colours.shape[:2]
    share = min(width / columns, height / rows)
    size = max(1, round(columns * share)), max(1, round(rows * share))
    return Image.fromarray(np.ascontiguousarray(colours)).resize(size, Image.Resampling.LANCZOS)


def flat(values: Field) -> str:
    """The value of a constant array in words."""
    numbers = [float(v) for v in values.ravel()]
    if len(set(numbers)) == 1:
        return f"{numbers[0]:.6g}"
    return "(" + ", ".join(f"{v:.4g}" for v in numbers) + ")"


def swatch(values: Field, display: Display, width: int, height: int) -> Image:
    """An array of equal values as a flat patch that says them; coloured where the values are a colour."""
    values = values.reshape(values.shape[0], -1)[:, :1]
    red, green, blue = display.paint(values)[0].tolist()
    colour = (red, green, blue) if display.kind in ("radiance", "reflectance", "normal", "unit") else PANEL
    image = canvas(width, height, colour)
    ink = (20, 20, 20) if sum(colour) > 450 else INK
    write(image, (width / 2, height / 2 - 12), flat(values), 18, ink, width - 8, "mm")
    write(image, (width / 2, height / 2 + 12), "everywhere", 15, ink, width - 8, "mm")
    return image


def image_panel(values: Field, display: Display, view: View, width: int, height: int, *,
                on_grid: bool = False, exact: bool = True) -> Image:
    """An image array (C, h, w) in a box; axes of length 1 are spread over the raster first.

    With ``exact`` it is enlarged by a whole factor only, else resampled to fill the box.
    """
    rows, columns = values.shape[1:]
    full = (view.grid.height, view.grid.width) if on_grid else (view.camera.height, view.camera.width)
    shape = (rows if rows > 1 else full[0], columns if columns > 1 else full[1], 3)
    colours = np.broadcast_to(display.paint(values), shape)
    return scaled(colours, width, height) if exact else resampled(colours, width, height)


def chosen_slices(values: Field, count: int) -> list[int]:
    """Up to ``count`` slices of a volume (C, D, H, W): the first, the last, and the rest where it changes.

    Examples
    --------
    >>> chosen_slices(np.repeat([0.0, 1.0, 0.0], [20, 4, 40]).reshape(1, 64, 1, 1), 6)
    [0, 19, 21, 22, 24, 63]
    """
    depth = values.shape[1]
    if depth <= count:
        return list(range(depth))
    flat = values.reshape(values.shape[0], depth, -1)
    flat = flat[:, :, :: max(1, flat.shape[2] // 4096)]
    step = np.abs(np.diff(flat, axis=1)).max(axis=(0, 2))
    changes = np.flatnonzero(step > 1e-3 * step.max())
    first, last = (int(changes[0]), int(changes[-1]) + 1) if changes.size else (0, depth - 1)
    inner = np.linspace(first, last, count - (first > 0) - (last < depth - 1))
    return sorted({0, depth - 1, *(round(k) for k in inner.tolist())})


def tile_size(grid: Grid, target: int) -> tuple[int, int]:
    """Width and height of a slice's picture about ``target`` pixels wide, by a whole factor if enlarged."""
    if max(grid.width, grid.height) > 1.5 * target:
        share = target / max(grid.width, grid.height)
        return max(1, round(grid.width * share)), max(1, round(grid.height * share))
    factor = max(1, min(round(target / grid.width), round(target / grid.height)))
    return grid.width * factor, grid.height * factor


def slices_panel(values: Field, display: Display, view: View, shape: tuple[int, int], *,
                 at_boundary: bool, target: int, gap: int = 6) -> Image:
    """Slices of a volume (C, D, H, W) in ``shape`` = (rows, columns) tiles, each with its depth in metres."""
    grid, (rows, columns) = view.grid, shape
    picked = chosen_slices(values, rows * columns)
    columns = min(columns, len(picked))
    rows = -(-len(picked) // columns)
    tile_width, tile_height = tile_size(grid, target)
    cell, line = max(tile_width, 64), 22  # the label below a tile needs its room
    image = canvas(columns * (cell + gap) - gap, rows * (tile_height + line + gap) - gap)
    for number, k in enumerate(picked):
        x, y = (number % columns) * (cell + gap), (number // columns) * (tile_height + line + gap)
        block = np.broadcast_to(values[:, k], (values.shape[0], grid.height, grid.width))
        image.paste(scaled(display.paint(block), tile_width, tile_height), (x, y))
        write(image, (x, y + tile_height + 3), _depth_words(k, values, view, at_boundary), 15, FAINT, cell)
    return image


def _depth_words(k: int, values: Field, view: View, at_boundary: bool) -> str:
    from froxel_ref.grid import slice_to_depth

    if values.shape[1] == 1:
        return "every slice"
    z = float(np.asarray(slice_to_depth(np.float64(k + 1 if at_boundary else k + 0.5), view.grid)))
    return f"{'to ' if at_boundary else ''}{z:.3g} m"


def plan_panel(values: Field, display: Display, view: View, width: int, height: int) -> Image:
    """The volume seen from above, to scale: the plane of view space through the image's middle row."""
    from PIL import Image

    from froxel_ref.grid import depth_to_slice

    camera, grid = view.camera, view.grid
    half_width = math.tan(math.radians(camera.vertical_fov) / 2.0) * camera.width / camera.height
    metres = max(grid.far / height, 2.0 * half_width * grid.far / width)  # per pixel
    tall, wide = max(1, round(grid.far / metres)), max(1, round(2.0 * half_width * grid.far / metres))
    z = grid.far - (np.arange(tall)[:, None] + 0.5) * metres
    x = (np.arange(wide)[None, :] + 0.5 - wide / 2.0) * metres
    with np.errstate(invalid="ignore", divide="ignore"):
        inside = (z >= grid.near) & (np.abs(x) < z * half_width)
        column = np.where(inside, (0.5 + 0.5 * x / np.maximum(z * half_width, 1e-30)) * grid.width, 0.0)
        k = np.where(z >= grid.near, depth_to_slice(np.maximum(z, grid.near), grid), 0.0)
    _, depth, rows, columns = values.shape  # index 0 wherever an axis has length 1
    k, column = (np.clip(i.astype(int), 0, n - 1) for i, n in ((k, depth), (column, columns)))
    colours = display.paint(values[:, :, rows // 2])[k, column]
    colours = np.where(inside[..., None], colours, np.array(PANEL, np.uint8))
    image = canvas(max(wide, 280), max(tall, 60), PANEL)
    image.paste(Image.fromarray(colours.astype(np.uint8)), ((image.width - wide) // 2, image.height - tall))
    write(image, (6, image.height - 42), "from above,", 15, FAINT, 130)
    write(image, (6, image.height - 22), f"{grid.far:.4g} m deep", 15, FAINT, 130)
    return image


def curve_panel(values: Field, width: int, height: int, label: str = "slice") -> Image:
    """A one-dimensional array as a curve over its index."""
    from PIL import ImageDraw

    image = canvas(width, height, PANEL)
    line = values.reshape(values.shape[0], -1)
    left, right, top, bottom = 64, width - 14, 12, height - 26
    low, high = float(min(0.0, line.min())), float(line.max()) or 1.0
    draw = ImageDraw.Draw(image)
    for share in (0.0, 0.5, 1.0):
        y = bottom - share * (bottom - top)
        draw.line([(left, y), (right, y)], fill=NOTHING)
        write(image, (left - 6, y), f"{low + share * (high - low):.3g}", 14, FAINT, anchor="rm")
    colours = [INK] if len(line) == 1 else [(255, 110, 100), (110, 220, 120), (110, 160, 255)]
    for channel, colour in zip(line, colours, strict=True):
        xs = left + (right - left) * (np.arange(len(channel)) + 0.5) / len(channel)
        ys = bottom - (channel - low) / (high - low) * (bottom - top)
        points = list(zip(xs.tolist(), ys.tolist(), strict=True))
        draw.line(points if len(points) > 1 else points * 2, fill=colour, width=2)
    last = f"{label} 0 to {line.shape[1] - 1}"
    write(image, ((left + right) / 2, height - 6), last, 14, FAINT, anchor="mb")
    return image


def legend(display: Display, width: int, *, plain: bool = False) -> Image:
    """The range in words, with the ramp beside it where there is one; with ``plain``, only the range."""
    from PIL import Image

    image, x = canvas(width, 22), 0
    if not plain and display.kind in ("unit", "scalar", "depth"):
        bar_width = min(100, width // 4)
        steps = np.broadcast_to(np.linspace(0.0, 1.0, bar_width), (1, 12, bar_width))
        bar = grey(steps) if display.kind == "unit" else ramp_colours(steps[0])
        image.paste(Image.fromarray(bar), (0, 5))
        x = bar_width + 8
    words = f"{display.low:.4g} to {display.high:.4g}" if plain else display.label()
    write(image, (x, 2), words, 16, FAINT, width - x)
    return image
