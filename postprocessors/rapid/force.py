"""Pressing sections for RAPID: what Machining FC can do of them, and the program rewritten so that each change of
force stands right before the motion that it is printed with.

A section is ``Force`` on, motions that press, ``Force`` off, one motion that leaves the surface.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import numpy as np
from msgspec.structs import replace

from camgen.geometry.arcs import measure_sweep, subtract
from camgen.geometry.vectors import cross, in_blocks, lengths
from camgen.model.errors import Refused
from camgen.model.pose import FloatArray, Pose, Vec3
from camgen.model.program import (
    Comment,
    Force,
    Instruction,
    Joints,
    Mask,
    Motion,
    MoveC,
    MoveJ,
    MoveL,
)
from camgen.model.text import fixed
from camgen.post.passes import PASSES

#: Digits of a force in N.
DIGITS = 3
#: How far a press direction may be off the tool axis that stands for it; well below what a printed orientation loses.
_ALIGNED = 5e-7
_TURN = (
    'on a drawing set tool.orient = "follow", so that the tool turns with the surface; of a part leave that edge out '
    '(input.select), or all pressing (post.force = "ignore")'
)


def tool_axis(rotation: FloatArray, press: Vec3) -> tuple[int, int] | None:
    """Which tool axis (0..2) and sign ``force_direction`` is, where the tool stands as ``rotation``; None when it is
    none.
    """
    along = rotation.T @ np.asarray(press)
    axis = int(np.argmax(np.abs(along)))
    sign = 1 if along[axis] > 0 else -1
    along[axis] -= sign
    return (axis, sign) if float(np.abs(along).max()) <= _ALIGNED else None


def settle(body: Sequence[Instruction], chord: float) -> tuple[Instruction, ...]:
    """Each ``Force`` moved right before its motion, which becomes straight; one that leaves the surface also stops, and
    what is remarked before it, on what comes next, is remarked after it.

    A force takes effect with the next motion, so nothing changes by the first; FCPress1LStart and FCPressEnd are
    straight, and FCPressEnd has no zone.
    """
    result: list[Instruction] = []
    waiting: Force | None = None
    start: Pose | None = None
    remarks: list[Instruction] = []
    for item in body:
        if isinstance(item, Force):
            waiting = item
            continue
        if isinstance(item, Comment) and waiting is not None and waiting.newtons == 0:
            remarks.append(item)
            continue
        if isinstance(item, (MoveJ, MoveL, MoveC)):
            if waiting is not None:
                result.append(waiting)
                result += [*_opening(waiting, item, start, chord), *remarks]
                waiting = None
                remarks.clear()
            else:
                result.append(item)
            start = item.target if isinstance(item.target, Pose) else None
        else:
            result.append(item)
    return tuple(result)


def _opening(
    force: Force, item: MoveJ | MoveL | MoveC, start: Pose | None, chord: float
) -> list[Instruction]:
    motions: list[Instruction] = [item]
    if isinstance(item, MoveC) and start is not None:
        motions = [*PASSES["chords"](start, item, chord)]
    if force.newtons == 0 and isinstance(motions[0], MoveL):
        motions[0] = replace(motions[0], blend=0.0)
    return motions


@dataclass
class _Section:
    """Where in a section the instructions have come to. force: the one that is on. moved: after it came a motion."""

    force: Force | None = None
    axis: tuple[int, int] | None = None
    moved: bool = False
    leaving: bool = False
    start: Pose | None = None
    begun: bool = False


def check_sections(post: str, body: Sequence[Instruction]) -> None:
    """Raises Refused for the first instruction that pressing with FCPress cannot do."""
    section = _Section()
    for index, item in enumerate(body):
        reason = ""
        if isinstance(item, Force):
            reason = _change(section, item)
        elif isinstance(item, (MoveJ, MoveL, MoveC)):
            section.begun = True
            reason = _explain_move(section, item)
            section.start = item.target if isinstance(item.target, Pose) else None
        if reason:
            raise Refused(post, index, reason)
    if section.leaving:
        raise Refused(
            post, len(body) - 1, "no straight motion leaves the surface after the force is off"
        )


def _change(section: _Section, item: Force) -> str:
    """Why the force cannot change here. Before the first motion it is put off, whether it is on or not."""
    if not section.begun and item.newtons == 0:
        return ""
    if section.leaving or (section.force is not None and not section.moved):
        return "two changes of force without a motion between them"
    if item.newtons > 0:
        if section.force is not None:
            return "the force is on already; each motion carries its own force, so switch it off before"
        if section.start is None:
            return "pressing from a pose that is not known; put a straight motion before it"
        section.axis = tool_axis(section.start.rotation, item.force_direction)
        if section.axis is None:
            return f"the press direction is no axis of the tool; {_TURN}"
        section.force, section.moved = item, False
        return ""
    if section.force is None:
        return "the force is off already"
    section.force, section.leaving = None, True
    return ""


def _explain_move(section: _Section, item: MoveJ | MoveL | MoveC) -> str:
    """Why this motion cannot press, or leave the surface."""
    if section.leaving:
        section.leaving = False
        return (
            "the motion that leaves the surface must be straight" if isinstance(item, MoveJ) else ""
        )
    force = section.force
    if force is None:
        return ""
    first, section.moved = not section.moved, True
    if isinstance(item, MoveJ):
        return "a joint-interpolated motion while pressing"
    if fixed(item.force, DIGITS) == fixed(0.0, DIGITS):
        return "a motion without force while pressing; switch the force off before it"
    if first and fixed(item.force, DIGITS) != fixed(force.newtons, DIGITS):
        return "the first motion must press as hard as its section starts"
    if tool_axis(item.target.rotation, item.force_direction) != section.axis:
        return f"the press direction is not the same tool axis in the whole section; {_TURN}"
    return ""


# Where the force sensor is set to zero.

#: Farther than this from where a section starts, along the tool or against its press direction, is in the air, mm.
_AIR = 1.0


def choose_calibrations(post: str, body: Sequence[Instruction]) -> frozenset[int]:
    """The indices of the motions after which FCCalib may stand: for each section the last of the farthest from the
    surface on the way to it. Where the tool stays down between two sections there is none.

    Raises Refused where there is none before the first.
    """
    chosen: set[int] = set()
    way: dict[int, Motion] = {}
    leaving = -1
    for index, item in enumerate(body):
        if isinstance(item, Force) and item.newtons > 0:
            found = _farthest(way, leaving, item.force_direction)
            if found is None and not chosen:
                what = "no motion in the air before pressing, where the force sensor can be set to zero"
                raise Refused(post, index, what, "raise process.clearance")
            chosen |= set() if found is None else {found}
        elif isinstance(item, Force):
            way, leaving = {}, index + 1
        elif isinstance(item, (MoveJ, MoveL, MoveC)):
            way[index] = item
    return frozenset(chosen)


def _farthest(way: Mapping[int, Motion], leaving: int, press: Vec3) -> int | None:
    """Of the motions ``way``, the last of which goes to the surface, the one after which the sensor is set to zero.

    Rather one to a pose that is in the air for sure than one to joints, and rather that than the one that has just left
    the surface, at index ``leaving``.
    """
    start = way[max(way)].target if way else None
    if not isinstance(start, Pose):
        return None
    clear = {k: _measure(start, motion.target, press) for k, motion in way.items()}
    most = max((v for k, v in clear.items() if k != leaving), default=0.0)
    if most >= _AIR:
        return max(k for k, v in clear.items() if k != leaving and v >= most - 1e-6)
    joints = [k for k, motion in way.items() if isinstance(motion.target, Joints)]
    if joints:
        return joints[-1]
    return leaving if clear.get(leaving, 0.0) >= _AIR else None


def _measure(start: Pose, target: Pose | Joints, press: Vec3) -> float:
    """How far ``target`` is from ``start`` along the tool or against the press direction, mm; 0 where not known."""
    if isinstance(target, Joints):
        return 0.0
    way = np.subtract(target.origin, start.origin)
    return max(-float(way @ start.rotation[:, 2]), -float(way @ np.asarray(press)))


def stop_before_calibrations(post: str, body: Sequence[Instruction]) -> tuple[Instruction, ...]:
    """The body whose motions stop where the sensor is set to zero."""
    stops = choose_calibrations(post, body)
    return tuple(
        replace(item, blend=0.0) if k in stops and isinstance(item, (MoveJ, MoveL, MoveC)) else item
        for k, item in enumerate(body)
    )


# Arcs that MoveC takes (docs/posts/rapid.md, what is not certain).

#: rad: the widest arc.
_WIDEST = math.radians(120)
#: rad: the least angle between circle point and end, seen from the start, and between circle point
#: and start, seen from the end, as planned and as printed. The manual asks for 1 degree at the start.
_LEAST_ANGLE, _LEAST_PRINTED_ANGLE = math.radians(1.25), math.radians(1.1)
#: mm: the least distance of any two of the three points.
_CLOSEST = 0.2
#: The least part of an arc that its circle point may cut off.
_SHORTER = 0.25
#: What is as near as this to a bound, in any unit, is looked at one by one.
_SURE = 1e-7


def arc_fault(start: Vec3, via: Vec3, end: Vec3, decimals: int) -> str:
    """The reason why an arc cannot be one MoveC. Empty for an arc that can.

    decimals: digits of the coordinates in the text.
    """
    if measure_sweep(start, via, end)[0] > _WIDEST + 1e-6:
        return "an arc of more than 120 deg; split it"
    if _measure_shorter(start, via, end) < _SHORTER:
        return "an arc whose circle point is near an end of it; split it"
    digit = 10**-decimals
    closest = max(_CLOSEST, 10 * digit)
    planned = _is_round((start, via, end), _LEAST_ANGLE, 2 * digit, closest)
    printed = (_round(start, decimals), _round(via, decimals), _round(end, decimals))
    if planned and _is_round(printed, _LEAST_PRINTED_ANGLE, digit, 0.0):
        return ""
    return (
        f"an arc whose circle point and end are less than 1.25 deg apart, seen from its start, or "
        f"of less than {closest:g} mm or {2 * digit:g} mm height; use a straight motion"
    )


def find_round(start: FloatArray, via: FloatArray, end: FloatArray, decimals: int) -> Mask:
    """(N,): the arcs through three points (N, 3), mm, in which ``arc_fault`` finds nothing for sure."""
    return in_blocks(partial(_are_round, decimals), start, via, end)


def _are_round(decimals: int, start: FloatArray, via: FloatArray, end: FloatArray) -> Mask:
    digit = 10.0**-decimals
    points = np.stack([start, via, end])
    printed = np.round(points, decimals)
    # Where the rounding is in doubt, so is the printed arc.
    sure = (np.abs(np.abs(points - printed) - digit / 2) > _SURE).all(axis=(0, 2))
    shapes = _shapes(*points)
    sure &= (shapes.sweep <= _WIDEST) & (shapes.shorter >= _SHORTER + _SURE)
    sure &= (shapes.angle >= _LEAST_ANGLE + _SURE) & (shapes.height >= 2 * digit + _SURE)
    sure &= shapes.closest >= max(_CLOSEST, 10 * digit) + _SURE
    shapes = _shapes(*printed)
    sure &= (shapes.angle >= _LEAST_PRINTED_ANGLE + _SURE) & (shapes.height >= digit + _SURE)
    return np.asarray(sure)


def find_wide(start: FloatArray, via: FloatArray, end: FloatArray) -> Mask:
    """(N,): the arcs through three points (N, 3), mm, of which ``arc_fault`` finds for sure that they turn too far."""
    return in_blocks(_are_wide, start, via, end)


def _are_wide(start: FloatArray, via: FloatArray, end: FloatArray) -> Mask:
    shapes = _shapes(start, via, end)
    return np.asarray((shapes.sweep > _WIDEST + 1e-6 + _SURE) & (shapes.shorter >= _SHORTER))


class _Shapes(NamedTuple):
    """N arcs through three points.

    sweep: (N,) rad.
    angle: (N,) rad between circle point and the chord, at the end where it is smaller.
    height: (N,) distance, mm, of the circle point from the chord.
    closest: (N,) least distance, mm, of two of the points.
    shorter: (N,) share of the arc that the shorter of its two pieces has.
    """

    sweep: FloatArray
    angle: FloatArray
    height: FloatArray
    closest: FloatArray
    shorter: FloatArray


def _shapes(start: FloatArray, via: FloatArray, end: FloatArray) -> _Shapes:
    back, on, chord = start - via, end - via, end - start
    area = lengths(cross(back, on))
    sweep = 2 * (np.pi - np.arctan2(area, (back * on).sum(axis=1)))
    first = np.arctan2(area, -(back * chord).sum(axis=1))
    last = np.arctan2(area, (on * chord).sum(axis=1))
    sides = [lengths(side) for side in (back, on, chord)]
    with np.errstate(divide="ignore", invalid="ignore"):
        height, shorter = area / sides[2], np.minimum(first, last) / (first + last)
    angle = np.minimum(first, last)
    return _Shapes(sweep, angle, height, np.minimum.reduce(sides), shorter)


def _measure_shorter(start: Vec3, via: Vec3, end: Vec3) -> float:
    """The share of an arc that the shorter of its two pieces has; 0.5 for points that make no arc."""
    one, two = _angles(start, via, end)
    return min(one, two) / (one + two) if min(one, two) > 0 else 0.5


def _angles(start: Vec3, via: Vec3, end: Vec3) -> tuple[float, float]:
    """The angles, rad, between circle point and chord at the start and at the end of an arc.

    Each is half of the piece of the arc on the other side of the circle point.
    """
    (ux, uy, uz), (wx, wy, wz) = subtract(via, start), subtract(end, via)
    cx, cy, cz = subtract(end, start)
    area = math.hypot(uy * cz - uz * cy, uz * cx - ux * cz, ux * cy - uy * cx)
    first = math.atan2(area, ux * cx + uy * cy + uz * cz)
    return first, math.atan2(area, wx * cx + wy * cy + wz * cz)


def _is_round(
    arc: tuple[Vec3, Vec3, Vec3], narrowest: float, lowest: float, closest: float
) -> bool:
    """Whether an arc keeps three least values.

    arc: start, circle point and end, mm.
    narrowest: angle, rad, between circle point and chord at either end.
    lowest: height, mm.
    closest: distance, mm, of any two of its points.
    """
    start, via, end = arc
    near = min(math.dist(start, via), math.dist(via, end), math.dist(start, end))
    angle, height = min(_angles(start, via, end)), measure_sweep(start, via, end)[1]
    return angle >= narrowest and height >= lowest and near >= closest


def _round(point: Vec3, decimals: int) -> Vec3:
    x, y, z = (round(v, decimals) for v in point)
    return x, y, z
