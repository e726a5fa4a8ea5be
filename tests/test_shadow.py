"""Shadow maps against exact rays: agreement at texels' centres, edges, biases, special places, frames."""

from __future__ import annotations

import dataclasses
import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from froxel_ref import scene_files
from froxel_ref.assets import load_assets
from froxel_ref.frame import FINAL, plan, run_frame
from froxel_ref.geometry import Lines
from froxel_ref.grid import froxel_points, make_froxels
from froxel_ref.records import InputError
from froxel_ref.scene import (
    Box,
    Camera,
    DirectionalLight,
    Folds,
    HeightField,
    Medium,
    Plane,
    PointLight,
    Scene,
    Sphere,
    SpotLight,
    Transform,
)
from froxel_ref.settings import Grid, Settings, ShadowMaps, replace
from froxel_ref.shadow import make_stack, map_kind, map_of, shadowed_lights, sight
from froxel_ref.shadow_raster import LightRaster, casters, raster_rays
from froxel_ref.shadow_stage import exact_sights, map_sights, shadow_maps
from froxel_ref.shadow_views import cascade_views, cube_views, octant_views, spot_view
from froxel_ref.visibility import dark_spans, exact_visibility, occluders

WHITE = (1.0, 1.0, 1.0)
THINGS = (
    Plane(), Sphere(center=(1.0, 1.2, -3.0), radius=0.7),
    Box(transform=Transform(translate=(-1.5, 1.0, -4.0), rotate=(0, 30, 10), scale=(0.4, 1.0, 0.3))),
    HeightField(heights=Folds(folds=3, size=33), transform=Transform(translate=(0, 2, -6), scale=(1.5, 1.5, 0.3))),
)
CAMERA = Camera(position=(0.3, 1.7, 1.0), target=(0.0, 1.2, -4.0), width=32, height=18)
GRID = Grid(width=16, height=9, depth=24, near=0.5, far=20.0)
SUN = DirectionalLight(direction=(0.5, 0.9, 0.4), irradiance=WHITE)
SPOT = SpotLight(position=(2.5, 4.0, -1.0), direction=(-0.5, -0.8, -0.6), intensity=WHITE, outer_angle=35, radius=20)
LAMP = PointLight(position=(0.2, 2.3, -3.2), intensity=WHITE, radius=20)
LIGHTS = {"directional": SUN, "spot": SPOT, "cube": LAMP, "octahedral": LAMP}


def maps_for(name, **changes):
    sizes = {"directional_size": 64, "spot_size": 64, "point_size": 64}
    return ShadowMaps(**({**sizes, "point_map": name if name in ("cube", "octahedral") else "cube"} | changes))


def looker(name, maps, surfaces=THINGS, light=None, dtype=np.float64, camera=CAMERA, grid=GRID):
    """A light's map made of surfaces, looked up."""
    light = light or LIGHTS[name]
    kind = map_kind(light)
    ready = casters(surfaces, load_assets(Scene(surfaces=surfaces), None))
    stack = make_stack(kind, {0: light}, ready, camera, grid, maps=maps, dtype=dtype)
    return sight(map_of(stack, 0, kind, light, maps=maps), maps=maps)


def exact(light, surfaces=THINGS):
    return exact_visibility(occluders(surfaces, load_assets(Scene(surfaces=surfaces), None)), [light])[0]


def views(name, maps):
    """Every face's raster, its border cut off."""
    border = maps.edge
    if name == "directional":
        return cascade_views(SUN, CAMERA, GRID, maps)
    if name == "octahedral":
        return list(itertools.chain(*octant_views(LAMP, maps.point_size - 2 * border).values()))
    faces = [spot_view(SPOT, maps.spot_size, border=border)] if name == "spot" else cube_views(
        LAMP, maps.point_size, border=border)
    return [cropped(face, border) for face in faces]


def cropped(view: LightRaster, border: int) -> LightRaster:
    return view._replace(base=view.base + border * (view.across + view.down), rows=view.rows - 2 * border,
                         columns=view.columns - 2 * border)


# --- agreement --------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", LIGHTS)
def test_points_on_texels_rays_see_what_is_exact(name):
    """Without a filter a map is right along the rays that it is made of, everywhere but at the surfaces' roundings."""
    maps = maps_for(name, kernel=0)
    see, truth = looker(name, maps), exact(LIGHTS[name])
    rng = np.random.default_rng(1)
    found = []
    for number, view in enumerate(views(name, maps)[:6]):
        origin, way = raster_rays(view)
        depth = rng.uniform(-15, 15, way.shape[1:]) if view.origin is None else rng.uniform(0.1, 12, way.shape[1:])
        if view.origin is None:
            depth = rng.uniform(-15, 15, origin.shape[1:])
        points = tuple(np.broadcast_to(o + w * depth, depth.shape) for o, w in zip(origin, way, strict=True))
        if name == "octahedral":  # a quarter's two pieces overlap: each is right in its own half
            own = way[1] * (1 - 2 * (number % 2)) > 1e-9
            points = tuple(p[own] for p in points)
        if name == "directional":  # a point may have a nearer cascade, whose texels it is not in the middle of
            size, inner = maps.directional_size, maps.directional_size - 2 * maps.edge
            nearer = [v for v in views(name, maps) if v.across @ v.across < view.across @ view.across * (1 - 1e-9)]
            hidden = np.zeros(points[0].shape, bool)
            for other in nearer:
                x, y = ((points[0] * a[0] + points[1] * a[1] + points[2] * a[2] - other.base @ a) / (a @ a)
                        for a in (other.across, other.down))
                hidden |= (np.abs(x - size / 2) < 0.97 * inner / 2) & (np.abs(y - size / 2) < 0.97 * inner / 2)
            x, y = (np.broadcast_to(c, points[0].shape) for c in np.meshgrid(*[np.arange(size) + 0.5] * 2))
            edge = np.maximum(np.abs(x - size / 2), np.abs(y - size / 2)) >= 0.97 * inner / 2
            points = tuple(p[~hidden & ~edge] for p in points)
        found.append((see(points), truth(points)))
    got, want = (np.concatenate([f[k].ravel() for f in found]) for k in (0, 1))
    assert got.size > 2000
    assert 0.05 < want.mean() < 0.95
    np.testing.assert_array_equal(got, want)


