"""Pictures of a converged image: its error estimate, and how far the frame of the same scene is from it."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from froxel_ref.display import NOTHING, Bytes, ramp_colours
from froxel_ref.panels import FAINT, INK, View, canvas, scaled, write
from froxel_ref.pictures import final_image
from froxel_ref.truth_image import TruthImage

if TYPE_CHECKING:
    from PIL.Image import Image

__all__ = ["Difference", "difference", "error_picture", "overview", "relative_error"]

Array: TypeAlias = NDArray[np.floating[Any]]

MARGIN, GAP, BOX, HEAD, FOOT = 32, 28, (760, 760), 52, 62
DIM = 0.17  # place on the ramp where a scale begins: to be seen on the page
DECADES = 8  # the most that a scale spans
UNCONVERGED = (240, 70, 70)


class Difference(NamedTuple):
    """A frame against the truth.

    Attributes
    ----------
    relative : ndarray, shape (h, w) [1]
        Largest difference of a channel over the truth's brightest channel; infinite where that is black.
    median : float [1]
        Of the relative differences.
    rms : float [1]
        Root mean square difference over the mean radiance: what the brightest few pixels make of it.
    worst : float [1]
        The largest finite relative difference.
    pixel : tuple of int
        Where that is: column and row, from the top left.
    """

    relative: Array
    median: float
    rms: float
    worst: float
    pixel: tuple[int, int]


def _over(part: Array, whole: Array) -> Array:
    """Share of the brightest channel, pixel by pixel."""
    most, size = np.abs(part).max(axis=0), whole.max(axis=0)
    share = np.where(most > 0.0, np.inf, 0.0)
    with np.errstate(over="ignore"):
        np.divide(most, size, out=share, where=size > 0.0)
    return share


def difference(radiance: Array, truth: Array) -> Difference:
    """How far an image is from the truth.

    Parameters
    ----------
    radiance, truth : ndarray, shape (3, h, w) [W m⁻² sr⁻¹]

    Returns
    -------
    Difference

    Examples
    --------
    >>> found = difference(np.full((3, 1, 2), 2.0), np.array([[[1.0, 2.0]]] * 3))
    >>> found.worst, found.pixel, round(found.rms, 4)
    (1.0, (0, 0), 0.4714)
    """
    away = radiance.astype(np.float64) - truth
    relative, mean = _over(away, truth), float(truth.mean())
    finite = np.where(np.isfinite(relative), relative, -1.0)
    row, column = np.unravel_index(int(np.argmax(finite)), finite.shape)
    with np.errstate(over="ignore"):
        rms = math.sqrt(float((away * away).mean()))
    share = rms / mean if mean > 0.0 else (math.inf if rms else 0.0)
    return Difference(relative, float(np.quantile(relative, 0.5, method="lower")), share,
                      max(0.0, float(finite[row, column])), (int(column), int(row)))


def relative_error(image: TruthImage) -> Array:
    """The estimated error as a share of the pixel's radiance, shape (h, w)."""
    return _over(image.error, image.radiance)


# --- scales -----------------------------------------------------------------------------------------


def _range(values: Array) -> tuple[int, int]:
    """The decades that a scale spans, as exponents: down from the largest value, eight at most."""
    shown = values[np.isfinite(values) & (values > 0.0)]
    if not shown.size:
        return -1, 0
    high = math.ceil(math.log10(float(shown.max())) - 1e-9)
    low = max(high - DECADES, math.floor(math.log10(float(shown.min()))))
    return min(low, high - 1), high


def _painted(values: Array, low: int, high: int) -> Bytes:
    with np.errstate(divide="ignore"):
        place = (np.log10(np.maximum(values, 0.0)) - low) / (high - low)
    return ramp_colours(DIM + (1.0 - DIM) * np.clip(place, 0.0, 1.0))


