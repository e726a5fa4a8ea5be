"""How the frame tends to the truth as its slices get thinner, on every built-in scene.

    python benchmarks/convergence.py [--data DIR] [--integrator NAME] [--scenes NAME ...] [--lamp-gap M]

The fog along the rays through the froxels' centres, at eight depths up to the far boundary, for 32 to 512
slices, against `froxel_ref.truth.trace_depths` to 1e-9. The error is the root mean square over rays, depths
and colours, over that of the truth; the order is the fitted slope of its logarithm. Both begin at the near
boundary (the frame fills the segment in front of it with the values of its first slice).

"smooth rays" are those that meet no edge: on which the medium has no jump and no lamp passes nearer than
0.5 m. There the integrator's own order shows. Where a medium begins or ends within a slice, its edge is
misplaced by up to half a slice: order 1 on the rays through it, whatever the integrator.
"""

from __future__ import annotations

import argparse
import dataclasses
from collections.abc import Iterator

import numpy as np
from timing import table

from froxel_ref import InputError, load, load_assets, run_frame
from froxel_ref.breaks import relate
from froxel_ref.density import place
from froxel_ref.geometry import camera_rays
from froxel_ref.grid import make_froxels
from froxel_ref.optical_depth import Lines, support
from froxel_ref.scene import Camera, DirectionalLight, HeightFog, Medium, PointLight, Scene
from froxel_ref.scene_files import builtin
from froxel_ref.settings import Grid, Settings, replace
from froxel_ref.truth import trace_depths

SLICES = (32, 64, 128, 256, 512)
WIDTH, HEIGHT, DEPTHS = 32, 18, 8


# Nothing in it has a kink: here an integrator's own order shows undisturbed.
SMOOTH = Scene(
    name="smooth", camera=Camera(position=(0, 1.7, 0), target=(0.2, 1.4, -4)),
    global_media=(Medium(extinction=0.08, phase_anisotropy=0.3,
                         height_fog=HeightFog(start=-99, falloff=0.02)),),
    lights=(PointLight(position=(5, 6, -8), intensity=(9, 8, 7), falloff="inverse_square"),))


def columns(scene) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Origin and directions of the froxels' rays, and metres per metre of depth."""
    rays = camera_rays(scene.camera, WIDTH, HEIGHT)
    length = rays.length.reshape(-1)
    per_depth = [np.broadcast_to(c, rays.length.shape).reshape(-1) for c in rays.per_depth]
    directions = np.stack(per_depth) / length
    return np.asarray(rays.origin)[:, np.newaxis], directions, length


def smooth(scene, lines: Lines, gap: float) -> np.ndarray:
    """Rays without jumps of density or lamps close by; cones and textures have kinks, which are left in."""
    result = np.ones(lines.start.shape, bool)
    for medium in (*scene.global_media, *scene.local_media):
        enter, leave = support(place(dataclasses.replace(medium, density=None)), lines)
        result &= (leave <= enter) | ((enter <= lines.start) & (leave >= lines.stop))
    for light in scene.all_lights:
        if not isinstance(light, DirectionalLight):
            lamp = relate(light, lines)
            beside = (lamp.nearest < lines.start - gap) | (lamp.nearest > lines.stop + gap)
            result &= beside | (lamp.across2 > gap * gap)
    return result


def scene_rows(name: str, data: str | None, integrator: str, gap: float) -> Iterator[tuple[object, ...]]:
    if name == SMOOTH.name:
        scene, settings, folder = SMOOTH, Settings(grid=Grid(far=32.0)), None
    else:
        scene, settings, folder = load(name, data=data)
    near, far = settings.grid.near, settings.grid.far
    origin, directions, length = columns(scene)
    coarse = make_froxels(scene.camera, Grid(width=WIDTH, height=HEIGHT, depth=DEPTHS, near=near, far=far,
                                             distribution=settings.grid.distribution))
    boundaries = coarse.boundaries[1:, 0, 0]
    assets = load_assets(scene, folder)
    truth = trace_depths(scene, origin, directions, boundaries[:, np.newaxis] * length, starts=near * length,
                         settings=settings, assets=assets, rtol=1e-9)
    lines = Lines(np.broadcast_to(origin, directions.shape), directions, near * length, far * length)
    plain = smooth(scene, lines, gap)
    errors: list[tuple[float, float]] = []
    for depth in SLICES:
        grid = dataclasses.replace(settings.grid, width=WIDTH, height=HEIGHT, depth=depth)
        run = replace(dataclasses.replace(settings, grid=grid), integrator=integrator, integrate_from="near")
        frame = run_frame(scene, run, assets=assets, outputs=["integrate/radiance"])
        got = np.broadcast_to(frame["integrate/radiance"], (3, depth, HEIGHT, WIDTH))
        got = got[:, depth // DEPTHS - 1::depth // DEPTHS].reshape(3, DEPTHS, -1)
        errors.append((relative(got, truth.radiance), relative(got[..., plain], truth.radiance[..., plain])))
    for label, share, column in (("all rays", 1.0, 0), ("smooth rays", plain.mean(), 1)):
        series = [e[column] for e in errors]
        yield (name, label, f"{share:.0%}", *[f"{e:.1e}" for e in series], order(series),
               f"{truth.converged.mean():.0%}")


def relative(got: np.ndarray, want: np.ndarray) -> float:
    scale = float(np.sqrt(np.mean(want**2))) if want.size else 0.0
    return float(np.sqrt(np.mean((got - want) ** 2))) / scale if scale else 0.0


def order(errors: list[float]) -> str:
    """The fitted slope over the last four refinements, while the truth's tolerance is far below."""
    e = np.array(errors[1:])
    if not e.any():
        return "no light"
    if (e < 1e-10).all():
        return "exact"
    use = e > 4e-9
    if use.sum() < 2:
        return "-"
    return f"{-np.polyfit(np.log(np.array(SLICES[1:])[use]), np.log(e[use]), 1)[0]:.2f}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--data", help="folder of the files that scenes name")
    parser.add_argument("--integrator", default="analytic")
    parser.add_argument("--scenes", nargs="+", default=[SMOOTH.name, *builtin()])
    parser.add_argument("--lamp-gap", type=float, default=0.5, metavar="M")
    args = parser.parse_args()
    rows: list[tuple[object, ...]] = []
    for name in args.scenes:
        try:
            rows += scene_rows(name, args.data, args.integrator, args.lamp_gap)
        except InputError as error:
            print(f"{name}: left out: {error}")
    print(f"integrator {args.integrator!r}; expected: its own order on smooth rays (2 for analytic), "
          "at least 1 where\nmedia have edges; steeper where a lamp's peak is only just being resolved\n")
    print(table(rows, ("scene", "rays", "share", *map(str, SLICES), "order", "truth converged")))


if __name__ == "__main__":
    main()
