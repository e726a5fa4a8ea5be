"""A report of error against run time as one web page that needs nothing but itself."""

from __future__ import annotations

import base64
import html
import json
import math
import shlex
from collections.abc import Iterable, Mapping, Sequence

from froxel_ref.report_pictures import FULL, Picture
from froxel_ref.report_plots import (
    THEME,
    Drawing,
    megabytes,
    milliseconds,
    number,
    percent,
    plots_available,
)
from froxel_ref.report_record import LeftOut, Point, Report, Spread

__all__ = ["page"]

STYLE = """
.shots{display:grid;grid-template-columns:repeat(auto-fill,minmax(min(100%,17rem),1fr));gap:.8rem;margin:.6rem 0}
.shots figure{margin:0}.shots img{width:100%;display:block;image-rendering:pixelated;border-radius:4px}
.shots figcaption{font-size:.86em;margin:.25em 0 0}
:root{color-scheme:light dark;THEME
--line:light-dark(#d5d8de,#363b43);--head:light-dark(#eef0f4,#262a31);--mark:light-dark(#fff3c4,#443a12);
--good:light-dark(#1b6e3c,#7fd6a0);--link:light-dark(#005a9c,#7cc0ff);--card:light-dark(#f7f8fa,#1d2025)}
*{box-sizing:border-box}html{scroll-padding-top:3.2rem}
body{font:15px/1.5 system-ui,sans-serif;margin:0;background:var(--p-paper);color:var(--p-ink);
-webkit-text-size-adjust:100%}
main,header{max-width:1160px;margin:0 auto;padding:0 1.2rem}
header{padding-top:1.6rem}h1{font-size:1.7rem;line-height:1.2;margin:0 0 .3rem;letter-spacing:-.01em}
h2{font-size:1.22rem;margin:2.6rem 0 .5rem;letter-spacing:-.005em}h3{font-size:1rem;margin:1.6rem 0 .4rem}
p{margin:.4rem 0 .7rem;max-width:78ch}.soft,figcaption,dd{color:var(--p-soft)}a{color:var(--link)}
nav{position:sticky;top:0;z-index:6;background:var(--p-paper);border-bottom:1px solid var(--line);margin-top:.9rem}
nav div{max-width:1160px;margin:0 auto;padding:.45rem 1.2rem;display:flex;gap:1.1rem;overflow-x:auto;
white-space:nowrap;font-size:14px}nav a{text-decoration:none}nav a:hover{text-decoration:underline}
wbr{display:none}code,.mono{font-family:ui-monospace,SFMono-Regular,Menlo,Consolas,monospace;font-size:.9em}
.num{white-space:nowrap;font-variant-numeric:tabular-nums}
.card{background:var(--card);border:1px solid var(--line);border-radius:10px;padding:1rem 1.1rem;margin:1rem 0}
.rec{border-left:5px solid var(--good)}.rec.missed{border-left-color:var(--p-fail)}
.rec h2{margin:0 0 .3rem}.rec p:last-child{margin-bottom:0}
.line{display:flex;gap:.6rem;align-items:stretch;margin:.7rem 0}
.line code{flex:1;min-width:0;overflow-x:auto;white-space:pre;background:var(--p-paper);border:1px solid var(--line);
border-radius:6px;padding:.5rem .7rem}
button,select{font:inherit;color:inherit}
.copy,.tools select,.tools button{background:var(--p-paper);border:1px solid var(--p-edge);border-radius:6px;
padding:.35rem .8rem;cursor:pointer}
.tools button:disabled{opacity:.5;cursor:default}
:focus-visible{outline:2px solid var(--link);outline-offset:2px}
.figures{display:grid;grid-template-columns:repeat(auto-fit,minmax(142px,1fr));gap:.7rem;margin:1.1rem 0}
.figures div{border:1px solid var(--line);border-radius:10px;padding:.65rem .85rem}
.figures dt{font-size:13px;color:var(--p-soft)}.figures dd{margin:0;color:var(--p-ink);font-size:1.3rem;
font-weight:600;font-variant-numeric:tabular-nums;line-height:1.3}.figures small{display:block;font-size:13px;
font-weight:400;color:var(--p-soft);overflow-wrap:anywhere}
figure{margin:1rem 0;border:1px solid var(--line);border-radius:10px;padding:.9rem 1rem .7rem}
.art{max-width:960px;margin:0 auto;position:relative}.art svg{display:block;width:100%;height:auto;
overflow:visible}.art svg text{font-family:system-ui,sans-serif}
.narrow{display:none;max-width:430px}figcaption{font-size:14px;margin:.6rem auto 0;max-width:960px}
.pt{cursor:pointer;outline:none}.halo{fill:none;stroke:var(--p-ink);stroke-width:2;pointer-events:none}
.halo.on{stroke:var(--p-ink);fill:var(--mark);fill-opacity:.4;stroke-width:2.2}
.of-l.on text,.of-l.hot text{text-decoration:underline}.dim{opacity:.12}
#tip{position:absolute;z-index:9;max-width:min(330px,calc(100vw - 16px));background:var(--p-ink);
color:var(--p-paper);border-radius:8px;padding:.55rem .75rem;font-size:13.5px;line-height:1.45;pointer-events:none;
box-shadow:0 3px 14px #0005;overflow-wrap:anywhere}#tip[hidden]{display:none}#tip b{display:block;font-size:14.5px}
#tip span{display:block}#tip code{font-size:12.5px}
.tools{display:flex;flex-wrap:wrap;gap:.5rem 1.2rem;align-items:center;margin:.7rem 0;font-size:14px}
.tools label{display:flex;gap:.45rem;align-items:center}.tools output{color:var(--p-soft)}
.scroll{overflow:auto;border:1px solid var(--line);border-radius:10px;max-width:100%}
.scroll.tall{max-height:min(78vh,900px)}
table{border-collapse:separate;border-spacing:0;width:100%;font-size:13.5px;line-height:1.35;
font-variant-numeric:tabular-nums}
th,td{padding:.4em .65em;text-align:left;vertical-align:top;border-bottom:1px solid var(--line)}
tbody tr:last-child td,tbody tr:last-child th{border-bottom:0}
thead th{background:var(--head);position:sticky;top:0;z-index:2;vertical-align:bottom;font-weight:600;
white-space:nowrap}
.n{text-align:right;white-space:nowrap}td small,th small{display:block;font-size:12.5px;color:var(--p-soft);
font-weight:400}tfoot th,tfoot td{border-top:1px solid var(--p-edge);border-bottom:0}
.wide-words{min-width:15rem}tbody th{font-weight:600}
.lead{position:sticky;left:0;background:var(--p-paper);z-index:1}thead .lead{z-index:3;background:var(--head)}
th button,.pick{font:inherit;font-weight:600;color:inherit;background:none;border:0;padding:0;cursor:pointer;
text-align:inherit;white-space:inherit}.pick{font-weight:500;color:var(--link)}
.points .lead{white-space:nowrap}.points td{white-space:nowrap}.points td small{white-space:normal;min-width:11rem}
thead th button::after{content:"\\2195";opacity:.55;margin-left:.25em}
th[aria-sort=ascending] button::after{content:"\\2191";opacity:1}
th[aria-sort=descending] button::after{content:"\\2193";opacity:1}
.points tbody tr{cursor:pointer}.points tbody tr:hover td{background:var(--card)}
.points tbody tr.on td{background:var(--mark)}
.fail{color:var(--p-fail)}.good{color:var(--good)}ul.plain{padding-left:1.1rem;margin:.4rem 0}
ul.plain li{margin:.25rem 0;max-width:78ch}
.pair{display:grid;grid-template-columns:repeat(auto-fit,minmax(min(100%,430px),1fr));gap:0 1.4rem;align-items:start}
.pair>*{min-width:0}
dl.list{display:grid;grid-template-columns:max-content minmax(0,1fr);gap:.25rem 1.1rem;margin:.5rem 0;font-size:14px}
dl.list dt{font-weight:600}dl.list dd{margin:0;overflow-wrap:anywhere;max-width:78ch}
footer{max-width:1160px;margin:2.5rem auto 2rem;padding:0 1.2rem;font-size:13.5px}
@media(max-width:860px){figure{padding:.7rem .4rem}}
@media(max-width:699px){main,header,footer,nav div{padding-left:.85rem;padding-right:.85rem}h1{font-size:1.4rem}
figure{padding:.6rem .1rem;border-left:0;border-right:0;border-radius:0;margin-left:0;margin-right:0}
figcaption{padding:0 .3rem}.wide{display:none}.narrow{display:block}
.points .lead{white-space:normal;overflow-wrap:anywhere;min-width:8.2rem;max-width:42vw}
.wide-words{min-width:21rem}wbr{display:inline}
.line{flex-wrap:wrap}.line code{flex-basis:100%}dl.list{grid-template-columns:minmax(0,1fr);gap:0}
dl.list dd{margin-bottom:.5rem}.figures{grid-template-columns:repeat(2,minmax(0,1fr))}}
@media print{:root{color-scheme:light}nav,.tools,.copy,#tip{display:none!important}main,header,footer{max-width:none}
.scroll,.scroll.tall{max-height:none;overflow:visible}thead th,.lead{position:static}figure,tr,.card{break-inside:avoid}
h2,h3{break-after:avoid}body{font-size:10pt}table{font-size:7.5pt}th,td{padding:.25em .35em}td small{font-size:7pt}
@page{margin:12mm}@page broad{size:landscape}#points{page:broad}
.points td,.points td small{white-space:normal;min-width:0}.points .mono{overflow-wrap:anywhere}
thead th{white-space:normal}.wide-words{min-width:0}.wide{display:block}.narrow{display:none}
thead th button::after{content:none}}
"""

