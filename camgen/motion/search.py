"""Tilts and rolls searched together along an edge, and what comes out proved densely."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import product

import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from camgen.geometry.rotations import from_vectors, turns_about_z
from camgen.model.part import BoolArray
from camgen.model.pose import FloatArray, frozen
from camgen.motion.pose_chains import PoseChain, States, Steps, cheapest, steps
from camgen.motion.pose_paths import Index, PosePath, counts, divide, rows
from camgen.motion.rolls import rolls_of
from camgen.motion.setup import (
    JUMP,
    MARGIN,
    EdgeMotion,
    OrientationFreedom,
    Setup,
    dense_parts,
    flange_poses,
)
from camgen.robots.kinematics import iterative as damped
from camgen.robots.kinematics.continuity import Choice, follow
from camgen.robots.kinematics.inverse import inverse
from camgen.robots.kinematics.joint_limits import turns, within_turned, wrap
from camgen.robots.kinematics.singular import from_singular
from camgen.robots.models import Robot

# The orientations that a tool may have instead of the nominal one: a small grid of tilts and rolls.

#: Tilts to each side, in steps of the most; rolls in a turn.
_STEPS, _ROLLS = 2, 12
#: Seconds of joint motion that a rad of tilt and of roll are weighed with: a roll does nothing to the process.
_TILT, _ROLL = 10.0, 0.2


class Grid(Struct, frozen=True, eq=False):
    """C orientations, the nominal one first. nominal_from_tool: (C, 3, 3). cost: (C,) s, what each is worth avoiding.
    moves: (M, C) the index of the one from which move m leads to each, -1 if none; move 0 stays.
    """

    nominal_from_tool: FloatArray
    cost: FloatArray
    moves: Index


def grid(freedom: OrientationFreedom) -> Grid:
    """Tilts across the edge (about y) and along it (about x) within the cone, each with all rolls (about z)."""
    steps = range(-_STEPS, _STEPS + 1) if freedom.tilt > 0 else range(1)
    rolls = rolls_of(freedom, _ROLLS)
    cells = [
        (a, b, r)
        for a, b, r in product(steps, steps, range(len(rolls.angles)))
        if a * a + b * b <= _STEPS**2
    ]
    cells.sort(
        key=lambda cell: (cell[0] ** 2 + cell[1] ** 2, round(abs(rolls.angles[cell[2]]), 9), cell)
    )
    index = {cell: k for k, cell in enumerate(cells)}
    around = [(0, 0, 0), (1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 1), (0, 0, -1)]
    moves = [
        [index.get((a - u, b - v, rolls.beside(r, -w)), -1) for a, b, r in cells]
        for u, v, w in around
    ]
    across, along, roll = np.array(cells).T
    tilts = np.column_stack([along, across, 0 * roll]) * (freedom.tilt / _STEPS)
    turn = np.array(rolls.angles)[roll]
    spin = from_vectors(np.column_stack([0 * turn, 0 * turn, turn]))
    cost = _TILT * np.linalg.norm(tilts, axis=1) + _ROLL * np.abs(turn)
    # A grid without tilts or rolls has moves that lead nowhere, or to where they come from.
    useful = [
        0,
        *(m for m in range(1, 7) if any(k >= 0 and k != c for c, k in enumerate(moves[m]))),
    ]
    return Grid(from_vectors(tilts) @ spin, cost, np.array(moves, dtype=np.int64)[useful])


def lean(nominal: FloatArray, actual: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Rad (N,) between the z axes of two orientations (N, 3, 3), and of the turn about z (swing and twist)."""
    turn = np.swapaxes(nominal, 1, 2) @ actual
    tilt = np.arctan2(np.hypot(turn[:, 0, 2], turn[:, 1, 2]), turn[:, 2, 2])
    return tilt, turns_about_z(turn)


# Joints for a table of poses, D looks by C orientations, branches in the same columns throughout.


