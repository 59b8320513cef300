"""From a tour to a program: approach, process on, the segments of the path, process off, retract, travel.

Every path becomes the same sequence, so that a reader of the program knows it after the first one. Columns are
computed once over the rows of all paths (numpy), the instructions are then written in one loop over plain lists.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from camgen.geometry.rotations import SURE_TURN, turns_about_z
from camgen.lower import columns as lower_rows
from camgen.lower.columns import Mask, Orientations, Rows
from camgen.lower.corners import ZONES, corner_tolerance
from camgen.lower.runs import Run, make_runs, plunge
from camgen.model.cell import Cell, Dynamics
from camgen.model.errors import JobError, NoSafeProgram
from camgen.model.job import Job, ProcessTable
from camgen.model.limits import tell
from camgen.model.path import ToolPath, Tour
from camgen.model.pose import TOOL_DOWN, FloatArray, Pose, Vec3, frozen
from camgen.model.program import (
    Columns,
    Comment,
    Force,
    Instruction,
    Joints,
    MoveC,
    MoveJ,
    MoveL,
    Origin,
    Output,
    Packing,
    Program,
    Wait,
    put_off_first,
    splice,
)
from camgen.model.tolerance import SAME_POINT_MM
from camgen.order.tours import ArmTour

# How far a tool that turns with the contour winds up, and where it is turned back: in the air, between two paths.

#: The tool may be turned by so much from how it stands at home, to either side, rad.
MOST = 2 * math.pi
#: A turn between two orientations that is larger has no sense of its own for sure, rad; steps are no larger than
#: ``SURE_TURN``.
_SURE = math.radians(150.0)


def twists(a: FloatArray, b: FloatArray) -> FloatArray:
    """The angles (N,) by which the tool turns about its own z from rotations a to b (N, 3, 3), rad in -pi..pi."""
    return turns_about_z(np.swapaxes(a, -1, -2) @ b)


def unwind(rows: Rows, orientations: Orientations) -> list[list[FloatArray]]:
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
    count = math.ceil(abs(turn) / SURE_TURN - 1e-9)
    angles = [turn * k / count for k in range(1, count)]
    return [*(frozen(a @ _about_z(angle)) for angle in angles), frozen(b)]


def _about_z(angle: float) -> FloatArray:
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def _insist_on_size(tour: Tour, most: float) -> None:
    """JobError for more motions than any controller takes, before they are made."""
    motions = sum(len(path.position) * len(path.depths) for path in tour.paths)
    if motions > most:
        what = f"{motions:,} motions come of its paths and passes, more than {tell(most)}"
        remedy = "take fewer passes, build the part in several programs, or raise limits.motions"
        raise JobError("job", what, "operation.passes", remedy)


def lower_paths(tour: Tour, cell: Cell, job: Job, name: str = "part", header: tuple[str, ...] = ()) -> Program:
    """The program that runs the paths of ``tour`` in order, from and back to the home position.

    cell: with the frames and the home of ``job``. name, header: of the program.
    Raises JobError for settings that do not go together, NoSafeProgram when there is no path.
    """
    if not tour.paths:
        raise NoSafeProgram(name, "no path to run")
    process = job.process
    body = Packing([MoveJ(cell.home, process.travel_speed), *turn_on(job, cell)])
    body.extend(run_paths(tour, cell, job))
    if process.spindle > 0:
        body.append(Output("spindle", 0.0))
    body.append(MoveJ(cell.home, process.travel_speed))
    return finish(body.body(), tour.paths, cell, job, name, header)


def turn_on(job: Job, cell: Cell) -> list[Instruction]:
    """The spindle on, if it turns. JobError where a mill would cut with it at rest."""
    if job.process.spindle > 0:
        return [Output("spindle", job.process.spindle), *dwell(job.process)]
    if isinstance(cell.home, Pose) and job.operation.depth and _nothing_turns(job.process):
        what = f"a cut of {job.operation.depth:g} mm with the spindle at rest"
        remedy = 'set it to the speed in rpm, or process.switch to "contact" for a laser or a plasma torch'
        raise JobError("job", what, "process.spindle", remedy)
    return []


def run_paths(tour: Tour, cell: Cell, job: Job, before: int = 0) -> Iterator[Instruction]:
    """The paths of ``tour``, each from above its start to above its end. before: how many paths of the program come
    before them.
    """
    _insist_on_size(tour, job.limits.motions)
    # A machine without joints has no axis that winds up.
    winds = job.tool.orient == "follow" and isinstance(cell.home, Joints)
    runs = make_runs(tour, job, winds, before)
    table = _table(runs, job, winds, cell.pace, turns_of(runs, tour, before) if isinstance(tour, ArmTour) else None)
    if isinstance(tour, ArmTour):
        own = [None if run.linked or run.low else run.number - before for run in runs]
        table = replace(
            table, ways=[None if k is None else list(_go(tour.ways[k], tour.paces[k], k + before)) for k in own]
        )
    for run in range(len(runs)):
        yield from _enter(table, run, job, run == 0, isinstance(cell.home, Pose))
        yield from _work(table, run, job)
        yield from _leave(table, run, job, isinstance(cell.home, Pose))
    if isinstance(tour, ArmTour):
        last = before + len(tour.paths) - 1
        yield from _go(tour.back, tour.back_paces, last)


def _go(ways: Sequence[FloatArray], paces: Sequence[tuple[float, float]], path: int) -> Iterator[MoveJ]:
    """Motions to joint values, each with its speed and share."""
    for values, (speed, share) in zip(ways, paces, strict=True):
        yield MoveJ(joints_of(values), speed, path=path, share=share)


def turns_of(runs: Sequence[Run], tour: ArmTour, before: int) -> FloatArray:
    """The turns of the tool at the rows of all runs, one after the other. before: as for ``run_paths``."""
    turns = []
    for run in runs:
        own, path = tour.turns[run.number - before], tour.paths[run.number - before]
        count = len(run.path.position)
        if (own == own[0]).all():
            turns.append(np.full(count, own[0]))
            continue
        # One that is turned on its way is entered straight down: its passes have its waypoints.
        back = not np.array_equal(run.path.position[:, :2], path.position[:, :2])
        turns.append(own[::-1] if back else own)
    return np.concatenate(turns)


def joints_of(values: FloatArray) -> Joints:
    """Joint values (J,) as a target."""
    return Joints(tuple(values.tolist()))


def _nothing_turns(process: ProcessTable) -> bool:
    """Whether a mill without a spindle speed would cut with a cutter at rest: no signal is said to turn it either."""
    return process.switch == "auto" or (process.switch == "air" and not signal(process))


def finish(
    body: Sequence[Instruction], paths: Sequence[ToolPath], cell: Cell, job: Job, name: str, header: tuple[str, ...]
) -> Program:
    """The program of ``body``: all that it uses is off at first, and turns on the spot have their speed."""
    turned = turn_slowly(put_off_first(body), math.radians(job.process.turn))
    return Program(name, cell.base_from_work, cell.flange_from_tool, turned, header, origins(paths))


def turn_slowly(body: Sequence[Instruction], speed: float) -> Sequence[Instruction]:
    """``body`` with the speed, rad/s, in all motions that turn the tool where it stays in its place and say none."""
    columns = Columns(body)
    changed = {
        int(columns.at[k]): (replace(columns.moves[k], turn=speed),)
        for k in np.flatnonzero(columns.turned & (columns.turn == 0))
    }
    return splice(body, changed) if changed else body


def origins(paths: Sequence[ToolPath]) -> tuple[Origin, ...]:
    """What the motions of a program over ``paths`` are there for."""
    return tuple(Origin(path.id, path.layer, path.contours, path.operation) for path in paths)


class _Table(Struct, frozen=True, eq=False):
    """What the instructions are made of, as plain lists: by row (segment i ends in row i), then by run.

    above_start, above_end: where it travels to the run and from it. near: where the feed begins. unwound: the
    orientations to go through before a run, where the one before it ended, before it travels. lifted: rows after the
    first pressed one that do not press, which are run above the part: ``over`` and ``over_via`` are where. ways: the
    motions of the joints that lead to above the start of a run; none: a straight line does, None: no arm has chosen.
    """

    runs: list[Run]
    position: list[Vec3]
    via: list[Vec3]
    over: list[Vec3]
    over_via: list[Vec3]
    arc: list[bool]
    feed: list[float]
    force: list[float]
    force_direction: list[tuple[Vec3, Vec3]]
    blend: list[float]
    orientations: Orientations
    turns: list[bool]
    first: list[int]
    last: list[int]
    above_start: list[Vec3]
    near: list[Vec3]
    above_end: list[Vec3]
    unwound: list[list[FloatArray]]
    lifted: list[bool]
    ways: list[list[MoveJ] | None]


def _table(runs: list[Run], job: Job, winds: bool, pace: Dynamics, turns: FloatArray | None) -> _Table:
    rows = lower_rows.gather([run.path for run in runs], [run.depth for run in runs])
    if job.tool.orient == "follow":
        for row in lower_rows.find_unfollowed(rows)[:1].tolist():
            path = runs[int(np.searchsorted(rows.last, row))].path
            what = f'"follow" needs a followed contour, path {path.id} has no surface beside it'
            raise JobError("job", what, "tool.orient", 'set tool.orient to "fixed"')
        rows = lower_rows.halve(rows)
        orientations = lower_rows.orient_along(rows)
    elif turns is not None:
        orientations = lower_rows.orient_turned(rows, turns)
    else:
        orientations = lower_rows.orient_fixed(rows)
    tolerance = np.array([corner_tolerance(job, run.path.operation) for run in runs])
    blend = lower_rows.blends(rows, np.repeat(tolerance, rows.last - rows.first + 1), pace)
    blend[np.flatnonzero(orientations.turns) - 1] = 0.0
    above_start, near, above_end = _heights(rows, runs, job.process)
    lifted = _lifted(rows)
    press = (_points(rows.force_direction[:, k]) for k in (0, 1) if (rows.force > 0).any())
    return _Table(
        runs=runs,
        position=_points(rows.position),
        via=_points(rows.via),
        over=_points(_over(rows, runs, job.process, rows.position)) if lifted.any() else [],
        over_via=_points(_over(rows, runs, job.process, rows.via)) if lifted.any() else [],
        arc=rows.arc.tolist(),
        feed=rows.feed.tolist(),
        force=rows.force.tolist(),
        force_direction=list(zip(*press, strict=True)),
        blend=blend.tolist(),
        orientations=orientations,
        turns=orientations.turns.tolist(),
        first=rows.first.tolist(),
        last=rows.last.tolist(),
        above_start=_points(above_start),
        near=_points(near),
        above_end=_points(above_end),
        unwound=unwind(rows, orientations) if winds else [[] for _ in runs],
        lifted=lifted.tolist(),
        ways=[None for _ in runs],
    )


def _points(column: FloatArray) -> list[Vec3]:
    return list(zip(*column.T.tolist(), strict=True))


def _heights(rows: Rows, runs: list[Run], process: ProcessTable) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Above the start, where the feed begins, above the end: (R, 3) each.

    All of them are measured from where the path was planned, not from its depth: the material of the first pass is
    still there. With the tool straight down the travel height is z = clearance, else it is clearance along the axis.
    """
    below = np.zeros((2, len(runs), 3))
    below[:, :, 2] = [[run.begin for run in runs], [run.depth for run in runs]]
    start, end = rows.position[rows.first] + below[0], rows.position[rows.last] + below[1]
    up_start, up_end = -rows.axis[rows.first], -rows.axis[rows.last]
    near = start + up_start * process.approach
    room = _lift(start, up_start, process.clearance)
    low = np.flatnonzero(room < process.approach - SAME_POINT_MM)
    low = np.append(low, np.flatnonzero(_lift(end, up_end, process.clearance) < -SAME_POINT_MM))
    if len(low):
        what = f"{process.clearance:g} mm is below where the tool approaches path {runs[int(low[0])].path.id}"
        raise JobError("job", what, "process.clearance", "raise process.clearance or lower process.approach")
    above_end = end + up_end * _lift(end, up_end, process.clearance)[:, None]
    above_start = start + up_start * room[:, None]
    passes = np.flatnonzero([run.low for run in runs])
    above_start[passes] = above_end[passes - 1] = near[passes]
    return above_start, near, above_end


