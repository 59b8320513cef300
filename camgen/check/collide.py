"""Does the whole program, links included, run clear of everything: every motion, with a bound on what is in between."""

from __future__ import annotations

import numpy as np
from msgspec import Struct

from camgen.check.reach import Reach
from camgen.collision.cell import Surroundings
from camgen.collision.motion import motion
from camgen.collision.scene import name_pair
from camgen.model.errors import NoSafeProgram
from camgen.model.program import Program
from camgen.plan.edges import STEP

#: Rows that are tested together: bounds the memory.
_ROWS = 2000
#: mm: clearances above are not told apart.
NEAR = 2.0


class Clear(Struct, frozen=True):
    """What was found. clearance: mm, the least distance of anything but the tool from the part, at most ``NEAR``."""

    clearance: float


def check_clear(where: Surroundings, program: Program, reach: Reach, file: str) -> Clear:
    """Tests the motions through ``reach.joints``, all of them. NoSafeProgram with the motion, the link and the obstacle
    of the first collision.
    """
    least = NEAR
    joints = reach.joints
    for begin in range(0, max(len(joints) - 1, 1), _ROWS):
        rows = joints[begin : begin + _ROWS + 1]
        courses = (where.apart, motion(where.apart, rows, STEP, NEAR)), (where.work, motion(where.work, rows, STEP))
        least = min(least, courses[0][1].clearance)
        hit = [(course.at, course.pair, scene) for scene, course in courses if course.pair >= 0]
        if hit:
            at, pair, scene = min(hit, key=lambda one: one[0])
            index = int(reach.owner[begin + int(np.ceil(at))])
            what = f"{reach.robot} collides on {program.place_of(index)}: {name_pair(scene, pair)}"
            raise NoSafeProgram(file, what, f"instruction {index}", "move or turn the part: cell.base_from_work")
    return Clear(least)
