"""Ways between paths without stops: the corners of a link are rounded where all that lies within a corner is free.

Controllers round a corner by a parabola within a zone, or begin the next motion while the one before slows down. How
far exactly is theirs. So all is tested that lies between the corner and the widest of these ways, triangle by triangle
of configurations, with the margin.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence

import numpy as np
from msgspec import Struct

from camgen.check.passing import Cruise, Legs, cruise, find_corners, legs_of
from camgen.check.reach import Reach
from camgen.collision.cell import Surroundings
from camgen.collision.motion import measure_apart
from camgen.collision.triangle import are_free
from camgen.geometry.halving import find_first
from camgen.geometry.ragged import ends_run, owners, run_lengths, run_starts
from camgen.model.part import BoolArray, IntArray, Note
from camgen.model.pose import FloatArray
from camgen.model.program import Columns, Force, MoveJ, Program
from camgen.model.text import counted
from camgen.motion.corners import TURNING, Flow
from camgen.robots.kinematics.forward import flange
from camgen.robots.models import Robot
from camgen.robots.workcell import Workcell

#: mm: zones that are tried, the largest first.
_ZONES = (200.0, 150.0, 100.0, 80.0, 60.0, 50.0, 40.0, 30.0, 20.0, 15.0, 10.0, 5.0, 1.0)
#: Chords in place of what rounds a corner; it bends towards the corner, so that they are farther off. And mm that are
#: added to what the motions are off straight lines.
_CHORDS, _ROUGH = 8, 0.1
#: rad or mm: from look to look at the height of the tip.
_LOOK = 0.035
#: mm: the least blend.
_LEAST_MM = 0.1


class _Rounding(Struct, frozen=True, eq=False):
    """How far a corner may be rounded. blend: mm. left: (N,) what is left of the motion before it, made: (N,) what of
    the next one is made, both as shares of the motions, from where the rounding begins to where it ends.
    """

    blend: float
    left: FloatArray
    made: FloatArray


def let_flow(
    program: Program,
    found: Reach,
    where: Surroundings,
    cell: Workcell,
    flow: Flow,
) -> tuple[Program, tuple[Note, ...]]:
    """``program`` with blends in those corners of its ways between paths that have room for one; a note says how many.

    A motion in contact has none: the sensor of the force is set to zero at a stop.

    found: joint values of the program.
    cell: cell with the arm that runs it.
    flow: corners that may be rounded.
    """
    robot, pace = cell.arm, cell.pace
    assert robot is not None
    legs, columns = legs_of(program, found, robot), program.columns
    turns = (columns.turn > 0) & ~columns.moves_are(MoveJ)
    link = ~columns.works & ~turns & (columns.speed > flow.slow)
    runs = {
        k: one
        for k in np.flatnonzero(link).tolist()
        if k > 0 and (one := cruise(legs, program, k, pace))
    }
    touched = _have_touched(columns, flow.slow)
    blends = {
        k: 0.0
        for k in find_corners(program).tolist()
        if k in runs and k + 1 in runs and not columns.blend[k] and touched[k]
    }
    lines = ~columns.moves_are(MoveJ)
    if not blends or columns.are(Force).any():
        return program, ()
    zones = _ZONES if pace.corner == "zone" else (0.0,)
    ways = {
        k: _ways(runs[k], runs[k + 1], zones, (lines[k], lines[k + 1]), flow.room) for k in blends
    }

    def free_of(some: Mapping[int, _Rounding]) -> list[bool]:
        corners = [
            _corner(found, legs, k, way, timed=pace.corner != "zone") for k, way in some.items()
        ]
        fans = [_fan(corner) for corner in corners]
        free = _are_free(where, fans, _bows(where, corners))
        return [
            good and _keeps_above(program, robot, fan, flow.floor)
            for good, fan in zip(free, fans, strict=True)
        ]

    blends |= {k: way.blend for k, way in _find_widest(ways, free_of).items()}
    passed = sum(blend > 0 for blend in blends.values())
    what = f"{passed} of {counted(len(blends), 'corner')} on the ways between are passed without a stop"
    return program.with_blends(blends), (Note("assumed", what),)


def _have_touched(columns: Columns, slow: float) -> BoolArray:
    """(M,) the motions after which the tool may go to another path: what has only led to a path has not been there."""
    path, there = columns.path, columns.works | (columns.speed <= slow)
    counts = np.cumsum(there)
    before: IntArray = np.repeat((counts - there)[run_starts(path)], run_lengths(path))
    return np.asarray(~ends_run(path) | (counts > before))


def _ways(
    one: Cruise, two: Cruise, zones: Sequence[float], lines: tuple[bool, bool], room: float
) -> list[_Rounding]:
    """The ways to round a corner, the widest first: by each of ``zones`` of which half of both motions is outside,
    since controllers cut it off there; by overlapping them where that is 0. lines: which of both motions are such, of
    which no more than ``room`` mm are rounded off.
    """
    short = min(one.mm, two.mm) / 2
    ways = [
        _round(one, two, zone) if zone else _overlap(one, two) for zone in zones if zone <= short
    ]
    return [way for way in ways if _keeps_up(way, one, two, lines, room)]


def _find_widest(
    ways: Mapping[int, Sequence[_Rounding]],
    free_of: Callable[[Mapping[int, _Rounding]], Sequence[bool]],
) -> dict[int, _Rounding]:
    """Of each corner's ways, the widest first, one that is free and the next wider one is not; none where none is free.
    What rounds a corner lies within all that is wider.
    """

    def free(at: Mapping[int, int]) -> Sequence[bool]:
        return free_of({k: ways[k][one] for k, one in at.items()})

    # Most corners have room for the widest.
    tried = {k: 0 for k, some in ways.items() if some}
    good = dict(zip(tried, free(tried), strict=True))
    narrow = {k: len(ways[k]) - 1 for k, one in good.items() if not one}
    found = find_first(narrow, lambda at: free({k: one + 1 for k, one in at.items()}))
    return {k: ways[k][0] for k, one in good.items() if one} | {
        k: ways[k][at + 1] for k, at in found.items()
    }


def _keeps_up(
    way: _Rounding, one: Cruise, two: Cruise, lines: tuple[bool, bool], room: float
) -> bool:
    """Whether of lines no more than ``room`` mm are rounded off. lines: which of both motions are such."""
    off = float(way.left[0]) * one.mm, float(way.made[-1]) * two.mm
    return all(mm <= room for mm, line in zip(off, lines, strict=True) if line)


def _keeps_above(program: Program, robot: Robot, fan: FloatArray, floor: float) -> bool:
    """Whether the tip is nowhere below ``floor`` in the triangles (N, 3, J), looked at in steps of the joints."""
    if floor == -math.inf:
        return True
    count = max(math.ceil(float(np.ptp(fan, axis=1).max()) / _LOOK), 1)
    first, second = (part.ravel() for part in np.meshgrid(*[np.arange(count + 1)] * 2))
    inside = first + second <= count
    shares = np.column_stack([count - first - second, first, second])[inside] / count
    rotation, origin = flange(
        robot, np.einsum("kc,ncj->nkj", shares, fan).reshape(-1, fan.shape[2])
    )
    tip = origin + rotation @ np.asarray(program.flange_from_tool.origin)
    base = program.base_from_work
    return bool(((tip - np.asarray(base.origin)) @ base.rotation[:, 2] >= floor).all())


def _round(one: Cruise, two: Cruise, zone: float) -> _Rounding:
    """A parabola, as far off the corner as the tool turns there."""
    t = np.linspace(0.0, 1.0, _CHORDS + 1)
    wide = [min(TURNING * zone / each.mm, 0.5) for each in (one, two)]
    return _Rounding(zone, (1 - t) ** 2 * wide[0], t**2 * wide[1])


def _overlap(one: Cruise, two: Cruise) -> _Rounding:
    """Both motions at once, from where the first begins to slow down until that is over and the second at its speed."""
    brake, ramp = one.peak / one.gain, two.peak / two.gain
    t = np.linspace(0.0, max(brake, ramp), _CHORDS + 1)
    left = np.maximum(brake - t, 0.0) ** 2 * one.gain / 2
    made = np.where(t < ramp, t**2 * two.gain / 2, two.peak * (t - ramp / 2))
    blend = round(float(left[0]) * one.mm / one.length, 3)
    return _Rounding(max(blend, _LEAST_MM), left / one.length, np.minimum(made / two.length, 0.5))


class _Corner(Struct, frozen=True, eq=False):
    """A corner and a way that rounds it, in configurations. at: (J,) the corner. points: (N, J) of the way. exact,
    even: (R, J) those on both motions, and the same as if joints ran evenly there.
    """

    at: FloatArray
    points: FloatArray
    exact: FloatArray
    even: FloatArray


def _corner(found: Reach, legs: Legs, motion: int, way: _Rounding, *, timed: bool) -> _Corner:
    """The corner after ``motion``. timed: shares of motions of the joints are of their time, not of the TCP's way."""
    corner = found.joints[legs.rows(motion).stop - 1]
    points, exact, even = np.tile(corner, (_CHORDS + 1, 1)), [], []
    evenly = np.linspace(0.0, 1.0, _CHORDS + 1)
    for k, shares in ((motion, 1.0 - way.left), (motion + 1, way.made)):
        rows = legs.rows(k)
        table = legs.seconds if timed and found.program.columns.moves_are(MoveJ)[k] else legs.way
        at, joints = (
            (table[rows] - table[rows.start]) / (table[rows.stop - 1] - table[rows.start]),
            found.joints[rows],
        )
        between = np.linspace(shares[0], shares[-1], _CHORDS + 1)
        rounding, along = np.split(_rows(at, joints, np.concatenate([shares, between])), 2)
        points += rounding - corner
        exact.append(along)
        even.append(along[0] + evenly[:, None] * (along[-1] - along[0]))
    return _Corner(corner, points, np.concatenate(exact), np.concatenate(even))


