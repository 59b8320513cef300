"""The subject of a proof: the motions of one task in one program, with hints about them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from camgen.check.proof.earlier import EarlierCuts
from camgen.check.proof.hints import Named, Program
from camgen.check.proof.motions import Controller, Motions, Rounding, tabulate
from camgen.check.proof.outputs import process_signal
from camgen.check.proof.pieces import BoolArray, IntArray
from camgen.check.proof.tasks import Drawing, Task
from camgen.check.proof.travel import Phases
from camgen.model.job import ProcessTable


class Context(NamedTuple):
    """Values that all tasks share.

    drawing: the contours of the part.
    named: ids in notes.
    rounding: rounding of the numbers of the texts.
    controller: the controller of the texts, if it is known.
    tables: the motions of each program by its name and by the output that is the signal.
    """

    drawing: Drawing
    named: Named
    rounding: Rounding
    controller: Controller | None
    tables: dict[tuple[str, str], Motions]

    def tabulate(self, program: Program, process: ProcessTable) -> Motions:
        """The motions of a program, with the output of `process` as the signal."""
        signal = process_signal(process)
        key = program.file, signal
        if key not in self.tables:
            self.tables[key] = tabulate(program.body, program.lines, program.path, signal)
        return self.tables[key]


def are_named(drawing: Drawing, names: frozenset[str]) -> BoolArray:
    """(C,) contours that are among `names`, by their ids or by those that they were made of."""
    if not names:
        return np.zeros(len(drawing.contours), np.bool_)
    listed = [
        contour.id in names or not names.isdisjoint(contour.sources) for contour in drawing.contours
    ]
    return np.array(listed, np.bool_)


class Subject(NamedTuple):
    """The motions of one task in one program, M in all.

    earlier: motions of earlier operations, if the task takes only what they leave.
    """

    task: Task
    context: Context
    program: Program
    motions: Motions
    phases: Phases
    of_task: BoolArray
    slack: float
    earlier: EarlierCuts | None = None

    @property
    def drawing(self) -> Drawing:
        """The contours of the part."""
        return self.context.drawing

    @property
    def limit(self) -> float:
        """Distance, mm, that a motion may have from its place in the drawing."""
        return self.slack + self.drawing.slack

    @property
    def works(self) -> IntArray:
        """The motions in contact."""
        return np.flatnonzero(self.phases.works & self.of_task)
