"""Effects of a program text by the manuals: a simulation of the modal state for each language.

The simulations judge the read-backs, so they import nothing of them. Each gives the trace of a
text: its motions with all settings that hold while they run, its outputs, its waits and its other
statements. A statement that a simulation does not know, or that the controller would refuse, is in
the trace word by word: such a text never counts as equal to another. Comments, blanks, letter case
and a setting that is made again have no effect and are not in a trace.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Sequence
from functools import reduce
from typing import NamedTuple

import numpy as np

from bench.support.motions import find_arc, place_motion

#: Largest differences of equal numbers by unit. Speeds, forces and orientations ("deg", and "turn",
#: an entry of a quaternion or a rotation matrix: 1e-5 rad) have the tolerances of a build. The via
#: point of an arc ("arc", mm) has the bound of `camgen.post.verify`, 0.003, and the rounding of the
#: text. A number without a unit is exact.
DIGITS = {
    "": 0.0,
    "mm": 1e-3,
    "arc": 4.5e-3,
    "deg": 1e-3,
    "turn": 1.1e-5,
    "mm/s": 1e-2,
    "deg/s": 1e-3,
    "%": 1e-4,
    "s": 1e-3,
    "N": 1e-2,
}
#: Words after which a value begins.
_BEGINS_VALUE = ("(", ",", "=", "+", "-", "*", "/", "speed")
#: Words between which a sign belongs to a number.
_BEFORE_SIGN = ("=", ",", "(", "[", ":=")
#: Part of the angle of an arc, on either side of its middle, in which a via point is exact.
_NEAR_END = 0.2


class Number(NamedTuple):
    """A number of a text. unit: a key of `DIGITS`."""

    value: float
    unit: str = ""


Atom = str | Number
Event = tuple[Atom, ...]
Point = tuple[float, float, float]
Matrix = np.ndarray


def is_same(first: Sequence[Event], second: Sequence[Event]) -> bool:
    """Whether two traces are equal within the printed digits."""
    return len(first) == len(second) and all(map(_is_alike, first, second))


def _is_alike(first: Event, second: Event) -> bool:
    return len(first) == len(second) and all(map(_is_close, first, second))


def _is_close(first: Atom, second: Atom) -> bool:
    if isinstance(first, Number) and isinstance(second, Number):
        limit = DIGITS[first.unit] * (1 + 1e-6)
        return first.unit == second.unit and abs(first.value - second.value) <= limit
    return first == second


class Machine:
    """The trace so far and the modal state.

    trace: events
    state: settings that hold until they are made again, by name
    outputs: last value of each output
    """

    def __init__(self) -> None:
        self.trace: list[Event] = []
        self.state: dict[str, Event] = {}
        self.outputs: dict[str, Event] = {}

    def keep(self, name: str, *value: Atom) -> None:
        """Makes a setting, which is in the trace with the motions after it alone."""
        self.state[name] = value

    def switch(self, name: str, *value: Atom) -> None:
        """Sets an output. It is in the trace if the value is another one."""
        if self.outputs.get(name) != value:
            self.outputs[name] = value
            self.add("output", name, *value)

    def add(self, *event: Atom) -> None:
        """Adds an event."""
        self.trace.append(event)

    def add_statement(self, words: Sequence[str]) -> None:
        """Adds a statement that is not interpreted, or a call. Outputs are unknown after it."""
        self.outputs.clear()
        self.add("says", *read_atoms(words))

    def leave(self) -> None:
        """Adds the state at the start or end of a routine, and forgets it."""
        self.move("leaves")
        self.state.clear()

    def move(self, *event: Atom) -> None:
        """Adds a motion with all settings that hold for it."""
        settings: list[Atom] = []
        for name in sorted(self.state):
            settings += (name, *self.state[name])
        self.add(*event, *settings)

    def end(self) -> list[Event]:
        """The whole trace, with the state at the end."""
        self.move("end")
        return self.trace


def as_number(words: Sequence[str]) -> float | None:
    """The number of words that are a number with or without a sign, else None."""
    has_sign = len(words) > 0 and words[0] in ("-", "+")
    digits = words[1:] if has_sign else words
    if len(digits) != 1 or not re.match(r"[\d.]", digits[0]):
        return None
    try:
        value = float(digits[0])
    except ValueError:
        return None
    return -value if has_sign and words[0] == "-" else value


def work_out(words: Sequence[str]) -> float | None:
    """The value of a number, or of sums and products of numbers, else None."""
    if not re.fullmatch(r"[-+]? ?[\d.]+(?: [-+*] [-+]? ?[\d.]+)*", " ".join(words)):
        return as_number(words)
    total, product, sign = 0.0, None, 1.0
    for place, word in enumerate(words):
        value = as_number([word])
        if value is not None:
            product = sign * value if product is None else product * sign * value
            sign = 1.0
        elif word == "*":
            continue
        elif place and words[place - 1] not in ("+", "-", "*"):
            total += product or 0.0
            product = None
            sign = -1.0 if word == "-" else 1.0
        elif word == "-":
            sign = -sign
    return total + (product or 0.0)


def rename(
    lines: Sequence[list[str]], names: Sequence[str], is_free: Callable[[str], bool]
) -> list[list[str]]:
    """Statements in which routines are named by the order in which they appear.

    The name of a routine has no effect: callers and declaration agree, or the text is refused.

    lines: words of each statement
    names: declared routines that may have any name; all keep theirs if two are alike or not free
    is_free: whether the language takes a name for a routine
    """
    if len(set(names)) < len(names) or not all(map(is_free, names)):
        return list(lines)
    order: dict[str, str] = dict.fromkeys(names, "")
    count = 0
    renamed = []
    for words in lines:
        named: list[str] = []
        for word in words:
            # A backslash begins the name of an argument.
            is_routine = word in order and named[-1:] != ["\\"]
            if is_routine and order[word] == "":
                count += 1
                order[word] = f"routine.{count}"
            named.append(order[word] if is_routine else word)
        renamed.append(named)
    return renamed


def unbracket(words: Sequence[str]) -> list[str]:
    """Words without the brackets around a single number that begins a value."""
    plain: list[str] = []
    for word in words:
        plain.append(word)
        is_bracket = plain[-3:-2] == ["("] and word == ")" and as_number(plain[-2:-1]) is not None
        if is_bracket and plain[-4:-3] and plain[-4] in _BEGINS_VALUE:
            plain[-3:] = [plain[-2]]
    return plain


def read_atom(word: str) -> Atom:
    """A word, or the number that it is: 5 and 5.000 are equal."""
    value = as_number([word])
    return word if value is None else Number(value)


def read_atoms(words: Sequence[str]) -> Event:
    """Words and numbers, without the sign of a 0 that begins a value."""
    atoms: list[Atom] = []
    for place, word in enumerate(words):
        is_sign = word == "-" and place > 0 and words[place - 1] in _BEFORE_SIGN
        if not (is_sign and as_number(words[place : place + 2]) == 0):
            atoms.append(read_atom(word))
    return tuple(atoms)


def split(words: Sequence[str], mark: str = ",") -> list[list[str]]:
    """Words between the marks that are outside of all brackets."""
    parts: list[list[str]] = [[]]
    depth = 0
    for word in words:
        depth += (word in ("(", "[")) - (word in (")", "]"))
        if word == mark and depth == 0:
            parts.append([])
        else:
            parts[-1].append(word)
    return parts


def read_arguments(
    words: Sequence[str], name: str, count: int, *, may_omit: bool = False
) -> list[float] | None:
    """The numbers of `name(...)`, 1 to `count` of them; None for other words.

    may_omit: whether an empty place between commas is 0
    """
    if len(words) < 4 or words[0] != name or words[1] != "(" or words[-1] != ")":
        return None
    numbers = []
    for part in split(words[2:-1]):
        value = 0.0 if may_omit and not part else work_out(part)
        if value is None:
            return None
        numbers.append(value)
    return numbers if len(numbers) <= count else None


def rotate(axis: int, degrees: float) -> Matrix:
    """The rotation about x, y or z (0, 1, 2), (3, 3)."""
    c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    j, k = (axis + 1) % 3, (axis + 2) % 3
    rotation = np.eye(3)
    rotation[[j, j, k, k], [j, k, j, k]] = c, -s, s, c
    return rotation


def multiply(*rotations: Matrix) -> Event:
    """The entries of a product of rotations, which are equal for equal orientations."""
    product = reduce(np.matmul, rotations)
    return tuple(Number(value, "turn") for value in product.ravel().tolist())


def describe_arc(start: Point, via: Point, end: Point) -> Event:
    """An arc by its middle if `via` is away from both ends, else by `via` itself.

    Points on one line are described by `via`, too.
    """
    points = np.array(start), np.array(via), np.array(end)
    plain = tuple(Number(value, "mm") for value in via)
    chord = points[2] - points[0]
    normal = np.cross(points[1] - points[0], chord)
    if normal @ normal < 1e-12 * max(1.0, (chord @ chord) ** 2):
        return ("via", *plain)
    centre, axis, angle = find_arc(*points)
    spoke, arm = points[0] - centre, points[1] - centre
    to_via = math.atan2(arm @ np.cross(axis, spoke), arm @ spoke) % math.tau
    if not _NEAR_END < to_via / angle < 1.0 - _NEAR_END:
        return ("via near an end", *plain)
    middle = place_motion(*points, np.array([0.5]))[0]
    return ("half-way", *(Number(value, "arc") for value in middle.tolist()))
