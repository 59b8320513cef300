"""Does the text say what was planned? ``compare`` holds a read-back against the program that was posted.

What is compared, and how exactly:

* Kinds of instructions, one to one and in order, comments left out. The names of outputs; their values to 0.001.
* Positions: each coordinate within ``tolerance.mm``, half the last printed digit.
* Arcs as geometry: the point half-way along the arc that was read, wherever its ``via`` lies on it, against the one
  half-way along the planned arc, within ``ARC_SLACK * tolerance.mm``. Why 6: let d be half the last digit. A text with
  ``via`` rounds three points by up to sqrt(3) d = 1.73 d each. An error of ``via`` across the arc moves the middle by
  as much; errors of the ends shift it along the arc by their mean, and turn it about ``via`` by as much again at most,
  since up to half a circle an arc is no higher than half its chord: sqrt(1.73^2 + 3.46^2) d = 3.9 d. A text with a
  centre, in a plane, rounds ends and centre by up to sqrt(2) d = 1.41 d each; the ends move the middle by 1.41 d
  across and along the arc, the centre by sqrt(2) times its own error at half a circle: 4.9 d together. Where a radius
  is only a few d, the second order adds up to 1 d. Rounding 200,000 arcs at random gives 2.2 d and 3.1 d.
* Orientations within ``tolerance.angle``, from the skew part of the difference: the trace alone cannot tell 1e-8 rad
  from 0. That at ``via`` only where the post carries it: controllers interpolate from the start to the end, and use it
  at most to tell in which sense.
* Postures: ABB's confdata, DENSO's figure or the switches of V+ are equal, or neutral where the plan has none.
* The share of the joints' greatest speeds, or the speed of the joint with the longest travel, instead of the speed of a
  joint motion, if it is known and the text states it.
* Joints, speeds, blends, waits, forces within their tolerances, as far as ``verified_fields`` of
  the post holds their word of ``COMPARED``.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from itertools import chain, pairwise
from operator import eq, ne
from typing import Any

import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from camgen.geometry.arcs import find_arc_middles
from camgen.geometry.rotations import angles_between
from camgen.geometry.vectors import lengths
from camgen.lang.programs import Executed, Frames
from camgen.model.errors import VerifyError
from camgen.model.pose import FloatArray, Pose, quaternion
from camgen.model.program import (
    Columns,
    Comment,
    Force,
    Indices,
    Instruction,
    Joints,
    Mask,
    MoveC,
    MoveJ,
    MoveL,
    Output,
    Program,
    Stop,
    ToolChange,
    Wait,
    read_numbers,
)
from camgen.model.text import counted, short
from camgen.post import Post, Tolerance
from camgen.post.preparation import CHANGES

#: What the point half-way along an arc may move per ``tolerance.mm``: see above.
ARC_SLACK = 6.0
#: What is left to the rounding of binary numbers, in every unit; and the tolerance of an output's value.
_SLACK, _VALUE = 1e-9, 1e-3
#: What texts say of a posture that is not known for sure.
_NEUTRAL: dict[str, object] = {"confdata": (0, 0, 0, 0), "figure": -1, "switches": ()}
#: So many instructions are compared together, or some more.
_SOME = 32768
_END, _MIDDLE, _TURN = "target", "middle of the arc", "orientation"
_PLACES = (_END, _MIDDLE)
_REMEDY = "do not run the program: its post or its read-back is wrong"


class Deviation(Struct, frozen=True):
    """How far the text is from the plan.

    max_mm: greatest distance of a target or of the middle of an arc. max_angle: greatest angle of an orientation, rad,
    0 where the text carries none. instructions: how many were compared.
    """

    max_mm: float
    max_angle: float
    instructions: int


class _Column(Struct, frozen=True, eq=False):
    """One property of M instructions, by row: their places among those compared, both values, the error (M,) and its
    limit, one or (M,), in the property's unit. An error that is not a number is beyond every limit.
    """

    what: str
    places: Indices
    planned: Any
    read: Any
    error: FloatArray
    limit: float | FloatArray


class _Both(Struct, frozen=True, eq=False):
    """The bodies, planned and read, as far as they can be held against each other by number: their first ``common``
    instructions, comments left out, M of them motions. indices, read_indices: where both stand in their bodies. first:
    of a stretch, the place of its first instruction in the whole.
    """

    plan: Columns
    read: Columns
    indices: Indices
    read_indices: Indices
    common: int
    moves: int
    first: int = 0

    def stretches(self) -> Iterator[_Both]:
        """The same bit by bit, cut before motions that are compared without those before them: no arcs, and none that
        turns the tool on the spot.
        """
        some = slice(0, self.moves)
        alone = ~(self.plan.moves_are(MoveC) | self.plan.turned)[some] & ~self.read.turned[some]
        places = self.places(MoveJ, MoveL, MoveC)[alone]
        bounds = [0]
        while (cut := int(np.searchsorted(places, bounds[-1] + _SOME))) < len(places):
            bounds.append(int(places[cut]))
        for low, high in pairwise([*bounds, self.common]):
            (plan, indices), (read, read_indices) = (
                _stretch(*side, low, high)
                for side in ((self.plan, self.indices), (self.read, self.read_indices))
            )
            yield _Both(plan, read, indices, read_indices, high - low, len(plan.at), low)

    def places(self, *kinds: type) -> Indices:
        """The places, among what is compared, of the instructions of the types ``kinds``."""
        return np.flatnonzero(self.plan.are(*kinds)[self.indices[: self.common]])

    def moving(self, what: str, name: str, where: Mask, limit: float) -> _Column:
        """A column of the motions ``where`` (M,): the error is that of the worst number."""
        a, b = (getattr(side, name)[: self.moves][where] for side in (self.plan, self.read))
        places = self.places(MoveJ, MoveL, MoveC)[where]
        return _Column(what, places, a, b, _worst(a - b), limit)

    def each(self, where: Mask) -> Iterator[tuple[Columns, Mask]]:
        """Both sides, with ``where`` (moves,) as long as the motions of each."""
        for side in (self.plan, self.read):
            chosen = np.zeros(len(side.at), np.bool_)
            chosen[: self.moves] = where
            yield side, chosen

    def others(self, kind: type, what: str, name: str, limit: float, width: int = 1) -> _Column:
        """An attribute of the instructions of one type, a number or a tuple of ``width``."""
        places = self.places(kind)
        a, b = (
            read_numbers(side.of(kind)[: len(places)], name, width)
            for side in (self.plan, self.read)
        )
        return _Column(what, places, a, b, _worst(a - b), limit)


def _stretch(side: Columns, indices: Indices, low: int, high: int) -> tuple[Columns, Indices]:
    """The instructions at ``indices[low:high]`` with what is between them, and their places there."""
    if low == high:
        return side.stretch(0, 0), indices[:0]
    begin, end = int(indices[low]), int(indices[high - 1]) + 1
    return side.stretch(begin, end), indices[low:high] - begin


def _worst(error: FloatArray) -> FloatArray:
    """(N,): the largest number of each row, whatever its sign; ``error`` is used up."""
    size = np.abs(error, out=error)
    return np.asarray(size.max(axis=1) if size.ndim == 2 else size)


def compare(
    planned: Program, executed: Executed, tolerance: Tolerance, carries: frozenset[str], file: str
) -> Deviation:
    """The deviation of a program text from the program as prepared for the post.

    executed: the strict run of the text.
    carries: words of ``COMPARED`` (``Post.list_verified``).
    file: name for messages.

    Raises VerifyError for the first finding of the run, or for the first instruction that
    differs, with its index in the planned body, its line, and both values.
    """
    for finding in executed.findings[:1]:
        raise VerifyError(file, finding.what, finding.line, _REMEDY)
    for frames in executed.frames or (Frames(),):
        _compare_frames(planned, frames, tolerance, carries, file)
    both = _pair(planned, executed)
    differences: list[tuple[int, str, str, str]] = []
    distance = angle = 0.0
    # What comes in between of all of a long program is larger than the program.
    for stretch in both.stretches():
        for column in _columns(stretch, tolerance, carries):
            differences += _first_beyond(column, stretch.first)
            if column.what in _PLACES:
                distance = max(distance, _farthest(column.planned, column.read))
            elif column.what == _TURN:
                angle = max(angle, float(column.error.max(initial=0.0)))
    read_at = both.read_indices
    if both.common < max(len(both.indices), len(read_at)):
        was, says = (
            _say(planned.body, both.indices, both.common),
            _say(executed.body, read_at, both.common),
        )
        differences.append((both.common, "instruction", was, says))
    if differences:
        place, what, was, says = min(differences, key=lambda difference: difference[0])
        index = int(both.indices[place]) if place < len(both.indices) else len(planned.body)
        line = executed.lines[read_at[place]] if place < len(read_at) else 0
        raise VerifyError(
            file, f"instruction {index}: {what} reads {says}, planned is {was}", line, _REMEDY
        )
    return Deviation(distance, angle, len(both.indices))


def _farthest(a: FloatArray, b: FloatArray) -> float:
    """The greatest distance between points (N, 3) and those of the same rows."""
    apart = a - b
    apart *= apart
    return math.sqrt(apart.sum(axis=1).max(initial=0.0))


def _pair(planned: Program, executed: Executed) -> _Both:
    """Both bodies as far as their instructions are of the same kinds."""
    if len(executed.body) != len(executed.lines):
        raise ValueError(
            f"{counted(len(executed.body), 'instruction')} with {counted(len(executed.lines), 'line')}"
        )
    plan, read = planned.columns, Columns(executed.body)
    at, read_at = (np.flatnonzero(~side.are(Comment)) for side in (plan, read))
    size = min(len(at), len(read_at))
    same = np.ones(size, np.bool_)
    for kind in (MoveJ, MoveL, MoveC, Output, Wait, Force, ToolChange, Stop):
        same &= plan.are(kind)[at[:size]] == read.are(kind)[read_at[:size]]
    common = _first_false(same)
    for kind, said in ((Output, _signals), (MoveJ, _joints)):
        places = np.flatnonzero(plan.are(kind)[at[:common]])
        a, b = (said(side)[: len(places)] for side in (plan, read))
        alike = np.fromiter(map(eq, a, b), np.bool_, len(places))
        common = int(np.append(places, common)[_first_false(alike)])
    moves = int(plan.are(MoveJ, MoveL, MoveC)[at[:common]].sum())
    return _Both(plan, read, at, read_at, common, moves)


def _first_false(mask: Mask) -> int:
    return int(np.append(mask, False).argmin())


def _signals(side: Columns) -> list[str]:
    return [item.signal for item in side.of(Output)]


def _joints(side: Columns) -> list[int]:
    """By motion of the joints, the number of joints of one to joint values, -1 for one to a pose."""
    count = np.full(len(side.at), -1)
    for place in np.flatnonzero(~side.posed).tolist():
        count[place] = len(side.moves[place].target.values)
    found: list[int] = count[side.moves_are(MoveJ)].tolist()
    return found


# Messages.


def _say(body: Sequence[Instruction], at: Indices, place: int) -> str:
    """An instruction in a few words."""
    if place >= len(at):
        return "nothing"
    item = body[at[place]]
    match item:
        case MoveJ(target=Joints(values)):
            return f"MoveJ to {len(values)} joint values"
        case MoveJ(target=Pose() as target) | MoveL(target=target) | MoveC(target=target):
            return f"{type(item).__name__} to {_text(target.origin)}"
        case Output(signal, value):
            return f"output {signal} {short(value, 3)}"
        case Wait(seconds):
            return f"wait {short(seconds, 3)} s"
        case Force(newtons):
            return f"force {short(newtons, 3)} N"
        case ToolChange(number):
            return f"change to tool {number}"
        case Stop():
            return "a stop"
    return type(item).__name__


def _text(value: object) -> str:
    """A number, some numbers, some words, or a rotation as its quaternion."""
    if isinstance(value, tuple) and all(isinstance(word, str) for word in value):
        return " ".join(value) or "nothing"
    array = np.atleast_1d(np.asarray(value, dtype=np.float64))
    if array.ndim == 2:
        return "q " + " ".join(short(v, 9) for v in quaternion(array))
    return " ".join(short(v, 6) for v in array.tolist())


def _first_beyond(column: _Column, first: int) -> Iterator[tuple[int, str, str, str]]:
    """Place, property, planned and read value of the first instruction that is beyond the limit, if any is. first: the
    place of the first one that the column may speak of.
    """
    for row in np.flatnonzero(~(column.error <= column.limit + _SLACK))[:1].tolist():
        yield (
            first + int(column.places[row]),
            column.what,
            _text(column.planned[row]),
            _text(column.read[row]),
        )


def _compare_frames(
    planned: Program, frames: Frames, tolerance: Tolerance, carries: frozenset[str], file: str
) -> None:
    """The frames that the text states, and that it states those it should."""
    both = (
        (planned.base_from_work, frames.base_from_work),
        (planned.flange_from_tool, frames.flange_from_tool),
    )
    for name, (was, says) in zip(_FRAMES, both, strict=True):
        if says is None:
            # What goes to joint values alone is in no frame.
            if name in carries and planned.columns.posed.any():
                raise VerifyError(file, f"the {name} frame is not in the text", 0, _REMEDY)
            continue
        off = np.abs(np.subtract(was.origin, says.origin)).max()
        turn = float(angles_between(was.rotation[None], says.rotation[None])[0])
        if not (off <= tolerance.mm + _SLACK and turn <= tolerance.angle + _SLACK):
            reads, plan = (f"{_text(pose.origin)} {_text(pose.rotation)}" for pose in (says, was))
            raise VerifyError(
                file, f"the {name} frame reads {reads}, planned is {plan}", 0, _REMEDY
            )


# Columns.


def _columns(both: _Both, tolerance: Tolerance, words: frozenset[str]) -> Iterator[_Column]:
    """All columns; the frames are compared elsewhere. words: keys of `COMPARED`."""
    posed = both.plan.posed[: both.moves]
    manner = _Manner(both, posed, tolerance, words)
    yield from _places(both, posed, tolerance)
    yield from _joint_values(manner)
    yield from _newtons(manner)
    yield from _others(both, tolerance)
    for word, compared in COMPARED.items():
        if word in words and compared.columns is not None:
            yield from compared.columns(manner)


def _places(both: _Both, posed: Mask, tolerance: Tolerance) -> Iterator[_Column]:
    """Where motions end and what arcs pass half-way."""
    yield both.moving(_END, "ends", posed, tolerance.mm)
    arcs = both.plan.arcs[both.plan.arcs < both.moves]
    a, b = (_middles(side, arcs) for side in (both.plan, both.read))
    places = both.places(MoveJ, MoveL, MoveC)[arcs]
    yield _Column(_MIDDLE, places, a, b, lengths(a - b), ARC_SLACK * tolerance.mm)


def _middles(side: Columns, arcs: Indices) -> FloatArray:
    """The points half-way along the first arcs, which are the motions ``arcs``."""
    return find_arc_middles(side.ends[arcs - 1], side.via[: len(arcs)], side.ends[arcs])


class _Looked(Struct, frozen=True, eq=False):
    """Rotations, by their places (K,) in a table."""

    table: Sequence[FloatArray]
    places: Indices

    def __getitem__(self, row: int) -> FloatArray:
        return self.table[int(self.places[row])]


def _turns(a: _Looked, b: _Looked) -> FloatArray:
    """``pose.angle_between`` by row (K,), rad. Each pair is looked at once: programs share rotations."""
    pairs, back = np.unique(a.places * max(len(b.table), 1) + b.places, return_inverse=True)
    if not len(pairs):
        return np.zeros(0)
    first = np.empty(len(pairs), np.intp)
    first[back] = np.arange(len(back))
    p, q = (np.stack([side[row] for row in first.tolist()]) for side in (a, b))
    return np.asarray(angles_between(p, q)[back])


class _Manner(Struct, frozen=True, eq=False):
    """The input of the functions in `COMPARED`.

    both: the bodies, M motions of each.
    posed: (M,) motions whose target is a pose.
    tolerance: limits of the comparison.
    words: all compared words, since "joint-share" and "joint-rate" stand in for "joint-speed".
    """

    both: _Both
    posed: Mask
    tolerance: Tolerance
    words: frozenset[str]

    @property
    def joint(self) -> Mask:
        """(M,): which motions are joint-interpolated."""
        return self.both.plan.moves_are(MoveJ)[: self.both.moves]

    @property
    def shared(self) -> Mask:
        """(M,): motions that are compared by their share of the maximum joint speeds."""
        return (self.both.plan.share[: self.both.moves] > 0) & ("joint-share" in self.words)

    @property
    def rated(self) -> Mask:
        """(M,): motions that are compared by the speed of a joint."""
        return (self.both.plan.rate[: self.both.moves] > 0) & ("joint-rate" in self.words)

    @property
    def every(self) -> Mask:
        """(M,): all motions."""
        return np.ones(self.both.moves, np.bool_)


def _orientations(manner: _Manner) -> Iterator[_Column]:
    both, posed = manner.both, manner.posed
    a, b = (
        _Looked(side.table, side.rotation[: both.moves][posed].astype(np.intp))
        for side in (both.plan, both.read)
    )
    places = both.places(MoveJ, MoveL, MoveC)[posed]
    yield _Column(_TURN, places, a, b, _turns(a, b), manner.tolerance.angle)


def _via_orientations(manner: _Manner) -> Iterator[_Column]:
    both = manner.both
    arcs = both.plan.arcs[both.plan.arcs < both.moves]
    a, b = (
        _Looked(side.table, side.via_rotation[: len(arcs)].astype(np.intp))
        for side in (both.plan, both.read)
    )
    places = both.places(MoveJ, MoveL, MoveC)[arcs]
    turns = _turns(a, b)
    yield _Column("orientation half-way", places, a, b, turns, manner.tolerance.angle)


def _joint_values(manner: _Manner) -> Iterator[_Column]:
    both, posed = manner.both, manner.posed
    (plan, chosen), (text, chosen_in_text) = both.each(~posed)
    planned = [motion.target.values for motion in plan.pick(plan.at[chosen])]
    read = [motion.target.values for motion in text.pick(text.at[chosen_in_text])]
    error = np.array(
        [np.abs(np.subtract(p, q)).max(initial=0.0) for p, q in zip(planned, read, strict=True)]
    )
    places = both.places(MoveJ, MoveL, MoveC)[~posed]
    yield _Column("joint values", places, planned, read, error, manner.tolerance.joint)


def _joint_shares(manner: _Manner) -> Iterator[_Column]:
    what, limit = "share of the joints' speeds", manner.tolerance.share
    yield manner.both.moving(what, "share", manner.shared, limit)


def _joint_rates(manner: _Manner) -> Iterator[_Column]:
    yield manner.both.moving("speed of a joint", "rate", manner.rated, manner.tolerance.rate)


def _joint_speeds(manner: _Manner) -> Iterator[_Column]:
    where = manner.joint & ~manner.shared & ~manner.rated
    yield manner.both.moving("speed", "speed", where, manner.tolerance.speed)


def _speeds(manner: _Manner) -> Iterator[_Column]:
    # In a reorientation the TCP has no speed.
    travels = manner.both.plan.turn[: manner.both.moves] == 0
    yield manner.both.moving("speed", "speed", ~manner.joint & travels, manner.tolerance.speed)


def _turning_speeds(manner: _Manner) -> Iterator[_Column]:
    both = manner.both
    planned = both.plan.turn[: both.moves] > 0
    if not planned.any():
        return
    # A text may lose a reorientation of less than half the last digit.
    read = both.read.turned[: both.moves] | (both.read.turn[: both.moves] > 0)
    # A joint motion has it only for a controller whose text states it.
    read |= both.plan.moves_are(MoveJ)[: both.moves]
    yield both.moving("speed of turning", "turn", planned & read, manner.tolerance.turn)


def _blends(manner: _Manner) -> Iterator[_Column]:
    yield manner.both.moving("blend", "blend", manner.every, manner.tolerance.mm)


def _stops(manner: _Manner) -> Iterator[_Column]:
    stop = manner.both.moving("blend", "blend", manner.every, 0.0)
    yield replace(stop, error=((stop.planned > 0) != (stop.read > 0)) * 1.0)


def _newtons(manner: _Manner) -> Iterator[_Column]:
    yield manner.both.moving("force", "force", ~manner.joint, manner.tolerance.force)


def _force_directions(manner: _Manner) -> Iterator[_Column]:
    both, tolerance = manner.both, manner.tolerance
    (newtons,) = _newtons(manner)
    if np.any(newtons.planned):
        a, b = (side.force_direction[where] for side, where in both.each(~manner.joint))
        yield _along(newtons, a, b, tolerance)
    changes = both.others(Force, "force", "newtons", tolerance.force)
    if np.any(changes.planned):
        press = both.others(Force, "force_direction", "force_direction", 0.0, 3)
        yield _along(changes, np.asarray(press.planned), np.asarray(press.read), tolerance)


def _postures_in(name: str) -> Callable[[_Manner], Iterator[_Column]]:
    """The column of the postures in the words of a controller, the field `name` of `Posture`."""

    def columns(manner: _Manner) -> Iterator[_Column]:
        yield _postures(manner.both, manner.posed, name)

    return columns


def _postures(both: _Both, posed: Mask, name: str) -> _Column:
    """What a text says of the posture at the target: the same as the plan, or that it is open."""
    # Of motions that are in neither the rest says nothing of it, and both are open.
    stated = np.zeros(both.moves, np.bool_)
    for side in (both.plan, both.read):
        found = side.special[0]
        stated[found[found < both.moves]] = True
    stated &= posed
    a, b = (
        [_get_said(motion, name) for motion in side.pick(side.at[where])]
        for side, where in both.each(stated)
    )
    places = both.places(MoveJ, MoveL, MoveC)[stated]
    return _Column(name, places, a, b, np.fromiter(map(ne, a, b), np.float64, len(a)), 0.0)


def _get_said(motion: MoveJ | MoveL | MoveC, name: str) -> object:
    said = getattr(motion.posture, name, None)
    return _NEUTRAL[name] if said is None else said


def _along(newtons: _Column, a: FloatArray, b: FloatArray, tolerance: Tolerance) -> _Column:
    """Forces by component, from their size and direction: each component may be off by both tolerances."""
    planned, read = (np.reshape(size, (-1, 1)) for size in (newtons.planned, newtons.read))
    limit = tolerance.force + tolerance.angle * planned[:, 0]
    return _Column(
        "force along x y z",
        newtons.places,
        planned * a,
        read * b,
        _worst(planned * a - read * b),
        limit,
    )


def _others(both: _Both, tolerance: Tolerance) -> Iterator[_Column]:
    """Outputs, waits, tool changes, stops and force changes."""
    yield both.others(Output, "output", "value", _VALUE)
    yield both.others(Wait, "wait", "seconds", tolerance.seconds)
    yield both.others(ToolChange, "tool change", "number", 0.0)
    yield both.others(Stop, "stop", "optional", 0.0)
    yield both.others(Force, "force", "newtons", tolerance.force)


class Compared(Struct, frozen=True):
    """The meaning of a word of `Post.verified_fields`.

    aspects: the properties that it compares, in the words of the summary; another word may compare
        them too.
    columns: makes the columns of the comparison; None for a frame (`_compare_frames`).
    """

    aspects: tuple[str, ...]
    columns: Callable[[_Manner], Iterator[_Column]] | None = None


_STOPS, _JOINT_SPEEDS = "stops at targets", "speeds of joint motions"
_POSTURES = "postures of the arm"
#: The properties that a text may or may not carry, by the word of `Post.verified_fields`. There are no
#: other words, and nothing else selects them. The rest is always compared: kinds and order of
#: instructions, targets, arcs, joint values, outputs, waits, tool changes, stops, newtons.
COMPARED: Mapping[str, Compared] = {
    "work": Compared(("the work frame",)),
    "tool": Compared(("the tool frame",)),
    "orientation": Compared(("orientations at targets",), _orientations),
    "via-orientation": Compared(("orientations half-way along arcs",), _via_orientations),
    "joint-share": Compared((_JOINT_SPEEDS,), _joint_shares),
    "joint-rate": Compared((_JOINT_SPEEDS,), _joint_rates),
    "joint-speed": Compared((_JOINT_SPEEDS,), _joint_speeds),
    "speed": Compared(("speeds of linear and circular motions",), _speeds),
    "turn": Compared(("speeds of reorientations",), _turning_speeds),
    "blend": Compared(("blend radii", _STOPS), _blends),
    "confdata": Compared((_POSTURES,), _postures_in("confdata")),
    "figure": Compared((_POSTURES,), _postures_in("figure")),
    "switches": Compared((_POSTURES,), _postures_in("switches")),
    "stop": Compared((_STOPS,), _stops),
    "force-direction": Compared(("directions of forces",), _force_directions),
}
_FRAMES = tuple(word for word, compared in COMPARED.items() if compared.columns is None)


def list_uncompared(post: Post) -> list[str]:
    """The properties of a program that are not compared for `post`, in the words of the summary.

    First those that its text does not carry, then those that an option lets `Post.prepare` change.
    """
    words = post.list_verified()
    covered = {aspect for word in words for aspect in COMPARED[word].aspects}
    aspects = dict.fromkeys(chain.from_iterable(row.aspects for row in COMPARED.values()))
    missing = [aspect for aspect in aspects if aspect not in covered]
    changed = [text for word, text in CHANGES.items() if text and word in post.list_changed()]
    return missing + changed
