"""The statements of a V+ program as the steps of the engine."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

from camgen.lang.code import (
    Act,
    Block,
    Code,
    Compiler,
    Condition,
    CountStart,
    End,
    Jump,
    JumpTable,
    LoopStart,
    Return,
    Select,
)
from camgen.lang.log import Log
from camgen.lang.programs import Level

from .locations import Expression
from .statements import ENDS
from .text import Impossible, Routine, Statement, Stretch, Unreadable
from .walk import Walker

GOES = re.compile(r"\bGOTO\s+(\d+)\s*$", re.IGNORECASE)
_THEN = re.compile(r"\bTHEN\s*$", re.IGNORECASE)
_GOTO = re.compile(r"\bGOTO\b", re.IGNORECASE)
_LOOPS = frozenset({"FOR", "WHILE", "DO"})
#: Maximum number of loops that EXIT n and NEXT n can leave at once.
_MAX_LOOPS = 40
#: The block of a branch, and its name in messages.
_BRANCHES = {"ELSE": "IF", "VALUE": "CASE", "ANY": "CASE"}
_NOUNS = {"IF": "an IF", "CASE": "a CASE"}
#: Characters of a line that count as one instruction.
_LONG = 60
#: A branch leaves for good if one of this many last statements does.
_LAST_STATEMENTS = 3
_LEAVING = frozenset({"GOTO", "RETURN", "RETURNE", "PAUSE"}) | ENDS
#: A jump to one of the last statements ends the program.
_END_STATEMENTS = 8

Do = Callable[[Any, Any], object]
Translate = Callable[["Translator", Statement], object]


class Question(NamedTuple):
    """A condition.

    word: IF, WHILE, UNTIL or DO.
    text: the condition with the words after it.
    ends: words that may follow it, empty for the end of the line.
    """

    word: str
    text: str
    ends: tuple[str, ...] = ("",)


class CaseValue(NamedTuple):
    """The value of a CASE."""

    text: str


class LoopCount(NamedTuple):
    """The number of loops that EXIT or NEXT leaves. around: the number of loops around it."""

    word: str
    text: str
    around: int


def read_label(rest: str) -> int:
    """Return the label of a GOTO."""
    if not (rest.isdigit() and rest.isascii()) or len(rest) > 5:
        raise Unreadable(f"GOTO wants a label, not {rest[:20] or 'nothing'}")
    return int(rest)


def read_bounds(text: Expression) -> tuple[float, float, float]:
    """Return the first and the last value of a counter and its step."""
    first = text.real()
    text.expect("TO")
    last = text.real()
    step = text.after("STEP", text.real, 1.0)
    text.finish()
    if step == 0:
        raise Impossible("a loop with step 0")
    return first, last, step


def measure_cost(statement: Statement | Stretch) -> int:
    """Return the number of steps that a statement takes from the budget."""
    if isinstance(statement, Stretch):
        return len(statement.poses)
    return 1 + len(statement.rest) // _LONG


def refuse(_machine: object, reason: str) -> None:
    """Report a statement that V+ does not take."""
    raise Unreadable(reason)


class Translator(Compiler):
    """Translates the statements of a program in order.

    routine: the program.
    index: index of the statement that is read.
    """

    def __init__(self, routine: Routine, do: Do, table: Mapping[str, Translate], log: Log) -> None:
        super().__init__()
        self.routine, self.index = routine, 0
        self._do, self._table, self._log = do, table, log

    def compile(self) -> Code:
        """Return the steps of the program. Blocks that are not closed are reported."""
        starts = []
        for index, statement in enumerate(self.routine.statements):
            self.index, self.line = index, statement.line
            start = len(self.steps)
            starts.append(start)
            if isinstance(statement, Stretch):
                lines, do = len(statement.poses), Walker.run_stretch
                self.add(Act(self.line, cost=0, do=do, operand=statement, lines=lines))
            else:
                self._add_statement(statement)
                self.steps[start].cost = measure_cost(statement)
        for block in self.blocks:
            what = f"{block.kind} is not closed"
            self._log.find("refused", what, line=block.line)
            self.steps[block.start] = Act(block.line, do=refuse, operand=what)
        starts.append(len(self.steps))
        for label, place in self.routine.labels.items():
            self.labels[str(label)] = starts[place]
        for jump in self._jumps:
            jump.to = self.labels[jump.label]
        for at, step in enumerate(self.steps):
            # A word that marks a place, or a branch of a block that is not closed.
            if isinstance(step, Jump) and step.to < 0:
                step.to = at + 1
        return Code(self.steps, self.labels)

    def _add_statement(self, statement: Statement) -> None:
        try:
            self._table.get(statement.word, Translator._act)(self, statement)
        except Unreadable as error:
            self._refuse(str(error))

    def _act(self, statement: Statement) -> None:
        self.add(Act(self.line, do=self._do, operand=statement))

    def _refuse(self, reason: str) -> None:
        self.add(Act(self.line, do=refuse, operand=reason))

    # -- branches ------------------------------------------------------------------------------

    def refuse_block(self, statement: Statement) -> None:
        """A block that the language does not evaluate: its condition is the statement itself."""
        self.open_branch(statement.word, Condition(statement))
        if statement.word == "IF" and "THEN" not in statement.rest.upper():
            self.close(self.blocks.pop())

    def _if(self, statement: Statement) -> None:
        rest = statement.rest
        if jump := GOES.search(rest):
            self._jump_if(rest[: jump.start()], int(jump[1]))
            return
        if not _THEN.search(rest):
            if _GOTO.search(rest):
                raise Unreadable("IF wants THEN or GOTO")
            self._log.find("refused", "IF wants THEN or GOTO", line=self.line)
        ends = ("THEN",) if rest[-4:].upper() == "THEN" else ()
        self.open_branch("IF", Condition(Question("IF", rest, ends)))

    def _jump_if(self, condition: str, label: int) -> None:
        block = self.open_branch("IF", Condition(Question("IF", condition)))
        self._jump(label)
        self.steps[-1].cost = 0
        self.close(self.blocks.pop())
        place, count = self.routine.labels.get(label, -1), len(self.routine.statements)
        block.branches[0].is_leaving = place > self.index and count - place <= _END_STATEMENTS

    def _check_alone(self, statement: Statement, level: Level) -> None:
        if statement.rest.strip(": "):
            what = f"{statement.word} stands alone, without {statement.rest[:30]}"
            self._log.find(level, what, line=self.line)

    def _else(self, statement: Statement) -> None:
        """The end of a branch, or of a case."""
        word, block = statement.word, self.innermost
        if word != "VALUE":
            self._check_alone(statement, "refused" if word == "ELSE" else "unusual")
        if block is None or block.kind != _BRANCHES[word]:
            what = f"{word} outside of {_NOUNS[_BRANCHES[word]]}"
            self._log.find("refused", what, line=self.line)
            self.add(Jump(self.line))
        elif word == "ELSE":
            self._note_leaving(block)
            self.add_alternative(block)
        else:
            block.leaving.append(self.add(Jump(self.line)))
            self.add_case(block, None if word == "ANY" else statement.rest)

    def _note_leaving(self, block: Block) -> None:
        """Note whether one of the last statements of a branch leaves for good."""
        if block.pending is not None:
            last = self.routine.statements[max(0, self.index - _LAST_STATEMENTS) : self.index]
            words = [item.word for item in last if item.line > block.line]
            block.pending.is_leaving = not _LEAVING.isdisjoint(words)

    def _case(self, statement: Statement) -> None:
        self.open("CASE", Select(self.line, value=CaseValue(statement.rest), cases=[]))

    def _end(self, statement: Statement) -> None:
        """The end of a block: END, or the UNTIL of a DO."""
        block = self.innermost
        if statement.word == "END":
            self._check_alone(statement, "unusual")
        if block is None or (block.kind == "DO") != (statement.word == "UNTIL"):
            self._log.find("refused", f"{statement.word} closes nothing", line=self.line)
            self.add(Jump(self.line))
            return
        self.blocks.pop()
        if isinstance(block.first, CountStart):
            self.close_count(block)
        elif isinstance(block.first, LoopStart):
            condition = None
            if block.kind == "DO":
                condition = Condition(Question("UNTIL", statement.rest), wanted=False)
            self.close_loop(block, condition)
        else:
            self._note_leaving(block)
            self.add(Jump(self.line))
            self.close(block)
        self.labels[f"NEXT {block.start}"] = len(self.steps) - 1
        self.labels[f"EXIT {block.start}"] = len(self.steps)

    # -- loops ---------------------------------------------------------------------------------

    def _while(self, statement: Statement) -> None:
        condition = Condition(Question("WHILE", statement.rest, ("DO", "")))
        self.open("WHILE", LoopStart(self.line, condition=condition))

    def _do_loop(self, statement: Statement) -> None:
        condition = Condition(Question("DO", statement.rest)) if statement.rest else None
        self.open("DO", LoopStart(self.line, condition=condition))

    def _exit(self, statement: Statement) -> None:
        """EXIT and NEXT: to the step after a loop, or to its last one."""
        loops = [block for block in reversed(self.blocks) if block.kind in _LOOPS][:_MAX_LOOPS]
        labels = [f"{statement.word} {block.start}" for block in loops]
        value = LoopCount(statement.word, statement.rest or "1", len(loops))
        self.add(JumpTable(self.line, value=value, labels=labels, is_call=False))

    # -- jumps ---------------------------------------------------------------------------------

    def _jump(self, label: int) -> None:
        if label in self.routine.labels:
            self.jump(str(label))
        else:
            self._refuse(f"there is no label {label} in this program")


#: Translators by word of the flow.
FLOW: dict[str, Translate] = {
    "IF": Translator._if,
    "CASE": Translator._case,
    "WHILE": Translator._while,
    "DO": Translator._do_loop,
    "FOR": lambda translator, statement: translator.open(
        "FOR", CountStart(statement.line, count=statement.rest)
    ),
    "GOTO": lambda translator, statement: translator._jump(read_label(statement.rest)),
    **dict.fromkeys(("ELSE", "VALUE", "ANY"), Translator._else),
    **dict.fromkeys(("END", "UNTIL"), Translator._end),
    **dict.fromkeys(("EXIT", "NEXT"), Translator._exit),
    **dict.fromkeys(
        ("RETURN", "RETURNE"),
        lambda translator, statement: translator.add(Return(statement.line)),
    ),
    **dict.fromkeys(ENDS, lambda translator, statement: translator.add(End(statement.line))),
}
