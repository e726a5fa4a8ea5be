"""Slow, scalar, exact geometry: rationals where there is no root, 40 digits where there is one.

Floats are rationals, so given the very rays that the package used, these hits carry no error at all. They are
formulated otherwise than the package: faces and triangles one by one instead of slabs and walks.
"""

from __future__ import annotations

import itertools
import math
from fractions import Fraction

import mpmath

Vector = tuple  # of three numbers


def dot(a, b):
    return sum(x * y for x, y in zip(a, b, strict=True))


def cross(a, b):
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


def subtract(a, b):
    return tuple(x - y for x, y in zip(a, b, strict=True))


def exact(vector):
    return tuple(Fraction(float(component)) for component in vector)


def camera_ray(camera, width, height, x, y):
    """World metres per metre of view depth through raster position (x, y), by Gram-Schmidt, in 40 digits."""
    with mpmath.workdps(40):
        forward = [mpmath.mpf(b) - mpmath.mpf(a) for a, b in zip(camera.position, camera.target, strict=True)]
        forward = [c / mpmath.sqrt(dot(forward, forward)) for c in forward]
        up = [mpmath.mpf(c) for c in camera.up]
        along = dot(up, forward)
        up = [c - along * f for c, f in zip(up, forward, strict=True)]
        up = [c / mpmath.sqrt(dot(up, up)) for c in up]
        right = cross(forward, up)
        tangent = mpmath.tan(mpmath.mpf(camera.vertical_fov) * mpmath.pi / 360)
        u = (mpmath.mpf(x) / width - mpmath.mpf(1) / 2) * 2 * tangent * camera.width / camera.height
        v = (mpmath.mpf(1) / 2 - mpmath.mpf(y) / height) * 2 * tangent
        return tuple(f + u * r + v * p for f, r, p in zip(forward, right, up, strict=True))


def project(camera, width, height, point):
    """View depth of a world point and its raster position (None behind the camera), in floats."""
    forward = subtract(camera.target, camera.position)
    forward = tuple(c / math.sqrt(dot(forward, forward)) for c in forward)
    right = cross(forward, camera.up)
    right = tuple(c / math.sqrt(dot(right, right)) for c in right)
    relative = subtract(point, camera.position)
    depth = dot(relative, forward)
    if depth <= 0.0:
        return depth, None
    tangent = math.tan(math.radians(camera.vertical_fov / 2))
    x = dot(relative, right) / (depth * tangent) * camera.height / camera.width
    y = dot(relative, cross(right, forward)) / (depth * tangent)
    return depth, ((x + 1) / 2 * width, (1 - y) / 2 * height)


def plane_hit(origin, direction, point, normal):
    """View depth of the hit, exactly, or None."""
    o, d, p, n = exact(origin), exact(direction), exact(point), exact(normal)
    slope = dot(n, d)
    t = dot(n, subtract(p, o)) / slope if slope else 0
    return t if t > 0 else None


def solve(columns, right):
    """Cramer's rule for three unknowns; None if singular."""
    a, b, c = columns
    determinant = dot(a, cross(b, c))
    if determinant == 0:
        return None
    return (dot(right, cross(b, c)) / determinant, dot(a, cross(right, c)) / determinant,
            dot(a, cross(b, right)) / determinant)


def box_hits(origin, direction, world_from_local):
    """All exact hits with the six faces, each taken by itself: (t, axis), nearest first."""
    columns = [exact(world_from_local[:3, axis]) for axis in range(3)]
    center = exact(world_from_local[:3, 3])
    o, d = exact(origin), exact(direction)
    hits = []
    for axis, side in itertools.product(range(3), (-1, 1)):
        i, j = (axis + 1) % 3, (axis + 2) % 3
        corner = tuple(c + side * a for c, a in zip(center, columns[axis], strict=True))
        # corner + s·e_i + r·e_j = o + t·d
        solution = solve((columns[i], columns[j], tuple(-c for c in d)), subtract(o, corner))
        if solution and abs(solution[0]) <= 1 and abs(solution[1]) <= 1 and solution[2] > 0:
            hits.append((solution[2], axis))
    return sorted(hits)


