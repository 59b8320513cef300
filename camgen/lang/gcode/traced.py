"""Motions other than lines, arcs and holes: splines, threads and probes."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from itertools import pairwise

from camgen.lang.gcode.machine import Handler, Machine
from camgen.lang.gcode.motion import target
from camgen.lang.gcode.words import LineError, take_whole
from camgen.model.pose import Vec3

#: Maximum number of lines of a spline. It is divided until its lines keep the tolerance of helices.
_MAX_LINES = 512
Vec2 = tuple[float, float]


def _feed(m: Machine, points: Sequence[Vec3], speed: float) -> None:
    m.start()
    m.pieces([(None, point) for point in points], speed)


def _spline(m: Machine, code: str, words: dict[str, float]) -> None:
    """G5 and G5.1 of LinuxCNC: a cubic Bezier curve (I J P Q) or a quadratic one (I J) in X and Y.

    Raises LineError for another plane and for missing words.
    """
    if m.plane != "G17":
        raise LineError(f"{code} outside the plane of X and Y (G17)")
    m.assume_feed(code)
    x0, y0, z0 = m.position()
    letters = "IJ" if code == "G5.1" else "IJPQ"
    offsets = {letter: words.pop(letter) * m.scale for letter in letters if letter in words}
    first = (offsets.get("I"), offsets.get("J"))
    last = (offsets.get("P"), offsets.get("Q"))
    x1, y1, _ = end = target(m, words)
    if code == "G5.1":
        if first == (None, None):
            raise LineError("G5.1 without I and J")
        points = [(x0, y0), (x0 + (first[0] or 0.0), y0 + (first[1] or 0.0)), (x1, y1)]
    else:
        if None in last:
            raise LineError("G5 without P and Q")
        if first == (None, None):
            if m.going_on is None:
                raise LineError("G5 without I and J after a motion that is not a spline")
            first = m.going_on
        points = [
            (x0, y0),
            (x0 + (first[0] or 0.0), y0 + (first[1] or 0.0)),
            (x1 + (last[0] or 0.0), y1 + (last[1] or 0.0)),
            (x1, y1),
        ]
        m.going_on = (-(last[0] or 0.0), -(last[1] or 0.0))
    _feed(m, _divide(m, _bezier(points), z0, end[2]), m.feed)


def _bezier(points: Sequence[Vec2]) -> Callable[[float], Vec2]:
    def at(t: float) -> Vec2:
        row = list(points)
        while len(row) > 1:
            row = [(a[0] + (b[0] - a[0]) * t, a[1] + (b[1] - a[1]) * t) for a, b in pairwise(row)]
        return row[0]

    return at


def _divide(m: Machine, curve: Callable[[float], Vec2], low: float, high: float) -> list[Vec3]:
    """Points along a curve, such that the lines between them keep the tolerance of helices.

    low, high: height of the start and of the end, mm.
    """
    count = 8
    while count < _MAX_LINES:
        gap = 0.0
        for k in range(count):
            a, b, c = (curve((k + part) / count) for part in (0.0, 0.5, 1.0))
            gap = max(gap, math.dist(b, ((a[0] + c[0]) / 2, (a[1] + c[1]) / 2)))
        if gap <= m.limits.helix:
            break
        count *= 2
    return [(*curve(k / count), low + (high - low) * k / count) for k in range(1, count + 1)]


def _knots(m: Machine, code: str, words: dict[str, float]) -> None:
    """G5.2 collects control points of a NURBS curve with their weights (P). G5.3 runs the curve.

    Raises LineError for a weight that is not positive and for too few points.
    """
    if code == "G5.2":
        _add_knot(m, words)
        return
    if len(m.control) < m.order:
        m.control.clear()
        raise LineError("G5.3 after fewer points than the order of the curve (L)")
    m.assume_feed(code)
    curve = _nurbs(m.control, m.order)
    m.control.clear()
    m.motion = "G1"
    _feed(m, _divide(m, curve, m.at[2], m.at[2]), m.feed)


def _add_knot(m: Machine, words: dict[str, float]) -> None:
    """Adds the control point of a line. The first line adds the position of the tool before it.

    The rules are those of LinuxCNC's interpreter. Raises LineError.
    """
    weight, order = words.pop("P", 0.0), take_whole(words, "L", 3)
    has_end = "X" in words
    if has_end != ("Y" in words):
        raise LineError("a control point (G5.2) with one of X and Y")
    if weight <= 0:
        raise LineError("G5.2 without a weight (P) above 0")
    if m.control and not has_end:
        raise LineError("a second control point (G5.2) without X and Y")
    if not m.control:
        m.control.append(((m.at[0], m.at[1]), 1.0 if has_end else weight))
        m.order = 3
    m.order = order if order > 3 else m.order
    if has_end:
        x, y, _ = target(m, words)
        m.control.append(((x, y), weight))


def _nurbs(control: Sequence[tuple[Vec2, float]], order: int) -> Callable[[float], Vec2]:
    """The NURBS curve over clamped, uniform knots. Its parameter is from 0 to 1."""
    points, count = list(control), len(control)
    last = count - order + 1
    knots = [0.0] * order + [float(k) for k in range(1, last)] + [float(last)] * order

    def at(t: float) -> Vec2:
        u = t * last
        span = max(k for k in range(order - 1, count) if knots[k] <= u)
        row = [(p[0] * w, p[1] * w, w) for p, w in points[span - order + 1 : span + 1]]
        for level in range(1, order):
            for j in range(order - 1, level - 1, -1):
                low, high = knots[span - order + 1 + j], knots[span + 1 + j - level]
                part = (u - low) / (high - low) if high > low else 0.0
                (x0, y0, w0), (x1, y1, w1) = row[j - 1], row[j]
                row[j] = (
                    x0 * (1 - part) + x1 * part,
                    y0 * (1 - part) + y1 * part,
                    w0 * (1 - part) + w1 * part,
                )
        x, y, w = row[order - 1]
        return x / w, y / w

    return at


def _find_turns(m: Machine, code: str) -> float:
    """The spindle speed for a thread, turns/s. Adds a refusal if the spindle does not turn."""
    if m.spindle == "M5" or not m.speed:
        m.log.find("refused", f"{code} while the spindle stands")
        return 1.0
    return m.speed / 60.0


def _thread(m: Machine, code: str, words: dict[str, float]) -> None:
    """G33 and G33.1: a motion of K per turn of the spindle. G33.1 returns to its start.

    Raises LineError without a pitch.
    """
    if "K" in words:
        pitch = abs(words.pop("K")) * m.scale
    else:
        pitch = m.feed * m.feed_scale
    if not pitch:
        raise LineError(f"{code} without its pitch (K)")
    start = m.position()
    x, y, z = target(m, words)
    speed = pitch * _find_turns(m, code)
    _feed(m, [(x, y, z)] if code == "G33" else [(x, y, z), start], speed)


def _threads(m: Machine, code: str, words: dict[str, float]) -> None:
    """G76 of LinuxCNC: the passes of a thread as its interpreter runs them. Raises LineError."""
    springs, ends = take_whole(words, "H", 0), take_whole(words, "L", 0)
    w = {letter: words.pop(letter, 0.0) for letter in "IJKPQRE"}
    pitch, first, full, peak = (w[letter] * m.scale for letter in "PJKI")
    if pitch <= 0 or first <= 0 or full <= first:
        raise LineError(
            "G76 without a pitch (P), or with a first depth (J) that is not below the last (K)"
        )
    if m.plane != "G18":
        raise LineError("G76 outside the plane of X and Z (G18)")
    x0, y0, z0 = m.position()
    z1 = target(m, words)[2]
    speed, side = pitch * _find_turns(m, code), 1.0 if peak > 0 else -1.0
    m.start()
    depths: list[float] = []
    power = 1.0 / max(w["R"], 1.0)
    while first * (len(depths) + 1) ** power < full and len(depths) < m.bounds.gcode_pieces:
        depths.append(first * (len(depths) + 1) ** power)
    # The thread leads towards -Z, or towards +Z.
    along = -math.copysign(1.0, z1 - z0)
    tangent, taper = along * math.tan(math.radians(w["Q"])), along * w["E"] * m.scale
    bottom = z1 + full * tangent
    for depth in [*depths, full, *[full] * springs]:
        back = depth * tangent
        clear, cut = x0 + side * (depth - full), x0 + side * (abs(peak) + depth)
        out = cut - side * full
        m.move_rapidly((clear, y0, z0 - back))
        if taper and ends & 1:
            _feed(m, [(out, y0, z0 - back), (cut, y0, z0 - back - taper)], speed)
        else:
            m.move_rapidly((cut, y0, z0 - back))
        if taper and ends & 2:
            _feed(m, [(cut, y0, bottom - back + taper), (out, y0, bottom - back)], speed)
        else:
            _feed(m, [(cut, y0, bottom - back)], speed)
        m.move_rapidly((clear, y0, bottom - back))
    m.move_rapidly((x0, y0, bottom - full * tangent))


def _probe(m: Machine, code: str, words: dict[str, float]) -> None:
    """G38.2 to G38.5: the probe runs to the end of the line. The place of contact is not known."""
    x, y, z = target(m, words)
    m.assume_feed(code)
    m.assume(
        f"{code}: the probe runs to its end", "probe", 1.0, "where it touches is not in the text"
    )
    _feed(m, [(x, y, z)], m.feed)
    for k in range(3):
        m.homes[str(5061 + k)] = (m.at[k] - m.shift[k]) / m.scale
    m.homes["5070"] = m.given.get("probe", 1.0)


#: The handler of each motion code.
TRACED: dict[str, Handler] = {
    "G5": _spline,
    "G5.1": _spline,
    "G5.2": _knots,
    "G5.3": _knots,
    "G33": _thread,
    "G33.1": _thread,
    "G76": _threads,
    "G38.2": _probe,
    "G38.3": _probe,
    "G38.4": _probe,
    "G38.5": _probe,
}