def solutions(robot: Robot, rotations: FloatArray, origins: FloatArray, moves: Index) -> FloatArray:
    """Joint values (D, C, B, J) for base_from_flange (D, C, 3, 3), (D, C, 3), nan: none. moves: ``Grid.moves``.

    Without a closed form those of the first pose are followed: from orientation to neighbouring orientation, then all
    from look to look.
    """
    looks, choices = origins.shape[:2]
    if robot.arm:
        found = inverse(robot, rotations.reshape(-1, 3, 3), origins.reshape(-1, 3), robot.home)
        return found.reshape(looks, choices, found.shape[1], -1)
    first = inverse(robot, rotations[0, :1], origins[0, :1])[0]
    first = first[np.isfinite(first[:, 0])]
    found = np.full((looks, choices, len(first), len(robot.joints)), np.nan)
    found[0, 0] = first
    known = np.arange(choices) == 0
    for _ in range(choices):
        sources = np.where((moves >= 0) & known[moves], moves, -1).max(axis=0)
        new = np.flatnonzero(~known & (sources >= 0))
        if not len(new):
            break
        found[0, new] = _follow(robot, rotations[0, new], origins[0, new], found[0, sources[new]])
        known[new] = True
    for row in range(1, looks):
        found[row] = _follow(robot, rotations[row], origins[row], found[row - 1])
    return found


def _follow(
    robot: Robot, rotations: FloatArray, origins: FloatArray, near: FloatArray
) -> FloatArray:
    """Joints (C, B, J) for C poses from those of ``near`` (C, B, J)."""
    branches = near.shape[1]
    goal = np.repeat(rotations, branches, axis=0), np.repeat(origins, branches, axis=0)
    return wrap(robot, damped.refine(robot, *goal, near.reshape(-1, near.shape[2]))).reshape(
        near.shape
    )


#: The orientation may change over so many mm and rad: the rows of the search.
_ROW_MM, _ROW_TURN = 50.0, math.radians(30)
#: mm, rad: what the search looks at in between; what it finds is proved by ``dense_parts``.
_LOOK_MM, _LOOK_TURN = 10.0, math.radians(10)
#: rad: the most a joint may turn from one row of the search to the next, and from one look to the next.
_KNOT_JUMP, _STEP_JUMP = math.radians(120), 2 * JUMP
#: rad: a tilt so much above another is the same; and what the axis may lean between rows where only the roll is free.
_EVEN, _CUT = 1e-6, math.radians(2)
#: Of so many orientations one is looked at before the others: no number of rolls, so that all of these come up.
_HERE_AND_THERE = 11
#: Number of the rows in which a chain collides that are checked before the others.
_ROWS_FIRST = 2
#: So many chains are proved before an edge is given up.
_TRIES = 40


class Knots(Struct, frozen=True, eq=False):
    """A way cut into the rows of the search, ``parts`` of each segment of the ``whole``."""

    whole: PosePath
    way: PosePath
    parts: Index


def search(setup: Setup, edge: str, way: PosePath, grid: Grid, most: float) -> EdgeMotion | str:
    """The motion along ``way`` that costs least, its orientations free within ``grid``; or what the last one collided
    with, empty where no motion is possible at all. most: rad that the axis may lean, between rows too.
    """
    parts = counts(way, _ROW_MM, _ROW_TURN)
    knots = Knots(way, divide(way, parts), parts)
    states = make_states(setup, knots.way, grid)
    ways = steps(setup.robot, states, _KNOT_JUMP)
    checked: set[int] = set()
    collision = ""
    for _ in range(_TRIES):
        chain, met = _choose_clear(setup, states, ways, checked)
        collision = met or collision
        if chain is None:
            break
        proved = prove(setup, edge, knots, grid, chain, most)
        if isinstance(proved, EdgeMotion):
            return thin_out(proved, *_few(knots, chain))
        stretch, met = proved
        collision = met or collision
        move, orientation = int(chain.moves[stretch]), int(chain.orientation[stretch + 1])
        states.open[stretch, move, orientation, chain.branch] = False
    return collision


def _choose_clear(
    setup: Setup, states: States, transitions: Steps, checked: set[int]
) -> tuple[PoseChain | None, str]:
    """The cheapest chain whose states are clear, and what the last one before it collided with.

    checked: rows of whose states those that collide are closed, which grow.
    """
    collision = ""
    while (chain := cheapest(setup.robot, states, transitions, setup.robot.home)) is not None:
        met = np.flatnonzero(~setup.clear(chain.joints)).tolist()
        new = sorted(set(met) - checked)
        if not new:
            break
        collision = setup.hit(chain.joints[met[0]])
        # Where no state of a row is left there is no chain: rows with few states come first.
        new.sort(key=lambda row: int(states.usable[row].any(axis=-1).sum()))
        for batch in (new[:_ROWS_FIRST], new[_ROWS_FIRST:]):
            if batch:
                check_states(setup, states, batch)
            if not states.usable[batch].any(axis=(1, 2, 3)).all():
                return None, collision
        checked |= set(new)
    return chain, collision


