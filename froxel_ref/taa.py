"""Temporal anti-aliasing of images: jittered pixels, a clipped history and an exponential moving average.

The tone map c/(1 + luma(c)) that all colours pass through is a projective map: a colour is (T, w) with T = c·w and
w = 1/(1 + luma(c)), and averaging tone-mapped colours is averaging colours with the weights w [Karis 2014]. Means and
clipping towards a box's centre act on (T, w) alike, so here w is carried along instead of being won back as 1 − luma(T)
(D9), and a colour that is not clipped never leaves its linear form.
"""

from __future__ import annotations

from fractions import Fraction
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from froxel_ref import blocks
from froxel_ref.arrays import Field
from froxel_ref.image_motion import Motion
from froxel_ref.jitter import mirrored
from froxel_ref.records import InputError, shown, suggest
from froxel_ref.sampling import at_centres, fetch_bilinear
from froxel_ref.tonemap import AUTHOR_LARGEST_LUMA, inverse_tone_map, luma

__all__ = ["AUTHOR", "BORDERS", "CLIPS", "INVERSES", "KERNELS", "POINTS", "PUBLISHED", "SPACES", "author_alpha",
           "fetch_history", "pixel_offsets", "resolve"]

Flags = NDArray[np.bool_]

POINTS = ("centred", "published")
KERNELS = ("five_tap", "bicubic", "bilinear")
CLIPS = ("line", "clamp", "off")
SPACES = ("ycocg", "rgb")
BORDERS = ("inside", "repeat", "zero")
INVERSES = ("carried", "luma")

PUBLISHED: dict[str, Any] = {"space": "rgb", "border": "repeat", "least_variance": 1e-7, "inverse": "luma",
                             "largest_luma": 1.0}
"""Options of `resolve` that follow the thesis's text [Dörries 2020, §3.2.6, listing 3.9]."""

AUTHOR: dict[str, Any] = PUBLISHED | {"border": "zero", "padding": 1e-5, "largest_luma": AUTHOR_LARGEST_LUMA}
"""Those that follow its program (A10); the weight comes from `author_alpha`."""

# Offsets are whole multiples of this [pixels], so that their sum is exact in whatever order and in float32.
GRAIN = 2.0**-24

# Halton points a cycle may have: beyond, their mean is so near to ½ that centred points would leave the pixel.
MOST = 64

# The centre of a pixel beyond every image: where an infinite position is taken to lie, for it has no fraction.
FAR = 2.0**30 + 0.5

# Pixels in a block: some thirty operands of a block of rows, of which most fit the cache together.
BLOCK = 16384

AROUND = tuple((j, i) for j in (-1, 0, 1) for i in (-1, 0, 1))


# --- jitter -----------------------------------------------------------------------------------------


def pixel_offsets(frame: ArrayLike, *, points: str = "centred", count: int = 16) -> NDArray[np.float64]:
    """Tell how far from their pixels' centres the samples of a frame lie.

    Parameters
    ----------
    frame : int or array_like of int, shape (…)
        The frames' numbers; negative ones continue the cycle backwards.
    points : {"centred", "published"}
        "published": the Halton points of bases 2 and 3 with the indices 1 … count, less ½. "centred" (the default):
        the same, moved so that their mean is 0 (D10).
    count : int
        How many points a cycle has, 1 to 64; 16 in [Dörries 2020, §3.2.6].

    Returns
    -------
    ndarray, shape (…, 2), float64 [pixels]
        To the right and downwards, in (−½, ½). ½ + offset is the ``jitter`` of `froxel_ref.geometry.camera_rays`.

    Raises
    ------
    InputError
        A frame that is no whole number; an unknown word; a count out of range.

    Notes
    -----
    The 16 published points average (−0.029, −0.037) pixels: a still image, filtered for long, is shifted by that
    against one without jitter. The centred ones are whole multiples of 2⁻²⁴ pixels whose sum is exactly 0, in any order
    and in float32 too; each is within 2⁻²⁴ of the published point less the mean.

    Examples
    --------
    >>> pixel_offsets(0, points="published").round(6).tolist()
    [0.0, -0.166667]
    >>> pixel_offsets(np.arange(16)).mean(axis=0).tolist()
    [0.0, 0.0]
    """
    index = np.asarray(frame)
    if index.dtype.kind not in "iu":
        raise InputError("frame", f"is {shown(frame)}, must be a whole number")
    if points not in POINTS:
        raise InputError("points", f"is {shown(points)}; {suggest(str(points), POINTS)}")
    if not isinstance(count, (int, np.integer)) or isinstance(count, bool) or not 1 <= count <= MOST:
        raise InputError("count", f"is {shown(count)}, must be a whole number, 1 to {MOST}")
    result: NDArray[np.float64] = _cycle(points, int(count))[index % int(count)]
    return result