def test_matched_texels_and_froxels_agree_completely():
    """A spot light at the camera whose texels are the froxels' columns: every froxel of the grid."""
    camera = Camera(position=(0.3, 1.7, 1.0), target=(0.3, 1.7, -4.0), vertical_fov=60, width=30, height=30)
    light = SpotLight(position=camera.position, direction=(0, 0, -1), intensity=WHITE, outer_angle=30, radius=40)
    maps = ShadowMaps(spot_size=34, kernel=0)  # 30 texels and a border of two
    grid = Grid(width=30, height=30, depth=40, near=0.5, far=20.0)
    points = froxel_points(make_froxels(camera, grid))
    got = looker("spot", maps, light=light, camera=camera, grid=grid)(points)
    want = exact(light)(points)
    assert got.shape == (40, 30, 30)
    assert 0.2 < want.mean() < 0.8
    np.testing.assert_array_equal(got, want)
    # Half a texel aside they no longer do: the comparison can fail.
    moved = dataclasses.replace(light, position=(0.33, 1.72, 1.0))
    assert (looker("spot", maps, light=moved, camera=camera, grid=grid)(points) != want).any()


@pytest.mark.parametrize("name", LIGHTS)
def test_disagreement_falls_as_the_resolution_rises(name):
    """First order: the share of points that a map gets wrong, for sizes 32 to 512."""
    rng = np.random.default_rng(2)
    points = tuple(rng.uniform(low, high, 60000) for low, high in ((-3, 3), (0.01, 3.5), (-8, -1)))
    want = exact(LIGHTS[name])(points)
    wrong, sizes = [], (32, 64, 128, 256, 512)
    for size in sizes:
        maps = maps_for(name, kernel=0, directional_size=size, spot_size=size, point_size=size)
        keep = np.ones(want.shape, bool)
        if name == "spot":  # outside its cone a spot light has no map
            away = [p - o for p, o in zip(points, SPOT.position, strict=True)]
            axis = np.array(SPOT.direction) / np.linalg.norm(SPOT.direction)
            along = sum(a * d for a, d in zip(away, axis, strict=True))
            keep = along > math.cos(math.radians(35)) * np.sqrt(sum(a * a for a in away))
        wrong.append((looker(name, maps)(points) != want)[keep].mean())
    slope = -np.polyfit(np.log(sizes), np.log(wrong), 1)[0]
    assert 0.75 < slope < 1.25, (wrong, slope)


# --- edges ------------------------------------------------------------------------------------------


def room(size=2.0, thick=0.2):
    """Six walls around the light at the origin."""
    result = []
    for axis, side in itertools.product(range(3), (-1.0, 1.0)):
        scale, place = [size + thick] * 3, [0.0] * 3
        scale[axis], place[axis] = thick / 2, side * (size + thick / 2)
        result.append(Box(transform=Transform(translate=tuple(place), scale=tuple(scale))))
    return tuple(result)


@pytest.mark.parametrize("kernel", [0, 1, 2, 3])
@pytest.mark.parametrize("name", ["cube", "octahedral"])
def test_no_seam_at_edges_and_corners(name, kernel):
    """In a room all before the walls is lit and all behind them dark, walking across every edge and corner."""
    light = PointLight(position=(0.3, -0.2, 0.1), intensity=WHITE)
    # A wall's distance changes by up to 7 % within three of an octahedral map's texels only if they are small.
    maps = maps_for(name, kernel=kernel, point_size=64 if name == "cube" else 512)
    walls = tuple(dataclasses.replace(wall, transform=dataclasses.replace(
        wall.transform, translate=tuple(np.add(wall.transform.translate, light.position).tolist()))) for wall in room())
    see = looker(name, maps, surfaces=walls, light=light)
    along = np.linspace(-1.0, 1.0, 801)
    for a, b in itertools.permutations(range(3), 2):
        for side, offset in itertools.product((-1.0, 1.0), np.linspace(-0.999, 0.999, 23)):
            # From one face of the cube over its edge to the next, and over the octahedron's edges on the way.
            way = np.zeros((3, along.size))
            way[a], way[b] = side, offset
            way[3 - a - b] = along * 1.5
            way /= np.abs(way).max(axis=0)
            near, far = (tuple(p + 2.0 * share * w for p, w in zip(light.position, way, strict=True))
                         for share in (0.93, 1.07))
            assert (see(near) == 1.0).all()
            assert (see(far) == 0.0).all()


def test_a_map_without_its_border_has_seams():
    """The neighbours' texels are what keeps edges whole: without a gutter the test above fails."""
    light = PointLight(position=(0.0, 0.0, 0.0), intensity=WHITE)
    maps = maps_for("octahedral", kernel=3)
    kind = map_kind(light)
    slope = (Plane(point=(0.0, -1.0, 0.0)),)
    stack = make_stack(kind, {0: light}, casters(slope, None), CAMERA, GRID, maps=maps)
    torn = stack.depth.copy()
    border = maps.edge
    torn[..., :border, :] = torn[..., -border:, :] = torn[..., :, :border] = torn[..., :, -border:] = 0.0
    angle = np.linspace(0, 2 * np.pi, 720)
    rim = (np.cos(angle), np.full_like(angle, -0.3), np.sin(angle))
    whole, broken = (sight(map_of(stack._replace(depth=depth), 0, kind, light, maps=maps), maps=maps)(rim)
                     for depth in (stack.depth, torn))
    assert (whole == 1.0).all()
    broken_down = sight(map_of(stack._replace(depth=torn), 0, kind, light, maps=maps), maps=maps)(
        (0.01 * rim[0], np.full_like(angle, -0.9), 0.01 * rim[2]))
    assert (broken < 1.0).any() or (broken_down < 1.0).any()


