"""The page of a report: what it says, and how it behaves in a real browser."""

from __future__ import annotations

import html
import html.parser
import re
import shlex
import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest
from report_examples import EXAMPLES, beyond_sense, extreme, rich

from froxel_ref import report_choices
from froxel_ref.report_html import page
from froxel_ref.report_numbers import megabytes, milliseconds, number
from froxel_ref.report_plots import Drawing, drawings, plots_available
from froxel_ref.report_sheet import NARROW, WIDE

NAMES = tuple(EXAMPLES)
WIDTHS = (1280, 390)


def whole(name: str) -> str:
    report = EXAMPLES[name]()
    return page(report, drawings(report) if plots_available() else {})


@pytest.fixture(scope="module")
def pages() -> dict[str, str]:
    """The page of each example, made once."""
    return {name: whole(name) for name in NAMES}


class Read(html.parser.HTMLParser):
    """Text that is shown, links, sources and ids of a page; ends that do not match a start are faults."""

    VOID = ("meta", "br", "input", "path", "use", "link", "img", "rect", "wbr")

    def __init__(self, text: str) -> None:
        super().__init__()
        self.words, self.links, self.ids, self.faults = [], [], [], []
        self.open: list[str] = []
        self.feed(text.replace("<wbr>", ""))  # where a name may break, and still is one word
        self.text = re.sub(r"\s+", " ", " ".join(self.words))

    def handle_starttag(self, tag, attributes):
        known = dict(attributes)
        self.links += [known[key] for key in ("href", "src", "xlink:href", "action") if key in known]
        self.ids += [known["id"]] if "id" in known else []
        if tag not in self.VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag, attributes):
        self.handle_starttag(tag, attributes)
        if tag not in self.VOID:
            self.open.pop()

    def handle_endtag(self, tag):
        if tag in self.VOID:
            return
        if not self.open or self.open[-1] != tag:
            self.faults.append(tag)
        else:
            self.open.pop()

    def handle_data(self, data):
        if not {"style", "script"} & set(self.open):
            self.words.append(data)


# --- what it says -----------------------------------------------------------------------------------


@pytest.mark.parametrize("name", NAMES)
def test_the_page_is_whole_and_needs_nothing_but_itself(pages, name: str):
    read = Read(pages[name])
    assert read.faults == []
    assert read.open == []
    assert len(read.ids) == len(set(read.ids))
    assert all(link.startswith("#") for link in read.links)
    assert {link[1:] for link in read.links if link != "#"} <= set(read.ids)
    assert "default-src 'none'" in pages[name]


@pytest.mark.parametrize("name", NAMES)
def test_every_point_and_every_failure_with_its_reason_is_said(pages, name: str):
    text = Read(pages[name]).text
    for point in EXAMPLES[name]().points:
        assert point.id in text
        if point.member == "failed":
            assert f"{point.id} : {point.fault or point.errors.fault}" in text  # in the list, not only in the table


def test_markup_in_names_stays_text(pages):
    assert "<script>alert" not in pages["extreme"]
    assert "<b>&" not in pages["extreme"]
    assert "<script>alert(1)</script>" in Read(pages["extreme"]).text


def test_numbers_beyond_sense_still_make_a_page():
    report = beyond_sense()
    read = Read(page(report, drawings(report) if plots_available() else {}))
    assert read.faults == []
    assert all(re.sub(r"\s+", " ", point.id) in read.text for point in report.points)


def test_the_budgets_sentences_are_true():
    text = Read(page(rich(), {})).text
    assert "add up to 1.000 , as they must." in text
    assert "The two are within 10 % of the frame’s own" in text.replace("\u202f", " ")
    budget = rich().budget
    off = budget._replace(rest=budget.rest + 0.1, claim=budget.claim._replace(measured=2.0 * budget.total),
                          parts=(budget.parts[0]._replace(without=2.0 * budget.total), *budget.parts[1:]))
    text = Read(page(rich()._replace(budget=off), {})).text
    assert "add up to 1.100 : they must add up to 1, so this budget is wrong." in text
    assert "They are far apart" in text
    assert f"Made true by themselves, {off.parts[0].name} would make the frame less exact" in text
    assert "share is not a number" in Read(page(extreme(), {})).text


