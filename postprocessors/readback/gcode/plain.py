"""The lines that most of a program consists of, read at once: a motion in the usual spelling and the usual state.

Every line that is not exactly of this form, and every state in which it could mean something else, goes the long way
through ``gcode_lexis`` and ``gcode_motion``; a test holds both ways against each other.
"""

from __future__ import annotations

import re
from typing import cast

from camgen.model.pose import TOOL_DOWN, Pose, Vec3
from camgen.model.program import MoveC, MoveJ, MoveL
from camgen.read.gcode.arcs import pieces
from camgen.read.gcode.words import Wrong

from .state import Machine

_NUMBER = r"(-?[0-9]{1,6}(?:\.[0-9]{1,8})?)"
#: In capitals, in this order, a blank between the words, and nothing else.
_PLAIN = re.compile(
    "(G[0-3])" + "".join(f"(?: {letter}{_NUMBER})?" for letter in "XYZIJ") + r"(?: F([0-9]{1,6}(?:\.[0-9]{1,8})?))?"
)
#: Longer lines may be beyond a controller's limit.
_LENGTH = 70


def read_plain(m: Machine, raw: str) -> bool:
    """Whether the line was read. Then its instruction is written down and the state moved on.

    Only where nothing but the words of a line decides what it does (``is_settled``).
    """
    plain = _PLAIN.fullmatch(raw)
    if plain is None or len(raw) > _LENGTH:
        return False
    code, x, y, z, i, j, f = plain.groups()
    feed = float(f) / 60.0 if f else m.feed
    if (x is None and y is None and z is None) or (feed <= 0 and code != "G0"):
        return False
    if (i is not None or j is not None) != (code in ("G2", "G3")):
        return False
    x0, y0, z0 = cast(Vec3, m.at)
    target = (x0 if x is None else float(x), y0 if y is None else float(y), z0 if z is None else float(z))
    if code == "G0":
        m.add(MoveJ(Pose(TOOL_DOWN, target), RAPID))
    elif code == "G1":
        m.add(MoveL(Pose(TOOL_DOWN, target), feed, 0.0, m.newtons if m.pressing else 0.0))
    elif not _arc(m, code, target, i, j, feed):
        return False
    m.motion, m.feed, m.at = code, feed, target
    return True


#: G0 runs at the machine's own speed, which no text tells; the instruction needs a positive one (mm/s).
RAPID = 100.0


def is_settled(m: Machine) -> bool:
    """Whether nothing but the words of a line decides what it does: the position is known, no mode is unusual."""
    settled = m.started and m.placed and None not in m.at and not m.ended and m.unit == 1.0 and m.plane == "G17"
    return settled and not (m.incremental or m.absolute_centre or m.waiting or m.next_newtons is not None)


def _arc(m: Machine, code: str, target: Vec3, i: str | None, j: str | None, feed: float) -> bool:
    words = {letter: float(text) for letter, text in (("I", i), ("J", j)) if text is not None}
    try:
        found = pieces("G17", code, cast(Vec3, m.at), target, words, False, False, m.rules.arcs)
    except Wrong:
        return False  # the long way says what is wrong
    force = m.newtons if m.pressing else 0.0
    for via, end in found:
        pose = Pose(TOOL_DOWN, end)
        m.add(MoveL(pose, feed, 0.0, force) if via is None else MoveC(Pose(TOOL_DOWN, via), pose, feed, 0.0, force))
    return True
