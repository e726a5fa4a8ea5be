"""Where the shadows of particles begin and end along rays, and what they leave of a light there."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
import reference_particles as reference

from froxel_ref.assets import load_assets
from froxel_ref.billboard_shadows import points_transmittance
from froxel_ref.billboards import Particles, placed_particles
from froxel_ref.geometry import Lines
from froxel_ref.particle_shadows import Shadows, particle_cuts, particle_shadows, passing
from froxel_ref.scene import DirectionalLight, Light, Particle, PointLight, Scene

WHITE = (1.0, 1.0, 1.0)
TEXTURE = np.random.default_rng(5).random((5, 7))
LIGHTS: dict[str, Light] = {
    "sun": DirectionalLight(direction=(0.4, 0.8, -0.3), irradiance=WHITE),
    "high sun": DirectionalLight(direction=(0.0, 1.0, 0.0), irradiance=WHITE),
    "lamp among them": PointLight(position=(0.3, 0.2, -0.4), intensity=WHITE, falloff="inverse_square"),
    "lamp": PointLight(position=(9.0, 14.0, 3.0), intensity=WHITE, radius=90.0),
}


def strewn(seed: int, count: int = 18) -> tuple[Particle, ...]:
    """Particles of every profile, some with a texture."""
    rng = np.random.default_rng(seed)
    return tuple(Particle(position=tuple(rng.uniform(-2, 2, 3)), size=rng.uniform(0.3, 2.0), fom_multiplier=1 + i % 3,
                          rotation=rng.uniform(0, 360), opacity=rng.uniform(0.1, 0.95), texture=("a", None)[i % 5 > 0],
                          profile=("soft", "disc", "square")[i % 3]) for i in range(count))


def ready(particles: tuple[Particle, ...]) -> Particles:
    return placed_particles(Scene(particles=particles), load_assets(Scene(), None)._replace(opacities={"a": TEXTURE}))


def rays(seed: int, count: int, light: Light | None = None) -> Lines:
    """From all around; the first passes through the lamp, the second lies in the plane of a particle."""
    rng = np.random.default_rng(seed)
    way = rng.normal(size=(3, count))
    way /= np.sqrt((way * way).sum(axis=0))
    start = rng.uniform(-4, 4, (3, count))
    if isinstance(light, PointLight):
        start[:, 0] = np.asarray(light.position) - 2.0 * way[:, 0]
    return Lines(start, way, np.zeros(count), np.full(count, 8.0))


def points(lines: Lines, t: np.ndarray) -> tuple[np.ndarray, ...]:
    return tuple(lines.origin[:, :, None] + lines.direction[:, :, None] * t)


def owners(found: Shadows) -> np.ndarray:
    return np.repeat(np.arange(len(found.first) - 1), np.diff(found.first))


@pytest.mark.parametrize("name", LIGHTS)
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_what_passes_is_what_points_have(name: str, seed: int) -> None:
    """Of the points on the rays, in any order, each looked at alone; rounding decides only at an edge."""
    particles, light, lines = ready(strewn(seed)), LIGHTS[name], rays(seed, 60, LIGHTS[name])
    t = np.random.default_rng(seed).uniform(0.0, 8.0, (60, 40))
    got = passing(particle_shadows(particles, light, lines), np.arange(60), t)
    assert 0.02 < (got < 1.0).mean() < 0.9
    np.testing.assert_allclose(got, points_transmittance(particles, light, points(lines, t)), rtol=1e-9)


@pytest.mark.parametrize("name", LIGHTS)
def test_what_passes_against_a_scalar_loop(name: str) -> None:
    particles, light, lines = strewn(7, 9), LIGHTS[name], rays(7, 6)
    t = np.linspace(0.1, 7.9, 23) * np.ones((6, 1))
    got = passing(particle_shadows(ready(particles), light, lines), np.arange(6), t)
    want = [[reference.transmittance(particles, {"a": TEXTURE.tolist()}, light, tuple(float(c[r, i]) for c in where))
             for i in range(23)] for where in (points(lines, t),) for r in range(6)]
    np.testing.assert_allclose(got, want, rtol=1e-9)


@pytest.mark.parametrize("name", LIGHTS)
def test_a_shadow_ends_where_it_says(name: str) -> None:
    """Just within it the particle alone dims (a soft one by some 1e-9), just outside it does not."""
    some = tuple(p for p in strewn(4, 60) if p.texture is None)
    particles, lines = ready(some), rays(4, 40)
    found = particle_shadows(particles, LIGHTS[name], lines)
    assert found.particle.size > 40
    row, step = owners(found), 1e-6
    for i in range(0, found.particle.size, 3):
        alone = ready((some[found.particle[i]],))
        for end, inward in ((found.enter[i], step), (found.leave[i], -step)):
            if not 0.0 < end < 8.0 or found.leave[i] - found.enter[i] < 4 * step:
                continue
            t = np.array([[end + inward, end - inward]])
            one = Lines(lines.origin[:, row[i], None], lines.direction[:, row[i], None], np.zeros(1), np.ones(1))
            within, outside = points_transmittance(alone, LIGHTS[name], points(one, t))[0]
            assert outside == 1.0
            assert within < 1.0


def test_only_pairs_that_meet_are_kept() -> None:
    """A thousand particles, of which a ray's ways to a lamp meet those in one plane; none is lost."""
    rng = np.random.default_rng(1)
    many = tuple(Particle(position=tuple(rng.uniform(-9, 9, 3)), size=0.2, profile="disc") for _ in range(1000))
    lines = rays(2, 8)
    found = particle_shadows(ready(many), LIGHTS["lamp"], lines)
    assert found.particle.size < 0.01 * 1000 * 8
    t = np.linspace(0.0, 8.0, 4001) * np.ones((8, 1))
    want = points_transmittance(ready(many), LIGHTS["lamp"], points(lines, t))
    assert (want < 1.0).any()
    np.testing.assert_allclose(passing(found, np.arange(8), t), want, rtol=1e-12)


