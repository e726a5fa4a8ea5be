"""Shadow rasters: against scalar rationals, against exact visibility of points, and without a crack."""

from __future__ import annotations

import importlib.util
import itertools
from types import SimpleNamespace

import numpy as np
import pytest
import reference_shadow as reference
from data import data_file
from hypothesis import given, settings
from hypothesis import strategies as st
from test_triangles import ball

from froxel_ref.assets import read_mesh
from froxel_ref.geometry import Rays
from froxel_ref.light_raster import Projected
from froxel_ref.scene import (
    Box,
    DirectionalLight,
    Folds,
    HeightField,
    Mesh,
    Plane,
    PointLight,
    Sphere,
    Transform,
)
from froxel_ref.shadow_raster import LightRaster, casters, raster_depth, raster_rays
from froxel_ref.triangle_raster import raster_triangles
from froxel_ref.triangles import hit_mesh, mesh_caster
from froxel_ref.visibility import exact_visibility, occluders

INF = np.inf
X, Y, Z = np.eye(3)
seeds = st.integers(0, 2**32 - 1)
rational = settings(max_examples=25)  # exact arithmetic over every triangle takes its time
kinds = pytest.mark.parametrize("parallel", [False, True], ids=["lamp", "sun"])
names = pytest.mark.parametrize("name", ["plane", "box", "sphere", "height field", "mesh"])
needs_embree = pytest.mark.skipif(importlib.util.find_spec("embreex") is None,
                                  reason="embreex is not installed (the extra 'mesh')")


def lamp(origin, middle, across, down, rows, columns):
    """A raster from a point whose image is centred on a direction."""
    base = np.asarray(middle) - 0.5 * columns * across - 0.5 * rows * down
    return LightRaster(base, across, down, np.asarray(origin, np.float64), None, rows, columns)


def sun(direction, middle, across, down, rows, columns):
    return lamp(np.zeros(3), middle, across, down, rows, columns)._replace(
        origin=None, direction=np.asarray(direction, np.float64))


def cube(origin, size):
    """Rasters of the six faces of a cube around a lamp."""
    e = np.eye(3)
    return [lamp(origin, side * e[k], e[(k + 1) % 3] * 2 / size, e[(k + 2) % 3] * 2 / size, size, size)
            for k in range(3) for side in (-1, 1)]


def turned(rng):
    """Three directions at right angles."""
    return np.linalg.qr(rng.normal(size=(3, 3)))[0]


def random_raster(rng, parallel, rows=5, columns=6, distance=4.0):
    """Rays that pass near the world's origin, or not, from any side."""
    a, b, c = turned(rng)
    size = rng.uniform(0.5, 2.5) / columns
    if parallel:
        return sun(c, rng.normal(size=3), a * size * 2, b * size * 2, rows, columns)
    origin = rng.normal(size=3) * rng.uniform(0.1, distance)
    aim = -origin / np.linalg.norm(origin) + 0.3 * rng.normal(size=3) if rng.random() < 0.7 else c
    return lamp(origin, aim, a * size, b * size, rows, columns)


def random_transform(rng):
    return Transform(translate=tuple(rng.normal(size=3) * 0.5), rotate=tuple(rng.uniform(0, 360, 3)),
                     scale=tuple(rng.uniform(0.3, 1.5, 3)))


def random_surface(rng, name):
    """A surface near the world's origin, the assets that it needs, and its triangles."""
    heights = rng.normal(size=(3, 4)) * 0.4
    vertices, faces = ball(1)
    vertices = vertices * rng.uniform(0.6, 1.2, (len(vertices), 1))
    surface = {
        "plane": lambda: Plane(point=tuple(rng.normal(size=3)), normal=tuple(rng.normal(size=3))),
        "sphere": lambda: Sphere(center=tuple(rng.normal(size=3) * 0.5), radius=rng.uniform(0.2, 1.5)),
        "box": lambda: Box(transform=random_transform(rng)),
        "height field": lambda: HeightField(heights=Folds(), transform=random_transform(rng)),
        "mesh": lambda: Mesh(path="ball.obj", transform=random_transform(rng)),
    }[name]()
    assets = SimpleNamespace(heights={Folds(): heights}, meshes={surface: (vertices, faces)})
    sheet = reference.triangles(surface, heights, (vertices, faces)) if name in ("height field", "mesh") else ()
    return surface, assets, sheet


def field(heights, **transform):
    """A height field made ready."""
    surface = HeightField(heights=Folds(), transform=Transform(**transform))
    return casters([surface], SimpleNamespace(heights={Folds(): np.asarray(heights, np.float64)}, meshes={}))


def body(vertices, faces, **transform):
    """A mesh made ready."""
    surface = Mesh(path="body.obj", transform=Transform(**transform))
    return casters([surface], SimpleNamespace(heights={}, meshes={surface: (np.asarray(vertices), faces)}))


