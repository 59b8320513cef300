"""The effect of each code except motions: modes, outputs, tools, waits, the origin."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping

from camgen.lang.gcode.machine import AXES, COOLANTS, Handler, Machine, take_axes
from camgen.lang.gcode.milling import MILLING, compensate
from camgen.lang.gcode.motion import target
from camgen.lang.gcode.predefined import find_feed, set_override
from camgen.lang.gcode.traced import TRACED
from camgen.lang.gcode.turning import run_lathe_cycle
from camgen.lang.gcode.words import LineError, take_whole
from camgen.model.program import ToolChange, Wait

#: mm: the unit of length of each code.
_UNITS = {"G20": 25.4, "G21": 1.0}
_POINTED = re.compile(r"p[ \t]*[0-9]*\.", re.IGNORECASE)
_WORKS = ("G54", "G55", "G56", "G57", "G58", "G59", "G59.1", "G59.2", "G59.3")
#: Fields of the machine that M70 and M73 save and M72 restores (LinuxCNC manual).
_MODES = (
    "unit",
    "incremental",
    "absolute_centre",
    "plane",
    "blend",
    "feed_mode",
    "feed",
    "to_start",
    "length",
    "side",
)
#: rpm. Maximum spindle speed at constant surface speed, without one in the program.
_MAX_TURNS = 3000.0


# -- feed, spindle and tool ------------------------------------------------------------------------


def feed(m: Machine, words: dict[str, float], codes: Mapping[str, str]) -> None:
    """Sets feed mode and feed: G93, G94, G95 and F. Raises LineError.

    F is per minute in G93, and per turn in G95. A change of the mode clears the feed. With G93 the
    word stays: each motion at feed needs its own. The dialect determines the unit of F in a line
    that changes the unit.
    """
    mode = codes.get("feed mode", m.feed_mode)
    if mode != m.feed_mode:
        m.feed_mode, m.feed = mode, 0.0
    if "F" not in words:
        return
    value = words["F"] if mode == "G93" else words.pop("F")
    if value < 0:
        raise LineError(f"feed F{value:g} is negative")
    if mode == "G93":
        m.feed = value / 60.0
        return
    scale, change = m.scale, codes.get("units")
    if change is not None:
        unit = _UNITS.get(change, 1.0)
        if m.dialect.unit_first is None and unit != scale:
            raise LineError(
                "F in the line that changes the unit: controllers differ in which unit it has"
            )
        if m.dialect.unit_first or m.unit is None:
            scale = unit
        elif unit != m.unit:
            m.log.find("unusual", f"F{value:g} counts in the unit before {change}", once="unit")
    m.feed = value * scale / m.feed_scale
    m.named.pop("_feed", None)


def speed_and_tool(m: Machine, words: dict[str, float], codes: Mapping[str, str]) -> None:
    """S and T. S without a code changes the speed of a spindle that turns. Raises LineError."""
    if "T" in words:
        number = words.pop("T")
        if number < 0 or number != int(number):
            raise LineError(f"T{number:g} is not a tool")
        m.tool = int(number)
    if "S" in words:
        value = words.pop("S")
        if value < 0:
            raise LineError(f"spindle speed S{value:g} is negative")
        m.speed = m.named["_rpm"] = value
        if m.spindle != "M5" and "spindle" not in codes:
            m.update_spindle()


def turn_spindle(m: Machine, code: str, words: dict[str, float]) -> None:
    """M3, M4 and M5; M19 turns it to an angle."""
    if code == "M19":
        words.pop("R", None), words.pop("P", None)
        m.log.fact("left out", "M19 turns the spindle to an angle")
        return
    words.pop("$", None)
    m.spindle = code
    if m.on_off:
        m.assume(
            "the spindle is the signal process",
            why="the program switches it and never says a speed",
        )
    m.update_spindle()


def _surface(m: Machine, code: str, words: dict[str, float]) -> None:
    """G96: S is the surface speed, m/min or feet/min, at the diameter where the tool is."""
    m.named["_spindle_css_mode"] = float(code == "G96")
    if code == "G97":
        return
    limit = words.pop("D", m.most_turns) or _MAX_TURNS
    circumference = 2 * math.pi * max(abs(m.at[0]), 1e-6)
    surface = (m.speed or 0.0) * (304.8 if m.scale != 1.0 else 1000.0)
    m.speed = min(limit, surface / circumference)
    m.assume(
        f"the spindle turns at {m.speed:.0f} rpm where the surface speed begins (G96)", "", m.speed
    )


def _change(m: Machine, code: str, words: dict[str, float]) -> None:
    """M6 changes the tool. M61 only states which tool is in the spindle."""
    if code == "M61":
        number = take_whole(words, "Q", 0)
        if m.cut and number != m.changed_to:
            m.log.lose(f"M61 says that tool T{number} is in, after a cut with another one")
        m.changed_to = number
        return
    if m.tool is None:
        m.log.fact("left out", "M6 without a tool (T)")
        return
    if m.spindle != "M5":
        m.spindle, m.halted = "M5", m.line
        m.update_spindle()
    number = m.changed_to = m.tool
    diameter = m.radii[number] * 2 if number in m.radii else m.given.get(f"t{number}.diameter", 0.0)
    if not m.marks or number not in m.tools:
        m.tools.append(number)
    m.marks.append((len(m.body), number, m.work))
    m.add(ToolChange(number, f"T{number}", diameter, m.given.get(f"t{number}.length", 0.0)))


def _length(m: Machine, code: str, words: dict[str, float]) -> None:
    """G43 to G43.2 and G49: z is assumed to be that of the tip, at any tool length."""
    m.length = "G49" if code == "G49" else "G43"
    words.pop("H", None)
    if code == "G49":
        return
    if code == "G43.1":
        for axis in AXES:
            words.pop(axis, None)
    m.reached = True
    m.assume(f"z is that of the tip of the tool: its length ({code}) is in no program")


# -- outputs and waits -----------------------------------------------------------------------------


def set_output(m: Machine, code: str, words: dict[str, float]) -> None:
    """M62 to M65 digital, M67 and M68 analog; M66 waits for an input. Raises LineError."""
    if m.side and code in ("M62", "M63", "M67") and not m.dialect.open:
        m.log.find("refused", f"{code} with cutter compensation on")
    if code == "M66":
        _wait_for_input(m, words)
        return
    analog = code in ("M67", "M68")
    index = words.pop("E" if analog else "P", -1.0)
    if index < 0 or index != int(index):
        raise LineError(f"{code} without the number of its output")
    if not analog:
        m.switch(f"dout{int(index)}", float(code in ("M62", "M64")))
    elif "Q" not in words:
        raise LineError(f"{code} without its value (Q)")
    else:
        m.switch(f"aout{int(index)}", words.pop("Q"))


def _wait_for_input(m: Machine, words: dict[str, float]) -> None:
    name = f"din{words.pop('P'):.0f}" if "P" in words else f"ain{words.pop('E', 0.0):.0f}"
    waits, _ = words.pop("L", 0.0), words.pop("Q", 0.0)
    value = float(waits in (1.0, 3.0))
    what = f"{name} is {value:g}"
    if waits:
        what += ", and its wait over at once"
    m.homes["5399"] = m.assume(what, name, value)


def switch_coolant(m: Machine, code: str, _words: dict[str, float]) -> None:
    """M7, M8 and M9."""
    if code != "M9":
        m.coolants.add(code)
        m.switch(COOLANTS[code], 1.0)
    else:
        if not m.coolants:
            m.assume("M9 switches nothing off", why="no coolant is on")
        for word in sorted(m.coolants):
            m.switch(COOLANTS[word], 0.0)
        m.coolants.clear()


def _dwell(m: Machine, _code: str, words: dict[str, float]) -> None:
    """G4: P in the unit of the controller, X and U of Fanuc and S of printers in s."""
    dialect = m.dialect
    is_pointed = dialect.name.startswith("fanuc") and _POINTED.search(m.raw)
    scale = 1.0 if is_pointed else dialect.dwell
    if "P" not in words and dialect.open:
        for letter in "SXU":
            if letter in words and (letter != "S" or dialect.extruder):
                words["P"], scale = words.pop(letter), 1.0
        if "P" not in words:
            return
    seconds = words.pop("P", -1.0) * scale
    if seconds < 0:
        raise LineError("G4 without its seconds (P)")
    if seconds >= m.long_wait:
        what = f"G4 P{seconds / scale:g} waits for {seconds:g} s"
        m.log.find("unusual", f"{what}: some controllers mean ms; these are seconds", once=what)
    m.add(Wait(seconds))


# -- modes -----------------------------------------------------------------------------------------


def _override(m: Machine, code: str, words: dict[str, float]) -> None:
    set_override(m, code, words.pop("P", 1.0))
    if code == "M49":
        m.log.fact("left out", "M49 locks the overrides")
    m.log.fact("overrides", code)


def _state(m: Machine, code: str, _words: dict[str, float]) -> None:
    """M70 and M73 save the modes, M72 restores them, M71 discards them."""
    if code in ("M70", "M73"):
        m.saved.append(tuple(getattr(m, name) for name in _MODES))
        del m.saved[:-50]
    elif m.saved:
        modes = zip(_MODES, m.saved.pop(), strict=True)
        for name, value in modes if code == "M72" else ():
            setattr(m, name, value)
    elif code == "M72":
        m.log.find("refused", "M72 without M70 or M73 before it")


#: Field of the machine and its value, for each code that sets one field.
_SETTINGS: dict[str, tuple[str, object]] = {
    "G7": ("lathe", True),
    "G8": ("lathe", False),
    "G17": ("plane", "G17"),
    "G18": ("plane", "G18"),
    "G19": ("plane", "G19"),
    "G90": ("incremental", False),
    "G90.1": ("absolute_centre", True),
    "G91": ("incremental", True),
    "G91.1": ("absolute_centre", False),
    "G98": ("to_start", True),
    "G99": ("to_start", False),
}


def _set_mode(m: Machine, code: str, _words: dict[str, float]) -> None:
    name, value = _SETTINGS[code]
    setattr(m, name, value)


def _units(m: Machine, code: str, _words: dict[str, float]) -> None:
    unit = _UNITS.get(code, 1.0)
    if m.feed > 0 and m.unit not in (None, unit):
        # The feed keeps its speed, and F its number.
        m.named.setdefault("_feed", find_feed(m))
    m.unit = unit


def _path(m: Machine, code: str, words: dict[str, float]) -> None:
    m.blend = float(code == "G64")
    if code == "G64":
        words.pop("P", None)
        words.pop("Q", None)
        if m.dialect.flow and words.pop("R", None) is not None:
            m.log.find(
                "unusual",
                "R of G64 chooses the planner of a newer LinuxCNC; version 2.9 refuses it",
                once="G64 R",
            )


def _cycle_off(m: Machine, _code: str, _words: dict[str, float]) -> None:
    """G80: no motion code is in force."""
    m.motion, m.level = "", None
    m.sticky.clear()


# -- the origin: work offsets, G92 and G10 ---------------------------------------------------------


def set_work(m: Machine, code: str, words: dict[str, float]) -> None:
    """G54 to G59.3: another work offset. In dialects with open codes, P numbers further ones.

    Its coordinates are a loss unless the program has set them and those of the offset before.
    """
    if m.dialect.open and "P" in words:
        code = f"{code} P{words.pop('P'):g}"
    if code != "G54":
        m.log.fact("work offset", code)
    before, m.work = m.work or "G54", code
    if code != before and any(m.known):
        old, new = m.works[before], m.works[code]
        if None in (*old, *new):
            after = f"{code} after motions in {before}"
            m.assume(f"{after}: each is shown in its own coordinates")
            m.log.lose(f"{after}: how far apart they are is known to the machine alone")
            m.adrift.update((0, 1, 2))
        else:
            for axis in range(3):
                m.shift[axis] += (new[axis] or 0.0) - (old[axis] or 0.0)
    if not m.marks or m.marks[-1][2] != code:
        m.marks.append((len(m.body), m.changed_to or 0, code))


def _shift(m: Machine, code: str, words: dict[str, float]) -> None:
    """G52 and G92.3: replaces the shift of the origin."""
    given = dict(enumerate(m.saved_shift)) if code == "G92.3" else take_axes(m, words)
    for axis, value in given.items():
        m.shift[axis] += value - (m.shifted[axis] or 0.0)
        m.shifted[axis] = value
    _save_shift(m)


def _save_shift(m: Machine) -> None:
    """Saves the shift for G92.3, as in the parameters 5211 to 5213 of LinuxCNC."""
    m.saved_shift[:] = [shift or 0.0 for shift in m.shifted]


def _read_as(m: Machine, axis: int, value: float) -> float | None:
    """Shifts the origin so that the position of an axis is `value`, mm.

    Returns the shift, None if the position was not known.
    """
    if not m.known[axis]:
        m.known[axis] = True
        m.at[axis] = value + m.shift[axis]
        m.assume(
            f"the tool stands at {AXES[axis]}{value:g} mm of the work frame", why="the line says so"
        )
        return None
    moved = m.at[axis] - value - m.shift[axis]
    m.shift[axis] += moved
    return moved


def _set_position(m: Machine, _code: str, words: dict[str, float]) -> None:
    """G92: shifts the origin, also that of rotary axes.

    With E alone it sets the filament counter, with S alone it limits the spindle speed.
    """
    for letter in m.others:
        if letter in words:
            m.rotary[letter] = words.pop(letter)
    axes = take_axes(m, words)
    for axis, value in axes.items():
        moved, total = _read_as(m, axis, value), m.shifted[axis]
        m.shifted[axis] = None if moved is None or total is None else total + moved
    if axes:
        _save_shift(m)
    elif m.dialect.increments and m.speed:
        m.log.fact("left out", "G92 S limits the spindle")
    elif not (m.rotary or m.dialect.extruder):
        m.log.find("refused", "G92 without an axis")


def _cancel(m: Machine, code: str, _words: dict[str, float]) -> None:
    """G92.1 and G92.2: cancels the shift of the origin. After G92.2, G92.3 restores it."""
    if None in m.shifted:
        m.assume(
            f"{code} after a G92 at a position that the program does not say: the origin stays"
        )
    for axis, shift in enumerate(m.shifted):
        m.shift[axis] -= shift or 0.0
    m.shifted[:] = [0.0, 0.0, 0.0]
    if code == "G92.1":
        _save_shift(m)


def _set_table(m: Machine, _code: str, words: dict[str, float]) -> None:
    """G10: sets a work offset, or the radius of a tool. Raises LineError.

    Other values of the tool table have no effect here.
    """
    kind, number = words.get("L", 0.0), words.get("P")
    if "L" not in words and not m.dialect.open:
        raise LineError("G10 without L, which says what it sets")
    if kind not in (2.0, 20.0):
        index = take_whole(words, "P", 0)
        if "R" in words and kind in (1.0, 10.0, 11.0):
            m.radii[index] = words["R"] * m.scale
        m.log.fact("tables of the machine", f"G10 L{kind:g} P{index}")
        words.clear()
        return
    for letter in m.others:
        words.pop(letter, None)
    if kind == 2.0:
        _assume_offset(m, int(number or 0.0), words)
    words.pop("L"), words.pop("P", None)
    if words.pop("R", 0.0) != 0:
        raise LineError("G10 with R turns the work offset")
    if number is None or number not in range(10):
        raise LineError(f"G10 P{-1 if number is None else number:g} is not a work offset")
    work = _WORKS[int(number) - 1] if number else (m.work or "G54")
    for axis, value in take_axes(m, words).items():
        _set_offset(m, kind == 20.0, work, axis, value)


def _assume_offset(m: Machine, number: int, words: Mapping[str, float]) -> None:
    work = m.work or "G54"
    if number and (number not in range(1, 10) or _WORKS[number - 1] != work):
        return
    table = m.works[work]
    for k, axis in enumerate(AXES):
        if axis in words and m.known[k] and table[k] is None:
            where = "where it was, mm, is known to the machine alone"
            what = f"G10 L2 moves {work} in {axis} from 0; {where}"
            table[k] = m.guess(what, f"{work.lower()}.{axis.lower()}", 0.0)


def _set_offset(m: Machine, by_position: bool, work: str, axis: int, value: float) -> None:
    table, is_active = m.works[work], work == (m.work or "G54")
    if by_position:
        if not is_active:
            raise LineError("G10 L20 of a work offset that is not the one in use")
        moved, old = _read_as(m, axis, value), table[axis]
        table[axis] = None if moved is None or old is None else old + moved
    else:
        old, table[axis] = table[axis], value
        if is_active and m.known[axis]:
            # The old value is known, or was assumed before.
            m.shift[axis] += value - (old or 0.0)


# -- places that the machine stores ----------------------------------------------------------------


def _home(m: Machine, code: str, words: dict[str, float]) -> None:
    """G28 and G30: by way of the axis words to a place that the machine stores.

    G28.1 and G30.1 store the place of the tool.
    """
    name = code.partition(".")[0].lower()
    if "." in code:
        for k, axis in enumerate(AXES):
            if m.known[k]:
                m.homes[f"{name}.{axis.lower()}"] = m.at[k]
            words.pop(axis, None)
        return
    if m.dialect.extruder:
        for letter in "ORLPW":
            words.pop(letter, None)
    has_others = _lose_other_axes(m, words)
    stated = [k for k, axis in enumerate(AXES) if axis in words]
    if has_others and not stated:
        return
    axes = stated or [0, 1, 2]
    if m.dialect.homes:
        _zero(m, axes, words)
        return
    if stated and m.incremental and not all(m.known[k] for k in stated):
        take_axes(m, words)
        m.held += not m.has_position
    elif stated:
        m.rapid(target(m, words), () if m.incremental else stated)
    go_away(m, code, axes, m.homes)


def _lose_other_axes(m: Machine, words: dict[str, float]) -> bool:
    """Removes words of other axes than X, Y, Z, with a loss. Returns whether there were any."""
    letters = [letter for letter in m.others if letter in words]
    for letter in letters:
        del words[letter]
        m.log.lose(f"axis {letter} moves: only X, Y and Z are replayed")
    return bool(letters)


def _zero(m: Machine, axes: list[int], words: dict[str, float]) -> None:
    """Homing of a printer: to the origin."""
    for axis in AXES:
        words.pop(axis, None)
    end = list(m.at)
    for k in axes:
        axis = AXES[k]
        end[k] = m.assume(f"G28: {axis} is at home at 0", f"g28.{axis.lower()}")
        m.shift[k] = 0.0
    m.rapid(end, axes)


def go_away(m: Machine, code: str, axes: list[int], stored: Mapping[str, float]) -> None:
    """Moves axes to places that the user says, or that the program has stored.

    Without one Z goes up, and X and Y are not shown.

    code: G28, G30 or G53.
    stored: places by key.
    """
    name = "machine" if code == "G53" else code.lower()
    end, shown = list(m.at), []
    for k in axes:
        key = f"{name}.{AXES[k].lower()}"
        goes = f"{code}: {AXES[k]} goes to a position that the machine stores"
        if key in stored or key in m.given:
            end[k] = stored[key] if key in stored else m.assume(f"{code}: {AXES[k]} is at", key)
            m.known[k] = True
            m.adrift.discard(k)
            shown.append(k)
        elif not m.has_position or not m.known[k]:
            m.known[k], m.lifted = False, m.lifted or k == 2
            m.assume(f"{goes}; it is shown from the next word on", key)
        elif k == 2:
            what = f"{code}: Z goes up to a position that the machine stores, mm"
            end[k] = m.assume(f"{what}; the highest so far is taken", key, m.top())
            m.adrift.add(k)
            shown.append(k)
        else:
            m.assume(f"{goes}, which is not shown", key)
            m.adrift.add(k)
    if not (m.has_position or all(m.known)):
        m.held += bool(shown) and code != "G53"  # the G0 beside G53 counts by itself
    elif shown and code == "G53" and m.motion == "G1" and m.feed > 0:
        m.pieces([(None, (end[0], end[1], end[2]))], m.feed)
    elif shown:
        m.rapid(end, shown)


def lift_tool(m: Machine) -> None:
    """G53 G0 Z0 before any other motion: to the top of the machine. The height is not known then.

    Raises LineError among increments, as LinuxCNC does.
    """
    if m.incremental:
        raise LineError("G53 among increments (G91)")
    m.lifted, m.known[2], m.at[2] = True, False, 0.0


def _machine_coordinates(m: Machine, motion: str, words: dict[str, float]) -> None:
    """G53: a motion in machine coordinates. Raises LineError.

    The user may say where their zero lies in the work frame (machine.z).
    """
    is_top = motion == "G0" and words.get("Z") == 0 and not {"X", "Y"} & words.keys()
    if is_top and not m.has_position and not m.given:
        del words["Z"]
        lift_tool(m)
        return
    if m.incremental and not m.dialect.open:
        raise LineError("G53 among increments (G91)")
    if m.dialect.open and not any(axis in words for axis in AXES):
        return
    if (motion or m.motion) not in ("G0", "G1"):
        raise LineError("G53 without G0 or G1")
    m.motion = motion or m.motion
    _lose_other_axes(m, words)
    axes = take_axes(m, words)
    keys = {k: f"machine.{AXES[k].lower()}" for k in axes}
    known = {keys[k]: m.given[keys[k]] + axes[k] for k in axes if keys[k] in m.given}
    if axes:
        go_away(m, "G53", list(axes), known)


_OFFSETS: dict[str, Handler] = {
    "G10": _set_table, "G28": _home, "G28.1": _home, "G30": _home, "G30.1": _home, "G52": _shift,
    "G92": _set_position, "G92.1": _cancel, "G92.2": _cancel, "G92.3": _shift,
}  # fmt: skip


def _move_origin(m: Machine, code: str, words: dict[str, float]) -> None:
    _OFFSETS[code](m, code, words)


#: The function of each modal group, in the order in which the groups act.
_IN_ORDER: dict[str, Handler] = {
    "outputs": set_output,
    "tool change": _change,
    "spindle": turn_spindle,
    "mist": switch_coolant,
    "flood": switch_coolant,
    "coolant off": switch_coolant,
    "override": _override,
    "dwell": _dwell,
    "state": _state,
    "spindle mode": _surface,
    "plane": _set_mode,
    "units": _units,
    "cutter compensation": compensate,
    "lathe radius": _set_mode,
    "length offset": _length,
    "work offset": set_work,
    "path": _path,
    "distance": _set_mode,
    "arc distance": _set_mode,
    "return level": _set_mode,
    "cycle off": _cycle_off,
    "offsets": _move_origin,
}
ORDER = tuple(_IN_ORDER)
#: The function of each modal group, and of each motion other than lines, arcs and holes.
HANDLERS: dict[str, Handler] = {
    **_IN_ORDER,
    "machine coordinates": _machine_coordinates,
    "turning": run_lathe_cycle,
    **MILLING,
    **TRACED,
}  # fmt: skip
