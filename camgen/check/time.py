"""Computes the time of a program: in total, per path, and on links."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
from msgspec import Struct
from msgspec.structs import replace
from numpy.typing import NDArray

from camgen.check.profile import durations, squares
from camgen.check.report import Cycle, exact_sum
from camgen.geometry.arcs import make_spans_through, measure_arcs
from camgen.geometry.ragged import mark_run_ends, select_distinct
from camgen.geometry.rotations import measure_angles_between
from camgen.geometry.vectors import compute_in_blocks, cross, measure_lengths, normalize
from camgen.model.cell import Dynamics
from camgen.model.pose import FloatArray, frozen
from camgen.model.program import Comment, Mask, MoveJ, Program, Wait, read_column, select_items
from camgen.model.sequences import take_rows
from camgen.model.tolerance import SAME_POINT_MM
from camgen.motion.limits import time_from_rest

if TYPE_CHECKING:
    from camgen.check.reach import JointTrace
    from camgen.robots.models import Robot


#: `Dynamics.corner` of controllers of mills, which do not reorient the tool.
_MILLS = ("arc", "junction")
#: rad: half of a corner angle below which the direction does not change.
_STRAIGHT = 1e-6


class Corners(Struct, frozen=True, eq=False):
    """K corners.

    half: (K,) half of the corner angle between the two directions, 0 to pi / 2 rad.
    room: (K,) half of the length of the shorter motion at the corner, mm.
    blend: (K,) blend radius, mm.
    fast: (K,) the higher of the two feeds, mm/s.
    gain: (K,) acceleration in the plane of the two motions, mm/s2.
    """

    half: FloatArray
    room: FloatArray
    blend: FloatArray
    fast: FloatArray
    gain: FloatArray


def pass_corners(corners: Corners, pace: Dynamics) -> tuple[FloatArray, FloatArray]:
    """Compute the squared speed (K,) in each corner, mm2/s2, infinite without a limit.

    Also returns the length (K,) before and after the corner in which it holds, mm.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        square, reach = _METHODS[pace.corner](corners, pace)
    straight = corners.half < _STRAIGHT
    if pace.corner == "overlap":
        return square, reach
    return np.where(straight, np.inf, square), np.where(straight, 0.0, reach)


def _zone(corners: Corners, pace: Dynamics) -> tuple[FloatArray, FloatArray]:
    """A parabola from d before the corner to d after it, run with constant acceleration.

    The velocity changes by 2 v sin(h) in the time 2 d / v.
    """
    reach = np.minimum(corners.blend, corners.room)
    return pace.acceleration * reach / np.sin(corners.half), reach


def _overlap(corners: Corners, pace: Dynamics) -> tuple[FloatArray, FloatArray]:
    """The next motion starts while the last one brakes, v^2 / 2a before a corner of any angle."""
    square = np.minimum(2 * pace.acceleration * corners.room, corners.fast**2)
    return square, square / (2 * pace.acceleration)


def _arc(corners: Corners, pace: Dynamics) -> tuple[FloatArray, FloatArray]:
    """An arc that stays within `pace.deviation` and within its room, at constant speed.

    Its length is 2 h r; v^2 = a r and e = r (1 / cos(h) - 1).
    """
    cosine = np.cos(corners.half)
    radius = np.minimum(pace.deviation * cosine / (1 - cosine), corners.room / np.tan(corners.half))
    return pace.across * corners.gain * radius, radius * corners.half


#: The speed in corners, by `Dynamics.corner`.
_METHODS: dict[str, Callable[[Corners, Dynamics], tuple[FloatArray, FloatArray]]] = {
    "zone": _zone,
    "overlap": _overlap,
    "arc": _arc,
}


class MotionShapes(Struct, frozen=True, eq=False):
    """M motions as curves of the TCP.

    end: (M, 3) end in the work frame, mm; NaN if it is unknown.
    length: (M,) length, mm; 0 if it is unknown.
    first: (M, 3) direction of travel at the start, unit vectors.
    last: (M, 3) direction of travel at the end, unit vectors.
    radius: (M,) radius of an arc, mm; infinite for all other motions.
    turn: (M,) angle by which the tool is reoriented, rad.
    """

    end: FloatArray
    length: FloatArray
    first: FloatArray
    last: FloatArray
    radius: FloatArray
    turn: FloatArray


