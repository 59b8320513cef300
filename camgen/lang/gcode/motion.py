"""Motions of a line as straight lines and arcs, and lines that are run by column."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from camgen.geometry.arcs import measure_spans
from camgen.lang.gcode.arcs import Arc, Piece, divide, find_centre
from camgen.lang.gcode.columns import Chunk, cut, perform
from camgen.lang.gcode.drilling import CYCLES, drill, speed_of
from camgen.lang.gcode.machine import ARCS, AXES, Machine, take_axes
from camgen.lang.gcode.words import LineError
from camgen.model.pose import Vec3
from camgen.model.program import Wait

_CENTRES = "IJKR"
#: Number of lines in a sequence below which running line by line is faster.
SHORTEST_RUN = 16
#: s: a longer turn of an axis alone is refused.
_LONGEST_TURN = 1e6


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
        m.profile.prepare_motion(m, code, words, False)
        act(m, m.motion, words)
        return
    polar(m, words)
    named = [axis for axis in AXES if axis in words]
    around = m.motion in ARCS and any(letter in words for letter in _CENTRES)
    if not named and not around and code not in CYCLES:
        m.profile.run_without_axes(m, code)
        return
    if not m.motion:
        _assume_rapid(m)
    m.profile.prepare_motion(m, code, words, m.motion in CYCLES)
    if m.motion in CYCLES:
        drill(m, words)
    elif m.motion == "G0":
        axes = () if m.incremental else [AXES.index(name) for name in named]
        m.rapid(target(m, words), axes)
    else:
        _work(m, target(m, words), words)


def _assume_rapid(m: Machine) -> None:
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
        if seconds > _LONGEST_TURN:
            raise LineError(f"an axis turns for {seconds:g} s")
        m.add(Wait(seconds))


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
            m.assume(
                f"{AXES[axis]} begins at 0", why="an incremental motion does not say from where"
            )
        end[axis] = end[axis] + value if m.incremental else value + m.shift[axis]
    return m.turned(end)


def _work(m: Machine, end: Sequence[float], words: dict[str, float]) -> None:
    """Adds a straight motion or an arc at feed. Raises LineError."""
    if m.feed_mode == "G93" and "F" not in words:
        raise LineError(f"{m.motion} without F: with G93 every motion has its own")
    words.pop("F", None)
    m.assume_feed(m.motion)
    m.start()
    start, last = m.position(), (end[0], end[1], end[2])
    # A machine that goes on after a refused arc stands at its end too.
    m.at[:] = last
    curve: list[Piece] = [(None, last)]
    centre: tuple[float, ...] = ()
    if m.motion in ARCS:
        for letter in _CENTRES:
            if letter in words:
                words[letter] *= m.scale
                if m.absolute_centre and letter != "R":
                    words[letter] += m.shift["IJK".index(letter)]
        if m.rotation is not None:
            m.rotation.turn_offset(words, m.absolute_centre)
        if m.path is not None:
            arc = Arc(m.plane, m.motion, start, last, words, m.absolute_centre)
            centre = find_centre(arc, m.limits)
        curve = _curve(m, start, last, words)
    if m.path is not None:
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
    if m.feed_mode != "G93":
        return speed_of(m)
    ends = np.array([start, *(end for _, end in curve)])
    vias = np.array([via or (math.nan,) * 3 for via, _ in curve])
    return max(float(measure_spans(ends, vias).sum()) * m.feed, 1e-6)


def run_usual(m: Machine, lines: Sequence[str], at: int, bound: int) -> int:
    """Runs lines in the usual spelling by column, from index `at` up to another line or `bound`.

    Returns the index of that line. The machine must be settled (`Machine.is_settled`). A motion
    with a fault is another line.
    """
    while bound - at >= SHORTEST_RUN:
        chunk: Chunk | None = m.chunk
        if chunk is None or not chunk.holds(at):
            chunk = m.chunk = cut(lines, at, m.profile.find_effect)
        stop = min(bound, chunk.end(at))
        if stop - at < SHORTEST_RUN or at < chunk.resume:
            break
        at = perform(m, chunk, at, stop)
        if at < stop:
            chunk.resume, chunk.pause = at + chunk.pause, 2 * chunk.pause
            break
    return at
