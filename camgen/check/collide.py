"""Does the whole program, links included, run clear of everything: every motion, with a bound on what is in between."""

from __future__ import annotations

import math
from functools import partial
from itertools import pairwise

import numpy as np
from msgspec import Struct

from camgen.check.reach import Reach, trace
from camgen.collision.cell import Surroundings
from camgen.collision.motion import measure_apart, motion, motions
from camgen.collision.scene import PART
from camgen.geometry.ragged import offsets, run_lengths
from camgen.model.errors import Blocked, Loss
from camgen.model.part import IntArray
from camgen.model.program import Program
from camgen.model.text import short
from camgen.plan.edges import STEP
from camgen.plan.edges.courses import APART, Course
from camgen.robots.kinematics.forward import flange
from camgen.robots.models import Robot

#: Rows that are tested together: bounds the memory.
_ROWS = 2000
#: mm: clearances above are not told apart.
NEAR = 2.0
_MOVE = "move or turn the part: cell.base_from_work"
#: Of a collision of what is at the flange with what stands, which stays where it is if the part is moved with it.
_CHANGE_TOOL = "let the tool lean, or take a slimmer or longer one: tool.axis_tilt, tool.diameter, tool.length"
_CHANGE_CELL = "move the fixture, or take a slimmer or longer tool: cell.fixtures, tool.diameter, tool.length"


class Clear(Struct, frozen=True):
    """What was found. clearance: mm, the least distance of anything but the tool from the part, at most ``NEAR``."""

    clearance: float


class _Collision(Struct, frozen=True):
    """at: the place in rows of the course. pair: the two bodies."""

    at: float
    pair: tuple[str, str]


def check_clear(where: Surroundings, reach: Reach, robot: Robot, file: str) -> Clear:
    """Tests the motions of ``reach``, all of them, as a controller makes them. Blocked, with the motion, the place and
    the obstacle of the first collision, and every path on which there is one.
    """
    course = trace(reach, robot, partial(measure_apart, where.scene), file)
    least = NEAR
    found = []
    for begin in range(0, max(len(course.joints) - 1, 1), _ROWS):
        rows = course.joints[begin : begin + _ROWS + 1]
        meetings = [(where.apart, motion(where.apart, rows, STEP, NEAR, APART))]
        meetings += [(where.work, motion(where.work, rows, STEP, apart=APART))]
        least = min(least, meetings[0][1].clearance)
        found += [_Collision(begin + met.at, scene.pairs[met.pair]) for scene, met in meetings if met.pair >= 0]
    if found:
        raise _block(reach, robot, file, course, [*found, *_find_by_path(where, reach, course)])
    return Clear(least)


def _find_by_path(where: Surroundings, reach: Reach, course: Course) -> list[_Collision]:
    """The first collision of each run of motions of one path."""
    path = reach.program.columns.path[_motions(reach, course)[1:]]
    ends = offsets(run_lengths(path))
    runs = [course.joints[a : b + 1] for a, b in pairwise(ends.tolist())]
    found = []
    for scene in (where.apart, where.work):
        met = motions(scene, runs, STEP, apart=APART)
        found += [_Collision(a + m.at, scene.pairs[m.pair]) for a, m in zip(ends, met, strict=False) if m.pair >= 0]
    return found


def _motions(reach: Reach, course: Course) -> IntArray:
    """(D,) the motion that each row of the course belongs to."""
    return reach.rows.motion[np.ceil(course.at).astype(np.int64)]


def _block(reach: Reach, robot: Robot, file: str, course: Course, found: list[_Collision]) -> Blocked:
    """The error about all paths with a collision."""
    program = reach.program
    instruction = program.columns.at[_motions(reach, course)]
    lost: dict[int, Loss] = {}
    for one in sorted(found, key=lambda one: one.at):
        index = int(instruction[math.ceil(one.at)])
        path, words = program.path_at(index), " against ".join(one.pair)
        where = f"at {_place(program, robot, course, one.at)} mm"
        link = (
            "" if program.columns.works[int(np.searchsorted(program.columns.at, index))] else " on a way to or from it"
        )
        if not lost:
            what = f"{robot.name} collides on {program.place_of(index)} {where}: {words}"
            error = file, what, f"instruction {index}", _remedy(one, robot)
        lost.setdefault(path, Loss(path, "collision", f"collision, {words}, {where}{link}"))
    return Blocked(*error, tuple(lost.values()))


def _place(program: Program, robot: Robot, course: Course, at: float) -> str:
    """The TCP there, x, y and z in the work frame."""
    row = min(int(at), len(course.joints) - 2) if len(course.joints) > 1 else 0
    part = at - row
    joints = course.joints[row] * (1 - part) + course.joints[min(row + 1, len(course.joints) - 1)] * part
    rotation, origin = flange(robot, joints[None])
    tip = origin[0] + rotation[0] @ np.asarray(program.flange_from_tool.origin)
    return " ".join(short(v, 1) for v in program.base_from_work.inverse().apply(tip))


def _remedy(one: _Collision, robot: Robot) -> str:
    """What would help. What is at the flange stays where it is beside the part, however that is moved."""
    if one.at == 0:
        return "give another home: cell.home"
    if {link.name for link in robot.links} & set(one.pair):
        return _MOVE
    return _CHANGE_TOOL if PART in one.pair else _CHANGE_CELL
