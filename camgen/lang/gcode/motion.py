"""Motions: from the words of a line to lines and arcs, and drilling cycles as the motions that they stand for."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np

from camgen.geometry.arcs import span_lengths
from camgen.lang.gcode.arcs import Arc, Piece, divide
from camgen.lang.gcode.machine import ARCS, AXES, RAPID, Machine, take_axes
from camgen.lang.gcode.words import LineError
from camgen.model.limits import tell
from camgen.model.pose import TOOL_DOWN, Pose, Vec3
from camgen.model.program import Instruction, MoveC, MoveJ, MoveL, Stop, Wait

CYCLES = frozenset({"G73", "G74", "G81", "G82", "G83", "G84", "G85", "G86", "G87", "G88", "G89"})
_CENTRES = "IJKR"


def move(m: Machine, code: str, words: dict[str, float]) -> None:
    """The motion of a line. code: its motion code, empty where the last one still holds. Takes out the words used."""
    if code and code != m.motion:
        m.sticky.clear()
        m.motion = code
    if m.motion not in CYCLES:
        m.level = None
    m.turn_axes(words, code)
    if m.trace(code, words):
        return
    polar(m, words)
    named = [axis for axis in AXES if axis in words]
    around = m.motion in ARCS and any(letter in words for letter in _CENTRES)
    if not named and not around and code not in CYCLES:
        m.stand(code)
        return
    if not m.motion:
        m.without_mode()
    m.settle(code, words, m.motion in CYCLES)
    if m.motion in CYCLES:
        drill(m, words)
        return
    axes = target(m, words)
    if m.motion == "G0":
        m.rapid(axes, () if m.incremental else [AXES.index(name) for name in named])
    else:
        _work(m, axes, words)


def polar(m: Machine, words: dict[str, float]) -> None:
    """Radius (@) and angle (^, deg) about the origin as X and Y. One that is not given stays; in G91 they add up."""
    radius, angle = words.pop("@", None), words.pop("^", None)
    m.spun = None if radius is None and angle is None else (radius or 0.0, angle or 0.0)
    if m.spun is None:
        return
    if m.plane != "G17" or "X" in words or "Y" in words:
        raise LineError("a polar word (@, ^) outside G17, or beside X and Y")
    x, y = ((m.at[axis] - m.shift[axis]) / m.scale for axis in (0, 1))
    here = math.hypot(x, y), math.degrees(math.atan2(y, x))
    if here[0] == 0 and (radius is None or angle is None or m.incremental):
        raise LineError("a polar word (@, ^) alone or in G91, from the origin")
    base = here if m.incremental else (0.0, 0.0)
    r = here[0] if radius is None else base[0] + radius
    turned = math.radians(here[1] if angle is None else base[1] + angle)
    end = r * math.cos(turned), r * math.sin(turned)
    words["X"], words["Y"] = (end[0] - x, end[1] - y) if m.incremental else end


def target(m: Machine, words: dict[str, float]) -> list[float]:
    """Where the axis words lead, absolute, mm; taken out."""
    end = m.turned(list(m.at), True)
    for axis, value in take_axes(m, words).items():
        if m.incremental and not m.known[axis]:
            m.known[axis] = True
            m.note(
                "assumed",
                f"{AXES[axis]} begins at 0",
                "an incremental motion does not say from where",
            )
        end[axis] = end[axis] + value if m.incremental else value + m.shift[axis]
    return m.turned(end)


def _work(m: Machine, end: Sequence[float], words: dict[str, float]) -> None:
    if m.feed_mode == "G93" and "F" not in words:
        raise LineError(f"{m.motion} without F: with G93 every motion has its own")
    words.pop("F", None)
    m.insist_on_feed(m.motion)
    m.start()
    start, last = m.here(), (end[0], end[1], end[2])
    m.at[:] = last  # also where the arc is refused and a stricter machine reads on
    found: list[Piece] = [(None, last)]
    if m.motion in ARCS:
        for letter in _CENTRES:
            if letter in words:
                words[letter] *= m.scale
                if m.absolute_centre and letter != "R":
                    words[letter] += m.shift["IJK".index(letter)]
        m.turn_centre(words)
        centre = m.beside(start, last, words)
        found = _curve(m, start, last, words)
        if centre:
            m.follow(start, last, _rate(m, start, found), centre)
            return
    elif m.beside(start, last, words):
        m.follow(start, last, _rate(m, start, found))
        return
    m.pieces(found, _rate(m, start, found))


def _curve(m: Machine, start: Vec3, end: Vec3, words: dict[str, float]) -> list[Piece]:
    """An arc, and its words taken out."""
    kept, inch = dict(words), m.scale != 1.0
    try:
        return divide(Arc(m.plane, m.motion, start, end, words, m.absolute_centre), m.limits, inch)
    except LineError as error:
        for k, letter in enumerate("IJK"):
            if letter in kept and not m.absolute_centre:
                kept[letter] += m.shift[k]
        absolute = Arc(m.plane, m.motion, start, end, kept, is_absolute=True)
        return m.centre(lambda: divide(absolute, m.limits, inch), error)


def _rate(m: Machine, start: Vec3, found: Sequence[Piece]) -> float:
    """The speed of a motion at feed, mm/s."""
    if m.feed_mode == "G94":
        return m.feed
    if m.feed_mode == "G95":
        return _per_turn(m)
    return max(_length(start, found) * m.feed, 1e-6)


def _per_turn(m: Machine) -> float:
    if not m.speed or m.spindle == "M5":
        m.stands("a feed per turn (G95) while the spindle stands")
    return m.feed * (m.speed or 60.0) / 60.0


def _length(start: Vec3, found: Sequence[Piece]) -> float:
    ends = np.array([start, *(end for _, end in found)])
    vias = np.array([(math.nan,) * 3, *(via or (math.nan,) * 3 for via, _ in found)])
    return float(span_lengths(ends, vias[1:]).sum())


# Drilling cycles (LinuxCNC manual, canned cycles; levels as its interpreter's).

#: Where a peck begins again above the last one, mm, in LinuxCNC.
_AGAIN = 0.254
_NORMAL = {"G17": 2, "G18": 1, "G19": 0}


def drill(m: Machine, words: dict[str, float]) -> None:
    """The holes of one line. Takes out the words used."""
    normal = _NORMAL[m.plane]
    depth = AXES[normal]
    count = _hold(m, (depth, "R", *_NEEDS.get(m.motion, ())), words)
    m.insist_on_feed(m.motion)
    if m.feed_mode == "G93":
        raise LineError(f"{m.motion} with {m.feed_mode}: a cycle has a feed per minute here")
    m.start()
    if m.level is None:
        m.level = m.at[normal]
    _holes(m, normal, take_axes(m, words), count)


def _hold(m: Machine, needed: tuple[str, ...], words: dict[str, float]) -> int:
    """Takes out the words that hold on, of which those ``needed`` must be there; the number of holes."""
    for letter in (*needed, *(_OPTIONAL if m.motion in _TAPS else "")):
        if letter in words:
            m.sticky[letter] = words.pop(letter) * (m.pause if letter == "P" else m.scale)
    count = words.pop("L", 1.0)
    if count < m.fewest_holes or count != int(count):
        raise LineError(f"L{count:g} is no number of holes")
    if count > m.bounds.gcode_pieces:
        most = tell(m.bounds.gcode_pieces)
        raise LineError(f"L{count:g}: more than {most} holes cannot be meant (limits.gcode_pieces)")
    for letter in needed:
        if letter not in m.sticky:
            raise LineError(f"{m.motion} without {letter}")
    return int(count)


#: Cycles that turn the spindle back or stop it, with words that they may have.
_TAPS = frozenset({"G74", "G84", "G87", "G88"})
_OPTIONAL = "PQIJK"
_NEEDS = {"G73": ("Q",), "G83": ("Q",), "G82": ("P",), "G86": ("P",), "G89": ("P",)}


def _holes(m: Machine, normal: int, words: dict[int, float], count: int) -> None:
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
        m.note(
            "assumed",
            "a cycle retracts to R",
            "the program says neither G98 nor G99; so does LinuxCNC",
        )
    clear = max(level, retract) if m.to_start else retract
    if level < retract:
        _to(m, normal, retract)
    height = max(m.at[normal], clear)
    for _ in range(count):
        if m.incremental:
            _go_on(m, place, words)
        place[normal] = height
        there = m.turned(list(place))
        if there != m.at:
            m.rapid(there)
        if height != retract:
            _to(m, normal, retract)
        _ONE[m.motion](m, normal, retract, bottom, clear)
        height = clear


def _go_on(m: Machine, place: list[float], words: dict[int, float]) -> None:
    """To the next hole in increments, of radius and angle too."""
    if m.spun is None:
        for axis, value in words.items():
            place[axis] += value
        return
    x, y = place[0] - m.shift[0], place[1] - m.shift[1]
    r, turned = math.hypot(x, y) + m.spun[0] * m.scale, math.atan2(y, x) + math.radians(m.spun[1])
    place[0], place[1] = r * math.cos(turned) + m.shift[0], r * math.sin(turned) + m.shift[1]


def _to(m: Machine, axis: int, value: float) -> None:
    end = list(m.at)
    end[axis] = value
    m.rapid(end)


def _in(m: Machine, axis: int, value: float) -> None:
    end = list(m.at)
    end[axis] = value
    m.pieces([(None, (end[0], end[1], end[2]))], speed_of(m))


def speed_of(m: Machine) -> float:
    """The speed of motions at feed that a cycle makes, mm/s. Raises LineError."""
    if m.feed_mode == "G93":
        raise LineError("a cycle with G93: it has a feed per minute, or per turn")
    return m.feed if m.feed_mode == "G94" else _per_turn(m)


def _plain(m: Machine, axis: int, retract: float, bottom: float, clear: float) -> None:  # noqa: ARG001
    _in(m, axis, bottom)
    _to(m, axis, clear)


def _dwelling(m: Machine, axis: int, retract: float, bottom: float, clear: float) -> None:  # noqa: ARG001
    _in(m, axis, bottom)
    m.add(Wait(_seconds(m)))
    _to(m, axis, clear)


def _bore(m: Machine, axis: int, retract: float, bottom: float, clear: float) -> None:
    _in(m, axis, bottom)
    _in(m, axis, retract)
    if clear != retract:
        _to(m, axis, clear)


def _bore_dwelling(m: Machine, axis: int, retract: float, bottom: float, clear: float) -> None:  # noqa: ARG001
    _in(m, axis, bottom)
    m.add(Wait(_seconds(m)))
    _in(m, axis, clear)


def _stop(m: Machine, axis: int, retract: float, bottom: float, clear: float) -> None:  # noqa: ARG001
    if m.spindle == "M5":
        raise LineError("G86 while the spindle stands")
    _in(m, axis, bottom)
    m.add(Wait(_seconds(m)))
    turning, m.spindle = m.spindle, "M5"
    m.turn()
    _to(m, axis, clear)
    m.spindle = turning
    m.turn()


def _peck(m: Machine, axis: int, retract: float, bottom: float, clear: float) -> None:
    step = m.sticky["Q"]
    if step <= 0:
        raise LineError(f"{m.motion} with pecks of Q{step:g}")
    count = math.ceil((retract - bottom) / step - 1e-9)
    if count > m.bounds.gcode_pieces:
        most = tell(m.bounds.gcode_pieces)
        raise LineError(
            f"{m.motion} with more than {most} pecks cannot be meant (limits.gcode_pieces)"
        )
    for peck in range(1, count):
        reached = retract - peck * step
        _in(m, axis, reached)
        if m.motion == "G83":
            _to(m, axis, retract)
        _to(m, axis, reached + _AGAIN)
    _in(m, axis, bottom)
    _to(m, axis, clear)


def _seconds(m: Machine) -> float:
    seconds = m.sticky["P"]
    if seconds < 0:
        raise LineError(f"{m.motion} with a wait of P{seconds:g}")
    return seconds


def _tap(m: Machine, axis: int, retract: float, bottom: float, clear: float) -> None:  # noqa: ARG001
    """In, the spindle turns back, out."""
    turning = m.spindle
    if turning != {"G84": "M3", "G74": "M4"}[m.motion]:
        m.stands(f"{m.motion} while the spindle stands or turns the other way")
    _in(m, axis, bottom)
    m.spindle = "M3" if turning == "M4" else "M4"
    m.turn()
    if m.sticky.get("P"):
        m.add(Wait(_seconds(m)))
    _in(m, axis, clear)
    m.spindle = turning
    m.turn()


def _by_hand(m: Machine, axis: int, retract: float, bottom: float, clear: float) -> None:  # noqa: ARG001
    """G88 waits for the operator at the bottom, who brings the tool up."""
    _in(m, axis, bottom)
    if m.sticky.get("P"):
        m.add(Wait(_seconds(m)))
    m.add(Stop())
    _to(m, axis, clear)


def _back_bore(m: Machine, axis: int, retract: float, bottom: float, clear: float) -> None:
    """G87: beside the hole down, into it, up to K at feed and back, beside it up."""
    hole = list(m.at)
    aside = [
        a + m.sticky.get(letter, 0.0) * (k != axis)
        for k, (a, letter) in enumerate(zip(hole, "IJK", strict=True))
    ]
    middle = m.sticky.get("IJK"[axis], 0.0) + (bottom if m.incremental else m.shift[axis])

    def go(place: list[float], height: float) -> None:
        m.rapid([height if k == axis else value for k, value in enumerate(place)])

    turning = m.spindle
    for place, height in ((aside, retract), (aside, bottom), (hole, bottom)):
        go(place, height)
    _in(m, axis, middle)
    _in(m, axis, bottom)
    for place, height in ((aside, bottom), (aside, retract), (hole, retract)):
        go(place, height)
    m.spindle = turning
    if clear != retract:
        _to(m, axis, clear)


_ONE: dict[str, Callable[[Machine, int, float, float, float], None]] = {
    "G73": _peck, "G81": _plain, "G82": _dwelling, "G83": _peck, "G85": _bore, "G86": _stop,
    "G89": _bore_dwelling, "G74": _tap, "G84": _tap, "G87": _back_bore, "G88": _by_hand,
}  # fmt: skip


# The lines that most of a program consists of, read at once: one motion in numbers, in the usual modes.

_ARC_DIGITS = ("2", "3")


def read_plain(m: Machine, lines: Sequence[str], at: int, bound: int) -> int:
    """Reads the lines from ``at`` (from 0) on, up to one that is not plain or to ``bound``; the place of that one.

    For a machine that is settled. What is odd about a line is left to the long way, which says what it is.
    """
    match, rows = m.plain.fullmatch, m.lines
    body: list[Instruction] = []
    unit, (sx, sy, sz), blend, force = m.scale, m.shift, m.blend, m.force
    last, feed, (x, y, z) = m.motion[1:], m.feed, m.at
    cut = False
    for place in range(at, bound):
        plain = match(lines[place])
        if plain is None:
            if m.is_remark(lines[place]):
                continue
            break
        digit, to_x, to_y, to_z, i, j, f = plain.groups()
        if digit is None:
            digit = last
        rate = float(f) * unit / 60.0 if f else feed
        if to_x is to_y is to_z is None:
            break
        end = (
            x if to_x is None else float(to_x) * unit + sx,
            y if to_y is None else float(to_y) * unit + sy,
            z if to_z is None else float(to_z) * unit + sz,
        )
        if digit == "1" and i is j is None and rate > 0:
            body.append(MoveL(Pose(TOOL_DOWN, end), rate, blend, force))
            cut = True
        elif digit == "0" and i is j is None:
            body.append(MoveJ(Pose(TOOL_DOWN, end), RAPID))
        elif (
            digit not in _ARC_DIGITS
            or rate <= 0
            or not (arc := _read_arc(m, digit, (x, y, z), end, (i, j), rate))
        ):
            break
        else:
            body += arc
            rows.extend([place + 1] * (len(arc) - 1))
            cut = True
        rows.append(place + 1)
        last, feed, (x, y, z) = digit, rate, end
    else:
        place = bound
    if body:
        m.body.extend(body)
        m.motion, m.feed, m.at[:] = f"G{last}", feed, (x, y, z)
        m.cut = m.cut or cut
    return place


def _read_arc(
    m: Machine,
    digit: str,
    start: Vec3,
    end: Vec3,
    centre: tuple[str | None, str | None],
    feed: float,
) -> list[Instruction]:
    """The arc of a plain line; nothing where it is none. centre: I and J."""
    (i, j), unit = centre, m.scale
    words = {} if i is None else {"I": float(i) * unit}
    if j is not None:
        words["J"] = float(j) * unit
    try:
        pieces = divide(
            Arc("G17", f"G{digit}", start, end, words), m.exact or m.limits, unit != 1.0
        )
    except LineError:
        return []
    motions: list[Instruction] = []
    for via, point in pieces:
        pose = Pose(TOOL_DOWN, point)
        if via is None:
            motions.append(MoveL(pose, feed, m.blend, m.force))
        else:
            motions.append(MoveC(Pose(TOOL_DOWN, via), pose, feed, m.blend, m.force))
    return motions
