"""What the nodes of a rule step over: shadows of media, sparse texels, thin layers. Closed forms and mpmath."""

from __future__ import annotations

import math

import mpmath
import numpy as np
import pytest

from froxel_ref.assets import Assets
from froxel_ref.scene import (
    DensityTexture,
    DirectionalLight,
    HeightFog,
    LocalMedium,
    Medium,
    PointLight,
    Scene,
    Sphere,
    Transform,
    VolumeDensity,
)
from froxel_ref.settings import SecondLobe, Settings, replace
from froxel_ref.truth import Truth, trace

WHITE = (1.0, 1.0, 1.0)
NOON = DirectionalLight(direction=(0, 1, 0), irradiance=WHITE)
RAY = ([[0.0]] * 3, [[0.0], [0.0], [-1.0]])


def hold(truth: Truth, want: float, rtol: float) -> None:
    """Within the tolerance, and the claim at least a tenth of the real error, but for rounding."""
    error = abs(float(truth.radiance[0, 0]) - want)
    assert truth.converged.all()
    assert error <= rtol * want
    assert error <= 10 * truth.error[0, 0] + 1e-13 * want


def texture(texels, **options):
    """A density texture and the assets that hold it."""
    source = VolumeDensity(path="made here.npy")
    assets = Assets(textures={source: texels}, heights={}, meshes={}, depth=None, radiance=None)
    return DensityTexture(source=source, **options), assets


def fog_between(a, b, extinction=0.01):
    """What fog of g = 0 under a sun of 1 sends from a stretch of the ray."""
    return (math.exp(-extinction * a) - math.exp(-extinction * b)) / (4 * math.pi)


# --- shadows of media -------------------------------------------------------------------------------


@pytest.mark.parametrize("rtol", [1e-4, 1e-8])
@pytest.mark.parametrize("radius", [0.3, 1.0, 3.0])
def test_the_shadow_of_a_small_ball_on_a_long_ray(radius, rtol):
    ball = LocalMedium(shape="ellipsoid", extinction=5.0,
                       transform=Transform(translate=(0, 6, -31.7), scale=(radius,) * 3))
    scene = Scene(global_media=(Medium(extinction=0.01),), local_media=(ball,), lights=(NOON,))

    def f(t):
        chord = 2 * mpmath.sqrt(max(radius**2 - (t - mpmath.mpf(31.7)) ** 2, 0))
        return 0.01 * mpmath.exp(-0.01 * t - 5 * chord) / (4 * mpmath.pi)

    edges = [0, 31.7 - radius, 31.7 - 0.999 * radius, 31.7, 31.7 + 0.999 * radius, 31.7 + radius, 100]
    hold(trace(scene, *RAY, 100.0, rtol=rtol, volumetric_shadows=True), float(mpmath.quad(f, edges)), rtol)


@pytest.mark.parametrize("half", [0.01, 0.1, 1.0])
@pytest.mark.parametrize("turn", [0.0, 45.0])
def test_the_shadow_of_a_dense_pole(half, turn):
    """Through 1e4/m next to nothing passes, but where a turned pole's chord is short: ∫e^(−2σx)dx."""
    pole = LocalMedium(extinction=1e4, transform=Transform(translate=(0, 5, -37.3), rotate=(turn, 0, 0),
                                                           scale=(10, half, half)))
    scene = Scene(global_media=(Medium(extinction=1e-3),), local_media=(pole,), lights=(NOON,))
    reach = half * (math.sqrt(2.0) if turn else 1.0)
    left, right = 37.3 - reach, 37.3 + reach
    want = fog_between(0, left, 1e-3) + fog_between(right, 100, 1e-3)
    if turn:
        want += 1e-3 / (4 * math.pi) * (math.exp(-1e-3 * left) + math.exp(-1e-3 * right)) / 2e4
    for rtol in (1e-4, 1e-8):
        hold(trace(scene, *RAY, 100.0, rtol=rtol, volumetric_shadows=True), want, rtol)


def shadow_by_midpoints(scene, lamp, way_depth, breaks, end, extinction):
    """A lamp's light along RAY in fog of g = 0 with the dimming on its way given, by panels between breaks."""
    import reference_truth as reference

    place = np.array(lamp.position)

    def f(t):
        points = np.array([0.0, 0.0, -1.0])[:, None, None] * t
        d2 = ((points - place[:, None, None]) ** 2).sum(axis=0)
        return extinction * np.exp(-extinction * t - way_depth(points)) / (4 * math.pi * d2)

    near = -place[2]
    return reference.integral(f, 0.0, end, [near, *breaks], finest=1e-7)


