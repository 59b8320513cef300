"""Summary of instructions that are not shown: of another task, or of an interrupt."""

from __future__ import annotations

from collections.abc import Iterable

from camgen.model.program import Instruction, MoveC, MoveJ, MoveL, Output, Stop, Wait
from camgen.model.text import counted

#: Maximum number of outputs that are named.
_MAX_NAMED = 8


def sum_up(body: Iterable[Instruction]) -> str:
    """Outputs, stops, waits and motions in a few words."""
    items = list(body)
    outputs = dict.fromkeys(
        f"sets {item.signal} to {item.value:g}" for item in items if isinstance(item, Output)
    )
    effects = [*outputs][:_MAX_NAMED]
    if len(outputs) > _MAX_NAMED:
        effects.append(f"and {counted(len(outputs) - _MAX_NAMED, 'more', 'more')}")
    motions = sum(isinstance(item, MoveJ | MoveL | MoveC) for item in items)
    effects += ["stops"] * any(isinstance(item, Stop) for item in items)
    effects += ["waits"] * any(isinstance(item, Wait) for item in items)
    effects += [counted(motions, "motion")] * (motions > 0)
    return ", ".join(effects) or "moves nothing"
