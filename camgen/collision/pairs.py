"""Tests two bodies of which at least one is a mesh, and measures their distance.

The cuboids around both are tested first (`hits`). Where these meet, fcl measures the meshes. That
takes 0.2 to 5 ms, a thousand times as long as a test of cuboids, so each distance is kept:

- The pose of one body relative to the other depends only on the joints between them.
- A joint brings them nearer by no more than its angle times its lever.
- So the distance at the middle of a cell of joint values bounds the distances in all of the cell.

If there is one link between two links, one of the two is nearly round about its joint. The solid
that it sweeps about this joint is tested first (`swept`). The distance from the solid does not
depend on the joint, so there are far fewer cells.

Before a distance is measured for few joint values, two cheaper tests are tried: known points of
both bodies that are near enough, and the enlarged cuboids of one body against the mesh of the other
one, which takes fcl a tenth of the time.

The results of `come_within` and `meet` do not depend on the distances that were kept before: if the
bounds do not decide, fcl measures at the joint values themselves.

For fcl a mesh is a surface, so a body wholly within it does not meet it. The bodies of an arm are
connected, from a base that is outside: before one is within, another one meets the surface.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import fcl  # type: ignore[import-untyped]
import numpy as np
from msgspec import Struct

from camgen.collision.boxes import Boxes
from camgen.collision.mesh import (
    make_box_object,
    measure_distance,
)
from camgen.collision.swept import SweptSolid
from camgen.model.part import BoolArray, IntArray
from camgen.model.pose import FloatArray, Pose
from camgen.robots.kinematics.forward import compute_link_frames
from camgen.robots.models import Box, Robot

#: Sizes of cells: distance by which bodies may come nearer from the middle of a cell to its border,
#: mm; and the size of further cells for solids, whose distance depends on one joint.
_SLACKS_MM, _SMALL_SLACK_MM = (24.0, 3.0), 0.5
#: fcl tests this number of poses in the time of one distance.
_WORTH = 12
#: Number of joint values in a cell from which its distance is measured before each is tested alone.
_MANY = 6
#: Number of joint values at which cuboids are tried before all others, and the fraction of these at
#: which they have to decide.
_TRIES, _WORTH_SHARE = 8, 0.5
#: Cells and results that a pair keeps. Each takes about 200 bytes.
_MOST_KNOWN = 100_000
#: Joint values at which points of two bodies are compared together.
_ROWS = 256
#: Joint values are equal if these decimals are, rad or mm.
_DIGITS = 12
#: mm by which distances of fcl may be wrong: two ways to compute one differ by less.
_ROUNDING_MM = 1e-6


class Shape(Struct, frozen=True, eq=False):
    """A body for fcl.

    frame: index of the link that carries it, 0 for a body that stands.
    parts: geometries of fcl, and the pose of each in the frame of that link.
    points: (K, 3) some of its points, in the frame of that link.
    boxes: cuboids that hold it, in the frame of that link.
    is_mesh: whether it is a surface of triangles.
    """

    frame: int
    parts: tuple[tuple[Any, Pose], ...]
    points: FloatArray
    boxes: tuple[Box, ...]
    is_mesh: bool = True


class Sweep(Struct, frozen=True, eq=False):
    """The solid that is tested in place of one body of a pair.

    is_first: whether it replaces the first body.
    points: (N, 3) corners of the other body, in the frame of its link.
    """

    solid: SweptSolid
    is_first: bool
    points: FloatArray


class MeshPair(Struct, frozen=True, eq=False):
    """Two bodies and their known distances.

    frames: indices of the links that carry them.
    first: objects of fcl for the first body, in the frame of its link.
    second: objects of fcl for the second body, each with its pose in the frame of its link.
    second_at_rest: objects of fcl for the second body, in the frame of its link.
    points: some points of both bodies, each in the frame of its link.
    boxes: cuboids that hold the first and the second body, each in the frame of its link; empty if
        the other body is not a mesh.
    joints: (d,) indices of the joints between both links.
    levers: (d,) distance by which each of these brings the bodies nearer at most, mm per rad or mm.
    slacks: sizes of cells: distance by which the bodies may come nearer from the middle of a cell
        to its border, mm.
    known: known distances by cells, one table for each of `slacks`.
    meetings: whether the bodies meet, by the values of `joints`.
    wider: makes the pair with a solid around one of these bodies, which is tested first; None if
        there is no such pair.
    sweep: the solid, if this is such a pair.
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


