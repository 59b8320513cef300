"""The parser of RAPID modules, after the grammar of the kernel manual, chapters 2 to 9.

The read-back of a post has a part of the language. It overrides the productions that it lacks.
"""

from __future__ import annotations

from typing import ClassVar, NoReturn

from camgen.lang.log import Log

from .expressions import Calls
from .rows import Spellings
from .statements import CLAUSES, STRUCTURE, Statements
from .tokens import Wrong, show_token
from .tree import Data, Expr, Module, Parameter, Point, Record, Routine, Run, Statement

_DATA = frozenset(("local", "task", "const", "pers", "var"))
_ATTRIBUTES = ("sysmodule", "noview", "nostepin", "viewonly", "readonly")
_MOST_DIMENSIONS = 3
_MODES = frozenset(("var", "pers", "inout", "ref"))


class Parser(Statements):
    """The parser of modules and routines.

    clauses: words that begin the clauses of routines.
    """

    clauses: ClassVar[frozenset[str]] = CLAUSES

    # -- modules ---------------------------------------------------------------------------------

    def modules(self) -> list[Module]:
        """All modules up to the end of the text."""
        modules = []
        while self.token[0] != "end":
            if self.word() == "module":
                modules.append(self.module())
            else:
                self.note(Wrong(self.token[2], f"{show_token(self.token)} stands outside a module"))
                while self.token[0] != "end" and self.word() != "module":
                    self.take()
        return modules

    def module(self) -> Module:
        """A module. Without ENDMODULE it ends at the next MODULE or with the text."""
        line = self.take()[2]
        name = ""
        try:
            name = self.name("a module name")
            self.attributes(line)
        except Wrong as wrong:
            self.note(wrong)
        data: list[Data] = []
        routines: list[Routine] = []
        records: list[Record] = []
        while self.word() != "endmodule":
            if self.token[0] == "end" or self.word() == "module":
                self.note(Wrong(self.token[2], f"ENDMODULE of {name} is missing"))
                break
            try:
                self.member(data, routines, records)
            except Wrong as wrong:
                self.note(wrong)
                self.recover()
        else:
            self.close_module()
        return Module(line, name, tuple(data), tuple(routines), tuple(records))

    def close_module(self) -> None:
        """Take ENDMODULE."""
        self.take()

    def attributes(self, line: int) -> None:
        """Take the attributes of a module, in brackets. Raises Wrong without a closing bracket.

        line: line of MODULE.
        """
        attributes: set[str] = set()
        is_open = self.accept("(")
        while is_open:
            kind, text, text_line, _ = self.take()
            if kind == "end":
                raise Wrong(line, ") of the module's attributes is missing")
            if kind != "name":
                what = f"an attribute of the module expected, found {text[:12]!r}"
                self.note(Wrong(text_line, what))
                is_open = text != ")"
                continue
            if self.whole and text.lower() not in _ATTRIBUTES:
                self.note(Wrong(text_line, f"{text[:40]} is not an attribute of a module"))
            elif self.whole and text.lower() in attributes:
                self.note(Wrong(text_line, f"the attribute {text} is given twice"))
            attributes.add(text.lower())
            is_open = not self.accept(")")
            if is_open and not self.accept(",") and self.token[0] != "end":
                what = f", or ) expected behind {text[:40]}, found {show_token(self.token)}"
                self.note(Wrong(text_line, what))

    def member(self, data: list[Data], routines: list[Routine], records: list[Record]) -> None:
        """Add a declaration of a module to the list of its kind."""
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
                self.note(Wrong(line, f"TASK before {word.upper()}: it belongs to data alone"))
            self.take()
            routines.append(self.routine(line, local, word))
        elif word in ("record", "alias"):
            records.append(self.record() if word == "record" else self.alias())
        elif self.token[0] == "hole":
            self.placeholder()
        else:
            self.no_member()

    def placeholder(self) -> None:
        """Note a placeholder such as ``<DDN>``."""
        _, text, line, _ = self.take()
        self.log.find("unusual", f"{text}: a place that is not filled in", line=line)

    def no_member(self) -> NoReturn:
        """Raise Wrong for a token that does not begin a declaration."""
        line, what = self.token[2], show_token(self.take())
        raise Wrong(line, f"a declaration expected, found {what}")

    def late_data(self, line: int, word: str) -> None:
        """Note a declaration of data after a routine."""
        what = f"{word.upper()} after a routine, where the kernel manual has no declaration of data"
        self.log.find("unusual", what, line=line)

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
        """A declaration of data. Raises Wrong if it needs a value and has none."""
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
        """Sizes of an array after the opening bracket. Raises Wrong if there are too many."""
        if not self.whole:
            raise Wrong(line, f"the array {name} is not read")
        dims = self.listed()
        self.expect("}")
        if len(dims) > _MOST_DIMENSIONS:
            limit = f"an array has at most {_MOST_DIMENSIONS}"
            raise Wrong(line, f"{name} has {len(dims)} dimensions; {limit}")
        return dims

    # -- routines --------------------------------------------------------------------------------

    def routine(self, line: int, local: bool, kind: str) -> Routine:
        """The rest of a routine after its first word, which is its `kind` in upper case."""
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
                self.note(Wrong(self.token[2], f"{end.upper()} of {name} is missing"))
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
        body = tuple(blocks[""])
        return Routine(line, name, local, tuple(data), body, handler, kind, parameters, gives, last)

    def enclosed(self, body: list[Statement | Run], _clause: str) -> None:
        """Add a statement to a clause: error, undo, backward, or empty for the body."""
        self.statement(body)

    def clause(self) -> str:
        """The first word of a clause. ERROR may have a list of error numbers."""
        word = self.take()[1].lower()
        if self.whole and word == "error" and self.accept("("):
            self.listed()
            self.expect(")")
        return word

    def parameters(self, _line: int, _name: str) -> tuple[Parameter, ...]:
        """Parameters up to the closing bracket."""
        parameters: list[Parameter] = []
        group = 0
        while not self.accept(")"):
            if parameters and not self.accept(",") and self.token[1] != "\\":
                raise Wrong(self.token[2], f", or ) expected, found {show_token(self.token)}")
            group += 1
            optional = self.accept("\\")
            parameters.append(self.parameter(optional, group))
            while optional and self.accept("|"):
                self.accept("\\")
                parameters.append(self.parameter(True, group))
        return tuple(parameters)

    def parameter(self, optional: bool, group: int) -> Parameter:
        """A parameter after its comma or backslash."""
        mode = ""
        if self.word() in _MODES:
            mode = self.take()[1].lower()
        kind = self.name("the data type of a parameter").lower()
        name = self.name("the name of a parameter").lower()
        dims = 0
        if self.accept("{"):
            self.expect("*")
            while self.accept(","):
                self.expect("*")
            self.expect("}")
            dims = 1
        return Parameter(mode, kind, name, dims, optional, group)

    def routine_data(self, late: bool) -> Data:
        """Data of a routine, VAR or CONST. Raises Wrong if they are late: after a statement."""
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
    """Whether a value is missing or written out, as PERS needs it (kernel manual, persistents)."""
    if isinstance(value, tuple):
        return all(is_literal(item) for item in value)
    return value is None or isinstance(value, (float, bool, str, Point))


def parse(text: str, first_line: int, log: Log) -> list[Module]:
    """The modules of a file.

    first_line: number of the first line of the file.
    log: log for faults of its grammar.
    """
    return Parser(text, first_line, Spellings(Calls), log).modules()
