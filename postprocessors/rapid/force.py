"""Checks the sections with contact force that Machining FC can run, and rewrites them for RAPID.

A section is `Force` on, motions that press, `Force` off, one motion that leaves the surface. In the
rewritten program each change of force is right before the motion with which it is printed.
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
from camgen.geometry.vectors import compute_in_blocks, cross, measure_lengths
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
from camgen.post.values import end_of

#: Digits of a force in N.
DIGITS = 3
#: Allowed deviation of a force direction from its tool axis, in each component of unit vectors; far
#: less than the rounding of a printed orientation.
_ALIGNED = 5e-7
_TURN = (
    'on a drawing set tool.orient = "follow", so that the tool turns with the surface; '
    'of a part leave that edge out (input.select), or all pressing (post.force = "ignore")'
)


def tool_axis(rotation: FloatArray, press: Vec3) -> tuple[int, int] | None:
    """Find the tool axis, 0 to 2, and the sign of a force direction; None if it is not an axis."""
    along = rotation.T @ np.asarray(press)
    axis = int(np.argmax(np.abs(along)))
    sign = 1 if along[axis] > 0 else -1
    along[axis] -= sign
    return (axis, sign) if float(np.abs(along).max()) <= _ALIGNED else None


def move_forces(body: Sequence[Instruction], chord: float) -> tuple[Instruction, ...]:
    """Move each `Force` right before its motion, and make this motion straight.

    A force takes effect with the next motion, so moving it changes nothing. FCPress1LStart and
    FCPressEnd are straight, and FCPressEnd has no zone. So a motion that leaves the surface also
    stops, and comments before it, which are about the next instructions, come after it.
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
            start = end_of(item)
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
    """The state within a section with contact force.

    force: force that is on, None if it is off.
    axis: tool axis and sign of its direction.
    moved: whether a motion followed it.
    leaving: whether the next motion leaves the surface.
    start: pose at which the next motion starts, None if it is unknown.
    has_moved: whether the program has had a motion.
    """

    force: Force | None = None
    axis: tuple[int, int] | None = None
    moved: bool = False
    leaving: bool = False
    start: Pose | None = None
    has_moved: bool = False


def check_sections(post: str, body: Sequence[Instruction]) -> None:
    """Check that FCPress can run all sections. Raises Refused for the first fault."""
    section = _Section()
    for index, item in enumerate(body):
        reason = ""
        if isinstance(item, Force):
            reason = _change(section, item)
        elif isinstance(item, (MoveJ, MoveL, MoveC)):
            section.has_moved = True
            reason = _explain_move(section, item)
            section.start = end_of(item)
        if reason:
            raise Refused(post, index, reason)
    if section.leaving:
        raise Refused(
            post, len(body) - 1, "no straight motion leaves the surface after the force is off"
        )


def _change(section: _Section, item: Force) -> str:
    if not section.has_moved and item.newtons == 0:
        return ""
    if section.leaving or (section.force is not None and not section.moved):
        return "two changes of force without a motion between them"
    if item.newtons > 0:
        if section.force is not None:
            return (
                "the force is on already"
                "; each motion carries its own force, so switch it off before"
            )
        if section.start is None:
            return "pressing from a pose that is not known; put a straight motion before it"
        section.axis = tool_axis(section.start.rotation, item.force_direction)
        if section.axis is None:
            return f"the press direction is not an axis of the tool; {_TURN}"
        section.force, section.moved = item, False
        return ""
    if section.force is None:
        return "the force is off already"
    section.force, section.leaving = None, True
    return ""


def _explain_move(section: _Section, item: MoveJ | MoveL | MoveC) -> str:
    if section.leaving:
        section.leaving = False
        if isinstance(item, MoveJ):
            return "the motion that leaves the surface must be straight"
        return ""
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


#: mm: a pose is in the air if it is farther than this from the start of a section, along the tool
#: axis or against the force direction.
_AIR = 1.0


