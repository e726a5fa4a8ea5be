"""The command ``froxel-ref stability``: parsing and printing only."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

from froxel_ref.cli_progress import progress

if TYPE_CHECKING:
    from froxel_ref.kernel_registry import Kernel
    from froxel_ref.stability import Measure

__all__ = ["EXAMPLES", "add_options", "run_stability"]

EXAMPLES = """\
Measures every kernel in float64, float32 and with float16 storage against arithmetic with 40 digits and
more, on random and extreme inputs; published formulas stand beside the corrected ones. Writes stability.csv,
stability.json, a map of the errors per kernel and index.html, whose path is the last line printed. Needs mpmath
(pip install 'froxel-ref[stability]').

examples:
  froxel-ref stability
  froxel-ref stability --list
  froxel-ref stability -o phase --kernel henyey_greenstein --kernel schlick --samples 100
"""


def add_options(parser: argparse.ArgumentParser) -> None:
    """The command's own options; those of the output are the caller's."""
    parser.add_argument("--kernel", metavar="NAME", action="append",
                        help="measure this kernel only; may be repeated (default: all)")
    parser.add_argument("--list", action="store_true", help="list the kernels and stop")
    parser.add_argument("--samples", metavar="N", default="400",
                        help="random inputs per kernel (default: 400)")


def run_stability(args: argparse.Namespace, table: Callable[[Sequence[Sequence[str]], str], None]) -> None:
    """Measure, write, print the table of what must hold and of what fails."""
    from froxel_ref.output import output_path
    from froxel_ref.records import InputError, shown
    from froxel_ref.stability_page import check_target, write_report

    if args.list:
        table([("kernel", "group", "what"), *((k.name, k.group, k.about) for k in _chosen(None))], "lll")
        return

    if not (args.samples.isascii() and args.samples.isdigit() and 2 <= int(args.samples[:9]) <= 1_000_000):
        raise InputError("--samples", f"is {shown(args.samples)}, must be a whole number from 2 to 1000000")
    chosen = _chosen(args.kernel)
    folder = output_path(args.output, "stability")
    check_target(folder, force=args.force)  # again when the folder is made: this one saves the wait
    with progress("kernels") as tell:
        report = write_report(chosen, folder, samples=int(args.samples), force=args.force, progress=tell)
    head = ("kernel", "form", "precision", "worst ulp", "mean", "condition", "worst, cond < 4", "verdict")
    table([head, *map(_row, report.measures)], "lllrrrrl")
    print(report.page)


def _chosen(names: Sequence[str] | None) -> list[Kernel]:
    """The kernels of these names; an unknown one is answered with its like, or with how to list them."""
    from froxel_ref.kernel_registry import kernels
    from froxel_ref.records import InputError, shown

    known = [kernel.name for kernel in kernels()]
    for name in names or ():
        if name not in known:
            near = _near(name, known)
            hint = f"did you mean {' or '.join(map(repr, near))}? " if near else ""
            raise InputError("--kernel", f"is {shown(name)}; {hint}froxel-ref stability --list names all")
    return kernels(names)


def _near(word: str, known: Sequence[str]) -> list[str]:
    """At most three names: spelled alike, with the word in them, or of which it has the initials.

    >>> _near("hg", ["henyey_greenstein", "height_fog"]), _near("hg", ["half_step"])
    (['henyey_greenstein'], [])
    """
    import difflib

    word = word.lower()
    if not word:
        return []
    alike = difflib.get_close_matches(word, known, n=1, cutoff=0.6)
    within = [name for name in known if word in name or "".join(part[0] for part in name.split("_")) == word]
    return list(dict.fromkeys([*alike, *within]))[:3]


def _row(row: Measure) -> tuple[str, ...]:
    return (row.kernel, row.form, row.precision, f"{row.worst:.3g}", f"{row.mean:.3g}", f"{row.condition:.2g}",
            f"{row.worst_well:.3g}", f"{row.verdict}: {row.reason}" if row.reason else row.verdict)
