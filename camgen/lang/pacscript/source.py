"""Reads PacScript files as modules: the preprocessor, and procedures with their statements."""

from __future__ import annotations

import operator
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import PurePosixPath
from typing import Any, NamedTuple

from camgen.lang.columns import Run
from camgen.lang.pacscript.expressions import Node, list_arguments, parse
from camgen.lang.pacscript.functions import COMPARISONS
from camgen.lang.pacscript.lines import (
    CLOSING,
    DEFINE,
    PARAMETER,
    FaultCallback,
    expand,
    join,
    split_rows,
    without_comment,
)
from camgen.lang.pacscript.motion import cut_bracket
from camgen.lang.pacscript.values import Unreadable
from camgen.lang.pacscript.words import name_fault
from camgen.lang.values import require

_OPENING = re.compile(
    r"(?:(?:public|private|static)\s+)?(sub|function)\s+([a-z_]\w*)\s*(.*)", re.IGNORECASE
)
_PROGRAM = re.compile(r"program\s+([a-z_]\w*)\s*(\(.*\))?", re.IGNORECASE)
_RETURNS = re.compile(r"as\s+(\w+)\s*(?:\(\s*\))?", re.IGNORECASE)
_DECLARING = re.compile(
    r"(?:dim|public|static|private|defio|defint|defsng|defdbl|defstr|defpos|defjnt|defvec|deftrn"
    r"|extern)\b",
    re.IGNORECASE,
)
_DIRECTIVE = re.compile(r"#\s*([a-z]+)\s*(.*)", re.IGNORECASE | re.DOTALL)
_INCLUDE = re.compile(r"""["<](.*?)[">]\s*(?:raw)?""", re.IGNORECASE)
_DEFINED = re.compile(r"\bdefined\s*\(?\s*(\w+)\s*\)?", re.IGNORECASE)
#: Maximum depth and number of the includes of a module.
_MAX_DEPTH, _MAX_INCLUDES = 20, 200
#: Headers of the controller: they hold names of types and of panels.
_SYSTEM = frozenset(("variant.h", "panelmain.h", "pacman.h", "dio_tab.h", "var_tab.h"))
#: Macros that the controller defines.
_PREDEFINED = {"__rc8__": "1", "__vertical_robot__": "1", "__scara_robot__": "0"}


class Statement(NamedTuple):
    """A statement, or motions in the usual spelling.

    line: number of its line, from 1 through all files.
    text: its text without comment, macros replaced.
    """

    line: int
    text: str | Run


class Parameter(NamedTuple):
    """A parameter of a procedure. kind: its type in lower case."""

    name: str
    kind: str
    by_value: bool


@dataclass(slots=True)
class Procedure:
    """A Sub, a Function or a PROGRAM.

    returns: type of the value of a Function, "program" for a PROGRAM, "" for a Sub.
    code: compiled steps, None before the first run.
    """

    name: str
    line: int
    parameters: list[Parameter]
    returns: str
    statements: list[Statement] = field(default_factory=list)
    code: Any = None


@dataclass(slots=True)
class Module:
    """A file with all that it includes.

    name: its name without folder and suffix.
    procedures: procedures by name in lower case. The start of the file is "main", that of an
        included file has the name of that file.
    declarations: declarations outside the procedures.
    macros: texts of the macros by name in lower case.
    included: names of the files that are included.
    missing: line of the first include of each file that is not given, by name.
    pac: whether it is in the older dialect.
    """

    name: str
    procedures: dict[str, Procedure] = field(default_factory=dict)
    declarations: list[Statement] = field(default_factory=list)
    macros: dict[str, str] = field(default_factory=dict)
    included: set[str] = field(default_factory=set)
    missing: dict[str, int] = field(default_factory=dict)
    pac: bool = False


class File(NamedTuple):
    """A file as it was given.

    line: number of its first line, from 1 through all files.
    statements: line and text of each statement, or the motions of several lines.
    """

    line: int
    statements: list[tuple[int, str | Run]]

    def count_statements(self) -> int:
        """The number of statements."""
        return sum(1 if isinstance(text, str) else len(text) for _, text in self.statements)


def read_files(
    files: Mapping[str, str], report: FaultCallback, remark: FaultCallback | None = None
) -> dict[str, File]:
    """Return the files by name in lower case. Lines are counted through all of them.

    remark: function that takes note of a doubtful comment, as in `join`.
    """
    result: dict[str, File] = {}
    before = 0
    for name, text in files.items():
        file = File(before + 1, join(text, before, report, remark))
        result.setdefault(base_name(name), file)
        before += text.count("\n") + (text[-1:] not in ("", "\n"))
    return result


def base_name(name: str) -> str:
    """Return the name of a file in lower case without its folder.

    DENSO separates folders by a backslash or a yen sign.
    """
    return re.split(r"[\\/\u00a5]", name.strip())[-1].lower()


