"""Plans motions along the selected edges of a 3-D part that the arm reaches."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import cache
from itertools import compress, starmap
from typing import Literal

from msgspec import Struct
from msgspec.structs import replace

from camgen.collision.cell import CellScene, make_cell_scene
from camgen.model.cell import Cell
from camgen.model.errors import InputError, JobError
from camgen.model.job import Job
from camgen.model.limits import format_limit
from camgen.model.part import (
    Edge,
    Line,
    Note,
    Part,
    Solid,
    drop_ids,
    index_by_id,
    keep_ids,
    list_ids,
)
from camgen.model.program import Joints
from camgen.model.sequences import take_rows
from camgen.model.text import counted, short
from camgen.motion.cell import find_home, make_free_space, make_setup
from camgen.motion.coverage import Coverage
from camgen.motion.edge_paths import (
    list_pieces,
    make_no_edge_error,
    make_tool_path,
    note_gaps,
    note_left_out,
)
from camgen.motion.pose_paths import PosePath, measure_to
from camgen.motion.reach import can_end, reach_paths
from camgen.motion.rolls import find_freedom
from camgen.motion.setup import (
    Blockage,
    EdgeMotion,
    FreeSpace,
    SampledMotion,
    Setup,
    UnreachableEdge,
)
from camgen.plan import EdgePlan, Watch
from camgen.plan.edges.contact import find_contacts
from camgen.plan.edges.last_face import read_offset
from camgen.plan.edges.pieces import LinePaths, PieceSearch
from camgen.plan.edges.poses import make_poses
from camgen.plan.edges.remedy import Attempt, find_remedies
from camgen.plan.edges.select import select_edges
from camgen.plan.unused import check_idle, check_rules
from camgen.robots.models import Robot
from camgen.robots.workcell import Workcell

#: The surroundings of the arm, from a job and the depth by which rims enter the tool's tip, mm.
Surround = Callable[[Job, float], CellScene]


def plan_edges(part: Part, job: Job, cell: Cell | None, watch: Watch) -> EdgePlan:
    """The processing motions along the selected edges of `part` that the arm of `cell` reaches.

    Raises InputError for a part without edges, JobError for settings that contradict each other and
    for a cell without an arm, NoSafeProgram if no edge can be processed.
    """
    solid = part.solid
    if not isinstance(cell, Workcell) or cell.arm is None or solid is None:
        raise JobError(
            "job", "edges of 3-D parts need an arm", "--post", "give rapid, pacscript or vplus"
        )
    _check(job, cell)
    edges = select_edges_of_job(solid, job)
    direction = read_offset(job, solid, edges.values())
    contacts = find_contacts(edges.values(), job, direction)

    def surround(other: Job, tip: float) -> CellScene:
        return make_cell_scene(other, cell, solid, tip)

    pose_paths = (
        (edge, make_poses(edge, job.operation.offset, direction)) for edge in edges.values()
    )
    task = LineTask(pose_paths, surround, _note_contacts(contacts), "edge", contacts)
    return plan_lines(part, job, cell, watch, task)


class LineTask(Struct, frozen=True, eq=False):
    """Lines of a part that are worked on.

    pose_paths: each line with its pose path, or the reason why it has none.
    surround: makes the surroundings of the arm.
    notes: notes besides those of the part and of the cell.
    noun: "edge" or "curve".
    contacts: depths by which rims enter the tool's tip, mm, by the ids of their lines.
    """

    pose_paths: Iterable[tuple[Line, PosePath | UnreachableEdge]]
    surround: Surround
    notes: Iterable[Note]
    noun: str
    contacts: Mapping[str, float] = {}

    def by_contact(self, lines: LinePaths) -> list[tuple[LinePaths, float]]:
        """The lines without contact and the rims, both with the depth of their contact, mm."""
        depth = max(self.contacts.values(), default=0.0)
        plain = [pair for pair in lines if pair[0].id not in self.contacts]
        rims = [pair for pair in lines if pair[0].id in self.contacts]
        return [group for group in ((plain, 0.0), (rims, depth)) if group[0]]


def plan_lines(part: Part, job: Job, cell: Workcell, watch: Watch, task: LineTask) -> EdgePlan:
    """The motions along the lines of a task. Raises NoSafeProgram if the arm reaches none."""
    assert cell.arm is not None
    noun, freedom = task.noun, find_freedom(job)
    where = task.surround(job, 0.0)
    find_home(cell.arm, cell, where.scene)
    watch("reaching")
    listed = list(task.pose_paths)
    lines = {line.id: line for line, _ in listed}
    reached: dict[str, EdgeMotion | UnreachableEdge] = {}
    pieces: dict[str, tuple[EdgeMotion, ...]] = {}
    search = PieceSearch(noun, watch, job.limits.stations)

    def report(done: int) -> None:
        watch(f"reaching {len(reached) + done} of {counted(len(lines), noun)}")

    for group, tip in task.by_contact(listed):
        if tip:
            where = replace(
                task.surround(job, tip), rims=frozenset(task.contacts), strict=where.work
            )
        setup = make_setup(cell.arm, cell, where)
        space = make_free_space(where, setup)
        results = _clear_between(reach_paths(group, setup, freedom, report), space)
        pieces |= search.find(group, results, Coverage(setup, space, freedom, job.process))
        reached |= index_by_id(results)
    whole = take_rows(reached, lines)
    watch("reaching, what would help others")
    attempt = _attempt(job, cell, cell.arm, task, dict(zip(lines, listed, strict=True)))
    unreached = [result for result in whole if isinstance(result, UnreachableEdge)]
    remedied, more = find_remedies(unreached, job, attempt, noun)
    explained = [search.explain(edge) for edge in remedied]
    lost = [edge for edge in explained if edge.id not in pieces]
    motions: list[EdgeMotion] = []
    for result in whole:
        motions += [result] if isinstance(result, EdgeMotion) else pieces.get(result.id, ())
    if not motions:
        raise make_no_edge_error(part, len(lines), lost[0], noun)
    notes = search.notes()
    for edge in explained:
        if edge.id in pieces:
            line, reason = lines[edge.id], edge.reason
            notes += note_gaps(line, pieces[edge.id], reason, job.operation.trim)
    paths = tuple(make_tool_path(motion, lines[motion.line], job) for motion in motions)
    return EdgePlan(
        part,
        paths,
        (*part.notes, *where.notes, *task.notes, *note_left_out(lost, lines), *notes, *more),
        edges=tuple(lines.values()),
        motions=tuple(motions),
        unreached=tuple(lost),
        where=where,
        original_paths=paths,
        noun=noun,
    )


def _attempt(
    job: Job,
    cell: Workcell,
    arm: Robot,
    task: LineTask,
    pose_paths: Mapping[str, tuple[Line, PosePath | UnreachableEdge]],
) -> Attempt:
    @cache
    def place(tilt: float, tip: float) -> tuple[Setup, FreeSpace]:
        # The margin does not decide whether there is a path at all.
        bare = replace(job.cell, margin=0.0)
        other = replace(job, tool=replace(job.tool, axis_tilt=tilt), cell=bare)
        where = task.surround(other, tip)
        setup = make_setup(arm, cell, where)
        return setup, make_free_space(where, setup)

    def attempt(other: Job, names: Sequence[str]) -> list[EdgeMotion | UnreachableEdge]:
        freedom = find_freedom(other)
        results: list[EdgeMotion | UnreachableEdge] = []
        for group, tip in task.by_contact(take_rows(pose_paths, names)):
            setup, space = place(other.tool.axis_tilt, tip)
            shaped = [(line, path) for line, path in group if isinstance(path, PosePath)]
            able = list(compress(shaped, can_end(setup, [path for _, path in shaped], freedom)))
            results += _clear_between(reach_paths(able, setup, freedom), space)
        return results

    return attempt


def _note_contacts(contacts: Mapping[str, float]) -> Iterator[Note]:
    if contacts:
        depth = short(max(contacts.values()), 2)
        yield Note(
            "assumed",
            f"the rim of {counted(len(contacts), 'edge')} may enter the tool's tip",
            f"it bends into the tip by up to {depth} mm: tool.diameter, operation.offset",
            tuple(contacts),
        )


def _clear_between(
    results: Sequence[EdgeMotion | UnreachableEdge], space: FreeSpace
) -> tuple[EdgeMotion | UnreachableEdge, ...]:
    """The results, with a reason in place of each motion that collides between its samples.

    A motion that was chosen for its margin is replaced by the one without it, if that is free.
    """
    moved = [result for result in results if isinstance(result, EdgeMotion)]
    looks = space.find_blockages(
        [SampledMotion(motion.sampled_joints, motion.sampled_path) for motion in moved]
    )
    checked = {motion.id: _stop(motion, look) for motion, look in zip(moved, looks, strict=True)}
    for motion in moved:
        if motion.nearer and isinstance(checked[motion.id], UnreachableEdge):
            checked[motion.id] = _clear_between([motion.nearer], space)[0]
    return tuple(checked.get(result.id, result) for result in results)


def _stop(motion: EdgeMotion, hit: Blockage | float) -> EdgeMotion | UnreachableEdge:
    if not isinstance(hit, Blockage):
        return motion
    along = short(measure_to(motion.sampled_path, hit.at), 1)
    return UnreachableEdge(motion.id, hit.kind, f"{hit.what}, {along} mm along it")


def select_edges_of_job(solid: Solid, job: Job) -> dict[str, Edge]:
    """The selected edges by their ids.

    Raises InputError for too many: a noisy mesh has thousands.
    """
    if not solid.edges:
        raise InputError(
            solid.source, "has no sharp edges", remedy="camgen inspect shows what is in it"
        )
    chosen = set(select_edges(solid, [job.input.select]))
    if not chosen:
        raise JobError(
            "job",
            f"picks no edge; the part has {counted(len(solid.edges), 'edge')}",
            "input.select",
            "camgen inspect lists them",
        )
    if len(chosen) > job.limits.edges:
        count = counted(len(chosen), "edge")
        raise InputError(
            solid.source,
            f"{count} are to be processed, more than {format_limit(job.limits.edges)}",
            "input.select",
            "smooth the mesh, select some of them, or raise limits.edges",
        )
    return index_by_id(keep_ids(solid.edges, chosen))


def _check(job: Job, cell: Cell) -> None:
    check_rules(
        [
            (
                job.tour.method == "as-drawn",
                "the edges of a part have no drawn order",
                "tour.method",
                'set it to "best" or "nearest"',
            ),
            (
                not isinstance(cell.home, Joints),
                "edges of 3-D parts need an arm",
                "--post",
                "give rapid, pacscript or vplus",
            ),
        ]
    )
    check_idle(job, "a 3-D part")


def leave_out_motions(
    plan: EdgePlan, lost: Sequence[tuple[str, Literal["collision", "jump"], str]]
) -> EdgePlan:
    """The plan without some motions.

    lost: id, kind and reason of each.
    Raises NoSafeProgram if no motion is left.
    """
    more = tuple(starmap(UnreachableEdge, lost))
    gone = list_ids(more)
    paths = drop_ids(plan.paths, gone)
    edges = index_by_id(plan.edges)
    pieces = list_pieces(plan.motions, edges)
    if not paths:
        raise make_no_edge_error(plan.part, len(edges), more[0], plan.noun)
    return replace(
        plan,
        paths=paths,
        original_paths=paths,
        motions=drop_ids(plan.motions, gone),
        unreached=(*plan.unreached, *more),
        notes=(*plan.notes, *note_left_out(more, edges, pieces)),
    )
