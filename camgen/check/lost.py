"""Which paths of a program an arm cannot run: all of them at once, so that the others need not be tried one by one."""

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

#: So often a stretch is begun anew behind what stops it; what is left then is found when the rest is checked again.
_MOST = 60

Mask = NDArray[np.bool_]
Index = NDArray[np.int64]


class Stretch(Struct, frozen=True, eq=False):
    """N rows that an arm runs from one motion to joint values to the next. rotations (N, 3, 3), origins (N, 3): of the
    flange. path: (N,) to which each belongs. way: (N,) rows on the way to their path. free: (N,) as in ``Ties``.
    """

    robot: Robot
    rotations: FloatArray
    origins: FloatArray
    path: Index
    way: Mask
    free: Mask

    def cut(self, rows: Index) -> Stretch:
        """Some of its rows; over those that are left out the joints go as they like."""
        gap = np.append(True, np.diff(rows) > 1)
        some = (
            self.rotations[rows],
            self.origins[rows],
            self.path[rows],
            self.way[rows],
            self.free[rows] | gap,
        )
        return Stretch(self.robot, *some)


class Lost(Struct, frozen=True):
    """A motion that the arm cannot run to its end.

    row: row at which it stops.
    text: the reason, with its position.
    way: whether the link is blocked, see `BlockedPath`.
    """

    row: int
    text: str
    way: bool


def find_lost(stretch: Stretch, stuck: Stuck) -> tuple[Lost, list[Lost]]:
    """What stopped the arm, and all that cannot be run, by rows: paths that are beyond its reach or limits, and those
    to which no posture leads on from the path before. stuck: on the whole stretch.
    """
    first = explain_stuck(stretch.robot, stretch.rotations, stretch.origins, stuck)
    stop = Lost(first.row, first.text, False)
    found = _find_beyond(stretch, stuck) if stretch.robot.arm is not None else []
    gone = {int(stretch.path[one.row]) for one in found if not one.way}
    ways = {int(stretch.path[one.row]) for one in found}
    left = ~np.isin(stretch.path, list(gone)) & ~(stretch.way & np.isin(stretch.path, list(ways)))
    found += _find_apart(stretch, np.flatnonzero(left))
    return stop, sorted(found, key=lambda one: one.row) or [stop]


def _find_beyond(stretch: Stretch, stuck: Stuck) -> list[Lost]:
    """The first row of each path, and of each way, that no posture reaches within the limits."""
    robot, none = stretch.robot, np.empty((0, stuck.candidates.shape[2]))
    bad = np.flatnonzero(
        ~are_turned_within_limits(robot, stuck.candidates, list_turn_counts(robot)).any(axis=(1, 2))
    )
    _, once = np.unique(stretch.path[bad] * 2 + stretch.way[bad], return_index=True)
    found = []
    for row in bad[once].tolist():
        reason = explain_stuck(
            robot, stretch.rotations, stretch.origins, Stuck(row, stuck.candidates, none)
        )
        found.append(Lost(row, reason.text, bool(stretch.way[row])))
    return found


def _find_apart(stretch: Stretch, left: Index) -> list[Lost]:
    """What stops the arm on the rows ``left``: begun anew behind each place in whatever posture does."""
    found: list[Lost] = []
    for _ in range(_MOST):
        if not len(left):
            break
        some = stretch.cut(left)
        choice = follow(some.robot, (some.rotations, some.origins), ties=Ties(free=some.free))
        if isinstance(choice, Choice):
            break
        row = int(left[choice.row])
        text = explain_stuck(some.robot, some.rotations, some.origins, choice).text
        own = left[(some.path == stretch.path[row]) & ~some.way]
        # A path at which the rows begin has no posture to blame.
        way = bool(stretch.way[row]) or bool(len(own) and own[0] > left[0])
        found.append(Lost(row, text, way))
        left = (
            left[left >= own[0]]
            if way and len(own)
            else left[left > max([row, *own[-1:].tolist()])]
        )
    return found


def join_losses(losses: list[BlockedPath]) -> tuple[BlockedPath, ...]:
    """One for each path: what stops the path itself before what stops the way to it."""
    kept: dict[int, BlockedPath] = {}
    for one in losses:
        if one.path not in kept or (kept[one.path].way and not one.way):
            kept[one.path] = one
    return tuple(kept.values())
