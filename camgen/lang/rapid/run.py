"""Runs a RAPID program once: its statements, the routines that they call, and its interrupts.

The engine runs the steps (`camgen.lang.flow`). It gets values here, and reports its choices here.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from typing import Any

from camgen.lang.code import Step
from camgen.lang.flow import Choice, Counter, Flow, MachineLanguage, Raised, Rules
from camgen.lang.run import Budget, Ended, Stopped
from camgen.lang.values import Unknown
from camgen.model.instructions import Output

from .choices import log_choice
from .code import CountRange, LoopVariable, Question, moves
from .functions import call_function, is_given, name_of
from .instructions import EFFECTS, CycleEnded
from .interrupts import connect, queue_trap, run_trap_aside
from .machine import Machine, RoutineScope
from .motions import find_form, move, move_inline
from .tokens import Wrong
from .tree import (
    Assign,
    CallByName,
    Calling,
    Component,
    Connect,
    Element,
    Expr,
    Inline,
    Maybe,
    Parameter,
    Ref,
    Routine,
    Statement,
    Word,
    find_root,
)
from .values import Value, Variable, copy_arrays, find_unknown

#: Depth of calls of routines within each other.
_DEEPEST = 70
#: Rounds of a loop without a condition. More rounds mean an endless loop.
_MOST_ROUNDS = 200
_RULES = Rules(_DEEPEST, skips_blocks=True, round_limit=_MOST_ROUNDS)
#: Types of PERS data that a routine of another file uses but does not set.
_READ_ONLY = frozenset(("tooldata", "wobjdata", "loaddata"))
#: Number of TRAPs without an interrupt that are run after the program.
_MOST_TRAPS = 50
#: Steps of such a TRAP.
_MOST_OF_A_TRAP = 5_000
#: Number of cycles of a program that has not moved.
_MOST_CYCLES = 3


class Runner(MachineLanguage):
    """The run of a program.

    entry: routine in which the program begins.
    flow: engine that runs the steps.
    ran: routines that were run.
    """

    faults: type[Exception] = Wrong

    def __init__(self, machine: Machine, entry: Routine, budget: Budget) -> None:
        self.machine, self.log, self.entry = machine, machine.log, entry
        self.flow = Flow(self, budget, _RULES)
        self.ran: set[Routine] = set()

    def perform(self, item: Statement) -> None:
        """Run a statement, and then the TRAPs whose interrupts have come."""
        _RUN[type(item)](self, item)
        if self.machine.due:
            self.interrupt(self.machine.due)

    def interrupt(self, due: list[Routine]) -> None:
        """Run TRAPs whose interrupts have come, unless interrupts are disabled."""
        machine = self.machine
        # An output that a TRAP sets in a corner is not a finding.
        blending, machine.blending = machine.blending, 0
        while due and not machine.held:
            trap = due.pop(0)
            if trap in machine.due:
                machine.due.remove(trap)
            self.call(trap, Calling(machine.line, trap.name.lower()))
        machine.blending = blending

    def interrupt_motion(self, machine: Machine, interrupt: Expr) -> None:
        """Run the TRAP of an interrupt at a place of a motion. A TRAP that moves runs after it."""
        queue_trap(machine, interrupt)
        self.interrupt([trap for trap in machine.due if not moves(machine.codes[trap])])

    def call(self, routine: Routine, call: Calling) -> Value:
        """Run a routine with its arguments and return the value of a FUNC."""
        machine = self.machine
        if routine is self.entry and machine.scope.routine is not None:
            machine.log.assume(f"{routine.name} calls itself: it is shown once")
            raise Ended
        self.flow.check_depth(f"routines call each other more than {_DEEPEST} deep")
        data = self._bind(routine, call)
        self.ran.add(routine)
        home = machine.homes[routine]
        outer, line = machine.scope, machine.line
        frame = machine.scope = RoutineScope(routine, home, data)
        for declaration in routine.data:
            data[declaration.name.lower()] = machine.declare(declaration, home)
        try:
            self.flow.run(machine.codes[routine])
        finally:
            machine.scope = outer
        machine.line = line
        return frame.result

    def _bind(self, routine: Routine, call: Calling) -> dict[str, Variable]:
        """The data of a routine's parameters by name.

        Raises Wrong for a missing or surplus argument.
        """
        options = dict(item for item in call.options if is_given(self.machine, item[1]))
        args = list(call.args)
        needed = sum(not parameter.optional for parameter in routine.parameters)
        what = f"{routine.name} has {needed} arguments, not {len(call.args)}"
        data: dict[str, Variable] = {}
        for parameter in routine.parameters:
            name = parameter.name
            if name in options:
                data[name] = self._parameter(parameter, options[name])
            elif parameter.optional:
                value = Unknown(f"{name}, which is not given")
                data[name] = Variable(name, parameter.type, "absent", value)
            elif args:
                data[name] = self._parameter(parameter, args.pop(0))
            else:
                raise Wrong(call.line, what)
        if args:
            raise Wrong(call.line, what)
        for name in options:
            if name not in data:
                raise Wrong(call.line, f"{routine.name} has no argument \\{name[:40]}")
        return data

    def _parameter(self, parameter: Parameter, value: Expr | None) -> Variable:
        """The data of a parameter: a copy, or the argument's own data if the mode allows changes.

        A switch has no value. A tool or a work object keeps its name.
        """
        machine, name, kind = self.machine, parameter.name, parameter.type
        if isinstance(value, Maybe):
            value = Ref(value.name)
        if kind.startswith("signal") and isinstance(value, Ref):
            signal = name_of(machine, value)
            return Variable(name, kind, "parameter", Unknown(signal, signal.lower()))
        if parameter.mode and isinstance(value, (Ref, Component, Element)):
            place = machine.place(value)
            if place is not None:
                return _share(*place)
        if value is None:
            return Variable(name, "switch", "parameter", True)
        copy = Variable(name, kind, "parameter", machine.settled(kind, machine.value(value)))
        copy.dims = (0.0,) * parameter.dims
        if kind in ("tooldata", "wobjdata") and isinstance(value, Ref):
            variable = machine.variable(value.name)
            copy.name = value.name if variable is None else variable.name
        return copy

    # Answers to the engine (`camgen.lang.flow.Language`).

    def evaluate(self, expression: Question | LoopVariable | Expr) -> Value:
        """The value of a condition, of the variable of a FOR, or of the expression of a TEST."""
        if isinstance(expression, Question):
            return self.machine.truth(expression.value, expression.word)
        if isinstance(expression, LoopVariable):
            return expression.value
        value = self.machine.value(expression)
        return find_unknown(value) or value

    def matches(self, value: Value, tests: tuple[Expr, ...]) -> bool | Unknown:
        """Whether a CASE has the value of its TEST among its values."""
        values = [self.machine.value(test) for test in tests]
        return value in values or find_unknown(values) or False

    def open_count(self, count: CountRange) -> Counter:
        """The variable and the bounds of a FOR. It counts down if the last value is smaller."""
        machine = self.machine
        loop = count.loop
        machine.scope.drop_counters(count.around)
        first, last = machine.number(loop.first), machine.number(loop.last)
        step = 1.0 if loop.step is None else machine.number(loop.step)
        variable = LoopVariable(machine.scope.add_counter(loop.name), first)
        for value in (first, last, step):
            if isinstance(value, Unknown):
                return Counter(variable, first if type(first) is float else 1.0, unknown=value)
        if loop.step is None and first > last:
            step = -1.0
        if step == 0:
            # The variable never reaches its last value.
            return Counter(variable, first, -math.inf)
        return Counter(variable, first, last, step)

    def assign(self, target: LoopVariable, value: float) -> None:
        """Set the variable of a FOR."""
        target.value = target.variable.value = value

    def read_state(self) -> object:
        """The values of all data that the routine sees."""
        machine = self.machine
        homes = {id(home): home.data for home in machine.homes.values()}
        state: list[Value] = []
        for level in (machine.scope.data, machine.data, *homes.values()):
            state += [copy_arrays(variable.value) for variable in level.values()]
        return state

    def assume(
        self, choice: Choice, step: Step, unknown: Unknown | None = None, length: int = 0
    ) -> bool:
        """Log a choice of the engine."""
        log_choice(self.machine, choice, step, unknown, length)
        return True

    def report(self, step: Step, error: Exception) -> None:
        """Log that a controller cannot carry out a step."""
        assert isinstance(error, Wrong)
        self.log.find("refused", error.what, line=error.line or step.line)


def _share(variable: Variable, path: tuple[int, ...], kind: str, dims: int) -> Variable:
    if not path and variable.storage != "absent":
        return variable
    part = Variable(variable.name, kind, variable.storage)
    part.base, part.dims = (variable, path), (0.0,) * dims
    return part


# Statements --------------------------------------------------------------------------------------


def _run_call(runner: Runner, call: Calling) -> None:
    machine = runner.machine
    routine = machine.routine(call.name)
    if routine is not None and routine.kind == "func":
        raise Wrong(call.line, f"{routine.name} is a FUNC, no statement")
    if routine is not None:
        runner.call(routine, call)
    elif find_form(call.name) is not None:
        move(machine, call)
    elif call.name in EFFECTS:
        EFFECTS[call.name](machine, call)
    elif call.name in ("raisetouser", "errraise"):
        raise Raised(call.line)
    else:
        _leave_out(runner, call)


def _leave_out(runner: Runner, call: Calling) -> None:
    """Leave out an instruction of a package or a routine of another file; run CallByVar."""
    machine = runner.machine
    if call.name == "callbyvar" and call.args:
        name = machine.value(call.args[0])
        number = machine.number(call.argument(1))
        if isinstance(name, str) and type(number) is float:
            _call_by_name(runner, f"{name}{number:g}", Calling(call.line, "callbyvar"))
            return
    machine.log.leave_out(f"{call.name} is in none of the files: it is left out")
    _forget_arguments(machine, call)


def _forget_arguments(machine: Machine, call: Calling) -> None:
    """Set the variables that a routine of another file may change to an unknown value."""
    for argument in call.values:
        if not isinstance(argument, (Ref, Component, Element)):
            continue
        root = find_root(argument)
        variable = machine.variable(root.name) if isinstance(root, Ref) else None
        if variable is not None and (
            variable.storage == "var"
            or (variable.storage == "pers" and machine.kind(variable.type) not in _READ_ONLY)
        ):
            machine.assign(argument, Unknown(f"what {call.name} gives to {variable.name}"))


def _call_by_name(runner: Runner, name: Value, call: Calling) -> None:
    machine = runner.machine
    if not isinstance(name, str):
        unknown = find_unknown(name)
        source = f" ({unknown.what[:40]})" if unknown else ""
        machine.log.leave_out(f"a routine is called by a name that is not known{source}: left out")
        return
    module, _, plain = name.strip().lower().rpartition(":")
    home = next((home for home in machine.homes.values() if home.name.lower() == module), None)
    if home is not None and plain in home.routines:
        runner.call(home.routines[plain], call)
        return
    is_known = (
        machine.routine(plain) is not None or plain in EFFECTS or find_form(plain) is not None
    )
    if is_known and not (module and home is None):
        _run_call(runner, Calling(call.line, plain, call.args, call.options))
    else:
        machine.log.leave_out(f"{plain[:40]} is in none of the files: it is left out")


def _run_late(runner: Runner, item: CallByName) -> None:
    name = runner.machine.value(item.name)
    _call_by_name(runner, name, Calling(item.line, "", item.args, item.options))


def _run_assign(runner: Runner, item: Assign) -> None:
    machine = runner.machine
    try:
        value = machine.value(item.value)
    except Wrong:
        # The run continues. With its old value the target would cause further findings.
        with suppress(Wrong):
            machine.assign(item.target, Unknown("a value that is refused"))
        raise
    machine.assign(item.target, value)


def _run_word(runner: Runner, item: Word) -> None:
    value = runner.machine.value(item.value)
    if item.name == "return":
        runner.machine.scope.result = value
    else:
        runner.machine.data["errno"] = Variable("ERRNO", "errnum", "var", value)
        raise Raised(item.line)


def _run_inline(runner: Runner, item: Inline) -> None:
    machine = runner.machine
    if find_form(item.shape.name) is None or machine.routine(item.shape.name) is not None:
        _run_call(runner, item.call())
    else:
        move_inline(machine, item)


_RUN: dict[type, Callable[[Runner, Any], None]] = {
    Inline: _run_inline,
    Calling: _run_call,
    Assign: _run_assign,
    Word: _run_word,
    Connect: lambda runner, item: connect(runner.machine, item),
    CallByName: _run_late,
}


# Programs ----------------------------------------------------------------------------------------


def run_entry(machine: Machine, entry: Routine, statements: int) -> tuple[int, str] | None:
    """Run a program from its entry, then the TRAPs whose interrupts did not come.

    Returns line and reason if the program stops before its end, else None.

    statements: upper limit of the number of statements of the text.
    """
    budget = Budget(statements, machine.request.limits.rapid_steps, "rapid_steps")
    runner = Runner(machine, entry, budget)
    machine.call, machine.function = runner.call, call_function
    machine.interrupt = runner.interrupt_motion
    stopped = _run_whole(runner, lambda: _run_cycles(runner, entry))
    for routine in machine.homes:
        if routine.kind == "proc" and routine not in runner.ran:
            machine.log.fact("not run", routine.name)
    traps = [trap for trap in machine.homes if trap.kind == "trap" and trap not in runner.ran]
    for trap in traps[:_MOST_TRAPS]:
        runner.flow = Flow(runner, Budget(0, _MOST_OF_A_TRAP, "rapid_steps"), _RULES)
        call = partial(runner.call, trap, Calling(trap.line, trap.name.lower()))
        run_trap_aside(machine, trap, partial(_run_whole, runner, call))
    return stopped


def _run_whole(runner: Runner, run: Callable[[], object]) -> tuple[int, str] | None:
    """Run to the end, to EXIT, or to a stop. Returns line and reason of a stop."""
    machine = runner.machine
    try:
        run()
    except Ended:
        pass
    except Stopped as stopped:
        return machine.line, str(stopped)
    except Raised as raised:
        return raised.line, "an error is raised that no handler takes"
    except Wrong as wrong:
        machine.log.find("refused", wrong.what, line=wrong.line)
        return wrong.line, wrong.what
    except RecursionError:
        return machine.line, "statements within each other, too deep"
    return None


def _run_cycles(runner: Runner, entry: Routine) -> None:
    """Run the entry, and again if it ends its cycle before it has moved but has changed data."""
    machine = runner.machine
    for _ in range(_MOST_CYCLES):
        changes = machine.changes
        try:
            runner.call(entry, Calling(entry.line, entry.name.lower()))
        except CycleEnded:
            if machine.body or machine.changes == changes:
                raise
            continue
        return


def report_end(machine: Machine, line: int) -> None:
    """Add findings and facts about signals, welding and force that are on at the end."""
    machine.line = line
    if machine.welding:
        machine.log.find("dangerous", "the arc still burns at the end: ArcLEnd is missing")
    for name in dict.fromkeys(item.signal for item in machine.body if isinstance(item, Output)):
        if machine.outputs.get(name.lower()):
            machine.log.fact("on at the end", name)
    if machine.pressing is not None:
        machine.log.find("dangerous", "force control is still on at the end: FCPressEnd is missing")
