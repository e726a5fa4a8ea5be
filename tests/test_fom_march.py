"""What a light's rays gather: closed forms, marches of order 2 and 1, the thesis's samples."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from reference_fom import listing_3_18

from froxel_ref.density import density, place
from froxel_ref.fom_march import DITHER, Marching, Span, media_coefficients, media_span
from froxel_ref.geometry import Lines
from froxel_ref.light_paths import light_transmittance
from froxel_ref.scene import DensityTexture, HeightFog, LocalMedium, Medium, NoiseDensity, PointLight, Transform
from froxel_ref.settings import Settings
from froxel_ref.volumes import noise

REACH = 12.0
ORIGIN = np.array([0.3, 2.0, -0.4])
NOISE = DensityTexture(source=NoiseDensity(size=8, cells=2, contrast=3), scale=(0.3, 0.2, 0.25), bias=(0.1, 0.2, 0.3))
LOCAL_NOISE = dataclasses.replace(NOISE, scale=(1.0, 1.0, 1.0))
TILT = Transform(translate=(1.5, 1.2, -3.0), rotate=(10.0, 25.0, 5.0), scale=(1.0, 1.5, 2.0))
MEDIA = {
    "uniform": Medium(extinction=0.2),
    "height fog": Medium(extinction=0.4, height_fog=HeightFog(start=1.0, falloff=0.8)),
    "ceiling": Medium(extinction=0.4, height_fog=HeightFog(start=0.0, falloff=0.5, max_height=3.0)),
    "box": LocalMedium(extinction=0.7, transform=TILT),
    "ellipsoid": LocalMedium(extinction=0.7, transform=TILT, shape="ellipsoid"),
    "foggy ellipsoid": LocalMedium(extinction=0.9, transform=TILT, shape="ellipsoid",
                                   height_fog=HeightFog(start=0.2, falloff=3.0)),
}
TEXTURED = {
    "noise": Medium(extinction=0.4, density=NOISE),
    "foggy noise": Medium(extinction=0.4, density=NOISE, height_fog=HeightFog(start=1.0, falloff=0.8)),
    "noisy ellipsoid": LocalMedium(extinction=0.9, transform=TILT, shape="ellipsoid", density=LOCAL_NOISE),
}


def texels(medium: Medium) -> np.ndarray | None:
    return None if medium.density is None else noise(medium.density.source)


def rays(count: int = 60, seed: int = 0) -> Lines:
    way = np.random.default_rng(seed).normal(size=(3, count))
    way[:, :40] += (np.array([1.5, 1.2, -3.0]) - ORIGIN)[:, None]  # towards the local ones
    way /= np.linalg.norm(way, axis=0)
    origin = np.broadcast_to(ORIGIN[:, None], way.shape)
    return Lines(origin, way, np.zeros(count), np.full(count, REACH))


WHOLE = Span(np.zeros(1), np.full(1, REACH))


def gathered(medium: Medium, lines: Lines, **how: object) -> np.ndarray:
    made = media_coefficients({0: place(medium, texels(medium))}, {0: medium.extinction}, lines, WHOLE,
                              **({"harmonics": 4} | how))
    return np.broadcast_to(made, (*made.shape[:2], lines.start.size))


def summed(medium: Medium, lines: Lines, harmonics: int = 4, count: int = 40000) -> np.ndarray:
    """By the midpoint rule on very many samples."""
    t = (np.arange(count) + 0.5) * (REACH / count)
    result = np.zeros((2, harmonics + 1, lines.start.size))
    for n in range(lines.start.size):
        points = tuple(lines.origin[c, n] + lines.direction[c, n] * t for c in range(3))
        tau = medium.extinction * np.broadcast_to(density(medium, points, texels(medium)), t.shape) * (REACH / count)
        for k in range(harmonics + 1):
            result[0, k, n] = 2.0 * np.sum(tau * np.cos(2.0 * np.pi * k * t / REACH))
            result[1, k, n] = 2.0 * np.sum(tau * np.sin(2.0 * np.pi * k * t / REACH))
    return result


@pytest.mark.parametrize("name", MEDIA)
def test_media_without_texture_are_exact(name: str) -> None:
    """Against sums whose own error, at edges, is below a step's optical depth: 2·0.9·12/40000 = 5e-4."""
    lines = rays()
    np.testing.assert_allclose(gathered(MEDIA[name], lines), summed(MEDIA[name], lines), atol=6e-4)


