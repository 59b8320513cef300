"""The order in which the read-back carries out the statements of a V+ program."""

from __future__ import annotations

from collections.abc import Callable

from .text import Routine, Statement, Stretch, Unreadable, one_by_one

Fault = Callable[[Statement, Unreadable], None]


def walk(
    routine: Routine,
    step: Callable[[int, Statement], int],
    stretch: Callable[[Stretch], None],
    fault: Fault,
) -> None:
    """Carries out the statements of a program from its first on. step: carries out one and gives the index of the next;
    behind one that it cannot, which ``fault`` is told, the walk goes on, behind the whole block that it opens. stretch:
    carries out motions that were read together.
    """
    statements, index = routine.statements, 0
    while index < len(statements):
        statement = statements[index]
        if isinstance(statement, Stretch):
            stretch(statement)
            index += 1
            continue
        try:
            index = step(index, statement)
        except Unreadable as error:
            fault(statement, error)
            index = routine.partner.get(index, index) + 1


def walk_apart(plain: Stretch, do: Callable[[Statement], None], fault: Fault) -> None:
    """Carries out motions that were read together one by one."""
    for statement in one_by_one(plain):
        try:
            do(statement)
        except Unreadable as error:
            fault(statement, error)
