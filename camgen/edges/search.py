"""Tilts and rolls searched together along an edge, and what comes out proved densely."""

from __future__ import annotations

import math

import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from camgen.edges.chains import Chain, States, cheapest, steps
from camgen.edges.freedom import Grid, lean
from camgen.edges.moving import JUMP, MARGIN, dense_parts, flange_poses
from camgen.edges.results import Reached, Setup
from camgen.edges.solutions import solutions
from camgen.edges.ways import Index, Way, counts, divided, rows
from camgen.pose import FloatArray, frozen
from camgen.robots.continuity import Choice, follow
from camgen.robots.models import Robot
from camgen.robots.singular import from_singular
from camgen.robots.values import turns, within_turned
from camgen.solid import BoolArray

#: The orientation may change over so many mm and rad: the rows of the search.
_STRETCH, _TURN = 50.0, math.radians(30)
#: mm, rad: what the search looks at in between; what it finds is proved by ``moving.dense_parts``.
_STEP, _STEP_TURN = 10.0, math.radians(10)
#: rad: the most a joint may turn from one row of the search to the next, and from one look to the next.
_KNOT_JUMP, _STEP_JUMP = math.radians(120), 2 * JUMP
#: rad: a tilt so much above another is the same; and what the axis may lean between rows where only the roll is free.
_EVEN, _CUT = 1e-6, math.radians(2)
#: So many chains are proved before an edge is given up.
_TRIES = 40


class Knots(Struct, frozen=True, eq=False):
    """A way cut into the rows of the search, ``parts`` of each segment of the ``whole``."""

    whole: Way
    way: Way
    parts: Index


def searched(setup: Setup, edge: str, way: Way, grid: Grid, most: float) -> Reached | str:
    """The motion along ``way`` that costs least, its orientations free within ``grid``; or what the last one collided
    with, empty where no motion is possible at all. most: rad that the axis may lean, between rows too.
    """
    parts = counts(way, _STRETCH, _TURN)
    knots = Knots(way, divided(way, parts), parts)
    states = _states(setup, knots.way, grid)
    ways = steps(setup.robot, states, _KNOT_JUMP)
    checked: set[int] = set()
    collision = ""
    for _ in range(_TRIES):
        chain = cheapest(setup.robot, states, ways, setup.robot.home)
        if chain is None:
            break
        proved = _proved(setup, edge, knots, grid, chain, most)
        if isinstance(proved, Reached):
            return proved
        stretch, collision = proved[0], proved[1] or collision
        new = {stretch, stretch + 1} - checked if proved[1] else set()
        for row in sorted(new):
            _check(setup, states, row)
        checked |= new
        if not new:
            move, orientation = int(chain.moves[stretch]), int(chain.orientation[stretch + 1])
            states.open[stretch, move, orientation, chain.branch] = False
    return collision


def _states(setup: Setup, knots: Way, grid: Grid) -> States:
    """What the rows of ``knots`` can choose from, and which orientations can stay from row to row."""
    robot, table = setup.robot, turns(setup.robot)
    parts = counts(knots, _STEP, _STEP_TURN)
    at, looks = rows(parts), divided(knots, parts)
    orientations = looks.rotation[:, None] @ grid.nominal_from_tool
    found = solutions(robot, *flange_poses(setup, looks.position[:, None], orientations), grid.moves)
    safe = _safe(robot, found)
    columns = np.flatnonzero(safe.any(axis=(0, 1)))
    found, safe = found[:, :, columns], safe[:, :, columns]
    usable = within_turned(robot, found[at], table) & safe[at][..., None]
    most = np.abs(table[usable.any(axis=(0, 1, 2))]).max(axis=0, initial=0)
    few = (np.abs(table) <= most).all(axis=1)
    table, usable = table[few], usable[..., few]
    opened = np.ones((len(parts), len(grid.moves), *usable.shape[1:]), dtype=bool)
    opened[:, 0] = _staying(robot, found, safe, parts, table)
    return States(found[at], table, usable, opened, grid.moves, grid.cost)


