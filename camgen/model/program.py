"""A program: its frames and its body of instructions, the rules that it keeps, and its instructions by column."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import cached_property
from itertools import chain, compress
from operator import attrgetter
from typing import Any

import numpy as np
from msgspec import Struct
from msgspec.structs import replace
from numpy.typing import NDArray

from camgen.model.body import NUMBER, Body, Indices, Mask, Packing, join, pack
from camgen.model.errors import Refused
from camgen.model.instructions import (
    Comment,
    Force,
    Instruction,
    Joints,
    Motion,
    MoveC,
    MoveJ,
    MoveL,
    Origin,
    Output,
    Posture,
    Stop,
    ToolChange,
    Wait,
)
from camgen.model.pose import FloatArray, Pose
from camgen.model.text import counted
from camgen.model.tolerance import SAME_POINT_MM

#: All that a program is made of is found here.
__all__ = [
    "RULES", "Body", "Columns", "Comment", "Force", "Indices", "Instruction", "Joints", "Mask",
    "Motion", "MoveC", "MoveJ", "MoveL", "Origin", "Output", "Packing", "Posture", "Program",
    "Stop", "ToolChange", "Wait", "check", "check_frame", "column", "distinct", "join",
    "motions", "numbers", "pack", "put_at", "put_off_first", "splice", "take",
]  # fmt: skip

# Instructions by column: a program may hold half a million of them, and a loop over them in Python takes seconds.


class Columns:
    """The columns of a body of N instructions, M of them motions; what is not packed is worked out when asked for."""

    def __init__(self, body: Sequence[Instruction]) -> None:
        self.body = body
        self._packed = pack(body)

    def stretch(self, low: int, high: int) -> Columns:
        """The columns of the instructions from ``low`` to before ``high``."""
        return Columns(self._packed.stretch(low, high))

    def are(self, *kinds: type) -> Mask:
        """(N,): which instructions are of one of the types ``kinds``."""
        return _any_of(self._packed.packed.kind, kinds)

    def of(self, *kinds: type) -> list[Any]:
        """The instructions of the types ``kinds``."""
        return self.pick(np.flatnonzero(self.are(*kinds)))

    def alike(self, kind: type, test: Callable[[Any], bool]) -> Mask:
        """(N,) which instructions of the type `kind` pass `test`; each object is tested once."""
        distinct = self._packed.distinct(kind)
        passed = np.array(list(map(test, distinct.items)), np.bool_)
        found = np.zeros(len(self.body), np.bool_)
        found[distinct.at[passed[distinct.number]]] = True
        return found

    @property
    def outputs(self) -> list[Any]:
        """The outputs, each object once, in order of its first place."""
        return self._packed.distinct(Output).items

    def pick(self, indices: Indices) -> list[Any]:
        """The instructions at ``indices``, which rise."""
        if isinstance(self.body, Body):
            return self.body.pick(indices)
        return list(map(self.body.__getitem__, indices.tolist()))

    @property
    def at(self) -> Indices:
        """(M,): where the motions stand in the body."""
        return self._packed.at

    @cached_property
    def moves(self) -> Moves:
        """The motions, each as an object when it is asked for."""
        return Moves(self)

    @cached_property
    def kinds(self) -> NDArray[np.int8]:
        """(M,): the kinds of the motions by number, as in ``body.NUMBER``: MoveJ, MoveL, MoveC."""
        return self._packed.packed.kind[self.at]

    def moves_are(self, *kinds: type) -> Mask:
        """(M,): which motions are of one of the types ``kinds``."""
        return _any_of(self.kinds, kinds)

    def before(self, indices: Indices) -> Indices:
        """The numbers of the motions before the instructions at ``indices``, -1 where there is none."""
        return np.asarray(np.searchsorted(self.at, indices) - 1)

    def pose(self, motion: int) -> Pose | None:
        """The pose to which a motion goes; none for one to joint values, and for motion -1."""
        target = self.moves[motion].target if motion >= 0 else None
        return target if isinstance(target, Pose) else None

    def neighbours(self, indices: Indices) -> tuple[list[Motion | None], list[Motion | None]]:
        """The motions before and after the instructions at `indices` (K,), which rise.

        None without such a motion.
        """
        numbers = np.append(self.before(indices), np.searchsorted(self.at, indices, side="right"))
        some, places = np.unique(numbers, return_inverse=True)
        is_there = (some >= 0) & (some < len(self.at))
        motions: list[Motion | None] = [None] * len(some)
        made = self.pick(self.at[some[is_there]])
        for place, motion in zip(np.flatnonzero(is_there).tolist(), made, strict=True):
            motions[place] = motion
        around = [motions[place] for place in places.tolist()]
        return around[: len(indices)], around[len(indices) :]

    @cached_property
    def posed(self) -> Mask:
        """(M,): which motions have a pose as their target, not joint values."""
        return self.rotation >= 0

    @property
    def table(self) -> Sequence[FloatArray]:
        """The rotations of the tool, each object once: programs share them."""
        return self._packed.rotations

    @property
    def rotation(self) -> NDArray[np.int32]:
        """(M,): the place in ``table`` of the rotation where each motion ends, -1 for those to joint values."""
        return self._packed.packed.rotation

    @property
    def via_rotation(self) -> NDArray[np.int32]:
        """(A,): the same half-way along the arcs."""
        return self._packed.packed.via_rotation

    def turned_as(self, rotation: FloatArray) -> Mask:
        """(M,): which motions go to a pose whose rotation is this very object, as programs share them."""
        return np.isin(
            self.rotation, [place for place, one in enumerate(self.table) if one is rotation]
        )

    def rotations(self, where: Mask) -> list[FloatArray]:
        """The rotations of the tool at the ends of the motions ``where`` (M,), which have poses as their targets."""
        return list(map(self.table.__getitem__, self.rotation[where].tolist()))

    @property
    def ends(self) -> FloatArray:
        """(M, 3): where motions end, NaN for those to joint values."""
        return self._packed.packed.end

    @property
    def vias(self) -> FloatArray:
        """(M, 3): the via points of arcs, NaN for other motions; made anew each time."""
        vias = np.full(self.ends.shape, np.nan)
        vias[self.arcs] = self.via
        return vias

    @property
    def arcs(self) -> Indices:
        """(A,): which motions are arcs."""
        return np.flatnonzero(self.moves_are(MoveC))

    @property
    def via(self) -> FloatArray:
        """(A, 3): the via points of the arcs."""
        return self._packed.packed.via

    def vias_of(self, motions: Indices) -> FloatArray:
        """(K, 3): the via points of motions (K,) that are arcs."""
        return self.via[np.searchsorted(self.arcs, motions)]

    @property
    def speed(self) -> FloatArray:
        """(M,): mm/s."""
        return self._packed.packed.speed

    @cached_property
    def share(self) -> FloatArray:
        """(M,): of the joints' greatest speeds, 0 where it is not known."""
        return self._say("share")[:, 0]

    @cached_property
    def rate(self) -> FloatArray:
        """(M,): speeds of the joints with the longest way, rad/s, 0 if not known."""
        return self._say("rate")[:, 0]

    @property
    def blend(self) -> FloatArray:
        """(M,): mm."""
        return self._packed.packed.blend

    @cached_property
    def force(self) -> FloatArray:
        """(M,): N, 0 for motions of the joints."""
        return self._say("force")[:, 0]

    @cached_property
    def force_direction(self) -> FloatArray:
        """(M, 3): see ``MoveL``, 0 for motions of the joints."""
        return self._say("force_direction", 3)

    @cached_property
    def turn(self) -> FloatArray:
        """(M,): rad/s at which the tool turns on the spot, 0 for motions that travel."""
        return self._say("turn")[:, 0]

    def _say(self, name: str, width: int = 1) -> FloatArray:
        """(M, width): an attribute of the motions, 0 of those that have it not."""
        places, moves = self.special
        told = np.array(
            [getattr(move, name, (0.0,) * width if width > 1 else 0.0) for move in moves],
            np.float64,
        )
        if not told.any():
            return np.broadcast_to(np.float64(0.0), (len(self.at), width))
        found = np.zeros((len(self.at), width))
        found[places] = told.reshape(-1, width)
        return found

    @cached_property
    def special(self) -> tuple[Indices, list[Any]]:
        """The motions that are more than end, speed and blend: to joint values, with joints, a posture, force, a share
        or a speed of turning. Their places among the motions, and they themselves.
        """
        kept = self._packed.packed.kept[self.at]
        return np.flatnonzero(kept), self.pick(self.at[kept])

    @cached_property
    def turned(self) -> Mask:
        """(M,): which straight motions turn the tool where its TCP stays in its place."""
        mask = self.moves_are(MoveL)
        mask[1:] &= self.posed[:-1]
        mask[:1] = False
        rotation, table = self.rotation, self.table
        mask[1:] &= rotation[1:] != rotation[:-1]
        rows = np.flatnonzero(mask)
        mask[rows] = (
            np.abs(self.ends[rows] - self.ends[rows - 1]).max(axis=1, initial=0.0) < SAME_POINT_MM
        )
        rows = np.flatnonzero(mask)
        both = zip(rotation[rows - 1].tolist(), rotation[rows].tolist(), strict=True)
        mask[rows] = [not np.array_equal(table[a], table[b]) for a, b in both]
        return mask

    @property
    def path(self) -> Indices:
        """(M,): the place in ``Program.paths`` of the path that each motion belongs to, -1: none."""
        return self._packed.packed.path

    @property
    def works(self) -> Mask:
        """(M,): which motions run along their path."""
        return self._packed.packed.work

    @cached_property
    def arrives(self) -> Mask:
        """(M,): which motions lead from a path to above the start of another one, or home from the last."""
        return np.append(False, self.path[1:] != self.path[:-1]) & ~self.works

    def find_rotations(self, sound: Callable[[FloatArray], bool]) -> Iterator[int]:
        """The first instruction with a rotation at its end, and the first one with a rotation half-way, that is not
        ``sound``.
        """
        wrong = [place for place, one in enumerate(self.table) if not sound(one)]
        for at, places in ((self.at, self.rotation), (self._packed.arcs, self.via_rotation)):
            yield from at[np.isin(places, wrong)][:1].tolist() if wrong else ()