def _lifted(rows: Rows) -> Mask:
    """(N,): the rows without force after the first pressed one of their run."""
    pressed = np.cumsum(rows.force > 0)
    before = np.repeat(pressed[rows.first], rows.last - rows.first + 1)
    return np.asarray((rows.force <= 0) & (pressed > before))


def _over(rows: Rows, runs: list[Run], process: ProcessTable, points: FloatArray) -> FloatArray:
    """``points`` (N, 3) of the rows, lifted along the axis to where a tool goes that ends pressing."""
    depth = np.repeat([run.depth for run in runs], rows.last - rows.first + 1)
    return points - rows.axis * (depth + min(process.retract, process.clearance))[:, None]


def _lift(point: FloatArray, up: FloatArray, clearance: float) -> FloatArray:
    """The way (R,) from each point along ``up`` to the height of travel."""
    straight = up[:, 2] > 1 - 1e-12
    return np.where(straight, clearance - point[:, 2], clearance)


def _enter(table: _Table, run: int, job: Job, from_home: bool, cartesian: bool) -> Iterator[Instruction]:
    """From the end of the run before to the start of this one; a tool that turns is switched on above it."""
    one, row, process = table.runs[run], table.first[run], job.process
    rotation, contact = table.orientations.ends[row], table.position[row]
    # A path that starts on an outer corner is faster there than the feed; the plunge before it must not be. A drill
    # does nothing but go down.
    feed = min(table.feed[row], process.feed if one.path.operation == "drill" else plunge(process))
    yield Comment(f"path {one.path.id} layer {one.path.layer}")
    if one.down:
        if not _same(table.position[table.last[run - 1]], contact):
            yield MoveL(Pose(rotation, contact), process.travel_speed, path=one.number)
        return
    if not one.linked:
        above, near = table.above_start[run], table.near[run]
        yield from _come(table, run, job, from_home, cartesian)
        if not _same(above, near):
            yield _rapid(cartesian, Pose(rotation, near), process.travel_speed, 0.0, one.number)
        if in_air(job):
            yield from switch_on(process)
        if _same(near, contact):
            return
    elif _same(table.position[table.last[run - 1]], contact):
        # A ramp goes on from where the pass before ended.
        return
    yield MoveL(Pose(rotation, contact), feed, path=one.number)


