"""Paths of a flat part as an arm runs them: sampled poses, and joint values by posture and roll.

A path is sampled every 10 mm along its deepest pass, and above its gates: the points where it may
begin and end. There the tool approaches and retracts at the clearance height.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from msgspec import Struct

from camgen.geometry.arcs import make_span_chain
from camgen.geometry.ragged import (
    compute_first_rows,
    compute_offsets,
    count_rows,
    list_owners,
)
from camgen.geometry.rotations import (
    find_sideways,
    make_rotations_about_z,
    make_rotations_from_axes,
)
from camgen.model.part import BoolArray, IntArray
from camgen.model.path import ToolPath
from camgen.model.pose import FloatArray
from camgen.motion.search import find_solutions
from camgen.motion.setup import MARGIN, Setup, compute_flange_poses
from camgen.plan.pieces import lengths_along
from camgen.robots.kinematics.inverse import compute_solutions, find_nearest
from camgen.robots.kinematics.joint_limits import (
    are_turned_within_limits,
    are_within_limits,
    list_turn_counts,
)
from camgen.robots.kinematics.singular import measure_singularity_distance
from camgen.robots.models import Robot

#: mm between two samples of a path.
_SAMPLE_MM = 10.0
#: Maximum number of samples of a path.
_MAX_SAMPLES = 120
#: Minimum number of gates of a closed path.
_MIN_GATES = 4
#: Maximum number of gates.
_MAX_GATES = 12
#: mm of a closed path for each gate.
_GATE_MM = 10.0
#: rad: largest motion of a joint from one sample to the next.
_JUMP = math.radians(40)
#: Poses whose joint values are computed at once: bounds the memory.
_MAX_POSES = 40_000
#: Joint values that are kept of those that differ by whole turns: the nearest to home.
_MAX_COPIES = 2


class Item(Struct, frozen=True, eq=False):
    """A path of a flat part as R tool poses, its samples.

    First the pose above the first gate, then those along the path, then those above other gates.

    position: (R, 3) TCP in the work frame, mm.
    rotation: (R, 3, 3) nominal orientation, which is roll 0.
    before: (R,) index of the sample from which each one is reached, -1 for the first.
    gates: (G,) indices of the samples above the gates.
    along: (G,) positions of the gates along the path, mm.
    closed: whether the path ends at the point where it starts.
    reversible: whether the path may run from its last gate to its first.
    min_distance: minimum singularity distance, rad.
    """

    position: FloatArray
    rotation: FloatArray
    before: IntArray
    gates: IntArray
    along: FloatArray
    closed: bool
    reversible: bool
    min_distance: float = MARGIN

    def __len__(self) -> int:
        return len(self.position)

    @property
    def last_gate(self) -> int:
        """Index of the gate at which the path is left."""
        return 0 if self.closed else len(self.gates) - 1

    @property
    def last(self) -> int:
        """Index of the sample at the end of the path."""
        return len(self.position) - len(self.gates)


def sample_path(path: ToolPath, clearance: float, seams: bool) -> Item:
    """The samples of a path.

    clearance: the clearance height, mm.
    seams: whether a closed path may begin elsewhere.
    """
    length = lengths_along(path)
    whole = float(length[-1])
    closed = path.closed and whole > 0
    gate_count, count = 1, 0
    if closed and seams:
        gate_count = min(max(_MIN_GATES, math.ceil(whole / _GATE_MM)), _MAX_GATES)
    if whole > 0:
        count = min(math.ceil(whole / _SAMPLE_MM), _MAX_SAMPLES)
        count = max(count, gate_count)
    along = np.linspace(0.0, whole, count + 1)
    position, axis = _interpolate(path, length, along)
    lift = -axis * _measure_lifts(position, axis, clearance)[:, None]
    lowest = position - [0.0, 0.0, max(path.depths)]
    # Each gate is above a sample.
    gates = np.round(np.arange(gate_count) * (count / gate_count)).astype(np.int64)
    if not closed and count:
        gates = np.array([0, count])
    rows = np.concatenate([gates[:1], np.arange(count + 1), gates[1:]])
    above = np.concatenate([[0], np.arange(count + 2, count + 1 + len(gates))])
    before = np.concatenate([np.arange(-1, count + 1), 1 + gates[1:]])
    samples = lowest[rows]
    samples[above] = (position + lift)[rows[above]]
    nominal = make_rotations_from_axes(axis, find_sideways(axis))[rows]
    reversible = path.reversible and not closed and count > 0
    return Item(samples, nominal, before, above, along[gates], closed, reversible)


def _interpolate(
    path: ToolPath, length: FloatArray, along: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Positions and tool axes (K, 3) at `along` mm along the path."""
    if len(path.position) == 1:
        return path.position[[0] * len(along)], path.axis[[0] * len(along)]
    segment = np.clip(np.searchsorted(length, along, side="left") - 1, 0, len(length) - 2)
    whole = length[segment + 1] - length[segment]
    part = np.divide(along - length[segment], whole, out=np.zeros(len(along)), where=whole > 0)
    axis = path.axis[segment] + part[:, None] * (path.axis[segment + 1] - path.axis[segment])
    position = make_span_chain(path.position, path.via[1:]).point(part, segment)
    return position, axis / np.linalg.norm(axis, axis=1)[:, None]


