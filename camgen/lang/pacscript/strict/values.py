"""Values of PacScript that depend on the unit of `Mps`, and the values that each type holds."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

from camgen.lang.pacscript.values import Either, Mps, Speed, Unreadable, Vector
from camgen.model.pose import Pose
from camgen.model.program import Joints


def spread(*values: object) -> list[tuple[float, ...]]:
    """The values of numbers for each unit. At least one number is an `Either`.

    Raises Unreadable for another value.
    """
    count = next(len(value.values) for value in values if isinstance(value, Either))
    return [
        value.values if isinstance(value, Either) else (require_number(value),) * count
        for value in values
    ]


def join(values: Sequence[float]) -> float | Either:
    """The values for each unit as a number if they are equal, else as an `Either`."""
    return values[0] if len(set(values)) == 1 else Either(tuple(values))


def require_number(value: object) -> float:
    """A value that is a number. Raises Unreadable for another one."""
    if not isinstance(value, float):
        raise Unreadable("only numbers can be calculated with")
    return value


def check_speed(value: object) -> Speed:
    """A value as an internal speed. Raises Unreadable if it is out of range."""
    if isinstance(value, Mps):
        numbers = value.number.values if isinstance(value.number, Either) else (value.number,)
        for number in numbers:
            if number <= 0:
                raise Unreadable(f"a speed of Mps({number:g})")
        return value
    if not isinstance(value, float):
        raise Unreadable("a speed must be a number")
    if not 0.1 <= value <= 100:
        raise Unreadable(f"a speed of {value:g} %, the controller takes 0.1 to 100")
    return value


def _is_whole(value: object) -> bool:
    numbers = value.values if isinstance(value, Either) else (value,)
    for number in numbers:
        if not isinstance(number, float) or not math.isfinite(number) or number != int(number):
            return False
    return True


#: Test of the values of each type, by its name in lower case (RC8 manual 450). Values of strings
#: are not evaluated.
TYPES: dict[str, Callable[[object], bool]] = {
    **dict.fromkeys(("integer", "byte", "bit"), _is_whole),
    **dict.fromkeys(("single", "double"), lambda value: isinstance(value, float | Either | Mps)),
    **dict.fromkeys(("position", "trans"), lambda value: isinstance(value, Pose)),
    "vector": lambda value: isinstance(value, Vector),
    "joint": lambda value: isinstance(value, Joints),
    "string": lambda _: False,
    "variant": lambda _: True,
}
