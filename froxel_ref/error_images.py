"""Images that errors are taken of: a smaller picture of the same view, its truth, and the distance of the two.

Errors are taken apart from the timed frames. Their raster has the view's shape and fewer pixels; a prime number of
its pixels shares the view's width with the froxels, so that pixels' centres fall on all places of froxels alike.
"""

from __future__ import annotations

import dataclasses
import math
import time
from collections import deque
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from froxel_ref import compare
from froxel_ref.assets import Assets, load_assets
from froxel_ref.flip import filter_reach, flip, flip_available, scaled_pixels_per_degree
from froxel_ref.frame import Frame, run_frame
from froxel_ref.quantities import final_result
from froxel_ref.records import InputError
from froxel_ref.report_record import Errors
from froxel_ref.scene import Camera, Scene
from froxel_ref.scene_files import Loaded
from froxel_ref.sequence import RATE, moment, moved_assets, run_sequence
from froxel_ref.settings import Settings, Switches, replace
from froxel_ref.truth_image import render_truth, shadow_kind

__all__ = [
    "PARTS_OF_IMAGE", "ReferenceImage", "Subject", "averages", "distance", "last_image", "make_subject", "no_flip",
    "raster", "reference_image", "regions", "whole_errors",
]

Image = NDArray[np.float64]

PARTS_OF_IMAGE = ("sky", "edges", "surfaces")
"""Regions of an image: nothing is hit; next door lies something at another depth, or nothing; all else."""

# Of the depth, beyond which two neighbouring pixels see two things.
STEP = 0.1


class Subject(NamedTuple):
    """What is measured.

    Attributes
    ----------
    loaded : Loaded
        Scene and base settings.
    assets : Assets
        Of the scene at its beginning.
    small : Scene
        The same with a camera of fewer pixels.
    small_assets : Assets
    frames : int
        The frame that is looked at is the last of so many; those that average over time begin with the first.
    rate : float [1/s]
        Of frames.
    """

    loaded: Loaded
    assets: Assets
    small: Scene
    small_assets: Assets
    frames: int
    rate: float = RATE

    @property
    def settings(self) -> Settings:
        """The base's."""
        return self.loaded.settings

    def now(self, settings: Settings, *, small: bool = False) -> tuple[Scene, Settings, Assets]:
        """Scene, settings and assets at the moment that is looked at."""
        scene, assets = (self.small, self.small_assets) if small else (self.loaded.scene, self.assets)
        there = moment(scene, None, self.frames - 1, rate=self.rate)
        later = replace(settings, time=settings.time + (self.frames - 1) / self.rate)
        return there, later, moved_assets(assets, scene, there)


class ReferenceImage(NamedTuple):
    """What images are held against; radiance is times the camera's exposure.

    Attributes
    ----------
    radiance, error : ndarray, float64, shape (3, h, w) [1]
        The truth, and its own estimate of its absolute error.
    converged : ndarray of bool, shape (h, w)
    seconds : float [s]
    """

    radiance: Image
    error: Image
    converged: NDArray[np.bool_]
    seconds: float


# --- the raster ---------------------------------------------------------------------------------------


