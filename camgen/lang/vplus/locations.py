"""Evaluates V+ locations and precision points, in addition to numbers and strings.

An external location, which is stored on the controller alone, is a frame of that name. An
expression with an external location is an external frame too, named by the text of the expression.
Sources: as ``expressions``; FRAME and SCALE by the Language Reference.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TypeVar

import numpy as np

from camgen.model.pose import Pose, Vec3, frozen, rotation_about, to_vec3
from camgen.model.program import Joints
from camgen.model.text import counted

from .expressions import Numbers
from .functions import truth
from .text import NULL, Frame, Impossible, Location, Unreadable, rotation_zyz
from .variables import NAME_PATTERN, Variables

_Operand = TypeVar("_Operand")

_TURNS = {"RX": 0, "RY": 1, "RZ": 2}
_PARTS = {"DX": 0, "DY": 1, "DZ": 2}
#: Words that begin a location.
BUILT = _TURNS.keys() | {
    "TRANS", "SHIFT", "INVERSE", "FRAME", "SCALE", "NORMAL", "TRANSB", "NULL", "HERE", "DEST",
    "TOOL", "BASE", "LATCH",
}  # fmt: skip
#: mm, or mm2 for the area of a FRAME: shifts and points that differ by less are equal.
_SMALL = 1e-9
#: mm, and elements of a rotation: IDENTICAL is TRUE for locations that differ by less.
_SAME = 1e-6


def describe(location: Location) -> str:
    """Return the text of an external location: its name, and the pose that is compounded to it."""
    name, local = location.frame.external, location.local
    if local is NULL or (not any(local.origin) and np.array_equal(local.rotation, NULL.rotation)):
        return name
    x, y, z = local.origin
    turned = "" if np.array_equal(local.rotation, NULL.rotation) else ",.."
    return f"{name}:TRANS({x:.6g},{y:.6g},{z:.6g}{turned})"


def describe_any(location: Location) -> str:
    """Return a short text of a location."""
    if location.frame.external:
        return describe(location)
    return location.name or "TRANS({:.6g},{:.6g},{:.6g},..)".format(*location.in_base().origin)


def make_external(name: str) -> Location:
    """Return a location that is stored on the controller alone."""
    return Location(NULL, Frame(external=name[:120]))


def _shift_external(location: Location, shift: Vec3) -> Location:
    """Shift an external location by mm. Repeated shifts are added up."""
    frame = location.frame
    again = frame.shifted != "" and describe(location) == frame.external
    name = frame.shifted if again else describe(location)
    x, y, z = (a + b for a, b in zip(frame.shift if again else (0.0, 0.0, 0.0), shift, strict=True))
    if max(abs(x), abs(y), abs(z)) < _SMALL:
        return make_external(name)
    return Location(
        NULL,
        Frame(
            external=f"SHIFT({name} BY {x:.6g},{y:.6g},{z:.6g})"[:120],
            shifted=name,
            shift=(x, y, z),
        ),
    )


class Expression(Numbers):
    """A text of any kind of value, parsed from left to right."""

    def location(self) -> Location:
        """Evaluate a location or a compound `a:b:c`."""
        first = self._primary()
        while self.accept(":"):
            second = self._primary()
            if second.frame.external and not self._scope.strict:
                first = make_external(f"{describe_any(first)}:{describe(second)}")
                continue
            relative = second.in_base()
            if first.frame.compound or first.frame.external:
                first = first.moved(relative)
            else:
                first = Location(relative, Frame(first.local, compound=True, name=first.name))
        return first

    def _primary(self) -> Location:
        token = self.take()
        if token in _BUILDS:
            return _BUILDS[token](self)
        if token in _TURNS:
            self.expect("(")
            return Location(
                Pose(
                    rotation_about(_TURNS[token], math.radians(self._bracketed())), (0.0, 0.0, 0.0)
                )
            )
        if token == "NULL":
            return Location(NULL)
        if token in ("HERE", "DEST"):
            return self._named().current_location(token)
        if self._scope.strict and token in ("FRAME", "TRANSB"):
            raise Unreadable(f"{token} is not evaluated")
        location = None if self._scope.strict else self._foreign(token)
        if location is not None:
            return location
        if not token[0].isalpha():
            raise Unreadable(f"a location expected instead of {token!r}")
        return self._named().location(token + self.subscripts())

    def _foreign(self, token: str) -> Location | None:
        """Evaluate a spelling that the post does not write. None if the token is a name."""
        if token == "(":
            return self._inner()
        if token in _MORE:
            return _MORE[token](self)
        if token in ("TOOL", "BASE"):
            return self._named().current_location(token)
        if token[0].isalpha() and self.accept("("):
            return self._external_function(token)
        return None

    def _external_function(self, token: str) -> Location:
        self.constant = False
        text = f"{token}({self.skip()})"
        if token not in _ASKED:
            raise Unreadable(f"{token} is not a function of locations")
        return make_external(text)

    def _inner(self) -> Location:
        self.deeper()
        value = self.location()
        self.close_bracket()
        return value

    def _trans(self) -> Location:
        self.open_bracket()
        values = self.reals()
        self.close_bracket()
        if len(values) > 6:
            raise Unreadable(f"TRANS has {len(values)} arguments")
        x, y, z, yaw, pitch, roll = values + [0.0] * (6 - len(values))
        return Location(Pose(rotation_zyz(yaw, pitch, roll), (x, y, z)))

    def _inverse(self) -> Location:
        inner = self._normal()
        if inner.frame.external and not self._scope.strict:
            return make_external(f"INVERSE({describe(inner)})")
        return Location(inner.in_base().inverse())

    def _shift(self) -> Location:
        self.open_bracket()
        location = self.location()
        self.expect("BY")
        values = self.reals()
        self.close_bracket()
        if len(values) > 3:
            raise Unreadable(f"SHIFT by {len(values)} values")
        dx, dy, dz = values + [0.0] * (3 - len(values))
        if location.frame.external and not self._scope.strict:
            return _shift_external(location, (dx, dy, dz))
        pose = location.in_base()
        x, y, z = pose.origin
        return Location(Pose(pose.rotation, (x + dx, y + dy, z + dz)))

    def _frame(self) -> Location:
        """Evaluate `FRAME(a, b, c, o)`: x from a to b, y towards c, the origin at o."""
        points = self._several(4)
        if any(point.frame.external for point in points):
            return make_external(f"FRAME({', '.join(map(describe_any, points))})")
        a, b, c, o = (np.array(point.in_base().origin) for point in points)
        x_direction = b - a
        z_direction = np.cross(x_direction, c - a)
        if min(float(np.linalg.norm(x_direction)), float(np.linalg.norm(z_direction))) < _SMALL:
            raise Impossible("FRAME of points on one line")
        x, z = x_direction / np.linalg.norm(x_direction), z_direction / np.linalg.norm(z_direction)
        rotation = frozen(np.column_stack([x, np.cross(z, x), z]))
        return Location(Pose(rotation, to_vec3(o)))

    def _several(self, count: int) -> list[Location]:
        self.open_bracket()
        locations = [self.location()]
        while len(locations) < count:
            self.expect(",")
            locations.append(self.location())
        self.close_bracket()
        return locations

    def _scale(self) -> Location:
        self.open_bracket()
        location = self.location()
        self.expect("BY")
        factor = self.logic()
        self.close_bracket()
        if location.frame.external:
            return make_external(f"SCALE({describe(location)} BY {factor:.6g})")
        pose = location.in_base()
        x, y, z = pose.origin
        return Location(Pose(pose.rotation, (x * factor, y * factor, z * factor)))

    def _normal(self) -> Location:
        self.expect("(")
        return self._inner()

    def _of_bytes(self) -> Location:
        self.expect("(")
        return make_external(f"TRANSB({self.skip()})")

    def _latch(self) -> Location:
        if self.accept("("):
            self.skip()
        return make_external("LATCH")

    def _of_locations(self, word: str) -> float:
        if word in _PARTS:
            inner = self._inner()
            if inner.frame.external and not self._scope.strict:
                return self._named().answer(f"{word}({describe(inner)})", "", 0.0)
            return inner.in_base().origin[_PARTS[word]]
        self._at -= 1
        a, b = self._several(2)
        if a.frame.external or b.frame.external:
            return self._named().answer(f"{word}({describe_any(a)}, {describe_any(b)})", "", 0.0)
        p, q = a.in_base(), b.in_base()
        distance = math.dist(p.origin, q.origin)
        if word == "DISTANCE":
            return distance
        return truth(distance < _SAME and bool(np.abs(p.rotation - q.rotation).max() < _SAME))

    # -- precision points ---------------------------------------------------------------------

    def operand(self) -> Joints | Location:
        """Evaluate the target of a motion: a location or a precision point."""
        return self.point() if self.peek()[:1] == "#" else self.location()

    def location_name(self) -> str:
        """Take the name of a location or of a precision point, with its subscripts evaluated."""
        name = self.take()
        if not NAME_PATTERN.fullmatch(name) or name[0] == "$":
            raise Unreadable(f"{name[:20]!r} is not the name of a location")
        return name + self.subscripts()

    def point(self) -> Joints | Location:
        """Evaluate `#PPOINT(..)` or the name of a precision point.

        V+ counts degrees, and mm for joint 3 of four (a SCARA). The value is a location if the
        joint values are external.
        """
        token = self.take()
        if token in ("#DEST", "#HERE", "#PDEST", "#PHERE") and not self._scope.strict:
            return self._named().current_point(token[-4:])
        if token != "#PPOINT":
            if token[0] != "#" and not self._scope.strict:
                raise Unreadable(f"a precision point expected instead of {token[:20]!r}")
            if self.peek() == "(" and not self._scope.strict:
                self.take()
                return make_external(f"{token}({self.skip()})")
            return self._named().point(token + self.subscripts())
        self.expect("(")
        values = self.reals()
        self.expect(")")
        if len(values) not in (4, 6):
            if self._scope.strict or len(values) > 12 or (len(values) == 1 and self.omitted):
                raise Unreadable(f"#PPOINT has {counted(len(values), 'value')}, not 4 or 6")
            self.omitted = True
            values += [0.0] * (6 - len(values))
        return to_joints(values)


#: Functions whose locations are external, of options and cameras for example.
_ASKED = frozenset({
    "VLOC", "VISION.LOC", "VTRANS", "BELT", "LATCH", "DEST", "HERE", "SOLVE.TRANS", "NOMINAL",
    "VFRAME",
})  # fmt: skip
_BUILDS = {"TRANS": Expression._trans, "SHIFT": Expression._shift, "INVERSE": Expression._inverse}
_MORE = {
    "FRAME": Expression._frame, "SCALE": Expression._scale, "NORMAL": Expression._normal,
    "TRANSB": Expression._of_bytes, "LATCH": Expression._latch,
}  # fmt: skip


def read_whole(text: str, scope: Variables, read: Callable[[Expression], _Operand]) -> _Operand:
    """Evaluate a text that is one operand, by a method of `Expression`."""
    expression = Expression(text, scope)
    value = read(expression)
    expression.finish()
    return value


def to_joints(values: list[float]) -> Joints:
    """Convert joint values of V+: degrees, and mm for the third of four joints."""
    slide = 2 if len(values) == 4 else None
    return Joints(tuple(v if k == slide else math.radians(v) for k, v in enumerate(values)))


def to_values(joints: Joints) -> list[float]:
    """Convert joint values to those of V+, the inverse of `to_joints`."""
    slide = 2 if len(joints.values) == 4 else None
    return [v if k == slide else math.degrees(v) for k, v in enumerate(joints.values)]
