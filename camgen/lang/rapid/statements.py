"""RAPID statements: the grammar of the kernel manual, chapter 4."""

from __future__ import annotations

import re
from collections.abc import Callable

from camgen.lang.log import Log

from .expressions import Calls
from .rows import Rows, Spellings
from .tokens import RESERVED, Wrong, banner, show_token
from .tree import (
    Assign,
    Block,
    CallByName,
    Calling,
    Connect,
    Empty,
    Expr,
    For,
    Goto,
    Hole,
    If,
    Label,
    Ref,
    Run,
    Statement,
    Test,
    While,
    Word,
)

#: Words at which a statement without a semicolon ends.
STRUCTURE = frozenset(
    ("module", "endmodule", "proc", "endproc", "func", "endfunc", "trap", "endtrap")
)
#: Words that close or continue a compound statement, and its first word.
_CLOSES = {
    "endif": "IF", "else": "IF", "elseif": "IF", "then": "IF", "endfor": "FOR",
    "endwhile": "WHILE", "do": "WHILE", "endtest": "TEST", "case": "TEST", "default": "TEST",
}  # fmt: skip
#: Words that begin a compound statement.
_COMPOUND = frozenset(("if", "for", "while", "test"))
#: Words that begin a clause of a routine after its body.
CLAUSES = frozenset(("error", "undo", "backward"))
#: The call of a routine without arguments. A long program has many.
_CALL = re.compile(r"[ \t\f\v\n]*([A-Za-z][A-Za-z0-9_]*);")
#: Depth of compound statements within each other.
_DEEPEST_BLOCK = 30


class Statements(Calls):
    """The parser of statements. It logs faults and continues after them.

    rows: statements that are read by column, None if the general rules read all.
    takes_runs: whether several statements are allowed at the current token.
    log: log of the faults. A fault that controllers load is unusual.
    nested: number of open compound statements.
    """

    def __init__(self, text: str, first_line: int, spellings: Spellings | None, log: Log) -> None:
        start = banner(text)
        super().__init__(text, first_line + text.count("\n", 0, start), start)
        self.first_line = first_line
        self.rows = None if spellings is None else Rows(text, first_line, spellings)
        self.takes_runs = True
        self.log = log
        self.nested = 0

    def note(self, wrong: Wrong) -> None:
        """Log a fault."""
        self.log.find("refused", wrong.what, line=wrong.line)

    def recover(self) -> None:
        """Skip the next semicolon, or stop at a word that opens or closes a routine or module."""
        while self.token[0] != "end" and self.word() not in STRUCTURE:
            if self.take()[1] == ";":
                return

    def statement(self, body: list[Statement | Run]) -> None:
        """Add a statement, or all consecutive statements that can be read by column."""
        kind, text, line, start = self.token
        if kind != "name":
            self.unnamed(body)
            return
        if text.lower() in RESERVED:
            self.control(body)
            return
        end = start
        if self.rows is not None and self.takes_runs:
            statements = self.rows.run(start)
            if statements is None:
                end, line = self.read_calls(body, start, line)
            else:
                body.append(statements.run)
                end, line = statements.end, statements.line
        if end == start:
            body.append(self.named_statement())
        else:
            self.jump(end, line)

    def read_calls(self, body: list[Statement | Run], start: int, line: int) -> tuple[int, int]:
        """Add consecutive calls without arguments from an offset and its line on.

        Returns offset and line of their end.
        """
        while (call := _CALL.match(self.text, start)) and call[1].lower() not in RESERVED:
            line += call[0].count("\n")
            body.append(Calling(line, call[1].lower()))
            start = call.end()
        return start, line

    def unnamed(self, body: list[Statement | Run]) -> None:
        """Add a statement that does not begin with a word: a call by name or a placeholder."""
        token = self.take()
        line, text = token[2], token[1]
        if text == "%" and self.whole:
            name = self.expression()
            self.expect("%")
            args, options = ((), ()) if self.token[1] == ";" else self.arguments(0)
            self.expect(";")
            body.append(CallByName(line, name, args, options))
        elif token[0] == "hole" and self.whole:
            body.append(self.empty(line, text))
        elif text == ";":
            what = "an empty statement, which the kernel manual does not have"
            self.log.find("unusual", what, line=line)
        else:
            raise Wrong(line, f"a statement expected, found {show_token(token)}")

    def empty(self, line: int, text: str) -> Empty:
        """The placeholder of a statement, or of the variable of an assignment."""
        if self.accept(":="):
            self.expression()
            self.expect(";")
        else:
            self.accept(";")
        return Empty(line, text)

    def named_statement(self) -> Statement:
        """A label, an assignment or a call."""
        if not self.whole:
            return self.statement_call()
        _, text, line, _ = self.take()
        mark = self.token[1] if self.token[0] == "mark" else ""
        if mark == ":":
            self.take()
            return Label(line, text.lower())
        if mark in (":=", ".", "{"):
            target = self.part(Ref(text), 0)
            self.expect(":=")
            value = self.expression()
            self.expect(";")
            return Assign(line, target, value)
        return self.call_of(text, line)

    def control(self, body: list[Statement | Run]) -> None:
        """Add a statement that begins with a reserved word."""
        word, line = self.word(), self.token[2]
        if word in _CONTROL:
            body.append(_CONTROL[word](self))
            return
        token = self.take()
        if word in _CLOSES:
            self.note(Wrong(line, f"{word.upper()} without its {_CLOSES[word]}"))
            if word in ("case", "elseif"):
                self.skip_head()
        else:
            raise Wrong(line, f"a statement expected, found {show_token(token)}")

    def skip_head(self) -> None:
        """Skip the rest of a condition, or of the values of a CASE, in its line."""
        line = self.token[2]
        while (
            self.token[0] != "end"
            and self.token[2] == line
            and self.take()[1].lower() not in (":", "then", "do", ";")
        ):
            pass

    def block(self, *ends: str) -> Block:
        """Statements up to one of the words `ends`, or to the end of the clause or routine."""
        body: list[Statement | Run] = []
        if self.nested >= _DEEPEST_BLOCK:
            raise Wrong(self.token[2], "statements nested too deeply")
        self.nested += 1
        try:
            while (word := self.word()) not in ends:
                if self.token[0] == "end" or word in STRUCTURE or word in CLAUSES:
                    break
                try:
                    self.statement(body)
                except Wrong as wrong:
                    self.note(wrong)
                    self.recover()
        finally:
            self.nested -= 1
        return tuple(body)

    def close(self, word: str, line: int) -> None:
        """Take the word that closes a compound statement, or note that it is missing.

        line: line of the compound statement.
        """
        if self.word() == word:
            self.take()
        else:
            what = f"{word.upper()} of the statement in line {line} is missing"
            self.note(Wrong(self.token[2], what))

    def head(self, word: str) -> Expr:
        """A condition, after which `word` is taken. A faulty one becomes a placeholder."""
        try:
            value = self.expression()
            self.expect_word(word)
        except Wrong as wrong:
            self.note(wrong)
            while self.token[0] != "end" and self.word() not in STRUCTURE and self.token[1] != ";":
                if self.take()[1].lower() == word:
                    break
            return Hole("<EXP>")
        return value

    def expect_word(self, word: str) -> None:
        """Take a reserved word. Raises Wrong if it is not the current token."""
        if self.word() != word:
            raise Wrong(self.token[2], f"{word.upper()} expected, found {show_token(self.token)}")
        self.take()


