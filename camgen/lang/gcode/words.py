"""A line of G-code: codes by modal group, words by letter, numbers, parameters and expressions."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any

from camgen.lang.values import require
from camgen.lang.word_tables import by_word

#: Largest value of a word that counts something, such as calls in a line.
_MOST_TIMES = 10_000
#: A value is a whole number if it differs from one by less.
_WHOLE = 1e-4


class LineError(Exception):
    """A line that is wrong or cannot be read. The text names the word and the reason."""


class UnknownWord(LineError):
    """A line with a word that is not read."""


# Numbers, parameters and expressions (LinuxCNC manual, overview). Angles are in deg.

#: An operator, or the end of an expression.
_OPERATOR = re.compile(r"\]|\*\*|[*/+-]|mod|eq|ne|gt|ge|lt|le|and|or|xor")
_FUNCTION = re.compile(r"abs|acos|asin|atan|cos|exists|exp|fix|fup|ln|round|sin|sqrt|tan")
_NAME = re.compile(r"#<([^<>]*)>")
#: Numbers that differ by less are equal to EQ and NE, as in LinuxCNC.
_EQUAL = 1e-4
#: Depth of nested expressions.
_DEEP = 60
#: Last parameter of a subroutine, and of the program. Larger numbers belong to the machine.
LOCALS, GLOBALS = 30, 5000


@dataclass(slots=True)
class Parameters:
    """The parameters of a program.

    machine: returns the value of a parameter of the machine by number or name, None if unknown.
    numbered: values of #31 to #5000, and of the parameters of the machine that lines have set.
    shared: values of names that begin with an underscore.
    arguments: values of #1 to #30 of the subroutine that runs.
    named: values of the other names.
    """

    machine: Callable[[str], float | None]
    numbered: dict[int, float] = field(default_factory=dict)
    shared: dict[str, float] = field(default_factory=dict)
    arguments: dict[int, float] = field(default_factory=dict)
    named: dict[str, float] = field(default_factory=dict)

    def get(self, key: int | str) -> float:
        """Return the value of a parameter. Raises LineError if no line has set it."""
        if isinstance(key, int) and key < 1:
            raise LineError(f"#{key} is not a parameter")
        value = self._find_table(key).get(key)
        if value is None and isinstance(key, int) and key <= GLOBALS:
            return 0.0
        if value is None:
            value = self.machine(str(key))
        if value is None and isinstance(key, str):
            raise LineError(f"#<{key}> is used before it is set")
        if value is None:
            raise LineError(f"#{key} is a value of the machine, which is not known here")
        return value

    def set(self, key: int | str, value: float) -> None:
        """Set a value. Raises LineError for a parameter of the machine."""
        if isinstance(key, str):
            if self.machine(key) is not None:
                raise LineError(f"#<{key}> cannot be set")
        elif key < 1 or 5400 <= key <= 5428:
            raise LineError(f"#{key} is a value of the machine and is not set here")
        self._find_table(key)[key] = value

    def _find_table(self, key: int | str) -> dict[Any, float]:
        if isinstance(key, str):
            if key.startswith("_"):
                return self.shared
            return self.named
        if key <= LOCALS:
            return self.arguments
        return self.numbered

    def has(self, key: int | str) -> bool:
        """Return whether a parameter is set."""
        if isinstance(key, str):
            return key in self._find_table(key) or self.machine(key) is not None
        return 1 <= key <= GLOBALS


def key_at(text: str, at: int, known: Parameters, depth: int = 0) -> tuple[int | str, int]:
    """Return the parameter whose # is at index `at`, and the index of its end."""
    named = _NAME.match(text, at)
    if named:
        return named[1], named.end()
    value, end = value_at(text, at + 1, known, depth + 1)
    if abs(value - round(value)) > _EQUAL:
        raise LineError(f"#{value:g} is not a parameter: its number must be whole")
    return round(value), end


def value_at(text: str, at: int, known: Parameters, depth: int = 0) -> tuple[float, int]:
    """Return the value at index `at`, and the index of its end. Raises LineError.

    text: a line in lower case without blanks.
    """
    if depth > _DEEP:
        raise LineError("an expression nested too deeply")
    number = _NUMBER.match(text, at)
    if number:
        return float(number[0]), number.end()
    sign = text[at : at + 1]
    if sign == "[":
        return _bracket(text, at + 1, known, depth + 1)
    if sign == "#":
        key, end = key_at(text, at, known, depth)
        return known.get(key), end
    if sign in ("-", "+"):
        value, end = value_at(text, at + 1, known, depth + 1)
        return (-value if sign == "-" else value), end
    function = _FUNCTION.match(text, at)
    if function:
        return _function(function[0], text, function.end(), known, depth + 1)
    raise LineError(f"cannot read {text[at : at + 12]!r}: a number or an expression is expected")


