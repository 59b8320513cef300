"""Drilling cycles as the motions that they stand for (LinuxCNC manual, canned cycles).

The levels between holes are those of LinuxCNC's interpreter.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

from camgen.lang.gcode.arcs import PLANES
from camgen.lang.gcode.machine import AXES, Machine, take_axes
from camgen.lang.gcode.words import LineError
from camgen.model.limits import format_limit
from camgen.model.program import Stop, Wait

CYCLES = frozenset({"G73", "G74", "G81", "G82", "G83", "G84", "G85", "G86", "G87", "G88", "G89"})
#: mm above the last depth, at which a peck begins in LinuxCNC.
_AGAIN = 0.254


class _Hole(NamedTuple):
    """The levels of a hole along its axis.

    axis: 0, 1 or 2.
    retract: level R, mm.
    bottom: mm.
    clear: level of the rapid motion to the next hole, mm.
    """

    axis: int
    retract: float
    bottom: float
    clear: float


def drill(m: Machine, words: dict[str, float]) -> None:
    """Adds the holes of a line, and removes its words. Raises LineError."""
    normal = PLANES[m.plane][2]
    count = _keep_words(m, (AXES[normal], "R", *_NEEDS.get(m.motion, ())), words)
    m.assume_feed(m.motion)
    if m.feed_mode == "G93":
        raise LineError(f"{m.motion} with {m.feed_mode}: a cycle has a feed per minute here")
    m.start()
    if m.level is None:
        m.level = m.at[normal]
    _holes(m, normal, take_axes(m, words), count)


def _keep_words(m: Machine, needed: tuple[str, ...], words: dict[str, float]) -> int:
    """Keeps the modal words of a cycle and removes them from words. Returns the number of holes.

    Raises LineError.

    needed: letters that the cycle must have.
    """
    for letter in (*needed, *(_OPTIONAL if m.motion in _TAPS else "")):
        if letter in words:
            m.sticky[letter] = words.pop(letter) * (m.dialect.dwell if letter == "P" else m.scale)
    count = words.pop("L", 1.0)
    # L0 of Fanuc only keeps the words of the cycle.
    if count < 0 or (count == 0 and not m.dialect.increments) or count != int(count):
        raise LineError(f"L{count:g} is not a number of holes")
    if count > m.bounds.gcode_pieces:
        limit = format_limit(m.bounds.gcode_pieces)
        raise LineError(f"L{count:g}: more than {limit} holes are refused (limits.gcode_pieces)")
    for letter in needed:
        if letter not in m.sticky:
            raise LineError(f"{m.motion} without {letter}")
    return int(count)


#: Cycles that turn the spindle back or stop it, with words that they may have.
_TAPS = frozenset({"G74", "G84", "G87", "G88"})
_OPTIONAL = "PQIJK"
_NEEDS = {"G73": ("Q",), "G83": ("Q",), "G82": ("P",), "G86": ("P",), "G89": ("P",)}


def _holes(m: Machine, normal: int, words: dict[int, float], count: int) -> None:
    """Adds holes, each after the rapid motions to its level R. Raises LineError.

    words: positions or increments by axis, mm.
    """
    place, level = m.turned(list(m.at), True), m.level or 0.0
    retract, bottom = m.sticky["R"], m.sticky[AXES[normal]]
    if m.incremental:
        retract += level
        bottom += retract
    else:
        retract, bottom = retract + m.shift[normal], bottom + m.shift[normal]
        for axis, value in words.items():
            place[axis] = value + m.shift[axis]
    if retract < bottom:
        raise LineError(f"{m.motion} begins (R) below its end")
    if m.to_start is None and level > retract:
        m.assume(
            "a cycle retracts to R", why="the program says neither G98 nor G99; so does LinuxCNC"
        )
    hole = _Hole(normal, retract, bottom, max(level, retract) if m.to_start else retract)
    if level < retract:
        _move_rapid(m, normal, retract)
    height = max(m.at[normal], hole.clear)
    for _ in range(count):
        if m.incremental:
            _move_to_next_hole(m, place, words)
        place[normal] = height
        above = m.turned(list(place))
        if above != m.at:
            m.rapid(above)
        if height != retract:
            _move_rapid(m, normal, retract)
        _CYCLES[m.motion](m, hole)
        height = hole.clear


def _move_to_next_hole(m: Machine, place: list[float], words: dict[int, float]) -> None:
    """Changes `place` to that of the next hole by increments, or by polar increments."""
    if m.spun is None:
        for axis, value in words.items():
            place[axis] += value
        return
    x, y = place[0] - m.shift[0], place[1] - m.shift[1]
    r, turned = math.hypot(x, y) + m.spun[0] * m.scale, math.atan2(y, x) + math.radians(m.spun[1])
    place[0], place[1] = r * math.cos(turned) + m.shift[0], r * math.sin(turned) + m.shift[1]


def _move_rapid(m: Machine, axis: int, value: float) -> None:
    end = list(m.at)
    end[axis] = value
    m.rapid(end)


def _move_at_feed(m: Machine, axis: int, value: float) -> None:
    end = list(m.at)
    end[axis] = value
    m.pieces([(None, (end[0], end[1], end[2]))], speed_of(m))


def speed_of(m: Machine) -> float:
    """The speed of motions at feed, mm/s. A spindle that stands is refused with G95.

    Raises LineError with G93, which no cycle has.
    """
    if m.feed_mode == "G93":
        raise LineError("a cycle with G93: it has a feed per minute, or per turn")
    if m.feed_mode == "G94":
        return m.feed
    if not m.speed or m.spindle == "M5":
        m.log.find("refused", "a feed per turn (G95) while the spindle stands")
    return m.feed * (m.speed or 60.0) / 60.0


def _drill(m: Machine, hole: _Hole) -> None:
    """G81, G82 and G89: the last two wait at the bottom, and G89 retracts at feed."""
    _move_at_feed(m, hole.axis, hole.bottom)
    if m.motion != "G81":
        m.add(Wait(_seconds(m)))
    if m.motion == "G89":
        _move_at_feed(m, hole.axis, hole.clear)
    else:
        _move_rapid(m, hole.axis, hole.clear)


def _bore(m: Machine, hole: _Hole) -> None:
    _move_at_feed(m, hole.axis, hole.bottom)
    _move_at_feed(m, hole.axis, hole.retract)
    if hole.clear != hole.retract:
        _move_rapid(m, hole.axis, hole.clear)


def _stop(m: Machine, hole: _Hole) -> None:
    if m.spindle == "M5":
        raise LineError("G86 while the spindle stands")
    _move_at_feed(m, hole.axis, hole.bottom)
    m.add(Wait(_seconds(m)))
    turning, m.spindle = m.spindle, "M5"
    m.update_spindle()
    _move_rapid(m, hole.axis, hole.clear)
    m.spindle = turning
    m.update_spindle()


def _peck(m: Machine, hole: _Hole) -> None:
    step = m.sticky["Q"]
    if step <= 0:
        raise LineError(f"{m.motion} with pecks of Q{step:g}")
    count = math.ceil((hole.retract - hole.bottom) / step - 1e-9)
    if count > m.bounds.gcode_pieces:
        limit = format_limit(m.bounds.gcode_pieces)
        raise LineError(f"{m.motion} with more than {limit} pecks is refused (limits.gcode_pieces)")
    for peck in range(1, count):
        reached = hole.retract - peck * step
        _move_at_feed(m, hole.axis, reached)
        if m.motion == "G83":
            _move_rapid(m, hole.axis, hole.retract)
        _move_rapid(m, hole.axis, reached + _AGAIN)
    _move_at_feed(m, hole.axis, hole.bottom)
    _move_rapid(m, hole.axis, hole.clear)


def _seconds(m: Machine) -> float:
    seconds = m.sticky["P"]
    if seconds < 0:
        raise LineError(f"{m.motion} with a wait of P{seconds:g}")
    return seconds


def _tap(m: Machine, hole: _Hole) -> None:
    turning = m.spindle
    if turning != {"G84": "M3", "G74": "M4"}[m.motion]:
        m.log.find("refused", f"{m.motion} while the spindle stands or turns the other way")
    _move_at_feed(m, hole.axis, hole.bottom)
    m.spindle = "M3" if turning == "M4" else "M4"
    m.update_spindle()
    if m.sticky.get("P"):
        m.add(Wait(_seconds(m)))
    _move_at_feed(m, hole.axis, hole.clear)
    m.spindle = turning
    m.update_spindle()


def _by_hand(m: Machine, hole: _Hole) -> None:
    """G88 waits at the bottom for the operator, who retracts the tool."""
    _move_at_feed(m, hole.axis, hole.bottom)
    if m.sticky.get("P"):
        m.add(Wait(_seconds(m)))
    m.add(Stop())
    _move_rapid(m, hole.axis, hole.clear)


def _back_bore(m: Machine, hole: _Hole) -> None:
    """G87: down beside the hole, into it, up to K at feed, and back the same way."""
    middle_of_hole = list(m.at)
    aside = [
        value + m.sticky.get(letter, 0.0) * (k != hole.axis)
        for k, (value, letter) in enumerate(zip(middle_of_hole, "IJK", strict=True))
    ]
    top = m.sticky.get("IJK"[hole.axis], 0.0) + (
        hole.bottom if m.incremental else m.shift[hole.axis]
    )

    def move(*stops: tuple[list[float], float]) -> None:
        for place, height in stops:
            m.rapid([height if k == hole.axis else value for k, value in enumerate(place)])

    turning = m.spindle
    move((aside, hole.retract), (aside, hole.bottom), (middle_of_hole, hole.bottom))
    _move_at_feed(m, hole.axis, top)
    _move_at_feed(m, hole.axis, hole.bottom)
    move((aside, hole.bottom), (aside, hole.retract), (middle_of_hole, hole.retract))
    m.spindle = turning
    if hole.clear != hole.retract:
        _move_rapid(m, hole.axis, hole.clear)


#: The motions of a hole, by cycle.
_CYCLES: dict[str, Callable[[Machine, _Hole], None]] = {
    "G73": _peck, "G81": _drill, "G82": _drill, "G83": _peck, "G85": _bore, "G86": _stop,
    "G89": _drill, "G74": _tap, "G84": _tap, "G87": _back_bore, "G88": _by_hand,
}  # fmt: skip