def _come(table: _Table, run: int, job: Job, from_home: bool, cartesian: bool) -> Iterator[Instruction]:
    """From above the end of the run before, or from home, to above the start of this one."""
    one, row, process = table.runs[run], table.first[run], job.process
    rotation, contact = table.orientations.ends[row], table.position[row]
    above, near, turned = table.above_start[run], table.near[run], table.unwound[run]
    ways = table.ways[run]
    if ways:
        yield from ways
    elif from_home:
        yield MoveJ(Pose(turned[0] if turned else rotation, above), process.travel_speed, path=one.number)
        yield from (_rapid(cartesian, Pose(back, above), process.travel_speed, 0.0, one.number) for back in turned[1:])
    else:
        left = table.above_end[run - 1]
        yield from (_rapid(cartesian, Pose(back, left), process.travel_speed, 0.0, one.number) for back in turned)
        if not _same(left, above):
            way = math.dist(left, above), math.dist(above, contact if _same(above, near) else near)
            zone = 0.0 if in_air(job) and _same(above, near) else _zone(process, *way)
            yield _rapid(cartesian, Pose(rotation, above), process.travel_speed, zone, one.number)


def _leave(table: _Table, run: int, job: Job, cartesian: bool) -> Iterator[Instruction]:
    """Up to where it travels, unless the next run starts where this one ended; there a tool that turns is off."""
    following, process = run + 1, job.process
    last = following == len(table.runs)
    if not last and (table.runs[following].linked or table.runs[following].down):
        return
    row = table.last[run]
    up, target = table.above_end[run], Pose(table.orientations.ends[row], table.above_end[run])
    here = table.over[row] if table.lifted[row] else table.position[row]
    off = in_air(job) and bool(signal(process))
    zone = 0.0
    if not last and not table.unwound[following] and not table.ways[following] and not off:
        zone = _zone(process, math.dist(here, up), math.dist(up, table.above_start[following]))
    if not _same(here, up):
        yield _rapid(cartesian, target, process.travel_speed, zone, table.runs[run].number)
    if off:
        yield Output(signal(process), 0.0)


