"""RAPID statements in the usual spelling, read at once: what long programs consist of."""

from __future__ import annotations

import re
from collections.abc import Callable
from functools import lru_cache

from .expressions import Calls
from .tokens import LARGEST, RESERVED, Wrong
from .tree import Calling, Inline, Point, Shape, Statement

#: Longer statements go the long way, so that a text without semicolons is not searched over and over.
_LONGEST = 1000
#: Position and orientation of a point. So few digits cannot make a number that is larger than a num can be.
_POINT_PLAIN = re.compile(r"\[\[([-.0-9,]{5,38})\],\[([-.0-9,]{7,100})\]")
_ANY_POINT = "[[0,0,0],[1,0,0,0]"
_MOST_POINTS = 2
#: Pieces of a statement with one point: before it, its position, its orientation, after it.
_PIECES_OF_ONE_POINT = 4
#: The call of a routine: each has another name.
_CALL = re.compile(r"[ \t\f\v\n]*([A-Za-z][A-Za-z0-9_]*);")
_REMARK = re.compile(r"[ \t\f\v\n]*![^\n]*\n")


def read_plain(
    text: str, start: int, line: int, body: list[Statement], grammar: Callable[[str, int], Calls]
) -> tuple[int, int]:
    """Reads statements from the offset ``start``, in ``line``, up to one in no usual spelling; returns where that is.

    start: where a statement may begin, which is not before a reserved word. grammar: for what is no point.
    """
    while end := text.find(";", start, start + _LONGEST) + 1:
        statement = text[start:end]
        if "!" in statement:
            remark = _REMARK.match(text, start)
            if remark is None:
                break
            start = remark.end()
            line += remark[0].count("\n")
            continue
        if call := _CALL.fullmatch(statement):
            if call[1].lower() in RESERVED:
                break
            line += statement.count("\n")
            body.append(Calling(line, call[1].lower()))
            start = end
            continue
        cut = _POINT_PLAIN.split(statement)
        shape = shape_of(grammar, *cut[::3])
        if shape is None:
            break
        try:
            body.append(_item(shape, line, cut))
        except ValueError:  # not three and four numbers
            break
        start = end
        line += shape.lines
    return start, line


def _item(shape: Shape, line: int, cut: list[str]) -> Calling | Inline:
    """The statement of a shape with its own line and numbers. ValueError when they are none."""
    line += shape.lead
    if len(cut) == 1:
        return Calling(line, shape.name, shape.args, shape.options)
    x, y, z = map(float, cut[-3].split(","))
    if len(cut) == _PIECES_OF_ONE_POINT:
        return Inline(line, shape, (x, y, z), _turn(cut[-2]))
    u, v, w = map(float, cut[1].split(","))
    return Inline(line, shape, (x, y, z), _turn(cut[-2]), (u, v, w), _turn(cut[2]))


@lru_cache(maxsize=1000)
def _turn(text: str) -> tuple[float, float, float, float]:
    """A quaternion: the same for many points."""
    w, x, y, z = map(float, text.split(","))
    if max(map(abs, (w, x, y, z))) > LARGEST:
        raise ValueError(text)
    return w, x, y, z


@lru_cache(maxsize=2000)
def shape_of(grammar: Callable[[str, int], Calls], *parts: str) -> Shape | None:
    """The shape of a statement that has points between ``parts``; nothing if the general rules are needed for it.

    A string may hold a semicolon, a function remembers its line, and a point that is not cut out has two brackets.
    """
    text, points = _ANY_POINT.join(parts), len(parts) - 1
    if points > _MOST_POINTS or any(mark in part for part in parts for mark in ('"', "(", "[[")):
        return None
    parser = grammar(text, 0)
    if parser.token[0] != "name" or parser.word() in RESERVED:
        return None
    try:
        call = parser.statement_call()
    except Wrong:
        return None
    found = [arg.value[2:] for arg in call.args[:points] if isinstance(arg, Point)]
    if len(found) < points:
        return None
    return Shape(
        call.name, tuple(found), call.args[points:], call.options, call.line, text.count("\n")
    )
