"""Which configurations collide."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from msgspec import Struct

from camgen.collision.boxes import Boxes, least_apart, meet
from camgen.collision.mesh import body, distance, find_struck, may_strike
from camgen.collision.scene import Scene, Target
from camgen.geometry.ragged import ramp, run_lengths
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
        pair = _grow(scene, bare, (row, box), grow[rows], None if closing is None else closing[rows])
        met = meet(pair[0].grown(near[rows][row, None]), pair[1])
        # Of several values for one place the last one stays: the first pair, since they come backwards.
        found[rows][row[met][::-1]] = scene.of_pair[box[met][::-1]]
        for target in scene.targets:
            _against(target, placed, found[rows])
    return found


def _grow(
    scene: Scene, bare: Boxes, which: tuple[IntArray, IntArray], grow: FloatArray, closing: FloatArray | None
) -> tuple[Boxes, Boxes]:
    """The boxes of the pairs ``which`` (rows and pairs of boxes), larger by what each of them or both together grow."""
    row, box = which
    first, second = scene.first[box], scene.second[box]
    one, other = grow[row, first], grow[row, second]
    if closing is not None:
        both = closing[which]
        less = both < one + other
        one, other = np.where(less, both, one), np.where(less, 0.0, other)
    return bare[row, first].grown(one[:, None]), bare[row, second].grown(other[:, None])


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
    rows = rotations.swapaxes(0, 1)[scene.frame].reshape(count, 3 * len(joints), 3)
    turned = rows @ np.concatenate([scene.rotation, scene.origin[..., None]], axis=2)
    turned = turned.reshape(count, len(joints), 3, 4)
    centres = origins[:, scene.frame] + turned[..., 3].swapaxes(0, 1)
    axes = np.ascontiguousarray(turned[..., :3].swapaxes(0, 1))
    return Boxes(centres, axes, np.broadcast_to(scene.half, centres.shape))


def near_pairs(scene: Scene, placed: Boxes) -> tuple[IntArray, IntArray]:
    """Row and pair of boxes (n,), in order, whose boxes square to the base meet."""
    reach = placed.reach
    near = np.ones((len(reach), len(scene.first)), dtype=bool)
    for axis in range(3):
        at, room = placed.centres[..., axis], reach[..., axis]
        near &= np.abs(at[:, scene.first] - at[:, scene.second]) <= room[:, scene.first] + room[:, scene.second]
    row, box = np.nonzero(near)
    return row, box


def near_mesh(target: Target, placed: Boxes) -> tuple[IntArray, IntArray, Boxes]:
    """Row and place in ``target.striking`` of boxes (n,), in order, that meet the box around the mesh and may strike
    it, and these boxes in the mesh's frame.
    """
    mesh = target.mesh
    rotation, origin = target.base_from_mesh.rotation, np.asarray(target.base_from_mesh.origin)
    around = Boxes(rotation @ mesh.box.centres + origin, rotation, mesh.box.half)
    room = placed.reach[:, target.striking] + around.reach
    apart = np.abs(placed.centres[:, target.striking] - around.centres) <= room
    row, which = np.nonzero(apart[..., 0] & apart[..., 1] & apart[..., 2])
    # Most are told apart by the ball around them, without the axes.
    ball = np.sqrt((placed.half**2).sum(axis=-1))
    box = target.striking[which]
    close = may_strike(mesh, (placed.centres[row, box] - origin) @ rotation, ball[row, box])
    row, which = row[close], which[close]
    boxes = placed[row, target.striking[which]].seen_from(rotation, origin)
    count = len(row)
    whole = Boxes(*(np.broadcast_to(a, (count, *a.shape)) for a in (mesh.box.centres, mesh.box.axes, mesh.box.half)))
    met = meet(whole, boxes)
    return row[met], which[met], boxes[met]


def _against(target: Target, placed: Boxes, found: IntArray) -> None:
    """Fill in the pairs with the mesh for configurations that have none yet."""
    free = np.flatnonzero(found < 0)
    row, which, boxes = near_mesh(target, placed[free])
    met = np.flatnonzero(find_struck(target.mesh, boxes))[::-1]
    found[free[row[met]]] = target.of_strike[which[met]]


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
    least = np.where(hits(scene, joints) < 0, near, 0.0)
    free = np.flatnonzero(least)
    _lower(scene, joints[free], free, _Found.beyond(least))
    return least


def least(scene: Scene, joints: FloatArray, near: float) -> Nearest:
    """The least of ``clearance`` for configurations (N, J) that do not collide, and its place; cheaper than each."""
    return least_of_each(scene, joints, np.zeros(len(joints), dtype=np.int64), np.array([near]))[0]


def least_of_each(scene: Scene, joints: FloatArray, owner: IntArray, near: FloatArray) -> list[Nearest]:
    """``least`` for each of n groups of configurations. owner: (N,) the group of each. near: (n,) mm."""
    found = _Found.beyond(near.copy())
    _lower(scene, joints, owner, found)
    columns = (column.tolist() for column in (found.distance, found.row, found.pair))
    return [Nearest(*one) for one in zip(*columns, strict=True)]


def _lower(scene: Scene, joints: FloatArray, place_of: IntArray, found: _Found) -> None:
    """Lower ``found`` at ``place_of`` (N,) to the distances at the configurations (N, J)."""
    for begin in range(0, len(joints), ROWS):
        rows = np.arange(begin, min(begin + ROWS, len(joints)))
        placed = place(scene, joints[rows])
        _between(scene, placed, rows, place_of, found)
        for target in scene.targets:
            _to_mesh(target, placed, rows, place_of, found)


def _between(scene: Scene, placed: Boxes, rows: IntArray, place_of: IntArray, found: _Found) -> None:
    wide = placed.grown(found.distance[place_of[rows]][:, None, None] * scene.moving[:, None])
    row, which = near_pairs(scene, wide)
    first, second = placed[row, scene.first[which]], placed[row, scene.second[which]]
    bound = least_apart(first, second)
    _measure(
        _Asked(place_of[rows[row]], rows[row], scene.of_pair[which], bound),
        found,
        lambda some, by: bound[some] < by,
        lambda k: distance(body(first, k), body(second, k)),
    )


def _to_mesh(target: Target, placed: Boxes, rows: IntArray, place_of: IntArray, found: _Found) -> None:
    row, which, wide = near_mesh(target, placed.grown(found.distance[place_of[rows]][:, None, None]))
    boxes = Boxes(wide.centres, wide.axes, placed.half[row, target.striking[which]])
    _measure(
        _Asked(place_of[rows[row]], rows[row], target.of_strike[which], np.zeros(len(row))),
        found,
        lambda some, by: find_struck(target.mesh, boxes[some].grown(by[:, None])),
        lambda k: distance(target.mesh.surface, body(boxes, k)),
    )


class _Asked(Struct, frozen=True, eq=False):
    """Candidates (n,) for the nearest: the place that each is asked for, its configuration, its pair, and mm that it is
    apart at least.
    """

    place: IntArray
    row: IntArray
    pair: IntArray
    bound: FloatArray


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
    mixed = np.random.default_rng(0).permutation(len(asked.place))
    left = mixed[np.lexsort((asked.bound[mixed], asked.place[mixed]))]
    many = 1
    while len(left):
        left = left[within(left, np.maximum(found.distance[asked.place[left]] - _SAME_DISTANCE_MM, 0.0))]
        now = ramp(run_lengths(asked.place[left])) < many
        for k in left[now].tolist():
            at = asked.place[k]
            if asked.bound[k] < found.distance[at] and (far := measured(k)) < found.distance[at]:
                found.distance[at], found.row[at], found.pair[at] = far, asked.row[k], asked.pair[k]
        left = left[~now]
        many *= 2