def test_gain_and_speed_up_are_against_the_base():
    report = rich()
    base = report.points[[p.knob for p in report.points].index("base")]
    text = Read(re.search(r'<section id="equal">.*?</section>', page(report, {}), re.DOTALL)[0]).text
    told = {p.id: p for p in report.points}
    ms, plain = milliseconds, number
    for row in report.equal_error:
        if row.point is not None:
            seconds, relmse = told[row.point].seconds.least, told[row.point].errors.relmse
            assert (f"{plain(row.relmse)} {row.point} {plain(relmse)} {ms(seconds)} "
                    f"{plain(base.seconds.least / seconds)}×") in text
    for row in report.equal_time:
        if row.point is not None:
            seconds, relmse = told[row.point].seconds.least, told[row.point].errors.relmse
            bar = f"{ms(seconds)} to {ms(told[row.point].seconds.end)}"
            assert (f"{ms(row.budget)} {row.point} {bar} {plain(relmse)} "
                    f"{plain(base.errors.relmse / relmse)}×") in text
    assert text.count("no point is") == 2


def test_the_command_can_be_copied_into_a_shell():
    report = extreme()
    found = re.search(r'<code tabindex="0">(.*?)</code>', page(report, {}))
    words = shlex.split(html.unescape(found[1]))
    assert words[:3] == ["froxel-ref", "render", report.setup.scene]
    sets = [words[i + 1] for i, word in enumerate(words) if word == "--set"]
    assert sets == [*report.setup.overrides, *report.recommendation.overrides]


