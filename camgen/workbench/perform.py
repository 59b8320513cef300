"""One build for the workbench: what ``camgen build`` makes of the same job, and what its pages show of it."""

from __future__ import annotations

import gc
from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path
from time import perf_counter

from msgspec import Struct
from msgspec.structs import replace

from camgen.check.report import clean
from camgen.model.errors import CamgenError, InputError, rename_errors
from camgen.model.files import Source
from camgen.model.part import Part, Raster
from camgen.model.path import ToolPath, Tour
from camgen.model.pose import to_vec3
from camgen.order.tours import JobTour
from camgen.pipeline import ProgramFile, Result, build, list_program_files
from camgen.pipeline.memory import no_collector
from camgen.plan import Watch, kind_of
from camgen.plan.propose import propose
from camgen.preview.page import Edits, page
from camgen.preview.view import view
from camgen.read import find_reader, read
from camgen.read.files import Files
from camgen.read.job_file import load_job
from camgen.read.layers import Layers
from camgen.workbench.form import find_place
from camgen.workbench.session import rows_of, tables_of
from camgen.workbench.usual import Usual, usual_in

#: Label, text and tone of a line of the summary.
Row = tuple[str, str, str]
#: The kinds of parts whose paths may be run in another order and begin elsewhere.
MOVABLE = ("drawing", "picture")
#: The summary of a build as the command line tells it: of the result, the job file, the inputs and the programs.
Tell = Callable[
    [Result, Path | None, Sequence[Path], Sequence[tuple[Path, ProgramFile]], int], list[Row]
]


class Ask(Struct, frozen=True):
    """What to build. text: of the job file, which is not read from the disk. output: the folder of the program.
    propose: operations are asked for as well.
    """

    number: int
    inputs: tuple[Path, ...]
    post: str
    job_file: Path
    text: str
    output: Path
    propose: bool = False


class Layer(Struct, frozen=True):
    """A layer of the input, the number of its contours, and whether the job asks for it."""

    name: str
    contours: int
    used: bool


class Run(Struct, frozen=True):
    """What a path works on: ids of contours, or of one edge, and the row of ``[[operations]]``, -1 without rows. seam:
    x, y, z (mm) where a closed one begins, leads left away. point: that of ``tour.seams`` which says so. ordered:
    whether ``tour.order`` names it. id: of the path, as the page has it.
    """

    contours: tuple[str, ...]
    row: int
    seam: tuple[float, float, float] | None = None
    point: tuple[float, ...] | None = None
    ordered: bool = False
    id: str = ""


class Looked(Struct, frozen=True):
    """What the page needs to know of the input to choose in it.

    kind: of the part. layers: all that the input has. contours: ids and layers of what is worked on or could be.
    worked: ids of contours by row of ``[[operations]]``. runs: the paths in the order of the program. select: whether
    edges are chosen by input.select.
    """

    kind: str
    layers: tuple[Layer, ...] = ()
    contours: tuple[tuple[str, str], ...] = ()
    worked: tuple[tuple[str, ...], ...] = ()
    runs: tuple[Run, ...] = ()


class Built(Struct, frozen=True):
    """A good build. page: HTML. programs: as they will be written. rows: the summary. opened: the files that were read,
    by their identity. picture: the stages of a photo or a drawing as SVG, "" where the input is no picture. usual: what
    held where the job is silent.
    """

    number: int
    page: str
    programs: tuple[tuple[Path, bytes], ...]
    rows: tuple[Row, ...]
    looked: Looked
    opened: dict[str, Path]
    picture: str
    seconds: float
    usual: Usual


class Failed(Struct, frozen=True):
    """No program. line: what the command line says, code: what it returns. place: the setting that it is about.
    picture: how far a photo came.
    """

    number: int
    line: str
    code: int
    place: tuple[str | int, ...]
    opened: dict[str, Path]
    picture: str = ""


class Proposed(Struct, frozen=True):
    """Rows for the job that the contours ask for. thickness: of the material that their depths are for, mm."""

    number: int
    tools: tuple[dict[str, object], ...]
    operations: tuple[dict[str, object], ...]
    thickness: float


Outcome = Built | Failed | Proposed