def _measure_lifts(position: FloatArray, axis: FloatArray, clearance: float) -> FloatArray:
    """Distances along the axis up to the clearance height, mm, as `lower` has them."""
    is_vertical = axis[:, 2] < -1 + 1e-12
    return np.where(is_vertical, clearance - position[:, 2], clearance)


class States(Struct, frozen=True, eq=False):
    """M states: ways to run an item.

    enter, leave: (M, J) joint values at which the item is entered and left.
    gate: (M, 2) index of the gate of both.
    roll: (M,) roll from the nominal orientation, rad.
    branch: (M,) the column of `inverse`; -1 for joint values that do not follow from a roll.
    """

    enter: FloatArray
    leave: FloatArray
    gate: IntArray
    roll: FloatArray
    branch: IntArray

    def __len__(self) -> int:
        return len(self.roll)

    @classmethod
    def fixed(cls, joints: FloatArray) -> States:
        """One state with these joint values (J,), which has no branch."""
        rows = joints[None]
        return cls(rows, rows, np.zeros((1, 2), np.int64), np.zeros(1), np.array([-1]))

    def single(self, row: int) -> States:
        """The state of this index."""
        return self.pick(np.array([row]))

    def split(self) -> list[States]:
        """Each state by itself."""
        return list(map(self.single, range(len(self))))

    def pick(self, rows: IntArray | BoolArray) -> States:
        """The states of these indices or of this mask."""
        return States(
            self.enter[rows], self.leave[rows], self.gate[rows], self.roll[rows], self.branch[rows]
        )


def join_states(several: Sequence[States]) -> States:
    """All states of `several`, in order."""
    columns = []
    for name in States.__struct_fields__:
        columns.append(np.concatenate([getattr(states, name) for states in several]))
    return States(*columns)


def select_states(several: Sequence[States], is_kept: BoolArray) -> list[States]:
    """The kept states of each of `several`. is_kept: (M,) for all their states in order."""
    return list(map(States.pick, several, np.split(is_kept, np.cumsum(count_rows(several))[:-1])))


def choose_each(several: Sequence[States], rows: IntArray) -> States:
    """One state of each of `several`, those of these indices (n,)."""
    return join_states(several).pick(compute_first_rows(count_rows(several)) + rows)