def test_without_matplotlib_the_page_has_its_tables_and_one_line(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(report_choices, "plots_available", lambda: False)
    text = page(rich(), {})
    assert "<svg" not in text
    assert "The plots are missing, the extra report draws them: python -m pip install" in re.sub(r"</?code>", "", text)
    assert all(point.id in text for point in rich().points)


def test_a_report_without_budget_and_more_has_no_empty_sections(pages):
    read = Read(pages["minimal"])
    assert not {"budget", "refinement", "equal", "left-out", "failures", "recommendation"} & set(read.ids)
    assert "FLIP not taken: the package flip-evaluator is missing" in read.text


# --- in a browser -----------------------------------------------------------------------------------

ARGUMENTS = ("--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-background-networking",
             "--disable-component-update", "--disable-sync")


class Shown:
    """A page in a browser, what it complained of, and what it asked for."""

    def __init__(self, context, path: Path) -> None:
        self.complaints: list[str] = []
        self.requests: list[str] = []
        self.page = context.new_page()
        self.page.on("console", lambda message: self.complaints.append(message.text))
        self.page.on("pageerror", lambda error: self.complaints.append(str(error)))
        self.page.on("request", lambda request: self.requests.append(request.url))
        self.page.goto(path.as_uri())

    def __call__(self, script: str, argument: object = None):
        return self.page.evaluate(script, argument)


@pytest.fixture(scope="module")
def contexts(pages, tmp_path_factory: pytest.TempPathFactory) -> Iterator:
    """Makes a browser's page of an example: ``open(name, width, scheme, touch)``."""
    program = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
    if program is None:
        pytest.skip("no chromium, chromium-browser or google-chrome here")
    playwright = pytest.importorskip("playwright.sync_api", reason="the package playwright (extra browser) is missing")
    if not plots_available():
        pytest.skip("matplotlib (extra report) is missing")
    folder = tmp_path_factory.mktemp("pages")
    for name, text in pages.items():
        (folder / f"{name}.html").write_text(text, encoding="utf-8")
    with playwright.sync_playwright() as play:
        browser = play.chromium.launch(executable_path=program, args=list(ARGUMENTS))  # its profile is new and empty
        made = []

        def show(name: str, width: int = 1280, scheme: str = "light", touch: bool = False) -> Shown:
            size = {"width": width, "height": 900}
            context = browser.new_context(viewport=size, color_scheme=scheme, has_touch=touch)
            made.append(context)
            return Shown(context, folder / f"{name}.html")

        yield show
        for context in made:
            context.close()
        browser.close()


@pytest.fixture(scope="module")
def shown(contexts) -> dict[tuple[str, int], Shown]:
    """Every example by light at both widths, for tests that only look."""
    return {(name, width): contexts(name, width) for name in NAMES for width in WIDTHS}


EVERY = [(name, width) for name in NAMES for width in WIDTHS]


@pytest.mark.parametrize("which", EVERY, ids=str)
def test_nothing_is_complained_of_and_nothing_fetched(shown, which):
    assert shown[which].complaints == []
    assert [url for url in shown[which].requests if not url.startswith("file:")] == []
    assert len(shown[which].requests) == 1


@pytest.mark.parametrize("which", EVERY, ids=str)
def test_the_page_never_scrolls_sideways(shown, which):
    wide, room = shown[which]("[document.documentElement.scrollWidth, document.documentElement.clientWidth]")
    assert wide <= room
    over = shown[which]("""() => [...document.querySelectorAll("main *, header *")].filter(e => {
        const r = e.getBoundingClientRect();
        return r.width && r.right > innerWidth + 1 && !e.closest(".scroll, .line code, nav, svg") })
        .map(e => e.outerHTML.slice(0, 80))""")
    assert over == []


@pytest.mark.parametrize("which", EVERY, ids=str)
def test_plots_have_text_of_ten_pixels_and_none_that_overlaps(shown, which):
    # Height of a line of text, from the size of its letters and the scale of the drawing.
    small, count, clashes = shown[which]("""() => {
        const all = [...document.querySelectorAll(".art svg text")].filter(t => t.getClientRects().length);
        const size = t => parseFloat(getComputedStyle(t).fontSize) * t.getScreenCTM().a;
        const small = all.filter(t => size(t) < 10).map(t => [t.textContent, size(t)]);
        const clashes = [];
        document.querySelectorAll(".art svg").forEach(svg => {
            const these = all.filter(t => t.closest("svg") === svg).map(t => [t, t.getBoundingClientRect()]);
            these.forEach(([t, a], i) => these.slice(i + 1).forEach(([u, b]) => {
                const x = Math.min(a.right, b.right) - Math.max(a.left, b.left);
                const y = Math.min(a.bottom, b.bottom) - Math.max(a.top, b.top);
                if (x > 1 && y > 0.35 * Math.min(a.height, b.height)) clashes.push([t.textContent, u.textContent])
            })) });
        return [small, all.length, clashes] }""")
    assert count > 10
    assert small == []
    assert clashes == []


@pytest.mark.parametrize("which", EVERY, ids=str)
def test_every_failure_can_be_seen(shown, which):
    report = EXAMPLES[which[0]]()
    text = re.sub(r"\s+", " ", shown[which]("document.body.innerText"))
    for index, point in enumerate(report.points):
        if point.member != "failed":
            continue
        assert f"{point.id}: {point.fault or point.errors.fault}" in text
        assert shown[which](f"""[...document.querySelectorAll('#plot-error-against-time .pt[data-p="{index}"]')]
            .filter(e => e.getClientRects().length && e.getBoundingClientRect().width > 4).length""") == 1


CONTRAST = """() => {
    const parse = c => { const m = c.match(/[\\d.]+/g).map(Number); return [m[0], m[1], m[2], m[3] ?? 1] };
    const over = (a, b) => [0, 1, 2].map(i => a[i] * a[3] + b[i] * (1 - a[3])).concat(1);
    const linear = v => v <= 0.04045 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4;
    const light = c => { const l = c.slice(0, 3).map(v => linear(v / 255));
        return 0.2126 * l[0] + 0.7152 * l[1] + 0.0722 * l[2] };
    const ground = e => { const layers = [];
        for (; e; e = e.parentElement) { const c = parse(getComputedStyle(e).backgroundColor);
            layers.push(c); if (c[3] === 1) break }
        return layers.reverse().reduce((below, c) => over(c, below), [255, 255, 255, 1]) };
    const bad = []; let count = 0;
    document.querySelectorAll("body, body *").forEach(e => {
        if (["SCRIPT", "STYLE"].includes(e.tagName) || !e.getClientRects().length) return;
        if (![...e.childNodes].some(n => n.nodeType === 3 && n.textContent.trim())) return;
        const style = getComputedStyle(e), drawn = e instanceof SVGElement;
        const colour = parse(drawn ? style.fill : style.color);
        const back = ground(drawn ? e.closest("svg").parentElement : e);
        let alpha = 1;
        for (let o = e; o && o !== document.body; o = o.parentElement) alpha *= +getComputedStyle(o).opacity;
        colour[3] *= alpha;
        const [a, b] = [light(over(colour, back)), light(back)].sort((x, y) => y - x), ratio = (a + 0.05) / (b + 0.05);
        count++; if (ratio < 4.5 && !e.disabled) bad.push([e.tagName, e.textContent.slice(0, 40), ratio]) });
    return [bad, count] }"""


@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("name", ["rich", "extreme"])
def test_text_can_be_read(contexts, name: str, scheme: str):
    # WCAG 2.2, 1.4.3; a marked row and the label of a point count too.
    seen = contexts(name, scheme=scheme)
    seen.page.locator(".points tbody tr").first.click()
    seen.page.locator("#plot-error-against-time .wide .pt").first.focus()
    bad, count = seen(CONTRAST)
    assert bad == []
    assert count > 200
    paper = seen("getComputedStyle(document.body).backgroundColor")
    assert (sum(map(int, re.findall(r"\d+", paper))) > 380) == (scheme == "light")


def column(seen: Shown, index: int) -> list[str]:
    return seen(f"""[...document.querySelectorAll(".points tbody tr")].filter(r => !r.hidden)
        .map(r => r.cells[{index}].innerText)""")


def head(seen: Shown, words: str) -> int:
    return seen("""words => [...document.querySelectorAll(".points thead th")]
        .findIndex(h => h.innerText.startsWith(words))""", words)


def test_numbers_are_sorted_as_numbers_and_what_is_missing_comes_last(contexts):
    seen = contexts("extreme")
    at = head(seen, "time [ms]")
    button = seen.page.locator(".points thead th").nth(at).locator("button")
    button.click()
    times = column(seen, at)
    expected = sorted(p.seconds.least for p in extreme().points if p.seconds)
    assert times[:len(expected)] == [milliseconds(t) for t in expected]
    assert set(times[len(expected):]) == {"–"}
    assert seen("document.querySelector('.points th[aria-sort]').getAttribute('aria-sort')") == "ascending"
    button.click()
    times = column(seen, at)
    assert times[:len(expected)] == [milliseconds(t) for t in expected[::-1]]
    assert set(times[len(expected):]) == {"–"}
    at = head(seen, "relMSE")
    seen.page.locator(".points thead th").nth(at).locator("button").click()
    assert column(seen, at)[:2] == ["0", "1.00×10⁻¹²"]


@pytest.mark.parametrize("width", WIDTHS)
def test_overrides_stand_in_one_line_as_a_shell_reads_them(contexts, width: int):
    seen = contexts("extreme", width)
    at = head(seen, "overrides")
    lines = seen(f"""[...document.querySelectorAll(".points tbody tr")].map(r => {{ const words = new Range();
        words.selectNodeContents(r.cells[{at}]);
        return new Set([...words.getClientRects()].map(line => Math.round(line.top))).size }})""")
    assert set(lines) == {1}
    told = [tuple(shlex.split(words)) for words in column(seen, at)]
    assert told == [point.overrides or ("–",) for point in extreme().points]
    assert max(map(len, told)) > 1


def test_words_are_sorted_as_words_with_their_numbers(contexts):
    seen = contexts("rich")
    seen.page.locator(".points thead button").first.click()
    names = column(seen, 0)
    assert [name for name in names if name.startswith("slices")] == [f"slices={n}" for n in (8, 16, 32, 64, 128, 256)]
    assert names == sorted(names, key=lambda s: [int(w) if w.isdigit() else w for w in re.split(r"(\d+)", s)])
    seen.page.locator(".points thead button").first.click()
    assert column(seen, 0) == names[::-1]


def test_rows_are_filtered_by_knob_and_front(contexts):
    seen, report = contexts("rich"), rich()
    seen.page.select_option("#knob", "slices")
    assert sorted(column(seen, 0)) == sorted(p.id for p in report.points if p.knob == "slices")
    seen.page.check("#front")
    left = sorted(p.id for p in report.points if p.knob == "slices" and p.member in ("certain", "possible"))
    assert sorted(column(seen, 0)) == left
    assert seen.page.inner_text("#shown") == f"{len(left)} of {len(report.points)} points"
    assert seen("document.querySelectorAll('#plot-error-against-time .wide .pt:not(.dim)').length") == len(left)
    seen.page.click("#clear")
    assert len(column(seen, 0)) == len(report.points)
    assert seen("document.querySelectorAll('.dim').length") == 0


PLACE = """(index) => { const all = [...document.querySelectorAll(`#plot-error-against-time .pt[data-p="${index}"]`)];
    const e = all.find(e => e.getClientRects().length); e.scrollIntoView({block: "center"});
    const r = e.getBoundingClientRect(); return [r.left + r.width / 2, r.top + r.height / 2] }"""


def first(name: str = "rich") -> tuple[int, str]:
    """A point that stands by itself: the fastest."""
    points = EXAMPLES[name]().points
    best = min((i for i, p in enumerate(points) if p.seconds), key=lambda i: points[i].seconds.least)
    return best, points[best].id


def test_a_label_comes_with_the_mouse_and_goes_with_it(contexts):
    seen = contexts("rich")
    index, name = first()
    tip = seen.page.locator("#tip")
    assert not tip.is_visible()
    x, y = seen(PLACE, index)
    seen.page.mouse.move(x + 3.0, y + 2.0)
    assert tip.is_visible()
    text = tip.inner_text()
    point = rich().points[index]
    for words in (name, milliseconds(point.seconds.least), number(point.errors.relmse),
                  megabytes(point.peak_bytes), f"--set {point.overrides[0]}"):
        assert words in text
    inside = seen("""() => { const r = document.getElementById("tip").getBoundingClientRect();
        return r.left >= 0 && r.right <= innerWidth && r.top >= 0 && r.bottom <= innerHeight }""")
    assert inside
    seen.page.mouse.move(5.0, 5.0)
    assert not tip.is_visible()


def test_a_label_comes_with_the_focus_of_the_keyboard(contexts):
    seen = contexts("rich")
    seen.page.locator("#plot-error-against-time").evaluate(
        "e => { const f = document.createElement('a'); f.href = '#'; f.id = 'before'; e.before(f); f.focus() }")
    seen.page.keyboard.press("Tab")
    tip = seen.page.locator("#tip")
    assert tip.is_visible()
    name = first()[1]
    assert name in tip.inner_text()
    seen.page.keyboard.press("ArrowRight")
    assert tip.is_visible()
    assert tip.inner_text().split("\n")[0] != name
    seen.page.keyboard.press("Enter")
    assert seen("document.querySelectorAll('.points tr.on').length") == 1
    seen.page.keyboard.press("Escape")
    assert not tip.is_visible()
    assert seen("document.querySelectorAll('.points tr.on').length") == 0


def test_a_label_comes_with_a_tap_on_a_phone(contexts):
    seen = contexts("rich", 390, touch=True)
    index, name = first()
    x, y = seen(PLACE, index)
    seen.page.touchscreen.tap(x + 4.0, y - 3.0)
    tip = seen.page.locator("#tip")
    assert tip.is_visible()
    assert name in tip.inner_text()
    left, right = seen("(() => { const r = document.getElementById('tip').getBoundingClientRect(); "
                       "return [r.left, r.right] })()")
    assert left >= 0.0
    assert right <= 390.0
    assert seen("document.querySelector('.points tr.on').dataset.p") == str(index)


def test_a_row_marks_its_point_and_a_point_its_row(contexts):
    seen = contexts("rich")
    index, _ = first()
    seen.page.locator(f"#point-{index} .pick").click()
    assert seen("document.querySelectorAll('#plot-error-against-time .wide .halo.on').length") == 1
    assert seen(f"document.querySelector('#point-{index} .pick').getAttribute('aria-pressed')") == "true"
    x, y = seen(PLACE, index)
    halo = seen("(() => { const r = document.querySelector('#plot-error-against-time .wide .halo.on')"
                ".getBoundingClientRect(); return [r.left + r.width / 2, r.top + r.height / 2] })()")
    assert halo == pytest.approx([x, y], abs=2.0)
    seen.page.mouse.click(x, y)
    assert seen("document.querySelectorAll('.points tr.on').length") == 0
    seen.page.mouse.click(x, y)
    assert seen("[...document.querySelectorAll('.points tr.on')].map(r => r.dataset.p)") == [str(index)]


def test_each_width_has_its_own_drawing(shown):
    for width, kind in ((1280, "wide"), (390, "narrow")):
        seen = shown["rich", width]("[...document.querySelectorAll('.art')].filter(e => e.getClientRects().length)"
                                    ".map(e => e.className)")
        assert set(seen) == {f"art {kind}"}
    assert WIDE > NARROW
    assert Drawing._fields == ("wide", "narrow")


def test_heads_stay_while_a_table_scrolls(contexts):
    seen = contexts("rich")
    gap = seen("""() => { const s = document.querySelector(".scroll.tall"); s.scrollTop = 200; s.scrollLeft = 100;
        const t = s.getBoundingClientRect(), h = s.querySelector("th").getBoundingClientRect();
        return [s.scrollTop, h.top - t.top, h.left - t.left] }""")
    assert gap == pytest.approx([200.0, 1.0, 1.0], abs=1.5)


def test_print_has_every_row_and_no_tools(contexts):
    seen = contexts("rich", 390)
    seen.page.emulate_media(media="print")
    assert not seen.page.locator(".tools").first.is_visible()
    assert not seen.page.locator("nav").is_visible()
    assert seen("(() => { const s = document.querySelector('.scroll.tall'); "
                "return s.scrollHeight - s.clientHeight })()") <= 1
    assert seen.page.locator("#plot-budget .wide").is_visible()
