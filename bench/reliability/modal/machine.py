"""What a program text does, by the least that the manuals say: one small simulation of the modal state a language.

They judge the read-backs, so they import nothing of them. Each gives the trace of a text: its motions with all that
holds while they run, its outputs, waits and whatever else it says. A statement that a simulation does not know goes
into the trace word by word, and so does one that the controller would refuse: such a text is never taken for another.
What a trace leaves out means nothing: comments, blanks, the case of letters, a setting made again.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Sequence
from functools import reduce
from typing import NamedTuple

import numpy as np

from bench.support.motions import find_arc, place_motion

#: By how much a number may differ and still be the printed one: of a speed and a force what a build forgives, of an
#: orientation ("deg", and "turn", an entry of a quaternion or a rotation matrix) what it forgives too, 1e-5 rad, of an
#: arc's middle ("arc", mm) the bound of ``camgen.post.verify``, 0.003, and the rounding of the text beside it. What has
#: no unit is exact.
DIGITS = {
    "": 0.0, "mm": 1e-3, "arc": 4.5e-3, "deg": 1e-3, "turn": 1.1e-5, "mm/s": 1e-2, "deg/s": 1e-3, "%": 1e-4, "s": 1e-3,
    "N": 1e-2,
}  # fmt: skip


class Number(NamedTuple):
    """A number of a text. unit: a key of ``DIGITS``."""

    value: float
    unit: str = ""


#: Words after which a value begins.
_BEGINS_VALUE = ("(", ",", "=", "+", "-", "*", "/", "speed")
Atom = str | Number
Event = tuple[Atom, ...]
Point = tuple[float, float, float]
Matrix = np.ndarray


def is_same(one: Sequence[Event], other: Sequence[Event]) -> bool:
    """Whether two traces say the same within the printed digits."""
    return len(one) == len(other) and all(map(_is_alike, one, other))


def _is_alike(one: Event, other: Event) -> bool:
    return len(one) == len(other) and all(map(_is_close, one, other))


def _is_close(one: Atom, other: Atom) -> bool:
    if isinstance(one, Number) and isinstance(other, Number):
        return one.unit == other.unit and abs(one.value - other.value) <= DIGITS[one.unit] * (
            1 + 1e-6
        )
    return one == other


class Machine:
    """The trace so far and the state: what holds until it is set again."""

    def __init__(self) -> None:
        self.trace: list[Event] = []
        self.state: dict[str, Event] = {}
        self.outputs: dict[str, Event] = {}

    def hold(self, name: str, *value: Atom) -> None:
        """A setting, which only shows in the motions after it."""
        self.state[name] = value

    def switch(self, name: str, *value: Atom) -> None:
        """An output; set again to what it is, it says nothing."""
        if self.outputs.get(name) != value:
            self.outputs[name] = value
            self.say("output", name, *value)

    def say(self, *event: Atom) -> None:
        """Something that happens."""
        self.trace.append(event)

    def tell(self, words: Sequence[str]) -> None:
        """A statement that is not understood, or that calls another: afterwards no output is known for sure."""
        self.outputs.clear()
        self.say("says", *atoms(words))

    def leave(self) -> None:
        """The end or the begin of a routine: what was set before it shows, and counts no more."""
        self.move("leaves")
        self.state.clear()

    def move(self, *event: Atom) -> None:
        """A motion, with all that holds for it."""
        self.say(
            *event, *(part for name in sorted(self.state) for part in (name, *self.state[name]))
        )

    def end(self) -> list[Event]:
        """The whole trace, with the state that is left behind."""
        self.move("end")
        return self.trace


def as_number(words: Sequence[str]) -> float | None:
    """The number that a few words are, a sign before it or none."""
    sign, digits = (words[0], words[1:]) if words and words[0] in ("-", "+") else ("", words)
    if len(digits) != 1 or not re.match(r"[\d.]", digits[0]):
        return None
    try:
        value = float(digits[0])
    except ValueError:
        return None
    return -value if sign == "-" else value


def work_out(words: Sequence[str]) -> float | None:
    """A number, or sums and products of numbers; None for anything else."""
    if not re.fullmatch(r"[-+]? ?[\d.]+(?: [-+*] [-+]? ?[\d.]+)*", " ".join(words)):
        return as_number(words)
    total, product, sign = 0.0, None, 1.0
    for k, word in enumerate(words):
        value = as_number([word])
        if value is not None:
            product = sign * value if product is None else product * sign * value
            sign = 1.0
        elif word == "*":
            continue
        elif k and words[k - 1] not in ("+", "-", "*"):
            total, product, sign = total + (product or 0.0), None, -1.0 if word == "-" else 1.0
        elif word == "-":
            sign = -sign
    return total + (product or 0.0)


def rename(
    lines: Sequence[list[str]], names: Sequence[str], is_free: Callable[[str], bool]
) -> list[list[str]]:
    """Statements in which routines are named by the order in which they appear.

    The name of a routine means nothing: callers and declaration agree, or the text is refused.

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
        for word in words:
            if order.get(word) == "":
                count += 1
                order[word] = f"routine.{count}"
        renamed.append([order.get(word, word) for word in words])
    return renamed


