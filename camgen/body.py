"""Instructions by column: a program may hold half a million of them, and a loop over them in Python takes seconds."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from functools import cached_property
from itertools import chain, compress
from operator import attrgetter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from camgen.instructions import Comment, Force, Instruction, MoveC, MoveJ, MoveL, Output, Wait
from camgen.pose import FloatArray, Pose

Mask = NDArray[np.bool_]
Indices = NDArray[np.intp]

_NUMBER: dict[type, int] = {MoveJ: 0, MoveL: 1, MoveC: 2, Output: 3, Wait: 4, Force: 5, Comment: 6}


class Columns:
    """The columns of a body of N instructions, M of them motions, each worked out when it is first asked for."""

    def __init__(self, body: Sequence[Instruction]) -> None:
        self.body = body
        #: (N,) what each instruction is.
        self._kind = np.fromiter(map(_NUMBER.__getitem__, map(type, body)), np.int8, len(body))

    def are(self, *kinds: type) -> Mask:
        """(N,): which instructions are of one of the types ``kinds``."""
        return _any_of(self._kind, kinds)

    def of(self, *kinds: type) -> list[Any]:
        """The instructions of the types ``kinds``."""
        return taken(self.body, self.are(*kinds))

    @cached_property
    def at(self) -> Indices:
        """(M,): where the motions stand in the body."""
        return np.flatnonzero(self.are(MoveJ, MoveL, MoveC))

    @cached_property
    def moves(self) -> list[Any]:
        """The motions."""
        return self.of(MoveJ, MoveL, MoveC)

    def moves_are(self, *kinds: type) -> Mask:
        """(M,): which motions are of one of the types ``kinds``."""
        return _any_of(self._kind[self.at], kinds)

    def before(self, indices: Indices) -> Indices:
        """The numbers of the motions before the instructions at ``indices``, -1 where there is none."""
        return np.asarray(np.searchsorted(self.at, indices) - 1)

    def pose(self, motion: int) -> Pose | None:
        """The pose to which a motion goes; none for one to joint values, and for motion -1."""
        target = self.moves[motion].target if motion >= 0 else None
        return target if isinstance(target, Pose) else None

    @cached_property
    def posed(self) -> Mask:
        """(M,): which motions have a pose as their target, not joint values."""
        mask = ~self.moves_are(MoveJ)
        rapid = np.flatnonzero(~mask)
        mask[rapid] = [type(self.moves[k].target) is Pose for k in rapid.tolist()]
        return mask

    def turned_as(self, rotation: FloatArray) -> Mask:
        """(M,): which motions go to a pose whose rotation is this very object, as programs share them."""
        mask = self.posed.copy()
        found = map(id, map(attrgetter("target.rotation"), taken(self.moves, mask)))
        mask[mask] = [one == id(rotation) for one in found]
        return mask

    @cached_property
    def ends(self) -> FloatArray:
        """(M, 3): where motions end, NaN for those to joint values."""
        return self._spread(self.posed, "target.origin")

    @cached_property
    def vias(self) -> FloatArray:
        """(M, 3): the via points of arcs, NaN for other motions."""
        return self._spread(self.moves_are(MoveC), "via.origin")

    @cached_property
    def speed(self) -> FloatArray:
        """(M,): mm/s."""
        return column(self.moves, "speed")

    @cached_property
    def blend(self) -> FloatArray:
        """(M,): mm."""
        return column(self.moves, "blend")

    @cached_property
    def force(self) -> FloatArray:
        """(M,): N, 0 for motions of the joints."""
        pressing = ~self.moves_are(MoveJ)
        force = np.zeros(len(self.moves))
        force[pressing] = column(taken(self.moves, pressing), "force")
        return force

    def _spread(self, where: Mask, name: str) -> FloatArray:
        places = np.full((len(where), 3), np.nan)
        places[where] = numbers(taken(self.moves, where), name, 3)
        return places


def spliced(body: Sequence[Instruction], changed: Mapping[int, Sequence[Instruction]]) -> tuple[Instruction, ...]:
    """The body with others in the place of the instructions whose indices are the keys of ``changed``."""
    pieces: list[Instruction] = []
    done = 0
    for index in sorted(changed):
        pieces += body[done:index]
        pieces += changed[index]
        done = index + 1
    pieces += body[done:]
    return tuple(pieces)


def _any_of(numbered: NDArray[np.int8], kinds: Iterable[type]) -> Mask:
    mask = np.zeros(len(numbered), np.bool_)
    for kind in kinds:
        mask |= numbered == _NUMBER[kind]
    return mask


def taken(items: Sequence[Any], keep: Mask) -> list[Any]:
    """The items to keep."""
    count = int(np.count_nonzero(keep))
    if count == len(items):
        return list(items)
    if 4 * count < len(items):
        return list(map(items.__getitem__, np.flatnonzero(keep).tolist()))
    return list(compress(items, keep.tolist()))


def numbers(items: Sequence[Any], name: str, width: int = 1) -> FloatArray:
    """An attribute of the items, a number or a tuple of ``width`` numbers, as (N, width)."""
    values = map(attrgetter(name), items)
    flat = chain.from_iterable(values) if width > 1 else values
    return np.fromiter(flat, np.float64, len(items) * width).reshape(-1, width)


def column(items: Sequence[Any], name: str) -> FloatArray:
    """An attribute of the items, a number each, as (N,)."""
    return numbers(items, name)[:, 0]


def shared(items: Sequence[Any], name: str) -> list[Any]:
    """The different objects that are an attribute of the items: most of them share rotations and directions."""
    values = list(map(attrgetter(name), items))
    return list(dict(zip(map(id, values), values, strict=True)).values())
