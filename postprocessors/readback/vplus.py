"""Read-back for Adept V+: what a ``.v2`` text says, found by carrying it out. Written from the manuals.

The one program that no other calls is run from its first to its last line. Programs that cannot be followed (tests,
jumps, arguments) are not guessed at: every such line is a fault.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import groupby

from msgspec.structs import replace

from camgen.errors import one_line
from camgen.ir import Instruction, MoveJ, MoveL
from camgen.pose import Pose
from camgen.post import Fault, Reading

from .vplus_places import BASE, NULL, Frame, Location, Unreadable
from .vplus_plain import Stretch
from .vplus_robot import Robot, same
from .vplus_run import Machine
from .vplus_text import Report, Routine, canonical, routines

#: Faults are messages of one line.
_WIDE = 160
#: The defaults of the post's options that give numbers their meaning (docs/posts/vplus.md).
_RATED, _SIGNALS, _TOOL, _WORK = 7500.0, {"process": 33}, "cg.tool", "cg.work"


def read(files: Mapping[str, str], options: Mapping[str, object]) -> Reading:
    """What the files say. options: ``rated``, ``signals``, and ``declare = false`` with ``tool`` and ``work``.

    A target ``frame:..`` is given in that frame when all targets name the same one, which then is ``work``; else all
    are given in the base, and ``work`` is the identity. A motion before BREAK stops (blend 0), another blends by 1 mm.
    """
    faults: dict[tuple[int, str], None] = {}

    def report(line: int, what: str) -> None:
        faults.setdefault((line, one_line(what)[:_WIDE]))

    machine = _run(files, options, report)
    work, body, lines = _translated(machine, report)
    ordered = sorted(faults, key=lambda f: f[0])
    return Reading(tuple(body), tuple(lines), tuple(Fault(line, what) for line, what in ordered), work, machine.tool)


def _run(files: Mapping[str, str], options: Mapping[str, object], report: Report) -> Machine:
    """The machine after it has run what the files say."""
    found = routines(files, report)
    programs: dict[str, Routine] = {}
    for routine in found:
        programs.setdefault(canonical(routine.name), routine)
    machine = Machine(programs, report, _rated(options), _signal_names(options), _known(options))
    for start in _start(list(programs.values()), report):
        machine.run(start)
    return machine


def _rated(options: Mapping[str, object]) -> float:
    value = options.get("rated", _RATED)
    return float(value) if isinstance(value, (int, float)) and value > 0 else _RATED


def _signal_names(options: Mapping[str, object]) -> dict[int, str]:
    table = options.get("signals", _SIGNALS)
    return {n: str(name) for name, n in table.items() if isinstance(n, int)} if isinstance(table, Mapping) else {}


def _known(options: Mapping[str, object]) -> frozenset[str]:
    """Locations that the text need not define."""
    if options.get("declare", True):
        return frozenset()
    return frozenset(canonical(str(options.get(key, name))) for key, name in (("tool", _TOOL), ("work", _WORK)))


def _start(found: list[Routine], report: Report) -> list[Routine]:
    """The program that no other calls; several: the first."""
    called = set()
    for routine in found:
        for statement in routine.statements:
            if not isinstance(statement, Stretch) and statement.word == "CALL":
                called.add(canonical(statement.rest.partition("(")[0].strip()))
    roots = [r for r in found if canonical(r.name) not in called] or found[:1]
    for other in roots[1:]:
        report(other.line, f"program {other.name} is called by no other and not evaluated")
    if not roots:
        report(1, "there is no .PROGRAM")
    return roots[:1]


def _translated(robot: Robot, report: Report) -> tuple[Pose | None, Sequence[Instruction], Sequence[int]]:
    """The common frame, the instructions with poses in it, and their lines."""
    # Most frames are the same object as the one before.
    given = [frame for frame, _ in groupby(robot.frames) if frame is not None]
    common = _common(given)
    if common is not None:
        return None if common.external else common.pose, robot.body, robot.lines
    if all(frame is BASE for frame in given):
        return NULL if given else None, robot.body, robot.lines
    body: list[Instruction] = []
    lines: list[int] = []
    for item, line, frame in zip(robot.body, robot.lines, robot.frames, strict=True):
        try:
            body.append(_in_base(item, frame))
        except Unreadable as error:
            report(line, f"the frames of the targets differ, and {error}")
            continue
        lines.append(line)
    return NULL, body, lines


def _in_base(item: Instruction, frame: Frame | None) -> Instruction:
    if frame is None or not isinstance(item, (MoveJ, MoveL)) or not isinstance(item.target, Pose):
        return item
    return replace(item, target=Location(item.target, frame).in_base())


def _common(given: list[Frame]) -> Frame | None:
    """One of the frames if all are the same, else nothing; nothing, too, if that is the base."""
    if not given:
        return None
    first = given[0]
    pose = first.pose
    for frame in given:
        if frame.external != first.external or frame.compound != first.compound:
            return None
        if frame.pose is not pose:
            if not same(frame.pose, pose):
                return None
            pose = frame.pose
    return first if first.compound or first.external else None
