"""How a RAPID program goes on: blocks, jumps, errors, loops and branches.

Where nothing in the text decides, the way that goes on is taken and said; a loop without end is run once.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, field

from camgen.lang.run import Budget, Ended, LoopRounds, Stopped

from .branches import Ways, hint
from .machine import Machine
from .tokens import Wrong
from .tree import Block, For, If, Label, Routine, Statement, Test, While
from .values import Unknown, Value, Variable, copied, find_unknown

#: Routines and blocks within each other.
_DEEPEST = 70
#: So often a loop is run that has a way out, before it is taken to have none.
_MOST_PASSES = 200
#: Runs of a statement whose error is handled by RETRY; controllers allow four.
_MOST_TRIES = 5


class Returned(Exception):
    """RETURN, with its value."""

    def __init__(self, value: Value) -> None:
        super().__init__()
        self.value = value


class Jump(Exception):
    """GOTO."""

    def __init__(self, label: str) -> None:
        super().__init__(label)
        self.label = label


class Raised(Exception):
    """RAISE: the error handler of the routine, or of whoever called it, is run. line: where it was raised."""

    def __init__(self, line: int) -> None:
        super().__init__(line)
        self.line = line


class Handled(Exception):
    """RETRY (again) or TRYNEXT in an error handler."""

    def __init__(self, again: bool) -> None:
        super().__init__(again)
        self.again = again


@dataclass(eq=False)
class Loop:
    """A loop as far as it has run: where the body was after its first pass, and what had changed by then."""

    passes: int = 0
    after_first: int = 0
    changes: int = -1
    rounds: LoopRounds = field(default_factory=LoopRounds)


@dataclass(eq=False)
class Flow(ABC):
    """Runs blocks of statements."""

    machine: Machine
    ways: Ways
    budget: Budget
    entry: Routine
    depth: int = 0
    handling: bool = False
    origin: int = 0  # where the error that is handled was raised
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
                except Jump as jump:
                    at = self._land(block, jump, item)
        finally:
            self.depth -= 1

    def enter(self) -> None:
        """One deeper."""
        if self.depth >= _DEEPEST:
            raise Stopped(f"routines call each other more than {_DEEPEST} deep")
        self.depth += 1

    def _land(self, block: Block, jump: Jump, item: Statement) -> int:
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
        self.budget.spend()
        for _ in range(_MOST_TRIES):
            try:
                self.perform(item)
            except Wrong as wrong:
                machine.log.find("refused", wrong.what, line=wrong.line or item.line)
            except Raised as raised:
                if self._tries_again(raised):
                    continue
            return
        raise Stopped(f"an error comes again after {_MOST_TRIES} tries")

    @abstractmethod
    def perform(self, item: Statement) -> None:
        """Does what a statement says."""

    # -- errors ----------------------------------------------------------------------------------------------------

    def _tries_again(self, raised: Raised) -> bool:
        """Runs the error handler of the routine for an error that was raised in a statement; whether it is RETRY."""
        routine = self.machine.scope.routine
        if routine is None or routine.handler is None or self.handling:
            raise raised
        self.handling, self.origin = True, raised.line
        try:
            self.run(routine.handler)
        except Handled as handled:
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
        machine.log.assume(f"{name} repeats without end: it is shown once")
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
            self.budget.spend()
            if endless and not escapes:
                loop.after_first = len(machine.body)
                self._end_loop(loop, "WHILE TRUE")
            if self._leave(item, loop, endless, before):
                return

    def _leave(self, item: While, loop: Loop, endless: bool, before: tuple[int, int]) -> bool:
        """Whether a loop is left that nothing in it ends."""
        machine = self.machine
        machine.line = item.line
        if self._repeats(loop) and endless:
            self._end_loop(loop, "WHILE TRUE")
        if machine.changes != before[0] and not loop.rounds.is_repeated(self._read_data):
            return False
        waits = before[1] == len(machine.body)
        what = (
            "waits for what nothing in it changes: it ends at once"
            if waits
            else "repeats: it is shown once"
        )
        machine.log.assume(f"a loop {what}")
        return True

    def _read_data(self) -> object:
        """The values of all data that the routine sees."""
        machine = self.machine
        levels = (machine.scope.data, machine.scope.home.data, machine.data)
        return [copied(variable.value) for level in levels for variable in level.values()]

    def _repeat_unknown(self, item: While, value: Unknown) -> None:
        """A loop whose condition is not known: one that moves is run once, one that waits ends."""
        machine = self.machine
        key, taken = hint(machine, item.condition, value, True)
        if self.ways.leads(item.body) and self.ways.moves(item.body):
            machine.log.assume(f"a loop asks {tell(value)}: it is run once", key, taken)
            self.run(item.body)
            return
        key, taken = hint(machine, item.condition, value, False)
        machine.log.assume(f"a loop asks {tell(value)}: it ends at once", key, taken)

    def count(self, item: For) -> None:
        """FOR; its variable is its own."""
        machine = self.machine
        first, last = machine.number(item.first), machine.number(item.last)
        step = machine.number(item.step) if item.step is not None else None
        unknown = next((v for v in (first, last, step) if isinstance(v, Unknown)), None)
        if unknown is not None:
            machine.log.assume(f"a FOR counts to {tell(unknown)}: it is run once", unknown.key)
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
                self.budget.spend()
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
                    machine.log.assume(f"an IF asks {tell(asked)}: it {what}", key, worth)
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
        machine.log.assume(f"a TEST asks {tell(unknown)}: the case {case} is taken", key, worth)
        self.run(blocks[taken])


def tell(unknown: Unknown) -> str:
    """What is not known, in words."""
    return unknown.what[:60] or "what is not known"
