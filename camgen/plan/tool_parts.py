"""Old programs with tool changes: which part of one each tool runs, and which tool that is."""

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
    """What one tool runs. tool: None where the program is for the one that is in. known: the job says what it is, not
    the machine's table alone. body, lines: as in ``ProgramRun``, without tool changes; it begins with a rapid motion.
    entry: the feed at which an assumed start is reached, mm/s; 0: none is.
    """

    tool: ToolTable | None
    known: bool
    body: tuple[Instruction, ...]
    lines: tuple[int, ...]
    entry: float = 0.0


class _Cut(Struct, frozen=True, eq=False):
    """The instructions from one tool change to the next, each with its line. line: of the change. number: of the tool,
    None: that which is in.
    """

    number: int | None
    line: int
    rows: list[tuple[Instruction, int]]

    @property
    def cuts(self) -> bool:
        """Whether anything is done at feed."""
        return any(isinstance(item, MoveL | MoveC) for item, _ in self.rows)


def split_by_tool(
    part: Recorded, job: Job, one_length: bool
) -> tuple[tuple[ToolPart, ...], tuple[Note, ...]]:
    """The program by its tools, in its order. one_length: whether each tool must be as long as it is, as at an arm.

    InputError where no text says which tool it is that cuts, or how long it is.
    """
    cuts, notes = _without_idle(_split(part))
    if cuts[0].number is None and len(cuts) > 1:
        what = f"changes to tool T{cuts[1].number} after the first cut: with which one it cuts before, it does not say"
        raise InputError(
            part.source,
            what,
            f"line {cuts[1].line}",
            "begin it with the number of that tool and M6",
        )
    rows: dict[int, ToolTable] = {row.number: row for row in job.tools if row.number}
    rows |= {job.tool.number: job.tool} if job.tool.number and job.tool.number not in rows else {}
    first = cuts[0].number
    if len(cuts) == 1 and first not in rows:
        if first is not None:
            why = "its length and diameter are in no program"
            notes.append(
                Note("assumed", f"line {cuts[0].line}: tool T{first} is the tool of the job", why)
            )
        return (_part(cuts[0], None, False, part.run.entry),), tuple(notes)
    if one_length:
        _insist_on_rows(part.source, cuts, rows)
    missing = [f"T{one.number}" for one in cuts if one.number not in rows]
    if missing:
        what = f"{', '.join(dict.fromkeys(missing))}: of the machine's tool table"
        notes.append(Note("assumed", what, "no row of [[tools]] says their length and diameter"))
    found = []
    for k, one in enumerate(cuts):
        number = one.number or 0
        tool = rows.get(number, ToolTable(name=f"T{number}", number=number))
        begun = _begin(one, cuts[k - 1], job) if k else one
        found.append(_part(begun, tool, number in rows, 0.0 if k else part.run.entry))
    return tuple(found), tuple(notes)


def _part(one: _Cut, tool: ToolTable | None, known: bool, entry: float) -> ToolPart:
    return ToolPart(
        tool, known, tuple(item for item, _ in one.rows), tuple(line for _, line in one.rows), entry
    )


def _insist_on_rows(source: str, cuts: Sequence[_Cut], rows: dict[int, ToolTable]) -> None:
    for one in cuts:
        if one.number not in rows:
            what = f"changes to tool T{one.number}, and how long that is no text says"
            remedy = "give each tool a row of [[tools]] with its number, length and diameter"
            raise InputError(source, what, f"line {one.line}", remedy)


def _split(part: Recorded) -> list[_Cut]:
    """At each change to another tool."""
    every = list(zip(part.run.body, part.run.lines, strict=True))
    found = [_Cut(None, 0, [])]
    for item, line in every:
        if not isinstance(item, ToolChange):
            found[-1].rows.append((item, line))
        elif item.number != found[-1].number:
            found.append(_Cut(item.number, line, []))
    return found


def _without_idle(cuts: Sequence[_Cut]) -> tuple[list[_Cut], list[Note]]:
    """Without tools that cut nothing: what is moved with them is left out, what is switched stays with the tool before,
    or with the one that comes first.
    """
    kept: list[_Cut] = []
    notes: list[Note] = []
    waiting: list[tuple[Instruction, int]] = []
    for one in cuts:
        if one.cuts:
            kept.append(_Cut(one.number, one.line, [*waiting, *one.rows]))
            waiting = []
            continue
        rest = [(item, line) for item, line in one.rows if not isinstance(item, MoveJ)]
        (kept[-1].rows if kept else waiting).extend(rest)
        if one.number:
            what = f"line {one.line}: tool T{one.number} is changed to and cuts nothing"
            notes.append(Note("skipped", what, "the change and its rapid motions are left out"))
        elif len(rest) < len(one.rows) and one.number is None:
            what = f"line {one.rows[0][1]}: rapid motions before the first tool change are left out"
            notes.append(Note("assumed", what, "the machine comes from its home"))
    joined = kept[:1]
    for one in kept[1:]:
        if one.number == joined[-1].number:
            joined[-1].rows.extend(one.rows)
        else:
            joined.append(one)
    return joined, notes


def _begin(one: _Cut, before: _Cut, job: Job) -> _Cut:
    """A part behind another one: where the tool stands after a change no text says. Rapid motions that keep the old
    height run at the height of travel; if the tool cuts from the old height on, it comes down to that at its feed.
    """
    last = next(
        item for item, _ in reversed(before.rows) if isinstance(item, MoveJ | MoveL | MoveC)
    )
    old, rows = _at(last).origin[2], list(one.rows)
    moves = {k: item for k, (item, _) in enumerate(rows) if isinstance(item, MoveJ | MoveL | MoveC)}
    leading = list(takewhile(lambda k: _keeps_height(moves[k], old), moves))
    first = next(k for k in moves if k not in leading)
    if not leading and isinstance(moves[first], MoveJ):
        return one
    x, y, _ = _at(moves[leading[-1]] if leading else last).origin
    line = rows[first][1]
    made: list[tuple[Instruction, int]] = [
        (MoveJ(Pose(TOOL_DOWN, (x, y, max(old, job.process.clearance))), last.speed), line)
    ]
    if not isinstance(moves[first], MoveJ):
        made.append((MoveL(Pose(TOOL_DOWN, (x, y, old)), moves[first].speed), line))
    rows[first:first] = made
    return _Cut(one.number, one.line, [row for k, row in enumerate(rows) if k not in leading])


def _keeps_height(item: Motion, height: float) -> bool:
    return isinstance(item, MoveJ) and abs(_at(item).origin[2] - height) <= SAME_POINT_MM


def _at(item: Motion) -> Pose:
    """Where it ends; G-code has no joint values."""
    assert isinstance(item.target, Pose)
    return item.target