def stem(name: str) -> str:
    """Return the name of a file by which programs call it."""
    return PurePosixPath(base_name(name)).stem


def list_included(file: File) -> list[str]:
    """Return the names of the files that a file includes."""
    texts = [text for _, text in file.statements if isinstance(text, str)]
    rests = [_DIRECTIVE.fullmatch(text) for text in texts if text[0] == "#"]
    matches = [
        _INCLUDE.fullmatch(match[2].strip())
        for match in rests
        if match and match[1].lower() == "include"
    ]
    return [base_name(match[1]) for match in matches if match]


def read_module(
    name: str, files: Mapping[str, File], given: Mapping[str, float], report: FaultCallback
) -> Module:
    """Read a file as a module. given: values of macros that the user sets, by lower-case name."""
    macros = {key: f"{value:g}" for key, value in given.items() if key.startswith("__")}
    module = Module(stem(name), macros=_PREDEFINED | macros)
    Reader(module, files, report).file(name, 0)
    return module


class Reader:
    """Reads the statements of a file and of what it includes into a module."""

    def __init__(self, module: Module, files: Mapping[str, File], report: FaultCallback) -> None:
        self.module, self.files, self.add_fault = module, files, report
        self.current: Procedure | None = None
        self.count = 0
        self.start = ""

    def file(self, name: str, depth: int) -> None:
        """Read a file."""
        active: list[str] = []
        self.start = self.start or name
        start = "main" if depth == 0 else stem(name)
        for line, text in self.files[name].statements:
            if isinstance(text, str) and text[0] == "#":
                self.directive(line, text, active, depth)
            elif any(state != "on" for state in active):
                continue
            elif isinstance(text, str):
                self.expand(line, text, start)
            else:
                self.motions(line, text, start)
        if active:
            self.add_fault(self.files[name].line, "#If has no #EndIf")
        if self.current is not None:
            if self.current.returns != "program":
                self.add_fault(self.current.line, "the procedure has no end")
            self.current = None

    def motions(self, line: int, run: Run, start: str) -> None:
        """Add motions in the usual spelling, line by line if a macro may change them."""
        macros = self.module.macros
        text = run.source.text.lower() if macros else ""
        if self.current is not None and not any(name in text for name in macros):
            self.current.statements.append(Statement(line, run))
            return
        for number, row in enumerate(split_rows(run), start=line):
            self.expand(number, without_comment(row), start)

    def expand(self, line: int, text: str, start: str) -> None:
        """Add a statement after the expansion of macros."""
        if self.module.macros:
            try:
                text = expand(text, self.module.macros)
            except ValueError as error:
                self.add_fault(line, str(error))
                return
        if text:
            self.statement(line, text, start)

    def directive(self, line: int, text: str, active: list[str], depth: int) -> None:
        """Run a directive of the preprocessor.

        active: state of each #If around it: on, off (no branch was on yet), or over.
        """
        match = _DIRECTIVE.fullmatch(text)
        word, rest = (match[1].lower(), match[2].strip()) if match else ("", "")
        if word in ("if", "ifdef", "ifndef"):
            if not all(state == "on" for state in active):
                active.append("over")
            else:
                active.append("on" if self.holds(line, word, rest) else "off")
        elif word in ("elif", "elseif", "else"):
            if not active:
                self.add_fault(line, f"#{word} without #If")
            elif active[-1] == "off":
                active[-1] = "on" if word == "else" or self.holds(line, "if", rest) else "off"
            else:
                active[-1] = "over"
        elif word in ("endif", "end"):
            if active:
                active.pop()
            else:
                self.add_fault(line, "#EndIf without #If")
        elif all(state == "on" for state in active):
            self.order(line, word, text, rest, depth)

    def order(self, line: int, word: str, text: str, rest: str, depth: int) -> None:
        """Run a directive other than #If and its branches."""
        if word == "define":
            if define := DEFINE.fullmatch(text):
                self.module.macros[define[1].lower()] = (define[2] or "").strip()
            else:
                self.add_fault(line, "#Define needs a name")
        elif word == "undef":
            self.module.macros.pop(rest.lower(), None)
        elif word == "include":
            self.include(line, rest, depth)
        elif word == "error":
            self.add_fault(line, f"#Error {rest[:80]}")
        elif word not in ("pragma", "warning"):
            self.add_fault(line, f"#{word} is not a directive")

    def include(self, line: int, rest: str, depth: int) -> None:
        """Run `#Include "name"`."""
        match = _INCLUDE.fullmatch(rest)
        if match is None:
            self.add_fault(line, "#Include needs the name of a file in quotes")
            return
        name = base_name(match[1])
        if name in self.module.included or name == self.start:
            return  # Files of DENSO include each other: each is read once.
        self.count += 1
        if name in self.files and depth < _MAX_DEPTH and self.count <= _MAX_INCLUDES:
            self.module.included.add(name)
            current, self.current = self.current, None
            self.file(name, depth + 1)
            self.current = current
        elif name in self.files:
            self.add_fault(line, "files that include each other without end")
        elif name not in _SYSTEM:
            self.module.missing.setdefault(name, line)

    def holds(self, line: int, word: str, rest: str) -> bool:
        """Evaluate a condition of the preprocessor."""
        macros = self.module.macros
        if word != "if":
            return (rest.split(maxsplit=1)[0].lower() in macros if rest else False) == (
                word == "ifdef"
            )
        try:
            known = _DEFINED.sub(lambda m: "1" if m[1].lower() in macros else "0", rest)
            return bool(_evaluate_constant(parse(expand(known, macros))))
        except (ValueError, ZeroDivisionError, OverflowError):
            self.add_fault(line, f"the condition {rest[:60]} is not understood")
            return False

    def statement(self, line: int, text: str, start: str) -> None:
        """Add a statement, or open or close a procedure."""
        lower = text[:8].lower()
        if lower.startswith("end") and (closing := CLOSING.fullmatch(text)):
            self.close(line, text, closing[1].lower())
        elif lower.startswith(("sub", "function", "public", "private", "static")) and (
            match := _OPENING.fullmatch(text)
        ):
            self.open(line, match, start)
        elif lower == "program " and (match := _PROGRAM.fullmatch(text)):
            # The older dialect: up to the end of the file.
            self.module.pac = True
            parameters = _parse_parameters((match[2] or "")[1:-1])
            self.current = Procedure(match[1].lower(), line, parameters, "program")
            self.module.procedures.setdefault(start, self.current)
        elif self.current is not None:
            self.current.statements.append(Statement(line, text))
        elif _DECLARING.match(text):
            self.module.declarations.append(Statement(line, text))
        else:
            self.add_fault(line, "a statement outside a procedure")

    def close(self, line: int, text: str, kind: str) -> None:
        """Run `End Sub` or `End Function`."""
        if self.current is None:
            self.add_fault(line, f"{text} closes nothing")
        elif self.current.returns != "program" and bool(self.current.returns) != (
            kind == "function"
        ):
            opened = "Function" if self.current.returns else "Sub"
            self.add_fault(line, f"{text} closes a {opened}, which ends with End {opened}")
        self.current = None

    def open(self, line: int, opening: re.Match[str], start: str) -> None:
        """Open a Sub or a Function."""
        if self.current is not None and self.current.returns != "program":
            self.add_fault(line, f"{opening[0][:60]} begins inside another procedure")
        name, rest, inside = opening[2].lower(), opening[3].strip(), ""
        try:
            if rest.startswith("("):
                inside, rest = cut_bracket(rest)
            parameters = _parse_parameters(inside)
        except Unreadable:
            parameters, rest = [], ""
            self.add_fault(line, "parameters that cannot be read")
        returns = _RETURNS.fullmatch(rest)
        if rest and returns is None:
            self.add_fault(line, f"{rest[:40]} is not understood")
        if what := "" if name == "main" else name_fault(opening[2]):
            self.add_fault(line, what)
        kind = ""
        if opening[1].lower() == "function":
            kind = returns[1].lower() if returns else "variant"
        self.current = Procedure(name, line, parameters, kind)
        if name == "main":
            name = start
        if name in self.module.procedures and self.module.procedures[name].line != line:
            self.add_fault(line, f"a second procedure {opening[2]}")
        else:
            self.module.procedures[name] = self.current


