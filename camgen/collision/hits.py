"""Which configurations collide."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import NamedTuple, Protocol

import numpy as np
from msgspec import Struct

from camgen.collision import pairs
from camgen.collision.boxes import Boxes, every, least_apart, meet
from camgen.collision.mesh import body, distance, find_struck
from camgen.collision.pairs import Travel
from camgen.collision.scene import Scene, Target, narrow
from camgen.geometry.ragged import each_once, ramp, run_lengths
from camgen.model.part import BoolArray, IntArray
from camgen.model.pose import FloatArray
from camgen.robots.kinematics.forward import frames

#: Configurations that are worked on at once: what belongs to them should fit into the processor's cache.
ROWS = 1024


def hits(
    scene: Scene,
    joints: FloatArray,
    grow: float | FloatArray = 0.0,
    closing: FloatArray | None = None,
    near: float | FloatArray = 0.0,
) -> IntArray:
    """The first pair of ``scene.pairs`` that collides at each configuration (N, J), rad or mm: (N,), -1: none.

    grow: mm by which boxes that move are larger, one number or (N, B). closing: (N, P) mm by which the two boxes of
    ``scene.first`` and ``scene.second`` are larger together, where that is less. near: mm, one number or (N,), at which
    bodies collide. To touch is to collide.
    """
    joints = np.asarray(joints, dtype=np.float64)
    grow = np.broadcast_to(grow, (len(joints), len(scene.frame))) * scene.moving
    near = np.broadcast_to(near, len(joints))
    found = np.full(len(joints), -1, dtype=np.int64)
    for begin in range(0, len(joints), ROWS):
        rows = slice(begin, begin + ROWS)
        bare = place(scene, joints[rows])
        placed = bare.grown((grow[rows] + near[rows, None] * scene.moving)[..., None])
        row, box = near_pairs(scene, placed)
        first, second, room = _grow(
            scene, bare, (row, box), grow[rows], None if closing is None else closing[rows]
        )
        room += near[rows][row]
        met = meet(first.grown(near[rows][row, None]), second)
        tests = _BoxTests(row, scene.of_pair[box], room)
        _look_closer(scene, joints[rows], tests, met, exactly=True)
        # Of several values for one place the last one stays: the first pair, since they come backwards.
        found[rows][row[met][::-1]] = scene.of_pair[box[met][::-1]]
        more = grow[rows] + near[rows, None]
        for target in scene.targets:
            _against(scene, joints[rows], target, placed, more, found[rows])
    return found


def split_off_meshes(scene: Scene) -> tuple[Scene, ...]:
    """The pairs of boxes, and those of which a link is a mesh: first the pairs that meet most.

    Two links meet the less, the fewer joints are between them.
    """
    between = {k: len(closer.joints) for k, closer in enumerate(scene.closer) if closer is not None}
    if not between:
        return (scene,)
    slow = sorted(between, key=lambda k: -between[k])
    quick = [k for k in range(len(scene.pairs)) if k not in between]
    return narrow(scene, quick), narrow(scene, slow)


def are_clear(scenes: Sequence[Scene], joints: FloatArray, near: float = 0.0) -> BoolArray:
    """The rows without a collision in any scene (N,), see ``hits``. Quick scenes come first."""
    clear = np.ones(len(joints), dtype=np.bool_)
    for scene in scenes:
        left = np.flatnonzero(clear)
        clear[left] = hits(scene, joints[left], near=near) < 0
    return clear


class _BoxTests(NamedTuple):
    """Tests of boxes.

    row: (n,) rows of joint values.
    pair: (n,) numbers of pairs of the scene.
    room: (n,) mm by which both bodies of a pair are larger together.
    travel: the largest deviations of the joint values, by row; None: not known.
    """

    row: IntArray
    pair: IntArray
    room: FloatArray
    travel: Travel | None = None


def _look_closer(
    scene: Scene, joints: FloatArray, tests: _BoxTests, met: BoolArray, exactly: bool = False
) -> None:
    """Clear ``met`` (n,) where the boxes meet and the meshes of a pair do not.

    joints: (N, J).
    exactly: whether meshes that are a little farther apart than `room` are cleared, and all pairs
        but the first one at each of the joint values. Else one test that is not cleared is enough
        at each of them: all later ones stay.
    """
    boxes_met = np.flatnonzero(met)
    is_named = np.zeros(len(joints), dtype=np.bool_)
    if not exactly:
        bare = np.array([closer is None for closer in scene.closer], dtype=np.bool_)
        is_named[tests.row[boxes_met[bare[tests.pair[boxes_met]]]]] = True
    for number in each_once(tests.pair[boxes_met]).tolist():
        which = boxes_met[tests.pair[boxes_met] == number]
        # An earlier pair collides there.
        late = is_named[tests.row[which]]
        if exactly:
            met[which[late]] = False
        which = which[~late]
        closer = scene.closer[number]
        if closer is not None and len(which):
            values, room = joints[tests.row[which]], tests.room[which]
            if not room.any():
                met[which] = pairs.meet(scene.robot, closer, values)
            elif exactly:
                met[which] = pairs.come_within(scene.robot, closer, values, room)
            else:
                travel = None if tests.travel is None else tests.travel.select(tests.row[which])
                met[which] = pairs.may_come_within(scene.robot, closer, values, room, travel)
        is_named[tests.row[which[met[which]]]] = True


#: A box that grows by 1 on every side reaches so much farther at its corners.
_CORNERS = math.sqrt(3.0)
#: Rows of configurations (n,), in order, and what is tested there (n,): numbers of pairs of boxes, and after them of
#: what strikes each of the scene's targets.
Tests = tuple[IntArray, IntArray]


def tests_of(tests: Tests, which: BoolArray) -> Tests:
    """Those at some rows, ``which`` of all, that are counted among themselves."""
    row, test = tests
    kept = which[row]
    return (np.cumsum(which) - 1)[row[kept]], test[kept]


def share_tests(tests: Tests, parts: int) -> Tests:
    """The same tests for each of so many parts that every row is cut into."""
    rows = (tests[0][:, None] * parts + np.arange(parts)).ravel()
    order = np.argsort(rows, kind="stable")
    return rows[order], np.repeat(tests[1], parts)[order]


class Growth(Protocol):
    """By how much boxes are larger than they are, mm, at rows of configurations; asked for what is near alone."""

    @property
    def travel(self) -> Travel | None:
        """The largest deviations of the joint values, None if they are not known."""

    def of_boxes(self, row: IntArray, box: IntArray, bare: Boxes) -> FloatArray:
        """Of boxes (n,), which are ``bare`` there; of those that stand whatever it is is left out."""

    def of_pairs(
        self, row: IntArray, pair: IntArray, first: Boxes, second: Boxes
    ) -> FloatArray | None:
        """Of the two boxes of pairs (n,) together; it counts where it is less than what both grow. None: never."""


class GrowthTable(Struct, frozen=True, eq=False):
    """``Growth`` that is known of all.

    grow: (N, B) mm by which each box is larger.
    closing: (N, P) mm by which both boxes of each pair are larger together; None: not known.
    travel: the largest deviations of the joint values; None: not known.
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
        """As of ``Growth``."""
        return np.asarray(self.grow[row, box])

    def of_pairs(
        self,
        row: IntArray,
        pair: IntArray,
        first: Boxes,  # noqa: ARG002
        second: Boxes,  # noqa: ARG002
    ) -> FloatArray | None:
        """As of ``Growth``."""
        return None if self.closing is None else np.asarray(self.closing[row, pair])


