"""Look the fog up at each pixel's depth, and lay it over the scene."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from froxel_ref import tonemap
from froxel_ref.arrays import Field, FogAt
from froxel_ref.blue_noise import blue_noise
from froxel_ref.buffers import Integrated
from froxel_ref.fog_lookups import fetch_biquadratic, noisy_lookup, tap_offsets
from froxel_ref.grid import depth_to_slice, slice_to_depth
from froxel_ref.records import InputError
from froxel_ref.sampling import fetch_trilinear
from froxel_ref.settings import SWITCHES, FogLookup, Grid
from froxel_ref.storage import store_half

__all__ = ["LOOKUPS", "composite", "fog_lookup", "lookup_bias", "lookup_fog"]

LOOKUPS = tuple(dict.fromkeys(SWITCHES["lookup"]))
NEAR_SURFACES = tuple(dict.fromkeys(SWITCHES["near_surface"]))
INVERSES = tuple(dict.fromkeys(SWITCHES["inverse_tone_map"]))


def lookup_fog(integrated: Integrated, grid: Grid, depth_image: Field, *, lookup: str = "boundary",
               near_surface: str = "fog", options: FogLookup | None = None, inverse_tone_map: str = "carried",
               frame: int = 0, shift: tuple[float, float] = (0.0, 0.0), threads: int | None = None
               ) -> tuple[Field, Field]:
    """Find the fog between the camera and the surface that each pixel shows.

    Parameters
    ----------
    integrated : Integrated
        The scattering buffer.
    grid : Grid
        The grid that it was computed on.
    depth_image : ndarray, shape (h, w)
        [m] View depth at the pixels' centres, at least 0; beyond the grid (also ∞) stands the fog of the
        last boundary. The image covers the grid's whole view, whatever its size.
    lookup : {"boundary", "centre"}, default "boundary"
        Where along z the stored values stand; see the notes. Published: "centre" (D4).
    near_surface : {"fog", "first_slice"}, default "fog"
        What a surface has that is nearer than the first stored value: the fog in front of it, or all of the
        first slice's. Published: "first_slice" (A11).
    options : FogLookup, optional
        Fetch, bias, taps and storage; one trilinear fetch of what was computed, unless given.
    inverse_tone_map : {"carried", "luma", "bounded"}, default "carried"
        Of tone-mapped storage (D9): up to the largest luma that the storage holds; up to 1, published, which float16
        reaches; or up to 1 − 1e-6, the program's.
    frame : int, default 0
        Number of the frame: layer of the noise.
    shift : (float, float), default (0, 0)
        [pixels] How far to the right and downwards of their centres the pixels are sampled.
    threads : int, optional
        Default: one per core. The result is the same to the last bit.

    Returns
    -------
    radiance : ndarray, shape (3, h, w), or (3, 1, 1) where constant
        [W m⁻² sr⁻¹] The fog's own light.
    transmittance : ndarray, shape (h, w) or (3, h, w); length 1 where constant
        [1] The share of the surface's light that passes.

    Raises
    ------
    InputError
        An unknown word.

    Notes
    -----
    Trilinear, with the edge texel beyond the borders of x and y [Dörries 2020, listing 3.5].

    ``boundary`` : the value stored for slice k stands at slice coordinate k + 1, the front values at 0, and
        clear air (0 and 1) at the camera; in between linear in the slice coordinate, and in depth in front
        of the near boundary. At a boundary this returns what is stored; elsewhere it is of second order in
        the slice's depth.
    ``centre`` : the value stored for slice k stands at k + ½, as a texture unit has it, so every lookup
        finds the fog of half a slice more (D4: at most ½·S·d of light too much, of first order). In front
        of the first centre it is linear in depth.

    Noisy taps, a bias, a B-spline and tone-mapped storage are as in `froxel_ref.fog_lookups`, at the same places. A
    bias takes the fog of as many slices away, at all depths: of the published 1.5, half a slice is what "centre" has
    too much.

    A NaN depth gives NaN.

    Examples
    --------
    >>> import numpy as np
    >>> stored = np.array([0.5, 0.25]).reshape(2, 1, 1)
    >>> fog = Integrated(np.zeros((3, 1, 1, 1)), stored, np.zeros((3, 1, 1)), np.ones((1, 1)))
    >>> grid = Grid(width=1, height=1, depth=2, near=1.0, far=3.0, distribution="linear")
    >>> depth = np.array([[0.0, 1.0, 1.5, 2.0, 2.5, np.inf]])
    >>> lookup_fog(fog, grid, depth)[1]
    array([[1.   , 1.   , 0.75 , 0.5  , 0.375, 0.25 ]])
    >>> lookup_fog(fog, grid, depth, lookup="centre", near_surface="first_slice")[1]
    array([[0.5  , 0.5  , 0.5  , 0.375, 0.25 , 0.25 ]])
    """
    height, width = depth_image.shape
    at = fog_lookup(integrated, grid, (height, width), lookup=lookup, near_surface=near_surface, options=options,
                    inverse_tone_map=inverse_tone_map, frame=frame, shift=shift, threads=threads)
    return at(np.arange(height).reshape(-1, 1), np.arange(width), depth_image)


def fog_lookup(integrated: Integrated, grid: Grid, shape: tuple[int, int], *, lookup: str = "boundary",
               near_surface: str = "fog", options: FogLookup | None = None, inverse_tone_map: str = "carried",
               frame: int = 0, shift: tuple[float, float] = (0.0, 0.0), threads: int | None = None) -> FogAt:
    """Make a function that finds the fog between the camera and points that pixels show.

    Parameters
    ----------
    integrated, grid, lookup, near_surface, options, inverse_tone_map, frame, shift, threads
        As for `lookup_fog`.
    shape : (int, int)
        Height and width of the image [pixels].

    Returns
    -------
    callable
        ``at(rows, columns, depth)``, the three broadcastable to a common shape (…): radiance (3, …) and
        transmittance (…) or (3, …), with length 1 along axes on which nothing varies.

    Raises
    ------
    InputError
        An unknown word.

    Notes
    -----
    For what lies in front of the surfaces, such as particles, which have their own depth in a pixel. What is the
    same for all pixels is worked out once.

    Examples
    --------
    >>> import numpy as np
    >>> stored = np.array([0.5, 0.25]).reshape(2, 1, 1)
    >>> fog = Integrated(np.zeros((3, 1, 1, 1)), stored, np.zeros((3, 1, 1)), np.ones((1, 1)))
    >>> grid = Grid(width=1, height=1, depth=2, near=1.0, far=3.0, distribution="linear")
    >>> at = fog_lookup(fog, grid, (2, 2))
    >>> at(np.array([0, 1]), np.array([1, 1]), np.array([2.0, 1.5]))[1]
    array([0.5 , 0.75])
    """
    for name, word, known in (("lookup", lookup, LOOKUPS), ("near_surface", near_surface, NEAR_SURFACES),
                              ("inverse_tone_map", inverse_tone_map, INVERSES)):
        if word not in known:
            raise InputError(name, f"is {word!r}, must be one of {', '.join(known)}")
    how = options or FogLookup()
    dtype, (height, width) = integrated.radiance.dtype, shape
    light = _stored(_texels(integrated.radiance, integrated.front_radiance, 0.0, grid, lookup), how, toned=True)
    passed = _stored(_texels(integrated.transmittance, integrated.front_transmittance, 1.0, grid, lookup), how)
    tint = passed.shape[:-3]
    textures = [light, passed.reshape(-1, *passed.shape[-3:])]
    if light.shape[-3:] == passed.shape[-3:]:  # one fetch finds its texels once for both
        textures = [np.concatenate(textures)]
    bias, noise = lookup_bias(how, lookup), blue_noise(dtype=dtype) if how.method == "noisy" else None
    fetch = fetch_biquadratic if how.method == "biquadratic" else fetch_trilinear
    nearest = _first_texel(lookup) if near_surface == "first_slice" else None
    most = {"carried": tonemap.FLOAT16_LARGEST_LUMA if how.storage == "float16" else None, "luma": 1.0,
            "bounded": tonemap.AUTHOR_LARGEST_LUMA}[inverse_tone_map]

    def at(rows: NDArray[np.integer[Any]], columns: NDArray[np.integer[Any]], depth: Field) -> tuple[Field, Field]:
        x = ((columns + (0.5 + shift[0])) * (grid.width / width)).astype(dtype)
        y = ((rows + (0.5 + shift[1])) * (grid.height / height)).astype(dtype)
        z = _texel_depth(depth, grid, lookup, near_surface).astype(dtype)
        if noise is None and bias == 0.0:
            found = [fetch(texture, x, y, z, threads=threads) for texture in textures]
        else:
            offsets = (np.zeros((1, 3, *(1,) * z.ndim), dtype) if noise is None else
                       tap_offsets(rows, columns, frame, taps=how.taps, reach=how.reach, depth_share=how.depth_share,
                                   noise=noise, dtype=dtype))
            found = [noisy_lookup(texture, x, y, z, offsets, bias=bias, nearest=nearest, fetch=fetch, threads=threads)
                     for texture in textures]
        radiance, transmittance = (found[0][:3], found[0][3:]) if len(found) == 1 else found
        if how.stored == "tone_mapped":
            radiance = tonemap.inverse_tone_map(radiance, largest_luma=most)
        return radiance, transmittance.reshape(*tint, *transmittance.shape[1:])

    return at


def lookup_bias(how: FogLookup, lookup: str) -> float:
    """How many slices nearer to the camera the fog is looked up.

    Parameters
    ----------
    how : FogLookup
    lookup : {"boundary", "centre"}

    Returns
    -------
    float
        As given; else 0 of one fetch, and of noisy taps 1.5 by "centre" [Dörries 2020, §3.2.7], which is half a slice
        too deep (D4), so 1 by "boundary".

    Examples
    --------
    >>> [lookup_bias(FogLookup(method="noisy"), lookup) for lookup in LOOKUPS]
    [1.0, 1.5]
    """
    if how.bias is not None:
        return how.bias
    return 0.0 if how.method != "noisy" else {"boundary": 1.0, "centre": 1.5}[lookup]


def _stored(texture: Field, how: FogLookup, *, toned: bool = False) -> Field:
    """A texture as it is kept: of radiance tone-mapped if so wanted, either in half floats."""
    if toned and how.stored == "tone_mapped":
        texture = tonemap.tone_map(texture)
    if how.storage == "full":
        return texture
    return store_half(texture)


def _first_texel(lookup: str) -> float:
    """Coordinate along z of the first stored value."""
    return 1.5 if lookup == "centre" else 2.5


def _texel_depth(depth: Field, grid: Grid, lookup: str, near_surface: str) -> NDArray[np.float64]:
    """Coordinate along z of the texture that `_texels` builds; texel i has its centre at i + ½.

    The texture begins with the camera's clear air, then has the front's values ("boundary" only), then the
    stored ones; ``first`` is the depth of the texel after the camera's.
    """
    s = depth_to_slice(np.clip(depth, grid.near, grid.far), grid)
    if lookup == "centre":
        first, position = float(slice_to_depth(0.5, grid)), s + 1.0
    else:
        first, position = grid.near, s + 1.5
    if near_surface == "first_slice":
        return np.maximum(position, _first_texel(lookup))
    return np.where(depth < first, depth / first + 0.5, position)


def _texels(values: Field, front: Field, at_camera: float, grid: Grid, lookup: str) -> Field:
    """The texture to fetch from: the stored values, with the camera's and the front's before them."""
    if values.shape[-3] < grid.depth:  # one texel stands for all depths
        return values
    shape = (*values.shape[:-3], 1, *values.shape[-2:])
    before = [np.broadcast_to(np.asarray(at_camera, values.dtype), shape)]
    if lookup == "boundary":
        before.append(np.broadcast_to(front[..., np.newaxis, :, :], shape))
    return np.concatenate([*before, values], axis=-3)


def composite(scene_radiance: Field, fog_radiance: Field, fog_transmittance: Field) -> Field:
    """Lay the fog over the scene.

    Parameters
    ----------
    scene_radiance : ndarray, shape (3, h, w)
        [W m⁻² sr⁻¹] What leaves the surfaces towards the camera, or the background.
    fog_radiance : ndarray, broadcastable to (3, h, w)
        [W m⁻² sr⁻¹] The fog's own light.
    fog_transmittance : ndarray, broadcastable to (3, h, w)
        [1] The share of the surface's light that passes.

    Returns
    -------
    ndarray, shape (3, h, w)
        [W m⁻² sr⁻¹] scene·T + L.

    Notes
    -----
    [Dörries 2020, eq. 2.11 and listing 3.5]. D5: its eq. 2.9 has the surface's term inside the integral
    over the ray, which adds it once per metre; who has it so passes ∫T dt along the ray [m] instead of T:
    what `froxel_ref.integrate.integrate` gives for a source of 1.

    Examples
    --------
    >>> import numpy as np
    >>> composite(np.full((3, 1, 1), 8.0), np.ones((3, 1, 1)), np.full((1, 1), 0.25)).ravel()
    array([3., 3., 3.])
    """
    result: Field = scene_radiance * fog_transmittance
    if result.shape == np.broadcast_shapes(result.shape, fog_radiance.shape):
        result += fog_radiance
        return result
    return np.asarray(result + fog_radiance)