SCRIPT = """
(()=>{"use strict";
const $=(s,r=document)=>[...r.querySelectorAll(s)],data=JSON.parse(document.getElementById("data").textContent);
const tip=document.getElementById("tip"),NS="http://www.w3.org/2000/svg";let marked=null,hot=null;
const centre=g=>{const u=g.querySelector("use");return u?[+u.getAttribute("x"),+u.getAttribute("y")]:null};
function halo(kind,p){$(".halo."+kind).forEach(h=>h.remove());if(p===null||kind==="hot"&&p===marked)return;
$(`.pt[data-p="${p}"]`).forEach(g=>{const c=centre(g);if(!c)return;const h=document.createElementNS(NS,"circle");
h.setAttribute("class","halo "+kind);h.setAttribute("cx",c[0]);h.setAttribute("cy",c[1]);
h.setAttribute("r",kind==="on"?12:10);g.parentNode.insertBefore(h,g)})}
function tag(kind,p){$(".of-l."+kind).forEach(e=>e.classList.remove(kind));
if(p!==null)$(`.of-l[data-p="${p}"]`).forEach(e=>e.classList.add(kind));halo(kind,p)}
function fill(p){const d=data[p];tip.replaceChildren();
const b=document.createElement("b");b.textContent=d.id;tip.append(b);
d.lines.forEach(t=>{const s=document.createElement("span");s.textContent=t;tip.append(s)});
if(d.set){const c=document.createElement("code");c.textContent=d.set;tip.append(c)}}
function show(g){const p=+g.dataset.p;hot=p;fill(p);tip.hidden=false;tag("hot",p);
const r=g.getBoundingClientRect(),w=tip.offsetWidth,h=tip.offsetHeight,full=document.documentElement.clientWidth;
let x=r.left+r.width/2-w/2,y=r.top-h-12;if(y<52)y=r.bottom+12;
tip.style.left=Math.max(8,Math.min(x,full-w-8))+scrollX+"px";tip.style.top=y+scrollY+"px"}
function hide(){tip.hidden=true;if(hot!==null){hot=null;tag("hot",null)}}
function mark(p){marked=marked===p?null:p;tag("on",marked);if(hot!==null)halo("hot",hot);
$(".points tbody tr").forEach(r=>{const on=marked!==null&&+r.dataset.p===marked;r.classList.toggle("on",on);
const b=r.querySelector(".pick");if(b)b.setAttribute("aria-pressed",on)})}
function near(svg,e){let best=null,least=24;$(".pt:not(.dim)",svg).forEach(g=>{const r=g.getBoundingClientRect(),
d=Math.hypot(r.left+r.width/2-e.clientX,r.top+r.height/2-e.clientY);if(d<least){least=d;best=g}});
if(!best){const l=e.target.closest(".of-l");if(l)best=$(`.pt[data-p="${l.dataset.p}"]`,svg)[0]||null}return best}
$(".art svg").forEach(svg=>{const pts=$(".pt",svg);if(!pts.length)return;
const order=pts.slice().sort((a,b)=>{const p=centre(a),q=centre(b);return p&&q?p[0]-q[0]||p[1]-q[1]:0});
order[0].tabIndex=0;
svg.addEventListener("pointermove",e=>{if(e.pointerType==="touch")return;const g=near(svg,e);g?show(g):hide()});
svg.addEventListener("pointerleave",e=>{if(e.pointerType!=="touch")hide()});
svg.addEventListener("click",e=>{const g=near(svg,e);if(g){e.stopPropagation();mark(+g.dataset.p);show(g)}});
order.forEach((g,i)=>{g.addEventListener("focus",()=>{order.forEach(o=>o.tabIndex=-1);g.tabIndex=0;show(g)});
g.addEventListener("blur",hide);g.addEventListener("keydown",e=>{
const to={ArrowRight:i+1,ArrowDown:i+1,ArrowLeft:i-1,ArrowUp:i-1,Home:0,End:order.length-1}[e.key];
if(to!==undefined){e.preventDefault();order[Math.max(0,Math.min(order.length-1,to))].focus()}
if(e.key==="Enter"||e.key===" "){e.preventDefault();mark(+g.dataset.p)}})})});
document.addEventListener("click",e=>{if(!e.target.closest(".art svg"))hide()});
document.addEventListener("keydown",e=>{if(e.key==="Escape"){hide();if(marked!==null)mark(marked)}});
$(".points tbody tr").forEach(r=>r.addEventListener("click",e=>{if(!e.target.closest("a"))mark(+r.dataset.p)}));
$("a[data-p]").forEach(a=>a.addEventListener("click",()=>{reset();if(marked!==+a.dataset.p)mark(+a.dataset.p)}));
$("thead th button").forEach(b=>b.addEventListener("click",()=>{
const h=b.parentElement,t=h.closest("table"),i=h.cellIndex,body=t.tBodies[0],was=h.getAttribute("aria-sort");
const words=h.dataset.k==="w",order=was?(was==="descending"?"ascending":"descending"):"ascending";
t.querySelectorAll("th").forEach(o=>o.removeAttribute("aria-sort"));h.setAttribute("aria-sort",order);
const sign=order==="ascending"?1:-1,value=r=>{const v=r.cells[i].dataset.v;return v===undefined||v===""?NaN:Number(v)};
const word=r=>r.cells[i].dataset.v??r.cells[i].textContent;
body.append(...[...body.rows].sort((a,b)=>{if(words)return sign*word(a).localeCompare(word(b),"en",{numeric:true});
const x=value(a),y=value(b);if(isNaN(x)||isNaN(y))return isNaN(x)-isNaN(y);return x===y?0:sign*(x<y?-1:1)}))}));
const knob=document.getElementById("knob"),front=document.getElementById("front"),
clear=document.getElementById("clear"),shown=document.getElementById("shown");
function filter(){let n=0;const rows=$(".points tbody tr"),off=new Set();rows.forEach(r=>{
const ok=(!knob.value||r.dataset.k===knob.value)&&(!front.checked||r.dataset.f==="1");r.hidden=!ok;
ok?n++:off.add(r.dataset.p)});shown.textContent=`${n} of ${rows.length} points`;
clear.disabled=n===rows.length;$("[data-p].pt,[data-p].of-b,[data-p].of-l,[data-p].of-r").forEach(e=>
e.classList.toggle("dim",off.has(e.dataset.p)))}
function reset(){if(knob){knob.value="";front.checked=false;filter()}}
if(knob){knob.addEventListener("change",filter);front.addEventListener("change",filter);
clear.addEventListener("click",reset);filter()}
$(".copy").forEach(b=>b.addEventListener("click",async()=>{const c=b.parentElement.querySelector("code");
try{await navigator.clipboard.writeText(c.textContent)}catch{const s=getSelection();s.selectAllChildren(c);
document.execCommand("copy")}b.textContent="Copied";setTimeout(()=>b.textContent="Copy",1500)}));
})();
"""

