"""RAPID text as modules: the grammar of the RAPID kernel manual (technical reference manual, chapters 2 to 9).

Whoever reads a part of the language only overrides the productions that it has not: one grammar for all.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import ClassVar

from msgspec import Struct

from .expressions import Calls
from .plain import read_plain
from .tokens import RESERVED, Wrong, banner, show_token
from .tree import (
    Assign,
    Block,
    Connect,
    Data,
    Empty,
    Expr,
    For,
    Goto,
    Hole,
    If,
    Label,
    Late,
    Module,
    Parameter,
    Record,
    Ref,
    Routine,
    Statement,
    Test,
    While,
    Word,
)

#: Words at which a statement that lost its semicolon must have ended.
STRUCTURE = frozenset(("module", "endmodule", "proc", "endproc", "func", "endfunc", "trap", "endtrap"))
#: Words that close or continue a compound statement, and what opens it.
_CLOSES = {
    "endif": "IF", "else": "IF", "elseif": "IF", "then": "IF", "endfor": "FOR", "endwhile": "WHILE", "do": "WHILE",
    "endtest": "TEST", "case": "TEST", "default": "TEST",
}  # fmt: skip
_CLAUSES = frozenset(("error", "undo", "backward"))
_DATA = frozenset(("local", "task", "const", "pers", "var"))
_ATTRIBUTES = ("sysmodule", "noview", "nostepin", "viewonly", "readonly")
_MODES = frozenset(("var", "pers", "inout", "ref"))
#: Compound statements within each other.
_DEEPEST_BLOCK = 30


class Note(Struct, frozen=True):
    """What is wrong, or odd, in a line. odd: the manual does not have it, and controllers load it."""

    line: int
    what: str
    odd: bool = False


class Parser(Calls):
    """Modules, routines and statements. Faults are noted, and reading goes on behind them.

    clauses: of routines. calls: the grammar of statements that are read at once.
    """

    clauses: ClassVar[frozenset[str]] = _CLAUSES
    calls: ClassVar[type[Calls]] = Calls

    def __init__(self, text: str, first_line: int, plain: bool = True) -> None:
        start = banner(text)
        super().__init__(text, first_line + text.count("\n", 0, start), start)
        self.plain, self.first_line = plain, first_line
        self.notes: list[Note] = []
        self.nested = 0

    def note(self, wrong: Wrong) -> None:
        """Notes a fault."""
        self.notes.append(Note(wrong.line, wrong.what))

    def recover(self) -> None:
        """Skips behind the next semicolon, but never over a word that opens or closes a routine or module."""
        while self.token[0] != "end" and self.word() not in STRUCTURE:
            if self.ended():
                return

    def ended(self) -> bool:
        """Takes a token and says whether a statement ends with it."""
        kind, text, _, _ = self.take()
        return kind == "move" or text == ";"

    def listed(self, item: Callable[[], Expr]) -> tuple[Expr, ...]:
        """Items with commas between them."""
        found = [item()]
        while self.accept(","):
            found.append(item())
        return tuple(found)

    # -- modules -------------------------------------------------------------------------------------------------

    def modules(self) -> list[Module]:
        """All modules up to the end of the text."""
        found = []
        while self.token[0] != "end":
            if self.word() == "module":
                found.append(self.module())
            else:
                self.notes.append(Note(self.token[2], f"{show_token(self.token)} stands outside a module"))
                while self.token[0] != "end" and self.word() != "module":
                    self.take()
        return found

    def module(self) -> Module:
        """A module; where its end is missing, up to there."""
        line = self.take()[2]
        name = ""
        attributes: tuple[str, ...] = ()
        try:
            name = self.name("a module name")
            attributes = self.attributes(line)
        except Wrong as wrong:
            self.note(wrong)
        data: list[Data] = []
        routines: list[Routine] = []
        records: list[Record] = []
        while self.word() != "endmodule":
            if self.token[0] == "end" or self.word() == "module":
                self.notes.append(Note(self.token[2], f"ENDMODULE of {name} is missing"))
                break
            try:
                self.member(data, routines, records)
            except Wrong as wrong:
                self.note(wrong)
                self.recover()
        else:
            self.close_module()
        return Module(line, name, tuple(data), tuple(routines), tuple(records), attributes)

    def close_module(self) -> None:
        """Takes ENDMODULE."""
        self.take()

    def attributes(self, line: int) -> tuple[str, ...]:
        """SYSMODULE and the like, in brackets. Wrong where they do not end."""
        found: list[str] = []
        if not self.accept("("):
            return ()
        while not self.accept(")"):
            kind, text, at, _ = self.take()
            if kind == "end":
                raise Wrong(line, ") of the module's attributes is missing")
            if kind == "name":
                found.append(text.lower())
                self.judge_attribute(at, text, found)
        return tuple(found)

    def judge_attribute(self, line: int, text: str, found: list[str]) -> None:
        """Notes an attribute that there is not, or that is given twice."""
        if found[-1] not in _ATTRIBUTES:
            self.notes.append(Note(line, f"{text[:40]} is no attribute of a module"))
        elif found[-1] in found[:-1]:
            self.notes.append(Note(line, f"the attribute {text} is given twice"))

    def member(self, data: list[Data], routines: list[Routine], records: list[Record]) -> None:
        """One declaration of a module."""
        line = self.token[2]
        local = task = False
        if self.word() in ("local", "task"):
            local, task = self.word() == "local", self.word() == "task"
            self.take()
        word = self.word()
        if word in ("const", "pers", "var"):
            if routines:
                self.late_data(line, word)
            data.append(self.data(line, local, task))
        elif word in ("proc", "func", "trap"):
            self.take()
            routines.append(self.routine(line, local, word))
        elif word in ("record", "alias"):
            records.append(self.record() if word == "record" else self.alias())
        elif self.token[0] == "hole":
            self.placeholder()
        else:
            self.no_member()

    def placeholder(self) -> None:
        """``<DDN>`` and its like."""
        _, text, line, _ = self.take()
        self.notes.append(Note(line, f"{text}: a place that is not filled in", odd=True))

    def no_member(self) -> None:
        """What is no declaration. Wrong names it."""
        line, what = self.token[2], show_token(self.take())
        raise Wrong(line, f"a declaration expected, found {what}")

    def late_data(self, line: int, word: str) -> None:
        """A declaration behind a routine, where the manual has none."""
        what = f"{word.upper()} after a routine, where the kernel manual has no declaration of data"
        self.notes.append(Note(line, what, odd=True))

    def record(self) -> Record:
        """RECORD with its components."""
        line = self.take()[2]
        name = self.name("the name of a RECORD")
        components = []
        while self.word() != "endrecord":
            kind = self.name("a data type or ENDRECORD").lower()
            components.append((kind, self.name(f"the name of a {kind}").lower()))
            self.expect(";")
        self.take()
        return Record(line, name.lower(), tuple(components))

    def alias(self) -> Record:
        """ALIAS of a data type."""
        line = self.take()[2]
        kind = self.name("a data type").lower()
        name = self.name("the name of an ALIAS")
        self.expect(";")
        return Record(line, name.lower(), ((kind, ""),), alias=True)

    def data(self, line: int, local: bool, task: bool) -> Data:
        """A declaration of data. Wrong where it must have a value and has none."""
        storage = self.take()[1].lower()
        data_type = self.name("a data type").lower()
        name = self.name(f"the name of a {data_type}")
        dims = self.dimensions(line, name) if self.accept("{") else ()
        value = self.expression() if self.accept(":=") else None
        self.expect(";")
        if value is None and (storage == "const" or (storage == "pers" and (local or task))):
            raise Wrong(line, f"{name} has no value")
        if storage == "pers" and not is_literal(value):
            raise Wrong(line, f"PERS {name} must have a literal value")
        return Data(line, storage, data_type, name, local, value, task, dims)

    def dimensions(self, _line: int, _name: str) -> tuple[Expr, ...]:
        """Of an array, behind the bracket."""
        dims = self.listed(self.expression)
        self.expect("}")
        return dims

    # -- routines ------------------------------------------------------------------------------------------------

    def routine(self, line: int, local: bool, kind: str) -> Routine:
        """A routine behind the word that begins it."""
        gives = self.name("the data type of a FUNC").lower() if kind == "func" else ""
        name = self.name(f"the name of a {kind.upper()}")
        parameters: tuple[Parameter, ...] = ()
        if kind != "trap":
            self.expect("(")
            parameters = self.parameters(line, name)
        data: list[Data] = []
        blocks: dict[str, list[Statement]] = {"": []}
        end, clause = f"end{kind}", ""
        while self.word() != end:
            if self.token[0] == "end" or self.word() in STRUCTURE:
                self.notes.append(Note(self.token[2], f"{end.upper()} of {name} is missing"))
                break
            try:
                if self.word() in self.clauses and self.word() not in blocks:
                    clause = self.clause()
                    blocks[clause] = []
                elif self.word() in _DATA:
                    data.append(self.routine_data(bool(blocks[""]) or bool(clause)))
                else:
                    self.enclosed(blocks[clause], clause)
            except Wrong as wrong:
                self.note(wrong)
                self.recover()
        last = self.token[2]
        if self.word() == end:
            self.take()
        handler = tuple(blocks["error"]) if "error" in blocks else None
        return Routine(line, name, local, tuple(data), tuple(blocks[""]), handler, kind, parameters, gives, last)

    def enclosed(self, body: list[Statement], _clause: str) -> None:
        """A statement of a routine, in the clause ("" the body, error, undo, backward)."""
        self.statement(body)

    def clause(self) -> str:
        """ERROR with the numbers that it is for, UNDO, BACKWARD."""
        word = self.take()[1].lower()
        if word == "error" and self.accept("("):
            self.listed(self.expression)
            self.expect(")")
        return word

    def parameters(self, _line: int, _name: str) -> tuple[Parameter, ...]:
        """Parameters up to the closing bracket."""
        found: list[Parameter] = []
        group = 0
        while not self.accept(")"):
            if found and not self.accept(",") and self.token[1] != "\\":
                raise Wrong(self.token[2], f", or ) expected, found {show_token(self.token)}")
            group += 1
            optional = self.accept("\\")
            found.append(self.parameter(optional, group))
            while optional and self.accept("|"):
                self.accept("\\")
                found.append(self.parameter(True, group))
        return tuple(found)

    def parameter(self, optional: bool, group: int) -> Parameter:
        """One parameter."""
        mode = ""
        if self.word() in _MODES:
            mode = self.take()[1].lower()
        kind = self.name("the data type of a parameter").lower()
        name = self.name("the name of a parameter").lower()
        dims = 0
        if self.accept("{"):
            self.listed(self.star)
            self.expect("}")
            dims = 1
        return Parameter(mode, kind, name, dims, optional, group)

    def star(self) -> Expr:
        """A dimension of a parameter, which is not said."""
        self.expect("*")
        return Hole("*")

    def routine_data(self, late: bool) -> Data:
        """Data of a routine: before its statements, and no PERS."""
        line = self.token[2]
        word = self.word()
        if word not in ("const", "var"):
            self.take()
            raise Wrong(line, f"{word.upper()} inside a routine")
        if late:
            self.take()
            raise Wrong(line, f"{word.upper()} after the first statement of a routine")
        return self.data(line, False, False)

    # -- statements ----------------------------------------------------------------------------------------------

    def statement(self, body: list[Statement]) -> None:
        """One statement, or as many as can be read at once."""
        token = self.token
        kind, text, line, start = token
        if kind not in ("name", "move"):
            self.unnamed(body)
            return
        if text.lower() in RESERVED:
            self.control(body)
            return
        if self.plain:
            end, line = read_plain(self.text, start, line, body, self.calls)
            if end != start:
                self.jump(end, line)
                return
        body.append(self.statement_call() if kind == "move" else self.named_statement())

    def unnamed(self, body: list[Statement]) -> None:
        """A statement that begins with no word: a late call, a placeholder, nothing."""
        token = self.take()
        line, text = token[2], token[1]
        if text == "%":
            name = self.expression()
            self.expect("%")
            args, options = ((), ()) if self.token[1] == ";" else self.arguments(0)
            self.expect(";")
            body.append(Late(line, name, args, options))
        elif token[0] == "hole":
            body.append(self.empty(line, text))
        elif text == ";":
            what = "an empty statement, which the kernel manual does not have"
            self.notes.append(Note(line, what, odd=True))
        else:
            raise Wrong(line, f"a statement expected, found {show_token(token)}")

    def empty(self, line: int, text: str) -> Empty:
        """``<SMT>``, or ``<VAR>:=`` with its value."""
        if self.accept(":="):
            self.expression()
            self.expect(";")
        else:
            self.accept(";")
        return Empty(line, text)

    def named_statement(self) -> Statement:
        """A label, an assignment or a call."""
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

    def control(self, body: list[Statement]) -> None:
        """A statement that begins with a reserved word."""
        word, line = self.word(), self.token[2]
        read = _CONTROL.get(word)
        if read is not None:
            body.append(read(self))
            return
        token = self.take()
        if word in _CLOSES:
            self.notes.append(Note(line, f"{word.upper()} without its {_CLOSES[word]}"))
            if word in ("case", "elseif"):
                self.skip_head()
        else:
            raise Wrong(line, f"a statement expected, found {show_token(token)}")

    def skip_head(self) -> None:
        """Skips the rest of a head, in its line."""
        line = self.token[2]
        while (
            self.token[0] != "end" and self.token[2] == line and self.take()[1].lower() not in (":", "then", "do", ";")
        ):
            pass

    def block(self, *ends: str) -> Block:
        """Statements up to one of the words ``ends``, or where they must have ended."""
        body: list[Statement] = []
        if self.nested >= _DEEPEST_BLOCK:
            raise Wrong(self.token[2], "statements nested too deeply")
        self.nested += 1
        try:
            while (word := self.word()) not in ends:
                if self.token[0] == "end" or word in STRUCTURE or word in _CLAUSES:
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
        """Takes the word that closes a compound statement, or notes that it is missing."""
        if self.word() == word:
            self.take()
        else:
            self.notes.append(Note(self.token[2], f"{word.upper()} of the statement in line {line} is missing"))

    def head(self, word: str) -> Expr:
        """A condition and the word behind it; a fault in it is noted, and what follows is read on."""
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
        """Takes a reserved word or raises Wrong."""
        if self.word() != word:
            raise Wrong(self.token[2], f"{word.upper()} expected, found {show_token(self.token)}")
        self.take()


def _read_if(parser: Parser) -> If:
    line = parser.take()[2]
    condition = parser.expression()
    if parser.word() != "then":
        body: list[Statement] = []
        plain, parser.plain = parser.plain, False
        try:
            parser.statement(body)
        finally:
            parser.plain = plain
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


def _read_for(parser: Parser) -> For:
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


def _read_while(parser: Parser) -> While:
    line = parser.take()[2]
    condition = parser.head("do")
    body = parser.block("endwhile")
    parser.close("endwhile", line)
    return While(line, condition, body)


def _read_test(parser: Parser) -> Test:
    line = parser.take()[2]
    value = parser.expression()
    cases = []
    while parser.word() == "case":
        parser.take()
        values = parser.listed(parser.expression)
        parser.expect(":")
        cases.append((values, parser.block("case", "default", "endtest")))
    otherwise = None
    if parser.word() == "default":
        parser.take()
        parser.expect(":")
        otherwise = parser.block("endtest", "case")
    parser.close("endtest", line)
    return Test(line, value, tuple(cases), otherwise)


def _read_goto(parser: Parser) -> Goto:
    line = parser.take()[2]
    name = parser.name("a label")
    parser.expect(";")
    return Goto(line, name.lower())


def _read_word(parser: Parser) -> Word:
    _, word, line, _ = parser.take()
    word = word.lower()
    value = None
    if word in ("return", "raise") and parser.token[1] != ";":
        value = parser.expression()
    parser.expect(";")
    return Word(line, word, value)


def _read_connect(parser: Parser) -> Connect:
    line = parser.take()[2]
    target = parser.part(Ref(parser.name("an interrupt")), 0)
    parser.expect_word("with")
    trap = parser.name("a TRAP")
    parser.expect(";")
    return Connect(line, target, trap)


_CONTROL: dict[str, Callable[[Parser], Statement]] = {
    "if": _read_if, "for": _read_for, "while": _read_while, "test": _read_test, "goto": _read_goto,
    "connect": _read_connect, **dict.fromkeys(("return", "raise", "retry", "trynext", "exit"), _read_word),
}  # fmt: skip


def is_literal(value: Expr | None) -> bool:
    """Whether a value is written out, as a PERS must have it (kernel manual, persistents)."""
    if isinstance(value, tuple):
        return all(is_literal(item) for item in value)
    return value is None or isinstance(value, (float, bool, str)) or type(value).__name__ in ("Point",)


def parse(text: str, first_line: int) -> tuple[list[Module], list[Note]]:
    """The modules of one file whose first line has the number ``first_line``, and what is wrong with its grammar."""
    parser = Parser(text, first_line)
    return parser.modules(), parser.notes
