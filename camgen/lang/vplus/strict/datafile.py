"""A V+ program whose motions stand in a data file: the program must be the known reader, and the data are carried out
as it would. For the read-back ``vplus`` with ``points = "file"``.

Written from docs/posts/vplus.md. The reader is compared word by word with ``_HEAD`` and ``_READER``. The records are
then written out as the lines of a plain program, which the read-back of plain programs judges.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
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
#: Lines of the head that are only there where the program states tool and work frame.
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
_SLOT = re.compile(r"<([a-z]+)(\.pose)?>")
_REAL = r"(?:- )?\d+(?:\.\d+)?"
_POSE = rf"{_REAL}(?: , {_REAL}){{5}}"
#: What may stand in a slot: a name, whole numbers, a file.
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
_WORDS = ("LEFTY", "RIGHTY", "ABOVE", "BELOW", "FLIP", "NOFLIP", "SINGLE", "MULTIPLE")


class _Wrong(Exception):
    """The text is not what it has to be: the line (1-based through both files), and why."""


class _Statement(NamedTuple):
    """A line without its comment. words: with a blank between each two."""

    line: int
    words: str


class _Program(NamedTuple):
    """What the slots hold. head: the lines in front of the reader, as they stand. off: the outputs that are put off
    after an error. file_line: of FOPENR. lines: how many the program has.
    """

    slots: Mapping[str, str]
    head: Sequence[str]
    off: tuple[int, ...]
    file_line: int
    lines: int


Plain = Callable[[Mapping[str, str], Mapping[str, object]], Executed]


def read_data(files: Mapping[str, str], options: Mapping[str, object], plain: Plain) -> Executed:
    """What the reader and its data say. plain: reads a program of V+ without a data file."""
    try:
        program = _match(next(iter(files.values()), ""), options)
        name = program.slots["file"].strip('"')
        if list(files)[1:] != [name]:
            given = ", ".join(list(files)[1:]) or "no data file"
            raise _Wrong(
                program.file_line, f"the program reads {name}: give it that file, not {given}"
            )
        text, where = _write_out(program, files[name], str(options.get("work", "cg.work")))
    except _Wrong as wrong:
        line, what = wrong.args
        return Executed((), (), findings=(Finding("refused", line, what),))
    executed = plain({name: text}, {**options, "points": "program"})
    findings = tuple(
        replace(finding, line=where[min(finding.line, len(where)) - 1])
        for finding in executed.findings
    )
    lines = tuple(where[line - 1] for line in executed.lines)
    return replace(executed, lines=lines, findings=findings)


def _statements(text: str) -> list[_Statement]:
    found = []
    for number, raw in enumerate(text.split("\n"), start=1):
        if re.search(r"[^\t -~]", raw):
            raise _Wrong(number, "a character that is not printable ASCII")
        code = re.match(r'(?:"[^"]*"|[^";])*', raw)
        rest = raw[code.end() :] if code else raw
        if rest and rest[0] != ";":
            raise _Wrong(number, "a string that does not end")
        words = _TOKEN.findall(code[0] if code else "")
        if words:
            found.append(_Statement(number, " ".join(words)))
    return found


def _match(text: str, options: Mapping[str, object]) -> _Program:
    """The program against the reader, word by word."""
    said = _statements(text)
    lines = text.count("\n") + (not text.endswith("\n"))
    wanted = _wanted(options)
    slots: dict[str, str] = {}
    off: list[int] = []
    file_line, place = 1, 0
    for pattern in wanted:
        if pattern is None:
            while place < len(said) and (
                signal := re.fullmatch(r"SIGNAL - (\d+)", said[place].words, re.IGNORECASE)
            ):
                off.append(int(signal[1]))
                place += 1
            continue
        here = said[place] if place < len(said) else _Statement(lines, "")
        found = pattern.fullmatch(here.words)
        if not found or any(
            slots.setdefault(key, value) != value for key, value in found.groupdict().items()
        ):
            raise _Wrong(
                here.line, f"not the reader of a data file: {here.words[:60] or 'nothing'}"
            )
        file_line = here.line if "file" in found.groupdict() else file_line
        place += 1
    if place < len(said):
        raise _Wrong(said[place].line, f"{said[place].words[:60]} behind the reader of a data file")
    raw = text.split("\n")
    # The variables of the reader are not in the program without it.
    head = raw[: next(s.line for s in said if s.words.upper().startswith("ATTACH ( CG")) - 1]
    head = ["" if re.match(r"\s*AUTO\s+REAL\b", line, re.IGNORECASE) else line for line in head]
    return _Program(slots, head, tuple(off), file_line, lines)


def _wanted(options: Mapping[str, object]) -> list[re.Pattern[str] | None]:
    """The lines of the program as patterns; None stands for its outputs."""
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
    """A line of the reader; case counts in strings only."""
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
    """The plain program, and for each of its lines the line it comes from."""
    first, *records = data.split("\n")
    if not records or records.pop():
        raise _Wrong(program.lines + data.count("\n") + 1, "the data end within a line")
    head = _FIRST.fullmatch(first)
    asked = tuple(program.slots[key] for key in ("one", "two", "count"))
    if head is None or head.groups() != asked:
        raise _Wrong(
            program.lines + 1, f"the data of another program: {first[:40]}, not 1,{','.join(asked)}"
        )
    if len(records) != int(asked[2]):
        last = program.lines + 1 + len(records)
        raise _Wrong(last, f"the program reads {asked[2]} records, here are {len(records)}")
    lines = list(program.head)
    where = list(range(1, len(lines) + 1))
    total, outputs = int(asked[0]) % _PRIME, set()
    for number, record in enumerate(records, start=program.lines + 2):
        values, total = _take(record, total, number)
        if values[0] == _SIGNAL:
            outputs.add(abs(values[2]))
        try:
            said = _say(values, work)
        except ValueError as error:
            raise _Wrong(number, f"{error}: {record}") from None
        lines += said
        where += [number] * len(said)
    if program.off != tuple(sorted(outputs)):
        raise _Wrong(
            program.file_line,
            "the outputs that are put off after an error are not those of the data",
        )
    end = ["DETACH ()", "RETURN", ".END"]
    return "\n".join((*lines, *end)) + "\n", where + [program.lines + len(records) + 1] * len(end)


def _take(record: str, total: int, line: int) -> tuple[list[int], int]:
    """The numbers of a record and the check up to it."""
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


def _say(values: Sequence[int], work: str) -> list[str]:
    """A record as lines of a program. ValueError for what no post writes."""
    kind, stop, *rest = values
    used = {1: 6, 2: 6, 3: 5, 4: 6, 5: 2, 6: 4, 7: 1, 8: 2}.get(kind, 0)
    if kind not in (*range(1, 9), *range(11, 19)) or any(rest[used:]):
        raise ValueError("no such record")
    if stop not in (0, 1) or (stop and kind > 4):
        raise ValueError("a stop that is none")
    if kind >= 11:
        return [_WORDS[kind - 11]]
    parts = rest[4:5] if kind == 3 else rest[1::2] if kind in (5, 6, 8) else []
    most = {3: 100, 8: 1000}.get(kind, 10000)
    if any(not 0 <= part < most for part in parts):
        raise ValueError("a fraction that is none")
    return [_KINDS[kind](rest, work), *(["BREAK"] if stop else [])]


def _real(value: int, digits: int) -> str:
    """``value`` 10^-digits, as a V+ program says it."""
    text = f"{abs(value):0{digits + 1}d}"
    return f"{'-' if value < 0 else ''}{text[:-digits]}.{text[-digits:]}"


def _pose(v: Sequence[int], work: str) -> str:
    return (
        f"{work}:TRANS({','.join([*(_real(x, 3) for x in v[:3]), *(_real(a, 4) for a in v[3:])])})"
    )


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
    4: lambda v, _: _point(*(_real(x, 4) for x in v)),
    5: lambda v, _: f"SPEED {_pair(v[0], v[1])} ALWAYS",
    6: lambda v, _: f"SPEED {_pair(v[0], v[1])}, {_pair(v[2], v[3])} MMPS ALWAYS",
    7: lambda v, _: f"SIGNAL {v[0]}",
    8: lambda v, _: f"WAIT.EVENT , {v[0]}.{v[1]:03d}",
}
