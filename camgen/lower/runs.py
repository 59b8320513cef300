"""Tool passes: one along a path at one depth, with its entry into the material and over the tabs.

A path with three depths gives three passes. The rows of a pass are those of its path, after those
of its entry. Heights are given as seen from the depth of the pass, so that the depth is subtracted
from all of them alike. Slanted segments are chords: controllers have arcs in a plane only.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from camgen.model.errors import JobError
from camgen.model.job import Job, ProcessTable
from camgen.model.limits import format_limit
from camgen.model.path import ToolPath, Tour, join_paths, make_waypoints
from camgen.model.pose import FloatArray, frozen
from camgen.model.tolerance import SAME_POINT_MM
from camgen.plan.pieces import begin_at, chorded, head, lengths_along, shortest, stretch


class ToolPass(Struct, frozen=True, gc=False):
    """One pass of the tool along a path.

    path: the path with the entry of the pass.
    number: index of the path in the program.
    depth: depth below the heights of `path`, mm.
    linked: whether it starts where the pass before ended, with only the plunge between them.
    begin: depth at which it starts, mm below the plan.
    down: whether it is reached straight from the path before, without a lift.
    low: whether it starts where the pass before ended, but the tool is first turned back, above the
        material and no higher.
    """

    path: ToolPath
    number: int
    depth: float
    linked: bool
    begin: float
    down: bool = False
    low: bool = False


class _Descent(Struct, frozen=True):
    """The limits of an entry.

    slope: tangent of the entry angle.
    chord: chord tolerance, mm.
    plunge: speed, mm/s.
    most: maximum number of motions.
    """

    slope: float
    chord: float
    plunge: float
    limit: float


class _Pass(Struct, frozen=True, gc=False):
    """A pass of one path.

    path: the path with its entry, heights as seen from its depth.
    begin: depth at which it starts, mm below the plan.
    """

    path: ToolPath
    begin: float


#: A path as each pass runs it, one for each depth.
_Directions = list[ToolPath]


def make_passes(tour: Tour, job: Job, winds: bool, before: int = 0) -> list[ToolPass]:
    """The passes of all paths in their order.

    Raises JobError for an entry that contradicts other settings of the job.

    before: number of paths of the program that come before those of the tour.
    winds: whether the tool turns with the contour, once around in every pass, and has to be turned
        back in the air.
    """
    slope = math.tan(math.radians(job.operation.entry_angle))
    descent = _Descent(slope, job.tolerance.chord, plunge(job.process), job.limits.motions)
    passes = []
    for index, path in enumerate(tour.paths):
        # A single pass is not linked with another one.
        several, at_depth = len(path.depths) > 1, index in tour.down
        # With force on, the motion after each pass has to leave the surface, so the tool is lifted.
        pressed = (several or at_depth) and bool(path.force.any())
        gap = math.dist(path.position[0].tolist(), path.position[-1].tolist()) if several else 0.0
        meets = several and gap < SAME_POINT_MM
        zigzag = several and path.reversible and not meets
        directions = [path] * len(path.depths)
        if zigzag:
            directions[1::2] = [path.reversed()] * (len(directions) // 2)
        linked = (zigzag or (meets and not winds)) and not pressed
        low = meets and not linked and not pressed
        planned = _plan_passes(directions, job, descent, at_depth)
        for k, (depth, path_pass) in enumerate(zip(path.depths, planned, strict=True)):
            passes.append(
                ToolPass(
                    path=path_pass.path,
                    number=before + index,
                    depth=depth,
                    linked=linked and k > 0,
                    begin=path_pass.begin,
                    down=k == 0 and at_depth and not pressed,
                    low=low and k > 0,
                )
            )
    return passes


def plunge(process: ProcessTable) -> float:
    """Speed of the plunge to the contact, mm/s."""
    return process.plunge or process.feed / 3


def _plan_passes(directions: _Directions, job: Job, descent: _Descent, down: bool) -> list[_Pass]:
    """The passes of a path. down: whether it is reached at its depth."""
    path, entry = directions[0], job.operation.entry
    if entry == "plunge" or max(path.depths) <= 0 or lengths_along(path)[-1] < SAME_POINT_MM:
        return [
            _Pass(_raise_over_tabs(directed, depth, descent.plunge), depth)
            for directed, depth in zip(directions, path.depths, strict=True)
        ]
    helix = entry == "helix" and path.entry_radius > 0
    _check_entry(path, job, down, helix)
    if path.closed and not helix:
        return _enter_around(directions, descent)
    return _enter_each(directions, descent, _enter_by_helix if helix else _enter_back_and_forth)


def _check_entry(path: ToolPath, job: Job, down: bool, helix: bool) -> None:
    """Raise JobError if a path cannot be entered on a slant. helix: whether a helix is used."""
    entry, remedy = job.operation.entry, 'set operation.entry to "plunge"'
    what, key = "", ""
    if path.force.any():
        what, key = f"a {entry} into the material and a force against it", "process.force"
    elif job.tool.orient == "follow":
        what = f"a tool that turns with the contour goes straight down, not on a {entry}"
        key = "tool.orient"
    elif down:
        what = f"a path that is reached at working height cannot be entered on a {entry}"
        key = "process.stay_down"
    elif not helix and len({*path.position[:, 2].tolist()}) > 1:
        what = f"path {path.id} is not level, so it cannot be entered on a {entry}"
        key = "operation.entry"
    if what:
        raise JobError("job", what, key, remedy)


def _list_steps(depths: tuple[float, ...]) -> list[float]:
    """The step down to each pass, mm, never negative."""
    return [max(0.0, depth - before) for before, depth in zip((0.0, *depths), depths, strict=False)]


def _enter_each(
    directions: _Directions,
    descent: _Descent,
    enter: Callable[[ToolPath, float, float, _Descent], ToolPath],
) -> list[_Pass]:
    """Passes that each begin with an entry. enter: gets the two heights of an entry, mm."""
    passes, depths = [], directions[0].depths
    for directed, depth, step in zip(directions, depths, _list_steps(depths), strict=True):
        path = _raise_over_tabs(directed, depth, descent.plunge)
        if step > SAME_POINT_MM:
            ramp = enter(directed, step - depth, -depth, descent)
            path = join_paths([_seen_from_depth(ramp, depth), path])
        passes.append(_Pass(path, depth - step))
    return passes


def _enter_back_and_forth(
    path: ToolPath, from_z: float, to_z: float, descent: _Descent
) -> ToolPath:
    """The entry along the first section of an open path, before its first tab.

    It ends where it starts, and runs back and forth as often as necessary.
    """
    needed = (from_z - to_z) / (descent.slope * shortest(path, descent.chord))
    turns = math.ceil(needed / (2 * _measure_before_tabs(path)) - 1e-9)
    forth = chorded(head(path, needed / (2 * turns)), descent.chord)
    _check_count(2 * turns * len(forth.position), descent)
    return _descend(join_paths([forth, forth.reversed()] * turns), from_z, to_z, descent.plunge)


def _measure_before_tabs(path: ToolPath) -> float:
    """Length of a path up to the slope of its first tab, mm; its whole length without tabs."""
    along = lengths_along(path)
    if path.floor is None:
        return float(along[-1])
    raised = np.flatnonzero(path.floor > path.floor.min() + SAME_POINT_MM)
    return float(along[raised[0] - 1]) if len(raised) and raised[0] else float(along[-1])


def _enter_around(directions: _Directions, descent: _Descent) -> list[_Pass]:
    """Passes along a closed path, each with a ramp along it and then once around at its depth.

    They follow each other without a break. The last one ends at the planned start of the path, so
    the first one begins before it by the length of all ramps.
    """
    path = directions[0]
    chord_fraction, whole = shortest(path, descent.chord), float(lengths_along(path)[-1])
    steps = _list_steps(path.depths)
    ramps = [step / (descent.slope * chord_fraction) for step in steps]
    _check_count(sum(ramps) / whole * len(chorded(path, descent.chord).position), descent)
    passes = []
    for k, (depth, step, ramp) in enumerate(zip(path.depths, steps, ramps, strict=True)):
        begin, end = -sum(ramps[k:]) % whole, -sum(ramps[k + 1 :]) % whole
        loop = _raise_over_tabs(begin_at(path, end), depth, descent.plunge)
        if step > SAME_POINT_MM:
            chords = chorded(stretch(path, begin, ramp), descent.chord)
            entry = _descend(chords, step - depth, -depth, descent.plunge)
            loop = join_paths([_seen_from_depth(entry, depth), loop])
        passes.append(_Pass(loop, depth - float(loop.position[0, 2] - path.position[0, 2])))
    return passes


def _enter_by_helix(path: ToolPath, from_z: float, to_z: float, descent: _Descent) -> ToolPath:
    radius = path.entry_radius
    step = _compute_helix_step(radius, descent.chord)
    _check_count((from_z - to_z) / (descent.slope * radius * step), descent)
    helix = make_helix_entry(path, from_z, to_z, radius, math.atan(descent.slope), descent.chord)
    is_down = np.diff(helix.position[:, 2], prepend=np.inf) < 0
    slow = np.minimum(helix.feed, descent.plunge)
    return helix.with_columns(feed=np.where(is_down, slow, helix.feed))


def _check_count(motions: float, descent: _Descent) -> None:
    if motions > descent.limit:
        limit = format_limit(descent.limit)
        what = f"a ramp at this angle needs {motions:,.0f} motions; the limit is {limit}"
        remedy = "use a steeper angle, or raise limits.motions"
        raise JobError("job", what, "operation.entry_angle", remedy)


def _descend(chords: ToolPath, from_z: float, to_z: float, speed: float) -> ToolPath:
    """Chords at the height of the plan, lowered from `from_z` to `to_z`, but over the tabs, mm."""
    along, height = lengths_along(chords), chords.position[:, 2]
    z = from_z + (to_z - from_z) * along / along[-1]
    z[-1] = to_z
    if chords.floor is not None:
        z = np.maximum(z, chords.floor - height)
    return _with_heights(chords.with_columns(feed=np.minimum(chords.feed, speed)), height + z)


def _seen_from_depth(path: ToolPath, depth: float) -> ToolPath:
    """The path as seen from `depth` mm below the plan."""
    return _with_heights(path, path.position[:, 2] + depth)


def _raise_over_tabs(path: ToolPath, depth: float, speed: float) -> ToolPath:
    """A pass as seen from its depth, raised over the tabs.

    After a tab it goes down at no more than `speed` mm/s.
    """
    if path.floor is None:
        return path
    z = np.maximum(path.position[:, 2], path.floor + depth)
    if (z == path.position[:, 2]).all():
        return path
    raised = _with_heights(path, z)
    drop, length = -np.diff(z), np.diff(lengths_along(raised))
    is_down = drop > SAME_POINT_MM
    feed = path.feed.copy()
    feed[1:][is_down] = np.minimum(feed[1:][is_down], speed * length[is_down] / drop[is_down])
    return raised.with_columns(feed=feed)


def _with_heights(path: ToolPath, z: FloatArray) -> ToolPath:
    """The path with its waypoints at heights `z` (N,); both ends of an arc are at one height."""
    position, via = path.position.copy(), path.via.copy()
    position[:, 2] = z
    via[:, 2] = np.where(np.isnan(via[:, 0]), np.nan, z)
    return path.with_columns(position=position, via=via)


def make_helix_entry(
    path: ToolPath, from_z: float, to_z: float, radius: float, angle: float, chord: float
) -> ToolPath:
    """A helix down about the first point of a path, once around at its foot, and to that point.

    It turns as the path would beside a wall around it: counter-clockwise with the wall on the
    right, as in climb cutting.

    from_z, to_z: heights relative to the path, mm.
    radius: radius of the helix, mm.
    angle: angle to the horizontal, rad.
    chord: largest distance of the helix from its chords, mm.
    """
    # A chord is shorter than its arc, so the helix is made longer by that factor to keep its slope.
    step = _compute_helix_step(radius, chord)
    sweep = (from_z - to_z) / (math.tan(angle) * radius * math.sin(step / 2) / (step / 2))
    count = math.ceil(sweep / step)
    turn = _find_turn_direction(path) * np.concatenate(
        [np.linspace(0.0, sweep, count + 1), sweep + np.array([0.5, 1.0, 1.5, 2.0]) * np.pi]
    )
    x, y, z = path.position[0].tolist()
    circle = np.column_stack(
        [x + radius * np.cos(turn), y + radius * np.sin(turn), np.full(len(turn), z + to_z)]
    )
    circle[: count + 1, 2] = z + np.linspace(from_z, to_z, count + 1)
    foot = np.arange(count + 1, len(turn))
    ends = np.concatenate([circle[: count + 1], circle[foot[1::2]], [[x, y, z + to_z]]])
    via = np.full(ends.shape, np.nan)
    via[count + 1 : count + 3] = circle[foot[::2]]
    return replace(
        path,
        table=make_waypoints(ends, via, path.feed[0], axis=path.axis[0]),
        closed=False,
        floor=None if path.floor is None else frozen(np.full(len(ends), path.floor[0])),
    )


def _compute_helix_step(radius: float, chord: float) -> float:
    """Angle whose chord is at most `chord` mm from a circle of this radius, rad."""
    return min(2 * math.acos(max(0.0, 1 - chord / radius)), math.radians(30))


def _find_turn_direction(path: ToolPath) -> float:
    """+1 for counter-clockwise, -1 if the path presses on its left."""
    ahead = (path.position[1] if np.isnan(path.via[1, 0]) else path.via[1]) - path.position[0]
    press = path.force_direction[1, 0]
    return -1.0 if ahead[0] * press[1] - ahead[1] * press[0] > 0 else 1.0
