"""G41, G42 and G40: the radius of a tool, and the motions of the path beside the programmed one."""

from __future__ import annotations

from functools import partial

from camgen.lang.gcode.arcs import PLANES, Arc, divide
from camgen.lang.gcode.compensation import OffsetPath, Segment, place
from camgen.lang.gcode.dialects import RAPID
from camgen.lang.gcode.machine import Machine
from camgen.model.pose import TOOL_DOWN, Pose
from camgen.model.program import Instruction, MoveC, MoveJ, MoveL


def compensate(m: Machine, code: str, words: dict[str, float]) -> None:
    """G41 and G42: beside the path by the radius of the tool if it is known. G40: on the path."""
    if m.path is not None:
        if code != "G40" and not m.dialect.open:
            m.log.find("refused", f"{code} while the path is compensated already")
        m.path.flush()
        m.path, m.left_path = None, True
    if code == "G40":
        m.side = 0
        return
    words.pop("L", None)
    if m.plane == "G19":
        m.log.find("refused", f"{code} in the plane of Y and Z (G19)")
        return
    m.side = -1 if code.startswith("G42") else 1
    radius = find_radius(m, code, words.pop("D", None))
    if radius <= 0:
        return
    m.start()
    axes = first, second, normal = PLANES[m.plane]
    m.height = m.at[normal]
    tip = complex(m.at[first], m.at[second])
    m.path = OffsetPath(m.side, radius, axes, tip, partial(_write, m), partial(_keep, m))


def find_radius(m: Machine, code: str, number: float | None) -> float:
    """The radius of a tool, mm; 0 with an assumption or a loss if it is not known.

    number: D of the line: a diameter for G41.1 and G42.1, else the number of the tool.
    """
    if code.endswith(".1"):
        return (number or 0.0) * m.scale / 2
    if number is not None and number != int(number):
        m.log.find(
            "unusual" if m.dialect.open else "refused",
            f"{code} with D{number:g}, which is not a tool number",
        )
        return 0.0
    tool = m.changed_to or 0 if number is None else int(number)
    key = f"t{tool}.diameter"
    if "compensation" in m.given and not m.given["compensation"]:
        m.assume(f"{code}: the path is run as programmed, the tool on it", "compensation")
        return 0.0
    if tool in m.radii:
        return m.radii[tool]
    if number == 0 and m.dialect.increments:
        # D0 removes the offset.
        return 0.0
    if key in m.given:
        return m.assume(f"{code}: tool {tool} has a diameter of {m.given[key]:g} mm", key) / 2
    if "tool.diameter" in m.given and len(m.tools) < 2:
        known = m.given["tool.diameter"]
        return m.assume(f"{code}: the tool has a diameter of {known:g} mm", "tool.diameter") / 2
    missing = f"the diameter of tool {tool}, mm, is in no program"
    m.assume(f"{code}: the path is run as programmed, the tool on it; {missing}", key)
    name, remedy = "the tool", "set tool.diameter"
    if tool:
        name = f"tool {tool}"
        remedy = f"give tool {tool} a row of [[tools]] with its number and diameter"
    what = f"{code}: the path depends on the radius of {name}, which is not known"
    m.log.lose(f'{what}; {remedy}, or operation.compensation = "as-programmed"')
    return 0.0


def _write(m: Machine, segment: Segment) -> None:
    assert m.path is not None
    axes, line, m.line = m.path.axes, m.line, segment.line
    end = place(segment.stop, segment.height, axes)
    if segment.speed is None:
        m.add(MoveJ(Pose(TOOL_DOWN, end), RAPID))
    elif segment.centre is None:
        m.add(MoveL(Pose(TOOL_DOWN, end), segment.speed, m.blend))
    else:
        start = place(segment.start, m.height, axes)
        offset = place(segment.centre - segment.start, 0.0, axes)
        words = {letter: offset[k] for k, letter in enumerate("IJK") if k != axes[2]}
        arc = Arc(m.plane, "G3" if segment.turn > 0 else "G2", start, end, words)
        for via, point in divide(arc, m.limits, m.scale != 1.0):
            pose = Pose(TOOL_DOWN, point)
            if via is None:
                m.add(MoveL(pose, segment.speed, m.blend))
            else:
                m.add(MoveC(Pose(TOOL_DOWN, via), pose, segment.speed, m.blend))
    m.line, m.height = line, segment.height


def _keep(m: Machine, item: Instruction, line: int) -> None:
    now, m.line = m.line, line
    m.add(item)
    m.line = now
