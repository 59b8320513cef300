"""Parses V+ text into routines: lines, labels, comments, blocks and names.

The types of locations are here, too. Sources: V+ Language User's Guide (program structure, names of
at most 15 characters), as far as docs/posts/vplus.md quotes them.
"""

from __future__ import annotations

import math
import re
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from functools import lru_cache

from msgspec import Struct

from camgen.lang.code import Code
from camgen.lang.columns import Run, Source, Template
from camgen.lang.log import Log
from camgen.model.pose import IDENTITY, FloatArray, Pose, Vec3, frozen, translation

from .names import NAME, TAKEN, canonical

NULL = translation(0, 0, 0)


class Unreadable(Exception):
    """A statement that cannot be evaluated; the message says why."""


class Impossible(Unreadable):
    """A statement that is one of V+, and that its values make impossible."""


class Frame(Struct, frozen=True, eq=False, gc=False):
    """The frame of a location: the first component of a compound, or the base.

    pose: base_from_frame; without a meaning if the frame is external.
    external: name of a frame that is stored on the controller alone, empty for others.
    compound: the location is a compound, with this frame as its first component.
    name: variable that holds the frame, empty without one.
    shifted: name of the location of which an external frame is a SHIFT, empty for others.
    shift: mm of that SHIFT along the axes of the base.
    """

    pose: Pose = NULL
    external: str = ""
    compound: bool = False
    name: str = ""
    shifted: str = ""
    shift: Vec3 = (0.0, 0.0, 0.0)


#: Frame of locations that are not compounds.
BASE = Frame()


class Location(Struct, frozen=True, eq=False, gc=False):
    """A pose in a frame.

    local: frame_from_location.
    frame: frame in which `local` is given.
    name: variable that holds the location, empty without one.
    """

    local: Pose
    frame: Frame = BASE
    name: str = ""

    def in_base(self) -> Pose:
        """Return the pose in the base frame. Raises Unreadable if the frame is external."""
        if self.frame.external:
            raise Unreadable(f"location {self.frame.external} is only on the controller")
        return self.frame.pose @ self.local if self.frame.compound else self.local

    def moved(self, offset: Pose) -> Location:
        """Return the compound of the location and `offset`, a pose in the frame of the location."""
        return Location(self.local @ offset, self.frame)


@lru_cache(maxsize=4096)
def rotation_zyz(yaw: float, pitch: float, roll: float) -> FloatArray:
    """R = Rz(yaw) Ry(pitch) Rz(roll), (3, 3); angles in degrees.

    Cached, since most targets of a program have the same rotation.
    """
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


# The fast path: consecutive motions in one spelling, which make up most of a V+ program.

#: A number of JSON, whose reader is several times as fast as `float`. Both give the same value,
#: except for the sign of -0.
_NUMBER = r"(?:-?[1-9][0-9]{0,8}+|0|-0(?=\.))(?:\.[0-9]{1,9}+)?"
_THREE = f"{_NUMBER},{_NUMBER},{_NUMBER}"
_SPEED_PARTS = re.compile(rf"({_NUMBER})(?:, ({_NUMBER}))?( MMPS)?( ALWAYS)?")
#: A line with its line end.
LINE = re.compile(r"[^\r\n]*+(?:\r\n|\r|\n)|[^\r\n]++")


@lru_cache(maxsize=1024)
def _parse_rotation(turn: str) -> FloatArray:
    return rotation_zyz(*map(float, turn.split(",")))


#: Motions to `name:TRANS(place,turn)`; `turn` is yaw,pitch,roll.
MOTIONS = Template(
    r" *(?P<head>MOVES? [A-Za-z][A-Za-z0-9._]*)"
    rf":TRANS\((?P<place>{_THREE}),(?P<turn>{_THREE})\)\r?\n",
    places=("place",),
    words={"turn": _parse_rotation},
    alike=("head",),
)


class Stretch(Struct, frozen=True, gc=False):
    """Motions to `name:TRANS(..)` in consecutive lines.

    line: 1-based line of the first motion.
    word: MOVE or MOVES.
    name: variable of the frame.
    poses: targets in that frame.
    source: text of the lines.
    """

    line: int
    word: str
    name: str
    poses: tuple[Pose, ...]
    source: Source


#: A SPEED: its value, its unit (%, mm/s or MONITOR) and the rotational speed in %.
SpeedSetting = tuple[float, str, float]


def parse_plain_speed(rest: str) -> tuple[float, str, float, bool] | None:
    """Parse a SPEED of plain numbers as an expression does. None for other spellings."""
    match = _SPEED_PARTS.fullmatch(rest)
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
#: Sections that a file may have besides programs.
SECTIONS = frozenset({".LOCATIONS", ".REALS", ".DOUBLES", ".STRINGS"})
#: A line up to its comment, or to a string that does not end.
_CODE = re.compile(r'(?:"[^"]*"|[^";])*+')
_STRING = re.compile(r'"[^"]*"')
_DECLARE = frozenset({"AUTO", "LOCAL", "GLOBAL"})
#: Maximum number of different lines whose statement is cached for lines that are repeated.
_REMEMBERED = 4096


