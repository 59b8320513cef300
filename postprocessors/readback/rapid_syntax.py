"""RAPID tokens as modules, data and statements: the grammar of the read-back.

Free form, case-insensitive, ``;`` ends a statement (RAPID kernel manual, grammar). What the subset lacks becomes a
fault that names it; no text makes the parser raise.
"""

from __future__ import annotations

from collections.abc import Iterator

from camgen.post import Fault

from .rapid_lexis import RESERVED, Token, Wrong, number, point, shown, tokens, whole_move
from .rapid_tree import Call, Data, Expr, Module, Point, Ref, Routine, refs, work_object

#: Words at which a statement that lost its semicolon must have ended.
_STRUCTURE = frozenset(("module", "endmodule", "proc", "endproc", "func", "endfunc", "trap", "endtrap"))
#: Words that only continue or close a control statement whose opening has been reported.
_CONTINUES = frozenset(("else", "elseif", "endif", "endfor", "endwhile", "endtest", "case", "default", "then", "do"))
_DATA = frozenset(("local", "task", "const", "pers", "var"))
_DEEPEST = 12


def parse(text: str, first_line: int) -> tuple[list[Module], list[Fault]]:
    """The modules of one file whose first line has the number ``first_line``, and what is wrong with its grammar."""
    parser = _Parser(tokens(text, first_line))
    modules = parser.modules()
    return modules, parser.faults


