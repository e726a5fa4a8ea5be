"""Where the shadows of media break along rays, against dense scans of what media let through."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from froxel_ref.breaks import relate
from froxel_ref.density import place
from froxel_ref.light_paths import light_transmittance
from froxel_ref.media_shadows import CELLS, shadow_cuts
from froxel_ref.optical_depth import Lines
from froxel_ref.records import InputError
from froxel_ref.scene import (
    DensityTexture,
    DirectionalLight,
    HeightFog,
    LocalMedium,
    Medium,
    NoiseDensity,
    PointLight,
    Transform,
)
from froxel_ref.settings import Settings

NOON = DirectionalLight(direction=(0.0, 1.0, 0.0), irradiance=(1, 1, 1))
LIGHTS = {"noon": NOON, "sun": DirectionalLight(direction=(0.4, 1.0, -0.3), irradiance=(1, 1, 1)),
          "level sun": DirectionalLight(direction=(1.0, 0.0, 0.2), irradiance=(1, 1, 1)),
          "lamp": PointLight(position=(0.3, 3.0, 0.4), intensity=(1, 1, 1)),
          "lamp inside": PointLight(position=(0.1, 0.2, -0.1), intensity=(1, 1, 1))}
POSE = Transform(translate=(0.2, 0.3, -0.1), rotate=(10, 25, 40), scale=(1.2, 0.4, 0.8))
LEVEL = Transform(translate=(0.2, 0.3, -0.1), rotate=(0, 25, 0), scale=(1.2, 0.9, 0.8))
CEILING = HeightFog(start=0.0, falloff=0.0, max_height=0.6)
MEDIA = {
    "box": LocalMedium(transform=POSE),
    "sheared": LocalMedium(transform=Transform(matrix=(1, 0.5, 0, 0.2, 0, 0.8, 0.3, 0, 0.2, 0, 1.1, 0))),
    "box with a ceiling": LocalMedium(transform=LEVEL, height_fog=CEILING),
    "box of fog": LocalMedium(transform=LEVEL, height_fog=HeightFog(start=0.3, falloff=0.5, max_height=0.8)),
    "ellipsoid": LocalMedium(shape="ellipsoid", transform=POSE),
    "ellipsoid with a ceiling": LocalMedium(shape="ellipsoid", transform=LEVEL, height_fog=CEILING),
}
STOP, COUNT = 10.0, 4001


def lines(seed, count):
    """Rays from all sides that pass the origin at up to 2 m."""
    rng = np.random.default_rng(seed)
    origin, aim = rng.normal(size=(3, count)), rng.uniform(-1.2, 1.2, (3, count))
    origin *= 5.0 / np.linalg.norm(origin, axis=0)
    d = aim - origin
    return Lines(origin, d / np.linalg.norm(d, axis=0), np.zeros(count), np.full(count, STOP))


def depths(medium, light, rays, sun_distance):
    """Optical depth towards a light at dense places of rays, extinction 1."""
    t = np.linspace(0, STOP, COUNT)
    points = tuple(o[:, None] + d[:, None] * t for o, d in zip(rays.origin, rays.direction, strict=True))
    passing = light_transmittance([place(medium)], np.ones((1, 1)), light, points, settings=Settings(),
                                  sun_distance=sun_distance)
    return t, -np.log(passing[0])


@pytest.mark.parametrize("sun_distance", [np.inf, 1.5])
@pytest.mark.parametrize("light", LIGHTS)
@pytest.mark.parametrize("name", MEDIA)
def test_no_kink_of_a_shadow_lies_between_cuts(name, light, sun_distance):
    """The depth's third difference is that of a smooth function but within two steps of a cut."""
    rays, source = lines(3, 60), LIGHTS[light]
    cuts = shadow_cuts([place(MEDIA[name])], np.ones((1, 1)), source, rays, sun_distance=sun_distance)
    t, depth = depths(MEDIA[name], source, rays, sun_distance)
    step = t[1]
    bend = np.abs(np.diff(depth, 3, axis=1))
    # A kink in the slope k makes a third difference of k·step, a smooth depth one of step³ (next to the edge of
    # an ellipsoid more). The ray's own edges and the lamp's nearest point are other cuts.
    row, column = np.nonzero(bend > 0.02 * step)
    at = t[column] + 1.5 * step
    own = own_edges(MEDIA[name], rays)
    every = np.concatenate([cuts, own], axis=1)
    gap = np.nanmin(np.where(np.isnan(every[row]), np.inf, np.abs(every[row] - at[:, None])), axis=1, initial=np.inf)
    reach = 0.25 if "ellipsoid" in name else 2.6 * step
    if isinstance(source, PointLight):
        reach = max(reach, 16 * step)  # ways that graze a face bend their chord sharply, without a kink
        nearest = relate(source, rays).nearest[row]
        gap = np.minimum(gap, np.where(np.abs(nearest - at) < 0.5, 0.0, np.inf))
    assert len(row) > 40
    assert (gap <= reach).all(), float(gap.max())


