"""RAPID text as modules: the grammar of the RAPID kernel manual (technical reference manual, chapters 2 to 9).

Whoever reads a part of the language only overrides the productions that it has not: one grammar for all.
"""

from __future__ import annotations

from typing import ClassVar

from .expressions import Calls
from .rows import Spellings
from .statements import CLAUSES, STRUCTURE, Note, Statements
from .tokens import Wrong, show_token
from .tree import Data, Expr, Hole, Module, Parameter, Record, Routine, Run, Statement

_DATA = frozenset(("local", "task", "const", "pers", "var"))
_ATTRIBUTES = ("sysmodule", "noview", "nostepin", "viewonly", "readonly")
_MOST_DIMENSIONS = 3
_MODES = frozenset(("var", "pers", "inout", "ref"))


class Parser(Statements):
    """Modules and routines. clauses: of routines."""

    clauses: ClassVar[frozenset[str]] = CLAUSES

    # -- modules -------------------------------------------------------------------------------------------------

    def modules(self) -> list[Module]:
        """All modules up to the end of the text."""
        found = []
        while self.token[0] != "end":
            if self.word() == "module":
                found.append(self.module())
            else:
                self.notes.append(
                    Note(self.token[2], f"{show_token(self.token)} stands outside a module")
                )
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
        while True:
            kind, text, at, _ = self.take()
            if kind == "end":
                raise Wrong(line, ") of the module's attributes is missing")
            if kind != "name":
                self.notes.append(
                    Note(at, f"an attribute of the module expected, found {text[:12]!r}")
                )
                if text == ")":
                    return tuple(found)
                continue
            found.append(text.lower())
            self.judge_attribute(at, text, found)
            if self.accept(")"):
                return tuple(found)
            if not self.accept(",") and self.token[0] != "end":
                self.notes.append(
                    Note(at, f", or ) expected behind {text[:40]}, found {show_token(self.token)}")
                )

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
            if task:
                what = f"TASK before {word.upper()}: it belongs to data alone"
                self.notes.append(Note(line, what))
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

    def dimensions(self, line: int, name: str) -> tuple[Expr, ...]:
        """Of an array, behind the bracket."""
        dims = self.listed(self.expression)
        self.expect("}")
        if len(dims) > _MOST_DIMENSIONS:
            raise Wrong(
                line, f"{name} has {len(dims)} dimensions; an array has at most {_MOST_DIMENSIONS}"
            )
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
        blocks: dict[str, list[Statement | Run]] = {"": []}
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
        return Routine(
            line,
            name,
            local,
            tuple(data),
            tuple(blocks[""]),
            handler,
            kind,
            parameters,
            gives,
            last,
        )

    def enclosed(self, body: list[Statement | Run], _clause: str) -> None:
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


def is_literal(value: Expr | None) -> bool:
    """Whether a value is written out, as a PERS must have it (kernel manual, persistents)."""
    if isinstance(value, tuple):
        return all(is_literal(item) for item in value)
    return (
        value is None or isinstance(value, (float, bool, str)) or type(value).__name__ in ("Point",)
    )


def parse(text: str, first_line: int) -> tuple[list[Module], list[Note]]:
    """The modules of one file whose first line has the number ``first_line``, and what is wrong with its grammar."""
    parser = Parser(text, first_line, Spellings(Calls))
    return parser.modules(), parser.notes