def find_meetings(
    scene: Scene,
    joints: FloatArray,
    growth: GrowthTable,
    near: FloatArray,
    asked: Tests | None = None,
) -> Tests:
    """The tests that meet at configurations (N, J).

    growth: growth of all boxes; of those that stand it does not count. A test that is not named
        meets nothing in any part of that either.
    near: (N,) mm at which bodies collide.
    asked: the only tests that are made; None: all.
    """
    found = []
    grow = growth.grow * scene.moving
    growth = GrowthTable(grow, growth.closing, growth.travel)
    for begin in range(0, len(joints), ROWS):
        rows = slice(begin, begin + ROWS)
        looked, part = finite(joints[rows]), growth.select(rows)
        if asked is None:
            some = _named(_meet_all(scene, looked, part, near[rows]))
        else:
            low, high = np.searchsorted(asked[0], [begin, begin + ROWS])
            at = looked, frames(scene.robot, looked)
            some = meet_again(
                scene, at, part, near[rows], (asked[0][low:high] - begin, asked[1][low:high])
            )
        found.append((some[0] + begin, some[1]))
    return join_tests(found)


def find_near(scene: Scene, joints: FloatArray, grow: FloatArray) -> Tests:
    """What may collide at configurations (N, J) where boxes that move are larger by ``grow`` (N, B), since the boxes
    around that are square to the base meet: cheaper than ``find_meetings``, and more.
    """
    found = []
    for begin in range(0, len(joints), ROWS):
        rows = slice(begin, begin + ROWS)
        wide = place(scene, joints[rows]).grown(_CORNERS * (grow[rows] * scene.moving)[..., None])
        some = [near_pairs(scene, wide)]
        first = len(scene.first)
        for target in scene.targets:
            row, which, _ = near_mesh(target, wide)
            some.append((row, which + first))
            first += len(target.striking)
        row, test = join_tests(some)
        order = np.argsort(row, kind="stable")
        found.append((row[order] + begin, test[order]))
    return join_tests(found)


