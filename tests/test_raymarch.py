"""The march from the froxels' far end to the surfaces."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import quad

from froxel_ref import shadow_stage
from froxel_ref.apply import lookup_fog
from froxel_ref.assets import load_assets
from froxel_ref.compare import order
from froxel_ref.density import place
from froxel_ref.geometry import camera_rays
from froxel_ref.grid import make_froxels, step_lengths
from froxel_ref.integrate import integrate
from froxel_ref.light_paths import light_transmittance
from froxel_ref.lighting import in_scattering
from froxel_ref.media import voxelise
from froxel_ref.optical_depth import extinctions
from froxel_ref.raymarch import DENSITIES, LongRange, combine, march_long_range, sun_transmittance
from froxel_ref.records import InputError
from froxel_ref.scene import (
    Box,
    Camera,
    DensityTexture,
    DirectionalLight,
    HeightFog,
    Medium,
    NoiseDensity,
    PointLight,
    Scene,
    Transform,
    VolumeDensity,
)
from froxel_ref.settings import Grid, Settings, replace
from froxel_ref.truth import trace
from froxel_ref.visibility import exact_visibility, occluders

EPS = 2.0**-52
FAR = 32.0

# Seen a little from above, so that rays rise and fall through height fog.
CAMERA = Camera(position=(0.0, 6.0, 0.0), target=(0.3, 5.5, -4.0), vertical_fov=50.0, width=8, height=6)
SUN = DirectionalLight(direction=(0.4, 0.7, -0.6), irradiance=(3.0, 2.0, 1.0))
SMOKE = Medium(albedo=(0.9, 0.8, 0.6), extinction=0.004, phase_anisotropy=0.7)
FOG = Medium(albedo=(0.7, 0.9, 0.5), extinction=0.02, phase_anisotropy=-0.3, emissive=(0.001, 0.0, 0.003),
             height_fog=HeightFog(start=1.0, falloff=0.15, max_height=30.0))
TINTED = Medium(albedo=(1.0, 0.5, 0.2), extinction=(0.01, 0.005, 0.02), phase_anisotropy=0.2,
                height_fog=HeightFog(start=4.0, falloff=0.3))
SETTINGS = Settings(grid=Grid(width=8, height=6, depth=16, near=0.5, far=FAR))
# One period of a wave along each axis, to be seen from far: smooth but for the kinks at texel centres.
WAVE = VolumeDensity(path="wave.npy")


def wave(count=32):
    u = 2.0 * np.pi * (np.arange(count) + 0.5) / count
    return 0.6 + 0.2 * np.sin(u)[:, None, None] * np.cos(u)[:, None] + 0.2 * np.sin(u)


def scene(*media, lights=(SUN,), ambient=(0.2, 0.1, 0.4), **more):
    return Scene(camera=CAMERA, global_media=media, lights=lights, ambient=ambient, **more)


def march(what, depth, *, settings=SETTINGS, farthest=2000.0, dtype=np.float64, rays=None, **options):
    rays = camera_rays(CAMERA, 8, 6, dtype=dtype) if rays is None else rays
    return march_long_range(np.asarray(depth, dtype), rays, what, farthest=farthest, settings=settings, **options)


def depths(seed=3, low=10.0, high=500.0):
    return np.random.default_rng(seed).uniform(low, high, (6, 8))


def smooth_sight(points, normal=None):
    """Light that comes and goes over some 100 m, between 0.2 and 1."""
    return 0.6 + 0.4 * np.sin(0.05 * points[0] + 0.03 * points[2]) * np.cos(0.01 * points[1])


# --- a scalar loop from the definition --------------------------------------------------------------


def scalar_density(medium, y):
    fog = medium.height_fog
    if fog is None:
        return 1.0
    if fog.max_height is not None and y > fog.max_height:
        return 0.0
    return math.exp(-fog.falloff * max(y - fog.start, 0.0))


def scalar_phase(g, cosine):
    return (1.0 - g * g) / (4.0 * math.pi * (1.0 + g * g - 2.0 * g * cosine) ** 1.5)


def scalar_march(what, ray, depth, steps, jitter, density, mixing, sight):
    """One ray: origin, world metres per metre of depth."""
    origin, per = ray
    length = math.sqrt(sum(c * c for c in per))
    light, through = [0.0] * 3, [1.0] * 3
    for k in range(steps):
        a, b = (FAR + (depth - FAR) * i / steps for i in (k, k + 1))
        z = a + (b - a) * jitter
        point = [o + p * z for o, p in zip(origin, per, strict=True)]
        material = []
        for medium in what.global_media:
            if density == "sampled":
                rho = scalar_density(medium, point[1])
            else:
                fog = medium.height_fog
                breaks = [(y - origin[1]) / per[1] for y in (fog.start, fog.max_height or 1e9)] if fog else []
                rho = quad(lambda s, medium=medium: scalar_density(medium, origin[1] + per[1] * s), a, b, epsabs=1e-14,
                           epsrel=1e-13, limit=200, points=[t for t in breaks if a < t < b] or None)[0] / (b - a)
            material.append((medium, rho))
        for c in range(3):
            sigma = source = 0.0
            parts = {}
            for medium, rho in material:
                e = medium.extinction if isinstance(medium.extinction, float) else medium.extinction[c]
                sigma += rho * e
                source += rho * medium.emissive[c]
                parts[medium.phase_anisotropy] = parts.get(medium.phase_anisotropy, 0.0) + rho * e * medium.albedo[c]
            if mixing == "mean":
                parts = {sum(m.phase_anisotropy for m, _ in material) / len(material): sum(parts.values())}
            elif mixing == "weighted":
                weights = [(m.phase_anisotropy, rho * sum(
                    (m.extinction if isinstance(m.extinction, float) else m.extinction[i]) * m.albedo[i]
                    for i in range(3))) for m, rho in material]
                whole = sum(w for _, w in weights)
                parts = {sum(g * w for g, w in weights) / whole if whole else 0.0: sum(parts.values())}
            for g, scattering in parts.items():
                source += scattering * what.ambient[c]
                for sun in what.lights:
                    size = math.sqrt(sum(d * d for d in sun.direction))
                    cosine = sum(d * p for d, p in zip(sun.direction, per, strict=True)) / (size * length)
                    share = float(sight(tuple(np.array(p) for p in point)))
                    source += scattering * scalar_phase(g, cosine) * sun.irradiance[c] * share
            d = (b - a) * length
            light[c] += through[c] * (source * -math.expm1(-sigma * d) / sigma if sigma else source * d)
            through[c] *= math.exp(-sigma * d)
    return light, through


@pytest.mark.parametrize("mixing", ["weighted", "mean", "mixture"])
@pytest.mark.parametrize("density", DENSITIES)
def test_agrees_with_the_scalar_loop(density, mixing):
    """Three media of different g, one of them tinted, two suns, one of them shadowed, a jitter for each pixel."""
    other = DirectionalLight(direction=(-1.0, 0.2, 3.0), irradiance=(0.5, 1.0, 0.0))
    what = scene(SMOKE, FOG, TINTED, lights=(SUN, other))
    jitter, ends = np.random.default_rng(1).random((6, 8)), depths()
    got = march(what, ends, settings=replace(SETTINGS, phase_mixing=mixing), steps=5, jitter=jitter, density=density,
                visibility={0: smooth_sight, 1: smooth_sight})
    rays = camera_rays(CAMERA, 8, 6)
    components = [np.broadcast_to(c, (6, 8)) for c in rays.per_depth]
    beyond = 0
    for y in range(6):
        for x in range(8):
            ray = (rays.origin, [float(c[y, x]) for c in components])
            want = ([0.0] * 3, [1.0] * 3)
            if ends[y, x] > FAR:
                beyond += 1
                want = scalar_march(what, ray, float(ends[y, x]), 5, float(jitter[y, x]), density, mixing, smooth_sight)
            # quad is asked for 1e-13; the rest is rounding.
            assert got.radiance[:, y, x] == pytest.approx(want[0], rel=1e-12)
            assert got.transmittance[:, y, x] == pytest.approx(want[1], rel=1e-12)
    assert 20 < beyond < 48


# --- closed forms -----------------------------------------------------------------------------------


@pytest.mark.parametrize("density", DENSITIES)
@pytest.mark.parametrize(("steps", "jitter"), [(1, 0.5), (7, 0.0), (16, 0.5), (64, 0.9)])
def test_uniform_media_are_exact(steps, jitter, density):
    """J·(1 − T) with T = e^(−σd), d along the ray: a rounding or two a step."""
    what = scene(SMOKE, dataclasses.replace(SMOKE, albedo=(0.1, 0.2, 0.3), extinction=0.001))
    rays, ends = camera_rays(CAMERA, 8, 6), depths(low=FAR)
    got = march(what, ends, steps=steps, jitter=jitter, density=density)
    through = np.exp(-0.005 * (ends - FAR) * rays.length)
    direction = np.stack([np.broadcast_to(c, (6, 8)) for c in rays.per_depth]) / rays.length
    sun = np.array(SUN.direction) / np.linalg.norm(SUN.direction)
    turned = scalar_phase_array(0.7, np.tensordot(sun, direction, 1))
    scattering = 0.004 * np.array([0.9, 0.8, 0.6]) + 0.001 * np.array([0.1, 0.2, 0.3])
    sky = np.array([0.2, 0.1, 0.4])[:, None, None] + np.array(SUN.irradiance)[:, None, None] * turned
    assert got.transmittance == pytest.approx(through, rel=4 * (steps + 4) * EPS)
    assert got.radiance == pytest.approx(scattering[:, None, None] / 0.005 * sky * (1.0 - through), rel=1e-13)


def scalar_phase_array(g, cosine):
    return (1.0 - g * g) / (4.0 * np.pi * (1.0 + g * g - 2.0 * g * cosine) ** 1.5)


@pytest.mark.parametrize(("steps", "jitter"), [(1, 0.5), (3, 0.1), (16, 0.5)])
@pytest.mark.parametrize("height", [-50.0, 0.5, 6.0, 40.0])
def test_height_fog_is_exact_in_any_number_of_steps(height, steps, jitter):
    """τ in closed form by pieces: level below the start, an exponential above, nothing over the ceiling."""
    camera = dataclasses.replace(CAMERA, position=(0.0, height, 0.0), target=(0.3, height - 0.4, -4.0))
    rays, ends, fog = camera_rays(camera, 8, 6), depths(low=FAR), FOG.height_fog
    what = dataclasses.replace(scene(dataclasses.replace(FOG, emissive=(0.0, 0.0, 0.0)), lights=()), camera=camera)
    got = march(what, ends, rays=rays, steps=steps, jitter=jitter)
    slope = np.broadcast_to(rays.per_depth[1], (6, 8))

    def primitive(y):  # of the density over height
        risen = np.clip(y, fog.start, fog.max_height) - fog.start
        return np.minimum(y, fog.start) + -np.expm1(-fog.falloff * risen) / fog.falloff

    tau = 0.02 * rays.length * (primitive(height + slope * ends) - primitive(height + slope * FAR)) / slope
    albedo = np.array(FOG.albedo)[:, None, None] * np.array([0.2, 0.1, 0.4])[:, None, None]
    # The primitive's difference loses some digits: those of |y| against the fog's own column.
    assert got.transmittance == pytest.approx(np.exp(-tau), rel=1e-12)
    assert got.radiance == pytest.approx(albedo * -np.expm1(-tau), rel=1e-11, abs=1e-15)


@pytest.mark.parametrize("mixing", ["weighted", "mean", "mixture"])
def test_emission_alone_adds_up_along_the_ray(mixing):
    """There is a sun, and ambient light, but nothing to scatter them."""
    glow = Medium(extinction=0.0, emissive=(1.0, 2.0, 4.0))
    rays = camera_rays(CAMERA, 8, 6)
    got = march(scene(glow), np.full((1, 1), 132.0), settings=replace(SETTINGS, phase_mixing=mixing))
    assert got.radiance == pytest.approx(np.array([1.0, 2.0, 4.0])[:, None, None] * 100.0 * rays.length, rel=1e-14)
    assert (got.transmittance == 1.0).all()


@given(st.floats(0.0, 0.3), st.floats(0.0, 0.2), st.floats(-20.0, 20.0), st.integers(1, 9), st.floats(0.0, 0.99),
       st.sampled_from(DENSITIES))
def test_furnace(sigma, falloff, start, steps, jitter, density):
    """White media in even light look like that light: L + T·L_a = L_a whatever their density."""
    white = Medium(albedo=(1.0, 1.0, 1.0), extinction=sigma)
    fog = dataclasses.replace(white, extinction=0.01, height_fog=HeightFog(start=start, falloff=falloff))
    got = march(scene(white, fog, lights=(), ambient=(1.0, 1.0, 1.0)), depths(), steps=steps, jitter=jitter,
                density=density)
    assert got.radiance + got.transmittance == pytest.approx(1.0, abs=16 * (steps + 1) * EPS)
    assert (got.transmittance >= 0.0).all()
    assert (got.transmittance <= 1.0).all()


def test_where_rays_end():
    """At the surface, at the farthest depth where there is none, and not before a surface beyond that."""
    what = scene(SMOKE)
    ends = np.array([[200.0, 500.0, 700.0, np.inf, FAR, 1.0, np.nan, -1.0]])
    got = march(what, ends, farthest=500.0)
    want = np.exp(-0.004 * camera_rays(CAMERA, 8, 6).length[:, :4] * (np.array([200.0, 500.0, 700.0, 500.0]) - FAR))
    assert got.transmittance[:, :4] == pytest.approx(want, rel=1e-13)
    assert (got.transmittance[:, 4:] == 1.0).all()
    assert (got.radiance[..., 4:] == 0.0).all()
    assert (got.radiance[..., :4] > 0.0).all()


# --- convergence ------------------------------------------------------------------------------------


def errors(what, counts, *, ends=None, **options):
    ends = depths(low=100.0) if ends is None else ends
    best = march(what, ends, steps=3000, **(options | {"jitter": 0.5}))
    found = []
    for count in counts:
        got = march(what, ends, steps=count, **options)
        found.append([float(np.abs(a - b).max() / np.abs(b).max()) for a, b in zip(got, best, strict=True)])
    return np.array(found).T


COUNTS = np.array([16, 32, 64, 128])
CASES = {"sampled": ((FOG,), {"density": "sampled"}), "two media": ((SMOKE, TINTED, FOG), {}),
         "shadow": ((SMOKE,), {"visibility": {0: smooth_sight}}),
         "all": ((SMOKE, TINTED), {"visibility": {0: smooth_sight}, "sun_steps": 1, "density": "sampled"})}
# A ceiling is an edge, where sampled densities are of first order.
OPEN = dataclasses.replace(FOG, height_fog=HeightFog(start=-200.0, falloff=0.03))


@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize(("jitter", "wanted"), [(0.5, 2.0), (0.2, 1.0)])
def test_order_of_convergence(case, jitter, wanted):
    """Second order for middles, first for another place, fitted over three doublings against 3000 steps."""
    media, options = CASES[case]
    media = tuple(OPEN if medium is FOG else dataclasses.replace(medium, height_fog=medium.height_fog and HeightFog(
        start=-100.0, falloff=0.05)) for medium in media)
    light, through = errors(scene(*media), COUNTS, jitter=jitter, **options)
    if case == "two media":  # mean densities do not read the jitter
        wanted = 2.0
    assert order(1.0 / COUNTS, light).order == pytest.approx(wanted, abs=0.2)
    if options.get("density") == "sampled":
        assert order(1.0 / COUNTS, through).order == pytest.approx(wanted, abs=0.2)
    else:
        assert through.max() < 3e-13


def test_sixteen_steps_are_worth_what_they_say():
    """Relative errors at 16 steps, root mean square over the image, of light and transmittance: as measured."""
    what, ends = scene(SMOKE, FOG), depths(low=100.0)
    best = march(what, ends, steps=3000)
    for density, light, through in (("mean", 5.3e-4, 0.0), ("sampled", 1.08e-3, 2.02e-3)):
        got = march(what, ends, density=density)
        rms = [float(np.sqrt(np.mean((a / b - 1.0) ** 2))) for a, b in zip(got, best, strict=True)]
        assert rms == pytest.approx([light, through], rel=0.05, abs=1e-12)


# --- against the froxels and the truth --------------------------------------------------------------


def froxel_fog(what, grid, depth, settings=SETTINGS):
    """The frame's own stages, by hand: radiance and transmittance from the camera to view depths."""
    settings = dataclasses.replace(settings, grid=grid)
    froxels = make_froxels(what.camera, grid)
    material = voxelise(what, froxels, {}, settings)
    step, length = step_lengths(froxels)
    stored = integrate(in_scattering(material, what.lights, froxels, ambient=what.ambient), material.extinction, step,
                       length, near=grid.near)
    return lookup_fog(stored, grid, depth)