def find_states(
    setup: Setup, items: Sequence[Item], angles: FloatArray, around: IntArray
) -> list[States]:
    """For each item, the states in which the arm can run all of it with one posture and one roll.

    A state leads from the first gate to the last, or from the first to itself on a closed path. Its
    joint values keep the limits and the singularity distance of the item, and do not jump.

    angles: (C,) rolls that are tried, rad.
    around: (M, C) as `Grid.moves`, for arms whose joint values are followed from sample to sample.
    """
    robot, turn_counts = setup.robot, list_turn_counts(setup.robot)
    rolled = make_rotations_about_z(angles)
    results: list[States] = []
    for group in _group(items, len(angles)):
        position, rotation = _join_poses(group)
        goal = compute_flange_poses(setup, position[:, None], rotation[:, None] @ rolled)
        ends = compute_offsets(count_rows(group))
        # Without a closed form the joint values of a sample depend on those before it on its path.
        if robot.arm:
            joints = np.split(find_solutions(robot, *goal, around), ends[1:-1])
        else:
            joints = []
            for rows in map(slice, ends[:-1].tolist(), ends[1:].tolist()):
                joints.append(find_solutions(robot, goal[0][rows], goal[1][rows], around))
        for item, of_item in zip(group, joints, strict=True):
            results.append(_select_valid(robot, item, of_item, turn_counts, angles))
    return results


def _join_poses(items: Sequence[Item]) -> tuple[FloatArray, FloatArray]:
    """(S, 3) TCP and (S, 3, 3) nominal orientation of all samples, one item after the other."""
    position = np.concatenate([item.position for item in items])
    return position, np.concatenate([item.rotation for item in items])


def _group(items: Sequence[Item], choices: int) -> list[list[Item]]:
    """Items in groups of at most `_MAX_POSES` poses. choices: rolls of each item."""
    groups: list[list[Item]] = []
    size = 0
    for item in items:
        if not groups or size + len(item) * choices > _MAX_POSES:
            groups.append([])
            size = 0
        groups[-1].append(item)
        size += len(item) * choices
    return groups


def _select_valid(
    robot: Robot, item: Item, joints: FloatArray, turn_counts: IntArray, angles: FloatArray
) -> States:
    """The states of an item with joint values (R, C, B, J) that are valid at all samples."""
    unwound, all_steady = _unwind(robot, [item], joints, np.array([0, len(item)]))
    exists = np.isfinite(joints).all(axis=(0, 3))
    known = np.where(np.isfinite(joints), joints, 0.0)
    distance = measure_singularity_distance(robot, known).min(axis=(0, -1), initial=math.inf)
    is_valid: BoolArray = np.logical_and.reduce(
        [all_steady[0], exists, distance >= item.min_distance]
    )
    within_limits = are_turned_within_limits(robot, unwound, turn_counts)
    is_state = is_valid.reshape(*is_valid.shape, 1) & np.logical_and.reduce(within_limits, axis=0)
    roll, branch, copy = np.nonzero(is_state)
    shift = math.tau * turn_counts[copy]
    enter = unwound[item.gates[0], roll, branch] + shift
    seconds = (np.abs(enter - robot.home) / robot.fastest).max(axis=1)
    order = np.lexsort((seconds, branch, roll))
    key = roll[order] * joints.shape[2] + branch[order]
    rank = np.arange(len(key)) - np.searchsorted(key, key)
    kept = np.sort(order[rank < _MAX_COPIES])
    leave = unwound[item.gates[item.last_gate], roll, branch] + shift
    gate = np.tile([0, item.last_gate], (len(roll), 1))
    states = States(enter, leave, gate, angles[roll], branch).pick(kept)
    return join_states([states, reverse_states(states)]) if item.reversible else states


def reverse_states(states: States) -> States:
    """The states run in the opposite direction."""
    return States(states.leave, states.enter, states.gate[:, ::-1], states.roll, states.branch)


class StateJoints(Struct, frozen=True, eq=False):
    """The joint values at all samples of E states.

    joints: (S, J) at the samples of each state, one state after the other.
    first: (E + 1,) the first row of each state.
    is_valid: (E,) whether the arm can run the state.
    """

    joints: FloatArray
    first: IntArray
    is_valid: BoolArray


