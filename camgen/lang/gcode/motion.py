"""Motions of a line as straight lines and arcs, and plain lines read at once."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence

import numpy as np

from camgen.geometry.arcs import span_lengths
from camgen.lang.gcode.arcs import Arc, Piece, divide
from camgen.lang.gcode.drilling import CYCLES, drill, per_turn
from camgen.lang.gcode.machine import ARCS, AXES, RAPID, Machine, take_axes
from camgen.lang.gcode.words import LineError
from camgen.model.pose import TOOL_DOWN, Pose, Vec3
from camgen.model.program import Instruction, MoveC, MoveJ, MoveL, Wait

_CENTRES = "IJKR"
_NUMBER = r"[ \t]*([+-]?(?:[0-9]{1,6}(?:\.[0-9]{0,12})?|\.[0-9]{1,12}))[ \t]*"
#: One motion without parameters: the digit of G0 to G3, then X Y Z I J F.
PLAIN = re.compile(
    r"[ \t]*(?:[nN][0-9]{1,9}[ \t]*)?(?:[gG]0?([0-3])[ \t]*(?![0-9.]))?"
    + "".join(f"(?:[{letter}{letter.lower()}]{_NUMBER})?" for letter in "XYZIJF")
    + r"(?:\([^(),]*\)[ \t]*|;[^,]*)?\r?"  # a comment with a comma may be one that LinuxCNC acts on
)


def move(m: Machine, code: str, words: dict[str, float]) -> None:
    """Adds the motion of a line, and removes its words. Raises LineError.

    code: motion code of the line, empty for the modal one.
    """
    if code and code != m.motion:
        m.sticky.clear()
        m.motion = code
    if m.motion not in CYCLES:
        m.level = None
    elif m.dialect.increments and "K" in words:
        words["L"] = words.pop("K")
    _turn_axes(m, words, code)
    if m.control and m.motion not in ("G5.2", "G5.3"):
        m.control.clear()
        raise LineError("the control points of G5.2 without G5.3, which draws their curve")
    act = m.profile.handlers.get(m.motion)
    if act is not None and (code or any(axis in words for axis in AXES)):
        m.profile.settle(m, code, words, False)
        act(m, m.motion, words)
        return
    polar(m, words)
    named = [axis for axis in AXES if axis in words]
    around = m.motion in ARCS and any(letter in words for letter in _CENTRES)
    if not named and not around and code not in CYCLES:
        m.profile.stand(m, code)
        return
    if not m.motion:
        _assume_rapid(m)
    m.profile.settle(m, code, words, m.motion in CYCLES)
    if m.motion in CYCLES:
        drill(m, words)
        return
    axes = target(m, words)
    if m.motion == "G0":
        m.rapid(axes, () if m.incremental else [AXES.index(name) for name in named])
    else:
        _work(m, axes, words)


def _assume_rapid(m: Machine) -> None:
    """Takes G0 for axis words without a modal motion code. Raises LineError as LinuxCNC does."""
    if not m.dialect.open:
        raise LineError("axis words without a motion code (G0, G1, G2, G3)")
    m.assume("axis words without a motion code are run as G0")
    m.motion = "G0"


def _turn_axes(m: Machine, words: dict[str, float], code: str) -> None:
    """Adds a loss for each motion of other axes, and its time if X, Y and Z stand still."""
    turned = 0.0
    for letter in m.others:
        if letter not in words:
            continue
        value, before = words.pop(letter), m.rotary.get(letter, 0.0)
        if value != (0.0 if m.incremental else before):
            m.log.lose(f"axis {letter} moves: only X, Y and Z are replayed")
        m.rotary[letter] = before + value if m.incremental else value
        turned = max(turned, abs(m.rotary[letter] - before))
        m.log.fact("axes that are not shown", letter)
    is_alone = not any(axis in words for axis in AXES)
    if turned and is_alone and (code or m.motion) != "G0" and m.feed > 0:
        if m.feed_mode == "G93":
            seconds = 1 / m.feed
        else:
            seconds = turned / (m.feed * 60.0 / m.scale) * 60.0
        m.add(Wait(min(seconds, 1e6)))


def polar(m: Machine, words: dict[str, float]) -> None:
    """Replaces radius (@) and angle (^, deg) about the origin by X and Y. Raises LineError.

    A missing one stays. In G91 they are increments.
    """
    radius, angle = words.pop("@", None), words.pop("^", None)
    m.spun = None if radius is None and angle is None else (radius or 0.0, angle or 0.0)
    if m.spun is None:
        return
    if m.plane != "G17" or "X" in words or "Y" in words:
        raise LineError("a polar word (@, ^) outside G17, or beside X and Y")
    x, y = ((m.at[axis] - m.shift[axis]) / m.scale for axis in (0, 1))
    before = math.hypot(x, y), math.degrees(math.atan2(y, x))
    if before[0] == 0 and (radius is None or angle is None or m.incremental):
        raise LineError("a polar word (@, ^) alone or in G91, from the origin")
    base = before if m.incremental else (0.0, 0.0)
    r = before[0] if radius is None else base[0] + radius
    turned = math.radians(before[1] if angle is None else base[1] + angle)
    end = r * math.cos(turned), r * math.sin(turned)
    words["X"], words["Y"] = (end[0] - x, end[1] - y) if m.incremental else end


def target(m: Machine, words: dict[str, float]) -> list[float]:
    """The absolute end of a motion, mm. Removes the axis words."""
    end = m.turned(list(m.at), True)
    for axis, value in take_axes(m, words).items():
        if m.incremental and not m.known[axis]:
            m.known[axis] = True
            why = "an incremental motion does not say from where"
            m.assume(f"{AXES[axis]} begins at 0", why=why)
        end[axis] = end[axis] + value if m.incremental else value + m.shift[axis]
    return m.turned(end)


def _work(m: Machine, end: Sequence[float], words: dict[str, float]) -> None:
    """Adds a straight motion or an arc at feed. Raises LineError."""
    if m.feed_mode == "G93" and "F" not in words:
        raise LineError(f"{m.motion} without F: with G93 every motion has its own")
    words.pop("F", None)
    m.insist_on_feed(m.motion)
    m.start()
    start, last = m.here(), (end[0], end[1], end[2])
    # A machine that goes on after a refused arc stands at its end too.
    m.at[:] = last
    curve: list[Piece] = [(None, last)]
    if m.motion in ARCS:
        for letter in _CENTRES:
            if letter in words:
                words[letter] *= m.scale
                if m.absolute_centre and letter != "R":
                    words[letter] += m.shift["IJK".index(letter)]
        if m.rotation is not None:
            m.rotation.turn_offset(words, m.absolute_centre)
    centre = m.find_offset(start, last, words)
    if m.motion in ARCS:
        curve = _curve(m, start, last, words)
    if centre:
        m.follow(start, last, _rate(m, start, curve), centre)
    else:
        m.pieces(curve, _rate(m, start, curve))


def _curve(m: Machine, start: Vec3, end: Vec3, words: dict[str, float]) -> list[Piece]:
    """The pieces of an arc. Removes its words. Raises LineError.

    A wide dialect may mean a centre in absolute coordinates, if it fits in no others.
    """
    kept, inch = dict(words), m.scale != 1.0
    try:
        return divide(Arc(m.plane, m.motion, start, end, words, m.absolute_centre), m.limits, inch)
    except LineError as error:
        if not m.dialect.open:
            raise
        for k, letter in enumerate("IJK"):
            if letter in kept and not m.absolute_centre:
                kept[letter] += m.shift[k]
        absolute = Arc(m.plane, m.motion, start, end, kept, is_absolute=True)
        try:
            pieces = divide(absolute, m.limits, inch)
        except LineError:
            raise error from None
    what = "the centre of the arc fits in absolute coordinates alone (G90.1)"
    m.log.find("unusual", f"{what}; it is read so", once="centre")
    m.log.lose(what)
    return pieces


def _rate(m: Machine, start: Vec3, curve: Sequence[Piece]) -> float:
    """The speed of a motion at feed, mm/s."""
    if m.feed_mode == "G94":
        return m.feed
    if m.feed_mode == "G95":
        return per_turn(m)
    return max(_length(start, curve) * m.feed, 1e-6)


def _length(start: Vec3, curve: Sequence[Piece]) -> float:
    ends = np.array([start, *(end for _, end in curve)])
    vias = np.array([(math.nan,) * 3, *(via or (math.nan,) * 3 for via, _ in curve)])
    return float(span_lengths(ends, vias[1:]).sum())


# Plain lines: one motion in numbers, in the usual modes. Most lines of a program are such.

_ARC_DIGITS = ("2", "3")


def read_plain(m: Machine, lines: Sequence[str], at: int, bound: int) -> int:
    """Reads lines from index `at` on, up to a line that is not plain, or to `bound`.

    Returns the index of that line. The machine must be settled (`Machine.is_settled`). A line with
    a fault is not plain, so that the general reader names the fault.
    """
    match, rows, remark = m.profile.plain.fullmatch, m.lines, m.profile.remark
    body: list[Instruction] = []
    unit, (sx, sy, sz), blend, force = m.scale, m.shift, m.blend, m.force
    last, feed, (x, y, z) = m.motion[1:], m.feed, m.at
    cut = False
    for place in range(at, bound):
        plain = match(lines[place])
        if plain is None:
            if remark is not None and remark.fullmatch(lines[place]):
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
    """The arc of a plain line, empty if the controller refuses it.

    centre: texts of I and J.
    """
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
