"""Builds a checked program from drawings: runs all stages and proves the text.

Nothing is printed or written here. The command line does that with the `Result`.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from functools import cached_property, partial
from itertools import chain, pairwise
from pathlib import Path
from typing import TYPE_CHECKING

from msgspec import Struct
from msgspec.structs import replace

import camgen.preview.notebook  # noqa: F401 (values draw themselves)
from camgen.check.executed import Rounding
from camgen.check.report import (
    NOT_CHECKED,
    PARTLY_CHECKED,
    Cycle,
    Motions,
    Verified,
    add_clearances,
    untested_of,
)
from camgen.check.report import report as report_of
from camgen.lang.recorded import Recorded
from camgen.lower import lower
from camgen.lower.steps import format_tool, frame_of
from camgen.model.cell import Cell, Dynamics
from camgen.model.drawing import draw_svg
from camgen.model.errors import Blocked, InputError, JobError, NoSafeProgram
from camgen.model.job import Job
from camgen.model.part import IntArray, Note, Part, sort_notes
from camgen.model.path import ToolPath, Tour
from camgen.model.pose import format_frame
from camgen.model.program import MoveJ, Program
from camgen.model.text import counted, harmless, short_each
from camgen.model.version import __version__
from camgen.order import ArmTour, may_link_by_joints, order
from camgen.pipeline.ahead import load_later_stages
from camgen.pipeline.assumptions import (
    note_arm,
    note_close_positions,
    note_depth,
    note_drills,
    note_pieces,
    note_set_up,
    note_slow_paths,
)
from camgen.pipeline.fixtures import (
    check_fixtures,
    leave_out_blocked,
    prove_fixtures,
    report_fixtures,
)
from camgen.pipeline.inputs import Inputs, note_machine, note_urdf, note_work_frame, read_inputs
from camgen.pipeline.located import LOCATED, check_placing, locate_inputs
from camgen.pipeline.memory import release_memory
from camgen.pipeline.motion import prove_motion
from camgen.pipeline.programs import (
    CheckedPrograms,
    PostedPrograms,
    Request,
    check_programs,
    find_lines,
    note_harm,
    post_programs,
)
from camgen.pipeline.refusals import convert_refusals
from camgen.pipeline.rounding import check_rounding, limit_path_tolerance, report_rounding
from camgen.pipeline.stock import OperationSum, prove_stock, report_operations, sum_operations
from camgen.plan import Coverage, EdgePlan, Plan, ReplayPlan, Watch, ignore_stages, plan
from camgen.plan.leave_out import find_dependent, leave_out_paths
from camgen.plan.steps import make_step_jobs
from camgen.post import OutputFile, Post
from camgen.post.contract import list_warnings
from camgen.post.limits import limit_tolerance
from camgen.post.plugins import (
    cell_of,
    fill_tables,
    find_post,
    find_readback,
    make_post,
)
from camgen.post.verify import Deviation
from camgen.read.files import Files
from camgen.read.job_file import from_mapping, load_job
from camgen.robots.workcell import Workcell

if TYPE_CHECKING:
    from camgen.check.collide import ClearanceReport
    from camgen.check.feeds import SlowPath
    from camgen.check.photo.locate import Located
    from camgen.check.proof import MotionProof
    from camgen.check.reach import JointTrace
    from camgen.check.stock import Clearance, StockProof
    from camgen.collision.cell import CellScene
    from camgen.pipeline.travel import Travel

#: An input: a file, or a part that was made in code.
Input = str | Path | Part
#: Maximum number of programs that are made and checked. Each leaves out the paths that the check
#: of the previous one found blocked.
_ROUNDS = 16
#: Characters of a name, and digits of its digest, in a header line that cannot hold the name.
_LONGEST_NAME, _DIGITS = 40, 12
#: A job: its tables, its file, or the value itself; None for the defaults.
JobLike = Mapping[str, object] | Job | str | Path | None


class Result(Struct, frozen=True, eq=False, dict=True):
    """A finished build. Lengths are in mm, angles in rad, times in s.

    part: the drawing or model as it was planned.
    cell: cell with the robot and the fixtures.
    tour: the paths in order, with their leads.
    program: the program that the text states, arcs already replaced where the controller has none.
    files: the texts with LF line ends.
    lines: line of each instruction of `program`, from 1 through all files; 0 for none.
    deviation: deviation of the text from the program.
    motions: sums of the program.
    cycle: its time.
    reach, clear: results of the check with a robot, None without one.
    coverage: coverage of a fill.
    where: bodies against which collisions were tested.
    planned: the paths before they were ordered.
    counts: number of files of each program, in the order in which they are run. There is one
        program, or one for each tool on controllers that cannot change tools. `program` then joins
        all of them.
    proof: proof of the material that the text removes, None for a part that is not cut.
    motion: proof of the motions against the drawing.
    rounded: rounding of the text, None if its post does not state how its controller rounds.
    travel: the travel of the machine that the text takes, None without `cell.machine`.
    slow: paths whose feed the joints of the arm cannot keep.
    located: the photo that shows the place of the part, None without one.
    fixtures: distances between the tool and the fixtures of a mill, None without them.
    blocked: paths and stretches of paths that are left out for a fixture.
    """

    part: Part
    job: Job
    post: Post
    cell: Workcell
    tour: Tour
    notes: tuple[Note, ...]
    program: Program
    files: tuple[OutputFile, ...]
    lines: IntArray
    deviation: Deviation
    motions: Motions
    cycle: Cycle
    reach: JointTrace | None = None
    clear: ClearanceReport | None = None
    coverage: Coverage | None = None
    where: CellScene | None = None
    planned: tuple[ToolPath, ...] = ()
    counts: tuple[int, ...] = (1,)
    proof: StockProof | None = None
    motion: MotionProof | None = None
    rounded: Rounding | None = None
    travel: Travel | None = None
    slow: tuple[SlowPath, ...] = ()
    located: Located | None = None
    fixtures: Clearance | None = None
    blocked: tuple[ToolPath, ...] = ()

    @cached_property
    def report(self) -> dict[str, object]:
        """The contract's report as plain data."""
        text = Verified(tuple(file.name for file in self.files), self.deviation.max_mm)
        table = report_of(self.part, self.tour, self.notes, self.cycle, text, self.coverage)
        table |= report_operations(self.job, self.operations, self.proof)
        table |= report_rounding(self.rounded)
        if self.travel is not None:
            table |= self.travel.report()
        if self.located is not None:
            table["located"] = self.located.report
        if self.travel is not None and self.travel.placed:
            table["checks"] = {"reach": NOT_CHECKED, "collision": NOT_CHECKED, "limits": "ok"}
        if self.reach is not None:
            untested = self.where.untested if self.where else ()
            collision = PARTLY_CHECKED if untested else "ok"
            table["checks"] = {"reach": "ok", "collision": collision, "limits": "ok"}
            if untested:
                table["untested"] = untested_of(untested)
        if self.fixtures is not None:
            table |= report_fixtures(self.fixtures)
        if self.slow:
            from camgen.check.feeds import report_slow_paths  # noqa: PLC0415 (kinematics)

            table["slow_feeds"] = report_slow_paths(
                self.slow, [path.id for path in self.tour.paths]
            )
        if self.clear is not None:
            add_clearances(table, self.clear)
        return table

    @property
    def operations(self) -> list[OperationSum]:
        """Paths, time and removed material of each of several operations, in their order."""
        return sum_operations(self.tour, self.cycle, self.proof)

    @property
    def text(self) -> str:
        """The text of all files of the program, joined in their order."""
        return "".join(file.text for file in self.files)

    def __repr__(self) -> str:
        files = ", ".join(file.name for file in self.files)
        return f"Result({files}, {counted(len(self.tour.paths), 'path')}, {self.cycle.total:.1f} s)"

    def _repr_svg_(self) -> str | None:
        return draw_svg(self.tour)


