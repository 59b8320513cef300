"""Makes a program from a tour: approach, process on, the segments of a path, process off, retract.

Every path becomes the same sequence, so a reader of the program knows it after the first one. The
rules are written for all paths at once, by column: which paths have such an instruction, and with
what numbers. A draft puts the instructions in order.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import chain

import numpy as np
from msgspec import Struct
from msgspec.structs import replace
from numpy.typing import NDArray

from camgen.geometry.rotations import SURE_TURN, measure_rolls
from camgen.geometry.vectors import multiply_rows
from camgen.lower import columns as lower_rows
from camgen.lower.columns import Mask, Orientations, Places, Rows
from camgen.lower.draft import Draft
from camgen.lower.runs import ToolPass, make_passes, plunge
from camgen.model.body import Targets, make_plain_motions
from camgen.model.cell import Cell
from camgen.model.errors import JobError, NoSafeProgram
from camgen.model.job import Job, ProcessTable
from camgen.model.limits import format_limit
from camgen.model.path import ToolPath, Tour
from camgen.model.pose import TOOL_DOWN, FloatArray, Pose, frozen, rotation_about, to_vec3
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

#: (R,) kinds of paths.
Operations = NDArray[np.str_]

# Roll of a tool that turns with the contour, and its unwinding in the air between two paths.

#: rad: largest roll of the tool to either side of its orientation at home.
MAX_ROLL = 2 * math.pi
#: rad: change of the roll between two orientations from which its direction is not certain; steps
#: are no larger than `SURE_TURN`.
_UNCERTAIN_TURN = math.radians(150.0)


def measure_twists(a: FloatArray, b: FloatArray) -> FloatArray:
    """(N,) rotations of the tool about its z from rotations a to b (N, 3, 3), rad in -pi..pi."""
    return measure_rolls(np.swapaxes(a, -1, -2) @ b)


def plan_unwinding(rows: Rows, orientations: Orientations) -> list[list[FloatArray]]:
    """For each pass the rotations (3, 3) to go through in the air before it.

    The last one is that of its start; the list of a pass is empty if the tool need not be turned
    back. At home the tool is assumed to point straight down with roll 0. Within a pass nothing can
    be turned back. A pass that rolls by more than `MAX_ROLL` to one side starts so that it rolls by
    equal amounts to both sides.
    """
    table = np.stack(orientations.table)
    begins, ends = table[orientations.begins], table[orientations.ends]
    vias = table[orientations.vias]
    before = np.roll(ends, 1, axis=0)
    on_arc = measure_twists(begins, vias) + measure_twists(vias, ends)
    step = measure_twists(before, begins) + np.where(rows.arc, on_arc, measure_twists(begins, ends))
    step[rows.first] = 0.0
    total = np.cumsum(step)
    left = np.concatenate([TOOL_DOWN[None], ends[rows.last[:-1]]])
    link_twists = measure_twists(left, ends[rows.first])
    roll, result = 0.0, []
    for k, (first, last) in enumerate(zip(rows.first.tolist(), rows.last.tolist(), strict=True)):
        along = total[first : last + 1] - total[first]
        low, high = float(along.min()), float(along.max())
        twist = float(link_twists[k])
        start = roll + twist
        if start + low < -MAX_ROLL - 1e-9 or start + high > MAX_ROLL + 1e-9:
            twist -= 2 * math.pi * round((start + (low + high) / 2) / (2 * math.pi))
        is_certain = abs(twist) <= _UNCERTAIN_TURN
        result.append([] if is_certain else _list_roll_steps(left[k], ends[first], twist))
        roll += twist + float(along[-1])
    return result


def _list_roll_steps(a: FloatArray, b: FloatArray, turn: float) -> list[FloatArray]:
    """Rotations from `a` to `b` (3, 3), in steps of a roll about tool z by `turn` rad, `b` last."""
    count = math.ceil(abs(turn) / SURE_TURN - 1e-9)
    return [*(frozen(a @ rotation_about(2, turn * k / count)) for k in range(1, count)), frozen(b)]


def _check_size(tour: Tour, limit: float) -> None:
    motions = sum(len(path) * len(path.depths) for path in tour.paths)
    if motions > limit:
        what = f"paths and passes need {motions:,} motions; the limit is {format_limit(limit)}"
        remedy = "use fewer passes, build the part in several programs, or raise limits.motions"
        raise JobError("job", what, "operation.passes", remedy)


def _check_home_height(cell: Cell, job: Job) -> None:
    """Raise JobError for a machine whose home is below the clearance height.

    The link from there to the first path would cross the part below that height.
    """
    clearance = job.process.clearance
    if isinstance(cell.home, Pose) and cell.home.origin[2] < clearance - SAME_POINT_MM:
        height = cell.home.origin[2]
        what = f"a home at z {height:g} mm is below the clearance height, {clearance:g} mm"
        raise JobError("job", what, "cell.home", "raise it, or lower process.clearance")


def lower_paths(
    tour: Tour, cell: Cell, job: Job, name: str = "part", header: tuple[str, ...] = ()
) -> Program:
    """The program that runs the paths of a tour in order, from and back to the home position.

    Raises JobError for settings that contradict each other, NoSafeProgram if there is no path.

    cell: the cell, with the frames and the home of `job`.
    name, header: name of the program, lines of its header.
    """
    if not tour.paths:
        raise NoSafeProgram(name, "no path to run")
    process = job.process
    home = MoveJ(cell.home, process.travel_speed)
    draft = Draft()
    draft.add(home, *start_spindle(job, cell))
    add_paths(draft, tour, cell, job, 0, TourEnds())
    draft.add(*([Output("spindle", 0.0)] if process.spindle > 0 else []), home)
    return finish_program(draft.body(), tour.paths, cell, job, name, header)


def start_spindle(job: Job, cell: Cell) -> list[Instruction]:
    """The spindle on, if it has a speed. Raises JobError for a mill that would cut without one."""
    if job.process.spindle > 0:
        return [Output("spindle", job.process.spindle), *make_dwell(job.process)]
    if isinstance(cell.home, Pose) and job.operation.depth and _is_cutter_at_rest(job.process):
        what = f"a cut of {job.operation.depth:g} mm with the spindle at rest"
        remedy = (
            "set it to the speed in rpm, "
            'or process.switch to "contact" for a laser or a plasma torch'
        )
        raise JobError("job", what, "process.spindle", remedy)
    return []


class TourEnds(Struct, frozen=True, eq=False):
    """The approach to the first path of a tour, and the retract from the last one.

    link: (K, 3) points on which the tool comes at working height, mm; None if it comes from above.
    stays: whether it stays at working height after the last path.
    """

    link: FloatArray | None = None
    stays: bool = False


def add_paths(
    draft: Draft,
    tour: Tour,
    cell: Cell,
    job: Job,
    before: int,
    ends: TourEnds,
) -> None:
    """Add the paths of a tour to a draft, each from above its start to above its end.

    before: number of paths of the program that come before them.
    ends: approach to the first path and retract from the last one.
    """
    _check_size(tour, job.limits.motions)
    _check_home_height(cell, job)
    if ends.link is not None:
        tour = replace(tour, down=tour.down | {0})
    passes = make_passes(tour, job, _must_unwind(job, cell), before)
    pass_draft = _open_draft(draft, passes, tour, cell, job, before)
    pass_draft.add_approaches(ends.link)
    pass_draft.add_segments()
    pass_draft.add_retracts(ends.stays)
    if isinstance(tour, ArmTour):
        draft.add(*_make_joint_motions(tour.back, tour.back_speeds, before + len(tour.paths) - 1))


def _make_joint_motions(
    joints: Sequence[FloatArray], speeds: Sequence[tuple[float, float]], path: int
) -> Iterator[MoveJ]:
    for values, (speed, fraction) in zip(joints, speeds, strict=True):
        yield MoveJ(Joints(tuple(values.tolist())), speed, path=path, share=fraction)


def join_rolls(passes: Sequence[ToolPass], tour: ArmTour, before: int) -> FloatArray:
    """The rolls of the tool at the rows of all passes, one after the other, rad.

    before: number of paths of the program that come before those of the tour.
    """
    rolls = []
    for tool_pass in passes:
        index = tool_pass.number - before
        of_path, path = tour.rolls[index], tour.paths[index]
        position = tool_pass.path.position
        if (of_path == of_path[0]).all():
            rolls.append(np.full(len(position), of_path[0]))
            continue
        # A path with a changing roll is entered by a plunge: its passes have its waypoints.
        is_reversed = not np.array_equal(position[:, :2], path.position[:, :2])
        rolls.append(of_path[::-1] if is_reversed else of_path)
    return np.concatenate(rolls)


def _is_cutter_at_rest(process: ProcessTable) -> bool:
    """Whether nothing turns the cutter of a mill without a spindle speed, no signal either."""
    return process.switch == "auto" or (process.switch == "air" and not find_signal(process))


def finish_program(
    body: Sequence[Instruction],
    paths: Sequence[ToolPath],
    cell: Cell,
    job: Job,
    name: str,
    header: tuple[str, ...],
) -> Program:
    """The program of a body: outputs are off at first, and reorientations have their speed."""
    body = limit_reorientations(switch_off_first(body), math.radians(job.process.turn))
    return Program(
        name, cell.base_from_work, cell.flange_from_tool, body, header, make_origins(paths)
    )


def limit_reorientations(body: Sequence[Instruction], speed: float) -> Sequence[Instruction]:
    """The body with this speed, rad/s, in all reorientations at a fixed TCP that have none."""
    columns = Columns(body)
    changed = {
        int(columns.at[k]): (replace(columns.moves[k], turn=speed),)
        for k in np.flatnonzero(columns.turned & (columns.turn == 0))
    }
    return splice(body, changed) if changed else body


def make_origins(paths: Sequence[ToolPath]) -> tuple[Origin, ...]:
    """The provenance of the motions of a program over `paths`."""
    return tuple(Origin(path.id, path.layer, path.contours, path.operation) for path in paths)


class _PassDraft(Struct, frozen=True, eq=False):
    """The instructions of R passes while they are made, by column.

    There are N rows; segment i ends in row i.

    draft: the body to which they are added, which has a place for each row.
    job: the speeds and heights of the passes.
    passes: the R passes.
    rows: positions, axes, forces and feeds, one pass after the other.
    blend: (N,) blend radius, mm.
    orientations: orientations of the tool at the rows.
    pass_of: (N,) pass to which a row belongs.
    lifted: (N,) whether the tool is raised: no force, after the first row of the pass in contact.
    depth: (R,) depth of the pass, mm.
    lift: (R,) distance by which it is raised, mm.
    operation: (R,) kind of the path.
    number: (R,) index of the path.
    linked, down: (R,) see `ToolPass`.
    above_start, above_end: (R, 3) points where the link to the pass ends and the one from it
        begins, mm.
    near: (R, 3) points where the feed begins, mm.
    unwound: orientations to go through at the end of the pass before, by pass.
    joint_links: joint motions to above the start, by pass. A pass without them has a straight line.
    rapid: kind of the link motions, a line for a robot.
    """

    draft: Draft
    job: Job
    passes: list[ToolPass]
    rows: Rows
    blend: FloatArray
    orientations: Orientations
    pass_of: Indices
    lifted: Mask
    depth: FloatArray
    lift: FloatArray
    operation: Operations
    number: Indices
    linked: Mask
    down: Mask
    above_start: FloatArray
    near: FloatArray
    above_end: FloatArray
    unwound: dict[int, list[FloatArray]]
    joint_links: dict[int, list[MoveJ]]
    rapid: type[MoveJ | MoveL]

    def add_approaches(self, link: FloatArray | None) -> None:
        """Add the motions from the end of each pass to the start of the next, process in air on.

        link: points of `TourEnds.link`.
        """
        rows, process, first = self.rows, self.job.process, self.rows.first
        contact, speed = rows.position[first], process.travel_speed
        is_apart = ~_are_same(rows.position[np.roll(rows.last, 1)], contact)
        free = ~(self.linked | self.down)
        titles = [f"path {each.path.id} layer {each.path.layer}" for each in self.passes]
        self.draft.insert(first, list(map(Comment, titles)))
        if link is not None:
            places = np.repeat(first[:1], len(link))
            targets = self._targets(link, self.orientations.ends[places])
            self.draft.insert(places, self._moves(places, targets, np.full(len(places), speed)))
            is_apart[0] = True
        self._travel(MoveL, first, self.down & is_apart, contact, speed)
        self._add_links(free)
        low = free & ~_are_same(self.above_start, self.near)
        self._travel(self.rapid, first, low, self.near, speed)
        if is_switched_in_air(self.job):
            self._insert_each(first[free], switch_on(process))
        # A path that starts on an outer corner is faster there than the feed; the plunge before it
        # must not be. A drill only plunges, so it has its feed.
        limit = np.where(self.operation == "drill", process.feed, plunge(process))
        # A ramp continues from the end of the pass before.
        plunges = np.where(self.linked, is_apart, free & ~_are_same(self.near, contact))
        self._travel(MoveL, first, plunges, contact, np.minimum(rows.feed[first], limit))

    def _add_links(self, free: Mask) -> None:
        """Add the motions from above the end of the pass before to above the start of `free`
        passes.

        The first pass is approached from home.
        """
        rows, process, ends = self.rows, self.job.process, self.orientations.ends
        above, near, contact = self.above_start, self.near, rows.position[rows.first]
        straight = free & ~_make_mask(self.joint_links, len(free))
        left = np.roll(self.above_end, 1, axis=0)
        unwound = {k: rotations for k, rotations in self.unwound.items() if straight[k]}
        if straight[0]:
            # From home to the first orientation at once.
            left[0] = above[0]
            unwound.setdefault(0, [self.orientations.table[ends[rows.first[0]]]])
        links: dict[int, list[MoveJ] | list[MoveJ | MoveL]] = {**self.joint_links}
        for k, rotations in unwound.items():
            motions: list[MoveJ | MoveL] = []
            for step, rotation in enumerate(rotations):
                kind = self.rapid if k or step else MoveJ
                pose = Pose(rotation, to_vec3(left[k]))
                motions.append(kind(pose, process.travel_speed, path=int(self.number[k])))
            links[k] = motions
        self._insert_several(rows.first, links)
        is_low = _are_same(above, near)
        next_point = np.where(is_low[:, None], contact, near)
        blend = _choose_blends(
            process, _measure_distances(left, above), _measure_distances(above, next_point)
        )
        blend = np.where(is_low & is_switched_in_air(self.job), 0.0, blend)
        moved = straight & ~_are_same(left, above)
        self._travel(self.rapid, rows.first, moved, above, process.travel_speed, blend)

    def add_retracts(self, stays: bool) -> None:
        """Add the motions up to the clearance height, except between passes that meet; process off.

        stays: value of `TourEnds.stays`.
        """
        process, up, last = self.job.process, self.above_end, self.rows.last
        leaving = ~np.append((self.linked | self.down)[1:], stays)
        end = self._points(last, self.lifted[last], self.rows.position)
        has_signal = is_switched_in_air(self.job) and bool(find_signal(process))
        blend = np.zeros(len(last))
        if not has_signal:
            led = _make_mask(self.unwound, len(last)) | _make_mask(self.joint_links, len(last))
            is_continued = ~np.append(led[1:], True)
            next_point = np.roll(self.above_start, -1, axis=0)
            lengths = _measure_distances(end, up), _measure_distances(up, next_point)
            blend = np.where(is_continued, _choose_blends(process, *lengths), 0.0)
        moved = leaving & ~_are_same(end, up)
        self._travel(self.rapid, last, moved, up, process.travel_speed, blend)
        if has_signal:
            self._insert_each(last[leaving], [Output(find_signal(process), 0.0)])

    def add_segments(self) -> None:
        """Add the segments of each pass between force on, process on and process off, force off."""
        rows, process, first, last = self.rows, self.job.process, self.rows.first, self.rows.last
        # A path of one point has no segment, so nothing presses there.
        second = first[last > first] + 1
        pressed = second[rows.force[second] > 0]
        self.draft.insert(pressed - 1, _make_forces(rows, pressed))
        in_air, signal = is_switched_in_air(self.job), find_signal(process)
        if not in_air:
            self._insert_each(first, switch_on(process))
        self._segments(second, plunge(process))
        if signal and not in_air:
            self._insert_each(last, [Output(signal, 0.0)])
        self._insert_each(last[(last > first) & (rows.force[last] > 0)], [Force(0.0)])

    def _segments(self, second: Indices, slow: float) -> None:
        """One motion for each segment, with force switched and the tool rolled where they change.

        The tool is raised where force ends, and leaves the surface; where force begins again it
        goes down at `slow` mm/s.

        second: the rows of the first segments, whose force is already on.
        """
        rows, turned, lifted = self.rows, self.orientations, self.lifted
        feed, has_force = rows.feed, rows.force > 0
        is_pressing = np.roll(has_force, 1)
        is_pressing[second] = has_force[second]
        segment = np.ones(len(feed), np.bool_)
        segment[rows.first] = False
        up = np.flatnonzero(segment & is_pressing & ~has_force)
        self._insert_each(up, [Force(0.0)])
        down = np.flatnonzero(segment & has_force & np.roll(lifted, 1))
        for ends, speed in ((up, feed[up]), (down, np.minimum(slow, feed[down]))):
            start = self._points(ends - 1, lifted[ends], rows.position)
            targets = self._targets(start, turned.ends[ends - 1])
            self.draft.insert(ends, self._moves(ends, targets, speed))
        ends = np.flatnonzero(segment & turned.turns)
        start = self._points(ends - 1, lifted[ends], rows.position)
        targets = self._targets(start, turned.begins[ends])
        turns = self._moves(ends, targets, feed[ends], work=True)
        force = np.where(is_pressing[ends], rows.force[ends], 0.0)
        self.draft.insert(ends, _add_forces(turns, force, rows.force_direction[:, 0], ends))
        begin = np.flatnonzero(segment & has_force & ~is_pressing)
        self.draft.insert(begin, _make_forces(rows, begin))
        hops = segment & self._are_hops()
        ends = np.flatnonzero(hops)
        targets = self._targets(rows.position[ends], turned.ends[ends])
        self.draft.insert(ends, self._moves(ends, targets, feed[ends], kind=self.rapid))
        ends = np.flatnonzero(segment & ~hops)
        end = self._points(ends, lifted[ends], rows.position)
        via = self._points(ends, lifted[ends], rows.via)
        targets = Targets(end, turned.ends[ends], turned.table, via, turned.vias[ends])
        along = self._moves(ends, targets, feed[ends], self.blend[ends], work=True)
        force, direction = rows.force[ends], rows.force_direction[:, 1]
        self.draft.insert(ends, _add_forces(along, force, direction, ends))

    def _are_hops(self) -> Mask:
        """(N,) segments of pockets that lead over cleared ground above the floor of their pass."""
        rows = self.rows
        of_pocket = (self.operation == "pocket")[self.pass_of]
        above = rows.position[:, 2] > SAME_POINT_MM - self.depth[self.pass_of]
        return np.asarray(of_pocket & above & (rows.feed >= self.job.process.travel_speed))

    def _travel(
        self,
        kind: type[MoveJ | MoveL],
        rows: Indices,
        moved: Mask,
        end: FloatArray,
        speed: FloatArray | float,
        blend: FloatArray | float = 0.0,
    ) -> None:
        """Add motions of the passes `moved` (R,) to `end` (R, 3), oriented as in `rows` (R,)."""
        passes = np.flatnonzero(moved)
        speed, blend = (np.broadcast_to(column, len(moved))[passes] for column in (speed, blend))
        places = rows[passes]
        targets = self._targets(end[passes], self.orientations.ends[places])
        self.draft.insert(places, self._moves(places, targets, speed, blend, kind=kind))

    def _moves(
        self,
        rows: Indices,
        targets: Targets,
        speed: FloatArray,
        blend: FloatArray | float = 0.0,
        work: bool = False,
        kind: type[MoveJ | MoveL] = MoveL,
    ) -> Body:
        """Motions (K,) of the passes to which `rows` (K,) belong, see `make_plain_motions`."""
        path = self.number[self.pass_of[rows]]
        return make_plain_motions(kind, targets, speed=speed, blend=blend, path=path, work=work)

    def _targets(self, origin: FloatArray, rotation: Places) -> Targets:
        """K poses of the tool.

        origin: (K, 3) mm.
        rotation: (K,) indices of orientations.
        """
        return Targets(origin, rotation, self.orientations.table)

    def _points(self, rows: Indices, lifted: Mask, points: FloatArray) -> FloatArray:
        """(K, 3) of `points` (N, 3) the rows (K,), raised along the axis where `lifted` (K,)."""
        chosen = points[rows]
        raised = rows[lifted]
        chosen[lifted] -= self.rows.axis[raised] * self.lift[self.pass_of[raised]][:, None]
        return chosen

    def _insert_each(self, rows: Indices, items: Iterable[Instruction]) -> None:
        for item in items:
            self.draft.insert(rows, [item] * len(rows))

    def _insert_several(self, rows: Indices, items: Mapping[int, Sequence[Instruction]]) -> None:
        places = np.repeat(rows[np.array(list(items), np.intp)], list(map(len, items.values())))
        self.draft.insert(places, [*chain.from_iterable(items.values())])


def _open_draft(
    draft: Draft, passes: list[ToolPass], tour: Tour, cell: Cell, job: Job, before: int
) -> _PassDraft:
    """The columns of the passes, with a place for each row after the contents of the draft.

    Raises JobError if the tool turns with the contour and a path has no surface beside it.

    before: number of paths before those of the tour.
    """
    follow = job.tool.orient == "follow"
    depths = np.array([tool_pass.depth for tool_pass in passes])
    rows = lower_rows.gather_rows([tool_pass.path for tool_pass in passes], depths, follow)
    if follow:
        for row in lower_rows.find_unfollowed(rows)[:1].tolist():
            path = passes[int(np.searchsorted(rows.last, row))].path
            what = f'"follow" needs a followed contour, path {path.id} has no surface beside it'
            raise JobError("job", what, "tool.orient", 'set tool.orient to "fixed"')
        rows = lower_rows.halve_arcs(rows)
        orientations = lower_rows.orient_along(rows)
    elif isinstance(tour, ArmTour):
        orientations = lower_rows.orient_turned(rows, join_rolls(passes, tour, before))
    else:
        orientations = lower_rows.orient_fixed(rows)
    pass_of = np.repeat(np.arange(len(passes)), rows.last - rows.first + 1)
    operations = [tool_pass.path.operation for tool_pass in passes]
    tolerance = np.array([compute_corner_tolerance(job, operation) for operation in operations])
    blend = lower_rows.compute_blends(rows, tolerance[pass_of], cell.pace)
    blend[np.flatnonzero(orientations.turns) - 1] = 0.0
    above_start, near, above_end = _compute_heights(rows, passes, job.process)
    unwound = plan_unwinding(rows, orientations) if _must_unwind(job, cell) else []
    draft.open(len(pass_of))
    return _PassDraft(
        draft=draft,
        job=job,
        passes=passes,
        rows=rows,
        blend=blend,
        orientations=orientations,
        pass_of=pass_of,
        lifted=_find_lifted(rows, pass_of),
        depth=depths,
        lift=depths + min(job.process.retract, job.process.clearance),
        operation=np.array(operations),
        number=np.array([tool_pass.number for tool_pass in passes]),
        linked=np.array([tool_pass.linked for tool_pass in passes]),
        down=np.array([tool_pass.down for tool_pass in passes]),
        above_start=above_start,
        near=near,
        above_end=above_end,
        unwound={k: rotations for k, rotations in enumerate(unwound) if rotations},
        joint_links=_list_joint_links(passes, tour, before),
        rapid=MoveJ if isinstance(cell.home, Pose) else MoveL,
    )


def _list_joint_links(
    passes: Sequence[ToolPass], tour: Tour, before: int
) -> dict[int, list[MoveJ]]:
    """Joint motions to above the start of a pass, by pass. before: paths before those of `tour`."""
    links = {}
    for k, tool_pass in enumerate(passes):
        index = tool_pass.number - before
        starts_low = tool_pass.linked or tool_pass.low or tool_pass.down
        if isinstance(tour, ArmTour) and not starts_low and len(tour.links[index]):
            speeds = tour.link_speeds[index]
            links[k] = [*_make_joint_motions(tour.links[index], speeds, tool_pass.number)]
    return links


def _must_unwind(job: Job, cell: Cell) -> bool:
    """Whether a tool that turns with the contour winds up joints, which a machine does not have."""
    return job.tool.orient == "follow" and not isinstance(cell.home, Pose)


def _compute_heights(
    rows: Rows, passes: list[ToolPass], process: ProcessTable
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """The points above the start, where the feed begins, and above the end, (R, 3) each, mm.

    All are measured from the planned path, not from its depth: the material of the first pass is
    still there. For a vertical tool the clearance height is z = clearance, otherwise the distance
    along the axis. Raises JobError if a path is above it.
    """
    below = np.zeros((2, len(passes), 3))
    below[0, :, 2] = [tool_pass.begin for tool_pass in passes]
    below[1, :, 2] = [tool_pass.depth for tool_pass in passes]
    start, end = rows.position[rows.first] + below[0], rows.position[rows.last] + below[1]
    up_start, up_end = -rows.axis[rows.first], -rows.axis[rows.last]
    near = start + up_start * process.approach
    lift_start = _measure_lift(start, up_start, process.clearance)
    lift_end = _measure_lift(end, up_end, process.clearance)
    low = np.flatnonzero(lift_start < process.approach - SAME_POINT_MM)
    low = np.append(low, np.flatnonzero(lift_end < -SAME_POINT_MM))
    if len(low):
        path_id = passes[int(low[0])].path.id
        what = f"{process.clearance:g} mm is below where the tool approaches path {path_id}"
        remedy = "raise process.clearance or lower process.approach"
        raise JobError("job", what, "process.clearance", remedy)
    above_end = end + up_end * lift_end[:, None]
    above_start = start + up_start * lift_start[:, None]
    starts_low = np.flatnonzero([tool_pass.low for tool_pass in passes])
    above_start[starts_low] = above_end[starts_low - 1] = near[starts_low]
    return above_start, near, above_end


def _find_lifted(rows: Rows, pass_of: Indices) -> Mask:
    """(N,) the rows without force after the first row of their pass in contact."""
    pressed = np.cumsum(rows.force > 0)
    return np.asarray((rows.force <= 0) & (pressed > pressed[rows.first][pass_of]))


def _measure_lift(point: FloatArray, up: FloatArray, clearance: float) -> FloatArray:
    """(R,) distance of each point along `up` to the clearance height, mm."""
    is_vertical = up[:, 2] > 1 - 1e-12
    return np.where(is_vertical, clearance - point[:, 2], clearance)


def _make_mask(indices: Iterable[int], count: int) -> Mask:
    mask = np.zeros(count, np.bool_)
    mask[list(indices)] = True
    return mask


def _choose_blends(process: ProcessTable, *lengths: FloatArray) -> FloatArray:
    """The blends (R,) at corners of links, at most half of the clearance and both lengths (R,)."""
    limit = np.minimum.reduce([np.full_like(lengths[0], process.clearance), *lengths]) / 2 + 1e-9
    return np.asarray(np.select([limit >= zone for zone in ZONES], ZONES, 0.0))


def _measure_distances(a: FloatArray, b: FloatArray) -> FloatArray:
    return np.asarray(np.sqrt(multiply_rows(a - b, a - b)))


def _are_same(a: FloatArray, b: FloatArray) -> Mask:
    return np.asarray(_measure_distances(a, b) < SAME_POINT_MM)


def make_dwell(process: ProcessTable) -> list[Instruction]:
    """The wait after an output is switched on."""
    return [Wait(process.dwell)] if process.dwell > 0 else []


def find_signal(process: ProcessTable) -> str:
    """The output that is on along a path, empty for none. Raises JobError if it is the spindle."""
    if process.signal == "auto":
        return "" if process.spindle > 0 else "process"
    if process.signal == "spindle":
        raise JobError(
            "job", '"spindle" is the spindle', "process.signal", "set process.spindle to its rpm"
        )
    return process.signal


def is_switched_in_air(job: Job) -> bool:
    """Whether the signal is switched above the part, as a cutter must turn before it enters."""
    switch = job.process.switch
    return switch == "air" or (switch == "auto" and bool(job.operation.depth or job.process.force))


def switch_on(process: ProcessTable) -> Iterator[Instruction]:
    """The signal on, if there is one, and the wait after it."""
    name = find_signal(process)
    if name:
        yield Output(name, 1.0)
        yield from make_dwell(process)


def _make_forces(rows: Rows, ends: Indices) -> list[Instruction]:
    directions = map(to_vec3, rows.force_direction[ends, 0]) if len(ends) else ()
    return list(map(Force, rows.force[ends].tolist(), directions))


def _add_forces(motions: Body, force: FloatArray, directions: FloatArray, rows: Indices) -> Body:
    """The K motions with a force each.

    force: (K,) N, 0 for none.
    directions: (N, 3) directions of the forces, of which `rows` (K,) count.
    """
    pressed = force > 0
    if not pressed.any():
        return motions
    moves = motions.take(np.flatnonzero(pressed))
    vectors = map(to_vec3, directions[rows[pressed]])
    objects = []
    for move, newtons, vector in zip(moves, force[pressed].tolist(), vectors, strict=True):
        objects.append(replace(move, force=newtons, force_direction=vector))
    return Body(replace(motions.packed, kept=pressed), motions.rotations, objects)
