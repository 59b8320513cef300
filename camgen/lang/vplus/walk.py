"""Motions that were read together, carried out one by one."""

from __future__ import annotations

from collections.abc import Callable

from .text import Statement, Stretch, Unreadable, one_by_one


def walk_apart(
    plain: Stretch,
    do: Callable[[Statement], None],
    fault: Callable[[Statement, Unreadable], None],
) -> None:
    """Carry out the motions of a stretch one by one. fault: takes those that cannot be."""
    for statement in one_by_one(plain):
        try:
            do(statement)
        except Unreadable as error:
            fault(statement, error)
