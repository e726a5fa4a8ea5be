"""Looking the fog up at a pixel's depth, and laying it over the scene."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from reference_integrate import lookup_pixel

from froxel_ref.apply import LOOKUPS, composite, fog_lookup, lookup_fog
from froxel_ref.grid import slice_to_depth
from froxel_ref.integrate import Integrated, integrate
from froxel_ref.records import InputError
from froxel_ref.settings import SWITCHES, Grid

EPS = 2.0**-52


def grid(depth, *, width=1, height=1, near=1.0, far=9.0, distribution="linear"):
    return Grid(width=width, height=height, depth=depth, near=near, far=far, distribution=distribution)


def random_fog(g: Grid, dtype=np.float64, seed=1) -> Integrated:
    """Any numbers will do: the lookup knows nothing of fog."""
    shape, random = (g.depth, g.height, g.width), np.random.default_rng(seed)
    return Integrated(*(random.random(size).astype(dtype) for size in (
        (3, *shape), shape, (3, *shape[1:]), shape[1:])))


def uniform_fog(g: Grid, sigma: float, source: float = 1.0) -> Integrated:
    boundaries = slice_to_depth(np.arange(g.depth + 1), g).reshape(-1, 1, 1)
    return integrate(np.full((3, 1, 1, 1), source), np.full((1, 1, 1), sigma), np.diff(boundaries, axis=0),
                     np.ones((1, 1)), near=g.near)


# --- by hand ----------------------------------------------------------------------------------------

# What the lookup is by default, and as published (D4 with A11).
HOW = {"boundary": {"lookup": "boundary"}, "centre": {"lookup": "centre", "near_surface": "first_slice"}}

# Boundaries at 1, 2, 3 m; stored T ½ and ¼, front 0.8. Boundary: T(0.5 m) is midway from 1 to 0.8, T(1.25 m)
# a quarter from 0.8 to ½. Centre: ½ stands at 1.5 m and ¼ at 2.5 m. First slice: ½ in front of where it stands.
BY_HAND = {("boundary", "fog"): [1.0, 0.9, 0.8, 0.725, 0.5, 0.375, 0.25, 0.25, 0.25],
           ("boundary", "first_slice"): [0.5, 0.5, 0.5, 0.5, 0.5, 0.375, 0.25, 0.25, 0.25],
           ("centre", "fog"): [1.0, 5 / 6, 2 / 3, 7 / 12, 0.375, 0.25, 0.25, 0.25, 0.25],
           ("centre", "first_slice"): [0.5, 0.5, 0.5, 0.5, 0.375, 0.25, 0.25, 0.25, 0.25]}


@pytest.mark.parametrize(("lookup", "near_surface"), BY_HAND)
def test_column_by_hand(lookup, near_surface):
    depth = np.array([[0.0, 0.5, 1.0, 1.25, 2.0, 2.5, 3.0, 50.0, np.inf]])
    fog = Integrated(np.zeros((3, 1, 1, 1)), np.array([0.5, 0.25]).reshape(2, 1, 1), np.zeros((3, 1, 1)),
                     np.array([[0.8]]))
    got = lookup_fog(fog, grid(2, far=3.0), depth, lookup=lookup, near_surface=near_surface)[1]
    assert got.ravel() == pytest.approx(BY_HAND[lookup, near_surface], rel=2 * EPS)


def test_light_starts_from_nothing_at_the_camera():
    """Light 0 at 0 m, (3, 6, 9) at the near boundary 1 m, (4, 8, 12) at 2 m."""
    colour = np.array([1.0, 2.0, 3.0]).reshape(3, 1, 1)
    fog = Integrated(4.0 * colour[:, None], np.ones((1, 1, 1)), 3.0 * colour, np.ones((1, 1)))
    got = lookup_fog(fog, grid(1, far=2.0), np.array([[0.0, 0.5, 1.0, 1.5, 2.0]]))[0]
    assert np.array_equal(got, colour * [[0.0, 1.5, 3.0, 3.5, 4.0]])


def test_image_by_hand():
    """Two texels seen by four pixels: the outer ones beyond the texel centres, the inner ¼ between."""
    fog = Integrated(np.zeros((3, 1, 1, 1)), np.array([[[0.2, 0.6]]]), np.zeros((3, 1, 1)), np.ones((1, 2)))
    got = lookup_fog(fog, grid(1, width=2, far=2.0), np.full((3, 4), 2.0))[1]
    assert got == pytest.approx(np.array([[0.2, 0.3, 0.5, 0.6]] * 3), rel=2 * EPS)


def test_nan_depth_shows():
    fog = random_fog(grid(4))
    got = lookup_fog(fog, grid(4), np.array([[2.0, np.nan]]))[0]
    assert np.isfinite(got[..., 0]).all()
    assert np.isnan(got[..., 1]).all()


# --- what is exact ----------------------------------------------------------------------------------


@pytest.mark.parametrize("dtype", [np.float64, np.float32])
def test_stored_values_come_back_bit_for_bit(dtype):
    """A pixel per texel, depths on boundaries that are exact numbers (1, 2 … 9 m)."""
    g = grid(8, width=5, height=3)
    fog = random_fog(g, dtype)
    for k in range(8):
        got = lookup_fog(fog, g, np.full((3, 5), k + 2.0, dtype))
        assert np.array_equal(got[0], fog.radiance[:, k])
        assert np.array_equal(got[1], fog.transmittance[k])
    front = lookup_fog(fog, g, np.ones((3, 5), dtype))
    assert np.array_equal(front[0], fog.front_radiance)
    assert np.array_equal(front[1], fog.front_transmittance)


def test_stored_values_come_back_on_exponential_slices():
    """A depth's slice coordinate is off by a few ulp of D, times the step to the neighbour (at most 1)."""
    g = Grid(width=4, height=3)
    fog = random_fog(g)
    depth = slice_to_depth(np.arange(1, 65), g)
    got = np.array([lookup_fog(fog, g, np.full((3, 4), z))[1] for z in depth])
    assert np.abs(got - fog.transmittance).max() <= 4 * 64 * EPS