def _scale(low: int, high: int, width: int) -> Image:
    """A bar with its decades; the lowest colour stands for all below, exact zeros among them."""
    from PIL import Image

    image = canvas(width, 36)
    bar = np.broadcast_to(_painted(np.logspace(low, high, width - 40), low, high)[None], (12, width - 40, 3))
    image.paste(Image.fromarray(np.ascontiguousarray(bar)), (20, 0))
    step = max(1, math.ceil((high - low) / max(1, (width - 40) // 60)))
    for decade in range(high, low - 1, -step):
        at = 20 + (decade - low) / (high - low) * (width - 41)
        words = f"{10.0**decade:g}" if 0 <= decade < 4 else f"1e{decade}"
        write(image, (at, 15), words, 14, FAINT, anchor="ma")
    return image


def _cell(picture: Bytes, title: str, words: str, scale: tuple[int, int] | None = None) -> Image:
    """A picture with a title, a line below it, and its scale; small ones enlarged by a whole factor."""
    body = scaled(picture, *BOX)
    width = max(body.width, 520)
    cell = canvas(width, HEAD + body.height + (FOOT if scale else 10))
    write(cell, (0, 0), title, 20, INK, width)
    write(cell, (0, 27), words, 15, FAINT, width)
    cell.paste(body, (0, HEAD))
    if scale:
        cell.paste(_scale(*scale, max(body.width, 300)), (0, HEAD + body.height + 12))
    return cell


def _error_cell(image: TruthImage) -> Image:
    values = relative_error(image)
    scale = _range(values)
    colours = _painted(values, *scale)
    rows, columns = np.indices(values.shape)
    # Two colours in turn: no error has them, and not all of the value is hidden behind them.
    colours[~image.converged & ((rows + columns) % 2 == 0)] = UNCONVERGED
    colours[~image.converged & ((rows + columns) % 2 == 1)] = NOTHING
    missed = int((~image.converged).sum())
    words = f"{missed} of {values.size} pixels did not converge: red and grey" if missed else (
        f"all {values.size} pixels converged")
    largest = float(np.max(values, where=np.isfinite(values), initial=0.0))
    return _cell(colours, f"estimated error / radiance: at most {largest:.2g}", words, scale)


# --- pages ------------------------------------------------------------------------------------------


def error_picture(image: TruthImage) -> Bytes:
    """The error estimate over the radiance, logarithmic, with its scale.

    Parameters
    ----------
    image : TruthImage

    Returns
    -------
    ndarray of uint8, shape (height, width, 3)
        Pixels that did not converge are red and grey in turn.
    """
    cell = _error_cell(image)
    page = canvas(cell.width + 2 * MARGIN, cell.height + 2 * MARGIN)
    page.paste(cell, (MARGIN, MARGIN))
    return np.asarray(page)


def overview(image: TruthImage, frame: Array, view: View, *, title: str, facts: str, frame_facts: str) -> Bytes:
    """Truth and frame side by side, their difference, and the truth's own error.

    Parameters
    ----------
    image : TruthImage
    frame : ndarray, shape (3, h, w) [W m⁻² sr⁻¹]
        Of the same scene.
    view : View
        Camera, grid and exposure.
    title, facts, frame_facts : str
        The scene's name; how the truth and the frame were made.

    Returns
    -------
    ndarray of uint8, shape (height, width, 3)
    """
    found = difference(frame, image.radiance)
    scale = _range(found.relative)
    away = (f"median {found.median:.2g}; worst {found.worst:.2g} at pixel x {found.pixel[0]}, y {found.pixel[1]}; "
            f"RMS {found.rms:.2g} of the mean radiance")
    cells = [_cell(final_image(image.radiance, view), "truth", facts),
             _cell(final_image(frame, view), "frame", frame_facts),
             _cell(_painted(found.relative, *scale), "|frame - truth| / truth", away, scale), _error_cell(image)]
    wide = [max(cells[i].width for i in (c, c + 2)) for c in (0, 1)]
    tall = [max(cells[i].height for i in (r, r + 1)) for r in (0, 2)]
    page = canvas(2 * MARGIN + sum(wide) + GAP, 2 * MARGIN + 60 + sum(tall) + GAP)
    write(page, (MARGIN, MARGIN - 6), title, 32, INK, page.width - 2 * MARGIN)
    for number, cell in enumerate(cells):
        page.paste(cell, (MARGIN + number % 2 * (wide[0] + GAP), MARGIN + 60 + number // 2 * (tall[0] + GAP)))
    return np.asarray(page)
