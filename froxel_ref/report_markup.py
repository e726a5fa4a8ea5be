"""Words, numbers, tables and drawings of a report as HTML."""

from __future__ import annotations

import html
import math
import shlex
from collections.abc import Iterable, Mapping, Sequence

from froxel_ref.report_numbers import number
from froxel_ref.report_plots import Drawing
from froxel_ref.report_record import Point, Report

__all__ = [
    "MEMBERS", "base_of", "by", "cell", "drawn", "factor", "failed", "find", "grouped", "least", "link", "long_time",
    "many", "num", "ratio", "safe", "sets", "table", "why",
]

# What is said of the members of a front.
MEMBERS = {"certain": "on the front", "possible": "perhaps on the front", "dominated": "another is better",
           "failed": "failed"}


def safe(words: str) -> str:
    """Words as text of HTML, quotes too.

    Parameters
    ----------
    words : str

    Returns
    -------
    str

    Examples
    --------
    >>> safe("a < b")
    'a &lt; b'
    """
    return html.escape(words, quote=True)


def num(text: str, unit: str = "") -> str:
    """A number and its unit that no line breaks.

    Parameters
    ----------
    text : str
        HTML.
    unit : str

    Returns
    -------
    str
        HTML.

    Examples
    --------
    >>> num("16.7", "ms")
    '<span class="num">16.7\u202fms</span>'
    """
    return f'<span class="num">{text}{chr(0x202f) + unit if unit else ""}</span>'


def grouped(number_of: int) -> str:
    """A whole number with its thousands apart.

    Parameters
    ----------
    number_of : int

    Returns
    -------
    str

    Examples
    --------
    >>> grouped(32400)
    '32\u202f400'
    """
    return f"{number_of:,}".replace(",", "\u202f")


def long_time(seconds: float) -> str:
    """A time in seconds, minutes or hours, as HTML.

    Parameters
    ----------
    seconds : float [s]

    Returns
    -------
    str
        HTML.

    Examples
    --------
    >>> long_time(600.0)
    '<span class="num">10\u202fmin</span>'
    """
    if not math.isfinite(seconds) or seconds < 60.0:
        return num(number(seconds), "s")
    minutes = seconds / 60.0
    return num(f"{minutes:.0f}", "min") if minutes < 90.0 else num(f"{minutes / 60.0:.1f}", "h")


def many(count: int, one: str, more: str = "") -> str:
    """A count and what is counted.

    Parameters
    ----------
    count : int
    one : str
        A single one.
    more : str
        Several. Default: with an s.

    Returns
    -------
    str

    Examples
    --------
    >>> many(1, "run"), many(3, "run")
    ('1 run', '3 runs')
    """
    return f"{count} {one if count == 1 else more or one + 's'}"


def by(size: Iterable[int]) -> str:
    """A size as 160×90.

    Parameters
    ----------
    size : iterable of int

    Returns
    -------
    str

    Examples
    --------
    >>> by((160, 90))
    '160×90'
    """
    return "×".join(map(str, size))


def factor(value: float) -> str:
    """How many times as much.

    Parameters
    ----------
    value : float [1]

    Returns
    -------
    str

    Examples
    --------
    >>> factor(2.0), factor(float("nan"))
    ('2.00×', '–')
    """
    return f"{number(value)}×" if math.isfinite(value) else "–"


def ratio(a: float, b: float) -> float:
    """One over another, where that is more than nothing.

    Parameters
    ----------
    a, b : float

    Returns
    -------
    float
        NaN otherwise.

    Examples
    --------
    >>> ratio(1.0, 2.0), ratio(1.0, 0.0)
    (0.5, nan)
    """
    return a / b if b > 0.0 else math.nan


def sets(overrides: Iterable[str]) -> str:
    """Overrides as arguments of a command line.

    Parameters
    ----------
    overrides : iterable of str

    Returns
    -------
    str

    Examples
    --------
    >>> sets(["grid.depth=32", "name=a b"])
    "--set grid.depth=32 --set 'name=a b'"
    """
    return " ".join(f"--set {shlex.quote(change)}" for change in overrides)


