"""Checks a prepared program: which changes `Post.prepare` may make.

The comparison holds the text against the prepared program, so a mistake of the preparation is in
both. `check_preparation` finds it. These rules hold for the two bodies:

* A motion keeps kind, target, orientation, speed, path, work, force, joint values, posture, share
  and speed of turning. Its blend may only become smaller.
* An arc may become several arcs and lines that lead along it, in its sense, within `chord`. A line
  may become several lines on it. The last one keeps the target and all that the motion had.
* Outputs, waits, tool changes and stops keep their values, their order and the motions between
  which they stand. Each motion has the same force change in force.
* Frames, name and paths stay. Comments do not count.

A post lists any other change that an option of it makes by a word of `CHANGES`.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from operator import eq
from typing import Any, NamedTuple

import numpy as np
from msgspec import Struct
from msgspec.structs import astuple, replace
from numpy.typing import NDArray

from camgen.geometry.ragged import list_owners, mark_run_ends, mark_run_starts, number_rows
from camgen.geometry.rotations import measure_angles_between
from camgen.geometry.vectors import cross, measure_lengths, multiply_rows
from camgen.model.errors import VerifyError
from camgen.model.pose import FloatArray, Pose
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
    read_numbers,
)
from camgen.model.sequences import take_rows

#: What an option may let a preparation change, with the words of the summary where the comparison
#: then says nothing about it. Cycles change no way, so they have no words.
CHANGES: Mapping[str, str] = {
    "force": "forces, which an option leaves out or turns into an output",
    "spindle": "the speed of the spindle, which an option only switches",
    "cycles": "",
}
#: Places in a table of rotations, -1 for joint values.
Places = NDArray[np.int32]
#: Points nearer than this to an arc or a line are on it, mm. It is far above the rounding of double
#: precision at coordinates of 10 m and far below a printed digit.
_ON_CURVE = 1e-6
#: rad. The same for orientations and directions.
_ON_TURN = 1e-6
#: Added to `chord`, relative: a pass that fills the whole of it may exceed it by rounding.
_FULL = 1e-6
#: Weights that turn an end into one number. They have no common measure, so that two ends of a
#: program have the same number only by an accident of the last digits.
_WEIGHTS = (1.0, 0.7320508075688772, 0.2360679774997898)
#: Arcs that are checked at a time.
_BLOCK = 4096
REMEDY = "do not run the program: prepare of its post is wrong"


class _Fault(NamedTuple):
    """The first motion that breaks a rule: its row among the motions before, and what happens."""

    row: int
    what: str


class _Side(Struct, frozen=True, eq=False):
    """The motions of one body.

    columns: columns of the body, M motions.
    rows: (K,) numbers of the motions that are compared; each other one is the beginning of the next
        motion, straight up or down.
    speed: (M,) mm/s; infinite where a cycle moves at the speed of travel.
    vertical: (M,) motions straight up or down that a cycle may hold; none without cycles.
    """

    columns: Columns
    rows: Indices
    speed: FloatArray
    vertical: Mask

    def index(self, row: int) -> int:
        """The place of a compared motion in the body."""
        return int(self.columns.at[self.rows[row]])


class _Match(Struct, frozen=True, eq=False):
    """Which motions after stand for which before.

    before, after: the bodies.
    last: (K,) by row before, the row after that ends there; fewer than K where a motion is missing.
    owner: (L,) by row after, up to the last that is matched, the row before that it belongs to.
    """

    before: _Side
    after: _Side
    last: Indices
    owner: Indices

    @property
    def count(self) -> Indices:
        """Number of motions that stand for each row before."""
        return np.diff(self.last, prepend=-1)

    @property
    def rows(self) -> Indices:
        """The motions before, by number, as far as they are matched."""
        return self.before.rows[: len(self.last)]

    @property
    def ends(self) -> Indices:
        """The motions after, by number, that end where these do."""
        return self.after.rows[self.last]

    @property
    def pieces(self) -> Indices:
        """The motions after, by number, up to the last that is matched."""
        return self.after.rows[: len(self.owner)]


def check_preparation(
    before: Program, after: Program, chord: float, allowed: frozenset[str] = frozenset()
) -> None:
    """Checks a program that `Post.prepare` returned against the one that it was given.

    chord: mm that a replacement may deviate.
    allowed: words of `CHANGES` (`Post.list_changed`).

    Raises VerifyError for the first instruction of `before` that is changed against the rules.
    """
    if after is before:
        return
    for what, a, b in (
        ("the work frame", before.base_from_work, after.base_from_work),
        ("the tool frame", before.flange_from_tool, after.flange_from_tool),
    ):
        if not _are_same_poses(a, b):
            raise VerifyError(before.name, f"the preparation changes {what}", 0, REMEDY)
    if (before.name, before.paths) != (after.name, after.paths):
        raise VerifyError(before.name, "the preparation changes the name or the paths", 0, REMEDY)
    if after.body is before.body:
        return
    cycles = "cycles" in allowed
    match = _match(_make_side(before.columns, cycles), _make_side(after.columns, cycles))
    faults = [(match.before.index(row), what) for row, what in _find_faults(match, chord, allowed)]
    faults += _find_switches(match, allowed)
    if faults:
        index, what = min(faults)
        raise VerifyError(before.name, f"instruction {index}: {what}", 0, REMEDY)


def _make_side(columns: Columns, cycles: bool) -> _Side:
    count = len(columns.at)
    if not cycles or count < 2:
        return _Side(columns, np.arange(count), columns.speed, np.zeros(count, np.bool_))
    step = np.diff(columns.ends, axis=0, prepend=np.full((1, 3), np.nan))
    vertical = (step[:, 0] == 0) & (step[:, 1] == 0) & ~columns.moves_are(MoveC)
    joint = columns.moves_are(MoveJ)
    # The speed of travel is that of the last joint motion. The first motion is one.
    travel = columns.speed[np.maximum.accumulate(np.where(joint, np.arange(count), 0))]
    speed = np.where(vertical & (joint | (columns.speed == travel)), np.inf, columns.speed)
    rank = np.cumsum(~columns.are(Comment))[columns.at]
    goes_on = vertical[:-1] & vertical[1:] & (np.diff(rank) == 1)
    goes_on &= (speed[1:] == speed[:-1]) & (step[1:, 2] * step[:-1, 2] >= 0)
    return _Side(columns, np.flatnonzero(~np.append(goes_on, False)), speed, vertical)


def _match(before: _Side, after: _Side) -> _Match:
    """Each motion before with the next motion after that ends at the same point."""
    wanted, ends = _number_ends(before), _number_ends(after)
    if len(wanted) == len(ends) and np.array_equal(wanted, ends):
        rows = np.arange(len(wanted))
        return _Match(before, after, rows, rows)
    find = ends.tolist().index
    last: list[int] = []
    place = -1
    try:
        for end in wanted.tolist():
            place = find(end, place + 1)
            last.append(place)
    except ValueError:
        pass  # the first motion that is missing ends the match
    matched = np.array(last, np.intp)
    owner = np.repeat(np.arange(len(matched)), np.diff(matched, prepend=-1))
    return _Match(before, after, matched, owner)


def _number_ends(side: _Side) -> FloatArray:
    """(K,): a number for each end, the same for the same point; infinite for joint values."""
    x, y, z = side.columns.ends[side.rows].T
    mixed = x * _WEIGHTS[0] + y * _WEIGHTS[1] + z * _WEIGHTS[2]
    mixed[np.isnan(mixed)] = np.inf
    return np.asarray(mixed)


def _find_faults(match: _Match, chord: float, allowed: frozenset[str]) -> Iterator[_Fault]:
    if len(match.last) < len(match.before.rows):
        yield _Fault(len(match.last), "the preparation loses this motion")
    elif len(match.owner) < len(match.after.rows):
        yield _Fault(max(len(match.last) - 1, 0), "the preparation adds motions after this one")
    if not len(match.last):
        return
    yield from _compare_columns(match)
    yield from _compare_forces(match, allowed)
    yield from _compare_special(match)
    yield from _check_curves(match, chord)


def _first(mask: Mask, rows: Indices | None, what: str) -> Iterator[_Fault]:
    """The first row where `mask` holds. rows: the row of each element; None: its place."""
    places = np.flatnonzero(mask)[:1]
    for row in (places if rows is None else rows[places]).tolist():
        yield _Fault(row, f"the preparation {what}")


def _compare_columns(match: _Match) -> Iterator[_Fault]:
    """Targets, orientations, blends, speeds, paths and kinds."""
    old, new = match.before, match.after
    a, b = old.columns, new.columns
    rows, ends, pieces, owner = match.rows, match.ends, match.pieces, match.owner
    changed = ~((a.ends[rows] == b.ends[ends]).all(axis=1) | ~a.posed[rows] & ~b.posed[ends])
    yield from _first(changed, None, "changes the target")
    different = ~_are_same_rotations(a.table, a.rotation[rows], b.table, b.rotation[ends])
    yield from _first(different, None, "changes the orientation")
    yield from _first(b.blend[ends] > a.blend[rows], None, "blends wider")
    owners = rows[owner]
    yield from _first(old.speed[owners] != new.speed[pieces], owner, "changes the speed")
    # All strokes of a cycle belong to its path, and work where they feed. Rapid strokes are joint
    # motions.
    stroke = old.vertical[owners] & new.vertical[pieces]
    for what, x, y in (
        ("changes the path", a.path, b.path),
        ("changes whether the motion works", a.works, b.works),
    ):
        yield from _first((x[owners] != y[pieces]) & ~stroke, owner, what)
    kinds, new_kinds = a.kinds[owners], b.kinds[pieces]
    arc = a.moves_are(MoveC)[owners]
    line = b.moves_are(MoveL)[pieces]
    yield from _first((kinds != new_kinds) & ~(arc & line) & ~stroke, owner, "changes the kind")
    several = (match.count > 1) & a.moves_are(MoveJ)[rows]
    yield from _first(several, None, "replaces a joint motion by several")


def _compare_forces(match: _Match, allowed: frozenset[str]) -> Iterator[_Fault]:
    """Forces and their directions. Inner pieces of an arc have their own direction."""
    a, b = match.before.columns, match.after.columns
    rows, ends, pieces, owner = match.rows, match.ends, match.pieces, match.owner
    if not (np.any(a.force) or np.any(b.force)):
        return
    force = a.force[rows[owner]]
    free = ("force" in allowed) & (b.force[pieces] == 0)
    yield from _first((b.force[pieces] != force) & ~free, owner, "changes the force")
    turned = (a.force_direction[rows] != b.force_direction[ends]).any(axis=1)
    yield from _first(turned & ~free[match.last], None, "changes the direction of the force")
    inner = np.ones(len(owner), np.bool_)
    inner[match.last] = False
    inner &= ~free & (force != 0)
    yield from _first(
        ~_are_pressed(match, np.flatnonzero(inner)),
        owner[inner],
        "changes the direction of the force inside an arc",
    )


def _are_pressed(match: _Match, places: Indices) -> Mask:
    """(P,): which pieces press as their arc does: along the tool axis, or turned with the arc.

    places: (P,) among `match.pieces`, inside of arcs.
    """
    a, b = match.before.columns, match.after.columns
    rows, pieces = match.rows[match.owner[places]], match.pieces[places]
    press, wanted = b.force_direction[pieces], a.force_direction[rows]
    sound = np.zeros(len(places), np.bool_)
    arcs = np.flatnonzero(a.moves_are(MoveC)[rows])
    lines = a.moves_are(MoveL)[rows]
    sound[lines] = (press[lines] == wanted[lines]).all(axis=1)
    circle = _make_circles(a, rows[arcs])
    turned = circle.turn(wanted[arcs], -(circle.sweep - circle.measure(b.ends[pieces[arcs]])))
    along = np.reshape(take_rows(b.table, b.rotation[pieces[arcs]].tolist()), (-1, 3, 3))[:, :, 2]
    deviation = np.minimum(
        measure_lengths(press[arcs] - turned), measure_lengths(press[arcs] - along)
    )
    sound[arcs] = deviation <= _ON_TURN
    return sound


def _compare_special(match: _Match) -> Iterator[_Fault]:
    a, b = match.before.columns, match.after.columns
    rows, ends = match.rows, match.ends
    yield from _first(a.share[rows] != b.share[ends], None, "changes the share of the speeds")
    yield from _first(a.rate[rows] != b.rate[ends], None, "changes the speed of a joint")
    yield from _first(a.turn[rows] != b.turn[ends], None, "changes the speed of turning")
    special = np.zeros(len(a.at), np.bool_)
    special[a.special[0]] = True
    other = np.zeros(len(b.at), np.bool_)
    other[b.special[0]] = True
    both = np.flatnonzero(special[rows] | other[ends])
    planned, prepared = a.pick(a.at[rows[both]]), b.pick(b.at[ends[both]])
    wrong = [
        p is not q and _list_joints(p) != _list_joints(q)
        for p, q in zip(planned, prepared, strict=True)
    ]
    yield from _first(np.array(wrong, np.bool_), both, "changes joint values or the posture")
    other[ends] = False
    inner = np.flatnonzero(other[match.pieces])
    stated = [
        any(_list_joints(motion)[:2]) or getattr(motion, "turn", 0.0) != 0
        for motion in b.pick(b.at[match.pieces[inner]])
    ]
    yield from _first(
        np.array(stated, np.bool_),
        match.owner[inner],
        "states joint values or a speed of turning inside of a motion",
    )


def _list_joints(motion: Any) -> tuple[object, object, object]:
    target = motion.target if isinstance(motion.target, Joints) else None
    return motion.joints, motion.posture, target


# Arcs and lines that are replaced.


class _Circles(Struct, frozen=True, eq=False):
    """The circles of N arcs.

    centre: (N, 3) mm.
    axis: (N, 3) unit vector; the arcs turn counter-clockwise about it.
    start: (N, 3) from the centre to where the arc starts, mm.
    radius: (N,) mm.
    sweep: (N,) rad, more than 0.
    """

    centre: FloatArray
    axis: FloatArray
    start: FloatArray
    radius: FloatArray
    sweep: FloatArray

    def take(self, rows: Indices) -> _Circles:
        """The circles of these rows."""
        return _Circles(*(column[rows] for column in astuple(self)))

    def measure(self, points: FloatArray) -> FloatArray:
        """(N,): the angle from the start to points (N, 3), rad, from -pi/2 on.

        A point at the start has the angle 0, or a little less by rounding.
        """
        angle = _measure_angles(self.axis, self.start, points - self.centre)
        return np.where(angle > 1.5 * np.pi, angle - 2 * np.pi, angle)

    def leave(self, points: FloatArray) -> FloatArray:
        """(N,): the distance of points (N, 3) from the circle, mm."""
        arm = points - self.centre
        out = multiply_rows(arm, self.axis)
        return np.hypot(out, measure_lengths(arm - out[:, None] * self.axis) - self.radius)

    def turn(self, vectors: FloatArray, angle: FloatArray) -> FloatArray:
        """Vectors (N, 3) turned about the axes by angles (N,), rad."""
        c, s = np.cos(angle)[:, None], np.sin(angle)[:, None]
        along = multiply_rows(vectors, self.axis)[:, None] * self.axis
        return np.asarray(along + c * (vectors - along) + s * cross(self.axis, vectors))


def _make_circles(columns: Columns, arcs: Indices) -> _Circles:
    """The circles of motions that are arcs. Not a number where the three points are on a line."""
    start, via, end = columns.ends[arcs - 1], columns.vias_of(arcs), columns.ends[arcs]
    u, w = via - start, end - start
    normal = cross(u, w)
    square = multiply_rows(normal, normal)
    with np.errstate(divide="ignore", invalid="ignore"):
        uu, ww = multiply_rows(u, u)[:, None], multiply_rows(w, w)[:, None]
        to_centre = (uu * cross(w, normal) + ww * cross(normal, u)) / (2 * square)[:, None]
        axis = normal / np.sqrt(square)[:, None]
    sweep = _measure_angles(axis, -to_centre, w - to_centre)
    return _Circles(start + to_centre, axis, -to_centre, measure_lengths(to_centre), sweep)


def _measure_angles(axis: FloatArray, a: FloatArray, b: FloatArray) -> FloatArray:
    """(N,): the angles from vectors a to b about the axes, rad, 0 to 2 pi."""
    return np.arctan2(multiply_rows(axis, cross(a, b)), multiply_rows(a, b)) % (2 * np.pi)


def _check_curves(match: _Match, chord: float) -> Iterator[_Fault]:
    a, b = match.before.columns, match.after.columns
    rows, ends = match.rows, match.ends
    replaced = match.count > 1
    arc = a.moves_are(MoveC)[rows]
    stays = arc & ~replaced & b.moves_are(MoveC)[ends]
    both = np.flatnonzero(stays)
    old, new = np.searchsorted(a.arcs, rows[both]), np.searchsorted(b.arcs, ends[both])
    turned = ~_are_same_rotations(a.table, a.via_rotation[old], b.table, b.via_rotation[new])
    moved = (a.via[old] != b.via[new]).any(axis=1)
    yield from _first(turned & ~moved, both, "changes the orientation inside an arc")
    stays[both[moved]] = False
    arcs = np.flatnonzero(arc & ~stays)
    for low in range(0, len(arcs), _BLOCK):
        yield from _check_arcs(match, arcs[low : low + _BLOCK], chord)
    yield from _check_lines(match, np.flatnonzero(replaced & a.moves_are(MoveL)[rows]))


def _list_pieces(match: _Match, rows: Indices) -> tuple[Indices, Indices]:
    """The pieces that stand for `rows`: for each the place of its row in `rows`, and its motion."""
    count = match.count[rows]
    which = list_owners(count)
    return which, match.pieces[number_rows(count) + (match.last[rows] - count + 1)[which]]


def _check_arcs(match: _Match, rows: Indices, chord: float) -> Iterator[_Fault]:
    """Arcs before that are replaced: each piece leads on along its arc and stays within `chord`."""
    a, b = match.before.columns, match.after.columns
    circles = _make_circles(a, match.rows[rows])
    which, pieces = _list_pieces(match, rows)
    owner, circle = rows[which], circles.take(which)
    angle = circle.measure(b.ends[pieces])
    is_last = mark_run_ends(which)
    angle[is_last] = circles.sweep
    begin = np.append(0.0, angle[:-1])
    begin[mark_run_starts(which)] = 0.0
    slack = _ON_CURVE / np.maximum(circle.radius, _ON_CURVE)
    yield from _first(~(angle >= begin - slack), owner, "runs back along an arc")
    # A chord leaves its arc most half-way, by the sagitta, and no more than its ends besides.
    leaves = np.maximum(circle.leave(b.ends[pieces - 1]), circle.leave(b.ends[pieces]))
    leaves += circle.radius * (1 - np.cos((angle - begin) / 2))
    round_pieces = np.flatnonzero(b.moves_are(MoveC)[pieces])
    leaves[round_pieces] = _leave_arcs(match, circle, pieces, round_pieces, (begin, angle))
    wrong = ~(leaves <= chord * (1 + _FULL) + _ON_CURVE)
    yield from _first(wrong, owner, "leaves an arc by more than tolerance.chord")
    yield from _check_turns(match, owner, pieces, ~is_last)


def _leave_arcs(
    match: _Match,
    circle: _Circles,
    pieces: Indices,
    places: Indices,
    angles: tuple[FloatArray, FloatArray],
) -> FloatArray:
    """(P,): the deviation of pieces that are arcs, mm; infinite for one that runs another way.

    circle, pieces: circles and motion numbers of all pieces.
    places: (P,) places of the arcs among them.
    angles: angles at which all pieces begin and end on their arcs, rad.
    """
    columns = match.after.columns
    motions = pieces[places]
    circle = circle.take(places)
    begin, end = angles[0][places], angles[1][places]
    via = columns.vias_of(motions)
    piece = _make_circles(columns, motions)
    deviation = circle.leave(via)
    for share in (0.25, 0.75):
        point = piece.centre + piece.turn(piece.start, share * piece.sweep)
        deviation = np.maximum(deviation, circle.leave(point))
    angle = circle.measure(via)
    return np.where((angle > begin) & (angle < end), deviation, np.inf)


def _check_turns(match: _Match, owner: Indices, pieces: Indices, inner: Mask) -> Iterator[_Fault]:
    """The orientations inside of arcs: on the way from the start through the via point to the end.

    owner: (P,) row before of each piece of an arc.
    pieces: (P,) motion numbers.
    inner: (P,) pieces that do not end at the end of the arc.
    """
    a, b = match.before.columns, match.after.columns
    arcs = match.rows[owner]
    start, end = a.rotation[arcs - 1], a.rotation[arcs]
    via = a.via_rotation[np.searchsorted(a.arcs, arcs)]
    same = (start == end) & (via == end)
    inside = [(np.flatnonzero(inner), b.rotation[pieces[inner]])]
    round_pieces = np.flatnonzero(b.moves_are(MoveC)[pieces])
    inside.append((round_pieces, b.via_rotation[np.searchsorted(b.arcs, pieces[round_pieces])]))
    for which, turns in inside:
        known = _are_same_rotations(a.table, end[which], b.table, turns) & same[which]
        yield from _check_between(match, (start, via, end), which[~known], turns[~known], owner)


def _check_between(
    match: _Match,
    planned: tuple[Places, Places, Places],
    which: Indices,
    turns: Places,
    owner: Indices,
) -> Iterator[_Fault]:
    """Orientations inside of arcs that turn the tool.

    planned: (P,) places in the table before of the orientations of the arc of each piece: at its
        start, half-way, and at its end.
    which: (Q,) pieces that are checked.
    turns: (Q,) places of their orientations in the table after.
    owner: (P,) rows before.
    """
    if not len(which):
        return
    a, b = match.before.columns, match.after.columns
    if ((planned[0][which] < 0) | (turns < 0)).any():
        yield _Fault(int(owner[which].min()), "the preparation changes an arc to joint values")
        return
    start, via, end = (_stack(a.table, side[which]) for side in planned)
    turn = _stack(b.table, turns)
    longest = measure_angles_between(start, via) + measure_angles_between(via, end) + _ON_TURN
    taken = measure_angles_between(start, turn) + measure_angles_between(turn, end)
    yield from _first(~(taken <= longest), owner[which], "changes the orientation inside an arc")


def _check_lines(match: _Match, rows: Indices) -> Iterator[_Fault]:
    """Lines before that are replaced by several: each leads on along the line."""
    if not len(rows):
        return
    a, b = match.before.columns, match.after.columns
    which, pieces = _list_pieces(match, rows)
    motions = match.rows[rows]
    start = a.ends[motions - 1]
    line = a.ends[motions] - start
    length = np.maximum(measure_lengths(line), _ON_CURVE)
    direction = line / length[:, None]
    arm = b.ends[pieces] - start[which]
    along = multiply_rows(arm, direction[which])
    deviation = measure_lengths(arm - along[:, None] * direction[which])
    steps = np.diff(along, prepend=0.0)
    steps[mark_run_starts(which)] = 0.0
    sound = (deviation <= _ON_CURVE) & (steps >= -_ON_CURVE) & (along >= -_ON_CURVE)
    sound &= along <= length[which] + _ON_CURVE
    yield from _first(~sound, rows[which], "leaves a line")
    first, last = a.rotation[motions - 1][which], a.rotation[motions][which]
    turned = ~_are_same_rotations(a.table, last, b.table, b.rotation[pieces])
    inner = np.append(which[1:] == which[:-1], False)
    yield from _first(turned & inner & (first == last), rows[which], "turns the tool on a line")


# Outputs, waits, tool changes, stops and force changes.


class _Switches(NamedTuple):
    """The outputs, waits, tool changes and stops of a body, and its force changes.

    indices: (S,) places in the body.
    after: (S,) compared motions before each.
    items: themselves.
    force_after: (F,) compared motions before each force change.
    forces: (F + 1, 4) newtons and direction; the first row, of -1 N, is before any change.
    """

    indices: Indices
    after: Indices
    items: Sequence[Instruction]
    force_after: Indices
    forces: FloatArray


def _list_switches(side: _Side, allowed: frozenset[str]) -> _Switches:
    columns = side.columns
    where = ~columns.are(MoveJ, MoveL, MoveC, Comment, Force)
    if "force" in allowed:
        where &= ~columns.alike(Output, lambda item: item.signal == "force")
    indices, changes = np.flatnonzero(where), np.flatnonzero(columns.are(Force))
    items = columns.pick(indices)
    if "spindle" in allowed:
        items = [_switch(item) for item in items]
    forces: list[Any] = columns.pick(changes)
    values = np.zeros((len(forces) + 1, 4))
    values[0, 0] = -1.0
    values[1:, :1] = read_numbers(forces, "newtons")
    values[1:, 1:] = read_numbers(forces, "force_direction", 3)
    at = columns.at[side.rows]
    after, force_after = np.searchsorted(at, indices), np.searchsorted(at, changes)
    return _Switches(indices, after, items, force_after, values)


def _switch(item: Instruction) -> Instruction:
    if isinstance(item, Output) and item.signal == "spindle":
        return replace(item, value=float(item.value != 0))
    return item


def _find_switches(match: _Match, allowed: frozenset[str]) -> Iterator[tuple[int, str]]:
    """The first output, wait, tool change, stop or force change that is not as before.

    Gives its index in the body before.
    """
    old, new = _list_switches(match.before, allowed), _list_switches(match.after, allowed)
    size = min(len(old.items), len(new.items))
    # The places after the motions that are matched: those before any motion, and after each.
    places = np.append(0, match.last + 1)
    known = old.after[:size] < len(places)
    wanted = places[np.minimum(old.after[:size], len(places) - 1)]
    same = np.fromiter(map(eq, old.items[:size], new.items[:size]), np.bool_, size)
    wrong = np.flatnonzero(~same | known & (wanted != new.after[:size]))[:1].tolist()
    if wrong:
        yield int(old.indices[wrong[0]]), _describe_change(old.items[wrong[0]])
    elif len(old.items) > size:
        yield int(old.indices[size]), _describe_change(old.items[size])
    elif len(new.items) > size:
        yield len(match.before.columns.body), f"the preparation adds {_name(new.items[size])}"
    if "force" not in allowed:
        yield from _find_force_changes(match, old, new)


def _find_force_changes(match: _Match, old: _Switches, new: _Switches) -> Iterator[tuple[int, str]]:
    if len(old.forces) == len(new.forces) == 1:
        return
    owner = match.owner
    before = np.searchsorted(old.force_after, owner, side="right")
    after = np.searchsorted(new.force_after, np.arange(len(owner)), side="right")
    wrong = (old.forces[before] != new.forces[after]).any(axis=1)
    for row in owner[np.flatnonzero(wrong)[:1]].tolist():
        yield match.before.index(row), "the preparation changes the force control of this motion"
    if (old.forces[-1] != new.forces[-1]).any():
        index = len(match.before.columns.body) - 1
        yield index, "the preparation changes the force control at the end"


def _describe_change(item: Instruction) -> str:
    return f"the preparation changes, moves or loses {_name(item)}"


def _name(item: Instruction) -> str:
    if isinstance(item, Output):
        return f"the output {item.signal} = {item.value:g}"
    return f"a {type(item).__name__}"


# Rotations and poses.


def _are_same_rotations(
    first: Sequence[FloatArray], a: Places, second: Sequence[FloatArray], b: Places
) -> Mask:
    """(N,): which rotations are equal. a, b: (N,) places in the tables, -1 for joint values."""
    places = {id(rotation): place for place, rotation in enumerate(first)}
    known = [places.get(id(rotation), -2) for rotation in second]
    same = np.asarray(np.array([*known, -1], np.intp)[b] == a)
    for row in np.flatnonzero(~same).tolist():
        if a[row] >= 0 and b[row] >= 0:
            same[row] = np.array_equal(first[a[row]], second[b[row]])
    return same


def _stack(table: Sequence[FloatArray], places: Places) -> FloatArray:
    return np.stack(take_rows(table, places.tolist()))


def _are_same_poses(a: Pose, b: Pose) -> bool:
    return a is b or (a.origin == b.origin and np.array_equal(a.rotation, b.rotation))
