"""A program: its frames, its body of instructions, the rules that it keeps, and views by column."""

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

from camgen.model.body import NUMBER, Body, BodyBuilder, Indices, Mask, join, pack
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
from camgen.model.sequences import take_rows
from camgen.model.text import counted
from camgen.model.tolerance import SAME_POINT_MM

#: Everything of which a program consists can be imported from here.
__all__ = [
    "RULES",
    "Body",
    "BodyBuilder",
    "Columns",
    "Comment",
    "Force",
    "Indices",
    "Instruction",
    "Joints",
    "Mask",
    "Motion",
    "MoveC",
    "MoveJ",
    "MoveL",
    "Origin",
    "Output",
    "Posture",
    "Program",
    "Stop",
    "ToolChange",
    "Wait",
    "check",
    "check_frame",
    "join",
    "list_distinct",
    "motions",
    "pack",
    "read_column",
    "read_numbers",
    "replace_at",
    "select_items",
    "splice",
    "switch_off_first",
]

# Instructions by column: a program may have half a million of them, and a loop over them in Python
# takes seconds.


class Columns:
    """The columns of a body of N instructions, M of them motions, A of these arcs.

    A body that is not packed is packed first; columns of kept instructions are computed when used.
    """

    def __init__(self, body: Sequence[Instruction]) -> None:
        self.body = body
        self._packed = pack(body)

    def stretch(self, low: int, high: int) -> Columns:
        """The columns of the instructions from `low` to before `high`."""
        return Columns(self._packed.stretch(low, high))

    def are(self, *kinds: type) -> Mask:
        """(N,) whether an instruction is of one of the types `kinds`."""
        return _any_of(self._packed.packed.kind, kinds)

    def list_kinds(self, *kinds: type) -> list[Any]:
        """The instructions of the types `kinds`."""
        return self.pick(np.flatnonzero(self.are(*kinds)))

    def alike(self, kind: type, test: Callable[[Any], bool]) -> Mask:
        """(N,) whether an instruction is of the type `kind` and passes `test`.

        Each object is tested once.
        """
        distinct = self._packed.distinct(kind)
        passed = np.array(list(map(test, distinct.items)), np.bool_)
        mask = np.zeros(len(self.body), np.bool_)
        mask[distinct.at[passed[distinct.number]]] = True
        return mask

    @property
    def outputs(self) -> list[Any]:
        """The outputs, each object once, in order of its first place."""
        return self._packed.distinct(Output).items

    def pick(self, indices: Indices) -> list[Any]:
        """The instructions at sorted `indices`."""
        if isinstance(self.body, Body):
            return self.body.pick(indices)
        return list(map(self.body.__getitem__, indices.tolist()))

    @property
    def at(self) -> Indices:
        """(M,) indices of the motions in the body."""
        return self._packed.at

    @cached_property
    def moves(self) -> Moves:
        """The motions as objects, which are made when they are used."""
        return Moves(self)

    @cached_property
    def kinds(self) -> NDArray[np.int8]:
        """(M,) kinds of the motions by `body.NUMBER`: MoveJ, MoveL, MoveC."""
        return self._packed.packed.kind[self.at]

    def moves_are(self, *kinds: type) -> Mask:
        """(M,) whether a motion is of one of the types `kinds`."""
        return _any_of(self.kinds, kinds)

    def before(self, indices: Indices) -> Indices:
        """(K,) the last motion before each instruction at `indices` (K,), or -1."""
        return np.asarray(np.searchsorted(self.at, indices) - 1)

    def pose(self, motion: int) -> Pose | None:
        """Target pose of a motion; None for a joint target and for motion -1."""
        target = self.moves[motion].target if motion >= 0 else None
        return target if isinstance(target, Pose) else None

    def neighbours(self, indices: Indices) -> tuple[list[Motion | None], list[Motion | None]]:
        """The last motion before and the first after each instruction at sorted `indices` (K,).

        None without such a motion.
        """
        numbers = np.append(self.before(indices), np.searchsorted(self.at, indices, side="right"))
        different, places = np.unique(numbers, return_inverse=True)
        exists = (different >= 0) & (different < len(self.at))
        motions: list[Motion | None] = [None] * len(different)
        objects = self.pick(self.at[different[exists]])
        for place, motion in zip(np.flatnonzero(exists).tolist(), objects, strict=True):
            motions[place] = motion
        neighbours = take_rows(motions, places.tolist())
        return neighbours[: len(indices)], neighbours[len(indices) :]

    @cached_property
    def posed(self) -> Mask:
        """(M,) whether the target of a motion is a pose, not joint values."""
        return self.rotation >= 0

    @property
    def table(self) -> Sequence[FloatArray]:
        """Rotations (3, 3) of the tool, each object once: poses share them."""
        return self._packed.rotations

    @property
    def rotation(self) -> NDArray[np.int32]:
        """(M,) index into `table` of the rotation at the end of a motion, -1 for joint values."""
        return self._packed.packed.rotation

    @property
    def via_rotation(self) -> NDArray[np.int32]:
        """(A,) index into `table` of the rotation half-way along each arc."""
        return self._packed.packed.via_rotation

    def turned_as(self, rotation: FloatArray) -> Mask:
        """(M,) whether a motion ends with this rotation: the same object, as poses share them."""
        same = [place for place, item in enumerate(self.table) if item is rotation]
        return np.isin(self.rotation, same)

    def rotations(self, where: Mask) -> list[FloatArray]:
        """Rotations at the ends of the motions of the mask `where` (M,), which have poses there."""
        return list(map(self.table.__getitem__, self.rotation[where].tolist()))

    @property
    def ends(self) -> FloatArray:
        """(M, 3) ends of the motions, mm, NaN for joint values."""
        return self._packed.packed.end

    @property
    def vias(self) -> FloatArray:
        """(M, 3) via points of arcs, mm, NaN for other motions; a new array for each call."""
        vias = np.full(self.ends.shape, np.nan)
        vias[self.arcs] = self.via
        return vias

    @property
    def arcs(self) -> Indices:
        """(A,) numbers of the motions that are arcs."""
        return np.flatnonzero(self.moves_are(MoveC))

    @property
    def via(self) -> FloatArray:
        """(A, 3) via points of the arcs, mm."""
        return self._packed.packed.via

    def vias_of(self, motions: Indices) -> FloatArray:
        """(K, 3) via points of motions (K,) that are arcs, mm."""
        return self.via[np.searchsorted(self.arcs, motions)]

    @property
    def speed(self) -> FloatArray:
        """(M,) TCP speeds, mm/s."""
        return self._packed.packed.speed

    @cached_property
    def share(self) -> FloatArray:
        """(M,) fractions of the maximum joint speeds, 0 if unknown."""
        return self._read_attribute("share")[:, 0]

    @cached_property
    def rate(self) -> FloatArray:
        """(M,) speeds of the revolute joints with the longest travel, rad/s, 0 if unknown."""
        return self._read_attribute("rate")[:, 0]

    @property
    def blend(self) -> FloatArray:
        """(M,) blend radii, mm."""
        return self._packed.packed.blend

    @cached_property
    def force(self) -> FloatArray:
        """(M,) contact forces, N, 0 for joint motions."""
        return self._read_attribute("force")[:, 0]

    @cached_property
    def force_direction(self) -> FloatArray:
        """(M, 3) directions of the force as in `MoveL`, 0 for joint motions."""
        return self._read_attribute("force_direction", 3)

    @cached_property
    def turn(self) -> FloatArray:
        """(M,) speeds of reorientations and limits of joint motions, rad/s, as `turn` of a motion.

        0 without one.
        """
        return self._read_attribute("turn")[:, 0]

    def _read_attribute(self, name: str, width: int = 1) -> FloatArray:
        """(M, width) an attribute of the motions, 0 for motions that do not have it."""
        places, moves = self.special
        missing = (0.0,) * width if width > 1 else 0.0
        values = np.array([getattr(move, name, missing) for move in moves], np.float64)
        if not values.any():
            return np.broadcast_to(np.float64(0.0), (len(self.at), width))
        column = np.zeros((len(self.at), width))
        column[places] = values.reshape(-1, width)
        return column

    @cached_property
    def special(self) -> tuple[Indices, list[Any]]:
        """Numbers and objects of the motions that the packed columns do not describe in full.

        They have a joint target, joint values, a posture, a force, a share, a rate or a turn.
        """
        kept = self._packed.packed.kept[self.at]
        return np.flatnonzero(kept), self.pick(self.at[kept])

    @cached_property
    def turned(self) -> Mask:
        """(M,) whether a linear motion is a reorientation: it rotates the tool at a fixed TCP."""
        mask = self.moves_are(MoveL)
        mask[1:] &= self.posed[:-1]
        mask[:1] = False
        rotation, table = self.rotation, self.table
        mask[1:] &= rotation[1:] != rotation[:-1]
        rows = np.flatnonzero(mask)
        travel = np.abs(self.ends[rows] - self.ends[rows - 1]).max(axis=1, initial=0.0)
        mask[rows] = travel < SAME_POINT_MM
        rows = np.flatnonzero(mask)
        both = zip(rotation[rows - 1].tolist(), rotation[rows].tolist(), strict=True)
        mask[rows] = [not np.array_equal(table[a], table[b]) for a, b in both]
        return mask

    @property
    def path(self) -> Indices:
        """(M,) index in `Program.paths` of the path to which a motion belongs, -1 for none."""
        return self._packed.packed.path

    @property
    def works(self) -> Mask:
        """(M,) whether a motion runs along its path."""
        return self._packed.packed.work

    @cached_property
    def arrives(self) -> Mask:
        """(M,) whether a motion links a path with the approach of the next one, or with home."""
        return np.append(False, self.path[1:] != self.path[:-1]) & ~self.works

    def find_rotations(self, is_valid: Callable[[FloatArray], bool]) -> Iterator[int]:
        """Yield the first instruction whose rotation at the end does not pass `is_valid`.

        Then the first one whose rotation half-way does not.
        """
        wrong = [place for place, item in enumerate(self.table) if not is_valid(item)]
        for at, places in ((self.at, self.rotation), (self._packed.arcs, self.via_rotation)):
            yield from at[np.isin(places, wrong)][:1].tolist()