@lru_cache(maxsize=16)
def _cycle(points: str, count: int) -> NDArray[np.float64]:
    """All offsets of a cycle, (count, 2), read-only."""
    columns = []
    for base in (2, 3):
        exact = [mirrored(index, base) - Fraction(1, 2) for index in range(1, count + 1)]
        columns.append(_centred(exact) if points == "centred" else [float(value) for value in exact])
    result = np.array(columns).T
    result.setflags(write=False)
    return result


def _centred(values: list[Fraction]) -> list[float]:
    """The values less their mean as multiples of `GRAIN` whose sum is 0: rounded down, the largest rests up."""
    mean = Fraction(sum(values), len(values))
    scaled = [(value - mean) / Fraction(GRAIN) for value in values]
    whole = [int(value // 1) for value in scaled]
    missing = -sum(whole)
    for i in sorted(range(len(values)), key=lambda i: whole[i] - scaled[i])[:missing]:
        whole[i] += 1
    return [number * GRAIN for number in whole]


def author_alpha(x: Field, y: Field, offset: ArrayLike) -> Field:
    """Weight of the current frame in the thesis's own program (A10).

    Parameters
    ----------
    x, y : Field, broadcastable to (h, w) [pixels]
        Where the history is fetched, as in `Motion`.
    offset : array_like, shape (2,) [pixels]
        The frame's jitter, from `pixel_offsets`.

    Returns
    -------
    Field, broadcastable to (h, w)
        The ``alpha`` of `resolve`, in (0, 0.8]; 0.8 at most where a coordinate is NaN, which has no history.

    Raises
    ------
    InputError
        An offset of another shape, or not finite.

    Notes
    -----
    (0.05 + 0.75·|2·frac(m) − 1|)·exp(−2.29·|jitter|), the farther from a pixel's centre the history is fetched the more
    of the current frame, against blur. The thesis gives no weight at all and the formula's m and unit are the
    program's: m = max(|x|, |y|), so of the two coordinates only the larger counts; and |jitter| is the length in half
    pixels, since it is the offset in clip space times the image's size, so twice the length of ``offset``. At rest
    frac(m) is ½, and the weight between 0.05 and 0.05·exp(−2.29·√2) = 0.002.

    Examples
    --------
    >>> author_alpha(np.array([[7.5, 8.0]]), np.array([[0.5]]), (0.0, 0.0)).tolist()
    [[0.05, 0.8]]
    """
    jitter = np.asarray(offset, np.float64)
    if jitter.shape != (2,) or not np.isfinite(jitter).all():
        raise InputError("offset", f"is {shown(offset)}, must be two finite numbers")
    largest = np.maximum(np.abs(x), np.abs(y))
    with np.errstate(invalid="ignore"):  # infinite positions
        beside = np.abs(2.0 * (largest - np.floor(largest)) - 1.0)
    weight = (0.05 + 0.75 * beside) * np.exp(-2.29 * 2.0 * np.hypot(*jitter))
    return np.asarray(np.where(np.isnan(weight), 0.8, weight).astype(np.result_type(x, y)))


# --- history ----------------------------------------------------------------------------------------


def fetch_history(history: Field, x: Field, y: Field, *, kernel: str = "five_tap", weight_bits: int | None = None,
                  threads: int | None = 1) -> Field:
    """Fetch an image between its pixels' centres by a Catmull–Rom spline, clamped at the edges.

    Parameters
    ----------
    history : Field, shape (h, w) or (c, h, w)
        The image of the frame before.
    x, y : Field, broadcastable to a common shape (…) [pixels]
        Where; 0 and w are the image's edges, centres lie at i + ½.
    kernel : {"five_tap", "bicubic", "bilinear"}
        "bicubic": all 16 pixels. "five_tap" (the default): without the four at the corners, the other weights divided
        by their sum, which are five bilinear fetches [Jimenez 2016; Dörries 2020, §3.2.6]. "bilinear": the blur that
        both are against.
    weight_bits : int, optional
        Of the bilinear fetches' weights, as for `froxel_ref.sampling.fetch_bilinear`.
    threads : int, optional
        As for `froxel_ref.sampling.fetch_bilinear`.

    Returns
    -------
    Field, shape (…) or (c, …)
        In the dtype of ``history``. May leave the range of the pixels. NaN where a pixel that is not finite has
        weight, and where a coordinate is NaN.

    Raises
    ------
    InputError
        Another number of axes, an image without pixels, an unknown kernel, weight_bits out of range.

    Notes
    -----
    Weights along an axis, f from the centre before: −½f + f² − ½f³, 1 − 5/2 f² + 3/2 f³, ½f + 2f² − 3/2 f³,
    −½f² + ½f³. The inner two of either axis make one bilinear fetch. A centre gives its pixel and a constant image
    that constant, both exactly, for values are formed as differences from the middle. Where all coordinates are the
    centres the result is ``history`` itself.

    "bicubic" is of order 3 in the pixel's size. "five_tap" is not: the middle fetch of the rows above and below is not
    at f, and with the corners goes what balances it, so a slope is off by up to 0.0061 of what a pixel changes
    (measured, at f = 0.21 and ½), order 1, where "bilinear" is of order 2.

    Examples
    --------
    >>> edge = np.array([[0.0, 0.0, 1.0, 1.0]])
    >>> fetch_history(edge, np.array([[1.5, 2.0, 2.5, 3.0]]), np.array([[0.5]])).tolist()
    [[0.0, 0.5, 1.0, 1.0625]]
    """
    if history.ndim not in (2, 3) or 0 in history.shape:
        raise InputError("history", f"has shape {history.shape}, must have 2 axes, or 3 with channels first, none of "
                                    "them empty")
    if kernel not in KERNELS:
        raise InputError("kernel", f"is {shown(kernel)}; {suggest(str(kernel), KERNELS)}")
    height, width = history.shape[-2:]
    if x.ndim == y.ndim == 2 and at_centres(x, 1, width) and at_centres(y, 0, height):
        return history
    x, y = np.asarray(np.clip(x, -FAR, FAR)), np.asarray(np.clip(y, -FAR, FAR))
    finite = np.isfinite(history)
    present = finite if history.ndim == 2 else finite.all(axis=0)
    if present.all():
        fetched = _fetch(history, x, y, kernel, weight_bits, threads)
    else:
        clean = np.asarray(np.where(present, history, 0), history.dtype)
        fetched = _fetch(clean, x, y, kernel, weight_bits, threads)
        spoilt = _fetch(np.asarray(~present, np.float64), x, y, kernel, None, threads, absolute=True) > 0.0
        fetched = np.asarray(np.where(spoilt, np.nan, fetched))
    with np.errstate(over="ignore"):  # an overshoot of the largest numbers
        return fetched.astype(history.dtype, copy=False)


def _fetch(image: Field, x: Field, y: Field, kernel: str, bits: int | None, threads: int | None, *,
           absolute: bool = False) -> Field:
    """One kernel's fetch of finite pixels; ``absolute``: all weights taken as positive, and not divided."""
    if kernel == "bilinear":
        return fetch_bilinear(image, x, y, weight_bits=bits, threads=threads)
    (left, wx), (top, wy) = _spline(x), _spline(y)
    if kernel == "bicubic":
        columns = [(left + (k - 0.5), wx[k]) for k in range(4)]
        rows = [(top + (k - 0.5), wy[k]) for k in range(4)]
        taps = [(cx, cy, ax * ay) for cy, ay in rows for cx, ax in columns]
        middle, total = taps.pop(5), np.ones(())
    else:
        inner_x, inner_y = wx[1] + wx[2], wy[1] + wy[2]
        cx, cy = left + (0.5 + wx[2] / inner_x), top + (0.5 + wy[2] / inner_y)
        middle = (cx, cy, inner_x * inner_y)
        taps = [(cx, top - 0.5, inner_x * wy[0]), (cx, top + 2.5, inner_x * wy[3]),
                (left - 0.5, cy, wx[0] * inner_y), (left + 2.5, cy, wx[3] * inner_y)]
        total = np.asarray(1.0 - (1.0 - inner_x) * (1.0 - inner_y))
    reference = fetch_bilinear(image, middle[0], middle[1], weight_bits=bits, threads=threads)
    others = [fetch_bilinear(image, u, v, weight_bits=bits, threads=threads) for u, v, _ in taps]
    if absolute:
        return np.asarray(sum((np.abs(tap[2]) * value for tap, value in zip(taps, others, strict=True)), reference))
    with np.errstate(over="ignore"):  # an overshoot of the largest numbers
        rest = sum(tap[2] * (value - reference) for tap, value in zip(taps, others, strict=True))
        return np.asarray(reference + rest / total)


def _spline(coordinate: Field) -> tuple[Field, list[Field]]:
    """The left edge of the pixel whose centre lies before a coordinate, and the weights of it and its neighbours."""
    t = coordinate - 0.5
    before = np.floor(t)
    f = t - before
    return before, [f * (-0.5 + f * (1.0 - 0.5 * f)), 1.0 + f * f * (1.5 * f - 2.5), f * (0.5 + f * (2.0 - 1.5 * f)),
                    f * f * (0.5 * f - 0.5)]


# --- resolving --------------------------------------------------------------------------------------


class _Toned(NamedTuple):
    """Tone-mapped colours."""

    colour: Field  # T, (3, …)
    weight: Field  # w = 1 − luma(T), (…)


class _Box(NamedTuple):
    """What the 3×3 pixels about each pixel hold."""

    mean: _Toned
    middle: Field  # the mean in the box's space, (3, …)
    half: Field  # half the box's edges, (3, …)
    any: Flags  # whether a pixel of them counts


class _Options(NamedTuple):
    """What is the same for all pixels; see `resolve`."""

    gamma: float
    clip: str
    space: str
    border: str
    padding: float
    least_variance: float
    tone_mapping: bool
    inverse: str
    largest_luma: float | None


def resolve(current: Field, history: Field | None, pixels: Motion | None = None, *, alpha: ArrayLike = 0.1,
            gamma: float = 1.0, clip: str = "line", space: str = "ycocg", border: str = "inside", padding: float = 0.0,
            least_variance: float = 0.0, kernel: str = "five_tap", tone_mapping: bool = True,
            inverse: str = "carried", largest_luma: float | None = None, largest: float | None = None,
            exposure_ratio: float = 1.0, cut: bool = False, threads: int | None = 1) -> Field:
    """Average an image with its history, clipped to what the image shows there now.

    Parameters
    ----------
    current : Field, shape (3, h, w) [W m⁻² sr⁻¹]
        Radiance of this frame, sampled at the pixels' jittered places. What is negative counts as 0.
    history : Field, like ``current``, or None
        What this function returned for the frame before; None for the first frame. One of the two may have length 1
        along an axis on which it does not vary.
    pixels : Motion, optional
        Where the pixels were, mostly from `froxel_ref.image_motion.closest_depth`; where they are, unless given.
    alpha : float or array_like, broadcastable to (h, w), in (0, 1]
        Weight of the current frame. The thesis gives none for images, and its program moves between 0.002 and 0.8
        (`author_alpha`, A10); 0.1 is the field's custom.
    gamma : float
        γ, at least 0: the box reaches this many standard deviations from the mean; 1 in [Dörries 2020, listing 3.9].
    clip : {"line", "clamp", "off"}
        Move what lies outside the box towards the box's centre up to its side [Karis 2014], or each channel by itself,
        or not at all.
    space : {"ycocg", "rgb"}
        Of the box. Published: "rgb" (A10).
    border : {"inside", "repeat", "zero"}
        Pixels beyond the image's edge: not there, those at the edge once more (published), or black (A10).
    padding : float
        Added to half the box's edges; 1e-5 in the author's program (A10).
    least_variance : float
        Smallest variance of a channel; 1e-7 in [Dörries 2020, listing 3.9].
    kernel : {"five_tap", "bicubic", "bilinear"}
        As for `fetch_history`.
    tone_mapping : bool
        Average and clip tone-mapped colours, or linear ones.
    inverse : {"carried", "luma"}
        How an average comes back: with the carried weights, or as published by T/(1 − luma(T)) (D9).
    largest_luma : float, optional
        For "luma" and for "clamp", as for `froxel_ref.tonemap.inverse_tone_map`.
    largest : float, optional
        Largest number that the result may hold: 65504 where it is stored in float16, that a fetch of the brightest,
        which may overshoot, does not become an infinity. Default: the type's largest.
    exposure_ratio : float
        A12: this frame's exposure over that of the frame before, where light is stored exposed.
    cut : bool
        The camera was cut: nothing of the history is used.
    threads : int, optional
        Default 1; None: one per core. The result does not depend on it.

    Returns
    -------
    Field, shape (3, h, w)
        In the dtype of current and history together. Finite whatever these hold, unless ``inverse`` is "luma" and
        ``largest_luma`` 1.

    Raises
    ------
    InputError
        Images without three channels or of unlike shapes; an option out of range; an unknown word.

    Notes
    -----
    With Y the current colour, S the history at the pixel's former place (cut to at least 0), all tone-mapped as T and w
    (eq. 3.3), m and σ mean and standard deviation of the 3×3 pixels about it [Salvi 2016; Dörries 2020, listing 3.9]:
    S' is S clipped to m ± γσ, and the result T⁻¹(α·T(Y) + (1 − α)·T(S')). This equals S' + β(Y − S') with
    β = αw_Y/(αw_Y + (1 − α)w_S'), which is how it is formed, from the heavier of both: equal colours give that colour
    exactly, and the result lies between Y and S' in every channel. S' itself is S bit for bit where it lies in the box,
    and else (T_m + s(T_S − T_m))/(w_m + s(w_S − w_m)) with the largest s in [0, 1] that leaves it in the box: a mean of
    what is there, with positive weights, so by "line" no result is brighter than all of the nine pixels and the fetched
    history, to some ulp. By "clamp" one can be: channels moved apart may have any luma, which ``largest_luma`` bounds.

    A pixel without history (beyond the former image, behind its camera, not finite there, or ``cut``) is Y alone. One
    whose Y is not finite takes S', and without history T⁻¹ of the mean of its finite neighbours, else 0. It counts in
    no neighbour's box. So nothing that is not finite leaves this function; what has been put into the history from
    elsewhere lasts one frame.

    What it converges to, at rest and unclipped: the mean over the jitter's points with weights w, thus between black
    and white at coverage a not a but, in luma L of the white, a·L/(1 + (1 − a)·L). The mean itself is that of
    ``tone_mapping=False``.

    Examples
    --------
    >>> now = np.ones((3, 2, 3))
    >>> resolve(now, None) is now, np.array_equal(resolve(now, now), now)
    (False, True)
    >>> resolve(now, 3.0 * now, alpha=0.5, clip="off")[0, 0].round(12).tolist()
    [1.666666666667, 1.666666666667, 1.666666666667]
    >>> resolve(np.where(now > 0, np.nan, 0.0), now)[0, 0].tolist()
    [1.0, 1.0, 1.0]
    """
    options = _Options(float(gamma), clip, space, border, float(padding), float(least_variance), tone_mapping, inverse,
                       largest_luma)
    _check(options, kernel, largest, exposure_ratio)
    shape = _shape(current, history, pixels)
    weight = _weight(alpha, shape)
    dtype = np.dtype(np.result_type(current, *(() if history is None else (history,))))
    dtype = dtype if dtype in (np.float32, np.float64) else np.dtype(np.float64)
    now = np.broadcast_to(current, (3, *shape)).astype(dtype)
    before, usable = np.zeros_like(now), np.zeros(shape, np.bool_)
    if history is not None and not cut:
        before, usable = _history(history, pixels, shape, kernel, exposure_ratio, dtype, threads)
    padded, present = _padded(now, border)
    result = np.empty((3, *shape), dtype)

    def fill(rows: slice) -> None:
        halo = slice(rows.start, rows.stop + 2)
        result[:, rows] = _resolve(padded[:, halo], present[halo], before[:, rows], usable[rows],
                                   weight[rows].astype(dtype), options)

    blocks.run(fill, (rows for _, rows in blocks.blocks(1, *shape, size=BLOCK)), threads=threads)
    if largest is not None or inverse == "carried":
        np.minimum(result, dtype.type(np.finfo(dtype).max if largest is None else largest), out=result)
    return result


def _history(history: Field, pixels: Motion | None, shape: tuple[int, int], kernel: str, exposure_ratio: float,
             dtype: np.dtype[Any], threads: int | None) -> tuple[Field, Flags]:
    """The history at the pixels' former places, at least 0, and where there is one; 0 where there is none."""
    fetched = np.where(np.isfinite(history), np.maximum(history, 0), np.nan).astype(dtype)
    valid: Flags = np.ones((1, 1), np.bool_)
    if pixels is not None:
        full = np.broadcast_to(fetched, (3, *shape))
        fetched, valid = fetch_history(full, pixels.x, pixels.y, kernel=kernel, threads=threads), pixels.valid
    with np.errstate(invalid="ignore", over="ignore"):  # what is not finite is left out
        fetched = fetched * dtype.type(exposure_ratio)
        usable = np.isfinite(fetched).all(axis=0) & valid
        fetched = np.where(usable, np.maximum(fetched, dtype.type(0)), dtype.type(0))
    return np.broadcast_to(fetched, (3, *shape)), np.broadcast_to(usable, shape)


def _padded(current: Field, border: str) -> tuple[Field, Flags]:
    """The image with a pixel more on each side, 0 where it is not finite or negative, and which of them count."""
    finite = np.isfinite(current).all(axis=0)
    clean = np.where(finite, np.maximum(current, 0), 0).astype(current.dtype)
    around = ((0, 0), (1, 1), (1, 1))
    if border == "repeat":
        return np.pad(clean, around, mode="edge"), np.pad(finite, 1, mode="edge")
    return np.pad(clean, around), np.pad(finite, 1, constant_values=border == "zero")


def _resolve(padded: Field, present: Flags, before: Field, usable: Flags, alpha: Field, options: _Options) -> Field:
    """Some rows; ``padded`` and ``present`` have a row or column more on each side."""
    toned = _tone(padded, options)
    inside = (slice(1, -1), slice(1, -1))
    current, finite = padded[:, 1:-1, 1:-1], present[inside]
    box = _box(toned, present, options)
    now, then = _Toned(toned.colour[:, 1:-1, 1:-1], toned.weight[inside]), _tone(before, options)
    linear, then = _clip(before, then, box, options)
    if options.inverse == "luma" and options.tone_mapping:
        kept = np.where(finite, alpha, 0)
        mixed = inverse_tone_map(then.colour + kept * (now.colour - then.colour), largest_luma=options.largest_luma)
    else:
        mixed = np.where(finite, _mix(current, linear, now.weight, then.weight, alpha), linear)
    alone = np.where(finite, current, np.where(box.any, _linear(box.mean), 0))
    return np.where(usable, mixed, alone)


def _tone(colour: Field, options: _Options) -> _Toned:
    """T and w of colours of at least 0; in linear averages the colour and 1."""
    one = colour.dtype.type(1)
    if not options.tone_mapping:
        return _Toned(colour, np.ones(colour.shape[1:], colour.dtype))
    below = one + luma(colour)
    return _Toned(colour / below, one / below)


def _linear(toned: _Toned) -> Field:
    """T/w, finite."""
    with np.errstate(over="ignore"):
        return np.asarray(np.minimum(toned.colour / toned.weight, np.finfo(toned.colour.dtype).max))


def _box(toned: _Toned, present: Flags, options: _Options) -> _Box:
    """Mean and spread of the 3×3 pixels about each; both are formed from differences to the middle pixel."""
    height, width = present.shape[0] - 2, present.shape[1] - 2
    taps = [(slice(1 + j, 1 + j + height), slice(1 + i, 1 + i + width)) for j, i in AROUND]
    both = np.concatenate([toned.colour, toned.weight[np.newaxis]])
    middle = both[:, 1:-1, 1:-1]
    found = sum(present[tap].astype(both.dtype) for tap in taps)
    each = 1 / np.maximum(found, both.dtype.type(1))
    mean = middle + sum(np.where(present[tap], (both[:, *tap] - middle) * each, 0) for tap in taps)
    variance = np.zeros_like(mean[:3])
    with np.errstate(over="ignore", invalid="ignore"):  # squares of linear colours: what is too wide clips nothing
        for tap in taps:
            off = _to_space(both[:3, *tap] - mean[:3], options.space)
            variance += np.where(present[tap], off * off * each, 0)
        deviation = np.sqrt(np.maximum(variance, both.dtype.type(options.least_variance)))
        half = both.dtype.type(options.gamma) * deviation + both.dtype.type(options.padding)
    return _Box(_Toned(mean[:3], mean[3]), _to_space(mean[:3], options.space), half, np.asarray(found > 0))


def _clip(before: Field, then: _Toned, box: _Box, options: _Options) -> tuple[Field, _Toned]:
    """The history clipped to the box, where there is one: its linear colour, T and w."""
    if options.clip == "off":
        return before, then
    off = _to_space(then.colour - box.mean.colour, options.space)
    over = (np.abs(off) > box.half) & box.any
    outside = over.any(axis=0)
    if options.clip == "clamp":
        moved = np.where(over, np.copysign(box.half, off), off)
        colour = np.maximum(box.mean.colour + _from_space(moved, options.space), 0)
        colour = np.where(outside, colour, then.colour)
        if not options.tone_mapping:
            return colour, _Toned(colour, then.weight)
        most = 1.0 - float(np.finfo(colour.dtype).epsneg) if options.largest_luma is None else options.largest_luma
        weight = np.where(outside, 1 - np.minimum(luma(colour), colour.dtype.type(most)), then.weight)
        weight = np.maximum(weight, np.finfo(colour.dtype).tiny)
        clipped = _Toned(colour, weight)
    else:
        share = np.where(over, box.half / np.where(over, np.abs(off), 1), 1).min(axis=0)
        # Two products of nothing negative: the weight stays above 0 and keeps its digits, however small one of both is.
        rest = 1 - share
        clipped = _Toned(rest * box.mean.colour + share * then.colour, rest * box.mean.weight + share * then.weight)
    return np.where(outside, _linear(clipped), before), _Toned(np.where(outside, clipped.colour, then.colour),
                                                              np.where(outside, clipped.weight, then.weight))


def _mix(current: Field, history: Field, current_weight: Field, history_weight: Field, alpha: Field) -> Field:
    """α·Y + (1 − α)·S of the tone-mapped colours, as an average of the linear ones."""
    with np.errstate(over="ignore", under="ignore"):
        ratio = np.minimum(history_weight / current_weight, np.finfo(alpha.dtype).max)
        share = alpha / (alpha + (1 - alpha) * ratio)
        rest = (1 - alpha) * ratio / (alpha + (1 - alpha) * ratio)
        return np.where(share <= 0.5, history + share * (current - history), current + rest * (history - current))


def _to_space(colour: Field, space: str) -> Field:
    """RGB, or luma and two differences of colour: Y, Co and Cg."""
    if space == "rgb":
        return colour
    red, green, blue = colour
    half, quarter = colour.dtype.type(0.5), colour.dtype.type(0.25)
    sides = quarter * red + quarter * blue
    return np.stack([sides + half * green, half * red - half * blue, half * green - sides])


def _from_space(colour: Field, space: str) -> Field:
    """The inverse of `_to_space`."""
    if space == "rgb":
        return colour
    y, orange, green = colour
    return np.stack([y - green + orange, y + green, y - green - orange])


def _shape(current: Field, history: Field | None, pixels: Motion | None) -> tuple[int, int]:
    """Height and width of the image, from what is given of it."""
    if current.ndim != 3 or len(current) != 3 or 0 in current.shape:
        raise InputError("current", f"has shape {current.shape}, must be (3, h, w)")
    if history is not None and (history.ndim != 3 or len(history) != 3 or 0 in history.shape):
        raise InputError("history", f"has shape {history.shape}, must be (3, h, w)")
    rows, columns = current.shape[1:]
    if history is not None:
        if any(n != m and 1 not in (n, m) for n, m in zip(history.shape[1:], (rows, columns), strict=True)):
            raise InputError("history", f"has shape {history.shape}, must be {current.shape}, or 1 along y or x")
        rows, columns = max(rows, history.shape[1]), max(columns, history.shape[2])
    if pixels is not None:
        if any(n not in (1, m) for n, m in zip((rows, columns), pixels.shape, strict=True)):
            raise InputError("pixels", f"are of an image of {pixels.shape}, must be of {(rows, columns)}")
        return pixels.shape
    return rows, columns


def _weight(alpha: ArrayLike, shape: tuple[int, int]) -> Field:
    """The current frame's weight for each pixel."""
    weight = np.asarray(alpha, np.float64)
    if not (np.all(weight > 0.0) and np.all(weight <= 1.0)):
        raise InputError("alpha", f"is {shown(alpha)}, must be above 0 and at most 1")
    if weight.ndim > 2 or any(n not in (1, m) for n, m in zip(weight.shape[::-1], shape[::-1], strict=False)):
        raise InputError("alpha", f"has shape {weight.shape}, must be {shape}, or 1 along y or x")
    return np.broadcast_to(weight, shape)


def _check(options: _Options, kernel: str, largest: float | None, exposure_ratio: float) -> None:
    """Refuse what is out of range."""
    words = (("clip", options.clip, CLIPS), ("space", options.space, SPACES), ("border", options.border, BORDERS),
             ("inverse", options.inverse, INVERSES), ("kernel", kernel, KERNELS))
    for name, word, known in words:
        if word not in known:
            raise InputError(name, f"is {shown(word)}; {suggest(str(word), known)}")
    for name in ("gamma", "padding", "least_variance"):
        if not 0.0 <= getattr(options, name) < np.inf:
            raise InputError(name, f"is {shown(getattr(options, name))}, must be a finite number, at least 0")
    if options.largest_luma is not None and not 0.0 < options.largest_luma <= 1.0:
        raise InputError("largest_luma", f"is {shown(options.largest_luma)}, must be above 0 and at most 1")
    if largest is not None and not 0.0 < largest < np.inf:
        raise InputError("largest", f"is {shown(largest)}, must be a finite number above 0")
    if not (np.isfinite(exposure_ratio) and exposure_ratio >= 0.0):
        raise InputError("exposure_ratio", f"is {shown(exposure_ratio)}, must be a finite number, at least 0")
