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
from camgen.lang.flow import Choice, Counter, Flow, Raised, Rules
from camgen.lang.log import Log
from camgen.lang.run import Budget, Ended, Stopped
from camgen.lang.values import Unknown
from camgen.model.instructions import Output

from .choices import log_choice
from .code import CountRange, LoopVariable, Question, moves
from .functions import call_function, name_of
from .instructions import EFFECTS, CycleEnded
from .interrupts import come, connect, judge_trap
from .machine import Frame, Machine
from .motions import form_of, inline, move
from .tokens import Wrong
from .tree import (
    Assign,
    Calling,
    Component,
    Connect,
    Element,
    Expr,
    Inline,
    Late,
    Maybe,
    Parameter,
    Ref,
    Routine,
    Statement,
    Word,
    find_root,
)
from .values import NOTHING, Value, Variable, copied, find_unknown

#: Routines that may wait for the end of one that they call.
_DEEPEST = 70
#: Rounds of a loop without a condition. After them it has no end.
_MOST_ROUNDS = 200
_RULES = Rules(_DEEPEST, skips_blocks=True, round_limit=_MOST_ROUNDS)
#: Types of PERS data that routines take to move with, and leave as they are.
_READ_ONLY = frozenset(("tooldata", "wobjdata", "loaddata"))
#: So many TRAPs are looked at beside the program.
_MOST_TRAPS = 50
#: Statements of a TRAP that is looked at beside the program.
_MOST_OF_A_TRAP = 5_000
#: Times that a program begins anew without having moved.
_MOST_CYCLES = 3


class Runner:
    """What runs statements and routines.

    entry: routine in which the program begins.
    flow: run of the steps.
    ran: routines that were run.
    """

    faults: type[Exception] = Wrong

    def __init__(self, machine: Machine, entry: Routine, budget: Budget) -> None:
        self.machine, self.entry = machine, entry
        self.flow = Flow(self, budget, _RULES)
        self.ran: set[Routine] = set()

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
            self.call(trap, Calling(machine.line, trap.name.lower()))
        machine.blending = blending

    def interrupt_motion(self, machine: Machine, interrupt: Expr) -> None:
        """An interrupt at a place of a motion: a TRAP that does not move runs there, others behind the motion."""
        come(machine, interrupt)
        self.interrupt([trap for trap in machine.due if not moves(machine.codes[trap])])

    def call(self, routine: Routine, call: Calling) -> Value:
        """Runs a routine with its arguments; what a FUNC gives."""
        machine = self.machine
        if routine is self.entry and machine.scope.routine is not None:
            machine.log.assume(f"{routine.name} calls itself: it is shown once")
            raise Ended
        self.flow.check_depth(f"routines call each other more than {_DEEPEST} deep")
        data = self._bind(routine, call)
        self.ran.add(routine)
        home = machine.homes[routine]
        outer, line = machine.scope, machine.line
        frame = machine.scope = Frame(routine, home, data)
        for one in routine.data:
            data[one.name.lower()] = machine.declare(one, home)
        try:
            self.flow.run(machine.codes[routine])
        finally:
            machine.scope = outer
        machine.line = line
        return frame.result

    def _bind(self, routine: Routine, call: Calling) -> dict[str, Variable]:
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

    # Answers to the engine (`camgen.lang.flow.Language`).

    @property
    def log(self) -> Log:
        """Findings and assumptions."""
        return self.machine.log

    def begin(self, step: Step) -> None:
        """A step begins."""
        self.machine.line = step.line

    def evaluate(self, expression: Question | LoopVariable | Expr) -> Value:
        """The value of a condition, of the variable of a FOR, or of a TEST."""
        if isinstance(expression, Question):
            return self.machine.truth(expression.value, expression.word)
        if isinstance(expression, LoopVariable):
            return expression.value
        value = self.machine.value(expression)
        return find_unknown(value) or value

    to_number = staticmethod(float)

    def matches(self, value: Value, tests: tuple[Expr, ...]) -> bool | Unknown:
        """Whether one of the values of a CASE is the value of its TEST."""
        values = [self.machine.value(test) for test in tests]
        return value in values or find_unknown(values) or False

    def open_count(self, count: CountRange) -> Counter:
        """The variable and the bounds of a FOR. It counts down if the last value is smaller."""
        machine = self.machine
        machine.scope.drop_counters(count.around)
        first, last = machine.number(count.first), machine.number(count.last)
        step = 1.0 if count.step is None else machine.number(count.step)
        variable = LoopVariable(machine.scope.add_counter(count.name), first)
        for value in (first, last, step):
            if isinstance(value, Unknown):
                return Counter(variable, first if type(first) is float else 1.0, unknown=value)
        if count.step is None and first > last:
            step = -1.0
        if step == 0:
            # No round brings the variable nearer to its last value.
            return Counter(variable, first, -math.inf)
        return Counter(variable, first, last, step)

    def assign(self, target: LoopVariable, value: float) -> None:
        """Set the variable of a FOR."""
        target.value = target.variable.value = value

    def count_instructions(self) -> int:
        """The number of instructions so far."""
        return len(self.machine.body)

    def read_state(self) -> object:
        """The values of all data that the routine sees."""
        machine = self.machine
        homes = {id(home): home.data for home in machine.homes.values()}
        state: list[Value] = []
        for level in (machine.scope.data, machine.data, *homes.values()):
            state += [copied(variable.value) for variable in level.values()]
        return state

    def assume(
        self, choice: Choice, step: Step, unknown: Unknown | None = None, length: int = 0
    ) -> bool:
        """Tell a choice of the engine."""
        log_choice(self.machine, choice, step, unknown, length)
        return True

    def report(self, step: Step, error: Exception) -> None:
        """Tell that a controller cannot carry out a step."""
        assert isinstance(error, Wrong)
        self.log.find("refused", error.what, line=error.line or step.line)