@pytest.mark.parametrize("name", MEDIA)
def test_half_of_a_0_is_the_whole_optical_depth(name: str) -> None:
    lines, medium = rays(), MEDIA[name]
    lamp = PointLight(position=tuple(ORIGIN), intensity=(1, 1, 1))
    ends = tuple(lines.origin[c] + REACH * lines.direction[c] for c in range(3))
    passed = light_transmittance([place(medium)], np.array([[medium.extinction]]), lamp, ends, settings=Settings())[0]
    np.testing.assert_allclose(gathered(medium, lines)[0, 0] / 2, -np.log(passed), rtol=1e-11, atol=1e-13)


@pytest.mark.parametrize("name", TEXTURED)
def test_marches_are_of_order_two(name: str) -> None:
    lines, medium = rays(), TEXTURED[name]
    fine = gathered(medium, lines, marching=Marching(step=1e-9, most_steps=8192))
    errors = [float(np.sqrt(np.mean((gathered(medium, lines, marching=Marching(step=1e-9, most_steps=steps)) - fine)
                                    ** 2))) for steps in (32, 64, 128, 256)]
    slope = np.polyfit(np.log([32, 64, 128, 256]), np.log(errors), 1)[0]
    assert -2.6 < slope < -1.7  # a texture's kinks between texels are of order 2 as well
    np.testing.assert_allclose(fine, summed(medium, lines, count=20000), atol=2e-3)


def test_points_at_a_steps_front_are_of_order_one() -> None:
    """D7: half a step of the fog is missing at the end and counted twice at the beginning."""
    lines, medium = rays(), TEXTURED["foggy noise"]
    fine = gathered(medium, lines, marching=Marching(step=1e-9, most_steps=8192))
    errors = [float(np.sqrt(np.mean((gathered(medium, lines, whole=True, marching=Marching(
        samples="front", step=1e-9, most_steps=steps)) - fine) ** 2))) for steps in (32, 64, 128, 256)]
    slope = np.polyfit(np.log([32, 64, 128, 256]), np.log(errors), 1)[0]
    assert -1.3 < slope < -0.8


@pytest.mark.parametrize("samples", ["front", "middle", "dithered"])
@pytest.mark.parametrize("least", [0.0, 1e-5])
def test_the_thesis_march_is_its_listing(samples: str, least: float) -> None:
    medium = dataclasses.replace(TEXTURED["foggy noise"], extinction=90.0)
    lines = rays(6)
    dither = np.array([1, 4, 7, 12, 15, 16]) / 16.0
    how = Marching(samples=samples, step=0.05, most_steps=64, most_tau=-math.log(least) if least else math.inf)
    got = gathered(medium, lines, marching=how, whole=True, dither=dither, harmonics=3)
    for n in range(6):
        offset = {"front": 0.0, "middle": 0.5, "dithered": 0.5 + dither[n]}[samples]

        def extinction(p: np.ndarray) -> float:
            return 90.0 * float(density(medium, tuple(np.array([c]) for c in p), texels(medium))[0])

        want = listing_3_18(extinction, lines.origin[:, n], lines.direction[:, n], REACH, 64, 3, offset=offset,
                            least=least)
        np.testing.assert_allclose(got[..., n], want, atol=1e-11 * np.abs(want).max())


