"""Where things are: cameras and transforms, and how far a scene's numbers go."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from froxel_ref.kinds import integer, number, vector
from froxel_ref.records import InputError, Record

__all__ = ["BLACK", "LIGHT", "LONGEST", "PLACE", "RATE", "SHORTEST", "SINGULAR", "SIZE", "STRONGEST", "WHITE", "WIDEST",
           "Camera", "Rgb", "Transform", "Vec3", "cos_sin", "must_point"]

Rgb = tuple[float, float, float]
Vec3 = tuple[float, float, float]
BLACK: Rgb = (0.0, 0.0, 0.0)
WHITE: Rgb = (1.0, 1.0, 1.0)

# Nothing is farther, larger, smaller or brighter than this: far beyond what a scene needs (a light year has
# 1e16 m, a hair 1e-4), and near enough that no square, fourth power or product of the stages' leaves the
# range of float32, where a frame would turn into infinities and NaN without a word.
LONGEST, SHORTEST, STRONGEST = 1e10, 1e-9, 1e18
RATE: dict[str, Any] = {"within": (-LONGEST, LONGEST)}
PLACE: dict[str, Any] = {"unit": "m", "within": (-LONGEST, LONGEST)}
SIZE: dict[str, Any] = {"unit": "m", "above": 0.0, "within": (SHORTEST, LONGEST)}
LIGHT: dict[str, Any] = {"at_least": 0.0, "within": (0.0, STRONGEST)}

# A transform whose smallest scale is below this share of its largest is refused as singular: float64
# could still invert it, but a point would lose half of its digits on the way.
SINGULAR = 1e-8

# Vectors that are normalised, and transforms, keep between 1/WIDEST and WIDEST, where squares and
# products of three neither overflow nor underflow.
WIDEST = 1e100


def must_point(direction: tuple[float, ...], name: str) -> None:
    """Refuse a vector that has no direction, or a length whose square is no number.

    Parameters
    ----------
    direction : tuple of floats
    name : str
        The field that it is in.

    Raises
    ------
    InputError

    Examples
    --------
    >>> must_point((0.0, 0.0, 0.0), "up")
    Traceback (most recent call last):
        ...
    froxel_ref.records.InputError: up: is zero, must point somewhere
    """
    if not any(direction):
        raise InputError(name, "is zero, must point somewhere")
    if not 1 / WIDEST < math.hypot(*direction) < WIDEST:
        raise InputError(name, f"has length {math.hypot(*direction):g}, must be within {1 / WIDEST:g} and "
                               f"{WIDEST:g}")


def _unit(direction: tuple[float, ...]) -> tuple[float, ...]:
    length = math.hypot(*direction)
    return tuple(component / length for component in direction)


@dataclass(frozen=True, kw_only=True)
class Camera(Record):
    """A pinhole camera and the size of its image."""

    position: Vec3 = vector((0.0, 1.7, 0.0), "world position", **PLACE)
    target: Vec3 = vector((0.0, 1.7, -1.0), "world point in the centre of the image", **PLACE)
    up: Vec3 = vector((0.0, 1.0, 0.0), "direction that is up in the image", **RATE)
    vertical_fov: float = number(60.0, "vertical field of view", unit="degrees", above=0.0, below=180.0,
                                 within=(0.001, 179.9))
    width: int = integer(960, "image width", unit="pixels", at_least=1, at_most=16384)
    height: int = integer(540, "image height", unit="pixels", at_least=1, at_most=16384)
    exposure: float = number(1.0, "factor on radiance for display", above=0.0, within=(SHORTEST, LONGEST))

    def check_together(self) -> None:
        if self.target == self.position:
            raise InputError("target", "is the camera's position, must be another point")
        forward = tuple(b - a for a, b in zip(self.position, self.target, strict=True))
        must_point(forward, "target")
        must_point(self.up, "up")
        across = np.cross(_unit(forward), _unit(self.up))
        if not float(np.linalg.norm(across)) > SINGULAR:
            raise InputError("up", "is along the view direction, must be across it")


# --- placing things ---------------------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True)
class Transform(Record):
    """An affine map from local space to the world: first scale, then rotate, then translate."""

    translate: Vec3 = vector(BLACK, "world position of the local origin", **PLACE)
    rotate: Vec3 = vector(BLACK, "turns about the world's x, then y, then z axis", unit="degrees", **RATE)
    scale: Vec3 = vector(WHITE, "metres per local unit along each local axis (half the extent)", **PLACE)
    matrix: tuple[float, ...] | None = vector(
        None, "instead of the three above: world_from_local as 12 numbers, its 3 rows of 4 one after the other",
        length=12, optional=True, **RATE)

    def check_together(self) -> None:
        if self.matrix is not None and (self.translate, self.rotate, self.scale) != (BLACK, BLACK, WHITE):
            raise InputError("matrix", "is given beside translate, rotate or scale, must stand for all three")
        place = "scale" if self.matrix is None else "matrix"
        linear = self.world_from_local[:3, :3]
        largest = float(np.abs(linear).max())
        if largest and not 1 / WIDEST < largest < WIDEST:
            raise InputError(
                place, f"has a largest entry of {largest:g}, must be within {1 / WIDEST:g} and {WIDEST:g}")
        sizes = np.linalg.svd(linear / (largest or 1.0), compute_uv=False)
        if not sizes[-1] > SINGULAR * sizes[0]:
            raise InputError(place, "makes the transform singular, must span all three axes")

    @property
    def world_from_local(self) -> NDArray[np.float64]:
        """The matrix, shape (4, 4), float64."""
        result = np.eye(4)
        if self.matrix is not None:
            result[:3] = np.reshape(self.matrix, (3, 4))
            return result
        turn = np.eye(3)
        for axis, degrees in enumerate(self.rotate):
            c, s = cos_sin(degrees)
            step = np.eye(3)
            i, j = (axis + 1) % 3, (axis + 2) % 3
            step[[i, i, j, j], [i, j, i, j]] = c, -s, s, c
            turn = step @ turn
        result[:3, :3] = turn * self.scale
        result[:3, 3] = self.translate
        return result


def cos_sin(degrees: float) -> tuple[float, float]:
    """Cosine and sine, exact at multiples of 90°, so that axis-aligned things stay axis-aligned.

    Parameters
    ----------
    degrees : float

    Returns
    -------
    (float, float)

    Examples
    --------
    >>> cos_sin(270.0)
    (0.0, -1.0)
    """
    quarter = {0.0: (1.0, 0.0), 90.0: (0.0, 1.0), 180.0: (-1.0, 0.0), 270.0: (0.0, -1.0)}
    angle = np.deg2rad(degrees)
    return quarter.get(degrees % 360.0, (float(np.cos(angle)), float(np.sin(angle))))