def own_edges(medium, rays):
    """Where rays meet the medium itself, by a dense scan of its density."""
    from froxel_ref.density import density

    t = np.linspace(0, STOP, 20001)
    points = tuple(o[:, None] + d[:, None] * t for o, d in zip(rays.origin, rays.direction, strict=True))
    value = np.broadcast_to(density(medium, points), (len(rays.start), t.size))
    edges = [np.flatnonzero(np.diff((row > 0).astype(int)) | np.diff((row == 1).astype(int))) for row in value]
    most = max(map(len, edges))
    return np.array([[*t[e], *[np.nan] * (most - len(e))] for e in edges])


def test_cuts_are_where_the_edges_are():
    """A unit box 3 m above a ray: under a sun its edges, under a lamp at height 7 blown up 7/2 and 7/4."""
    box = place(LocalMedium(transform=Transform(translate=(0, 4, 0))))
    ray = Lines(np.array([[-9.0], [0.0], [0.0]]), np.array([[1.0], [0.0], [0.0]]), np.zeros(1), np.array([18.0]))
    cuts = shadow_cuts([box], np.ones((1, 1)), NOON, ray)
    assert sorted(set((cuts[~np.isnan(cuts)] - 9).round(12))) == [-1.0, 1.0]
    lamp = PointLight(position=(0, 7, 0), intensity=(1, 1, 1))
    cuts = shadow_cuts([box], np.ones((1, 1)), lamp, ray)
    assert sorted(set((cuts[~np.isnan(cuts)] - 9).round(12))) == [-3.5, -1.75, 1.75, 3.5]
    # 4 m of way reach 1 m into the box and its ends nowhere else.
    cuts = shadow_cuts([box], np.ones((1, 1)), NOON, ray, sun_distance=2.5)
    assert not cuts.shape[1]


def test_what_casts_no_shadow_makes_no_cuts():
    rays = lines(5, 20)
    clear, fog = place(LocalMedium(extinction=0.0)), place(Medium())
    assert shadow_cuts([clear, fog], np.array([[0.0], [1.0]]), NOON, rays).shape == (20, 0)


@pytest.mark.parametrize("light", LIGHTS)
def test_pieces_of_a_textured_shadow_sweep_over_few_cells(light):
    """Between neighbouring cuts the way's points in the medium move by at most 2 texels, across the way."""
    record = DensityTexture(source=NoiseDensity(size=64))
    cloud = place(LocalMedium(transform=POSE, density=record), np.ones((64, 64, 64)))
    rays, source = lines(7, 30), LIGHTS[light]
    lamp = None if isinstance(source, DirectionalLight) else relate(source, rays)
    cuts = np.sort(shadow_cuts([cloud], np.ones((1, 1)), source, rays, lamp=lamp), axis=1)
    t, depth = depths(MEDIA["box"], source, rays, np.inf)
    inverse = np.linalg.inv(POSE.world_from_local)[:3, :3] * 32  # texels per metre
    checked = 0
    for i in range(30):
        shaded = t[depth[i] > 1e-9]
        ends = [c for c in cuts[i] if not np.isnan(c)]
        for a, b in itertools.pairwise(ends):
            if not len(shaded) or a < shaded[0] or b > shaded[-1]:
                continue
            p, q = (rays.origin[:, i] + rays.direction[:, i] * x for x in (a, b))
            if isinstance(source, DirectionalLight):
                way = inverse @ np.array(source.direction)
                moved = inverse @ (q - p)
                moved = moved - way * (moved @ way) / (way @ way)
                assert np.linalg.norm(moved) <= 1.01 * CELLS
            checked += 1
    assert checked > 30
    swept = np.linalg.norm(inverse @ rays.direction, axis=0).max() * STOP
    assert np.isfinite(cuts).sum(axis=1).max() <= swept / CELLS + 60


def test_a_texture_too_fine_is_refused():
    record = DensityTexture(source=NoiseDensity(size=4), scale=(1e6, 1e6, 1e6))
    haze = place(Medium(density=record, height_fog=HeightFog(max_height=-1.0)), np.ones((4, 4, 4)))
    ray = Lines(np.zeros((3, 1)), np.array([[1.0], [0.0], [0.0]]), np.zeros(1), np.array([99.0]))
    low = DirectionalLight(direction=(0, -1, 0), irradiance=(1, 1, 1))
    with pytest.raises(InputError, match=r"^density\.scale: makes a ray's ways to a light sweep over \d+ cells"):
        shadow_cuts([haze], np.ones((1, 1)), low, ray)
