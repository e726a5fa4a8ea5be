"""What arrives at a point from one light: its direction and the factor on its colour.

`colour` (light) times the factor of `light_at` is the irradiance on a surface that faces the light,
without visibility. The parts (`distance_attenuation`, `cone_attenuation`) are what `froxel_ref.lighting`
evaluates along camera rays; surfaces and the truth call `light_at` on points.
"""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from froxel_ref.arrays import Field, Points, Sight
from froxel_ref.records import InputError
from froxel_ref.scene import DirectionalLight, Light, PointLight, Rgb, Scene, SpotLight
from froxel_ref.settings import SWITCHES

__all__ = [
    "ATTENUATIONS", "Cone", "colour", "cone_attenuation", "cone_corners", "distance_attenuation", "light_at",
    "point_intensity", "seen", "smallest_d2", "spot_cone", "spot_intensity", "unit",
    "with_intensities", "with_intensity",
]

ATTENUATIONS = tuple(dict.fromkeys(SWITCHES["attenuation"]))

# Share of points that a light reaches, below which it is worth to gather them before their sight is asked.
SPARSE = 0.7

Cone = tuple[float, float]
"""Scale and offset of a spot light's cone: the factor is sat(cos·scale + offset)²."""


def colour(light: Light) -> NDArray[np.float64]:
    """What the factor of `light_at` multiplies: irradiance of a directional light, intensity of the others.

    A light that is given by its power counts as `with_intensity` makes it.

    Parameters
    ----------
    light : Light
        Any light.

    Returns
    -------
    ndarray, shape (3,)
        [W m⁻²] for a directional light, [W sr⁻¹] for the others.

    Examples
    --------
    >>> colour(PointLight(position=(0, 0, 0), intensity=(1, 2, 3)))
    array([1., 2., 3.])
    """
    if isinstance(light, DirectionalLight):
        return np.array(light.irradiance)
    return np.array(with_intensity(light).intensity)


def with_intensity(light: PointLight, *, convention: str = "solid_angle") -> PointLight:
    """A light given by its intensity, from one given by its power.

    Parameters
    ----------
    light : PointLight or SpotLight
        With an intensity [W sr⁻¹], then returned as it is, or with a power [W].
    convention : {"solid_angle", "author"}
        Of a spot light, see `spot_intensity` (A6).

    Returns
    -------
    PointLight or SpotLight

    Raises
    ------
    InputError
        For an unknown ``convention``.

    Examples
    --------
    >>> with_intensity(PointLight(position=(0, 0, 0), power=(4 * math.pi, 0, 0))).intensity
    (1.0, 0.0, 0.0)
    """
    if light.power is None:
        return light
    intensity = (spot_intensity(light.power, light.inner_angle, light.outer_angle, convention=convention)
                 if isinstance(light, SpotLight) else point_intensity(light.power))
    return dataclasses.replace(light, intensity=intensity, power=None)


def with_intensities(scene: Scene, convention: str = "solid_angle") -> Scene:
    """A scene whose point and spot lights are all given by their intensity.

    Parameters
    ----------
    scene : Scene
    convention : {"solid_angle", "author"}
        Of spot lights given by their power, see `spot_intensity` (A6).

    Returns
    -------
    Scene

    Raises
    ------
    InputError
        For an unknown ``convention``.

    Examples
    --------
    >>> lamp = PointLight(position=(0, 0, 0), power=(4 * math.pi, 0, 0))
    >>> with_intensities(Scene(lights=(lamp,))).lights[0].intensity
    (1.0, 0.0, 0.0)
    """
    lights = tuple(with_intensity(light, convention=convention) if isinstance(light, PointLight) else light
                   for light in scene.lights)
    return scene if lights == scene.lights else dataclasses.replace(scene, lights=lights)


def unit(vector: tuple[float, float, float]) -> tuple[float, float, float]:
    """A vector of length 1, from one of any finite length but zero.

    Parameters
    ----------
    vector : (float, float, float)

    Returns
    -------
    (float, float, float)

    Examples
    --------
    >>> unit((0.0, 3e200, 4e200))
    (0.0, 0.6, 0.8)
    """
    # Scaled by its largest component first: the square of 1e200 would overflow, that of 1e-200 vanish.
    largest = max(abs(c) for c in vector)
    scaled = [c / largest for c in vector]
    length = math.hypot(*scaled)
    return scaled[0] / length, scaled[1] / length, scaled[2] / length


