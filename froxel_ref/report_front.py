"""Where a point of a report stands between error and time, and the front of both."""

from __future__ import annotations

import math
from collections.abc import Sequence

from froxel_ref.pareto import front
from froxel_ref.report_record import Point

__all__ = ["called", "error_of", "front_of", "placed", "times_of"]


def front_of(points: Sequence[Point], norm: str = "relmse") -> dict[int, str]:
    """The members of the front of time and an error.

    Parameters
    ----------
    points : sequence of Point
    norm : str
        "relmse" takes the members that the report has; another one ("flip") has those of `froxel_ref.pareto.front`.

    Returns
    -------
    dict of int to str
        "certain" or "possible" by the index of the point, in order of the least time.

    Examples
    --------
    >>> from froxel_ref.report_record import Errors, Spread
    >>> def point(flip, least, median):
    ...     errors = Errors(0.1, 0.0, 0.0, 0.0, flip)
    ...     return Point("", "", "", (), 1, errors, Spread(least, median, 3), {}, None, "dominated")
    >>> front_of([point(0.1, 2.0, 2.5), point(0.2, 1.9, 2.1), point(0.2, 3.0, 3.5)], "flip")
    {1: 'possible', 0: 'certain'}
    """
    if norm == "relmse":
        found = {i: p.member for i, p in enumerate(points) if p.member in ("certain", "possible") and placed(p, norm)}
    else:
        use = [i for i, p in enumerate(points) if p.member != "failed" and placed(p, norm)]
        low, high = zip(*(times_of(points[i]) for i in use), strict=True) if use else ((), ())
        members = front([error_of(points[i], norm) for i in use], low, high).membership if use else ()
        found = {i: member for i, member in zip(use, members, strict=True) if member in ("certain", "possible")}
    return dict(sorted(found.items(), key=lambda item: times_of(points[item[0]])[0]))


def error_of(point: Point, norm: str = "relmse") -> float:
    """An error of a point.

    Parameters
    ----------
    point : Point
    norm : str
        A field of its errors, "relmse" or "flip".

    Returns
    -------
    float [1]
        NaN where it has none.

    Examples
    --------
    >>> from froxel_ref.report_record import Errors
    >>> point = Point("", "", "", (), 1, Errors(0.1, 0.0, 0.0, 0.0), None, {}, None, "failed")
    >>> error_of(point), error_of(point, "flip")
    (0.1, nan)
    """
    value = getattr(point.errors, norm)
    return math.nan if value is None else float(value)


def times_of(point: Point) -> tuple[float, float]:
    """Both ends of the bar of a point's time.

    Parameters
    ----------
    point : Point

    Returns
    -------
    least, end : float [s]
        NaN where it has no time that can be drawn.

    Examples
    --------
    >>> from froxel_ref.report_record import Errors, Spread
    >>> point = Point("", "", "", (), 1, Errors(0.1, 0.0, 0.0, 0.0), Spread(2.0, 2.5, 3), {}, None, "certain")
    >>> times_of(point), times_of(point._replace(seconds=None))
    ((2.0, 2.5), (nan, nan))
    """
    if point.seconds is None or not point.seconds.least > 0.0 or not math.isfinite(point.seconds.end):
        return math.nan, math.nan
    return float(point.seconds.least), float(max(point.seconds.end, point.seconds.least))


def placed(point: Point, norm: str = "relmse") -> bool:
    """Whether a point has a place between the axes; an error of 0 has one, on a line of its own.

    Parameters
    ----------
    point : Point
    norm : str
        As for `error_of`.

    Returns
    -------
    bool

    Examples
    --------
    >>> from froxel_ref.report_record import Errors, Spread
    >>> point = Point("", "", "", (), 1, Errors(0.0, 0.0, 0.0, 0.0), Spread(2.0, 2.5, 3), {}, None, "certain")
    >>> placed(point), placed(point, "flip"), placed(point._replace(seconds=None))
    (True, False, False)
    """
    error = error_of(point, norm)
    return math.isfinite(error) and error >= 0.0 and math.isfinite(times_of(point)[0])


def called(point: Point) -> str:
    """What a point is called in plots: by its id, but for the base.

    Parameters
    ----------
    point : Point

    Returns
    -------
    str

    Examples
    --------
    >>> from froxel_ref.report_record import Errors
    >>> called(Point("slices=32", "slices", "32", (), 1, Errors(0.1, 0.0, 0.0, 0.0), None, {}, None, "failed"))
    'slices=32'
    """
    return "base" if point.knob == "base" else point.id
