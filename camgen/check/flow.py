"""Adds blends to the corners of links, where the space inside the corner is free.

A controller rounds a corner by a parabola inside a zone, or by starting the next motion while the
previous one decelerates. The exact corner path is up to the controller. So the whole area between
the corner and the widest possible corner path is tested for collisions, as triangles of joint
values and with the margin of the cell.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence

import numpy as np
from msgspec import Struct

from camgen.check.passing import (
    MotionTrace,
    SpeedProfile,
    find_corners,
    make_speed_profile,
    trace_motions,
)
from camgen.check.reach import JointTrace, compute_tips
from camgen.collision.cell import CellScene
from camgen.collision.motion import measure_apart
from camgen.collision.triangle import are_free
from camgen.geometry.halving import find_first
from camgen.geometry.ragged import (
    count_rows,
    find_run_starts,
    list_owners,
    mark_run_ends,
    measure_runs,
)
from camgen.geometry.vectors import interpolate_rows
from camgen.model.part import BoolArray, IntArray, Note
from camgen.model.pose import FloatArray
from camgen.model.program import Columns, Force, MoveJ, Program
from camgen.model.text import counted
from camgen.motion.corners import TURNING, Flow
from camgen.robots.models import Robot
from camgen.robots.workcell import Workcell

#: mm: zones that are tried, the largest first.
_ZONES = (200.0, 150.0, 100.0, 80.0, 60.0, 50.0, 40.0, 30.0, 20.0, 15.0, 10.0, 5.0, 1.0)
#: Chords of a corner path. It bends towards the corner, so the chords are farther from the corner.
_CHORDS = 8
#: mm: added to the measured deviation of motions from straight lines of joint values.
_EXTRA_MM = 0.1
#: rad or mm: step of the joints between two tests of the height of the tip.
_HEIGHT_STEP = 0.035
#: mm: smallest blend that is written.
_MIN_BLEND = 0.1


class _CornerPath(Struct, frozen=True, eq=False):
    """A path that rounds a corner, at N places from its start to its end.

    blend: blend radius, mm.
    left: (N,) rest of the motion before the corner, as a fraction of it.
    run: (N,) part of the next motion that is done, as a fraction of it.
    """

    blend: float
    left: FloatArray
    run: FloatArray


def blend_links(
    program: Program,
    reach: JointTrace,
    where: CellScene,
    cell: Workcell,
    flow: Flow,
) -> tuple[Program, tuple[Note, ...]]:
    """Return `program` with blends in the corners of links that are free, and a note.

    A motion in contact gets no blend: the force sensor is set to zero at a stop. A program with
    force control is returned as it is.

    reach: joint values of the program.
    cell: cell with the arm that runs it.
    flow: corners that may be rounded.
    """
    robot, pace = cell.arm, cell.pace
    assert robot is not None
    trace, columns = trace_motions(program, reach, robot), program.columns
    is_line = ~columns.moves_are(MoveJ)
    is_link = ~columns.works & ~((columns.turn > 0) & is_line) & (columns.speed > flow.slow)
    profiles: dict[int, SpeedProfile] = {}
    for motion in np.flatnonzero(is_link).tolist():
        profile = make_speed_profile(trace, program, motion, pace) if motion > 0 else None
        if profile is not None:
            profiles[motion] = profile
    may_blend = _have_touched(columns, flow.slow) & (columns.blend == 0)
    corners = [k for k in find_corners(program).tolist() if may_blend[k]]
    corners = [k for k in corners if k in profiles and k + 1 in profiles]
    if not corners or columns.are(Force).any():
        return program, ()
    is_timed = pace.corner != "zone"
    zones = (0.0,) if is_timed else _ZONES
    options: dict[int, list[_CornerPath]] = {}
    room = np.where(is_line, flow.room, math.inf).tolist()
    for k in corners:
        options[k] = _list_corner_paths(profiles[k], profiles[k + 1], zones, room[k : k + 2])

    def are_clear(chosen: Mapping[int, _CornerPath]) -> list[bool]:
        rounded = [
            _make_corner(reach, trace, k, path, is_timed=is_timed) for k, path in chosen.items()
        ]
        fans = [_make_fan(corner) for corner in rounded]
        free = _are_free(where, fans, _measure_bows(where, rounded))
        return [
            is_free and _keeps_above(program, robot, fan, flow.floor)
            for is_free, fan in zip(free, fans, strict=True)
        ]

    blends = dict.fromkeys(corners, 0.0)
    blends |= {k: path.blend for k, path in _find_widest(options, are_clear).items()}
    passed = sum(blend > 0 for blend in blends.values())
    what = f"{passed} of {counted(len(blends), 'corner')} on links are passed without a stop"
    return program.with_blends(blends), (Note("assumed", what),)


def _have_touched(columns: Columns, slow: float) -> BoolArray:
    """Return (M,) False at the last motion of each path without a motion in contact.

    Such a motion ends at the position of the path, such as a mark, so the tool must stop there.
    """
    path, is_contact = columns.path, columns.works | (columns.speed <= slow)
    counts = np.cumsum(is_contact)
    before: IntArray = np.repeat((counts - is_contact)[find_run_starts(path)], measure_runs(path))
    return np.asarray(~mark_run_ends(path) | (counts > before))


def _list_corner_paths(
    before: SpeedProfile, after: SpeedProfile, zones: Sequence[float], room: Sequence[float]
) -> list[_CornerPath]:
    """List the corner paths between two motions from wide to narrow.

    zones: zones in mm; 0 overlaps the motions. A zone is left out if it is longer than half of a
        motion, since controllers reduce it there.
    room: maximum length of each of both motions that may be rounded off, mm.
    """
    half = min(before.mm, after.mm) / 2
    paths: list[_CornerPath] = []
    for zone in zones:
        if zone > half:
            continue
        path = _round(before, after, zone) if zone else _overlap(before, after)
        lengths = float(path.left[0]) * before.mm, float(path.run[-1]) * after.mm
        if lengths[0] <= room[0] and lengths[1] <= room[1]:
            paths.append(path)
    return paths


def _find_widest(
    options: Mapping[int, Sequence[_CornerPath]],
    are_clear: Callable[[Mapping[int, _CornerPath]], Sequence[bool]],
) -> dict[int, _CornerPath]:
    """Choose for each corner the widest corner path that is free, by bisection.

    options: per corner, its corner paths from wide to narrow. A narrow one lies within all wider
        ones, so if one is free all narrower ones are. Corners without a free one are left out.
    """
    widest = {k: paths[0] for k, paths in options.items() if paths}
    is_free = dict(zip(widest, are_clear(widest), strict=True))
    # Most corners have room for the widest corner path.
    narrower = {k: options[k][1:] for k in widest if not is_free[k]}

    def select(indices: Mapping[int, int]) -> dict[int, _CornerPath]:
        return {k: narrower[k][index] for k, index in indices.items()}

    counts = dict(zip(narrower, map(len, narrower.values()), strict=True))
    first_free = find_first(counts, lambda indices: are_clear(select(indices)))
    return {k: widest[k] for k in widest if is_free[k]} | select(first_free)


def _keeps_above(program: Program, robot: Robot, fan: FloatArray, floor: float) -> bool:
    """Whether the tip stays above z = `floor` in triangles (N, 3, J), sampled in small steps."""
    if floor == -math.inf:
        return True
    count = max(math.ceil(float(np.ptp(fan, axis=1).max()) / _HEIGHT_STEP), 1)
    second, first = np.indices((count + 1, count + 1)).reshape(2, -1)
    inside = first + second <= count
    weights = np.column_stack([count - first - second, first, second])[inside] / count
    joints = np.einsum("kc,ncj->nkj", weights, fan).reshape(-1, fan.shape[2])
    tip = compute_tips(robot, joints, program.flange_from_tool)
    base = program.base_from_work
    return bool(((tip - np.asarray(base.origin)) @ base.rotation[:, 2] >= floor).all())


def _round(before: SpeedProfile, after: SpeedProfile, zone: float) -> _CornerPath:
    """Make a parabola that begins and ends as far from the corner as the reorientation there."""
    t = np.linspace(0.0, 1.0, _CHORDS + 1)
    first, second = (min(TURNING * zone / profile.mm, 0.5) for profile in (before, after))
    return _CornerPath(zone, (1 - t) ** 2 * first, t**2 * second)


def _overlap(before: SpeedProfile, after: SpeedProfile) -> _CornerPath:
    """Run both motions at once, from the start of braking until the second is at its speed."""
    brake, ramp = before.peak / before.acceleration, after.peak / after.acceleration
    t = np.linspace(0.0, max(brake, ramp), _CHORDS + 1)
    left = np.maximum(brake - t, 0.0) ** 2 * before.acceleration / 2
    run = np.where(t < ramp, t**2 * after.acceleration / 2, after.peak * (t - ramp / 2))
    blend = round(float(left[0]) * before.mm / before.length, 3)
    done = np.minimum(run / after.length, 0.5)
    return _CornerPath(max(blend, _MIN_BLEND), left / before.length, done)


class _Corner(Struct, frozen=True, eq=False):
    """A corner and a path that rounds it, in joint values.

    at: (J,) the corner.
    points: (N, J) corner path.
    exact: (R, J) samples on both motions.
    even: (R, J) the same samples if the joints were interpolated linearly there.
    """

    at: FloatArray
    points: FloatArray
    exact: FloatArray
    even: FloatArray


def _make_corner(
    reach: JointTrace, trace: MotionTrace, motion: int, path: _CornerPath, *, is_timed: bool
) -> _Corner:
    """Compute the joint values of a corner path after `motion`.

    is_timed: whether fractions of a joint motion are fractions of its time; otherwise of the length
        of its TCP path, as for a line.
    """
    corner = reach.joints[trace.rows(motion).stop - 1]
    points, exact, even = np.tile(corner, (_CHORDS + 1, 1)), [], []
    evenly = np.linspace(0.0, 1.0, _CHORDS + 1)
    is_joint = reach.program.columns.moves_are(MoveJ)
    for k, fractions in ((motion, 1.0 - path.left), (motion + 1, path.run)):
        rows = trace.rows(k)
        table = trace.seconds if is_timed and is_joint[k] else trace.travelled
        first, last = table[rows.start], table[rows.stop - 1]
        at = (table[rows] - first) / (last - first)
        samples = np.concatenate([fractions, np.linspace(fractions[0], fractions[-1], _CHORDS + 1)])
        rounding, along = np.split(interpolate_rows(samples, at, reach.joints[rows]), 2)
        points += rounding - corner
        exact.append(along)
        even.append(along[0] + evenly[:, None] * (along[-1] - along[0]))
    return _Corner(corner, points, np.concatenate(exact), np.concatenate(even))


def _make_fan(corner: _Corner) -> FloatArray:
    points = corner.points
    return np.stack([np.broadcast_to(corner.at, points[1:].shape), points[:-1], points[1:]], axis=1)


def _measure_bows(where: CellScene, corners: Sequence[_Corner]) -> FloatArray:
    if not corners:
        return np.zeros(0)
    exact = np.concatenate([corner.exact for corner in corners])
    even = np.concatenate([corner.even for corner in corners])
    distances = measure_apart(where.scene, exact, even).reshape(len(corners), -1)
    return np.asarray(distances.max(axis=1) + _EXTRA_MM)


def _are_free(where: CellScene, fans: Sequence[FloatArray], bows: FloatArray) -> list[bool]:
    """Whether each corner is free of collisions and keeps the margin.

    fans: triangles of each corner, see `_make_fan`.
    bows: (n,) deviation of each corner, mm, see `_measure_bows`.
    """
    if not fans:
        return []
    triangles, owner = np.concatenate(fans), list_owners(count_rows(fans))
    free = are_free(where.with_margin, triangles, owner, where.margin, bows)
    rest = free[owner]
    left = (np.cumsum(free) - 1)[owner[rest]]
    free[free] = are_free(where.work, triangles[rest], left, 0.0, bows[free])
    return list(free.tolist())
