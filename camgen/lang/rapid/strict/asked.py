"""What the options of the post ask for and a RAPID program may say otherwise: the load of the tool, how it presses, the
supervision of postures, settings.

A controller takes all of it, so that each is a remark: harmless in a program written by hand, in one of ours the sign
of a changed text.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from typing import cast

from msgspec import Struct

from camgen.lang.rapid.types import Value

#: Two numbers are the same within half of the last digit that the post prints of them.
_SAME = 0.00051
_NUMBER = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?", re.ASCII)
_FRAMES = {"tool": "tool", "work": "work object"}
#: Speeds of external axes in all speeddata of the system and of posts: mm/s and deg/s.
_EXTERNAL_SPEED = (5000.0, 1000.0)
_NO_TURN = (1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


class Asked(Struct, frozen=True):
    """Options of the post, its defaults where they are not given. load: mass, kg, and centre of gravity, mm;
    acceleration: of AccSet, empty: none; calibration: the loaddata of FCCalib, empty: none; task: whether persistents
    are those of their task; names: of the tool and of the work object on the controller.
    """

    load: tuple[float, ...]
    threshold: float
    change: float
    distance: float
    conf: str
    on_error: str
    singularity: str
    acceleration: tuple[float, ...]
    calibration: str
    task: bool
    names: Mapping[str, str]


def read_asked(options: Mapping[str, object]) -> Asked:
    """The options that are given, and for the rest the defaults of the post."""
    cog = _numbers(options, "cog")
    return Asked(
        load=(_number(options, "mass", 0.001), *(cog if len(cog) == 3 else (0.0, 0.0, 0.001))),
        threshold=_number(options, "force_threshold", 50.0),
        change=_number(options, "force_change", 0.0),
        distance=_number(options, "force_distance", 0.0),
        conf=str(options.get("conf", "auto")),
        on_error=str(options.get("on_error", "raise")),
        singularity=str(options.get("sing_area", "")),
        acceleration=_numbers(options, "acc_set"),
        calibration=str(options.get("force_load", "")),
        task=options.get("s4", False) is not True,
        names={
            "tool": str(options.get("tool", "tCamgen")),
            "work": str(options.get("work", "wCamgen")),
        },
    )


def _number(options: Mapping[str, object], key: str, default: float) -> float:
    value = options.get(key, default)
    return float(value) if isinstance(value, (int, float)) else default


def _numbers(options: Mapping[str, object], key: str) -> tuple[float, ...]:
    given = options.get(key, ())
    values = given if isinstance(given, Sequence) else ()
    return tuple(float(value) for value in values if isinstance(value, (int, float)))


def judge_load(asked: Asked, load: Value) -> str:
    """What the load of a tool is, where it is another than the options give; else empty."""
    said = _flatten(load)
    if _same(said, (*asked.load, *_NO_TURN)):
        return ""
    mass, *cog = (f"{value:g}" for value in said[:4])
    wanted, *centre = (f"{value:g}" for value in asked.load)
    if (mass, cog) == (wanted, centre):
        return "a tool with inertia, which the options do not give"
    return (
        f"a tool of {mass} kg with its centre of gravity at {', '.join(cog)} mm, by post.mass and post.cog it has "
        f"{wanted} kg at {', '.join(centre)} mm"
    )


def judge_persistent(asked: Asked, name: str, task: bool) -> str:
    """What is wrong with the kind of a persistent that is not local (RAPID kernel manual, persistent declarations)."""
    if task == asked.task:
        return ""
    return (
        f"{name} is TASK PERS, which S4 has not"
        if task
        else f"{name} is PERS, one for all tasks, not TASK PERS"
    )


def judge_name(asked: Asked, kind: str, name: str, unknown: bool) -> str:
    """The fault of a tool or a work object with another name than the option; empty without one.

    kind: key of `Asked.names`
    unknown: whether the text leaves its declaration to the controller
    """
    wanted = asked.names[kind]
    if name.lower() == wanted.lower():
        return ""
    state = "not declared" if unknown else f"the {_FRAMES[kind]} of a motion"
    return f"{name[:40]} is {state}, by post.{kind} it is {wanted}"


def judge_external_speed(speed: Sequence[float]) -> str:
    """The fault of a speed whose external axes have other limits than posts write; empty without one.

    speed: numbers of a speeddata: mm/s, deg/s, mm/s of linear and deg/s of rotating external axes
    """
    if len(speed) < 4 or tuple(speed[2:4]) == _EXTERNAL_SPEED:
        return ""
    numbers = ", ".join(f"{value:g}" for value in speed[2:4])
    return f"a speed with {numbers} for external axes, where posts write 5000, 1000"


def judge_pressing(asked: Asked, values: Mapping[str, Value]) -> Iterator[str]:
    """What FCPress1LStart says otherwise than the options do."""
    for name, option, wanted, unit in (
        ("threshold", "force_threshold", asked.threshold, "%"),
        ("forcechange", "force_change", asked.change, "N/s"),
        ("possupvdist", "force_distance", asked.distance, "mm"),
    ):
        said = cast(float, values.get(name, 0.0))
        if not _same((said,), (wanted,)):
            yield f"{name} is {said:g} {unit}, by post.{option} it is {wanted:g}"
    if "usespdffw" in values:
        yield "UseSpdFFW, which no option asks for"


def judge_calibration(asked: Asked, said: str | Value) -> str:
    """What is wrong with the loaddata of FCCalib, by name in lower case or by value."""
    if not asked.calibration:
        return "FCCalib, which post.force_load does not ask for"
    if isinstance(said, str):
        same = said == asked.calibration.lower()
    else:
        same = _same(_flatten(said), tuple(map(float, _NUMBER.findall(asked.calibration))))
    return (
        "" if same else f"FCCalib with another load than post.force_load = {asked.calibration[:40]}"
    )


def judge_acceleration(asked: Asked, said: tuple[float, ...]) -> str:
    """What is wrong with AccSet; nothing said: empty."""
    if _same(said, asked.acceleration):
        return ""
    numbers = ", ".join(f"{value:g}" for value in asked.acceleration)
    return f"AccSet is not what post.acc_set asks for, {numbers or 'none'}"


def judge_singularity(asked: Asked, said: str) -> str:
    """What is wrong with SingArea; nothing said: empty."""
    return (
        ""
        if said == asked.singularity
        else f"SingArea is not what post.sing_area asks for, {_or_none(asked)}"
    )


def _or_none(asked: Asked) -> str:
    return asked.singularity or "none"


def _same(a: Sequence[float], b: Sequence[float]) -> bool:
    return len(a) == len(b) and all(abs(x - y) <= _SAME for x, y in zip(a, b, strict=True))


def _flatten(value: Value) -> tuple[float, ...]:
    """The numbers of a record in order."""
    if isinstance(value, tuple):
        return tuple(number for item in value for number in _flatten(item))
    return (float(value),) if isinstance(value, (int, float)) else ()