class Moves(Sequence[Any]):
    """The motions of a body."""

    def __init__(self, columns: Columns) -> None:
        self._columns = columns

    def __len__(self) -> int:
        return len(self._columns.at)

    def __getitem__(self, index: Any) -> Any:
        at = self._columns.at[index]
        return self._columns.pick(at) if isinstance(index, slice) else self._columns.body[int(at)]

    def __iter__(self) -> Iterator[Any]:
        return compress(self._columns.body, self._columns.are(MoveJ, MoveL, MoveC).tolist())


def splice(
    body: Sequence[Instruction], changed: Mapping[int, Sequence[Instruction]]
) -> Sequence[Instruction]:
    """The body with others in the place of the instructions whose indices are the keys of ``changed``; packed where it
    was.
    """
    if isinstance(body, Body):
        return _splice_packed(body, changed)
    pieces: list[Instruction] = []
    done = 0
    for index in sorted(changed):
        pieces += body[done:index]
        pieces += changed[index]
        done = index + 1
    pieces += body[done:]
    return tuple(pieces)


def _splice_packed(body: Body, changed: Mapping[int, Sequence[Instruction]]) -> Body:
    places = sorted(changed)
    new = pack(chain.from_iterable(changed[place] for place in places))
    return put_at(body, places, [len(changed[place]) for place in places], new)