def test_steps_are_no_longer_than_asked_for_and_no_more_than_allowed() -> None:
    """Counted at the density: one sample a step."""
    lines = rays(1)
    medium = Medium(extinction=1.0, density=NOISE)
    for step, most, expected in ((0.05, 64, 64), (0.5, 64, 24), (4.0, 64, 3), (100.0, 64, 1)):
        got = gathered(medium, lines, marching=Marching(samples="front", step=step, most_steps=most), whole=True,
                       harmonics=0)

        def extinction(p: np.ndarray) -> float:
            return float(density(medium, tuple(np.array([c]) for c in p), texels(medium))[0])

        want = listing_3_18(extinction, lines.origin[:, 0], lines.direction[:, 0], REACH, expected, 0)
        np.testing.assert_allclose(got[..., 0], want, rtol=1e-12)


def test_a_dithered_march_of_a_mediums_stretch_drops_what_lies_behind_it() -> None:
    """A8: the directional march loses its last sample where the dither is above ½."""
    medium = LocalMedium(extinction=1.0, density=dataclasses.replace(LOCAL_NOISE, source=NoiseDensity(size=4)))
    flat = place(medium, np.full((4, 4, 4), 1.0))
    count = 16
    start, way = (np.repeat([[0.0], [0.0], [z]], count, axis=1) for z in (4.0, -1.0))
    lines = Lines(start, way, np.zeros(count), np.full(count, REACH))
    got = media_coefficients({0: flat}, {0: 1.0}, lines, Span(np.full(count, 3.0), np.full(count, 5.0)),
                             marching=Marching(samples="dithered", step=0.25, most_steps=64),
                             dither=DITHER.reshape(-1), harmonics=0)[0, 0] / 2
    np.testing.assert_allclose(got, np.where(DITHER.reshape(-1) >= 0.5, 1.75, 2.0), rtol=1e-12)


@settings(max_examples=25, deadline=None)
@given(st.permutations(list(range(5))), st.integers(1, 4))
def test_media_add_in_any_order(order: list[int], split: int) -> None:
    media = [*list(MEDIA.values())[:4], TEXTURED["noisy ellipsoid"]]
    placed = {i: place(media[i], texels(media[i])) for i in order}
    extinction = {i: media[i].extinction for i in order}
    lines = rays(20)
    whole = media_coefficients(placed, extinction, lines, WHOLE)
    parts = [{i: placed[i] for i in some} for some in (order[:split], order[split:])]
    apart = sum(media_coefficients(part, extinction, lines, WHOLE) for part in parts)
    np.testing.assert_allclose(apart, whole, atol=1e-13)


def test_rays_do_not_know_of_each_other() -> None:
    """Grouping by number of steps, and gathering of those that meet a medium, change no bit."""
    lines, medium = rays(), TEXTURED["noisy ellipsoid"]
    whole = gathered(medium, lines)
    for n in range(0, 60, 7):
        one = Lines(*(field[..., n:n + 1] for field in lines))
        assert gathered(medium, one).tobytes() == np.ascontiguousarray(whole[..., n:n + 1]).tobytes()


def test_float32_gathers_what_float64_does() -> None:
    for medium in (*MEDIA.values(), *TEXTURED.values()):
        lines = rays()
        made = media_coefficients({0: place(medium, texels(medium), dtype=np.float32)}, {0: medium.extinction}, lines,
                                  WHOLE, harmonics=4, dtype=np.dtype(np.float32))
        assert made.dtype == np.float32
        np.testing.assert_allclose(np.broadcast_to(made, (2, 5, 60)), gathered(medium, lines), atol=5e-5)


def test_spans_hold_what_is_met() -> None:
    lines = rays()
    span = media_span([place(MEDIA["box"]), place(MEDIA["ellipsoid"])], lines)
    met = gathered(MEDIA["box"], lines)[0, 0] > 0.0
    assert np.array_equal(span.far > span.near, met)
    assert met.any()
    assert not met.all()


@pytest.mark.parametrize("extinction", [1e-30, 1e8, 1e12])
def test_extreme_extinctions_stay_finite(extinction: float) -> None:
    for medium in (*MEDIA.values(), *TEXTURED.values()):
        made = gathered(dataclasses.replace(medium, extinction=extinction), rays())
        assert np.isfinite(made).all()