@pytest.mark.parametrize("lookup", LOOKUPS)
def test_constant_field_comes_back_exactly(lookup):
    g = Grid(width=4, height=3, depth=5)
    fog = Integrated(np.full((3, 5, 3, 4), 0.1), np.full((5, 3, 4), 0.7),
                     np.full((3, 3, 4), 0.1), np.full((3, 4), 0.7))
    depth = np.random.default_rng(2).uniform(g.near, 70.0, (11, 13))
    radiance, transmittance = lookup_fog(fog, g, depth, **HOW[lookup])
    assert (radiance == 0.1).all()
    assert (transmittance == 0.7).all()


def test_linear_field_is_reproduced():
    """a + bx + cy + dz over texel places is linear in between, and level beyond the outer texel centres."""
    g = grid(8, width=6, height=5)
    x, y = np.arange(6) + 0.5, (np.arange(5) + 0.5)[:, None]
    stored = 0.3 + 0.02 * x + 0.03 * y + 0.01 * np.arange(2.0, 10.0).reshape(-1, 1, 1)
    fog = Integrated(np.zeros((3, 1, 1, 1)), stored, np.zeros((3, 1, 1)), stored[0] - 0.01)
    depth = np.random.default_rng(2).uniform(1.0, 9.0, (9, 17))
    across = np.clip((np.arange(17) + 0.5) * 6 / 17, 0.5, 5.5)
    down = np.clip((np.arange(9) + 0.5) * 5 / 9, 0.5, 4.5)[:, None]
    exact = 0.3 + 0.02 * across + 0.03 * down + 0.01 * depth
    assert lookup_fog(fog, g, depth)[1] == pytest.approx(exact, rel=8 * EPS)


@pytest.mark.parametrize("lookup", LOOKUPS)
@pytest.mark.parametrize(("width", "height"), [(7, 5), (1, 4), (3, 1)])
def test_agrees_with_the_scalar_loop(width, height, lookup):
    """Tent weights over all texels, one pixel at a time."""
    g = grid(6, width=width, height=height)
    fog = random_fog(g)
    depth = np.random.default_rng(4).uniform(0.0, 12.0, (6, 8))
    radiance, transmittance = lookup_fog(fog, g, depth, **HOW[lookup])
    boundaries = [1.0 + 8.0 * k / 6.0 for k in range(7)]
    for j, i in itertools.product(range(6), range(8)):
        z, u, v = depth[j, i], (i + 0.5) / 8, (j + 0.5) / 6
        place = (boundaries, (z - 1.0) / 8.0 * 6.0, z, u, v, lookup)
        light = lookup_pixel(fog.radiance[1].tolist(), fog.front_radiance[1].tolist(), 0.0, *place)
        through = lookup_pixel(fog.transmittance.tolist(), fog.front_transmittance.tolist(), 1.0, *place)
        assert (radiance[1, j, i], transmittance[j, i]) == pytest.approx((light, through), rel=1e-14)


