"""Runs V+ instructions for values, declarations, prompts, tasks and settings."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping

from camgen.lang.log import Log
from camgen.lang.programs import RunRequest
from camgen.lang.values import require
from camgen.model.program import Joints

from .effects import LOST, OMITTED, SILENT, SILENT_PARAMETERS, UNSEEN
from .instructions import DOES, REACTIONS
from .locations import BUILT, Expression, to_values
from .names import canonical
from .robot import Robot
from .text import Location, Statement, Unreadable
from .variables import Cell, Table, Value

#: A single variable, with or without subscripts: an argument that is passed by reference.
PLAIN = re.compile(r"[#$]?[A-Za-z][A-Za-z0-9._]*\s*(?:\[[^\"]*\])?")
_NO_VARIABLE = frozenset({"TRUE", "FALSE", "ON", "OFF", "PI", *BUILT, "#PPOINT", "RANDOM", "TIME"})
_TYPED = re.compile(r"(REAL|DOUBLE|LOC|STRING)\s+", re.IGNORECASE)
_NAME = re.compile(r"[#$]?[A-Za-z][A-Za-z0-9._]*")
_PROGRAM = re.compile(r"([A-Za-z][A-Za-z0-9._]*)\s*(?:\(|,|$)")
#: Instructions that end the run.
ENDS = frozenset({"HALT", "STOP", "PANIC"})


def split(text: str) -> Iterator[str]:
    """Split arguments at the commas outside of brackets and strings."""
    depth, start, quoted = 0, 0, False
    for at, c in enumerate(text):
        if c == '"':
            quoted = not quoted
        elif quoted:
            continue
        elif c in "([":
            depth += 1
        elif c in ")]":
            depth -= 1
        elif c == "," and not depth:
            yield text[start:at].strip()
            start = at + 1
    yield text[start:].strip()


def unwrap(text: str) -> tuple[str, str]:
    """Split `(a, b) c` into the text inside the brackets and the text after them."""
    depth, quoted = 0, False
    for at, c in enumerate(text):
        if c == '"':
            quoted = not quoted
        elif c == "(" and not quoted:
            depth += 1
        elif c == ")" and not quoted:
            depth -= 1
            if not depth:
                return text[1:at].strip(), text[at + 1 :].strip()
    raise Unreadable("a bracket is not closed")


class Statements(Robot):
    """Runs instructions that are neither motions nor flow.

    tasks: description and line of each EXECUTE, by the canonical name of its program.
    reactions: description and line of each REACT that was not run, by the name of its program.
    run_reactions: programs of the reactions that were run.
    """

    def __init__(self, request: RunRequest, log: Log) -> None:
        super().__init__(request, log)
        self.tasks: dict[str, tuple[str, int]] = {}
        self.reactions: dict[str, tuple[str, int]] = {}
        self.run_reactions: set[str] = set()

    def do(self, statement: Statement) -> None:
        """Run an instruction that is not a jump, a call or a test."""
        word = statement.word
        if word in DOES:
            DOES[word](self, statement)
        elif word in _MORE:
            _MORE[word](self, statement)
        elif word in LOST:
            self.log.find("unusual", f"{word} is not evaluated: {LOST[word]}", line=statement.line)
            self.log.lose(f"{word} is not evaluated: {LOST[word]}", line=statement.line)
            if word in UNSEEN:
                self.lose_position(word)
        elif word in OMITTED:
            self.log.omit(
                f"{word} {statement.rest}".rstrip() + f": {OMITTED[word]}", line=statement.line
            )
        elif word in REACTIONS:
            self.react(statement)
        elif word not in SILENT:
            raise Unreadable(f"{word[:40]} is not an instruction of V+")

    # -- values --------------------------------------------------------------------------------

    def assign_value(self, statement: Statement) -> None:
        """Run `name = value`."""
        text = Expression(statement.rest, self)
        name = text.take()
        if not _NAME.fullmatch(name):
            raise Unreadable(f"{name[:20]!r} is not a name")
        name += text.subscripts()
        text.expect("=")
        if name[0] == "#":
            raise Unreadable("a precision point is given its value by SET")
        value: Value = text.string() if name[0] == "$" else text.logic()
        text.finish()
        self.warn(text)
        self.assign(name, value)

    def set(self, statement: Statement) -> None:
        """Run `SET name = location`."""
        self.check_here(statement.rest)
        text = Expression(statement.rest, self)
        name = self._take_location_name(text)
        text.expect("=")
        value = text.any_point() if name[0] == "#" else text.location()
        text.finish()
        self._assign_location(name, value)

    def _take_location_name(self, text: Expression) -> str:
        name = text.take()
        if not _NAME.fullmatch(name) or name[0] == "$":
            raise Unreadable(f"{name[:20]!r} is not the name of a location")
        return name + text.subscripts()

    def _assign_location(self, name: str, value: Location | Joints) -> None:
        if isinstance(value, Location) and not value.frame.external:
            value = Location(value.local, value.frame, canonical(name))
        self.assign(name, value)

    def define_here(self, statement: Statement) -> None:
        """Run `HERE name`."""
        self.check_here("HERE")
        text = Expression(statement.rest, self)
        name = self._take_location_name(text)
        text.finish()
        self._assign_location(
            name, self.current_point("HERE") if name[0] == "#" else self.current_location("HERE")
        )

    def joints_here(self, statement: Statement) -> None:
        """Run `JHERE a, b, ..`, which assigns the joint values to variables."""
        self.check_here("HERE")
        point = self.current_point("HERE")
        values = to_values(point) if isinstance(point, Joints) else []
        for k, name in enumerate(split(statement.rest)):
            if k < len(values):
                self.assign(self.variable(name), values[k])
            else:
                self.assign_external(name)

    def variable(self, name: str) -> str:
        """Return the name of a variable with its subscripts evaluated."""
        text = Expression(name, self)
        word = text.take()
        if not _NAME.fullmatch(word):
            raise Unreadable(f"{word[:20]!r} is not a name")
        word += text.subscripts()
        text.finish()
        return word

    def assign_external(self, name: str) -> None:
        """Assign an external value to a variable, which is an assumption."""
        if not name:
            return
        variable = self.variable(name)
        key = canonical(variable)
        base = key.partition("[")[0]
        given = self._assume.get(key, self._assume.get(base))
        self.doubt = given is None
        if variable[0] == "$":
            self.log.assume(f"string {base} comes from outside: read as empty")
            self.assign(variable, "")
        elif variable[0] == "#":
            self.assign(variable, self._taught(key, "precision point"))
        else:
            value = self._assume.get(key, self._assume.get(base, 1.0))
            self.log.assume(f"{base} comes from outside: taken for {value:g}", base, value)
            self.assign(variable, value)

    def prompt(self, statement: Statement) -> None:
        """Run `PROMPT text, variables`: the operator gives their values."""
        first, *names = split(statement.rest)
        for name in names if first[:1] in ('"', "$", "/", "") else [first, *names]:
            self.assign_external(name)

    def declare_variables(self, statement: Statement) -> None:
        """Run `AUTO`, `LOCAL` or `GLOBAL`."""
        word, scope = statement.word, self._scopes[-1]
        if word == "GLOBAL":
            return
        for part in split(statement.rest):
            name = re.sub(r"\s*\[[^\]]*\]$", "", _TYPED.sub("", part, count=1))
            if not _NAME.fullmatch(name):
                raise Unreadable(f"{name[:20]!r} is not a name")
            key = canonical(name)
            if key in scope.arguments:
                self.log.find(
                    "unusual", f"{word} {key}: the argument of that name is not seen any more"
                )
                del scope.arguments[key]
            if word == "AUTO" and key in scope.auto:
                raise Unreadable(f"{key} is declared twice")
            if word == "AUTO":
                scope.auto[key] = None
            else:
                scope.local.setdefault(key, None)

    def warn(self, text: Expression) -> None:
        """Add a finding for an expression whose precedence of operators is not confirmed."""
        if text.unbracketed:
            what = "a comparison beside AND, OR or XOR without brackets"
            self.log.find("unusual", f"{what}: which comes first is not confirmed")

    # -- settings by name ----------------------------------------------------------------------

    def timer(self, statement: Statement) -> None:
        """Run `TIMER n = seconds`."""
        text = Expression(statement.rest, self)
        number = text.logic() if text.peek() != "(" else self._in_brackets(text)
        text.expect("=")
        seconds = text.logic()
        text.finish()
        self.timers[number] = self.clock - seconds

    def _in_brackets(self, text: Expression) -> float:
        text.take()
        number = text.logic()
        text.expect(")")
        return number

    def parameter(self, statement: Statement) -> None:
        """Run `PARAMETER name = value` or `SWITCH name = value`."""
        name, sign, rest = statement.rest.partition("=")
        if not sign:
            raise Unreadable(f"{statement.word} wants name = value")
        text = Expression(rest, self)
        value = text.logic()
        text.finish()
        key = "".join(name.split()).lower()
        if statement.word == "PARAMETER":
            self.parameters[key] = value
            if key not in SILENT_PARAMETERS:
                self.log.omit(f"PARAMETER {key}: a parameter of the controller")
        else:
            self.set_switch(statement.word, key, value != 0)

    def select(self, statement: Statement) -> None:
        """Run `SELECT ROBOT = n`."""
        name, _, rest = statement.rest.partition("=")
        if name.strip().upper() == "ROBOT" and rest.strip() not in ("1", ""):
            self.log.omit(f"SELECT ROBOT = {rest.strip()}: the robot that moves")

    def solve(self, statement: Statement) -> None:
        """Run `SOLVE.ANGLES` or `SOLVE.TRANS`, whose values only the controller computes."""
        for name in split(statement.rest.partition("=")[0]):
            if PLAIN.fullmatch(name):
                self.assign_external(name)

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

    def react(self, statement: Statement) -> str:
        """Run `REACT signal, program(arguments), priority` or `REACTE program(arguments)`.

        Returns the call if the user assumes that the reaction is run, at its first REACT. Otherwise
        the reaction is noted, and the result is empty.
        """
        parts = [part for part in split(statement.rest) if part]
        position = 0 if statement.word == "REACTE" else 1
        call = parts[position] if len(parts) > position else ""
        match = _PROGRAM.match(call)
        if match is None:
            self.log.fact("reactions", f"{statement.word} {statement.rest}".strip())
            return ""
        key = canonical(match[1])
        is_run = bool(self._assume.get(key))
        what = "comes once, where it first may" if is_run else "does not come"
        self.log.assume(f"{statement.word} {match[1]}: it {what}", key, float(is_run))
        if is_run and key not in self.run_reactions:
            self.run_reactions.add(key)
            return call
        self.reactions.setdefault(
            key, (f"{match[1]} ({statement.word}, line {self.line})", self.line)
        )
        return ""

    # -- arguments -----------------------------------------------------------------------------

    def argument(self, formal: str, text: str) -> Cell:
        """Return the cell for the argument `text` of a CALL.

        A variable is passed by reference, any other value in a new cell. formal: name of the
        argument in the called program.
        """
        key = canonical(formal)
        if not text:
            return Cell({}, key)
        bare = text.removesuffix("[]").strip()
        if not bare.startswith("&") and PLAIN.fullmatch(bare) and bare.upper() not in _NO_VARIABLE:
            expression = Expression(bare, self)
            name = expression.take()
            name += expression.subscripts()
            if not expression.peek():
                return self.cell(name)
        table: Table = {key: self._by_value(formal, bare.removeprefix("&").strip())}
        return Cell(table, key)

    def _by_value(self, formal: str, text: str) -> Value | None:
        expression = Expression(text, self)
        value: Value
        if formal[:1] == "$" or expression.is_string():
            value = expression.string()
        elif expression.peek()[:1] == "#":
            value = expression.any_point()
        elif expression.peek() in BUILT or ":" in text:
            value = expression.location()
        else:
            name = canonical(text)
            if isinstance(self._value(name), Location):
                return self._value(name)
            value = expression.logic()
        expression.finish()
        return value


_MORE: Mapping[str, Callable[[Statements, Statement], None]] = {
    "=": Statements.assign_value,
    "AUTO": Statements.declare_variables,
    "EXECUTE": Statements.execute,
    "GLOBAL": Statements.declare_variables,
    "HERE": Statements.define_here,
    "JHERE": Statements.joints_here,
    "LOCAL": Statements.declare_variables,
    "PARAMETER": Statements.parameter,
    "PROMPT": Statements.prompt,
    "SELECT": Statements.select,
    "SET": Statements.set,
    "SOLVE.ANGLES": Statements.solve,
    "SOLVE.TRANS": Statements.solve,
    "SWITCH": Statements.parameter,
    "TIMER": Statements.timer,
}