def base_of(report: Report) -> Point | None:
    """The point that all others start from.

    Parameters
    ----------
    report : Report

    Returns
    -------
    Point or None
    """
    return next((point for point in report.points if point.knob == "base"), None)


def find(report: Report, name: str | None) -> tuple[int, Point] | None:
    """A point by its id.

    Parameters
    ----------
    report : Report
    name : str or None

    Returns
    -------
    tuple of int and Point, or None
        Its index too; None if there is no such point.
    """
    return next(((i, point) for i, point in enumerate(report.points) if point.id == name), None)


def least(point: Point | None) -> float:
    """The least time of a point.

    Parameters
    ----------
    point : Point or None

    Returns
    -------
    float [s]
        NaN where there is none.
    """
    return math.nan if point is None or point.seconds is None else point.seconds.least


def failed(point: Point) -> bool:
    """Whether a point has no error or no time.

    Parameters
    ----------
    point : Point

    Returns
    -------
    bool
    """
    return point.member == "failed" or not math.isfinite(point.errors.relmse) or point.seconds is None


def why(point: Point) -> str:
    """Why a point failed.

    Parameters
    ----------
    point : Point

    Returns
    -------
    str
    """
    return point.fault or point.errors.fault or "no reason given"


def link(report: Report, name: str | None) -> str:
    """A link to a point's row, which marks it.

    Parameters
    ----------
    report : Report
    name : str or None
        Id of the point.

    Returns
    -------
    str
        HTML: the name alone if there is no such point, – without one.
    """
    found = find(report, name)
    if found is None:
        return safe(name) if name else "–"
    return f'<a href="#point-{found[0]}" data-p="{found[0]}">{safe(found[1].id)}</a>'


def drawn(name: str, words: str, drawings: Mapping[str, Drawing]) -> str:
    """A plot for wide screens and for phones, and what is said beneath.

    Parameters
    ----------
    name : str
        Of the plot.
    words : str
        HTML.
    drawings : mapping of str to Drawing

    Returns
    -------
    str
        HTML; nothing if it was not drawn.
    """
    if name not in drawings:
        return ""
    plot = drawings[name]
    return (f'<figure id="plot-{name}"><div class="art wide">{plot.wide}</div><div class="art narrow">{plot.narrow}'
            f"</div><figcaption>{words}</figcaption></figure>")


def table(heads: Sequence[tuple[str, str, str]], rows: str, kind: str, *, tall: bool = False, label: str = "",
          sortable: bool = False, foot: str = "") -> str:
    """A table that scrolls within itself.

    Parameters
    ----------
    heads : sequence of (str, str, str)
        Words as HTML, an explanation, and classes of which the first is n for numbers or w for words.
    rows : str
        HTML.
    kind : str
        Its class.
    tall : bool
        Whether it scrolls upwards too.
    label : str
        What those hear who do not see it.
    sortable : bool
        Whether heads are buttons that sort it.
    foot : str
        A last row, as HTML.

    Returns
    -------
    str
        HTML.
    """
    cells = "".join(
        f'<th scope="col" class="{marks}" data-k="{marks[0]}" title="{safe(about)}">'
        + (f'<button type="button">{head}</button>' if sortable else head) + "</th>" for head, about, marks in heads)
    return (f'<div class="scroll{" tall" if tall else ""}" tabindex="0" role="region" aria-label="{safe(label)}">'
            f'<table class="{kind}"><thead><tr>{cells}</tr></thead><tbody>{rows}</tbody>'
            + (f"<tfoot>{foot}</tfoot>" if foot else "") + "</table></div>")


def cell(value: float | None, text: str) -> str:
    """A cell with a number, and what it is sorted by.

    Parameters
    ----------
    value : float or None
    text : str
        HTML.

    Returns
    -------
    str
        HTML.

    Examples
    --------
    >>> cell(0.5, "50 %"), cell(None, "–")
    ('<td class="n" data-v="0.5">50 %</td>', '<td class="n" data-v="">–</td>')
    """
    key = "" if value is None or math.isnan(value) else "Infinity" if value == math.inf else repr(float(value))
    return f'<td class="n" data-v="{key}">{text}</td>'
