"""G2 and G3 as arcs of at most half a circle, helices as short lines: for the interpreter and for read-backs alike."""

from __future__ import annotations

import math

from msgspec import Struct

from camgen.lang.gcode.words import LineError
from camgen.model.limits import Limits as Bounds
from camgen.model.limits import tell
from camgen.model.pose import Vec3

Vec2 = tuple[float, float]

#: First axis, second axis and normal of each plane; G3 turns from the first to the second.
_PLANES = {"G17": (0, 1, 2), "G18": (2, 0, 1), "G19": (1, 2, 0)}
#: An end point nearer to the start than this angle is a full turn, as in both controllers. rad.
NO_ANGLE = 1e-6
#: A half circle whose rounded points reach further by this stays one arc: mm along it, at most rad.
#: With two decimals, each of its ends is off by 0.005 mm and its centre too.
OVER_MM, OVER_RAD = 0.03, 0.1

#: Via point, None for a line, and end point.
Piece = tuple[Vec3 | None, Vec3]


class Limits(Struct, frozen=True):
    """What a controller accepts as an arc.

    spiral: by how much the radii may differ at least, at most (mm), and at least in a program in inches; between the
    two 0.1 % of the radius counts. shorter: by how much R may be less than half the chord, mm. least_radius: mm. turns:
    whether P counts turns. helix: by how much the lines that a helix becomes may leave it, mm. pieces: what an arc
    may become at most.
    """

    spiral: tuple[float, float, float]
    shorter: float
    least_radius: float
    turns: bool
    helix: float = 0.002
    pieces: float = Bounds().gcode_pieces


#: Of LinuxCNC 2.9, from its source and tried with its interpreter.
LINUXCNC = Limits(
    spiral=(0.02828, 2.83, 0.002828 * 25.4),
    shorter=0.00127,
    least_radius=0.00127,
    turns=True,
)


def pieces(plane: str, code: str, start: Vec3, end: Vec3, words: dict[str, float], absolute: bool, inch: bool,
           limits: Limits) -> list[Piece]:  # fmt: skip
    """The arc from ``start`` to ``end`` (mm). words: I J K R in mm and P, taken out when used. Raises LineError."""
    first, second, normal = axes = _PLANES[plane]
    a0, b0, a1, b1 = start[first], start[second], end[first], end[second]
    offsets = (words.pop("IJK"[first], None), words.pop("IJK"[second], None))
    radius = words.pop("R", None)
    if radius is None:
        a, b = _centre(offsets, (a0, b0), absolute)
    elif offsets == (None, None):
        a, b = _centre_of(code, a0, b0, a1, b1, radius, limits)
    else:
        raise LineError("R and a centre in one arc")
    r0, r1 = math.hypot(a0 - a, b0 - b), math.hypot(a1 - a, b1 - b)
    if radius is None:
        _check_radii(r0, r1, inch, limits)
    begin = math.atan2(b0 - b, a0 - a)
    sweep = _sweep(code, begin, math.atan2(b1 - b, a1 - a), words.pop("P", 1.0), limits)
    rise = end[normal] - start[normal]
    if rise or abs(sweep) - min(OVER_MM / max(r0, r1), OVER_RAD) > math.pi:
        return _divide(axes, start, end, (a, b), (r0, r1, begin, sweep), limits)
    r, angle = (r0 + r1) / 2, begin + sweep / 2
    point = [start[normal]] * 3
    point[first], point[second] = a + r * math.cos(angle), b + r * math.sin(angle)
    return [((point[0], point[1], point[2]), end)]


def find_centre(plane: str, code: str, start: Vec3, end: Vec3, words: dict[str, float], absolute: bool,
                limits: Limits) -> tuple[float, float]:  # fmt: skip
    """The centre of the arc of ``pieces``, in its plane. Raises LineError."""
    first, second, _ = _PLANES[plane]
    if "R" in words:
        return _centre_of(
            code, start[first], start[second], end[first], end[second], words["R"], limits
        )
    return _centre(
        (words.get("IJK"[first]), words.get("IJK"[second])), (start[first], start[second]), absolute
    )


