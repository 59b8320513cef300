"""Codes of mills: the radius of the tool, rotated coordinates, macros, and circular pockets.

G41 and G42 move the tool beside the programmed path by its radius, G40 back on it.

Sources: Fanuc Series 0i-MF operator's manual (B-64694), coordinate system rotation and custom
macro; Using Mach3Mill, chapter 10; Haas VF series manual (96-8000), circular pocket milling.
"""

from __future__ import annotations

import math
from functools import partial

from camgen.lang.gcode.arcs import PLANES, Arc, divide
from camgen.lang.gcode.compensation import OffsetPath, Segment, place
from camgen.lang.gcode.dialects import RAPID
from camgen.lang.gcode.drilling import speed_of
from camgen.lang.gcode.machine import AXES, Handler, Machine
from camgen.lang.gcode.macros import take_arguments
from camgen.lang.gcode.motion import target
from camgen.lang.gcode.rotation import Rotation
from camgen.lang.gcode.words import LineError, take_whole
from camgen.model.pose import TOOL_DOWN, Pose
from camgen.model.program import Instruction, MoveC, MoveJ, MoveL


def _rotate(m: Machine, code: str, words: dict[str, float]) -> None:
    """G68 and G69: rotates the coordinates by R, deg, or ends the rotation.

    The centre is given by two axes of the plane, in Mach3 by A and B; without them it is the tool.
    With I in Mach3, R adds to the rotation in force.
    """
    if code == "G69":
        m.rotation = None
        return
    before, m.rotation = m.rotation, None
    axes = PLANES[m.plane][:2]
    is_mach3 = "A" in words or "B" in words or m.dialect.name == "mach3"
    letters = ("A", "B") if is_mach3 else tuple(AXES[k] for k in axes)
    centre: list[float] = []
    for letter, axis in zip(letters, axes, strict=True):
        usual = 0.0 if is_mach3 else m.at[axis] - m.shift[axis]
        value = words.pop(letter) * m.scale if letter in words else usual
        centre.append(value + m.shift[axis])
    adds = words.pop("I", None) is not None
    if "R" in words:
        degrees = words.pop("R")
    else:
        degrees = m.guess("G68 without R: the angle is the machine's, deg", "g68.r", 0.0)
    angle = math.radians(degrees) + (before.angle if adds and before else 0.0)
    m.rotation = Rotation(axes, complex(*centre), angle)


def _call_after_motions(m: Machine, code: str, words: dict[str, float]) -> None:
    """G66: the macro runs after every motion, until G67."""
    m.modal = None
    if code == "G67":
        return
    number, times = words.pop("P", 0.0), take_whole(words, "L", 1)
    m.modal = ("G65", number, times, take_arguments(words))
    m.modal_depth = m.depth


def _pocket(m: Machine, code: str, words: dict[str, float]) -> None:
    """G12 (clockwise) and G13 (counterclockwise): cuts circles around the position of the tool.

    The circle has the radius I. With K and Q, the radii grow from I to K by Q. They are smaller by
    the radius of tool D. Z is the depth. In G91, the circles are cut L times, deeper by Z
    each time.

    The link from circle to circle is assumed to be a half circle. Raises LineError for a wrong
    radius.
    """
    if words.get("I", 0.0) <= 0 or ("K" in words) != ("Q" in words) or words.get("Q", 1.0) <= 0:
        raise LineError(f"{code} without a radius (I), or K without Q")
    m.assume_feed(code)
    radius = _find_radius(m, code, words.pop("D", None))
    first, last, step = words.pop("I"), words.pop("K", 0.0), words.pop("Q", 0.0)
    radii = [first * m.scale]
    while radii[-1] < last * m.scale - 1e-9 and len(radii) < m.limits.pieces:
        radii.append(min(radii[-1] + step * m.scale, last * m.scale))
    radii = [circle - radius for circle in radii]
    if radii[0] <= 0:
        raise LineError(f"{code} with a first circle (I) that is not larger than the tool")
    times = take_whole(words, "L", 1) if m.incremental else 1
    deeper = words.pop("Z", None)
    m.assume(f"{code}: the tool goes from circle to circle in half circles")
    m.start()
    if "X" in words or "Y" in words:
        _feed_to(m, {letter: words.pop(letter) for letter in "XY" if letter in words})
    for _ in range(times):
        if deeper is not None:
            _feed_to(m, {"Z": deeper})
        _cut_circles(m, "G2" if code == "G12" else "G3", radii)


def _feed_to(m: Machine, words: dict[str, float]) -> None:
    x, y, z = target(m, words)
    m.pieces([(None, (x, y, z))], speed_of(m))


def _cut_circles(m: Machine, code: str, radii: list[float]) -> None:
    """Cuts a half circle to each circle, the circle, and at last a half circle to the centre."""
    x, y, z = m.position()
    offset = 0.0  # from the centre along X, mm
    for k, radius in enumerate([*radii, 0.0]):
        circle_start = -math.copysign(radius, offset) if k and radius else radius
        for end in [circle_start, circle_start] if radius else [0.0]:
            start = (x + offset, y, z)
            words = {"I": (end - offset) / 2 if end != offset else -offset, "J": 0.0}
            arc = Arc("G17", code, start, (x + end, y, z), words)
            m.pieces(divide(arc, m.limits, m.scale != 1.0), speed_of(m))
            offset = end


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
    radius = _find_radius(m, code, words.pop("D", None))
    if radius <= 0:
        return
    m.start()
    axes = first, second, normal = PLANES[m.plane]
    m.height = m.at[normal]
    tip = complex(m.at[first], m.at[second])
    m.path = OffsetPath(m.side, radius, axes, tip, partial(_write, m), partial(_keep, m))


def _find_radius(m: Machine, code: str, number: float | None) -> float:
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


#: The handler of each modal group.
MILLING: dict[str, Handler] = {
    "rotation": _rotate,
    "modal macro": _call_after_motions,
    "circular pocket": _pocket,
}
