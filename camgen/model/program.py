"""The instructions of a program, frozen values that a body of a hundred thousand can hold.

A signal is a name, an arc is two poses: how a controller spells them is its post's. A posture is a joint solution; what
controllers call it follows from the geometry of the arm (``robots.posture``), which posts do not know.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import cached_property
from itertools import chain, compress
from operator import attrgetter
from typing import Any

import numpy as np
from msgspec import Struct
from msgspec.structs import replace
from numpy.typing import NDArray

from camgen.model.errors import Refused
from camgen.model.pose import FloatArray, Pose
from camgen.model.text import counted
from camgen.model.tolerance import SAME_POINT_MM


class Joints(Struct, frozen=True, gc=False):
    """Controller joint values: rad for revolute, mm for sliding joints, axis 1 first."""

    values: tuple[float, ...]


class Posture(Struct, frozen=True, gc=False, omit_defaults=True):
    """What controllers call the posture in which the arm stands at the target; what is not known for sure is left out.

    confdata: ABB's cf1, cf4, cf6, cfx. figure: DENSO's Fig. switches: the words of V+, for all motions of a program or
    for none, since they stay in force.
    """

    confdata: tuple[int, int, int, int] | None = None
    figure: int | None = None
    switches: tuple[str, ...] = ()


class Origin(Struct, frozen=True):
    """What a motion is there for: the path ``id``, which works on ``contours`` (ids of contours, or of one edge) of
    ``layer`` by ``operation``.
    """

    id: str
    layer: str = ""
    contours: tuple[str, ...] = ()
    operation: str = ""


class MoveJ(Struct, frozen=True, eq=False, gc=False):
    """Joint-interpolated motion to joints or to a pose of the TCP in the work frame. speed: TCP limit, mm/s. joints and
    posture: of the arm at a target that is a pose, where a robot is known. path: see ``MoveL``. share: of the greatest
    speeds of the joints, at which the TCP keeps to ``speed``; 0: not known.
    """

    target: Pose | Joints
    speed: float
    blend: float = 0.0
    joints: Joints | None = None
    posture: Posture | None = None
    path: int = -1
    work: bool = False
    share: float = 0.0


class MoveL(Struct, frozen=True, eq=False, gc=False):
    """Straight line of the TCP. target: work_from_tcp. blend: radius in mm within which the corner may be rounded, 0 =
    exact stop. force: N to press with during this motion, while a ``Force`` is on. force_direction: its direction at
    the target, unit vector in the work frame from the tool towards the surface. path: place in ``Program.paths`` of the
    one that this motion belongs to, the ways there and up from it included, -1: none. work: it runs along that path.
    turn: rad/s at which the tool turns where the TCP stays in its place, which ``speed`` does not limit; 0: the TCP
    travels.
    """

    target: Pose
    speed: float
    blend: float = 0.0
    force: float = 0.0
    force_direction: tuple[float, float, float] = (0.0, 0.0, 0.0)
    joints: Joints | None = None
    posture: Posture | None = None
    path: int = -1
    work: bool = False
    turn: float = 0.0


class MoveC(Struct, frozen=True, eq=False, gc=False):
    """Arc of the TCP from where it is through ``via`` (half-way) to ``target``, at most half a circle."""

    via: Pose
    target: Pose
    speed: float
    blend: float = 0.0
    force: float = 0.0
    force_direction: tuple[float, float, float] = (0.0, 0.0, 0.0)
    joints: Joints | None = None
    posture: Posture | None = None
    path: int = -1
    work: bool = False


class Output(Struct, frozen=True, gc=False):
    """Sets a named signal. value: 0 off, 1 on; for ``spindle`` its speed in rpm."""

    signal: str
    value: float


class Wait(Struct, frozen=True, gc=False):
    """Stands still for so many seconds."""

    seconds: float


class Force(Struct, frozen=True, gc=False):
    """Force control on, pressing with ``newtons`` along ``force_direction`` (unit, work frame) from the next motion on;
    0 N: off, and the next motion leaves the surface.
    """

    newtons: float
    force_direction: tuple[float, float, float] = (0.0, 0.0, 0.0)


class ToolChange(Struct, frozen=True):
    """Another tool from here on, with all outputs off and the machine at home. number: in the machine's tool table.
    diameter, length: mm. flange_from_tool: its frame; None: the program's.
    """

    number: int
    name: str = ""
    diameter: float = 0.0
    length: float = 0.0
    flange_from_tool: Pose | None = None


class Comment(Struct, frozen=True, gc=False):
    """A remark for whoever reads the program; posts clean it."""

    text: str


Motion = MoveJ | MoveL | MoveC
Instruction = MoveJ | MoveL | MoveC | Output | Wait | Force | ToolChange | Comment


# Instructions by column: a program may hold half a million of them, and a loop over them in Python takes seconds.

Mask = NDArray[np.bool_]
Indices = NDArray[np.intp]

_NUMBER: dict[type, int] = {MoveJ: 0, MoveL: 1, MoveC: 2, Output: 3, Wait: 4, Force: 5, Comment: 6, ToolChange: 7}


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
        return take(self.body, self.are(*kinds))

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
        found = map(id, map(attrgetter("target.rotation"), take(self.moves, mask)))
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
    def share(self) -> FloatArray:
        """(M,): of the joints' greatest speeds, 0 where it is not known."""
        share = np.zeros(len(self.moves))
        swing = self.moves_are(MoveJ)
        share[swing] = column(take(self.moves, swing), "share")
        return share

    @cached_property
    def blend(self) -> FloatArray:
        """(M,): mm."""
        return column(self.moves, "blend")

    @cached_property
    def force(self) -> FloatArray:
        """(M,): N, 0 for motions of the joints."""
        pressing = ~self.moves_are(MoveJ)
        force = np.zeros(len(self.moves))
        force[pressing] = column(take(self.moves, pressing), "force")
        return force

    @cached_property
    def turn(self) -> FloatArray:
        """(M,): rad/s at which the tool turns on the spot, 0 for motions that travel."""
        straight = self.moves_are(MoveL)
        turn = np.zeros(len(self.moves))
        turn[straight] = column(take(self.moves, straight), "turn")
        return turn

    @cached_property
    def turned(self) -> Mask:
        """(M,): which straight motions turn the tool where its TCP stays in its place."""
        mask = self.moves_are(MoveL)
        mask[1:] &= self.posed[:-1]
        mask[:1] = False
        rows = np.flatnonzero(mask)
        mask[rows] = np.abs(self.ends[rows] - self.ends[rows - 1]).max(axis=1, initial=0.0) < SAME_POINT_MM
        rows = np.flatnonzero(mask)
        rotations = [(self.moves[k - 1].target.rotation, self.moves[k].target.rotation) for k in rows.tolist()]
        mask[rows] = [a is not b and not np.array_equal(a, b) for a, b in rotations]
        return mask

    @cached_property
    def path(self) -> Indices:
        """(M,): the place in ``Program.paths`` of the path that each motion belongs to, -1: none."""
        return np.fromiter(map(attrgetter("path"), self.moves), np.intp, len(self.moves))

    @cached_property
    def works(self) -> Mask:
        """(M,): which motions run along their path."""
        return np.fromiter(map(attrgetter("work"), self.moves), np.bool_, len(self.moves))

    @cached_property
    def arrives(self) -> Mask:
        """(M,): which motions lead from a path to above the start of another one, or home from the last."""
        return np.append(False, self.path[1:] != self.path[:-1]) & ~self.works

    def _spread(self, where: Mask, name: str) -> FloatArray:
        places = np.full((len(where), 3), np.nan)
        places[where] = numbers(take(self.moves, where), name, 3)
        return places