class Statement(Struct, frozen=True, gc=False):
    """One instruction.

    line: its line, counted from 1 through all files.
    word: its first word in capitals, = for an assignment.
    rest: text after the word; the whole text of an assignment.
    """

    line: int
    word: str
    rest: str


@dataclass(slots=True)
class Routine:
    """One `.PROGRAM`.

    name: name as it is spelled.
    line: line of the .PROGRAM.
    arguments: text between its brackets.
    statements: instructions in order.
    labels: index of the statement after each label, by the label.
    code: its steps, empty until it is compiled.
    """

    name: str
    line: int
    arguments: str
    statements: list[Statement | Stretch] = field(default_factory=list)
    labels: dict[int, int] = field(default_factory=dict)
    code: Code = field(default_factory=lambda: Code([]))


@dataclass(slots=True)
class _File:
    """A file while it is read.

    log: takes the findings; `report` counts the faults.
    strict: the file is for the read-back, which accepts only the spelling of the post.
    name: name of the program of a text without a .PROGRAM line, empty for others.
    data: line, section and text of the lines in other sections.
    reports: number of faults so far.
    routines: programs so far.
    current: program of the present line, None outside.
    section: other section of the present line, empty outside.
    long_names: names of 15 characters and more, by their first 15 characters.
    usual: word and rest of lines without a fault, by the line.
    """

    log: Log
    strict: bool
    name: str = ""
    data: list[tuple[int, str, str]] = field(default_factory=list)
    reports: int = 0
    routines: list[Routine] = field(default_factory=list)
    current: Routine | None = None
    section: str = ""
    long_names: dict[str, str] = field(default_factory=dict)
    usual: dict[str, tuple[str, str]] = field(default_factory=dict)

    def report(self, line: int, what: str) -> None:
        self.reports += 1
        self.log.find("refused", what, line=line)

    def remark(self, line: int, what: str) -> None:
        self.log.find("unusual", what, line=line)


def parse_files(
    files: Mapping[str, str], log: Log, data_files: Collection[str] = (), strict: bool = False
) -> tuple[list[Routine], list[tuple[int, str, str]]]:
    """Return all programs in order, and line, section and text of the lines of other sections.

    data_files: names of files that hold data alone. Their lines count in the line numbers.
    strict: accept only the spelling of the post.
    """
    routines: list[Routine] = []
    data: list[tuple[int, str, str]] = []
    number = 1
    for name, text in files.items():
        if name in data_files:
            number += len(text.splitlines())
            continue
        file = _File(log, strict)
        if not strict and not _HAS_PROGRAM.search(text):
            file.name = _STEM.sub("_", name.rpartition("/")[2].partition(".")[0]) or "main"
        number = _parse_file(text, number, file)
        routines += file.routines
        data += file.data
    names = set()
    for routine in routines:
        key = canonical(routine.name)
        if key in names:
            log.find("refused", f"program {routine.name} is there twice", line=routine.line)
        names.add(key)
    return routines, data


def _parse_file(text: str, number: int, file: _File) -> int:
    """Parse a file from line `number` on. Returns the number of the first line of the next file."""
    for piece in MOTIONS.cut(text):
        if isinstance(piece, Run):
            number = _add_stretch(piece, number, file)
            continue
        for raw in LINE.findall(piece):
            usual = file.usual.get(raw)
            if usual is not None and file.current is not None:
                file.current.statements.append(Statement(number, *usual))
            else:
                _parse_line(raw, number, file)
            number += 1
    if file.current is not None or file.section:
        name = file.current.name if file.current is not None else file.section
        report = file.report if file.strict else file.remark
        if file.current is None or not file.name:
            report(number - 1, f"{name} has no .END")
    return number


def _add_stretch(run: Run, line: int, file: _File) -> int:
    """Add consecutive motions from a line on. Returns the number of the line after them."""
    word, spelling = run["head"][0].split()
    name = spelling.lower()
    known = name if len(name) < NAME else file.long_names.get(name[:NAME])
    if file.current is None or known != name:
        for number, raw in enumerate(run.source.text.splitlines(), start=line):
            _parse_line(raw, number, file)
    else:
        poses = tuple(map(Pose, run["turn"], run["place"]))
        file.current.statements.append(Stretch(line, word, spelling, poses, run.source))
    return line + len(run)


