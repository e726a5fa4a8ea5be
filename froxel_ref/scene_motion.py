"""Scenes that move: values that change over time, and the scene at one moment.

A track names one number or vector of a scene by its path, as an override does (``lights[2].position[1]``), and gives
it values at some times. What lies between is linear, smooth or stepwise. A moment of a moving scene is an ordinary
scene without tracks, so no stage knows of time.
"""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from froxel_ref.kinds import Flag, Kind, Many, Nested, Number, Vector, choice, number, text
from froxel_ref.records import InputError, Record, at, kinds_of, shown, suggest
from froxel_ref.scene_media import NoiseDensity, VolumeDensity
from froxel_ref.scene_space import LONGEST, SHORTEST, STRONGEST

if TYPE_CHECKING:
    from froxel_ref.scene import Scene

__all__ = ["Key", "Track", "check_tracks", "duration", "scene_at", "track_values"]

Steps: TypeAlias = tuple[str | int, ...]
Value: TypeAlias = float | tuple[float, ...]

TIME: dict[str, Any] = {"unit": "s", "within": (-LONGEST, LONGEST)}
_PATH = re.compile(r"[a-z_]\w*(\[\d{1,18}\])*(\.[a-z_]\w*(\[\d{1,18}\])*)*", re.ASCII | re.IGNORECASE)
_MADE_ONCE = (NoiseDensity, VolumeDensity)  # textures are made of them before the first frame


@dataclass(frozen=True, kw_only=True)
class Key(Record):
    """The value of a track at one time."""

    time: float = number(about="when", **TIME)
    value: Value = dataclasses.field(metadata={"kind": Vector(
        False, "the number, or the list of numbers, at that time", Number(within=(-STRONGEST, STRONGEST)), None, True)})

    def check_together(self) -> None:
        if self.value == ():
            raise InputError("value", "is an empty list, must hold at least one number")


@dataclass(frozen=True, kw_only=True)
class Track(Record):
    """How one number or vector of a scene changes over time."""

    path: str = text(about="what changes, such as camera.position or lights[2].position[1]")
    keys: tuple[Key, ...] = dataclasses.field(metadata={"kind": Many(
        False, "its values, in growing time; at least one", Nested(classes=(Key,)))})
    interpolation: str = choice(
        "linear", "smooth", "step", default="linear",
        about="between keys: straight; cubic without a kink or overshoot; or the value of the last key so far")
    repeat: str = choice(
        "hold", "loop", "back_and_forth", default="hold",
        about="before the first and after the last key: their values; all over again; or back and forth")

    def check_together(self) -> None:
        if not self.keys:
            raise InputError("keys", "is empty, must hold at least one key")
        first = self.keys[0]
        for i, (before, key) in enumerate(zip(self.keys, self.keys[1:], strict=False), 1):
            if not key.time - before.time >= SHORTEST:
                raise InputError(f"keys[{i}].time", f"is {_seconds(key.time)}, must be later than keys[{i - 1}], "
                                                    f"{_seconds(before.time)}, by {SHORTEST:g} s or more")
            if _count(key.value) != _count(first.value):
                raise InputError(f"keys[{i}].value", f"is {_how_many(key.value)}, must be "
                                                     f"{_how_many(first.value)} like that of keys[0]")


def _seconds(time: float) -> str:
    return f"{repr(time).removesuffix('.0')} s"


def _count(value: Value) -> int:
    return len(value) if isinstance(value, tuple) else 0


def _how_many(value: Value) -> str:
    return f"a list of {len(value)}" if isinstance(value, tuple) else "one number"


# --- values over time -------------------------------------------------------------------------------


