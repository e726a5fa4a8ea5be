"""How far a command is: lines where there is no terminal, a bar where there is one."""

from __future__ import annotations

import io
import sys

import pytest

from froxel_ref import cli_progress
from froxel_ref.cli_progress import _lines, progress


class Clock:
    now = 100.0

    def __call__(self) -> float:
        return self.now


def told(steps: list[tuple[float, str, int, int]], capsys: pytest.CaptureFixture[str]) -> list[str]:
    """The lines for steps at these seconds after the start."""
    clock = Clock()
    tell = _lines("kernels", clock)
    for seconds, *step in steps:
        clock.now = 100.0 + seconds
        tell(*step)
    out, err = capsys.readouterr()
    assert out == ""
    return err.splitlines()


def test_what_is_soon_done_says_nothing(capsys: pytest.CaptureFixture[str]) -> None:
    assert told([(0.0, "a", 0, 3), (4.0, "b", 1, 3), (9.9, "c", 2, 3)], capsys) == []


def test_a_line_every_ten_seconds(capsys: pytest.CaptureFixture[str]) -> None:
    """At an even pace of two a second, of 100."""
    steps = [(0.5 * done, "rayleigh", done, 100) for done in range(100)]
    assert told(steps, capsys) == [
        "froxel-ref: 20 of 100 kernels (rayleigh), about 40 s left",
        "froxel-ref: 40 of 100 kernels (rayleigh), about 30 s left",
        "froxel-ref: 60 of 100 kernels (rayleigh), about 20 s left",
        "froxel-ref: 80 of 100 kernels (rayleigh), about 10 s left"]


def test_another_part_of_the_work_has_a_pace_of_its_own(capsys: pytest.CaptureFixture[str]) -> None:
    lines = told([(0.0, "a", 0, 2), (100.0, "", 0, 1000), (110.0, "", 10, 1000), (1000.0, "", 500, 1000)], capsys)
    assert lines == ["froxel-ref: 10 of 1000 kernels, about 16 min 30 s left",
                     "froxel-ref: 500 of 1000 kernels, about 15 min 0 s left"]


def test_a_terminal_has_a_bar_and_no_lines(monkeypatch: pytest.MonkeyPatch) -> None:
    class Terminal(io.StringIO):
        def isatty(self) -> bool:
            return True

    screen = Terminal()
    monkeypatch.setattr(sys, "stderr", screen)
    with progress("rays") as tell:
        for done in range(0, 5000, 1000):
            tell("", done, 4000)
    assert "\r" in screen.getvalue()
    assert "froxel-ref:" not in screen.getvalue()


def test_a_reader_that_went_away_stops_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    class Broken(io.StringIO):
        def write(self, text: str) -> int:
            raise BrokenPipeError

    monkeypatch.setattr(cli_progress, "EVERY", 0.0)
    for stream in (Broken(), None):
        monkeypatch.setattr(sys, "stderr", stream)
        with progress("rays") as tell:
            tell("", 1, 2)
