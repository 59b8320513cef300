"""Searches tilts and rolls together along an edge, and proves the result at dense samples."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import cache
from itertools import product

import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from camgen.geometry.ragged import compute_offsets
from camgen.geometry.rotations import make_rotations_from_vectors, measure_rolls
from camgen.model.part import BoolArray
from camgen.model.pose import FloatArray, frozen
from camgen.motion.pose_chains import PoseChain, States, Steps, find_cheapest_chain, find_steps
from camgen.motion.pose_paths import Index, PosePath, count_parts, divide
from camgen.motion.rolls import list_rolls
from camgen.motion.setup import (
    JUMP,
    MARGIN,
    EdgeMotion,
    OrientationFreedom,
    Setup,
    compute_flange_poses,
    count_samples,
)
from camgen.robots.kinematics import iterative as damped
from camgen.robots.kinematics.continuity import Choice, find_needed, follow
from camgen.robots.kinematics.inverse import compute_solutions
from camgen.robots.kinematics.joint_limits import (
    are_turned_within_limits,
    list_turn_counts,
    wrap_joints,
)
from camgen.robots.kinematics.singular import measure_singularity_distance
from camgen.robots.models import Robot

# The orientations that a tool may have instead of the nominal one: a small grid of tilts and rolls.

#: Steps of the tilt to each side, up to the largest; and number of rolls in a turn.
_STEPS, _ROLLS = 2, 12
#: s/rad: cost of tilt and of roll as time of a joint motion. A roll does not change the process.
_TILT, _ROLL = 10.0, 0.2
#: Steps of tilt across and along the edge and of roll that a move of the grid makes.
_MOVES = ((0, 0, 0), (1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 1), (0, 0, -1))


class Grid(Struct, frozen=True, eq=False):
    """C orientations, the nominal one first.

    nominal_from_tool: (C, 3, 3) rotations.
    cost: (C,) cost of each orientation, s.
    moves: (M, C) index of the orientation from which move m leads to each, -1 for none; move 0
        stays.
    """

    nominal_from_tool: FloatArray
    cost: FloatArray
    moves: Index


@cache
def make_grid(freedom: OrientationFreedom) -> Grid:
    """The tilts within the cone of `freedom`, each with all rolls (about z).

    Tilts are across the edge (about y) and along it (about x).
    """
    steps = range(-_STEPS, _STEPS + 1) if freedom.tilt > 0 else range(1)
    rolls = list_rolls(freedom, _ROLLS)
    cells = [
        (a, b, r)
        for a, b, r in product(steps, steps, range(len(rolls.angles)))
        if a * a + b * b <= _STEPS**2
    ]
    cells.sort(
        key=lambda cell: (cell[0] ** 2 + cell[1] ** 2, round(abs(rolls.angles[cell[2]]), 9), cell)
    )
    index = {cell: k for k, cell in enumerate(cells)}
    moves = np.full((len(_MOVES), len(cells)), -1, dtype=np.int64)
    for m, (u, v, w) in enumerate(_MOVES):
        for k, (a, b, r) in enumerate(cells):
            moves[m, k] = index.get((a - u, b - v, rolls.find_neighbour(r, -w)), -1)
    across, along, roll = np.array(cells).T
    tilts = np.column_stack([along, across, 0 * roll]) * (freedom.tilt / _STEPS)
    turn = np.array(rolls.angles)[roll]
    spin = make_rotations_from_vectors(np.column_stack([0 * turn, 0 * turn, turn]))
    cost = _TILT * np.linalg.norm(tilts, axis=1) + _ROLL * np.abs(turn)
    # In a grid without tilts or rolls some moves lead nowhere, or back to where they come from.
    is_useful = ((moves >= 0) & (moves != np.arange(len(cells)))).any(axis=1)
    is_useful[0] = True
    return Grid(make_rotations_from_vectors(tilts) @ spin, cost, moves[is_useful])


def measure_lean(nominal: FloatArray, actual: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The tilt and the roll from nominal to actual orientations (N, 3, 3), (N,) rad each.

    They are the swing and the twist of the rotation: the angle between the z axes, and the rotation
    about z.
    """
    rotation = np.swapaxes(nominal, 1, 2) @ actual
    tilt = np.arctan2(np.hypot(rotation[:, 0, 2], rotation[:, 1, 2]), rotation[:, 2, 2])
    return tilt, measure_rolls(rotation)


# Joint values for a table of poses: D samples by C orientations. A branch keeps its column.


