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
from froxel_ref.display import Bytes, Display
from froxel_ref.grid import depth_to_slice, slice_to_depth
from froxel_ref.scene import Camera
from froxel_ref.settings import Grid

if TYPE_CHECKING:
    from PIL.Image import Image

__all__ = [
    "AMBER", "FAINT", "INK", "PANEL", "PAPER", "View", "canvas", "chosen_slices", "drawable",
    "image_panel", "plan_panel", "scaled", "slices_panel", "swatch", "tame", "tile_size", "write",
]

PAPER, PANEL = (22, 24, 28), (34, 37, 43)
INK, FAINT, AMBER = (232, 234, 238), (150, 156, 166), (236, 178, 92)
_SIGNS = str.maketrans({"×": "x", "–": "-", "—": "-", "−": "-", "²": "^2", "³": "^3", "⁻": "^-", "¹": "1",
                       "½": "1/2", "≤": "<=", "≥": ">=", "σ": "sigma", "τ": "tau", "→": "->", "µ": "u"})
_DRAWN = "°·…"  # all that the typeface has beyond ASCII


class View(NamedTuple):
    """What a picture needs to know of the frame.

    Attributes
    ----------
    camera : Camera
        Its view and the size of its image [px].
    grid : Grid
        The froxels.
    exposure : float
        Of the display, a factor on radiance.
    """

    camera: Camera
    grid: Grid
    exposure: float = 1.0


@lru_cache
def _font(size: int) -> Any:
    """Pillow's own typeface, the same on every machine, in a size in pixels."""
    from PIL import ImageFont

    return ImageFont.load_default(size)


def write(image: Image, at: tuple[float, float], words: str, size: int = 15,
          fill: tuple[int, int, int] = INK, width: float = math.inf, anchor: str = "la") -> None:
    """Draw one line of text, shortened with dots where it would be too wide.

    Parameters
    ----------
    image : PIL.Image.Image
        Drawn into.
    at : tuple of 2 floats
        Where the anchor lies: x and y from the top left corner [px].
    words : str
        What to write; see `drawable`.
    size : int
        Of the typeface [px].
    fill : tuple of 3 ints
        Its colour, 0 to 255.
    width : float
        The most that the line may take [px].
    anchor : str
        Pillow's two letters: ``la`` for top left, ``mm`` for the middle.
    """
    from PIL import ImageDraw

    draw, face, line = ImageDraw.Draw(image), _font(size), drawable(words)
    while line and draw.textlength(line, font=face) > width:
        line = line[:-2].rstrip(" …,;") + "…" if len(line) > 2 else ""
    draw.text(at, line, font=face, fill=fill, anchor=anchor)


def drawable(words: str) -> str:
    """The words in the characters that the typeface has: accents dropped, signs spelled out.

    Parameters
    ----------
    words : str
        Any text.

    Returns
    -------
    str
        The same; ``?`` for what has no spelling here.

    Examples
    --------
    >>> drawable("Dörries: σ ≤ ½·10⁻¹ m")
    'Dorries: sigma <= 1/2·10^-1 m'
    """
    plain = unicodedata.normalize("NFKD", words.translate(_SIGNS))
    kept = (c for c in plain if not unicodedata.combining(c))
    return "".join(c if c.isascii() or c in _DRAWN else "?" for c in kept)


def canvas(width: int, height: int, color: tuple[int, int, int] = PAPER) -> Image:
    """An empty picture.

    Parameters
    ----------
    width, height : int
        Its size [px].
    color : tuple of 3 ints
        What it is filled with, 0 to 255.

    Returns
    -------
    PIL.Image.Image
        RGB, 8 bits.

    Examples
    --------
    >>> canvas(4, 3).size
    (4, 3)
    """
    from PIL import Image

    return Image.new("RGB", (int(width), int(height)), color)