def test_cascades_join_without_a_gap():
    """Along a line away from the camera a lit plane stays lit, and what is below it dark, through all cascades."""
    maps = maps_for("directional", kernel=3)
    see = looker("directional", maps, surfaces=(Plane(),))
    z = -np.linspace(0.0, 19.0, 4000)
    x = np.zeros_like(z)
    for height, want in ((1.0, 1.0), (-1.0, 0.0)):
        assert (see((x, x + height, z)) == want).all()


# --- biases -----------------------------------------------------------------------------------------


def plane_points(normal, count, rng, extent=3.0):
    """Points of the plane through the origin across a normal."""
    n = np.asarray(normal) / np.linalg.norm(normal)
    basis = np.linalg.svd(n[None])[2][1:]
    return n, basis.T @ rng.uniform(-extent, extent, (2, count))


GRAZING = (5.0, 30.0, 60.0, 80.0, 89.0, 89.9)


@pytest.mark.parametrize("dtype", [np.float64, np.float32])
@pytest.mark.parametrize("kernel", [0, 1, 3])
@pytest.mark.parametrize("name", LIGHTS)
def test_a_lit_plane_has_no_acne_at_any_angle(name, kernel, dtype):
    """Every point of a plane is fully lit, from overhead to 0.1° of grazing, without any bias to be tuned."""
    rng = np.random.default_rng(7)
    maps = maps_for(name, kernel=kernel)
    for angle, turn in itertools.product(GRAZING, rng.uniform(0, 2 * np.pi, 3)):
        tilt = math.radians(angle)
        normal = np.array([math.sin(tilt) * math.cos(turn), math.cos(tilt), math.sin(tilt) * math.sin(turn)])
        if name == "directional":
            light = DirectionalLight(direction=(0, 1, 0), irradiance=WHITE)
        elif name == "spot":
            light = SpotLight(position=(0, 4, 0), direction=(0, -1, 0), intensity=WHITE, outer_angle=40, radius=50)
        else:
            light = PointLight(position=(0, 4, 0), intensity=WHITE, radius=50)
        n, points = plane_points(normal, 2000, rng)
        towards = np.array([0.0, 1.0, 0.0]) if name == "directional" else np.array([[0.0], [4.0], [0.0]]) - points
        if (n @ (towards if name == "directional" else towards[:, 0])) < 0:
            n = -n
        keep = np.ones(points.shape[1], bool)
        if name == "spot":
            keep = -towards[1] < -math.cos(math.radians(39)) * np.linalg.norm(towards, axis=0)
        plane = Plane(point=(0, 0, 0), normal=tuple(n.tolist()))
        see = looker(name, maps, surfaces=(plane,), light=light, dtype=dtype)
        x, y, z = points[:, keep].astype(dtype)
        normals = tuple(np.full(x.shape, c, dtype) for c in n)
        assert (see((x, y, z), normals) == 1.0).all(), (name, angle)


@pytest.mark.parametrize("dtype", [np.float64, np.float32])
@pytest.mark.parametrize("name", ["cube", "octahedral"])
def test_no_acne_where_faces_meet(name, dtype):
    """On a floor, along the lines that the edges of a cube about the lamp throw on it, and a rounding aside."""
    rng = np.random.default_rng(13)
    for offset, height in ((0.0, 2.0), (0.0, 7.3), (100.0, 9.9), (1000.0, 9.9)):
        light = PointLight(position=(offset, height, -offset), intensity=WHITE, radius=50)
        see = looker(name, maps_for(name, point_size=256), surfaces=(Plane(),), light=light, dtype=dtype)
        along = np.concatenate([np.linspace(-height, height, 41), rng.uniform(-height, height, 20000)])
        aside = np.concatenate([np.zeros(41), rng.normal(scale=1e-5 * (1 + offset), size=20000)])
        for x, z in ((along, height + aside), (-height + aside, along), (along, along + aside), (along, -along)):
            points = tuple(np.asarray(c, dtype) for c in (x + offset, np.zeros_like(x), z - offset))
            share = see(points, tuple(np.full(x.shape, c, dtype) for c in (0.0, 1.0, 0.0)))
            assert (share == 1.0).all(), (offset, height, share.min())


@pytest.mark.parametrize("kernel", [0, 3, 7, 15])
@pytest.mark.parametrize("size", [128, 1024])
@pytest.mark.parametrize("name", ["directional", "spot"])
def test_no_acne_at_the_edges_of_wide_kernels(name, size, kernel):
    """Lifted points look at texels beyond a face's edge: there must be some."""
    rng = np.random.default_rng(14)
    maps = maps_for(name, kernel=kernel, directional_size=size, spot_size=size)
    for tilt, outer in itertools.product((20.0, 45.0, 70.0), (20.0, 74.9)):
        normal = np.array([math.sin(math.radians(tilt)), math.cos(math.radians(tilt)), 0.2])
        n = normal / np.linalg.norm(normal)
        light = DirectionalLight(direction=(0, 1, 0), irradiance=WHITE) if name == "directional" else SpotLight(
            position=(0, 4, 0), direction=(0, -1, 0), intensity=WHITE, inner_angle=5, outer_angle=outer, radius=90)
        _, points = plane_points(n, 6000, rng, extent=8.0)
        if name == "spot":
            away = points - np.array([[0.0], [4.0], [0.0]])
            points = points[:, -away[1] > math.cos(math.radians(outer)) * np.linalg.norm(away, axis=0)]
        see = looker(name, maps, surfaces=(Plane(normal=tuple(n.tolist())),), light=light)
        share = see(tuple(points), tuple(np.full(points.shape[1], c) for c in n))
        assert (share == 1.0).all(), (tilt, outer, share.min())