def choose_calibrations(post: str, body: Sequence[Instruction]) -> frozenset[int]:
    """Choose the motions after which the force sensor is set to zero (FCCalib), by index.

    For each section this is the last one of the motions to it that are farthest from the surface. A
    section without a motion in the air before it has none.

    Raises Refused if no motion in the air comes before the first section.
    """
    chosen: set[int] = set()
    approach: dict[int, Motion] = {}
    leaving = -1
    for index, item in enumerate(body):
        if isinstance(item, Force) and item.newtons > 0:
            farthest = _find_farthest(approach, leaving, item.force_direction)
            if farthest is not None:
                chosen.add(farthest)
            elif not chosen:
                raise Refused(
                    post,
                    index,
                    "no motion in the air before pressing, "
                    "where the force sensor can be set to zero",
                    "raise process.clearance",
                )
        elif isinstance(item, Force):
            approach, leaving = {}, index + 1
        elif isinstance(item, (MoveJ, MoveL, MoveC)):
            approach[index] = item
    return frozenset(chosen)


def _find_farthest(approach: Mapping[int, Motion], leaving: int, press: Vec3) -> int | None:
    """Choose the motion of an approach after which the sensor is set to zero.

    A motion to a pose that is known to be in the air comes first, then one to joint values, then
    the one that has just left the surface, at index `leaving`. The last motion of the approach goes
    to the surface.
    """
    start = end_of(approach.get(max(approach, default=-1)))
    if start is None:
        return None
    heights = {k: _measure(start, motion.target, press) for k, motion in approach.items()}
    last_height = heights.pop(leaving, 0.0)
    highest = max(heights.values(), default=0.0)
    if highest >= _AIR:
        return max(k for k, height in heights.items() if height >= highest - 1e-6)
    joints = [k for k, motion in approach.items() if isinstance(motion.target, Joints)]
    if joints:
        return joints[-1]
    return leaving if last_height >= _AIR else None


def _measure(start: Pose, target: Pose | Joints, press: Vec3) -> float:
    """Measure the height of `target` above `start`, mm; 0 if it is unknown.

    The height is along the tool axis or against the force direction, the larger of both.
    """
    if isinstance(target, Joints):
        return 0.0
    travel = np.subtract(target.origin, start.origin)
    return max(-float(travel @ start.rotation[:, 2]), -float(travel @ np.asarray(press)))


def stop_before_calibrations(post: str, body: Sequence[Instruction]) -> tuple[Instruction, ...]:
    """Remove the blends of the motions after which the sensor is set to zero."""
    result = list(body)
    for index in choose_calibrations(post, body):
        item = result[index]
        if isinstance(item, (MoveJ, MoveL, MoveC)):
            result[index] = replace(item, blend=0.0)
    return tuple(result)


# Limits of MoveC (docs/posts/rapid.md, section about uncertain facts).

#: rad: largest sweep of an arc.
_WIDEST = math.radians(120)
#: rad: minimum angle between circle point and end, seen from the start, and between circle point
#: and start, seen from the end, as planned and as printed. The manual asks for 1 degree at the
#: start.
_MIN_ANGLE, _MIN_PRINTED_ANGLE = math.radians(1.25), math.radians(1.1)
#: mm: minimum distance between any two of the three points.
_CLOSEST = 0.2
#: Smallest fraction of an arc that its circle point may cut off.
_SHORTER = 0.25
#: An arc that is nearer to a limit, in any unit, is tested one by one.
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
    planned = _is_round((start, via, end), _MIN_ANGLE, 2 * digit, closest)
    printed = (_round(start, decimals), _round(via, decimals), _round(end, decimals))
    if planned and _is_round(printed, _MIN_PRINTED_ANGLE, digit, 0.0):
        return ""
    return (
        f"an arc whose circle point and end are less than 1.25 deg apart, seen from its start, or "
        f"of less than {closest:g} mm or {2 * digit:g} mm height; use a straight motion"
    )


def find_round(start: FloatArray, via: FloatArray, end: FloatArray, decimals: int) -> Mask:
    """Whether `arc_fault` certainly finds no fault in arcs through points (N, 3), mm."""
    return compute_in_blocks(partial(_are_round, decimals), start, via, end)


