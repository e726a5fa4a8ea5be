"""What one stage hands to the next: named groups of arrays, so that no stage has to know another."""

from __future__ import annotations

from typing import NamedTuple

from froxel_ref.arrays import Field

__all__ = ["Hits", "Integrated", "VBuffer"]


class Hits(NamedTuple):
    """The nearest surface along each ray.

    Attributes
    ----------
    depth : Field, shape (h, w) [m]
        View depth, +inf where there is nothing.
    normal : Field, shape (3, h, w)
        World normal of length 1 that faces the camera; 0 where there is nothing.
    albedo : Field, shape (3, h, w)
        Lambert reflectance; 0 where there is nothing.
    """

    depth: Field
    normal: Field
    albedo: Field


class VBuffer(NamedTuple):
    """The material of participating media at points; every field keeps only the axes on which it varies.

    Attributes
    ----------
    scattering : Field, shape (3, …) [1/m]
        σ_s = Σ albedo·extinction·density.
    extinction : Field, shape (…), or (3, …) if any medium's is RGB [1/m]
        σ_t = Σ extinction·density.
    emission : Field, shape (3, …) [W m⁻³ sr⁻¹]
        As authored, Σ emissive·density, for the switch "per_metre"; for "published" too, where lighting
        multiplies it by σ_s (D2); Σ (1 − albedo)·extinction·density·emissive for "absorption".
    phase_anisotropy : Field, shape (…) [1]
        g, see `voxelise`.
    lobes : tuple of (Field of shape (3, …) [1/m], float)
        For the exact mixture of phase functions: the scattering of the media of each g, and that g.
    """

    scattering: Field
    extinction: Field
    emission: Field
    phase_anisotropy: Field
    lobes: tuple[tuple[Field, float], ...] = ()


class Integrated(NamedTuple):
    """The scattering buffer: what the fog between the camera and each slice boundary adds and lets through.

    Attributes
    ----------
    radiance : ndarray, shape (3, D, H, W) or (3, 1, 1, 1)
        [W m⁻² sr⁻¹] ``radiance[:, k]`` is the light gathered up to boundary k + 1; one texel of zeros
        where the medium gives no light.
    transmittance : ndarray, shape (D, H, W) or (3, D, H, W), or (1, 1, 1)
        [1] ``transmittance[..., k, :, :]`` is what passes from boundary k + 1; one texel of ones in vacuum.
    front_radiance : ndarray, shape (3, H, W) or (3, 1, 1)
        [W m⁻² sr⁻¹] The light gathered up to the near boundary.
    front_transmittance : ndarray, shape (H, W) or (3, H, W), or (1, 1)
        [1] What passes from the near boundary.
    """

    radiance: Field
    transmittance: Field
    front_radiance: Field
    front_transmittance: Field
