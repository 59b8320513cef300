"""Logical units of V+: devices, and files that a program opens and reads.

What comes from a device is an assumption; a file that is given beside the programs is read, line by line.
"""

from __future__ import annotations

import re
from collections.abc import Mapping

from camgen.lang.log import Log
from camgen.lang.programs import Ask

from .conditions import Conditions
from .locations import Expression
from .statements import PLAIN, split, unwrap
from .text import Statement, Unreadable

_OPENED = re.compile(r"FOPENR\s*\([^()]*\)\s*\"([^\"]+)\"", re.IGNORECASE)
_PROGRAM = re.compile(r"^\s*\.PROGRAM\b", re.IGNORECASE | re.MULTILINE)
_FOLDER = re.compile(r".*[\\/:>]")
_NUMBER = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d{1,3})?")
#: What IOSTAT says: success, the end of a file, no such file.
_FINE, _END_OF_FILE, _NO_FILE = 1.0, -504.0, -514.0
_FIRST_UNIT = 5.0
#: What follows ATTACH and DETACH where they mean the robot.
_ROBOT = frozenset({"", "()", "(0)"})


def find_data(files: Mapping[str, str]) -> dict[str, str]:
    """The files among ``files`` that hold no program and that one of the others opens to read."""
    wanted = {base_name(name) for text in files.values() for name in _OPENED.findall(text)}
    return {
        n: text for n, text in files.items() if base_name(n) in wanted and not _PROGRAM.search(text)
    }


def base_name(name: str) -> str:
    """A file without its disk and folder."""
    return _FOLDER.sub("", name.strip()).lower()


class Units(Conditions):
    """What is open, by the number of its unit: the lines of a file that are left, the next one last."""

    def __init__(self, ask: Ask, log: Log) -> None:
        super().__init__(ask, log)
        self._files: dict[str, str] = {}
        self._unread: dict[float, list[str]] = {}
        self._status: dict[float, float] = {}

    def lay_beside(self, files: Mapping[str, str]) -> None:
        """Files that the programs may read."""
        self._files = {base_name(name): text for name, text in files.items()}

    def answer(self, word: str, arguments: str, value: float) -> float:
        """IOSTAT of a unit with a file is known."""
        if word == "IOSTAT" and self._files:
            number = float(arguments.partition(",")[0] or 0.0)
            if number in self._status:
                return self._status[number]
        return super().answer(word, arguments, value)

    def do(self, statement: Statement) -> None:
        """Carries out an instruction that the next one follows."""
        does = _DOES.get(statement.word)
        if does is not None:
            does(self, statement)
        else:
            super().do(statement)

    def attach(self, statement: Statement) -> None:
        """``ATTACH (lun, mode) device``: the unit gets a number; without one the robot is this program's."""
        if statement.rest in _ROBOT:
            self.detached = False
        if not statement.rest.startswith("("):
            return
        first, *more = split(unwrap(statement.rest)[0])
        if more and PLAIN.fullmatch(first):
            name = self.variable(first)
            if not self.defined(name):
                self.assign(name, _FIRST_UNIT + len(self._status))
            if self._files:
                self._status[self.real(name)] = _FINE

    def detach(self, statement: Statement) -> None:
        """``DETACH``: of the robot, or of a unit."""
        if statement.rest in _ROBOT:
            self.rest()
            self.detached = True

    def _unit(self, rest: str) -> tuple[float, str]:
        """The number of the unit in brackets, and what follows them."""
        if not rest.startswith("("):
            raise Unreadable("(lun) expected before what is read or written")
        inner, left = unwrap(rest)
        text = Expression(next(split(inner)), self)
        number = text.logic() if text.peek() else 0.0
        return number, left

    def open(self, statement: Statement) -> None:
        """``FOPENR (lun) name``."""
        if not self._files:
            return
        number, left = self._unit(statement.rest)
        text = self._files.get(base_name(Expression(left, self).string()))
        self._status[number] = _NO_FILE if text is None else _FINE
        self._unread[number] = [] if text is None else text.splitlines()[::-1]

    def close(self, statement: Statement) -> None:
        """``FCLOSE (lun)``."""
        if self._files:
            number, _ = self._unit(statement.rest)
            self._unread.pop(number, None)
            self._status[number] = _FINE

    def read(self, statement: Statement) -> None:
        """``READ (lun) variables``: the next line of a file, else what a device says."""
        number, left = self._unit(statement.rest)
        names = list(split(left))
        if number not in self._unread:
            for name in names:
                self.hear(name)
            return
        lines = self._unread[number]
        self._status[number] = _FINE if lines else _END_OF_FILE
        if lines:
            self._take(lines.pop(), names)

    def _take(self, line: str, names: list[str]) -> None:
        """The fields of a line into variables; a string takes all that is left."""
        self.doubt = False
        for name in names:
            variable = self.variable(name)
            if variable[0] == "$":
                self.assign(variable, line)
                line = ""
                continue
            field, _, line = line.strip().replace(",", " ").partition(" ")
            self.assign(variable, float(field) if _NUMBER.fullmatch(field) else 0.0)


_DOES = {
    "ATTACH": Units.attach,
    "DETACH": Units.detach,
    "FCLOSE": Units.close,
    "FOPENR": Units.open,
    "READ": Units.read,
}
