"""RAPID tokens as modules, data and statements: the grammar of the read-back.

Free form, case-insensitive, ``;`` ends a statement (RAPID kernel manual, grammar). What the subset lacks becomes a
fault that names it; no text makes the parser raise.
"""

from __future__ import annotations

from camgen.post import Fault

from .rapid_call import Calls
from .rapid_lexis import RESERVED, Wrong, banner, shown
from .rapid_plain import read_plain
from .rapid_tree import Call, Data, Expr, Inline, Module, Ref, Routine

#: Words at which a statement that lost its semicolon must have ended.
_STRUCTURE = frozenset(("module", "endmodule", "proc", "endproc", "func", "endfunc", "trap", "endtrap"))
#: Words that only continue or close a control statement whose opening has been reported.
_CONTINUES = frozenset(("else", "elseif", "endif", "endfor", "endwhile", "endtest", "case", "default", "then", "do"))
_DATA = frozenset(("local", "task", "const", "pers", "var"))


def parse(text: str, first_line: int, plain: bool) -> tuple[list[Module], list[Fault]]:
    """The modules of one file whose first line has the number ``first_line``, and what is wrong with its grammar.

    plain: whether statements in the usual spelling are read at once.
    """
    parser = _Parser(text, first_line, plain)
    modules = parser.modules()
    return modules, parser.faults


class _Parser(Calls):
    """Modules and routines."""

    def __init__(self, text: str, first_line: int, plain: bool) -> None:
        start = banner(text)
        super().__init__(text, first_line + text.count("\n", 0, start), start)
        self.plain = plain
        self.faults: list[Fault] = []

    def recover(self) -> None:
        """Skips behind the next semicolon, but never over a word that opens or closes a routine or module."""
        while self.token[0] != "end" and self.word() not in _STRUCTURE:
            if self.ended():
                return

    def ended(self) -> bool:
        """Takes a token and says whether a statement ends with it."""
        kind, text, _, _ = self.take()
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
        body: list[Call | Inline] = []
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

    def statement(self, body: list[Call | Inline]) -> None:
        """One statement, or as many as can be read at once."""
        token = self.token
        kind, text, line, start = token
        if kind not in ("name", "move"):
            self.take()
            if text != ";":  # an empty statement
                raise Wrong(line, f"a statement expected, found {shown(token)}")
            return
        if text.lower() in RESERVED:
            self.control()
            return
        if self.plain:
            end, line = read_plain(self.text, start, line, body)
            if end != start:
                self.jump(end, line)
                return
        body.append(self.statement_call())

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


def _literal(value: Expr | None) -> bool:
    if isinstance(value, tuple):
        return all(_literal(item) for item in value)
    return not isinstance(value, (Ref, Call))
