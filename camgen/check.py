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
  from 0. The orientation at ``via`` is left out: controllers interpolate from the start to the end.
* Joints, speeds, blends, waits, forces within their tolerances, as far as the post ``carries`` them.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from operator import attrgetter
from typing import Any

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from camgen.body import Mask, are, numbers, posed, taken
from camgen.errors import VerifyError
from camgen.ir import Comment, Force, Instruction, Joints, MoveC, MoveJ, MoveL, Output, Program, Wait
from camgen.pose import FloatArray, Pose, quaternion
from camgen.post import Reading, Tolerance
from camgen.text import short

#: What the point half-way along an arc may move per ``tolerance.mm``: see above.
ARC_SLACK = 6.0
#: What is left to the rounding of binary numbers, in every unit; and the tolerance of an output's value.
_SLACK, _VALUE = 1e-9, 1e-3
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
    places: NDArray[np.intp]
    planned: Sequence[Any] | FloatArray
    read: Sequence[Any] | FloatArray
    error: FloatArray
    limit: float | FloatArray


class _Group(Struct, frozen=True, eq=False):
    """Some of the instructions: their places, planned and read."""

    places: NDArray[np.intp]
    planned: list[Any]
    read: list[Any]

    def where(self, keep: Mask) -> _Group:
        """Those of them to keep."""
        return _Group(self.places[keep], taken(self.planned, keep), taken(self.read, keep))

    def column(self, what: str, name: str, limit: float, width: int = 1) -> _Column:
        """An attribute, a number or a tuple of ``width``: the error is that of the worst number."""
        a, b = numbers(self.planned, name, width), numbers(self.read, name, width)
        return _Column(what, self.places, a, b, np.abs(a - b).max(axis=1), limit)


def compare(planned: Program, reading: Reading, tolerance: Tolerance, carries: frozenset[str], file: str) -> Deviation:
    """The deviation of what was read from ``planned``, the program as prepared for the post.

    carries: what the text holds (``Post.carries``). file: for messages. Raises VerifyError for the first fault of the
    reading or the first instruction that differs, with its index in the planned body, its line, and both values.
    """
    for fault in reading.faults[:1]:
        raise VerifyError(file, fault.what, fault.line, _REMEDY)
    _compare_frames(planned, reading, tolerance, file)
    indices, plan = _spoken(planned.body, range(len(planned.body)))
    lines, read = _spoken(reading.body, reading.lines)
    common = _same_kinds(plan, read)
    both = _Group(np.arange(common), plan[:common], read[:common])
    moves = both.where(are(both.planned, MoveL, MoveC, MoveJ))
    places, to_poses = _places(moves, tolerance)
    columns = [*places, *_manners(moves, to_poses, tolerance, carries), *_others(both, tolerance, carries)]
    differences = [found for column in columns for found in _first_beyond(column)]
    if common < max(len(plan), len(read)):
        differences.append((common, "instruction", _say(plan, common), _say(read, common)))
    if differences:
        place, what, was, says = min(differences, key=lambda difference: difference[0])
        index = indices[place] if place < len(indices) else len(planned.body)
        line = lines[place] if place < len(lines) else 0
        raise VerifyError(file, f"instruction {index}: {what} reads {says}, planned is {was}", line, _REMEDY)
    distance = (np.linalg.norm(np.subtract(c.planned, c.read), axis=1).max(initial=0.0) for c in places)
    angle = (c.error.max(initial=0.0) for c in columns if c.what == "orientation")
    return Deviation(float(max(distance)), float(max(angle, default=0.0)), len(plan))


def _spoken(body: Sequence[Instruction], places: Sequence[int]) -> tuple[list[int], list[Instruction]]:
    """The instructions that are no comments, and their numbers."""
    if len(body) != len(places):
        raise ValueError(f"{len(body)} instructions with {len(places)} lines")
    keep = ~are(body, Comment)
    return taken(places, keep), taken(body, keep)


def _same_kinds(plan: list[Instruction], read: list[Instruction]) -> int:
    """How many instructions at the start can be compared by number: same type, same signal, as many joints."""
    count = min(len(plan), len(read))
    types, others = list(map(type, plan[:count])), list(map(type, read[:count]))
    if types != others:
        count = next(i for i, (a, b) in enumerate(zip(types, others, strict=True)) if a is not b)
    finer = (i for i, kind in enumerate(types[:count]) if kind is MoveJ or kind is Output)
    return next((i for i in finer if _name(plan[i]) != _name(read[i])), count)


