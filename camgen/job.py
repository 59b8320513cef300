"""From drawings to a checked program: ``build`` runs the five arrows of the house and proves the text.

Nothing is printed and nothing written here; the command line does that with the ``Result``.
"""

from __future__ import annotations

import difflib
import hashlib
import math
import os
import stat
from collections.abc import Callable, Mapping, Sequence
from functools import cached_property
from pathlib import Path

import msgspec
from msgspec import Struct
from msgspec.structs import replace

from camgen import __version__
from camgen.check import Deviation, compare
from camgen.cli_job import from_mapping, load
from camgen.errors import InputError, JobError, NoSafeProgram
from camgen.ir import Program
from camgen.leads import add_leads
from camgen.lower import lower, placed
from camgen.paths import ToolPath, Tour
from camgen.planners import plan
from camgen.plugins import find_post, find_readback, make_post
from camgen.pose import Pose, fixed_xyz
from camgen.post import Cell, OutputFile, Post
from camgen.reach import Reach, reached
from camgen.readers import read
from camgen.report import Motions, sum_up
from camgen.report import report as report_of
from camgen.robots.models import robot
from camgen.settings import Job
from camgen.shapes import Note, Part
from camgen.text import short
from camgen.tour import order, travel

#: What ``build`` calls when it begins a stage: its name as the user sees it.
Watch = Callable[[str], None]


class Result(Struct, frozen=True, eq=False, dict=True):
    """What a build made. All lengths mm, angles rad, times s.

    part: what was read. tour: the paths in order, with their leads. program: as the text says it, arcs already
    replaced where the controller has none. files: the text with LF line ends. deviation: of the text read back.
    motions: the sums of the program. reach: what ``cell.robot`` found, None where no robot is given.
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
    reach: Reach | None = None

    @cached_property
    def report(self) -> dict[str, object]:
        """The contract's report as plain data."""
        files = [file.name for file in self.files]
        checked = {} if self.reach is None else {"reach": "ok", "limits": "ok"}
        seconds, deviation = self.motions.seconds, self.deviation.max_mm
        return report_of(self.part, self.tour, self.notes, seconds, deviation, files, checked)

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
    watch: Watch = lambda _: None,
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
    digest = _digest(settings, sources)
    part = joined([_read(source, settings) for source in sources])
    tour, notes, cell = _planned(part, settings, poster, strict, watch)
    watch("programming")
    header = _header(sources, part, poster, settings, cell, digest)
    title = poster.program or name or part.name
    program = poster.prepare(lower(tour, cell, settings, title, header), settings.tolerance.chord)
    reach = reached(program, robot(settings.cell.robot), part.source) if settings.cell.robot else None
    files = poster.render(program)
    watch("verifying")
    reading = readback({file.name: file.text for file in files}, settings.post)
    deviation = compare(program, reading, poster.tolerance(), poster.carried(), files[0].name)
    motions = sum_up(program.columns)
    return Result(part, settings, poster, cell, tour, notes, program, files, deviation, motions, reach)


def joined(parts: Sequence[Part]) -> Part:
    """Several parts in one work frame as one. Contour ids get the place of their input in front: ``2/c7``."""
    if len(parts) == 1:
        return parts[0]
    if any(part.raster is not None for part in parts):
        name = next(part.source for part in parts if part.raster is not None)
        raise InputError(name, "a picture makes a program by itself", remedy="build it alone")
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


def _planned(part: Part, job: Job, poster: Post, strict: bool, watch: Watch) -> tuple[Tour, tuple[Note, ...], Cell]:
    """The tour of the paths, all notes and the cell in which the program will run."""
    watch("planning")
    planned = plan(part, job)
    notes = part.notes + planned.notes
    _insist(part, notes, bool(planned.paths), strict)
    watch("ordering")
    cell = placed(poster.cell(), job)
    tour, lead_notes = _toured(planned.paths, part, job, cell)
    notes += lead_notes
    _insist(part, notes, bool(tour.paths), strict)
    return tour, notes, cell


