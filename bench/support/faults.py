"""Faults of a kind, drawn until enough of them have an effect."""

from __future__ import annotations

import random
from collections.abc import Callable

#: The verdict on a fault that does no harm. Others are drawn in its place.
IDLE = "without effect"
#: Largest number of faults that are drawn for each one with an effect.
_MOST = 200
#: A verdict, and the text that names the fault.
Verdict = tuple[str, str]


def try_faults(
    kind: str, seed: int, count: int, try_fault: Callable[[int, random.Random], Verdict | None]
) -> list[Verdict]:
    """The verdicts on the faults of a kind, until `count` of them have an effect.

    try_fault: makes the fault of a number and judges it; None if there is nothing to change.
    RuntimeError if too many faults have no effect.
    """
    verdicts: list[Verdict] = []
    missing = count
    for number in range(_MOST * count):
        if not missing:
            return verdicts
        verdict = try_fault(number, random.Random(f"{seed} {kind} {number}"))
        if verdict is not None:
            verdicts.append(verdict)
            missing -= verdict[0] != IDLE
    raise RuntimeError(f"{kind}: of {_MOST * count} faults {missing} too few have an effect")
