"""The header of a program of ours: the post and the job for which it was written."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from glob import escape
from pathlib import Path

from msgspec import Struct

from camgen.lang.programs import Finding, Frames
from camgen.model.errors import JobError
from camgen.model.job import Job
from camgen.model.plugins import list_entries
from camgen.model.pose import format_frame
from camgen.post.plugins import POSTS
from camgen.read.files import Files

#: Lines of a text in which a header stands.
_LINES = 60
_JOB = re.compile(r"\bcamgen (\S+) - job ([0-9a-f]{12})\b")
_POST = re.compile(r"\bpost: (\w+) - cell: ")
_WORK = re.compile(r"work frame: (\S+(?: \S+){5})")
_TOOL = re.compile(r"tool: .* - frame (\S+(?: \S+){5})")
_PLACE = re.compile(r"\bprogram [1-9][0-9]* of [1-9][0-9]*\b")
#: Characters around a line of a header that make it a comment.
_COMMENT = " \t()!;'"
_NUMBER = re.compile(r"_[1-9][0-9]*$")


class Header(Struct, frozen=True):
    """The header of a program.

    post: name of its post.
    version: version of camgen that wrote it.
    digest: digest of the job and the part.
    lines: lines of the header.
    is_one_of: whether it is one of several programs of a job.
    """

    post: str
    version: str
    digest: str
    lines: frozenset[str]
    is_one_of: bool

    @property
    def is_located(self) -> bool:
        """Whether a photo says where the part lies."""
        return any(line.startswith("drawing located by a photo") for line in self.lines)


def read_header(texts: Mapping[str, str]) -> Header | None:
    """The header of the first text; None for a text of another hand."""
    head = next(iter(texts.values()), "").split("\n", _LINES)[:_LINES]
    job, post = _JOB.search("\n".join(head)), _POST.search("\n".join(head))
    if job is None or post is None:
        return None
    lines = frozenset(line.strip(_COMMENT) for line in head)
    return Header(post[1], job[1], job[2], lines, any(map(_PLACE.fullmatch, lines)))


def find_stale_frames(texts: Mapping[str, str], frames: Sequence[Frames]) -> list[Finding]:
    """The lines of the header whose tool or work frame is none of those that the program sets.

    Frames that only the controller stores are not compared.
    """
    head = next(iter(texts.values()), "").split("\n", _LINES)[:_LINES]
    findings = []
    for pattern, kind, poses in (
        (_WORK, "work", [frame.base_from_work for frame in frames]),
        (_TOOL, "tool", [frame.flange_from_tool for frame in frames]),
    ):
        stated = {format_frame(pose) for pose in poses if pose is not None}
        if not stated or None in poses:
            continue
        others = " or ".join(sorted(stated))
        for number, line in enumerate(head, 1):
            match = pattern.fullmatch(line.strip(_COMMENT))
            if match and match[1] not in stated:
                what = f"the header says {kind} frame {match[1]}, the program sets {others}"
                findings.append(Finding("unusual", number, what))
    return findings


def name_source(program: Path, header: Header | None) -> Path:
    """The program, with the name that it would have alone: `part.pcs` for `part_2.pcs`."""
    if header is None or not header.is_one_of:
        return program
    return program.with_stem(_NUMBER.sub("", program.stem))


def find_part(header: Header, source: Path, job: Job, files: Files) -> Path:
    """The part beside the program, if job and part are those of its header.

    The header names no file that is opened: the part is a file beside the program with the stem of
    `source`.

    Raises JobError if a post, a part or the digest does not agree.
    """
    from camgen.pipeline import format_part_name  # noqa: PLC0415 (only for our texts)
    from camgen.pipeline.inputs import compute_digest  # noqa: PLC0415
    from camgen.pipeline.rounding import limit_path_tolerance  # noqa: PLC0415

    remedy = "name the controller with --post"
    if header.is_located:
        raise JobError(
            "--post", "is not given, and the place of the part comes from a photo", remedy=remedy
        )
    if not any(entry.name == header.post for entry in list_entries(POSTS)):
        raise JobError(
            "--post",
            f"is not given, and the header names {header.post}, which is not installed",
            remedy=remedy,
        )
    settings = limit_path_tolerance(job, header.post)
    neighbours = sorted(source.parent.glob(f"{escape(source.stem)}.*"))
    what = f"is not given, and no part {source.stem}.* stands beside the program"
    for part in neighbours:
        if format_part_name(part.name) in header.lines and part.is_file():
            if compute_digest(settings, [part], files) == header.digest:
                return part
            what = "is not given, and the job or the part has changed since the program was written"
    raise JobError("--post", what, remedy=remedy)
