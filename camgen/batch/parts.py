"""What is to be done for every input: build it, or nothing since it was built from the same before."""

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


class Order(Struct, frozen=True):
    """What holds for all parts, as on the command line. job: the one of ``--job``, else each part's own."""

    post: str
    job: str | None
    sets: tuple[str, ...]
    strict: bool


class BatchPart(Struct, frozen=True):
    """One input. program: its first file, below the output folder. digest: of all that the program is made from.
    read: every file that it is made from. Exactly one of the last three is there: what is to be built, what is built
    already, why it cannot be built.
    """

    input: BatchInput
    program: str
    digest: str
    read: Mapping[str, Path]
    task: Task | None = None
    record: Record | None = None
    outcome: Outcome | None = None


def look_at(
    inputs: Sequence[BatchInput], order: Order, folder: Path, records: Mapping[str, Record]
) -> tuple[list[BatchPart], dict[str, int]]:
    """The parts in order, and who may write which file (in small letters, since many systems do not tell the case):
    the first file of each program belongs to its part. JobError where two claim one, or one is an input.
    """
    suffix, made_by = find_post(order.post).suffix, _maker(order.post)
    parts = [_part(place, one, order, suffix, made_by) for place, one in enumerate(inputs)]
    owners: dict[str, int] = {}
    read = {same for part in parts for same in part.read} | {identity(one.source) for one in inputs}
    if identity(folder / NAME) in read:
        raise JobError(
            str(folder / NAME), "is read by a part, and a batch writes it", remedy="rename it"
        )
    for place, part in enumerate(parts):
        first = owners.setdefault(part.program.casefold(), place)
        source = str(part.input.source)
        if first != place and not part.outcome:
            what = f"its program would have the name of that of {parts[first].input.source}"
            raise JobError(
                source,
                what,
                part.program,
                'build them into two folders, or by one pattern with "**"',
            )
        if identity(folder / part.program) in read:
            what = "its program would overwrite a file that is read"
            raise JobError(source, what, part.program, "give another folder with -o")
    return [_unless_there(part, folder, records) for part in parts], owners


def _part(place: int, one: BatchInput, order: Order, suffix: str, made_by: str) -> BatchPart:
    name = one.source.stem
    job_file = None
    files = Files()  # of this part alone: its bytes are not kept while the others are looked at
    try:
        if not _is_text(one.source):
            raise InputError(str(one.source), "its name is no UTF-8 text", remedy="rename it")
        if order.post.endswith(".py"):
            files.read(order.post)  # Python imports it; what it was made from stays
        job_file = find_job_file(order.job, one.source)
        job = load_job(job_file, order.sets, files)
        name = str(job.post.get("program") or name)
        total = f"{made_by} {one.source.name} {name} {order.strict} {compute_digest(job, [one.source], files)}"
    except CamgenError as error:
        return BatchPart(
            one,
            (one.folder / (name + suffix)).as_posix(),
            "",
            files.opened,
            outcome=Outcome(error.exit_code, str(error)),
        )
    task = Task(
        place, one.source, order.post, job, str(job_file or "job"), order.strict, __version__
    )
    digest = hashlib.sha256(total.encode("utf-8", "surrogateescape")).hexdigest()
    return BatchPart(one, (one.folder / (name + suffix)).as_posix(), digest, files.opened, task)


def _is_text(path: Path) -> bool:
    """Whether a name can stand in the state and the report of a batch, which are UTF-8."""
    try:
        path.as_posix().encode()
    except UnicodeEncodeError:
        return False
    return True


def _unless_there(part: BatchPart, folder: Path, records: Mapping[str, Record]) -> BatchPart:
    record = records.get(part.program)
    if part.task is None or not is_unchanged(record, part.digest, folder / part.input.folder):
        return part
    return BatchPart(part.input, part.program, part.digest, part.read, record=record)


def _maker(post: str) -> str:
    """What the text depends on beside the job: camgen's version, and that of the post."""
    if post.endswith(".py"):
        return f"{__version__} {hashlib.sha256(Files().read(post).data).hexdigest()}"
    (entry,) = (one for one in list_entries(POSTS) if one.name == post)
    return (
        f"{__version__} {post} {entry.dist.name} {entry.dist.version}"
        if entry.dist
        else f"{__version__} {post}"
    )
