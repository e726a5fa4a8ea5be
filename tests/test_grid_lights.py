"""Lights and media that are told once for a grid: in its parts the bits of what each part works out for itself."""

from __future__ import annotations

import numpy as np
import pytest

from froxel_ref import grid_lights, lamps, lighting, media
from froxel_ref.arrays import Index
from froxel_ref.checkerboard import lattice_froxels, lattices
from froxel_ref.fog_stages import pieces
from froxel_ref.frame import run_frame
from froxel_ref.grid import Froxels, make_froxels
from froxel_ref.grid_lights import lights_in, relate_lights, shine
from froxel_ref.jobs import Job
from froxel_ref.scene import (
    Camera,
    DirectionalLight,
    HeightFog,
    LocalMedium,
    Medium,
    PointLight,
    Scene,
    SpotLight,
    Transform,
)
from froxel_ref.settings import Grid, Settings, replace

GRID = Grid(width=11, height=7, depth=9, near=0.5, far=20.0)
LIGHTS = (
    DirectionalLight(direction=(0.2, 1.0, 0.1), irradiance=(2, 2, 2)),
    PointLight(position=(0.0, 2.0, -4.0), intensity=(9, 5, 2), radius=3, min_distance=1.5),
    SpotLight(position=(1.0, 4.0, -8.0), direction=(0.0, -1.0, 0.2), intensity=(4, 5, 2), radius=6, outer_angle=40),
    PointLight(position=(0.5, 1.0, -9.0), intensity=(1, 2, 3), falloff="inverse_square"),
    PointLight(position=(0.5, 1.0, 90.0), intensity=(1, 2, 3), radius=2),
)
SCENE = Scene(
    global_media=(Medium(extinction=0.1, phase_anisotropy=0.5, height_fog=HeightFog(falloff=0.3)),), lights=LIGHTS,
    local_media=(LocalMedium(extinction=0.8, phase_anisotropy=-0.3, emissive=(0, 0.1, 0),
                             transform=Transform(translate=(0, 1.5, -4), scale=(1.5, 1, 1))),))


def parts(froxels: Froxels) -> list[tuple[Froxels, Index]]:
    whole = slice(0, 7), slice(0, 11)
    slabs = [(slice(a, b), *whole) for a, b in ((0, 4), (4, 5), (5, 9))]
    return [(lattice_froxels(froxels, box), box) for box in (*lattices((9, 7, 11), 0), *lattices((9, 7, 11), 1))] + [
        (froxels._replace(depths=froxels.depths[box[0]]), box) for box in slabs]


@pytest.mark.parametrize("dtype", [np.float64, np.float32])
@pytest.mark.parametrize("mixing", ["weighted", "mixture"])
@pytest.mark.parametrize("restrict", [True, False])
def test_a_part_has_its_own_light(dtype: type, mixing: str, restrict: bool) -> None:
    how = replace(Settings(grid=GRID), phase_mixing=mixing)
    froxels = make_froxels(Camera(), GRID, dtype=dtype)
    every = (*SCENE.global_media, *SCENE.local_media)
    lobes = lighting.lobes_of(media.even_anisotropies(every, how), dtype=np.dtype(dtype))
    assert len(lobes) == (2 if mixing == "mixture" else 0)
    lights = relate_lights(LIGHTS, froxels, restrict=restrict, lobes=lobes)
    terms = media.media_terms(SCENE, froxels, {}, how, restrict=restrict)
    span = media.anisotropy_span(every, how)
    lit = 0
    for part, box in parts(froxels):
        buffer = media.voxelise(SCENE, part, {}, how, restrict=restrict)
        shared = media.voxelise(SCENE, part, {}, how, restrict=restrict, terms=media.terms_in(terms, box))
        for one, other in zip(buffer[:4], shared[:4], strict=True):
            assert np.array_equal(*np.broadcast_arrays(one, other))
        want, got = (lighting.in_scattering(buffer, given, part, restrict=restrict, anisotropy_span=span)
                     for given in (LIGHTS, lights_in(lights, box)))
        assert np.array_equal(want, got)
        lit += int(want.any())
    assert lit == 11


def test_a_medium_is_left_out_where_a_part_has_none_of_it() -> None:
    froxels = make_froxels(Camera(), GRID)
    terms = media.media_terms(SCENE, froxels, {}, Settings())
    counts = [len(media.terms_in(terms, box)) for _, box in parts(froxels)]
    assert counts[:8] == [2] * 8
    assert min(counts) == 1
    assert len(media.media_terms(SCENE, froxels._replace(depths=froxels.depths[:2]), {}, Settings())) == 1


@pytest.mark.parametrize("how", [{"checkerboard": True}, {"merged": True}, {"merged": True, "checkerboard": True}])
def test_lights_and_media_are_told_once(how: dict[str, bool], monkeypatch: pytest.MonkeyPatch) -> None:
    calls: dict[str, int] = {}

    def counted(module: object, name: str) -> None:
        whole = getattr(module, name)

        def call(*arguments: object, **options: object) -> object:
            calls[name] = calls.get(name, 0) + 1
            return whole(*arguments, **options)

        monkeypatch.setattr(module, name, call)

    fog = Medium(extinction=0.1, phase_anisotropy=0.5)
    for module, name in ((grid_lights, "sun_rays"), (grid_lights, "sun_light"), (lamps, "light_rays"),
                         (media, "_terms")):
        counted(module, name)
    monkeypatch.setattr("froxel_ref.fog_stages.SLAB", 1)
    settings = replace(Settings(grid=GRID), **how)
    scene = Scene(global_media=(fog,), lights=LIGHTS)
    assert len(pieces(Job(scene, settings, None))) >= 4  # type: ignore[arg-type]
    run_frame(scene, settings)
    assert calls == {"sun_rays": 1, "sun_light": 1, "light_rays": 1, "_terms": 1}


def test_a_lobe_that_varies_shines_otherwise_at_every_depth() -> None:
    froxels = make_froxels(Camera(), GRID)
    lights = relate_lights(LIGHTS, froxels)
    fog = np.ones((3, 1, 1, 1))
    lobe = lamps.make_lobe(fog, 1.0, True, "henyey_greenstein", np.full((1, 1, 1), 0.5), np.dtype(float), span=(0, 0.5))
    assert shine(lights, lobe) is None
    even = lamps.make_lobe(fog, 1.0, True, "henyey_greenstein", 0.5, np.dtype(float))
    found = shine(lights, even)
    assert found is not None
    known = relate_lights(LIGHTS, froxels, lobes=[even])
    assert shine(known, even) is shine(known, even)
    part = shine(lights_in(known, (slice(0, 9), slice(1, 7, 2), slice(0, 11, 2))), even)
    assert part is not None
    assert np.array_equal(part[0], found[0][:, :, 1::2, ::2])
