"""The instructions of a long program, packed in columns.

As objects, half a million motions take 150 MB, and a second for one loop over them. A `Body` holds
their numbers in columns and makes an object each time one is used. Instructions that the columns do
not describe in full are kept as objects.
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

#: Numbers of the kinds of instructions in `Packed.kind`; motions come first.
NUMBER: dict[type, int] = {
    MoveJ: 0,
    MoveL: 1,
    MoveC: 2,
    Output: 3,
    Wait: 4,
    Force: 5,
    Comment: 6,
    ToolChange: 7,
    Stop: 8,
}
_SWING, _LINE, _ARC = NUMBER[MoveJ], NUMBER[MoveL], NUMBER[MoveC]
#: Instructions that are objects at the same time while a body is packed or read in order.
_BLOCK = 8192
#: Bisection is faster than a pass over all instructions if fewer than one in 32 is looked up.
_SPARSE = 32
_NO_DIRECTION = (0.0, 0.0, 0.0)


class Packed(Struct, frozen=True, eq=False):
    """The columns of N instructions, M of them motions, A of these arcs.

    kind: (N,) kinds by `NUMBER`.
    end: (M, 3) end of each motion, mm, NaN for joint values.
    rotation: (M,) rotation of the tool there, as index into the table of rotations, -1 for joint
        values.
    speed, blend, path, work: (M,) as in `MoveL`.
    via: (A, 3) via points of the arcs, mm.
    via_rotation: (A,) rotation at the via points, as index into the table.
    kept: (N,) whether an instruction is kept as an object.
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


#: Types of the columns, and shapes of their rows.
_TYPES: dict[str, tuple[type, tuple[int, ...]]] = {
    "kind": (np.int8, ()),
    "end": (np.float64, (3,)),
    "rotation": (np.int32, ()),
    "speed": (np.float64, ()),
    "blend": (np.float64, ()),
    "path": (np.intp, ()),
    "work": (np.bool_, ()),
    "via": (np.float64, (3,)),
    "via_rotation": (np.int32, ()),
    "kept": (np.bool_, ()),
}