def track_values(track: Track, time: ArrayLike) -> NDArray[np.float64]:
    """The value of a track at some times.

    Parameters
    ----------
    track : Track
        Its keys, how they are joined, and what lies before and after them.
    time : float or array_like, shape (...) [s]
        When.

    Returns
    -------
    ndarray, shape (...) or (c, ...), float64
        In the unit of what moves; with c channels where the keys' values are lists. At a key's time exactly its
        value, between keys never beyond the two values next to it.

    Raises
    ------
    InputError
        ``time`` is not finite.

    Notes
    -----
    With τ the share of the way from one key to the next, a and b their values and h seconds between them:
    ``linear`` is (1 − τ)·a + τ·b, of second order in h. ``smooth`` is the cubic of the values a, b and the slopes
    p, q at both ends::

        a·(1 − τ)²·(1 + 2τ) + b·τ²·(3 − 2τ) + h·τ·(1 − τ)·((1 − τ)·p − τ·q)

    The slope at a key is 0 where the value turns round or rests; else that of the parabola through the key and its
    neighbours, (k·d + h·e)/(h + k) with the slopes d, e of the straight lines of h and k seconds to its left and right,
    but at most three times the lesser of d and e, so that the cubic is monotone between keys [Fritsch 1980]. At the
    first and the last key it is 0, and with ``loop`` made of the last and the first line: the whole has a continuous
    first derivative, but for ``loop`` where first and last value differ and do not mean the same. It is of third
    order in h where no slope is set to 0 or bounded. Numbers of a list move each by itself: turns as three angles,
    directions without keeping their length.

    With ``loop`` the last key's time is the first key's again, so that the last value is approached, not reached (and
    not seen with ``step``). ``back_and_forth`` takes twice as long to repeat.

    Examples
    --------
    >>> keys = (Key(time=0, value=0), Key(time=1, value=10), Key(time=2, value=10))
    >>> track_values(Track(path="lights[0].radius", keys=keys), [-1, 0.25, 1, 1.5, 9])
    array([ 0. ,  2.5, 10. , 10. , 10. ])
    >>> track_values(Track(path="lights[0].radius", keys=keys, interpolation="smooth"), 0.25)
    array(1.5625)
    """
    when = np.asarray(time, dtype=np.float64)
    if not np.isfinite(when).all():
        raise InputError("time", "holds NaN or infinity, must be finite")
    times = np.array([key.time for key in track.keys])
    values = np.array([key.value for key in track.keys]).T
    when = _folded(when, times, track.repeat)
    before = np.searchsorted(times, when, side="right") - 1
    if track.interpolation == "step" or len(times) == 1:
        return np.asarray(values[..., before])
    before = np.minimum(before, len(times) - 2)
    a, b, step = values[..., before], values[..., before + 1], np.diff(times)
    share = (when - times[before]) / step[before]
    rest = 1.0 - share
    if track.interpolation == "linear":
        between = rest * a + share * b
    else:
        slope = _slopes(np.diff(values) / step, step, track.repeat == "loop")
        bend = rest * slope[..., before] - share * slope[..., before + 1]
        between = (a * (rest * rest * (1.0 + 2.0 * share)) + b * (share * share * (3.0 - 2.0 * share))
                   + step[before] * share * rest * bend)
    return np.asarray(np.clip(between, np.minimum(a, b), np.maximum(a, b)))  # rounding may pass the ends


def _folded(when: NDArray[np.float64], times: NDArray[np.float64], repeat: str) -> NDArray[np.float64]:
    """Times brought back between the first and the last key; those between them stay as they are, to the bit."""
    first, last = times[0], times[-1]
    if repeat == "hold" or first == last:
        return np.clip(when, first, last)
    period = last - first
    if repeat == "loop":
        inside, gone = (when >= first) & (when < last), (when - first) % period
    else:
        inside, gone = (when >= first) & (when <= last), (when - first) % (2.0 * period)
        gone = np.minimum(gone, 2.0 * period - gone)
    return np.where(inside, when, np.clip(first + gone, first, last))


def _slopes(line: NDArray[np.float64], step: NDArray[np.float64], cyclic: bool) -> NDArray[np.float64]:
    """The slope at each key, (..., n), of those of the n − 1 lines between them and how long these are."""
    left, right = (np.concatenate(part, axis=-1) for part in ((line[..., -1:], line), (line, line[..., :1])))
    h, k = np.concatenate([step[-1:], step]), np.concatenate([step, step[:1]])
    steepest = 3.0 * np.minimum(np.abs(left), np.abs(right))
    slope = np.clip((k * left + h * right) / (h + k), -steepest, steepest)
    slope[np.sign(left) * np.sign(right) <= 0.0] = 0.0
    if not cyclic:
        slope[..., [0, -1]] = 0.0
    return np.asarray(slope)


# --- the scene at one moment ------------------------------------------------------------------------


def scene_at(scene: Scene, time: float) -> Scene:
    """A moving scene as it is at one moment.

    Parameters
    ----------
    scene : Scene
        With tracks or without.
    time : float [s]
        The moment. Textures scroll by `Settings.time`, which is to be set to the same.

    Returns
    -------
    Scene
        Every track's value is in its place, and there are no tracks; a scene without tracks itself.

    Raises
    ------
    InputError
        ``time`` is not finite; the values at that moment do not go together, such as a direction that passes through
        zero on its way. What one number alone may be holds at all times, since no value leaves those of its keys.

    Examples
    --------
    >>> from froxel_ref.scene import Scene
    >>> walk = Track(path="camera.position[2]", keys=(Key(time=0, value=4), Key(time=2, value=0)))
    >>> scene_at(Scene(tracks=(walk,)), 0.5).camera.position
    (0.0, 1.7, 3.0)
    """
    time = at("time", Number(**TIME).accept, time)
    if not scene.tracks:
        return scene
    paths = [_split(track.path) for track in scene.tracks]
    values = [track_values(track, time).tolist() for track in scene.tracks]
    try:
        moment: Scene = _put(scene, _tree(paths, values) | {"tracks": ()})
    except InputError as error:
        raise _noted(error, paths, range(len(paths)), time) from None
    return moment


