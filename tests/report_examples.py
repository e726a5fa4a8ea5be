"""Reports made up for the tests of what is written of them: no number in them was measured."""

from __future__ import annotations

import math

import numpy as np

from froxel_ref.report_record import (
    AtError,
    AtTime,
    Budget,
    BudgetPart,
    Claim,
    Errors,
    LeftOut,
    Level,
    Point,
    Recommendation,
    Reference,
    Refinement,
    Report,
    Saved,
    Setup,
    Spread,
)

NONE = Errors(math.nan, math.nan, math.nan, math.nan)

KNOBS: dict[str, tuple[str, tuple[float, ...], str]] = {
    # knob: path, values, what it does to (time, error) as powers of value/base
    "slices": ("grid.depth", (8, 16, 32, 64, 128, 256), "both"),
    "across": ("grid.width", (40, 80, 160, 320), "both"),
    "shadow_maps": ("shadows.size", (256, 512, 1024, 2048), "error"),
    "harmonics": ("opacity_maps.harmonics", (1, 3, 7, 15), "error"),
    "integrator": ("switches.integrator", (0, 1, 2, 3), "little"),
    "storage": ("storage", (0, 1, 2), "little"),
    "jitter": ("temporal.jitter", (0, 1), "little"),
    "taps": ("fog_lookup.taps", (1, 4), "time"),
    "raymarch": ("long_range.steps", (8, 16, 32, 64), "time"),
}
WORDS = {"integrator": ("published", "simple", "linear", "gauss"), "storage": ("full", "float16", "r11g11b10"),
         "jitter": ("off", "on")}


def setup(**changed: object) -> Setup:
    """What was measured, with some fields changed."""
    values = {
        "scene": "thesis-hall", "about": "A hall of pillars in fog, under a sun and twelve lamps.",
        "scene_digest": "9f2c" * 16, "overrides": ("volumetric_shadows=maps",), "suite": "full",
        "grid": (160, 90, 64), "size": (960, 540), "raster": (240, 135), "repeats": 9, "frames": 16, "epsilon": 0.01,
        "exposure": 1.7, "pixels_per_degree": 11.2, "flip": "",
        "machine": {"processor": "Example 9000 at 3.2 GHz", "cores": "8", "system": "Linux 6.1", "froxel-ref": "0.9.0",
                    "Python": "3.11.9", "NumPy": "2.1.0", "SciPy": "1.14.0"},
        "begun": "2026-03-01T12:00:00Z", "took": 1834.2}
    return Setup(**(values | changed))  # type: ignore[arg-type]


REFERENCE = Reference("Single scattering, converged to a relative error of 1e-5, with exact shadows.", 1e-5, 3.1e-7, 12,
                      32400, 412.7)


