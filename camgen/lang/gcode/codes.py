"""What the codes of foreign programs do that are no motions: tools, lengths, stored places, kept modes, waits."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from functools import partial

from camgen.lang.gcode.arcs import Arc, divide
from camgen.lang.gcode.compensation import OffsetPath, Segment, place
from camgen.lang.gcode.foreign import Foreign
from camgen.lang.gcode.machine import (
    AXES,
    HANDLERS,
    RAPID,
    Handler,
    set_offsets,
    take_axes,
    work_offset,
)
from camgen.lang.gcode.milling import MILLING
from camgen.lang.gcode.motion import target
from camgen.lang.gcode.turning import turn
from camgen.lang.gcode.words import LineError
from camgen.model.pose import TOOL_DOWN, Pose
from camgen.model.program import Instruction, MoveC, MoveJ, MoveL, ToolChange, Wait

_POINTED = re.compile(r"p[ \t]*[0-9]*\.", re.IGNORECASE)
_WORKS = {n: f"G{53 + n}" for n in range(1, 7)} | {n: f"G59.{n - 6}" for n in range(7, 10)}
#: What M70 and M73 keep, and M72 brings back (LinuxCNC manual).
_MODES = (
    "unit", "incremental", "absolute_centre", "plane", "blend", "feed_mode", "feed", "to_start", "length", "side",
)  # fmt: skip
#: A lathe's spindle turns no faster at the centre than this, where the program names no limit.
_MOST_TURNS = 3000.0


def _change(m: Foreign, code: str, words: dict[str, float]) -> None:
    """M6, and M61 which only says what tool is in."""
    if code == "M61":
        number = int(words.pop("Q", 0.0))
        if m.cut and number != m.changed_to:
            m.log.lose(f"M61 says that tool T{number} is in, after a cut with another one")
        m.changed_to = number
        return
    if m.tool is None:
        m.log.fact("left out", "M6 without a tool (T)")
        return
    if m.spindle != "M5":
        m.spindle, m.halted = "M5", m.line
        m.turn()
    number = m.changed_to = m.tool
    diameter = m.radii[number] * 2 if number in m.radii else m.given.get(f"t{number}.diameter", 0.0)
    if not m.marks or number not in m.tools:
        m.tools.append(number)
    m.marks.append((len(m.body), number, m.work))
    m.add(ToolChange(number, f"T{number}", diameter, m.given.get(f"t{number}.length", 0.0)))


def _length(m: Foreign, code: str, words: dict[str, float]) -> None:
    """G43 and its kin: z is that of the tip, whatever the length."""
    m.length = "G49" if code == "G49" else "G43"
    if code == "G49":
        words.pop("H", None)
        return
    words.pop("H", None)
    if code == "G43.1":
        for letter in "XYZ":
            words.pop(letter, None)
    m.reached = True
    m.assume(f"z is that of the tip of the tool: its length ({code}) is in no program", "", 0.0)


def _spindle(m: Foreign, code: str, words: dict[str, float]) -> None:
    if code == "M19":
        words.pop("R", None), words.pop("P", None)
        m.log.fact("left out", "M19 turns the spindle to an angle")
        return
    words.pop("$", None)
    HANDLERS["spindle"](m, code, words)


def _surface(m: Foreign, code: str, words: dict[str, float]) -> None:
    """G96: S is the speed of the surface, m/min or feet/min, at the diameter where the tool is."""
    if code == "G97":
        return
    most = words.pop("D", m.most_turns) or _MOST_TURNS
    across = 2 * math.pi * max(abs(m.at[0]), 1e-6)
    surface = (m.speed or 0.0) * (304.8 if m.scale != 1.0 else 1000.0)
    m.speed = min(most, surface / across)
    m.assume(
        f"the spindle turns at {m.speed:.0f} rpm where the surface speed begins (G96)", "", m.speed
    )


def _outputs(m: Foreign, code: str, words: dict[str, float]) -> None:
    if m.side and code in ("M62", "M63", "M67") and not m.dialect.open:
        m.log.find("refused", f"{code} with cutter compensation on")
    if code != "M66":
        HANDLERS["outputs"](m, code, words)
        return
    name = f"din{words.pop('P'):.0f}" if "P" in words else f"ain{words.pop('E', 0.0):.0f}"
    waits, _ = words.pop("L", 0.0), words.pop("Q", 0.0)
    default = {3.0: 1.0, 1.0: 1.0}.get(waits, 0.0)
    value = m.assume(
        f"{name} is {default:g}" + (", and its wait over at once" if waits else ""), name, default
    )
    m.homes["5399"] = value


def _dwell(m: Foreign, code: str, words: dict[str, float]) -> None:  # noqa: ARG001 (as all handlers)
    """G4: P in the unit of the controller, X and U of Fanuc and S of printers in s."""
    scale = (
        1.0 if _POINTED.search(m.raw) and m.dialect.name.startswith("fanuc") else m.dialect.dwell
    )
    if "P" not in words and m.dialect.open:
        for letter in "SXU":
            if letter in words and not (letter == "S" and not m.dialect.extruder):
                words["P"], scale = words.pop(letter), 1.0
        if "P" not in words:
            return
    seconds = words.pop("P", -1.0) * scale
    if seconds < 0:
        raise LineError("G4 without its seconds (P)")
    if seconds >= 100:
        m.note(
            "warning",
            f"G4 P{seconds / scale:g} waits for {seconds:g} s",
            "some controllers mean ms; these are seconds",
        )
    m.add(Wait(seconds))


def _state(m: Foreign, code: str, words: dict[str, float]) -> None:  # noqa: ARG001 (as all handlers)
    """M70 and M73 keep the modes, M72 brings them back, M71 forgets them."""
    if code in ("M70", "M73"):
        m.saved.append(tuple(getattr(m, name) for name in _MODES))
        del m.saved[:-50]
    elif not m.saved:
        if code == "M72":
            m.log.find("refused", "M72 without M70 or M73 before it")
    else:
        kept = m.saved.pop()
        if code == "M72":
            for name, value in zip(_MODES, kept, strict=True):
                setattr(m, name, value)


def _override(m: Foreign, code: str, words: dict[str, float]) -> None:
    words.pop("P", None)
    if code == "M49":
        HANDLERS["override"](m, code, words)
    m.log.fact("overrides", code)


def _diameter(m: Foreign, code: str, words: dict[str, float]) -> None:  # noqa: ARG001 (as all handlers)
    m.lathe = code == "G7"


def _compensate(m: Foreign, code: str, words: dict[str, float]) -> None:
    """G41 and G42: beside the path by the radius of the tool, where that is known. G40: no more."""
    if m.path is not None:
        if code != "G40" and not m.dialect.open:
            m.log.find("refused", f"{code} while the path is compensated already")
        m.path.flush()
        m.path, m.left_path = None, True
    if code == "G40":
        m.side = 0
        return
    words.pop("L", None)
    if m.plane not in _BESIDE:
        m.log.find("refused", f"{code} in the plane of Y and Z (G19)")
        return
    m.side = -1 if code.startswith("G42") else 1
    radius = find_radius(m, code, words.pop("D", None))
    if radius > 0:
        m.start()
        first, second, normal = _BESIDE[m.plane]
        tip = complex(m.at[first], m.at[second])
        m.height = m.at[normal]
        m.path = OffsetPath(
            m.side, radius, (first, second, normal), tip, partial(_write, m), partial(_keep, m)
        )


#: The axes of compensation by plane, and its normal.
_BESIDE = {"G17": (0, 1, 2), "G18": (2, 0, 1)}


def find_radius(m: Foreign, code: str, number: float | None) -> float:
    """The radius of a tool, mm; 0 with an assumption or a loss if it is not known."""
    if code.endswith(".1"):
        return (number or 0.0) * m.scale / 2
    if number is not None and number != int(number):
        m.log.find(
            "refused" if not m.dialect.open else "unusual",
            f"{code} with D{number:g}, which is no number of a tool",
        )
        return 0.0
    name = m.changed_to or 0 if number is None else int(number)
    key = f"t{name}.diameter"
    if "compensation" in m.given and not m.given["compensation"]:
        m.assume(f"{code}: the path is run as programmed, the tool on it", "compensation", 0.0)
        return 0.0
    if name in m.radii:
        return m.radii[name]
    if number == 0 and m.dialect.increments:
        # D0 removes the offset.
        return 0.0
    if key in m.given:
        return (
            m.assume(
                f"{code}: tool {name} has a diameter of {m.given[key]:g} mm", key, m.given[key]
            )
            / 2
        )
    if "tool.diameter" in m.given and len(m.tools) < 2:
        known = m.given["tool.diameter"]
        return (
            m.assume(f"{code}: the tool has a diameter of {known:g} mm", "tool.diameter", known) / 2
        )
    what = f"{code}: the path is run as programmed, the tool on it; the diameter of tool {name}, mm, is in no program"
    m.assume(what, key, 0.0)
    remedy = (
        f"give tool {name} a row of [[tools]] with its number and diameter"
        if name
        else "set tool.diameter"
    )
    what = f"{code}: the path depends on the radius of {f'tool {name}' if name else 'the tool'}, which is not known"
    m.log.lose(f'{what}; {remedy}, or operation.compensation = "as-programmed"')
    return 0.0


def _write(m: Foreign, segment: Segment) -> None:
    """Adds a motion of the offset path."""
    assert m.path is not None
    axes, line = m.path.axes, m.line
    m.line, waiting, m.path.last = segment.line, m.path.last, None
    end = place(segment.stop, segment.height, axes)
    if segment.centre is None or segment.speed is None:
        pose = Pose(TOOL_DOWN, end)
        m.add(MoveJ(pose, RAPID) if segment.speed is None else MoveL(pose, segment.speed, m.blend))
    else:
        start = place(segment.start, m.height, axes)
        offset = place(segment.centre - segment.start, 0.0, axes)
        words = {letter: offset[k] for k, letter in enumerate("IJK") if k != axes[2]}
        code = "G3" if segment.turn > 0 else "G2"
        arc = Arc(m.plane, code, start, end, words)
        for via, point in divide(arc, m.limits, m.scale != 1.0):
            pose = Pose(TOOL_DOWN, point)
            m.add(
                MoveL(pose, segment.speed, m.blend)
                if via is None
                else MoveC(Pose(TOOL_DOWN, via), pose, segment.speed, m.blend)
            )
    m.line, m.path.last, m.height = line, waiting, segment.height


def _keep(m: Foreign, item: Instruction, line: int) -> None:
    assert m.path is not None
    now, m.line, waiting, m.path.last = m.line, line, m.path.last, None
    m.add(item)
    m.line, m.path.last = now, waiting


# Places that the machine stores.


def _shift(m: Foreign, code: str, words: dict[str, float]) -> None:
    """G52 and G92.3: the shift of the origin, whatever it was."""
    given = dict(enumerate(m.suspended)) if code == "G92.3" else take_axes(m, words)
    for axis, value in given.items():
        m.shift[axis] += value - (m.shifted[axis] or 0.0)
        m.shifted[axis] = value


def _read_as(m: Foreign, code: str, words: dict[str, float]) -> None:
    """G92: of the axes that turn too; with E alone it counts filament, with S alone it limits the spindle."""
    for letter in m.others:
        if letter in words:
            m.rotary[letter] = words.pop(letter)
    if any(axis in words for axis in AXES):
        set_offsets(m, code, words)
    elif m.dialect.increments and m.speed:
        m.log.fact("left out", "G92 S limits the spindle")
    elif not (m.rotary or m.dialect.extruder):
        m.log.find("refused", "G92 without an axis")


def _cancel(m: Foreign, code: str, words: dict[str, float]) -> None:
    """G92.1 and G92.2; the second keeps the shift for G92.3."""
    m.suspended[:] = [by or 0.0 for by in m.shifted]
    if None in m.shifted:
        m.assume(
            f"{code} after a G92 at a position that the program does not say: the origin stays",
            "",
            0.0,
        )
        m.shifted[:] = [by or 0.0 for by in m.shifted]
    set_offsets(m, code, words)


def _set(m: Foreign, code: str, words: dict[str, float]) -> None:
    """G10: work offsets, and the tool table, of which the radius is kept."""
    if words.get("L") in (2.0, 20.0):
        if "R" in words and words["R"] == 0:
            del words["R"]
        for letter in m.others:
            words.pop(letter, None)
        if words["L"] == 2.0:
            _know(m, int(words.get("P", 0.0)), words)
        set_offsets(m, code, words)
        return
    number = int(words.pop("P", 0.0))
    if "R" in words and words.get("L") in (1.0, 10.0, 11.0):
        m.radii[number] = words["R"] * m.scale
    m.log.fact("tables of the machine", f"G10 L{words.get('L', 0.0):g} P{number}")
    words.clear()


def _know(m: Foreign, number: int, words: dict[str, float]) -> None:
    """Where the work offset in use was before G10 L2 moves it: at 0, where nobody says it."""
    work = m.work or "G54"
    if number and _WORKS.get(number) != work:
        return
    table = m.works.setdefault(work, [None, None, None])
    for k, axis in enumerate(AXES):
        if axis in words and m.known[k] and table[k] is None:
            what = f"G10 L2 moves {work} in {axis} from 0; where it was, mm, is known to the machine alone"
            table[k] = m.guess(what, f"{work.lower()}.{axis.lower()}", 0.0)


def _home(m: Foreign, code: str, words: dict[str, float]) -> None:
    """G28 and G30: by way of the axis words to where the machine stores; the .1 store where the tool is."""
    name = code.partition(".")[0].lower()
    if "." in code:
        for k, axis in enumerate(AXES):
            if m.known[k]:
                m.homes[f"{name}.{axis.lower()}"] = m.at[k]
            words.pop(axis, None)
        return
    for letter in [*m.others, *(letter for letter in "ORLPW" if m.dialect.extruder)]:
        words.pop(letter, None)
    named = [k for k, axis in enumerate(AXES) if axis in words] or [0, 1, 2]
    if m.dialect.homes:
        _zero(m, named, words)
        return
    if not any(axis in words for axis in AXES):
        pass
    elif m.incremental and not all(m.known[k] for k in named):
        take_axes(m, words)
        m.held += not m.has_position
    else:
        m.rapid(target(m, words), () if m.incremental else named)
    go_away(m, name, code, named, m.homes)


def _zero(m: Foreign, named: list[int], words: dict[str, float]) -> None:
    """Homing of a printer: to the origin."""
    for axis in AXES:
        words.pop(axis, None)
    end = list(m.at)
    for k in named:
        axis = AXES[k].lower()
        end[k] = m.assume(f"G28: {axis.upper()} is at home at 0", f"g28.{axis}", 0.0)
        m.shift[k] = 0.0
    m.rapid(end, named)


def go_away(
    m: Foreign,
    name: str,
    code: str,
    axes: list[int],
    stored: Mapping[str, float],
    work: bool = False,
) -> None:
    """Axes to places that the user says, or the program has stored; else Z goes up, and X and Y are not shown.

    name: what the keys begin with. work: at feed.
    """
    end, told = list(m.at), []
    for k in axes:
        axis = AXES[k].lower()
        key = f"{name}.{axis}"
        if key in stored or key in m.given:
            end[k] = (
                stored[key]
                if key in stored
                else m.assume(f"{code}: {AXES[k]} is at", key, m.given[key])
            )
            m.known[k] = True
            m.adrift.discard(k)
            told.append(k)
        elif not m.has_position or not m.known[k]:
            m.known[k], m.lifted = False, m.lifted or k == 2
            m.assume(
                f"{code}: {AXES[k]} goes to a position that the machine stores; it is shown from the next word on",
                key,
                0.0,
            )
        elif k == 2:
            end[k] = m.assume(
                f"{code}: Z goes up to a position that the machine stores, mm; the highest so far is taken",
                key,
                m.top(),
            )
            m.adrift.add(k)
            told.append(k)
        else:
            m.assume(
                f"{code}: {AXES[k]} goes to a position that the machine stores, which is not shown",
                key,
                0.0,
            )
            m.adrift.add(k)
    if not (m.has_position or all(m.known)):
        m.held += bool(told) and name != "machine"  # the G0 beside G53 counts by itself
        return
    if not told:
        return
    if work:
        m.pieces([(None, (end[0], end[1], end[2]))], m.feed)
    else:
        m.rapid(end, told)


def lift(m: Foreign, motion: str, words: dict[str, float]) -> None:
    """G53: a motion in machine coordinates. Where their zero lies in the work frame the user may say (machine.z)."""
    if m.incremental and not m.dialect.open:
        raise LineError("G53 among increments (G91)")
    if m.dialect.open and not any(axis in words for axis in AXES):
        return
    if motion not in ("", "G0", "G1") or (not motion and m.motion not in ("G0", "G1")):
        raise LineError("G53 without G0 or G1")
    m.motion = motion or m.motion
    for letter in m.others:
        words.pop(letter, None)
    axes = {k: words.pop(axis) * m.scale for k, axis in enumerate(AXES) if axis in words}
    if not axes:
        return
    known = {f"machine.{AXES[k].lower()}": m.given[f"machine.{AXES[k].lower()}"] + value for k, value in axes.items()
             if f"machine.{AXES[k].lower()}" in m.given}  # fmt: skip
    go_away(m, "machine", "G53", list(axes), known, work=m.motion == "G1" and m.feed > 0)


def _work(m: Foreign, code: str, words: dict[str, float]) -> None:
    """G54 to G59.3: another frame, of which only the machine knows where it is."""
    words.pop("P", None)
    before = m.work or "G54"
    known = [
        None not in (a, b)
        for a, b in zip(m.works.get(before, [None] * 3), m.works.get(code, [None] * 3), strict=True)
    ]
    if code == before or all(known):
        work_offset(m, code, words)
    else:
        m.work = code
        if any(m.known):
            m.assume(
                f"{code} after motions in {before}: each is shown in its own coordinates", "", 0.0
            )
            m.log.lose(
                f"{code} after motions in {before}: how far apart they are is known to the machine alone"
            )
            m.adrift.update((0, 1, 2))
    if not m.marks or m.marks[-1][2] != m.work:
        m.marks.append((len(m.body), m.changed_to or 0, m.work))


_OFFSETS: dict[str, Handler] = {
    "G10": _set, "G28": _home, "G28.1": _home, "G30": _home, "G30.1": _home, "G52": _shift, "G92": _read_as,
    "G92.1": _cancel, "G92.2": _cancel, "G92.3": _shift,
}  # fmt: skip


def _move_origin(m: Foreign, code: str, words: dict[str, float]) -> None:
    _OFFSETS[code](m, code, words)


CODES: dict[str, Handler] = {
    **HANDLERS,
    "tool change": _change,
    "length offset": _length,
    "spindle": _spindle,
    "spindle mode": _surface,
    "outputs": _outputs,
    "dwell": _dwell,
    "state": _state,
    "override": _override,
    "lathe radius": _diameter,
    "cutter compensation": _compensate,
    "offsets": _move_origin,
    "work offset": _work,
    "machine coordinates": lift,
    **MILLING,
    "turning": turn,
}
