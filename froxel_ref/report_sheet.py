"""A sheet to draw a report's plots on, their colours by light and by dark, and their logarithmic scale.

Drawing is done by Matplotlib, in pixels from the upper left corner, of which there are 72 to an inch.
"""

from __future__ import annotations

import math
import re
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["NARROW", "SERIES", "THEME", "WIDE", "Log", "Sheet", "plain_settings"]

WIDE, NARROW = 820 / 72, 356 / 72  # widths [in]: from 700 px on, and on phones

# Colours by light and by dark. No two light ones are equal: SVG knows them by their value.
THEME: dict[str, tuple[str, str]] = {
    "paper": ("#fffffe", "#16181c"), "ink": ("#1b1d21", "#e8eaee"), "soft": ("#585f6a", "#a4aab4"),
    "grid": ("#e3e6ea", "#2c3037"), "lane": ("#f3f4f7", "#1e2126"), "edge": ("#9aa1ab", "#5d646f"),
    "front": ("#3a4049", "#c3c8d0"), "fail": ("#b3261e", "#ff8a80"),
    "s0": ("#0072b2", "#57b0f2"), "s1": ("#c24e00", "#ff9d57"), "s2": ("#007d5a", "#45cfa0"),
    "s3": ("#b0408c", "#ef8fd0"), "s4": ("#8a6700", "#e0c040"), "s5": ("#1787a8", "#74dcee"),
    "s6": ("#6a3fb5", "#b9a0fa"), "s7": ("#6b6f76", "#b6bac1")}
SERIES = tuple(name for name in THEME if re.fullmatch(r"s\d", name))


class Log(NamedTuple):
    """A logarithmic scale.

    Attributes
    ----------
    low, high : float
        Powers of ten that lie at its ends.
    start, end : float [px]
        Where these are.

    Examples
    --------
    >>> scale = Log(-1.0, 1.0, 0.0, 100.0)
    >>> scale.at(1.0), scale.at_power(0.5), scale.ticks(40.0)
    (50.0, 75.0, [0.1, 1.0, 10.0])
    """

    low: float
    high: float
    start: float
    end: float

    def at(self, value: float) -> float:
        """Where a positive value is [px]."""
        return self.at_power(math.log10(value))

    def at_power(self, power: float) -> float:
        """Where a power of ten is [px], by its exponent."""
        return self.start + (power - self.low) / (self.high - self.low) * (self.end - self.start)

    def ticks(self, apart: float) -> list[float]:
        """Powers of ten, or some multiples of them, at least so many pixels apart."""
        decade = abs(self.end - self.start) / (self.high - self.low)
        inside = range(max(-300, math.floor(self.low)), min(300, math.ceil(self.high)) + 1)
        if 0.125 * decade >= apart:
            values = [m * 10.0**k for k in inside for m in (1, 1.5, 2, 3, 5, 7)]
        elif 0.3 * decade >= apart:
            values = [m * 10.0**k for k in inside for m in (1, 2, 5)]
        elif 0.47 * decade >= apart:
            values = [m * 10.0**k for k in inside for m in (1, 3)]
        else:
            step = max(1, math.ceil(apart / decade))
            values = [10.0**k for k in inside if k % step == 0]
        return [value for value in values if self.low - 1e-9 <= math.log10(value) <= self.high + 1e-9]


