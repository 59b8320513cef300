"""Read-back for Adept V+: what a ``.v2`` text says, found by carrying it out. Written from the manuals.

The one program that no other calls is run from its first to its last line. Programs that cannot be followed (tests,
jumps, arguments) are not guessed at: every such line is a fault.
"""

from __future__ import annotations

from collections.abc import Mapping

from camgen.errors import one_line
from camgen.ir import Instruction, Joints, MoveJ, MoveL
from camgen.pose import Pose
from camgen.post import Fault, Reading

from .vplus_expr import NULL, Location, Unreadable
from .vplus_robot import Other, Step, same
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

    found = routines(files, report)
    programs: dict[str, Routine] = {}
    for routine in found:
        programs.setdefault(canonical(routine.name), routine)
    machine = Machine(programs, report, _rated(options), _signal_names(options), _known(options))
    for start in _start(list(programs.values()), report):
        machine.run(start)
    work, body, lines = _translated(machine.steps, report)
    ordered = sorted(faults, key=lambda f: f[0])
    return Reading(body, lines, tuple(Fault(line, what) for line, what in ordered), work, machine.tool)


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
            if statement.word == "CALL":
                called.add(canonical(statement.rest.partition("(")[0].strip()))
    roots = [r for r in found if canonical(r.name) not in called] or found[:1]
    for other in roots[1:]:
        report(other.line, f"program {other.name} is called by no other and not evaluated")
    if not roots:
        report(1, "there is no .PROGRAM")
    return roots[:1]


def _translated(
    steps: list[Step | Other], report: Report
) -> tuple[Pose | None, tuple[Instruction, ...], tuple[int, ...]]:
    """The common frame, the instructions with poses in it, and their lines."""
    targets = [s.target for s in steps if isinstance(s, Step) and isinstance(s.target, Location)]
    common = _common(targets)
    body: list[Instruction] = []
    lines: list[int] = []
    for step in steps:
        if isinstance(step, Step):
            try:
                body.append(_motion(step, common))
            except Unreadable as error:
                report(step.line, f"the frames of the targets differ, and {error}")
                continue
            lines.append(step.line)
        else:
            lines.append(step[0])
            body.append(step[1])
    work = common.frame if common is not None and not common.external else None
    if common is None and targets:
        work = NULL
    return work, tuple(body), tuple(lines)


def _motion(step: Step, common: Location | None) -> Instruction:
    target = step.target
    if isinstance(target, Joints):
        return MoveJ(target, step.speed, step.blend)
    pose = target.local if common is not None else target.in_base()
    return MoveL(pose, step.speed, step.blend) if step.straight else MoveJ(pose, step.speed, step.blend)


def _common(targets: list[Location]) -> Location | None:
    """One of the targets if all have the same frame, else nothing."""
    if not targets:
        return None
    first = targets[0]
    frame = first.frame
    for target in targets:
        if target.external != first.external or target.compound != first.compound:
            return None
        if target.frame is not frame:
            if not same(target.frame, frame):
                return None
            frame = target.frame
    return first if first.compound or first.external else None