MEMBERS = {"certain": "on the front", "possible": "perhaps on the front", "dominated": "another is better",
           "failed": "failed"}


def page(report: Report, drawings: Mapping[str, Drawing], pictures: Sequence[Picture] = ()) -> str:
    """The page; no link leaves it, and nothing is fetched.

    Parameters
    ----------
    report : Report
    drawings : mapping of str to Drawing
        From `froxel_ref.report_plots.drawings`; without any, the page has its tables and says what would draw.
    pictures : sequence of Picture
        Of where the error lies (`froxel_ref.report_pictures.error_pictures`).

    Returns
    -------
    str
        HTML.

    Examples
    --------
    >>> from froxel_ref.report_record import Reference, Setup
    >>> setup = Setup("hall", "A hall.", "", (), "quick", (1, 1, 1), (1, 1), (1, 1), 1, 1, 0.01, 1.0, 60.0, "", {}, "",
    ...               0.0)
    >>> report = Report(setup, Reference("", 1e-4, 0.0, 0, 1, 0.0), (), (), None, None, None, (), (), None)
    >>> page(report, {}).startswith("<!doctype html>")
    True
    """
    theme = "".join(f"--p-{name}:light-dark({light},{dark});" for name, (light, dark) in THEME.items())
    sections = [  # id, heading, in the row of links; contents
        ("plots", "Error against time", "Plots", _plots(report, drawings)),
        ("points", "All points", "Points", _points(report)),
        ("equal", "Equal time, equal error", "Equal time", _equal(report)),
        ("budget", "Where the error comes from", "Budget", _shown(pictures) + _budget(report, drawings)),
        ("refinement", "Refinement", "Refinement", _refinement(report, drawings)),
        ("stages", "Run time by stage", "Stages", _drawn("stages", "Times of stages in the run that was least; “all "
                                                          "else” is what none of them took.", drawings)),
        ("left-out", "What was left out, and what it saved", "Left out", _left_out(report, drawings)),
        ("failures", "Failures", "Failures", _failures(report.points)),
        ("reading", "How to read this", "Reading", _reading(report)),
        ("machine", "Machine and versions", "Machine", _machine(report)),
    ]
    sections = [section for section in sections if section[3]]
    links = "".join(f'<a href="#{name}">{short}</a>' for name, _, short, _ in sections)
    body = "".join(f'<section id="{name}"><h2>{head}</h2>{inside}</section>' for name, head, _, inside in sections)
    data = json.dumps([_told(point) for point in report.points], ensure_ascii=False).replace("<", "\\u003c")
    setup = report.setup
    return "\n".join([
        '<!doctype html><html lang="en"><head><meta charset="utf-8">',
        '<meta name="viewport" content="width=device-width,initial-scale=1">',
        "<meta http-equiv=\"Content-Security-Policy\" content=\"default-src 'none'; style-src 'unsafe-inline'; "
        "script-src 'unsafe-inline'; img-src data:\">",
        f"<title>Error against run time: {_safe(setup.scene)}</title>",
        f"<style>{STYLE.replace('THEME', theme)}</style></head><body>",
        f"<header><h1>Error against run time: {_safe(setup.scene)}</h1>",
        f'<p class="soft">{_safe(setup.about)}</p><p>{_summary(report)}</p></header>',
        f'<nav aria-label="Sections"><div>{links}</div></nav>',
        f"<main>{_recommendation(report)}{_figures(report)}{body}</main>",
        f'<footer class="soft">Measured {_safe(_when(setup.begun))}; it took {_long_time(setup.took)}. '
        "The same figures as files: <code>report.json</code>, <code>points.csv</code>.</footer>",
        f'<div id="tip" role="status" hidden></div><script type="application/json" id="data">{data}</script>',
        f"<script>{SCRIPT}</script></body></html>", ""])


