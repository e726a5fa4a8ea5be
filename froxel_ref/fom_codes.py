"""What opacity maps hold of their texels' rays: numbers that what dims adds to, by one of several techniques.

Maps, ranges, gutters and lookups are the same for all of them. A `Code` says how stretches of extinction, marches and
points add to a texel's numbers, in any order, and how optical depth is read from these. The plain functions on rays are
those of `froxel_ref.fom`, `opacity_slices`, `cosine_maps`, `power_moments` and `trigonometric_moments`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammainc

from froxel_ref import cosine_maps, fom, power_moments, trigonometric_moments
from froxel_ref.absorbers import Absorbers
from froxel_ref.arrays import Field
from froxel_ref.fom_lookup import Reading, planes_of
from froxel_ref.settings import OpacityMaps
from froxel_ref.storage import FLOATS, store, store_series

__all__ = ["Code", "code_of", "fourier_code"]

Array: TypeAlias = NDArray[np.floating[Any]]
Integers: TypeAlias = NDArray[np.intp]
Transmittance: TypeAlias = Callable[[Field, Field], Field]

# Lookups of moments at a time: some fifty arrays of them stay in the cache.
LOOKUPS = 8192
# Crossings at a time, so that a hundred numbers of each fit in memory.
POINTS = 1 << 16
# How much of the circle trigonometric moments use.
TURN = 1.0 - trigonometric_moments.WRAPPING / (2.0 * np.pi)


class Code(NamedTuple):
    """One technique: how a texel's numbers are gathered, stored and read.

    All depths are shares of the texel's range. Numbers of several calls are added.

    Attributes
    ----------
    about : str
        What they are, for a plan.
    channels : int
        How many a texel has.
    stretches : callable
        From start, stop and optical depth of stretches of constant extinction, shape (n,), to numbers
        (channels, n).
    falling : callable
        From start, stop, most and slope, as of `froxel_ref.fom.falling_coefficients`, shape (n,), to the same.
    steps : callable
        From start and step, shape (n,), the optical depths of even steps, shape (steps, n), and whether they fill
        their steps, as of `froxel_ref.fom.even_coefficients`, to the same.
    points : callable
        From depth and optical depth of points, shape (n,), to the same.
    uniform : callable
        From the optical depth of what fills the range, shape (n,), to the same.
    scatter : callable
        From rays' indices, depth and optical depth of points, and the number of rays, to an iterator over the
        channels of their sums.
    store : callable
        From numbers, shape (…, channels, rows, columns), to what half floats hold of them.
    reading : Reading or None
        How optical depth is read; None: as Fourier opacity maps are (`froxel_ref.fom_lookup`).
    """

    about: str
    channels: int
    stretches: Callable[[Field, Field, Field], Field]
    falling: Callable[[Field, Field, Field, Field], Field]
    steps: Callable[[Field, Field, Field, bool], Field]
    points: Callable[[Field, Field], Field]
    uniform: Callable[[Field], Field]
    scatter: Callable[[Integers, Field, Field, int], Iterator[Field]]
    store: Callable[[Field], Field]
    reading: Reading | None = None


def code_of(maps: OpacityMaps) -> Code:
    """The technique that the settings ask for.

    Parameters
    ----------
    maps : OpacityMaps

    Returns
    -------
    Code

    Examples
    --------
    >>> for name in ("fourier", "slices", "cosine", "power", "trigonometric"):
    ...     code = code_of(OpacityMaps(technique=name))
    ...     held = code.stretches(np.zeros(1), np.ones(1), np.full(1, 4.0))[:3, 0]
    ...     print(code.about, (held.round(3) + 0.0).tolist())
    Fourier series, 8 numbers a texel [8.0, 0.0, 0.0]
    opacity slices, 8 numbers a texel [0.5, 1.0, 1.5]
    cosine series, 8 numbers a texel [8.0, 0.0, 0.0]
    power moments, 7 numbers a texel [4.0, 0.0, 1.333]
    trigonometric moments, 7 numbers a texel [4.0, -0.207, 0.033]
    """
    storage = "float16" if maps.storage == "float16" else None
    if maps.technique == "slices":
        return _slices(maps.channels)
    if maps.technique == "cosine":
        return _cosine(maps.channels)
    if maps.technique == "power":
        return _power(maps.channels, storage, maps.overestimation)
    if maps.technique == "trigonometric":
        return _trigonometric(maps.channels, storage, maps.overestimation)
    return fourier_code(maps.harmonics)


def fourier_code(harmonics: int) -> Code:
    """Fourier opacity maps [Jansen 2010; Dörries 2020, §3.3.2].

    Parameters
    ----------
    harmonics : int
        K.

    Returns
    -------
    Code
        Of 2K + 2 channels: a_0, b_0, a_1, b_1, …

    Examples
    --------
    >>> (fourier_code(1).points(np.array([0.25]), np.array([1.5])).round(12) + 0.0).tolist()
    [[3.0], [0.0], [0.0], [3.0]]
    """
    channels = 2 * harmonics + 2

    def uniform(tau: Field) -> Field:  # what fills the range has no harmonics
        result = np.zeros((channels, *tau.shape), tau.dtype)
        result[0] = 2.0 * tau
        return result

    def points(depth: Field, tau: Field) -> Field:
        return planes_of(fom.sample_coefficients(depth[np.newaxis], tau[np.newaxis], harmonics=harmonics))

    return Code(
        _about("Fourier series", channels), channels,
        lambda start, stop, tau: planes_of(fom.segment_coefficients(
            start[np.newaxis], stop[np.newaxis], tau[np.newaxis], harmonics=harmonics)),
        lambda start, stop, most, slope: planes_of(fom.falling_coefficients(
            start[np.newaxis], stop[np.newaxis], most[np.newaxis], slope[np.newaxis], harmonics=harmonics)),
        lambda start, step, tau, filled: planes_of(fom.even_coefficients(
            start, step, tau, harmonics=harmonics, filled=filled)),
        points, uniform, _scatter(points, None), _store_series)


def _about(what: str, channels: int) -> str:
    return f"{what}, {channels} number{'s' * (channels > 1)} a texel"


def _scatter(points: Callable[[Field, Field], Field], most: int | None = POINTS
             ) -> Callable[[Integers, Field, Field, int], Iterator[Field]]:
    """Points made into numbers, so many at a time, and summed by rays."""
    def sums(ray: Integers, depth: Field, tau: Field, count: int) -> Iterator[Field]:
        for values in points(depth, tau):
            yield np.bincount(ray, weights=values, minlength=count).astype(np.float64, copy=False)

    def scatter(ray: Integers, depth: Field, tau: Field, count: int) -> Iterator[Field]:
        if most is None or ray.size <= most:
            return sums(ray, depth, tau, count)
        pieces = [slice(begin, begin + most) for begin in range(0, ray.size, most)]
        total = np.stack(list(sums(ray[pieces[0]], depth[pieces[0]], tau[pieces[0]], count)))
        for some in pieces[1:]:
            for plane, values in zip(total, sums(ray[some], depth[some], tau[some], count), strict=True):
                plane += values
        return iter(total)

    return scatter


def _store_series(numbers: Field) -> Field:
    return store_series(numbers, "float16", axis=-3)


def _within(steps: Callable[[Field, Field, Field, bool], Field], points: Callable[[Field, Field], Field]
            ) -> Callable[[Field, Field, Field, bool], Field]:
    """Steps whose middles or points may lie beyond the range: what is behind it dims nothing that is looked up, what
    is before it dims all of it. (A Fourier series is periodic instead.)"""
    def gather(start: Field, step: Field, tau: Field, filled: bool) -> Field:
        if not ((start < 0.0).any() or (start + (len(tau) - 1) * step > 1.0).any()):
            return steps(start, step, tau, filled)
        depth = start + np.arange(len(tau)).reshape(-1, 1) * step
        before, behind = depth < 0.0, depth > 1.0
        inside = np.where(before | behind, 0.0, tau).astype(tau.dtype)
        # Where nothing is inside, depths may be any number.
        some = ~(before | behind).all(axis=0)
        first = np.sum(np.where(before, tau, 0.0), axis=0)
        return (steps(np.where(some, start, 0.0), np.where(some, step, 0.0), inside, filled)
                + points(np.zeros_like(first), first))

    return gather


# --- opacity shadow maps ----------------------------------------------------------------------------


def _slices(slices: int) -> Code:
    """Optical depth up to each slice's end, linear in between [Kim 2001]: `opacity_slices`, which hold "depth".

    Sums to the ends, and not of the slices, are what is added, so nothing is left to do when all has been gathered.
    """
    ends = (np.arange(slices) + 1.0) / slices

    def stretches(start: Field, stop: Field, tau: Field) -> Field:
        length = stop - start
        point = length < np.finfo(length.dtype).tiny
        scale = 1.0 / np.where(point, 1.0, length)
        held = _held(start, slices)
        return np.stack([tau * np.where(point, held <= k, np.clip((end - start) * scale, 0.0, 1.0))
                         for k, end in enumerate(ends.tolist())])

    def falling(start: Field, stop: Field, most: Field, slope: Field) -> Field:
        length, steep = stop - start, np.abs(slope)
        result = []
        for end in ends.tolist():
            part = np.minimum(np.maximum(end - start, 0.0), length)
            x = steep * part
            with np.errstate(under="ignore"):
                # A rising one begins thinner, by what it rises to its end.
                thinner = np.where(slope < 0.0, np.exp(-steep * (length - part)), 1.0)
                result.append(most * thinner * part * np.where(x > 0.0, -np.expm1(-x) / np.where(x > 0.0, x, 1.0), 1.0))
        return np.stack(result)

    def steps(start: Field, step: Field, tau: Field, filled: bool) -> Field:
        sums = np.zeros((len(tau) + 1, *tau.shape[1:]))
        np.cumsum(tau, axis=0, out=sums[1:])
        ray = np.arange(sums.shape[1])
        over = 1.0 / np.maximum(step, 1e-300)
        result = np.empty((slices, sums.shape[1]))
        result[-1] = sums[-1]
        for k, end in enumerate(ends[:-1].tolist()):
            if filled:
                u = np.clip((end - start) * over + 0.5, 0.0, len(tau))
                whole = np.minimum(u.astype(np.intp), len(tau) - 1)
                result[k] = sums[whole, ray] + (u - whole) * tau[whole, ray]
            else:
                before = np.clip(np.ceil((end - start) * over), 0.0, len(tau)).astype(np.intp)
                result[k] = sums[before, ray]
        return result

    def points(depth: Field, tau: Field) -> Field:
        held = _held(depth, slices)
        return np.stack([tau * (held <= k) for k in range(slices)])

    def scatter(ray: Integers, depth: Field, tau: Field, count: int) -> Iterator[Field]:
        # In one pass, however many slices there are.
        place = _held(depth, slices).astype(np.intp) * count + ray
        each = np.bincount(place, weights=tau, minlength=slices * count).astype(np.float64, copy=False)
        whole = each.reshape(slices, count)
        return iter(np.cumsum(whole, axis=0, out=whole))

    def held_in_halves(numbers: Field) -> Field:  # behind the largest number nothing passes either
        return store(np.minimum(numbers, numbers.dtype.type(FLOATS["float16"].maximum)), "float16")

    return Code(_about("opacity slices", slices), slices, stretches, falling, _within(steps, points), points,
                lambda tau: stretches(np.zeros_like(tau), np.ones_like(tau), tau), scatter, held_in_halves,
                Reading(_read_slices, _fetch_slices, each=True))


def _held(depth: Field, slices: int) -> Field:
    """Which slice holds a point: its beginning is its own, its end the next one's, but for the last."""
    return np.floor(np.minimum(depth * slices, slices - 1.0))


