"""The statements of a program that its runs came to."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable

import numpy as np
from msgspec import Struct

from camgen.lang.code import Act, Code
from camgen.model.program import Indices, Mask
from camgen.model.text import counted, grouped

#: Number of gaps that the summary lists.
_GAP_LIMIT = 5


class Coverage(Struct, frozen=True, eq=False):
    """The statements of a program, and which of them ran.

    lines: (N,) lines that hold a statement, from 1 through all files, ascending.
    ran: (N,) whether a run came to the line.
    """

    lines: Indices
    ran: Mask

    @property
    def share(self) -> float:
        """Share of the lines that ran, from 0 to 1. 1 for a program without a statement."""
        return float(self.ran.mean()) if len(self.ran) else 1.0

    def as_data(self) -> dict[str, int]:
        """The numbers of statements, and of those that ran."""
        return {"statements": len(self.lines), "run": int(self.ran.sum())}

    def list_gaps(self) -> list[tuple[int, int]]:
        """First and last line of each group of statements that did not run."""
        edges = np.diff(np.concatenate(([False], ~self.ran, [False])).astype(np.int8))
        firsts, ends = np.flatnonzero(edges > 0), np.flatnonzero(edges < 0)
        first_lines, last_lines = self.lines[firsts].tolist(), self.lines[ends - 1].tolist()
        return list(zip(first_lines, last_lines, strict=True))


def measure_coverage(codes: Iterable[Code], ran: Collection[int], end: int) -> Coverage:
    """The coverage of routines by a run.

    codes: all routines of the program.
    ran: lines of the steps that the run came to, see `Log.ran`.
    end: line where the run ended. If a step of several lines was not completed, it ran to there.
    """
    lines: list[int] = []
    done: list[int] = []
    for code in codes:
        for step in code.steps:
            if not isinstance(step, Act) or step.lines == 1:
                lines.append(step.line)
                continue
            several = range(step.line, step.line + step.lines)
            lines += several
            if step.line in ran:
                is_cut = end in several and several[-1] not in ran
                done += range(step.line, end + 1) if is_cut else several
    statements = np.unique(np.array(lines, np.intp))
    return Coverage(statements, np.isin(statements, np.array([*ran, *done], np.intp)))


def join_coverage(coverages: Iterable[Coverage | None]) -> Coverage | None:
    """The coverage by several runs of one program. None if a run has none."""
    joined: Coverage | None = None
    for coverage in coverages:
        if coverage is None:
            return None
        ran = coverage.ran if joined is None else joined.ran | coverage.ran
        joined = Coverage(coverage.lines, ran)
    return joined


def format_coverage(
    coverage: Coverage | None, find: Callable[[int], tuple[str, int]]
) -> list[tuple[str, str]]:
    """A row of the summary with the statements that ran; none without a statement.

    find: file, and number in it, of a line that is counted through all files.
    """
    if coverage is None or not len(coverage.lines):
        return []
    count, run = len(coverage.lines), int(coverage.ran.sum())
    if run == count:
        return [("coverage", f"all {counted(count, 'statement')} run")]
    gaps = coverage.list_gaps()
    text = f"{grouped(run)} of {counted(count, 'statement')} run ({int(100 * coverage.share)} %)"
    text += ", not run: "
    text += ", ".join(_format_gap(find(first), find(last)) for first, last in gaps[:_GAP_LIMIT])
    if len(gaps) > _GAP_LIMIT:
        text += f" and {counted(len(gaps) - _GAP_LIMIT, 'more place')}"
    return [("coverage", text)]


def _format_gap(first: tuple[str, int], last: tuple[str, int]) -> str:
    text = f"{first[0]} line {grouped(first[1])}"
    if first == last:
        return text
    file = f"{last[0]} line " if first[0] != last[0] else ""
    return f"{text} to {file}{grouped(last[1])}"
