"""PacScript files as modules: what ``#Include``, ``#Define`` and ``#If`` make of them, and their procedures."""

from __future__ import annotations

import operator
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import PurePosixPath
from typing import Any, NamedTuple

from camgen.lang.columns import Run
from camgen.lang.pacscript.expressions import Node, arguments, parse
from camgen.lang.pacscript.functions import COMPARISONS
from camgen.lang.pacscript.lines import (
    CLOSING,
    DEFINE,
    PARAMETER,
    Say,
    expand,
    join,
    split_rows,
    without_comment,
)
from camgen.lang.pacscript.motion import cut_bracket
from camgen.lang.pacscript.values import Unreadable
from camgen.lang.pacscript.words import name_fault
from camgen.lang.programs import strip_mark

_OPENING = re.compile(
    r"(?:(?:public|private|static)\s+)?(sub|function)\s+([a-z_]\w*)\s*(.*)", re.IGNORECASE
)
_PROGRAM = re.compile(r"program\s+([a-z_]\w*)\s*(\(.*\))?", re.IGNORECASE)
_RETURNS = re.compile(r"as\s+(\w+)\s*(?:\(\s*\))?", re.IGNORECASE)
_DECLARING = re.compile(r"(?:dim|public|static|private|defio|defint|defsng|defdbl|defstr|defpos|defjnt|defvec|deftrn"
                        r"|extern)\b", re.IGNORECASE)  # fmt: skip
_DIRECTIVE = re.compile(r"#\s*([a-z]+)\s*(.*)", re.IGNORECASE | re.DOTALL)
_INCLUDE = re.compile(r"""["<](.*?)[">]\s*(?:raw)?""", re.IGNORECASE)
_DEFINED = re.compile(r"\bdefined\s*\(?\s*(\w+)\s*\)?", re.IGNORECASE)
#: Includes may nest so deep, and a module may have so many of them.
_DEEPEST, _MOST = 20, 200
#: Headers of the controller: they hold names of types and of panels.
_SYSTEM = frozenset(("variant.h", "panelmain.h", "pacman.h", "dio_tab.h", "var_tab.h"))
#: What the controller defines by itself.
_PREDEFINED = {"__rc8__": "1", "__vertical_robot__": "1", "__scara_robot__": "0"}


class Statement(NamedTuple):
    """A statement, or motions in the usual spelling.

    line: number of its line, from 1 through all files.
    text: its text without comment, macros replaced.
    """

    line: int
    text: str | Run


class Parameter(NamedTuple):
    """A parameter of a procedure. kind: its type in small letters."""

    name: str
    kind: str
    by_value: bool


@dataclass(slots=True)
class Procedure:
    """A Sub, a Function or a PROGRAM. returns: the type of what a function gives, "" of the others."""

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

    name: its name in lower case, without a folder.
    line: number of its first line, from 1 through all files.
    statements: line and text of each statement, or the motions of several lines.
    """

    name: str
    line: int
    statements: list[tuple[int, str | Run]]

    def count_statements(self) -> int:
        """The number of statements."""
        return sum(1 if isinstance(text, str) else len(text) for _, text in self.statements)


def read_files(files: Mapping[str, str], say: Say, remark: Say | None = None) -> dict[str, File]:
    """The files by name in small letters. Lines are counted through all of them.

    remark: function that takes note of a doubtful comment, as in `join`.
    """
    found: dict[str, File] = {}
    before = 0
    for name, text in files.items():
        base = base_name(name)
        found.setdefault(base, File(base, before + 1, join(text, before, say, remark)))
        before += text.count("\n") + (text[-1:] not in ("", "\n"))
    return found


def normalize(text: str) -> str:
    """A text without a byte order mark, with LF line ends."""
    plain = text.replace("\r\n", "\n").replace("\r", "\n") if "\r" in text else text
    return strip_mark(plain)


def base_name(name: str) -> str:
    """A file's name in small letters without its folder; DENSO writes folders with a backslash or a yen sign."""
    return re.split(r"[\\/\u00a5]", name.strip())[-1].lower()


def stem(name: str) -> str:
    """A file's name as programs call it."""
    return PurePosixPath(base_name(name)).stem


