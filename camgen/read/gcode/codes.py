"""What each code does that is not a motion, in the order in which the codes of one line act (LinuxCNC manual)."""

from __future__ import annotations

from collections.abc import Callable

from camgen.read.gcode.state import AXES, Machine
from camgen.read.gcode.words import Unread, Wrong

# Where the origin is: work offsets, G92 and G10, as far as the program itself decides it.

_WORKS = ("G54", "G55", "G56", "G57", "G58", "G59", "G59.1", "G59.2", "G59.3")


def work_offset(m: Machine, code: str, words: dict[str, float]) -> None:  # noqa: ARG001 (as all handlers)
    """G54 to G59.3."""
    before, m.work = m.work or "G54", code
    if code == before or not any(m.known):
        return
    old, new = _table(m, before), _table(m, code)
    for axis in range(3):
        a, b = old[axis], new[axis]
        if m.known[axis] and (a is None or b is None):
            raise Wrong(f"{code} after motions in {before}: how far apart they are is known to the machine alone")
        m.shift[axis] += (b or 0.0) - (a or 0.0)


def _table(m: Machine, code: str) -> list[float | None]:
    return m.works.setdefault(code, [None, None, None])


def given(m: Machine, words: dict[str, float]) -> dict[int, float]:
    """The axis words of a line in mm, taken out, by axis."""
    return {k: words.pop(name) * m.scale for k, name in enumerate(AXES) if name in words}


def set_offsets(m: Machine, code: str, words: dict[str, float]) -> None:
    """G10 L2 and L20, G92 and what cancels it."""
    if code in ("G92.1", "G92.2"):
        _cancel(m, code)
        return
    if code == "G92":
        axes = given(m, words)
        if not axes:
            raise Wrong("G92 without an axis")
        for axis, value in axes.items():
            moved = _read_as(m, axis, value)
            total = m.shifted[axis]
            m.shifted[axis] = None if moved is None or total is None else total + moved
        return
    kind, number = words.pop("L", 0.0), words.pop("P", -1.0)
    if kind not in (2.0, 20.0):
        raise Wrong(f"G10 L{kind:g} changes the tool table, which is not known here")
    if "R" in words:
        raise Wrong("G10 with R turns the work offset")
    if number not in range(10):
        raise Wrong(f"G10 P{number:g} is no work offset")
    target = _WORKS[int(number) - 1] if number else (m.work or "G54")
    for axis, value in given(m, words).items():
        _set(m, kind == 20.0, target, axis, value)


def _set(m: Machine, by_position: bool, target: str, axis: int, value: float) -> None:
    table, active = _table(m, target), target == (m.work or "G54")
    if by_position:
        if not active:
            raise Wrong("G10 L20 of a work offset that is not the one in use")
        moved, old = _read_as(m, axis, value), table[axis]
        table[axis] = None if moved is None or old is None else old + moved
        return
    old, table[axis] = table[axis], value
    if not active or not m.known[axis]:
        return
    if old is None:
        raise Wrong(f"G10 L2 moves {target} after a motion in it: where it was is known to the machine alone")
    m.shift[axis] += value - old


def _read_as(m: Machine, axis: int, value: float) -> float | None:
    """Makes the position of an axis read as ``value``; how far that moved the origin, None where it is not known."""
    if not m.known[axis]:
        m.known[axis] = True
        m.at[axis] = value + m.shift[axis]
        m.remark("assumed", f"the tool stands at {AXES[axis]}{value:g} mm of the work frame", "the line says so")
        return None
    moved = m.at[axis] - value - m.shift[axis]
    m.shift[axis] += moved
    return moved


def _cancel(m: Machine, code: str) -> None:
    for axis, by in enumerate(m.shifted):
        if by is None:
            raise Wrong(f"{code} after a G92 at a position that the program does not say")
        m.shift[axis] -= by
    m.shifted[:] = [0.0, 0.0, 0.0]


_INCH = 25.4


def feed_mode(m: Machine, code: str, words: dict[str, float]) -> None:  # noqa: ARG001 (as all handlers)
    """G93, G94, G95: a feed of another mode is none."""
    if code != m.feed_mode:
        m.feed = 0.0
    m.feed_mode = code


def feed(m: Machine, value: float, codes: dict[str, str]) -> None:
    """F in the unit that holds before the line's own G20 or G21; in G93 per minute, in G95 per turn."""
    if value < 0:
        raise Wrong(f"feed F{value:g} is negative")
    if codes.get("units") == ("G20" if m.scale == 1.0 else "G21") and m.feed_mode != "G93":
        raise Wrong("F in the line that changes the unit: controllers differ in which unit it has")
    m.feed = value / 60.0 if m.feed_mode == "G93" else value * m.scale / (1.0 if m.feed_mode == "G95" else 60.0)


def speed_and_tool(m: Machine, words: dict[str, float], codes: dict[str, str]) -> None:
    """S and T; a speed alone changes a spindle that turns."""
    if "T" in words:
        number = words.pop("T")
        if number < 0 or number != int(number):
            raise Wrong(f"T{number:g} is no tool")
        m.tool = int(number)
    if "S" in words:
        value = words.pop("S")
        if value < 0:
            raise Wrong(f"spindle speed S{value:g} is negative")
        m.speed = value
        if m.spindle != "M5" and "spindle" not in codes:
            m.switch("spindle", _turning(m))


def _turning(m: Machine) -> float:
    return -m.speed if m.spindle == "M4" else m.speed


