"""Motions in lines that follow each other, all spelled alike: most of a V+ program, read a stretch at a time.

    MOVES cg.work:TRANS(10,20.5,0,0,180,180)
    MOVES cg.work:TRANS(12,20.5,0,0,180,180)

Every line that is not exactly of this form goes the long way through ``vplus_text`` and ``vplus_expr``, and so does a
stretch in a state in which it could mean something else. A test holds both ways against each other.
"""

from __future__ import annotations

import re
from functools import lru_cache
from itertools import repeat

from msgspec import Struct
from msgspec.json import Decoder

from camgen.pose import FloatArray, Pose

from .vplus_places import rotation_zyz

#: A stretch is cut here, so that its numbers as text stay few.
_LONGEST = 256
#: As in JSON, whose reader is several times as fast as ``float`` and as exact, but for the sign of -0.
_NUMBER = r"(?:-?[1-9][0-9]{0,8}|0|-0(?=\.))(?:\.[0-9]{1,9})?"
_THREE = f"{_NUMBER},{_NUMBER},{_NUMBER}"
_STRETCH = (
    r"(?P<head> *(?P<word>MOVES?) (?P<name>[A-Za-z][A-Za-z0-9._]*):TRANS\()"
    rf"{_THREE}(?P<turn>,{_THREE}\)(?P<end>\r?\n))(?:(?P=head){_THREE},{_THREE}\)(?P=end)){{0,{_LONGEST - 1}}}"
)
_Row3 = tuple[float, float, float]
_Row6 = tuple[float, float, float, float, float, float]
_rows_of_3, _rows_of_6 = Decoder(list[_Row3]), Decoder(list[_Row6])
_PACE = rf"{_NUMBER}(?:, {_NUMBER})?(?: MMPS)?(?: ALWAYS)?"
#: A stretch, else a SPEED, else one line of any kind with its end: together the whole of a text.
PIECE = re.compile(rf"{_STRETCH}| *SPEED (?P<pace>{_PACE})\r?\n|[^\r\n]*+(?:\r\n|\r|\n)|[^\r\n]++")
_PACE_PARTS = re.compile(rf"({_NUMBER})(?:, ({_NUMBER}))?( MMPS)?( ALWAYS)?")


class Stretch(Struct, frozen=True, gc=False):
    """Motions to ``name:TRANS(..)`` in lines that follow each other.

    line: 1-based, of the first. word: MOVE or MOVES. poses: in the frame ``name``. text, start, end: where it stands.
    """

    line: int
    word: str
    name: str
    poses: tuple[Pose, ...]
    text: str
    start: int
    end: int

    @property
    def lines(self) -> list[str]:
        """The lines as they stand in the text."""
        return self.text[self.start : self.end].splitlines()


def stretch(piece: re.Match[str], line: int) -> Stretch:
    """What a match of ``PIECE`` with a ``head`` says. line: that of its start."""
    text, word, name, head, turn, end = piece.group(0, "word", "name", "head", "turn", "end")
    if text.count(turn) == text.count("\n"):
        # All are oriented alike.
        origins = _rows_of_3.decode(f"[[{text[len(head) : -len(turn)].replace(turn + head, '],[')}]]")
        poses = tuple(map(Pose, repeat(_rotation(turn)), origins))
    else:
        rows = _rows_of_6.decode(f"[[{text[len(head) : -len(end) - 1].replace(f'){end}{head}', '],[')}]]")
        poses = tuple(Pose(rotation_zyz(*row[3:]), row[:3]) for row in rows)
    return Stretch(line, word, name, poses, piece.string, *piece.span())


@lru_cache(maxsize=1024)
def _rotation(turn: str) -> FloatArray:
    """The rotation of ``,yaw,pitch,roll)`` and a line end."""
    yaw, pitch, roll = map(float, turn.strip(",)\r\n").split(","))
    return rotation_zyz(yaw, pitch, roll)


def pace(rest: str) -> tuple[float, str, bool] | None:
    """What ``vplus_words.speed`` says of a SPEED without names; nothing where it has more to say."""
    match = _PACE_PARTS.fullmatch(rest)
    if match is None or float(match[1]) <= 0 or float(match[2] or 1.0) <= 0:
        return None
    return float(match[1]), "mm/s" if match[3] else "%", bool(match[4])