def rich() -> Report:
    """Some 40 points over 10 knobs, two of which failed, and everything else that a report may hold."""
    random = np.random.default_rng(7)
    points = [_point(random, "base", "base", (), 0.031, 2.1e-3, "possible")]
    for knob, (path, values, effect) in KNOBS.items():
        for i, value in enumerate(values):
            words = WORDS[knob][i] if knob in WORDS else f"{value:g}"
            turn = math.log2((value or 0.5) / values[len(values) // 2]) if knob not in WORDS else i - 1.0
            pull = {"both": (0.75, -1.3), "error": (0.12, -0.9), "time": (0.3, -0.2), "little": (0.06, 0.1)}[effect]
            noise = random.normal(0.0, 0.12, 2).tolist()
            seconds = 0.03 * 2.0 ** (pull[0] * turn + noise[0])
            relmse = 2e-3 * 2.0 ** (pull[1] * turn + noise[1])
            points.append(_point(random, knob, words, (f"{path}={words}",), seconds, relmse, ""))
    points.append(Point("media=exact", "media", "exact", ("volumetric_shadows=exact",), 1, NONE, None, {}, None,
                        "failed", "refused: 8.2 GB of arrays, more than the 4 GB that are allowed"))
    points.append(Point("albedo_at_zero=divide", "albedo_at_zero", "divide", ("albedo_at_zero=divide",), 1,
                        NONE._replace(fault="NaN in 1,204 of 32,400 pixels"), Spread(0.0302, 0.0311, 9),
                        {"media": 0.01, "integrate": 0.02}, 61_000_000, "failed", "NaN in 1,204 of 32,400 pixels"))
    points = _judged(points)
    front = [p for p in points if p.member in ("certain", "possible")]

    def exact(seconds: float) -> str | None:
        these = [p for p in front if p.seconds is not None and p.seconds.median <= seconds]
        return min(these, key=lambda p: p.errors.relmse).id if these else None

    def fast(relmse: float) -> str | None:
        return next((p.id for p in front if p.errors.relmse <= relmse), None)

    return Report(
        setup(), REFERENCE, tuple(points),
        (LeftOut("checkerboard", "the scene has one frame only"), LeftOut("scrolling", "no texture moves")),
        budget(), refinement(),
        Saved((LeftOut("raymarch", "nothing lies beyond the grid"), LeftOut("taa", "switched off"),
               LeftOut("lighting: spot lights", "there are none")),
              Spread(0.031, 0.0334, 9), Spread(0.0712, 0.0733, 9), 58_200_000, 131_000_000, True),
        tuple(AtTime(seconds, exact(seconds)) for seconds in (0.001, 1.0 / 60.0, 1.0 / 30.0, 0.1)),
        tuple(AtError(relmse, fast(relmse)) for relmse in (1e-2, 3e-3, 1e-3, 1e-6)),
        Recommendation("33.3 ms a frame", True, front[-4].id, front[-4].overrides, front[-2].id, front[-5].id,
                       "Takes 6 % longer than the base and has half of its error. The next step up takes 42 % longer "
                       "for a quarter less error."))


def _point(random: np.random.Generator, knob: str, label: str, overrides: tuple[str, ...], seconds: float,
           relmse: float, member: str) -> Point:
    root = math.sqrt(relmse)
    shares = {"media": 0.16, "lighting": 0.41, "shadow": 0.2, "integrate": 0.11, "fom": 0.05, "surface": 0.03,
              "culling": 0.012, "apply": 0.018}
    stages = {name: seconds * share for name, share in shares.items()}
    errors = Errors(relmse, -0.21 * root, 4.0 * root, 11.0 * root, 0.9 * root)
    return Point("base" if knob == "base" else f"{knob}={label}", knob, label, overrides, 16 if knob == "jitter" else 1,
                 errors, Spread(seconds, seconds * (1.02 + abs(float(random.normal(0.0, 0.05)))), 9), stages,
                 int(5.8e7 * (seconds / 0.031)), member)


def _judged(points: list[Point]) -> list[Point]:
    """With the members of the front, by the least time; every third of them only possibly; in order of time."""
    best, judged, count = math.inf, [], 0
    for point in sorted(points, key=lambda p: p.seconds.least if p.seconds else math.inf):
        if point.member != "failed":
            member = "dominated"
            if point.errors.relmse < best:
                best, count = point.errors.relmse, count + 1
                member = "possible" if count % 3 == 0 else "certain"
            point = point._replace(member=member)
        judged.append(point)
    return judged


def budget() -> Budget:
    """Shares, rest and interaction add up to 1, and so do regions; one share is negative."""
    regions = {"sky": 0.31, "surfaces in fog": 0.52, "edges": 0.17}
    shares = {"slices": (0.1, 0.28, 0.12), "shadow maps": (0.02, 0.17, 0.11), "opacity maps": (0.04, 0.09, 0.02),
              "bilinear lookup": (0.01, 0.03, 0.06), "half floats": (-0.01, -0.03, -0.02)}
    parts = tuple(
        BudgetPart(name, f"what {name} add to the image", f"the truth in place of {name}",
                   2.1e-3 * abs(sum(split)) * factor, 2.1e-3 * (1.0 - sum(split)), sum(split), -0.02 * sum(split),
                   dict(zip(regions, split, strict=True)))
        for (name, split), factor in zip(shares.items(), (1.1, 0.7, 1.4, 0.6, 0.3), strict=True))
    rest = 0.035
    return Budget(2.1e-3, parts, (LeftOut("particles", "the scene has none"),), rest, 4.1e-5,
                  1.0 - rest - sum(part.share for part in parts), 1.9e-5, Claim("slices", 1.08e-3, 1.05e-3, 2.2e-3),
                  regions, {"sky": 0.2, "surfaces in fog": 0.5, "edges": 0.3})


def refinement() -> Refinement:
    """Five levels that tend to the reference by the order 1.9, about."""
    errors = [0.2 * step**1.9 * wobble for step, wobble in zip((1.0, 0.5, 0.25, 0.125, 0.0625),
                                                               (1.0, 1.05, 0.94, 1.03, 1.0), strict=True)]
    levels = tuple(Level(f"{40 << i}×{23 << i}×{16 << i}, maps {128 << i}", 0.5**i,
                         Errors(e * e, -0.1 * e, 3.0 * e, 9.0 * e))
                   for i, e in enumerate(errors))
    return Refinement(levels, 1.9, 0.04)


def minimal() -> Report:
    """The least that a report can be: two points, no budget, no refinement, no FLIP."""
    base = Point("base", "base", "base", (), 1, Errors(1e-3, 0.01, 0.2, 0.4), Spread(0.02, 0.02, 1), {}, None,
                 "certain")
    half = Point("slices=32", "slices", "32", ("grid.depth=32",), 1, Errors(4e-3, 0.02, 0.3, 0.5),
                 Spread(0.011, 0.012, 3), {"media": 0.004}, 12_000_000, "certain")
    return Report(setup(flip="the package flip-evaluator is missing", suite="quick", overrides=()), REFERENCE,
                  (base, half), (), None, None, None, (), (), None)


def extreme() -> Report:
    """Times from 0.1 ms to 1000 s, errors from 0 to 10, NaN, infinity, markup in names, a floor of 0."""
    times = 10.0 ** np.linspace(-4.0, 3.0, 15)
    errors = [10.0, 3.0, 1.0, 0.1, 1e-2, 1e-3, 1e-4, 1e-6, 1e-8, 1e-9, 1e-10, 1e-11, 1e-12, 0.0, math.inf]
    points = [Point(f"knob{i}=<b>&\"{i}", f"knob{i}", f"<b>&\"{i}", (f"a.b={i}", 'scene.name="it\'s <here>"'), 1,
                    Errors(e, -e, e, e, None if i % 2 else min(e, 1.0)), Spread(float(t), float(t) * 1.5, 3),
                    {"media": float(t)}, 10 ** (i % 12), "certain" if math.isfinite(e) else "failed",
                    "" if math.isfinite(e) else "infinite")
              for i, (t, e) in enumerate(zip(times, errors, strict=True))]
    points[5] = points[5]._replace(id="a_knob_with_a_name=that is far too long to stand beside a mark on any sheet")
    points += [Point(f"late={i}", "late", str(i), (), 1, NONE, None, {}, None, "failed", f"refused for reason {i}")
               for i in range(4)]
    points.append(Point("base", "base", "base", (), 1, NONE._replace(fault="no image"), Spread(0.5, 0.6, 3), {}, 0,
                        "failed", "no image"))
    points.append(Point("untimed", "late", "untimed", (), 1, Errors(1e-5, 0.0, 0.0, 0.0), None, {}, None, "failed",
                        "ran out of time"))
    return Report(setup(scene="<script>alert(1)</script>"), REFERENCE._replace(floor=0.0), tuple(points), (),
                  Budget(math.nan, (), (), math.nan, math.nan, math.nan, math.nan, None, {}, {}),
                  Refinement((Level("only", 1.0, NONE),), None, None), None,
                  (AtTime(1e-5, None),), (AtError(0.0, None),),
                  Recommendation("relMSE at most 1e-20", False, points[3].id, points[3].overrides, None, None,
                                 "None is as exact as that."))


def beyond_sense() -> Report:
    """Numbers that no measurement gives, and names that no font has: a page must come of it all the same."""
    report = rich()
    assert report.budget is not None
    assert report.saved is not None
    odd = (0.0, -1.0, math.nan, math.inf, -math.inf, 1e-300, 1e300)
    errors = [Errors(v, v, v, v, v) for v in odd]
    points = [report.points[i]._replace(id=f"$a$\n{name}{i}", errors=errors[i], member="certain", peak_bytes=10**15,
                                        seconds=Spread(odd[-1 - i], odd[i], 3), stages={"日本": odd[i]})
              for i, name in enumerate(("", "é\t", "日本語", "w" * 120, "_^{", "\\$", "%s"))]
    part = report.budget.parts[0]
    return report._replace(
        points=tuple(points), reference=REFERENCE._replace(floor=math.inf),
        budget=report.budget._replace(total=1e-300, parts=tuple(
            part._replace(name="$", alone=v, share=v, regions=dict.fromkeys(part.regions, v)) for v in odd)),
        refinement=Refinement(tuple(Level("$x$", abs(v), e) for v, e in zip(odd, errors, strict=True)), 1e300, 1e300),
        saved=report.saved._replace(planned=Spread(0.0, math.nan, 0), forced=Spread(math.inf, 1e300, 0),
                                    planned_bytes=0))


EXAMPLES = {"rich": rich, "minimal": minimal, "extreme": extreme}
