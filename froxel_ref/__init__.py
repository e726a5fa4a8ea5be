"""froxel_ref: a reference for froxel volumetric lighting, in plain NumPy.

The names below are loaded when they are first used; every stage is a module of its own besides
(``froxel_ref.media``, ``froxel_ref.lighting``, ``froxel_ref.integrate``, …).

>>> import froxel_ref
>>> scene, settings, folder = froxel_ref.load("uniform")
>>> froxel_ref.plan(scene, settings)["surface"].why
'the scene has no surfaces'
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from froxel_ref.assets import load_assets
    from froxel_ref.frame import plan, run_frame
    from froxel_ref.image_files import save_image
    from froxel_ref.presets import preset
    from froxel_ref.records import InputError
    from froxel_ref.scene import Scene
    from froxel_ref.scene_files import load
    from froxel_ref.sequence import run_sequence
    from froxel_ref.settings import Settings
    from froxel_ref.truth import trace

__version__ = "0.1.0"
__all__ = [
    "InputError", "Scene", "Settings", "__version__", "load", "load_assets", "plan", "preset", "run_frame",
    "run_sequence", "save_image", "trace",
]

_HOMES = {
    "InputError": "records", "Scene": "scene", "Settings": "settings", "load": "scene_files",
    "load_assets": "assets", "plan": "frame", "preset": "presets", "run_frame": "frame", "run_sequence": "sequence",
    "save_image": "image_files", "trace": "truth",
}


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module 'froxel_ref' has no attribute {name!r}")
    return getattr(importlib.import_module(f"froxel_ref.{_HOMES[name]}"), name)


def __dir__() -> list[str]:
    return sorted(__all__)
