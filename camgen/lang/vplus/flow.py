"""The run of V+ programs: calls, and answers to the questions of the flow.

A loop whose end the text does not determine runs once (``--assume rounds=3``: three times). An
input that the user has not set is off, unless a program would leave for good then, or wait.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from camgen.lang.code import Act, Branch, Code, LoopEnd, LoopStart, Step
from camgen.lang.flow import Choice, Counter, Flow, Rules
from camgen.lang.log import Log
from camgen.lang.programs import Ask
from camgen.lang.run import Budget, Ended, Stopped
from camgen.lang.values import Unknown
from camgen.model.program import Joints, MoveC, MoveJ, MoveL
from camgen.model.text import counted

from .code import CaseValue, LoopCount, Question, compile_routine, measure_cost, read_bounds
from .instructions import MOTIONS, REACTIONS
from .locations import Expression
from .names import canonical
from .statements import split, unwrap
from .text import Impossible, Location, Routine, Statement, Stretch, Unreadable
from .units import Units
from .variables import Cell, Table, Value
from .walk import walk_apart

#: So many programs may call each other: V+ has a stack, too.
_DEEPEST = 60
CALLED = re.compile(r"([A-Za-z][A-Za-z0-9._]*)\s*(\(.*\))?", re.DOTALL)
_MOST_STATE = 3000
#: Values of a state that count as an instruction when they are compared.
_LONG = 60
#: What the bound of a run gives for each line of a file that the program reads.
_READS = 100


class Machine(Units):
    """The controller, with the programs that it has. stopped: where and why the run broke off. ran,
    done: the programs and the lines that were carried out.
    """

    faults: type[Exception] = Unreadable

    def __init__(self, programs: Sequence[Routine], ask: Ask, log: Log) -> None:
        super().__init__(ask, log)
        self._programs: dict[str, Routine] = {}
        for routine in programs:
            self._programs.setdefault(canonical(routine.name), routine)
        self._kept: dict[str, Table] = {}
        self._codes: dict[str, Code] = {}
        self._rounds = max(1, int(min(self._assume.get("rounds", 1.0), 1e6)))
        size = sum(
            measure_cost(statement) for program in programs for statement in program.statements
        )
        self._budget = Budget(size, ask.limits.vplus_steps, "vplus_steps")
        rules = Rules(_DEEPEST, self._rounds, skips_blocks=True)
        self._flow = Flow(self, self._budget, rules)
        self.stopped: tuple[int, str] | None = None
        self.ran: set[str] = set()

    def lay_beside(self, files: Mapping[str, str]) -> None:
        """Files that the programs may read, by name; each line of them may be read and worked with."""
        super().lay_beside(files)
        self._budget.left += _READS * sum(text.count("\n") for text in files.values())

    def find_program(self, key: str) -> Routine | None:
        """The program of a name in its canonical form."""
        return self._programs.get(key)

    def spend(self, count: int) -> None:
        """Take as many steps from the budget of the run. Stopped if it has too few."""
        self._budget.spend(count)

    def last(self, name: str) -> float:
        """The last index of an array."""
        self.spend(len(self.cell(name).table) // 8)
        return super().last(name)

    def give(self, values: Mapping[str, Value]) -> None:
        """Globals that have a value before the program starts."""
        self._globals.update(values)

    def run(self, routine: Routine) -> None:
        """Carries out ``routine`` and what it calls."""
        try:
            self._run(routine, {})
        except Ended:
            pass
        except Stopped as error:
            self.stopped = self.line, str(error)
        self.finish()

    def _run(self, routine: Routine, arguments: Mapping[str, Cell]) -> None:
        key = canonical(routine.name)
        self.ran.add(key)
        self.enter(self._kept.setdefault(key, {}))
        self._scopes[-1].others.update(arguments)
        self._flow.run(self._compile(routine))
        self.tell_inputs()
        self.leave()

    def _compile(self, routine: Routine) -> Code:
        key = canonical(routine.name)
        if key not in self._codes:
            self._codes[key] = compile_routine(routine, Machine.act, Machine.run_stretch)
        return self._codes[key]

    def compile_all(self) -> list[Code]:
        """Return the steps of all programs."""
        return [self._compile(routine) for routine in self._programs.values()]

    def run_stretch(self, plain: Stretch) -> None:
        """Carries out motions that were read together."""
        if self.stretch(plain):
            self.line = plain.line + len(plain.poses) - 1
            return
        walk_apart(plain, self._do_apart, self._unreadable)

    def _do_apart(self, statement: Statement) -> None:
        self.line, self.doubt = statement.line, False
        self.do(statement)

    def _unreadable(self, statement: Statement, error: Unreadable) -> None:
        if self.doubt and isinstance(error, Impossible):
            what = f"not evaluated: {error} (with what is assumed)"
            self.log.find("unusual", what, line=statement.line)
            self.log.lose(what, line=statement.line)
        else:
            self.log.find("refused", str(error), line=statement.line)
        if statement.word in MOTIONS:
            self.lost(statement.word)

    def act(self, statement: Statement) -> None:
        """Carries out an instruction that changes nothing of the flow."""
        _ACTS.get(statement.word, Machine.do)(self, statement)

    # -- answers to the engine (`camgen.lang.flow.Language`) ------------------------------------

    def begin(self, step: Step) -> None:
        """A step begins."""
        if self.consulted:
            self.tell_inputs()
        self.line = step.line
        self.doubt = False

    def report(self, step: Step, error: Exception) -> None:
        """Tells that a step cannot be carried out."""
        assert isinstance(error, Unreadable)
        operand = step.operand if isinstance(step, Act) else None
        word = operand.word if isinstance(operand, Statement) else ""
        self._unreadable(Statement(step.line, word, ""), error)

    def evaluate(self, expression: Question | CaseValue | LoopCount | str) -> Any:
        """The value of a condition, of a CASE or of a counter."""
        if isinstance(expression, Question):
            return self._ask(expression)
        if isinstance(expression, str):
            return self.real(expression)
        text = Expression(expression.text, self)
        if isinstance(expression, CaseValue):
            value = self._evaluate_item(text)
            text.expect("OF")
            text.finish()
            return value
        count = text.logic()
        text.finish()
        if not 1 <= count <= expression.around or count != int(count):
            raise Unreadable(f"{expression.word} outside of a loop")
        return count

    def _ask(self, question: Question) -> bool | Unknown:
        """Whether a condition holds. Unknown with a guess if that rests on an assumption."""
        word, text, ends = question
        if word == "DO":
            raise Unreadable("DO stands alone")
        holds, is_open, _ = self.condition(text, ends)
        if word == "WHILE" and text[-2:].upper() != "DO":
            self.log.find("refused", "WHILE wants DO", line=self.line)
        is_unknown = bool(self.consulted) if word == "IF" else is_open
        return Unknown(guess=holds) if is_unknown else holds

    to_number = staticmethod(float)

    def matches(self, value: float | str, tests: str) -> bool:
        """Whether a VALUE has the value of its CASE."""
        self.spend(1)
        return self._is_one_of(value, tests)

    def _evaluate_item(self, text: Expression) -> float | str:
        return text.string() if text.is_string() else text.logic()

    def count_instructions(self) -> int:
        """The number of instructions so far."""
        return len(self.body)

    def assume(
        self, choice: Choice, step: Step, unknown: Unknown | None = None, length: int = 0
    ) -> bool:
        """Makes a choice of the engine, by other inputs if need be; whether that works."""
        if choice is Choice.LOOP_REPEATS:
            self._cut(length)
            is_while = isinstance(step, LoopStart) and step.condition is not None
            what = "a loop that repeats itself for ever is told for one of its rounds"
            self.log.assume(what, line=step.line if is_while else 0)
            return True
        assert isinstance(step, (Branch, LoopStart, LoopEnd))
        assert step.condition is not None
        assert unknown is not None
        text = step.condition.value.text
        if choice is Choice.LOOP_LIMITED:
            what = f"a loop that nothing known ends is run for {counted(self._rounds, 'round')}"
            self.log.assume(what, "rounds", self._rounds)
            return isinstance(step, LoopEnd) or self.wish(text[:-2], False, fresh=False)
        is_branch = isinstance(step, Branch)
        wanted = choice is not Choice.BRANCH_PASSED
        return unknown.guess == wanted or self.wish(text, wanted, fresh=is_branch)

    def read_state(self) -> object:
        """What the next round depends on; None where that is too much to keep."""
        tables = [self._globals]
        for scope in self._scopes:
            tables += [scope.own, scope.kept]
        size = sum(map(len, tables))
        if size > _MOST_STATE:
            return None
        self.spend(size // _LONG)
        values = tuple(tuple((k, _plain(v)) for k, v in table.items()) for table in tables)
        return values, _plain(self._at), tuple(self.outputs.items()), self._always, self._once

    def _cut(self, length: int) -> None:
        """Takes back what the repeated round has added."""
        del (
            self.body[length:],
            self.lines[length:],
            self.frames[length:],
            self.bases[length:],
            self.tool[length:],
        )
        for index in [index for index in self.durations if index >= length]:
            del self.durations[index]
        motions = [k for k, item in enumerate(self.body) if isinstance(item, (MoveJ, MoveL, MoveC))]
        self._last = motions[-1] if motions else None

    def open_count(self, count: str) -> Counter:
        """The counter of FOR."""
        text = Expression(count, self)
        name = text.take()
        if not name[0].isalpha():
            raise Unreadable(f"{name[:20]!r} is no name")
        name += text.subscripts()
        text.expect("=")
        return Counter(name, *read_bounds(text))

    def _is_one_of(self, wanted: float | str, tests: str) -> bool:
        if tests[-1:] != ":":
            raise Unreadable("VALUE wants a colon at its end")
        for item in split(tests[:-1]):
            text = Expression(item, self)
            value = self._evaluate_item(text)
            text.finish()
            if value == wanted:
                return True
        return False

    # -- calls ---------------------------------------------------------------------------------------------------

    def _react(self, statement: Statement) -> None:
        call = self.react(statement)
        if call:
            self._call(call)

    def _call(self, rest: str) -> None:
        match = CALLED.fullmatch(rest)
        if match is None:
            raise Unreadable("CALL wants the name of a program and its arguments")
        self._enter(match[1], match[2] or "()")

    def _call_by_text(self, rest: str) -> None:
        text = Expression(rest, self)
        name = text.string()
        left = text.rest()
        if not name:
            self._leave_out(f"CALLS {rest}: which program, is not known: left out")
            return
        self._enter(name, left or "()")

    def _leave_out(self, what: str) -> None:
        self.log.assume(what)
        self.log.lose(what)

    def _enter(self, name: str, brackets: str) -> None:
        routine = self._programs.get(canonical(name))
        if routine is None:
            self._leave_out(f"program {name} is not in these files: left out")
            return
        self._flow.check_depth(f"more than {_DEEPEST} programs call each other")
        given = list(split(unwrap(brackets)[0]))
        formals = [part.removesuffix("[]").strip() for part in split(routine.arguments)]
        if len([g for g in given if g]) > len([f for f in formals if f]):
            self.log.find("unusual", f"more arguments than program {routine.name} has")
        given += [""] * (len(formals) - len(given))
        cells = {
            canonical(formal.lstrip("&")): self.argument(formal.lstrip("&"), text)
            for formal, text in zip(formals, given, strict=False)
            if formal
        }
        line = self.line
        self.tell_inputs()
        self._run(routine, cells)
        self.line = line


def _plain(value: object) -> object:
    """Something that can be compared."""
    if isinstance(value, Location):
        return (
            value.local.origin,
            value.local.rotation.tobytes(),
            value.frame.external,
            value.frame.pose.origin,
        )
    return value.values if isinstance(value, Joints) else value


#: Instructions that call programs or wait, beside those of `Statements`.
_ACTS: dict[str, Callable[[Machine, Statement], object]] = {
    "CALL": lambda machine, statement: machine._call(statement.rest),
    "CALLS": lambda machine, statement: machine._call_by_text(statement.rest),
    "WAIT": lambda machine, statement: machine.wait(statement.rest),
    "WAIT.EVENT": lambda machine, statement: machine.wait_event(statement.rest),
    **dict.fromkeys(REACTIONS, Machine._react),
}