def put_at(
    body: Body, places: Sequence[int] | Indices, sizes: Sequence[int] | Indices, new: Body
) -> Body:
    """The body with the instructions of ``new`` in the place of those at ``places``, which rise; ``sizes`` of them for
    each.
    """
    counts = np.ones(len(body), np.intp)
    counts[places] = sizes
    order = np.repeat(np.arange(len(body)), counts)
    replaced = np.zeros(len(body), np.bool_)
    replaced[places] = True
    order[replaced[order]] = len(body) + np.arange(len(new))
    return join(body, new).take(order)


def _any_of(numbered: NDArray[np.int8], kinds: Iterable[type]) -> Mask:
    mask = np.zeros(len(numbered), np.bool_)
    for kind in kinds:
        mask |= numbered == NUMBER[kind]
    return mask


def take(items: Sequence[Any], keep: Mask) -> list[Any]:
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


def distinct(items: Sequence[Any], name: str) -> list[Any]:
    """The different objects that are an attribute of the items: most of them share rotations and directions."""
    values = list(map(attrgetter(name), items))
    return list(dict(zip(map(id, values), values, strict=True)).values())


# The rules that every program keeps, looked at by column: a body may hold a hundred thousand motions.

#: The name by which a body that breaks one is refused.
RULES = "program"
_BLENDS = "a motion before an output, a wait or a force change must not blend"


