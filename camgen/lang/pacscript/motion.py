"""Parses motion statements: interpolation, pass marks, targets, options (PacScript reference)."""

from __future__ import annotations

import re
from typing import NamedTuple

from camgen.lang.pacscript.expressions import LEFT_OUT, Node, arguments, parse
from camgen.lang.pacscript.values import Unreadable

MARK = re.compile(r"@\s*(0|P|E|C|\[?\s*\d+\s*\]?)(?![\d.])\s*", re.IGNORECASE)
#: The options of a motion that have a value.
OPTION = re.compile(
    r"(speed|s|accel|a|decel|d|time|t|pose|static)\s*=\s*(.*)", re.IGNORECASE | re.DOTALL
)
EXTENDED = re.compile(r"\bExA?\s*\(", re.IGNORECASE)
#: Whether the motion is linear, by the word of the interpolation.
LINEAR = {"l": True, "p": False, "ptp": False}
_BRACKET = re.compile(r"@\s*\[")


class Goal(NamedTuple):
    """A target or a length of a motion.

    mark: pass mark "0", "P", "E", "C", or mm as a number or an expression.
    value: expression of the target or the length.
    extended: expression of Ex or ExA, None without one.
    """

    mark: str | Node
    value: Node
    extended: Node | None = None


class Motion(NamedTuple):
    """A motion statement.

    kind: interpolation in lower case, empty if the statement has none.
    goals: targets and lengths in order.
    options: expressions by the name of the option in lower case.
    at_once: Next, so that the following statement does not wait for the motion.
    """

    kind: str
    goals: tuple[Goal, ...]
    options: dict[str, Node]
    at_once: bool


def read_goal(text: str) -> Goal:
    """Parse `[@mark] value [Ex(...)|ExA(...)]`."""
    mark: str | Node = "0"
    if text.startswith("@"):
        if match := MARK.match(text):
            mark, text = match[1].strip("[] \t").upper(), text[match.end() :]
        elif _BRACKET.match(text):
            inside, text = cut_bracket(text[text.index("[") :])
            mark = parse(inside)
        else:
            raise Unreadable(f"the pass mark of {text} is not understood")
        if not text.strip():
            raise Unreadable("a pass mark without a target")
    extended = EXTENDED.search(text)
    if extended is None:
        return Goal(mark, parse(text))
    return Goal(mark, parse(text[: extended.start()]), parse(text[extended.start() :]))


def read_motion(rest: str, kinds: tuple[str, ...] = ()) -> Motion:
    """Parse the operands of a motion statement.

    kinds: words of interpolations of which one must come first; empty for a statement without one.
    """
    parts = arguments(rest)
    kind = ""
    if kinds:
        first, *parts = parts
        kind = first.lower()
        if kind not in kinds:
            raise Unreadable(f"{first[:40] or 'nothing'} is not an interpolation of this motion")
    goals, options, at_once = [], {}, False
    for part in parts:
        if "=" in part and (option := OPTION.fullmatch(part)):
            name = option[1].lower()
            options[_SHORT.get(name, name)] = parse(option[2])
        elif part.lower() == "next":
            at_once = True
        elif part == "":
            raise Unreadable("a value is missing")
        else:
            goals.append(read_goal(part))
    return Motion(kind, tuple(goals), options, at_once)


_SHORT = {"s": "speed", "a": "accel", "d": "decel", "t": "time"}


def cut_bracket(text: str) -> tuple[str, str]:
    """Split a text that begins with a bracket into the text inside and the text after it.

    Raises Unreadable if the bracket is not closed.
    """
    depth = 0
    for match in _BRACKETS.finditer(text):
        depth += (match[0] in "([") - (match[0] in ")]")
        if depth == 0:
            return text[1 : match.start()], text[match.end() :].strip()
    raise Unreadable("a bracket is not closed")


_BRACKETS = re.compile(r'"[^"]*"|[()\[\]]')


#: A `Drive` or `DriveA`: pass mark, axes with their values or joint values, and options.
Axes = tuple[str | Node, list[tuple[Node, Node]] | Node, Motion]


def read_axes(rest: str) -> Axes:
    """Parse `Drive[A] [@mark] (axis, value), ... [, options]`, or the form with joint values."""
    motion = read_motion(rest)
    if not motion.goals:
        raise Unreadable("a motion without a target")
    mark = motion.goals[0].mark
    if len(motion.goals) == 1 and motion.goals[0].value.kind != "tuple":
        return mark, motion.goals[0].value, motion
    pairs = []
    for goal in motion.goals:
        if goal.value.kind != "tuple" or len(goal.value.parts) != 2 or LEFT_OUT in goal.value.parts:
            raise Unreadable("an axis and its value in brackets are expected")
        pairs.append((goal.value.parts[0], goal.value.parts[1]))
    return mark, pairs, motion
