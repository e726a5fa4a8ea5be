"""Lookups in Fourier opacity maps: octahedra across edges and corners, spot lights, cascades, ranges."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from reference_fom import fold, listing_3_17, neighbour, unfold

from froxel_ref.fom import sample_coefficients, segment_coefficients
from froxel_ref.fom_lookup import OpacityMap, cascade_sight, lamp_sight, planes_of
from froxel_ref.fom_views import lamp_directions, octahedral_directions, opacity_cascades
from froxel_ref.light_visibility import both_sights
from froxel_ref.scene import Camera, DirectionalLight, PointLight, SpotLight
from froxel_ref.settings import Grid, OpacityMaps, ShadowMaps
from froxel_ref.shadow_filters import pad_octahedral
from froxel_ref.shadow_views import raster_from_world, spot_view

HERE = (0.5, -1.0, 2.0)
RELATIVE = np.concatenate([np.eye(3), -np.reshape(HERE, (3, 1))], axis=1)[None]
INNER = 16


def smooth(ways: np.ndarray) -> np.ndarray:
    """A total optical depth that varies smoothly with direction."""
    x, y, z = ways
    return 1.5 + 0.6 * x - 0.4 * y + 0.5 * z * x + 0.3 * y * y


def octahedral(values: np.ndarray, *, reach: float = 10.0, gutter: int = 1, harmonics: int = 0) -> OpacityMap:
    """A map of uniform extinction whose optical depth to ``reach`` is given by texel, without gutter."""
    planes = np.zeros((2 * harmonics + 2, *values.shape))
    planes[0] = 2.0 * values
    return OpacityMap("octahedral", pad_octahedral(planes, gutter)[None], np.zeros(1), np.full(1, reach), RELATIVE,
                      gutter)


def points_at(ways: np.ndarray, distance: float | np.ndarray) -> tuple[np.ndarray, ...]:
    return tuple(HERE[c] + ways[c] * distance for c in range(3))


# --- octahedra --------------------------------------------------------------------------------------


@pytest.mark.parametrize("size", [1, 2, 3, 8, 15])
def test_directions_are_those_of_the_fold(size: int) -> None:
    ways = octahedral_directions(size)
    for row in range(size):
        for column in range(size):
            u, v = (2.0 * (column + 0.5) / size - 1.0, 2.0 * (row + 0.5) / size - 1.0)
            np.testing.assert_allclose(ways[:, row, column], unfold(u, v), atol=1e-15)
            np.testing.assert_allclose(fold(unfold(u, v)), (u, v), atol=1e-14)


@pytest.mark.parametrize("size", [2, 3, 8])
def test_the_gutter_sees_what_the_true_neighbour_sees(size: int) -> None:
    inner, padded = octahedral_directions(size), octahedral_directions(size, gutter=2)
    for row in range(-2, size + 2):
        for column in range(-2, size + 2):
            there = neighbour(row, column, size)
            assert np.array_equal(padded[:, row + 2, column + 2], inner[:, *there])


def test_a_texels_neighbour_across_an_edge_is_near_it_on_the_sphere() -> None:
    """What the gutter rests on: without the turn the neighbours would lie on the other side of the sphere."""
    padded = octahedral_directions(INNER, gutter=1)
    steps = [np.arccos(np.clip((a * b).sum(axis=0), -1.0, 1.0)) for a, b in (
        (padded[:, 1:], padded[:, :-1]), (padded[:, :, 1:], padded[:, :, :-1]))]
    assert max(float(s[..., 1:-1].max()) for s in (steps[0], steps[1].swapaxes(-1, -2))) < 5.0 / INNER
    wrong = np.pad(octahedral_directions(INNER), ((0, 0), (1, 1), (1, 1)), mode="wrap")
    assert np.arccos(np.clip((wrong[:, 1:] * wrong[:, :-1]).sum(axis=0), -1.0, 1.0)).max() > 1.0


def bilinear(values: np.ndarray, way: np.ndarray) -> float:
    """A lookup that finds each of the four texels by walking across the octahedron's edges."""
    size = len(values)
    u, v = fold(way)
    x, y = (u + 1.0) * size / 2.0 - 0.5, (v + 1.0) * size / 2.0 - 0.5
    column, row = math.floor(x), math.floor(y)
    total = 0.0
    for dy, wy in ((0, 1.0 - (y - row)), (1, y - row)):
        for dx, wx in ((0, 1.0 - (x - column)), (1, x - column)):
            total += wy * wx * values[neighbour(row + dy, column + dx, size)]
    return total


