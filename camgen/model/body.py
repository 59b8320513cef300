"""The instructions of a long program packed by column.

As objects, half a million motions take 150 MB and a second to look through. A ``Body`` holds their numbers in columns
and makes the objects anew when they are asked for; what is no plain motion it keeps as it is.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from functools import cached_property
from itertools import chain, compress, count, islice, repeat
from operator import attrgetter
from typing import Any, NamedTuple, overload

import numpy as np
from msgspec import Struct
from msgspec.structs import replace
from numpy.typing import NDArray

from camgen.model.instructions import (
    Comment,
    Force,
    Instruction,
    Motion,
    MoveC,
    MoveJ,
    MoveL,
    Output,
    Stop,
    ToolChange,
    Wait,
)
from camgen.model.pose import FloatArray, Pose

Mask = NDArray[np.bool_]
Indices = NDArray[np.intp]

#: The numbers of the kinds of instructions in ``Packed.kind``; motions come first.
NUMBER: dict[type, int] = {
    MoveJ: 0, MoveL: 1, MoveC: 2, Output: 3, Wait: 4, Force: 5, Comment: 6, ToolChange: 7, Stop: 8
}  # fmt: skip
_SWING, _LINE, _ARC = NUMBER[MoveJ], NUMBER[MoveL], NUMBER[MoveC]
#: So many instructions are objects at a time.
_BLOCK = 8192
#: One instruction of so many is looked up by itself.
_MANY = 32
_NO_DIRECTION = (0.0, 0.0, 0.0)


class Packed(Struct, frozen=True, eq=False):
    """The columns of N instructions, M of them motions, A of these arcs.

    kind: (N,), see ``NUMBER``. end: (M, 3) mm where motions end, NaN for joint values; rotation: (M,) of the tool
    there, a place in the table of rotations, -1 for joint values. speed, blend, path, work: (M,) as in ``MoveL``. via:
    (A, 3) mm, via_rotation: (A,) half-way along arcs. kept: (N,) which instructions are kept as objects.
    """

    kind: NDArray[np.int8]
    end: FloatArray
    rotation: NDArray[np.int32]
    speed: FloatArray
    blend: FloatArray
    path: Indices
    work: Mask
    via: FloatArray
    via_rotation: NDArray[np.int32]
    kept: Mask


#: The types of the columns, and the shapes of their rows.
_TYPES: dict[str, tuple[type, tuple[int, ...]]] = {
    "kind": (np.int8, ()), "end": (np.float64, (3,)), "rotation": (np.int32, ()), "speed": (np.float64, ()),
    "blend": (np.float64, ()), "path": (np.intp, ()), "work": (np.bool_, ()), "via": (np.float64, (3,)),
    "via_rotation": (np.int32, ()), "kept": (np.bool_, ()),
}  # fmt: skip


class _Rotations:
    """The rotations of a body, each object once."""

    def __init__(self) -> None:
        self.table: list[FloatArray] = []
        self._places: dict[int, int] = {}

    def places(self, rotations: Sequence[FloatArray]) -> NDArray[np.int32]:
        """Where they stand in the table, into which new ones are put."""
        keys = list(map(id, rotations))
        for key, rotation in dict(zip(keys, rotations, strict=True)).items():
            if key not in self._places:
                self._places[key] = len(self.table)
                self.table.append(rotation)
        return np.fromiter(map(self._places.__getitem__, keys), np.int32, len(keys))


class Distinct(NamedTuple):
    """The K instructions of one type in a body.

    items: each object once, in order of its first place.
    at: (K,) their indices in the body.
    number: (K,) index into `items` of each instruction.
    """

    items: list[Instruction]
    at: Indices
    number: Indices


class Body(Sequence[Instruction]):
    """The instructions of a program by column; each is made when it is asked for, another object each time.

    rotations: the table that ``Packed`` means. objects: the instructions that are kept, in order.
    """

    def __init__(
        self, packed: Packed, rotations: Sequence[FloatArray], objects: Sequence[Instruction]
    ) -> None:
        self.packed, self.rotations, self.objects = packed, rotations, objects
        self._distinct: dict[type, Distinct] = {}

    def __len__(self) -> int:
        return len(self.packed.kind)

    def __iter__(self) -> Iterator[Instruction]:
        size = len(self)
        return chain.from_iterable(
            self._make(low, min(low + _BLOCK, size)) for low in range(0, size, _BLOCK)
        )

    @overload
    def __getitem__(self, index: int) -> Instruction: ...
    @overload
    def __getitem__(self, index: slice) -> tuple[Instruction, ...]: ...
    def __getitem__(self, index: int | slice) -> Instruction | tuple[Instruction, ...]:
        if isinstance(index, slice):
            low, high, step = index.indices(len(self))
            return tuple(self._make(low, max(low, high))) if step == 1 else tuple(self)[index]
        place = index + len(self) if index < 0 else index
        if not 0 <= place < len(self):
            raise IndexError("there is no such instruction")
        return self._make(place, place + 1)[0]

    @cached_property
    def at(self) -> Indices:
        """(M,): where the motions stand."""
        return np.flatnonzero(self.packed.kind <= _ARC)

    @cached_property
    def arcs(self) -> Indices:
        """(A,): where the arcs stand."""
        return np.flatnonzero(self.packed.kind == _ARC)

    @cached_property
    def kept_at(self) -> Indices:
        """Where the ``objects`` stand."""
        return np.flatnonzero(self.packed.kept)

    def pick(self, indices: Indices) -> list[Instruction]:
        """The instructions at ``indices``, which rise."""
        if len(indices) == len(self):
            return list(self)
        if not self.packed.kept[indices].all():
            return list(self.take(indices)) if len(indices) else []
        return list(map(self.objects.__getitem__, self._ranks(self.kept_at, indices).tolist()))

    def distinct(self, kind: type) -> Distinct:
        """The instructions of one type, each object once: a body repeats its outputs."""
        if kind not in self._distinct:
            at, items = self._list(kind)
            keys = list(map(id, items))
            each = dict(zip(keys, items, strict=True))
            number = dict(zip(each, count(), strict=False))
            numbers = np.fromiter(map(number.__getitem__, keys), np.intp, len(keys))
            self._distinct[kind] = Distinct(list(each.values()), at, numbers)
        return self._distinct[kind]

    def _list(self, kind: type) -> tuple[Indices, list[Instruction]]:
        """(K,) places of the instructions of one type, and these."""
        if NUMBER[kind] <= _ARC:
            at = np.flatnonzero(self.packed.kind == NUMBER[kind])
            return at, self.pick(at)
        # Other instructions than motions are always kept.
        ranks = np.flatnonzero(self.packed.kind[self.kept_at] == NUMBER[kind])
        return self.kept_at[ranks], list(map(self.objects.__getitem__, ranks.tolist()))

    def take(self, indices: Indices) -> Body:
        """A body of the instructions at ``indices``."""
        packed = self.packed
        kind, kept = packed.kind[indices], packed.kept[indices]
        moves = self._ranks(self.at, indices[kind <= _ARC])
        arcs = self._ranks(self.arcs, indices[kind == _ARC])
        objects = self._ranks(self.kept_at, indices[kept])
        of_moves = {name: getattr(packed, name)[moves] for name in _OF_MOVES}
        of_arcs = {name: getattr(packed, name)[arcs] for name in _OF_ARCS}
        chosen = Packed(kind=kind, kept=kept, **of_moves, **of_arcs)
        return Body(chosen, self.rotations, list(map(self.objects.__getitem__, objects.tolist())))

    def _ranks(self, at: Indices, indices: Indices) -> Indices | NDArray[np.int32]:
        """The places of ``indices`` in ``at``, which rises and has all of them."""
        if _MANY * len(indices) < len(self):
            return np.searchsorted(at, indices)
        among = np.zeros(len(self), np.bool_)
        among[at] = True
        return (np.cumsum(among, dtype=np.int32) - 1)[indices]

    def stretch(self, low: int, high: int) -> Body:
        """The instructions from ``low`` to before ``high``, in the same columns."""
        spans = {"kind": (low, high), "kept": (low, high)}
        for names, at in ((_OF_MOVES, self.at), (_OF_ARCS, self.arcs)):
            begin, end = np.searchsorted(at, (low, high)).tolist()
            spans |= dict.fromkeys(names, (begin, end))
        begin, end = np.searchsorted(self.kept_at, (low, high)).tolist()
        packed = Packed(
            **{name: getattr(self.packed, name)[slice(*span)] for name, span in spans.items()}
        )
        return Body(packed, self.rotations, self.objects[begin:end])

    def _make(self, low: int, high: int) -> list[Instruction]:
        """The instructions from ``low`` to before ``high`` as objects, without a loop in Python: this is run often."""
        packed, kept = self.packed, self.packed.kept[low:high]
        begin, end = np.searchsorted(self.at, (low, high)).tolist()
        first, last = np.searchsorted(self.arcs, (low, high)).tolist()
        kind = packed.kind[low:high]
        source = np.where(kept, _KEPT, kind)
        moving = source[kind <= _ARC]
        over = packed.via[first:last], packed.via_rotation[first:last], source[kind == _ARC] == _ARC
        sources: list[Iterator[Instruction]] = []
        for made in (MoveJ, MoveL, MoveC):
            rows = np.flatnonzero(moving == NUMBER[made]) + begin
            places = self._poses(packed.end[rows], packed.rotation[rows])
            vias = [self._poses(over[0][over[2]], over[1][over[2]])] if made is MoveC else []
            rest = (getattr(packed, name)[rows].tolist() for name in ("speed", "blend"))
            free = () if made is MoveJ else (repeat(0.0), repeat(_NO_DIRECTION))
            owner = (getattr(packed, name)[rows].tolist() for name in ("path", "work"))
            sources.append(
                map(made, *vias, places, *rest, *free, repeat(None), repeat(None), *owner)
            )
        begin, end = np.searchsorted(self.kept_at, (low, high)).tolist()
        sources.append(iter(self.objects[begin:end]))
        return list(map(next, map(sources.__getitem__, source.tolist())))

    def _poses(self, places: FloatArray, rotations: NDArray[np.int32]) -> Iterator[Pose]:
        return map(
            Pose, map(self.rotations.__getitem__, rotations.tolist()), map(tuple, places.tolist())
        )


#: Behind the kinds of motions: what is kept as an object.
_KEPT = 3
_OF_MOVES = ("end", "rotation", "speed", "blend", "path", "work")
_OF_ARCS = ("via", "via_rotation")


class Packing(Sequence[Instruction]):
    """A body in the making: it is added to like a list, and packed bit by bit."""

    def __init__(self, items: Iterable[Instruction] = ()) -> None:
        self._open: list[Instruction] = []
        # Buffers grow where they are: a long program is not there twice.
        self._columns = {name: bytearray() for name in _TYPES}
        self._lent = False
        self._objects: list[Instruction] = []
        self._rotations = _Rotations()
        self._packed = 0
        self.extend(items)

    def append(self, item: Instruction) -> None:
        """One more instruction."""
        self._open.append(item)
        if len(self._open) >= _BLOCK:
            self._close()

    def extend(self, items: Iterable[Instruction]) -> None:
        """More of them."""
        left = iter(items)
        while some := list(islice(left, _BLOCK - len(self._open))):
            self._open += some
            if len(self._open) >= _BLOCK:
                self._close()

    def extend_body(self, body: Body) -> None:
        """More of them, which are packed."""
        self._close()
        self._add(_turned(body, self._rotations), body.objects)

    def __len__(self) -> int:
        return self._packed + len(self._open)

    @overload
    def __getitem__(self, index: int) -> Instruction: ...
    @overload
    def __getitem__(self, index: slice) -> tuple[Instruction, ...]: ...
    def __getitem__(self, index: int | slice) -> Instruction | tuple[Instruction, ...]:
        return self.body()[index]

    def __iter__(self) -> Iterator[Instruction]:
        return iter(self.body())

    @property
    def objects(self) -> Sequence[Instruction]:
        """What is kept as objects: all that is no motion is among it."""
        self._close()
        return self._objects

    def body(self) -> Body:
        """All that was added."""
        self._close()
        self._lent = True
        columns: dict[str, Any] = {
            name: np.frombuffer(self._columns[name], kind).reshape(-1, *shape)
            for name, (kind, shape) in _TYPES.items()
        }
        return Body(Packed(**columns), self._rotations.table, self._objects)

    def _add(self, packed: Packed, objects: Sequence[Instruction]) -> None:
        if self._lent:  # a buffer that is looked into cannot grow
            self._columns = {name: bytearray(buffer) for name, buffer in self._columns.items()}
            self._lent = False
        for name, (kind, _) in _TYPES.items():
            self._columns[name] += np.ascontiguousarray(getattr(packed, name), kind).data
        self._objects += objects
        self._packed += len(packed.kind)

    def _close(self) -> None:
        if self._open:
            self._add(*_pack(self._open, self._rotations))
            self._open = []


def pack(items: Iterable[Instruction]) -> Body:
    """The instructions by column."""
    return items if isinstance(items, Body) else Packing(items).body()


def join(*bodies: Body) -> Body:
    """Bodies one after the other."""
    rotations = _Rotations()
    packed = [_turned(body, rotations) for body in bodies]
    columns: dict[str, Any] = {
        name: np.concatenate(
            [np.zeros((0, *shape), kind), *(getattr(one, name) for one in packed)], dtype=kind
        )
        for name, (kind, shape) in _TYPES.items()
    }
    return Body(
        Packed(**columns),
        rotations.table,
        list(chain.from_iterable(body.objects for body in bodies)),
    )


def _turned(body: Body, rotations: _Rotations) -> Packed:
    """The columns of a body with the rotations in another table."""
    packed = body.packed
    places = np.append(rotations.places(body.rotations), np.int32(-1))
    return replace(
        packed, rotation=places[packed.rotation], via_rotation=places[packed.via_rotation]
    )


def _pack(items: Sequence[Instruction], rotations: _Rotations) -> tuple[Packed, list[Instruction]]:
    """The columns of ``items``, and those of them that are kept."""
    kind = np.fromiter(map(NUMBER.__getitem__, map(type, items)), np.int8, len(items))
    moving = kind <= _ARC
    moves: list[Any] = list(compress(items, moving.tolist()))
    plain = np.ones(len(moves), np.bool_)
    if not _are_plain(moves):
        plain[:] = list(map(_is_plain, moves))
    kept = ~moving
    kept[moving] = ~plain
    targets = list(map(attrgetter("target"), moves))
    posed = np.fromiter((type(target) is Pose for target in targets), np.bool_, len(moves))
    poses: list[Pose] = list(compress(targets, posed.tolist()))
    end, rotation = np.full((len(moves), 3), np.nan), np.full(len(moves), -1, np.int32)
    end[posed] = _origins(poses)
    rotation[posed] = rotations.places([pose.rotation for pose in poses])
    vias: list[Pose] = [move.via for move in moves if type(move) is MoveC]
    packed = Packed(
        kind=kind,
        end=end,
        rotation=rotation,
        speed=np.fromiter(map(attrgetter("speed"), moves), np.float64, len(moves)),
        blend=np.fromiter(map(attrgetter("blend"), moves), np.float64, len(moves)),
        path=np.fromiter(map(attrgetter("path"), moves), np.intp, len(moves)),
        work=np.fromiter(map(attrgetter("work"), moves), np.bool_, len(moves)),
        via=_origins(vias),
        via_rotation=rotations.places([pose.rotation for pose in vias]),
        kept=kept,
    )
    return packed, list(compress(items, kept.tolist()))


def _origins(poses: Sequence[Pose]) -> FloatArray:
    flat = chain.from_iterable(map(attrgetter("origin"), poses))
    return np.fromiter(flat, np.float64, 3 * len(poses)).reshape(-1, 3)


def _are_plain(moves: Sequence[Any]) -> bool:
    """Whether the columns say all of all the motions."""
    along = [move for move in moves if type(move) is not MoveJ]
    ever = (
        *(map(attrgetter(name), moves) for name in ("joints", "posture")),
        *(map(attrgetter(name), along) for name in ("force",)),
        (move.turn for move in moves if type(move) is not MoveC),
        (
            move.share or move.rate or type(move.target) is not Pose
            for move in moves
            if type(move) is MoveJ
        ),
    )
    return not any(map(any, ever)) and set(map(attrgetter("force_direction"), along)) <= {
        _NO_DIRECTION
    }


def _is_plain(move: Motion) -> bool:
    """Whether the columns say all of a motion."""
    if move.joints is not None or move.posture is not None or type(move.target) is not Pose:
        return False
    if type(move) is MoveJ:
        return move.share == 0 and move.rate == 0 and move.turn == 0
    assert not isinstance(move, MoveJ)
    turn = move.turn if type(move) is MoveL else 0.0
    return move.force == 0 and turn == 0 and move.force_direction == _NO_DIRECTION


# Bodies that are made by column, a kind of instructions at a time, and put together by where they stand.


class Targets(Struct, frozen=True, eq=False):
    """The poses in which K motions end.

    origin: (K, 3) mm.
    rotation: (K,) places in `table`.
    table: rotations (3, 3).
    via: (K, 3) mm, half-way along an arc, NaN for other motions. None: no arcs.
    via_rotation: (K,) places in `table`, half-way along an arc.
    """

    origin: FloatArray
    rotation: NDArray[np.int32]
    table: Sequence[FloatArray]
    via: FloatArray | None = None
    via_rotation: NDArray[np.int32] | None = None


def plain_motions(
    kind: type,
    targets: Targets,
    *,
    speed: FloatArray | float,
    blend: FloatArray | float,
    path: Indices,
    work: bool,
) -> Body:
    """K motions that columns describe in full: arcs where `targets` have a via point, else `kind`.

    speed, blend: (K,) mm/s and mm, or a number for all motions.
    path: (K,) number of the path of each motion.
    work: whether the motions work on the part.
    """
    size = len(targets.origin)
    via = np.full((size, 3), np.nan) if targets.via is None else targets.via
    turned = targets.rotation if targets.via_rotation is None else targets.via_rotation
    arcs = np.flatnonzero(~np.isnan(via[:, 0]))
    kinds = np.full(size, NUMBER[kind], np.int8)
    kinds[arcs] = _ARC
    packed = Packed(
        kind=kinds,
        end=targets.origin,
        rotation=targets.rotation,
        speed=np.broadcast_to(np.float64(speed), size),
        blend=np.broadcast_to(np.float64(blend), size),
        path=path,
        work=np.broadcast_to(np.bool_(work), size),
        via=via[arcs],
        via_rotation=turned[arcs],
        kept=np.broadcast_to(np.bool_(False), size),
    )
    return Body(packed, targets.table, [])


def merge(pieces: list[tuple[Indices, Body]]) -> Body:
    """One body of the instructions of ``pieces``, each with their places (N,), by which they are sorted; of those at
    one place the ones of the earlier piece come first. ``pieces`` are used up: a long program is not held twice.
    """
    order = np.argsort(np.concatenate([places for places, _ in pieces]), kind="stable")
    rank = np.empty(len(order), np.int32)
    rank[order] = np.arange(len(order), dtype=np.int32)
    del order
    ranks = np.split(rank, np.cumsum([len(body) for _, body in pieces])[:-1])
    kind, kept = np.empty(len(rank), np.int8), np.empty(len(rank), np.bool_)
    for at, (_, body) in zip(ranks, pieces, strict=True):
        kind[at], kept[at] = body.packed.kind, body.packed.kept
    moving, arc = kind <= _ARC, kind == _ARC
    columns = {name: _room(pieces[0][1], name, int(moving.sum())) for name in _OF_MOVES}
    columns |= {name: _room(pieces[0][1], name, int(arc.sum())) for name in _OF_ARCS}
    number = [np.cumsum(mask, dtype=np.int32) - mask for mask in (moving, arc, kept)]
    rotations, objects = _Rotations(), np.empty(int(kept.sum()), np.object_)
    for at in ranks:
        _, body = pieces.pop(0)
        packed, table = body.packed, _table_places(body, rotations)
        moves, arcs = number[0][at[packed.kind <= _ARC]], number[1][at[packed.kind == _ARC]]
        for name in (*_OF_MOVES, *_OF_ARCS):
            column = getattr(packed, name)
            turned = name in ("rotation", "via_rotation")
            columns[name][arcs if name in _OF_ARCS else moves] = table[column] if turned else column
        objects[number[2][at[packed.kept]]] = np.fromiter(
            body.objects, np.object_, len(body.objects)
        )
    return Body(Packed(kind=kind, kept=kept, **columns), rotations.table, objects.tolist())


def _room(like: Body, name: str, size: int) -> NDArray[Any]:
    """An empty column for ``size`` rows."""
    column = getattr(like.packed, name)
    return np.empty((size, *column.shape[1:]), column.dtype)


def _table_places(body: Body, rotations: _Rotations) -> NDArray[np.int32]:
    """Where the rotations that ``body`` uses stand among ``rotations``, into which they are put; last -1, of joints."""
    used = np.zeros(len(body.rotations) + 1, np.bool_)
    used[body.packed.rotation] = used[body.packed.via_rotation] = True
    places = np.full(len(used), -1, np.int32)
    some = np.flatnonzero(used[:-1])
    places[some] = rotations.places([body.rotations[place] for place in some.tolist()])
    return places
