"""Settings that belong together, by one name: overrides to begin with."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from froxel_ref.records import InputError, shown, suggest

__all__ = ["PRESETS", "preset"]

PRESETS: Mapping[str, tuple[str, ...]] = MappingProxyType({
    # Configuration 8 of [Dörries 2020, table 3.3] with everything of its chapter 3: α of §3.2.7.
    "thesis": (
        "settings.temporal.filter=scattering", "settings.temporal.alpha=0.2", "settings.checkerboard=true",
        "settings.merged=true", "settings.volumetric_shadows=maps", "settings.fog_lookup.method=noisy",
        "settings.fog_lookup.stored=tone_mapped", "settings.long_range.march=true", "settings.taa.on=true"),
})
"""Of each name the overrides, as `froxel_ref.load` takes them."""


def preset(name: str) -> list[str]:
    """The overrides of a preset.

    Parameters
    ----------
    name : str
        "thesis": the whole frame of [Dörries 2020], every stage of it switched on. Its departures are switches, which
        ``fidelity`` sets.

    Returns
    -------
    list of str
        To be given to `froxel_ref.load`, own overrides behind them.

    Raises
    ------
    InputError
        Unknown name.

    Examples
    --------
    >>> import froxel_ref
    >>> scene, settings, folder = froxel_ref.load("uniform", overrides=[*preset("thesis"), "taa.alpha=0.2"])
    >>> settings.taa.on, settings.taa.alpha
    (True, 0.2)
    """
    if name not in PRESETS:
        raise InputError("preset", f"is {shown(name)}; {suggest(str(name), PRESETS)}")
    return list(PRESETS[name])