def make_states(
    setup: Setup, knots: PosePath, grid: Grid, pieces_jump: float | None = None
) -> States:
    """The states of the rows of ``knots``, and the orientations that can stay from row to row.

    pieces_jump: largest turn of a joint from row to row, rad, if pieces of the path are sought. A
        joint that cannot come past half a turn needs no whole turns: whatever it can run, it can
        run about the middle of its limits. None for the whole path: then only branches in which
        each row can be stood at are of use.
    """
    robot, table, whole = setup.robot, turns(setup.robot), pieces_jump is None
    parts = counts(knots, _LOOK_MM, _LOOK_TURN)
    at, looks = rows(parts), divide(knots, parts)
    orientations = looks.rotation[:, None] @ grid.nominal_from_tool
    found = solutions(
        robot, *flange_poses(setup, looks.position[:, None], orientations), grid.moves
    )
    idle = np.zeros((found.shape[2], len(robot.joints)), dtype=np.bool_)
    if pieces_jump is not None:
        idle = ~_pass_half_turns(robot, found, max(pieces_jump, _STEP_JUMP))
        table = table[~table[:, idle.all(axis=0)].any(axis=1)]
    usable = within_turned(robot, found[at], table)
    usable &= ~(idle[:, None] & (table != 0)).any(axis=2)
    stands = np.asarray(usable.any(axis=-1))
    stands[stands] = _safe(robot, found[at][stands])
    # A branch never becomes another.
    of_use = stands.any(axis=1)
    columns = np.flatnonzero(of_use.all(axis=0) if whole else of_use.any(axis=0))
    found, usable = found[:, :, columns], usable[:, :, columns] & stands[:, :, columns, None]
    safe = _safe(robot, found)
    most = np.abs(table[usable.any(axis=(0, 1, 2))]).max(axis=0, initial=0)
    few = (np.abs(table) <= most).all(axis=1)
    table, usable = table[few], usable[..., few]
    opened = np.ones((len(parts), len(grid.moves), *usable.shape[1:]), dtype=bool)
    opened[:, 0] = _staying(robot, found, safe, parts, table)
    return States(found[at], table, usable, opened, grid.moves, grid.cost)


def _pass_half_turns(robot: Robot, joints: FloatArray, jump: float) -> BoolArray:
    """The joints that may come past half a turn from the middle of their limits, by branch (B, J).

    joints: (D, C, B, J) joint values, between which no joint turns by more than ``jump`` rad. A
        joint that has another value in the serial chain always counts.
    """
    off = joints - robot.limits.mean(axis=1)
    near = math.pi - jump
    both = (off > near).any(axis=(0, 1)) & (off < -near).any(axis=(0, 1))
    return np.asarray(both | (robot.coupling != np.eye(len(robot.joints))).any(axis=1))


def _safe(robot: Robot, found: FloatArray) -> BoolArray:
    """Which of (D, C, B, J) are there and far enough from singularities (D, C, B)."""
    with np.errstate(invalid="ignore"):
        away = from_singular(robot, found).min(axis=-1, initial=math.inf)
        return np.asarray(np.isfinite(found[..., 0]) & (away >= MARGIN))


def _staying(
    robot: Robot, found: FloatArray, safe: BoolArray, parts: Index, table: Index
) -> BoolArray:
    """(K - 1, C, B, T): the orientation and branch can be kept through a stretch that arrives with these turns."""
    moved = np.diff(found, axis=0)
    turning: BoolArray = np.array([not joint.sliding for joint in robot.joints])
    whole = np.rint(moved / math.tau) * turning
    steady = (np.abs(moved - math.tau * whole) <= _STEP_JUMP)[..., turning].all(axis=-1)
    unwound = found[:-1]
    whole[np.isnan(whole)] = 0.0
    if whole.any():
        # Whole turns from each look to the last one of its stretch.
        left = np.concatenate(
            [np.cumsum(whole[::-1], axis=0)[::-1], np.zeros((1, *whole.shape[1:]))]
        )
        unwound = unwound + math.tau * (left[:-1] - left[np.repeat(rows(parts)[1:], parts)])
    good = within_turned(robot, unwound, table) & np.asarray(steady & safe[:-1])[..., None]
    return np.asarray(np.logical_and.reduceat(good, rows(parts)[:-1], axis=0))


