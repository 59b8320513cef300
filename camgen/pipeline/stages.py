"""The stages of a build as single calls; `build` runs all of them in one call.

Each stage takes the result of the previous one and up to two more values:

- the job: a mapping as in a job file, the path of a job file, or a `Job`; None for the defaults;
- the cell in which the program will run: a result of `cell`, or the name of a post, whose built-in
  cell it is then.

Lengths are in mm, angles in rad, times in s. Each stage raises a CamgenError.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from camgen.check import Checks
from camgen.check import check as check_program
from camgen.lang.programs import Executed
from camgen.lower import lower as lower_tour
from camgen.model.cell import Cell
from camgen.model.errors import JobError
from camgen.model.job import Job
from camgen.model.part import Part
from camgen.model.path import Tour
from camgen.model.program import Program
from camgen.order import order as order_plan
from camgen.pipeline import Input, JobLike, Result, list_inputs, load_settings, make_job_post
from camgen.pipeline.fixtures import leave_out_blocked
from camgen.pipeline.inputs import read_cell, read_parts
from camgen.pipeline.programs import print_program
from camgen.pipeline.rounding import limit_path_tolerance
from camgen.plan import EdgePlan, Plan, Watch, ignore_stages
from camgen.plan import plan as plan_part
from camgen.post import OutputFile
from camgen.post.contract import prepare_program
from camgen.post.limits import limit_tolerance
from camgen.post.plugins import cell_of, fill_tables, find_post, find_readback
from camgen.post.verify import Deviation, compare
from camgen.preview.drawings import draw_preview
from camgen.read.files import Files
from camgen.read.made import make_part
from camgen.robots.workcell import Workcell

if TYPE_CHECKING:
    from camgen.collision.cell import CellScene

#: A cell, or the name of a post, whose built-in cell it is.
CellLike = Workcell | str


def job(tables: JobLike = None) -> Job:
    """The checked settings of `tables`, with the defaults for all others. Raises JobError."""
    return load_settings(tables, Files())


def part(shape: Any, name: str = "part", layer: str = "0") -> Part:
    """A part made in code.

    shape: points (N, 2), a list of such chains, a shapely geometry, or a trimesh, mm. A chain
        whose last point is its first is closed.

    Raises InputError for anything else.
    """
    return make_part(shape, name, layer)


def read(inputs: Input | Sequence[Input], job: JobLike = None) -> Part:
    """The part in one file, or in several in one work frame. Raises InputError for an empty one."""
    settings, files = load_settings(job, Files()), Files()
    return read_parts(list_inputs(inputs), settings, files)


def cell(post: str, job: JobLike = None, part: Part | None = None) -> Workcell:
    """The cell of the post `post` with the frames, home, arm and fixtures of `job`.

    part: a 3-D part gets the arm of the post if the job names none.
    """
    files = Files()
    settings = load_settings(job, files)
    return read_cell(part, settings, _make_post_cell(post, settings), files)


def plan(
    part: Part, job: JobLike = None, cell: CellLike | None = None, watch: Watch = ignore_stages
) -> Plan:
    """The tool paths of `part`.

    cell: the cell; edges of 3-D parts need one with an arm.
    watch: called with the name of each stage.
    """
    settings = load_settings(job, Files())
    workcell = _find_cell(cell, settings, part)
    return leave_out_blocked(plan_part(part, settings, workcell, watch), settings, workcell)


def order(
    plan: Plan, job: JobLike = None, cell: CellLike | None = None, watch: Watch = ignore_stages
) -> Tour:
    """The paths of a plan as one tour.

    cell: the cell, at whose home the tour starts and ends.
    watch: called with the name of each stage.
    """
    settings = load_settings(job, Files())
    return order_plan(plan, settings, _find_cell(cell, settings, plan.part), watch)


def lower(
    tour: Tour,
    job: JobLike = None,
    cell: CellLike | None = None,
    name: str = "part",
    header: Sequence[str] = (),
) -> Program:
    """The program that runs `tour` from the home of `cell` and back.

    name: name of the program.
    header: remarks at its beginning.
    """
    settings = load_settings(job, Files())
    return lower_tour(tour, _take_cell(cell, settings), settings, name, tuple(header))


def check(
    program: Program, job: JobLike = None, cell: CellLike | None = None, plan: Plan | None = None
) -> Checks:
    """Check reach, joint limits and collisions of `program`, links included, for the arm of `cell`.

    plan: plan of a 3-D part, which has the bodies for the collision tests.

    Without an arm nothing is checked. Raises NoSafeProgram with the motion and the reason.
    """
    settings = load_settings(job, Files())
    where: CellScene | None = plan.where if isinstance(plan, EdgePlan) else None
    return check_program(program, settings, _take_cell(cell, settings), where)


def post(program: Program, post: str, job: JobLike = None) -> tuple[OutputFile, ...]:
    """The files of `program` for the controller `post`.

    Raises Refused for an instruction that the controller does not have.
    """
    settings = limit_path_tolerance(load_settings(job, Files()), post)
    poster = make_job_post(post, settings, "job")
    return print_program(poster, prepare_program(poster, program, settings.tolerance.chord))


def read_back(
    files: Sequence[OutputFile] | Mapping[str, str], post: str, job: JobLike = None
) -> Executed:
    """The strict run of the text of a program: its instructions with their lines, and its findings.

    files: texts by name.
    """
    texts = files if isinstance(files, Mapping) else {file.name: file.text for file in files}
    settings = limit_path_tolerance(load_settings(job, Files()), post)
    return find_readback(post)(texts, fill_tables(find_post(post), settings.post))


def verify(
    files: Sequence[OutputFile], program: Program, post: str, job: JobLike = None
) -> Deviation:
    """The deviation of the text `files` from `program`.

    Raises VerifyError with the first line that differs from the program.
    """
    settings = limit_path_tolerance(load_settings(job, Files()), post)
    poster = make_job_post(post, settings, "job")
    chord = settings.tolerance.chord
    planned = prepare_program(poster, program, chord)
    executed = read_back(files, post, settings)
    tolerance = limit_tolerance(poster.tolerance(), chord)
    return compare(planned, executed, tolerance, poster.list_verified(), files[0].name)


def preview(result: Result, suffix: str = ".svg") -> bytes:
    """The preview of a build: a drawing (".svg"), a page (".html") or a picture (".png")."""
    return draw_preview(result, Path(f"preview{suffix}"))


def _find_cell(cell: CellLike | None, job: Job, part: Part | None) -> Workcell | None:
    if not isinstance(cell, str):
        return cell
    return read_cell(part, job, _make_post_cell(cell, job), Files())


def _take_cell(cell: CellLike | None, job: Job) -> Workcell:
    """The cell of a program. Raises JobError for None: frames and home are never guessed."""
    workcell = _find_cell(cell, job, None)
    if workcell is None:
        raise JobError(
            "cell",
            "is not given",
            remedy='give a result of camgen.cell, or the name of a post: "rapid"',
        )
    return workcell


def _make_post_cell(post: str, job: Job) -> Cell:
    """The built-in cell of the post `post` with the options of `job`."""
    return cell_of(make_job_post(post, job, "job"), job)
