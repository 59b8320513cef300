"""V+ locations and precision points: what their expressions are, on top of those of numbers.

A location that only the controller knows stays what it is: whatever is made of it is named by the text that makes it.
Sources: as ``expressions``; FRAME and SCALE by the Language Reference.
"""

from __future__ import annotations

import math

import numpy as np

from camgen.model.pose import FloatArray, Pose, Vec3, frozen, rotation_about, to_vec3
from camgen.model.program import Joints
from camgen.model.text import counted

from .expressions import Numbers
from .functions import truth
from .text import NULL, Frame, Impossible, Location, Unreadable, rotation_zyz

_TURNS = {"RX": 0, "RY": 1, "RZ": 2}
_PARTS = {"DX": 0, "DY": 1, "DZ": 2}
#: Words that begin a location.
BUILT = frozenset(
    {
        "TRANS",
        "SHIFT",
        "INVERSE",
        "FRAME",
        "SCALE",
        "NORMAL",
        "TRANSB",
        "NULL",
        "HERE",
        "DEST",
        "TOOL",
        "BASE",
        "LATCH",
    }
    | _TURNS.keys()
)
_SMALL = 1e-9
#: Below this many mm two locations are the same one.
_SAME = 1e-6


def describe(location: Location) -> str:
    """The name of a location that only the controller knows, with what is compounded to it."""
    name, local = location.frame.external, location.local
    if local is NULL or (not any(local.origin) and np.array_equal(local.rotation, NULL.rotation)):
        return name
    x, y, z = local.origin
    turned = "" if np.array_equal(local.rotation, NULL.rotation) else ",.."
    return f"{name}:TRANS({x:.6g},{y:.6g},{z:.6g}{turned})"


def unknown(name: str) -> Location:
    """A location that only the controller knows."""
    return Location(NULL, Frame(external=name[:120]))


def _shift_unknown(location: Location, by: Vec3) -> Location:
    """A location that only the controller knows, shifted; shifts of shifts are one."""
    frame = location.frame
    again = frame.of != "" and describe(location) == frame.external
    name = frame.of if again else describe(location)
    x, y, z = (a + b for a, b in zip(frame.by if again else (0.0, 0.0, 0.0), by, strict=True))
    if max(abs(x), abs(y), abs(z)) < _SMALL:
        return unknown(name)
    return Location(
        NULL,
        Frame(external=f"SHIFT({name} BY {x:.6g},{y:.6g},{z:.6g})"[:120], of=name, by=(x, y, z)),
    )


