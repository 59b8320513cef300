"""The values of PacScript: numbers, texts, positions, joint values, vectors and arrays."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence

import numpy as np
from msgspec import Struct

from camgen.lang.values import Unknown
from camgen.model.pose import (
    IDENTITY,
    FloatArray,
    Pose,
    Vec3,
    compute_fixed_xyz,
    frozen,
    rotation_from_fixed_xyz,
)
from camgen.model.program import Joints


class Unreadable(ValueError):
    """Something that cannot be evaluated; its text says what."""


class Wrong(Unreadable):
    """Something at which the controller stops with an error."""


class PoseWithFigure(Pose, frozen=True, eq=False, gc=False):
    """A position with a figure that is not -1."""

    figure: int


class ExternalPose(Pose, frozen=True, eq=False, gc=False):
    """A pose in an external frame, which is not in the text. base: name of that frame."""

    base: str


class Vector(Struct, frozen=True, gc=False):
    """``V(x, y, z)``, mm."""

    values: Vec3


class Rate(float):
    """A speed in %, from `Mps`. mm_s: its exact value in mm/s."""

    mm_s: float

    def __new__(cls, mm_s: float, rated: float) -> Rate:
        """Make a speed. rated: speed at 100 %, mm/s."""
        rate = super().__new__(cls, 100 * mm_s / rated)
        rate.mm_s = mm_s
        return rate


class Either(Struct, frozen=True):
    """A number that depends on the unit of `Mps`, which a strict run may leave open.

    values: number for each unit.
    """

    values: tuple[float, ...]


class Mps(Struct, frozen=True):
    """A speed by `Mps` of a strict run.

    number: speed in the unit of the controller.
    """

    number: float | Either


#: An internal speed: %, a `Rate` of a program of any author, `Mps` of a strict run.
Speed = float | Mps


class Array:
    """An array, or the value of `Array()` or `Split()`.

    tops: largest index of each dimension, empty if the array grows with its use.
    fill: value of elements that were not set.
    items: elements that were set, by their indices.
    """

    __slots__ = ("fill", "items", "tops")

    def __init__(
        self, tops: tuple[int, ...], fill: Value, items: dict[tuple[int, ...], Value] | None = None
    ) -> None:
        self.tops, self.fill, self.items = tops, fill, items or {}

    def copy(self) -> Array:
        """Return a copy."""
        return Array(self.tops, self.fill, dict(self.items))

    def check(self, at: tuple[int, ...]) -> None:
        """Raise Wrong if the array has no such element."""
        if self.tops and (
            len(at) != len(self.tops)
            or any(k < 0 or k > top for k, top in zip(at, self.tops, strict=True))
        ):
            indices, tops = ", ".join(map(str, at)), ", ".join(map(str, self.tops))
            raise Wrong(f"there is no element ({indices}): the array ends at ({tops})")

    def get(self, at: tuple[int, ...]) -> Value:
        """Return an element."""
        self.check(at)
        return self.items.get(at, self.fill)


#: A tuple is a list of values in brackets without a name: a position in the older dialect.
Value = (
    float
    | str
    | bool
    | Pose
    | Joints
    | Vector
    | Array
    | Unknown
    | Either
    | Mps
    | tuple["Value", ...]
)

#: The figure of a position that leaves it open (RC8 manual 456).
UNDEFINED = -1
#: Largest number of a program, chosen above the longest delay, in ms.
LARGEST = 1e10
#: Maximum error of lengths and right angles of the axes of a homogeneous position.
_SQUARE = 1e-3
_NUMERAL = re.compile(r"\s*[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d{1,3})?\s*")
_rotations: dict[tuple[float, float, float], FloatArray] = {}


def finite(value: float) -> float:
    """Return `value`. Raises Unreadable if it is larger than `LARGEST`."""
    if not abs(value) <= LARGEST:
        raise Unreadable("a number is too large")
    return value


def index(value: float) -> int:
    """Convert a number to an index. Raises Unreadable if it is not one."""
    if not 0 <= value <= 1e9 or value != int(value):
        raise Unreadable(f"{value:g} is not an index")
    return int(value)


def position(values: Sequence[float]) -> Pose:
    """Make a position from `P(x, y, z, rx, ry, rz, fig)`, in mm and degrees.

    A missing value is 0, a missing figure -1. A figure below 0 is open.
    """
    if len(values) > 7:
        raise Unreadable("P() has more than seven values")
    x, y, z, rx, ry, rz = values[:6] if len(values) > 5 else [*values, *[0.0] * (6 - len(values))]
    if not math.isfinite(x + y + z + rx + ry + rz):
        raise Unreadable("a number is too large")
    key = (rx, ry, rz)
    if key not in _rotations:
        if len(_rotations) > 100_000:
            _rotations.clear()
        _rotations[key] = rotation_from_fixed_xyz(
            math.radians(rx), math.radians(ry), math.radians(rz)
        )
    if len(values) < 7 or values[6] < 0:
        return Pose(_rotations[key], (x, y, z))
    return PoseWithFigure(_rotations[key], (x, y, z), index(values[6]))


def vector(values: Sequence[float]) -> Vector:
    """Make a vector from `V(x, y, z)`, mm. A missing value is 0."""
    x, y, z = ([*values, 0.0, 0.0, 0.0])[:3]
    return Vector((x, y, z))


def joints(values: Sequence[float]) -> Joints:
    """Make joint values from `J(j1, j2, ...)`, in degrees."""
    if len(values) > 8:
        raise Unreadable("J() has more than eight values")
    return Joints(tuple(math.radians(v) for v in values))


def homogeneous(values: Sequence[float]) -> Pose:
    """Make a position from `T(p, orient, approach, fig)`: y axis, z axis (RC8 manual 458)."""
    if len(values) < 9:
        raise Unreadable("T() has fewer than nine values")
    y, z = np.array(values[3:6]), np.array(values[6:9])
    if max(abs(float(y @ y) - 1), abs(float(z @ z) - 1), abs(float(y @ z))) > _SQUARE:
        raise Unreadable("the axes of T() are not unit vectors at right angles")
    z = z / np.linalg.norm(z)
    y = y - z * float(y @ z)
    y = y / np.linalg.norm(y)
    return Pose(frozen(np.column_stack([np.cross(y, z), y, z])), (values[0], values[1], values[2]))


def name_place(base: str) -> ExternalPose:
    """Make an external pose with a name."""
    return ExternalPose(IDENTITY, (0.0, 0.0, 0.0), base)


def keep_frame(pose: Pose, other: Pose) -> Pose:
    """Return `pose` in the frame of `other`, which may be external."""
    return (
        ExternalPose(pose.rotation, pose.origin, other.base)
        if isinstance(other, ExternalPose)
        else pose
    )


def base_of(place: object) -> str:
    """Return the name of the external frame of a place, empty for any other value."""
    if isinstance(place, ExternalPose):
        return place.base
    return ""


def figure_of(place: object) -> int:
    """Return the figure of a position, -1 if it is open."""
    return place.figure if isinstance(place, PoseWithFigure) else UNDEFINED


def with_figure(place: Pose, figure: int) -> Pose:
    """Return a position with another figure, which is open below 0."""
    if figure < 0:
        return Pose(place.rotation, place.origin)
    return PoseWithFigure(place.rotation, place.origin, figure)


def components(place: Pose) -> list[float]:
    """Return x, y, z in mm and rx, ry, rz in degrees."""
    return [*place.origin, *map(math.degrees, compute_fixed_xyz(place.rotation))]


def number(value: Value, what: str = "a number") -> float:
    """Convert a value to a number. Raises Unreadable, also for an unknown value."""
    if isinstance(value, (float, bool)):
        return float(value)
    if isinstance(value, Unknown):
        raise Unreadable(f"{value.what} is not known")
    if isinstance(value, str) and (numeral := _NUMERAL.fullmatch(value)):
        return finite(float(numeral[0]))
    raise Unreadable(f"{describe_value(value)} is not {what}")


def describe_value(value: Value) -> str:
    """Describe a value in a message."""
    if isinstance(value, (float, bool)):
        return f"{float(value):g}"
    if isinstance(value, str):
        return f'"{value[:40]}"'
    return _NOUNS.get(type(value), "a value")


_NOUNS: dict[type, str] = {
    Pose: "a position",
    PoseWithFigure: "a position",
    Joints: "a joint value",
    Vector: "a vector",
    Array: "an array",
    ExternalPose: "a position that the text does not hold",
    Unknown: "a value that the text does not hold",
    tuple: "a list of values",
}


def comparable(value: Value | None) -> object:
    """Return a value as something that ``==`` compares."""
    if isinstance(value, Pose):
        return type(value), value.origin, value.rotation.tobytes()
    if isinstance(value, Array):
        return value.tops, {at: comparable(item) for at, item in value.items.items()}
    return value
