"""Tests whether whole triangles of joint values are free of collisions.

A triangle between a corner and its neighbours holds every path by which a controller may round the
corner.
"""

from __future__ import annotations

import numpy as np
from msgspec import Struct

from camgen.collision.boxes import Boxes
from camgen.collision.hits import (
    ROWS,
    GrowthTable,
    Tests,
    check_finite,
    divide_tests,
    find_meetings,
    find_near,
    join_tests,
    meet_again,
    select_tests,
)
from camgen.collision.motion import bound_closing, bound_levers
from camgen.collision.pairs import Travel
from camgen.collision.scene import Scene
from camgen.geometry.ragged import measure_runs, number_rows
from camgen.geometry.vectors import cross, measure_lengths
from camgen.model.part import BoolArray, IntArray
from camgen.model.pose import FloatArray
from camgen.robots.kinematics.forward import compute_link_frames, compute_velocities

#: Maximum number of times that a triangle is split.
_SPLITS = 4
#: The four quarters of a triangle: rows of its corners, which are 0, 1, 2, and of the middles of
#: its sides 01, 12, 20, which are 3, 4, 5.
_FOUR = np.array([[0, 3, 5], [3, 1, 4], [5, 4, 2], [3, 4, 5]])
#: Parts of triangles of each group that are tested in the first round. Each round doubles it.
_FIRST = 32


def are_free(
    scene: Scene,
    corners: FloatArray,
    owner: IntArray,
    near: float = 0.0,
    deviation: FloatArray | float = 0.0,
) -> BoolArray:
    """Whether bodies keep more than `near` mm in whole groups of triangles of joint values (G,).

    corners: (K, 3, J) joint values, rad or mm.
    owner: (K,) group of each triangle, 0 to G - 1; no group is empty.
    deviation: distance by which any point of a body may be elsewhere, mm, (G,) or one for all.

    A triangle is free if boxes at its middle, grown by all that they move within it
    (`_TriangleGrowth`), meet nothing. Otherwise it is split in four, up to `_SPLITS` times. Parts
    that are not found to be free by then count as colliding. The smallest parts are tested first,
    so most groups that collide are settled after a few tests.
    """
    groups = int(owner.max(initial=-1)) + 1
    is_free = np.ones(groups, dtype=bool)
    travel = np.abs(check_finite(corners) @ scene.robot.coupling.T).max(axis=(0, 1), initial=0.0)
    bounds = _JointBounds(scene, bound_levers(scene, travel), bound_closing(scene, travel))
    deviations = np.broadcast_to(deviation, groups)
    pending = _Pending(
        corners,
        owner,
        np.zeros(len(corners), dtype=np.int64),
        _find_near(bounds, corners, deviations[owner], near),
    )
    limit = _FIRST
    while len(pending.owner):
        order, is_chosen = np.lexsort((-pending.depth, pending.owner)), pending.depth == 0
        is_chosen[order[number_rows(measure_runs(pending.owner[order])) < limit]] = True
        batch, pending = pending.select(is_chosen), pending.select(~is_chosen)
        row, test = _meet_within(bounds, batch, deviations, near)
        meets = np.zeros(len(batch.owner), dtype=np.bool_)
        meets[row] = True
        is_free[batch.owner[meets & (batch.depth == _SPLITS)]] = False
        # A whole triangle that collides at its middle need not be split.
        wholes = meets & (batch.depth == 0)
        if wholes.any():
            middle = batch.corners[wholes].mean(axis=1)
            groups_of_wholes = batch.owner[wholes]
            growth = GrowthTable(deviations[groups_of_wholes][:, None])
            wholes_tests = select_tests((row, test), wholes)
            nears = np.full(len(middle), near)
            colliding, _ = find_meetings(scene, middle, growth, nears, wholes_tests)
            is_free[groups_of_wholes[colliding]] = False
        quarters = _split(batch, meets & is_free[batch.owner], row, test)
        pending = pending.select(is_free[pending.owner]).join(quarters)
        limit *= 2
    return is_free


class _JointBounds(Struct, frozen=True, eq=False):
    """Bounds of the distances by which joints move bodies.

    levers: (J, B) see `bound_levers`.
    closing: (J, P) see `bound_closing`.
    """

    scene: Scene
    levers: FloatArray
    closing: FloatArray


def _find_near(
    bounds: _JointBounds, corners: FloatArray, deviation: FloatArray, near: float
) -> Tests:
    """Tests that may meet in triangles (K, 3, J), by the levers of the joints alone."""
    middle = corners.mean(axis=1)
    largest = np.abs((corners - middle[:, None]) @ bounds.scene.robot.coupling.T).max(axis=1)
    return find_near(bounds.scene, middle, largest @ bounds.levers + deviation[:, None] + near)


def _meet_within(
    bounds: _JointBounds, batch: _Pending, deviations: FloatArray, near: float
) -> Tests:
    """The tests of `batch` that may meet within its triangles."""
    meetings = []
    for begin in range(0, len(batch.owner), ROWS):
        rows = slice(begin, begin + ROWS)
        middle = batch.corners[rows].mean(axis=1)
        moved = (batch.corners[rows] - middle[:, None]) @ bounds.scene.robot.coupling.T
        links = compute_link_frames(bounds.scene.robot, middle)
        growth = _TriangleGrowth.make(bounds, links, moved, deviations[batch.owner[rows]], near)
        low, high = np.searchsorted(batch.tests[0], [begin, begin + ROWS])
        tests = batch.tests[0][low:high] - begin, batch.tests[1][low:high]
        nears = np.full(len(middle), near)
        row, test = meet_again(bounds.scene, (middle, links), growth, nears, tests)
        meetings.append((row + begin, test))
    return join_tests(meetings)


