"""A routine as flat, typed steps, and the compiler of structured statements to them.

A step has an index in its routine. After a step the next one runs, or the step of index `to`. So a
jump may lead into a block and out of it, as GOTO does.

The engine reads nothing of a language here. Conditions, expressions, counters and operands are
objects that the language makes and that only the language evaluates.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from enum import Enum, auto
from itertools import accumulate
from typing import Any, TypeVar

from msgspec import Struct, field


class Effect(Enum):
    """The effect of an `Act` on the machine."""

    NONE = auto()
    #: It switches an output, waits, or calls what may move.
    ACTS = auto()
    #: It moves the robot.
    MOVES = auto()
    #: It leaves its routine or gives the robot away. The steps after it are not meant to run.
    LEAVES = auto()


class Step(Struct, gc=False):
    """A step of a routine.

    line: line of its statement, from 1 through all files.
    to: index of the step that runs next instead of the following one, -1 without one.
    cost: number of steps of the budget.
    """

    line: int
    to: int = -1
    cost: int = 1


class Act(Step, kw_only=True, gc=False):
    """A statement that the language carries out by itself.

    do: called with the language and the operand. A step that it returns runs next, such as a
        jump whose label is known only then.
    lines: number of lines of the statement, or of several statements in one step.
    """

    do: Callable[[Any, Any], object]
    operand: Any = None
    effect: Effect = Effect.NONE
    lines: int = 1


class Condition(Struct, frozen=True, gc=False):
    """A condition.

    value: expression of the language.
    wanted: value with which the block is entered or the loop goes on.
    is_constant: whether the text alone determines it, such as TRUE. Nothing ends such a loop.
    is_unlikely: whether it is chosen not to hold if nothing else decides, such as `a <> b`.
    """

    value: Any
    wanted: bool = True
    is_constant: bool = False
    is_unlikely: bool = False


class Branch(Step, kw_only=True, gc=False):
    """The start of a block. The block runs if the condition holds, else `to` is the next step.

    end: index of the step after the block and its alternatives.
    is_leaving: whether the block leaves for good.
    """

    condition: Condition
    end: int = -1
    is_leaving: bool = False


class Jump(Step, kw_only=True, gc=False):
    """`to` is the next step.

    label: label of a jump that the text makes, empty for the jump from a branch to the block's end.
    is_exit: whether it leaves a loop.
    """

    label: str = ""
    is_exit: bool = False


class LoopStart(Step, kw_only=True, gc=False):
    """The start of a loop. The loop runs if the condition holds, else `to` is the next step."""

    condition: Condition | None = None


class LoopEnd(Step, kw_only=True, gc=False):
    """The end of a loop. If the condition holds, `to` is the next step, the start of the loop."""

    condition: Condition | None = None


class CountStart(Step, kw_only=True, gc=False):
    """The start of a counted loop. `to` is the step after its end.

    count: counter and bounds, which the language evaluates once.
    """

    count: Any


class CountEnd(Step, kw_only=True, gc=False):
    """The end of the counted loop that starts at `to`."""


class Case(Struct, gc=False):
    """A case of a `Select`.

    tests: values that select it, None for the case of all others.
    to: index of its first step.
    """

    tests: Any
    to: int


class Select(Step, kw_only=True, gc=False):
    """The first case that the value selects runs. Without one, `to` is the next step."""

    value: Any
    cases: list[Case]


class Call(Step, kw_only=True, gc=False):
    """A label is the next step. The next `Return` comes back to the step after this one."""

    label: str


class JumpTable(Step, kw_only=True, gc=False):
    """The label of a number, counted from 1, is the next step. Without one, nothing happens.

    is_call: whether the next `Return` comes back to the step after this one.
    """

    value: Any
    labels: Sequence[str]
    is_call: bool


class Handle(Step, kw_only=True, gc=False):
    """Sets the label that is the next step after an error, empty for none."""

    label: str


class Return(Step, kw_only=True, gc=False):
    """Leaves the routine.

    is_to_call: whether it goes back to the last `Call` of the routine if there is one.
    """

    is_to_call: bool = False


class Raise(Step, kw_only=True, gc=False):
    """Raises an error of the program.

    is_again: whether it is the error that the handler has taken.
    """

    is_again: bool = False


class Resume(Step, kw_only=True, gc=False):
    """Ends an error handler.

    is_again: whether the step that raised the error runs again. Else the one after it runs.
    """

    is_again: bool


class End(Step, gc=False):
    """Ends the program."""


_LEAVING = (Return, Raise, End)
_LOOPS_AND_CASES = (LoopStart, CountStart, Select)


def leaves(step: Step) -> bool:
    """Return whether a step leaves its block for good, so that the next one does not run."""
    if isinstance(step, Jump):
        return step.is_exit or bool(step.label)
    if isinstance(step, Act):
        return step.effect is Effect.LEAVES
    return isinstance(step, _LEAVING)


def _can_leave(step: Step, loop: range) -> bool:
    """Return whether a step of a loop may leave it."""
    if isinstance(step, Resume) or (leaves(step) and not isinstance(step, Jump)):
        return True
    is_unconditional = isinstance(step, LoopStart) and step.condition is None
    return step.to >= 0 and step.to not in loop and not is_unconditional


class Code(Struct):
    """A routine.

    steps: its steps.
    labels: index of the step of each label.
    acting: number of acting or moving steps before each index. A language that guesses each
        condition needs none.
    """

    steps: list[Step]
    labels: dict[str, int] = field(default_factory=dict)
    acting: list[int] = field(default_factory=list)
    _endless: dict[range, bool] = field(default_factory=dict)

    def acts(self, span: range) -> bool:
        """Return whether a step of a span acts or moves."""
        return self.acting[span.stop] > self.acting[span.start]

    def leaves(self, span: range) -> bool:
        """Return whether a span leaves for good, by a step outside of its inner blocks."""
        at = span.start
        while at < span.stop:
            step = self.steps[at]
            if leaves(step):
                return True
            after = step.end if isinstance(step, Branch) else step.to
            is_block = isinstance(step, (Branch, *_LOOPS_AND_CASES))
            at = after if is_block and after > at else at + 1
        return False

    def is_endless(self, loop: range) -> bool:
        """Return whether no step of a loop before its last one may leave it."""
        if loop not in self._endless:
            body = self.steps[loop.start : loop.stop - 1]
            self._endless[loop] = not any(_can_leave(step, loop) for step in body)
        return self._endless[loop]

    def list_branches(self, at: int) -> tuple[range, range]:
        """Return the steps of the branch at `at`, and those of the alternative to it."""
        branch = self.steps[at]
        assert isinstance(branch, Branch)
        has_alternative = branch.end > branch.to
        return range(at + 1, branch.to - has_alternative), range(branch.to, branch.end)

    def list_alternatives(self, at: int) -> list[range]:
        """Return the steps of each alternative to the branch at `at`, an empty one if it has none.

        An alternative with a condition of its own comes before those to it.
        """
        blocks = []
        _, alternative = self.list_branches(at)
        while alternative and isinstance(first := self.steps[alternative.start], Branch):
            if first.end != alternative.stop:
                break
            block, alternative = self.list_branches(alternative.start)
            blocks.append(block)
        return [*blocks, alternative]


class Block(Struct, eq=False, gc=False):
    """A block that is not closed yet.

    kind: word of the language that opened it.
    start: index of its first step.
    line: line of its first statement.
    first: its first step.
    leaving: jumps to its end.
    ending: jumps to its last step, which ends a round of a loop.
    branches: its branches.
    pending: its last branch without an alternative yet, None after the last alternative.
    """

    kind: str
    start: int
    line: int
    first: Step
    leaving: list[Jump]
    ending: list[Jump] = []
    branches: list[Branch] = []
    pending: Branch | None = None


_AnyStep = TypeVar("_AnyStep", bound=Step)


class Compiler:
    """The steps of a routine while its statements are read in order.

    line: line of the statement that is read.
    steps: steps so far.
    blocks: blocks that are open, the innermost last.
    labels: index of the step of each label so far.
    """

    def __init__(self) -> None:
        self.line = 0
        self.steps: list[Step] = []
        self.blocks: list[Block] = []
        self.labels: dict[str, int] = {}
        self._jumps: list[Jump] = []

    @property
    def innermost(self) -> Block | None:
        """The innermost open block, None without one."""
        return next(reversed(self.blocks), None)

    def add(self, step: _AnyStep) -> _AnyStep:
        """Add a step and return it."""
        self.steps.append(step)
        return step

    def open(self, kind: str, first: Step) -> Block:
        """Open a block with its first step."""
        block = Block(kind, len(self.steps), self.line, self.add(first), [])
        self.blocks.append(block)
        return block

    def open_branch(self, kind: str, condition: Condition) -> Block:
        """Open a block that runs if a condition holds."""
        branch = Branch(self.line, condition=condition)
        block = self.open(kind, branch)
        self._set_pending(block, branch)
        return block

    def add_alternative(self, block: Block) -> None:
        """End a branch. The steps that follow run if its condition does not hold."""
        block.leaving.append(self.add(Jump(self.line)))
        if block.pending is not None:
            block.pending.to = len(self.steps)
            block.pending = None

    def add_condition(self, block: Block, condition: Condition) -> None:
        """Make an alternative depend on a condition of its own."""
        self._set_pending(block, self.add(Branch(self.line, condition=condition)))

    def _set_pending(self, block: Block, branch: Branch) -> None:
        block.pending = branch
        block.branches.append(branch)

    def end_case(self, block: Block) -> None:
        """End the case before this line, if a block has one already."""
        assert isinstance(block.first, Select)
        if block.first.cases:
            block.leaving.append(self.add(Jump(self.line)))

    def add_case(self, block: Block, tests: Any) -> None:
        """Begin a case of a block whose first step is a `Select`. tests: None for all others."""
        assert isinstance(block.first, Select)
        block.first.cases.append(Case(tests, len(self.steps)))

    def close_loop(self, block: Block, condition: Condition | None = None) -> None:
        """Close a block whose first step is a `LoopStart`."""
        self.add(LoopEnd(self.line, block.start, condition=condition))
        self.close(block)

    def close_count(self, block: Block) -> None:
        """Close a block whose first step is a `CountStart`."""
        self.add(CountEnd(self.line, block.start))
        self.close(block)

    def close(self, block: Block) -> None:
        """End a block before the next step. It is no longer in `blocks`."""
        end = len(self.steps)
        if block.pending is not None:
            block.pending.to = end
        elif not isinstance(block.first, Branch):
            block.first.to = end
        for jump in block.leaving:
            jump.to = end
        for jump in block.ending:
            jump.to = end - 1
        for branch in block.branches:
            branch.end = end

    def exit(self, kinds: Collection[str]) -> bool:
        """Leave the innermost block of some kinds. Return whether there is one."""
        block = self._find_block(kinds)
        if block is not None:
            block.leaving.append(self.add(Jump(self.line, is_exit=True)))
        return block is not None

    def end_round(self, kinds: Collection[str]) -> bool:
        """End a round of the innermost loop of some kinds. Return whether there is one."""
        block = self._find_block(kinds)
        if block is not None:
            block.ending.append(self.add(Jump(self.line, is_exit=True)))
        return block is not None

    def _find_block(self, kinds: Collection[str]) -> Block | None:
        return next((block for block in reversed(self.blocks) if block.kind in kinds), None)

    def jump(self, label: str) -> None:
        """Add a jump to a label."""
        self._jumps.append(self.add(Jump(self.line, label=label)))

    def list_missing(self) -> list[Jump]:
        """Return the jumps to labels that are missing."""
        return [jump for jump in self._jumps if jump.label not in self.labels]

    def mark(self, label: str) -> bool:
        """Name the next step. Return whether the label is a new one; the first one counts."""
        is_new = label not in self.labels
        self.labels.setdefault(label, len(self.steps))
        return is_new

    def finish(self) -> Code:
        """Return the routine. A jump to a label that is missing keeps -1."""
        for jump in self._jumps:
            jump.to = self.labels.get(jump.label, -1)
        acting = [isinstance(step, Act) and step.effect in _ACTING for step in self.steps]
        code = Code(self.steps, self.labels, [0, *accumulate(acting)])
        for at, step in enumerate(self.steps):
            if isinstance(step, Branch):
                step.is_leaving = code.leaves(code.list_branches(at)[0])
        return code


_ACTING = (Effect.ACTS, Effect.MOVES)
