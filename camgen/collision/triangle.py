"""Is a whole triangle of configurations free? That is what lies between a corner and every way that rounds it."""

from __future__ import annotations

import numpy as np
from msgspec import Struct

from camgen.collision.boxes import Boxes
from camgen.collision.hits import (
    ROWS,
    GrowthTable,
    Tests,
    find_meetings,
    find_near,
    finite,
    join_tests,
    meet_again,
    share_tests,
    tests_of,
)
from camgen.collision.motion import closing, levers
from camgen.collision.pairs import Travel
from camgen.collision.scene import Scene
from camgen.geometry.ragged import ramp, run_lengths
from camgen.geometry.vectors import cross, lengths
from camgen.model.part import BoolArray, IntArray
from camgen.model.pose import FloatArray
from camgen.robots.kinematics.forward import frames, set_out

#: So often a triangle is split.
_SPLITS = 4
#: A triangle as four of half its size: rows of its corners and of the middles of its sides, 01, 12 and 20.
_FOUR = np.array([[0, 3, 5], [3, 1, 4], [5, 4, 2], [3, 4, 5]])
#: Of each group so many parts of triangles are looked at in a round at most, and twice as many in the next.
_FIRST = 32


def are_free(
    scene: Scene,
    corners: FloatArray,
    owner: IntArray,
    near: float = 0.0,
    apart: FloatArray | float = 0.0,
) -> BoolArray:
    """Which groups of triangles of configurations, rad or mm, hold none at which bodies come within ``near`` mm (G,).

    corners: (K, 3, J). owner: (K,) the group of each, 0 to G - 1, none of them empty. apart: mm, (G,) or one for all,
    that any point of a body may be off.

    A triangle is free where, at its middle, boxes grown by all that they move within it (``_Growth``) meet nothing;
    else it is split in four, ``_SPLITS`` times: what is not found free then is taken not to be. The smallest come
    first: most groups that are not free are done with after a few.
    """
    groups = int(owner.max(initial=-1)) + 1
    found = np.ones(groups, dtype=bool)
    serial = finite(corners) @ scene.robot.coupling.T
    travel = np.abs(serial).max(axis=(0, 1), initial=0.0)
    reach = _Reach(scene, levers(scene, travel), closing(scene, travel))
    off = np.broadcast_to(apart, groups)
    left = _Left(
        corners,
        owner,
        np.zeros(len(corners), dtype=np.int64),
        _find_near(reach, corners, off[owner], near),
    )
    many = _FIRST
    while len(left.owner):
        order, chosen = np.lexsort((-left.depth, left.owner)), left.depth == 0
        chosen[order[ramp(run_lengths(left.owner[order])) < many]] = True
        some, left = left.of(chosen), left.of(~chosen)
        row, test = _meet_within(reach, some, off, near)
        met = np.zeros(len(some.owner), dtype=np.bool_)
        met[row] = True
        found[some.owner[met & (some.depth == _SPLITS)]] = False
        # What collides at the middle of a whole one need not be split.
        again = met & (some.depth == 0)
        if again.any():
            middle, more = some.corners[again].mean(axis=1), off[some.owner[again]]
            first = tests_of((row, test), again)
            nears = np.full(len(middle), near)
            at, _ = find_meetings(scene, middle, GrowthTable(more[:, None]), nears, first)
            found[some.owner[again][at]] = False
        left = left.of(found[left.owner]).joined(_split(some, met & found[some.owner], row, test))
        many *= 2
    return found


class _Reach(Struct, frozen=True, eq=False):
    """How far joints move what is in a scene at most. levers, closing: (J, B) and (J, P), as of these functions."""

    scene: Scene
    levers: FloatArray
    closing: FloatArray


def _find_near(reach: _Reach, corners: FloatArray, off: FloatArray, near: float) -> Tests:
    """What may meet in triangles (K, 3, J) by the levers of their joints alone."""
    middle = corners.mean(axis=1)
    around = np.abs((corners - middle[:, None]) @ reach.scene.robot.coupling.T).max(axis=1)
    return find_near(reach.scene, middle, around @ reach.levers + off[:, None] + near)


def _meet_within(reach: _Reach, some: _Left, off: FloatArray, near: float) -> Tests:
    """What of the tests that are asked for may meet in some triangles."""
    found = []
    for begin in range(0, len(some.owner), ROWS):
        rows = slice(begin, begin + ROWS)
        middle = some.corners[rows].mean(axis=1)
        moved = (some.corners[rows] - middle[:, None]) @ reach.scene.robot.coupling.T
        links = frames(reach.scene.robot, middle)
        low, high = np.searchsorted(some.asked[0], [begin, begin + ROWS])
        growth = _Growth.of(reach, links, moved, off[some.owner[rows]], near)
        asked = some.asked[0][low:high] - begin, some.asked[1][low:high]
        row, test = meet_again(
            reach.scene, (middle, links), growth, np.full(len(middle), near), asked
        )
        found.append((row + begin, test))
    return join_tests(found)


