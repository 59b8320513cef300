"""How far a tool that turns with the contour winds up, and where it is turned back: in the air, between two paths.

Once round a contour is one turn of the last axis, which has room for little more than one to each side. A text says
orientations, not turns, and a controller takes the shorter way between two of them: whole turns are taken back in
steps that have only one.
"""

from __future__ import annotations

import math

import numpy as np

from camgen.lower_rows import Orientations, Rows
from camgen.pose import TOOL_DOWN, FloatArray, frozen

#: The tool may be turned by so much from how it stands at home, to either side, rad.
MOST = 2 * math.pi
#: A turn between two orientations that is larger has no sense of its own for sure; steps are no larger, rad.
_SURE, _STEP = math.radians(150.0), math.radians(120.0)


def twists(a: FloatArray, b: FloatArray) -> FloatArray:
    """The angles (N,) by which the tool turns about its own z from rotations a to b (N, 3, 3), rad in -pi..pi."""
    turn = np.einsum("nji,njk->nik", a, b)
    return np.asarray(np.arctan2(turn[:, 1, 0] - turn[:, 0, 1], turn[:, 0, 0] + turn[:, 1, 1]))


def unwound(rows: Rows, orientations: Orientations) -> list[list[FloatArray]]:
    """For each run the rotations (3, 3) to go through in the air before it: none, or up to that of its start.

    The tool is taken to be straight down and not wound up at home. Within a run nothing can be turned back: one that
    winds up by more than ``MOST`` to one side is begun so that it does so by as much to both.
    """
    begins, ends, vias = (np.stack(column) for column in (orientations.begins, orientations.ends, orientations.vias))
    before = np.roll(ends, 1, axis=0)
    along = np.where(rows.arc, twists(begins, vias) + twists(vias, ends), twists(begins, ends))
    step = twists(before, begins) + along
    step[rows.first] = 0.0
    total = np.cumsum(step)
    stands = np.concatenate([TOOL_DOWN[None], ends[rows.last[:-1]]])
    travel = twists(stands, ends[rows.first])
    wound, result = 0.0, []
    for k, (first, last) in enumerate(zip(rows.first.tolist(), rows.last.tolist(), strict=True)):
        run = total[first : last + 1] - total[first]
        low, high = float(run.min()), float(run.max())
        turn = float(travel[k])
        start = wound + turn
        if start + low < -MOST - 1e-9 or start + high > MOST + 1e-9:
            turn -= 2 * math.pi * round((start + (low + high) / 2) / (2 * math.pi))
        result.append(_steps(stands[k], ends[first], turn) if abs(turn) > _SURE else [])
        wound += turn + float(run[-1])
    return result


def _steps(a: FloatArray, b: FloatArray, turn: float) -> list[FloatArray]:
    """From ``a`` to ``b`` (3, 3), turning about tool z by ``turn``, in steps; the last one is ``b``."""
    count = math.ceil(abs(turn) / _STEP - 1e-9)
    angles = [turn * k / count for k in range(1, count)]
    return [*(frozen(a @ _about_z(angle)) for angle in angles), frozen(b)]


def _about_z(angle: float) -> FloatArray:
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