def scaled(colours: Bytes, width: int, height: int) -> Image:
    """Texels as squares: enlarged by a whole factor, or averaged down, to fit a box.

    Parameters
    ----------
    colours : ndarray of uint8, shape (rows, columns, 3)
        One texel each.
    width, height : int
        The box [px].

    Returns
    -------
    PIL.Image.Image
        At most as large as the box, unless that has no room for a pixel.

    Examples
    --------
    >>> scaled(np.zeros((2, 3, 3), np.uint8), 10, 10).size
    (9, 6)
    """
    from PIL import Image

    rows, columns = colours.shape[:2]
    image = Image.fromarray(np.ascontiguousarray(colours))
    if rows <= height and columns <= width:
        factor = max(1, min(width // columns, height // rows))
        return image.resize((columns * factor, rows * factor), Image.Resampling.NEAREST)
    share = min(width / columns, height / rows)
    return image.resize((max(1, round(columns * share)), max(1, round(rows * share))), Image.Resampling.BOX)


def _resampled(colours: Bytes, width: int, height: int) -> Image:
    """An image resampled to fit a box, its proportions kept."""
    from PIL import Image

    rows, columns = colours.shape[:2]
    share = min(width / columns, height / rows)
    size = max(1, round(columns * share)), max(1, round(rows * share))
    return Image.fromarray(np.ascontiguousarray(colours)).resize(size, Image.Resampling.LANCZOS)


def _flat(values: Field) -> str:
    """The value of a constant array in words."""
    numbers = [float(v) for v in values.ravel()]
    if len(set(numbers)) == 1:
        return f"{numbers[0]:.6g}"
    return "(" + ", ".join(f"{v:.4g}" for v in numbers) + ")"


def swatch(values: Field, display: Display, width: int, height: int) -> Image:
    """An array of equal values as a flat patch that says them; coloured where the values are a colour.

    Parameters
    ----------
    values : ndarray, shape (C, ...)
        Channel first, C 1 or 3; the first texel's are shown.
    display : Display
        How values become colours.
    width, height : int
        Size of the patch [px].

    Returns
    -------
    PIL.Image.Image
        The patch.
    """
    values = values.reshape(values.shape[0], -1)[:, :1]
    red, green, blue = display.paint(values)[0].tolist()
    colour = (red, green, blue) if display.kind in ("radiance", "reflectance", "normal", "unit") else PANEL
    image = canvas(width, height, colour)
    ink = (20, 20, 20) if sum(colour) > 450 else INK
    write(image, (width / 2, height / 2 - 12), _flat(values), 18, ink, width - 8, "mm")
    write(image, (width / 2, height / 2 + 12), "everywhere", 15, ink, width - 8, "mm")
    return image


def image_panel(values: Field, display: Display, raster: tuple[int, int], width: int, height: int, *,
                exact: bool = True) -> Image:
    """An image array in a box; axes of length 1 are spread over the raster first.

    Parameters
    ----------
    values : ndarray, shape (C, h, w)
        Channel first; h and w the raster's or 1.
    display : Display
        How values become colours.
    raster : (int, int)
        Rows and columns of the whole.
    width, height : int
        The box [px].
    exact : bool
        Whether to enlarge by a whole factor only; else it is resampled to fill the box.

    Returns
    -------
    PIL.Image.Image
        The image.
    """
    rows, columns = values.shape[1:]
    shape = (rows if rows > 1 else raster[0], columns if columns > 1 else raster[1], 3)
    colours = np.broadcast_to(display.paint(values), shape)
    return scaled(colours, width, height) if exact else _resampled(colours, width, height)


def chosen_slices(values: Field, count: int) -> list[int]:
    """Choose slices of a volume to show: the first, the last, and the rest where it changes.

    Parameters
    ----------
    values : ndarray, shape (C, D, H, W)
        The volume.
    count : int
        How many slices there is room for.

    Returns
    -------
    list of int
        At most ``count`` indices, growing.

    Examples
    --------
    >>> chosen_slices(np.repeat([0.0, 1.0, 0.0], [20, 4, 40]).reshape(1, 64, 1, 1), 6)
    [0, 19, 21, 22, 24, 63]
    """
    depth = values.shape[1]
    if depth <= count:
        return list(range(depth))
    flat = values.reshape(values.shape[0], depth, -1)
    flat = tame(flat[:, :, :: max(1, flat.shape[2] // 4096)])
    step = np.abs(np.diff(flat, axis=1)).max(axis=(0, 2))
    changes = np.flatnonzero(step > 1e-3 * step.max())
    first, last = (int(changes[0]), int(changes[-1]) + 1) if changes.size else (0, depth - 1)
    inner = np.linspace(first, last, count - (first > 0) - (last < depth - 1))
    return sorted({0, depth - 1, *(round(k) for k in inner.tolist())})


def tame(values: Field) -> Field:
    """Values of which every difference is finite.

    Parameters
    ----------
    values : ndarray, any shape

    Returns
    -------
    ndarray, float64, of the same shape
        Within ±1e300; 0 for NaN.

    Examples
    --------
    >>> tame(np.array([np.nan, np.inf])).tolist()
    [0.0, 1e+300]
    """
    return np.clip(np.nan_to_num(np.asarray(values, np.float64), nan=0.0), -1e300, 1e300)


def tile_size(grid: Grid, target: int) -> tuple[int, int]:
    """The size of a slice's picture, a whole factor of the grid's where that is enlarged.

    Parameters
    ----------
    grid : Grid
        Its width and height.
    target : int
        About how large the longer side is to be [px].

    Returns
    -------
    width, height : int
        In pixels.

    Examples
    --------
    >>> tile_size(Grid(width=160, height=90), 180), tile_size(Grid(width=32, height=18), 180)
    ((160, 90), (192, 108))
    """
    if max(grid.width, grid.height) > 1.5 * target:
        share = target / max(grid.width, grid.height)
        return max(1, round(grid.width * share)), max(1, round(grid.height * share))
    factor = max(1, min(round(target / grid.width), round(target / grid.height)))
    return grid.width * factor, grid.height * factor


def slices_panel(values: Field, display: Display, view: View, shape: tuple[int, int], *,
                 at_boundary: bool, target: int, gap: int = 6) -> Image:
    """Slices of a volume side by side, each with its depth in metres.

    Parameters
    ----------
    values : ndarray, shape (C, D, H, W)
        Channel first, axes of length 1 where it does not vary.
    display : Display
        How values become colours.
    view : View
        The frame.
    shape : tuple of 2 ints
        The most rows and columns of tiles.
    at_boundary : bool
        Whether slice k holds what is at its far boundary, k + 1, rather than at its middle.
    target : int
        As for `tile_size`.
    gap : int
        Between tiles [px].

    Returns
    -------
    PIL.Image.Image
        The tiles on `PAPER`.
    """
    grid, (rows, columns) = view.grid, shape
    picked = chosen_slices(values, rows * columns)
    columns = min(columns, len(picked))
    rows = -(-len(picked) // columns)
    tile_width, tile_height = tile_size(grid, target)
    cell, line = max(tile_width, 64), 24  # the label below a tile needs its room
    image = canvas(columns * (cell + gap) - gap, rows * (tile_height + line + gap) - gap)
    for number, k in enumerate(picked):
        x, y = (number % columns) * (cell + gap), (number // columns) * (tile_height + line + gap)
        block = np.broadcast_to(values[:, k], (values.shape[0], grid.height, grid.width))
        image.paste(scaled(display.paint(block), tile_width, tile_height), (x, y))
        write(image, (x, y + tile_height + 3), _depth_words(k, values, view, at_boundary), 17, FAINT, cell)
    return image


def _depth_words(k: int, values: Field, view: View, at_boundary: bool) -> str:
    if values.shape[1] == 1:
        return "every slice"
    z = float(np.asarray(slice_to_depth(np.float64(k + 1 if at_boundary else k + 0.5), view.grid)))
    return f"{'to ' if at_boundary else ''}{z:.3g} m"


def plan_panel(values: Field, display: Display, view: View, width: int, height: int) -> Image:
    """The volume seen from above, to scale: the plane of view space through the image's middle row.

    Parameters
    ----------
    values : ndarray, shape (C, D, H, W)
        Channel first, axes of length 1 where it does not vary.
    display : Display
        How values become colours.
    view : View
        The frame.
    width, height : int
        The box [px].

    Returns
    -------
    PIL.Image.Image
        The camera is at the bottom, in the middle; outside the grid is `PANEL`.
    """
    from PIL import Image

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
    write(image, (6, image.height - 46), "middle row from", 17, FAINT, 150)
    write(image, (6, image.height - 24), f"above, {grid.far:.4g} m", 17, FAINT, 150)
    return image
