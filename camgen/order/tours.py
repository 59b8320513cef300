"""Tours that know more than their paths: how an arm gets from edge to edge, what a program did between its cuts, which
operations they are of.
"""

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
    """Edges of a 3-D part. route: the motions with the links that lead to them. lengths: mm of each leg's edge. made:
    the paths.
    """

    route: Route
    lengths: tuple[float, ...]
    made: tuple[ToolPath, ...]


class ArmTour(Tour, frozen=True, eq=False, kw_only=True):
    """Paths of a flat part by an arm that chooses how its tool is turned about its axis. turns: by path, (N,) rad from
    the nominal orientation at its waypoints. ways: by path, the joint values (J,) that lead to above its start, one
    after the other; none: a straight line does. back: those that lead from the last path to home. paces, back_paces: of
    each of these motions the speed of the TCP, mm/s, and the share of the joints' greatest speeds, 0 where the speed
    alone holds. seconds: of all ways between the paths. made: the paths.
    """

    turns: tuple[FloatArray, ...]
    ways: tuple[tuple[FloatArray, ...], ...]
    back: tuple[FloatArray, ...]
    paces: tuple[tuple[tuple[float, float], ...], ...]
    back_paces: tuple[tuple[float, float], ...]
    seconds: float
    made: tuple[ToolPath, ...]


class ReplayTour(Tour, frozen=True, eq=False, kw_only=True):
    """The paths of a program that was read, and what it does. made: the paths. parts: as in ``ReplayPlan``."""

    run: ProgramRun
    made: tuple[ToolPath, ...]
    parts: tuple[ToolPart, ...] = ()


class JobTour(Tour, frozen=True, eq=False, kw_only=True):
    """Several operations one after the other. numbers: their places in ``Job.operations``. tours: of each, whose paths,
    one after the other, are the paths.

    links: points (K, 3), mm, for each operation, on which the tool comes to its first path at
        working height, from the operation before. None: the tool is lifted.
    """

    steps: tuple[Step, ...]
    numbers: tuple[int, ...]
    tours: tuple[Tour, ...]
    links: tuple[FloatArray | None, ...]
