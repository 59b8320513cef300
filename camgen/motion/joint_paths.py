"""Motions as a controller makes them: joint values so close that no body leaves the way of the TCP between two rows."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from msgspec import Struct

from camgen.geometry.ragged import each_once, offsets
from camgen.model.part import BoolArray
from camgen.model.pose import FloatArray
from camgen.motion.pose_paths import Index, PosePath, PoseSampler
from camgen.motion.setup import SampledMotion, Setup, flange_poses
from camgen.robots.kinematics.inverse import nearest

#: mm: half-way between two rows no point of arm and tool is farther from where joints that run evenly have it.
APART = 0.02
#: So often a stretch is halved, down to a 4096th, before no joints are taken to lead along it.
_HALVINGS = 12


class JointPath(Struct, frozen=True, eq=False):
    """joints: (D, J), between which they may be taken to run evenly: what is left is about a quarter of ``APART``,
    since every stretch is halved once more than it had to be. at: (D,) where, in rows of the way: 2.25 is a quarter of
    the way from row 2 to row 3. lost: rows after which no joints lead along the way.
    """

    joints: FloatArray
    at: FloatArray
    lost: Index


def follow_closely(setup: Setup, way: PosePath, joints: FloatArray, along: BoolArray) -> JointPath:
    """The motion through the poses of ``way`` with its ``joints`` (N, J), rad or mm. along: (N - 1,) the segments in
    which the TCP keeps to the way; in others the joints run evenly, and nothing is added.
    """
    at = np.arange(len(joints), dtype=np.float64)
    open_: BoolArray = np.asarray(along, dtype=bool)
    lost: list[FloatArray] = []
    poses = PoseSampler.of(way).poses
    for _ in range(_HALVINGS):
        before = np.flatnonzero(open_)
        if not len(before):
            break
        kept = offsets(1 + open_)
        middle, place = kept[before] + 1, (at[before] + at[before + 1]) / 2
        even = (joints[before] + joints[before + 1]) / 2
        position, rotation = poses(place)
        exact = nearest(setup.robot, *flange_poses(setup, position, rotation), even)
        none: BoolArray = np.asarray(np.isnan(exact).any(axis=1))
        lost.append(at[before[none]])
        exact = np.where(none[:, None], even, exact)
        far: BoolArray = np.asarray(setup.apart(exact, even) > APART)
        wide = middle[far]
        at, joints = _insert(at, kept, middle, place), _insert(joints, kept, middle, exact)
        open_ = np.zeros(len(at) - 1, dtype=np.bool_)
        open_[wide - 1] = open_[wide] = True
    lost.append(at[:-1][open_])
    return JointPath(joints, at, each_once(np.concatenate(lost).astype(np.int64)))


def _insert(old: FloatArray, kept: Index, middle: Index, new: FloatArray) -> FloatArray:
    """One table with ``old`` at the rows ``kept`` and ``new`` at the rows ``middle``."""
    found = np.empty((len(old) + len(new), *old.shape[1:]))
    found[kept], found[middle] = old, new
    return found


def follow_all(setup: Setup, tracks: Sequence[SampledMotion]) -> list[JointPath]:
    """``follow_closely`` of each of several, in one."""
    bound = [k for k, track in enumerate(tracks) if track.way is not None]
    plain = {k: track.joints for k, track in enumerate(tracks) if track.way is None}
    found = {
        k: JointPath(q, np.arange(len(q), dtype=np.float64), np.zeros(0, np.int64))
        for k, q in plain.items()
    }
    if bound:
        found |= zip(bound, _split(setup, [tracks[k] for k in bound]), strict=True)
    return [found[k] for k in range(len(tracks))]


def _split(setup: Setup, tracks: Sequence[SampledMotion]) -> list[JointPath]:
    """The courses of tracks that are bound to a way."""
    ways = [track.way for track in tracks if track.way is not None]
    first = offsets([len(way) for way in ways])
    whole = PosePath(
        *(
            np.concatenate([getattr(way, name) for way in ways])
            for name in PosePath.__struct_fields__
        )
    )
    along = np.ones(len(whole) - 1, dtype=bool)
    along[first[1:-1] - 1] = False
    one = follow_closely(setup, whole, np.concatenate([track.joints for track in tracks]), along)
    # The seam from one way to the next has no rows in between.
    ends = np.searchsorted(one.at, first - 0.5)
    found = []
    for a, b, low, high in zip(first[:-1], first[1:], ends[:-1], ends[1:], strict=True):
        own = one.lost[(one.lost >= a) & (one.lost < b)]
        found.append(JointPath(one.joints[low:high], one.at[low:high] - a, own - a))
    return found
