"""Runs V+ instructions for values, declarations, prompts, tasks and settings."""

from __future__ import annotations

import re
from collections.abc import Iterator

from camgen.model.program import Joints

from .effects import SILENT_PARAMETERS
from .locations import BUILT, Expression, read_whole, to_values
from .names import canonical
from .robot import Robot
from .text import Location, Statement, Unreadable
from .variables import NAME_PATTERN, Cell, Table, Value

#: A single variable, with or without subscripts: an argument that is passed by reference.
PLAIN = re.compile(r"[#$]?[A-Za-z][A-Za-z0-9._]*\s*(?:\[[^\"]*\])?")
_NO_VARIABLE = frozenset({"TRUE", "FALSE", "ON", "OFF", "PI", *BUILT, "#PPOINT", "RANDOM", "TIME"})
_SEPARATOR = re.compile(r'"[^"]*"?|[(),\[\]]')
_TYPED = re.compile(r"(REAL|DOUBLE|LOC|STRING)\s+", re.IGNORECASE)
#: Instructions that end the run.
ENDS = frozenset({"HALT", "STOP", "PANIC"})


def split(text: str) -> Iterator[str]:
    """Split arguments at the commas outside of brackets and strings."""
    depth = start = 0
    for match in _SEPARATOR.finditer(text):
        sign = match[0]
        if sign == "," and not depth:
            yield text[start : match.start()].strip()
            start = match.end()
        depth += (sign in ("(", "[")) - (sign in (")", "]"))
    yield text[start:].strip()


def unwrap(text: str) -> tuple[str, str]:
    """Split `(a, b) c` into the text inside the brackets and the text after them."""
    depth = 0
    for match in _SEPARATOR.finditer(text):
        depth += (match[0] == "(") - (match[0] == ")")
        if match[0] == ")" and not depth:
            return text[1 : match.start()].strip(), text[match.end() :].strip()
    raise Unreadable("a bracket is not closed")


class Statements(Robot):
    """Runs instructions that are neither motions nor flow."""

    # -- values --------------------------------------------------------------------------------

    def assign_value(self, statement: Statement) -> None:
        """Run `name = value`."""
        text = Expression(statement.rest, self)
        name = text.variable()
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
        name = text.location_name()
        text.expect("=")
        value = text.point() if name[0] == "#" else text.location()
        text.finish()
        self._assign_location(name, value)

    def _assign_location(self, name: str, value: Location | Joints) -> None:
        if isinstance(value, Location) and not value.frame.external:
            value = Location(value.local, value.frame, canonical(name))
        self.assign(name, value)

    def define_here(self, statement: Statement) -> None:
        """Run `HERE name`."""
        self.check_here("HERE")
        name = read_whole(statement.rest, self, Expression.location_name)
        current = self.current_point if name[0] == "#" else self.current_location
        self._assign_location(name, current("HERE"))

    def joints_here(self, statement: Statement) -> None:
        """Run `JHERE a, b, ..`, which assigns the joint values to variables."""
        self.check_here("HERE")
        point = self.current_point("HERE")
        values = to_values(point) if isinstance(point, Joints) else []
        for k, name in enumerate(split(statement.rest)):
            if k < len(values):
                self.assign(read_whole(name, self, Expression.variable), values[k])
            else:
                self.assign_external(name)

    def assign_external(self, name: str) -> None:
        """Assign an external value to a variable, which is an assumption."""
        if not name:
            return
        variable = read_whole(name, self, Expression.variable)
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
            if not NAME_PATTERN.fullmatch(name):
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
        number = text.logic()
        text.expect("=")
        seconds = text.logic()
        text.finish()
        self.timers[number] = self.clock - seconds

    def parameter(self, statement: Statement) -> None:
        """Run `PARAMETER name = value` or `SWITCH name = value`."""
        name, sign, rest = statement.rest.partition("=")
        if not sign:
            raise Unreadable(f"{statement.word} wants name = value")
        value = read_whole(rest, self, Expression.logic)
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
            value = expression.point()
        elif expression.peek() in BUILT or ":" in text:
            value = expression.location()
        else:
            name = canonical(text)
            if isinstance(self._value(name), Location):
                return self._value(name)
            value = expression.logic()
        expression.finish()
        return value
