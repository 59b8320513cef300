"""Tests the rounded corners along the paths of an arm for collisions.

A corner that is free and keeps the margin stays as it is. Any other one gets a smaller blend or a
stop.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from msgspec import Struct

from camgen.check.executed import pick_transitions
from camgen.check.passing import find_corners
from camgen.check.reach import JointTrace, compute_tips
from camgen.collision.cell import CellScene
from camgen.collision.motion import check_motions, measure_apart, measure_closer
from camgen.collision.scene import Scene
from camgen.geometry.vectors import interpolate_rows
from camgen.model.cell import Dynamics
from camgen.model.part import BoolArray, IntArray, Note
from camgen.model.pose import FloatArray
from camgen.model.program import Columns, Program
from camgen.model.text import counted
from camgen.model.tolerance import NONZERO, ZONES
from camgen.motion.cell import FINE, STEP
from camgen.motion.corners import TURNING
from camgen.motion.joint_paths import APART, JointPath
from camgen.motion.rounding import measure_rounding
from camgen.robots.models import Robot
from camgen.robots.workcell import Workcell

#: Corners that are tested together; it bounds the memory.
_CORNERS = 1000
#: Chords of a rounded path.
_CHORDS = 8

#: Distances (N,), mm, between joint values (N, J) and others in a scene.
_Measure = Callable[[Scene, FloatArray, FloatArray], FloatArray]


class _JointPath(Struct, frozen=True, eq=False):
    """A program of M motions as a path of the joints.

    joints: (D, J) joint values, so close that linear interpolation between them is exact enough.
    travelled: (D,) path of the TCP up to each of them, mm.
    end: (M,) row in which each motion ends.
    tip: (D, 3) place of the TCP, mm.
    """

    joints: FloatArray
    travelled: FloatArray
    end: IntArray
    tip: FloatArray

    def joints_at(self, mm: FloatArray) -> FloatArray:
        """Interpolate joint values (*, J) at lengths (*,) along the path of the TCP, mm."""
        return interpolate_rows(mm, self.travelled, self.joints)

    def tip_at(self, mm: FloatArray) -> FloatArray:
        """Interpolate the TCP (*, 3), mm, at lengths (*,) along its path, mm."""
        return interpolate_rows(mm, self.travelled, self.tip)


class _RoundedCorners(Struct, frozen=True, eq=False):
    """K corners in joint values.

    programmed: (K, C + 1, J) joint values on the programmed path.
    rounded: (K, C + 1, J) joint values on the widest corner path.
    middle: (K, C, J) joint values in the middle of the chords of the programmed path.
    more: (K,) distance, mm, by which the controller may leave the path farther than `rounded`.
    """

    programmed: FloatArray
    rounded: FloatArray
    middle: FloatArray
    more: FloatArray


def reduce_blends(
    program: Program,
    reach: JointTrace,
    joint_path: JointPath,
    where: CellScene,
    cell: Workcell,
    gap: float = 0.0,
) -> tuple[Program, tuple[Note, ...]]:
    """Reduce blends along paths until all corners are free; a note counts the changed ones.

    In a free corner the programmed path keeps the margin, and in addition the distance by which two
    bodies may come nearer on the widest corner path. So all paths between both keep the margin. The
    tool and the part meet along a path, so for this pair the widest corner path itself is tested.

    reach: joint values of the program.
    joint_path: joint path of the program; it meets nothing without blends.
    gap: distance, mm, that all bodies with a margin keep along the program. A corner that needs no
        more is not tested again.
    """
    columns, pace = program.columns, cell.pace
    corners = find_corners(program)
    corners = corners[columns.works[corners] & columns.works[corners + 1]]
    corners = corners[columns.blend[corners] > 0]
    if not len(corners):
        return program, ()
    assert cell.arm is not None
    path = _follow(program, reach, joint_path, cell.arm)
    blend = columns.blend.copy()
    is_rim = np.array([where.is_rim(origin.contours) for origin in program.paths], np.bool_)
    left = corners
    while len(left):
        free = []
        for rows in np.split(left, range(_CORNERS, len(left), _CORNERS)):
            rounded = _round(columns, path, blend[rows], rows, pace)
            free.append(_are_clear(where, rounded, gap, ~is_rim[columns.path[rows]]))
        left = left[~np.concatenate(free)]
        blend[left] = _lessen(blend[left], pace)
        left = left[blend[left] > 0]
    changed = corners[blend[corners] < columns.blend[corners]]
    if not len(changed):
        return program, ()
    blends = dict(zip(changed.tolist(), blend[changed].tolist(), strict=True))
    what = f"blends are smaller at {len(changed)} of {counted(len(corners), 'corner')} along paths"
    return program.with_blends(blends), (
        Note("assumed", what, "a wider corner path there is not proven to be free"),
    )


def _follow(program: Program, reach: JointTrace, joint_path: JointPath, robot: Robot) -> _JointPath:
    tip = compute_tips(robot, joint_path.joints, program.flange_from_tool)
    travelled = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(tip, axis=0), axis=1)))
    return _JointPath(
        joint_path.joints, travelled, np.searchsorted(joint_path.at, reach.rows.at), tip
    )


def _lessen(blend: FloatArray, pace: Dynamics) -> FloatArray:
    """The next smaller blends; 0 for motions that overlap, which have none."""
    if pace.corner == "overlap":
        return np.zeros_like(blend)
    return np.asarray(np.select([blend > zone for zone in ZONES], ZONES, 0.0))


def _are_clear(
    where: CellScene, corners: _RoundedCorners, gap: float, is_strict: BoolArray
) -> BoolArray:
    """(K,) whether the arm meets nothing in corners and keeps the margin.

    is_strict: (K,) whether the corner is on a path that is not along a rim.
    """
    programmed, rounded = corners.programmed, corners.rounded
    deviation = _measure(where.scene, measure_apart, rounded, programmed) + corners.more
    even = (programmed[:, 1:] + programmed[:, :-1]) / 2
    bow = APART + float(_measure(where.scene, measure_apart, corners.middle, even).max(initial=0.0))
    # Two bodies that move may both deviate, and a test may state their distance by a step too
    # large.
    clear: BoolArray = np.asarray(where.margin + 2 * deviation + FINE + 2 * APART <= gap)
    tight = np.flatnonzero(~clear)
    closer = _measure(where.with_margin, measure_closer, rounded[tight], programmed[tight])
    needed = where.margin + closer + 2 * corners.more[tight]
    tests = check_motions(where.with_margin, list(programmed[tight]), FINE, needed, bow)
    clear[tight] = np.array([0.0 if test.hit else test.clearance for test in tests]) >= needed
    if where.work.pairs:
        tests = check_motions(where.work, list(rounded), STEP, deviation=bow)
        clear &= ~np.array([test.hit for test in tests])
    if where.strict is not None and is_strict.any():
        tests = check_motions(where.strict, list(rounded[is_strict]), STEP, deviation=bow)
        clear[is_strict] &= ~np.array([test.hit for test in tests])
    return clear


def _measure(scene: Scene, measure: _Measure, first: FloatArray, second: FloatArray) -> FloatArray:
    """Measure the largest distance (K,) between joint values (K, R, J) and others, mm."""
    shape = (-1, first.shape[-1])
    distances = measure(scene, first.reshape(shape), second.reshape(shape))
    return np.asarray(distances.reshape(first.shape[:2]).max(axis=1))


def _round(
    columns: Columns, path: _JointPath, blend: FloatArray, corners: IntArray, pace: Dynamics
) -> _RoundedCorners:
    """The corners at the ends of motions, rounded as widely as the tool may be turned there.

    The rounding mixes both motions. The model of the controller has another curve where a motion
    is an arc; where that one leaves the path farther, `more` is the rest.
    """
    place = path.travelled[path.end]
    corner = place[corners]
    reach = blend * (1.0 if pace.corner == "overlap" else TURNING)
    # A controller cuts a zone at half of either motion.
    before = np.minimum(reach, (corner - place[corners - 1]) / 2)[:, None]
    after = np.minimum(reach, (place[corners + 1] - corner) / 2)[:, None]
    # In the middle chord as much is left of the first motion as is run of the second one.
    share, sides = np.linspace(0.0, 1.0, _CHORDS + 1), (np.sqrt(before), np.sqrt(after))
    even = sides[0] / np.maximum(sides[0] + sides[1], NONZERO)
    t = np.where(share <= 0.5, 2 * share * even, even + (2 * share - 1) * (1 - even))
    left, run = corner[:, None] - (1 - t) ** 2 * before, corner[:, None] + t**2 * after
    along = left + run - corner[:, None]
    rows = path.end[corners]
    rounded = path.joints_at(left) + path.joints_at(run) - path.joints[rows, None]
    tip = path.tip_at(left) + path.tip_at(run) - path.tip[rows, None]
    distance = np.linalg.norm(tip - path.tip[rows, None], axis=2).min(axis=1)
    modelled = pick_transitions(columns, corners)._replace(blend=blend)
    more = np.maximum(np.nan_to_num(measure_rounding(modelled, pace)) - distance, 0.0)
    middle = path.joints_at((along[:, 1:] + along[:, :-1]) / 2)
    return _RoundedCorners(path.joints_at(along), rounded, middle, more)
