"""The part of RAPID that programs of a post use. The parser refuses the rest of the grammar.

It reads declarations, PROCs without parameters, calls of instructions, and values that are written
out. Everything else is refused by name.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from typing import Any, ClassVar, cast

from camgen.lang.log import Log
from camgen.lang.rapid.expressions import Calls
from camgen.lang.rapid.grammar import Parser
from camgen.lang.rapid.rows import Spellings
from camgen.lang.rapid.statements import STRUCTURE
from camgen.lang.rapid.tokens import BANNER_LINES, RESERVED, Wrong, banner
from camgen.lang.rapid.tree import (
    Calling,
    Data,
    Inline,
    Module,
    Parameter,
    Routine,
    Run,
    Statement,
    list_statements,
)

#: Words that open a compound statement, and words that continue or close one.
_OPENS = frozenset(("if", "for", "while", "test"))
_CLOSES = frozenset(("endif", "endfor", "endwhile", "endtest"))
_CONTINUES = _CLOSES | frozenset(("else", "elseif", "case", "default", "then", "do"))
#: First words of statements that are read in ERROR handlers alone.
_HANDLES = frozenset(("if", "raise", "exit"))
#: Name of the statement `IF FCIsForceMode() FCDeact;`. No routine can have it.
DEACT_WHERE_ON = "if fcdeact"
#: The only IF that is read outside of ERROR handlers.
_ASKS = re.compile(r"if\s+FCIsForceMode\b", re.IGNORECASE)

#: A PROC in the usual spelling up to its first statement.
_BEGIN = re.compile(r"PROC ([A-Za-z][A-Za-z0-9_]*)\(\)\n(?: *![^\n]*\n)* *")


class Written(Calls):
    """Calls whose values are written out."""

    whole: ClassVar[bool] = False


def parse(text: str, first_line: int, spellings: Spellings | None, log: Log) -> list[Module]:
    """Parses the modules of a file.

    first_line: number of the first line.
    spellings: spellings of statements that are read by column. None: the general rules read all.
    log: log for findings.
    """
    return _Parser(text, first_line, spellings, log).modules()


def calls_of(block: Iterable[Statement | Run]) -> Iterator[Calling | Inline]:
    """The statements of a block, one by one. The parser reads no others."""
    return cast(Iterator[Calling | Inline], list_statements(block))


class _Parser(Parser):
    """Modules and routines."""

    whole: ClassVar[bool] = False
    clauses: ClassVar[frozenset[str]] = frozenset(("error",))
    # Members of a module that no post writes are refused.
    record = alias = placeholder = Parser.no_member

    def __init__(self, text: str, first_line: int, spellings: Spellings | None, log: Log) -> None:
        start = banner(text)
        super().__init__(text, first_line, spellings, log)
        #: Number of open compound statements. Each of them is a finding already.
        self.compounds = 0
        if start and [line.strip() for line in text[:start].strip().split("\n")] != BANNER_LINES:
            what = f"a banner other than {' / '.join(BANNER_LINES)}"
            self.log.find("unusual", what, line=first_line)
        self.outside = start

    # -- modules

    def modules(self) -> list[Module]:
        """Parses all modules. Comments outside of them are findings."""
        modules = super().modules()
        self.remark_comment()
        return modules

    def module(self) -> Module:
        """Parses a module. A comment before it is a finding."""
        self.remark_comment()
        return super().module()

    def close_module(self) -> None:
        """Parses ENDMODULE."""
        self.outside = self.token[3] + len("endmodule")
        self.take()

    def remark_comment(self) -> None:
        """Adds a finding for a comment between modules.

        A comment is an element of a list inside of a module (RAPID kernel manual, comments).
        """
        end = self.token[3] if self.token[0] != "end" else len(self.text)
        comment = self.text.find("!", self.outside, end)
        if comment >= 0:
            line = self.first_line + self.text.count("\n", 0, comment)
            what = "a comment outside of a module, where the kernel manual has none"
            self.log.find("unusual", what, line=line)

    def late_data(self, line: int, word: str) -> None:
        """Adds a finding for a declaration after a routine."""
        self.note(Wrong(line, f"{word.upper()} after the first routine of the module"))

    def skip_past(self, word: str) -> None:
        """Skips a routine that is not read."""
        while self.token[0] != "end" and self.word() not in (word, "endmodule"):
            self.take()
        if self.word() == word:
            self.take()

    def member(self, data: list[Data], routines: list[Routine], records: list[Any]) -> None:
        """Parses a declaration of a module."""
        usual = self.usual_routines() if self.word() == "proc" else []
        if usual:
            routines += usual
        else:
            super().member(data, routines, records)

    def usual_routines(self) -> list[Routine]:
        """Parses consecutive PROCs in the usual spelling, if there are any.

        Each has only statements that are read by column, and no handler or one that is RAISE alone.
        """
        _, _, line, start = self.token
        begin = _BEGIN.match(self.text, start)
        if self.rows is None or begin is None or begin[1].lower() in RESERVED:
            return []
        routines, end, last = self.rows.read_routines(begin[1], line, begin.end())
        if routines:
            self.jump(end, last)
        return routines

    # -- routines

    def routine(self, line: int, local: bool, kind: str) -> Routine:
        """Parses a PROC. Raises Wrong for other kinds of routines."""
        if kind != "proc":
            self.skip_past(f"end{kind}")
            raise Wrong(line, f"{kind.upper()} is not read")
        if local:
            what = "a routine that is LOCAL, which the controller cannot call by an event"
            self.log.find("unusual", what, line=line)
        return super().routine(line, local, kind)

    def parameters(self, line: int, name: str) -> tuple[Parameter, ...]:
        """Raises Wrong if a PROC has parameters."""
        if not self.accept(")"):
            self.skip_past("endproc")
            raise Wrong(line, f"PROC {name} has parameters, which are not read")
        return ()

    def enclosed(self, body: list[Statement | Run], clause: str) -> None:
        """Parses a statement, or the end of force control or of a handler."""
        if clause:
            is_end = self.word() in _HANDLES
        else:
            is_end = self.word() == "if" and bool(_ASKS.match(self.text, self.token[3]))
        if is_end:
            body.append(self.handling())
        else:
            self.takes_runs = not clause
            self.statement(body)

    def handling(self) -> Calling:
        """Parses the conditional end of force control, or RAISE or EXIT of an ERROR handler."""
        _, text, line, _ = self.take()
        if text.lower() == "if":
            for mark in ("fcisforcemode", "(", ")", "fcdeact"):
                if self.token[1].lower() != mark:
                    raise Wrong(line, "IF is read as IF FCIsForceMode() FCDeact; alone")
                self.take()
        self.expect(";")
        return Calling(line, DEACT_WHERE_ON if text.lower() == "if" else text.lower())

    # -- statements

    def control(self, _body: list[Statement | Run]) -> None:
        """Adds a finding for a control statement and skips its head.

        The statements inside it are read. A word that continues or closes a compound statement is a
        finding too, unless one is open.
        """
        word, line = self.word(), self.token[2]
        if word not in _CONTINUES:
            self.note(Wrong(line, f"{word.upper()} is a statement that is not read"))
        elif self.compounds == 0:
            self.note(Wrong(line, f"{word.upper()} belongs to no statement before it"))
        self.compounds += word in _OPENS
        self.compounds -= word in _CLOSES and self.compounds > 0
        self.take()
        while self.token[0] != "end" and self.token[2] == line and self.word() not in STRUCTURE:
            if self.word() in ("then", "do"):
                self.take()
                return
            if self.take()[1] == ";":
                return