# --- words ------------------------------------------------------------------------------------------


def _safe(words: str) -> str:
    return html.escape(words, quote=True)


def _broken(words: str) -> str:
    """A name that may be broken behind its = and _."""
    return _safe(words).replace("=", "=<wbr>").replace("_", "_<wbr>")


def _num(text: str, unit: str = "") -> str:
    """A number and its unit that no line breaks."""
    return f'<span class="num">{text}{chr(0x202f) + unit if unit else ""}</span>'


def _count(number_of: int) -> str:
    return f"{number_of:,}".replace(",", "\u202f")


def _long_time(seconds: float) -> str:
    if not math.isfinite(seconds) or seconds < 60.0:
        return _num(number(seconds), "s")
    minutes = seconds / 60.0
    return _num(f"{minutes:.0f}", "min") if minutes < 90.0 else _num(f"{minutes / 60.0:.1f}", "h")


def _when(begun: str) -> str:
    """2026-03-01T12:00:00Z as 2026-03-01, 12:00 UTC."""
    day, t, rest = begun.partition("T")
    return f"{day}, {rest[:5]} UTC" if t and len(rest) >= 5 else begun or "at an unknown time"


def _many(count: int, one: str, more: str = "") -> str:
    return f"{count} {one if count == 1 else more or one + 's'}"


def _base(report: Report) -> Point | None:
    return next((point for point in report.points if point.knob == "base"), None)


def _find(report: Report, name: str | None) -> tuple[int, Point] | None:
    return next(((i, point) for i, point in enumerate(report.points) if point.id == name), None)


def _least(point: Point | None) -> float:
    return math.nan if point is None or point.seconds is None else point.seconds.least


def _over(a: float, b: float) -> float:
    return a / b if b > 0.0 else math.nan


def _times(value: float) -> str:
    return f"{number(value)}×" if math.isfinite(value) else "–"


def _failed(point: Point) -> bool:
    return point.member == "failed" or not math.isfinite(point.errors.relmse) or point.seconds is None


def _why(point: Point) -> str:
    return point.fault or point.errors.fault or "no reason given"


def _link(report: Report, name: str | None) -> str:
    found = _find(report, name)
    if found is None:
        return _safe(name) if name else "–"
    return f'<a href="#point-{found[0]}" data-p="{found[0]}">{_safe(found[1].id)}</a>'


def _told(point: Point) -> dict[str, object]:
    """What the label of a point says."""
    lines = []
    if point.seconds is not None:
        spread = point.seconds
        lines.append(f"{milliseconds(spread.least)} ms, median {milliseconds(spread.median)} ms of "
                     f"{_many(spread.runs, 'run')}")
    if _failed(point):
        lines.append(f"failed: {_why(point)}")
    if math.isfinite(point.errors.relmse):
        lines.append(f"relMSE {number(point.errors.relmse)}, mean |error| {percent(point.errors.absolute)}, "
                     f"bias {percent(point.errors.bias)}, largest "
                     f"{number(point.errors.maximum)}")
    if point.errors.flip is not None:
        lines.append(f"FLIP {number(point.errors.flip)}")
    if point.peak_bytes is not None:
        lines.append(f"{megabytes(point.peak_bytes)} MB at most")
    if not _failed(point):
        lines.append(MEMBERS.get(point.member, point.member))
    return {"id": point.id, "lines": lines, "set": _sets(point.overrides)}


def _sets(overrides: Iterable[str]) -> str:
    return " ".join(f"--set {shlex.quote(change)}" for change in overrides)


def _summary(report: Report) -> str:
    setup, points = report.setup, report.points
    good = [p for p in points if not _failed(p)]
    knobs = len({p.knob for p in points if p.knob != "base"})
    words = (f"{_many(len(points), 'choice')} of settings ({_many(knobs, 'knob')} turned one at a time or together, "
             f"suite <b>{_safe(setup.suite)}</b>) were timed at {_num(_by(setup.size))} pixels, and their images of "
             f"{_num(_by(setup.raster))} pixels compared with a converged reference")
    if not good:
        return f"{words}. None of them could be measured."
    times = [p.seconds.least for p in good if p.seconds is not None]
    errors = [p.errors.relmse for p in good]
    return (f"{words}: they take {_num(milliseconds(min(times)))} to {_num(milliseconds(max(times)), 'ms')} a frame, "
            f"with a relMSE of {_num(number(min(errors)))} to {_num(number(max(errors)))}.")


