"""What the report command writes: a record as JSON and CSV, the plots, and the page."""

from __future__ import annotations

import csv
import io
import json
import math
import shlex
import types
import typing
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from numbers import Integral, Real
from pathlib import Path
from typing import Any, NamedTuple

from froxel_ref.output import refusal, whole_file
from froxel_ref.records import InputError, Json, key_shown, shown, suggest
from froxel_ref.report_pictures import SHEET, Picture, sheet_png
from froxel_ref.report_record import Budget, Level, Point, Report

__all__ = [
    "BUDGET", "FORMAT", "JSON", "PAGE", "PICTURES", "POINTS", "REFINEMENT", "VERSION", "budget_csv", "points_csv",
    "refinement_csv", "report_from_json", "report_json", "write_report",
]

FORMAT, VERSION = "froxel-ref report", 1
JSON, PAGE, POINTS, BUDGET, REFINEMENT = "report.json", "index.html", "points.csv", "budget.csv", "refinement.csv"

# Every picture that there can be; what a report has nothing for is left out.
PICTURES = ("error-against-time.png", "flip-against-time.png", "budget.png", "refinement.png", "stages.png",
            "planned.png")


class Column(NamedTuple):
    """A column of a CSV file: its heading, with the unit; its path in the JSON; what it is; how it is taken."""

    heading: str
    path: str
    about: str
    take: Callable[[Any], Any]


def _errors(path: str, about: Mapping[str, str]) -> tuple[Column, ...]:
    def column(field: str, heading: str) -> Column:
        return Column(heading, f"{path}.errors.{field}", about[field], lambda row: getattr(row.errors, field))

    names = {"relmse": "relmse", "worst": "worst_pixel_share", "absolute": "mean_absolute", "bias": "bias",
             "quantile": "quantile_999", "maximum": "maximum", "flip": "flip",
             "fault": "error_fault"}
    return tuple(column(field, heading) for field, heading in names.items())


ERRORS = {
    "relmse": "mean of (a - b)^2/(b^2 + epsilon) of radiance times exposure, a measured, b the reference [1]",
    "worst": "the share of relMSE that a single pixel has [1]",
    "absolute": "mean of |a - b|, over the mean of b [1]",
    "bias": "mean of a - b, over the mean of b [1]",
    "quantile": "99.9th percentile of |a - b|, over the mean of b [1]",
    "maximum": "largest |a - b|, over the mean of b [1]",
    "flip": "mean HDR-FLIP [1]; empty (null in JSON) where it was not taken",
    "fault": "why there are no errors; all are nan then",
}

POINT_COLUMNS: tuple[Column, ...] = (
    Column("id", "points[].id", "unlike that of any other point", lambda p: p.id),
    Column("knob", "points[].knob", "what was turned; base: the settings that all others start from", lambda p: p.knob),
    Column("label", "points[].label", "what it was turned to", lambda p: p.label),
    Column("overrides", "points[].overrides", "what to give to --set, beyond the base's; in CSV as a shell takes them, "
           "apart by spaces", lambda p: shlex.join(p.overrides)),
    Column("frames", "points[].frames", "frames, one after the other, whose last image was measured",
           lambda p: p.frames),
    *_errors("points[]", ERRORS),
    Column("time_least_s", "points[].seconds.least", "time of a whole frame, warm, all stages: least of the runs [s]",
           lambda p: p.seconds and p.seconds.least),
    Column("time_median_s", "points[].seconds.median", "median of the runs [s]",
           lambda p: p.seconds and p.seconds.median),
    Column("time_bar_s", "points[].seconds.high", "where the error bar ends, if not at the median [s]",
           lambda p: p.seconds and p.seconds.end),
    Column("runs", "points[].seconds.runs", "number of runs", lambda p: p.seconds and p.seconds.runs),
    Column("peak_bytes", "points[].peak_bytes", "the most memory that arrays took at one moment [bytes]",
           lambda p: p.peak_bytes),
    Column("member", "points[].member", "of the Pareto front of relMSE and time: certain, possible, dominated or "
           "failed", lambda p: p.member),
    Column("fault", "points[].fault", "why it failed", lambda p: p.fault),
)
STAGE = ("points[].stages.NAME", "time of the stage in the run that was least [s]; in CSV stage_NAME_s")

