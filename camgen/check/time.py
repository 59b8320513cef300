"""The time of a program, in all and by path, and the part of it that is travel."""

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
from camgen.geometry.ragged import each_once, ends_run
from camgen.geometry.rotations import angles_between
from camgen.geometry.vectors import cross, in_blocks, lengths, unit
from camgen.model.cell import Dynamics
from camgen.model.pose import FloatArray, frozen
from camgen.model.program import Comment, Mask, MoveJ, Program, Wait, read_column, select_items
from camgen.model.tolerance import SAME_POINT_MM
from camgen.motion.limits import time_from_rest

if TYPE_CHECKING:
    from camgen.check.reach import Reach
    from camgen.robots.models import Robot


# How fast the corner between two motions is passed, by the ways in which controllers round it.

#: Corners of controllers of mills, which do not turn the tool.
_MILLS = ("arc", "junction")
#: Half a turn (rad) below which two motions go on in one direction.
_NONE = 1e-6


class Corners(Struct, frozen=True, eq=False):
    """K corners.

    half: (K,) rad, half of the turn of the direction of travel, 0 to pi / 2.
    room: (K,) mm, half of the shorter motion at the corner.
    blend: (K,) mm.
    fast: (K,) mm/s, the greater of the two feeds.
    gain: (K,) mm/s2 in the plane of the two motions.
    """

    half: FloatArray
    room: FloatArray
    blend: FloatArray
    fast: FloatArray
    gain: FloatArray


