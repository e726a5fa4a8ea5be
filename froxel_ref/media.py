"""Participating media: densities at points, and the V-Buffer that holds the material of every froxel.

Every field of the V-Buffer is a sum over media of a constant times the medium's density at the point, so
this module works out the constants once per medium (`_Term`) and then only evaluates densities. The same
terms give single points (`media_at`, for the ground truth too) and whole grids (`voxelise`).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from froxel_ref import blocks
from froxel_ref.arrays import Candidates, Field, Index, Points
from froxel_ref.buffers import VBuffer
from froxel_ref.density import Placed, density, density_at, place
from froxel_ref.grid import Froxels, corner_bounds, froxel_points
from froxel_ref.grid_parts import part_slice
from froxel_ref.records import InputError
from froxel_ref.scene import LocalMedium, Medium, NoiseDensity, Rgb, Scene, VolumeDensity
from froxel_ref.settings import SWITCHES, Settings

__all__ = [
    "Terms", "VBuffer", "albedo_of", "anisotropy_span", "contributing", "density", "even_anisotropies", "media_at",
    "media_terms", "pack_v_buffer", "terms_in", "voxelise",
]

Textures = Mapping[NoiseDensity | VolumeDensity, NDArray[Any]]


# --- what each medium adds to which field -----------------------------------------------------------


def contributing(media: Sequence[Medium]) -> tuple[Medium, ...]:
    """Leave out the media that neither dim nor glow.

    Parameters
    ----------
    media : sequence of Medium
        Global and local ones.

    Returns
    -------
    tuple of Medium
        Those with extinction or emissive above 0, in order. The others add exact zeros to every field but
        the plain mean of g (D12), which counts media whatever their density.

    Examples
    --------
    >>> [medium.name for medium in contributing([Medium(name="a"), Medium(name="b", extinction=0.0)])]
    ['a']
    """
    return tuple(m for m in media if any(_rgb(m.extinction)) or any(m.emissive))


class _Term(NamedTuple):
    """A medium in place, its factors on density in each field, and the box of froxels it can touch.

    ``number`` is its place among the global and local media.
    """

    placed: Placed
    factors: Mapping[str, tuple[float, ...]]
    number: int
    bounds: Index | None = None

    @property
    def medium(self) -> Medium:
        return self.placed.medium


Terms: TypeAlias = tuple[_Term, ...]
"""Media ready to be evaluated in a grid, or in a part of one."""

# Fields that count whether a medium's region holds the point, whatever its density there.
MEMBERSHIP = ("member_anisotropy", "members")


def _rgb(value: float | Rgb) -> Rgb:
    return value if isinstance(value, tuple) else (value, value, value)


def _scatters(medium: Medium) -> bool:
    return any(a * e > 0.0 for a, e in zip(medium.albedo, _rgb(medium.extinction), strict=True))


def _terms(media: Sequence[Medium], textures: Textures, settings: Settings, dtype: np.dtype[Any], *,
           idle: bool = False) -> list[_Term]:
    """The media with their factors; those that add nothing to any field are left out unless ``idle``."""
    names, lobes = _wanted(media, settings), _lobe_anisotropies(media)
    terms = []
    for number, medium in enumerate(media):
        factors = _factors(medium, settings.emission, wide=names["extinction"] == 3)
        factors = {name: values for name, values in factors.items() if idle or any(values)}
        factors |= {"member_anisotropy": (medium.phase_anisotropy,), "members": (1.0,)}
        if _scatters(medium):
            factors["anisotropy"] = (medium.phase_anisotropy * sum(factors["scattering"]),)
            factors[f"lobe {lobes.index(medium.phase_anisotropy)}"] = factors["scattering"]
        used = {name: values for name, values in factors.items() if name in names}
        if used:
            texels = None if medium.density is None else textures[medium.density.source]
            terms.append(_Term(place(medium, texels, dtype=dtype), used, number))
    return terms


def _factors(medium: Medium, emission: str, wide: bool) -> dict[str, tuple[float, ...]]:
    extinction, albedo, emissive = _rgb(medium.extinction), medium.albedo, medium.emissive
    if emission == "absorption":
        emissive = _product(tuple((1.0 - a) * e for a, e in zip(albedo, extinction, strict=True)), emissive)
    return {"scattering": _product(albedo, extinction), "extinction": extinction if wide else extinction[:1],
            "emission": emissive}


def _product(a: tuple[float, ...], b: tuple[float, ...]) -> Rgb:
    return a[0] * b[0], a[1] * b[1], a[2] * b[2]


def _lobe_anisotropies(media: Sequence[Medium]) -> list[float]:
    """The distinct g of the media that scatter."""
    return list(dict.fromkeys(m.phase_anisotropy for m in media if _scatters(m)))


def _wanted(media: Sequence[Medium], settings: Settings) -> dict[str, int]:
    """The sums to form, and their number of channels; g only where it is not one number everywhere."""
    wide = any(isinstance(m.extinction, tuple) for m in contributing(media))
    names = {"scattering": 3, "extinction": 3 if wide else 1, "emission": 3}
    lobes = _lobe_anisotropies(media)
    if settings.phase_mixing == "mean":
        shared = len({m.phase_anisotropy for m in media}) <= 1
        if not (shared and any(not isinstance(m, LocalMedium) for m in media)):
            names |= dict.fromkeys(MEMBERSHIP, 1)
    elif len(lobes) > 1:
        names["anisotropy"] = 1
        if settings.phase_mixing == "mixture":
            names |= {f"lobe {i}": 3 for i in range(len(lobes))}
    return names


def _mean_anisotropy(sums: Mapping[str, Field], media: Sequence[Medium], *,
                     in_place: bool = False) -> Field:
    """g from its numerator and weight, 0 where the weight is; within the media's own values in any case."""
    if "members" in sums:
        numerator, weight = sums["member_anisotropy"][0], sums["members"][0]
    else:
        scattering = sums["scattering"]
        numerator, weight = sums["anisotropy"][0], scattering[0] + scattering[1] + scattering[2]
    with np.errstate(invalid="ignore", divide="ignore"):
        ratio: Field = np.divide(numerator, weight, out=numerator if in_place else None)
    ratio[weight == 0.0] = 0.0
    anisotropies = [0.0] + [m.phase_anisotropy for m in media]
    # Sums near the smallest number lose their digits; g must not leave (−1, 1) for that.
    return np.clip(ratio, min(anisotropies), max(anisotropies), out=ratio)