# --- rays -------------------------------------------------------------------------------------------


@kinds
def test_rays_go_through_the_texels_centres(parallel):
    raster = random_raster(np.random.default_rng(1), parallel, rows=3, columns=4)
    origins, directions = (np.broadcast_to(part, (3, 3, 4)) for part in raster_rays(raster))
    for i, j in np.ndindex(3, 4):
        origin, direction = reference.ray(raster, i, j)
        np.testing.assert_allclose(origins[:, i, j], [float(c) for c in origin], rtol=1e-14, atol=1e-14)
        np.testing.assert_allclose(directions[:, i, j], [float(c) for c in direction], rtol=1e-14, atol=1e-14)


# --- by hand ----------------------------------------------------------------------------------------

# A lamp 4 m above the origin looks down, at one metre below it 2 x 3 texels of ½ m; a sun from above has its
# texels of ½ m at a height of 10 m.
ABOVE = LightRaster(-0.75 * X - 0.5 * Y - Z, 0.5 * X, 0.5 * Y, 4.0 * Z, None, 2, 3)
NOON = LightRaster(-0.75 * X - 0.5 * Y + 10.0 * Z, 0.5 * X, 0.5 * Y, None, -Z, 2, 3)
SLOPE = [[-1.0, 1.0], [-1.0, 1.0]]  # h = x
TRIANGLE = (np.array([[-1.0, -1.0, 0.0], [2.0, -1.0, 0.0], [-1.0, 2.0, 0.0]]), np.array([[0, 1, 2]]))


def test_plane_by_hand():
    """A floor at 1 m; a wall at x = ¼, which rays of the last column meet; from below nothing."""
    floor, wall = casters([Plane(point=(5, 5, 1), normal=(0, 0, -2)), Plane(point=(0.25, 0, 0), normal=(1, 0, 0))],
                          None)
    assert raster_depth([floor], ABOVE).tolist() == [[3.0] * 3] * 2
    assert raster_depth([floor], NOON).tolist() == [[9.0] * 3] * 2
    assert raster_depth([wall], ABOVE).tolist() == [[INF, INF, 0.5]] * 2
    assert raster_depth([wall], NOON).tolist() == [[INF] * 3] * 2
    assert raster_depth([wall, floor], ABOVE).tolist() == [[3.0, 3.0, 0.5]] * 2
    assert raster_depth([floor], ABOVE._replace(base=ABOVE.base + 2 * Z)).tolist() == [[INF] * 3] * 2
    # Parallel rays have no beginning: a plane behind their base is met, too.
    assert raster_depth([floor], NOON._replace(base=NOON.base - 20 * Z)).tolist() == [[-11.0] * 3] * 2


def test_box_by_hand():
    """From 0 to 2 m height, |x| ≤ ⅜, |y| ≤ 1: the middle column meets its top, the others pass it by."""
    box = casters([Box(transform=Transform(translate=(0, 0, 1), scale=(0.375, 1, 1)))], None)
    assert raster_depth(box, ABOVE).tolist() == [[INF, 2.0, INF]] * 2
    assert raster_depth(box, NOON).tolist() == [[INF, 8.0, INF]] * 2
    # Seen along x from (-4, 0, 1), through texels at z ± ¼ and y ∓ ½: the side, 3⅝ m away.
    side = LightRaster(X - Y - 0.5 * Z, Y, 0.5 * Z, np.array([-4.0, 0.0, 1.0]), None, 2, 2)
    np.testing.assert_allclose(raster_depth(box, side), [[INF, INF]] * 2)
    assert raster_depth(box, side._replace(across=0.25 * Y, base=X - 0.25 * Y - 0.5 * Z)).tolist() == [[3.625] * 2] * 2


def test_sphere_by_hand():
    """r = 1 about (0, ¼, 1): the sun straight above it meets it 8 m down, at ½ m from its axis √¾ m up."""
    ball_ = casters([Sphere(center=(0, 0.25, 1), radius=1)], None)
    edge, far = 9 - np.sqrt(0.75), 9 - np.sqrt(0.5)
    np.testing.assert_allclose(raster_depth(ball_, NOON), [[far, edge, far], [9 - np.sqrt(0.75), 8, edge]], rtol=1e-15)
    straight = lamp((0, 0.25, 4), -Z, 0.75 * X, Y, 1, 3)
    # At ¾ per metre the ray is t·(¾, 0, −1) − (0, 0, −3): (25/16)t² − 6t + 8 has no root.
    assert raster_depth(ball_, straight).tolist() == [[INF, 2.0, INF]]
    # At ¼ per metre: (17/16)t² − 6t + 8 = 0.
    t = (3 - np.sqrt(0.5)) * 16 / 17
    beside = straight._replace(base=straight.base + 0.25 * X)
    assert raster_depth(ball_, beside)[0, 1] == pytest.approx(t, rel=1e-15)


