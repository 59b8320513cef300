"""Paths of a flat part as an arm runs them: the poses that it is looked at in, and the joints of each posture and turn.

A path is looked at along its deepest pass, every 10 mm, and above the places where it may begin and end: its gates.
The tool comes and leaves there at the height of travel.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from msgspec import Struct

from camgen.geometry.arcs import chain
from camgen.geometry.ragged import offsets, owners
from camgen.geometry.rotations import find_sideways, from_axes, turned_about_z
from camgen.model.part import BoolArray, IntArray
from camgen.model.path import ToolPath
from camgen.model.pose import FloatArray
from camgen.motion.search import find_solutions
from camgen.motion.setup import MARGIN, Setup, compute_flange_poses
from camgen.plan.pieces import lengths_along
from camgen.robots.kinematics.inverse import find_nearest, inverse
from camgen.robots.kinematics.joint_limits import (
    are_turned_within_limits,
    are_within_limits,
    list_turn_counts,
)
from camgen.robots.kinematics.singular import measure_singularity_distance
from camgen.robots.models import Robot

#: mm between two looks along a path, and the most looks at one.
_LOOK_MM, _MOST_LOOKS = 10.0, 120
#: Gates of a closed path: at least, at most, and mm of it for each.
_LEAST_GATES, _MOST_GATES, _GATE_MM = 4, 12, 10.0
#: rad: no joint turns by more from one look to the next.
_JUMP = math.radians(40)
#: Poses that joints are found for at once: bounds the memory.
_POSES = 40_000
#: Of the joint values that differ by whole turns, so many of those nearest to home are kept.
_COPIES = 2


class Item(Struct, frozen=True, eq=False):
    """A path. position (R, 3), rotation (R, 3, 3): the looks, work frame, with the nominal turn: above the first gate,
    along the path, and above the other gates. before: (R,) the look from which each is reached, -1: none. gates: (G,)
    the looks above. along: (G,) mm along the path where the gates are. closed: it is left where it is entered.
    reversible: it may be run from its last gate to its first. off: rad that it keeps from singularities.
    """

    position: FloatArray
    rotation: FloatArray
    before: IntArray
    gates: IntArray
    along: FloatArray
    closed: bool
    reversible: bool
    off: float = MARGIN

    def __len__(self) -> int:
        return len(self.position)

    @property
    def last(self) -> int:
        """The look at the end of the path."""
        return len(self.position) - len(self.gates)


def lay_out(path: ToolPath, clearance: float, seams: bool) -> Item:
    """``path`` as it is looked at. clearance: the height of travel. seams: a closed one may begin elsewhere."""
    length = lengths_along(path)
    whole = float(length[-1])
    closed = path.closed and whole > 0
    count = min(math.ceil(whole / _LOOK_MM), _MOST_LOOKS) if whole > 0 else 0
    gates = (
        min(max(_LEAST_GATES, math.ceil(whole / _GATE_MM)), _MOST_GATES) if closed and seams else 1
    )
    count = max(count, gates if closed else 1) if whole > 0 else 0
    looked = np.linspace(0.0, whole, count + 1)
    position, axis = _at(path, length, looked)
    lift = -axis * _lifts(position, axis, clearance)[:, None]
    low = position - [0.0, 0.0, max(path.depths)]
    # A gate is at a look.
    at = np.round(np.arange(gates) * (count / gates)).astype(np.int64)
    if not closed and count:
        at = np.array([0, count])
    rows = np.concatenate([at[:1], np.arange(count + 1), at[1:]])
    above = np.concatenate([[0], np.arange(count + 2, count + 1 + len(at))])
    before = np.arange(-1, count + 1)
    before = np.concatenate([before, 1 + at[1:]])
    place = low[rows]
    place[above] = (position + lift)[rows[above]]
    nominal = from_axes(axis, find_sideways(axis))[rows]
    reversible = path.reversible and not closed and count > 0
    return Item(place, nominal, before, above, looked[at], closed, reversible)


def _at(path: ToolPath, length: FloatArray, looked: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Places and axes (K, 3), ``looked`` mm along the path."""
    if len(path.position) == 1:
        return path.position[[0] * len(looked)], path.axis[[0] * len(looked)]
    segment = np.clip(np.searchsorted(length, looked, side="left") - 1, 0, len(length) - 2)
    whole = length[segment + 1] - length[segment]
    part = np.divide(looked - length[segment], whole, out=np.zeros(len(looked)), where=whole > 0)
    axis = path.axis[segment] + part[:, None] * (path.axis[segment + 1] - path.axis[segment])
    return chain(path.position, path.via[1:]).point(part, segment), axis / np.linalg.norm(
        axis, axis=1
    )[:, None]


