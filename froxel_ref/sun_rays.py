"""Directional lights as the camera's rays see them: one angle per ray, worked out in twice the digits.

A sun's light is the same at every depth of a ray, so all that it gives to a frame goes through H × W
numbers. Near the sun these are ill-conditioned: a narrow phase function turns a rounding of the ray's unit
vector into 1.5/(1 − |g|) as much in its value. Worked out from the unnormalised ray and direction with
about 106 bits, they come out as the exact value rounded, for the price of one image.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from froxel_ref.arrays import Field
from froxel_ref.compensated import FOUR_PI, DoubleDouble, dot, double_double
from froxel_ref.geometry import Rays
from froxel_ref.lights import colour
from froxel_ref.phase import phase
from froxel_ref.scene import DirectionalLight

__all__ = ["SunRays", "sun_light", "sun_rays"]


class SunRays(NamedTuple):
    """A directional light relative to each ray of a grid.

    Attributes
    ----------
    number : int
        Index in the scene's lights.
    irradiance : ndarray, shape (3,), float64 [W m⁻²]
        On a surface that faces the light.
    deflection : DoubleDouble, shape (H, W)
        cos θ = u·L of the ray's and the light's unit directions.
    dtype : data type
        Of the frame.
    """

    number: int
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
    >>> light = DirectionalLight(direction=(0, 0, -2), irradiance=(1, 1, 1))
    >>> sun_rays(0, light, camera_rays(Camera(), 1, 1)).deflection.high.tolist()
    [[1.0]]
    """
    p = [double_double(component) for component in rays.per_depth]
    # By a power of two, exactly, so that no square over- or underflows.
    exponent = math.frexp(max(map(abs, light.direction)))[1]
    towards = [double_double(math.ldexp(component, -exponent)) for component in light.direction]
    cosine = dot(p, towards) / (dot(p, p) * dot(towards, towards)).sqrt()
    shape = rays.length.shape
    whole = DoubleDouble(np.broadcast_to(cosine.high, shape), np.broadcast_to(cosine.low, shape))
    return SunRays(index, colour(light), whole, rays.length.dtype)


def sun_light(sun: SunRays, name: str, g: Field, *, share: float = 1.0, rows: slice = slice(None),
              varies: bool = False) -> Field:
    """What a phase function turns of a sun's light into each ray, per unit of scattering.

    Parameters
    ----------
    sun : SunRays
        From `sun_rays`.
    name : str
        A key of `froxel_ref.phase.PHASE`.
    g : Field, shape (…), three axes
        Phase anisotropy.
    share : float
        Factor on the phase function.
    rows : slice
        Of the grid, that ``g`` belongs to.
    varies : bool
        Whether g does elsewhere, and what is one number here must be computed as it is there.

    Returns
    -------
    Field, shape broadcastable to (3, D, H, W) [W m⁻² sr⁻¹]
        share·p·E in the frame's dtype.

    Notes
    -----
    Henyey–Greenstein with one g: (1 − g²)/(4π·b·√b), b = (1 − |g|)² + 2|g|(1 ∓ cos θ), times share and
    irradiance in twice the digits and rounded once: within 0.51 ulp of the exact value for
    |g| ≤ 1 − 2⁻²⁴. The others, and a g that varies, take cos θ and 1 − cos θ rounded once each.

    Examples
    --------
    >>> from froxel_ref.geometry import camera_rays
    >>> from froxel_ref.scene import Camera
    >>> light = DirectionalLight(direction=(0, 0, -1), irradiance=(1, 2, 3))
    >>> sun = sun_rays(0, light, camera_rays(Camera(), 1, 1))
    >>> sun_light(sun, "henyey_greenstein", np.full((1, 1, 1), 0.5)).ravel().round(6).tolist()  # 6/(4π)·E
    [0.477465, 0.95493, 1.432394]
    """
    cosine = DoubleDouble(sun.deflection.high[np.newaxis, rows], sun.deflection.low[np.newaxis, rows])
    irradiance = sun.irradiance.reshape(3, 1, 1, 1)
    one = double_double(1.0)
    if name == "henyey_greenstein" and g.size == 1 and not varies:
        size = double_double(abs(float(g.reshape(-1)[0])))
        turn = one - cosine if g.reshape(-1)[0] >= 0 else one + cosine
        rest = one - size
        bend = rest * rest + (size + size) * turn
        value = (rest * (one + size)) / (FOUR_PI * bend * bend.sqrt())
        light: Field = (value * (double_double(irradiance) * double_double(share))).high
        return light.astype(sun.dtype, copy=False)
    narrow, small = (part.high.astype(sun.dtype, copy=False) for part in (cosine, one - cosine))
    plain = phase(name, narrow, g.astype(sun.dtype, copy=False), versine=np.maximum(small, 0.0))
    scaled: Field = plain * (irradiance * share).astype(sun.dtype, copy=False)
    return scaled