def test_height_field_by_hand():
    """z = x over [−2, 2]²: below the lamp t = 4/(1 + u) at u across per metre; below the sun 10 − x."""
    for heights in (SLOPE, np.tile(np.linspace(-1, 1, 3), (4, 1))):
        ready = field(heights, scale=(2.0, 2.0, 2.0))
        depth = raster_depth(ready, ABOVE)
        # The columns are at u = −½, 0, ½; the first would meet the plane at x = −4, beyond the field.
        np.testing.assert_allclose(depth, [[INF, 4.0, 4 / 1.5]] * 2, rtol=1e-15)
        np.testing.assert_allclose(raster_depth(ready, NOON), [[10.5, 10.0, 9.5]] * 2, rtol=1e-15)


def test_mesh_by_hand():
    """A triangle on the ground, x, y ≥ −1 and x + y ≤ 1, both of its sides, and one more that is nearer."""
    # At 4 m the texels are at x = −2, 0, 2 and y = ∓1; a border belongs to the triangle.
    assert raster_depth(body(*TRIANGLE), ABOVE).tolist() == [[INF, 4.0, 4.0], [INF, 4.0, INF]]
    below = LightRaster(ABOVE.base + 2 * Z, ABOVE.across, ABOVE.down, -ABOVE.origin, None, 2, 3)
    assert raster_depth(body(*TRIANGLE), below).tolist() == [[INF, 4.0, 4.0], [INF, 4.0, INF]]
    assert raster_depth(body(*TRIANGLE), NOON).tolist() == [[10.0] * 3] * 2
    nearer = (np.concatenate([TRIANGLE[0], TRIANGLE[0] + Z]), np.array([[0, 1, 2], [5, 4, 3]]))
    assert raster_depth(body(*nearer), NOON).tolist() == [[9.0] * 3] * 2


def test_rows_run_along_down_and_columns_along_across():
    image = raster_depth(casters([Sphere(center=(0.5, 0.25, 0), radius=0.1)], None), NOON)
    assert np.argwhere(np.isfinite(image)).tolist() == [[1, 2]]


def test_without_surfaces_nothing_is_hit():
    for raster, dtype in itertools.product((ABOVE, NOON), (np.float64, np.float32)):
        depth = raster_depth([], raster, dtype=dtype)
        assert depth.dtype == dtype
        assert depth.tolist() == [[INF] * 3] * 2


# --- against scalars --------------------------------------------------------------------------------


@kinds
@names
@rational
@given(seeds)
def test_depth_agrees_with_scalar_geometry(name, parallel, seed):
    """Seeds are generic: no ray passes an edge within the rounding that could turn a hit into a miss."""
    rng = np.random.default_rng(seed)
    surface, assets, sheet = random_surface(rng, name)
    raster = random_raster(rng, parallel, rows=4, columns=5)
    depth = raster_depth(casters([surface], assets), raster)
    expected = [[reference.first_hit(surface, raster, i, j, sheet) for j in range(5)] for i in range(4)]
    np.testing.assert_allclose(depth, expected, rtol=2e-11, atol=1e-12 if parallel else 0.0)


@kinds
@given(seeds)
def test_the_first_of_many_surfaces_counts(parallel, seed):
    rng = np.random.default_rng(seed)
    many = [random_surface(rng, name) for name in ("box", "sphere", "height field", "plane", "box", "mesh")]
    ready = [caster for surface, assets, _ in many for caster in casters([surface], assets)]
    raster = random_raster(rng, parallel)
    alone = np.stack([raster_depth([caster], raster) for caster in ready])
    order = rng.permutation(len(ready))
    together = raster_depth([ready[k] for k in order], raster)
    np.testing.assert_array_equal(together, alone.min(axis=0))


# --- against exact visibility -----------------------------------------------------------------------


def assert_dark_behind(surface, assets, raster, near=1e-6, share=1.0):
    """Points of the rays just before and behind the hits, and anywhere: dark where t is beyond the depth."""
    rng = np.random.default_rng(0)
    depth = raster_depth(casters([surface], assets), raster)
    assert not np.isnan(depth).any()
    parallel = raster.origin is None
    light = (DirectionalLight(direction=tuple(-raster.direction), irradiance=(1, 1, 1)) if parallel
             else PointLight(position=tuple(raster.origin), intensity=(1, 1, 1)))
    sees = exact_visibility(occluders([surface], assets), [light])[0]
    origins, directions = raster_rays(raster)
    step = near if parallel else near * depth
    hit = np.isfinite(depth) & (parallel | (depth > 0.0))
    finite = np.where(hit, depth, 1.0)
    for t in (np.where(hit, finite - step, 1.0), np.where(hit, finite + step, 1.0),
              rng.uniform(-9.0 if parallel else 0.0, 9.0, depth.shape)):
        x, y, z = origins + t * directions
        seen = sees((x, y, z)) > 0
        clear = np.abs(t - depth) > 0.5 * np.where(hit, step, 1e-9)
        wrong = clear & (seen != (t <= depth))
        assert wrong.mean() <= 1.0 - share
    return depth