@pytest.mark.parametrize("name", LIGHTS)
def test_without_its_lift_a_plane_has_acne(name):
    rng = np.random.default_rng(8)
    n, points = plane_points((0.6, 0.5, 0.2), 2000, rng, extent=1.0)
    light = {"directional": DirectionalLight(direction=(0, 1, 0), irradiance=WHITE),
             "spot": SpotLight(position=(0, 4, 0), direction=(0, -1, 0), intensity=WHITE, outer_angle=40)}.get(
                 name, PointLight(position=(0, 4, 0), intensity=WHITE))
    maps = maps_for(name, normal_bias=0.0, corner_bias=0.0)
    see = looker(name, maps, surfaces=(Plane(normal=tuple(n.tolist())),), light=light)
    share = see(tuple(points), tuple(np.full(2000, c) for c in n))
    assert share.mean() < 0.9


@pytest.mark.parametrize("name", LIGHTS)
@pytest.mark.parametrize(("bias", "value"), [("constant_bias", 0.6), ("slope_bias", 2.0)])
def test_the_usual_biases_light_a_plane_too(name, bias, value):
    """Constant and slope bias, as a port has them: enough of either and there is no acne; halved there is."""
    rng = np.random.default_rng(9)
    n, points = plane_points((0.5, 0.8, 0.2), 2000, rng, extent=1.0)
    light = {"directional": DirectionalLight(direction=(0, 1, 0), irradiance=WHITE),
             "spot": SpotLight(position=(0, 4, 0), direction=(0, -1, 0), intensity=WHITE, outer_angle=40)}.get(
                 name, PointLight(position=(0, 4, 0), intensity=WHITE))
    seen = []
    for factor in (1.0, 0.02):
        maps = maps_for(name, normal_bias=0.0, corner_bias=0.0, **{bias: value * factor})
        see = looker(name, maps, surfaces=(Plane(normal=tuple(n.tolist())),), light=light)
        seen.append(see(tuple(points), tuple(np.full(2000, c) for c in n)))
    assert (seen[0] == 1.0).all()
    assert (seen[1] < 1.0).any()


@pytest.mark.parametrize("kernel", [0, 1, 3])
@pytest.mark.parametrize("name", LIGHTS)
def test_corners_are_not_dark(name, kernel):
    """Where a floor meets a wall, texels across the corner lie on the other one: both stay lit up to it.

    Wider kernels than bilinear ones reach further across, and leave a soft, shallow line.
    """
    surfaces = (Plane(), Plane(point=(0, 0, -5), normal=(0, 0, 1)))
    light = {"directional": DirectionalLight(direction=(0.2, 1.0, 0.8), irradiance=WHITE),
             "spot": SpotLight(position=(0.5, 4, -1), direction=(0, -1, -1), intensity=WHITE, outer_angle=40)}.get(
                 name, PointLight(position=(0.5, 4, -1), intensity=WHITE))
    x, near = np.meshgrid(np.linspace(-1.0, 1.0, 101), np.geomspace(1e-4, 0.3, 60))
    dark = False
    for turned, points in ((np.array([0.0, 1.0, 0.0]), (x, 0 * x, near - 5.0)),
                           (np.array([0.0, 0.0, 1.0]), (x, near, 0 * x - 5.0))):
        normal = tuple(np.full(x.shape, c) for c in turned)
        biased, bare = (looker(name, maps_for(name, kernel=kernel, corner_bias=b), surfaces=surfaces, light=light)(
            points, normal) for b in (2.0, 0.0))
        assert biased.min() == 1.0 if kernel <= 1 else biased.min() > max(0.95, bare.min())
        dark |= bool((bare < 1.0).any())
    assert dark or kernel < 3


@pytest.mark.parametrize("kernel", [1, 7, 15])
@pytest.mark.parametrize("name", ["spot", "cube", "octahedral"])
def test_no_bias_takes_a_surface_to_the_light(name, kernel):
    """However coarse the map and wide the kernel, a lamp shut into a solid lights nothing, and a plate shades."""
    light = {"spot": SpotLight(position=(0, 2, 0), direction=(0, -1, 0), intensity=WHITE, inner_angle=5, outer_angle=74)
             }.get(name, PointLight(position=(0, 2, 0), intensity=WHITE))
    x, z = np.meshgrid(*[np.linspace(-0.6, 0.6, 25)] * 2)
    floor, normal = (x, 0 * x, z), (0 * x, 0 * x + 1.0, 0 * x)
    maps = maps_for(name, kernel=kernel)
    shell = Box(transform=Transform(translate=(0, 2, 0), scale=(0.3, 0.3, 0.3)))
    shut = looker(name, maps, surfaces=(Plane(), shell), light=light)
    assert (shut(floor, normal) <= 1e-15).all()
    plate = Box(transform=Transform(translate=(0, 1, 0), scale=(1.0, 0.05, 1.0)))
    # A kernel of 15 of 64 texels sees past the plate; what the bias adds is little.
    shaded, bare = (looker(name, dataclasses.replace(maps, corner_bias=b), surfaces=(Plane(), plate), light=light)(
        floor, normal).mean() for b in (2.0, 0.0))
    assert shaded <= bare + 0.05
    assert shaded < 0.01 or kernel > 1


