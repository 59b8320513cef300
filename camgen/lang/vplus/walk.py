"""Runs consecutive motions one by one."""

from __future__ import annotations

from collections.abc import Callable

from .text import Statement, Stretch, Unreadable, split_stretch


def walk_apart(
    plain: Stretch,
    do: Callable[[Statement], None],
    fault: Callable[[Statement, Unreadable], None],
) -> None:
    """Run the motions of a stretch with `do`. fault: called for those that raise Unreadable."""
    for statement in split_stretch(plain):
        try:
            do(statement)
        except Unreadable as error:
            fault(statement, error)
