"""V+ text as routines: lines, labels, comments, blocks, names, and the locations that stand in it.

Sources: V+ Language User's Guide (program structure, names of at most 15 characters), as far as docs/posts/vplus.md
quotes them.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field
from functools import lru_cache

from msgspec import Struct

from camgen.lang.columns import Run, Source, Template
from camgen.model.pose import IDENTITY, FloatArray, Pose, Vec3, frozen, translation

from .names import NAME, TAKEN, canonical

# V+ locations: what is given in what.

NULL = translation(0, 0, 0)


class Unreadable(Exception):
    """A statement that cannot be evaluated; the message says why."""


class Impossible(Unreadable):
    """A statement that is one of V+, and that its values make impossible."""


class Frame(Struct, frozen=True, eq=False, gc=False):
    """What a location is given in, the first component of a compound. external: the name of that component where only
    the controller knows it; then ``pose`` means nothing. name: of the component, where it is a variable. of, by: what
    an external one is a SHIFT of, and by how many mm along the axes of the base.
    """

    pose: Pose = NULL
    external: str = ""
    compound: bool = False
    name: str = ""
    of: str = ""
    by: Vec3 = (0.0, 0.0, 0.0)


#: The frame of what is no compound.
BASE = Frame()


class Location(Struct, frozen=True, eq=False, gc=False):
    """``local`` in ``frame``. name: of the variable that holds it."""

    local: Pose
    frame: Frame = BASE
    name: str = ""

    def in_base(self) -> Pose:
        """The location in the base frame."""
        if self.frame.external:
            raise Unreadable(f"location {self.frame.external} is only on the controller")
        return self.frame.pose @ self.local if self.frame.compound else self.local

    def moved(self, by: Pose) -> Location:
        """The location compounded with ``by`` on its right."""
        return Location(self.local @ by, self.frame)


@lru_cache(maxsize=4096)
def rotation_zyz(yaw: float, pitch: float, roll: float) -> FloatArray:
    """R = Rz(yaw) Ry(pitch) Rz(roll), angles in degrees. Most targets of a program share theirs, hence the cache."""
    if not (yaw or pitch or roll):
        return IDENTITY
    a, b, c = math.radians(yaw), math.radians(pitch), math.radians(roll)
    ca, sa, cb, sb, cc, sc = (
        math.cos(a),
        math.sin(a),
        math.cos(b),
        math.sin(b),
        math.cos(c),
        math.sin(c),
    )
    return frozen(
        [
            [ca * cb * cc - sa * sc, -ca * cb * sc - sa * cc, ca * sb],
            [sa * cb * cc + ca * sc, -sa * cb * sc + ca * cc, sa * sb],
            [-sb * cc, sb * sc, cb],
        ]
    )


# Motions in lines that follow each other, all spelled alike: most of a V+ program.

#: As in JSON, whose reader is several times as fast as ``float`` and as exact, but for the sign of -0.
_NUMBER = r"(?:-?[1-9][0-9]{0,8}+|0|-0(?=\.))(?:\.[0-9]{1,9}+)?"
_THREE = f"{_NUMBER},{_NUMBER},{_NUMBER}"
_PACE_PARTS = re.compile(rf"({_NUMBER})(?:, ({_NUMBER}))?( MMPS)?( ALWAYS)?")
#: One line of any kind with its end.
LINE = re.compile(r"[^\r\n]*+(?:\r\n|\r|\n)|[^\r\n]++")


@lru_cache(maxsize=1024)
def _rotation(turn: str) -> FloatArray:
    """The rotation of ``yaw,pitch,roll``."""
    return rotation_zyz(*map(float, turn.split(",")))


#: Motions to ``name:TRANS(place,turn)``.
MOTIONS = Template(
    rf" *(?P<head>MOVES? [A-Za-z][A-Za-z0-9._]*):TRANS\((?P<place>{_THREE}),(?P<turn>{_THREE})\)\r?\n",
    places=("place",),
    words={"turn": _rotation},
    alike=("head",),
)


class Stretch(Struct, frozen=True, gc=False):
    """Motions to ``name:TRANS(..)`` in lines that follow each other.

    line: 1-based, of the first. word: MOVE or MOVES. poses: in the frame ``name``. source: the lines.
    """

    line: int
    word: str
    name: str
    poses: tuple[Pose, ...]
    source: Source


def stretch(run: Run, line: int) -> Stretch:
    """The motions of a run of ``MOTIONS`` that begins in line ``line``."""
    word, name = run["head"][0].split()
    return Stretch(line, word, name, tuple(map(Pose, run["turn"], run["place"])), run.source)


#: The speed of a SPEED, its unit (%, mm/s or MONITOR) and the rotational speed in %.
Pace = tuple[float, str, float]


def pace(rest: str) -> tuple[float, str, float, bool] | None:
    """What ``words.speed`` says of a SPEED without names; nothing where it has more to say."""
    match = _PACE_PARTS.fullmatch(rest)
    if match is None or float(match[1]) <= 0 or float(match[2] or 1.0) <= 0:
        return None
    return float(match[1]), "mm/s" if match[3] else "%", float(match[2] or 100.0), bool(match[4])


_LABEL = re.compile(r"\s*(\d+)(?:\s+|$)", re.ASCII)
_WORD = re.compile(r"\s*([#$]?[A-Za-z][A-Za-z0-9._]*)\s*(.*)", re.DOTALL)
_ELEMENT = re.compile(r"\[[^\"=]*\]\s*=(?!=)")
_LONG_NAME = re.compile(rf"[A-Za-z][A-Za-z0-9._]{{{NAME - 1},}}")
_HEADER = re.compile(r"([A-Za-z][A-Za-z0-9._]*)\s*\(([^()]*)\)\s*")
#: The list of arguments may be missing (User's Guide, program organization).
_BARE_HEADER = re.compile(r"([A-Za-z][A-Za-z0-9._]*)\s*(?:\(([^()]*)\))?\s*")
_VALUE = re.compile(r"\s*[-+.\d\"'(]")
_HAS_PROGRAM = re.compile(r"^\s*\.PROGRAM\b", re.IGNORECASE | re.MULTILINE)
_STEM = re.compile(r"[^A-Za-z0-9._]+")
_THEN = re.compile(r"\bTHEN\s*$", re.IGNORECASE)
_GOTO = re.compile(r"\bGOTO\b", re.IGNORECASE)
#: What a file may hold besides programs.
SECTIONS = frozenset({".LOCATIONS", ".REALS", ".DOUBLES", ".STRINGS"})
_LOOPS = frozenset({"FOR", "WHILE", "DO"})
#: Loops around an EXIT or a NEXT that can be meant.
_DEEPEST = 40
_A = {"IF": "an IF", "CASE": "a CASE"}
_ALONE = frozenset({"ELSE", "END", "ANY"})
_BRANCHES = {"ELSE": "IF", "VALUE": "CASE", "ANY": "CASE"}
_STRING = re.compile(r'"[^"]*"')
_DECLARE = frozenset({"AUTO", "LOCAL", "GLOBAL"})
#: Words that open a block which END closes, with the word that has to stand in the line, too.
_OPENS = {"IF": "THEN", "FOR": "", "WHILE": "", "CASE": ""}
#: So many different lines are remembered with what they say.
_REMEMBERED = 4096

Report = Callable[[int, str], None]


class Statement(Struct, frozen=True, gc=False):
    """One instruction: its line (1-based through all files), its first word in capitals, what follows the word."""

    line: int
    word: str
    rest: str


@dataclass(slots=True)
class Routine:
    """One ``.PROGRAM``. partner: by the index of an opening statement the index of its END (or UNTIL). opener: the
    other way round, and of ELSE, VALUE and ANY. branches: these by the index of their IF or CASE. loops: around EXIT
    and NEXT, from within. labels: the index of the statement behind each.
    """

    name: str
    line: int
    arguments: str
    statements: list[Statement | Stretch] = field(default_factory=list)
    partner: dict[int, int] = field(default_factory=dict)
    opener: dict[int, int] = field(default_factory=dict)
    branches: dict[int, list[int]] = field(default_factory=dict)
    loops: dict[int, tuple[int, ...]] = field(default_factory=dict)
    labels: dict[int, int] = field(default_factory=dict)


@dataclass(slots=True)
class _File:
    """A file while it is read. first: what its lines are counted from. reports: how often something was reported.

    long_names: by their first ``NAME`` characters. usual: word and rest by line, of lines with nothing to report.
    strict: as the read-back wants it, with no more than what the post writes. name: of a program that has no .PROGRAM
    line. data: what stands in other sections, by line.
    """

    first: int
    tell: Report
    remark: Report
    strict: bool = True
    name: str = ""
    data: list[tuple[int, str, str]] = field(default_factory=list)
    reports: int = 0
    found: list[Routine] = field(default_factory=list)
    current: Routine | None = None
    section: str = ""
    long_names: dict[str, str] = field(default_factory=dict)
    usual: dict[str, tuple[str, str]] = field(default_factory=dict)

    def report(self, line: int, what: str) -> None:
        """Passes it on."""
        self.reports += 1
        self.tell(line, what)


def routines(files: Mapping[str, str], report: Report, remark: Report) -> list[Routine]:
    """All programs of all files in order. What is no program, or no V+, is reported. remark: what V+ takes anyway."""
    found: list[Routine] = []
    number = 1
    for text in files.values():
        file = _File(number, report, remark)
        number = _read(text, file)
        found += file.found
    _match(found, report, None)
    return found


def read_files(
    files: Mapping[str, str], beside: Collection[str], report: Report, remark: Report
) -> tuple[list[Routine], list[tuple[int, str, str]]]:
    """The programs of foreign files, and the lines of their other sections: line, section, text. beside: the names of
    files that hold data, whose lines are counted.
    """
    found: list[Routine] = []
    data: list[tuple[int, str, str]] = []
    number = 1
    for name, text in files.items():
        if name in beside:
            number += len(text.splitlines())
            continue
        bare = (
            ""
            if _HAS_PROGRAM.search(text)
            else _STEM.sub("_", name.rpartition("/")[2].partition(".")[0]) or "main"
        )
        file = _File(number, report, remark, strict=False, name=bare)
        number = _read(text, file)
        found += file.found
        data += file.data
    _match(found, report, remark)
    return found, data


def _match(found: list[Routine], report: Report, remark: Report | None) -> None:
    """remark: for what is no more than odd; None: as strictly as the read-back wants it."""
    seen: dict[str, Routine] = {}
    for routine in found:
        if seen.setdefault(canonical(routine.name), routine) is not routine:
            report(routine.line, f"program {routine.name} is there twice")
        _Blocks(routine, report, remark).match()


def _read(text: str, file: _File) -> int:
    """Reads a file; returns the number that the first line of the next one has."""
    number = file.first
    for piece in MOTIONS.cut(text):
        if isinstance(piece, Run):
            number = _stretch(stretch(piece, number), file)
            continue
        for raw in LINE.findall(piece):
            usual = file.usual.get(raw)
            if usual is not None and file.current is not None:
                file.current.statements.append(Statement(number, *usual))
            else:
                _line(raw, number, file)
            number += 1
    if file.current is not None or file.section:
        name = file.current.name if file.current is not None else file.section
        tell = file.report if file.strict else file.remark
        if file.current is None or not file.name:
            tell(number - 1, f"{name} has no .END")
    return number


def _stretch(plain: Stretch, file: _File) -> int:
    """Reads a stretch; returns the number of the line after it."""
    name, after = plain.name.lower(), plain.line + len(plain.poses)
    known = name if len(name) < NAME else file.long_names.get(name[:NAME])
    if file.current is None or known != name:
        for number, raw in enumerate(plain.source.text.splitlines(), start=plain.line):
            _line(raw, number, file)
    else:
        file.current.statements.append(plain)
    return after


def _line(raw: str, number: int, file: _File) -> None:
    """Reads any line."""
    before = file.reports
    code = _code(raw, number, file.report, file.strict)
    for name in _LONG_NAME.findall(_STRING.sub("", code) if '"' in code else code):
        _check_long(name.lower(), number, file)
    if not code:
        return
    if file.section in SECTIONS and not file.strict and not code.upper().startswith(".END"):
        file.data.append((number, file.section, code))
    elif code[0] == ".":
        if file.current is not None and not code.upper().startswith(".END"):
            file.report(number, f"{code.split()[0]} before the .END of {file.current.name}")
        file.current, file.section = _dot(code, number, file)
        if file.current is not None:
            file.found.append(file.current)
    elif file.current is not None:
        said = _add(file.current, code, number, file.report)
        # A declaration may be wrong further down; all else means the same in every place.
        if (
            said
            and said[0] not in _DECLARE
            and file.reports == before
            and len(file.usual) < _REMEMBERED
        ):
            file.usual[raw] = said
    else:
        _outside(code, number, file)


def _outside(code: str, number: int, file: _File) -> None:
    """Reads a line that stands in no program."""
    if file.name and not file.found:
        file.report(number, f"the text has no .PROGRAM line: taken for a program {file.name}")
        file.current = Routine(file.name, number, "")
        file.found.append(file.current)
        _add(file.current, code, number, file.report)
    elif not file.section:
        file.report(number, "an instruction outside of a .PROGRAM")


def _code(raw: str, number: int, report: Report, strict: bool) -> str:
    """The line without its comment and outer blanks."""
    if not raw.isascii() and strict:
        report(number, "a character that is not ASCII")
    if "\x1a" in raw:  # the end of a file on a disk of the controller
        raw = raw.replace("\x1a", "")
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


def _check_long(name: str, number: int, file: _File) -> None:
    """A report on a long name that V+ takes for another one, a remark where it cuts one for the first time."""
    if len(name) > NAME and name[:NAME] not in file.long_names:
        file.remark(
            number, f"{name} is longer than {NAME} characters, of which V+ ignores the rest"
        )
    other = file.long_names.setdefault(name[:NAME], name)
    if other != name:
        file.report(number, f"{name} and {other} are one name: only {NAME} characters count")


def _dot(code: str, number: int, file: _File) -> tuple[Routine | None, str]:
    """The routine and the other section that are open after a line that starts with a dot."""
    report = file.report
    word, rest = (*code.split(None, 1), "")[:2]
    word = word.upper()
    if word == ".END":
        if file.current is None and not file.section:
            report(number, ".END without .PROGRAM")
        if rest:
            file.remark(number, f"{rest[:20]!r} after .END, of which V+ reads no more")
        return None, ""
    if word == ".PROGRAM":
        header = (_HEADER if file.strict else _BARE_HEADER).fullmatch(rest.strip())
        if header is None:
            report(number, "a .PROGRAM line is .PROGRAM name(arguments)")
            return Routine("", number, ""), ""
        if header[1].upper() in TAKEN and file.strict:
            report(number, f"{header[1]} is a word of V+, not the name of a program")
        arguments = (header[2] or "").strip()
        value = next((one.strip() for one in arguments.split(",") if _VALUE.match(one)), "")
        if value:
            report(number, f"{value[:20]} is a value, where the name of a variable belongs")
        return Routine(header[1], number, arguments), ""
    if word in SECTIONS and not file.strict:
        return None, word
    report(number, f"{word} is not evaluated")
    return None, word


def _add(routine: Routine, code: str, number: int, report: Report) -> tuple[str, str] | None:
    """Adds a statement; returns its word and what follows it, nothing where there is none or the line has a label."""
    label = _LABEL.match(code)
    if label:
        if len(label[1]) > 5 or int(label[1]) > 65535:
            report(number, f"label {label[1][:12]} is above 65535")
        elif int(label[1]) in routine.labels:
            report(number, f"label {int(label[1])} is there twice")
        else:
            routine.labels[int(label[1])] = len(routine.statements)
        code = code[label.end() :]
        if not code:
            return None
    match = _WORD.fullmatch(code)
    if match is None:
        report(number, f"unknown statement {code[:40]!r}")
        return None
    word, rest = match[1], match[2]
    if rest[:1] == "=":
        word, rest = "=", f"{word} {rest}"
    elif rest[:1] == "[" and _ELEMENT.match(rest):
        word, rest = "=", f"{word}{rest}"
    word = word.upper()
    if word in _DECLARE and any(s.word not in _DECLARE for s in routine.statements):
        report(number, f"{word} after the first instruction")
    routine.statements.append(Statement(number, word, rest))
    return None if label else (word, rest)


def one_by_one(plain: Stretch) -> list[Statement]:
    """The instructions of a stretch."""
    return [
        Statement(number, plain.word, raw.split()[1])
        for number, raw in enumerate(plain.source.text.splitlines(), start=plain.line)
    ]


class _Blocks:
    """The blocks of a program. remark: see ``_match``; the read-back evaluates no block but FOR."""

    def __init__(self, routine: Routine, report: Report, remark: Report | None) -> None:
        self._routine, self._report, self._remark, self._strict = (
            routine,
            report,
            remark,
            remark is None,
        )
        self._open: list[int] = []
        self._around: list[int] = []

    def match(self) -> None:
        """Finds what belongs together; what does not is reported."""
        for index, statement in enumerate(self._routine.statements):
            if isinstance(statement, Statement):
                self._see(index, statement)
        for index in self._open:
            opener = self._routine.statements[index]
            if isinstance(opener, Statement):
                self._report(opener.line, f"{opener.word} is not closed")

    def _see(self, index: int, statement: Statement) -> None:
        word, routine = statement.word, self._routine
        if self._remark is not None and word in _ALONE and statement.rest.strip(": "):
            tell = self._report if word == "ELSE" else self._remark
            tell(statement.line, f"{word} stands alone, without {statement.rest[:30]}")
        if self._opens(statement):
            self._open.append(index)
            if word in _LOOPS:
                self._around.append(index)
        elif word in ("END", "UNTIL"):
            opener = self._word(-1)
            if not opener or (opener == "DO") != (word == "UNTIL"):
                self._report(statement.line, f"{word} closes nothing")
            else:
                start = self._open.pop()
                if self._around and self._around[-1] == start:
                    self._around.pop()
                routine.partner[start], routine.opener[index] = index, start
        elif word in _BRANCHES and not self._strict:
            if self._word(-1) != _BRANCHES[word]:
                self._report(statement.line, f"{word} outside of {_A[_BRANCHES[word]]}")
            else:
                routine.branches.setdefault(self._open[-1], []).append(index)
                routine.opener[index] = self._open[-1]
        elif word in ("EXIT", "NEXT"):
            routine.loops[index] = tuple(reversed(self._around[-_DEEPEST:]))

    def _opens(self, statement: Statement) -> bool:
        word, rest = statement.word, statement.rest
        if word == "DO":
            return True
        if word == "IF" and not self._strict:
            then = _THEN.search(rest) is not None
            if not then and not _GOTO.search(rest):
                self._report(statement.line, "IF wants THEN or GOTO")
            return then or not _GOTO.search(rest)
        return word in _OPENS and _OPENS[word] in rest.upper()

    def _at(self, index: int) -> Statement:
        statement = self._routine.statements[index]
        assert isinstance(statement, Statement)
        return statement

    def _word(self, place: int) -> str:
        return self._at(self._open[place]).word if self._open else ""