def _fetch_slices(flat: Field, texel: Integers, depth: Field) -> Field:
    """Two of each texel's numbers, and what is linear between them; 0 at depth 0."""
    slices, count = flat.shape
    place = np.minimum(np.maximum(depth, 0.0), 1.0) * slices
    below = np.minimum(np.floor(place), slices - 1.0)
    share = place - below
    index = below.astype(np.intp) * count + texel
    numbers = flat.reshape(-1)
    far = numbers.take(index)
    near = np.where(below > 0.0, numbers.take(np.maximum(index - count, 0)), 0.0)
    return np.asarray(near * (1.0 - share) + far * share, np.result_type(flat, depth))


def _read_slices(planes: Field, depth: Field) -> Field:
    flat = planes.reshape(len(planes), -1)
    texel = np.arange(flat.shape[1]).reshape(planes.shape[1:])
    return _fetch_slices(flat, texel, depth)


# --- extinction transmittance maps ------------------------------------------------------------------


def _cosine(count: int) -> Code:
    """Cosine coefficients c_0 … [Gautron 2011]: `cosine_maps`, real Fourier coefficients at half the depths."""
    highest = count - 1

    def stretches(start: Field, stop: Field, tau: Field) -> Field:
        return cosine_maps.cosine_coefficients(_one(start, stop, tau), count=count)

    def steps(start: Field, step: Field, tau: Field, filled: bool) -> Field:
        made = fom.even_coefficients(0.5 * start, 0.5 * step, tau, harmonics=highest, filled=filled)
        return np.asarray(made[0])

    def falling(start: Field, stop: Field, most: Field, slope: Field) -> Field:
        made = fom.falling_coefficients(0.5 * start[np.newaxis], 0.5 * stop[np.newaxis], 2.0 * most[np.newaxis],
                                        2.0 * slope[np.newaxis], harmonics=highest)
        return np.asarray(made[0])

    def points(depth: Field, tau: Field) -> Field:
        return np.asarray(fom.sample_coefficients(0.5 * depth[np.newaxis], tau[np.newaxis], harmonics=highest)[0])

    def uniform(tau: Field) -> Field:
        result = np.zeros((count, *tau.shape), tau.dtype)
        result[0] = 2.0 * tau
        return result

    return Code(_about("cosine series", count), count, stretches, falling, _within(steps, points), points, uniform,
                _scatter(points), _store_series, Reading(cosine_maps.optical_depth, None, each=False))