PART_COLUMNS: tuple[Column, ...] = (
    Column("name", "budget.parts[].name", "of the approximation", lambda b: b.name),
    Column("about", "budget.parts[].about", "what it is", lambda b: b.about),
    Column("truth", "budget.parts[].truth", "what it is replaced by", lambda b: b.truth),
    Column("share", "budget.parts[].share", "share of the frame's relMSE; shares, rest and interaction add up to 1 "
           "[1]", lambda b: b.share),
    Column("alone", "budget.parts[].alone", "relMSE with everything else true [1]; empty where that takes too long; "
           "of rest and interaction that of "
           "their own image", lambda b: b.alone),
    Column("without", "budget.parts[].without", "relMSE with this part true, all others on [1]", lambda b: b.without),
    Column("bias", "budget.parts[].bias", "mean of what it adds, over the mean of the reference [1]", lambda b: b.bias),
)
REGION = ("budget.parts[].regions.NAME", "its share by region of the image [1]; they add up to share; in CSV "
          "share_in_NAME")

LEVEL_COLUMNS: tuple[Column, ...] = (
    Column("label", "refinement.levels[].label", "settings in words", lambda v: v.label),
    Column("step", "refinement.levels[].step", "over that of the coarsest level [1]", lambda v: v.step),
    *_errors("refinement.levels[]", ERRORS),
)


# --- JSON -------------------------------------------------------------------------------------------


def report_json(report: Report) -> dict[str, Json]:
    """A report as JSON values, every field written out under its name.

    Parameters
    ----------
    report : Report

    Returns
    -------
    dict
        With ``format``, ``schema_version`` and ``columns``, which says what the numbers are, and their units. JSON
        knows neither NaN nor infinity: they are the strings "nan", "inf" and "-inf". What is not there is null.

    Examples
    --------
    >>> from froxel_ref.report_record import Claim
    >>> _plain(Claim("depth", 2.0, float("nan"), 0.0))
    {'name': 'depth', 'claimed': 2.0, 'measured': 'nan', 'slack': 0.0}
    """
    columns = {column.path: column.about for column in (*POINT_COLUMNS, *PART_COLUMNS, *LEVEL_COLUMNS)}
    columns |= dict([STAGE, REGION])
    plain: dict[str, Json] = _plain(report)
    return {"format": FORMAT, "schema_version": VERSION, "columns": columns} | plain


def _plain(value: Any) -> Json:
    """A value as JSON has it; numbers of NumPy become Python's."""
    if hasattr(value, "_asdict"):
        return {name: _plain(item) for name, item in value._asdict().items()}
    if isinstance(value, Mapping):
        return {str(name): _plain(item) for name, item in value.items()}
    if isinstance(value, tuple | list):
        return [_plain(item) for item in value]
    if value is None or isinstance(value, str | bool):
        return value
    if isinstance(value, Integral):
        return int(value)
    if isinstance(value, Real):
        return float(value) if math.isfinite(value) else str(float(value))
    return bool(value)  # NumPy's


def report_from_json(raw: Json) -> Report:
    """A report from its JSON form.

    Parameters
    ----------
    raw : JSON value
        As `report_json` makes it.

    Returns
    -------
    Report
        Equal to the one that was written, number for number.

    Raises
    ------
    InputError
        Another format or version; a key that is unknown or missing; a value of another type. The place is a path.

    Examples
    --------
    >>> report_from_json({"format": "another"})
    Traceback (most recent call last):
    froxel_ref.records.InputError: format: is 'another', must be 'froxel-ref report'
    """
    if not isinstance(raw, Mapping):
        raise InputError("", f"is {shown(raw)}, must be an object")
    for key, must in (("format", FORMAT), ("schema_version", VERSION)):
        if raw.get(key) != must or isinstance(raw.get(key), bool):
            raise InputError(key, f"is {shown(raw.get(key))}, must be {must!r}")
    report = _read(Report, {key: raw[key] for key in raw if key not in ("format", "schema_version", "columns")}, "")
    assert isinstance(report, Report)
    return report


