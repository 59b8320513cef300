"""Runs a RAPID program once: its statements in their order, the routines that they call, the ways that lead on.

Where nothing in the text decides, the way that goes on is taken and said; a loop without end is run once.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

from camgen.model.instructions import Output

from .branches import Ways, hint
from .functions import call_function, name_of
from .instructions import EFFECTS, CycleEnded, Ended
from .machine import Frame, Home, Machine
from .motions import form_of, inline, move
from .tokens import Wrong
from .tree import (
    Assign,
    Block,
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
from .values import NOTHING, Unknown, Value, Variable, copied, find_unknown

#: Routines and blocks within each other.
_DEEPEST = 70
#: So often a loop is run that has a way out, before it is taken to have none.
_MOST_PASSES = 200
_TOO_LONG = "the program has not ended after what is run of it; limits.rapid_steps lets more run"
_MOST_CYCLES = 3
#: Runs of a statement whose error is handled by RETRY; controllers allow four.
_MOST_TRIES = 5
#: Passes after which all data are compared.
_LOOKED_AT = 16


class _Returned(Exception):
    """RETURN, with its value."""

    def __init__(self, value: Value) -> None:
        super().__init__()
        self.value = value


class _Jump(Exception):
    """GOTO."""

    def __init__(self, label: str) -> None:
        super().__init__(label)
        self.label = label


class _Raised(Exception):
    """RAISE: the error handler of the routine, or of whoever called it, is run. line: where it was raised."""

    def __init__(self, line: int) -> None:
        super().__init__(line)
        self.line = line


class _Handled(Exception):
    """RETRY (again) or TRYNEXT in an error handler."""

    def __init__(self, again: bool) -> None:
        super().__init__(again)
        self.again = again


class Stopped(Exception):
    """The program is not run any further: the line and the reason."""

    def __init__(self, line: int, what: str) -> None:
        super().__init__(line, what)
        self.line, self.what = line, what


@dataclass(eq=False)
class Loop:
    """A loop as far as it has run: where the body was after its first pass, and what had changed by then."""

    passes: int = 0
    after_first: int = 0
    changes: int = -1
    seen: list[Value] = field(default_factory=list)  # what all data were worth after a pass


@dataclass(eq=False)
class Runner:
    """What runs statements. most: statements that are run."""

    machine: Machine
    ways: Ways
    most: int
    entry: Routine
    steps: int = 0
    depth: int = 0
    handling: bool = False
    labels: dict[int, dict[str, int]] = field(default_factory=dict)
    jumps: dict[tuple[int, str], Loop] = field(default_factory=dict)

    # -- blocks ----------------------------------------------------------------------------------------------------

    def run(self, block: Block) -> None:
        """The statements of a block."""
        at = 0
        self.enter()
        try:
            while at < len(block):
                item = block[at]
                at += 1
                try:
                    self.step(item)
                except _Jump as jump:
                    at = self._land(block, jump, item)
        finally:
            self.depth -= 1

    def enter(self) -> None:
        """One deeper."""
        if self.depth >= _DEEPEST:
            raise Stopped(self.machine.line, f"routines call each other more than {_DEEPEST} deep")
        self.depth += 1

    def _land(self, block: Block, jump: _Jump, item: Statement) -> int:
        """Where a GOTO goes on in this block; raised on where its label is not in it."""
        labels = self.labels.get(id(block))
        if labels is None:
            labels = {one.name: place for place, one in enumerate(block) if isinstance(one, Label)}
            self.labels[id(block)] = labels
        if jump.label not in labels:
            raise jump
        place = labels[jump.label]
        if any(one is item for one in block[:place]):
            return place
        loop = self.jumps.setdefault((id(block), jump.label), Loop())
        if self._repeats(loop):
            self._end_loop(loop, f"GOTO {jump.label}")
        return place

    def step(self, item: Statement) -> None:
        """One statement; an error in it that no handler takes is noted, and what follows is run."""
        machine = self.machine
        machine.line = item.line
        self.steps += 1
        if self.steps > self.most:
            raise Stopped(item.line, _TOO_LONG)
        for _ in range(_MOST_TRIES):
            try:
                _RUN[type(item)](self, item)
            except Wrong as wrong:
                machine.find("refused", wrong.what, wrong.line or item.line)
            except _Raised as raised:
                if self._tries_again(raised):
                    continue
            return
        raise Stopped(item.line, f"an error comes again after {_MOST_TRIES} tries")

    # -- errors ----------------------------------------------------------------------------------------------------

    def _tries_again(self, raised: _Raised) -> bool:
        """Runs the error handler of the routine for an error that was raised in a statement; whether it is RETRY."""
        routine = self.machine.scope.routine
        if routine is None or routine.handler is None or self.handling:
            raise raised
        self.handling = True
        try:
            self.run(routine.handler)
        except _Handled as handled:
            return handled.again
        finally:
            self.handling = False
        raise raised

    # -- loops -----------------------------------------------------------------------------------------------------

    def _repeats(self, loop: Loop) -> bool:
        """Counts a pass; whether the loop has no end that this run would come to."""
        machine = self.machine
        loop.passes += 1
        if loop.passes == 1:
            loop.after_first = len(machine.body)
        same = loop.changes == machine.changes
        loop.changes = machine.changes
        return (same and loop.passes > 1) or loop.passes > _MOST_PASSES

    def _end_loop(self, loop: Loop, name: str) -> None:
        """A loop without end: what it does is shown once, and the program is over."""
        machine = self.machine
        for kept in (machine.body, machine.lines, machine.frame_of):
            del kept[loop.after_first :]
        machine.assume(f"{name} repeats without end: it is shown once")
        raise Ended

    def repeat(self, item: While) -> None:
        """WHILE."""
        machine, loop = self.machine, Loop()
        endless = item.condition is True
        escapes = self.ways.escapes(item.body)
        while True:
            machine.line = item.line
            value = machine.truth(item.condition, "WHILE")
            if isinstance(value, Unknown):
                self._repeat_unknown(item, value)
                return
            if not value:
                return
            before = machine.changes, len(machine.body)
            self.run(item.body)
            self._tick(item.line)
            if endless and not escapes:
                loop.after_first = len(machine.body)
                self._end_loop(loop, "WHILE TRUE")
            if self._leave(item, loop, endless, before):
                return

    def _tick(self, line: int) -> None:
        """A pass costs a statement, so that empty ones end too."""
        self.steps += 1
        if self.steps > self.most:
            raise Stopped(line, _TOO_LONG)

    def _leave(self, item: While, loop: Loop, endless: bool, before: tuple[int, int]) -> bool:
        """Whether a loop is left that nothing in it ends."""
        machine = self.machine
        machine.line = item.line
        if self._repeats(loop) and endless:
            self._end_loop(loop, "WHILE TRUE")
        if machine.changes != before[0] and not self._stands_still(loop):
            return False
        waits = before[1] == len(machine.body)
        what = "waits for what nothing in it changes: it ends at once" if waits else "repeats: it is shown once"
        machine.assume(f"a loop {what}")
        return True

    def _stands_still(self, loop: Loop) -> bool:
        """Whether a pass left all data as the one before it did; looked at now and then, since it takes its time."""
        if loop.passes < _LOOKED_AT or (loop.passes & (loop.passes - 1) and (loop.passes - 1) & (loop.passes - 2)):
            return False
        machine = self.machine
        levels = (machine.scope.data, machine.scope.home.data, machine.data)
        now = [copied(variable.value) for level in levels for variable in level.values()]
        same = now == loop.seen
        loop.seen = now
        return same and bool(loop.passes & (loop.passes - 1))

    def _repeat_unknown(self, item: While, value: Unknown) -> None:
        """A loop whose condition is not known: one that moves is run once, one that waits ends."""
        machine = self.machine
        key, taken = hint(machine, item.condition, value, True)
        if self.ways.leads(item.body) and self.ways.moves(item.body):
            machine.assume(f"a loop asks {_tell(value)}: it is run once", key, taken)
            self.run(item.body)
            return
        key, taken = hint(machine, item.condition, value, False)
        machine.assume(f"a loop asks {_tell(value)}: it ends at once", key, taken)

    def count(self, item: For) -> None:
        """FOR; its variable is its own."""
        machine = self.machine
        first, last = machine.number(item.first), machine.number(item.last)
        step = machine.number(item.step) if item.step is not None else None
        unknown = next((v for v in (first, last, step) if isinstance(v, Unknown)), None)
        if unknown is not None:
            machine.assume(f"a FOR counts to {_tell(unknown)}: it is run once", unknown.key)
            first = last = first if type(first) is float else 1.0
            step = 1.0
        if step is None:
            step = 1.0 if first <= last else -1.0
        key = item.name.lower()
        hidden = machine.scope.data.get(key)
        counter = machine.scope.data[key] = Variable(item.name, "num", "counter", first)
        try:
            at = first
            while step != 0 and (at <= last if step > 0 else at >= last):
                counter.value = at
                self.run(item.body)
                self._tick(item.line)
                at += step
        finally:
            if hidden is None:
                machine.scope.data.pop(key, None)
            else:
                machine.scope.data[key] = hidden

    # -- branches --------------------------------------------------------------------------------------------------

    def choose(self, item: If) -> None:
        """IF: the first branch whose condition holds; where one is not known, the one that leads on."""
        machine = self.machine
        for place, (condition, block) in enumerate(item.branches):
            machine.line = item.line
            value = machine.truth(condition, "IF")
            if isinstance(value, Unknown):
                self._choose_unknown(item, place, value)
                return
            if value:
                self.run(block)
                return
        if item.otherwise is not None:
            self.run(item.otherwise)

    def _choose_unknown(self, item: If, place: int, value: Unknown) -> None:
        """The branch that leads on, of those from ``place`` on."""
        machine = self.machine
        open_ones = item.branches[place:]
        blocks = [block for _, block in open_ones] + [item.otherwise or ()]
        taken = self.ways.choose(blocks)
        for at, (condition, _) in enumerate(open_ones):
            holds = at == taken
            if at <= taken:
                asked = machine.value(condition) if at else value
                if isinstance(asked, Unknown):
                    key, worth = hint(machine, condition, asked, holds)
                    what = "is taken to hold" if holds else "is taken not to hold"
                    machine.assume(f"an IF asks {_tell(asked)}: it {what}", key, worth)
        self.run(blocks[taken])

    def select(self, item: Test) -> None:
        """TEST: the case with the value; where it is not known, the one that leads on."""
        machine = self.machine
        value = machine.value(item.value)
        unknown = find_unknown(value)
        if unknown is None:
            for values, block in item.cases:
                worths = [machine.value(one) for one in values]
                unknown = unknown or find_unknown(worths)
                if value in worths:
                    self.run(block)
                    return
            if unknown is None:
                self.run(item.otherwise or ())
                return
        blocks = [block for _, block in item.cases] + [item.otherwise or ()]
        taken = self.ways.choose(blocks)
        case, key, worth = "DEFAULT", "", 0.0
        if taken < len(item.cases):
            found = machine.value(item.cases[taken][0][0])
            case = f"{found:g}" if type(found) is float else ascii(found)[:40]
            key, worth = (unknown.key, found) if type(found) is float else ("", 0.0)
        machine.assume(f"a TEST asks {_tell(unknown)}: the case {case} is taken", key, worth)
        self.run(blocks[taken])

    # -- routines --------------------------------------------------------------------------------------------------

    def call(self, routine: Routine, call: Call) -> Value:
        """Runs a routine with its arguments; what a FUNC gives."""
        machine = self.machine
        if routine is self.entry and self.depth > 0:
            machine.assume(f"{routine.name} calls itself: it is shown once")
            raise Ended
        data = self._bind(routine, call)
        home = machine.homes[routine]
        outer, line = machine.scope, machine.line
        self.enter()
        machine.scope = Frame(routine, home, data)
        for one in routine.data:
            data[one.name.lower()] = machine.declare(one, home)
        handling, self.handling = self.handling, False
        try:
            self.run(routine.body)
        except _Returned as returned:
            return returned.value
        except _Jump as jump:
            machine.find("refused", f"GOTO {jump.label[:40]}: there is no such label where it could go to")
        finally:
            self.depth -= 1
            self.handling = handling
            machine.scope, machine.line = outer, line
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
                found[one.name] = self._parameter(one, options.get(one.name)) if given else _absent(one)
            elif args:
                found[one.name] = self._parameter(one, args.pop(0))
            else:
                raise Wrong(call.line, f"{routine.name} has {len(needed)} arguments, not {len(call.args)}")
        if args:
            raise Wrong(call.line, f"{routine.name} has {len(needed)} arguments, not {len(call.args)}")
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
        made = Variable(one.name, one.type, "parameter", machine.settled(one.type, machine.value(value)))
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


def _tell(unknown: Unknown) -> str:
    return unknown.what[:60] or "what is not known"


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
    _leave_out(runner, call)


def _leave_out(runner: Runner, call: Call) -> None:
    """An instruction of a package, or a routine of another file."""
    if call.name == "callbyvar" and call.args:
        machine = runner.machine
        name, number = machine.value(call.args[0]), machine.number(call.args[1]) if len(call.args) > 1 else NOTHING
        if isinstance(name, str) and type(number) is float:
            _call_by_name(runner, f"{name}{number:g}", Call(call.line, "callbyvar"))
            return
    runner.machine.assume(f"{call.name} is in none of the files: it is left out")


def _call_by_name(runner: Runner, name: Value, call: Call) -> None:
    machine = runner.machine
    if not isinstance(name, str):
        what = find_unknown(name)
        machine.assume(
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
        machine.assume(f"{plain[:40]} is in none of the files: it is left out")
        return
    _run_call(runner, Call(call.line, plain, call.args, call.options))


def _run_in(runner: Runner, home: Home, routine: Routine, call: Call) -> None:
    """A routine that is local to a module which its name says."""
    assert runner.machine.homes[routine] is home
    runner.call(routine, call)


def _run_late(runner: Runner, item: Late) -> None:
    _call_by_name(runner, runner.machine.value(item.name), Call(item.line, "", item.args, item.options))


def _run_assign(runner: Runner, item: Assign) -> None:
    runner.machine.assign(item.target, runner.machine.value(item.value))


def _run_goto(_runner: Runner, item: Goto) -> None:
    raise _Jump(item.name)


def _run_word(runner: Runner, item: Word) -> None:
    """RETURN, RAISE, RETRY, TRYNEXT, EXIT."""
    if item.name == "return":
        raise _Returned(NOTHING if item.value is None else runner.machine.value(item.value))
    if item.name == "raise":
        raise _Raised(item.line)
    if item.name in ("retry", "trynext"):
        if not runner.handling:
            raise Wrong(item.line, f"{item.name.upper()} outside of an error handler")
        raise _Handled(item.name == "retry")
    raise Ended


def _run_connect(runner: Runner, item: Connect) -> None:
    runner.machine.assume(f"the interrupt {item.trap} does not come")


def _run_empty(_runner: Runner, item: Empty) -> None:
    raise Wrong(item.line, f"{item.text}: a place that is not filled in; the controller stops there")


def _run_inline(runner: Runner, item: Inline) -> None:
    machine = runner.machine
    if form_of(item.shape.name) is None or machine.routine(item.shape.name) is not None:
        _run_call(runner, item.call())
    else:
        inline(machine, item)


_RUN: dict[type, Callable[[Runner, Value], None]] = {
    Inline: _run_inline,
    Call: _run_call, Assign: _run_assign, If: Runner.choose, For: Runner.count, While: Runner.repeat,
    Test: Runner.select, Label: lambda _runner, _item: None, Goto: _run_goto, Word: _run_word,
    Connect: _run_connect, Late: _run_late, Empty: _run_empty,
}  # fmt: skip


# The whole ------------------------------------------------------------------------------------------------------


def run_entry(machine: Machine, entry: Routine, most: int) -> tuple[int, str] | None:
    """Runs a program from its entry; line and reason where it is not run to its end."""
    runner = Runner(machine, Ways(machine), most, entry)
    machine.call, machine.function = runner.call, call_function
    try:
        _run_cycles(runner, entry)
    except Ended:
        pass
    except Stopped as stopped:
        return stopped.line, stopped.what
    except _Raised as raised:
        return raised.line, "an error is raised that no handler takes"
    except _Handled:
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
        machine.find("dangerous", "the arc still burns at the end: ArcLEnd is missing")
    for name in dict.fromkeys(item.signal for item in machine.body if isinstance(item, Output)):
        if machine.outputs.get(name.lower()):
            machine.tell("on at the end", name)
    if machine.pressing is not None:
        machine.find("dangerous", "force control is still on at the end: FCPressEnd is missing")
