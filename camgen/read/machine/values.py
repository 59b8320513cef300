"""Values of a settings file, each with the line on which it stands."""

from __future__ import annotations

import math
import re

from msgspec import Struct

from camgen.model.errors import InputError
from camgen.model.text import harmless

#: A decimal number; Python's own reading also takes "1_000", "nan" and digits of other scripts.
_NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?", re.ASCII)
#: Bounds of rates, accelerations and the like; their squares stay finite.
_LOWEST, _HIGHEST = 1e-6, 1e9


class Value(Struct, frozen=True):
    """A value as it is written.

    text: the value.
    line: its line, from 1.
    """

    text: str
    line: int


class Settings(Struct, frozen=True):
    """The settings of a file.

    file: name of the file.
    values: values of the settings, by name.
    remedy: remedy for a missing setting.
    """

    file: str
    values: dict[str, Value]
    remedy: str

    def number(self, name: str, low: float = -math.inf, high: float = math.inf) -> float:
        """A setting as a number from `low` to `high`.

        Raises InputError if it is missing, not a number or out of range.
        """
        value = self.values.get(name)
        if value is None:
            raise InputError(self.file, f"has no {name}", "cell.machine", self.remedy)
        if not _NUMBER.fullmatch(value.text):
            raise self.fault(name, "is not a number", "correct the line")
        number = float(value.text)
        if not math.isfinite(number):
            raise self.fault(name, "is not a finite number", "correct the line")
        if number < low:
            raise self.fault(name, f"is below {low:g}", "correct the line")
        if number > high:
            raise self.fault(name, f"is above {high:g}", "correct the line")
        return number

    def above_zero(self, name: str) -> float:
        """A setting as a number above 0. Raises InputError for any other."""
        number = self.number(name, high=_HIGHEST)
        if number <= 0:
            raise self.fault(name, "is not above 0", "correct the line")
        if number < _LOWEST:
            raise self.fault(name, f"is below {_LOWEST:g}", "correct the line")
        return number

    def fault(self, name: str, what: str, remedy: str) -> InputError:
        """The error about a setting of the file."""
        value = self.values[name]
        return InputError(
            self.file, f"{name} = {harmless(value.text)} {what}", f"line {value.line}", remedy
        )