def _bracket(text: str, at: int, known: Parameters, depth: int) -> tuple[float, int]:
    """Return the value of an expression after its opening bracket, and the index of its end."""
    value, at = value_at(text, at, known, depth)
    values, waiting = [value], [""]
    while True:
        match = _OPERATOR.match(text, at)
        if not match:
            raise LineError(f"cannot read {text[at : at + 12]!r} in an expression")
        operator = match[0]
        while waiting[-1] and _BINDS[waiting[-1]] >= _BINDS.get(operator, 0):
            right, left = values.pop(), values.pop()
            values.append(_apply(waiting.pop(), left, right))
        if operator == "]":
            return values[0], at + 1
        value, at = value_at(text, at + len(operator), known, depth)
        values.append(value)
        waiting.append(operator)


_BINDS = {
    "**": 6, "*": 5, "/": 5, "mod": 5, "+": 4, "-": 4,
    "eq": 3, "ne": 3, "gt": 3, "ge": 3, "lt": 3, "le": 3, "and": 2, "or": 2, "xor": 2,
}  # fmt: skip


def _power(a: float, b: float) -> float:
    if a < 0 and b != int(b):
        raise LineError("a negative number to a power that is not whole")
    return float(a**b)


def _modulo(a: float, b: float) -> float:
    rest = math.fmod(a, b)
    return rest + abs(b) if rest < 0 else rest


_BINARY: dict[str, Callable[[float, float], float]] = {
    "**": _power,
    "*": lambda a, b: a * b,
    "/": lambda a, b: a / b,
    "mod": _modulo,
    "+": lambda a, b: a + b,
    "-": lambda a, b: a - b,
    "eq": lambda a, b: float(abs(a - b) < _EQUAL),
    "ne": lambda a, b: float(abs(a - b) >= _EQUAL),
    "gt": lambda a, b: float(a > b),
    "ge": lambda a, b: float(a >= b),
    "lt": lambda a, b: float(a < b),
    "le": lambda a, b: float(a <= b),
    "and": lambda a, b: float(bool(a) and bool(b)),
    "or": lambda a, b: float(bool(a) or bool(b)),
    "xor": lambda a, b: float(bool(a) != bool(b)),
}
_UNARY: dict[str, Callable[[float], float]] = {
    "abs": abs,
    "acos": lambda v: math.degrees(math.acos(v)),
    "asin": lambda v: math.degrees(math.asin(v)),
    "cos": lambda v: math.cos(math.radians(v)),
    "exp": math.exp,
    "fix": lambda v: float(math.floor(v)),
    "fup": lambda v: float(math.ceil(v)),
    "ln": math.log,
    "round": lambda v: math.copysign(math.floor(abs(v) + 0.5), v),
    "sin": lambda v: math.sin(math.radians(v)),
    "sqrt": math.sqrt,
    "tan": lambda v: math.tan(math.radians(v)),
}


def _apply(operator: str, a: float, b: float) -> float:
    try:
        value = _BINARY[operator](a, b)
    except (ValueError, ZeroDivisionError, OverflowError) as error:
        raise LineError(f"{a:g} {operator.upper()} {b:g} has no value") from error
    return _finite(value, operator)


def _finite(value: float, what: str) -> float:
    if not math.isfinite(value):
        raise LineError(f"{what.upper()} gives no finite number")
    return value


def _function(name: str, text: str, at: int, known: Parameters, depth: int) -> tuple[float, int]:
    if text[at : at + 1] != "[":
        raise LineError(f"{name.upper()} without its bracket")
    if name == "exists":
        key, end = key_at(text, at + 1, known, depth) if text[at + 1 : at + 2] == "#" else ("", at)
        if text[end : end + 1] != "]":
            raise LineError("EXISTS asks for a parameter, EXISTS[#<name>]")
        return float(known.has(key)), end + 1
    value, at = _bracket(text, at + 1, known, depth)
    if name == "atan":
        if text[at : at + 2] != "/[":
            raise LineError("ATAN has two arguments, ATAN[y]/[x]")
        other, at = _bracket(text, at + 2, known, depth)
        return math.degrees(math.atan2(value, other)), at
    try:
        return _finite(float(_UNARY[name](value)), name), at
    except (ValueError, OverflowError) as error:
        raise LineError(f"{name.upper()}[{value:g}] has no value") from error


