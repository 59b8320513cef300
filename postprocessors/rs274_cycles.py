"""Holes as drilling cycles: which motions of a program are one, and its line (LinuxCNC manual, canned cycles).

A cycle is the same motions said shortly. A hole is: above it, down to R by rapid motion, down at the feed, in pecks or
at once, and straight up to where it began. What lies between these motions (a signal, a wait) keeps them as they are.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise

import numpy as np
from msgspec import Struct

from camgen.body import Columns
from camgen.ir import Comment, Instruction, Motion, MoveJ, MoveL
from camgen.pose import Pose, Vec3
from camgen.post import pose_of
from camgen.text import short

#: Nearer than this two heights are one, mm.
_SAME = 1e-6
#: Where LinuxCNC begins a peck again above the one before, mm (0.01 inch).
_AGAIN = 0.254
#: Digits of R and Q: LinuxCNC subtracts Q once for every peck, so that its rounding adds up.
_DIGITS, _LEAST = 6, 1e-6


class Stroke(Struct, frozen=True):
    """A way straight up or down to z, mm. feed: mm/s, 0 for a rapid motion."""

    z: float
    feed: float


class Hole(Struct, frozen=True, eq=False):
    """One cycle. first, last: the instructions that it replaces. motions: what it does, the same way in as few motions
    as the controller makes of it. words: of its line, but for X and Y. across: whether its first motion leads to it.
    """

    first: int
    last: int
    motions: tuple[Motion, ...]
    words: str
    across: bool

    @property
    def place(self) -> Vec3:
        """Where it ends, mm."""
        return pose_of(self.motions[-1]).origin

    @property
    def feed(self) -> float:
        """Mm/s."""
        return next(motion.speed for motion in self.motions if isinstance(motion, MoveL))


def holes(columns: Columns, decimals: int) -> list[Hole]:
    """The holes among the instructions ``columns`` that are cycles."""
    ends, kinds = columns.ends, columns.moves_are(MoveJ)
    if len(ends) < 3:
        return []
    down = (np.diff(ends, axis=0)[:, 2] < -_SAME) & (np.diff(ends[:, :2], axis=0) == 0).all(axis=1)
    found: list[Hole] = []
    for k in np.flatnonzero(kinds[:-1] & columns.posed[:-1] & down).tolist():
        if found and int(columns.at[k]) < found[-1].last:
            continue
        hole = _hole(columns, k, decimals)
        if hole is not None:
            found.append(hole)
    return found


def _hole(columns: Columns, k: int, decimals: int) -> Hole | None:
    """The hole that begins above with motion ``k``."""
    last = _back(columns, k)
    if last is None:
        return None
    above = columns.moves[k]
    x, y, top = above.target.origin
    strokes = _strokes(columns.moves[k + 1 : last + 1], top, above.speed)
    words = _words(top, strokes, decimals) if strokes else ""
    if not words:
        return None
    turn = above.target.rotation
    motions: list[Motion] = []
    for stroke in strokes:
        target = Pose(turn, (x, y, stroke.z))
        motions.append(MoveL(target, stroke.feed) if stroke.feed else MoveJ(target, above.speed))
    across = k > 0 and _leads(columns.pose(k - 1), above.target, decimals)
    first = int(columns.at[k + (not across)])
    return Hole(first, int(columns.at[last]), (*([above] if across else []), *motions), words, across)


def _leads(before: Pose | None, above: Pose, decimals: int) -> bool:
    """Whether a way at the height of travel leads to a hole, which X and Y of its line say."""
    if before is None or abs(before.origin[2] - above.origin[2]) > _SAME:
        return False
    (x, y, _), (u, v, _) = before.origin, above.origin
    return short(x, decimals) != short(u, decimals) or short(y, decimals) != short(v, decimals)


def _back(columns: Columns, k: int) -> int | None:
    """The motion after ``k`` that is back where ``k`` ended, if nothing but straight up and down is between them."""
    x, y, top = columns.moves[k].target.origin
    for j in range(k + 1, len(columns.moves)):
        item = columns.moves[j]
        if columns.at[j] != columns.at[j - 1] + 1 or not isinstance(item.target, Pose):
            return None
        u, v, z = item.target.origin
        if (u, v) != (x, y) or not isinstance(item, MoveJ | MoveL) or z > top + _SAME:
            return None
        if isinstance(item, MoveL) and item.force:
            return None
        if abs(z - top) <= _SAME:
            return None if _goes_on(columns, j) else j
    return None


def _goes_on(columns: Columns, j: int) -> bool:
    """Whether the motion after ``j`` goes down again in the same place: then ``j`` ends a peck, not a hole."""
    if j + 1 == len(columns.moves) or columns.at[j + 1] != columns.at[j] + 1:
        return False
    return bool((columns.ends[j + 1, :2] == columns.ends[j, :2]).all())


def _strokes(moves: Sequence[MoveJ | MoveL], top: float, travel: float) -> list[Stroke]:
    """Motions up and down, one stroke for those that go on in the same way; none where they are of no hole.

    travel: mm/s; a line at that speed is a rapid motion on this machine.
    """
    each = [Stroke(_z(move), 0.0 if isinstance(move, MoveJ) or move.speed == travel else move.speed) for move in moves]
    if any(stroke.feed > travel for stroke in each):
        return []
    strokes = [Stroke(top, -1.0)]
    for stroke in each:
        on = stroke.feed == strokes[-1].feed
        if on and (strokes[-1].z - strokes[-2].z) * (stroke.z - strokes[-1].z) >= 0:
            strokes.pop()
        strokes.append(stroke)
    return strokes[1:]


def _z(move: MoveJ | MoveL) -> float:
    return pose_of(move).origin[2]


def _words(top: float, strokes: Sequence[Stroke], decimals: int) -> str:
    """The words of the cycle that makes ``strokes`` from the height ``top``; empty where none does."""
    retract, rest = (top, strokes) if strokes[0].feed else (strokes[0].z, strokes[1:])
    cuts = [stroke for stroke in rest if stroke.feed]
    levels = [retract, *(cut.z for cut in cuts)]
    if not cuts or len({cut.feed for cut in cuts}) > 1 or any(b >= a - _SAME for a, b in pairwise(levels)):
        return ""
    wanted = [Stroke(cuts[0].z, cuts[0].feed)]
    for before, cut in pairwise(cuts):
        wanted += [Stroke(retract, 0.0), Stroke(before.z + _AGAIN, 0.0), cut]
    wanted.append(Stroke(top, 0.0))
    if len(rest) != len(wanted):
        return ""
    if any(a.feed != b.feed or abs(a.z - b.z) > _SAME for a, b in zip(rest, wanted, strict=True)):
        return ""
    words = f"Z{short(levels[-1], decimals)} R{short(retract, _DIGITS)}"
    if len(cuts) == 1:
        return f"G81 {words}"
    peck = _peck(levels)
    return f"G83 {words} Q{short(peck, _DIGITS)}" if peck else ""


def _peck(levels: Sequence[float]) -> float:
    """The Q of the pecks from ``levels[0]`` through the others; 0 where they are not of one depth."""
    step, count = levels[0] - levels[1], len(levels) - 1
    if any(abs(levels[0] - k * step - levels[k]) > _SAME for k in range(1, count)):
        return 0.0
    left = levels[0] - (count - 1) * step - levels[-1]
    if left > step + _SAME:
        return 0.0
    # A Q that divides the depth might leave a last peck of nothing, by rounding.
    return step + _LEAST if left > step - 1e-4 else step


def rows(body: Sequence[Instruction], found: Sequence[Hole]) -> Iterator[tuple[Hole, bool, bool]]:
    """Each hole, whether the cycle before it still holds, and whether it is the last for which its own does."""
    joins = [
        one.words == two.words
        and one.feed == two.feed
        and two.across
        and all(isinstance(item, Comment) for item in body[one.last + 1 : two.first])
        for one, two in pairwise(found)
    ]
    for hole, before, after in zip(found, [False, *joins], [*joins, False], strict=True):
        yield hole, before, not after