def perform(ask: Ask, watch: Watch, tell: Tell) -> Outcome:
    """The outcome of a build. What ends it from outside (``watch`` may raise) goes through."""
    files = Files([Source(ask.job_file, ask.text.encode())])
    begun = perf_counter()
    with no_collector():
        try:
            with rename_errors("job", str(ask.job_file)):
                return (
                    _propose(ask, files) if ask.propose else _build(ask, files, watch, tell, begun)
                )
        except CamgenError as error:
            line, code, place = f"error: {error}", error.exit_code, tuple(find_place(error))
        except Exception as error:  # whatever it is, it is a line in the page, as in cli.main
            line, code, place = f"fault: {type(error).__name__}: {error}", 1, ()
        finally:
            gc.collect()
        return Failed(ask.number, line, code, place, dict(files.opened), _far(ask, files))


def _build(ask: Ask, files: Files, watch: Watch, tell: Tell, begun: float) -> Built:
    job = load_job(ask.job_file, (), files)
    result = build(ask.inputs, post=ask.post, job=job, watch=watch, files=files)
    programs = list_program_files(result, ask.output, None)
    watch("drawing")
    runs = find_runs(result)
    shown = page(view(result), _edits(runs) if kind_of(result.part) in MOVABLE else None)
    return Built(
        number=ask.number,
        page=shown,
        programs=tuple((path, bytes(file)) for path, file in programs),
        rows=tuple(tell(result, ask.job_file if ask.text else None, ask.inputs, programs, 1)),
        looked=_look(ask, result, files, runs),
        opened=dict(files.opened),
        picture=_stages(result),
        seconds=perf_counter() - begun,
        usual=usual_in(result),
    )


# What the input has.


def _look(ask: Ask, result: Result, files: Files, runs: tuple[Run, ...]) -> Looked:
    kind = kind_of(result.part)
    if kind == "solid":
        return Looked(kind, runs=runs)
    contours = tuple((contour.id, contour.layer) for contour in result.part.contours)
    worked = [dict[str, None]() for _ in result.job.operations]
    for run in runs:
        if run.row >= 0:
            worked[run.row].update(dict.fromkeys(run.contours))
    return Looked(
        kind=kind,
        layers=_layers(ask, result, files),
        contours=contours,
        worked=tuple(tuple(ids) for ids in worked),
        runs=runs,
    )


def find_runs(result: Result) -> tuple[Run, ...]:
    """The paths in the order of the program."""
    tour = result.tour
    if kind_of(result.part) not in MOVABLE:
        solid = result.part.solid is not None
        return tuple(
            Run(path.contours or ((path.id,) if solid else ()), -1, id=clean(path.id))
            for path in tour.paths
        )
    from camgen.plan.seams import has_seam  # noqa: PLC0415 (shapely, which flat parts have loaded)

    planned = {path.id: path for path in result.planned if has_seam(path)}
    rows = _rows_of_paths(tour)
    points = _find_points(result, planned, rows)
    named = set(result.job.tour.order)
    return tuple(
        Run(
            contours=path.contours,
            row=row,
            seam=_find_seam(path, planned[path.id]) if path.id in planned else None,
            point=points.get(path.id),
            ordered=not named.isdisjoint(path.contours),
            id=clean(path.id),
        )
        for path, row in zip(tour.paths, rows, strict=True)
    )


def _find_points(
    result: Result, planned: dict[str, ToolPath], rows: Sequence[int]
) -> dict[str, tuple[float, ...]]:
    """The point of ``tour.seams`` of each path that has one, by its id. rows: of ``[[operations]]``, of the paths."""
    if not result.job.tour.seams:
        return {}
    from camgen.plan.seams import choose_points, read_points  # noqa: PLC0415 (shapely, only for few jobs)

    names = list(planned)
    row_of = {path.id: row for path, row in zip(result.tour.paths, rows, strict=True)}
    own = [row_of.get(name, -1) for name in names]
    chosen, _ = choose_points(read_points(result.job), list(planned.values()), own, result.part)
    return {names[path]: tuple(result.job.tour.seams[number]) for path, number in chosen.items()}


def _find_seam(path: ToolPath, planned: ToolPath) -> tuple[float, float, float]:
    """Where the closed path ``planned`` begins in ``path``, which may have leads."""
    row = 0
    if not path.closed:
        from camgen.plan.seams import SAME_MM, project  # noqa: PLC0415 (shapely, only for few jobs)

        row = int(project(planned, path.position[0, :2])[2] > SAME_MM)
    return to_vec3(path.position[row])


