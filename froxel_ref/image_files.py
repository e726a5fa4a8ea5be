"""Image files: ``.png`` as displayed, ``.npy`` and ``.exr`` with linear radiance."""

from __future__ import annotations

import importlib.util
from collections.abc import Callable
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from froxel_ref.arrays import Field
from froxel_ref.pictures import View, final_image
from froxel_ref.records import InputError, shown

if TYPE_CHECKING:
    from froxel_ref.frame import Frame

__all__ = ["ENDINGS", "display_image", "image_writer", "linear_image", "save_image", "write_png"]

ENDINGS = (".png", ".npy", ".exr")
"""Of files that hold an image."""


def image_writer(path: Path) -> Callable[[Path, Frame], None]:
    """How a file of this name's ending is written.

    Parameters
    ----------
    path : Path
        Its ending, in any case, is ``.png`` (exposed, tone-mapped, sRGB, 8 bits), ``.npy`` (linear
        radiance in the frame's precision) or ``.exr`` (linear radiance in float32).

    Returns
    -------
    callable
        ``write(path, frame)``.

    Raises
    ------
    InputError
        Another ending, or ``.exr`` without OpenEXR. Nothing is guessed: imageio alone would write a TIFF
        under the name ``.exr`` and say nothing.

    Examples
    --------
    >>> image_writer(Path("fog.tiff"))
    Traceback (most recent call last):
        ...
    froxel_ref.records.InputError: output: 'fog.tiff' must end in one of .png, .npy, .exr
    """
    writers = dict(zip(ENDINGS, (_write_display, _write_npy, _write_exr), strict=True))
    ending = path.suffix.lower()
    if ending not in writers:
        raise InputError("output", f"{shown(str(path))} must end in one of {', '.join(writers)}")
    if ending == ".exr" and importlib.util.find_spec("OpenEXR") is None:
        raise InputError("output", "writing .exr needs OpenEXR: python -m pip install 'froxel-ref[exr]'")
    return writers[ending]


def linear_image(frame: Frame) -> Field:
    """The final radiance at the camera's size.

    Parameters
    ----------
    frame : Frame
        With its final image.

    Returns
    -------
    array, shape (height, width, 3) [W m⁻² sr⁻¹]
        Linear RGB, C-contiguous, in the frame's precision.

    Examples
    --------
    >>> import froxel_ref
    >>> scene, settings, _ = froxel_ref.load("uniform", overrides=[
    ...     "camera.width=4", "camera.height=2", "grid.width=2", "grid.height=2", "grid.depth=2"])
    >>> frame = froxel_ref.run_frame(scene, settings)
    >>> linear_image(frame).shape
    (2, 4, 3)
    """
    camera = frame.scene.camera
    whole = np.broadcast_to(frame.image, (3, camera.height, camera.width))
    return np.ascontiguousarray(np.moveaxis(whole, 0, -1))


def write_png(path: Path, image: NDArray[np.uint8]) -> None:
    """Write an 8-bit RGB image as PNG; the same image gives the same bytes.

    Parameters
    ----------
    path : Path
        The file; one that stands there is replaced.
    image : array of uint8, shape (height, width, 3)
        As displayed, sRGB.

    Raises
    ------
    OSError
        It cannot be written.

    Examples
    --------
    >>> import tempfile
    >>> path = Path(tempfile.mkdtemp(), "black.png")
    >>> write_png(path, np.zeros((2, 4, 3), np.uint8))
    >>> path.read_bytes()[:4]
    b'\\x89PNG'
    """
    import imageio.v3 as iio

    path.write_bytes(iio.imwrite("<bytes>", image, extension=".png", plugin="pillow"))


def display_image(frame: Frame) -> NDArray[np.uint8]:
    """The final image as displayed: exposed, tone-mapped, sRGB.

    Parameters
    ----------
    frame : Frame
        With its final image.

    Returns
    -------
    array of uint8, shape (height, width, 3)

    Examples
    --------
    >>> import froxel_ref
    >>> scene, settings, _ = froxel_ref.load("vacuum", overrides=["camera.width=4", "camera.height=2"])
    >>> display_image(froxel_ref.run_frame(scene, settings)).shape
    (2, 4, 3)
    """
    return final_image(frame.image, View(frame.scene.camera, frame.settings.grid, frame.display_exposure))


def save_image(frame: Frame, path: str | PathLike[str]) -> None:
    """Write a frame's final image.

    Parameters
    ----------
    frame : Frame
        With its final image.
    path : path
        Its ending says what is written, as for `image_writer`; a file that stands there is replaced.

    Raises
    ------
    InputError
        Another ending.
    OSError
        It cannot be written.

    Examples
    --------
    >>> import tempfile
    >>> import froxel_ref
    >>> scene, settings, _ = froxel_ref.load("vacuum", overrides=["camera.width=4", "camera.height=2"])
    >>> save_image(froxel_ref.run_frame(scene, settings), Path(tempfile.mkdtemp(), "vacuum.png"))
    """
    place = Path(path)
    image_writer(place)(place, frame)


def _write_display(path: Path, frame: Frame) -> None:
    write_png(path, display_image(frame))


def _write_npy(path: Path, frame: Frame) -> None:
    image = linear_image(frame)
    image = image.astype(image.dtype.newbyteorder("<"), copy=False)
    with path.open("wb") as file:  # not np.save, which hides what the system says of a full disk
        np.lib.format.write_array_header_1_0(file, np.lib.format.header_data_from_array_1_0(image))
        file.write(image.data)


def _write_exr(path: Path, frame: Frame) -> None:
    import OpenEXR  # type: ignore[import-not-found,import-untyped,unused-ignore]

    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    with OpenEXR.File(header, {"RGB": linear_image(frame).astype(np.float32)}) as file:
        file.write(str(path))