def splice(body: Sequence[Instruction], changed: Mapping[int, Sequence[Instruction]]) -> tuple[Instruction, ...]:
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

_BLENDS = "a motion before an output, a wait or a force change must not blend"


def check(columns: Columns, paths: int = 0) -> None:
    """Raises Refused for the first instruction of a body that breaks a rule of ``Program`` with so many ``paths``."""
    at, speed, blend = columns.at, columns.speed, columns.blend
    waits = np.flatnonzero(columns.are(Wait))
    broken = [
        *_first(at[:1][~columns.moves_are(MoveJ)[:1]], "the first motion must be joint-interpolated"),
        *_not_finite(columns),
        *_first(at[~(speed > 0) | (blend < 0)], "a speed must be positive and a blend not negative"),
        *_first(
            at[~((columns.share >= 0) & (columns.share <= 1))], "a share of the joints' speeds must be from 0 to 1"
        ),
        *_first(at[(columns.path < -1) | (columns.path >= paths)], "a motion belongs to a path that there is none of"),
        *_first(at[columns.turned & ~(columns.turn > 0)], "a motion that only turns the tool has no speed of turning"),
        *_first(at[~(columns.turn >= 0)], "a speed of turning must not be negative"),
        *_first(waits[column(columns.of(Wait), "seconds") < 0], "a wait must not be negative"),
        *_blending(columns),
        *_pressing(columns),
        *_left_on(columns),
        *_changing(columns),
    ]
    if broken:
        index, what = min(broken, key=lambda one: one[0])
        raise Refused("program", index, what)


def check_frame(frame: Pose) -> None:
    """Raises Refused for a frame with a number that is not finite."""
    if not (np.isfinite(frame.rotation).all() and all(map(math.isfinite, frame.origin))):
        raise Refused("program", -1, "a number is not finite")


def _first(indices: Indices, what: str) -> Iterator[tuple[int, str]]:
    for index in indices[:1].tolist():
        yield index, what


