"""The run of a routine's steps: branches, loops, jumps and calls, for all languages.

What a program asks for may be unknown, such as an input. Then one branch is chosen:

- A branch that leaves for good is avoided. If the program comes back to this place in a loop
  without a condition, the loop is left that way after one round.
- Otherwise the guess of the language counts, if it has one. A loop is then run for a number of
  rounds, unless its end can be assumed.
- Otherwise the branch that acts is entered. A loop that acts and does not leave for good is run
  once, another loop not at all.
- If a loop without a count asks for the same value again, the other branch is entered: something
  outside ends the loop.
- Of several cases that do not leave, the first one that acts is entered, or else the first one
  that has steps.

An error of the program continues at the handler of the routine, or of the one that called it. A
handler may end with the step that raised the error, or with the one after it.

A loop whose condition holds and that repeats itself is left: something outside ends it. A loop
without a condition is left too, or it ends the program, as the rules of the language say.

The language adds each choice to its log in its own words. Another run may take another option at a
choice (`RunRequest.shifts`).
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable
from enum import Enum, auto
from typing import Any, Protocol

from msgspec import Struct, field

from camgen.lang.code import (
    Act,
    Branch,
    Call,
    Code,
    CountEnd,
    CountStart,
    End,
    Handle,
    Jump,
    JumpTable,
    LoopEnd,
    LoopStart,
    Raise,
    Resume,
    Return,
    Select,
    Step,
)
from camgen.lang.log import Log
from camgen.lang.run import Budget, Ended, LimitReached, LoopRounds, Stopped
from camgen.lang.values import Unknown

#: Calls of labels within a routine that may wait for their return.
_CALL_LIMIT = 100
#: Runs of a step whose error a handler answers by running it again.
_TRY_LIMIT = 5


class Raised(Exception):
    """The program raises an error, and the routine that runs has no handler.

    line: line of the step that raised it.
    """

    def __init__(self, line: int) -> None:
        super().__init__(line)
        self.line = line


class Choice(Enum):
    """A choice that the text does not determine."""

    BRANCH_ENTERED = auto()
    BRANCH_PASSED = auto()
    LOOP_RUN_ONCE = auto()
    #: A loop is not entered, or not run again.
    LOOP_ENDED = auto()
    #: A loop that is guessed to go on is left after its rounds.
    LOOP_LIMITED = auto()
    #: A loop without a condition is left after one round where a branch could have left it.
    LOOP_LEFT = auto()
    #: A loop repeats itself. It is left.
    LOOP_REPEATS = auto()
    #: A loop has no end. The program ends after one of its rounds.
    LOOP_ENDLESS = auto()
    FIRST_CASE = auto()
    FIRST_LABEL = auto()


class Counter(Struct, gc=False):
    """A counted loop that runs.

    target: its variable, as the language names it.
    first: first value, unknown if one of the three is unknown.
    last: last value.
    step: difference of two values.
    unknown: the first of the three that is unknown.
    """

    target: Any
    first: Any
    last: float = 0.0
    step: float = 1.0
    unknown: Unknown | None = None

    def has(self, value: float) -> bool:
        """Return whether the loop runs with this value."""
        return value <= self.last if self.step >= 0 else value >= self.last


class Rules(Struct, frozen=True):
    """The rules in which languages differ.

    depth_limit: number of routines that may wait for the end of one that they call.
    rounds: rounds of a loop that is guessed to go on. The program goes on after a loop without a
        condition. None: it ends there, and conditions are not guessed.
    skips_blocks: whether a block is passed whose first step cannot be carried out.
    round_limit: rounds of a loop without a condition. After them it has no end, even if its state
        differs after each round. None: the limit of steps ends it.
    """

    depth_limit: int
    rounds: int | None = None
    skips_blocks: bool = False
    round_limit: int | None = None


class Language(Protocol):
    """A language, as the run needs it.

    The defaults of `matches` and `assume` raise `faults`, so that the step is not run.

    faults: class of the exceptions for a step that cannot be carried out.
    log: findings and assumptions.
    """

    faults: type[Exception]
    log: Log

    def begin(self, step: Step) -> None:
        """Take note that a step runs now."""

    def evaluate(self, expression: Any, /) -> Any:
        """Return the value of an expression or of a condition, Unknown if it has none."""

    def to_number(self, value: Any) -> float:
        """Return a value as a number."""
        return float(value)

    def matches(self, value: Any, tests: Any) -> bool | Unknown:
        """Return whether a value selects a case."""
        raise self.faults(f"the case {tests} of {value} is not evaluated")

    def open_count(self, count: Any) -> Counter:
        """Return the counter and the bounds of a counted loop."""

    def assign(self, target: Any, value: Any) -> None:
        """Set the variable of a counted loop."""

    def count_instructions(self) -> int:
        """Return the number of instructions so far."""

    def read_state(self) -> object:
        """Return what the next round of a loop depends on, comparable by `==`.

        None for a state that is too large to keep, and if other limits end such a loop.
        """
        return None

    def assume(
        self, choice: Choice, step: Step, unknown: Unknown | None = None, length: int = 0
    ) -> bool:
        """Add a choice to the log. Return whether it can be made.

        step: branch, or first step of the loop.
        unknown: the value that the choice depends on.
        length: number of instructions before the round that a loop repeats; for a loop without end,
            number of instructions after its first round; for a case, its index.
        """
        del unknown, length
        raise self.faults(f"{choice.name} of line {step.line} is not evaluated")

    def report(self, step: Step, error: Exception) -> None:
        """Add a step that cannot be carried out to the log."""


class MachineLanguage(Language, Protocol):
    """A language whose run has a machine, with the line that runs and the instructions so far."""

    machine: Any

    def begin(self, step: Step) -> None:
        """Take note that a step runs now."""
        self.machine.line = step.line

    def count_instructions(self) -> int:
        """Return the number of instructions so far."""
        return len(self.machine.body)


class CallFrame(Struct, gc=False):
    """A routine that runs.

    counters: counted loops, by the index of their first step.
    rounds: rounds of each loop, by the index of its first step, or of the jump that repeats it.
    undecided: indices of loops that were entered without a known condition.
    exits: branches not taken that leave for good, by the index of their condition.
    branch_choices: indices of the branches with an unknown condition, each with the unknown value.
    returns: indices of the steps to which calls of labels return.
    handler: index of the step of the error handler, -1 without one.
    error: error that the handler has taken last, None without one.
    failed: index of the step that raised it.
    tries: number of runs of steps that a handler ran again, by their index.
    """

    code: Code
    counters: dict[int, Counter] = field(default_factory=dict)
    rounds: defaultdict[int, LoopRounds] = field(default_factory=lambda: defaultdict(LoopRounds))
    undecided: set[int] = field(default_factory=set)
    exits: dict[int, range] = field(default_factory=dict)
    branch_choices: set[tuple[int, str]] = field(default_factory=set)
    returns: list[int] = field(default_factory=list)
    handler: int = -1
    error: Raised | None = None
    failed: int = -1
    tries: dict[int, int] = field(default_factory=dict)


class Flow:
    """The run of a program."""

    def __init__(self, language: Language, budget: Budget, rules: Rules) -> None:
        self._language = language
        self._budget = budget
        self._rules = rules
        self._depth = 0

    def check_depth(self, reason: str) -> None:
        """LimitReached with a reason if one more call is too deep."""
        if self._depth > self._rules.depth_limit:
            raise LimitReached(reason)

    def run(self, code: Code, start: int = 0, within: range | None = None) -> None:
        """Run a routine to its end. Ended and Stopped end the program, Raised is an error of it.

        start: index of the first step. A routine may begin inside the steps of another one.
        within: indices of the steps. The run ends when the next step is another one.
        """
        if within is None:
            within = range(len(code.steps))
        self._depth += 1
        try:
            self._run(CallFrame(code), start, within)
        except LimitReached:
            self._language.log.is_limited = True
            raise
        finally:
            self._depth -= 1
            self._language.log.steps = self._budget.spent

    def _run(self, frame: CallFrame, at: int, within: range) -> None:
        steps = frame.code.steps
        begin, spend, faults = self._language.begin, self._budget.spend, self._language.faults
        ran = self._language.log.ran
        while at in within:
            step = steps[at]
            begin(step)
            ran.add(step.line)
            spend(step.cost)
            try:
                at = _RUN[type(step)](self, frame, at, step)
            except Raised as error:
                if frame.handler < 0:
                    raise
                frame.error, frame.failed = error, at
                at = frame.handler
            except faults as error:
                self._language.report(step, error)
                at = self._skip(step, at)

    def _skip(self, step: Step, at: int) -> int:
        """Return the index of the step after one that cannot be carried out."""
        if not self._rules.skips_blocks or not isinstance(step, _OPENING):
            return at + 1
        return step.end if isinstance(step, Branch) else step.to

    def _act(self, frame: CallFrame, at: int, step: Act) -> int:
        after = step.do(self._language, step.operand)
        if isinstance(after, Step):
            return _RUN[type(after)](self, frame, at, after)
        if step.lines > 1:
            self._language.log.ran.add(step.line + step.lines - 1)
        return at + 1

    # -- branches ------------------------------------------------------------------------------

    def _is_true(self, value: Any) -> bool | Unknown:
        if isinstance(value, (bool, Unknown)):
            return value
        return bool(self._language.to_number(value))

    def _branch(self, frame: CallFrame, at: int, step: Branch) -> int:
        condition = step.condition
        holds = self._is_true(self._language.evaluate(condition.value))
        if isinstance(holds, Unknown):
            is_entered = self._choose_branch(frame, at, step, holds)
            if self._is_asked_again(frame, at, holds):
                is_entered = not is_entered
            is_entered = self._decide(holds, default=is_entered)
            choice = Choice.BRANCH_ENTERED if is_entered else Choice.BRANCH_PASSED
            if not self._language.assume(choice, step, holds):
                is_entered = not is_entered
        else:
            is_entered = holds == condition.wanted
        return at + 1 if is_entered else step.to

    def _decide(self, unknown: Unknown, *, default: bool) -> bool:
        """Return whether a block is entered whose condition is unknown.

        default: whether it is entered by default.
        """
        return self._language.log.decide(unknown.what, 0 if default else 1, 2) == 0

    def _choose_branch(self, frame: CallFrame, at: int, step: Branch, unknown: Unknown) -> bool:
        code = frame.code
        branch, alternative = code.list_branches(at)
        if unknown.guess is not None:
            return unknown.guess and not (step.is_leaving and not alternative)
        others = code.list_alternatives(at)
        staying = [block for block in others if not code.leaves(block)]
        if step.is_leaving == bool(staying):
            frame.exits[at] = branch if step.is_leaving else alternative
            return not step.is_leaving
        is_idle = any(map(code.acts, staying or others)) and not code.acts(branch)
        return not is_idle and not step.condition.is_unlikely

    def _is_asked_again(self, frame: CallFrame, at: int, unknown: Unknown) -> bool:
        """Take note of a choice of a branch. Return whether the same value was chosen for before.

        Nothing in the text ends a loop that asks again, so that something outside does. A counted
        loop ends by itself.
        """
        steps = frame.code.steps
        is_counted = any(start < at < steps[start].to for start in frame.counters)
        if unknown.guess is not None or is_counted:
            return False
        choice = at, unknown.what
        is_again = choice in frame.branch_choices
        frame.branch_choices.add(choice)
        return is_again

    def _select(self, frame: CallFrame, _at: int, step: Select) -> int:
        value = self._language.evaluate(step.value)
        unknown = value if isinstance(value, Unknown) else None
        for case in step.cases if unknown is None else ():
            matches = case.tests is None or self._language.matches(value, case.tests)
            if isinstance(matches, Unknown):
                unknown = unknown or matches
            elif matches and (case.tests is not None or unknown is None):
                return case.to
        if unknown is None:
            return step.to
        default = self._choose_case(frame.code, step)
        number = self._language.log.decide(unknown.what, default, max(len(step.cases), 1))
        self._language.assume(Choice.FIRST_CASE, step, unknown, number)
        return step.cases[number].to if step.cases else step.to

    def _choose_case(self, code: Code, step: Select) -> int:
        starts = [case.to for case in step.cases]
        # The last step of a case leads to the step after the block.
        ends = [*(start - 1 for start in starts[1:]), step.to]
        cases = [range(start, end) for start, end in zip(starts, ends, strict=False)]
        staying = [number for number, case in enumerate(cases) if not code.leaves(case)]
        acting = [number for number in staying if code.acts(cases[number])]
        filled = [number for number in staying if cases[number]]
        return next(iter(acting or filled or staying), 0)

    # -- jumps ---------------------------------------------------------------------------------

    def _jump(self, frame: CallFrame, at: int, step: Jump) -> int:
        if step.to < 0:
            raise Stopped(f"there is no label {step.label}")
        if step.to <= at:
            return self._repeat(frame, range(step.to, at + 1), at)
        if step.is_exit:
            self._leave_loops(frame, at, step.to)
        return step.to

    def _leave_loops(self, frame: CallFrame, at: int, target: int) -> None:
        """Forget the rounds of the loops that a jump from `at` leaves."""
        for start in list(frame.rounds):
            if start < at < frame.code.steps[start].to <= target:
                del frame.rounds[start]

    def _call(self, frame: CallFrame, at: int, step: Call) -> int:
        start = frame.code.labels.get(step.label)
        if start is None:
            self._language.log.find("refused", f"there is no label {step.label}")
            return at + 1
        if len(frame.returns) > _CALL_LIMIT:
            raise Stopped("GoSub without end")
        frame.returns.append(at + 1)
        return start

    def _jump_by_number(self, frame: CallFrame, at: int, step: JumpTable) -> int:
        value = self._language.evaluate(step.value)
        if isinstance(value, Unknown):
            self._language.assume(Choice.FIRST_LABEL, step, value)
            number = 1
        else:
            number = int(self._language.to_number(value))
        label = step.labels[number - 1] if 1 <= number <= len(step.labels) else None
        if label not in frame.code.labels:
            return at + 1
        if step.is_call:
            frame.returns.append(at + 1)
        target = frame.code.labels[label]
        self._leave_loops(frame, at, target)
        return target

    def _return(self, frame: CallFrame, _at: int, step: Return) -> int:
        if step.is_to_call and frame.returns:
            return frame.returns.pop()
        return len(frame.code.steps)

    def _handle(self, frame: CallFrame, at: int, step: Handle) -> int:
        frame.handler = frame.code.labels.get(step.label, -1)
        return at + 1

    def _raise(self, frame: CallFrame, _at: int, step: Raise) -> int:
        if step.is_again and frame.error is not None:
            raise frame.error
        raise Raised(step.line)

    def _resume(self, frame: CallFrame, _at: int, step: Resume) -> int:
        failed = frame.failed
        if not step.is_again:
            frame.tries.pop(failed, None)
            return self._skip(frame.code.steps[failed], failed)
        tries = frame.tries[failed] = frame.tries.get(failed, 1) + 1
        if tries > _TRY_LIMIT:
            raise Stopped(f"an error comes again after {_TRY_LIMIT} tries")
        return failed

    def _end(self, _frame: CallFrame, _at: int, _step: End) -> int:
        raise Ended

    # -- loops ---------------------------------------------------------------------------------

    def _start_loop(self, frame: CallFrame, at: int, step: LoopStart) -> int:
        condition = step.condition
        if condition is None:
            return at + 1
        holds = self._is_true(self._language.evaluate(condition.value))
        if isinstance(holds, Unknown):
            is_entered = self._enter_unknown(frame, at, step, holds)
        else:
            is_entered = holds == condition.wanted
        if is_entered:
            return at + 1
        frame.rounds.pop(at, None)
        return step.to

    def _enter_unknown(self, frame: CallFrame, at: int, step: LoopStart, unknown: Unknown) -> bool:
        frame.undecided.add(at)
        if unknown.guess is None:
            body = range(at + 1, step.to - 1)
            is_useful = frame.code.acts(body) and not frame.code.leaves(body)
            is_entered = self._decide(unknown, default=is_useful)
            choice = Choice.LOOP_RUN_ONCE if is_entered else Choice.LOOP_ENDED
            self._language.assume(choice, step, unknown)
            return is_entered
        return unknown.guess and self._has_round(frame, at, step, unknown)

    def _has_round(self, frame: CallFrame, at: int, step: Step, unknown: Unknown) -> bool:
        """Count a round of a loop that is guessed to go on. Return whether it is one of its rounds.

        at: index of its first step.
        """
        rounds = frame.rounds[at]
        rounds.count += 1
        if rounds.count <= (self._rules.rounds or 0):
            return True
        self._language.assume(Choice.LOOP_LIMITED, step, unknown)
        return False

    def _end_loop(self, frame: CallFrame, at: int, step: LoopEnd) -> int:
        start = frame.code.steps[step.to]
        assert isinstance(start, LoopStart)
        after = self._end_round(frame, at, step, start)
        if not step.to <= after <= at:
            frame.rounds.pop(step.to, None)
        elif after == step.to and start.condition is None:
            # The start of such a loop does nothing.
            return after + 1
        return after

    def _end_round(self, frame: CallFrame, at: int, step: LoopEnd, start: LoopStart) -> int:
        condition = step.condition
        if condition is not None:
            holds = self._is_true(self._language.evaluate(condition.value))
            if isinstance(holds, Unknown):
                return self._end_unknown(frame, at, step, holds)
            if holds != condition.wanted:
                return at + 1
        else:
            condition = start.condition
            if step.to in frame.undecided and condition is not None:
                frame.undecided.discard(step.to)
                if self._rules.rounds is not None:
                    return step.to
                if isinstance(self._is_true(self._language.evaluate(condition.value)), Unknown):
                    return at + 1
        if condition is None or condition.is_constant:
            return self._repeat(frame, range(step.to, at + 1), step.to)
        return self._watch(frame, at, step.to, step.to)

    def _end_unknown(self, frame: CallFrame, at: int, step: LoopEnd, unknown: Unknown) -> int:
        if self._language.assume(Choice.LOOP_ENDED, step, unknown):
            return at + 1
        # The body has run once by now.
        if step.to not in frame.rounds:
            frame.rounds[step.to] = LoopRounds(count=1)
        if self._has_round(frame, step.to, step, unknown):
            return step.to
        return at + 1

    def _repeat(self, frame: CallFrame, loop: range, key: int) -> int:
        """Return the step after a round of a loop that has no condition.

        key: index of its rounds.
        """
        if self._rules.rounds is not None:
            return self._watch(frame, loop[-1], loop.start, key)
        code = frame.code
        conditions = [at for at in frame.exits if at in loop]
        if conditions:
            self._language.assume(Choice.LOOP_LEFT, code.steps[loop.start])
            # The longest branch does most. An error handler is short.
            return max((frame.exits.pop(at) for at in conditions), key=len).start
        is_endless = code.is_endless(loop) or self._is_repeated(frame, key)
        rounds = frame.rounds.get(key)
        limit = self._rules.round_limit
        if not is_endless and (limit is None or rounds is None or rounds.count <= limit):
            return loop.start
        length = self._language.count_instructions() if rounds is None else rounds.first_length
        self._language.assume(Choice.LOOP_ENDLESS, code.steps[loop.start], length=length)
        raise Ended

    def _watch(self, frame: CallFrame, at: int, start: int, key: int) -> int:
        """Return the step after a round: the start of the loop, or the step after its end `at`."""
        if not self._is_repeated(frame, key):
            return start
        rounds = frame.rounds[key]
        # If the program comes here again, the next rounds are all compared.
        rounds.count = 0
        self._language.assume(Choice.LOOP_REPEATS, frame.code.steps[start], length=rounds.length)
        return at + 1

    def _is_repeated(self, frame: CallFrame, key: int) -> bool:
        length = self._language.count_instructions()
        return frame.rounds[key].is_repeated(self._language.read_state, length)

    def _start_count(self, frame: CallFrame, at: int, step: CountStart) -> int:
        counter = self._language.open_count(step.count)
        if counter.unknown is not None:
            self._language.assume(Choice.LOOP_RUN_ONCE, step, counter.unknown)
        self._language.assign(counter.target, counter.first)
        frame.counters.pop(at, None)
        if counter.unknown is None:
            if not counter.has(counter.first):
                return step.to
            frame.counters[at] = counter
        return at + 1

    def _end_count(self, frame: CallFrame, at: int, step: CountEnd) -> int:
        counter = frame.counters.get(step.to)
        if counter is None:
            return at + 1
        value = self._language.evaluate(counter.target)
        if isinstance(value, Unknown):
            return at + 1
        number = self._language.to_number(value) + counter.step
        self._language.assign(counter.target, number)
        if counter.has(number):
            return step.to + 1
        del frame.counters[step.to]
        return at + 1


_OPENING = (Branch, LoopStart, CountStart, Select)
_RUN: dict[type[Step], Callable[[Flow, CallFrame, int, Any], int]] = {
    Act: Flow._act,
    Branch: Flow._branch,
    Jump: Flow._jump,
    Call: Flow._call,
    JumpTable: Flow._jump_by_number,
    Return: Flow._return,
    Handle: Flow._handle,
    Raise: Flow._raise,
    Resume: Flow._resume,
    End: Flow._end,
    Select: Flow._select,
    LoopStart: Flow._start_loop,
    LoopEnd: Flow._end_loop,
    CountStart: Flow._start_count,
    CountEnd: Flow._end_count,
}