@needs_embree
@kinds
@names
@given(seeds)
def test_points_behind_the_depth_are_dark_and_no_others(name, parallel, seed):
    """Of meshes Embree decides in float32: a few rays at their edges may differ."""
    rng = np.random.default_rng(seed)
    surface, assets, _ = random_surface(rng, name)
    raster = random_raster(rng, parallel, rows=16, columns=16)
    mesh = name == "mesh"
    assert_dark_behind(surface, assets, raster, near=1e-4 if mesh else 2e-6, share=0.99 if mesh else 1.0)


@pytest.mark.parametrize("surface", [Box(transform=Transform(rotate=(10, 20, 30), scale=(1, 2, 0.5))),
                                     Sphere(center=(0.3, 0, 0), radius=1)], ids=["box", "sphere"])
def test_a_lamp_within_a_solid_lights_nothing(surface):
    for raster in cube((0.2, 0.1, -0.1), 4):
        assert raster_depth(casters([surface], None), raster).tolist() == [[0.0] * 4] * 4
        assert assert_dark_behind(surface, None, raster).max() == 0.0


@pytest.mark.parametrize("origin", [(1, 0.2, 0.1), (-0.3, 1, 0.6), (1, 1, 0.25), (1, -1, 1)],
                         ids=["face", "another face", "edge", "corner"])
def test_a_lamp_on_a_box_lights_what_is_outside(origin):
    """Rays into the box are dark from the start, all others are not touched by it."""
    for raster in cube(origin, 6):
        depth = assert_dark_behind(Box(), None, raster)
        _, directions = raster_rays(raster)
        on = np.abs(origin) == 1
        inward = (directions[on] * np.asarray(origin)[on][:, np.newaxis, np.newaxis] < 0).all(axis=0)
        np.testing.assert_array_equal(depth, np.where(inward, 0.0, INF))


@pytest.mark.parametrize("gap", [1e-6, 1e-9, 1e-12])
def test_a_lamp_a_hair_off_a_wall_is_not_on_it(gap):
    """Inside all is dark; outside the wall is as near as it is."""
    for solid in (Box(), Sphere()):
        ready = casters([solid], None)
        for raster in cube((1.0 - gap, 0.0, 0.0), 3):
            assert raster_depth(ready, raster).max() == 0.0
        towards = raster_depth(ready, cube((1.0 + gap, 0.0, 0.0), 3)[0])
        assert towards[1, 1] == pytest.approx(gap, rel=1e-3)


def test_a_lamp_on_a_turned_box_or_a_sphere_lights_what_is_outside():
    """Where rounding decides whether the lamp is inside: never all dark, half the rays free."""
    rng = np.random.default_rng(3)
    for _ in range(20):
        transform = random_transform(rng)
        pose = transform.world_from_local
        on_face = pose[:3, :3] @ (1.0, *rng.uniform(-0.9, 0.9, 2)) + pose[:3, 3]
        radius, up = rng.uniform(0.1, 3.0), turned(rng)[0]
        center = rng.normal(size=3)
        for surface, origin in ((Box(transform=transform), on_face),
                                (Sphere(center=tuple(center), radius=radius), center + radius * up)):
            depth = np.stack([raster_depth(casters([surface], None), raster) for raster in cube(origin, 16)])
            # Of a cube's texels exactly half lie on each side of any plane through the middle.
            assert np.isinf(depth).sum() == depth.size // 2
            assert depth[np.isfinite(depth)].max() < 1e-12


def test_a_light_in_the_plane_of_a_sheet_is_not_hidden_by_it():
    """The plane turned by anything, too, where the lamp's height above it is rounding."""
    rng = np.random.default_rng(4)
    flat = field(np.zeros((3, 3)))
    low = [sun(X, (0, 0, 0), Y / 4, Z / 4, size, size) for size in (7, 8)]
    for raster in (*cube((0.25, 0.5, 0.0), 8), *low):
        assert np.isinf(raster_depth(casters([Plane(point=(3, 3, 0), normal=(0, 0, 1))], None), raster)).all()
        assert np.isinf(raster_depth(flat, raster)).all()
        assert np.isinf(raster_depth(body(*TRIANGLE), raster)).all()
    for _ in range(50):
        normal, a, b = turned(rng)
        point = rng.normal(size=3)
        origin = point + a * rng.normal() + b * rng.normal()
        plane = casters([Plane(point=tuple(point), normal=tuple(normal))], None)
        for raster in (*cube(origin, 2), sun(a, point, b, normal, 3, 3)):
            assert np.isinf(raster_depth(plane, raster)).all()


