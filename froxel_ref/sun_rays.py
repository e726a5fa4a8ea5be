"""Directional lights as the camera's rays see them: one angle per ray, worked out in twice the digits.

A sun's light is the same at every depth of a ray, so all that it gives to a frame goes through H × W
numbers. Near the sun these are ill-conditioned: a narrow phase function turns a rounding of the ray's unit
vector into 1.5/(1 − |g|) as much in its value. Worked out from the unnormalised ray and direction with
about 106 bits, they come out as the exact value rounded, for the price of one image.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from froxel_ref.arrays import Field
from froxel_ref.compensated import FOUR_PI, DoubleDouble, double_double
from froxel_ref.geometry import Rays
from froxel_ref.lights import colour
from froxel_ref.phase import phase
from froxel_ref.scene import DirectionalLight

__all__ = ["SunRays", "sun_phase", "sun_rays"]


class SunRays(NamedTuple):
    """A directional light relative to each ray of a grid.

    Attributes
    ----------
    index : int
        In the scene's lights.
    irradiance : ndarray, shape (3,), float64 [W m⁻²]
        On a surface that faces the light.
    deflection : DoubleDouble, shape (H, W)
        cos θ = u·L of the ray's and the light's unit directions.
    dtype : data type
        Of the frame.
    """

    index: int
    irradiance: NDArray[np.float64]
    deflection: DoubleDouble
    dtype: np.dtype[Any]


def sun_rays(index: int, light: DirectionalLight, rays: Rays) -> SunRays:
    """Relate a directional light to the rays of a grid.

    Parameters
    ----------
    index : int
        Of the light, carried along.
    light : DirectionalLight
        The light.
    rays : Rays
        The grid's; per_depth and the light's direction are taken as exact.

    Returns
    -------
    SunRays

    Notes
    -----
    cos θ = p·l/√(p·p · l·l) of the unnormalised ray p and direction l, relative error below 2⁻⁹⁸ of 1.

    Examples
    --------
    >>> from froxel_ref.geometry import camera_rays
    >>> from froxel_ref.scene import Camera
    >>> sun = sun_rays(0, DirectionalLight(direction=(0, 0, -2), irradiance=(1, 1, 1)), camera_rays(Camera(), 1, 1))
    >>> sun.deflection.high.tolist()
    [[1.0]]
    """
    p = [double_double(component) for component in rays.per_depth]
    towards = [double_double(component) for component in light.direction]
    cosine = _dot(p, towards) / (_dot(p, p) * _dot(towards, towards)).sqrt()
    shape = rays.length.shape
    whole = DoubleDouble(np.broadcast_to(cosine.high, shape), np.broadcast_to(cosine.low, shape))
    return SunRays(index, colour(light), whole, rays.length.dtype)


def _dot(a: list[DoubleDouble], b: list[DoubleDouble]) -> DoubleDouble:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def sun_phase(sun: SunRays, name: str, g: Field, *, rows: slice = slice(None)) -> Field:
    """What a phase function makes of a sun's direction, for each ray.

    Parameters
    ----------
    sun : SunRays
        From `sun_rays`.
    name : str
        A key of `froxel_ref.phase.PHASE`.
    g : Field, shape (…), three axes
        Phase anisotropy.
    rows : slice
        Of the grid, that ``g`` belongs to.

    Returns
    -------
    Field, shape broadcastable to (D, H, W) [sr⁻¹]
        In the frame's dtype.

    Notes
    -----
    Henyey–Greenstein with one g: (1 − g²)/(4π·b·√b), b = (1 − |g|)² + 2|g|(1 ∓ cos θ), in twice the digits
    and rounded once: within 0.51 ulp of the exact value for |g| ≤ 1 − 2⁻²⁴. The others, and a g that
    varies, take cos θ and 1 − cos θ rounded once each.

    Examples
    --------
    >>> from froxel_ref.geometry import camera_rays
    >>> from froxel_ref.scene import Camera
    >>> sun = sun_rays(0, DirectionalLight(direction=(0, 0, -1), irradiance=(1, 1, 1)), camera_rays(Camera(), 1, 1))
    >>> sun_phase(sun, "henyey_greenstein", np.full((1, 1, 1), 0.5)).round(6).tolist()  # 6/(4π)
    [[[0.477465]]]
    """
    cosine = DoubleDouble(sun.deflection.high[np.newaxis, rows], sun.deflection.low[np.newaxis, rows])
    one = double_double(1.0)
    if name == "henyey_greenstein" and g.size == 1:
        size = double_double(abs(float(g.reshape(-1)[0])))
        turn = one - cosine if g.reshape(-1)[0] >= 0 else one + cosine
        rest = one - size
        bend = rest * rest + (size + size) * turn
        value = (rest * (one + size)) / (FOUR_PI * bend * bend.sqrt())
        return value.high.astype(sun.dtype, copy=False)
    narrow, small = (part.high.astype(sun.dtype, copy=False) for part in (cosine, one - cosine))
    return phase(name, narrow, g.astype(sun.dtype, copy=False), versine=np.maximum(small, 0.0))
