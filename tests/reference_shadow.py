"""The first surface along a light's ray, one ray and one surface at a time, in rationals or 60 digits.

Rays come from the definition of a raster, in rationals. Surfaces are taken from theirs: a plane by its
equation, a box by its six faces, a sphere by its quadratic, sheets of triangles by every triangle. A hit is
a parameter t of any sign; which of them count is settled at the end.
"""

from __future__ import annotations

from fractions import Fraction

import mpmath
import numpy as np
from reference_geometry import cross, dot, exact, height_field_triangles, solve, subtract

from froxel_ref.scene import Box, HeightField, Plane, Sphere


def ray(raster, row, column):
    """Origin and direction of a texel's ray, exactly as the raster defines it."""
    x, y = column + Fraction(1, 2), row + Fraction(1, 2)
    place = tuple(b + x * a + y * d for b, a, d in zip(exact(raster.base), exact(raster.across), exact(raster.down),
                                                       strict=True))
    return (place, exact(raster.direction)) if raster.origin is None else (exact(raster.origin), place)


def plane_hits(plane, origin, direction):
    n = exact(plane.normal)
    slope = dot(n, direction)
    return [dot(n, subtract(exact(plane.point), origin)) / slope] if slope else []


def box_range(box, origin, direction):
    """Where the ray enters and leaves a box, or None: the least and the greatest hit of its faces."""
    pose = box.transform.world_from_local
    edges, center = [exact(pose[:3, k]) for k in range(3)], exact(pose[:3, 3])
    hits = []
    for k in range(3):
        e, f, g = edges[k], edges[(k + 1) % 3], edges[(k + 2) % 3]
        for side in (-1, 1):
            middle = tuple(c + side * a for c, a in zip(center, e, strict=True))
            found = solve((f, g, tuple(-c for c in direction)), subtract(origin, middle))
            if found and abs(found[0]) <= 1 and abs(found[1]) <= 1:
                hits.append(found[2])
    return (min(hits), max(hits)) if hits and min(hits) < max(hits) else None


def sphere_range(sphere, origin, direction):
    with mpmath.workdps(60):
        def digits(vector):
            return [mpmath.mpf(c.numerator) / c.denominator for c in vector]
        d, q = digits(direction), digits(subtract(origin, exact(sphere.center)))
        a, b, c = dot(d, d), dot(q, d), dot(q, q) - mpmath.mpf(sphere.radius)**2
        inside = b * b - a * c
        return ((-b - mpmath.sqrt(inside)) / a, (-b + mpmath.sqrt(inside)) / a) if inside > 0 else None


def triangle_hits(triangle, origin, direction):
    """By the signs of three volumes: of the ray with each edge."""
    a, b, c = (subtract(exact(corner), origin) for corner in triangle)
    u, v, w = dot(cross(b, c), direction), dot(cross(c, a), direction), dot(cross(a, b), direction)
    total = u + v + w
    if total == 0 or min(u, v, w) < 0 < max(u, v, w):
        return []
    return [dot(a, cross(b, c)) / total]


def triangles(surface, heights=None, mesh=None):
    """World corners of the triangles of a height field or of a mesh (vertices, faces)."""
    pose = surface.transform.world_from_local
    if isinstance(surface, HeightField):
        return height_field_triangles(pose, heights)
    return [tuple(tuple(pose[:3, :3] @ mesh[0][k] + pose[:3, 3]) for k in face) for face in mesh[1]]


def first_hit(surface, raster, row, column, sheet=()):
    """t of the first hit as a float, inf if there is none, 0 where a lamp is within a solid."""
    origin, direction = ray(raster, row, column)
    least = -np.inf if raster.origin is None else 0
    if isinstance(surface, Box | Sphere):
        span = (box_range if isinstance(surface, Box) else sphere_range)(surface, origin, direction)
        return float("inf") if span is None or span[1] <= least else float(max(span[0], least))
    if isinstance(surface, Plane):
        hits = plane_hits(surface, origin, direction)
    else:
        hits = [t for triangle in sheet for t in triangle_hits(triangle, origin, direction)]
    return float(min((t for t in hits if t > least), default=float("inf")))
