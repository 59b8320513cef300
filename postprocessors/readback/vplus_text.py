"""V+ text as routines: lines, labels, comments, blocks, names. For the read-back ``vplus``.

Sources: V+ Language User's Guide (program structure, names of at most 15 characters), as far as docs/posts/vplus.md
quotes them.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import lru_cache

#: Names are told apart by so many characters; the rest is cut silently.
NAME = 15
_LINE_END = re.compile(r"\r\n|\r|\n")
_LABEL = re.compile(r"\s*(\d+)(?:\s+|$)", re.ASCII)
_WORD = re.compile(r"\s*([A-Za-z][A-Za-z0-9._]*)\s*(.*)", re.DOTALL)
_LONG_NAME = re.compile(rf"[A-Za-z][A-Za-z0-9._]{{{NAME - 1},}}")
_HEADER = re.compile(r"([A-Za-z][A-Za-z0-9._]*)\s*\(([^()]*)\)\s*")
_STRING = re.compile(r'"[^"]*"')
_DECLARE = frozenset({"AUTO", "LOCAL", "GLOBAL"})
#: Words that open a block which END closes, with the word that has to stand in the line, too.
_OPENS = {"IF": "THEN", "FOR": "", "WHILE": "", "CASE": ""}

Report = Callable[[int, str], None]


@dataclass(frozen=True, slots=True)
class Statement:
    """One instruction: its line (1-based through all files), its first word in capitals, what follows the word."""

    line: int
    word: str
    rest: str


@dataclass(slots=True)
class Routine:
    """One ``.PROGRAM``. partner: by the index of an opening statement the index of its END (or UNTIL)."""

    name: str
    line: int
    arguments: str
    statements: list[Statement] = field(default_factory=list)
    partner: dict[int, int] = field(default_factory=dict)


@lru_cache(maxsize=4096)
def canonical(name: str) -> str:
    """The name as V+ keeps it: case does not count, nor what follows the 15th character. A ``#`` or ``$`` stays."""
    bare = name.lstrip("#$")
    return name[: len(name) - len(bare)] + bare[:NAME].lower()


def routines(files: Mapping[str, str], report: Report) -> list[Routine]:
    """All programs of all files in order. What is no program, or no V+, is reported."""
    found: list[Routine] = []
    first = 1
    for text in files.values():
        lines = _LINE_END.split(text)
        if lines and not lines[-1]:
            lines.pop()
        found += _routines(lines, first, report)
        first += len(lines)
    seen: dict[str, Routine] = {}
    for routine in found:
        if seen.setdefault(canonical(routine.name), routine) is not routine:
            report(routine.line, f"program {routine.name} is there twice")
        routine.partner = _partners(routine, report)
    return found


def _routines(lines: list[str], first: int, report: Report) -> list[Routine]:
    found: list[Routine] = []
    current: Routine | None = None
    section = ""
    long_names: dict[str, str] = {}
    for number, raw in enumerate(lines, start=first):
        code = _code(raw, number, report)
        for name in _LONG_NAME.findall(_STRING.sub("", code) if '"' in code else code):
            _collision(name.lower(), long_names, number, report)
        if not code:
            continue
        if code[0] == ".":
            if current is not None and not code.upper().startswith(".END"):
                report(number, f"{code.split()[0]} before the .END of {current.name}")
            current, section = _dot(code, number, current, section, report)
            if current is not None:
                found.append(current)
        elif current is not None:
            _add(current, code, number, report)
        elif not section:
            report(number, "an instruction outside of a .PROGRAM")
    if current is not None or section:
        report(first + len(lines) - 1, f"{current.name if current else section} has no .END")
    return found


def _code(raw: str, number: int, report: Report) -> str:
    """The line without its comment and outer blanks."""
    if not raw.isascii():
        report(number, "a character that is not ASCII")
    if '"' not in raw:
        return raw.partition(";")[0].strip()
    quoted = False
    for i, c in enumerate(raw):
        if c == '"':
            quoted = not quoted
        elif c == ";" and not quoted:
            return raw[:i].strip()
    if quoted:
        report(number, "a string that does not end")
    return raw.strip()


def _collision(name: str, long_names: dict[str, str], number: int, report: Report) -> None:
    other = long_names.setdefault(name[:NAME], name)
    if other != name:
        report(number, f"{name} and {other} are one name: only {NAME} characters count")


def _dot(code: str, number: int, current: Routine | None, section: str, report: Report) -> tuple[Routine | None, str]:
    """The routine and the other section that are open after a line that starts with a dot."""
    word, rest = (*code.split(None, 1), "")[:2]
    word = word.upper()
    if word == ".END":
        if current is None and not section:
            report(number, ".END without .PROGRAM")
        return None, ""
    if word == ".PROGRAM":
        header = _HEADER.fullmatch(rest.strip())
        if header is None:
            report(number, "a .PROGRAM line is .PROGRAM name(arguments)")
            return Routine("", number, ""), ""
        return Routine(header[1], number, header[2].strip()), ""
    report(number, f"{word} is not evaluated")
    return None, word


def _add(routine: Routine, code: str, number: int, report: Report) -> None:
    label = _LABEL.match(code)
    if label:
        if len(label[1]) > 5 or int(label[1]) > 65535:
            report(number, f"label {label[1][:12]} is above 65535")
        code = code[label.end() :]
        if not code:
            return
    match = _WORD.fullmatch(code)
    if match is None:
        report(number, f"unknown statement {code[:40]!r}")
        return
    word, rest = match[1], match[2]
    if rest[:1] == "=":
        word, rest = "=", f"{word} {rest}"
    word = word.upper()
    if word in _DECLARE and any(s.word not in _DECLARE for s in routine.statements):
        report(number, f"{word} after the first instruction")
    routine.statements.append(Statement(number, word, rest))


def _partners(routine: Routine, report: Report) -> dict[int, int]:
    partner: dict[int, int] = {}
    open_blocks: list[int] = []
    for index, statement in enumerate(routine.statements):
        word = statement.word
        if word == "DO" or (word in _OPENS and _OPENS[word] in statement.rest.upper()):
            open_blocks.append(index)
        elif word in ("END", "UNTIL"):
            opener = routine.statements[open_blocks[-1]].word if open_blocks else ""
            if not opener or (opener == "DO") != (word == "UNTIL"):
                report(statement.line, f"{word} closes nothing")
            else:
                partner[open_blocks.pop()] = index
    for index in open_blocks:
        report(routine.statements[index].line, f"{routine.statements[index].word} is not closed")
    return partner