def can_stand(setup: Setup, position: FloatArray, rotation: FloatArray, grid: Grid) -> BoolArray:
    """At which TCPs of the work frame, (K, 3) and (K, 3, 3), some joints have the tool in an orientation of ``grid`` as
    ``search`` asks for it: within the limits, far enough from singularities and clear (K,).
    """
    robot = setup.robot
    goal = flange_poses(setup, position[:, None], rotation[:, None] @ grid.nominal_from_tool)
    found = solutions(robot, *goal, grid.moves)
    usable = np.asarray(within_turned(robot, found, turns(robot)).any(axis=-1))
    usable[usable] = _safe(robot, found[usable])
    stands = np.zeros(len(position), dtype=np.bool_)
    # The nominal orientation comes first, then a few here and there; where one is clear no other is looked at.
    number = np.arange(usable.shape[1])
    for which in (number == 0, number % _HERE_AND_THERE == 1, number > 0):
        some = usable & which[:, None] & ~stands[:, None, None]
        if some.any():
            stands[np.nonzero(some)[0][setup.clear(found[some])]] = True
            usable &= ~which[:, None]
    return stands


def check_states(setup: Setup, states: States, rows: Sequence[int]) -> None:
    """Leaves of the states of some rows those that are clear."""
    stands = states.usable[rows].any(axis=-1)
    clear = np.zeros(stands.shape, dtype=bool)
    clear[stands] = setup.clear(states.joints[rows][stands])
    states.usable[rows] &= clear[..., None]


def prove(
    setup: Setup, edge: str, knots: Knots, grid: Grid, chain: PoseChain, most: float
) -> EdgeMotion | tuple[int, str]:
    """The motion of ``chain`` as the robot makes it, or the first stretch where it fails, and what it collides with."""
    actual = replace(
        knots.way, rotation=frozen(knots.way.rotation @ grid.nominal_from_tool[chain.orientation])
    )
    parts = dense_parts(actual)
    dense, at = divide(actual, parts), rows(parts)
    joints = follow(
        setup.robot,
        *flange_poses(setup, dense.position, dense.rotation),
        chain.joints[0],
        MARGIN,
        JUMP,
    )
    if not isinstance(joints, Choice):
        return _stretch(at, joints.row), ""
    hit = np.flatnonzero(~setup.clear(joints.joints))
    if len(hit):
        return _stretch(at, int(hit[0])), setup.hit(joints.joints[hit[0]])
    tilt, roll = lean(divide(knots.way, parts).rotation, dense.rotation)
    # On an arc the axis cuts the corner between two rows that lean, or roll, differently.
    steep = np.flatnonzero(tilt > max(most, _CUT) + _EVEN)
    if len(steep):
        return _stretch(at, int(steep[0])), ""
    return EdgeMotion(
        edge,
        False,
        actual,
        frozen(joints.joints[at]),
        dense,
        frozen(joints.joints),
        at,
        frozen(tilt),
        frozen(roll),
    )


def thin_out(motion: EdgeMotion, kept: Index, nominal: PosePath) -> EdgeMotion:
    """A motion with only the rows ``kept`` in its program.

    nominal: pose path with these rows, in the nominal orientation.
    """
    path = replace(nominal, rotation=frozen(motion.way.rotation[kept]))
    return replace(motion, way=path, joints=frozen(motion.joints[kept]), at=motion.at[kept])


def _stretch(at: Index, row: int) -> int:
    return int(np.clip(np.searchsorted(at, row) - 1, 0, len(at) - 2))


def _few(knots: Knots, chain: PoseChain) -> tuple[Index, PosePath]:
    """The rows that the program needs: all in segments where the orientation changes, else the segments' ends."""
    at = rows(knots.parts)
    changes = np.add.reduceat(chain.moves != 0, at[:-1]) > 0
    own = [
        np.arange(low + 1, high + 1) if change else [high]
        for low, high, change in zip(at[:-1], at[1:], changes, strict=True)
    ]
    return np.concatenate([[0], *own]), divide(knots.whole, np.where(changes, knots.parts, 1))
