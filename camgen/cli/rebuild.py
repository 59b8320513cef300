"""The comparison of a program with the one that its job and its part make today."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

from camgen.cli.header import Header
from camgen.cli.say import Terminal
from camgen.lang.programs import Executed
from camgen.lower.steps import split_tools
from camgen.model.errors import CamgenError, InputError, VerifyError
from camgen.model.job import Job
from camgen.model.program import Program
from camgen.model.signature import State, read_signature
from camgen.model.text import counted
from camgen.model.version import __version__
from camgen.post import Post
from camgen.post.contract import prepare_program
from camgen.post.limits import limit_tolerance
from camgen.post.verify import compare
from camgen.read.files import Files

Row = tuple[str, str]

#: The states of a program in words.
STATES: Mapping[State, str] = {
    "as written": "the text is as camgen wrote it",
    "edited": "the text was edited since camgen wrote it",
    "unsigned": "the text has no digest of camgen",
}


class Origin(NamedTuple):
    """The origin of a program.

    header: its header.
    part: part for which it was written.
    job: job for which it was written.
    name: name that it would have alone.
    """

    header: Header
    part: Path
    job: Job
    name: str


def read_state(texts: Mapping[str, str]) -> State:
    """Whether the files of a program are as camgen wrote them.

    Files without a digest do not count.
    """
    states = {read_signature(text) for text in texts.values()}
    if "edited" in states:
        return "edited"
    return "as written" if "as written" in states else "unsigned"


def compare_rebuilt(
    path: Path, post: Post, executed: Executed, origin: Origin, terminal: Terminal, files: Files
) -> tuple[Row, VerifyError | None]:
    """The comparison of a program with the one that its job and part make.

    Another version of camgen, or one with other extras, may make another program of them.

    path: file of the program.
    post: post that wrote it.
    executed: strict run of its text.

    Returns the row of the summary, and the first difference.
    """
    target = f"what its job and {origin.part.name} make"
    if origin.header.version != __version__:
        why = f"camgen {origin.header.version} wrote it, this is {__version__}"
        return ("plan", f"not compared with {target}: {why}"), None
    from camgen.pipeline import build  # noqa: PLC0415 (all of camgen, only for our texts)

    try:
        result = build(
            origin.part,
            post=post.name,
            job=origin.job,
            name=origin.name,
            watch=terminal.stage,
            files=files,
        )
        chord = result.job.tolerance.chord
        program = prepare_program(post, pick_program(result.program, post, path), chord)
    except CamgenError as error:
        return ("plan", f"not compared with {target}: {error}"), None
    tolerance = limit_tolerance(post.tolerance(), chord)
    try:
        equal = compare(program, executed, tolerance, post.list_verified(), str(path))
    except VerifyError as error:
        what = f"differs from {target}"
        remedy = f"--post {post.name} examines the text by itself"
        where = f"line {error.line}: " if error.line else ""
        different = VerifyError(error.file, f"{what}: {error.what}", error.line, remedy)
        return ("plan", f"{what}: {where}{error.what}"), different
    instructions = counted(equal.instructions, "instruction")
    return ("plan", f"{instructions} equal to {target}, {equal.max_mm:.6f} mm"), None


def pick_program(program: Program, post: Post, path: Path) -> Program:
    """The program of a file: of several, one for each tool, the one with the name of the file."""
    if post.changes_tools:
        return program
    parts = {part.name: part for part in split_tools(program)}
    if len(parts) == 1:
        return next(iter(parts.values()))
    if path.stem not in parts:
        raise InputError(
            str(path),
            "the plan holds a program for each tool",
            ", ".join(parts),
            "give one by its own name",
        )
    return parts[path.stem]
