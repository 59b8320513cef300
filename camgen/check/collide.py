"""Checks a program for collisions, links included, with a bound on the depth between samples."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import chain, pairwise

import numpy as np
from msgspec import Struct

from camgen.check.lost import join_losses
from camgen.check.reach import JointTrace
from camgen.collision.cell import CellScene
from camgen.collision.describe import describe_hit
from camgen.collision.motion import SceneTest, check_in_scenes, check_motions
from camgen.collision.scene import PART, Scene
from camgen.geometry.ragged import compute_offsets, mark_run_ends, measure_runs
from camgen.model.errors import Blocked, BlockedPath
from camgen.model.part import IntArray, Note
from camgen.model.pose import FloatArray
from camgen.model.program import Program
from camgen.model.text import join_short, short
from camgen.motion.cell import FINE, STEP
from camgen.motion.joint_paths import APART, JointPath
from camgen.robots.kinematics.forward import compute_flange
from camgen.robots.models import Robot

#: Number of rows that are tested in one call, which bounds the memory.
_ROWS = 2000
#: Clearances are measured up to this at least, mm.
NEAR = 2.0
#: Distances that differ less count as equal, mm.
_SAME = 0.005
_MOVE = "move or turn the part: cell.base_from_work"
#: Remedies for a collision of a body at the flange, whose place at the part is that of the path.
_CHANGE_TOOL = (
    "let the tool lean, or take a slimmer or longer one: tool.axis_tilt, tool.diameter, tool.length"
)
_CHANGE_CELL = (
    "move the fixture, or take a slimmer or longer tool: cell.fixtures, tool.diameter, tool.length"
)


class ClosestApproach(Struct, frozen=True):
    """The position on a path, or on the link to it, at which two bodies are nearest.

    distance: distance of the bodies, mm.
    pair: names of the bodies.
    on: the path or link, in words.
    at: x, y and z of the TCP in the work frame, mm, as text.
    path: index of the path in the tour; -1 on the link home.
    works: whether the motion is along the path.
    """

    distance: float
    pair: tuple[str, str]
    on: str
    at: str
    path: int = -1
    works: bool = False

    def __str__(self) -> str:
        return f"{' against '.join(self.pair)} on {self.on} at {self.at} mm"


class ClearanceReport(Struct, frozen=True):
    """The clearances of a program without collisions, except those of the tool at the part.

    bound: distance up to which bodies are measured, mm: `NEAR` or the margin, the larger one.
    close: closest approach on each path and link that comes nearer than `bound`.
    notes: a note about each path and link that comes nearer than the margin.
    """

    bound: float
    close: tuple[ClosestApproach, ...] = ()
    notes: tuple[Note, ...] = ()

    @property
    def nearest(self) -> ClosestApproach | None:
        """The closest approach of the program; None if all of it keeps `bound`."""
        return min(self.close, key=lambda near: near.distance, default=None)

    @property
    def clearance(self) -> float:
        """The smallest distance in the program, mm, at most `bound`."""
        return min((near.distance for near in self.close), default=self.bound)

    def by_path(self, paths: int) -> tuple[list[float], list[float], float]:
        """Return the smallest distance on each path, each link to a path, and the link home, mm.

        paths: number of paths in the tour.
        """
        work, links = [self.bound] * paths, [self.bound] * (paths + 1)
        for near in self.close:
            table = work if near.works else links
            table[near.path] = min(table[near.path], near.distance)
        return work, links[:-1], links[-1]


def join_reports(reports: Sequence[ClearanceReport]) -> ClearanceReport:
    """The report of several programs that run one after the other, with one margin."""
    return ClearanceReport(
        reports[0].bound,
        tuple(chain.from_iterable(report.close for report in reports)),
        tuple(chain.from_iterable(report.notes for report in reports)),
    )


class _Collision(Struct, frozen=True):
    """A collision.

    at: place in rows of the joint path.
    pair: names of the two bodies.
    text: the bodies, their depth and the joint values.
    """

    at: float
    pair: tuple[str, str]
    text: str


def check_clear(
    where: CellScene, reach: JointTrace, course: JointPath, robot: Robot, file: str
) -> ClearanceReport:
    """Measure the clearances of a program along its motions, without blends.

    course: joint path of all motions of `reach`.

    Raises Blocked with the motion, position and bodies of the first collision, and with all paths
    that have one.
    """
    near = max(where.margin, NEAR)
    collisions: list[_Collision] = []
    close: list[ClosestApproach] = []
    for begin in range(0, max(len(course.joints) - 1, 1), _ROWS):
        rows = course.joints[begin : begin + _ROWS + 1]
        tests = SceneTest(where.with_margin, FINE, near), SceneTest(where.work, STEP)
        (others,), (working,) = check_in_scenes(tests, [rows], APART)
        for scene, check in ((where.with_margin, others), (where.work, working)):
            if check.hit:
                collisions.append(_collision(scene, course, begin + check.at, check.pair))
        if not collisions and others.nearest >= 0:
            close += _find_near(where, reach, robot, course, (begin, begin + len(rows)), near)
    collisions += _find_strict(where, reach, course)
    if collisions:
        collisions += _find_by_path(where, reach, course)
        raise _block(reach, robot, file, course, collisions)
    return ClearanceReport(near, tuple(close), _note_near(close, where.margin))


def _find_near(
    where: CellScene,
    reach: JointTrace,
    robot: Robot,
    course: JointPath,
    rows: tuple[int, int],
    near: float,
) -> list[ClosestApproach]:
    """Find the closest approach on each path and link in some rows of the joint path.

    rows: first row, and the row after the last.
    near: distance up to which bodies are measured, mm.
    """
    program, columns = reach.program, reach.program.columns
    motion_of = _find_motions(reach, course)[rows[0] : rows[1]]
    kinds = columns.path[motion_of[1:]] * 2 + columns.works[motion_of[1:]]
    runs = list(pairwise([0, *np.cumsum(measure_runs(kinds)).tolist()]))
    joints = [course.joints[rows[0] + first : rows[0] + last + 1] for first, last in runs]
    checks = check_motions(where.with_margin, joints, FINE, near, APART)
    close = []
    for (first, _), check in zip(runs, checks, strict=True):
        if check.nearest < 0:
            continue
        at = first + check.nearest_at
        number = int(motion_of[max(math.ceil(at), first + 1)])
        index = int(columns.at[number])
        place = program.place_of(index)
        works = bool(columns.works[number])
        on = place if works or program.path_of(index) is None else f"the link to {place}"
        ahead = columns.path[number:]
        path = int(next(iter(ahead[ahead >= 0]), -1))
        pair = where.with_margin.pairs[check.nearest]
        tip = _place(program, robot, course, rows[0] + at)
        close.append(ClosestApproach(check.clearance, pair, on, tip, path, works))
    return close


def _note_near(close: Sequence[ClosestApproach], margin: float) -> tuple[Note, ...]:
    nearest: dict[str, ClosestApproach] = {}
    for near in close:
        is_near = near.distance < margin - _SAME
        if is_near and near.distance <= nearest.get(near.on, near).distance:
            nearest[near.on] = near
    why = f"cell.margin asks for {short(margin, 2)} mm"
    return tuple(
        Note("warning", f"{short(near.distance, 2)} mm apart: {near}", why)
        for near in nearest.values()
    )


def _find_by_path(where: CellScene, reach: JointTrace, course: JointPath) -> list[_Collision]:
    runs = _divide_by_path(reach, course)
    return _find_in_runs(where.with_margin, course, runs) + _find_in_runs(where.work, course, runs)


def _find_strict(where: CellScene, reach: JointTrace, course: JointPath) -> list[_Collision]:
    """Find collisions by the strict test, on all paths except rims, and on links between them."""
    if where.strict is None:
        return []
    is_rim = [where.is_rim(path.contours) for path in reach.program.paths]
    columns, motion_of = reach.program.columns, _find_motions(reach, course)
    runs = []
    spared = False  # the path before
    for first, last in _divide_by_path(reach, course):
        path = int(columns.path[motion_of[last]])
        before, spared = spared, path >= 0 and is_rim[path]
        if not (before or spared):
            runs.append((first, last))
    return _find_in_runs(where.strict, course, runs)


def _divide_by_path(reach: JointTrace, course: JointPath) -> list[tuple[int, int]]:
    """Return the first and the last row of each path, and of each link to one."""
    columns, motion_of = reach.program.columns, _find_motions(reach, course)[1:]
    ends = compute_offsets(measure_runs(columns.path[motion_of] * 2 + columns.arrives[motion_of]))
    return list(pairwise(ends.tolist()))


def _find_in_runs(
    scene: Scene, course: JointPath, runs: Sequence[tuple[int, int]]
) -> list[_Collision]:
    joints = [course.joints[first : last + 1] for first, last in runs]
    checked = check_motions(scene, joints, STEP, deviation=APART)
    return [
        _collision(scene, course, first + result.at, result.pair)
        for (first, _), result in zip(runs, checked, strict=True)
        if result.hit
    ]


def _collision(scene: Scene, course: JointPath, at: float, pair: int) -> _Collision:
    return _Collision(at, scene.pairs[pair], describe_hit(scene, _joints_at(course, at), pair))


def _find_motions(reach: JointTrace, course: JointPath) -> IntArray:
    return reach.rows.motion[np.ceil(course.at).astype(np.int64)]


def _block(
    reach: JointTrace, robot: Robot, file: str, course: JointPath, collisions: list[_Collision]
) -> Blocked:
    program, columns = reach.program, reach.program.columns
    motion_of = _find_motions(reach, course)
    losses: list[BlockedPath] = []
    last = mark_run_ends(motion_of)
    for collision in sorted(collisions, key=lambda collision: collision.at):
        row = math.ceil(collision.at)
        number = int(motion_of[row])
        index = int(columns.at[number])
        path, bodies = program.path_at(index), " against ".join(collision.pair)
        where = f"at {_place(program, robot, course, collision.at)} mm"
        link = "" if columns.works[number] else " on a link to or from it"
        # The path begins at the end of its link.
        is_link = bool(columns.arrives[number]) and not (collision.at == row and last[row])
        if not losses:
            what = f"{robot.name} collides on {program.place_of(index)} {where}: {collision.text}"
            error = file, what, f"instruction {index}", _remedy(collision, robot)
        why, at_end = f"collision, {bodies}, {where}{link}", bool(link) and not is_link
        losses.append(BlockedPath(path, "collision", why, is_link, at_end))
    return Blocked(*error, join_losses(losses))


def _place(program: Program, robot: Robot, course: JointPath, at: float) -> str:
    """Format the TCP at a place in rows of the joint path, in the work frame, mm."""
    rotation, origin = compute_flange(robot, _joints_at(course, at)[None])
    tip = origin[0] + rotation[0] @ np.asarray(program.flange_from_tool.origin)
    return join_short(program.base_from_work.inverse().apply(tip), 1)


def _joints_at(course: JointPath, at: float) -> FloatArray:
    row = min(int(at), len(course.joints) - 2) if len(course.joints) > 1 else 0
    part = at - row
    after = course.joints[min(row + 1, len(course.joints) - 1)]
    return np.asarray(course.joints[row] * (1 - part) + after * part)


def _remedy(collision: _Collision, robot: Robot) -> str:
    """Choose a change of the job that helps. Moving the part moves the tool with it."""
    if collision.at == 0:
        return "give another home: cell.home"
    if {link.name for link in robot.links} & set(collision.pair):
        return _MOVE
    return _CHANGE_TOOL if PART in collision.pair else _CHANGE_CELL