def build(  # noqa: PLR0913 (the public call, whose keywords users write)
    inputs: Input | Sequence[Input],
    *,
    post: str,
    job: JobLike = None,
    name: str = "",
    strict: bool = False,
    watch: Watch = ignore_stages,
    files: Files | None = None,
    locate: str | Path | None = None,
    start: Sequence[float] | None = None,
) -> Result:
    """Build a checked program for the controller `post`.

    inputs: one or several drawings or parts in one work frame.
    job: tables as in a job file, or the path of a job file. None for the defaults; no job file is
        searched then.
    name: name of the program. If empty, the name of the first input without its suffix.
    strict: raise an error if anything is skipped.
    watch: called with the name of each stage.
    files: cache of the files that are read.
    locate: photo that shows where the part of the drawings lies.
    start: approximate pose of the part, x, y (mm) and turn (deg). It decides between poses that
        fit equally well.

    Raises a CamgenError.
    """
    files = files or Files()
    sources = list_inputs(inputs)
    settings = limit_path_tolerance(load_settings(job, files), post)
    files = files.within(settings.limits)
    files.meanwhile = partial(load_later_stages, post)
    poster = make_job_post(post, settings, str(job) if isinstance(job, (str, Path)) else "job")
    readback = find_readback(post)
    start_pose = check_placing(settings, locate is not None, start)
    watch("reading")
    read = read_inputs(sources, settings, cell_of(poster, settings), files)
    located = None
    if locate is not None:
        watch("locating")
        read, settings, located = locate_inputs(read, settings, Path(locate), start_pose, files)
    release_memory()
    planned = plan(read.part, settings, read.cell, watch)
    release_memory()
    title = poster.program or name or planned.part.name
    header = _make_header(sources, planned.part, poster, settings, read)
    if located is not None:
        header = (*header, f"{LOCATED}: {located.pose}")
    full_plan = planned
    planned = leave_out_blocked(planned, settings, read.cell)
    _check_outcome(planned.part, planned.notes, bool(planned.paths), strict)
    request = Request(settings, read.cell, poster, title, header, strict, watch)
    planned, tour, checks = _make_program(planned, request)
    release_memory()
    watch("verifying")
    posted = post_programs(
        checks, readback, fill_tables(type(poster), settings.post), settings.tolerance.chord
    )
    proof = prove_stock(full_plan, planned, tour, request, posted.texts)
    if len(tour.paths) < len(full_plan.paths):
        planned = _forget_coverage(planned)
    fixtures = prove_fixtures(proof, tour, request, posted.texts)
    result = _sum_up(planned, tour, request, checks, posted, proof)
    _check_outcome(result.part, result.notes, True, strict)
    motion = prove_motion(read.part, planned, request, posted, result.notes)
    rounded = check_rounding(tour, settings, posted)
    result = replace(result, motion=motion, rounded=rounded, located=located, fixtures=fixtures)
    if read.cell.machine is None:
        return result
    from camgen.pipeline.travel import check_travel, note_rates  # noqa: PLC0415 (only for a mill)

    travel = check_travel(settings, read.cell, posted.texts)
    notes = sort_notes(result.notes, note_rates(read.cell, result.program))
    return replace(result, travel=travel, notes=notes)


