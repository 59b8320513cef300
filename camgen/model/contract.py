"""Contracts of plug-ins: a table of members with a check each, and the error for a wrong member.

Posts, read-backs and languages are foreign code. A wrong word, number or type is an error when the
plug-in is loaded or when it returns the value, not a wrong program later.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from camgen.model.body import NUMBER, Body, BodyBuilder
from camgen.model.errors import JobError, make_one_line
from camgen.model.text import counted, suggest

#: Gives the fault of a value, as the rest of a sentence about it; empty for a good value.
Check = Callable[[Any], str]
#: Characters of a value that a message shows.
_SHOWN = 60


class Member(NamedTuple):
    """A member of a plug-in.

    name: spelling of its author; "()" at the end marks a method, which is called.
    check: gives the fault of the member, or of the result of the method.
    """

    name: str
    check: Check


def check_members(plug_in: str, members: Sequence[Member], value: Any, remedy: str) -> None:
    """Raises JobError for the first of `members` of `value` that is wrong.

    plug_in: its kind and name, for the message.
    """
    for member in members:
        name = member.name.removesuffix("()")
        if not hasattr(value, name):
            raise JobError(plug_in, f"has no {member.name}", remedy=remedy)
        content = getattr(value, name)
        check_value(plug_in, member, content() if name != member.name else content, remedy)


def check_value(plug_in: str, member: Member, value: Any, remedy: str) -> None:
    """Raises JobError for a wrong `value` that the plug-in gave as `member`."""
    fault = member.check(value)
    if fault:
        raise JobError(plug_in, f"{member.name} {fault}", remedy=remedy)


def be_all(*checks: Check) -> Check:
    """A check that makes several, up to the first that finds a fault."""

    def check(value: Any) -> str:
        for single in checks:
            fault = single(value)
            if fault:
                return fault
        return ""

    return check


def be_struct(kind: type, fields: Mapping[str, Check]) -> Check:
    """A check that a value is of the type `kind` and that its `fields` pass their checks."""

    def check(value: Any) -> str:
        if not isinstance(value, kind):
            article = "an" if kind.__name__[0] in "AEIOU" else "a"
            return f"is {_show(value)}, not {article} {kind.__name__}"
        for name, single in fields.items():
            fault = single(getattr(value, name))
            if fault:
                return f"has {name} that {fault}"
        return ""

    return check


def be_empty(value: Any) -> str:
    """A check of the abstract methods that a class leaves open: none are allowed."""
    return f"must be defined: {', '.join(sorted(value))}" if value else ""


def be_callable(value: Any) -> str:
    """A check that a value is a function."""
    return "" if callable(value) else f"is {_show(value)}, not a function"


def be(kind: type | tuple[type, ...], noun: str) -> Check:
    """A check that a value is of the type `kind`; a bool is not a number."""

    def check(value: Any) -> str:
        if isinstance(value, kind) and (kind is bool or not isinstance(value, bool)):
            return ""
        return f"is {_show(value)}, not {noun}"

    return check


def be_between(low: int, high: int | None = None) -> Check:
    """A check that a value is a whole number from `low` to `high`; None: without an upper bound."""
    bounds = f"from {low} to {high}" if high is not None else f"of {low} or more"

    def check(value: Any) -> str:
        is_whole = isinstance(value, int) and not isinstance(value, bool)
        if is_whole and value >= low and (high is None or value <= high):
            return ""
        return f"is {_show(value)}, not a whole number {bounds}"

    return check


def be_text(holds: Callable[[str], object], noun: str) -> Check:
    """A check that a value is a text for which `holds` is true. noun: describes such a text."""

    def check(value: Any) -> str:
        if isinstance(value, str) and holds(value):
            return ""
        return f"is {_show(value)}, not {noun}"

    return check


def be_each(kind: type | tuple[type, ...], check: Check, noun: str) -> Check:
    """A check that a value is a collection of the type `kind` and that each element passes `check`.

    noun: describes the collection.
    """

    def check_each(value: Any) -> str:
        for element in value:
            fault = check(element)
            if fault:
                return f"has an element that {fault}"
        return ""

    return be_all(be(kind, noun), check_each)


def be_words(kind: type | tuple[type, ...], words: Collection[str], noun: str) -> Check:
    """A check that a value is a collection of the type `kind` and holds only `words`."""

    def check_words(value: Any) -> str:
        for word in sorted(value, key=repr):
            if not isinstance(word, str):
                return f"has {_show(word)}, which is not a word"
            if word not in words:
                return f"has the unknown word {word!r}, {suggest(word, words)}"
        return ""

    return be_all(be(kind, noun), check_words)


def be_body(body: Any) -> str:
    """A check that a value is a sequence of instructions."""
    if isinstance(body, (Body, BodyBuilder)):
        # Motions in columns have their types by construction.
        body = body.objects
    if not isinstance(body, Sequence) or isinstance(body, str):
        return f"is {_show(body)}, not a sequence of instructions"
    for kind in dict.fromkeys(map(type, body)):
        if kind not in NUMBER:
            return f"has an element of the type {kind.__name__}, which is not an instruction"
    return ""


def find_wrong_lines(lines: Any, count: int) -> str:
    """Gives the fault of the lines of `count` instructions: a whole number each, from 1."""
    if isinstance(lines, str) or not isinstance(lines, (Sequence, np.ndarray)):
        return f"is {_show(lines)}, not a sequence of line numbers"
    if len(lines) != count:
        return f"has {counted(len(lines), 'number')} for {counted(count, 'instruction')}"
    numbers = np.asarray(lines) if len(lines) else np.ones(1, np.intp)
    if numbers.ndim != 1 or numbers.dtype.kind not in "iu" or numbers.min() < 1:
        return "has an element that is not a line number from 1 on"
    return ""


def _show(value: object) -> str:
    text = make_one_line(repr(value))
    return text if len(text) <= _SHOWN else f"{text[: _SHOWN - 3]}..."
