"""Pictures of where the error lies: truth, frame, their difference, and what each approximation adds to it."""

from __future__ import annotations

import io
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from froxel_ref import report_log
from froxel_ref.budget import added
from froxel_ref.display import Bytes, to_srgb8
from froxel_ref.panels import FAINT, INK, canvas, scaled, write
from froxel_ref.report_numbers import percent
from froxel_ref.report_points import BASE, EPSILON
from froxel_ref.report_record import Budget, Report

__all__ = ["SHEET", "Picture", "diverging", "error_pictures", "sheet", "sheet_png"]

Image = NDArray[np.float64]

SHEET = "errors.png"

MARGIN, GAP, BOX, HEAD = 28, 22, (448, 448), 50

# From too dark to too bright, through the paper of nothing: readable with any colour vision.
DARK, NEUTRAL, BRIGHT = (33.0, 102.0, 172.0), (247.0, 247.0, 247.0), (178.0, 24.0, 43.0)
NOTHING = (255, 0, 255)  # not a number
FULL = 0.25  # relative error of the strongest colours


class Picture(NamedTuple):
    """A small picture, with a title and a line."""

    title: str
    words: str
    pixels: Bytes

    @property
    def png(self) -> bytes:
        """As a file's content, a pixel a texel."""
        return _png(self.pixels)


def diverging(values: Image) -> Bytes:
    """Colours of signed values: −1 and less blue, 0 white, 1 and more red, what is not a number magenta.

    Parameters
    ----------
    values : ndarray, shape (h, w)

    Returns
    -------
    ndarray of uint8, shape (h, w, 3)

    Examples
    --------
    >>> diverging(np.array([[-1.0, 0.0, 2.0, np.nan]])).tolist()
    [[[33, 102, 172], [247, 247, 247], [178, 24, 43], [255, 0, 255]]]
    """
    known = np.isfinite(values)
    share = np.clip(np.where(known, values, 0.0), -1.0, 1.0)[..., np.newaxis]
    end = np.where(share < 0.0, DARK, BRIGHT)
    colours: Bytes = np.rint(np.asarray(NEUTRAL) + np.abs(share) * (end - np.asarray(NEUTRAL))).astype(np.uint8)
    colours[~known & ~np.isinf(values)] = NOTHING
    colours[np.isposinf(values)], colours[np.isneginf(values)] = BRIGHT, DARK
    return colours


def error_pictures(report: Report, folder: Path) -> list[Picture]:
    """What the images of a log show.

    Parameters
    ----------
    report : Report
    folder : Path
        With its log's images.

    Returns
    -------
    list of Picture
        Truth, the base's frame, its error, and what each part of the budget adds; fewer where images are missing.
    """
    shape = (3, report.setup.raster[1], report.setup.raster[0])
    truth, whole = (report_log.load_image(folder, name, shape) for name in ("reference", f"image {BASE}"))
    if truth is None or whole is None:
        return []
    weight = 1.0 / np.sqrt(truth * truth + EPSILON)

    def signed(image: Image) -> Bytes:
        return diverging(np.mean(image * weight, axis=0) / FULL)

    size = " x ".join(map(str, report.setup.raster))
    found = [Picture("truth", f"{size} pixels, converged", to_srgb8(truth)),
             Picture("frame", "the base's settings", to_srgb8(np.where(np.isfinite(whole), whole, 0.0))),
             Picture("error", f"relMSE {report.points[0].errors.relmse:.3g}", signed(whole - truth))]
    return found + (_parts(report.budget, folder, shape, whole, signed) if report.budget is not None else [])


def _parts(budget: Budget, folder: Path, shape: tuple[int, int, int], whole: Image,
           signed: Callable[[Image], Bytes]) -> list[Picture]:
    none = report_log.load_image(folder, "budget: none", shape)
    found = []
    for part in budget.parts:
        alone = report_log.load_image(folder, f"budget: {part.name} alone", shape)
        without = report_log.load_image(folder, f"budget: without {part.name}", shape)
        if without is None or none is None:
            continue
        first = {} if part.alone is None or alone is None else {part.name: alone}
        adds = added(part.name, whole=whole, none=none, alone=first, without={part.name: without})
        found.append(Picture(part.name, f"{percent(part.share)} of relMSE", signed(adds)))
    return found


def sheet_png(pictures: Sequence[Picture], *, title: str) -> bytes:
    """All pictures on one page, as a file's content."""
    return _png(sheet(pictures, title=title))


def _png(pixels: Bytes) -> bytes:
    from PIL import Image as Pillow

    held = io.BytesIO()
    Pillow.fromarray(pixels).save(held, "png", optimize=True)
    return held.getvalue()


def sheet(pictures: Sequence[Picture], *, title: str) -> Bytes:
    """All pictures on one page.

    Parameters
    ----------
    pictures : sequence of Picture
        Of one size.
    title : str

    Returns
    -------
    ndarray of uint8, shape (height, width, 3)
    """
    bodies = [scaled(picture.pixels, *BOX) for picture in pictures]
    wide, tall = max(body.width for body in bodies), max(body.height for body in bodies)
    rows = -(-len(bodies) // 3)
    page = canvas(2 * MARGIN + 3 * wide + 2 * GAP, 2 * MARGIN + 76 + rows * (HEAD + tall + GAP))
    write(page, (MARGIN, MARGIN - 6), title, 28, INK, page.width - 2 * MARGIN)
    write(page, (MARGIN, MARGIN + 34), f"errors over sqrt(truth^2 + {EPSILON:g}): blue too dark, red too bright, full "
                                       f"colour from {100.0 * FULL:g} % on", 16, FAINT, page.width - 2 * MARGIN)
    for number, (picture, body) in enumerate(zip(pictures, bodies, strict=True)):
        x = MARGIN + number % 3 * (wide + GAP)
        y = MARGIN + 76 + number // 3 * (HEAD + tall + GAP)
        write(page, (x, y), picture.title, 20, INK, wide)
        write(page, (x, y + 25), picture.words, 15, FAINT, wide)
        page.paste(body, (x, y + HEAD))
    return np.asarray(page)