def with_long_range(what, grid, depth, **options):
    fog = froxel_fog(what, grid, depth)
    long = march(what, depth, settings=dataclasses.replace(SETTINGS, grid=grid), **options)
    return combine(*fog, *long)


@pytest.mark.parametrize("ends", [40.0, 77.7, 256.0])
def test_uniform_fog_equals_that_of_longer_froxels(ends):
    """Both are exact at a slice boundary: 64 slices to the surface, or 16 to the far end and then a march."""
    what, depth = scene(SMOKE, dataclasses.replace(SMOKE, extinction=0.01)), np.full((6, 8), ends)
    whole = froxel_fog(what, dataclasses.replace(SETTINGS.grid, far=ends, depth=64), depth)
    for got, want in zip(with_long_range(what, SETTINGS.grid, depth), whole, strict=True):
        assert got == pytest.approx(want, rel=64 * 4 * EPS)


def test_height_fog_approaches_that_of_longer_froxels():
    """The difference is the froxels' own error, of second order in their slices (the march alone is exact here)."""
    fog = dataclasses.replace(FOG, emissive=(0.0,) * 3, height_fog=HeightFog(start=-200.0, falloff=0.03))
    what, depth = scene(fog), np.full((6, 8), 200.0)
    rays = camera_rays(CAMERA, 8, 6)
    direction = np.stack([np.broadcast_to(c, (6, 8)) for c in rays.per_depth]).reshape(3, -1)
    truth = trace(what, np.array(CAMERA.position)[:, None], direction, (200.0 * rays.length).reshape(-1), rtol=1e-10)
    counts, off = np.array([32, 64, 128, 256]), []
    for count in counts:
        near = dataclasses.replace(SETTINGS.grid, depth=int(count))
        short = with_long_range(what, near, depth)[0]
        whole = froxel_fog(what, dataclasses.replace(near, far=200.0), depth)[0]
        exact = truth.radiance.reshape(3, 6, 8)
        off.append([np.abs(short - exact).max() / exact.max(), np.abs(whole - short).max() / exact.max()])
    ours, difference = np.array(off).T
    assert order(1.0 / counts, difference).order == pytest.approx(2.0, abs=0.1)
    assert difference[-1] < 4e-4
    # What is left of the froxels in front: measured 1.7e-5 with 32 slices, 4e-7 to 1.3e-6 with more, of which the
    # segment in front of the near boundary has a part that no slices take away.
    assert (ours < [3e-5, 6e-6, 2e-6, 2e-6]).all()


