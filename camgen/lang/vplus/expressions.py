"""Evaluates V+ expressions of numbers and strings; `locations` adds locations and precision points.

Sources: V+ Language Reference and User's Guide as docs/posts/vplus.md and docs/languages/vplus.md
quote them. `TRANS` is x, y, z, yaw, pitch, roll with R = Rz(yaw) Ry(pitch) Rz(roll), and missing
arguments are 0. `a:b` multiplies from left to right. SIN and COS take degrees. TRUE is -1.
"""

from __future__ import annotations

import math
import operator
import re
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from functools import lru_cache
from typing import Any

from camgen.model.text import counted

from .functions import (
    ASKED,
    NUMBERS,
    OF_STRINGS,
    TEXTS,
    decode,
    divide,
    format_number,
    join,
    remainder,
    signed,
    truth,
    whole,
)
from .text import Impossible, Unreadable
from .variables import NAME_PATTERN, Variables

#: Maximum depth of nested brackets: keeps a hostile text from exhausting the stack of Python.
_MAX_DEPTH = 40
#: Maximum of a sum: integers of 32 bits without a sign, up to 4.295e9, are within it.
_MAX_SUM = 4.3e9
#: Maximum of a literal and of a product.
_MAX_PRODUCT = 1e30
#: A string, a number, a comparison, an integer in another base, a name, or any other character.
#: Blanks between tokens are optional.
_TOKEN = re.compile(
    r'"[^"]*"|(?:\d+\.?\d*|\.\d+)(?:E[-+]?\d+)?|==|<>|<=|>=|=<|=>'
    r"|\^[HBD]?[0-9A-F]+|[#$]?[A-Z][A-Z0-9._]*|\S",
    re.ASCII,
)
_DIGITS = frozenset("0123456789.")
_CONSTANTS = {"TRUE": -1.0, "ON": -1.0, "FALSE": 0.0, "OFF": 0.0, "PI": math.pi}
_BASES = {"H": 16, "B": 2, "D": 10}
_COMPARED: Mapping[str, Callable[[Any, Any], bool]] = {
    "==": operator.eq,
    "<>": operator.ne,
    "<": operator.lt,
    ">": operator.gt,
    "<=": operator.le,
    ">=": operator.ge,
    "=<": operator.le,
    "=>": operator.ge,
}
_JOINED: Mapping[str, Callable[[float, float], float]] = {
    "AND": lambda a, b: truth(a != 0 and b != 0), "OR": lambda a, b: truth(a != 0 or b != 0),
    "XOR": lambda a, b: truth((a != 0) != (b != 0)),
}  # fmt: skip
_PRODUCTS: Mapping[str, Callable[[float, float], float]] = {
    "*": operator.mul,
    "/": divide,
    "MOD": remainder,
    "BAND": lambda a, b: signed(whole(a) & whole(b)),
}
_SUMS: Mapping[str, Callable[[float, float], float]] = {
    "+": operator.add,
    "-": operator.sub,
    "BOR": lambda a, b: signed(whole(a) | whole(b)),
    "BXOR": lambda a, b: signed(whole(a) ^ whole(b)),
}
#: Words between values, which are not values themselves.
_JOINING = frozenset({
    "THEN", "DO", "OF", "TO", "STEP", "BY", "GOTO", "AND", "OR", "XOR", "MOD", "BAND", "BOR",
    "BXOR", "ALWAYS",
})  # fmt: skip
#: Functions of external values whose arguments may be other things than numbers.
_FREE = frozenset({"PARAMETER", "INT.EVENT", "VPARAMETER"})
#: Functions whose values follow from the run of the program.
_OF_RUN = frozenset({"SIG", "LAST", "DEFINED", "TIMER", "BITS", "SPEED", "ACCEL"})
#: Functions of `_OF_RUN` and of external values whose arguments are numbers.
_NUMBERED = frozenset(
    {"TIMER", "BITS", "SPEED", "ACCEL", "IOSTAT", "TASK", "STATE", "ERROR", "AIO.IN", "PENDANT"}
)
#: Factor of a SPEED, and its unit, by the word after it.
_UNITS = {
    "": (1.0, "%"),
    "MMPS": (1.0, "mm/s"),
    "IPS": (25.4, "mm/s"),
    "MONITOR": (1.0, "MONITOR"),
}
_OF_LOCATIONS = frozenset({"DX", "DY", "DZ", "DISTANCE", "IDENTICAL"})


