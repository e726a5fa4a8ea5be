"""Density volumes: what files say, what lies they tell, and noise."""

from __future__ import annotations

import io
import math
import os
import pickle
import struct
import tracemalloc
from pathlib import Path

import numpy as np
import pytest
from data import data_file
from hypothesis import example, given
from hypothesis import strategies as st

from froxel_ref import volumes
from froxel_ref.records import InputError
from froxel_ref.scene import NoiseDensity, VolumeDensity
from froxel_ref.volumes import noise, open_input, read_density, read_npy, read_vol, refuse

BOUNDS = (-1.0, 0.0, 2.0, 1.0, 4.0, 2.5)


def vol_bytes(array: np.ndarray, bounds: tuple[float, ...] = BOUNDS, *, version: int = 3, kind: int = 1,
              channels: int = 1) -> bytes:
    nz, ny, nx = array.shape
    header = struct.pack("<3sB5i6f", b"VOL", version, kind, nx, ny, nz, channels, *bounds)
    return header + array.astype("<f4").tobytes()


def npy_bytes(array: np.ndarray, *, version: tuple[int, int] | None = None, pickled: bool = False) -> bytes:
    file = io.BytesIO()
    np.lib.format.write_array(file, array, version=version, allow_pickle=pickled)
    return file.getvalue()


def npy_with_header(header: str, data: bytes = b"", version: int = 1) -> bytes:
    raw = header.encode("latin-1")
    length = len(raw).to_bytes(2 if version == 1 else 4, "little")
    return b"\x93NUMPY" + bytes([version, 0]) + length + raw + data


def written(folder: Path, name: str, data: bytes) -> Path:
    path = folder / name
    path.write_bytes(data)
    return path


GRID = np.arange(24, dtype=np.float32).reshape(2, 3, 4) / 8


# --- .vol -----------------------------------------------------------------------------------------------


def test_vol_by_hand(tmp_path: Path) -> None:
    data = (b"VOL\x03" + b"\x01\0\0\0" + b"\x02\0\0\0" + b"\x01\0\0\0" + b"\x03\0\0\0" + b"\x01\0\0\0"
            + struct.pack("<6f", *BOUNDS) + struct.pack("<6f", 0.0, 0.5, 1.0, 1.5, 2.0, 2.5))
    values, bounds = read_vol(written(tmp_path, "a.vol", data))
    assert values.tolist() == [[[0.0, 0.5]], [[1.0, 1.5]], [[2.0, 2.5]]]  # x fastest
    assert values.dtype == np.float32
    assert bounds == ((-1.0, 0.0, 2.0), (1.0, 4.0, 2.5))


VOL = vol_bytes(GRID)


@pytest.mark.parametrize(("data", "words"), [
    (b"", "does not begin with 'VOL'"),
    (b"PK\x03\x04" + VOL[4:], "does not begin with 'VOL'"),
    (VOL[:20], "truncated: 20 bytes"),
    (VOL[:-1], r"truncated: shape \(2, 3, 4\) of float32 takes 96 bytes after the header, the file has 95"),
    (VOL + b"\0", "longer than it states"),
    (vol_bytes(GRID, version=2), "version 2, must be 3"),
    (vol_bytes(GRID, kind=3), r"type 3, must be 1 \(float32\)"),
    (vol_bytes(GRID, channels=3), "3 channels, must have 1"),
    (vol_bytes(GRID, (0, 0, 0, 1, 0, 1)), "bounds .* must be finite and not empty"),
    (vol_bytes(GRID, (0, 0, math.nan, 1, 1, 1)), "bounds .* must be finite"),
    (struct.pack("<3sB5i6f", b"VOL", 3, 1, 10**4, 10**4, 10**4, 1, *BOUNDS), "more than 1073741824 values"),
    (struct.pack("<3sB5i6f", b"VOL", 3, 1, -4, 3, -2, 1, *BOUNDS), "at least 1"),
    (struct.pack("<3sB5i6f", b"VOL", 3, 1, 0, 3, 2, 1, *BOUNDS), "at least 1"),
])
def test_vol_lies_are_refused(tmp_path: Path, data: bytes, words: str) -> None:
    path = written(tmp_path, "lie.vol", data)
    with pytest.raises(InputError, match=words) as fault:
        read_vol(path, place="here")
    one_line(fault.value, "here", path)


def one_line(fault: InputError, place: str, path: Path) -> None:
    assert str(fault).startswith(f"{place}: ")
    assert "\n" not in str(fault)
    assert repr(str(path)) in str(fault)


