"""Finds all paths of a program that an arm cannot run.

All are found at once, so that the next attempt can leave all of them out.
"""

from __future__ import annotations

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from camgen.model.errors import BlockedPath
from camgen.model.pose import FloatArray
from camgen.robots.kinematics.continuity import Choice, Stuck, Ties, follow
from camgen.robots.kinematics.joint_limits import are_turned_within_limits, list_turn_counts
from camgen.robots.kinematics.reasons import explain_stuck
from camgen.robots.models import Robot

#: Times that a stretch is started again after a failure. Later failures are found when the program
#: without the paths found so far is checked.
_MAX_RESTARTS = 60

Mask = NDArray[np.bool_]
Index = NDArray[np.int64]


class Stretch(Struct, frozen=True, eq=False):
    """N rows that an arm runs from one motion to joint values to the next.

    rotations: (N, 3, 3) orientation of the flange.
    origins: (N, 3) position of the flange, mm.
    path: (N,) path of each row.
    on_link: (N,) rows on the link to their path.
    free: (N,) rows of joint motions, see `Ties`.
    """

    robot: Robot
    rotations: FloatArray
    origins: FloatArray
    path: Index
    on_link: Mask
    free: Mask

    def select(self, rows: Index) -> Stretch:
        """Return some of the rows; the joints are free where rows are left out."""
        rotations, origins = self.rotations[rows], self.origins[rows]
        free = self.free[rows] | np.append(True, np.diff(rows) > 1)
        return Stretch(self.robot, rotations, origins, self.path[rows], self.on_link[rows], free)


class JointFailure(Struct, frozen=True):
    """A motion that the arm cannot run to its end.

    row: row at which it stops.
    text: the reason, with its position.
    on_link: whether the link is blocked, see `BlockedPath`.
    """

    row: int
    text: str
    on_link: bool


def find_failures(stretch: Stretch, stuck: Stuck) -> tuple[JointFailure, list[JointFailure]]:
    """Return the failure at which the arm stopped, and those of all paths, in order of rows.

    A path fails if it is out of reach or beyond the joint limits, or if no posture leads to it from
    the path before.

    stuck: result of following the whole stretch.
    """
    first = explain_stuck(stretch.robot, stretch.rotations, stretch.origins, stuck)
    stop = JointFailure(first.row, first.text, False)
    failures = _find_unreachable(stretch, stuck) if stretch.robot.arm is not None else []
    blocked = [int(stretch.path[failure.row]) for failure in failures if not failure.on_link]
    failed = [int(stretch.path[failure.row]) for failure in failures]
    is_blocked = np.isin(stretch.path, blocked)
    is_failed_link = stretch.on_link & np.isin(stretch.path, failed)
    failures += _find_interrupted(stretch, np.flatnonzero(~is_blocked & ~is_failed_link))
    return stop, sorted(failures, key=lambda failure: failure.row) or [stop]


def _find_unreachable(stretch: Stretch, stuck: Stuck) -> list[JointFailure]:
    robot, none = stretch.robot, np.empty((0, stuck.candidates.shape[2]))
    can_reach = are_turned_within_limits(robot, stuck.candidates, list_turn_counts(robot))
    bad = np.flatnonzero(~can_reach.any(axis=(1, 2)))
    _, first = np.unique(stretch.path[bad] * 2 + stretch.on_link[bad], return_index=True)
    failures = []
    for row in bad[first].tolist():
        at_row = Stuck(row, stuck.candidates, none)
        reason = explain_stuck(robot, stretch.rotations, stretch.origins, at_row)
        failures.append(JointFailure(row, reason.text, bool(stretch.on_link[row])))
    return failures


def _find_interrupted(stretch: Stretch, left: Index) -> list[JointFailure]:
    """Find the failures on the rows `left`, starting again in any posture after each."""
    failures: list[JointFailure] = []
    for _ in range(_MAX_RESTARTS):
        if not len(left):
            break
        rest = stretch.select(left)
        choice = follow(rest.robot, (rest.rotations, rest.origins), ties=Ties(free=rest.free))
        if isinstance(choice, Choice):
            break
        row = int(left[choice.row])
        text = explain_stuck(rest.robot, rest.rotations, rest.origins, choice).text
        path_rows = left[(rest.path == stretch.path[row]) & ~rest.on_link]
        # If the rows begin with this path, no posture before it can be the reason.
        starts_later = len(path_rows) > 0 and path_rows[0] > left[0]
        on_link = bool(stretch.on_link[row]) or bool(starts_later)
        failures.append(JointFailure(row, text, on_link))
        if on_link and len(path_rows):
            left = left[left >= path_rows[0]]
        else:
            left = left[left > max([row, *path_rows[-1:].tolist()])]
    return failures


def join_losses(losses: list[BlockedPath]) -> tuple[BlockedPath, ...]:
    """Keep one per path; a blocked path counts before a blocked link to it."""
    kept: dict[int, BlockedPath] = {}
    for loss in losses:
        if loss.path not in kept or (kept[loss.path].on_link and not loss.on_link):
            kept[loss.path] = loss
    return tuple(kept.values())