def _sums(terms: Sequence[_Term], names: Mapping[str, int], points: Points,
          settings: Settings) -> dict[str, Field]:
    """The sums over media at points, channel first, each with the axes on which it varies."""
    ones = (1,) * max(p.ndim for p in points)
    dtype = np.result_type(*points)
    totals: dict[str, Field] = {}
    for term in terms:
        used = [name for name in names if name in term.factors]
        values = _values(term, points, settings) if used else {}
        for name in used:
            factors = np.reshape(np.asarray(term.factors[name], dtype), (-1, *ones))
            piece = factors * values[name in MEMBERSHIP]
            totals[name] = totals[name] + piece if name in totals else piece
    return {name: totals.get(name, np.zeros((channels, *ones), dtype)) for name, channels in names.items()}


def _values(term: _Term, points: Points, settings: Settings) -> dict[bool, Field]:
    """What a medium's factors multiply: its density (False) and its membership (True)."""
    value, inside = density_at(term.placed, points, time=settings.time,
                               addressing=settings.density_addressing)
    one = np.ones((1,) * value.ndim, value.dtype)
    return {False: value, True: one if inside is None else inside.astype(value.dtype)}


def _one_anisotropy(media: Sequence[Medium], settings: Settings) -> float:
    """g where `_wanted` has none: one number everywhere."""
    shared = [m.phase_anisotropy for m in media] if settings.phase_mixing == "mean" else _lobe_anisotropies(media)
    return (shared or [0.0])[0]


def anisotropy_span(media: Sequence[Medium], settings: Settings) -> tuple[float, float]:
    """Between which numbers a V-Buffer's phase anisotropy lies, whatever froxels it is of.

    Parameters
    ----------
    media : sequence of Medium
        Global, then local ones.
    settings : Settings
        Its phase_mixing.

    Returns
    -------
    (float, float)
        Twice the same where g is one number everywhere.

    Examples
    --------
    >>> fog, ball = Medium(phase_anisotropy=0.5), LocalMedium(phase_anisotropy=0.8)
    >>> [anisotropy_span(media, Settings()) for media in ((fog,), (ball,), (fog, ball))]
    [(0.5, 0.5), (0.8, 0.8), (0.0, 0.8)]
    """
    if not {"anisotropy", "member_anisotropy"} & _wanted(media, settings).keys():
        g = _one_anisotropy(media, settings)
        return g, g
    every = [m.phase_anisotropy for m in media] if settings.phase_mixing == "mean" else _lobe_anisotropies(media)
    return min([0.0, *every]), max([0.0, *every])  # 0 where nothing scatters


