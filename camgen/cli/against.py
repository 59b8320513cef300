"""``camgen inspect PHOTO --against PART``: what is missing of a part, what is too much, in mm and as a picture."""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Iterator, Sequence
from pathlib import Path

from msgspec.structs import replace

from camgen.batch.writing import check_targets, write_all
from camgen.check.photo import (
    WHY_NOT,
    Difference,
    Inspection,
    NotReworked,
    Rework,
    inspect_photo,
    list_rework,
)
from camgen.check.photo.rework import WITHOUT_FORCE, insist_on_following, insist_on_pose
from camgen.cli.inputs import open_inputs
from camgen.cli.rework import write_drawing, write_job
from camgen.cli.say import Voice, table
from camgen.model.errors import JobError, NoSafeProgram, VerifyError
from camgen.model.job import CameraTable, ImageTable, Job
from camgen.model.text import counted, name_ranges, short
from camgen.plan import name_operation
from camgen.preview.inspection import draw
from camgen.read import find_reader, list_installed
from camgen.read.clamps import set_clamps_aside
from camgen.read.image import read_outlines
from camgen.read.job_file import beside, load
from camgen.read.move import move_part

_PICTURES = (".svg", ".png")
#: So many places are listed, the greatest.
_LISTED = 40


def run(arguments: Namespace, says: Voice) -> int:
    """Prints what differs, writes the picture and the rework of burrs. --strict: differing is an error."""
    _insist(arguments)
    targets = [Path(name) for name in (arguments.preview, arguments.rework) if name]
    if arguments.rework:
        targets.append(Path(arguments.rework).with_suffix(".dxf"))
    with open_inputs([arguments.input], arguments.format) as ((photo,), opened):
        drawing, own = _drawing(Path(arguments.against))
        job_file = beside(arguments.job, photo)
        check_targets(targets, [photo, drawing, *(one for one in (job_file, own) if one)])
        job = load(job_file, arguments.sets, opened)
        files = opened.within(job.limits)
        says.stage("reading")
        seen = read_outlines(files.read(photo), job, files)
        expects = (
            load(own, [], files) if own else replace(job, camera=CameraTable(), image=ImageTable())
        )
        source = files.read(drawing)
        drawn = set_clamps_aside(find_reader(source).read(source, expects, files), expects)
        part = move_part(drawn, expects)
        says.stage("comparing")
        found = inspect_photo(seen, part, expects, arguments.least)
        says.clear()
        works, left = (
            list_rework(found, expects, arguments.removal)
            if arguments.removal is not None
            else ((), ())
        )
        if arguments.strict and found.differences:
            first = found.differences[0]
            what = f"differs from {drawing.name} in {counted(len(found.differences), 'place')}, first: {_tell(first)}"
            raise VerifyError(arguments.input, what, remedy="leave --strict out to see all of them")
        if arguments.rework:
            _insist_on_boxes(expects)
            insist_on_following(expects, name_operation(part, expects))
            insist_on_pose(arguments.input, found.fit, found.expected.region)
            if not works:
                what = "shows no burr that can be worked again"
                raise NoSafeProgram(
                    arguments.input, what, remedy="leave --rework out to see what differs"
                )
        write_all(list(_outputs(arguments, found, works, expects)), files.opened)
    if arguments.json:
        says.data(_facts(found, works, left))
    else:
        says.out(_page(found, works, left))
        if works and not expects.process.force:
            says.rows([("warning", WITHOUT_FORCE, "look")])
    says.rows(
        [
            (note.kind, str(note).partition(": ")[2], "look")
            for note in found.notes
            if note.kind == "warning"
        ]
    )
    says.rows([("written", str(target), "good") for target in targets])
    return 0


def _insist(arguments: Namespace) -> None:
    if arguments.preview and Path(arguments.preview).suffix.lower() not in _PICTURES:
        raise JobError(
            arguments.preview,
            "is no kind of picture of an inspection",
            remedy="end it in .svg or .png",
        )
    if arguments.rework and arguments.removal is None:
        raise JobError(
            "--rework",
            "needs --removal",
            remedy="give what one pass takes off, mm, e.g. --removal 0.2",
        )
    if arguments.rework and Path(arguments.rework).suffix.lower() != ".toml":
        what = "is not the name of a job file"
        raise JobError(arguments.rework, what, remedy="end it in .toml; a drawing comes beside it")


def _insist_on_boxes(job: Job) -> None:
    """Raises JobError for clamps that are drawn: the drawing of the rework has no such layer."""
    if job.drawn_fixtures:
        what = "the drawing of a rework has no layers of clamps"
        raise JobError("job", what, "cell.fixtures", "give boxes or mesh files")