def compute_motion_shapes(program: Program, arm: Robot | None) -> MotionShapes:
    """Compute the curves of the motions of `program`.

    arm: the arm, for the position of the tool at joint values; without it that is unknown.
    """
    columns = program.columns
    end, turn = _compute_ends(program, arm)
    start = np.concatenate([np.full((min(1, len(end)), 3), np.nan), end[:-1]])
    length = compute_in_blocks(lambda a, b: measure_lengths(b - a), start, end)
    arc = columns.arcs[~np.isnan(length[columns.arcs])]
    first = compute_in_blocks(lambda a, b: normalize(np.nan_to_num(b - a)), start, end)
    last, radius = first, np.full(len(end), np.inf)
    if len(arc):
        shapes = compute_in_blocks(_shape_arcs, start[arc], columns.vias_of(arc), end[arc])
        last = first.copy()
        length[arc], radius[arc] = shapes[:, 0], shapes[:, 1]
        first[arc], last[arc] = shapes[:, 2:5], shapes[:, 5:]
    return MotionShapes(end, np.nan_to_num(length), first, last, radius, turn)


def _shape_arcs(start: FloatArray, via: FloatArray, end: FloatArray) -> FloatArray:
    """Compute (K, 8) of arcs: length and radius, mm, and the directions of travel at both ends."""
    spans = make_spans_through(start, via, end)
    tangents = (normalize(np.nan_to_num(tangent)) for tangent in spans.tangents())
    return np.column_stack(
        [measure_arcs(start, via, end), np.where(spans.curved, spans.radius, np.inf), *tangents]
    )


def _compute_ends(program: Program, arm: Robot | None) -> tuple[FloatArray, FloatArray]:
    columns = program.columns
    if arm is not None:
        # Kinematics are loaded for programs of arms only, here and below.
        from camgen.check.reach import compute_ends  # noqa: PLC0415

        fixed = select_items(columns.moves, columns.moves_are(MoveJ) & ~columns.posed)
        anchors = np.array([move.target.values for move in fixed])
        end, rotation = compute_ends(program, arm, anchors.reshape(len(fixed), len(arm.home)))
        return end, np.append(0.0, measure_angles_between(rotation[:-1], rotation[1:]))
    turn = np.zeros(len(columns.moves))
    posed = columns.posed
    rotations = columns.rotations(posed)
    same = np.fromiter(map(id, rotations), np.int64, len(rotations))
    motions = np.flatnonzero(posed)
    # A reorientation that starts at joint values is unknown.
    changes = np.flatnonzero((same[1:] != same[:-1]) & (np.diff(motions) == 1))
    if len(changes):
        before = np.stack(take_rows(rotations, changes.tolist()))
        after = np.stack(take_rows(rotations, (changes + 1).tolist()))
        turn[motions[changes + 1]] = measure_angles_between(before, after)
    return columns.ends, turn


class _JointSteps(Struct, frozen=True, eq=False):
    """The R steps between the samples of a `Reach`.

    motion: (R,) motion of each step.
    step: (R, J) travel of each joint divided by its maximum speed, s.
    mm: (R,) travel of the TCP, mm.
    held: (J,) fraction of its maximum speed at which each joint may run.
    gain: (J,) acceleration divided by the maximum speed, 1/s; None: by `Dynamics.ramp`.
    """

    motion: NDArray[np.int64]
    step: FloatArray
    mm: FloatArray
    held: FloatArray
    gain: FloatArray | None


class _Pieces(Struct, frozen=True, eq=False):
    """P consecutive pieces of lines and arcs, each with its own limits.

    motion: (P,) motion of each piece.
    length: (P,) mm.
    limit: (P,) maximum speed, mm/s.
    gain: (P,) acceleration along the piece, mm/s2.
    """

    motion: NDArray[np.int64]
    length: FloatArray
    limit: FloatArray
    gain: FloatArray