def test_far_from_the_origin_nothing_is_lost() -> None:
    """1e6 m away rounding is 1e-10 m: shadows end as they do at the origin, to 1e-8 m."""
    far = np.array([1e6, -2e6, 5e5])
    near_scene, lines = strewn(6), rays(6, 50)
    moved = tuple(Particle(**{**{n: getattr(p, n) for n in ("size", "rotation", "opacity", "profile", "texture")},
                              "position": tuple(np.asarray(p.position) + far)}) for p in near_scene)
    light = LIGHTS["lamp"]
    there = PointLight(position=tuple(np.asarray(light.position) + far), intensity=WHITE, radius=90.0)
    for a, b in ((light, there), (LIGHTS["sun"], LIGHTS["sun"])):
        one = particle_shadows(ready(near_scene), a, lines)
        other = particle_shadows(ready(moved), b, lines._replace(origin=lines.origin + far[:, None]))
        wide = one.leave - one.enter > 1e-3
        np.testing.assert_array_equal(one.particle[wide], other.particle[other.leave - other.enter > 1e-3])
        np.testing.assert_allclose(other.enter[other.leave - other.enter > 1e-3], one.enter[wide], atol=1e-6)


def test_cuts_are_the_ends_and_the_lines_of_textures() -> None:
    """A sun from above: the ray crosses 2 m of a texture. The columns' lines at first; of 80 columns, each second."""
    sun = LIGHTS["high sun"]
    board = Particle(position=(0, 3, -5), size=2.0, texture="a")
    along_x = Lines(np.array([[-4.0], [0.0], [-5.0]]), np.array([[1.0], [0.0], [0.0]]), np.zeros(1), np.full(1, 9.0))
    for columns, inner in ((2, [3.5, 4.5]), (4, [3.25, 3.75, 4.25, 4.75]), (80, 3.0 + 2.0 * np.arange(1, 40) / 40)):
        assets = load_assets(Scene(), None)._replace(opacities={"a": np.ones((1, columns))})
        particles = placed_particles(Scene(particles=(board,)), assets)
        cuts = particle_cuts(particle_shadows(particles, sun, along_x))
        np.testing.assert_allclose(np.sort(cuts[np.isfinite(cuts)]), [3.0, *inner, 5.0], rtol=1e-12)
        assert particle_cuts(particle_shadows(particles, sun, along_x._replace(stop=np.full(1, 2.0)))).shape == (1, 0)


@pytest.mark.parametrize("name", LIGHTS)
def test_between_cuts_a_texture_is_smooth(name: str) -> None:
    """There a polynomial of degree 10 through a piece of optical transmittance is right to some 1e-6."""
    board = ready(tuple(Particle(position=(x, 1, -2), size=3.0, rotation=33.0, texture="a") for x in (-1, 1)))
    lines = rays(9, 60)
    found = particle_shadows(board, LIGHTS[name], lines)
    cuts, worst = particle_cuts(found), 0.0
    for row in np.flatnonzero(np.diff(found.first)):
        ends = np.unique(cuts[row, np.isfinite(cuts[row])])
        for low, high in pairwise(ends.tolist()):
            x = np.polynomial.chebyshev.chebpts1(24)
            t = 0.5 * (low + high) + 0.5 * (high - low) * x
            y = passing(found, np.array([row]), t[None])[0]
            fit = np.polynomial.Chebyshev.fit(x, y, 10)
            worst = max(worst, np.abs(fit(x) - y).max())
    assert worst < 1e-5


def test_work_in_parts_changes_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    particles, lines = ready(strewn(8, 40)), rays(8, 50)
    found = particle_shadows(particles, LIGHTS["lamp"], lines)
    rows = np.repeat(np.arange(50), 3)
    t = np.random.default_rng(8).uniform(0, 8, (150, 5))
    want = passing(found, rows, t)
    for name, value in (("TOGETHER", 1), ("PAIRS", 7)):
        monkeypatch.setattr(f"froxel_ref.particle_shadows.{name}", value)
    again = particle_shadows(particles, LIGHTS["lamp"], lines)
    np.testing.assert_array_equal(again.particle, found.particle)
    np.testing.assert_array_equal(passing(again, rows, t), want)
    assert (want < 1.0).any()


def test_a_lamp_in_a_particle_and_one_out_of_reach() -> None:
    particles = ready((Particle(position=(0, 2, 0), profile="square", size=2.0),))
    lines = rays(3, 30)
    inside = PointLight(position=(0, 2, 0), intensity=WHITE, radius=90.0)
    short = PointLight(position=(0, 9, 0), intensity=WHITE, radius=6.0)
    assert particle_shadows(particles, inside, lines).particle.size == 0
    assert particle_shadows(particles, short, lines).particle.size == 0
