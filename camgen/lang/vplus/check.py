"""Checks whether the controller would accept those lines of a V+ program that were not run.

Each line is evaluated as if it were run, with values that fit everywhere. A line that is not V+ is
a finding. A line that is impossible only with these values is accepted.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping, Sequence, Set
from typing import Any

from camgen.lang.code import JumpTable
from camgen.lang.log import Log
from camgen.lang.programs import RunRequest
from camgen.lang.values import require

from .code import GOES, CaseValue, read_bounds, read_label
from .flow import CALLED, Machine
from .locations import Expression, make_external
from .statements import ENDS, split, unwrap
from .text import Impossible, Location, Routine, Statement, Unreadable
from .variables import Cell, Value

#: Instructions whose operands are not checked here.
_IGNORED = frozenset({"ANY", "AUTO", "ELSE", "END", "GLOBAL", "LOCAL", "RETURN", "RETURNE"})
_ANYWHERE = make_external("somewhere")


class _Checker(Machine):
    """Checks single instructions of a program, without any lasting effect.

    routine: the program.
    lines_outside_of_loops: lines of its EXIT and NEXT that no loop is around.
    """

    routine: Routine
    lines_outside_of_loops: Set[int]

    def _value(self, key: str) -> None:  # noqa: ARG002 (none is kept)
        return None

    def missing(self, name: str, value: Value | None, kind: str) -> Any:  # noqa: ARG002 (any)
        self.doubt = self.doubt or kind == "real"
        return {"real": 1.0, "string": ""}.get(kind, _ANYWHERE)

    def current_location(self, word: str) -> Location:  # noqa: ARG002 (any)
        return _ANYWHERE

    def assign(self, name: str, value: Value) -> None:
        """Nothing is kept."""

    def is_on(self, number: int) -> bool:  # noqa: ARG002 (any)
        return False

    def check(self, statement: Statement) -> None:
        if statement.word in _CHECKS:
            _CHECKS[statement.word](self, statement)
        elif statement.word not in ENDS and statement.word not in _IGNORED:
            self.act(statement)

    def _check_if(self, statement: Statement) -> None:
        if jump := GOES.search(statement.rest):
            self.condition(statement.rest[: jump.start()], ("",))
            self._check_label(int(jump[1]))
        elif statement.rest[-4:].upper() == "THEN":
            self.condition(statement.rest, ("THEN",))

    def _check_label(self, label: int) -> None:
        if label not in self.routine.labels:
            raise Unreadable(f"there is no label {label} in this program")

    def _check_loop(self, statement: Statement) -> None:
        wanted = ("DO",) if statement.word == "WHILE" else ("",)
        if statement.rest:
            self.condition(statement.rest, wanted)
        elif statement.word != "WAIT":
            raise Unreadable(f"{statement.word} wants a condition")

    def _check_for(self, statement: Statement) -> None:
        text = Expression(statement.rest, self)
        if not text.take()[0].isalpha():
            raise Unreadable("FOR wants the name of a variable")
        text.subscripts()
        text.expect("=")
        read_bounds(text)

    def _check_exit(self, statement: Statement) -> None:
        if statement.line in self.lines_outside_of_loops:
            raise Unreadable(f"{statement.word} outside of a loop")

    def _check_call(self, statement: Statement) -> None:
        match = require(
            CALLED.fullmatch(statement.rest),
            Unreadable("CALL wants the name of a program and its arguments"),
        )
        for part in split(unwrap(match[2])[0]) if match[2] else ():
            self.argument("a", part)

    def _check_do(self, statement: Statement) -> None:
        if statement.rest:
            raise Unreadable("DO stands alone")

    def cell(self, name: str) -> Cell:
        return Cell({}, name)


_CHECKS: Mapping[str, Callable[[_Checker, Statement], object]] = {
    "CALL": _Checker._check_call,
    "CALLS": lambda checker, statement: Expression(statement.rest, checker).string(),
    "CASE": lambda checker, statement: checker.evaluate(CaseValue(statement.rest)),
    "DO": _Checker._check_do,
    "FOR": _Checker._check_for,
    "GOTO": lambda checker, statement: checker._check_label(read_label(statement.rest)),
    "IF": _Checker._check_if,
    "VALUE": lambda checker, statement: checker._is_one_of(0.5, statement.rest),
    **dict.fromkeys(("EXIT", "NEXT"), _Checker._check_exit),
    **dict.fromkeys(("UNTIL", "WAIT", "WHILE"), _Checker._check_loop),
}


def check_rest(routines: Sequence[Routine], ran: Set[int], log: Log) -> None:
    """Add a finding for each line outside of `ran` that the controller would refuse."""
    checker = _Checker((), RunRequest(), Log(), {}, {})
    # Each line is read once: there is no bound to it.
    checker.budget.left = sys.maxsize
    accepted: set[tuple[str, str]] = set()
    for routine in routines:
        checker.routine = routine
        checker.lines_outside_of_loops = {
            step.line
            for step in routine.code.steps
            if isinstance(step, JumpTable) and not step.labels
        }
        for statement in routine.statements:
            if not isinstance(statement, Statement) or statement.line in ran:
                continue
            text = statement.word, statement.rest
            if text in accepted:
                continue
            checker.line, checker.doubt = statement.line, False
            try:
                checker.check(statement)
            except Impossible:
                pass
            except Unreadable as error:
                log.find("refused", str(error), line=statement.line)
                continue
            checker.forget()
            if statement.word not in ("GOTO", "IF", "EXIT", "NEXT") and len(accepted) < 50_000:
                accepted.add(text)
