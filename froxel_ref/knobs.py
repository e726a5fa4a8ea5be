"""What a report turns: each knob with its steps, and whether a scene has a use for it.

A step is a handful of overrides (`froxel_ref.overrides`), so that what is measured can be typed after ``--set``.
To add a knob, write a function of the base's scene and settings that gives its steps, and list it in `KNOBS`.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from fractions import Fraction
from typing import Any, NamedTuple

from froxel_ref.budget import mixes_phases
from froxel_ref.frame import Plan
from froxel_ref.overrides import override
from froxel_ref.presets import preset
from froxel_ref.records import InputError, from_json, shown, suggest, to_json
from froxel_ref.scene import Scene
from froxel_ref.scene_files import Document
from froxel_ref.settings import DISTRIBUTIONS, SWITCHES, Settings

__all__ = ["KNOBS", "SUITES", "Knob", "Step", "changed", "chosen", "own_knob"]

SUITES = ("quick", "full")
"""How much a report measures: what takes minutes, or all of it."""

Need = tuple[bool, str]

LARGEST_MAP, LARGEST_ATLAS = 4096, 16384


class Step(NamedTuple):
    """One position of a knob.

    Attributes
    ----------
    label : str
        In a few characters.
    overrides : tuple of str
        What to change of the base's settings.
    frames : int or None
        Frames to average, where that is what the step is about; else as many as the report takes.
    quick : bool
        Whether the quick suite has it.
    """

    label: str
    overrides: tuple[str, ...]
    frames: int | None = None
    quick: bool = False


class Knob(NamedTuple):
    """Something about a frame that costs time and buys exactness.

    Attributes
    ----------
    name : str
    about : str
        A clause.
    steps : callable
        From the base's settings to its positions; that of the base may be among them, and is left out.
    needed : callable
        From scene, settings and the base's plan to whether the scene has a use for it, and why.
    """

    name: str
    about: str
    steps: Callable[[Settings], Sequence[Step]]
    needed: Callable[[Scene, Settings, Plan], Need]


def changed(settings: Settings, overrides: Sequence[str]) -> Settings:
    """Settings with overrides applied.

    Parameters
    ----------
    settings : Settings
    overrides : sequence of str
        Each ``path=value``, with or without ``settings.`` in front.

    Returns
    -------
    Settings

    Raises
    ------
    InputError
        Anything that is not allowed; a path into the scene.

    Examples
    --------
    >>> changed(Settings(), ["grid.depth=32", "emission=published"]).grid.depth
    32
    """
    before: dict[str, Any] = {"name": ""}
    raw: Any = {"schema": 1, "scene": before, "settings": to_json(settings)}
    for text in overrides:
        refused = InputError(text.partition("=")[0].strip(), "is of the scene, must be a setting: errors are taken "
                                                             "against one truth")
        try:
            raw = override(Document, raw, text)
        except InputError as error:
            # Of lists in the scene nothing is known here, and to say so would mislead.
            raise (refused if re.match(r"scene\b", error.place) else error) from None
        if raw["scene"] is not before:
            raise refused
    return from_json(Document, raw).settings


# --- whether a scene has a use for a knob -------------------------------------------------------------


def _runs(stage: str) -> Callable[[Scene, Settings, Plan], Need]:
    def needed(scene: Scene, settings: Settings, planned: Plan) -> Need:
        return planned[stage].runs, planned[stage].why

    return needed


def _always(scene: Scene, settings: Settings, planned: Plan) -> Need:
    return True, "every scene has it"


def _mixed(scene: Scene, settings: Settings, planned: Plan) -> Need:
    several = mixes_phases(scene)
    return several, "media of different anisotropy" if several else "all media have the same anisotropy"


def _fogged(scene: Scene, settings: Settings, planned: Plan) -> Need:
    part = next(part for part in planned["apply"].parts if part.name == "fog lookup")
    return part.runs, part.why


# --- steps -------------------------------------------------------------------------------------------


def _grid(settings: Settings) -> list[Step]:
    width, height = settings.grid.width, settings.grid.height
    return [Step(f"{w}x{h}", (f"grid.width={w}", f"grid.height={h}"), quick=share in (Fraction(1, 2), Fraction(3, 2)))
            for share in map(Fraction, ("1/4", "1/2", "3/4", "3/2", "2"))
            for w, h in [(max(1, round(width * share)), max(1, round(height * share)))]]


def _slices(settings: Settings) -> list[Step]:
    depth = settings.grid.depth
    return [Step(str(n), (f"grid.depth={n}",), quick=share in (Fraction(1, 4), Fraction(1, 2), Fraction(2)))
            for share in map(Fraction, ("1/8", "1/4", "1/2", "3/2", "2", "4")) for n in [max(1, round(depth * share))]]


def _distribution(settings: Settings) -> list[Step]:
    return [Step(name, (f"grid.distribution={name}",), quick=True) for name in DISTRIBUTIONS]


def _both(settings: Settings) -> list[Step]:
    """Grid and slices together: what a budget is spent on."""
    grid = settings.grid
    return [Step(f"{w}x{h}x{d}", (f"grid.width={w}", f"grid.height={h}", f"grid.depth={d}"),
                 quick=(across, deep) in ((Fraction(1, 2), Fraction(1, 2)), (Fraction(3, 2), Fraction(2))))
            for across in map(Fraction, ("1/4", "1/2", "3/4", "3/2", "2"))
            for deep in map(Fraction, ("1/4", "1/2", "2", "4")) if 1 / 8 <= across * across * deep <= 8
            for w, h, d in [(max(1, round(grid.width * across)), max(1, round(grid.height * across)),
                             max(1, round(grid.depth * deep)))]]


def _switch(name: str, *quick: str) -> Callable[[Settings], list[Step]]:
    def steps(settings: Settings) -> list[Step]:
        return [Step(value, (f"{name}={value}",), quick=value in quick) for value in dict.fromkeys(SWITCHES[name])]

    return steps


def _shadows(settings: Settings) -> list[Step]:
    """Sizes, filters and kinds of shadow maps."""
    maps = settings.shadow_maps
    names = ("directional_size", "spot_size", "point_size")
    steps = []
    for share in map(Fraction, ("1/4", "1/2", "2")):
        sizes = [max(32, int(getattr(maps, name) * share) // 8 * 8) for name in names]
        steps.append(Step(f"maps x{share}", tuple(f"shadow_maps.{name}={size}" for name, size in
                                                  zip(names, sizes, strict=True)), quick=share == Fraction(1, 2)))
    return [*steps, Step("nearest texel", ("shadow_maps.kernel=0",)), Step("kernel 3", ("shadow_maps.kernel=3",)),
            Step("octahedral", ("shadow_maps.point_map=octahedral",)),
            Step("exponential", ("shadow_maps.technique=exponential",), quick=True),
            Step("exact", ("shadows=exact",))]


def _opacity(settings: Settings) -> list[Step]:
    """Harmonics, readings, sizes and kinds of opacity maps; rays instead of maps."""
    maps = settings.opacity_maps
    series = () if maps.technique == "fourier" else ("opacity_maps.numbers=null", "opacity_maps.technique=fourier")
    steps = [Step(f"K={k}", (*series, f"opacity_maps.harmonics={k}"), quick=k in (1, 7)) for k in (1, 2, 3, 5, 7, 15)]
    steps += [Step(name, (*series, f"opacity_maps.reconstruction={name}"), quick=name == "resolved")
              for name in ("lanczos", "resolved")]
    for share in map(Fraction, ("1/2", "2")):
        sizes = {name: min(LARGEST_ATLAS if name == "atlas" else LARGEST_MAP, int(getattr(maps, name) * share))
                 for name in ("small", "large", "atlas", "smallest", "directional_size")}
        if sizes["smallest"] >= max(8, 3 * maps.gutter):
            steps.append(Step(f"tiles x{share}", tuple(f"opacity_maps.{name}={n}" for name, n in sizes.items())))
    rivals = (("slices", 8, True), ("slices", 32, False), ("cosine", 8, False), ("cosine", 16, False),
              ("power", 7, True), ("trigonometric", 7, False))
    for kind, numbers, quick in rivals:
        # Readings that only a Fourier series has are not kept.
        steps.append(Step(f"{kind} {numbers}", (
            "opacity_maps.reconstruction=fourier", f"opacity_maps.technique={kind}", f"opacity_maps.numbers={numbers}"),
            quick=quick))
    return [*steps, Step("float16", ("opacity_maps.storage=float16",)), Step("exact", ("volumetric_shadows=exact",))]


def _temporal(settings: Settings) -> list[Step]:
    """Filters, weights and numbers of frames."""
    scattering, a = "temporal.filter=scattering", "temporal.alpha={}".format
    return [Step("scattering, α 0.2", (scattering, a(0.2)), quick=True),
            Step("scattering, α 0.2, 4 frames", (scattering, a(0.2)), frames=4),
            Step("scattering, α 0.05, mean", (scattering, a(0.05), "temporal.start=mean"), quick=True),
            Step("scattering, α 0.05, mean, 4 frames", (scattering, a(0.05), "temporal.start=mean"), frames=4),
            Step("scattering, α 0.05", (scattering, a(0.05))),
            Step("unphased, α 0.2", ("temporal.filter=unphased", a(0.2))),
            Step("media, α 0.2", ("temporal.filter=media", a(0.2))),
            Step("scattering, α 0.2, clamp", (scattering, a(0.2), "temporal.clamp=range")),
            Step("off", ("temporal.filter=off",))]


def _checkerboard(settings: Settings) -> list[Step]:
    other = "false" if settings.checkerboard else "true"
    return [Step("off" if settings.checkerboard else "on", (f"checkerboard={other}",)),
            Step("on, α 0.2", ("checkerboard=true", "temporal.filter=scattering", "temporal.alpha=0.2"), quick=True)]


def _merged(settings: Settings) -> list[Step]:
    other = not settings.merged
    return [Step("on" if other else "off", (f"merged={'true' if other else 'false'}",), quick=True)]


def _lookup(settings: Settings) -> list[Step]:
    return [Step("trilinear", ("fog_lookup.method=trilinear",)),
            Step("biquadratic", ("fog_lookup.method=biquadratic",), quick=True),
            Step("noisy", ("fog_lookup.method=noisy", "fog_lookup.stored=linear"), quick=True),
            Step("noisy, tone-mapped", ("fog_lookup.method=noisy", "fog_lookup.stored=tone_mapped")),
            Step("bias 1", ("fog_lookup.bias=1",)), Step("bias 0", ("fog_lookup.bias=0",)),
            Step("at centres", ("lookup=centre",))]


def _long_range(settings: Settings) -> list[Step]:
    steps = [Step(f"{n} steps", (f"long_range.steps={n}",), quick=n in (4, 64)) for n in (2, 4, 8, 16, 32, 64)]
    return [*steps, Step("without noise", ("long_range.noise=false",), quick=True),
            Step("off", ("long_range.march=false",), quick=True)]


def _precision(settings: Settings) -> list[Step]:
    stored = tuple(f"{name}.storage=float16" for name in ("fog_lookup", "opacity_maps", "taa"))
    return [Step("float32", ("precision=float32",), quick=True), Step("float64", ("precision=float64",)),
            Step("float32, stored as float16", ("precision=float32", *stored), quick=True)]


def _taa(settings: Settings) -> list[Step]:
    return [Step("on", ("taa.on=true",), quick=True), Step("on, α 0.05", ("taa.on=true", "taa.alpha=0.05")),
            Step("off", ("taa.on=false",))]


def _fidelity(settings: Settings) -> list[Step]:
    return [Step(name, (f"fidelity={name}",), quick=name == "published")
            for name in ("corrected", "published", "author")]


def _whole(settings: Settings) -> list[Step]:
    whole = tuple(text.removeprefix("settings.") for text in preset("thesis"))
    return [Step("thesis", whole), Step("thesis, published", (*whole, "fidelity=published"))]


KNOBS: tuple[Knob, ...] = (
    Knob("grid", "froxels across and down", _grid, _runs("integrate")),
    Knob("slices", "froxels in depth", _slices, _runs("integrate")),
    Knob("grid and slices", "both together", _both, _runs("integrate")),
    Knob("distribution", "how slices share the depth", _distribution, _runs("integrate")),
    Knob("integrator", "of a slice", _switch("integrator", "published", "linear"), _runs("integrate")),
    Knob("phase", "several media's phase functions in one froxel", _switch("phase_mixing", "mean", "mixture"), _mixed),
    Knob("shadows", "of surfaces", _shadows, _runs("shadow")),
    Knob("opacity maps", "shadows of media and particles", _opacity, _runs("fom")),
    Knob("temporal", "the average of froxels over frames", _temporal, _runs("integrate")),
    Knob("checkerboard", "every second froxel of a frame", _checkerboard, _runs("integrate")),
    Knob("merged", "media and lighting slab by slab", _merged, _runs("integrate")),
    Knob("lookup", "how the fog is looked up", _lookup, _fogged),
    Knob("long range", "the march behind the froxels", _long_range, _runs("long_range")),
    Knob("precision", "types of the arithmetic and of what is stored", _precision, _always),
    Knob("anti-aliasing", "the average of the image over frames", _taa, _always),
    Knob("fidelity", "as it is right, or as the sources have it", _fidelity, _always),
    Knob("whole", "every stage of the thesis", _whole, _runs("integrate")),
)
"""In the order of a frame."""


def own_knob(text: str) -> Knob:
    """A knob of one's own.

    Parameters
    ----------
    text : str
        ``path=value,value,…``: a setting, and what it is turned to.

    Returns
    -------
    Knob
        Named as the setting, needed by every scene.

    Raises
    ------
    InputError
        No ``=``, or no value.

    Examples
    --------
    >>> [step.overrides for step in own_knob("grid.far=16,32").steps(Settings())]
    [('grid.far=16',), ('grid.far=32',)]
    """
    path, equals, values = text.partition("=")
    path = path.strip()
    if not (equals and path):
        raise InputError("--sweep", f"is {shown(text)}, must be path=value,value,…")
    listed = _listed(values)
    if not listed:
        raise InputError("--sweep", f"is {shown(text)}: an empty sweep, must have a value at least")
    name = path.removeprefix("settings.")
    return Knob(name, "as asked for", lambda settings: [Step(v, (f"{name}={v}",), quick=True) for v in listed], _always)


def _listed(values: str) -> list[str]:
    """Values between commas; commas within JSON lists do not part them."""
    found, depth = [""], 0
    for letter in values:
        depth += (letter in "[{") - (letter in "]}")
        if letter == "," and not depth:
            found.append("")
        else:
            found[-1] += letter
    return [value.strip() for value in found if value.strip()]


def chosen(names: Sequence[str] | None) -> tuple[Knob, ...]:
    """Knobs by their names, in the order of `KNOBS`; all of them unless names are given.

    Raises
    ------
    InputError
        An unknown name, or none.

    Examples
    --------
    >>> [knob.name for knob in chosen(["slices", "grid"])]
    ['grid', 'slices']
    """
    if names is None:
        return KNOBS
    known = [knob.name for knob in KNOBS]
    for name in names:
        if name not in known:
            raise InputError("--knobs", f"has {shown(name)}; {suggest(name, known)}")
    if not names:
        raise InputError("--knobs", f"is empty, must name some of {', '.join(known)}")
    return tuple(knob for knob in KNOBS if knob.name in names)