def pass_corners(corners: Corners, pace: Dynamics) -> tuple[FloatArray, FloatArray]:
    """Squared speed (K,) in each corner, infinite where nothing limits it, and how far (K,) before and behind the
    corner it holds, mm.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        square, reach = _WAYS[pace.corner](corners, pace)
    straight = corners.half < _NONE
    if pace.corner == "overlap":
        return square, reach
    return np.where(straight, np.inf, square), np.where(straight, 0.0, reach)


def _zone(corners: Corners, pace: Dynamics) -> tuple[FloatArray, FloatArray]:
    """A parabola from d before the corner to d behind it, run with one acceleration: 2 v sin(h) in the time 2 d / v."""
    reach = np.minimum(corners.blend, corners.room)
    return pace.acceleration * reach / np.sin(corners.half), reach


def _overlap(corners: Corners, pace: Dynamics) -> tuple[FloatArray, FloatArray]:
    """The next motion speeds up while the one before slows down, v^2 / 2a before the corner, whatever its angle."""
    square = np.minimum(2 * pace.acceleration * corners.room, corners.fast**2)
    return square, square / (2 * pace.acceleration)


def _arc(corners: Corners, pace: Dynamics) -> tuple[FloatArray, FloatArray]:
    """An arc that stays within ``pace.deviation`` and within its room: v^2 = a r, e = r (1 / cos(h) - 1).

    It is 2 h r long, and its speed does not change.
    """
    cosine = np.cos(corners.half)
    within = pace.deviation * cosine / (1 - cosine)
    radius = np.minimum(within, corners.room / np.tan(corners.half))
    return pace.across * corners.gain * radius, radius * corners.half


_WAYS: dict[str, Callable[[Corners, Dynamics], tuple[FloatArray, FloatArray]]] = {
    "zone": _zone,
    "overlap": _overlap,
    "arc": _arc,
}


# The motions of a program as curves: lengths, directions at both ends, radii, and how far the tool turns.


class MotionShapes(Struct, frozen=True, eq=False):
    """M motions. end: (M, 3) mm, work frame, NaN where it is not known. length: (M,) mm of the TCP, 0 where not known.
    first, last: (M, 3) unit vectors of travel at both ends. radius: (M,) mm, infinite but for arcs. turn: (M,) rad of
    the tool on the way.
    """

    end: FloatArray
    length: FloatArray
    first: FloatArray
    last: FloatArray
    radius: FloatArray
    turn: FloatArray


def shape_motions(program: Program, arm: Robot | None) -> MotionShapes:
    """The motions of ``program``. arm: tells where joint values put the tool; without one that is not known."""
    columns = program.columns
    end, turn = _place(program, arm)
    start = np.concatenate([np.full((min(1, len(end)), 3), np.nan), end[:-1]])
    length = in_blocks(lambda a, b: lengths(b - a), start, end)
    arc = columns.arcs[~np.isnan(length[columns.arcs])]
    first = in_blocks(lambda a, b: unit(np.nan_to_num(b - a)), start, end)
    last, radius = first, np.full(len(end), np.inf)
    if len(arc):
        found = in_blocks(_shape_arcs, start[arc], columns.vias_of(arc), end[arc])
        last = first.copy()
        length[arc], radius[arc], first[arc], last[arc] = (
            found[:, 0],
            found[:, 1],
            found[:, 2:5],
            found[:, 5:],
        )
    return MotionShapes(end, np.nan_to_num(length), first, last, radius, turn)


def _shape_arcs(start: FloatArray, via: FloatArray, end: FloatArray) -> FloatArray:
    """(K, 8) of arcs: length and radius, mm, and the unit vectors of travel at both ends."""
    found = make_spans_through(start, via, end)
    tangents = (unit(np.nan_to_num(one)) for one in found.tangents())
    radius = np.where(found.curved, found.radius, np.inf)
    return np.column_stack([measure_arcs(start, via, end), radius, *tangents])


def _place(program: Program, arm: Robot | None) -> tuple[FloatArray, FloatArray]:
    """Where the motions end (M, 3) and the angles (M,) by which the tool turns."""
    columns = program.columns
    if arm is not None:
        from camgen.check.reach import ends  # noqa: PLC0415 (kinematics, only for what needs them)

        fixed = select_items(columns.moves, columns.moves_are(MoveJ) & ~columns.posed)
        anchors = np.array([move.target.values for move in fixed]).reshape(
            len(fixed), len(arm.home)
        )
        end, rotation = ends(program, arm, anchors)
        return end, np.append(0.0, angles_between(rotation[:-1], rotation[1:]))
    turn = np.zeros(len(columns.moves))
    posed = columns.posed
    rotations = columns.rotations(posed)
    same = np.fromiter(map(id, rotations), np.int64, len(rotations))
    where = np.flatnonzero(posed)
    # A turn that starts at joint values is not known.
    other = np.flatnonzero((same[1:] != same[:-1]) & (np.diff(where) == 1))
    if len(other):
        pairs = [np.stack([rotations[k + late] for k in other.tolist()]) for late in (0, 1)]
        turn[where[other + 1]] = angles_between(*pairs)
    return columns.ends, turn


# The seconds of every motion: lines and arcs by acceleration and look-ahead, joint motions by the slowest joint.


class _Arm(Struct, frozen=True, eq=False):
    """R rows on the way of the robot, but for the first. motion: (R,) that each belongs to. step: (R, J) what the
    joints turn to get there, as a share of what they turn in a second at full speed. way: (R,) mm of the TCP. held:
    (J,) the share of its full speed that each joint may run at. gain: (J,) that share in a second, None: the ramp.
    """

    motion: NDArray[np.int64]
    step: FloatArray
    way: FloatArray
    held: FloatArray
    gain: FloatArray | None


class _Pieces(Struct, frozen=True, eq=False):
    """P pieces of the lines and arcs, one after the other. motion: (P,). length: (P,) mm. most: (P,) mm/s. gain: (P,)
    mm/s2 along it.
    """

    motion: NDArray[np.int64]
    length: FloatArray
    most: FloatArray
    gain: FloatArray


def time_motions(
    program: Program, pace: Dynamics, found: Reach | None, arm: Robot | None
) -> tuple[FloatArray, FloatArray]:
    """Seconds (M,) of the motions of ``program``, and where they end, (M, 3) mm, NaN where it is not known.

    found, arm: the robot and its joints along the program; without them a joint motion is the straight line between
    its ends, and takes no time where one end is not known.
    """
    columns = program.columns
    shape = shape_motions(program, arm)
    if pace.corner in _MILLS:
        shape = replace(shape, turn=np.zeros_like(shape.turn))
    rows = None if found is None or arm is None else _rows(program, found, arm)
    swing = columns.moves_are(MoveJ) & (rows is not None)
    still = ~swing & (shape.length < SAME_POINT_MM)
    seconds = np.zeros(len(swing))
    turning = np.where(columns.turn > 0, np.minimum(columns.turn, pace.turning), pace.turning)[
        still
    ]
    seconds[still] = time_from_rest(shape.turn[still], turning, pace.turning / pace.ramp)
    if rows is not None:
        rest = swing | still
        seconds[rest] = np.maximum(seconds, _joints(rows, len(swing), pace))[rest]
        share = columns.share if pace.shares else np.zeros(len(swing))
        shared = np.flatnonzero(share > 0)
        seconds[shared] = _joints(rows, len(swing), pace, np.where(share > 0, share, 1.0))[shared]
        way = _sums(rows.motion, rows.way, len(swing))
        paced = np.flatnonzero(swing & (share == 0))
        by_way = time_from_rest(way[paced], columns.speed[paced], pace.acceleration)
        seconds[paced] = np.maximum(seconds[paced], by_way)
    turned = np.flatnonzero(swing & (columns.turn > 0))
    gain = pace.turning / pace.ramp
    by_turn = time_from_rest(shape.turn[turned], columns.turn[turned], gain)
    seconds[turned] = np.maximum(seconds[turned], by_turn)
    going = ~swing & ~still
    if going.any():
        pieces = _pieces(program, shape, pace, going, rows)
        if pace.corner == "junction":
            seconds[going] += _time_blocks(program, shape, pace, going, pieces)
        else:
            seconds += _run(pieces, _corners(program, shape, pace, going), len(swing))
    if found is not None and arm is not None and (columns.blend > 0).any():
        from camgen.check.passing import save_seconds  # noqa: PLC0415 (kinematics, only for what needs them)

        seconds = np.maximum(seconds - save_seconds(program, found, arm, pace), 0.0)
    return seconds, shape.end


def _rows(program: Program, found: Reach, arm: Robot) -> _Arm:
    from camgen.robots.kinematics.forward import flange  # noqa: PLC0415 (kinematics, only for what needs them)

    owner = np.searchsorted(program.columns.at, found.owner)[1:]
    turned, origin = flange(arm, found.joints)
    place = origin + turned @ np.asarray(program.flange_from_tool.origin)
    step = np.abs(np.diff(found.joints, axis=0)) / arm.speeds
    gain = None if arm.accelerations is None else arm.accelerations / arm.speeds
    return _Arm(
        owner, step, np.linalg.norm(np.diff(place, axis=0), axis=1), arm.fastest / arm.speeds, gain
    )


def _joints(rows: _Arm, count: int, pace: Dynamics, share: FloatArray | float = 1.0) -> FloatArray:
    """Seconds (M,) of the slowest joint from rest to rest. share: of its full speed, (M,) or one for all."""
    ways = np.stack([_sums(rows.motion, step, count) for step in rows.step.T])
    gain = 1.0 / pace.ramp if rows.gain is None else rows.gain[:, None]
    return np.asarray(time_from_rest(ways, np.minimum(share, rows.held[:, None]), gain).max(axis=0))


def _pieces(
    program: Program, shape: MotionShapes, pace: Dynamics, going: Mask, rows: _Arm | None
) -> _Pieces:
    """The motions that are ``going`` with what limits their speed, row by row where the joints are known.

    That is their feed, what the tool can turn meanwhile, and on arcs the acceleration across: v^2 = a r.
    """
    motion = np.flatnonzero(going)
    length, turn = shape.length[motion], shape.turn[motion]
    radius = shape.radius[motion]
    # A planner of blocks runs arcs as chords, whose junctions limit their speed.
    curved = ~np.isinf(radius) & (pace.corner != "junction")
    speed, gain = program.columns.speed[motion], np.full(len(motion), pace.acceleration)
    if pace.axes is not None:
        speed, gain = _limit_by_axes(program, shape, pace, motion)
    most = np.minimum(speed, np.sqrt(np.where(curved, pace.across * gain * radius, np.inf)))
    gain = gain * np.where(curved, pace.along, 1.0)
    turning = turn > 0
    most[turning] = np.minimum(most[turning], length[turning] * pace.turning / turn[turning])
    if rows is None:
        return _Pieces(motion, length, most, gain)
    counts = np.bincount(rows.motion, minlength=len(going))
    row = going[rows.motion]
    owner, slowest = rows.motion[row], (rows.step[row] / rows.held).max(axis=1)
    place = np.searchsorted(motion, owner)
    piece = length[place] / counts[owner]
    with np.errstate(divide="ignore"):
        return _Pieces(owner, piece, np.minimum(most[place], piece / slowest), gain[place])


def _limit_by_axes(
    program: Program, shape: MotionShapes, pace: Dynamics, motion: NDArray[np.int64]
) -> tuple[FloatArray, FloatArray]:
    """(G,) speeds, mm/s, and accelerations, mm/s2, of the motions (G,) that the axes of a machine allow.

    Rapid motions run at the rate of the machine, not at a speed of the program. Arcs are level.
    """
    from camgen.check.axis_limits import limit_along, limit_around  # noqa: PLC0415 (as below)

    axes = pace.axes
    assert axes is not None
    columns = program.columns
    rapid = columns.moves_are(MoveJ)[motion]
    if pace.corner == "junction":
        # The axes limit each of its blocks.
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
    program: Program, shape: MotionShapes, pace: Dynamics, going: Mask, pieces: _Pieces
) -> FloatArray:
    """Seconds (G,) of the motions that are ``going``, on a controller that plans blocks."""
    from camgen.check.blocks import Motions, time_blocks  # noqa: PLC0415 (only GRBL)

    columns = program.columns
    index = np.flatnonzero(going)
    speed = np.full(len(going), np.inf)
    np.minimum.at(speed, pieces.motion, pieces.most)
    via = np.full((len(going), 3), np.nan)
    arcs = columns.arcs
    via[arcs] = columns.vias_of(arcs)
    start = np.concatenate([shape.end[:1], shape.end[:-1]])[index]
    acts = ~columns.are(Comment)
    # A motion without a step makes no block.
    acts[columns.at[~going & (shape.length < SAME_POINT_MM)]] = False
    stops = np.append(np.diff(np.cumsum(acts)[columns.at[index]]) != 1, True)
    motions = Motions(start, shape.end[index], via[index], speed[index], stops)
    return time_blocks(motions, pace)


def _limit_turns(before: FloatArray, after: FloatArray, pace: Dynamics) -> FloatArray:
    """(K,) mm/s2 in the plane of two directions (K, 3), whichever way it points there."""
    gain = np.full(len(before), pace.acceleration)
    if pace.axes is None:
        return gain
    from camgen.check.axis_limits import limit_around  # noqa: PLC0415 (only jobs with a machine)

    limit = limit_around(pace.axes.accelerations, unit(cross(before, after)))
    return np.asarray(np.minimum(gain, limit))


class _Ends(Struct, frozen=True, eq=False):
    """Limits at the ends of G motions.

    square: (G,) squared speed, mm2/s2, that is allowed at the end of a motion.
    reach: (G,) mm before and after the end in which that holds.
    share: (G,) share of its acceleration that a motion may use.
    """

    square: FloatArray
    reach: FloatArray
    share: FloatArray


def _corners(program: Program, shape: MotionShapes, pace: Dynamics, going: Mask) -> _Ends:
    """The limits at the ends of the motions that are ``going``.

    The machine stands before and after all that is no line or arc, and where something is
    switched. A blend of 0 is a stop where the controller knows blends.
    """
    columns = program.columns
    index = np.flatnonzero(going)
    square, reach = np.zeros(len(index)), np.zeros(len(index))
    done = np.cumsum(~columns.are(Comment))[columns.at]
    follows = (np.diff(index) == 1) & (np.diff(done[index]) == 1)
    share = np.where(np.append(follows, False), 1.0, pace.last)
    if pace.corner in ("zone", "overlap"):
        follows &= columns.blend[index[:-1]] > 0
    if pace.rapid_stops:
        rapid = columns.moves_are(MoveJ)[index]
        follows &= rapid[:-1] == rapid[1:]
    one, two = index[:-1][follows], index[1:][follows]
    # Half of the angle between unit vectors, exact for small and for large ones.
    apart = lengths(shape.first[two] - shape.last[one])
    along = lengths(shape.first[two] + shape.last[one])
    corners = Corners(
        half=np.arctan2(apart, along),
        room=np.minimum(shape.length[one], shape.length[two]) / 2,
        blend=columns.blend[one],
        fast=np.maximum(columns.speed[one], columns.speed[two]),
        gain=_limit_turns(shape.last[one], shape.first[two], pace),
    )
    here = np.flatnonzero(follows)
    limit, around = pass_corners(corners, pace)
    # A motion that may not brake as hard as others is entered as if half of it were to stop in.
    brake = pace.last * pace.acceleration * np.where(np.isinf(shape.radius[two]), 1.0, pace.along)
    is_held = share[1:][follows] < 1
    limit = np.where(is_held, np.minimum(limit, brake * shape.length[two]), limit)
    if pace.last < 1:
        # A level arc and a line up or down beside it share the acceleration, and nearly stop.
        rise = np.maximum(np.abs(shape.last[one, 2]), np.abs(shape.first[two, 2])) > _NONE
        overlap = rise & ~(np.isinf(shape.radius[one]) & np.isinf(shape.radius[two]))
        limit[overlap] = around[overlap] = 0.0
        share[here[overlap]] = share[here[overlap] + 1] = pace.last
    square[here], reach[here] = limit, np.where(limit < corners.fast**2, around, 0.0)
    return _Ends(square, reach, share)


def _run(pieces: _Pieces, limits: _Ends, count: int) -> FloatArray:
    """Seconds (M,) of the motions that the pieces belong to."""
    square, reach = limits.square, limits.reach
    nodes = np.append(0.0, np.cumsum(pieces.length))
    ends = nodes[1:][ends_run(pieces.motion)]
    wide = np.flatnonzero(reach > 0)
    begin, end = ends[wide] - reach[wide], ends[wide] + reach[wide]
    edges = each_once(np.concatenate([nodes, begin, end]))
    length, middle = np.diff(edges), (edges[1:] + edges[:-1]) / 2
    piece = np.searchsorted(nodes, middle) - 1
    most, gain = pieces.most[piece], pieces.gain[piece]
    gain *= limits.share[np.searchsorted(ends, middle)]
    if len(wide):
        zone = np.searchsorted(begin, middle) - 1
        inside = (zone >= 0) & (middle < end[zone])
        most[inside] = np.minimum(most[inside], np.sqrt(square[wide][zone[inside]]))
    allowed = np.append(0.0, np.minimum(most, np.append(most[1:], 0.0)) ** 2)
    at = np.searchsorted(edges, ends)
    np.minimum.at(allowed, at, square)
    found = durations(length, most, squares(length, allowed, gain), gain)
    return _sums(pieces.motion[piece], found, count)


def _sums(motion: NDArray[np.int64], values: FloatArray, count: int) -> FloatArray:
    """The sums (M,) of values by the motion that they belong to."""
    return np.asarray(np.bincount(motion, values, count), dtype=np.float64)


def assign_paths(program: Program) -> NDArray[np.int64]:
    """(M,): the path along which each motion of ``program`` runs, -1 for ways between paths."""
    return np.where(program.columns.works, program.columns.path, -1)


def cycle(
    program: Program, pace: Dynamics, found: Reach | None = None, arm: Robot | None = None
) -> Cycle:
    """The time of ``program``, in all and by path. found, arm: see ``time_motions``."""
    columns = program.columns
    seconds, _ = time_motions(program, pace, found, arm)
    path = assign_paths(program)
    # A wait belongs to what comes after it: the one after the signal is switched on to the path, as the pauses in it.
    waits = np.searchsorted(columns.at, np.flatnonzero(columns.are(Wait)))
    every = np.concatenate([seconds, read_column(columns.of(Wait), "seconds")])
    owner = np.append(path, np.append(path, -1)[waits])
    count = len(program.paths)
    # Travel leads to the next path that is worked on.
    at = np.flatnonzero(path >= 0)
    order = np.searchsorted(at, np.concatenate([np.arange(len(path)), waits]))
    next_path = np.append(path[at], count)[order]
    travels = owner < 0
    paths = np.bincount(owner[~travels], every[~travels], count)
    links = np.bincount(next_path[travels], every[travels], count + 1)[:count]
    return Cycle(exact_sum(every), exact_sum(every[travels]), frozen(paths), frozen(links))