@given(seeds)
def test_rays_parallel_to_the_faces_of_a_box(seed):
    """Along an edge of the box, exactly or within rounding; beside it and through it."""
    rng = np.random.default_rng(seed)
    turn = (0.0, 0.0, 0.0) if seed % 2 else tuple(rng.uniform(0, 360, 3))
    place, size = tuple(rng.normal(size=3)), tuple(rng.uniform(0.5, 2, 3))
    box = Box(transform=Transform(translate=place, rotate=turn, scale=size))
    pose = box.transform.world_from_local
    edges = [pose[:3, k] / np.linalg.norm(pose[:3, k]) for k in range(3)]
    k = rng.integers(3)
    raster = sun(edges[k], pose[:3, 3] + rng.normal(size=3), edges[k - 1] * 0.67, edges[k - 2] * 0.71, 4, 5)
    depth = assert_dark_behind(box, None, raster)
    expected = [[reference.first_hit(box, raster, i, j) for j in range(5)] for i in range(4)]
    np.testing.assert_allclose(depth, expected, rtol=1e-12, atol=1e-12)


# --- restriction, types, places to write ------------------------------------------------------------


@kinds
@given(seeds)
def test_restriction_does_not_change_a_bit(parallel, seed):
    rng = np.random.default_rng(seed)
    many = [random_surface(rng, name) for name in ("box", "sphere", "height field", "plane", "mesh")]
    origin = rng.normal(size=3) * rng.choice([0.3, 1.0, 5.0])
    rasters = [random_raster(rng, True, rows=60, columns=70)] if parallel else cube(origin, 40)
    for (surface, assets, _), raster in itertools.product(many, rasters):
        ready = casters([surface], assets)
        assert raster_depth(ready, raster).tobytes() == raster_depth(ready, raster, restrict=False).tobytes()


def test_restriction_of_triangles_of_every_size():
    """A grid of 2 to 40,000 texels a triangle, seen from near, along itself and from afar."""
    ready = field(np.random.default_rng(2).normal(size=(5, 6)) * 0.1)
    for origin, size in itertools.product([(0.1, 0.2, 0.3), (0.5, 0.0, 0.02), (0, -3, 0.01), (2, 3, 20)], (32, 300)):
        for raster in cube(origin, size):
            depth = raster_depth(ready, raster)
            assert depth.tobytes() == raster_depth(ready, raster, restrict=False).tobytes()


@kinds
@given(seeds)
def test_float32_is_rounded_once(parallel, seed):
    rng = np.random.default_rng(seed)
    many = [random_surface(rng, name) for name in ("box", "sphere", "height field", "mesh")]
    ready = [caster for surface, assets, _ in many for caster in casters([surface], assets)]
    raster = random_raster(rng, parallel, rows=20, columns=20)
    depth, single = (raster_depth(ready, raster, dtype=dtype) for dtype in (np.float64, np.float32))
    assert single.dtype == np.float32
    np.testing.assert_array_equal(single, depth.astype(np.float32))


def test_a_depth_beyond_float32_is_infinite():
    far = casters([Plane(point=(0, 0, -1e10), normal=(0, 0, 1))], None)
    raster = ABOVE._replace(base=ABOVE.base * 1e-30, across=ABOVE.across * 1e-30, down=ABOVE.down * 1e-30)
    assert raster_depth(far, raster).max() == pytest.approx(1e40)
    assert np.isinf(raster_depth(far, raster, dtype=np.float32)).all()


def test_out_is_filled_wherever_it_lies():
    """Also a part of a larger image, and rows the other way round; what lies beside it stays."""
    ready = [*casters([Sphere(radius=0.5)], None), *body(*TRIANGLE)]
    expected = raster_depth(ready, NOON)
    assert np.unique(expected).size == 2  # both are seen
    atlas = np.full((6, 8), 7.0)
    assert raster_depth(ready, NOON, out=atlas[1:3, 2:5]).base is atlas
    np.testing.assert_array_equal(atlas[1:3, 2:5], expected)
    assert (atlas == 7.0).sum() == 48 - 6
    single = np.empty((2, 3), np.float32)
    assert raster_depth(ready, NOON, out=single) is single
    np.testing.assert_array_equal(single, expected.astype(np.float32))
    raster_depth(ready, NOON, out=atlas[3:1:-1, 2:5])
    np.testing.assert_array_equal(atlas[3:1:-1, 2:5], expected)