def time_motions(
    program: Program, pace: Dynamics, reach: JointTrace | None, arm: Robot | None
) -> FloatArray:
    """Compute the seconds (M,) of all motions.

    Lines and arcs are timed by acceleration and look-ahead, joint motions by the slowest joint.

    reach: joint values along the program.
    arm: the robot. Without both a joint motion is the straight line between its ends. It takes no
        time if one end is unknown.
    """
    columns = program.columns
    shape = compute_motion_shapes(program, arm)
    if pace.corner in _MILLS:
        shape = replace(shape, turn=np.zeros_like(shape.turn))
    steps = None if reach is None or arm is None else _make_joint_steps(program, reach, arm)
    is_joint = columns.moves_are(MoveJ) & (steps is not None)
    still = ~is_joint & (shape.length < SAME_POINT_MM)
    count = len(is_joint)
    seconds = np.zeros(count)
    turning = np.where(columns.turn > 0, np.minimum(columns.turn, pace.turning), pace.turning)
    gain = pace.turning / pace.ramp
    seconds[still] = time_from_rest(shape.turn[still], turning[still], gain)
    if steps is not None:
        rest = is_joint | still
        seconds[rest] = np.maximum(seconds, _time_joints(steps, count, pace))[rest]
        share = columns.share if pace.shares else np.zeros(count)
        shared = np.flatnonzero(share > 0)
        seconds[shared] = _time_joints(steps, count, pace, np.where(share > 0, share, 1.0))[shared]
        mm = _sum_by_motion(steps.motion, steps.mm, count)
        paced = np.flatnonzero(is_joint & (share == 0))
        seconds[paced] = np.maximum(
            seconds[paced], time_from_rest(mm[paced], columns.speed[paced], pace.acceleration)
        )
    turned = np.flatnonzero(is_joint & (columns.turn > 0))
    seconds[turned] = np.maximum(
        seconds[turned], time_from_rest(shape.turn[turned], columns.turn[turned], gain)
    )
    timed = ~is_joint & ~still
    if timed.any():
        pieces = _make_pieces(program, shape, pace, timed, steps)
        if pace.corner == "junction":
            seconds[timed] += _time_blocks(program, shape, pace, timed, pieces)
        else:
            seconds += _time_pieces(pieces, _limit_ends(program, shape, pace, timed), count)
    if reach is not None and arm is not None and (columns.blend > 0).any():
        from camgen.check.passing import compute_saved_seconds  # noqa: PLC0415

        seconds = np.maximum(seconds - compute_saved_seconds(program, reach, arm, pace), 0.0)
    return seconds


def _make_joint_steps(program: Program, reach: JointTrace, arm: Robot) -> _JointSteps:
    from camgen.check.reach import compute_tips  # noqa: PLC0415

    owner = np.searchsorted(program.columns.at, reach.owner)[1:]
    tip = compute_tips(arm, reach.joints, program.flange_from_tool)
    step = np.abs(np.diff(reach.joints, axis=0)) / arm.speeds
    mm = np.linalg.norm(np.diff(tip, axis=0), axis=1)
    gain = None if arm.accelerations is None else arm.accelerations / arm.speeds
    return _JointSteps(owner, step, mm, arm.fastest / arm.speeds, gain)


def _time_joints(
    steps: _JointSteps, count: int, pace: Dynamics, fraction: FloatArray | float = 1.0
) -> FloatArray:
    """Compute the seconds (M,) of the slowest joint from rest to rest.

    fraction: fraction of the joints' maximum speeds, (M,) or one for all.
    """
    travel = np.stack([_sum_by_motion(steps.motion, step, count) for step in steps.step.T])
    gain = 1.0 / pace.ramp if steps.gain is None else steps.gain[:, None]
    limit = np.minimum(fraction, steps.held[:, None])
    return np.asarray(time_from_rest(travel, limit, gain).max(axis=0))


def _make_pieces(
    program: Program, shape: MotionShapes, pace: Dynamics, timed: Mask, steps: _JointSteps | None
) -> _Pieces:
    """Compute the speed limits of the `timed` motions, per joint step if the joints are known.

    The limits are the feed, the speed of the reorientation, and on arcs the acceleration across the
    path: v^2 = a r.
    """
    motion = np.flatnonzero(timed)
    length, turn = shape.length[motion], shape.turn[motion]
    radius = shape.radius[motion]
    # A planner of blocks runs arcs as chords, whose junctions limit their speed.
    curved = ~np.isinf(radius) & (pace.corner != "junction")
    speed, gain = program.columns.speed[motion], np.full(len(motion), pace.acceleration)
    if pace.axes is not None:
        speed, gain = _limit_by_axes(program, shape, pace, motion)
    limit = np.minimum(speed, np.sqrt(np.where(curved, pace.across * gain * radius, np.inf)))
    gain = gain * np.where(curved, pace.along, 1.0)
    turning = turn > 0
    limit[turning] = np.minimum(limit[turning], length[turning] * pace.turning / turn[turning])
    if steps is None:
        return _Pieces(motion, length, limit, gain)
    counts = np.bincount(steps.motion, minlength=len(timed))
    row = timed[steps.motion]
    owner, slowest = steps.motion[row], (steps.step[row] / steps.held).max(axis=1)
    index = np.searchsorted(motion, owner)
    piece = length[index] / counts[owner]
    with np.errstate(divide="ignore"):
        return _Pieces(owner, piece, np.minimum(limit[index], piece / slowest), gain[index])


