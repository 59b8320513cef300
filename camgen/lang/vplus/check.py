"""The lines of a V+ program that its run did not come to: whether the controller would take them.

Each is read as if it were carried out, with values that fit everywhere; what they make impossible is no fault of the
line, and what is no V+ is.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence, Set

from camgen.lang.log import Log
from camgen.lang.programs import Ask
from camgen.model.program import Joints

from .code import GOES, read_bounds, read_label
from .flow import CALLED, Machine
from .locations import Expression, unknown
from .statements import ENDS, split, unwrap
from .text import Impossible, Location, Routine, Statement, Unreadable
from .variables import Cell, Value

_SOMEWHERE = unknown("somewhere")


class _Reader(Machine):
    """Reads single instructions; nothing that they do lasts."""

    def real(self, name: str) -> float:  # noqa: ARG002 (any)
        """Any number."""
        self.doubt = True
        return 1.0

    def text(self, name: str) -> str:  # noqa: ARG002 (any)
        """Any string."""
        return ""

    def location(self, name: str) -> Location:  # noqa: ARG002 (any)
        """Any location."""
        return _SOMEWHERE

    def point(self, name: str) -> Joints | Location:  # noqa: ARG002 (any)
        """Any precision point."""
        return _SOMEWHERE

    def here(self, word: str) -> Location:  # noqa: ARG002 (any)
        """Anywhere."""
        return _SOMEWHERE

    def assign(self, name: str, value: Value) -> None:
        """Nothing is kept."""

    def is_on(self, number: int) -> bool:  # noqa: ARG002 (any)
        """No signal is on."""
        return False

    def spend(self, count: int) -> None:
        """Each line is read once: there is no bound to it."""

    def look(self, routine: Routine, index: int, statement: Statement) -> None:
        """Unreadable where the controller would not take the instruction."""
        if statement.word in _LOOKS:
            _LOOKS[statement.word](self, routine, index, statement)
        elif statement.word not in ENDS and statement.word not in (
            "RETURN",
            "RETURNE",
            "AUTO",
            "LOCAL",
            "GLOBAL",
        ):
            self.do(statement)

    def _test(self, routine: Routine, index: int, statement: Statement) -> None:
        jump = GOES.search(statement.rest)
        if jump and index not in routine.partner:
            self.condition(statement.rest[: jump.start()], ("",))
            self._label(routine, int(jump[1]))
        elif statement.rest[-4:].upper() == "THEN":
            self.condition(statement.rest, ("THEN",))

    def _label(self, routine: Routine, label: int) -> None:
        if label not in routine.labels:
            raise Unreadable(f"there is no label {label} in this program")

    def _leap(self, routine: Routine, _: int, statement: Statement) -> None:
        self._label(routine, read_label(statement.rest))

    def _loop(self, _routine: Routine, _index: int, statement: Statement) -> None:
        wanted = ("DO",) if statement.word == "WHILE" else ("",)
        if statement.rest:
            self.condition(statement.rest, wanted)
        elif statement.word != "WAIT":
            raise Unreadable(f"{statement.word} wants a condition")

    def _count(self, _routine: Routine, _index: int, statement: Statement) -> None:
        text = Expression(statement.rest, self)
        if not text.take()[0].isalpha():
            raise Unreadable("FOR wants the name of a variable")
        text.subscripts()
        text.expect("=")
        read_bounds(text)

    def _choose(self, _routine: Routine, _index: int, statement: Statement) -> None:
        text = Expression(statement.rest, self)
        if text.is_string():
            text.string()
        else:
            text.logic()
        text.expect("OF")
        text.finish()

    def _one(self, _routine: Routine, _index: int, statement: Statement) -> None:
        self._is_one_of(0.5, statement.rest)

    def _leave(self, routine: Routine, index: int, statement: Statement) -> None:
        if not routine.loops.get(index):
            raise Unreadable(f"{statement.word} outside of a loop")

    def _calls(self, _routine: Routine, _index: int, statement: Statement) -> None:
        if statement.word == "CALL":
            match = CALLED.fullmatch(statement.rest)
            if match is None:
                raise Unreadable("CALL wants the name of a program and its arguments")
            for part in split(unwrap(match[2])[0]) if match[2] else ():
                self.argument("a", part)
        else:
            Expression(statement.rest, self).string()

    def _event(self, _routine: Routine, _index: int, statement: Statement) -> None:
        self.wait_event(statement.rest)

    def _nothing(self, _routine: Routine, _index: int, _statement: Statement) -> None:
        pass

    def _begin(self, _routine: Routine, _index: int, statement: Statement) -> None:
        if statement.rest:
            raise Unreadable("DO stands alone")

    def cell(self, name: str) -> Cell:
        """A place of its own."""
        return Cell({}, name)


_LOOKS: Mapping[str, Callable[[_Reader, Routine, int, Statement], None]] = {
    "ANY": _Reader._nothing, "CALL": _Reader._calls, "CALLS": _Reader._calls, "CASE": _Reader._choose,
    "DO": _Reader._begin, "ELSE": _Reader._nothing, "END": _Reader._nothing, "EXIT": _Reader._leave,
    "FOR": _Reader._count, "GOTO": _Reader._leap, "IF": _Reader._test, "NEXT": _Reader._leave,
    "UNTIL": _Reader._loop, "VALUE": _Reader._one, "WAIT": _Reader._loop, "WAIT.EVENT": _Reader._event,
    "WHILE": _Reader._loop,
}  # fmt: skip


def check_rest(routines: Sequence[Routine], ran: Set[int], log: Log) -> None:
    """Add what the controller refuses in the lines that were not run. ran: lines that were run."""
    told = Log()
    reader = _Reader((), Ask(), told)
    fine: set[tuple[str, str]] = set()
    for routine in routines:
        for index, statement in enumerate(routine.statements):
            if not isinstance(statement, Statement) or statement.line in ran:
                continue
            said = statement.word, statement.rest
            if said in fine:
                continue
            reader.line, reader.doubt = statement.line, False
            try:
                reader.look(routine, index, statement)
            except Impossible:
                pass
            except Unreadable as error:
                log.find("refused", str(error), line=statement.line)
                continue
            reader.forget()
            if statement.word not in ("GOTO", "IF", "EXIT", "NEXT") and len(fine) < 50_000:
                fine.add(said)
