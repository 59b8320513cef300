"""Tours with more than their paths: links of an arm, a program that was read, operations."""

from __future__ import annotations

from typing import TYPE_CHECKING

from camgen.model.job import Step
from camgen.model.path import ToolPath, Tour
from camgen.model.pose import FloatArray

if TYPE_CHECKING:
    from camgen.lang.recorded import ProgramRun
    from camgen.order.edges.route import Route
    from camgen.plan.tool_parts import ToolPart


class EdgeTour(Tour, frozen=True, eq=False, kw_only=True):
    """A tour of edges of a 3-D part.

    route: the motions with the links that lead to them.
    lengths: length of the edge of each leg, mm.
    original_paths: the paths as they were ordered.
    """

    route: Route
    lengths: tuple[float, ...]
    original_paths: tuple[ToolPath, ...]


class ArmTour(Tour, frozen=True, eq=False, kw_only=True):
    """A tour of paths of a flat part by an arm that chooses the roll of its tool.

    rolls: (N,) roll from the nominal orientation at the waypoints of each path, rad.
    links: joint values (J,) that lead to above the start of each path; empty for a straight line.
    back: joint values (J,) that lead from the last path to home.
    link_speeds, back_speeds: speeds of these motions: of the TCP, mm/s, and the fraction of the
        maximum joint speeds; 0 if the first alone applies.
    seconds: time of all links, s.
    original_paths: the paths as they were ordered.
    """

    rolls: tuple[FloatArray, ...]
    links: tuple[tuple[FloatArray, ...], ...]
    back: tuple[FloatArray, ...]
    link_speeds: tuple[tuple[tuple[float, float], ...], ...]
    back_speeds: tuple[tuple[float, float], ...]
    seconds: float
    original_paths: tuple[ToolPath, ...]


class ReplayTour(Tour, frozen=True, eq=False, kw_only=True):
    """The paths of a program that was read, and the run of that program.

    run: the program as it was run.
    original_paths: the paths as they were ordered.
    parts: parts of the program by tool, as in `ReplayPlan`.
    """

    run: ProgramRun
    original_paths: tuple[ToolPath, ...]
    parts: tuple[ToolPart, ...] = ()


class JobTour(Tour, frozen=True, eq=False, kw_only=True):
    """Several operations one after the other.

    steps: the steps of the job.
    numbers: indices of the operations in `Job.operations`.
    tours: the tour of each operation; their paths, one after the other, are the paths.
    links: points (K, 3) in mm on which the tool comes to the first path of each operation at
        working height, from the operation before; None if the tool is lifted.
    """

    steps: tuple[Step, ...]
    numbers: tuple[int, ...]
    tours: tuple[Tour, ...]
    links: tuple[FloatArray | None, ...]