def even_anisotropies(media: Sequence[Medium], settings: Settings) -> tuple[float, ...]:
    """The phase anisotropies of the scattering's parts, as far as each is one number everywhere.

    Parameters
    ----------
    media : sequence of Medium
        Global, then local ones.
    settings : Settings
        Its phase_mixing.

    Returns
    -------
    tuple of float
        One for each lobe of a mixture; otherwise g, or none where it varies.

    Examples
    --------
    >>> fog, ball = Medium(phase_anisotropy=0.5), LocalMedium(phase_anisotropy=0.8)
    >>> from froxel_ref.settings import replace
    >>> [even_anisotropies((fog, ball), replace(Settings(), phase_mixing=mixing)) for mixing in ("weighted", "mixture")]
    [(), (0.5, 0.8)]
    """
    if settings.phase_mixing == "mixture":
        return tuple(_lobe_anisotropies(media))
    low, high = anisotropy_span(media, settings)
    return (low,) if low == high else ()


def _buffer(sums: Mapping[str, Field], anisotropy: Field | None, media: Sequence[Medium],
            settings: Settings) -> VBuffer:
    """The V-Buffer from its sums; without an anisotropy, g is one number everywhere."""
    scattering, extinction, lobes = sums["scattering"], sums["extinction"], _lobe_anisotropies(media)
    if anisotropy is None:
        anisotropy = np.full((1,) * (scattering.ndim - 1), _one_anisotropy(media, settings), scattering.dtype)
    parts: tuple[tuple[Field, float], ...] = ()
    if settings.phase_mixing == "mixture":
        parts = tuple((sums.get(f"lobe {i}", scattering), g) for i, g in enumerate(lobes))
    return VBuffer(scattering, extinction[0] if len(extinction) == 1 else extinction, sums["emission"],
                   anisotropy, parts)


# --- points and grids -------------------------------------------------------------------------------


def media_at(media: Sequence[Medium], points: Points, textures: Textures, settings: Settings) -> VBuffer:
    """Evaluate the material of all media at points.

    Parameters
    ----------
    media : sequence of Medium
        Global and local ones; the sums are formed in this order.
    points : Points [m]
        World positions, three arrays with the same number of axes.
    textures : mapping from NoiseDensity or VolumeDensity to ndarray, shape (nz, ny, nx)
        The texels of every density texture in ``media``.
    settings : Settings
        Its time and the switches emission, phase_mixing and density_addressing.

    Returns
    -------
    VBuffer
        Fields with the points' axes, of length 1 where nothing varies, in the points' dtype.

    Notes
    -----
    The fields, the three means of g and their sources: see `voxelise`, which gives the same bits.

    Examples
    --------
    >>> from froxel_ref.scene import HeightFog
    >>> x, y = np.zeros(1), np.array([0.0, 2.0])
    >>> fog = Medium(albedo=(0.5, 0.5, 0.5), extinction=0.25, height_fog=HeightFog(falloff=1.0))
    >>> buffer = media_at([fog], (x, y, x), {}, Settings())
    >>> buffer.extinction.round(4).tolist(), buffer.scattering.shape
    ([0.25, 0.0338], (3, 2))
    """
    names = _wanted(media, settings)
    terms = _terms(media, textures, settings, np.result_type(*points))
    sums = _sums(terms, names, points, settings)
    mean = "anisotropy" in names or "members" in names
    return _buffer(sums, _mean_anisotropy(sums, media) if mean else None, media, settings)


def media_terms(scene: Scene, froxels: Froxels, textures: Textures, settings: Settings, *, restrict: bool = True
                ) -> Terms:
    """Make a scene's media ready for a grid: what each adds to which field, and the box of froxels that it can touch.

    Parameters
    ----------
    scene, froxels, textures, settings, restrict
        As for `voxelise`.

    Returns
    -------
    Terms
        Without the media that add nothing, and without those out of view.

    Examples
    --------
    >>> from froxel_ref.grid import make_froxels
    >>> froxels = make_froxels(Scene().camera, Settings().grid)
    >>> len(media_terms(Scene(global_media=(Medium(), Medium(extinction=0.0))), froxels, {}, Settings()))
    1
    """
    media = (*scene.global_media, *scene.local_media)
    terms = _terms(media, textures, settings, froxels.depths.dtype, idle=not restrict)
    return _in_view(_bounded(term, froxels, restrict) for term in terms)


