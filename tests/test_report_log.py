"""The log of a report: what was measured comes back to the last bit, whatever was cut off or damaged."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest

from froxel_ref.records import InputError
from froxel_ref.report_log import (
    FORMAT,
    IMAGES,
    LOG,
    Entry,
    append,
    begin,
    image_path,
    is_log,
    load_image,
    read,
    store_image,
)

HEADER = {"package": "1.0", "scene": "hall", "digest": "abc", "suite": "quick", "everything": True,
          "points": [["base", 1], ["slices=8", 16]]}
ENTRIES = {
    "reference": Entry({"seconds": 0.1 + 0.2, "unconverged": 3}, 1.25),
    "image slices=8": Entry({"errors": {"relmse": math.nan, "bias": math.inf, "maximum": -math.inf, "fault": "NaN"}},
                            1e-300),
    "image α=0.2, ½": Entry({"fault": "refused: a \"line\"\nand another, \u2028 and \x85"}, 0.0),
    "time 0 base": Entry({"seconds": 5e-324, "stages": {"media": 1 / 3}}, 2.0)}


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    begin(tmp_path / "report", HEADER)
    for name, entry in ENTRIES.items():
        append(tmp_path / "report", name, entry)
    return tmp_path / "report"


def test_measurements_come_back_to_the_last_bit(folder: Path) -> None:
    found = read(folder, HEADER)
    assert repr(found) == repr(ENTRIES)  # NaN too
    assert (folder / IMAGES).is_dir()
    # Each is a line of its own, whatever is in it.
    lines = (folder / LOG).read_bytes().split(b"\n")
    assert len(lines) == 2 + len(ENTRIES)
    assert lines[-1] == b""


def test_the_last_of_two_counts(folder: Path) -> None:
    append(folder, "reference", Entry({"seconds": 7.0}, 3.0))
    assert read(folder, HEADER)["reference"] == Entry({"seconds": 7.0}, 3.0)


def test_a_log_that_is_cut_off_anywhere_keeps_what_is_whole(folder: Path) -> None:
    """At each byte behind the header; and a measurement that is added then is a line of its own."""
    whole = (folder / LOG).read_bytes()
    ends = [i + 1 for i, byte in enumerate(whole) if byte == ord("\n")]
    for length in range(ends[0], len(whole)):
        (folder / LOG).write_bytes(whole[:length])
        # A line without its end is whole already.
        count = sum(end - 1 <= length for end in ends[1:])
        expected = dict(list(ENTRIES.items())[:count])
        assert repr(read(folder, HEADER)) == repr(expected)
        append(folder, "more", Entry(1, 1.0))
        assert repr(read(folder, HEADER)) == repr(expected | {"more": Entry(1, 1.0)})


@pytest.mark.parametrize("line", [b"\xff\xfe\x00", b"[1, 2]", b"{}", b'{"name": "x", "value": 1}', b"null",
                                  b'{"name": "x", "value": 1, "took": "long"}', b"[" * 100_000])
def test_a_line_that_is_no_measurement_counts_as_not_there(folder: Path, line: bytes) -> None:
    with (folder / LOG).open("ab") as file:
        file.write(line + b"\n")
    append(folder, "more", Entry(1, 1.0))
    assert repr(read(folder, HEADER)) == repr(ENTRIES | {"more": Entry(1, 1.0)})


@pytest.mark.parametrize(("change", "words"), [
    ({"scene": "shaft"}, r"is of another scene \('hall', not 'shaft'\), must be of the same: choose another folder, or "
                         "--force to begin anew"),
    ({"package": "2.0"}, r"is of another version \('1.0', not '2.0'\)"),
    ({"digest": "abd"}, "is of another scene or other settings or files, must"),
    ({"suite": "full"}, r"is of another suite \('quick', not 'full'\)"),
    ({"points": [["base", 1]]}, "is of other knobs or sweeps, must"),
    ({"points": [["base", 1], ["slices=8", 4]]}, "is of other knobs or sweeps, must")])
def test_what_is_of_something_else_is_refused(folder: Path, change: dict[str, object], words: str) -> None:
    before = (folder / LOG).read_bytes()
    with pytest.raises(InputError, match=words) as fault:
        read(folder, HEADER | change)
    assert fault.value.place == "--resume"
    assert "\n" not in str(fault.value)
    assert (folder / LOG).read_bytes() == before


def test_points_alone_may_be_gone_on_with_for_everything(folder: Path) -> None:
    assert read(folder, HEADER | {"everything": False}).keys() == ENTRIES.keys()


@pytest.mark.parametrize("content", [b"", b"\n", b"{", b"no log", b'{"format": "another"}\n',
                                     json.dumps({"format": FORMAT, "version": 99}).encode()])
def test_what_is_no_log_is_refused(tmp_path: Path, content: bytes) -> None:
    (tmp_path / LOG).write_bytes(content)
    with pytest.raises(InputError, match=r"--resume: .* holds no measurements of this format to go on with"):
        read(tmp_path, HEADER)


def test_without_a_log_there_is_nothing_to_go_on_with(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"--resume: .* holds no measurements to go on with"):
        read(tmp_path, HEADER)
    assert not is_log(tmp_path / LOG)


def test_a_log_is_known_by_its_first_line(folder: Path) -> None:
    assert is_log(folder / LOG)
    (folder / "other").write_text('{"format": "froxel-ref report"}\n')
    assert not is_log(folder / "other")


def test_what_cannot_be_written_is_refused_in_a_line(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match=r"output: .* cannot be written: "):
        begin(tmp_path / "file", HEADER)
    with pytest.raises(InputError, match=r"output: .* cannot be written: "):
        append(tmp_path / "file", "x", Entry(1, 1.0))


# --- images -------------------------------------------------------------------------------------------


SHAPE = (3, 4, 5)


def test_images_come_back_to_the_last_bit(folder: Path) -> None:
    image = np.random.default_rng(1).normal(size=SHAPE)
    image[0, 0, :3] = math.nan, math.inf, -0.0
    store_image(folder, "image base", image)
    found = load_image(folder, "image base", SHAPE)
    assert found is not None
    assert found.tobytes() == image.tobytes()
    assert load_image(folder, "image other", SHAPE) is None
    assert load_image(folder, "image base", (3, 5, 4)) is None
    store_image(folder, "image base", image + 1)  # again
    assert len(list((folder / IMAGES).iterdir())) == 1


def test_names_become_names_of_files_each_its_own(folder: Path) -> None:
    names = ["image a=1", "image a=1 ", "image a/1", "image a\\1", "image ../../a", "image α", "image β", "image .",
             "", "x" * 300, "x" * 301, "CON", "image A=1", "budget: a alone", "image a=[1,2]"]
    paths = [image_path(folder, name) for name in names]
    assert len({path.name.casefold() for path in paths}) == len(names)
    for path in paths:
        assert path.parent == folder / IMAGES
        assert path.suffix == ".npy"
        assert len(path.name) < 80
        assert path.name.isascii()
    for i, name in enumerate(names):
        store_image(folder, name, np.full(SHAPE, float(i)))
    assert [load_image(folder, name, SHAPE)[0, 0, 0] for name in names] == list(range(len(names)))  # type: ignore[index]


def test_a_damaged_image_is_none(folder: Path) -> None:
    """Cut off anywhere; any byte of its head another; another type; a pickle; no array at all."""
    image = np.random.default_rng(2).normal(size=SHAPE)
    store_image(folder, "x", image)
    path = image_path(folder, "x")
    whole = path.read_bytes()
    for length in range(0, len(whole), 5):
        path.write_bytes(whole[:length])
        assert load_image(folder, "x", SHAPE) is None
    for place in range(128):
        for value in (0, 10, 32, 39, 40, 41, 57, 255):
            path.write_bytes(whole[:place] + bytes([value]) + whole[place + 1:])
            found = load_image(folder, "x", SHAPE)
            assert found is None or (found.shape == SHAPE and found.dtype == np.float64)
    for content in (b"PK\x03\x04junk", b"\x80\x04N.", b"", b"text"):
        path.write_bytes(content)
        assert load_image(folder, "x", SHAPE) is None
    np.save(path, image.astype(np.float32))
    assert load_image(folder, "x", SHAPE) is None
    np.save(path, np.array([{}]), allow_pickle=True)
    assert load_image(folder, "x", SHAPE) is None
    with path.open("wb") as file:
        np.savez(file, image)
    assert load_image(folder, "x", SHAPE) is None
    path.unlink()
    path.mkdir()
    assert load_image(folder, "x", SHAPE) is None
