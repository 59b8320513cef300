"""The motion lines that most of a PacScript program consists of, read without an expression.

    Move L, @P P(10.000, 20.500, 0.000, 180.0000, 0.0000, 0.0000, -1), Speed = Mps(0.02)
    Move C, P(1.000, 2.000, 0.000), @0 P(2.000, 2.000, 0.000), Speed = 20

Every line that is not exactly of this form goes the long way through ``pacscript_motion``. A test holds both ways
against each other.
"""

from __future__ import annotations

import re
from functools import lru_cache

from msgspec import Struct
from msgspec.json import Decoder

from camgen.pose import FloatArray, Pose, Vec3

from .pacscript_machine import Machine
from .pacscript_motion import Manner, arc, go, manner_of, nothing
from .pacscript_values import UNDEFINED, Figured, Unreadable, evaluate

#: As in JSON, whose reader is several times as fast as ``float`` and as exact. With a point: JSON's -0 has no sign.
_NUMBER = r"-?(?:0|[1-9][0-9]{0,8})\.[0-9]{1,9}"
_PLACE = rf"({_NUMBER}, {_NUMBER}, {_NUMBER})((?:, [-0-9., ]{{1,90}})?)"
_RATE = r"[0-9]{1,6}(?:\.[0-9]{1,9})?"
_MOTION = (
    rf" {{0,16}}Move (?:([LP])|C, P\({_PLACE}\)), ((?:@(?:[0PE]|[0-9]{{1,6}}) )?)P\({_PLACE}\)"
    rf"((?:, Speed = (?:Mps\({_RATE}\)|{_RATE}))?)\r?(?:\n|\Z)"
)
#: One line of any kind with its end.
LINE = re.compile(r"[^\n]*+\n|[^\n]++")
#: The same; a motion in the usual spelling has groups: L or P, else of via x, y, z and the rest; pass mark; of the
#: target x, y, z and the rest; speed.
PIECE = re.compile(f"{_MOTION}|{LINE.pattern}")
_numbers = Decoder(Vec3)


class Plain(Struct, frozen=True, gc=False):
    """A motion of one line, 1-based through all files. via: of an arc."""

    line: int
    manner: Manner
    via: Pose | None
    target: Pose


def plain(piece: re.Match[str], line: int) -> Plain | None:
    """What a match of ``PIECE`` with groups says; nothing where the long way has to say what is wrong with it."""
    kind, via, via_turn, mark, target, turn, speed = piece.groups()
    try:
        manner, end = _manner(kind or "C", mark, speed), _place(target, turn)
        middle = None if kind else _place(via, via_turn)
    except Unreadable:
        return None
    return Plain(line, manner, middle, end)


_manner = lru_cache(maxsize=1024)(manner_of)


def _place(position: str, turn: str) -> Pose:
    """``P()`` with x, y, z and the rest."""
    rotation, figure = _turned(turn)
    origin = _numbers.decode(f"[{position}]")
    return Pose(rotation, origin) if figure == UNDEFINED else Figured(rotation, origin, figure)


@lru_cache(maxsize=1024)
def _turned(turn: str) -> tuple[FloatArray, int]:
    """The rotation and the figure that follow x, y, z in the brackets of ``P()``, as the long way reads them."""
    value = evaluate(f"P(0, 0, 0{turn})", nothing)
    if not isinstance(value, Pose):
        raise Unreadable(f"{turn} is no rotation")
    return value.rotation, value.figure if isinstance(value, Figured) else UNDEFINED


def carry_out(machine: Machine, item: Plain) -> None:
    """Does what ``pacscript_motion.move`` does with the same line."""
    manner = item.manner
    speed = machine.mm_per_second(machine.internal if manner.speed is None else manner.speed)
    if item.via is not None:
        arc(machine, item.via, item.target, manner.blend, speed, False)
    else:
        go(machine, manner.linear, item.target, manner.blend, speed, False)
