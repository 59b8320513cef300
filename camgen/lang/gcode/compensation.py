"""Cutter compensation (G41, G42): the path beside the programmed one by the radius of the tool, as LinuxCNC runs it.

A corner outside is rounded about its point; inside the paths are cut at their crossing. Hence a motion is written down
when the next one is known. In a plane: X and Y, or X and Z.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Callable
from dataclasses import dataclass, field

from camgen.lang.gcode.words import LineError
from camgen.model.pose import Vec3
from camgen.model.program import Instruction

#: Corners that turn by less are none, as in LinuxCNC, and so are those inside that turn nearly back. rad.
_STRAIGHT = 0.05
_SAME = 1e-9


@dataclass(slots=True)
class Segment:
    """A motion in the plane. begin, end: programmed; start, stop: of the tool. centre: None for a line. turn: 1 to the
    left, -1 to the right. height: where it ends along the normal. speed: mm/s, None for a rapid motion.
    """

    begin: complex
    end: complex
    start: complex
    stop: complex
    centre: complex | None
    turn: int
    height: float
    speed: float | None
    line: int

    def heading(self, at_end: bool) -> complex:
        """Its direction at one end, of length 1."""
        if self.centre is None:
            way = self.end - self.begin
        else:
            way = ((self.end if at_end else self.begin) - self.centre) * (1j * self.turn)
        return way / abs(way)


@dataclass(slots=True)
class Beside:
    """A path beside the programmed one. side: 1 left, -1 right. axes: of the plane and its normal. here: of the tool.
    write: takes a segment. keep: takes any other instruction and its line. last: the motion that is not written yet;
    entering: it is the first; behind: what comes at its end, ways along the normal or instructions with their line.
    """

    side: int
    radius: float
    axes: tuple[int, int, int]
    here: complex
    write: Callable[[Segment], None]
    keep: Callable[[Instruction, int], None]
    last: Segment | None = None
    entering: bool = True
    behind: list[tuple[Instruction, int] | Segment] = field(default_factory=list)

    def move(self, begin: complex, end: complex, centre: complex | None, turn: int, height: float,
             speed: float | None, line: int) -> None:  # fmt: skip
        """The next motion. LineError where the tool has no way."""
        one = Segment(begin, end, begin, end, centre, turn, height, speed, line)
        if centre is None and abs(end - begin) < _SAME:
            self._climb(one)
            return
        self._set_off(one)
        if self.last is None:
            self._enter(one)
        else:
            self._join(self.last, one)
        self.last = one

    def _climb(self, one: Segment) -> None:
        """Along the normal alone."""
        if self.last is None:
            raise LineError(
                "the first motion with G41 or G42 is not longer than the radius of the tool"
            )
        self.behind.append(one)

    def _set_off(self, one: Segment) -> None:
        """Both its ends beside the path."""
        if one.centre is None:
            aside = one.heading(False) * (1j * self.side * self.radius)
            one.start, one.stop = one.begin + aside, one.end + aside
            return
        share = 1 - self.side * one.turn * self.radius / abs(one.begin - one.centre)
        if share <= 0:
            raise LineError("an arc inside whose radius is not greater than that of the tool")
        one.start = one.centre + (one.begin - one.centre) * share
        one.stop = one.centre + (one.end - one.centre) * share

    def _enter(self, one: Segment) -> None:
        """The first motion comes from where the tool is to beside its end."""
        reach = abs(one.end - one.begin) if one.centre is None else abs(one.begin - one.centre)
        if reach <= self.radius:
            raise LineError(
                "the first motion with G41 or G42 is not longer than the radius of the tool"
            )
        one.start = self.here
        if one.centre is None:
            return
        # About a point on the line from its end to its centre, as far from where the tool is as from that end.
        inward = (one.centre - one.stop) / abs(one.centre - one.stop)
        chord = self.here - one.stop
        along = (chord * inward.conjugate()).real
        if along <= _SAME:
            raise LineError(
                "the first motion with G41 or G42 is an arc that the tool cannot come to"
            )
        one.centre = one.stop + inward * (abs(chord) ** 2 / (2 * along))

    def _join(self, old: Segment, new: Segment) -> None:
        """From one motion to the next: about the corner, or cut at the crossing."""
        before, after = old.heading(True), new.heading(False)
        turned = cmath.phase(after / before) * self.side
        if _STRAIGHT < turned < math.pi - _STRAIGHT:
            old.stop = new.start = self._cross(old, new)
            self.flush()
        elif not -_STRAIGHT <= turned <= _STRAIGHT and abs(new.start - old.stop) > _SAME:
            height = self._height(old)
            self.flush()
            around = Segment(
                old.end,
                old.end,
                self.here,
                new.start,
                old.end,
                -self.side,
                height,
                new.speed,
                new.line,
            )
            self.write(around)
            self.here = new.start
        else:
            new.start = old.stop
            self.flush()

    def _height(self, old: Segment) -> float:
        heights = [item.height for item in self.behind if isinstance(item, Segment)]
        return heights[-1] if heights else old.height

    def _cross(self, old: Segment, new: Segment) -> complex:
        """Where the paths beside two motions meet, near their corner."""
        corner = new.begin
        found = [p for p in _crossings(old, new) if abs(p - corner) < 1e6]
        if not found:
            raise LineError("a corner inside that the tool does not reach")
        best = min(found, key=lambda p: abs(p - corner))
        if self.entering:
            return best  # LinuxCNC asks nothing of the way onto the path
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
        """Writes down the motion that waits, and what comes at its end."""
        if self.last is None:
            return
        self.write(self.last)
        self.here, self.entering = self.last.stop, False
        for item in self.behind:
            if isinstance(item, Segment):
                item.start = item.stop = self.here
                self.write(item)
            else:
                self.keep(*item)
        self.behind.clear()
        self.last = None


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
        through = line.stop if line is old else line.start  # the first motion begins beside nothing
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
    apart = abs(b - a)
    if apart < _SAME:
        return []
    along = (apart * apart + r * r - s * s) / (2 * apart)
    rest = r * r - along * along
    if rest < -1e-9:
        return []
    d = (b - a) / apart
    return [
        a + d * along + d * 1j * half
        for half in (math.sqrt(max(rest, 0.0)), -math.sqrt(max(rest, 0.0)))
    ]


def place(point: complex, height: float, axes: tuple[int, int, int]) -> Vec3:
    """A point of the plane at a height, as coordinates."""
    end = [0.0, 0.0, 0.0]
    end[axes[0]], end[axes[1]], end[axes[2]] = point.real, point.imag, height
    return (end[0], end[1], end[2])
