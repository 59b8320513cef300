"""Data whose values rest on a branch that was assumed.

Where the text does not determine a branch or a loop, all data that its blocks may set rest on the
choice, and all that is computed from them. A fault of such a value is one only if the program
comes there with it.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any

from msgspec import Struct

from camgen.lang.code import Act, Branch, Step

from .machine import Machine
from .motions import form_of
from .tree import Assign, Calling, Maybe, Ref, Routine, find_root
from .values import Variable


def list_names(node: Any) -> Iterator[str]:
    """The names of data in an expression, a statement or a step."""
    if isinstance(node, (Ref, Maybe)):
        yield node.name
    elif isinstance(node, tuple):
        for part in node:
            yield from list_names(part)
    elif isinstance(node, Struct):
        for field in node.__struct_fields__:
            yield from list_names(getattr(node, field))


def rests(machine: Machine, node: Any) -> bool:
    """Whether an expression, a statement or a step asks for data that rest on an assumed branch."""
    return machine.has_resting and any(
        variable.is_resting for variable in _list_variables(machine, list_names(node))
    )


def rest_on(machine: Machine, step: Step) -> None:
    """Let all data that the blocks of a branch or loop may set rest on it."""
    routine = machine.scope.routine
    if routine is None:
        return
    steps = machine.codes[routine].steps
    at = next(index for index, other in enumerate(steps) if other is step)
    end = step.end if isinstance(step, Branch) else step.to
    names = _list_set(machine, steps[min(at, end) : max(at, end)], set())
    for variable in _list_variables(machine, names):
        if variable.storage != "const":
            machine.has_resting = variable.is_resting = True


def set_resting(machine: Machine, target: Any) -> None:
    """Let data rest on an assumed branch.

    target: the name of the data, or an element or a component.
    """
    for variable in _list_variables(machine, list_names(find_root(target))):
        variable.is_resting = True


def _list_variables(machine: Machine, names: Iterable[str]) -> Iterator[Variable]:
    """The data of names, of a parameter those that it is a part of."""
    for name in names:
        variable = machine.variable(name)
        while variable is not None and variable.base is not None:
            variable = variable.base[0]
        if variable is not None:
            yield variable


def _only_reads(name: str) -> bool:
    """Return whether an instruction sets none of its arguments: a motion without a search."""
    return form_of(name) is not None and not name.startswith("search")


def _list_set(machine: Machine, steps: Iterable[Step], called: set[Routine]) -> Iterator[str]:
    """The names of data that steps may set.

    called: routines whose steps are listed already.
    """
    for step in steps:
        statement = step.operand if isinstance(step, Act) else None
        if isinstance(statement, Assign):
            yield from list_names(find_root(statement.target))
        elif isinstance(statement, Calling) and not _only_reads(statement.name):
            yield from list_names(statement)
            routine = machine.routine(statement.name)
            if routine is not None and routine not in called:
                called.add(routine)
                yield from _list_set(machine, machine.codes[routine].steps, called)