@lru_cache(maxsize=16384)
def tokens(text: str) -> tuple[str, ...]:
    """Split a text into tokens: capitals except in strings, with an empty token at the end."""
    if '"' not in text:
        return (*_TOKEN.findall(text.upper()), "")
    pieces = re.split(r'("[^"]*")', text)
    result: list[str] = []
    for piece in pieces:
        if piece[:1] == '"' and len(piece) > 1:
            result.append(piece)
        else:
            result += _TOKEN.findall(piece.upper())
    return (*result, "")


class Reader:
    """A text that is parsed from left to right. Methods raise Unreadable if the text does not fit.

    constant: no name was used so far.
    omitted: a number between commas was left out.
    unbracketed: AND, OR or XOR had a comparison without brackets as an operand.
    """

    def __init__(self, text: str, scope: Variables) -> None:
        self._scope = scope
        self.constant = True
        self.omitted = False
        self.unbracketed = False
        # The empty token at the end means that there is always a next one.
        self._tokens = tokens(text)
        self._at = 0
        self._depth = 0

    def _named(self) -> Variables:
        self.constant = False
        return self._scope

    def peek(self) -> str:
        """The next token in capitals, empty at the end."""
        return self._tokens[self._at]

    def take(self) -> str:
        """The next token in capitals."""
        token = self._tokens[self._at]
        if not token:
            raise Unreadable("something is missing at the end of the line")
        self._at += 1
        return token

    def accept(self, token: str) -> bool:
        """Take the next token if it is `token`. Returns whether it was."""
        if self._tokens[self._at] != token:
            return False
        self._at += 1
        return True

    def after(self, token: str, read: Callable[[], float], default: float) -> float:
        """Read a number if the next token is `token`, else return `default`."""
        if self.accept(token):
            return read()
        return default

    def expect(self, token: str) -> None:
        """Take the next token, which must be `token`."""
        if not self.accept(token):
            raise Unreadable(f"{token} expected before {self.peek() or 'the end of the line'}")

    def finish(self) -> None:
        """Check that all tokens were taken."""
        if self._tokens[self._at]:
            raise Unreadable(f"{self._tokens[self._at][:20]!r} is not expected here")

    def rest(self) -> str:
        """Take all remaining tokens. Returns them as text."""
        remaining = " ".join(self._tokens[self._at : -1])
        self._at = len(self._tokens) - 1
        return remaining

    def skip(self) -> str:
        """Take all up to the bracket that closes the one just taken. Returns the text inside."""
        depth, start = 1, self._at
        while depth:
            token = self.take()
            depth += (token == "(") - (token == ")")
        return " ".join(self._tokens[start : self._at - 1])

    def open_bracket(self) -> None:
        """Enter a bracket, which must be the next token."""
        self.expect("(")
        self.deeper()

    def close_bracket(self) -> None:
        """Leave the bracket that was entered last."""
        self.expect(")")
        self._depth -= 1

    def deeper(self) -> None:
        """Enter a bracket."""
        self._depth += 1
        if self._depth > _MAX_DEPTH:
            raise Unreadable("brackets are nested too deeply")


