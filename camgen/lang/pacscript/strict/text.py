"""PacScript source as procedures: comments, macros, `Sub` and `Function` (RC8 manual 5225, 449)."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import PurePath

from camgen.lang.columns import Run
from camgen.lang.log import Log
from camgen.lang.pacscript.lines import (
    CLOSING,
    DEFINE,
    GOES_ON,
    LONGEST_GROWN,
    LONGEST_LINE,
    PARAMETER,
    expand,
    too_long,
    without_comment,
)
from camgen.lang.pacscript.plain import LINE, Plain, plain
from camgen.lang.pacscript.words import name_fault

from .motion import MOTIONS
from .words import TYPES

_OPENING = re.compile(r"(sub|function)\s+(\w+)\s*(?:\(([^()]*)\))?\s*(?:as\s+\w+)?", re.IGNORECASE)

#: A statement: its line, counted through all files, and its text without comment and macros.
Statement = tuple[int, str] | Plain


@dataclass(frozen=True, slots=True)
class Procedure:
    """A Sub or Function.

    line: line of its declaration.
    parameters: types of the parameters by name, in lower case.
    statements: statements of the procedure.
    """

    line: int
    parameters: Mapping[str, str]
    statements: list[Statement]


@dataclass(slots=True)
class SourceText:
    """The procedures by lower-case name, and the log for the text around them."""

    log: Log
    procedures: dict[str, Procedure] = field(default_factory=dict)


def read_source(files: Mapping[str, str], log: Log, short: bool) -> SourceText:
    """Reads all files in order.

    `Main` of a file after the first has the name of the file, by which `Call` calls it.
    short: whether motions in the usual spelling become `Plain`.
    """
    source = SourceText(log)
    line = 0
    for index, (name, text) in enumerate(files.items()):
        pieces = MOTIONS.cut(text) if short else [text]
        line = _read_file(pieces, line, PurePath(name).stem.lower() if index else "main", source)
    if "main" not in source.procedures:
        source.log.find("refused", "there is no Sub Main", line=1)
    return source


@dataclass(slots=True)
class _Macros:
    """The macros of `#Define`.

    texts: texts by name in lower case.
    pattern: pattern of the names, None without macros.
    """

    texts: dict[str, str] = field(default_factory=dict)
    pattern: re.Pattern[str] | None = None


def _read_file(pieces: Iterable[Run | str], before: int, main: str, source: SourceText) -> int:
    """Reads a file. Returns the number of its last line.

    before: number of lines of the files before it.
    main: name of its procedure `Main`.
    """
    macros = _Macros()
    current: Procedure | None = None
    number, first, begun = before, 0, ""
    for piece in pieces:
        if isinstance(piece, str):
            text = piece
        else:
            text = piece.source.text
            has_macro = macros.pattern and macros.pattern.search(text)
            if current is not None and not begun and not has_macro:
                current.statements.extend(plain(piece, number + 1))
                number += len(piece)
                continue
        for row in LINE.findall(text):
            number += 1
            text = begun + _read_row(row.removesuffix("\n"), number, source)
            first = first if begun else number
            begun = text[:-1] if GOES_ON.search(text[-2:]) and len(text) < LONGEST_GROWN else ""
            if not begun:
                current = _read_statement(text, first, macros, current, main, source)
    if begun:
        source.log.find("refused", "the statement goes on after the last line", line=first)
    if current is not None:
        source.log.find("refused", "the procedure has no end", line=current.line)
    return number


def _read_row(row: str, number: int, source: SourceText) -> str:
    """A line without its comment."""
    if too_long(row):
        source.log.find("refused", f"a line of more than {LONGEST_LINE} bytes", line=number)
    text = without_comment(row)
    if row.rstrip().endswith(" _") and not text.endswith("_"):
        source.log.find(
            "unusual",
            "a comment that ends in _: the next line may be taken for a part of it",
            line=number,
        )
    return text


def _read_statement(
    text: str,
    number: int,
    macros: _Macros,
    current: Procedure | None,
    main: str,
    source: SourceText,
) -> Procedure | None:
    """Adds a statement of one or more lines. Returns the procedure of the next statement."""
    if text.startswith("#"):
        _directive(text, number, macros, source)
        return current
    if macros.pattern:
        text = _expand(text, number, macros, source)
    return _statement(text, number, current, main, source) if text else current


def _statement(
    text: str, number: int, current: Procedure | None, main: str, source: SourceText
) -> Procedure | None:
    """Adds a statement. Returns the procedure of the next statement."""
    if CLOSING.fullmatch(text):
        if current is None:
            source.log.find("refused", f"{text} closes nothing", line=number)
        return None
    if opening := _OPENING.fullmatch(text):
        if current is not None:
            source.log.find("refused", f"{text} begins inside another procedure", line=number)
        return _open(opening, number, main, source)
    if current is None:
        source.log.find("refused", "a statement outside a procedure", line=number)
    else:
        current.statements.append((number, text))
    return current


def _directive(text: str, number: int, macros: _Macros, source: SourceText) -> None:
    if define := DEFINE.fullmatch(text):
        source.log.find("unusual", "#Define, which no program of the post has", line=number)
        _check_names(source, number, define[1])
        macros.texts[define[1].lower()] = define[2] or ""
        macros.pattern = re.compile(rf"\b(?:{'|'.join(macros.texts)})\b", re.IGNORECASE | re.ASCII)
    else:
        source.log.find("refused", f"{text.split(maxsplit=1)[0]} is not evaluated", line=number)


def _expand(text: str, number: int, macros: _Macros, source: SourceText) -> str:
    try:
        return expand(text, macros.texts)
    except ValueError as error:
        source.log.find("refused", str(error), line=number)
        return ""


def _check_names(source: SourceText, number: int, *names: str) -> None:
    """Adds findings for names that the language does not accept."""
    for name in names:
        if what := name_fault(name):
            source.log.find("refused", what, line=number)


def _open(opening: re.Match[str], number: int, main: str, source: SourceText) -> Procedure:
    given = opening[2].lower()
    name = main if given == "main" else given
    matches = [PARAMETER.fullmatch(p) for p in (opening[3] or "").split(",") if p.strip()]
    parameters = {m[2].lower(): (m[4] or "variant").lower() for m in matches if m and not m[3]}
    if len(parameters) < len(matches) or not TYPES.keys() >= set(parameters.values()):
        source.log.find("refused", "parameters that cannot be read", line=number)
        parameters = {
            name: kind if kind in TYPES else "variant" for name, kind in parameters.items()
        }
    _check_names(source, number, *(() if given == "main" else (opening[2],)), *parameters)
    if name == "main" and parameters:
        what = "Main has parameters, and nobody calls it with values"
        source.log.find("refused", what, line=number)
    procedure = Procedure(number, parameters, [])
    if name in source.procedures:
        source.log.find("refused", f"a second procedure {opening[2]}", line=number)
        return procedure
    source.procedures[name] = procedure
    return procedure