def border_ways() -> np.ndarray:
    """Directions on and about every edge and corner of the square, on the folds, and anywhere."""
    rng = np.random.default_rng(1)
    along = np.concatenate([rng.uniform(-1, 1, 40), [-1.0, 1.0, 0.0, 0.999, -0.999]])
    off = np.concatenate([rng.uniform(0.85, 1.0, 44), [1.0]])
    square = [(s * o, a) for s in (-1, 1) for o, a in zip(off, along, strict=True)]
    square += [(a, b) for b, a in square] + [(sx * 0.97, sy * 0.98) for sx in (-1, 1) for sy in (-1, 1)]
    folds = [(a, s * (1.0 - abs(a))) for a in along for s in (-1, 1)]
    ways = [unfold(u, v) for u, v in (*square, *folds)]
    return np.array(ways + [w / np.linalg.norm(w) for w in rng.normal(size=(100, 3))]).T


@pytest.mark.parametrize("size", [4, 16])
def test_lookups_across_edges_and_corners_are_those_of_the_true_neighbours(size: int) -> None:
    values = np.random.default_rng(2).uniform(0.1, 2.0, (size, size))
    see = lamp_sight(octahedral(values))
    ways = border_ways()
    got = -np.log(see(points_at(ways, 10.0)))
    want = [bilinear(values, way) for way in ways.T]
    np.testing.assert_allclose(got, want, atol=2e-12)


def test_without_a_gutter_they_are_not() -> None:
    values = np.random.default_rng(2).uniform(0.1, 2.0, (INNER, INNER))
    ways = border_ways()
    got = -np.log(lamp_sight(octahedral(values, gutter=0))(points_at(ways, 10.0)))
    assert np.abs(got - [bilinear(values, way) for way in ways.T]).max() > 0.3


@pytest.mark.parametrize("size", [16, 32, 64])
def test_no_seam_above_the_interpolation_error(size: int) -> None:
    """A smooth function: as exact across the edges as anywhere, and of order 2."""
    see = lamp_sight(octahedral(smooth(octahedral_directions(size))))
    ways = border_ways()
    error = np.abs(-np.log(see(points_at(ways, 10.0))) - smooth(ways))
    # Second derivatives of the function over the sphere are below 3; a texel is at most 3.5/size wide. Edges of
    # the octahedron are kinks of the map, where bilinear lookups are off by a texel's bend: of the same size.
    assert error.max() < 12.0 / size**2 * 3.0
    inside = np.abs(np.array([fold(way) for way in ways.T])).max(axis=1) < 1.0 - 2.0 / size
    assert error[~inside].max() < 3.0 * max(error[inside].max(), 1e-12)


def test_a_lookup_is_continuous_across_every_edge() -> None:
    values = np.random.default_rng(3).uniform(0.1, 2.0, (INNER, INNER))
    see = lamp_sight(octahedral(values))
    rng = np.random.default_rng(4)
    for _ in range(50):
        way = rng.normal(size=3)
        way /= np.linalg.norm(way)
        way[rng.integers(0, 3)] = 0.0 if rng.random() < 0.5 else 1e-9  # on the planes where the square folds or ends
        near = way + rng.normal(size=3) * 1e-9
        a, b = (see(points_at((w / np.linalg.norm(w))[:, None], 10.0))[0] for w in (way, near))
        assert abs(a - b) < 1e-6