def test_the_smoke_plume() -> None:
    path = data_file("smoke.vol")
    density = read_density(VolumeDensity(path="smoke.vol"), path)
    assert density.shape == (53, 45, 44)  # the file states 44 x 45 x 53
    assert (density.min(), density.max()) == (0.0, np.float32(1.8496094))
    low, high = read_vol(path)[1]
    texel = np.subtract(high, low) / (44, 45, 53)
    np.testing.assert_allclose(texel, texel[0], rtol=0.03)  # cubes, nearly, as a grid of smoke should have


# --- .npy -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("version", [(1, 0), (2, 0), (3, 0)])
@pytest.mark.parametrize("dtype", ["<f4", ">f8", "<f2", "|u1", ">u2", "<i8", ">i4"])
@pytest.mark.parametrize("order", ["C", "F"])
def test_npy_reads_back(tmp_path: Path, version: tuple[int, int], dtype: str, order: str) -> None:
    array = np.arange(24).reshape(2, 3, 4).astype(dtype, order=order)  # type: ignore[call-overload]
    got = read_npy(written(tmp_path, "a.npy", npy_bytes(array, version=version)), ndim=3)
    np.testing.assert_array_equal(got, array)
    assert got.dtype == np.dtype(dtype).newbyteorder("=")
    assert got.dtype.isnative
    assert got.flags.c_contiguous


def test_npy_by_hand(tmp_path: Path) -> None:
    header = "{'shape': (2, 1), 'fortran_order': False, 'descr': '>u2'}"
    path = written(tmp_path, "a.npy", npy_with_header(header, b"\x01\x00\x00\x02"))
    assert read_npy(path).tolist() == [[256], [2]]


F4 = "{{'descr': '{}', 'fortran_order': {}, 'shape': {}, }}"


@pytest.mark.parametrize(("data", "words"), [
    (b"", "signature"),
    (b"\x93NUMPY", "signature"),
    (b"PK\x03\x04whatever", "signature"),
    (npy_bytes(GRID)[:60], "truncated within"),
    (npy_bytes(GRID)[:-3], "truncated: shape"),
    (npy_bytes(GRID) + b"\0" * 5, "longer than it states"),
    (b"\x93NUMPY\x09\0" + npy_bytes(GRID)[8:], "version 9"),
    (npy_bytes(np.array([None, {}]), pickled=True), "pickled Python objects, which are never read"),
    (npy_bytes(np.zeros(3, [("a", "f4")])), "must hold integers or floats"),
    (npy_bytes(np.zeros(3, complex)), "'<c16', must hold"),
    (npy_bytes(np.zeros(3, bool)), "'|b1', must hold"),
    (npy_bytes(np.zeros(3, "M8[s]")), "must hold"),
    (npy_bytes(np.array(["text"])), "must hold"),
    (npy_bytes(np.zeros((3, 0, 2))), "at least 1"),
    (npy_with_header(F4.format("<f4", False, (10**4,) * 3)), "more than 1073741824 values"),
    (npy_with_header(F4.format("<f4", False, (2**62, 4))), "more than"),
    (npy_with_header(F4.format("<f4", False, "(0x" + "f" * 1500 + ",)")), "more than"),
    (npy_with_header(F4.format("<f4", False, (-1, -4))), "at least 1"),
    (npy_with_header(F4.format("<f4", False, "(True, 4)")), "wrong type"),
    (npy_with_header(F4.format("<f4", False, "4")), "wrong type"),
    (npy_with_header(F4.format("<f4", 1, (4,))), "wrong type"),
    (npy_with_header(F4.format("<f4", False, "(4L,)")), "not a dict"),
    (npy_with_header(F4.format("<f1", False, (4,))), "must hold"),
    (npy_with_header(F4.format("2<f4", False, (4,))), "must hold"),
    (npy_with_header("__import__('os').system('false')"), "not a dict"),
    (npy_with_header("[" * 1900), "not a dict"),
    (npy_with_header("{'descr': '\\d'}"), "not a dict"),
    (npy_with_header("{}" + " " * 70000, version=2), "header of 70002 bytes"),
])
def test_npy_lies_are_refused(tmp_path: Path, data: bytes, words: str) -> None:
    path = written(tmp_path, "lie.npy", data)
    with pytest.raises(InputError, match=words) as fault:
        read_npy(path, place="here")
    one_line(fault.value, "here", path)