def test_exponential_maps_know_no_kernel():
    rng = np.random.default_rng(6)
    points = tuple(rng.uniform(low, high, 2000) for low, high in ((-3, 3), (0, 3), (-8, -1)))
    normal = tuple(np.full(2000, c) for c in (0.0, 1.0, 0.0))
    one, two = (looker("cube", maps_for("cube", technique="exponential", point_size=128, kernel=k))(points, normal)
                for k in (0, 9))
    assert np.array_equal(one, two)


def test_media_are_not_biased():
    """A froxel's sample lies on no surface: only a constant bias, if one is set, moves it."""
    see = looker("spot", maps_for("spot", kernel=0))
    lifted = looker("spot", maps_for("spot", kernel=0, normal_bias=9.0, slope_bias=9.0, corner_bias=9.0))
    rng = np.random.default_rng(10)
    points = tuple(rng.uniform(low, high, 5000) for low, high in ((-3, 3), (0, 3), (-8, -1)))
    assert np.array_equal(see(points), lifted(points))


# --- special places ---------------------------------------------------------------------------------


@pytest.mark.parametrize("technique", ["compare", "exponential"])
@pytest.mark.parametrize("dtype", [np.float64, np.float32])
@pytest.mark.parametrize("name", LIGHTS)
def test_no_place_gives_nan(name, dtype, technique):
    """At the light, on its axes and planes, at a froxel's centre, far away: a number in [0, 1], no warning."""
    maps = maps_for(name, technique=technique, directional_size=128, spot_size=128, point_size=128)
    for surfaces in (THINGS, (Sphere(center=LAMP.position, radius=0.5),), (Box(),), ()):
        see = looker(name, maps, surfaces=surfaces, dtype=dtype)
        place = np.array(getattr(LIGHTS[name], "position", (0, 0, 0)), float)
        offsets = [np.zeros(3), *np.eye(3), *-np.eye(3), *np.eye(3) * 1e-20, *np.eye(3) * 1e9, [1, 1, 1], [1, -1, 0]]
        points = tuple((place + np.array(offsets)).T.astype(dtype))
        for normal in (None, tuple(np.full(len(offsets), c, dtype) for c in (0.0, 1.0, 0.0))):
            share = see(points, normal)
            assert share.dtype == dtype
            assert ((share >= 0.0) & (share <= 1.0)).all()


@pytest.mark.parametrize("name", ["spot", "cube", "octahedral"])
def test_a_light_inside_a_solid_lights_nothing(name):
    light = dataclasses.replace(LIGHTS[name], position=(0.1, 0.2, 0.3))
    rng = np.random.default_rng(12)
    points = tuple(rng.uniform(-3, 3, (3, 4000)))
    if name == "spot":  # outside its cone it shines on nothing anyway
        away = np.stack([p - o for p, o in zip(points, light.position, strict=True)])
        axis = np.array(light.direction) / np.linalg.norm(light.direction)
        lit = axis @ away > math.cos(math.radians(light.outer_angle)) * np.linalg.norm(away, axis=0)
        points = tuple(p[lit] for p in points)
    for solid in (Box(), Sphere(radius=1.5)):
        assert (looker(name, maps_for(name), surfaces=(solid,), light=light)(points) == 0.0).all()
        assert (exact(light, (solid,))(points) == 0.0).all()


# --- which lights have maps -------------------------------------------------------------------------


def test_lights_that_nothing_can_hide_have_no_map():
    near = Sphere(center=(0, 0, -5), radius=1)
    lamp = PointLight(position=(0, 0, 0), intensity=WHITE, radius=3.99)
    lights = [lamp, dataclasses.replace(lamp, radius=4.01), dataclasses.replace(lamp, falloff="inverse_square"),
              dataclasses.replace(lamp, radius=9, casts_shadows=False),
              dataclasses.replace(lamp, radius=9, intensity=(0, 0, 0)),
              SUN]
    assert shadowed_lights(lights, [near]) == (1, 2, 5)
    assert shadowed_lights(lights, [dataclasses.replace(near, casts_shadows=False)]) == ()
    box = Box(transform=Transform(translate=(0, 0, -5), rotate=(0, 45, 0)))
    assert 1 in shadowed_lights(lights, [box])
    assert shadowed_lights([lamp], [Plane(point=(0, -3.98, 0))]) == (0,)
    assert shadowed_lights([lamp], [Plane(point=(0, -4.0, 0), normal=(0, -20, 0))]) == ()


@settings(max_examples=50, deadline=None)
@given(st.tuples(*[st.floats(-4, 4)] * 3), st.tuples(*[st.floats(0, 360)] * 3), st.tuples(*[st.floats(0.05, 2)] * 3),
       st.floats(0.2, 4))
def test_a_left_out_box_is_out_of_reach(place, turn, scale, radius):
    """Whatever is left out, no point of it lies within the light's radius."""
    box = Box(transform=Transform(translate=place, rotate=turn, scale=scale))
    lamp = PointLight(position=(0, 0, 0), intensity=WHITE, radius=radius)
    if not shadowed_lights([lamp], [box]):
        pose = box.transform.world_from_local
        local = np.random.default_rng(0).uniform(-1, 1, (3, 4000))
        local[0] = np.sign(local[0])
        points = pose[:3, :3] @ local + pose[:3, 3:]
        assert np.linalg.norm(points, axis=0).min() > radius


def test_wide_spot_lights_have_a_point_lights_map():
    wide = SpotLight(position=(0, 3, 0), intensity=WHITE, inner_angle=40, outer_angle=85)
    assert map_kind(wide) == "point"
    scene = Scene(camera=CAMERA, lights=(wide,), surfaces=THINGS)
    made = shadow_maps(scene, Settings(grid=GRID, shadow_maps=maps_for("cube")), load_assets(scene, None))
    assert made["shadow/point_light"].tolist() == [0]
    assert made["shadow/spot_depth"].shape[0] == 0


