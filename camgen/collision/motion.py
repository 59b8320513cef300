"""A whole motion: sampled as finely as what moves and what is near ask for."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from msgspec import Struct

from camgen.collision.boxes import Boxes
from camgen.collision.hits import (
    ROWS,
    GrowthTable,
    Nearest,
    Tests,
    find_meetings,
    finite,
    hits,
    least_of_each,
    place,
    share_tests,
    tests_of,
)
from camgen.collision.pairs import Travel
from camgen.collision.scene import Scene
from camgen.geometry.ragged import offsets, owners, ramp
from camgen.model.part import BoolArray, IntArray
from camgen.model.pose import FloatArray

#: The longest stretches are 2 ** _HALVINGS steps.
_HALVINGS = 5
#: Stretches of more steps are long. If the middle of one collides, those after it are not examined.
_LONG = 2
#: Of the stretches of one length, so many are nearly all.
_MOST = 0.75
#: rad that joints may turn together between two places where it is worked out how far all has moved.
_CLOSE_TURN = 0.05
#: Of so many waypoints one is looked at first.
_SPARSE = 8


class MotionCheck(Struct, frozen=True):
    """What a motion meets. pair: of ``scene.pairs``, -1 if none. at: where the first hit is, in rows of the waypoints:
    2.25 is a quarter of the way from row 2 to row 3; nan if there is none. clearance: mm; 0 at a hit, ``near`` if
    nothing comes closer. nearest, nearest_at: the pair that comes as close as ``clearance`` and where, in rows; -1 and
    nan at a hit and if nothing comes closer.
    """

    pair: int
    at: float
    clearance: float
    nearest: int = -1
    nearest_at: float = math.nan

    @property
    def hit(self) -> bool:
        """Whether it meets anything."""
        return self.pair >= 0


def motion(
    scene: Scene, waypoints: FloatArray, step: float, near: float = 0.0, apart: float = 0.0
) -> MotionCheck:
    """The first hit of the motion through the configurations (K, J), rad or mm, or else how close it comes.

    Joints run evenly from row to row. apart: mm that any point of a body may be off that at most, as it is where the
    TCP runs along a line: a motion that is free is free with that too.

    A stretch of the motion is free where, at its middle, boxes grown by all that they move within it
    (``measure_moves``) and by ``near`` meet nothing: nothing happens in it that is not within these boxes. What is not
    free is divided, down to stretches in which no point moves by more than ``step`` (mm); these are tested at their
    middle as they are. So a hit that is not found is less than half a step and ``apart`` deep, twice that if both
    bodies move, and the clearance at any moment is no more than that below the one returned.
    """
    return motions(scene, [waypoints], step, near, apart)[0]


def motions(
    scene: Scene,
    several: Sequence[FloatArray],
    step: float,
    near: float | FloatArray = 0.0,
    apart: float = 0.0,
) -> list[MotionCheck]:
    """``motion`` of each of ``several``, together: in a fraction of the time where they are short. near: one for all or
    each (L,).
    """
    if not several:
        return []
    nears = np.broadcast_to(near, len(several))
    checks = _check(scene, several, step, nears, apart, is_hasty=True)
    left = [k for k, check in enumerate(checks) if check is None]
    if left:
        again = [several[k] for k in left]
        patient = _check(scene, again, step, nears[left], apart, is_hasty=False)
        for k, check in zip(left, patient, strict=True):
            checks[k] = check
    return [check for check in checks if check is not None]


def _check(
    scene: Scene,
    several: Sequence[FloatArray],
    step: float,
    near: FloatArray,
    deviation: float,
    *,
    is_hasty: bool,
) -> list[MotionCheck | None]:
    """The checks of ``motions``.

    near: (L,) mm, of each motion.
    deviation: mm that any point of a body may be off.
    is_hasty: whether a motion is examined only up to a place that is found early to collide. None
        for one in which no shortest stretch up to that place collides at its middle.
    """
    lines = _Lines.of(scene, [finite(waypoints) for waypoints in several])
    # What is as near at some of the waypoints bounds how near the rest need be looked at.
    nears = _bound(scene, [waypoints[::_SPARSE] for waypoints in several], near.tolist())
    distances = np.array([bound.distance for bound in nears])
    at, first, is_cut = _find_undecided(scene, lines, step, distances, deviation, is_hasty)
    rows = _rows(lines.waypoints, at)
    splits = first[1:-1]
    pairs = np.split(hits(scene, rows), splits)
    free = [
        bound.distance if (own < 0).all() else 0.0 for own, bound in zip(pairs, nears, strict=True)
    ]
    closer = _least(scene, np.split(rows, splits), np.where(is_cut, 0.0, free).tolist())
    places = np.split(at - np.repeat(lines.first[:-1], np.diff(first)), splits)
    checks = [_course(*one) for one in zip(places, pairs, nears, closer, strict=True)]
    # The last place of each motion is its end, which is beyond the place where a motion is cut.
    is_known = [not cut or (hit[:-1] >= 0).any() for cut, hit in zip(is_cut, pairs, strict=True)]
    return [check if known else None for check, known in zip(checks, is_known, strict=True)]


def _course(at: FloatArray, pairs: IntArray, bound: Nearest, closer: Nearest) -> MotionCheck:
    """What a motion meets at its undecided places ``at``, or how near it comes there or before, at some waypoints."""
    met = np.flatnonzero(pairs >= 0)
    if len(met):
        return MotionCheck(int(pairs[met[0]]), float(at[met[0]]), 0.0)
    if closer.pair >= 0:
        return MotionCheck(-1, math.nan, closer.distance, closer.pair, float(at[closer.row]))
    return MotionCheck(
        -1,
        math.nan,
        bound.distance,
        bound.pair,
        float(bound.row * _SPARSE) if bound.pair >= 0 else math.nan,
    )


def _bound(scene: Scene, several: Sequence[FloatArray], nears: Sequence[float]) -> list[Nearest]:
    """The least clearance of each of several tables of configurations, at most ``nears``; 0 where one collides."""
    if not any(nears):
        return [Nearest(0.0, -1, -1) for _ in several]
    struck = np.split(
        hits(scene, np.concatenate(several)) >= 0, np.cumsum([len(rows) for rows in several])[:-1]
    )
    return _least(
        scene,
        several,
        [0.0 if one.any() else near for one, near in zip(struck, nears, strict=True)],
    )


def _least(scene: Scene, several: Sequence[FloatArray], nears: Sequence[float]) -> list[Nearest]:
    """``least`` of each of several tables, rows counted in each; for those that are to be nearer than 0 nothing."""
    asked = [k for k, near in enumerate(nears) if near > 0]
    found = [Nearest(0.0, -1, -1) for _ in several]
    if asked:
        lengths = np.array([len(several[k]) for k in asked])
        joints = np.concatenate([several[k] for k in asked])
        measured = least_of_each(
            scene, joints, owners(lengths), np.array([nears[k] for k in asked])
        )
        for k, one, begin in zip(asked, measured, offsets(lengths).tolist(), strict=False):
            found[k] = Nearest(one.distance, one.row - begin, one.pair)
    return found


class _Lines(Struct, frozen=True, eq=False):
    """L motions, one after the other in each table; what changes from one to the next counts as nothing.

    waypoints: (K, J). first: (L + 1,) the first row of each among them, and K. numbers: (R,) places along them, in
    rows, between which joints turn by no more than ``_CLOSE_TURN``. ends: (L, 2) the first and the last of each. ways:
    (R, B) mm that any point of each box has moved at most up to there. way: (R,) the same of the box that moves most,
    with a gap between two motions. turned: (R, J) what the joints of the serial chain have turned or slid up to there,
    to and fro. closing: (J, P) mm per rad or mm of a joint by which two boxes of a pair come nearer at most.
    """

    waypoints: FloatArray
    first: IntArray
    numbers: FloatArray
    ends: IntArray
    ways: FloatArray
    way: FloatArray
    turned: FloatArray
    closing: FloatArray

    @classmethod
    def of(cls, scene: Scene, several: Sequence[FloatArray]) -> _Lines:
        """The motions through each of ``several`` (K, J)."""
        waypoints, first = np.concatenate(several), offsets([len(each) for each in several])
        numbers, seam = _finer(_angles(scene, waypoints), first)
        rows = _rows(waypoints, numbers)
        moves = measure_moves(scene, rows)
        moves[seam] = 0.0
        ways = np.vstack([np.zeros(len(scene.frame)), np.cumsum(moves, axis=0)])
        most = moves.max(axis=1, initial=0.0)
        most[seam] = 1.0
        way = np.append(0.0, np.cumsum(most))
        serial = rows @ scene.robot.coupling.T
        turns = np.abs(np.diff(serial, axis=0))
        turns[seam] = 0.0
        turned = np.vstack([np.zeros(serial.shape[1]), np.cumsum(turns, axis=0)])
        ends = np.column_stack([np.append(0, seam + 1), np.append(seam, len(numbers) - 1)])
        close = closing(scene, np.abs(serial).max(axis=0))
        return cls(waypoints, first, numbers, ends, ways, way, turned, close)


def _finer(angles: FloatArray, first: IntArray) -> tuple[FloatArray, IntArray]:
    """Places along the waypoints, in rows, between which joints turn by no more than ``_CLOSE_TURN``, for
    ``measure_moves`` is close there; and those of them after which the next motion begins. first: as of ``_Lines``.
    """
    parts = np.maximum(np.ceil(angles / _CLOSE_TURN), 1).astype(np.int64)
    parts[first[1:-1] - 1] = 1
    row = owners(parts)
    numbers = np.append(row + ramp(parts) / parts[row], float(len(parts)))
    return numbers, offsets(parts)[first[1:-1] - 1]


def _find_undecided(
    scene: Scene, lines: _Lines, step: float, nears: FloatArray, apart: float, is_hasty: bool
) -> tuple[FloatArray, IntArray, BoolArray]:
    """Where each motion must be tested as it is, in rows of all waypoints: its ends, and the middles of those stretches
    that are no longer than ``step`` and were never found free.

    Also returned are the first of each motion among these (L + 1,), and which motions (L,) were
    cut: if ``is_hasty``, no stretch is examined that begins beyond the middle of a long one that
    collides there.
    """
    start, stop = lines.way[lines.ends].T
    count = np.maximum(np.ceil((stop - start) / (step * 2**_HALVINGS)), 1).astype(np.int64)
    width = (stop - start) / count
    own = owners(count)
    begins = start[own] + ramp(count) * width[own]
    asked: Tests | None = None
    index = np.arange(len(lines.way), dtype=np.float64)
    found = [(np.repeat(np.arange(len(start)), 2), lines.numbers[lines.ends].ravel())]
    last = np.full(len(start), math.inf)
    while len(own):
        short = width[own] <= step
        middles = np.interp(begins[short] + width[own[short]] / 2, lines.way, lines.numbers)
        found.append((own[short], middles))
        long = ~short
        asked = None if asked is None else tests_of(asked, long)
        own, begins = own[long], begins[long]
        places = [
            np.interp(begins + width[own] * part, lines.way, index) for part in (0.0, 0.5, 1.0)
        ]
        grow, turned = (_most(table, places) for table in (lines.ways, lines.turned))
        rows = _rows(lines.waypoints, np.interp(places[1], index, lines.numbers))
        both = turned @ lines.closing + 2 * apart
        travel = Travel(turned, 2 * apart + nears[own])
        growth = GrowthTable(grow + apart, both, travel)
        row, test = find_meetings(scene, rows, growth, nears[own], asked)
        met = np.zeros(len(own), dtype=np.bool_)
        met[row] = True
        if is_hasty and (width > _LONG * step).any():
            # Most collisions are long, and only the first place of a motion matters.
            centres = begins + width[own] / 2
            tested = np.flatnonzero(met & (centres < last[own]))
            struck = tested[hits(scene, rows[tested]) >= 0]
            np.minimum.at(last, own[struck], centres[struck])
            met &= begins <= last[own]
        # Where nearly all are undecided so are most of their halves: quarters are looked at next.
        parts = 4 if met.sum() > _MOST * len(met) and (width[own] > 2 * step).all() else 2
        width = width / parts
        own = np.repeat(own[met], parts)
        begins = (begins[met][:, None] + width[own[::parts]][:, None] * np.arange(parts)).ravel()
        # Nothing happens in a part that does not happen in the whole.
        asked = share_tests(tests_of((row, test), met), parts)
    owner, at = (np.concatenate(column) for column in zip(*found, strict=True))
    order = np.lexsort((at, owner))
    first = offsets(np.bincount(owner, minlength=len(start)))
    return at[order], first, np.isfinite(last)


def _most(table: FloatArray, places: Sequence[FloatArray]) -> FloatArray:
    """How much columns that only grow change at most from the middle one of three places to the others."""
    before, here, after = (_rows(table, place) for place in places)
    return np.maximum(here - before, after - here)


def _rows(table: FloatArray, at: FloatArray) -> FloatArray:
    """``table`` (K, C) between its rows, at ``at`` (N,): (N, C)."""
    row = np.minimum(at.astype(np.int64), max(len(table) - 2, 0))
    part = (at - row)[:, None]
    return np.asarray(table[row] * (1 - part) + table[np.minimum(row + 1, len(table) - 1)] * part)


def measure_moves(scene: Scene, waypoints: FloatArray) -> FloatArray:
    """How long the way of any point of each box is at most from each row of (K, J) to the next: (K - 1, B), mm.

    A point's speed differs from its mean by no more than half of its greatest acceleration. The mean is no more than
    the way of the box's middle and of the ends of its axes. Two joints give no more than the product of their rates
    and the lever of one, so that half of what all give is no more than all angles times all rates with their levers.
    """
    straight = np.empty((len(waypoints) - 1, len(scene.frame)))
    for begin in range(0, len(straight), ROWS):
        placed = place(scene, waypoints[begin : begin + ROWS + 1])
        straight[begin : begin + ROWS] = _measure_ways(placed[:-1], placed[1:])
    serial = waypoints @ scene.robot.coupling.T
    angles = _angles(scene, waypoints)
    bent = angles[:, None] * (
        np.abs(np.diff(serial, axis=0)) @ levers(scene, np.abs(serial).max(axis=0))
    )
    return np.asarray(straight + bent)


def measure_apart(scene: Scene, one: FloatArray, other: FloatArray) -> FloatArray:
    """How far any point of a body is at most from where it is in another configuration: (N,) mm for each of (N, J)."""
    found = np.zeros(len(one))
    for begin in range(0, len(one), ROWS):
        rows = slice(begin, begin + ROWS)
        here, there = place(scene, one[rows]), place(scene, other[rows])
        found[rows] = _measure_ways(here, there).max(axis=1, initial=0.0)
    return found


def measure_closer(scene: Scene, one: FloatArray, other: FloatArray) -> FloatArray:
    """By how much two bodies of a pair may be nearer at most than they are in another configuration: (N,) mm for each
    of (N, J).

    Of a body and what stands it is what a point of the body is off (``measure_apart``). Of two that move it is that of
    one as the other sees it: what carries both along brings them no nearer.
    """
    both = scene.moving[scene.first] & scene.moving[scene.second]
    first, second = scene.first[both], scene.second[both]
    alone = np.zeros(len(scene.frame), dtype=np.bool_)
    alone[
        np.concatenate(
            [scene.first[~both], scene.second[~both], *(one.striking for one in scene.targets)]
        )
    ] = True
    found = np.zeros(len(one))
    for begin in range(0, len(one), ROWS):
        rows = slice(begin, begin + ROWS)
        placings = [place(scene, table[rows]) for table in (one, other)]
        beside = _measure_ways(*(placed[:, np.flatnonzero(alone)] for placed in placings))
        between = [
            _measure_ways(*(_seen_by(placed[:, a], placed[:, b]) for placed in placings))
            for a, b in ((first, second), (second, first))
        ]
        nearer = [ways.max(axis=1, initial=0.0) for ways in (beside, np.minimum(*between))]
        found[rows] = np.maximum(*nearer)
    return found


def _seen_by(boxes: Boxes, others: Boxes) -> Boxes:
    """Boxes (N, P) in the axes of others, about their middles."""
    back = np.swapaxes(others.axes, -1, -2)
    return Boxes(
        (back @ (boxes.centres - others.centres)[..., None])[..., 0], back @ boxes.axes, boxes.half
    )


def _measure_ways(here: Boxes, there: Boxes) -> FloatArray:
    """Mm (N, B) of the way straight from each box to the other: of its middle and of the ends of its axes."""
    moved, turned = there.centres - here.centres, there.axes - here.axes
    ways = np.sqrt(moved[..., 0] ** 2 + moved[..., 1] ** 2 + moved[..., 2] ** 2)
    for k in range(3):
        end = turned[..., k]
        ways += np.sqrt(end[..., 0] ** 2 + end[..., 1] ** 2 + end[..., 2] ** 2) * here.half[..., k]
    return np.asarray(ways)


def _angles(scene: Scene, waypoints: FloatArray) -> FloatArray:
    """The sum of what all turning joints turn from row to row (K - 1,), rad."""
    turning = np.array([not joint.sliding for joint in scene.robot.joints])
    return np.asarray(
        np.abs(np.diff(waypoints @ scene.robot.coupling.T, axis=0))[:, turning].sum(axis=1)
    )


def levers(scene: Scene, travel: FloatArray) -> FloatArray:
    """How far any point of a box moves at most per rad or mm of a joint (J, B): its distance from the joint's origin,
    for which the lengths of the chain are added up. travel: (J,) the farthest that each joint is from 0.
    """
    joints = scene.robot.joints
    found = np.zeros((len(joints), len(scene.frame)))
    far = np.linalg.norm(scene.origin, axis=1) + np.linalg.norm(scene.half, axis=1)
    for k in reversed(range(len(joints))):
        beyond = scene.frame > k
        found[k, beyond] = 1.0 if joints[k].sliding else far[beyond]
        far[beyond] += (
            math.hypot(*joints[k].previous_from_joint.origin) + joints[k].sliding * travel[k]
        )
    return found


def closing(scene: Scene, travel: FloatArray) -> FloatArray:
    """By how much two boxes of a pair come nearer at most per rad or mm of a joint (J, P): by what the joints between
    their links do to the farther one; where meshes decide, the meshes. travel: as for ``levers``.
    """
    one, other = scene.frame[scene.first], scene.frame[scene.second]
    low, high = np.minimum(one, other), np.maximum(one, other)
    lever = levers(scene, travel)[:, np.where(one > other, scene.first, scene.second)]
    joint = np.arange(len(lever))[:, None]
    approach = np.where((joint >= low) & (joint < high), lever, 0.0)
    for number, closer in enumerate(scene.closer):
        if closer is not None:
            between = np.ix_(closer.joints, np.flatnonzero(scene.of_pair == number))
            approach[between] = np.minimum(approach[between], closer.levers[:, None])
    return approach
