"""V+ expressions: numbers, strings, locations and precision points.

Sources: V+ Language Reference and User's Guide as docs/posts/vplus.md and docs/languages/vplus.md quote them: ``TRANS``
is x, y, z, yaw, pitch, roll with R = Rz(yaw) Ry(pitch) Rz(roll), missing arguments are 0; ``a:b`` multiplies left to
right; SIN and COS take degrees; TRUE is -1.
"""

from __future__ import annotations

import math
import re
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from functools import lru_cache
from typing import Any, ClassVar, Protocol

from camgen.model.program import Joints
from camgen.model.text import counted

from .functions import (
    ASKED,
    NUMBERS,
    OF_STRINGS,
    TEXTS,
    decode,
    format_number,
    join,
    remainder,
    signed,
    truth,
    whole,
)
from .text import Impossible, Location, Unreadable

#: Brackets deeper than this are no program that somebody wrote.
_DEPTH = 40
_LARGEST = 1e9
#: A string, a number, a comparison, an integer to another base, a name, or any other sign; blanks are nowhere needed.
_TOKEN = re.compile(
    r'"[^"]*"|(?:\d+\.?\d*|\.\d+)(?:E[-+]?\d+)?|==|<>|<=|>=|=<|=>|\^[HBD]?[0-9A-F]+|[#$]?[A-Z][A-Z0-9._]*|\S',
    re.ASCII,
)
_DIGITS = frozenset("0123456789.")
_CONSTANTS = {"TRUE": -1.0, "ON": -1.0, "FALSE": 0.0, "OFF": 0.0, "PI": math.pi}
_BASES = {"H": 16, "B": 2, "D": 10}
_COMPARED: Mapping[str, Callable[[Any, Any], bool]] = {
    "==": lambda a, b: a == b, "<>": lambda a, b: a != b, "<": lambda a, b: a < b, ">": lambda a, b: a > b,
    "<=": lambda a, b: a <= b, ">=": lambda a, b: a >= b, "=<": lambda a, b: a <= b, "=>": lambda a, b: a >= b,
}  # fmt: skip
_JOINED: Mapping[str, Callable[[float, float], float]] = {
    "AND": lambda a, b: truth(a != 0 and b != 0), "OR": lambda a, b: truth(a != 0 or b != 0),
    "XOR": lambda a, b: truth((a != 0) != (b != 0)),
}  # fmt: skip
_PRODUCTS = frozenset({"*", "/", "MOD", "BAND"})
_SUMS = frozenset({"+", "-", "BOR", "BXOR"})
#: Words between values: none of them is one.
_JOINING = frozenset(
    {
        "THEN",
        "DO",
        "OF",
        "TO",
        "STEP",
        "BY",
        "GOTO",
        "AND",
        "OR",
        "XOR",
        "MOD",
        "BAND",
        "BOR",
        "BXOR",
        "ALWAYS",
    }
)
#: Functions of the surroundings that read more than numbers in their brackets.
_FREE = frozenset({"PARAMETER", "INT.EVENT", "VPARAMETER"})
#: Functions that the program itself answers, and those of the surroundings with numbers in their brackets.
_OWN = frozenset({"SIG", "LAST", "DEFINED", "TIMER", "BITS", "SPEED", "ACCEL"})
_NUMBERED = frozenset(
    {"TIMER", "BITS", "SPEED", "ACCEL", "IOSTAT", "TASK", "STATE", "ERROR", "AIO.IN", "PENDANT"}
)
_OF_LOCATIONS = frozenset({"DX", "DY", "DZ", "DISTANCE", "IDENTICAL"})


class Scope(Protocol):
    """Where names get their values. strict: what only the surroundings know is Unreadable, not assumed."""

    strict: ClassVar[bool]

    def real(self, name: str) -> float:
        """The value of a real variable; names come with their subscripts, as ``A[1,2]``."""

    def text(self, name: str) -> str:
        """The value of a string variable."""

    def set_text(self, name: str, value: str) -> None:
        """Gives a string variable a value."""

    def location(self, name: str) -> Location:
        """The value of a location variable."""

    def point(self, name: str) -> Joints | Location:
        """The value of a precision point, a location where only the controller knows its joints."""

    def here(self, word: str) -> Location:
        """HERE, DEST, TOOL or BASE."""

    def point_here(self, word: str) -> Joints | Location:
        """The same as joint values."""

    def signals(self, numbers: list[float]) -> float:
        """SIG: whether all of these signals are as their signs say."""

    def answer(self, word: str, arguments: str, value: float) -> float:
        """What a function of the surroundings says; ``value`` where nobody knows."""

    def answer_text(self, word: str) -> str:
        """The same of a string."""

    def last(self, name: str) -> float:
        """The last index of an array."""

    def defined(self, name: str) -> bool:
        """Whether a variable has a value."""

    def says_defined(self, name: str) -> bool:
        """What the function DEFINED says of it."""


