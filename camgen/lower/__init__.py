"""Makes a program from a tour: the motions of an arm or a machine, instruction by instruction."""

from __future__ import annotations

from camgen.lower.contours import lower_paths
from camgen.model.cell import Cell
from camgen.model.job import Job
from camgen.model.path import Tour
from camgen.model.program import Program
from camgen.order import ArmTour, EdgeTour, JobTour, ReplayTour, make_changed_paths_error
from camgen.robots.workcell import Workcell


def lower(
    tour: Tour, cell: Cell, job: Job, name: str = "part", header: tuple[str, ...] = ()
) -> Program:
    """The program that runs a tour from and back to the home position of the cell, in its frames.

    Raises JobError for settings that contradict each other, NoSafeProgram if there is no path.

    name, header: name of the program, lines of its header.
    """
    if isinstance(tour, (ArmTour, EdgeTour, ReplayTour)) and tour.paths is not tour.original_paths:
        raise make_changed_paths_error()
    if isinstance(tour, EdgeTour):
        from camgen.lower.edges import lower_edges  # noqa: PLC0415 (robots: only for edges)

        return lower_edges(tour, cell, job, name, header)
    if isinstance(tour, ReplayTour):
        from camgen.lower.replay import (  # noqa: PLC0415 (only for replays)
            lower_replay,
            lower_taught,
        )

        return (lower_taught if tour.run.whole else lower_replay)(tour, cell, job, name, header)
    if isinstance(tour, JobTour):
        from camgen.lower.steps import lower_steps  # noqa: PLC0415 (only for several operations)

        program = lower_steps(tour, cell, job, name, header)
        steps = zip(tour.steps, tour.tours, strict=True)
        tools = [(step.tool, len(part.paths)) for step, part in steps]
    else:
        program = lower_paths(tour, cell, job, name, header)
        tools = [(job.tool, len(tour.paths))]
    if not isinstance(cell, Workcell) or cell.fixtures is None:
        return program
    from camgen.lower.over_fixtures import lift_over_fixtures  # noqa: PLC0415 (only with fixtures)

    return lift_over_fixtures(program, cell.fixtures, tools)