def compute_state_joints(
    setup: Setup,
    items: Sequence[Item],
    roll: FloatArray,
    branch: IntArray,
    gate: IntArray,
    near: FloatArray,
) -> StateJoints:
    """The joint values of E items, each with one roll (E,) in one branch (E,), rad.

    gate: (E,) the gate above which the joint values are nearest to `near`.
    near: (E, J) joint values; for an arm without a closed form those above the first gate.
    """
    robot = setup.robot
    first = compute_offsets(count_rows(items))
    owner = list_owners(np.diff(first))
    position, nominal = _join_poses(items)
    goal = compute_flange_poses(setup, position, nominal @ make_rotations_about_z(roll)[owner])
    if robot.arm is None:
        solutions = _follow(robot, goal, items, first, near)
    else:
        solutions = compute_solutions(robot, *goal, robot.home)[
            np.arange(len(owner)), branch[owner]
        ]
    unwound, steady = _unwind(robot, items, solutions, first)
    at_gates = [item.gates[g] for item, g in zip(items, gate.tolist(), strict=True)]
    turns = _count_turns(robot, near - unwound[first[:-1] + at_gates]) * math.tau
    joints = unwound + turns[owner]
    min_distance = np.array([item.min_distance for item in items])[owner]
    distance = measure_singularity_distance(robot, joints).min(axis=-1, initial=math.inf)
    is_valid = are_within_limits(robot, joints) & (distance >= min_distance)
    return StateJoints(joints, first, steady & np.logical_and.reduceat(is_valid, first[:-1]))


def _count_turns(robot: Robot, moved: FloatArray) -> FloatArray:
    """The whole turns in motions of the joints (..., J), 0 for slides and infinite motions."""
    is_finite = np.isfinite(moved)
    turns = np.rint(np.where(is_finite, moved, 0.0) / math.tau)
    return np.where(robot.revolute & is_finite, turns, 0.0)


def _unwind(
    robot: Robot, items: Sequence[Item], joints: FloatArray, first: IntArray
) -> tuple[FloatArray, BoolArray]:
    """`joints` without whole turns between samples, and which items have no joint jump (E, ...).

    joints: (S, ..., J) at the samples of E items, one item after the other.
    first: (E + 1,) the first row of each item.
    """
    owner = list_owners(np.diff(first))
    before = np.concatenate([item.before for item in items]) + first[owner]
    before[first[:-1]] = first[:-1]
    moved = np.nan_to_num(joints - joints[before], nan=math.inf)
    turns = _count_turns(robot, moved)
    jumps = (np.abs(moved - math.tau * turns) > _JUMP)[..., robot.revolute].any(axis=-1)
    steady = ~np.logical_or.reduceat(jumps, first[:-1], axis=0)
    sums = np.cumsum(turns, axis=0)
    sums -= sums[first[:-1]][owner]
    # Samples above other gates are reached from the path, all others from the sample before.
    rows = np.arange(len(before))
    above = np.flatnonzero((before != rows - 1) & (before != rows))
    sums[above] = sums[before[above]] + turns[above]
    loops = np.flatnonzero([item.closed for item in items])
    if len(loops):
        # On a path around the arm's own axis a joint ends a whole turn from where it started.
        last = first[loops] + [items[k].last for k in loops.tolist()]
        steady[loops] &= (np.abs(sums[last] - sums[first[loops] + 1]) < 0.5).all(axis=-1)
    return joints - math.tau * sums, steady


def _follow(
    robot: Robot,
    goal: tuple[FloatArray, FloatArray],
    items: Sequence[Item],
    first: IntArray,
    near: FloatArray,
) -> FloatArray:
    """Joint values (S, J) at all samples, each found from the one before, of all items together."""
    joints = np.full((first[-1], near.shape[1]), np.nan)
    for sample in range(np.diff(first).max()):
        group = np.flatnonzero(sample < np.diff(first))
        rows = first[group] + sample
        guess = near[group]
        if sample:
            guess = joints[first[group] + [items[k].before[sample] for k in group.tolist()]]
        known = np.isfinite(guess).all(axis=1)
        goals = (goal[0][rows[known]], goal[1][rows[known]])
        joints[rows[known]] = find_nearest(robot, *goals, guess[known])
    return joints
