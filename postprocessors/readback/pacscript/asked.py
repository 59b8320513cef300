"""What the options of the post ask for and a PacScript program may say otherwise: frames, external speed, acceleration.

A controller takes all of it, so that each is a remark: harmless in a program written by hand, in one of ours the sign
of a changed text.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from msgspec import Struct

#: Two numbers are the same within half of the last digit that the post prints of them, %.
_SAME = 0.000051


class Asked(Struct, frozen=True):
    """Options of the post, its defaults where they are not given. numbers: of tool and work; define: whether the
    program writes these frames; external: %, 0: the pendant's is left as it is; acceleration: %.
    """

    numbers: Mapping[str, int]
    define: bool
    external: float
    acceleration: float


def read_asked(options: Mapping[str, object]) -> Asked:
    """The options that are given, and for the rest the defaults of the post."""
    numbers = {kind: int(_number(options, kind, 1)) for kind in ("tool", "work")}
    external, acceleration = _number(options, "ext_speed", 0.0), _number(options, "accel", 50.0)
    return Asked(numbers, options.get("define", False) is True, external, acceleration)


def _number(options: Mapping[str, object], key: str, default: float) -> float:
    value = options.get(key, default)
    return float(value) if isinstance(value, (int, float)) else default


def judge_settings(
    asked: Asked, numbers: Mapping[str, int], external: float, acceleration: tuple[float, ...] | None
) -> Iterator[str]:
    """What a motion is made with otherwise than the options ask. numbers: of tool and work; external: %, 0 where the
    text does not say it; acceleration: of Accel and Decel in %, empty where they do not hold any more, None where the
    text has said neither them nor Speed.
    """
    for kind, wanted in asked.numbers.items():
        if numbers[kind] != wanted:
            yield f"{kind} {numbers[kind]} is on, by post.{kind} it is {wanted}"
    if abs(external - asked.external) > _SAME:
        said = f"ExtSpeed {external:g}" if external else "no ExtSpeed"
        yield f"{said}, by post.ext_speed it is {asked.external:g}" + ("" if asked.external else ": none")
    if acceleration is None:
        return
    if len(acceleration) != 2 or max(abs(one - asked.acceleration) for one in acceleration) > _SAME:
        said = ", ".join(f"{one:g}" for one in acceleration) or "not set after Speed"
        yield f"Accel is {said}, by post.accel it is {asked.acceleration:g}, {asked.acceleration:g}"
