"""Force control: `ForceParam` (RC8 manual 5176), `ForceCtrl` as it is believed to be, templates."""

from __future__ import annotations

import math
import re
import string
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import chain
from typing import NamedTuple

import numpy as np

from camgen.lang.pacscript.expressions import arguments, parse
from camgen.lang.pacscript.lines import without_comment
from camgen.lang.pacscript.source import Statement
from camgen.lang.pacscript.values import Unreadable, index
from camgen.model.pose import Pose, Vec3
from camgen.model.program import Force

from .machine import StrictMachine
from .run import StrictRun

_NUMBER = r"([-+]?\d+(?:\.\d+)?)"
_KINDS = ("on", "change", "off")
#: Number of the work frame of a force, and number of force tables (RC8 manual 5176).
_WORK, _TABLES = 2, 10


def parameter(run: StrictRun, rest: str) -> None:
    """Runs `ForceParam table, frame, P(fx, fy, fz, ...)`.

    The force is in N. Only forces in the work frame (frame 2) are read.
    """
    parts = arguments(rest)
    if len(parts) > 3:
        raise Unreadable("ForceParam with options is not evaluated")
    if len(parts) < 3:
        raise Unreadable("ForceParam needs 3 values")
    table, frame = (index(run.read_number(part)) for part in parts[:2])
    force = run.evaluate(parse(parts[2]))
    if not isinstance(force, Pose):
        raise Unreadable("ForceParam needs P(fx, fy, fz, mx, my, mz)")
    if not np.array_equal(force.rotation, np.eye(3)):
        raise Unreadable("ForceParam with a torque is not evaluated")
    if frame != _WORK:
        raise Unreadable("a force outside the work frame is not evaluated")
    if not 1 <= table <= _TABLES:
        raise Unreadable(f"the force table {table}; there are 1 to {_TABLES}")
    _set_force(run.machine, table, force.origin)


def _set_force(machine: StrictMachine, table: int, force: Vec3) -> None:
    """Writes a force table, N in the work frame. A force of it that was never on is a finding."""
    machine.forces[table] = _WORK, force
    if machine.table == table:
        machine.press(table)
    note_unused(machine, table)
    if machine.table != table:
        machine.unused_forces[table] = machine.line


def note_unused(machine: StrictMachine, *tables: int) -> None:
    """Adds findings for forces of tables that were set and never on."""
    for table in tables:
        line = machine.unused_forces.pop(table, 0)
        if line:
            machine.log.find("unusual", f"force table {table} is set and never on", line=line)


def control(run: StrictRun, rest: str) -> None:
    """Runs `ForceCtrl True, table` or `ForceCtrl False`."""
    machine = run.machine
    values = [run.read_number(part) for part in arguments(rest)]
    if not values[0]:
        _off(machine)
    elif len(values) != 2:
        raise Unreadable("ForceCtrl True needs the number of a table")
    elif index(values[1]) not in machine.forces:
        raise Unreadable(f"the force table {values[1]:g} is not set in the text")
    else:
        _on(machine, index(values[1]))


def _on(machine: StrictMachine, table: int) -> None:
    if machine.table is not None:
        raise Unreadable("force control is on already")
    machine.unused_forces.pop(table, None)
    if not machine.press(table):
        machine.fault("force control with no force")
    machine.emit_still(Force(*machine.pressing))


def _off(machine: StrictMachine) -> None:
    machine.press(None)
    machine.emit_still(Force(0.0))


@dataclass(frozen=True, slots=True)
class Template:
    """The N lines of an option.

    kind: "on", "change" or "off".
    patterns: pattern of each line.
    places: names of the places of each line, in order.
    starts: first character of each line, empty if it is a number.
    """

    kind: str
    patterns: tuple[re.Pattern[str], ...]
    places: tuple[tuple[str, ...], ...]
    starts: tuple[str, ...]


