"""Drilling cycles as the motions that they stand for (LinuxCNC manual, canned cycles; levels as its interpreter's).

Only what leaves nothing open: straight down, absolute, from a known height to which G98 returns. The interpreter of
foreign programs knows the rest.
"""

from __future__ import annotations

import math
from typing import cast

from camgen.model.pose import TOOL_DOWN, Pose, Vec3
from camgen.model.program import MoveJ, MoveL, Wait
from camgen.read.gcode.words import Unread, Wrong

from .plain import RAPID
from .state import Machine

#: Which words the lines of a cycle share.
CYCLES = {"G81": "ZR", "G82": "ZRP", "G83": "ZRQ"}
#: Where a peck begins again above the one before, mm; more pecks are not meant.
_AGAIN, _MOST = 0.254, 20_000


def begin(m: Machine) -> None:
    """A cycle after another motion: nothing is shared yet, and G98 returns to where it begins."""
    m.sticky = {}
    m.level = m.at[2] or 0.0


def drill(m: Machine, code: str, words: dict[str, float]) -> None:
    """The hole of one line. code: as it stands there, empty where the last one holds. Takes out the words used."""
    if not any(axis in words for axis in "XYZ"):
        if code:
            raise Wrong(f"{code} without X, Y or Z")
        return
    _settled(m, words)
    for letter in CYCLES[m.motion]:
        if letter in words:
            m.sticky[letter] = words.pop(letter)
        if letter not in m.sticky:
            raise Wrong(f"{m.motion} without {letter}")
    retract, bottom = m.sticky["R"], m.sticky["Z"]
    if retract < bottom:
        raise Wrong(f"{m.motion} begins (R) below its end")
    if retract > m.level:
        raise Unread(f"{m.motion} that begins above where G98 returns to is not read")
    x, y, _ = cast(Vec3, m.at)
    place = words.pop("X", x), words.pop("Y", y)
    if place != (x, y):
        m.add(MoveJ(Pose(TOOL_DOWN, (*place, m.level)), RAPID))
    m.at = (*place, m.level)
    if retract != m.level:
        _to(m, retract, rapid=True)
    _down(m, retract, bottom)
    _to(m, m.level, rapid=True)


def _settled(m: Machine, words: dict[str, float]) -> None:
    """Raises where more than the words of the line decides what the cycle does."""
    if m.feed <= 0:
        raise Wrong(f"{m.motion} without a feed (F)")
    usual = m.started and m.placed and m.unit == 1.0 and m.plane == "G17" and m.back == "G98" and not m.incremental
    if not usual or m.waiting or m.pressing or m.next_newtons is not None or "L" in words:
        raise Unread(f"{m.motion} in another state than a post leaves it in is not read")


def _down(m: Machine, retract: float, bottom: float) -> None:
    if m.motion == "G83":
        step = m.sticky["Q"]
        count = math.ceil((retract - bottom) / step - 1e-9) if step > 0 else 0
        if not 0 < count <= _MOST:
            raise Wrong(f"G83 with pecks of Q{step:g}")
        for reached in (retract - peck * step for peck in range(1, count)):
            _to(m, reached)
            _to(m, retract, rapid=True)
            _to(m, reached + _AGAIN, rapid=True)
    _to(m, bottom)
    if m.motion == "G82":
        if m.sticky["P"] < 0:
            raise Wrong("G82 with a negative wait (P)")
        m.add(Wait(m.sticky["P"]))


def _to(m: Machine, z: float, rapid: bool = False) -> None:
    x, y, _ = cast(Vec3, m.at)
    m.at = (x, y, z)
    target = Pose(TOOL_DOWN, (x, y, z))
    m.add(MoveJ(target, RAPID) if rapid else MoveL(target, m.feed))
