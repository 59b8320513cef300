"""A way out of each end of a processing motion, up above the safety level; an approach is the same backwards.

RFA paper, section II.A: back along the tool where only the last link is below the level, over the wrist's place where
the link before it is too. Where such a way collides or breaks a limit, others are tried before the end is given up.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from itertools import islice

import numpy as np
from msgspec import Struct

from camgen.geometry.ragged import offsets
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
from camgen.robots.kinematics.forward import flange, frames

#: rad: the wrist is kept from standing straight, where it is singular.
_BENT = math.radians(10.0)
#: Least rise, mm per mm, of a way that is to reach the level.
_STEEP = 0.15
#: mm: the least way out.
_LEAST_WAY_OUT_MM = 1.0
#: mm: a way out that comes so little nearer than its end is not given up for that.
_AS_NEAR_MM = 0.05
#: mm back along the tool where no way leads up to the level.
_BACK = (50.0, 20.0, 10.0, 5.0, 2.0)
#: Directions round the vertical that are tried, all 45 deg up.
_DIRECTIONS = 8


class Retraction(Struct, frozen=True, eq=False):
    """way: rows from the end of a motion to free space. joints: (N, J) there. looks: (D,) poses as it goes, dense:
    (D, J) the joints there. speed: (N - 1,) mm/s of each segment. name: of the direction. via: (K, J) joint values by
    way of which the joints go home from its end, where the straight motion collides.
    """

    way: PosePath
    joints: FloatArray
    looks: PosePath
    dense: FloatArray
    speed: FloatArray
    name: str
    via: FloatArray

    def time(self, speeds: LinkSpeeds) -> float:
        """Its duration from rest to rest without a stop, s."""
        length = float(self.way.length.sum())
        mean = length / float((self.way.length / self.speed).sum())
        return float(speeds.time_tool(length, mean))


def retractions(
    setup: Setup, room: FreeSpace, ends: Sequence[tuple[PosePath, FloatArray]], speeds: LinkSpeeds
) -> list[Retraction | str]:
    """For each end, a pose (one row) and the joints (J,) it is taken in, the first way out that is free and keeps the
    margin, or as much of it as the end has; else the free one that keeps most; or why there is none.
    """
    ways = [_ways(setup, room, end, joints) for end, joints in ends]
    # What stands nearer than the margin at the end is as near on all ways out of it.
    wanted = room.gaps(np.stack([joints for _, joints in ends]))
    found: list[Retraction | str] = ["" for _ in ends]
    most = [-1.0 for _ in ends]
    left = list(range(len(ends)))
    # Together several ways take little more time than one.
    count = 1
    while left:
        owner: list[int] = []
        named: list[tuple[str, PosePath]] = []
        for k in left:
            tried = list(islice(ways[k], count))
            owner += [k] * len(tried)
            named += tried
        ran = _run(setup, named, [ends[k][1] for k in owner], speeds)
        moved = [way for way in ran if isinstance(way, Retraction)]
        kept = iter(room.look([SampledMotion(way.dense, way.looks) for way in moved]))
        for k, way in zip(owner, ran, strict=True):
            look = next(kept) if isinstance(way, Retraction) else math.nan
            if most[k] >= wanted[k] - _AS_NEAR_MM:
                continue
            if isinstance(way, str):
                found[k] = found[k] or way
            elif isinstance(look, Blockage):
                found[k] = found[k] or f"{way.name} {look.what}"
            elif look > most[k]:
                found[k], most[k] = way, look
        left = [k for k in dict.fromkeys(owner) if most[k] < wanted[k] - _AS_NEAR_MM]
        count *= 2
    return [one or "the tool points up" for one in found]


def shorter(
    setup: Setup, room: FreeSpace, end: PosePath, joints: FloatArray, speeds: LinkSpeeds
) -> Retraction | None:
    """A way out of one end that does not lead up to the level: the longest back along the tool that is free."""
    base_from_work = setup.base_from_work
    start = base_from_work.rotation @ end.position[0] + np.asarray(base_from_work.origin)
    back = -(base_from_work.rotation @ end.rotation[0])[:, 2]
    ways = (("back", _chain(setup, end, [start, start + far * back])) for far in _BACK)
    for named in ways:
        (way,) = _run(setup, [named], [joints], speeds)
        if isinstance(way, Retraction) and not isinstance(
            room.look([SampledMotion(way.dense, way.looks)])[0], Blockage
        ):
            return way
    return None


def _run(
    setup: Setup,
    ways: Sequence[tuple[str, PosePath]],
    starts: Sequence[FloatArray],
    speeds: LinkSpeeds,
) -> list[Retraction | str]:
    """``ways`` out of where the joints are (J,), each with its name, as the arm runs them; or why it cannot."""
    parts = [count_samples(way) for _, way in ways]
    dense = [divide(way, own) for (_, way), own in zip(ways, parts, strict=True)]
    goals = [compute_flange_poses(setup, one.position, one.rotation) for one in dense]
    made: list[Retraction | str] = []
    followed = follow_each(setup.robot, goals, starts, MARGIN, JUMP)
    for (name, way), own, looks, joints, found in zip(
        ways, parts, dense, starts, followed, strict=True
    ):
        if isinstance(found, Choice) and np.abs(found.joints[0] - joints).max() < 1e-6:
            at = offsets(own)
            speed = compute_line_speeds(setup, speeds, looks, found.joints, at)
            none = frozen(joints[None][:0])
            made.append(
                Retraction(
                    way, frozen(found.joints[at]), looks, frozen(found.joints), speed, name, none
                )
            )
        else:
            made.append(f"{name} the arm cannot follow")
    return made


def _ways(
    setup: Setup, room: FreeSpace, end: PosePath, joints: FloatArray
) -> Iterator[tuple[str, PosePath]]:
    """What is tried, in this order."""
    base_from_work = setup.base_from_work
    start = base_from_work.rotation @ end.position[0] + np.asarray(base_from_work.origin)
    back = -(base_from_work.rotation @ end.rotation[0])[:, 2]
    up = np.array([0.0, 0.0, 1.0])
    straight = _straight(setup, room, start, back, end)
    low_wrist = (
        frames(setup.robot, joints[None])[1][0, 5, 2] < room.level if len(joints) == 6 else False
    )
    over = _over_wrist(setup, room, end, joints) if low_wrist else None
    if straight is not None:
        yield "along the tool", straight
    if over is not None:
        yield "over the wrist", over
    beside = start + back * _out_of(room, start, back)
    yield (
        "back and up",
        _chain(
            setup,
            end,
            [start, beside, beside + up * max(room.level - beside[2], _LEAST_WAY_OUT_MM)],
        ),
    )
    turns = np.arange(_DIRECTIONS) * (math.tau / _DIRECTIONS) + math.atan2(back[1], back[0])
    order = sorted(range(_DIRECTIONS), key=lambda k: (min(k, _DIRECTIONS - k), k))
    slopes = [np.array([math.cos(turns[k]), math.sin(turns[k]), 1.0]) / math.sqrt(2) for k in order]
    for name, along in [("up", up), *(("up aside", slope) for slope in slopes)]:
        way = _straight(setup, room, start, along, end)
        if way is not None:
            yield name, way


def _straight(
    setup: Setup, room: FreeSpace, start: FloatArray, along: FloatArray, end: PosePath
) -> PosePath | None:
    """In one direction up to the level (equation 1)."""
    if along[2] < _STEEP:
        return None
    return _chain(
        setup,
        end,
        [start, start + along * max((room.level - start[2]) / along[2], _LEAST_WAY_OUT_MM)],
    )


def _over_wrist(
    setup: Setup, room: FreeSpace, end: PosePath, joints: FloatArray
) -> PosePath | None:
    """First the TCP goes to where the wrist is, turned as the link before it points, then back along it to the level
    (the paper's second case).
    """
    wrist = frames(setup.robot, joints[None])[1][0, 5]
    stretched = joints.copy()
    stretched[4] = math.copysign(_BENT, joints[4])
    turned = flange(setup.robot, stretched[None])[0][0] @ setup.flange_from_tool.rotation
    back = -turned[:, 2]
    if back[2] < _STEEP:
        return None
    top = wrist + back * max((room.level - wrist[2]) / back[2], _LEAST_WAY_OUT_MM)
    work_from_base = setup.base_from_work.inverse()
    position = [
        end.position[0],
        *(np.stack([wrist, top]) @ work_from_base.rotation.T + work_from_base.origin),
    ]
    rotation = work_from_base.rotation @ turned
    return PosePath(
        frozen(position),
        frozen(np.full((3, 3), np.nan)),
        frozen([end.rotation[0], rotation, rotation]),
    )


def _chain(setup: Setup, end: PosePath, points: list[FloatArray]) -> PosePath:
    """Straight from point to point (base frame), turned as ``end``."""
    work_from_base = setup.base_from_work.inverse()
    position = np.stack(points) @ work_from_base.rotation.T + np.asarray(work_from_base.origin)
    position[0] = end.position[0]
    count = len(points)
    rotation = np.broadcast_to(end.rotation[0], (count, 3, 3))
    return PosePath(frozen(position), frozen(np.full((count, 3), np.nan)), frozen(rotation))


def _out_of(room: FreeSpace, start: FloatArray, along: FloatArray) -> float:
    """How far it is along a direction until the point is ``beside`` mm out of the part's box."""
    low, high = room.low - room.beside, room.high + room.beside
    ends = np.where(along > 0, high, low)
    with np.errstate(divide="ignore"):
        ways = np.where(np.abs(along) > 1e-9, (ends - start) / along, math.inf)
    return max(float(ways.min()), _LEAST_WAY_OUT_MM)