@lru_cache(maxsize=16384)
def tokens(text: str) -> tuple[str, ...]:
    """The tokens of a text in capitals, strings as they are, and an empty one at the end."""
    if '"' not in text:
        return (*_TOKEN.findall(text.upper()), "")
    pieces = re.split(r'("[^"]*")', text)
    found: list[str] = []
    for piece in pieces:
        if piece[:1] == '"' and len(piece) > 1:
            found.append(piece)
        else:
            found += _TOKEN.findall(piece.upper())
    return (*found, "")


class Reader:
    """One text, read from left to right. Every method raises Unreadable where the text does not fit. constant: no name
    had a say in what was read so far. omitted: a number between commas was left out. unbracketed: a comparison stood
    beside AND, OR or XOR without brackets.
    """

    def __init__(self, text: str, scope: Scope) -> None:
        self._scope = scope
        self.constant = True
        self.omitted = False
        self.unbracketed = False
        # An empty token closes the list, so that there is always a next one.
        self._tokens = tokens(text)
        self._at = 0
        self._depth = 0

    def _named(self) -> Scope:
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
        """Whether the next token is ``token``; then it is taken."""
        if self._tokens[self._at] != token:
            return False
        self._at += 1
        return True

    def expect(self, token: str) -> None:
        """Takes ``token``."""
        if not self.accept(token):
            raise Unreadable(f"{token} expected before {self.peek() or 'the end of the line'}")

    def finish(self) -> None:
        """Nothing may be left."""
        if self._tokens[self._at]:
            raise Unreadable(f"{self._tokens[self._at][:20]!r} is not expected here")

    def rest(self) -> str:
        """What is left, taken."""
        left = " ".join(self._tokens[self._at : -1])
        self._at = len(self._tokens) - 1
        return left

    def skip(self) -> str:
        """What stands up to the bracket that closes the one just taken, which is taken too."""
        depth, start = 1, self._at
        while depth:
            token = self.take()
            depth += (token == "(") - (token == ")")
        return " ".join(self._tokens[start : self._at - 1])

    def deeper(self) -> None:
        """A bracket within brackets."""
        self._depth += 1
        if self._depth > _DEPTH:
            raise Unreadable("brackets are nested too deeply")