class _Growth(Struct, frozen=True, eq=False):
    """How far boxes move at most from the middle of each triangle to any place within it: a ``Growth``.

    As far as they set out from there to one of its corners, since all other places lie between these, and as much as
    that may change on the way: no more than all angles times what the levers of the joints tell (``measure_moves``).
    Of triangles so wide that this is more than the levers alone tell, it is what they tell.

    setting_out: (J + 1, K, 3, 6), as of ``set_out``. angles: (K,) that all turning joints turn. grow, closing: (K, B)
    and (K, P) mm by the levers. off: (K,) mm that any point may be off.

    travel: the largest deviations of the joint values.
    """

    scene: Scene
    setting_out: FloatArray
    angles: FloatArray
    grow: FloatArray
    closing: FloatArray
    off: FloatArray
    travel: Travel

    @classmethod
    def of(
        cls,
        reach: _Reach,
        links: tuple[FloatArray, FloatArray],
        moved: FloatArray,
        off: FloatArray,
        near: float,
    ) -> _Growth:
        """moved: (K, 3, J) what the joints of the chain are at the corners from where they are in the middle."""
        around = np.abs(moved).max(axis=1)
        turning = np.array([not joint.sliding for joint in reach.scene.robot.joints])
        start = set_out(reach.scene.robot, links, moved)
        return cls(
            reach.scene,
            start,
            around[:, turning].sum(axis=1),
            around @ reach.levers,
            around @ reach.closing,
            off,
            Travel(around, 2 * off + near),
        )

    def of_boxes(self, row: IntArray, box: IntArray, bare: Boxes) -> FloatArray:
        """As of ``Growth``."""
        start = self.setting_out[self.scene.frame[box], row]
        return self._limit(start, bare, self.grow[row, box], row) + self.off[row]

    def of_pairs(self, row: IntArray, pair: IntArray, first: Boxes, second: Boxes) -> FloatArray:
        """As of ``Growth``."""
        one, other = (
            self.scene.frame[self.scene.first[pair]],
            self.scene.frame[self.scene.second[pair]],
        )
        start = (
            self.setting_out[np.maximum(one, other), row]
            - self.setting_out[np.minimum(one, other), row]
        )
        far = (one > other)[:, None]
        centres, half = (
            np.where(far, first.centres, second.centres),
            np.where(far, first.half, second.half),
        )
        boxes = Boxes(centres, first.axes, half)
        return self._limit(start, boxes, self.closing[row, pair], row) + 2 * self.off[row]

    def _limit(
        self, start: FloatArray, boxes: Boxes, most: FloatArray, row: IntArray
    ) -> FloatArray:
        """Of boxes (n,) that set out like ``start`` (n, 3, 6) and move no farther than ``most`` by the levers."""
        turn = start[..., :3]
        middle = lengths(cross(turn, boxes.centres[:, None]) + start[..., 3:])
        straight = (middle + lengths(turn) * lengths(boxes.half)[:, None]).max(axis=1)
        return np.asarray(np.minimum(straight + self.angles[row] * most, most))


class _Left(Struct, frozen=True, eq=False):
    """Triangles that are to be looked at. corners: (K, 3, J). owner, depth: (K,) the group of each, and how often it
    was split. asked: rows (n,) and tests (n,) that its whole met.
    """

    corners: FloatArray
    owner: IntArray
    depth: IntArray
    asked: Tests

    def of(self, which: BoolArray) -> _Left:
        """Those of them."""
        return _Left(
            self.corners[which], self.owner[which], self.depth[which], tests_of(self.asked, which)
        )

    def joined(self, other: _Left) -> _Left:
        """These and others behind them."""
        return _Left(
            np.concatenate([self.corners, other.corners]),
            np.concatenate([self.owner, other.owner]),
            np.concatenate([self.depth, other.depth]),
            join_tests((self.asked, (other.asked[0] + len(self.owner), other.asked[1]))),
        )


def _split(whole: _Left, which: BoolArray, row: IntArray, test: IntArray) -> _Left:
    """Each of some triangles as four. row, test: what they meet."""
    corners = whole.corners[which]
    six = np.concatenate([corners, (corners + corners[:, [1, 2, 0]]) / 2], axis=1)
    four = six[:, _FOUR].reshape(-1, *corners.shape[1:])
    owner, depth = (
        np.repeat(column[which], len(_FOUR)) for column in (whole.owner, whole.depth + 1)
    )
    return _Left(four, owner, depth, share_tests(tests_of((row, test), which), len(_FOUR)))