def join_tests(several: Iterable[Tests]) -> Tests:
    """Some tests and others behind them."""
    none = np.zeros(0, dtype=np.int64)
    row, test = (np.concatenate(column) for column in zip((none, none), *several, strict=True))
    return row, test


#: Joint values (N, J), and the frames of the links there, see ``frames``.
_Places = tuple[FloatArray, tuple[FloatArray, FloatArray]]


def meet_again(scene: Scene, at: _Places, growth: Growth, near: FloatArray, tests: Tests) -> Tests:
    """The tests that meet ``at`` some joint values, see ``find_meetings``."""
    return _named(_meet_some(scene, at, growth, near, *tests))


def _named(tested: Iterable[_Tested]) -> Tests:
    """Those that meet, row by row."""
    row, test = join_tests((row[met], test[met]) for row, test, met in tested)
    order = np.argsort(row, kind="stable")
    return row[order], test[order]


#: Tests, and which of them meet.
_Tested = tuple[IntArray, IntArray, BoolArray]


def _meet_all(
    scene: Scene, joints: FloatArray, growth: GrowthTable, near: FloatArray
) -> Iterator[_Tested]:
    """``find_meetings`` of all tests."""
    bare, grow = place(scene, joints), growth.grow
    more = grow + near[:, None] * scene.moving
    row, test = near_pairs(scene, bare.grown(_CORNERS * more[..., None]))
    boxes, others, room = _grow(scene, bare, (row, test), grow, growth.closing)
    met = meet(boxes.grown(near[row, None]), others)
    tests = _BoxTests(row, scene.of_pair[test], room + near[row], growth.travel)
    _look_closer(scene, joints, tests, met)
    yield row, test, met
    first = len(scene.first)
    for target in scene.targets:
        row, which, boxes = near_mesh(target, bare.grown(more[..., None]))
        met = find_struck(target.mesh, boxes)
        room = more[row, target.striking[which]]
        _look_closer(scene, joints, _BoxTests(row, target.of_strike[which], room), met)
        yield row, which + first, met
        first += len(target.striking)