def test_the_shadow_of_a_box_before_a_lamp():
    """A slab 2 m above the ray and 1 thick under a lamp at 4: its chord is 1 over the way's slope."""
    slab = LocalMedium(extinction=30.0, transform=Transform(translate=(0, 2.5, -50.5), scale=(9, 0.5, 0.5)))
    lamp = PointLight(position=(0.0, 4.0, -48.0), intensity=WHITE, falloff="inverse_square")
    scene = Scene(global_media=(Medium(extinction=0.01),), local_media=(slab,), lights=(lamp,))

    def depth(points):
        way = np.array(lamp.position)[:, None, None] - points
        length = np.linalg.norm(way, axis=0)
        with np.errstate(divide="ignore", invalid="ignore"):
            shares = [((2 - points[1]) / way[1], (3 - points[1]) / way[1]),
                      ((-51 - points[2]) / way[2], (-50 - points[2]) / way[2])]
        low = np.maximum.reduce([np.minimum(a, b) for a, b in shares])
        high = np.minimum.reduce([np.maximum(a, b) for a, b in shares])
        return 30 * np.maximum(high - low, 0) * length + 0.01 * length

    # Ways through the corners (y, z) of the slab meet the ray where z − 48 is blown up by 4/(4 − y).
    corners = [48 + (z - 48) * 4 / (4 - y) for y in (2, 3) for z in (50, 51)]
    want = shadow_by_midpoints(scene, lamp, depth, corners, 100.0, 0.01)
    for rtol in (1e-4, 1e-8):
        hold(trace(scene, *RAY, 100.0, rtol=rtol, volumetric_shadows=True), want, rtol)


def test_a_ceiling_cuts_the_shadow_of_a_box():
    """The sun is low: only what lies below the ceiling at half height dims, and its shadow ends sooner."""
    box = LocalMedium(extinction=3.0, height_fog=HeightFog(start=0.0, falloff=0.0, max_height=0.5),
                      transform=Transform(translate=(0, 3, -60), scale=(9, 1, 1)))
    sun = DirectionalLight(direction=(0, 1, 1), irradiance=WHITE)
    scene = Scene(global_media=(Medium(extinction=0.01),), local_media=(box,), lights=(sun,))

    def f(t):  # the way from z = −t climbs 1:1; it is at height y at z = y − t; the box spans z −61…−59, y 2…3
        low, high = max(2, t - 61), min(3, t - 59)
        chord = mpmath.sqrt(2) * max(high - low, 0)
        return 0.01 * mpmath.exp(-0.01 * t - 3 * chord) / (4 * mpmath.pi)

    want = float(mpmath.quad(f, [0, 61, 62, 63, 64, 100]))
    for rtol in (1e-4, 1e-9):
        hold(trace(scene, *RAY, 100.0, rtol=rtol, volumetric_shadows=True), want, rtol)


def test_the_end_of_the_way_to_a_sun_is_an_edge():
    """With 4 m to the sun, a slab 2 m to 6 m above a slope is entered, filled and left behind."""
    slab = LocalMedium(extinction=2.0, transform=Transform(translate=(0, 4, 0), scale=(1e3, 2, 1e3)))
    scene = Scene(global_media=(Medium(extinction=1e-3),), local_media=(slab,), lights=(NOON,))
    slope = np.array([0.0, -0.04, -1.0])
    slope /= np.linalg.norm(slope)
    rise = -slope[1]

    def f(t):  # the ray falls from y = 0; the way spans [y, y + 4], the fog dims it over all 4 m
        chord = min(max(4 - rise * t - 2, 0), 4)
        return 1e-3 * mpmath.exp(-1e-3 * (t + 4) - 2 * chord) / (4 * mpmath.pi)

    want = float(mpmath.quad(f, [0, 10, 25, 2 / rise, 100]))
    for rtol in (1e-4, 1e-9):
        hold(trace(scene, [[0.0]] * 3, slope[:, None], 100.0, rtol=rtol, volumetric_shadows=True,
                   sun_distance=4.0), want, rtol)