def _centre(
    offsets: tuple[float | None, float | None], start: tuple[float, float], absolute: bool
) -> Vec2:
    first, second = offsets
    if first is None and second is None:
        raise LineError("arc without a centre or radius (I, J, K or R) in its plane")
    if absolute:
        if first is None or second is None:
            raise LineError("an absolute centre (G90.1) needs both its words")
        return first, second
    return start[0] + (first or 0.0), start[1] + (second or 0.0)


def _centre_of(
    code: str, a0: float, b0: float, a1: float, b1: float, radius: float, limits: Limits
) -> Vec2:
    """The centre of the arc of ``radius``: up to half a circle where positive, the larger one where negative."""
    half = math.hypot(a1 - a0, b1 - b0) / 2
    if half == 0:
        raise LineError("arc with R whose end is its start")
    if half - abs(radius) > limits.shorter:
        raise LineError(f"R{radius:g} does not reach the end point")
    away = math.sqrt(max(0.0, radius * radius - half * half))
    # The centre of a short counter-clockwise arc lies to the left of its chord.
    side = away if (code == "G3") == (radius > 0) else -away
    return (a0 + a1) / 2 - side * (b1 - b0) / (2 * half), (b0 + b1) / 2 + side * (a1 - a0) / (
        2 * half
    )


def _check_radii(start: float, end: float, inch: bool, limits: Limits) -> None:
    least, most, least_inch = limits.spiral
    if inch:
        least, most = least_inch, most * least_inch / least
    if min(start, end) < limits.least_radius:
        raise LineError("arc of no radius")
    differ = abs(start - end)
    if differ > most or (differ > least and differ > 0.001 * max(start, end)):
        raise LineError(
            f"the radii of the arc differ by {differ:.4f} mm (start {start:.4f}, end {end:.4f})"
        )


def _sweep(code: str, begin: float, finish: float, turns: float, limits: Limits) -> float:
    """The signed angle, counter-clockwise positive."""
    if turns != 1 and not limits.turns:
        raise LineError(f"P{turns:g} has no meaning in an arc")
    if turns < 1 or turns != int(turns):
        raise LineError(f"P{turns:g} is no number of turns")
    turn = (finish - begin if code == "G3" else begin - finish) % (2 * math.pi)
    if turn < NO_ANGLE:
        turn += 2 * math.pi
    turn += 2 * math.pi * (turns - 1)
    return turn if code == "G3" else -turn


def _divide(
    axes: tuple[int, int, int],
    start: Vec3,
    end: Vec3,
    centre: Vec2,
    arc: tuple[float, float, float, float],
    limits: Limits,
) -> list[Piece]:
    """A helix as lines, a wide arc as several. arc: radii at start and end, angle at the start, sweep."""
    first, second, normal = axes
    (a, b), (r0, r1, begin, sweep) = centre, arc
    lift, radius = end[normal] - start[normal], max(r0, r1)

    def at(fraction: float) -> Vec3:
        """The point of the arc; between unequal radii the radius changes evenly."""
        point = [0.0, 0.0, 0.0]
        r, angle = r0 + (r1 - r0) * fraction, begin + sweep * fraction
        point[first], point[second] = a + r * math.cos(angle), b + r * math.sin(angle)
        point[normal] = start[normal] + lift * fraction
        return (point[0], point[1], point[2])

    if lift:
        step = 2 * math.acos(max(0.0, 1 - limits.helix / radius))
        count = _count(abs(sweep) / step, limits.pieces)
        return [*((None, at(i / count)) for i in range(1, count)), (None, end)]
    count = _count((abs(sweep) - min(OVER_MM / radius, OVER_RAD)) / math.pi, limits.pieces)
    ends = [*(at(i / count) for i in range(1, count)), end]
    return [(at((i + 0.5) / count), point) for i, point in enumerate(ends)]


def _count(number: float, most: float) -> int:
    if number > most:
        raise LineError(
            f"an arc of more than {tell(most)} pieces cannot be meant (limits.gcode_pieces)"
        )
    return max(1, math.ceil(number))
