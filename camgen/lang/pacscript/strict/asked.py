"""What the options of the post ask for and a PacScript program may say otherwise: frames, speeds, acceleration, marks.

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
    program writes these frames; external: %, 0: the pendant's is left as it is; internal, acceleration: %; in_mm:
    whether blends are @n.
    """

    numbers: Mapping[str, int]
    define: bool
    external: float
    internal: float
    acceleration: float
    in_mm: bool


def read_asked(options: Mapping[str, object]) -> Asked:
    """The options that are given, and for the rest the defaults of the post."""
    numbers = {kind: int(_number(options, kind, 1)) for kind in ("tool", "work")}
    external, internal = (
        _number(options, "ext_speed", 0.0),
        _number(options, "internal_speed", 10.0),
    )
    define, in_mm = options.get("define", False) is True, options.get("pass_mark", "P") == "mm"
    return Asked(numbers, define, external, internal, _number(options, "accel", 50.0), in_mm)


def _number(options: Mapping[str, object], key: str, default: float) -> float:
    value = options.get(key, default)
    return float(value) if isinstance(value, (int, float)) else default


def judge_settings(
    asked: Asked,
    numbers: Mapping[str, int],
    external: float,
    acceleration: tuple[float, ...],
) -> Iterator[str]:
    """What a motion is made with otherwise than the options ask. numbers: of tool and work; external: %, 0 where the
    text does not say it; acceleration: of Accel and Decel in %, empty before them and after Speed, which changes
    it.
    """
    for kind, wanted in asked.numbers.items():
        if numbers[kind] != wanted:
            yield f"{kind} {numbers[kind]} is on, by post.{kind} it is {wanted}"
    if abs(external - asked.external) > _SAME:
        said = f"ExtSpeed {external:g}" if external else "no ExtSpeed"
        yield f"{said}, by post.ext_speed it is {asked.external:g}" + (
            "" if asked.external else ": none"
        )
    if len(acceleration) != 2 or max(abs(one - asked.acceleration) for one in acceleration) > _SAME:
        said = ", ".join(f"{one:g}" for one in acceleration) or "not set, or not after Speed"
        yield f"Accel is {said}, by post.accel it is {asked.acceleration:g}, {asked.acceleration:g}"


def judge_internal(asked: Asked, internal: object) -> str:
    """What the internal speed, %, is otherwise than the options ask, None where the text does not say it. No motion
    runs at it, but one that somebody adds by hand will.
    """
    if internal is None:
        return f"no Speed, by post.internal_speed it is {asked.internal:g}"
    if not isinstance(internal, float):
        return f"Speed by Mps, by post.internal_speed it is {asked.internal:g}"
    if abs(internal - asked.internal) <= _SAME:
        return ""
    return f"Speed {internal:g}, by post.internal_speed it is {asked.internal:g}"


def judge_mark(asked: Asked, mark: str) -> str:
    """What a pass mark says otherwise than the options ask."""
    if mark in ("@E", "@C"):
        return f"the pass mark {mark}, which no program of the post says"
    if mark == "@P" and asked.in_mm:
        return "@P, by post.pass_mark blends are in mm"
    if mark not in ("@0", "@P") and not asked.in_mm:
        return "a blend in mm, by post.pass_mark it is @P"
    return ""