def test_faults_are_named():
    with pytest.raises(ValueError, match=r"out has the shape \(3, 2\), must have the raster's \(2, 3\)"):
        raster_depth([], ABOVE, out=np.empty((3, 2)))
    with pytest.raises(ValueError, match="lie in a plane"):
        raster_depth(casters([Sphere()], None), ABOVE._replace(down=2.0 * ABOVE.across))


# --- no cracks --------------------------------------------------------------------------------------


@pytest.mark.parametrize("origin", [(0.1, 0.2, 0.3), (0.0, 0.0, 0.0), (0.7, -0.4, 0.1)])
def test_no_ray_leaves_a_closed_mesh(origin):
    """101,400 rays from within: all stop, between the sphere inscribed in the faces and that of the corners."""
    vertices, faces = ball(4)
    ready = body(vertices, faces)
    normals = np.cross(vertices[faces[:, 1]] - vertices[faces[:, 0]], vertices[faces[:, 2]] - vertices[faces[:, 0]])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    inner = np.abs((normals * vertices[faces[:, 0]]).sum(axis=1)).min()
    for raster in cube(origin, 130):
        depth = raster_depth(ready, raster)
        assert np.isfinite(depth).all()
        start, direction = raster_rays(raster)
        radius = np.linalg.norm(start + depth * direction, axis=0)
        assert inner - 1e-12 <= radius.min()
        assert radius.max() <= 1.0 + 1e-12


@kinds
def test_no_ray_enters_a_closed_mesh_unseen(parallel):
    """From outside: whatever meets a sphere that fits inside has been stopped before it."""
    rng = np.random.default_rng(6)
    vertices, faces = ball(4)
    count = 0
    for _ in range(12):
        a, b, c = turned(rng)
        raster = (sun(c, 3 * rng.normal() * c, a / 60, b / 60, 120, 120) if parallel else
                  lamp(-3 * c, c + 0.1 * a, a / 200, b / 200, 120, 120))
        depth = raster_depth(body(vertices, faces), raster)
        inside = raster_depth(casters([Sphere(radius=0.98)], None), raster)
        met = np.isfinite(inside)
        assert (depth[met] < inside[met]).all()
        count += met.sum()
    assert count > 1e5


def aimed(origin, point, parallel, rng):
    """One ray through a point, as well as rounding allows."""
    a, b, _ = turned(rng)
    if parallel:
        direction = (point - origin) / np.linalg.norm(point - origin)
        raster = sun(direction, point - 3 * direction, a, b, 1, 1)
        return raster._replace(base=point - 3 * direction - 0.5 * a - 0.5 * b)
    return lamp(origin, point - origin, a * 0.1, b * 0.1, 1, 1)


@kinds
@pytest.mark.parametrize("share", [0.0, 0.5, 0.3], ids=["vertices", "middles of edges", "edges"])
def test_no_ray_slips_through_what_triangles_share(share, parallel):
    """One ray at a time, straight at a vertex or at a point of an edge: it stops there or before."""
    rng = np.random.default_rng(8)
    vertices, faces = ball(2)
    ready = body(vertices, faces)
    for origin in ((0.1, 0.2, 0.3), (0.0, 0.0, 0.0)):
        for face in faces:
            point = vertices[face[0]] * (1 - share) + vertices[face[1]] * share
            depth = raster_depth(ready, aimed(np.asarray(origin), point, parallel, rng))[0, 0]
            if parallel:  # the line also crosses the body's other wall, before the point
                assert depth <= 3.0 + 1e-9
            else:
                assert depth == pytest.approx(1.0, rel=1e-12)


@pytest.mark.parametrize("offset", [0.0, 0.5], ids=["between", "on"])
def test_no_ray_slips_between_triangles_of_a_height_field(offset):
    """Texel centres on grid lines, on vertices and on diagonals, exactly: every ray within the border hits."""
    rng = np.random.default_rng(9)
    heights = rng.integers(-8, 8, (9, 9)) / 64
    step = 1 / 32
    raster = sun(-Z, (0, 0, 2), X * step, Y * step, 60, 60)
    raster = raster._replace(base=np.array([-1 + 2 * step - offset * step, -1 + 2 * step - offset * step, 2.0]))
    depth = raster_depth(field(heights), raster)
    assert np.isfinite(depth).all()
    assert (np.abs(depth - 2.0) <= 0.125).all()
    if offset:
        # Vertices are 8 texels apart: the first inner one is 6 texels from the first texel.
        np.testing.assert_array_equal(depth[6::8, 6::8], 2.0 - heights[1:-1, 1:-1])


