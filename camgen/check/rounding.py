"""Corners along the paths: what a controller rounds off there is free and keeps the margin, else it rounds less."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from msgspec import Struct

from camgen.check.passing import find_corners
from camgen.check.reach import Reach
from camgen.collision.cell import Surroundings
from camgen.collision.motion import measure_apart, measure_closer, motions
from camgen.collision.scene import Scene
from camgen.model.cell import Dynamics
from camgen.model.part import BoolArray, IntArray, Note
from camgen.model.pose import FloatArray
from camgen.model.program import Columns, Program
from camgen.model.text import counted
from camgen.model.tolerance import NONZERO, ZONES
from camgen.motion.cell import FINE, STEP
from camgen.motion.corners import TURNING
from camgen.motion.joint_paths import APART, JointPath
from camgen.robots.kinematics.forward import flange
from camgen.robots.models import Robot
from camgen.robots.workcell import Workcell

#: Corners that are tested together: bounds the memory. Chords in place of what rounds one.
_CORNERS, _CHORDS = 1000, 8

#: How far apart configurations (N, J) and others are in a scene: (N,) mm.
_Measure = Callable[[Scene, FloatArray, FloatArray], FloatArray]


class _Ways(Struct, frozen=True, eq=False):
    """A program as it is run. joints: (D, J), so close that they run evenly in between. way: (D,) mm of the TCP up to
    there. end: (M,) the row in which each motion ends.
    """

    joints: FloatArray
    way: FloatArray
    end: IntArray

    def at(self, mm: FloatArray) -> FloatArray:
        """The joints (*, J) at places (*,) along the way, none of them where the TCP stands."""
        return np.stack([np.interp(mm, self.way, column) for column in self.joints.T], axis=-1)


def hold_clear(
    program: Program,
    found: Reach,
    course: JointPath,
    where: Surroundings,
    cell: Workcell,
    gap: float = 0.0,
) -> tuple[Program, tuple[Note, ...]]:
    """``program`` with those blends along its paths that may stay, lesser ones or stops in place of others: a note says
    of how many.

    Within a corner the program's way is to keep the margin and as much as two bodies may be nearer on the widest
    rounding, which holds for all between these ways. Of the tool and the part, which meet there, the widest rounding is
    tested like any motion. found, course: of the program, which meets nothing without blends. gap: mm that all that is
    to keep the margin is apart all along it, as a test found it: a corner that needs no more is not tested again.
    """
    columns, pace = program.columns, cell.pace
    corners = _find_rounded(columns, find_corners(program))
    if not len(corners):
        return program, ()
    assert cell.arm is not None
    ways, blend = _follow(program, found, course, cell.arm), columns.blend.copy()
    left = corners
    while len(left):
        free = [
            _are_clear(where, ways, blend, some, pace, gap)
            for some in np.split(left, range(_CORNERS, len(left), _CORNERS))
        ]
        left = left[~np.concatenate(free)]
        blend[left] = _lessen(blend[left], pace)
        left = left[blend[left] > 0]
    changed = corners[blend[corners] < columns.blend[corners]]
    if not len(changed):
        return program, ()
    less = dict(zip(changed.tolist(), blend[changed].tolist(), strict=True))
    what = f"less is rounded at {len(changed)} of {counted(len(corners), 'corner')} along the paths"
    note = Note("assumed", what, "what more would be rounded off there is not free for sure")
    return program.with_blends(less), (note,)


def _find_rounded(columns: Columns, corners: IntArray) -> IntArray:
    """Those of some motions that end in a blend between two motions along a path."""
    return corners[
        (columns.blend[corners] > 0) & columns.works[corners] & columns.works[corners + 1]
    ]


def _follow(program: Program, found: Reach, course: JointPath, robot: Robot) -> _Ways:
    rotation, origin = flange(robot, course.joints)
    tip = origin + rotation @ np.asarray(program.flange_from_tool.origin)
    way = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(tip, axis=0), axis=1)))
    return _Ways(course.joints, way, np.searchsorted(course.at, found.rows.at))


def _lessen(blend: FloatArray, pace: Dynamics) -> FloatArray:
    """The next smaller blends: where motions overlap there are none."""
    if pace.corner == "overlap":
        return np.zeros_like(blend)
    return np.asarray(np.select([blend > zone for zone in ZONES], ZONES, 0.0))


def _are_clear(
    where: Surroundings,
    ways: _Ways,
    blend: FloatArray,
    corners: IntArray,
    pace: Dynamics,
    gap: float,
) -> BoolArray:
    """In which corners (K,), after these motions, nothing is met and the margin kept."""
    own, rounded, middle = _round(ways, blend[corners], corners, pace)
    off = _measure(where.scene, measure_apart, rounded, own)
    even = (own[:, 1:] + own[:, :-1]) / 2
    bow = APART + float(_measure(where.scene, measure_apart, middle, even).max(initial=0.0))
    # Two bodies that move may both be off, and a test tells their distance by up to a step too large.
    clear: BoolArray = np.asarray(where.margin + 2 * off + FINE + 2 * APART <= gap)
    tight = np.flatnonzero(~clear)
    needed = where.margin + _measure(where.apart, measure_closer, rounded[tight], own[tight])
    beside = motions(where.apart, list(own[tight]), FINE, needed, bow)
    clear[tight] = np.array([0.0 if one.hit else one.clearance for one in beside]) >= needed
    if where.work.pairs:
        clear &= ~np.array([one.hit for one in motions(where.work, list(rounded), STEP, apart=bow)])
    return clear


def _measure(scene: Scene, by: _Measure, one: FloatArray, other: FloatArray) -> FloatArray:
    """The most (K,), mm, of what is measured from the configurations of a corner to others, (K, R, J) each."""
    rows = (each.reshape(-1, each.shape[-1]) for each in (one, other))
    return np.asarray(by(scene, *rows).reshape(one.shape[:2]).max(axis=1))


def _round(
    ways: _Ways, blend: FloatArray, corners: IntArray, pace: Dynamics
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """The joints on the program's way about the corners after these motions, and on a parabola from as far before each
    corner to as far behind it as it may be rounded with its ``blend``, (K, C + 1, J) each; the joints half-way from one
    to the next of the former, (K, C, J).
    """
    place = ways.way[ways.end]
    here = place[corners]
    wide = blend * (1.0 if pace.corner == "overlap" else TURNING)
    # A controller cuts what is rounded at half of either motion.
    before = np.minimum(wide, (here - place[corners - 1]) / 2)[:, None]
    after = np.minimum(wide, (place[corners + 1] - here) / 2)[:, None]
    # In the middle one of the chords' ends, by so much of both motions as much is left of one as is made of the other.
    share, sides = np.linspace(0.0, 1.0, _CHORDS + 1), (np.sqrt(before), np.sqrt(after))
    even = sides[0] / np.maximum(sides[0] + sides[1], NONZERO)
    t = np.where(share <= 0.5, 2 * share * even, even + (2 * share - 1) * (1 - even))
    left, made = here[:, None] - (1 - t) ** 2 * before, here[:, None] + t**2 * after
    along = left + made - here[:, None]
    rounded = ways.at(left) + ways.at(made) - ways.joints[ways.end[corners], None]
    return ways.at(along), rounded, ways.at((along[:, 1:] + along[:, :-1]) / 2)