def test_no_step_at_the_far_end():
    """From a hair within to a hair beyond: the froxels' lookup ends where the march begins."""
    what = scene(SMOKE, FOG)
    grid = dataclasses.replace(SETTINGS.grid, depth=128)
    inner, outer = (with_long_range(what, grid, np.full((6, 8), z)) for z in (FAR * (1 - 1e-6), FAR * (1 + 1e-6)))
    for a, b in zip(inner, outer, strict=True):
        assert b == pytest.approx(a, rel=1e-5)  # 64 µm of fog
    # Nor in the slope: half a metre beyond adds what half a metre within does, to 1.4 % (fog dims and rays climb).
    at = [with_long_range(what, grid, np.full((6, 8), z))[0] for z in (FAR - 0.5, FAR, FAR + 0.5)]
    assert at[2] - at[1] == pytest.approx(at[1] - at[0], rel=0.03)
    assert (at[2] > at[1]).all()


def test_a_hair_of_fog_beyond_the_far_end():
    """Optical depths of a tenth of a millimetre and of one ulp of depth, each cut into 16 steps."""
    dense = dataclasses.replace(FOG, extinction=1e9, emissive=(0.0,) * 3)
    length = camera_rays(CAMERA, 8, 6).length
    height = 6.0 + np.broadcast_to(camera_rays(CAMERA, 8, 6).per_depth[1], (6, 8)) * FAR
    for ends in (FAR + 1e-4, np.nextafter(FAR, 99.0)):
        sigma = 1e9 if ends < FAR + 1e-6 else 1e3
        got = march(scene(dataclasses.replace(dense, extinction=sigma)), np.full((6, 8), ends))
        density = np.where(height > 30.0, 0.0, np.exp(-0.15 * np.maximum(height - 1.0, 0.0)))
        # The density changes by 0.15·1e-4 on the way.
        assert -np.log(got.transmittance) == pytest.approx(sigma * density * (ends - FAR) * length, rel=1e-4, abs=1e-16)
        assert np.isfinite(got.radiance).all()