def _parse_line(raw: str, number: int, file: _File) -> None:
    reports_before = file.reports
    code = _strip_comment(raw, number, file)
    for name in _LONG_NAME.findall(_STRING.sub("", code) if '"' in code else code):
        _check_long_name(name.lower(), number, file)
    if not code:
        return
    if file.section in SECTIONS and not file.strict and not code.upper().startswith(".END"):
        file.data.append((number, file.section, code))
    elif code[0] == ".":
        if file.current is not None and not code.upper().startswith(".END"):
            file.report(number, f"{code.split()[0]} before the .END of {file.current.name}")
        file.current, file.section = _parse_dot_line(code, number, file)
        if file.current is not None:
            file.routines.append(file.current)
    elif file.current is not None:
        usual = _add_statement(file.current, code, number, file)
        # A declaration is wrong after the first instruction; other lines mean the same everywhere.
        if (
            usual
            and usual[0] not in _DECLARE
            and file.reports == reports_before
            and len(file.usual) < _REMEMBERED
        ):
            file.usual[raw] = usual
    else:
        _parse_outside(code, number, file)


def _parse_outside(code: str, number: int, file: _File) -> None:
    if file.name and not file.routines:
        file.report(number, f"the text has no .PROGRAM line: taken for a program {file.name}")
        file.current = Routine(file.name, number, "")
        file.routines.append(file.current)
        _add_statement(file.current, code, number, file)
    elif not file.section:
        file.report(number, "an instruction outside of a .PROGRAM")


def _strip_comment(raw: str, number: int, file: _File) -> str:
    if not raw.isascii() and file.strict:
        file.report(number, "a character that is not ASCII")
    if "\x1a" in raw:  # end mark of a file on a disk of the controller
        raw = raw.replace("\x1a", "")
    if '"' not in raw:
        return raw.partition(";")[0].strip()
    code = _CODE.match(raw)
    assert code is not None
    if raw[code.end() :].startswith('"'):
        file.report(number, "a string that does not end")
        return raw.strip()
    return code[0].strip()


def _check_long_name(name: str, number: int, file: _File) -> None:
    if len(name) > NAME and name[:NAME] not in file.long_names:
        file.remark(
            number, f"{name} is longer than {NAME} characters, of which V+ ignores the rest"
        )
    other = file.long_names.setdefault(name[:NAME], name)
    if other != name:
        file.report(number, f"{name} and {other} are one name: only {NAME} characters count")


def _parse_dot_line(code: str, number: int, file: _File) -> tuple[Routine | None, str]:
    """Return the routine and the other section that are open after a line with a dot."""
    word, rest = (*code.split(None, 1), "")[:2]
    word = word.upper()
    if word == ".END":
        if file.current is None and not file.section:
            file.report(number, ".END without .PROGRAM")
        if rest:
            file.remark(number, f"{rest[:20]!r} after .END, of which V+ reads no more")
        return None, ""
    if word == ".PROGRAM":
        header = (_HEADER if file.strict else _BARE_HEADER).fullmatch(rest.strip())
        if header is None:
            file.report(number, "a .PROGRAM line is .PROGRAM name(arguments)")
            return Routine("", number, ""), ""
        if header[1].upper() in TAKEN and file.strict:
            file.report(number, f"{header[1]} is a word of V+, not the name of a program")
        arguments = (header[2] or "").strip()
        value = next((part.strip() for part in arguments.split(",") if _VALUE.match(part)), "")
        if value:
            file.report(number, f"{value[:20]} is a value, where the name of a variable belongs")
        return Routine(header[1], number, arguments), ""
    if word in SECTIONS and not file.strict:
        return None, word
    file.report(number, f"{word} is not evaluated")
    return None, word


def _add_statement(routine: Routine, code: str, number: int, file: _File) -> tuple[str, str] | None:
    """Add a statement. Returns its word and the rest; None without a statement or with a label."""
    label = _LABEL.match(code)
    if label:
        if len(label[1]) > 5 or int(label[1]) > 65535:
            file.report(number, f"label {label[1][:12]} is above 65535")
        elif int(label[1]) in routine.labels:
            file.report(number, f"label {int(label[1])} is there twice")
        else:
            routine.labels[int(label[1])] = len(routine.statements)
        code = code[label.end() :]
        if not code:
            return None
    match = _WORD.fullmatch(code)
    if match is None:
        file.report(number, f"unknown statement {code[:40]!r:.100}")
        return None
    word, rest = match[1], match[2]
    if rest[:1] == "=":
        word, rest = "=", f"{word} {rest}"
    elif rest[:1] == "[" and _ELEMENT.match(rest):
        word, rest = "=", f"{word}{rest}"
    word = word.upper()
    if word in _DECLARE and any(s.word not in _DECLARE for s in routine.statements):
        file.report(number, f"{word} after the first instruction")
    routine.statements.append(Statement(number, word, rest))
    return None if label else (word, rest)
