"""Cycles of lathes: G71 and G72 rough a profile in passes, G70 finishes it.

Sources: LinuxCNC 2.9, G-Code Reference, tried with its interpreter; Fanuc Series 0i-TF operator's
manual (B-64694), multiple repetitive cycles; Haas lathe operator's manual for the form of one line.

A profile may change its direction or have pockets. Each pass then ends where it first meets the
profile, as if the profile did neither.
"""

from __future__ import annotations

import math
from array import array
from collections.abc import Iterator, Sequence
from itertools import pairwise

from msgspec import Struct

from camgen.geometry.arcs import compute_circle, turn_about
from camgen.lang.gcode.compensation import OffsetPath
from camgen.lang.gcode.drilling import speed_of
from camgen.lang.gcode.machine import Machine
from camgen.lang.gcode.words import LineError, take_whole
from camgen.model.pose import Vec3
from camgen.model.program import BodyBuilder, MoveC, MoveJ, MoveL

#: rad. Arcs of a profile are divided into such steps to find where a pass meets them.
_STEP = math.radians(0.5)
#: mm. Positions that differ by less are equal.
_SAME = 1e-9
#: mm by which the tool of Fanuc and Haas leaves a pass. A setting of the machine can change it.
_BACK = 1.0
Item = MoveJ | MoveL | MoveC


class _Roughing(Struct, frozen=True):
    """A roughing cycle.

    start: position at which the cycle starts, mm.
    across: axis along which the passes come nearer to the profile, 0 (X, G71) or 2 (Z, G72).
    cut: depth of a pass, mm.
    back: distance by which the tool leaves a pass, mm.
    shift: allowance in X and Z that the cycle leaves on the profile, mm.
    fanuc: whether it is a cycle of Fanuc, not of LinuxCNC.
    """

    start: Vec3
    across: int
    cut: float
    back: float
    shift: tuple[float, float]
    fanuc: bool


def run_lathe_cycle(m: Machine, code: str, words: dict[str, float]) -> None:
    """G70, G71 or G72. Raises LineError without a profile.

    The profile is a subroutine (Q) in LinuxCNC, and the lines with the numbers P to Q in Fanuc.
    """
    fanuc = m.dialect.diameter
    if fanuc and "P" not in words:
        # G71 U R: depth and retreat of the passes of the next line.
        m.first_line = words
        return
    if "Q" not in words:
        raise LineError(f"{code} without its profile (Q)")
    steps = m.find_lines(words["P"] if fanuc else None, words["Q"])
    m.start()
    path = _leave_path(m, code)
    start = _find_start(m, words)
    m.move_rapidly(start)
    if code == "G70":
        _finish(m, words, steps, start)
    else:
        _run_roughing(m, code, words, steps, start)
    if path is not None:
        path.tip = complex(m.at[path.axes[0]], m.at[path.axes[1]])
        m.path = path


def _leave_path(m: Machine, code: str) -> OffsetPath | None:
    """Turns cutter compensation off for a cycle. Returns its path, None if it was off."""
    path = m.path
    if path is None:
        return None
    path.flush()
    m.path = None
    m.assume(f"{code}: the profile is run as programmed, without the compensation that is on")
    return path


def _find_start(m: Machine, words: dict[str, float]) -> Vec3:
    """The start of a cycle, mm: the position of the tool, with X and Z of the line in LinuxCNC."""
    x, y, z = m.position()
    if m.dialect.diameter:
        return x, y, z
    if "X" in words:
        x = words["X"] * m.scale / (2 if m.lathe else 1) + m.shift[0]
    if "Z" in words:
        z = words["Z"] * m.scale + m.shift[2]
    return x, y, z


def _run_roughing(
    m: Machine, code: str, words: dict[str, float], steps: range, start: Vec3
) -> None:
    m.assume_feed(code)
    profile = _record(m, steps)
    if not profile:
        raise LineError(f"{code}: the profile moves nothing")
    m.assume(
        f"{code}: passes to where each first meets the profile, as of one that does not go back",
    )
    _rough(m, _read_roughing(m, code, words, start), profile)
    if m.dialect.diameter:
        m.leap = ("GOTO", words["Q"], 1, None)


def _read_roughing(m: Machine, code: str, words: dict[str, float], start: Vec3) -> _Roughing:
    """The cycle of G71 or G72, from its line and in Fanuc from the line before."""
    across = 0 if code.startswith("G71") else 2
    if not m.dialect.diameter:
        allowance = words.get("D", 0.0) * m.scale
        shift = (allowance, 0.0) if across == 0 else (0.0, allowance)
        cut, back = words.get("I", 1.0) * m.scale, words.get("R", 0.5) * m.scale
        return _Roughing(start, across, cut, back, shift, fanuc=False)
    first_line, m.first_line = m.first_line, {}
    cut = first_line.get("U" if across == 0 else "W", words.get("D", 0.0)) * m.scale
    if cut <= 0:
        cut = m.assume(f"{code} without the depth of a pass, mm", "g71.depth", 1.0)
    shift = (words.get("U", 0.0) * m.scale / 2, words.get("W", 0.0) * m.scale)
    back = first_line["R"] * m.scale if "R" in first_line else _BACK
    return _Roughing(start, across, cut, back, shift, fanuc=True)