class Expression(Numbers):
    """One text of any kind, read from left to right."""

    def location(self) -> Location:
        """A location or a compound ``a:b:c``."""
        first = self._primary()
        while self.accept(":"):
            second = self._primary()
            if second.frame.external and not self._scope.strict:
                first = unknown(f"{self._name(first)}:{describe(second)}")
                continue
            relative = second.in_base()
            if first.frame.compound or first.frame.external:
                first = first.moved(relative)
            else:
                first = Location(relative, Frame(first.local, compound=True, name=first.name))
        return first

    def _name(self, location: Location) -> str:
        if location.frame.external:
            return describe(location)
        x, y, z = location.in_base().origin
        return location.name or f"TRANS({x:.6g},{y:.6g},{z:.6g},..)"

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
            return self._named().here(token)
        if self._scope.strict and token in ("FRAME", "TRANSB"):
            raise Unreadable(f"{token} is not evaluated")
        more = None if self._scope.strict else self._foreign(token)
        if more is not None:
            return more
        if not token[0].isalpha():
            raise Unreadable(f"a location expected instead of {token!r}")
        return self._named().location(token + self.subscripts())

    def _foreign(self, token: str) -> Location | None:
        """What the post does not write; nothing where the token is a name."""
        if token == "(":
            return self._inner()
        if token in _MORE:
            return _MORE[token](self)
        if token in ("TOOL", "BASE"):
            return self._named().here(token)
        if token[0].isalpha() and self.accept("("):
            return self._function_of(token)
        return None

    def _function_of(self, token: str) -> Location:
        """A function that no text answers, such as those of a camera."""
        self.constant = False
        text = f"{token}({self.skip()})"
        if token not in _ASKED:
            raise Unreadable(f"{token} is no function of locations")
        return unknown(text)

    def _inner(self) -> Location:
        """A location up to the closing bracket."""
        self.deeper()
        value = self.location()
        self.expect(")")
        self._depth -= 1
        return value

    def _trans(self) -> Location:
        self.expect("(")
        self.deeper()
        values = self.reals()
        self.expect(")")
        self._depth -= 1
        if len(values) > 6:
            raise Unreadable(f"TRANS has {len(values)} arguments")
        x, y, z, yaw, pitch, roll = values + [0.0] * (6 - len(values))
        return Location(Pose(rotation_zyz(yaw, pitch, roll), (x, y, z)))

    def _inverse(self) -> Location:
        self.expect("(")
        inner = self._inner()
        if inner.frame.external and not self._scope.strict:
            return unknown(f"INVERSE({describe(inner)})")
        return Location(inner.in_base().inverse())

    def _shift(self) -> Location:
        self.expect("(")
        self.deeper()
        location = self.location()
        self.expect("BY")
        values = self.reals()
        self.expect(")")
        self._depth -= 1
        if len(values) > 3:
            raise Unreadable(f"SHIFT by {len(values)} values")
        dx, dy, dz = values + [0.0] * (3 - len(values))
        if location.frame.external and not self._scope.strict:
            return _shift_unknown(location, (dx, dy, dz))
        pose = location.in_base()
        x, y, z = pose.origin
        return Location(Pose(pose.rotation, (x + dx, y + dy, z + dz)))

    def _frame(self) -> Location:
        """``FRAME(a, b, c, o)``: x from a to b, y towards c, the origin at o."""
        found = self._several(4)
        if any(place.frame.external for place in found):
            return unknown(f"FRAME({', '.join(map(self._name, found))})")
        a, b, c, o = (np.array(place.in_base().origin) for place in found)
        along, aside = b - a, c - a
        up = np.cross(along, aside)
        if min(float(np.linalg.norm(along)), float(np.linalg.norm(up))) < _SMALL:
            raise Impossible("FRAME of points on one line")
        return Location(Pose(_square(along, up), to_vec3(o)))

    def _several(self, count: int) -> list[Location]:
        self.expect("(")
        self.deeper()
        found = [self.location()]
        while len(found) < count:
            self.expect(",")
            found.append(self.location())
        self.expect(")")
        self._depth -= 1
        return found

    def _scale(self) -> Location:
        self.expect("(")
        self.deeper()
        location = self.location()
        self.expect("BY")
        by = self.logic()
        self.expect(")")
        self._depth -= 1
        if location.frame.external:
            return unknown(f"SCALE({describe(location)} BY {by:.6g})")
        pose = location.in_base()
        x, y, z = pose.origin
        return Location(Pose(pose.rotation, (x * by, y * by, z * by)))

    def _normal(self) -> Location:
        self.expect("(")
        return self._inner()

    def _of_bytes(self) -> Location:
        self.expect("(")
        return unknown(f"TRANSB({self.skip()})")

    def _latch(self) -> Location:
        if self.accept("("):
            self.skip()
        return unknown("LATCH")

    def _of_locations(self, word: str) -> float:
        if word in _PARTS:
            inner = self._inner()
            if inner.frame.external and not self._scope.strict:
                return self._named().answer(f"{word}({describe(inner)})", "", 0.0)
            return inner.in_base().origin[_PARTS[word]]
        self._at -= 1
        a, b = self._several(2)
        if a.frame.external or b.frame.external:
            return self._named().answer(f"{word}({self._name(a)}, {self._name(b)})", "", 0.0)
        p, q = a.in_base(), b.in_base()
        distance = math.dist(p.origin, q.origin)
        if word == "DISTANCE":
            return distance
        return truth(distance < _SAME and bool(np.abs(p.rotation - q.rotation).max() < _SAME))

    # -- precision points ----------------------------------------------------------------------------------------

    def point(self) -> Joints:
        """``#PPOINT(..)`` or the name of a precision point. Degrees; mm for joint 3 of four (a SCARA)."""
        found = self.any_point()
        if isinstance(found, Joints):
            return found
        raise Unreadable(f"precision point {describe(found)} is only on the controller")

    def any_point(self) -> Joints | Location:
        """The same; a location where only the controller knows its joints."""
        token = self.take()
        if token in ("#DEST", "#HERE", "#PDEST", "#PHERE") and not self._scope.strict:
            return self._named().point_here(token[-4:])
        if token != "#PPOINT":
            if token[0] != "#" and not self._scope.strict:
                raise Unreadable(f"a precision point expected instead of {token[:20]!r}")
            if self.peek() == "(" and not self._scope.strict:
                self.take()
                return unknown(f"{token}({self.skip()})")
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


#: Functions of locations of options and cameras.
_ASKED = frozenset(
    {
        "VLOC",
        "VISION.LOC",
        "VTRANS",
        "BELT",
        "LATCH",
        "DEST",
        "HERE",
        "SOLVE.TRANS",
        "NOMINAL",
        "VFRAME",
    }
)
_BUILDS = {"TRANS": Expression._trans, "SHIFT": Expression._shift, "INVERSE": Expression._inverse}
_MORE = {
    "FRAME": Expression._frame, "SCALE": Expression._scale, "NORMAL": Expression._normal,
    "TRANSB": Expression._of_bytes, "LATCH": Expression._latch,
}  # fmt: skip


def to_joints(values: list[float]) -> Joints:
    """Joint values as V+ gives them: deg, of four joints the third one in mm."""
    slide = 2 if len(values) == 4 else None
    return Joints(tuple(v if k == slide else math.radians(v) for k, v in enumerate(values)))


def to_values(joints: Joints) -> list[float]:
    """The other way round."""
    slide = 2 if len(joints.values) == 4 else None
    return [v if k == slide else math.degrees(v) for k, v in enumerate(joints.values)]


def _square(x: FloatArray, z: FloatArray) -> FloatArray:
    x, z = x / np.linalg.norm(x), z / np.linalg.norm(z)
    return frozen(np.column_stack([x, np.cross(z, x), z]))
