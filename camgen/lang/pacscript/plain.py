"""The motion lines that most of a PacScript program consists of, read without an expression."""

from __future__ import annotations

import re
from collections.abc import Callable
from functools import lru_cache
from typing import Any

from msgspec import Struct
from msgspec.json import Decoder

from camgen.lang.pacscript.values import UNDEFINED, Figured, Unreadable, position
from camgen.model.pose import FloatArray, Pose, Vec3

#: As in JSON, whose reader is several times as fast as ``float`` and as exact. With a point: JSON's -0 has no sign.
_NUMBER = r"-?(?:0|[1-9][0-9]{0,8})\.[0-9]{1,9}"
_PLACE = rf"({_NUMBER}, {_NUMBER}, {_NUMBER})((?:, [-0-9., ]{{1,90}})?)"
_RATE = r"[0-9]{1,6}(?:\.[0-9]{1,9})?"
_STATEMENT = (
    rf"Move (?:([LP])|C, P\({_PLACE}\)), ((?:@(?:[0PE]|[0-9]{{1,6}}) )?)P\({_PLACE}\)"
    rf"((?:, Speed = (?:Mps\({_RATE}(?: \* [A-Za-z][A-Za-z0-9_]{{0,63}})?\)|{_RATE}))?)"
)
#: One line of any kind with its end.
LINE = re.compile(r"[^\n]*+\n|[^\n]++")
#: The same; a motion in the usual spelling has groups: L or P, else of via x, y, z and the rest; pass mark; of the
#: target x, y, z and the rest; speed.
PIECE = re.compile(rf" {{0,16}}{_STATEMENT}\r?(?:\n|\Z)|{LINE.pattern}")
#: A motion in the usual spelling with the groups of ``PIECE``.
STATEMENT = re.compile(_STATEMENT)
_TURN = re.compile(r"(?:, -?[0-9]+(?:\.[0-9]*)?){0,4}")
_numbers = Decoder(Vec3)


class Plain(Struct, frozen=True, gc=False):
    """A motion of one line, 1-based through all files. manner: what the reader makes of kind, mark and speed. via: of
    an arc.
    """

    line: int
    manner: Any
    via: Pose | None
    target: Pose


def plain(
    piece: re.Match[str], line: int, manner_of: Callable[[str, str, str], Any]
) -> Plain | None:
    """What a match of ``PIECE`` with groups says; nothing where the long way has to say what is wrong with it.

    manner_of: what L, P or C, the mark and the speed, as they stand in the text, mean; Unreadable for the long way.
    """
    kind, via, via_turn, mark, target, turn, speed = piece.groups()
    try:
        manner, end = manner_of(kind or "C", mark, speed), _place(target, turn)
        middle = None if kind else _place(via, via_turn)
    except Unreadable:
        return None
    return Plain(line, manner, middle, end)


def _place(xyz: str, turn: str) -> Pose:
    """``P()`` with x, y, z and the rest."""
    rotation, figure = _read_turn(turn)
    origin = _numbers.decode(f"[{xyz}]")
    return Pose(rotation, origin) if figure == UNDEFINED else Figured(rotation, origin, figure)


@lru_cache(maxsize=1024)
def _read_turn(turn: str) -> tuple[FloatArray, int]:
    """The rotation and the figure that follow x, y, z in the brackets of ``P()``, as the long way reads them."""
    if not _TURN.fullmatch(turn):
        raise Unreadable(f"{turn} is no rotation")
    values = [0.0, 0.0, 0.0, *map(float, turn.split(",")[1:])]
    if len(values) > 6 and values[6] != UNDEFINED and values[6] < 0:
        raise Unreadable(f"{turn} has another figure")
    place = position(values)
    return place.rotation, place.figure if isinstance(place, Figured) else UNDEFINED