def _one(start: Field, stop: Field, tau: Field) -> Absorbers:
    """One stretch of constant extinction on each ray."""
    return Absorbers(start[np.newaxis], stop[np.newaxis], tau[np.newaxis], np.zeros((1, 1), tau.dtype))


# --- moments ----------------------------------------------------------------------------------------


def _power(channels: int, storage: str | None, overestimation: float) -> Code:
    """Power moments b_0 … of z = 2d − 1 [Münstermann 2018]: `power_moments`."""
    count = channels - 1

    def stretches(start: Field, stop: Field, tau: Field) -> Field:
        return power_moments.power_moments(_one(start, stop, tau), count=count)

    def falling(start: Field, stop: Field, most: Field, slope: Field) -> Field:
        # From the denser end e inwards: z = e ± 2δs, and ∫ s^j exp(−xs) ds over [0, 1].
        length = stop - start
        end = 2.0 * np.where(slope >= 0.0, start, stop) - 1.0
        inwards = 2.0 * np.where(slope >= 0.0, length, -length)
        with np.errstate(under="ignore"):
            rest = [most * length * each for each in _falling_powers(np.abs(slope) * length, count)]
            return _about_a_point(end, inwards, rest)

    def steps(start: Field, step: Field, tau: Field, filled: bool) -> Field:
        # The moments of the steps' middles; then, for stretches, of what is spread by half a step about them.
        first, ahead = 2.0 * np.asarray(start, np.float64) - 1.0, 2.0 * np.asarray(step, np.float64)
        sums = np.zeros((channels, *np.broadcast_shapes(first.shape, tau.shape[1:])))
        for i, each in enumerate(tau):
            z, power = first + i * ahead, each.astype(np.float64)
            for total in sums:
                total += power
                power = power * z
        return _spread(sums, 0.5 * ahead) if filled else sums

    def points(depth: Field, tau: Field) -> Field:
        z, power = 2.0 * depth - 1.0, tau
        result = [power]
        for _ in range(count):
            power = power * z
            result.append(power)
        return np.stack(result)

    def passed(moments: Field, depth: Field) -> Field:
        return power_moments.transmittance(moments, depth, storage=storage, overestimation=overestimation)

    return Code(_about("power moments", channels), channels, stretches, falling, _within(steps, points), points,
                lambda tau: stretches(np.zeros_like(tau), np.ones_like(tau), tau), _scatter(points), _store_series,
                _moments_reading(passed))