class _Rotations:
    """The rotations of a body, each object once.

    table: (3, 3) rotations.
    """

    def __init__(self) -> None:
        self.table: list[FloatArray] = []
        self._index_of: dict[int, int] = {}

    def places(self, rotations: Sequence[FloatArray]) -> NDArray[np.int32]:
        """Their indices into the table, to which new ones are added."""
        keys = list(map(id, rotations))
        for key, rotation in dict(zip(keys, rotations, strict=True)).items():
            if key not in self._index_of:
                self._index_of[key] = len(self.table)
                self.table.append(rotation)
        return np.fromiter(map(self._index_of.__getitem__, keys), np.int32, len(keys))


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
    """The instructions of a program in columns. Each access to an instruction makes a new object.

    packed: the columns.
    rotations: the table of rotations to which the columns refer.
    objects: the instructions that are kept as objects, in order.
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
        blocks = (self._make(low, min(low + _BLOCK, size)) for low in range(0, size, _BLOCK))
        return chain.from_iterable(blocks)

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
        """(M,) indices of the motions, sorted."""
        return np.flatnonzero(self.packed.kind <= _ARC)

    @cached_property
    def arcs(self) -> Indices:
        """(A,) indices of the arcs, sorted."""
        return np.flatnonzero(self.packed.kind == _ARC)

    @cached_property
    def kept_at(self) -> Indices:
        """Indices of the instructions that are kept as objects, sorted."""
        return np.flatnonzero(self.packed.kept)

    def pick(self, indices: Indices) -> list[Instruction]:
        """The instructions at sorted `indices`."""
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
        """The indices (K,) of the instructions of one type, and these instructions."""
        if NUMBER[kind] <= _ARC:
            at = np.flatnonzero(self.packed.kind == NUMBER[kind])
            return at, self.pick(at)
        # Other instructions than motions are always kept.
        ranks = np.flatnonzero(self.packed.kind[self.kept_at] == NUMBER[kind])
        return self.kept_at[ranks], list(map(self.objects.__getitem__, ranks.tolist()))

    def take(self, indices: Indices) -> Body:
        """A body of the instructions at sorted `indices`."""
        packed = self.packed
        kind, kept = packed.kind[indices], packed.kept[indices]
        moves = self._ranks(self.at, indices[kind <= _ARC])
        arcs = self._ranks(self.arcs, indices[kind == _ARC])
        objects = self._ranks(self.kept_at, indices[kept])
        of_moves = {name: getattr(packed, name)[moves] for name in _MOTION_COLUMNS}
        of_arcs = {name: getattr(packed, name)[arcs] for name in _ARC_COLUMNS}
        chosen = Packed(kind=kind, kept=kept, **of_moves, **of_arcs)
        return Body(chosen, self.rotations, list(map(self.objects.__getitem__, objects.tolist())))

    def _ranks(self, at: Indices, indices: Indices) -> Indices | NDArray[np.int32]:
        """The places of `indices` in `at`, which is sorted and has all of them."""
        if _SPARSE * len(indices) < len(self):
            return np.searchsorted(at, indices)
        is_listed = np.zeros(len(self), np.bool_)
        is_listed[at] = True
        return (np.cumsum(is_listed, dtype=np.int32) - 1)[indices]

    def stretch(self, low: int, high: int) -> Body:
        """The instructions from `low` to before `high`, as views of the same columns."""
        spans = {"kind": (low, high), "kept": (low, high)}
        for names, at in ((_MOTION_COLUMNS, self.at), (_ARC_COLUMNS, self.arcs)):
            begin, end = np.searchsorted(at, (low, high)).tolist()
            spans |= dict.fromkeys(names, (begin, end))
        begin, end = np.searchsorted(self.kept_at, (low, high)).tolist()
        columns = {}
        for name, span in spans.items():
            columns[name] = getattr(self.packed, name)[slice(*span)]
        return Body(Packed(**columns), self.rotations, self.objects[begin:end])

    def _make(self, low: int, high: int) -> list[Instruction]:
        """The instructions from `low` to before `high` as objects.

        It runs often, so it has no loop over instructions in Python: there is one iterator for each
        kind of motion and one for kept objects, and each instruction is the next of its iterator.
        """
        packed, kept = self.packed, self.packed.kept[low:high]
        begin, end = np.searchsorted(self.at, (low, high)).tolist()
        first, last = np.searchsorted(self.arcs, (low, high)).tolist()
        kind = packed.kind[low:high]
        source = np.where(kept, _KEPT, kind)
        motion_source = source[kind <= _ARC]
        is_made = source[kind == _ARC] == _ARC
        via = packed.via[first:last][is_made]
        via_rotation = packed.via_rotation[first:last][is_made]
        sources: list[Iterator[Instruction]] = []
        for motion in (MoveJ, MoveL, MoveC):
            rows = np.flatnonzero(motion_source == NUMBER[motion]) + begin
            targets = self._poses(packed.end[rows], packed.rotation[rows])
            vias = [self._poses(via, via_rotation)] if motion is MoveC else []
            limits = (getattr(packed, name)[rows].tolist() for name in ("speed", "blend"))
            force = () if motion is MoveJ else (repeat(0.0), repeat(_NO_DIRECTION))
            owner = (getattr(packed, name)[rows].tolist() for name in ("path", "work"))
            joints, posture = repeat(None), repeat(None)
            sources.append(map(motion, *vias, targets, *limits, *force, joints, posture, *owner))
        begin, end = np.searchsorted(self.kept_at, (low, high)).tolist()
        sources.append(iter(self.objects[begin:end]))
        return list(map(next, map(sources.__getitem__, source.tolist())))

    def _poses(self, origins: FloatArray, rotations: NDArray[np.int32]) -> Iterator[Pose]:
        """Poses with `origins` (K, 3) and with rotations of the table (K,)."""
        tables = map(self.rotations.__getitem__, rotations.tolist())
        return map(Pose, tables, map(tuple, origins.tolist()))


#: Number of the kept objects in `Body._make`, after the kinds of motions.
_KEPT = 3
_MOTION_COLUMNS = ("end", "rotation", "speed", "blend", "path", "work")
_ARC_COLUMNS = ("via", "via_rotation")


class BodyBuilder(Sequence[Instruction]):
    """Builds a body: instructions are added as to a list, and packed in blocks."""

    def __init__(self, items: Iterable[Instruction] = ()) -> None:
        self._open: list[Instruction] = []
        # Buffers grow in place, so a long program is not held twice.
        self._columns = {name: bytearray() for name in _TYPES}
        self._lent = False
        self._objects: list[Instruction] = []
        self._rotations = _Rotations()
        self._packed = 0
        self.extend(items)

    def append(self, item: Instruction) -> None:
        """Adds an instruction."""
        self._open.append(item)
        if len(self._open) >= _BLOCK:
            self._close()

    def extend(self, items: Iterable[Instruction]) -> None:
        """Adds instructions."""
        pending = iter(items)
        while block := list(islice(pending, _BLOCK - len(self._open))):
            self._open += block
            if len(self._open) >= _BLOCK:
                self._close()

    def extend_body(self, body: Body) -> None:
        """Adds the instructions of a body, without making objects of them."""
        self._close()
        self._add(_with_table(body, self._rotations), body.objects)

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
        """The instructions that are kept as objects. All that are not motions are among them."""
        self._close()
        return self._objects

    def body(self) -> Body:
        """A body of all instructions that were added."""
        self._close()
        self._lent = True
        columns: dict[str, Any] = {
            name: np.frombuffer(self._columns[name], kind).reshape(-1, *shape)
            for name, (kind, shape) in _TYPES.items()
        }
        return Body(Packed(**columns), self._rotations.table, self._objects)

    def _add(self, packed: Packed, objects: Sequence[Instruction]) -> None:
        if self._lent:  # a buffer that an array refers to cannot grow
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
    """The instructions as a body; a body is returned as it is."""
    return items if isinstance(items, Body) else BodyBuilder(items).body()


def join(*bodies: Body) -> Body:
    """The bodies joined in the given order."""
    rotations = _Rotations()
    packed = [_with_table(body, rotations) for body in bodies]
    columns: dict[str, Any] = {}
    for name, (kind, shape) in _TYPES.items():
        parts = [getattr(part, name) for part in packed]
        columns[name] = np.concatenate([np.zeros((0, *shape), kind), *parts], dtype=kind)
    objects = list(chain.from_iterable(body.objects for body in bodies))
    return Body(Packed(**columns), rotations.table, objects)


def _with_table(body: Body, rotations: _Rotations) -> Packed:
    """The columns of a body, with its rotations as indices into another table."""
    packed = body.packed
    places = np.append(rotations.places(body.rotations), np.int32(-1))
    rotation, via_rotation = places[packed.rotation], places[packed.via_rotation]
    return replace(packed, rotation=rotation, via_rotation=via_rotation)


def _pack(items: Sequence[Instruction], rotations: _Rotations) -> tuple[Packed, list[Instruction]]:
    """The columns of `items`, and those of `items` that are kept as objects."""
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
    """Whether the columns describe all of the motions in full, without a loop in Python."""
    tcp_motions = [move for move in moves if type(move) is not MoveJ]
    joint_motions = [move for move in moves if type(move) is MoveJ]
    extras = (
        *(map(attrgetter(name), moves) for name in ("joints", "posture")),
        map(attrgetter("force"), tcp_motions),
        (move.turn for move in moves if type(move) is not MoveC),
        (move.share or move.rate or type(move.target) is not Pose for move in joint_motions),
    )
    if any(map(any, extras)):
        return False
    return set(map(attrgetter("force_direction"), tcp_motions)) <= {_NO_DIRECTION}


def _is_plain(move: Motion) -> bool:
    if move.joints is not None or move.posture is not None or type(move.target) is not Pose:
        return False
    if type(move) is MoveJ:
        return move.share == 0 and move.rate == 0 and move.turn == 0
    assert not isinstance(move, MoveJ)
    turn = move.turn if type(move) is MoveL else 0.0
    return move.force == 0 and turn == 0 and move.force_direction == _NO_DIRECTION


# Bodies that are made in columns, one kind of instructions at a time, and merged by their places.


class Targets(Struct, frozen=True, eq=False):
    """The poses in which K motions end.

    origin: (K, 3) mm.
    rotation: (K,) indices into `table`.
    table: rotations (3, 3).
    via: (K, 3) via points of arcs, mm, NaN for other motions. None: no arcs.
    via_rotation: (K,) rotations at the via points, as indices into `table`.
    """

    origin: FloatArray
    rotation: NDArray[np.int32]
    table: Sequence[FloatArray]
    via: FloatArray | None = None
    via_rotation: NDArray[np.int32] | None = None


def make_plain_motions(
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
    via_rotation = targets.rotation if targets.via_rotation is None else targets.via_rotation
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
        via_rotation=via_rotation[arcs],
        kept=np.broadcast_to(np.bool_(False), size),
    )
    return Body(packed, targets.table, [])


def merge(pieces: list[tuple[Indices, Body]]) -> Body:
    """One body of the instructions of `pieces`, sorted by their places.

    Instructions of different pieces with one place stay in the order of the pieces.

    pieces: bodies with the place (N,) of each of their instructions. The list is emptied, so that a
        long program is not held twice.
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
    columns: dict[str, NDArray[Any]] = {}
    for names, mask in ((_MOTION_COLUMNS, moving), (_ARC_COLUMNS, arc)):
        for name in names:
            dtype, shape = _TYPES[name]
            columns[name] = np.empty((int(mask.sum()), *shape), dtype)
    move_row, arc_row, object_row = (
        np.cumsum(mask, dtype=np.int32) - mask for mask in (moving, arc, kept)
    )
    rotations, objects = _Rotations(), np.empty(int(kept.sum()), np.object_)
    for at in ranks:
        _, body = pieces.pop(0)
        packed, table = body.packed, _table_places(body, rotations)
        moves, arcs = move_row[at[packed.kind <= _ARC]], arc_row[at[packed.kind == _ARC]]
        for name in _MOTION_COLUMNS:
            column = getattr(packed, name)
            columns[name][moves] = table[column] if name == "rotation" else column
        columns["via"][arcs] = packed.via
        columns["via_rotation"][arcs] = table[packed.via_rotation]
        body_objects = np.fromiter(body.objects, np.object_, len(body.objects))
        objects[object_row[at[packed.kept]]] = body_objects
    return Body(Packed(kind=kind, kept=kept, **columns), rotations.table, objects.tolist())


def _table_places(body: Body, rotations: _Rotations) -> NDArray[np.int32]:
    """The indices into `rotations` of the rotations of `body`, to which they are added.

    Rotations that the body does not use have -1, and so has the last index, for joint values.
    """
    used = np.zeros(len(body.rotations) + 1, np.bool_)
    used[body.packed.rotation] = used[body.packed.via_rotation] = True
    places = np.full(len(used), -1, np.int32)
    indices = np.flatnonzero(used[:-1])
    places[indices] = rotations.places([body.rotations[index] for index in indices.tolist()])
    return places
