"""Text of a PacScript program that follows from options of the post.

It is the frames, speeds, accelerations and pass marks. A controller accepts other text too, so that
a difference is unusual, not refused. In a program of a post it shows that the text was changed.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from msgspec import Struct

from camgen.lang.post_options import read_number

#: Maximum difference of two equal numbers, %: half of the last digit that the post prints.
_SAME = 0.000051


class Expected(Struct, frozen=True):
    """Options of the post, or its defaults.

    numbers: numbers of the tool and work frame, by "tool" and "work".
    define: whether the program writes these frames.
    external: external speed, %. 0: the program leaves that of the pendant.
    internal: internal speed, %.
    acceleration: acceleration and deceleration, %.
    in_mm: whether blends are in mm (`@n`).
    """

    numbers: Mapping[str, int]
    define: bool
    external: float
    internal: float
    acceleration: float
    in_mm: bool


def read_expected(options: Mapping[str, object]) -> Expected:
    """Reads the options of the post. Raises JobError if one has the wrong type."""
    return Expected(
        numbers={kind: int(read_number(options, kind, 1)) for kind in ("tool", "work")},
        define=options.get("define", False) is True,
        external=read_number(options, "ext_speed", 0.0),
        internal=read_number(options, "internal_speed", 10.0),
        acceleration=read_number(options, "accel", 50.0),
        in_mm=options.get("pass_mark", "P") == "mm",
    )


def check_settings(
    expected: Expected,
    numbers: Mapping[str, int],
    external: float,
    acceleration: tuple[float, ...],
) -> Iterator[str]:
    """Differences between the settings of a motion and the options.

    numbers: numbers of the tool and work frame.
    external: external speed, %, 0 if the text does not set it.
    acceleration: values of Accel and Decel, %. Empty before them and after Speed, which changes it.
    """
    for kind, wanted in expected.numbers.items():
        if numbers[kind] != wanted:
            yield f"{kind} {numbers[kind]} is on, by post.{kind} it is {wanted}"
    if abs(external - expected.external) > _SAME:
        statement = f"ExtSpeed {external:g}" if external else "no ExtSpeed"
        suffix = "" if expected.external else ": none"
        yield f"{statement}, by post.ext_speed it is {expected.external:g}{suffix}"
    differences = [abs(percent - expected.acceleration) for percent in acceleration]
    if len(acceleration) != 2 or max(differences) > _SAME:
        values = ", ".join(f"{percent:g}" for percent in acceleration)
        wanted_values = f"{expected.acceleration:g}, {expected.acceleration:g}"
        values = values or "not set, or not after Speed"
        yield f"Accel is {values}, by post.accel it is {wanted_values}"


def check_internal(expected: Expected, internal: object) -> str:
    """The fault of an internal speed that is not that of the options, empty without one.

    No motion of the program runs at this speed, but a motion that a user adds does.
    internal: internal speed, %, None if the text does not set it.
    """
    if internal is None:
        return f"no Speed, by post.internal_speed it is {expected.internal:g}"
    if not isinstance(internal, float):
        return f"Speed by Mps, by post.internal_speed it is {expected.internal:g}"
    if abs(internal - expected.internal) <= _SAME:
        return ""
    return f"Speed {internal:g}, by post.internal_speed it is {expected.internal:g}"


def check_mark(expected: Expected, mark: str) -> str:
    """The fault of a pass mark that is not that of the options, empty without one."""
    if mark in ("E", "C"):
        return f"the pass mark @{mark}, which no program of the post says"
    if mark == "P" and expected.in_mm:
        return "@P, by post.pass_mark blends are in mm"
    if mark not in ("0", "P") and not expected.in_mm:
        return "a blend in mm, by post.pass_mark it is @P"
    return ""
