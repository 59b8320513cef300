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
from camgen.model.body import Targets, plain_motions
from camgen.model.cell import Cell
from camgen.model.errors import JobError, NoSafeProgram
from camgen.model.job import Job, ProcessTable
from camgen.model.limits import format_limit
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
    splice,
    switch_off_first,
)
from camgen.model.tolerance import SAME_POINT_MM, ZONES
from camgen.motion.corners import compute_corner_tolerance
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
        what = f"{motions:,} motions come of its paths and passes, more than {format_limit(most)}"
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


class TourEnds(Struct, frozen=True, eq=False):
    """How the tool comes to the paths of a tour, and how it leaves them.

    link: (K, 3) mm, points on which it comes at working height; None: it comes from above.
    stays: whether it stays at working height after the last path.
    """

    link: FloatArray | None = None
    stays: bool = False


def run_paths(
    draft: Draft,
    tour: Tour,
    cell: Cell,
    job: Job,
    before: int = 0,
    ends: TourEnds | None = None,
) -> None:
    """Adds the paths of ``tour`` to ``draft``, each from above its start to above its end.

    before: number of paths of the program that come before them.
    ends: way to the first path and from the last one; None: from above and upwards.
    """
    ends = ends or TourEnds()
    _insist_on_size(tour, job.limits.motions)
    _insist_on_height(cell, job)
    if ends.link is not None:
        tour = replace(tour, down=tour.down | {0})
    runs = make_runs(tour, job, _winds(job, cell), before)
    columns = _open_draft(draft, runs, tour, cell, job, before)
    columns.enter(ends.link)
    columns.work()
    columns.leave(ends.stays)
    if isinstance(tour, ArmTour):
        draft.add(*_go(tour.back, tour.back_speeds, before + len(tour.paths) - 1))


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
        own, path = tour.rolls[run.number - before], tour.paths[run.number - before]
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
    body = turn_slowly(switch_off_first(body), math.radians(job.process.turn))
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


