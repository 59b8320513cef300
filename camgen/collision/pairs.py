"""Two bodies of which at least one is a mesh: whether they meet, and their distance.

The cuboids around both are tested first (``hits``). Where these meet, fcl measures the meshes. That
takes 0.2 to 5 ms, a thousand times as long as a test of cuboids, so each distance is kept:

- The place of one body beside the other depends only on the joints between them.
- A joint brings them nearer by no more than its angle times its lever.
- So the distance at the middle of a cell of joint values bounds the distances in all of the cell.

Of two links with one link between them, one is nearly round about the joint beside it. A solid
around all that it sweeps takes its place first (``swept``): then that joint does not count, and
there are far fewer cells.

Before a distance is measured for a few questions alone, two cheaper answers are tried: known points
of both bodies that are near enough, and the cuboids of one body, enlarged, against the mesh of the
other one, which fcl answers in a tenth of the time.

The answers of `come_within` and `meet` do not depend on the distances that were kept before: if the
bounds do not decide, fcl measures at the joint values themselves.

For fcl a mesh is a surface, which a body wholly within it does not meet. The bodies of an arm hang
together, from a base that is outside: before one is within, another passes the surface.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from functools import lru_cache
from typing import Any

import fcl  # type: ignore[import-untyped]
import numpy as np
from msgspec import Struct

from camgen.collision.mesh import distance, join_surfaces, make_model, pick_outermost
from camgen.collision.swept import SweptSolid
from camgen.model.part import BoolArray, IntArray
from camgen.model.pose import FloatArray, Pose
from camgen.robots.kinematics.forward import frames
from camgen.robots.models import Box, Link, Robot

#: mm by which bodies may come nearer from the middle of a cell to its border, for each size; and
#: the size of more cells for solids, with one joint between them and a link.
_SLACKS_MM, _SMALL_SLACK_MM = (24.0, 3.0), 0.5
#: Meetings that take fcl as long as a distance.
_WORTH = 12
#: Questions in a cell for which its distance is measured before each is tried by itself.
_MANY = 6
#: Places at which cuboids are tried before all others, and the share of these at which they have to
#: answer.
_TRIES, _WORTH_SHARE = 8, 0.5
#: Cells and meetings that a pair keeps: they take some 200 bytes each.
_MOST_KNOWN = 100_000
#: Joint values at which points of two bodies are compared together.
_ROWS = 256
#: Decimals of joint values, rad or mm; the values are equal if these are.
_DIGITS = 12
#: mm by which fcl's distances may be off: two ways to compute one differ by less.
_ROUNDING_MM = 1e-6


class Shape(Struct, frozen=True, eq=False):
    """A body as fcl has it.

    frame: number of the link that carries it, 0 for a body that stands.
    parts: fcl's geometries, and the pose of each in that link's frame.
    points: (K, 3) some of its points, in that link's frame.
    boxes: cuboids that hold it, in that link's frame.
    is_mesh: whether it is a surface of triangles.
    """

    frame: int
    parts: tuple[tuple[Any, Pose], ...]
    points: FloatArray
    boxes: tuple[Box, ...]
    is_mesh: bool = True


class Sweep(Struct, frozen=True, eq=False):
    """A body of which the solid that it sweeps is tested.

    solid: the solid.
    is_first: whether that is the first body.
    points: (N, 3) corners of the other body, in its link's frame.
    """

    solid: SweptSolid
    is_first: bool
    points: FloatArray


class MeshPair(Struct, frozen=True, eq=False):
    """Two bodies and their known distances.

    frames: the links that carry them.
    first: fcl's objects of the first body, in its link's frame.
    second: fcl's objects of the second one, each with its pose in its link's frame.
    second_at_rest: the same in its link's frame.
    points: some points of both bodies, each in its link's frame.
    boxes: cuboids that hold the first and the second body, each in its link's frame; empty where
        the other body is not a mesh.
    joints: (d,) the joints of the chain between both links.
    levers: (d,) mm per rad or mm of each, by which the bodies come nearer at most.
    slacks: mm by which they come nearer from the middle of a cell to its border, for each size.
    known: distances by cells, one table for each of ``slacks``.
    meetings: whether the bodies meet, by the values of ``joints``.
    wider: the pair with a solid around one of these bodies, which is tested first, if there is one;
        made where it is asked for.
    sweep: the body of this pair that is such a solid.
    """

    frames: tuple[int, int]
    first: tuple[Any, ...]
    second: tuple[tuple[Any, Pose], ...]
    second_at_rest: tuple[Any, ...]
    points: tuple[FloatArray, FloatArray]
    boxes: tuple[tuple[Box, ...], tuple[Box, ...]]
    joints: IntArray
    levers: FloatArray
    slacks: tuple[float, ...]
    known: tuple[dict[tuple[int, ...], float], ...]
    meetings: dict[bytes, bool]
    wider: Callable[[], MeshPair | None] = lambda: None
    sweep: Sweep | None = None


@lru_cache(maxsize=64)
def model_of(link: Link) -> Any:
    """Fcl's model of all surfaces of a link, made once for any number of scenes."""
    return make_model(*join_surfaces(link))