def _lifts(position: FloatArray, axis: FloatArray, clearance: float) -> FloatArray:
    """Mm along the axis up to the height of travel, as ``lower`` has it."""
    straight = axis[:, 2] < -1 + 1e-12
    return np.where(straight, clearance - position[:, 2], clearance)


class States(Struct, frozen=True, eq=False):
    """M states: ways to run an item.

    enter, leave: (M, J) joint values where the item is entered and left.
    gate: (M, 2) index of the gate of both.
    turn: (M,) roll from the nominal orientation, rad.
    branch: (M,) the column of ``inverse``; -1 for joint values that do not follow from a roll.
    """

    enter: FloatArray
    leave: FloatArray
    gate: IntArray
    turn: FloatArray
    branch: IntArray

    def __len__(self) -> int:
        return len(self.turn)

    @classmethod
    def fixed(cls, joints: FloatArray) -> States:
        """One state with the joint values (J,), which has no branch."""
        rows = joints[None]
        return cls(rows, rows, np.zeros((1, 2), np.int64), np.zeros(1), np.array([-1]))

    def single(self, row: int) -> States:
        """One of the states."""
        return self.pick(np.array([row]))

    def split(self) -> list[States]:
        """Each state by itself."""
        return [self.single(row) for row in range(len(self))]

    def pick(self, rows: IntArray | BoolArray) -> States:
        """Some of the states."""
        return States(
            self.enter[rows], self.leave[rows], self.gate[rows], self.turn[rows], self.branch[rows]
        )


def join_states(several: Sequence[States]) -> States:
    """All of ``several``, in order."""
    columns = (
        np.concatenate([getattr(one, name) for one in several]) for name in States.__struct_fields__
    )
    return States(*columns)


def find_states(
    setup: Setup, items: Sequence[Item], angles: FloatArray, around: IntArray
) -> list[States]:
    """For each item all postures and turns, of ``angles`` (C,), in which it can be run as a whole with one turn, from
    its first gate to its last, or, of a closed one, from its first: joints keep their limits, 2 deg from singularities
    and go on without a jump. around: (M, C) as ``Grid.moves``, for arms whose joints are followed.
    """
    robot, table = setup.robot, list_turn_counts(setup.robot)
    spin = turned_about_z(angles)
    found: list[States] = []
    for group in _groups(items, len(angles)):
        position = np.concatenate([item.position for item in group])
        rotation = np.concatenate([item.rotation for item in group])[:, None] @ spin
        goal = compute_flange_poses(setup, position[:, None], rotation)
        ends = offsets([len(item) for item in group])
        # Without a closed form the joints of a row depend on those before it along its path.
        if robot.arm:
            joints = np.split(find_solutions(robot, *goal, around), ends[1:-1])
        else:
            rows = [slice(*pair) for pair in pairwise(ends.tolist())]
            joints = [find_solutions(robot, goal[0][own], goal[1][own], around) for own in rows]
        found += [
            _states(robot, item, own, table, angles)
            for item, own in zip(group, joints, strict=True)
        ]
    return found


def _groups(items: Sequence[Item], choices: int) -> list[list[Item]]:
    groups: list[list[Item]] = []
    size = 0
    for item in items:
        if not groups or size + len(item) * choices > _POSES:
            groups.append([])
            size = 0
        groups[-1].append(item)
        size += len(item) * choices
    return groups


def _states(
    robot: Robot, item: Item, found: FloatArray, table: IntArray, angles: FloatArray
) -> States:
    """The states of an item with joints (R, C, B, J)."""
    unwound, all_steady = _unwind(robot, [item], found, np.array([0, len(item)]))
    steady = all_steady[0]
    there = np.isfinite(found).all(axis=(0, 3))
    away = measure_singularity_distance(robot, np.where(np.isfinite(found), found, 0.0)).min(
        axis=(0, -1), initial=math.inf
    )
    sound: BoolArray = np.logical_and.reduce([steady, there, away >= item.off])
    good = sound.reshape(*sound.shape, 1) & np.logical_and.reduce(
        are_turned_within_limits(robot, unwound, table), axis=0
    )
    turn, branch, copy = np.nonzero(good)
    shift = math.tau * table[copy]
    enter = unwound[item.gates[0], turn, branch] + shift
    far = (np.abs(enter - robot.home) / robot.fastest).max(axis=1)
    order = np.lexsort((far, branch, turn))
    key = turn[order] * found.shape[2] + branch[order]
    rank = np.arange(len(key)) - np.searchsorted(key, key)
    kept = np.sort(order[rank < _COPIES])
    out = item.gates[0 if item.closed else -1]
    leave = unwound[out, turn, branch] + shift
    gate = np.tile([0, 0 if item.closed else len(item.gates) - 1], (len(turn), 1))
    states = States(enter, leave, gate, angles[turn], branch).pick(kept)
    return join_states([states, turn_round(states)]) if item.reversible else states


