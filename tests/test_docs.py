"""What the documents promise: citations resolve, examples run, command lines parse."""

from __future__ import annotations

import ast
import json
import re
import shlex
from pathlib import Path
from typing import Any

import pytest

from froxel_ref.cli import _parser
from froxel_ref.scene_files import load

ROOT = Path(__file__).parent.parent
SOURCES = sorted((ROOT / "froxel_ref").glob("*.py"))
DOCUMENTS = sorted(ROOT.glob("*.md"))
README = (ROOT / "README.md").read_text(encoding="utf-8")

# [Key] or [Key, place], several joined by semicolons; a key: name and year or version, or a standard's own.
KEY = r"(?:[A-ZÄÖÜ]\w+ (?:(?:19|20)\d\d|\d\.\d)|IEC [\d-]+|EXT_\w+)"
FENCE = re.compile(r"^```(\w*)\n(.*?)^```$", re.MULTILINE | re.DOTALL)


# --- citations --------------------------------------------------------------------------------------


def cited(text: str) -> set[str]:
    """The keys in square brackets, also where a line ends within them or a comment sign stands between."""
    joined = re.sub(r"\s*\n\s*(?:#\s*)?", " ", text)
    parts = [part.strip() for inside in re.findall(r"\[([^\[\]]+)\]", joined) for part in inside.split(";")]
    return {found[1] for part in parts if (found := re.match(rf"({KEY})(?:,|$)", part))}


def listed() -> list[str]:
    text = (ROOT / "REFERENCES.md").read_text(encoding="utf-8")
    return re.findall(r"^\| \[(.+?)\] \|", text, re.MULTILINE)


@pytest.mark.parametrize(("text", "keys"), [
    ("as in [Kosian 2020, eq. 2.4]", {"Kosian 2020"}),
    ("[Henyey 1941; Dörries 2020,\n    listing 3.2]", {"Henyey 1941", "Dörries 2020"}),
    ("# exact [Dekker\n# 1971]", {"Dekker 1971"}),
    ("[IEC 61966-2-1], [EXT_packed_float, §2.1.A and B] [Mitsuba 0.6, gridvolume]",
     {"IEC 61966-2-1", "EXT_packed_float", "Mitsuba 0.6"}),
    ("list[int] array[2020] [Camera, Grid] [CONVENTIONS.md](CONVENTIONS.md)", set()),
])
def test_citations_are_found(text: str, keys: set[str]) -> None:
    assert cited(text) == keys


@pytest.mark.parametrize("path", SOURCES + DOCUMENTS, ids=lambda path: path.name)
def test_every_citation_is_listed(path: Path) -> None:
    assert cited(path.read_text(encoding="utf-8")) <= set(listed())


def test_every_listed_work_is_cited() -> None:
    keys = listed()
    assert len(keys) == len(set(keys)) > 10
    assert all(re.fullmatch(KEY, key) for key in keys)
    elsewhere = [path for path in SOURCES + DOCUMENTS if path.name != "REFERENCES.md"]
    used = set().union(*(cited(path.read_text(encoding="utf-8")) for path in elsewhere))
    assert set(keys) - used == set()


# --- examples ---------------------------------------------------------------------------------------


def blocks(language: str) -> list[str]:
    return [text for kind, text in FENCE.findall(README) if kind == language]


def test_the_readme_has_examples() -> None:
    assert len(blocks("python")) >= 2
    assert len(blocks("json")) >= 1


def test_python_in_the_readme_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """One block after the other, as a reader would type them; lines that are values too."""
    monkeypatch.chdir(tmp_path)
    names: dict[str, Any] = {}
    for text in blocks("python"):
        exec(compile(ast.parse(text), "README.md", "exec"), names)


@pytest.mark.parametrize("text", blocks("json"))
def test_scenes_in_the_readme_load(text: str, tmp_path: Path) -> None:
    document = json.loads(text)
    (tmp_path / "scene.json").write_text(text, encoding="utf-8")
    assert load(tmp_path / "scene.json").scene.name == document["scene"].get("name", "")


# --- command lines ----------------------------------------------------------------------------------


def command_lines() -> list[str]:
    """The arguments of every froxel-ref command that stands alone on a line, in a block or in backticks."""
    code = [line for kind, text in FENCE.findall(README) if kind == "" for line in text.splitlines()]
    code += re.findall(r"`([^`\n]+)`", FENCE.sub("", README))
    whole = [re.split(r" {2,}|>", part)[0].strip() for line in code for part in line.split("&&")]
    found = [re.fullmatch(r"(?:python -m froxel_ref|froxel-ref) (.+)", part) for part in whole]
    return list(dict.fromkeys(match[1] for match in found if match))


def test_the_readme_has_command_lines() -> None:
    assert len(command_lines()) >= 8


@pytest.mark.parametrize("line", command_lines())
def test_command_lines_in_the_readme_parse(line: str) -> None:
    args = _parser().parse_args(shlex.split(line))
    assert callable(args.run)