def _outputs(m: Machine, code: str, words: dict[str, float]) -> None:
    """M62 to M65 digital, M67 and M68 analog. Those that wait for the next motion stand before it either way."""
    analog = code in ("M67", "M68")
    index = words.pop("E" if analog else "P", -1.0)
    if index < 0 or index != int(index):
        raise Wrong(f"{code} without the number of its output")
    if not analog:
        m.switch(f"dout{int(index)}", 1.0 if code in ("M62", "M64") else 0.0)
    elif "Q" not in words:
        raise Wrong(f"{code} without its value (Q)")
    else:
        m.switch(f"aout{int(index)}", words.pop("Q"))


def _change(m: Machine, code: str, words: dict[str, float]) -> None:  # noqa: ARG001
    if m.tool is None:
        raise Wrong("M6 without a tool (T)")
    if m.changed_to is not None and m.tool != m.changed_to and m.cut:
        raise Wrong(f"M6 changes to tool T{m.tool}: a program has one tool here")
    if m.cut and m.changed_to is None:
        raise Wrong(f"M6 changes to tool T{m.tool} after the first cut: a program has one tool here")
    m.changed_to = m.tool
    m.remark("assumed", f"tool T{m.tool} is the tool of the job", "its length and diameter are in no program")


def _spindle(m: Machine, code: str, words: dict[str, float]) -> None:  # noqa: ARG001
    m.spindle = code
    if m.on_off:
        m.remark("assumed", "the spindle is the signal process", "the program switches it and never says a speed")
        m.switch("process", float(code != "M5"))
    else:
        m.switch("spindle", 0.0 if code == "M5" else _turning(m))


_COOLANTS = {"M7": "mist", "M8": "flood"}


def _coolant(m: Machine, code: str, words: dict[str, float]) -> None:  # noqa: ARG001
    if code != "M9":
        m.coolants.add(code)
        m.switch(_COOLANTS[code], 1.0)
        return
    if not m.coolants:
        m.remark("assumed", "M9 switches nothing off", "no coolant is on")
    for word in sorted(m.coolants):
        m.switch(_COOLANTS[word], 0.0)
    m.coolants.clear()


def _dwell(m: Machine, code: str, words: dict[str, float]) -> None:  # noqa: ARG001
    seconds = words.pop("P", -1.0)
    if seconds < 0:
        raise Wrong("G4 without its seconds (P)")
    if seconds >= 100:
        m.remark("warning", f"G4 P{seconds:g} waits for {seconds:g} s", "some controllers mean ms; these are seconds")
    m.wait(seconds)


def _override(m: Machine, code: str, words: dict[str, float]) -> None:  # noqa: ARG001
    if code == "M49":
        m.remark("skipped", "M49 locks the overrides", "a robot program has no word for it")


def _units(m: Machine, code: str, words: dict[str, float]) -> None:  # noqa: ARG001
    m.unit = _INCH if code == "G20" else 1.0


def _plane(m: Machine, code: str, words: dict[str, float]) -> None:  # noqa: ARG001
    m.plane = code


def _length(m: Machine, code: str, words: dict[str, float]) -> None:
    if code == "G43":
        words.pop("H", None)
        m.remark("assumed", "the length of the tool (G43) is that of the job", "z is that of its tip")
    m.length = code


def _path(m: Machine, code: str, words: dict[str, float]) -> None:
    m.blend = 1.0 if code == "G64" else 0.0
    if code == "G64":
        words.pop("P", None)
        words.pop("Q", None)


def _distance(m: Machine, code: str, words: dict[str, float]) -> None:  # noqa: ARG001
    m.incremental = code == "G91"


def _centres(m: Machine, code: str, words: dict[str, float]) -> None:  # noqa: ARG001
    m.absolute_centre = code == "G90.1"


def _cycle_off(m: Machine, code: str, words: dict[str, float]) -> None:  # noqa: ARG001
    """G80: the next axis words have no motion code."""
    m.motion, m.level = "", None
    m.sticky.clear()


def _level(m: Machine, code: str, words: dict[str, float]) -> None:  # noqa: ARG001
    m.to_start = code == "G98"


def stop(m: Machine, code: str) -> None:
    """M0 to M60. A stop that waits for the operator has no instruction here, and a program must not run through it."""
    if code in ("M0", "M60"):
        raise Unread(f"{code} waits for the operator: a program here runs through")
    if code == "M1":
        m.remark("skipped", "M1 stops where the operator wants it", "a program here runs through")
    else:
        m.ended = True


def switch_off(m: Machine) -> None:
    """The end of a program stops spindle and coolant (LinuxCNC manual, M2)."""
    if m.spindle != "M5":
        m.switch("process" if m.on_off else "spindle", 0.0)
    for word in sorted(m.coolants):
        m.switch(_COOLANTS[word], 0.0)


HANDLERS: tuple[tuple[str, Callable[[Machine, str, dict[str, float]], None]], ...] = (
    ("outputs", _outputs),
    ("tool change", _change),
    ("spindle", _spindle),
    ("mist", _coolant),
    ("flood", _coolant),
    ("coolant off", _coolant),
    ("override", _override),
    ("dwell", _dwell),
    ("plane", _plane),
    ("units", _units),
    ("length offset", _length),
    ("work offset", work_offset),
    ("path", _path),
    ("distance", _distance),
    ("arc distance", _centres),
    ("return level", _level),
    ("cycle off", _cycle_off),
    ("offsets", set_offsets),
)
