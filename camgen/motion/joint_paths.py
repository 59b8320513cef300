"""Motions as a controller runs them: joint values so dense that joints run evenly between two rows.

Between two rows no body leaves the pose path of the TCP by more than a tolerance.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from msgspec import Struct
from msgspec.structs import astuple

from camgen.geometry.ragged import (
    compute_offsets,
    concatenate_columns,
    count_rows,
    select_distinct,
)
from camgen.model.part import BoolArray
from camgen.model.pose import FloatArray
from camgen.motion.pose_paths import Index, PosePath, sample_poses
from camgen.motion.setup import SampledMotion, Setup, compute_flange_poses
from camgen.robots.kinematics.inverse import find_nearest

#: mm: no point of arm and tool deviates by more from its place with evenly running joints, at the
#: middle of two rows.
APART = 0.02
#: A segment is halved this number of times, down to a 4096th. Then no joint values lead along it.
_HALVINGS = 12


class JointPath(Struct, frozen=True, eq=False):
    """Joint values between which the joints run evenly.

    The remaining deviation is about a quarter of `APART`, since every segment is halved once more
    than necessary.

    joints: (D, J) joint values, rad or mm.
    at: (D,) their places in rows of the pose path: 2.25 is between rows 2 and 3.
    lost: rows of the pose path after which no joint values lead along it.
    """

    joints: FloatArray
    at: FloatArray
    lost: Index


def follow_closely(
    setup: Setup, path: PosePath, joints: FloatArray, on_path: BoolArray
) -> JointPath:
    """The motion along a pose path.

    joints: (N, J) joint values at its rows, rad or mm.
    on_path: (N - 1,) whether the TCP keeps to the path in a segment. In others the joints run
        evenly, and no rows are added.
    """
    at = np.arange(len(joints), dtype=np.float64)
    is_open: BoolArray = np.asarray(on_path, dtype=bool)
    lost: list[FloatArray] = []
    for _ in range(_HALVINGS):
        before = np.flatnonzero(is_open)
        if not len(before):
            break
        kept = compute_offsets(1 + is_open)
        middle, place = kept[before] + 1, (at[before] + at[before + 1]) / 2
        even = (joints[before] + joints[before + 1]) / 2
        poses = compute_flange_poses(setup, *sample_poses(path, place))
        exact = find_nearest(setup.robot, *poses, even)
        is_missing: BoolArray = np.asarray(np.isnan(exact).any(axis=1))
        lost.append(at[before[is_missing]])
        exact = np.where(is_missing[:, None], even, exact)
        uneven = middle[np.asarray(setup.measure_apart(exact, even) > APART)]
        at, joints = _insert(at, kept, middle, place), _insert(joints, kept, middle, exact)
        is_open = np.zeros(len(at) - 1, dtype=np.bool_)
        is_open[uneven - 1] = is_open[uneven] = True
    lost.append(at[:-1][is_open])
    return JointPath(joints, at, select_distinct(np.concatenate(lost).astype(np.int64)))


def _insert(old: FloatArray, kept: Index, middle: Index, added: FloatArray) -> FloatArray:
    table = np.empty((len(old) + len(added), *old.shape[1:]))
    table[kept], table[middle] = old, added
    return table


def follow_all(setup: Setup, motions: Sequence[SampledMotion]) -> list[JointPath]:
    """The joint path of each of several motions. Pose paths are followed as one, with seams."""
    none = np.zeros(0, np.int64)
    followed = [
        JointPath(motion.joints, np.arange(len(motion.joints), dtype=np.float64), none)
        for motion in motions
    ]
    on_paths = [k for k, motion in enumerate(motions) if motion.pose_path is not None]
    if not on_paths:
        return followed
    paths = [motion.pose_path for motion in motions if motion.pose_path is not None]
    first = compute_offsets(count_rows(paths))
    whole = PosePath(*concatenate_columns(map(astuple, paths)))
    on_path = np.ones(len(whole) - 1, dtype=bool)
    on_path[first[1:-1] - 1] = False
    joints = np.concatenate([motions[k].joints for k in on_paths])
    joined = follow_closely(setup, whole, joints, on_path)
    # The seam from one path to the next has no rows in between.
    ends = np.searchsorted(joined.at, first - 0.5)
    for number, k in enumerate(on_paths):
        begin = first[number]
        rows = slice(ends[number], ends[number + 1])
        lost = joined.lost[(joined.lost >= begin) & (joined.lost < first[number + 1])]
        followed[k] = JointPath(joined.joints[rows], joined.at[rows] - begin, lost - begin)
    return followed