def check(columns: Columns, paths: int = 0) -> None:
    """Raises Refused for the first instruction of a body that breaks a rule of ``Program`` with so many ``paths``."""
    at, speed, blend = columns.at, columns.speed, columns.blend
    waits = np.flatnonzero(columns.are(Wait))
    broken = [
        *_first(
            at[:1][~columns.moves_are(MoveJ)[:1]], "the first motion must be joint-interpolated"
        ),
        *_not_finite(columns),
        *_first(
            at[~(speed > 0) | (blend < 0)], "a speed must be positive and a blend not negative"
        ),
        *_first(
            at[~((columns.share >= 0) & (columns.share <= 1))],
            "a share of the joints' speeds must be from 0 to 1",
        ),
        *_first(
            at[~((columns.rate >= 0) & np.isfinite(columns.rate))],
            "a speed of a joint must not be negative",
        ),
        *_first(
            at[(columns.path < -1) | (columns.path >= paths)],
            "a motion belongs to a path that there is none of",
        ),
        *_first(
            at[columns.turned & ~(columns.turn > 0)],
            "a motion that only turns the tool has no speed of turning",
        ),
        *_first(at[~(columns.turn >= 0)], "a speed of turning must not be negative"),
        *_first(waits[column(columns.of(Wait), "seconds") < 0], "a wait must not be negative"),
        *_blending(columns),
        *_pressing(columns),
        *_left_on(columns),
        *_changing(columns),
    ]
    if broken:
        index, what = min(broken, key=lambda one: one[0])
        raise Refused(RULES, index, what)


def check_frame(frame: Pose) -> None:
    """Raises Refused for a frame with a number that is not finite."""
    if not (np.isfinite(frame.rotation).all() and all(map(math.isfinite, frame.origin))):
        raise Refused(RULES, -1, "a number is not finite")


def _first(indices: Indices, what: str) -> Iterator[tuple[int, str]]:
    for index in indices[:1].tolist():
        yield index, what


def _not_finite(columns: Columns) -> Iterator[tuple[int, str]]:
    """Instructions with a number that is not finite, the first of each kind."""
    for where, values in (
        (None, columns.speed),
        (None, columns.blend),
        (None, columns.force),
        (None, columns.force_direction),
        (None, columns.turn),
        (columns.posed, columns.ends),
    ):
        good = _finite(values)
        yield from _first(
            columns.at[~good if where is None else ~good & where], "a number is not finite"
        )
    yield from _first(columns.at[columns.arcs[~_finite(columns.via)]], "a number is not finite")
    for index in columns.find_rotations(_sound):
        yield index, "a number is not finite"
    places, special = columns.special
    told = [one.joints is None or _sound(one.joints.values) for one in special]
    aimed = [not isinstance(one.target, Joints) or _sound(one.target.values) for one in special]
    for sound in (told, aimed):
        yield from _first(columns.at[places[~np.array(sound, np.bool_)]], "a number is not finite")
    for kind, name in (
        (Output, "value"),
        (Wait, "seconds"),
        (Force, "newtons"),
        (Force, "force_direction"),
    ):
        different = columns.outputs if kind is Output else columns.of(kind)
        if not all(map(_sound, distinct(different, name))):
            bad = [not _sound(getattr(item, name)) for item in columns.of(kind)]
            yield from _first(np.flatnonzero(columns.are(kind))[bad], "a number is not finite")


