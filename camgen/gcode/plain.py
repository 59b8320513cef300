"""The lines that most of a program consists of, read at once: one motion in numbers, in the usual modes.

Every other line, and every other state, goes the long way; a test holds both ways against each other.
"""

from __future__ import annotations

import re

from camgen.gcode.arcs import pieces
from camgen.gcode.state import RAPID, Machine
from camgen.gcode.wrong import Wrong
from camgen.instructions import MoveJ, MoveL
from camgen.pose import TOOL_DOWN, Pose

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