def _limit_by_axes(
    program: Program, shape: MotionShapes, pace: Dynamics, motion: NDArray[np.int64]
) -> tuple[FloatArray, FloatArray]:
    """Compute speeds (G,), mm/s, and accelerations (G,), mm/s2, that the axes of a machine allow.

    Rapid motions run at the rate of the machine, not at a speed of the program. Arcs are level.
    """
    # Only jobs with a machine need this, here and below.
    from camgen.check.axis_limits import limit_along, limit_around  # noqa: PLC0415

    axes = pace.axes
    assert axes is not None
    columns = program.columns
    rapid = columns.moves_are(MoveJ)[motion]
    if pace.corner == "junction":
        # The axes limit each block of this planner.
        return np.where(rapid, np.inf, columns.speed[motion]), np.full(len(motion), np.inf)
    first = shape.first[motion]
    level = ~np.isinf(shape.radius[motion])
    up = np.broadcast_to((0.0, 0.0, 1.0), first.shape)
    limits = []
    for each, whole in ((axes.rates, pace.fastest), (axes.accelerations, pace.acceleration)):
        limit = np.where(level, limit_around(each, up), limit_along(each, first))
        limits.append(np.minimum(limit, whole))
    rates, gain = limits
    return np.where(rapid, rates, np.minimum(columns.speed[motion], rates)), gain


def _time_blocks(
    program: Program, shape: MotionShapes, pace: Dynamics, timed: Mask, pieces: _Pieces
) -> FloatArray:
    """Compute the seconds (G,) of the `timed` motions on a controller that plans blocks."""
    from camgen.check.blocks import Motions, time_blocks  # noqa: PLC0415 (only GRBL)

    columns = program.columns
    index = np.flatnonzero(timed)
    speed = np.full(len(timed), np.inf)
    np.minimum.at(speed, pieces.motion, pieces.limit)
    via = np.full((len(timed), 3), np.nan)
    arcs = columns.arcs
    via[arcs] = columns.vias_of(arcs)
    start = np.concatenate([shape.end[:1], shape.end[:-1]])[index]
    acts = ~columns.are(Comment)
    # A motion without a step makes no block.
    acts[columns.at[~timed & (shape.length < SAME_POINT_MM)]] = False
    stops = np.append(np.diff(np.cumsum(acts)[columns.at[index]]) != 1, True)
    return time_blocks(Motions(start, shape.end[index], via[index], speed[index], stops), pace)


def _limit_turns(before: FloatArray, after: FloatArray, pace: Dynamics) -> FloatArray:
    """Compute the acceleration (K,) in the plane of two directions (K, 3), mm/s2.

    It holds for every direction in that plane.
    """
    gain = np.full(len(before), pace.acceleration)
    if pace.axes is None:
        return gain
    from camgen.check.axis_limits import limit_around  # noqa: PLC0415

    limit = limit_around(pace.axes.accelerations, normalize(cross(before, after)))
    return np.asarray(np.minimum(gain, limit))


class _Ends(Struct, frozen=True, eq=False):
    """Limits at the ends of G motions.

    square: (G,) squared speed that is allowed at the end of a motion, mm2/s2.
    reach: (G,) length before and after the end in which that holds, mm.
    share: (G,) fraction of its acceleration that a motion may use.
    """

    square: FloatArray
    reach: FloatArray
    share: FloatArray