def _safe(robot: Robot, found: FloatArray) -> BoolArray:
    """Which of (D, C, B, J) are there and far enough from singularities (D, C, B)."""
    there: BoolArray = np.asarray(np.isfinite(found).all(axis=-1))
    away = from_singular(robot, np.where(there[..., None], found, 0.0)).min(axis=-1, initial=math.inf)
    return np.asarray(there & (away >= MARGIN))


def _staying(robot: Robot, found: FloatArray, safe: BoolArray, parts: Index, table: Index) -> BoolArray:
    """(K - 1, C, B, T): the orientation and branch can be kept through a stretch that arrives with these turns."""
    moved = np.nan_to_num(np.diff(found, axis=0), nan=math.inf)
    turning: BoolArray = np.array([not joint.sliding for joint in robot.joints])
    whole = np.where(turning & np.isfinite(moved), np.rint(np.where(np.isfinite(moved), moved, 0.0) / math.tau), 0.0)
    steady = (np.abs(moved - math.tau * whole) <= _STEP_JUMP)[..., turning].all(axis=-1)
    # Whole turns from each look to the last one of its stretch.
    left = np.concatenate([np.cumsum(whole[::-1], axis=0)[::-1], np.zeros((1, *whole.shape[1:]))])
    ends = np.repeat(rows(parts)[1:], parts)
    unwound = found[:-1] + math.tau * (left[:-1] - left[ends])
    good = within_turned(robot, unwound, table) & np.asarray(steady & safe[:-1])[..., None]
    return np.asarray(np.logical_and.reduceat(good, rows(parts)[:-1], axis=0))


def _check(setup: Setup, states: States, row: int) -> None:
    """Leaves of the states of a row those that are clear."""
    own = states.usable[row].any(axis=-1)
    clear = np.zeros(own.shape, dtype=bool)
    clear[own] = setup.clear(states.joints[row][own])
    states.usable[row] &= clear[..., None]


def _proved(setup: Setup, edge: str, knots: Knots, grid: Grid, chain: Chain, most: float) -> Reached | tuple[int, str]:
    """The motion of ``chain`` as the robot makes it, or the first stretch where it fails, and what it collides with."""
    actual = replace(knots.way, rotation=frozen(knots.way.rotation @ grid.nominal_from_tool[chain.orientation]))
    parts = dense_parts(actual)
    dense, at = divided(actual, parts), rows(parts)
    joints = follow(setup.robot, *flange_poses(setup, dense.position, dense.rotation), chain.joints[0], MARGIN, JUMP)
    if not isinstance(joints, Choice):
        return _stretch(at, joints.row), ""
    hit = np.flatnonzero(~setup.clear(joints.joints))
    if len(hit):
        return _stretch(at, int(hit[0])), setup.hit(joints.joints[hit[0]])
    kept, few = _few(knots, chain)
    tilt, roll = lean(divided(knots.way, parts).rotation, dense.rotation)
    # On an arc the axis cuts the corner between two rows that lean, or roll, differently.
    steep = np.flatnonzero(tilt > max(most, _CUT) + _EVEN)
    if len(steep):
        return _stretch(at, int(steep[0])), ""
    way = replace(few, rotation=frozen(actual.rotation[kept]))
    posture = frozen(joints.joints[at[kept]])
    return Reached(edge, False, way, posture, frozen(joints.joints), at[kept], frozen(tilt), frozen(roll))


def _stretch(at: Index, row: int) -> int:
    return int(np.clip(np.searchsorted(at, row) - 1, 0, len(at) - 2))


def _few(knots: Knots, chain: Chain) -> tuple[Index, Way]:
    """The rows that the program needs: all in segments where the orientation changes, else the segments' ends."""
    at = rows(knots.parts)
    changes = np.add.reduceat(chain.moves != 0, at[:-1]) > 0
    own = [
        np.arange(low + 1, high + 1) if change else [high]
        for low, high, change in zip(at[:-1], at[1:], changes, strict=True)
    ]
    return np.concatenate([[0], *own]), divided(knots.whole, np.where(changes, knots.parts, 1))
