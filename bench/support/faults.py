"""Faults of a kind, drawn until enough of them have an effect."""

from __future__ import annotations

import random
from collections.abc import Callable

#: The verdict on a fault that does no harm. Others are drawn in its place.
IDLE = "without effect"
#: Faults that are drawn for one that has an effect, at most.
_MOST = 200
#: A verdict, and the text that names the fault.
Verdict = tuple[str, str]


def judge_faults(
    kind: str, seed: int, count: int, judge: Callable[[int, random.Random], Verdict | None]
) -> list[Verdict]:
    """The verdicts on the faults of a kind, until `count` of them have an effect.

    judge: makes the fault of a number and judges it; None if there is nothing to change.
    RuntimeError if too many faults have no effect.
    """
    verdicts: list[Verdict] = []
    missing = count
    for number in range(_MOST * count):
        if not missing:
            return verdicts
        verdict = judge(number, random.Random(f"{seed} {kind} {number}"))
        if verdict is not None:
            verdicts.append(verdict)
            missing -= verdict[0] != IDLE
    raise RuntimeError(f"{kind}: of {_MOST * count} faults {missing} too few have an effect")
