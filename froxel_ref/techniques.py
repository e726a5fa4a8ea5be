"""Ways to keep the transmittance along rays, side by side: each encodes the same absorbers and is asked at depths.

To add one, write a function of its options that returns a `Technique`, and list it in `KINDS`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np

from froxel_ref import cosine_maps, deep_shadow, fom, fom_resolved, opacity_slices, power_moments, trigonometric_moments
from froxel_ref.absorbers import Absorbers
from froxel_ref.arrays import Field
from froxel_ref.moment_storage import STORAGES, stored_moments
from froxel_ref.records import InputError, shown, suggest
from froxel_ref.storage import FLOATS, FORMATS, store, store_series

__all__ = ["KINDS", "Technique", "stored_bytes", "technique"]

Decode = Callable[[Field, Field], Field]

BYTES = {None: 4, "float32": 4, "float16": 2, "unorm16": 2, "unorm8": 1}
SERIES = ("float32", "float16")  # formats with a sign


class Technique(NamedTuple):
    """One way to keep what absorbers let through.

    Attributes
    ----------
    name : str
        With the options that set it apart.
    about : str
        A sentence.
    numbers : int or None
        How many a ray has; None if that depends on the ray.
    encode : callable
        From absorbers to an array of shape (numbers, …).
    decode : callable
        From that and depths, shape (m, …), to transmittance in [0, 1], shape (m, …).
    size : int or None [bytes]
        That a ray takes where it is stored; None: 4 a number.
    uncut : callable or None
        `decode` without its clamp, where there is something to cut.
    """

    name: str
    about: str
    numbers: int | None
    encode: Callable[[Absorbers], Field]
    decode: Decode
    size: int | None = None
    uncut: Decode | None = None


def stored_bytes(technique: Technique, encoded: Field) -> int:
    """How much of memory a ray takes.

    Parameters
    ----------
    technique : Technique
    encoded : ndarray, shape (numbers, …)
        From its `encode`.

    Returns
    -------
    int [bytes]

    Examples
    --------
    >>> stored_bytes(technique("fourier", storage="float16"), np.zeros((8, 1)))
    16
    """
    return 4 * len(encoded) if technique.size is None else technique.size


def technique(kind: str, /, **options: Any) -> Technique:
    """One of `KINDS`, with options.

    Parameters
    ----------
    kind : str
        A key of `KINDS`.
    **options
        Of the function there.

    Returns
    -------
    Technique

    Raises
    ------
    InputError
        An unknown kind; a storage that the kind does not have.

    Examples
    --------
    >>> layer = Absorbers(*(np.array([v]) for v in (0.5, 0.5, 4.0, 0.0)))
    >>> d = np.array([0.45, 0.6])
    >>> for kind in ("deep", "power", "fourier"):
    ...     way = technique(kind)
    ...     print(way.name, way.decode(way.encode(layer), d).round(2).tolist())
    deep [1.0, 0.02]
    power 4 [1.0, 0.02]
    FOM 3 [0.5, 0.02]
    """
    if kind not in KINDS:
        raise InputError("kind", f"is {shown(kind)}; {suggest(str(kind), KINDS)}")
    return KINDS[kind](**options)


def _deep() -> Technique:
    return Technique("deep", "The exact transmittance, as pieces in order of depth [Lokovic 2000].", None,
                     deep_shadow.deep_map, deep_shadow.transmittance)


def _slices(*, slices: int = 32, sampling: str = "mean", holds: str = "transmittance", storage: str | None = None
            ) -> Technique:
    _check(storage, FORMATS)

    def encode(absorbers: Absorbers) -> Field:
        depths = opacity_slices.slice_depths(absorbers, slices=slices, sampling=sampling)
        held = opacity_slices.opacity_slices(depths, holds=holds)
        if storage is not None and storage in FLOATS:  # beyond its largest number nothing passes either
            held = np.minimum(held, held.dtype.type(FLOATS[storage].maximum))
        return held if storage is None else store(held, storage)

    def decode(encoded: Field, depth: Field) -> Field:
        return opacity_slices.transmittance(encoded, depth, holds=holds)

    name = _name("OSM", slices, "" if sampling == "mean" else sampling, "" if holds == "transmittance" else holds,
                 storage)
    return Technique(name, "Transmittance at fixed depths, linear in between [Kim 2001; Hillaire 2015].", slices,
                     encode, decode, slices * BYTES[storage])


def _cosine(*, count: int = 8, storage: str | None = None) -> Technique:
    _check(storage, SERIES)
    return Technique(
        _name("ETM", count, storage), "Extinction as a series of cosines [Gautron 2011].", count,
        lambda absorbers: store_series(cosine_maps.cosine_coefficients(absorbers, count=count), storage),
        cosine_maps.transmittance, count * BYTES[storage],
        lambda encoded, depth: cosine_maps.transmittance(encoded, depth, clamp=False))


def _fourier(*, harmonics: int = 3, lanczos: bool = False, storage: str | None = None) -> Technique:
    _check(storage, SERIES)
    numbers = 2 * (harmonics + 1)

    def encode(absorbers: Absorbers) -> Field:
        start, stop, tau, rise = absorbers
        pairs = fom.segment_coefficients(start, stop, tau, rise=rise, harmonics=harmonics)
        whole = pairs.reshape(numbers, *pairs.shape[2:]).astype(np.result_type(*absorbers))
        return store_series(whole, storage)

    def decode(encoded: Field, depth: Field, *, clamp: bool = True) -> Field:
        pairs = encoded.reshape(2, harmonics + 1, *encoded.shape[1:])
        passed = fom.transmittance(pairs, depth, lanczos=lanczos, clamp=clamp)
        return passed.astype(np.result_type(encoded, depth), copy=False)

    return Technique(_name("FOM", harmonics, "Lanczos" if lanczos else "", storage),
                     "Extinction as a Fourier series, b_0 stored too [Jansen 2010].", numbers, encode, decode,
                     numbers * BYTES[storage], lambda encoded, depth: decode(encoded, depth, clamp=False))


def _resolved(*, harmonics: int = 3, storage: str | None = None) -> Technique:
    plain = _fourier(harmonics=harmonics, storage=storage)

    def decode(encoded: Field, depth: Field) -> Field:
        pairs = encoded.reshape(2, harmonics + 1, *encoded.shape[1:])
        found = fom_resolved.resolve(pairs, rounding=fom_resolved.ROUNDINGS.get(storage, 0.0))
        passed = fom_resolved.resolved_transmittance(found, depth)
        return passed.astype(np.result_type(encoded, depth), copy=False)

    return plain._replace(name=_name("resolved", harmonics, storage), uncut=None, decode=decode,
                          about="The same coefficients, read as a non-negative extinction that has them.")


def _power(*, count: int = 4, storage: str | None = None, ratio: float = 1.0,
           overestimation: float = power_moments.OVERESTIMATION) -> Technique:
    _check(storage, STORAGES)

    def encode(absorbers: Absorbers) -> Field:
        return stored_moments(power_moments.power_moments(absorbers, count=count, ratio=ratio), storage)

    def decode(encoded: Field, depth: Field) -> Field:
        return power_moments.transmittance(encoded, depth, storage=storage, ratio=ratio, overestimation=overestimation)

    return Technique(_name("power", count, "" if ratio == 1.0 else f"log {ratio:g}", storage),
                     "Bounds from averages of powers of depth [Münstermann 2018].", 1 + count, encode, decode,
                     _moment_bytes(count, storage))


def _trigonometric(*, count: int = 2, storage: str | None = None, wrapping: float = trigonometric_moments.WRAPPING,
                   overestimation: float = power_moments.OVERESTIMATION) -> Technique:
    _check(storage, STORAGES)

    def encode(absorbers: Absorbers) -> Field:
        moments = trigonometric_moments.trigonometric_moments(absorbers, count=count, wrapping=wrapping)
        return stored_moments(moments, storage, power=False)

    def decode(encoded: Field, depth: Field) -> Field:
        return trigonometric_moments.transmittance(encoded, depth, storage=storage, wrapping=wrapping,
                                                   overestimation=overestimation)

    return Technique(_name("trig", count, storage), "Bounds from Fourier coefficients [Münstermann 2018].",
                     1 + 2 * count, encode, decode, _moment_bytes(2 * count, storage))


KINDS: Mapping[str, Callable[..., Technique]] = {
    "deep": _deep, "slices": _slices, "cosine": _cosine, "fourier": _fourier, "resolved": _resolved,
    "power": _power, "trigonometric": _trigonometric,
}
"""By kind, functions of options: `slices` (slices, sampling, holds), `cosine` (count), `fourier` (harmonics, lanczos),
`resolved` (harmonics), `power` (count, ratio, overestimation), `trigonometric` (count, wrapping, overestimation), all
with storage; `deep`."""


def _name(*parts: object) -> str:
    return " ".join(str(part) for part in parts if part not in (None, ""))


def _moment_bytes(count: int, storage: str | None) -> int:
    return BYTES["float32" if storage == "unorm16" else storage] + count * BYTES[storage]


def _check(storage: str | None, known: tuple[str, ...]) -> None:
    possible = [name for name in known if name in BYTES]
    if storage is not None and storage not in possible:
        raise InputError("storage", f"is {shown(storage)}; {suggest(str(storage), possible)}")
