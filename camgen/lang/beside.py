"""What a program does beside the one that is shown: another task, an interrupt that does not come."""

from __future__ import annotations

from collections.abc import Iterable

from camgen.model.program import Instruction, MoveC, MoveJ, MoveL, Output, Stop, Wait
from camgen.model.text import counted

#: So many outputs are named.
_MOST = 8


def sum_up(body: Iterable[Instruction]) -> str:
    """Outputs, stops, waits and motions in a few words."""
    done = list(body)
    said = list(
        dict.fromkeys(
            f"sets {item.signal} to {item.value:g}" for item in done if isinstance(item, Output)
        )
    )
    if len(said) > _MOST:
        said = [*said[:_MOST], f"and {counted(len(said) - _MOST, 'more', 'more')}"]
    motions = sum(isinstance(item, MoveJ | MoveL | MoveC) for item in done)
    said += ["stops"] * any(isinstance(item, Stop) for item in done)
    said += ["waits"] * any(isinstance(item, Wait) for item in done)
    said += [counted(motions, "motion")] * (motions > 0)
    return ", ".join(said) or "moves nothing"
