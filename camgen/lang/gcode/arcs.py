"""Arcs of G2 and G3: arcs of at most half a circle, and short lines along helices."""

from __future__ import annotations

import math
from typing import NamedTuple

from msgspec import Struct
from msgspec.structs import replace

from camgen.lang.gcode.words import LineError
from camgen.model.limits import Limits as Bounds
from camgen.model.limits import format_limit
from camgen.model.pose import Vec3

Vec2 = tuple[float, float]

#: First axis, second axis and normal of each plane; G3 turns from the first to the second.
PLANES = {"G17": (0, 1, 2), "G18": (2, 0, 1), "G19": (1, 2, 0)}
#: rad: an end point nearer to the start is a full turn, as in LinuxCNC and GRBL.
NO_ANGLE = 1e-6
#: A half circle whose rounded points reach further by this stays one arc: mm along it, at most rad.
#: With two decimals, each of its ends is off by 0.005 mm and its centre too.
OVER_MM, OVER_RAD = 0.03, 0.1

#: Via point, None for a line, and end point.
Piece = tuple[Vec3 | None, Vec3]


class Limits(Struct, frozen=True):
    """The arcs that a controller accepts.

    spiral: difference of the radii at start and end, mm: always accepted, always refused, and
        always accepted in inches. Between the first two 0.1 % of the radius is accepted.
    shorter: length, mm, by which R may be less than half the chord.
    least_radius: minimum radius, mm.
    turns: whether P counts turns.
    helix: deviation of the lines along a helix, mm.
    pieces: maximum number of pieces of an arc.
    """

    spiral: tuple[float, float, float]
    shorter: float
    least_radius: float
    turns: bool
    helix: float = 0.002
    pieces: float = Bounds().gcode_pieces

    def at_unit(self, unit: float) -> Limits:
        """The limits for a program in a unit, mm: `spiral` of inches is another one."""
        if unit == 1.0:
            return self
        accepted, refused, accepted_inch = self.spiral
        refused = refused * accepted_inch / accepted
        return replace(self, spiral=(accepted_inch, refused, accepted_inch))


#: LinuxCNC 2.9, from its source, and tried with its interpreter.
LINUXCNC = Limits(
    spiral=(0.02828, 2.83, 0.002828 * 25.4),
    shorter=0.00127,
    least_radius=0.00127,
    turns=True,
)


class Arc(NamedTuple):
    """An arc as a line states it.

    plane: G17, G18 or G19.
    code: G2 or G3.
    start, end: mm.
    words: I, J, K and R, mm, and P. `divide` removes the words that it uses.
    is_absolute: whether the centre is in absolute coordinates (G90.1).
    """

    plane: str
    code: str
    start: Vec3
    end: Vec3
    words: dict[str, float]
    is_absolute: bool = False


class _Circle(NamedTuple):
    """The circle of an arc in its plane.

    centre: mm.
    radii: radius at start and end, mm.
    begin: angle of the start, rad.
    sweep: angle of the arc, rad, counter-clockwise positive.
    """

    centre: Vec2
    radii: Vec2
    begin: float
    sweep: float

    def point(self, fraction: float) -> Vec2:
        """The point at a fraction of the sweep. The radius changes evenly."""
        radius = self.radii[0] + (self.radii[1] - self.radii[0]) * fraction
        angle = self.begin + self.sweep * fraction
        return self.centre[0] + radius * math.cos(angle), self.centre[1] + radius * math.sin(angle)


def divide(arc: Arc, limits: Limits, inch: bool) -> list[Piece]:
    """The pieces of an arc. Raises LineError for an arc that the controller refuses.

    inch: whether the program is in inches.
    """
    first, second, normal = PLANES[arc.plane]
    start, end, words = arc.start, arc.end, arc.words
    a, b = find_centre(arc, limits)
    words.pop("IJK"[first], None)
    words.pop("IJK"[second], None)
    begin = start[first] - a, start[second] - b
    finish = end[first] - a, end[second] - b
    radii = math.hypot(*begin), math.hypot(*finish)
    if words.pop("R", None) is None:
        _check_radii(radii, limits.at_unit(25.4 if inch else 1.0))
    angle = math.atan2(begin[1], begin[0])
    sweep = _sweep(arc.code, angle, math.atan2(finish[1], finish[0]), words.pop("P", 1.0), limits)
    margin = min(OVER_MM / max(radii), OVER_RAD)
    if start[normal] != end[normal]:
        return _cut_helix(arc, _Circle((a, b), radii, angle, sweep), limits)
    if abs(sweep) - margin > math.pi:
        circle = _Circle((a, b), radii, angle, sweep)
        return _cut_circle(arc, circle, (abs(sweep) - margin) / math.pi, limits)
    radius, middle = (radii[0] + radii[1]) / 2, angle + sweep / 2
    via = [start[normal]] * 3
    via[first], via[second] = a + radius * math.cos(middle), b + radius * math.sin(middle)
    return [((via[0], via[1], via[2]), end)]