def _fan(corner: _Corner) -> FloatArray:
    """What is between a corner and the way that rounds it, as triangles (N, 3, J) of configurations."""
    points = corner.points
    return np.stack([np.broadcast_to(corner.at, points[1:].shape), points[:-1], points[1:]], axis=1)


def _bows(where: Surroundings, corners: Sequence[_Corner]) -> FloatArray:
    """Mm that both motions are off straight lines of joint values at corners (n,)."""
    if not corners:
        return np.zeros(0)
    exact, even = (
        np.concatenate(rows)
        for rows in zip(*((one.exact, one.even) for one in corners), strict=True)
    )
    return np.asarray(
        measure_apart(where.scene, exact, even).reshape(len(corners), -1).max(axis=1) + _ROUGH
    )


def _rows(at: FloatArray, joints: FloatArray, shares: FloatArray) -> FloatArray:
    """The joints at ``shares`` (N,) of a motion that has ``joints`` (R, J) at the shares ``at`` (R,)."""
    return np.stack([np.interp(shares, at, column) for column in joints.T], axis=1)


def _are_free(where: Surroundings, fans: Sequence[FloatArray], bows: FloatArray) -> list[bool]:
    """In which corners nothing is met, and the margin kept. fans: as of ``_fan``, bows: (n,) mm, as of ``_bows``."""
    if not fans:
        return []
    triangles, owner = np.concatenate(fans), owners([len(fan) for fan in fans])
    free = are_free(where.with_margin, triangles, owner, where.margin, bows)
    rest = free[owner]
    free[free] = are_free(
        where.work, triangles[rest], (np.cumsum(free) - 1)[owner[rest]], 0.0, bows[free]
    )
    return [bool(each) for each in free]
