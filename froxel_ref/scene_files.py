"""Scenes as data: documents in JSON, the built-in ones, and the JSON Schema of both.

A document is one object with the keys ``schema`` (its version), ``scene`` and ``settings``. What it may hold
is declared once, in `froxel_ref.scene` and `froxel_ref.settings`; this module only reads and writes.
"""

from __future__ import annotations

import importlib.resources
import stat
from collections.abc import Sequence
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import Any, NamedTuple

from froxel_ref.kinds import integer, nested
from froxel_ref.overrides import override
from froxel_ref.records import InputError, Record, from_json, json_schema, shown, suggest, to_json
from froxel_ref.scene import Scene
from froxel_ref.settings import Settings
from froxel_ref.strict_json import parse

__all__ = ["Document", "Loaded", "builtin", "document", "load", "schema"]

VERSION = 1
LARGEST = 16_000_000  # bytes; volumes and meshes live in files of their own, so a scene is a few kilobytes


@dataclass(frozen=True, kw_only=True)
class Document(Record):
    """A scene file: what is in the world and how its frame is computed."""

    schema: int = integer(about="version of this layout", at_least=VERSION, at_most=VERSION)
    scene: Scene = nested(Scene, about="what is in the world")
    settings: Settings = nested(Settings, default=Settings(), about="how its frame is computed")


class Loaded(NamedTuple):
    """A scene and how its frame is computed.

    Attributes
    ----------
    scene : Scene
        What is in the world.
    settings : Settings
        How its frame is computed.
    folder : Path or None
        Where the files lie that the scene names; None if there is no such folder.
    """

    scene: Scene
    settings: Settings
    folder: Path | None


def load(name_or_path: str | PathLike[str], *, overrides: Sequence[str] = (),
         data: str | PathLike[str] | None = None) -> Loaded:
    """A built-in scene by its name, or a scene file by its path.

    Parameters
    ----------
    name_or_path : str or path
        A built-in scene's name, or the path of a ``.json`` file.
    overrides : sequence of str, optional
        Changes to the document, each ``path=value``, applied in order; see `froxel_ref.overrides`.
    data : str or path, optional
        Folder of the volumes, meshes and images that the scene names; a scene file's own folder unless given.

    Returns
    -------
    Loaded
        ``scene``, ``settings``, ``folder``.

    Raises
    ------
    InputError
        Unknown scene, unreadable or malformed file, anything in it that is not allowed.

    Examples
    --------
    >>> scene, settings, folder = load("uniform", overrides=["grid.depth=16"])
    >>> scene.name, settings.grid.depth, folder
    ('uniform', 16, None)
    """
    where = str(name_or_path)
    is_path = not isinstance(name_or_path, str) or where.endswith(".json") or "/" in where or "\\" in where
    raw = parse(_read(Path(where)), _shown_path(where)) if is_path else _builtin_document(where)
    _check_version(raw)
    try:
        whole = from_json(Document, raw)
        if overrides:
            complete = to_json(whole)
            for text in overrides:
                complete = override(Document, complete, text)
            whole = from_json(Document, complete)
    except RecursionError:
        raise InputError(_shown_path(where), "is nested too deeply") from None
    folder = _folder(data) if data is not None else Path(where).parent if is_path else None
    return Loaded(whole.scene, whole.settings, folder)


def builtin() -> dict[str, str]:
    """The built-in scenes.

    Returns
    -------
    dict of str to str
        Their names, in order, and what each shows in one sentence.

    Examples
    --------
    >>> "thesis-hall" in builtin()
    True
    """
    return {name: str(_builtin_document(name)["scene"]["description"]) for name in _builtin_names()}


def document(scene: Scene, settings: Settings) -> dict[str, Any]:
    """The JSON form of a scene and its settings: every field, and nothing lost when it is loaded again.

    Parameters
    ----------
    scene : Scene
        What is in the world.
    settings : Settings
        How its frame is computed.

    Returns
    -------
    dict
        With the keys ``schema``, ``scene`` and ``settings``; plain values that `json.dumps` takes.

    Examples
    --------
    >>> document(Scene(name="empty"), Settings())["scene"]["name"]
    'empty'
    """
    written: dict[str, Any] = to_json(Document(schema=VERSION, scene=scene, settings=settings))
    return written


def schema() -> dict[str, Any]:
    """The JSON Schema (2020-12) of scene files.

    Returns
    -------
    dict
        Plain values. Rules between fields are not in it, they are the records' alone.

    Examples
    --------
    >>> schema()["$ref"]
    '#/$defs/Document'
    """
    return {"title": "froxel-ref scene", **json_schema(Document)}


# --- where a document comes from --------------------------------------------------------------------


def _check_version(raw: Any) -> None:
    given = raw.get("schema", VERSION) if isinstance(raw, dict) else VERSION
    if isinstance(given, bool) or given != VERSION:
        raise InputError("schema", f"is {shown(given)}, this version of froxel-ref reads {VERSION}")


def _scenes() -> Any:
    return importlib.resources.files("froxel_ref") / "scenes"


def _builtin_names() -> list[str]:
    files = (file.name for file in _scenes().iterdir())
    return sorted(name.removesuffix(".json") for name in files if name.endswith(".json"))


def _builtin_document(name: str) -> Any:
    names = _builtin_names()
    if name not in names:
        near, known = suggest(name, names), f"known: {', '.join(names)}"
        hint = near if near == known else f"{near} ({known})"
        raise InputError("scene", f"{shown(name)} is not built in; {hint}; a scene file's name ends in .json")
    return parse((_scenes() / f"{name}.json").read_text(encoding="utf-8"), name)


def _read(path: Path) -> str:
    place = _shown_path(str(path))
    try:
        mode = path.stat().st_mode
        if not (stat.S_ISREG(mode) or stat.S_ISDIR(mode)):  # open() would wait for a pipe's writer for ever
            raise InputError(place, "cannot be read: is not a regular file")
        with path.open("rb") as file:
            content = file.read(LARGEST + 1)
    except OSError as error:
        raise InputError(place, f"cannot be read: {error.strerror or error}") from None
    except InputError:
        raise
    except ValueError as error:  # a NUL in the path
        raise InputError(place, f"cannot be read: {error}") from None
    if len(content) > LARGEST:
        raise InputError(place, f"is larger than {LARGEST // 1_000_000} MB, too large for a scene")
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputError(place, f"is not UTF-8 (byte {error.start})") from None


def _shown_path(path: str) -> str:
    return path if path.isprintable() else repr(path)


def _folder(data: str | PathLike[str]) -> Path:
    folder = Path(data)
    try:
        if folder.is_dir():
            return folder
    except (OSError, ValueError):
        pass
    raise InputError("data", f"{shown(str(data))} is not a folder")