def smallest_d2(light: PointLight, attenuation: str = "min_distance") -> float:
    """The lower bound on the squared distance [m²] that keeps the inverse square finite.

    Parameters
    ----------
    light : PointLight or SpotLight
        Gives ``min_distance`` or ``radius``.
    attenuation : {"min_distance", "inverse_radius"}
        d_min², or 1/r² as the thesis's own program has it (A6; the number of 1/m² is taken as m²).

    Returns
    -------
    float
        Bound on d² [m²].

    Raises
    ------
    InputError
        For another word.

    Examples
    --------
    >>> smallest_d2(PointLight(position=(0, 0, 0), intensity=(1, 1, 1), radius=4), "inverse_radius")
    0.0625
    """
    if attenuation not in ATTENUATIONS:
        raise InputError("attenuation", f"is {attenuation!r}, must be one of {', '.join(ATTENUATIONS)}")
    bound = light.min_distance if attenuation == "min_distance" else 1.0 / light.radius
    return bound * bound  # not **, which raises where this is infinite


def distance_attenuation(d2: Field, light: PointLight, *, attenuation: str = "min_distance") -> Field:
    """The factor on a point or spot light's intensity at squared distance d².

    Parameters
    ----------
    d2 : ndarray
        Squared distances [m²], at least 0, finite.
    light : PointLight or SpotLight
        Gives radius, falloff and min_distance.
    attenuation : {"min_distance", "inverse_radius"}
        See `smallest_d2`.

    Returns
    -------
    ndarray, shape of ``d2``
        [m⁻²], in the dtype of ``d2``.

    Raises
    ------
    InputError
        For an unknown ``attenuation``.

    Notes
    -----
    sat(1 − (d²/r²)²)² / max(d², d_min²) [Dörries 2020, listing 3.7 leaves the function open; departure A6],
    exactly 0 from the radius on; with ``falloff="inverse_square"`` 1 / max(d², d_min²) and no end.
    d²/r² is cut at 1 before it is squared, so nothing overflows for any finite d². The window's relative
    error grows as 1/(1 − (d²/r²)²) towards the radius, the absolute one stays at some ulp of 1/d².

    Examples
    --------
    >>> lamp = PointLight(position=(0, 0, 0), intensity=(1, 1, 1), radius=2)
    >>> distance_attenuation(np.array([0.0, 1.0, 2.0, 4.0]), lamp)
    array([1.0000000e+04, 8.7890625e-01, 2.8125000e-01, 0.0000000e+00])
    """
    bounded = np.maximum(d2, _normal(smallest_d2(light, attenuation), d2.dtype))
    if light.falloff == "inverse_square":
        return np.asarray(1.0 / bounded)
    with np.errstate(over="ignore"):  # d²/r² beyond all numbers is cut to 1 as well
        share = np.minimum(d2 / _normal(light.radius * light.radius, d2.dtype), 1.0)
    window = 1.0 - share * share
    return np.asarray(window * window / bounded)


def spot_cone(light: SpotLight) -> Cone:
    """Scale and offset that turn the cosine to a spot light's axis into its falloff.

    Parameters
    ----------
    light : SpotLight
        Gives the half angles.

    Returns
    -------
    (float, float)
        scale = 1/(cos inner − cos outer), offset = −cos outer·scale.

    Examples
    --------
    >>> spot_cone(SpotLight(position=(0, 0, 0), intensity=(1, 1, 1), inner_angle=0, outer_angle=60))
    (2.0000000000000004, -1.0000000000000004)
    """
    outer, inner = math.radians(light.outer_angle), math.radians(light.inner_angle)
    # cos a − cos b as a product: the difference itself has no digits left for narrow cones.
    scale = 1.0 / (2.0 * math.sin((outer + inner) / 2.0) * math.sin((outer - inner) / 2.0))
    return scale, -math.cos(outer) * scale


