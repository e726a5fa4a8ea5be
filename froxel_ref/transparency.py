"""Transparent surfaces in the image: fogged at their own depth, sorted by pixel, with particles between them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from froxel_ref.arrays import Field, FogAt
from froxel_ref.buffers import Hits
from froxel_ref.particles import ParticleLayer

__all__ = ["Pane", "fogged_pane", "interleaved", "sorted_panes"]


class Pane(NamedTuple):
    """What one transparent surface does to each pixel: below·transmittance + radiance.

    Attributes
    ----------
    depth : ndarray, shape (h, w) [m]
        View depth, ∞ where there is nothing.
    radiance : ndarray, shape (3, h, w)
        [W m⁻² sr⁻¹] Its own light and that of the fog in front of it, times its opacity.
    transmittance : ndarray, shape (h, w)
        [1] The share of what lies behind it that passes.
    """

    depth: Field
    radiance: Field
    transmittance: Field


def fogged_pane(hits: Hits, light: Field, opacity: float, depth_image: Field, fog_at: FogAt) -> Pane:
    """Fog a transparent surface at its own depth.

    Parameters
    ----------
    hits : Hits
        Where it is hit, shape (h, w).
    light : ndarray, shape (3, h, w) [W m⁻² sr⁻¹]
        What it would send to the camera if it were opaque.
    opacity : float [1]
    depth_image : ndarray, shape (h, w) [m]
        View depth of the opaque surfaces, ∞ where there are none.
    fog_at : callable
        See `froxel_ref.arrays.FogAt`.

    Returns
    -------
    Pane
        Clear where an opaque surface is nearer or as near.

    Notes
    -----
    α·(L·T(z) + F(z)) with the opacity α, its light L, and the fog's transmittance T and light F up to its depth z
    [Dörries 2020, §3.2.10].

    Examples
    --------
    >>> hits = Hits(np.array([[2.0, 4.0]]), np.zeros((3, 1, 2)), np.ones((3, 1, 2)))
    >>> pane = fogged_pane(hits, np.full((3, 1, 2), 8.0), 0.25, np.full((1, 2), 3.0),
    ...                    lambda rows, columns, depth: (np.ones((3, 1)), np.full(1, 0.5)))
    >>> pane.depth.tolist(), pane.radiance[0].tolist(), pane.transmittance.tolist()
    ([[2.0, inf]], [[1.25, 0.0]], [[0.75, 1.0]])
    """
    on = hits.depth < depth_image
    row, column = np.nonzero(on)
    glow, passed = fog_at(row, column, hits.depth[on])
    radiance, transmittance = np.zeros_like(light), np.ones_like(hits.depth)
    radiance[:, on] = opacity * (light[:, on] * passed + glow)
    transmittance[on] = 1.0 - opacity
    return Pane(np.where(on, hits.depth, np.inf), radiance, transmittance)


def sorted_panes(panes: Iterable[Pane]) -> list[Pane]:
    """Sort transparent surfaces by their depth in each pixel.

    Parameters
    ----------
    panes : iterable of Pane
        All of one shape, taken one at a time.

    Returns
    -------
    list of Pane
        The nearest of each pixel first; of equally near ones the first given. As many as lie behind one another in
        the pixel with most of them.

    Examples
    --------
    >>> panes = [Pane(np.array([depth]), np.zeros((3, 1, 2)), np.full((1, 2), passed))
    ...          for depth, passed in (([1.0, 2.0], 0.25), ([2.0, 1.0], 0.75))]
    >>> [pane.transmittance.tolist() for pane in sorted_panes(panes)]
    [[[0.25, 0.75]], [[0.75, 0.25]]]
    """
    found: list[Pane] = []
    for pane in panes:
        carried = pane
        for i, other in enumerate(found):
            nearer = pane.depth < other.depth
            found[i], carried = _chosen(nearer, carried, other), _chosen(nearer, other, carried)
        if np.isfinite(carried.depth).any():
            found.append(carried)
    return found


def _chosen(where: NDArray[np.bool_], yes: Pane, no: Pane) -> Pane:
    return Pane(*(np.where(where, a, b) for a, b in zip(yes, no, strict=True)))


def interleaved(panes: Sequence[Pane], particles: Sequence[ParticleLayer]) -> ParticleLayer:
    """Lay transparent surfaces and the particles between them over one another.

    Parameters
    ----------
    panes : sequence of Pane
        k of them, the nearest of each pixel first.
    particles : sequence of ParticleLayer
        k + 1 of them, each before the pane of its number: from `froxel_ref.particles.particle_layers`.

    Returns
    -------
    ParticleLayer
        What all of them together do to an image.

    Examples
    --------
    >>> clear = ParticleLayer(np.zeros((3, 1, 1)), np.ones((1, 1)))
    >>> pane = Pane(np.ones((1, 1)), np.full((3, 1, 1), 2.0), np.full((1, 1), 0.5))
    >>> layer = interleaved([pane], [ParticleLayer(np.ones((3, 1, 1)), np.full((1, 1), 0.5)), clear])
    >>> layer.radiance.ravel().tolist(), layer.transmittance.tolist()
    ([2.0, 2.0, 2.0], [[0.25]])
    """
    radiance, passed = particles[-1]
    for pane, before in zip(reversed(panes), reversed(particles[:-1]), strict=True):
        for over in (pane, before):
            radiance, passed = radiance * over.transmittance + over.radiance, passed * over.transmittance
    return ParticleLayer(radiance, passed)
