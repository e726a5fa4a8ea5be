"""What froxel_ref's in-scattering is measured against: the thesis's listings in NumPy, and numba kernels.

All take the same lights and media and return (3, D, H, W) float32.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from froxel_ref.grid import Froxels
from froxel_ref.scene import PointLight

Array = NDArray[np.float32]


# --- (a) the thesis, as one would port it -----------------------------------------------------------


def normalize(v: Array) -> Array:
    """Vectors of length 1; the components are on the last axis."""
    return v / np.sqrt(np.sum(v * v, axis=-1, keepdims=True))


def phase(V: Array, L: Array, g: Array) -> Array:
    """Henyey–Greenstein of the cosine between −V and L."""
    cos_theta = -np.sum(V * L, axis=-1)
    return (1 - g * g) / (np.float32(4 * math.pi) * (1 + g * g - 2 * g * cos_theta) ** np.float32(1.5))


def punctual(light: PointLight, position: Array, V: Array, g: Array) -> Array:
    """One light at every froxel [Dörries 2020, listing 3.7]."""
    to_light = np.array(light.position, np.float32) - position
    L = normalize(to_light)
    distance = np.sqrt(np.sum(to_light * to_light, axis=-1))
    d2 = distance * distance
    window = np.clip(1 - (d2 / np.float32(light.radius**2)) ** 2, 0, 1) ** 2
    attenuation = window / np.maximum(d2, np.float32(light.min_distance**2))
    return np.array(light.intensity, np.float32) * (attenuation * phase(V, L, g))[..., np.newaxis]


def transcription(froxels: Froxels, scattering: Array, g: Array, lights: Sequence[PointLight]) -> Array:
    """Whole-volume arrays of vectors, light after light [Dörries 2020, listings 3.2 and 3.7]."""
    shape = (froxels.depths.shape[0], *froxels.rays.length.shape)
    direction = np.stack([np.broadcast_to(c, shape[1:]) for c in froxels.rays.per_depth], axis=-1)
    camera = np.array(froxels.rays.origin, np.float32)
    position = camera + direction * froxels.depths[..., np.newaxis]
    V = normalize(camera - position)
    lighting = np.zeros((*shape, 3), np.float32)
    anisotropy = np.ascontiguousarray(np.broadcast_to(g, shape))
    for light in lights:
        lighting += punctual(light, position, V, anisotropy)
    lighting *= np.moveaxis(np.broadcast_to(scattering, (3, *shape)), 0, -1)
    return np.moveaxis(lighting, -1, 0)


# --- (b) numba --------------------------------------------------------------------------------------


def rows(lights: Sequence[PointLight]) -> Array:
    """Position, 1/r², d_min² and intensity of each light."""
    return np.array([(*light.position, 1.0 / light.radius**2, light.min_distance**2, *light.intensity)
                     for light in lights], np.float32)


def listings_kernel(fastmath: bool) -> Any:
    """The listings' arithmetic, a froxel at a time, lights tested by their radius."""
    import numba

    one, four_pi = np.float32(1.0), np.float32(4.0 * math.pi)

    @numba.njit(parallel=True, fastmath=fastmath)
    def kernel(depths, px, py, pz, camera, table, scattering, g, out):  # type: ignore[no-untyped-def]
        for z in numba.prange(depths.size):
            for y in range(px.shape[0]):
                for x in range(px.shape[1]):
                    ox, oy, oz = px[y, x] * depths[z], py[y, x] * depths[z], pz[y, x] * depths[z]
                    inverse = one / math.sqrt(ox * ox + oy * oy + oz * oz)
                    anisotropy = g[z, y, x]
                    square = anisotropy * anisotropy
                    red = green = blue = np.float32(0.0)
                    for k in range(table.shape[0]):
                        lx = table[k, 0] - (camera[0] + ox)
                        ly = table[k, 1] - (camera[1] + oy)
                        lz = table[k, 2] - (camera[2] + oz)
                        d2 = lx * lx + ly * ly + lz * lz
                        share = d2 * table[k, 3]
                        if share < one:
                            cosine = (ox * lx + oy * ly + oz * lz) * inverse / math.sqrt(d2)
                            base = one + square - (anisotropy + anisotropy) * cosine
                            window = one - share * share
                            weight = (window * window / max(d2, table[k, 4]) * (one - square)
                                      / (four_pi * base * math.sqrt(base)))
                            red += weight * table[k, 5]
                            green += weight * table[k, 6]
                            blue += weight * table[k, 7]
                    out[0, z, y, x] = red * scattering[0, z, y, x]
                    out[1, z, y, x] = green * scattering[1, z, y, x]
                    out[2, z, y, x] = blue * scattering[2, z, y, x]

    def run(froxels: Froxels, scattering: Array, g: Array, lights: Sequence[PointLight]) -> Array:
        shape = (froxels.depths.shape[0], *froxels.rays.length.shape)
        out = np.empty((3, *shape), np.float32)
        p = [np.broadcast_to(c, shape[1:]) for c in froxels.rays.per_depth]
        kernel(froxels.depths[:, 0, 0], *p, np.array(froxels.rays.origin, np.float32), rows(lights),
               np.broadcast_to(scattering, (3, *shape)), np.broadcast_to(g, shape), out)
        return out

    return run