def terms_in(terms: Terms, box: Index) -> Terms:
    """What a part of a grid has of the media that are ready for all of it.

    Parameters
    ----------
    terms : Terms
        From `media_terms`.
    box : Index
        The part, with numbers for its starts and stops.

    Returns
    -------
    Terms

    Examples
    --------
    >>> from froxel_ref.grid import make_froxels
    >>> froxels = make_froxels(Scene().camera, Settings().grid)
    >>> from froxel_ref.scene import Transform
    >>> ball = LocalMedium(transform=Transform(translate=(0, 1.7, -4)))
    >>> terms = media_terms(Scene(local_media=(ball,)), froxels, {}, Settings())
    >>> [len(terms_in(terms, (slice(k, k + 8), slice(0, 90), slice(0, 160)))) for k in (0, 28, 56)]
    [0, 1, 0]
    """
    return _in_view(term if term.bounds is None else term._replace(bounds=(
        part_slice(box[0], term.bounds[0]), part_slice(box[1], term.bounds[1]), part_slice(box[2], term.bounds[2])))
        for term in terms)


def _in_view(terms: Iterable[_Term]) -> Terms:
    return tuple(term for term in terms if term.bounds is None or all(r.start < r.stop for r in term.bounds))


def voxelise(scene: Scene, froxels: Froxels, textures: Textures, settings: Settings, *, restrict: bool = True,
             candidates: Candidates | None = None, terms: Terms | None = None, threads: int | None = None,
             block: int = blocks.BLOCK) -> VBuffer:
    """Fill the V-Buffer: the material of all media at every froxel's sample.

    Parameters
    ----------
    scene : Scene
        Its global and local media.
    froxels : Froxels
        Where the samples lie.
    textures : mapping from NoiseDensity or VolumeDensity to ndarray, shape (nz, ny, nx)
        The texels of every density texture in the scene.
    settings : Settings
        Its time and the switches emission, phase_mixing and density_addressing.
    restrict : bool
        Evaluate local media only in the box of froxels that holds them, and leave out media that add
        nothing. The result is the same to the last bit without.
    candidates : callable, optional
        Given a block's slices and rows, the indices of the local media that it has to visit, growing
        (`froxel_ref.culling.candidates`); all of them unless given.
    terms : Terms, optional
        From `media_terms` or `terms_in`, lest each part of a grid work them out anew.
    threads, block : int, optional
        How to run; see `froxel_ref.blocks`. No effect on the result.

    Returns
    -------
    VBuffer
        In the froxels' dtype. Uniform fog is (1, 1, 1), height fog under a camera without roll
        (D, H, 1); a field is full only if a local medium in view or a density texture adds to it.

    Notes
    -----
    Materials add: σ_s = Σ albedo·σ_t·ρ, σ_t = Σ σ_t·ρ, emission = Σ emissive·ρ with density ρ
    [Dörries 2020, §3.2.5]. The phase anisotropy g, by the switch phase_mixing (D12):

    - "weighted": Σ g·w·ρ/Σ w·ρ, where w is the sum of the medium's three σ_s; 0 where nothing scatters.
      Where all media that scatter share one g, it is that number everywhere.
    - "mean": the plain mean over the media whose region holds the point, 0 where none does. As in the
      thesis's program a global medium always counts, and a local one anywhere inside its shape, even
      where their density is 0 (above max_height, in a hole of the texture, or extinction 0).
    - "mixture": as weighted, and ``lobes`` holds Σ σ_s·ρ for each distinct g, for lighting to apply each
      phase function to its own share.

    Elementwise but for the sums, which run in the order global, then local media.

    Examples
    --------
    >>> from froxel_ref.grid import make_froxels
    >>> from froxel_ref.settings import Grid
    >>> froxels = make_froxels(Scene().camera, Grid(width=4, height=3, depth=2))
    >>> voxelise(Scene(global_media=(Medium(),)), froxels, {}, Settings()).extinction.shape
    (1, 1, 1)
    """
    media = (*scene.global_media, *scene.local_media)
    names = _wanted(media, settings)
    if terms is None:
        terms = media_terms(scene, froxels, textures, settings, restrict=restrict)
    whole = {name: channels for name, channels in names.items() if _is_full(name, terms, froxels)}
    small = {name: channels for name, channels in names.items() if name not in whole}
    everywhere = [term for term in terms if term.bounds is None and any(name in small for name in term.factors)]
    points = froxel_points(froxels) if everywhere else froxel_points(froxels, *(slice(0, 1),) * 3)
    sums = _sums(everywhere, small, points, settings)
    mean = "anisotropy" if "anisotropy" in names else "member_anisotropy"
    first = len(scene.global_media)
    visit = None if candidates is None or not restrict else lambda z, y: (candidates(z, y) + first).tolist()
    sums |= _fill(terms, whole, froxels, settings, media, mean, visit, threads, block)
    if mean in small:
        return _buffer(sums, _mean_anisotropy(sums, media), media, settings)
    return _buffer(sums, sums[mean][0] if mean in whole else None, media, settings)