class _RunDraft(Struct, frozen=True, eq=False):
    """The instructions of R runs in the making, by column: N rows (segment i ends in row i).

    draft: the body that they are put into, which has a place for each row.
    job: the speeds and heights of the runs.
    runs: list of R runs.
    rows: positions, axes, forces and feeds, one run after the other.
    blend: (N,) mm.
    orientations: orientations of the tool at the rows.
    run: (N,) run to which a row belongs.
    lifted: (N,) whether the tool is raised: no force, after the first pressed row of the run.
    over: (R,) mm by which it is raised.
    number: (R,) numbers of the paths.
    linked, down: (R,) see `Run`.
    above_start, above_end: (R, 3) mm, where the travel to the run ends and the travel from it begins.
    near: (R, 3) mm, where the feed begins.
    unwound: orientations to go through at the end of the run before, by run.
    ways: joint motions to above the start, by run. A run without them has a straight line.
    rapid: kind of the travel motions, a line for a robot.
    """

    draft: Draft
    job: Job
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

    def enter(self, link: FloatArray | None) -> None:
        """From the end of each run to the start of the next; a process in the air is on.

        link: see `TourEnds`.
        """
        rows, process, first = self.rows, self.job.process, self.rows.first
        contact, speed = rows.position[first], process.travel_speed
        apart = ~_same(rows.position[np.roll(rows.last, 1)], contact)
        free = ~(self.linked | self.down)
        remarks = [Comment(f"path {run.path.id} layer {run.path.layer}") for run in self.runs]
        self.draft.put(first, remarks)
        if link is not None:
            at = np.repeat(first[:1], len(link))
            targets = self._targets(link, self.orientations.ends[at])
            self.draft.put(at, self._moves(at, targets, np.full(len(at), speed)))
            apart[0] = True
        self._travel(MoveL, first, self.down & apart, contact, speed)
        self._come(free)
        low = free & ~_same(self.above_start, self.near)
        self._travel(self.rapid, first, low, self.near, speed)
        if in_air(self.job):
            self._put_each(first[free], switch_on(process))
        # A path that starts on an outer corner is faster there than the feed; the plunge before it
        # must not be. A drill does nothing but go down.
        slow = plunge(process)
        most = [process.feed if run.path.operation == "drill" else slow for run in self.runs]
        # A ramp goes on from where the pass before ended.
        sinks = np.where(self.linked, apart, free & ~_same(self.near, contact))
        self._travel(MoveL, first, sinks, contact, np.minimum(rows.feed[first], most))

    def _come(self, free: Mask) -> None:
        """From above the end of the run before, or from home, to above the start of `free` runs."""
        rows, process, ends = self.rows, self.job.process, self.orientations.ends
        above, near, contact = self.above_start, self.near, rows.position[rows.first]
        straight = free & ~_among(self.ways, len(free))
        left = np.roll(self.above_end, 1, axis=0)
        turned = {run: backs for run, backs in self.unwound.items() if straight[run]}
        if straight[0]:
            # From home to the first orientation at once.
            left[0] = above[0]
            turned.setdefault(0, [self.orientations.table[ends[rows.first[0]]]])
        come: dict[int, list[MoveJ] | list[MoveJ | MoveL]] = {**self.ways}
        for run, backs in turned.items():
            kinds = [self.rapid if run or k else MoveJ for k in range(len(backs))]
            poses = [Pose(back, to_vec3(left[run])) for back in backs]
            number = int(self.number[run])
            come[run] = [
                kind(pose, process.travel_speed, path=number)
                for kind, pose in zip(kinds, poses, strict=True)
            ]
        self._put_several(rows.first, come)
        at_once = _same(above, near)
        way = _distances(left, above), _distances(above, np.where(at_once[:, None], contact, near))
        zone = np.where(at_once & in_air(self.job), 0.0, _zone(process, *way))
        moved = straight & ~_same(left, above)
        self._travel(self.rapid, rows.first, moved, above, process.travel_speed, zone)

    def leave(self, stays: bool) -> None:
        """Up to the travel height, unless the next run starts where a run ends; then process off.

        stays: see `TourEnds`.
        """
        process, up, last = self.job.process, self.above_end, self.rows.last
        leaving = ~np.append((self.linked | self.down)[1:], stays)
        here = self._points(last, self.lifted[last], self.rows.position)
        off = in_air(self.job) and bool(signal(process))
        zone = np.zeros(len(last))
        if not off:
            led = _among(self.unwound, len(last)) | _among(self.ways, len(last))
            on = ~np.append(led[1:], True)
            way = _distances(here, up), _distances(up, np.roll(self.above_start, -1, axis=0))
            zone = np.where(on, _zone(process, *way), 0.0)
        self._travel(self.rapid, last, leaving & ~_same(here, up), up, process.travel_speed, zone)
        if off:
            self._put_each(last[leaving], [Output(signal(process), 0.0)])

    def work(self) -> None:
        """The segments of each run between force on, process on and process off, force off."""
        rows, process, first, last = self.rows, self.job.process, self.rows.first, self.rows.last
        # Points that are only touched have no segment, and nothing presses there.
        second = first[last > first] + 1
        pressed = second[rows.force[second] > 0]
        self.draft.put(pressed - 1, _forces(rows, pressed))
        if not in_air(self.job):
            self._put_each(first, switch_on(process))
        self._segments(second, plunge(process))
        if signal(process) and not in_air(self.job):
            self._put_each(last, [Output(signal(process), 0.0)])
        self._put_each(last[(last > first) & (rows.force[last] > 0)], [Force(0.0)])

    def _segments(self, second: Indices, slow: float) -> None:
        """One motion a segment. Where force begins or ends it is switched; where the orientation
        jumps the tool is turned.

        The tool is raised where force ends, and leaves the surface for good; where force begins
        again it goes down at `slow` mm/s.
        second: the rows of the first segments, whose force is already on.
        """
        rows, turned, lifted = self.rows, self.orientations, self.lifted
        feed, wanted = rows.feed, rows.force > 0
        pressing = np.roll(wanted, 1)
        pressing[second] = wanted[second]
        segment = np.ones(len(feed), np.bool_)
        segment[rows.first] = False
        up = np.flatnonzero(segment & pressing & ~wanted)
        self._put_each(up, [Force(0.0)])
        down = np.flatnonzero(segment & wanted & np.roll(lifted, 1))
        for at, speed in ((up, feed[up]), (down, np.minimum(slow, feed[down]))):
            start = self._points(at - 1, lifted[at], rows.position)
            self.draft.put(at, self._moves(at, self._targets(start, turned.ends[at - 1]), speed))
        at = np.flatnonzero(segment & turned.turns)
        start = self._points(at - 1, lifted[at], rows.position)
        turns = self._moves(at, self._targets(start, turned.begins[at]), feed[at], work=True)
        force = np.where(pressing[at], rows.force[at], 0.0)
        self.draft.put(at, _press(turns, force, rows.force_direction[:, 0], at))
        begin = np.flatnonzero(segment & wanted & ~pressing)
        self.draft.put(begin, _forces(rows, begin))
        hops = segment & self._are_hops()
        at = np.flatnonzero(hops)
        ends = self._targets(rows.position[at], turned.ends[at])
        self.draft.put(at, self._moves(at, ends, feed[at], kind=self.rapid))
        at = np.flatnonzero(segment & ~hops)
        end, via = (self._points(at, lifted[at], column) for column in (rows.position, rows.via))
        targets = Targets(end, turned.ends[at], turned.table, via, turned.vias[at])
        along = self._moves(at, targets, feed[at], self.blend[at], work=True)
        self.draft.put(at, _press(along, rows.force[at], rows.force_direction[:, 1], at))

    def _are_hops(self) -> Mask:
        """(N,) segments of pockets that lead over cleared ground above the floor of their pass."""
        rows = self.rows
        of_pocket = np.array([run.path.operation == "pocket" for run in self.runs])
        floor = -np.array([run.depth for run in self.runs])
        above = rows.position[:, 2] > floor[self.run] + SAME_POINT_MM
        fast = rows.feed >= self.job.process.travel_speed
        return np.asarray(of_pocket[self.run] & above & fast)

    def _travel(
        self,
        kind: type[MoveJ | MoveL],
        rows: Indices,
        where: Mask,
        end: FloatArray,
        speed: FloatArray | float,
        blend: FloatArray | float = 0.0,
    ) -> None:
        """Motions of the runs `where` (R,) to `end` (R, 3), with the orientations of `rows` (R,)."""
        runs = np.flatnonzero(where)
        speed, blend = (np.broadcast_to(column, len(where))[runs] for column in (speed, blend))
        at = rows[runs]
        targets = self._targets(end[runs], self.orientations.ends[at])
        self.draft.put(at, self._moves(at, targets, speed, blend, kind=kind))

    def _moves(
        self,
        rows: Indices,
        targets: Targets,
        speed: FloatArray,
        blend: FloatArray | float = 0.0,
        work: bool = False,
        kind: type[MoveJ | MoveL] = MoveL,
    ) -> Body:
        """Plain motions (K,) of the runs that ``rows`` (K,) belong to, see ``plain_motions``."""
        path = self.number[self.run[rows]]
        return plain_motions(kind, targets, speed=speed, blend=blend, path=path, work=work)

    def _targets(self, origin: FloatArray, rotation: Places) -> Targets:
        """K poses of the tool. origin: (K, 3) mm. rotation: (K,) places in the orientations."""
        return Targets(origin, rotation, self.orientations.table)

    def _points(self, at: Indices, lifted: Mask, points: FloatArray) -> FloatArray:
        """(K, 3) of `points` (N, 3) the rows `at` (K,), raised along the axis where `lifted` (K,)."""
        chosen = points[at]
        high = at[lifted]
        chosen[lifted] -= self.rows.axis[high] * self.over[self.run[high]][:, None]
        return chosen

    def _put_each(self, rows: Indices, items: Iterable[Instruction]) -> None:
        """All of ``items`` at each of ``rows``."""
        for item in items:
            self.draft.put(rows, [item] * len(rows))

    def _put_several(self, rows: Indices, items: Mapping[int, Sequence[Instruction]]) -> None:
        """At the rows (R,) of some runs, those that are keys of ``items``, each its own."""
        places = np.repeat(rows[np.array(list(items), np.intp)], list(map(len, items.values())))
        self.draft.put(places, [*chain.from_iterable(items.values())])