class Numbers(Reader, ABC):
    """Numbers, conditions and strings."""

    # -- reals --------------------------------------------------------------------------------

    def logic(self) -> float:
        """Evaluate a number or a condition, with AND, OR and XOR."""
        value, joined, compared = self._conjunction()
        while self.peek() in ("OR", "XOR"):
            combine = _JOINED[self.take()]
            other, _, other_compared = self._conjunction()
            value, joined, compared = combine(value, other), True, compared or other_compared
        self.unbracketed = self.unbracketed or (joined and compared)
        return value

    def _conjunction(self) -> tuple[float, bool, bool]:
        """Evaluate conditions with AND between them.

        Returns the value, whether there was an AND, and whether there was a bare comparison.
        """
        value, compared = self._relation()
        joined = False
        while self.accept("AND"):
            other, other_compared = self._relation()
            value, joined = _JOINED["AND"](value, other), True
            compared = compared or other_compared
        return value, joined, compared

    def _relation(self) -> tuple[float, bool]:
        if self.accept("NOT"):
            self.deeper()
            value, compared = self._relation()
            self._depth -= 1
            return truth(value == 0), compared
        if self.is_string():
            left = self.string()
            sign = self.take()
            if sign not in _COMPARED:
                raise Unreadable(f"a comparison expected instead of {sign[:20]!r}")
            return truth(_COMPARED[sign](left, self.string())), True
        value, compared = self.real(), False
        while self.peek() in _COMPARED:
            value, compared = truth(_COMPARED[self.take()](value, self.real())), True
        return value, compared

    def real(self) -> float:
        """Evaluate a sum."""
        value = self._product()
        while self.peek() in _SUMS:
            value = _SUMS[self.take()](value, self._product())
        if not abs(value) <= _MAX_SUM:
            raise Impossible("a number is not finite or beyond any machine")
        return value

    def _product(self) -> float:
        value = self._factor()
        while self.peek() in _PRODUCTS:
            value = _PRODUCTS[self.take()](value, self._factor())
            if not abs(value) < _MAX_PRODUCT:
                raise Impossible("a number is not finite or beyond any machine")
        return value

    def _factor(self) -> float:
        sign = 1.0
        while self.peek() in ("+", "-"):
            if self.take() == "-":
                sign = -sign
        token = self.take()
        if token == "(":
            return sign * self._bracketed()
        if token[0] in _DIGITS and token != ".":
            value = float(token)
            if not abs(value) < _MAX_PRODUCT:
                raise Impossible("a number is not finite or beyond any machine")
            return sign * value
        if token in _CONSTANTS:
            return sign * _CONSTANTS[token]
        if token[0].isalpha():
            return sign * self._word(token)
        if token[0] == "^":
            return sign * _parse_based(token)
        raise Unreadable(f"a number expected instead of {token!r}")

    def _word(self, token: str) -> float:
        if token in ("COM", "NOT"):
            self.deeper()
            value = self._factor()
            self._depth -= 1
            return signed(~whole(value)) if token == "COM" else truth(value == 0)
        if token in _JOINING:
            raise Unreadable(f"a number expected instead of {token}")
        if self.peek() == "(":
            return self._function(token)
        if (
            token in ASKED
            and not self._scope.strict
            and self.peek() != "["
            and not self._scope.defined(token)
        ):
            return self._named().answer(token, "", ASKED[token])
        return self._named().real(token + self.subscripts())

    def subscripts(self) -> str:
        """Evaluate subscripts `[i, j]` after a name. Returns a text, empty if missing or `[]`."""
        if not self.accept("["):
            return ""
        if self.accept("]"):
            return ""
        self.deeper()
        indices = []
        while True:
            # A missing subscript is 0, also after the last comma of a[i,].
            value = self.logic() if self.peek() not in (",", "]") else 0.0
            if not 0 <= value < 2**31:
                raise Impossible(f"{value:g} is not an index of an array")
            indices.append(str(int(value)))
            if not self.accept(","):
                break
        self.expect("]")
        self._depth -= 1
        return f"[{','.join(indices)}]"

    def variable(self) -> str:
        """Take the name of a variable. Returns it with its subscripts evaluated."""
        name = self.take()
        if not NAME_PATTERN.fullmatch(name):
            raise Unreadable(f"{name[:20]!r} is not a name")
        return name + self.subscripts()

    def _bracketed(self) -> float:
        self.deeper()
        value = self.logic()
        self.close_bracket()
        return value

    def _function(self, word: str) -> float:
        if word in NUMBERS:
            minimum, maximum, function = NUMBERS[word]
            self.open_bracket()
            values = self.numbers(maximum)
            self.close_bracket()
            if not minimum <= len(values) <= maximum:
                raise Unreadable(f"{word} has {counted(len(values), 'argument')}")
            return float(function(*values))
        if word in OF_STRINGS:
            kinds, minimum, function = OF_STRINGS[word]
            return float(function(*self._arguments(word, kinds, minimum)))
        if word in _OF_LOCATIONS:
            self.take()
            return self._of_locations(word)
        return self._external(word)

    def numbers(self, maximum: int = 64) -> list[float]:
        """Evaluate numbers with commas between them. A missing number is a fault."""
        values = [self.logic()]
        while len(values) <= maximum and self.accept(","):
            values.append(self.logic())
        return values

    def _arguments(self, word: str, kinds: str, minimum: int) -> list[float | str]:
        """Evaluate the arguments of a function, in brackets.

        kinds: one character per argument, $ for a string and a dot for a number.
        minimum: number of arguments that must be there.
        """
        self.open_bracket()
        values: list[float | str] = []
        while self.peek() != ")":
            if len(values) == len(kinds):
                raise Unreadable(f"{word} has more than {counted(len(kinds), 'argument')}")
            values.append(self.string() if kinds[len(values)] == "$" else self.logic())
            if not self.accept(","):
                break
        self.close_bracket()
        if len(values) < minimum:
            raise Unreadable(f"{word} wants {counted(minimum, 'argument')}")
        return values

    @abstractmethod
    def _of_locations(self, word: str) -> float:
        """Evaluate a function of locations, such as DX."""

    def _external(self, word: str) -> float:
        """Evaluate a function of the run or of external values."""
        scope = self._named()
        if word not in ASKED and word not in _OF_RUN and word not in _FREE:
            raise Unreadable(
                f"{word} is not defined" if scope.strict else f"{word} is not a function"
            )
        if scope.strict:
            raise Unreadable(f"{word} is not evaluated")
        self.take()
        if word == "SIG":
            values = self.numbers()
            self.expect(")")
            return scope.signals(values)
        if word in ("LAST", "DEFINED"):
            name = self.take() + self.subscripts()
            self.rest_of_brackets()
            return scope.last(name) if word == "LAST" else truth(scope.is_assumed_defined(name))
        if word in _NUMBERED:
            values = self.numbers()
            self.expect(")")
            return scope.answer(word, ",".join(f"{v:g}" for v in values), ASKED.get(word, 0.0))
        return scope.answer(word, self.skip(), ASKED.get(word, 1.0))

    def rest_of_brackets(self) -> None:
        """Take the closing bracket, with an empty `[]` before it if there is one."""
        if self.accept("["):
            self.expect("]")
        self.expect(")")

    def reals(self) -> list[float]:
        """Evaluate numbers with commas between them; a missing one is 0."""
        values = [self._real_or_zero()]
        while self.accept(","):
            values.append(self._real_or_zero())
        return values

    def _real_or_zero(self) -> float:
        if self.peek() not in (",", ")", ""):
            return self.real()
        self.omitted = True
        return 0.0

    def is_string(self) -> bool:
        """Whether the next token begins a string expression."""
        return self.peek()[:1] in ('"', "$") and self.peek() != "$"

    def speed(self) -> tuple[float, str, float, bool]:
        """Evaluate a SPEED.

        Returns its value, its unit (%, mm/s or MONITOR), the rotational speed in % (100 if it is
        missing), and whether the setting holds for more than one motion.
        """
        value = self.real()
        turning = self.after(",", self.real, 100.0)
        if turning <= 0:
            raise Impossible("a rotational speed must be positive")
        words = self.rest().split()
        units = [word for word in words if word != "ALWAYS"]
        is_repeated = len(set(words)) < len(words)
        if len(units) > 1 or is_repeated or not _UNITS.keys() >= set(units):
            raise Unreadable(f"SPEED cannot end with {' '.join(words)[:40]}")
        if value <= 0:
            raise Impossible("a speed must be positive")
        scale, unit = _UNITS[units[0] if units else ""]
        return value * scale, unit, turning, "ALWAYS" in words

    # -- strings ------------------------------------------------------------------------------

    def string(self) -> str:
        """Evaluate strings with + between them."""
        parts = [self._string_operand()]
        while self.peek() == "+":
            self.take()
            parts.append(self._string_operand())
        return join(parts)

    def _string_operand(self) -> str:
        token = self.take()
        if token[0] == '"' and len(token) > 1:
            return token[1:-1]
        if token == "(":
            self.deeper()
            value = self.string()
            self.close_bracket()
            return value
        if token[0] != "$" or token == "$":
            raise Unreadable(f"a string expected instead of {token[:20]!r}")
        if self.peek() != "(":
            return self._named().text(token + self.subscripts())
        if token in TEXTS:
            kinds, minimum, function = TEXTS[token]
            return str(function(*self._arguments(token, kinds, minimum)))
        self.take()
        if token == "$ENCODE":
            return self._encode()
        if token == "$DECODE":
            return self._decode()
        self.skip()
        return self._named().answer_text(token)

    def _encode(self) -> str:
        parts, form = [], ""
        while self.peek() != ")":
            if self.accept("/"):
                form = self.take()
                if self.peek() and self.peek()[0] in _DIGITS:  # F8.3 is one token, I 5 may be two
                    form += self.take()
            elif self.is_string():
                parts.append(self.string())
            elif self.peek() != ",":
                parts.append(format_number(self.logic(), form))
            if not self.accept(",") and self.peek() not in ("/", ")"):
                break
        self.expect(")")
        return join(parts)

    def _decode(self) -> str:
        name = self.take()
        if name[:1] != "$":
            raise Unreadable("$DECODE wants a string variable")
        name += self.subscripts()
        self.expect(",")
        delimiters = self.string()
        mode = self.after(",", self.logic, 0.0)
        self.expect(")")
        scope = self._named()
        front, remaining = decode(scope.text(name), delimiters, mode)
        scope.assign(name, remaining)
        return front


def _parse_based(token: str) -> float:
    base = _BASES.get(token[1:2], 8)
    digits = token[2:] if token[1:2] in _BASES else token[1:]
    try:
        value = int(digits, base)
    except ValueError:
        raise Unreadable(f"{token[:20]} is not an integer") from None
    return signed(value)
