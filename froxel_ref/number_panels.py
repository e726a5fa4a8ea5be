"""Panels of numbers: tables, curves, and the legend that says what colours mean."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from froxel_ref.arrays import Field
from froxel_ref.display import NOTHING, Display, grey, ramp_colours
from froxel_ref.panels import FAINT, INK, PANEL, canvas, tame, write

if TYPE_CHECKING:
    from PIL.Image import Image

__all__ = ["curve_panel", "legend", "table_panel"]


def table_panel(values: Field, width: int, *, rows: int = 12) -> Image:
    """Numbers as text, a line for each entry of the first axes.

    Parameters
    ----------
    values : ndarray, shape (m,), (m, faces, n) or (m, faces, 3, 4)
        Indices, or numbers of a face, of which each is a line.
    width : int
        The most that the panel may take [px].
    rows : int
        The most lines.

    Returns
    -------
    PIL.Image.Image
        The panel; says how many lines it left out.
    """
    lines = [f"{k}:  {value:.0f}" for k, value in enumerate(values.tolist())] if values.ndim == 1 else [
        f"map {k}, face {face}:   " + "   |   ".join("  ".join(_plain(v, numbers) for v in row)
                                                     for row in np.atleast_2d(numbers))
        for k, light in enumerate(values) for face, numbers in enumerate(light)]
    shown = lines[:rows] + ([f"and {len(lines) - rows} more"] if len(lines) > rows else [])
    image = canvas(min(width, 220 if values.ndim == 1 else 1100), 20 * len(shown) + 12, PANEL)
    for k, line in enumerate(shown):
        write(image, (8, 6 + 20 * k), line, 15, INK, image.width - 16)
    return image


def _plain(value: float, others: Field) -> str:
    """A number, what is nothing beside the others as 0."""
    return "0" if abs(value) <= 1e-12 * float(np.abs(others).max()) else f"{value:.6g}"


def curve_panel(values: Field, width: int, height: int, label: str = "slice") -> Image:
    """A one-dimensional array as a curve over its index.

    Parameters
    ----------
    values : ndarray, shape (C, n) or (C, D, 1, 1)
        One curve for each channel.
    width, height : int
        Size of the picture [px].
    label : str
        What the index counts.

    Returns
    -------
    PIL.Image.Image
        The curves, with the range beside them.
    """
    from PIL import ImageDraw

    image = canvas(width, height, PANEL)
    line = tame(values.reshape(values.shape[0], -1))
    left, right, top, bottom = 64, width - 14, 12, height - 26
    low, high = float(min(0.0, line.min())), float(line.max()) or 1.0
    draw = ImageDraw.Draw(image)
    for share in (0.0, 0.5, 1.0):
        y = bottom - share * (bottom - top)
        draw.line([(left, y), (right, y)], fill=NOTHING)
        write(image, (left - 6, y), f"{low + share * (high - low):.3g}", 14, FAINT, anchor="rm")
    colours = [INK] if len(line) == 1 else [(255, 110, 100), (110, 220, 120), (110, 160, 255)]
    for channel, colour in zip(line, colours[:len(line)], strict=True):
        xs = left + (right - left) * (np.arange(len(channel)) + 0.5) / len(channel)
        ys = bottom - (channel - low) / (high - low) * (bottom - top)
        points = list(zip(xs.tolist(), ys.tolist(), strict=True))
        draw.line(points if len(points) > 1 else points * 2, fill=colour, width=2)
    last = f"{label} 0 to {line.shape[1] - 1}"
    write(image, ((left + right) / 2, height - 6), last, 14, FAINT, anchor="mb")
    return image


def legend(display: Display, width: int, *, plain: bool = False) -> Image:
    """The range of the values in words, with the ramp beside it where there is one.

    Parameters
    ----------
    display : Display
        How values become colours.
    width : int
        Of the picture [px].
    plain : bool
        Whether to give the range alone.

    Returns
    -------
    PIL.Image.Image
        A line, 26 pixels high.
    """
    from PIL import Image

    image, x = canvas(width, 26), 0
    if not plain and display.kind not in ("radiance", "normal"):
        bar_width = min(100, width // 4)
        # A bar of colours shows what becomes of greys: all channels alike.
        share, low = np.linspace(0.0, 1.0, bar_width), 0.0 if display.kind == "colour" else display.low
        if display.kind == "unit":
            bar = grey(np.broadcast_to(share, (1, 14, bar_width)))
        elif display.kind in ("scalar", "depth", "span"):
            bar = np.broadcast_to(ramp_colours(share), (14, bar_width, 3))
        elif display.kind == "signed":
            bar = display.paint(np.broadcast_to(low * (1.0 - share) + display.high * share, (1, 14, bar_width)))
        else:
            bar = display.paint(np.broadcast_to(low * (1.0 - share) + display.high * share, (3, 14, bar_width)))
        image.paste(Image.fromarray(np.ascontiguousarray(bar)), (0, 6))
        x = bar_width + 8
    words = f"{display.low:.4g} to {display.high:.4g}" if plain else display.label()
    write(image, (x, 2), words, 18, FAINT, width - x)
    return image