def unbracket(words: Sequence[str]) -> list[str]:
    """Words without the brackets around a single number that begins a value."""
    plain: list[str] = []
    for word in words:
        plain.append(word)
        bracket = plain[-3:-2] == ["("] and word == ")" and as_number(plain[-2:-1]) is not None
        if bracket and plain[-4:-3] and plain[-4] in _BEGINS_VALUE:
            plain[-3:] = [plain[-2]]
    return plain


def atom(word: str) -> Atom:
    """A word, or the number that it is: 5 and 5.000 are one."""
    value = as_number([word])
    return word if value is None else Number(value)


def atoms(words: Sequence[str]) -> Event:
    """Words and numbers, without the sign of a 0 that begins a value."""
    bare = ("=", ",", "(", "[", ":=")
    kept = [
        word
        for k, word in enumerate(words)
        if not (
            word == "-"
            and words[k - 1 : k]
            and words[k - 1] in bare
            and as_number(words[k : k + 2]) == 0
        )
    ]
    return tuple(map(atom, kept))


def split(words: Sequence[str], mark: str = ",") -> list[list[str]]:
    """``words`` between the marks that stand in no bracket."""
    parts: list[list[str]] = [[]]
    depth = 0
    for word in words:
        depth += (word in ("(", "[")) - (word in (")", "]"))
        if word == mark and depth == 0:
            parts.append([])
        else:
            parts[-1].append(word)
    return parts


def arguments(
    words: Sequence[str], name: str, count: int, omitted: bool = False
) -> list[float] | None:
    """The numbers of ``name(...)``, at least one and at most ``count``; None where ``words`` is nothing like that.

    omitted: what stands empty between commas is 0.
    """
    if len(words) < 4 or words[0] != name or words[1] != "(" or words[-1] != ")":
        return None
    values = [0.0 if omitted and not part else work_out(part) for part in split(words[2:-1])]
    known = [value for value in values if value is not None]
    return known if len(known) == len(values) <= count else None


def turn(axis: int, degrees: float) -> Matrix:
    """The rotation about x, y or z (0, 1, 2)."""
    c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    j, k = (axis + 1) % 3, (axis + 2) % 3
    rotation = np.eye(3)
    rotation[[j, j, k, k], [j, k, j, k]] = c, -s, s, c
    return rotation


def turned(*rotations: Matrix) -> Event:
    """The entries of a product of rotations: triples of angles that turn alike are alike."""
    product = reduce(np.matmul, rotations)
    return tuple(Number(value, "turn") for value in product.ravel().tolist())


def arc(start: Point, via: Point, end: Point) -> Event:
    """An arc by the point half-way on it, wherever ``via`` lies between a fifth and four fifths of its angle; by
    ``via`` itself where it lies elsewhere or the three are on one line.
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
    if not 0.2 < to_via / angle < 0.8:
        return ("via near an end", *plain)
    middle = place_motion(*points, np.array([0.5]))[0]
    return ("half-way", *(Number(value, "arc") for value in middle.tolist()))
