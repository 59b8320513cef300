"""The seconds of every motion: lines and arcs by acceleration and look-ahead, joint motions by the slowest joint."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from camgen.body import Mask
from camgen.cycle.corners import Corners, passed
from camgen.cycle.profile import durations, from_rest, squares
from camgen.cycle.shape import Shape, shaped
from camgen.ir import Comment, MoveJ, Program
from camgen.pose import FloatArray
from camgen.post import Pace

if TYPE_CHECKING:
    from camgen.reach import Reach
    from camgen.robots.models import Robot

#: A motion shorter than this only turns the tool, mm.
_STILL = 1e-6


class _Arm(Struct, frozen=True, eq=False):
    """R rows on the way of the robot, but for the first. motion: (R,) that each belongs to. step: (R, J) what the
    joints turn to get there, as a share of what they turn in a second at full speed. way: (R,) mm of the TCP.
    """

    motion: NDArray[np.int64]
    step: FloatArray
    way: FloatArray


class _Pieces(Struct, frozen=True, eq=False):
    """P pieces of the lines and arcs, one after the other. motion: (P,). length: (P,) mm. most: (P,) mm/s. gain: (P,)
    mm/s2 along it.
    """

    motion: NDArray[np.int64]
    length: FloatArray
    most: FloatArray
    gain: FloatArray


def timed(program: Program, pace: Pace, found: Reach | None, arm: Robot | None) -> tuple[FloatArray, FloatArray]:
    """Seconds (M,) of the motions of ``program``, and where they end, (M, 3) mm, NaN where it is not known.

    found, arm: the robot and its joints along the program; without them a joint motion is the straight line between
    its ends, and takes no time where one end is not known.
    """
    columns = program.columns
    shape = shaped(program, arm)
    rows = None if found is None or arm is None else _rows(program, found, arm)
    swing = columns.moves_are(MoveJ) & (rows is not None)
    still = ~swing & (shape.length < _STILL)
    seconds = np.zeros(len(swing))
    seconds[still] = from_rest(shape.turn[still], pace.turning, pace.turning / pace.ramp)
    if rows is not None:
        rest = swing | still
        seconds[rest] = np.maximum(seconds, _joints(rows, len(swing), pace))[rest]
        way = _sums(rows.motion, rows.way, len(swing))[swing]
        seconds[swing] = np.maximum(seconds[swing], from_rest(way, columns.speed[swing], pace.acceleration))
    going = ~swing & ~still
    if going.any():
        pieces = _pieces(program, shape, pace, going, rows)
        seconds += _run(pieces, *_corners(program, shape, pace, going), pace.last, len(swing))
    return seconds, shape.end


def _rows(program: Program, found: Reach, arm: Robot) -> _Arm:
    from camgen.robots.forward import flange  # noqa: PLC0415 (kinematics, only for what needs them)

    owner = np.searchsorted(program.columns.at, found.owner)[1:]
    turned, origin = flange(arm, found.joints)
    place = origin + turned @ np.asarray(program.flange_from_tool.origin)
    step = np.abs(np.diff(found.joints, axis=0)) / arm.speeds
    return _Arm(owner, step, np.linalg.norm(np.diff(place, axis=0), axis=1))


def _joints(rows: _Arm, count: int, pace: Pace) -> FloatArray:
    """Seconds (M,) of the slowest joint from rest to rest."""
    ways = np.stack([_sums(rows.motion, step, count) for step in rows.step.T])
    return np.asarray(from_rest(ways, 1.0, 1.0 / pace.ramp).max(axis=0))


def _pieces(program: Program, shape: Shape, pace: Pace, going: Mask, rows: _Arm | None) -> _Pieces:
    """The motions that are ``going`` with what limits their speed, row by row where the joints are known.

    That is their feed, what the tool can turn meanwhile, and on arcs the acceleration across: v^2 = a r.
    """
    motion = np.flatnonzero(going)
    length, turn = shape.length[motion], shape.turn[motion]
    radius = shape.radius[motion]
    most = np.minimum(program.columns.speed[motion], np.sqrt(pace.across * pace.acceleration * radius))
    gain = pace.acceleration * np.where(np.isinf(radius), 1.0, pace.along)
    turning = turn > 0
    most[turning] = np.minimum(most[turning], length[turning] * pace.turning / turn[turning])
    if rows is None:
        return _Pieces(motion, length, most, gain)
    counts = np.bincount(rows.motion, minlength=len(going))
    row = going[rows.motion]
    owner, slowest = rows.motion[row], rows.step[row].max(axis=1)
    place = np.searchsorted(motion, owner)
    piece = length[place] / counts[owner]
    with np.errstate(divide="ignore"):
        return _Pieces(owner, piece, np.minimum(most[place], piece / slowest), gain[place])


def _corners(program: Program, shape: Shape, pace: Pace, going: Mask) -> tuple[FloatArray, FloatArray]:
    """Squared speed allowed at the end of each motion that is ``going``, and how far around it that holds, (G,) each.

    The machine stands before and after all that is no line or arc, and where something is switched. A blend of 0 is a
    stop where the controller knows blends.
    """
    columns = program.columns
    index = np.flatnonzero(going)
    square, reach = np.zeros(len(index)), np.zeros(len(index))
    done = np.cumsum(~columns.are(Comment))[columns.at]
    follows = (np.diff(index) == 1) & (np.diff(done[index]) == 1)
    if pace.corner in ("zone", "overlap"):
        follows &= columns.blend[index[:-1]] > 0
    one, two = index[:-1][follows], index[1:][follows]
    # Half of the angle between unit vectors, exact for small and for large ones.
    apart = np.linalg.norm(shape.first[two] - shape.last[one], axis=1)
    along = np.linalg.norm(shape.first[two] + shape.last[one], axis=1)
    corners = Corners(
        half=np.arctan2(apart, along),
        room=np.minimum(shape.length[one], shape.length[two]) / 2,
        blend=columns.blend[one],
        fast=np.maximum(columns.speed[one], columns.speed[two]),
    )
    here = np.flatnonzero(follows)
    found, around = passed(corners, pace)
    square[here], reach[here] = found, np.where(found < corners.fast**2, around, 0.0)
    return square, reach


def _run(pieces: _Pieces, square: FloatArray, reach: FloatArray, last: float, count: int) -> FloatArray:
    """Seconds (M,) of the motions that the pieces belong to."""
    nodes = np.append(0.0, np.cumsum(pieces.length))
    ends = nodes[1:][np.append(pieces.motion[1:] != pieces.motion[:-1], True)]
    wide = np.flatnonzero(reach > 0)
    begin, end = ends[wide] - reach[wide], ends[wide] + reach[wide]
    edges = np.unique(np.concatenate([nodes, begin, end]))
    length, middle = np.diff(edges), (edges[1:] + edges[:-1]) / 2
    piece = np.searchsorted(nodes, middle) - 1
    most, gain = pieces.most[piece], pieces.gain[piece]
    gain[(square == 0)[np.searchsorted(ends, middle)]] *= last
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
