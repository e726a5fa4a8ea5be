"""The stability table as one web page that needs nothing but itself."""

from __future__ import annotations

import base64
import html
import math
from collections.abc import Mapping, Sequence

from froxel_ref.kernel_registry import Kernel, Parameter
from froxel_ref.stability_measure import FAULTS, SOUND_ULP, WELL, Measure

__all__ = ["page"]

STYLE = """
:root{color-scheme:light dark;--line:light-dark(#d5d8de,#3a3e46);--fails:light-dark(#b3261e,#ff8a80);
--inexact:light-dark(#8a5300,#f0b860);--sound:light-dark(#1b6e3c,#7fd6a0);--paper:light-dark(#fff,#16181c);
--head:light-dark(#eef0f4,#262a31);--faint:light-dark(#5c636e,#a0a6b0)}
*{box-sizing:border-box}
body{font:15px/1.45 system-ui,sans-serif;margin:1.2rem auto;max-width:1340px;padding:0 1rem;
background:var(--paper);color:light-dark(#1b1d21,#e8eaee)}
h1{font-size:1.5rem;margin:.2em 0}h2{font-size:1.15rem;margin-top:1.6em}p,dl{max-width:95ch}
dl{display:grid;grid-template-columns:max-content 1fr;gap:.15em 1em;font-size:.92em;margin:.4em 0}
dt{font-weight:600}dd{margin:0;color:var(--faint)}
table{border-collapse:separate;border-spacing:0;width:100%;font-size:13px;line-height:1.35;
font-variant-numeric:tabular-nums}
th,td{padding:.32em .55em;text-align:left;vertical-align:top;border-bottom:1px solid var(--line)}
th{background:var(--head);position:sticky;top:0;z-index:1;border-top:1px solid var(--line);vertical-align:bottom}
th.n,td.n{text-align:right}
th button{font:inherit;font-weight:600;color:inherit;background:none;border:0;padding:0;cursor:pointer;
text-align:inherit}
th button:focus-visible{outline:2px solid}
th[aria-sort=ascending] button::after{content:" \\2191"}
th[aria-sort=descending] button::after{content:" \\2193"}
.fails{color:var(--fails)}.inexact{color:var(--inexact)}.sound{color:var(--sound)}
td span{white-space:nowrap}td b{display:block}td small{display:block;font-size:12px;min-width:9.5em}
.faint,td small{color:var(--faint)}
tr:target td,tr.first td{border-top:1px solid var(--faint)}
summary{cursor:pointer;color:var(--faint)}details[open] summary{margin-bottom:.3em}
.few tr.ok{display:none}label{display:block;margin:1em 0 .4em}
figure{margin:1.4em 0;scroll-margin-top:1em}img{max-width:100%;height:auto;border-radius:6px;display:block}
figcaption{color:var(--faint);margin-top:.3em}code{font-size:.95em}
@media(max-width:760px){table{display:block;overflow-x:auto}}
"""

# Numbers begin with the largest, words with the first; a second click turns the order round.
SCRIPT = """
document.querySelectorAll("th button").forEach(b=>b.addEventListener("click",()=>{
const h=b.parentElement,t=h.closest("table"),i=h.cellIndex,body=t.tBodies[0];
const words=body.rows[0].cells[i].dataset.v===undefined,was=h.getAttribute("aria-sort");
const order=was?(was==="descending"?"ascending":"descending"):(words?"ascending":"descending");
t.querySelectorAll("th").forEach(o=>o.removeAttribute("aria-sort"));
h.setAttribute("aria-sort",order);t.querySelectorAll(".first").forEach(r=>r.classList.remove("first"));
const sign=order==="ascending"?1:-1,number=r=>{const v=Number(r.cells[i].dataset.v);return isNaN(v)?-1:v};
body.append(...[...body.rows].sort((a,b)=>sign*(words
?a.cells[i].textContent.localeCompare(b.cells[i].textContent)
:Math.sign(number(a)-number(b))||0)))}));
document.querySelector("label input").addEventListener("change",e=>
document.querySelector("table").classList.toggle("few",e.target.checked));
"""

LEGEND = (
    ("verdict", "<b class=fails>fails</b>: results that must not be (NaN, infinite, negative, above the bound, "
     f"rising); <b class=inexact>inexact</b>: none of these, but more than {SOUND_ULP:g} ulp of inputs whose "
     f"condition number is below {WELL:g}, or of any inputs for each unit of 1 + condition number; "
     "<b class=sound>sound</b>: neither"),
    ("ulp", "spacings of the type at the exact value: half of one is the best that rounding can do"),
    ("condition", "by how much the exact formula magnifies a relative change of its inputs; below "
     f"{WELL:g} there is no excuse for lost digits"),
    ("relative", "largest error as a share of the exact value, where that is a normal number"),
    ("inputs at the worst", "where the error is largest; the ring in the picture"),
    ("types", "float16 is computed in float32 and rounded once, for storage"),
)

# Heading, its explanation, whether it is a number.
HEADS = (
    ("kernel", "to its picture", False), ("form", "the first of a kernel must hold", False), ("type", "", False),
    ("verdict", "", False),
    (f"worst, cond. < {WELL:g} [ulp]", f"largest error of inputs whose condition number is below {WELL:g}", True),
    ("worst [ulp]", "largest error of all inputs", True), ("relative", "largest relative error", True),
    ("inputs at the worst", "", False), ("details", "", False))