def ray_kernel(fastmath: bool) -> Any:
    """froxel_ref's arithmetic along the ray, a froxel at a time, lights tested by their radius."""
    import numba

    one, two = np.float32(1.0), np.float32(2.0)

    @numba.njit(parallel=True, fastmath=fastmath)
    def relate(px, py, pz, length, camera, table, nearest, across2):  # type: ignore[no-untyped-def]
        for y in numba.prange(length.shape[0]):
            for k in range(table.shape[0]):
                qx, qy, qz = table[k, 0] - camera[0], table[k, 1] - camera[1], table[k, 2] - camera[2]
                for x in range(length.shape[1]):
                    a, b, c = px[y, x], py[y, x], pz[y, x]
                    nx, ny, nz = qy * c - qz * b, qz * a - qx * c, qx * b - qy * a
                    inverse = one / length[y, x]
                    nearest[y, x, k] = (qx * a + qy * b + qz * c) * inverse
                    across2[y, x, k] = (nx * nx + ny * ny + nz * nz) * inverse * inverse

    @numba.njit(parallel=True, fastmath=fastmath)
    def kernel(depths, length, nearest, across2, table, scattering, g, out):  # type: ignore[no-untyped-def]
        for z in numba.prange(depths.size):
            for y in range(length.shape[0]):
                for x in range(length.shape[1]):
                    t = depths[z] * length[y, x]
                    rest = one - g[z, y, x]
                    slope = two * g[z, y, x] / (rest * rest)
                    red = green = blue = np.float32(0.0)
                    for k in range(table.shape[0]):
                        s = t - nearest[y, x, k]
                        d2 = s * s + across2[y, x, k]
                        share = d2 * table[k, 3]
                        if share < one:
                            d = math.sqrt(d2)
                            e = d + slope * (d + s)
                            window = one - share * share
                            weight = window * window / (e * math.sqrt(d * e))
                            if d2 < table[k, 4]:
                                weight *= d2 / table[k, 4]
                            red += weight * table[k, 5]
                            green += weight * table[k, 6]
                            blue += weight * table[k, 7]
                    factor = (one + g[z, y, x]) / (np.float32(4.0 * math.pi) * rest * rest)
                    out[0, z, y, x] = red * factor * scattering[0, z, y, x]
                    out[1, z, y, x] = green * factor * scattering[1, z, y, x]
                    out[2, z, y, x] = blue * factor * scattering[2, z, y, x]

    def run(froxels: Froxels, scattering: Array, g: Array, lights: Sequence[PointLight]) -> Array:
        rays, table = froxels.rays, rows(lights)
        shape = (froxels.depths.shape[0], *rays.length.shape)
        out = np.empty((3, *shape), np.float32)
        nearest, across2 = np.empty((2, *shape[1:], len(lights)), np.float32)
        relate(*(np.broadcast_to(c, shape[1:]) for c in rays.per_depth), rays.length,
               np.array(rays.origin, np.float32), table, nearest, across2)
        kernel(froxels.depths[:, 0, 0], rays.length, nearest, across2, table,
               np.broadcast_to(scattering, (3, *shape)), np.broadcast_to(g, shape), out)
        return out

    return run