# --- textures ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("rtol", [1e-4, 1e-8])
def test_one_filled_texel_among_many(rtol):
    """Its column is the area of a hat: h = 2·10/64 m of density 1."""
    texels = np.zeros((64, 64, 64))
    texels[20, 30, 40] = 1.0
    record, assets = texture(texels)
    cloud = LocalMedium(extinction=1.0, density=record, transform=Transform(translate=(0, 0, -20), scale=(10,) * 3))
    origin = [[(40.5 / 32 - 1) * 10], [(30.5 / 32 - 1) * 10], [0.0]]
    truth = trace(Scene(local_media=(cloud,), lights=(NOON,)), origin, RAY[1], 40.0, rtol=rtol, assets=assets)
    hold(truth, -math.expm1(-20 / 64) / (4 * math.pi), rtol)


def test_one_glowing_texel_without_extinction():
    texels = np.zeros((64, 64, 64))
    texels[20, 30, 40] = 1.0
    record, assets = texture(texels)
    glow = LocalMedium(extinction=0.0, emissive=WHITE, density=record,
                       transform=Transform(translate=(0, 0, -20), scale=(10,) * 3))
    origin = [[(40.5 / 32 - 1) * 10], [(30.5 / 32 - 1) * 10], [0.0]]
    hold(trace(Scene(local_media=(glow,)), origin, RAY[1], 40.0, rtol=1e-6, assets=assets), 20 / 64, 1e-6)


@pytest.mark.parametrize("filled", [3, 27, 60])
def test_the_shadow_of_one_texel(filled):
    """A hat's column σ·h·(1 − |x|/h) onto the ray below: the shadow is 2h wide on 100 m."""
    texels = np.zeros((64, 2, 2))
    texels[filled] = 1.0
    record, assets = texture(texels)
    sheet = LocalMedium(extinction=20.0, density=record, transform=Transform(translate=(0, 4, -40), scale=(1, 1, 20)))
    scene = Scene(global_media=(Medium(extinction=0.01),), local_media=(sheet,), lights=(NOON,))
    # Texel k's centre lies at z = −60 + (k + ½)·40/64; texels are 0.625 m, the chord is 2 m.
    centre, h = 60 - (filled + 0.5) * 0.625, 0.625

    def f(t):
        return 0.01 * mpmath.exp(-0.01 * t - 40 * max(1 - abs(t - centre) / h, 0)) / (4 * mpmath.pi)

    want = float(mpmath.quad(f, [0, centre - h, centre - 0.9 * h, centre, centre + 0.9 * h, centre + h, 100]))
    for rtol in (1e-4, 1e-7):
        truth = trace(scene, *RAY, 100.0, rtol=rtol, volumetric_shadows=True, assets=assets)
        hold(truth, want, rtol)


# --- where the density is 0 and g counts ------------------------------------------------------------


@pytest.mark.parametrize("extinction", [0.0, 1e-3])
@pytest.mark.parametrize("place", [13.0, 27.3, 41.3])
def test_the_plain_mean_of_g_counts_a_medium_above_its_ceiling(place, extinction):
    """The ray passes 0.1 m of its box, above the ceiling: there g is the mean of 0 and 0.9."""
    half = 0.05
    box = LocalMedium(extinction=extinction, phase_anisotropy=0.9,
                      height_fog=HeightFog(start=0, falloff=0, max_height=0.3),
                      transform=Transform(translate=(0, 0, -place), scale=(3, 3, half)))
    sun = DirectionalLight(direction=(0, 0, -1), irradiance=WHITE)
    scene = Scene(global_media=(Medium(extinction=0.05),), local_media=(box,), lights=(sun,))
    settings = replace(Settings(), phase_mixing="mean")
    inside = (1 - 0.45**2) / (1 - 0.45) ** 3 * fog_between(place - half, place + half, 0.05)
    want = fog_between(0, place - half, 0.05) + fog_between(place + half, 60, 0.05) + inside
    hold(trace(scene, [[0.0], [1.0], [0.0]], RAY[1], 60.0, settings=settings, rtol=1e-9), want, 1e-9)


# --- extremes ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("end", [1e4, 1e7, 1e10, 1e14])
@pytest.mark.parametrize("extinction", [1e8, 1e12])
def test_a_mean_free_path_far_below_the_ray(extinction, end):
    scene = Scene(global_media=(Medium(extinction=extinction),), lights=(NOON,))
    hold(trace(scene, *RAY, end, rtol=1e-6), 1 / (4 * math.pi), 1e-6)


def lobe(cosine, g):
    return (1 - g * g) / (4 * mpmath.pi) / (1 + g * g - 2 * g * cosine) ** mpmath.mpf(1.5)


