"""What the stability command writes: a table as CSV, JSON and a web page, and the kernels' heat maps."""

from __future__ import annotations

import base64
import csv
import html
import json
import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

import froxel_ref
from froxel_ref.image_files import write_png
from froxel_ref.output import check_folder, whole_folder
from froxel_ref.stability import WELL, Kernel, Measure, sweep

__all__ = ["CSV", "FORMAT", "JSON", "PAGE", "Report", "check_target", "write_report"]

Progress = Callable[[str, int, int], None]

CSV, JSON, PAGE = "stability.csv", "stability.json", "index.html"
FORMAT, VERSION = "froxel-ref stability", 1

# Heading, how it is said, what it is: of the page's columns that are numbers.
COLUMNS: tuple[tuple[str, str, str], ...] = (
    ("worst", "worst [ulp]", "largest error"),
    ("mean", "mean [ulp]", "mean error"),
    ("worst_relative", "relative", "largest relative error where the exact value is a normal number"),
    ("condition", "condition", "condition number where the error is largest"),
    ("worst_well", f"worst, condition < {WELL:g}", "largest error among well-conditioned inputs [ulp]"),
    ("worst_per_condition", "worst/(1 + condition)", "largest error over 1 + condition number [ulp]"),
    ("not_a_number", "NaN", "results that are not a number"),
    ("infinite", "infinite", "infinite results for a finite exact value"),
    ("negative", "negative", "results below 0"),
    ("above", "above bound", "results above the bound: transmittance 1, the furnace, the peak"),
    ("rising", "rises", "steps at which an output that must fall grew"),
    ("beyond", "beyond type", "inputs whose exact value is beyond the type, not counted"),
    ("cases", "inputs", "inputs tried"),
)


class Report(NamedTuple):
    """A written report: its folder, its page and what was measured."""

    folder: Path
    page: Path
    measures: list[Measure]


def check_target(folder: Path, *, force: bool) -> None:
    """Whether a report may be written there.

    Raises
    ------
    InputError
        It exists and ``force`` is not set, it is a file, or it holds anything but a report.
    """
    check_folder(folder, _foreign, force=force, kind="stability report", short="report")


def _foreign(folder: Path) -> str | None:
    """Something in the folder that no report there speaks of."""
    known: set[str] = set()
    try:
        report = json.loads((folder / JSON).read_text(encoding="utf-8"))
        if report["format"] == FORMAT:
            known = {CSV, JSON, PAGE} | {str(kernel["picture"]) for kernel in report["kernels"]}
    except (OSError, ValueError, TypeError, KeyError):
        pass
    return next((path.name for path in sorted(folder.iterdir()) if path.name not in known), None)


def write_report(chosen: Sequence[Kernel], folder: Path, *, samples: int = 400, force: bool = False,
                 progress: Progress | None = None) -> Report:
    """Measure kernels and write the report into a folder that appears whole or not at all.

    Parameters
    ----------
    chosen : sequence of Kernel
        From `froxel_ref.stability.kernels`.
    folder : Path
        The folder to make.
    samples : int
        Random inputs per kernel and precision.
    force : bool
        Replace a report that stands there, once the new one is complete.
    progress : callable, optional
        Called as ``progress(what, index, count)`` before each kernel's measures and picture.

    Returns
    -------
    Report

    Raises
    ------
    InputError
        The place is taken or cannot be written; mpmath or Pillow is missing; too few samples.
    """
    from froxel_ref.stability_pictures import heat_map

    folder, count = Path(folder), 2 * len(chosen)
    tell = progress or (lambda what, index, count: None)
    with whole_folder(folder, lambda target: check_target(target, force=force)) as partial:
        measures = sweep(chosen, samples=samples, progress=lambda name, index, _: tell(name, index, count))
        for index, kernel in enumerate(chosen, len(chosen)):
            tell(f"{kernel.name}: picture", index, count)
            write_png(partial / _picture(kernel), heat_map(kernel))
        _write_csv(partial / CSV, measures)
        document = _document(chosen, measures, samples)
        text = json.dumps(document, indent=1, ensure_ascii=False, allow_nan=False) + "\n"
        (partial / JSON).write_text(text, encoding="utf-8", newline="\n")
        (partial / PAGE).write_text(_page(chosen, measures, samples, partial), encoding="utf-8", newline="\n")
    return Report(folder, folder / PAGE, measures)


