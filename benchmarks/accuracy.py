"""How exact the foundations are: worst errors in ulp against arithmetic with 40 digits.

    python benchmarks/accuracy.py [--samples N]

Prints, for float64 and float32: the phase functions over g in (−1, 1) and every angle, half of them near
±1; their integrals over the sphere; the slice integral for σd from 0 to 1e30, denormals included; and a
whole frame of uniform fog under a sun against its closed form. Needs mpmath (the extra `test`).

An ulp is counted as relative error over eps (2⁻⁵² or 2⁻²³), and, stricter by up to two, as the spacing of
numbers at the exact result.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable, Iterator

import mpmath
import numpy as np
from timing import table

from froxel_ref import Settings, run_frame
from froxel_ref.frame import Frame
from froxel_ref.geometry import camera_rays
from froxel_ref.integrate import slice_integral
from froxel_ref.phase import PHASE
from froxel_ref.scene import Camera, DirectionalLight, Medium, Scene
from froxel_ref.settings import Grid

mp = mpmath.mp.clone()
mp.dps = 50
TYPES = {"float64": np.float64, "float32": np.float32}


def ulps(got: float, want: mpmath.mpf, dtype: type) -> tuple[float, float]:
    """Error over eps·|want|, and over the spacing of the type at it."""
    if want == 0:
        return (0.0, 0.0) if got == 0 else (math.inf, math.inf)
    error = abs(mp.mpf(float(got)) - want)
    return (float(error / abs(want) / float(np.finfo(dtype).eps)),
            float(error / mp.mpf(float(np.spacing(dtype(float(abs(want))))))))


def exact_phase(name: str, cosine: float | mpmath.mpf, anisotropy: float) -> mpmath.mpf:
    """The definitions, straight from the books, in 50 digits."""
    c, g = mp.mpf(cosine), mp.mpf(anisotropy)
    lobe = (1 + g * g - 2 * g * c) ** mp.mpf("1.5")
    if name == "rayleigh":
        return 3 / (16 * mp.pi) * (1 + c * c)
    if name == "henyey_greenstein":
        return (1 - g * g) / (4 * mp.pi * lobe)
    if name == "cornette_shanks":
        return 3 / (8 * mp.pi) * (1 - g * g) * (1 + c * c) / ((2 + g * g) * lobe)
    h = abs(g)
    rest = max(1 - mp.mpf("0.55") * h - mp.mpf("0.55") * h * h, mp.mpf("0.0595"))
    k = mp.sign(g) * (1 - (1 - h) * rest)
    return (1 - k * k) / (4 * mp.pi * (1 - k * c) ** 2)


def anisotropies(rng: np.random.Generator, count: int, dtype: type) -> np.ndarray:
    """Half uniform in (−1, 1), half so near to ±1 that the distance is uniform in its logarithm."""
    digits = -np.log10(np.finfo(dtype).epsneg)
    near = np.copysign(1 - 10 ** -rng.uniform(0, digits, count // 2), rng.uniform(-1, 1, count // 2))
    values = np.concatenate([rng.uniform(-1, 1, count - count // 2), near]).astype(dtype)
    edge = np.nextafter(dtype(1), dtype(0))
    return np.clip(values, -edge, edge)


def phase_rows(samples: int) -> Iterator[tuple[object, ...]]:
    for name in ("henyey_greenstein", "rayleigh", "schlick", "cornette_shanks"):
        for type_name, dtype in TYPES.items():
            rng = np.random.default_rng(7)
            g, cosine = anisotropies(rng, samples, dtype), anisotropies(rng, samples, dtype)[::-1].copy()
            cosine[:3] = -1, 0, 1
            got = np.broadcast_to(PHASE[name](cosine, g), cosine.shape)
            worst = np.array([ulps(p, exact_phase(name, float(c), float(a)), dtype)
                              for p, c, a in zip(got, cosine, g, strict=True)]).max(axis=0)
            yield name, type_name, f"{worst[0]:.2f}", f"{worst[1]:.2f}", sphere_defect(name, dtype)


def sphere_defect(name: str, dtype: type) -> str:
    """The largest |∫p dΩ − 1| for |g| ≤ 0.99, by Gauss–Legendre in a variable that flattens the lobe."""
    if dtype is np.float32:
        return "-"
    x, weight = np.polynomial.legendre.leggauss(400)
    worst = 0.0
    for g in (-0.99, -0.9, -0.5, 0.0, 0.2, 0.7, 0.9, 0.95, 0.99):
        # 1 ∓ cos θ = ε(e^(ku) − 1), u in [0, 1], spreads the lobe of width (1 − |g|)² over the nodes.
        e = (1 - abs(g)) ** 2
        k = math.log1p(2 / e)
        u = (x + 1) / 2
        turn = e * np.expm1(k * u)
        slope = e * k * np.exp(k * u)
        value = PHASE[name](np.clip(turn - 1 if g < 0 else 1 - turn, -1, 1), g,
                            versine=2 - turn if g < 0 else turn)
        worst = max(worst, abs(2 * math.pi * float(np.sum(weight / 2 * slope * value)) - 1))
    return f"{worst:.1e}"


def slice_rows(samples: int) -> Iterator[tuple[object, ...]]:
    for type_name, dtype in TYPES.items():
        rng = np.random.default_rng(11)
        tiny = float(np.log10(np.finfo(dtype).smallest_subnormal))
        length = (10.0 ** rng.uniform(-6, 4, samples)).astype(dtype)
        exponents = rng.uniform(tiny, 30, samples // 2), rng.uniform(-8, 3, samples - samples // 2)
        depth = 10.0 ** np.concatenate(exponents)
        extinction = np.minimum(depth / length, float(np.finfo(dtype).max)).astype(dtype)
        extinction[:4] = 0.0, np.finfo(dtype).smallest_subnormal, np.finfo(dtype).tiny, 1.0
        source = np.ones(samples, dtype)
        light, through = slice_integral(source, extinction, length)
        worst, worst_t = [], []
        for L, T, s, d in zip(light, through, extinction, length, strict=True):
            sigma, d = mp.mpf(float(s)), mp.mpf(float(d))
            x = sigma * d
            worst.append(ulps(L, -mp.expm1(-x) / sigma if sigma else d, dtype))
            if x < 80:  # beyond, the transmittance leaves the normal numbers of float32
                worst_t.append(ulps(T, mp.exp(-x), dtype)[1] / (1 + float(x)))
        a, b = np.array(worst).max(axis=0)
        yield "slice integral", type_name, f"{a:.2f}", f"{b:.2f}", f"{max(worst_t):.2f}"


def frame_rows() -> Iterator[tuple[object, ...]]:
    """The worst over all slices, pixels and channels of 24×16×64 froxels, for each g."""
    light = DirectionalLight(direction=(0.4, 0.7, -0.5), irradiance=(3.0, 2.0, 1.0))
    for g in (-0.9, -0.4, 0.0, 0.3, 0.6, 0.9, 0.99, 0.999):
        medium = Medium(albedo=(0.9, 0.5, 1.0), extinction=0.02, phase_anisotropy=g)
        scene = Scene(camera=Camera(target=(0.3, 1.9, -1.0), vertical_fov=75.0, width=24, height=16),
                      global_media=(medium,), lights=(light,))
        frame = run_frame(scene, Settings(grid=Grid(width=24, height=16)))
        yield g, *frame_error(scene, frame, light, medium)


def frame_error(scene: Scene, frame: Frame, light: DirectionalLight, medium: Medium) -> tuple[str, str]:
    rays = camera_rays(scene.camera, 24, 16)
    boundaries = [mp.mpf(float(z)) for z in frame["grid/slice_depth"]]
    direction = [mp.mpf(c) for c in light.direction]
    sigma, worst, worst_t = mp.mpf(medium.extinction), 0.0, 0.0
    components = [np.broadcast_to(c, (16, 24)) for c in rays.per_depth]
    for j in range(0, 16, 3):
        for i in range(0, 24, 3):
            p = [mp.mpf(float(c[j, i])) for c in components]
            length = mp.sqrt(sum(c * c for c in p))
            cosine = sum(a * b for a, b in zip(p, direction, strict=True)) / length / mp.sqrt(
                sum(c * c for c in direction))
            phase = exact_phase("henyey_greenstein", cosine, medium.phase_anisotropy)
            for k, z in enumerate(boundaries):
                through = mp.exp(-sigma * z * length)
                want = mp.mpf(medium.albedo[0]) * light.irradiance[0] * phase * (1 - through)
                got, got_t = frame["integrate/radiance"][0, k, j, i], frame["integrate/transmittance"][k, j, i]
                worst = max(worst, ulps(got, want, np.float64)[1] / (k + 1))
                worst_t = max(worst_t, ulps(got_t, through, np.float64)[1] / (k + 1))
    return f"{worst:.2f}", f"{worst_t:.2f}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--samples", type=int, default=20000)
    samples = parser.parse_args().samples
    show: list[tuple[tuple[str, ...], Callable[[], Iterator[tuple[object, ...]]]]] = [
        (("phase function", "type", "worst, eps", "worst, spacings", "|integral - 1|"),
         lambda: phase_rows(samples)),
        (("slice integral, x = σd", "type", "worst, eps", "worst, spacings", "T: spacings/(1+x)"),
         lambda: slice_rows(samples)),
        (("uniform fog, a sun, g", "radiance: spacings per slice", "transmittance"), frame_rows),
    ]
    for head, rows in show:
        print(table(list(rows()), head) + "\n")


if __name__ == "__main__":
    main()