def _not_finite(columns: Columns) -> Iterator[tuple[int, str]]:
    """Instructions with a number that is not finite, the first of each kind."""
    moves, posed, arcs = columns.moves, columns.posed, columns.moves_are(MoveC)
    for where, values in (
        (None, columns.speed),
        (None, columns.blend),
        (None, columns.force),
        (None, columns.turn),
        (posed, columns.ends),
        (arcs, columns.vias),
    ):
        finite = np.isfinite(values)
        good: Mask = np.asarray(finite.all(axis=1)) if finite.ndim == 2 else finite
        yield from _first(columns.at[~good if where is None else ~good & where], "a number is not finite")
    straight, jointed = take(moves, posed), take(moves, ~posed)
    known = [move for move in moves if move.joints is not None] if any(map(attrgetter("joints"), moves)) else []
    for items, name in (
        (straight, "target.rotation"),
        (take(moves, arcs), "via.rotation"),
        (take(moves, ~columns.moves_are(MoveJ)), "force_direction"),
        (jointed, "target.values"),
        (known, "joints.values"),
        (columns.of(Output), "value"),
        (columns.of(Wait), "seconds"),
        (columns.of(Force), "newtons"),
        (columns.of(Force), "force_direction"),
    ):
        if not all(map(_sound, distinct(items, name))):
            bad = next(item for item in items if not _sound(attrgetter(name)(item)))
            yield next(k for k, item in enumerate(columns.body) if item is bad), "a number is not finite"


def _sound(value: float | Sequence[float] | FloatArray) -> bool:
    if isinstance(value, float):
        return math.isfinite(value)
    if isinstance(value, tuple):
        return all(map(math.isfinite, value))
    return bool(np.isfinite(value).all())


def _blending(columns: Columns) -> Iterator[tuple[int, str]]:
    """Motions that blend although no motion follows."""
    at, blends = columns.at, columns.blend > 0
    spoken = np.flatnonzero(~columns.are(Comment))
    size = len(columns.body)
    moving = np.zeros(size + 1, np.bool_)
    moving[at] = True
    following = np.append(spoken[1:], size)[np.searchsorted(spoken, at)]
    last = following == size
    yield from _first(at[blends & ~moving[following] & ~last], _BLENDS)
    yield from _first(at[blends & last], "the last motion must not blend")


def _pressing(columns: Columns) -> Iterator[tuple[int, str]]:
    """Motions that press while force control is off."""
    switches: list[Any] = columns.of(Force)
    newtons = np.append(0.0, column(switches, "newtons"))
    on = newtons[np.searchsorted(np.flatnonzero(columns.are(Force)), columns.at)] > 0
    yield from _first(columns.at[(columns.force > 0) & ~on], "a motion presses while force control is off")


def _left_on(columns: Columns) -> Iterator[tuple[int, str]]:
    """Outputs, and force control, of which a program does not know at its first motion or at its end that they are off:
    one that was aborted is run again from its first line.
    """
    at = np.flatnonzero(columns.are(Output, Force))
    switched = [
        (item.signal, item.value) if type(item) is Output else (None, item.newtons)
        for item in columns.of(Output, Force)
    ]
    first = int(columns.at[0]) if len(columns.at) else len(columns.body)
    before, after = dict(switched[: int(np.searchsorted(at, first))]), dict(switched)
    names = {signal: "force control" if signal is None else f"output {signal}" for signal in after}
    if len(columns.at):
        for signal, name in names.items():
            if before.get(signal, 1.0) != 0:
                yield first, f"{name} is not switched off before the first motion"
    for signal, name in names.items():
        if after[signal] != 0:
            yield len(columns.body) - 1, f"{name} must be off at the end"


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


def put_off_first(body: Sequence[Instruction]) -> tuple[Instruction, ...]:
    """The body after instructions that switch off every output and the force control that it uses: where it is run
    again after an abort, nothing moves with the tool on.
    """
    columns = Columns(body)
    names = dict.fromkeys(item.signal for item in columns.of(Output))
    force = [Force(0.0)] if columns.are(Force).any() else []
    return (*(Output(name, 0.0) for name in names), *force, *body)


# The typed program between planning and posts: few instructions, checked once, with a text form (``ir_text``).


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
    body: tuple[Instruction, ...]
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

    def with_body(self, body: tuple[Instruction, ...]) -> Program:
        """The same program with another body."""
        return replace(self, body=body)

    def __repr__(self) -> str:
        moves = counted(len(self.columns.moves), "motion")
        return f"Program({self.name!r}, {counted(len(self.body), 'instruction')}, {moves})"


def motions(body: tuple[Instruction, ...]) -> Iterator[tuple[int, Motion]]:
    """The motions of a body with their index in it."""
    for index, item in enumerate(body):
        if isinstance(item, (MoveL, MoveC, MoveJ)):
            yield index, item