def duration(scene: Scene) -> float:
    """The time of the last key of all.

    Parameters
    ----------
    scene : Scene
        With tracks or without.

    Returns
    -------
    float [s]
        0 without tracks. What repeats goes on after it.

    Examples
    --------
    >>> from froxel_ref.scene import Scene
    >>> duration(Scene(tracks=(Track(path="ambient", keys=(Key(time=3, value=(1, 1, 1)),)),)))
    3.0
    """
    return max((track.keys[-1].time for track in scene.tracks), default=0.0)


def _tree(paths: Iterable[Steps], values: Iterable[float | list[float]]) -> dict[str | int, Any]:
    """Values by the steps to them, one dict within another: all of a record's come at once."""
    tree: dict[str | int, Any] = {}
    for path, value in zip(paths, values, strict=True):
        node = tree
        for step in path[:-1]:
            node = node.setdefault(step, {})
        node[path[-1]] = value
    return tree


def _put(whole: Any, changes: Any) -> Any:
    """A record or tuple with some of what it holds changed, each record on the way made and checked once."""
    if not isinstance(changes, dict):
        return changes
    if isinstance(whole, tuple):
        items = list(whole)
        for i, change in changes.items():
            items[i] = at(f"[{i}]", partial(_put, items[i]), change)
        return tuple(items)
    return dataclasses.replace(whole, **{
        name: at(name, partial(_put, getattr(whole, name)), change) for name, change in changes.items()})


def _noted(error: InputError, paths: Sequence[Steps], some: Iterable[int], time: float) -> InputError:
    """The fault with its time and the tracks to it, or all of the same part where none leads there."""
    place = _split(error.place) if _PATH.fullmatch(error.place) else ()
    some = list(some)
    near = [i for i in some if _is_within(paths[i], place)]
    near = near or [i for i in some if _part(paths[i]) == _part(place)]
    who = ", ".join(f"tracks[{i}]" for i in near) + " " if near else ""
    return InputError(error.place, f"{error.problem} ({who}at {_seconds(time)})")


# --- what may move ----------------------------------------------------------------------------------


def check_tracks(scene: Scene) -> None:
    """Refuse tracks that lead nowhere or to what cannot move, and values that are not allowed at a key's time.

    Parameters
    ----------
    scene : Scene
        Its constructor calls this.

    Raises
    ------
    InputError
        A path that leads nowhere, to a word, a whole number, a list of records or what a texture is made of; two
        tracks that move the same; a key's value that its field does not allow; values that do not go together at the
        time of a key.

    Notes
    -----
    Each value is checked by its field, then each part of the scene (the camera, a light, …) that tracks lead to is
    made once for every time at which one of its own tracks has a key: 2,000 keys of a camera's position and target
    take some 0.1 s.

    Examples
    --------
    >>> from froxel_ref.scene import Scene
    >>> Scene(tracks=(Track(path="camera.width", keys=(Key(time=0, value=4),)),))
    Traceback (most recent call last):
        ...
    froxel_ref.records.InputError: tracks[0].path: is 'camera.width', a whole number, must be a real number or a \
vector of them
    """
    if not scene.tracks:
        return
    paths, kinds = zip(*(at(f"tracks[{i}].path", partial(_end, scene), track.path)
                         for i, track in enumerate(scene.tracks)), strict=True)
    _refuse_twice(paths)
    for i, (track, path, kind) in enumerate(zip(scene.tracks, paths, kinds, strict=True)):
        for key in track.keys:
            try:
                at(_joined(path), kind.accept, key.value)
            except InputError as error:
                raise _noted(error, paths, [i], key.time) from None
    parts: dict[Steps, list[int]] = {}
    for i, path in enumerate(paths):
        parts.setdefault(_part(path), []).append(i)
    for part, some in parts.items():
        _check_part(scene, part, paths, some)