# --- depths -----------------------------------------------------------------------------------------


@settings(max_examples=50, deadline=None)
@given(st.lists(st.tuples(st.floats(0, 1), st.floats(0, 6)), min_size=1, max_size=6), st.floats(0, 14),
       st.integers(0, 5))
def test_lamps_read_what_the_thesis_reads(layers: list[tuple[float, float]], distance: float, harmonics: int) -> None:
    depth, tau = (np.array(column) for column in zip(*layers, strict=True))
    coefficients = sample_coefficients(depth, tau, harmonics=harmonics)
    planes = np.broadcast_to(planes_of(coefficients)[:, None, None], (2 * harmonics + 2, 8, 8)).copy()
    planes[:, 0, 0] *= 1.0 + 1e-9  # so that texels differ, and the way of all lookups is taken
    see = lamp_sight(OpacityMap("octahedral", planes[None], np.full(1, 2.0), np.full(1, 12.0), RELATIVE, 1))
    way = np.array([[0.6], [0.64], [0.48]])
    got = float(see(points_at(way, distance))[0])
    d = min(max((distance - 2.0) / 10.0, 0.0), 1.0)
    assert got == pytest.approx(listing_3_17(coefficients[0], coefficients[1], d), abs=1e-12 * (1 + 20 * tau.sum()))


def test_a_map_that_is_the_same_everywhere_is_read_as_one_texel() -> None:
    planes = np.zeros((8, 8, 8))
    planes[0], planes[2], planes[5] = 1.5, 0.3, -0.2
    other = planes.copy()
    other[:, 3, 3] *= 1.0 + 4e-16
    ways = border_ways()
    for some in (planes, other):
        some[4] = 0.1
    alike, each = (lamp_sight(OpacityMap("octahedral", p[None], np.zeros(1), np.full(1, 9.0), RELATIVE, 1))(
        points_at(ways, np.linspace(0, 12, ways.shape[1]))) for p in (planes, other))
    np.testing.assert_allclose(alike, each, rtol=1e-14)


def test_an_empty_range_and_empty_maps_are_clear() -> None:
    planes = np.ones((1, 8, 8, 8))
    ways = border_ways()
    for near, far, some in ((0.0, 0.0, planes), (3.0, 3.0, planes), (0.0, 5.0, 0.0 * planes)):
        see = lamp_sight(OpacityMap("octahedral", some, np.full(1, near), np.full(1, far), RELATIVE, 1))
        assert np.all(see(points_at(ways, 4.0)) == 1.0)


@pytest.mark.parametrize("total", [0.0, 1e-30, 1e8, 1e30])
def test_what_passes_stays_within_0_and_1(total: float) -> None:
    rng = np.random.default_rng(5)
    planes = planes_of(sample_coefficients(rng.random((3, 8, 8)), np.full((3, 8, 8), total)))[None]
    ways = border_ways()
    for name in ("fourier", "lanczos"):
        see = lamp_sight(OpacityMap("octahedral", planes, np.zeros(1), np.full(1, 9.0), RELATIVE, 1),
                         reconstruction=name)
        got = see(points_at(ways, np.linspace(0, 10, ways.shape[1])))
        assert np.isfinite(got).all()
        assert got.min() >= 0.0
        assert got.max() <= 1.0


def test_at_the_light_itself_nothing_has_been_passed() -> None:
    values = np.random.default_rng(6).uniform(0.1, 2.0, (8, 8))
    assert float(lamp_sight(octahedral(values))(tuple(np.array([c]) for c in HERE))[0]) == 1.0


# --- spot lights ------------------------------------------------------------------------------------

SPOT = SpotLight(position=HERE, direction=(0.3, -0.9, -0.5), intensity=(1, 1, 1), outer_angle=40, inner_angle=20,
                 radius=10)