def _absent(one: Parameter) -> Variable:
    return Variable(one.name, one.type, "absent", Unknown(f"{one.name}, which is not given"))


# Statements -----------------------------------------------------------------------------------------------------


def _run_call(runner: Runner, call: Calling) -> None:
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


def _leave_out(runner: Runner, call: Calling) -> None:
    """An instruction of a package, or a routine of another file."""
    if call.name == "callbyvar" and call.args:
        machine = runner.machine
        name, number = (
            machine.value(call.args[0]),
            machine.number(call.args[1]) if len(call.args) > 1 else NOTHING,
        )
        if isinstance(name, str) and type(number) is float:
            _call_by_name(runner, f"{name}{number:g}", Calling(call.line, "callbyvar"))
            return
    runner.machine.log.leave_out(f"{call.name} is in none of the files: it is left out")
    _forget_arguments(runner.machine, call)


def _forget_arguments(machine: Machine, call: Calling) -> None:
    """Give the variables that a routine of another file may set an unknown value."""
    for argument in (*call.args, *(value for _, value in call.options)):
        if not isinstance(argument, (Ref, Component, Element)):
            continue
        root = find_root(argument)
        variable = machine.variable(root.name) if isinstance(root, Ref) else None
        if variable is None or variable.storage not in ("var", "pers"):
            continue
        if variable.storage == "var" or machine.kind(variable.type) not in _READ_ONLY:
            machine.assign(argument, Unknown(f"what {call.name} gives to {variable.name}"))


def _call_by_name(runner: Runner, name: Value, call: Calling) -> None:
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
        runner.call(home.routines[plain], call)
        return
    if (module and home is None) or (
        machine.routine(plain) is None and plain not in EFFECTS and form_of(plain) is None
    ):
        machine.log.leave_out(f"{plain[:40]} is in none of the files: it is left out")
        return
    _run_call(runner, Calling(call.line, plain, call.args, call.options))


def _run_late(runner: Runner, item: Late) -> None:
    _call_by_name(
        runner, runner.machine.value(item.name), Calling(item.line, "", item.args, item.options)
    )


def _run_assign(runner: Runner, item: Assign) -> None:
    machine = runner.machine
    try:
        value = machine.value(item.value)
    except Wrong:
        # The run goes on. The value that was there before would cause further findings.
        with suppress(Wrong):
            machine.assign(item.target, Unknown("a value that is refused"))
        raise
    machine.assign(item.target, value)


def _run_word(runner: Runner, item: Word) -> None:
    """RETURN and RAISE with a value."""
    value = runner.machine.value(item.value)
    if item.name == "return":
        runner.machine.scope.result = value
        return
    runner.machine.data["errno"] = Variable("ERRNO", "errnum", "var", value)
    raise Raised(item.line)


def _run_inline(runner: Runner, item: Inline) -> None:
    machine = runner.machine
    if form_of(item.shape.name) is None or machine.routine(item.shape.name) is not None:
        _run_call(runner, item.call())
    else:
        inline(machine, item)


_RUN: dict[type, Callable[[Runner, Any], None]] = {
    Inline: _run_inline,
    Calling: _run_call,
    Assign: _run_assign,
    Word: _run_word,
    Connect: lambda runner, item: connect(runner.machine, item),
    Late: _run_late,
}


# The whole ------------------------------------------------------------------------------------------------------


def run_entry(machine: Machine, entry: Routine, statements: int) -> tuple[int, str] | None:
    """Run a program from its entry. Return line and reason where it does not run to its end.

    statements: number of statements of the text at most.
    """
    budget = Budget(statements, machine.ask.limits.rapid_steps, "rapid_steps")
    runner = Runner(machine, entry, budget)
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
        runner.flow = Flow(runner, Budget(0, _MOST_OF_A_TRAP, "rapid_steps"), _RULES)
        call = Calling(routine.line, routine.name.lower())
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
    except RecursionError:
        return machine.line, "statements within each other, too deep"
    return None


def _run_cycles(runner: Runner, entry: Routine) -> None:
    """The entry; again where it ends a cycle before it has moved, since data tell it what to do next."""
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
