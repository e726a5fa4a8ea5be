"""Random scenes: each ray at 1e-4 against the same ray in 24 stretches at a tighter tolerance.

A feature that a rule steps over on a whole ray it cannot miss in a 24th of it, so that the two agree only where
nothing was missed. Seeded, a small part of a search over many more rays.
"""

from __future__ import annotations

import numpy as np
import pytest

from froxel_ref.assets import Assets
from froxel_ref.scene import (
    Box,
    DensityTexture,
    DirectionalLight,
    HeightFog,
    LocalMedium,
    Medium,
    PointLight,
    Scene,
    Sphere,
    SpotLight,
    Transform,
    VolumeDensity,
)
from froxel_ref.settings import Settings, Switches
from froxel_ref.truth import trace, trace_depths

STRETCHES = 24


class Dice:
    """Random parts of scenes."""

    def __init__(self, seed, textured):
        self.r, self.textured, self.textures = np.random.default_rng([seed, textured]), textured, {}

    def vec(self, low, high):
        return tuple(self.r.uniform(low, high, 3).tolist())

    def chance(self, p):
        return bool(self.r.random() < p)

    def pose(self):
        if self.chance(0.3):
            matrix = np.concatenate([self.r.normal(size=(3, 3)) + np.eye(3), self.r.uniform(-5, 5, (3, 1))], axis=1)
            return Transform(matrix=tuple(matrix.ravel().tolist()))
        return Transform(translate=self.vec(-5, 5), rotate=self.vec(-180, 180) if self.chance(0.7) else (0, 0, 0),
                         scale=tuple((10 ** self.r.uniform(-1.5, 0.5, 3)).tolist()))

    def texture(self):
        source = VolumeDensity(path=f"{len(self.textures)}.npy")
        n = int(self.r.choice([4, 16, 32, 48]))
        sparse = (self.r.random((n, n, n)) < 10 ** self.r.uniform(-3.5, -1.5)).astype(float)
        self.textures[source] = sparse if n > 4 else self.r.random((4, 3, 5)) ** 2
        return DensityTexture(source=source, bias=self.vec(-1, 1))

    def medium(self, local):
        u, fog = self.r.uniform, None
        if self.chance(0.5):
            fog = (HeightFog(start=u(-0.2, 0.8), falloff=10 ** u(-1, 2), max_height=u(0.2, 1.1)) if local else
                   HeightFog(start=u(-4, 4), falloff=10 ** u(-2, 1), max_height=u(-4, 8) if self.chance(0.5) else None))
        extinction = 10 ** u(-2.5, 2 if local else -0.8)
        options = {"albedo": self.vec(0, 1), "extinction": extinction, "phase_anisotropy": u(-0.8, 0.8),
                   "height_fog": fog}
        if not local:
            return Medium(**options)
        return LocalMedium(shape="box" if self.chance(0.5) else "ellipsoid", transform=self.pose(),
                           density=self.texture() if self.textured else None, **options)

    def light(self):
        if self.chance(0.4):
            axes = [(0, 1, 0), (1, 0, 0), (0, -1, 0)]
            return DirectionalLight(direction=axes[self.r.integers(3)] if self.chance(0.4) else self.vec(-1, 1),
                                    irradiance=self.vec(0, 5))
        options = {"position": self.vec(-7, 7), "intensity": self.vec(1, 20), "radius": self.r.uniform(3, 20),
                   "falloff": "windowed" if self.chance(0.5) else "inverse_square"}
        if self.chance(0.5):
            return PointLight(**options)
        return SpotLight(direction=self.vec(-1, 1), inner_angle=self.r.uniform(1, 20),
                         outer_angle=self.r.uniform(25, 70), **options)

    def scene(self):
        surfaces = (Box(transform=self.pose()), Sphere(center=self.vec(-5, 5), radius=self.r.uniform(0.3, 2.5)))
        return Scene(global_media=tuple(self.medium(False) for _ in range(self.r.integers(0, 2))),
                     local_media=tuple(self.medium(True) for _ in range(self.r.integers(1, 4))),
                     lights=tuple(self.light() for _ in range(self.r.integers(1, 4))), surfaces=surfaces,
                     ambient=self.vec(0, 0.1) if self.chance(0.3) else (0, 0, 0))

    def rays(self, count):
        origin = self.r.uniform(-8, 8, (3, count))
        return origin, self.r.uniform(-5, 5, (3, count)) - origin, 10 ** self.r.uniform(0.3, 1.7, count)


@pytest.mark.parametrize(("seeds", "textured", "volumetric"), [
    (range(60), False, True), (range(100, 120), False, False), (range(200, 240), True, False),
    (range(300, 310), True, True),
], ids=["shadows of media", "plain media", "textures", "shadows of textures"])
def test_whole_rays_agree_with_their_stretches(seeds, textured, volumetric):
    for seed in seeds:
        dice = Dice(seed, textured)
        scene = dice.scene()
        assets = Assets(textures=dice.textures, heights={}, meshes={}, depth=None, radiance=None)
        mixing = str(dice.r.choice(["mixture", "weighted", "mean"]))
        options = {"settings": Settings(switches=Switches(phase_mixing=mixing)), "assets": assets,
                   "shadows": "exact" if dice.chance(0.5) else "off", "volumetric_shadows": volumetric,
                   "sun_distance": 10 ** dice.r.uniform(0, 1.5) if dice.chance(0.5) else np.inf, "threads": 1}
        origins, d, ends = dice.rays(24 if textured else 40)
        whole = trace(scene, origins, d, ends, rtol=1e-4, **options)
        parts = trace_depths(scene, origins, d, np.linspace(0, 1, STRETCHES + 1)[1:, None] * ends, rtol=1e-6, **options)
        want, known = parts.radiance[:, -1], parts.error[:, -1]
        wrong = np.maximum(np.abs(whole.radiance - want) - known, 0.0)
        assert whole.converged.all(), seed
        assert (wrong <= 1e-4 * want).all(), (seed, np.flatnonzero((wrong > 1e-4 * want).any(axis=0)))
        assert (wrong <= 10 * whole.error + 1e-12 * want).all(), seed


def test_a_whole_image_converges_under_all_shadows():
    """Curtains of triangles leave stretches of a rounding's width between shadows; none may count as unknown."""
    from froxel_ref import load, load_assets
    from froxel_ref.truth_image import render_truth

    scene, settings, folder = load("thesis-hall", overrides=["scene.camera.width=32", "scene.camera.height=18"])
    image = render_truth(scene, settings, assets=load_assets(scene, folder), shadows="exact")
    assert image.converged.all()
    assert (image.error <= 1e-4 * image.fog_radiance).all()
