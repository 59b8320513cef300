"""Whether a program stays within the travel of the machine that `cell.machine` describes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from msgspec import Struct

from camgen.check.axis_limits import limit_along
from camgen.check.report import clean
from camgen.check.time import compute_motion_shapes
from camgen.check.travel import exceed_travel, leave_travel, measure_extent, size_of
from camgen.model.errors import NoSafeProgram
from camgen.model.job import Job
from camgen.model.machine import Machine
from camgen.model.part import Note
from camgen.model.pose import FloatArray, Vec3, to_vec3
from camgen.model.program import Columns, MoveJ, Program, ToolChange, read_column
from camgen.model.text import counted, grouped, short
from camgen.robots.workcell import Workcell

if TYPE_CHECKING:
    from camgen.pipeline.programs import PostedText

#: A feed is above a rate from this multiple of it on, beyond the digits of a feed.
_SAME_RATE = 1 + 1e-6
#: The option of a post with the tool whose length the program applies.
_TOOL = "tool"


class Travel(Struct, frozen=True):
    """The programs in the travel of the machine.

    machine: the machine.
    low, high: extreme positions, mm; machine coordinates if `placed`, else those of the work.
    placed: whether positions were compared; else only the extent was, the work offset is not known.
    """

    machine: Machine
    low: Vec3
    high: Vec3
    placed: bool

    def __str__(self) -> str:
        size, travel = size_of(self.low, self.high), size_of(self.machine.low, self.machine.high)
        text = f"{size} within the travel of {travel} of {self.machine.file}"
        if self.placed:
            return text
        return f"{text}; not proven: its place, cell.base_from_work states no work offset"

    def report(self) -> dict[str, object]:
        """The machine and the travel that the program takes, as a table of the report."""
        machine = self.machine
        table = {
            "file": clean(machine.file),
            "controller": machine.controller,
            "travel_mm": [_digits(machine.low), _digits(machine.high)],
            "extent_mm": [_digits(self.low), _digits(self.high)],
            "placed": self.placed,
        }
        return {"machine": table}


def _digits(position: Vec3) -> list[float]:
    # 0.0 is added against a zero with a sign.
    return [round(value, 3) + 0.0 for value in position]


def check_travel(job: Job, cell: Workcell, texts: Sequence[PostedText]) -> Travel:
    """The travel that the texts take, as they were read back.

    cell: a cell with a machine.

    Raises NoSafeProgram for a program that leaves the travel.
    """
    machine = cell.machine
    assert machine is not None
    placed = job.cell.base_from_work is not None
    low, high = np.full(3, np.inf), np.full(3, -np.inf)
    for text in texts:
        columns = Columns(text.executed.body)
        extent = measure_extent(columns, _find_shift(text, job, cell, placed))
        excess = (leave_travel if placed else exceed_travel)(extent, machine)
        if excess is not None:
            line = text.executed.lines[columns.at[excess.motion]]
            what = f"the program leaves the travel of {machine.file}: {excess.text}"
            remedy = "move the part: cell.base_from_work" if placed else "divide the part"
            if cell.fixtures is not None:
                remedy += "; cell.safety is the room above fixtures"
            raise NoSafeProgram(text.name, what, f"line {line}", remedy)
        low, high = np.minimum(low, extent.low), np.maximum(high, extent.high)
    return Travel(machine, to_vec3(low), to_vec3(high), placed)


def note_rates(cell: Workcell, program: Program) -> tuple[Note, ...]:
    """Feeds that the axes of the machine do not reach: its controller runs them slower.

    cell: a cell with a machine.
    """
    axes = cell.pace.axes
    assert axes is not None
    assert cell.machine is not None
    columns = program.columns
    shape = compute_motion_shapes(program, None)
    rates = np.minimum(limit_along(axes.rates, shape.first), cell.pace.fastest)
    feeds = ~columns.moves_are(MoveJ) & (shape.length > 0)
    above = feeds & (columns.speed > rates * _SAME_RATE)
    count = int(above.sum())
    if not count:
        return ()
    slowest = f"{short(float(rates[above].min()), 3)} mm/s"
    of_all = f"{grouped(count)} of {counted(int(feeds.sum()), 'motion')} with a feed"
    what = f"{of_all} ask for more than {cell.machine.file} allows, down to {slowest}"
    return (Note("warning", what, "the controller runs them slower, and the time counts that"),)


def _find_shift(text: PostedText, job: Job, cell: Workcell, placed: bool) -> FloatArray:
    """(M, 3) mm from the positions of the text to positions of the machine.

    The work offset is added, and the length of a tool where the program applies it (G43). Without a
    work offset the positions of the first tool are not shifted.
    """
    columns = text.program.columns
    shift = np.zeros((len(columns.moves), 3))
    changes = np.flatnonzero(columns.are(ToolChange))
    first = job.tool.length if getattr(text.post, _TOOL, 0) else 0.0
    lengths = np.append(first, read_column(columns.list_kinds(ToolChange), "length"))
    shift[:, 2] = lengths[np.searchsorted(changes, columns.at)]
    return np.asarray(shift + (np.asarray(cell.base_from_work.origin) if placed else -shift[:1]))