def find_solutions(
    robot: Robot, rotations: FloatArray, origins: FloatArray, moves: Index
) -> FloatArray:
    """The joint values (D, C, B, J) of all branches for poses of the flange, nan for none.

    Without a closed form the solutions of the first pose are followed: first from orientation to
    neighbouring orientation, then all from sample to sample.

    rotations, origins: base_from_flange, (D, C, 3, 3) and (D, C, 3).
    moves: field of `Grid`.
    """
    samples, choices = origins.shape[:2]
    if robot.arm:
        joints = compute_solutions(
            robot, rotations.reshape(-1, 3, 3), origins.reshape(-1, 3), robot.home
        )
        return joints.reshape(samples, choices, joints.shape[1], -1)
    first = compute_solutions(robot, rotations[0, :1], origins[0, :1])[0]
    first = first[np.isfinite(first[:, 0])]
    joints = np.full((samples, choices, len(first), len(robot.joints)), np.nan)
    joints[0, 0] = first
    known = np.arange(choices) == 0
    for _ in range(choices):
        sources = np.where((moves >= 0) & known[moves], moves, -1).max(axis=0)
        added = np.flatnonzero(~known & (sources >= 0))
        if not len(added):
            break
        starts = joints[0, sources[added]]
        joints[0, added] = _follow(robot, rotations[0, added], origins[0, added], starts)
        known[added] = True
    for row in range(1, samples):
        joints[row] = _follow(robot, rotations[row], origins[row], joints[row - 1])
    return joints


def _follow(
    robot: Robot, rotations: FloatArray, origins: FloatArray, starts: FloatArray
) -> FloatArray:
    """The joint values (C, B, J) for C poses, followed from joint values `starts` (C, B, J)."""
    branches = starts.shape[1]
    goal = np.repeat(rotations, branches, axis=0), np.repeat(origins, branches, axis=0)
    refined = damped.refine(robot, *goal, starts.reshape(-1, starts.shape[2]))
    return wrap_joints(robot, refined).reshape(starts.shape)


#: mm and rad between two rows of the search, over which the orientation may change.
_ROW_MM, _ROW_TURN = 50.0, math.radians(30)
#: mm and rad between two samples of the search. Its result is proved at the samples of
#: `count_samples`.
_SAMPLE_MM, _SAMPLE_TURN = 10.0, math.radians(10)
#: rad: largest angle of a joint from one row of the search to the next, and from one sample to the
#: next.
_KNOT_JUMP, _STEP_JUMP = math.radians(120), 2 * JUMP
#: rad: tilts that differ by less are equal; and the largest tilt between rows if only the roll is
#: free.
_EVEN, _CUT = 1e-6, math.radians(2)
#: Every 11th orientation is tested before the others. The number does not divide numbers of rolls,
#: so all rolls are among these.
_HERE_AND_THERE = 11
#: Number of the rows in which a chain collides that are checked before the others.
_ROWS_FIRST = 2
#: Chains that are proved before an edge is given up.
_TRIES = 40


def search(
    setup: Setup, edge: str, path: PosePath, grid: Grid, max_lean: float
) -> EdgeMotion | str:
    """The cheapest motion along a pose path with orientations of `grid`.

    Without a motion, the obstacle of the last one that collided is returned, or an empty text if no
    motion collided.

    edge: id of the edge.
    max_lean: largest tilt of the tool axis, between rows too, rad.
    """
    parts = count_parts(path, _ROW_MM, _ROW_TURN)
    rows = divide(path, parts)
    states = make_states(setup, rows, grid)
    transitions = find_steps(setup.robot, states, _KNOT_JUMP)
    checked: set[int] = set()
    collision = ""
    for _ in range(_TRIES):
        chain, obstacle = _choose_clear(setup, states, transitions, checked)
        collision = obstacle or collision
        if chain is None:
            break
        proved = prove(setup, edge, rows, grid, chain, max_lean)
        if isinstance(proved, EdgeMotion):
            return thin_out(proved, *_choose_rows(path, parts, chain))
        stretch, obstacle = proved
        collision = obstacle or collision
        move, orientation = int(chain.moves[stretch]), int(chain.orientation[stretch + 1])
        states.open[stretch, move, orientation, chain.branch] = False
    return collision