class _TriangleGrowth(Struct, frozen=True, eq=False):
    """Bounds of the distances that boxes move from the middle of triangles to any of their points.

    The first bound is the speed at the middle towards the farthest corner, since all other points
    are between the corners, plus the most by which the speed may change on the way: the sum of all
    angles times the distance by the levers (`measure_moves`). The second bound is the distance by
    the levers alone, which is smaller in wide triangles. The smaller one counts.

    starts: (J + 1, K, 3, 6) motions of the links at the middle towards the corners, see
        `compute_velocities`.
    angles: (K,) sum of the angles of all revolute joints, rad.
    box_limits, pair_limits: (K, B) and (K, P) distances by the levers, mm.
    deviation: (K,) distance by which any point of a body may be elsewhere, mm.
    travel: the largest deviations of the joint values.
    """

    scene: Scene
    starts: FloatArray
    angles: FloatArray
    box_limits: FloatArray
    pair_limits: FloatArray
    deviation: FloatArray
    travel: Travel

    @classmethod
    def make(
        cls,
        bounds: _JointBounds,
        links: tuple[FloatArray, FloatArray],
        moved: FloatArray,
        deviation: FloatArray,
        near: float,
    ) -> _TriangleGrowth:
        """The growth of K triangles.

        links: frames of the links at the middles.
        moved: (K, 3, J) joint values of the serial chain at the corners, minus those at the middle.
        """
        largest = np.abs(moved).max(axis=1)
        return cls(
            bounds.scene,
            compute_velocities(bounds.scene.robot, links, moved),
            largest[:, bounds.scene.robot.revolute].sum(axis=1),
            largest @ bounds.levers,
            largest @ bounds.closing,
            deviation,
            Travel(largest, 2 * deviation + near),
        )

    def of_boxes(self, row: IntArray, box: IntArray, bare: Boxes) -> FloatArray:
        start = self.starts[self.scene.frame[box], row]
        return self._bound(start, bare, self.box_limits[row, box], row) + self.deviation[row]

    def of_pairs(self, row: IntArray, pair: IntArray, first: Boxes, second: Boxes) -> FloatArray:
        first_frame = self.scene.frame[self.scene.first[pair]]
        second_frame = self.scene.frame[self.scene.second[pair]]
        # Motion of the box farther along the chain, relative to the other one.
        far = np.maximum(first_frame, second_frame)
        start = self.starts[far, row] - self.starts[np.minimum(first_frame, second_frame), row]
        first_is_far = (first_frame > second_frame)[:, None]
        centres = np.where(first_is_far, first.centres, second.centres)
        boxes = Boxes(centres, first.axes, np.where(first_is_far, first.half, second.half))
        return self._bound(start, boxes, self.pair_limits[row, pair], row) + 2 * self.deviation[row]

    def _bound(
        self, start: FloatArray, boxes: Boxes, limit: FloatArray, row: IntArray
    ) -> FloatArray:
        """Bounds (n,) of the distances that boxes move, mm.

        start: (n, 3, 6) motions at the middle towards the corners.
        limit: (n,) distance by the levers, mm.
        """
        turn = start[..., :3]
        middle = measure_lengths(cross(turn, boxes.centres[:, None]) + start[..., 3:])
        straight = (middle + measure_lengths(turn) * measure_lengths(boxes.half)[:, None]).max(
            axis=1
        )
        return np.asarray(np.minimum(straight + self.angles[row] * limit, limit))


class _Pending(Struct, frozen=True, eq=False):
    """Triangles to be tested.

    corners: (K, 3, J) joint values.
    owner: (K,) group of each.
    depth: (K,) number of times that each was split.
    tests: the tests that met in the triangle from which each was split, by row.
    """

    corners: FloatArray
    owner: IntArray
    depth: IntArray
    tests: Tests

    def select(self, which: BoolArray) -> _Pending:
        return _Pending(
            self.corners[which],
            self.owner[which],
            self.depth[which],
            select_tests(self.tests, which),
        )

    def join(self, other: _Pending) -> _Pending:
        return _Pending(
            np.concatenate([self.corners, other.corners]),
            np.concatenate([self.owner, other.owner]),
            np.concatenate([self.depth, other.depth]),
            join_tests((self.tests, (other.tests[0] + len(self.owner), other.tests[1]))),
        )


def _split(batch: _Pending, which: BoolArray, row: IntArray, test: IntArray) -> _Pending:
    """The four quarters of some triangles. row, test: the tests that meet in `batch`."""
    corners = batch.corners[which]
    six = np.concatenate([corners, (corners + corners[:, [1, 2, 0]]) / 2], axis=1)
    four = six[:, _FOUR].reshape(-1, *corners.shape[1:])
    owner = np.repeat(batch.owner[which], len(_FOUR))
    depth = np.repeat(batch.depth[which] + 1, len(_FOUR))
    return _Pending(four, owner, depth, divide_tests(select_tests((row, test), which), len(_FOUR)))