def _drawing(named: Path) -> tuple[Path, Path | None]:
    """The drawing, and its own job file. Of a job file that is named, the input of its name beside it."""
    if named.suffix.lower() != ".toml":
        return named, beside(None, named)
    suffixes = sorted(
        {
            suffix
            for one in list_installed()
            if one.reader
            for suffix in one.reader.suffixes
            if suffix
        }
    )
    found = [path for path in (named.with_suffix(suffix) for suffix in suffixes) if path.is_file()]
    if len(found) == 1:
        return found[0], named
    which = ", ".join(path.name for path in found) or "no input of its name"
    raise JobError(str(named), f"beside it is {which}", remedy="give the drawing to --against")


def _outputs(
    arguments: Namespace, found: Inspection, works: Sequence[Rework], job: Job
) -> Iterator[tuple[Path, bytes]]:
    if arguments.preview:
        target = Path(arguments.preview)
        yield target, draw(found, target.suffix.lower())
    if arguments.rework:
        target = Path(arguments.rework)
        yield target, write_job(found, works, job, target)
        yield target.with_suffix(".dxf"), write_drawing(works, found.expected.rings)


# What is printed.


def _page(found: Inspection, works: Sequence[Rework], left: Sequence[NotReworked]) -> str:
    expected = found.expected
    what = "ink along the planned paths" if expected.inked else "material inside the contours"
    lines = [
        f"{found.photo.source} against {expected.source}: {what}, {expected.region.area:.2f} mm2 expected",
        *(note.what for note in found.notes if note.what.startswith("photo laid")),
        *(_sum(found, much) for much in (True, False)),
    ]
    places = [_row(number, each) for number, each in enumerate(found.differences[:_LISTED], 1)]
    listed = (
        table([("", "what", "x mm", "y mm", "height mm", "length mm", "mm2", "at"), *places])
        if places
        else ""
    )
    more = len(found.differences) - len(places)
    told = [f"and {counted(more, 'more place')}"] if more else []
    return (
        "\n".join(
            [*lines, *([listed.rstrip("\n")] if listed else []), *told, *_needs(found, works, left)]
        )
        + "\n"
    )


def _facts(
    found: Inspection, works: Sequence[Rework], left: Sequence[NotReworked]
) -> dict[str, object]:
    """The list as data."""
    rows = [
        {
            "kind": each.kind,
            "place": each.place,
            "height": each.height,
            "length": each.length,
            "area": each.area,
            "contour": each.contour,
        }
        for each in found.differences
    ]
    return {
        "source": found.photo.source,
        "against": found.expected.source,
        "expected_area": found.expected.region.area,
        "turn": found.fit.turn,
        "shift": found.fit.shift,
        "fit": found.fit.share,
        "least": found.least,
        "differences": rows,
        "rework": [
            {"number": work.number, "passes": work.passes, "feed": work.feed} for work in works
        ],
        "not_reworked": list(left),
    }


def _sum(found: Inspection, much: bool) -> str:
    count = sum(each.much == much for each in found.differences)
    area = found.area(much)
    share = 100 * area / found.expected.region.area
    label = "too much" if much else "missing"
    if not count:
        return f"{label}: nothing from {short(found.least, 3)} mm on"
    return f"{label}: {counted(count, 'place')}, {area:.2f} mm2, {share:.2f} %"


def _row(number: int, difference: Difference) -> tuple[str, ...]:
    sizes = (*difference.place, difference.height, difference.length, difference.area)
    return (str(number), difference.kind, *(f"{size:.2f}" for size in sizes), difference.contour)


def _tell(difference: Difference) -> str:
    x, y = difference.place
    return f"{difference.kind} at {x:.2f}, {y:.2f} mm, {difference.height:.2f} mm"


def _needs(
    found: Inspection, works: Sequence[Rework], left: Sequence[NotReworked]
) -> Iterator[str]:
    """Lines on the work for each burr, and on the reasons to leave the others."""
    for work in works:
        passes = counted(work.passes, "pass", "passes")
        yield f"burr {work.number}: {passes} at {short(work.feed, 3)} mm/s"
    reasons: dict[str, list[str]] = {}
    for each in left or _unplanned(found):
        reasons.setdefault(each.why, []).append(str(each.number))
    for why, numbers in reasons.items():
        yield f"not to be reworked: {', '.join(name_ranges(numbers))}: {why}"
    if found.burrs and not works and not left:
        count = counted(len(found.burrs), "burr")
        highest = f"{count}, the highest {found.burrs[0].height:.2f} mm"
        yield f"{highest}: --removal MM, the height that a pass takes off, says how many passes"


def _unplanned(found: Inspection) -> list[NotReworked]:
    """The differences that are not burrs, if the height that a pass takes off is not known."""
    return [
        NotReworked(number, WHY_NOT[each.kind])
        for number, each in enumerate(found.differences, 1)
        if each.kind in WHY_NOT
    ]