def truth_of(what, ends, **options):
    rays = camera_rays(CAMERA, 8, 6)
    direction = np.stack([np.broadcast_to(c, (6, 8)) for c in rays.per_depth]).reshape(3, -1)
    length = rays.length.reshape(-1)
    found = trace(what, np.array(CAMERA.position)[:, None], direction, ends.reshape(-1) * length,
                  starts=np.minimum(FAR, ends.reshape(-1)) * length, settings=SETTINGS, **options)
    return found.radiance.reshape(3, 6, 8), found.transmittance.reshape(*found.transmittance.shape[:-1], 6, 8)


@pytest.mark.parametrize("medium", [FOG, TINTED, SMOKE])
def test_one_medium_is_the_truth_in_sixteen_steps(medium):
    """Nothing is left for the steps to resolve, emission and a tinted extinction included: off by 2e-15, measured."""
    what, ends = scene(medium), depths()
    got, (light, through) = march(what, ends), truth_of(what, ends, rtol=1e-10)
    assert got.radiance == pytest.approx(light, rel=2e-14, abs=1e-300)
    assert got.transmittance == pytest.approx(through, rel=2e-14)


def test_two_media_approach_the_truth():
    what, ends = scene(SMOKE, FOG), depths(low=100.0)
    mixed = replace(SETTINGS, phase_mixing="mixture")
    rays = camera_rays(CAMERA, 8, 6)
    direction = np.stack([np.broadcast_to(c, (6, 8)) for c in rays.per_depth]).reshape(3, -1)
    length = rays.length.reshape(-1)
    truth = trace(what, np.array(CAMERA.position)[:, None], direction, ends.reshape(-1) * length, starts=FAR * length,
                  settings=mixed, rtol=1e-9)
    off = [np.abs(march(what, ends, steps=n, settings=mixed).radiance / truth.radiance.reshape(3, 6, 8) - 1.0).max()
           for n in COUNTS]
    assert order(1.0 / COUNTS, off).order == pytest.approx(2.0, abs=0.3)
    assert off[-1] < 2e-4