def _by(size: Iterable[int]) -> str:
    return "×".join(map(str, size))


# --- sections ---------------------------------------------------------------------------------------


def _recommendation(report: Report) -> str:
    advice = report.recommendation
    if advice is None:
        return ""
    command = " ".join(filter(None, ["froxel-ref render", shlex.quote(report.setup.source or report.setup.scene),
                                     _sets([*report.setup.overrides, *advice.overrides])]))
    steps = []
    if advice.up is not None:
        steps.append(f"More exact: {_link(report, advice.up)}.")
    if advice.down is not None:
        steps.append(f"Faster: {_link(report, advice.down)}.")
    head = (f"For {_safe(advice.limit)}: {_link(report, advice.point)}" if advice.met else
            f"Nothing meets {_safe(advice.limit)}; {_link(report, advice.point)} comes closest")
    return (f'<section class="card rec{"" if advice.met else " missed"}" id="recommendation"><h2>{head}</h2>'
            f'<p>{_safe(advice.words)}</p><div class="line"><code tabindex="0">{_safe(command)}</code>'
            '<button class="copy" type="button">Copy</button></div>'
            + (f"<p>{' '.join(steps)}</p>" if steps else "") + "</section>")


def _figures(report: Report) -> str:
    """The key figures, a tile each."""
    base, good = _base(report), [p for p in report.points if not _failed(p)]
    tiles = []
    if base is not None and not _failed(base):
        tiles.append(("base", _num(milliseconds(_least(base)), "ms"), f"relMSE {number(base.errors.relmse)}"))
    if good:
        fast, exact = min(good, key=_least), min(good, key=lambda p: p.errors.relmse)
        tiles.append(("fastest", _num(milliseconds(_least(fast)), "ms"), f"{_safe(fast.id)}, relMSE "
                      f"{number(fast.errors.relmse)}"))
        tiles.append(("most exact, relMSE", _num(number(exact.errors.relmse)), f"{_safe(exact.id)}, "
                      f"{milliseconds(_least(exact))}\u202fms"))
    sure, maybe = (sum(p.member == word for p in report.points) for word in ("certain", "possible"))
    tiles.append(("on the front", _num(str(sure)), f"and {maybe} perhaps, of {len(report.points)}"))
    tiles.append(("the reference’s own relMSE", _num(number(report.reference.floor)),
                  f"{report.reference.unconverged} of {_count(report.reference.pixels)} pixels did not converge"))
    saved = report.saved
    if saved is not None:
        tiles.append(("saved by leaving out", _num(_times(_over(saved.forced.least, saved.planned.least))),
                      f"in time, {_times(_over(saved.forced_bytes, saved.planned_bytes))} in memory"))
    fails = sum(map(_failed, report.points))
    if fails:
        tiles.append(("failed", f'<a class="num fail" href="#failures">{fails}</a>', f"of {len(report.points)}"))
    return '<dl class="figures">' + "".join(
        f"<div><dt>{name}</dt><dd>{value}<small>{words}</small></dd></div>" for name, value, words in tiles) + "</dl>"


def _drawn(name: str, words: str, drawings: Mapping[str, Drawing]) -> str:
    if name not in drawings:
        return ""
    plot = drawings[name]
    return (f'<figure id="plot-{name}"><div class="art wide">{plot.wide}</div><div class="art narrow">{plot.narrow}'
            f"</div><figcaption>{words}</figcaption></figure>")


def _plots(report: Report, drawings: Mapping[str, Drawing]) -> str:
    if not drawings:
        return ("" if plots_available() else
                "<p>The plots are missing: the extra <code>report</code> (Matplotlib) draws them.</p>")
    hint = "Point at a mark, tap it, or reach it by Tab and the arrow keys; a click marks its row in the table."
    return (_drawn("error-against-time", "A point lies at the least time of its runs; its bar ends where noise "
                   "is likely to end. The "
                   f"stepped line is the least error that is reached in so much time. {hint}", drawings)
            + _drawn("flip-against-time", "The same by FLIP, which weighs errors as an eye does; its front is its own.",
                     drawings))


def _points(report: Report) -> str:
    if not report.points:
        return ""
    base = _least(_base(report))
    flips = any(point.errors.flip is not None for point in report.points)
    heads = [("point", "its settings, beyond the base’s", "w lead"), ("knob", "what was turned", "w"),
             ("front", "of relMSE and time", "w"), ("time [ms]", "of a frame, the least of the runs", "n"),
             ("median [ms]", "of the runs", "n"),
             ("speed-up", "the base’s time over this one’s", "n"), ("relMSE", "mean of (a − b)²/(b² + ε)", "n"),
             ("mean |error|", "mean of |a − b|, over the mean of b", "n"),
             ("bias", "mean of a − b, over the mean of b", "n"),
             ("99.9th\u00a0pct.", "99.9th percentile of |a − b|, over the mean of b", "n"),
             ("largest", "largest |a − b|, over the mean of b", "n")]
    heads += [("FLIP", "mean HDR-FLIP", "n")] * flips
    heads += [("memory [MB]", "the most that arrays took at one moment", "n"),
              ("overrides", "what to give to --set", "w"), ("frames", "whose last was measured", "n"),
              ("runs", "timed runs", "n")]
    rows = "".join(_row(report, i, point, base, flips) for i, point in enumerate(report.points))
    knobs = "".join(f'<option value="{_safe(knob)}">{_safe(knob)}</option>'
                    for knob in dict.fromkeys(point.knob for point in report.points))
    return (f'<div class="tools"><label>knob <select id="knob"><option value="">all</option>{knobs}</select></label>'
            '<label><input type="checkbox" id="front"> front only</label>'
            '<button type="button" id="clear" disabled>show all</button>'
            f'<output id="shown" aria-live="polite">{_many(len(report.points), "point")}</output></div>'
            + _table(heads, rows, "points", tall=True, label="All points", sortable=True))