# A line of G-code as codes by modal group and words by letter.

#: Codes by modal group (LinuxCNC manual). A line has at most one code of a group.
GROUP = by_word({
    "cycle off": "G80",
    "motion": "G0 G1 G2 G3 G5 G5.1 G5.2 G5.3 G33 G33.1 G38.2 G38.3 G38.4 G38.5 G73 G74 G76 G81 G82 "
    "G83 G84 G85 G86 G87 G88 G89",
    "plane": "G17 G18 G19",
    "distance": "G90 G91",
    "arc distance": "G90.1 G91.1",
    "feed mode": "G93 G94 G95",
    "units": "G20 G21",
    "cutter compensation": "G40 G41 G41.1 G42 G42.1",
    "length offset": "G43 G43.1 G43.2 G49",
    "return level": "G98 G99",
    "work offset": "G54 G55 G56 G57 G58 G59 G59.1 G59.2 G59.3",
    "path": "G61 G61.1 G64",
    "spindle mode": "G96 G97",
    "offsets": "G10 G28 G28.1 G30 G30.1 G52 G92 G92.1 G92.2 G92.3",
    "dwell": "G4",
    "lathe radius": "G7 G8",
    "stop": "M0 M1 M2 M30 M60",
    "outputs": "M62 M63 M64 M65 M66 M67 M68",
    "tool change": "M6 M61",
    "spindle": "M3 M4 M5 M19",
    "override": "M48 M49 M50 M51 M52 M53",
    "machine coordinates": "G53",
    "state": "M70 M71 M72 M73",
    "subprogram": "M97 M98 M99",
    # One line may have both M7 and M8.
    "mist": "M7",
    "flood": "M8",
    "coolant off": "M9",
})  # fmt: skip

#: Codes that the plain machine does not run, by reason.
_WHY = by_word({
    "goes to a position that the machine stores": "G28 G28.1 G30 G30.1",
    "cutter compensation: the controller moves the path by the radius of the tool": "G41 G41.1 "
    "G42 G42.1",
    "a tool length that the program sets itself": "G43.1 G43.2",
    "a cycle that taps, stops or turns the spindle back": "G74 G84 G87 G88",
    "a thread": "G33 G33.1 G76",
    "a probe": "G38.2 G38.3 G38.4 G38.5",
    "a spline": "G5 G5.1 G5.2 G5.3",
    "lathe diameters": "G7",
    "constant surface speed": "G96",
    "a shift of the origin": "G52",
    "brings an earlier shift back": "G92.3",
    "waits for the operator: a program here runs through": "M0 M60",
    "waits for an input": "M66",
    "turns the spindle to an angle": "M19",
    "a subprogram of other controllers": "M97 M98 M99",
    "sets the number of the tool": "M61",
    "keeps or restores the modes": "M70 M71 M72 M73",
    "goes to machine coordinates, which are not known here": "G53",
    "a drilling cycle": "G73 G81 G82 G83 G85 G86 G89",
    "shifts the origin": "G10 G92 G92.1 G92.2",
    "a feed mode other than mm/min": "G93 G95",
    "stops where the operator wants it": "M1",
})  # fmt: skip
_NUMBER = re.compile(r"[+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)")
#: A comment in parentheses, or one that runs to the end of the line.
COMMENT = re.compile(r"\(([^()]*)\)|;.*")
_NUMBERED = re.compile(r"n[0-9]+(?:\.[0-9]*)?")
BLANKS = str.maketrans("", "", " \t\r\f\v")
_LETTERS = frozenset("abcdefghijklmpqrstuvwxyz@^$")
#: Largest number of a word: mm, mm/min or rpm.
_HUGE = 1e7

Line = tuple[dict[str, str], dict[str, float]]


def bare(raw: str) -> str:
    """The line without comments, blanks, slash and number, in lower case.

    Raises LineError for a comment that acts, such as a line of Python.
    """
    if ";" in raw or "(" in raw or ")" in raw:
        if raw.lstrip().lower().startswith(";py,"):
            raise LineError("a line of Python")
        if re.search(r"\(\s*(?:probeopen|abort)\b", raw, re.IGNORECASE):
            raise LineError("an active comment that stops or probes")
        raw = without_comments(raw)
    return without_number(raw.translate(BLANKS).lower().removeprefix("/"))


