"""Runs a RAPID program once: its statements in their order, the routines that they call, the ways that lead on.

Where nothing in the text decides, the way that goes on is taken and said; a loop without end is run once.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial

from camgen.lang.run import Budget, Ended, Stopped
from camgen.model.instructions import Output

from .branches import Ways
from .flow import Flow, Handled, Jump, Raised, Returned
from .functions import call_function, name_of
from .instructions import EFFECTS, CycleEnded
from .interrupts import come, connect, judge_trap
from .machine import Frame, Home, Machine
from .motions import form_of, inline, move
from .tokens import Wrong
from .tree import (
    Assign,
    Call,
    Component,
    Connect,
    Element,
    Empty,
    Expr,
    For,
    Goto,
    If,
    Inline,
    Label,
    Late,
    Maybe,
    Parameter,
    Ref,
    Routine,
    Statement,
    Test,
    While,
    Word,
)
from .values import NOTHING, Unknown, Value, Variable, find_unknown

#: So many TRAPs are looked at beside the program.
_MOST_TRAPS = 50
#: Statements of a TRAP that is looked at beside the program.
_MOST_OF_A_TRAP = 5_000
#: Times that a program begins anew without having moved.
_MOST_CYCLES = 3


@dataclass(eq=False)
class Runner(Flow):
    """What runs statements and routines. ran: routines that were run."""

    ran: set[Routine] = field(default_factory=set)

    def perform(self, item: Statement) -> None:
        """Does what a statement says; behind it run the TRAPs whose interrupts have come."""
        _RUN[type(item)](self, item)
        if self.machine.due:
            self.interrupt(self.machine.due)

    def interrupt(self, due: list[Routine]) -> None:
        """Runs TRAPs whose interrupts have come, unless they wait. They may switch while the arm moves."""
        machine = self.machine
        blending, machine.blending = machine.blending, 0
        while due and not machine.held:
            trap = due.pop(0)
            if trap in machine.due:
                machine.due.remove(trap)
            self.call(trap, Call(machine.line, trap.name.lower()))
        machine.blending = blending

    def interrupt_motion(self, machine: Machine, interrupt: Expr) -> None:
        """An interrupt at a place of a motion: a TRAP that does not move runs there, others behind the motion."""
        come(machine, interrupt)
        self.interrupt([trap for trap in machine.due if not self.ways.moves(trap.body)])

    def call(self, routine: Routine, call: Call) -> Value:
        """Runs a routine with its arguments; what a FUNC gives."""
        machine = self.machine
        if routine is self.entry and self.depth > 0:
            machine.log.assume(f"{routine.name} calls itself: it is shown once")
            raise Ended
        data = self._bind(routine, call)
        self.ran.add(routine)
        home = machine.homes[routine]
        outer, line = machine.scope, machine.line
        self.enter()
        machine.scope = Frame(routine, home, data)
        for one in routine.data:
            data[one.name.lower()] = machine.declare(one, home)
        handling, self.handling = self.handling, False
        try:
            self.run(routine.body)
        except Returned as returned:
            machine.line = line
            return returned.value
        except Jump as jump:
            machine.log.find(
                "refused", f"GOTO {jump.label[:40]}: there is no such label where it could go to"
            )
        finally:
            self.depth -= 1
            self.handling = handling
            machine.scope = outer
        machine.line = line
        return NOTHING

    def _bind(self, routine: Routine, call: Call) -> dict[str, Variable]:
        """The data that a routine's parameters are."""
        options = {name: value for name, value in call.options if not self._is_absent(value)}
        args = list(call.args)
        needed = [one for one in routine.parameters if not one.optional]
        found: dict[str, Variable] = {}
        for one in routine.parameters:
            if one.optional or one.name in options:
                given = one.name in options
                found[one.name] = (
                    self._parameter(one, options.get(one.name)) if given else _absent(one)
                )
            elif args:
                found[one.name] = self._parameter(one, args.pop(0))
            else:
                raise Wrong(
                    call.line, f"{routine.name} has {len(needed)} arguments, not {len(call.args)}"
                )
        if args:
            raise Wrong(
                call.line, f"{routine.name} has {len(needed)} arguments, not {len(call.args)}"
            )
        for name in options:
            if name not in found:
                raise Wrong(call.line, f"{routine.name} has no argument \\{name[:40]}")
        return found

    def _is_absent(self, value: Expr | None) -> bool:
        if not isinstance(value, Maybe):
            return False
        variable = self.machine.variable(value.name)
        return variable is None or variable.storage == "absent"

    def _parameter(self, one: Parameter, value: Expr | None) -> Variable:
        """The data that a parameter is: those of the argument themselves where it may change them."""
        machine = self.machine
        if isinstance(value, Maybe):
            value = Ref(value.name)
        if one.type.startswith("signal") and isinstance(value, Ref):
            name = name_of(machine, value)
            return Variable(one.name, one.type, "parameter", Unknown(name, name.lower()))
        if one.mode and isinstance(value, (Ref, Component, Element)):
            found = machine.place(value)
            if found is not None:
                variable, path, kind, dims = found
                if not path and variable.storage != "absent":
                    return variable
                part = Variable(variable.name, kind, variable.storage)
                part.base, part.dims = (variable, path), (0.0,) * dims
                return part
        if value is None:
            return Variable(one.name, "switch", "parameter", True)
        made = Variable(
            one.name, one.type, "parameter", machine.settled(one.type, machine.value(value))
        )
        made.dims = (0.0,) * one.dims
        return self._named_frame(made, value)

    def _named_frame(self, made: Variable, value: Expr) -> Variable:
        """A tool or a work object that is handed on keeps its name."""
        if made.type in ("tooldata", "wobjdata") and isinstance(value, Ref):
            variable = self.machine.variable(value.name)
            made.name = value.name if variable is None else variable.name
        return made