def _fill(terms: Sequence[_Term], names: Mapping[str, int], froxels: Froxels, settings: Settings,
          media: Sequence[Medium], mean: str, visit: Callable[[slice, slice], list[int]] | None,
          threads: int | None, block: int) -> dict[str, Field]:
    """The full fields, block by block: what is everywhere first, then each local medium in its box."""
    shape = _full_shape(froxels)
    fields = {name: np.empty((channels, *shape), froxels.depths.dtype) for name, channels in names.items()}
    everywhere = [term for term in terms if term.bounds is None]
    local = {term.number: term for term in terms if term.bounds is not None}

    def fill(part: tuple[slice, slice]) -> None:
        z, y = part
        for name, total in _sums(everywhere, names, froxel_points(froxels, z, y), settings).items():
            fields[name][:, z, y] = total
        for number in local if visit is None else visit(z, y):
            term = local.get(number)
            if term is None:  # it adds nothing, or lies out of view
                continue
            box = _overlap(term.bounds or (z, y, slice(None)), z, y)
            if box is not None:
                views = {name: fields[name][:, *box] for name in names if name in term.factors}
                _add(term, views, froxel_points(froxels, *box), settings)
        if mean in names:
            _mean_anisotropy({name: fields[name][:, z, y] for name in names}, media, in_place=True)

    blocks.run(fill, blocks.blocks(*shape, size=block) if names else [], threads=threads)
    return fields


def _add(term: _Term, views: Mapping[str, Field], points: Points, settings: Settings) -> None:
    """Add a local medium to views of the fields."""
    values = _values(term, points, settings)
    for name, view in views.items():
        for channel, factor in zip(view, term.factors[name], strict=True):
            channel += values[name in MEMBERSHIP] * factor


def _bounded(term: _Term, froxels: Froxels, restrict: bool) -> _Term:
    """The term with the box of froxels that its medium can touch; None for a global medium."""
    medium = term.medium
    if not isinstance(medium, LocalMedium):
        return term
    if not restrict:
        depth, height, width = _full_shape(froxels)
        return term._replace(bounds=(slice(0, depth), slice(0, height), slice(0, width)))
    corners = np.stack(np.meshgrid(*[(-1.0, 1.0)] * 3), axis=-1).reshape(-1, 3)
    matrix = medium.transform.world_from_local
    return term._replace(bounds=corner_bounds(froxels, corners @ matrix[:3, :3].T + matrix[:3, 3]))


def _overlap(bounds: Index, z: slice, y: slice) -> Index | None:
    depth = slice(max(bounds[0].start, z.start), min(bounds[0].stop, z.stop))
    rows = slice(max(bounds[1].start, y.start), min(bounds[1].stop, y.stop))
    return (depth, rows, bounds[2]) if depth.start < depth.stop and rows.start < rows.stop else None


def _full_shape(froxels: Froxels) -> tuple[int, int, int]:
    return (len(froxels.depths), *froxels.rays.length.shape)


