"""The error budget: one approximation of the frame at a time replaced by its truth.

A *part* is one way in which the frame departs from the truth, with a function that turns settings into those without
it: a fine enough grid, exact shadows, no filter. With F(S) the image whose parts in S are approximate and T the truth,
part i adds a_i = F(only i) − F(none) to a frame that is true otherwise, and m_i = F(all) − F(all but i) to one that is
approximate otherwise. The error e = F(all) − T is taken apart as

    e = Σ_i s_i + r + x,    s_i = ½(a_i + m_i),    r = F(none) − T,

where r is what the replacements, fine but not infinitely so, leave. If parts interact in pairs at most,
F(S) = F(none) + Σ_i a_i + Σ_{i<j} b_ij, then m_i = a_i + Σ_j b_ij, so that each of two gets half of what they do
together, and x is nothing: s_i is then the mean of what i adds over all orders in which parts may be switched on
[Shapley 1953]. x is what three and more do together. In the inner product ⟨u, v⟩ = mean of u·v/(T² + ε), in which
relMSE is ⟨e, e⟩, the shares ⟨s_i, e⟩/⟨e, e⟩, those of r and of x add up to 1. Where F(only i) would take too long, s_i
is m_i.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace as with_fields
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from froxel_ref.frame import Plan
from froxel_ref.media import contributing
from froxel_ref.report_record import Budget, BudgetPart, Claim, LeftOut
from froxel_ref.scene import Scene
from froxel_ref.settings import SWITCHES, FogLookup, LongRange, Settings, Switches, Temporal, replace

__all__ = ["Part", "added", "all_true", "make_budget", "mixes_phases", "only", "parts_of"]

Image = NDArray[np.float64]


class Part(NamedTuple):
    """One approximation.

    Attributes
    ----------
    name, about : str
    truth : str
        What replaces it, in words.
    replaced : callable
        From settings to settings without this approximation; of several, the order does not matter.
    """

    name: str
    about: str
    truth: str
    replaced: Callable[[Settings], Settings]


# --- the parts ------------------------------------------------------------------------------------------


def parts_of(scene: Scene, settings: Settings, planned: Plan, *, raster: tuple[int, int], refine: int = 4
             ) -> tuple[tuple[Part, ...], tuple[LeftOut, ...]]:
    """The approximations that a frame makes, and those that it does not.

    Parameters
    ----------
    scene : Scene
    settings : Settings
    planned : Plan
        Of the two.
    raster : tuple of int
        Width and height of the images: with a column of froxels for each pixel nothing is left to interpolate
        across.
    refine : int
        Slices of the replacement for each of the frame's.

    Returns
    -------
    parts : tuple of Part
    left_out : tuple of LeftOut

    Examples
    --------
    >>> from froxel_ref.frame import plan
    >>> kept, left = parts_of(Scene(), Settings(), plan(Scene()), raster=(16, 9))
    >>> [part.name for part in kept], left[0]
    ([], LeftOut(name='depth', why='the scene has no medium with extinction or emission'))
    """
    fogged = planned["integrate"].runs, planned["integrate"].why
    found: list[tuple[Part, bool, str]] = [
        (Part("depth", f"{settings.grid.depth} slices", f"{refine * settings.grid.depth} slices",
              lambda how: _gridded(how, depth=refine * settings.grid.depth)), *fogged),
        (Part("lateral", f"{settings.grid.width}x{settings.grid.height} froxels across", "one for each pixel",
              lambda how: _gridded(how, width=raster[0], height=raster[1])), *fogged),
        (Part("opaque shadows", "maps", "a ray from every point", lambda how: replace(how, shadows="exact")),
         planned["shadow"].runs, planned["shadow"].why),
        (Part("volumetric shadows", f"maps, {settings.opacity_maps.harmonics} harmonics", "a ray from every point",
              lambda how: replace(how, volumetric_shadows="exact")), planned["fom"].runs, planned["fom"].why),
        (Part("phase", "one g a froxel", "the exact mixture (D12)", lambda how: replace(how, phase_mixing="mixture")),
         *_mixes(scene, settings, planned)),
        (Part("departures", f"fidelity {settings.fidelity}, switches", "all corrected", _corrected),
         *_departs(settings)),
        (Part("temporal filter", f"{settings.temporal.filter}, α = {settings.temporal.alpha:g}", "one centred sample",
              lambda how: replace(how, temporal=Temporal())), *_turned_on(
                  settings.temporal.filter != "off" and fogged[0], fogged)),
        (Part("checkerboard", "every second froxel", "every froxel", lambda how: replace(how, checkerboard=False)),
         *_turned_on(settings.checkerboard and fogged[0], fogged)),
        (Part("lookup", settings.fog_lookup.method, "one trilinear fetch",
              lambda how: replace(how, fog_lookup=_plain(how))), *_looked_up(settings, fogged)),
        (Part("long range", f"{settings.long_range.steps} steps", f"{16 * settings.long_range.steps} steps, no noise",
              lambda how: replace(how, long_range=_long(settings, how))),
         planned["long_range"].runs, planned["long_range"].why),
        (Part("particles' light", "at their centres", "at every point",
              lambda how: replace(how, particles_lit_at="pixel")),
         bool(scene.all_particles) and settings.particles_lit_at == "centre",
         "it is at every point" if scene.all_particles else "the scene has no particles"),
        (Part("storage", "as stored", "float64 throughout", _stored), *_rounds(settings)),
        (Part("anti-aliasing", "the image averaged over frames", "pixels' centres",
              lambda how: replace(how, taa=with_fields(how.taa, on=False))), settings.taa.on, "it is off"),
    ]
    return (tuple(part for part, there, _ in found if there),
            tuple(LeftOut(part.name, why) for part, there, why in found if not there))


def _gridded(how: Settings, **changes: Any) -> Settings:
    return replace(how, grid=with_fields(how.grid, **changes))


def _plain(how: Settings) -> FogLookup:
    return with_fields(how.fog_lookup, method="trilinear", bias=None, stored="linear")


def _long(base: Settings, how: Settings) -> LongRange:
    return with_fields(how.long_range, steps=16 * base.long_range.steps, noise=False)


def _corrected(how: Settings) -> Settings:
    # The mixture of phase functions is a part of its own.
    return replace(how, fidelity="corrected", switches=Switches(phase_mixing=how.phase_mixing))


def _stored(how: Settings) -> Settings:
    return replace(how, precision="float64", fog_lookup=with_fields(how.fog_lookup, storage="full"),
                   taa=with_fields(how.taa, storage="full"), opacity_maps=with_fields(how.opacity_maps, storage="full"))


def _turned_on(there: bool, fogged: tuple[bool, str]) -> tuple[bool, str]:
    return there, "it is off" if fogged[0] else fogged[1]


def mixes_phases(scene: Scene) -> bool:
    """Whether media that scatter differ in their anisotropy."""
    media = contributing((*scene.global_media, *scene.local_media))
    return len({medium.phase_anisotropy for medium in media if any(medium.albedo)}) > 1


def _mixes(scene: Scene, settings: Settings, planned: Plan) -> tuple[bool, str]:
    lit = planned["merged" if settings.merged else "lighting"]
    if not lit.runs:
        return False, lit.why
    if not mixes_phases(scene):
        return False, "all media that scatter have the same anisotropy"
    return settings.phase_mixing != "mixture", "the mixture is exact"


def _departs(settings: Settings) -> tuple[bool, str]:
    others = [name for name in SWITCHES if name != "phase_mixing" and getattr(settings, name) != SWITCHES[name][0]]
    return bool(others), "every switch is as corrected"


def _looked_up(settings: Settings, fogged: tuple[bool, str]) -> tuple[bool, str]:
    how = settings.fog_lookup
    plain = how.method == "trilinear" and not how.bias and how.stored == "linear"
    return not plain and fogged[0], "it is one trilinear fetch" if fogged[0] else fogged[1]


def _rounds(settings: Settings) -> tuple[bool, str]:
    full = all(each.storage == "full" for each in (settings.fog_lookup, settings.taa, settings.opacity_maps))
    return settings.precision != "float64" or not full, "everything is float64"


# --- which settings -------------------------------------------------------------------------------------


def all_true(settings: Settings, parts: Sequence[Part]) -> Settings:
    """Settings with all parts replaced by their truth."""
    for part in parts:
        settings = part.replaced(settings)
    return settings


def only(settings: Settings, parts: Sequence[Part], approximate: Part) -> Settings:
    """Settings with all parts but one replaced by their truth."""
    return all_true(settings, [part for part in parts if part is not approximate])


# --- the sums -------------------------------------------------------------------------------------------


def added(name: str, *, whole: Image, none: Image, alone: Mapping[str, Image], without: Mapping[str, Image]) -> Image:
    """What a part adds to an image: the mean of what it adds when it comes first and when it comes last.

    Parameters
    ----------
    name : str
        Of the part.
    whole, none, alone, without
        As for `make_budget`.

    Returns
    -------
    ndarray, shape (3, h, w)

    Examples
    --------
    >>> one = lambda value: np.full((3, 1, 1), value)
    >>> last = {"whole": one(4.0), "without": {"depth": one(2.0)}}
    >>> added("depth", none=one(0.0), alone={"depth": one(1.0)}, **last).ravel().tolist()
    [1.5, 1.5, 1.5]
    """
    last = whole - without[name]
    return 0.5 * (alone[name] - none + last) if name in alone else last


def make_budget(parts: Sequence[Part], left_out: Sequence[LeftOut], *, truth: Image, whole: Image, none: Image,
                alone: Mapping[str, Image], without: Mapping[str, Image], epsilon: float,
                regions: Mapping[str, NDArray[np.bool_]]) -> Budget:
    """Take the error of an image apart by its causes.

    Parameters
    ----------
    parts : sequence of Part
    left_out : sequence of LeftOut
    truth : ndarray, shape (3, h, w)
    whole, none : ndarray, shape (3, h, w)
        The image with all approximations, and with none.
    alone, without : mapping of str to ndarray, shape (3, h, w)
        By part: the image with this approximation only, if there is one, and with all others.
    epsilon : float
        Of relMSE.
    regions : mapping of str to ndarray of bool, shape (h, w)
        That each pixel lies in one of.

    Returns
    -------
    Budget
        Its parts from the largest share to the smallest.

    Notes
    -----
    The claim: without part j, e − s_j is left. What is left is e − m_j; the two differ by m_j − s_j = ½(m_j − a_j),
    half of what the part does together with others, and the roots of their relMSE by at most the root of that one's.

    Examples
    --------
    >>> from froxel_ref.settings import Settings
    >>> parts = [Part(name, "", "", lambda how: how) for name in ("depth", "storage")]
    >>> image = lambda value: np.full((3, 1, 1), value)
    >>> found = make_budget(parts, [], truth=image(1.0), whole=image(1.4), none=image(1.0), epsilon=0.01,
    ...                     alone={"depth": image(1.3), "storage": image(1.1)},
    ...                     without={"depth": image(1.1), "storage": image(1.3)},
    ...                     regions={"sky": np.ones((1, 1), bool)})
    >>> [(part.name, round(part.share, 12)) for part in found.parts], abs(round(found.interaction, 12))
    ([('depth', 0.75), ('storage', 0.25)], 0.0)
    """
    weight = 1.0 / (truth * truth + epsilon)
    mean = float(np.abs(truth).mean())
    error = whole - truth

    def product(u: Image, v: Image, mask: NDArray[np.bool_] | None = None) -> float:
        each = weight * u * v
        return float(np.mean(each if mask is None else each * mask))

    total = product(error, error)

    def share(image: Image, mask: NDArray[np.bool_] | None = None) -> float:
        return product(image, error, mask) / total if total else 0.0

    found, together = [], error - (none - truth)
    for part in parts:
        adds = added(part.name, whole=whole, none=none, alone=alone, without=without)
        together = together - adds
        first = alone[part.name] - none if part.name in alone else None
        left = without[part.name] - truth
        found.append(BudgetPart(
            part.name, part.about, part.truth, None if first is None else product(first, first), product(left, left),
            share(adds),
            float(np.mean(adds)) / mean if mean else 0.0, {name: share(adds, mask) for name, mask in regions.items()}))
    rest = none - truth
    return Budget(
        total, tuple(sorted(found, key=lambda part: -part.share)), tuple(left_out), share(rest), product(rest, rest),
        share(together), product(together, together), _claim(found, error, none, alone, without, whole, product),
        {name: float(mask.mean()) for name, mask in regions.items()},
        {name: share(error, mask) for name, mask in regions.items()})


def _claim(found: Sequence[BudgetPart], error: Image, none: Image, alone: Mapping[str, Image],
           without: Mapping[str, Image], whole: Image, product: Callable[[Image, Image], float]) -> Claim | None:
    """What the truth of the largest part that was tried alone should leave, and what it does."""
    tried = [part for part in found if part.alone is not None]
    if not tried:
        return None
    largest = max(tried, key=lambda part: part.share)
    adds = added(largest.name, whole=whole, none=none, alone=alone, without=without)
    left, apart = error - adds, whole - without[largest.name] - adds
    return Claim(largest.name, product(left, left), largest.without, float(np.sqrt(product(apart, apart))))
