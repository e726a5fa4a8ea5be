"""Kernels of slice integration: each rule and its profile, and columns of up to 4096 slices."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from typing import Any

import numpy as np

from froxel_ref.arrays import Field
from froxel_ref.integrate import integrate, slice_integral
from froxel_ref.kernel_registry import Kernel, Parameter, for_each, register
from froxel_ref.slice_profiles import Profile, legendre, profile_integral

__all__: list[str] = []

Digits = Any


EXTINCTION = Parameter("extinction", "1/m", "magnitude", 1e-300, 1e8,
                       (0.0, 5e-324, 1e-12, 1e-5, 0.05, 1e8), 0.05)
LENGTH = Parameter("length", "m", "magnitude", 1e-6, 1e9, (1e-6, 0.01, 1.0, 64.0, 1e22))


def _rule(name: str, which: int) -> Callable[[Field, Field], Field]:
    return lambda sigma, d: slice_integral(np.ones_like(sigma), sigma, d, integrator=name)[which]


def _exact_light(mp: Digits, sigma: Any, d: Any) -> Any:
    return -mp.expm1(-sigma * d) / sigma if sigma else d


def _most_light(sigma: Any, d: Any) -> Any:
    return np.minimum(d, 1.0 / sigma)


register(Kernel(
    "slice_integral", "slice integration", "light of a slice of constant medium, source 1",
    (EXTINCTION, LENGTH),
    {"corrected": _rule("analytic", 0), "published": _rule("published", 0), "simple": _rule("simple", 0)},
    _exact_light, departure="D3: clamp at 1e-5 and (S − S·T)/σ; simple: no length at all",
    at_most=_most_light))
register(Kernel(
    "slice_transmittance", "slice integration", "transmittance of a slice", (EXTINCTION, LENGTH),
    {"corrected": _rule("analytic", 1), "published": _rule("published", 1)},
    lambda mp, sigma, d: mp.exp(-sigma * d), departure="D3: clamp at 1e-5", at_most=1.0, falling=0))
register(Kernel(
    "furnace", "slice integration", "a slice whose source is its extinction: 1 − T", (EXTINCTION, LENGTH),
    {"corrected": lambda s, d: slice_integral(s, s, d)[0],
     "published": lambda s, d: slice_integral(s, s, d, integrator="published")[0]},
    lambda mp, sigma, d: -mp.expm1(-sigma * d), departure="D3", at_most=lambda s, d: np.ones_like(s)))
register(Kernel(
    "half_step", "slice integration", "light of a slice by the half step, S·d·exp(−σ·d/2)",
    (EXTINCTION, LENGTH),
    {"corrected": _rule("half_step", 0)}, lambda mp, s, d: d * mp.exp(-s * d / 2), at_most=lambda s, d: d))


def _exact_profile(mp: Digits, depth: Any, slope: Any) -> Any:
    """∫₀¹ e^(−depth·m(u)) (1 − ½slope(u − ½)) du by panels that halve towards the front."""
    front = 1 - slope / 2
    cuts = [mp.mpf(0)] + [mp.ldexp(1, -n) for n in range(max(4, int(mp.frexp(depth)[1]) + 2), -1, -1)]
    total = mp.mpf(0)
    for low, high in itertools.pairwise(cuts):
        if depth * low * (front + slope * low / 2) > 100:
            break
        for at, weight in legendre(32):
            u = low + (high - low) * mp.mpf(at)
            value = (1 - slope / 2 * (u - mp.mpf(0.5))) * mp.exp(-depth * u * (front + slope * u / 2))
            total += (high - low) * mp.mpf(weight) * value
    return total


def _profile(depth: Field, slope: Field) -> Field:
    flat, one = np.zeros_like(slope), np.ones_like(depth)
    return profile_integral(one, depth, one, Profile(-0.5 * slope, flat, 0.5), Profile(slope, flat, 0.5))[0]


register(Kernel(
    "profile_integral", "slice integration", "light of a slice whose extinction and source are linear", (
        Parameter("optical depth", "1", "magnitude", 1e-30, 1e6, (0.0, 1e-8, 1.0, 44.0, 46.0, 1e6)),
        Parameter("slope of the extinction", "1", "choice", -2.0, 2.0, (-1.75, -0.5, 0.0, 1.0, 1.75), 0.5)),
    {"corrected": _profile}, _exact_profile, at_most=lambda x, slope: np.ones_like(x) * 2.0, share=0.1))

SLICES = Parameter("slices", "1", "choice", 1.0, 4096.0, (1.0, 2.0, 64.0, 4096.0), 64.0, whole=True)
STEP = 1.0 / 64.0  # a power of two, so that the exact optical depth is σ·n/64


def _accumulated(which: str, contrast: float = 1.0, **options: Any) -> Callable[[Field, Field], Field]:
    """Light or transmittance behind n slices, every other one thinner by the contrast."""
    def columns(count: float, sigma: Field) -> Field:
        n = int(count)
        thinner = np.where(np.arange(n) % 2, contrast, 1.0).astype(sigma.dtype)
        medium = sigma[None, None] * thinner[:, None, None]
        fog = integrate(np.ones((3, 1, 1, 1), sigma.dtype), medium if contrast != 1.0 else medium[:1],
                        np.full((n, 1, 1), STEP, sigma.dtype), np.ones((1, len(sigma)), sigma.dtype),
                        integrate_from="near", threads=1, **options)
        field = fog.radiance[0] if which == "light" else fog.transmittance
        return np.broadcast_to(field[-1, 0], sigma.shape)
    return lambda sigma, count: for_each(count, columns, sigma)


THIN = Parameter("extinction", "1/m", "magnitude", 1e-12, 1e3, (0.0, 5e-324, 1e-5, 1.0, 10.0, 1e8))
CONTRAST = 2.0**-40  # 1e12, exactly

register(Kernel(
    "accumulated_transmittance", "accumulation", "transmittance behind up to 4096 slices of 1/64 m",
    (THIN, SLICES),
    {"compensated": _accumulated("through", compensated=True), "plain": _accumulated("through"),
     "published": _accumulated("through", integrator="published")},
    lambda mp, sigma, n: mp.exp(-sigma * n * mp.mpf(STEP)),
    departure="D3; plain: a product of rounded factors",
    at_most=1.0, falling=0))
register(Kernel(
    "accumulated_light", "accumulation", "light of up to 4096 slices of 1/64 m, source 1", (THIN, SLICES),
    {"compensated": _accumulated("light", compensated=True), "plain": _accumulated("light"),
     "published": _accumulated("light", integrator="published")},
    lambda mp, sigma, n: _exact_light(mp, sigma, n * mp.mpf(STEP)), departure="D3",
    at_most=lambda sigma, n: _most_light(sigma, n * STEP)))
register(Kernel(
    "accumulated_contrast", "accumulation", "transmittance, every other slice 1e12 times thinner",
    (THIN, SLICES),
    {"compensated": _accumulated("through", CONTRAST, compensated=True),
     "plain": _accumulated("through", CONTRAST)},
    lambda mp, sigma, n: mp.exp(-sigma * mp.mpf(STEP)
                                * (mp.ceil(n / 2) + mp.floor(n / 2) * mp.mpf(CONTRAST))),
    departure="plain: a product of rounded factors", at_most=1.0, falling=0))