def _picture(kernel: Kernel) -> str:
    return f"{kernel.name}.png"


# --- CSV and JSON -----------------------------------------------------------------------------------


def _write_csv(path: Path, measures: Sequence[Measure]) -> None:
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow([*Measure._fields[:-1], "sound", "inputs_at_worst"])
        for row in measures:
            writer.writerow([*row[:-1], str(row.sound).lower(), " ".join(repr(value) for value in row.place)])


def _json(value: Any) -> Any:
    """A value as JSON, which knows neither infinity nor NaN."""
    if isinstance(value, float) and not math.isfinite(value):
        return str(value)
    return [_json(item) for item in value] if isinstance(value, tuple) else value


def _document(chosen: Sequence[Kernel], measures: Sequence[Measure], samples: int) -> dict[str, Any]:
    entries = []
    for kernel in chosen:
        rows = [{name: _json(value) for name, value in row._asdict().items()
                 if name not in ("kernel", "group")}
                | {"sound": row.sound} for row in measures if row.kernel == kernel.name]
        parameters = [{name: _json(value) for name, value in p._asdict().items()} for p in kernel.parameters]
        entries.append({"name": kernel.name, "group": kernel.group, "about": kernel.about,
                        "departure": kernel.departure, "parameters": parameters, "picture": _picture(kernel),
                        "measures": rows})
    return {"format": FORMAT, "schema_version": VERSION, "samples": samples,
            "made_by": {"froxel-ref": froxel_ref.__version__, "numpy": np.__version__},
            "columns": {name: about for name, _, about in COLUMNS}, "kernels": entries}


# --- the page ---------------------------------------------------------------------------------------

STYLE = """
:root{color-scheme:light dark;--line:light-dark(#d5d8de,#3a3e46);--bad:light-dark(#b3261e,#ff8a80);
--head:light-dark(#f1f3f6,#24272d);--faint:light-dark(#5c636e,#a0a6b0)}
body{font:15px/1.45 system-ui,sans-serif;margin:1.2rem auto;max-width:1300px;padding:0 1rem;
background:light-dark(#fff,#16181c);color:light-dark(#1b1d21,#e8eaee)}
h1{font-size:1.5rem;margin:.2em 0}h2{font-size:1.15rem;margin-top:1.6em}p{max-width:75ch}
.wide{overflow-x:auto;border:1px solid var(--line);border-radius:6px}
table{border-collapse:collapse;font-size:13px;font-variant-numeric:tabular-nums;white-space:nowrap}
th,td{padding:.3em .6em;text-align:right;border-bottom:1px solid var(--line)}
th:nth-child(-n+4),td:nth-child(-n+4){text-align:left}
th{background:var(--head);position:sticky;top:0}
th button{font:inherit;font-weight:600;color:inherit;background:none;border:0;padding:0;cursor:pointer}
th button:focus-visible{outline:2px solid}
th[aria-sort=ascending] button::after{content:" \\2191"}
th[aria-sort=descending] button::after{content:" \\2193"}
.bad{color:var(--bad);font-weight:600}.faint{color:var(--faint)}
figure{margin:1.2em 0}img{max-width:100%;height:auto;border-radius:6px}figcaption{color:var(--faint)}
code{font-size:.95em}
"""

# Numbers begin with the largest, words with the first; a second click turns the order round.
SCRIPT = """
document.querySelectorAll("th button").forEach(b=>b.addEventListener("click",()=>{
const h=b.parentElement,t=h.closest("table"),i=h.cellIndex,body=t.tBodies[0];
const words=body.rows[0].cells[i].dataset.v===undefined,was=h.getAttribute("aria-sort");
const order=was?(was==="descending"?"ascending":"descending"):(words?"ascending":"descending");
t.querySelectorAll("th").forEach(o=>o.removeAttribute("aria-sort"));
h.setAttribute("aria-sort",order);
const sign=order==="ascending"?1:-1,number=r=>{const v=Number(r.cells[i].dataset.v);return isNaN(v)?-1:v};
body.append(...[...body.rows].sort((a,b)=>sign*(words
?a.cells[i].textContent.localeCompare(b.cells[i].textContent)
:Math.sign(number(a)-number(b))||0)))}));
"""