def _name(item: Instruction) -> object:
    """The signal of an output, the number of joints of a motion to joints."""
    if isinstance(item, Output):
        return item.signal
    return len(item.target.values) if isinstance(item, MoveJ) and isinstance(item.target, Joints) else None


# Messages.


def _say(body: list[Instruction], place: int) -> str:
    """An instruction in a few words."""
    if place >= len(body):
        return "nothing"
    match body[place]:
        case MoveJ(target=Joints(values)):
            return f"MoveJ to {len(values)} joint values"
        case MoveJ(target=Pose() as target) | MoveL(target=target) | MoveC(target=target):
            return f"{type(body[place]).__name__} to {_text(target.origin)}"
        case Output(signal, value):
            return f"output {signal} {short(value, 3)}"
        case Wait(seconds):
            return f"wait {short(seconds, 3)} s"
        case Force(newtons):
            return f"force {short(newtons, 3)} N"
    return type(body[place]).__name__


def _text(value: object) -> str:
    """A number, some numbers, or a rotation as its quaternion."""
    array = np.atleast_1d(np.asarray(value, dtype=np.float64))
    if array.ndim == 2:
        return "q " + " ".join(short(v, 9) for v in quaternion(array))
    return " ".join(short(v, 6) for v in array.tolist())


def _first_beyond(column: _Column) -> Iterator[tuple[int, str, str, str]]:
    """Place, property, planned and read value of the first instruction that is beyond the limit, if any is."""
    for row in np.flatnonzero(~(column.error <= column.limit + _SLACK))[:1].tolist():
        yield int(column.places[row]), column.what, _text(column.planned[row]), _text(column.read[row])


def _compare_frames(planned: Program, reading: Reading, tolerance: Tolerance, file: str) -> None:
    """The frames that the text defines."""
    both = (("work", planned.base_from_work, reading.work), ("tool", planned.flange_from_tool, reading.tool))
    for name, was, says in both:
        if says is None:
            continue
        off = np.abs(np.subtract(was.origin, says.origin)).max()
        turn = _turns([was.rotation], [says.rotation])[0]
        if not (off <= tolerance.mm + _SLACK and turn <= tolerance.angle + _SLACK):
            reads, plan = (f"{_text(pose.origin)} {_text(pose.rotation)}" for pose in (says, was))
            raise VerifyError(file, f"the {name} frame reads {reads}, planned is {plan}", 0, _REMEDY)


# Columns.


def _places(moves: _Group, tolerance: Tolerance) -> tuple[list[_Column], _Group]:
    """Where motions end and what arcs pass half-way, and the motions to poses."""
    is_pose, is_arc = posed(moves.planned), are(moves.planned, MoveC)
    to_poses, arcs = moves.where(is_pose), moves.where(is_arc)
    target = to_poses.column("target", "target.origin", tolerance.mm, 3)
    middles = []
    for origins, side in ((target.planned, arcs.planned), (target.read, arcs.read)):
        ends = np.full((len(is_pose), 3), np.nan)
        ends[is_pose] = origins
        starts = np.roll(ends, 1, axis=0)
        middles.append(arc_middles(starts[is_arc], numbers(side, "via.origin", 3), ends[is_arc]))
    a, b = middles
    error = np.linalg.norm(a - b, axis=1)
    return [target, _Column("middle of the arc", arcs.places, a, b, error, ARC_SLACK * tolerance.mm)], to_poses


