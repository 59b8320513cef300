"""Motions that are no lines, arcs or holes: splines, threads, taps, back bores and probes."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from itertools import pairwise

from camgen.lang.gcode.machine import Handler, Machine
from camgen.lang.gcode.motion import target
from camgen.lang.gcode.words import LineError
from camgen.model.pose import Vec3

#: Points of a spline at most; it is divided until its lines are within the tolerance of helices.
_POINTS = 512
Vec2 = tuple[float, float]


def _feed(m: Machine, points: Sequence[Vec3], speed: float) -> None:
    m.start()
    m.pieces([(None, point) for point in points], speed)


def _spline(m: Machine, code: str, words: dict[str, float]) -> None:
    """G5, a cubic curve of Bezier by I J and P Q; G5.1, a square one by I J. In X and Y, as LinuxCNC has them."""
    if m.plane != "G17":
        raise LineError(f"{code} outside the plane of X and Y (G17)")
    m.insist_on_feed(code)
    x0, y0, z0 = m.here()
    offsets = {letter: words.pop(letter) * m.scale for letter in "IJPQ" if letter in words}
    first = (offsets.get("I"), offsets.get("J"))
    last = (offsets.get("P"), offsets.get("Q"))
    x1, y1, _ = end = target(m, words)
    if code == "G5.1":
        if first == (None, None):
            raise LineError("G5.1 without I and J")
        a = (x0 + (first[0] or 0.0), y0 + (first[1] or 0.0))
        points = [(x0, y0), a, (x1, y1)]
    else:
        if None in last:
            raise LineError("G5 without P and Q")
        if first == (None, None):
            if m.going_on is None:
                raise LineError("G5 without I and J behind what is no spline")
            first = m.going_on
        points = [
            (x0, y0),
            (x0 + (first[0] or 0.0), y0 + (first[1] or 0.0)),
            (x1 + (last[0] or 0.0), y1 + (last[1] or 0.0)),
            (x1, y1),
        ]
        m.going_on = (-(last[0] or 0.0), -(last[1] or 0.0))
    curve = _bezier(points)
    _feed(m, _divide(m, curve, z0, end[2]), m.feed)


def _bezier(points: Sequence[Vec2]) -> Callable[[float], Vec2]:
    def at(t: float) -> Vec2:
        row = list(points)
        while len(row) > 1:
            row = [(a[0] + (b[0] - a[0]) * t, a[1] + (b[1] - a[1]) * t) for a, b in pairwise(row)]
        return row[0]

    return at


def _divide(m: Machine, curve: Callable[[float], Vec2], low: float, high: float) -> list[Vec3]:
    """Points along a curve, between which lines leave it by no more than those of a helix."""
    count = 8
    while count < _POINTS:
        gap = 0.0
        for k in range(count):
            a, b, c = (curve((k + part) / count) for part in (0.0, 0.5, 1.0))
            gap = max(gap, math.dist(b, ((a[0] + c[0]) / 2, (a[1] + c[1]) / 2)))
        if gap <= m.limits.helix:
            break
        count *= 2
    return [(*curve(k / count), low + (high - low) * k / count) for k in range(1, count + 1)]


def _knots(m: Machine, code: str, words: dict[str, float]) -> None:
    """G5.2 begins a NURBS and gathers its control points with their weights P; G5.3 draws it."""
    if code == "G5.2":
        weight = words.pop("P", 0.0)
        if weight <= 0:
            raise LineError("G5.2 without a weight (P) above 0")
        order = int(words.pop("L", 3.0))
        if not m.control:
            m.control.append(((m.at[0], m.at[1]), weight))
            m.order = max(order, 3)
        if "X" in words or "Y" in words:
            end = target(m, words)
            m.control.append(((end[0], end[1]), weight))
        return
    if len(m.control) < m.order:
        m.control.clear()
        raise LineError("G5.3 after fewer points than the order of the curve (L)")
    m.insist_on_feed(code)
    curve = _nurbs(m.control, m.order)
    m.control.clear()
    m.motion = "G1"
    _feed(m, _divide(m, curve, m.at[2], m.at[2]), m.feed)


def _nurbs(control: Sequence[tuple[Vec2, float]], order: int) -> Callable[[float], Vec2]:
    """The curve over clamped, even knots."""
    points, count = list(control), len(control)
    knots = (
        [0.0] * order
        + [float(k) for k in range(1, count - order + 1)]
        + [float(count - order + 1)] * order
    )

    def at(t: float) -> Vec2:
        u = t * (count - order + 1)
        span = min(max(k for k in range(order - 1, count) if knots[k] <= u), count - 1)
        row = [(p[0] * w, p[1] * w, w) for p, w in points[span - order + 1 : span + 1]]
        for level in range(1, order):
            for j in range(order - 1, level - 1, -1):
                low, high = knots[span - order + 1 + j], knots[span + 1 + j - level]
                part = (u - low) / (high - low) if high > low else 0.0
                row[j] = tuple(
                    a * (1 - part) + b * part for a, b in zip(row[j - 1], row[j], strict=True)
                )  # type: ignore[assignment]
        x, y, w = row[order - 1]
        return x / w, y / w

    return at


def _turns(m: Machine, code: str) -> float:
    """Turns per second, which threads need."""
    if m.spindle == "M5" or not m.speed:
        m.log.find("refused", f"{code} while the spindle stands")
        return 1.0
    return m.speed / 60.0


def _thread(m: Machine, code: str, words: dict[str, float]) -> None:
    """G33 K: with the spindle, K mm per turn. G33.1: there and back."""
    pitch = (
        abs(words.pop("K")) * m.scale
        if "K" in words
        else m.feed * (1.0 if m.feed_mode == "G95" else 60.0)
    )
    if not pitch:
        raise LineError(f"{code} without its pitch (K)")
    begin, end = m.here(), target(m, words)
    speed = pitch * _turns(m, code)
    there = (end[0], end[1], end[2])
    _feed(m, [there] if code == "G33" else [there, begin], speed)


def _threads(m: Machine, code: str, words: dict[str, float]) -> None:
    """G76 of LinuxCNC: passes of a thread, as its interpreter cuts them."""
    w = {letter: words.pop(letter, 0.0) for letter in "IJKPQRHEL"}
    pitch, first, full, peak = (w[letter] * m.scale for letter in "PJKI")
    if pitch <= 0 or first <= 0 or full <= first:
        raise LineError(
            "G76 without a pitch (P), or with a first depth (J) that is not below the last (K)"
        )
    if m.plane != "G18":
        raise LineError("G76 outside the plane of X and Z (G18)")
    x0, y0, z0 = m.here()
    z1 = target(m, words)[2]
    speed, side = pitch * _turns(m, code), 1.0 if peak > 0 else -1.0
    m.start()
    depths: list[float] = []
    power = 1.0 / max(w["R"], 1.0)
    while first * (len(depths) + 1) ** power < full and len(depths) < m.bounds.gcode_pieces:
        depths.append(first * (len(depths) + 1) ** power)
    tangent, taper, ends = math.tan(math.radians(w["Q"])), w["E"] * m.scale, int(w["L"])
    bottom = z1 + full * tangent if z1 < z0 else z1 - full * tangent
    for depth in [*depths, full, *[full] * min(int(w["H"]), 100)]:
        back = depth * tangent if z1 < z0 else -depth * tangent
        clear, cut = x0 + side * (depth - full), x0 + side * (abs(peak) + depth)
        out = cut - side * full
        toward = taper if z1 < z0 else -taper
        _go(m, (clear, y0, z0 - back))
        if taper and ends & 1:
            _feed(m, [(out, y0, z0 - back), (cut, y0, z0 - back - toward)], speed)
        else:
            _go(m, (cut, y0, z0 - back))
        if taper and ends & 2:
            _feed(m, [(cut, y0, bottom - back + toward), (out, y0, bottom - back)], speed)
        else:
            _feed(m, [(cut, y0, bottom - back)], speed)
        _go(m, (clear, y0, bottom - back))
    _go(m, (x0, y0, bottom - full * tangent if z1 < z0 else bottom + full * tangent))


def _go(m: Machine, end: Vec3) -> None:
    if list(end) != m.at:
        m.rapid(end, (0, 1, 2))


def _probe(m: Machine, code: str, words: dict[str, float]) -> None:
    """To its end: how far it goes is not in the text."""
    end = target(m, words)
    m.insist_on_feed(code)
    m.assume(
        f"{code}: the probe runs to its end", "probe", 1.0, "where it touches is not in the text"
    )
    _feed(m, [(end[0], end[1], end[2])], m.feed)
    for k in range(3):
        m.homes[str(5061 + k)] = (m.at[k] - m.shift[k]) / m.scale
    m.homes["5070"] = m.given.get("probe", 1.0)


TRACED: dict[str, Handler] = {
    "G5": _spline, "G5.1": _spline, "G5.2": _knots, "G5.3": _knots, "G33": _thread, "G33.1": _thread, "G76": _threads,
    "G38.2": _probe, "G38.3": _probe, "G38.4": _probe, "G38.5": _probe,
}  # fmt: skip
