"""Motions of an arm from corner to corner: how each is run, and what a corner saves that is passed without a stop."""

from __future__ import annotations

import math

import numpy as np
from msgspec import Struct

from camgen.check.reach import Reach
from camgen.model.cell import Dynamics
from camgen.model.part import IntArray
from camgen.model.pose import FloatArray
from camgen.model.program import Comment, MoveJ, Program
from camgen.robots.kinematics.forward import flange
from camgen.robots.models import Robot


class Legs(Struct, frozen=True, eq=False):
    """The rows on the way of a program. turned: (S, J) joint values in what they turn in a second at their greatest
    speeds. tip: (S, 3) the TCP, mm. owner: (S,) the motion that a row belongs to; each motion but the first begins at
    the last row of the one before. way: (S,) mm of the TCP up to there. seconds: (S,) at the joints' greatest speeds.
    """

    turned: FloatArray
    tip: FloatArray
    owner: IntArray
    way: FloatArray
    seconds: FloatArray

    def rows(self, motion: int) -> slice:
        """The rows of ``motion``, one but the first, from where it begins to where it ends."""
        begin, end = np.searchsorted(self.owner, [motion, motion + 1]).tolist()
        return slice(begin - 1, end)


def legs_of(program: Program, found: Reach, robot: Robot) -> Legs:
    """The rows of what was ``found`` of ``program``."""
    rotation, origin = flange(robot, found.joints)
    tip = origin + rotation @ np.asarray(program.flange_from_tool.origin)
    turned = found.joints / robot.speeds
    way = np.linalg.norm(np.diff(tip, axis=0), axis=1)
    seconds = np.abs(np.diff(turned, axis=0)).max(axis=1)
    owner = np.searchsorted(program.columns.at, found.owner)
    return Legs(
        turned, tip, owner, *(np.append(0.0, np.cumsum(column)) for column in (way, seconds))
    )


def find_corners(program: Program) -> IntArray:
    """The motions, all but the first, after which another one follows with nothing between that asks for a stop."""
    columns = program.columns
    done = np.cumsum(~columns.are(Comment))[columns.at]
    return np.flatnonzero(np.diff(done)[1:] == 1) + 1


class Cruise(Struct, frozen=True):
    """How a motion is run: its length, its greatest speed and its acceleration, in mm along a line or an arc, for a
    motion of the joints in seconds at their greatest speeds. mm, seconds: of its whole way.
    """

    length: float
    most: float
    gain: float
    mm: float
    seconds: float

    @property
    def peak(self) -> float:
        """The speed that it comes to from rest to rest."""
        return min(self.most, math.sqrt(self.gain * self.length))


def cruise(legs: Legs, program: Program, motion: int, pace: Dynamics) -> Cruise | None:
    """How ``motion`` is run, None where the TCP or the joints stay in their place."""
    rows, move = legs.rows(motion), program.columns.moves[motion]
    mm, seconds = (
        float(table[rows.stop - 1] - table[rows.start]) for table in (legs.way, legs.seconds)
    )
    if mm < _STILL_MM or seconds <= 0:
        return None
    if isinstance(move, MoveJ):
        shared = pace.shares and move.share > 0
        most = move.share if shared else min(1.0, move.speed * seconds / mm)
        gain = 1 / pace.ramp if shared else min(1 / pace.ramp, pace.acceleration * seconds / mm)
        return Cruise(seconds, most, gain, mm, seconds)
    steps = np.diff(legs.seconds[rows])
    turning = steps > 0
    slowest = float((np.diff(legs.way[rows])[turning] / steps[turning]).min(initial=math.inf))
    return Cruise(mm, min(move.speed, slowest), pace.acceleration, mm, seconds)


#: mm: a TCP that moves no farther stays in its place.
_STILL_MM = 0.01