# --- frames -----------------------------------------------------------------------------------------


def hall():
    loaded = scene_files.load("thesis-hall")
    scene = dataclasses.replace(loaded.scene, camera=dataclasses.replace(loaded.scene.camera, width=48, height=27))
    how = Settings(grid=Grid(width=24, height=14, depth=24, near=0.5, far=48.0), shadow_maps=ShadowMaps(
        directional_size=128, spot_size=64, point_size=64))
    return scene, how, load_assets(scene, loaded.folder)


def test_a_frame_by_maps_is_near_the_frame_by_rays():
    scene, how, assets = hall()
    fine = replace(how, shadow_maps=ShadowMaps(directional_size=1024, point_size=512))
    off, coarse, maps, rays = (run_frame(scene, s, assets=assets, outputs=[FINAL])[FINAL] for s in (
        replace(how, shadows="off"), how, fine, replace(how, shadows="exact")))
    def error(image):
        return np.sqrt(np.mean((image - rays) ** 2)) / rays.mean()

    assert error(off) > 0.15
    assert error(coarse) < 0.05
    assert error(maps) < 0.35 * error(coarse)


@pytest.mark.parametrize("changes", [{"technique": "exponential", "directional_size": 128, "point_size": 128,
                                      "spot_size": 128, "downsample": 2}, {"point_map": "octahedral"}, {"kernel": 3},
                                     {"cascades": 1}, {"kernel": 0}])
def test_every_technique_makes_a_frame_with_shadows(changes):
    scene, how, assets = hall()
    how = replace(how, shadow_maps=dataclasses.replace(how.shadow_maps, **changes))
    image = run_frame(scene, how, assets=assets, outputs=[FINAL])[FINAL]
    rays = run_frame(scene, replace(how, shadows="exact"), assets=assets, outputs=[FINAL])[FINAL]
    off = run_frame(scene, replace(how, shadows="off"), assets=assets, outputs=[FINAL])[FINAL]
    assert np.isfinite(image).all()
    assert np.abs(image - rays).mean() < 0.5 * np.abs(off - rays).mean()


def test_maps_are_taken_over_where_nothing_moved():
    scene, how, assets = hall()
    first = run_frame(scene, how, assets=assets)
    again = run_frame(scene, how, assets=assets, previous=first)
    assert {name.partition("_")[0] for name in again.reused} == {"shadow/directional", "shadow/spot", "shadow/point"}
    for name, array in first.results.items():
        assert np.array_equal(array, again[name]), name
    # Colours do not matter, places do.
    red = dataclasses.replace(scene, lights=tuple(
        dataclasses.replace(light, intensity=(9, 0, 0)) if isinstance(light, PointLight) else light
        for light in scene.lights))
    assert len(run_frame(red, how, assets=assets, previous=first).reused) == 15
    moved = dataclasses.replace(scene, lights=(scene.lights[0], dataclasses.replace(
        scene.lights[1], position=(-6.0, 3.0, -7.0)), *scene.lights[2:]))
    fresh, kept = (run_frame(moved, how, assets=assets, previous=p) for p in (None, first))
    assert {name.partition("_")[0] for name in kept.reused} == {"shadow/directional", "shadow/spot"}
    assert all(np.array_equal(fresh[name], kept[name]) for name in fresh.results)
    box = dataclasses.replace(scene, surfaces=(*scene.surfaces, Sphere(center=(0, 2, -9))))
    assert run_frame(box, how, assets=assets, previous=first).reused == tuple(
        name for name in first.results if name.startswith("shadow/spot"))
    other = replace(how, shadow_maps=dataclasses.replace(how.shadow_maps, point_size=32))
    assert not any("point" in name for name in run_frame(scene, other, assets=assets, previous=first).reused)


@pytest.mark.parametrize("kind", ["spot", "point"])
@pytest.mark.parametrize("technique", ["compare", "exponential"])
def test_maps_that_are_taken_over_are_those_of_the_frame(kind, technique):
    """A lamp without a window, and a camera that walks: nothing of its map may depend on the camera."""
    lamp = {"position": (2, 5, 1), "intensity": (50, 50, 50), "falloff": "inverse_square"}
    light = SpotLight(direction=(-0.4, -1, -0.2), **lamp) if kind == "spot" else PointLight(**lamp)
    scenes = [Scene(camera=Camera(position=(0, 1.7, z), target=(0, 1.5, 0), width=32, height=18), lights=(light,),
                    global_media=(Medium(extinction=0.05),), surfaces=THINGS) for z in (6.0, 12.0)]
    how = Settings(grid=Grid(width=16, height=9, depth=16, far=20), shadow_maps=ShadowMaps(
        technique=technique, spot_size=64, point_size=64))
    first = run_frame(scenes[0], how)
    fresh, kept = (run_frame(scenes[1], how, previous=p) for p in (None, first))
    assert f"shadow/{kind}_depth" in kept.reused
    assert all(np.array_equal(fresh[name], kept[name]) for name in fresh.results)
    with pytest.raises(ValueError, match="read-only"):
        kept[f"shadow/{kind}_depth"][...] = 0.0


@pytest.mark.parametrize("light", [
    PointLight(position=(0, 200, 0), intensity=WHITE, falloff="inverse_square"),
    SpotLight(position=(0, 200, 0), intensity=WHITE, falloff="inverse_square")])