def test_exact_shadows_approach_the_truth():
    """Walls between the sun and the rays: edges are of first order for one ray, and their mean falls with the steps."""
    wall = Box(transform=Transform(translate=(20.0, 60.0, -150.0), scale=(40.0, 3.0, 40.0)))
    what, ends = scene(SMOKE, surfaces=(wall,)), depths(low=100.0)
    sights = exact_visibility(occluders(what.surfaces, load_assets(what, None)), what.lights)
    light, through = truth_of(what, ends, rtol=1e-7, shadows="exact")
    unshadowed = march(what, ends).radiance
    assert np.abs(unshadowed / light - 1.0).max() > 0.1
    off = []
    for count in (16, 64, 256, 1024):
        got = march(what, ends, steps=count, visibility=sights)
        off.append(float(np.sqrt(np.mean((got.radiance / light - 1.0) ** 2))))
        assert got.transmittance == pytest.approx(through, rel=1e-11)
    assert order([1 / 16, 1 / 64, 1 / 256, 1 / 1024], off).order == pytest.approx(1.0, abs=0.3)
    assert off[-1] < 1e-3


def test_jitter_takes_the_bias_out_of_shadows():
    """The mean over 32 evenly spread jitters has 32 times the samples: a frame is off by 2 %, their mean by 0.5 %."""
    wall = Box(transform=Transform(translate=(20.0, 60.0, -150.0), scale=(40.0, 3.0, 40.0)))
    what, ends = scene(SMOKE, surfaces=(wall,)), depths(low=100.0)
    sights = exact_visibility(occluders(what.surfaces, load_assets(what, None)), what.lights)
    light, _ = truth_of(what, ends, rtol=1e-7, shadows="exact")
    frames = [march(what, ends, visibility=sights, jitter=(i + 0.5) / 32).radiance for i in range(32)]
    assert np.abs(frames[0] / light - 1.0).max() > 0.02
    assert np.mean(frames, axis=0) == pytest.approx(light, rel=5e-3)


# --- shadows of the media ---------------------------------------------------------------------------


LIGHTS = {"above": (0.4, 0.7, -0.6), "level": (1.0, 0.0, 0.2), "below": (0.3, -0.4, 0.1)}


@pytest.mark.parametrize("distance", [np.inf, 60.0])
@pytest.mark.parametrize("towards", LIGHTS)
def test_media_without_texture_dim_the_sun_in_closed_form(towards, distance):
    light = DirectionalLight(direction=LIGHTS[towards], irradiance=(1.0, 1.0, 1.0))
    media = [SMOKE, FOG, TINTED]
    random = np.random.default_rng(5)
    points = tuple(random.uniform(-40.0, 40.0, (2, 1, 9)) for _ in range(3))
    placed = [place(medium) for medium in media]
    got = sun_transmittance(placed, light, points, distance=distance, steps=1)
    with np.errstate(invalid="ignore"):
        want = light_transmittance(placed, extinctions(media), light, points, settings=SETTINGS, sun_distance=distance)
    assert got.shape == (3, 2, 1, 9)
    assert np.array_equal(got, want)
    assert got.min() < 0.9 or towards != "above"


def textured(**fog):
    return Medium(extinction=0.02, density=DensityTexture(source=WAVE, scale=(0.006, 0.008, 0.005)),
                  height_fog=HeightFog(**fog) if fog else None)


@pytest.mark.parametrize(("distance", "fog", "towards"), [
    (np.inf, {"start": 2.0, "falloff": 0.05}, "above"), (200.0, {"start": 2.0, "falloff": 0.05}, "above"),
    (200.0, {"start": -60.0, "falloff": 0.02}, "level"), (150.0, {"start": -30.0, "falloff": 0.04}, "below"),
    (200.0, {}, "above"), (300.0, {"start": 10.0, "falloff": 0.05, "max_height": 50.0}, "above")])
