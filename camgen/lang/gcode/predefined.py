"""The parameters of the machine: by number, and the predefined names of LinuxCNC, such as `#<_z>`.

Source: LinuxCNC manual, G-code overview, "Predefined Named Parameters"; values compared with its
interpreter rs274. The interpreter is followed where the manual differs: `_retract_r_plane` is 1
with G99, and `_ccomp` is 410 with G41.1.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

from camgen.lang.gcode.machine import Machine

#: Names of the coordinates, by axis.
_PLACES = {"_x": 0, "_y": 1, "_z": 2, "5420": 0, "5421": 1, "5422": 2}
_ABSOLUTE = {"_abs_x": 0, "_abs_y": 1, "_abs_z": 2}
#: Letters of the other axes, by name.
_OTHERS = (
    dict(zip(("5423", "5424", "5425", "5426", "5427", "5428"), "ABCUVW", strict=True))
    | {f"_{letter.lower()}": letter for letter in "ABCUVW"}
    | {f"_abs_{letter.lower()}": letter for letter in "ABCUVW"}
)
#: Values at the start of a program of names that lines set in `Machine.named`.
_STARTS = {
    "_adaptive_feed": 0.0,
    "_feed_hold": 1.0,
    "_feed_override": 1.0,
    "_rpm": 0.0,
    "_speed_override": 1.0,
    "_spindle_css_mode": 0.0,
}
#: Names that the code of a line sets, with their values; the others have that of P.
_SETS: Mapping[str, Mapping[str, float | None]] = {
    "M48": {"_speed_override": 1.0, "_feed_override": 1.0},
    "M49": {"_speed_override": 0.0, "_feed_override": 0.0},
    "M50": {"_feed_override": None},
    "M51": {"_speed_override": None},
    "M52": {"_adaptive_feed": None},
    "M53": {"_feed_hold": None},
}
#: Values of the controller and its tool table, and the values that are assumed.
_OF_THE_MACHINE = {
    "_vmajor": 2.9,
    "_vminor": 0.0,
    "_current_pocket": 0.0,
    "_selected_pocket": 0.0,
}


def _number(code: str) -> float:
    """The value of a mode: G18 is 180, G59.1 is 591."""
    return round(float(code[1:]) * 10.0)


_MODES: Mapping[str, Callable[[Machine], float]] = {
    "_absolute": lambda m: not m.incremental,
    "_ccomp": lambda m: {0: 400.0, 1: 410.0, -1: 420.0}[m.side],
    "_call_level": lambda m: m.depth,
    "_coord_system": lambda m: _number(m.work or "G54"),
    "_current_tool": lambda m: m.changed_to or 0,
    "_feed": lambda m: m.named.get("_feed", find_feed(m)),
    "_flood": lambda m: "M8" in m.coolants,
    "_ijk_absolute_mode": lambda m: m.absolute_centre,
    "_imperial": lambda m: m.scale != 1.0,
    "_incremental": lambda m: m.incremental,
    "_inverse_time": lambda m: m.feed_mode == "G93",
    "_lathe_diameter_mode": lambda m: m.lathe,
    "_lathe_radius_mode": lambda m: not m.lathe,
    "_line": lambda m: m.line,
    "_metric": lambda m: m.scale == 1.0,
    "_mist": lambda m: "M7" in m.coolants,
    "_motion_mode": lambda m: _number(m.motion or "G80"),
    "_plane": lambda m: _number(m.plane),
    "_remap_level": lambda _m: 0.0,
    "_retract_old_z": lambda m: m.to_start is True,
    "_retract_r_plane": lambda m: m.to_start is not True,
    "_selected_tool": lambda m: m.tool or 0,
    "_spindle_cw": lambda m: m.spindle == "M3",
    "_spindle_on": lambda m: m.spindle != "M5",
    "_spindle_rpm_mode": lambda m: not m.named.get("_spindle_css_mode"),
    # The program runs on the machine, not in a preview.
    "_task": lambda _m: 1.0,
    "_tool_offset": lambda m: m.length != "G49",
    "_units_per_minute": lambda m: m.feed_mode == "G94",
    "_units_per_rev": lambda m: m.feed_mode == "G95",
    # A return without a value, or none yet.
    "_value": lambda _m: 0.0,
    "_value_returned": lambda _m: 0.0,
    "5400": lambda m: m.changed_to or 0,
}


def find_value(m: Machine, name: str) -> float | None:
    """The value of a parameter of the machine by number or name, None for another one.

    A value that only the machine knows is an assumption and a loss.
    """
    if name in _MODES:
        return float(_MODES[name](m))
    if name in _STARTS:
        return m.named.get(name, _STARTS[name])
    if name in _PLACES:
        return _find_place(m, name, _PLACES[name])
    if name in _ABSOLUTE:
        return _find_absolute(m, name, _ABSOLUTE[name])
    letter = _OTHERS.get(name, "")
    if letter in m.rotary:
        return m.rotary[letter]
    if name in m.homes:
        return m.homes[name]
    is_stored = name.isdigit() or name.startswith(("_hal[", "_ini["))
    if letter or is_stored or name in _OF_THE_MACHINE:
        return _ask_machine(m, name, _OF_THE_MACHINE.get(name, 0.0))
    return None


def find_feed(m: Machine) -> float:
    """The number of F for the feed in force, in the unit of the program and its feed mode."""
    if m.feed_mode == "G93":
        return m.feed * 60.0
    return m.feed / m.scale * m.feed_scale


def _ask_machine(m: Machine, name: str, value: float) -> float:
    """The value that the user gives for a parameter of the machine, else `value`."""
    shown = f"#{name}" if name.isdigit() else f"#<{name}>"
    return m.guess(f"{shown} is a value of the machine", shown, value)


def _find_place(m: Machine, name: str, axis: int) -> float:
    """A coordinate in those of the program, in its unit."""
    value = (m.at[axis] - m.shift[axis]) / m.scale
    # The length of a tool moves its tip, before Z moves.
    if m.known[axis] and (axis != 2 or m.length_at_z in ("", m.length)):
        return value
    return _ask_machine(m, name, value)


def _find_absolute(m: Machine, name: str, axis: int) -> float:
    """A coordinate in those of the machine, in the unit of the program."""
    if not m.known[axis]:
        return _ask_machine(m, name, 0.0)
    zero = m.guess(f"#<{name}>: the zero of the machine is at 0", f"machine.{name[-1]}", 0.0)
    length = 0.0
    if axis == 2 and m.length != "G49":
        length = m.guess(f"#<{name}>: the tool has no length", f"t{m.changed_to or 0}.length", 0.0)
    return (m.at[axis] - zero + length) / m.scale


def set_override(m: Machine, code: str, value: float) -> None:
    """Sets the names of M48 to M53. value: P of the line."""
    for name, fixed in _SETS[code].items():
        m.named[name] = value if fixed is None else fixed