def _meet_some(
    scene: Scene,
    placed: _Places,
    growth: Growth,
    near: FloatArray,
    row: IntArray,
    test: IntArray,
) -> Iterator[_Tested]:
    """``find_meetings`` of tests at these rows. Only boxes that are asked for are placed, each once."""
    joints, links = placed
    first, many = len(scene.first), len(scene.frame)
    own = test < first
    at, pair = row[own], test[own]
    ends = [at * many + boxes[pair] for boxes in (scene.first, scene.second)]
    strikes = []
    for target in scene.targets:
        own = (test >= first) & (test < first + len(target.striking))
        strikes.append((row[own] * many + target.striking[test[own] - first], row[own], test[own]))
        first += len(target.striking)
    asked = np.zeros(len(near) * many, dtype=np.bool_)
    for places in (*ends, *(place for place, _, _ in strikes)):
        asked[places] = True
    number, places = np.cumsum(asked) - 1, np.flatnonzero(asked)
    of, box = np.divmod(places, many)
    bare, moving = _place_some(scene, links, of, box), scene.moving[box]
    grow = growth.of_boxes(of, box, bare) * moving
    more = (grow + near[of] * moving)[:, None]
    if len(pair):
        reach = bare.grown(_CORNERS * more).reach
        one, other = (number.take(end) for end in ends)
        room = reach.take(one, axis=0) + reach.take(other, axis=0)
        kept = np.flatnonzero(
            every(np.abs(bare.centres.take(one, axis=0) - bare.centres.take(other, axis=0)) <= room)
        )
        at, pair, one, other = at[kept], pair[kept], one[kept], other[kept]
        both = bare.take(one), bare.take(other)
        share = _share(grow.take(one), grow.take(other), growth.of_pairs(at, pair, *both))
        wide = share[0] + near[at]
        met = meet(both[0].grown(wide[:, None]), both[1].grown(share[1][:, None]))
        tests = _BoxTests(at, scene.of_pair[pair], wide + share[1], growth.travel)
        _look_closer(scene, joints, tests, met)
        yield at, pair, met
    begins = len(scene.first) + np.cumsum([0, *(len(target.striking) for target in scene.targets)])
    for target, begin, (place, at, which) in zip(scene.targets, begins, strikes, strict=False):
        if len(place):
            here = number.take(place)
            boxes = bare.take(here).grown(more.take(here, axis=0)).seen_from(*_frame(target))
            met = find_struck(target.mesh, boxes)
            of_pair = target.of_strike[which - begin]
            _look_closer(scene, joints, _BoxTests(at, of_pair, more.take(here)), met)
            yield at, which, met


def _frame(target: Target) -> tuple[FloatArray, FloatArray]:
    """base_from_mesh, rotation and origin."""
    return target.base_from_mesh.rotation, np.asarray(target.base_from_mesh.origin)


def _grow(
    scene: Scene,
    bare: Boxes,
    which: tuple[IntArray, IntArray],
    grow: FloatArray,
    closing: FloatArray | None,
) -> tuple[Boxes, Boxes, FloatArray]:
    """The boxes of the pairs ``which`` (rows and pairs of boxes), grown each or together.

    The third value is the growth of both together, mm.
    """
    row, box = which
    one, other = grow[row, scene.first[box]], grow[row, scene.second[box]]
    one, other = _share(one, other, None if closing is None else closing[row, box])
    first, second = bare.pick(row, scene.first[box]), bare.pick(row, scene.second[box])
    return first.grown(one[:, None]), second.grown(other[:, None]), one + other


def _share(
    one: FloatArray, other: FloatArray, both: FloatArray | None
) -> tuple[FloatArray, FloatArray]:
    """Mm by which the first and the second box of pairs (n,) grow, of what each of them does: where both together grow
    less than each of them the first does for both.
    """
    if both is None:
        return one, other
    less = both < one + other
    return np.where(less, both, one), np.where(less, 0.0, other)