def raster(camera: Camera, pixels: int, *, exactly: bool = False) -> tuple[int, int]:
    """A smaller size of the same shape.

    Parameters
    ----------
    camera : Camera
    pixels : int
        About how many it should have.
    exactly : bool
        Its pixels' centres must be centres of the camera's: for images that come from elsewhere.

    Returns
    -------
    width, height : int
        The camera's own if that is not larger. Of the same shape exactly where there is such a size not far from what
        is wanted, else to half a pixel.

    Notes
    -----
    A froxel of a grid g wide, seen by a raster r wide, has pixels at r/gcd(r, g) places; a prime r/(W/gcd(W, H))
    shares no factor with most grids.

    Examples
    --------
    >>> raster(Camera(width=960, height=540), 7000), raster(Camera(width=31, height=20), 7000)
    ((112, 63), (31, 20))
    >>> raster(Camera(width=1366, height=768), 7000)
    (119, 67)
    """
    parts = math.gcd(camera.width, camera.height)
    across, down = camera.width // parts, camera.height // parts
    if camera.width * camera.height <= pixels:
        return camera.width, camera.height
    fit = [k for k in range(1, parts + 1)
           if ((parts // k) % 2 == 1 and parts % k == 0 if exactly else _is_prime(k) or k == parts)]
    best = min(fit, key=lambda k: abs(math.log(across * down * k * k / pixels)), default=parts)
    rows = math.sqrt(pixels * camera.height / camera.width)
    height = next(n for n in range(max(2, math.floor(rows)), 2 * math.ceil(rows) + 4) if _is_prime(n))
    if exactly or across * down * best * best < 2.5 * pixels or height > camera.height:
        return across * best, down * best
    return max(1, round(height * camera.width / camera.height)), height


def _is_prime(number: int) -> bool:
    return number > 1 and all(number % k for k in range(2, math.isqrt(number) + 1))


def _smaller(scene: Scene, assets: Assets, pixels: int) -> tuple[Scene, Assets]:
    camera, own = scene.camera, scene.image_buffers is not None
    width, height = raster(camera, pixels, exactly=own)
    if own and width * height > 2.5 * pixels:
        return _lattice(scene, assets, pixels)
    small = dataclasses.replace(scene, camera=dataclasses.replace(camera, width=width, height=height))
    step = camera.width // width
    if not own or step == 1:
        return small, assets
    every = slice(step // 2, None, step)
    depth, radiance = (None if image is None else image[..., every, every]
                       for image in (assets.depth, assets.radiance))
    return small, assets._replace(depth=depth, radiance=radiance)


def _lattice(scene: Scene, assets: Assets, pixels: int) -> tuple[Scene, Assets]:
    """Every s-th pixel of images that come from elsewhere, s odd, a border left out so that the middle stays."""
    camera = scene.camera
    step = max(3, round(math.sqrt(camera.width * camera.height / pixels)) // 2 * 2 + 1)
    counts, slices = [], []
    for size in (camera.width, camera.height):
        count = size // step
        # As many pixels are left out on either side.
        count -= (size - (count - 1) * step - 1) % 2 if count > 1 else 0
        start = (size - (count - 1) * step - 1) // 2
        counts.append(count)
        slices.append(slice(start, start + (count - 1) * step + 1, step))
    half = math.tan(math.radians(0.5 * camera.vertical_fov)) * counts[1] * step / camera.height
    small = dataclasses.replace(scene, camera=dataclasses.replace(
        camera, width=counts[0], height=counts[1], vertical_fov=math.degrees(2.0 * math.atan(half))))
    depth, radiance = (None if image is None else image[..., slices[1], slices[0]]
                       for image in (assets.depth, assets.radiance))
    return small, assets._replace(depth=depth, radiance=radiance)


def make_subject(loaded: Loaded, *, pixels: int, frames: int, rate: float = RATE) -> Subject:
    """Read what a scene's files hold, and choose the raster.

    Parameters
    ----------
    loaded : Loaded
    pixels : int
        About how many the raster should have.
    frames : int
        Of points that average over time.
    rate : float [1/s]

    Returns
    -------
    Subject

    Raises
    ------
    InputError
        A file that cannot be read; tracks that lead to what is not allowed.
    """
    assets = load_assets(loaded.scene, loaded.folder)
    small, cut = _smaller(loaded.scene, assets, pixels)
    subject = Subject(loaded, assets, small, cut, frames, rate)
    subject.now(loaded.settings)
    return subject


# --- images ---------------------------------------------------------------------------------------------


def averages(settings: Settings) -> bool:
    """Whether a frame depends on the frames before it."""
    return settings.temporal.filter != "off" or settings.checkerboard or settings.taa.on


def exposed(frame: Frame) -> Image:
    """A frame's radiance times the camera's exposure, wherever that came in (A12)."""
    image: Image = np.broadcast_to(frame.image, (3, *_size(frame.scene))).astype(np.float64)
    return image * frame.display_exposure


def with_size(scene: Scene, finer: int) -> Scene:
    """A scene whose camera has so many times the pixels along each axis."""
    camera = scene.camera
    return dataclasses.replace(scene, camera=dataclasses.replace(camera, width=finer * camera.width,
                                                                 height=finer * camera.height))


def _size(scene: Scene) -> tuple[int, int]:
    return scene.camera.height, scene.camera.width


def last_image(subject: Subject, settings: Settings, *, frames: int | None = None, finer: int = 1,
               threads: int | None = None) -> Image:
    """The image that errors are taken of: on the raster, of the moment that is looked at.

    Parameters
    ----------
    subject : Subject
    settings : Settings
    frames : int, optional
        Frames before and with that moment; the subject's if the settings average over time, else one.
    finer : int
        Odd: pixels along each axis for one of the raster's, of which the middle one is taken.
    threads : int, optional

    Returns
    -------
    ndarray, float64, shape (3, h, w) [1]

    Raises
    ------
    InputError
        Settings that this scene cannot be run with.
    """
    final = final_result(settings)
    if finer > 1:
        subject = subject._replace(small=with_size(subject.small, finer))
    if not averages(settings):
        scene, how, assets = subject.now(settings, small=True)
        frame = run_frame(scene, how, assets=assets, outputs=[final], threads=threads, frame=subject.frames - 1)
        return exposed(frame)[:, finer // 2::finer, finer // 2::finer]
    count = min(frames or subject.frames, subject.frames)
    made = run_sequence(subject.small, frames=subject.frames, first=subject.frames - count, settings=settings,
                        rate=subject.rate, assets=subject.small_assets, outputs=[final], threads=threads)
    return exposed(deque(made, maxlen=1).pop())[:, finer // 2::finer, finer // 2::finer]


def reference_image(subject: Subject, *, rtol: float, threads: int | None = None,
                    progress: Callable[[int, int], None] | None = None) -> ReferenceImage:
    """The converged truth on the raster.

    Parameters
    ----------
    subject : Subject
    rtol : float
        As for `froxel_ref.truth.trace`.
    threads : int, optional
    progress : callable, optional
        Called as ``progress(rays done, rays)``.

    Returns
    -------
    ReferenceImage

    Notes
    -----
    Of the physics as it is right, whatever the settings' fidelity and switches; with the shadows that they have, of
    which a sun's are those of local media, as in frames; as far as the frame sees: to the froxels' far end, or to that
    of the long range.
    """
    scene, how, assets = subject.now(subject.settings, small=True)
    begun = time.perf_counter()
    right = replace(how, fidelity="corrected", switches=Switches())
    far = how.long_range.farthest if how.long_range.march else how.grid.far
    found = render_truth(scene, right, assets=assets, rtol=rtol, far=far, sun_media="local", threads=threads,
                         progress=progress)
    exposure = scene.camera.exposure
    radiance, error = (np.asarray(image * exposure, np.float64) for image in (found.radiance, found.error))
    return ReferenceImage(radiance, error, found.converged, time.perf_counter() - begun)


def reference_words(subject: Subject, rtol: float) -> str:
    """What the reference is, in a sentence."""
    how = subject.settings
    shadows = "no shadows" if shadow_kind(how) == "off" else "exact shadows"
    if how.volumetric_shadows != "off":
        shadows += " of surfaces, media and particles (of suns: local media)"
    return (f"converged single scattering along each pixel's ray, adaptive quadrature to a relative tolerance of "
            f"{rtol:g}, {shadows}.")


# --- errors ---------------------------------------------------------------------------------------------


def distance(image: Image, reference: Image, *, epsilon: float) -> Errors:
    """Norms of an image against the reference; those that cannot be taken are NaN, with the fault.

    Parameters
    ----------
    image, reference : ndarray, float64, shape (3, h, w) [1]
        Radiance times exposure.
    epsilon : float
        Of relMSE.

    Returns
    -------
    Errors
        Without FLIP.

    Examples
    --------
    >>> distance(np.full((3, 1, 2), 1.1), np.ones((3, 1, 2)), epsilon=0.01).bias.__round__(12)
    0.1
    """
    finite = np.isfinite(reference)
    if not finite.all():
        return Errors(math.nan, math.nan, math.nan, math.nan, None,
                      f"the reference is not finite in {int((~finite).sum())} of {finite.size} values")
    norms = (compare.relative_mse(image, reference, epsilon=epsilon), compare.bias(image, reference),
             compare.quantile(image, reference, 0.999), compare.maximum(image, reference),
             compare.absolute(image, reference))
    fault = next((norm.fault for norm in norms if norm.fault), "")
    if not fault and not all(math.isfinite(norm.value) for norm in norms):
        fault = f"the error is beyond all numbers: values up to {float(np.abs(image).max()):.3g}"
    if fault:
        return Errors(math.nan, math.nan, math.nan, math.nan, None, fault)
    mean = float(np.abs(reference).mean())
    relmse, bias, quantile, maximum, absolute = (norm.value for norm in norms)
    if mean == 0.0:
        if maximum == 0.0:
            return Errors(relmse, 0.0, 0.0, 0.0, absolute=0.0, worst=0.0)
        return Errors(math.nan, math.nan, math.nan, math.nan, None, "the reference is black: no share of its mean")
    each = np.sum(((image - reference) / np.sqrt(reference * reference + epsilon)) ** 2, axis=0)
    worst = float(each.max() / each.sum()) if maximum > 0.0 else 0.0
    return Errors(relmse, bias / mean, quantile / mean, maximum / mean, absolute=absolute / mean, worst=worst)


def whole_errors(image: Image, reference: Image, *, epsilon: float, exposure: float = 1.0,
                 pixels_per_degree: float | None = None) -> Errors:
    """Norms of an image against the reference, with HDR-FLIP where it is at hand.

    Parameters
    ----------
    image, reference, epsilon
        As for `distance`.
    exposure : float
        By which FLIP multiplies what it gets.
    pixels_per_degree : float, optional
        Without it there is no FLIP.

    Returns
    -------
    Errors
    """
    errors = distance(image, reference, epsilon=epsilon)
    if pixels_per_degree is None or errors.fault:
        return errors
    norm = flip(image, reference, exposure=exposure, pixels_per_degree=pixels_per_degree)
    return errors._replace(flip=norm.value, fault=norm.fault)


def no_flip(size: tuple[int, int], full_width: int) -> str:
    """Why FLIP cannot be taken of images of a raster; empty if it can.

    Parameters
    ----------
    size : tuple of int
        Width and height of the raster.
    full_width : int
        Of the view: the raster's pixels are so much larger on the screen.

    Returns
    -------
    str

    Examples
    --------
    >>> no_flip((112, 63), 5000)
    'needs at least 2 pixels per degree, these images have 1.5: they are 112 pixels wide, the frame 5000'
    """
    if not flip_available():
        return "needs the extra flip: python -m pip install -e '.[flip]'"
    density = scaled_pixels_per_degree(size[0], full_width)
    try:
        least = 2 * filter_reach(density) + 1
    except InputError:
        return (f"needs at least 2 pixels per degree, these images have {density:.2g}: they are {size[0]} pixels wide, "
                f"the frame {full_width}")
    if any(side != 1 and side < least for side in size):
        return (f"needs images of at least {least} x {least} pixels at {density:.3g} pixels per degree, these are "
                f"{size[0]} x {size[1]}")
    return ""


def regions(subject: Subject) -> dict[str, NDArray[np.bool_]]:
    """The raster's regions (`PARTS_OF_IMAGE`), those without a pixel left out.

    Parameters
    ----------
    subject : Subject

    Returns
    -------
    dict of str to ndarray of bool, shape (h, w)
        Each pixel lies in one.
    """
    scene, how, assets = subject.now(subject.settings, small=True)
    still = replace(how, shadows="off", taa=dataclasses.replace(how.taa, on=False))  # pixels' centres
    found = run_frame(scene, still, assets=assets, outputs=["surface/depth"])["surface/depth"]
    depth = np.broadcast_to(found, _size(scene)).astype(np.float64)
    nearness = 1.0 / depth  # 0 in the sky
    edge = np.zeros(depth.shape, bool)
    for axis in (0, 1):
        ahead, behind = np.split(nearness, [1], axis)[1], np.split(nearness, [-1], axis)[0]
        apart = np.abs(ahead - behind) > STEP * np.maximum(ahead, behind)
        pad = [(0, 0), (0, 0)]
        pad[axis] = (1, 0)
        edge |= np.pad(apart, pad)
        pad[axis] = (0, 1)
        edge |= np.pad(apart, pad)
    sky = np.isinf(depth) & ~edge
    parts = dict(zip(PARTS_OF_IMAGE, (sky, edge, ~sky & ~edge), strict=True))
    return {name: mask for name, mask in parts.items() if mask.any()}
