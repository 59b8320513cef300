"""From drawings to a checked program: ``build`` runs the five arrows of the house and proves the text.

Nothing is printed and nothing written here; the command line does that with the ``Result``.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

from msgspec import Struct
from msgspec.structs import replace

from camgen import __version__
from camgen.check import Deviation, compare
from camgen.cli_job import from_mapping, load
from camgen.cycle.total import cycle
from camgen.errors import InputError, JobError
from camgen.gcode.recorded import Recorded
from camgen.ir import Program
from camgen.lower import placed
from camgen.page_fit import on_page
from camgen.paths import Tour
from camgen.planners.coverage import Coverage
from camgen.plans import Planned, Watch, unwatched, way
from camgen.plugins import find_post, find_readback, make_post
from camgen.pose import Pose, fixed_xyz
from camgen.post import Cell, OutputFile, Pace, Post
from camgen.readers import read
from camgen.report import Cycle, Motions, sum_up
from camgen.report import report as report_of
from camgen.robots.urdf_name import split_name
from camgen.settings import Job
from camgen.shapes import Note, Part
from camgen.sources import digest_of
from camgen.text import short

if TYPE_CHECKING:
    from camgen.collide import Clear
    from camgen.reach import Reach
    from camgen.robots.models import Robot
    from camgen.surroundings import Surroundings


class Result(Struct, frozen=True, eq=False, dict=True):
    """What a build made. All lengths mm, angles rad, times s.

    part: what was read. tour: the paths in order, with their leads. program: as the text says it, arcs already
    replaced where the controller has none. files: the text with LF line ends. deviation: of the text read back.
    motions: the sums of the program. cycle: its time. reach, clear: what the check with a robot found, None where there
    is none. coverage: of a fill. arm, where: the robot and what it was tested against, None where there is none.
    """

    part: Part
    job: Job
    post: Post
    cell: Cell
    tour: Tour
    notes: tuple[Note, ...]
    program: Program
    files: tuple[OutputFile, ...]
    deviation: Deviation
    motions: Motions
    cycle: Cycle
    reach: Reach | None = None
    clear: Clear | None = None
    coverage: Coverage | None = None
    arm: Robot | None = None
    where: Surroundings | None = None

    @cached_property
    def report(self) -> dict[str, object]:
        """The contract's report as plain data."""
        files = [file.name for file in self.files]
        checked = {} if self.reach is None else {"reach": "ok", "limits": "ok", "collision": "ok"}
        found = (self.part, self.tour, self.notes, self.cycle, self.deviation.max_mm, files, checked)
        return report_of(*found, self.coverage)

    @property
    def text(self) -> str:
        """The program: the text of all its files, one after the other."""
        return "".join(file.text for file in self.files)


def build(
    inputs: str | Path | Sequence[str | Path],
    *,
    post: str,
    job: Mapping[str, object] | Job | str | Path | None = None,
    name: str = "",
    strict: bool = False,
    watch: Watch = unwatched,
) -> Result:
    """A checked program for the controller ``post`` from one or several drawings in one work frame.

    job: tables as in a job file, the path of one, or nothing: the defaults (no file is looked for). name: of the
    program, the first input's name without suffix when empty. strict: what was skipped is an error. watch: is told
    the stages. Raises a CamgenError.
    """
    sources = [Path(inputs)] if isinstance(inputs, (str, Path)) else [Path(one) for one in inputs]
    settings = _settings(job)
    poster = _poster(post, settings, str(job) if isinstance(job, (str, Path)) else "job")
    readback = find_readback(post)
    watch("reading")
    digest = digest_of(settings, sources)
    part = _thinned(on_page(joined([_read(source, settings) for source in sources]), settings), settings)
    cell = placed(poster.cell(), settings)
    planned = way(part, settings)(part, settings, cell, strict, watch)
    watch("programming")
    header = _header(sources, part, poster, settings, cell, digest)
    title = poster.program or name or part.name
    program = poster.prepare(planned.lowered(title, header), settings.tolerance.chord)
    tour, notes, arm = planned.tour, planned.notes, planned.arm
    notes += _of_urdf(settings.cell.robot, arm)
    if arm:
        watch("checking")
    reach = _reach(program, arm, part.source) if arm else None
    program = reach.program if reach else program
    where, clear = _clear(part, settings, cell, planned, reach) if reach else (None, None)
    files = poster.render(program)
    watch("verifying")
    reading = readback({file.name: file.text for file in files}, settings.post)
    deviation = compare(program, reading, poster.tolerance(), poster.carried(), files[0].name)
    motions, pace = sum_up(program.columns), pace_of(poster, settings)
    time = cycle(program, tour, pace, reach, arm)
    made = (part, settings, poster, cell, tour, notes, program, files, deviation, motions, time, reach, clear)
    return Result(*made, planned.coverage, arm, where)


