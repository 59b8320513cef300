"""``camgen build``: reads, plans, proves, and only then writes everything at once."""

from __future__ import annotations

import gc
import os
import sys
import tempfile
from argparse import Namespace
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from time import perf_counter

import msgspec
from msgspec import Struct, field

from camgen.artwork import meant
from camgen.cli_job import beside, load
from camgen.cli_plan import encode
from camgen.cli_say import Voice
from camgen.cli_summary import rows
from camgen.errors import InputError, JobError
from camgen.job import Result, build
from camgen.report import clean
from camgen.writing import check_targets, write_all


class _Stages(Struct):
    """Tells the terminal the stage that runs and remembers how long each took."""

    says: Voice
    names: list[str] = field(default_factory=list)
    times: list[float] = field(default_factory=list)

    def __call__(self, name: str) -> None:
        if name == "planning":
            gc.collect()  # what was read is a heap of cycles, and a large one
        self.says.stage(name)
        if self.names and name.startswith(f"{self.names[-1]} "):
            return  # how far the same stage is
        self.names.append(name)
        self.times.append(perf_counter())

    def spent(self) -> list[tuple[str, float]]:
        """Each stage with its seconds, the last one up to now."""
        ends = [*self.times[1:], perf_counter()]
        return [(name, end - begin) for name, begin, end in zip(self.names, self.times, ends, strict=True)]


def run(arguments: Namespace, says: Voice) -> int:
    """Builds, writes, sums up."""
    stages = _Stages(says)
    with no_collector(), _inputs(arguments) as inputs:
        job_file = beside(arguments.job, None if arguments.inputs[0] == "-" else inputs[0])
        read = [*inputs, *([job_file] if job_file else [])]
        folder, program = _place(arguments.output)
        extra = [Path(p) for p in (arguments.plan, arguments.report, arguments.preview) if p]
        check_targets([*([program] if program else []), *extra], read)
        _check_preview(arguments.preview)
        job = load(job_file, arguments.sets)
        name = program.stem if program else ""
        with told_as("job", str(job_file or "job")):
            result = build(inputs, post=arguments.post, job=job, name=name, strict=arguments.strict, watch=stages)
        stages("writing")
        programs = program_files(result, folder, program)
        check_targets([*(path for path, _ in programs), *extra], read)
        write_all([*programs, *_extras(arguments, result, [path.name for path, _ in programs])])
    says.rows(rows(result, job_file, inputs, programs, says.verbose))
    if says.verbose:
        says.rows([("timing", ", ".join(f"{name} {seconds:.2f} s" for name, seconds in stages.spent()), "plain")])
    return 0


def _place(output: str | None) -> tuple[Path, Path | None]:
    """The folder for the program, and its file where ``-o`` names one."""
    if output is None:
        return Path(), None
    if os.path.isdir(output):  # unlike Path.is_dir it takes a name of any length
        return Path(output), None
    if output.endswith(("/", os.sep)):
        raise JobError(output, "no such folder", remedy="make it first")
    return Path(output).parent, Path(output)


def _check_preview(name: str | None) -> None:
    if name and Path(name).suffix.lower() not in _PREVIEWS:
        what = "a preview is a page (HTML) or a drawing (SVG, PNG)"
        raise JobError(name, what, remedy="give a name that ends in .html, .svg or .png")


def program_files(result: Result, folder: Path, file: Path | None) -> list[tuple[Path, bytes]]:
    """The program files with the controller's line ends."""
    paths = [folder / one.name for one in result.files]
    if file is not None:
        if len(paths) > 1 and file.name != paths[0].name:
            what = f"the program takes {len(paths)} files, which call each other by name"
            raise JobError(str(file), what, remedy="give a folder with -o")
        paths[0] = file
    newline = result.post.newline
    texts = [one.text.replace("\n", newline).encode("ascii") for one in result.files]
    return list(zip(paths, texts, strict=True))


def _extras(arguments: Namespace, result: Result, files: Sequence[str]) -> Iterator[tuple[Path, bytes]]:
    """Plan, report and preview, where asked for."""
    if arguments.plan:
        options = result.job.post
        data = encode(result.program, result.post.name, options, result.job.tolerance.chord)
        yield Path(arguments.plan), data
    if arguments.report:
        report = result.report | {"files": [clean(name) for name in files]}
        yield Path(arguments.report), msgspec.json.format(msgspec.json.encode(report), indent=2) + b"\n"
    if arguments.preview:
        target = Path(arguments.preview)
        yield target, _PREVIEWS[target.suffix.lower()](result)


def _page(result: Result) -> bytes:
    from camgen.page import html, view  # noqa: PLC0415 (only where a page is asked for)

    return html.page(view.view(result)).encode("utf-8")


def _picture(result: Result) -> bytes:
    from camgen.page import picture, view  # noqa: PLC0415 (only where a picture is asked for)

    return picture.png(view.view(result))


def _drawing(result: Result) -> bytes:
    from camgen import preview, preview_drawing, preview_stages  # noqa: PLC0415 (only where a picture is asked for)

    part, title = result.part, f"{result.part.source}, {result.post.name}"
    if part.raster is not None and meant(result.job):
        return preview_drawing.svg(part, part.raster, result.tour, result.notes, result.job, title).encode("utf-8")
    if part.raster is not None:
        return preview_stages.svg(part, part.raster, result.tour, result.notes, title).encode("utf-8")
    return preview.svg(part, result.tour, result.notes, title).encode("utf-8")


#: What draws a preview, by the ending of its name.
_PREVIEWS = {".html": _page, ".svg": _drawing, ".png": _picture}


@contextmanager
def no_collector() -> Iterator[None]:
    """Without the search for cyclic garbage, of which a build makes little but for the document that is read.

    15 000 circles take 11.0 s of processor time instead of 12.9 s (median of three).
    """
    enabled = gc.isenabled()
    gc.disable()
    gc.freeze()  # so that the one search after reading looks at what was read only
    try:
        yield
    finally:
        gc.unfreeze()
        if enabled:
            gc.enable()


@contextmanager
def _inputs(arguments: Namespace) -> Iterator[list[Path]]:
    """The inputs as files; standard input becomes one for as long as this lasts."""
    names: list[str] = arguments.inputs
    if "-" not in names:
        if arguments.format:
            raise JobError("--format", "is for standard input", remedy="leave it out, or give - as the input")
        yield [Path(name) for name in names]
        return
    kind = (arguments.format or "").lstrip(".")
    if not kind.isalnum():
        raise JobError("-", "standard input has no suffix", remedy="say what it is, e.g. --format dxf")
    with tempfile.TemporaryDirectory(prefix="camgen-") as folder:
        file = Path(folder) / f"stdin.{kind}"
        file.write_bytes(sys.stdin.buffer.read())
        with told_as(str(file), "-"):
            yield [file if name == "-" else Path(name) for name in names]


@contextmanager
def told_as(inner: str, outer: str) -> Iterator[None]:
    """Errors about ``inner`` are told as errors about ``outer``, the name that the user knows."""
    try:
        yield
    except (InputError, JobError) as error:
        if error.file == inner:
            raise type(error)(outer, error.what, error.where, error.remedy) from error
        raise
