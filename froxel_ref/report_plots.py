"""Plots of a report: error against time, the budget, refinement, stages, and what leaving out saves.

Every plot is drawn by Matplotlib (extra ``report``), once for a width: as a PNG file in light colours, or as SVG whose
text is text and whose colours are CSS variables, so that a page shows it by light and by dark.
"""

from __future__ import annotations

import html
import importlib.util
import io
import re
from typing import TYPE_CHECKING, NamedTuple

from froxel_ref.records import InputError
from froxel_ref.report_bars import figure_budget, figure_planned, figure_stages
from froxel_ref.report_front import called, times_of
from froxel_ref.report_numbers import milliseconds, number
from froxel_ref.report_orders import figure_refinement
from froxel_ref.report_record import Point, Report
from froxel_ref.report_scatter import figure_error
from froxel_ref.report_sheet import NARROW, THEME, WIDE, plain_settings

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = [
    "Drawing", "drawings", "figure_budget", "figure_error", "figure_planned", "figure_refinement", "figure_stages",
    "pictures", "plots_available", "png", "point_words", "svg",
]

PICTURE_WIDTH = 1600  # of a PNG file [px]


def plots_available() -> bool:
    """Whether Matplotlib is there to draw.

    Returns
    -------
    bool

    Examples
    --------
    >>> plots_available() in (True, False)
    True
    """
    return importlib.util.find_spec("matplotlib") is not None


class Drawing(NamedTuple):
    """A plot as two pieces of SVG, to stand in a page."""

    wide: str
    narrow: str


def _flip(report: Report, width: float) -> Figure | None:
    """Error against time, by FLIP."""
    return figure_error(report, width, norm="flip")


FIGURES = {"error-against-time": figure_error, "flip-against-time": _flip, "budget": figure_budget,
           "refinement": figure_refinement, "stages": figure_stages, "planned": figure_planned}


def pictures(report: Report) -> dict[str, bytes]:
    """All plots as PNG files, 1600 px wide, in light colours.

    Parameters
    ----------
    report : Report

    Returns
    -------
    dict of str to bytes
        By the file's name. What the report has nothing for is not there. The same report gives the same bytes.

    Raises
    ------
    InputError
        Matplotlib is missing.
    """
    return {f"{name}.png": png(figure) for name, figure in _figures(report, WIDE).items()}


def drawings(report: Report) -> dict[str, Drawing]:
    """All plots as SVG for a page, for wide screens and for phones.

    Parameters
    ----------
    report : Report

    Returns
    -------
    dict of str to Drawing
        By the plot's name. Colours are the CSS variables ``--p-NAME`` of `THEME`; what belongs to point i of the
        report has ``data-p="i"``, and its marker has the class ``pt``.

    Raises
    ------
    InputError
        Matplotlib is missing.
    """
    wide, narrow = _figures(report, WIDE), _figures(report, NARROW)
    return {name: Drawing(svg(wide[name], report, f"{name}-w-"), svg(narrow[name], report, f"{name}-n-"))
            for name in wide}


def _figures(report: Report, width: float) -> dict[str, Figure]:
    """All plots that the report has something for, by name."""
    if not plots_available():
        raise InputError("plots", "matplotlib is missing; install froxel-ref[report]")
    drawn = {name: make(report, width) for name, make in FIGURES.items()}
    return {name: figure for name, figure in drawn.items() if figure is not None}


def png(figure: Figure) -> bytes:
    """A figure as a PNG file, 1600 px wide.

    Parameters
    ----------
    figure : Figure

    Returns
    -------
    bytes
    """
    file = io.BytesIO()
    with plain_settings():
        figure.savefig(file, format="png", dpi=PICTURE_WIDTH / figure.get_size_inches()[0], metadata={"Software": None})
    return file.getvalue()


def svg(figure: Figure, report: Report, prefix: str) -> str:
    """A figure as SVG to stand in a page.

    Parameters
    ----------
    figure : Figure
    report : Report
        That it is of.
    prefix : str
        Put before every id, so that many plots may stand in one page.

    Returns
    -------
    str
        One ``svg`` element that needs nothing from elsewhere.
    """
    file = io.StringIO()
    with plain_settings():
        figure.patch.set_visible(False)
        figure.savefig(file, format="svg", metadata=dict.fromkeys(("Date", "Creator", "Format", "Type")))
        figure.patch.set_visible(True)
    text = file.getvalue()
    text = text[text.index("<svg"):]
    text = re.sub(r"<metadata>.*?</metadata>|<!--.*?-->|<title>.*?</title>", "", text, flags=re.DOTALL)
    text = re.sub(r'<svg [^>]*?viewBox="([^"]*)"[^>]*>', r'<svg viewBox="\1">', text, count=1)
    text = re.sub(r"font-family: [^;\"]*;? ?", "", text)
    names = {light: f"var(--p-{name})" for name, (light, _) in THEME.items()}
    text = re.sub(r"#[0-9a-f]{6}\b", lambda found: names.get(found[0], found[0]), text)
    text = text.replace("xlink:href", "href")
    text = re.sub(r'id="([pblr])(\d+)"', lambda found: _tied(found[1], int(found[2]), report), text)
    text = re.sub(r'(?<= id=")|(?<=url\(#)|(?<=href="#)', prefix, text)
    return re.sub(r"\n\s*", "\n", text).strip()


def _tied(kind: str, index: int, report: Report) -> str:
    """What ties an element to a point: markers, which can have the focus, and bars, labels and rings."""
    if kind != "p":
        return f'class="of-{kind}" data-p="{index}"'
    words = html.escape(point_words(report.points[index]), quote=True)
    return f'class="pt" data-p="{index}" tabindex="-1" role="button" aria-label="{words}"'


def point_words(point: Point) -> str:
    """A point in one sentence, for those who hear it.

    Parameters
    ----------
    point : Point

    Returns
    -------
    str

    Examples
    --------
    >>> from froxel_ref.report_record import Errors
    >>> point_words(Point("slices=32", "slices", "32", (), 1, Errors(*[float("nan")] * 4), None, {}, None, "failed",
    ...                   "refused"))
    'slices=32: failed, refused'
    """
    if point.member == "failed":
        return f"{called(point)}: failed, {point.fault or point.errors.fault}"
    return f"{called(point)}: {milliseconds(times_of(point)[0])} ms, relMSE {number(point.errors.relmse)}"