def save_seconds(program: Program, found: Reach, robot: Robot, pace: Dynamics) -> FloatArray:
    """Seconds (M,) by which motions are shorter than from rest to rest, for corners with a blend between motions of
    which one at least is one of the joints.
    """
    columns = program.columns
    saved = np.zeros(len(columns.moves))
    swing = columns.moves_are(MoveJ)
    corners = [
        k
        for k in find_corners(program).tolist()
        if columns.blend[k] > 0 and (swing[k] or swing[k + 1])
    ]
    if not corners or pace.corner not in ("zone", "overlap"):
        return saved
    legs = legs_of(program, found, robot)
    for k in corners:
        both = cruise(legs, program, k, pace), cruise(legs, program, k + 1, pace)
        if both[0] is None or both[1] is None:
            continue
        if pace.corner == "overlap":
            # The next motion speeds up while this one slows down: the shorter of both counts no more.
            saved[k + 1] += min(one.peak / one.gain for one in both if one)
            continue
        share, held = _pass(legs, k, both[0], both[1], float(columns.blend[k]), pace)
        for motion, one in ((k, both[0]), (k + 1, both[1])):
            # From seconds at full speed to what the motion is measured in.
            scale = one.length / one.seconds
            saved[motion] += _save(one, share * scale, held * scale)
    return saved


def _pass(
    legs: Legs, motion: int, a: Cruise, b: Cruise, zone: float, pace: Dynamics
) -> tuple[float, float]:
    """The share of the joints' greatest speeds with which the corner after ``motion`` is passed, the same before and
    behind it, and how long before and behind it that holds, in seconds at full speed.

    Within the zone all joints and the TCP change from one direction to the other with even accelerations: at a share l
    that holds for s on both sides, by l times the difference of both directions in the time 2 s / l. What is left of
    half of each motion is enough to come to rest.
    """
    one, two = legs.rows(motion), legs.rows(motion + 1)
    sides = [(one.stop - 2, one.stop - 1), (two.start, two.start + 1)]
    rates = [_rate(legs, *side) for side in sides]
    turn = float(np.abs(rates[1][0] - rates[0][0]).max()) * pace.ramp
    bend = float(np.linalg.norm(rates[1][1] - rates[0][1])) / pace.acceleration
    hard = max(turn, bend, _LEAST_BEND)
    lengths = [one.seconds for one in (a, b)]
    gains = [one.gain * one.seconds / one.length for one in (a, b)]
    shares = [one.most * one.seconds / one.length for one in (a, b)]
    held = min(min(zone / one.mm, 0.5) * one.seconds for one in (a, b))
    # Of a shorter zone more is left to come to rest in: 2 s / hard = 2 g (half - s) at the best.
    held = min([held, *(g * n / 2 / (1 / hard + g) for g, n in zip(gains, lengths, strict=True))])
    return min(math.sqrt(2 * held / hard), *shares), held


#: s: corners that bend less are taken to bend so much.
_LEAST_BEND = 1e-3


def _rate(legs: Legs, a: int, b: int) -> tuple[FloatArray, FloatArray]:
    """How fast the joints (J,), as shares of their greatest speeds, and the TCP (3,), mm/s, go from row ``a`` to row
    ``b`` where the fastest joint is as fast as it may be.
    """
    seconds = max(float(legs.seconds[b] - legs.seconds[a]), 1e-9)
    return (legs.turned[b] - legs.turned[a]) / seconds, (legs.tip[b] - legs.tip[a]) / seconds


def _save(one: Cruise, speed: float, held: float) -> float:
    """What half of a motion saves that ends at ``speed``, which is held for the last ``held``, not at rest."""
    half, most = one.length / 2, one.peak
    stopped = most / one.gain / 2 + half / most
    top = min(most, math.sqrt(speed**2 + 2 * one.gain * (half - held)))
    ramp = (top**2 - speed**2) / (2 * one.gain)
    passed = held / speed + (top - speed) / one.gain + (half - held - ramp) / top
    return max(stopped - passed, 0.0)
