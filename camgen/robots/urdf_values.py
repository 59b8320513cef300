"""Numbers, places and names in the elements of a URDF, in mm and rad.

Source: the ROS wiki's pages urdf/XML/joint and urdf/XML/link: lengths are m; ``rpy`` turns about the fixed axes x, y
and z, in this order, by rad.
"""

from __future__ import annotations

import math
import re
from xml.etree.ElementTree import Element

from camgen.pose import Pose, Vec3, rotation_from_fixed_xyz

#: Lengths in m and angles in rad beyond this are damage.
_FARTHEST = 1e4
_NUMBER = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?", re.ASCII)
#: rad: an angle no farther from a multiple of 90 deg than this, and than one of its last digit, is that multiple.
_ROUNDED = 1e-3
_EXACT = 1e-9
#: Letters of a name.
_LONGEST = 500
ZERO: Vec3 = (0.0, 0.0, 0.0)


class Wrong(Exception):
    """An element that cannot be meant; whoever knows the file's name makes an InputError of it."""

    def __init__(self, what: str, where: str = "", remedy: str = "") -> None:
        super().__init__(what, where, remedy)
        self.what, self.where, self.remedy = what, where, remedy


def name_of(element: Element, key: str, where: str = "") -> str:
    """The attribute ``key``, which has to be there."""
    value = element.get(key, "").strip()
    if not value:
        raise Wrong(f"{element.tag} has no {key}", where, f'give it {key}="..."')
    if len(value) > _LONGEST:
        raise Wrong(f"{element.tag} {value[:20]}... has a {key} of {len(value)} letters", where, "shorten it")
    if not value.isprintable():
        raise Wrong(f"{element.tag} has a {key} that cannot be printed", where, "rename it")
    return value


def number(text: str, where: str) -> float:
    """A finite number of a size that lengths in m and angles in rad have."""
    text = text.strip()
    if not _NUMBER.fullmatch(text):
        raise Wrong(f'"{text[:40]}" is not a number', where)
    value = float(text)
    if not abs(value) < _FARTHEST:
        raise Wrong(f"{text[:40]} is beyond all measure", where, "lengths are m, angles rad")
    return value


def optional(element: Element, key: str, where: str) -> float | None:
    """The number ``key`` of an element, None where it is not stated."""
    text = element.get(key)
    return None if text is None else number(text, f"{where}, {key}")


def three(element: Element | None, key: str, default: Vec3, where: str) -> Vec3:
    """Three numbers ``key`` of an element, ``default`` where they are not stated."""
    text = None if element is None else element.get(key)
    if text is None:
        return default
    words = text.split()
    if len(words) != 3:
        raise Wrong(f"three numbers are needed, not {len(words)}", f"{where}, {key}")
    x, y, z = (number(word, f"{where}, {key}") for word in words)
    return (x, y, z)


def place(element: Element, where: str) -> Pose:
    """Where the ``origin`` in an element is, mm; the parent's frame where it has none."""
    origin = element.find("origin")
    x, y, z = three(origin, "xyz", ZERO, where)
    three(origin, "rpy", ZERO, where)
    roll, pitch, yaw = (_angle(word) for word in _angles(origin))
    return Pose(rotation_from_fixed_xyz(roll, pitch, yaw), (1000 * x, 1000 * y, 1000 * z))


def rounded_angles(element: Element) -> int:
    """How many angles of its ``origin`` were taken as the multiples of 90 deg that they are rounded from."""
    words = _angles(element.find("origin"))
    return sum(abs(_angle(word) - float(word)) > _EXACT for word in words)


def _angles(origin: Element | None) -> list[str]:
    return ("0 0 0" if origin is None else origin.get("rpy", "0 0 0")).split()


def _angle(text: str) -> float:
    """The angle that ``text`` stands for: 1.5708 and 1.57 are 90 deg, 1.58 and 0.001 are what they are. With 0.0002 deg
    between axes that are meant to be square no arm would be one that has a closed form.
    """
    value = float(text)
    quarters = round(value / (math.pi / 2))
    if not quarters:
        return value
    digits, _, power = text.lower().partition("e")
    last = 10.0 ** (int(power or 0) - len(digits.partition(".")[2]))
    whole = quarters * math.pi / 2
    return whole if abs(value - whole) <= min(last, _ROUNDED) else value


def direction(element: Element, where: str) -> Vec3:
    """The ``axis`` in an element, of length 1; x where it has none."""
    stated = three(element.find("axis"), "xyz", (1.0, 0.0, 0.0), f"{where}, axis")
    length = math.hypot(*stated)
    if length < 1e-6:
        raise Wrong("the axis has no direction", where, "give axis xyz, of length 1")
    x, y, z = (value / length for value in stated)
    return (x, y, z)