def _open_draft(
    draft: Draft, runs: list[Run], tour: Tour, cell: Cell, job: Job, before: int
) -> _RunDraft:
    """The columns of `runs`, with a place for each row behind the contents of `draft`.

    before: number of paths before those of `tour`. Raises JobError if the tool turns with the
    contour and a path has no surface beside it.
    """
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
    elif isinstance(tour, ArmTour):
        orientations = lower_rows.orient_turned(rows, turns_of(runs, tour, before))
    else:
        orientations = lower_rows.orient_fixed(rows)
    run = np.repeat(np.arange(len(runs)), rows.last - rows.first + 1)
    tolerance = np.array([compute_corner_tolerance(job, run.path.operation) for run in runs])
    blend = lower_rows.blends(rows, tolerance[run], cell.pace)
    blend[np.flatnonzero(orientations.turns) - 1] = 0.0
    above_start, near, above_end = _heights(rows, runs, job.process)
    unwound = unwind(rows, orientations) if _winds(job, cell) else []
    draft.open(len(run))
    return _RunDraft(
        draft=draft,
        job=job,
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
        ways=_chosen_ways(runs, tour, before) if isinstance(tour, ArmTour) else {},
        rapid=MoveJ if isinstance(cell.home, Pose) else MoveL,
    )


def _chosen_ways(runs: Sequence[Run], tour: ArmTour, before: int) -> dict[int, list[MoveJ]]:
    """Joint motions to above the start of a run, by run. before: paths before those of `tour`."""
    chosen = {}
    for k, run in enumerate(runs):
        own = run.number - before
        if not (run.linked or run.low or run.down) and len(tour.links[own]):
            chosen[k] = [*_go(tour.links[own], tour.link_speeds[own], run.number)]
    return chosen


def _winds(job: Job, cell: Cell) -> bool:
    """Whether a tool that turns with the contour winds up an axis: a machine without joints has none that does."""
    return job.tool.orient == "follow" and not isinstance(cell.home, Pose)


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