def _falling_powers(x: Field, highest: int) -> list[Field]:
    """∫ s^j exp(−xs) ds over [0, 1] for j = 0 … highest, all terms of the recurrence positive or small.

    Downwards, M_{j−1} = (x M_j + e^{−x})/j, from the incomplete gamma function (a series where x < 1); beyond x = 20
    upwards.
    """
    left = np.exp(-x)
    deep = x > 20.0
    down = np.where(deep, 1.0, x)
    series, term = np.zeros_like(x), np.full_like(x, 1.0 / (highest + 1.0))
    small = np.minimum(x, 1.0)
    for i in range(18):
        series += term
        term = term * small / (highest + 2.0 + i)
    order = highest + 1.0
    mass = gammainc(order, np.maximum(down, 1.0)) * math.gamma(order) * np.maximum(down, 1.0) ** -order
    last = np.where(x < 1.0, np.exp(-small) * series, mass)
    falling = [last]
    for j in range(highest, 0, -1):
        falling.append((down * falling[-1] + np.exp(-down)) / j)
    rising = [-np.expm1(-x) / np.where(deep, x, 1.0)]
    over = 1.0 / np.where(deep, x, 1.0)
    for j in range(1, highest + 1):
        rising.append((j * rising[-1] - left) * over)
    return [np.where(deep, up, down) for up, down in zip(rising, falling[::-1], strict=True)]