def _page(chosen: Sequence[Kernel], measures: Sequence[Measure], samples: int, folder: Path) -> str:
    """One file with everything inside: no link leaves it."""
    first = {kernel.name: next(iter(kernel.forms)) for kernel in chosen}
    held = [row for row in measures if row.form == first[row.kernel]]
    exact = [row.worst_well for row in held if row.precision in ("float64", "float32")]
    sound = sum(row.sound for row in held)
    facts = (f"{len(chosen)} kernels, {samples} random inputs each beside the hand-picked extremes, against "
             f"arithmetic with 40 digits and more. Of the {len(held)} rows of forms that must hold, {sound} "
             "have no NaN, infinity, negative, rising or too large result. Their largest error in float64 "
             f"and float32 where the condition number is below {WELL:g}: {max(exact, default=0.0):.3g} ulp.")
    parts = ['<!doctype html><html lang="en"><head><meta charset="utf-8">',
             '<meta name="viewport" content="width=device-width,initial-scale=1">',
             f"<title>Numerical stability</title><style>{STYLE}</style></head><body>",
             f"<h1>Numerical stability</h1><p>{facts}</p>",
             "<p>Errors are in ulp, spacings of the type at the exact value, of inputs taken as exact; "
             "float16 is float32 rounded for storage. The first form of a kernel must hold, the others show what a "
             "departure costs. Click a heading to sort.</p>",
             _table(measures, first), "<h2>Errors over the inputs</h2>"]
    for kernel in chosen:
        data = base64.b64encode((folder / _picture(kernel)).read_bytes()).decode("ascii")
        words = html.escape(kernel.about + (f" ({kernel.departure})" if kernel.departure else ""))
        parts.append(f'<figure id="{kernel.name}"><img loading="lazy" alt="Error over the inputs: {words}" '
                     f'src="data:image/png;base64,{data}"><figcaption>{words}</figcaption></figure>')
    return "\n".join([*parts, f"<script>{SCRIPT}</script></body></html>", ""])


def _table(measures: Sequence[Measure], first: dict[str, str]) -> str:
    names = [("kernel", "kernel", ""), ("form", "form", ""), ("precision", "precision", ""),
             ("verdict", "verdict", "no result that must not be")]
    heads = "".join(f'<th scope="col" title="{html.escape(about)}"><button>{html.escape(head)}</button></th>'
                    for _, head, about in (*names, *COLUMNS, ("place", "inputs at the worst", "")))
    return (f'<div class="wide"><table><thead><tr>{heads}</tr></thead><tbody>'
            + "\n".join(_row(row, first[row.kernel] == row.form) for row in measures)
            + "</tbody></table></div>")


def _row(row: Measure, holds: bool) -> str:
    cells = [f'<td><a href="#{row.kernel}">{row.kernel}</a></td>', f"<td>{html.escape(row.form)}</td>",
             f"<td>{row.precision}</td>", f"<td{'' if row.sound else ' class=bad'}>"
             f"{'sound' if row.sound else 'fails'}</td>"]
    for name, _, _ in COLUMNS:
        value = getattr(row, name)
        counts = name in ("not_a_number", "infinite", "negative", "above", "rising")
        style = ' class="bad"' if counts and value else ' class="faint"' if not value or not holds else ""
        words = f"{value:d}" if isinstance(value, int) else f"{value:.3g}"
        key = "Infinity" if value == math.inf else repr(value)  # as JavaScript reads numbers
        cells.append(f'<td data-v="{key}"{style}>{words}</td>')
    place = ", ".join(f"{value:.6g}" for value in row.place)
    return f"<tr>{''.join(cells)}<td class=faint>{place}</td></tr>"
