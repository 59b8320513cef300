"""Motions of the machine: from axis words to instructions."""

from __future__ import annotations

from camgen.model.pose import TOOL_DOWN, Pose, Vec3
from camgen.model.program import MoveC, MoveJ, MoveL
from camgen.read.gcode.arcs import pieces
from camgen.read.gcode.words import Wrong

from .cycles import CYCLES, begin, drill
from .plain import RAPID
from .state import Machine

_ARCS = ("G2", "G3")


def move(m: Machine, code: str, words: dict[str, float]) -> None:
    """The motion of a line. code: its motion code, empty where the last one still holds. Takes out the words used."""
    _chosen(m, code)
    given = [axis for axis in "XYZ" if axis in words]
    if m.motion in CYCLES:
        drill(m, code, words)
        return
    if not given and not (code in _ARCS and m.rules.linuxcnc):
        if code in _ARCS:
            raise Wrong(f"{code} without an end point")
        if code == "G1" and m.feed <= 0:
            raise Wrong("G1 without a feed (F)")
        return
    if not m.motion:
        raise Wrong("axis words without G0, G1, G2 or G3")
    if m.motion != "G0" and m.feed <= 0:
        raise Wrong(f"{m.motion} without a feed (F)")
    _start(m)
    if not m.placed and (m.incremental or m.motion != "G0"):
        _assume(m, f"{'an incremental' if m.incremental else 'a feed'} motion from a position that is not known")
    end = _target(m, words)
    if not m.placed and not _place(m, given, end):
        return
    start, target = _known(m.at), _known(end)
    m.at = target
    m.waiting = 0
    if m.next_newtons is not None:
        m.newtons, m.next_newtons = m.next_newtons, None
    _write(m, start, target, words)


def _chosen(m: Machine, code: str) -> None:
    """Takes in the motion code of a line."""
    if code in CYCLES and code != m.motion:
        begin(m)
    if code:
        m.motion = "" if code == "G80" else code


def _write(m: Machine, start: Vec3, target: Vec3, words: dict[str, float]) -> None:
    if m.motion == "G0":
        m.add(MoveJ(Pose(TOOL_DOWN, target), RAPID))
        return
    force = m.newtons if m.pressing else 0.0
    if m.motion == "G1":
        m.add(MoveL(Pose(TOOL_DOWN, target), m.feed, 0.0, force))
        return
    for axis in "IJKR":
        if axis in words:
            words[axis] *= m.unit or 1.0
    inch = m.unit != 1.0
    for via, end in pieces(m.plane, m.motion, start, target, words, m.absolute_centre, inch, m.rules.arcs):
        pose = Pose(TOOL_DOWN, end)
        if via is None:
            m.add(MoveL(pose, m.feed, 0.0, force))
        else:
            m.add(MoveC(Pose(TOOL_DOWN, via), pose, m.feed, 0.0, force))


def _target(m: Machine, words: dict[str, float]) -> tuple[float | None, float | None, float | None]:
    x, y, z = m.at
    scale = m.unit or 1.0
    if "X" in words:
        x = words.pop("X") * scale + ((x or 0.0) if m.incremental else 0.0)
    if "Y" in words:
        y = words.pop("Y") * scale + ((y or 0.0) if m.incremental else 0.0)
    if "Z" in words:
        z = words.pop("Z") * scale + ((z or 0.0) if m.incremental else 0.0)
    return x, y, z


def _start(m: Machine) -> None:
    """What must be settled before anything moves."""
    if m.started:
        return
    m.started = True
    if m.unit is None:
        m.unit = 1.0
        m.remark("a motion before G20 or G21; read as mm")
    m.work = m.work or "G54"
    if m.work != m.expect.work:
        m.fault(f"work offset {m.work}, but post.work is {m.expect.work}")
    if m.expect.tool and m.length != "G43":
        m.fault("the length of the tool is not applied (G43) before the first motion")
    if m.expect.path is not None and not m.path:
        m.remark("neither G61 nor G64 P before the first motion: corners may be rounded by any amount")


def _place(m: Machine, given: list[str], end: tuple[float | None, float | None, float | None]) -> bool:
    """Takes in a first G0; whether the position is now known in all axes, so that it is an instruction.

    A tool that stands anywhere is lifted first, then moved: X and Y while Z is unknown is a fault.
    """
    if end[2] is None:
        _assume(m, "X or Y moves while Z is not known")
        return True
    if any(m.at["XYZ".index(axis)] is not None for axis in given):
        m.remark("an axis moves again before the position is known in all axes")
    m.at = end
    m.placed = None not in end
    return m.placed


def _assume(m: Machine, why: str) -> None:
    m.remark(f"{why}; read as from 0")
    x, y, z = m.at
    m.at = (x or 0.0, y or 0.0, z or 0.0)
    m.placed = True


def _known(position: tuple[float | None, float | None, float | None]) -> Vec3:
    x, y, z = position
    return (x or 0.0, y or 0.0, z or 0.0)
