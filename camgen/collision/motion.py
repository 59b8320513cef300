"""Tests whole motions for collisions, with samples as dense as moving bodies and obstacles need.

Every sample tests boxes that are large enough to cover a stretch of the motion, so nothing between
two samples is missed.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial

import numpy as np
from msgspec import Struct

from camgen.collision.boxes import Boxes
from camgen.collision.hits import (
    ROWS,
    GrowthTable,
    Nearest,
    Tests,
    check_finite,
    divide_tests,
    find_collisions,
    find_meetings,
    find_nearest_pairs,
    place_at,
    place_boxes,
    select_tests,
)
from camgen.collision.pairs import Travel
from camgen.collision.scene import Scene
from camgen.geometry.ragged import compute_offsets, count_rows, list_owners, number_rows
from camgen.geometry.vectors import measure_lengths
from camgen.model.part import BoolArray, IntArray
from camgen.model.pose import FloatArray
from camgen.robots.kinematics.forward import compute_link_frames
from camgen.robots.models import Robot

#: The longest stretches are 2 ** _HALVINGS steps.
_HALVINGS = 5
#: Stretches of more steps are long. If the middle of one collides, those after it are not examined.
_LONG = 2
#: Fraction of the stretches of one length from which nearly all of them are undecided.
_NEARLY_ALL = 0.75
#: Sum of the angles of all joints between two places at which positions are computed, rad.
_CLOSE_TURN = 0.05
#: Every n-th waypoint is measured first.
_SPARSE = 8
#: Start, middle and end of a stretch, as fractions of it.
_START_MIDDLE_END = np.array([[0.0], [0.5], [1.0]])


class SceneTest(Struct, frozen=True, eq=False):
    """A scene in which motions are tested.

    step: largest distance that a point moves between two exact tests, mm.
    near: clearance up to which distances are measured, mm, one for all or one for each motion (L,).
    """

    scene: Scene
    step: float
    near: float | FloatArray = 0.0


class MotionCheck(Struct, frozen=True):
    """The first collision of a motion, or its clearance.

    pair: index in `scene.pairs` of the pair that collides, -1 for none.
    at: place of the first collision in rows of the waypoints, nan for none: 2.25 is a quarter of
        the way from row 2 to row 3.
    clearance: mm; 0 at a collision, `near` if nothing comes closer.
    nearest: index in `scene.pairs` of the pair that comes as close as `clearance`, -1 at a
        collision and if nothing comes closer than `near`.
    nearest_at: its place in rows of the waypoints, otherwise nan.
    """

    pair: int
    at: float
    clearance: float
    nearest: int = -1
    nearest_at: float = math.nan

    @property
    def hit(self) -> bool:
        """Whether the motion collides."""
        return self.pair >= 0


def check_motion(
    scene: Scene, waypoints: FloatArray, step: float, near: float = 0.0, deviation: float = 0.0
) -> MotionCheck:
    """The first collision of a motion, or its clearance.

    waypoints: (K, J) joint values, rad or mm, between which joints are interpolated linearly.
    step: largest distance that a point moves between two exact tests, mm.
    near: clearance up to which distances are measured, mm.
    deviation: distance by which any point of a body may be elsewhere, mm, for example because the
        TCP follows a line. A motion that is free is free with that too.

    A stretch of the motion is free if the boxes at its middle, grown by all that they move within
    it (`measure_moves`) and by `near`, meet nothing. Other stretches are divided until no point
    moves by more than `step`. These are tested at their middle as they are. So a collision that is
    missed is less deep than half a step and `deviation`, or twice that if both bodies move. The
    clearance at any moment is lower than the one returned by no more than that.
    """
    return check_motions(scene, [waypoints], step, near, deviation)[0]


def check_motions(
    scene: Scene,
    several: Sequence[FloatArray],
    step: float,
    near: float | FloatArray = 0.0,
    deviation: float = 0.0,
) -> list[MotionCheck]:
    """`check_motion` of each of L motions, in a fraction of the time if they are short.

    near: mm, one for all or one for each (L,).
    """
    return check_in_scenes([SceneTest(scene, step, near)], several, deviation)[0]


def check_in_scenes(
    tests: Sequence[SceneTest], several: Sequence[FloatArray], deviation: float = 0.0
) -> list[list[MotionCheck]]:
    """`check_motions` in several scenes of one arm, whose links are placed once for all of them."""
    if not several:
        return [[] for _ in tests]
    results = []
    lines_of_scenes = _Lines.make([test.scene for test in tests], several)
    for test, lines in zip(tests, lines_of_scenes, strict=True):
        nears = np.broadcast_to(test.near, len(several))
        checks, is_known = _check(test, lines, several, nears, deviation, is_hasty=True)
        unknown = np.flatnonzero(~is_known).tolist()
        if unknown:
            again = [several[k] for k in unknown]
            whole = _Lines.make([test.scene], again)[0]
            patient, _ = _check(test, whole, again, nears[unknown], deviation, is_hasty=False)
            for k, check in zip(unknown, patient, strict=True):
                checks[k] = check
        results.append(checks)
    return results


def _check(
    test: SceneTest,
    lines: _Lines,
    several: Sequence[FloatArray],
    near: FloatArray,
    deviation: float,
    *,
    is_hasty: bool,
) -> tuple[list[MotionCheck], BoolArray]:
    """The checks of `check_motions`, and which of them are final (L,).

    near: (L,) mm, of each motion.
    is_hasty: whether a motion is examined only up to a place that is found early to collide. Its
        check is not final if no shortest stretch up to that place collides at its middle.
    """
    scene, step = test.scene, test.step
    # The clearance at some waypoints is a limit for all others.
    sparse = _measure_sparse(scene, [waypoints[::_SPARSE] for waypoints in several], near)
    at, first, is_cut = _find_undecided(scene, lines, step, sparse.distance, deviation, is_hasty)
    rows = _interpolate(lines.waypoints, at)
    pairs, splits = find_collisions(scene, rows), first[1:-1]
    is_found = is_cut | np.logical_or.reduceat(pairs >= 0, first[:-1])
    limits = np.where(is_found, 0.0, sparse.distance)
    closer = _find_nearest(scene, rows, first, limits)
    places = np.split(at - np.repeat(lines.first[:-1], np.diff(first)), splits)
    make_check = partial(_make_check, sparse, closer)
    checks = list(map(make_check, range(len(several)), places, np.split(pairs, splits)))
    # The last place of each motion is its end, which is beyond the place where a motion is cut.
    is_before_end = np.arange(len(pairs)) < np.repeat(first[1:] - 1, np.diff(first))
    return checks, ~is_cut | np.logical_or.reduceat((pairs >= 0) & is_before_end, first[:-1])


def _make_check(
    sparse: Nearest, closer: Nearest, number: int, at: FloatArray, pairs: IntArray
) -> MotionCheck:
    """The check of one motion.

    sparse: nearest pairs at some waypoints of each motion.
    closer: nearest pairs at the undecided places, where they are nearer than that.
    number: index of the motion.
    at, pairs: undecided places, and the pair that collides at each, -1 for none.
    """
    colliding = np.flatnonzero(pairs >= 0)
    if len(colliding):
        return MotionCheck(int(pairs[colliding[0]]), float(at[colliding[0]]), 0.0)
    nearest, place = sparse, math.nan
    if closer.pair[number] >= 0:
        nearest, place = closer, float(at[closer.row[number]])
    elif sparse.pair[number] >= 0:
        place = float(sparse.row[number] * _SPARSE)
    pair, clearance = int(nearest.pair[number]), float(nearest.distance[number])
    return MotionCheck(-1, math.nan, clearance, pair, place)


def _measure_sparse(scene: Scene, several: Sequence[FloatArray], nears: FloatArray) -> Nearest:
    """The smallest clearance in each table of joint values, at most `nears`; 0 at a collision."""
    joints, first = np.concatenate(several), compute_offsets(count_rows(several))
    if nears.any():
        hits = find_collisions(scene, joints) >= 0
        nears = np.where(np.logical_or.reduceat(hits, first[:-1]), 0.0, nears)
    return _find_nearest(scene, joints, first, nears)


def _find_nearest(scene: Scene, joints: FloatArray, first: IntArray, nears: FloatArray) -> Nearest:
    """`find_nearest_pairs` of L motions; 0 for a motion whose `near` is not above 0.

    Rows of the result count from the first one of the motion.

    joints: (N, J).
    first: (L + 1,) the first row of each motion, and N.
    """
    owner = list_owners(np.diff(first))
    rows = np.flatnonzero(nears[owner] > 0)
    nearest = find_nearest_pairs(scene, joints[rows], owner[rows], nears)
    known = np.flatnonzero(nearest.pair >= 0)
    nearest.row[known] = rows[nearest.row[known]] - first[known]
    return nearest


class _Lines(Struct, frozen=True, eq=False):
    """L motions, one after the other. Nothing counts as moving from one motion to the next.

    waypoints: (K, J) joint values.
    first: (L + 1,) the first row of each motion, and K.
    numbers: (R,) places in rows of the waypoints, between which joints turn by no more than
        `_CLOSE_TURN`.
    ends: (L, 2) indices in `numbers` of the first and the last place of each motion.
    box_paths: (R, B) longest path of any point of each box up to each place, mm.
    paths: (R,) longest path of any point up to each place, mm, with a gap between two motions.
    turned: (R, J) path of each joint of the serial chain up to each place, rad or mm.
    closing: (J, P) see `bound_closing`.
    """

    waypoints: FloatArray
    first: IntArray
    numbers: FloatArray
    ends: IntArray
    box_paths: FloatArray
    paths: FloatArray
    turned: FloatArray
    closing: FloatArray

    @classmethod
    def make(cls, scenes: Sequence[Scene], several: Sequence[FloatArray]) -> list[_Lines]:
        """The motions through each of `several` (K, J), in each scene of one arm."""
        robot, joints = scenes[0].robot, list(map(check_finite, several))
        waypoints, first = np.concatenate(joints), compute_offsets(count_rows(several))
        numbers, seam = _divide(_sum_angles(robot, waypoints), first)
        rows = _interpolate(waypoints, numbers)
        serial = rows @ robot.coupling.T
        turns = np.abs(np.diff(serial, axis=0))
        turns[seam] = 0.0
        turned = np.vstack([np.zeros(serial.shape[1]), np.cumsum(turns, axis=0)])
        ends = np.column_stack([np.append(0, seam + 1), np.append(seam, len(numbers) - 1)])
        lines = []
        for scene, moves in zip(scenes, measure_moves(scenes, rows), strict=True):
            moves[seam] = 0.0
            longest = moves.max(axis=1, initial=0.0)
            longest[seam] = 1.0
            box_paths = np.vstack([np.zeros(len(scene.frame)), np.cumsum(moves, axis=0)])
            paths = np.append(0.0, np.cumsum(longest))
            closing = bound_closing(scene, np.abs(serial).max(axis=0))
            lines.append(cls(waypoints, first, numbers, ends, box_paths, paths, turned, closing))
        return lines


def _divide(angles: FloatArray, first: IntArray) -> tuple[FloatArray, IntArray]:
    """Divide motions so finely that the bound of `measure_moves` is tight.

    angles: (K - 1,) sum of the angles of all joints from row to row, rad.
    first: field of `_Lines`.
    Returns the field `numbers` of `_Lines`, and the indices in it of the ends of all motions except
    the last one.
    """
    parts = np.maximum(np.ceil(angles / _CLOSE_TURN), 1).astype(np.int64)
    parts[first[1:-1] - 1] = 1
    row = list_owners(parts)
    numbers = np.append(row + number_rows(parts) / parts[row], float(len(parts)))
    return numbers, compute_offsets(parts)[first[1:-1] - 1]


def _find_undecided(
    scene: Scene,
    lines: _Lines,
    step: float,
    nears: FloatArray,
    deviation: float,
    is_hasty: bool,
) -> tuple[FloatArray, IntArray, BoolArray]:
    """The places at which each motion must be tested as it is, in rows of all waypoints.

    They are the ends of the motions, and the middles of stretches that are no longer than `step`
    and were never found to be free.

    Also returned are the first of each motion among these (L + 1,), and which motions (L,) were
    cut: if `is_hasty`, no stretch is examined that begins beyond the middle of a long one that
    collides there.
    """
    start, stop = lines.paths[lines.ends].T
    count = np.maximum(np.ceil((stop - start) / (step * 2**_HALVINGS)), 1).astype(np.int64)
    width = (stop - start) / count
    line = list_owners(count)
    begins = start[line] + number_rows(count) * width[line]
    tests: Tests | None = None
    index = np.arange(len(lines.paths), dtype=np.float64)
    undecided = [(np.repeat(np.arange(len(start)), 2), lines.numbers[lines.ends].ravel())]
    last = np.full(len(start), math.inf)
    while len(line):
        is_long = width[line] > step
        middles = begins[~is_long] + width[line[~is_long]] / 2
        undecided.append((line[~is_long], np.interp(middles, lines.paths, lines.numbers)))
        tests = None if tests is None else select_tests(tests, is_long)
        line, begins = line[is_long], begins[is_long]
        places = np.interp(begins + width[line] * _START_MIDDLE_END, lines.paths, index)
        grow = _measure_changes(lines.box_paths, places)
        turned = _measure_changes(lines.turned, places)
        rows = _interpolate(lines.waypoints, np.interp(places[1], index, lines.numbers))
        both = turned @ lines.closing + 2 * deviation
        travel = Travel(turned, 2 * deviation + nears[line])
        growth = GrowthTable(grow + deviation, both, travel)
        row, test = find_meetings(scene, rows, growth, nears[line], tests)
        meets = np.zeros(len(line), dtype=np.bool_)
        meets[row] = True
        if is_hasty and (width > _LONG * step).any():
            # Most collisions are long, and only the first place of a motion matters.
            centres = begins + width[line] / 2
            tested = np.flatnonzero(meets & (centres < last[line]))
            struck = tested[find_collisions(scene, rows[tested]) >= 0]
            np.minimum.at(last, line[struck], centres[struck])
            meets &= begins <= last[line]
        # If nearly all are undecided, so are most of their halves. Quarters are tested next.
        is_quartered = meets.sum() > _NEARLY_ALL * len(meets) and (width[line] > 2 * step).all()
        parts = 4 if is_quartered else 2
        width = width / parts
        line = np.repeat(line[meets], parts)
        steps = width[line[::parts]][:, None] * np.arange(parts)
        begins = (begins[meets][:, None] + steps).ravel()
        # A test that does not meet in a stretch does not meet in its parts.
        tests = divide_tests(select_tests((row, test), meets), parts)
    owner, at = map(np.concatenate, zip(*undecided, strict=True))
    order = np.lexsort((at, owner))
    return at[order], compute_offsets(np.bincount(owner, minlength=len(start))), np.isfinite(last)


def _measure_changes(table: FloatArray, places: FloatArray) -> FloatArray:
    """The larger change of increasing columns from the middle of three places to the other two."""
    before, middle, after = (_interpolate(table, place) for place in places)
    return np.maximum(middle - before, after - middle)


def _interpolate(table: FloatArray, at: FloatArray) -> FloatArray:
    """`table` (K, C) between its rows, at the places `at` (N,): (N, C)."""
    row = np.minimum(at.astype(np.int64), max(len(table) - 2, 0))
    part = (at - row)[:, None]
    return np.asarray(table[row] * (1 - part) + table[np.minimum(row + 1, len(table) - 1)] * part)


def measure_moves(scenes: Sequence[Scene], waypoints: FloatArray) -> list[FloatArray]:
    """An upper bound of the path of any point of each box between rows of (K, J): (K - 1, B), mm.

    scenes: scenes of one arm, each with B boxes of its own.

    The speed of a point differs from its mean by no more than half of its largest acceleration. The
    mean is no more than the distances that the middle of the box and the ends of its axes move. Two
    joints accelerate a point by no more than the product of their rates and the lever of one. So
    half of the acceleration by all joints is no more than the sum of all angles, times the sum of
    the angles with their levers.
    """
    robot = scenes[0].robot
    serial = waypoints @ robot.coupling.T
    turns, range_of_joints = np.abs(np.diff(serial, axis=0)), np.abs(serial).max(axis=0)
    angles = _sum_angles(robot, waypoints)[:, None]
    bounds: list[FloatArray] = []
    for scene in scenes:
        bounds.append(angles * (turns @ bound_levers(scene, range_of_joints)))
    for begin in range(0, len(waypoints) - 1, ROWS):
        links = compute_link_frames(robot, waypoints[begin : begin + ROWS + 1])
        for scene, bound in zip(scenes, bounds, strict=True):
            placed = place_at(scene, links)
            bound[begin : begin + ROWS] += _measure_distances(placed[:-1], placed[1:])
    return bounds


def measure_apart(scene: Scene, first: FloatArray, second: FloatArray) -> FloatArray:
    """Upper bounds of the distance of any point of a body between two joint values, (N,) mm.

    first, second: (N, J).
    """
    distances = np.zeros(len(first))
    for begin in range(0, len(first), ROWS):
        rows = slice(begin, begin + ROWS)
        start, end = place_boxes(scene, first[rows]), place_boxes(scene, second[rows])
        distances[rows] = _measure_distances(start, end).max(axis=1, initial=0.0)
    return distances


def measure_closer(scene: Scene, first: FloatArray, second: FloatArray) -> FloatArray:
    """Upper bounds of the change of any pair's distance between two joint values, (N,) mm.

    first, second: (N, J).

    If one of the bodies stands, the bound is the distance of a point of the other one
    (`measure_apart`). If both move, it is that of one body relative to the other, because a motion
    of both together changes nothing.
    """
    both = scene.moving[scene.first] & scene.moving[scene.second]
    a, b = scene.first[both], scene.second[both]
    alone = np.zeros(len(scene.frame), dtype=np.bool_)
    alone[scene.first[~both]] = alone[scene.second[~both]] = True
    for target in scene.targets:
        alone[target.striking] = True
    bounds = np.zeros(len(first))
    for begin in range(0, len(first), ROWS):
        rows = slice(begin, begin + ROWS)
        start, end = place_boxes(scene, first[rows]), place_boxes(scene, second[rows])
        boxes = np.flatnonzero(alone)
        distances = _measure_distances(start[:, boxes], end[:, boxes])
        a_moves = _measure_distances(_see_from(start, a, b), _see_from(end, a, b))
        b_moves = _measure_distances(_see_from(start, b, a), _see_from(end, b, a))
        closer = np.minimum(a_moves, b_moves).max(axis=1, initial=0.0)
        bounds[rows] = np.maximum(distances.max(axis=1, initial=0.0), closer)
    return bounds


def _see_from(placed: Boxes, seen: IntArray, observer: IntArray) -> Boxes:
    """The boxes `seen` (P,) among boxes (N, B) in the frames of the boxes `observer` (P,)."""
    boxes, others = placed[:, seen], placed[:, observer]
    back = np.swapaxes(others.axes, -1, -2)
    centres = (back @ (boxes.centres - others.centres)[..., None])[..., 0]
    return Boxes(centres, back @ boxes.axes, boxes.half)


def _measure_distances(start: Boxes, end: Boxes) -> FloatArray:
    """The distance of the middle of each box, plus those of the ends of its axes, (N, B) mm."""
    distances, turned = measure_lengths(end.centres - start.centres), end.axes - start.axes
    for k in range(3):
        distances += measure_lengths(turned[..., k]) * start.half[..., k]
    return np.asarray(distances)


def _sum_angles(robot: Robot, waypoints: FloatArray) -> FloatArray:
    """The sum of the angles of all revolute joints from row to row (K - 1,), rad."""
    turns = np.abs(np.diff(waypoints @ robot.coupling.T, axis=0))
    return np.asarray(turns[:, robot.revolute].sum(axis=1))


def bound_levers(scene: Scene, travel: FloatArray) -> FloatArray:
    """Upper bounds of the distance that a joint moves any point of a box, mm per rad or mm (J, B).

    For a revolute joint it is the distance of the point from the origin of the joint, with the
    lengths of the chain added up.

    travel: (J,) largest distance of each joint from 0, rad or mm.
    """
    joints = scene.robot.joints
    bounds = np.zeros((len(joints), len(scene.frame)))
    reach = np.linalg.norm(scene.origin, axis=1) + np.linalg.norm(scene.half, axis=1)
    for k in reversed(range(len(joints))):
        moving = scene.frame > k
        bounds[k, moving] = 1.0 if joints[k].sliding else reach[moving]
        length = math.hypot(*joints[k].previous_from_joint.origin)
        reach[moving] += length + joints[k].sliding * travel[k]
    return bounds


def bound_closing(scene: Scene, travel: FloatArray) -> FloatArray:
    """Upper bounds of the distance by which a joint brings two boxes of a pair nearer (J, P).

    mm per rad or mm. Only joints between the links of both boxes count, with the lever of the box
    farther along the chain. Meshes of links have levers of their own.

    travel: argument of `bound_levers`.
    """
    first, second = scene.frame[scene.first], scene.frame[scene.second]
    low, high = np.minimum(first, second), np.maximum(first, second)
    lever = bound_levers(scene, travel)[:, np.where(first > second, scene.first, scene.second)]
    joint = np.arange(len(lever))[:, None]
    approach = np.where((joint >= low) & (joint < high), lever, 0.0)
    for number, closer in enumerate(scene.closer):
        if closer is not None:
            between = np.ix_(closer.joints, np.flatnonzero(scene.of_pair == number))
            approach[between] = np.minimum(approach[between], closer.levers[:, None])
    return approach