def _table(heads: Sequence[tuple[str, str, str]], rows: str, kind: str, *, tall: bool = False, label: str = "",
           sortable: bool = False, foot: str = "") -> str:
    """A table that scrolls within itself; heads are (words, explanation, classes: n for numbers, w for words)."""
    cells = "".join(
        f'<th scope="col" class="{marks}" data-k="{marks[0]}" title="{_safe(about)}">'
        + (f'<button type="button">{head}</button>' if sortable else head) + "</th>" for head, about, marks in heads)
    return (f'<div class="scroll{" tall" if tall else ""}" tabindex="0" role="region" aria-label="{_safe(label)}">'
            f'<table class="{kind}"><thead><tr>{cells}</tr></thead><tbody>{rows}</tbody>'
            + (f"<tfoot>{foot}</tfoot>" if foot else "") + "</table></div>")


def _n(value: float | None, text: str) -> str:
    """A cell with a number, and what it is sorted by."""
    key = "" if value is None or math.isnan(value) else "Infinity" if value == math.inf else repr(float(value))
    return f'<td class="n" data-v="{key}">{text}</td>'


def _row(report: Report, index: int, point: Point, base: float, flips: bool) -> str:
    spread, errors = point.seconds, point.errors
    speed = _over(base, _least(point))
    front = MEMBERS.get(point.member, point.member)
    if _failed(point):
        front = f'<b class="fail">failed</b><small>{_safe(_why(point))}</small>'
    elif point.member in ("certain", "possible"):
        front = f"<b>{front}</b>"
    cells = [f'<td class="lead" data-v="{_safe(point.id)}"><button type="button" class="pick" aria-pressed="false">'
             f"{_broken(point.id)}</button></td><td>{_safe(point.knob)}</td>"
             f'<td data-v="{list(MEMBERS).index(point.member) if point.member in MEMBERS else 9}">{front}</td>',
             _n(_least(point), milliseconds(spread.least if spread else None)),
             _n(spread.median if spread else None, milliseconds(spread.median if spread else None)),
             _n(speed, _times(speed)), _n(errors.relmse, number(errors.relmse)),
             _n(errors.absolute, percent(errors.absolute)), _n(errors.bias, percent(errors.bias)),
             _n(errors.quantile, number(errors.quantile)), _n(errors.maximum, number(errors.maximum))]
    if flips:
        cells.append(_n(errors.flip, number(errors.flip)))
    cells += [_n(point.peak_bytes, megabytes(point.peak_bytes)),
              f'<td class="mono">{"<br>".join(map(_safe, point.overrides)) or "–"}</td>',
              _n(point.frames, str(point.frames)),
              _n(spread.runs if spread else None, str(spread.runs) if spread else "–")]
    member = "1" if point.member in ("certain", "possible") else "0"
    return (f'<tr id="point-{index}" data-p="{index}" data-k="{_safe(point.knob)}" data-f="{member}">'
            + "".join(cells) + "</tr>")


def _equal(report: Report) -> str:
    if not report.equal_time and not report.equal_error:
        return ""
    base = _base(report)
    start = math.nan if base is None else base.errors.relmse
    parts = []
    if report.equal_time:
        rows = ""
        for row in report.equal_time:
            point = (_find(report, row.point) or (0, None))[1]
            error = math.nan if point is None else point.errors.relmse
            rows += ("<tr>" + _n(row.budget, milliseconds(row.budget)) + f"<td>{_link(report, row.point)}</td>"
                     + (_n(_least(point), milliseconds(_least(point))) + _n(error, number(error))
                        + _n(None, _times(_over(start, error))) if point else
                        '<td colspan="3" class="soft">no point is as fast</td>') + "</tr>")
        heads = [("at most [ms]", "a frame", "n"), ("most exact point", "", "w"), ("time [ms]", "least", "n"),
                 ("relMSE", "", "n"), ("less error", "the base’s relMSE over this one’s", "n")]
        parts.append("<div><h3>With so much time</h3>" + _table(heads, rows, "small", label="Equal time") + "</div>")
    if report.equal_error:
        rows = ""
        for target in report.equal_error:
            point = (_find(report, target.point) or (0, None))[1]
            error = math.nan if point is None else point.errors.relmse
            speed = _over(_least(base), _least(point))
            rows += ("<tr>" + _n(target.relmse, number(target.relmse)) + f"<td>{_link(report, target.point)}</td>"
                     + (_n(error, number(error)) + _n(_least(point), milliseconds(_least(point)))
                        + _n(speed, _times(speed)) if point else
                        '<td colspan="3" class="soft">no point is as exact</td>') + "</tr>")
        heads = [("relMSE at most", "", "n"), ("fastest point", "", "w"), ("relMSE", "", "n"),
                 ("time [ms]", "least", "n"), ("speed-up", "the base’s time over this one’s", "n")]
        parts.append("<div><h3>With so much error</h3>" + _table(heads, rows, "small", label="Equal error") + "</div>")
    return (f'<div class="pair">{"".join(parts)}</div><p class="soft">Less error and speed-up are against the base: '
            "above 1 is better.</p>")


def _shown(pictures: Sequence[Picture]) -> str:
    """Small pictures side by side, their pixels as squares."""
    if not pictures:
        return ""
    shots = "".join(
        f'<figure><img alt="{_safe(each.title)}: {_safe(each.words)}" src="data:image/png;base64,'
        f'{base64.b64encode(each.png).decode("ascii")}"><figcaption><b>{_safe(each.title)}</b> {_safe(each.words)}'
        "</figcaption></figure>" for each in pictures)
    return (f'<div class="shots">{shots}</div><p class="soft">Errors, and what single approximations add to them, over '
            f"√(b² + ε): blue where the frame is too dark, red where it is too bright, full colour from "
            f"{percent(FULL)} on.</p>")


