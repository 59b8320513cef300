"""Codes of some mills: rotated coordinates, modal calls of macros, and circular pockets.

Sources: Fanuc Series 0i-MF operator's manual (B-64694), coordinate system rotation and custom
macro; Using Mach3Mill, chapter 10; Haas VF series manual (96-8000), circular pocket milling.
"""

from __future__ import annotations

import math

from camgen.lang.gcode.arcs import PLANES, Arc, divide
from camgen.lang.gcode.drilling import speed_of
from camgen.lang.gcode.machine import AXES, Handler, Machine
from camgen.lang.gcode.macros import take_arguments
from camgen.lang.gcode.motion import target
from camgen.lang.gcode.rotation import Rotation
from camgen.lang.gcode.tool_radius import find_radius
from camgen.lang.gcode.words import LineError


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
    number, times = words.pop("P", 0.0), int(words.pop("L", 1.0))
    m.modal = ("G65", number, min(times, 10_000), take_arguments(words))
    m.modal_depth = m.inside()


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
    radius = find_radius(m, code, words.pop("D", None))
    first, last, step = words.pop("I"), words.pop("K", 0.0), words.pop("Q", 0.0)
    radii = [first * m.scale]
    while radii[-1] < last * m.scale - 1e-9 and len(radii) < m.limits.pieces:
        radii.append(min(radii[-1] + step * m.scale, last * m.scale))
    radii = [circle - radius for circle in radii]
    if radii[0] <= 0:
        raise LineError(f"{code} with a first circle (I) that is not larger than the tool")
    times = min(int(words.pop("L", 1.0)), 1000) if m.incremental else 1
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


#: The handler of each modal group.
MILLING: dict[str, Handler] = {
    "rotation": _rotate,
    "modal macro": _call_after_motions,
    "circular pocket": _pocket,
}
