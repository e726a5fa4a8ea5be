"""Whether a measurement that was read from a log is one: a line that was changed by hand counts as not there."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

from froxel_ref.report_record import Errors, Spread

__all__ = ["sound"]


def sound(name: str, value: Any) -> bool:
    """Whether a value is what a measurement of that name may be.

    Parameters
    ----------
    name : str
        As `froxel_ref.report.measurements` has it.
    value : JSON value

    Returns
    -------
    bool

    Examples
    --------
    >>> sound("memory base", {"bytes": 12}), sound("memory base", {"bytes": -12}), sound("memory base", 7)
    (True, False, False)
    """
    if not isinstance(value, Mapping):
        return False
    kind = name.split(" ")[0].rstrip(":")
    if set(value) == {"fault"}:
        return isinstance(value["fault"], str) and kind in ("image", "budget", "memory", "time")
    try:
        return KINDS[kind](value)
    except (KeyError, TypeError):
        return False


def _number(value: Any, least: float = 0.0, *, above: bool = False) -> bool:
    right = isinstance(value, int | float) and not isinstance(value, bool)
    return right and math.isfinite(value) and (value > least if above else value >= least)


def _count(value: Any) -> bool:
    return isinstance(value, int) and _number(value)


def _errors(value: Any) -> bool:
    """Numbers that norms may have; with a fault they may be NaN."""
    if not isinstance(value, Mapping) or set(value) != set(Errors._fields) or not isinstance(value["fault"], str):
        return False
    sizes = [value[name] for name in Errors._fields if name not in ("bias", "fault", "flip")]
    if value["fault"]:
        return all(isinstance(size, float) for size in sizes)
    return _number(value["bias"], -math.inf) and all(map(_number, sizes)) and (
        value["flip"] is None or _number(value["flip"]))


def _image(value: Mapping[str, Any]) -> bool:
    return set(value) == {"errors"} and _errors(value["errors"])


def _level(value: Mapping[str, Any]) -> bool:
    rest = {key: value[key] for key in value if key not in ("label", "step")}
    return isinstance(value["label"], str) and _number(value["step"], above=True) and (
        _image(rest) or (set(rest) == {"fault"} and isinstance(rest["fault"], str)))


def _reference(value: Mapping[str, Any]) -> bool:
    return (isinstance(value["begun"], str) and _number(value["seconds"]) and _count(value["unconverged"])
            and _number(value["floor"]) and _number(value["mean"]))


def _time(value: Mapping[str, Any]) -> bool:
    stages = value["stages"]
    return _number(value["seconds"], above=True) and isinstance(stages, Mapping) and all(
        isinstance(name, str) and _number(seconds) for name, seconds in stages.items())


def _saved(value: Mapping[str, Any]) -> bool:
    def spread(given: Any) -> bool:
        return (isinstance(given, list) and len(given) == len(Spread._fields) and _number(given[0], above=True)
                and _number(given[1], given[0]) and _count(given[2]) and _number(given[3]))

    left = value["left_out"]
    return (isinstance(left, list) and all(isinstance(pair, list) and len(pair) == 2
                                           and all(isinstance(words, str) for words in pair) for pair in left)
            and spread(value["planned"]) and spread(value["forced"]) and _count(value["planned_bytes"])
            and _count(value["forced_bytes"]) and isinstance(value["same"], bool))


KINDS: Mapping[str, Callable[[Mapping[str, Any]], bool]] = {
    "reference": _reference, "image": _image, "budget": _image, "level": _level, "time": _time, "saved": _saved,
    "memory": lambda value: set(value) == {"bytes"} and _count(value["bytes"])}
