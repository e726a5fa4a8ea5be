"""What the stability command writes: a table as CSV, JSON and a web page, and a picture of each kernel."""

from __future__ import annotations

import csv
import json
import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

import froxel_ref
from froxel_ref.image_files import write_png
from froxel_ref.output import check_folder, read_manifest, whole_folder
from froxel_ref.records import InputError
from froxel_ref.stability import Kernel, examine
from froxel_ref.stability_html import page
from froxel_ref.stability_inputs import seed
from froxel_ref.stability_measure import SOUND_ULP, WELL, Measure

__all__ = ["CSV", "FORMAT", "JSON", "PAGE", "Report", "check_target", "write_report"]

Progress = Callable[[str, int, int], None]

CSV, JSON, PAGE = "stability.csv", "stability.json", "index.html"
FORMAT, VERSION = "froxel-ref stability", 2

# What stands in a row, in the CSV and in the JSON alike, and what it is; units are in the names.
COLUMNS: dict[str, str] = {
    "form": "how it is computed; the first of a kernel must hold",
    "precision": "type computed in; float16 is float32, rounded for storage",
    "verdict": f"fails: results that must not be; inexact: more than {SOUND_ULP:g} ulp where the condition number is "
               f"below {WELL:g}, or of any input for each unit of 1 + condition number; else sound",
    "reason": "of a verdict that is not sound",
    "worst_ulp": "largest error, in spacings of the type at the exact value",
    "mean_ulp": "mean error",
    "worst_relative": "largest relative error where the exact value is a normal number",
    "condition": "condition number where the error is largest: by how much the exact function magnifies a "
                 "relative change of its inputs",
    "worst_well_ulp": f"largest error among inputs whose condition number is below {WELL:g}",
    "worst_per_condition_ulp": "largest error over 1 + condition number",
    "inputs_at_worst": "inputs with the largest error, by the names of the parameters, in their units",
    "not_a_number": "results that are not a number",
    "infinite": "infinite results for a finite exact value",
    "negative": "results below 0",
    "above": "results above the bound: transmittance 1, the furnace, the peak",
    "rising": "steps at which an output that must fall grew",
    "beyond": "inputs whose exact value is beyond the type, not counted",
    "cases": "inputs tried: random, hand-picked, and the picture's",
}


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
    report = read_manifest(folder / JSON, FORMAT)
    try:
        if report:
            known = {CSV, JSON, PAGE} | {str(kernel["picture"]) for kernel in report["kernels"]}
    except (TypeError, KeyError):
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
        Called as ``progress(kernel, index, count)`` before each kernel.

    Returns
    -------
    Report

    Raises
    ------
    InputError
        The place is taken or cannot be written; mpmath or Pillow is missing; too few samples.
    """
    from froxel_ref.stability_pictures import heat_map

    if samples < 2:
        raise InputError("samples", f"is {samples}, must be at least 2")
    folder, measures = Path(folder), list[Measure]()
    with whole_folder(folder, lambda target: check_target(target, force=force)) as partial:
        for index, kernel in enumerate(chosen):
            if progress is not None:
                progress(kernel.name, index, len(chosen))
            found = examine(kernel, samples)
            measures += found.measures
            write_png(partial / _picture(kernel), heat_map(kernel, found))
        _write_csv(partial / CSV, chosen, measures)
        document = _document(chosen, measures, samples)
        text = json.dumps(document, indent=1, ensure_ascii=False, allow_nan=False) + "\n"
        (partial / JSON).write_text(text, encoding="utf-8", newline="\n")
        pictures = {kernel.name: (partial / _picture(kernel)).read_bytes() for kernel in chosen}
        (partial / PAGE).write_text(page(chosen, measures, samples, pictures), encoding="utf-8", newline="\n")
    return Report(folder, folder / PAGE, measures)


def _picture(kernel: Kernel) -> str:
    return f"{kernel.name}.png"


# --- CSV and JSON -----------------------------------------------------------------------------------


def _row(kernel: Kernel, row: Measure) -> dict[str, Any]:
    """A measure by the names in `COLUMNS`."""
    values = row._asdict() | {f"{name}_ulp": getattr(row, name)
                              for name in ("worst", "mean", "worst_well", "worst_per_condition")}
    inputs = {p.name: value for p, value in zip(kernel.parameters, row.place, strict=True)}
    values |= {"verdict": row.verdict, "reason": row.reason, "inputs_at_worst": inputs}
    return {name: values[name] for name in COLUMNS}


def _write_csv(path: Path, chosen: Sequence[Kernel], measures: Sequence[Measure]) -> None:
    known = {kernel.name: kernel for kernel in chosen}
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(["kernel", "group", *COLUMNS])
        for row in measures:
            cells = _row(known[row.kernel], row)
            inputs = "; ".join(f"{name}={value!r}" for name, value in cells["inputs_at_worst"].items())
            writer.writerow([row.kernel, row.group, *(cells | {"inputs_at_worst": inputs}).values()])


def _json(value: Any) -> Any:
    """A value as JSON, which knows neither infinity nor NaN."""
    if isinstance(value, float) and not math.isfinite(value):
        return str(value)
    if isinstance(value, dict):
        return {name: _json(item) for name, item in value.items()}
    return [_json(item) for item in value] if isinstance(value, tuple) else value


def _document(chosen: Sequence[Kernel], measures: Sequence[Measure], samples: int) -> dict[str, Any]:
    entries = []
    for kernel in chosen:
        rows = [_json(_row(kernel, row)) for row in measures if row.kernel == kernel.name]
        entries.append({"name": kernel.name, "group": kernel.group, "about": kernel.about,
                        "departure": kernel.departure, "seed": seed(kernel),
                        "parameters": [_json(p._asdict()) for p in kernel.parameters],
                        "picture": _picture(kernel), "measures": rows})
    return {"format": FORMAT, "schema_version": VERSION, "samples": samples,
            "random": "numpy.random.default_rng(seed) for each kernel",
            "made_by": {"froxel-ref": froxel_ref.__version__, "numpy": np.__version__},
            "columns": COLUMNS, "kernels": entries}
