"""Motions: from the words of a line to lines and arcs."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence

import numpy as np

from camgen.geometry.arcs import span_lengths
from camgen.model.pose import TOOL_DOWN, Pose, Vec3
from camgen.model.program import MoveJ, MoveL
from camgen.read.gcode import cycles
from camgen.read.gcode.arcs import Piece, pieces
from camgen.read.gcode.codes import given
from camgen.read.gcode.state import AXES, RAPID, Machine
from camgen.read.gcode.words import Wrong

_ARCS = ("G2", "G3")
_CENTRES = "IJKR"


def move(m: Machine, code: str, words: dict[str, float]) -> None:
    """The motion of a line. code: its motion code, empty where the last one still holds. Takes out the words used."""
    if code and code != m.motion:
        m.sticky.clear()
        m.motion = code
    if m.motion not in cycles.CODES:
        m.level = None
    for letter in "ABCUVW":
        if words.pop(letter, 0.0):
            raise Wrong(f"axis {letter} moves: only X, Y and Z are replayed")
    _polar(m, words)
    named = [axis for axis in AXES if axis in words]
    around = code in _ARCS and any(letter in words for letter in _CENTRES)
    if not named and not around and code not in cycles.CODES:
        if code in _ARCS:
            raise Wrong(f"{code} without an end point or centre")
        m.held += code == "G0" and not m.begun  # to where the tool stands, as LinuxCNC sees it
        return
    if not m.motion:
        raise Wrong("axis words without a motion code (G0, G1, G2, G3)")
    _settle(m, "Z" in words or m.motion in cycles.CODES)
    if m.motion in cycles.CODES:
        cycles.drill(m, words)
        return
    axes = target(m, words)
    if m.motion == "G0":
        m.rapid(axes, () if m.incremental else [AXES.index(name) for name in named])
    else:
        _work(m, axes, words)


def _polar(m: Machine, words: dict[str, float]) -> None:
    """Radius (@) and angle (^, deg) about the origin as X and Y. One that is not given stays; in G91 they add up."""
    radius, angle = words.pop("@", None), words.pop("^", None)
    if radius is None and angle is None:
        return
    if m.plane != "G17" or m.motion in cycles.CODES or "X" in words or "Y" in words:
        raise Wrong("a polar word (@, ^) outside G17, in a cycle, or beside X and Y")
    x, y = ((m.at[axis] - m.shift[axis]) / m.scale for axis in (0, 1))
    here = math.hypot(x, y), math.degrees(math.atan2(y, x))
    if here[0] == 0 and (radius is None or angle is None or m.incremental):
        raise Wrong("a polar word (@, ^) alone or in G91, from the origin")
    base = here if m.incremental else (0.0, 0.0)
    r = here[0] if radius is None else base[0] + radius
    turned = math.radians(here[1] if angle is None else base[1] + angle)
    end = r * math.cos(turned), r * math.sin(turned)
    words["X"], words["Y"] = (end[0] - x, end[1] - y) if m.incremental else end


def target(m: Machine, words: dict[str, float]) -> list[float]:
    """Where the axis words lead, absolute, mm; taken out."""
    end = list(m.at)
    for axis, value in given(m, words).items():
        if m.incremental and not m.known[axis]:
            m.known[axis] = True
            m.remark("assumed", f"{AXES[axis]} begins at 0", "an incremental motion does not say from where")
        end[axis] = end[axis] + value if m.incremental else value + m.shift[axis]
    return end


def _settle(m: Machine, rises: bool) -> None:
    if m.unit is None:
        m.unit = 1.0
        m.remark("assumed", "lengths are mm", "neither G20 nor G21 stands before the first motion")
    if not rises:
        return
    if not m.length_at_z:
        m.length_at_z = m.length
    elif m.length != m.length_at_z:
        raise Wrong(f"a motion of Z after {m.length}: it shifts z by the length of the tool, which is not known here")


def _work(m: Machine, end: Sequence[float], words: dict[str, float]) -> None:
    if m.feed_mode == "G93" and "F" not in words:
        raise Wrong(f"{m.motion} without F: with G93 every motion has its own")
    words.pop("F", None)
    if m.feed <= 0:
        raise Wrong(f"{m.motion} without a feed (F)")
    m.start()
    last = (end[0], end[1], end[2])
    found: list[Piece] = [(None, last)]
    if m.motion in _ARCS:
        for letter in _CENTRES:
            if letter in words:
                words[letter] *= m.scale
                if m.absolute_centre and letter != "R":
                    words[letter] += m.shift["IJK".index(letter)]
        found = pieces(m.plane, m.motion, m.here(), last, words, m.absolute_centre, m.scale != 1.0, m.limits)
    m.pieces(found, rate(m, found))


def rate(m: Machine, found: Sequence[Piece]) -> float:
    """The speed of a motion at feed, mm/s."""
    if m.feed_mode == "G94":
        return m.feed
    if m.feed_mode == "G95":
        if m.speed <= 0 or m.spindle == "M5":
            raise Wrong("a feed per turn (G95) while the spindle stands")
        return m.feed * m.speed / 60.0
    return max(_length(m.here(), found) * m.feed, 1e-6)


def _length(start: Vec3, found: Sequence[Piece]) -> float:
    ends = np.array([start, *(end for _, end in found)])
    vias = np.array([(math.nan,) * 3, *(via or (math.nan,) * 3 for via, _ in found)])
    return float(span_lengths(ends, vias[1:]).sum())


# The lines that most of a program consists of, read at once: one motion in numbers, in the usual modes.

_NUMBER = r"[ \t]*([+-]?(?:[0-9]{1,6}(?:\.[0-9]{0,12})?|\.[0-9]{1,12}))[ \t]*"
_PLAIN = re.compile(
    r"[ \t]*(?:[nN][0-9]{1,9}[ \t]*)?(?:[gG]0?([0-3])[ \t]*(?![0-9.]))?"
    + "".join(f"(?:[{letter}{letter.lower()}]{_NUMBER})?" for letter in "XYZIJF")
    + r"(?:\([^(),]*\)[ \t]*|;[^,]*)?\r?"  # a comment with a comma may be one that LinuxCNC acts on
)
_CODES = {"0": "G0", "1": "G1", "2": "G2", "3": "G3", None: ""}


def is_settled(m: Machine) -> bool:
    """Whether nothing but the words of a line decides what it does."""
    usual = m.begun and m.unit is not None and m.plane == "G17" and m.feed_mode == "G94"
    return usual and not (m.ended or m.incremental or m.absolute_centre or m.sticky or m.length != m.length_at_z)


def read_plain(m: Machine, raw: str) -> bool:
    """Whether the line was read. Then its instruction is written down and the state moved on."""
    plain = _PLAIN.fullmatch(raw)
    if plain is None:
        return False
    digit, x, y, z, i, j, f = plain.groups()
    code = _CODES[digit] or m.motion
    unit = m.unit or 1.0
    feed = float(f) * unit / 60.0 if f else m.feed
    if (x is None and y is None and z is None) or (i is not None or j is not None) != (code in ("G2", "G3")):
        return False
    if code not in _MOVES or (feed <= 0 and code != "G0"):
        return False
    at, (sx, sy, sz) = m.at, m.shift
    target = (
        at[0] if x is None else float(x) * unit + sx,
        at[1] if y is None else float(y) * unit + sy,
        at[2] if z is None else float(z) * unit + sz,
    )
    if code == "G0":
        m.add(MoveJ(Pose(TOOL_DOWN, target), RAPID))
    elif code == "G1":
        m.add(MoveL(Pose(TOOL_DOWN, target), feed, m.blend))
        m.cut = True
    else:
        words = {letter: float(text) * unit for letter, text in (("I", i), ("J", j)) if text is not None}
        try:
            found = pieces("G17", code, m.here(), target, words, False, unit != 1.0, m.limits)
        except Wrong:
            return False  # the long way says what is wrong
        m.pieces(found, feed)
    m.motion, m.feed = code, feed
    at[:] = target
    return True


_MOVES = ("G0", "G1", "G2", "G3")