@pytest.mark.parametrize("second", [False, True])
@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("g", [0.999, 0.9999, 0.999999])
def test_narrow_lobes_keep_their_digits_on_both_sides(g, sign, second):
    ray = np.array([3e-5, 1e-5, -1.0])
    ray /= np.linalg.norm(ray)
    sun = DirectionalLight(direction=(0, 0, -sign), irradiance=WHITE)
    settings = Settings(phase_function="two_lobe_henyey_greenstein" if second else "henyey_greenstein",
                        second_lobe=SecondLobe(phase_anisotropy=sign * g, weight=0.5))
    fog = Medium(extinction=0.1, phase_anisotropy=0.3 if second else sign * g)
    truth = trace(Scene(global_media=(fog,), lights=(sun,)), [[0.0]] * 3, ray[:, None], 10.0, settings=settings)
    with mpmath.workdps(40):
        u = [mpmath.mpf(float(c)) for c in ray]
        cosine = -sign * u[2] / mpmath.sqrt(sum(c * c for c in u))
        phase = lobe(cosine, sign * mpmath.mpf(g))
        if second:
            phase = (phase + lobe(cosine, mpmath.mpf(0.3))) / 2
        want = float(phase * (1 - mpmath.exp(-mpmath.mpf(0.1) * 10)))
    hold(truth, want, 1e-14)


def test_a_lamp_behind_keeps_the_digits_of_a_backward_lobe():
    """Beyond a lamp that the ray passes at 1e-6 m, 1 + cos is h²/(2s²)."""
    g, h = -0.9999, 1e-6
    lamp = PointLight(position=(h, 0, 1.0), intensity=WHITE, falloff="inverse_square")
    truth = trace(Scene(global_media=(Medium(extinction=0.1, phase_anisotropy=g),), lights=(lamp,)), *RAY, 2.0,
                  rtol=1e-9)
    with mpmath.workdps(40):
        def f(t):
            s = t + 1
            d = mpmath.sqrt(s * s + mpmath.mpf(h) ** 2)
            return mpmath.mpf(0.1) * mpmath.exp(-mpmath.mpf(0.1) * t) * lobe(-s / d, mpmath.mpf(g)) / d**2
        want = float(mpmath.quad(f, [0, 0.5, 1, 2]))
    hold(truth, want, 1e-9)


@pytest.mark.parametrize("tilt", [1e-2, 1e-4])
@pytest.mark.parametrize("radius", [1e3, 1e6, 6.4e6, 1e9])
def test_the_edge_of_a_planets_shadow(radius, tilt):
    """The sun on the horizon of a ball's top: a ray behind it leaves the shadow where it rises above it."""
    planet = Sphere(center=(0, -radius, 0), radius=radius)
    sun = DirectionalLight(direction=(1, 0, 0), irradiance=WHITE)
    ray = np.array([-1.0, tilt, 0.0])
    ray /= np.linalg.norm(ray)
    origin = [[-1.0], [-25 * tilt], [0.0]]
    truth = trace(Scene(global_media=(Medium(extinction=0.1),), lights=(sun,), surfaces=(planet,)), origin,
                  ray[:, None], 100.0, shadows="exact", rtol=1e-10)
    edge = 25 * tilt / float(ray[1])
    hold(truth, fog_between(edge, 100, 0.1), 1e-10)


@pytest.mark.parametrize("shape", ["box", "ellipsoid"])
@pytest.mark.parametrize("far", [1e6, 1e9, 9e9])
def test_a_scene_far_from_the_origin_says_what_that_costs(far, shape):
    """Places are rounded to 1e-16 of themselves: the scene that was moved differs, by no more than ten claims."""
    shift = far * np.array([0.9, 0.7, -0.8])
    origin, ray = np.array([-2.0, -1.5, 2.1]), np.array([[0.6], [0.48], [-0.64]])

    def moved(by, lamp):
        place = np.array([3.0, 1.0, 1.0]) + by
        light = PointLight(position=tuple(place), intensity=WHITE) if lamp else NOON
        cloud = LocalMedium(shape=shape, extinction=0.5, transform=Transform(translate=tuple(by), rotate=(10, 20, 30)))
        return Scene(local_media=(cloud,), lights=(light,))

    for lamp in (False, True):
        for volumetric in (False, True):
            near = trace(moved(np.zeros(3), lamp), origin[:, None], ray, 8.0, rtol=1e-11, volumetric_shadows=volumetric)
            there = trace(moved(shift, lamp), (origin + shift)[:, None], ray, 8.0, volumetric_shadows=volumetric)
            hold(there, near.radiance[0, 0], 1e-4)