@lru_cache(maxsize=64)
def link_points(link: Link) -> FloatArray:
    """The corners (K, 3) of the surfaces of a link that lie farthest outward."""
    return pick_outermost(join_surfaces(link)[0])


def box_part(box: Box) -> tuple[Any, Pose]:
    """A cuboid as fcl has it, and its pose in the link's frame."""
    x, y, z = box.half
    return fcl.Box(2 * x, 2 * y, 2 * z), box.link_from_box


def pair_up(
    first: Shape,
    second: Shape,
    levers: FloatArray,
    wider: Callable[[], MeshPair | None] = lambda: None,
    sweep: Sweep | None = None,
) -> MeshPair:
    """The pair of two bodies.

    levers: (J,) mm per rad or mm of each joint, 0 for joints that are not between them, and for
        that of a swept body.
    wider, sweep: fields of ``MeshPair``.
    """
    low, high = sorted((first.frame, second.frame))
    joints = np.arange(low, high)
    slacks: tuple[float, ...] = _SLACKS_MM
    if sweep is not None:
        joints = joints[1:] if sweep.is_first else joints[:-1]
        slacks += (_SMALL_SLACK_MM,)
    return MeshPair(
        (first.frame, second.frame),
        tuple(fcl.CollisionObject(*_with_transform(*part)) for part in first.parts),
        tuple((fcl.CollisionObject(part[0]), part[1]) for part in second.parts),
        tuple(fcl.CollisionObject(*_with_transform(*part)) for part in second.parts),
        (first.points, second.points),
        (first.boxes if second.is_mesh else (), second.boxes if first.is_mesh else ()),
        joints,
        levers[joints],
        slacks,
        tuple({} for _ in slacks),
        {},
        wider,
        sweep,
    )


def _with_transform(geometry: Any, pose: Pose) -> tuple[Any, Any]:
    return geometry, fcl.Transform(pose.rotation, np.asarray(pose.origin))


def come_within(robot: Robot, pair: MeshPair, joints: FloatArray, room: FloatArray) -> BoolArray:
    """At which joint values (N, J) the two bodies come within ``room`` (N,), mm; at 0: meet."""
    met = _have_near_points(robot, pair, joints, room)
    left = np.flatnonzero(~met)
    left = left[at_least(robot, pair, joints[left], room[left]) <= room[left]]
    for row, placed in zip(left.tolist(), _each(robot, pair, joints[left]), strict=True):
        met[row] = _distance(pair, placed) <= room[row]
    return met


def meet(robot: Robot, pair: MeshPair, joints: FloatArray) -> BoolArray:
    """At which joint values (N, J) the two bodies meet.

    fcl takes a tenth of the time of a distance for it. So known distances are used, and new ones
    are measured in cells of many questions alone.
    """
    met = may_come_within(robot, pair, joints, np.zeros(len(joints)), worth=_WORTH)
    left = np.flatnonzero(met)
    if len(pair.meetings) > _MOST_KNOWN:
        pair.meetings.clear()
    serial = (joints[left] @ robot.coupling.T)[:, pair.joints]
    keys = [row.tobytes() for row in serial.round(_DIGITS)]
    new = [k for k, key in enumerate(keys) if key not in pair.meetings]
    for k, placed in zip(new, _each(robot, pair, joints[left[new]]), strict=True):
        pair.meetings[keys[k]] = _meet(pair, placed)
    met[left] = [pair.meetings[key] for key in keys]
    return met


class Travel(Struct, frozen=True, eq=False):
    """The largest deviations from N joint values.

    turned: (N, J) rad or mm, of each joint of the serial chain.
    more: (N,) mm by which two bodies may be nearer beside that.
    """

    turned: FloatArray
    more: FloatArray

    def select(self, rows: IntArray | slice) -> Travel:
        """The deviations in some rows."""
        return Travel(self.turned[rows], self.more[rows])