# --- the two places of a stored value ---------------------------------------------------------------


def worst_error(count, lookup, distribution):
    """Largest error of light and transmittance inside the grid, in uniform fog, against the closed form."""
    g = grid(count, near=0.5, far=8.0, distribution=distribution)
    depth = np.linspace(0.5, 8.0, 5003)[None, 40:-1200]
    light, through = lookup_fog(uniform_fog(g, 0.4), g, depth, **HOW[lookup])
    exact = np.exp(-0.4 * depth)
    return np.abs(light[0] - (1.0 - exact) / 0.4).max(), np.abs(through - exact).max()


@pytest.mark.parametrize("distribution", ["linear", "exponential"])
@pytest.mark.parametrize(("lookup", "order"), [("boundary", 2.0), ("centre", 1.0)])
def test_order_of_the_lookup(lookup, order, distribution):
    """Fitted slope of log error against log slice depth."""
    counts = np.array([64, 128, 256, 512])
    errors = np.array([worst_error(count, lookup, distribution) for count in counts])
    assert -np.polyfit(np.log(counts), np.log(errors), 1)[0] == pytest.approx([order] * 2, abs=0.1)


def test_centre_lookup_is_half_a_slice_too_deep():
    """D4: with 0.5 m slices, the fog found at depth z is that at z + 0.25 m: 2.5 % of thin fog at 10 m."""
    g = grid(128, near=0.5, far=64.5)
    fog = uniform_fog(g, 1e-6)
    depth = np.array([[10.0, 20.0, 40.0]])
    through = {lookup: -np.log(lookup_fog(fog, g, depth, **HOW[lookup])[1]) / 1e-6 for lookup in LOOKUPS}
    assert through["boundary"] == pytest.approx(depth, rel=1e-9)
    # A chord of e^(−σz) lies σh²/8 = 3.1e-8 m above it in the middle of a slice.
    assert through["centre"] == pytest.approx(depth + 0.25, rel=1e-9, abs=4e-8)


def test_centre_lookup_gives_near_surfaces_the_first_slice():
    """A11: at the lens, a surface is behind all of slice 0; corrected, behind nothing."""
    g = grid(8)
    fog = uniform_fog(g, 0.5)
    light, through = lookup_fog(fog, g, np.array([[0.0, 0.3, 1.4]]), **HOW["centre"])
    assert np.array_equal(through[0], np.repeat(fog.transmittance[0, 0], 3))
    assert np.array_equal(light[0, 0], np.repeat(fog.radiance[0, 0, 0], 3))
    assert lookup_fog(fog, g, np.array([[0.0]]))[1] == 1.0


# --- whatever the fog -------------------------------------------------------------------------------


@given(st.integers(1, 6), st.integers(1, 4), st.integers(1, 5), st.sampled_from(LOOKUPS), st.integers(0, 99))
def test_never_leaves_the_range_of_the_stored_values(depth, height, width, lookup, seed):
    g = Grid(width=width, height=height, depth=depth)
    fog = random_fog(g, seed=seed)
    image = np.random.default_rng(seed).uniform(0.0, 80.0, (3, 7))
    found = lookup_fog(fog, g, image, **HOW[lookup])
    for got, values, front, camera in zip(found, fog[:2], fog[2:], (0.0, 1.0), strict=True):
        assert got.min() >= min(values.min(), front.min(), camera)
        assert got.max() <= max(values.max(), front.max(), camera)


@pytest.mark.parametrize("lookup", LOOKUPS)
@pytest.mark.parametrize("dtype", [np.float64, np.float32])
def test_same_bits_whatever_the_threads(dtype, lookup):
    g = Grid(width=20, height=11, depth=9)
    fog = random_fog(g, dtype)
    depth = np.random.default_rng(5).uniform(0.0, 80.0, (90, 160)).astype(dtype)
    one, three = (lookup_fog(fog, g, depth, **HOW[lookup], threads=threads) for threads in (1, 3))
    for a, b in zip(one, three, strict=True):
        assert a.dtype == dtype
        assert np.array_equal(a, b)


