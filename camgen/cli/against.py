"""`camgen inspect PHOTO --against PART`: missing and surplus material of a part in a photo.

Prints a list of the differences in mm. Draws them, and plans the rework of burrs, if asked for.
"""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Iterator, Sequence
from pathlib import Path

from msgspec.structs import replace

from camgen.batch.writing import check_targets, list_paths, write_all
from camgen.check.photo import (
    WHY_NOT,
    Difference,
    Inspection,
    NotReworked,
    Rework,
    inspect_photo,
    list_rework,
)
from camgen.check.photo.rework import WITHOUT_FORCE, check_following, check_pose
from camgen.cli.inputs import check_suffix, open_inputs, to_path
from camgen.cli.rework import write_drawing, write_job
from camgen.cli.say import Terminal, format_table, label_rows, rows_of_notes
from camgen.model.errors import JobError, NoSafeProgram, VerifyError
from camgen.model.job import CameraTable, ImageTable, Job
from camgen.model.text import counted, name_ranges, short
from camgen.plan import name_operation
from camgen.preview.inspection import draw
from camgen.read import find_reader, list_installed
from camgen.read.clamps import set_clamps_aside
from camgen.read.image import read_outlines
from camgen.read.job_file import find_job_file, load_job
from camgen.read.move import move_part

#: Maximum number of differences in the printed list; the largest ones come first.
_MAX_LISTED = 40


def run(arguments: Namespace, terminal: Terminal) -> None:
    """Compare a photo with a part, print the differences, and write the picture and the rework.

    Raises VerifyError for any difference with `--strict`, JobError for unusable arguments,
    NoSafeProgram if a rework is asked for and no burr can be reworked.
    """
    _check_arguments(arguments)
    preview, rework = to_path(arguments.preview), to_path(arguments.rework)
    rework_drawing = rework and rework.with_suffix(".dxf")
    with open_inputs([arguments.input], arguments.format) as ((photo,), opened):
        drawing, drawing_job = _find_drawing(Path(arguments.against))
        job_file = find_job_file(arguments.job, photo)
        check_targets([preview, rework, rework_drawing], [photo, drawing, job_file, drawing_job])
        job = load_job(job_file, arguments.sets, opened)
        files = opened.within(job.limits)
        terminal.stage("reading")
        seen = read_outlines(files.read(photo), job, files)
        if drawing_job:
            part_job = load_job(drawing_job, [], files)
        else:
            part_job = replace(job, camera=CameraTable(), image=ImageTable())
        source = files.read(drawing)
        drawn = set_clamps_aside(find_reader(source).read(source, part_job, files), part_job)
        part = move_part(drawn, part_job)
        terminal.stage("comparing")
        inspection = inspect_photo(seen, part, part_job, arguments.least)
        works: Sequence[Rework] = ()
        not_reworked: Sequence[NotReworked] = ()
        if arguments.removal is not None:
            works, not_reworked = list_rework(inspection, part_job, arguments.removal)
        if arguments.strict and inspection.differences:
            count = counted(len(inspection.differences), "place")
            first = _format_difference(inspection.differences[0])
            raise VerifyError(
                arguments.input,
                f"differs from {drawing.name} in {count}, first: {first}",
                remedy="leave --strict out to see all of them",
            )
        if arguments.rework:
            _check_clamps(part_job)
            check_following(part_job, name_operation(part, part_job))
            check_pose(arguments.input, inspection.fit, inspection.expected.region)
            if not works:
                raise NoSafeProgram(
                    arguments.input,
                    "shows no burr that can be worked again",
                    remedy="leave --rework out to see what differs",
                )
        written = list(_make_files(preview, rework, inspection, works, part_job))
        write_all(written, files.opened)
    if arguments.json:
        terminal.data(_make_json(inspection, works, not_reworked))
    else:
        terminal.out(_format_page(inspection, works, not_reworked))
        if works and not part_job.process.force:
            terminal.rows([("warning", WITHOUT_FORCE, "look")])
    terminal.rows(rows_of_notes(note for note in inspection.notes if note.kind == "warning"))
    terminal.rows(label_rows("written", list_paths(written), "good"))


def _check_arguments(arguments: Namespace) -> None:
    """Raises JobError for file names or combinations of options that cannot be used."""
    check_suffix(
        arguments.preview,
        (".svg", ".png"),
        "is not a kind of picture of an inspection",
        "end it in .svg or .png",
    )
    if arguments.rework and arguments.removal is None:
        raise JobError(
            "--rework",
            "needs --removal",
            remedy="give what one pass takes off, mm, e.g. --removal 0.2",
        )
    check_suffix(
        arguments.rework,
        (".toml",),
        "is not the name of a job file",
        "end it in .toml; a drawing comes beside it",
    )


def _check_clamps(job: Job) -> None:
    """Raises JobError if clamps are layers of the drawing, which the drawing of a rework lacks."""
    if job.drawn_fixtures:
        raise JobError(
            "job",
            "the drawing of a rework has no layers of clamps",
            "cell.fixtures",
            "give boxes or mesh files",
        )


