"""From a tour to a program: approach, process on, the segments of the path, process off, retract, travel.

Every path becomes the same sequence, so that a reader of the program knows it after the first one. Its rules are
written for all paths at once, by column: which have such an instruction, and with what numbers. A draft puts them in
order.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import chain

import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from camgen.geometry.rotations import SURE_TURN, turns_about_z
from camgen.geometry.vectors import dots
from camgen.lower import columns as lower_rows
from camgen.lower.columns import Mask, Orientations, Places, Rows
from camgen.lower.draft import Draft
from camgen.lower.runs import Run, make_runs, plunge
from camgen.model.body import Poses, plain_motions
from camgen.model.cell import Cell
from camgen.model.errors import JobError, NoSafeProgram
from camgen.model.job import Job, ProcessTable
from camgen.model.limits import tell
from camgen.model.path import ToolPath, Tour
from camgen.model.pose import TOOL_DOWN, FloatArray, Pose, frozen, to_vec3
from camgen.model.program import (
    Body,
    Columns,
    Comment,
    Force,
    Indices,
    Instruction,
    Joints,
    MoveJ,
    MoveL,
    Origin,
    Output,
    Program,
    Wait,
    put_off_first,
    splice,
)
from camgen.model.tolerance import SAME_POINT_MM, ZONES
from camgen.motion.corners import corner_tolerance
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
    table = np.stack(orientations.table)
    begins, ends, vias = (
        table[orientations.begins],
        table[orientations.ends],
        table[orientations.vias],
    )
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
    motions = sum(len(path) * len(path.depths) for path in tour.paths)
    if motions > most:
        what = f"{motions:,} motions come of its paths and passes, more than {tell(most)}"
        remedy = "take fewer passes, build the part in several programs, or raise limits.motions"
        raise JobError("job", what, "operation.passes", remedy)


def _insist_on_height(cell: Cell, job: Job) -> None:
    """JobError for a machine whose home is lower than the height of travel.

    The way from there to the first path would lead across the part below that height.
    """
    clearance = job.process.clearance
    if isinstance(cell.home, Pose) and cell.home.origin[2] < clearance - SAME_POINT_MM:
        height = cell.home.origin[2]
        what = f"a home at z {height:g} mm is below the height of travel, {clearance:g} mm"
        raise JobError("job", what, "cell.home", "raise it, or lower process.clearance")


def lower_paths(
    tour: Tour, cell: Cell, job: Job, name: str = "part", header: tuple[str, ...] = ()
) -> Program:
    """The program that runs the paths of ``tour`` in order, from and back to the home position.

    cell: with the frames and the home of ``job``. name, header: of the program.
    Raises JobError for settings that do not go together, NoSafeProgram when there is no path.
    """
    if not tour.paths:
        raise NoSafeProgram(name, "no path to run")
    process = job.process
    home = MoveJ(cell.home, process.travel_speed)
    draft = Draft()
    draft.add(home, *turn_on(job, cell))
    run_paths(draft, tour, cell, job)
    draft.add(*([Output("spindle", 0.0)] if process.spindle > 0 else []), home)
    return finish(draft.body(), tour.paths, cell, job, name, header)


def turn_on(job: Job, cell: Cell) -> list[Instruction]:
    """The spindle on, if it turns. JobError where a mill would cut with it at rest."""
    if job.process.spindle > 0:
        return [Output("spindle", job.process.spindle), *dwell(job.process)]
    if isinstance(cell.home, Pose) and job.operation.depth and _nothing_turns(job.process):
        what = f"a cut of {job.operation.depth:g} mm with the spindle at rest"
        remedy = 'set it to the speed in rpm, or process.switch to "contact" for a laser or a plasma torch'
        raise JobError("job", what, "process.spindle", remedy)
    return []


def run_paths(draft: Draft, tour: Tour, cell: Cell, job: Job, before: int = 0) -> None:
    """The paths of ``tour``, each from above its start to above its end, behind what is in ``draft``.

    before: how many paths of the program come before them.
    """
    _insist_on_size(tour, job.limits.motions)
    _insist_on_height(cell, job)
    # A machine without joints has no axis that winds up.
    cartesian = isinstance(cell.home, Pose)
    winds = job.tool.orient == "follow" and not cartesian
    runs = make_runs(tour, job, winds, before)
    table = _table(
        runs, job, winds, cell, turns_of(runs, tour, before) if isinstance(tour, ArmTour) else None
    )
    if isinstance(tour, ArmTour):
        own = {
            k: run.number - before
            for k, run in enumerate(runs)
            if not (run.linked or run.low or run.down)
        }
        ways = {
            k: [*_go(tour.ways[n], tour.paces[n], n + before)]
            for k, n in own.items()
            if len(tour.ways[n])
        }
        table = replace(table, ways=ways)
    draft.open(len(table.run))
    _enter(draft, table, job)
    _work(draft, table, job)
    _leave(draft, table, job)
    if isinstance(tour, ArmTour):
        draft.add(*_go(tour.back, tour.back_paces, before + len(tour.paths) - 1))


def _go(
    ways: Sequence[FloatArray], paces: Sequence[tuple[float, float]], path: int
) -> Iterator[MoveJ]:
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
    body: Sequence[Instruction],
    paths: Sequence[ToolPath],
    cell: Cell,
    job: Job,
    name: str,
    header: tuple[str, ...],
) -> Program:
    """The program of ``body``: all that it uses is off at first, and turns on the spot have their speed."""
    body = turn_slowly(put_off_first(body), math.radians(job.process.turn))
    return Program(name, cell.base_from_work, cell.flange_from_tool, body, header, origins(paths))


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
    """What the instructions are made of, by column: of N rows (segment i ends in row i) and of R runs.

    run: (N,) to which a row belongs. lifted: (N,) rows after the first pressed one of their run that do not press,
    which are run above the part, ``over`` (R,) mm higher. number: (R,) of their paths. linked, down: (R,) see ``Run``.
    above_start, above_end: (R, 3) where it travels to the run and from it. near: (R, 3) where the feed begins. unwound:
    by run, the orientations to go through before it, where the one before it ended, before it travels. ways: by run,
    the motions of the joints that lead to above its start, where an arm has chosen some; else a straight line does.
    rapid: the kind of motion of travel: robots keep to the line, machines whose axes are the coordinates have one.
    """

    runs: list[Run]
    rows: Rows
    blend: FloatArray
    orientations: Orientations
    run: Indices
    lifted: Mask
    over: FloatArray
    number: Indices
    linked: Mask
    down: Mask
    above_start: FloatArray
    near: FloatArray
    above_end: FloatArray
    unwound: dict[int, list[FloatArray]]
    ways: dict[int, list[MoveJ]]
    rapid: type[MoveJ | MoveL]

    def poses(self, origin: FloatArray, rotation: Places) -> Poses:
        """K poses of the tool. origin: (K, 3). rotation: (K,) places in the table of the orientations."""
        return Poses(origin, rotation, self.orientations.table)


def _table(runs: list[Run], job: Job, winds: bool, cell: Cell, turns: FloatArray | None) -> _Table:
    follow = job.tool.orient == "follow"
    depths = [run.depth for run in runs]
    rows = lower_rows.gather([run.path for run in runs], depths, follow)
    if follow:
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
    run = np.repeat(np.arange(len(runs)), rows.last - rows.first + 1)
    tolerance = np.array([corner_tolerance(job, run.path.operation) for run in runs])
    blend = lower_rows.blends(rows, tolerance[run], cell.pace)
    blend[np.flatnonzero(orientations.turns) - 1] = 0.0
    above_start, near, above_end = _heights(rows, runs, job.process)
    unwound = unwind(rows, orientations) if winds else []
    return _Table(
        runs=runs,
        rows=rows,
        blend=blend,
        orientations=orientations,
        run=run,
        lifted=_lifted(rows, run),
        over=np.array(depths) + min(job.process.retract, job.process.clearance),
        number=np.array([run.number for run in runs]),
        linked=np.array([run.linked for run in runs]),
        down=np.array([run.down for run in runs]),
        above_start=above_start,
        near=near,
        above_end=above_end,
        unwound={k: turned for k, turned in enumerate(unwound) if turned},
        ways={},
        rapid=MoveJ if isinstance(cell.home, Pose) else MoveL,
    )


def _heights(
    rows: Rows, runs: list[Run], process: ProcessTable
) -> tuple[FloatArray, FloatArray, FloatArray]:
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
        raise JobError(
            "job", what, "process.clearance", "raise process.clearance or lower process.approach"
        )
    above_end = end + up_end * _lift(end, up_end, process.clearance)[:, None]
    above_start = start + up_start * room[:, None]
    passes = np.flatnonzero([run.low for run in runs])
    above_start[passes] = above_end[passes - 1] = near[passes]
    return above_start, near, above_end


def _lifted(rows: Rows, run: Indices) -> Mask:
    """(N,): the rows without force after the first pressed one of their run."""
    pressed = np.cumsum(rows.force > 0)
    return np.asarray((rows.force <= 0) & (pressed > pressed[rows.first][run]))


def _lift(point: FloatArray, up: FloatArray, clearance: float) -> FloatArray:
    """The way (R,) from each point along ``up`` to the height of travel."""
    straight = up[:, 2] > 1 - 1e-12
    return np.where(straight, clearance - point[:, 2], clearance)


def _enter(draft: Draft, table: _Table, job: Job) -> None:
    """From the end of each run to the start of the next; a tool that turns is switched on above it."""
    rows, process, first = table.rows, job.process, table.rows.first
    contact, speed = rows.position[first], process.travel_speed
    apart = ~_same(rows.position[np.roll(rows.last, 1)], contact)
    free = ~(table.linked | table.down)
    draft.put(first, [Comment(f"path {run.path.id} layer {run.path.layer}") for run in table.runs])
    _travel(draft, table, MoveL, first, table.down & apart, contact, speed)
    _come(draft, table, job, free)
    _travel(
        draft,
        table,
        table.rapid,
        first,
        free & ~_same(table.above_start, table.near),
        table.near,
        speed,
    )
    if in_air(job):
        _put_each(draft, first[free], switch_on(process))
    # A path that starts on an outer corner is faster there than the feed; the plunge before it must not be. A drill
    # does nothing but go down.
    slow = plunge(process)
    most = [process.feed if run.path.operation == "drill" else slow for run in table.runs]
    # A ramp goes on from where the pass before ended.
    sinks = np.where(table.linked, apart, free & ~_same(table.near, contact))
    _travel(draft, table, MoveL, first, sinks, contact, np.minimum(rows.feed[first], most))


def _come(draft: Draft, table: _Table, job: Job, free: Mask) -> None:
    """From above the end of the run before, or from home, to above the start of each run that is ``free``."""
    rows, process, ends = table.rows, job.process, table.orientations.ends
    above, near, contact = table.above_start, table.near, rows.position[rows.first]
    straight = free & ~_among(table.ways, len(free))
    left = np.roll(table.above_end, 1, axis=0)
    turned = {run: backs for run, backs in table.unwound.items() if straight[run]}
    if straight[0]:
        # From home to the first orientation at once.
        left[0] = above[0]
        turned.setdefault(0, [table.orientations.table[ends[rows.first[0]]]])
    come: dict[int, list[MoveJ] | list[MoveJ | MoveL]] = {**table.ways}
    for run, backs in turned.items():
        kinds = [table.rapid if run or k else MoveJ for k in range(len(backs))]
        poses = [Pose(back, to_vec3(left[run])) for back in backs]
        number = int(table.number[run])
        come[run] = [
            kind(pose, process.travel_speed, path=number)
            for kind, pose in zip(kinds, poses, strict=True)
        ]
    _put_several(draft, rows.first, come)
    at_once = _same(above, near)
    way = _distances(left, above), _distances(above, np.where(at_once[:, None], contact, near))
    zone = np.where(at_once & in_air(job), 0.0, _zone(process, *way))
    _travel(
        draft,
        table,
        table.rapid,
        rows.first,
        straight & ~_same(left, above),
        above,
        process.travel_speed,
        zone,
    )


def _leave(draft: Draft, table: _Table, job: Job) -> None:
    """Up to where it travels, unless the next run starts where one ended; there a tool that turns is off."""
    process, up, last = job.process, table.above_end, table.rows.last
    leaving = ~np.append((table.linked | table.down)[1:], False)
    here = _points(table, last, table.lifted[last], table.rows.position)
    off = in_air(job) and bool(signal(process))
    zone = np.zeros(len(last))
    if not off:
        on = ~np.append(
            (_among(table.unwound, len(last)) | _among(table.ways, len(last)))[1:], True
        )
        way = _distances(here, up), _distances(up, np.roll(table.above_start, -1, axis=0))
        zone = np.where(on, _zone(process, *way), 0.0)
    _travel(
        draft, table, table.rapid, last, leaving & ~_same(here, up), up, process.travel_speed, zone
    )
    if off:
        _put_each(draft, last[leaving], [Output(signal(process), 0.0)])


def _travel(
    draft: Draft,
    table: _Table,
    kind: type[MoveJ | MoveL],
    rows: Indices,
    where: Mask,
    end: FloatArray,
    speed: FloatArray | float,
    blend: FloatArray | float = 0.0,
) -> None:
    """Motions of the runs ``where`` (R,), to ``end`` (R, 3), the tool as in one of their ``rows`` (R,)."""
    runs = np.flatnonzero(where)
    speed, blend = (np.broadcast_to(column, len(where))[runs] for column in (speed, blend))
    at = rows[runs]
    draft.put(
        at,
        _moves(
            table, at, table.poses(end[runs], table.orientations.ends[at]), speed, blend, kind=kind
        ),
    )


def _moves(
    table: _Table,
    rows: Indices,
    target: Poses,
    speed: FloatArray,
    blend: FloatArray | float = 0.0,
    work: bool = False,
    via: Poses | None = None,
    kind: type[MoveJ | MoveL] = MoveL,
) -> Body:
    """Plain motions (K,) of the runs that ``rows`` (K,) belong to, see ``plain_motions``."""
    return plain_motions(
        kind,
        target,
        speed=speed,
        blend=blend,
        path=table.number[table.run[rows]],
        work=work,
        via=via,
    )


def _put_each(draft: Draft, rows: Indices, items: Iterable[Instruction]) -> None:
    """All of ``items`` at each of ``rows``."""
    for item in items:
        draft.put(rows, [item] * len(rows))


def _put_several(draft: Draft, rows: Indices, items: Mapping[int, Sequence[Instruction]]) -> None:
    """At the rows (R,) of some runs, those that are keys of ``items``, each its own."""
    runs = np.array(list(items), np.intp)
    draft.put(
        np.repeat(rows[runs], list(map(len, items.values()))),
        [*chain.from_iterable(items.values())],
    )


def _among(runs: Iterable[int], count: int) -> Mask:
    mask = np.zeros(count, np.bool_)
    mask[list(runs)] = True
    return mask


def _zone(process: ProcessTable, *neighbours: FloatArray) -> FloatArray:
    """The blends (R,) at corners of travel: in the upper half of the clearance and of their two neighbours (R,)."""
    room = (
        np.minimum.reduce([np.full_like(neighbours[0], process.clearance), *neighbours]) / 2 + 1e-9
    )
    return np.asarray(np.select([room >= zone for zone in ZONES], ZONES, 0.0))


def _distances(a: FloatArray, b: FloatArray) -> FloatArray:
    return np.asarray(np.sqrt(dots(a - b, a - b)))


def _same(a: FloatArray, b: FloatArray) -> Mask:
    return np.asarray(_distances(a, b) < SAME_POINT_MM)


def dwell(process: ProcessTable) -> list[Instruction]:
    """The wait after something is switched on."""
    return [Wait(process.dwell)] if process.dwell > 0 else []


def signal(process: ProcessTable) -> str:
    """The output that is on along a path, empty: none. JobError."""
    if process.signal == "auto":
        return "" if process.spindle > 0 else "process"
    if process.signal == "spindle":
        raise JobError(
            "job", '"spindle" is the spindle', "process.signal", "set process.spindle to its rpm"
        )
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


def _work(draft: Draft, table: _Table, job: Job) -> None:
    """The segments of each run between force on, process on and process off, force off."""
    rows, first, last = table.rows, table.rows.first, table.rows.last
    # Points that are only touched have no segment, and nothing presses there.
    second = first[last > first] + 1
    pressed = second[rows.force[second] > 0]
    draft.put(pressed - 1, _forces(rows, pressed))
    if not in_air(job):
        _put_each(draft, first, switch_on(job.process))
    _segments(draft, table, second, plunge(job.process))
    if signal(job.process) and not in_air(job):
        _put_each(draft, last, [Output(signal(job.process), 0.0)])
    _put_each(draft, last[(last > first) & (rows.force[last] > 0)], [Force(0.0)])


def _segments(draft: Draft, table: _Table, second: Indices, slow: float) -> None:
    """One motion a segment; force is switched where it begins or ends, the tool turned where its orientation jumps.

    What comes after pressing is run above the part, so that the tool leaves the surface for good: it goes up there, and
    down again at ``slow`` mm/s. second: the rows of the first segments, before which their force is on already.
    """
    rows, turned, lifted = table.rows, table.orientations, table.lifted
    feed, wanted = rows.feed, rows.force > 0
    pressing = np.roll(wanted, 1)
    pressing[second] = wanted[second]
    segment = np.ones(len(feed), np.bool_)
    segment[rows.first] = False
    up = np.flatnonzero(segment & pressing & ~wanted)
    _put_each(draft, up, [Force(0.0)])
    down = np.flatnonzero(segment & wanted & np.roll(lifted, 1))
    for at, speed in ((up, feed[up]), (down, np.minimum(slow, feed[down]))):
        start = _points(table, at - 1, lifted[at], rows.position)
        draft.put(at, _moves(table, at, table.poses(start, turned.ends[at - 1]), speed))
    at = np.flatnonzero(segment & turned.turns)
    start = _points(table, at - 1, lifted[at], rows.position)
    turns = _moves(table, at, table.poses(start, turned.begins[at]), feed[at], work=True)
    draft.put(
        at,
        _press(turns, np.where(pressing[at], rows.force[at], 0.0), rows.force_direction[:, 0], at),
    )
    begin = np.flatnonzero(segment & wanted & ~pressing)
    draft.put(begin, _forces(rows, begin))
    at = np.flatnonzero(segment)
    end, via = (
        table.poses(_points(table, at, lifted[at], points), places[at])
        for points, places in ((rows.position, turned.ends), (rows.via, turned.vias))
    )
    along = _moves(table, at, end, feed[at], table.blend[at], True, via)
    draft.put(at, _press(along, rows.force[at], rows.force_direction[:, 1], at))


def _points(table: _Table, at: Indices, lifted: Mask, points: FloatArray) -> FloatArray:
    """``points`` (N, 3) of the rows ``at`` (K,), where ``lifted`` (K,) along the axis to where a tool goes that ends
    pressing.
    """
    chosen = points[at]
    high = at[lifted]
    chosen[lifted] -= table.rows.axis[high] * table.over[table.run[high]][:, None]
    return chosen


def _forces(rows: Rows, at: Indices) -> list[Instruction]:
    """Force on for the segments that end in the rows ``at``."""
    directions = map(to_vec3, rows.force_direction[at, 0]) if len(at) else ()
    return list(map(Force, rows.force[at].tolist(), directions))


def _press(motions: Body, force: FloatArray, directions: FloatArray, at: Indices) -> Body:
    """The K motions, pressing with ``force`` (K,) N, of which columns do not tell, along those of ``directions`` (N, 3)
    ``at`` their rows.
    """
    pressed = force > 0
    if not pressed.any():
        return motions
    told = zip(
        motions.take(np.flatnonzero(pressed)),
        force[pressed].tolist(),
        map(to_vec3, directions[at[pressed]]),
        strict=True,
    )
    objects = [replace(move, force=newtons, force_direction=press) for move, newtons, press in told]
    return Body(replace(motions.packed, kept=pressed), motions.rotations, objects)