def _rapid(cartesian: bool, target: Pose, speed: float, blend: float, path: int) -> MoveJ | MoveL:
    """Travel: robots keep to the line, machines whose axes are the coordinates have a rapid motion for it."""
    kind = MoveJ if cartesian else MoveL
    return kind(target, speed, blend, path=path)


def _zone(process: ProcessTable, *neighbours: float) -> float:
    """The blend at a corner of travel: it stays in the upper half of the clearance and of its two neighbours."""
    room = min(process.clearance, *neighbours) / 2 + 1e-9
    return next((zone for zone in ZONES if zone <= room), 0.0)


def _same(a: Vec3, b: Vec3) -> bool:
    return math.dist(a, b) < SAME_POINT_MM


def dwell(process: ProcessTable) -> list[Instruction]:
    """The wait after something is switched on."""
    return [Wait(process.dwell)] if process.dwell > 0 else []


def signal(process: ProcessTable) -> str:
    """The output that is on along a path, empty: none. JobError."""
    if process.signal == "auto":
        return "" if process.spindle > 0 else "process"
    if process.signal == "spindle":
        raise JobError("job", '"spindle" is the spindle', "process.signal", "set process.spindle to its rpm")
    return process.signal


def in_air(job: Job) -> bool:
    """Whether the signal is switched above the part: a tool that turns must do so before it enters."""
    where = job.process.switch
    return where == "air" or (where == "auto" and bool(job.operation.depth or job.process.force))


