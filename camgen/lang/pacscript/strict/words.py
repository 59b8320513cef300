"""What a declared type of PacScript can hold of the values that the read-back knows (RC8 manual 450)."""

from __future__ import annotations

import math
from collections.abc import Callable

from camgen.model.pose import Pose
from camgen.model.program import Joints

from .values import Either, Mps, Value, Vector


def _is_whole(value: Value) -> bool:
    numbers = value.values if isinstance(value, Either) else (value,)
    return all(isinstance(one, float) and math.isfinite(one) and one == int(one) for one in numbers)


def _is_number(value: Value) -> bool:
    return isinstance(value, (float, Either, Mps))


def _is_position(value: Value) -> bool:
    return isinstance(value, Pose)


#: What a variable of each type holds as it is, lower case; a string holds nothing that is evaluated.
TYPES: dict[str, Callable[[Value], bool]] = {
    **dict.fromkeys(("integer", "byte", "bit"), _is_whole),
    **dict.fromkeys(("single", "double"), _is_number),
    **dict.fromkeys(("position", "trans"), _is_position),
    "vector": lambda value: isinstance(value, Vector),
    "joint": lambda value: isinstance(value, Joints),
    "string": lambda _: False,
    "variant": lambda _: True,
}
