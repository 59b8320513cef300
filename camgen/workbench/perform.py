"""One build for the workbench: the same program as that of `camgen build`, and its preview."""

from __future__ import annotations

import gc
from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path
from time import perf_counter

import numpy as np
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
from camgen.pipeline.memory import pause_collector
from camgen.plan import Watch, find_part_kind
from camgen.plan.propose import propose
from camgen.preview.page import Edits, format_page
from camgen.preview.view import make_view
from camgen.read import find_reader, read
from camgen.read.files import Files
from camgen.read.job_file import load_job
from camgen.read.layers import Layers
from camgen.workbench.form import find_setting
from camgen.workbench.session import list_rows, parse_tables
from camgen.workbench.usual import Defaults, find_defaults

#: Label, text and tone of a line of the summary.
Row = tuple[str, str, str]
#: Kinds of parts on which the user may change the order and the start points of paths.
MOVABLE = ("drawing", "picture")
#: Makes the summary of a build as on the command line, from the result, the job file, the inputs,
#: the programs and the verbosity.
Summarize = Callable[
    [Result, Path | None, Sequence[Path], Sequence[tuple[Path, ProgramFile]], int], list[Row]
]


class BuildRequest(Struct, frozen=True):
    """A request to build.

    number: number of the request.
    inputs: files of the part.
    post: name of the controller.
    job_file: path of the job file.
    text: text of the job file, which is not read from the disk.
    output: folder of the program.
    propose: propose operations instead of building.
    """

    number: int
    inputs: tuple[Path, ...]
    post: str
    job_file: Path
    text: str
    output: Path
    propose: bool = False


class Layer(Struct, frozen=True):
    """A layer of the input.

    name: its name.
    contours: number of its contours.
    used: whether the job selects it.
    """

    name: str
    contours: int
    used: bool


class PathSummary(Struct, frozen=True):
    """A path of the program.

    contours: ids of its contours, or of its edge.
    row: its row of `[[operations]]`, -1 without rows.
    seam: x, y, z (mm) of the start of a closed path, without its lead-in; None for an open one.
    point: point of `tour.seams` that sets the start, None without one.
    ordered: whether `tour.order` names the path.
    id: id of the path on the page.
    """

    contours: tuple[str, ...]
    row: int
    seam: tuple[float, float, float] | None = None
    point: tuple[float, ...] | None = None
    ordered: bool = False
    id: str = ""


class InputSummary(Struct, frozen=True):
    """The content of the input, from which the user of the page chooses.

    kind: kind of the part.
    layers: all layers of the input.
    contours: id and layer of each contour that is, or could be, worked.
    worked: ids of the worked contours, for each row of `[[operations]]`.
    runs: paths in the order of the program.
    """

    kind: str
    layers: tuple[Layer, ...] = ()
    contours: tuple[tuple[str, str], ...] = ()
    worked: tuple[tuple[str, ...], ...] = ()
    runs: tuple[PathSummary, ...] = ()


class Built(Struct, frozen=True):
    """A successful build.

    number: number of the request.
    page: preview as HTML.
    programs: path and bytes of each file of the program.
    rows: lines of the summary.
    summary: content of the input.
    opened: files that were read, by their identity.
    picture: stages of a photo or a drawing as SVG, "" for any other input.
    seconds: duration of the build, s.
    usual: defaults that depend on the input, the controller and the job.
    """

    number: int
    page: str
    programs: tuple[tuple[Path, bytes], ...]
    rows: tuple[Row, ...]
    summary: InputSummary
    opened: dict[str, Path]
    picture: str
    seconds: float
    usual: Defaults


class Failed(Struct, frozen=True):
    """A build without a program.

    number: number of the request.
    line: error as on the command line.
    code: exit code of the command line.
    place: path of the setting in the job that the error is about, empty for none.
    opened: files that were read, by their identity.
    picture: stages of a photo before the error as SVG, "" for any other input.
    """

    number: int
    line: str
    code: int
    place: tuple[str | int, ...]
    opened: dict[str, Path]
    picture: str = ""


class Proposed(Struct, frozen=True):
    """Operations that are proposed for the contours.

    number: number of the request.
    tools, operations: rows of `[[tools]]` and `[[operations]]`.
    thickness: thickness of the material for which the depths are chosen, mm.
    """

    number: int
    tools: tuple[dict[str, object], ...]
    operations: tuple[dict[str, object], ...]
    thickness: float


