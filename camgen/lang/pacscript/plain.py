"""Motions in the usual spelling, of which most of a PacScript program consists, read by column."""

from __future__ import annotations

import re
from collections.abc import Callable
from functools import lru_cache, partial
from itertools import count

from msgspec import Struct

from camgen.lang.columns import Run, Template
from camgen.lang.pacscript.expressions import parse
from camgen.lang.pacscript.values import UNDEFINED, PoseWithFigure, Unreadable, finite, position
from camgen.model.pose import Pose, Vec3

#: A number as in JSON, whose reader is as exact as `float`. It has a point: JSON's -0 has no sign.
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
_SPEED = re.compile(
    rf"(?:, Speed = (?:Mps\({_RATE}(?: \* [A-Za-z][A-Za-z0-9_]{{0,63}})?\)|{_RATE}))?"
)
_TURN = re.compile(r"(?:, -?[0-9]+(?:\.[0-9]*)?){0,4}")


class Plain(Struct, frozen=True, gc=False):
    """A motion of one line.

    line: number of its line, from 1 through all files.
    kind: L or P, None for an arc.
    mark: pass mark as in `Goal`.
    speed: expression of its own speed, empty without one.
    via: via point of an arc.
    target: pose at its end.
    """

    line: int
    kind: str | None
    mark: str
    speed: str
    via: Pose | None
    target: Pose


def list_motions(run: Run, line: int) -> list[Plain]:
    """The motions of a run that begins in line `line`."""
    vias = [place and place(at) for place, at in zip(run["via_turn"], run["via"], strict=True)]
    targets = [place(at) for place, at in zip(run["turn"], run["target"], strict=True)]
    return list(map(Plain, count(line), run["kind"], run["mark"], run["speed"], vias, targets))


def _read_mark(text: str) -> str:
    return text.strip()[1:] or "0"


def _read_speed(text: str) -> str:
    """The expression of a speed. Raises Unreadable in another spelling."""
    if not _SPEED.fullmatch(text):
        raise Unreadable(f"{text} has another speed")
    expression = text.partition("=")[2].strip()
    if expression:
        parse(expression)
    return expression


@lru_cache(maxsize=1024)
def _read_turn(turn: str) -> Callable[[Vec3], Pose]:
    """`P()` of a position, with the rotation and the figure that follow it in the brackets.

    Raises Unreadable in another spelling.
    """
    if not _TURN.fullmatch(turn):
        raise Unreadable(f"{turn} is not a rotation")
    values = [0.0, 0.0, 0.0, *(finite(float(text)) for text in turn.split(",")[1:])]
    if len(values) > 6 and values[6] != UNDEFINED and values[6] < 0:
        raise Unreadable(f"{turn} has another figure")
    place = position(values)
    if isinstance(place, PoseWithFigure):
        return partial(PoseWithFigure, place.rotation, figure=place.figure)
    return partial(Pose, place.rotation)


#: The lane of the motions of a text.
MOTIONS = Template(
    _MOTION,
    places=("via", "target"),
    words={
        "mark": _read_mark,
        "speed": _read_speed,
        "turn": _read_turn,
        "via_turn": _read_turn,
    },
)
