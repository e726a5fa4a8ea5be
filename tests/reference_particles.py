"""Particles again, one at a time, as slow scalar loops from the definitions."""

from __future__ import annotations

import math


def dot(a, b):
    return sum(x * y for x, y in zip(a, b, strict=True))


def cross(a, b):
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


def minus(a, b):
    return tuple(x - y for x, y in zip(a, b, strict=True))


def unit(a):
    length = math.sqrt(dot(a, a))
    return tuple(x / length for x in a)


def axes(along, rotation):
    """Right and down of a square that a viewer sees along a direction, turned counter-clockwise for it."""
    up = (0.0, 1.0, 0.0) if abs(along[1]) < 0.99 else (0.0, 0.0, -1.0)
    right = unit(cross(along, up))
    up = cross(right, along)
    c, s = math.cos(math.radians(rotation)), math.sin(math.radians(rotation))
    turned_right = tuple(c * r + s * u for r, u in zip(right, up, strict=True))
    turned_up = tuple(c * u - s * r for r, u in zip(right, up, strict=True))
    return turned_right, tuple(-u for u in turned_up)


def texel(texture, x, y):
    """Bilinear, x and y in texels, edges repeated."""
    rows, columns = len(texture), len(texture[0])

    def row(j):
        line = texture[min(max(j, 0), rows - 1)]
        i = math.floor(x - 0.5)
        f = x - 0.5 - i
        return float(line[min(max(i, 0), columns - 1)]) * (1 - f) + float(line[min(max(i + 1, 0), columns - 1)]) * f

    j = math.floor(y - 0.5)
    f = y - 0.5 - j
    return row(j) * (1 - f) + row(j + 1) * f


def opacity(particle, textures, x, y):
    """At (x, y) in half edges."""
    if max(abs(x), abs(y)) > 1.0:
        return 0.0
    if particle.texture is not None:
        texture = textures[particle.texture]
        return particle.opacity * texel(texture, (x + 1) / 2 * len(texture[0]), (y + 1) / 2 * len(texture))
    r2 = x * x + y * y
    share = {"square": 1.0, "disc": float(r2 <= 1.0), "soft": max(1.0 - r2, 0.0) ** 2}[particle.profile]
    return particle.opacity * share


def met(particle, textures, along, start, way, *, half=0.5):
    """Where a line meets the square of a particle that is seen along a direction, and the opacity there."""
    slope = dot(way, along)
    if slope <= 0.0:
        return None
    t = dot(minus(particle.position, start), along) / slope
    offset = minus(tuple(s + t * w for s, w in zip(start, way, strict=True)), particle.position)
    right, down = axes(along, particle.rotation)
    edge = half * particle.size
    return t, opacity(particle, textures, dot(offset, right) / edge, dot(offset, down) / edge)


def lamp_hit(particle, textures, lamp, way, *, half=0.5):
    """Distance and opacity along a ray from a lamp."""
    away = minus(particle.position, lamp)
    return met(particle, textures, unit(away), lamp, way, half=half) if any(away) else None


def transmittance(particles, textures, light, point):
    """What all particles let through of a light's way to a point; the light has a position or a direction."""
    passed = 1.0
    for particle in particles:
        if hasattr(light, "position"):
            ahead = minus(point, light.position)
            if not any(ahead):
                continue
            found, end = lamp_hit(particle, textures, light.position, unit(ahead)), math.sqrt(dot(ahead, ahead))
        else:
            along = tuple(-c for c in unit(light.direction))
            found, end = met(particle, textures, along, point, along), 0.0
        if found is not None and found[0] < end:
            passed *= (1.0 - found[1]) ** particle.fom_multiplier
    return passed


def image(particles, textures, rays, depth, centre_depth, light, fog):
    """The particles' radiance and transmittance, pixel by pixel.

    ``rays`` are metres per metre of view depth, (3, h, w), from the origin ``rays.origin``; ``light(point, particle)``
    and ``fog(row, column, depth)`` are scalar functions.
    """
    origin, ways = rays
    height, width = len(depth), len(depth[0])
    order = sorted(range(len(particles)), key=lambda i: (-centre_depth[i], i))
    radiance = [[[0.0] * width for _ in range(height)] for _ in range(3)]
    through = [[1.0] * width for _ in range(height)]
    for row in range(height):
        for column in range(width):
            way = tuple(float(ways[c][row][column]) for c in range(3))
            for i in order:
                found = lamp_hit(particles[i], textures, origin, way)
                if found is None or not found[0] < depth[row][column]:
                    continue
                z, alpha = found
                point = tuple(o + z * w for o, w in zip(origin, way, strict=True))
                lit, (glow, passed) = light(point, particles[i]), fog(row, column, z)
                for c in range(3):
                    radiance[c][row][column] = (radiance[c][row][column] * (1.0 - alpha)
                                                + alpha * (lit[c] * passed[c] + glow[c]))
                through[row][column] *= 1.0 - alpha
    return radiance, through
