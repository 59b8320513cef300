"""V+ instructions that are neither motions nor control: values, declarations, questions, tasks, settings by name."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping

from camgen.lang.log import Log
from camgen.lang.programs import Ask
from camgen.model.program import Joints

from .effects import LOST, OMITTED, SILENT, SILENT_PARAMETERS, UNSEEN
from .instructions import DOES, REACTIONS
from .locations import BUILT, Expression, to_values
from .names import canonical
from .robot import Robot
from .text import Location, Statement, Unreadable
from .variables import Cell, Table, Value

#: A variable alone, with subscripts or without: an argument that its program can change.
PLAIN = re.compile(r"[#$]?[A-Za-z][A-Za-z0-9._]*\s*(?:\[[^\"]*\])?")
_NO_VARIABLE = frozenset({"TRUE", "FALSE", "ON", "OFF", "PI", *BUILT, "#PPOINT", "RANDOM", "TIME"})
_TYPED = re.compile(r"(REAL|DOUBLE|LOC|STRING)\s+", re.IGNORECASE)
_NAME = re.compile(r"[#$]?[A-Za-z][A-Za-z0-9._]*")
_PROGRAM = re.compile(r"([A-Za-z][A-Za-z0-9._]*)\s*(?:\(|,|$)")
#: The end of a program: RETURN and its kind lead on, the rest ends the run.
ENDS = frozenset({"HALT", "STOP", "PANIC"})


def split(text: str) -> Iterator[str]:
    """Arguments: what stands between the commas outside of brackets and strings."""
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
    """``(a, b) c``: what stands in the brackets at the front, and what follows them."""
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
    """The instructions, one by one; those of control stand above. beside, reactions: the programs that EXECUTE starts
    and that REACT names, how they are told, and their line. come: reactions that have come.
    """

    def __init__(self, ask: Ask, log: Log) -> None:
        super().__init__(ask, log)
        self.beside: dict[str, tuple[str, int]] = {}
        self.reactions: dict[str, tuple[str, int]] = {}
        self.come: set[str] = set()

    def do(self, statement: Statement) -> None:
        """Carries out an instruction that the next one follows."""
        word = statement.word
        if word in DOES:
            DOES[word](self, statement)
        elif word in _MORE:
            _MORE[word](self, statement)
        elif word in LOST:
            self.log.find("unusual", f"{word} is not evaluated: {LOST[word]}", line=statement.line)
            self.log.lose(f"{word} is not evaluated: {LOST[word]}", line=statement.line)
            if word in UNSEEN:
                self.lost(word)
        elif word in OMITTED:
            self.log.omit(
                f"{word} {statement.rest}".rstrip() + f": {OMITTED[word]}", line=statement.line
            )
        elif word in REACTIONS:
            self.react(statement)
        elif word not in SILENT:
            raise Unreadable(f"{word[:40]} is no instruction of V+")

    # -- values --------------------------------------------------------------------------------------------------

    def let(self, statement: Statement) -> None:
        """``name = value``."""
        text = Expression(statement.rest, self)
        name = text.take()
        if not _NAME.fullmatch(name):
            raise Unreadable(f"{name[:20]!r} is no name")
        name += text.subscripts()
        text.expect("=")
        if name[0] == "#":
            raise Unreadable("a precision point is given its value by SET")
        value: Value = text.string() if name[0] == "$" else text.logic()
        text.finish()
        self.warn(text)
        self.assign(name, value)

    def set(self, statement: Statement) -> None:
        """``SET name = location``."""
        self.check_here(statement.rest)
        text = Expression(statement.rest, self)
        name = self._left(text)
        text.expect("=")
        found = text.any_point() if name[0] == "#" else text.location()
        text.finish()
        self._keep(name, found)

    def _left(self, text: Expression) -> str:
        name = text.take()
        if not _NAME.fullmatch(name) or name[0] == "$":
            raise Unreadable(f"{name[:20]!r} is no name of a location")
        return name + text.subscripts()

    def _keep(self, name: str, found: Location | Joints) -> None:
        if isinstance(found, Location) and not found.frame.external:
            found = Location(found.local, found.frame, canonical(name))
        self.assign(name, found)

    def define_here(self, statement: Statement) -> None:
        """``HERE name``."""
        self.check_here("HERE")
        text = Expression(statement.rest, self)
        name = self._left(text)
        text.finish()
        self._keep(name, self.point_here("HERE") if name[0] == "#" else self.here("HERE"))

    def joints_here(self, statement: Statement) -> None:
        """``JHERE a, b, ..``: joint values into variables."""
        self.check_here("HERE")
        where = self.point_here("HERE")
        values = to_values(where) if isinstance(where, Joints) else []
        for k, name in enumerate(split(statement.rest)):
            if k < len(values):
                self.assign(self.variable(name), values[k])
            else:
                self.hear(name)

    def variable(self, name: str) -> str:
        """The name of a variable, with its subscripts worked out."""
        text = Expression(name, self)
        found = text.take()
        if not _NAME.fullmatch(found):
            raise Unreadable(f"{found[:20]!r} is no name")
        found += text.subscripts()
        text.finish()
        return found

    def hear(self, name: str) -> None:
        """A variable that gets its value from outside."""
        if not name:
            return
        found = self.variable(name)
        key = canonical(found)
        base = key.partition("[")[0]
        given = self._assume.get(key, self._assume.get(base))
        self.doubt = given is None
        if found[0] == "$":
            self.log.assume(f"string {base} comes from outside: taken as empty")
            self.assign(found, "")
        elif found[0] == "#":
            self.assign(found, self._taught(key, "precision point"))
        else:
            value = 1.0 if given is None else given
            self.log.assume(f"{base} comes from outside: taken for {value:g}", base, value)
            self.assign(found, value)

    def prompt(self, statement: Statement) -> None:
        """``PROMPT text, variables``: the operator answers."""
        first, *names = split(statement.rest)
        for name in names if first[:1] in ('"', "$", "/", "") else [first, *names]:
            self.hear(name)

    def declares(self, statement: Statement) -> None:
        """``AUTO``, ``LOCAL`` and ``GLOBAL``."""
        word, scope = statement.word, self._scopes[-1]
        if word == "GLOBAL":
            return
        bare = statement.rest
        for part in split(bare):
            name = re.sub(r"\s*\[[^\]]*\]$", "", _TYPED.sub("", part, count=1))
            if not _NAME.fullmatch(name):
                raise Unreadable(f"{name[:20]!r} is no name")
            key = canonical(name)
            if key in scope.others:
                self.log.find(
                    "unusual", f"{word} {key}: the argument of that name is not seen any more"
                )
                del scope.others[key]
            if word == "AUTO" and key in scope.own:
                raise Unreadable(f"{key} is declared twice")
            if word == "AUTO":
                scope.own[key] = None
            else:
                scope.kept.setdefault(key, None)

    def warn(self, text: Expression) -> None:
        """A remark on a condition whose order of evaluation may surprise."""
        if text.unbracketed:
            what = "a comparison beside AND, OR or XOR without brackets: which comes first is not confirmed"
            self.log.find("unusual", what)

    # -- settings by name ----------------------------------------------------------------------------------------

    def timer(self, statement: Statement) -> None:
        """``TIMER n = seconds``."""
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
        """``PARAMETER name = value``, ``SWITCH name = value``."""
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
        """``SELECT ROBOT = n``."""
        name, _, rest = statement.rest.partition("=")
        if name.strip().upper() == "ROBOT" and rest.strip() not in ("1", ""):
            self.log.omit(f"SELECT ROBOT = {rest.strip()}: the robot that moves")

    def solve(self, statement: Statement) -> None:
        """``SOLVE.ANGLES`` and ``SOLVE.TRANS``: the kinematics of the arm, which no text has."""
        left = statement.rest.partition("=")[0]
        for name in split(left):
            if PLAIN.fullmatch(name):
                self.hear(name)

    def execute(self, statement: Statement) -> None:
        """``EXECUTE task program``: it runs beside this one."""
        rest = statement.rest
        bare = re.sub(r"^\s*(/\w+\s*)?(\([^)]*\)|\d+)?\s*,?\s*", "", rest)
        match = _PROGRAM.match(bare) or _PROGRAM.match(bare.partition(" ")[2])
        if match is None:
            raise Unreadable("EXECUTE wants the name of a program")
        number = rest[: len(rest) - len(bare)].strip(" ,()")
        self.beside.setdefault(
            canonical(match[1]), (f"{match[1]}{f' (task {number})' if number else ''}", self.line)
        )

    def react(self, statement: Statement) -> str:
        """``REACT signal, program(arguments), priority``: the call that may come, "" where it names none."""
        parts = [one for one in split(statement.rest) if one]
        call = parts[0] if statement.word == "REACTE" else (parts[1] if len(parts) > 1 else "")
        match = _PROGRAM.match(call)
        if match is None:
            self.log.fact("reactions", f"{statement.word} {statement.rest}".strip())
            return ""
        key = canonical(match[1])
        comes = bool(self._assume.get(key))
        what = "comes once, where it first may" if comes else "does not come"
        self.log.assume(f"{statement.word} {match[1]}: it {what}", key, float(comes))
        if comes and key not in self.come:
            self.come.add(key)
            return call
        self.reactions.setdefault(
            key, (f"{match[1]} ({statement.word}, line {self.line})", self.line)
        )
        return ""

    # -- arguments -----------------------------------------------------------------------------------------------

    def argument(self, formal: str, text: str) -> Cell:
        """What the argument ``text`` of a CALL is for a program that calls it ``formal``."""
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
    "=": Statements.let, "AUTO": Statements.declares, "EXECUTE": Statements.execute,
    "GLOBAL": Statements.declares, "HERE": Statements.define_here, "JHERE": Statements.joints_here,
    "LOCAL": Statements.declares, "PARAMETER": Statements.parameter, "PROMPT": Statements.prompt,
"SELECT": Statements.select, "SET": Statements.set,
    "SOLVE.ANGLES": Statements.solve, "SOLVE.TRANS": Statements.solve, "SWITCH": Statements.parameter,
    "TIMER": Statements.timer,
}  # fmt: skip
