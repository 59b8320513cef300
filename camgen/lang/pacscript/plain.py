"""The motion lines that most of a PacScript program consists of, read without an expression."""

from __future__ import annotations

import re
from collections.abc import Callable
from functools import lru_cache, partial
from itertools import count
from typing import Any

from msgspec import Struct

from camgen.lang.columns import Run, Template
from camgen.lang.pacscript.values import UNDEFINED, Figured, Unreadable, position
from camgen.model.pose import Pose, Vec3

#: As in JSON, whose reader is several times as fast as ``float`` and as exact. With a point: JSON's -0 has no sign.
_NUMBER = r"-?(?:0|[1-9][0-9]{0,8}+)\.[0-9]{1,9}+"
_THREE = f"{_NUMBER}, {_NUMBER}, {_NUMBER}"
_REST = r"(?:, [-0-9., ]{1,90})?"
_RATE = r"[0-9]{1,6}(?:\.[0-9]{1,9})?"
_MOTION = (
    rf" {{0,16}}Move (?:(?P<kind>[LP])|C, P\((?P<via>{_THREE})(?P<via_turn>{_REST})\)), "
    rf"(?P<mark>(?:@(?:[0PE]|[0-9]{{1,6}}) )?)P\((?P<target>{_THREE})(?P<turn>{_REST})\)"
    r"(?P<speed>(?:, Speed = [^\r\n,]{1,80})?)"
    r"\r?(?:\n|\Z)"
)
#: One line of any kind with its end.
LINE = re.compile(r"[^\n]*+\n|[^\n]++")
_SPEED = re.compile(
    rf"(?:, Speed = (?:Mps\({_RATE}(?: \* [A-Za-z][A-Za-z0-9_]{{0,63}})?\)|{_RATE}))?"
)
_TURN = re.compile(r"(?:, -?[0-9]+(?:\.[0-9]*)?){0,4}")


class Plain(Struct, frozen=True, gc=False):
    """A motion of one line.

    line: 1-based through all files.
    kind: L or P, None for an arc.
    mark, speed: pass mark and own speed as the decoders of `motions` return them.
    via: via point of an arc.
    """

    line: int
    kind: str | None
    mark: Any
    speed: Any
    via: Pose | None
    target: Pose


def motions(mark: Callable[[str], Any], speed: Callable[[str], Any]) -> Template:
    """Motions in the usual spelling.

    mark, speed: decoders of the pass mark and of the speed, for each of which the text may be
        empty. They raise Unreadable if the long way has to report a fault.
    """

    def read_speed(text: str) -> Any:
        if not _SPEED.fullmatch(text):
            raise Unreadable(f"{text} has another speed")
        return speed(text)

    turns = dict.fromkeys(("turn", "via_turn"), _read_turn)
    return Template(
        _MOTION, places=("via", "target"), words={"mark": mark, "speed": read_speed, **turns}
    )


def plain(run: Run, line: int) -> list[Plain]:
    """The motions of a run that begins in line `line`."""
    vias = [place and place(at) for place, at in zip(run["via_turn"], run["via"], strict=True)]
    targets = [place(at) for place, at in zip(run["turn"], run["target"], strict=True)]
    return list(map(Plain, count(line), run["kind"], run["mark"], run["speed"], vias, targets))


@lru_cache(maxsize=1024)
def _read_turn(turn: str) -> Callable[[Vec3], Pose]:
    """``P()`` of a place and the rotation and figure that follow it in the brackets, as the long way reads them."""
    if not _TURN.fullmatch(turn):
        raise Unreadable(f"{turn} is no rotation")
    values = [0.0, 0.0, 0.0, *map(float, turn.split(",")[1:])]
    if len(values) > 6 and values[6] != UNDEFINED and values[6] < 0:
        raise Unreadable(f"{turn} has another figure")
    place = position(values)
    if isinstance(place, Figured):
        return partial(Figured, place.rotation, figure=place.figure)
    return partial(Pose, place.rotation)
