"""The arrows of the house as a user calls them: what ``build`` does in one call, stage by stage.

Each takes what the one before gave, a job (a mapping as in a job file, its path, or a ``Job``; left out: the
defaults), and the cell in which the program will run: what ``cell`` gives, or the name of a post, whose own it is then.
Lengths mm, angles rad, times s. Each raises a CamgenError.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from msgspec.structs import replace

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
from camgen.model.signature import sign
from camgen.order import order as order_plan
from camgen.pipeline import Input, JobLike, Result, path_or_part, poster_of, settings_of
from camgen.pipeline.fixtures import leave_out_blocked
from camgen.pipeline.inputs import read_cell, read_parts
from camgen.pipeline.rounding import limit_path_tolerance
from camgen.plan import EdgePlan, Plan, Watch, ignore_stages
from camgen.plan import plan as plan_part
from camgen.post import OutputFile
from camgen.post.contract import prepare_program, render_program
from camgen.post.limits import limit_tolerance
from camgen.post.plugins import cell_of, fill_tables, find_post, find_readback
from camgen.post.verify import Deviation, compare
from camgen.preview.drawings import draw
from camgen.read.files import Files
from camgen.read.made import make_part
from camgen.robots.workcell import Workcell

if TYPE_CHECKING:
    from camgen.collision.cell import Surroundings

#: A cell, or the name of the post whose own it is.
CellLike = Workcell | str


def job(tables: JobLike = None) -> Job:
    """The settings of ``tables``, checked; what they leave out has its default. JobError for what makes no sense."""
    return settings_of(tables, Files())


def part(shape: Any, name: str = "part", layer: str = "0") -> Part:
    """A part made in code from ``shape``, mm: points (N, 2), a list of such chains, a shapely geometry, or a trimesh.

    A chain whose last point is its first is closed. InputError for what is no shape.
    """
    return make_part(shape, name, layer)


def read(inputs: Input | Sequence[Input], job: JobLike = None) -> Part:
    """The part in one file, or in several in one work frame. InputError where there is none."""
    settings, files = settings_of(job, Files()), Files()
    sources = path_or_part(inputs)
    return read_parts(sources, settings, files)


def cell(post: str, job: JobLike = None, part: Part | None = None) -> Workcell:
    """The cell of the post ``post`` with what ``job`` says of frames, home, arm and fixtures.

    part: a 3-D part is checked with the arm of the post where the job names none.
    """
    files = Files()
    settings = settings_of(job, files)
    return read_cell(part, settings, _own_cell(post, settings), files)


def plan(
    part: Part, job: JobLike = None, cell: CellLike | None = None, watch: Watch = ignore_stages
) -> Plan:
    """The tool paths of ``part``. cell: edges of 3-D parts need one with an arm. watch: is told the stages."""
    settings = settings_of(job, Files())
    workcell = _cell(cell, settings, part)
    return leave_out_blocked(plan_part(part, settings, workcell, watch), settings, workcell)


def order(
    plan: Plan, job: JobLike = None, cell: CellLike | None = None, watch: Watch = ignore_stages
) -> Tour:
    """The paths of a plan as one tour. cell: the tool comes from its home and goes back. watch: as in ``plan``."""
    settings = settings_of(job, Files())
    return order_plan(plan, settings, _cell(cell, settings, plan.part), watch)


def lower(
    tour: Tour,
    job: JobLike = None,
    cell: CellLike | None = None,
    name: str = "part",
    header: Sequence[str] = (),
) -> Program:
    """The program that runs ``tour`` from and back to the home of ``cell``. name, header: of the program."""
    settings = settings_of(job, Files())
    return lower_tour(tour, _take_cell(cell, settings), settings, name, tuple(header))


def check(
    program: Program, job: JobLike = None, cell: CellLike | None = None, plan: Plan | None = None
) -> Checks:
    """Reach, joint limits and collisions of ``program`` with the arm of ``cell``, links included; nothing without one.

    plan: of a 3-D part, which knows what there is to run into. NoSafeProgram with the motion and the reason.
    """
    settings = settings_of(job, Files())
    where: Surroundings | None = plan.where if isinstance(plan, EdgePlan) else None
    return check_program(program, settings, _take_cell(cell, settings), where)


def post(program: Program, post: str, job: JobLike = None) -> tuple[OutputFile, ...]:
    """``program`` as the files of the controller ``post``. Refused for an instruction that it cannot do."""
    settings = limit_path_tolerance(settings_of(job, Files()), post)
    poster = poster_of(post, settings, "job")
    rendered = render_program(poster, prepare_program(poster, program, settings.tolerance.chord))
    return tuple(replace(file, text=sign(file.text)) for file in rendered)


def read_back(
    files: Sequence[OutputFile] | Mapping[str, str], post: str, job: JobLike = None
) -> Executed:
    """The strict run of the text of a program: its instructions with their lines, and its findings.

    files: texts by name.
    """
    texts = files if isinstance(files, Mapping) else {file.name: file.text for file in files}
    settings = limit_path_tolerance(settings_of(job, Files()), post)
    return find_readback(post)(texts, fill_tables(find_post(post), settings.post))


def verify(
    files: Sequence[OutputFile], program: Program, post: str, job: JobLike = None
) -> Deviation:
    """How far the text is from ``program``. VerifyError with the first line that does not say what was planned."""
    settings = limit_path_tolerance(settings_of(job, Files()), post)
    poster = poster_of(post, settings, "job")
    chord = settings.tolerance.chord
    planned = prepare_program(poster, program, chord)
    executed = read_back(files, post, settings)
    tolerance = limit_tolerance(poster.tolerance(), chord)
    return compare(planned, executed, tolerance, poster.list_verified(), files[0].name)


def preview(result: Result, suffix: str = ".svg") -> bytes:
    """The preview of a build: a drawing (".svg"), a page (".html") or a picture (".png")."""
    return draw(result, Path(f"preview{suffix}"))


def _cell(cell: CellLike | None, job: Job, part: Part) -> Workcell | None:
    if not isinstance(cell, str):
        return cell
    return read_cell(part, job, _own_cell(cell, job), Files())


def _take_cell(cell: CellLike | None, job: Job) -> Workcell:
    """The frames and the home of a program are never guessed."""
    if cell is None:
        raise JobError(
            "cell",
            "is not given",
            remedy='give what camgen.cell makes, or the name of a post: "rapid"',
        )
    return read_cell(None, job, _own_cell(cell, job), Files()) if isinstance(cell, str) else cell


def _own_cell(post: str, job: Job) -> Cell:
    """The built-in cell of the post of this name, with the options of ``job``."""
    return cell_of(poster_of(post, job, "job"), job)