def _make_program(planned: Plan, request: Request) -> tuple[Plan, Tour, CheckedPrograms]:
    """Make the program of `planned` and check it, until no path of it is blocked.

    Each round leaves out the paths that the check found blocked, and orders the others again.
    Raises the first `Blocked` if no path is left, or the one of the last round if that still finds
    a blocked path.
    """
    job, cell = request.job, request.cell
    where = planned.where if isinstance(planned, EdgePlan) else None
    first: Blocked | None = None
    arm_links = False
    for remaining in reversed(range(_ROUNDS)):
        planned, tour = _order_whole(planned, request, arm_links)
        if first is not None and not tour.paths:
            break
        _check_outcome(
            planned.part, (*planned.notes, *tour.notes), bool(tour.paths), request.strict
        )
        request.watch("programming")
        release_memory()
        lowered = lower(tour, cell, job, request.title, request.header)
        release_memory()
        try:
            with convert_refusals(planned.part, lowered):
                if cell.arm:
                    request.watch("checking")
                check_fixtures(lowered, tour, request, planned.part.source)
                checked = check_programs(lowered, tour, request, where, planned.part.source)
                return planned, tour, checked
        except Blocked as error:
            first = first or error
            if not remaining:
                raise
            # The second half of the rounds leaves blocked edges out, so that the rounds are enough.
            if remaining > _ROUNDS // 2 and isinstance(planned, EdgePlan):
                barred = _bar_links(planned, tour, error)
                if barred != planned.barred:
                    planned = replace(planned, barred=barred)
                    continue
            planned, arm_links = _plan_again(planned, tour, job, error, arm_links)
            if not planned.paths:
                break
            _check_outcome(planned.part, planned.notes, True, request.strict)
    assert first is not None
    raise first


