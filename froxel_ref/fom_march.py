"""What opacity maps hold of the media along a light's rays: in closed form where there is one, else by a march.

Depths along a ray are in metres from the light (of a directional light, from its cascade's plane), and
normalised to the range that the map covers before they enter its numbers.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from froxel_ref.arrays import Field, Points
from froxel_ref.density import Placed, density_at
from froxel_ref.fom_codes import Code, fourier_code
from froxel_ref.fom_lookup import pairs_of
from froxel_ref.optical_depth import Lines, MediumPath, line_points, medium_path
from froxel_ref.scene import LocalMedium

__all__ = ["DITHER", "Marching", "Span", "media_coefficients", "media_numbers", "media_span"]

Integers: TypeAlias = NDArray[np.intp]

# Order of a 4×4 tile's texels in an ordered dither [Bayer 1973], in sixteenths from 1 on (A8).
DITHER = (1.0 + np.array([[0, 8, 2, 10], [12, 4, 14, 6], [3, 11, 1, 9], [15, 7, 13, 5]])) / 16.0


# Samples that are worked on at a time: the dozen arrays of them that a march needs stay in the cache.
SAMPLES = 131072


class Marching(NamedTuple):
    """How a march samples.

    Attributes
    ----------
    samples : {"segments", "middle", "front", "dithered"}
        What a step adds (D7, A8): a stretch of constant extinction; a point at its middle, at its front, or half a
        step and the dither beyond its front, the last one perhaps past the end.
    most_tau : float
        What a point's optical depth is cut to (D8).
    step : float [m]
        Longest step, unless that makes more than ``most_steps``.
    most_steps : int
    time : float [s]
        Of scrolling textures.
    addressing : str
        As for `froxel_ref.density.density_at`.
    """

    samples: str = "segments"
    most_tau: float = np.inf
    step: float = 0.05
    most_steps: int = 64
    time: float = 0.0
    addressing: str = "wrap"


class Span(NamedTuple):
    """The depths that maps cover, broadcastable to the rays [m]; where far ≤ near there is nothing."""

    near: Field
    far: Field


def media_span(media: Sequence[Placed], lines: Lines) -> Span:
    """Nearest and farthest depth of media along rays.

    Parameters
    ----------
    media : sequence of Placed
        Those that dim.
    lines : Lines, n of them

    Returns
    -------
    Span, shape (n,)
        Infinite and −infinite where a ray meets none.

    Examples
    --------
    >>> from froxel_ref.density import place
    >>> lines = Lines(np.array([[0.0], [0.0], [4.0]]), np.array([[0.0], [0.0], [-1.0]]), np.zeros(1), np.full(1, 9.0))
    >>> [end.tolist() for end in media_span([place(LocalMedium())], lines)]
    [[3.0], [5.0]]
    """
    near, far = np.full(lines.start.shape, np.inf), np.full(lines.start.shape, -np.inf)
    for placed in media:
        path = medium_path(placed._replace(texture=None), lines)
        met = path.leave > path.enter
        near = np.where(met, np.minimum(near, path.enter), near)
        far = np.where(met, np.maximum(far, path.leave), far)
    return Span(near, far)


def media_coefficients(media: Mapping[int, Placed], extinction: Mapping[int, float], lines: Lines, span: Span, *,
                       harmonics: int = 3, marching: Marching | None = None, whole: bool = False,
                       dither: Field | None = None, dtype: np.dtype[np.floating] | None = None) -> Field:
    """Fourier coefficients of all media along rays.

    Parameters
    ----------
    media : mapping of int to Placed
        Those that dim, by any number; their textures in the type of the arithmetic.
    extinction : mapping of int to float [1/m]
        At density 1, by the same numbers.
    lines : Lines, n of them
        From the light, or through a directional light's texels.
    span : Span, broadcastable to (n,) [m]
        What the maps cover; must hold everything that dims.
    harmonics : int
        K.
    marching : Marching, optional
        How what has no closed form is sampled.
    whole : bool
        Point samples only: march the whole span for all media together, as the thesis's lamps do; else each
        medium's own stretch.
    dither : Field, shape (n,)
        For dithered samples, in (0, 1].
    dtype : dtype, optional
        Of the coefficients and of textures' coordinates; float64 unless given.

    Returns
    -------
    Field, shape (2, K + 1, n), or (2, K + 1, 1) where all rays are alike [1]

    Notes
    -----
    "segments": exact for media without textures, uniform (`fom.segment_coefficients`) or with height fog
    (`fom.falling_coefficients`); through a texture the stretch inside the medium is cut into equal steps, by eights
    as few as keep them below ``step``, each of constant extinction as at its middle: order 2 in the step.
    Point samples march everything; "front" is of order 1 [Dörries 2020, listing 3.18].

    Examples
    --------
    >>> from froxel_ref.density import place
    >>> fog = place(LocalMedium())
    >>> lines = Lines(np.array([[0.0], [0.0], [4.0]]), np.array([[0.0], [0.0], [-1.0]]), np.zeros(1), np.full(1, 9.0))
    >>> full = media_coefficients({0: fog}, {0: 0.5}, lines, Span(np.full(1, 3.0), np.full(1, 5.0)))
    >>> float(full[0, 0, 0]), bool(np.abs(full[:, 1:]).max() < 1e-15)
    (2.0, True)
    """
    return pairs_of(media_numbers(media, extinction, lines, span, code=fourier_code(harmonics), marching=marching,
                                  whole=whole, dither=dither, dtype=dtype))


def media_numbers(media: Mapping[int, Placed], extinction: Mapping[int, float], lines: Lines, span: Span, *,
                  code: Code, marching: Marching | None = None, whole: bool = False, dither: Field | None = None,
                  dtype: np.dtype[np.floating] | None = None) -> Field:
    """What a technique's maps hold of all media along rays.

    Parameters
    ----------
    media, extinction, lines, span, marching, whole, dither, dtype
        As for `media_coefficients`.
    code : Code
        The technique, from `froxel_ref.fom_codes`.

    Returns
    -------
    Field, shape (channels, n), or (channels, 1) where all rays are alike [1]

    Notes
    -----
    Media are gathered as for `media_coefficients`. Of other techniques than Fourier's, points beyond the range's end
    dim nothing, where a series that is periodic has them at its beginning.

    Examples
    --------
    >>> from froxel_ref.density import place
    >>> from froxel_ref.fom_codes import code_of
    >>> from froxel_ref.settings import OpacityMaps
    >>> fog = place(LocalMedium())
    >>> lines = Lines(np.array([[0.0], [0.0], [4.0]]), np.array([[0.0], [0.0], [-1.0]]), np.zeros(1), np.full(1, 9.0))
    >>> code = code_of(OpacityMaps(technique="slices", numbers=4))
    >>> media_numbers({0: fog}, {0: 0.5}, lines, Span(np.full(1, 2.0), np.full(1, 6.0)), code=code).tolist()
    [[0.0], [0.5], [1.0], [1.0]]
    """
    how = marching or Marching()
    dtype = dtype or np.dtype(np.float64)
    count = lines.start.size
    if how.samples != "segments" and whole:
        return _march_whole(media, extinction, lines, span, code, how, dither, dtype)
    total = np.zeros((code.channels, 1), dtype)
    for number, placed in media.items():
        if how.samples == "segments" and _everywhere(placed):
            total = total + _uniform(extinction[number], span, code, dtype)
            continue
        live, path = _met(placed, lines)
        if not live.size:
            continue
        if total.shape[-1] == 1:
            total = np.repeat(total, count, axis=-1)
        part = Lines(*(np.broadcast_to(field, (*field.shape[:-1], count))[..., live] for field in lines))
        near, far = (np.broadcast_to(end, count)[live] for end in span)
        if how.samples == "segments" and placed.texture is None:
            piece = _closed(path, extinction[number], near, far, code)
        else:
            piece = _march(placed, path, extinction[number], part, Span(near, far), code, how,
                           None if dither is None else dither[live], dtype)
        total[..., live] += piece.astype(dtype, copy=False)
    return total


def _everywhere(placed: Placed) -> bool:
    """Whether a medium is the same everywhere."""
    medium = placed.medium
    fog = medium.height_fog
    return (not isinstance(medium, LocalMedium) and placed.texture is None
            and (fog is None or (fog.falloff == 0.0 and fog.max_height is None)))


def _uniform(extinction: float, span: Span, code: Code, dtype: np.dtype[np.floating]) -> Field:
    """A medium that fills the range."""
    length = np.maximum(np.reshape(span.far - span.near, -1), 0.0)
    return code.uniform(extinction * np.where(np.isfinite(length), length, 0.0)).astype(dtype, copy=False)


def _met(placed: Placed, lines: Lines) -> tuple[Integers, MediumPath]:
    """Which rays meet a medium, and their stretches in it."""
    path = medium_path(placed._replace(texture=None), lines)
    live = np.flatnonzero(path.leave > path.enter)
    return live, path._replace(**{name: getattr(path, name)[live] for name in MediumPath._fields if name != "cells"})


def _normal(t: Field, near: Field, far: Field) -> Field:
    """Depths as shares of the range, in [0, 1]."""
    return np.minimum(np.maximum((t - near) / np.maximum(far - near, 1e-300), 0.0), 1.0)


def _closed(path: MediumPath, extinction: float, near: Field, far: Field, code: Code) -> Field:
    """A medium without a texture: where it is uniform, and where its height fog falls."""
    flat = [_normal(t, near, far) for t in (path.flat_from, path.flat_to)]
    tau = extinction * np.maximum(path.flat_to - path.flat_from, 0.0)
    result = code.stretches(flat[0], np.maximum(flat[0], flat[1]), tau)
    falls = np.flatnonzero(path.fall_to > path.fall_from)
    if falls.size:
        begin, end = path.fall_from[falls], path.fall_to[falls]
        slope, length = path.slope[falls], (far - near)[falls]
        # The exponent at the denser end: at the beginning of a falling stretch, at the end of a rising one.
        exponent = np.maximum(path.exponent[falls] + np.minimum(slope, 0.0) * (end - begin), 0.0)
        with np.errstate(under="ignore"):
            most = extinction * length * np.exp(-exponent)
        ends = [_normal(t, near[falls], far[falls]) for t in (begin, end)]
        result[..., falls] += code.falling(ends[0], np.maximum(ends[0], ends[1]), most, slope * length)
    return result


# --- marches ----------------------------------------------------------------------------------------


def _groups(length: Field, how: Marching) -> list[tuple[int, Integers]]:
    """Rays by their number of steps: as few as keep a step below ``step``, and no more than ``most_steps``.

    Stretches of constant extinction may be shorter than they must: in eights, so that there are few groups.
    """
    eights = 8.0 if how.samples == "segments" else 1.0
    steps = np.maximum(np.ceil(length / (how.step * eights)), 1.0) * eights
    counts = np.minimum(steps, how.most_steps).astype(np.intp)
    result = []
    for count in np.unique(counts).tolist():
        alike = np.flatnonzero(counts == count)
        few = max(1, SAMPLES // count)
        result += [(int(count), alike[begin:begin + few]) for begin in range(0, len(alike), few)]
    return result


def _offset(how: Marching, dither: Field | None) -> Field | float:
    """Where in a step its sample lies, in steps."""
    if how.samples == "dithered":
        return 0.5 + (0.5 if dither is None else dither)
    return 0.0 if how.samples == "front" else 0.5


def _march(placed: Placed, path: MediumPath, extinction: float, lines: Lines, span: Span, code: Code,
           how: Marching, dither: Field | None, dtype: np.dtype[np.floating]) -> Field:
    """One medium, marched along its own stretch of each ray."""
    def thickness(t: Field, points: Points, size: Field) -> Field:
        value, _ = density_at(placed, points, time=how.time, addressing=how.addressing)
        return np.broadcast_to(value, t.shape) * (extinction * size).astype(dtype)

    return _marched(thickness, lines, path.enter, path.leave, span, code, how, dither, dtype)


def _march_whole(media: Mapping[int, Placed], extinction: Mapping[int, float], lines: Lines, span: Span, code: Code,
                 how: Marching, dither: Field | None, dtype: np.dtype[np.floating]) -> Field:
    """All media together, marched through the whole range of each ray."""
    def thickness(t: Field, points: Points, size: Field) -> Field:
        total = np.zeros(t.shape, dtype)
        for number, placed in media.items():
            value, _ = density_at(placed, points, time=how.time, addressing=how.addressing)
            total += value * dtype.type(extinction[number])
        return total * size.astype(dtype)

    near, far = (np.broadcast_to(end, lines.start.shape) for end in span)
    return _marched(thickness, lines, near, np.maximum(far, near), Span(near, far), code, how, dither, dtype,
                    past_end=True)


def _marched(thickness: Callable[[Field, Points, Field], Field], lines: Lines, begin: Field, end: Field, span: Span,
             code: Code, how: Marching, dither: Field | None, dtype: np.dtype[np.floating], *,
             past_end: bool = False) -> Field:
    """The numbers of steps from ``begin`` to ``end`` of each ray; a dithered one may lie past the end."""
    result = np.zeros((code.channels, lines.start.size), dtype)
    near, width = span.near, np.maximum(span.far - span.near, 1e-300)
    for count, chosen in _groups(end - begin, how):
        offset = _offset(how, None if dither is None else dither[chosen])
        size = (end - begin)[chosen] / count
        first = begin[chosen] + offset * size
        t = first + np.arange(count)[:, np.newaxis] * size
        x, y, z = (c.astype(dtype, copy=False).T for c in line_points(lines, t.T, chosen))
        tau = np.minimum(thickness(t, (x, y, z), size), how.most_tau)
        if how.samples == "dithered" and not past_end:
            tau = np.where(t < end[chosen], tau, 0.0)
        result[..., chosen] = code.steps((first - near[chosen]) / width[chosen], size / width[chosen], tau,
                                         how.samples == "segments")
    return result
