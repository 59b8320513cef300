"""Decides for each input of a batch whether it has to be built, by the digest of its sources."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from pathlib import Path

from msgspec import Struct

from camgen.batch.inputs import BatchInput
from camgen.batch.state import NAME, Outcome, Record, Task, is_unchanged
from camgen.model.errors import CamgenError, InputError, JobError
from camgen.model.plugins import list_entries
from camgen.model.version import __version__
from camgen.pipeline.inputs import compute_digest
from camgen.post.plugins import POSTS, find_post
from camgen.read.files import Files, identity
from camgen.read.job_file import find_job_file, load_job


class BatchOptions(Struct, frozen=True):
    """The options of all parts, as on the command line.

    post: name of the controller.
    job: job file of `--job`; None for the job file beside each part.
    sets: texts of `--set`.
    strict: whether anything left out is an error.
    """

    post: str
    job: str | None
    sets: tuple[str, ...]
    strict: bool


class BatchPart(Struct, frozen=True):
    """One input. Exactly one of `task`, `record` and `outcome` is set.

    input: the input.
    program: first file of the program, relative to the output folder.
    digest: digest of everything from which the program is made.
    read: files from which the program is made, by identity.
    task: task of a part that has to be built.
    record: record of a part that is unchanged.
    outcome: reason why a part cannot be built.
    """

    input: BatchInput
    program: str
    digest: str
    read: Mapping[str, Path]
    task: Task | None = None
    record: Record | None = None
    outcome: Outcome | None = None


def make_parts(
    inputs: Sequence[BatchInput], options: BatchOptions, folder: Path, records: Mapping[str, Record]
) -> tuple[list[BatchPart], dict[str, int]]:
    """The parts in their order, and the part that may write each file.

    The first file of each program belongs to its part. Names of files are in lower case, since many
    systems do not distinguish case. Raises JobError if two parts have a file of the same name, or
    if a file is an input.
    """
    suffix, post = find_post(options.post).suffix, _describe_post(options.post)
    owners: dict[str, int] = {}
    parts, read = [], set[str]()
    for place, batch_input in enumerate(inputs):
        parts.append(_make_part(place, batch_input, options, suffix, post))
        read.add(identity(batch_input.source))
        read.update(parts[-1].read)
    if identity(folder / NAME) in read:
        raise JobError(
            str(folder / NAME), "is read by a part, and a batch writes it", remedy="rename it"
        )
    for place, part in enumerate(parts):
        first = owners.setdefault(part.program.casefold(), place)
        source = str(part.input.source)
        if first != place and not part.outcome:
            raise JobError(
                source,
                f"its program would have the same name as that of {parts[first].input.source}",
                part.program,
                'build them into two folders, or by one pattern with "**"',
            )
        if identity(folder / part.program) in read:
            raise JobError(
                source,
                "its program would overwrite a file that is read",
                part.program,
                "give another folder with -o",
            )
    return [_skip_unchanged(part, folder, records) for part in parts], owners


def _make_part(
    place: int, batch_input: BatchInput, options: BatchOptions, suffix: str, post: str
) -> BatchPart:
    """The part of an input, with a task or with the reason why it cannot be built.

    place: index of the input.
    suffix: suffix of programs.
    post: description of the post, for the digest.
    """
    source = batch_input.source
    name = source.stem
    job_file = None
    files = Files()  # The cache of this part alone, so that its bytes are freed after it.
    try:
        if not _is_text(source):
            raise InputError(str(source), "its name is not UTF-8 text", remedy="rename it")
        if options.post.endswith(".py"):
            files.read(options.post)  # Registers the file, which Python imports by itself.
        job_file = find_job_file(options.job, source)
        job = load_job(job_file, options.sets, files)
        name = str(job.post.get("program") or name)
        digest = compute_digest(job, [source], files)
    except CamgenError as error:
        outcome = Outcome(error.exit_code, str(error))
        program = (batch_input.folder / (name + suffix)).as_posix()
        return BatchPart(batch_input, program, "", files.opened, outcome=outcome)
    job_name = str(job_file or "job")
    task = Task(place, source, options.post, job, job_name, options.strict, __version__)
    text = f"{post} {source.name} {name} {options.strict} {digest}"
    digest = hashlib.sha256(text.encode("utf-8", "surrogateescape")).hexdigest()
    program = (batch_input.folder / (name + suffix)).as_posix()
    return BatchPart(batch_input, program, digest, files.opened, task)


def _is_text(path: Path) -> bool:
    """Whether a name can be written to the state and the report of a batch, which are UTF-8."""
    try:
        path.as_posix().encode()
    except UnicodeEncodeError:
        return False
    return True


def _skip_unchanged(part: BatchPart, folder: Path, records: Mapping[str, Record]) -> BatchPart:
    record = records.get(part.program)
    if part.task is None or not is_unchanged(record, part.digest, folder / part.input.folder):
        return part
    return BatchPart(part.input, part.program, part.digest, part.read, record=record)


def _describe_post(post: str) -> str:
    """The versions of camgen and of the post, on which the text depends besides the job."""
    if post.endswith(".py"):
        return f"{__version__} {hashlib.sha256(Files().read(post).data).hexdigest()}"
    (entry,) = (entry for entry in list_entries(POSTS) if entry.name == post)
    return (
        f"{__version__} {post}{(f' {entry.dist.name} {entry.dist.version}' if entry.dist else '')}"
    )
