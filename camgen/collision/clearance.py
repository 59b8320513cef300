"""How far what may collide is apart."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from camgen.collision.boxes import Boxes, meet
from camgen.collision.hits import hits, near_mesh, near_pairs, place
from camgen.collision.mesh import body, distance, struck
from camgen.collision.scene import Scene, Target
from camgen.pose import FloatArray
from camgen.solid import BoolArray, IntArray

_ROWS = 1024
#: mm that distances must differ by to be told apart.
_SAME = 1e-6


def clearance(scene: Scene, joints: FloatArray, near: float) -> FloatArray:
    """The least distance (N,), mm, of all pairs at each configuration (N, J); 0 where it collides, ``near`` where all
    are as far apart or farther. True to 1e-6 mm; the cost grows with what lies within ``near``.
    """
    joints = np.asarray(joints, dtype=np.float64)
    least = np.where(hits(scene, joints) < 0, near, 0.0)
    free = np.flatnonzero(least)
    _lower(scene, joints[free], free, least)
    return least


def least(scene: Scene, joints: FloatArray, near: float) -> float:
    """The least of ``clearance`` for configurations (N, J) that do not collide: cheaper than that of each."""
    found = np.array([near])
    _lower(scene, joints, np.zeros(len(joints), dtype=np.int64), found)
    return float(found[0])


def _lower(scene: Scene, joints: FloatArray, place_of: IntArray, found: FloatArray) -> None:
    """Lower ``found`` at ``place_of`` (N,) to the distances at the configurations (N, J)."""
    for begin in range(0, len(joints), _ROWS):
        rows = slice(begin, begin + _ROWS)
        placed = place(scene, joints[rows])
        _between(scene, placed, place_of[rows], found)
        for target in scene.targets:
            _to_mesh(target, placed, place_of[rows], found)


def _between(scene: Scene, placed: Boxes, place_of: IntArray, found: FloatArray) -> None:
    wide = placed.grown(found[place_of][:, None, None] * scene.moving[:, None])
    row, which = near_pairs(scene, wide)
    first, second = placed[row, scene.first[which]], placed[row, scene.second[which]]
    _measured(
        place_of[row],
        found,
        lambda some, by: meet(first[some].grown(by), second[some]),
        lambda k: distance(body(first, k), body(second, k)),
    )


def _to_mesh(target: Target, placed: Boxes, place_of: IntArray, found: FloatArray) -> None:
    row, which, wide = near_mesh(target, placed.grown(found[place_of][:, None, None]))
    boxes = Boxes(wide.centres, wide.axes, placed.half[row, target.striking[which]])
    _measured(
        place_of[row],
        found,
        lambda some, by: struck(target.mesh, boxes[some].grown(by)),
        lambda k: distance(target.mesh.surface, body(boxes, k)),
    )


def _measured(
    place_of: IntArray,
    found: FloatArray,
    touches: Callable[[IntArray, FloatArray], BoolArray],
    measured: Callable[[int], float],
) -> None:
    """Lower ``found`` at ``place_of`` (n,) to the distances of n candidates.

    fcl's distance takes a hundred times as long as a yes or no. So one candidate of each place is measured, and only
    those stay that ``touches`` others when grown by less than that: what lies within a distance of a box is in the
    box grown by it. In any order but that along a motion, few rounds are needed.
    """
    left = np.random.default_rng(0).permutation(len(place_of))
    while len(left := left[touches(left, np.maximum(found[place_of[left]] - _SAME, 0.0)[:, None])]):
        _, first = np.unique(place_of[left], return_index=True)
        for k in left[first].tolist():
            found[place_of[k]] = min(found[place_of[k]], measured(k))
        left = np.delete(left, first)