def _finite(values: FloatArray) -> Mask:
    """(N,): in which rows all numbers are finite."""
    finite = np.isfinite(values)
    if finite.all():
        return np.ones(len(values), np.bool_)
    return np.asarray(finite.all(axis=1)) if finite.ndim == 2 else finite


def _sound(value: float | Sequence[float] | FloatArray) -> bool:
    if isinstance(value, float):
        return math.isfinite(value)
    if isinstance(value, tuple):
        return all(map(math.isfinite, value))
    return bool(np.isfinite(value).all())


def _blending(columns: Columns) -> Iterator[tuple[int, str]]:
    """Motions that blend although no motion follows."""
    moving = columns.are(MoveJ, MoveL, MoveC)[~columns.are(Comment)]
    goes_on = np.append(moving[1:], False)[moving]
    last = np.append(np.zeros(max(len(moving) - 1, 0), np.bool_), True)[: len(moving)][moving]
    stops = (columns.blend > 0) & ~goes_on
    yield from _first(columns.at[stops & ~last], _BLENDS)
    yield from _first(columns.at[stops & last], "the last motion must not blend")


def _pressing(columns: Columns) -> Iterator[tuple[int, str]]:
    """Motions that press while force control is off."""
    if not (columns.force > 0).any():
        return
    switches: list[Any] = columns.of(Force)
    newtons = np.append(0.0, column(switches, "newtons"))
    on = newtons[np.searchsorted(np.flatnonzero(columns.are(Force)), columns.at)] > 0
    yield from _first(
        columns.at[(columns.force > 0) & ~on], "a motion presses while force control is off"
    )


def _left_on(columns: Columns) -> Iterator[tuple[int, str]]:
    """Outputs, and force control, of which a program does not know at its first motion or at its end that they are off:
    one that was aborted is run again from its first line.
    """
    at = np.flatnonzero(columns.are(Output, Force))
    switches = columns.of(Output, Force)
    first = int(columns.at[0]) if len(columns.at) else len(columns.body)
    before, after = (
        _last_values(some) for some in (switches[: int(np.searchsorted(at, first))], switches)
    )
    names = {signal: "force control" if signal is None else f"output {signal}" for signal in after}
    if len(columns.at):
        for signal, name in names.items():
            if before.get(signal, 1.0) != 0:
                yield first, f"{name} is not switched off before the first motion"
    for signal, name in names.items():
        if after[signal] != 0:
            yield len(columns.body) - 1, f"{name} must be off at the end"


def _last_values(switches: Sequence[Output | Force]) -> dict[str | None, float]:
    """What each signal, None: the force, is set to last. Each object is looked at once: it stands in many places."""
    keys = list(map(id, switches))
    last = dict(zip(keys, range(len(keys)), strict=True))
    values: dict[str | None, tuple[int, float]] = {}
    for key, item in dict(zip(keys, switches, strict=True)).items():
        name, value = (
            (item.signal, item.value) if isinstance(item, Output) else (None, item.newtons)
        )
        values[name] = max(values.get(name, (-1, 0.0)), (last[key], value))
    return {name: value for name, (_, value) in values.items()}


def _changing(columns: Columns) -> Iterator[tuple[int, str]]:
    """Tool changes with something on, and motions after one that are not joint-interpolated."""
    on = set[str]()
    changed = False
    for index in np.flatnonzero(columns.are(ToolChange)).tolist():
        changed = True
        if index + 1 < len(columns.body) and not isinstance(_moved(columns, index), MoveJ):
            yield index, "the first motion after a tool change must be joint-interpolated"
    if not changed:
        return
    for index in np.flatnonzero(columns.are(Output, Force, ToolChange)).tolist():
        item = columns.body[index]
        if isinstance(item, ToolChange):
            if on:
                yield index, f"{min(on)} is on at a tool change"
            continue
        name, value = _switched(item)
        (on.add if value else on.discard)(name)