def test_textures_towards_the_sun_converge_to_the_exact_way(distance, fog, towards):
    """To the sum over the texture's cells, in second order: errors of 16, 32, 64 and 128 steps, root mean square."""
    light = DirectionalLight(direction=LIGHTS[towards], irradiance=(1.0, 1.0, 1.0))
    medium = textured(**fog)
    random = np.random.default_rng(6)
    points = tuple(random.uniform(-40.0, 40.0, (1, 1, 60)) for _ in range(3))
    placed = [place(medium, wave())]
    want = light_transmittance(placed, extinctions([medium]), light, points, settings=SETTINGS, sun_distance=distance)
    got = [sun_transmittance(placed, light, points, steps=int(n), distance=distance) for n in COUNTS]
    off = [float(np.sqrt(np.mean((each - want) ** 2))) for each in got]
    assert order(1.0 / COUNTS, off).order == pytest.approx(2.0, abs=0.3)
    assert off[0] < 2e-4  # measured: at most 1.1e-4 of transmittances between 0.04 and 0.97
    assert want.max() - want.min() > 0.05


def test_a_column_without_end_does_not_dim():
    light = DirectionalLight(direction=(0.0, 1.0, 0.0), irradiance=(1.0, 1.0, 1.0))
    down = dataclasses.replace(light, direction=(0.0, -1.0, 0.0))
    x = np.zeros((1, 1, 2))
    assert (sun_transmittance([place(SMOKE), place(textured(), wave())], light, (x, x, x)) == 1.0).all()
    assert (sun_transmittance([place(textured(start=-5.0), wave())], down, (x, x, x)) == 1.0).all()


def test_media_that_shadow_themselves_are_the_truth():
    """Height fog between the sun and every sample, against the truth with volumetric shadows."""
    fog = dataclasses.replace(FOG, height_fog=HeightFog(start=-20.0, falloff=0.05), extinction=0.01)
    what, ends = scene(fog, ambient=(0.0,) * 3), depths(low=100.0)
    light, _ = truth_of(what, ends, rtol=1e-8, volumetric_shadows=True)
    off = [np.abs(march(what, ends, steps=n, sun_steps=1).radiance / light - 1.0).max() for n in COUNTS]
    assert order(1.0 / COUNTS, off).order == pytest.approx(2.0, abs=0.3)
    assert off[0] < 0.02
    assert np.abs(march(what, ends).radiance / light - 1.0).max() > 0.05  # without


def test_lights_that_cast_no_shadow_are_not_dimmed():
    free = dataclasses.replace(SUN, casts_shadows=False)
    one, other = (march(scene(FOG, lights=(free,)), depths(), sun_steps=n).radiance for n in (0, 4))
    assert np.array_equal(one, other)


def test_textured_media_approach_the_truth():
    """A noise texture under height fog; the texture has kinks, so errors fall in second order only by and large."""
    source = NoiseDensity(size=16, cells=2)
    cloud = Medium(albedo=(0.9, 0.9, 0.9), extinction=0.02, height_fog=HeightFog(start=0.0, falloff=0.05),
                   density=DensityTexture(source=source, scale=(0.01, 0.02, 0.01)))
    what, ends = scene(cloud, SMOKE), depths(low=100.0, high=300.0)
    textures = load_assets(what, None).textures
    light, through = truth_of(what, ends, rtol=1e-5)
    off = []
    for count in COUNTS:
        got = march(what, ends, steps=count, textures=textures)
        off.append([float(np.sqrt(np.mean((got.radiance / light - 1.0) ** 2))),
                    float(np.sqrt(np.mean((got.transmittance / through - 1.0) ** 2)))])
    off = np.array(off)
    for errors in off.T:
        assert order(1.0 / COUNTS, errors).order == pytest.approx(2.0, abs=0.5)
    assert (off[0] < 0.02).all()
    assert (off[-1] < 5e-4).all()


# --- what is left out -------------------------------------------------------------------------------


def test_surfaces_within_the_froxels_take_no_part():
    """Their points are asked of no sight, and their values are exactly those of clear air."""
    asked = []

    def sight(points, normal=None):
        asked.append(np.broadcast_shapes(*(p.shape for p in points)))
        return np.full((1, 1, 1), 0.5)

    ends = np.full((6, 8), 20.0)
    ends[2, 3:6] = 100.0
    got = march(scene(SMOKE), ends, visibility={0: sight}, steps=4)
    assert asked == [(1, 1, 3)] * 4
    alone = march(scene(SMOKE), ends, steps=4)
    inside = ends < FAR
    assert (got.radiance[:, inside] == 0.0).all()
    assert (got.transmittance[inside] == 1.0).all()
    assert np.array_equal(got.transmittance, alone.transmittance)
    assert (got.radiance[:, ~inside] < alone.radiance[:, ~inside]).all()


@pytest.mark.parametrize(("media", "ends", "shapes"), [
    ((), 500.0, ((3, 1, 1), (1, 1))), ((SMOKE,), 20.0, ((3, 1, 1), (1, 1))), ((TINTED,), 20.0, ((3, 1, 1), (3, 1, 1))),
    ((Medium(extinction=0.0),), 500.0, ((3, 1, 1), (1, 1))), ((SMOKE,), 500.0, ((3, 6, 8), (6, 8))),
    ((TINTED,), 500.0, ((3, 6, 8), (3, 6, 8)))])