def _record(m: Machine, steps: range) -> list[Item]:
    """The motions of the steps of a profile. The program does not get them here."""
    saved = m.body, m.lines, list(m.at), m.motion, m.feed, m.line, m.incremental, m.side
    m.body, m.lines = BodyBuilder(), array("q")
    try:
        m.run_lines(steps)
        if m.path is not None:
            m.path.flush()
        return [item for item in m.body if isinstance(item, MoveJ | MoveL | MoveC)]
    finally:
        m.body, m.lines, m.at[:], m.motion, m.feed, m.line, m.incremental, m.side = saved
        m.path, m.left_path = None, False


def _finish(m: Machine, words: dict[str, float], steps: range, start: Vec3) -> None:
    """G70.

    Fanuc runs the profile once and returns to the start of the cycle. LinuxCNC runs it P times, at
    distances from D to E along X.
    """
    if m.dialect.diameter:
        m.run_lines(steps)
        m.leap = None
        m.move_rapidly(start)
        return
    times = take_whole(words, "P", 1)
    first, last = (words.get(letter, 0.0) * m.scale for letter in "DE")
    profile = _record(m, steps)
    if first or last:
        m.assume("G70 with D or E: the profile is moved along X by as much")
    for k in range(times):
        _follow(m, profile, (first + (last - first) * k / max(times - 1, 1), 0.0))


def _follow(m: Machine, profile: Sequence[Item], shift: tuple[float, float]) -> None:
    """Runs the motions of a profile, moved by `shift` in X and Z, mm."""

    def move(point: Vec3) -> Vec3:
        return point[0] + shift[0], point[1], point[2] + shift[1]

    for item in profile:
        end = move(item.target.origin)  # type: ignore[union-attr]  # G-code has no joint values
        if isinstance(item, MoveJ):
            m.rapid(end, (0, 1, 2))
        else:
            via = move(item.via.origin) if isinstance(item, MoveC) else None
            m.pieces([(via, end)], speed_of(m))


def _list_points(profile: Sequence[Item], start: Vec3) -> Iterator[tuple[float, float]]:
    """X and Z along a profile, mm, from the end of its first motion on."""
    for k, item in enumerate(profile):
        end = item.target.origin  # type: ignore[union-attr]  # G-code has no joint values
        if isinstance(item, MoveC):
            centre, _, axis, sweep = compute_circle(start, item.via.origin, end)
            x, y, z = (a - b for a, b in zip(start, centre, strict=True))
            count = max(2, math.ceil(sweep / _STEP))
            for step in range(1, count):
                point = turn_about((x, y, z), axis, sweep * step / count)
                yield point[0] + centre[0], point[2] + centre[2]
        if k or len(profile) == 1 or isinstance(item, MoveJ):
            yield end[0], end[2]
        start = end


def _rough(m: Machine, cycle: _Roughing, profile: Sequence[Item]) -> None:
    """Cuts passes along Z (G71) or X (G72), each nearer to the profile, then runs the profile.

    A cycle of Fanuc returns to its start.
    """
    start, across, along = cycle.start, cycle.across, 2 - cycle.across
    points = [(x + cycle.shift[0], z + cycle.shift[1]) for x, z in _list_points(profile, start)]
    distances = [point[across // 2] for point in points]
    across_sign, last_level = 1.0, max(distances)
    if min(distances) < start[across] - _SAME:
        across_sign, last_level = -1.0, min(distances)
    along_sign = -1.0 if points[-1][along // 2] < start[along] else 1.0
    level, passes = start[across] + (across_sign * cycle.cut if cycle.fanuc else 0.0), 0
    while (level - last_level) * -across_sign > _SAME and passes < m.limits.pieces:
        end = _find_pass_end(points, across // 2, level)
        if end is not None and (end - start[along]) * along_sign > _SAME:
            _run_pass(m, cycle, (level, end), (across_sign, along_sign))
        level += across_sign * cycle.cut
        passes += 1
    _follow(m, profile, cycle.shift)
    if cycle.fanuc:
        m.move_rapidly(start)


def _find_pass_end(
    points: Sequence[tuple[float, float]], across: int, level: float
) -> float | None:
    """The coordinate along a pass at which it first meets the profile, mm. None if it does not.

    points: X and Z along the profile, mm.
    across: column of the coordinate across the passes.
    level: coordinate of the pass in this column, mm.
    """
    along = 1 - across
    for before, after in pairwise(points):
        a, b = before[across], after[across]
        if (a - level) * (b - level) <= 0 and abs(b - a) > _SAME:
            fraction = (level - a) / (b - a)
            return before[along] + fraction * (after[along] - before[along])
    return None


def _run_pass(
    m: Machine, cycle: _Roughing, target: tuple[float, float], signs: tuple[float, float]
) -> None:
    """Runs one pass: to its level, along it, clear at 45 degrees, and back.

    target: coordinates of the end of the pass across and along the passes, mm.
    signs: direction of the passes across and along, 1 or -1.
    """
    start, across, along = cycle.start, cycle.across, 2 - cycle.across
    (level, end), (across_sign, along_sign) = target, signs

    def make_point(across_mm: float, along_mm: float) -> Vec3:
        point = [0.0, start[1], 0.0]
        point[across], point[along] = across_mm, along_mm
        return point[0], point[1], point[2]

    m.rapid(make_point(level, start[along]), (0, 1, 2))
    m.pieces([(None, make_point(level, end))], speed_of(m))
    clear = level - across_sign * cycle.back
    m.rapid(make_point(clear, end - along_sign * cycle.back), (0, 1, 2))
    if cycle.fanuc:
        m.rapid(make_point(clear, start[along]), (0, 1, 2))
    else:
        m.rapid(make_point(clear, start[along] + along_sign * cycle.back), (0, 1, 2))
        m.rapid(make_point(level, start[along]), (0, 1, 2))