def cone_attenuation(cos_axis: Field, light: SpotLight) -> Field:
    """The factor of a spot light's cone.

    Parameters
    ----------
    cos_axis : ndarray
        Cosine of the angle between the light's axis and the direction from the light to the point.
    light : SpotLight
        Gives the half angles.

    Returns
    -------
    ndarray, shape of ``cos_axis``
        1 within the inner angle, 0 outside the outer.

    Notes
    -----
    sat(cos·scale + offset)² [Dörries 2020, listing 3.7 leaves the function open].

    Examples
    --------
    >>> lamp = SpotLight(position=(0, 0, 0), intensity=(1, 1, 1), inner_angle=0, outer_angle=60)
    >>> cone_attenuation(np.array([1.0, 0.75, 0.25]), lamp).round(12)
    array([1.  , 0.25, 0.  ])
    """
    scale, offset = spot_cone(light)
    part = np.clip(cos_axis * scale + offset, 0.0, 1.0)
    return np.asarray(part * part)


def cone_corners(light: SpotLight, dtype: np.dtype[Any]) -> NDArray[np.float64]:
    """World points whose convex hull holds all that a windowed spot light reaches.

    Parameters
    ----------
    light : SpotLight
        Gives the position, direction, radius and outer angle.
    dtype : dtype
        Of the arithmetic that the hull must allow for.

    Returns
    -------
    ndarray, shape (9, 3) or (0, 3) [m]
        The position and the corners of an eight-sided pyramid; none where the cone is too wide for one.

    Notes
    -----
    The cosine to the axis, computed in a few roundings of its type, is compared with that of the outer angle:
    32 ulp of 1 are allowed, up to 0.15° in float32. Positions round as well, which is for the caller to
    allow for. The base lies at the radius, its corners at radius·tan(outer)/cos(π/8): 8 % of a circle's area
    is added.

    Examples
    --------
    >>> lamp = SpotLight(position=(0, 0, 0), intensity=(1, 1, 1), radius=2, inner_angle=0, outer_angle=45)
    >>> corners = cone_corners(lamp, np.dtype(float))
    >>> corners.shape, corners[:, 1].min().round(9)
    ((9, 3), np.float64(-2.0))
    """
    inside = _cos(light.outer_angle) - 32.0 * float(np.finfo(dtype).eps)
    if inside < 0.17:  # beyond 80° the pyramid is wider than the sphere is large
        return np.empty((0, 3))
    half = math.sqrt((1.0 - inside) * (1.0 + inside)) / inside / math.cos(math.pi / 8.0)
    axis = np.array(unit(light.direction))
    side = np.cross(axis, np.eye(3)[np.argmin(np.abs(axis))])
    side /= np.linalg.norm(side)
    turn = np.arange(8.0)[:, np.newaxis] * (math.pi / 4.0)
    ring = axis + half * (np.cos(turn) * side + np.sin(turn) * np.cross(axis, side))
    return np.concatenate([np.zeros((1, 3)), ring * light.radius]) + light.position


def light_at(light: Light, points: Points, *, attenuation: str = "min_distance") -> tuple[Points, Field]:
    """Direction to a light, and the factor on its `colour`, at points.

    Parameters
    ----------
    light : Light
        Any light.
    points : Points
        World positions [m], three arrays that broadcast together.
    attenuation : {"min_distance", "inverse_radius"}
        Lower bound on d²; see `smallest_d2`.

    Returns
    -------
    L : Points
        Unit vectors from the points to the light; three arrays of length-1 axes for a directional light.
        At the light itself (0, 0, 0): no direction is right there.
    factor : ndarray
        1 (length-1 axes) for a directional light, else [m⁻²]. Finite everywhere.

    Raises
    ------
    InputError
        For an unknown ``attenuation``.

    Notes
    -----
    [Dörries 2020, listing 3.7] without colour, phase function and visibility. Distances up to the square
    root of the largest number of the dtype (1.8e19 m in float32) do not overflow.

    Examples
    --------
    >>> lamp = PointLight(position=(0, 2, 0), intensity=(1, 1, 1), falloff="inverse_square")
    >>> L, factor = light_at(lamp, (np.zeros(1), np.zeros(1), np.zeros(1)))
    >>> [float(c[0]) for c in L], float(factor[0])
    ([0.0, 1.0, 0.0], 0.25)
    """
    shape = (1,) * max(np.ndim(p) for p in points)
    dtype = np.result_type(*points)
    if isinstance(light, DirectionalLight):
        x, y, z = (np.full(shape, c, dtype) for c in unit(light.direction))
        return (x, y, z), np.ones(shape, dtype)
    dx, dy, dz = (position - p for position, p in zip(light.position, points, strict=True))
    d2 = dx * dx + dy * dy + dz * dz
    factor = distance_attenuation(d2, light, attenuation=attenuation)
    # The smallest normal number instead of 0: 0/tiny is the (0, 0, 0) promised above, without a mask.
    d = np.maximum(np.sqrt(d2), np.finfo(dtype).tiny)
    L = (dx / d, dy / d, dz / d)
    if isinstance(light, SpotLight):
        ax, ay, az = unit(light.direction)
        factor = factor * cone_attenuation(-(L[0] * ax + L[1] * ay + L[2] * az), light)
    return L, factor


