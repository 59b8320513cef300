"""Persistent data that a program asks in loops and never sets: another task or a computer does."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping

from camgen.lang.code import Act, Branch, Code, LoopStart

from .code import Question
from .tree import (
    Assign,
    CallByName,
    Calling,
    Component,
    Connect,
    Element,
    Expr,
    Negation,
    Operation,
    Ref,
    find_root,
)
from .values import Variable

#: Types whose values a computer writes one by one, with their aliases resolved.
_TYPES = frozenset(("num", "dnum", "bool", "string"))


def find_polled(data: Mapping[str, Variable], codes: Iterable[Code]) -> list[Variable]:
    """Return the global persistent data whose values come from outside of the program.

    A condition in a loop asks for them. No statement sets them or passes them to a routine.

    data: global data, by name in lower case.
    codes: all routines of the program.
    """
    in_conditions: set[str] = set()
    given: set[str] = set()
    for code in codes:
        loop_end = 0
        for index, step in enumerate(code.steps):
            if isinstance(step, LoopStart):
                loop_end = max(loop_end, step.to)
            if isinstance(step, (Branch, LoopStart)) and index < loop_end:
                question = step.condition and step.condition.value
                if isinstance(question, Question):
                    in_conditions.update(_list_names(question.value))
            if isinstance(step, Act):
                given.update(_list_given(step.operand))
    names = sorted(in_conditions - given)
    return [data[name] for name in names if name in data and _is_polled(data[name])]


def _is_polled(variable: Variable) -> bool:
    return variable.storage == "pers" and variable.type in _TYPES and not variable.dims


def _list_names(expr: Expr | None) -> Iterator[str]:
    if isinstance(expr, Ref):
        yield expr.name.lower()
    elif isinstance(expr, Operation):
        yield from _list_names(expr.left)
        yield from _list_names(expr.right)
    elif isinstance(expr, (Negation, Component, Element)):
        yield from _list_names(expr.value if isinstance(expr, Negation) else expr.base)


def _list_given(statement: object) -> Iterator[str]:
    """Names of the data that a statement sets, or passes to a routine that may set them."""
    targets: list[Expr | None] = []
    if isinstance(statement, (Assign, Connect)):
        targets.append(statement.target)
    if isinstance(statement, Assign) and isinstance(statement.value, Calling):
        statement = statement.value
    if isinstance(statement, (Calling, CallByName)):
        targets += [*statement.args, *(value for _, value in statement.options)]
    for target in targets:
        root = None if target is None else find_root(target)
        if isinstance(root, Ref):
            yield root.name.lower()