def pace_of(post: Post, job: Job) -> Pace:
    """What the post takes its machine to do, with the acceleration of the job."""
    own, pace = job.process.acceleration, post.pace()
    return replace(pace, acceleration=own) if own else pace


def joined(parts: Sequence[Part]) -> Part:
    """Several parts in one work frame as one. Contour ids get the place of their input in front: ``2/c7``."""
    if len(parts) == 1:
        return parts[0]
    alone = [part for part in parts if part.raster is not None or part.solid is not None or isinstance(part, Recorded)]
    if alone:
        what = "picture" if alone[0].raster is not None else "program" if alone[0].solid is None else "3-D part"
        raise InputError(alone[0].source, f"a {what} makes a program by itself", remedy="build it alone")
    contours = [replace(c, id=f"{k}/{c.id}") for k, part in enumerate(parts, 1) for c in part.contours]
    notes = [replace(note, what=f"{part.source}: {note.what}") for part in parts for note in part.notes]
    return Part(
        name=parts[0].name,
        source=" + ".join(part.source for part in parts),
        units=" + ".join(dict.fromkeys(part.units for part in parts)),
        contours=tuple(contours),
        notes=tuple(notes),
    )


def _read(source: Path, job: Job) -> Part:
    """A reader knows its file by name only; the user is told the path that he gave."""
    try:
        return read(source, job)
    except InputError as error:
        if error.file != source.name:
            raise
        raise InputError(str(source), error.what, error.where, error.remedy) from error


def _settings(job: Mapping[str, object] | Job | str | Path | None) -> Job:
    if isinstance(job, Job):
        return job
    if isinstance(job, Mapping):
        return from_mapping(job)
    return load(None if job is None else Path(job))


def _poster(name: str, job: Job, origin: str) -> Post:
    """The post with its options; what is wrong with one is told with the file that it stands in."""
    kind = find_post(name)
    try:
        return make_post(kind, job.post)
    except JobError as error:
        raise JobError(origin, error.what, error.file, error.remedy) from error


def _thinned(part: Part, job: Job) -> Part:
    if part.raster is None and not job.tolerance.simplify and not job.input.min_length:
        return part
    from camgen.simplify import simplified  # noqa: PLC0415 (OpenCV is loaded only by what needs it)

    return simplified(part, job)


def _reach(program: Program, arm: Robot, file: str) -> Reach:
    from camgen.reach import reached  # noqa: PLC0415 (kinematics, only for what needs them)

    return reached(program, arm, file)


def _clear(part: Part, job: Job, cell: Cell, planned: Planned, reach: Reach) -> tuple[Surroundings, Clear]:
    """What there is to run into, and the test of the whole program, links included, for collisions."""
    from camgen.collide import collided  # noqa: PLC0415 (fcl is loaded only by what needs it)
    from camgen.surroundings import around  # noqa: PLC0415

    assert planned.arm is not None
    where = planned.where or around(job, planned.arm, cell, None)
    return where, collided(where, reach.program, reach, part.source)


def _of_urdf(name: str, arm: Robot | None) -> tuple[Note, ...]:
    """What was assumed of an arm that a URDF describes; the built-in ones are described to the end."""
    described = split_name(name)
    if not (described and arm):
        return ()
    file = Path(described[0]).name
    why = "their zeros and signs need not be the controller's: compare one pose with the teach pendant"
    notes = [Note("assumed", f"{file}: {note}") for note in arm.notes]
    return (*notes, Note("warning", f"{file}: home and posture are in the joint values of the URDF", why))


def _header(sources: Sequence[Path], part: Part, post: Post, job: Job, cell: Cell, digest: str) -> tuple[str, ...]:
    return (
        f"camgen {__version__} - job {digest}",
        *(f"part: {source.name}" for source in sources),
        f"post: {post.name} - cell: {cell.name.replace(',', ' -')}",
        f"units: mm - drawing: {part.units}",
        f"tool: diameter {short(job.tool.diameter, 3)} mm - frame {_frame(cell.flange_from_tool)}",
        f"work frame: {_frame(cell.base_from_work)}",
    )


def _frame(pose: Pose) -> str:
    """The origin x y z in mm and rx ry rz in deg (contract, section 3)."""
    angles = (math.degrees(angle) for angle in fixed_xyz(pose.rotation))
    return " ".join([*(short(v, 3) for v in pose.origin), *(short(a, 4) for a in angles)])