def _order_whole(plan: Plan, request: Request, arm_links: bool) -> tuple[Plan, Tour]:
    """Order `plan`, and leave out of it all paths that need a path which the tour has left out."""
    while True:
        tour = order(plan, request.job, request.cell, request.watch, arm_links)
        left_out = {path.id for path in plan.paths} - {path.id for path in tour.paths}
        dependent = find_dependent(plan, left_out) if left_out else {}
        if not dependent:
            return plan, tour
        plan = leave_out_paths(plan, dependent)


def _plan_again(
    plan: Plan, tour: Tour, job: Job, error: Blocked, arm_links: bool
) -> tuple[Plan, bool]:
    """Leave out of `plan` the paths that the check of its program found blocked.

    If only straight links are blocked, and the arm may choose its links, no path is left out.
    Returns the plan and whether the arm chooses its links in the next round (`arm_links`: whether
    it has chosen them so far). Raises `error` if nothing that can be left out is blocked.
    """
    is_straight = not isinstance(plan, (EdgePlan, ReplayPlan)) and not isinstance(tour, ArmTour)
    may_choose = is_straight and not arm_links and may_link_by_joints(job)
    losses = [loss for loss in error.lost if not (may_choose and loss.on_link)]
    if error.lost and not losses:
        return plan, True
    # A replay runs all motions of the program that was read. A loss on no path is on the motions
    # to or from home, which every program has.
    if isinstance(plan, ReplayPlan) or not losses or any(loss.path < 0 for loss in losses):
        raise error
    named = [(tour.paths[loss.path].id, loss.kind, loss.why) for loss in losses]
    if isinstance(plan, EdgePlan):
        from camgen.plan.edges import leave_out_motions  # noqa: PLC0415 (fcl: only for edges)

        return leave_out_motions(plan, named), arm_links
    return leave_out_paths(plan, {name: why for name, _, why in named}), arm_links


def _bar_links(plan: EdgePlan, tour: Tour, error: Blocked) -> frozenset[frozenset[str]]:
    """`EdgePlan.barred` with the pairs of paths beside the links on which the check was blocked.

    A blocked link costs its edge only if the tool has left the part on it.
    """
    names = [path.id for path in tour.paths]
    pairs: list[tuple[str, str]] = []
    for loss in error.lost:
        if (loss.on_link or loss.at_end) and loss.path >= 0:
            pairs += pairwise(names[max(loss.path - 1, 0) : loss.path + 2])
    return plan.barred | set(map(frozenset, pairs))


def _forget_coverage(plan: Plan) -> Plan:
    """Remove the coverage of a fill: it was measured with the paths that are left out."""
    if plan.coverage is None:
        return plan
    note = Note("assumed", "the coverage is not reported", "paths are left out")
    return replace(plan, coverage=None, notes=(*plan.notes, note))


