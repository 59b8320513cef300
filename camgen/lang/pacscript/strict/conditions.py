"""Conditions that the text alone decides: those that compare ``Mps`` with a percentage, for each unit it may have.

``Mps`` gives the percentage of the arm's greatest speed. What that is in mm/s depends on the arm, so that a comparison
is only decided where it comes out the same for every arm.
"""

from __future__ import annotations

import re
from functools import cache
from itertools import islice

from camgen.lang.pacscript.plain import Plain

from .machine import Machine
from .text import Statement
from .values import Either, Mps, Unreadable, evaluate, join, spread

#: mm/s at 100 % of the slowest and of the fastest arm; and the least internal speed, %, to which a controller may raise
#: what is below.
_SLOWEST, _FASTEST, _LEAST = 500.0, 20_000.0, 0.1
#: The questions of the post, each by its statements: in which unit ``Mps`` is, and whether it is a percentage at all.
_QUESTIONS = (
    ("if mps(0.1) > 0.2 then", "unit = 0.001", "end if"),
    ("if mps(100 * unit) < 0.5 or mps(100 * unit) > 20 then", "givearm", "exit sub", "end if"),
)
_WORD = re.compile(r"[\w.]+|\S")
_IF = re.compile(r"if\b(.*)\bthen", re.IGNORECASE)
_WORDS = re.compile(r"\b(?:and|or)\b", re.IGNORECASE)
_COMPARISON = re.compile(r"([^<>=]+)([<>])([^<>=]+)")
_ASSIGNMENT = re.compile(r"([a-z]\w*)\s*=\s*([^=].*)", re.IGNORECASE | re.ASCII)


def carry_out_if(machine: Machine, statements: list[Statement], at: int) -> int | None:
    """Carries out a block ``If ... Then`` on ``Mps``; by how many statements to go on, None for another condition.

    In its branches names may be given values, which then depend on the unit. Other statements may only stand in a
    branch that is not gone into.
    """
    found = _IF.fullmatch(_text(statements[at]))
    if found is None or "mps" not in found[1].lower():
        return None
    branches, count = _branches(statements, at)
    if count == 0:
        return None
    machine.asked = True
    try:
        _hold_question(machine, statements[at : at + count])
        truth = _decide(machine, found[1])
        for branch, taken in zip(branches, (truth, [not one for one in truth]), strict=True):
            for statement in branch if any(taken) else ():
                machine.line = statement.line if isinstance(statement, Plain) else statement[0]
                _assign(machine, _text(statement), taken)
    except Unreadable as error:
        machine.fault(str(error))
        machine.here = None
    return count


def _hold_question(machine: Machine, statements: list[Statement]) -> None:
    """Notes which question of the post is asked, and a remark on any other one.

    A branch that no arm takes is not carried out, so it has to be the one of the post.
    """
    words = [_words(_text(statement)) for statement in statements]
    if words not in _known_questions():
        machine.remark("Mps is asked otherwise than by the programs of the post")
    elif machine.moved:
        machine.remark("Mps is asked after the first motion")
    elif machine.forces:
        machine.remark("a force table is written before Mps is asked, which may leave the program")
    else:
        machine.questions.append(_known_questions().index(words))


def _words(text: str) -> list[str]:
    return _WORD.findall(text.lower())


@cache
def _known_questions() -> list[list[list[str]]]:
    return [[_words(text) for text in question] for question in _QUESTIONS]


def _text(statement: Statement) -> str:
    return "" if isinstance(statement, Plain) else statement[1]


def _branches(
    statements: list[Statement], at: int
) -> tuple[tuple[list[Statement], list[Statement]], int]:
    """What stands before and after ``Else`` and how many statements the whole is; 0 for a block of another kind."""
    then: list[Statement] = []
    other: list[Statement] = []
    branch, depth = then, 0
    for count, statement in enumerate(islice(statements, at + 1, None), start=2):
        words = " ".join(_text(statement).lower().split())
        if words in ("end if", "endif"):
            if depth == 0:
                return (then, other), count
            depth -= 1
        elif depth == 0 and words.startswith("elseif"):
            break
        elif depth == 0 and words == "else" and branch is then:
            branch = other
            continue
        depth += words.startswith("if ") and words.endswith(" then")
        branch.append(statement)
    return (then, other), 0


def _assign(machine: Machine, text: str, taken: list[bool]) -> None:
    """A value for a name, by the units for which this branch is gone into."""
    assignment = _ASSIGNMENT.fullmatch(text)
    if assignment is None:
        raise Unreadable("where Mps decides, only names can be given a value")
    name = assignment[1].lower()
    value = evaluate(assignment[2], machine.lookup)
    if not all(taken):
        new, old = spread(value, machine.lookup(name), Either((0.0,) * len(taken)))[:2]
        value = join([a if go else b for a, b, go in zip(new, old, taken, strict=True)])
    machine.name(name, value)


def _decide(machine: Machine, condition: str) -> list[bool]:
    """The truth of a condition, by unit."""
    joints = [word.lower() for word in _WORDS.findall(condition)]
    if len(set(joints)) > 1:
        raise Unreadable("And beside Or is not evaluated")
    single = [_compare(machine, part) for part in _WORDS.split(_bare(condition))]
    return [(all if joints[:1] == ["and"] else any)(values) for values in zip(*single, strict=True)]


def _bare(text: str) -> str:
    """``text`` without a pair of brackets around all of it."""
    text = text.strip()
    inner = text[1:-1]
    lowest = depth = 0
    for sign in inner:
        depth += (sign == "(") - (sign == ")")
        lowest = min(lowest, depth)
    return inner if text[:1] == "(" and text[-1:] == ")" and lowest == 0 == depth else text


def _compare(machine: Machine, text: str) -> list[bool]:
    """Whether ``Mps(...) < n`` or ``Mps(...) > n``, by unit."""
    found = _COMPARISON.fullmatch(_bare(text))
    if found is None:
        raise Unreadable(f"{text.strip()[:60]} is not evaluated")
    left, right = (evaluate(side.strip(), machine.lookup) for side in (found[1], found[3]))
    greater = found[2] == ">"
    if isinstance(right, Mps):
        left, right, greater = right, left, not greater
    if not isinstance(left, Mps) or not isinstance(right, float):
        raise Unreadable(f"{text.strip()[:60]} is not evaluated")
    return [_holds(speed, greater, right) for speed in machine.by_unit(left)]


def _holds(mm_s: float, greater: bool, percent: float) -> bool:
    """Whether a speed is above, else below so many percent of an arm's greatest one, the same for all arms."""
    low, high = 100 * mm_s / _FASTEST, 100 * mm_s / _SLOWEST
    high = max(high, min(_LEAST, 100 * mm_s))
    least, most = (low > percent, high > percent) if greater else (high < percent, low < percent)
    if least != most:
        raise Unreadable(
            f"whether {mm_s:g} mm/s is {'over' if greater else 'under'} {percent:g} % depends on the arm"
        )
    return least
