"""The style sheet and the script of a report's page, as text that stands in it."""

from __future__ import annotations

from froxel_ref.report_sheet import THEME

__all__ = ["SCRIPT", "STYLE"]

_RULES = """
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
header{padding-top:1.6rem;overflow-wrap:anywhere}
h1{font-size:1.7rem;line-height:1.2;margin:0 0 .3rem;letter-spacing:-.01em}
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
# By light and by dark, as the drawings know them.
_COLOURS = "".join(f"--p-{name}:light-dark({light},{dark});" for name, (light, dark) in THEME.items())

STYLE = _RULES.replace("THEME", _COLOURS)

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
