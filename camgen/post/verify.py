"""Compares the read-back of a program text with the program that was posted.

`compare` compares, with these limits:

* Kinds of instructions, one to one and in order, without comments. The names of outputs, and their
  values to 0.001.
* Positions: each coordinate within `tolerance.mm`, half of the last printed digit.
* Arcs as geometry: the point half-way along the arc in the text, wherever its `via` is on it, and
  the one half-way along the planned arc, within `ARC_SLACK * tolerance.mm`. The reason for 6: let d
  be half of the last digit. A text with `via` rounds three points by up to sqrt(3) d = 1.73 d each.
  An error of `via` across the arc moves the middle by as much. Errors of the ends shift it along
  the arc by their mean, and rotate it about `via` by at most as much again, since up to half a
  circle an arc is no higher than half of its chord: sqrt(1.73^2 + 3.46^2) d = 3.9 d. A text with a
  centre, in a plane, rounds ends and centre by up to sqrt(2) d = 1.41 d each. The ends move the
  middle by 1.41 d across and along the arc, the centre by sqrt(2) times its error at half a circle:
  4.9 d together. If a radius is only a few d, the second order adds up to 1 d. Rounding 200,000
  random arcs gives 2.2 d and 3.1 d.
* Orientations within `tolerance.angle`, from the skew part of the difference: the trace alone
  cannot distinguish 1e-8 rad from 0. The orientation at `via` is compared only if the post carries
  it: controllers interpolate from the start to the end, and use it at most for the direction.
* Postures: ABB's confdata, DENSO's figure or the switches of V+ are equal, or neutral if the plan
  has none.
* The fraction of the maximum joint speeds, or the speed of the joint with the longest travel,
  instead of the speed of a joint motion, if it is known and the text states it.
* Joints, speeds, blends, waits, forces within their tolerances, as far as `verified_fields` of the
  post contains their word of `COMPARED`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from itertools import chain, pairwise
from operator import eq, ne
from typing import Any

import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from camgen.geometry.arcs import find_arc_middles
from camgen.geometry.rotations import measure_angles_between
from camgen.geometry.vectors import measure_lengths
from camgen.lang.programs import Executed, Frames
from camgen.model.errors import VerifyError
from camgen.model.pose import FloatArray, Pose, compute_quaternion
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
from camgen.model.sequences import take_rows
from camgen.model.text import counted, join_short, short
from camgen.post import Post, Tolerance
from camgen.post.preparation import CHANGES

#: Deviation of the point half-way along an arc that is allowed per `tolerance.mm`: see above.
ARC_SLACK = 6.0
#: Rounding of binary numbers, in every unit.
_SLACK = 1e-9
#: Tolerance of an output's value.
_VALUE = 1e-3
#: Postures in a text that leave the posture open.
_NEUTRAL: dict[str, object] = {"confdata": (0, 0, 0, 0), "figure": -1, "switches": ()}
#: Number of motions that are compared together, at least.
_BATCH = 32768
_END, _MIDDLE, _TURN = "target", "middle of the arc", "orientation"
_PLACES = (_END, _MIDDLE)
_REMEDY = "do not run the program: its post or its read-back is wrong"


class Deviation(Struct, frozen=True):
    """The deviation of a text from the plan.

    max_mm: largest distance of a target or of the middle of an arc, mm.
    max_angle: largest angle of an orientation, rad; 0 if the text carries no orientation.
    instructions: number of compared instructions.
    """

    max_mm: float
    max_angle: float
    instructions: int


class _Column(Struct, frozen=True, eq=False):
    """One property of M instructions.

    what: name of the property.
    places: (M,) indices of the instructions among those compared.
    planned: value of each instruction in the plan.
    read: value of each instruction in the text.
    error: (M,) deviation in the unit of the property; NaN is beyond every limit.
    limit: allowed deviation, one for all or (M,).
    """

    what: str
    places: Indices
    planned: Any
    read: Any
    error: FloatArray
    limit: float | FloatArray


class _Bodies(Struct, frozen=True, eq=False):
    """The bodies of plan and text, or stretches of them, without comments.

    plan: the plan.
    read: the text.
    indices: index of each instruction in the body of the plan.
    read_indices: index of each instruction in the body of the text.
    common: number of instructions at the start that are of the same kinds.
    moves: number of motions among these.
    first: index of the first instruction of a stretch in the whole.
    """

    plan: Columns
    read: Columns
    indices: Indices
    read_indices: Indices
    common: int
    moves: int
    first: int = 0

    def divide(self) -> Iterator[_Bodies]:
        """Divide the bodies before motions that are compared without the motions before them.

        These are all motions except arcs and reorientations at a fixed TCP.
        """
        alone = ~(self.plan.moves_are(MoveC) | self.plan.turned)[: self.moves]
        alone &= ~self.read.turned[: self.moves]
        places = self.find(MoveJ, MoveL, MoveC)[alone]
        bounds = [0]
        while (cut := int(np.searchsorted(places, bounds[-1] + _BATCH))) < len(places):
            bounds.append(int(places[cut]))
        for low, high in pairwise([*bounds, self.common]):
            plan, indices = _cut(self.plan, self.indices, low, high)
            read, read_indices = _cut(self.read, self.read_indices, low, high)
            yield _Bodies(plan, read, indices, read_indices, high - low, len(plan.at), low)

    def find(self, *kinds: type) -> Indices:
        """Find the instructions of the types `kinds` among the common ones."""
        return np.flatnonzero(self.plan.are(*kinds)[self.indices[: self.common]])

    def compare_motions(self, what: str, name: str, where: Mask, limit: float) -> _Column:
        """Compare an attribute of the motions `where` (M,), by the worst number of each."""
        a = getattr(self.plan, name)[: self.moves][where]
        b = getattr(self.read, name)[: self.moves][where]
        return self.make_column(what, where, a, b, _measure_worst(a - b), limit)

    def make_column(
        self,
        what: str,
        where: Mask | Indices,
        planned: Any,
        read: Any,
        error: FloatArray,
        limit: float,
    ) -> _Column:
        """A property of the motions `where`: a mask (M,), or their numbers."""
        places = self.find(MoveJ, MoveL, MoveC)[where]
        return _Column(what, places, planned, read, error, limit)

    def select(self, where: Mask) -> Iterator[tuple[Columns, Mask]]:
        """Return both sides, with the mask `where` (moves,) extended to all motions of each."""
        for side in (self.plan, self.read):
            chosen = np.zeros(len(side.at), np.bool_)
            chosen[: self.moves] = where
            yield side, chosen

    def compare_others(
        self, kind: type, what: str, name: str, limit: float, width: int = 1
    ) -> _Column:
        """Compare an attribute of the instructions of one type, a number or a tuple of `width`."""
        places = self.find(kind)
        a = read_numbers(self.plan.list_kinds(kind)[: len(places)], name, width)
        b = read_numbers(self.read.list_kinds(kind)[: len(places)], name, width)
        return _Column(what, places, a, b, _measure_worst(a - b), limit)


def _cut(side: Columns, indices: Indices, low: int, high: int) -> tuple[Columns, Indices]:
    if low == high:
        return side.stretch(0, 0), indices[:0]
    begin, end = int(indices[low]), int(indices[high - 1]) + 1
    return side.stretch(begin, end), indices[low:high] - begin


def _measure_worst(error: FloatArray) -> FloatArray:
    """Return the largest absolute number of each row, (N,); `error` is overwritten."""
    size = np.abs(error, out=error)
    return np.asarray(size.max(axis=1) if size.ndim == 2 else size)


def compare(
    planned: Program, executed: Executed, tolerance: Tolerance, carries: frozenset[str], file: str
) -> Deviation:
    """Compare a program text with the program that was prepared for the post.

    executed: the strict run of the text.
    carries: words of `COMPARED` (`Post.list_verified`).
    file: name for messages.

    Raises VerifyError for the first finding of the run, or for the first instruction that differs,
    with its index in the planned body, its line, and both values.
    """
    for finding in executed.findings[:1]:
        raise VerifyError(file, finding.what, finding.line, _REMEDY)
    for frames in executed.frames or (Frames(),):
        _compare_frames(planned, frames, tolerance, carries, file)
    bodies = _pair(planned, executed)
    differences: list[tuple[int, str, str, str]] = []
    distance = angle = 0.0
    # The columns of a whole long program would be larger than the program.
    for stretch in bodies.divide():
        for column in _make_columns(stretch, tolerance, carries):
            differences += _find_first_beyond(column, stretch.first)
            if column.what in _PLACES:
                distance = max(distance, _measure_farthest(column.planned, column.read))
            elif column.what == _TURN:
                angle = max(angle, float(column.error.max(initial=0.0)))
    read_at = bodies.read_indices
    if bodies.common < max(len(bodies.indices), len(read_at)):
        plan_text = _describe(planned.body, bodies.indices, bodies.common)
        read_text = _describe(executed.body, read_at, bodies.common)
        differences.append((bodies.common, "instruction", plan_text, read_text))
    if differences:
        place, what, plan_text, read_text = min(differences, key=lambda difference: difference[0])
        index = int(bodies.indices[place]) if place < len(bodies.indices) else len(planned.body)
        line = executed.lines[read_at[place]] if place < len(read_at) else 0
        raise VerifyError(
            file,
            f"instruction {index}: {what} reads {read_text}, planned is {plan_text}",
            line,
            _REMEDY,
        )
    return Deviation(distance, angle, len(bodies.indices))


def _measure_farthest(a: FloatArray, b: FloatArray) -> float:
    difference = a - b
    difference *= difference
    return math.sqrt(difference.sum(axis=1).max(initial=0.0))


def _pair(planned: Program, executed: Executed) -> _Bodies:
    if len(executed.body) != len(executed.lines):
        instructions = counted(len(executed.body), "instruction")
        raise ValueError(f"{instructions} with {counted(len(executed.lines), 'line')}")
    plan, read = planned.columns, Columns(executed.body)
    at, read_at = np.flatnonzero(~plan.are(Comment)), np.flatnonzero(~read.are(Comment))
    size = min(len(at), len(read_at))
    same = np.ones(size, np.bool_)
    for kind in (MoveJ, MoveL, MoveC, Output, Wait, Force, ToolChange, Stop):
        same &= plan.are(kind)[at[:size]] == read.are(kind)[read_at[:size]]
    common = _first_false(same)
    for kind, read_column in ((Output, _list_signals), (MoveJ, _count_joints)):
        places = np.flatnonzero(plan.are(kind)[at[:common]])
        alike = np.fromiter(map(eq, read_column(plan), read_column(read)), np.bool_, len(places))
        common = int(np.append(places, common)[_first_false(alike)])
    moves = int(plan.are(MoveJ, MoveL, MoveC)[at[:common]].sum())
    return _Bodies(plan, read, at, read_at, common, moves)


def _first_false(mask: Mask) -> int:
    return int(np.append(mask, False).argmin())


def _list_signals(side: Columns) -> list[str]:
    return [item.signal for item in side.list_kinds(Output)]


def _count_joints(side: Columns) -> list[int]:
    count = np.full(len(side.at), -1)
    for place in np.flatnonzero(~side.posed).tolist():
        count[place] = len(side.moves[place].target.values)
    return list(count[side.moves_are(MoveJ)].tolist())


def _describe(body: Sequence[Instruction], at: Indices, place: int) -> str:
    if place >= len(at):
        return "nothing"
    item = body[at[place]]
    match item:
        case MoveJ(target=Joints(values)):
            return f"MoveJ to {len(values)} joint values"
        case MoveJ(target=Pose() as target) | MoveL(target=target) | MoveC(target=target):
            return f"{type(item).__name__} to {_format(target.origin)}"
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


def _format(value: object) -> str:
    if isinstance(value, tuple) and all(isinstance(word, str) for word in value):
        return " ".join(value) or "nothing"
    array = np.atleast_1d(np.asarray(value, dtype=np.float64))
    if array.ndim == 2:
        return "q " + join_short(compute_quaternion(array), 9)
    return join_short(array.tolist(), 6)


def _find_first_beyond(column: _Column, first: int) -> Iterator[tuple[int, str, str, str]]:
    """Find the first instruction beyond the limit.

    first: index of the first instruction of the stretch.

    Yields index, property, planned and read value; nothing if all are within the limit.
    """
    for row in np.flatnonzero(~(column.error <= column.limit + _SLACK))[:1].tolist():
        planned, read = _format(column.planned[row]), _format(column.read[row])
        yield first + int(column.places[row]), column.what, planned, read


def _compare_frames(
    planned: Program, frames: Frames, tolerance: Tolerance, carries: frozenset[str], file: str
) -> None:
    for name, plan, read in (
        ("work", planned.base_from_work, frames.base_from_work),
        ("tool", planned.flange_from_tool, frames.flange_from_tool),
    ):
        if read is None:
            # A program without poses uses no frame.
            if name in carries and planned.columns.posed.any():
                raise VerifyError(file, f"the {name} frame is not in the text", 0, _REMEDY)
            continue
        distance = np.abs(np.subtract(plan.origin, read.origin)).max()
        angle = float(measure_angles_between(plan.rotation[None], read.rotation[None])[0])
        if not (distance <= tolerance.mm + _SLACK and angle <= tolerance.angle + _SLACK):
            reads = f"{_format(read.origin)} {_format(read.rotation)}"
            was = f"{_format(plan.origin)} {_format(plan.rotation)}"
            raise VerifyError(file, f"the {name} frame reads {reads}, planned is {was}", 0, _REMEDY)


def _make_columns(
    bodies: _Bodies, tolerance: Tolerance, words: frozenset[str]
) -> Iterator[_Column]:
    """Make all columns, without the frames, which `_compare_frames` compares.

    words: keys of `COMPARED`.
    """
    case = _Case(bodies, bodies.plan.posed[: bodies.moves], tolerance, words)
    yield from _compare_places(case)
    yield from _compare_joint_values(case)
    yield from _compare_newtons(case)
    yield bodies.compare_others(Output, "output", "value", _VALUE)
    yield bodies.compare_others(Wait, "wait", "seconds", tolerance.seconds)
    yield bodies.compare_others(ToolChange, "tool change", "number", 0.0)
    yield bodies.compare_others(Stop, "stop", "optional", 0.0)
    yield bodies.compare_others(Force, "force", "newtons", tolerance.force)
    for word, compared in COMPARED.items():
        if word in words and compared.columns is not None:
            yield from compared.columns(case)


class _Case(Struct, frozen=True, eq=False):
    """The input of the functions in `COMPARED`.

    bodies: the bodies, with M motions each.
    posed: (M,) motions whose target is a pose.
    tolerance: limits of the comparison.
    words: all compared words, since "joint-share" and "joint-rate" replace "joint-speed".
    """

    bodies: _Bodies
    posed: Mask
    tolerance: Tolerance
    words: frozenset[str]

    @property
    def arcs(self) -> Indices:
        """The motions that are arcs."""
        arcs = self.bodies.plan.arcs
        return arcs[arcs < self.bodies.moves]

    @property
    def joint(self) -> Mask:
        """Whether each motion is a joint motion, (M,)."""
        return self.bodies.plan.moves_are(MoveJ)[: self.bodies.moves]

    @property
    def shared(self) -> Mask:
        """Whether each motion is compared by its fraction of the maximum joint speeds, (M,)."""
        return (self.bodies.plan.share[: self.bodies.moves] > 0) & ("joint-share" in self.words)

    @property
    def rated(self) -> Mask:
        """Whether each motion is compared by the speed of a joint, (M,)."""
        return (self.bodies.plan.rate[: self.bodies.moves] > 0) & ("joint-rate" in self.words)


def _compare_places(case: _Case) -> Iterator[_Column]:
    bodies, arcs, limit = case.bodies, case.arcs, case.tolerance.mm
    yield bodies.compare_motions(_END, "ends", case.posed, limit)
    plan, read, count = bodies.plan, bodies.read, len(arcs)
    a = find_arc_middles(plan.ends[arcs - 1], plan.via[:count], plan.ends[arcs])
    b = find_arc_middles(read.ends[arcs - 1], read.via[:count], read.ends[arcs])
    yield bodies.make_column(_MIDDLE, arcs, a, b, measure_lengths(a - b), ARC_SLACK * limit)


class _Rotations(Struct, frozen=True, eq=False):
    """Rotations as indices (K,) in a table."""

    table: Sequence[FloatArray]
    places: Indices

    def __getitem__(self, row: int) -> FloatArray:
        return self.table[int(self.places[row])]

    def stack(self, rows: Indices) -> FloatArray:
        return np.stack(take_rows(self.table, self.places[rows].tolist()))


def _measure_angles(a: _Rotations, b: _Rotations) -> FloatArray:
    """Measure the angle of each pair of rotations (K,), rad.

    Each different pair is measured once, since programs share rotations.
    """
    pairs, back = np.unique(a.places * max(len(b.table), 1) + b.places, return_inverse=True)
    if not len(pairs):
        return np.zeros(0)
    first = np.empty(len(pairs), np.intp)
    first[back] = np.arange(len(back))
    return np.asarray(measure_angles_between(a.stack(first), b.stack(first))[back])


def _compare_orientations(case: _Case) -> Iterator[_Column]:
    bodies, posed = case.bodies, case.posed
    a = _Rotations(bodies.plan.table, bodies.plan.rotation[: bodies.moves][posed].astype(np.intp))
    b = _Rotations(bodies.read.table, bodies.read.rotation[: bodies.moves][posed].astype(np.intp))
    yield bodies.make_column(_TURN, posed, a, b, _measure_angles(a, b), case.tolerance.angle)


def _compare_via_orientations(case: _Case) -> Iterator[_Column]:
    bodies, arcs = case.bodies, case.arcs
    a = _Rotations(bodies.plan.table, bodies.plan.via_rotation[: len(arcs)].astype(np.intp))
    b = _Rotations(bodies.read.table, bodies.read.via_rotation[: len(arcs)].astype(np.intp))
    yield bodies.make_column(
        "orientation half-way", arcs, a, b, _measure_angles(a, b), case.tolerance.angle
    )


def _compare_joint_values(case: _Case) -> Iterator[_Column]:
    values = []
    for side, where in case.bodies.select(~case.posed):
        values.append([motion.target.values for motion in side.pick(side.at[where])])
    planned, read = values
    pairs = zip(planned, read, strict=True)
    error = np.array([np.abs(np.subtract(p, q)).max(initial=0.0) for p, q in pairs])
    yield case.bodies.make_column(
        "joint values", ~case.posed, planned, read, error, case.tolerance.joint
    )


def _compare_joint_shares(case: _Case) -> Iterator[_Column]:
    yield case.bodies.compare_motions(
        "share of the joints' speeds", "share", case.shared, case.tolerance.share
    )


def _compare_joint_rates(case: _Case) -> Iterator[_Column]:
    yield case.bodies.compare_motions("speed of a joint", "rate", case.rated, case.tolerance.rate)


def _compare_joint_speeds(case: _Case) -> Iterator[_Column]:
    where = case.joint & ~case.shared & ~case.rated
    yield case.bodies.compare_motions("speed", "speed", where, case.tolerance.speed)


def _compare_speeds(case: _Case) -> Iterator[_Column]:
    # In a reorientation the TCP has no speed.
    where = ~case.joint & (case.bodies.plan.turn[: case.bodies.moves] == 0)
    yield case.bodies.compare_motions("speed", "speed", where, case.tolerance.speed)


def _compare_reorientation_speeds(case: _Case) -> Iterator[_Column]:
    bodies = case.bodies
    planned = bodies.plan.turn[: bodies.moves] > 0
    if not planned.any():
        return
    # A text may lose a reorientation of less than half of the last digit.
    read = bodies.read.turned[: bodies.moves] | (bodies.read.turn[: bodies.moves] > 0)
    # A joint motion has such a speed only for a controller whose text states it.
    where = planned & (read | case.joint)
    yield bodies.compare_motions("speed of turning", "turn", where, case.tolerance.turn)


def _compare_blends(case: _Case) -> Iterator[_Column]:
    every_motion = np.ones(case.bodies.moves, np.bool_)
    yield case.bodies.compare_motions("blend", "blend", every_motion, case.tolerance.mm)


def _compare_stops(case: _Case) -> Iterator[_Column]:
    for blends in _compare_blends(case):
        yield replace(blends, error=((blends.planned > 0) != (blends.read > 0)) * 1.0, limit=0.0)


def _compare_newtons(case: _Case) -> Iterator[_Column]:
    yield case.bodies.compare_motions("force", "force", ~case.joint, case.tolerance.force)


def _compare_force_directions(case: _Case) -> Iterator[_Column]:
    bodies, tolerance = case.bodies, case.tolerance
    (newtons,) = _compare_newtons(case)
    if np.any(newtons.planned):
        a, b = (side.force_direction[where] for side, where in bodies.select(~case.joint))
        yield _compare_components(newtons, a, b, tolerance)
    changes = bodies.compare_others(Force, "force", "newtons", tolerance.force)
    if np.any(changes.planned):
        press = bodies.compare_others(Force, "force_direction", "force_direction", 0.0, 3)
        yield _compare_components(changes, press.planned, press.read, tolerance)


def _compare_postures(case: _Case, name: str) -> Iterator[_Column]:
    """Compare the field `name` of `Posture`; a text has the planned posture, or leaves it open."""
    bodies = case.bodies
    # Motions that are special on neither side have no posture, so both are open.
    stated = np.zeros(bodies.moves, np.bool_)
    for side in (bodies.plan, bodies.read):
        special = side.special[0]
        stated[special[special < bodies.moves]] = True
    stated &= case.posed
    values = []
    for side, where in bodies.select(stated):
        values.append([_get_posture(motion, name) for motion in side.pick(side.at[where])])
    a, b = values
    error = np.fromiter(map(ne, a, b), np.float64, len(a))
    yield bodies.make_column(name, stated, a, b, error, 0.0)


def _get_posture(motion: MoveJ | MoveL | MoveC, name: str) -> object:
    value = getattr(motion.posture, name, None)
    if value is None:
        return _NEUTRAL[name]
    return value


def _compare_components(
    newtons: _Column, a: FloatArray, b: FloatArray, tolerance: Tolerance
) -> _Column:
    """Compare forces by component; each component may deviate by both tolerances together."""
    limit = tolerance.force + tolerance.angle * newtons.planned.ravel()
    planned, read = np.reshape(newtons.planned, (-1, 1)) * a, np.reshape(newtons.read, (-1, 1)) * b
    error = _measure_worst(planned - read)
    return _Column("force along x y z", newtons.places, planned, read, error, limit)


class Compared(Struct, frozen=True):
    """The meaning of a word of `Post.verified_fields`.

    aspects: the properties that it compares, in the words of the summary; another word may compare
        them too.
    columns: makes the columns of the comparison; None for a frame (`_compare_frames`).
    """

    aspects: tuple[str, ...]
    columns: Callable[[_Case], Iterator[_Column]] | None = None


_STOPS, _JOINT_SPEEDS = "stops at targets", "speeds of joint motions"
_POSTURES = "postures of the arm"
#: The properties that a text may or may not carry, by the word of `Post.verified_fields`. There are
#: no other words, and nothing else selects them. The rest is always compared: kinds and order of
#: instructions, targets, arcs, joint values, outputs, waits, tool changes, stops, newtons.
COMPARED: Mapping[str, Compared] = {
    "work": Compared(("the work frame",)),
    "tool": Compared(("the tool frame",)),
    "orientation": Compared(("orientations at targets",), _compare_orientations),
    "via-orientation": Compared(("orientations half-way along arcs",), _compare_via_orientations),
    "joint-share": Compared((_JOINT_SPEEDS,), _compare_joint_shares),
    "joint-rate": Compared((_JOINT_SPEEDS,), _compare_joint_rates),
    "joint-speed": Compared((_JOINT_SPEEDS,), _compare_joint_speeds),
    "speed": Compared(("speeds of linear and circular motions",), _compare_speeds),
    "turn": Compared(("speeds of reorientations",), _compare_reorientation_speeds),
    "blend": Compared(("blend radii", _STOPS), _compare_blends),
    "confdata": Compared((_POSTURES,), partial(_compare_postures, name="confdata")),
    "figure": Compared((_POSTURES,), partial(_compare_postures, name="figure")),
    "switches": Compared((_POSTURES,), partial(_compare_postures, name="switches")),
    "stop": Compared((_STOPS,), _compare_stops),
    "force-direction": Compared(("directions of forces",), _compare_force_directions),
}


def list_uncompared(post: Post) -> list[str]:
    """List the properties that are not compared for `post`, in the words of the summary.

    Properties that its text does not carry come first, then those that an option lets
    `Post.prepare` change.
    """
    covered = set(chain.from_iterable(COMPARED[word].aspects for word in post.list_verified()))
    aspects = dict.fromkeys(chain.from_iterable(row.aspects for row in COMPARED.values()))
    missing = [aspect for aspect in aspects if aspect not in covered]
    changed = [text for word, text in CHANGES.items() if text and word in post.list_changed()]
    return missing + changed