def _absent(one: Parameter) -> Variable:
    return Variable(one.name, one.type, "absent", Unknown(f"{one.name}, which is not given"))


# Statements -----------------------------------------------------------------------------------------------------


def _run_call(runner: Runner, call: Call) -> None:
    machine = runner.machine
    routine = machine.routine(call.name)
    if routine is not None:
        if routine.kind == "func":
            raise Wrong(call.line, f"{routine.name} is a FUNC, no statement")
        runner.call(routine, call)
        return
    if form_of(call.name) is not None:
        move(machine, call)
        return
    effect = EFFECTS.get(call.name)
    if effect is not None:
        effect(machine, call)
        return
    if call.name in ("raisetouser", "errraise"):
        raise Raised(call.line)
    _leave_out(runner, call)


def _leave_out(runner: Runner, call: Call) -> None:
    """An instruction of a package, or a routine of another file."""
    if call.name == "callbyvar" and call.args:
        machine = runner.machine
        name, number = (
            machine.value(call.args[0]),
            machine.number(call.args[1]) if len(call.args) > 1 else NOTHING,
        )
        if isinstance(name, str) and type(number) is float:
            _call_by_name(runner, f"{name}{number:g}", Call(call.line, "callbyvar"))
            return
    runner.machine.log.leave_out(f"{call.name} is in none of the files: it is left out")


def _call_by_name(runner: Runner, name: Value, call: Call) -> None:
    machine = runner.machine
    if not isinstance(name, str):
        what = find_unknown(name)
        machine.log.leave_out(
            f"a routine is called by a name that is not known{f' ({what.what[:40]})' if what else ''}: left out"
        )
        return
    module, _, plain = name.strip().lower().rpartition(":")
    home = next((one for one in machine.homes.values() if one.name.lower() == module), None)
    if home is not None and plain in home.routines:
        _run_in(runner, home, home.routines[plain], call)
        return
    if (module and home is None) or (
        machine.routine(plain) is None and plain not in EFFECTS and form_of(plain) is None
    ):
        machine.log.leave_out(f"{plain[:40]} is in none of the files: it is left out")
        return
    _run_call(runner, Call(call.line, plain, call.args, call.options))


def _run_in(runner: Runner, home: Home, routine: Routine, call: Call) -> None:
    """A routine that is local to a module which its name says."""
    assert runner.machine.homes[routine] is home
    runner.call(routine, call)


def _run_late(runner: Runner, item: Late) -> None:
    _call_by_name(
        runner, runner.machine.value(item.name), Call(item.line, "", item.args, item.options)
    )


def _run_assign(runner: Runner, item: Assign) -> None:
    runner.machine.assign(item.target, runner.machine.value(item.value))


def _run_goto(_runner: Runner, item: Goto) -> None:
    raise Jump(item.name)


