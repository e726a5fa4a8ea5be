"""Where the tests find real files that are not part of the repository."""

from __future__ import annotations

import os
from pathlib import Path

import pytest


def data_file(name: str) -> Path:
    """A real input file; skips the test, with the reason, where it is not there.

    Looked for in the folder that FROXEL_REF_DATA names, else in ``../shared/data`` beside the repository.
    """
    beside = Path(__file__).resolve().parents[2] / "shared" / "data"
    folder = Path(os.environ.get("FROXEL_REF_DATA") or beside)
    path = folder / name
    if not path.is_file():
        pytest.skip(f"{name} is not in {folder}; FROXEL_REF_DATA names another folder")
    return path
