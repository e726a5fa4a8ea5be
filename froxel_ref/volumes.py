"""Density textures: from noise, and from files that are not trusted (``.vol``, ``.npy``, raw).

A reader looks at a file's header and its real size before it sets aside any memory, and never runs what
is in a file (no pickles). Every fault is one `InputError` that names the file and what is wrong with it.
"""

from __future__ import annotations

import ast
import math
import os
import stat
import struct
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import DTypeLike, NDArray

from froxel_ref.records import InputError, shown
from froxel_ref.scene import NoiseDensity, VolumeDensity

__all__ = ["noise", "open_input", "read_density", "read_npy", "read_vol", "refuse"]

StrPath = str | os.PathLike[str]
Bounds = tuple[tuple[float, float, float], tuple[float, float, float]]

# 1024³ values, 8 GB in float64: what states more is taken for a broken header, whatever the file's size.
MAX_VALUES = 2**30
# A plain array's header takes 128 bytes; a longer one would only be work for the parser.
MAX_NPY_HEADER = 2048

_VOL_HEADER = struct.Struct("<3sB5i6f")
_VOL_FLOAT32 = 1

# The twelve edge directions of a cube: gradients without a preferred axis that cost no multiplications.
_EDGES = np.array([[x, y, z] for x in (-1, 0, 1) for y in (-1, 0, 1) for z in (-1, 0, 1)
                   if abs(x) + abs(y) + abs(z) == 2], dtype=np.float64)


# --- files ------------------------------------------------------------------------------------------


@contextmanager
def open_input(path: StrPath, *, place: str = "") -> Iterator[tuple[BinaryIO, int]]:
    """A user's file, open for reading, and its size; whatever the system says against it is an `InputError`.

    Parameters
    ----------
    path : path
        The file.
    place : str
        Where the path was given, for messages.

    Yields
    ------
    file : binary file
        Positioned at its start.
    size : int
        Its length [bytes].

    Raises
    ------
    InputError
        Missing, a directory, not a regular file, not readable; memory too small for what is read.

    Examples
    --------
    >>> with open_input("no/such/file"):
    ...     pass
    Traceback (most recent call last):
    froxel_ref.records.InputError: 'no/such/file' does not exist
    """
    try:
        mode = os.stat(path).st_mode
        if not stat.S_ISREG(mode):  # before open(), which would wait for ever on a pipe
            raise _fault(path, place, f"is {'a directory' if stat.S_ISDIR(mode) else 'not a regular file'}")
        file = open(path, "rb")  # noqa: SIM115
    except FileNotFoundError:
        raise _fault(path, place, "does not exist") from None
    except OSError as error:
        raise _fault(path, place, f"cannot be opened: {error.strerror or error}") from None
    except ValueError as error:
        if isinstance(error, InputError):
            raise
        raise _fault(path, place, f"is not a file name ({error})") from None
    with file:
        try:
            yield file, os.fstat(file.fileno()).st_size
        except MemoryError:
            raise _fault(path, place, "does not fit in memory") from None
        except OSError as error:
            raise _fault(path, place, f"cannot be read: {error.strerror or error}") from None


def read_npy(path: StrPath, *, ndim: int | None = None, place: str = "") -> NDArray[Any]:
    """The array of numbers in a ``.npy`` file.

    Parameters
    ----------
    path : path
        The file.
    ndim : int, optional
        How many axes it must have.
    place : str
        Where the path was given, for messages.

    Returns
    -------
    ndarray
        C-contiguous, native byte order, in the file's own dtype: an integer or float of 1 to 8 bytes.

    Raises
    ------
    InputError
        Any fault of the file: not such a file, another dtype (pickled objects among them), another number
        of axes, empty, too large, truncated or longer than stated.

    Notes
    -----
    Format versions 1 to 3 of the NumPy enhancement proposal 1. The header is a Python literal; it is
    parsed as one, never evaluated. `numpy.load` is not used: it trusts the stated shape.

    Examples
    --------
    >>> import tempfile, pathlib
    >>> path = pathlib.Path(tempfile.mkdtemp(), "a.npy")
    >>> np.save(path, np.asfortranarray([[1.0, 2.0], [3.0, 4.0]]))
    >>> read_npy(path, ndim=2)
    array([[1., 2.],
           [3., 4.]])
    """
    with open_input(path, place=place) as (file, size):
        dtype, shape, fortran = _npy_header(file, path, place)
        if ndim is not None and len(shape) != ndim:
            raise _fault(path, place, f"has {len(shape)} axes {shown(shape)}, must have {ndim}")
        order = shape[::-1] if fortran else shape
        values = _values(file, size, dtype, order, path, place)
        return np.ascontiguousarray(values.T) if fortran else values