def test_shapes(media, ends, shapes):
    got = march(scene(*media), np.full((1, 1), ends))
    assert tuple(field.shape for field in got) == shapes
    if shapes[0] == (3, 1, 1):
        assert (got.radiance == 0.0).all()
        assert (got.transmittance == 1.0).all()


def test_nothing_that_shines_leaves_the_transmittance():
    got = march(scene(SMOKE, lights=(), ambient=(0.0,) * 3), np.full((1, 1), 500.0))
    assert got.radiance.shape == (3, 1, 1)
    assert not got.radiance.any()
    assert got.transmittance.shape == (6, 8)


def test_lamps_and_local_media_are_left_out():
    lamp = PointLight(position=(0.0, 5.0, -100.0), intensity=(9.0, 9.0, 9.0), radius=500.0)
    one, other = (march(scene(SMOKE, lights=lights), depths()) for lights in ((SUN,), (lamp, SUN)))
    for a, b in zip(one, other, strict=True):
        assert np.array_equal(a, b)


def test_visibility_goes_by_the_number_of_the_light():
    lamp = PointLight(position=(0.0, 5.0, -100.0), intensity=(9.0, 9.0, 9.0))
    what = scene(SMOKE, lights=(lamp, SUN), ambient=(0.0,) * 3)
    ends = depths(low=FAR + 1.0)
    plain, dark = (march(what, ends, visibility={n: lambda p, normal=None: np.zeros((1, 1, 1))}) for n in (0, 1))
    assert (plain.radiance > 0.0).all()
    assert not dark.radiance.any()


@pytest.mark.parametrize("mixing", ["weighted", "mixture"])
def test_the_result_does_not_depend_on_threads_or_blocks(mixing, monkeypatch):
    what, ends = scene(SMOKE, FOG, TINTED), depths()
    options = {"settings": replace(SETTINGS, phase_mixing=mixing), "visibility": {0: smooth_sight}, "sun_steps": 1}
    whole = march(what, ends, threads=1, **options)
    monkeypatch.setattr("froxel_ref.raymarch.RAYS", 7)
    for threads in (1, 3):
        for a, b in zip(whole, march(what, ends, threads=threads, **options), strict=True):
            assert np.array_equal(a, b)


def test_float32_stays_and_is_float64_rounded():
    """The arithmetic is wider: what is left is the rounding of rays, depths and results, times τ."""
    what, ends = scene(SMOKE, FOG), depths()
    narrow, wide = (march(what, ends, dtype=dtype) for dtype in (np.float32, np.float64))
    for a, b in zip(narrow, wide, strict=True):
        assert a.dtype == np.float32
        assert a == pytest.approx(b, rel=3e-6)


def test_rays_may_keep_axes_of_one():
    """A level camera's x varies along rows only, y along columns only: the arrays as they come."""
    camera = Camera(position=(0.0, 3.0, 0.0), target=(0.0, 3.0, -1.0), width=8, height=6)
    what = dataclasses.replace(scene(SMOKE, FOG), camera=camera)
    rays = camera_rays(camera, 8, 6)
    assert {component.shape for component in rays.per_depth} == {(1, 8), (6, 1), (1, 1)}
    full = rays._replace(per_depth=tuple(np.broadcast_to(c, (6, 8)).copy() for c in rays.per_depth))
    for a, b in zip(march(what, depths(), rays=rays), march(what, depths(), rays=full), strict=True):
        assert np.array_equal(a, b)


# --- switches ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(("switch", "word"), [
    ("emission", "published"), ("emission", "absorption"), ("ambient", "constant"), ("exposure", "lighting"),
    ("integrator", "published"), ("integrator", "half_step"), ("phase_mixing", "mean"), ("phase_mixing", "mixture")])
@pytest.mark.parametrize("phase", ["henyey_greenstein", "two_lobe_henyey_greenstein", "rayleigh"])
def test_switches_mean_what_they_do_in_froxels(switch, word, phase):
    """Uniform media, a column of froxels whose slices are the march's steps."""
    glow = dataclasses.replace(FOG, height_fog=None)
    what = scene(SMOKE, glow)
    what = dataclasses.replace(what, camera=dataclasses.replace(CAMERA, exposure=2.5))
    grid = Grid(width=8, height=6, depth=5, near=FAR, far=FAR + 200.0, distribution="linear")
    settings = dataclasses.replace(replace(SETTINGS, **{switch: word}), phase_function=phase)
    froxels = make_froxels(CAMERA, grid)
    material = voxelise(what, froxels, {}, settings)
    light = in_scattering(material, what.lights, froxels, ambient=what.ambient, phase_function=phase,
                          second_lobe=settings.second_lobe, emission=settings.emission, ambient_term=settings.ambient,
                          exposure=2.5 if settings.exposure == "lighting" else 1.0)
    step, length = step_lengths(froxels)
    # The half step stores its transmittance in the middle of the slice; light is up to its end.
    fog = integrate(light, material.extinction, step, length, near=FAR, integrate_from="near",
                    integrator=settings.integrator)
    got = march(what, np.full((1, 1), FAR + 200.0), settings=settings, steps=5)
    assert got.radiance == pytest.approx(fog.radiance[:, -1], rel=1e-13)
    if word != "half_step":
        assert got.transmittance == pytest.approx(fog.transmittance[-1], rel=1e-13)


