"""Cycles of lathes: G71 and G72 rough a profile in passes, G70 finishes it.

Sources: LinuxCNC 2.9, G-Code Reference, tried with its interpreter; Fanuc Series 0i-TF operator's manual (B-64694),
multiple repetitive cycles; Haas lathe operator's manual for the form of one line. Profiles that go back and pockets
in them are passed as if each pass ended where it first meets the profile.
"""

from __future__ import annotations

import math
from array import array
from collections.abc import Iterator, Sequence

from msgspec import Struct

from camgen.geometry.arcs import circle, turn_about
from camgen.lang.gcode.compensation import OffsetPath
from camgen.lang.gcode.drilling import speed_of
from camgen.lang.gcode.machine import Machine
from camgen.lang.gcode.words import LineError
from camgen.model.pose import Vec3
from camgen.model.program import BodyBuilder, MoveC, MoveJ, MoveL

#: rad: arcs of a profile are looked at in steps, to find where a pass meets them.
_STEP = math.radians(0.5)
_SAME = 1e-9
#: mm by which Fanuc and Haas leave a pass, where the text says nothing: a setting of the machine.
_BACK = 1.0
Item = MoveJ | MoveL | MoveC


class _Roughing(Struct, frozen=True):
    """across: the axis along which the passes come nearer, 0 (X, G71) or 2 (Z, G72). cut, back: of a pass, and how far
    the tool leaves it, mm. shift: X and Z that the profile is left by. own: as Fanuc does it, else LinuxCNC.
    """

    across: int
    cut: float
    back: float
    shift: tuple[float, float]
    fanuc: bool


def turn(m: Machine, code: str, words: dict[str, float]) -> None:
    """One of the cycles. LinuxCNC names its profile as a subroutine (Q), Fanuc by the numbers of its lines (P, Q)."""
    fanuc = m.dialect.diameter
    if fanuc and "P" not in words:
        m.first_line = (
            words  # G71 U R: the depth of the cut and the retreat of the cycle that follows
        )
        return
    if "Q" not in words:
        raise LineError(f"{code} without its profile (Q)")
    steps = m.find_lines(words["P"] if fanuc else None, words["Q"])
    m.start()
    path = _leave_path(m, code)
    begin = _begin_of(m, words, fanuc)
    if list(begin) != m.at:
        m.rapid(begin, (0, 1, 2))
    if code == "G70":
        _finish(m, words, steps, begin, fanuc)
    else:
        _remove(m, code, words, steps, begin)
    if path is not None:
        path.tip = complex(m.at[path.axes[0]], m.at[path.axes[1]])
        m.path = path


def _leave_path(m: Machine, code: str) -> OffsetPath | None:
    """Turns cutter compensation off for a cycle. Returns its path."""
    path, m.path = m.path, None
    if path is not None:
        m.path = path
        path.flush()
        m.path = None
        m.assume(
            f"{code}: the profile is run as programmed, without the compensation that is on",
            "",
            0.0,
        )
    return path


def _remove(m: Machine, code: str, words: dict[str, float], steps: range, begin: Vec3) -> None:
    """G71 and G72."""
    fanuc = m.dialect.diameter
    m.insist_on_feed(code)
    profile = _record(m, steps)
    if not profile:
        raise LineError(f"{code}: the profile moves nothing")
    m.assume(
        f"{code}: passes to where each first meets the profile, as of one that does not go back",
    )
    _rough(m, _words_of(m, code, words, fanuc), profile, begin)
    if fanuc:
        m.leap = ("GOTO", words["Q"], 1, None)


def _begin_of(m: Machine, words: dict[str, float], fanuc: bool) -> Vec3:
    """Where the cycle begins: where the tool is, or X and Z of LinuxCNC's."""
    x, y, z = m.here()
    if fanuc:
        return x, y, z
    x = words["X"] * m.scale / (2 if m.lathe else 1) + m.shift[0] if "X" in words else x
    return x, y, words["Z"] * m.scale + m.shift[2] if "Z" in words else z


def _words_of(m: Machine, code: str, words: dict[str, float], fanuc: bool) -> _Roughing:
    across = 0 if code.startswith("G71") else 2
    if not fanuc:
        left = words.get("D", 0.0) * m.scale
        shift = (left, 0.0) if across == 0 else (0.0, left)
        return _Roughing(
            across, words.get("I", 1.0) * m.scale, words.get("R", 0.5) * m.scale, shift, False
        )
    before, m.first_line = m.first_line, {}
    cut = before.get("U" if across == 0 else "W", words.get("D", 0.0)) * m.scale
    if cut <= 0:
        cut = m.assume(f"{code} without the depth of a pass, mm", "g71.depth", 1.0)
    shift = (words.get("U", 0.0) * m.scale / 2, words.get("W", 0.0) * m.scale)
    back = before["R"] * m.scale if "R" in before else _BACK
    return _Roughing(across, cut, back, shift, True)