@given(seeds)
def test_no_ray_slips_through_a_turned_height_field(seed):
    """A lamp beneath the middle of a field, wherever it is in the world: all rays at its inner part hit."""
    rng = np.random.default_rng(seed)
    transform = random_transform(rng)
    pose = transform.world_from_local
    heights = rng.normal(size=(12, 17)) * 0.02
    surface = HeightField(heights=Folds(), transform=transform)
    ready = casters([surface], SimpleNamespace(heights={Folds(): heights}, meshes={}))
    e, origin = pose[:3, :3].T, pose[:3, :3] @ (0.05, -0.1, -0.6) + pose[:3, 3]
    raster = lamp(origin, e[2], e[0] / 40, e[1] / 40, 100, 100)
    depth = raster_depth(ready, raster)
    # In local units the field is 0.6 away, give or take its heights: t counts lengths of the local z axis.
    assert (np.abs(depth - 0.6) < 0.12).all()


def test_vertices_that_a_file_repeats_do_not_open_the_mesh():
    """Every triangle with corners of its own, as files write them that split their seams."""
    vertices, faces = ball(3)
    split = vertices[faces].reshape(-1, 3)
    turn = {"rotate": (20.0, 50.0, 70.0), "translate": (0.3, 0.1, -0.2)}
    for raster in cube((0.35, 0.1, -0.1), 64):
        whole = raster_depth(body(vertices, faces, **turn), raster)
        assert np.isfinite(whole).all()
        apart = raster_depth(body(split, np.arange(len(split)).reshape(-1, 3), **turn), raster)
        assert apart.tobytes() == whole.tobytes()


def test_triangles_that_vanish_are_not_hit():
    """Corners that coincide or lie on a line, and a sheet seen exactly edge on."""
    line = np.array([[0.0, 0.0, 0.0], [0.25, 0.0, 0.0], [0.5, 0.0, 0.0]])
    for corners in (np.zeros((3, 3)), line[[0, 0, 2]], line):
        for raster in (ABOVE, NOON, sun(-Z, (0, 0, 9), X / 4, Y / 4, 9, 9)):
            assert np.isinf(raster_depth(body(corners, np.array([[0, 1, 2]])), raster)).all()
    upright = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    assert np.isinf(raster_depth(body(upright, np.array([[0, 1, 2]])), sun(-Z, (0, 0, 9), X / 4, Y / 4, 9, 9))).all()


def test_a_ray_in_the_plane_of_a_triangle_does_not_meet_it_beside_it():
    """Edge on, the products are rounding: it is passed by all the same, with and without its rectangle."""
    rng = np.random.default_rng(10)
    triangle = np.array([[1.0, 1.0], [2.0, 1.5], [1.5, 2.5]])
    for _ in range(500):
        a, b, _ = turned(rng)
        corners = triangle[:, :1] * a + triangle[:, 1:] * b
        raster = aimed(-rng.random() * a, 3.0 * a + 0.1 * rng.normal() * b, parallel=False, rng=rng)
        for corner, restrict in itertools.product((corners, corners - 1.5 * a), (True, False)):
            assert np.isinf(raster_depth(body(corner, np.array([[0, 1, 2]])), raster, restrict=restrict)).all()


@kinds
def test_a_triangle_across_the_rays_has_the_depth_of_its_corners(parallel):
    """To the last bit, although the shares of the corners are rounded."""
    rng = np.random.default_rng(11)
    for depth in (0.1, 0.7, 1.3):
        shape = np.concatenate([rng.uniform(-1, 1, (3, 2)), np.full((3, 1), -depth)], axis=1)
        raster = (sun(-Z, (0, 0, 0), X / 40, Y / 40, 80, 80) if parallel else
                  lamp((0, 0, 0), -Z, X / 20, Y / 20, 80, 80))
        found = raster_depth(body(shape, np.array([[0, 1, 2]])), raster)
        assert np.isfinite(found).sum() > 20
        assert set(found[np.isfinite(found)].tolist()) == {depth}


@given(seeds)
def test_corners_within_rounding_of_a_texels_centre(seed):
    """The rectangle is exact: corners on centres, or an ulp beside them, at any depth."""
    rng = np.random.default_rng(seed)
    weight = rng.uniform(0.1, 10.0, (3, 40))
    x, y = ((rng.integers(0, 12, (3, 40)) + 0.5) * weight for _ in range(2))
    x, y = (np.nextafter(v, v + rng.integers(-1, 2, v.shape)) for v in (x, y))
    vertices = Projected(*(v.reshape(-1) for v in (weight, weight, x, y, weight)), (1e-15, 1e-15, 1e-15))
    for face in np.arange(120).reshape(3, 40).T:
        image, whole = np.full((2, 12, 12), INF)
        raster_triangles(image, vertices, face[np.newaxis], forward=True)
        raster_triangles(whole, vertices, face[np.newaxis], forward=True, restrict=False)
        assert image.tobytes() == whole.tobytes()