def test_a_clamped_extinction_dims_a_vacuum():
    """D3: 1e-5 a metre, as in the froxels with that integrator."""
    got = march(scene(), np.full((1, 1), 132.0), settings=replace(SETTINGS, integrator="published"))
    assert got.transmittance == pytest.approx(np.exp(-1e-5 * 100.0 * camera_rays(CAMERA, 8, 6).length), rel=1e-14)


@pytest.mark.parametrize("steps", [1, 16])
def test_height_fog_with_a_level_texture_is_exact(steps):
    """A texture of ½ halves the fog: its height counts as the mean over a step whether there is a texture or not."""
    half = dataclasses.replace(FOG, extinction=0.04, emissive=(0.0,) * 3, density=DensityTexture(source=WAVE))
    bare = dataclasses.replace(FOG, emissive=(0.0,) * 3)
    got = march(scene(half), depths(), steps=steps, textures={WAVE: np.full((2, 3, 4), 0.5)})
    for a, b in zip(got, march(scene(bare), depths(), steps=steps), strict=True):
        assert a == pytest.approx(b, rel=1e-13)


def test_no_shadow_map_reaches_that_far():
    """A4: outside all cascades the march is lit, though the froxels' switch may say dark."""
    what = scene(SMOKE, surfaces=(Box(transform=Transform(translate=(0.0, 3.0, -20.0), scale=(8.0, 1.0, 8.0))),))
    settings = dataclasses.replace(SETTINGS, shadows="maps")
    assets = load_assets(what, None)
    maps = shadow_stage.shadow_maps(what, settings, assets)
    lit, dark = (march(what, np.full((6, 8), 900.0), settings=settings, visibility=shadow_stage.map_sights(
        maps, what, replace(settings, beyond_cascades=word), assets)) for word in ("lit", "dark"))
    unshadowed = march(what, np.full((6, 8), 900.0))
    assert np.array_equal(lit.radiance, unshadowed.radiance)
    assert (dark.radiance <= lit.radiance).all()
    assert dark.radiance.mean() < 0.8 * lit.radiance.mean()


def test_time_moves_textures():
    source = NoiseDensity(size=8, cells=2)
    cloud = Medium(extinction=0.02, density=DensityTexture(source=source, scale=(0.01,) * 3, scroll=(0.1, 0.0, 0.0)))
    what = scene(cloud)
    textures = load_assets(what, None).textures
    first, second, period = (march(what, depths(), textures=textures, settings=dataclasses.replace(SETTINGS, time=t))
                             for t in (0.0, 2.0, 10.0))
    assert np.abs(first.radiance - second.radiance).max() > 1e-3
    assert period.radiance == pytest.approx(first.radiance, rel=1e-12)


# --- together with the fog --------------------------------------------------------------------------


def test_two_stretches_in_a_row_are_one():
    """By the definition: what is marched from 32 m to 200 m is that to 80 m, and behind it that from 80 m."""
    what, ends = scene(SMOKE, TINTED, lights=()), np.full((6, 8), 200.0)
    whole = march(what, ends, steps=400)
    first = march(what, np.full((6, 8), 80.0), steps=400)
    second = march(what, ends, steps=400, settings=dataclasses.replace(
        SETTINGS, grid=dataclasses.replace(SETTINGS.grid, far=80.0)))
    for a, b in zip(combine(*first, *second), whole, strict=True):
        assert a == pytest.approx(b, rel=1e-5)


def test_combined_by_hand():
    """T_fog ¼, ½ and 1 in the channels; light 1 in front, 8 behind, of which ½ passes."""
    fog = np.array([0.25, 0.5, 1.0]).reshape(3, 1, 1)
    light, through = combine(np.ones((3, 1, 1)), fog, np.full((3, 2, 2), 8.0), np.full((2, 2), 0.5))
    assert light[:, 0, 0].tolist() == [3.0, 5.0, 9.0]
    assert through[:, 1, 1].tolist() == [0.125, 0.25, 0.5]
    nothing = LongRange(np.zeros((3, 1, 1)), np.ones((1, 1)))
    for got, want in zip(combine(light, through, *nothing), (light, through), strict=True):
        assert np.array_equal(got, want)


# --- bad input --------------------------------------------------------------------------------------


@pytest.mark.parametrize(("options", "place"), [
    ({"farthest": 10.0}, "farthest"), ({"farthest": np.inf}, "farthest"), ({"farthest": np.nan}, "farthest"),
    ({"steps": 0}, "steps"), ({"jitter": 1.0}, "jitter"), ({"jitter": np.full((6, 8), -0.1)}, "jitter"),
    ({"jitter": np.nan}, "jitter"), ({"jitter": np.zeros((3, 3))}, "jitter"), ({"density": "men"}, "density"),
    ({"sun_steps": -1}, "sun_steps"), ({"sun_distance": 0.0}, "sun_distance"),
    ({"sun_distance": np.nan}, "sun_distance")])
def test_bad_input_is_named(options, place):
    with pytest.raises(InputError) as fault:
        march(scene(SMOKE), depths(), **options)
    assert fault.value.place == place
    assert "must" in fault.value.problem or "did you mean" in fault.value.problem


def test_depth_must_fit_and_textures_must_be_there():
    with pytest.raises(InputError, match="depth"):
        march(scene(SMOKE), np.ones((5, 8)))
    with pytest.raises(InputError, match="density"):
        march(scene(textured()), depths())
    with pytest.raises(InputError, match="steps"):
        sun_transmittance([place(SMOKE)], SUN, (np.zeros(1),) * 3, steps=0)
