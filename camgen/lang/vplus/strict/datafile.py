"""Reads a V+ program with a data file of motions (`points = "file"`) back.

The module is written from docs/posts/vplus.md. The program is compared word by word with `_HEAD`
and `_READER`. The records of the data file are then converted to the lines of a plain program,
which the read-back of plain programs judges.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from itertools import repeat
from typing import NamedTuple

from msgspec.structs import replace

from camgen.lang.programs import Executed, Finding

_HEAD = """\
.PROGRAM <name>()
AUTO <tool>, <work>
AUTO REAL cg.lun, cg.pass, cg.n, cg.sum, cg.kind, cg.stop
AUTO REAL cg.a, cg.b, cg.c, cg.d, cg.e, cg.f, cg.check
SELECT ROBOT = 1
ATTACH ()
ENABLE CP
ACCEL (<profile>) <accel>, <accel>
SET <tool> = TRANS(<tool.pose>)
TOOL <tool>
SET <work> = TRANS(<work.pose>)
"""
#: Lines of the head that only a program has that declares tool and work frame.
_DECLARED = (1, 8, 10)
_READER = """\
ATTACH (cg.lun, 4) "DISK"
IF IOSTAT(cg.lun) < 0 THEN
GOTO 100
END
cg.pass = 1
WHILE cg.pass <= 2 DO
FOPENR (cg.lun) <file>
IF IOSTAT(cg.lun) < 0 THEN
GOTO 100
END
READ (cg.lun) cg.a, cg.b, cg.c, cg.d
IF IOSTAT(cg.lun) < 0 THEN
GOTO 100
END
IF (cg.a <> 1) OR (cg.b <> <one>) THEN
GOTO 100
END
IF (cg.c <> <two>) OR (cg.d <> <count>) THEN
GOTO 100
END
cg.sum = cg.b MOD 65521
cg.n = 1
WHILE cg.n <= <count> DO
READ (cg.lun) cg.kind, cg.stop, cg.a, cg.b, cg.c, cg.d, cg.e, cg.f, cg.check
IF IOSTAT(cg.lun) < 0 THEN
GOTO 100
END
cg.sum = (31*cg.sum+((cg.kind+8388608) MOD 65521)) MOD 65521
cg.sum = (31*cg.sum+((cg.stop+8388608) MOD 65521)) MOD 65521
cg.sum = (31*cg.sum+((cg.a+8388608) MOD 65521)) MOD 65521
cg.sum = (31*cg.sum+((cg.b+8388608) MOD 65521)) MOD 65521
cg.sum = (31*cg.sum+((cg.c+8388608) MOD 65521)) MOD 65521
cg.sum = (31*cg.sum+((cg.d+8388608) MOD 65521)) MOD 65521
cg.sum = (31*cg.sum+((cg.e+8388608) MOD 65521)) MOD 65521
cg.sum = (31*cg.sum+((cg.f+8388608) MOD 65521)) MOD 65521
IF cg.sum <> cg.check THEN
GOTO 100
END
IF cg.pass == 2 THEN
CASE cg.kind OF
VALUE 1:
MOVES <work>:TRANS(cg.a/1000,cg.b/1000,cg.c/1000,cg.d/10000,cg.e/10000,cg.f/10000)
VALUE 2:
MOVE <work>:TRANS(cg.a/1000,cg.b/1000,cg.c/1000,cg.d/10000,cg.e/10000,cg.f/10000)
VALUE 3:
MOVE #PPOINT(cg.a/10000,cg.b/10000,cg.c/1000+cg.e/100000,cg.d/10000)
VALUE 4:
MOVE #PPOINT(cg.a/10000,cg.b/10000,cg.c/10000,cg.d/10000,cg.e/10000,cg.f/10000)
VALUE 5:
SPEED cg.a+cg.b/10000 ALWAYS
VALUE 6:
SPEED cg.a+cg.b/10000, cg.c+cg.d/10000 MMPS ALWAYS
VALUE 7:
SIGNAL cg.a
VALUE 8:
WAIT.EVENT , cg.a+cg.b/1000
VALUE 11:
LEFTY
VALUE 12:
RIGHTY
VALUE 13:
ABOVE
VALUE 14:
BELOW
VALUE 15:
FLIP
VALUE 16:
NOFLIP
VALUE 17:
SINGLE
VALUE 18:
MULTIPLE
ANY
GOTO 100
END
IF cg.stop == 1 THEN
BREAK
END
END
cg.n = cg.n+1
END
FCLOSE (cg.lun)
cg.pass = cg.pass+1
END
DETACH (cg.lun)
DETACH ()
RETURN
100
BREAK
<signals>
TYPE "the data file is missing, damaged or of another job: stopped"
FCLOSE (cg.lun)
DETACH (cg.lun)
DETACH ()
STOP
.END
"""
_TOKEN = re.compile(
    r'"[^"]*"|\d+(?:\.\d+)?|[.$#]?[A-Za-z][A-Za-z0-9._]*|<[a-z]+(?:\.pose)?>|<>|<=|==|\S'
)
_SWITCHED_OFF = re.compile(r"SIGNAL - (\d+)", re.IGNORECASE)
_SLOT = re.compile(r"<([a-z]+)(\.pose)?>")
_REAL = r"(?:- )?\d+(?:\.\d+)?"
_POSE = rf"{_REAL}(?: , {_REAL}){{5}}"
#: Pattern of the text of a slot: a name, whole numbers, a file.
_FILLS = {
    "name": r"[A-Za-z][A-Za-z0-9._]*",
    "file": r'"[^"]+"',
    "one": r"\d+",
    "two": r"\d+",
    "count": r"\d+",
}
_FIRST = re.compile(r"1,(0|[1-9]\d*),(0|[1-9]\d*),(0|[1-9]\d*)")
_RECORD = re.compile(r"(?:-?[1-9]\d{0,6}|0)(?:,(?:-?[1-9]\d{0,6}|0)){8}")
_LARGEST, _SHIFT, _PRIME, _FACTOR = 2**23 - 1, 2**23, 65521, 31
_SIGNAL = 7
#: Count of numbers that a record uses, by its kind.
_USED = {1: 6, 2: 6, 3: 5, 4: 6, 5: 2, 6: 4, 7: 1, 8: 2}
#: Positions of numbers that are the fraction of another one, and their limits, by kind.
_FRACTIONS = {3: slice(4, 5), 5: slice(1, None, 2), 6: slice(1, None, 2), 8: slice(1, None, 2)}
_FRACTION_LIMITS = {3: 100, 8: 1000}
_WORDS = ("LEFTY", "RIGHTY", "ABOVE", "BELOW", "FLIP", "NOFLIP", "SINGLE", "MULTIPLE")


class _Wrong(Exception):
    """Raised with the line, from 1 through both files, and the reason if a text is not valid."""


class _Statement(NamedTuple):
    """A line without its comment.

    line: line, from 1.
    words: words of the line with blanks between them.
    """

    line: int
    words: str


class _Program(NamedTuple):
    """The program that reads a data file.

    slots: texts of the slots by name.
    head: lines before the reader, as written.
    outputs_off: outputs that are switched off after an error.
    file_line: line of FOPENR.
    lines: number of lines.
    """

    slots: Mapping[str, str]
    head: Sequence[str]
    outputs_off: tuple[int, ...]
    file_line: int
    lines: int


Plain = Callable[[Mapping[str, str], Mapping[str, object]], Executed]


def read_data(files: Mapping[str, str], options: Mapping[str, object], plain: Plain) -> Executed:
    """Reads a program and its data file back.

    plain: reads a V+ program without a data file back.
    """
    try:
        program = _match(next(iter(files.values()), ""), options)
        name = program.slots["file"].strip('"')
        if list(files)[1:] != [name]:
            given = ", ".join(list(files)[1:]) or "no data file"
            what = f"the program reads {name}: give it that file, not {given}"
            raise _Wrong(program.file_line, what)
        text, origins = _write_out(program, files[name], str(options.get("work", "cg.work")))
    except _Wrong as wrong:
        line, what = wrong.args
        return Executed((), (), findings=(Finding("refused", line, what),))
    executed = plain({name: text}, {**options, "points": "program"})
    findings = []
    for finding in executed.findings:
        line = min(finding.line, len(origins))
        findings.append(replace(finding, line=origins[line - 1]))
    lines = tuple(origins[line - 1] for line in executed.lines)
    return replace(executed, lines=lines, findings=tuple(findings))


def _statements(text: str) -> list[_Statement]:
    statements = []
    for number, raw in enumerate(text.split("\n"), start=1):
        if re.search(r"[^\t -~]", raw):
            raise _Wrong(number, "a character that is not printable ASCII")
        code = re.match(r'(?:"[^"]*"|[^";])*', raw)
        assert code is not None
        if raw[code.end() :][:1] not in ("", ";"):
            raise _Wrong(number, "a string that does not end")
        words = _TOKEN.findall(code[0])
        if words:
            statements.append(_Statement(number, " ".join(words)))
    return statements


def _match(text: str, options: Mapping[str, object]) -> _Program:
    """Compares a program with the reader, word by word. Raises _Wrong at a difference."""
    statements = _statements(text)
    lines = text.count("\n") + (not text.endswith("\n"))
    wanted = _wanted(options)
    slots: dict[str, str] = {}
    outputs_off: list[int] = []
    file_line, index = 1, 0
    for pattern in wanted:
        if pattern is None:
            while index < len(statements):
                signal = _SWITCHED_OFF.fullmatch(statements[index].words)
                if signal is None:
                    break
                outputs_off.append(int(signal[1]))
                index += 1
            continue
        statement = statements[index] if index < len(statements) else _Statement(lines, "")
        match = pattern.fullmatch(statement.words)
        texts = match.groupdict() if match else {}
        # A slot has the same text everywhere.
        if not match or any(slots.setdefault(name, text) != text for name, text in texts.items()):
            words = statement.words[:60] or "nothing"
            raise _Wrong(statement.line, f"not the reader of a data file: {words}")
        file_line = statement.line if "file" in texts else file_line
        index += 1
    if index < len(statements):
        statement = statements[index]
        raise _Wrong(statement.line, f"{statement.words[:60]} after the reader of a data file")
    raw = text.split("\n")
    # The plain program does not have the variables of the reader.
    reader_lines = [s.line for s in statements if s.words.upper().startswith("ATTACH ( CG")]
    head = raw[: reader_lines[0] - 1]
    head = ["" if re.match(r"\s*AUTO\s+REAL\b", line, re.IGNORECASE) else line for line in head]
    return _Program(slots, head, tuple(outputs_off), file_line, lines)


def _wanted(options: Mapping[str, object]) -> list[re.Pattern[str] | None]:
    """The lines of the program as patterns, None for its outputs."""
    fills = dict(_FILLS)
    for key, usual in (("tool", "cg.tool"), ("work", "cg.work")):
        fills[key] = re.escape(str(options.get(key, usual)))
    head = _HEAD.splitlines()
    if not options.get("declare", True):
        head = [line for k, line in enumerate(head) if k not in _DECLARED]
    return [
        None if line == "<signals>" else _pattern(line, fills)
        for line in (*head, *_READER.splitlines())
    ]


def _pattern(line: str, fills: Mapping[str, str]) -> re.Pattern[str]:
    """The pattern of a line of the reader. Only strings are case-sensitive."""
    parts = []
    for word in _TOKEN.findall(line):
        slot = _SLOT.fullmatch(word)
        if slot is None:
            parts.append(re.escape(word) if word[0] == '"' else f"(?i:{re.escape(word)})")
        elif slot[2]:
            parts.append(_POSE)
        elif slot[1] in ("tool", "work"):
            parts.append(f"(?i:{fills[slot[1]]})")
        elif slot[1] in ("profile", "accel"):
            parts.append(_REAL)  # judged by the read-back of plain programs
        else:
            parts.append(f"(?P<{slot[1]}>{fills[slot[1]]})")
    return re.compile(" ".join(parts))


def _write_out(program: _Program, data: str, work: str) -> tuple[str, list[int]]:
    """The plain program, and the line of origin of each of its lines. Raises _Wrong."""
    first, *records = data.split("\n")
    if not records or records.pop():
        raise _Wrong(program.lines + data.count("\n") + 1, "the data end within a line")
    head = _FIRST.fullmatch(first)
    expected = tuple(program.slots[key] for key in ("one", "two", "count"))
    if head is None or head.groups() != expected:
        what = f"the data of another program: {first[:40]}, not 1,{','.join(expected)}"
        raise _Wrong(program.lines + 1, what)
    if len(records) != int(expected[2]):
        last = program.lines + 1 + len(records)
        raise _Wrong(last, f"the program reads {expected[2]} records, here are {len(records)}")
    lines = list(program.head)
    origins = list(range(1, len(lines) + 1))
    total, outputs = int(expected[0]) % _PRIME, set()
    for number, record in enumerate(records, start=program.lines + 2):
        values, total = _take(record, total, number)
        if values[0] == _SIGNAL:
            outputs.add(abs(values[2]))
        try:
            record_lines = _format_record(values, work)
        except ValueError as error:
            raise _Wrong(number, f"{error}: {record}") from None
        lines += record_lines
        origins += [number] * len(record_lines)
    if program.outputs_off != tuple(sorted(outputs)):
        what = "the outputs that are put off after an error are not those of the data"
        raise _Wrong(program.file_line, what)
    end = ["DETACH ()", "RETURN", ".END"]
    origins += [program.lines + len(records) + 1] * len(end)
    return "\n".join((*lines, *end)) + "\n", origins


def _take(record: str, total: int, line: int) -> tuple[list[int], int]:
    """The numbers of a record, and the check sum up to it. Raises _Wrong if they do not agree."""
    if not _RECORD.fullmatch(record):
        raise _Wrong(line, f"not a record of nine whole numbers: {record[:60]}")
    *values, check = map(int, record.split(","))
    if max(map(abs, values)) > _LARGEST:
        raise _Wrong(line, f"a number above {_LARGEST}: {record[:60]}")
    for value in values:
        total = (_FACTOR * total + (value + _SHIFT) % _PRIME) % _PRIME
    if check != total:
        raise _Wrong(line, f"the check is {check}, not {total}: {record}")
    return values, total


def _format_record(values: Sequence[int], work: str) -> list[str]:
    """The lines of a program for a record. Raises ValueError for one that no post writes."""
    kind, stop, *rest = values
    used = _USED.get(kind, 0)
    if kind not in (*range(1, 9), *range(11, 19)) or any(rest[used:]):
        raise ValueError("no such record")
    if stop not in (0, 1) or (stop and kind > 4):
        raise ValueError("an invalid stop")
    if kind >= 11:
        return [_WORDS[kind - 11]]
    fractions = rest[_FRACTIONS[kind]] if kind in _FRACTIONS else []
    limit = _FRACTION_LIMITS.get(kind, 10_000)
    if any(not 0 <= fraction < limit for fraction in fractions):
        raise ValueError("an invalid fraction")
    return [_KINDS[kind](rest, work), *(["BREAK"] if stop else [])]


def _real(value: int, digits: int) -> str:
    """`value` 10^-digits in the spelling of V+."""
    text = f"{abs(value):0{digits + 1}d}"
    return f"{'-' if value < 0 else ''}{text[:-digits]}.{text[-digits:]}"


def _pose(v: Sequence[int], work: str) -> str:
    numbers = [*map(_real, v[:3], repeat(3)), *map(_real, v[3:], repeat(4))]
    return f"{work}:TRANS({','.join(numbers)})"


def _point(*values: str) -> str:
    return f"MOVE #PPOINT({', '.join(values)})"


def _pair(whole: int, part: int) -> str:
    return f"{whole}.{part:04d}"


_KINDS: Mapping[int, Callable[[Sequence[int], str], str]] = {
    1: lambda v, work: f"MOVES {_pose(v, work)}",
    2: lambda v, work: f"MOVE {_pose(v, work)}",
    3: lambda v, _: _point(
        _real(v[0], 4), _real(v[1], 4), _real(100 * v[2] + v[4], 5), _real(v[3], 4)
    ),
    4: lambda v, _: _point(*map(_real, v, repeat(4))),
    5: lambda v, _: f"SPEED {_pair(v[0], v[1])} ALWAYS",
    6: lambda v, _: f"SPEED {_pair(v[0], v[1])}, {_pair(v[2], v[3])} MMPS ALWAYS",
    7: lambda v, _: f"SIGNAL {v[0]}",
    8: lambda v, _: f"WAIT.EVENT , {v[0]}.{v[1]:03d}",
}
