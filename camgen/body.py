"""Instructions by column: a program may hold half a million of them, and a loop over them in Python takes seconds."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import chain, compress
from operator import attrgetter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from camgen.instructions import Instruction, MoveC, MoveJ, MoveL
from camgen.pose import FloatArray, Pose

Mask = NDArray[np.bool_]


def are(items: Sequence[Any], *kinds: type) -> Mask:
    """(N,): which items are of one of the types ``kinds``."""
    found = map(frozenset(kinds).__contains__, map(type, items))
    return np.fromiter(found, np.bool_, len(items))


def taken(items: Iterable[Any], keep: Mask) -> list[Any]:
    """The items to keep."""
    return list(compress(items, keep.tolist()))


def moves_of(body: Sequence[Instruction]) -> tuple[list[Any], Mask]:
    """The motions of a body, and which of its instructions they are (N,)."""
    mask = are(body, MoveJ, MoveL, MoveC)
    return taken(body, mask), mask


def numbers(items: Sequence[Any], name: str, width: int = 1) -> FloatArray:
    """An attribute of the items, a number or a tuple of ``width`` numbers, as (N, width)."""
    values = map(attrgetter(name), items)
    flat = chain.from_iterable(values) if width > 1 else values
    return np.fromiter(flat, np.float64, len(items) * width).reshape(-1, width)


def column(items: Sequence[Any], name: str) -> FloatArray:
    """An attribute of the items, a number each, as (N,)."""
    return numbers(items, name)[:, 0]


def posed(moves: Sequence[Any]) -> Mask:
    """Which motions (N,) have a pose as their target, not joint values."""
    return are(list(map(attrgetter("target"), moves)), Pose)


def ends(moves: Sequence[Any]) -> FloatArray:
    """Where motions end (N, 3), NaN for those to joint values."""
    return _spread(moves, posed(moves), "target.origin")


def vias(moves: Sequence[Any]) -> FloatArray:
    """The via points (N, 3) of the motions that are arcs, else NaN."""
    return _spread(moves, are(moves, MoveC), "via.origin")


def _spread(moves: Sequence[Any], where: Mask, name: str) -> FloatArray:
    places = np.full((len(moves), 3), np.nan)
    places[where] = numbers(taken(moves, where), name, 3)
    return places