def may_come_within(
    robot: Robot,
    pair: MeshPair,
    joints: FloatArray,
    room: FloatArray,
    travel: Travel | None = None,
    worth: int = 1,
) -> BoolArray:
    """At which joint values (N, J) bounds prove no distance above ``room`` (N,), mm.

    travel: the largest deviations of the joint values, which are a part of ``room``. The joint
        about which a body sweeps its solid brings the solid no nearer.
    worth: questions in a cell for which fcl measures its distance if that is not known.
    """
    met = np.ones(len(joints), dtype=np.bool_)
    if travel is not None and (wider := pair.wider()) is not None:
        solid_room = travel.turned[:, wider.joints] @ wider.levers + travel.more
        rows = np.flatnonzero(solid_room < room)
        bound = at_least(robot, wider, joints[rows], solid_room[rows], worth)
        met[rows] = bound <= solid_room[rows]
    left = np.flatnonzero(met)
    left = left[~_have_near_points(robot, pair, joints[left], room[left])]
    met[left] = at_least(robot, pair, joints[left], room[left], worth) <= room[left]
    return met


def _have_near_points(
    robot: Robot, pair: MeshPair, joints: FloatArray, room: FloatArray
) -> BoolArray:
    """At which joint values (N, J) two known points of the bodies are within ``room`` (N,), mm."""
    near = np.zeros(len(joints), dtype=np.bool_)
    roomy = np.flatnonzero(room > 0)
    first, second = pair.points
    for begin in range(0, len(roomy), _ROWS):
        rows = roomy[begin : begin + _ROWS]
        turned, shifted = _place(robot, pair, joints[rows])
        placed = second @ turned.swapaxes(1, 2) + shifted[:, None]
        squares = (placed**2).sum(axis=2)[:, :, None] + (first**2).sum(axis=1)
        squares -= 2 * (placed @ first.T)
        near[rows] = squares.min(axis=(1, 2)) <= room[rows] ** 2
    return near


def measure(robot: Robot, pair: MeshPair, joints: FloatArray) -> float:
    """The distance at joint values (J,), mm; 0 where the bodies meet."""
    (placed,) = _each(robot, pair, joints[None])
    return _distance(pair, placed)


def at_least(
    robot: Robot, pair: MeshPair, joints: FloatArray, enough: FloatArray, worth: int = 1
) -> FloatArray:
    """No more than the distance at joint values (N, J), mm (N,); it may be negative.

    enough: (N,) mm; nothing more is measured for a bound that is more, nor where none can be.
    worth: argument of ``may_come_within``.
    """
    bound = np.full(len(joints), -math.inf)
    if (wider := pair.wider()) is not None:
        bound = at_least(robot, wider, joints, enough, worth)
    is_open = _raise(robot, pair, joints, enough, bound, max(worth, _MANY))
    left = np.flatnonzero(is_open & (bound <= enough))
    if worth < _MANY and len(left):
        # A few questions in a cell are answered sooner one by one.
        wide = enough[left] + 2 * _ROUNDING_MM
        far_rows = left[_have_boxes_apart(robot, pair, joints[left], wide)]
        bound[far_rows] = enough[far_rows] + _ROUNDING_MM
        _raise(robot, pair, joints, enough, bound, worth)
    return bound


def _raise(
    robot: Robot,
    pair: MeshPair,
    joints: FloatArray,
    enough: FloatArray,
    bound: FloatArray,
    worth: int,
) -> BoolArray:
    """Raise ``bound`` (N,) to what cells prove.

    Returns where it is not known that the distance is no more than ``enough``, (N,).
    """
    is_open = np.ones(len(joints), dtype=np.bool_)
    for level, slack in enumerate(pair.slacks):
        left = np.flatnonzero(is_open & (bound <= enough))
        if not len(left):
            break
        more, is_known = _bound(robot, pair, joints[left], level, worth)
        bound[left] = np.maximum(bound[left], more)
        # The distance is no more than that in the middle of the cell and its slack.
        is_open[left] = ~is_known | (more + 2 * (slack + _ROUNDING_MM) > enough[left])
    return is_open


def _bound(
    robot: Robot, pair: MeshPair, joints: FloatArray, level: int, worth: int
) -> tuple[FloatArray, BoolArray]:
    """The least that the distance can be at joint values (N, J), mm (N,), and where it is known.

    worth: argument of ``may_come_within``; the bound of an unknown cell is below 0.
    """
    width = 2 * pair.slacks[level] / np.maximum(len(pair.joints) * pair.levers, 1.0)
    serial = (joints @ robot.coupling.T)[:, pair.joints]
    cells = np.rint(serial / width).astype(np.int64)
    unique, cell_of, counts = np.unique(cells, axis=0, return_inverse=True, return_counts=True)
    known = pair.known[level]
    if len(known) > _MOST_KNOWN:
        known.clear()
    keys = list(map(tuple, unique.tolist()))
    new = [k for k, key in enumerate(keys) if counts[k] >= worth and key not in known]
    if new:
        middles = np.zeros((len(new), len(robot.joints)))
        middles[:, pair.joints] = unique[new] * width
        middles = np.asarray(np.linalg.solve(robot.coupling, middles.T).T)
        for k, placed in zip(new, _each(robot, pair, middles), strict=True):
            known[keys[k]] = _distance(pair, placed)
    middle = np.array([known.get(key, math.nan) for key in keys])[cell_of.ravel()]
    is_known = ~np.isnan(middle)
    slack = np.abs(serial - cells * width) @ pair.levers + _ROUNDING_MM
    return np.where(is_known, middle, 0.0) - slack, is_known