def finite(joints: FloatArray) -> FloatArray:
    """``joints`` as they are. ValueError where one is not a number: nothing would seem to be near it."""
    if not np.isfinite(joints).all():
        raise ValueError("a configuration holds a joint value that is not finite")
    return np.asarray(joints, dtype=np.float64)


def place(scene: Scene, joints: FloatArray) -> Boxes:
    """All boxes at N configurations (N, J), base frame: (N, B)."""
    rotations, origins = frames(scene.robot, finite(joints))
    # All configurations of a box in one product of matrices: an eighth of the time of a product each.
    count = len(scene.frame)
    rows = rotations.swapaxes(0, 1).take(scene.frame, axis=0).reshape(count, 3 * len(joints), 3)
    centres = (rows @ scene.origin[..., None]).reshape(count, len(joints), 3)
    centres += origins.swapaxes(0, 1).take(scene.frame, axis=0)
    # Most boxes lie along the axes of their link.
    for box in np.flatnonzero((scene.rotation != np.eye(3)).any(axis=(1, 2))).tolist():
        rows[box] = rows[box] @ scene.rotation[box]
    axes = rows.reshape(count, len(joints), 3, 3).swapaxes(0, 1)
    return Boxes(centres.swapaxes(0, 1), axes, np.broadcast_to(scene.half, (len(joints), count, 3)))


def _place_some(
    scene: Scene, links: tuple[FloatArray, FloatArray], row: IntArray, box: IntArray
) -> Boxes:
    """Boxes (n,) at rows (n,) of configurations whose links are at ``links``, as of ``frames``."""
    frame = scene.frame[box]
    # Link by link, as they lie in memory: so they are taken in a third of the time.
    at = frame * len(links[0]) + row
    rotation = links[0].swapaxes(0, 1).reshape(-1, 3, 3).take(at, axis=0)
    origin = links[1].swapaxes(0, 1).reshape(-1, 3).take(at, axis=0)
    turned = rotation @ np.concatenate([scene.rotation, scene.origin[..., None]], axis=2).take(
        box, axis=0
    )
    return Boxes(origin + turned[..., 3], turned[..., :3], scene.half.take(box, axis=0))


def near_pairs(scene: Scene, placed: Boxes) -> tuple[IntArray, IntArray]:
    """Row and pair of boxes (n,), in order, whose boxes square to the base meet."""
    reach = placed.reach
    near = np.ones((len(scene.first), len(reach)), dtype=bool)
    for axis in range(3):
        # Box by box in memory: pairs are rows then, and taken in a fraction of the time.
        at, room = (np.ascontiguousarray(table[..., axis].T) for table in (placed.centres, reach))
        near &= np.abs(at[scene.first] - at[scene.second]) <= room[scene.first] + room[scene.second]
    row, box = np.nonzero(near.T)
    return row, box


def near_mesh(target: Target, placed: Boxes) -> tuple[IntArray, IntArray, Boxes]:
    """Row and place in ``target.striking`` of boxes (n,), in order, that may meet the mesh since the boxes around both
    do that are square to the base, and these boxes in the mesh's frame.
    """
    mesh = target.mesh
    rotation, origin = _frame(target)
    around = Boxes(rotation @ mesh.box.centres + origin, rotation, mesh.box.half)
    striking = placed[:, target.striking]
    apart = np.abs(striking.centres - around.centres) <= striking.reach + around.reach
    row, which = np.nonzero(apart[..., 0] & apart[..., 1] & apart[..., 2])
    return row, which, striking[row, which].seen_from(rotation, origin)