def _choose_clear(
    setup: Setup, states: States, transitions: Steps, checked: set[int]
) -> tuple[PoseChain | None, str]:
    """The cheapest chain whose states are clear, and the obstacle of the last one that was not.

    checked: rows whose colliding states are closed; rows are added to it.
    """
    collision = ""
    while (
        chain := find_cheapest_chain(setup.robot, states, transitions, setup.robot.home)
    ) is not None:
        colliding = np.flatnonzero(~setup.clear(chain.joints)).tolist()
        unchecked = sorted(set(colliding) - checked)
        if not unchecked:
            break
        collision = setup.hit(chain.joints[colliding[0]])
        # A row without states ends the search, so rows with few states come first.
        unchecked.sort(key=lambda row: int(states.usable[row].any(axis=-1).sum()))
        for batch in (unchecked[:_ROWS_FIRST], unchecked[_ROWS_FIRST:]):
            if batch:
                check_states(setup.clear, states, batch)
            if not states.usable[batch].any(axis=(1, 2, 3)).all():
                return None, collision
        checked |= set(unchecked)
    return chain, collision


def make_states(
    setup: Setup, path: PosePath, grid: Grid, pieces_jump: float | None = None
) -> States:
    """The states of the rows of `path`, and the orientations that can stay from row to row.

    pieces_jump: largest angle of a joint from row to row, rad, if pieces of the path are searched.
        A joint that cannot pass half a turn needs no other turn counts: it can run everything about
        the middle of its limits. None for the whole path: then only branches that reach each row
        are kept.
    """
    robot, table, is_whole = setup.robot, list_turn_counts(setup.robot), pieces_jump is None
    parts = count_parts(path, _SAMPLE_MM, _SAMPLE_TURN)
    at, samples = compute_offsets(parts), divide(path, parts)
    orientations = samples.rotation[:, None] @ grid.nominal_from_tool
    goal = compute_flange_poses(setup, samples.position[:, None], orientations)
    joints = find_solutions(robot, *goal, grid.moves)
    idle = np.zeros((joints.shape[2], len(robot.joints)), dtype=np.bool_)
    if pieces_jump is not None:
        idle = ~_pass_half_turns(robot, joints, max(pieces_jump, _STEP_JUMP))
        table = table[~table[:, idle.all(axis=0)].any(axis=1)]
    usable = are_turned_within_limits(robot, joints[at], table)
    usable &= ~(idle[:, None] & (table != 0)).any(axis=2)
    stands = np.asarray(usable.any(axis=-1))
    stands[stands] = _are_safe(robot, joints[at][stands])
    # A branch never becomes another one.
    reaches = stands.any(axis=1)
    columns = np.flatnonzero(reaches.all(axis=0) if is_whole else reaches.any(axis=0))
    joints, usable = joints[:, :, columns], usable[:, :, columns] & stands[:, :, columns, None]
    safe = _are_safe(robot, joints)
    is_needed = find_needed(table, usable)
    table, usable = table[is_needed], usable[..., is_needed]
    opened = np.ones((len(parts), len(grid.moves), *usable.shape[1:]), dtype=bool)
    opened[:, 0] = _can_stay(robot, joints, safe, parts, table)
    return States(joints[at], table, usable, opened, grid.moves, grid.cost)


def _pass_half_turns(robot: Robot, joints: FloatArray, jump: float) -> BoolArray:
    """Whether joints may pass half a turn from the middle of their limits, by branch (B, J).

    joints: (D, C, B, J) joint values, between which no joint turns by more than `jump` rad. A
        joint that has another value in the serial chain always counts.
    """
    offset = joints - robot.limits.mean(axis=1)
    limit = math.pi - jump
    both = (offset > limit).any(axis=(0, 1)) & (offset < -limit).any(axis=(0, 1))
    return np.asarray(both | (robot.coupling != np.eye(len(robot.joints))).any(axis=1))


def _are_safe(robot: Robot, joints: FloatArray) -> BoolArray:
    """Whether joint values (..., J) are solutions and far enough from singularities, (...)."""
    with np.errstate(invalid="ignore"):
        distance = measure_singularity_distance(robot, joints).min(axis=-1, initial=math.inf)
        return np.asarray(np.isfinite(joints[..., 0]) & (distance >= MARGIN))


def _can_stay(
    robot: Robot, joints: FloatArray, safe: BoolArray, parts: Index, table: Index
) -> BoolArray:
    """Whether orientation and branch can stay through a stretch between rows, (K - 1, C, B, T).

    T: by the turn counts at its end.
    joints, safe: (D, C, B, J) and (D, C, B), at the samples.
    """
    moved = np.diff(joints, axis=0)
    whole = np.rint(moved / math.tau) * robot.revolute
    steady = (np.abs(moved - math.tau * whole) <= _STEP_JUMP)[..., robot.revolute].all(axis=-1)
    unwound = joints[:-1]
    whole[np.isnan(whole)] = 0.0
    if whole.any():
        # Whole turns from each sample to the last one of its stretch.
        none = np.zeros((1, *whole.shape[1:]))
        to_end = np.concatenate([np.cumsum(whole[::-1], axis=0)[::-1], none])
        unwound = unwound + math.tau * (
            to_end[:-1] - to_end[np.repeat(compute_offsets(parts)[1:], parts)]
        )
    can = (
        are_turned_within_limits(robot, unwound, table) & np.asarray(steady & safe[:-1])[..., None]
    )
    return np.asarray(np.logical_and.reduceat(can, compute_offsets(parts)[:-1], axis=0))


