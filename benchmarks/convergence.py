"""How the frame tends to the truth as its slices get thinner, on every built-in scene.

    python benchmarks/convergence.py [--data DIR] [--integrator NAME] [--scenes NAME ...] [--lamp-gap M]

The fog along the rays through the froxels' centres, for 32 to 2048 slices, against `froxel_ref.truth.trace`
to 1e-9. Rays are cut into 32 stretches of depth; the error is the root mean square over rays, stretches and
colours, over that of the truth; the order is the fitted slope of its logarithm over the last refinements.
Both begin at the near boundary (the frame fills the segment in front of it with its first slice's values).

"whole rays": the light gathered up to each stretch's end. Where a medium begins or ends within a slice, its
edge is misplaced by up to half a slice: order 1 on the rays through it, whatever the integrator.

"clear stretches": what each stretch that meets no edge sends out of its own front, (L_b − L_a)/T_a of the
frame: within it the medium has no jump, no lamp passes nearer than the gap, and no cone or window begins or
ends. There the integrator's own order shows, on rays through media's edges too. Faces of a texture's cells
are kinks that are left in: order 2 stays once slices are thinner than cells, and is the most that any
integrator reaches there. ("half_step" stores the transmittance up to the middle of slices, which T_a here is
not: its order shows on whole rays.)
"""

from __future__ import annotations

import argparse
import dataclasses
from collections.abc import Iterator, Sequence

import numpy as np
from timing import table

from froxel_ref import InputError, load, load_assets, run_frame
from froxel_ref.assets import Assets
from froxel_ref.breaks import lamp_cuts, relate
from froxel_ref.density import place
from froxel_ref.geometry import camera_rays
from froxel_ref.grid import make_froxels
from froxel_ref.integrate import DEGREES
from froxel_ref.optical_depth import Lines, support
from froxel_ref.scene import Camera, DirectionalLight, HeightFog, Medium, PointLight, Scene
from froxel_ref.scene_files import builtin
from froxel_ref.settings import Grid, Settings, replace
from froxel_ref.truth import trace

SLICES = (32, 64, 128, 256, 512, 1024, 2048)
WIDTH, HEIGHT, STRETCHES = 24, 14, 32
FITTED = 4        # refinements, the finest ones
DARKEST = 1e-3    # transmittance in front of a stretch below which the frame's difference keeps too few digits


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


def clear(scene: Scene, lines: Lines, gap: float) -> np.ndarray:
    """Stretches without jumps of density, lamps close by, or a lamp's cone or window beginning or ending."""
    result = np.ones(lines.start.shape, bool)
    for medium in (*scene.global_media, *scene.local_media):
        enter, leave = support(place(dataclasses.replace(medium, density=None)), lines)
        result &= (leave <= enter) | ((enter <= lines.start) & (leave >= lines.stop))
    for light in scene.all_lights:
        if not isinstance(light, DirectionalLight):
            lamp = relate(light, lines)
            beside = (lamp.nearest < lines.start - gap) | (lamp.nearest > lines.stop + gap)
            result &= beside | (lamp.across2 > gap * gap)
            at = lamp_cuts(lamp) + lamp.nearest[:, np.newaxis]
            result &= ~((at > lines.start[:, np.newaxis]) & (at < lines.stop[:, np.newaxis])).any(axis=1)
    return result


def scene_rows(name: str, data: str | None, integrator: str, gap: float) -> Iterator[tuple[object, ...]]:
    if name == SMOOTH.name:
        scene, settings, folder = SMOOTH, Settings(grid=Grid(far=32.0)), None
    else:
        scene, settings, folder = load(name, data=data)
    near, far = settings.grid.near, settings.grid.far
    origin, directions, length = columns(scene)
    coarse = make_froxels(scene.camera, Grid(width=WIDTH, height=HEIGHT, depth=STRETCHES, near=near, far=far,
                                             distribution=settings.grid.distribution))
    ends = coarse.boundaries[:, 0, 0, np.newaxis] * length
    lines = Lines(np.broadcast_to(origin, (3, ends[1:].size)), np.tile(directions, STRETCHES),
                  ends[:-1].reshape(-1), ends[1:].reshape(-1))
    assets = load_assets(scene, folder)
    truth = trace(scene, *lines[:2], lines.stop, starts=lines.start, settings=settings, assets=assets, rtol=1e-9)
    pieces = truth.radiance.reshape(3, STRETCHES, -1)
    through = np.broadcast_to(truth.transmittance, truth.radiance.shape).reshape(pieces.shape)
    before = np.cumprod(np.concatenate([np.ones_like(through[:, :1]), through[:, :-1]], axis=1), axis=1)
    plain = clear(scene, lines, gap).reshape(STRETCHES, -1)
    if integrator in DEGREES:  # they look into the slices around, and so across an edge next door
        plain[1:] &= plain[:-1].copy()
        plain[:-1] &= plain[1:].copy()
    use = plain & (before > DARKEST).all(axis=0)
    errors: list[tuple[float, float]] = []
    for depth in SLICES:
        light, passed = gathered(scene, settings, assets, integrator, depth)
        own = np.diff(light, axis=1, prepend=0.0) / passed
        errors.append((relative(light, np.cumsum(pieces * before, axis=1)),
                       relative(own[:, use], pieces[:, use])))
    shares = (1.0, float(use.mean()))
    for label, share, series in zip(("whole rays", "clear stretches"), shares, zip(*errors, strict=True), strict=True):
        yield (name, label, f"{share:.0%}", *[f"{e:.1e}" for e in series], order(series),
               f"{truth.converged.mean():.0%}")


def gathered(scene: Scene, settings: Settings, assets: Assets, integrator: str, depth: int
             ) -> tuple[np.ndarray, np.ndarray]:
    """The frame's light up to each stretch's end and transmittance up to its front, (3, stretches, rays)."""
    grid = dataclasses.replace(settings.grid, width=WIDTH, height=HEIGHT, depth=depth)
    run = replace(settings, grid=grid, shadows="off", integrator=integrator, integrate_from="near")
    frame = run_frame(scene, run, assets=assets, outputs=["integrate/radiance", "integrate/transmittance"])
    each = slice(depth // STRETCHES - 1, None, depth // STRETCHES)
    fields = [np.broadcast_to(frame[f"integrate/{name}"], (3, depth, HEIGHT, WIDTH))[:, each].reshape(
        3, STRETCHES, -1) for name in ("radiance", "transmittance")]
    return fields[0], np.concatenate([np.ones_like(fields[1][:, :1]), fields[1][:, :-1]], axis=1)


def relative(got: np.ndarray, want: np.ndarray) -> float:
    scale = float(np.sqrt(np.mean(want**2))) if want.size else 0.0
    return float(np.sqrt(np.mean((got - want) ** 2))) / scale if scale else 0.0


def order(errors: Sequence[float]) -> str:
    """The fitted slope over the last refinements, while the truth's tolerance is far below."""
    e = np.array(errors)
    if not e.any():
        return "no light"
    if (e < 1e-10).all():
        return "exact"
    use = np.flatnonzero(e > 1e-8)[-FITTED - 1:]
    if use.size < 2:
        return "-"
    return f"{-np.polyfit(np.log(np.array(SLICES)[use]), np.log(e[use]), 1)[0]:.2f}"


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
    print(f"integrator {args.integrator!r}; expected: its own order on clear stretches (2 for analytic), and 1 on "
          "rays through\nmedia's edges; in between where few of the rays have any\n")
    print(table(rows, ("scene", "of", "share", *map(str, SLICES), "order", "truth converged")))


if __name__ == "__main__":
    main()
