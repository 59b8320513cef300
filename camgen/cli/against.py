"""``camgen inspect PHOTO --against PART``: what is missing of a part, what is too much, in mm and as a picture."""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Iterator, Sequence
from pathlib import Path

from msgspec.structs import replace

from camgen.batch.writing import check_targets, write_all
from camgen.check.photo import Difference, Inspection, Rework, inspect_photo, list_rework
from camgen.cli.inputs import open_inputs
from camgen.cli.say import Voice, table
from camgen.model.errors import JobError, VerifyError
from camgen.model.job import CameraTable, ImageTable
from camgen.model.text import counted, harmless, short
from camgen.model.version import __version__
from camgen.preview.inspection import draw
from camgen.read import find_reader, list_installed
from camgen.read.image import read as read_photo
from camgen.read.job_file import beside, load
from camgen.read.move import move_part

_PICTURES = (".svg", ".png")
#: So many places are listed, the greatest.
_LISTED = 40


def run(arguments: Namespace, says: Voice) -> int:
    """Prints what differs, writes the picture and the settings of another run. --strict: differing is an error."""
    targets = [Path(name) for name in (arguments.preview, arguments.rework) if name]
    _insist(arguments)
    with open_inputs([arguments.input], arguments.format) as ((photo,), opened):
        drawing, own = _drawing(Path(arguments.against))
        job_file = beside(arguments.job, photo)
        check_targets(targets, [photo, drawing, *(one for one in (job_file, own) if one)])
        job = load(job_file, arguments.sets, opened)
        files = opened.within(job.limits)
        says.stage("reading")
        seen = read_photo(files.read(photo), job, files)
        expects = (
            load(own, [], files) if own else replace(job, camera=CameraTable(), image=ImageTable())
        )
        source = files.read(drawing)
        part = move_part(find_reader(source).read(source, expects, files), expects)
        says.stage("comparing")
        found = inspect_photo(seen, part, expects, arguments.least)
        says.clear()
        rework = (
            list_rework(found, expects, arguments.removal) if arguments.removal is not None else ()
        )
        if arguments.strict and found.differences:
            first = found.differences[0]
            what = f"differs from {drawing.name} in {counted(len(found.differences), 'place')}, first: {_tell(first)}"
            raise VerifyError(arguments.input, what, remedy="leave --strict out to see all of them")
        write_all(list(_outputs(arguments, found, rework)), files.opened)
    says.out(_page(found, rework))
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
    arguments: Namespace, found: Inspection, rework: Sequence[Rework]
) -> Iterator[tuple[Path, bytes]]:
    if arguments.preview:
        target = Path(arguments.preview)
        yield target, draw(found, target.suffix.lower())
    if arguments.rework:
        yield Path(arguments.rework), _fragment(found, rework).encode()


# What is printed.


def _page(found: Inspection, rework: Sequence[Rework]) -> str:
    expected = found.expected
    what = "ink along the planned paths" if expected.inked else "material inside the contours"
    lines = [
        f"{found.photo.source} against {expected.source}: {what}, {expected.region.area:.2f} mm2 expected",
        *(note.what for note in found.notes if note.what.startswith("photo laid")),
        *(_sum(found, much) for much in (True, False)),
    ]
    places = [_row(number, one) for number, one in enumerate(found.differences[:_LISTED], 1)]
    listed = (
        table([("", "what", "x mm", "y mm", "height mm", "length mm", "mm2", "at"), *places])
        if places
        else ""
    )
    more = len(found.differences) - len(places)
    told = [f"and {counted(more, 'more place')}"] if more else []
    return (
        "\n".join(
            [*lines, *([listed.rstrip("\n")] if listed else []), *told, *_needs(found, rework)]
        )
        + "\n"
    )


def _sum(found: Inspection, much: bool) -> str:
    count = sum(one.much == much for one in found.differences)
    area = found.area(much)
    share = 100 * area / found.expected.region.area
    label = "too much" if much else "missing"
    if not count:
        return f"{label}: nothing from {short(found.least, 3)} mm on"
    return f"{label}: {counted(count, 'place')}, {area:.2f} mm2, {share:.2f} %"


def _row(number: int, one: Difference) -> tuple[str, ...]:
    what = "too much" if one.much else "missing"
    numbers = (f"{v:.2f}" for v in (*one.place, one.height, one.length, one.area))
    return (str(number), f"{what}, apart" if one.whole else what, *numbers, one.contour)


def _tell(one: Difference) -> str:
    x, y = one.place
    return f"{'too much' if one.much else 'missing'} at {x:.2f}, {y:.2f} mm, {one.height:.2f} mm"


def _needs(found: Inspection, rework: Sequence[Rework]) -> Iterator[str]:
    """Which contours want another run, and with what."""
    if found.expected.inked:
        return
    if rework:
        for one in rework:
            yield f"{_of(one.contour, one.burrs, one.height)}: {_settings(one)}"
        return
    by: dict[str, list[float]] = {}
    for burr in found.burrs:
        by.setdefault(burr.contour, []).append(burr.height)
    for name, heights in by.items():
        yield f"{_of(name, len(heights), max(heights))}; --removal MM, what a pass takes off, says how many"


def _of(name: str, burrs: int, height: float) -> str:
    return f"{name} needs more passes: {counted(burrs, 'burr')}, the highest {height:.2f} mm"


def _settings(one: Rework) -> str:
    return f"operation.passes = {one.passes}, or process.feed = {short(one.feed, 3)}"


def _fragment(found: Inspection, rework: Sequence[Rework]) -> str:
    """Tables of a job file for another run over the same contours."""
    names = f"{harmless(found.photo.source)} against {harmless(found.expected.source)}"
    lines = [f"# camgen {__version__}: {names}"]
    lines += [
        f"# {harmless(_of(one.contour, one.burrs, one.height))}: {_settings(one)}" for one in rework
    ]
    for number, one in enumerate(found.burrs, 1):
        x, y = one.place
        size = f"{one.height:.2f} mm high, {one.length:.2f} mm long"
        lines.append(f"# burr {number}: {size}, at {x:.2f} {y:.2f} of {harmless(one.contour)}")
    if not rework:
        return "\n".join([*lines, "# no burr: nothing to do again", ""])
    worst = max(rework, key=lambda one: one.passes)
    lines += [
        "",
        "[operation]",
        f"passes = {worst.passes}",
        "",
        "# or, instead of more passes:",
        "# [process]",
    ]
    return "\n".join([*lines, f"# feed = {short(min(one.feed for one in rework), 3)}", ""])