def _about_a_point(centre: Field, scale: Field, moments: Sequence[Field]) -> Field:
    """Moments of z = centre + scale·s, from those of s: the binomial theorem."""
    scaled, factor = [], np.ones_like(scale)
    for each in moments:
        scaled.append(each * factor)
        factor = factor * scale
    result = []
    for k in range(len(moments)):
        total = scaled[0]
        for j in range(1, k + 1):  # Horner's rule in the centre: Σ C(k, j) centre^{k−j} scaled_j
            total = total * centre + math.comb(k, j) * scaled[j]
        result.append(total)
    return np.stack(result)


def _spread(sums: Array, half: Field) -> Array:
    """Moments of points, each made a stretch of constant extinction that reaches by ``half`` before and behind it."""
    square = half * half
    result = np.empty_like(sums)
    for k in range(len(sums)):
        factor, total = np.ones_like(square), sums[k]
        for j in range(2, k + 1, 2):
            factor = factor * square
            total = total + (math.comb(k, j) / (j + 1.0)) * factor * sums[k - j]
        result[k] = total
    return result


def _trigonometric(channels: int, storage: str | None, overestimation: float) -> Code:
    """Trigonometric moments [Münstermann 2018]: `trigonometric_moments`, half the Fourier coefficients on an arc."""
    count = channels // 2

    def moments(pairs: Field) -> Field:  # b_0, then real and imaginary parts
        return np.delete(0.5 * planes_of(pairs), 1, axis=0)

    def stretches(start: Field, stop: Field, tau: Field) -> Field:
        return trigonometric_moments.trigonometric_moments(_one(start, stop, tau), count=count)

    def steps(start: Field, step: Field, tau: Field, filled: bool) -> Field:
        return moments(fom.even_coefficients(TURN * start, TURN * step, tau, harmonics=count, filled=filled))

    def falling(start: Field, stop: Field, most: Field, slope: Field) -> Field:
        return moments(fom.falling_coefficients(
            TURN * start[np.newaxis], TURN * stop[np.newaxis], most[np.newaxis] / TURN, slope[np.newaxis] / TURN,
            harmonics=count))

    def points(depth: Field, tau: Field) -> Field:
        return moments(fom.sample_coefficients(TURN * depth[np.newaxis], tau[np.newaxis], harmonics=count))

    def passed(numbers: Field, depth: Field) -> Field:
        return trigonometric_moments.transmittance(numbers, depth, storage=storage, overestimation=overestimation)

    return Code(_about("trigonometric moments", channels), channels, stretches, falling, _within(steps, points), points,
                lambda tau: stretches(np.zeros_like(tau), np.ones_like(tau), tau), _scatter(points), _store_series,
                _moments_reading(passed))


def _moments_reading(passed: Transmittance) -> Reading:
    """Optical depth from moments.

    Of the moments over b_0, what has the optical depth 1: −ln of what it lets through is the share that lies before a
    depth, without overflow, and times b_0 the optical depth. Nothing lies before depth 0, and all of it before depth 1.
    """
    def read(planes: Field, depth: Field) -> Field:
        shape = np.broadcast_shapes(planes.shape[1:], depth.shape)
        one = planes[0].size == 1
        numbers = np.asarray(planes.reshape(len(planes), -1), np.float64)
        places = np.broadcast_to(depth, shape).reshape(-1)
        whole = np.broadcast_to(numbers[0], places.shape)
        result = np.where(places >= 1.0, whole, 0.0)
        chosen = np.flatnonzero((places > 0.0) & (places < 1.0) & (whole > 0.0))
        for begin in range(0, chosen.size, LOOKUPS):
            some = chosen[begin:begin + LOOKUPS]
            d = np.asarray(places[some], np.float64)
            if one:
                share = -np.log(passed(numbers / numbers[0], d[:, np.newaxis]))[:, 0]
            else:
                ours = numbers.take(some, axis=1)
                share = -np.log(passed(ours / ours[0], d[np.newaxis]))[0]
            result[some] = whole[some] * np.minimum(np.maximum(share, 0.0), 1.0)
        return np.asarray(result.reshape(shape), np.result_type(planes, depth))

    return Reading(read, None, each=False)