#: The second body's link in the frame of the first one's: rotations (N, 3, 3) and origins (N, 3),
#: mm, or one of each.
_Relative = tuple[FloatArray, FloatArray]


def _place(robot: Robot, pair: MeshPair, joints: FloatArray) -> _Relative:
    """The second body's link in the frame of the first one's, at joint values (N, J)."""
    rotations, origins = frames(robot, joints)
    first, second = pair.frames
    back = rotations[:, first].swapaxes(1, 2)
    turned = np.asarray(back @ rotations[:, second])
    shifted = (back @ (origins[:, second] - origins[:, first])[..., None])[..., 0]
    return turned, shifted


def _each(robot: Robot, pair: MeshPair, joints: FloatArray) -> Iterator[_Relative]:
    """``_place`` at each of the joint values (N, J)."""
    return zip(*_place(robot, pair, joints), strict=True)


def _move(pair: MeshPair, placed: _Relative) -> None:
    """Put the second body's objects where they are."""
    turned, shifted = placed
    for item, pose in pair.second:
        origin = shifted + turned @ np.asarray(pose.origin)
        item.setTransform(fcl.Transform(turned @ pose.rotation, origin))


def _have_boxes_apart(
    robot: Robot, pair: MeshPair, joints: FloatArray, room: FloatArray
) -> BoolArray:
    """At which joint values (N, J) the cuboids of one body meet nothing of the other, (N,).

    room: (N,) mm by which cuboids are larger on each side.
    Some places are tried first. If it is true at few of them, the others are not tried.
    """
    turned, shifted = _place(robot, pair, joints)
    back = turned.swapaxes(1, 2)
    moved_back = -(back @ shifted[..., None])[..., 0]
    is_apart = np.zeros(len(joints), dtype=np.bool_)
    is_first = np.arange(len(joints)) % max(len(joints) // _TRIES, 1) == 0
    for meshes, boxes, (rotations, origins) in (
        (pair.first, pair.boxes[1], (turned, shifted)),
        (pair.second_at_rest, pair.boxes[0], (back, moved_back)),
    ):
        if not boxes:
            continue
        for tried in (is_first, ~is_first):
            left = np.flatnonzero(tried & ~is_apart)
            if not len(left):
                continue
            is_apart[left] = True
            for box in boxes:
                pose = box.link_from_box
                axes = rotations[left] @ pose.rotation
                centres = origins[left] + rotations[left] @ np.asarray(pose.origin)
                sizes = 2 * (np.asarray(box.half) + room[left, None])
                for row, *placed in zip(left.tolist(), axes, centres, sizes.tolist(), strict=True):
                    is_apart[row] = is_apart[row] and not _meet_any(meshes, [_make_box(*placed)])
            if is_apart[left].mean() < _WORTH_SHARE:
                break
    return is_apart


def _make_box(axes: FloatArray, centre: FloatArray, sizes: list[float]) -> Any:
    return fcl.CollisionObject(fcl.Box(*sizes), fcl.Transform(axes, centre))


def _distance(pair: MeshPair, placed: _Relative) -> float:
    # To fcl a solid is its surface, and bodies within the solid are apart from it.
    if pair.sweep is not None and _is_within(pair.sweep, placed):
        return 0.0
    _move(pair, placed)
    least = math.inf
    for item in pair.first:
        for other, _ in pair.second:
            least = min(least, distance(item, other))
    return least


def _is_within(sweep: Sweep, placed: _Relative) -> bool:
    """Whether a corner of the other body is within the solid."""
    turned, shifted = placed
    if sweep.is_first:
        turned, shifted = turned.T, -shifted @ turned
    return sweep.solid.holds_any(sweep.points, turned, shifted)


def _meet(pair: MeshPair, placed: _Relative) -> bool:
    _move(pair, placed)
    return _meet_any(pair.first, [item for item, _ in pair.second])


def _meet_any(first: Sequence[Any], second: Sequence[Any]) -> bool:
    """Whether any of fcl's objects meets one of the second ones."""
    for item in first:
        for other in second:
            if fcl.collide(item, other, fcl.CollisionRequest(), fcl.CollisionResult()):
                return True
    return False