def _check_part(scene: Scene, part: Steps, paths: Sequence[Steps], some: list[int]) -> None:
    """Make one part of a scene as it is at every key of the tracks that move it."""
    whole: Any = scene
    for step in part:
        whole = whole[step] if isinstance(step, int) else getattr(whole, step)
    if not isinstance(whole, Record):  # a vector: its numbers were checked, each by itself
        return
    tracks = [scene.tracks[i] for i in some]
    inner = [paths[i][len(part):] for i in some]
    times = np.unique([key.time for track in tracks for key in track.keys])
    values = [track_values(track, times) for track in tracks]
    for k, time in enumerate(times.tolist()):
        try:
            at(_joined(part), partial(_put, whole), _tree(inner, (value[..., k].tolist() for value in values)))
        except InputError as error:
            raise _noted(error, paths, some, time) from None


def _refuse_twice(paths: Sequence[Steps]) -> None:
    ends: dict[Steps, int] = {}
    above: dict[Steps, int] = {}
    for i, path in enumerate(paths):
        ahead = [path[:length] for length in range(1, len(path) + 1)]
        other = next((ends[each] for each in ahead if each in ends), above.get(path))
        if other is not None:
            how = "like" if paths[other] == path else "inside" if len(paths[other]) < len(path) else "around"
            raise InputError(f"tracks[{i}].path", f"is {shown(_joined(path))}, {how} {_joined(paths[other])} of "
                                                  f"tracks[{other}], must be something else")
        ends[path] = i
        above |= dict.fromkeys(ahead, i)


def _end(scene: Scene, path: str) -> tuple[Steps, Kind]:
    """The steps of a path and the kind of what it leads to; refuses what cannot move."""
    if not _PATH.fullmatch(path):
        raise InputError("", f"is {shown(path)}, must be a path such as lights[2].radius")
    steps = _split(path)
    if steps[0] == "scene":
        raise InputError("", f"is {shown(path)}, must begin within the scene, without 'scene.'")
    kind: Kind = Nested(classes=(type(scene),))
    value: Any = scene
    for i, step in enumerate(steps):
        here = _joined(steps[:i])
        if isinstance(step, str):
            if not isinstance(value, Record):
                raise InputError("", f"is {shown(path)}, but {here} is {_what(kind, value)}, has no key {step!r}")
            known = kinds_of(type(value))
            if step not in known:
                raise InputError("", f"is {shown(path)}, but {step!r} is not a key{f' of {here}' if here else ''}; "
                                     f"{suggest(step, known)}")
            kind, value = known[step], getattr(value, step)
        elif not isinstance(value, tuple) or not isinstance(kind, (Many, Vector)):
            raise InputError("", f"is {shown(path)}, but {here} is {_what(kind, value)}, not a list")
        elif step >= len(value):
            count = f"has only {len(value)}" if value else "is empty"
            raise InputError("", f"is {shown(path)}, but {here} {count}")
        else:
            kind, value = kind.item if isinstance(kind, Many) else kind.each, value[step]
        if isinstance(value, _MADE_ONCE):
            raise InputError("", f"is {shown(path)}, but {_joined(steps[:i + 1])} is made into a texture once, "
                                 f"must not move")
    if steps[0] == "tracks":
        raise InputError("", f"is {shown(path)}, must be something else than a track")
    each = kind.each if isinstance(kind, Vector) else kind
    if not isinstance(each, Number) or each.whole:
        raise InputError("", f"is {shown(path)}, {_what(kind, value)}, must be a real number or a vector of them")
    return steps, kind


def _what(kind: Kind, value: Any) -> str:
    """What stands there, in words."""
    if value is None and isinstance(kind, (Nested, Vector)):
        return "null"
    if isinstance(kind, Vector) and isinstance(value, tuple):
        return "a list of whole numbers" if kind.each.whole else "a list of numbers"
    each = kind.each if isinstance(kind, Vector) else kind
    if isinstance(each, Number):
        return "a whole number" if each.whole else "one number"
    return {Many: "a list of records", Nested: "a record", Flag: "true or false"}.get(type(kind), "a word")


def _split(path: str) -> Steps:
    return tuple(int(digits) if digits else name for name, digits in re.findall(r"([A-Za-z_]\w*)|\[(\d+)\]", path))


def _joined(steps: Steps) -> str:
    return "".join(f"[{step}]" if isinstance(step, int) else f".{step}" for step in steps).removeprefix(".")


def _part(steps: Steps) -> Steps:
    """The beginning of a path that no other part's rules look beyond: ``camera``, ``lights[2]``."""
    return steps[:2] if len(steps) > 1 and isinstance(steps[1], int) else steps[:1]


def _is_within(steps: Steps, other: Steps) -> bool:
    return steps[:len(other)] == other != ()
