"""Small programs of tests as whole ones: off before the first motion what they use, and off at the end."""

from collections.abc import Iterable
from itertools import dropwhile

import numpy as np
from msgspec.structs import replace

from camgen.model.program import Columns, Force, Instruction, MoveL, Output, switch_off_first


def whole(body: Iterable[Instruction]) -> tuple[Instruction, ...]:
    """``body`` between what switches off all outputs and the force that it uses, first and, where still on, last. One
    that is whole stays as it is.
    """
    own = list(dropwhile(_is_off, body))
    left: dict[str, float] = {}
    newtons = 0.0
    for item in own:
        if isinstance(item, Output):
            left[item.signal] = item.value
        elif isinstance(item, Force):
            newtons = item.newtons
    off = [Output(name, 0.0) for name, value in left.items() if value]
    return (*switch_off_first(own), *off, *([Force(0.0)] if newtons else []))


def turning(body: Iterable[Instruction], speed: float) -> tuple[Instruction, ...]:
    """``body`` with a speed, rad/s, for the motions of it that only turn the tool and have none."""
    items = list(body)
    columns = Columns(items)
    for place in columns.at[np.flatnonzero(columns.turned & (columns.turn == 0))].tolist():
        item = items[place]
        assert isinstance(item, MoveL)
        items[place] = replace(item, turn=speed)
    return tuple(items)


def _is_off(item: Instruction) -> bool:
    return (isinstance(item, Output) and item.value == 0) or (
        isinstance(item, Force) and item.newtons == 0
    )