class Numbers(Reader, ABC):
    """Numbers, conditions and strings."""

    # -- reals ---------------------------------------------------------------------------------------------------

    def logic(self) -> float:
        """A number or a condition, with AND, OR and XOR."""
        value, joined, compared = self._both()
        while self.peek() in ("OR", "XOR"):
            combine = _JOINED[self.take()]
            other, _, beside = self._both()
            value, joined, compared = combine(value, other), True, compared or beside
        self.unbracketed = self.unbracketed or (joined and compared)
        return value

    def _both(self) -> tuple[float, bool, bool]:
        """Conditions with AND between them; whether there is one, and whether one of them compares without brackets."""
        value, compared = self._relation()
        joined = False
        while self.accept("AND"):
            other, beside = self._relation()
            value, joined, compared = _JOINED["AND"](value, other), True, compared or beside
        return value, joined, compared

    def _relation(self) -> tuple[float, bool]:
        """A number or a comparison, and whether it compares."""
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
            compare = _COMPARED[self.take()]
            value, compared = truth(compare(value, self.real())), True
        return value, compared

    def real(self) -> float:
        """A sum, finite."""
        value = self._product()
        while self.peek() in _SUMS:
            sign, other = self.take(), self._product()
            if sign in "+-":
                value += other if sign == "+" else -other
            else:
                a, b = whole(value), whole(other)
                value = signed(a | b if sign == "BOR" else a ^ b)
        if not abs(value) <= _LARGEST * 4.3:
            raise Impossible("a number is not finite or beyond any machine")
        return value

    def _product(self) -> float:
        value = self._factor()
        while self.peek() in _PRODUCTS:
            sign, other = self.take(), self._factor()
            if sign == "*":
                value *= other
            elif sign == "/":
                if other == 0:
                    raise Impossible("a division by zero")
                value /= other
            elif sign == "MOD":
                value = remainder(value, other)
            else:
                value = signed(whole(value) & whole(other))
            if not abs(value) < 1e30:
                raise Impossible("a number is not finite or beyond any machine")
        return value

    def _factor(self) -> float:
        sign = 1.0
        while self.peek() in ("+", "-"):
            sign = sign if self.take() == "+" else -sign
        token = self.take()
        if token == "(":
            return sign * self._bracketed()
        if token[0] in _DIGITS and token != ".":
            return sign * self._literal(token)
        if token in _CONSTANTS:
            return sign * _CONSTANTS[token]
        if token[0].isalpha():
            return sign * self._word(token)
        if token == "^" or token[0] == "^":
            return sign * _based(token)
        raise Unreadable(f"a number expected instead of {token!r}")

    def _literal(self, token: str) -> float:
        value = float(token)
        if not abs(value) < 1e30:
            raise Impossible("a number is not finite or beyond any machine")
        return value

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
        """``[i, j]`` after a name as text, empty where there is none and for ``[]``."""
        if not self.accept("["):
            return ""
        if self.accept("]"):
            return ""
        self.deeper()
        found = []
        while True:
            # An empty place is 0, and so is what stands in front of the last comma of a[i,].
            value = self.logic() if self.peek() not in (",", "]") else 0.0
            if not 0 <= value < 2**31:
                raise Impossible(f"{value:g} is no index of an array")
            found.append(str(int(value)))
            if not self.accept(","):
                break
        self.expect("]")
        self._depth -= 1
        return f"[{','.join(found)}]"

    def _bracketed(self) -> float:
        self.deeper()
        value = self.logic()
        self.expect(")")
        self._depth -= 1
        return value

    def _function(self, word: str) -> float:
        if word in NUMBERS:
            least, most, does = NUMBERS[word]
            self.take()
            self.deeper()
            values = self.numbers(most)
            self.expect(")")
            self._depth -= 1
            if not least <= len(values) <= most:
                raise Unreadable(f"{word} has {counted(len(values), 'argument')}")
            return float(does(*values))
        if word in OF_STRINGS:
            self.take()
            return self._of_strings(word)
        if word in _OF_LOCATIONS:
            self.take()
            return self._of_locations(word)
        return self._surroundings(word)

    def numbers(self, most: int = 64) -> list[float]:
        """Numbers with commas between them, none left out."""
        values = [self.logic()]
        while len(values) <= most and self.accept(","):
            values.append(self.logic())
        return values

    def _of_strings(self, word: str) -> float:
        kinds, least, does = OF_STRINGS[word]
        return float(does(*self._arguments(word, kinds, least)))

    def _arguments(self, word: str, kinds: str, least: int) -> list[float | str]:
        """Up to the closing bracket. kinds: $ a string, a dot a number."""
        self.deeper()
        values: list[float | str] = []
        while self.peek() != ")":
            if len(values) == len(kinds):
                raise Unreadable(f"{word} has more than {counted(len(kinds), 'argument')}")
            values.append(self.string() if kinds[len(values)] == "$" else self.logic())
            if not self.accept(","):
                break
        self.expect(")")
        self._depth -= 1
        if len(values) < least:
            raise Unreadable(f"{word} wants {counted(least, 'argument')}")
        return values

    @abstractmethod
    def _of_locations(self, word: str) -> float:
        """DX and the like."""

    def _surroundings(self, word: str) -> float:
        """A function that the surroundings answer, or a name."""
        scope = self._named()
        if word not in ASKED and word not in _OWN and word not in _FREE:
            raise (
                Unreadable(f"{word} is no function")
                if not scope.strict
                else Unreadable(f"{word} is not defined")
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
            return scope.last(name) if word == "LAST" else truth(scope.says_defined(name))
        if word in _NUMBERED:
            values = self.numbers()
            self.expect(")")
            return scope.answer(word, ",".join(f"{v:g}" for v in values), ASKED.get(word, 0.0))
        return scope.answer(word, self.skip(), ASKED.get(word, 1.0))

    def rest_of_brackets(self) -> None:
        """Up to the closing bracket, where nothing but more of a name may stand."""
        if self.accept("["):
            self.expect("]")
        self.expect(")")

    def reals(self) -> list[float]:
        """Numbers with commas between them; one that is missing is 0."""
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
        """Whether a string comes next."""
        return self.peek()[:1] in ('"', "$") and self.peek() != "$"

    # -- strings -------------------------------------------------------------------------------------------------

    def string(self) -> str:
        """Strings with + between them."""
        parts = [self._one_string()]
        while self.peek() == "+":
            self.take()
            parts.append(self._one_string())
        return join(parts)

    def _one_string(self) -> str:
        token = self.take()
        if token[0] == '"' and len(token) > 1:
            return token[1:-1]
        if token == "(":
            self.deeper()
            value = self.string()
            self.expect(")")
            self._depth -= 1
            return value
        if token[0] != "$" or token == "$":
            raise Unreadable(f"a string expected instead of {token[:20]!r}")
        if self.peek() != "(":
            return self._named().text(token + self.subscripts())
        self.take()
        if token in TEXTS:
            kinds, least, does = TEXTS[token]
            return str(does(*self._arguments(token, kinds, least)))
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
        mode = self.logic() if self.accept(",") else 0.0
        self.expect(")")
        scope = self._named()
        found, left = decode(scope.text(name), delimiters, mode)
        scope.set_text(name, left)
        return found


def _based(token: str) -> float:
    base = _BASES.get(token[1:2], 8)
    digits = token[2:] if token[1:2] in _BASES else token[1:]
    try:
        value = int(digits, base)
    except ValueError:
        raise Unreadable(f"{token[:20]} is no integer") from None
    return signed(value)