def _run_word(runner: Runner, item: Word) -> None:
    """RETURN, RAISE, RETRY, TRYNEXT, EXIT."""
    if item.name == "return":
        raise Returned(NOTHING if item.value is None else runner.machine.value(item.value))
    if item.name == "raise":
        if item.value is not None:
            machine = runner.machine
            machine.data["errno"] = Variable("ERRNO", "errnum", "var", machine.value(item.value))
        raise Raised(runner.origin if runner.handling and item.value is None else item.line)
    if item.name in ("retry", "trynext"):
        if not runner.handling:
            raise Wrong(item.line, f"{item.name.upper()} outside of an error handler")
        raise Handled(item.name == "retry")
    raise Ended


def _run_connect(runner: Runner, item: Connect) -> None:
    connect(runner.machine, item)


def _run_empty(_runner: Runner, item: Empty) -> None:
    raise Wrong(
        item.line, f"{item.text}: a place that is not filled in; the controller stops there"
    )


def _run_inline(runner: Runner, item: Inline) -> None:
    machine = runner.machine
    if form_of(item.shape.name) is None or machine.routine(item.shape.name) is not None:
        _run_call(runner, item.call())
    else:
        inline(machine, item)


_RUN: dict[type, Callable[[Runner, Value], None]] = {
    Inline: _run_inline,
    Call: _run_call, Assign: _run_assign, If: Flow.choose, For: Flow.count, While: Flow.repeat,
    Test: Flow.select, Label: lambda _runner, _item: None, Goto: _run_goto, Word: _run_word,
    Connect: _run_connect, Late: _run_late, Empty: _run_empty,
}  # fmt: skip


# The whole ------------------------------------------------------------------------------------------------------


def run_entry(machine: Machine, entry: Routine, statements: int) -> tuple[int, str] | None:
    """Run a program from its entry. Return line and reason where it does not run to its end.

    statements: number of statements of the text at most.
    """
    budget = Budget(statements, machine.ask.limits.rapid_steps, "rapid_steps")
    runner = Runner(machine, Ways(machine), budget, entry)
    machine.call, machine.function, machine.interrupt = (
        runner.call,
        call_function,
        runner.interrupt_motion,
    )
    stopped = _run_whole(runner, lambda: _run_cycles(runner, entry))
    for routine in machine.homes:
        if routine.kind == "proc" and routine not in runner.ran:
            machine.log.fact("not run", routine.name)
    waiting = [one for one in machine.homes if one.kind == "trap" and one not in runner.ran]
    for routine in waiting[:_MOST_TRAPS]:
        runner.depth = 0
        runner.budget = Budget(0, _MOST_OF_A_TRAP, "rapid_steps")
        call = Call(routine.line, routine.name.lower())
        judge_trap(
            machine, routine, partial(_run_whole, runner, partial(runner.call, routine, call))
        )
    return stopped


def _run_whole(runner: Runner, run: Callable[[], object]) -> tuple[int, str] | None:
    machine = runner.machine
    try:
        run()
    except Ended:
        pass
    except Stopped as stopped:
        return machine.line, str(stopped)
    except Raised as raised:
        return raised.line, "an error is raised that no handler takes"
    except Handled:
        return machine.line, "RETRY or TRYNEXT outside of an error handler"
    except RecursionError:
        return machine.line, "statements within each other, too deep"
    return None


def _run_cycles(runner: Runner, entry: Routine) -> None:
    """The entry; again where it ends a cycle before it has moved, since data tell it what to do next."""
    machine = runner.machine
    for _ in range(_MOST_CYCLES):
        changes = machine.changes
        try:
            runner.call(entry, Call(entry.line, entry.name.lower()))
        except CycleEnded:
            if machine.body or machine.changes == changes:
                raise
            continue
        return


def judge_end(machine: Machine, line: int) -> None:
    """What is left on at the end."""
    machine.line = line
    if machine.welding:
        machine.log.find("dangerous", "the arc still burns at the end: ArcLEnd is missing")
    for name in dict.fromkeys(item.signal for item in machine.body if isinstance(item, Output)):
        if machine.outputs.get(name.lower()):
            machine.log.fact("on at the end", name)
    if machine.pressing is not None:
        machine.log.find("dangerous", "force control is still on at the end: FCPressEnd is missing")