def page(chosen: Sequence[Kernel], measures: Sequence[Measure], samples: int, pictures: Mapping[str, bytes]) -> str:
    """The page; no link leaves it.

    Parameters
    ----------
    chosen : sequence of Kernel
    measures : sequence of Measure
        Of these kernels, in the order of the table.
    samples : int
        Random inputs per kernel and precision.
    pictures : mapping of str to bytes
        A PNG file for each kernel's name.

    Returns
    -------
    str
        HTML.

    Examples
    --------
    >>> page([], [], 2, {}).startswith("<!doctype html>")
    True
    """
    first = {kernel.name: next(iter(kernel.forms)) for kernel in chosen}
    legend = "".join(f"<dt>{head}</dt><dd>{words}</dd>" for head, words in LEGEND)
    parts = ['<!doctype html><html lang="en"><head><meta charset="utf-8">',
             '<meta name="viewport" content="width=device-width,initial-scale=1">',
             f"<title>Numerical stability</title><style>{STYLE}</style></head><body>",
             f"<h1>Numerical stability</h1><p>{_key(measures, first)}</p>",
             f"<p>{len(chosen)} kernels against arithmetic with 40 digits and more, each on {samples} random inputs, "
             "hand-picked extremes, and the cells of its picture. Inputs count as exact. The first form of a kernel "
             "must hold; the others show what a departure or a plain formula costs. Click a heading to sort.</p>",
             f"<dl>{legend}</dl>", '<label><input type="checkbox"> only what is not sound</label>',
             _table(chosen, measures, first), "<h2>Errors over the inputs</h2>"]
    for kernel in chosen:
        data = base64.b64encode(pictures[kernel.name]).decode("ascii")
        words = html.escape(kernel.about + (f" ({kernel.departure})" if kernel.departure else ""))
        parts.append(f'<figure id="{kernel.name}"><img loading="lazy" alt="Error over the inputs: {words}" '
                     f'src="data:image/png;base64,{data}"><figcaption><code>{kernel.name}</code>: {words}</figcaption>'
                     "</figure>")
    return "\n".join([*parts, f"<script>{SCRIPT}</script></body></html>", ""])


def _key(measures: Sequence[Measure], first: Mapping[str, str]) -> str:
    """What the table comes to, in two sentences."""
    held = [row for row in measures if row.form == first[row.kernel]]
    others = [row for row in measures if row.form != first[row.kernel]]
    exact = max((row.worst_well for row in held if row.precision != "float16"), default=0.0)
    failing, inexact = (sum(row.verdict == word for row in others) for word in ("fails", "inexact"))
    sound = sum(row.sound for row in held)
    return (f"<b>{'All' if sound == len(held) else f'Only {sound} of the'} {len(held)} rows of forms that must hold "
            f"are sound</b>: where the condition number is below {WELL:g}, their error in float64 and float32 is at "
            f"most {exact:.3g} ulp. Of the {len(others)} rows of published and plain forms, {failing} fail and "
            f"{inexact} are inexact.")


def _table(chosen: Sequence[Kernel], measures: Sequence[Measure], first: Mapping[str, str]) -> str:
    heads = "".join(f'<th scope="col"{" class=n" if number else ""} title="{html.escape(about)}">'
                    f"<button>{html.escape(head)}</button></th>" for head, about, number in HEADS)
    known = {kernel.name: kernel for kernel in chosen}
    rows, last = [], ""
    for row in measures:
        marks = " ".join(word for word, so in (("ok", row.sound), ("first", row.kernel != last)) if so)
        rows.append(f'<tr class="{marks}">{_cells(row, known[row.kernel], first[row.kernel] == row.form)}</tr>')
        last = row.kernel
    return f"<table><thead><tr>{heads}</tr></thead><tbody>" + "\n".join(rows) + "</tbody></table>"


def _cells(row: Measure, kernel: Kernel, holds: bool) -> str:
    name = row.kernel.replace("_", "_<wbr>")
    reason = f"<small>{html.escape(row.reason)}</small>" if row.reason else ""
    numbers = "".join(f'<td class=n data-v="{_key_of(value)}">{value:.3g}</td>'
                      for value in (row.worst_well, row.worst, row.worst_relative))
    inputs = "<br>".join(f"{html.escape(p.name)} = <span>{_valued(p, value)}</span>"
                         for p, value in zip(kernel.parameters, row.place, strict=True))
    form = f"<b>{html.escape(row.form)}</b>" if holds else html.escape(row.form)
    return (f'<td><a href="#{row.kernel}">{name}</a></td><td>{form}</td><td>{row.precision}</td>'
            f"<td><b class={row.verdict}>{row.verdict}</b>{reason}</td>{numbers}<td class=faint>{inputs}</td>"
            f"<td><details><summary>more</summary><div>{_details(row)}</div></details></td>")


def _details(row: Measure) -> str:
    counts = [f"{getattr(row, name)} {words}" for name, words in FAULTS.items()]
    return "<br>".join([f"mean {row.mean:.3g} ulp", f"condition at the worst {row.condition:.3g}",
                        f"worst/(1 + condition) {row.worst_per_condition:.3g} ulp", *counts,
                        f"{row.beyond} beyond the type", f"{row.cases} inputs"])


def _valued(parameter: Parameter, value: float) -> str:
    """A value with its unit; what is next to 1 keeps its distance from it."""
    gap = 1.0 - abs(value)
    near = 0.0 < gap < 1e-4 and parameter.kind in ("share", "cosine")
    number = f"{'−1 + ' if value < 0.0 else '1 − '}{gap:.3g}" if near else f"{value:.5g}"
    return number + ("" if parameter.unit == "1" else f" {html.escape(parameter.unit)}")


def _key_of(value: float) -> str:
    """As JavaScript reads numbers."""
    return "Infinity" if value == math.inf else repr(value)