def test_wrong_number_of_axes(tmp_path: Path) -> None:
    path = written(tmp_path, "flat.npy", npy_bytes(GRID[0]))
    with pytest.raises(InputError, match=r"has 2 axes \(3, 4\), must have 3"):
        read_npy(path, ndim=3)


def test_pickles_never_run(tmp_path: Path) -> None:
    class Trap:
        def __reduce__(self) -> tuple[object, tuple[str]]:
            return os.mkdir, (str(tmp_path / "sprung"),)

    for name in ("a.npy", "b.npy"):
        data = npy_bytes(np.array([Trap()]), pickled=True) if name == "a.npy" else pickle.dumps(Trap())
        with pytest.raises(InputError):
            read_npy(written(tmp_path, name, data))
    assert not (tmp_path / "sprung").exists()


@pytest.mark.parametrize("data", [
    npy_with_header(F4.format("<f8", False, (512, 512, 4096))),
    struct.pack("<3sB5i6f", b"VOL", 3, 1, 1024, 1024, 1024, 1, *BOUNDS)])
def test_nothing_is_set_aside_for_a_lie(tmp_path: Path, data: bytes) -> None:
    path = written(tmp_path, "lie", data)
    tracemalloc.start()
    try:
        with pytest.raises(InputError, match="truncated"):
            (read_vol if data[:3] == b"VOL" else read_npy)(path)
        assert tracemalloc.get_traced_memory()[1] < 1e6  # what they state takes 8 and 4 GB
    finally:
        tracemalloc.stop()


# --- files as such ----------------------------------------------------------------------------------------


def test_what_is_no_file(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe.npy")
    for path, words in ((tmp_path, "is a directory"), (tmp_path / "no.npy", "does not exist"),
                        (tmp_path / "pipe.npy", "is not a regular file"),
                        (Path("/dev/zero"), "is not a regular file"),
                        (tmp_path / ("x" * 300), "cannot be opened: File name too long")):
        with pytest.raises(InputError, match=words) as fault:
            read_npy(path, place="here")
        one_line(fault.value, "here", path)
    with pytest.raises(InputError, match="is not a file name"):
        read_npy("a\0b")


def test_what_cannot_be_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = written(tmp_path, "secret.npy", npy_bytes(GRID))

    def refuse_it(*_: object) -> None:
        raise PermissionError(13, "Permission denied")

    with monkeypatch.context() as patch:
        patch.setattr("builtins.open", refuse_it)  # root, who may run this, can read anything
        with pytest.raises(InputError, match="cannot be opened: Permission denied"):
            read_npy(path)
    with pytest.raises(InputError, match="cannot be read: Input/output error"), open_input(path):
        raise OSError(5, "Input/output error")
    with pytest.raises(InputError, match="does not fit in memory"), open_input(path):
        raise MemoryError


# --- densities --------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("dtype", "values", "wanted"), [
    ("uint8", [0, 51, 255, 1], [0.0, 0.2, 1.0, 1 / 255]),
    ("uint16", [0, 13107, 65535, 1], [0.0, 0.2, 1.0, 1 / 65535]),
    ("float16", [0.0, 0.5, 2.0, 1.0], [0.0, 0.5, 2.0, 1.0]),
    ("float32", [0.0, 0.5, 2.0, 3e38], [0.0, 0.5, 2.0, float(np.float32(3e38))]),
    ("float64", [0.0, 0.1, 2.0, 1e300], [0.0, 0.1, 2.0, 1e300]),
])
def test_raw_and_npy_densities(tmp_path: Path, dtype: str, values: list[float], wanted: list[float]) -> None:
    array = np.array(values, dtype).reshape(1, 2, 2)
    raw = VolumeDensity(path="a.raw", shape=(1, 2, 2), dtype=dtype)
    little = array.astype(array.dtype.newbyteorder("<"))
    got = read_density(raw, written(tmp_path, "a.raw", little.tobytes()))
    assert got.dtype == np.float64
    assert got.tolist() == np.reshape(wanted, (1, 2, 2)).tolist()
    npy = read_density(VolumeDensity(path="a.npy"), written(tmp_path, "a.npy", npy_bytes(array)))
    np.testing.assert_array_equal(npy, got)


def test_multiplier_and_dtype(tmp_path: Path) -> None:
    path = written(tmp_path, "a.VOL", vol_bytes(GRID))
    source = VolumeDensity(path="a.VOL", multiplier=0.1)
    np.testing.assert_array_equal(read_density(source, path), GRID.astype(float) * 0.1)
    single = read_density(source, path, dtype=np.float32)
    np.testing.assert_array_equal(single, (GRID.astype(float) * 0.1).astype(np.float32))  # rounded once