def _sum_up(
    plan: Plan,
    tour: Tour,
    request: Request,
    checked: CheckedPrograms,
    posted: PostedPrograms,
    proof: StockProof | None,
) -> Result:
    checks, job, cell, post = checked.whole, request.job, request.cell, request.post
    return Result(
        part=plan.part,
        job=job,
        post=post,
        cell=cell,
        tour=tour,
        notes=sort_notes(
            plan.part.notes,
            plan.notes,
            (*tour.notes, *note_urdf(job.cell.robot, cell.arm), *note_work_frame(job, cell)),
            (checks.clear.notes if checks.clear else ()),
            (
                *note_machine(cell, job),
                *note_arm(plan.part, job, cell),
                *note_depth(plan.part, job, cell),
                *note_drills(plan.part, job),
                *note_set_up(proof),
                *note_pieces(proof, job),
                *note_slow_paths(checks.slow, tour),
                *note_close_positions(plan.part, checks.program, cell),
                *_note_corners(checks.program, cell.pace, job),
                *list_warnings(post, checks.program),
                *note_harm(posted.texts),
            ),
        ),
        program=checks.program,
        files=tuple(chain.from_iterable(text.files for text in posted.texts)),
        counts=tuple(len(text.files) for text in posted.texts),
        lines=find_lines(checks.program.body, posted.texts),
        deviation=posted.deviation,
        motions=checked.motions,
        cycle=checked.cycle,
        reach=checks.reach,
        clear=checks.clear,
        coverage=plan.coverage,
        where=checks.where,
        planned=plan.paths,
        proof=proof,
        blocked=plan.left_out,
        slow=checks.slow,
    )


def _note_corners(program: Program, pace: Dynamics, job: Job) -> tuple[Note, ...]:
    """Note the assumed acceleration (mm/s2) with which the controller rounds corners."""
    # With a tolerance of 0 a blend is only between motions that continue without a corner.
    if pace.corner != "overlap" or job.process.acceleration or job.tolerance.corner == 0:
        return ()
    columns = program.columns
    if not columns.blend[~columns.moves_are(MoveJ)].any():
        return ()
    what = f"corners without a stop are rounded as at {pace.acceleration:g} mm/s2"
    why = "a slower arm rounds them more; set process.acceleration, or tolerance.corner = 0"
    return (Note("assumed", what, why),)


def list_inputs(inputs: Input | Sequence[Input]) -> list[Path | Part]:
    """One or several inputs as a list, each a part or the path of a file."""
    listed = [inputs] if isinstance(inputs, (str, Path, Part)) else inputs
    return [source if isinstance(source, Part) else Path(source) for source in listed]


def load_settings(job: JobLike, files: Files) -> Job:
    """The job itself, or the job of tables or of a file. Raises JobError for an invalid one."""
    if isinstance(job, Job):
        return job
    if isinstance(job, Mapping):
        return from_mapping(job, files)
    return load_job(None if job is None else Path(job), files=files)


def make_job_post(name: str, job: Job, origin: str) -> Post:
    """Make the post `name` with the options of `job`.

    Raises JobError for a wrong option, with `origin` as the file that sets it, and for a post that
    prints more coarsely than the job allows.
    """
    kind = find_post(name)
    try:
        post = make_post(kind, job.post)
        limit_tolerance(post.tolerance(), job.tolerance.chord)
        return post
    except JobError as error:
        raise JobError(origin, error.what, error.file, error.remedy) from error


