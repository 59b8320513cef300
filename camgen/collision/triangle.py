"""Is a whole triangle of configurations free? That is what lies between a corner and every way that rounds it."""

from __future__ import annotations

import numpy as np

from camgen.collision.hits import finite, hits
from camgen.collision.motion import closing, levers
from camgen.collision.scene import Scene
from camgen.model.part import BoolArray
from camgen.model.pose import FloatArray

#: So often a triangle is split.
_SPLITS = 4
#: A triangle as four of half its size: rows of its corners and of the middles of its sides, 01, 12 and 20.
_FOUR = np.array([[0, 3, 5], [3, 1, 4], [5, 4, 2], [3, 4, 5]])


def are_free(scene: Scene, corners: FloatArray, near: float = 0.0, apart: FloatArray | float = 0.0) -> BoolArray:
    """Which of K triangles of configurations (K, 3, J), rad or mm, hold none at which bodies come within ``near`` mm
    (K,). apart: mm, (K,) or one for all, that any point of a body may be off.

    A triangle is free where, at its middle, boxes grown by all that they move within it meet nothing; else it is split
    in four, ``_SPLITS`` times: what is not found free then is taken not to be.
    """
    found = np.ones(len(corners), dtype=bool)
    serial = finite(corners.reshape(-1, corners.shape[-1])) @ scene.robot.coupling.T
    travel = np.abs(serial).max(axis=0, initial=0.0)
    lever, close = levers(scene, travel), closing(scene, travel)
    owner, left, off = np.arange(len(corners)), corners, np.broadcast_to(apart, len(corners))
    for depth in range(_SPLITS + 1):
        if not len(left):
            break
        middle = left.mean(axis=1)
        around = np.abs((left - middle[:, None]) @ scene.robot.coupling.T).max(axis=1)
        grow = around @ lever
        more = off[owner]
        met = hits(scene, middle, grow + more[:, None], around @ close + 2 * more[:, None], near) >= 0
        met[met] = found[owner[met]]
        bad = met.copy()
        if depth < _SPLITS:
            # What collides at its middle need not be split.
            bad[met] = hits(scene, middle[met], more[met, None], None, near) >= 0
        found[owner[bad]] = False
        met &= found[owner]
        six = np.concatenate([left[met], (left[met] + left[met][:, [1, 2, 0]]) / 2], axis=1)
        left, owner = six[:, _FOUR].reshape(-1, *left.shape[1:]), np.repeat(owner[met], len(_FOUR))
    return found