def test_exponential_maps_of_far_lamps_hide(light):
    """Whatever the camera sees: a plate at 60 m hides what is below it, and nothing else."""
    plate = Box(transform=Transform(translate=(0, 60, 0), scale=(20, 0.5, 20)))
    maps = maps_for("cube", technique="exponential", point_size=256, spot_size=256)
    see = looker("spot", maps, surfaces=(Plane(), plate), light=light)
    x = np.array([0.0, 5.0, 45.0, 60.0])
    # A point light sees the floor out to the horizon, so its range is 1.5 km and 59 m are e^(−80·59/1500) of light.
    np.testing.assert_allclose(see((x, np.full(4, 1.0), 0 * x)), [0, 0, 1, 1], atol=0.05)


def test_exponential_maps_of_a_low_sun_light_a_plane():
    light = DirectionalLight(direction=(1, 0.05, 0.3), irradiance=WHITE)
    see = looker("directional", maps_for("directional", technique="exponential", directional_size=1024),
                 surfaces=(Plane(),), light=light, grid=Grid())
    z = -np.linspace(1.0, 60.0, 3000)
    share = see((0 * z, 0 * z, z), tuple(np.full(3000, c) for c in (0.0, 1.0, 0.0)))
    assert share.min() > 0.97


def test_cascades_follow_the_camera_and_lamps_stay():
    scene, how, assets = hall()
    first = run_frame(scene, how, assets=assets)
    walked = dataclasses.replace(scene, camera=dataclasses.replace(scene.camera, position=(2.8, 1.9, -1.5)))
    fresh, kept = (run_frame(walked, how, assets=assets, previous=p) for p in (None, first))
    assert {name.partition("_")[0] for name in kept.reused} == {"shadow/spot", "shadow/point"}
    assert all(np.array_equal(fresh[name], kept[name]) for name in fresh.results)


@pytest.mark.parametrize(("scene", "shadows", "why"), [
    (Scene(), "maps", "nothing that casts"), (Scene(surfaces=(Plane(),)), "maps", "no light"),
    (Scene(surfaces=(Plane(),), lights=(SUN,)), "off", "off"),
    (Scene(surfaces=(Plane(),), lights=(SUN,)), "exact", "exact"),
    (Scene(surfaces=(Plane(casts_shadows=False),), lights=(SUN,)), "maps", "nothing that casts"),
    (Scene(surfaces=(Plane(),), lights=(dataclasses.replace(SUN, casts_shadows=False),)), "maps", "no light")])
def test_leaving_out_says_why(scene, shadows, why):
    planned = plan(scene, Settings(shadows=shadows))["shadow"]
    assert not planned.runs
    assert why in planned.why


def test_beyond_the_cascades_is_lit_or_dark():
    """A4: a camera that looks past the froxels' far end, at a floor under a low roof far away."""
    maps = maps_for("directional")
    see = {}
    for word in ("lit", "dark"):
        light = LIGHTS["directional"]
        stack = make_stack("directional", {0: light}, casters((Plane(),), None), CAMERA, GRID, maps=maps)
        see[word] = sight(map_of(stack, 0, "directional", light, maps=maps), maps=maps, outside=word)
    far = (np.array([500.0]), np.array([1.0]), np.array([0.0]))
    assert (see["lit"](far).item(), see["dark"](far).item()) == (1.0, 0.0)


# --- exact ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_exact_rays_do_not_let_a_surface_hide_itself(dtype):
    scene = Scene(camera=CAMERA, lights=(SUN, LAMP), surfaces=(Plane(point=(0, -3.3, 0)),))
    sees = exact_sights(scene, load_assets(scene, None))
    rng = np.random.default_rng(3)
    x, z = rng.uniform(-40, 40, (2, 5000)).astype(dtype)
    y = np.full_like(x, dtype(-3.3))
    normal = (np.zeros_like(x), np.ones_like(x), np.zeros_like(x))
    for number in (0, 1):
        assert (sees[number]((x, y, z), normal) == 1.0).all()


def test_a_plane_that_a_lamp_lies_in_hides_nothing():
    """By exact rays as by maps, and along rays; rounding does not sprinkle it with shadow."""
    n, rng = np.array((1.0, 2.0, 3.0)), np.random.default_rng(4)
    place = np.array((1.3, 0.7, 0.2)) + 0.7 * np.cross(n, (1, 0, 0))
    plane = Plane(point=(1.3, 0.7, 0.2), normal=(1, 2, 3))
    along = DirectionalLight(direction=tuple(np.cross(n, (0.3, 0.1, 1)).tolist()), irradiance=WHITE)
    points = tuple(rng.normal(scale=5, size=(3, 4000)))
    way = rng.normal(size=(3, 400))
    lines = Lines(rng.normal(scale=5, size=(3, 400)), way / np.linalg.norm(way, axis=0), np.zeros(400),
                  np.full(400, 9.0))
    for light in (PointLight(position=tuple(place.tolist()), intensity=WHITE, radius=50), along):
        assert (exact(light, (plane,))(points) == 1.0).all()
        assert np.isnan(dark_spans(occluders((plane,), load_assets(Scene(), None)), lines, light)).all()


# --- made elsewhere ---------------------------------------------------------------------------------


def test_maps_made_elsewhere_are_used(tmp_path):
    scene, how, _ = hall()
    first = run_frame(scene, how)
    np.save(tmp_path / "sun.npy", first["shadow/directional_depth"][0])
    np.save(tmp_path / "lamp.npy", first["shadow/point_depth"][3].astype(np.float32))
    lights = list(scene.lights)
    lights[0] = dataclasses.replace(lights[0], shadow_map="sun.npy")
    lights[4] = dataclasses.replace(lights[4], shadow_map="lamp.npy")
    given = dataclasses.replace(scene, lights=tuple(lights))
    second = run_frame(given, how, assets=load_assets(given, tmp_path))
    assert np.array_equal(first["shadow/directional_depth"], second["shadow/directional_depth"])
    np.testing.assert_allclose(second[FINAL], first[FINAL], rtol=1e-3)
    # In float64 they are the very maps: nothing changes.
    np.save(tmp_path / "lamp.npy", first["shadow/point_depth"][3])
    assert np.array_equal(run_frame(given, how, assets=load_assets(given, tmp_path))[FINAL], first[FINAL])
    np.save(tmp_path / "sun.npy", np.full((4, 128, 128), np.inf))
    lit = run_frame(given, how, assets=load_assets(given, tmp_path))
    assert lit[FINAL].mean() > 1.02 * second[FINAL].mean()


