"""Is a whole triangle of configurations free? That is what lies between a corner and every way that rounds it."""

from __future__ import annotations

import numpy as np
from msgspec import Struct

from camgen.collision.hits import Tests, find_meetings, finite, share_tests, tests_of
from camgen.collision.motion import closing, levers
from camgen.collision.scene import Scene
from camgen.geometry.ragged import ramp, run_lengths
from camgen.model.part import BoolArray, IntArray
from camgen.model.pose import FloatArray

#: So often a triangle is split.
_SPLITS = 4
#: A triangle as four of half its size: rows of its corners and of the middles of its sides, 01, 12 and 20.
_FOUR = np.array([[0, 3, 5], [3, 1, 4], [5, 4, 2], [3, 4, 5]])
#: Of each group so many triangles are looked at in a round, and so many times more in the next.
_FIRST, _MORE = 32, 2.0


def are_free(
    scene: Scene, corners: FloatArray, owner: IntArray, near: float = 0.0, apart: FloatArray | float = 0.0
) -> BoolArray:
    """Which groups of triangles of configurations, rad or mm, hold none at which bodies come within ``near`` mm (G,).

    corners: (K, 3, J). owner: (K,) the group of each, 0 to G - 1, none of them empty. apart: mm, (G,) or one for all,
    that any point of a body may be off.

    A triangle is free where, at its middle, boxes grown by all that they move within it meet nothing; else it is split
    in four, ``_SPLITS`` times: what is not found free then is taken not to be. The smallest come first: most groups
    that are not free are done with after a few.
    """
    groups = int(owner.max(initial=-1)) + 1
    found = np.ones(groups, dtype=bool)
    coupling = scene.robot.coupling.T
    travel = np.abs(finite(corners.reshape(-1, corners.shape[-1])) @ coupling).max(axis=0, initial=0.0)
    lever, close = levers(scene, travel), closing(scene, travel)
    off = np.broadcast_to(apart, groups)
    left = _Left(corners, owner, np.zeros(len(corners), dtype=np.int64), None)
    many = float(len(corners))
    while len(left.owner):
        order = np.lexsort((-left.depth, left.owner))
        chosen = np.zeros(len(order), dtype=bool)
        chosen[order[ramp(run_lengths(left.owner[order])) < many]] = True
        some, left = left.of(chosen), left.of(~chosen)
        middle, more = some.corners.mean(axis=1), off[some.owner]
        around = np.abs((some.corners - middle[:, None]) @ coupling).max(axis=1)
        grow, both = around @ lever + more[:, None], around @ close + 2 * more[:, None]
        level = np.full(len(middle), near)
        row, test = find_meetings(scene, middle, grow, both, level, some.asked)
        met = np.zeros(len(middle), dtype=np.bool_)
        met[row] = True
        found[some.owner[met & (some.depth == _SPLITS)]] = False
        # What collides at the middle of a whole one need not be split.
        again = met & (some.depth == 0)
        if again.any():
            first = tests_of((row, test), again)
            at, _ = find_meetings(scene, middle[again], more[again, None], None, level[again], first)
            found[some.owner[again][at]] = False
        left = left.of(found[left.owner]).joined(_split(some, met & found[some.owner], row, test))
        many = _FIRST if some.asked is None else many * _MORE
    return found


class _Left(Struct, frozen=True, eq=False):
    """Triangles that are to be looked at. corners: (K, 3, J). owner, depth: (K,) the group of each, and how often it
    was split. asked: rows (n,) and tests (n,) that its whole met, None: all.
    """

    corners: FloatArray
    owner: IntArray
    depth: IntArray
    asked: Tests | None

    def of(self, which: BoolArray) -> _Left:
        """Those of them."""
        asked = None if self.asked is None else tests_of(self.asked, which)
        return _Left(self.corners[which], self.owner[which], self.depth[which], asked)

    def joined(self, other: _Left) -> _Left:
        """These and others behind them."""
        if self.asked is None or other.asked is None:
            return other
        rows = np.concatenate([self.asked[0], other.asked[0] + len(self.owner)])
        return _Left(
            np.concatenate([self.corners, other.corners]),
            np.concatenate([self.owner, other.owner]),
            np.concatenate([self.depth, other.depth]),
            (rows, np.concatenate([self.asked[1], other.asked[1]])),
        )


def _split(whole: _Left, which: BoolArray, row: IntArray, test: IntArray) -> _Left:
    """Each of some triangles as four. row, test: what they meet."""
    corners = whole.corners[which]
    six = np.concatenate([corners, (corners + corners[:, [1, 2, 0]]) / 2], axis=1)
    four = six[:, _FOUR].reshape(-1, *corners.shape[1:])
    owner, depth = (np.repeat(column[which], len(_FOUR)) for column in (whole.owner, whole.depth + 1))
    return _Left(four, owner, depth, share_tests(tests_of((row, test), which), len(_FOUR)))