def _moved(columns: Columns, index: int) -> Motion | None:
    """The first motion after the instruction at ``index``."""
    after = int(np.searchsorted(columns.at, index))
    return columns.moves[after] if after < len(columns.moves) else None


def _switched(item: Instruction) -> tuple[str, float]:
    if isinstance(item, Output):
        return f"output {item.signal}", item.value
    assert isinstance(item, Force)
    return "force control", item.newtons


def put_off_first(body: Sequence[Instruction]) -> Sequence[Instruction]:
    """The body after instructions that switch off every output and the force control that it uses, but for outputs that
    it switches off itself before it moves: where it is run again after an abort, nothing moves with the tool on.
    """
    columns = Columns(body)
    first = int(columns.at[0]) if len(columns.at) else len(body)
    # As the last instruction before the first motion has it.
    before = {item.signal: item.value for item in body[:first] if isinstance(item, Output)}
    names = {item.signal: None for item in columns.outputs if before.get(item.signal, 1.0) != 0}
    force = [Force(0.0)] if columns.are(Force).any() else []
    off: list[Instruction] = [*(Output(name, 0.0) for name in names), *force]
    return join(pack(off), body) if isinstance(body, Body) else (*off, *body)


# The typed program between planning and posts: few instructions, checked once.


class Program(Struct, frozen=True, eq=False, dict=True):
    """A whole program in one work frame.

    base_from_work and flange_from_tool: the frames that the poses are in. header: remarks for its top, in order. paths:
    what the motions are there for, see ``path_of``. Construction raises Refused unless the first motion is
    joint-interpolated, every number is finite, every speed positive, every path known, no motion before an output, a
    wait, a force change or the end blends, and every output and the force control that it uses are switched off before
    the first motion and left off at the end.
    """

    name: str
    base_from_work: Pose
    flange_from_tool: Pose
    body: Sequence[Instruction]
    header: tuple[str, ...] = ()
    paths: tuple[Origin, ...] = ()

    def __post_init__(self) -> None:
        for frame in (self.base_from_work, self.flange_from_tool):
            check_frame(frame)
        check(self.columns, len(self.paths))

    @cached_property
    def columns(self) -> Columns:
        """The body by column."""
        return Columns(self.body)

    def path_of(self, index: int) -> Origin | None:
        """What the motion at ``index`` of the body is there for, or the one before it where that is none."""
        motion = int(np.searchsorted(self.columns.at, index, side="right")) - 1
        path = int(self.columns.path[motion]) if motion >= 0 else -1
        return self.paths[path] if path >= 0 else None

    def path_at(self, index: int) -> int:
        """The path that the motion at ``index`` of the body belongs to; for the way home that of the last before it;
        -1: none.
        """
        before = self.columns.path[: int(np.searchsorted(self.columns.at, index, side="right"))]
        return int(before[before >= 0][-1]) if (before >= 0).any() else -1

    def place_of(self, index: int) -> str:
        """Where the motion at ``index`` of the body is, in words."""
        origin = self.path_of(index)
        if origin is not None:
            return f"{'edge' if origin.operation == 'edges' else 'path'} {origin.id}"
        begun = self.columns.path[: int(np.searchsorted(self.columns.at, index, side="right"))] >= 0
        return "the way home" if begun.any() else "the way to the first path"

    def with_body(self, body: Sequence[Instruction]) -> Program:
        """The same program with another body."""
        return replace(self, body=body)

    def with_blends(self, blends: Mapping[int, float]) -> Program:
        """The same program with other blends, mm, by motion."""
        columns = self.columns
        changed = {
            int(columns.at[k]): [replace(columns.moves[k], blend=blend)]
            for k, blend in blends.items()
        }
        return self.with_body(splice(self.body, changed))

    def __repr__(self) -> str:
        moves = counted(len(self.columns.moves), "motion")
        return f"Program({self.name!r}, {counted(len(self.body), 'instruction')}, {moves})"


def motions(body: Sequence[Instruction]) -> Iterator[tuple[int, Motion]]:
    """The motions of a body with their index in it."""
    for index, item in enumerate(body):
        if isinstance(item, (MoveL, MoveC, MoveJ)):
            yield index, item