Outcome = Built | Failed | Proposed


def run_request(request: BuildRequest, watch: Watch, summarize: Summarize) -> Outcome:
    """Run a request. An exception by which `watch` cancels the build is not caught."""
    files = Files([Source(request.job_file, request.text.encode())])
    start = perf_counter()
    with pause_collector():
        try:
            with rename_errors("job", str(request.job_file)):
                if request.propose:
                    return _propose(request, files)
                return _build(request, files, watch, summarize, start)
        except CamgenError as error:
            line, code, place = f"error: {error}", error.exit_code, tuple(find_setting(error))
        except Exception as error:  # any fault is a line on the page, as in cli.main
            line, code, place = f"fault: {type(error).__name__}: {error}", 1, ()
        finally:
            gc.collect()
        return Failed(
            request.number, line, code, place, dict(files.opened), _draw_progress(request, files)
        )


def _build(
    request: BuildRequest, files: Files, watch: Watch, summarize: Summarize, start: float
) -> Built:
    job = load_job(request.job_file, (), files)
    result = build(request.inputs, post=request.post, job=job, watch=watch, files=files)
    programs = list_program_files(result, request.output, None)
    watch("drawing")
    runs = summarize_paths(result)
    edits = None
    if find_part_kind(result.part) in MOVABLE:
        edits = Edits(
            tuple(run.seam for run in runs),
            tuple(run.point is not None for run in runs),
            tuple(run.ordered for run in runs),
        )
    job_file = request.job_file if request.text else None
    return Built(
        number=request.number,
        page=format_page(make_view(result), edits),
        programs=tuple((path, bytes(file)) for path, file in programs),
        rows=tuple(summarize(result, job_file, request.inputs, programs, 1)),
        summary=_summarize_input(request, result, files, runs),
        opened=dict(files.opened),
        picture=_draw_stages(result),
        seconds=perf_counter() - start,
        usual=find_defaults(result),
    )


# The content of the input.


def _summarize_input(
    request: BuildRequest, result: Result, files: Files, runs: tuple[PathSummary, ...]
) -> InputSummary:
    kind = find_part_kind(result.part)
    if kind == "solid":
        return InputSummary(kind, runs=runs)
    worked = [dict[str, None]() for _ in result.job.operations]
    for run in runs:
        if run.row >= 0:
            worked[run.row].update(dict.fromkeys(run.contours))
    return InputSummary(
        kind=kind,
        layers=_list_layers(request, result, files),
        contours=tuple((contour.id, contour.layer) for contour in result.part.contours),
        worked=tuple(map(tuple, worked)),
        runs=runs,
    )


def summarize_paths(result: Result) -> tuple[PathSummary, ...]:
    """Summarize the paths in the order of the program."""
    tour = result.tour
    if find_part_kind(result.part) not in MOVABLE:
        solid = result.part.solid is not None
        return tuple(
            PathSummary(path.contours or ((path.id,) if solid else ()), -1, id=clean(path.id))
            for path in tour.paths
        )
    from camgen.plan.seams import has_seam  # noqa: PLC0415 (shapely, which flat parts have loaded)

    planned = {path.id: path for path in result.planned if has_seam(path)}
    rows = _find_rows(tour)
    points = _find_points(result, planned, rows)
    named = set(result.job.tour.order)
    summaries = []
    for path, row in zip(tour.paths, rows, strict=True):
        seam = _find_seam(path, planned[path.id]) if path.id in planned else None
        point, is_ordered = points.get(path.id), not named.isdisjoint(path.contours)
        summaries.append(PathSummary(path.contours, row, seam, point, is_ordered, clean(path.id)))
    return tuple(summaries)


def _find_points(
    result: Result, planned: dict[str, ToolPath], rows: Sequence[int]
) -> dict[str, tuple[float, ...]]:
    """The point of `tour.seams` of each path that has one, by its id.

    planned: closed paths by their id.
    rows: row of `[[operations]]` of each path of the tour.
    """
    if not result.job.tour.seams:
        return {}
    from camgen.plan.seams import choose_points, read_points  # noqa: PLC0415 (shapely)

    names = list(planned)
    row_of = {path.id: row for path, row in zip(result.tour.paths, rows, strict=True)}
    path_rows = [row_of.get(name, -1) for name in names]
    points = read_points(result.job)
    chosen, _ = choose_points(points, list(planned.values()), path_rows, result.part)
    return {names[path]: tuple(result.job.tour.seams[number]) for path, number in chosen.items()}