class Sheet:
    """A figure in pixels, y downwards; its height is set at the end, by `finish`.

    Colours are names of `THEME`. An element with a ``gid`` of a letter and a number belongs to the point of that index:
    p its marker, b its bar, l its label, r its ring (`froxel_ref.report_plots.svg`).

    Parameters
    ----------
    width : float [in]

    Attributes
    ----------
    figure : matplotlib.figure.Figure
    width : float [px]
    narrow : bool
        Whether it is for a phone.
    size : float [px]
        Of its letters.
    """

    def __init__(self, width: float) -> None:
        from matplotlib.figure import Figure

        self.figure = Figure(figsize=(width, width))
        self.axes = self.figure.add_axes((0.0, 0.0, 1.0, 1.0))
        self.axes.set_axis_off()
        self.width = 72.0 * width
        self.narrow = self.width < 600.0
        self.size = 11.0 if self.narrow else 12.8

    def text(self, x: float, y: float, words: str, colour: str = "ink", anchor: str = "left", *, bold: bool = False,
             big: bool = False, gid: str | None = None) -> None:
        """Words in one line, whose middle is at y."""
        size = self.size * (1.15 if big else 1.0)
        self.axes.text(x, y + 0.36 * size, _one_line(words).replace("$", r"\$"), color=THEME[colour][0], fontsize=size,
                       ha=anchor, va="baseline", family="DejaVu Sans", weight="bold" if bold else "normal", gid=gid,
                       clip_on=False)

    def line(self, xs: Sequence[float], ys: Sequence[float], colour: str, width: float = 1.0, *, dash: bool = False,
             alpha: float = 1.0, gid: str | None = None, order: float = 2.0) -> None:
        """A line through places; one with a higher ``order`` lies above."""
        self.axes.plot(xs, ys, color=THEME[colour][0], linewidth=width, linestyle=(0, (4, 3)) if dash else "-",
                       alpha=alpha, gid=gid, zorder=order, clip_on=False, solid_capstyle="butt", marker="None")

    def box(self, x0: float, y0: float, x1: float, y1: float, colour: str, *, alpha: float = 1.0, order: float = 1.0,
            gid: str | None = None) -> None:
        """A filled rectangle between two corners."""
        from matplotlib.patches import Rectangle

        self.axes.add_patch(Rectangle((min(x0, x1), min(y0, y1)), abs(x1 - x0), abs(y1 - y0), linewidth=0.0,
                                      facecolor=THEME[colour][0], alpha=alpha, zorder=order, gid=gid, clip_on=False))

    def mark(self, x: float, y: float, shape: str, colour: str, size: float, *, fill: str | None = None,
             alpha: float = 1.0, width: float = 1.6, gid: str | None = None, order: float = 4.0) -> None:
        """A marker of Matplotlib's, its edge in a colour, filled with another, or not ("none")."""
        face = "none" if fill == "none" else THEME[fill or colour][0]
        self.axes.plot([x], [y], marker=shape, markersize=size, markerfacecolor=face, markeredgecolor=THEME[colour][0],
                       markeredgewidth=width, alpha=alpha, linestyle="None", gid=gid, zorder=order, clip_on=False)

    def long(self, words: str, bold: bool = False) -> float:
        """How wide words are [px]."""
        return _long(_one_line(words), self.size, bold)

    def cut(self, words: str, room: float) -> str:
        """Words that fit, with … where they had to be cut."""
        words = _one_line(words)
        if self.long(words) <= room:
            return words
        while len(words) > 1 and self.long(words + "…") > room:
            words = words[:-1]
        return words.rstrip() + "…"

    def finish(self, height: float) -> Figure:
        """The figure, of that height [px]."""
        self.figure.set_size_inches(self.width / 72.0, height / 72.0)
        self.axes.set_xlim(0.0, self.width)
        self.axes.set_ylim(height, 0.0)
        self.figure.patch.set_facecolor(THEME["paper"][0])
        return self.figure


def _one_line(words: str) -> str:
    """Without line breaks, and what no letter stands for."""
    return "".join(letter for letter in " ".join(words.split()) if letter.isprintable() or letter in "\u202f\u00a0")


def _long(words: str, size: float, bold: bool = False) -> float:
    """How wide words of that size are, in the unit of the size."""
    from matplotlib.font_manager import FontProperties
    from matplotlib.textpath import text_to_path

    font = FontProperties(family="DejaVu Sans", size=size, weight="bold" if bold else "normal")
    width, _, _ = text_to_path.get_text_width_height_descent(words, font, ismath=False)
    return float(width)


@contextmanager
def plain_settings() -> Iterator[None]:
    """Matplotlib as it comes, whatever the user's own settings; the same bytes for the same record.

    Yields
    ------
    None
        With these settings, which go at the end.
    """
    import matplotlib

    with matplotlib.rc_context(), warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Glyph .* missing")  # names may be in any script; browsers have it
        matplotlib.rcdefaults()
        matplotlib.rcParams.update({"svg.fonttype": "none", "svg.hashsalt": "froxel-ref", "path.simplify": False})
        yield