@pytest.mark.parametrize("lookup", LOOKUPS)
@pytest.mark.parametrize("depth", [1, 9])
def test_compact_fields_give_the_same_bits(depth, lookup):
    """Vacuum's single texel, and a column that is the same for all pixels, against all written out."""
    g = Grid(width=6, height=4, depth=depth)
    image = np.random.default_rng(6).uniform(0.0, 80.0, (8, 10))
    column = random_fog(Grid(width=1, height=1, depth=depth))
    vacuum = Integrated(np.zeros((3, 1, 1, 1)), np.ones((1, 1, 1)), np.zeros((3, 1, 1)), np.ones((1, 1)))
    for fog in (column, vacuum):
        full = Integrated(*(np.broadcast_to(field, lead + (depth, 4, 6)[-field.ndim + len(lead):]).copy()
                            for field, lead in zip(fog, ((3,), (), (3,), ()), strict=True)))
        for a, b in zip(lookup_fog(fog, g, image, **HOW[lookup]), lookup_fog(full, g, image, **HOW[lookup]),
                        strict=True):
            assert np.array_equal(*np.broadcast_arrays(a, b))


def test_one_transmittance_per_colour():
    g = Grid(width=6, height=4, depth=5)
    fog = random_fog(g)
    tinted = fog._replace(transmittance=np.stack([fog.transmittance**power for power in (1, 2, 3)]),
                          front_transmittance=np.stack([fog.front_transmittance] * 3))
    image = np.random.default_rng(6).uniform(0.0, 80.0, (8, 10))
    got = lookup_fog(tinted, g, image)[1]
    assert got.shape == (3, 8, 10)
    assert np.array_equal(got[0], lookup_fog(fog, g, image)[1])
    assert composite(np.ones((3, 8, 10)), np.zeros((3, 1, 1)), got) == pytest.approx(got)


@pytest.mark.parametrize("lookup", LOOKUPS)
@pytest.mark.parametrize("dtype", [np.float64, np.float32])
def test_scattered_pixels_have_the_bits_of_the_image(dtype, lookup):
    g = Grid(width=6, height=4, depth=5)
    rng = np.random.default_rng(7)
    image = rng.uniform(0.0, 80.0, (12, 17)).astype(dtype)
    rows, columns = rng.integers(12, size=40), rng.integers(17, size=40)
    for fog in (random_fog(g, dtype), random_fog(Grid(width=1, height=1, depth=5), dtype)):
        at = fog_lookup(fog, g, image.shape, **HOW[lookup])
        for got, whole in zip(at(rows, columns, image[rows, columns]), lookup_fog(fog, g, image, **HOW[lookup]),
                              strict=True):
            assert got.dtype == dtype
            assert np.array_equal(got, np.broadcast_to(whole, (*whole.shape[:-2], 12, 17))[..., rows, columns])


def test_scattered_pixels_of_vacuum_are_one():
    vacuum = Integrated(np.zeros((3, 1, 1, 1)), np.ones((1, 1, 1)), np.zeros((3, 1, 1)), np.ones((1, 1)))
    radiance, transmittance = fog_lookup(vacuum, grid(4), (5, 5))(np.arange(5), np.arange(5), np.ones(5))
    assert (radiance.shape, transmittance.shape) == ((3, 1), (1,))


def test_inputs_are_left_alone():
    g = Grid(width=6, height=4, depth=5)
    fog, image = random_fog(g), np.full((3, 5), np.inf)
    before = [field.copy() for field in fog]
    lookup_fog(fog, g, image)
    assert all(np.array_equal(a, b) for a, b in zip(fog, before, strict=True))
    assert np.isinf(image).all()


def test_switches_are_the_words_of_the_settings():
    assert set(LOOKUPS) == set(SWITCHES["lookup"])
    with pytest.raises(InputError, match="boundary, centre"):
        lookup_fog(random_fog(grid(2)), grid(2), np.ones((1, 1)), lookup="center")
    with pytest.raises(InputError, match="near_surface: is 'all', must be one of fog, first_slice"):
        lookup_fog(random_fog(grid(2)), grid(2), np.ones((1, 1)), near_surface="all")
    with pytest.raises(InputError, match="boundary, centre"):
        fog_lookup(random_fog(grid(2)), grid(2), (1, 1), lookup="center")


# --- over the scene ---------------------------------------------------------------------------------


def test_composite_by_hand():
    """Scene (8, 4, 0) through ¼, plus fog (1, 0.5, 2)."""
    scene, fog = (np.array(c).reshape(3, 1, 1) for c in ([8.0, 4.0, 0.0], [1.0, 0.5, 2.0]))
    assert np.array_equal(composite(scene, fog, np.full((1, 1), 0.25)).ravel(), [3.0, 1.5, 2.0])


def test_no_fog_leaves_the_scene_alone():
    scene = np.random.default_rng(8).random((3, 4, 5))
    assert np.array_equal(composite(scene, np.zeros((3, 1, 1)), np.ones((1, 1))), scene)