def _find_seam(path: ToolPath, planned: ToolPath) -> tuple[float, float, float]:
    """The start of the closed path `planned` on `path`, which may have a lead-in."""
    row = 0
    if not path.closed:
        from camgen.plan.seams import SAME_MM, project_point  # noqa: PLC0415 (shapely)

        row = int(project_point(planned, path.position[0, :2])[2] > SAME_MM)
    return to_vec3(path.position[row])


def _find_rows(tour: Tour) -> list[int]:
    """The row of `[[operations]]` of each path, -1 for a job without rows."""
    if not isinstance(tour, JobTour):
        return [-1] * len(tour.paths)
    return np.repeat(tour.numbers, [len(step_tour.paths) for step_tour in tour.tours]).tolist()


def _list_layers(request: BuildRequest, result: Result, files: Files) -> tuple[Layer, ...]:
    """All layers of drawings and curves, including those that the job leaves out."""
    if result.part.raster is not None:
        return ()
    globs = tuple(glob.strip().casefold() for glob in result.job.input.layers)
    parts = [result.part]
    if globs != ("*",):
        whole = replace(result.job, input=replace(result.job.input, layers=["*"]))
        parts = [read(file, whole, files) for file in request.inputs]
    counts = Counter[str]()
    for part in parts:
        counts.update(contour.layer for contour in part.contours)
        counts.update(curve.layer for curve in part.curves)
    selection = Layers({}, {}, globs)
    return tuple(
        Layer(name, count, not selection.why_not(name)) for name, count in sorted(counts.items())
    )


# Pictures.


def _draw_stages(result: Result) -> str:
    if result.part.raster is None:
        return ""
    from camgen.preview.drawings import draw_preview  # noqa: PLC0415 (only for pictures)

    return draw_preview(result, Path("stages.svg")).decode()


def _draw_progress(request: BuildRequest, files: Files) -> str:
    """The stages of a photo whose build failed: with its mask, or the photo alone.

    "" for an input that is not a picture.
    """
    try:
        source = files.read(request.inputs[0])
        if find_reader(source).makes != "picture":
            return ""
    except CamgenError:
        return ""
    try:
        part = read(request.inputs[0], load_job(request.job_file, (), files), files)
        return _draw_mask(part, part.raster) if part.raster is not None else ""
    except CamgenError:
        return _draw_photo(source)


def _draw_mask(part: Part, raster: Raster) -> str:
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


def _draw_photo(source: Source) -> str:
    from camgen.preview.panels import WIDE, Panel, format_image, format_sheet  # noqa: PLC0415
    from camgen.vision.image import read_picture  # noqa: PLC0415 (OpenCV, only for pictures)

    try:
        pixels = read_picture(source).pixels
    except CamgenError:
        return ""
    high = WIDE * pixels.shape[0] / pixels.shape[1]
    return format_sheet([Panel("photo", high, [format_image(pixels, WIDE, high)])], (), source.name)


# Proposed operations.


def _propose(request: BuildRequest, files: Files) -> Proposed:
    job = load_job(request.job_file, (), files)
    part = read(request.inputs[0], job, files)
    if find_part_kind(part) != "drawing" or len(request.inputs) > 1:
        raise InputError(part.source, "operations are proposed for one flat drawing")
    # The proposal replaces the rows of the job.
    names = {row.get("name") for row in list_rows(parse_tables(request.text), "tools")}
    library = [tool for tool in job.tools if tool.name and tool.name not in names]
    proposal = propose(part, job.stock, library)
    if proposal is None:
        raise InputError(
            part.source, "has no closed contour that a drill or a mill of 1 mm or more could make"
        )
    return Proposed(
        number=request.number,
        tools=tuple(dict(tool.row) for tool in proposal.tools),
        operations=tuple(dict(operation.row) for operation in proposal.operations),
        thickness=proposal.thickness,
    )