def _find_drawing(named: Path) -> tuple[Path, Path | None]:
    """The drawing of the part, and its own job file, None without one.

    named: the drawing, or its job file. For a job file, the drawing is the input of the same name
        in the same folder.

    Raises JobError if a job file has no such input, or several.
    """
    if named.suffix.lower() != ".toml":
        return named, find_job_file(None, named)
    suffixes: set[str] = set()
    for plugin in list_installed():
        if plugin.reader:
            suffixes.update(plugin.reader.suffixes)
    drawings = []
    for suffix in sorted(suffixes - {""}):
        path = named.with_suffix(suffix)
        if path.is_file():
            drawings.append(path)
    if len(drawings) == 1:
        return drawings[0], named
    names = ", ".join(path.name for path in drawings)
    what = (
        f"has several inputs beside it: {names}" if names else "has no input of its name beside it"
    )
    raise JobError(str(named), what, remedy="give the drawing to --against")


def _make_files(
    preview: Path | None,
    rework: Path | None,
    inspection: Inspection,
    works: Sequence[Rework],
    job: Job,
) -> Iterator[tuple[Path, bytes]]:
    """Path and content of each file to write."""
    if preview:
        yield preview, draw(inspection, preview.suffix.lower())
    if rework:
        yield rework, write_job(inspection, works, job, rework)
        yield rework.with_suffix(".dxf"), write_drawing(works, inspection.expected.rings)


# The printed result.


def _format_page(
    inspection: Inspection, works: Sequence[Rework], not_reworked: Sequence[NotReworked]
) -> str:
    """The text for the terminal: a summary, a table of differences, and the rework."""
    expected = inspection.expected
    what = "ink along the planned paths" if expected.inked else "material inside the contours"
    lines = [
        f"{inspection.photo.source} against {expected.source}: {what}, "
        f"{expected.region.area:.2f} mm2 expected",
    ]
    lines += [note.what for note in inspection.notes if note.what.startswith("photo laid")]
    lines += [_format_total(inspection, True), _format_total(inspection, False)]
    if inspection.differences:
        rows: list[tuple[str, ...]] = [
            ("", "what", "x mm", "y mm", "height mm", "length mm", "mm2", "at")
        ]
        for number, difference in enumerate(inspection.differences[:_MAX_LISTED], 1):
            rows.append(_format_row(number, difference))
        lines.append(format_table(rows).rstrip("\n"))
    more = len(inspection.differences) - _MAX_LISTED
    if more > 0:
        lines.append(f"and {counted(more, 'more place')}")
    lines += _list_rework_lines(inspection, works, not_reworked)
    return "\n".join(lines) + "\n"


def _make_json(
    inspection: Inspection, works: Sequence[Rework], not_reworked: Sequence[NotReworked]
) -> dict[str, object]:
    """The result as data for `--json`."""
    rows = []
    for difference in inspection.differences:
        rows.append(
            {
                "kind": difference.kind,
                "place": difference.place,
                "height": difference.height,
                "length": difference.length,
                "area": difference.area,
                "contour": difference.contour,
            }
        )
    return {
        "source": inspection.photo.source,
        "against": inspection.expected.source,
        "expected_area": inspection.expected.region.area,
        "turn": inspection.fit.turn,
        "shift": inspection.fit.shift,
        "fit": inspection.fit.share,
        "least": inspection.least,
        "differences": rows,
        "rework": [
            {"number": work.number, "passes": work.passes, "feed": work.feed} for work in works
        ],
        "not_reworked": list(not_reworked),
    }


def _format_total(inspection: Inspection, surplus: bool) -> str:
    """Number and area of the differences with surplus material, or with missing material."""
    count = sum(difference.surplus == surplus for difference in inspection.differences)
    area = inspection.area(surplus)
    percent = 100 * area / inspection.expected.region.area
    label = "too much" if surplus else "missing"
    if not count:
        return f"{label}: nothing from {short(inspection.least, 3)} mm on"
    return f"{label}: {counted(count, 'place')}, {area:.2f} mm2, {percent:.2f} %"


def _format_row(number: int, difference: Difference) -> tuple[str, ...]:
    sizes = (*difference.place, difference.height, difference.length, difference.area)
    return (str(number), difference.kind, *(f"{size:.2f}" for size in sizes), difference.contour)


def _format_difference(difference: Difference) -> str:
    x, y = difference.place
    return f"{difference.kind} at {x:.2f}, {y:.2f} mm, {difference.height:.2f} mm"


def _list_rework_lines(
    inspection: Inspection, works: Sequence[Rework], not_reworked: Sequence[NotReworked]
) -> Iterator[str]:
    """Lines on the passes for each burr, and on the reasons to leave other differences."""
    for work in works:
        passes = counted(work.passes, "pass", "passes")
        yield f"burr {work.number}: {passes} at {short(work.feed, 3)} mm/s"
    reasons: dict[str, list[str]] = {}
    for skipped in not_reworked or _list_unplanned(inspection):
        reasons.setdefault(skipped.why, []).append(str(skipped.number))
    for why, numbers in reasons.items():
        yield f"not to be reworked: {', '.join(name_ranges(numbers))}: {why}"
    if inspection.burrs and not works and not not_reworked:
        burrs = counted(len(inspection.burrs), "burr")
        yield (
            f"{burrs}, the highest {inspection.burrs[0].height:.2f} mm: "
            "--removal MM, the height that a pass takes off, says how many passes"
        )


def _list_unplanned(inspection: Inspection) -> list[NotReworked]:
    """The differences that are not burrs, for a list without `--removal`."""
    skipped = []
    for number, difference in enumerate(inspection.differences, 1):
        if difference.kind in WHY_NOT:
            skipped.append(NotReworked(number, WHY_NOT[difference.kind]))
    return skipped