def _budget(report: Report, drawings: Mapping[str, Drawing]) -> str:
    budget = report.budget
    if budget is None:
        return ""
    names = list(budget.region_totals)
    heads = [("part", "an approximation of the frame", "w lead"), ("share", "of the frame’s relMSE", "n"),
             ("alone", "its relMSE with everything else true", "n"),
             ("without", "relMSE with this part true, all others on", "n"),
             ("bias", "mean of what it adds, over the mean of the reference", "n")]
    heads += [(f"in {_safe(name)}", "its share there; regions add up to the share", "n") for name in names]
    heads.append(("what it is; its truth", "", "w wide-words"))
    rows = "".join(
        f'<tr><th scope="row" class="lead">{_safe(part.name)}</th>' + _n(part.share, percent(part.share))
        + _n(part.alone, number(part.alone)) + _n(part.without, number(part.without))
        + _n(part.bias, percent(part.bias))
        + "".join(_n(part.regions.get(name), percent(part.regions.get(name))) for name in names)
        + f"<td>{_safe(part.about)}<small>true: {_safe(part.truth)}</small></td></tr>" for part in budget.parts)
    blank = f'<td colspan="{2 + len(names)}"></td>'
    for name, share, relmse, words in (
            ("rest", budget.rest, budget.rest_relmse, "left when all parts are true: fine, but not infinitely so"),
            ("interaction", budget.interaction, budget.interaction_relmse,
             "what three and more parts do together; of two, each has half")):
        rows += (f'<tr><th scope="row" class="lead">{name}</th>' + _n(share, percent(share))
                 + _n(relmse, number(relmse)) + blank + f"<td>{words}</td></tr>")
    total = sum(part.share for part in budget.parts) + budget.rest + budget.interaction
    foot = (f'<tr><th scope="row" class="lead">together</th>{_n(total, percent(total))}'
            f"{_n(budget.total, number(budget.total))}<td></td><td></td>"
            + "".join(_n(v, percent(v)) for v in budget.region_totals.values())
            + "<td>the frame’s relMSE, and where in the image it is</td></tr>")
    return (_drawn("budget", "A share is the mean of what a part adds first, to a frame that is true otherwise, "
                   "and last, to one that is not; negative where it undoes what others do. The thin mark is what it "
                   "makes alone.", drawings)
            + f"<p>{_adds_up(report, total)}</p>" + _table(heads, rows, "small", label="Budget", foot=foot)
            + _regions(report))


def _adds_up(report: Report, total: float) -> str:
    budget = report.budget
    assert budget is not None
    if not math.isfinite(total):
        return "The parts could not be summed: some share is not a number."
    right = abs(total - 1.0) <= 5e-3
    words = (f"Shares ({_num(percent(sum(part.share for part in budget.parts)))}), rest "
             f"({_num(percent(budget.rest))}) and interaction ({_num(percent(budget.interaction))}) add up to "
             f"{_num(f'{total:.3f}')}" + (", as they must." if right else
                                          ': <b class="fail">they must add up to 1, so this budget is wrong.</b>'))
    claim = budget.claim
    if claim is None:
        return words
    gap = abs(math.sqrt(max(claim.claimed, 0.0)) - math.sqrt(max(claim.measured, 0.0)))
    held = gap <= claim.slack * (1.0 + 1e-6) + 1e-12
    return (f"{words} The check: with <b>{_safe(claim.name)}</b> true, {_num(number(claim.claimed))} of relMSE should "
            f"be left by the budget, and {_num(number(claim.measured))} is. The roots differ by {_num(number(gap))}; "
            "what this part does together with others explains up to "
            f"{_num(number(claim.slack))}: " + ('<b class="good">the claim holds</b>.' if held else
                                               '<b class="fail">the claim does not hold</b>.'))


def _regions(report: Report) -> str:
    budget = report.budget
    assert budget is not None
    if not budget.regions:
        return ""
    rows = ""
    for name, pixels in budget.regions.items():
        share = budget.region_totals.get(name, math.nan)
        worst = max(budget.parts, key=lambda part: part.regions.get(name, -math.inf), default=None)
        rows += (f'<tr><th scope="row">{_safe(name)}</th>' + _n(pixels, percent(pixels)) + _n(share, percent(share))
                 + _n(None, _times(_over(share, pixels))) + f"<td>{_safe(worst.name) if worst else '–'}</td></tr>")
    heads = [("region", "", "w"), ("of the pixels", "", "n"), ("of the error", "", "n"),
             ("against the mean", "share of the error over share of the pixels", "n"), ("largest part there", "", "w")]
    return "<h3>By region of the image</h3>" + _table(heads, rows, "small", label="Regions")


def _refinement(report: Report, drawings: Mapping[str, Drawing]) -> str:
    found = report.refinement
    if found is None:
        return ""
    words = "No order could be fitted: a level has no error."
    if found.order is not None:
        words = (f"Grid, maps and harmonics refined together, the frame tends to the reference by the order "
                 f"<b>{_num(f'{found.order:.2f}'.replace('-', '−'))}</b>: √relMSE goes with that power of the step.")
        if 0.0 < found.order < 50.0:
            words += f" With half the step it is {_num(number(2.0**found.order))} times smaller."
        if found.residual is not None:
            words += f" Levels lie within {_num(percent(math.expm1(min(found.residual, 99.0))))} (rms) of that line."
    if found.absolute_order is not None:
        words += (f" The mean absolute error tends to it by the order "
                  f"<b>{_num(f'{found.absolute_order:.2f}'.replace('-', '−'))}</b>, on which single pixels on edges of "
                  "light have less hold.")
    rows, before = "", None
    for level in found.levels:
        errors = level.errors
        local = math.nan
        if before is not None and before.step > level.step > 0.0 and all(
                0.0 < e < math.inf for e in (before.errors.relmse, errors.relmse)):
            fall = math.log(before.errors.relmse) - math.log(errors.relmse)
            local = 0.5 * fall / (math.log(before.step) - math.log(level.step))
        rows += (f'<tr><th scope="row" class="lead">{_safe(level.label)}</th>' + _n(level.step, number(level.step))
                 + _n(errors.relmse, number(errors.relmse) + (f"<small>{_safe(errors.fault)}</small>"
                                                              if errors.fault else ""))
                 + _n(local, f"{local:.2f}" if math.isfinite(local) else "–")
                 + _n(errors.absolute, percent(errors.absolute)) + _n(errors.bias, percent(errors.bias))
                 + _n(errors.quantile, number(errors.quantile)) + _n(errors.maximum, number(errors.maximum))
                 + _n(errors.flip, number(errors.flip)) + "</tr>")
        before = level
    heads = [("level", "", "w lead"), ("step", "over the coarsest level’s", "n"), ("relMSE", "", "n"),
             ("order", "of √relMSE, from the level above", "n"), ("mean |error|", "", "n"),
             ("bias", "", "n"), ("99.9th pct.", "", "n"),
             ("largest", "", "n"), ("FLIP", "", "n")]
    return (f"<p>{words}</p>" + _drawn("refinement", "The dashed line is the fit.", drawings)
            + _table(heads, rows, "small", label="Refinement"))


