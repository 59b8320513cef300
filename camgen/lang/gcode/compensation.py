"""Cutter compensation (G41, G42) as LinuxCNC runs it: the path of the tool at its radius.

The path follows an arc about each outer corner. At inner corners it is cut where both
sides cross. So a motion is written after the next one is known. The plane is XY or XZ, and its
points are complex numbers.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Callable
from dataclasses import dataclass, field

from camgen.lang.gcode.words import LineError
from camgen.model.pose import Vec3
from camgen.model.program import Instruction

#: rad: smaller turns are not corners, as in LinuxCNC. So are inner corners that nearly turn back.
_STRAIGHT = 0.05
_SAME = 1e-9
_SHORT = "the first motion with G41 or G42 is not longer than the radius of the tool"


@dataclass(slots=True)
class Segment:
    """A motion in the plane.

    begin, end: programmed ends, mm.
    centre: centre of an arc, None for a line.
    turn: 1 for an arc to the left, -1 to the right.
    height: height at its end along the normal, mm.
    speed: mm/s, None for a rapid motion.
    line: number of its line.
    start, stop: ends of the path of the tool, mm.
    """

    begin: complex
    end: complex
    centre: complex | None
    turn: int
    height: float
    speed: float | None
    line: int
    start: complex = 0j
    stop: complex = 0j

    def heading(self, at_end: bool) -> complex:
        """The direction at one of its ends, of length 1."""
        if self.centre is None:
            direction = self.end - self.begin
        else:
            direction = ((self.end if at_end else self.begin) - self.centre) * (1j * self.turn)
        return direction / abs(direction)


@dataclass(slots=True)
class OffsetPath:
    """The path of the tool at its radius beside the programmed path.

    side: 1 left, -1 right.
    radius: radius of the tool, mm.
    axes: axes of the plane, and its normal.
    tip: position of the tool in the plane, mm.
    write: adds a segment to the program.
    keep: adds any other instruction with its line.
    last: the motion that is not written yet.
    is_first: whether it is the first motion.
    pending: segments along the normal, and instructions with their lines, that follow it.
    """

    side: int
    radius: float
    axes: tuple[int, int, int]
    tip: complex
    write: Callable[[Segment], None]
    keep: Callable[[Instruction, int], None]
    last: Segment | None = None
    is_first: bool = True
    pending: list[tuple[Instruction, int] | Segment] = field(default_factory=list)

    def move(self, segment: Segment) -> None:
        """Adds the next motion. Raises LineError if the tool cannot run beside it."""
        segment.start, segment.stop = segment.begin, segment.end
        if segment.centre is None and abs(segment.end - segment.begin) < _SAME:
            if self.last is None:
                raise LineError(_SHORT)
            self.pending.append(segment)
            return
        self._set_off(segment)
        if self.last is None:
            self._enter(segment)
        else:
            self._join(self.last, segment)
        self.last = segment

    def _set_off(self, segment: Segment) -> None:
        """Offsets both ends of a motion. Raises LineError for an inner arc that is too small."""
        if segment.centre is None:
            offset = segment.heading(False) * (1j * self.side * self.radius)
            segment.start, segment.stop = segment.begin + offset, segment.end + offset
            return
        share = 1 - self.side * segment.turn * self.radius / abs(segment.begin - segment.centre)
        if share <= 0:
            raise LineError("an arc inside whose radius is not greater than that of the tool")
        segment.start = segment.centre + (segment.begin - segment.centre) * share
        segment.stop = segment.centre + (segment.end - segment.centre) * share

    def _enter(self, segment: Segment) -> None:
        """Begins the first motion at the tip of the tool. Raises LineError if it is too short."""
        far = segment.end if segment.centre is None else segment.centre
        if abs(segment.begin - far) <= self.radius:
            raise LineError(_SHORT)
        segment.start = self.tip
        if segment.centre is None:
            return
        # The centre is on the line from its end to its centre, at the same distance from both ends.
        inward = (segment.centre - segment.stop) / abs(segment.centre - segment.stop)
        chord = self.tip - segment.stop
        along = (chord * inward.conjugate()).real
        if along <= _SAME:
            raise LineError(
                "the first motion with G41 or G42 is an arc that the tool cannot come to"
            )
        segment.centre = segment.stop + inward * (abs(chord) ** 2 / (2 * along))

    def _join(self, old: Segment, new: Segment) -> None:
        """Joins two motions: on an arc about an outer corner, or at the crossing of both."""
        before, after = old.heading(True), new.heading(False)
        turned = cmath.phase(after / before) * self.side
        if _STRAIGHT < turned < math.pi - _STRAIGHT:
            old.stop = new.start = self._cross(old, new)
            self.flush()
        elif not -_STRAIGHT <= turned <= _STRAIGHT and abs(new.start - old.stop) > _SAME:
            heights = [item.height for item in (old, *self.pending) if isinstance(item, Segment)]
            self.flush()
            around = Segment(
                old.end, old.end, old.end, -self.side, heights[-1], new.speed, new.line,
                start=self.tip, stop=new.start,
            )  # fmt: skip
            self.write(around)
            self.tip = new.start
        else:
            new.start = old.stop
            self.flush()

    def _cross(self, old: Segment, new: Segment) -> complex:
        corner = new.begin
        crossings = [point for point in _crossings(old, new) if abs(point - corner) < 1e6]
        if not crossings:
            raise LineError("a corner inside that the tool does not reach")
        best = min(crossings, key=lambda point: abs(point - corner))
        # LinuxCNC does not examine the first motion.
        if self.is_first:
            return best
        if old.centre is None:
            reached = ((best - old.start) * old.heading(False).conjugate()).real >= -_SAME
        else:
            reached = _swept(old, best) <= (_swept(old, old.stop) or math.tau) + _SAME
        if not reached:
            raise LineError(
                "a corner inside that the tool cannot reach without cutting into the path"
            )
        return best

    def flush(self) -> None:
        """Writes the last motion and the instructions that follow it."""
        last, self.last = self.last, None
        if last is None:
            return
        self.write(last)
        self.tip, self.is_first = last.stop, False
        for item in self.pending:
            if isinstance(item, Segment):
                item.start = item.stop = self.tip
                self.write(item)
            else:
                self.keep(*item)
        self.pending.clear()


def _swept(arc: Segment, end: complex) -> float:
    """The angle along an arc from its start to ``end``, rad."""
    assert arc.centre is not None
    return cmath.phase((end - arc.centre) / (arc.start - arc.centre)) * arc.turn % math.tau


def _crossings(old: Segment, new: Segment) -> list[complex]:
    if old.centre is None and new.centre is None:
        a, d, b, e = old.stop, old.heading(True), new.start, new.heading(False)
        cross = (d.conjugate() * e).imag
        return [] if abs(cross) < _SAME else [a + d * (((b - a).conjugate() * e).imag / cross)]
    if old.centre is None or new.centre is None:
        line, arc = (old, new) if old.centre is None else (new, old)
        assert arc.centre is not None
        # The first motion has no offset at its start.
        through = line.stop if line is old else line.start
        return _of_line(through, line.heading(False), arc.centre, abs(arc.start - arc.centre))
    return _of_circles(
        old.centre, abs(old.start - old.centre), new.centre, abs(new.start - new.centre)
    )


def _of_line(a: complex, d: complex, centre: complex, radius: float) -> list[complex]:
    along = ((centre - a) * d.conjugate()).real
    foot = a + d * along
    rest = radius * radius - abs(centre - foot) ** 2
    if rest < -1e-9:
        return []
    half = math.sqrt(max(rest, 0.0))
    return [foot + d * half, foot - d * half]


def _of_circles(a: complex, r: float, b: complex, s: float) -> list[complex]:
    distance = abs(b - a)
    if distance < _SAME:
        return []
    along = (distance * distance + r * r - s * s) / (2 * distance)
    rest = r * r - along * along
    if rest < -1e-9:
        return []
    d = (b - a) / distance
    half = math.sqrt(max(rest, 0.0))
    return [a + d * along + d * 1j * half, a + d * along - d * 1j * half]


def place(point: complex, height: float, axes: tuple[int, int, int]) -> Vec3:
    """The coordinates of a point of the plane at a height, mm."""
    end = [0.0, 0.0, 0.0]
    end[axes[0]], end[axes[1]], end[axes[2]] = point.real, point.imag, height
    return (end[0], end[1], end[2])
