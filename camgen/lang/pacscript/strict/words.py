"""Types of PacScript variables, as tests of the values that they can hold (RC8 manual 450)."""

from __future__ import annotations

import math
from collections.abc import Callable

from camgen.model.pose import Pose
from camgen.model.program import Joints

from .values import Either, Mps, Value, Vector


def _is_whole(value: Value) -> bool:
    numbers = value.values if isinstance(value, Either) else (value,)
    for number in numbers:
        if not isinstance(number, float) or not math.isfinite(number) or number != int(number):
            return False
    return True


def _is_number(value: Value) -> bool:
    return isinstance(value, (float, Either, Mps))


def _is_position(value: Value) -> bool:
    return isinstance(value, Pose)


#: Test of the values of each type, by its name in lower case. Values of strings are not evaluated.
TYPES: dict[str, Callable[[Value], bool]] = {
    **dict.fromkeys(("integer", "byte", "bit"), _is_whole),
    **dict.fromkeys(("single", "double"), _is_number),
    **dict.fromkeys(("position", "trans"), _is_position),
    "vector": lambda value: isinstance(value, Vector),
    "joint": lambda value: isinstance(value, Joints),
    "string": lambda _: False,
    "variant": lambda _: True,
}
