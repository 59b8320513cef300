"""The options of the post, and the text of a RAPID program that follows from them.

The text is the load of the tool, the force control, the supervision of postures and the settings. A
controller accepts other text too, so that a difference is unusual, not refused. In a program of a
post it shows that the text was changed.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from itertools import chain
from typing import cast

from msgspec import Struct

from camgen.lang.post_options import read_number
from camgen.lang.rapid.types import Value

#: Maximum difference of two equal numbers: half of the last digit that the post prints.
_SAME = 0.00051
_NUMBER = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?", re.ASCII)
_FRAMES = {"tool": "tool", "work": "work object"}
#: Speeds of external axes in all speeddata of the system and of posts: mm/s and deg/s.
_EXTERNAL_SPEED = (5000.0, 1000.0)
_NO_TURN = (1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


#: The signals of a cell whose options name none.
_SIGNALS: Mapping[str, object] = {"process": "doProcess"}
#: Longest name on IRC5 and later, and on S4.
_NAME, _NAME_S4 = 32, 16


class PostSettings(Struct, frozen=True):
    """Options of the post, or its defaults.

    signals: logical name of a signal by its identifier in lower case.
    external: whether tool and work object are declared on the controller, not in the text.
    sign: +1 if a positive force presses along the positive tool axis, else -1.
    longest_name: maximum number of characters of a name.
    load: mass, kg, and centre of gravity, mm.
    threshold: force at which pressing begins, % of the force.
    change: rate of the force, N/s.
    distance: supervised distance of the search for contact, mm.
    conf: supervision of postures: auto, on or off.
    on_error: last word of the ERROR handler of main, or none.
    singularity: argument of SingArea, empty without one.
    acceleration: arguments of AccSet, %, empty without one.
    calibration: loaddata of FCCalib, empty without one.
    task: whether persistents belong to their task (TASK PERS).
    names: names of the tool and of the work object on the controller, by "tool" and "work".
    """

    signals: Mapping[str, str]
    external: bool
    sign: int
    longest_name: int
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


def read_settings(options: Mapping[str, object]) -> PostSettings:
    """Reads the options of the post. Raises JobError if one has the wrong type."""
    cog = _numbers(options, "cog")
    table = options.get("signals", _SIGNALS)
    items = table.items() if isinstance(table, Mapping) else ()
    is_s4 = options.get("s4", False) is True
    return PostSettings(
        signals={str(name).lower(): str(key) for key, name in items},
        external=options.get("declare", True) is False,
        sign=-1 if options.get("force_sign", 1) == -1 else 1,
        longest_name=_NAME_S4 if is_s4 else _NAME,
        load=(read_number(options, "mass", 0.001), *(cog if len(cog) == 3 else (0.0, 0.0, 0.001))),
        threshold=read_number(options, "force_threshold", 50.0),
        change=read_number(options, "force_change", 0.0),
        distance=read_number(options, "force_distance", 0.0),
        conf=str(options.get("conf", "auto")),
        on_error=str(options.get("on_error", "raise")),
        singularity=str(options.get("sing_area", "")),
        acceleration=_numbers(options, "acc_set"),
        calibration=str(options.get("force_load", "")),
        task=not is_s4,
        names={
            "tool": str(options.get("tool", "tCamgen")),
            "work": str(options.get("work", "wCamgen")),
        },
    )


def _numbers(options: Mapping[str, object], key: str) -> tuple[float, ...]:
    option = options.get(key, ())
    values = option if isinstance(option, Sequence) else ()
    return tuple(float(value) for value in values if isinstance(value, (int, float)))


def check_load(settings: PostSettings, load: Value) -> str:
    """The fault of a tool whose load is not that of the options, empty without one."""
    numbers = _flatten(load)
    if is_same(numbers, (*settings.load, *_NO_TURN)):
        return ""
    mass, *cog = (f"{value:g}" for value in numbers[:4])
    expected_mass, *expected_cog = (f"{value:g}" for value in settings.load)
    if (mass, cog) == (expected_mass, expected_cog):
        return "a tool with inertia, which the options do not give"
    tool = f"a tool of {mass} kg with its centre of gravity at {', '.join(cog)} mm"
    wanted = f"{expected_mass} kg at {', '.join(expected_cog)} mm"
    return f"{tool}, by post.mass and post.cog it has {wanted}"


def check_name(settings: PostSettings, kind: str, name: str, unknown: bool) -> str:
    """The fault of a tool or a work object with another name than the option, empty without one.

    kind: key of `PostSettings.names`.
    unknown: whether the text leaves its declaration to the controller.
    """
    wanted = settings.names[kind]
    if name.lower() == wanted.lower():
        return ""
    state = "not declared" if unknown else f"the {_FRAMES[kind]} of a motion"
    return f"{name[:40]} is {state}, by post.{kind} it is {wanted}"


def check_external_speed(speed: Sequence[float]) -> str:
    """The fault of a speed with other limits of external axes than posts write, empty without one.

    speed: numbers of a speeddata: mm/s, deg/s, mm/s of linear and deg/s of rotating external axes.
    """
    if tuple(speed[2:]) == _EXTERNAL_SPEED:
        return ""
    numbers = ", ".join(f"{value:g}" for value in speed[2:])
    return f"a speed with {numbers} for external axes, where posts write 5000, 1000"


def check_pressing(settings: PostSettings, values: Mapping[str, Value]) -> Iterator[str]:
    """Differences between the arguments of FCPress1LStart and the options."""
    for name, option, wanted, unit in (
        ("threshold", "force_threshold", settings.threshold, "%"),
        ("forcechange", "force_change", settings.change, "N/s"),
        ("possupvdist", "force_distance", settings.distance, "mm"),
    ):
        value = cast(float, values.get(name, 0.0))
        if not is_same((value,), (wanted,)):
            yield f"{name} is {value:g} {unit}, by post.{option} it is {wanted:g}"
    if "usespdffw" in values:
        yield "UseSpdFFW, which no option asks for"


def check_calibration(settings: PostSettings, load: str | Value) -> str:
    """The fault of FCCalib with another load than the option, empty without one.

    load: loaddata, by name in lower case or by value.
    """
    if not settings.calibration:
        return "FCCalib, which post.force_load does not ask for"
    expected = settings.calibration.lower()
    numbers = tuple(map(float, _NUMBER.findall(expected)))
    if load == expected or (isinstance(load, tuple) and is_same(_flatten(load), numbers)):
        return ""
    return f"FCCalib with another load than post.force_load = {settings.calibration[:40]}"


def is_same(a: Sequence[float], b: Sequence[float]) -> bool:
    """Whether numbers are equal within the digits that the post prints."""
    return len(a) == len(b) and all(abs(x - y) <= _SAME for x, y in zip(a, b, strict=True))


def _flatten(value: Value) -> tuple[float, ...]:
    if isinstance(value, tuple):
        return tuple(chain.from_iterable(map(_flatten, value)))
    return (float(value),) if isinstance(value, (int, float)) else ()
