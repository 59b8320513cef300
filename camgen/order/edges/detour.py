"""A way of the joints round what stands between two configurations, where no straight motion leads.

Two trees grow towards one another from both ends, each towards places at random and then towards the other
(RRT-Connect, Kuffner and LaValle, ICRA 2000); what is found is cut short. Lines are looked at from place to place, many
at once, and the way as a whole is proved like any other link. The same question has the same answer: the search is
seeded, and ends after so many looks.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from camgen.geometry.ragged import owners, ramp
from camgen.model.part import BoolArray
from camgen.model.pose import FloatArray, frozen
from camgen.motion.setup import Blockage, FreeSpace, SampledMotion, Setup
from camgen.robots.kinematics.joint_limits import are_within_limits

#: Configurations that are looked at for one way at most, with the margin and without it.
LOOKS = 40_000
#: rad that any joint turns from look to look; finer where what was found collides in between.
_STEPS = (0.04, 0.02, 0.01)
#: Places at random that a tree grows towards at once, and rad of its branches.
_TARGETS, _BRANCH = 16, 1.0
#: Of the places at random so many are near the two ends, rad.
_NEAR_SHARE, _NEAR = 0.5, 1.0
#: Rounds in which a way is cut short.
_CUTS = 40


class _Space(Struct, eq=False):
    """What is searched. scale: (J,) rad that a rad or a mm of each joint counts for. step: rad from look to look.
    looks: how many are left.
    """

    setup: Setup
    scale: FloatArray
    step: float
    looks: int

    def are_free(self, joints: FloatArray) -> BoolArray:
        """Which of (N, J) are within the limits and clear."""
        self.looks -= len(joints)
        good = are_within_limits(self.setup.robot, joints)
        good[good] = self.setup.clear(joints[good])
        return good

    def run(self, a: FloatArray, b: FloatArray) -> FloatArray:
        """How far the lines from ``a`` to ``b`` (N, J) are free: shares (N,), 1 for all the way."""
        far = (np.abs(b - a) * self.scale).max(axis=1)
        parts = np.maximum(np.ceil(far / self.step), 1).astype(np.int64)
        line, part = owners(parts), ramp(parts) + 1
        share = part / parts[line]
        good = self.are_free(a[line] + share[:, None] * (b - a)[line])
        first = np.full(len(a), np.iinfo(np.int64).max)
        np.minimum.at(first, line[~good], part[~good])
        return np.asarray(np.minimum((first - 1) / parts, 1.0))


class _Tree(Struct, eq=False):
    """Configurations (N, J) that free lines lead to, each from its parent; the first is the root."""

    joints: FloatArray
    parent: list[int]

    def nearest(self, to: FloatArray, scale: FloatArray) -> FloatArray:
        """The number of the nearest one to each of (M, J)."""
        apart = np.linalg.norm((to[:, None] - self.joints) * scale, axis=2)
        return np.asarray(apart.argmin(axis=1))

    def add(self, joints: FloatArray, parents: Sequence[int]) -> list[int]:
        """The numbers of ``joints`` (M, J), which come last."""
        count = len(self.joints)
        self.joints = np.concatenate([self.joints, joints])
        self.parent += parents
        return list(range(count, count + len(joints)))

    def branch(self, node: int) -> FloatArray:
        """From the root to a node (K, J)."""
        found = [node]
        while found[-1]:
            found.append(self.parent[found[-1]])
        return self.joints[found[::-1]]


def find_detour(setup: Setup, room: FreeSpace, a: FloatArray, b: FloatArray) -> FloatArray | None:
    """A way from ``a`` to ``b`` (J,) by joint values (K, J) between which all joints run evenly, proved free; None
    where none is found. One with the margin comes first, where both ends have it.
    """
    both = np.stack([a, b])
    setups = [setup]
    if setup.roomy(both).all():
        setups.insert(0, replace(setup, clear=setup.roomy))
    sliding = np.array([joint.sliding for joint in setup.robot.joints])
    scale = np.where(sliding, 1.0 / setup.robot.lever, 1.0)
    if not (are_within_limits(setup.robot, both) & setup.clear(both)).all():
        return None
    for each in setups:
        for step in _STEPS:
            space = _Space(each, scale, step, LOOKS)
            way = _search(space, a, b)
            if way is None:
                break
            short = _cut_short(space, way)
            for each_way, said in zip(
                (short, way), room.look([SampledMotion(short), SampledMotion(way)]), strict=True
            ):
                if not isinstance(said, Blockage):
                    return frozen(each_way)
    return None


def _search(space: _Space, a: FloatArray, b: FloatArray) -> FloatArray | None:
    """The first way that is found (K, J)."""
    rng = np.random.default_rng(0)
    trees = [_Tree(a[None], [-1]), _Tree(b[None], [-1])]
    targets = b[None]
    turn = 0
    while space.looks > 0:
        one, other = trees[turn], trees[1 - turn]
        grown = _grow(space, one, targets, _BRANCH)
        if grown:
            reached = _grow(space, other, one.joints[grown], np.inf)
            for node, there in zip(grown, _match(other, reached, one.joints[grown]), strict=True):
                if there >= 0:
                    ways = [one.branch(node), other.branch(there)[::-1][1:]]
                    way = np.concatenate(ways)
                    return way if turn == 0 else way[::-1]
        turn = 1 - turn
        targets = _draw(space, rng, a, b)
    return None


def _grow(space: _Space, tree: _Tree, targets: FloatArray, most: float) -> list[int]:
    """New nodes of the tree on the free part of lines from its nearest nodes to ``targets`` (M, J), no longer than
    ``most`` rad.
    """
    near = tree.nearest(targets, space.scale)
    begin = tree.joints[near]
    far = np.linalg.norm((targets - begin) * space.scale, axis=1)
    end = begin + np.minimum(most / np.maximum(far, 1e-9), 1.0)[:, None] * (targets - begin)
    share = space.run(begin, end)
    new = np.flatnonzero(share * far > 1e-6)
    # Exactly at its target, where it comes so far.
    at = np.where((share == 1.0)[:, None], end, begin + share[:, None] * (end - begin))[new]
    return tree.add(at, near[new].tolist())


def _match(tree: _Tree, nodes: Sequence[int], wanted: FloatArray) -> list[int]:
    """The node of ``nodes`` that is at each of the places ``wanted`` (M, J), -1 where none is."""
    at = [tree.joints[node] for node in nodes]
    found = []
    for place in wanted:
        same = [
            node
            for node, joints in zip(nodes, at, strict=True)
            if np.abs(joints - place).max() < 1e-9
        ]
        found.append(same[0] if same else -1)
    return found


def _draw(space: _Space, rng: np.random.Generator, a: FloatArray, b: FloatArray) -> FloatArray:
    """Places at random (M, J): anywhere within the limits, and near the box around both ends."""
    low, high = space.setup.robot.limits.T
    close = _NEAR / space.scale
    near = (
        np.clip(np.minimum(a, b) - close, low, high),
        np.clip(np.maximum(a, b) + close, low, high),
    )
    count = int(_TARGETS * _NEAR_SHARE)
    return np.concatenate(
        [rng.uniform(*near, (count, len(a))), rng.uniform(low, high, (_TARGETS - count, len(a)))]
    )


def _cut_short(space: _Space, way: FloatArray) -> FloatArray:
    """The way with straight lines in place of stretches, where they are free and take less time."""
    rng = np.random.default_rng(1)
    speeds = space.setup.robot.speeds
    for _ in range(_CUTS):
        if len(way) < 3:
            break
        at = np.append(0.0, np.cumsum((np.abs(np.diff(way, axis=0)) / speeds).max(axis=1)))
        ends = np.sort(rng.uniform(0.0, at[-1], (_TARGETS, 2)), axis=1)
        ends[0] = at[0], at[-1]
        points = np.stack([np.interp(ends, at, column) for column in way.T], axis=2)
        saved = ends[:, 1] - ends[:, 0] - (np.abs(points[:, 1] - points[:, 0]) / speeds).max(axis=1)
        saved[space.run(points[:, 0], points[:, 1]) < 1.0] = 0.0
        best = int(saved.argmax())
        if saved[best] > 1e-6:
            before, after = way[at < ends[best, 0]], way[at > ends[best, 1]]
            way = np.concatenate([before, points[best], after])
    return way