def _toured(paths: Sequence[ToolPath], part: Part, job: Job, cell: Cell) -> tuple[Tour, tuple[Note, ...]]:
    """The paths in order from and back to home, with their leads."""
    start = cell.home.origin[:2] if isinstance(cell.home, Pose) else None
    tour = order(paths, job.tour.method, start, job.operation.inside_first)
    led, notes = add_leads(tour.paths, part, job)
    return Tour(tuple(led), travel(led, start), tour.method), tuple(notes)


def _insist(part: Part, notes: Sequence[Note], something: bool, strict: bool) -> None:
    """NoSafeProgram when nothing is left to do, or, where ``strict``, when something was left out."""
    skipped = [note for note in notes if note.kind == "skipped"]
    if not part.contours:
        raise InputError(part.source, "nothing to work on", remedy="camgen inspect shows what the file holds")
    if not something:
        # What the planner left out comes last; what the reader left out is not why the contours have no path.
        last = next((note for note in reversed(skipped) if note not in part.notes), Note("skipped", "nothing fits"))
        raise NoSafeProgram(part.source, f"no path is left: {last.what}", last.why)
    if strict and skipped:
        what = f"--strict and {len(skipped)} left out, first: {skipped[0].what}"
        raise NoSafeProgram(part.source, what, skipped[0].why, "mend the input, or build without --strict")


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


def _digest(job: Job, sources: Sequence[Path]) -> str:
    """Twelve hex digits that stand for the settings and the bytes of all files that are read."""
    if not sources:
        raise InputError("input", "none is given")
    total = hashlib.sha256(msgspec.json.encode(_own(job), order="deterministic"))
    seen: dict[str, Path] = {}
    for source in sources:
        data = readable(source)
        real = os.path.realpath(source)
        if real in seen:
            raise InputError(str(source), "is given twice", remedy="name every input once")
        seen[real] = source
        total.update(b"%d:" % len(data))
        total.update(data)
    for name in (job.image.background, job.camera.file):
        if name:
            total.update(readable(Path(name)))
    return total.hexdigest()[:12]


def _own(job: Job) -> dict[str, object]:
    """What the job sets differently from the defaults: a new setting leaves the programs of old jobs as they are."""
    image, camera = job.image, job.camera
    # Of a file its bytes count, wherever it lies.
    image = replace(image, background=Path(image.background).name)
    camera = replace(camera, file=Path(camera.file).name)
    tables = msgspec.to_builtins(replace(job, image=image, camera=camera))
    defaults = msgspec.to_builtins(Job())
    return {
        name: {key: value for key, value in table.items() if value != defaults[name].get(key)}
        for name, table in tables.items()
        if table != defaults[name]
    }


def readable(source: Path) -> bytes:
    """The bytes of an input. InputError when there are none: missing, a folder, not to be read."""
    try:
        mode = source.stat().st_mode
        if stat.S_ISDIR(mode):
            raise InputError(str(source), "is a folder", remedy="name the files in it")
        if not stat.S_ISREG(mode):
            raise InputError(str(source), "is not a regular file", remedy="copy it to a file, or use - with --format")
        data = source.read_bytes()
    except FileNotFoundError as error:
        raise InputError(str(source), "no such file", remedy=_nearest(source)) from error
    except (OSError, ValueError) as error:  # ValueError: a zero byte in the name
        reason = getattr(error, "strerror", None) or str(error)
        raise InputError(str(source), f"cannot be read: {reason}") from error
    return data


def _nearest(source: Path) -> str:
    try:
        stems = {Path(name).stem: name for name in sorted(os.listdir(source.parent))}
    except OSError:
        return "its folder does not exist"
    near = difflib.get_close_matches(source.stem, stems, 1)
    return f"nearest is {source.parent / stems[near[0]]}" if near else ""
