"""Logical units of V+: devices, and files that a program opens and reads.

A value from a device is an assumption. A data file that is given with the programs is read line by
line.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from itertools import chain

from camgen.lang.log import Log
from camgen.lang.programs import RunRequest

from .conditions import Conditions
from .locations import Expression, read_whole
from .statements import PLAIN, split, unwrap
from .text import Statement, Unreadable

_OPENED = re.compile(r"FOPENR\s*\([^()]*\)\s*\"([^\"]+)\"", re.IGNORECASE)
_PROGRAM = re.compile(r"^\s*\.PROGRAM\b", re.IGNORECASE | re.MULTILINE)
_FOLDER = re.compile(r".*[\\/:>]")
_NUMBER = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d{1,3})?")
#: Values of IOSTAT.
_SUCCESS, _END_OF_FILE, _NO_FILE = 1.0, -504.0, -514.0
#: Number of the first unit that ATTACH assigns.
_FIRST_UNIT = 5.0
#: Operands of ATTACH and DETACH that denote the robot.
_ROBOT = frozenset({"", "()", "(0)"})


def find_data(files: Mapping[str, str]) -> dict[str, str]:
    """Select the files without a program that one of the other files opens to read."""
    wanted = set(map(strip_folder, chain.from_iterable(map(_OPENED.findall, files.values()))))
    return {
        name: text
        for name, text in files.items()
        if strip_folder(name) in wanted and not _PROGRAM.search(text)
    }


def strip_folder(name: str) -> str:
    """Return the name of a file in lower case, without its disk and folder."""
    return _FOLDER.sub("", name.strip()).lower()


class FileUnits(Conditions):
    """The open units.

    _files: texts by the name of the file.
    _unread: remaining lines by the number of the unit, in reverse order.
    _status: value of IOSTAT by the number of the unit.
    """

    def __init__(self, request: RunRequest, log: Log, files: Mapping[str, str]) -> None:
        super().__init__(request, log)
        self._files = {strip_folder(name): text for name, text in files.items()}
        self._unread: dict[float, list[str]] = {}
        self._status: dict[float, float] = {}

    def answer(self, word: str, arguments: str, value: float) -> float:
        """Return the value of an external function. IOSTAT of a unit with a file is known."""
        if word == "IOSTAT" and self._files:
            number = float(arguments.partition(",")[0] or 0.0)
            if number in self._status:
                return self._status[number]
        return super().answer(word, arguments, value)

    def attach(self, statement: Statement) -> None:
        """Run `ATTACH (lun, mode) device`, which assigns a unit, or `ATTACH` of the robot."""
        if statement.rest in _ROBOT:
            self.detached = False
        if not statement.rest.startswith("("):
            return
        first, *more = split(unwrap(statement.rest)[0])
        if more and PLAIN.fullmatch(first):
            name = read_whole(first, self, Expression.variable)
            if not self.defined(name):
                self.assign(name, _FIRST_UNIT + len(self._status))
            if self._files:
                self._status[self.real(name)] = _SUCCESS

    def detach(self, statement: Statement) -> None:
        """Run `DETACH`, of the robot or of a unit."""
        if statement.rest in _ROBOT:
            self.rest()
            self.detached = True

    def _split_unit(self, rest: str) -> tuple[float, str]:
        if not rest.startswith("("):
            raise Unreadable("(lun) expected before what is read or written")
        inner, operands = unwrap(rest)
        text = Expression(next(split(inner)), self)
        number = text.logic() if text.peek() else 0.0
        return number, operands

    def open(self, statement: Statement) -> None:
        """Run `FOPENR (lun) name`."""
        if not self._files:
            return
        number, name = self._split_unit(statement.rest)
        text = self._files.get(strip_folder(Expression(name, self).string()))
        self._status[number], self._unread[number] = _NO_FILE, []
        if text is not None:
            self._status[number], self._unread[number] = _SUCCESS, text.splitlines()[::-1]

    def close(self, statement: Statement) -> None:
        """Run `FCLOSE (lun)`."""
        if self._files:
            number, _ = self._split_unit(statement.rest)
            self._unread.pop(number, None)
            self._status[number] = _SUCCESS

    def read(self, statement: Statement) -> None:
        """Run `READ (lun) variables`: the next line of a file, or external values of a device."""
        number, operands = self._split_unit(statement.rest)
        names = list(split(operands))
        if number not in self._unread:
            for name in names:
                self.assign_external(name)
            return
        lines = self._unread[number]
        self._status[number] = _SUCCESS if lines else _END_OF_FILE
        if lines:
            self._assign_fields(lines.pop(), names)

    def _assign_fields(self, line: str, names: list[str]) -> None:
        self.doubt = False
        for name in names:
            variable = read_whole(name, self, Expression.variable)
            if variable[0] == "$":
                self.assign(variable, line)
                line = ""
                continue
            field, _, line = line.strip().replace(",", " ").partition(" ")
            self.assign(variable, float(field) if _NUMBER.fullmatch(field) else 0.0)
