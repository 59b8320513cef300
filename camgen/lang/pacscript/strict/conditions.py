"""Conditions that compare `Mps` with a percentage, for each unit that it may have.

`Mps` converts a speed to a percentage of the maximum speed of the arm. This speed in mm/s depends
on the arm. A comparison is decided only if it has the same result for every arm.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from itertools import islice

from msgspec import Struct

from camgen.lang.pacscript.expressions import Node, parse
from camgen.lang.pacscript.source import Statement
from camgen.lang.pacscript.values import Either, Mps, Unreadable, Value
from camgen.lang.values import require

from .machine import StrictMachine
from .run import StrictRun
from .spelling import note_unusual
from .values import join, spread

#: Speeds at 100 % of the slowest and of the fastest arm, mm/s.
_SLOWEST, _FASTEST = 500.0, 20_000.0
#: Minimum internal speed, %. A controller may raise lower speeds to it.
_MIN_PERCENT = 0.1
#: Statements of the two questions of the post: the unit of `Mps`, and whether it is a percentage.
_QUESTIONS = (
    "if mps(0.1) > 0.2 then\nunit = 0.001\nend if",
    "if mps(100 * unit) < 0.5 or mps(100 * unit) > 20 then\ngivearm\nexit sub\nend if",
)
_WORD = re.compile(r"[\w.]+|\S|\n")
_IF = re.compile(r"if\b(.*)\bthen", re.IGNORECASE)
_WORDS = re.compile(r"\b(?:and|or)\b", re.IGNORECASE)
_COMPARISON = re.compile(r"([^<>=]+)([<>])([^<>=]+)")
_ASSIGNMENT = re.compile(r"([a-z]\w*)\s*=\s*([^=].*)", re.IGNORECASE | re.ASCII)


class Question(Struct, frozen=True):
    """A block `If ... Then` with `Mps` in its condition.

    statements: all statements of the block.
    condition: text of its condition.
    branches: statements before and after `Else`.
    """

    statements: Sequence[Statement]
    condition: str
    branches: tuple[list[Statement], list[Statement]]


def read_question(statements: Sequence[Statement], at: int) -> Question | None:
    """The block at `at`, None if it does not ask for `Mps`."""
    condition = _IF.fullmatch(_text(statements[at]))
    if condition is None or "mps" not in condition[1].lower():
        return None
    branches: tuple[list[Statement], list[Statement]] = [], []
    branch, depth = branches[0], 0
    for count, statement in enumerate(islice(statements, at + 1, None), start=2):
        words = read_words(statement)
        if words in ("end if", "endif"):
            if depth == 0:
                return Question(statements[at : at + count], condition[1], branches)
            depth -= 1
        elif depth == 0 and words.startswith("elseif"):
            return None
        elif depth == 0 and words == "else" and branch is branches[0]:
            branch = branches[1]
            continue
        depth += words.startswith("if ") and words.endswith(" then")
        branch.append(statement)
    return None


def ask_question(run: StrictRun, question: Question) -> None:
    """Runs a block that asks for `Mps`.

    A branch may assign values to names. These then depend on the unit. It may have other statements
    only if no unit takes it.
    """
    machine = run.machine
    note_unusual(machine, _text(question.statements[0]))
    machine.compares_mps = True
    _check_question(machine, question.statements)
    truth = _decide(run, question.condition)
    negation = [not value for value in truth]
    for branch, taken in zip(question.branches, (truth, negation), strict=True):
        for statement in branch if any(taken) else ():
            machine.line = statement.line
            _assign(run, _text(statement), taken)


def _check_question(machine: StrictMachine, statements: Sequence[Statement]) -> None:
    """Adds the question of the post that a block asks. Any other block is a finding.

    A branch that no arm takes is not run, so that it has to be that of the post.
    """
    words = _WORD.findall("\n".join(map(_text, statements)).lower())
    known = list(map(_WORD.findall, _QUESTIONS))
    if words not in known:
        machine.remark("Mps is asked otherwise than by the programs of the post")
    elif machine.moved:
        machine.remark("Mps is asked after the first motion")
    elif machine.forces:
        machine.remark("a force table is written before Mps is asked, which may leave the program")
    else:
        machine.questions.append(known.index(words))


def _text(statement: Statement) -> str:
    """The text of a statement, empty for motions in the usual spelling."""
    return statement.text if isinstance(statement.text, str) else ""


def read_words(statement: Statement) -> str:
    """The words of a statement in lower case, empty for motions in the usual spelling."""
    return " ".join(_text(statement).lower().split())


def _assign(run: StrictRun, text: str, taken: list[bool]) -> None:
    assignment = require(
        _ASSIGNMENT.fullmatch(text),
        Unreadable("where Mps decides, only names can be given a value"),
    )
    target = Node("name", assignment[1].lower())
    value: Value = run.evaluate(parse(assignment[2]))
    if not all(taken):
        new, old = spread(value, run.evaluate(target), Either((0.0,) * len(taken)))[:2]
        by_unit = zip(new, old, taken, strict=True)
        value = join([after if is_taken else before for after, before, is_taken in by_unit])
    run.set_variable(target, value)


def _decide(run: StrictRun, condition: str) -> list[bool]:
    """The truth of a condition, by unit."""
    joints = [word.lower() for word in _WORDS.findall(condition)]
    if len(set(joints)) > 1:
        raise Unreadable("And beside Or is not evaluated")
    comparisons = [_compare(run, part) for part in _WORDS.split(_bare(condition))]
    combine = all if joints[:1] == ["and"] else any
    return [combine(values) for values in zip(*comparisons, strict=True)]


def _bare(text: str) -> str:
    """`text` without a pair of brackets around all of it."""
    text = text.strip()
    inner = text[1:-1]
    lowest = depth = 0
    for sign in inner:
        depth += (sign == "(") - (sign == ")")
        lowest = min(lowest, depth)
    return inner if text[:1] == "(" and text[-1:] == ")" and lowest == 0 == depth else text


def _compare(run: StrictRun, text: str) -> list[bool]:
    """The result of `Mps(...) < n` or `Mps(...) > n`, by unit."""
    comparison = require(
        _COMPARISON.fullmatch(_bare(text)), Unreadable(f"{text.strip()[:60]} is not evaluated")
    )
    left = run.evaluate(parse(comparison[1].strip()))
    right = run.evaluate(parse(comparison[3].strip()))
    greater = comparison[2] == ">"
    if isinstance(right, Mps):
        left, right, greater = right, left, not greater
    if not isinstance(left, Mps) or not isinstance(right, float):
        raise Unreadable(f"{text.strip()[:60]} is not evaluated")
    return [_holds(speed, greater, right) for speed in run.machine.by_unit(left)]


def _holds(mm_s: float, greater: bool, percent: float) -> bool:
    """Whether a speed is above (`greater`) or below a percentage of the maximum speed of an arm.

    Raises Unreadable if this depends on the arm.
    """
    low, high = 100 * mm_s / _FASTEST, 100 * mm_s / _SLOWEST
    high = max(high, min(_MIN_PERCENT, 100 * mm_s))
    if greater:
        side, results = "over", {low > percent, high > percent}
    else:
        side, results = "under", {low < percent, high < percent}
    if len(results) > 1:
        raise Unreadable(f"whether {mm_s:g} mm/s is {side} {percent:g} % depends on the arm")
    return results.pop()