def _read_if(parser: Statements) -> If:
    line = parser.take()[2]
    condition = parser.expression()
    if parser.word() != "then":
        body: list[Statement | Run] = []
        if parser.word() in _COMPOUND:
            place = "after the condition of an IF without THEN"
            what = f"{parser.word().upper()} {place}: a simple statement stands there"
            parser.note(Wrong(parser.token[2], what))
        takes_runs, parser.takes_runs = parser.takes_runs, False
        try:
            parser.statement(body)
        finally:
            parser.takes_runs = takes_runs
        return If(line, ((condition, tuple(body)),))
    parser.take()
    branches = [(condition, parser.block("elseif", "else", "endif"))]
    while parser.word() == "elseif":
        parser.take()
        condition = parser.head("then")
        branches.append((condition, parser.block("elseif", "else", "endif")))
    otherwise = None
    if parser.word() == "else":
        parser.take()
        otherwise = parser.block("endif")
    parser.close("endif", line)
    return If(line, tuple(branches), otherwise)


def _read_for(parser: Statements) -> For:
    line = parser.take()[2]
    name = parser.name("the name of a loop variable")
    parser.expect_word("from")
    first = parser.expression()
    parser.expect_word("to")
    last = parser.expression()
    step = None
    if parser.word() == "step":
        parser.take()
        step = parser.expression()
    parser.expect_word("do")
    body = parser.block("endfor")
    parser.close("endfor", line)
    return For(line, name, first, last, step, body)


def _read_while(parser: Statements) -> While:
    line = parser.take()[2]
    condition = parser.head("do")
    body = parser.block("endwhile")
    parser.close("endwhile", line)
    return While(line, condition, body)


def _read_test(parser: Statements) -> Test:
    line = parser.take()[2]
    value = parser.expression()
    cases = []
    while parser.word() == "case":
        parser.take()
        values = parser.listed()
        parser.expect(":")
        cases.append((values, parser.block("case", "default", "endtest")))
    otherwise = None
    if parser.word() == "default":
        parser.take()
        parser.expect(":")
        otherwise = parser.block("endtest", "case")
    parser.close("endtest", line)
    return Test(line, value, tuple(cases), otherwise)


def _read_goto(parser: Statements) -> Goto:
    line = parser.take()[2]
    name = parser.name("a label")
    parser.expect(";")
    return Goto(line, name.lower())


def _read_word(parser: Statements) -> Word:
    _, word, line, _ = parser.take()
    word = word.lower()
    value = None
    if word in ("return", "raise") and parser.token[1] != ";":
        value = parser.expression()
    parser.expect(";")
    return Word(line, word, value)


def _read_connect(parser: Statements) -> Connect:
    line = parser.take()[2]
    target = parser.part(Ref(parser.name("an interrupt")), 0)
    parser.expect_word("with")
    trap = parser.name("a TRAP")
    parser.expect(";")
    return Connect(line, target, trap)


_CONTROL: dict[str, Callable[[Statements], Statement]] = {
    "if": _read_if, "for": _read_for, "while": _read_while, "test": _read_test, "goto": _read_goto,
    "connect": _read_connect,
    **dict.fromkeys(("return", "raise", "retry", "trynext", "exit"), _read_word),
}  # fmt: skip
