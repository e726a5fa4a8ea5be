"""JSON as scenes have it: finite numbers, every key once, and faults that name line and column."""

from __future__ import annotations

import json
import re
from typing import Any, NoReturn

from froxel_ref.records import InputError, key_shown

__all__ = ["MalformedError", "parse"]


class MalformedError(InputError):
    """Text that is not JSON at all."""


def parse(text: str, source: str) -> Any:
    """JSON text as plain values, stricter than `json.loads`: finite numbers and every key once.

    Parameters
    ----------
    text : str
        The document.
    source : str
        What messages call it, such as its path.

    Returns
    -------
    JSON value
        dict, list, str, int, float, bool or None.

    Raises
    ------
    InputError
        NaN or Infinity, a key twice in one object: with line and column.
    MalformedError
        Text that is not JSON: with line and column, too.

    Examples
    --------
    >>> parse('{"near": NaN}', "hall.json")
    Traceback (most recent call last):
        ...
    froxel_ref.records.InputError: hall.json, line 1, column 10: is NaN, must be a finite number
    """
    try:
        return json.loads(text, parse_constant=_refuse_constant, parse_int=_whole, object_pairs_hook=_once)
    except json.JSONDecodeError as error:
        raise MalformedError(_place(source, text, error.pos), f"malformed JSON: {error.msg}") from None
    except _Refused as refused:
        position = _constant(text) if refused.key is None else _second(text)
        raise InputError(_place(source, text, position), refused.problem) from None
    except RecursionError:
        raise InputError(source, "is nested too deeply") from None


class _Refused(Exception):
    """What JSON's grammar, or its reader, lets through and a scene may not hold."""

    def __init__(self, problem: str, key: str | None = None) -> None:
        super().__init__(problem)
        self.problem, self.key = problem, key


def _refuse_constant(name: str) -> NoReturn:
    raise _Refused(f"is {name}, must be a finite number")


def _whole(digits: str) -> int | float:
    # Beyond every float, and beyond what int() reads: the record refuses the infinity with its place.
    return int(digits) if len(digits) <= 400 else float(digits)


def _once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    values = dict(pairs)
    if len(values) < len(pairs):
        seen: set[str] = set()
        twice = next(key for key, _ in pairs if key in seen or seen.add(key))  # type: ignore[func-returns-value]
        raise _Refused(f"the key {key_shown(twice)} stands twice in one object", twice)
    return values


def _place(source: str, text: str, position: int) -> str:
    line = text.count("\n", 0, position) + 1
    return f"{source}, line {line}, column {position - text.rfind(chr(10), 0, position)}"


# Strings are matched whole, so that what stands inside them is passed over.
_TOKEN = re.compile(r'(?P<string>"(?:[^"\\]|\\.)*")(?P<key>\s*:)?|(?P<constant>NaN|-?Infinity)|[{}]')


def _constant(text: str) -> int:
    return next((token.start() for token in _TOKEN.finditer(text) if token["constant"]), 0)


def _second(text: str) -> int:
    """Where the first object that closes with a key twice has it for the second time."""
    open_objects: list[tuple[set[str], list[int]]] = []
    for token in _TOKEN.finditer(text):
        if token[0] == "{":
            open_objects.append((set(), []))
        elif token[0] == "}":
            _, again = open_objects.pop()
            if again:
                return again[0]
        elif token["key"]:
            keys, again = open_objects[-1]
            key = json.loads(token["string"])
            if key in keys:
                again.append(token.start())
            keys.add(key)
    return 0