def _npy_header(file: BinaryIO, path: StrPath, place: str) -> tuple[np.dtype[Any], tuple[int, ...], bool]:
    start = file.read(8)
    if start[:6] != b"\x93NUMPY" or len(start) < 8:
        raise _fault(path, place, "is not a .npy file (it does not begin with its signature)")
    if start[6] not in (1, 2, 3):
        raise _fault(path, place, f"has .npy version {start[6]}, must be 1, 2 or 3")
    width = 2 if start[6] == 1 else 4
    length = int.from_bytes(file.read(width), "little")
    if length > MAX_NPY_HEADER:
        raise _fault(path, place, f"has a .npy header of {length} bytes, must have at most {MAX_NPY_HEADER}")
    raw = file.read(length)
    if len(raw) < length:
        raise _fault(path, place, "is truncated within its .npy header")
    header = _literal(raw, "utf-8" if start[6] == 3 else "latin-1")
    if not isinstance(header, dict) or set(header) != {"descr", "fortran_order", "shape"}:
        raise _fault(path, place, "has a .npy header that is not a dict of descr, fortran_order and shape")
    shape, fortran = header["shape"], header["fortran_order"]
    if not isinstance(shape, tuple) or not all(type(n) is int for n in shape) or type(fortran) is not bool:
        raise _fault(path, place, "has a .npy header whose shape or fortran_order is of the wrong type")
    return _npy_dtype(header["descr"], path, place), shape, fortran