def without_comments(raw: str) -> str:
    """The line without its comments. Raises LineError for parentheses that do not match."""
    raw = COMMENT.sub("", raw)
    if "(" in raw or ")" in raw:
        raise LineError("a comment that is not closed, or closed twice")
    return raw


def drop_comments(raw: str, nested: bool) -> str:
    """Return the line without comments. A comment may have no end.

    nested: whether comments nest. Else the first closing parenthesis ends one, as in GRBL.
    """
    head = raw.partition(";")[0]
    if "(" not in head:
        raw = head
    kept, depth = [], 0
    for letter in raw:
        if letter == "(":
            depth = depth + 1 if nested else 1
        elif letter == ")":
            if not depth and not nested:
                kept.append(letter)
            depth = max(0, depth - 1)
        elif letter == ";" and not depth:
            break
        elif not depth:
            kept.append(letter)
    return "".join(kept)


def without_number(text: str) -> str:
    """A line in lower case without its number, N10. Raises LineError."""
    if not text.startswith("n"):
        return text
    numbered = require(_NUMBERED.match(text), LineError("N without a number"))
    return text[numbered.end() :]


def group_of(code: str) -> str:
    """The modal group of a code. Raises UnknownWord for a code without a group."""
    group = GROUP.get(code)
    if group is None:
        raise UnknownWord(explain_unread(code, "not a code that is known"))
    return group


def words_of(text: str, known: Parameters, group: Callable[[str], str] = group_of) -> Line:
    """Codes by group and words by letter of a bare line. Raises LineError.

    Parameters are set after the whole line is read.

    group: returns the modal group of a code.
    """
    codes: dict[str, str] = {}
    words: dict[str, float] = {}
    setting: list[tuple[int | str, float]] = []
    at = 0
    while at < len(text):
        letter = text[at]
        if letter == "#":
            key, at = key_at(text, at, known)
            if text[at : at + 1] != "=":
                what = "a parameter that stands alone is set with ="
                raise LineError(f"cannot read {text[at : at + 12]!r}: {what}")
            value, at = value_at(text, at + 1, known)
            setting.append((key, value))
            continue
        if letter not in _LETTERS:
            raise LineError(f"cannot read {text[at : at + 12]!r}")
        number = _NUMBER.match(text, at + 1)
        value, at = (float(number[0]), number.end()) if number else value_at(text, at + 1, known)
        if not -_HUGE < value < _HUGE:
            written = number[0][:12] if number else f"{value:g}"
            raise LineError(f"word {letter.upper()}{written} is out of range")
        if letter in "gm":
            _code(codes, _name(letter.upper(), value), group)
        elif letter.upper() in words:
            raise LineError(f"word {letter.upper()} twice in one line")
        else:
            words[letter.upper()] = value
    for key, value in setting:
        known.set(key, value)
    return codes, words


def take_whole(words: dict[str, float], letter: str, usual: int) -> int:
    """Removes a word and returns its value, `usual` without the word.

    Raises LineError unless it is a whole number from 0 to 10,000. As in LinuxCNC, a value is whole
    that differs from one by 0.0001 at most.
    """
    value = words.pop(letter, float(usual))
    whole = round(value) if math.isfinite(value) else -1
    if abs(value - whole) > _WHOLE or not 0 <= whole <= _MOST_TIMES:
        raise LineError(f"{letter}{value:g} is not a whole number from 0 to {_MOST_TIMES:,}")
    return whole


def _code(codes: dict[str, str], code: str, group_of: Callable[[str], str]) -> None:
    group = group_of(code)
    if group in codes:
        raise LineError(f"{codes[group]} and {code} are of one group ({group})")
    codes[group] = code


def explain_unread(code: str, otherwise: str) -> str:
    """The finding for a code that is not read.

    otherwise: reason for a code that the table does not have.
    """
    return f"{code} is not read: {_WHY.get(code, otherwise)}"


@lru_cache(maxsize=1024)
def _name(letter: str, number: float) -> str:
    # The sum turns -0 into 0: both are one key of the cache.
    return f"{letter}{round(number, 3) + 0.0:g}"