def make_box_part(box: Box) -> tuple[Any, Pose]:
    """The geometry of fcl for a cuboid, and its pose in the frame of the link."""
    x, y, z = box.half
    return fcl.Box(2 * x, 2 * y, 2 * z), box.link_from_box


def make_pair(
    first: Shape,
    second: Shape,
    levers: FloatArray,
    wider: Callable[[], MeshPair | None] = lambda: None,
    sweep: Sweep | None = None,
) -> MeshPair:
    """The pair of two bodies.

    levers: (J,) distance by which each joint brings them nearer at most, mm per rad or mm; 0 for
        joints that are not between them, and for the joint of a swept body.
    wider, sweep: fields of `MeshPair`.
    """
    low, high = sorted((first.frame, second.frame))
    joints = np.arange(low, high)
    slacks: tuple[float, ...] = _SLACKS_MM
    if sweep is not None:
        joints = joints[1:] if sweep.is_first else joints[:-1]
        slacks += (_SMALL_SLACK_MM,)
    return MeshPair(
        (first.frame, second.frame),
        tuple(itertools.starmap(_make_object, first.parts)),
        tuple((fcl.CollisionObject(part[0]), part[1]) for part in second.parts),
        tuple(itertools.starmap(_make_object, second.parts)),
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


def _make_object(geometry: Any, pose: Pose) -> Any:
    return fcl.CollisionObject(geometry, fcl.Transform(pose.rotation, np.asarray(pose.origin)))


def come_within(robot: Robot, pair: MeshPair, joints: FloatArray, limit: FloatArray) -> BoolArray:
    """Whether the two bodies come within `limit` (N,) mm at joint values (N, J); 0 is to meet."""
    is_near = _have_near_points(robot, pair, joints, limit)
    rows = np.flatnonzero(~is_near)
    rows = rows[bound_distances(robot, pair, joints[rows], limit[rows]) <= limit[rows]]
    for row, placed in zip(rows.tolist(), _place_each(robot, pair, joints[rows]), strict=True):
        is_near[row] = _distance(pair, placed) <= limit[row]
    return is_near


def meet(robot: Robot, pair: MeshPair, joints: FloatArray) -> BoolArray:
    """Whether the two bodies meet at joint values (N, J).

    That takes fcl a tenth of the time of a distance. So known distances are used, and new ones are
    measured in cells of many joint values alone.
    """
    is_meeting = may_come_within(robot, pair, joints, np.zeros(len(joints)), worth=_WORTH)
    rows = np.flatnonzero(is_meeting)
    if len(pair.meetings) > _MOST_KNOWN:
        pair.meetings.clear()
    serial = (joints[rows] @ robot.coupling.T)[:, pair.joints]
    keys = [row.tobytes() for row in serial.round(_DIGITS)]
    untested = [k for k, key in enumerate(keys) if key not in pair.meetings]
    for k, placed in zip(untested, _place_each(robot, pair, joints[rows[untested]]), strict=True):
        pair.meetings[keys[k]] = _meet(pair, placed)
    is_meeting[rows] = [pair.meetings[key] for key in keys]
    return is_meeting


class Travel(Struct, frozen=True, eq=False):
    """The largest deviations from N joint values.

    turned: (N, J) deviation of each joint of the serial chain, rad or mm.
    extra: (N,) distance by which two bodies may be nearer for other reasons, mm.
    """

    turned: FloatArray
    extra: FloatArray

    def select(self, rows: IntArray | slice) -> Travel:
        """The deviations in some rows."""
        return Travel(self.turned[rows], self.extra[rows])


def may_come_within(
    robot: Robot,
    pair: MeshPair,
    joints: FloatArray,
    limit: FloatArray,
    travel: Travel | None = None,
    worth: int = 1,
) -> BoolArray:
    """Whether the bodies may come within `limit` (N,) mm at joint values (N, J).

    False if bounds prove a larger distance.

    travel: the largest deviations of the joint values, which are a part of `limit`. The joint about
        which a body sweeps its solid brings the solid no nearer.
    worth: number of joint values in a cell from which fcl measures its distance if it is not known.
    """
    is_near = np.ones(len(joints), dtype=np.bool_)
    if travel is not None and (wider := pair.wider()) is not None:
        solid_limit = travel.turned[:, wider.joints] @ wider.levers + travel.extra
        rows = np.flatnonzero(solid_limit < limit)
        bound = bound_distances(robot, wider, joints[rows], solid_limit[rows], worth)
        is_near[rows] = bound <= solid_limit[rows]
    rows = np.flatnonzero(is_near)
    rows = rows[~_have_near_points(robot, pair, joints[rows], limit[rows])]
    is_near[rows] = bound_distances(robot, pair, joints[rows], limit[rows], worth) <= limit[rows]
    return is_near


def _have_near_points(
    robot: Robot, pair: MeshPair, joints: FloatArray, limit: FloatArray
) -> BoolArray:
    """Whether two known points of the bodies are within `limit` (N,) mm at joint values (N, J)."""
    is_near = np.zeros(len(joints), dtype=np.bool_)
    positive = np.flatnonzero(limit > 0)
    first, second = pair.points
    for begin in range(0, len(positive), _ROWS):
        rows = positive[begin : begin + _ROWS]
        rotations, origins = _place(robot, pair, joints[rows])
        placed = second @ rotations.swapaxes(1, 2) + origins[:, None]
        squares = (placed**2).sum(axis=2)[:, :, None] + (first**2).sum(axis=1)
        squares -= 2 * (placed @ first.T)
        is_near[rows] = squares.min(axis=(1, 2)) <= limit[rows] ** 2
    return is_near


def measure_pair(robot: Robot, pair: MeshPair, joints: FloatArray) -> float:
    """The distance at joint values (J,), mm; 0 if the bodies meet."""
    (placed,) = _place_each(robot, pair, joints[None])
    return _distance(pair, placed)


def bound_distances(
    robot: Robot, pair: MeshPair, joints: FloatArray, enough: FloatArray, worth: int = 1
) -> FloatArray:
    """Lower bounds of the distance at joint values (N, J), mm (N,); they may be negative.

    enough: (N,) mm; no more is measured if a bound is above it, or if none can be.
    worth: argument of `may_come_within`.
    """
    bound = np.full(len(joints), -math.inf)
    if (wider := pair.wider()) is not None:
        bound = bound_distances(robot, wider, joints, enough, worth)
    is_open = _raise(robot, pair, joints, enough, bound, max(worth, _MANY))
    rows = np.flatnonzero(is_open & (bound <= enough))
    if worth < _MANY and len(rows):
        # A few joint values in a cell are tested faster one by one.
        margin = enough[rows] + 2 * _ROUNDING_MM
        far_rows = rows[_have_boxes_apart(robot, pair, joints[rows], margin)]
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
    """Raise `bound` (N,) to the bounds that cells prove.

    Returns False where the distance is known to be no more than `enough`, (N,).
    """
    is_open = np.ones(len(joints), dtype=np.bool_)
    for level, slack in enumerate(pair.slacks):
        rows = np.flatnonzero(is_open & (bound <= enough))
        if not len(rows):
            break
        raised, is_known = _bound(robot, pair, joints[rows], level, worth)
        bound[rows] = np.maximum(bound[rows], raised)
        # The distance is no more than the distance in the middle of the cell, plus its slack.
        is_open[rows] = ~is_known | (raised + 2 * (slack + _ROUNDING_MM) > enough[rows])
    return is_open


def _bound(
    robot: Robot, pair: MeshPair, joints: FloatArray, level: int, worth: int
) -> tuple[FloatArray, BoolArray]:
    """Lower bounds of the distance at joint values (N, J), mm (N,), and whether they are known.

    level: index in `slacks` of the size of the cells.
    worth: argument of `may_come_within`; the bound of an unknown cell is below 0.
    """
    width = 2 * pair.slacks[level] / np.maximum(len(pair.joints) * pair.levers, 1.0)
    serial = (joints @ robot.coupling.T)[:, pair.joints]
    cells = np.rint(serial / width).astype(np.int64)
    unique, cell_of, counts = np.unique(cells, axis=0, return_inverse=True, return_counts=True)
    known = pair.known[level]
    if len(known) > _MOST_KNOWN:
        known.clear()
    keys = list(map(tuple, unique.tolist()))
    unknown = [k for k, key in enumerate(keys) if counts[k] >= worth and key not in known]
    if unknown:
        middles = np.zeros((len(unknown), len(robot.joints)))
        middles[:, pair.joints] = unique[unknown] * width
        middles = np.asarray(np.linalg.solve(robot.coupling, middles.T).T)
        for k, placed in zip(unknown, _place_each(robot, pair, middles), strict=True):
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
    rotations, origins = compute_link_frames(robot, joints)
    first, second = pair.frames
    back = rotations[:, first].swapaxes(1, 2)
    offset = (origins[:, second] - origins[:, first])[..., None]
    return np.asarray(back @ rotations[:, second]), (back @ offset)[..., 0]


def _place_each(robot: Robot, pair: MeshPair, joints: FloatArray) -> Iterator[_Relative]:
    return zip(*_place(robot, pair, joints), strict=True)


def _move(pair: MeshPair, placed: _Relative) -> None:
    rotation, shift = placed
    for item, pose in pair.second:
        origin = shift + rotation @ np.asarray(pose.origin)
        item.setTransform(fcl.Transform(rotation @ pose.rotation, origin))


def _have_boxes_apart(
    robot: Robot, pair: MeshPair, joints: FloatArray, margin: FloatArray
) -> BoolArray:
    """Whether the cuboids of one body meet nothing of the other at joint values (N, J).

    Some joint values are tried first. If the cuboids are apart at few of them, the others are not
    tried, and count as False.

    margin: (N,) distance by which cuboids are larger on each side, mm.
    """
    rotation, shift = _place(robot, pair, joints)
    back = rotation.swapaxes(1, 2)
    shift_back = -(back @ shift[..., None])[..., 0]
    is_apart = np.zeros(len(joints), dtype=np.bool_)
    is_first = np.arange(len(joints)) % max(len(joints) // _TRIES, 1) == 0
    for meshes, boxes, (rotations, origins) in (
        (pair.first, pair.boxes[1], (rotation, shift)),
        (pair.second_at_rest, pair.boxes[0], (back, shift_back)),
    ):
        if not boxes:
            continue
        for tried in (is_first, ~is_first):
            rows = np.flatnonzero(tried & ~is_apart)
            if not len(rows):
                continue
            is_apart[rows] = True
            for box in boxes:
                pose = box.link_from_box
                centres = origins[rows] + rotations[rows] @ np.asarray(pose.origin)
                half = np.asarray(box.half) + margin[rows, None]
                grown = Boxes(centres, rotations[rows] @ pose.rotation, half)
                for k, row in enumerate(rows.tolist()):
                    is_apart[row] = is_apart[row] and not _meet_any(
                        meshes, [make_box_object(grown, k)]
                    )
            if is_apart[rows].mean() < _WORTH_SHARE:
                break
    return is_apart


def _distance(pair: MeshPair, placed: _Relative) -> float:
    # For fcl a solid is its surface, so bodies within the solid do not meet it.
    if pair.sweep is not None and _is_within(pair.sweep, placed):
        return 0.0
    _move(pair, placed)
    least = math.inf
    for item in pair.first:
        for other, _ in pair.second:
            least = min(least, measure_distance(item, other))
    return least


def _is_within(sweep: Sweep, placed: _Relative) -> bool:
    rotation, shift = placed
    if sweep.is_first:
        rotation, shift = rotation.T, -shift @ rotation
    return sweep.solid.holds_any(sweep.points, rotation, shift)


def _meet(pair: MeshPair, placed: _Relative) -> bool:
    _move(pair, placed)
    return _meet_any(pair.first, [item for item, _ in pair.second])


def _meet_any(first: Sequence[Any], second: Sequence[Any]) -> bool:
    for item in first:
        for other in second:
            if fcl.collide(item, other, fcl.CollisionRequest(), fcl.CollisionResult()):
                return True
    return False