def switch_on(process: ProcessTable) -> Iterator[Instruction]:
    """The signal on, if there is one, and the wait after it."""
    name = signal(process)
    if name:
        yield Output(name, 1.0)
        yield from dwell(process)


def _work(table: _Table, run: int, job: Job) -> Iterator[Instruction]:
    """The segments of a run between force on, process on and process off, force off."""
    first, last = table.first[run], table.last[run]
    pressing = last > first and table.force[first + 1] > 0
    if pressing:
        yield Force(table.force[first + 1], table.force_direction[first + 1][0])
    if not in_air(job):
        yield from switch_on(job.process)
    yield from _segments(table, range(first + 1, last + 1), pressing, table.runs[run].number, plunge(job.process))
    if signal(job.process) and not in_air(job):
        yield Output(signal(job.process), 0.0)
    if last > first and table.force[last] > 0:
        yield Force(0.0)


def _segments(table: _Table, rows: range, pressing: bool, path: int, slow: float) -> Iterator[Instruction]:
    """One motion a segment; force is switched where it begins or ends, the tool turned where its orientation jumps.

    What comes after pressing is run above the part, so that the tool leaves the surface for good: it goes up there, and
    down again at ``slow`` mm/s.
    """
    feed, blend, forces = table.feed, table.blend, table.force
    ends, vias = table.orientations.ends, table.orientations.vias
    for row in rows:
        position, via_of = (table.over, table.over_via) if table.lifted[row] else (table.position, table.via)
        force = forces[row]
        end = (0.0, 0.0, 0.0)
        wanted = force > 0
        if wanted or pressing:
            begin, end = table.force_direction[row]
        if pressing and not wanted:
            yield Force(0.0)
            end = (0.0, 0.0, 0.0)
            yield MoveL(Pose(ends[row - 1], position[row - 1]), feed[row], path=path)
        elif wanted and table.lifted[row - 1]:
            yield MoveL(Pose(ends[row - 1], position[row - 1]), min(slow, feed[row]), path=path)
        if table.turns[row]:
            held, press = (force, begin) if wanted and pressing else (0.0, (0.0, 0.0, 0.0))
            turned = Pose(table.orientations.begins[row], position[row - 1])
            yield MoveL(turned, feed[row], 0.0, held, press, None, None, path, True)
        if wanted and not pressing:
            yield Force(force, begin)
        pressing = wanted
        target = Pose(ends[row], position[row])
        if table.arc[row]:
            via = Pose(vias[row], via_of[row])
            yield MoveC(via, target, feed[row], blend[row], force, end, None, None, path, True)
        else:
            yield MoveL(target, feed[row], blend[row], force, end, None, None, path, True)