def test_refusals_show_the_first_value(tmp_path: Path) -> None:
    for value, words in ((math.nan, r"holds nan at \[1, 0, 3\] \(1 such values\)"),
                         (math.inf, "holds inf at"),
                         (-0.25, r"holds -0.25 at \[1, 0, 3\].*finite and at least 0")):
        array = GRID.copy()
        array[1, 0, 3] = value
        path = written(tmp_path, "a.npy", npy_bytes(array))
        with pytest.raises(InputError, match=words) as fault:
            read_density(VolumeDensity(path="a.npy"), path, place="density.source")
        one_line(fault.value, "density.source.path", path)
    refuse(GRID, GRID < 0, "rule", "file")


def test_what_overflows_is_refused(tmp_path: Path) -> None:
    path = written(tmp_path, "a.npy", npy_bytes(np.full((1, 1, 2), 1e300)))
    with pytest.raises(InputError, match="holds inf at"):
        read_density(VolumeDensity(path="a.npy", multiplier=1e10), path)
    with pytest.raises(InputError, match="holds inf at"):
        read_density(VolumeDensity(path="a.npy"), path, dtype=np.float32)


@pytest.mark.parametrize(("source", "words"), [
    (VolumeDensity(path="a.png"), r"source.path: .*neither .vol nor .npy; a raw file needs 'shape'"),
    (VolumeDensity(path="a.png", shape=(2, 3, 5), dtype="float32"), "source.path: .*is truncated"),
    (VolumeDensity(path="a.png", shape=(2, 3, 3), dtype="float32"), "source.path: .*is longer"),
    (VolumeDensity(path="a.png", shape=(10**6, 10**6, 1), dtype="uint8"), "source.path: .*more than 107374"),
    (VolumeDensity(path="a.npy", shape=(2, 3, 4), dtype="float32"), "source.shape: is given, but a .npy"),
    (VolumeDensity(path="a.vol", shape=(2, 3, 4), dtype="float32"), "source.shape: is given, but a .vol"),
])
def test_sources_that_do_not_fit(tmp_path: Path, source: VolumeDensity, words: str) -> None:
    path = written(tmp_path, source.path, GRID.tobytes())
    with pytest.raises(InputError, match=words):
        read_density(source, path, place="source")


def test_other_integers_are_refused(tmp_path: Path) -> None:
    path = written(tmp_path, "a.npy", npy_bytes(np.ones((2, 2, 2), np.int64)))
    with pytest.raises(InputError, match="holds int64, must be a float, uint8 or uint16"):
        read_density(VolumeDensity(path="a.npy"), path)


# --- fuzz -------------------------------------------------------------------------------------------------

ORIGINALS = {".vol": vol_bytes(GRID), ".npy": npy_bytes(np.asfortranarray(GRID))}


@st.composite
def damaged(draw: st.DrawFn) -> tuple[str, bytes]:
    extension = draw(st.sampled_from(sorted(ORIGINALS)))
    data = bytearray(ORIGINALS[extension])
    for _ in range(draw(st.integers(0, 4))):  # most of them in the header
        data[draw(st.integers(0, 140)) % len(data)] = draw(st.integers(0, 255))
    return extension, bytes(data[:draw(st.integers(0, len(data)))] if draw(st.booleans()) else data)


@given(damaged())
@example((".npy", b"\x93NUMPY\x01\0"))
@example((".vol", b"VOL"))
def test_damaged_files_are_read_or_refused(tmp_path_factory: pytest.TempPathFactory,
                                           broken: tuple[str, bytes]) -> None:
    path = tmp_path_factory.getbasetemp() / f"broken{broken[0]}"
    path.write_bytes(broken[1])
    try:
        density = read_density(VolumeDensity(path=path.name), path, place="here")
    except InputError as fault:
        one_line(fault, "here.path", path)
    else:
        assert density.size == 24
        assert np.isfinite(density).all()


@given(st.text(alphabet="{}()[]'\"\\:,.0x_<>fui48dscrhapeontTFlk LN-+", max_size=80))
def test_headers_of_any_text_are_refused(tmp_path_factory: pytest.TempPathFactory, text: str) -> None:
    path = tmp_path_factory.getbasetemp() / "header.npy"
    path.write_bytes(npy_with_header(text))
    with pytest.raises(InputError):
        read_npy(path)


# --- noise ------------------------------------------------------------------------------------------------