def _edits(runs: Sequence[Run]) -> Edits:
    return Edits(
        tuple(run.seam for run in runs),
        tuple(run.point is not None for run in runs),
        tuple(run.ordered for run in runs),
    )


def _rows_of_paths(tour: Tour) -> list[int]:
    """The row of ``[[operations]]`` of each path, -1 where the job has none."""
    if not isinstance(tour, JobTour):
        return [-1] * len(tour.paths)
    return [row for row, one in zip(tour.numbers, tour.tours, strict=True) for _ in one.paths]


def _layers(ask: Ask, result: Result, files: Files) -> tuple[Layer, ...]:
    """All layers of drawings and curves, with those that the job leaves out."""
    if result.part.raster is not None:
        return ()
    globs = tuple(glob.strip().casefold() for glob in result.job.input.layers)
    found = _count_layers(result.part)
    if globs != ("*",):
        whole = replace(result.job, input=replace(result.job.input, layers=["*"]))
        found = sum((_count_layers(read(one, whole, files)) for one in ask.inputs), Counter[str]())
    asked = Layers({}, {}, globs)
    return tuple(
        Layer(name, count, not asked.why_not(name)) for name, count in sorted(found.items())
    )


def _count_layers(part: Part) -> Counter[str]:
    return Counter([contour.layer for contour in part.contours]) + Counter(
        [curve.layer for curve in part.curves]
    )


# Pictures.


def _stages(result: Result) -> str:
    if result.part.raster is None:
        return ""
    from camgen.preview.drawings import draw  # noqa: PLC0415 (only for pictures)

    return draw(result, Path("stages.svg")).decode()


def _far(ask: Ask, files: Files) -> str:
    """How far a photo came whose build failed: to its mask, or only to the photo. "" for no picture."""
    try:
        source = files.read(ask.inputs[0])
        if find_reader(source).makes != "picture":
            return ""
    except CamgenError:
        return ""
    try:
        part = read(ask.inputs[0], load_job(ask.job_file, (), files), files)
        return _mask(part, part.raster) if part.raster is not None else ""
    except CamgenError:
        return _photo(source)


def _mask(part: Part, raster: Raster) -> str:
    from camgen.preview.panels import (  # noqa: PLC0415 (only for pictures)
        WIDE,
        Panel,
        format_crop,
        format_image,
        format_sheet,
        make_crop,
    )

    crop = make_crop(raster)
    high = WIDE * raster.photo.shape[0] / raster.photo.shape[1]
    panels = [
        Panel("photo", high, [format_image(raster.photo, WIDE, high)]),
        Panel(f"to scale, {part.units}", crop.high, [format_crop(crop, raster.view)]),
        Panel("part and bench", crop.high, [format_crop(crop, raster.mask, smooth=False)]),
    ]
    return format_sheet(panels, part.notes, part.source)


def _photo(source: Source) -> str:
    from camgen.preview.panels import WIDE, Panel, format_image, format_sheet  # noqa: PLC0415 (only for pictures)
    from camgen.vision.image import read_picture as load_picture  # noqa: PLC0415 (OpenCV, only for pictures)

    try:
        photo = load_picture(source)
    except CamgenError:
        return ""
    high = WIDE * photo.pixels.shape[0] / photo.pixels.shape[1]
    return format_sheet(
        [Panel("photo", high, [format_image(photo.pixels, WIDE, high)])], (), source.name
    )


# Operations that the contours ask for.


def _propose(ask: Ask, files: Files) -> Proposed:
    job = load_job(ask.job_file, (), files)
    part = read(ask.inputs[0], job, files)
    if kind_of(part) != "drawing" or len(ask.inputs) > 1:
        raise InputError(part.source, "operations are proposed for one flat drawing")
    # The rows of the job make way for those of the proposal.
    names = {row.get("name") for row in rows_of(tables_of(ask.text), "tools")}
    library = [tool for tool in job.tools if tool.name and tool.name not in names]
    found = propose(part, job.stock, library)
    if found is None:
        what = "has no closed contour that a drill or a mill of 1 mm or more could make"
        raise InputError(part.source, what)
    tools = tuple(dict(tool.row) for tool in found.tools)
    rows = tuple(dict(operation.row) for operation in found.operations)
    return Proposed(ask.number, tools, rows, found.thickness)