_NOT_FINITE = {"nan": math.nan, "inf": math.inf, "-inf": -math.inf}


def _read(kind: Any, raw: Json, place: str) -> Any:
    """A value of a declared type."""
    origin, inside = typing.get_origin(kind), typing.get_args(kind)
    if origin in (types.UnionType, typing.Union):
        return None if raw is None else _read(next(each for each in inside if each is not type(None)), raw, place)
    if origin is tuple:
        if not isinstance(raw, list):
            raise InputError(place, f"is {shown(raw)}, must be a list")
        kinds = [inside[0]] * len(raw) if inside[-1] is Ellipsis else list(inside)
        if len(kinds) != len(raw):
            raise InputError(place, f"has length {len(raw)}, must have {len(kinds)}")
        return tuple(_read(each, item, f"{place}[{i}]") for i, (each, item) in enumerate(zip(kinds, raw, strict=True)))
    if origin is not None or hasattr(kind, "_fields"):
        if not isinstance(raw, Mapping):
            raise InputError(place, f"is {shown(raw)}, must be an object")
        if origin is not None:
            return {str(key): _read(inside[1], item, _under(place, key)) for key, item in raw.items()}
        return _record(kind, raw, place)
    if kind is float:
        if isinstance(raw, str) and raw in _NOT_FINITE:
            return _NOT_FINITE[raw]
        if isinstance(raw, int | float) and not isinstance(raw, bool):
            return float(raw)
    elif isinstance(raw, kind) and isinstance(raw, bool) == (kind is bool):
        return raw
    words = {float: 'a number, "nan", "inf" or "-inf"', int: "a whole number", str: "a string", bool: "true or false"}
    raise InputError(place, f"is {shown(raw)}, must be {words[kind]}")


def _record(kind: Any, raw: Mapping[Any, Json], place: str) -> Any:
    hints = typing.get_type_hints(kind)
    for key in raw:
        if key not in hints:
            raise InputError(_under(place, key), f"is not a key here; {suggest(str(key), hints)}")
    missing = next((name for name in hints if name not in raw and name not in kind._field_defaults), None)
    if missing is not None:
        raise InputError(_under(place, missing), "is missing")
    return kind(**{name: _read(hints[name], raw[name], _under(place, name)) for name in hints if name in raw})


def _under(place: str, key: object) -> str:
    return f"{place}.{key_shown(key)}" if place else key_shown(key)


# --- CSV --------------------------------------------------------------------------------------------