def perlin(source: NoiseDensity, x: float, y: float, z: float) -> float:
    """One value of the noise at a point of the period [0, 1]³, corner by corner in plain floats."""
    bits = np.random.PCG64(source.seed)
    total = weights = 0.0
    for octave in range(source.octaves):
        cells = source.cells * 2**octave
        if octave and 2 * cells > source.size:
            break
        words = [int(word) % 12 for word in bits.random_raw(cells**3)]
        place = [c * cells for c in (x, y, z)]
        value = 0.0
        for corner in np.ndindex(2, 2, 2):
            low = [math.floor(p) for p in place]
            offset = [p - a - c for p, a, c in zip(place, low, corner, strict=True)]
            i, j, k = ((a + c) % cells for a, c in zip(low, corner, strict=True))
            gradient = EDGES[words[(k * cells + j) * cells + i]]
            blend = math.prod(fade(1 - abs(d)) for d in offset)
            value += blend * sum(g * d for g, d in zip(gradient, offset, strict=True))
        total += value * 0.5**octave
        weights += 0.5**octave
    return min(max(0.5 + 0.5 * source.contrast * total / weights, 0.0), 1.0)


EDGES = [(-1, -1, 0), (-1, 0, -1), (-1, 0, 1), (-1, 1, 0), (0, -1, -1), (0, -1, 1),
         (0, 1, -1), (0, 1, 1), (1, -1, 0), (1, 0, -1), (1, 0, 1), (1, 1, 0)]


def fade(t: float) -> float:
    return 6 * t**5 - 15 * t**4 + 10 * t**3


@pytest.mark.parametrize("source", [
    NoiseDensity(), NoiseDensity(seed=9, size=12, cells=3, octaves=4, contrast=6.0),
    NoiseDensity(seed=0, size=2, cells=1, octaves=1), NoiseDensity(size=5, cells=7, octaves=8)])
def test_noise_equals_the_sum_over_corners(source: NoiseDensity) -> None:
    texture, n = noise(source), source.size
    for k, j, i in np.random.default_rng(0).integers(0, n, (20, 3)).tolist():
        wanted = perlin(source, (i + 0.5) / n, (j + 0.5) / n, (k + 0.5) / n)
        assert texture[k, j, i] == pytest.approx(wanted, rel=0, abs=2e-14)  # measured 7e-16


@given(st.builds(NoiseDensity, seed=st.integers(0, 2**63), size=st.integers(2, 24), cells=st.integers(1, 8),
                 octaves=st.integers(1, 5), contrast=st.floats(0.01, 50)))
def test_noise_is_bounded_and_repeatable(source: NoiseDensity) -> None:
    size = source.size
    texture = noise(source)
    assert texture.shape == (size, size, size)
    assert texture.min() >= 0
    assert texture.max() <= 1
    np.testing.assert_array_equal(texture, noise(source))


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("octaves", [1, 2, 3])
def test_noise_has_no_seam(axis: int, octaves: int) -> None:
    texture = noise(NoiseDensity(seed=4, size=32, cells=2, octaves=octaves, contrast=1.0))
    step = np.abs(np.roll(texture, -1, axis) - texture).mean(axis=tuple({0, 1, 2} - {axis}))
    # The step across the period's end is one among the others; where texels half a period apart
    # meet it is 4 to 8 times that.
    assert step[-1] < 1.5 * step[:-1].max()


def test_seeds_differ_and_contrast_spreads() -> None:
    one, other = noise(NoiseDensity(seed=1)), noise(NoiseDensity(seed=2))
    assert np.abs(one - other).mean() > 0.1
    assert abs(one.mean() - 0.5) < 0.02
    low = noise(NoiseDensity(seed=1, contrast=0.5))
    np.testing.assert_allclose(low - 0.5, (noise(NoiseDensity(seed=1, contrast=1.0)) - 0.5) / 2, atol=1e-15)


def test_noise_bytes_are_frozen() -> None:
    # Written down once: a change of the stream or of the order of operations shows here.
    texture = noise(NoiseDensity(seed=1, size=4, cells=2, octaves=1))
    assert [value.hex() for value in texture[0, 0].tolist()] == FROZEN


FROZEN = ["0x1.7a28f30000000p-1", "0x1.1bd70d0000000p-1", "0x1.3bd38d0000000p-1", "0x1.9a25730000000p-1"]


def test_limits_are_what_the_messages_say() -> None:
    assert volumes.MAX_VALUES == 1073741824
