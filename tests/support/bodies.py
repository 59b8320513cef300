"""Bodies of programs for tests, as ``Program`` demands them: off before the first motion and at the end."""

from collections.abc import Iterable
from itertools import dropwhile

import numpy as np
from msgspec.structs import replace

from camgen.model.program import Columns, Force, Instruction, MoveL, Output, put_off_first


def safe(body: Iterable[Instruction]) -> tuple[Instruction, ...]:
    """The body after the resets of all outputs and of the force that it uses, and with the outputs that it leaves on
    put off at its end. One that is so already stays as it is.
    """
    own = list(dropwhile(_is_off, body))
    left = {item.signal: item.value for item in own if isinstance(item, Output)}
    return put_off_first((*own, *(Output(signal, 0.0) for signal, value in left.items() if value)))


def turning(body: Iterable[Instruction], speed: float) -> tuple[Instruction, ...]:
    """The body with a speed, rad/s, for the motions of it that only turn the tool and have none."""
    items = list(body)
    columns = Columns(items)
    for place in columns.at[np.flatnonzero(columns.turned & (columns.turn == 0))].tolist():
        item = items[place]
        assert isinstance(item, MoveL)
        items[place] = replace(item, turn=speed)
    return tuple(items)


def _is_off(item: Instruction) -> bool:
    return (isinstance(item, Output) and item.value == 0) or (isinstance(item, Force) and item.newtons == 0)