def arc_middles(start: FloatArray, via: FloatArray, end: FloatArray) -> FloatArray:
    """The points (N, 3) half-way along the arcs from ``start`` through ``via``, wherever on it, to ``end``.

    In the arc's plane, with the middle of the chord as origin: via = (u, h), half the chord a; the centre is (0, k)
    with k = (u^2 + h^2 - a^2) / 2h. Three points on one line: half-way if via is between the others, else via itself,
    so that it is not mistaken for an arc. A start that is not known (NaN): via too.
    """
    centre, span = (start + end) / 2, end - start
    length = np.linalg.norm(span, axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        along = np.where(length[:, None] > 0, span / length[:, None], 0.0)
        u = np.einsum("ni,ni->n", via - centre, along)
        across = via - centre - u[:, None] * along
        h = np.linalg.norm(across, axis=1)
        a = length / 2
        k = (u * u + h * h - a * a) / (2 * h)
        radius = np.hypot(a, k)
        # The same number twice: the one for the short way does not lose digits for very flat arcs.
        height = np.where(k < 0, a * a / (radius - k), radius + k)
        flat = h < 1e-9 * a
        middle = centre + np.where(flat, 0.0, height / h)[:, None] * across
    unknown = np.isnan(start).any(axis=1) | (flat & (np.abs(u) > a * (1 - 1e-9))) | ((a == 0) & (h == 0))
    return np.where(unknown[:, None], via, middle)


def _turns(a: list[FloatArray], b: list[FloatArray]) -> FloatArray:
    """``pose.angle_between`` by row (M,), rad. Each pair of arrays is looked at once: programs share rotations."""
    seen: dict[tuple[int, int], int] = {}
    index = [seen.setdefault(pair, len(seen)) for pair in zip(map(id, a), map(id, b), strict=True)]
    if not index:
        return np.zeros(0)
    first = np.unique(index, return_index=True)[1].tolist()
    p, q = (np.concatenate([side[i] for i in first]).reshape(-1, 3, 3) for side in (a, b))
    turn = np.einsum("nji,njk->nik", p, q)
    skew = turn - np.transpose(turn, (0, 2, 1))
    # The entries of the skew part are 2 sin(angle) times the axis, each twice; the trace is 1 + 2 cos(angle).
    sine = np.sqrt(np.einsum("nij,nij->n", skew, skew) / 2)
    angles: FloatArray = np.arctan2(sine, np.einsum("nii->n", turn) - 1)[index]
    return angles


def _manners(moves: _Group, to_poses: _Group, tolerance: Tolerance, carries: frozenset[str]) -> Iterator[_Column]:
    """How motions are made: orientation, joints, speed, blend, force."""
    if "orientation" in carries:
        a, b = (list(map(attrgetter("target.rotation"), side)) for side in (to_poses.planned, to_poses.read))
        yield _Column("orientation", to_poses.places, a, b, _turns(a, b), tolerance.angle)
    jointed = moves.where(~posed(moves.planned))
    a, b = ([item.target.values for item in side] for side in (jointed.planned, jointed.read))
    error = np.array([np.abs(np.subtract(p, q)).max(initial=0.0) for p, q in zip(a, b, strict=True)])
    yield _Column("joint values", jointed.places, a, b, error, tolerance.joint)
    rapid = are(moves.planned, MoveJ)
    linear = moves.where(~rapid)
    if "joint-speed" in carries:
        yield moves.where(rapid).column("speed", "speed", tolerance.speed)
    if "speed" in carries:
        yield linear.column("speed", "speed", tolerance.speed)
    if "blend" in carries:
        yield moves.column("blend", "blend", tolerance.mm)
    if "stop" in carries:
        p, q = (numbers(side, "blend", 1) for side in (moves.planned, moves.read))
        yield _Column("blend", moves.places, p, q, ((p > 0) != (q > 0))[:, 0] * 1.0, 0.0)
    yield from _forces(linear, "force", tolerance, carries)


def _forces(group: _Group, name: str, tolerance: Tolerance, carries: frozenset[str]) -> Iterator[_Column]:
    """Newtons, and their direction: a text gives it by components, so each may be off by both tolerances."""
    newtons = group.column("force", name, tolerance.force)
    yield newtons
    if "force-direction" in carries and np.any(newtons.planned):
        a = np.asarray(newtons.planned) * numbers(group.planned, "press", 3)
        b = np.asarray(newtons.read) * numbers(group.read, "press", 3)
        limit = tolerance.force + tolerance.angle * np.asarray(newtons.planned)[:, 0]
        yield _Column("force along x y z", group.places, a, b, np.abs(a - b).max(axis=1), limit)


def _others(both: _Group, tolerance: Tolerance, carries: frozenset[str]) -> Iterator[_Column]:
    """Outputs, waits and force control."""
    outputs, waits, forces = (both.where(are(both.planned, kind)) for kind in (Output, Wait, Force))
    yield outputs.column("output", "value", _VALUE)
    yield waits.column("wait", "seconds", tolerance.seconds)
    yield from _forces(forces, "newtons", tolerance, carries)
