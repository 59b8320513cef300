"""Retractions from the ends of processing motions up above the safety level.

An approach is a retraction run backwards. RFA paper, section II.A: the tool retracts along its axis
if only the last link is below the level, and over the wrist if the link before it is too. If these
collide or break a limit, other directions are tried.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from itertools import islice

import numpy as np
from msgspec import Struct

from camgen.geometry.ragged import compute_offsets
from camgen.model.pose import FloatArray, frozen
from camgen.motion.limits import LinkSpeeds, compute_line_speeds
from camgen.motion.pose_paths import PosePath, divide
from camgen.motion.setup import (
    JUMP,
    MARGIN,
    Blockage,
    FreeSpace,
    SampledMotion,
    Setup,
    compute_flange_poses,
    count_samples,
)
from camgen.robots.kinematics.continuity import Choice, follow_each
from camgen.robots.kinematics.forward import compute_flange, compute_link_frames

#: rad: smallest angle of the bent wrist. A straight wrist is singular.
_MIN_WRIST_ANGLE = math.radians(10.0)
#: mm per mm: smallest rise of a path that is to reach the safety level.
_MIN_RISE = 0.15
#: mm: length of the shortest retraction.
_MIN_LENGTH_MM = 1.0
#: mm: a retraction whose clearance is smaller than that of its end by less than this is accepted.
_CLEARANCE_SLACK_MM = 0.05
#: mm back along the tool if no path leads up to the safety level, the longest first.
_SHORT_LENGTHS_MM = (50.0, 20.0, 10.0, 5.0, 2.0)
#: Directions about the vertical that are tried, all 45 deg upwards.
_DIRECTIONS = 8


class Retraction(Struct, frozen=True, eq=False):
    """A motion from the end of a processing motion into free space.

    pose_path: pose path of the TCP, N rows.
    joints: (N, J) joint values at its rows.
    sampled_path: pose path with a row at each of the D samples of the motion.
    sampled_joints: (D, J) joint values at the samples.
    speed: (N - 1,) speed of each segment, mm/s.
    name: name of its direction.
    via: (K, J) joint values to pass through from its end to home, if the direct motion collides.
    """

    pose_path: PosePath
    joints: FloatArray
    sampled_path: PosePath
    sampled_joints: FloatArray
    speed: FloatArray
    name: str
    via: FloatArray

    def time(self, speeds: LinkSpeeds) -> float:
        """Its duration from rest to rest without a stop, s."""
        length = float(self.pose_path.length.sum())
        mean = length / float((self.pose_path.length / self.speed).sum())
        return float(speeds.time_tool(length, mean))


#: A direction's name and the pose path of the TCP.
_Candidate = tuple[str, PosePath]


def find_retractions(
    setup: Setup, space: FreeSpace, ends: Sequence[tuple[PosePath, FloatArray]], speeds: LinkSpeeds
) -> list[Retraction | str]:
    """Find a retraction for each end, or the reason against it.

    It is the first candidate that is free and keeps the margin, or the clearance of its end if that
    is smaller. Without one it is the free candidate with the largest clearance.

    ends: a pose of one row, and the joint values (J,) there.
    """
    candidates = [_list_candidates(setup, space, end, joints) for end, joints in ends]
    # A body that is nearer than the margin at the end is as near on all retractions from it.
    wanted = space.gaps(np.stack([joints for _, joints in ends])) - _CLEARANCE_SLACK_MM
    results: list[Retraction | str] = [""] * len(ends)
    clearance = [-1.0] * len(ends)
    pending = list(range(len(ends)))
    # Several candidates together take little more time than one.
    batch_size = 1
    while pending:
        owners: list[int] = []
        batch: list[_Candidate] = []
        for k in pending:
            next_candidates = list(islice(candidates[k], batch_size))
            owners += [k] * len(next_candidates)
            batch += next_candidates
        followed = list(_follow(setup, batch, [ends[k][1] for k in owners], speeds))
        free = _examine(space, followed)
        for k, result in zip(owners, followed, strict=True):
            verdict = result if isinstance(result, str) else next(free)
            if clearance[k] >= wanted[k]:
                continue
            if isinstance(verdict, str):
                results[k] = results[k] or verdict
            elif verdict > clearance[k]:
                results[k], clearance[k] = result, verdict
        pending = [k for k in dict.fromkeys(owners) if clearance[k] < wanted[k]]
        batch_size *= 2
    return [result or "the tool points up" for result in results]


def _examine(space: FreeSpace, results: Sequence[Retraction | str]) -> Iterator[float | str]:
    """The clearance of each retraction, mm, or the name and reason of the collision."""
    retractions = [result for result in results if isinstance(result, Retraction)]
    looks = space.look([SampledMotion(out.sampled_joints, out.sampled_path) for out in retractions])
    for out, result in zip(retractions, looks, strict=True):
        yield f"{out.name} {result.what}" if isinstance(result, Blockage) else result


def find_short_retraction(
    setup: Setup, space: FreeSpace, end: PosePath, joints: FloatArray, speeds: LinkSpeeds
) -> Retraction | None:
    """Find the longest free retraction back along the tool that stays below the safety level.

    Returns None if none of `_SHORT_LENGTHS_MM` is free.
    """
    start, back = _locate(setup, end)
    for length in _SHORT_LENGTHS_MM:
        path = _make_path(setup, end, [start, start + length * back])
        (result,) = _follow(setup, [("back", path)], [joints], speeds)
        if isinstance(result, Retraction) and not isinstance(next(_examine(space, [result])), str):
            return result
    return None


def _locate(setup: Setup, end: PosePath) -> tuple[FloatArray, FloatArray]:
    """(3,) position of the TCP and direction back along the tool, base frame."""
    base_from_work = setup.base_from_work
    start = base_from_work.rotation @ end.position[0] + np.asarray(base_from_work.origin)
    return start, -(base_from_work.rotation @ end.rotation[0])[:, 2]


def _follow(
    setup: Setup, candidates: Sequence[_Candidate], starts: Sequence[FloatArray], speeds: LinkSpeeds
) -> Iterator[Retraction | str]:
    """The retraction on each candidate, from joint values (J,), or why the arm cannot follow it."""
    parts = [count_samples(path) for _, path in candidates]
    dense = [divide(path, counts) for (_, path), counts in zip(candidates, parts, strict=True)]
    goals = [compute_flange_poses(setup, poses.position, poses.rotation) for poses in dense]
    choices = follow_each(setup.robot, goals, starts, MARGIN, JUMP)
    for (name, path), counts, samples, start, choice in zip(
        candidates, parts, dense, starts, choices, strict=True
    ):
        if not isinstance(choice, Choice) or np.abs(choice.joints[0] - start).max() >= 1e-6:
            yield f"{name} the arm cannot follow"
            continue
        joints, rows = choice.joints, compute_offsets(counts)
        speed = compute_line_speeds(setup, speeds, samples, joints, rows)
        at_rows, no_via = frozen(joints[rows]), frozen(start[None][:0])
        yield Retraction(path, at_rows, samples, frozen(joints), speed, name, no_via)


def _list_candidates(
    setup: Setup, space: FreeSpace, end: PosePath, joints: FloatArray
) -> Iterator[_Candidate]:
    start, back = _locate(setup, end)
    up = np.array([0.0, 0.0, 1.0])
    straight = _make_straight(setup, space, end, back)
    has_low_wrist = (
        len(joints) == 6
        and compute_link_frames(setup.robot, joints[None])[1][0, 5, 2] < space.level
    )
    over_wrist = _make_over_wrist(setup, space, end, joints) if has_low_wrist else None
    for name, path in (("along the tool", straight), ("over the wrist", over_wrist)):
        if path is not None:
            yield name, path
    outside = start + back * _measure_distance_out(space, start, back)
    top = outside + up * max(space.level - outside[2], _MIN_LENGTH_MM)
    yield "back and up", _make_path(setup, end, [start, outside, top])
    angles = np.arange(_DIRECTIONS) * (math.tau / _DIRECTIONS) + math.atan2(back[1], back[0])
    directions = [("up", up)]
    for k in sorted(range(_DIRECTIONS), key=lambda k: (min(k, _DIRECTIONS - k), k)):
        slope = np.array([math.cos(angles[k]), math.sin(angles[k]), 1.0]) / math.sqrt(2)
        directions.append(("up aside", slope))
    for name, direction in directions:
        path = _make_straight(setup, space, end, direction)
        if path is not None:
            yield name, path


def _make_straight(
    setup: Setup, space: FreeSpace, end: PosePath, direction: FloatArray
) -> PosePath | None:
    """A line in one direction up to the safety level (equation 1); None if it rises too little."""
    if direction[2] < _MIN_RISE:
        return None
    start = _locate(setup, end)[0]
    length = max((space.level - start[2]) / direction[2], _MIN_LENGTH_MM)
    return _make_path(setup, end, [start, start + direction * length])


def _make_over_wrist(
    setup: Setup, space: FreeSpace, end: PosePath, joints: FloatArray
) -> PosePath | None:
    """The TCP goes to the wrist, turned as the link before it, then back along that link.

    This is the second case of the paper. None if that link rises too little.
    """
    wrist = compute_link_frames(setup.robot, joints[None])[1][0, 5]
    stretched = joints.copy()
    stretched[4] = math.copysign(_MIN_WRIST_ANGLE, joints[4])
    turned = compute_flange(setup.robot, stretched[None])[0][0] @ setup.flange_from_tool.rotation
    back = -turned[:, 2]
    if back[2] < _MIN_RISE:
        return None
    top = wrist + back * max((space.level - wrist[2]) / back[2], _MIN_LENGTH_MM)
    work_from_base = setup.base_from_work.inverse()
    points = np.stack([wrist, top]) @ work_from_base.rotation.T + work_from_base.origin
    rotation = work_from_base.rotation @ turned
    return PosePath(
        frozen([end.position[0], *points]),
        frozen(np.full((3, 3), np.nan)),
        frozen([end.rotation[0], rotation, rotation]),
    )


def _make_path(setup: Setup, end: PosePath, points: list[FloatArray]) -> PosePath:
    """A pose path straight from point to point (base frame), in the orientation of `end`."""
    work_from_base = setup.base_from_work.inverse()
    position = np.stack(points) @ work_from_base.rotation.T + np.asarray(work_from_base.origin)
    position[0] = end.position[0]
    count = len(points)
    rotation = np.broadcast_to(end.rotation[0], (count, 3, 3))
    return PosePath(frozen(position), frozen(np.full((count, 3), np.nan)), frozen(rotation))


def _measure_distance_out(space: FreeSpace, start: FloatArray, direction: FloatArray) -> float:
    """Distance in a direction until the point is `holder_distance` out of the part's box, mm."""
    lower, upper = space.low - space.holder_distance, space.high + space.holder_distance
    faces = np.where(direction > 0, upper, lower)
    with np.errstate(divide="ignore"):
        distances = np.where(np.abs(direction) > 1e-9, (faces - start) / direction, math.inf)
    return max(float(distances.min()), _MIN_LENGTH_MM)
