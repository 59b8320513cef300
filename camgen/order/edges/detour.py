"""Searches a detour of the joints around obstacles, if the direct motion collides.

Two trees grow from both ends, in turn towards random joint values and towards the other tree
(RRT-Connect, Kuffner and LaValle, ICRA 2000). The detour found is then shortened. Lines are tested
at samples, many at once. The whole detour is proved like any other link. The result is the same
each time: the random generator has a fixed seed, and the number of samples is limited.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from camgen.geometry.ragged import list_owners, number_rows
from camgen.geometry.vectors import interpolate_rows
from camgen.model.part import BoolArray
from camgen.model.pose import FloatArray, frozen
from camgen.motion.setup import Blockage, FreeSpace, SampledMotion, Setup
from camgen.robots.kinematics.joint_limits import are_within_limits

#: Maximum number of samples of one search, with the margin and again without it.
MAX_SAMPLES = 40_000
#: rad: largest motion of a joint between two samples. The next one is used if the proof of a detour
#: finds a collision between them.
_STEPS = (0.04, 0.02, 0.01)
#: Random joint values towards which a tree grows at once.
_TARGETS = 16
#: rad: length of a branch of the tree.
_BRANCH = 1.0
#: Fraction of the random joint values that are near the two ends.
_NEAR_FRACTION = 0.5
#: rad: distance of these from the box around both ends.
_NEAR_DISTANCE = 1.0
#: Attempts to shorten a detour.
_CUTS = 40


class _Space(Struct, eq=False):
    """The joint space of a search.

    setup: the arm and its collision test.
    scale: (J,) rad for each rad or mm of a joint.
    step: distance between two samples, rad.
    samples_left: number of samples that may still be tested.
    """

    setup: Setup
    scale: FloatArray
    step: float
    samples_left: int

    def are_free(self, joints: FloatArray) -> BoolArray:
        """Which of (N, J) are within the limits and clear."""
        self.samples_left -= len(joints)
        free = are_within_limits(self.setup.robot, joints)
        free[free] = self.setup.clear(joints[free])
        return free

    def measure_free(self, a: FloatArray, b: FloatArray) -> FloatArray:
        """The free fraction (N,) of each line from `a` to `b` (N, J); 1 for a whole line."""
        distance = (np.abs(b - a) * self.scale).max(axis=1)
        parts = np.maximum(np.ceil(distance / self.step), 1).astype(np.int64)
        line, part = list_owners(parts), number_rows(parts) + 1
        free = self.are_free(a[line] + (part / parts[line])[:, None] * (b - a)[line])
        first = np.full(len(a), np.iinfo(np.int64).max)
        np.minimum.at(first, line[~free], part[~free])
        return np.asarray(np.minimum((first - 1) / parts, 1.0))


class _Tree(Struct, eq=False):
    """A tree of joint values with free lines between them.

    joints: (N, J) joint values of the nodes; the first is the root.
    parent: parent of each node.
    """

    joints: FloatArray
    parent: list[int]

    def find_nearest(self, targets: FloatArray, scale: FloatArray) -> FloatArray:
        """The index of the nearest node to each of `targets` (M, J)."""
        distance = np.linalg.norm((targets[:, None] - self.joints) * scale, axis=2)
        return np.asarray(distance.argmin(axis=1))

    def add(self, joints: FloatArray, parents: Sequence[int]) -> list[int]:
        """Adds nodes (M, J) and returns their indices."""
        count = len(self.joints)
        self.joints = np.concatenate([self.joints, joints])
        self.parent += parents
        return list(range(count, count + len(joints)))

    def list_branch(self, node: int) -> FloatArray:
        """Joint values (K, J) from the root to a node."""
        nodes = [node]
        while nodes[-1]:
            nodes.append(self.parent[nodes[-1]])
        return self.joints[nodes[::-1]]


def find_detour(setup: Setup, space: FreeSpace, a: FloatArray, b: FloatArray) -> FloatArray | None:
    """Find joint values (K, J) from `a` to `b` (J,) with free joint motions between them.

    The motions are proved. A detour with the margin is searched first if both ends keep it. Returns
    None if none is found.
    """
    both = np.stack([a, b])
    setups = [setup]
    if setup.roomy(both).all():
        setups.insert(0, replace(setup, clear=setup.roomy))
    scale = np.where(setup.robot.revolute, 1.0, 1.0 / setup.robot.lever)
    if not (are_within_limits(setup.robot, both) & setup.clear(both)).all():
        return None
    for searched in setups:
        for step in _STEPS:
            joint_space = _Space(searched, scale, step, MAX_SAMPLES)
            detour = _search(joint_space, a, b)
            if detour is None:
                break
            short = _shorten(joint_space, detour)
            results = space.look([SampledMotion(short), SampledMotion(detour)])
            for joints, result in zip((short, detour), results, strict=True):
                if not isinstance(result, Blockage):
                    return frozen(joints)
    return None


def _search(space: _Space, a: FloatArray, b: FloatArray) -> FloatArray | None:
    """Search joint values (K, J) from `a` to `b` with two trees, until the samples are used up."""
    rng = np.random.default_rng(0)
    trees = [_Tree(a[None], [-1]), _Tree(b[None], [-1])]
    targets = b[None]
    growing = 0
    while space.samples_left > 0:
        tree, other = trees[growing], trees[1 - growing]
        nodes = _grow(space, tree, targets, _BRANCH)
        if nodes:
            reached = _grow(space, other, tree.joints[nodes], np.inf)
            for node in nodes:
                match = _find_node(other, reached, tree.joints[node])
                if match is not None:
                    path = np.concatenate(
                        [tree.list_branch(node), other.list_branch(match)[-2::-1]]
                    )
                    return path if growing == 0 else path[::-1]
        growing = 1 - growing
        targets = _draw(space, rng, a, b)
    return None


def _grow(space: _Space, tree: _Tree, targets: FloatArray, max_length: float) -> list[int]:
    """Add nodes on the free part of lines from the nearest nodes towards `targets` (M, J).

    Returns their indices. max_length: length of the lines, rad.
    """
    nearest = tree.find_nearest(targets, space.scale)
    start = tree.joints[nearest]
    distance = np.linalg.norm((targets - start) * space.scale, axis=1)
    end = start + np.minimum(max_length / np.maximum(distance, 1e-9), 1.0)[:, None] * (
        targets - start
    )
    fraction = space.measure_free(start, end)
    added = np.flatnonzero(fraction * distance > 1e-6)
    # A node that reaches its target has exactly its joint values.
    is_whole = (fraction == 1.0)[:, None]
    joints = np.where(is_whole, end, start + fraction[:, None] * (end - start))[added]
    return tree.add(joints, nearest[added].tolist())


def _find_node(tree: _Tree, nodes: Sequence[int], joints: FloatArray) -> int | None:
    for node in nodes:
        if np.abs(tree.joints[node] - joints).max() < 1e-9:
            return node
    return None


def _draw(space: _Space, rng: np.random.Generator, a: FloatArray, b: FloatArray) -> FloatArray:
    """Random joint values (M, J): anywhere within the limits, and near the box around both ends."""
    low, high = space.setup.robot.limits.T
    distance = _NEAR_DISTANCE / space.scale
    near_low = np.clip(np.minimum(a, b) - distance, low, high)
    near_high = np.clip(np.maximum(a, b) + distance, low, high)
    count = int(_TARGETS * _NEAR_FRACTION)
    near = rng.uniform(near_low, near_high, (count, len(a)))
    return np.concatenate([near, rng.uniform(low, high, (_TARGETS - count, len(a)))])


def _shorten(space: _Space, path: FloatArray) -> FloatArray:
    """Replace sections of joint values (K, J) by lines where these are free and take less time."""
    rng = np.random.default_rng(1)
    speeds = space.setup.robot.speeds
    for _ in range(_CUTS):
        if len(path) < 3:
            break
        times = np.append(0.0, np.cumsum((np.abs(np.diff(path, axis=0)) / speeds).max(axis=1)))
        ends = np.sort(rng.uniform(0.0, times[-1], (_TARGETS, 2)), axis=1)
        ends[0] = times[0], times[-1]
        points = interpolate_rows(ends, times, path)
        saved = ends[:, 1] - ends[:, 0] - (np.abs(points[:, 1] - points[:, 0]) / speeds).max(axis=1)
        saved[space.measure_free(points[:, 0], points[:, 1]) < 1.0] = 0.0
        best = int(saved.argmax())
        if saved[best] > 1e-6:
            before, after = path[times < ends[best, 0]], path[times > ends[best, 1]]
            path = np.concatenate([before, points[best], after])
    return path
