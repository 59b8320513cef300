"""Completes small programs of tests: outputs and force are off at the start and at the end."""

from collections.abc import Iterable
from itertools import dropwhile

import numpy as np
from msgspec.structs import replace

from camgen.model.program import Columns, Force, Instruction, MoveL, Output, switch_off_first


def whole(body: Iterable[Instruction]) -> tuple[Instruction, ...]:
    """A body with instructions that switch off its outputs and its force.

    All of them are switched off first, and those that are still on at the end. A complete body is
    unchanged.
    """
    used = list(dropwhile(_is_off, body))
    last_values: dict[str, float] = {}
    newtons = 0.0
    for item in used:
        if isinstance(item, Output):
            last_values[item.signal] = item.value
        elif isinstance(item, Force):
            newtons = item.newtons
    off_outputs = [Output(name, 0.0) for name, value in last_values.items() if value]
    return (*switch_off_first(used), *off_outputs, *([Force(0.0)] if newtons else []))


def turning(body: Iterable[Instruction], speed: float) -> tuple[Instruction, ...]:
    """A body in which reorientations without a speed have this one, rad/s."""
    items = list(body)
    columns = Columns(items)
    for index in columns.at[np.flatnonzero(columns.turned & (columns.turn == 0))].tolist():
        item = items[index]
        assert isinstance(item, MoveL)
        items[index] = replace(item, turn=speed)
    return tuple(items)


def _is_off(item: Instruction) -> bool:
    return (isinstance(item, Output) and item.value == 0) or (
        isinstance(item, Force) and item.newtons == 0
    )