class Moves(Sequence[Any]):
    """The motions of a body as a sequence of objects."""

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
    """The body with the instructions at some indices replaced by others.

    changed: the new instructions by index, any number for each. A packed body stays packed.
    """
    if isinstance(body, Body):
        places = sorted(changed)
        new = pack(chain.from_iterable(changed[place] for place in places))
        return replace_at(body, places, [len(changed[place]) for place in places], new)
    pieces: list[Instruction] = []
    done = 0
    for index in sorted(changed):
        pieces += body[done:index]
        pieces += changed[index]
        done = index + 1
    pieces += body[done:]
    return tuple(pieces)


def replace_at(
    body: Body, places: Sequence[int] | Indices, sizes: Sequence[int] | Indices, new: Body
) -> Body:
    """The body with the instructions at sorted `places` replaced by those of `new`.

    sizes: number of instructions of `new` for each place.
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


def select_items(items: Sequence[Any], keep: Mask) -> list[Any]:
    """The items whose value in the mask `keep` is true."""
    count = int(np.count_nonzero(keep))
    if count == len(items):
        return list(items)
    if 4 * count < len(items):
        return list(map(items.__getitem__, np.flatnonzero(keep).tolist()))
    return list(compress(items, keep.tolist()))


def read_numbers(items: Sequence[Any], name: str, width: int = 1) -> FloatArray:
    """(N, width) an attribute of the items: a number, or a tuple of `width` numbers."""
    values = map(attrgetter(name), items)
    flat = chain.from_iterable(values) if width > 1 else values
    return np.fromiter(flat, np.float64, len(items) * width).reshape(-1, width)


def read_column(items: Sequence[Any], name: str) -> FloatArray:
    """(N,) an attribute of the items that is a number."""
    return read_numbers(items, name)[:, 0]


def list_distinct(items: Sequence[Any], name: str) -> list[Any]:
    """The different objects among an attribute of the items, which mostly share them."""
    values = list(map(attrgetter(name), items))
    return list(dict(zip(map(id, values), values, strict=True)).values())


# The rules that every program keeps, checked by column: a body may have a hundred thousand motions.

#: Name of the checker in the message about a body that breaks a rule.
RULES = "program"
_BLENDS = "a motion before an output, a wait or a force change must not blend"


def check(columns: Columns, paths: int = 0) -> None:
    """Raises Refused for the first instruction of a body that breaks a rule of `Program`.

    paths: number of paths of the program.
    """
    at, speed, blend = columns.at, columns.speed, columns.blend
    share, rate, path, turn = columns.share, columns.rate, columns.path, columns.turn
    wrong_waits = np.flatnonzero(columns.alike(Wait, lambda wait: wait.seconds < 0))
    not_joint = ~columns.moves_are(MoveJ)[:1]
    broken = [
        *_first(at[:1][not_joint], "the first motion must be joint-interpolated"),
        *_find_not_finite(columns),
        *_first(
            at[~(speed > 0) | (blend < 0)], "a speed must be positive and a blend not negative"
        ),
        *_first(
            at[~((share >= 0) & (share <= 1))], "a share of the joints' speeds must be from 0 to 1"
        ),
        *_first(at[~((rate >= 0) & np.isfinite(rate))], "a speed of a joint must not be negative"),
        *_first(
            at[(path < -1) | (path >= paths)], "a motion belongs to a path that does not exist"
        ),
        *_first(
            at[columns.turned & ~(turn > 0)],
            "a motion that only turns the tool has no speed of turning",
        ),
        *_first(at[~(turn >= 0)], "a speed of turning must not be negative"),
        *_first(wrong_waits, "a wait must not be negative"),
        *_find_blending(columns),
        *_find_pressing(columns),
        *_find_left_on(columns),
        *_find_changing(columns),
    ]
    if broken:
        index, what = min(broken, key=lambda fault: fault[0])
        raise Refused(RULES, index, what)


def check_frame(frame: Pose) -> None:
    """Raises Refused for a frame with a number that is not finite."""
    if not (np.isfinite(frame.rotation).all() and all(map(math.isfinite, frame.origin))):
        raise Refused(RULES, -1, "a number is not finite")


def _first(indices: Indices, what: str) -> Iterator[tuple[int, str]]:
    """Yield the first of `indices` with the message, if there is one."""
    for index in indices[:1].tolist():
        yield index, what


def _find_not_finite(columns: Columns) -> Iterator[tuple[int, str]]:
    """Yield instructions with a number that is not finite, at least the first of all."""
    message = "a number is not finite"
    for values in (
        columns.speed,
        columns.blend,
        columns.force,
        columns.force_direction,
        columns.turn,
    ):
        yield from _first(columns.at[~_are_finite(values)], message)
    yield from _first(columns.at[columns.posed & ~_are_finite(columns.ends)], message)
    yield from _first(columns.at[columns.arcs[~_are_finite(columns.via)]], message)
    for index in columns.find_rotations(_is_finite):
        yield index, message
    for place, move in zip(*columns.special, strict=True):
        for joints in (move.joints, move.target):
            if isinstance(joints, Joints) and not _is_finite(joints.values):
                yield int(columns.at[place]), message
    for kind, name, width in (
        (Output, "value", 1),
        (Wait, "seconds", 1),
        (Force, "newtons", 1),
        (Force, "force_direction", 3),
    ):
        values = read_numbers(columns.list_kinds(kind), name, width)
        yield from _first(np.flatnonzero(columns.are(kind))[~_are_finite(values)], message)


def _are_finite(values: FloatArray) -> Mask:
    """(N,) whether all numbers of a row of `values` (N, ...) are finite."""
    finite = np.isfinite(values)
    if finite.all():
        return np.ones(len(values), np.bool_)
    return np.asarray(finite.all(axis=1)) if finite.ndim == 2 else finite


def _is_finite(value: float | Sequence[float] | FloatArray) -> bool:
    if isinstance(value, float):
        return math.isfinite(value)
    if isinstance(value, tuple):
        return all(map(math.isfinite, value))
    return bool(np.isfinite(value).all())


def _find_blending(columns: Columns) -> Iterator[tuple[int, str]]:
    """Yield motions that blend although the next instruction is not a motion."""
    is_motion = columns.are(MoveJ, MoveL, MoveC)[~columns.are(Comment)]
    is_followed = np.append(is_motion[1:], False)[is_motion]
    is_last = (np.arange(len(is_motion)) == len(is_motion) - 1)[is_motion]
    wrong = (columns.blend > 0) & ~is_followed
    yield from _first(columns.at[wrong & ~is_last], _BLENDS)
    yield from _first(columns.at[wrong & is_last], "the last motion must not blend")


def _find_pressing(columns: Columns) -> Iterator[tuple[int, str]]:
    """Yield the first motion that presses while force control is off."""
    if not (columns.force > 0).any():
        return
    switches: list[Any] = columns.list_kinds(Force)
    newtons = np.append(0.0, read_column(switches, "newtons"))
    on = newtons[np.searchsorted(np.flatnonzero(columns.are(Force)), columns.at)] > 0
    wrong = columns.at[(columns.force > 0) & ~on]
    yield from _first(wrong, "a motion presses while force control is off")


def _find_left_on(columns: Columns) -> Iterator[tuple[int, str]]:
    """Yield outputs, and force control, that may be on at the first motion or at the end.

    A program that was aborted is started again from its first line, with outputs still on.
    """
    at = np.flatnonzero(columns.are(Output, Force))
    switches = columns.list_kinds(Output, Force)
    first = int(columns.at[0]) if len(columns.at) else len(columns.body)
    before = _last_values(switches[: int(np.searchsorted(at, first))])
    after = _last_values(switches)
    if len(columns.at):
        for name in after:
            if before.get(name, 1.0) != 0:
                yield first, f"{name} is not switched off before the first motion"
    for name, value in after.items():
        if value != 0:
            yield len(columns.body) - 1, f"{name} must be off at the end"


def _last_values(switches: Sequence[Instruction]) -> dict[str, float]:
    """The last value of each output and of the force, by their names in messages.

    Each object is read once: it may be in a body many times.
    """
    keys = list(map(id, switches))
    last = dict(zip(keys, range(len(keys)), strict=True))
    values: dict[str, tuple[int, float]] = {}
    for key, item in dict(zip(keys, switches, strict=True)).items():
        name, value = _name_switch(item)
        values[name] = max(values.get(name, (-1, 0.0)), (last[key], value))
    return {name: value for name, (_, value) in values.items()}


def _find_changing(columns: Columns) -> Iterator[tuple[int, str]]:
    """Yield tool changes with an output or force control on, and wrong motions after one.

    The first motion after a tool change must be joint-interpolated.
    """
    values: dict[str, float] = {}
    changes = np.flatnonzero(columns.are(ToolChange)).tolist()
    for index in changes:
        _, (next_motion,) = columns.neighbours(np.array([index]))
        if index + 1 < len(columns.body) and not isinstance(next_motion, MoveJ):
            yield index, "the first motion after a tool change must be joint-interpolated"
    if not changes:
        return
    for index in np.flatnonzero(columns.are(Output, Force, ToolChange)).tolist():
        item = columns.body[index]
        if not isinstance(item, ToolChange):
            name, value = _name_switch(item)
            values[name] = value
        elif any(values.values()):
            yield index, f"{min(filter(values.get, values))} is on at a tool change"


def _name_switch(item: Instruction) -> tuple[str, float]:
    """Name and value of an output or force change, the name as in messages."""
    if isinstance(item, Output):
        return f"output {item.signal}", item.value
    assert isinstance(item, Force)
    return "force control", item.newtons


def switch_off_first(body: Sequence[Instruction]) -> Sequence[Instruction]:
    """The body with instructions before it that switch off its outputs and its force control.

    An output that the body itself switches off before its first motion is not repeated. So nothing
    moves with the tool on if the program is started again after an abort.
    """
    columns = Columns(body)
    first = int(columns.at[0]) if len(columns.at) else len(body)
    # Values at the first motion.
    before = {item.signal: item.value for item in body[:first] if isinstance(item, Output)}
    names = {item.signal: None for item in columns.outputs if before.get(item.signal, 1.0) != 0}
    force = [Force(0.0)] if columns.are(Force).any() else []
    switch_off: list[Instruction] = [*(Output(name, 0.0) for name in names), *force]
    if isinstance(body, Body):
        return join(pack(switch_off), body)
    return (*switch_off, *body)


# The program between planning and posts: a few kinds of instructions, checked once.


class Program(Struct, frozen=True, eq=False, dict=True):
    """A whole program in one work frame.

    name: name of the program.
    base_from_work, flange_from_tool: frames in which the poses are given.
    body: the instructions.
    header: comments at its top, in order.
    paths: the paths to which motions belong, see `path_of`.

    Construction raises Refused unless these rules hold:

    - The first motion is joint-interpolated, and so is the first one after a tool change.
    - Every number is finite, every speed is positive, no blend, wait or share is negative.
    - Every path of a motion exists.
    - Only a motion that is followed by another one, comments aside, blends.
    - A motion presses only while force control is on.
    - Every output and the force control that it uses are switched off before the first motion, at
      a tool change and at the end.
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
        """The path to which the motion at `index`, or the last one before it, belongs; or None."""
        motion = int(np.searchsorted(self.columns.at, index, side="right")) - 1
        path = int(self.columns.path[motion]) if motion >= 0 else -1
        return self.paths[path] if path >= 0 else None

    def path_at(self, index: int) -> int:
        """Index of the last path up to the instruction at `index` of the body, -1 for none.

        A motion on no path, such as the motion home, counts for the path before it.
        """
        before = self.columns.path[: int(np.searchsorted(self.columns.at, index, side="right"))]
        return int(before[before >= 0][-1]) if (before >= 0).any() else -1

    def place_of(self, index: int) -> str:
        """Position in the program of the instruction at `index`, in words, for messages."""
        origin = self.path_of(index)
        if origin is not None:
            return f"{'edge' if origin.operation == 'edges' else 'path'} {origin.id}"
        return "the link home" if self.path_at(index) >= 0 else "the link to the first path"

    def with_body(self, body: Sequence[Instruction]) -> Program:
        """A copy with another body."""
        return replace(self, body=body)

    def with_blends(self, blends: Mapping[int, float]) -> Program:
        """A copy with other blends, mm, by the number of the motion."""
        columns = self.columns
        changed: dict[int, Sequence[Instruction]] = {}
        for motion, blend in blends.items():
            changed[int(columns.at[motion])] = [replace(columns.moves[motion], blend=blend)]
        return self.with_body(splice(self.body, changed))

    def __repr__(self) -> str:
        moves = counted(len(self.columns.moves), "motion")
        return f"Program({self.name!r}, {counted(len(self.body), 'instruction')}, {moves})"


def motions(body: Sequence[Instruction]) -> Iterator[tuple[int, Motion]]:
    """Yield the motions of a body, each with its index in the body."""
    for index, item in enumerate(body):
        if isinstance(item, (MoveL, MoveC, MoveJ)):
            yield index, item
