"""Checks whether the controller would accept those lines of a V+ program that were not run.

Each line is evaluated as if it were run, with values that fit everywhere. A line that is not V+ is
a finding. A line that is impossible only with these values is accepted.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence, Set

from camgen.lang.log import Log
from camgen.lang.programs import RunRequest
from camgen.lang.values import require
from camgen.model.program import Joints

from .code import GOES, read_bounds, read_label
from .flow import CALLED, Machine
from .locations import Expression, make_external
from .statements import ENDS, split, unwrap
from .text import Impossible, Location, Routine, Statement, Unreadable
from .variables import Cell, Value

#: Instructions whose operands are not checked here.
_IGNORED = frozenset({"RETURN", "RETURNE", "AUTO", "LOCAL", "GLOBAL"})
_ANYWHERE = make_external("somewhere")


class _Checker(Machine):
    """Checks single instructions, without any lasting effect."""

    def real(self, name: str) -> float:  # noqa: ARG002 (any)
        self.doubt = True
        return 1.0

    def text(self, name: str) -> str:  # noqa: ARG002 (any)
        return ""

    def location(self, name: str) -> Location:  # noqa: ARG002 (any)
        return _ANYWHERE

    def point(self, name: str) -> Joints | Location:  # noqa: ARG002 (any)
        return _ANYWHERE

    def current_location(self, word: str) -> Location:  # noqa: ARG002 (any)
        return _ANYWHERE

    def assign(self, name: str, value: Value) -> None:
        """Nothing is kept."""

    def is_on(self, number: int) -> bool:  # noqa: ARG002 (any)
        return False

    def spend(self, count: int) -> None:
        """Each line is read once: there is no bound to it."""

    def check(self, routine: Routine, index: int, statement: Statement) -> None:
        if statement.word in _CHECKS:
            _CHECKS[statement.word](self, routine, index, statement)
        elif statement.word not in ENDS and statement.word not in _IGNORED:
            self.do(statement)

    def _check_if(self, routine: Routine, index: int, statement: Statement) -> None:
        jump = GOES.search(statement.rest)
        if jump and index not in routine.partner:
            self.condition(statement.rest[: jump.start()], ("",))
            self._check_label(routine, int(jump[1]))
        elif statement.rest[-4:].upper() == "THEN":
            self.condition(statement.rest, ("THEN",))

    def _check_label(self, routine: Routine, label: int) -> None:
        if label not in routine.labels:
            raise Unreadable(f"there is no label {label} in this program")

    def _check_jump(self, routine: Routine, _: int, statement: Statement) -> None:
        self._check_label(routine, read_label(statement.rest))

    def _check_loop(self, _routine: Routine, _index: int, statement: Statement) -> None:
        wanted = ("DO",) if statement.word == "WHILE" else ("",)
        if statement.rest:
            self.condition(statement.rest, wanted)
        elif statement.word != "WAIT":
            raise Unreadable(f"{statement.word} wants a condition")

    def _check_for(self, _routine: Routine, _index: int, statement: Statement) -> None:
        text = Expression(statement.rest, self)
        if not text.take()[0].isalpha():
            raise Unreadable("FOR wants the name of a variable")
        text.subscripts()
        text.expect("=")
        read_bounds(text)

    def _check_case(self, _routine: Routine, _index: int, statement: Statement) -> None:
        text = Expression(statement.rest, self)
        if text.is_string():
            text.string()
        else:
            text.logic()
        text.expect("OF")
        text.finish()

    def _check_value(self, _routine: Routine, _index: int, statement: Statement) -> None:
        self._is_one_of(0.5, statement.rest)

    def _check_exit(self, routine: Routine, index: int, statement: Statement) -> None:
        if not routine.loops.get(index):
            raise Unreadable(f"{statement.word} outside of a loop")

    def _check_call(self, _routine: Routine, _index: int, statement: Statement) -> None:
        if statement.word == "CALL":
            match = require(
                CALLED.fullmatch(statement.rest),
                Unreadable("CALL wants the name of a program and its arguments"),
            )
            for part in split(unwrap(match[2])[0]) if match[2] else ():
                self.argument("a", part)
        else:
            Expression(statement.rest, self).string()

    def _check_event(self, _routine: Routine, _index: int, statement: Statement) -> None:
        self.wait_event(statement.rest)

    def _accept(self, _routine: Routine, _index: int, _statement: Statement) -> None:
        pass

    def _check_do(self, _routine: Routine, _index: int, statement: Statement) -> None:
        if statement.rest:
            raise Unreadable("DO stands alone")

    def cell(self, name: str) -> Cell:
        return Cell({}, name)


_CHECKS: Mapping[str, Callable[[_Checker, Routine, int, Statement], None]] = {
    "ANY": _Checker._accept,
    "CALL": _Checker._check_call,
    "CALLS": _Checker._check_call,
    "CASE": _Checker._check_case,
    "DO": _Checker._check_do,
    "ELSE": _Checker._accept,
    "END": _Checker._accept,
    "EXIT": _Checker._check_exit,
    "FOR": _Checker._check_for,
    "GOTO": _Checker._check_jump,
    "IF": _Checker._check_if,
    "NEXT": _Checker._check_exit,
    "UNTIL": _Checker._check_loop,
    "VALUE": _Checker._check_value,
    "WAIT": _Checker._check_loop,
    "WAIT.EVENT": _Checker._check_event,
    "WHILE": _Checker._check_loop,
}


def check_rest(routines: Sequence[Routine], ran: Set[int], log: Log) -> None:
    """Add a finding for each line outside of `ran` that the controller would refuse."""
    checker = _Checker((), RunRequest(), Log())
    accepted: set[tuple[str, str]] = set()
    for routine in routines:
        for index, statement in enumerate(routine.statements):
            if not isinstance(statement, Statement) or statement.line in ran:
                continue
            text = statement.word, statement.rest
            if text in accepted:
                continue
            checker.line, checker.doubt = statement.line, False
            try:
                checker.check(routine, index, statement)
            except Impossible:
                pass
            except Unreadable as error:
                log.find("refused", str(error), line=statement.line)
                continue
            checker.forget()
            if statement.word not in ("GOTO", "IF", "EXIT", "NEXT") and len(accepted) < 50_000:
                accepted.add(text)
