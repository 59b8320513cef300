"""The part of RAPID that programs of ours use: the grammar of the language with what else it has turned down.

What is read: declarations, PROCs without parameters, calls of instructions, values that are written out. Everything
else is a fault that names it.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from typing import Any, ClassVar, cast

from camgen.lang.log import Log
from camgen.lang.rapid.expressions import Calls
from camgen.lang.rapid.grammar import Parser
from camgen.lang.rapid.statements import STRUCTURE, Note
from camgen.lang.rapid.tokens import BANNER_LINES, RESERVED, Wrong, banner, show_token
from camgen.lang.rapid.tree import (
    Call,
    Data,
    Expr,
    Inline,
    Module,
    Parameter,
    Point,
    Ref,
    Routine,
    Shape,
    Statement,
)

from .rows import Cut, Run, Spellings

#: Words that open a compound statement, and words that continue or close one.
_OPENS = frozenset(("if", "for", "while", "test"))
_CLOSES = frozenset(("endif", "endfor", "endwhile", "endtest"))
_CONTINUES = _CLOSES | frozenset(("else", "elseif", "case", "default", "then", "do"))
#: Words with which a statement begins that is read in ERROR handlers alone.
_HANDLES = frozenset(("if", "raise", "exit"))
#: The name of the statement ``IF FCIsForceMode() FCDeact;``, one that no routine has.
DEACT_WHERE_ON = "if fcdeact"
#: The only IF that is read outside of them.
_ASKS = re.compile(r"if\s+FCIsForceMode\b", re.IGNORECASE)

#: A PROC in the usual spelling up to its first statement, and from behind its last one on.
_BEGIN = re.compile(r"PROC ([A-Za-z][A-Za-z0-9_]*)\(\)\n(?: *![^\n]*\n)* *")
_END = re.compile(r"(\n *ERROR\n *RAISE;)?\n *ENDPROC\b")


class Written(Calls):
    """Calls whose values are written out."""

    whole: ClassVar[bool] = False


def parse(
    text: str, first_line: int, spellings: Spellings | None, log: Log
) -> tuple[list[Module], int]:
    """The modules of one file whose first line has the number ``first_line``, and how many line ends it has.

    spellings: of statements that are read at once, in runs; None: each is read by the general rules.
    """
    parser = _Parser(text, first_line, spellings)
    modules = parser.modules()
    if parser.cut is not None:
        parser.cut.close()
    for note in parser.notes:
        log.find("unusual" if note.odd else "refused", note.what, line=note.line)
    return modules, text.count("\n") if parser.cut is None else parser.cut.line_ends


def calls_of(block: Sequence[Statement | Run]) -> Iterator[Call | Inline]:
    """The statements of a routine that was read here, one by one: there are no others."""
    for item in cast(Sequence[Any], block):
        if isinstance(item, Run):
            yield from map(item.rows.statement, range(item.first, item.last))
        else:
            yield item


class _Parser(Parser):
    """Modules and routines."""

    whole: ClassVar[bool] = False
    clauses: ClassVar[frozenset[str]] = frozenset(("error",))
    calls: ClassVar[type[Calls]] = Written

    def __init__(self, text: str, first_line: int, spellings: Spellings | None) -> None:
        start = banner(text)
        super().__init__(text, first_line, spellings is not None)
        self.cut = None if spellings is None else Cut(text, first_line, spellings)
        #: Compound statements that are open. Each of them is a fault already.
        self.compounds = 0
        found = [one.strip() for one in text[:start].strip().split("\n")]
        if start and found != BANNER_LINES:
            self.notes.append(
                Note(first_line, f"a banner other than {' / '.join(BANNER_LINES)}", odd=True)
            )
        self.outside = start

    # -- modules -------------------------------------------------------------------------------------------------

    def modules(self) -> list[Module]:
        """All modules, and remarks on comments outside of them."""
        found = super().modules()
        self.remark_comment()
        return found

    def module(self) -> Module:
        """A module, and a remark on a comment before it."""
        self.remark_comment()
        return super().module()

    def close_module(self) -> None:
        """Takes ENDMODULE."""
        self.outside = self.token[3] + len("endmodule")
        self.take()

    def remark_comment(self) -> None:
        """Notes a comment between modules: it is an element of a list inside of one (RAPID kernel manual, comments)."""
        end = self.token[3] if self.token[0] != "end" else len(self.text)
        comment = self.text.find("!", self.outside, end)
        if comment >= 0:
            line = self.first_line + self.text.count("\n", 0, comment)
            what = "a comment outside of a module, where the kernel manual has none"
            self.notes.append(Note(line, what, odd=True))

    def judge_attribute(self, line: int, text: str, found: list[str]) -> None:
        """Attributes of a module say nothing here."""

    def record(self) -> Any:
        """RECORD is not read."""
        self.no_member()

    def alias(self) -> Any:
        """ALIAS is not read."""
        self.no_member()

    def placeholder(self) -> None:
        """Placeholders are not read."""
        self.no_member()

    def late_data(self, line: int, word: str) -> None:
        """A declaration behind a routine is a fault in a program of ours."""
        self.notes.append(Note(line, f"{word.upper()} after the first routine of the module"))

    def dimensions(self, line: int, name: str) -> tuple[Expr, ...]:
        """Arrays are not read."""
        raise Wrong(line, f"the array {name} is not read")

    def skip_past(self, word: str) -> None:
        """Skips a routine that is not read."""
        while self.token[0] != "end" and self.word() not in (word, "endmodule"):
            self.take()
        if self.word() == word:
            self.take()

    def member(self, data: list[Data], routines: list[Routine], records: list[Any]) -> None:
        """One declaration of a module."""
        found = self.usual_routines() if self.cut is not None and self.word() == "proc" else []
        if found:
            routines += found
        else:
            super().member(data, routines, records)

    def usual_routines(self) -> list[Routine]:
        """PROCs one after the other, each one run of statements in the usual spelling, with a handler that hands the
        error on or none.
        """
        _, _, line, start = self.token
        begin = _BEGIN.match(self.text, start)
        if self.cut is None or begin is None or begin[1].lower() in RESERVED:
            return []
        routines: list[Routine] = []
        name, found = begin[1], self.cut.run(begin.end())
        while found is not None and (parted := self.cut.parted(found)) is not None:
            routines.append(_usual(line, name, parted.run, parted.handles, parted.last))
            start, line, name, found = parted.start, parted.line, parted.name, parted.found
        if found is not None and (end := _END.match(self.text, found.end)):
            last = found.line + end[0].count("\n")
            routines.append(_usual(line, name, found.run, bool(end[1]), last))
            start, line = end.end(), last
        if routines:
            self.jump(start, line)
        return routines

    # -- routines ------------------------------------------------------------------------------------------------

    def routine(self, line: int, local: bool, kind: str) -> Routine:
        """A PROC; others are not read."""
        if kind != "proc":
            self.skip_past(f"end{kind}")
            raise Wrong(line, f"{kind.upper()} is not read")
        if local:
            what = "a routine that is LOCAL, which the controller cannot call by an event"
            self.notes.append(Note(line, what, odd=True))
        return super().routine(line, local, kind)

    def parameters(self, line: int, name: str) -> tuple[Parameter, ...]:
        """Parameters are not read."""
        if not self.accept(")"):
            self.skip_past("endproc")
            raise Wrong(line, f"PROC {name} has parameters, which are not read")
        return ()

    def clause(self) -> str:
        """ERROR."""
        return self.take()[1].lower()

    def enclosed(self, body: list[Statement], clause: str) -> None:
        """A statement, or what ends force control or a handler."""
        if (clause and self.word() in _HANDLES) or (
            not clause and self.word() == "if" and _ASKS.match(self.text, self.token[3])
        ):
            body.append(self.handling())
        elif clause or not self.run(body):
            self.statement(body)

    def run(self, body: list[Any]) -> bool:
        """Reads a run of statements at once, where there is one."""
        found = (
            self.cut.run(self.token[3])
            if self.cut is not None and self.token[0] in ("name", "move")
            else None
        )
        if found is None:
            return False
        body.append(found.run)
        self.jump(found.end, found.line)
        return True

    def handling(self) -> Call:
        """The end of force control where it is on, and what only an ERROR handler may say here: RAISE, EXIT."""
        _, text, line, _ = self.take()
        if text.lower() == "if":
            for mark in ("fcisforcemode", "(", ")", "fcdeact"):
                if self.token[1].lower() != mark:
                    raise Wrong(line, "IF is read as IF FCIsForceMode() FCDeact; alone")
                self.take()
        self.expect(";")
        return Call(line, DEACT_WHERE_ON if text.lower() == "if" else text.lower())

    # -- statements ----------------------------------------------------------------------------------------------

    def unnamed(self, _body: list[Statement]) -> None:
        """What begins with no word is no statement."""
        token = self.take()
        if token[1] != ";":
            raise Wrong(token[2], f"a statement expected, found {show_token(token)}")
        self.notes.append(
            Note(token[2], "an empty statement, which the kernel manual does not have", odd=True)
        )

    def named_statement(self) -> Statement:
        """A call."""
        return self.statement_call()

    def control(self, _body: list[Statement]) -> None:
        """Reports a control statement and skips its head; the statements inside it are read.

        A word that continues or closes a compound statement is reported too, unless one is open.
        """
        word, line = self.word(), self.token[2]
        if word not in _CONTINUES:
            self.notes.append(Note(line, f"{word.upper()} is a statement that is not read"))
        elif self.compounds == 0:
            self.notes.append(Note(line, f"{word.upper()} belongs to no statement before it"))
        self.compounds += word in _OPENS
        self.compounds -= word in _CLOSES and self.compounds > 0
        self.take()
        while self.token[0] != "end" and self.token[2] == line and self.word() not in STRUCTURE:
            if self.word() in ("then", "do"):
                self.take()
                return
            if self.ended():
                return


def _usual(line: int, name: str, run: Run, handles: bool, last: int) -> Routine:
    handler = (Call(last - 1, "raise"),) if handles else None
    return Routine(line, name, False, (), cast(Any, (run,)), handler, "proc", (), "", last)


__all__ = [
    "DEACT_WHERE_ON", "Call", "Data", "Expr", "Inline", "Module", "Point", "Ref", "Routine", "Shape", "Wrong",
    "calls_of", "parse",
]  # fmt: skip