def test_a_cube_without_a_border_is_a_renderers_own(tmp_path):
    """Six faces that end at their edges: the inner part of ours, and right but for the texels at the edges."""
    scene, how, assets = hall()
    ours = run_frame(scene, how, assets=assets)
    edge = how.shadow_maps.edge
    plain = replace(how, shadow_maps=dataclasses.replace(how.shadow_maps, border=0, point_size=64 - 2 * edge))
    np.save(tmp_path / "lamp.npy", ours["shadow/point_depth"][3][:, edge:-edge, edge:-edge])
    lights = [dataclasses.replace(light, shadow_map="lamp.npy" if i == 4 else None)
              for i, light in enumerate(scene.lights)]
    given = dataclasses.replace(scene, lights=tuple(lights))
    used = run_frame(given, plain, assets=load_assets(given, tmp_path))["shadow/point_depth"][3]
    made = run_frame(scene, plain, assets=assets)["shadow/point_depth"][3]
    # The same rays but for rounding, which decides at silhouettes.
    assert np.isclose(used, made, rtol=1e-12).mean() > 0.999


@pytest.mark.parametrize(("array", "words"), [
    (np.zeros((4, 64, 128)), r"lights\[0\].shadow_map: has shape \(4, 64, 128\), must be \(4, 128, 128\)"),
    (np.zeros((128, 128)), r"lights\[0\].shadow_map: has shape \(128, 128\), must be \(4, 128, 128\)"),
    (np.where(np.arange(128) == 5, np.nan, np.ones((4, 128, 128))),
     r"lights\[0\].shadow_map: .* depth must be a number"),
    (np.full((4, 128, 128), -np.inf), r"lights\[0\].shadow_map: has NaN or −∞"),
    (np.zeros((4, 128, 128), np.int32), "must hold floats")])
def test_bad_maps_are_refused_by_name(tmp_path, array, words):
    scene, how, _ = hall()
    np.save(tmp_path / "sun.npy", array)
    given = dataclasses.replace(scene, lights=(dataclasses.replace(scene.lights[0], shadow_map="sun.npy"),))
    with pytest.raises(InputError, match=words):
        run_frame(given, how, assets=load_assets(given, tmp_path))


@pytest.mark.parametrize(("changes", "words"), [
    ({"cascades": 0}, "cascades: is 0, must be at least 1"),
    ({"point_size": 17}, "point_size: is 17, must be a multiple of 2"),
    ({"spot_size": 20, "kernel": 15}, "spot_size: is 20, must be above 48"),
    ({"technique": "exponential", "directional_size": 100}, "directional_size: is 100, must be a multiple of 8"),
    ({"technique": "variance"}, "technique"), ({"kernel": -1}, "kernel"), ({"exponent": 100.0}, "exponent")])
def test_bad_settings_are_refused_by_name(changes, words):
    with pytest.raises(InputError, match=words):
        ShadowMaps(**changes)


def test_depths_behind_a_lamp_are_refused(tmp_path):
    scene, how, _ = hall()
    np.save(tmp_path / "lamp.npy", np.full((6, 64, 64), -1.0))
    given = dataclasses.replace(scene, lights=(dataclasses.replace(scene.lights[1], shadow_map="lamp.npy"),))
    with pytest.raises(InputError, match=r"lights\[0\].shadow_map: has negative depths"):
        run_frame(given, how, assets=load_assets(given, tmp_path))


@pytest.mark.parametrize(("changes", "words"), [
    ({"border": 20, "point_size": 50}, "point_size: is 50, must be at least 60"),
    ({"technique": "exponential", "blur": 10, "downsample": 4, "point_size": 104}, "must be at least 132")])
def test_gutters_wider_than_the_octahedron_are_refused(changes, words):
    with pytest.raises(InputError, match=words):
        ShadowMaps(point_map="octahedral", **changes)


def test_an_octahedron_without_a_gutter():
    see = looker("octahedral", maps_for("octahedral", border=0, kernel=0))
    points = tuple(np.random.default_rng(5).uniform(low, high, 4000) for low, high in ((-3, 3), (0, 3), (-8, -1)))
    assert (see(points) == exact(LAMP)(points)).mean() > 0.85


def test_maps_beyond_the_memory_are_named():
    scene, how, _ = hall()
    huge = replace(how, shadow_maps=ShadowMaps(directional_size=16384, cascades=16))
    with pytest.raises(InputError, match=r"settings.shadow_maps: need up to .* GiB"):
        plan(dataclasses.replace(scene, lights=scene.lights * 3), huge)


def test_a_spot_of_half_a_sphere_is_refused():
    with pytest.raises(InputError, match="outer_angle"):
        SpotLight(position=(0, 0, 0), intensity=WHITE, outer_angle=90)


def test_results_do_not_depend_on_threads_or_blocks():
    scene, how, assets = hall()
    one, two = (run_frame(scene, how, assets=assets, threads=n) for n in (1, 3))
    assert all(np.array_equal(one[name], two[name]) for name in one.results)


def test_map_sights_are_those_of_the_lights():
    scene, how, assets = hall()
    sees = map_sights(shadow_maps(scene, how, assets), scene, how, assets)
    assert sorted(sees) == list(range(10))