def list_included(file: File) -> list[str]:
    """The names of the files that a file includes."""
    texts = [text for _, text in file.statements if isinstance(text, str)]
    rests = [_DIRECTIVE.fullmatch(text) for text in texts if text[0] == "#"]
    found = [
        _INCLUDE.fullmatch(one[2].strip()) for one in rests if one and one[1].lower() == "include"
    ]
    return [base_name(one[1]) for one in found if one]


def read_module(
    name: str, files: Mapping[str, File], given: Mapping[str, float], say: Say
) -> Module:
    """The module of a file. given: values that the user gives for names of the preprocessor, in small letters."""
    module = Module(stem(name))
    module.macros.update(_PREDEFINED)
    module.macros.update(
        {key: f"{value:g}" for key, value in given.items() if key.startswith("__")}
    )
    Reader(module, files, say).file(name, 0)
    return module


class Reader:
    """Reads the statements of a file and of what it includes into a module."""

    def __init__(self, module: Module, files: Mapping[str, File], say: Say) -> None:
        self.module, self.files, self.say = module, files, say
        self.current: Procedure | None = None
        self.count = 0
        self.start = ""

    def file(self, name: str, depth: int) -> None:
        """All of a file."""
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
            self.say(self.files[name].line, "#If has no #EndIf")
        if self.current is not None:
            if self.current.returns != "program":
                self.say(self.current.line, "the procedure has no end")
            self.current = None

    def motions(self, line: int, run: Run, start: str) -> None:
        """Motions in the usual spelling. They are read line by line where a macro may change them."""
        macros = self.module.macros
        text = run.source.text.lower() if macros else ""
        if self.current is not None and not any(name in text for name in macros):
            self.current.statements.append(Statement(line, run))
            return
        for number, row in enumerate(split_rows(run), start=line):
            self.expand(number, without_comment(row), start)

    def expand(self, line: int, text: str, start: str) -> None:
        """A statement in which macros may stand."""
        if self.module.macros:
            try:
                text = expand(text, self.module.macros)
            except ValueError as error:
                self.say(line, str(error))
                return
        if text:
            self.statement(line, text, start)

    def directive(self, line: int, text: str, active: list[str], depth: int) -> None:
        """``#...``; active: of each #If around it whether it is on, was on, or is yet to come on."""
        found = _DIRECTIVE.fullmatch(text)
        word, rest = (found[1].lower(), found[2].strip()) if found else ("", "")
        if word in ("if", "ifdef", "ifndef"):
            outside = all(state == "on" for state in active)
            active.append(
                "over" if not outside else "on" if self.holds(line, word, rest) else "off"
            )
        elif word in ("elif", "elseif", "else"):
            if not active:
                self.say(line, f"#{word} without #If")
            elif active[-1] == "off":
                active[-1] = "on" if word == "else" or self.holds(line, "if", rest) else "off"
            else:
                active[-1] = "over"
        elif word in ("endif", "end"):
            if active:
                active.pop()
            else:
                self.say(line, "#EndIf without #If")
        elif all(state == "on" for state in active):
            self.order(line, word, text, rest, depth)

    def order(self, line: int, word: str, text: str, rest: str, depth: int) -> None:
        """A directive that is no condition."""
        if word == "define":
            if define := DEFINE.fullmatch(text):
                self.module.macros[define[1].lower()] = (define[2] or "").strip()
            else:
                self.say(line, "#Define needs a name")
        elif word == "undef":
            self.module.macros.pop(rest.lower(), None)
        elif word == "include":
            self.include(line, rest, depth)
        elif word == "error":
            self.say(line, f"#Error {rest[:80]}")
        elif word not in ("pragma", "warning"):
            self.say(line, f"#{word} is no directive")

    def include(self, line: int, rest: str, depth: int) -> None:
        """``#Include "name"``."""
        found = _INCLUDE.fullmatch(rest)
        if found is None:
            self.say(line, "#Include needs the name of a file in quotes")
            return
        name = base_name(found[1])
        if name in self.module.included or name == self.start:
            return  # Files of the maker include each other: each is taken once.
        self.count += 1
        if name in self.files and depth < _DEEPEST and self.count <= _MOST:
            self.module.included.add(name)
            current, self.current = self.current, None
            self.file(name, depth + 1)
            self.current = current
        elif name in self.files:
            self.say(line, "files that include each other without end")
        elif name not in _SYSTEM:
            self.module.missing.setdefault(name, line)

    def holds(self, line: int, word: str, rest: str) -> bool:
        """Whether a condition of the preprocessor holds."""
        macros = self.module.macros
        if word != "if":
            return (rest.split(maxsplit=1)[0].lower() in macros if rest else False) == (
                word == "ifdef"
            )
        try:
            known = _DEFINED.sub(lambda m: "1" if m[1].lower() in macros else "0", rest)
            return bool(_constant(parse(expand(known, macros))))
        except (ValueError, ZeroDivisionError, OverflowError):
            self.say(line, f"the condition {rest[:60]} is not understood")
            return False

    def statement(self, line: int, text: str, start: str) -> None:
        """A statement of one line or several."""
        lower = text[:8].lower()
        if lower.startswith("end") and (closing := CLOSING.fullmatch(text)):
            self.close(line, text, closing[1].lower())
        elif lower.startswith(("sub", "function", "public", "private", "static")) and (
            found := _OPENING.fullmatch(text)
        ):
            self.open(line, found, start)
        elif lower == "program " and (found := _PROGRAM.fullmatch(text)):
            self.program(line, found, start)
        elif self.current is not None:
            self.current.statements.append(Statement(line, text))
        elif _DECLARING.match(text):
            self.module.declarations.append(Statement(line, text))
        else:
            self.say(line, "a statement outside a procedure")

    def close(self, line: int, text: str, kind: str) -> None:
        """``End Sub`` or ``End Function``."""
        if self.current is None:
            self.say(line, f"{text} closes nothing")
        elif self.current.returns != "program" and bool(self.current.returns) != (
            kind == "function"
        ):
            opened = "Function" if self.current.returns else "Sub"
            self.say(line, f"{text} closes a {opened}, which ends with End {opened}")
        self.current = None

    def program(self, line: int, found: re.Match[str], start: str) -> None:
        """``PROGRAM name`` of the older dialect: to the end of the file."""
        self.module.pac = True
        self.current = Procedure(
            found[1].lower(), line, _parameters((found[2] or "")[1:-1]), "program"
        )
        self.module.procedures.setdefault(start, self.current)

    def open(self, line: int, opening: re.Match[str], start: str) -> None:
        """A Sub or a Function."""
        if self.current is not None and self.current.returns != "program":
            self.say(line, f"{opening[0][:60]} begins inside another procedure")
        name, rest, inside = opening[2].lower(), opening[3].strip(), ""
        try:
            if rest.startswith("("):
                inside, rest = cut_bracket(rest)
            parameters = _parameters(inside)
        except Unreadable:
            parameters, rest = [], ""
            self.say(line, "parameters that cannot be read")
        returns = _RETURNS.fullmatch(rest)
        if rest and returns is None:
            self.say(line, f"{rest[:40]} is not understood")
        if what := "" if name == "main" else name_fault(opening[2]):
            self.say(line, what)
        kind = (
            (returns[1].lower() if returns else "variant")
            if opening[1].lower() == "function"
            else ""
        )
        self.current = Procedure(name, line, parameters, kind)
        name = start if name == "main" else name
        if name in self.module.procedures and self.module.procedures[name].line != line:
            self.say(line, f"a second procedure {opening[2]}")
        else:
            self.module.procedures[name] = self.current


def _parameters(inside: str) -> list[Parameter]:
    """What stands in the brackets of a declaration. Unreadable."""
    found = []
    for part in arguments(inside) if inside.strip() else ():
        match = PARAMETER.fullmatch(part)
        if match is None:
            raise Unreadable("parameters that cannot be read")
        found.append(
            Parameter(
                match[2].lower().rstrip("!#%$"),
                (match[4] or "variant").lower(),
                (match[1] or "").lower() == "byval",
            )
        )
    return found


def _constant(node: Node) -> float:
    """The value of an expression of constants; names that nobody defines are 0."""
    if node.kind == "number":
        return float(node.said)
    if node.kind in ("tuple", "sign", "not") and len(node.parts) == 1:
        value = _constant(node.parts[0])
        return (
            value
            if node.kind == "tuple"
            else float(not value)
            if node.kind == "not"
            else float(node.said) * value
        )
    if len(node.parts) == 2 and node.kind in _OPERATIONS:
        return float(_OPERATIONS[node.kind](*map(_constant, node.parts)))
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