def can_stand(setup: Setup, position: FloatArray, rotation: FloatArray, grid: Grid) -> BoolArray:
    """Whether the arm reaches TCPs in an orientation of `grid` under the rules of `search`, (K,).

    The joint values must be within the limits, far enough from singularities and clear.

    position, rotation: poses in the work frame, (K, 3) and (K, 3, 3).
    """
    robot = setup.robot
    goal = compute_flange_poses(
        setup, position[:, None], rotation[:, None] @ grid.nominal_from_tool
    )
    joints = find_solutions(robot, *goal, grid.moves)
    usable = np.asarray(
        are_turned_within_limits(robot, joints, list_turn_counts(robot)).any(axis=-1)
    )
    usable[usable] = _are_safe(robot, joints[usable])
    stands = np.zeros(len(position), dtype=np.bool_)
    # The nominal orientation is tested first, then a few others. The rest is tested only if none of
    # these is clear.
    number = np.arange(usable.shape[1])
    for which in (number == 0, number % _HERE_AND_THERE == 1, number > 0):
        tested = usable & which[:, None] & ~stands[:, None, None]
        if tested.any():
            stands[np.nonzero(tested)[0][setup.clear(joints[tested])]] = True
            usable &= ~which[:, None]
    return stands


def check_states(
    are_clear: Callable[[FloatArray], BoolArray], states: States, rows: Sequence[int]
) -> None:
    """Remove the colliding states of some rows from `states.usable`.

    are_clear: a test of joint values, such as `Setup.clear`.
    """
    stands = np.asarray(states.usable[rows].any(axis=-1))
    if stands.any():
        stands[stands] = are_clear(states.joints[rows][stands])
        states.usable[rows] &= stands[..., None]


def prove(
    setup: Setup, edge: str, nominal: PosePath, grid: Grid, chain: PoseChain, max_lean: float
) -> EdgeMotion | tuple[int, str]:
    """The motion of a chain as the robot runs it, at dense samples.

    If it fails, the index of the first stretch at which it does, and the obstacle; empty if it does
    not collide.

    nominal: pose path with a row for each state of the chain, in the nominal orientation.
    max_lean: argument of `search`.
    """
    turned = nominal.rotation @ grid.nominal_from_tool[chain.orientation]
    actual = replace(nominal, rotation=frozen(turned))
    parts = count_samples(actual)
    dense, at = divide(actual, parts), compute_offsets(parts)
    joints = follow(
        setup.robot,
        compute_flange_poses(setup, dense.position, dense.rotation),
        chain.joints[0],
        MARGIN,
        JUMP,
    )
    if not isinstance(joints, Choice):
        return _stretch(at, joints.row), ""
    hit = np.flatnonzero(~setup.clear(joints.joints))
    if len(hit):
        return _stretch(at, int(hit[0])), setup.hit(joints.joints[hit[0]])
    tilt, roll = measure_lean(divide(nominal, parts).rotation, dense.rotation)
    # Between two rows on an arc the axis leans more if their tilts or rolls differ.
    steep = np.flatnonzero(tilt > max(max_lean, _CUT) + _EVEN)
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
    """The motion with only the rows `kept` in its program.

    nominal: pose path with these rows, in the nominal orientation.
    """
    path = replace(nominal, rotation=frozen(motion.pose_path.rotation[kept]))
    return replace(motion, pose_path=path, joints=frozen(motion.joints[kept]), at=motion.at[kept])


def _stretch(at: Index, row: int) -> int:
    return int(np.clip(np.searchsorted(at, row) - 1, 0, len(at) - 2))


def _choose_rows(path: PosePath, parts: Index, chain: PoseChain) -> tuple[Index, PosePath]:
    """The rows that the program needs, and the nominal pose path with these.

    They are the ends of all segments, and all rows of segments in which the orientation changes.

    parts: number of parts of each segment of the path between the rows of the chain.
    """
    at = compute_offsets(parts)
    changes = np.add.reduceat(chain.moves != 0, at[:-1]) > 0
    is_kept = np.append(True, np.repeat(changes, parts))
    is_kept[at] = True
    return np.flatnonzero(is_kept), divide(path, np.where(changes, parts, 1))