def spot_map(spot: str, values: np.ndarray, border: int) -> OpacityMap:
    planes = np.zeros((2, *values.shape))
    planes[0] = 2.0 * values
    return OpacityMap("spot", planes[None], np.zeros(1), np.full(1, 10.0),
                      raster_from_world(spot_view(SPOT, len(values), border=border))[None], border)


def cone_ways() -> np.ndarray:
    axis = np.array(SPOT.direction) / np.linalg.norm(SPOT.direction)
    ways = np.random.default_rng(7).normal(size=(4000, 3))
    ways /= np.linalg.norm(ways, axis=1)[:, None]
    return ways[ways @ axis > math.cos(math.radians(39.5))].T


@pytest.mark.parametrize("size", [32, 64])
def test_spot_lights_see_along_their_texels_rays(size: int) -> None:
    values = smooth(lamp_directions(SPOT, size, gutter=1))
    ways = cone_ways()
    got = -np.log(lamp_sight(spot_map("upright", values, 1))(points_at(ways, 10.0)))
    assert np.abs(got - smooth(ways)).max() < 20.0 / size**2


def test_the_authors_spot_lights_are_upside_down() -> None:
    """A3: written with +y up, looked up with +y down, no gutter."""
    size = 64
    values = smooth(lamp_directions(SPOT, size, gutter=1, spot="mirrored"))
    upright = smooth(lamp_directions(SPOT, size, gutter=0))
    assert np.array_equal(values, upright[::-1])
    ways = cone_ways()
    got = -np.log(lamp_sight(spot_map("mirrored", values, 0))(points_at(ways, 10.0)))
    assert np.abs(got - smooth(ways)).max() > 0.3


def test_the_authors_octahedra_hold_the_opposite_direction() -> None:
    """A9: written and read alike, so only the buffer differs."""
    lamp = PointLight(position=HERE, intensity=(1, 1, 1), radius=10)
    one, other = (lamp_directions(lamp, 18, gutter=1, octahedron=word) for word in ("from_light", "to_light"))
    assert np.array_equal(one, -other)
    ways = border_ways()
    seen = [lamp_sight(octahedral(smooth(w[:, 1:-1, 1:-1])), octahedron=word)(points_at(ways, 10.0))
            for word, w in (("from_light", one), ("to_light", other))]
    assert np.abs(np.log(seen[0]) - np.log(seen[1])).max() < 0.1


# --- suns -------------------------------------------------------------------------------------------

SUN = DirectionalLight(direction=(0.0, 1.0, 0.0), irradiance=(1, 1, 1))
GRID = Grid(near=0.5, far=20.0)
VIEW = opacity_cascades(SUN, Camera(), GRID, ShadowMaps(cascades=1), OpacityMaps(directional_size=32))[0]


def sun_map(near: np.ndarray, far: np.ndarray, tau: np.ndarray) -> OpacityMap:
    """Uniform extinction between each texel's ends."""
    zero, one = np.zeros((1, 32, 32)), np.ones((1, 32, 32))
    planes = planes_of(segment_coefficients(zero, one, tau[None]))
    return OpacityMap("directional", planes[None], near[None], far[None], raster_from_world(VIEW)[None], 1)


def texel_points(depth: np.ndarray | float) -> tuple[np.ndarray, ...]:
    """Points at the texels' centres, at a depth along their rays."""
    x, y = np.arange(32) + 0.5, (np.arange(32) + 0.5)[:, None]
    shift = np.asarray(depth)
    return tuple(np.broadcast_to(VIEW.base[c] + x * VIEW.across[c] + y * VIEW.down[c] + shift * VIEW.direction[c],
                                 (32, 32)) for c in range(3))


