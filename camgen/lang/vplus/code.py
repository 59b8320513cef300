"""The statements of a V+ program as the steps of the engine."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

from camgen.lang.code import (
    Act,
    Branch,
    Case,
    Code,
    Condition,
    CountEnd,
    CountStart,
    End,
    Jump,
    JumpTable,
    LoopEnd,
    LoopStart,
    Return,
    Select,
    Step,
)

from .locations import Expression
from .statements import ENDS
from .text import Impossible, Routine, Statement, Stretch, Unreadable

GOES = re.compile(r"\bGOTO\s+(\d+)\s*$", re.IGNORECASE)
#: Characters of a line that count as one instruction.
_LONG = 60
#: A branch leaves for good if one of this many last statements does.
_LAST_STATEMENTS = 3
_LEAVING = frozenset({"GOTO", "RETURN", "RETURNE", "PAUSE"}) | ENDS
#: A jump to one of the last statements ends the program.
_END_STATEMENTS = 8

Do = Callable[[Any, Any], object]
Translate = Callable[["Translator", int, Statement], Step]


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


def compile_routine(
    routine: Routine, do: Do, run_stretch: Do, table: Mapping[str, Translate] | None = None
) -> Code:
    """Return the steps of a program.

    do: carries out a statement.
    run_stretch: carries out a stretch.
    table: words of the flow, those of `FLOW` if None. `do` carries out all others.
    """
    return Translator(routine, do, run_stretch, table or FLOW).code


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


def name_statement(step: Step) -> Statement:
    """The line and the word of the statement of a step, without its operands."""
    operand = getattr(step, "operand", None)
    word = ""
    if isinstance(operand, Statement):
        word = operand.word
    return Statement(step.line, word, "")


def _do_nothing(_machine: object, _operand: object) -> None:
    """Words that only mark a place, such as the END of an IF."""


class Translator:
    """Translates the statements of a program in order.

    routine: the program.
    code: the steps so far.
    """

    def __init__(
        self, routine: Routine, do: Do, run_stretch: Do, table: Mapping[str, Translate]
    ) -> None:
        self.routine = routine
        self._do = do
        self._has_branches = table.get("IF") is Translator._if
        self._starts = [0]
        for index, statement in enumerate(routine.statements):
            steps = 2 if self._is_jump(index, statement) else 1
            self._starts.append(self._starts[-1] + steps)
        self.code = Code([])
        for index, statement in enumerate(routine.statements):
            cost = measure_cost(statement)
            if isinstance(statement, Stretch):
                lines = len(statement.poses)
                act = Act(statement.line, cost=cost, do=run_stretch, operand=statement, lines=lines)
                self.code.steps.append(act)
                continue
            try:
                step = table.get(statement.word, Translator._act)(self, index, statement)
            except Unreadable as error:
                step = Act(statement.line, do=refuse, operand=str(error))
            step.cost = cost
            self.code.steps.append(step)
            if self._is_jump(index, statement):
                jump = self._jump_of_if(index, statement)
                jump.cost = 0
                self.code.steps.append(jump)

    def _is_jump(self, index: int, statement: Statement | Stretch) -> bool:
        """Return whether a statement is an IF with GOTO."""
        if not isinstance(statement, Statement) or statement.word != "IF":
            return False
        is_open = self._has_branches and index not in self.routine.partner
        return is_open and bool(GOES.search(statement.rest))

    def find_end(self, index: int) -> int:
        """Return the step after the block that a statement opens, or after the statement."""
        return self._starts[self.routine.partner.get(index, index) + 1]

    def _act(self, _index: int, statement: Statement) -> Step:
        return Act(statement.line, do=self._do, operand=statement)

    def _nothing(self, statement: Statement) -> Step:
        return Act(statement.line, do=_do_nothing)

    # -- branches ------------------------------------------------------------------------------

    def refuse_block(self, index: int, statement: Statement) -> Step:
        """A block that the language does not evaluate: its condition is the statement itself."""
        after = self.find_end(index)
        return Branch(statement.line, after, condition=Condition(statement), end=after)

    def _if(self, index: int, statement: Statement) -> Step:
        routine, rest = self.routine, statement.rest
        jump = GOES.search(rest)
        after = self.find_end(index)
        if jump and index not in routine.partner:
            condition = Condition(Question("IF", rest[: jump.start()]))
            place = routine.labels.get(int(jump[1]), -1)
            is_end = place > index and len(routine.statements) - place <= _END_STATEMENTS
            return Branch(statement.line, after, condition=condition, end=after, is_leaving=is_end)
        if index not in routine.partner:
            raise Unreadable("IF wants THEN or GOTO")
        ends = ("THEN",) if rest[-4:].upper() == "THEN" else ()
        last = next(iter(routine.branches.get(index, ())), routine.partner[index])
        return Branch(
            statement.line,
            self._starts[last + 1],
            condition=Condition(Question("IF", rest, ends)),
            end=after,
            is_leaving=self._leaves(index + 1, last),
        )

    def _leaves(self, start: int, end: int) -> bool:
        """Return whether one of the last statements of a branch leaves for good."""
        last = self.routine.statements[start:end][-_LAST_STATEMENTS:]
        return any(isinstance(item, Statement) and item.word in _LEAVING for item in last)

    def _jump_of_if(self, index: int, statement: Statement) -> Step:
        jump = GOES.search(statement.rest)
        assert jump is not None
        return self._jump(index, statement.line, int(jump[1]))

    def _else(self, index: int, statement: Statement) -> Step:
        """The end of a branch, or of a case."""
        opener = self.routine.opener.get(index, -1)
        if opener not in self.routine.partner:
            return self._nothing(statement)
        return Jump(statement.line, self.find_end(opener))

    def _case(self, index: int, statement: Statement) -> Step:
        routine = self.routine
        if index not in routine.partner:
            raise Unreadable("CASE is not closed")
        cases = []
        for place in routine.branches.get(index, ()):
            branch = routine.statements[place]
            assert isinstance(branch, Statement)
            tests = None if branch.word == "ANY" else branch.rest
            cases.append(Case(tests, self._starts[place + 1]))
        value = CaseValue(statement.rest)
        return Select(statement.line, self.find_end(index), value=value, cases=cases)

    # -- loops ---------------------------------------------------------------------------------

    def _while(self, index: int, statement: Statement) -> Step:
        if index not in self.routine.partner:
            raise Unreadable("WHILE is not closed")
        condition = Condition(Question("WHILE", statement.rest, ("DO", "")))
        return LoopStart(statement.line, self.find_end(index), condition=condition)

    def _do_loop(self, index: int, statement: Statement) -> Step:
        condition = Condition(Question("DO", statement.rest)) if statement.rest else None
        return LoopStart(statement.line, self.find_end(index), condition=condition)

    def _until(self, index: int, statement: Statement) -> Step:
        start = self.routine.opener.get(index)
        if start is None:
            return self._nothing(statement)
        condition = Condition(Question("UNTIL", statement.rest), wanted=False)
        return LoopEnd(statement.line, self._starts[start], condition=condition)

    def _for(self, index: int, statement: Statement) -> Step:
        if index not in self.routine.partner:
            raise Unreadable("FOR is not closed")
        return CountStart(statement.line, self.find_end(index), count=statement.rest)

    def _end(self, index: int, statement: Statement) -> Step:
        start = self.routine.opener.get(index)
        opener = self.routine.statements[start] if start is not None else None
        word = opener.word if isinstance(opener, Statement) else ""
        if start is None or word not in ("WHILE", "FOR"):
            return self._nothing(statement)
        kind = LoopEnd if word == "WHILE" else CountEnd
        return kind(statement.line, self._starts[start])

    def _exit(self, index: int, statement: Statement) -> Step:
        """EXIT and NEXT: to the step after a loop, or to its last one."""
        loops = self.routine.loops.get(index, ())
        labels = []
        for start in loops:
            end = self.routine.partner.get(start, index)
            target = self._starts[end if statement.word == "NEXT" else end + 1]
            labels.append(f"step {target}")
            self.code.labels[labels[-1]] = target
        value = LoopCount(statement.word, statement.rest or "1", len(loops))
        return JumpTable(statement.line, value=value, labels=labels, is_call=False)

    # -- jumps ---------------------------------------------------------------------------------

    def _goto(self, index: int, statement: Statement) -> Step:
        return self._jump(index, statement.line, read_label(statement.rest))

    def _jump(self, _index: int, line: int, label: int) -> Step:
        place = self.routine.labels.get(label)
        if place is None:
            return Act(line, do=refuse, operand=f"there is no label {label} in this program")
        return Jump(line, self._starts[place])

    def _return(self, _index: int, statement: Statement) -> Step:
        return Return(statement.line)

    def _halt(self, _index: int, statement: Statement) -> Step:
        return End(statement.line)


#: Translators by word of the flow.
FLOW: dict[str, Translate] = {
    "IF": Translator._if,
    "ELSE": Translator._else,
    "CASE": Translator._case,
    "VALUE": Translator._else,
    "ANY": Translator._else,
    "WHILE": Translator._while,
    "DO": Translator._do_loop,
    "UNTIL": Translator._until,
    "FOR": Translator._for,
    "END": Translator._end,
    "EXIT": Translator._exit,
    "NEXT": Translator._exit,
    "GOTO": Translator._goto,
    "RETURN": Translator._return,
    "RETURNE": Translator._return,
    **dict.fromkeys(ENDS, Translator._halt),
}
