"""Runs V+ programs: calls, and the answers to the questions of the engine.

A loop whose end is not determined by the text runs once, or as often as `--assume rounds=3` sets.
An input that the user has not set is off, unless the program would then end or wait.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from itertools import chain
from typing import Any

from camgen.lang.code import Branch, LoopEnd, LoopStart, Step
from camgen.lang.flow import Choice, Counter, Flow, Rules
from camgen.lang.log import Log
from camgen.lang.programs import RunRequest
from camgen.lang.run import Ended, Stopped
from camgen.lang.values import Unknown, require
from camgen.model.program import Joints, MoveC, MoveJ, MoveL
from camgen.model.text import counted

from .arm import POSTURES
from .code import CaseValue, LoopCount, Question, measure_cost, read_bounds
from .effects import LOST, OMITTED, SILENT, UNSEEN
from .locations import Expression
from .names import canonical
from .statements import split, unwrap
from .text import Impossible, Location, Routine, Statement, Unreadable
from .units import FileUnits
from .variables import Cell, Table, Value
from .walk import Walker

#: Maximum depth of calls. V+ has a limited stack, too.
_MAX_DEPTH = 60
CALLED = re.compile(r"([A-Za-z][A-Za-z0-9._]*)\s*(\(.*\))?", re.DOTALL)
#: A program with its arguments.
_PROGRAM = re.compile(r"([A-Za-z][A-Za-z0-9._]*)\s*(?:\(|,|$)")
#: Maximum number of variables in a state that is compared.
_MAX_STATE = 3000
#: Number of variables in a state that cost one step when they are compared.
_VARIABLES_PER_STEP = 60
#: Steps that the budget of a run gains for each line of a file that the program reads.
_STEPS_PER_LINE = 100


class Machine(FileUnits, Walker):
    """A run of the programs.

    programs: programs by their canonical name.
    stopped: line and reason if the run could not reach its end, otherwise None.
    ran: canonical names of the programs that were run.
    tasks: description and line of each EXECUTE, by the canonical name of its program.
    reactions: description and line of each REACT that was not run, by the name of its program.
    """

    def __init__(
        self,
        programs: Sequence[Routine],
        request: RunRequest,
        log: Log,
        files: Mapping[str, str],
        values: Mapping[str, Value],
    ) -> None:
        """`values` are the globals that have a value already, `files` may be read."""
        super().__init__(request, log, files)
        self._globals.update(values)
        self.programs = {canonical(routine.name): routine for routine in reversed(programs)}
        self._kept: dict[str, Table] = {}
        self._rounds = max(1, int(min(self._assume.get("rounds", 1.0), 1e6)))
        size = sum(map(measure_cost, chain.from_iterable(item.statements for item in programs)))
        lines = sum(text.count("\n") for text in files.values())
        self.budget.left += size + _STEPS_PER_LINE * lines
        self._flow = Flow(self, self.budget, Rules(_MAX_DEPTH, self._rounds, skips_blocks=True))
        self.stopped: tuple[int, str] | None = None
        self.ran: set[str] = set()
        self.tasks: dict[str, tuple[str, int]] = {}
        self.reactions: dict[str, tuple[str, int]] = {}
        self._run_reactions: set[str] = set()

    def last(self, name: str) -> float:
        """See `Variables.last`. Costs steps, since it searches the table."""
        self.budget.spend(len(self.cell(name).table) // 8)
        return super().last(name)

    def run(self, routine: Routine) -> None:
        """Run a program and all that it calls."""
        try:
            self._run(routine, {})
        except Ended:
            pass
        except Stopped as error:
            self.stopped = self.line, str(error)
        self.rest()

    def _run(self, routine: Routine, arguments: Mapping[str, Cell]) -> None:
        key = canonical(routine.name)
        self.ran.add(key)
        self.enter(self._kept.setdefault(key, {}))
        self._scopes[-1].arguments.update(arguments)
        self._flow.run(routine.code)
        self.assume_inputs()
        self.leave()

    def add_fault(self, line: int, word: str, error: Exception) -> None:
        """Add a finding for an instruction that cannot be run."""
        if self.doubt and isinstance(error, Impossible):
            what = f"not evaluated: {error} (with what is assumed)"
            self.log.find("unusual", what, line=line)
            self.log.lose(what, line=line)
        else:
            self.log.find("refused", str(error), line=line)
        if word in _MOTIONS:
            self.lose_position(word)

    def act(self, statement: Statement) -> None:
        """Run an instruction that is not part of the flow."""
        word = statement.word
        if word in DOES:
            DOES[word](self, statement)
        elif word in LOST:
            what = f"{word} is not evaluated: {LOST[word]}"
            self.log.find("unusual", what)
            self.log.lose(what)
            if word in UNSEEN:
                self.lose_position(word)
        elif word in OMITTED:
            self.log.omit(f"{word} {statement.rest}".rstrip() + f": {OMITTED[word]}")
        elif word not in SILENT:
            raise Unreadable(f"{word[:40]} is not an instruction of V+")

    # -- answers to the engine (`camgen.lang.flow.Language`) ------------------------------------

    def begin(self, step: Step) -> None:
        """Start a step."""
        if self.consulted:
            self.assume_inputs()
        self.line = step.line
        self.doubt = False

    def evaluate(self, expression: Question | CaseValue | LoopCount | str) -> Any:
        """Evaluate a condition, a CASE, the count of EXIT or NEXT, or a counter."""
        if isinstance(expression, Question):
            return self._evaluate_condition(expression)
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

    def _evaluate_condition(self, question: Question) -> bool | Unknown:
        word, text, ends = question
        if word == "DO":
            raise Unreadable("DO stands alone")
        holds, is_open = self.condition(text, ends)
        if word == "WHILE" and text[-2:].upper() != "DO":
            self.log.find("refused", "WHILE wants DO", line=self.line)
        is_unknown = bool(self.consulted) if word == "IF" else is_open
        return Unknown(guess=holds) if is_unknown else holds

    def matches(self, value: float | str, tests: str) -> bool:
        """Whether a VALUE has the value of its CASE."""
        self.budget.spend()
        return self._is_one_of(value, tests)

    def _evaluate_item(self, text: Expression) -> float | str:
        return text.string() if text.is_string() else text.logic()

    def assume(
        self, choice: Choice, step: Step, unknown: Unknown | None = None, length: int = 0
    ) -> bool:
        """Make a choice of the engine by a change of inputs. Returns whether it was possible."""
        if choice is Choice.LOOP_REPEATS:
            self._delete_from(length)
            is_while = isinstance(step, LoopStart) and step.condition is not None
            what = "a loop without an end is shown for one round"
            self.log.assume(what, line=step.line if is_while else 0)
            return True
        assert isinstance(step, (Branch, LoopStart, LoopEnd))
        assert step.condition is not None
        assert unknown is not None
        text = step.condition.value.text
        if choice is Choice.LOOP_LIMITED:
            what = f"a loop that nothing known ends is run for {counted(self._rounds, 'round')}"
            self.log.assume(what, "rounds", self._rounds)
            return isinstance(step, LoopEnd) or self.change_inputs(text[:-2], False, fresh=False)
        is_branch = isinstance(step, Branch)
        wanted = choice is not Choice.BRANCH_PASSED
        return unknown.guess == wanted or self.change_inputs(text, wanted, fresh=is_branch)

    def read_state(self) -> object:
        """Return the state that decides the next iteration, None if it is too large."""
        tables = [self._globals]
        for scope in self._scopes:
            tables += [scope.auto, scope.local]
        size = sum(map(len, tables))
        if size > _MAX_STATE:
            return None
        self.budget.spend(size // _VARIABLES_PER_STEP)
        values = tuple(map(_make_comparable, tables))
        return (
            values,
            _make_comparable(self._at),
            tuple(self.outputs.items()),
            self._always,
            self._once,
        )

    def _delete_from(self, length: int) -> None:
        del self.body[length:], self.lines[length:], self.frames[length:]
        del self.bases[length:], self.tool[length:]
        self.durations = {k: seconds for k, seconds in self.durations.items() if k < length}
        motions = [k for k, item in enumerate(self.body) if isinstance(item, (MoveJ, MoveL, MoveC))]
        self._last = motions[-1] if motions else None

    def open_count(self, count: str) -> Counter:
        """Open the counter of a FOR."""
        text = Expression(count, self)
        name = text.take()
        if not name[0].isalpha():
            raise Unreadable(f"{name[:20]!r} is not a name")
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

    # -- calls --------------------------------------------------------------------------------

    def execute(self, statement: Statement) -> None:
        """Note `EXECUTE task program`, which starts a concurrent task."""
        rest = statement.rest
        bare = re.sub(r"^\s*(/\w+\s*)?(\([^)]*\)|\d+)?\s*,?\s*", "", rest)
        match = require(
            _PROGRAM.match(bare) or _PROGRAM.match(bare.partition(" ")[2]),
            Unreadable("EXECUTE wants the name of a program"),
        )
        number = rest[: len(rest) - len(bare)].strip(" ,()")
        task = f" (task {number})" if number else ""
        self.tasks.setdefault(canonical(match[1]), (f"{match[1]}{task}", self.line))

    def react(self, statement: Statement) -> None:
        """Run `REACT signal, program(arguments), priority` or `REACTE program(arguments)`.

        The reaction is run at its first REACT if the user assumes that. Otherwise it is noted.
        """
        parts = [part for part in split(statement.rest) if part]
        position = 0 if statement.word == "REACTE" else 1
        call = parts[position] if len(parts) > position else ""
        match = _PROGRAM.match(call)
        if match is None:
            self.log.fact("reactions", f"{statement.word} {statement.rest}".strip())
            return
        key = canonical(match[1])
        is_run = bool(self._assume.get(key))
        what = "comes once, where it first may" if is_run else "does not come"
        self.log.assume(f"{statement.word} {match[1]}: it {what}", key, float(is_run))
        if is_run and key not in self._run_reactions:
            self._run_reactions.add(key)
            self.call(Statement(self.line, "CALL", call))
        else:
            text = f"{match[1]} ({statement.word}, line {self.line})"
            self.reactions.setdefault(key, (text, self.line))

    def call(self, statement: Statement) -> None:
        """Run `CALL program(arguments)`."""
        match = require(
            CALLED.fullmatch(statement.rest),
            Unreadable("CALL wants the name of a program and its arguments"),
        )
        self._enter(match[1], match[2] or "()")

    def call_by_text(self, statement: Statement) -> None:
        """Run `CALLS text(arguments)`."""
        rest = statement.rest
        text = Expression(rest, self)
        name = text.string()
        arguments = text.rest()
        if not name:
            self.log.leave_out(f"CALLS {rest}: which program, is not known: left out")
            return
        self._enter(name, arguments or "()")

    def _enter(self, name: str, brackets: str) -> None:
        routine = self.programs.get(canonical(name))
        if routine is None:
            self.log.leave_out(f"program {name} is not in these files: left out")
            return
        self._flow.check_depth(f"more than {_MAX_DEPTH} programs call each other")
        given = list(split(unwrap(brackets)[0]))
        formals = [part.removesuffix("[]").strip() for part in split(routine.arguments)]
        if sum(map(bool, given)) > sum(map(bool, formals)):
            self.log.find("unusual", f"more arguments than program {routine.name} has")
        given += [""] * (len(formals) - len(given))
        cells = {
            canonical(formal.lstrip("&")): self.argument(formal.lstrip("&"), text)
            for formal, text in zip(formals, given, strict=False)
            if formal
        }
        line = self.line
        self.assume_inputs()
        self._run(routine, cells)
        self.line = line


def _make_comparable(value: object) -> object:
    if isinstance(value, Location):
        return (
            value.local.origin,
            value.local.rotation.tobytes(),
            value.frame.external,
            value.frame.pose.origin,
        )
    if isinstance(value, dict):
        return tuple((key, _make_comparable(item)) for key, item in value.items())
    return value.values if isinstance(value, Joints) else value


#: Motions: if one cannot be read, the pose of the robot is not known after it.
_MOTIONS = frozenset(
    """ALIGN APPRO APPROS DEPART DEPARTS DRIVE JMOVE MOVE MOVES MOVEST MOVET NEST READY
    """.split()  # noqa: SIM905 (a table)
)
#: Instructions with a method that runs them; all others are in `effects.py` (V+ Language Reference
#: Guide, keywords, see docs/languages/vplus.md).
DOES: Mapping[str, Callable[[Machine, Statement], object]] = {
    "=": Machine.assign_value,
    "ATTACH": Machine.attach,
    "BASE": Machine.base,
    "BITS": Machine.set_bits,
    "CALL": Machine.call,
    "CALLS": Machine.call_by_text,
    "DECOMPOSE": Machine.decompose,
    "DELAY": Machine.delay,
    "DETACH": Machine.detach,
    "DRIVE": Machine.drive,
    "DURATION": Machine.duration,
    "EXECUTE": Machine.execute,
    "FCLOSE": Machine.close,
    "FOPENR": Machine.open,
    "HERE": Machine.define_here,
    "JHERE": Machine.joints_here,
    "JMOVE": Machine.jmove,
    "PAUSE": Machine.stop,
    "PROMPT": Machine.prompt,
    "READ": Machine.read,
    "RESET": Machine.reset,
    "SELECT": Machine.select,
    "SET": Machine.set,
    "SIGNAL": Machine.signal,
    "SPEED": Machine.speed,
    "TIMER": Machine.timer,
    "TOOL": Machine.set_tool,
    "WAIT": Machine.wait,
    "WAIT.EVENT": Machine.wait_event,
    **dict.fromkeys(("ALIGN", "NEST", "READY"), Machine.move_external),
    **dict.fromkeys(("APPRO", "APPROS"), Machine.appro),
    **dict.fromkeys(("AUTO", "GLOBAL", "LOCAL"), Machine.declare_variables),
    **dict.fromkeys(("BRAKE", "BREAK"), Machine.brake),
    **dict.fromkeys(("CLOSE", "CLOSEI", "OPEN", "OPENI", "RELAX", "RELAXI"), Machine.hand),
    **dict.fromkeys(("COARSE", "FINE", "NULL", "NONULL"), Machine.set_accuracy),
    **dict.fromkeys(("CPOFF", "CPON"), Machine.path),
    **dict.fromkeys(("DEPART", "DEPARTS"), Machine.depart),
    **dict.fromkeys(("DISABLE", "ENABLE"), Machine.switch),
    **dict.fromkeys(("MOVE", "MOVES", "MOVEST", "MOVET"), Machine.move),
    **dict.fromkeys(("PARAMETER", "SWITCH"), Machine.parameter),
    **dict.fromkeys(("REACT", "REACTE", "REACTI"), Machine.react),
    **dict.fromkeys(("SOLVE.ANGLES", "SOLVE.TRANS"), Machine.solve),
    **dict.fromkeys(POSTURES, Machine.configure),
}