def _is_full(name: str, terms: Sequence[_Term], froxels: Froxels) -> bool:
    """Whether a field varies along all three axes."""
    shapes = [(len(froxels.depths), *component.shape) for component in froxels.rays.per_depth]
    varying: list[tuple[int, ...]] = [(1, 1, 1)]
    for term in terms:
        fog = term.medium.height_fog
        if name not in term.factors or (term.bounds is None and name in MEMBERSHIP):
            continue
        if term.bounds is not None:
            varying.append(_full_shape(froxels))
        elif term.placed.texture is not None:
            varying.extend(shapes)
        elif fog is not None and (fog.falloff > 0.0 or fog.max_height is not None):
            varying.append(shapes[1])
    return np.broadcast_shapes(*varying) == _full_shape(froxels)


# --- layout -----------------------------------------------------------------------------------------


def albedo_of(scattering: Field, extinction: Field, *, at_zero: str = "zero") -> Field:
    """Divide scattering by extinction, as the V-Buffer's first texture holds it.

    Parameters
    ----------
    scattering : Field, shape (3, …) [1/m]
    extinction : Field, shape (…) or (3, …) [1/m]
    at_zero : {"zero", "divide"}
        Albedo where extinction is 0: 0, or 0/0 = NaN as listing 3.1 has it (D1).

    Returns
    -------
    Field, shape (3, …) [1]

    Raises
    ------
    InputError
        For another word.

    Notes
    -----
    [Dörries 2020, listing 3.1, table 3.2]. Of a single medium it is the authored albedo within 4 ulp:
    albedo·extinction, its product with the density, extinction's, and this quotient are rounded.

    Examples
    --------
    >>> thin = np.array([0.0, 0.5])
    >>> albedo_of(np.stack([thin / 2] * 3), thin).tolist()[0]
    [0.0, 0.5]
    >>> albedo_of(np.stack([thin / 2] * 3), thin, at_zero="divide").tolist()[0]
    [nan, 0.5]
    """
    if at_zero not in SWITCHES["albedo_at_zero"]:
        words = dict.fromkeys(SWITCHES["albedo_at_zero"])
        raise InputError("albedo_at_zero", f"is {at_zero!r}, must be one of {', '.join(words)}")
    if at_zero == "divide":
        with np.errstate(invalid="ignore", divide="ignore"):
            return np.asarray(scattering / extinction)
    shape = np.broadcast_shapes(scattering.shape, extinction.shape)
    result: Field = np.divide(scattering, extinction, out=np.zeros(shape, scattering.dtype), where=extinction > 0.0)
    return result


def pack_v_buffer(vbuffer: VBuffer, *, albedo_at_zero: str = "zero") -> tuple[Field, Field]:
    """Lay the V-Buffer out as the thesis's two textures.

    Parameters
    ----------
    vbuffer : VBuffer
        With three axes (z, y, x) and monochrome extinction.
    albedo_at_zero : {"zero", "divide"}
        Albedo where extinction is 0: 0, or 0/0 = NaN as listing 3.1 has it (D1).

    Returns
    -------
    a : Field, shape (D, H, W, 4)
        Albedo (red, green, blue) and extinction [1/m].
    b : Field, shape (D, H, W, 4)
        Emissive (red, green, blue) and phase anisotropy.

    Raises
    ------
    InputError
        The extinction is RGB, for which the layout has no room.

    Notes
    -----
    GPU texture order (z, y, x, channel) [Dörries 2020, table 3.2]; axes of length 1 stay so. The albedo is
    rounded once more than the scattering it stands for: 1 ulp.

    Examples
    --------
    >>> x = np.zeros((1, 1, 1))
    >>> a, b = pack_v_buffer(media_at([Medium(albedo=(1, 0.5, 0), extinction=2)], (x, x, x), {}, Settings()))
    >>> a.tolist(), b.shape
    ([[[[1.0, 0.5, 0.0, 2.0]]]], (1, 1, 1, 4))
    """
    scattering, extinction, emission, anisotropy, _ = vbuffer
    if extinction.ndim == scattering.ndim:
        raise InputError("extinction", "is RGB, must be one number for the layout of table 3.2")
    albedo = albedo_of(scattering, extinction, at_zero=albedo_at_zero)
    return _interleave(albedo, extinction), _interleave(emission, anisotropy)


def _interleave(rgb: Field, alpha: Field) -> Field:
    """Channel first to channel last: three channels and a fourth."""
    shape = np.broadcast_shapes(rgb.shape[1:], alpha.shape)
    result = np.empty((*shape, 4), rgb.dtype)
    for i, channel in enumerate((*rgb, alpha)):
        result[..., i] = channel
    return result
