"""The motions of a program as rows of poses, and joint motions between rows as rows of joints: what is to be looked at.

Lines and arcs are cut into short pieces; joint-interpolated motions are known only once their ends are.
"""

from __future__ import annotations

import math

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from camgen.edges.ways import Index, Way, counts, divided, rows
from camgen.ir import MoveJ, Program
from camgen.pose import FloatArray
from camgen.robots.forward import flange
from camgen.robots.models import Robot

#: Rows along a motion are at most so far apart: mm of the TCP or of the flange; rad of the tool; of an arc; of a joint.
STEP, _TURN, _SWEEP, _JOINT = 10.0, math.radians(10.0), math.radians(40.0), math.radians(2.0)


class Rows(Struct, frozen=True, eq=False):
    """R rows on the way of M motions. way: the TCP in the work frame; row 0 is where the first motion ends. motion:
    (R,) the motion that each row belongs to. at: (M,) the row in which each motion ends. free: (R,) rows to which the
    joints are interpolated from the row before.
    """

    way: Way
    motion: Index
    at: Index
    free: NDArray[np.bool_]


def sampled(program: Program, way: Way) -> Rows:
    """The rows of ``program``. way: of the TCP, a row for each motion."""
    free = program.columns.moves_are(MoveJ)
    way, own = _through_middles(way, program)
    parts = np.where(
        free[own[1:]], 1, np.maximum(counts(way, STEP, _TURN), np.ceil(_sweep(way) / _SWEEP).astype(np.int64))
    )
    motion = np.concatenate([own[:1], np.repeat(own[1:], parts)])
    at = np.flatnonzero(np.append(motion[1:] != motion[:-1], True))
    return Rows(divided(way, parts), motion, at, free[motion])


def ends(program: Program, robot: Robot, anchors: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Positions (M, 3) and rotations (M, 3, 3) of the TCP in the work frame where motions end."""
    columns = program.columns
    posed, position = columns.posed, columns.ends.copy()
    rotation = np.empty((len(posed), 3, 3))
    targets = [columns.moves[k].target.rotation for k in np.flatnonzero(posed).tolist()]
    seen = {id(one): one for one in targets}
    place = {key: k for k, key in enumerate(seen)}
    if targets:
        rotation[posed] = np.stack(list(seen.values()))[[place[id(one)] for one in targets]]
    turned, origin = flange(robot, anchors)
    tool, base = program.flange_from_tool, program.base_from_work
    rotation[~posed] = base.rotation.T @ turned @ tool.rotation
    position[~posed] = (origin + turned @ np.asarray(tool.origin) - np.asarray(base.origin)) @ base.rotation
    return position, rotation


def _through_middles(way: Way, program: Program) -> tuple[Way, Index]:
    """The way with a row in the middle of each arc along which the tool turns, where it stands as at the via point:
    half a turn has no shorter way. And the motion that each row belongs to.
    """
    turning = np.append(False, ~np.isnan(way.via[1:, 0]) & (way.rotation[1:] != way.rotation[:-1]).any(axis=(1, 2)))
    parts = np.where(turning[1:], 2, 1)
    own = np.concatenate([[0], np.repeat(np.arange(1, len(way)), parts)])
    if not turning.any():
        return way, own
    finer = divided(way, parts)
    rotation = finer.rotation.copy()
    vias = [program.columns.moves[k].via.rotation for k in np.flatnonzero(turning).tolist()]
    rotation[rows(parts)[turning] - 1] = np.stack(vias)
    return Way(finer.position, finer.via, rotation), own


def _sweep(way: Way) -> FloatArray:
    """(N - 1,) rad of each segment, 0 for a straight one."""
    chord = way.position[1:] - way.position[:-1]
    height = np.linalg.norm(way.via[1:] - way.position[:-1] - chord / 2, axis=1)
    return np.asarray(np.nan_to_num(4 * np.arctan2(2 * height, np.linalg.norm(chord, axis=1))))


def interpolated(robot: Robot, joints: FloatArray, free: NDArray[np.bool_]) -> tuple[FloatArray, Index]:
    """The joint values (R, J) with more rows on the way to those in ``free`` (R,), all joints together: no joint turns
    by more than 2 deg from row to row, and the flange moves by about 10 mm at most. And where the old rows are (R,).
    """
    turning = np.array([not joint.sliding for joint in robot.joints])
    angle = (np.abs(np.diff(joints, axis=0)) * turning).max(axis=1, initial=0.0)
    parts = np.where(free[1:], np.maximum(np.ceil(angle / _JOINT - 1e-9), 1), 1).astype(np.int64)
    if not free[1:].any():
        return joints, rows(parts)
    dense = _between(joints, parts)
    own = np.repeat(free[1:], parts)
    looked = np.append(own, False) | np.append(False, own)
    place = np.zeros((len(dense), 3))
    place[looked] = flange(robot, dense[looked])[1]
    moved = np.linalg.norm(np.diff(place, axis=0), axis=1) * own
    longest = np.maximum.reduceat(moved, rows(parts)[:-1])
    parts = parts * np.maximum(np.ceil(longest / STEP), 1).astype(np.int64)
    return _between(joints, parts), rows(parts)


def _between(joints: FloatArray, parts: Index) -> FloatArray:
    """The values with each step cut into equal parts."""
    segment = np.repeat(np.arange(len(parts)), parts)
    share = (np.arange(1, len(segment) + 1) - (np.cumsum(parts) - parts)[segment]) / parts[segment]
    found = np.concatenate([joints[:1], joints[segment] + share[:, None] * np.diff(joints, axis=0)[segment]])
    found[rows(parts)] = joints
    return found