def _parse_parameters(inside: str) -> list[Parameter]:
    parameters = []
    for part in list_arguments(inside):
        match = require(PARAMETER.fullmatch(part), Unreadable("parameters that cannot be read"))
        parameters.append(
            Parameter(
                match[2].lower().rstrip("!#%$"),
                (match[4] or "variant").lower(),
                (match[1] or "").lower() == "byval",
            )
        )
    return parameters


def _evaluate_constant(node: Node) -> float:
    """Evaluate an expression of constants, in which undefined names are 0."""
    if node.kind == "number":
        return float(node.content)
    if node.kind in ("tuple", "sign", "not") and len(node.parts) == 1:
        value = _evaluate_constant(node.parts[0])
        if node.kind == "tuple":
            return value
        return float(not value) if node.kind == "not" else float(node.content) * value
    if len(node.parts) == 2 and node.kind in _OPERATIONS:
        return float(_OPERATIONS[node.kind](*map(_evaluate_constant, node.parts)))
    if node.kind == "name":
        return 0.0
    raise Unreadable(f"{node.kind} is not evaluated")


_OPERATIONS: dict[str, Callable[[Any, Any], float]] = {
    **COMPARISONS,
    "and": lambda a, b: bool(a and b),
    "or": lambda a, b: bool(a or b),
    "+": operator.add,
    "-": operator.sub,
    "*": operator.mul,
}