def seen(factor: Field, sight: Sight, points: Points, normal: Points | None = None) -> Field:
    """What is left of a light's factor behind what hides it.

    Parameters
    ----------
    factor : ndarray, shape (…)
        At least 0, as from `light_at`.
    sight : callable
        See `froxel_ref.arrays.Sight`.
    points, normal : Points
        What the sight is asked about, broadcastable to ``factor``.

    Returns
    -------
    ndarray, shape (…)
        factor·sight; where the light does not shine anyway the sight is not asked.

    Examples
    --------
    >>> x = np.arange(4.0)
    >>> seen(np.array([0.0, 0.0, 0.0, 2.0]), lambda points: 0.1 * points[0], (x, x, x)).round(3).tolist()
    [0.0, 0.0, 0.0, 0.6]
    """
    lit = factor > 0.0
    count = int(np.count_nonzero(lit))
    if count > SPARSE * lit.size:
        return np.asarray(factor * (sight(points) if normal is None else sight(points, normal)))
    result = factor.copy()
    if count:
        x, y, z = (np.broadcast_to(p, lit.shape)[lit] for p in points)
        if normal is None:
            result[lit] *= sight((x, y, z))
        else:
            nx, ny, nz = (np.broadcast_to(n, lit.shape)[lit] for n in normal)
            result[lit] *= sight((x, y, z), (nx, ny, nz))
    return result


def point_intensity(power: Rgb) -> Rgb:
    """Radiant intensity of a point light of a given power: Φ/(4π).

    Parameters
    ----------
    power : (float, float, float)
        Φ [W].

    Returns
    -------
    (float, float, float)
        [W sr⁻¹].

    Examples
    --------
    >>> point_intensity((4 * math.pi, 0.0, 8 * math.pi))
    (1.0, 0.0, 2.0)
    """
    r, g, b = (c / (4.0 * math.pi) for c in power)
    return r, g, b


def spot_intensity(
    power: Rgb, inner_angle: float, outer_angle: float, *, convention: str = "solid_angle"
) -> Rgb:
    """Radiant intensity on the axis of a spot light of a given power.

    Parameters
    ----------
    power : (float, float, float)
        Φ [W].
    inner_angle, outer_angle : float
        Half angles of the cone [degrees].
    convention : {"solid_angle", "author"}
        Φ over the cone's effective solid angle, so that the light emits Φ; or Φ/π whatever the cone, as
        the thesis's own program has it (A6).

    Returns
    -------
    (float, float, float)
        [W sr⁻¹].

    Raises
    ------
    InputError
        For an unknown ``convention``.

    Notes
    -----
    ∫ sat(cos·scale + offset)² dω = 2π[(1 − cos inner) + (cos inner − cos outer)/3].

    Examples
    --------
    >>> round(spot_intensity((1.0, 1.0, 1.0), 0.0, 60.0)[0] * math.pi, 12)
    3.0
    """
    if convention not in ("solid_angle", "author"):
        raise InputError("convention", f"is {convention!r}, must be one of solid_angle, author")
    inner, outer = 1.0 - _cos(inner_angle), 1.0 - _cos(outer_angle)
    cone = math.pi if convention == "author" else 2.0 * math.pi * (inner + (outer - inner) / 3.0)
    r, g, b = (c / cone for c in power)
    return r, g, b


def _normal(value: float, dtype: np.dtype[Any]) -> float:
    """A positive number, moved to the nearest that the dtype holds with all its digits."""
    limits = np.finfo(dtype)
    return min(max(value, float(limits.tiny)), float(limits.max))


def _cos(degrees: float) -> float:
    return math.cos(math.radians(degrees))