def _literal(raw: bytes, encoding: str) -> Any:
    """The Python literal in a header, None where there is none."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # what a broken string escape gives, before it is refused
            return ast.literal_eval(raw.decode(encoding).strip())
    except (ValueError, SyntaxError, TypeError, MemoryError, RecursionError):
        return None


def _npy_dtype(described: Any, path: StrPath, place: str) -> np.dtype[Any]:
    allowed = "must hold integers or floats of 1 to 8 bytes"
    if isinstance(described, str) and described.lstrip("<>|=") == "O":
        raise _fault(path, place, f"holds pickled Python objects, which are never read; {allowed}")
    # Only the plain form: numpy.dtype() itself also takes repeat counts, field lists and deprecated names.
    plain = isinstance(described, str) and len(described) == 3 and described[0] in "<>|=" \
        and described[1] in "iuf" and described[2] in "1248" and described[1:] != "f1"
    if not plain:
        raise _fault(path, place, f"holds {shown(described)}, {allowed}")
    dtype: np.dtype[Any] = np.dtype(described)
    return dtype


def _values(file: BinaryIO, size: int, dtype: np.dtype[Any], shape: tuple[int, ...], path: StrPath,
            place: str) -> NDArray[Any]:
    """The rest of the file as an array in C order, after its size has been held against what is stated."""
    if any(n < 1 for n in shape):
        raise _fault(path, place, f"states the shape {shown(shape)}, every length must be at least 1")
    if math.prod(shape) > MAX_VALUES:
        raise _fault(path, place, f"states the shape {shown(shape)}, more than {MAX_VALUES} values in all")
    count = math.prod(shape)
    stated, real = count * dtype.itemsize, size - file.tell()
    if stated != real:
        what = "is truncated" if real < stated else "is longer than it states"
        raise _fault(path, place, f"{what}: shape {shown(shape)} of {dtype.name} takes {stated} bytes "
                                  f"after the header, the file has {real}")
    values = np.fromfile(file, dtype, count)
    if values.size != count:  # it shrank while being read
        raise _fault(path, place, "is truncated")
    return values.astype(dtype.newbyteorder("="), copy=False).reshape(shape)


def _fault(path: StrPath, place: str, problem: str) -> InputError:
    return InputError(place, f"{os.fspath(path)!r} {problem}")


def read_vol(path: StrPath, *, place: str = "") -> tuple[NDArray[np.float32], Bounds]:
    """The grid and the bounding box of a Mitsuba grid volume (``.vol``).

    Parameters
    ----------
    path : path
        The file.
    place : str
        Where the path was given, for messages.

    Returns
    -------
    values : ndarray, float32, shape (nz, ny, nx)
        The grid.
    bounds : ((xmin, ymin, zmin), (xmax, ymax, zmax))
        The two corners of its box, in the units of the program that wrote it.

    Raises
    ------
    InputError
        Any fault of the file.

    Notes
    -----
    Bytes ``VOL``, uint8 version 3, int32 type (1: float32, the only one read), int32 nx, ny, nz and
    channels (1), six float32 bounds, then the values, x fastest; little-endian [Mitsuba 0.6, gridvolume].

    Examples
    --------
    >>> import tempfile
    >>> path = Path(tempfile.mkdtemp(), "two.vol")
    >>> header = struct.pack("<3sB5i6f", b"VOL", 3, 1, 2, 1, 1, 1, 0.0, 0.0, 0.0, 2.0, 1.0, 1.0)
    >>> _ = path.write_bytes(header + struct.pack("<2f", 0.25, 0.75))
    >>> read_vol(path)
    (array([[[0.25, 0.75]]], dtype=float32), ((0.0, 0.0, 0.0), (2.0, 1.0, 1.0)))
    """
    with open_input(path, place=place) as (file, size):
        shape, bounds = _vol_header(file, path, place)
        return _values(file, size, np.dtype("<f4"), shape, path, place), bounds


def _vol_header(file: BinaryIO, path: StrPath, place: str) -> tuple[tuple[int, int, int], Bounds]:
    raw = file.read(_VOL_HEADER.size)
    if raw[:3] != b"VOL":
        raise _fault(path, place, "is not a .vol file (it does not begin with 'VOL')")
    if len(raw) < _VOL_HEADER.size:
        raise _fault(path, place, f"is truncated: {len(raw)} bytes, a .vol header takes {_VOL_HEADER.size}")
    _, version, kind, nx, ny, nz, channels, *corners = _VOL_HEADER.unpack(raw)
    if version != 3:
        raise _fault(path, place, f"has .vol version {version}, must be 3")
    if kind != _VOL_FLOAT32:
        raise _fault(path, place, f"has .vol type {kind}, must be {_VOL_FLOAT32} (float32)")
    if channels != 1:
        raise _fault(path, place, f"has {channels} channels, must have 1")
    low, high = tuple(corners[:3]), tuple(corners[3:])
    if not all(math.isfinite(a) and math.isfinite(b) and a < b for a, b in zip(low, high, strict=True)):
        raise _fault(path, place, f"has the bounds {low} to {high}, must be finite and not empty")
    return (nz, ny, nx), (low, high)


# --- densities --------------------------------------------------------------------------------------


def read_density(source: VolumeDensity, path: StrPath, *, place: str = "",
                 dtype: DTypeLike = np.float64) -> NDArray[Any]:
    """The density texture that a file holds.

    Parameters
    ----------
    source : VolumeDensity
        Its multiplier and, for raw files, shape and dtype.
    path : path
        The file itself; its extension tells the format.
    place : str
        Where the source stands in the scene, for messages.
    dtype : dtype
        Of the result; values are converted in float64 and rounded once.

    Returns
    -------
    ndarray, shape (nz, ny, nx)
        Finite, not negative. Integers (uint8, uint16) span [0, 1]; all are times the multiplier.

    Raises
    ------
    InputError
        Any fault of the file; NaN, infinite or negative densities; an unknown extension.

    Examples
    --------
    >>> import tempfile
    >>> path = Path(tempfile.mkdtemp(), "smoke.raw")
    >>> _ = path.write_bytes(bytes([0, 51, 102, 255]))
    >>> read_density(VolumeDensity(path="smoke.raw", shape=(1, 2, 2), dtype="uint8", multiplier=2.0), path)
    array([[[0. , 0.4],
            [0.8, 2. ]]])
    """
    values = _stored(source, path, place)
    where = _under(place, "path")
    if values.dtype.kind != "f" and values.dtype not in (np.uint8, np.uint16):
        raise _fault(path, where, f"holds {values.dtype.name}, must be a float, uint8 or uint16")
    top = 1.0 if values.dtype.kind == "f" else float(np.iinfo(values.dtype).max)
    with np.errstate(all="ignore"):  # what overflows is infinite, and refused below
        density = values.astype(np.float64)
        if top != 1.0:
            density /= top
        density *= source.multiplier
        density = density.astype(dtype, copy=False)
    refuse(density, ~(np.isfinite(density) & (density >= 0.0)), "densities must be finite and at least 0",
           path, place=where)
    return density


def _stored(source: VolumeDensity, path: StrPath, place: str) -> NDArray[Any]:
    extension, where = Path(path).suffix.lower(), _under(place, "path")
    if extension in (".vol", ".npy"):
        for name in ("shape", "dtype"):
            if getattr(source, name) is not None:
                raise InputError(_under(place, name), f"is given, but a {extension} file states its own")
        return read_vol(path, place=where)[0] if extension == ".vol" else read_npy(path, ndim=3, place=where)
    if source.shape is None or source.dtype is None:
        raise _fault(path, where, "is neither .vol nor .npy; a raw file needs 'shape' (z, y, x) and 'dtype'")
    with open_input(path, place=where) as (file, size):
        return _values(file, size, np.dtype(source.dtype).newbyteorder("<"), source.shape, path, where)


def refuse(values: NDArray[Any], wrong: NDArray[np.bool_], rule: str, path: StrPath, *,
           place: str = "") -> None:
    """Raise `InputError` if any value is wrong; it shows how many are, the first of them and the rule.

    Parameters
    ----------
    values, wrong : ndarray
        The values of a file, and where they break the rule.
    rule : str
        What must hold, as a clause.
    path : path
        The file, for the message.
    place : str
        Where the path was given, for the message.

    Raises
    ------
    InputError
        If any value is wrong.

    Examples
    --------
    >>> heights = np.array([1.0, -2.0, -3.0])
    >>> refuse(heights, heights < 0.0, "must be at least 0", "h.npy", place="heights")
    Traceback (most recent call last):
    froxel_ref.records.InputError: heights: 'h.npy' holds -2 at [1] (2 such values); must be at least 0
    """
    count = int(np.count_nonzero(wrong))
    if count:
        first = np.unravel_index(int(np.argmax(wrong)), wrong.shape)
        index = ", ".join(str(int(i)) for i in first)
        raise _fault(path, place, f"holds {values[first]:g} at [{index}] ({count} such values); {rule}")


def _under(place: str, name: str) -> str:
    return f"{place}.{name}" if place else name


# --- noise ------------------------------------------------------------------------------------------


def noise(source: NoiseDensity) -> NDArray[np.float64]:
    """A periodic density texture: octaves of gradient noise, spread about ½ and cut to [0, 1].

    Parameters
    ----------
    source : NoiseDensity
        Seed, size n, cells, octaves, contrast.

    Returns
    -------
    ndarray, float64, shape (n, n, n)
        Texels at the texel centres (i + ½)/n of the period.

    Notes
    -----
    Octave k is gradient noise on a periodic lattice of cells·2^k points a side, with weight 2^−k: at each
    lattice point one of the twelve edge directions of a cube; between them the gradients' ramps, blended
    by the quintic 6t⁵ − 15t⁴ + 10t³ [Perlin 2002]. The weighted mean of the octaves, in about (−1, 1), is
    N; the density is clip(½ + ½·contrast·N, 0, 1). Octaves after the first whose cells are smaller than
    two texels are left out, since the texture could not hold them. Each octave has the texture's period.

    The lattice is drawn from the generator's raw words, whose stream NumPy keeps from version to version
    (that of its distributions it does not), and everything after is sums and products: the same bytes
    on every machine.

    Examples
    --------
    >>> noise(NoiseDensity(seed=7, size=16)).shape
    (16, 16, 16)
    """
    bits = np.random.default_rng(source.seed).bit_generator
    total = np.zeros((source.size,) * 3)
    weights = 0.0
    for octave in range(source.octaves):
        cells = source.cells * 2**octave
        if octave and 2 * cells > source.size:
            break
        edges = (bits.random_raw(cells**3) % len(_EDGES)).astype(np.intp)
        _add_octave(total, _EDGES[edges.reshape(cells, cells, cells)], 0.5**octave)
        weights += 0.5**octave
    total *= 0.5 * source.contrast / weights
    total += 0.5
    return np.clip(total, 0.0, 1.0, out=total)


def _add_octave(total: NDArray[np.float64], lattice: NDArray[np.float64], weight: float) -> None:
    """Add ``weight`` times the gradient noise of one lattice (cells, cells, cells, 3) to (n, n, n).

    The noise is Σ over corners of Π fade · (gradient · offset). Both factors are products over the axes,
    so the sum is taken one axis at a time; only the last one runs at the texture's full size.
    """
    count, cells = total.shape[0], lattice.shape[0]
    position = (np.arange(count) + 0.5) / count * cells
    low = np.floor(position).astype(np.intp)
    t = position - low
    fade = t * t * t * (t * (t * 6.0 - 15.0) + 10.0)
    ends = (low, (low + 1) % cells)
    plain = (1.0 - fade, fade)                          # a corner's share
    ramp = (plain[0] * t, plain[1] * (t - 1.0))         # its share times the offset from it

    def along(array: NDArray[np.float64], axis: int, factors: tuple[Any, Any]) -> NDArray[np.float64]:
        shape = tuple(count if i == axis else 1 for i in range(array.ndim))
        near: NDArray[np.float64] = array.take(ends[0], axis) * factors[0].reshape(shape)
        far = array.take(ends[1], axis) * factors[1].reshape(shape)
        near += far
        return near

    gx, gy, gz = np.moveaxis(lattice, -1, 0)
    across = along(along(gx, 2, ramp), 1, plain) + along(along(gy, 2, plain), 1, ramp)
    upward = along(along(gz, 2, plain), 1, plain)
    for k in range(count):
        for end, share, lift in zip(ends, plain, ramp, strict=True):
            total[k] += weight * share[k] * across[end[k]] + weight * lift[k] * upward[end[k]]
