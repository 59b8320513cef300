"""Tests which joint values collide, and measures clearances at joint values."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import NamedTuple, Protocol

import numpy as np
from msgspec import Struct

from camgen.collision import pairs
from camgen.collision.boxes import Boxes, all_of_three, bound_distances, meet
from camgen.collision.mesh import find_struck, make_box_object, measure_distance
from camgen.collision.pairs import Travel
from camgen.collision.scene import Scene, Target, select_pairs
from camgen.geometry.ragged import measure_runs, number_rows, select_distinct
from camgen.model.part import BoolArray, IntArray
from camgen.model.pose import FloatArray
from camgen.robots.kinematics.forward import compute_link_frames

#: Joint values that are tested together. Their data fit into the cache of the processor.
ROWS = 1024
#: Frames of the links at N joint values, see `compute_link_frames`.
_Links = tuple[FloatArray, FloatArray]
#: Joint values (N, J), and the frames of the links there.
_PlacedLinks = tuple[FloatArray, _Links]


def find_collisions(
    scene: Scene,
    joints: FloatArray,
    grow: float | FloatArray = 0.0,
    near: float | FloatArray = 0.0,
) -> IntArray:
    """The first pair of `scene.pairs` that collides at each of the joint values, (N,); -1 for none.

    joints: (N, J) rad or mm.
    grow: distance by which moving boxes are larger on all sides, mm, one number or (N, B).
    near: clearance at which bodies collide, mm, one number or (N,). Bodies that touch collide.
    """
    joints = check_finite(joints)
    grow = np.broadcast_to(grow, (len(joints), len(scene.frame))) * scene.moving
    near = np.broadcast_to(near, len(joints))
    colliding = np.empty(len(joints), dtype=np.int64)
    for begin in range(0, len(joints), ROWS):
        rows = slice(begin, begin + ROWS)
        placed = joints[rows], compute_link_frames(scene.robot, joints[rows])
        colliding[rows] = _find_first(scene, placed, grow[rows], near[rows])
    return colliding


def _find_first(scene: Scene, placed: _PlacedLinks, grow: FloatArray, near: FloatArray) -> IntArray:
    """`find_collisions` at joint values with placed links."""
    joints, links = placed
    bare = place_at(scene, links)
    limits = grow + near[:, None]
    grown = bare.grown((grow + near[:, None] * scene.moving)[..., None])
    row, test = _find_near_pairs(scene, grown)
    met = _test_pairs(scene, (joints, bare), (row, test), GrowthTable(grow), near, exactly=True)
    colliding = np.full(len(joints), -1, dtype=np.int64)
    # The last value that is assigned to a row stays. In reverse order that is the first pair.
    colliding[row[met][::-1]] = scene.of_pair[test[met][::-1]]
    for target in scene.targets:
        _add_mesh_hits(scene, joints, target, grown, limits, colliding)
    return colliding


def split_off_meshes(scene: Scene, near: float = 0.0) -> tuple[tuple[Scene, float], ...]:
    """The pairs of boxes, and those with the mesh of a link, which are ordered for early hits.

    Two links meet the less often, the fewer joints are between them.

    near: argument of `find_collisions`, which is returned with each scene, for `are_clear`.
    """
    between = {k: len(closer.joints) for k, closer in enumerate(scene.closer) if closer is not None}
    if not between:
        return ((scene, near),)
    slow = sorted(between, key=lambda k: -between[k])
    quick = [k for k in range(len(scene.pairs)) if k not in between]
    return (select_pairs(scene, quick), near), (select_pairs(scene, slow), near)


def are_clear(tests: Sequence[tuple[Scene, float]], joints: FloatArray) -> BoolArray:
    """Whether nothing collides at joint values (N, J), (N,); see `find_collisions`.

    tests: scenes of one arm, each with its `near`, in order of their time.
    """
    joints = check_finite(joints)
    is_clear = np.zeros(len(joints), dtype=np.bool_)
    for begin in range(0, len(joints), ROWS):
        values = joints[begin : begin + ROWS]
        links = compute_link_frames(tests[0][0].robot, values)
        clear = np.arange(len(values))
        for scene, near in tests:
            placed = values[clear], _take_poses(links, clear)
            grow = np.zeros((len(clear), len(scene.frame)))
            hit = _find_first(scene, placed, grow, np.full(len(clear), near))
            clear = clear[hit < 0]
        is_clear[begin + clear] = True
    return is_clear


def _take_poses(links: _Links, rows: IntArray) -> _Links:
    if len(rows) == len(links[0]):
        return links
    # Links stay stored link by link.
    rotations, origins = (table.swapaxes(0, 1).take(rows, axis=1) for table in links)
    return rotations.swapaxes(0, 1), origins.swapaxes(0, 1)


class _BoxTests(NamedTuple):
    """Tests of boxes.

    row: (n,) rows of joint values.
    pair: (n,) indices in `scene.pairs`.
    limit: (n,) distance within which the bodies of a pair count as meeting, mm.
    travel: the largest deviations of the joint values, by row; None if they are not known.
    """

    row: IntArray
    pair: IntArray
    limit: FloatArray
    travel: Travel | None = None


def _clear_distant_meshes(
    scene: Scene, joints: FloatArray, tests: _BoxTests, met: BoolArray, exactly: bool = False
) -> None:
    """Clear `met` (n,) where the boxes of a pair meet and its meshes do not.

    joints: (N, J).
    exactly: If True, meshes a little beyond their limit are cleared too, and so are all pairs
        except the first one that meets in a row. If False, the tests of a row end at the first one
        that is not cleared, and all later ones stay.
    """
    boxes_met = np.flatnonzero(met)
    is_named = np.zeros(len(joints), dtype=np.bool_)
    if not exactly:
        has_no_mesh = np.array([closer is None for closer in scene.closer], dtype=np.bool_)
        is_named[tests.row[boxes_met[has_no_mesh[tests.pair[boxes_met]]]]] = True
    for pair in select_distinct(tests.pair[boxes_met]).tolist():
        which = boxes_met[tests.pair[boxes_met] == pair]
        # Rows in which an earlier pair collides.
        is_late = is_named[tests.row[which]]
        if exactly:
            met[which[is_late]] = False
        which = which[~is_late]
        closer = scene.closer[pair]
        if closer is not None and len(which):
            values, limit = joints[tests.row[which]], tests.limit[which]
            if not limit.any():
                met[which] = pairs.meet(scene.robot, closer, values)
            elif exactly:
                met[which] = pairs.come_within(scene.robot, closer, values, limit)
            else:
                travel = None if tests.travel is None else tests.travel.select(tests.row[which])
                met[which] = pairs.may_come_within(scene.robot, closer, values, limit, travel)
        is_named[tests.row[which[met[which]]]] = True


#: Distance of the corners of a box that grows by 1 on every side from their previous places.
_CORNERS = math.sqrt(3.0)
#: Rows of joint values (n,), in order, and the number of the test made there (n,). The pairs of
#: boxes have the first numbers, then the boxes that strike each of the targets of the scene.
Tests = tuple[IntArray, IntArray]


def select_tests(tests: Tests, which: BoolArray) -> Tests:
    """The tests of some rows. which: (N,) whether a row is kept; the kept rows are renumbered."""
    row, test = tests
    kept = which[row]
    return (np.cumsum(which) - 1)[row[kept]], test[kept]


def divide_tests(tests: Tests, parts: int) -> Tests:
    """The tests of each row, for each of `parts` new rows into which it is divided."""
    rows = (tests[0][:, None] * parts + np.arange(parts)).ravel()
    order = np.argsort(rows, kind="stable")
    return rows[order], np.repeat(tests[1], parts)[order]


class Growth(Protocol):
    """Distances by which boxes are larger at rows of joint values, mm, computed on demand."""

    @property
    def travel(self) -> Travel | None:
        """The largest deviations of the joint values, None if they are not known."""

    def of_boxes(self, row: IntArray, box: IntArray, bare: Boxes) -> FloatArray:
        """Growth of boxes (n,), which are `bare` there. Growth of standing boxes is ignored."""

    def of_pairs(
        self, row: IntArray, pair: IntArray, first: Boxes, second: Boxes
    ) -> FloatArray | None:
        """Growth of the two boxes of pairs (n,) together, None if it is not known.

        It counts where it is less than what both grow.
        """


class GrowthTable(Struct, frozen=True, eq=False):
    """`Growth` from tables.

    grow: (N, B) distance by which each box is larger, mm.
    closing: (N, P) distance by which both boxes of each pair are larger together, mm; None if it is
        not known.
    travel: the largest deviations of the joint values; None if they are not known.
    """

    grow: FloatArray
    closing: FloatArray | None = None
    travel: Travel | None = None

    def select(self, rows: slice) -> GrowthTable:
        """The growth in some rows."""
        return GrowthTable(
            self.grow[rows],
            None if self.closing is None else self.closing[rows],
            None if self.travel is None else self.travel.select(rows),
        )

    def of_boxes(self, row: IntArray, box: IntArray, bare: Boxes) -> FloatArray:  # noqa: ARG002
        """See `Growth`."""
        return np.asarray(self.grow[row, box])

    def of_pairs(
        self,
        row: IntArray,
        pair: IntArray,
        first: Boxes,  # noqa: ARG002
        second: Boxes,  # noqa: ARG002
    ) -> FloatArray | None:
        """See `Growth`."""
        return None if self.closing is None else np.asarray(self.closing[row, pair])


def find_meetings(
    scene: Scene,
    joints: FloatArray,
    growth: GrowthTable,
    near: FloatArray,
    tests: Tests | None = None,
) -> Tests:
    """The tests that meet at joint values (N, J).

    growth: growth of all boxes; growth of standing boxes is ignored. A test that does not meet,
        meets nothing in any part of that growth either.
    near: (N,) clearance at which bodies collide, mm.
    tests: the only tests that are made; None for all.
    """
    meetings = []
    growth = GrowthTable(growth.grow * scene.moving, growth.closing, growth.travel)
    for begin in range(0, len(joints), ROWS):
        rows = slice(begin, begin + ROWS)
        values, part = check_finite(joints[rows]), growth.select(rows)
        if tests is None:
            row, test = _select_meeting(_test_all(scene, values, part, near[rows]))
        else:
            low, high = np.searchsorted(tests[0], [begin, begin + ROWS])
            placed = values, compute_link_frames(scene.robot, values)
            batch = tests[0][low:high] - begin, tests[1][low:high]
            row, test = meet_again(scene, placed, part, near[rows], batch)
        meetings.append((row + begin, test))
    return join_tests(meetings)


def find_near(scene: Scene, joints: FloatArray, grow: FloatArray) -> Tests:
    """The tests that may meet at joint values (N, J) if moving boxes are larger by `grow` (N, B).

    Only the boxes around them with edges along x, y and z of the base are tested. That is cheaper
    than `find_meetings`, and names more tests.
    """
    near = []
    for begin in range(0, len(joints), ROWS):
        rows = slice(begin, begin + ROWS)
        grown = place_boxes(scene, joints[rows]).grown(
            _CORNERS * (grow[rows] * scene.moving)[..., None]
        )
        tests = [_find_near_pairs(scene, grown)]
        first = len(scene.first)
        for target in scene.targets:
            row, strike, _ = _find_near_mesh(target, grown)
            tests.append((row, strike + first))
            first += len(target.striking)
        row, test = join_tests(tests)
        order = np.argsort(row, kind="stable")
        near.append((row[order] + begin, test[order]))
    return join_tests(near)


def join_tests(several: Iterable[Tests]) -> Tests:
    """Several groups of tests, one after the other."""
    none = np.zeros(0, dtype=np.int64)
    row, test = map(np.concatenate, zip((none, none), *several, strict=True))
    return row, test


def meet_again(
    scene: Scene, placed: _PlacedLinks, growth: Growth, near: FloatArray, tests: Tests
) -> Tests:
    """The tests among `tests` that meet, see `find_meetings`."""
    return _select_meeting(_test_some(scene, placed, growth, near, *tests))


#: Rows and numbers of tests, and whether each of them meets.
_Results = tuple[IntArray, IntArray, BoolArray]


def _select_meeting(results: Iterable[_Results]) -> Tests:
    row, test = join_tests((row[met], test[met]) for row, test, met in results)
    order = np.argsort(row, kind="stable")
    return row[order], test[order]


def _test_all(
    scene: Scene, joints: FloatArray, growth: GrowthTable, near: FloatArray
) -> Iterator[_Results]:
    """Make all tests of boxes that are near, see `find_meetings`."""
    bare, grow = place_boxes(scene, joints), growth.grow
    limits = grow + near[:, None] * scene.moving
    row, test = _find_near_pairs(scene, bare.grown(_CORNERS * limits[..., None]))
    yield row, test, _test_pairs(scene, (joints, bare), (row, test), growth, near)
    begin = len(scene.first)
    for target in scene.targets:
        row, strike, boxes = _find_near_mesh(target, bare.grown(limits[..., None]))
        met = find_struck(target.mesh, boxes)
        limit = limits[row, target.striking[strike]]
        tests = _BoxTests(row, target.of_strike[strike], limit)
        _clear_distant_meshes(scene, joints, tests, met)
        yield row, strike + begin, met
        begin += len(target.striking)


def _test_some(
    scene: Scene,
    placed: _PlacedLinks,
    growth: Growth,
    near: FloatArray,
    row: IntArray,
    test: IntArray,
) -> Iterator[_Results]:
    """Make these tests, see `find_meetings`. Each box that they need is placed once."""
    joints, links = placed
    begin, box_count = len(scene.first), len(scene.frame)
    is_pair = test < begin
    pair_row, pair = row[is_pair], test[is_pair]
    first, second = scene.first[pair], scene.second[pair]
    first, second = pair_row * box_count + first, pair_row * box_count + second
    is_needed = np.zeros(len(near) * box_count, dtype=np.bool_)
    is_needed[first] = is_needed[second] = True
    strikes = []
    for target in scene.targets:
        is_strike = (test >= begin) & (test < begin + len(target.striking))
        strike_row, strike = row[is_strike], test[is_strike] - begin
        index = strike_row * box_count + target.striking[strike]
        is_needed[index] = True
        strikes.append((index, strike_row, test[is_strike], target.of_strike[strike]))
        begin += len(target.striking)
    number = np.cumsum(is_needed) - 1
    box_row, box = np.divmod(np.flatnonzero(is_needed), box_count)
    bare, moving = _place_some(scene, links, box_row, box), scene.moving[box]
    grow = growth.of_boxes(box_row, box, bare) * moving
    limits = (grow + near[box_row] * moving)[:, None]
    if len(pair):
        reach = bare.grown(_CORNERS * limits).reach
        first, second = number.take(first), number.take(second)
        extent = reach.take(first, axis=0) + reach.take(second, axis=0)
        offset = bare.centres.take(first, axis=0) - bare.centres.take(second, axis=0)
        kept = np.flatnonzero(all_of_three(np.abs(offset) <= extent))
        pair_row, pair, first, second = pair_row[kept], pair[kept], first[kept], second[kept]
        boxes, others = bare.take(first), bare.take(second)
        both = growth.of_pairs(pair_row, pair, boxes, others)
        first_grow, second_grow = _share_growth(grow.take(first), grow.take(second), both)
        first_grow = first_grow + near[pair_row]
        met = meet(boxes.grown(first_grow[:, None]), others.grown(second_grow[:, None]))
        limit = first_grow + second_grow
        tests = _BoxTests(pair_row, scene.of_pair[pair], limit, growth.travel)
        _clear_distant_meshes(scene, joints, tests, met)
        yield pair_row, pair, met
    for target, (index, strike_row, strike, of_pair) in zip(scene.targets, strikes, strict=True):
        if len(index):
            striking = number.take(index)
            limit = limits.take(striking)
            boxes = bare.take(striking).grown(limit[:, None]).seen_from(*_get_frame(target))
            met = find_struck(target.mesh, boxes)
            _clear_distant_meshes(scene, joints, _BoxTests(strike_row, of_pair, limit), met)
            yield strike_row, strike, met


def _get_frame(target: Target) -> tuple[FloatArray, FloatArray]:
    return target.base_from_mesh.rotation, np.asarray(target.base_from_mesh.origin)


def _test_pairs(
    scene: Scene,
    placed: tuple[FloatArray, Boxes],
    tests: Tests,
    growth: GrowthTable,
    near: FloatArray,
    exactly: bool = False,
) -> BoolArray:
    """Whether pairs of boxes meet, (n,).

    placed: joint values (N, J), and all boxes there (N, B).
    exactly: argument of `_clear_distant_meshes`.
    """
    row, pair = tests
    if not len(row):
        return np.zeros(0, dtype=np.bool_)
    first, second, (joints, bare) = scene.first[pair], scene.second[pair], placed
    both = None if growth.closing is None else growth.closing[row, pair]
    grow = _share_growth(growth.grow[row, first], growth.grow[row, second], both)
    boxes = bare.pick(row, first).grown(grow[0][:, None]).grown(near[row, None])
    met = meet(boxes, bare.pick(row, second).grown(grow[1][:, None]))
    limit = grow[0] + grow[1] + near[row]
    box_tests = _BoxTests(row, scene.of_pair[pair], limit, growth.travel)
    _clear_distant_meshes(scene, joints, box_tests, met, exactly)
    return met


def _share_growth(
    first: FloatArray, second: FloatArray, both: FloatArray | None
) -> tuple[FloatArray, FloatArray]:
    """The growth of the first and of the second boxes of pairs (n,), mm.

    If `both`, the growth of a pair together, is less than the sum, the first box gets all of it.
    """
    if both is None:
        return first, second
    is_less = both < first + second
    return np.where(is_less, both, first), np.where(is_less, 0.0, second)


def check_finite(joints: FloatArray) -> FloatArray:
    """The joint values. Raises ValueError if one is not finite, which would seem to be free."""
    if not np.isfinite(joints).all():
        raise ValueError("a configuration holds a joint value that is not finite")
    return np.asarray(joints, dtype=np.float64)


def place_boxes(scene: Scene, joints: FloatArray) -> Boxes:
    """All boxes at joint values (N, J), in the base frame: (N, B)."""
    return place_at(scene, compute_link_frames(scene.robot, check_finite(joints)))


def place_at(scene: Scene, links: _Links) -> Boxes:
    """All boxes at frames of the links, see `compute_link_frames`, in the base frame: (N, B)."""
    rotations, origins = links
    # One matrix product for all poses of a box takes an eighth of the time of a product for each.
    count, poses = len(scene.frame), len(rotations)
    rows = rotations.swapaxes(0, 1).take(scene.frame, axis=0).reshape(count, 3 * poses, 3)
    centres = (rows @ scene.origin[..., None]).reshape(count, poses, 3)
    centres += origins.swapaxes(0, 1).take(scene.frame, axis=0)
    # Most boxes have their edges along the axes of their link.
    for box in np.flatnonzero((scene.rotation != np.eye(3)).any(axis=(1, 2))).tolist():
        rows[box] = rows[box] @ scene.rotation[box]
    axes = rows.reshape(count, poses, 3, 3).swapaxes(0, 1)
    return Boxes(centres.swapaxes(0, 1), axes, np.broadcast_to(scene.half, (poses, count, 3)))


def _place_some(scene: Scene, links: _Links, row: IntArray, box: IntArray) -> Boxes:
    """Boxes (n,) of the scene, each at one row (n,) of `links`."""
    frame = scene.frame[box]
    # Links are stored link by link. In that order they are taken in a third of the time.
    index = frame * len(links[0]) + row
    rotation = links[0].swapaxes(0, 1).reshape(-1, 3, 3).take(index, axis=0)
    origin = links[1].swapaxes(0, 1).reshape(-1, 3).take(index, axis=0)
    link_from_box = np.concatenate([scene.rotation, scene.origin[..., None]], axis=2)
    turned = rotation @ link_from_box.take(box, axis=0)
    return Boxes(origin + turned[..., 3], turned[..., :3], scene.half.take(box, axis=0))


def _find_near_pairs(scene: Scene, placed: Boxes) -> Tests:
    """The pairs of boxes that meet as boxes with edges along x, y and z of the base."""
    reach = placed.reach
    is_near = np.ones((len(scene.first), len(reach)), dtype=bool)
    for axis in range(3):
        # Stored box by box, the boxes of pairs are taken in a fraction of the time.
        centre = np.ascontiguousarray(placed.centres[..., axis].T)
        half = np.ascontiguousarray(reach[..., axis].T)
        offset = np.abs(centre[scene.first] - centre[scene.second])
        is_near &= offset <= half[scene.first] + half[scene.second]
    row, pair = np.nonzero(is_near.T)
    return row, pair


def _find_near_mesh(target: Target, placed: Boxes) -> tuple[IntArray, IntArray, Boxes]:
    """The boxes that may meet a mesh, by the boxes around both along x, y and z of the base.

    Returns their rows, their indices in `target.striking`, and the boxes in the frame of the mesh.
    """
    striking, around = target.striking, target.box
    offset = np.abs(placed.centres[:, striking] - around.centres)
    is_near = offset <= placed.reach[:, striking] + around.reach
    row, strike = np.nonzero(is_near[..., 0] & is_near[..., 1] & is_near[..., 2])
    return row, strike, placed.pick(row, striking[strike]).seen_from(*_get_frame(target))


def _add_mesh_hits(
    scene: Scene,
    joints: FloatArray,
    target: Target,
    placed: Boxes,
    limits: FloatArray,
    colliding: IntArray,
) -> None:
    """Set `colliding` to the pair that strikes a mesh, at joint values that have no pair yet.

    limits: (N, B) distance by which boxes are larger, mm.
    """
    free = np.flatnonzero(colliding < 0)
    is_all = len(free) == len(colliding)
    row, strike, boxes = _find_near_mesh(target, placed if is_all else placed[free])
    met = find_struck(target.mesh, boxes)
    row = free[row]
    tests = _BoxTests(row, target.of_strike[strike], limits[row, target.striking[strike]])
    _clear_distant_meshes(scene, joints, tests, met, exactly=True)
    struck = np.flatnonzero(met)[::-1]
    colliding[row[struck]] = target.of_strike[strike[struck]]


# Clearances.

#: Two distances count as different if they differ by more than this, mm.
_SAME_DISTANCE_MM = 1e-6


class Nearest(Struct, frozen=True, eq=False):
    """The smallest clearance of each of n groups of joint values, lowered as more is measured.

    distance: (n,) mm.
    row: (n,) index of the joint values, -1 without a pair.
    pair: (n,) index in `scene.pairs`; -1 if no pair is nearer than the first distance.
    """

    distance: FloatArray
    row: IntArray
    pair: IntArray


class _Measurement(Struct, frozen=True, eq=False):
    """Joint values whose clearances are measured.

    scene: cell with the pairs that are measured.
    joints: (N, J) rad or mm.
    owner: (N,) the group of each.
    nearest: the smallest clearance of each group.
    """

    scene: Scene
    joints: FloatArray
    owner: IntArray
    nearest: Nearest


def measure_clearance(scene: Scene, joints: FloatArray, near: float) -> FloatArray:
    """The clearance of all pairs at joint values (N, J), mm (N,).

    It is 0 at a collision, and at most `near`. It is exact to 1e-6 mm. The time grows with the
    number of pairs within `near`.
    """
    joints = np.asarray(joints, dtype=np.float64)
    distances = np.where(are_clear(split_off_meshes(scene), joints), near, 0.0)
    free = np.flatnonzero(distances)
    return find_nearest_pairs(scene, joints[free], free, distances).distance


def find_nearest_pairs(
    scene: Scene, joints: FloatArray, owner: IntArray, near: FloatArray
) -> Nearest:
    """The smallest clearance of each of n groups of joint values that do not collide.

    It is cheaper than to measure each clearance.

    owner: (N,) the group of each of the joint values.
    near: (n,) largest distance asked for in each group, mm.
    """
    none = np.full(len(near), -1)
    measurement = _Measurement(scene, joints, owner, Nearest(near.copy(), none, none.copy()))
    for begin in range(0, len(joints), ROWS):
        rows = np.arange(begin, min(begin + ROWS, len(joints)))
        placed = place_boxes(scene, joints[rows])
        _measure_pairs(measurement, rows, placed)
        for target in scene.targets:
            _measure_strikes(measurement, target, rows, placed)
    return measurement.nearest


class _Candidates(Struct, frozen=True, eq=False):
    """Pairs that may be the nearest ones of some group.

    row: (n,) index of the joint values.
    pair: (n,) index in `scene.pairs`.
    bound: (n,) lower bound of the distance, mm.
    """

    row: IntArray
    pair: IntArray
    bound: FloatArray


def _measure_pairs(measurement: _Measurement, rows: IntArray, placed: Boxes) -> None:
    """Lower the clearances to the distances of pairs of boxes, or of meshes of links.

    rows: (n,) indices of joint values.
    placed: all boxes there, (n, B).
    """
    scene = measurement.scene
    distances = measurement.nearest.distance[measurement.owner[rows]][:, None, None]
    row, test = _find_near_pairs(scene, placed.grown(distances * scene.moving[:, None]))
    first, second = placed.pick(row, scene.first[test]), placed.pick(row, scene.second[test])
    candidates = _Candidates(rows[row], scene.of_pair[test], bound_distances(first, second))
    _measure_candidates(
        measurement,
        candidates,
        lambda batch, limit: candidates.bound[batch] < limit,
        lambda k: measure_distance(make_box_object(first, k), make_box_object(second, k)),
    )


def _measure_strikes(
    measurement: _Measurement, target: Target, rows: IntArray, placed: Boxes
) -> None:
    """`_measure_pairs` for the distances from a mesh that stands."""
    distances = measurement.nearest.distance[measurement.owner[rows]][:, None, None]
    row, strike, grown = _find_near_mesh(target, placed.grown(distances))
    boxes = Boxes(grown.centres, grown.axes, placed.half[row, target.striking[strike]])
    candidates = _Candidates(rows[row], target.of_strike[strike], np.zeros(len(row)))

    def may_be_nearer(batch: IntArray, limit: FloatArray) -> BoolArray:
        is_struck = find_struck(target.mesh, boxes[batch].grown(limit[:, None]))
        return np.asarray(is_struck & (candidates.bound[batch] < limit))

    _measure_candidates(
        measurement,
        candidates,
        may_be_nearer,
        lambda k: measure_distance(target.mesh.surface, make_box_object(boxes, k)),
    )


def _raise_bounds(measurement: _Measurement, candidates: _Candidates) -> None:
    """Raise the bounds of pairs whose meshes are farther apart than their boxes.

    No bound is measured beyond the distance that is already found for its group.
    """
    scene, bound, row = measurement.scene, candidates.bound, candidates.row
    limit = measurement.nearest.distance[measurement.owner[row]]
    for pair in select_distinct(candidates.pair).tolist():
        closer = scene.closer[pair]
        if closer is not None:
            rows = np.flatnonzero((candidates.pair == pair) & (bound < limit))
            joints = measurement.joints[row[rows]]
            raised = pairs.bound_distances(scene.robot, closer, joints, limit[rows])
            bound[rows] = np.maximum(bound[rows], raised)


#: An odd number of 64 bits whose multiples are spread evenly and in no simple order.
_SPREAD = np.uint64(0x9E3779B97F4A7C15)


def _measure_candidates(
    measurement: _Measurement,
    candidates: _Candidates,
    may_be_nearer: Callable[[IntArray, FloatArray], BoolArray],
    measure_boxes: Callable[[int], float],
) -> None:
    """Lower the clearances to the distances of n candidates.

    may_be_nearer: gets indices (m,) of candidates and distances (m,), mm; returns (m,) whether they
        may be nearer than that.
    measure_boxes: distance of a candidate whose pair has no meshes of links, mm.

    A distance of fcl takes a hundred times as long as a test. So the candidate with the lowest
    bound is measured in each group, and then only those that may be nearer remain. Each round
    measures twice as many as the previous one, in case many are about equally near. Candidates with
    equal bounds are in mixed order. In the order of a motion each would be a little nearer than the
    one before, which needs many rounds.
    """
    _raise_bounds(measurement, candidates)
    scene, nearest = measurement.scene, measurement.nearest
    group = measurement.owner[candidates.row]
    mixed = np.argsort(np.arange(len(group), dtype=np.uint64) * _SPREAD)
    pending = mixed[np.lexsort((candidates.bound[mixed], group[mixed]))]
    limit = 1
    while len(pending):
        distances = nearest.distance[group[pending]] - _SAME_DISTANCE_MM
        pending = pending[may_be_nearer(pending, np.maximum(distances, 0.0))]
        is_due = number_rows(measure_runs(group[pending])) < limit
        for k in pending[is_due].tolist():
            index, row = group[k], candidates.row[k]
            if candidates.bound[k] >= nearest.distance[index]:
                continue
            closer = scene.closer[candidates.pair[k]]
            if closer is None:
                measured = measure_boxes(k)
            else:
                measured = pairs.measure_pair(scene.robot, closer, measurement.joints[row])
            if measured < nearest.distance[index]:
                nearest.distance[index] = measured
                nearest.row[index], nearest.pair[index] = row, candidates.pair[k]
        pending = pending[~is_due]
        limit *= 2