def test_triangles_around_and_behind_the_lamp():
    """A floor of two triangles that reaches 100 m to all sides, 1 m below the lamp: as the plane."""
    floor = field(np.zeros((2, 2)), scale=(100.0, 100.0, 1.0))
    ground = casters([Plane(normal=(0, 0, 1))], None)
    for raster in cube((0.3, 0.2, 1.0), 50):
        depth, plane = raster_depth(floor, raster), raster_depth(ground, raster)
        # All faces but the one that looks up see the ground, those to the sides with their lower half.
        assert np.isfinite(plane).mean() == {-1.0: 1.0, 1.0: 0.0}.get(raster.base[2] + 25.5 * raster.down[2]
                                                                      + 25.5 * raster.across[2], 0.5)
        np.testing.assert_allclose(depth[plane < 90], plane[plane < 90], rtol=1e-13)
        assert np.isinf(depth[np.isinf(plane)]).all()


# --- sizes ------------------------------------------------------------------------------------------


def scaled(surface, factor):
    def times(vector):
        return tuple(factor * c for c in vector)
    if isinstance(surface, Plane):
        return Plane(point=times(surface.point), normal=surface.normal)
    if isinstance(surface, Sphere):
        return Sphere(center=times(surface.center), radius=factor * surface.radius)
    old = surface.transform
    transform = Transform(translate=times(old.translate), rotate=old.rotate, scale=times(old.scale))
    return (Box(transform=transform) if isinstance(surface, Box) else
            HeightField(heights=Folds(), transform=transform) if isinstance(surface, HeightField) else
            Mesh(path="ball.obj", transform=transform))


@kinds
@names
@pytest.mark.parametrize("factor", [2.0**-20, 2.0**20, 1e-6, 1e6])
@settings(max_examples=20)
@given(seeds)
def test_any_scale_gives_the_same_picture(name, parallel, factor, seed):
    """To the last bit for powers of two."""
    rng = np.random.default_rng(seed)
    surface, assets, _ = random_surface(rng, name)
    raster = random_raster(rng, parallel)
    larger = scaled(surface, factor)
    (mesh,) = assets.meshes.values()
    depth = raster_depth(casters([surface], assets), raster)
    moved = raster._replace(base=raster.base * factor, across=raster.across * factor, down=raster.down * factor)
    if parallel:
        expected = depth * factor
    else:  # t counts lengths of the base, which grows along
        moved, expected = moved._replace(origin=raster.origin * factor), depth
    found = raster_depth(casters([larger], SimpleNamespace(heights=assets.heights, meshes={larger: mesh})), moved)
    if np.log2(factor) % 1:
        np.testing.assert_allclose(found, expected, rtol=1e-10, atol=1e-12 * factor if parallel else 0)
    else:
        np.testing.assert_array_equal(found, expected)


# --- a real mesh ------------------------------------------------------------------------------------


@needs_embree
@kinds
def test_real_mesh_agrees_with_the_cast_of_rays(parallel):
    """Embree chooses in float32: a few rays in a thousand meet another triangle at an edge."""
    vertices, faces = read_mesh(data_file("stanford-bunny.obj"))
    size = 0.2 / 128
    raster = (sun(-Z, (-0.02, 0.1, 0.3), X * size, -Y * size, 128, 128) if parallel else
              lamp((-0.02, 0.1, 0.3), -Z, X * size * 3, -Y * size * 3, 128, 128))
    depth = raster_depth(body(vertices, faces), raster)
    origins, directions = raster_rays(raster)
    triangles, caster = vertices[faces], mesh_caster(vertices, faces)
    if parallel:
        chosen = caster(np.broadcast_to(origins, (3, 128, 128)).reshape(3, -1).T,
                        np.broadcast_to(directions, (3, 128, 128)).reshape(3, -1).T).reshape(128, 128)
        normal = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
        with np.errstate(all="ignore"):
            plane = ((triangles[chosen, 0] - origins.transpose(1, 2, 0)) * normal[chosen]).sum(axis=-1)
            expected = np.where(chosen >= 0, plane / -normal[chosen, 2], INF)
    else:
        x, y, z = (np.broadcast_to(d, (128, 128)) for d in directions)
        rays = Rays(tuple(raster.origin), (x, y, z), np.linalg.norm(directions, axis=0))
        expected = hit_mesh(rays, triangles, caster)[0]
    hit = np.isfinite(depth)
    assert 0.2 < hit.mean() < 0.9
    same = np.isclose(depth, expected, rtol=1e-12, atol=1e-12)
    assert (same | (hit != np.isfinite(expected))).mean() > 0.997
    assert (hit == np.isfinite(expected)).mean() > 0.999