def test_each_texel_of_a_cascade_has_its_own_range() -> None:
    rng = np.random.default_rng(8)
    near, tau = rng.uniform(-5, 0, (32, 32)), rng.uniform(0.1, 3, (32, 32))
    far = near + rng.uniform(1, 5, (32, 32))
    see = cascade_sight(sun_map(near, far, tau))
    for t in (-6.0, -2.0, 0.0, 1.0, 6.0):
        want = np.exp(-tau * np.clip((t - near) / (far - near), 0, 1))
        np.testing.assert_allclose(see(texel_points(t))[2:-2, 2:-2], want[2:-2, 2:-2], rtol=1e-11)


def test_filtered_coefficients_of_different_ranges_have_no_mean() -> None:
    """S3: a step in the ranges, as at a medium's silhouette; between its texels only one of the two is right."""
    near = np.where(np.arange(32) < 16, -4.0, 0.0) * np.ones((32, 1))
    far, tau = near + 2.0, np.full((32, 32), 2.0)
    shift = 0.5 * VIEW.across  # half way between two texels
    at = tuple(c + s for c, s in zip(texel_points(-3.0), shift, strict=True))
    want = 0.5 * 1.0  # half way through it for the one texel, in front of it for the other
    for lookup, wrong in (("per_texel", False), ("filtered", True)):
        got = -math.log(cascade_sight(sun_map(near, far, tau), lookup=lookup)(at)[16, 15])
        assert (abs(got - want) > 0.3) == wrong


def test_texels_with_nothing_are_clear_and_outside_is_lit() -> None:
    nothing = np.zeros((32, 32))
    see = cascade_sight(sun_map(nothing, nothing, nothing))
    assert np.all(see(texel_points(3.0)) == 1.0)
    half = np.where(np.arange(32) < 16, 1.0, 0.0) * np.ones((32, 1))
    for lookup in ("per_texel", "filtered"):
        see = cascade_sight(sun_map(nothing, half, half), lookup=lookup)
        assert np.all(see(texel_points(3.0))[:, 17:] == 1.0)
        far_off = tuple(np.array([1e4 * (c == 0)]) for c in range(3))
        assert float(see(far_off)[0]) == 1.0


def test_a_points_first_cascade_counts() -> None:
    views = opacity_cascades(SUN, Camera(), GRID, ShadowMaps(cascades=3), OpacityMaps(directional_size=32))
    planes = np.zeros((3, 8, 32, 32))
    planes[:, 0] = 2.0 * np.array([1.0, 2.0, 4.0])[:, None, None]  # optical depth 1, 2, 4 at the far end
    ends = np.zeros((3, 32, 32)), np.full((3, 32, 32), 1e-3)
    see = cascade_sight(OpacityMap("directional", planes, *ends, np.stack([raster_from_world(v) for v in views]), 1))
    for view, tau in zip(views, (1.0, 2.0, 4.0), strict=True):
        middle = view.base + 16 * view.across + 16 * view.down + 5.0 * view.direction
        inside = [all(abs(step @ (middle - v.base) / (step @ step) - 16.0) < 0.97 * 15 for step in (v.across, v.down))
                  for v in views]
        first = inside.index(True)
        got = -math.log(see(tuple(np.array([c]) for c in middle))[0])
        assert got == pytest.approx((1.0, 2.0, 4.0)[first], rel=1e-12)
        assert first <= (1.0, 2.0, 4.0).index(tau)


# --- both -------------------------------------------------------------------------------------------


def test_product_and_smaller() -> None:
    """D16: eq. 2.13's product, and the smaller of the two in the thesis's program."""
    x = np.linspace(0, 1, 5)

    def opaque(points: tuple, normal: object = None) -> np.ndarray:
        return points[0]

    def media(points: tuple, normal: object = None) -> np.ndarray:
        return 1.0 - points[0]

    points = (x, x, x)
    np.testing.assert_array_equal(both_sights(opaque, media)(points), x * (1 - x))
    np.testing.assert_array_equal(both_sights(opaque, media, smaller=True)(points), np.minimum(x, 1 - x))