def find_centre(arc: Arc, limits: Limits) -> Vec2:
    """The centre of an arc in its plane, mm. Raises LineError."""
    first, second, _ = PLANES[arc.plane]
    words = arc.words
    a, b = words.get("IJK"[first]), words.get("IJK"[second])
    if "R" in words:
        if a is not None or b is not None:
            raise LineError("R and a centre in one arc")
        return _centre_of_radius(arc, words["R"], limits)
    if a is None and b is None:
        raise LineError("arc without a centre or radius (I, J, K or R) in its plane")
    if arc.is_absolute:
        if a is None or b is None:
            raise LineError("an absolute centre (G90.1) needs both its words")
        return a, b
    return arc.start[first] + (a or 0.0), arc.start[second] + (b or 0.0)


def _centre_of_radius(arc: Arc, radius: float, limits: Limits) -> Vec2:
    """The centre of an arc with R: up to half a circle if it is positive, else the larger arc."""
    first, second, _ = PLANES[arc.plane]
    a0, b0 = arc.start[first], arc.start[second]
    a1, b1 = arc.end[first], arc.end[second]
    half = math.hypot(a1 - a0, b1 - b0) / 2
    if half == 0:
        raise LineError("arc with R whose end is its start")
    if half - abs(radius) > limits.shorter:
        raise LineError(f"R{radius:g} does not reach the end point")
    height = math.sqrt(max(0.0, radius * radius - half * half))
    # The centre of a short counter-clockwise arc lies to the left of its chord.
    side = height if (arc.code == "G3") == (radius > 0) else -height
    a = (a0 + a1) / 2 - side * (b1 - b0) / (2 * half)
    return a, (b0 + b1) / 2 + side * (a1 - a0) / (2 * half)


def _check_radii(radii: Vec2, limits: Limits) -> None:
    accepted, refused, _ = limits.spiral
    if min(radii) < limits.least_radius:
        raise LineError("arc of no radius")
    start, end = radii
    difference = abs(start - end)
    if difference > refused or (difference > accepted and difference > 0.001 * max(radii)):
        raise LineError(
            f"the radii of the arc differ by {difference:.4f} mm (start {start:.4f}, end {end:.4f})"
        )


def _sweep(code: str, begin: float, finish: float, turns: float, limits: Limits) -> float:
    """The angle of an arc, rad, counter-clockwise positive. Raises LineError.

    begin, finish: angles of start and end, rad.
    turns: value of P.
    """
    if turns != 1 and not limits.turns:
        raise LineError(f"P{turns:g} has no meaning in an arc")
    if turns < 1 or turns != int(turns):
        raise LineError(f"P{turns:g} is not a number of turns")
    turn = (finish - begin if code == "G3" else begin - finish) % (2 * math.pi)
    if turn < NO_ANGLE:
        turn += 2 * math.pi
    turn += 2 * math.pi * (turns - 1)
    return turn if code == "G3" else -turn


def _cut_helix(arc: Arc, circle: _Circle, limits: Limits) -> list[Piece]:
    step = 2 * math.acos(max(0.0, 1 - limits.helix / max(circle.radii)))
    count = _count(abs(circle.sweep) / step, limits.pieces)
    points = [_place(arc, circle.point(k / count), k / count) for k in range(1, count)]
    return [(None, point) for point in [*points, arc.end]]


def _cut_circle(arc: Arc, circle: _Circle, halves: float, limits: Limits) -> list[Piece]:
    """An arc as several.

    halves: its angle in half turns.
    """
    count = _count(halves, limits.pieces)
    points = [_place(arc, circle.point(k / count), k / count) for k in range(1, count)]
    vias = [_place(arc, circle.point((k + 0.5) / count), (k + 0.5) / count) for k in range(count)]
    return list(zip(vias, [*points, arc.end], strict=True))


def _place(arc: Arc, point: Vec2, fraction: float) -> Vec3:
    """A point of the plane of an arc, at a fraction of the way along its normal, mm."""
    first, second, normal = PLANES[arc.plane]
    place = [0.0, 0.0, 0.0]
    place[first], place[second] = point
    place[normal] = arc.start[normal] + (arc.end[normal] - arc.start[normal]) * fraction
    return (place[0], place[1], place[2])


def _count(number: float, limit: float) -> int:
    """The number of pieces. Raises LineError if there are too many."""
    if number > limit:
        raise LineError(
            f"an arc of more than {format_limit(limit)} pieces is refused (limits.gcode_pieces)"
        )
    return max(1, math.ceil(number))
