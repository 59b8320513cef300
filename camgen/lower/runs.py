"""Runs: one pass each along a path at one depth, how it gets down there, and over the tabs.

A path with three depths gives three runs. The columns of a run are those of its path with what leads into the material
before them; heights that are not those of the pass stand in them as seen from its depth, so that the depth is taken off
all of them alike. What goes down slantwise is chords: controllers have arcs in a plane only.
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
from camgen.model.path import ToolPath, Tour, join_paths, waypoints
from camgen.model.pose import FloatArray, frozen
from camgen.model.tolerance import SAME_POINT_MM
from camgen.plan.pieces import begin_at, chorded, head, lengths_along, shortest, stretch


class Run(Struct, frozen=True, gc=False):
    """One pass. number: of its path in the program. depth: mm, to be taken off the heights of ``path``. begin: mm below
    the plan where it starts. linked: it starts where the run before it ended, so that nothing lies between them but the
    plunge. down: it is reached straight from there, without a lift. low: it starts there too, but the tool is turned
    back before, above the material and no higher.
    """

    path: ToolPath
    number: int
    depth: float
    linked: bool
    begin: float
    down: bool = False
    low: bool = False


class _Descent(Struct, frozen=True):
    """How a tool goes down. slope: the tangent of the entry angle. chord: mm. plunge: mm/s. most: motions."""

    slope: float
    chord: float
    plunge: float
    most: float


class _Pass(Struct, frozen=True, gc=False):
    """path: with its entry, heights as seen from its depth. begin: mm below the plan where it starts."""

    path: ToolPath
    begin: float


_Ways = list[ToolPath]


def make_runs(tour: Tour, job: Job, winds: bool, before: int = 0) -> list[Run]:
    """The runs of all paths in their order.

    before: how many paths of the program come before those of the tour. winds: the tool turns with the contour, once
    round for every pass, and has to be turned back in the air. Raises JobError for an entry that does not go with what
    else the job asks for.
    """
    slope = math.tan(math.radians(job.operation.entry_angle))
    descent = _Descent(slope, job.tolerance.chord, plunge(job.process), job.limits.motions)
    runs = []
    for index, path in enumerate(tour.paths):
        # Of a single pass nobody asks how it goes on from the one before it.
        several, at_depth = len(path.depths) > 1, index in tour.down
        # With force on, the motion after each pass has to leave the surface, so it goes up and comes down again.
        pressed = (several or at_depth) and bool(path.force.any())
        meets = (
            several
            and math.dist(path.position[0].tolist(), path.position[-1].tolist()) < SAME_POINT_MM
        )
        zigzag = several and path.reversible and not meets
        ways = [path.reversed() if zigzag and k % 2 else path for k in range(len(path.depths))]
        linked = (zigzag or (meets and not winds)) and not pressed
        low = meets and not linked and not pressed
        for k, (depth, one) in enumerate(
            zip(path.depths, _passes(ways, job, descent, at_depth), strict=True)
        ):
            down = k == 0 and at_depth and not pressed
            runs.append(
                Run(
                    one.path,
                    before + index,
                    depth,
                    linked and k > 0,
                    one.begin,
                    down,
                    low and k > 0,
                )
            )
    return runs


def plunge(process: ProcessTable) -> float:
    """The speed of going down to the contact, mm/s."""
    return process.plunge or process.feed / 3


def _passes(ways: _Ways, job: Job, descent: _Descent, down: bool) -> list[_Pass]:
    """The passes of a path that is run in ``ways``. down: it is reached at its depth."""
    path, entry = ways[0], job.operation.entry
    if entry == "plunge" or max(path.depths) <= 0 or lengths_along(path)[-1] < SAME_POINT_MM:
        return [
            _Pass(_over_tabs(way, depth, descent.plunge), depth)
            for way, depth in zip(ways, path.depths, strict=True)
        ]
    helix = entry == "helix" and path.entry_radius > 0
    _insist_on_room(path, job, down, helix)
    if helix:
        return _go_down(
            ways, descent, lambda way, from_z, to_z: _enter_by_helix(way, from_z, to_z, descent)
        )
    if path.closed:
        return _go_round(ways, descent)
    return _go_down(
        ways, descent, lambda path, from_z, to_z: _enter_to_and_fro(path, from_z, to_z, descent)
    )


def _insist_on_room(path: ToolPath, job: Job, down: bool, helix: bool) -> None:
    """JobError where a path cannot be entered on a slant. helix: it is entered on one."""
    entry, remedy = job.operation.entry, 'set operation.entry to "plunge"'
    if path.force.any():
        raise JobError(
            "job", f"a {entry} into the material and a force against it", "process.force", remedy
        )
    if job.tool.orient == "follow":
        what = f"a tool that turns with the contour goes straight down, not on a {entry}"
        raise JobError("job", what, "tool.orient", remedy)
    if down:
        what = f"a way at working height has no material to go down into on a {entry}"
        raise JobError("job", what, "process.stay_down", remedy)
    if not helix and len({*path.position[:, 2].tolist()}) > 1:
        raise JobError(
            "job",
            f"path {path.id} is not level: no {entry} goes into it",
            "operation.entry",
            remedy,
        )


def _steps(depths: tuple[float, ...]) -> list[float]:
    """By how much each pass goes down, mm, never up."""
    return [max(0.0, depth - before) for before, depth in zip((0.0, *depths), depths, strict=False)]


def _go_down(
    ways: _Ways, descent: _Descent, enter: Callable[[ToolPath, float, float], ToolPath]
) -> list[_Pass]:
    """Passes that each begin with what ``enter`` makes of a way and the two heights, both below the plan."""
    passes = []
    for way, depth, step in zip(ways, ways[0].depths, _steps(ways[0].depths), strict=True):
        loop = _over_tabs(way, depth, descent.plunge)
        if step > SAME_POINT_MM:
            ramp = enter(way, step - depth, -depth)
            loop = join_paths([_at_depth(ramp, depth), loop])
        passes.append(_Pass(loop, depth - step))
    return passes


def _enter_to_and_fro(path: ToolPath, from_z: float, to_z: float, descent: _Descent) -> ToolPath:
    """The descent along the first stretch of an open path, before its first tab.

    It ends where it starts, and runs back and forth as often as it takes.
    """
    need = (from_z - to_z) / (descent.slope * shortest(path, descent.chord))
    length = _length_before_tabs(path)
    turns = math.ceil(need / (2 * length) - 1e-9)
    forth = chorded(head(path, need / (2 * turns)), descent.chord)
    _insist_on_count(2 * turns * len(forth.position), descent)
    return _slope(join_paths([forth, forth.reversed()] * turns), from_z, to_z, descent.plunge)


def _length_before_tabs(path: ToolPath) -> float:
    """The length of a path up to the slope of its first tab, mm; all of it without tabs."""
    along = lengths_along(path)
    if path.floor is None:
        return float(along[-1])
    raised = np.flatnonzero(path.floor > path.floor.min() + SAME_POINT_MM)
    return float(along[raised[0] - 1]) if len(raised) and raised[0] else float(along[-1])


def _go_round(ways: _Ways, descent: _Descent) -> list[_Pass]:
    """Passes along a closed path, each down along it and then once round at its depth.

    They follow each other without a break, and the last one ends where the path was planned to start: the first one
    begins so much before that as all ramps take.
    """
    path = ways[0]
    flat, whole = shortest(path, descent.chord), float(lengths_along(path)[-1])
    steps = _steps(path.depths)
    needs = [step / (descent.slope * flat) for step in steps]
    _insist_on_count(sum(needs) / whole * len(chorded(path, descent.chord).position), descent)
    passes = []
    for k, (depth, step, need) in enumerate(zip(path.depths, steps, needs, strict=True)):
        begin, end = -sum(needs[k:]) % whole, -sum(needs[k + 1 :]) % whole
        loop = _over_tabs(begin_at(path, end), depth, descent.plunge)
        if step > SAME_POINT_MM:
            way = chorded(stretch(path, begin, need), descent.chord)
            loop = join_paths(
                [_at_depth(_slope(way, step - depth, -depth, descent.plunge), depth), loop]
            )
        passes.append(_Pass(loop, depth - float(loop.position[0, 2] - path.position[0, 2])))
    return passes


def _enter_by_helix(way: ToolPath, from_z: float, to_z: float, descent: _Descent) -> ToolPath:
    radius = way.entry_radius
    _insist_on_count(
        (from_z - to_z) / (descent.slope * radius * _helix_step(radius, descent.chord)), descent
    )
    helix = helix_entry(way, from_z, to_z, radius, math.atan(descent.slope), descent.chord)
    down = np.diff(helix.position[:, 2], prepend=np.inf) < 0
    return helix.with_columns(
        feed=np.where(down, np.minimum(helix.feed, descent.plunge), helix.feed)
    )


def _insist_on_count(motions: float, descent: _Descent) -> None:
    if motions > descent.most:
        what = (
            f"{motions:,.0f} motions come of a ramp so flat, more than {format_limit(descent.most)}"
        )
        raise JobError(
            "job", what, "operation.entry_angle", "take a steeper one, or raise limits.motions"
        )


def _slope(way: ToolPath, from_z: float, to_z: float, speed: float) -> ToolPath:
    """``way``, chords at the height of the plan, down from ``from_z`` to ``to_z`` below that, but over the tabs."""
    along = lengths_along(way)
    z = from_z + (to_z - from_z) * along / along[-1]
    z[-1] = to_z
    if way.floor is not None:
        z = np.maximum(z, way.floor - way.position[:, 2])
    return _at_heights(way.with_columns(feed=np.minimum(way.feed, speed)), way.position[:, 2] + z)


def _at_depth(path: ToolPath, depth: float) -> ToolPath:
    """``path`` as seen from ``depth`` mm below the plan."""
    return _at_heights(path, path.position[:, 2] + depth)


def _over_tabs(path: ToolPath, depth: float, speed: float) -> ToolPath:
    """A pass as seen from its depth, over the tabs; down behind them it goes no deeper than ``speed`` mm a second."""
    if path.floor is None:
        return path
    z = np.maximum(path.position[:, 2], path.floor + depth)
    if (z == path.position[:, 2]).all():
        return path
    held = _at_heights(path, z)
    drop, way = -np.diff(z), np.diff(lengths_along(held))
    down = drop > SAME_POINT_MM
    feed = path.feed.copy()
    feed[1:][down] = np.minimum(feed[1:][down], speed * way[down] / drop[down])
    return held.with_columns(feed=feed)


def _at_heights(path: ToolPath, z: FloatArray) -> ToolPath:
    """``path`` with its waypoints at ``z`` (N,); arcs have both ends at one height."""
    position, via = path.position.copy(), path.via.copy()
    position[:, 2] = z
    via[:, 2] = np.where(np.isnan(via[:, 0]), np.nan, z)
    return path.with_columns(position=position, via=via)


def helix_entry(
    path: ToolPath, from_z: float, to_z: float, radius: float, angle: float, chord: float
) -> ToolPath:
    """Down a helix about the first point of ``path``, once round at its foot, and to that point.

    from_z, to_z: mm, against the height of the path. radius: mm. angle: rad, against the level. chord: mm, the helix
    is chords that leave it by no more. It turns as the path would beside a wall around it: with the wall on the right,
    as a climb cut has it, counter-clockwise.
    """
    # A chord is shorter than its arc: the helix is made longer by so much, for its slope.
    step = _helix_step(radius, chord)
    sweep = (from_z - to_z) / (math.tan(angle) * radius * math.sin(step / 2) / (step / 2))
    count = math.ceil(sweep / step)
    sense = _sense(path)
    turn = sense * np.concatenate(
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
    size = len(ends)
    return replace(
        path,
        table=waypoints(ends, via, path.feed[0], axis=path.axis[0]),
        closed=False,
        floor=None if path.floor is None else frozen(np.full(size, path.floor[0])),
    )


def _helix_step(radius: float, chord: float) -> float:
    """The angle, rad, whose chord leaves a circle of ``radius`` by ``chord`` at most."""
    return min(2 * math.acos(max(0.0, 1 - chord / radius)), math.radians(30))


def _sense(path: ToolPath) -> float:
    """+1 counter-clockwise, unless what the path presses on is on its left."""
    ahead = (path.position[1] if np.isnan(path.via[1, 0]) else path.via[1]) - path.position[0]
    press = path.force_direction[1, 0]
    return -1.0 if ahead[0] * press[1] - ahead[1] * press[0] > 0 else 1.0