def _are_round(decimals: int, start: FloatArray, via: FloatArray, end: FloatArray) -> Mask:
    digit = 10.0**-decimals
    points = np.stack([start, via, end])
    printed = np.round(points, decimals)
    # If the rounding of a point is uncertain, so is the printed arc.
    sure = (np.abs(np.abs(points - printed) - digit / 2) > _SURE).all(axis=(0, 2))
    shapes = _make_shapes(*points)
    sure &= (shapes.sweep <= _WIDEST) & (shapes.shorter >= _SHORTER + _SURE)
    sure &= (shapes.angle >= _MIN_ANGLE + _SURE) & (shapes.height >= 2 * digit + _SURE)
    sure &= shapes.closest >= max(_CLOSEST, 10 * digit) + _SURE
    shapes = _make_shapes(*printed)
    sure &= (shapes.angle >= _MIN_PRINTED_ANGLE + _SURE) & (shapes.height >= digit + _SURE)
    return np.asarray(sure)


def find_wide(start: FloatArray, via: FloatArray, end: FloatArray) -> Mask:
    """Whether `arc_fault` certainly finds arcs through points (N, 3), mm, to be too wide."""
    return compute_in_blocks(_are_wide, start, via, end)


def _are_wide(start: FloatArray, via: FloatArray, end: FloatArray) -> Mask:
    shapes = _make_shapes(start, via, end)
    return np.asarray((shapes.sweep > _WIDEST + 1e-6 + _SURE) & (shapes.shorter >= _SHORTER))


class _Shapes(NamedTuple):
    """N arcs through three points.

    sweep: (N,) sweep, rad.
    angle: (N,) angle between circle point and chord, at the end with the smaller one, rad.
    height: (N,) distance of the circle point from the chord, mm.
    closest: (N,) minimum distance between two of the points, mm.
    shorter: (N,) length of the shorter of the two pieces, as a fraction of the arc.
    """

    sweep: FloatArray
    angle: FloatArray
    height: FloatArray
    closest: FloatArray
    shorter: FloatArray


def _make_shapes(start: FloatArray, via: FloatArray, end: FloatArray) -> _Shapes:
    back, on, chord = start - via, end - via, end - start
    area = measure_lengths(cross(back, on))
    sweep = 2 * (np.pi - np.arctan2(area, (back * on).sum(axis=1)))
    first = np.arctan2(area, -(back * chord).sum(axis=1))
    last = np.arctan2(area, (on * chord).sum(axis=1))
    sides = [measure_lengths(side) for side in (back, on, chord)]
    with np.errstate(divide="ignore", invalid="ignore"):
        height, shorter = area / sides[2], np.minimum(first, last) / (first + last)
    return _Shapes(sweep, np.minimum(first, last), height, np.minimum.reduce(sides), shorter)


def _measure_shorter(start: Vec3, via: Vec3, end: Vec3) -> float:
    """Measure the shorter piece of an arc, as a fraction of it; 0.5 for points that make no arc."""
    first, last = _measure_angles(start, via, end)
    return min(first, last) / (first + last) if min(first, last) > 0 else 0.5


def _measure_angles(start: Vec3, via: Vec3, end: Vec3) -> tuple[float, float]:
    """Measure the angles between circle point and chord at the start and the end of an arc, rad.

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
    """Whether an arc keeps three minimum values.

    arc: start, circle point and end, mm.
    narrowest: minimum angle between circle point and chord at either end, rad.
    lowest: minimum height, mm.
    closest: minimum distance between any two of its points, mm.
    """
    start, via, end = arc
    near = min(math.dist(start, via), math.dist(via, end), math.dist(start, end))
    angle, height = min(_measure_angles(start, via, end)), measure_sweep(start, via, end)[1]
    return angle >= narrowest and height >= lowest and near >= closest


def _round(point: Vec3, decimals: int) -> Vec3:
    x, y, z = (round(v, decimals) for v in point)
    return x, y, z