def sphere_hit(origin, direction, center, radius):
    """View depth of the nearest hit by the quadratic in 60 digits, or None; and how far off a miss is."""
    with mpmath.workdps(60):
        o, d, c = ([mpmath.mpf(float(x)) for x in v] for v in (origin, direction, center))
        q = subtract(o, c)
        a, b, k = dot(d, d), 2 * dot(q, d), dot(q, q) - mpmath.mpf(radius)**2
        discriminant = b * b - 4 * a * k
        if discriminant < 0:
            return None, distance_to_ray(origin, direction, center) - float(radius)
        root = mpmath.sqrt(discriminant)
        roots = [(-b - root) / (2 * a), (-b + root) / (2 * a)]
        positive = [t for t in roots if t > 0]
        return (positive[0] if positive else None), 0.0


def distance_to_ray(origin, direction, point):
    """How near a whole line passes to a point, in 60 digits."""
    with mpmath.workdps(60):
        o, d, p = ([mpmath.mpf(float(x)) for x in v] for v in (origin, direction, point))
        q = subtract(p, o)
        return float(mpmath.sqrt(dot(q, q) - dot(q, d)**2 / dot(d, d)))


def triangle_hit(origin, direction, corners):
    """View depth of the exact hit with one triangle, its border included [Möller, Trumbore 1997], or None."""
    a, b, c = (exact(corner) for corner in corners)
    o, d = exact(origin), exact(direction)
    solution = solve((subtract(b, a), subtract(c, a), tuple(-x for x in d)), subtract(o, a))
    if solution is None:
        return None
    u, v, t = solution
    return t if u >= 0 and v >= 0 and u + v <= 1 and t > 0 else None


def triangles_hit(origin, direction, triangles):
    """Nearest exact hit over all triangles: (t, index), or None."""
    hits = [(t, i) for i, corners in enumerate(triangles)
            if (t := triangle_hit(origin, direction, corners)) is not None]
    return min(hits) if hits else None


def height_field_triangles(world_from_local, heights):
    """The corners of a height field's triangles in the world, in the order of its facets."""
    rows, columns = len(heights), len(heights[0])

    def place(i, j):
        local = (-1 + 2 * i / (columns - 1), -1 + 2 * j / (rows - 1), float(heights[j][i]))
        return tuple(dot(world_from_local[axis, :3], local) + world_from_local[axis, 3] for axis in range(3))

    result = []
    for j, i in itertools.product(range(rows - 1), range(columns - 1)):
        result.append((place(i, j), place(i + 1, j), place(i + 1, j + 1)))
        result.append((place(i, j), place(i + 1, j + 1), place(i, j + 1)))
    return result


def plain(light):
    """A light record as a dict of what `lambert` reads."""
    values = {"kind": light.kind, "direction": getattr(light, "direction", None)}
    if light.kind == "directional":
        return values | {"colour": light.irradiance}
    values |= {"colour": light.intensity, "position": light.position, "radius": light.radius,
               "min_distance": light.min_distance, "windowed": light.falloff == "windowed"}
    return values | ({"inner": light.inner_angle, "outer": light.outer_angle} if light.kind == "spot" else {})


def lambert(point, normal, albedo, lights, ambient):
    """Radiance of a Lambert surface under (kind, …) lights given as plain dicts."""
    total = [0.0, 0.0, 0.0]
    for light in lights:
        if light["kind"] == "directional":
            towards, strength = light["direction"], 1.0
        else:
            towards = subtract(light["position"], point)
            d = math.sqrt(dot(towards, towards))
            strength = 1.0 / max(d, light["min_distance"])**2
            if light["windowed"]:
                strength *= max(0.0, 1.0 - (d / light["radius"])**4)**2
        cosine = dot(normal, towards) / math.sqrt(dot(towards, towards))
        if light["kind"] == "spot":
            axis = light["direction"]
            off = -dot(axis, towards) / math.sqrt(dot(axis, axis) * dot(towards, towards))
            inner, outer = (math.cos(math.radians(light[key])) for key in ("inner", "outer"))
            strength *= min(1.0, max(0.0, (off - outer) / (inner - outer)))**2
        for i in range(3):
            total[i] += light["colour"][i] * strength * max(cosine, 0.0)
    return tuple(a * (e / math.pi + m) for a, e, m in zip(albedo, total, ambient, strict=True))