class _Parser:
    """Recursive descent with one token of look-ahead."""

    def __init__(self, source: Iterator[Token]) -> None:
        self.source = source
        self.faults: list[Fault] = []
        self.token: Token = ("end", "", 1)
        self.take()

    # -- tokens --------------------------------------------------------------------------------------------------

    def take(self) -> Token:
        """The current token; the next one becomes current. The end stays the end."""
        token = self.token
        self.token = next(self.source, ("end", "", token[2]))
        return token

    def word(self) -> str:
        """The current name in lower case, or nothing."""
        return self.token[1].lower() if self.token[0] == "name" else ""

    def accept(self, mark: str) -> bool:
        """Takes ``mark`` if it is next."""
        if self.token[0] == "mark" and self.token[1] == mark:
            self.take()
            return True
        return False

    def expect(self, mark: str) -> None:
        """Takes ``mark`` or raises Wrong."""
        if not self.accept(mark):
            raise Wrong(self.token[2], f"{mark} expected, found {shown(self.token)}")

    def name(self, what: str) -> str:
        """Takes a name that is no reserved word."""
        kind, text, line = self.token
        if kind != "name" or text.lower() in RESERVED:
            raise Wrong(line, f"{what} expected, found {shown(self.token)}")
        self.take()
        return text

    def recover(self) -> None:
        """Skips behind the next semicolon, but never over a word that opens or closes a routine or module."""
        while self.token[0] != "end" and self.word() not in _STRUCTURE:
            if self.ended():
                return

    def ended(self) -> bool:
        """Takes a token and says whether a statement ends with it."""
        kind, text, _ = self.take()
        return kind == "move" or text == ";"

    # -- modules -------------------------------------------------------------------------------------------------

    def modules(self) -> list[Module]:
        """All modules up to the end of the text."""
        found = []
        while self.token[0] != "end":
            if self.word() == "module":
                found.append(self.module())
            else:
                self.faults.append(Fault(self.token[2], f"{shown(self.token)} stands outside a module"))
                while self.token[0] != "end" and self.word() != "module":
                    self.take()
        return found

    def module(self) -> Module:
        line = self.take()[2]
        name = ""
        try:
            name = self.name("a module name")
            if self.accept("("):
                while not self.accept(")"):
                    if self.take()[0] == "end":
                        raise Wrong(line, ") of the module's attributes is missing")
        except Wrong as wrong:
            self.faults.append(wrong.fault)
        data: list[Data] = []
        routines: list[Routine] = []
        while self.word() != "endmodule":
            if self.token[0] == "end" or self.word() == "module":
                self.faults.append(Fault(self.token[2], f"ENDMODULE of {name} is missing"))
                return Module(line, name, tuple(data), tuple(routines))
            try:
                self.member(data, routines)
            except Wrong as wrong:
                self.faults.append(wrong.fault)
                self.recover()
        self.take()
        return Module(line, name, tuple(data), tuple(routines))

    def member(self, data: list[Data], routines: list[Routine]) -> None:
        """One declaration of a module."""
        line = self.token[2]
        local = task = False
        if self.word() in ("local", "task"):
            local, task = self.word() == "local", self.word() == "task"
            self.take()
        word = self.word()
        if word in ("const", "pers", "var"):
            data.append(self.data(line, local, task))
        elif word == "proc":
            self.take()
            routines.append(self.routine(line, local))
        elif word in ("func", "trap"):
            self.take()
            self.skip_past(f"end{word}")
            raise Wrong(line, f"{word.upper()} is not read")
        else:
            what = shown(self.take())
            raise Wrong(line, f"a declaration expected, found {what}")

    def skip_past(self, word: str) -> None:
        """Skips a routine that is not read."""
        while self.token[0] != "end" and self.word() not in (word, "endmodule"):
            self.take()
        if self.word() == word:
            self.take()

    def data(self, line: int, local: bool, task: bool) -> Data:
        storage = self.take()[1].lower()
        data_type = self.name("a data type").lower()
        name = self.name(f"the name of a {data_type}")
        if self.accept("{"):
            raise Wrong(line, f"the array {name} is not read")
        value = self.expression() if self.accept(":=") else None
        self.expect(";")
        if value is None and (storage == "const" or (storage == "pers" and (local or task))):
            raise Wrong(line, f"{name} has no value")
        if storage == "pers" and not _literal(value):
            raise Wrong(line, f"PERS {name} must have a literal value")
        return Data(line, storage, data_type, name, local, value)

    # -- routines ------------------------------------------------------------------------------------------------

    def routine(self, line: int, local: bool) -> Routine:
        name = self.name("the name of a PROC")
        self.expect("(")
        if not self.accept(")"):
            self.skip_past("endproc")
            raise Wrong(line, f"PROC {name} has parameters, which are not read")
        data: list[Data] = []
        body: list[Call] = []
        while self.word() != "endproc":
            if self.token[0] == "end" or self.word() in _STRUCTURE:
                self.faults.append(Fault(self.token[2], f"ENDPROC of {name} is missing"))
                return Routine(line, name, local, tuple(data), tuple(body))
            try:
                if self.word() in _DATA:
                    data.append(self.routine_data(bool(body)))
                else:
                    self.statement(body)
            except Wrong as wrong:
                self.faults.append(wrong.fault)
                self.recover()
        self.take()
        return Routine(line, name, local, tuple(data), tuple(body))

    def routine_data(self, late: bool) -> Data:
        line = self.token[2]
        word = self.word()
        if word not in ("const", "var"):
            self.take()
            raise Wrong(line, f"{word.upper()} inside a routine")
        if late:
            self.take()
            raise Wrong(line, f"{word.upper()} after the first statement of a routine")
        return self.data(line, False, False)

    def statement(self, body: list[Call]) -> None:
        kind, text, line = self.token
        if kind == "move":
            self.take()
            name, target, speed, zone, tool, work = whole_move(text)
            args: tuple[Expr, ...] = (Point(point(target, line)), *refs(speed, zone, tool))
            body.append(Call(line, name.lower(), args, work_object(work)))
            return
        if kind != "name":
            self.take()
            if text != ";":  # an empty statement
                raise Wrong(line, f"a statement expected, found {shown((kind, text, line))}")
            return
        if text.lower() in RESERVED:
            self.control()
            return
        self.take()
        if self.token[0] == "mark" and self.token[1] in (":=", ":", ".", "{", "("):
            raise Wrong(line, f"{text}{self.token[1]} is a statement that is not read")
        body.append(self.call(text, line))

    def call(self, name: str, line: int) -> Call:
        """The rest of a statement ``name arguments;``."""
        if self.accept(";"):
            return Call(line, name.lower())
        args, options = self.arguments(0)
        self.expect(";")
        return Call(line, name.lower(), args, options)

    def control(self) -> None:
        """Reports a control statement and skips its head, so that the statements inside it are still looked at."""
        word, line = self.word(), self.token[2]
        if word not in _CONTINUES:
            self.faults.append(Fault(line, f"{word.upper()} is a statement that is not read"))
        self.take()
        while self.token[0] != "end" and self.token[2] == line and self.word() not in _STRUCTURE:
            if self.word() in ("then", "do"):
                self.take()
                return
            if self.ended():
                return

    # -- expressions ---------------------------------------------------------------------------------------------

    def arguments(self, depth: int) -> tuple[tuple[Expr, ...], tuple[tuple[str, Expr | None], ...]]:
        """Arguments up to what is none, optional ones (after a backslash) apart."""
        args: list[Expr] = []
        options: list[tuple[str, Expr | None]] = []
        while True:
            if self.accept("\\"):
                name = self.name("the name of an optional argument").lower()
                options.append((name, self.expression(depth) if self.accept(":=") else None))
            else:
                args.append(self.expression(depth))
            if not self.accept(",") and self.token[1] != "\\":
                return tuple(args), tuple(options)

    def expression(self, depth: int = 0) -> Expr:
        kind, text, line = self.token
        if depth > _DEEPEST:
            raise Wrong(line, "an expression nested too deeply")
        if kind in ("number", "string", "point"):
            self.take()
            if kind == "number":
                return number(text, line)
            return Point(point(text, line)) if kind == "point" else text[1:-1].replace('""', '"')
        if kind == "name":
            return self.named(depth)
        self.take()
        if text == "[":
            items = [self.expression(depth + 1)]
            while self.accept(","):
                items.append(self.expression(depth + 1))
            self.expect("]")
            return tuple(items)
        if text in ("+", "-") and self.token[0] == "number":
            return number(text + self.take()[1], line)
        raise Wrong(line, f"a value expected, found {shown((kind, text, line))}")

    def named(self, depth: int) -> Expr:
        """A name, TRUE, FALSE or a function with its arguments."""
        line = self.token[2]
        if self.word() in ("true", "false"):
            return self.take()[1].lower() == "true"
        name = self.name("a value")
        if not self.accept("("):
            return Ref(name)
        args, options = self.arguments(depth + 1)
        self.expect(")")
        return Call(line, name.lower(), args, options)


def _literal(value: Expr | None) -> bool:
    if isinstance(value, tuple):
        return all(_literal(item) for item in value)
    return not isinstance(value, (Ref, Call))