def read_templates(options: Mapping[str, object]) -> list[Template]:
    """The force templates of the options, longer ones first."""
    templates = [_template(kind, options.get(f"force_{kind}")) for kind in _KINDS]
    return sorted(filter(None, templates), key=lambda template: -len(template.patterns))


def may_say(known: list[Template], word: str) -> bool:
    """Whether a line of a template may start with `word`."""
    starts = chain.from_iterable(template.starts for template in known)
    return any(_may_start(start, word) for start in starts)


class ForceLines(NamedTuple):
    """The lines of a template in a text.

    kind: kind of the template.
    values: values of its places by name.
    line_count: number of its lines.
    """

    kind: str
    values: dict[str, float]
    line_count: int


def read_template(
    templates: list[Template], statements: Sequence[Statement], at: int
) -> ForceLines | None:
    """The lines of a template from `at` on, None without any."""
    for template in templates:
        count = len(template.patterns)
        values = _match(template, statements[at : at + count])
        if values is not None:
            return ForceLines(template.kind, values, count)
    return None


def run_template(run: StrictRun, lines: ForceLines) -> None:
    """Runs the lines of a template."""
    machine, values = run.machine, lines.values
    if lines.kind == "off":
        _off(machine)
        return
    vector: Vec3 = (values["x"], values["y"], values["z"])
    if "newtons" in values and abs(math.hypot(*vector) - values["newtons"]) > 0.01:
        machine.fault("the newtons of a force line are not those of its vector")
    number = values.get("n", machine.table or 1)
    if number != int(number):
        raise Unreadable(f"the force table {number:g} is not a whole number")
    table = int(number)
    _set_force(machine, table, vector)
    if lines.kind == "on" and machine.table is None:
        _on(machine, table)
    elif machine.table != table:
        machine.fault("a change of a force that is not on")


def _template(kind: str, lines: object) -> Template | None:
    if not isinstance(lines, (list, tuple)) or not all(isinstance(line, str) for line in lines):
        return None
    try:
        read = [_line(text) for text in map(without_comment, lines) if text]
    except ValueError:
        return None  # The braces do not match. No post accepts such a template.
    if not read:
        return None
    patterns, places, starts = zip(*read, strict=True)
    if kind != "off" and not {"x", "y", "z"} <= set(chain.from_iterable(places)):
        return None
    return Template(kind, patterns, places, starts)


def _line(text: str) -> tuple[re.Pattern[str], tuple[str, ...], str]:
    """The pattern of a line of a template, the names of its places, and its first character.

    The character is empty if the line starts with a number.
    """
    pattern, names, start = "", [], ""
    for literal, name, _, _ in string.Formatter().parse(text):
        bare = _bare(literal)
        start = start if pattern else bare[:1]
        pattern += re.escape(bare)
        if name is not None:
            pattern += _NUMBER
            names.append(name)
    return re.compile(pattern, re.IGNORECASE), tuple(names), start


def _may_start(start: str, text: str) -> bool:
    """Whether `text` may be a line with the first character `start`.

    This is always so if one of them is not ASCII.
    """
    first = text.lstrip()[:1]
    if not start:
        return first in ("+", "-") or first.isdecimal()
    return not (start + first).isascii() or start.lower() == first.lower()


def _match(template: Template, statements: Sequence[Statement]) -> dict[str, float] | None:
    if len(statements) < len(template.patterns):
        return None
    values: dict[str, float] = {}
    for statement, pattern, names, start in zip(
        statements, template.patterns, template.places, template.starts, strict=True
    ):
        text = statement.text
        # No motion is in the usual spelling if a template may look like one.
        if not isinstance(text, str) or not _may_start(start, text):
            return None
        match = pattern.fullmatch(_bare(text))
        if match is None:
            return None
        values.update(zip(names, map(float, match.groups()), strict=True))
    return values


def _bare(text: str) -> str:
    return re.sub(r"\s+", "", text)
