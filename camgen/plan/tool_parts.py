"""Splits an old program at its tool changes and assigns a tool of the job to each part."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import takewhile

from msgspec import Struct

from camgen.lang.recorded import Recorded
from camgen.model.errors import InputError
from camgen.model.job import Job, ToolTable
from camgen.model.part import Note
from camgen.model.pose import TOOL_DOWN, Pose
from camgen.model.program import Instruction, Motion, MoveC, MoveJ, MoveL, ToolChange
from camgen.model.tolerance import SAME_POINT_MM


class ToolPart(Struct, frozen=True, eq=False):
    """The part of a program that one tool runs.

    tool: the tool; None for the only tool of a program, which is the tool of the job.
    known: the job describes the tool, not only the tool table of the machine.
    body: instructions without tool changes; the first motion is a rapid motion.
    lines: line of each instruction.
    entry: feed to an assumed start, mm/s; 0 without one.
    """

    tool: ToolTable | None
    known: bool
    body: tuple[Instruction, ...]
    lines: tuple[int, ...]
    entry: float = 0.0


class _Section(Struct, frozen=True, eq=False):
    """The instructions from one tool change to the next.

    number: number of the tool, None for the tool that is loaded at the start.
    line: line of the tool change.
    rows: the instructions, each with its line.
    """

    number: int | None
    line: int
    rows: list[tuple[Instruction, int]]

    @property
    def cuts(self) -> bool:
        """True if the section has a motion at feed."""
        return any(isinstance(item, MoveL | MoveC) for item, _ in self.rows)


def split_by_tool(
    part: Recorded, job: Job, on_arm: bool
) -> tuple[tuple[ToolPart, ...], tuple[Note, ...]]:
    """Split the program into one part per tool, in its order, with notes.

    on_arm: an arm runs the program, so the length of each tool has to be known.
    Raises InputError if the tool of a cut is not stated, or its length is not known.
    """
    sections, notes = _drop_unused(_split_at_changes(part))
    first = sections[0].number
    if first is None and len(sections) > 1:
        raise InputError(
            part.source,
            f"cuts before its first tool change, to T{sections[1].number}, "
            "and does not state with which tool",
            f"line {sections[1].line}",
            "begin it with the number of that tool and M6",
        )
    tools: dict[int, ToolTable] = {row.number: row for row in job.tools if row.number}
    if job.tool.number and job.tool.number not in tools:
        tools[job.tool.number] = job.tool
    if len(sections) == 1 and first not in tools:
        if first is not None:
            notes.append(
                Note(
                    "assumed",
                    f"line {sections[0].line}: tool T{first} is the tool of the job",
                    "its length and diameter are in no program",
                )
            )
        return (_make_part(sections[0], None, False, part.run.entry),), tuple(notes)
    unknown: dict[str, int] = {}
    for section in sections:
        if section.number not in tools:
            unknown.setdefault(f"T{section.number}", section.line)
    if unknown and on_arm:
        raise InputError(
            part.source,
            f"changes to tool {next(iter(unknown))}, whose length is not known",
            f"line {next(iter(unknown.values()))}",
            "give each tool a row of [[tools]] with its number, length and diameter",
        )
    if unknown:
        notes.append(
            Note(
                "assumed",
                f"{', '.join(unknown)}: of the machine's tool table",
                "no row of [[tools]] has their length and diameter",
            )
        )
    parts = []
    for k, section in enumerate(sections):
        number = section.number or 0
        tool = tools.get(number, ToolTable(name=f"T{number}", number=number))
        started = _add_start(section, sections[k - 1], job) if k else section
        parts.append(_make_part(started, tool, number in tools, 0.0 if k else part.run.entry))
    return tuple(parts), tuple(notes)


def _make_part(section: _Section, tool: ToolTable | None, known: bool, entry: float) -> ToolPart:
    body, lines = zip(*section.rows, strict=True)
    return ToolPart(tool, known, body, lines, entry)


def _split_at_changes(part: Recorded) -> list[_Section]:
    sections = [_Section(None, 0, [])]
    for item, line in zip(part.run.body, part.run.lines, strict=True):
        if not isinstance(item, ToolChange):
            sections[-1].rows.append((item, line))
        elif item.number != sections[-1].number:
            sections.append(_Section(item.number, line, []))
    return sections


def _drop_unused(sections: Sequence[_Section]) -> tuple[list[_Section], list[Note]]:
    """Drop the motions of tools that cut nothing, with a note each.

    Their other instructions go to the section before, or to the first one that cuts.
    """
    cutting: list[_Section] = []
    notes: list[Note] = []
    waiting: list[tuple[Instruction, int]] = []
    for section in sections:
        if section.cuts:
            cutting.append(_Section(section.number, section.line, [*waiting, *section.rows]))
            waiting = []
            continue
        others = [(item, line) for item, line in section.rows if not isinstance(item, MoveJ)]
        (cutting[-1].rows if cutting else waiting).extend(others)
        if section.number:
            notes.append(
                Note(
                    "skipped",
                    f"line {section.line}: tool T{section.number} is loaded and cuts nothing",
                    "the change and its rapid motions are left out",
                )
            )
        elif len(others) < len(section.rows) and section.number is None:
            line = section.rows[0][1]
            notes.append(
                Note(
                    "assumed",
                    f"line {line}: rapid motions before the first tool change are left out",
                    "the machine comes from its home",
                )
            )
    joined = cutting[:1]
    for section in cutting[1:]:
        if section.number == joined[-1].number:
            joined[-1].rows.extend(section.rows)
        else:
            joined.append(section)
    return joined, notes


def _add_start(section: _Section, before: _Section, job: Job) -> _Section:
    """Start a section after a tool change, whose end position the program does not state.

    Rapid motions at the old height are replaced by one at the clearance height or above. If the
    tool cuts from the old height on, it comes down to it at the feed of the cut.
    """
    last = next(
        item for item, _ in reversed(before.rows) if isinstance(item, MoveJ | MoveL | MoveC)
    )
    height, rows = _get_target(last).origin[2], list(section.rows)
    motions = {
        k: item for k, (item, _) in enumerate(rows) if isinstance(item, MoveJ | MoveL | MoveC)
    }
    leading = list(takewhile(lambda k: _keeps_height(motions[k], height), motions))
    first = next(k for k in motions if k not in leading)
    if not leading and isinstance(motions[first], MoveJ):
        return section
    x, y, _ = _get_target(motions[leading[-1]] if leading else last).origin
    line = rows[first][1]
    added: list[tuple[Instruction, int]] = [
        (MoveJ(Pose(TOOL_DOWN, (x, y, max(height, job.process.clearance))), last.speed), line)
    ]
    if not isinstance(motions[first], MoveJ):
        added.append((MoveL(Pose(TOOL_DOWN, (x, y, height)), motions[first].speed), line))
    rows[first:first] = added
    return _Section(
        section.number, section.line, [row for k, row in enumerate(rows) if k not in leading]
    )


def _keeps_height(item: Motion, height: float) -> bool:
    return isinstance(item, MoveJ) and abs(_get_target(item).origin[2] - height) <= SAME_POINT_MM


def _get_target(item: Motion) -> Pose:
    assert isinstance(item.target, Pose)  # G-code has no joint values
    return item.target
