"""Reads a DENSO PacScript program of a post back: text -> instructions, findings by line.

The run is that of the language with a strict profile: what no program of the post has is a finding,
and so is a setting that is not that of the options. A line that is not evaluated (conditions,
loops, free curves, extended axes) is refused; nothing is guessed. The facts and their sources are
listed in docs/posts/pacscript.md.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial

from camgen.lang.programs import Executed, Frames
from camgen.model.program import MoveC, MoveJ, MoveL

from . import force
from .machine import StrictMachine
from .run import StrictRun
from .statements import compile_strictly

#: Number of statements beyond which a program counts as endless.
_STEPS = 2_000_000


def read(files: Mapping[str, str], options: Mapping[str, object]) -> Executed:
    """Runs a program.

    options: options of the post. rated, rated_turn, mps, signals, force_on, force_change and
        force_off give what the text does not state. The text must agree with those of `Expected`.

    A blend of `@P` is 1 mm, as its radius is up to the controller. Speeds in percent refer to
    `rated`. If `mps` does not name a unit, both units must result in the same speeds.
    Raises JobError if an option has the wrong type.
    """
    compiler = partial(compile_strictly, templates=force.read_templates(options))
    run = StrictRun(files, options, _STEPS, compiler)
    machine = run.machine
    if run.run_main():
        _finish(machine)
    work, tool = (machine.defined.get((kind, machine.numbers[kind])) for kind in ("work", "tool"))
    return Executed(
        tuple(machine.body),
        tuple(machine.lines),
        (Frames(base_from_work=work, flange_from_tool=tool),),
        findings=machine.log.list_findings(),
    )


def _finish(machine: StrictMachine) -> None:
    """Adds findings for the state at the end of the program, and for all that was assumed."""
    if machine.passing:
        moves = zip(machine.body, machine.lines, strict=True)
        lines = [line for item, line in moves if isinstance(item, MoveJ | MoveL | MoveC)]
        machine.log.find("refused", "the last motion passes its target", line=lines[-1])
    if machine.table is not None:
        machine.fault("force control is on at the end")
    if machine.armed:
        machine.remark("the arm is not given back")
    force.note_unused(machine, *machine.unused_forces)
    machine.check_end()
    for assumption in machine.log.list_assumed():
        machine.log.find("refused", assumption.what, line=assumption.line)
    for line, what in (*machine.log.list_lost(), *machine.log.list_omitted()):
        machine.log.find("refused", what, line=line)