def _record(m: Machine, steps: range) -> list[Item]:
    """The motions of the steps of a profile, which are not run now."""
    kept = m.body, m.lines, list(m.at), m.motion, m.feed, m.line, m.incremental, m.side
    m.body, m.lines = BodyBuilder(), array("q")
    try:
        m.run_lines(steps)
        _flush(m)
        return [item for item in m.body if isinstance(item, MoveJ | MoveL | MoveC)]
    finally:
        m.body, m.lines, m.at[:], m.motion, m.feed, m.line, m.incremental, m.side = kept
        m.path, m.left_path = None, False


def _flush(m: Machine) -> None:
    if m.path is not None:
        m.path.flush()


def _finish(m: Machine, words: dict[str, float], steps: range, begin: Vec3, fanuc: bool) -> None:
    """G70: the profile as it stands, and of Fanuc back to where the cycle began. LinuxCNC: P times, from D to E off."""
    if fanuc:
        m.run_lines(steps)
        m.leap = None
        if list(begin) != m.at:
            m.rapid(begin, (0, 1, 2))
        return
    times = min(max(int(words.get("P", 1.0)), 1), 100)
    start, end = (words.get(letter, 0.0) * m.scale for letter in "DE")
    profile = _record(m, steps)
    if start or end:
        m.assume("G70 with D or E: the profile is moved along X by as much")
    for k in range(times):
        off = start + (end - start) * k / max(times - 1, 1)
        _follow(m, profile, (off, 0.0))


def _follow(m: Machine, profile: Sequence[Item], shift: tuple[float, float]) -> None:
    """Along the profile, which begins with a rapid motion or not."""

    def moved(point: Vec3) -> Vec3:
        return point[0] + shift[0], point[1], point[2] + shift[1]

    for item in profile:
        end = moved(item.target.origin)  # type: ignore[union-attr]  # G-code has no joint values
        if isinstance(item, MoveJ):
            m.rapid(end, (0, 1, 2))
        else:
            via = moved(item.via.origin) if isinstance(item, MoveC) else None
            m.pieces([(via, end)], speed_of(m))


def _points(profile: Sequence[Item], begin: Vec3) -> Iterator[tuple[float, float]]:
    """X and Z along the profile, from the end of its first motion on."""
    here = begin
    for k, item in enumerate(profile):
        end = item.target.origin  # type: ignore[union-attr]  # G-code has no joint values
        if isinstance(item, MoveC):
            centre, _, axis, sweep = circle(here, item.via.origin, end)
            x, y, z = (a - b for a, b in zip(here, centre, strict=True))
            count = max(2, math.ceil(sweep / _STEP))
            for step in range(1, count):
                point = turn_about((x, y, z), axis, sweep * step / count)
                yield point[0] + centre[0], point[2] + centre[2]
        if k or len(profile) == 1 or isinstance(item, MoveJ):
            yield end[0], end[2]
        here = end


def _rough(m: Machine, how: _Roughing, profile: Sequence[Item], begin: Vec3) -> None:
    """Passes along Z (G71) or X (G72), each nearer, then along the profile, and of Fanuc back to where it began."""
    across, along = how.across, 2 - how.across
    points = [(x + how.shift[0], z + how.shift[1]) for x, z in _points(profile, begin)]
    near = [point[across // 2] for point in points]
    side = -1.0 if min(near) < begin[across] - _SAME else 1.0
    inmost = min(near) if side < 0 else max(near)
    way = -1.0 if points[-1][along // 2] < begin[along] else 1.0
    level, passes = begin[across] + (side * how.cut if how.fanuc else 0.0), 0
    while (level - inmost) * -side > _SAME and passes < m.limits.pieces:
        end = _meet(points, across // 2, level)
        if end is not None and (end - begin[along]) * way > _SAME:
            _pass(m, how, begin, level, end, way, side)
        level += side * how.cut
        passes += 1
    _follow(m, profile, how.shift)
    if how.fanuc and list(begin) != m.at:
        m.rapid(begin, (0, 1, 2))


def _meet(points: Sequence[tuple[float, float]], across: int, level: float) -> float | None:
    """Where, along the passes, one at ``level`` first meets the profile."""
    along = 1 - across
    for k in range(1, len(points)):
        a, b = points[k - 1][across], points[k][across]
        if (a - level) * (b - level) <= 0 and abs(b - a) > _SAME:
            share = (level - a) / (b - a)
            return points[k - 1][along] + share * (points[k][along] - points[k - 1][along])
    return None


def _pass(
    m: Machine, how: _Roughing, begin: Vec3, level: float, end: float, way: float, side: float
) -> None:
    """One pass: to its level, along, off by ``back`` at 45 degrees, and back."""
    across, along = how.across, 2 - how.across

    def place(nearer: float, farther: float) -> Vec3:
        point = [0.0, begin[1], 0.0]
        point[across], point[along] = nearer, farther
        return point[0], point[1], point[2]

    m.rapid(place(level, begin[along]), (0, 1, 2))
    m.pieces([(None, place(level, end))], speed_of(m))
    off = level - side * how.back
    m.rapid(place(off, end - way * how.back), (0, 1, 2))
    m.rapid(place(off, begin[along] if how.fanuc else begin[along] + way * how.back), (0, 1, 2))
    if not how.fanuc:
        m.rapid(place(level, begin[along]), (0, 1, 2))