def _against(
    scene: Scene,
    joints: FloatArray,
    target: Target,
    placed: Boxes,
    more: FloatArray,
    found: IntArray,
) -> None:
    """Fill in the pairs with the mesh for configurations that have none yet.

    more: (N, B) mm by which boxes are larger.
    """
    free = np.flatnonzero(found < 0)
    row, which, boxes = near_mesh(target, placed if len(free) == len(found) else placed[free])
    struck = find_struck(target.mesh, boxes)
    row = free[row]
    room = more[row, target.striking[which]]
    tests = _BoxTests(row, target.of_strike[which], room)
    _look_closer(scene, joints, tests, struck, exactly=True)
    met = np.flatnonzero(struck)[::-1]
    found[row[met]] = target.of_strike[which[met]]


# How far what may collide is apart.

#: mm that distances must differ by to be told apart.
_SAME_DISTANCE_MM = 1e-6


class Nearest(Struct, frozen=True):
    """The nearest that two bodies come. row: the configuration. pair: of ``scene.pairs``, -1 where all are as far apart
    as was looked.
    """

    distance: float
    row: int
    pair: int


class _Found(Struct, frozen=True, eq=False):
    """What has been found so far at each of n places, lowered as more is measured. distance: (n,) mm. row: (n,) the
    configuration, pair: (n,) the pair that is so near, -1 where nothing is.
    """

    distance: FloatArray
    row: IntArray
    pair: IntArray

    @classmethod
    def beyond(cls, distance: FloatArray) -> _Found:
        """Nothing is nearer than ``distance`` (n,)."""
        none = np.full(len(distance), -1)
        return cls(distance, none, none.copy())


def clearance(scene: Scene, joints: FloatArray, near: float) -> FloatArray:
    """The least distance (N,), mm, of all pairs at each configuration (N, J); 0 where it collides, ``near`` where all
    are as far apart or farther. True to 1e-6 mm; the cost grows with what lies within ``near``.
    """
    joints = np.asarray(joints, dtype=np.float64)
    least = np.where(are_clear(split_off_meshes(scene), joints), near, 0.0)
    free = np.flatnonzero(least)
    _lower(scene, joints[free], free, _Found.beyond(least))
    return least


def least(scene: Scene, joints: FloatArray, near: float) -> Nearest:
    """The least of ``clearance`` for configurations (N, J) that do not collide, and its place; cheaper than each."""
    return least_of_each(scene, joints, np.zeros(len(joints), dtype=np.int64), np.array([near]))[0]


def least_of_each(
    scene: Scene, joints: FloatArray, owner: IntArray, near: FloatArray
) -> list[Nearest]:
    """``least`` for each of n groups of configurations. owner: (N,) the group of each. near: (n,) mm."""
    found = _Found.beyond(near.copy())
    _lower(scene, joints, owner, found)
    columns = (column.tolist() for column in (found.distance, found.row, found.pair))
    return [Nearest(*one) for one in zip(*columns, strict=True)]


class _Rows(NamedTuple):
    """Configurations that are measured together.

    joints: (n, J).
    placed: all boxes there, (n, B).
    row: (n,) numbers of the configurations.
    place: (n,) their places in the results.
    """

    joints: FloatArray
    placed: Boxes
    row: IntArray
    place: IntArray


def _lower(scene: Scene, joints: FloatArray, place_of: IntArray, found: _Found) -> None:
    """Lower ``found`` at ``place_of`` (N,) to the distances at the configurations (N, J)."""
    for begin in range(0, len(joints), ROWS):
        rows = np.arange(begin, min(begin + ROWS, len(joints)))
        looked = _Rows(joints[rows], place(scene, joints[rows]), rows, place_of[rows])
        _between(scene, looked, found)
        for target in scene.targets:
            _to_mesh(scene, target, looked, found)