def _table(heads: Sequence[str], rows: Iterable[Sequence[Any]]) -> str:
    """CSV text: lines end in a line feed, what is not there is empty, numbers are exact."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(heads)
    for row in rows:
        cells = [_plain(value) for value in row]
        writer.writerow(["" if cell is None else repr(cell) if isinstance(cell, float) else cell for cell in cells])
    return text.getvalue()


def points_csv(points: Sequence[Point]) -> str:
    """All points, a row each.

    Parameters
    ----------
    points : sequence of Point

    Returns
    -------
    str
        CSV. Units are in the headings; a stage that some point does not have is empty there.

    Examples
    --------
    >>> points_csv([]).startswith("id,knob,label,overrides,frames,relmse,worst_pixel_share,mean_absolute,bias")
    True
    """
    stages = list(dict.fromkeys(name for point in points for name in point.stages))
    at = [column.heading for column in POINT_COLUMNS].index("peak_bytes")
    heads = [column.heading for column in POINT_COLUMNS]
    heads[at:at] = [f"stage_{name}_s" for name in stages]
    rows = []
    for point in points:
        row = [column.take(point) for column in POINT_COLUMNS]
        row[at:at] = [point.stages.get(name) for name in stages]
        rows.append(row)
    return _table(heads, rows)


def budget_csv(budget: Budget) -> str:
    """The budget: a row for each part, for the rest, the interaction, and the total.

    Parameters
    ----------
    budget : Budget

    Returns
    -------
    str
        CSV. The first column is "part", "rest", "interaction" or "total".

    Examples
    --------
    >>> print(budget_csv(Budget(0.25, (), (), 0.75, 0.125, 0.25, 0.0625, None, {"sky": 1.0}, {"sky": 1.0})))
    row,name,about,truth,share,alone,without,bias,share_in_sky
    rest,rest,what is left with all parts true,,0.75,0.125,,,
    interaction,interaction,what three and more parts do together,,0.25,0.0625,,,
    total,total,the frame,,1.0,0.25,,,1.0
    <BLANKLINE>
    """
    regions = list(budget.region_totals)
    rows: list[list[Any]] = [["part", *(column.take(part) for column in PART_COLUMNS),
                              *(part.regions.get(name) for name in regions)] for part in budget.parts]
    nothing = [None] * len(regions)
    rows.append(["rest", "rest", "what is left with all parts true", None, budget.rest, budget.rest_relmse, None, None,
                 *nothing])
    rows.append(["interaction", "interaction", "what three and more parts do together", None, budget.interaction,
                 budget.interaction_relmse, None, None, *nothing])
    rows.append(["total", "total", "the frame", None, 1.0, budget.total, None, None,
                 *(budget.region_totals[name] for name in regions)])
    heads = [column.heading for column in PART_COLUMNS]
    return _table(["row", *heads, *(f"share_in_{name}" for name in regions)], rows)


def refinement_csv(levels: Sequence[Level]) -> str:
    """The levels of a refinement, coarsest first.

    Parameters
    ----------
    levels : sequence of Level

    Returns
    -------
    str
        CSV.

    Examples
    --------
    >>> from froxel_ref.report_record import Errors
    >>> print(refinement_csv([Level("1/1", 1.0, Errors(0.5, 0.25, 1.0, 2.0, absolute=0.75, worst=0.125))]))
    label,step,relmse,worst_pixel_share,mean_absolute,bias,quantile_999,maximum,flip,error_fault
    1/1,1.0,0.5,0.125,0.75,0.25,1.0,2.0,,
    <BLANKLINE>
    """
    return _table([column.heading for column in LEVEL_COLUMNS],
                  ([column.take(level) for column in LEVEL_COLUMNS] for level in levels))


# --- files ------------------------------------------------------------------------------------------


def write_report(folder: Path, report: Report, *, pictures: Mapping[str, bytes] | None = None,
                 shown: Sequence[Picture] = ()) -> list[Path]:
    """Write a report into a folder that is there; each file replaces an older one in one step.

    Parameters
    ----------
    folder : Path
        An existing folder.
    report : Report
    pictures : mapping of str to bytes, optional
        PNG files by their names. Default: `froxel_ref.report_plots.pictures` of the report, or none without matplotlib.
    shown : sequence of Picture
        Of where the error lies, for the page and one sheet of their own.

    Returns
    -------
    list of Path
        What was written, the page last. A file of an earlier report that this one does not have is removed.

    Raises
    ------
    InputError
        The folder or a file cannot be written.
    """
    from froxel_ref.report_html import page
    from froxel_ref.report_plots import drawings, plots_available
    from froxel_ref.report_plots import pictures as drawn

    folder = Path(folder)
    able = plots_available()
    text = json.dumps(report_json(report), indent=1, ensure_ascii=False, allow_nan=False) + "\n"
    files: dict[str, bytes] = {JSON: text.encode(), POINTS: points_csv(report.points).encode()}
    if report.budget is not None:
        files[BUDGET] = budget_csv(report.budget).encode()
    if report.refinement is not None:
        files[REFINEMENT] = refinement_csv(report.refinement.levels).encode()
    files |= (drawn(report) if able else {}) if pictures is None else pictures
    if shown:
        files[SHEET] = sheet_png(shown, title=f"{report.setup.scene}: where the error lies")
    files[PAGE] = page(report, drawings(report) if able else {}, shown).encode()
    for name, content in files.items():
        with whole_file(folder / name, force=True) as partial:
            partial.write_bytes(content)
    for name in {BUDGET, REFINEMENT, SHEET, *PICTURES} - set(files):
        try:
            with suppress(FileNotFoundError):
                (folder / name).unlink()
        except OSError as error:
            raise refusal(error, "output", folder / name) from None
    return [folder / name for name in files]