def _left_out(report: Report, drawings: Mapping[str, Drawing]) -> str:
    parts = []
    saved = report.saved
    if saved is not None:
        same = ("All results are the same, bit for bit." if saved.same else
                '<b class="fail">Results are not the same bit for bit.</b>')
        parts.append(
            f"<p>With everything forced on, the same frame takes "
            f"{_num(_times(_over(saved.forced.least, saved.planned.least)))} the time and "
            f"{_num(_times(_over(saved.forced_bytes, saved.planned_bytes)))} the memory. {same}</p>"
            + _drawn("planned", "Bars are the least of the runs.", drawings))

        def row(name: str, spread: Spread, size: int) -> str:
            return (f'<tr><th scope="row">{name}</th>' + _n(spread.least, milliseconds(spread.least))
                    + _n(spread.median, milliseconds(spread.median)) + _n(spread.runs, str(spread.runs))
                    + _n(size, megabytes(size)) + "</tr>")

        heads = [("frame", "", "w"), ("time [ms]", "least of the runs", "n"), ("median [ms]", "", "n"),
                 ("runs", "", "n"), ("memory [MB]", "the most that arrays took at one moment", "n")]
        parts.append(_table(heads, row("as planned", saved.planned, saved.planned_bytes)
                            + row("all forced on", saved.forced, saved.forced_bytes), "small", label="Saved"))
        parts.append(_list("Stages, and parts of stages, that do not run", saved.left_out))
    parts.append(_list("Knobs that this scene does not need", report.left_out))
    if report.budget is not None:
        parts.append(_list("Approximations that this frame does not make", report.budget.left_out))
    return "".join(parts)


def _list(head: str, items: Sequence[LeftOut]) -> str:
    if not items:
        return ""
    rows = "".join(f"<li><b>{_safe(item.name)}</b>: {_safe(item.why)}</li>" for item in items)
    return f'<h3>{head}</h3><ul class="plain">{rows}</ul>'


def _failures(points: Sequence[Point]) -> str:
    rows = "".join(
        f'<li><a class="fail" href="#point-{i}" data-p="{i}"><b>{_safe(point.id)}</b></a>: {_safe(_why(point))}'
        + (f" (after {_num(milliseconds(_least(point)), 'ms')} a frame)" if point.seconds else "") + "</li>"
        for i, point in enumerate(points) if _failed(point))
    if not rows:
        return ""
    return ("<p>They are crosses in the plots: at the upper edge without an error, at the right edge without a time."
            "</p>"
            f'<ul class="plain">{rows}</ul>')


def _reading(report: Report) -> str:
    setup, reference = report.setup, report.reference
    flip = (f"HDR-FLIP [Andersson 2021], mean of the image, at {_num(number(setup.pixels_per_degree))} pixels "
            "per degree of view" if not setup.flip else f"not taken: {_safe(setup.flip)}")
    entries = [
        ("reference", f"{_safe(reference.about)} It took {_long_time(reference.seconds)}. Its own relMSE, by its "
         f"estimate of its error, is {_num(number(reference.floor))}: below it nothing can be told from the truth. "
         f"{reference.unconverged} of {_count(reference.pixels)} pixels did not reach the relative tolerance of "
         f"{_num(number(reference.rtol))}."),
        ("relMSE", f"mean of (a − b)²/(b² + ε) over pixels and channels, ε = {_num(number(setup.epsilon))}; a is the "
         f"frame, b the reference, both radiance times the exposure {_num(number(setup.exposure))}"),
        ("mean |error|", "mean of |a − b| over the mean of b: a few pixels that are far off count by how far they "
         "are, not by its square"),
        ("bias", "mean of a − b over the mean of b: whether the frame is too bright or too dark on the whole"),
        ("99.9th pct., largest", "of |a − b|, over the mean of b"),
        ("FLIP", flip),
        ("time", f"of a whole frame, warm, all stages, of {_num(_by(setup.size))} pixels and "
         f"{_num(_by(setup.grid))} froxels unless a knob turns them; least and median of up to "
         f"{_many(setup.repeats, 'run')}. The least is the best estimate on a machine that does other things too; the "
         "bar from there is what these add: to the median, and at least to "
         f"{_num(f'{setup.noise:.2f}')} times the least, below which nine of ten points have their median"),
        ("errors of", f"images of {_num(_by(setup.raster))} pixels, the same view, apart from the timed "
         f"runs. Points that average over time are the last of {_many(setup.frames, 'frame')}"),
        ("front", "points that no other beats in both time and relMSE. Certain: whatever the noise of times, within "
         "their bars; possible: it depends on that noise"),
        ("memory", "the most bytes that arrays took at one moment of a frame; 1 MB is 10⁶ bytes"),
    ]
    return '<dl class="list">' + "".join(f"<dt>{name}</dt><dd>{words}</dd>" for name, words in entries) + "</dl>"


def _machine(report: Report) -> str:
    setup = report.setup
    entries = [*setup.machine.items(), ("overrides of the scene’s file", " ".join(setup.overrides) or "none"),
               ("scene and settings, SHA-256", setup.scene_digest)]
    return '<dl class="list">' + "".join(f"<dt>{_safe(name)}</dt><dd>{_safe(value)}</dd>"
                                         for name, value in entries) + "</dl>"