def turn_round(states: States) -> States:
    """The same run the other way."""
    return States(states.leave, states.enter, states.gate[:, ::-1], states.turn, states.branch)


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
    turn: FloatArray,
    branch: IntArray,
    gate: IntArray,
    near: FloatArray,
) -> StateJoints:
    """Items (E) each with one turn (E,), in one branch (E,), with joints near to ``near`` (E, J) above ``gate`` (E,);
    of an arm without a closed form that is the first.
    """
    robot = setup.robot
    first = offsets([len(item) for item in items])
    owner = owners(np.diff(first))
    rotation = np.concatenate([item.rotation for item in items]) @ turned_about_z(turn)[owner]
    goal = compute_flange_poses(setup, np.concatenate([item.position for item in items]), rotation)
    if robot.arm is None:
        found = _follow(robot, goal, items, first, near)
    else:
        found = inverse(robot, *goal, robot.home)[np.arange(len(owner)), branch[owner]]
    unwound, steady = _unwind(robot, items, found, first)
    off = (
        near
        - unwound[
            first[:-1] + [item.gates[g] for item, g in zip(items, gate.tolist(), strict=True)]
        ]
    )
    off = np.where(
        robot.revolute & np.isfinite(off),
        np.rint(np.where(np.isfinite(off), off, 0.0) / math.tau) * math.tau,
        0.0,
    )
    joints = unwound + off[owner]
    off = np.array([item.off for item in items])[owner]
    sound = are_within_limits(robot, joints) & (
        measure_singularity_distance(robot, joints).min(axis=-1, initial=math.inf) >= off
    )
    return StateJoints(joints, first, steady & np.logical_and.reduceat(sound, first[:-1]))


def _unwind(
    robot: Robot, items: Sequence[Item], joints: FloatArray, first: IntArray
) -> tuple[FloatArray, BoolArray]:
    """``joints`` without whole turns between samples, and whether no joint jumps in each item (E, ...).

    joints: (S, ..., J) at the samples of E items, one item after the other.
    first: (E + 1,) the first row of each item.
    """
    owner = owners(np.diff(first))
    before = np.concatenate([item.before for item in items]) + first[owner]
    before[first[:-1]] = first[:-1]
    moved = np.nan_to_num(joints - joints[before], nan=math.inf)
    whole = np.where(
        robot.revolute & np.isfinite(moved),
        np.rint(np.where(np.isfinite(moved), moved, 0.0) / math.tau),
        0.0,
    )
    jumps = (np.abs(moved - math.tau * whole) > _JUMP)[..., robot.revolute].any(axis=-1)
    steady = ~np.logical_or.reduceat(jumps, first[:-1], axis=0)
    sums = np.cumsum(whole, axis=0)
    sums -= sums[first[:-1]][owner]
    # The samples above other gates are reached from along the path, all others from the one before.
    extra = np.flatnonzero(
        (before != np.arange(-1, len(before) - 1)) & (before != np.arange(len(before)))
    )
    sums[extra] = sums[before[extra]] + whole[extra]
    loops = np.array([k for k, item in enumerate(items) if item.closed], dtype=np.int64)
    if len(loops):
        # Round the arm's own axis a path ends a whole turn from where it started.
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
    """Joints (S, J) of looks followed one after the other, of all items together."""
    found = np.full((first[-1], near.shape[1]), np.nan)
    for look in range(max(len(item) for item in items)):
        some = [k for k, item in enumerate(items) if look < len(item)]
        at = first[some] + look
        guess = found[first[some] + [items[k].before[look] for k in some]] if look else near[some]
        known = np.flatnonzero(np.isfinite(guess).all(axis=1))
        found[at[known]] = find_nearest(robot, goal[0][at[known]], goal[1][at[known]], guess[known])
    return found
