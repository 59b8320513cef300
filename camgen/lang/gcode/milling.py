"""Words of mills that not all controllers have: rotated coordinates, modal calls of macros, circular pockets.

Sources: Fanuc Series 0i-MF operator's manual (B-64694), coordinate system rotation and custom macro; Using Mach3Mill,
chapter 10; Haas VF series manual (96-8000), circular pocket milling.
"""

from __future__ import annotations

import math

from camgen.lang.gcode.arcs import Arc, divide
from camgen.lang.gcode.drilling import speed_of
from camgen.lang.gcode.machine import AXES, Handler, Machine
from camgen.lang.gcode.macros import take_arguments
from camgen.lang.gcode.motion import target
from camgen.lang.gcode.rotation import Rotation
from camgen.lang.gcode.tool_radius import find_radius
from camgen.lang.gcode.words import LineError

_PLANES = {"G17": (0, 1), "G18": (2, 0), "G19": (1, 2)}


def _rotate(m: Machine, code: str, words: dict[str, float]) -> None:
    """G68 by R, deg, about X Y of the plane, or where the tool is; Mach3: about A B, and I adds to what is on. G69."""
    if code == "G69":
        m.rotation = None
        return
    before, m.rotation = m.rotation, None
    axes = _PLANES[m.plane]
    letters = (
        ("A", "B")
        if "A" in words or "B" in words or m.dialect.name == "mach3"
        else tuple(AXES[k] for k in axes)
    )
    usual = (0.0, 0.0) if letters[0] == "A" else tuple(m.at[axis] - m.shift[axis] for axis in axes)
    centre = [
        (words.pop(letter) * m.scale if letter in words else value) + m.shift[axis]
        for letter, value, axis in zip(letters, usual, axes, strict=True)
    ]
    adds = words.pop("I", None) is not None and before is not None
    angle = (
        words.pop("R")
        if "R" in words
        else m.guess("G68 without R: the angle is the machine's, deg", "g68.r", 0.0)
    )
    turned = math.radians(angle) + (before.angle if adds and before else 0.0)
    m.rotation = Rotation(axes, complex(*centre), turned)


def _call_after_motions(m: Machine, code: str, words: dict[str, float]) -> None:
    """G66: the macro runs after every motion, until G67."""
    m.modal = None
    if code == "G67":
        return
    number, times = words.pop("P", 0.0), int(words.pop("L", 1.0))
    m.modal = ("G65", number, min(times, 10_000), take_arguments(words))
    m.modal_depth = m.inside()


def _pocket(m: Machine, code: str, words: dict[str, float]) -> None:
    """G12 (clockwise) and G13 (the other way): circles about the tool, of I, or from I by Q to K. Once L times deeper.

    D is the tool, by whose radius they are smaller. How it goes from circle to circle is taken as half circles.
    """
    if words.get("I", 0.0) <= 0 or ("K" in words) != ("Q" in words) or words.get("Q", 1.0) <= 0:
        raise LineError(f"{code} without a radius (I), or K without Q")
    m.insist_on_feed(code)
    radius = find_radius(m, code, words.pop("D", None))
    first, last, step = words.pop("I"), words.pop("K", 0.0), words.pop("Q", 0.0)
    radii = [first * m.scale]
    while radii[-1] < last * m.scale - 1e-9 and len(radii) < m.limits.pieces:
        radii.append(min(radii[-1] + step * m.scale, last * m.scale))
    radii = [one - radius for one in radii]
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
        _go_round(m, "G2" if code == "G12" else "G3", radii)


def _feed_to(m: Machine, words: dict[str, float]) -> None:
    x, y, z = target(m, words)
    m.pieces([(None, (x, y, z))], speed_of(m))


def _go_round(m: Machine, code: str, radii: list[float]) -> None:
    """Half a circle to each, all of it, and half a circle back to the middle."""
    x, y, z = m.here()
    place = 0.0
    for k, radius in enumerate([*radii, 0.0]):
        there = -math.copysign(radius, place) if k and radius else radius
        for end in [there, there] if radius else [0.0]:
            start = (x + place, y, z)
            words = {"I": (end - place) / 2 if end != place else -place, "J": 0.0}
            arc = Arc("G17", code, start, (x + end, y, z), words)
            m.pieces(divide(arc, m.limits, m.scale != 1.0), speed_of(m))
            place = end


#: By modal group.
MILLING: dict[str, Handler] = {
    "rotation": _rotate,
    "modal macro": _call_after_motions,
    "circular pocket": _pocket,
}