def _check_outcome(part: Part, notes: Sequence[Note], has_paths: bool, strict: bool) -> None:
    """Raise InputError for an empty part, and NoSafeProgram if no path is left.

    strict: raise NoSafeProgram too if anything was left out or went wrong.
    """
    skipped = [note for note in notes if note.kind == "skipped"]
    has_shape = part.contours or part.curves or part.solid is not None
    if not has_shape and not isinstance(part, Recorded):
        raise InputError(
            part.source, "nothing to work on", remedy="camgen inspect shows what the file holds"
        )
    # A robot program may have joint motions alone. They are not paths.
    if not has_paths and not _is_taught(part):
        # The notes of the planner come last. A note of the reader is not the reason why the
        # contours have no path.
        nothing = Note("skipped", "nothing fits")
        last = next((note for note in reversed(skipped) if note not in part.notes), nothing)
        raise NoSafeProgram(part.source, f"no path is left: {last.what}", last.why)
    failing = skipped or [note for note in notes if note.strict]
    if strict and failing:
        what = f"{len(skipped)} left out, first: {skipped[0].what}" if skipped else failing[0].what
        raise NoSafeProgram(
            part.source,
            f"--strict and {what}",
            failing[0].why,
            "correct the input, or build without --strict",
        )


def _make_header(
    sources: Sequence[Path | Part], part: Part, post: Post, job: Job, read: Inputs
) -> tuple[str, ...]:
    cell = read.cell
    taught = "motion as executed - routines and loops are not carried over"
    return (
        f"camgen {__version__} - job {read.digest}",
        *(format_part_name(source.name) for source in sources),
        f"post: {post.name} - cell: {cell.name.replace(',', ' -')}",
        f"units: mm - drawing: {part.units}",
        *_list_move_lines(part),
        *([taught] if _is_taught(part) else []),
        *_list_tool_lines(job, cell),
        f"work frame: {format_frame(cell.base_from_work)}",
    )


def _list_move_lines(part: Part) -> list[str]:
    """The header line on a drawing that `input.origin` moved."""
    if part.moved is None:
        return []
    x, y = short_each(part.moved, 6)
    return [f"drawing moved by x {x} y {y} mm"]


def format_part_name(name: str) -> str:
    """The header line that names a part.

    If characters of the name are replaced or cut off, the digest of the whole name follows, so that
    the lines of two parts always differ.
    """
    line = f"part: {name}"
    if harmless(line) == line:
        return line
    digest = hashlib.sha256(name.encode("utf-8", "surrogateescape")).hexdigest()
    return f"part: {harmless(name, _LONGEST_NAME)} - name {digest[:_DIGITS]}"


def _is_taught(part: Part) -> bool:
    return isinstance(part, Recorded) and part.run.whole


def _list_tool_lines(job: Job, cell: Cell) -> tuple[str, ...]:
    """The lines on the tools and their frames. The tools of all operations are in each program."""
    lines = []
    for step_job in make_step_jobs(job):
        frame = frame_of(step_job, cell) if job.operations else cell.flange_from_tool
        lines.append(format_tool(step_job.tool.name, step_job.tool.diameter, frame))
    return tuple(dict.fromkeys(lines))


class ProgramFile(Struct, frozen=True):
    """The text of a file, with the line ends of its controller.

    Its bytes are made on demand, so that a program of a hundred megabytes is not held twice.
    """

    text: str
    newline: str

    def __bytes__(self) -> bytes:
        return self.text.replace("\n", self.newline).encode("ascii")

    def head(self, count: int) -> bytes:
        """The first bytes, `count` or more, without making all of them."""
        return bytes(ProgramFile(self.text[:count], self.newline))

    @property
    def lines(self) -> int:
        """The number of lines."""
        return self.text.count("\n")

    def __len__(self) -> int:
        return len(self.text) + self.lines * (len(self.newline) - 1)


def list_program_files(
    result: Result, folder: Path, file: Path | None
) -> list[tuple[Path, ProgramFile]]:
    """The program files with the paths to which they are written.

    folder: folder of the files.
    file: path of a program with one file; None for the name of the post in `folder`.
    """
    newline = result.post.newline
    files = [(folder / output.name, ProgramFile(output.text, newline)) for output in result.files]
    if file is not None and len(result.counts) == 1:
        if len(files) > 1 and file.name != files[0][0].name:
            raise JobError(
                str(file),
                f"the program takes {len(files)} files, which call each other by name",
                remedy="give a folder with -o",
            )
        files[0] = (file, files[0][1])
    return files