def _between(scene: Scene, rows: _Rows, found: _Found) -> None:
    placed = rows.placed
    wide = placed.grown(found.distance[rows.place][:, None, None] * scene.moving[:, None])
    row, which = near_pairs(scene, wide)
    first, second = placed.pick(row, scene.first[which]), placed.pick(row, scene.second[which])
    pair = scene.of_pair[which]
    bound = least_apart(first, second)
    _raise_bounds(scene, rows.joints[row], pair, found.distance[rows.place[row]], bound)

    def measured(k: int) -> float:
        closer = scene.closer[pair[k]]
        if closer is not None:
            return pairs.measure(scene.robot, closer, rows.joints[row[k]])
        return distance(body(first, k), body(second, k))

    _measure(
        _Asked(rows.place[row], rows.row[row], pair, bound),
        found,
        lambda some, by: bound[some] < by,
        measured,
    )


def _to_mesh(scene: Scene, target: Target, rows: _Rows, found: _Found) -> None:
    placed = rows.placed
    row, which, wide = near_mesh(target, placed.grown(found.distance[rows.place][:, None, None]))
    boxes = Boxes(wide.centres, wide.axes, placed.half[row, target.striking[which]])
    pair = target.of_strike[which]
    bound = np.zeros(len(row))
    _raise_bounds(scene, rows.joints[row], pair, found.distance[rows.place[row]], bound)

    def within(some: IntArray, by: FloatArray) -> BoolArray:
        struck = find_struck(target.mesh, boxes[some].grown(by[:, None]))
        return np.asarray(struck & (bound[some] < by))

    def measured(k: int) -> float:
        closer = scene.closer[pair[k]]
        if closer is not None:
            return pairs.measure(scene.robot, closer, rows.joints[row[k]])
        return distance(target.mesh.surface, body(boxes, k))

    _measure(_Asked(rows.place[row], rows.row[row], pair, bound), found, within, measured)


def _raise_bounds(
    scene: Scene, joints: FloatArray, pair: IntArray, enough: FloatArray, bound: FloatArray
) -> None:
    """Raise ``bound`` (n,) for meshes that are farther apart than their boxes at joints (n, J).

    enough: (n,) mm; no bound need be more.
    """
    for number in each_once(pair).tolist():
        closer = scene.closer[number]
        if closer is not None:
            rows = np.flatnonzero((pair == number) & (bound < enough))
            raised = pairs.at_least(scene.robot, closer, joints[rows], enough[rows])
            bound[rows] = np.maximum(bound[rows], raised)


class _Asked(Struct, frozen=True, eq=False):
    """Candidates (n,) for the nearest: the place that each is asked for, its configuration, its pair, and mm that it is
    apart at least.
    """

    place: IntArray
    row: IntArray
    pair: IntArray
    bound: FloatArray


#: An odd number of 64 bits: its multiples are spread evenly and follow no order.
_SPREAD = np.uint64(0x9E3779B97F4A7C15)


def _measure(
    asked: _Asked,
    found: _Found,
    within: Callable[[IntArray, FloatArray], BoolArray],
    measured: Callable[[int], float],
) -> None:
    """Lower ``found`` to the distances of n candidates. within: which of some may be nearer than so many mm.

    fcl's distance takes a hundred times as long as a yes or no. So of each place the candidate that may be nearest is
    measured, and only those stay that may be nearer than that. Where many are about as near, twice as many are measured
    in each round as in the one before. Of candidates that may all touch any one may be the nearest; in any order but
    that along a motion, few rounds are needed.
    """
    mixed = np.argsort(np.arange(len(asked.place), dtype=np.uint64) * _SPREAD)
    left = mixed[np.lexsort((asked.bound[mixed], asked.place[mixed]))]
    many = 1
    while len(left):
        left = left[
            within(left, np.maximum(found.distance[asked.place[left]] - _SAME_DISTANCE_MM, 0.0))
        ]
        now = ramp(run_lengths(asked.place[left])) < many
        for k in left[now].tolist():
            at = asked.place[k]
            if asked.bound[k] < found.distance[at] and (far := measured(k)) < found.distance[at]:
                found.distance[at], found.row[at], found.pair[at] = far, asked.row[k], asked.pair[k]
        left = left[~now]
        many *= 2