def _limit_ends(program: Program, shape: MotionShapes, pace: Dynamics, timed: Mask) -> _Ends:
    """Compute the limits at the ends of the `timed` motions.

    The machine stops before and after all other motions, and where an output is set. If the
    controller knows blends, a blend of 0 is a stop.
    """
    columns = program.columns
    index = np.flatnonzero(timed)
    square, reach = np.zeros(len(index)), np.zeros(len(index))
    done = np.cumsum(~columns.are(Comment))[columns.at]
    follows = (np.diff(index) == 1) & (np.diff(done[index]) == 1)
    share = np.where(np.append(follows, False), 1.0, pace.last)
    if pace.corner in ("zone", "overlap"):
        follows &= columns.blend[index[:-1]] > 0
    if pace.rapid_stops:
        rapid = columns.moves_are(MoveJ)[index]
        follows &= rapid[:-1] == rapid[1:]
    before, after = index[:-1][follows], index[1:][follows]
    difference = measure_lengths(shape.first[after] - shape.last[before])
    total = measure_lengths(shape.first[after] + shape.last[before])
    corners = Corners(
        # Half of the angle between unit vectors, exact for small and for large angles.
        half=np.arctan2(difference, total),
        room=np.minimum(shape.length[before], shape.length[after]) / 2,
        blend=columns.blend[before],
        fast=np.maximum(columns.speed[before], columns.speed[after]),
        gain=_limit_turns(shape.last[before], shape.first[after], pace),
    )
    ends = np.flatnonzero(follows)
    limit, around = pass_corners(corners, pace)
    # A motion that may not brake as hard as others is entered as if it had to stop in its half.
    brake = pace.last * pace.acceleration * np.where(np.isinf(shape.radius[after]), 1.0, pace.along)
    limit = np.where(share[1:][follows] < 1, np.minimum(limit, brake * shape.length[after]), limit)
    if pace.last < 1:
        # A level arc and a line up or down next to it share the acceleration, and nearly stop.
        rise = np.maximum(np.abs(shape.last[before, 2]), np.abs(shape.first[after, 2])) > _STRAIGHT
        overlap = rise & ~(np.isinf(shape.radius[before]) & np.isinf(shape.radius[after]))
        limit[overlap] = around[overlap] = 0.0
        share[ends[overlap]] = share[ends[overlap] + 1] = pace.last
    square[ends], reach[ends] = limit, np.where(limit < corners.fast**2, around, 0.0)
    return _Ends(square, reach, share)


def _time_pieces(pieces: _Pieces, limits: _Ends, count: int) -> FloatArray:
    square, reach = limits.square, limits.reach
    nodes = np.append(0.0, np.cumsum(pieces.length))
    ends = nodes[1:][mark_run_ends(pieces.motion)]
    wide = np.flatnonzero(reach > 0)
    begin, end = ends[wide] - reach[wide], ends[wide] + reach[wide]
    edges = select_distinct(np.concatenate([nodes, begin, end]))
    length, middle = np.diff(edges), (edges[1:] + edges[:-1]) / 2
    piece = np.searchsorted(nodes, middle) - 1
    limit, gain = pieces.limit[piece], pieces.gain[piece]
    gain *= limits.share[np.searchsorted(ends, middle)]
    if len(wide):
        zone = np.searchsorted(begin, middle) - 1
        inside = (zone >= 0) & (middle < end[zone])
        limit[inside] = np.minimum(limit[inside], np.sqrt(square[wide][zone[inside]]))
    allowed = np.append(0.0, np.minimum(limit, np.append(limit[1:], 0.0)) ** 2)
    np.minimum.at(allowed, np.searchsorted(edges, ends), square)
    seconds = durations(length, limit, squares(length, allowed, gain), gain)
    return _sum_by_motion(pieces.motion[piece], seconds, count)


def _sum_by_motion(motion: NDArray[np.int64], values: FloatArray, count: int) -> FloatArray:
    return np.asarray(np.bincount(motion, values, count), dtype=np.float64)


def assign_paths(program: Program) -> NDArray[np.int64]:
    """Return the path (M,) along which each motion runs, -1 for links."""
    return np.where(program.columns.works, program.columns.path, -1)


def compute_cycle(
    program: Program, pace: Dynamics, reach: JointTrace | None = None, arm: Robot | None = None
) -> Cycle:
    """Compute the time of a program in total and per path; `reach`, `arm`: see `time_motions`."""
    columns = program.columns
    seconds = time_motions(program, pace, reach, arm)
    path = assign_paths(program)
    # A wait belongs to the next motion. So the wait after an output is set on, and pauses in a
    # path, belong to the path.
    waits = np.searchsorted(columns.at, np.flatnonzero(columns.are(Wait)))
    times = np.concatenate([seconds, read_column(columns.list_kinds(Wait), "seconds")])
    owner = np.append(path, np.append(path, -1)[waits])
    count = len(program.paths)
    # Travel leads to the next path that is worked on.
    at = np.flatnonzero(path >= 0)
    order = np.searchsorted(at, np.concatenate([np.arange(len(path)), waits]))
    next_path = np.append(path[at], count)[order]
    travels = owner < 0
    paths = np.bincount(owner[~travels], times[~travels], count)
    links = np.bincount(next_path[travels], times[travels], count + 1)[:count]
    return Cycle(exact_sum(times), exact_sum(times[travels]), frozen(paths), frozen(links))
